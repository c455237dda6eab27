"""Where an obstacle can be, by looking at many instants."""

from __future__ import annotations

import math
from collections.abc import Sequence


def gap(row: Sequence[float], px: float, py: float, t: float) -> float:
    """Distance of a point from both discs that an obstacle is in at `t`."""
    x, y, vx, vy, radius, speed, accel, age = row
    later = t + age
    full = math.dist((px, py), (x, y)) - radius - speed * later
    if math.isinf(accel):
        return full
    return max(full, math.dist((px, py), (x + vx * later, y + vy * later)) - radius - accel * later**2 / 2)


def least(
    row: Sequence[float], px: float, py: float, wx: float, wy: float, start: float, end: float, looks: int = 400
) -> float:
    """The least of `gap` at so many instants of a uniform motion."""
    times = [start + (end - start) * i / looks for i in range(looks + 1)]
    return min(gap(row, px + wx * (t - start), py + wy * (t - start), t) for t in times)
