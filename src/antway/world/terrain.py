"""A grid, and the shape of a robot, as kernels take them."""

from __future__ import annotations

import numpy as np

from antway.grid import Grid
from antway.kernels.base.records import Terrain, Walls
from antway.kernels.robot.sweep import Body
from antway.world.robots import RobotSpec

_KEPT, _KEPT_CELLS = 8, 2**21  # grids kept in `_cache`, and the most cells of them together
_cache: list[tuple[Grid, Walls]] = []  # the grids used last; many episodes share one


def terrain_of(grid: Grid) -> Terrain:
    """Return the blocked cells of `grid` and where they lie; its yaw is taken to be 0."""
    return Terrain(grid.blocked, grid.origin[0], grid.origin[1], grid.resolution)


def walls_of(grid: Grid) -> Walls:
    """Return `grid` with the distances to its walls. They take a while to compute, so those of the last few grids are kept."""
    for known, walls in _cache:
        if known is grid:
            return walls
    x0, y0, _ = grid.origin
    walls = Walls(grid.blocked, grid.clearance(), x0, y0, grid.resolution)
    _cache.append((grid, walls))
    del _cache[:-_KEPT]
    while len(_cache) > 1 and sum(known.blocked.size for known, _ in _cache) > _KEPT_CELLS:
        del _cache[0]
    return walls


def body_of(robot: RobotSpec) -> Body:
    """Return the shape of a robot."""
    return Body(robot.corners, robot.rounding, robot.radius, np.zeros((1, 2)))
