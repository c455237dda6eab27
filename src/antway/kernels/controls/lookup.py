"""The map as rollouts look it up: the distance to walls, and the time to the goal."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import inner_kernel, kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState
from antway.kernels.controls.motion import MotionState
from antway.kernels.controls.problem import GOAL_SPEED, GOAL_X, GOAL_Y, TOLERANCE, StaticField

_DETOUR = 0.1  # 1; a path longer than a straight line by this share of the distance at which `manoeuvre` ends goes round walls
_FINE = 0.02  # m; this often in a step a footprint that keeps its heading is judged, as its corners can pass those of walls
_CUT = 0.005  # m; a disc may come this much nearer to the corner of a wall in a step than at its ends: the guard passes that
_MOST_PARTS = 1000.0  # 1; into which a step is divided; more would take long for a robot of absurd speed or size
_SHORT_TURN = 1.0  # s; a loss to the turning radius up to this is not counted, because rollouts and `lost_time` see short turns


@inner_kernel
def sample(field: NDArray[np.float32], x: float, y: float, frame: Floats) -> float:
    """Return the bilinear value of a field at (x, y); outside the map the value at its edge."""
    c = min(max((x - frame[0]) * frame[2], 0.0), field.shape[1] - 1.001)
    r = min(max((y - frame[1]) * frame[2], 0.0), field.shape[0] - 1.001)
    i, j = int(r), int(c)
    u, w = r - i, c - j
    low = field[i, j] + w * (field[i, j + 1] - field[i, j])
    high = field[i + 1, j] + w * (field[i + 1, j + 1] - field[i + 1, j])
    return float(low + u * (high - low))


@inner_kernel
def slope(field: StaticField, x: float, y: float, e: float) -> tuple[float, float, float]:
    """Return the central differences of the time to the goal over 2 e m along x and along y, and their norm, s."""
    gx = sample(field.time, x + e, y, field.time_frame) - sample(field.time, x - e, y, field.time_frame)
    gy = sample(field.time, x, y + e, field.time_frame) - sample(field.time, x, y - e, field.time_frame)
    return gx, gy, math.sqrt(gx * gx + gy * gy)


@inner_kernel
def time_to_go(field: StaticField, at: MotionState) -> float:
    """Return the time to the goal of a robot that turns and accelerates at once, s."""
    return max(sample(field.time, at.x, at.y, field.time_frame), 0.0)


@inner_kernel
def reaches(at: MotionState, x: float, y: float, tolerance: float, slow: float) -> bool:
    """Tell whether the robot's centre is within `tolerance` m of (x, y), and no faster than `slow` m/s."""
    dx, dy = at.x - x, at.y - y
    return bool(dx * dx + dy * dy < tolerance * tolerance and at.a * at.a + at.b * at.b <= slow * slow)


@inner_kernel
def at_goal(field: StaticField, at: MotionState) -> bool:
    """Tell whether the robot's centre is within the goal's tolerance, and slow enough."""
    goal = field.goal
    return reaches(at, goal[GOAL_X], goal[GOAL_Y], goal[TOLERANCE], goal[GOAL_SPEED])


@inner_kernel
def turning_loss(field: StaticField, at: MotionState, to_go: float) -> float:
    """Return the time that a car loses to its turning radius on the `to_go` s to the goal, s.

    Far from the goal the first `_SHORT_TURN` s are left out.
    """
    headings = len(field.turning) - 1
    if headings < 1:
        return 0.0
    k = math.atan2(at.sin, at.cos) * headings / (2.0 * math.pi)
    low = math.floor(k)
    one, other = field.turning[int(low) % headings], field.turning[int(low + 1.0) % headings]
    turned = sample(one, at.x, at.y, field.turning_frame)
    turned += (k - low) * (sample(other, at.x, at.y, field.turning_frame) - turned)
    loss = turned - sample(field.turning[headings], at.x, at.y, field.turning_frame) - _SHORT_TURN
    return max(loss, _manoeuvre_loss(field, at, to_go))


@inner_kernel
def _manoeuvre_loss(field: StaticField, at: MotionState, to_go: float) -> float:
    """Return the time that a car loses to manoeuvres near its goal, s; 0 if its path there goes round a wall."""
    frame, dx, dy = field.manoeuvre_frame, field.goal[GOAL_X] - at.x, field.goal[GOAL_Y] - at.y
    distance, edge = math.sqrt(dx * dx + dy * dy), -frame[0]
    detour = to_go * frame[3] + field.goal[TOLERANCE] - distance  # m
    share = min(2.0 - detour / (_DETOUR * edge), 1.0)
    if distance >= edge or share <= 0.0:
        return 0.0
    return float(share * sample(field.manoeuvre, at.cos * dx + at.sin * dy, at.cos * dy - at.sin * dx, frame))


@inner_kernel
def clearance(field: StaticField, at: MotionState, enough: float) -> float:
    """Return the distance from the robot to walls, m.

    It is the distance from the robot's disc. If that is below `enough` and the smaller discs of the footprint are farther from
    walls, it is the distance from these.
    """
    wall = sample(field.wall, at.x, at.y, field.wall_frame)
    if wall >= enough or len(field.discs) == 0:
        return wall
    least = math.inf
    for i in range(len(field.discs)):
        dx, dy = field.discs[i, 0], field.discs[i, 1]
        x, y = at.x + at.cos * dx - at.sin * dy, at.y + at.sin * dx + at.cos * dy
        least = min(least, sample(field.wall, x, y, field.wall_frame) + field.discs[i, 2])
    return max(wall, least)


@inner_kernel
def _longest_step(limits: RobotLimits) -> float:
    """Return the length of a step in which the robot's disc comes nearer to a corner by `_CUT` than at its ends, m."""
    return math.sqrt(8.0 * limits.radius * _CUT)  # a chord of the circle around the corner


@inner_kernel
def passes_corners(limits: RobotLimits, dt: float) -> bool:
    """Tell whether a robot that stands can pass the corner of a wall unnoticed in a period of `dt` s.

    The guard would refuse that, and the robot would stand there for good. A robot that gets faster slowly gets on.
    """
    return min(limits.v_max, limits.a_max * dt) * dt > _longest_step(limits)


@inner_kernel
def clearance_within(
    field: StaticField, before: MotionState, at: MotionState, wall: float, enough: float, limits: RobotLimits
) -> float:
    """Return the least distance of a robot from walls in a step from `before` to `at`, m, if it is below `enough`.

    Wheels drive an arc. `wall` is the distance of the robot's disc at the end. The start has been judged as the end of the step
    before.
    """
    dx, dy = at.x - before.x, at.y - before.y
    moved = math.sqrt(dx * dx + dy * dy)
    if wall >= enough + moved:
        return wall
    least = clearance(field, at, enough)
    if least >= enough + moved:
        return least
    keeps_heading = limits.drive == HOLONOMIC
    part = _FINE if keeps_heading and len(field.discs) > 0 else _longest_step(limits)
    parts = math.ceil(min(moved / part, _MOST_PARTS))
    turn = before.cos * at.sin - before.sin * at.cos  # rad, if it is small
    for k in range(1, parts):
        share = k / parts
        bulge = 0.0 if keeps_heading else 0.5 * share * (1.0 - share) * turn  # of the arc beside its chord, as a share of that
        x, y = before.x + share * dx + bulge * dy, before.y + share * dy - bulge * dx
        cos, sin = before.cos + share * (at.cos - before.cos), before.sin + share * (at.sin - before.sin)
        least = min(least, clearance(field, MotionState(x, y, cos, sin, 0.0, 0.0), enough))
    return least


@kernel
def depth_in_wall(field: StaticField, state: RobotState) -> float:
    """Return how deep the robot is in a wall, because its place or the map is wrong, m; 0 if it is in none."""
    at = MotionState(state.x, state.y, math.cos(state.theta), math.sin(state.theta), state.a, state.b)
    return max(-clearance(field, at, 0.0), 0.0)


@inner_kernel
def _seen_from(at: MotionState, dx: float, dy: float) -> tuple[float, float]:
    """Return how far ahead of the robot and how far to its left the point (-dx, -dy) from its centre is, m."""
    return -(at.cos * dx + at.sin * dy), at.sin * dx - at.cos * dy


@inner_kernel
def _square_from(box: Floats, ahead: float, left: float) -> float:
    """Return the squared distance of a point from the robot's box, m^2."""
    out = max(box[0] - ahead, ahead - box[1], 0.0)
    side = max(box[2] - left, left - box[3], 0.0)
    return float(out * out + side * side)


@inner_kernel
def footprint_distance(
    field: StaticField, before: MotionState, from_x: float, from_y: float, at: MotionState, dx: float, dy: float
) -> float:
    """Return the least distance of the robot's box from an obstacle in a step, plus the radius of the robot's disc, m.

    The robot is at (from_x, from_y) from the obstacle `before` the step, and at (dx, dy) from it `at` the end. Seen from the
    robot the obstacle moves in a straight line. It is nearest beside a corner of the box, at the end, or at the start, which
    has been judged as the end of the step before. Obstacles keep the distances of centres that hold for the disc, so that the
    footprint is judged by the same numbers.
    """
    box = field.box
    (a, b), (ahead, left) = _seen_from(before, from_x, from_y), _seen_from(at, dx, dy)
    nearest, start = _square_from(box, ahead, left), _square_from(box, a, b)
    along, across = ahead - a, left - b
    length = along * along + across * across
    for i in range(2):
        for j in range(2, 4):
            da, db = box[i] - a, box[j] - b
            if 0.0 < da * along + db * across < length:
                square = (da * across - db * along) ** 2 / length
                if square < start:
                    nearest = min(nearest, square)
    return float(math.sqrt(nearest) + box[4])
