"""How long a car needs to a goal near it where nothing is in the way, which times by heading are too coarse to tell."""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from antway.kernels.base.arrays import Floats
from antway.kernels.base.records import RobotLimits

_EDGE = 60  # nodes from the middle of the tables to their edges
_NODES = 20  # nodes in a turning radius
_LENGTHS = 24  # number of lengths of the first piece, up to half of a turn


@lru_cache(16)
def manoeuvre_losses(robot: RobotLimits, tolerance: float) -> tuple[NDArray[np.float32], Floats]:
    """Return what a car at rest near its goal loses to manoeuvres, in s, and the frame: `StaticField.manoeuvre`.

    This is the difference of `manoeuvre_times` from what ramps and one turn take (`lost_time`, kernels/controls/rollout.py). It
    fades from two turning radii on, because farther away the times by heading tell. Both are empty for other robots.
    All limits of acceleration have to be finite.
    """
    if robot.turning_radius == 0.0:
        return np.empty((0, 0), np.float32), np.zeros(4)
    node = robot.turning_radius / _NODES
    y, x = node * (np.indices((2 * _EDGE + 1,) * 2) - _EDGE)
    far = np.maximum(np.hypot(x, y) - tolerance, 0.0)
    phi = np.arctan2(np.abs(y), x)
    known = _from_rest(far + _turn(robot, robot.v_max) * (phi - np.sin(phi)), robot.v_max, robot)
    if robot.v_reverse > 0.0:
        phi = math.pi - phi
        back = far + _turn(robot, robot.v_reverse) * (phi - np.sin(phi))
        known = np.minimum(known, _from_rest(back, robot.v_reverse, robot))
    lost = np.maximum(manoeuvre_times(robot, tolerance) - known, 0.0)
    weight = np.clip(3.0 - 3.0 * np.hypot(x, y) / (_EDGE * node), 0.0, 1.0)
    return (weight * lost).astype(np.float32), np.array([-_EDGE * node, -_EDGE * node, 1.0 / node, robot.v_max])


def manoeuvre_times(robot: RobotLimits, tolerance: float) -> Floats:
    """Return how long a car at rest needs to a goal at each node of a square around it, where nothing is in the way, s.

    It drives a straight line or an arc of its turning radius, and then an arc and a straight line to within `tolerance` m of
    the goal, each of the two pieces forward or in reverse. Node (i, j), 0 to 120, is (j - 60) / 20 turning radii ahead of the
    car and (i - 60) / 20 to its left.
    """
    radius, node = robot.turning_radius, robot.turning_radius / _NODES
    y, x = node * (np.indices((_EDGE + 1, 2 * _EDGE + 1)) - np.array([0, _EDGE])[:, None, None])  # the left half
    best = np.full(x.shape, np.inf)
    directions = [(sign, speed) for sign, speed in ((1.0, robot.v_max), (-1.0, robot.v_reverse)) if speed > 0.0]
    angles = np.linspace(0.0, math.pi, _LENGTHS).tolist()
    for (sign, speed), bend, angle in product(directions, (-1.0, 0.0, 1.0), angles):
        turned = sign * bend * angle
        dx = x - sign * radius * (math.sin(angle) if bend else angle)
        dy = y - bend * radius * (1.0 - math.cos(angle))
        ahead, left = math.cos(turned) * dx + math.sin(turned) * dy, math.cos(turned) * dy - math.sin(turned) * dx
        first = angle * (_turn(robot, speed) if bend else radius)
        for then, pace in directions:
            length = _arc_and_line(then * ahead, np.abs(left), radius, _turn(robot, pace))
            if then == sign:
                time = _from_rest(first + length, pace, robot)
            else:
                time = _rest_to_rest(first, speed, robot) + _from_rest(length, pace, robot)
            best = np.minimum(best, time)
    n = min(int(tolerance / node), 2 * _EDGE)
    disc = np.hypot(*np.indices((2 * n + 1, 2 * n + 1)) - n) * node <= tolerance
    return minimum_filter(np.vstack((best[:0:-1], best)), footprint=disc, mode="nearest")


def _turn(robot: RobotLimits, speed: float) -> float:
    """Return how far a robot drives at `speed` m/s in the time in which it turns by 1 rad, m."""
    return max(robot.turning_radius, speed / robot.turn_rate)


def _arc_and_line(x: Floats, y: Floats, radius: float, turn: float) -> Floats:
    """Return the length of the shorter arc and line to (x, y) in the car's frame, y >= 0, `turn` m a radian; or infinity, m."""
    best = np.full(x.shape, np.inf)
    for left in (y, -y):  # with an arc to the left, and with one to the right
        square = x * x + (left - radius) ** 2 - radius * radius
        line = np.sqrt(np.maximum(square, 0.0))
        angle = np.arctan2(left - radius, x) + np.arctan2(radius, line)
        angle = np.where(angle < -1e-9, angle + 2.0 * math.pi, np.maximum(angle, 0.0))
        best = np.minimum(best, np.where(square >= 0.0, turn * angle + line, np.inf))
    return best


def _from_rest(length: Floats, speed: float, robot: RobotLimits) -> Floats:
    """Return how long a robot takes from rest for a length in m, s."""
    top = np.minimum(speed, np.sqrt(2.0 * robot.a_max * np.maximum(length, 1e-9)))
    return length / top + 0.5 * top / robot.a_max


def _rest_to_rest(length: float, speed: float, robot: RobotLimits) -> float:
    """Return how long a robot takes from rest to rest for a length in m, s."""
    ramps = 0.5 / robot.a_max + 0.5 / robot.brake_max
    top = min(speed, math.sqrt(max(length, 1e-9) / ramps))
    return length / top + top * ramps
