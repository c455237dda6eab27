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

KEPT, NEW, IMPROVED, NONE = 0, 1, 2, 3  # what became of the plan
# Entries of `Plan.state`: number of knots, arrival at the goal in s, cycles in which a plan was made, when to look for a better
# one though all goes as foreseen, lower bound on any arrival as last found, number of motion segments predicted, time in s that
# was given of late for room to spare.
COUNT, ARRIVAL, PLANNED, LOOK, BOUND, FORESEEN, SPENT = range(7)
_LITTLE = 0.01  # s; room worth less than this is not looked for
_FORGETS = 0.1  # of the time spent on room, in s a second: who dodges to and fro pays once
_PAUSE = 0.25  # s; while all goes as foreseen the ants look for a better plan only so often
_SAME = 1e-3  # m and m/s; an obstacle goes as foreseen if it is no farther from where it was to be, with that velocity
_GRAZE = 0.05  # m; a plan in conflict stays in use for now if it lacks no more than this of its clearance radius,
_SOON = 0.5  # s; if it does so no sooner than this from now,
_LAST = 4  # part of the expansions of a search that the last one, for a plan without margins, may take
_GRACE = 0.3  # s; and if no other plan arrives before this much later


class Settings(NamedTuple):
    """Numbers of the policy; see `AntwayPolicy`."""

    dt: float  # s
    horizon: float  # s
    judged: bool  # whether it is noted what is foretold, to be compared with what comes
    preferred_speed: float  # m/s
    hysteresis: float  # s
    tracking_tolerance: float  # m
    expansions: int  # moves tested where there is no plan
    improvement_expansions: int  # moves tested where there is a plan
    low: float  # least and greatest persistence of the pheromone
    high: float
    goal_x: float  # m
    goal_y: float
    tubes: TubeMargins
    bare: TubeMargins  # where no path keeps those, one is taken that keeps these; of no robot radius: none is
    roomy: TubeMargins  # a plan that keeps these is better than one that does not; of no robot radius: it is not
    spare_worth: float  # s^2/m; if it arrives no more than this, times how wrong velocities are, later, less what was spent
    colony: ColonySettings


class Crowd(NamedTuple):
    """What is known of obstacles that avoid one another, and where they will go; see kernels/tracking/crowd.py."""

    rows: NDArray[np.float64]  # [M, COLUMNS]
    known: NDArray[np.int64]  # [2] rows in use, and those of `foretold`
    prediction: NDArray[np.float64]  # [M, STEPS, 2] m/s
    averaged: NDArray[np.float64]  # [M, 8] the estimates with the velocities of kernels/tracking/averages.py
    foretold: NDArray[np.float64]  # [M, foretold.COLUMNS] and how well predictions have held: kernels/tracking/foretold.py
    pool: NDArray[np.float64]  # [2]
    wrong: NDArray[np.float64]  # [M] m/s


class Plan(NamedTuple):
    """The plan in use, and what was predicted when it was last tested."""

    knots: NDArray[np.float64]  # [N, 3] rows (t, x, y)
    segments: NDArray[np.float64]  # [P, 8]
    state: NDArray[np.float64]  # [7] see COUNT and the others above


@kernel
def _as_foreseen(estimates: NDArray[np.float64], now: float, age: float, segments: NDArray[np.float64]) -> bool:
    """Tell whether all obstacles of an earlier prediction are where they were to be now, and move as they were to.

    Others may have come: they make no path faster.
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
    """Tell whether a plan in conflict lacks but a few centimetres of room, and not soon: they may well come right by then."""
    spared = predictions.segments.copy()
    for p in range(len(spared)):
        if spared[p, records.T0] > now + _SOON - 1e-9:
            narrow = spared[p, records.CLEARANCE_RADIUS] - _GRAZE
            spared[p, records.CLEARANCE_RADIUS] = max(narrow, spared[p, records.CONTACT_RADIUS])
    return first_conflict(knots, now, Predictions(spared, predictions.stopping_time, predictions.work)) == math.inf


@kernel
def _still_good(settings: Settings, plan: Plan, predictions: Predictions, now: float, x: float, y: float) -> tuple[bool, bool]:
    """Tell whether the plan in use is free of conflicts, and else whether it only grazes what is foreseen."""
    n = int(plan.state[COUNT])
    far = plan.knots[n - 1, 0] if n > 0 else now
    if far <= now + settings.dt or (far <= now + settings.horizon - 1e-6 and far <= plan.state[ARRIVAL] - 1e-6):
        return False, False  # it has ended, or does not see as far as it could
    px, py, _ = place_at(plan.knots, n, now)
    if math.hypot(px - x, py - y) > settings.tracking_tolerance:
        return False, False
    if first_conflict(plan.knots[:n], now, predictions) == math.inf:
        return True, False
    return False, _grazes(plan.knots[:n], now, predictions)


@kernel
def _follow(context: PlanningContext, settings: Settings, plan: Plan, now: float, x: float, y: float) -> tuple[float, float]:
    """Return the velocity (vx, vy) that is on the plan in one control period."""
    n, dt = int(plan.state[COUNT]), settings.dt
    tx, ty, knot = place_at(plan.knots, n, now + dt)
    end, ex, ey = plan.knots[n - 1, 0] - settings.colony.stay, plan.knots[n - 1, 1], plan.knots[n - 1, 2]
    # It leads to the centre of the goal's cell: from there, or if that were a way back, go to the goal.
    beyond = math.hypot(ex - settings.goal_x, ey - settings.goal_y)
    back = math.hypot(x - settings.goal_x, y - settings.goal_y) < beyond < 3.0 * context.resolution
    if end <= now + dt or (back and end <= now + dt + math.hypot(ex - x, ey - y) / context.speed):
        tx, ty = settings.goal_x, settings.goal_y
    if not clear(context, x, y, tx, ty):  # the chord cuts a corner of a plan along a wall: go to the corner
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
    """Send ants for a plan that costs less than `limit` s; one that is found becomes the plan in use."""
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
    """Return what the metres of the plan in use cost from now on to the goal beside their time, s."""
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
    """Return (vx, vy, what became of the plan, its arrival, a lower bound on any arrival).

    Arrivals are absolute, s; `estimates` are as kernels/tracking/kalman.py leaves them, `age` s old.
    """
    s, (x, y), averaged = settings, xy, crowd.averaged[: len(estimates)]
    # See how predictions have held, and predict where everything will be.
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
    # Test the plan in use, and look for a better one: with room to spare first, then with the margins, else without.
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
