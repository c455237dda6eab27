"""Tours: TSPLIB distances, an ant's walk through all cities, and the cycles of a colony."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels import rng
from antway.kernels.colony import Numbers, best_deposits, clip, evaporate, limits, persistence
from antway.kernels.jit import kernel

MATRIX, EUC_2D, CEIL_2D, ATT, EUCLID = range(5)
BEST, CYCLE, RESTARTED, IMPROVED, BEST_SINCE, TAU_0, TAU_MIN, TAU_MAX = range(8)

Floats = NDArray[np.float64]
Ints = NDArray[np.int32]


class Cities(NamedTuple):
    """n cities and the candidate edges to the k nearest of each."""

    kind: int  # how distances come: MATRIX, EUC_2D, CEIL_2D, ATT (TSPLIB's roundings) or EUCLID (not rounded)
    xy: Floats  # [n, 2] places; unused with a matrix
    matrix: Floats  # [n, n] distances, or empty
    near: Ints  # [n, k] nearest other cities, nearest first
    gap: Floats  # [n, k] their distances
    back: Ints  # [n, k] column of i in near[near[i, c]], or -1: the same edge from its other end


class Colony(NamedTuple):
    """What a colony of m ants knows; kernels change it in place."""

    tau: Floats  # [n, k] pheromone on the candidate edges; where an edge is candidate at both ends, the same at both
    eta: Floats  # [n, k] heuristic to the power beta, the nearest of each city 1
    weight: NDArray[np.float32]  # [n, k] tau ** alpha * eta, row by row up to a factor: Eq. (1) before division
    orders: Ints  # [m, n] the ants' tours of the last cycle
    lengths: Floats  # [m]
    bests: Ints  # [2, n] best tour ever, best since the last restart
    record: Floats  # [8] see BEST ... TAU_MAX


@kernel
def distance(kind: int, xy: Floats, matrix: Floats, i: int, j: int) -> float:
    """Return the distance between cities i and j by TSPLIB's definitions."""
    if kind == MATRIX:
        return float(matrix[i, j])
    dx, dy = xy[i, 0] - xy[j, 0], xy[i, 1] - xy[j, 1]
    square = dx * dx + dy * dy
    if kind == EUC_2D:
        return math.floor(math.sqrt(square) + 0.5)
    if kind == CEIL_2D:
        return math.ceil(math.sqrt(square))
    if kind == ATT:
        return math.ceil(math.sqrt(square / 10.0))
    return math.sqrt(square)


@kernel
def length(cities: Cities, order: Ints) -> float:
    """Return the length of the closed tour `order`."""
    total = 0.0
    before = order[-1]
    for city in order:
        total += distance(cities.kind, cities.xy, cities.matrix, before, city)
        before = city
    return total


@kernel
def gaps(kind: int, xy: Floats, matrix: Floats, near: Ints) -> Floats:
    """Return the distances of the candidate edges, float64[n, k]."""
    result = np.empty(near.shape)
    for i in range(near.shape[0]):
        for c in range(near.shape[1]):
            result[i, c] = distance(kind, xy, matrix, i, near[i, c])
    return result


@kernel
def column(near: Ints, i: int, j: int) -> int:
    """Return the column of j among the candidates of i, or -1."""
    for c in range(near.shape[1]):
        if near[i, c] == j:
            return c
    return -1


@kernel
def backs(near: Ints) -> Ints:
    """Return for each candidate edge its column at the other end, or -1."""
    result = np.empty(near.shape, dtype=np.int32)
    for i in range(near.shape[0]):
        for c in range(near.shape[1]):
            result[i, c] = column(near, near[i, c], i)
    return result


@kernel
def combine(tau: Floats, eta: Floats, alpha: float, weight: NDArray[np.float32]) -> None:
    """weight <- tau ** alpha * eta, with each row's tau relative to its largest, so that float32 suffices."""
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


@kernel
def choose(
    weight: NDArray[np.float32], near: Ints, place: Ints, t: int, i: int, q0: float, state: rng.State, sums: NDArray[np.float32]
) -> int:
    """Draw the column of the next city among i's candidates that stand at place t or later; -1 if none has weight.

    Eq. (1) by roulette, or, with probability q0, the candidate of most weight. sums: scratch of k.
    """
    k = near.shape[1]
    if q0 > 0.0 and rng.uniform(state) < q0:
        best, top = -1, np.float32(0.0)
        for c in range(k):
            if weight[i, c] > top and place[near[i, c]] >= t:
                best, top = c, weight[i, c]
        return best
    total = np.float32(0.0)
    for c in range(k):
        if place[near[i, c]] >= t:
            total += weight[i, c]
        sums[c] = total
    if not total > np.float32(0.0):
        return -1
    # 23 random bits: their largest product with the total is still below it.
    draw = np.float32(rng.next_bits(state) >> np.uint64(41)) * np.float32(2.0**-23) * total
    c = 0
    while sums[c] <= draw:
        c += 1
    return c


@kernel
def walk(
    cities: Cities, colony: Colony, numbers: Numbers, state: rng.State, order: Ints, place: Ints, sums: NDArray[np.float32]
) -> float:
    """Build one ant's tour in `order` and return its length.

    order[:t] is the tour so far and order[t:] the cities left, in no order; place[order[i]] = i throughout. Where no candidate
    is left the ant goes to the nearest city left.
    """
    near, gap = cities.near, cities.gap
    n = len(order)
    total = 0.0
    i = np.int32(rng.below(state, n))
    swap(order, place, 0, i)
    for t in range(1, n):
        c = choose(colony.weight, near, place, t, i, numbers.q0, state, sums)
        if c >= 0:
            j = near[i, c]
            total += gap[i, c]
            if numbers.xi > 0.0:
                local_update(cities, colony, numbers, i, c)
        else:
            j, least = -1, math.inf
            for other in order[t:]:
                d = distance(cities.kind, cities.xy, cities.matrix, i, other)
                if d < least or (d == least and other < j):
                    j, least = other, d
            total += least
        swap(order, place, t, j)
        i = j
    return total + distance(cities.kind, cities.xy, cities.matrix, i, order[0])


@kernel
def swap(order: Ints, place: Ints, t: int, city: int) -> None:
    """Bring `city` to place t, in exchange for the one that stands there."""
    other, p = order[t], place[city]
    order[t], order[p] = city, other
    place[city], place[other] = t, p


@kernel
def local_update(cities: Cities, colony: Colony, numbers: Numbers, i: int, c: int) -> None:
    """ACS: tau <- (1 - xi) tau + xi tau_0 on the edge that an ant takes from i, and its weight with it."""
    j, d = cities.near[i, c], cities.back[i, c]
    old = colony.tau[i, c]
    tau = (1.0 - numbers.xi) * old + numbers.xi * colony.record[TAU_0]
    ratio = np.float32((tau / old) ** numbers.alpha)
    colony.tau[i, c] = tau
    colony.weight[i, c] *= ratio
    if d >= 0:
        colony.tau[j, d] = tau
        colony.weight[j, d] *= ratio


@kernel
def deposit(near: Ints, tau: Floats, order: Ints, keep: float, amount: float) -> None:
    """tau <- keep tau + amount on the tour's edges, at both ends, where they are candidates."""
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
def learn(cities: Cities, colony: Colony, numbers: Numbers) -> bool:
    """End a cycle: keep the best, fade and deposit by the rule; tell whether the best ever improved."""
    near, tau, record, lengths = cities.near, colony.tau, colony.record, colony.lengths
    t = int(record[CYCLE])
    ranking = np.argsort(lengths, kind="mergesort")
    shortest = lengths[ranking[0]]
    better = shortest < record[BEST]
    if better:
        record[BEST] = shortest
        colony.bests[0] = colony.orders[ranking[0]]
    if shortest < record[BEST_SINCE]:
        record[BEST_SINCE] = shortest
        record[IMPROVED] = t
        colony.bests[1] = colony.orders[ranking[0]]
    best = max(record[BEST_SINCE], 1e-300)
    excess = max(shortest, 1e-300) / best - 1.0
    since = t - int(record[RESTARTED])
    if numbers.best_only:
        rho = persistence(numbers.fade, 1.0, 0.0, since, excess)
        deposit(near, tau, colony.bests[1], rho, (1.0 - rho) * numbers.elite * numbers.q / best)
    else:
        evaporate(tau, numbers.fade, since, excess)
        alone = best_deposits(numbers.schedule, since)
        if not alone:
            for r in range(len(lengths)):
                if numbers.share[r] > 0.0:
                    amount = numbers.share[r] * numbers.q / max(lengths[ranking[r]], 1e-300)
                    deposit(near, tau, colony.orders[ranking[r]], 1.0, amount)
        if numbers.elite > 0.0 and (alone or len(numbers.schedule) == 0):
            deposit(near, tau, colony.bests[1], 1.0, numbers.elite * numbers.q / best)
    if numbers.p_best > 0.0:
        rho = persistence(numbers.fade, 1.0, 0.0, since, excess)
        low, high = limits(numbers, rho, best, near.shape[0], 0.5 * near.shape[1])
        record[TAU_MIN], record[TAU_MAX] = low, high
        if numbers.restart > 0 and t - record[IMPROVED] >= numbers.restart:
            tau[:] = high
            record[RESTARTED], record[IMPROVED], record[BEST_SINCE] = t + 1, t + 1, math.inf
        clip(tau, low, high)
    record[CYCLE] += 1.0
    return better


@kernel
def build(cities: Cities, colony: Colony, numbers: Numbers, seed: np.uint64, first: int, last: int) -> None:
    """Let ants `first` to `last` - 1 walk; each draws from its own stream, so that results do not depend on who runs it."""
    m, n = colony.orders.shape
    place = np.empty(n, dtype=np.int32)
    sums = np.empty(cities.near.shape[1], dtype=np.float32)
    state = np.empty(1, dtype=np.uint64)
    for ant in range(first, last):
        order = colony.orders[ant]
        for p in range(n):
            place[order[p]] = p
        state[0] = rng.stream(seed, np.uint64(int(colony.record[CYCLE]) * m + ant))
        colony.lengths[ant] = walk(cities, colony, numbers, state, order, place, sums)


@kernel
def cycles(cities: Cities, colony: Colony, numbers: Numbers, seed: np.uint64, count: int, history: Floats) -> int:
    """Run `count` cycles of construct, evaluate, deposit; note (cycle, best length) of improvements in history[count, 2]."""
    noted = 0
    for _ in range(count):
        combine(colony.tau, colony.eta, numbers.alpha, colony.weight)
        build(cities, colony, numbers, seed, 0, colony.orders.shape[0])
        if learn(cities, colony, numbers):
            history[noted, 0], history[noted, 1] = colony.record[CYCLE], colony.record[BEST]
            noted += 1
    return noted
