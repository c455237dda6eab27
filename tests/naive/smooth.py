"""Slow, obvious twin of kernels/trajectory/smooth.py: splines by SciPy, clearance from every cell, speeds by bisection."""

from __future__ import annotations

import math

import numpy as np
from scipy.interpolate import BSpline

HOLONOMIC = 0


def clearance(blocked: np.ndarray, size: float, x: float, y: float) -> float:
    """Distance of a point from all blocked squares and the edges of the map, below 0 off it."""
    rows, cols = blocked.shape
    away = np.abs((x, y) - (np.argwhere(blocked)[:, ::-1] + 0.5) * size) - size / 2
    return min(x, y, cols * size - x, rows * size - y, np.hypot(*np.maximum(away, 0.0).T).min(initial=math.inf))


def spline(points: np.ndarray, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Places and curvatures of the samples of a uniform cubic spline whose end points count three times."""
    every = np.vstack((points[:1], points[:1], points, points[-1:], points[-1:]))
    curve = BSpline(np.arange(len(every) + 4.0), every, 3)
    u = 3.0 + np.arange((len(points) + 1) * samples + 1) / samples
    u[-1] -= 1e-12
    first, second = curve(u, 1), curve(u, 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        kappa = (first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]) / np.hypot(*first.T) ** 3
    kappa[: samples + 1] = kappa[-samples - 1 :] = 0.0
    return curve(u), kappa


def accelerations(x: float, kappa: tuple[float, float], ds: float, limits) -> tuple[float, float]:
    """Least and greatest acceleration along the path that keeps the limits at the square x of the speed; (1, -1) for none."""
    middle, change = sum(kappa) / 2, (kappa[1] - kappa[0]) / ds
    if x > limits.v_max**2:
        return 1.0, -1.0
    if limits.drive == HOLONOMIC:
        most = min(limits.a_max, limits.brake_max)
        if max(abs(middle), abs(kappa[0])) * x > most:
            return 1.0, -1.0
        part = math.sqrt(1 - (middle * x / most) ** 2)
        return -limits.brake_max * part, limits.a_max * part
    if abs(kappa[0]) * math.sqrt(x) > limits.turn_rate:
        return 1.0, -1.0
    low, high = -limits.brake_max, limits.a_max
    if abs(middle) < 1e-9:
        return (low, high) if abs(change) * x <= limits.alpha_max else (1.0, -1.0)
    bounds = sorted(((-limits.alpha_max - change * x) / middle, (limits.alpha_max - change * x) / middle))
    return max(low, bounds[0]), min(high, bounds[1])


def squares(kappa: np.ndarray, ds: np.ndarray, limits) -> np.ndarray:
    """Squares of the greatest speeds along a path from stand to stand."""
    m = len(kappa)
    high = np.zeros(m)
    for i in range(m - 2, -1, -1):

        def drives(x: float, i: int = i) -> bool:
            low, most = accelerations(x, (kappa[i], kappa[i + 1]), ds[i], limits)
            return low <= most and x + 2 * ds[i] * low <= high[i + 1] and x + 2 * ds[i] * most >= 0

        a, b = 0.0, limits.v_max**2
        for _ in range(80):
            middle = (a + b) / 2
            a, b = (middle, b) if drives(middle) else (a, middle)
        high[i] = b if drives(b) else a
    x = np.zeros(m)
    for i in range(m - 1):
        _, most = accelerations(x[i], (kappa[i], kappa[i + 1]), ds[i], limits)
        x[i + 1] = max(min(x[i] + 2 * ds[i] * most, high[i + 1]), 0.0)
    return x
