"""Setting out: policies that drive to goals, what they are shown, and whether goals are on the same path; no ROS import."""

from __future__ import annotations

import math
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadInput, BadParameter, CellBlocked, OutOfBounds
from antway.grid import Grid
from antway.policies.antway.beside import Beside
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.guard import at_scan
from antway.processes import spare_collections
from antway.ros2 import frames
from antway.ros2.frames import Odometry, Pose
from antway.ros2.goals import Goal
from antway.ros2.path import around, corridor, keeps_near
from antway.ros2.settings import Settings
from antway.world.policy import XY, Observation, Task, Tracks


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
        given.cell_at(goal.xy)
    except BadInput as wrong:
        return wrong.at("", "goal")
    if goal.path is not None:
        grid = corridor(grid, np.vstack((here, frames.move(into, goal.path))), settings.corridor + settings.robot.radius)
    policy = AntwayPolicy(**settings.policy)
    try:
        policy.reset(Task(grid, settings.robot, here, frames.move_point(into, goal.xy), **settings.task), 0)
    except (CellBlocked, OutOfBounds) as wrong:
        if wrong.field != "goal":
            raise
        return type(wrong)("goal", goal.xy, wrong.allowed)  # in the map's frame
    if grid is not level[0]:
        policy.set_surroundings(level[0])
    spare_collections()
    return policy


def sensed_part(settings: Settings, level: tuple[Grid, Pose], xy: XY) -> Grid | None:
    """Return the part of the map that a robot at `xy` m senses; None if it is not on the map. `level` is as in `set_out`."""
    return around(level[0], frames.move_point(frames.inverse(level[1]), xy), settings.robot.sensor_range)


def observed(
    frame: Pose, odometry: Odometry, scan: tuple[float, Tracks], sent: NDArray[np.float64], start: float = 0.0
) -> Observation:
    """Return what is observed in a policy's frame at the time of odometry or, if later, of the scan, from `start` s on.

    `sent`, float64[N, 2], are the commands that do not act yet.
    """
    into = frames.inverse(frame)
    t, xy, velocity, heading, turn_rate = frames.move_odometry(into, odometry)
    tracks, stamp = frames.move_tracks(into, scan[1]), scan[0] - start
    seen = Observation(t - start, xy, velocity, heading, tracks, stamp, turn_rate, sent if len(sent) else None)
    return at_scan(seen) if stamp > seen.t else seen


class Planned(NamedTuple):
    """A policy that was started for a map and a goal."""

    policy: AntwayPolicy
    grid: Grid
    goal: Goal


class _Making(NamedTuple):
    """A policy that is being started for a map, whose frame it uses, and a goal; None: it is not wanted any more."""

    grid: Grid
    frame: Pose
    goal: Goal | None
    work: Beside[AntwayPolicy | BadInput]


class Outset:
    """Starts policies, beside the control loop where the robot drives or the map is large, one after another."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.making: _Making | None = None

    def forget(self) -> None:
        """Forget the goal of the policy that is being started, because it was dropped."""
        self.making = None if self.making is None else self.making._replace(goal=None)

    def plan(self, grid: Grid, level: tuple[Grid, Pose], goal: Goal, xy: XY, drives: bool) -> Planned | BadInput | None:
        """Return a started policy, why the goal is refused, or None as long as none is ready.

        Goals and maps may come faster than a policy starts. So one for an earlier goal, or a map of the same frame, is returned
        too, and the next one is started after it. One for a goal that was dropped is not returned, but waited for. The robot is
        at `xy` m and `drives`, or not; the other parameters are those of `set_out`.
        """
        made, frame = self.making, level[1]
        if made is not None and not made.work.done:
            return None
        if made is None or made.goal is None or made.frame != frame:
            work = partial(set_out, self.settings, grid, level, goal, xy)
            made = self.making = _Making(grid, frame, goal, Beside(grid.blocked.size, 0.0, work, 0 if drives else None))
            if not made.work.done:
                return None
        self.making = None
        current = made.goal is goal and made.grid is grid
        try:
            policy = made.work.result()
        except BadInput:
            if current:
                raise
            return None
        if isinstance(policy, BadInput):
            return policy if current else None
        return Planned(policy, made.grid, made.goal or goal)


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
    except BadParameter:  # a path is too long for any map, which is refused when the robot is to set out
        return False
