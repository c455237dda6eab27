"""The planning context: the map, the robot's moves on it, and the exact field over these moves."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.geometry import leads_clear
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import Terrain
from antway.kernels.spacetime.segments import TOUCH, unsafe_stay


class PlanningContext(NamedTuple):
    """The map, the robot's moves between nodes on it, and the exact field over these moves.

    The nodes are the centres of the map's cells, of every second or third cell, and so on, or of parts of cells. `cell` and
    `flat cell` stand for a node in these kernels.
    """

    terrain: Terrain
    rows: int  # of nodes
    cols: int
    legal: NDArray[np.uint32]  # [rows * cols] bit k tells whether move k is free of walls
    field: Floats  # [rows * cols] s; time to the goal at full speed over these moves
    offset: Ints  # [K] flat
    step: Floats  # [K, 3] x and y in m and time in s of each move
    resolution: float  # m; distance of neighbouring nodes
    x0: float  # m; node (0, 0)
    y0: float
    radius: float  # m
    speed: float  # m/s
    goal: int  # flat cell


@bare_kernel
def centre(context: PlanningContext, cell: int) -> tuple[float, float]:
    """Return the place (x, y) of a flat cell, m."""
    cols = context.cols
    return context.x0 + (cell % cols) * context.resolution, context.y0 + (cell // cols) * context.resolution


@inner_kernel
def block_around(context: PlanningContext, x: float, y: float, cells: int) -> tuple[int, int, int, int]:
    """Return the rows [first, last) and columns [first, last) up to so many cells from the one nearest to (x, y)."""
    col = math.floor((x - context.x0) / context.resolution + 0.5)
    row = math.floor((y - context.y0) / context.resolution + 0.5)
    return max(row - cells, 0), min(row + cells + 1, context.rows), max(col - cells, 0), min(col + cells + 1, context.cols)


@bare_kernel
def clear(context: PlanningContext, ax: float, ay: float, bx: float, by: float) -> bool:
    """Tell whether the robot can go straight from (ax, ay) to (bx, by), or out of a wall, without contact with another wall.

    A path may begin in a wall, because the robot's place is wrong, or because the robot is nearer to it than paths keep.
    """
    return leads_clear(context.terrain, ax, ay, bx, by, context.radius)


@bare_kernel
def can_stay(x: float, y: float, t0: float, t1: float, segments: Floats) -> bool:
    """Tell whether a robot may stand at (x, y) from t0 to t1 s."""
    for p in range(len(segments)):
        low, high = unsafe_stay(x, y, segments, p)
        if low < t1 - TOUCH and high > t0 + TOUCH:
            return False
    return True


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
