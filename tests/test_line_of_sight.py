"""Where a robot can stand among walls, and the cells at which paths begin and end, against searches through all cells."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, RobotSpec, Task
from antway.world.line_of_sight import clear, diagonal_radius, goal_of_cells, nearest_free, passes, start_cell
from common import cases

ORIGIN = (-1.0, 2.0, 0.0)


def walled(rng: np.random.Generator, size: float) -> Grid:
    """A map of 9 x 11 cells with a few blocked ones."""
    return Grid(rng.random((9, 11)) < 0.12, size, ORIGIN)


def test_the_nearest_free_cell_is_the_best_of_all() -> None:
    """It is near, free and in sight; of cells as far off the first row counts, and what is off the map has none."""
    rng, found = np.random.default_rng(2), 0
    for _ in range(cases(150, 5000)):
        grid, radius, span = walled(rng, 0.5), float(rng.uniform(0.05, 0.6)), int(rng.integers(0, 4))
        inflated = grid.inflate(radius)
        xy = tuple((np.array(ORIGIN[:2]) + rng.uniform(0.0, 1.0, 2) * (5.5, 4.5)).tolist())
        if rng.random() < 0.3:  # on a corner of four cells, all of which are as far off
            xy = tuple((np.array(ORIGIN[:2]) + 0.5 * rng.integers(1, 9, 2)).tolist())
        at, best = grid.cell_at(xy), []
        for row, col in np.argwhere(~inflated.blocked).tolist():
            if max(abs(row - at[0]), abs(col - at[1])) <= span and passes(grid, xy, grid.centre((row, col)), radius):
                best.append((math.dist(grid.centre((row, col)), xy), (row, col)))
        assert nearest_free(grid, inflated, xy, span, radius) == (min(best)[1] if best else None)
        found += bool(best)
    assert 20 < found < 0.95 * cases(150, 5000)
    assert nearest_free(grid, inflated, (-1.1, 3.0), 3, 0.1) is None


def test_a_start_may_be_in_a_wall_by_less_than_a_third_of_the_radius() -> None:
    blocked = np.zeros((20, 20), np.bool_)
    blocked[:5] = True
    grid = Grid(blocked, 0.2)
    inflated = grid.inflate(0.3)
    for y, cell in ((1.35, (6, 10)), (1.22, (6, 10)), (1.2, None)):  # the wall ends at 1 m; 0.7 of the radius are 0.21 m
        assert (
            start_cell(grid, inflated, (2.1, y), 1, 0.3) == cell and nearest_free(grid, inflated, (2.1, 1.22), 1, 0.3) is None
        )


@pytest.mark.parametrize("radius", [0.1, 0.25, 0.26, 0.4, 0.9])
def test_every_move_between_cells_of_the_inflated_map_is_clear(radius: float) -> None:
    """On cells as wide as the robot diagonal moves need both cells beside them, on narrower ones no more than their ends."""
    rng, moves = np.random.default_rng(7), 0
    for _ in range(cases(4, 500)):
        grid = Grid(rng.random((25, 25)) < 0.03, 0.5, ORIGIN)
        task = Task(grid, RobotSpec(radius=radius), (1.0, 4.0), (5.0, 9.0))
        free = ~grid.inflate(diagonal_radius(task)).blocked
        for row, col in np.argwhere(free).tolist():
            for dr, dc in ((0, 1), (1, 0), (1, 1), (1, -1)):
                to = row + dr, col + dc
                if not (0 <= to[0] < 25 and 0 <= to[1] < 25 and free[to]):
                    continue
                if radius > 0.25 or (free[to[0], col] and free[row, to[1]]):
                    moves += 1
                    assert clear(task, grid.centre((row, col)), grid.centre(to)), (row, col, to)
    assert moves > 200 and diagonal_radius(task) == (radius if radius <= 0.25 else math.hypot(radius, 0.5 / math.sqrt(2.0)))


def test_a_path_over_cells_ends_where_the_robot_can_be() -> None:
    """At the goal, or at the nearest centre from which it can be reached where the robot cannot be at that of its own cell."""
    blocked = np.zeros((20, 20), np.bool_)
    blocked[:, :5] = True
    for goal, end in (((1.9, 2.05), (1.9, 2.05)), ((1.39, 2.05), (1.5, 2.1)), ((1.31, 2.25), (1.5, 2.3))):
        task = Task(Grid(blocked, 0.2), RobotSpec(radius=0.31), (3.0, 3.0), goal)
        assert goal_of_cells(task) == pytest.approx(end)
    blocked[:, 7:] = True
    task = Task(Grid(blocked, 0.2), RobotSpec(radius=0.199), (1.2, 3.0), (1.2, 2.05))
    assert goal_of_cells(task) == (1.2, 2.05), "from the middle of a narrow corridor no centre can be reached"
