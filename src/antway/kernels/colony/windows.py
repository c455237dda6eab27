"""Stops with time windows, and what follows from the windows alone: precedence, unusable arcs, a lower bound.

A task is a path from stop 0 through all others to stop n - 1. Times are chosen such that their sums are exact in float64.
Tightening: Desrochers, Desrosiers, Solomon, Operations Research 40 (1992); Ascheuer, Fischetti, Groetschel, Mathematical
Programming 90 (2001).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel

Ids = NDArray[np.int32]
Sets = NDArray[np.uint64]  # sets of stops, 64 in a word
# Limit of the rounds of tightening; 13 suffice for every benchmark instance. Two stops, each reached soonest from the other,
# may push the openings of each other's windows for millions of rounds.
_ROUNDS = 20


class Windows(NamedTuple):
    """n stops; all times are tightened without excluding a feasible order."""

    time: Floats  # [n, n] time of service and travel, infinite for arcs that no feasible order uses
    far: Floats  # [n, n] shortest path with other stops in between
    opens: Floats  # [n] earliest start of service
    closes: Floats  # [n] latest start of service
    after: Ids  # [n, n] stops that may come next, by increasing reduced cost
    afters: Ids  # [n] the number of these stops
    before: Sets  # [n, w] the stops that must come earlier
    by_closing: Ids  # [n] the stops by latest start
    farthest: Floats  # [n] maximum of each row of `far`
    leave: Floats  # [n] dual values of leaving a stop
    enter: Floats  # [n] dual values of entering a stop: leave[i] + enter[j] <= time[i, j]
    mark: Sets  # [n] a random word for each stop; the mark of a set is the exclusive or of its words
    bound: float  # lower bound of the travel time: the sum of all dual values


@bare_kernel
def schedule(
    time: Floats, opens: Floats, closes: Floats, order: Ids, ready: Floats, latest: Floats, duration: Floats, earliest: Floats
) -> None:
    """Write the times of `order` for each of its places.

    They are the start of service (`ready`), the latest start such that no later stop is late (`latest`), the travel time from
    there to the end (`duration`), and the earliest end of the order from there on (`earliest`).
    """
    last = len(order) - 1
    ready[0] = opens[order[0]]
    for p in range(1, last + 1):
        ready[p] = max(ready[p - 1] + time[order[p - 1], order[p]], opens[order[p]])
    latest[last], duration[last], earliest[last] = closes[order[last]], 0.0, opens[order[last]]
    for p in range(last - 1, -1, -1):
        i = order[p]
        step = time[i, order[p + 1]]
        latest[p] = min(closes[i], latest[p + 1] - step)
        duration[p] = duration[p + 1] + step
        earliest[p] = max(opens[i] + duration[p], earliest[p + 1])


@kernel
def shortest(time: Floats) -> Floats:
    """Return the lengths of shortest paths through any other stops (Floyd, Warshall)."""
    far = time.copy()
    n = len(far)
    for k in range(n):
        for i in range(n):
            if i != k:
                for j in range(n):
                    far[i, j] = min(far[i, j], far[i, k] + far[k, j])
    return far


@kernel
def tighten(time: Floats, far: Floats, opens: Floats, closes: Floats, first: NDArray[np.bool_]) -> int:
    """Tighten windows, precedence first[i, j] (i comes before j) and arcs in place, until nothing changes or for 20 rounds.

    Returns -1, or a stop whose window is empty or that must come before itself; then no order is feasible.
    """
    n = len(time)
    last = n - 1
    for j in range(1, n):
        first[0, j] = True
        first[j - 1, last] = True
    for _ in range(_ROUNDS):
        changed = find_precedence(far, opens, closes, first)
        for i in range(n):
            if first[i, i]:
                return i
        changed |= drop_arcs(time, far, opens, closes, first)
        for j in range(n):
            earliest, latest = tightened(time, far, opens, closes, first, j)
            if earliest > opens[j] or latest < closes[j]:
                opens[j], closes[j] = earliest, latest
                changed = True
            if earliest > latest:
                return j
        if not changed:
            break
    return -1


@bare_kernel
def find_precedence(far: Floats, opens: Floats, closes: Floats, first: NDArray[np.bool_]) -> bool:
    """Add the precedence that follows from windows, and what follows from that; tell whether there is more of it."""
    n, changed = len(far), False
    for i in range(n):
        for j in range(n):
            if i != j and not first[i, j] and opens[j] + far[j, i] > closes[i]:
                first[i, j] = changed = True
    for k in range(n):
        for i in range(n):
            if first[i, k]:
                for j in range(n):
                    if first[k, j] and not first[i, j]:
                        first[i, j] = changed = True
    return changed


@bare_kernel
def drop_arcs(time: Floats, far: Floats, opens: Floats, closes: Floats, first: NDArray[np.bool_]) -> bool:
    """Make the time of arcs that no feasible order uses infinite; tell whether there are any."""
    n, changed = len(time), False
    for i in range(n):
        for j in range(n):
            if np.isfinite(time[i, j]) and i != j and excluded(far, time[i, j], opens, closes, first, i, j):
                time[i, j] = np.inf
                changed = True
    return changed


@bare_kernel
def tightened(
    time: Floats, far: Floats, opens: Floats, closes: Floats, first: NDArray[np.bool_], j: int
) -> tuple[float, float]:
    """Return the window of stop j, tightened by the windows of the stops before and after it."""
    n = len(time)
    earliest, latest = opens[j], closes[j]
    if j > 0:
        # The order comes from some stop i to j, so that service at j starts between the least and the largest arrival.
        soonest, last_arrival = np.inf, -np.inf
        for i in range(n):
            if i != j:
                soonest = min(soonest, opens[i] + time[i, j])
                if np.isfinite(time[i, j]):
                    last_arrival = max(last_arrival, closes[i] + time[i, j])
            if first[i, j]:
                earliest = max(earliest, opens[i] + far[i, j])
        earliest = max(earliest, soonest)
        latest = min(latest, max(earliest, last_arrival))
    if j < n - 1:
        # It goes from j to some stop i, whose window must still be open.
        last_departure = -np.inf
        for i in range(n):
            if i != j and np.isfinite(time[j, i]):
                last_departure = max(last_departure, closes[i] - time[j, i])
            if first[j, i]:
                latest = min(latest, closes[i] - far[j, i])
        latest = min(latest, last_departure)
    return earliest, latest


@bare_kernel
def excluded(far: Floats, step: float, opens: Floats, closes: Floats, first: NDArray[np.bool_], i: int, j: int) -> bool:
    """Tell whether no feasible order goes directly from i to j."""
    n = len(far)
    if first[j, i] or opens[i] + step > closes[j]:
        return True
    there = max(opens[i] + step, opens[j])
    for k in range(n):
        if k in (i, j):
            continue
        # k must come before i or after j, or the arc cannot be used. Where it cannot reach i in time, i comes before k.
        sooner = not first[i, k] and max(opens[k] + far[k, i], opens[i]) + step <= closes[j]
        later = not first[k, j] and there + far[j, k] <= closes[k]
        if not sooner and not later:
            return True
    return False


@kernel
def assignment(cost: Floats) -> tuple[Floats, Floats]:
    """Return dual values (rows, columns) of the least assignment of rows to columns, by shortest augmenting paths.

    An infinite cost means no arc. A row that can reach no column is left out, which keeps the dual values feasible.
    """
    n = len(cost)
    u, v = np.zeros(n + 1), np.zeros(n + 1)
    row_of, previous = np.zeros(n + 1, dtype=np.int64), np.zeros(n + 1, dtype=np.int64)
    for i in range(1, n + 1):
        row_of[0] = i
        at = 0
        least = np.full(n + 1, np.inf)
        used = np.zeros(n + 1, dtype=np.bool_)
        while at >= 0 and row_of[at] != 0:
            used[at] = True
            row, delta, then = row_of[at], np.inf, -1
            for j in range(1, n + 1):
                if not used[j]:
                    here = cost[row - 1, j - 1] - u[row] - v[j]
                    if here < least[j]:
                        least[j], previous[j] = here, at
                    if least[j] < delta:
                        delta, then = least[j], j
            if then >= 0:
                for j in range(n + 1):
                    if used[j]:
                        u[row_of[j]] += delta
                        v[j] -= delta
                    else:
                        least[j] -= delta
            at = then
        while at > 0:
            row_of[at] = row_of[previous[at]]
            at = previous[at]
    return u[1:], v[1:]


@bare_kernel
def late(far: Floats, opens: Floats, closes: Floats, i: int, j: int, k: int) -> bool:
    """Tell whether going from the start through i, j and k to the end is late somewhere; stops may repeat."""
    n = len(far)
    now, at = opens[0], 0
    for stop in (i, j, k, n - 1):
        if stop != at:
            now = max(now + far[at, stop], opens[stop])
            at = stop
        if now > closes[stop]:
            return True
    return False


@kernel
def conflict(far: Floats, opens: Floats, closes: Floats) -> tuple[int, int, int]:
    """Return one to three stops that no order can visit in time, even without others, padded with -1."""
    last = len(far) - 1
    for i in range(last):
        if late(far, opens, closes, i, i, i):
            return i, -1, -1
    for i in range(1, last):
        for j in range(i + 1, last):
            if late(far, opens, closes, i, j, j) and late(far, opens, closes, j, i, i):
                return i, j, -1
    for i in range(1, last):
        for j in range(i + 1, last):
            for k in range(j + 1, last):
                possible = False
                for a, b, c in ((i, j, k), (j, i, k), (k, i, j), (k, j, i), (i, k, j), (j, k, i)):
                    possible = possible or not late(far, opens, closes, a, b, c)
                if not possible:
                    return i, j, k
    return -1, -1, -1
