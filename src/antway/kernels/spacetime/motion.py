"""Motions as knots (t, x, y): read from the colony's memory, tested for conflicts, and shortened by any-angle shortcuts."""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel, shared_kernel
from antway.kernels.base.records import T0, T1, VX, VY, Predictions, X, Y
from antway.kernels.spacetime.context import PlanningContext, can_stay, centre, clear
from antway.kernels.spacetime.memory import STATE_COUNT, Memory
from antway.kernels.spacetime.segments import TOUCH, earliest_departure

LOOK = 10  # a shortcut leads at most this many vertices ahead
_SAMPLES = 100  # number of steps into which `passing` divides the time span


@bare_kernel
def _append(knots: Floats, n: int, t: float, x: float, y: float) -> int:
    """Write the knot (t, x, y) behind the first n; return the new number of knots."""
    knots[n, 0], knots[n, 1], knots[n, 2] = t, x, y
    return n + 1


@shared_kernel
def trace_back(
    memory: Memory,
    context: PlanningContext,
    predictions: Predictions,
    x: float,
    y: float,
    end: int,
    horizon: float,
    until: float,
    out: Floats,
) -> int:
    """Write the path to state `end` and along the field as knots (t, x, y), including waits; return the number of knots.

    Each departure becomes the earliest safe one, because arrivals may have become earlier since the move was tried. After
    `end`, where obstacles are ignored, the path follows the field to the goal or until time `until`.
    """
    chain = np.empty(memory.counter[STATE_COUNT], np.int32)  # no path has more states than there are
    length = 0
    s = end
    while s >= 0:
        chain[length] = s
        length += 1
        s = memory.parent[s]
    t = memory.arrival[chain[length - 1]]
    n = _append(out, 0, t, x, y)
    for i in range(length - 2, -1, -1):
        c = chain[i]
        px, py = out[n - 1, 1], out[n - 1, 2]
        gx, gy = centre(context, memory.cell[c])
        duration = math.hypot(gx - px, gy - py) / context.speed
        if duration == 0.0:
            continue
        limit = memory.depart[c]
        vx, vy = (gx - px) / duration, (gy - py) / duration
        depart = earliest_departure(px, py, vx, vy, duration, max(t, memory.low[c] - duration), limit, predictions)
        depart = min(depart, limit)
        if depart > t + TOUCH:
            n = _append(out, n, depart, px, py)
        t = depart + duration
        n = _append(out, n, t, gx, gy)
        if n + 3 > len(out):
            return n
    cell = memory.cell[end]
    if cell != context.goal and t < horizon:
        t = horizon
        n = _append(out, n, t, out[n - 1, 1], out[n - 1, 2])
    while cell >= 0 and cell != context.goal and t < until and n < len(out):
        move = _down_the_field(context, cell)
        if move < 0:
            break
        cell += context.offset[move]
        t += context.step[move, 2]
        n = _append(out, n, t, *centre(context, cell))
    return n


@bare_kernel
def _down_the_field(context: PlanningContext, cell: int) -> int:
    """Return the move from `cell` on which the goal is reached soonest without moving obstacles, or -1 if no move is legal."""
    least, move = math.inf, -1
    for k in range(len(context.offset)):
        if (context.legal[cell] >> np.uint32(k)) & np.uint32(1):
            cost = context.step[k, 2] + context.field[cell + context.offset[k]]
            if cost < least:
                least, move = cost, k
    return move


@kernel
def first_conflict(knots: Floats, now: float, predictions: Predictions) -> float:
    """Return the start of the first leg or wait after `now` that meets an obstacle, s; infinite if none does."""
    for i in range(len(knots) - 1):
        t0, t1 = max(float(knots[i, 0]), now), float(knots[i + 1, 0])
        if t1 <= t0:
            continue
        span = knots[i + 1, 0] - knots[i, 0]
        vx, vy = (knots[i + 1, 1] - knots[i, 1]) / span, (knots[i + 1, 2] - knots[i, 2]) / span
        x, y = knots[i, 1] + vx * (t0 - knots[i, 0]), knots[i, 2] + vy * (t0 - knots[i, 0])
        if vx == 0.0 and vy == 0.0:
            if not can_stay(x, y, t0, t1, predictions.segments):
                return t0
        elif earliest_departure(x, y, vx, vy, t1 - t0, t0, t0, predictions) == math.inf:
            return t0
    return math.inf


@kernel
def place_at(knots: Floats, t: float) -> tuple[float, float, int]:
    """Return the place (x, y) on a motion at time t, and the index of the next knot."""
    n = len(knots)
    if t <= knots[0, 0]:
        return knots[0, 1], knots[0, 2], min(1, n - 1)
    for i in range(1, n):
        if t < knots[i, 0]:
            s = (t - knots[i - 1, 0]) / (knots[i, 0] - knots[i - 1, 0])
            x, y = knots[i - 1, 1], knots[i - 1, 2]
            return x + s * (knots[i, 1] - x), y + s * (knots[i, 2] - y), i
    return knots[n - 1, 1], knots[n - 1, 2], n - 1


@kernel
def passing(knots: Floats, segments: Floats, now: float, until: float) -> tuple[float, float, float, float]:
    """Return the robot's place relative to an obstacle when the two are nearest, and the obstacle's velocity then.

    The robot is on knots (t, x, y). The `segments` predict the obstacle in order of time. Places are sampled from `now` to
    `until` s.
    """
    best, p = (math.inf, 0.0, 0.0, 0.0, 0.0), 0
    for i in range(_SAMPLES + 1):
        t = now + (until - now) * i / _SAMPLES
        while p < len(segments) - 1 and segments[p, T1] <= t:
            p += 1
        x, y, _ = place_at(knots, t)
        x -= segments[p, X] + (t - segments[p, T0]) * segments[p, VX]
        y -= segments[p, Y] + (t - segments[p, T0]) * segments[p, VY]
        if math.hypot(x, y) < best[0]:
            best = math.hypot(x, y), x, y, float(segments[p, VX]), float(segments[p, VY])
    return best[1], best[2], best[3], best[4]


@shared_kernel
def shorten(context: PlanningContext, predictions: Predictions, knots: Floats, out: Floats) -> int:
    """Write to `out` a motion without new conflicts that is nowhere later than `knots`; return its number of knots.

    From each vertex it goes straight to the farthest of the next LOOK vertices that it reaches no later than before, with the
    first safe departure. The robot must be able to stand there until the old departure, so the rest of the motion stays valid.
    """
    n, m = len(knots), 0
    x, y, arrive, depart = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    for i in range(n):
        if m > 0 and knots[i, 1] == x[m - 1] and knots[i, 2] == y[m - 1]:
            depart[m - 1] = knots[i, 0]
            continue
        x[m], y[m], arrive[m], depart[m] = knots[i, 1], knots[i, 2], knots[i, 0], knots[i, 0]
        m += 1
    rows, i, t = _append(out, 0, arrive[0], x[0], y[0]), 0, arrive[0]
    while i < m - 1 and rows + 2 < len(out):
        j = min(i + LOOK, m - 1)
        while True:
            duration = math.hypot(x[j] - x[i], y[j] - y[i]) / context.speed
            leave = math.inf
            if t + duration <= arrive[j] + TOUCH and (j == i + 1 or clear(context, x[i], y[i], x[j], y[j])):
                vx, vy = (x[j] - x[i]) / duration, (y[j] - y[i]) / duration
                leave = earliest_departure(x[i], y[i], vx, vy, duration, t, depart[i], predictions)
            there = leave + duration
            if there <= arrive[j] + TOUCH and can_stay(x[j], y[j], there, depart[j], predictions.segments):
                break
            if j == i + 1:
                leave, duration = depart[i], arrive[j] - depart[i]  # keep the old leg
                break
            j -= 1
        if leave > t + TOUCH:
            rows = _append(out, rows, leave, x[i], y[i])
        t = leave + duration
        rows = _append(out, rows, t, x[j], y[j])
        i = j
    if depart[m - 1] > arrive[m - 1] and i == m - 1:  # keep a wait at the end
        rows = _append(out, rows, depart[m - 1], x[m - 1], y[m - 1])
    return rows
