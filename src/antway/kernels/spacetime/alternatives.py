"""How a motion passes an obstacle, and the time to the goal without moving obstacles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.base.records import T0, T1, VX, VY, X, Y
from antway.kernels.spacetime.context import PlanningContext, block_around, centre
from antway.kernels.spacetime.motion import place_at

_SAMPLES = 100  # number of steps into which the time span is divided


@kernel
def passing(
    knots: NDArray[np.float64], segments: NDArray[np.float64], now: float, until: float
) -> tuple[float, float, float, float]:
    """Return the robot's place relative to an obstacle when the two are nearest, and the obstacle's velocity then.

    The robot is on knots (t, x, y). The `segments` predict the obstacle in order of time. Places are sampled from `now` to
    `until` s.
    """
    best, p = (math.inf, 0.0, 0.0, 0.0, 0.0), 0
    for i in range(_SAMPLES + 1):
        t = now + (until - now) * i / _SAMPLES
        while p < len(segments) - 1 and segments[p, T1] <= t:
            p += 1
        x, y, _ = place_at(knots, t)
        x -= segments[p, X] + (t - segments[p, T0]) * segments[p, VX]
        y -= segments[p, Y] + (t - segments[p, T0]) * segments[p, VY]
        if math.hypot(x, y) < best[0]:
            best = math.hypot(x, y), x, y, float(segments[p, VX]), float(segments[p, VY])
    return best[1], best[2], best[3], best[4]


@kernel
def free_time(context: PlanningContext, x: float, y: float, leg_cells: int) -> float:
    """Return the time from (x, y) to the goal without moving obstacles, s; the first leg goes up to `leg_cells` cells."""
    top, bottom, left, right = block_around(context, x, y, leg_cells)
    best = math.inf
    for row in range(top, bottom):
        for cell in range(row * context.cols + left, row * context.cols + right):
            cx, cy = centre(context, cell)
            best = min(best, math.hypot(cx - x, cy - y) / context.speed + context.field[cell])
    return best
