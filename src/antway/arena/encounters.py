"""Suite `encounters`: single encounters at which robots fail, in rooms and corridors with cells of 0.2 m."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from antway.arena.suites import Chance, Suite
from antway.grid import Grid
from antway.kernels.robot.motions import first_inside
from antway.planning import Status
from antway.search.sipp import sipp
from antway.world.motions import Line, Motion, Pursue, Waypoints
from antway.world.policy import XY, RobotSpec
from antway.world.scenario import Scenario
from antway.world.sensor import Sensor
from antway.world.world import Obstacle, World

CELL = 0.2  # m; edge of a cell
START, GOAL = (1.1, 6.1), (11.1, 6.1)  # m; start and goal of the pursuit
ROBOT = RobotSpec(radius=0.3, v_max=1.0, dt=0.1, sensor_range=5.0)


def encounters() -> Suite:
    """Return the suite.

    head-on: a disc comes from the opposite direction in a corridor of 2.4 m. doorway: a disc comes through the robot's door.
    overtaking: a slow disc goes ahead in a corridor. ambush: a hidden disc comes out of a side corridor. flow: a stream of
    people crosses. crowd: many stand about, with a path between them. pursuer: a disc runs after the robot and stops before it
    touches it; as its path depends on the robot's, the optimum is unknown.
    """
    return Suite("encounters", tuple(KINDS), lambda group, chance: KINDS[group](chance), default=50)


def head_on(chance: Chance) -> Scenario:
    """A disc comes from the opposite direction."""
    y, meets = chance.between(1.0, 2.0), chance.between(0.3, 0.9)
    return _scenario("head-on", _corridor(), (1.0, 1.5), (15.0, 1.5), [(0.4, Line((15.3, y), (0.8, y), meets))])


def doorway(chance: Chance) -> Scenario:
    """A disc comes through the door of 1.4 m between two rooms."""
    walls = np.zeros((40, 60), np.bool_)
    row = chance.integer(8, 26)
    walls[:row, 29:31] = walls[row + 7 :, 29:31] = True
    middle = (row + 3.5) * CELL
    path = ((10.5, chance.between(1.0, 7.0)), (7.0, middle), (5.0, middle), (1.0, chance.between(1.0, 7.0)))
    comes = Waypoints(path, chance.between(0.4, 0.9), loop=False)
    return _scenario("doorway", walls, (1.5, chance.between(1.0, 7.0)), (10.5, 4.0), [(0.35, comes)])


def overtaking(chance: Chance) -> Scenario:
    """A slow disc goes ahead of the robot."""
    y = chance.between(1.0, 2.0)
    ahead = Line((chance.between(2.4, 4.0), y), (15.3, y), chance.between(0.1, 0.45))
    return _scenario("overtaking", _corridor(), (1.0, 1.5), (14.0, 1.5), [(0.4, ahead)])


def ambush(chance: Chance) -> Scenario:
    """Discs come out of two side corridors into the robot's, hidden by the corners."""
    walls = np.zeros((60, 60), np.bool_)
    walls[:25] = walls[35:] = True
    walls[:, 20:28] = walls[:, 38:46] = False
    walls[0] = walls[-1] = True
    out = []
    for x in (4.8, 8.4):
        up, speed = chance.integer(0, 2), chance.between(0.5, 0.9)
        ends = ((x, 1.0), (x, 11.0)) if up else ((x, 11.0), (x, 1.0))
        out.append((0.35, Line(*ends, speed, max(x - 1.0 - 5.0 / speed + chance.between(-0.5, 1.5), 0.0))))
    return _scenario("ambush", walls, (1.0, 6.0), (11.0, 6.0), out, occlusion=True)


def flow(chance: Chance) -> Scenario:
    """A stream of discs crosses the robot's path on three parallel lines."""
    out = []
    for row in range(3):
        x, speed = 4.0 + 1.6 * row, chance.between(0.5, 0.9)
        ends = ((x, 0.6), (x, 11.4)) if chance.integer(0, 2) else ((x, 11.4), (x, 0.6))
        delay = chance.between(0.0, 2.0)
        for _ in range(5):
            out.append((0.25, Line(*ends, speed, delay)))
            delay += chance.between(2.2, 4.0) / speed
    return _scenario("flow", np.zeros((60, 60), np.bool_), (1.0, 6.0), (11.0, 6.0), out)


def crowd(chance: Chance) -> Scenario:
    """Discs that are not on the map stand far enough apart for the robot to pass between any two."""
    out: list[tuple[float, Line]] = []
    places: list[XY] = [(1.0, 6.0), (11.0, 6.0)]
    while len(out) < 24:
        at = chance.between(0.5, 11.5), chance.between(0.5, 11.5)
        if all(math.dist(at, other) > 0.6 + 2 * ROBOT.radius + 0.1 for other in places):
            places.append(at)
            out.append((0.3, Line(at, at, 0.0)))
    return _scenario("crowd", np.zeros((60, 60), np.bool_), (1.0, 6.0), (11.0, 6.0), out)


def pursuer(chance: Chance) -> Scenario:
    """A disc runs towards the robot, and after it when it evades, for 20 s."""
    while True:
        walls = np.zeros((60, 60), np.bool_)
        for _ in range(8):
            row, col = chance.integer(4, 52), chance.integer(12, 44)
            walls[row : row + 4, col : col + 4] = True
        origin = chance.between(6.0, 10.0), chance.between(3.0, 9.0)
        grid = Grid(walls, CELL)
        free = grid.inflate(ROBOT.radius).is_free(grid.cell_at(origin))
        # The disc may be off the centre of its cell, where a corner can reach it.
        free = free and first_inside(walls, np.zeros(1), grid.to_points([origin]), ROBOT.radius / CELL) == math.inf
        if free and sipp(grid, START, GOAL, radius=ROBOT.radius, v_max=ROBOT.v_max).status is Status.FOUND:
            break
    return _scenario("pursuer", walls, START, GOAL, [(ROBOT.radius, Pursue(origin, chance.between(0.5, 0.9)))])


KINDS: dict[str, Callable[[Chance], Scenario]] = {
    "head-on": head_on,
    "doorway": doorway,
    "overtaking": overtaking,
    "ambush": ambush,
    "flow": flow,
    "crowd": crowd,
    "pursuer": pursuer,
}


def _corridor() -> np.ndarray:
    """Return an empty corridor of 80 x 15 cells whose border rows are walls."""
    walls = np.zeros((15, 80), np.bool_)
    walls[0] = walls[-1] = True
    return walls


def _scenario(
    name: str, walls: np.ndarray, start: XY, goal: XY, obstacles: Sequence[tuple[float, Motion]], *, occlusion: bool = False
) -> Scenario:
    moving = tuple(Obstacle(radius, motion) for radius, motion in obstacles)
    return Scenario(
        World(Grid(walls, CELL), moving),
        start,
        goal,
        robot=ROBOT,
        sensor=Sensor(occlusion=occlusion),
        obstacle_speed=0.9,
        name=f"encounter {name}",
    )
