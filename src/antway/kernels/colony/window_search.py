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
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.colony.windows import Floats, Ids, Windows

Part = tuple[float, float, float]  # duration, earliest end, latest start
Found = tuple[float, int, int, int, int]  # gain of a move, and the arguments of `change`


class Trail(NamedTuple):
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


class Moves(NamedTuple):
    """Which moves are tried, and how they are valued."""

    makespan: bool  # whether the end time of an order counts instead of its travel time
    longest: int  # largest number of stops in the shorter one of two swapped parts
    least: float  # s; gains up to this may be rounding errors


@kernel
def trail(n: int) -> Trail:
    """Return scratch for an order of n stops."""
    order, copy, saved = np.zeros(n, dtype=np.int32), np.zeros(n, dtype=np.int32), np.zeros(n, dtype=np.int32)
    times = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
    return Trail(order, *times, copy, saved, np.ones(n, dtype=np.bool_), np.zeros(1, dtype=np.uint64))


@bare_kernel
def join(problem: Windows, one: Part, a: int, b: int, two: Part) -> Part:
    """Return the part `one`, which ends at stop a, followed by `two`, which starts at b; latest is -inf if always late."""
    step = problem.time[a, b]
    latest = min(one[2], two[2] - step - one[0])
    if one[1] + step > two[2]:
        latest = -np.inf
    return one[0] + step + two[0], max(one[1] + step + two[0], two[1]), latest


@bare_kernel
def refresh(problem: Windows, t: Trail) -> None:
    """Compute the times of the order."""
    n = len(t.order)
    t.ready[0] = problem.opens[t.order[0]]
    for p in range(1, n):
        t.ready[p] = max(t.ready[p - 1] + problem.time[t.order[p - 1], t.order[p]], problem.opens[t.order[p]])
    end = t.order[n - 1]
    t.latest[n - 1], t.duration[n - 1], t.earliest[n - 1] = problem.closes[end], 0.0, problem.opens[end]
    for p in range(n - 2, -1, -1):
        i = t.order[p]
        step = problem.time[i, t.order[p + 1]]
        t.latest[p] = min(problem.closes[i], t.latest[p + 1] - step)
        t.duration[p] = t.duration[p + 1] + step
        t.earliest[p] = max(problem.opens[i] + t.duration[p], t.earliest[p + 1])


@bare_kernel
def value(t: Trail, makespan: bool) -> float:
    """Return the travel time of the order, or its end time; of two orders with equal ends the shorter is slightly better."""
    travel = float(t.duration[0])
    return float(t.ready[len(t.order) - 1]) + 1e-6 * travel if makespan else travel


@bare_kernel
def change(t: Trail, i: int, j: int, k: int, shape: int) -> None:
    """Swap the parts at the places i ... j and j + 1 ... k.

    shape : 0 as they are; 1 with the first part reversed; 2 with the second; 3 no swap, but i ... j reversed.
    """
    order, copy = t.order, t.copy
    if shape == 3:
        while i < j:
            order[i], order[j] = order[j], order[i]
            i += 1
            j -= 1
        return
    at = i
    for p in range(k - j):
        copy[at] = order[k - p] if shape == 2 else order[j + 1 + p]
        at += 1
    for p in range(j - i + 1):
        copy[at] = order[j - p] if shape == 1 else order[i + p]
        at += 1
    for p in range(i, k + 1):
        order[p] = copy[p]


@bare_kernel
def gain_of(
    problem: Windows,
    t: Trail,
    habits: Moves,
    i: int,
    k: int,
    one: Part,
    ends: tuple[int, int],
    two: Part,
    others: tuple[int, int],
    least: float,
) -> float:
    """Return the gain if `one` and then `two` take the places i ... k; -inf if a stop is late or the gain is at most `least`.

    ends, others : the first and the last stop of each part.
    """
    time, order = problem.time, t.order
    first, between, last = time[order[i - 1], ends[0]], time[ends[1], others[0]], time[others[1], order[k + 1]]
    travel = float(t.duration[i - 1] - t.duration[k + 1] - first - one[0] - between - two[0] - last)
    if not habits.makespan and not travel > least:
        return -np.inf
    now = t.ready[i - 1] + first
    if not now <= one[2]:
        return -np.inf
    now = max(now + one[0], one[1]) + between
    if not now <= two[2]:
        return -np.inf
    now = max(now + two[0], two[1]) + last
    if not now <= t.latest[k + 1]:
        return -np.inf
    if not habits.makespan:
        return travel
    return float(t.ready[len(order) - 1] - max(now + t.duration[k + 1], t.earliest[k + 1])) + 1e-6 * travel


@bare_kernel
def stirred(gain: float, temperature: float, state: rng.State) -> float:
    """Return `gain` with Gumbel noise, so that the largest is drawn with probability ~ exp(gain / temperature)."""
    if temperature == 0.0 or gain == -np.inf:
        return gain
    return gain - temperature * math.log(-math.log(rng.uniform(state) * (1.0 - 1e-12) + 1e-13))


@inner_kernel
def better(
    problem: Windows, t: Trail, habits: Moves, found: Found, move: tuple[int, int, int, int],
    one: Part, ends: tuple[int, int], two: Part, others: tuple[int, int], temperature: float, state: rng.State,
) -> Found:  # fmt: skip
    """Return the better one of `found` and a move, the arguments of `change`, after which `one` comes before `two`."""
    least = -np.inf if temperature > 0.0 else found[0]
    gain = stirred(gain_of(problem, t, habits, move[0], move[2], one, ends, two, others, least), temperature, state)
    return (gain, *move) if gain > found[0] else found


@bare_kernel
def best_at(problem: Windows, t: Trail, habits: Moves, i: int, temperature: float, state: rng.State) -> Found:
    """Return the best of the moves that begin or end at place i: its gain (more than `least`) and what `change` takes.

    With temperature > 0 it is drawn at random, see `stirred`.
    """
    opens, closes, order = problem.opens, problem.closes, t.order
    n = len(order)
    found = (habits.least if temperature == 0.0 else -np.inf, -1, 0, 0, 0)
    u = order[i]
    # A short part i ... j and a part of any length after it.
    forward = backward = (0.0, opens[u], closes[u])
    for j in range(i, min(i + habits.longest, n - 2)):
        x = order[j]
        if j > i:
            alone = (0.0, opens[x], closes[x])
            forward = join(problem, forward, order[j - 1], x, alone)
            backward = join(problem, alone, x, order[j - 1], backward)
        if forward[2] < 0.0 and backward[2] < 0.0:
            break
        limit = max(forward[2], backward[2])
        w = order[j + 1]
        second = (0.0, opens[w], closes[w])
        for k in range(j + 1, n - 1):
            v = order[k]
            if k > j + 1:
                second = join(problem, second, order[k - 1], v, (0.0, opens[v], closes[v]))
            if second[2] < 0.0 or second[1] > limit:
                break
            if forward[2] >= 0.0:
                found = better(problem, t, habits, found, (i, j, k, 0), second, (w, v), forward, (u, x), temperature, state)
            if j > i and backward[2] >= 0.0:
                found = better(problem, t, habits, found, (i, j, k, 1), second, (w, v), backward, (x, u), temperature, state)
    # A short part j + 1 ... i and a longer one before it.
    forward = backward = (0.0, opens[u], closes[u])
    for j in range(i - 1, max(i - habits.longest, 0) - 1, -1):
        if j < 1:
            break
        x = order[j + 1]
        if j < i - 1:
            alone = (0.0, opens[x], closes[x])
            forward = join(problem, alone, x, order[j + 2], forward)
            backward = join(problem, backward, order[j + 2], x, alone)
        if forward[2] < 0.0 and backward[2] < 0.0:
            break
        soonest = min(forward[1] if forward[2] >= 0.0 else np.inf, backward[1] if backward[2] >= 0.0 else np.inf)
        w = order[j]
        second = (0.0, opens[w], closes[w])
        for h in range(j, 0, -1):
            v = order[h]
            if h < j:
                second = join(problem, (0.0, opens[v], closes[v]), v, order[h + 1], second)
            if second[2] < soonest:
                break
            if forward[2] >= 0.0 and j - h >= i - j:
                found = better(problem, t, habits, found, (h, j, i, 0), forward, (x, u), second, (v, w), temperature, state)
            if j < i - 1 and backward[2] >= 0.0:
                found = better(problem, t, habits, found, (h, j, i, 2), backward, (u, x), second, (v, w), temperature, state)
    return reversal(problem, t, habits, i, temperature, state, found)


@bare_kernel
def reversal(
    problem: Windows,
    t: Trail,
    habits: Moves,
    i: int,
    temperature: float,
    state: rng.State,
    found: Found,
) -> Found:
    """Return the best of `found` and of reversing a part that begins at place i."""
    opens, closes, order = problem.opens, problem.closes, t.order
    u = order[i]
    alone = (0.0, opens[u], closes[u])
    between = alone  # the part i + 1 ... j reversed
    for j in range(i + 1, len(order) - 1):
        v = order[j]
        one = (0.0, opens[v], closes[v])
        between = one if j == i + 1 else join(problem, one, v, order[j - 1], between)
        if between[2] < 0.0 or between[1] > closes[u]:
            break
        found = better(problem, t, habits, found, (i, j, j, 3), between, (v, order[i + 1]), alone, (u, u), temperature, state)
    return found


@bare_kernel
def watch(t: Trail, a: int, j: int, k: int) -> None:
    """Mark the stops beside the cuts of a move for another look."""
    n = len(t.order)
    for cut in (a, j + 1, k + 1, a + k - j):
        for p in (cut - 1, cut):
            if 0 < p < n - 1:
                t.look[t.order[p]] = True


@bare_kernel
def settle(problem: Windows, t: Trail, habits: Moves) -> None:
    """Make improving moves until no marked stop has one. No stop is late before or after."""
    n = len(t.order)
    quiet, i = 0, 1
    while quiet < n - 2:
        if t.look[t.order[i]]:
            _, a, b, c, shape = best_at(problem, t, habits, i, 0.0, t.state)
            if a >= 0:
                change(t, a, b, c, shape)
                refresh(problem, t)
                watch(t, a, b, c)
                quiet = 0
                continue
            t.look[t.order[i]] = False
        quiet += 1
        i = i + 1 if i < n - 2 else 1


@bare_kernel
def shake(problem: Windows, t: Trail, habits: Moves, temperature: float, state: rng.State) -> None:
    """Make a random move at a random place. No stop is late before or after."""
    i = 1 + rng.below(state, len(t.order) - 2)
    _, a, b, c, shape = best_at(problem, t, habits, i, temperature, state)
    if a >= 0:
        change(t, a, b, c, shape)
        refresh(problem, t)
        watch(t, a, b, c)
