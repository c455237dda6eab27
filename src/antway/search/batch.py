"""Many queries on one map at once, without the cost of a Python call for each."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid, Moves
from antway.kernels.search.astar import FULL, NO_SPACE, solve_all
from antway.planning import Problem, free_cell
from antway.search.astar import MOST_CELLS, Searcher, searcher
from antway.search.derived import NEIGHBOURS, longer
from antway.search.distance_field import dijkstra
from antway.search.jps import jumps_pay
from antway.search.result import octile_length
from antway.search.subgoals import CHUNK, hierarchy_of


@dataclass(frozen=True, slots=True, eq=False)
class Routes:
    """The answers to many queries.

    Attributes
    ----------
    lengths : float64[Q]
        m; infinite where there is no path.
    cells : int32[M, 2]
        All paths, (row, col), one after the other.
    path_start : int64[Q + 1]
        Path i is `cells[path_start[i]:path_start[i + 1]]`, empty where there is none.
    """

    lengths: NDArray[np.float64]
    cells: NDArray[np.int32]
    path_start: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.lengths)

    def __iter__(self) -> Iterator[NDArray[np.int32]]:
        return (self[i] for i in range(len(self)))

    def __getitem__(self, i: int) -> NDArray[np.int32]:
        """Return path i, int32[N, 2]."""
        i = range(len(self))[i]  # raises IndexError for a number out of range
        return self.cells[self.path_start[i] : self.path_start[i + 1]]


def solve_many(grid: Grid, starts: ArrayLike, goals: ArrayLike, moves: Moves = Moves.EIGHT) -> Routes:
    """Return a shortest path from each start to the goal with the same index.

    Parameters
    ----------
    grid : Grid
    starts, goals : int[Q, 2]
        Free cells (row, col).
    moves : Moves
        Of 4 or 8 neighbours.

    Raises
    ------
    OutOfBounds, CellBlocked, BadParameter
        If an end is not a free cell of the map, or the arrays do not fit together.

    Notes
    -----
    Queries are solved as by the planner `jps`. With `Moves.EIGHT` on a grid that `antway.search.subgoals.prepare` has prepared,
    they are solved as by `subgoals`, which gives different paths of the same lengths. Whether preparation pays depends on the
    map: in measurements it paid after dozens of queries on a maze, and after thousands on a floor with halls.

    Examples
    --------
    >>> routes = solve_many(Grid(np.zeros((3, 3), dtype=bool), 0.5), [(0, 0), (2, 2)], [(0, 2), (2, 2)])
    >>> routes.lengths.tolist(), routes[0].tolist()
    ([1.0, 0.0], [[0, 0], [0, 1], [0, 2]])
    """
    checks.instance("grid", grid, Grid)
    if checks.instance("moves", moves, Moves) not in NEIGHBOURS:
        raise BadParameter("moves", moves.value, "moves of 4 or 8 neighbours")
    if grid.blocked.size >= MOST_CELLS:
        raise BadParameter("grid.shape", grid.shape, f"of fewer than {MOST_CELLS} cells for many queries at once")
    sources, targets = _free_cells("starts", starts, grid), _free_cells("goals", goals, grid)
    if len(sources) != len(targets):
        raise BadParameter("len(goals)", len(targets), f"that of starts, {len(sources)}")
    ends = np.hstack((sources, targets))
    path_start, diagonals = np.zeros(len(ends) + 1, np.int64), np.zeros(len(ends), np.int64)
    hierarchy = hierarchy_of(grid)
    if moves is Moves.EIGHT and hierarchy.made and hierarchy.pays:
        cells = hierarchy.plan_all(ends, path_start, diagonals)
    else:
        cells = _search_all(searcher(grid, moves, moves is Moves.EIGHT and jumps_pay(grid)), ends, path_start, diagonals)
    lengths = np.where(diagonals < 0, np.inf, octile_length(np.diff(path_start) - 1, diagonals, grid))
    routes = Routes(lengths, cells[: path_start[-1]], path_start)
    return _with_long_ones(routes, np.flatnonzero(diagonals == -2), ends, grid, moves)


def _search_all(
    search: Searcher, ends: NDArray[np.int64], path_start: NDArray[np.int64], diagonals: NDArray[np.int64]
) -> NDArray[np.int32]:
    """Solve queries as the planner `jps` does; see `kernels.search.astar.solve_all`."""
    cells, query = np.empty((64 * len(ends) + 1024, 2), np.int32), 0
    work = search.workspace()
    while query < len(ends):
        query, work.base, code = solve_all(
            search.map, work.memory, work.base, ends[: query + CHUNK], query, path_start, cells, diagonals
        )
        if code == FULL:
            work.grow()
        elif code == NO_SPACE:
            cells = longer(cells)
    search.spare.append(work)  # not after an interruption, which may have kept the new base from being stored
    return cells


def _with_long_ones(routes: Routes, missing: NDArray[np.int64], ends: NDArray[np.int64], grid: Grid, moves: Moves) -> Routes:
    """Return `routes` with the paths that were too long for the kernel's integers, which are solved by Dijkstra."""
    if not len(missing):
        return routes
    paths = list(routes)
    for i in missing.tolist():
        row, col, goal_row, goal_col = ends[i].tolist()
        plan = dijkstra(Problem(grid, (row, col), (goal_row, goal_col), moves))
        paths[i], routes.lengths[i] = plan.cells, plan.length
    return Routes(routes.lengths, np.concatenate(paths), np.cumsum([0, *map(len, paths)]))


def _free_cells(name: str, value: ArrayLike, grid: Grid) -> NDArray[np.int64]:
    cells = checks.raw(name, value, "integers of shape (queries, 2)")
    if cells.shape in ((0,), (0, 2)):
        return np.empty((0, 2), np.int64)
    if cells.ndim != 2 or cells.shape[1] != 2 or not np.issubdtype(cells.dtype, np.integer):
        raise BadParameter(name, f"{cells.dtype} array of shape {cells.shape}", "integers of shape (queries, 2)")
    outside = ((cells < 0) | (cells >= grid.shape)).any(axis=1)
    wrong = outside if outside.any() else grid.blocked[cells[:, 0], cells[:, 1]]
    for i in np.flatnonzero(wrong)[:1].tolist():
        free_cell(f"{name}[{i}]", tuple(cells[i].tolist()), grid)  # says what is wrong
    return cells.astype(np.int64)
