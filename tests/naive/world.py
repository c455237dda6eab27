"""Slow, obvious twins of kernels/robot/dynamics.py and kernels/robot/sensor.py: everything by dense sampling."""

from __future__ import annotations

import math

import numpy as np


def wall_distance(blocked: np.ndarray, row: float, col: float) -> float:
    """Distance of a point from the nearest blocked square or edge of the map, in cells."""
    rows, cols = blocked.shape
    least = min(row + 0.5, rows - 0.5 - row, col + 0.5, cols - 0.5 - col)
    for r, c in np.argwhere(blocked):
        least = min(least, math.hypot(max(abs(row - r) - 0.5, 0.0), max(abs(col - c) - 0.5, 0.0)))
    return least


def first_wall(blocked: np.ndarray, row: float, col: float, dr: float, dc: float, radius: float, samples: int) -> float:
    """Share of the way at the first sample closer to a wall than the radius; infinite if none is."""
    for share in np.linspace(0.0, 1.0, samples):
        if wall_distance(blocked, row + share * dr, col + share * dc) < radius:
            return float(share)
    return math.inf


def first_inside(blocked: np.ndarray, knot_t: np.ndarray, knot_rc: np.ndarray, radius: float, samples: int) -> float:
    """Time of the first sample of a piecewise linear motion closer to a blocked square than the radius; infinite if none is."""
    for t in np.linspace(knot_t[0], knot_t[-1], samples):
        row, col = (np.interp(t, knot_t, knot_rc[:, axis]) for axis in (0, 1))
        for r, c in np.argwhere(blocked):
            if math.hypot(max(abs(row - r) - 0.5, 0.0), max(abs(col - c) - 0.5, 0.0)) < radius:
                return float(t)
    return math.inf


def drive(v: np.ndarray, heading: float, command: np.ndarray, v_max: float, a_max: float, dt: float) -> np.ndarray:
    """Holonomic robot: the velocity nearest to the command on the straight line to it that the limits allow."""
    if not np.isfinite(command).all():
        command = np.zeros(2)
    speed = np.hypot(*command)
    target = command if speed <= v_max else command / speed * v_max
    change = target - v
    size = np.hypot(*change)
    return target if size <= a_max * dt else v + change / size * a_max * dt


def visible(blocked: np.ndarray, a: np.ndarray, b: np.ndarray, samples: int = 400) -> bool:
    """Whether no sample of the segment (in cells) lies inside a blocked square."""
    for share in np.linspace(0.0, 1.0, samples):
        r, c = np.floor(a + share * (b - a) + 0.5).astype(int)
        if 0 <= r < blocked.shape[0] and 0 <= c < blocked.shape[1] and blocked[r, c]:
            return False
    return True
