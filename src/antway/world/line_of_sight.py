"""What a robot can reach in a straight line among the walls of its map."""

from __future__ import annotations

import math

from antway.errors import OutOfBounds
from antway.grid import Cell, Grid
from antway.kernels.base.geometry import segment_hits_cells
from antway.world.policy import XY, Task


def clear(task: Task, a: XY, b: XY, radius: float | None = None) -> bool:
    """Tell whether the robot, or a disc of another `radius` in m, can drive straight from `a` to `b` among the map's walls."""
    (ar, ac), (br, bc) = task.grid.to_points((a, b)).tolist()
    radius = task.robot.radius if radius is None else radius
    return not segment_hits_cells(task.grid.blocked, ar, ac, br, bc, radius / task.grid.resolution, True)


def nearest_free(task: Task, inflated: Grid, xy: XY, cells: int, radius: float | None = None) -> Cell | None:
    """Return the cell from which a path from `xy` starts, None if there is none.

    It is free in `inflated`, at most `cells` rows and columns from that of `xy`, its centre is reached in a straight line, and
    of all such it is the nearest. With `radius` (m) for a disc of that radius in place of the robot.
    """
    try:
        row, col = inflated.cell_at(xy)
    except OutOfBounds:
        return None
    span = range(-cells, cells + 1)
    free = [(row + i, col + j) for i in span for j in span if inflated.is_free((row + i, col + j))]
    free.sort(key=lambda cell: (math.dist(inflated.centre(cell), xy), cell))
    return next((cell for cell in free if clear(task, xy, inflated.centre(cell), radius)), None)


def goal_of_cells(task: Task) -> XY:
    """Return where a path over cells ends: the goal, or, where its cell's centre has no room, the nearest centre that has.

    From there the goal is reached in a straight line; if there is no such cell, it is the goal.
    """
    centre = task.grid.centre(task.grid.cell_at(task.goal))
    if clear(task, centre, centre):
        return task.goal
    inflated = task.grid.inflate(task.robot.radius)
    cell = nearest_free(task, inflated, task.goal, cells=2)
    return task.goal if cell is None else inflated.centre(cell)
