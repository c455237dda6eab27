"""One control cycle of the antway policy in one call: predict, keep or improve the plan, command."""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base import records
from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import inner_kernel, kernel
from antway.kernels.base.records import Predictions, Terrain
from antway.kernels.base.rng import State
from antway.kernels.base.rows import copy_row
from antway.kernels.spacetime.ants import AntSettings, search
from antway.kernels.spacetime.context import PlanningContext, clear
from antway.kernels.spacetime.memory import EXPANSIONS, Memory
from antway.kernels.spacetime.motion import first_conflict, place_at, shorten, trace_back
from antway.kernels.spacetime.pheromone import Trails, evaporate
from antway.kernels.tracking.crowd import foresee
from antway.kernels.tracking.curves import Turning, predict_turns, turn_rates
from antway.kernels.tracking.predict import SIGMA_V, VX, VY, TubeMargins, X, Y, predict, time_shift
from antway.kernels.tracking.prediction_error import compare_predictions, store_predictions
from antway.kernels.tracking.scan import TrackEstimates
from antway.kernels.tracking.table import Table

KEPT, NEW, NONE = range(3)  # what a cycle did with the plan
# Entries of `PlanInUse.state`: number of knots, arrival at the goal in s, number of cycles in which a plan was made,
# the time in s before which no better plan is searched for while the obstacles move as predicted, the last lower bound on any
# arrival in s, the number of predicted motion segments, and the time in s that was recently given up for additional clearance.
KNOT_COUNT, ARRIVAL, PLANNED, NEXT_SEARCH, BOUND, SEGMENT_COUNT, DELAY_SPENT = range(7)
_ON_PLAN = 0.02  # m; a robot that is farther from its place on the plan does not follow the plan any more
_DELAY_PER_ERROR = 2.0  # s^2/m; for additional clearance a plan may arrive later by this times the mean velocity error
_LITTLE = 0.01  # s; additional clearance worth less than this is not searched for
_FORGETS = 0.1  # 1; the time given up for clearance is forgotten at this rate, in s a second
_PAUSE = 0.25  # s; the colony searches for a better plan at this interval while the obstacles move as predicted
_SAME = 1e-3  # m and m/s; an obstacle moves as predicted if its place and its velocity differ by less than this
_TOLERATED = 0.05  # m; a plan that lacks at most this much of its clearance radius may be kept for now
_SOON = 0.5  # s; a plan that lacks clearance sooner than this is given up
_LAST = 4  # the search for a plan without margins may take the expansions divided by this
_NEAR_GOAL = 2.0  # m; nearer to the goal's tolerance than this, the robot may go straight into it
_LATER = 0.3  # s; it does so if its plan arrives later than that by more than this
_GRACE = 0.3  # s; a plan that lacks clearance is replaced by one that arrives up to this much later


class PolicySettings(NamedTuple):
    """Numbers of the policy; see `AntwayPolicy`."""

    dt: float  # s
    horizon: float  # s
    stores_predictions: bool  # whether predictions are stored and later compared with what happened
    preferred_speed: float  # m/s
    hysteresis: float  # s
    expansions: int  # most moves tested where there is no plan
    improvement_expansions: int  # most moves tested where there is a plan
    goal_x: float  # m
    goal_y: float  # m
    arrives_within: float  # m; the robot has arrived this far from the goal; 0 if it is to reach the goal itself
    tubes: TubeMargins
    narrow_tubes: TubeMargins  # of the last search, if no path keeps clear of `tubes`; a robot radius of 0 means no such search
    wide_tubes: TubeMargins  # of the search for additional clearance; a robot radius of 0 means that there is none
    colony: AntSettings
    few_moves: AntSettings  # of the search that follows if the expansions were too few; a colony without moves means none


class Crowd(NamedTuple):
    """Estimates and predictions of obstacles; kernels/tracking/crowd.py predicts people who avoid one another."""

    people: Table  # [M, crowd.COLUMNS]
    prediction: Floats  # [M, STEPS, 2] m/s; predicted velocities
    tracks: TrackEstimates  # after the last scan
    turning: Turning
    stored: Table  # [M, prediction_error.COLUMNS] stored predictions and their errors
    pool: Floats  # [2] errors of all tracks together, see kernels/tracking/prediction_error.py
    missed: Ints  # [1] number of predictions of all tracks that missed
    velocity_error: Floats  # [M] m/s; standard deviation of the predicted velocity of each track


class PlanInUse(NamedTuple):
    """The plan in use, and the prediction against which it was last tested."""

    knots: Floats  # [N, 3] rows (t, x, y)
    segments: Floats  # [P, 8]
    state: Floats  # [7] see KNOT_COUNT and the others above


class _Cycle(NamedTuple):
    """What the steps of one control cycle share."""

    memory: Memory
    trails: Trails
    state: State  # of the random generator
    context: PlanningContext
    terrain: Terrain
    settings: PolicySettings
    plan: PlanInUse
    estimates: Floats  # [K, 8] with the velocities and errors that are predicted
    trajectories: Floats  # [K, STEPS, 2] m/s; predicted velocities
    now: float  # s
    age: float  # s, of the estimates
    x: float  # m, of the robot
    y: float  # m


@inner_kernel
def _as_predicted(c: _Cycle) -> bool:
    """Tell whether all obstacles of the last prediction are now at their predicted places with their predicted velocities.

    New obstacles do not count, because they make no path faster.
    """
    segments, estimates = c.plan.segments, c.estimates
    for p in range(int(c.plan.state[SEGMENT_COUNT])):
        since = segments[p, records.T0]
        if since <= c.now < segments[p, records.T1]:
            ux, uy = segments[p, records.VX], segments[p, records.VY]
            x, y = segments[p, records.X] + ux * (c.now - since), segments[p, records.Y] + uy * (c.now - since)
            for k in range(len(estimates)):
                vx, vy = estimates[k, VX], estimates[k, VY]
                distance = max(abs(estimates[k, X] + vx * c.age - x), abs(estimates[k, Y] + vy * c.age - y))
                if max(distance, abs(vx - ux), abs(vy - uy)) < _SAME:
                    break
            else:
                return False
    return True


@inner_kernel
def _predict(c: _Cycle, margins: TubeMargins, out: Floats) -> int:
    """Write the motion segments of the obstacles in tubes with these margins to `out`; return how many there are."""
    return predict(c.estimates, c.now, c.age, c.settings.horizon, c.x, c.y, margins, c.terrain, c.trajectories, out)


@kernel
def _with_less_clearance(predictions: Predictions, now: float) -> Predictions:
    """Return the predictions with clearance radii that are smaller by up to _TOLERATED m in segments that begin in _SOON s.

    Those that begin later have them, too, but none that begins earlier. The prediction may well have changed by then, so a plan
    that is clear of these can be kept for now.
    """
    segments = predictions.segments.copy()
    for p in range(len(segments)):
        if segments[p, records.T0] > now + _SOON - 1e-9:
            less = segments[p, records.CLEARANCE_RADIUS] - _TOLERATED
            segments[p, records.CLEARANCE_RADIUS] = max(less, segments[p, records.CONTACT_RADIUS])
    return Predictions(segments, predictions.stopping_time)


@inner_kernel
def _can_be_followed(c: _Cycle) -> bool:
    """Tell whether the robot is on the plan in use, and the plan leads to the goal or on until the horizon."""
    knots = c.plan.knots[: int(c.plan.state[KNOT_COUNT])]
    end = knots[-1, 0] if len(knots) > 0 else c.now
    if end <= c.now + c.settings.dt or (end <= c.now + c.settings.horizon - 1e-6 and end <= c.plan.state[ARRIVAL] - 1e-6):
        return False
    px, py, _ = place_at(knots, c.now)
    return bool(math.hypot(px - c.x, py - c.y) <= _ON_PLAN)


@inner_kernel
def _is_clear(c: _Cycle, predictions: Predictions) -> bool:
    """Tell whether the plan in use is free of conflicts with the predictions."""
    return first_conflict(c.plan.knots[: int(c.plan.state[KNOT_COUNT])], c.now, predictions) == math.inf


@inner_kernel
def _follow(c: _Cycle) -> tuple[float, float]:
    """Return the velocity (vx, vy) that brings the robot onto the plan within one control period."""
    context, settings, knots, now, x, y = c.context, c.settings, c.plan.knots[: int(c.plan.state[KNOT_COUNT])], c.now, c.x, c.y
    dt = settings.dt
    tx, ty, knot = place_at(knots, now + dt)
    end, ex, ey = knots[-1, 0], knots[-1, 1], knots[-1, 2]
    if settings.colony.stay > 0.0:  # a plan that leads to the goal goes on with the stay there
        end = min(end, c.plan.state[ARRIVAL])
    # The plan ends at the centre of the goal's cell. Go straight to the goal from there, or earlier if the centre is a detour.
    beyond = math.hypot(ex - settings.goal_x, ey - settings.goal_y)
    back = math.hypot(x - settings.goal_x, y - settings.goal_y) < beyond < 3.0 * context.resolution
    if end <= now + dt or (back and end <= now + dt + math.hypot(ex - x, ey - y) / context.speed):
        tx, ty = settings.goal_x, settings.goal_y
    if not clear(context, x, y, tx, ty):  # the chord would cut a corner at a wall, so go to the corner first
        _, _, knot = place_at(knots, now)
        tx, ty = knots[knot, 1], knots[knot, 2]
    vx, vy = (tx - x) / dt, (ty - y) / dt
    speed = math.hypot(vx, vy)
    if speed > context.speed:
        vx, vy = vx * context.speed / speed, vy * context.speed / speed
    return vx, vy


@kernel
def _search(c: _Cycle, colony: AntSettings, predictions: Predictions, limit: float, budget: int) -> bool:
    """Let the ants search for a plan that costs less than `limit` s; if they find one, it becomes the plan in use."""
    memory, trails, context, settings, plan = c.memory, c.trails, c.context, c.settings, c.plan
    horizon = c.now + settings.horizon
    found = search(memory, trails, context, predictions, colony, c.x, c.y, c.now, horizon, limit, budget, c.state)
    end, cost, plan.state[BOUND] = found
    if end < 0:
        return False
    m = trace_back(memory, context, predictions, c.x, c.y, end, horizon, horizon + settings.horizon, memory.knots)
    traced_end = memory.knots[m - 1, 0]
    arrival = cost
    if settings.colony.distance_weight > 0.0:
        rest = context.field[memory.cell[end]]
        arrival -= memory.distance_cost[end] + settings.colony.distance_weight * context.speed * rest
    n = shorten(context, predictions, memory.knots[:m], plan.knots)
    plan.state[KNOT_COUNT], plan.state[ARRIVAL] = n, arrival - (traced_end - plan.knots[n - 1, 0])
    if settings.colony.stay > 0.0 and memory.cell[end] == context.goal and n < len(plan.knots):
        copy_row(plan.knots[n - 1], plan.knots[n])
        plan.knots[n, 0] += settings.colony.stay
        plan.state[KNOT_COUNT] += 1
    plan.state[PLANNED] += 1
    evaporate(trails, c.now, plan.state[PLANNED])
    return True


@inner_kernel
def _distance_cost(c: _Cycle) -> float:
    """Return the cost of the remaining distance of the plan in use to the goal, in addition to its time, s."""
    knots, weight = c.plan.knots[: int(c.plan.state[KNOT_COUNT])], c.settings.colony.distance_weight
    if weight == 0.0 or len(knots) == 0:
        return 0.0
    x, y, knot = place_at(knots, c.now)
    metres = max(c.plan.state[ARRIVAL] - knots[-1, 0], 0.0) * c.context.speed
    for i in range(knot, len(knots)):
        metres += math.hypot(knots[i, 1] - x, knots[i, 2] - y)
        x, y = knots[i, 1], knots[i, 2]
    return float(weight * metres)


@kernel
def _replan(c: _Cycle, predictions: Predictions, valid: bool, most_delay: float) -> int:
    """Search for a plan better than the one in use, which may be `valid`; return what was done with the plan.

    The ants search first for a plan with additional clearance, which may arrive up to `most_delay` s later, then for one that
    keeps the margins, and last, if there is no plan, for one without margins.
    """
    s, plan, memory = c.settings, c.plan, c.memory
    on_plan = _can_be_followed(c)
    usable = valid or (on_plan and _is_clear(c, _with_less_clearance(predictions, c.now)))
    found, is_wide, budget = False, False, s.improvement_expansions if valid else s.expansions
    if most_delay > _LITTLE and len(predictions.segments) > 0:
        count = _predict(c, s.wide_tubes, memory.segments)
        wide = Predictions(memory.segments[:count], time_shift(s.wide_tubes))
        is_wide = on_plan and _is_clear(c, wide)
        limit, before = math.inf, plan.state[ARRIVAL]
        if usable:
            limit = before + (-s.hysteresis if is_wide else max(most_delay - plan.state[DELAY_SPENT], 0.0))
        found = _search(c, s.colony, wide, limit + _distance_cost(c), budget)
        if found and usable:
            plan.state[DELAY_SPENT] += max(plan.state[ARRIVAL] - before, 0.0)
    limit = plan.state[ARRIVAL] - s.hysteresis if valid else plan.state[ARRIVAL] + _GRACE if usable else math.inf
    if found or is_wide:
        limit, budget = plan.state[ARRIVAL] - most_delay, s.improvement_expansions
    if _search(c, s.colony, predictions, limit + _distance_cost(c), budget):
        found = True
    plan.state[NEXT_SEARCH] = c.now + _PAUSE
    if not (found or usable) and s.few_moves.moves and memory.counter[EXPANSIONS] >= budget:
        found = _search(c, s.few_moves, predictions, math.inf, budget)
    if not (found or usable) and s.narrow_tubes.robot_radius > 0.0:
        count = _predict(c, s.narrow_tubes, plan.segments)
        plan.state[SEGMENT_COUNT] = count
        narrow = Predictions(plan.segments[:count], time_shift(s.narrow_tubes))
        found = _search(c, s.colony, narrow, math.inf, s.expansions // _LAST)
    return NEW if found else KEPT if usable else NONE


@inner_kernel
def _goes_straight_in(c: _Cycle) -> bool:
    """Tell whether a straight path into the goal's tolerance is free, while the plan arrives later, and make it the plan.

    Somebody beside the goal may leave room within the tolerance, though not at the goal's node.
    """
    s, knots = c.settings, c.memory.knots
    dx, dy = s.goal_x - c.x, s.goal_y - c.y
    away = math.hypot(dx, dy)
    arrival = c.now + away / c.context.speed
    if not 0.0 < away - s.arrives_within < _NEAR_GOAL or c.plan.state[ARRIVAL] < arrival + _LATER:
        return False
    share = 1.0 - s.arrives_within / away
    knots[0, 0], knots[0, 1], knots[0, 2] = c.now, c.x, c.y
    knots[1, 0], knots[1, 1], knots[1, 2] = c.now + share * away / c.context.speed, c.x + share * dx, c.y + share * dy
    if not clear(c.context, c.x, c.y, knots[1, 1], knots[1, 2]):
        return False
    count = _predict(c, s.tubes, c.memory.segments)  # those of the plan may be without margins by now
    if first_conflict(knots[:2], c.now, Predictions(c.memory.segments[:count], time_shift(s.tubes))) < math.inf:
        return False
    copy_row(knots[0], c.plan.knots[0])
    copy_row(knots[1], c.plan.knots[1])
    c.plan.state[KNOT_COUNT], c.plan.state[ARRIVAL] = 2, knots[1, 0]
    return True


@kernel
def cycle(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    terrain: Terrain,
    settings: PolicySettings,
    plan: PlanInUse,
    crowd: Crowd,
    known: int,
    now: float,
    scanned: float,
    xy: tuple[float, float],
    state: State,
) -> tuple[float, float, int]:
    """Return the velocity (vx, vy) that the robot is to take, m/s, and what the cycle did with the plan.

    The tracks are the first `known` rows of `crowd.tracks`, at the time `scanned`, s, of the last scan.
    """
    s, n, age, most_delay = settings, known, now - scanned, 0.0
    estimates, seen, averaged = crowd.tracks.estimates[:n], crowd.tracks.seen[:n], crowd.tracks.averaged[:n]
    velocity_error = crowd.velocity_error[:n]
    # Compare earlier predictions with what happened.
    turn_rates(crowd.turning, estimates, seen, averaged, crowd.tracks.changes[:n], scanned)
    compare_predictions(crowd.stored, crowd.pool, crowd.missed, averaged, seen, scanned, velocity_error)
    if s.wide_tubes.robot_radius > 0.0 and n > 0:
        copy_row(velocity_error, averaged[:, SIGMA_V])
        most_delay = _DELAY_PER_ERROR * velocity_error.mean()
    # Predict all obstacles.
    foresee(crowd.people, estimates, seen, scanned, s.preferred_speed, crowd.prediction)
    predict_turns(estimates, crowd.turning.rate, crowd.prediction)
    c = _Cycle(memory, trails, state, context, terrain, s, plan, averaged, crowd.prediction[:n], now, age, xy[0], xy[1])
    as_predicted = _as_predicted(c)
    count = _predict(c, s.tubes, plan.segments)
    plan.state[SEGMENT_COUNT] = count
    predictions = Predictions(plan.segments[:count], time_shift(s.tubes))
    if s.stores_predictions:
        store_predictions(crowd.stored, estimates, scanned, predictions.segments)
    # Keep the plan or search for a better one, and follow it.
    valid = _can_be_followed(c) and _is_clear(c, predictions)
    memory.counter[EXPANSIONS] = 0
    plan.state[DELAY_SPENT] = max(plan.state[DELAY_SPENT] - _FORGETS * s.dt, 0.0)
    what = KEPT
    if not (valid and as_predicted and now < plan.state[NEXT_SEARCH] - 1e-9):
        what = _replan(c, predictions, valid, most_delay)
    if what == NONE:
        plan.state[KNOT_COUNT], plan.state[ARRIVAL] = 0, math.inf
    if s.arrives_within > 0.0 and _goes_straight_in(c):
        what = NEW
    if what == NONE:
        return 0.0, 0.0, NONE
    vx, vy = _follow(c)
    return vx, vy, what
