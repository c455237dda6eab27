"""Suite `synthetic`: environments of 16 x 16 m with bouncing discs that see nothing and never yield."""

from __future__ import annotations

import math

import numpy as np

from antway.arena.suites import Chance, Suite
from antway.grid import Cell, Grid
from antway.world.motions import Bounce, Motion, RandomWalk
from antway.world.policy import RobotSpec
from antway.world.scenario import Scenario
from antway.world.sensor import Sensor
from antway.world.world import Obstacle, World

SIDE = 80  # number of cells on each side of the map
CELL = 0.2  # m; edge of a cell
FAMILIES = ("open", "clutter", "aisles")
DENSITIES = {"low": 0.03, "medium": 0.07, "high": 0.12}  # 1/m^2; number of discs per area
RADII = (0.2, 0.45)  # m; range of the discs' radii
SPEEDS = (0.3, 0.9)  # m/s; range of the discs' speeds
FAST = (0.6, 1.5)  # m/s; range of the discs' speeds in the variant "fast"
FREE_AT_START = 1.0  # m; least distance of obstacles from the robot at the start
ROBOT = RobotSpec(radius=0.3, v_max=1.0, dt=0.1, sensor_range=4.0)


def synthetic() -> Suite:
    """Return the suite: three families of environments, three densities, and three harder variants.

    In "high-turners" half of the discs turn at random every 3 s, in "high-noise" sensed positions have an error of 0.05 m, and
    in "medium-fast" discs move at 0.6-1.5 m/s. The declared bound on the obstacles' speed is the top speed of the family.
    Speeds never grow, and the declared bound on their growth is 0.5 m/s^2. Except for turners, discs turn only at walls: the
    declared bound on changes of velocity elsewhere is 0.1 m/s^2.
    """
    levels = (*DENSITIES, "high-turners", "high-noise", "medium-fast")
    return Suite("synthetic", tuple(f"{family}/{level}" for family in FAMILIES for level in levels), make)


def make(group: str, chance: Chance) -> Scenario:
    """Return a scenario of "family/level"."""
    family, level = group.split("/")
    density, _, variant = level.partition("-")
    speeds = FAST if variant == "fast" else SPEEDS
    grid, start, goal = _place(family, chance)
    (x, y), clearance = grid.centre(start), grid.clearance()
    count = round(DENSITIES[density] * (SIDE * CELL) ** 2)
    obstacles: list[Obstacle] = []
    while len(obstacles) < count:
        radius = chance.between(*RADII)
        cell = chance.integer(0, SIDE), chance.integer(0, SIDE)
        at = grid.centre(cell)
        if clearance[cell] > radius + 0.02 and math.dist(at, (x, y)) > radius + ROBOT.radius + FREE_AT_START:
            turner = variant == "turners" and len(obstacles) % 2 == 1
            speed, heading = chance.between(*speeds), chance.turn()
            motion: Motion = RandomWalk(at, speed, 3.0, heading) if turner else Bounce(at, speed, heading)
            obstacles.append(Obstacle(radius, motion))
    return Scenario(
        World(grid, tuple(obstacles)),
        (x, y),
        grid.centre(goal),
        robot=ROBOT,
        sensor=Sensor(occlusion=False, noise=0.05 if variant == "noise" else 0.0),
        obstacle_speed=speeds[1],
        obstacle_surge=0.5,
        obstacle_swerve=math.inf if variant == "turners" else 0.1,
        name=f"synthetic {group}",
    )


def _place(family: str, chance: Chance) -> tuple[Grid, Cell, Cell]:
    """Return a map and two ends at opposite sides of it where the robot can stand."""
    while True:
        grid = Grid(_walls(family, chance), CELL)
        inflated = grid.inflate(ROBOT.radius)
        start = chance.integer(3, 10), chance.integer(3, SIDE - 3)
        goal = chance.integer(SIDE - 10, SIDE - 3), chance.integer(3, SIDE - 3)
        if chance.integer(0, 2):
            start, goal = start[::-1], goal[::-1]
        if inflated.is_free(start) and inflated.is_free(goal):
            return grid, start, goal


def _walls(family: str, chance: Chance) -> np.ndarray:
    blocked = np.zeros((SIDE, SIDE), np.bool_)
    if family == "clutter":
        for _ in range(22):
            row, col = chance.integer(5, SIDE - 9), chance.integer(5, SIDE - 9)
            height, width = chance.integer(2, 7), chance.integer(2, 7)
            blocked[row : row + height, col : col + width] = True
    elif family == "aisles":
        for col in range(12, SIDE - 12, 14):
            blocked[8:36, col : col + 4] = True
            blocked[44:72, col : col + 4] = True
    return blocked
