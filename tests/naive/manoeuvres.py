"""How long a car needs to a goal near it: two pieces, tried one after another in small steps."""

from __future__ import annotations

import math

import numpy as np

from antway.world.robots import RobotSpec


def least_time(goal: tuple[float, float], tolerance: float, robot: RobotSpec, lengths: int = 60) -> float:
    """The least time of all first pieces of up to half a turn, and all second pieces that end within tolerance of the goal."""
    best, speeds = math.inf, {1.0: robot.v_max, -1.0: robot.v_reverse}
    signs = [sign for sign in speeds if speeds[sign] > 0.0]
    arcs = np.linspace(0.0, math.pi, lengths).tolist()
    turns = np.linspace(0.0, math.tau, 4 * lengths).tolist()
    for sign in signs:
        for bend in (-1.0, 0.0, 1.0):
            for first in arcs:
                x, y, theta = _after((0.0, 0.0, 0.0), sign, bend, first, robot)
                for then in signs:
                    for other in (-1.0, 1.0):
                        for turn in turns:
                            at = _after((x, y, theta), then, other, turn, robot)
                            line = _line_to(at, then, goal, tolerance)
                            length = turn * robot.turning_radius + line
                            if then == sign:
                                time = _from_rest(first * robot.turning_radius + length, speeds[sign], robot)
                            else:
                                time = _stops(first * robot.turning_radius, speeds[sign], robot)
                                time += _from_rest(length, speeds[then], robot)
                            best = min(best, time)
                            if math.isfinite(line):  # a longer arc before the line only takes longer
                                break
    return best


def _after(
    pose: tuple[float, float, float], sign: float, bend: float, turn: float, robot: RobotSpec
) -> tuple[float, float, float]:
    """The pose after `turn` turning radii, straight ahead or along a circle."""
    x, y, theta = pose
    radius = robot.turning_radius
    if bend == 0.0:
        return x + sign * turn * radius * math.cos(theta), y + sign * turn * radius * math.sin(theta), theta
    cx, cy = x - bend * radius * math.sin(theta), y + bend * radius * math.cos(theta)
    angle = sign * bend * turn
    dx, dy = x - cx, y - cy
    c, s = math.cos(angle), math.sin(angle)
    return cx + c * dx - s * dy, cy + s * dx + c * dy, theta + angle


def _line_to(pose: tuple[float, float, float], sign: float, goal: tuple[float, float], tolerance: float) -> float:
    """How far a straight line leads until it is within tolerance of the goal; infinite if it never is."""
    x, y, theta = pose
    ux, uy = sign * math.cos(theta), sign * math.sin(theta)
    along = (goal[0] - x) * ux + (goal[1] - y) * uy
    beside = (goal[0] - x) * uy - (goal[1] - y) * ux
    half = tolerance**2 - beside**2
    if half < 0.0 or along + math.sqrt(half) < 0.0:
        return math.inf
    return max(along - math.sqrt(half), 0.0)


def _from_rest(length: float, speed: float, robot: RobotSpec) -> float:
    ramp = speed**2 / (2.0 * robot.a_max)
    if length <= ramp:
        return math.sqrt(2.0 * length / robot.a_max)
    return speed / robot.a_max + (length - ramp) / speed


def _stops(length: float, speed: float, robot: RobotSpec) -> float:
    ramps = speed**2 / 2.0 * (1.0 / robot.a_max + 1.0 / robot.braking)
    if length >= ramps:
        return speed / robot.a_max + speed / robot.braking + (length - ramps) / speed
    top = speed * math.sqrt(length / ramps)
    return top / robot.a_max + top / robot.braking
