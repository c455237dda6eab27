"""Makes plans from the results of kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway.grid import Grid
from antway.planning import Clock, Plan, Problem, Status


def found(problem: Problem, cells: NDArray[np.int32], expanded: int, clock: Clock, *, shortest: bool = True) -> Plan:
    """Return the plan for a path of `cells`, int32[N, 2]; its length is computed from its moves."""
    length = path_length(cells, problem.grid)
    return Plan(Status.FOUND, cells, length, shortest, expanded, clock.elapsed(), length if shortest else 0.0)


def found_shortest(grid: Grid, cells: NDArray[np.int32], diagonals: int, expanded: int, clock: Clock) -> Plan:
    """Return the plan for a shortest path of straight and `diagonals` diagonal moves."""
    length = octile_length(len(cells) - 1, diagonals, grid)
    return Plan(Status.FOUND, cells, length, True, expanded, clock.elapsed(), length)


def octile_length(moves: Any, diagonals: Any, grid: Grid) -> Any:
    """Return the length in m of a path of `moves` moves, of which `diagonals` are diagonal; or of many paths, from arrays."""
    return (moves - diagonals + math.sqrt(2) * diagonals) * grid.resolution


def not_found(no_path: bool, expanded: int, clock: Clock) -> Plan:
    """Return the plan of a search that proved that there is no path, or that ran out of budget."""
    return Plan(Status.NO_PATH if no_path else Status.BUDGET, expanded=expanded, elapsed=clock.elapsed())


def path_length(cells: NDArray[np.int32], grid: Grid) -> float:
    """Return the length in m of a path of cells, exactly: the number of moves of each kind times their length."""
    steps = cells[1:] - cells[:-1]
    counts = np.bincount((steps * steps).sum(axis=1))
    kinds = np.flatnonzero(counts)
    return math.fsum(math.sqrt(kind) * counts[kind] for kind in kinds.tolist()) * grid.resolution
