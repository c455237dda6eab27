"""Where a moving obstacle can be: no farther than its speed allows, nor farther from its course than its acceleration does."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel
from antway.kernels.robot.sweep import Walls, free_distance

X, Y, VX, VY, RADIUS, SPEED, ACCEL, AGE = range(8)  # columns of a row, one row an obstacle
COLUMNS = 8


@bare_kernel
def least_gap(ax: float, ay: float, wx: float, wy: float, reach: float, growth: float, t: float) -> float:
    """Least of |a + w s| - (reach + growth s) over s in [0, t]; below 0 the growing disc around an obstacle is entered.

    Parameters
    ----------
    ax, ay : float
        The robot seen from the middle of the disc, m.
    wx, wy : float
        The robot's velocity against that of the disc, m/s.
    reach : float
        Radius of the disc at first, m.
    growth : float
        How fast it grows, m/s, >= 0.
    t : float
        Length of the step, s.

    Notes
    -----
    The function is convex. With c the lateral distance and k = growth / |w| < 1 it is least where the distance made since the
    closest point is c k / sqrt(1 - k^2); with k >= 1 at the end.
    """
    speed = math.hypot(wx, wy)
    s = t
    if speed > growth:
        k = growth / speed
        lateral = abs(ax * wy - ay * wx) / speed
        s = min(max((lateral * k / math.sqrt(1.0 - k * k) - (ax * wx + ay * wy) / speed) / speed, 0.0), t)
    return math.hypot(ax + wx * s, ay + wy * s) - reach - growth * s


@bare_kernel
def reach_gap(row: NDArray[np.float64], px: float, py: float, t: float) -> float:
    """Distance in m of the point (px, py) from the body of an obstacle wherever it can be in `t` s; below 0: it may be there.

    Parameters
    ----------
    row : float64[8]
        Where it was last seen x, y (m), with what velocity vx, vy (m/s), its radius (m), bounds on its speed (m/s) and on its
        acceleration as a vector (m/s^2, infinite: it may turn and run at once), and how long ago that was (s).
    t : float
        s from now, >= -age.

    Notes
    -----
    With t' = t + age: max(|p - x| - r - speed t', |p - (x + v t')| - r - accel t'^2 / 2). It is in both discs, so the distance
    is no less than from either.
    """
    later = t + row[AGE]
    gap: float = math.hypot(px - row[X], py - row[Y]) - row[RADIUS] - row[SPEED] * later
    if row[ACCEL] < math.inf:
        dx, dy = px - row[X] - row[VX] * later, py - row[Y] - row[VY] * later
        gap = max(gap, math.hypot(dx, dy) - row[RADIUS] - 0.5 * row[ACCEL] * later * later)
    return gap


@bare_kernel
def reach_gap_along(row: NDArray[np.float64], px: float, py: float, wx: float, wy: float, start: float, end: float) -> float:
    """Lower bound in m of `reach_gap` over [begin, end] for a point at (px, py) at `start` that moves with (wx, wy) m/s.

    Parameters
    ----------
    row : float64[8]
        As in `reach_gap`.
    start, end : float
        s from now, -age <= begin <= end.

    Notes
    -----
    The larger of the least of either term: the first is convex, and so is the second once the parabola accel t'^2 / 2 is
    replaced by its chord, which lies above it by no more than accel (end - begin)^2 / 8.
    """
    since, span = start + row[AGE], end - start
    ax, ay = px - row[X], py - row[Y]
    gap = least_gap(ax, ay, wx, wy, row[RADIUS] + row[SPEED] * since, row[SPEED], span)
    if row[ACCEL] < math.inf:
        reach, growth = row[RADIUS] + 0.5 * row[ACCEL] * since * since, row[ACCEL] * (since + 0.5 * span)
        ax, ay = ax - row[VX] * since, ay - row[VY] * since
        gap = max(gap, least_gap(ax, ay, wx - row[VX], wy - row[VY], reach, growth, span))
    return gap


@bare_kernel
def split_at_walls(tracks: NDArray[np.float64], count: int, walls: Walls, time: float) -> int:
    """Add a row for each of `count` tracks that could touch a wall within `time` s; returns how many rows there are.

    A wall may throw a track back. Until it could first touch one, a track is within accel t^2 / 2 of its course, which is
    looked at in steps of 0.05 s; after that it goes anywhere with its speed. Wherever it is, one of its two rows is there.
    """
    n = count
    for k in range(count):
        accel = tracks[k, ACCEL]
        if accel == math.inf:
            continue
        drift = 0.025 * math.hypot(tracks[k, VX], tracks[k, VY])  # from the middle of a step to its ends
        for i in range(math.ceil(time / 0.05)):
            t = 0.05 * i + 0.025
            x, y = tracks[k, X] + tracks[k, VX] * t, tracks[k, Y] + tracks[k, VY] * t
            off = 0.5 * accel * (t + 0.025) * (t + 0.025) + drift
            if free_distance(walls, x, y) < tracks[k, RADIUS] + off:
                tracks[n, X], tracks[n, Y], tracks[n, VX], tracks[n, VY] = x, y, 0.0, 0.0
                tracks[n, RADIUS], tracks[n, SPEED] = tracks[k, RADIUS] + off, tracks[k, SPEED]
                tracks[n, ACCEL], tracks[n, AGE] = math.inf, tracks[k, AGE] - (t - 0.025)
                n += 1
                break
    return n
