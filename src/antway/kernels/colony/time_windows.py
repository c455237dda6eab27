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
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.colony.windows import Floats, Ids, Sets, Windows


class Beam(NamedTuple):
    """Scratch for beams of up to w partial orders of n stops, with c candidates at a time."""

    sets: Sets  # [2, w, words] stops visited
    last: Ids  # [2, w] stop reached
    ready: Floats  # [2, w] start of service there
    cost: Floats  # [2, w] travel time until there
    rest: Floats  # [2, w] lower bound of the remaining travel time
    scent: Floats  # [2, w] sum of `score` over its arcs
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


class Draw(NamedTuple):
    """How a beam chooses: key = bound * lower bound + time * start of service + scent + noise * Gumbel."""

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
    return Beam(
        np.zeros((2, width, words), dtype=np.uint64),
        np.zeros((2, width), dtype=np.int32),
        np.zeros((2, width)),
        np.zeros((2, width)),
        np.zeros((2, width)),
        np.zeros((2, width)),
        np.zeros((2, width), dtype=np.uint64),
        np.zeros((2, width), dtype=np.int32),
        np.zeros((n, width), dtype=np.int32),
        np.zeros((n, width), dtype=np.int32),
        np.zeros(c, dtype=np.int32),
        np.zeros(c, dtype=np.int32),
        np.zeros(c),
        np.zeros(c),
        np.zeros(c),
        np.zeros(c, dtype=np.uint64),
        np.zeros(c, dtype=np.int32),
        np.full(size, -1, dtype=np.int32),
    )


@bare_kernel
def misses(problem: Windows, beam: Beam, now: int, p: int, j: int, ready: float) -> bool:
    """Tell whether some unvisited stop can no longer be reached in time once partial order p continues to j."""
    horizon = ready + problem.farthest[j]
    for q in range(beam.first[now, p], len(problem.by_closing)):
        u = problem.by_closing[q]
        if problem.closes[u] >= horizon:
            return False
        if (
            u != j
            and not (beam.sets[now, p, u >> 6] >> np.uint64(u & 63)) & np.uint64(1)
            and ready + problem.far[j, u] > problem.closes[u]
        ):
            return True
    return False


@bare_kernel
def enter(beam: Beam, c: int, count: int) -> int:
    """Add candidate c, which is the one at `count`, unless another is as early and as short; return the new count."""
    spot = np.int64(
        (beam.c_mark[c] * np.uint64(0x9E3779B97F4A7C15) + np.uint64(beam.c_stop[c]) * np.uint64(0xBF58476D1CE4E5B9))
        >> np.uint64(20)
    ) & (len(beam.table) - 1)
    other = beam.table[spot]
    while other >= 0:
        # Sets with equal marks count as equal: a collision of 64 random bits is not to be expected.
        if beam.c_mark[other] == beam.c_mark[c] and beam.c_stop[other] == beam.c_stop[c] and beam.c_key[other] < np.inf:
            if beam.c_ready[other] <= beam.c_ready[c] and beam.c_cost[other] <= beam.c_cost[c]:
                return count
            if beam.c_ready[c] <= beam.c_ready[other] and beam.c_cost[c] <= beam.c_cost[other]:
                beam.c_key[other] = np.inf
        other = beam.c_next[other]
    beam.c_next[c] = beam.table[spot]
    beam.table[spot] = c
    return count + 1


@kernel
def keep(beam: Beam, count: int, width: int) -> tuple[int, bool]:
    """Keep the `width` candidates of least keys, in their order; return their number and whether any was dropped."""
    alive = 0
    for c in range(count):
        if beam.c_key[c] < np.inf:
            alive += 1
    threshold, free = np.inf, width
    if alive > width:
        keys = np.empty(alive)
        at = 0
        for c in range(count):
            if beam.c_key[c] < np.inf:
                keys[at] = beam.c_key[c]
                at += 1
        threshold = np.partition(keys, width - 1)[width - 1]
        for key in keys:
            free -= key < threshold
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
    return at, alive > width


@kernel
def search(
    problem: Windows, before: Sets, score: Floats, draw: Draw, width: int, seed: np.uint64, beam: Beam, order: Ids
) -> tuple[float, bool]:
    """Extend the beam from stop 0 through all others; write the best order and return its cost, infinite if there is none.

    before : [n, w] the stops that must come earlier, at least those of `problem`.
    score : [n, n] penalty of each arc by its pheromone.
    The second result is True if no partial order was dropped that could have been better.
    """
    n = len(problem.opens)
    words, capacity = before.shape[1], len(beam.c_parent)
    state = seed
    now, size, whole = 0, 1, True
    beam.sets[0, 0, :] = 0
    beam.sets[0, 0, 0] = 1
    beam.last[0, 0], beam.ready[0, 0], beam.cost[0, 0], beam.rest[0, 0] = 0, problem.opens[0], 0.0, problem.bound
    beam.scent[0, 0], beam.mark[0, 0], beam.first[0, 0] = 0.0, problem.mark[0], 0
    for layer in range(1, n):
        count = 0
        for p in range(size):
            i = beam.last[now, p]
            for at in range(problem.afters[i]):
                j = problem.after[i, at]
                if (beam.sets[now, p, j >> 6] >> np.uint64(j & 63)) & np.uint64(1):
                    continue
                step = problem.time[i, j]
                ready = max(beam.ready[now, p] + step, problem.opens[j])
                if ready > problem.closes[j]:
                    continue
                blocked = False
                for w in range(words):
                    if before[j, w] & ~beam.sets[now, p, w]:
                        blocked = True
                        break
                if blocked:
                    continue
                cost = beam.cost[now, p] + step
                least = beam.rest[now, p] - problem.leave[i] - problem.enter[j] + (ready if draw.makespan else cost)
                if least >= draw.limit or misses(problem, beam, now, p, j, ready):
                    continue
                if count == capacity:
                    count, dropped = keep(beam, count, width)
                    whole = whole and not dropped
                    for c in range(count):
                        enter(beam, c, c)
                key = draw.bound * least + draw.time * ready + beam.scent[now, p] + score[i, j]
                if draw.noise > 0.0:
                    state += rng.GAMMA
                    share = (float(rng.mix(state) >> np.uint64(11)) + 0.5) * (1.0 / 9007199254740992.0)
                    key += draw.noise * math.log(-math.log(share))
                beam.c_parent[count], beam.c_stop[count], beam.c_ready[count] = p, j, ready
                beam.c_cost[count], beam.c_key[count] = (0.0 if draw.makespan else cost), key
                beam.c_mark[count] = beam.mark[now, p] ^ problem.mark[j]
                count = enter(beam, count, count)
        size, dropped = keep(beam, count, width)
        whole = whole and not dropped
        if size == 0:
            return np.inf, whole
        then = 1 - now
        for c in range(size):
            p, j = beam.c_parent[c], beam.c_stop[c]
            i = beam.last[now, p]
            beam.sets[then, c] = beam.sets[now, p]
            beam.sets[then, c, j >> 6] |= np.uint64(1) << np.uint64(j & 63)
            beam.last[then, c], beam.ready[then, c], beam.cost[then, c] = (
                j,
                beam.c_ready[c],
                beam.cost[now, p] + problem.time[i, j],
            )
            beam.rest[then, c] = beam.rest[now, p] - problem.leave[i] - problem.enter[j]
            beam.scent[then, c], beam.mark[then, c] = beam.scent[now, p] + score[i, j], beam.c_mark[c]
            q = beam.first[now, p]
            while q < n and (
                beam.sets[then, c, problem.by_closing[q] >> 6] >> np.uint64(problem.by_closing[q] & 63)
            ) & np.uint64(1):
                q += 1
            beam.first[then, c] = q
            beam.parent[layer, c], beam.stop[layer, c] = p, j
        now = then
    best = 0
    for c in range(1, size):
        better = beam.ready[now, c] < beam.ready[now, best] if draw.makespan else beam.cost[now, c] < beam.cost[now, best]
        if better:
            best = c
    result = beam.ready[now, best] if draw.makespan else beam.cost[now, best]
    for layer in range(n - 1, 0, -1):
        order[layer] = beam.stop[layer, best]
        best = beam.parent[layer, best]
    order[0] = 0
    return result, whole
