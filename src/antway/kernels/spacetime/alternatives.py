"""How a motion passes one obstacle, and what it would be worth if nothing moved."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.base.records import T0, T1, VX, VY, X, Y
from antway.kernels.spacetime.context import PlanningContext, centre
from antway.kernels.spacetime.motion import place_at

_SAMPLES = 100  # steps into which the time looked at is divided


@kernel
def passing(
    knots: NDArray[np.float64], segments: NDArray[np.float64], now: float, until: float
) -> tuple[float, float, float, float]:
    """Return where the robot on knots (t, x, y) is as seen from an obstacle when it is nearest to it, and that one's velocity.

    Looks from `now` to `until` s, in steps; `segments` predict the one obstacle, in order of time.
    """
    best, p = (math.inf, 0.0, 0.0, 0.0, 0.0), 0
    for i in range(_SAMPLES + 1):
        t = now + (until - now) * i / _SAMPLES
        while p < len(segments) - 1 and segments[p, T1] <= t:
            p += 1
        x, y, _ = place_at(knots, len(knots), t)
        x -= segments[p, X] + (t - segments[p, T0]) * segments[p, VX]
        y -= segments[p, Y] + (t - segments[p, T0]) * segments[p, VY]
        if math.hypot(x, y) < best[0]:
            best = math.hypot(x, y), x, y, float(segments[p, VX]), float(segments[p, VY])
    return best[1], best[2], best[3], best[4]


@kernel
def free_time(context: PlanningContext, x: float, y: float, leg_cells: int) -> float:
    """Return the time to the goal from (x, y) if nothing moved, s: by way of a cell at most `leg_cells` cells around."""
    rows, cols = context.blocked.shape
    col0, row0 = (
        math.floor((x - context.x0) / context.resolution + 0.5),
        math.floor((y - context.y0) / context.resolution + 0.5),
    )
    best = math.inf
    for row in range(max(row0 - leg_cells, 0), min(row0 + leg_cells, rows - 1) + 1):
        for col in range(max(col0 - leg_cells, 0), min(col0 + leg_cells, cols - 1) + 1):
            cx, cy = centre(context, row * cols + col)
            best = min(best, math.hypot(cx - x, cy - y) / context.speed + context.field[row * cols + col])
    return best
