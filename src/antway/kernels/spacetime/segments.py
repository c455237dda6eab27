"""Exact times at which a disc must not stand, or must not depart, because of motion segments.

A *motion segment* is a row (t0, t1, x, y, vx, vy, contact radius, clearance radius): from t0 to t1 s an obstacle moves
uniformly from (x, y) m with (vx, vy) m/s. A standing robot is in contact if the centres are nearer than the contact radius.
A moving robot keeps the clearance radius away from the obstacle's place `stopping_time` s before, because the guard asks this
of a robot that cannot stop sooner. Touching is legal. A piecewise linear prediction is a list of segments. A tube that widens
over time has larger radii in later segments.
"""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import timeline_at
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import CLEARANCE_RADIUS, CONTACT_RADIUS, T0, T1, VX, VY, Predictions, Trajectories, X, Y

TOUCH = 1e-9
NEVER = 1e13  # s; stands for infinity where a time must be finite; no clock tells so much (limits.MAX_CLOCK)
Segments = Floats  # [P, 8]


@bare_kernel
def unsafe_stay(x: float, y: float, segments: Segments, p: int) -> tuple[float, float]:
    """Return the open interval of times in s at which a robot at (x, y) is in contact with segment p; (inf, -inf) if none."""
    return within(x, y, segments[p, CONTACT_RADIUS] - TOUCH, segments, p)


@bare_kernel
def within(x: float, y: float, distance: float, segments: Segments, p: int) -> tuple[float, float]:
    """Return the open interval of times in s at which segment p is less than `distance` m from (x, y); (inf, -inf) if none."""
    s = segments[p]
    return _near(s[X] - x, s[Y] - y, s[VX], s[VY], s[T0], s[T1], distance)


@inner_kernel
def insert_interval(intervals: Floats, n: int, low: float, high: float) -> int:
    """Insert (low, high) into the first n rows of `intervals`, in the order of their starts; return the new number of rows."""
    i = n
    while i > 0 and intervals[i - 1, 0] > low:
        intervals[i, 0], intervals[i, 1] = intervals[i - 1, 0], intervals[i - 1, 1]
        i -= 1
    intervals[i, 0], intervals[i, 1] = low, high
    return n + 1


@bare_kernel
def _near(ax: float, ay: float, vx: float, vy: float, start: float, end: float, distance: float) -> tuple[float, float]:
    """Return the part of [start, end] in which |a + v (t - start)| < distance; (inf, -inf) if there is none."""
    vv = vx * vx + vy * vy
    slack = ax * ax + ay * ay - distance * distance
    if vv == 0.0:
        return (start, end) if slack < 0.0 else (math.inf, -math.inf)
    av = ax * vx + ay * vy
    root = av * av - vv * slack
    if root <= 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root)
    low, high = max(start, start + (-av - root) / vv), min(end, start + (-av + root) / vv)
    return (low, high) if low < high else (math.inf, -math.inf)


@bare_kernel
def unsafe_departures(
    x: float, y: float, vx: float, vy: float, duration: float, segments: Segments, p: int
) -> tuple[float, float]:
    """Return the interval of departures in s with which a uniform move meets segment p; (inf, -inf) if there are none.

    The robot leaves (x, y) at time s with (vx, vy) and drives for `duration` s. Let z be the time since departure and t the
    absolute time. The (z, t) in [0, duration] x [t0, t1] with |a + v z - u (t - t0)| < r are in contact. This set is convex, so
    the departures s = t - z that lead into it form one interval. Its ends lie on an edge of the rectangle, or where a line of
    constant s touches the ellipse.
    """
    t0, t1 = segments[p, T0], segments[p, T1]
    ax, ay = x - segments[p, X], y - segments[p, Y]
    ux, uy = segments[p, VX], segments[p, VY]
    contact_radius = segments[p, CLEARANCE_RADIUS] - TOUCH
    span = t1 - t0
    low, high = math.inf, -math.inf
    for k in range(2):  # edges of constant z: at departure and at arrival
        z = duration * k
        first, last = _near(ax + vx * z, ay + vy * z, -ux, -uy, 0.0, span, contact_radius)
        low, high = min(low, first - z), max(high, last - z)
    for k in range(2):  # edges of constant t: the start and the end of the segment
        w = span * k
        first, last = _near(ax - ux * w, ay - uy * w, vx, vy, 0.0, duration, contact_radius)
        low, high = min(low, w - last), max(high, w - first)
    # q = a + v z - u w on the circle; w - z is linear in q with gradient g, so it is extreme at q = -+ r g / |g|.
    det = ux * vy - uy * vx
    if det != 0.0:
        gx, gy = (vy - uy) / det, (ux - vx) / det
        norm = math.hypot(gx, gy)
        if norm > 0.0:
            for sign in (-1.0, 1.0):
                qx, qy = sign * contact_radius * gx / norm - ax, sign * contact_radius * gy / norm - ay
                # solve v z - u w = q
                z = (ux * qy - uy * qx) / det
                w = (vx * qy - vy * qx) / det
                if 0.0 <= z <= duration and 0.0 <= w <= span:
                    low, high = min(low, w - z), max(high, w - z)
    return low + t0, high + t0


@bare_kernel
def delayed(x: float, y: float, vx: float, vy: float, duration: float, s: float, predictions: Predictions, p: int) -> float:
    """Return the departure s, delayed until segment p allows to leave (x, y) with (vx, vy) for `duration` s."""
    segments, stopping_time = predictions.segments, predictions.stopping_time
    t0, t1 = max(s - stopping_time, segments[p, T0]), min(s - stopping_time + duration, segments[p, T1])
    if t0 > t1:
        return s
    # Most pairs that are apart are recognized by the bounding boxes of both sweeps.
    contact_radius = segments[p, CLEARANCE_RADIUS]
    z0, z1 = t0 - segments[p, T0], t1 - segments[p, T0]
    ex, ey = x + vx * duration, y + vy * duration
    ox, px = segments[p, X] + segments[p, VX] * z0, segments[p, X] + segments[p, VX] * z1
    if min(ox, px) - contact_radius > max(x, ex) or max(ox, px) + contact_radius < min(x, ex):
        return s
    oy, py = segments[p, Y] + segments[p, VY] * z0, segments[p, Y] + segments[p, VY] * z1
    if min(oy, py) - contact_radius > max(y, ey) or max(oy, py) + contact_radius < min(y, ey):
        return s
    low, high = unsafe_departures(x, y, vx, vy, duration, segments, p)
    return high + stopping_time if low + TOUCH < s - stopping_time < high - TOUCH else s


@bare_kernel
def earliest_departure(
    x: float, y: float, vx: float, vy: float, duration: float, s: float, limit: float, predictions: Predictions
) -> float:
    """Return the first time in [s, limit] to leave (x, y) with (vx, vy) for `duration` s without contact; infinite if none."""
    p = clear = 0  # test the segments in turn until all of them in a row allow the same time
    while clear < len(predictions.segments) and s <= limit:
        later = delayed(x, y, vx, vy, duration, s, predictions, p)
        clear = clear + 1 if later == s else 1
        s, p = later, p + 1 if p + 1 < len(predictions.segments) else 0
    return s if s <= limit else math.inf


@kernel
def timeline_segments(trajectories: Trajectories, robot_radius: float, start: float, horizon: float) -> Segments:
    """Return the motion segments of K discs between `start` and `horizon` s."""
    knot_t, first, radius = trajectories.knot_t, trajectories.first, trajectories.radius
    segments = np.empty((len(knot_t) + len(radius), 8))
    n = 0
    for k in range(len(radius)):
        low, high = first[k], first[k + 1]
        for i in range(low, high + 1):  # the segment that ends at knot i
            t0 = start if i == low else max(start, knot_t[i - 1])
            t1 = min(horizon, 2 * NEVER if i == high else knot_t[i])
            if t0 < t1:
                x, y, vx, vy = timeline_at(t0, trajectories, k)
                contact_radius = robot_radius + radius[k]
                segments[n] = (t0, t1, x, y, vx, vy, contact_radius, contact_radius)
                n += 1
    return segments[:n]
