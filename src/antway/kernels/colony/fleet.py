"""Several routes, perhaps through some of the stops only: strings of neighbouring stops are taken out and put back.

Slack induction by string removals (Christiaens, Vanden Berghe, Transportation Science 54, 2020) under simulated annealing.
Stops that fit nowhere stay out at a price.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base import rng
from antway.kernels.base.jit import bare_kernel, kernel

Floats = NDArray[np.float64]
Ids = NDArray[np.int32]
OUT = -1  # route of a stop that is in none
HERE, BEST, WORTH, BEST_COST = range(4)
SHORT, LONG = 10, 10  # stops taken out in a turn on average; the longest string


class Fleet(NamedTuple):
    """n stops, of which 0 is where all routes begin and n - 1 where they end."""

    time: Floats  # [n, n] service and travel, infinite where there is no path
    opens: Floats  # [n] earliest begin of service
    closes: Floats  # [n] latest
    price: Floats  # [n] what it costs in the objective not to visit a stop
    worth: Floats  # [n] priority of a stop: more of it is better, whatever the objective
    near: Ids  # [n, m] the other inner stops, nearest first
    last_weight: float  # what the latest end of a route counts in the objective,
    sum_weight: float  # and the travel time of all


class Routes(NamedTuple):
    """k routes under change; kernels keep the times in step."""

    stops: Ids  # [k, n]
    sizes: Ids  # [k] stops in each, start and end included
    route: Ids  # [n] the route that a stop is in, or OUT
    ready: Floats  # [k, n] begin of service at each place
    latest: Floats  # [k, n] latest begin of service such that nothing after it is late
    duration: Floats  # [k, n] from each place to the end, without waiting
    earliest: Floats  # [k, n] earliest end from each place on
    ends: Floats  # [k] when each route ends,
    travel: Floats  # [k] and how long it travels


@kernel
def routes(n: int, k: int) -> Routes:
    """Return k routes from start to end; `refresh` works out their times."""
    stops = np.zeros((k, n), dtype=np.int32)
    stops[:, 1] = n - 1
    times = np.zeros((k, n)), np.zeros((k, n)), np.zeros((k, n)), np.zeros((k, n))
    return Routes(stops, np.full(k, 2, dtype=np.int32), np.full(n, OUT, dtype=np.int32), *times, np.zeros(k), np.zeros(k))


@bare_kernel
def refresh(fleet: Fleet, r: Routes, k: int) -> None:
    """Work out the times of route k."""
    size, stops = r.sizes[k], r.stops[k]
    r.ready[k, 0] = fleet.opens[0]
    for p in range(1, size):
        r.ready[k, p] = max(r.ready[k, p - 1] + fleet.time[stops[p - 1], stops[p]], fleet.opens[stops[p]])
    end = stops[size - 1]
    r.latest[k, size - 1], r.duration[k, size - 1], r.earliest[k, size - 1] = fleet.closes[end], 0.0, fleet.opens[end]
    for p in range(size - 2, -1, -1):
        step = fleet.time[stops[p], stops[p + 1]]
        r.latest[k, p] = min(fleet.closes[stops[p]], r.latest[k, p + 1] - step)
        r.duration[k, p] = r.duration[k, p + 1] + step
        r.earliest[k, p] = max(fleet.opens[stops[p]] + r.duration[k, p], r.earliest[k, p + 1])
    r.ends[k] = r.ready[k, size - 1]
    r.travel[k] = r.duration[k, 0]


@bare_kernel
def objective(fleet: Fleet, r: Routes) -> tuple[float, float]:
    """Return the price of the stops left out with the weighted times, and the priorities of the others."""
    cost, worth, last = 0.0, 0.0, 0.0
    for k in range(len(r.sizes)):
        cost += fleet.sum_weight * r.travel[k]
        last = max(last, r.ends[k])
    cost += fleet.last_weight * last
    for stop in range(1, len(r.route) - 1):
        if r.route[stop] == OUT:
            cost += fleet.price[stop]
        else:
            worth += fleet.worth[stop]
    return cost, worth


@bare_kernel
def insert(fleet: Fleet, r: Routes, stop: int, state: rng.State) -> bool:
    """Put `stop` where it costs least (one place in a hundred is overlooked); False if it fits nowhere in time."""
    most, second, longest = 0.0, 0.0, -1
    for k in range(len(r.sizes)):
        if r.ends[k] > most:
            most, second, longest = r.ends[k], most, k
        else:
            second = max(second, r.ends[k])
    best, route, place = np.inf, -1, -1
    for k in range(len(r.sizes)):
        others = second if k == longest else most
        if r.sizes[k] == 2 and k > 0 and r.sizes[k - 1] == 2:
            continue  # empty routes are alike
        for p in range(1, r.sizes[k]):
            before, after = r.stops[k, p - 1], r.stops[k, p]
            here = max(r.ready[k, p - 1] + fleet.time[before, stop], fleet.opens[stop])
            if r.ready[k, p - 1] > fleet.closes[stop]:
                break
            if here > fleet.closes[stop]:
                continue
            then = here + fleet.time[stop, after]
            if then > r.latest[k, p]:
                continue
            cost = fleet.sum_weight * (fleet.time[before, stop] + fleet.time[stop, after] - fleet.time[before, after])
            if fleet.last_weight > 0.0:
                end = max(then + r.duration[k, p], r.earliest[k, p])
                cost += fleet.last_weight * (max(others, end) + 0.01 * end)
            if cost < best and rng.next_bits(state) % np.uint64(100) != np.uint64(0):
                best, route, place = cost, k, p
    if route < 0:
        return False
    for p in range(r.sizes[route], place, -1):
        r.stops[route, p] = r.stops[route, p - 1]
    r.stops[route, place] = stop
    r.sizes[route] += 1
    r.route[stop] = route
    refresh(fleet, r, route)
    return True


@bare_kernel
def take_string(fleet: Fleet, r: Routes, k: int, stop: int, length: int, state: rng.State) -> None:
    """Take out `length` stops of route k that stand together around `stop`; in half the cases some between them stay."""
    size = r.sizes[k] - 2
    place = 1
    while r.stops[k, place] != stop:
        place += 1
    spared = 0
    if length < size and rng.uniform(state) < 0.5:
        spared = 1
        while length + spared < size and rng.uniform(state) < 0.99 and spared < length:
            spared += 1
    span = min(length + spared, size)
    low, high = max(1, place - span + 1), min(place, size - span + 1)
    from_place = low + rng.below(state, high - low + 1)
    keep_from = from_place + (rng.below(state, span - spared + 1) if spared > 0 else span)
    at = from_place
    for p in range(from_place, r.sizes[k]):
        out = p < from_place + span and not keep_from <= p < keep_from + spared
        if out:
            r.route[r.stops[k, p]] = OUT
        else:
            r.stops[k, at] = r.stops[k, p]
            at += 1
    r.sizes[k] = at
    refresh(fleet, r, k)


@bare_kernel
def ruin(fleet: Fleet, r: Routes, touched: NDArray[np.bool_], state: rng.State) -> None:
    """Take strings out of routes that pass near a stop drawn."""
    n, routes_used, visited = len(r.route), 0, 0
    for k in range(len(r.sizes)):
        touched[k] = False
        routes_used += r.sizes[k] > 2
        visited += r.sizes[k] - 2
    if routes_used == 0:
        return
    longest = min(float(LONG), visited / routes_used)
    strings = int(1.0 + rng.uniform(state) * (4.0 * SHORT / (1.0 + longest)))
    seed = 1 + rng.below(state, n - 2)
    if fleet.last_weight > 0.0 and rng.uniform(state) < 0.5:
        # What ends last decides.
        last = 0
        for k in range(len(r.sizes)):
            if r.ends[k] > r.ends[last]:
                last = k
        if r.sizes[last] > 2:
            seed = r.stops[last, 1 + rng.below(state, r.sizes[last] - 2)]
    for place in range(-1, fleet.near.shape[1]):
        stop = seed if place < 0 else fleet.near[seed, place]
        k = r.route[stop]
        if k == OUT or touched[k]:
            continue
        touched[k] = True
        length = int(1.0 + rng.uniform(state) * min(float(r.sizes[k] - 2), longest))
        take_string(fleet, r, k, stop, min(length, r.sizes[k] - 2), state)
        strings -= 1
        if strings <= 0:
            return


@bare_kernel
def recreate(fleet: Fleet, r: Routes, absent: Ids, keys: Floats, state: rng.State) -> None:
    """Put the absent stops back, sorted at random, by time to the start, by their windows, or by what they are worth."""
    count = 0
    kind = rng.below(state, 8)
    for stop in range(1, len(r.route) - 1):
        if r.route[stop] != OUT:
            continue
        key = rng.uniform(state)
        if kind == 0:
            key = fleet.time[0, stop]
        elif kind == 1:
            key = -fleet.time[0, stop]
        elif kind == 2:
            key = fleet.closes[stop]
        elif kind == 3:
            key = fleet.closes[stop] - fleet.opens[stop]
        elif kind == 4:
            key = -fleet.price[stop] * (0.5 + key)
        at = count
        while at > 0 and keys[at - 1] > key:
            keys[at], absent[at] = keys[at - 1], absent[at - 1]
            at -= 1
        keys[at], absent[at] = key, stop
        count += 1
    for c in range(count):
        insert(fleet, r, absent[c], state)


@bare_kernel
def copy(fleet: Fleet, source: Routes, target: Routes, times: bool) -> None:
    """Make `target` the same routes as `source`."""
    for k in range(len(source.sizes)):
        target.sizes[k] = source.sizes[k]
        for p in range(source.sizes[k]):
            target.stops[k, p] = source.stops[k, p]
        if times:
            refresh(fleet, target, k)
    for stop in range(len(source.route)):
        target.route[stop] = source.route[stop]


@kernel
def anneal(
    fleet: Fleet,
    r: Routes,
    saved: Routes,
    best: Routes,
    record: Floats,
    seed: np.uint64,
    turns: int,
    temperature: float,
    cooling: float,
) -> None:
    """Ruin and recreate `turns` times, at temperatures from `temperature` on, each `cooling` times the last.

    record : [4] objective of `saved`, priorities of `best` (BEST), priorities of `saved`, objective of `best`.
    """
    state = np.array([seed], dtype=np.uint64)
    n = len(r.route)
    touched, absent, keys = np.zeros(len(r.sizes), dtype=np.bool_), np.zeros(n, dtype=np.int32), np.zeros(n)
    copy(fleet, saved, r, True)
    for _ in range(turns):
        ruin(fleet, r, touched, state)
        recreate(fleet, r, absent, keys, state)
        cost, worth = objective(fleet, r)
        if cost < record[HERE] - temperature * math.log(1.0 - rng.uniform(state)):
            record[HERE], record[WORTH] = cost, worth
            copy(fleet, r, saved, False)
            if worth > record[BEST] or (worth == record[BEST] and cost < record[BEST_COST]):
                record[BEST], record[BEST_COST] = worth, cost
                copy(fleet, r, best, False)
        else:
            copy(fleet, saved, r, True)
        temperature *= cooling


@bare_kernel
def shorten(fleet: Fleet, r: Routes, k: int) -> None:
    """Take stops out of route k until none is late: before the first that is, those that save most time for their price."""
    while r.sizes[k] > 2:
        refresh(fleet, r, k)
        size, stops, late = r.sizes[k], r.stops[k], 0
        while late < size and r.ready[k, late] <= fleet.closes[stops[late]]:
            late += 1
        if late == size:
            return
        best, place = -1.0, min(late, size - 2)
        for p in range(1, min(late, size - 2) + 1):
            saved = fleet.time[stops[p - 1], stops[p]] + fleet.time[stops[p], stops[p + 1]]
            saved = max(0.0, saved - fleet.time[stops[p - 1], stops[p + 1]]) / (fleet.price[stops[p]] + 1e-9)
            if saved > best:
                best, place = saved, p
        r.route[stops[place]] = OUT
        for p in range(place, size - 1):
            stops[p] = stops[p + 1]
        r.sizes[k] -= 1
    refresh(fleet, r, k)


@kernel
def start(fleet: Fleet, r: Routes, seed: np.uint64) -> tuple[float, float]:
    """Insert the stops that are in no route, after those that would be late are out; return objective and priorities."""
    state = np.array([seed], dtype=np.uint64)
    for k in range(len(r.sizes)):
        shorten(fleet, r, k)
    n = len(r.route)
    absent, keys = np.zeros(n, dtype=np.int32), np.zeros(n)
    recreate(fleet, r, absent, keys, state)
    return objective(fleet, r)
