"""Space-time search: safe interval path planning (SIPP) for a disc among moving discs, exact in continuous time.

Phillips, Likhachev: SIPP: Safe Interval Path Planning for Dynamic Environments, ICRA 2011.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter, CellBlocked
from antway.grid import Cell, Grid, Moves
from antway.kernels.base import records
from antway.kernels.base.geometry import segment_hits_cells
from antway.kernels.spacetime import sipp as kernels
from antway.kernels.spacetime.moves import move_field, move_mask
from antway.kernels.spacetime.segments import timeline_segments
from antway.limits import MAX_PLACE, MAX_SPEED
from antway.planning import Status, TimedPath

TIMED_MOVES = (Moves.FOUR, Moves.EIGHT, Moves.SIXTEEN, Moves.THIRTY_TWO)
NO_SEGMENTS = np.empty((0, 8))


class Trajectories(Protocol):
    """The motions of K discs, as in `antway.world.timeline.Timeline`.

    Disc k, of radius[k] m, is at knot_xy[i] m at knot_t[i] s for first[k] <= i < first[k + 1], moves straight and at constant
    speed in between, and stands before its first and after its last knot.
    """

    @property
    def radius(self) -> NDArray[np.float64]: ...  # [K] m
    @property
    def knot_t(self) -> NDArray[np.float64]: ...  # [M] s, strictly increasing within a disc
    @property
    def knot_xy(self) -> NDArray[np.float64]: ...  # [M, 2] m
    @property
    def first(self) -> NDArray[np.int64]: ...  # [K + 1] from 0 to M


@dataclass(frozen=True, slots=True, eq=False)
class TimedPlan:
    """The answer of a space-time search.

    Attributes
    ----------
    status : Status
    path : TimedPath
        Empty unless found. The robot drives each leg at full speed, or waits.
    arrival : float
        Time at the goal in s, infinite without a path. No path of the same moves arrives more than 1e-8 s earlier.
    lower_bound : float
        If the path was found, its arrival; else no path of the same moves arrives earlier, s.
    expanded : int
        Safe intervals expanded.
    elapsed : float
        Time taken in s.
    """

    status: Status
    path: TimedPath
    arrival: float
    lower_bound: float
    expanded: int
    elapsed: float


def timed_moves(
    grid: Grid, radius: float, moves: Moves = Moves.THIRTY_TWO, stride: int = 1, first: Cell = (0, 0)
) -> NDArray[np.uint32]:
    """Return which moves a disc of `radius` m can make from each cell, uint32[H, W]: bit k is for `moves.offsets[k]`.

    Touching is legal, contact with blocked cells or the edge of the map is not. `moves` are FOUR, EIGHT, SIXTEEN or THIRTY_TWO,
    which do not cut corners. Only every stride-th cell of a row and of a column counts, from the cell `first` on, each of whose
    numbers is below `stride`; moves are that much longer, and the answer has only these cells.

    Examples
    --------
    >>> timed_moves(Grid(np.zeros((1, 3), dtype=bool)), 0.5, Moves.FOUR).tolist()
    [[1, 5, 4]]
    >>> timed_moves(Grid(np.zeros((1, 5), dtype=bool)), 0.5, Moves.FOUR, stride=2).tolist()
    [[1, 5, 4]]
    """
    checks.instance("grid", grid, Grid)
    checks.instance("moves", moves, Moves)
    if moves not in TIMED_MOVES:
        raise BadParameter("moves", moves, f"one of {', '.join(m.name for m in TIMED_MOVES)}")
    radius = checks.number("radius", radius, low=0.0, high=1000 * grid.resolution, unit="m, at most 1000 cells")
    stride = checks.integer("stride", stride, low=1, high=100)
    corner = checks.sequence("first", first, "a cell (row, col)", size=2)
    row, col = (checks.integer("first", one, low=0, high=min(stride, side) - 1) for one, side in zip(corner, grid.shape))
    return move_mask(grid.blocked, moves.offsets, radius / grid.resolution, stride, row, col)


def timed_field(mask: NDArray[np.uint32], moves: Moves, goals: ArrayLike, scale: float = 1.0) -> NDArray[np.float64]:
    """Return the exact distance of every cell to the nearest goal, float64[H, W]; infinite where none can be reached.

    The mask, uint32[H, W], is that of `timed_moves` with the same moves, or a window of it. The goals are cells of the mask,
    int[G, 2] or (row, col). `scale` > 0 is the length of a cell's edge in the unit of the result: the resolution for m,
    resolution / speed for s.

    Examples
    --------
    >>> mask = timed_moves(Grid(np.zeros((1, 3), dtype=bool)), 0.5, Moves.FOUR)
    >>> timed_field(mask, Moves.FOUR, (0, 0), scale=0.5).tolist()
    [[0.0, 0.5, 1.0]]
    """
    if not isinstance(mask, np.ndarray) or mask.dtype != np.uint32 or mask.ndim != 2:
        raise BadParameter("mask", mask, "a uint32[H, W] array from timed_moves")
    checks.instance("moves", moves, Moves)
    cells = np.atleast_2d(checks.raw("goals", goals, "cells, int[G, 2]"))
    if not np.issubdtype(cells.dtype, np.integer) or cells.ndim != 2 or cells.shape[1] != 2:
        raise BadParameter("goals", goals, "cells, int[G, 2]")
    if (cells < 0).any() or (cells >= mask.shape).any():
        raise BadParameter("goals", goals, f"cells of the mask, {mask.shape[0]} x {mask.shape[1]}")
    scale = checks.number("scale", scale, low=0.0, open_low=True)
    whole = np.ascontiguousarray(mask)  # for a window the kernel would be compiled anew
    return move_field(whole, moves.offsets, moves.lengths, cells.astype(np.int64)) * scale


class Sipp:
    """Space-time search to one goal on one map, prepared once for many searches.

    Parameters
    ----------
    grid : Grid
        The map as it is, not inflated; yaw 0.
    goal : (x, y)
        m; the robot goes to the centre of the cell that contains it.
    radius, v_max : float
        Of the robot, m (>= 0) and m/s (in [1e-6, 1000]). It drives at full speed, or waits at the centre of a cell.
    moves : Moves
        FOUR, EIGHT, SIXTEEN or THIRTY_TWO.
    goal_tolerance : float
        If > 0 the goals are all cells with centres within this distance of `goal`, m.

    Attributes
    ----------
    mask : uint32[H, W]
        The legal moves (`timed_moves`).
    field : float64[H, W]
        The exact time to the goal without moving obstacles, s.

    Raises
    ------
    BadParameter, OutOfBounds, CellBlocked
        For numbers out of range, a goal off the map, or one where the robot's disc cannot stand.

    Examples
    --------
    >>> search = Sipp(Grid(np.zeros((3, 9), dtype=bool)), (8.5, 1.5), radius=0.3, v_max=1.0)
    >>> search.plan((0.5, 1.5)).arrival
    8.0
    """

    def __init__(
        self,
        grid: Grid,
        goal: Iterable[float],
        *,
        radius: float,
        v_max: float,
        moves: Moves = Moves.THIRTY_TWO,
        goal_tolerance: float = 0.0,
    ) -> None:
        self.mask = timed_moves(grid, radius, moves)
        if grid.origin[2] != 0.0:
            raise BadParameter("grid.origin[2]", grid.origin[2], "0 in a space-time search (yaw): Grid.turned() turns the map")
        self.grid, self.moves, self.radius = grid, moves, float(radius)
        self.v_max = checks.number("v_max", v_max, low=1e-6, high=MAX_SPEED, unit="m/s")
        self.goals = self._goal_cells(goal, checks.number("goal_tolerance", goal_tolerance, low=0.0, unit="m"))
        self.field = timed_field(self.mask, moves, self.goals, grid.resolution / self.v_max)
        if float(self.field[np.isfinite(self.field)].max(initial=0.0)) > _LONGEST:
            raise BadParameter("v_max", v_max, f"such that no path to the goal takes more than {_LONGEST:g} s")
        self._workspace = _workspace(self.mask.size, 4096, 64)

    def plan(
        self,
        start: Iterable[float],
        obstacles: Trajectories | None = None,
        *,
        t: float = 0.0,
        horizon: float = math.inf,
        max_expanded: int | None = None,
    ) -> TimedPlan:
        """Return the path that arrives first.

        Parameters
        ----------
        start : (x, y)
            m. If it is not the centre of a cell, the robot first goes straight to a centre at most three rows and columns away.
        obstacles : Trajectories or None
            The moving discs, such as a `Timeline`.
        t : float
            Time at the start, s.
        horizon : float
            Obstacles are ignored from this time on, s.
        max_expanded : int or None
            Budget of safe intervals to expand.

        Returns
        -------
        TimedPlan
            NO_PATH also if an obstacle touches the robot at the start; BUDGET if the budget was too small.

        Raises
        ------
        BadParameter, OutOfBounds, CellBlocked
            For invalid numbers, arrays or starts; CellBlocked if the start is in contact with a wall.
        """
        t = checks.number("t", t, low=-1e8, high=1e8, unit="s")
        horizon = checks.number("horizon", horizon, low=t, infinite=True, unit="s")
        segments = NO_SEGMENTS
        if obstacles is not None:
            segments = timeline_segments(checked_trajectories(obstacles), self.radius, t, horizon)
        return self.search(start, t, segments, max_expanded)

    def search(
        self, start: Iterable[float], t: float, segments: NDArray[np.float64], max_expanded: int | None = None
    ) -> TimedPlan:
        """Do as `plan` with prepared segments, float64[P, 8] (see `kernels.spacetime.segments`), for every control cycle."""
        started = time.perf_counter()
        x, y = checks.point("start", start)
        self.grid.cell_at((x, y))
        row, col = self.grid.to_points((x, y))[0].tolist()
        if not self._stands(row, col):
            raise CellBlocked("start", (x, y), f"where a disc of {self.radius:g} m is free of walls")
        most = 2**62 if max_expanded is None else checks.integer("max_expanded", max_expanded, low=0)
        grid, (ox, oy, _), size = self.grid, self.grid.origin, self.grid.resolution
        frame = kernels.Frame(ox + size / 2, oy + size / 2, size, grid.shape[1])
        offsets, lengths = self.moves.offsets, self.moves.lengths
        moving = kernels.Moving(grid.blocked, self.mask, self.field, offsets, lengths, frame, self.radius, self.v_max)
        if len(segments) > len(self._workspace.spans):
            self._workspace = _workspace(self.mask.size, len(self._workspace.cell), 2 * len(segments))
        while True:
            code, state, expanded, bound = kernels.sipp(moving, (x, y), (row, col), t, segments, most, self._workspace)
            if code != kernels.FULL:
                break
            self._workspace = _workspace(
                self.mask.size, 2 * len(self._workspace.cell) + len(segments), len(self._workspace.spans)
            )
        path, arrival = TimedPath(np.empty(0), np.empty((0, 2))), math.inf
        if code == kernels.FOUND:
            path = TimedPath(*kernels.sipp_path(state, (x, y), frame, self._workspace))
            arrival = bound = float(path.t[-1])
        elif code == kernels.BUDGET:
            bound = max(t, bound - max(1e-8, 4 * math.ulp(bound)))  # sums of times are rounded
        return TimedPlan(_STATUS[code], path, arrival, bound, expanded, time.perf_counter() - started)

    def stands(self, xy: tuple[float, float]) -> bool:
        """Tell whether the robot at `xy` (m) touches no wall."""
        row, col = self.grid.to_points(xy)[0]
        return self._stands(float(row), float(col))

    def _stands(self, row: float, col: float) -> bool:
        return not segment_hits_cells(self.grid.blocked, row, col, row, col, self.radius / self.grid.resolution, True)

    def _goal_cells(self, goal: Iterable[float], tolerance: float) -> list[Cell]:
        xy = checks.point("goal", goal)
        cells = [self.grid.cell_at(xy)]
        if tolerance > 0.0:
            free = np.argwhere(~self.grid.blocked)
            away = np.hypot(*(self.grid.to_xy(free) - xy).T)
            cells = [(int(r), int(c)) for r, c in free[away <= tolerance]]
        cells = [cell for cell in cells if self._stands(*cell)]
        if not cells:
            near = f" at the centre of a cell within {tolerance:g} m" if tolerance > 0.0 else ""
            raise CellBlocked("goal", xy, f"where a disc of {self.radius:g} m is free of walls{near}")
        return cells


def sipp(
    grid: Grid,
    start: Iterable[float],
    goal: Iterable[float],
    obstacles: Trajectories | None = None,
    *,
    radius: float,
    v_max: float,
    moves: Moves = Moves.THIRTY_TWO,
    goal_tolerance: float = 0.0,
    t: float = 0.0,
    horizon: float = math.inf,
    max_expanded: int | None = None,
) -> TimedPlan:
    """Return the path from `start` to `goal` among moving discs that arrives first; parameters and errors as for `Sipp`.

    Examples
    --------
    >>> from antway.world.timeline import Timeline
    >>> crossing = Timeline.of([1], [0.4], [([0.0, 10.0], [(4.5, -4.5), (4.5, 5.5)])])
    >>> plan = sipp(Grid(np.zeros((1, 9), dtype=bool)), (0.5, 0.5), (8.5, 0.5), crossing, radius=0.4, v_max=1.0)
    >>> plan.status.value, round(plan.arrival, 3)
    ('found', 10.131)
    """
    search = Sipp(grid, goal, radius=radius, v_max=v_max, moves=moves, goal_tolerance=goal_tolerance)
    return search.plan(start, obstacles, t=t, horizon=horizon, max_expanded=max_expanded)


_LONGEST = 1e12  # s; a path that takes longer would end after the last safe interval
_STATUS = {kernels.FOUND: Status.FOUND, kernels.NO_PATH: Status.NO_PATH, kernels.BUDGET: Status.BUDGET}


def _workspace(cells: int, states: int, spans: int) -> kernels.SippMemory:
    def whole(n: int) -> NDArray[np.int32]:
        return np.empty(n, np.int32)

    real = np.empty
    states, entries = states + 2 * spans, 4 * states
    return kernels.SippMemory(
        np.zeros(3, np.int64), np.zeros(cells, np.int64), whole(cells), whole(cells),
        whole(states), whole(states), real(states), real(states), real(states), real(states), real(states), real(states),
        real(entries), real(entries), whole(entries), np.empty((spans, 2)),
    )  # fmt: skip


def checked_trajectories(obstacles: Trajectories) -> records.Trajectories:
    """Return the motions of K discs as kernels use them, if the arrays fit together."""
    if not all(hasattr(obstacles, name) for name in ("radius", "knot_t", "knot_xy", "first")):
        raise BadParameter("obstacles", obstacles, "trajectories such as a Timeline: radius, knot_t, knot_xy, first; or None")
    radius = checks.array("obstacles.radius", obstacles.radius, (None,), low=0.0, high=MAX_PLACE, unit="m")
    knot_t = checks.array("obstacles.knot_t", obstacles.knot_t, (None,))
    knot_xy = checks.array("obstacles.knot_xy", obstacles.knot_xy, (len(knot_t), 2), low=-MAX_PLACE, high=MAX_PLACE, unit="m")
    first = checks.raw("obstacles.first", obstacles.first, f"int64[{len(radius) + 1}], one more than radius")
    if not np.issubdtype(first.dtype, np.integer) or first.shape != (len(radius) + 1,):
        raise BadParameter("obstacles.first", first, f"int64[{len(radius) + 1}], one more than radius")
    first = first.astype(np.int64)  # differences of unsigned numbers are never below 0
    if first[0] != 0 or first[-1] != len(knot_t) or (np.diff(first) < 1).any():
        raise BadParameter("obstacles.first", first, f"increasing from 0 to {len(knot_t)}")
    rising = np.diff(knot_t) > 0.0
    rising[first[1:-1] - 1] = True
    if not rising.all():
        raise BadParameter(
            "obstacles.knot_t", float(knot_t[np.argmin(rising) + 1]), "strictly increasing within an obstacle (s)"
        )
    return records.Trajectories(knot_t, knot_xy, first, radius)
