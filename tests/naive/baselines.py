"""Slow, obvious twins of the baselines' kernels: gradients by differences, linear systems solved whole, dense sampling."""

from __future__ import annotations

import itertools
import math

import numpy as np
from scipy.ndimage import label


def wall_potential(blocked: np.ndarray, size: float, x: float, y: float, radius: float, contact_radius: float) -> float:
    """Sum over walls, told apart by flooding, of (1/d - 1/reach)^2 / 2, d to the nearest point of any of its cells."""
    rows, cols = blocked.shape
    walls, count = label(blocked, np.ones((3, 3)))
    distances = [x, cols * size - x, y, rows * size - y]
    for wall in range(1, count + 1):
        cells = np.argwhere(walls == wall) * size
        aside = np.maximum(np.maximum(cells[:, 1] - x, x - cells[:, 1] - size), 0.0)
        along = np.maximum(np.maximum(cells[:, 0] - y, y - cells[:, 0] - size), 0.0)
        distances.append(float(np.hypot(aside, along).min()))
    return sum((1 / (d - radius) - 1 / contact_radius) ** 2 / 2 for d in distances if d - radius < contact_radius)


def disc_potential(robot: np.ndarray, radius: float, brake: float, contact_radius: float, discs: np.ndarray) -> float:
    """Sum over discs (x, y, vx, vy, r) of 1 / (d - b) - 1 / reach for the robot (x, y, vx, vy): Ge and Cui 2002, eq. by eq."""
    total = 0.0
    for disc in discs:
        away = disc[:2] - robot[:2]
        approach = float((robot[2:] - disc[2:4]) @ away / np.linalg.norm(away))
        gap = float(np.linalg.norm(away)) - radius - disc[4] - approach**2 / (2 * brake)
        if approach > 0 and gap < contact_radius:
            total += 1 / gap - 1 / contact_radius
    return total


def gradient(function, at: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central differences."""
    return np.array([(function(at + e) - function(at - e)) / (2 * step) for e in np.eye(len(at)) * step])


def neighbours(kind: np.ndarray, row: int, col: int) -> list[tuple[int, int, float]]:
    """The up to 8 neighbours of a cell and their distances; diagonal ones only if both side cells are not closed (1)."""
    near = []
    for i, j in itertools.product((-1, 0, 1), repeat=2):
        r, c = row + i, col + j
        inside = 0 <= r < kind.shape[0] and 0 <= c < kind.shape[1] and (i, j) != (0, 0)
        if inside and (i == 0 or j == 0 or (kind[row, c] != 1 and kind[r, col] != 1)):
            near.append((r, c, math.hypot(i, j)))
    return near


def relaxed(kind: np.ndarray, slope: float, diagonal: float) -> np.ndarray:
    """Fixed point of Glasius' relaxation: one linear equation a cell, solved at once. 0 free, 1 closed, 2 target."""
    n = kind.size
    a, b = np.eye(n), np.zeros(n)
    for row, col in np.ndindex(kind.shape):
        i = row * kind.shape[1] + col
        b[i] = kind[row, col] == 2
        if kind[row, col] == 0:
            for r, c, d in neighbours(kind, row, col):
                a[i, r * kind.shape[1] + c] -= slope * (1.0 if d == 1 else diagonal)
    return np.linalg.solve(a, b).reshape(kind.shape)


def shunted(kind: np.ndarray, time: float, step: float = 1e-4) -> np.ndarray:
    """Yang and Meng's dynamics with A = 10, B = D = 1, mu = 0.7, E = 100 from rest, by Euler's method, all neurons at once."""
    x = np.zeros(kind.shape)
    for _ in range(round(time / step)):
        change = np.zeros_like(x)
        for row, col in np.ndindex(kind.shape):
            drive = 100.0 * (kind[row, col] == 2) - 100.0 * (kind[row, col] == 1)
            excited = max(drive, 0.0) + sum(0.7 / d * max(x[r, c], 0.0) for r, c, d in neighbours(kind, row, col))
            here = x[row, col]
            change[row, col] = -10.0 * here + (1.0 - here) * excited - (1.0 + here) * max(-drive, 0.0)
        x += step * change
    return x


def first_touch(
    start: tuple[float, float],
    velocity: tuple[float, float],
    horizon: float,
    discs: np.ndarray,
    wall: float,
    radius: float,
    samples: int = 20001,
) -> float:
    """When a disc that goes straight first touches one of `discs` (x, y, vx, vy, least distance) or the wall x = `wall`."""
    t = np.linspace(0.0, horizon, samples)
    x, y = start[0] + velocity[0] * t, start[1] + velocity[1] * t
    touched = x + radius > wall
    for d in discs:
        touched |= np.hypot(d[0] + d[2] * t - x, d[1] + d[3] * t - y) < d[4]
    return float(t[touched][0]) if touched.any() else math.inf
