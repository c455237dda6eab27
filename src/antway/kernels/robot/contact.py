"""One control step of the simulated robot, which ends at the first contact."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import TOUCH, swept_discs, swept_timeline, wall_ahead
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import RobotLimits, Terrain, Trajectories
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.motion import REST

# What ended a step, in the order by which ties are decided.
GOES_ON, HIT_MOVING, HIT_STANDING, HIT_WALL, REACHED = 0, 1, 2, 3, 4


class Record(NamedTuple):
    """The robot's record of an episode, with a row for the start of each cycle and one for the end."""

    t: Floats  # float64[N + 1], s
    xy: Floats  # float64[N + 1, 2], m
    velocity: Floats  # float64[N + 1, 2], m/s
    heading: Floats  # float64[N + 1], rad
    turn_rate: Floats  # float64[N + 1], rad/s
    command: Floats  # float64[N, 2]: (vx, vy), or (v, omega) for wheels


@inner_kernel
def at_goal(x: float, y: float, aim: Floats) -> bool:
    """Tell whether (x, y) is within the tolerance of the goal, also where it is exactly on the edge; `aim` as in `advance`."""
    return bool(math.hypot(x - aim[0], y - aim[1]) <= aim[2] + TOUCH)


@bare_kernel
def advance(
    i: int, dt: float, limits: RobotLimits, aim: Floats, record: Record, terrain: Terrain, trajectories: Trajectories
) -> tuple[int, int, float]:
    """Drive control step i and write row i + 1 of the robot's record.

    The robot moves straight at constant speed from `record.t[i]` to (i + 1) dt, or until it meets an obstacle, a wall or the
    goal. Row i + 1 holds the state at that time; rows and commands up to i are given. `aim` has x, y and tolerance of the goal,
    m; a robot that is exactly that far from the goal at the end of the step has reached it.

    Returns what happened, `GOES_ON` or another of the above; the index of the obstacle that was met, else -1; and the smallest
    distance between the edges of robot and obstacles in this step, m, infinite without obstacles.
    """
    t, xy, velocity, heading, _, command = record
    radius = trajectories.radius
    vx, vy, new_heading = drive(velocity[i, 0], velocity[i, 1], heading[i], command[i, 0], command[i, 1], limits, dt)
    t0, t1 = t[i], (i + 1) * dt
    h = t1 - t0
    ax, ay = xy[i, 0], xy[i, 1]
    bx, by = ax + vx * h, ay + vy * h
    what, obstacle, when, clearance = GOES_ON, -1, t1, math.inf
    for k in range(len(radius)):
        contact_radius = limits.radius + radius[k]
        hit, distance, _ = swept_timeline(ax, ay, bx, by, t0, t1, contact_radius, trajectories, k)
        clearance = min(clearance, distance - contact_radius)
        if hit < when or (hit == when and what == GOES_ON):
            when, obstacle = hit, k
            what = HIT_MOVING if math.hypot(vx, vy) > REST else HIT_STANDING
    wall, _, _ = wall_ahead(terrain, ax, ay, vx * h, vy * h, limits.radius)
    if t0 + wall * h < when:
        what, obstacle, when = HIT_WALL, -1, t0 + wall * h
    arrival, _, _ = swept_discs(aim[0] - ax, aim[1] - ay, -vx, -vy, aim[2], h)
    if t0 + arrival < when:
        what, obstacle, when = REACHED, -1, t0 + arrival
    if what != GOES_ON:
        when = max(when, np.nextafter(t0, math.inf))
        bx, by = ax + vx * (when - t0), ay + vy * (when - t0)
        clearance = math.inf
        for k in range(len(radius)):
            contact_radius = limits.radius + radius[k]
            _, distance, _ = swept_timeline(ax, ay, bx, by, t0, when, contact_radius, trajectories, k)
            clearance = min(clearance, distance - contact_radius)
    t[i + 1] = when
    xy[i + 1, 0], xy[i + 1, 1] = bx, by
    velocity[i + 1, 0], velocity[i + 1, 1] = vx, vy
    heading[i + 1] = new_heading
    if what == GOES_ON and at_goal(bx, by, aim):
        what = REACHED
    return what, obstacle, clearance
