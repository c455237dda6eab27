"""The motion that stops at every corner of a polyline, and the choice of corners."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid
from antway.kernels.base.geometry import segment_hits_cells
from antway.limits import MAX_PLACE
from antway.trajectory.motion import Motion
from antway.world.robots import RobotSpec
from antway.world.rollouts import finite_limits

_STRAIGHT = 1e-9  # rad, m; smaller turns and distances are ignored
_AHEAD = 60  # limit of corners that a leg may skip


def stop_at_corners(points: ArrayLike, robot: RobotSpec) -> Motion:
    """Return the fastest motion along a polyline, float64[N, 2], m, that stops at every vertex, where wheels turn in place.

    Equal neighbours count once. Wheels start with the heading of the first leg and end with that of the last. Infinite
    accelerations count as 1000 m/s^2 and rad/s^2.

    Raises
    ------
    BadParameter
        For no point, a coordinate beyond 1e10 m, or a corner with an ackermann drive.

    Examples
    --------
    >>> robot = RobotSpec(a_max=1.0)
    >>> round(stop_at_corners([(0.0, 0.0), (4.0, 0.0)], robot).time, 9)
    5.0
    """
    xy = without_repeats(checks.array("points", points, (None, 2), low=-MAX_PLACE, high=MAX_PLACE, unit="m"))
    checks.instance("robot", robot, RobotSpec)
    if len(xy) == 0:
        raise BadParameter("points", 0, "at least 1 point")
    limits, legs = finite_limits(robot), np.diff(xy, axis=0)
    if robot.drive == "ackermann" and len(legs) > 1:
        raise BadParameter("points", len(xy), "2 points with an ackermann drive, which cannot turn in place")
    heading = 0.0
    if robot.footprint is None or robot.wheels:
        heading = math.atan2(legs[0, 1], legs[0, 0]) if len(legs) else 0.0
    rows = [(0.0, *xy[0], heading, 0.0, 0.0, 0.0)]
    for (x, y), (dx, dy) in zip(xy, legs):
        length, towards = math.hypot(dx, dy), math.atan2(dy, dx)
        if robot.wheels:
            turn = math.remainder(towards - heading, 2.0 * math.pi)
            t = rows[-1][0]
            for after, moved, rate in _trapezoid(abs(turn), limits.turn_rate, limits.alpha_max, limits.alpha_max):
                sign = math.copysign(1.0, turn)
                rows.append((t + after, x, y, heading + sign * moved, 0.0, 0.0, sign * rate))
            heading += turn
        elif robot.footprint is None:
            heading = towards
        t = rows[-1][0]
        for after, moved, speed in _trapezoid(length, limits.v_max, limits.a_max, limits.brake_max):
            share = moved / length
            rows.append((t + after, x + share * dx, y + share * dy, heading, speed * dx / length, speed * dy / length, 0.0))
    table = np.array(rows)
    return Motion(*(np.ascontiguousarray(table[:, k]) for k in (0, slice(1, 3), 3, slice(4, 6), 6)))


def _trapezoid(distance: float, most: float, growth: float, fall: float) -> list[tuple[float, float, float]]:
    """Return (time since the start, distance, speed) at the ends of the ramp up, the level part and the ramp down."""
    if distance <= _STRAIGHT:
        return []
    peak = min(most, math.sqrt(2.0 * distance * growth * fall / (growth + fall)))
    up, down = peak / growth, peak / fall
    level = max(distance - peak * (up + down) / 2.0, 0.0) / peak
    knots = [(up, peak * up / 2.0, peak)]
    if level > 1e-9:
        knots.append((up + level, distance - peak * down / 2.0, peak))
    return [*knots, (up + level + down, distance, 0.0)]


def without_repeats(xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a polyline without vertices that equal the one before or are straight between their neighbours."""
    if len(xy) == 0:
        return xy
    xy = xy[np.concatenate(([True], (np.diff(xy, axis=0) != 0.0).any(axis=1)))]
    legs = np.diff(xy, axis=0)
    turn = np.arctan2(legs[:-1, 0] * legs[1:, 1] - legs[:-1, 1] * legs[1:, 0], (legs[:-1] * legs[1:]).sum(axis=1))
    return xy[np.concatenate(([True], np.abs(turn) > _STRAIGHT, [True]))[: len(xy)]]


def straight_legs(points: NDArray[np.float64], grid: Grid, robot: RobotSpec) -> NDArray[np.float64] | None:
    """Return the polyline through some of the vertices that a disc as wide as the robot drives in the least time with stops.

    None if not even the legs between neighbours are clear of walls, by the exact swept test.
    """
    xy = without_repeats(points)
    at, limits = grid.to_points(xy).tolist(), finite_limits(robot)
    wide = robot.radius / grid.resolution

    def clear(i: int, j: int) -> bool:
        (a, b), (c, d) = at[i], at[j]
        return not segment_hits_cells(grid.blocked, a, b, c, d, wide, True)

    best, before = [0.0], [0]
    for j in range(1, len(xy)):
        best.append(math.inf)
        before.append(-1)
        for i in range(j - 1, max(j - 1 - _AHEAD, -1), -1):
            away = math.dist(xy[i], xy[j])
            if away <= _STRAIGHT:  # the path comes back to a vertex
                continue
            time = best[i] + _trapezoid(away, limits.v_max, limits.a_max, limits.brake_max)[-1][0]
            if time < best[j] and clear(i, j):
                best[j], before[j] = time, i
    if best[-1] == math.inf:
        return None
    chosen = [len(xy) - 1]
    while chosen[-1] > 0:
        chosen.append(before[chosen[-1]])
    return xy[chosen[::-1]]
