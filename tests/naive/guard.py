"""Slow, obvious twins of the guard's kernels: everything by sampling."""

from __future__ import annotations

import math

import numpy as np


def driven(v, heading, command, limits, dt):
    """The robot's velocity and heading after one step under a command, by the textbook."""
    v_max, a_max, turn_rate, differential = limits
    command, v = np.array(command, float), np.array(v, float)
    asked = math.hypot(*command)
    command *= min(1.0, v_max / asked) if asked > 0 else 0.0
    if not differential:
        change = command - v
        much = math.hypot(*change)
        return v + change * min(1.0, a_max * dt / much if much > 0 else 1.0), heading
    speed = v @ (math.cos(heading), math.sin(heading))
    if asked > 1e-9:
        turn = math.remainder(math.atan2(command[1], command[0]) - heading, 2 * math.pi)
        heading += min(max(turn, -turn_rate * dt), turn_rate * dt)
    ahead = np.array([math.cos(heading), math.sin(heading)])
    return min(max(max(command @ ahead, 0.0), speed - a_max * dt), speed + a_max * dt) * ahead, heading


def gaps_of_fractions(px, py, v, heading, command, tracks, radius, limits, dt, blocked, size) -> np.ndarray:
    """For 0.1, 0.2, ... 1.0 of the command: least gap in m, until a stand, to what obstacles could reach and to walls."""
    command = np.array(command) * min(1.0, limits[0] / math.hypot(*command))
    return np.array(
        [_least_gap(px, py, v, heading, command * k / 10, tracks, radius, limits, dt, blocked, size) for k in range(1, 11)]
    )


def _least_gap(px, py, v, heading, command, tracks, radius, limits, dt, blocked, size) -> float:
    xy, t, least = np.array([px, py]), 0.0, math.inf
    v, heading = driven(v, heading, command, limits, dt)
    while math.hypot(*v) > 1e-9:
        s = np.linspace(0.0, dt, 101)
        path = xy + s[:, None] * v
        for x, y, _, _, r, bound in tracks:
            least = min(least, float((np.hypot(path[:, 0] - x, path[:, 1] - y) - r - radius - bound * (t + s)).min()))
        least = min(least, _wall_gap(path, blocked, size) - radius)
        xy, t = xy + v * dt, t + dt
        v, heading = driven(v, heading, (0.0, 0.0), limits, dt)
    return least


def _wall_gap(path, blocked, size) -> float:
    rows, cols = blocked.shape
    least = min(path.min(), (cols * size - path[:, 0]).min(), (rows * size - path[:, 1]).min())
    row, col = np.nonzero(blocked)
    dx = np.maximum(np.abs(path[:, 0, None] - (col + 0.5) * size) - size / 2, 0.0)
    dy = np.maximum(np.abs(path[:, 1, None] - (row + 0.5) * size) - size / 2, 0.0)
    return min(float(least), float(np.hypot(dx, dy).min()))


class Book:
    """Tracks by name: when last seen, and how."""

    def __init__(self) -> None:
        self.seen: dict[int, tuple] = {}

    def take(self, now, stamp, hold, name, xy, velocity, radius, spread, fastest, surge, stopping) -> np.ndarray:
        for k, obstacle in enumerate(name.tolist()):
            known = not np.isnan(velocity[k]).any()
            v = velocity[k] if known else np.zeros(2)
            self.seen[obstacle] = (stamp, *xy[k], *v, radius[k] + spread[k], math.hypot(*v) if known else fastest)
        self.seen = {obstacle: row for obstacle, row in self.seen.items() if row[0] >= stamp or now - row[0] <= hold}
        rows = []
        for at, x, y, vx, vy, r, speed in self.seen.values():
            bound = min(fastest, speed + surge * (now - at + stopping))
            rows.append((x, y, vx, vy, r + bound * (now - at), bound))
        return np.array(rows).reshape(-1, 6)
