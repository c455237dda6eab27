"""Least harm: the command whose predicted contacts are least likely, latest and slowest.

The guard takes it in mode "least-harm" where no command is certain to be safe.
"""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import TOUCH, wall_ahead
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import RobotLimits, RobotState, Terrain
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.reach import AGE, RADIUS, VX, VY, X, Y

_SIDES = 16  # number of directions tried
_SPEEDS = 2  # number of speeds tried in each direction
_LASTS = (0.3, 0.8, 2.0)  # s; a tried motion lasts this long, and then the robot stands
_AHEAD = 2.5  # s; contacts are looked for up to this time ahead
_STEPS = 64  # most steps into which that time is divided
_WEIGHT = 1.5  # s; a contact this much later counts 1 / e of the earlier one
_SIGMA = 0.04  # m; standard deviation of the place of a track now
_GROWTH = 0.15  # m/s; growth of the standard deviation of a predicted place
_LOGISTIC = 1.7  # 1; 1 / (1 + exp(1.7 z)) approximates the chance that a standard normal number exceeds z
_SPEED_COST = 0.02  # a contact at full speed counts this share more than a contact at rest
_PROGRESS = 0.02  # expected contacts that full speed in the commanded direction makes up for


@kernel
def harm(
    state: RobotState,
    tx: float,
    ty: float,
    until: float,
    tracks: Floats,
    limits: RobotLimits,
    dt: float,
    enough: float,
    path: Floats,
) -> float:
    """Return the expected number of contacts of a robot that is commanded (tx, ty) for `until` s and then stands.

    Later contacts count less. The state has the velocity (vx, vy), whatever the drive. Each of `tracks` (rows of
    kernels/robot/reach.py) keeps its velocity, and its place becomes less certain with time. The sum is broken off when it
    reaches `enough`. `path`, float64[S, 5], is scratch memory: the time looked ahead is divided into at most S steps.
    """
    dt = max(dt, _AHEAD / len(path))  # s; a step is longer than a control period where there would be too many of these
    steps = math.ceil(_AHEAD / dt - 1e-9)
    x, y, angle, wx, wy = state
    for i in range(steps):
        goes = i * dt < until - TOUCH
        wx, wy, angle = drive(wx, wy, angle, tx if goes else 0.0, ty if goes else 0.0, limits, dt)
        path[i, 0], path[i, 1], path[i, 2], path[i, 3], path[i, 4] = x, y, wx, wy, math.hypot(wx, wy) / limits.v_max
        x, y = x + wx * dt, y + wy * dt
    total = 0.0
    for k in range(len(tracks)):
        ux, uy = tracks[k, VX], tracks[k, VY]
        ax, ay = tracks[k, X] + ux * tracks[k, AGE], tracks[k, Y] + uy * tracks[k, AGE]
        body = limits.radius + tracks[k, RADIUS]
        moves = (limits.v_max + math.hypot(ux, uy)) * _AHEAD
        if math.hypot(ax - state.x, ay - state.y) - body > moves + 3.0 * (_SIGMA + _GROWTH * _AHEAD):
            continue
        low, ratio, when, fast = math.inf, 0.0, 0.0, 0.0
        for i in range(steps):
            t = i * dt
            if t / _WEIGHT >= low:
                break
            qx, qy, rx, ry = ax + ux * t - path[i, 0], ay + uy * t - path[i, 1], ux - path[i, 2], uy - path[i, 3]
            sigma = _SIGMA + _GROWTH * (t + 0.5 * dt)
            near = body + 3.0 * sigma + (abs(rx) + abs(ry)) * dt
            if qx * qx + qy * qy > near * near:
                continue
            rr = rx * rx + ry * ry
            s = min(max(-(qx * rx + qy * ry) / rr, 0.0), dt) if rr > 0.0 else 0.0
            after = t + s
            if i == 0 and qx * qx + qy * qy < body * body:
                s, after = dt, 0.0  # a contact that is there already counts by what is left of it after the step
            slope = _LOGISTIC * (math.hypot(qx + rx * s, qy + ry * s) - body) / sigma
            if max(slope, 0.0) + after / _WEIGHT < low:
                low, ratio, when, fast = max(slope, 0.0) + after / _WEIGHT, slope, after, path[i, 4]
        if low < math.inf:
            total += math.exp(-when / _WEIGHT) / (1.0 + math.exp(ratio)) * (1.0 + _SPEED_COST * fast)
        if total >= enough:
            break
    return total


@kernel
def least_harm(
    state: RobotState, cx: float, cy: float, tracks: Floats, limits: RobotLimits, dt: float, terrain: Terrain
) -> tuple[float, float]:
    """Return the command (vx, vy) of least `harm` that is clear of walls.

    The candidates are standing still, the command (cx, cy), and `_SIDES` directions at `_SPEEDS` speeds. The other parameters
    are those of `harm`.
    """
    (x, y, heading, vx, vy), v_max, a_max, radius = state, limits.v_max, limits.a_max, limits.radius
    path = np.empty((_STEPS, 5))
    best, bx, by = harm(state, 0.0, 0.0, 0.0, tracks, limits, dt, math.inf, path), 0.0, 0.0
    asked = max(math.hypot(cx, cy), TOUCH)
    for k in range(_SIDES * _SPEEDS + 1):
        speed, angle = v_max * (1 + k % _SPEEDS) / _SPEEDS, 2 * math.pi * (k // _SPEEDS) / _SIDES
        tx, ty = speed * math.cos(angle), speed * math.sin(angle)
        if k == _SIDES * _SPEEDS:
            tx, ty, speed = cx, cy, math.hypot(cx, cy)
        if speed <= TOUCH:
            continue
        braking = 0.5 * speed * speed / a_max
        ahead = speed * _LASTS[-1] + braking
        share, _, _ = wall_ahead(terrain, x, y, tx / speed * ahead, ty / speed * ahead, radius)
        clear_time = (min(share, 1.0) * ahead - braking) / speed  # s
        if clear_time < dt:
            continue
        wx, wy, _ = drive(vx, vy, heading, tx, ty, limits, dt)
        reaches = math.hypot(wx, wy)
        far = reaches * dt + 0.5 * reaches * reaches / a_max
        # Wheels drive along their heading, which may differ from the commanded direction.
        if reaches > TOUCH and wall_ahead(terrain, x, y, wx / reaches * far, wy / reaches * far, radius)[0] <= 1.0:
            continue
        progress = _PROGRESS * (tx * cx + ty * cy) / (asked * v_max)
        for lasts in _LASTS:
            value = harm(state, tx, ty, min(lasts, clear_time), tracks, limits, dt, best + progress, path) - progress
            if value < best - TOUCH:
                best, bx, by = value, tx, ty
            if lasts >= clear_time:
                break
    return bx, by
