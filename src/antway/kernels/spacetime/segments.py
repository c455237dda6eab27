"""When can a disc not stand, or not set off? Exact answers against pieces of uniform motion.

A *piece* is a row (t0, t1, x, y, vx, vy, reach, berth): from t0 to t1 s an obstacle moves uniformly from (x, y) m with
(vx, vy) m/s. A robot that stands is in its way at a distance of the centres below `contact_radius` m, one that moves below `berth`
m, and that of where the obstacle was `stopping_time` s before: what a guard asks of one that cannot stop sooner. Touching is legal. A
piecewise linear prediction is a list of pieces, and a tube that widens over time is one whose later pieces reach farther.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel

TOUCH = 1e-9
Segments = NDArray[np.float64]  # [P, 8]


@bare_kernel
def unsafe_stay(x: float, y: float, segments: Segments, p: int) -> tuple[float, float]:
    """Return the open interval of times in s at which a robot at (x, y) is in contact with piece p; (inf, -inf) if none."""
    return within(x, y, segments[p, 6] - TOUCH, segments, p)


@bare_kernel
def within(x: float, y: float, distance: float, segments: Segments, p: int) -> tuple[float, float]:
    """Return the open interval of times in s at which piece p is less than `distance` m from (x, y); (inf, -inf) if none."""
    ax, ay = segments[p, 2] - x, segments[p, 3] - y
    vx, vy = segments[p, 4], segments[p, 5]
    slack = ax * ax + ay * ay - distance * distance
    vv = vx * vx + vy * vy
    if vv == 0.0:
        return (segments[p, 0], segments[p, 1]) if slack < 0.0 else (math.inf, -math.inf)
    av = ax * vx + ay * vy
    root = av * av - vv * slack
    if root <= 0.0:
        return math.inf, -math.inf
    root = math.sqrt(root)
    low = max(segments[p, 0], segments[p, 0] + (-av - root) / vv)
    high = min(segments[p, 1], segments[p, 0] + (-av + root) / vv)
    return (low, high) if low < high else (math.inf, -math.inf)


@bare_kernel
def _edge(
    bx: float, by: float, dx: float, dy: float, low: float, high: float, contact_radius: float, out: NDArray[np.float64]
) -> bool:
    """Part of [low, high] in which |b + d z| < reach, written to out[0:2]; False if there is none."""
    dd = dx * dx + dy * dy
    slack = bx * bx + by * by - contact_radius * contact_radius
    if dd == 0.0:
        out[0], out[1] = low, high
        return slack < 0.0
    bd = bx * dx + by * dy
    root = bd * bd - dd * slack
    if root <= 0.0:
        return False
    root = math.sqrt(root)
    out[0] = max(low, (-bd - root) / dd)
    out[1] = min(high, (-bd + root) / dd)
    return bool(out[0] < out[1])


@bare_kernel
def unsafe_departures(
    x: float, y: float, vx: float, vy: float, duration: float, segments: Segments, p: int, work: NDArray[np.float64]
) -> tuple[float, float]:
    """Return the interval of departure times in s for which a uniform move meets piece p (without lag); (inf, -inf) if none.

    The robot leaves (x, y) at time s with (vx, vy) and drives for `duration` s. In contact are the (z, t) in [0, duration] x
    [t0, t1], z the time since departure and t the time itself, with |a + v z - u (t - t0)| < reach: a convex set, so the
    departures s = t - z that lead into it are one interval. Its ends lie on an edge of the rectangle or where a line of
    constant s touches the ellipse. `work` is float64[2].
    """
    t0, t1 = segments[p, 0], segments[p, 1]
    ax, ay = x - segments[p, 2], y - segments[p, 3]
    ux, uy = segments[p, 4], segments[p, 5]
    contact_radius = segments[p, 7] - TOUCH
    span = t1 - t0
    low, high = math.inf, -math.inf
    for k in range(2):  # edges of constant z: at departure and at arrival
        z = duration * k
        if _edge(ax + vx * z, ay + vy * z, -ux, -uy, 0.0, span, contact_radius, work):
            low, high = min(low, work[0] - z), max(high, work[1] - z)
    for k in range(2):  # edges of constant t: the piece's begin and end
        w = span * k
        if _edge(ax - ux * w, ay - uy * w, vx, vy, 0.0, duration, contact_radius, work):
            low, high = min(low, w - work[1]), max(high, w - work[0])
    # q = a + v z - u w on the circle; w - z is linear in q with gradient g, so it is extreme at q = -+ reach g / |g|.
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
def delayed(
    x: float,
    y: float,
    vx: float,
    vy: float,
    duration: float,
    s: float,
    segments: Segments,
    p: int,
    stopping_time: float,
    work: NDArray[np.float64],
) -> float:
    """Return s, or where piece p forbids to leave (x, y) then with (vx, vy) for `duration` s, when it no longer does."""
    t0, t1 = max(s - stopping_time, segments[p, 0]), min(s - stopping_time + duration, segments[p, 1])
    if t0 > t1:
        return s
    # culling: the boxes of both sweeps
    contact_radius = segments[p, 7]
    ex, ey = x + vx * duration, y + vy * duration
    ox, px = segments[p, 2] + segments[p, 4] * (t0 - segments[p, 0]), segments[p, 2] + segments[p, 4] * (t1 - segments[p, 0])
    if min(ox, px) - contact_radius > max(x, ex) or max(ox, px) + contact_radius < min(x, ex):
        return s
    oy, py = segments[p, 3] + segments[p, 5] * (t0 - segments[p, 0]), segments[p, 3] + segments[p, 5] * (t1 - segments[p, 0])
    if min(oy, py) - contact_radius > max(y, ey) or max(oy, py) + contact_radius < min(y, ey):
        return s
    low, high = unsafe_departures(x, y, vx, vy, duration, segments, p, work)
    return high + stopping_time if low + TOUCH < s - stopping_time < high - TOUCH else s


@bare_kernel
def earliest_departure(
    x: float,
    y: float,
    vx: float,
    vy: float,
    duration: float,
    s: float,
    limit: float,
    segments: Segments,
    stopping_time: float,
    work: NDArray[np.float64],
) -> float:
    """Return the first time in [s, limit] to leave (x, y) with (vx, vy) for `duration` s without contact; infinite if none."""
    p = clear = 0  # pieces in turn, until all in a row allow the same time
    while clear < len(segments) and s <= limit:
        later = delayed(x, y, vx, vy, duration, s, segments, p, stopping_time, work)
        clear = clear + 1 if later == s else 1
        s, p = later, p + 1 if p + 1 < len(segments) else 0
    return s if s <= limit else math.inf
