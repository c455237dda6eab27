"""The general range of motion of sensed obstacles: each obstacle's predicted trajectory and the space around it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway.grid import Grid
from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.records import Trajectories
from antway.kernels.base.rng import make_state
from antway.kernels.robot.motions import bounce
from antway.kernels.tracking.tubes import close_cells, first_conflict, stand_free
from antway.planning import TimedPath
from antway.world.policy import XY, Observation
from antway.world.terrain import terrain_of

_KNOTS = 64  # limit of knots of a predicted trajectory; after the last one the obstacle is assumed to stand


@dataclass(frozen=True, slots=True, eq=False)
class Tubes:
    """Predicted trajectories of K discs at constant velocity, mirrored at walls."""

    t: float  # s; time of the prediction
    trajectories: Trajectories

    @staticmethod
    def predict(t: float, seen_at: float, discs: Floats, grid: Grid, horizon: float) -> Tubes:
        """Step 3: predict from `seen_at` s to `horizon` s after `t` discs that were at (x, y), float64[K, 5].

        Columns x, y in m, velocity in m/s along x and y, and radius in m.
        """
        state = make_state(0, 0)
        points = grid.to_points(discs[:, :2])
        scale, times, places = grid.resolution, [np.empty(0)], [np.empty((0, 2))]
        for (row, col), (vx, vy, radius) in zip(points.tolist(), discs[:, 2:].tolist(), strict=True):
            speed, heading, until = math.hypot(vx, vy) / scale, math.atan2(vy, vx), t - seen_at + horizon
            knots, rc = np.empty(_KNOTS), np.empty((_KNOTS, 2))
            n = bounce(grid.blocked, row, col, speed, heading, radius / scale, math.inf, until, state, knots, rc)
            times.append(seen_at + knots[:n])
            places.append(grid.to_xy(rc[:n]))
        first = np.cumsum([len(knots) for knots in times], dtype=np.int64)
        return Tubes(t, Trajectories(np.concatenate(times), np.concatenate(places), first, discs[:, 4].copy()))

    def knots(self, k: int) -> tuple[Floats, Floats]:
        """Return the knots of the trajectory of track k: t in s, and x and y in m."""
        knot_t, knot_xy, first, _ = self.trajectories
        return knot_t[first[k] : first[k + 1]], knot_xy[first[k] : first[k + 1]]

    def rows(self) -> NDArray[np.float32]:
        """Return the prediction in the format of a `Decision`, float32[P, 7]."""
        rows = []
        for k, radius in enumerate(self.trajectories.radius.tolist()):
            t, xy = self.knots(k)
            keep = np.concatenate(([True], np.diff(t) > 0.0))
            t, xy = t[keep], xy[keep]
            span = np.diff(t)[:, None]
            rows.append(np.hstack((t[:-1, None], t[1:, None], xy[:-1], np.diff(xy, axis=0) / span, np.full_like(span, radius))))
        return np.vstack((np.empty((0, 7)), *rows)).astype(np.float32)

    def standing(self, t: Floats, xy: Floats, until: float, body: float, growth: float, most: int) -> Ints:
        """Return int64[N]: the first `most` places xy[i] at which a body can stand from t[i] to `until` and meets no tube."""
        free = np.empty(len(t), np.bool_)
        stand_free(t, xy, self.t, until, body, growth, self.trajectories, free, most)
        return np.flatnonzero(free)

    def close(
        self, grid: Grid, window: tuple[int, int, int, int], xy: XY, v_max: float, body: float, horizon: float, *, whole: bool
    ) -> Bools:
        """Return which cells of `window`, bool[H, W], are in a tube when a body from `xy` gets there, or ever."""
        closed = np.zeros(grid.shape, np.bool_)
        row, col, rows, cols = window
        part = np.empty((rows, cols), np.bool_)
        early, late = (0.0, 1e9) if whole else (0.9, 1.3)
        terrain, discs, corner = terrain_of(grid), self.trajectories, (row, col)
        close_cells(self.t, *xy, v_max, early, late, horizon, body, discs, terrain, corner, part)
        closed[row : row + rows, col : col + cols] = part
        return closed


@dataclass(frozen=True, slots=True, eq=False)
class Ahead:
    """What one control cycle knows: the observation, the tubes, and the robot's radius with the margin."""

    seen: Observation
    tubes: Tubes
    body: float
    velocity: Floats  # float64[K, 2]; velocities of the tracks, m/s
    until: float  # s; time up to which the robot looks ahead
    growth: float

    def conflict(self, path: TimedPath, until: float) -> tuple[float, int]:
        """Return when and with which track the robot on `path` first meets a tube."""
        return first_conflict(path.t, path.xy, until, self.body, self.growth, self.tubes.trajectories)
