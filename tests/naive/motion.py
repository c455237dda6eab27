"""Slow, obvious twin of kernels/robot/motion.py and kernels/robot/cycle.py: steps of a millisecond, contact by sampling."""

from __future__ import annotations

import math

import numpy as np

ACKERMANN = 2
MS = 1e-3


def ramp(v: float, target: float, growth: float, fall: float, h: float) -> float:
    """The speed after h s on its ramp to the target; through 0 the rate changes, so the step is cut there."""
    if v * (target - v) < 0.0:
        end = target if v * target >= 0.0 else 0.0
        if abs(end - v) > fall * h:
            return v + math.copysign(fall * h, end - v)
        h -= abs(end - v) / fall
        v = end
    return target if abs(target - v) <= growth * h else v + math.copysign(growth * h, target - v)


def wheels(state, command, limits, dt: float) -> np.ndarray:
    """States (x, y, theta, v, omega) of wheels every millisecond of a cycle under one command."""
    x, y, theta, v, w = state
    cv, cw = command if all(map(math.isfinite, command)) else (0.0, 0.0)
    cv, cw = min(max(cv, -limits.v_reverse), limits.v_max), min(max(cw, -limits.turn_rate), limits.turn_rate)
    steps = max(round(dt / MS), 1)
    h = dt / steps
    rows = [(x, y, theta, v, w)]
    for _ in range(steps):
        fine = []
        for _ in range(4):  # quarters, so that a ramp that ends within the step is met
            v = ramp(v, cv, limits.a_max, limits.brake_max, h / 4)
            w = ramp(w, cw, limits.alpha_max, limits.alpha_max, h / 4)
            if limits.drive == ACKERMANN:
                w = min(max(w, -abs(v) / limits.turning_radius), abs(v) / limits.turning_radius)
            fine.append((v, w))
        v0, w0 = rows[-1][3], rows[-1][4]
        for v1, w1 in fine:
            middle = theta + (3 * w0 + w1) / 8 * h / 4
            x += (v0 + v1) / 2 * math.cos(middle) * h / 4
            y += (v0 + v1) / 2 * math.sin(middle) * h / 4
            theta += (w0 + w1) / 2 * h / 4
            v0, w0 = v1, w1
        rows.append((x, y, theta, v, w))
    return np.array(rows)


def holonomic(state, command, limits, dt: float) -> np.ndarray:
    """States (x, y, theta, vx, vy) of a holonomic robot every millisecond of a cycle under one command."""
    x, y, theta, *v = state
    v, command = np.array(v), np.array(command if all(map(math.isfinite, command)) else (0.0, 0.0), float)
    asked = math.hypot(*command)
    if asked > limits.v_max:
        command *= limits.v_max / asked
    rate = limits.brake_max if command @ (command - v) <= 0.0 else limits.a_max
    steps = max(round(dt / MS), 1)
    h = dt / steps
    rows = [(x, y, theta, *v)]
    for _ in range(steps):
        for _ in range(8):
            change = command - v
            size = math.hypot(*change)
            new = command if size <= rate * h / 8 else v + change / size * rate * h / 8
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
