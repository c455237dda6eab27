"""Small crowded places for the tests of avoidance."""

from __future__ import annotations

import math

import numpy as np

from antway import Grid, RobotSpec, Scenario, World
from antway.kernels.base.records import Predictions
from antway.kernels.spacetime import ants as spacetime
from antway.policies.antway.nodes import make_context
from antway.policies.antway.state import make_memory, make_trails
from antway.world.motions import Bounce
from antway.world.sensor import Sensor
from antway.world.world import Obstacle

BETAS, SLACK = np.array([100.0, 30.0, 10.0, 100.0]), np.array([9.0, 0.0, 0.05, 0.2])


def local_problem(rng: np.random.Generator):
    """A window of 31 x 31 cells of 0.2 m, 12 % blocked, 3 to 14 discs at 0.2 to 1.0 of the robot's speed; start and goal."""
    while True:
        grid = Grid(rng.random((31, 31)) < 0.12, 0.2)
        free = np.argwhere(grid.clearance() >= 0.09)
        start, goal = (tuple(map(int, cell)) for cell in free[rng.integers(len(free), size=2)])
        robot = RobotSpec(radius=0.09)
        context = make_context(grid, robot, goal)
        field = context.field[start[0] * 31 + start[1]]
        if 2.0 < field < 20.0:
            break
    count = int(rng.integers(3, 15))
    angle, speed = rng.uniform(0.0, 2 * math.pi, count), rng.uniform(0.2, 1.0, count)
    xy, leg_cells = rng.uniform(0.0, 6.2, (count, 2)), rng.uniform(0.2, 0.45, count)
    segments = np.column_stack(
        (np.zeros(count), np.full(count, 20.0), xy, speed * np.cos(angle), speed * np.sin(angle), leg_cells, leg_cells)
    )
    return grid, robot, start, goal, context, segments


def colony(
    context,
    segments,
    x,
    y,
    *,
    leg_cells=0,
    minimum_improvement=0.001,
    expansions=10**6,
    horizon=20.0,
    stopping_time=0.0,
    seed=1,
    states=1 << 16,
    distance_weight=0.0,
    t0=0.0,
    trails=None,
    memory=None,
    limit=math.inf,
):
    """Search a local problem; returns memory, end state, cost, bound."""
    cells = context.field.size
    memory = make_memory(cells, states, 1 << 18) if memory is None else memory
    settings = spacetime.AntSettings(leg_cells, BETAS, SLACK, minimum_improvement, 1.0, distance_weight, 0.0)
    trails = make_trails(cells) if trails is None else trails
    end, arrival, bound = spacetime.search(
        memory, trails, context, Predictions(segments, stopping_time), settings, x, y, t0, horizon,
        limit, expansions, np.array([seed], np.uint64),
    )  # fmt: skip
    return memory, end, arrival, bound


def crowd(seed: int, count: int = 12, speed: tuple[float, float] = (0.3, 0.9), sensor: Sensor | None = None, **scenario):
    """A room of 10 x 10 m with two walls and bouncing discs that never yield."""
    rng = np.random.default_rng(seed)
    blocked = np.zeros((50, 50), dtype=bool)
    blocked[15:18, 10:30] = blocked[32:35, 20:42] = True
    grid = Grid(blocked, 0.2)
    room = grid.clearance()
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        radius, cell = rng.uniform(0.2, 0.35), tuple(map(int, rng.integers(0, 50, 2)))
        x, y = grid.centre(cell)
        if room[cell] > radius and math.hypot(x - 1.1, y - 1.1) > 2.0:
            heading = float(rng.uniform(-math.pi, math.pi))
            obstacles.append(Obstacle(radius, Bounce((x, y), float(rng.uniform(*speed)), heading)))
    settings = {"obstacle_speed": speed[1], "obstacle_surge": 0.5, "sensor": sensor or Sensor(occlusion=False), **scenario}
    return Scenario(World(grid, tuple(obstacles)), (1.1, 1.1), (8.9, 8.9), **settings)
