"""One control cycle of the antway policy in one call: predict, keep or improve the plan, command."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base import records
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import Predictions, Terrain
from antway.kernels.base.rng import State
from antway.kernels.base.rows import copy_row
from antway.kernels.spacetime.ants import ColonySettings, search
from antway.kernels.spacetime.context import PlanningContext, clear
from antway.kernels.spacetime.memory import EXPANSIONS, Memory
from antway.kernels.spacetime.motion import first_conflict, place_at, shorten, trace_back
from antway.kernels.spacetime.pheromone import Trails, evaporate
from antway.kernels.tracking.crowd import foresee
from antway.kernels.tracking.foretold import compared, foretell
from antway.kernels.tracking.predict import SIGMA_V, VX, VY, TubeMargins, X, Y, predict, time_shift

KEPT, NEW, IMPROVED, NONE = 0, 1, 2, 3  # what a cycle did with the plan
# Entries of `Plan.state`: the number of knots, the arrival at the goal in s, the number of cycles in which a plan was made, the
# time in s before which no better plan is looked for while the obstacles move as predicted, the last lower bound on any arrival
# in s, the number of predicted motion segments, and the time in s that was recently given up for additional clearance.
COUNT, ARRIVAL, PLANNED, LOOK, BOUND, FORESEEN, SPENT = range(7)
_LITTLE = 0.01  # s; additional clearance worth less than this is not looked for
_FORGETS = 0.1  # 1; the time given up for clearance is forgotten at this rate, in s a second
_PAUSE = 0.25  # s; the colony looks for a better plan at this interval while the obstacles move as predicted
_SAME = 1e-3  # m and m/s; an obstacle moves as predicted if its place and its velocity differ by less than this
_GRAZE = 0.05  # m; a plan grazes an obstacle if it lacks at most this much of its clearance radius
_SOON = 0.5  # s; a plan that grazes an obstacle sooner than this is given up
_LAST = 4  # the search for a plan without margins may take the expansions divided by this
_GRACE = 0.3  # s; a grazing plan is replaced by one that arrives up to this much later


class Settings(NamedTuple):
    """Numbers of the policy; see `AntwayPolicy`."""

    dt: float  # s
    horizon: float  # s
    judged: bool  # whether predictions are stored and later compared with what happened
    preferred_speed: float  # m/s
    hysteresis: float  # s
    tracking_tolerance: float  # m
    expansions: int  # most moves tested where there is no plan
    improvement_expansions: int  # most moves tested where there is a plan
    low: float  # least persistence of the pheromone
    high: float  # greatest persistence of the pheromone
    goal_x: float  # m
    goal_y: float  # m
    tubes: TubeMargins
    bare: TubeMargins  # margins of the last search, if no path keeps `tubes`; a robot radius of 0 means that there is none
    roomy: TubeMargins  # margins of the search for additional clearance; a robot radius of 0 means that there is none
    spare_worth: float  # s^2/m; a plan with additional clearance may arrive later by this times the mean velocity error
    colony: ColonySettings


class Crowd(NamedTuple):
    """Estimates and predictions of obstacles; kernels/tracking/crowd.py predicts people who avoid one another."""

    rows: NDArray[np.float64]  # [M, COLUMNS]
    known: NDArray[np.int64]  # [2] number of `rows` in use, and number of rows of `foretold` in use
    prediction: NDArray[np.float64]  # [M, STEPS, 2] m/s; predicted velocities
    averaged: NDArray[np.float64]  # [M, 8] the estimates with the velocities of kernels/tracking/averages.py
    foretold: NDArray[np.float64]  # [M, foretold.COLUMNS] stored predictions and their errors, see kernels/tracking/foretold.py
    pool: NDArray[np.float64]  # [2] errors of all tracks together
    wrong: NDArray[np.float64]  # [M] m/s; standard deviation of the velocity of each track


class Plan(NamedTuple):
    """The plan in use, and the prediction against which it was last tested."""

    knots: NDArray[np.float64]  # [N, 3] rows (t, x, y)
    segments: NDArray[np.float64]  # [P, 8]
    state: NDArray[np.float64]  # [7] see COUNT and the others above


@kernel
def _as_foreseen(estimates: NDArray[np.float64], now: float, age: float, segments: NDArray[np.float64]) -> bool:
    """Tell whether all obstacles of an earlier prediction are now at their predicted places with their predicted velocities.

    New obstacles do not count, because they make no path faster.
    """
    for p in range(len(segments)):
        since = segments[p, records.T0]
        if since <= now < segments[p, records.T1]:
            ux, uy = segments[p, records.VX], segments[p, records.VY]
            x, y = segments[p, records.X] + ux * (now - since), segments[p, records.Y] + uy * (now - since)
            for k in range(len(estimates)):
                vx, vy = estimates[k, VX], estimates[k, VY]
                off = max(abs(estimates[k, X] + vx * age - x), abs(estimates[k, Y] + vy * age - y))
                if max(off, abs(vx - ux), abs(vy - uy)) < _SAME:
                    break
            else:
                return False
    return True


@kernel
def _grazes(knots: NDArray[np.float64], now: float, predictions: Predictions) -> bool:
    """Tell whether a plan in conflict only lacks up to _GRAZE m of clearance, and not within _SOON s.

    The prediction may well have changed by then, so such a plan can be kept for now.
    """
    spared = predictions.segments.copy()
    for p in range(len(spared)):
        if spared[p, records.T0] > now + _SOON - 1e-9:
            narrow = spared[p, records.CLEARANCE_RADIUS] - _GRAZE
            spared[p, records.CLEARANCE_RADIUS] = max(narrow, spared[p, records.CONTACT_RADIUS])
    return first_conflict(knots, now, Predictions(spared, predictions.stopping_time, predictions.work)) == math.inf


@kernel
def _still_good(settings: Settings, plan: Plan, predictions: Predictions, now: float, x: float, y: float) -> tuple[bool, bool]:
    """Tell whether the plan in use is free of conflicts, and if not, whether it only grazes an obstacle."""
    n = int(plan.state[COUNT])
    far = plan.knots[n - 1, 0] if n > 0 else now
    if far <= now + settings.dt or (far <= now + settings.horizon - 1e-6 and far <= plan.state[ARRIVAL] - 1e-6):
        return False, False  # the plan has ended, or ends before the horizon without reaching the goal
    px, py, _ = place_at(plan.knots, n, now)
    if math.hypot(px - x, py - y) > settings.tracking_tolerance:
        return False, False
    if first_conflict(plan.knots[:n], now, predictions) == math.inf:
        return True, False
    return False, _grazes(plan.knots[:n], now, predictions)


@kernel
def _follow(context: PlanningContext, settings: Settings, plan: Plan, now: float, x: float, y: float) -> tuple[float, float]:
    """Return the velocity (vx, vy) that brings the robot onto the plan within one control period."""
    n, dt = int(plan.state[COUNT]), settings.dt
    tx, ty, knot = place_at(plan.knots, n, now + dt)
    end, ex, ey = plan.knots[n - 1, 0] - settings.colony.stay, plan.knots[n - 1, 1], plan.knots[n - 1, 2]
    # The plan ends at the centre of the goal's cell. Go straight to the goal from there, or earlier if the centre is a detour.
    beyond = math.hypot(ex - settings.goal_x, ey - settings.goal_y)
    back = math.hypot(x - settings.goal_x, y - settings.goal_y) < beyond < 3.0 * context.resolution
    if end <= now + dt or (back and end <= now + dt + math.hypot(ex - x, ey - y) / context.speed):
        tx, ty = settings.goal_x, settings.goal_y
    if not clear(context, x, y, tx, ty):  # the chord would cut a corner at a wall, so go to the corner first
        _, _, knot = place_at(plan.knots, n, now)
        tx, ty = plan.knots[knot, 1], plan.knots[knot, 2]
    vx, vy = (tx - x) / dt, (ty - y) / dt
    speed = math.hypot(vx, vy)
    if speed > context.speed:
        vx, vy = vx * context.speed / speed, vy * context.speed / speed
    return vx, vy


@kernel
def _look(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    settings: Settings,
    plan: Plan,
    predictions: Predictions,
    now: float,
    xy: tuple[float, float],
    limit: float,
    budget: int,
    state: State,
) -> bool:
    """Let the ants look for a plan that costs less than `limit` s; if they find one, it becomes the plan in use."""
    (x, y), horizon = xy, now + settings.horizon
    end, cost, plan.state[BOUND] = search(
        memory, trails, context, predictions, settings.colony, x, y, now, horizon, limit, budget, state
    )
    if end < 0:
        return False
    m = trace_back(memory, context, predictions, x, y, end, horizon, horizon + settings.horizon, memory.knots)
    late = memory.knots[m - 1, 0]
    arrival = cost
    if settings.colony.distance_weight > 0.0:
        rest = context.field[memory.cell[end]]
        arrival -= memory.toll[end] + settings.colony.distance_weight * context.speed * rest
    n = shorten(context, predictions, memory.knots, m, plan.knots)
    plan.state[COUNT], plan.state[ARRIVAL] = n, arrival - (late - plan.knots[n - 1, 0])
    if settings.colony.stay > 0.0 and memory.cell[end] == context.goal and n < len(plan.knots):
        copy_row(plan.knots[n - 1], plan.knots[n])
        plan.knots[n, 0] += settings.colony.stay
        plan.state[COUNT] += 1
    plan.state[PLANNED] += 1
    evaporate(trails, now, settings.low, settings.high, plan.state[PLANNED])
    return True


@kernel
def _owed(context: PlanningContext, settings: Settings, plan: Plan, now: float) -> float:
    """Return the cost of the remaining distance of the plan in use to the goal, in addition to its time, s."""
    n = int(plan.state[COUNT])
    if settings.colony.distance_weight == 0.0 or n == 0:
        return 0.0
    x, y, knot = place_at(plan.knots, n, now)
    metres = max(plan.state[ARRIVAL] - plan.knots[n - 1, 0], 0.0) * context.speed
    for i in range(knot, n):
        metres += math.hypot(plan.knots[i, 1] - x, plan.knots[i, 2] - y)
        x, y = plan.knots[i, 1], plan.knots[i, 2]
    return float(settings.colony.distance_weight * metres)


@kernel
def cycle(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    terrain: Terrain,
    settings: Settings,
    plan: Plan,
    crowd: Crowd,
    estimates: NDArray[np.float64],
    now: float,
    age: float,
    xy: tuple[float, float],
    state: State,
) -> tuple[float, float, int, float, float]:
    """Return (vx, vy, what the cycle did with the plan, the plan's arrival, a lower bound on any arrival).

    Arrivals are absolute times in s. The `estimates` are those of kernels/tracking/kalman.py, `age` s old.
    """
    s, (x, y), averaged = settings, xy, crowd.averaged[: len(estimates)]
    # Compare earlier predictions with what happened, and predict all obstacles.
    wrong, seen = crowd.wrong[: len(estimates)], now - age
    crowd.known[1] = compared(crowd.foretold, crowd.known[1], crowd.pool, averaged, seen, wrong)
    worth = 0.0
    if s.roomy.robot_radius > 0.0 and len(estimates) > 0:
        copy_row(wrong, averaged[:, SIGMA_V])
        worth = s.spare_worth * wrong.mean()
    crowd.known[0] = foresee(crowd.rows, crowd.known[0], estimates, seen, s.preferred_speed, crowd.prediction)
    foreseen = _as_foreseen(averaged, now, age, plan.segments[: int(plan.state[FORESEEN])])
    trajectories = crowd.prediction[: len(estimates)]
    count = predict(averaged, now, age, s.horizon, x, y, s.tubes, terrain, trajectories, plan.segments)
    if s.judged:
        foretell(crowd.foretold, crowd.known[1], estimates, seen, plan.segments[:count])
    plan.state[FORESEEN] = count
    predictions = Predictions(plan.segments[:count], time_shift(s.tubes), np.empty(2))
    # Test the plan in use. Look for a better one: first with additional clearance, then with the margins, last without them.
    valid, grazes = _still_good(s, plan, predictions, now, x, y)
    found, memory.counter[EXPANSIONS] = False, 0
    plan.state[SPENT] = max(plan.state[SPENT] - _FORGETS * s.dt, 0.0)
    if not (valid and foreseen and now < plan.state[LOOK] - 1e-9):
        spare, budget = False, s.improvement_expansions if valid else s.expansions
        if worth > _LITTLE and count > 0:
            count = predict(averaged, now, age, s.horizon, x, y, s.roomy, terrain, trajectories, memory.segments)
            roomy = Predictions(memory.segments[:count], time_shift(s.roomy), np.empty(2))
            spare, _ = _still_good(s, plan, roomy, now, x, y)
            before, left = plan.state[ARRIVAL], max(worth - plan.state[SPENT], 0.0)
            limit = before + (-s.hysteresis if spare else left) if valid or grazes else math.inf
            limit += _owed(context, s, plan, now)
            found = _look(memory, trails, context, s, plan, roomy, now, xy, limit, budget, state)
            if found and (valid or grazes):
                plan.state[SPENT] += max(plan.state[ARRIVAL] - before, 0.0)
        limit = plan.state[ARRIVAL] - s.hysteresis if valid else plan.state[ARRIVAL] + _GRACE if grazes else math.inf
        if found or spare:
            limit, budget = plan.state[ARRIVAL] - worth, s.improvement_expansions
        limit += _owed(context, s, plan, now)
        if _look(memory, trails, context, s, plan, predictions, now, xy, limit, budget, state):
            found = True
        plan.state[LOOK] = now + _PAUSE
        if not (found or valid or grazes) and s.bare.robot_radius > 0.0:
            count = predict(averaged, now, age, s.horizon, x, y, s.bare, terrain, trajectories, plan.segments)
            plan.state[FORESEEN] = count
            bare, budget = Predictions(plan.segments[:count], time_shift(s.bare), np.empty(2)), s.expansions // _LAST
            found = _look(memory, trails, context, s, plan, bare, now, xy, math.inf, budget, state)
    what = IMPROVED if found and valid else NEW if found else KEPT if valid or grazes else NONE
    if what == NONE:
        plan.state[COUNT], plan.state[ARRIVAL] = 0, math.inf
        return 0.0, 0.0, NONE, math.inf, plan.state[BOUND]
    vx, vy = _follow(context, s, plan, now, x, y)
    return vx, vy, what, plan.state[ARRIVAL], plan.state[BOUND]
