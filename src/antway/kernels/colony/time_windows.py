"""Ants that build orders with time windows together: a beam of partial orders, extended stop by stop.

Of two partial orders with the same stops and the same last stop, one that is neither earlier nor shorter is dropped (dynamic
programming: Dumas, Desrosiers, Gelinas, Solomon, Operations Research 43, 1995). Of the others `width` are kept, drawn by
pheromone, lower bound and time (Beam-ACO: Lopez-Ibanez, Blum, Computers & Operations Research 37, 2010; drawing without
replacement by Gumbel noise: Kool, van Hoof, Welling, ICML 2019). If none of these was dropped, the best order was found.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base import rng
from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.colony.windows import Ids, Sets, Windows


class Beam(NamedTuple):
    """Scratch for beams of up to w partial orders of n stops, with c candidates at a time.

    Partial orders of p stops make up layer p. The first axis is for the two layers in memory, the even and the odd one.
    """

    visited: Sets  # [2, w, words] stops visited
    last: Ids  # [2, w] stop reached
    ready: Floats  # [2, w] start of service there
    cost: Floats  # [2, w] travel time until there
    rest: Floats  # [2, w] lower bound of the remaining travel time
    penalty: Floats  # [2, w] sum of the penalties of its arcs
    mark: Sets  # [2, w] exclusive or of the random words of its stops
    first: Ids  # [2, w] index in `by_closing` before which all stops are visited
    parent: Ids  # [n, w] the partial order of the previous layer that it extends
    stop: Ids  # [n, w] the stop by which it extends it
    c_parent: Ids  # [c] the same for candidates
    c_stop: Ids  # [c]
    c_ready: Floats  # [c]
    c_cost: Floats  # [c]
    c_key: Floats  # [c] the candidates of least keys are kept; infinite: dropped
    c_mark: Sets  # [c]
    c_next: Ids  # [c] next candidate of the same entry in the table, or -1
    table: Ids  # [power of 2] hash table: first candidate of an entry, or -1


class Choice(NamedTuple):
    """How a beam chooses: key = bound * lower bound + time * start of service + penalty + noise * Gumbel."""

    bound: float
    time: float
    noise: float
    makespan: bool  # whether to minimise the arrival time at the end instead of the travel time
    limit: float  # only orders that cost less than this are of interest


@kernel
def workspace(n: int, width: int) -> Beam:
    """Return scratch for beams of `width` partial orders of n stops."""
    words, c = (n + 63) // 64, 6 * width + 4 * n
    size = 1
    while size < 2 * c:
        size *= 2
    visited, mark = np.zeros((2, width, words), dtype=np.uint64), np.zeros((2, width), dtype=np.uint64)
    last, first = np.zeros((2, width), dtype=np.int32), np.zeros((2, width), dtype=np.int32)
    ready, cost, rest, penalty = np.zeros((2, width)), np.zeros((2, width)), np.zeros((2, width)), np.zeros((2, width))
    parent, stop = np.zeros((n, width), dtype=np.int32), np.zeros((n, width), dtype=np.int32)
    c_parent, c_stop, c_next = np.zeros(c, dtype=np.int32), np.zeros(c, dtype=np.int32), np.zeros(c, dtype=np.int32)
    c_ready, c_cost, c_key, c_mark = np.zeros(c), np.zeros(c), np.zeros(c), np.zeros(c, dtype=np.uint64)
    table = np.full(size, -1, dtype=np.int32)
    orders = visited, last, ready, cost, rest, penalty, mark, first, parent, stop
    return Beam(*orders, c_parent, c_stop, c_ready, c_cost, c_key, c_mark, c_next, table)


@inner_kernel
def has_visited(beam: Beam, layer: int, p: int, stop: int) -> bool:
    """Tell whether partial order p of a layer in memory has visited `stop`."""
    return bool((beam.visited[layer, p, stop >> 6] >> np.uint64(stop & 63)) & np.uint64(1))


@inner_kernel
def has_predecessors(problem: Windows, beam: Beam, layer: int, p: int, stop: int) -> bool:
    """Tell whether partial order p of a layer in memory has visited all stops that must come before `stop`."""
    missing = np.uint64(0)
    for w in range(problem.before.shape[1]):
        missing |= problem.before[stop, w] & ~beam.visited[layer, p, w]
    return bool(missing == np.uint64(0))


@bare_kernel
def misses(problem: Windows, beam: Beam, layer: int, p: int, j: int, ready: float) -> bool:
    """Tell whether some unvisited stop can no longer be reached in time once partial order p continues to j."""
    horizon = ready + problem.farthest[j]
    for q in range(beam.first[layer, p], len(problem.by_closing)):
        u = problem.by_closing[q]
        if problem.closes[u] >= horizon:
            return False
        if u != j and not has_visited(beam, layer, p, u) and ready + problem.far[j, u] > problem.closes[u]:
            return True
    return False


@bare_kernel
def enter(beam: Beam, c: int) -> bool:
    """Add candidate c to the table, unless another is as early and as short; tell whether it was added."""
    spot = np.int64(
        (beam.c_mark[c] * np.uint64(0x9E3779B97F4A7C15) + np.uint64(beam.c_stop[c]) * np.uint64(0xBF58476D1CE4E5B9))
        >> np.uint64(20)
    ) & (len(beam.table) - 1)
    other = beam.table[spot]
    while other >= 0:
        # Sets with equal marks count as equal: a collision of 64 random bits is not to be expected.
        if beam.c_mark[other] == beam.c_mark[c] and beam.c_stop[other] == beam.c_stop[c]:
            if beam.c_ready[other] <= beam.c_ready[c] and beam.c_cost[other] <= beam.c_cost[c]:
                return False
            if beam.c_ready[c] <= beam.c_ready[other] and beam.c_cost[c] <= beam.c_cost[other]:
                beam.c_key[other] = np.inf
        other = beam.c_next[other]
    beam.c_next[c] = beam.table[spot]
    beam.table[spot] = c
    return True


@kernel
def keep(beam: Beam, count: int, width: int) -> tuple[int, bool]:
    """Keep the `width` candidates of least keys, in their order; return their number and whether any was dropped."""
    keys = beam.c_key[:count]
    keys = keys[keys < np.inf]
    threshold, free = np.inf, width
    if len(keys) > width:
        threshold = np.partition(keys, width - 1)[width - 1]
        free -= np.sum(keys < threshold)
    at = 0
    for c in range(count):
        key = beam.c_key[c]
        if key == np.inf or key > threshold:
            continue
        if key == threshold:
            if free == 0:
                continue
            free -= 1
        beam.c_parent[at], beam.c_stop[at], beam.c_ready[at] = beam.c_parent[c], beam.c_stop[c], beam.c_ready[c]
        beam.c_cost[at], beam.c_key[at], beam.c_mark[at] = beam.c_cost[c], key, beam.c_mark[c]
        at += 1
    beam.table[:] = -1
    return at, len(keys) > width


@bare_kernel
def start(problem: Windows, beam: Beam) -> None:
    """Make the partial order that is only stop 0 the first of layer 0."""
    beam.visited[0, 0, :] = 0
    beam.visited[0, 0, 0] = 1
    beam.last[0, 0], beam.ready[0, 0], beam.cost[0, 0], beam.rest[0, 0] = 0, problem.opens[0], 0.0, problem.bound
    beam.penalty[0, 0], beam.mark[0, 0], beam.first[0, 0] = 0.0, problem.mark[0], 0


@kernel
def extend(
    problem: Windows, penalty: Floats, choice: Choice, width: int, beam: Beam, layer: int, size: int, state: rng.State
) -> tuple[int, bool]:
    """Extend the `size` partial orders of a layer by one stop each; return the number of kept candidates, and whether all are.

    A candidate is left out without loss if it has a late stop, leads to one, or costs `choice.limit` or more.
    """
    count, whole = 0, True
    for p in range(size):
        i = beam.last[layer, p]
        for at in range(problem.afters[i]):
            j = problem.after[i, at]
            if has_visited(beam, layer, p, j):
                continue
            step = problem.time[i, j]
            ready = max(beam.ready[layer, p] + step, problem.opens[j])
            if ready > problem.closes[j] or not has_predecessors(problem, beam, layer, p, j):
                continue
            cost = beam.cost[layer, p] + step
            least = beam.rest[layer, p] - problem.leave[i] - problem.enter[j] + (ready if choice.makespan else cost)
            if least >= choice.limit or misses(problem, beam, layer, p, j, ready):
                continue
            if count == len(beam.c_parent):
                count, dropped = keep(beam, count, width)
                whole = whole and not dropped
                for c in range(count):
                    enter(beam, c)
            key = choice.bound * least + choice.time * ready + beam.penalty[layer, p] + penalty[i, j]
            if choice.noise > 0.0:
                share = (float(rng.next_bits(state) >> np.uint64(11)) + 0.5) * 2.0**-53
                key += choice.noise * math.log(-math.log(share))
            beam.c_parent[count], beam.c_stop[count], beam.c_ready[count] = p, j, ready
            beam.c_cost[count], beam.c_key[count] = (0.0 if choice.makespan else cost), key
            beam.c_mark[count] = beam.mark[layer, p] ^ problem.mark[j]
            if enter(beam, count):
                count += 1
    count, dropped = keep(beam, count, width)
    return count, whole and not dropped


@bare_kernel
def advance(problem: Windows, penalty: Floats, beam: Beam, layer: int, size: int) -> None:
    """Make the `size` kept candidates the partial orders of the other layer in memory."""
    then = 1 - layer
    for c in range(size):
        p, j = beam.c_parent[c], beam.c_stop[c]
        i = beam.last[layer, p]
        for w in range(beam.visited.shape[2]):
            beam.visited[then, c, w] = beam.visited[layer, p, w]
        beam.visited[then, c, j >> 6] |= np.uint64(1) << np.uint64(j & 63)
        beam.last[then, c], beam.ready[then, c] = j, beam.c_ready[c]
        beam.cost[then, c] = beam.cost[layer, p] + problem.time[i, j]
        beam.rest[then, c] = beam.rest[layer, p] - problem.leave[i] - problem.enter[j]
        beam.penalty[then, c], beam.mark[then, c] = beam.penalty[layer, p] + penalty[i, j], beam.c_mark[c]
        q = beam.first[layer, p]
        while q < len(problem.by_closing) and has_visited(beam, then, c, problem.by_closing[q]):
            q += 1
        beam.first[then, c] = q


@kernel
def search(
    problem: Windows, penalty: Floats, choice: Choice, width: int, seed: np.uint64, beam: Beam, order: Ids
) -> tuple[float, bool]:
    """Extend the beam from stop 0 through all others; write the best order and return its cost, infinite if there is none.

    The second result is True if no partial order was dropped that could have been better. `penalty`, float64[n, n], is that of
    each arc by its pheromone.
    """
    n = len(problem.opens)
    state = np.array([seed], dtype=np.uint64)
    size, whole = 1, True
    start(problem, beam)
    for p in range(1, n):
        layer = (p - 1) % 2
        size, all_kept = extend(problem, penalty, choice, width, beam, layer, size, state)
        whole = whole and all_kept
        if size == 0:
            return np.inf, whole
        advance(problem, penalty, beam, layer, size)
        for c in range(size):
            beam.parent[p, c], beam.stop[p, c] = beam.c_parent[c], beam.c_stop[c]
    costs = beam.ready[(n - 1) % 2] if choice.makespan else beam.cost[(n - 1) % 2]
    best = 0
    for c in range(1, size):
        if costs[c] < costs[best]:
            best = c
    result = costs[best]
    for p in range(n - 1, 0, -1):
        order[p] = beam.stop[p, best]
        best = beam.parent[p, best]
    order[0] = 0
    return result, whole
