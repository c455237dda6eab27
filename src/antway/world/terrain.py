"""A grid, and the shape of a robot, as kernels take them."""

from __future__ import annotations

import numpy as np

from antway.grid import Grid, kept
from antway.kernels.base.arrays import Bools
from antway.kernels.base.records import BLOCK, Terrain, Walls
from antway.kernels.robot.sweep import Body
from antway.world.robots import RobotSpec


def terrain_of(grid: Grid) -> Terrain:
    """Return the blocked cells of `grid` and where they lie; its yaw is taken to be 0."""
    blocks = kept(grid, "blocks", lambda: _blocks(grid.blocked))
    return Terrain(grid.blocked, blocks, grid.origin[0], grid.origin[1], grid.resolution)


def _blocks(blocked: Bools) -> Bools:
    """Return whether any cell of each block is blocked, as in `Terrain`."""
    (rows, cols), (more_rows, more_cols) = blocked.shape, (-n % BLOCK for n in blocked.shape)
    whole = np.pad(blocked, ((0, more_rows), (0, more_cols)))
    cells = whole.reshape((rows + more_rows) // BLOCK, BLOCK, (cols + more_cols) // BLOCK, BLOCK)
    return np.array(cells.any(axis=(1, 3)))


def walls_of(grid: Grid) -> Walls:
    """Return `grid` with the distances to its walls, which take a while to compute, so that they are kept."""
    clearance = kept(grid, ("clearance", grid.resolution), grid.clearance)
    return Walls(grid.blocked, clearance, grid.origin[0], grid.origin[1], grid.resolution)


def body_of(robot: RobotSpec) -> Body:
    """Return the shape of a robot."""
    return Body(robot.corners, robot.rounding, robot.radius, np.zeros((1, 2)))
