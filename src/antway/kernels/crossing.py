"""One control cycle of the antway policy in one call: predict, keep or improve the plan, command."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.base.rng import State
from antway.kernels.spacetime.ants import search
from antway.kernels.spacetime.context import PlanningContext, clear
from antway.kernels.spacetime.memory import Memory
from antway.kernels.spacetime.motion import first_conflict, place_at, shorten, trace_back
from antway.kernels.spacetime.pheromone import Trails, evaporate
from antway.kernels.tracking.crowd import foresee
from antway.kernels.tracking.predict import VX, VY, X, Y, predict

KEPT, NEW, IMPROVED, NONE = 0, 1, 2, 3  # what became of the plan
COUNT, ARRIVAL, PLANNED, LOOK, BOUND, FORESEEN = range(6)  # of a plan's state
_PAUSE = 0.25  # s; between looks for a better plan while all goes as foreseen
_SAME = 1e-3  # m, m/s; what is that near to its prediction goes as foreseen
_GRAZE = 0.05  # m; a plan whose berth is short by no more, and that not before
_SOON = 0.5  # s have passed, stays in use unless another is at most
_GRACE = 0.3  # s later


class Settings(NamedTuple):
    """Numbers of the policy; see `AntwayPolicy`."""

    dt: float  # s
    robot_radius: float  # m
    horizon: float  # s
    margin: float  # m
    speed_bound: float  # m/s
    preferred_speed: float  # m/s
    surge_bound: float  # m/s^2
    stopping_time: float  # s
    quantile: float  # 1
    minimum_improvement: float  # s
    hysteresis: float  # s
    tracking_tolerance: float  # m
    expansions: int  # moves tested where there is no plan
    improvement_expansions: int  # and where there is one
    amount: float  # Q of the deposit Q / L, s
    leg_cells: int  # cells
    low: float  # persistence
    high: float
    goal_x: float  # m
    goal_y: float
    betas: NDArray[np.float64]
    slack: NDArray[np.float64]


class Crowd(NamedTuple):
    """What is known of those who avoid one another, and where they will go; see kernels/tracking/crowd.py."""

    rows: NDArray[np.float64]
    known: NDArray[np.int64]  # [1] rows in use
    prediction: NDArray[np.float64]


class Plan(NamedTuple):
    """The plan in use.

    Its knots are (t, x, y); its state is [number of knots, arrival at the goal in s, cycles planned, when to look for a better
    one though all goes as foreseen, what the last look found to be a bound on any arrival, pieces foreseen].
    """

    knots: NDArray[np.float64]
    scratch: NDArray[np.float64]
    state: NDArray[np.float64]


@kernel
def _as_foreseen(estimates: NDArray[np.float64], now: float, age: float, segments: NDArray[np.float64]) -> bool:
    """Tell whether all that an earlier prediction, `segments`, is about are where they were to be now, and move as they were to.

    Others may have come: they make no way faster.
    """
    for p in range(len(segments)):
        if segments[p, 0] <= now < segments[p, 1]:
            x, y = (
                segments[p, 2] + segments[p, 4] * (now - segments[p, 0]),
                segments[p, 3] + segments[p, 5] * (now - segments[p, 0]),
            )
            for k in range(len(estimates)):
                vx, vy = estimates[k, VX], estimates[k, VY]
                off = max(abs(estimates[k, X] + vx * age - x), abs(estimates[k, Y] + vy * age - y))
                if max(off, abs(vx - segments[p, 4]), abs(vy - segments[p, 5])) < _SAME:
                    break
            else:
                return False
    return True


@kernel
def _grazes(
    knots: NDArray[np.float64], now: float, segments: NDArray[np.float64], stopping_time: float, work: NDArray[np.float64]
) -> bool:
    """Tell whether a plan that is in conflict only grazes what is foreseen: a few centimetres may well come right by then."""
    spared = segments.copy()
    for p in range(len(spared)):
        if spared[p, 0] > now + _SOON - 1e-9:
            spared[p, 7] = max(spared[p, 7] - _GRAZE, spared[p, 6])
    return first_conflict(knots, now, spared, stopping_time, work) == math.inf


@kernel
def cycle(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    settings: Settings,
    plan: Plan,
    crowd: Crowd,
    estimates: NDArray[np.float64],
    now: float,
    age: float,
    x: float,
    y: float,
    frame: NDArray[np.float64],
    segments: NDArray[np.float64],
    state: State,
) -> tuple[float, float, int, float, float]:
    """Return (vx, vy, what became of the plan, its arrival, a lower bound on any arrival).

    Arrivals are absolute, s; `estimates` are as kernels/tracking/kalman.py leaves them, `age` s old; `segments` is room for the prediction.
    """
    s = settings
    crowd.known[0] = foresee(crowd.rows, crowd.known[0], estimates, now - age, s.preferred_speed, crowd.prediction)
    foreseen = _as_foreseen(estimates, now, age, segments[: int(plan.state[FORESEEN])])
    count = predict(
        estimates,
        now,
        age,
        s.horizon,
        x,
        y,
        s.robot_radius,
        s.margin,
        s.speed_bound,
        s.surge_bound,
        s.stopping_time,
        s.quantile,
        context.blocked,
        frame,
        crowd.prediction[: len(estimates)],
        segments,
    )
    plan.state[FORESEEN] = count
    ahead = segments[:count]
    work = np.empty(2)
    n = int(plan.state[COUNT])
    valid = grazes = False
    far = plan.knots[n - 1, 0] if n > 0 else now
    if far > now + s.dt and (far > now + s.horizon - 1e-6 or far > plan.state[ARRIVAL] - 1e-6):  # it sees as far as it can
        px, py, _ = place_at(plan.knots, n, now)
        on_course = math.hypot(px - x, py - y) <= s.tracking_tolerance
        valid = on_course and first_conflict(plan.knots[:n], now, ahead, s.stopping_time, work) == math.inf
        grazes = on_course and not valid and _grazes(plan.knots[:n], now, ahead, s.stopping_time, work)
    limit = plan.state[ARRIVAL] - s.hysteresis if valid else plan.state[ARRIVAL] + _GRACE if grazes else math.inf
    horizon = now + s.horizon
    end = -1
    memory.counter[2] = 0
    if not (valid and foreseen and now < plan.state[LOOK] - 1e-9):
        end, arrival, plan.state[BOUND] = search(
            memory,
            trails,
            context,
            ahead,
            s.stopping_time,
            x,
            y,
            now,
            horizon,
            s.leg_cells,
            s.betas,
            s.slack,
            s.minimum_improvement,
            limit,
            s.improvement_expansions if valid else s.expansions,
            s.amount,
            state,
        )
        plan.state[LOOK] = now + _PAUSE
    what = KEPT if valid or grazes else NONE
    if end >= 0:
        what = IMPROVED if valid else NEW
        m = trace_back(memory, context, ahead, s.stopping_time, x, y, end, horizon, horizon + s.horizon, plan.scratch)
        late = plan.scratch[m - 1, 0]
        n = shorten(context, ahead, s.stopping_time, plan.scratch, m, plan.knots)
        plan.state[COUNT], plan.state[ARRIVAL] = n, arrival - (late - plan.knots[n - 1, 0])
        plan.state[PLANNED] += 1
        evaporate(trails, now, s.low, s.high, plan.state[PLANNED])
    elif what == NONE:
        plan.state[COUNT], plan.state[ARRIVAL] = 0, math.inf
        return 0.0, 0.0, NONE, math.inf, plan.state[BOUND]
    tx, ty, knot = place_at(plan.knots, n, now + s.dt)
    if plan.knots[n - 1, 0] <= now + s.dt:  # the plan ends at the goal's cell; the goal itself is a little way off
        tx, ty = s.goal_x, s.goal_y
    if not clear(context, x, y, tx, ty):  # the chord cuts a corner of the plan that hugs a wall: go to the corner
        _, _, knot = place_at(plan.knots, n, now)
        tx, ty = plan.knots[knot, 1], plan.knots[knot, 2]
    vx, vy = (tx - x) / s.dt, (ty - y) / s.dt
    speed = math.hypot(vx, vy)
    if speed > context.speed:
        vx, vy = vx * context.speed / speed, vy * context.speed / speed
    return vx, vy, what, plan.state[ARRIVAL], plan.state[BOUND]
