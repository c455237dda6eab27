"""2-opt, Or-opt and 3-opt for a tour in an array, with neighbour lists and a queue of cities to examine.

A move removes the edges (t1, t2), (t3, t4) and possibly (t5, t6) and adds (t2, t3), (t4, t5), (t6, t1), where all partial
gains are positive (Lin, Kernighan 1973; all sequential 3-opt moves). Moves consist of reversals, each of the shorter side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.colony.tour import Cities, Ids, Index, distance

# Elements of `Search.counts`.
HEAD = 0  # place of the first city in the queue
SIZE = 1  # number of cities in the queue
LOGGED = 2  # number of logged reversals
# Shapes of a move.
TWO = 0  # 2-opt: one part is reversed
THREE = 1  # 3-opt by two reversals, whose first one already gives a tour
SWAPPED = 2  # 3-opt: two neighbouring parts are swapped
REVERSED = 3  # 3-opt: two neighbouring parts are both reversed where they are


class Search(NamedTuple):
    """A tour that is being improved. Always order[place[i]] == i."""

    order: Ids  # [n]
    place: Ids  # [n]
    queue: Ids  # [n] ring buffer of the cities to examine
    queued: NDArray[np.bool_]  # [n] whether a city is in the queue (the negated don't-look bit)
    log: NDArray[np.int64]  # [r, 2] reversals since the log was cleared, for undoing them; empty: nothing is logged
    counts: NDArray[np.int64]  # [3] see HEAD, SIZE and LOGGED


@kernel
def workspace(n: int, log: int) -> Search:
    """Return scratch for tours of n cities that can undo `log` reversals."""
    order, place, queue = np.empty(n, dtype=np.uint32), np.empty(n, dtype=np.uint32), np.empty(n, dtype=np.uint32)
    reversals, counts = np.empty((log, 2), dtype=np.int64), np.zeros(3, dtype=np.int64)
    return Search(order, place, queue, np.zeros(n, dtype=np.bool_), reversals, counts)


@bare_kernel
def set_tour(search: Search, order: Ids) -> None:
    """Take `order` as the tour."""
    for p in range(len(order)):
        search.order[p] = order[p]
        search.place[order[p]] = p


@bare_kernel
def push(search: Search, city: Index) -> None:
    """Put `city` at the end of the queue, unless it is queued already."""
    if not search.queued[city]:
        search.queued[city] = True
        tail = search.counts[HEAD] + search.counts[SIZE]
        n = len(search.queue)
        search.queue[tail - n if tail >= n else tail] = city
        search.counts[SIZE] += 1


@bare_kernel
def pop(search: Search) -> int:
    """Take the first city off the queue."""
    head = search.counts[HEAD]
    city: int = search.queue[head]
    search.counts[HEAD] = head + 1 if head + 1 < len(search.queue) else 0
    search.counts[SIZE] -= 1
    search.queued[city] = False
    return city


@bare_kernel
def beside(search: Search, city: Index, forward: bool) -> int:
    """Return the city after `city`, or before it."""
    p, last = search.place[city], len(search.order) - 1
    if forward:
        after: int = search.order[0 if p == last else p + 1]
        return after
    before: int = search.order[last if p == 0 else p - 1]
    return before


@bare_kernel
def between(search: Search, a: Index, b: Index, c: Index, forward: bool) -> bool:
    """Tell whether b is on the tour from a to c, ends included, in the given direction."""
    p, q, r = search.place[a], search.place[b], search.place[c]
    if not forward:
        p, r = r, p
    inside: bool = (p <= q and q <= r) if p <= r else (q >= p or q <= r)
    return inside


@bare_kernel
def reverse(search: Search, i: Index, j: Index) -> None:
    """Reverse the places i to j (cyclically if j < i), or the other places if they are fewer: the closed tour is the same."""
    order, place = search.order, search.place
    n: Index = np.int64(len(order))
    inside = j - i + 1 if j >= i else j - i + 1 + n
    if 2 * inside > n:
        i, j, inside = j + 1, i - 1, n - inside
        if i == n:
            i = np.int64(0)
        if j < 0:
            j = n - 1
    for _ in range(inside // 2):
        a, b = order[np.uint32(i)], order[np.uint32(j)]
        order[np.uint32(i)], order[np.uint32(j)] = b, a
        place[b], place[a] = i, j
        i += 1
        if i == n:
            i = np.int64(0)
        j -= 1
        if j < 0:
            j = n - 1


@bare_kernel
def flip(search: Search, a: Index, b: Index, c: Index, d: Index) -> None:
    """Replace the edges (a, b), (c, d) by (a, c), (b, d); b follows a and d follows c in the same direction."""
    if beside(search, a, True) == b:
        i, j = np.int64(search.place[b]), np.int64(search.place[c])
    else:
        i, j = np.int64(search.place[a]), np.int64(search.place[d])
    if len(search.log) > 0:
        at = search.counts[LOGGED]
        search.log[at, 0], search.log[at, 1] = i, j
        search.counts[LOGGED] += 1
    reverse(search, i, j)


@bare_kernel
def undo(search: Search) -> None:
    """Undo all logged reversals."""
    for at in range(search.counts[LOGGED] - 1, -1, -1):
        reverse(search, search.log[at, 0], search.log[at, 1])
    search.counts[LOGGED] = 0


@bare_kernel
def small(search: Search, t2: Index, t3: Index, t5: Index, longest: int) -> bool:
    """Tell whether the part that a 3-opt move displaces, cut at t2, t3 and t5, has about `longest` cities at most."""
    n = len(search.order)
    if longest >= n:
        return True
    p, q, r = np.int64(search.place[t2]), np.int64(search.place[t3]), np.int64(search.place[t5])
    parts = min(abs(p - q), n - abs(p - q)), min(abs(q - r), n - abs(q - r)), min(abs(p - r), n - abs(p - r))
    return bool(min(parts[0], min(parts[1], parts[2])) <= longest)


@bare_kernel
def exchange(search: Search, shape: int, t1: Index, t2: Index, t3: Index, t4: Index, t5: Index, t6: Index) -> None:
    """Make a move by one to three flips, and queue its ends."""
    # The compiler wants as many steps of each shape; only the first `count` are made.
    steps = (t1, t2, t4, t3), (t1, t4, t6, t5), (t1, t2, t4, t3)
    count = 1 if shape == TWO else 2
    if shape == SWAPPED:  # the parts t2 ... t5 and t6 ... t3 are swapped
        steps, count = ((t1, t2, t3, t4), (t1, t3, t6, t5), (t3, t5, t2, t4)), 3
    elif shape == REVERSED:  # the parts t2 ... t6 and t5 ... t3 are reversed
        steps = (t1, t2, t6, t5), (t2, t5, t3, t4), (t1, t2, t4, t3)
    for s in range(count):
        flip(search, steps[s][0], steps[s][1], steps[s][2], steps[s][3])
    for city in (t1, t2, t3, t4, t5, t6):
        push(search, city)


@bare_kernel
def move(cities: Cities, search: Search, t1: Index, breadth: int, longest: int) -> float:
    """Make the first improving move found that removes an edge of t1; return its gain, or 0 if there is none."""
    metric, near, gap, least = cities.metric, cities.near, cities.gap, cities.least
    for forward in (True, False):
        t2 = beside(search, t1, forward)
        d12 = distance(metric, t1, t2)
        for c in range(near.shape[1]):
            t3 = near[t2, c]
            g1 = d12 - gap[t2, c]
            if g1 <= least:
                break
            if t3 == t1:
                continue
            # t4 before t3 closes a tour. With t4 after t3, t2 ... t3 is a cycle, and the third edge must open it.
            for cycle in (False, True):
                t4 = beside(search, t3, forward == cycle)
                if t4 == t2:
                    continue
                g2 = g1 + distance(metric, t3, t4)
                if not cycle:
                    gain: float = g2 - distance(metric, t4, t1)
                    if gain > least:
                        exchange(search, TWO, t1, t2, t3, t4, t1, t2)
                        return gain
                for e in range(min(breadth, near.shape[1])):
                    t5 = near[t4, e]
                    g3 = g2 - gap[t4, e]
                    if g3 <= least:
                        break
                    inside = between(search, t2, t5, t3 if cycle else t4, forward)
                    if t5 in (t3, t1) or (cycle and not inside) or not small(search, t2, t3, t5, longest):
                        continue
                    for path in (True, False):
                        t6 = beside(search, t5, path)
                        if t6 in (t1, t4) or (not cycle and path != (inside == forward)):
                            continue
                        gain = g3 + distance(metric, t5, t6) - distance(metric, t6, t1)
                        if gain > least:
                            shape = THREE if not cycle else SWAPPED if path == forward else REVERSED
                            exchange(search, shape, t1, t2, t3, t4, t5, t6)
                            return gain
    return 0.0


@bare_kernel
def settle(cities: Cities, search: Search, breadth: int, longest: int) -> float:
    """Improve until the queue is empty or the log is full; return the gain."""
    total = 0.0
    slack = len(search.log)
    while search.counts[SIZE] > 0:
        city = pop(search)
        if slack > 0 and search.counts[LOGGED] + 3 > slack:
            continue
        gain = move(cities, search, city, breadth, longest)
        if gain > 0.0:
            total += gain
            push(search, city)
    return total


@kernel
def improve(cities: Cities, search: Search, order: Ids, breadth: int, longest: int) -> float:
    """Improve the tour `order` in place to a local optimum and return the gain; `search` is scratch, with an empty queue.

    For the third edge `breadth` candidates are tried; 0 is 2-opt. The part that a 3-opt move displaces has at most `longest`
    cities; 3 is Or-opt, n full 3-opt.
    """
    set_tour(search, order)
    for city in order:
        push(search, city)
    gain = settle(cities, search, breadth, longest)
    copy_row(search.order, order)
    return gain
