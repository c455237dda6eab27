"""Local search of orders with time windows: neighbouring parts are swapped, possibly with one reversed, or one is reversed.

A part of an order is a function of its start time: if that is later than `latest`, some stop is late; else the part ends at
max(start + duration, earliest). Parts are joined in constant time, so that a move takes constant time (Savelsbergh, ORSA
Journal on Computing 4, 1992; da Silva, Urrutia, Discrete Optimization 7, 2010). Insertion and Or-opt swap parts of few stops.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base import rng
from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.colony.windows import Ids, Windows, schedule

# Shapes of a move of the places i ... j and j + 1 ... k.
SWAPPED = 0  # the parts i ... j and j + 1 ... k are swapped
FIRST_REVERSED = 1  # they are swapped, and the part that was first is reversed
SECOND_REVERSED = 2  # they are swapped, and the part that was second is reversed
REVERSED = 3  # the part i ... j is reversed where it is


class Part(NamedTuple):
    """A sequence of neighbouring stops."""

    first: int  # its first stop
    last: int  # its last stop
    duration: float  # travel time from the first to the last stop
    earliest: float  # earliest start of service at the last stop
    latest: float  # latest start of service at the first stop such that no stop is late; -inf if some stop is always late


class OrderChange(NamedTuple):
    """A change of an order, see `change`."""

    gain: float  # by how much the order becomes better
    i: int  # place at which the first part begins, -1 if there is no move
    j: int  # place at which the first part ends
    k: int  # place at which the second part ends
    shape: int  # SWAPPED ... REVERSED


class TimedOrder(NamedTuple):
    """An order that is being improved, with its times, which kernels keep up to date."""

    order: Ids  # [n]
    ready: Floats  # [n] start of service at each place
    latest: Floats  # [n] latest start of service at each place such that no later stop is late
    duration: Floats  # [n] travel time from each place to the end
    earliest: Floats  # [n] earliest end of the order from each place on
    copy: Ids  # [n] scratch
    saved: Ids  # [n] scratch
    look: NDArray[np.bool_]  # [n] stops whose moves have to be tried
    state: rng.State  # [1] scratch


class MoveOptions(NamedTuple):
    """Which moves are tried, and how they are valued."""

    makespan: bool  # whether the end time of an order counts instead of its travel time
    longest: int  # largest number of stops in the shorter one of two swapped parts
    least: float  # s; gains up to this may be rounding errors


@kernel
def timed_order(n: int) -> TimedOrder:
    """Return scratch for an order of n stops."""
    order, copy, saved = np.zeros(n, dtype=np.int32), np.zeros(n, dtype=np.int32), np.zeros(n, dtype=np.int32)
    times = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    return TimedOrder(order, *times, copy, saved, np.ones(n, dtype=np.bool_), np.zeros(1, dtype=np.uint64))


@bare_kernel
def single(problem: Windows, stop: int) -> Part:
    """Return the part that is only `stop`."""
    return Part(stop, stop, 0.0, problem.opens[stop], problem.closes[stop])


@bare_kernel
def join(problem: Windows, one: Part, two: Part) -> Part:
    """Return the part `one` followed by the part `two`."""
    step = problem.time[one.last, two.first]
    latest = min(one.latest, two.latest - step - one.duration)
    if one.earliest + step > two.latest:
        latest = -np.inf
    earliest = max(one.earliest + step + two.duration, two.earliest)
    return Part(one.first, two.last, one.duration + step + two.duration, earliest, latest)


@bare_kernel
def refresh(problem: Windows, t: TimedOrder) -> None:
    """Compute the times of the order."""
    schedule(problem.time, problem.opens, problem.closes, t.order, t.ready, t.latest, t.duration, t.earliest)


@bare_kernel
def value(t: TimedOrder, makespan: bool) -> float:
    """Return the travel time of the order, or its end time; of two orders with equal ends the shorter is slightly better."""
    travel = float(t.duration[0])
    return float(t.ready[len(t.order) - 1]) + 1e-6 * travel if makespan else travel


@bare_kernel
def change(t: TimedOrder, move: OrderChange) -> None:
    """Make a move."""
    order, copy, i, j, k = t.order, t.copy, move.i, move.j, move.k
    if move.shape == REVERSED:
        while i < j:
            order[i], order[j] = order[j], order[i]
            i += 1
            j -= 1
        return
    at = i
    for p in range(k - j):
        copy[at] = order[k - p] if move.shape == SECOND_REVERSED else order[j + 1 + p]
        at += 1
    for p in range(j - i + 1):
        copy[at] = order[j - p] if move.shape == FIRST_REVERSED else order[i + p]
        at += 1
    for p in range(i, k + 1):
        order[p] = copy[p]


@bare_kernel
def gain_of(problem: Windows, t: TimedOrder, makespan: bool, i: int, k: int, one: Part, two: Part, least: float) -> float:
    """Return the gain if `one`, then `two` take the places i ... k; -inf if a stop is late or the gain is at most `least`."""
    time, order = problem.time, t.order
    first, between, last = time[order[i - 1], one.first], time[one.last, two.first], time[two.last, order[k + 1]]
    travel = float(t.duration[i - 1] - t.duration[k + 1] - first - one.duration - between - two.duration - last)
    if not makespan and not travel > least:
        return -np.inf
    now = t.ready[i - 1] + first
    if not now <= one.latest:
        return -np.inf
    now = max(now + one.duration, one.earliest) + between
    if not now <= two.latest:
        return -np.inf
    now = max(now + two.duration, two.earliest) + last
    if not now <= t.latest[k + 1]:
        return -np.inf
    if not makespan:
        return travel
    return float(t.ready[len(order) - 1] - max(now + t.duration[k + 1], t.earliest[k + 1])) + 1e-6 * travel


@bare_kernel
def with_noise(gain: float, temperature: float, state: rng.State) -> float:
    """Return `gain` with Gumbel noise, so that the largest is drawn with probability ~ exp(gain / temperature)."""
    if temperature == 0.0 or gain == -np.inf:
        return gain
    return gain - temperature * math.log(-math.log(rng.uniform(state) * (1.0 - 1e-12) + 1e-13))


@inner_kernel
def better(
    problem: Windows, t: TimedOrder, options: MoveOptions, best: OrderChange, i: int, j: int, k: int, shape: int,
    one: Part, two: Part, temperature: float, state: rng.State,
) -> OrderChange:  # fmt: skip
    """Return the better one of `best` and the move (i, j, k, shape), after which the part `one` comes before `two`."""
    least = -np.inf if temperature > 0.0 else best.gain
    gain = with_noise(gain_of(problem, t, options.makespan, i, k, one, two, least), temperature, state)
    return OrderChange(gain, i, j, k, shape) if gain > best.gain else best


@bare_kernel
def best_at(problem: Windows, t: TimedOrder, options: MoveOptions, i: int, temperature: float, state: rng.State) -> OrderChange:
    """Return the best of the moves that begin or end at place i, if it gains more than `options.least`.

    With temperature > 0 a move of any gain is drawn at random, see `with_noise`.
    """
    best = OrderChange(options.least if temperature == 0.0 else -np.inf, -1, 0, 0, 0)
    best = best_swap_after(problem, t, options, i, temperature, state, best)
    best = best_swap_before(problem, t, options, i, temperature, state, best)
    return best_reversal(problem, t, options, i, temperature, state, best)


@inner_kernel
def best_swap_after(
    problem: Windows, t: TimedOrder, options: MoveOptions, i: int, temperature: float, state: rng.State, best: OrderChange
) -> OrderChange:
    """Return the best of `best` and of swapping a short part that begins at place i with a part of any length after it."""
    order, n = t.order, len(t.order)
    forward = backward = single(problem, order[i])
    for j in range(i, min(i + options.longest, n - 2)):
        if j > i:
            alone = single(problem, order[j])
            forward, backward = join(problem, forward, alone), join(problem, alone, backward)
        if forward.latest < 0.0 and backward.latest < 0.0:
            break
        limit = max(forward.latest, backward.latest)
        second = single(problem, order[j + 1])
        for k in range(j + 1, n - 1):
            if k > j + 1:
                second = join(problem, second, single(problem, order[k]))
            if second.latest < 0.0 or second.earliest > limit:
                break
            if forward.latest >= 0.0:
                best = better(problem, t, options, best, i, j, k, SWAPPED, second, forward, temperature, state)
            if j > i and backward.latest >= 0.0:
                best = better(problem, t, options, best, i, j, k, FIRST_REVERSED, second, backward, temperature, state)
    return best


@inner_kernel
def best_swap_before(
    problem: Windows, t: TimedOrder, options: MoveOptions, i: int, temperature: float, state: rng.State, best: OrderChange
) -> OrderChange:
    """Return the best of `best` and of swapping a short part that ends at place i with a part before it that is longer."""
    order = t.order
    forward = backward = single(problem, order[i])
    for j in range(i - 1, max(i - options.longest, 1) - 1, -1):
        if j < i - 1:
            alone = single(problem, order[j + 1])
            forward, backward = join(problem, alone, forward), join(problem, backward, alone)
        if forward.latest < 0.0 and backward.latest < 0.0:
            break
        soonest = min(
            forward.earliest if forward.latest >= 0.0 else np.inf, backward.earliest if backward.latest >= 0.0 else np.inf
        )
        second = single(problem, order[j])
        for h in range(j, 0, -1):
            if h < j:
                second = join(problem, single(problem, order[h]), second)
            if second.latest < soonest:
                break
            if forward.latest >= 0.0 and j - h >= i - j:
                best = better(problem, t, options, best, h, j, i, SWAPPED, forward, second, temperature, state)
            if j < i - 1 and backward.latest >= 0.0:
                best = better(problem, t, options, best, h, j, i, SECOND_REVERSED, backward, second, temperature, state)
    return best


@inner_kernel
def best_reversal(
    problem: Windows, t: TimedOrder, options: MoveOptions, i: int, temperature: float, state: rng.State, best: OrderChange
) -> OrderChange:
    """Return the best of `best` and of reversing a part that begins at place i."""
    order = t.order
    alone = single(problem, order[i])
    between = alone  # the part i + 1 ... j reversed
    for j in range(i + 1, len(order) - 1):
        one = single(problem, order[j])
        between = one if j == i + 1 else join(problem, one, between)
        if between.latest < 0.0 or between.earliest > alone.latest:
            break
        best = better(problem, t, options, best, i, j, j, REVERSED, between, alone, temperature, state)
    return best


@bare_kernel
def make(problem: Windows, t: TimedOrder, move: OrderChange) -> None:
    """Make a move, and mark the stops beside its cuts for another look."""
    change(t, move)
    refresh(problem, t)
    n = len(t.order)
    for cut in (move.i, move.j + 1, move.k + 1, move.i + move.k - move.j):
        for p in (cut - 1, cut):
            if 0 < p < n - 1:
                t.look[t.order[p]] = True


@bare_kernel
def settle(problem: Windows, t: TimedOrder, options: MoveOptions, i: int = 1, looks: int = 2**62) -> int:
    """Make improving moves from place i on, until no marked stop has one; return 0. No stop is late before or after.

    After `looks` stops were looked at, return the place from which another call goes on as if there had been only one.
    """
    n = len(t.order)
    quiet = 0
    while quiet < n - 2:
        if t.look[t.order[i]]:
            if looks == 0:
                return i
            looks -= 1
            move = best_at(problem, t, options, i, 0.0, t.state)
            if move.i >= 0:
                make(problem, t, move)
                quiet = 0
                continue
            t.look[t.order[i]] = False
        quiet += 1
        i = i + 1 if i < n - 2 else 1
    return 0


@bare_kernel
def shake(problem: Windows, t: TimedOrder, options: MoveOptions, temperature: float, state: rng.State) -> None:
    """Make a random move at a random place. No stop is late before or after."""
    i = 1 + rng.below(state, len(t.order) - 2)
    move = best_at(problem, t, options, i, temperature, state)
    if move.i >= 0:
        make(problem, t, move)
