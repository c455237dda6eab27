"""A step aside from the plan: more clearance from people who may sway, where the plan passes them closely and soon."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.spacetime.context import PlanningContext, clear
from antway.kernels.spacetime.motion import place_at
from antway.kernels.tracking.predict import RADIUS, SIGMA_V, VX, VY, X, Y

AHEAD = 0.6  # s; contacts count that come so soon, or within three control periods
HOLD = 0.2  # s; the robot leaves the plan for so long, or for one control period, and goes on beside it
STEPS = 8  # in which the plan is looked at
_SIDES = 16  # directions tried, at full and at half speed
_COST = 0.05  # chance of contact that a turn from full speed to a stand has to save
_LEAD = 0.1  # s; in which a track's place has become uncertain before now
_NEVER = 0.01  # a chance of contact below this changes nothing
_LOGISTIC = 1.7  # 1 / (1 + exp(1.7 z)) is nearly the chance that a normal number is above z


@kernel
def chance_of_contact(
    places: NDArray[np.float64],
    aside: tuple[float, float],
    estimates: NDArray[np.float64],
    age: float,
    radius: float,
    enough: float,
    ahead: float,
    hold: float,
) -> float:
    """Return the expected number of tracks that touch a robot within `ahead` s.

    Parameters
    ----------
    places : float64[STEPS + 1, 2]
        Where its plan takes it, at equal times from now to `ahead` s, m.
    aside : (float, float)
        Velocity against the plan for `hold` s, m/s.
    estimates : float64[K, 8]
        As in kernels/tracking/predict.py; each track keeps its velocity, of which SIGMA_V says how wrong it may be.
    age, radius : float
        How old the estimates are, s; of the robot, m.
    enough : float
        A number from which on the answer need not be exact.
    ahead, hold : float
        s.
    """
    (ox, oy), h, total = aside, ahead / STEPS, 0.0
    for k in range(len(estimates)):
        ux, uy = estimates[k, VX], estimates[k, VY]
        ax, ay = estimates[k, X] + ux * age, estimates[k, Y] + uy * age
        body, least = radius + estimates[k, RADIUS], math.inf
        qx, qy = ax - places[0, 0], ay - places[0, 1]
        for i in range(STEPS):
            t = (i + 1) * h
            away = min(t, hold)
            rx, ry = ax + ux * t - places[i + 1, 0] - ox * away, ay + uy * t - places[i + 1, 1] - oy * away
            dx, dy = rx - qx, ry - qy
            dd = dx * dx + dy * dy
            s = min(max(-(qx * dx + qy * dy) / dd, 0.0), 1.0) if dd > 0.0 else 0.0
            sigma = estimates[k, SIGMA_V] * (_LEAD + (i + s) * h) + 1e-6
            least = min(least, (math.hypot(qx + dx * s, qy + dy * s) - body) / sigma)
            qx, qy = rx, ry
        total += 1.0 / (1.0 + math.exp(min(_LOGISTIC * least, 50.0)))
        if total >= enough:
            break
    return total


@kernel
def sidestep(
    knots: NDArray[np.float64],
    now: float,
    age: float,
    xy: tuple[float, float],
    command: tuple[float, float],
    estimates: NDArray[np.float64],
    context: PlanningContext,
    dt: float,
) -> tuple[float, float]:
    """Return the command (vx, vy) whose chance of contact soon, and how far it is from the one given, cost least.

    Parameters
    ----------
    knots : float64[N, 3]
        The plan, rows (t, x, y); empty where there is none.
    now, age : float
        Time now, and how old the estimates are, s.
    xy, command : (float, float)
        Where the robot is, m; the velocity that keeps it on the plan, m/s.
    estimates : float64[K, 8]
        As in `chance_of_contact`.
    context : PlanningContext
    dt : float
        Control period, s.
    """
    (x, y), (cx, cy), n, v = xy, command, len(knots), context.speed
    ahead, hold = max(AHEAD, 3.0 * dt), max(HOLD, dt)
    places = np.empty((STEPS + 1, 2))
    px, py = x, y
    if n > 0:
        px, py, _ = place_at(knots, n, now)
    for i in range(STEPS + 1):
        t = i * ahead / STEPS
        places[i, 0], places[i, 1] = x + cx * t, y + cy * t
        if n > 0:
            qx, qy, _ = place_at(knots, n, now + t)
            places[i, 0], places[i, 1] = qx + x - px, qy + y - py
    best = chance_of_contact(places, (0.0, 0.0), estimates, age, context.radius, math.inf, ahead, hold)
    if best < _NEVER:
        return cx, cy
    bx, by, bearing = cx, cy, math.atan2(cy, cx)
    for k in range(2 * _SIDES + 1):
        speed = 0.0 if k == 2 * _SIDES else v if k < _SIDES else 0.5 * v
        angle = bearing + 2.0 * math.pi * k / _SIDES
        tx, ty = speed * math.cos(angle), speed * math.sin(angle)
        cost = _COST * math.hypot(tx - cx, ty - cy) / v
        if cost < best and clear(context, x, y, x + tx * hold, y + ty * hold):
            left, aside = best - cost, (tx - cx, ty - cy)
            cost += chance_of_contact(places, aside, estimates, age, context.radius, left, ahead, hold)
            if cost < best:
                best, bx, by = cost, tx, ty
    return bx, by
