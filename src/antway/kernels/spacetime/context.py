"""The planning context: the map, the robot's moves on it, and the exact field over these moves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import segment_hits_cells
from antway.kernels.base.jit import bare_kernel
from antway.kernels.spacetime.segments import TOUCH, unsafe_stay


class PlanningContext(NamedTuple):
    """The map, the robot's moves on it, and the exact field over these moves."""

    blocked: NDArray[np.bool_]  # [H, W]
    legal: NDArray[np.uint32]  # [H * W] bit k tells whether move k is free of walls
    field: NDArray[np.float64]  # [H * W] s; time to the goal at full speed over these moves
    offset: NDArray[np.int64]  # [K] flat
    step: NDArray[np.float64]  # [K, 3] x and y in m and time in s of each move
    resolution: float
    x0: float  # m, centre of cell (0, 0)
    y0: float
    radius: float  # m
    speed: float  # m/s
    goal: int  # flat cell


@bare_kernel
def centre(context: PlanningContext, cell: int) -> tuple[float, float]:
    """Return the centre (x, y) of a flat cell, m."""
    cols = context.blocked.shape[1]
    return context.x0 + (cell % cols) * context.resolution, context.y0 + (cell // cols) * context.resolution


@bare_kernel
def clear(context: PlanningContext, ax: float, ay: float, bx: float, by: float) -> bool:
    """Tell whether the robot can go straight from (ax, ay) to (bx, by) without contact with a wall."""
    s = context.resolution
    return not segment_hits_cells(
        context.blocked,
        (ay - context.y0) / s,
        (ax - context.x0) / s,
        (by - context.y0) / s,
        (bx - context.x0) / s,
        context.radius / s,
        True,
    )


@bare_kernel
def can_stay(x: float, y: float, t0: float, t1: float, segments: NDArray[np.float64]) -> bool:
    """Tell whether a robot may stand at (x, y) from t0 to t1 s."""
    for p in range(len(segments)):
        low, high = unsafe_stay(x, y, segments, p)
        if low < t1 - TOUCH and high > t0 + TOUCH:
            return False
    return True
