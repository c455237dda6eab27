"""A colony for the TSP: the walk of an ant, the update after a cycle, and the cycles."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base import rng
from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.colony.local_search import LOGGED, Search, flip, improve, push, set_tour, settle, undo, workspace
from antway.kernels.colony.pheromone import CEILING, Numbers, best_deposits, clip, evaporate, limits, persistence
from antway.kernels.colony.tour import Cities, Ids, Index, column, distance

# Elements of `ColonyState.record`.
BEST = 0  # length of the best tour so far, infinite before the first cycle
CYCLE = 1  # number of cycles done
RESTARTED = 2  # cycle in which the colony started, or restarted
IMPROVED = 3  # cycle of the last improvement since then
BEST_SINCE = 4  # length of the best tour since then
TAU_0 = 5  # initial pheromone
TAU_MIN = 6  # lower limit of pheromone, for rules with limits
TAU_MAX = 7  # upper limit of pheromone, for rules with limits
Weights = NDArray[np.float32]
TINY, HUGE = np.float32(1e-30), np.float32(1e30)  # within these limits float32 products neither underflow nor overflow


class ColonyState(NamedTuple):
    """The state of a colony of m ants, which kernels change in place."""

    tau: Floats  # [n, k] pheromone on the candidate edges; equal at both ends if an edge is a candidate of both
    eta: Floats  # [n, k] heuristic to the power beta, scaled to 1 for the nearest city
    weight: NDArray[np.float32]  # [n, k] tau ** alpha * eta up to a factor for each row: the numerator of Eq. (1)
    row_sum: Floats  # [n] sum of each row of `weight`
    orders: Ids  # [m, n] the tours of the last cycle
    lengths: Floats  # [m]
    bests: Ids  # [2, n] best tour so far, best tour since the last restart
    record: Floats  # [8] see BEST ... TAU_MAX


class LocalSearchOptions(NamedTuple):
    """How an ant improves or changes its tour."""

    breadth: int  # of the local search, see `local_search.improve`; -1: none
    longest: int  # of the local search, see there
    attempts: int  # number of changes in each cycle of focused construction; 0: no focused construction
    window: int  # largest number of cities in a part of a change
    temperature: float = 0.0  # initial temperature for changes of an old tour, in mean edge lengths of the best tour
    temperature_rebuilt: float = 0.0  # the same for a newly built tour, whose edges come from many good tours
    rebuild_every: int = 0  # an ant builds a new tour every so many cycles, and changes its last one in the others; 0: never


@bare_kernel
def combine(tau: Floats, eta: Floats, alpha: float, weight: Weights, row_sum: Floats) -> None:
    """weight <- tau ** alpha * eta, with tau relative to the largest of its row so that float32 suffices; row_sum: its sums."""
    n, k = tau.shape
    for i in range(n):
        top = 0.0
        for c in range(k):
            top = max(top, tau[i, c])
        scale = 1.0 / top
        if alpha == 1.0:
            for c in range(k):
                weight[i, c] = tau[i, c] * scale * eta[i, c]
        else:
            for c in range(k):
                weight[i, c] = (tau[i, c] * scale) ** alpha * eta[i, c]
        row_sum[i] = 0.0
        for c in range(k):
            row_sum[i] += weight[i, c]


@bare_kernel
def choose(weight: Weights, near: Ids, left: Weights, i: Index, greedy: bool, share: np.float32, sums: Weights) -> int:
    """Return the column of the next city among the unvisited candidates of i; -1 if none has weight.

    It is drawn by the roulette of Eq. (1), which stops at the share `share` in [0, 1) of the sum; if `greedy`, it is the
    candidate of largest weight. left[j] is 1 for an unvisited city, else 0. sums: scratch of k.
    """
    k = near.shape[1]
    if greedy:
        best, top = -1, np.float32(0.0)
        for c in range(k):
            if weight[i, c] * left[near[i, c]] > top:
                best, top = c, weight[i, c]
        return best
    total = np.float32(0.0)
    for c in range(k):
        # A product instead of a branch, because it is hard to predict which candidates are left.
        total += weight[i, c] * left[near[i, c]]
        sums[c] = total
    if not TINY < total < HUGE:
        return -1
    return drawn(sums, share * total)


@bare_kernel
def drawn(sums: Weights, share: np.float32) -> int:
    """Return the first column whose partial sum is more than `share`, a number below the last sum."""
    c = 0
    while sums[c] <= share:  # faster than counting without branches, thanks to branch prediction
        c += 1
    return c


@bare_kernel
def propose(weight: Weights, row_sum: Floats, near: Ids, left: Weights, i: Index, came: Index, share: float) -> int:
    """Draw by Eq. (1) among all candidates of i but the one of column `came`; return -1 if the drawn city was visited.

    If the ant then draws again with `choose`, the next city has the same distribution as with `choose` alone (rejection
    sampling). With pheromone on few edges most draws succeed, and a draw looks at two or three candidates instead of all.
    """
    rest = row_sum[i]
    if came >= 0:
        rest -= weight[i, came]
    if rest < 1e-9 * row_sum[i]:  # the rest may be nothing but rounding errors
        return -1
    draw = share * rest
    for c in range(near.shape[1]):
        if c != came:
            draw -= weight[i, c]
            if draw < 0.0:
                return c if left[near[i, c]] > 0.0 else -1
    return -1


@bare_kernel
def nearest_left(cities: Cities, left: Weights, i: Index) -> tuple[Index, float]:
    """Return the nearest city to i that is not visited yet, and its distance.

    Of cities at equal distances it is the one of least number, and of those in the same place as i the next one after i.
    """
    n = len(left)
    j, least = np.uint32(0), math.inf
    for step in range(1, n):  # from i on, so that the next one of many cities in the same place is soon found
        other = np.uint32(i + step if i + step < n else i + step - n)
        if left[other] > 0.0:
            d = distance(cities.metric, i, other)
            if d < least or (d == least and other < j):
                j, least = other, d
                if d == 0.0:
                    break
    return j, least


@bare_kernel
def walk(
    cities: Cities, colony: ColonyState, numbers: Numbers, state: np.uint64, order: Ids, left: Weights, sums: Weights
) -> float:
    """Build one ant's tour in `order` and return its length.

    Each step draws among the unvisited candidates by the roulette of Eq. (1), or with probability q0 takes the one of largest
    weight; if there is none, the ant goes to the nearest unvisited city. Its random numbers start at `state`.
    """
    near, gap, back, weight, q0, xi = cities.near, cities.gap, cities.back, colony.weight, numbers.q0, numbers.xi
    n = len(order)
    left[:] = 1.0
    total = 0.0
    state += rng.GAMMA
    i = np.uint32(((rng.mix(state) >> np.uint64(32)) * np.uint64(n)) >> np.uint64(32))
    order[0], left[i] = i, 0.0
    came = -1
    for t in range(1, n):
        greedy = False
        if q0 > 0.0:
            state += rng.GAMMA
            greedy = float(rng.mix(state) >> np.uint64(11)) * 2.0**-53 < q0
        c = -1
        if xi == 0.0 and not greedy:
            state += rng.GAMMA
            c = propose(weight, colony.row_sum, near, left, i, came, float(rng.mix(state) >> np.uint64(11)) * 2.0**-53)
        if c < 0:
            state += rng.GAMMA
            # 23 random bits: the product of the largest such number with a sum is still below the sum.
            share = np.float32(rng.mix(state) >> np.uint64(41)) * np.float32(2.0**-23)
            c = choose(weight, near, left, i, greedy, share, sums)
        came = -1
        if c >= 0:
            j = near[i, c]
            total += gap[i, c]
            came = back[i, c]
            if xi > 0.0:
                local_update(cities, colony, numbers, i, c)
        else:
            j, d = nearest_left(cities, left, i)
            total += d
        order[t], left[j] = j, 0.0
        i = j
    if xi > 0.0:  # the edge that closes the tour counts as taken, too
        c = column(near, i, order[0])
        if c >= 0:
            local_update(cities, colony, numbers, i, c)
    return total + distance(cities.metric, i, order[0])


@bare_kernel
def local_update(cities: Cities, colony: ColonyState, numbers: Numbers, i: Index, c: Index) -> None:
    """ACS: tau <- (1 - xi) tau + xi tau_0 on the edge that an ant takes from i; its weight is updated too."""
    j, d = cities.near[i, c], cities.back[i, c]
    old = colony.tau[i, c]
    tau = (1.0 - numbers.xi) * old + numbers.xi * colony.record[TAU_0]
    ratio = np.float32((tau / old) ** numbers.alpha)
    colony.tau[i, c] = tau
    colony.weight[i, c] *= ratio
    if d >= 0:
        colony.tau[j, d] = tau
        colony.weight[j, d] *= ratio


@bare_kernel
def deposit(near: Ids, tau: Floats, order: Ids, keep: float, amount: float) -> None:
    """tau <- keep tau + amount on the edges of the tour that are candidates, at both ends."""
    amount = min(amount, CEILING)
    i = order[-1]
    for j in order:
        c = column(near, i, j)
        if c >= 0:
            tau[i, c] = keep * tau[i, c] + amount
        c = column(near, j, i)
        if c >= 0:
            tau[j, c] = keep * tau[j, c] + amount
        i = j


@kernel
def learn(cities: Cities, colony: ColonyState, numbers: Numbers) -> bool:
    """End a cycle: keep the best tour, evaporate and deposit by the rule; tell whether the best so far improved."""
    near, tau, record, lengths = cities.near, colony.tau, colony.record, colony.lengths
    t = int(record[CYCLE])
    first = np.argmin(lengths)
    shortest = lengths[first]
    better: bool = shortest < record[BEST]
    if better:
        record[BEST] = shortest
        copy_row(colony.orders[first], colony.bests[0])
    if shortest < record[BEST_SINCE]:
        record[BEST_SINCE] = shortest
        record[IMPROVED] = t
        copy_row(colony.orders[first], colony.bests[1])
    best = max(record[BEST_SINCE], 1e-300)
    excess = max(shortest, 1e-300) / best - 1.0
    since = t - int(record[RESTARTED])
    if numbers.best_only:
        rho = persistence(numbers.persistence_rule, 1.0, 0.0, since, excess)
        deposit(near, tau, colony.bests[1], rho, max(1.0 - rho, 0.0) * numbers.elite * numbers.q / best)
    else:
        evaporate(tau, numbers.persistence_rule, since, excess)
        alone = best_deposits(numbers.schedule, since)
        if not alone:
            ranking = np.argsort(lengths, kind="mergesort") if np.any(numbers.deposit_weight[1:] > 0.0) else np.array([first])
            for r in range(len(ranking)):
                if numbers.deposit_weight[r] > 0.0:
                    amount = numbers.deposit_weight[r] * numbers.q / max(lengths[ranking[r]], 1e-300)
                    deposit(near, tau, colony.orders[ranking[r]], 1.0, amount)
        if numbers.elite > 0.0 and (alone or len(numbers.schedule) == 0):
            deposit(near, tau, colony.bests[1], 1.0, numbers.elite * numbers.q / best)
    if numbers.p_best > 0.0:
        rho = persistence(numbers.persistence_rule, 1.0, 0.0, since, excess)
        low, high = limits(numbers, rho, best, near.shape[0], numbers.choices or 0.5 * near.shape[0])
        record[TAU_MIN], record[TAU_MAX] = low, high
        if numbers.restart > 0 and t - record[IMPROVED] >= numbers.restart:
            tau[:] = high
            record[RESTARTED], record[IMPROVED], record[BEST_SINCE] = t + 1, t + 1, math.inf
        clip(tau, low, high)
    record[CYCLE] += 1.0
    return better


@kernel
def select(colony: ColonyState, options: LocalSearchOptions, seed: np.uint64) -> None:
    """Give each ant the better of its own last tour and that of a randomly drawn ant (tournament selection)."""
    m, cycle = len(colony.lengths), int(colony.record[CYCLE])
    if options.rebuild_every < 2 or cycle == 0:
        return
    state = np.empty(1, dtype=np.uint64)
    state[0] = rng.stream(rng.mix(seed), np.uint64(cycle))
    for ant in range(m):
        other = np.int64(rng.below(state, m))
        if colony.lengths[other] < colony.lengths[ant]:
            copy_row(colony.orders[other], colony.orders[ant])
            colony.lengths[ant] = colony.lengths[other]


@kernel
def build(
    cities: Cities, colony: ColonyState, numbers: Numbers, options: LocalSearchOptions, seed: np.uint64, first: int, last: int
) -> None:
    """Let the ants `first` to `last` - 1 make their tours; each has its own random stream, independent of threads."""
    m, n = colony.orders.shape
    search = workspace(n, 0 if options.attempts == 0 else 500)
    unlogged = Search(search.order, search.place, search.queue, search.queued, search.log[:0], search.counts)
    sums, left = np.empty(cities.near.shape[1], dtype=np.float32), np.empty(n, dtype=np.float32)
    state, cycle = np.empty(1, dtype=np.uint64), int(colony.record[CYCLE])
    for ant in range(first, last):
        order = colony.orders[ant]
        state[0] = rng.stream(seed, np.uint64(cycle * m + ant))
        if options.attempts > 0 and cycle > 0 and (options.rebuild_every == 0 or (cycle + ant) % options.rebuild_every != 0):
            set_tour(search, order)
            colony.lengths[ant] -= refine(cities, colony, options, ant, options.temperature, state, search, sums)
            copy_row(search.order, order)
            continue
        colony.lengths[ant] = walk(cities, colony, numbers, state[0], order, left, sums)
        if options.breadth >= 0:
            colony.lengths[ant] -= improve(cities, unlogged, order, options.breadth, options.longest)
            if options.rebuild_every > 0:
                colony.lengths[ant] -= refine(cities, colony, options, ant, options.temperature_rebuilt, state, search, sums)
                copy_row(search.order, order)


@bare_kernel
def refine(
    cities: Cities,
    colony: ColonyState,
    options: LocalSearchOptions,
    ant: int,
    temperature: float,
    state: rng.State,
    search: Search,
    sums: NDArray[np.float32],
) -> float:
    """Focused construction: copy a tour, change four edges, repair around them, keep the result if it is not longer.

    A longer tour is accepted by the Metropolis rule at a temperature that falls to 0 within the cycle (simulated annealing).
    The change is a double bridge, u B C D -> u D C B on a few dozen cities, which 3-opt cannot undo in one move; the edge
    from u into D is drawn by Eq. (1). This is done `attempts` times
    for the tour of `ant`, at a `temperature` in mean edges at first. Returns the gain.
    """
    n, k = cities.near.shape
    window = min(options.window, (n - 2) // 3)
    total = 0.0
    temperature *= min(colony.record[BEST], colony.lengths[ant]) / n  # in the first cycle there is no best tour
    for a in range(options.attempts):
        p = np.int64(rng.below(state, n))
        u = search.order[p]
        # The drawn edge leads to a city that is 3 to 2 * window places ahead.
        weight = np.float32(0.0)
        for c in range(k):
            if 3 <= places_ahead(search, p, cities.near[u, c]) <= 2 * window:
                weight += colony.weight[u, c]
            sums[c] = weight
        if not TINY < weight < HUGE:
            continue
        c = drawn(sums, np.float32(rng.next_bits(state) >> np.uint64(41)) * np.float32(2.0**-23) * weight)
        q = places_ahead(search, p, cities.near[u, c])
        b = 1 + np.int64(rng.below(state, int(q) - 2))
        d = q + np.int64(rng.below(state, window))
        gain = bridge(cities, search, p, b, q - 1, d)
        gain += settle(cities, search, options.breadth, options.longest)
        if gain < 0.0 and gain <= temperature * (1.0 - a / options.attempts) * math.log(1.0 - rng.uniform(state)):
            undo(search)
        else:
            search.counts[LOGGED] = 0
            total += gain
    return total


@bare_kernel
def places_ahead(search: Search, p: Index, city: Index) -> int:
    """Return how many places after place p `city` is in the tour."""
    q = np.int64(search.place[city]) - p
    return int(q if q >= 0 else q + len(search.order))


@bare_kernel
def bridge(cities: Cities, search: Search, p: Index, b: Index, c: Index, d: Index) -> float:
    """Double bridge: put the parts p + (1..b), (b+1..c), (c+1..d) in reverse order; return the gain."""
    n = len(search.order)
    u, v = search.order[p], search.order[(p + d + 1) % n]
    b1, b2 = search.order[(p + 1) % n], search.order[(p + b) % n]
    c1, c2 = search.order[(p + b + 1) % n], search.order[(p + c) % n]
    d1, d2 = search.order[(p + c + 1) % n], search.order[(p + d) % n]
    gain = 0.0
    for i, j, sign in ((u, b1, 1), (b2, c1, 1), (c2, d1, 1), (d2, v, 1), (u, d1, -1), (d2, c1, -1), (c2, b1, -1), (b2, v, -1)):
        gain += sign * distance(cities.metric, i, j)
    for i, j, k, m in ((u, b1, d2, v), (u, d2, d1, c2), (d2, c2, c1, b2), (c2, b2, b1, v)):
        flip(search, i, j, k, m)
    for city in (u, v, b1, b2, c1, c2, d1, d2):
        push(search, city)
    return gain


@kernel
def cycles(
    cities: Cities,
    colony: ColonyState,
    numbers: Numbers,
    options: LocalSearchOptions,
    seed: np.uint64,
    count: int,
    target: float,
    history: Floats,
) -> int:
    """Run up to `count` cycles of construction, improvement and deposit, until a tour has at most the length `target`.

    Writes (cycle, best length) to history[count, 2] at each improvement; returns the number of improvements.
    """
    noted = 0
    for _ in range(count):
        combine(colony.tau, colony.eta, numbers.alpha, colony.weight, colony.row_sum)
        select(colony, options, seed)
        build(cities, colony, numbers, options, seed, 0, colony.orders.shape[0])
        if learn(cities, colony, numbers):
            history[noted, 0], history[noted, 1] = colony.record[CYCLE], colony.record[BEST]
            noted += 1
            if colony.record[BEST] <= target:
                break
    return noted


@kernel
def walk_once(cities: Cities, colony: ColonyState, numbers: Numbers, seed: np.uint64) -> float:
    """Build one tour in orders[0], independent of cycles; return its length."""
    n, k = cities.near.shape
    left, sums = np.empty(n, dtype=np.float32), np.empty(k, dtype=np.float32)
    return walk(cities, colony, numbers, rng.mix(seed), colony.orders[0], left, sums)
