"""Slow, obvious twins of ORCA: by sampling, and by trying every candidate."""

from __future__ import annotations

import itertools
import math

import numpy as np


def meets(a: np.ndarray, u: np.ndarray, contact_radius: float, horizon: float) -> bool:
    """Whether two who keep on at relative velocity `u` touch within the horizon, the other being at `a`."""
    nearest = min(max(float(a @ u) / max(float(u @ u), 1e-300), 0.0), horizon)  # s
    return math.hypot(*(a - u * nearest)) < contact_radius


def least_change(a: np.ndarray, u: np.ndarray, contact_radius: float, horizon: float) -> float:
    """Least change of `u`, over directions and lengths, to the border between velocities that meet and those that do not."""
    now, best = meets(a, u, contact_radius, horizon), math.inf
    for angle in np.linspace(-math.pi, math.pi, 120, endpoint=False):
        path = np.array([math.cos(angle), math.sin(angle)])
        for length in np.arange(0.0, 3.5, 0.01):
            if length >= best:
                break
            if meets(a, u + length * path, contact_radius, horizon) != now:
                best = float(length)
    return best


def violation(lines: np.ndarray, v: np.ndarray) -> float:
    """How far `v` is beyond the line that it is farthest beyond."""
    return max(-(dx * (v[1] - y) - dy * (v[0] - x)) for x, y, dx, dy in lines.tolist())


def nearest(lines: np.ndarray, top: float, request: np.ndarray) -> np.ndarray | None:
    """The best of all candidates: the wish, its feet on lines and circle, crossings of lines with lines and with the circle."""
    candidates = [request, request * top / max(math.hypot(*request), 1e-12)]
    for x, y, dx, dy in lines.tolist():
        p, d = np.array([x, y]), np.array([dx, dy])
        foot = float(p @ d)
        candidates.append(p + d * float(d @ (request - p)))
        root = foot * foot + top * top - float(p @ p)
        if root >= 0.0:
            candidates += [p + d * (-foot - math.sqrt(root)), p + d * (-foot + math.sqrt(root))]
    for one, other in itertools.combinations(lines, 2):
        matrix = np.column_stack((one[2:], -other[2:]))
        if abs(np.linalg.det(matrix)) > 1e-9:
            candidates.append(one[:2] + one[2:] * np.linalg.solve(matrix, other[:2] - one[:2])[0])
    good = [v for v in candidates if math.hypot(*v) <= top + 1e-9 and violation(lines, v) <= 1e-9]
    return min(good, key=lambda v: math.dist(v, request)) if good else None


def least_violation(lines: np.ndarray, top: float) -> float:
    """Least sampled value of `violation` over the disc of velocities."""
    grid = np.linspace(-top, top, 61)
    return min(violation(lines, np.array([x, y])) for x in grid for y in grid if math.hypot(x, y) <= top)
