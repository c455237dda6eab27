"""Slow, obvious twin of kernels/robot/motion.py and kernels/robot/cycle.py: steps of a millisecond, contact by sampling."""

from __future__ import annotations

import math

import numpy as np

HOLONOMIC, ACKERMANN = 0, 2
MS = 1e-3


def ramp(v: float, target: float, growth: float, fall: float) -> tuple[float, float, float]:
    """The speed after what infinite rates do to it at once, the end of the ramp it is on, and the ramp's rate."""
    while v != target:
        falls = v * (target - v) < 0.0
        end = 0.0 if falls and v * target < 0.0 else target
        rate = fall if falls else growth
        if rate < math.inf:
            return v, end, rate
        v = end
    return v, v, 1.0


def on(v: float, end: float, rate: float, h: float) -> float:
    """The speed after h s on a ramp."""
    return end if abs(end - v) <= rate * h else v + math.copysign(rate * h, end - v)


def wheels(state, command, limits, dt: float) -> np.ndarray:
    """States (x, y, theta, v, omega) of wheels every millisecond of a cycle under one command."""
    x, y, theta, v, w = state
    cv, cw = command if all(map(math.isfinite, command)) else (0.0, 0.0)
    cv, cw = min(max(cv, -limits.v_reverse), limits.v_max), min(max(cw, -limits.turn_rate), limits.turn_rate)

    def held(w: float, v: float) -> float:
        most = abs(v) / limits.turning_radius if limits.drive == ACKERMANN else math.inf
        return min(max(w, -most), most)

    steps = max(round(dt / MS), 1)
    rows = [(x, y, theta, v, w)]
    for _ in range(steps):
        left = dt / steps
        while left > 0.0:  # in quarters that end where the speed's ramp does
            v0, end, rate = ramp(v, cv, limits.a_max, limits.brake_max)
            h = min(left, dt / steps / 4)
            if v0 != end and abs(end - v0) < rate * h:
                h = abs(end - v0) / rate
                v = end
            else:
                v = on(v0, end, rate, h)
            w0 = held(cw if limits.alpha_max == math.inf else w, v0)
            w = held(cw if limits.alpha_max == math.inf else on(w0, cw, limits.alpha_max, h), v)
            middle = theta + (3 * w0 + w) / 8 * h
            x, y = x + (v0 + v) / 2 * math.cos(middle) * h, y + (v0 + v) / 2 * math.sin(middle) * h
            theta += (w0 + w) / 2 * h
            left -= h
        rows.append((x, y, theta, v, w))
    return np.array(rows)


def holonomic(state, command, limits, dt: float) -> np.ndarray:
    """States (x, y, theta, vx, vy) of a holonomic robot every millisecond of a cycle under one command."""
    x, y, theta, *v = state
    v, command = np.array(v), np.array(command if all(map(math.isfinite, command)) else (0.0, 0.0), float)
    asked = math.hypot(*command)
    if asked > limits.v_max:
        command *= limits.v_max / asked
    rate = limits.brake_max if command @ (command - v) <= 1e-9 else limits.a_max
    steps = max(round(dt / MS), 1)
    h = dt / steps
    rows = [(x, y, theta, *v)]
    for _ in range(steps):
        for _ in range(8):
            change = command - v
            size = math.hypot(*change)
            new = command if size <= rate * h / 8 else v + change / size * rate * h / 8
            v = new if rate == math.inf else v
            x, y = x + (v[0] + new[0]) / 2 * h / 8, y + (v[1] + new[1]) / 2 * h / 8
            v = new
        rows.append((x, y, theta, *v))
    return np.array(rows)


def body_at(corners: np.ndarray, x, y, theta) -> np.ndarray:
    """Corners of the body in the world; of bodies at many places, if these are arrays."""
    x, y, c, s = (np.asarray(value)[..., None] for value in (x, y, np.cos(theta), np.sin(theta)))
    ahead, left = corners.T
    return np.stack((x + c * ahead - s * left, y + s * ahead + c * left), axis=-1)


def hull_gap(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Distance of two convex polygons, counterclockwise, of one or more corners; negative if they overlap.

    The last two axes of an array are the corners of a polygon and their coordinates. All axes before are many polygons.
    """
    depth, least = -math.inf, math.inf
    for p, q in ((a, b), (b, a)):
        edge = (np.roll(p, -1, axis=-2) - p)[..., None, :]
        to = q[..., None, :, :] - p[..., None, :]  # from each corner of one polygon to each corner of the other
        length = np.hypot(edge[..., 0], edge[..., 1])
        if p.shape[-2] > 1:
            outwards = (to[..., 0] * edge[..., 1] - to[..., 1] * edge[..., 0]) / length
            depth = np.maximum(depth, outwards.min(axis=-1).max(axis=-1))
        share = np.clip((to * edge).sum(axis=-1) / np.where(length > 0.0, length, 1.0) ** 2, 0.0, 1.0)
        away = to - share[..., None] * edge
        least = np.minimum(least, np.hypot(away[..., 0], away[..., 1]).min(axis=(-2, -1)))
    return np.where((depth <= 0.0) & (max(a.shape[-2], b.shape[-2]) > 1), depth, least)


def wall_gap(corners: np.ndarray, blocked: np.ndarray, size: float, reach: float) -> np.ndarray:
    """Distance of a convex polygon in the world from blocked squares and the edges of a map whose corner is (0, 0).

    Of many polygons, if `corners` has more than two axes. Squares that are further than `reach` away from all are left out.
    """
    rows, cols = blocked.shape
    x, y = corners[..., 0], corners[..., 1]
    least = np.minimum(np.minimum(x, cols * size - x), np.minimum(y, rows * size - y)).min(axis=-1)
    for r, c in np.argwhere(blocked):
        if (
            x.min() - reach <= (c + 1) * size
            and c * size <= x.max() + reach
            and y.min() - reach <= (r + 1) * size
            and r * size <= y.max() + reach
        ):
            square = np.array([(c, r), (c + 1, r), (c + 1, r + 1), (c, r + 1)]) * size
            least = np.minimum(least, hull_gap(corners, square))
    return least


def answered(state, start: float, end: float, given, commands, limits) -> tuple[float, float]:
    """The speeds at `end` after every millisecond under the command that acts then; without one they stay."""
    for k in range(round((end - start) / MS)):
        now = start + (k + 0.5) * MS
        acting = [command for when, command in zip(given, commands, strict=True) if when + limits.latency <= now]
        if acting:
            state = (holonomic if limits.drive == HOLONOMIC else wheels)(state, acting[-1], limits, MS)[-1]
    return state[3], state[4]
