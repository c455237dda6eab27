"""The static map as the kernels of the robot's room take it."""

from __future__ import annotations

from antway.grid import Grid
from antway.kernels.robot.sweep import Walls

_KEPT, _KEPT_CELLS = 8, 2**21  # grids, and cells of them together
_cache: list[tuple[Grid, Walls]] = []  # of the grids used last; many episodes share one


def walls_of(grid: Grid) -> Walls:
    """Return the record of `grid` for kernels; of the last few grids it is kept, as the distances to walls take a while."""
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
