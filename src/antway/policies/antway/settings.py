"""The numbers with which policy antway plans: how wide tubes are, and how the ants in space and time search."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from antway.kernels.crossing import PolicySettings
from antway.kernels.spacetime.ants import AntSettings
from antway.kernels.tracking.predict import TubeMargins
from antway.policies.guard import assumed_accel
from antway.world.policy import Task

if TYPE_CHECKING:
    from antway.policies.antway.policy import AntwayPolicy

_DISCOUNT = 0.3  # 1; a plan keeps this share of a tube's width, because full tubes would close every passage
_MARGIN = 0.005  # m; least distance kept to predicted obstacles
_DRIFT_TIME = 0.2  # s; the margin grows by this times the standard deviation of a track's velocity
_EXTRA_DRIFT_TIME = 1.0  # s; a plan with additional clearance keeps this times that deviation more from 1.5 s ahead on
_INSIDE = 0.95  # 1; a straight path into the tolerance of the goal ends at this share of it
_LEG_NODES = 2  # the first move of a path ends at most this many nodes around the robot
_BETAS = (100.0, 30.0, 10.0, 100.0)  # 1/s; greediness of the ants in turn: three follow the field closely, one explores
_SLACK = (9.0, 0.0, 0.05, 0.2)  # s; each of these ants gives up once its path has become this much longer


def make_settings(policy: AntwayPolicy, task: Task, radius: float) -> PolicySettings:
    """Return the settings of the cycle of kernels/crossing.py for plans of a disc of `radius` m, with the policy's options."""
    robot = task.robot
    controlled = not robot.stepwise  # then the colony in the space of controls keeps the margins
    guarded = policy.guard is not None and not controlled
    stopping = robot.dt + (0.0 if math.isinf(robot.a_max) else robot.stop_time)
    strict = policy.mode == "strict"
    tubes = TubeMargins(
        robot_radius=radius,
        margin=_MARGIN if policy.margin is None else policy.margin,
        quantile=policy.quantile if strict else 0.0 if controlled else policy.quantile * _DISCOUNT,
        speed_bound=float(task.obstacle_speed) if guarded else 0.0,
        acceleration_bound=float(task.obstacle_surge) if guarded else 0.0,
        stopping_time=stopping if guarded else 0.0,
        vector_bound=assumed_accel(task, policy.mode),
        drift_time=0.0 if strict or controlled or policy.margin is not None else _DRIFT_TIME,
    )
    colony = AntSettings(
        leg_cells=_LEG_NODES,
        betas=np.array(_BETAS),
        slack=np.array(_SLACK),
        minimum_improvement=policy.minimum_improvement,
        amount=policy.deposit,
        distance_weight=policy.distance_weight,
        stay=float(task.stay),
    )
    short = np.flatnonzero(np.abs(policy.moves.offsets).max(axis=1) == 1)  # moves to neighbouring nodes
    return PolicySettings(
        dt=robot.dt,
        horizon=policy.horizon,
        stores_predictions=True,
        preferred_speed=float(task.obstacle_speed),
        hysteresis=policy.hysteresis,
        expansions=policy.expansions,
        improvement_expansions=policy.improvement_expansions,
        goal_x=task.goal[0],
        goal_y=task.goal[1],
        arrives_within=0.0 if controlled or task.stay > 0.0 else _INSIDE * task.goal_tolerance,
        tubes=tubes,
        narrow_tubes=TubeMargins(0.0 if strict else radius),
        wide_tubes=tubes._replace(robot_radius=0.0 if strict or controlled else radius, extra_drift_time=_EXTRA_DRIFT_TIME),
        colony=colony,
        few_moves=colony._replace(moves=np.uint64(0 if len(short) == len(policy.moves.offsets) else (1 << short).sum())),
    )
