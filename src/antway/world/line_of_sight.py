"""Where a robot can stand among the walls of its map, and what it can reach in a straight line."""

from __future__ import annotations

import math

import numpy as np

from antway.errors import CellBlocked, OutOfBounds
from antway.grid import Cell, Grid
from antway.kernels.base.geometry import segment_hits_cells
from antway.kernels.robot.brake import DEEPEST
from antway.world.policy import XY, Task


def passes(grid: Grid, a: XY, b: XY, radius: float) -> bool:
    """Tell whether a disc of `radius` m can move straight from `a` to `b` without touching a wall."""
    (ar, ac), (br, bc) = grid.to_points((a, b)).tolist()
    return not segment_hits_cells(grid.blocked, ar, ac, br, bc, radius / grid.resolution, True)


def clear(task: Task, a: XY, b: XY) -> bool:
    """Tell whether the robot can drive straight from `a` to `b` without touching a wall."""
    return passes(task.grid, a, b, task.robot.radius)


def check_clear(task: Task, name: str, xy: XY) -> None:
    """Raise `CellBlocked`, which names `name`, if the robot touches a wall or an edge of the map at `xy`."""
    if not clear(task, xy, xy):
        allowed = f"at least the robot's radius, {task.robot.radius:g} m, from walls and the map's edges"
        raise CellBlocked(name, xy, f"{allowed}; the nearest is {_gap_to_wall(task.grid, xy):.3g} m away")


def _gap_to_wall(grid: Grid, xy: XY) -> float:
    """Return the distance of a place from the nearest blocked cell or edge of the map, m; 0 in one or off the map."""
    (row, col), (rows, cols) = grid.to_points(xy)[0].tolist(), grid.shape
    edges = min(row, col, rows - 1 - row, cols - 1 - col) + 0.5
    away = np.maximum(np.abs(np.argwhere(grid.blocked) - (row, col)) - 0.5, 0.0)
    return max(min(float(edges), float(np.hypot(*away.T).min(initial=math.inf))), 0.0) * grid.resolution


def nearest_free(grid: Grid, inflated: Grid, xy: XY, cells: int, radius: float) -> Cell | None:
    """Return the cell from which a path from `xy` starts, None if there is none.

    It is the nearest free cell of `inflated` at most `cells` rows and columns from that of `xy` to whose centre a disc of
    `radius` m can move straight among the walls of `grid`.
    """
    try:
        row, col = inflated.cell_at(xy)
    except OutOfBounds:
        return None
    span = range(-cells, cells + 1)
    free = [(row + i, col + j) for i in span for j in span if inflated.is_free((row + i, col + j))]
    free.sort(key=lambda cell: (math.dist(inflated.centre(cell), xy), cell))
    return next((cell for cell in free if passes(grid, xy, inflated.centre(cell), radius)), None)


def start_cell(grid: Grid, inflated: Grid, xy: XY, cells: int, radius: float) -> Cell | None:
    """Do as `nearest_free` for a place that may be in a wall by up to a share of `radius`, because it or the map is wrong."""
    found = nearest_free(grid, inflated, xy, cells, radius)
    return nearest_free(grid, inflated, xy, cells, (1.0 - DEEPEST) * radius) if found is None else found


def diagonal_radius(task: Task) -> float:
    """Return the radius of the inflation that lets the robot's disc make every move between neighbouring free cells, m.

    On cells that are narrower than the disc, a diagonal move comes nearer to a corner by at most half its length.
    """
    radius, size = task.robot.radius, task.grid.resolution
    return radius if size >= 2 * radius else math.hypot(radius, size / math.sqrt(2))


def goal_of_cells(task: Task) -> XY:
    """Return the end of a path over cells: the goal, or the nearest cell centre if the robot cannot be at that of the goal's.

    From that centre the goal can be reached in a straight line. If there is none, it is the goal.
    """
    centre = task.grid.centre(task.grid.cell_at(task.goal))
    if clear(task, centre, centre):
        return task.goal
    inflated = task.grid.inflate(task.robot.radius)
    cell = nearest_free(task.grid, inflated, task.goal, 2, task.robot.radius)
    return task.goal if cell is None else inflated.centre(cell)
