"""Several routes, possibly through only some of the stops: strings of neighbouring stops are removed and reinserted.

Slack induction by string removals (Christiaens, Vanden Berghe, Transportation Science 54, 2020) under simulated annealing.
Stops that fit nowhere stay out and cost a price.
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
SHORT, LONG = 10, 10  # average number of stops removed in a turn; length of the longest string


class Fleet(NamedTuple):
    """n stops; all routes start at stop 0 and end at stop n - 1."""

    time: Floats  # [n, n] time of service and travel, infinite where there is no path
    opens: Floats  # [n] earliest start of service
    closes: Floats  # [n] latest start of service
    price: Floats  # [n] cost in the objective of not visiting a stop
    worth: Floats  # [n] priority of a stop; a larger sum is better, before the objective is compared
    near: Ids  # [n, m] the other inner stops, nearest first
    last_weight: float  # weight of the latest end of a route in the objective
    sum_weight: float  # weight of the total travel time in the objective


class Routes(NamedTuple):
    """k routes that are being changed; kernels keep the times up to date."""

    stops: Ids  # [k, n]
    sizes: Ids  # [k] number of stops in each route, with start and end
    route: Ids  # [n] the route of each stop, or OUT
    ready: Floats  # [k, n] start of service at each place
    latest: Floats  # [k, n] latest start of service such that no later stop is late
    duration: Floats  # [k, n] time from each place to the end, without waiting
    earliest: Floats  # [k, n] earliest end of the route from each place on
    ends: Floats  # [k] end time of each route
    travel: Floats  # [k] travel time of each route


@kernel
def routes(n: int, k: int) -> Routes:
    """Return k empty routes from start to end; `refresh` computes their times."""
    stops = np.zeros((k, n), dtype=np.int32)
    stops[:, 1] = n - 1
    times = np.zeros((k, n)), np.zeros((k, n)), np.zeros((k, n)), np.zeros((k, n))
    return Routes(stops, np.full(k, 2, dtype=np.int32), np.full(n, OUT, dtype=np.int32), *times, np.zeros(k), np.zeros(k))


@bare_kernel
def refresh(fleet: Fleet, r: Routes, k: int) -> None:
    """Compute the times of route k."""
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
    """Return the prices of the stops left out plus the weighted times, and the sum of the priorities of the others."""
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
    """Insert `stop` where it costs least (one place in a hundred is skipped); return False if it fits nowhere in time."""
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
            continue  # all empty routes are equivalent
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
    """Remove `length` neighbouring stops of route k around `stop`; in half of the cases some stops between them stay."""
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
    """Remove strings from routes that pass near a randomly drawn stop."""
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
        # The route that ends last determines the objective.
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
    """Reinsert the absent stops, sorted at random, by time from the start, by their windows, or by their prices."""
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
    """Ruin and recreate `turns` times; the first temperature is `temperature`, and each next one is multiplied by `cooling`.

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
    """Remove stops from route k until none is late: of those up to the first late one, what saves most time for its price."""
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
    """Remove stops that would be late, then insert those that are in no route; return objective and priorities."""
    state = np.array([seed], dtype=np.uint64)
    for k in range(len(r.sizes)):
        shorten(fleet, r, k)
    n = len(r.route)
    absent, keys = np.zeros(n, dtype=np.int32), np.zeros(n)
    recreate(fleet, r, absent, keys, state)
    return objective(fleet, r)
