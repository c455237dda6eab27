"""Dijkstra: the distance from every cell to a goal, and the shortest path as its plainest planner."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Cell, Grid, Moves
from antway.planning import Budget, Plan, Problem, free_cell
from antway.search.costs import checked_costs
from antway.search.derived import graph
from antway.search.heap import NO_FACES, heap_plan, padded, search


def distance_field(
    grid: Grid,
    goal: Cell | Iterable[Cell],
    moves: Moves = Moves.EIGHT,
    *,
    within: float = math.inf,
    costs: ArrayLike | None = None,
) -> NDArray[np.float64]:
    """Return the exact distance from every cell to the nearest goal.

    Parameters
    ----------
    grid : Grid
    goal : (row, col) or several of them
        Free cells.
    moves : Moves
    within : float
        Stop there: cells farther than this are infinite, m, >= 0.
    costs : float[H, W] or None
        Cost of each cell, see `antway.search.costs`; the result is then the least cost instead.

    Returns
    -------
    float64[H, W]
        m; infinite where no goal can be reached, and in blocked cells.

    Raises
    ------
    OutOfBounds, CellBlocked, BadParameter
        If a goal is no free cell of the map, or a parameter is out of range.

    Examples
    --------
    >>> distance_field(Grid(np.zeros((2, 3), dtype=bool), resolution=0.5), (0, 0)).round(3).tolist()
    [[0.0, 0.5, 1.0], [0.5, 0.707, 1.207]]
    """
    checks.instance("grid", grid, Grid)
    checks.instance("moves", moves, Moves)
    within = checks.number("within", within, low=0.0, infinite=True, unit="m")
    goals = goal_cells(goal, grid)
    weights = None if costs is None else checked_costs(costs, grid)
    net = graph(grid, moves)
    limit = within / grid.resolution
    _, labels = search(net, goals, -1, padded(net, weights), NO_FACES, limit, None)
    field = net.inner(labels.label) * grid.resolution
    field[field > within] = np.inf
    return field


def goal_cells(goal: object, grid: Grid) -> list[Cell]:
    """Return one goal or several as a list of free cells."""
    if isinstance(goal, (str, bytes)) or not isinstance(goal, (Iterable, np.ndarray)):
        raise BadParameter("goal", goal, "a cell (row, col) or several")
    parts = list(goal)
    if not parts:
        raise BadParameter("goal", goal, "at least one cell")
    if not isinstance(parts[0], (Iterable, np.ndarray)):
        return [free_cell("goal", parts, grid)]
    return [free_cell(f"goal[{i}]", part, grid) for i, part in enumerate(parts)]


def dijkstra(problem: Problem, *, seed: int = 0, budget: Budget = Budget(), costs: ArrayLike | None = None) -> Plan:
    """Return a shortest path, by Dijkstra's search.

    Parameters
    ----------
    problem : Problem
    seed : int
        Not used.
    budget : Budget
    costs : float[H, W] or None
        Cost of each cell, see `antway.search.costs`; the plan is then the cheapest, and not marked `optimal`, which speaks
        of length.

    Returns
    -------
    Plan

    Examples
    --------
    >>> dijkstra(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2))).length
    2.8284271247461903
    """
    clock = budget.start()
    return heap_plan(problem, clock, heuristic=False, costs=None if costs is None else checked_costs(costs, problem.grid))
