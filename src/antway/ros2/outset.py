"""Setting out: the policy that drives to a goal, and whether another goal is on the same path; no ROS import."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from antway.errors import BadInput, BadParameter
from antway.grid import Grid
from antway.planning import standing_cell
from antway.policies.antway.policy import AntwayPolicy
from antway.processes import spare_collections
from antway.ros2 import frames
from antway.ros2.frames import Pose
from antway.ros2.goals import Goal
from antway.ros2.path import corridor, keeps_near
from antway.ros2.settings import Settings
from antway.world.policy import XY, Task


@lru_cache(maxsize=1)
def inflated(grid: Grid, radius: float) -> Grid:
    """Return `grid` inflated by `radius` m; the newest one is kept, and any thread may ask for it."""
    return grid.inflate(radius)


def set_out(settings: Settings, given: Grid, level: tuple[Grid, Pose], goal: Goal, xy: XY) -> AntwayPolicy | BadInput:
    """Return a newly started policy for a robot at `xy` on the map `given`, or why the goal is refused.

    `level` is what `frames.level` returns for the map. The policy's map is that of the goal's corridor, if it has one.
    """
    grid, frame = level
    into = frames.inverse(frame)
    here = frames.move_point(into, xy)
    try:
        standing_cell("goal", goal.xy, given, inflated(given, settings.robot.radius), settings.robot.radius)
    except BadInput as wrong:
        return wrong
    if goal.path is not None:
        grid = corridor(grid, np.vstack((here, frames.move(into, goal.path))), settings.corridor + settings.robot.radius)
    policy = AntwayPolicy(**settings.policy)
    policy.reset(Task(grid, settings.robot, here, frames.move_point(into, goal.xy), **settings.task), 0)
    if grid is not level[0]:
        policy.set_surroundings(level[0])
    spare_collections()
    return policy


def same_path(before: Goal, goal: Goal, level: tuple[Grid, Pose], width: float) -> bool:
    """Tell whether `goal` is the one before, without a path or with one in the inner half of a corridor of this width, m."""
    if before.path is None or goal.path is None:
        return before.path is goal.path and before == goal
    grid, frame = level
    if math.dist(before.xy, goal.xy) > grid.resolution:
        return False
    path, other = (frames.move(frames.inverse(frame), path) for path in (before.path, goal.path))
    try:
        return keeps_near(grid, path, other, width / 2)
    except BadParameter:  # the path before is too long for any map, which is refused when the robot is to set out
        return False
