"""Where a moving obstacle can be: within what its speed allows, and within what its acceleration allows."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import free_distance
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import Walls

X, Y, VX, VY, RADIUS, SPEED, ACCEL, AGE = range(8)  # columns of a row; there is one row for each obstacle
COLUMNS = 8
_STEP = 0.05  # s; an obstacle's uniform motion towards a wall is looked at in steps of this length


@bare_kernel
def least_gap(ax: float, ay: float, wx: float, wy: float, reach: float, growth: float, t: float) -> float:
    """Return the least of |a + w s| - (reach + growth s) over s in [0, t]; below 0 the robot enters the growing disc.

    At s = 0 the robot is at (ax, ay) m from the centre of the disc, relative to which it moves with (wx, wy) m/s; the disc's
    radius is `reach` m and grows by `growth` >= 0 m/s. The function is convex. With the lateral distance c and k = growth / |w|
    < 1 it is least at the distance c k / sqrt(1 - k^2) beyond the closest point; with k >= 1 it is least at the end.
    """
    speed = math.hypot(wx, wy)
    s = t
    if speed > growth:
        k = growth / speed
        lateral = abs(ax * wy - ay * wx) / speed
        s = min(max((lateral * k / math.sqrt(1.0 - k * k) - (ax * wx + ay * wy) / speed) / speed, 0.0), t)
    return math.hypot(ax + wx * s, ay + wy * s) - reach - growth * s


@bare_kernel
def reach_gap_along(row: Floats, px: float, py: float, wx: float, wy: float, start: float, end: float) -> float:
    """Return a lower bound in m of the gap between a moving point and every place that an obstacle can cover meanwhile.

    `row` has the obstacle's last known place (m) and velocity (m/s), its radius (m), bounds on its speed (m/s) and on its
    acceleration vector (m/s^2, infinite if the velocity may jump), and how long ago it was seen (s). The point moves from (px,
    py) with (wx, wy) m/s, from `start` to `end` s from now, -age <= start <= end.

    At a time t' after it was seen, an obstacle is in two discs, so that the gap of a point p is at least max(|p - x| - r -
    speed t', |p - (x + v t')| - r - accel t'^2 / 2). The result is the larger of the minima of both terms. The first term is
    convex, and so is the second once the parabola accel t'^2 / 2 is replaced by its chord, which is above it by at most accel
    (end - start)^2 / 8.
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
def split_at_walls(tracks: Floats, count: int, walls: Walls, time: float) -> int:
    """Add a row for each of `count` tracks that could touch a wall within `time` s; return the number of rows.

    A wall may reflect an obstacle. Until it could first touch one, the obstacle is within accel t^2 / 2 of its uniform motion,
    which is looked at in steps of 0.05 s; after that it can go anywhere with its speed. Its two rows together cover all these
    places. The velocity in the second row is NaN, so that nobody is predicted to stand there.
    """
    n = count
    for k in range(count):
        accel = tracks[k, ACCEL]
        if accel == math.inf:
            continue
        drift = 0.5 * _STEP * math.hypot(tracks[k, VX], tracks[k, VY])  # how far it moves from the middle of a step to its ends
        for i in range(math.ceil(time / _STEP)):
            start, end = _STEP * i, _STEP * (i + 1)
            t = 0.5 * (start + end)
            x, y = tracks[k, X] + tracks[k, VX] * t, tracks[k, Y] + tracks[k, VY] * t
            off = 0.5 * accel * end * end + drift
            if free_distance(walls, x, y) < tracks[k, RADIUS] + off:
                tracks[n, X], tracks[n, Y], tracks[n, VX], tracks[n, VY] = x, y, math.nan, math.nan
                tracks[n, RADIUS], tracks[n, SPEED] = tracks[k, RADIUS] + off, tracks[k, SPEED]
                tracks[n, ACCEL], tracks[n, AGE] = math.inf, tracks[k, AGE] - start
                n += 1
                break
    return n
