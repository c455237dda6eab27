"""Robots whose place lies in a wall on the map, because the map or their localisation is wrong, get out of it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import CellBlocked, Grid, Outcome, Scenario, World, run
from antway.kernels.robot.brake import DEEPEST
from antway.kernels.robot.sweep import Body
from antway.policies.antway.policy import AntwayPolicy
from antway.world.policy import Command, Decision, Observation, Task
from antway.world.robots import load_robot
from antway.world.terrain import body_of

WALL = 1.0  # m; everything below this y is blocked
GAP = 0.001  # m; the robot's disc really stands so far from the wall at first
ROBOTS = ("holonomic", "inertia", "diff", "jackal", "amr")


class Misplaced:
    """A policy whose robot and goal are taken to be so many metres nearer to the wall than they are."""

    def __init__(self, policy: AntwayPolicy, nearer: float, from_start: bool) -> None:
        self.policy, self.nearer, self.from_start = policy, nearer, from_start

    def reset(self, task: Task, seed: int) -> None:
        """Begin; the task's start is wrong as well, or not."""
        (x, y), (to_x, to_y) = task.start, task.goal
        task = replace(task, goal=(to_x, to_y - self.nearer))
        self.policy.reset(replace(task, start=(x, y - self.nearer)) if self.from_start else task, seed)

    def act(self, observation: Observation) -> Command:
        """Return the policy's command."""
        x, y = observation.xy
        return self.policy.act(replace(observation, xy=(x, y - self.nearer)))

    def explain(self) -> Decision:
        """Return the policy's decision."""
        return self.policy.explain()


def _beside_wall(robot: str) -> Scenario:
    blocked = np.zeros((60, 90), dtype=bool)
    blocked[: round(WALL / 0.1)] = True
    spec = load_robot(robot)
    return Scenario(World(Grid(blocked, 0.1), ()), (2.0, WALL + spec.radius + GAP), (7.0, 4.0), spec)


def _deepest(body: Body, xy: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """How deep the body is in the wall at each of the poses, m."""
    side = np.sin(heading)[:, None] * body.corners[:, 0] + np.cos(heading)[:, None] * body.corners[:, 1]
    return WALL - (xy[:, 1] + side.min(axis=1) - body.rounding)


@pytest.mark.parametrize("from_start", [True, False])
@pytest.mark.parametrize("share", [0.05, 0.25])
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_robot_in_a_wall_gets_out_and_no_deeper(robot: str, share: float, from_start: bool) -> None:
    """It arrives, whether its place was in the wall when the task was given or only then; it used to stand for good."""
    scenario = _beside_wall(robot)
    radius, body = scenario.robot.radius, body_of(scenario.robot)
    (x, y), (to_x, to_y) = scenario.start, scenario.goal
    apart = -_deepest(body, np.array([[x, y]]), np.array([math.atan2(to_y - y, to_x - x)]))[0]
    nearer = float(apart) + share * radius
    result = run(scenario, Misplaced(AntwayPolicy(), nearer, from_start), seed=1)
    assert result.outcome is Outcome.REACHED and result.time < 12.0
    assert result.trace is not None
    depth = _deepest(body, result.trace.xy - (0.0, nearer), result.trace.heading)
    assert depth[0] == pytest.approx(share * radius) and depth.max() < depth[0] + 2e-3


@pytest.mark.parametrize("robot", ["holonomic", "diff"])
def test_a_place_too_deep_in_a_wall_is_refused(robot: str) -> None:
    """A start is refused from `DEEPEST` of the radius on, and a goal as soon as the robot touches the wall there."""
    task = _beside_wall(robot).task
    policy, (x, _), radius = AntwayPolicy(), task.start, task.robot.radius
    policy.reset(replace(task, start=(x, WALL + (1.0 - DEEPEST) * radius + 0.001)), 0)
    with pytest.raises(CellBlocked, match="start"):
        policy.reset(replace(task, start=(x, WALL + (1.0 - DEEPEST) * radius - 0.001)), 0)
    with pytest.raises(CellBlocked, match="goal"):
        policy.reset(replace(task, goal=(7.0, WALL + 0.97 * radius)), 0)
