"""Obstacles as they were seen, now and soon, and the last metres to a goal at which somebody stands."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.records import Trajectories
from antway.kernels.tracking.tubes import first_conflict
from antway.world.line_of_sight import clear
from antway.world.policy import XY, Command, Decision, Observation, Task, Tracks
from antway.world.robots import RobotSpec
from antway.world.rollouts import acting

STANDING = 0.05  # m/s; an obstacle slower than this counts as standing
TAKEN = "somebody stands at the goal"  # the reason of a robot that waits for its goal
STRAIGHT_IN = f"{TAKEN}: straight to a free place within the tolerance"  # that of one that need not wait
_NEAR = 2.0  # m; a robot is near its goal if it can brake within this distance of the tolerance
_SIDES = 16  # number of places tried within the tolerance, besides the nearest one and the goal
_INSIDE = 0.97  # 1; they are at this share of the tolerance from the goal
_DRIFT = 0.02  # m; a robot that would leave the straight line by more, until it drives along it, stops and turns before


class Approach(NamedTuple):
    """How a policy comes to a goal at which somebody may stand."""

    seen: Observation  # with the obstacles that count for the policy's own method
    obstacle: int | None  # id of who stands at the goal, if the robot is near; else None
    command: Command | None  # leads straight to a free place within the tolerance; None if no such place can be reached


def renewed(decision: Decision, action: str, reason: str, **more: Any) -> Decision:
    """Return the decision with these attributes, or the present one if it is the same in words and about the same obstacle."""
    same = (decision.action, decision.reason, decision.obstacle) == (action, reason, more.get("obstacle"))
    return decision if same else Decision(action, reason, **more)


def now(o: Observation) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return places (m) and velocities (m/s) of the tracks, extrapolated to now; an unknown velocity counts as 0."""
    velocity = np.nan_to_num(o.tracks.velocity)
    age = o.t - o.sensed_at if math.isfinite(o.sensed_at) else 0.0
    return o.tracks.xy + velocity * age, velocity


def contact_radii(
    o: Observation, xy: NDArray[np.float64], robot_xy: XY, robot: RobotSpec, margin: float
) -> NDArray[np.float64]:
    """Return how far, m, the centres of robot and obstacles at `xy` keep apart: by the margin, or a smaller present gap."""
    body = o.tracks.radius + robot.radius
    gap = np.hypot(xy[:, 0] - robot_xy[0], xy[:, 1] - robot_xy[1]) - body
    return body + np.clip(gap - 1e-6, 0.0, margin)


def keeping_velocity(o: Observation, radius: NDArray[np.float64], span: float) -> Trajectories:
    """Return the motions of the tracks, with these radii, m, if each keeps its velocity for `span` s from now on."""
    xy, velocity = now(o)
    knots = np.stack((xy, xy + velocity * span), axis=1).reshape(-1, 2)
    times, first = np.tile((o.t, o.t + span), len(xy)), np.arange(0, 2 * len(xy) + 1, 2, dtype=np.int64)
    return Trajectories(times, knots, first, radius)


def fastest_to_stop(robot: RobotSpec, length: float) -> float:
    """Return the greatest speed v, m/s, with v dt + v^2 / 2b <= length, so that a robot can still stop within `length` m."""
    speed = length / robot.dt
    if math.isfinite(robot.braking):
        change = robot.braking * robot.dt
        speed = min(speed, 2 * length * robot.braking / (change + math.sqrt(change * change + 2 * robot.braking * length)))
    return min(speed, robot.v_max)


def approach(task: Task, observation: Observation, kept: float) -> Approach:
    """Return how a method comes to its goal from which somebody keeps it who stands nearer than `kept` m to a robot there.

    As long as the robot is not near, such obstacles do not count, unless they are close to the robot.
    """
    nobody, robot = Approach(observation, None, None), task.robot
    if not len(observation.tracks):
        return nobody
    o = acting(observation, robot)[0]
    xy, body = now(o)[0], observation.tracks.radius + robot.radius
    speed = np.hypot(*o.tracks.velocity.T)  # who has no velocity need not stand
    if o.tracks.covariance is not None:
        speed -= 2.0 * np.sqrt(o.tracks.variances(2))  # it may be an error of the estimate
    gap = np.where(speed < STANDING, np.hypot(*(xy - task.goal).T) - body, math.inf)
    k, near = int(np.argmin(gap)), _NEAR + robot.v_max * robot.stop_time / 2
    if not gap[k] < kept:
        return nobody
    if math.dist(o.xy, task.goal) > task.goal_tolerance + near:
        counts = (gap >= kept) | (np.hypot(*(xy - o.xy).T) - body < near / 2)
        tracks = observation.tracks
        covariance = None if tracks.covariance is None else tracks.covariance[counts]
        some = Tracks(tracks.id[counts], tracks.xy[counts], tracks.velocity[counts], tracks.radius[counts], covariance)
        return Approach(replace(observation, tracks=some), None, None)
    place = _free_place(task, o)
    command = None if place is None else _straight(robot, o, place)
    return nobody if place is not None and command is None else Approach(observation, int(o.tracks.id[k]), command)


def _straight(robot: RobotSpec, o: Observation, place: XY) -> Command | None:
    """Return the command that drives straight to a place and could stop there; None for a car that would have to manoeuvre."""
    dx, dy = place[0] - o.xy[0], place[1] - o.xy[1]
    bearing, top = math.atan2(dy, dx), fastest_to_stop(robot, math.hypot(dx, dy))
    ux, uy = math.cos(bearing), math.sin(bearing)
    if robot.wheels:
        turn = abs(math.remainder(bearing - o.heading, 2.0 * math.pi))
        if min(turn, 1.0) * turn * robot.v_max / (2.0 * robot.turn_rate) > _DRIFT:
            if robot.turning_radius > 0.0:
                return None
            top = 1e-6 if math.hypot(*o.velocity) < 1e-6 else 0.0
    elif (ux * o.velocity[1] - uy * o.velocity[0]) ** 2 / (2.0 * robot.braking) > _DRIFT:
        top = 0.0
    return Command((ux * top, uy * top))


def _free_place(task: Task, o: Observation) -> XY | None:
    """Return the nearest place within the tolerance of the goal to which the robot can drive straight now."""
    robot, (gx, gy), distance = task.robot, task.goal, _INSIDE * task.goal_tolerance
    angle = math.atan2(o.xy[1] - gy, o.xy[0] - gx) + 2.0 * math.pi * np.arange(_SIDES) / _SIDES
    places = np.vstack((np.column_stack((gx + distance * np.cos(angle), gy + distance * np.sin(angle))), task.goal))
    far = np.hypot(*(places - o.xy).T)
    order = np.argsort(far, kind="stable")
    for margin in (robot.v_max * robot.dt / 2, 0.0):
        radius = contact_radii(o, now(o)[0], o.xy, robot, margin) - robot.radius
        discs = keeping_velocity(o, radius, float(far.max()) / robot.v_max)
        for length, place in zip(far[order].tolist(), places[order].tolist()):
            times = np.array((o.t, o.t + length / robot.v_max))
            contact, _ = first_conflict(times, np.array((o.xy, place)), float(times[1]), robot.radius, 0.0, discs)
            if contact == math.inf and clear(task, o.xy, (place[0], place[1])):
                return place[0], place[1]
    return None
