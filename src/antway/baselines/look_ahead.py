"""Shared by baselines without a global plan: a target on the global path, and a step that ends before walls."""

from __future__ import annotations

import math

from antway.kernels.base.geometry import wall_ahead
from antway.planning import TimedPath
from antway.world.line_of_sight import clear
from antway.world.policy import XY, Command, Observation, Task
from antway.world.terrain import terrain_of

SHORT = 1e-6  # m; distance to a wall that a step leaves


def look_ahead(task: Task, o: Observation, path: TimedPath, within: float) -> XY:
    """Return the farthest visible node of `path`, at most `within` m along it, or the goal if it is visible.

    `path` leads from the robot to the goal at full speed, and is not empty.
    """
    if clear(task, o.xy, task.goal):
        return task.goal
    until = o.t + within / task.robot.v_max
    nodes = [(float(x), float(y)) for t, (x, y) in zip(path.t, path.xy) if o.t + 1e-9 < t <= until]
    nodes = nodes or [path.at(until)]
    return next((node for node in reversed(nodes) if clear(task, o.xy, node)), nodes[0])


def short_of_walls(task: Task, o: Observation, vx: float, vy: float) -> Command:
    """Return the command (vx, vy) in m/s, limited to full speed, and slowed down before walls."""
    robot = task.robot
    speed = math.hypot(vx, vy)
    if speed > robot.v_max:
        vx, vy, speed = vx * robot.v_max / speed, vy * robot.v_max / speed, robot.v_max
    if speed == 0.0:
        return Command((0.0, 0.0))
    span = robot.dt + speed / (2 * robot.braking)
    share, _, _ = wall_ahead(terrain_of(task.grid), *o.xy, vx * span, vy * span, robot.radius)
    if share <= 1.0:
        # As the braking distance is v^2 / 2a, a proportional reduction of v is enough for any a.
        share = max(share - SHORT / (speed * span), 0.0)
        vx, vy = vx * share, vy * share
    return Command((vx, vy))
