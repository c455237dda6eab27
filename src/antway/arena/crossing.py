"""Suite `crossing`: circle and square of CrowdNav, with humans that are steered by ORCA and do not see the robot.

Chen, Liu, Kreiss, Alahi: Crowd-robot interaction, ICRA 2019; ORCA: van den Berg, Guy, Lin, Manocha, ISRR 2011 (RVO2).
"""

from __future__ import annotations

import math

import numpy as np

from antway.arena.suites import Chance, Suite
from antway.errors import BadParameter
from antway.grid import Grid
from antway.world.motions import Replay
from antway.world.policy import XY, RobotSpec
from antway.world.scenario import Scenario
from antway.world.sensor import Sensor
from antway.world.world import Obstacle, World

HUMANS = 5  # number of humans in an episode
RADIUS = 0.3  # m; radius of the robot and of the humans
SPEED = 1.0  # m/s; top speed of the robot and of the humans
STEP = 0.25  # s; period at which the robot and the humans choose a velocity
LIMIT = 25.0  # s; horizon of an episode
CIRCLE = 4.0  # m; radius of the circle on which the humans start in group "circle"
NOISE = 1.0  # m; width of the noise of these starts along each axis
SQUARE = 10.0  # m; side of the square in which the humans start in group "square"
APART = 0.2  # m; least gap between two starts, and between two goals
LATE = 1e-6  # s; delay of the humans relative to the robot
START, GOAL = (0.0, -4.0), (0.0, 4.0)  # m; of the robot; both are cell centres
SIDE = 81  # number of cells on each side of the empty map
CELL = 0.2  # m; edge of a cell
ROBOT = RobotSpec(radius=RADIUS, v_max=SPEED, dt=STEP, sensor_range=math.inf)

Walk = tuple[XY, XY]  # start and goal


def crossing() -> Suite:
    """Return the suite.

    The robot drives from (0, -4) to (0, 4) at 1 m/s among five humans, all of radius 0.3 m, in steps of 0.25 s for up to 25 s,
    with a goal tolerance of 0.3 m. As the humans do not see it, their paths are computed beforehand; within a step they walk
    straight. Their speed is limited to 1 m/s, their acceleration is not.
    """
    return Suite("crossing", ("circle", "square"), make, default=500)


def make(group: str, chance: Chance) -> Scenario:
    """Return a scenario of the "circle" or the "square"."""
    walks: list[Walk] = [(START, GOAL)]
    while len(walks) <= HUMANS:
        walk = _circle(chance) if group == "circle" else _square(chance)
        if all(_apart(walk, other, group) for other in walks):
            walks.append(walk)
    # At the time of a step the sensor must see the previous velocities, not those that the humans choose at that moment.
    t = tuple(STEP * k + LATE for k in range(round(LIMIT / STEP) + 1))
    humans = tuple(Obstacle(RADIUS, Replay(t, tuple(track))) for track in orca_tracks(walks[1:], len(t) - 1))
    edge = -(SIDE * CELL) / 2
    return Scenario(
        World(Grid(np.zeros((SIDE, SIDE), np.bool_), CELL, (edge, edge, 0.0)), humans),
        START,
        GOAL,
        robot=ROBOT,
        sensor=Sensor(occlusion=False),
        horizon=LIMIT,
        goal_tolerance=RADIUS,
        obstacle_speed=SPEED,
        name=f"crossing {group}",
    )


def _circle(chance: Chance) -> Walk:
    angle = chance.between(0.0, 2 * math.pi)
    x = CIRCLE * math.cos(angle) + chance.between(-0.5, 0.5) * NOISE
    y = CIRCLE * math.sin(angle) + chance.between(-0.5, 0.5) * NOISE
    return (x, y), (-x, -y)


def _square(chance: Chance) -> Walk:
    side = 1.0 if chance.integer(0, 2) else -1.0
    half = SQUARE / 2
    start = chance.between(0.0, half) * side, chance.between(-half, half)
    return start, (chance.between(0.0, half) * -side, chance.between(-half, half))


def _apart(walk: Walk, other: Walk, group: str) -> bool:
    """Tell whether start and goal are far enough from those of another; in the circle each start from both ends."""
    least = 2 * RADIUS + APART
    pairs = [(walk[0], other[0]), (walk[0], other[1])] if group == "circle" else list(zip(walk, other))
    return all(math.dist(a, b) >= least for a, b in pairs)


def orca_tracks(walks: list[Walk], steps: int) -> list[list[XY]]:
    """Return the places after each of `steps` steps of humans who walk to their goals and avoid one another by ORCA.

    Each human has an own RVO2 simulation, with that human as the first agent and the others, in order, without goals:
    neighbour distance 10 m, 10 neighbours, both horizons 5 s, radius + 0.01 m, at most 1 m/s. The preferred velocity points to
    the goal, with 1 m/s or, within the last metre, the remaining distance per second.
    """
    try:
        from pyrvo import RVOSimulator
    except ImportError:
        raise BadParameter("suite", "crossing", "another suite, or install pyrvo (the extra `arena`)") from None
    count = len(walks)
    common = (10.0, 10, 5.0, 5.0, RADIUS + 0.01, SPEED)
    xy = [start for start, _ in walks]
    velocity: list[XY] = [(0.0, 0.0)] * count
    minds = []
    orders = [[k, *(j for j in range(count) if j != k)] for k in range(count)]
    for order in orders:
        mind = RVOSimulator(STEP, *common)
        for j in order:
            mind.add_agent(xy[j], *common, velocity[j])
        minds.append(mind)
    tracks = [[place] for place in xy]
    for _ in range(steps):
        chosen: list[XY] = []
        for k, mind in enumerate(minds):
            for i, j in enumerate(orders[k]):
                mind.set_agent_position(i, xy[j])
                mind.set_agent_velocity(i, velocity[j])
                mind.set_agent_pref_velocity(i, (0.0, 0.0))
            preferred = walks[k][1][0] - xy[k][0], walks[k][1][1] - xy[k][1]
            path = max(math.hypot(*preferred), 1.0)
            mind.set_agent_pref_velocity(0, (preferred[0] / path, preferred[1] / path))
            mind.do_step()
            found = mind.get_agent_velocity(0)
            chosen.append((found.x, found.y))
        velocity = chosen
        for k, (vx, vy) in enumerate(velocity):
            xy[k] = xy[k][0] + vx * STEP, xy[k][1] + vy * STEP
            tracks[k].append(xy[k])
    return tracks
