"""A grid as kernels take it."""

from __future__ import annotations

from antway.grid import Grid
from antway.kernels.base.records import Terrain


def terrain_of(grid: Grid) -> Terrain:
    """Return the blocked cells of `grid` and where they lie; its yaw is taken to be 0."""
    return Terrain(grid.blocked, grid.origin[0], grid.origin[1], grid.resolution)
