"""A step aside from the plan: more clearance from people that the plan passes closely and soon, because they may sway."""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import kernel
from antway.kernels.spacetime.context import PlanningContext, clear
from antway.kernels.spacetime.motion import place_at
from antway.kernels.tracking.predict import RADIUS, SIGMA_V, VX, VY, X, Y

AHEAD = 0.6  # s; contacts within this time, or within three control periods, count
HOLD = 0.2  # s; the robot leaves the plan for this time, or for one control period, and continues beside it
STEPS = 8  # number of steps into which the plan is divided
_SIDES = 16  # number of directions tried, each at full and at half speed
_COST = 0.05  # 1; a change of the velocity by the full speed must reduce the chance of contact by this
_LEAD = 0.1  # s; the place of a track has become uncertain for this time before now
_NEVER = 0.01  # 1; the command is not changed for a smaller chance of contact
_LOGISTIC = 1.7  # 1; 1 / (1 + exp(1.7 z)) approximates the chance that a standard normal number exceeds z
_BY_TURN = 10.0  # 1; a contact by a turn within this control period counts as often: there is no later period to avert it
_NO_CHANCE = 30.0  # standard deviations; a track that stays farther away than this does not count


@kernel
def chance_of_contact(
    places: Floats,
    aside: tuple[float, float],
    estimates: Floats,
    age: float,
    radius: float,
    enough: float,
    ahead: float,
    hold: float,
) -> float:
    """Return the expected number of tracks that touch the robot, of `radius` m, within `ahead` s.

    `places`, float64[STEPS + 1, 2], are those of the robot on the plan at equal time steps from now on, m, relative to which it
    moves with the velocity `aside`, m/s, during the first `hold` s. Each track keeps its velocity, whose standard deviation is
    SIGMA_V; the estimates (kernels/tracking/predict.py) are `age` s old. The sum is broken off when it reaches `enough`.
    """
    (ox, oy), h, total, moved = aside, ahead / STEPS, 0.0, 0.0
    for i in range(STEPS):
        moved = max(moved, math.hypot(places[i + 1, 0] - places[0, 0], places[i + 1, 1] - places[0, 1]))
    moved += math.hypot(ox, oy) * hold
    for k in range(len(estimates)):
        ux, uy = estimates[k, VX], estimates[k, VY]
        ax, ay = estimates[k, X] + ux * age, estimates[k, Y] + uy * age
        body, least = radius + estimates[k, RADIUS], math.inf
        qx, qy = ax - places[0, 0], ay - places[0, 1]
        gap = math.hypot(qx, qy) - body - moved - math.hypot(ux, uy) * ahead
        if gap > _NO_CHANCE * (estimates[k, SIGMA_V] * (_LEAD + ahead) + 1e-6):
            continue
        touches = qx * qx + qy * qy < body * body  # such a contact counts by what is left of it after a step
        for i in range(STEPS):
            t = (i + 1) * h
            away = min(t, hold)
            rx, ry = ax + ux * t - places[i + 1, 0] - ox * away, ay + uy * t - places[i + 1, 1] - oy * away
            dx, dy = rx - qx, ry - qy
            dd = dx * dx + dy * dy
            s = min(max(-(qx * dx + qy * dy) / dd, 0.0), 1.0) if dd > 0.0 else 0.0
            if i == 0 and touches:
                s = 1.0
            sigma = estimates[k, SIGMA_V] * (_LEAD + (i + s) * h) + 1e-6
            least = min(least, (math.hypot(qx + dx * s, qy + dy * s) - body) / sigma)
            qx, qy = rx, ry
        total += 1.0 / (1.0 + math.exp(min(_LOGISTIC * least, 50.0)))
        if total >= enough:
            break
    return total


@kernel
def chance_by_turns(x: float, y: float, estimates: Floats, age: float, radius: float, dt: float) -> float:
    """Return how many tracks are expected to touch a robot that is at (x, y) after `dt` s if each turns now, at any angle.

    A track moves on with its speed; of its directions those count that lead it into contact. The other parameters are those of
    `chance_of_contact`.
    """
    total = 0.0
    for k in range(len(estimates)):
        ux, uy = estimates[k, VX], estimates[k, VY]
        moved, body = math.hypot(ux, uy) * dt, radius + estimates[k, RADIUS]
        distance = math.hypot(estimates[k, X] + ux * age - x, estimates[k, Y] + uy * age - y)
        if distance < body + moved and moved > 0.0 and distance > 0.0:
            cosine = (distance * distance + moved * moved - body * body) / (2.0 * distance * moved)
            total += math.acos(min(max(cosine, -1.0), 1.0)) / math.pi
    return total


@kernel
def sidestep(
    knots: Floats,
    now: float,
    age: float,
    xy: tuple[float, float],
    command: tuple[float, float],
    estimates: Floats,
    context: PlanningContext,
    dt: float,
    turns: float,
) -> tuple[float, float]:
    """Return the command (vx, vy) that minimizes the chance of contact plus a cost for the change from the given command.

    `knots`, float64[N, 3], are the plan's rows (t, x, y); empty if there is none. The robot is at `xy`, m, and `command` is the
    velocity that keeps it on the plan, m/s. The estimates are those of `chance_of_contact`, `dt` is the control period, s, and
    `turns` is how often a track turns, 1/s.
    """
    (x, y), (cx, cy), n, v = xy, command, len(knots), context.speed
    ahead, hold = max(AHEAD, 3.0 * dt), max(HOLD, dt)
    places = np.empty((STEPS + 1, 2))
    px, py = x, y
    if n > 0:
        px, py, _ = place_at(knots, now)
    for i in range(STEPS + 1):
        t = i * ahead / STEPS
        places[i, 0], places[i, 1] = x + cx * t, y + cy * t
        if n > 0:
            qx, qy, _ = place_at(knots, now + t)
            places[i, 0], places[i, 1] = qx + x - px, qy + y - py
    best = chance_of_contact(places, (0.0, 0.0), estimates, age, context.radius, math.inf, ahead, hold)
    by_turn = _BY_TURN * turns * dt
    if turns > 0.0:
        best += by_turn * chance_by_turns(x + cx * dt, y + cy * dt, estimates, age, context.radius, dt)
    if best < _NEVER:
        return cx, cy
    bx, by, bearing = cx, cy, math.atan2(cy, cx)
    for k in range(2 * _SIDES + 1):
        speed = 0.0 if k == 2 * _SIDES else v if k < _SIDES else 0.5 * v
        angle = bearing + 2.0 * math.pi * k / _SIDES
        tx, ty = speed * math.cos(angle), speed * math.sin(angle)
        cost = _COST * math.hypot(tx - cx, ty - cy) / v
        if turns > 0.0 and cost < best:
            cost += by_turn * chance_by_turns(x + tx * dt, y + ty * dt, estimates, age, context.radius, dt)
        if cost < best and clear(context, x, y, x + tx * hold, y + ty * hold):
            left, aside = best - cost, (tx - cx, ty - cy)
            cost += chance_of_contact(places, aside, estimates, age, context.radius, left, ahead, hold)
            if cost < best:
                best, bx, by = cost, tx, ty
    return bx, by
