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
        for x, y, vx, vy, r, bound, accel, age in tracks:
            later = t + s + age
            gap = np.hypot(path[:, 0] - x, path[:, 1] - y) - bound * later
            if np.isfinite(accel):
                ahead = np.hypot(path[:, 0] - x - vx * later, path[:, 1] - y - vy * later) - accel * later**2 / 2
                gap = np.maximum(gap, ahead)
            least = min(least, float(gap.min()) - r - radius)
        least = min(least, _wall_gap(path, blocked, size) - radius)
        xy, t = xy + v * dt, t + dt
        v, heading = driven(v, heading, (0.0, 0.0), limits, dt)
    return least


def _wall_gap(path, blocked, size) -> float:
    rows, cols = blocked.shape
    least = min(path.min(), (cols * size - path[:, 0]).min(), (rows * size - path[:, 1]).min())
    row, col = np.nonzero(blocked)
    near = np.hypot((col + 0.5) * size - path[0, 0], (row + 0.5) * size - path[0, 1]) < 2.0  # m; no robot gets to others
    row, col = row[near], col[near]
    dx = np.maximum(np.abs(path[:, 0, None] - (col + 0.5) * size) - size / 2, 0.0)
    dy = np.maximum(np.abs(path[:, 1, None] - (row + 0.5) * size) - size / 2, 0.0)
    return min(float(least), float(np.hypot(dx, dy).min(initial=math.inf)))


class Book:
    """Tracks by name: when last seen, and how."""

    def __init__(self) -> None:
        self.seen: dict[int, tuple] = {}

    def take(self, now, stamp, hold, name, xy, velocity, radius, spread, bounds, stopping) -> np.ndarray:
        """The rows of kernels/robot/reach.py; `bounds` are on speed, its growth and the change of velocity; [3] is learnt."""
        for k, obstacle in enumerate(name.tolist()):
            speed = math.hypot(*velocity[k])
            most = [0.0, 0.0]
            if obstacle in self.seen:
                before = self.seen[obstacle]
                most = list(before[-1])
                if spread[k] == 0.0 and not math.isnan(speed) and not math.isnan(before[-2]) and stamp > before[0]:
                    most[1] = max(most[1], (speed - before[-2]) / (stamp - before[0]))
            v = np.zeros(2) if math.isnan(speed) else velocity[k]
            if spread[k] == 0.0 and not math.isnan(speed):
                most[0] = max(most[0], speed)
            self.seen[obstacle] = (stamp, *xy[k], *v, radius[k] + spread[k], speed, most)
        top = max([math.hypot(*v) for v, off in zip(velocity, spread) if off == 0.0 and not np.isnan(v).any()], default=0.0)
        bounds[3] += 0.01 * max(top - bounds[3], 0.0)
        self.seen = {obstacle: row for obstacle, row in self.seen.items() if row[0] >= stamp or now - row[0] <= hold}
        rows = []
        for at, x, y, vx, vy, r, speed, most in self.seen.values():
            fastest = max(bounds[0], bounds[3], most[0])
            bound = min(fastest, speed + max(bounds[1], most[1]) * (now - at + stopping))
            accel = bounds[2]
            if math.isnan(speed):
                bound, accel = fastest, math.inf
            rows.append((x, y, vx, vy, r, bound, accel, now - at))
        return np.array(rows).reshape(-1, 8)
