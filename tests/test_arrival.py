"""Robots with inertia after they have reached the goal, and while they wait."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, Scenario, World
from antway.policies.antway.policy import AntwayPolicy
from antway.world.motions import Replay
from antway.world.robots import load_robot
from antway.world.stage import Stage
from antway.world.trace import Outcome
from antway.world.world import Obstacle

WHEELS = ("diff", "jackal", "amr")


def _played(scenario: Scenario, seconds: float, stay: float = 0.0) -> Stage:
    """Play on behind the goal for so many seconds; nothing is touched."""
    stage, policy = Stage(scenario, 1, seconds), AntwayPolicy()
    stage.end_at_goal(False)
    policy.reset(replace(stage.task, stay=stay), 1)
    outcome = None
    while outcome is None:
        seen = stage.observe()
        outcome, reason = stage.drive(*stage.controls(policy.act(seen), seen))
    assert outcome is Outcome.TIMEOUT, reason
    return stage


def _hall(robot: str, *standing: tuple[float, float]) -> Scenario:
    obstacles = tuple(Obstacle(0.25, Replay((0.0, 100.0), (place, place))) for place in standing)
    world = World(Grid(np.zeros((40, 80), bool), 0.1), obstacles)
    return Scenario(world, (1.5, 2.0), (5.0, 2.0), load_robot(robot))


@pytest.mark.parametrize("stay", [0.0, 5.0])
@pytest.mark.parametrize("robot", [*WHEELS, "inertia"])
def test_a_robot_comes_to_rest_at_the_goal(robot: str, stay: float) -> None:
    """It ends within the tolerance, and if it is to stay there, it does not leave it any more."""
    stage = _played(_hall(robot), 12.0, stay)
    away = np.hypot(*(stage.xy - stage.task.goal).T)
    assert not stage.velocity[-20:].any() and not stage.turn_rate[-20:].any()
    assert away[-1] <= stage.task.goal_tolerance
    first = int((away <= stage.task.goal_tolerance).argmax())
    assert (away[first:].max() <= stage.task.goal_tolerance) == (stay > 0.0)


@pytest.mark.parametrize("stay", [0.0, 1.0])
@pytest.mark.parametrize("robot", [*WHEELS, "inertia"])
def test_a_robot_at_the_goal_lets_pass_who_does_not_look(robot: str, stay: float) -> None:
    """Somebody walks straight over the goal, later from the other side; the robot gets out of the way, and comes back."""
    hall = _hall(robot)
    walk = Replay((0.0, 9.0, 14.0, 19.0, 24.0), ((7.0, 3.8), (7.0, 3.8), (3.0, 0.2), (3.0, 0.2), (7.0, 3.8)))
    stage = _played(replace(hall, world=World(hall.world.grid, (Obstacle(0.25, walk),))), 30.0, stay)
    away = np.hypot(*(stage.xy - stage.task.goal).T)
    assert away[90] <= stage.task.goal_tolerance < away[90:].max() < 2.5
    assert away[-1] <= stage.task.goal_tolerance and not stage.velocity[-5:].any()


@pytest.mark.parametrize("robot", WHEELS)
def test_a_robot_could_stop_before_who_stands_behind_the_goal(robot: str) -> None:
    """Whoever brakes at the goal, or lets the policy drive on, touches nobody who stands a quarter of a metre behind it."""
    spec = load_robot(robot)
    ahead = spec.radius if spec.footprint is None else max(x for x, _ in spec.footprint)
    stage = _played(_hall(robot, (5.0 + ahead + 0.5, 2.0)), 8.0)
    away = np.hypot(*(stage.xy - stage.task.goal).T)
    assert (away <= stage.task.goal_tolerance).any()


def test_a_robot_that_has_found_no_way_does_not_turn_to_and_fro() -> None:
    """Close to somebody who leaves no gap in a corridor of 0.9 m, it used to turn nearly all the time."""
    blocked = np.ones((13, 120), bool)
    blocked[2:11, 1:119] = False
    world = World(Grid(blocked, 0.1), (Obstacle(0.25, Replay((0.0, 100.0), ((4.0, 0.65), (4.0, 0.65)))),))
    stage = _played(Scenario(world, (3.495, 0.65), (10.0, 0.65), load_robot("turtlebot4")), 16.0)
    assert ((np.hypot(*stage.velocity[80:].T) == 0.0) & (stage.turn_rate[80:] == 0.0)).mean() > 0.8


@pytest.mark.parametrize("robot", ["jackal", "inertia"])
def test_a_robot_that_waits_stands(robot: str) -> None:
    """Before somebody who stands in a corridor it does not drive to and fro, to come with a run when the way is free."""
    blocked = np.ones((24, 120), bool)
    blocked[5:19, 3:117] = False
    world = World(Grid(blocked, 0.1), (Obstacle(0.3, Replay((0.0, 100.0), ((6.0, 1.2), (6.0, 1.2)))),))
    stage = _played(Scenario(world, (1.6, 1.2), (10.0, 1.2), load_robot(robot)), 16.0)
    speed = np.hypot(*stage.velocity[80:].T)
    assert (speed == 0.0).mean() > 0.8 and speed.mean() < 0.05
    assert math.dist(stage.xy[-1], (6.0, 1.2)) < 1.5
