"""Loads the kernels of control cycles before a robot drives: to read them from disk takes longer than a control period."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from antway.grid import Grid
from antway.kernels.base.cache import is_compiled
from antway.kernels.base.jit import PLAIN
from antway.kernels.base.records import RobotState
from antway.kernels.robot.motion import delayed
from antway.kernels.robot.odometry import COLUMNS, T
from antway.kernels.robot.response import Period
from antway.policies.antway.odometry import OdometryCheck
from antway.world.policy import XY, Observation, Policy, Task, Tracks
from antway.world.robots import RobotSpec

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
    policy = make(**options)
    policy.reset(Task(Grid(np.zeros((40, 60), bool), 0.1), kind, (1.0, 2.0), (5.0, 2.0)), 0)
    state, commands = RobotState(1.0, 2.0, 0.0, 0.0, 0.0), [(0.0, 0.0)] * kind.late_commands
    for n in range(_CYCLES):
        observation = _observed(kind, state, n * kind.dt, commands[n:])
        commands.append(policy.act(observation).acts(observation, kind))
        policy.explain()
        state = _driven(kind, state, commands[n])
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


def _observed(robot: RobotSpec, state: RobotState, t: float, pending: list[XY]) -> Observation:
    """Return what the robot observes in the hall at `t` s, when somebody is about to cross its path."""
    x, y, heading, one, two = state
    velocity, turn_rate = (one, two), 0.0
    if robot.wheels:
        velocity, turn_rate = (one * math.cos(heading), one * math.sin(heading)), two
    crossing = Tracks(np.array([1]), np.array([(3.0, 1.0 + t)]), np.array([(0.0, 1.0)]), np.array([0.25]))
    waiting = np.array(pending).reshape(-1, 2)
    return Observation(t, (x, y), velocity, heading, crossing, turn_rate=turn_rate, pending=waiting)


def _driven(robot: RobotSpec, state: RobotState, command: XY) -> RobotState:
    """Return the state after a period of this command: a policy would learn from a robot that does not do as it says."""
    if not robot.stepwise:
        return delayed(state, np.array([command]), robot.limits._replace(latency=robot.dt), robot.dt)
    if robot.wheels:  # of the dynamics "steps", from which nothing is learnt
        return state
    vx, vy = command
    return RobotState(state.x + vx * robot.dt, state.y + vy * robot.dt, math.atan2(vy, vx), vx, vy)
