"""What a colony in space and time is given: the static side of a task, an empty memory, pheromone."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.grid import Grid, Moves
from antway.kernels.spacetime.context import PlanningContext
from antway.kernels.spacetime.memory import HEAP, LEGS, NEAR, SEGMENTS, STATES, Memory
from antway.kernels.spacetime.pheromone import TRAILS, Trails
from antway.search.sipp import timed_field, timed_moves
from antway.world.policy import RobotSpec


def make_memory(cells: int, states: int = STATES, heap: int = HEAP) -> Memory:
    """Return an empty memory for a map of so many cells."""

    def ints(n: int) -> NDArray[np.int32]:
        return np.zeros(n, np.int32)

    return Memory(
        stamp=ints(cells),
        first=ints(cells),
        intervals=ints(cells),
        latest=np.zeros(cells),
        near=np.zeros((cells + 1, 2), np.int32),
        near_segment=ints(NEAR),
        near_time=np.zeros((NEAR, 2)),
        box=np.zeros((SEGMENTS, 4)),
        cell=ints(states),
        low=np.zeros(states),
        high=np.zeros(states),
        arrival=np.zeros(states),
        depart=np.zeros(states),
        parent=ints(states),
        tried=np.zeros(states, np.uint64),
        key=np.zeros(states),
        heap_key=np.zeros(heap),
        heap_state=ints(heap),
        leg_cell=np.zeros(LEGS, np.int64),
        leg_time=np.zeros(LEGS),
        span=np.zeros((2, SEGMENTS)),
        counter=np.zeros(6, np.int64),
    )


def make_trails(cells: int, bin: float = 0.5) -> Trails:
    """Return an empty table of pheromone for a map of so many cells and bins of arrival of `bin` s."""
    return Trails(np.full(TRAILS, -1, np.int64), np.zeros(TRAILS, np.float32), np.zeros(cells, np.bool_), bin)


def make_context(grid: Grid, robot: RobotSpec, goal: tuple[int, int], moves: Moves = Moves.THIRTY_TWO) -> PlanningContext:
    """Return the static side of a task: the moves that `robot` can make on `grid`, and the exact field to `goal` over them."""
    (x, y, _), size, cols = grid.origin, grid.resolution, grid.shape[1]
    mask = timed_moves(grid, robot.radius, moves)
    field = timed_field(mask, moves, goal, scale=size / robot.v_max)
    offsets = moves.offsets.astype(np.int64)
    return PlanningContext(
        blocked=grid.blocked,
        legal=mask.ravel(),
        field=field.ravel(),
        offset=offsets[:, 0] * cols + offsets[:, 1],
        step=np.column_stack((offsets[:, 1] * size, offsets[:, 0] * size, moves.lengths * (size / robot.v_max))),
        resolution=size,
        x0=x + size / 2,
        y0=y + size / 2,
        radius=robot.radius,
        speed=robot.v_max,
        goal=goal[0] * cols + goal[1],
    )
