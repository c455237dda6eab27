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


def body_at(corners: np.ndarray, x: float, y: float, theta: float) -> np.ndarray:
    """Corners of the body in the world."""
    c, s = math.cos(theta), math.sin(theta)
    return corners @ np.array([[c, s], [-s, c]]) + (x, y)


def hull_gap(a: np.ndarray, b: np.ndarray) -> float:
    """Distance of two convex polygons, counterclockwise, of one or more corners; negative if they overlap."""
    depth = -math.inf
    for p, q in ((a, b), (b, a)):
        for i in range(len(p) if len(p) > 1 else 0):
            edge = p[(i + 1) % len(p)] - p[i]
            normal = np.array([edge[1], -edge[0]]) / math.hypot(*edge)
            depth = max(depth, float(((q - p[i]) @ normal).min()))
    if depth <= 0.0 and max(len(a), len(b)) > 1:
        return depth
    least = math.inf
    for p, q in ((a, b), (b, a)):
        for i in range(len(p)):
            start, edge = p[i], p[(i + 1) % len(p)] - p[i]
            square = float(edge @ edge)
            share = np.clip(((q - start) @ edge) / square, 0.0, 1.0) if square else np.zeros(len(q))
            least = min(least, float(np.hypot(*(q - start - share[:, None] * edge).T).min()))
    return least


def wall_gap(corners: np.ndarray, blocked: np.ndarray, size: float, reach: float) -> float:
    """Distance of a convex polygon in the world from blocked squares and the edges of a map whose corner is (0, 0)."""
    rows, cols = blocked.shape
    least = float(min(corners.min(), (cols * size - corners[:, 0]).min(), (rows * size - corners[:, 1]).min()))
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    for r, c in np.argwhere(blocked):
        if low[0] <= (c + 1) * size and c * size <= high[0] and low[1] <= (r + 1) * size and r * size <= high[1]:
            square = np.array([(c, r), (c + 1, r), (c + 1, r + 1), (c, r + 1)]) * size
            least = min(least, hull_gap(corners, square))
    return least


def answered(state, start: float, end: float, given, commands, limits) -> tuple[float, float]:
    """The speeds at `end` after every millisecond under the command that acts then; without one they stay."""
    for k in range(round((end - start) / MS)):
        now = start + (k + 0.5) * MS
        acting = [command for when, command in zip(given, commands, strict=True) if when + limits.latency <= now]
        if acting:
            state = (holonomic if limits.drive == HOLONOMIC else wheels)(state, acting[-1], limits, MS)[-1]
    return state[3], state[4]
