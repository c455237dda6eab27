"""Slow, obvious twins of the kernels of avoidance: everything by sampling."""

from __future__ import annotations

import math

import numpy as np


def unsafe_stay(x: float, y: float, piece: np.ndarray, times: np.ndarray) -> np.ndarray:
    """For each time, whether a robot standing at (x, y) is in contact with the piece."""
    w = times - piece[0]
    gap = np.hypot(piece[2] + piece[4] * w - x, piece[3] + piece[5] * w - y)
    return (times >= piece[0]) & (times <= piece[1]) & (gap < piece[6])


def unsafe_departures(
    x: float, y: float, v: np.ndarray, duration: float, piece: np.ndarray, departures: np.ndarray
) -> np.ndarray:
    """For each departure, whether some sample of the move is in contact with the piece."""
    z = np.linspace(0.0, duration, 201)
    t = departures[:, None] + z
    w = t - piece[0]
    gap = np.hypot(x + v[0] * z - piece[2] - piece[4] * w, y + v[1] * z - piece[3] - piece[5] * w)
    return ((t >= piece[0]) & (t <= piece[1]) & (gap < piece[7])).any(axis=1)


def gap_to_reach(a: np.ndarray, w: np.ndarray, contact_radius: float, growth: float, t: float) -> float:
    """Least sampled |a + w s| - (reach + growth s)."""
    s = np.linspace(0.0, t, 20001)
    return float((np.hypot(a[0] + w[0] * s, a[1] + w[1] * s) - contact_radius - growth * s).min())


def closest(knots: np.ndarray, segments: np.ndarray, step: float = 0.005) -> float:
    """Least sampled distance of a motion, rows (t, x, y), from contact with the segments."""
    t = np.arange(knots[0, 0], knots[-1, 0], step)
    x, y = np.interp(t, knots[:, 0], knots[:, 1]), np.interp(t, knots[:, 0], knots[:, 2])
    least = math.inf
    for p in segments:
        at = (t >= p[0]) & (t <= p[1])
        w = t[at] - p[0]
        if at.any():
            least = min(least, float((np.hypot(x[at] - p[2] - p[4] * w, y[at] - p[3] - p[5] * w) - p[6]).min()))
    return least


def passing(knots: np.ndarray, segments: np.ndarray, now: float, until: float) -> tuple[float, ...]:
    """Of 101 instants the one at which robot and obstacle are nearest: the robot seen from the obstacle, and its velocity."""
    seen = []
    for t in now + (until - now) * np.arange(101) / 100:
        p = segments[segments[:, 1] > t][0] if (segments[:, 1] > t).any() else segments[-1]
        x, y = (float(np.interp(t, knots[:, 0], knots[:, k])) - (p[1 + k] + (t - p[0]) * p[3 + k]) for k in (1, 2))
        seen.append((x, y, p[4], p[5]))
    return min(seen, key=lambda one: math.hypot(*one[:2]))


class Kalman:
    """The textbook filter with matrices, one axis: state (place, velocity), white acceleration of density q^2 dt."""

    def __init__(self, z: float, w: float, variance: float, velocity_variance: float) -> None:
        self.m, self.p = np.array([z, w]), np.diag([variance, velocity_variance])

    def step(self, dt: float, q: float, z: float, variance: float) -> None:
        f, noise = np.array([[1.0, dt], [0.0, 1.0]]), np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        self.m, self.p = f @ self.m, f @ self.p @ f.T + q * q * dt * noise
        h = np.array([[1.0, 0.0]])
        k = self.p @ h.T / (h @ self.p @ h.T + variance)
        self.m = self.m + (k * (z - self.m[0])).ravel()
        self.p = (np.eye(2) - k @ h) @ self.p
