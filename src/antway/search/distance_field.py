"""Dijkstra: the distance from every cell to a goal, and the simplest planner of shortest paths."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Cell, Grid, Moves
from antway.kernels.base.jit import call
from antway.kernels.search import distance_field as kernel
from antway.kernels.search.canonical import START, Lattice
from antway.kernels.search.distance_field import RING, STRAIGHT
from antway.planning import Budget, Clock, Plan, Problem, free_cell, start_clock
from antway.search import best_first as heap
from antway.search.costs import checked_costs
from antway.search.derived import NEIGHBOURS, lattice, longer
from antway.search.result import found, not_found

STEPS = 1 << 15  # cells expanded between two looks at the clock, about 5 ms


def distance_field(
    grid: Grid,
    goal: Cell | Iterable[Cell],
    moves: Moves = Moves.EIGHT,
    *,
    until: Cell | Iterable[Cell] | None = None,
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
    until : (row, col), or several of them, or None
        Free cells. The search stops once their distances are known; cells that are not settled by then are infinite.
    within : float
        Cells farther than this are infinite, m, >= 0.
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
    goals = free_cells("goal", goal, grid)
    targets = [] if until is None else free_cells("until", until, grid)
    cells = within / grid.resolution * (1 + 1e-12)  # a cell at exactly that distance counts, in spite of rounding
    if costs is None and moves in NEIGHBOURS:
        search = DijkstraField(lattice(grid, moves), goals, targets, cells)
        search.run(None)
        field, unit, known = search.label.reshape(grid.shape), grid.resolution / STRAIGHT, search.known
    else:
        field, known = heap.field(grid, moves, goals, targets, cells, None if costs is None else checked_costs(costs, grid))
        unit = grid.resolution
    if known < math.inf:
        field[field > known] = np.inf
    field *= unit
    return field


def free_cells(name: str, value: object, grid: Grid) -> list[Cell]:
    """Return one cell or several as a list of free cells of `grid`, or raise the error that says what is wrong."""
    parts = checks.sequence(name, value, "a cell (row, col) or several")
    if not parts:
        raise BadParameter(name, value, "at least one cell")
    if not isinstance(parts[0], (Iterable, np.ndarray)):
        return [free_cell(name, tuple(parts), grid)]
    return [free_cell(f"{name}[{i}]", part, grid) for i, part in enumerate(parts)]


class DijkstraField:
    """Distances that spread over a lattice; `label`, float64[cells], has them in units of 1 / STRAIGHT cells."""

    def __init__(self, net: Lattice, sources: list[Cell], targets: list[Cell], within: float = math.inf) -> None:
        self.net, self.within = net, within
        self.label = np.full(net.around.size, np.inf)
        starts = np.array([net.at(cell) for cell in sources])
        self.label[starts] = 0.0
        first = np.full(RING, -1)
        first[0] = 0
        entries = np.empty((2 * len(starts) + 256, 2), np.int64)
        entries[: len(starts), 0] = starts << 4 | START
        entries[: len(starts), 1] = [*range(1, len(starts)), -1]
        self.state = np.array([0, len(starts), -1, len(starts), 0])
        self.memory = kernel.Memory(self.label, first, entries, self.state)
        self.base = self.span = 0  # bands; after a restart the first label, and more than the length of any path
        self.targets = np.array([net.at(cell) for cell in targets], dtype=np.int64)

    def restart(self, source: int, targets: NDArray[np.int64]) -> None:
        """Start again from the flat cell `source` towards flat cells, in the same arrays; for a field without `within`.

        Labels are not cleared, because that takes a considerable part of the time of a search. Instead each search starts so
        far below the existing labels that those are as good as infinite, until float64 would no longer be exact.
        """
        if self.span == 0:
            self.label.fill(np.inf)
            self.span = math.isqrt(2 * int(np.count_nonzero(self.net.around)) ** 2) + 2 * RING
        self.base -= self.span
        if (self.span - self.base) * STRAIGHT > 2.0**53:
            self.label.fill(np.inf)
            self.base = 0
        self.label[source] = self.base * STRAIGHT
        self.memory.first.fill(-1)
        self.memory.first[self.base & (RING - 1)] = 0
        self.memory.entries[0] = source << 4 | START, -1
        self.state[:] = self.base, 1, -1, 1, 0
        self.targets = targets

    def distances(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the distances of flat cells from the source after a restart, in the units of `label`."""
        away: NDArray[np.float64] = self.label[cells] - self.base * STRAIGHT
        return np.where(away < self.span * STRAIGHT, away, np.inf)

    def run(self, clock: Clock | None) -> bool:
        """Spread until done or until the clock runs out; tell whether it is done."""
        code = kernel.RUNNING
        while code != kernel.DONE and not (clock and clock.spent()):
            code = call(kernel.spread, self.net, self.targets, self.within * STRAIGHT, self.memory, STEPS)
            if code == kernel.FULL:
                self.memory = self.memory._replace(entries=longer(self.memory.entries))
        return code == kernel.DONE

    def path_from(self, cell: Cell) -> NDArray[np.int32]:
        """Return the cells of a shortest path from a cell with a final distance to the nearest source, int32[N, 2]."""
        flat = kernel.descend(self.net, self.label, self.net.at(cell))
        return np.column_stack(np.divmod(flat, self.net.width)).astype(np.int32)

    @property
    def known(self) -> float:
        """All distances up to this are final, in the units of `label`."""
        stopped = self.targets.size and self.state[kernel.OPEN]
        return min(self.within * STRAIGHT, float(self.state[kernel.BAND]) * STRAIGHT - 1 if stopped else math.inf)


def dijkstra(problem: Problem, *, seed: int = 0, budget: Budget = Budget(), costs: ArrayLike | None = None) -> Plan:
    """Return a shortest path, by Dijkstra's search.

    Parameters
    ----------
    problem : Problem
    seed : int
        Not used.
    budget : Budget
    costs : float[H, W] or None
        Cost of each cell, see `antway.search.costs`. The plan is then the cheapest one; it is not marked `optimal`, which
        refers to the length.

    Examples
    --------
    >>> dijkstra(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2))).length
    2.8284271247461903
    """
    clock = start_clock(problem, seed, budget)
    if costs is not None or problem.moves not in NEIGHBOURS:
        return heap.plan(problem, clock, heuristic=False, costs=costs)
    return spread_plan(problem, clock)


def spread_plan(problem: Problem, clock: Clock) -> Plan:
    """Solve a problem with 4 or 8 moves by spreading distances from the start until the goal is reached."""
    net = lattice(problem.grid, problem.moves)
    search = DijkstraField(net, [problem.start], [problem.goal])
    done = search.run(clock)
    expanded = int(search.state[kernel.EXPANDED])
    if not done or search.label[net.at(problem.goal)] == math.inf:
        return not_found(done, expanded, clock)
    return found(problem, np.ascontiguousarray(search.path_from(problem.goal)[::-1]), expanded, clock)
