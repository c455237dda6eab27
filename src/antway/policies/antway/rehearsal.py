"""Loads the kernels of control cycles before a robot drives: to read them from disk takes longer than a control period."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from antway.grid import Grid
from antway.kernels.base.cache import is_compiled
from antway.kernels.base.jit import PLAIN
from antway.kernels.robot.odometry import COLUMNS, T
from antway.kernels.robot.response import Period
from antway.policies.antway.odometry import OdometryCheck
from antway.world.motions import Line
from antway.world.policy import Policy
from antway.world.robots import RobotSpec
from antway.world.scenario import Scenario
from antway.world.stage import Stage
from antway.world.world import Obstacle, World

_CYCLES = 3  # cycles are rehearsed; the second compares predictions with what came, and the third learns from that
_SQUARE = ((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2))  # m; a footprint
_done: set[tuple[object, ...]] = set()  # rehearsals of this process


def rehearse(make: Callable[..., Policy], robot: RobotSpec, **options: object) -> None:
    """Drive through a small hall for a few cycles, if this process has not yet driven this kind of robot in this way.

    Where no process has compiled the kernels yet, there is nothing to load: the episode compiles only what it needs. `make`
    makes a policy from `options`, the arguments on which it depends which kernels the policy calls.
    """
    kind = _kind_of(robot)
    what = (kind, *options.values())
    if PLAIN or what in _done:
        return
    _done.add(what)
    if not is_compiled(*(("", "crossing.cycle") if kind.stepwise else ("controls", "colony.forage"))):
        return
    policy, stage = make(**options), Stage(_hall(kind), 0, _CYCLES * kind.dt)
    policy.reset(stage.task, 0)
    for _ in range(_CYCLES):
        observation = stage.observe()
        stage.drive(*stage.controls(policy.act(observation), observation))
        policy.explain()
    if robot.dynamics != "steps":
        _correct_speeds(kind)


def _correct_speeds(robot: RobotSpec) -> None:
    """Predict the speeds of a robot that measures wrong ones, or no turn rate."""
    check, seen = OdometryCheck(robot), np.zeros((2, COLUMNS))
    check.measured, check.turn_rate, seen[1, T] = False, 0.0, robot.dt
    period = Period(seen[0], seen[1], np.zeros((1, 3)))
    check.correct(period, robot.limits)
    check.turn(period, robot.limits)


def _kind_of(robot: RobotSpec) -> RobotSpec:
    """Return a plain robot that is driven by the same kernels."""
    return RobotSpec(
        drive=robot.drive,
        a_max=math.inf if robot.stepwise else 1.0,
        turning_radius=0.5 if robot.drive == "ackermann" else 0.0,
        latency=0.1 if robot.latency > 0.0 else 0.0,
        footprint=None if robot.footprint is None else _SQUARE,
        dynamics=robot.dynamics,
    )


def _hall(robot: RobotSpec) -> Scenario:
    """Return a small hall in which somebody is about to cross the robot's path."""
    crossing = Obstacle(0.25, Line((3.0, 1.0), (3.0, 3.0), 1.0))
    return Scenario(World(Grid(np.zeros((40, 60), bool), 0.1), (crossing,)), (1.0, 2.0), (5.0, 2.0), robot=robot)
