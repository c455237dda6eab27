"""Exact distances among all stops on a map."""

from __future__ import annotations

import math
import os
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.grid import Cell, Grid, Moves
from antway.kernels.search.distance_field import STRAIGHT
from antway.search import best_first
from antway.search.costs import checked_costs
from antway.search.derived import NEIGHBOURS, lattice
from antway.search.distance_field import DijkstraField, free_cells

_THREADS = 4  # limit of threads; each keeps the distances of all cells in memory
_STOPS = 16  # least number of stops for each thread; with fewer, another thread does not pay


def stop_distances(
    grid: Grid, stops: Iterable[Iterable[int]], moves: Moves = Moves.EIGHT, *, costs: ArrayLike | None = None
) -> NDArray[np.float64]:
    """Return the exact distances among all `stops`.

    Parameters
    ----------
    grid : Grid
        Inflated by the robot's radius, if it has one.
    stops : sequence of (row, col)
        Free cells.
    moves : Moves
    costs : float[H, W] or None
        Cost of each cell, see `antway.search.costs`; the result is then the least cost instead.

    Returns
    -------
    float64[N, N]
        m, symmetric; infinite if there is no path.

    Raises
    ------
    OutOfBounds, CellBlocked, BadParameter
        If a stop is not a free cell of the map, or a parameter is out of range.

    Notes
    -----
    There is one Dijkstra search for each stop but the last, up to the farthest of the later stops, on several cores.

    Examples
    --------
    >>> stop_distances(Grid(np.zeros((3, 3), dtype=bool)), [(0, 0), (0, 2), (2, 2)]).round(3).tolist()
    [[0.0, 2.0, 2.828], [2.0, 0.0, 2.0], [2.828, 2.0, 0.0]]
    """
    checks.instance("grid", grid, Grid)
    checks.instance("moves", moves, Moves)
    cells = free_cells("stops", stops, grid)
    # Outer stops come first, so that the last ones are near each other.
    middle = np.mean(cells, axis=0)
    turn = np.argsort([-math.dist(cell, middle) for cell in cells], kind="stable")
    weights = None if costs is None else checked_costs(costs, grid)
    if weights is not None or moves not in NEIGHBOURS:
        rows, unit = _by_best_first(grid, [cells[i] for i in turn], moves, weights), grid.resolution
    else:
        rows, unit = _by_cells(grid, [cells[i] for i in turn], moves), grid.resolution / STRAIGHT
    result = np.zeros((len(cells), len(cells)))
    for i, row in enumerate(rows):
        result[turn[i], turn[i + 1 :]] = result[turn[i + 1 :], turn[i]] = row[i + 1 :] * unit
    return result


def _by_best_first(
    grid: Grid, cells: list[Cell], moves: Moves, costs: NDArray[np.float64] | None
) -> Iterator[NDArray[np.float64]]:
    rows, cols = np.array(cells).T
    for i, cell in enumerate(cells[:-1]):
        field, _ = best_first.field(grid, moves, [cell], cells[i + 1 :], math.inf, costs)
        yield field[rows, cols]


def _by_cells(grid: Grid, cells: list[Cell], moves: Moves) -> Iterator[NDArray[np.float64]]:
    net = lattice(grid, moves)
    places = np.array(cells)
    at = places @ np.array([net.width, 1])
    threads = max(min(os.cpu_count() or 1, _THREADS, len(cells) // _STOPS), 1)

    def rows_from(first: int) -> list[NDArray[np.float64]]:
        field, rows = DijkstraField(net, cells[:1], cells), []
        for i in range(first, len(cells) - 1, threads):
            far = np.abs(places[i + 1 :] - places[i]).max(axis=1)
            # The farthest come first, because the kernel looks for one that is not settled yet, and stops there.
            field.restart(at[i], at[i + 1 :][np.argsort(-far, kind="stable")])
            field.run(None)
            rows.append(field.distances(at))
        return rows

    with ThreadPoolExecutor(threads) as pool:
        found = list(pool.map(rows_from, range(threads)))
    for i in range(len(cells) - 1):
        yield found[i % threads][i // threads]
