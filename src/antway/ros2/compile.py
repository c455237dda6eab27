"""Compiles what a node needs before it drives, by small tasks; no ROS import."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from antway.grid import Grid
from antway.kernels.base.geometry import wrap
from antway.kernels.base.jit import call
from antway.kernels.tracking import kalman
from antway.planning import PLANNERS, Problem, solve
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.guard import Guard
from antway.ros2.scan import ScanTracker, without_ids
from antway.ros2.settings import Settings
from antway.tours.plan import plan_tour
from antway.world.episode import run
from antway.world.motions import Bounce
from antway.world.policy import Command, Observation, RobotSpec, Tracks
from antway.world.scenario import Scenario
from antway.world.world import Obstacle, World


def compile_for(settings: Settings) -> None:
    """Compile the kernels that plan and drive with these settings."""
    _plan()
    robot, mode = settings.robot, settings.policy["mode"]
    _drive(robot, AntwayPolicy, mode)
    if robot.dynamics == "ramps":  # many a robot has more inertia and latency than was declared, and measures no speeds
        robot = replace(robot, a_max=min(robot.a_max, 1.0), latency=max(robot.latency, robot.dt))
        _drive(robot, _Unmeasured, mode)


class _Unmeasured(AntwayPolicy):
    """The policy on a robot whose odometry reports speeds of 0."""

    def act(self, observation: Observation) -> Command:
        return super().act(replace(observation, velocity=(0.0, 0.0), turn_rate=0.0))


@cache
def _plan() -> None:
    """Plan by every planner, because compute_path_to_pose names one, and two tours; and follow tracks from laser scans."""
    place = Grid(np.zeros((8, 8), bool))
    for planner in PLANNERS:
        solve(Problem(place, (0, 0), (7, 7)), planner, time_limit=0.1)
    for stops in (3, 16):  # which different methods put in order
        plan_tour(place, (1.5, 1.5), [(0.5 + 2.0 * (i % 4), 0.5 + 2.0 * (i // 4)) for i in range(stops)], seconds=0.05)
    tracker = ScanTracker()
    tracker.update(0.0, without_ids(np.zeros((1, 2)), np.ones(1)))
    call(kalman.raise_variances, *tracker.table[:2], np.zeros(2), np.zeros(2))  # when a sensor turns out to be wrong


@cache
def _drive(robot: RobotSpec, policy: type[AntwayPolicy], mode: str) -> None:
    """Drive through a hall with a wall, among discs that come from all sides, one of them from where it is hard to avoid."""
    radius = robot.radius
    blocked = np.zeros((24, 24), bool)
    blocked[:8, 12] = True
    discs = [(9.0, 12.0, math.pi), (12.0, 18.0, -1.5), (8.0, 20.0, -2.0), (15.0, 11.0, 2.5)]  # places in radii, directions
    moving = tuple(Obstacle(radius, Bounce((x * radius, y * radius), robot.v_max, turn)) for x, y, turn in discs)
    start, goal = (4.0 * radius, 12.0 * radius), (20.0 * radius, 12.0 * radius)
    hall = Scenario(World(Grid(blocked, radius), moving), start, goal, robot=robot, horizon=min(60.0 * robot.dt, 60.0))
    run(hall, policy(mode=mode))
    guard = Guard(mode=mode)
    guard.reset(hall.task)
    guard.limit(Observation(0.0, hall.start, (0.0, 0.0), 0.0, Tracks.none()), None)  # the stop
    wrap(0.0)  # for the yaws of messages
