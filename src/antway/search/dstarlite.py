"""D* Lite: shortest paths that are kept up to date while cells change and the robot moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter, CellBlocked, OutOfBounds
from antway.grid import Cell
from antway.kernels.search.canonical import NEED
from antway.kernels.search.dstarlite import EXPANDED, GOAL, INF, START, DStar, change, compute, descend, initialize, move
from antway.planning import Budget, Clock, Plan, Problem, start_clock
from antway.search.derived import NEIGHBOURS
from antway.search.result import found_shortest, not_found

STEPS = 1 << 14  # expansions between two looks at the clock


def dstarlite(problem: Problem, *, seed: int = 0, budget: Budget = Budget()) -> Plan:
    """Return a shortest path by the first search of D* Lite. For its purpose, repeated searches, see `DStarLite`.

    Parameters and result are those of `antway.search.jps.jps`.

    Raises
    ------
    BadParameter
        For moves beyond the 8 neighbours.

    Examples
    --------
    >>> from antway import Grid
    >>> dstarlite(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 1))).length
    2.414213562373095
    """
    clock = start_clock(problem, seed, budget)
    return DStarLite(problem).plan_until(clock)


class DStarLite:
    """A changing problem, and its shortest path after each change (Koenig and Likhachev, D* Lite, AAAI 2002).

    The search runs from the goal and keeps its distances; after a change it recomputes only those that differ and matter. The
    path is as short as that of a new search. Its cost is exact in integers (38,613,965 for a straight move, 54,608,393 for a
    diagonal one), which order paths by length as long as their numbers of diagonals differ by less than 38 million.

    Parameters
    ----------
    problem : Problem
        The initial problem. Its grid is not modified: changes make a new one.

    Raises
    ------
    BadParameter
        For moves other than FOUR, EIGHT, EIGHT_NOSQUEEZE and EIGHT_CUT.

    Examples
    --------
    >>> from antway import Grid, Moves
    >>> robot = DStarLite(Problem(Grid(np.zeros((3, 3), dtype=bool)), (1, 0), (1, 2), Moves.FOUR))
    >>> robot.plan().length
    2.0
    >>> robot.change([(1, 1)], True)
    >>> robot.plan().length
    4.0
    """

    def __init__(self, problem: Problem) -> None:
        if checks.instance("problem", problem, Problem).moves not in NEIGHBOURS:
            raise BadParameter("moves", problem.moves.value, f"one of {', '.join(m.value for m in NEIGHBOURS)} for D* Lite")
        free = np.pad(~problem.grid.blocked, 1)
        size, self._width = free.size, free.shape[1]
        self._problem, self._stale = problem, False
        start, goal = self._flat("ends", [problem.start, problem.goal])
        g, rhs, place = np.full(size, INF), np.full(size, INF), np.full(size, -1)
        key, queue = np.zeros((size, 2), np.int64), np.empty(size, np.int64)
        state = np.array([self._width, len(problem.moves.offsets), NEED[problem.moves.value], start, goal, 0, 0, 0])
        self._search = DStar(free.ravel(), g, rhs, key, queue, place, state)
        initialize(self._search)

    @property
    def problem(self) -> Problem:
        """The present problem; its grid is made on demand."""
        if self._stale:
            blocked = ~self._search.free.reshape(-1, self._width)[1:-1, 1:-1]
            start = self._cell(self._search.state[START])
            self._problem = replace(self._problem, grid=replace(self._problem.grid, blocked=blocked), start=start)
            self._stale = False
        return self._problem

    def change(self, cells: ArrayLike, blocked: ArrayLike) -> None:
        """Set cells to blocked or free.

        Parameters
        ----------
        cells : int[N, 2]
            (row, col); if a cell is listed twice, the last state counts.
        blocked : bool or bool[N]

        Raises
        ------
        BadParameter, OutOfBounds
            For arrays of another shape or type, and cells off the map.
        CellBlocked
            If the start or the goal would be blocked; then nothing is changed. Move the robot first.
        """
        flat = self._flat("cells", cells)
        state = checks.raw("blocked", blocked, f"one bool, or {len(flat)}")
        if state.dtype != np.bool_ or state.shape not in ((), flat.shape):
            raise BadParameter("blocked", f"{state.dtype}{list(state.shape)}", f"one bool, or {len(flat)}")
        now_free = np.full(flat.shape, ~state)
        for name, place in (("start", START), ("goal", GOAL)):
            end = self._search.state[place]
            at = (flat == end).nonzero()[0]
            if len(at) and not now_free[at[-1]]:
                raise CellBlocked("cells", self._cell(end), f"other than the {name} if they become blocked")
        self._stale = True  # before the change, because an interruption may follow it
        change(self._search, flat, now_free)

    def move(self, start: Cell) -> None:
        """Move the robot to `start`, any free cell.

        Raises
        ------
        BadParameter, OutOfBounds, CellBlocked
        """
        (flat,) = self._flat("start", [checks.sequence("start", start, "a cell (row, col)", size=2)])
        if not self._search.free[flat]:
            raise CellBlocked("start", start, "a free cell; this one is blocked")
        self._stale = True
        move(self._search, flat)

    def _flat(self, name: str, cells: ArrayLike) -> NDArray[np.int64]:
        """Return the indices of cells in the padded grid."""
        at = checks.raw(name, cells, "cells (row, col)")
        at = np.empty((0, 2), np.int64) if at.size == 0 else at
        if at.ndim != 2 or at.shape[1] != 2 or at.dtype.kind not in "iu":
            raise BadParameter(name, cells, "cells (row, col)")
        rows, cols = self._problem.grid.shape
        row, col = at.T.astype(np.int64)
        outside = (row.view(np.uint64) >= rows) | (col.view(np.uint64) >= cols)  # negative numbers become very large
        if outside.any():
            raise OutOfBounds(name, tuple(at[outside][0].tolist()), f"on the map of {rows} rows and {cols} columns")
        flat: NDArray[np.int64] = (row + 1) * self._width + col + 1
        return flat

    def _cell(self, flat: int) -> Cell:
        return int(flat) // self._width - 1, int(flat) % self._width - 1

    def plan(self, budget: Budget = Budget()) -> Plan:
        """Return a shortest path on the present map; `expanded` counts only this call.

        If the budget runs out, the next call continues the search.
        """
        return self.plan_until(checks.instance("budget", budget, Budget).start())

    def plan_until(self, clock: Clock) -> Plan:
        """Plan as `plan` does, until a clock that runs already is spent."""
        state = self._search.state
        state[EXPANDED] = 0
        done = False
        while not done and not clock.spent():
            done = compute(self._search, STEPS)
        if not done or self._search.rhs[state[START]] == INF:
            return not_found(done, int(state[EXPANDED]), clock)
        path, diagonals = descend(self._search)
        return found_shortest(self._problem.grid, path, diagonals, int(state[EXPANDED]), clock)
