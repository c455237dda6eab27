"""2-opt, Or-opt and 3-opt of a tour held as an array, with neighbour lists and a queue of cities to look at.

A move removes the edges (t1, t2), (t3, t4) and perhaps (t5, t6) and adds (t2, t3), (t4, t5), (t6, t1), such that the partial
gains stay positive (Lin, Kernighan 1973; all sequential 3-opt moves). Moves are made of reversals, each of the shorter side.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.jit import bare_kernel, kernel
from antway.kernels.tour import Cities, Ids, distance

HEAD, SIZE, LOGGED = range(3)


class Search(NamedTuple):
    """A tour under improvement. order[place[i]] == i throughout."""

    order: Ids  # [n]
    place: Ids  # [n]
    queue: Ids  # [n] ring of the cities to look at
    queued: NDArray[np.bool_]  # [n] which those are (the don't-look bits, negated)
    log: NDArray[np.int64]  # [r, 2] reversals made since the log was cleared, for undoing; empty: none is kept
    count: NDArray[np.int64]  # [3] head and size of the queue, reversals logged


@kernel
def workspace(n: int, log: int) -> Search:
    """Return scratch for tours of n cities that can undo `log` reversals."""
    return Search(
        np.empty(n, dtype=np.uint32),
        np.empty(n, dtype=np.uint32),
        np.empty(n, dtype=np.uint32),
        np.zeros(n, dtype=np.bool_),
        np.empty((log, 2), dtype=np.int64),
        np.zeros(3, dtype=np.int64),
    )


@bare_kernel
def set_tour(search: Search, order: Ids) -> None:
    """Take `order` as the tour."""
    for p in range(len(order)):
        search.order[p] = order[p]
        search.place[order[p]] = p


@bare_kernel
def push(search: Search, city: int) -> None:
    """Put `city` at the end of the queue, unless it is in it."""
    if not search.queued[city]:
        search.queued[city] = True
        tail = search.count[HEAD] + search.count[SIZE]
        n = len(search.queue)
        search.queue[tail - n if tail >= n else tail] = city
        search.count[SIZE] += 1


@bare_kernel
def pop(search: Search) -> int:
    """Take the first city off the queue."""
    head = search.count[HEAD]
    city = search.queue[head]
    search.count[HEAD] = head + 1 if head + 1 < len(search.queue) else 0
    search.count[SIZE] -= 1
    search.queued[city] = False
    return city


@bare_kernel
def beside(search: Search, city: int, forward: bool) -> int:
    """Return the city after `city`, or before it."""
    p, last = search.place[city], len(search.order) - 1
    if forward:
        return search.order[0 if p == last else p + 1]
    return search.order[last if p == 0 else p - 1]


@bare_kernel
def between(search: Search, a: int, b: int, c: int, forward: bool) -> bool:
    """Tell whether b lies on the way from a to c, ends included, in that direction."""
    p, q, r = search.place[a], search.place[b], search.place[c]
    if not forward:
        p, r = r, p
    return (p <= q and q <= r) if p <= r else (q >= p or q <= r)


@bare_kernel
def reverse(search: Search, i: int, j: int) -> None:
    """Reverse the places i to j (round the end if j < i), or all others if those are fewer, which is the same closed tour."""
    order, place = search.order, search.place
    n = np.int64(len(order))
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
def flip(search: Search, a: int, b: int, c: int, d: int) -> None:
    """Replace edges (a, b), (c, d) by (a, c), (b, d), where b comes next to a and d next to c in the same direction."""
    if beside(search, a, True) == b:
        i, j = np.int64(search.place[b]), np.int64(search.place[c])
    else:
        i, j = np.int64(search.place[a]), np.int64(search.place[d])
    if len(search.log) > 0:
        at = search.count[LOGGED]
        search.log[at, 0], search.log[at, 1] = i, j
        search.count[LOGGED] += 1
    reverse(search, i, j)


@bare_kernel
def undo(search: Search) -> None:
    """Take back all logged reversals."""
    for at in range(search.count[LOGGED] - 1, -1, -1):
        reverse(search, search.log[at, 0], search.log[at, 1])
    search.count[LOGGED] = 0


@bare_kernel
def push_six(search: Search, t1: int, t2: int, t3: int, t4: int, t5: int, t6: int) -> None:
    """Queue the ends of a move."""
    push(search, t1)
    push(search, t2)
    push(search, t3)
    push(search, t4)
    push(search, t5)
    push(search, t6)


@bare_kernel
def small(search: Search, t2: int, t3: int, t5: int, longest: int) -> bool:
    """Tell whether a part that a 3-opt move displaces, cut at t2, t3 and t5, has at most `longest` cities or so."""
    n = len(search.order)
    if longest >= n:
        return True
    p, q, r = np.int64(search.place[t2]), np.int64(search.place[t3]), np.int64(search.place[t5])
    parts = min(abs(p - q), n - abs(p - q)), min(abs(q - r), n - abs(q - r)), min(abs(p - r), n - abs(p - r))
    return min(parts[0], min(parts[1], parts[2])) < longest


@bare_kernel
def move(cities: Cities, search: Search, t1: int, breadth: int, longest: int) -> float:
    """Make the first improving move found that removes an edge of t1; return its gain, or 0 if there is none."""
    kind, xy, matrix, near, gap, least = cities.kind, cities.xy, cities.matrix, cities.near, cities.gap, cities.least
    k = near.shape[1]
    for forward in (True, False):
        t2 = beside(search, t1, forward)
        d12 = distance(kind, xy, matrix, t1, t2)
        for c in range(k):
            t3 = near[t2, c]
            g1 = d12 - gap[t2, c]
            if g1 <= least:
                break
            # t4 before t3: a 2-opt move, and from there on to a third edge.
            t4 = beside(search, t3, not forward)
            if t4 != t2 and t3 != t1:
                g2 = g1 + distance(kind, xy, matrix, t3, t4)
                gain = g2 - distance(kind, xy, matrix, t4, t1)
                if gain > least:
                    flip(search, t1, t2, t4, t3)
                    push_six(search, t1, t2, t3, t4, t1, t2)
                    return gain
                for e in range(breadth):
                    t5 = near[t4, e]
                    g3 = g2 - gap[t4, e]
                    if g3 <= least:
                        break
                    if t5 in (t3, t1) or not small(search, t2, t3, t5, longest):
                        continue
                    t6 = beside(search, t5, between(search, t2, t5, t4, forward) == forward)
                    if t6 == t4:
                        continue
                    gain = g3 + distance(kind, xy, matrix, t5, t6) - distance(kind, xy, matrix, t6, t1)
                    if gain > least:
                        flip(search, t1, t2, t4, t3)
                        flip(search, t1, t4, t6, t5)
                        push_six(search, t1, t2, t3, t4, t5, t6)
                        return gain
            # t4 after t3: closing here would leave a cycle t2 ... t3; the third edge must open it.
            t4 = beside(search, t3, forward)
            if t3 == t1 or t4 == t2 or breadth == 0:
                continue
            g2 = g1 + distance(kind, xy, matrix, t3, t4)
            for e in range(breadth):
                t5 = near[t4, e]
                g3 = g2 - gap[t4, e]
                if g3 <= least:
                    break
                if t5 == t3 or not between(search, t2, t5, t3, forward) or not small(search, t2, t3, t5, longest):
                    continue
                t6 = beside(search, t5, forward)
                gain = g3 + distance(kind, xy, matrix, t5, t6) - distance(kind, xy, matrix, t6, t1)
                if gain > least:
                    flip(search, t1, t2, t3, t4)
                    flip(search, t1, t3, t6, t5)
                    flip(search, t3, t5, t2, t4)
                    push_six(search, t1, t2, t3, t4, t5, t6)
                    return gain
                if t5 == t2:
                    continue
                t6 = beside(search, t5, not forward)
                gain = g3 + distance(kind, xy, matrix, t5, t6) - distance(kind, xy, matrix, t6, t1)
                if gain > least:
                    flip(search, t1, t2, t6, t5)
                    flip(search, t2, t5, t3, t4)
                    push_six(search, t1, t2, t3, t4, t5, t6)
                    return gain
    return 0.0


@bare_kernel
def settle(cities: Cities, search: Search, breadth: int, longest: int) -> float:
    """Improve until the queue is empty (or the log of reversals full); return the gain."""
    total = 0.0
    room = len(search.log)
    while search.count[SIZE] > 0:
        city = pop(search)
        if room > 0 and search.count[LOGGED] + 3 > room:
            continue
        gain = move(cities, search, city, breadth, longest)
        if gain > 0.0:
            total += gain
            push(search, city)
    return total


@kernel
def improve(cities: Cities, search: Search, order: Ids, breadth: int, longest: int) -> float:
    """Improve the tour `order` in place to a local optimum and return the gain.

    breadth : candidates tried for the third edge; 0 is 2-opt.
    longest : cities in the part that a 3-opt move displaces; 3 is Or-opt, n full 3-opt.
    """
    set_tour(search, order)
    for city in order:
        push(search, city)
    gain = settle(cities, search, breadth, longest)
    order[:] = search.order
    return gain
