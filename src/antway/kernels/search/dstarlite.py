"""D* Lite on a padded flat grid: when cells change or the robot moves, only the affected part is searched again.

Koenig and Likhachev, D* Lite, AAAI 2002, optimised version; `g`, `rhs`, the keys and k_m are the paper's. Costs are sums of
the fine lengths of `lengths`. Moves are numbered as the directions in `canonical`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Bools, Ints
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.search.canonical import COL, ROW
from antway.kernels.search.lengths import FINE_DIAGONAL as DIAGONAL
from antway.kernels.search.lengths import FINE_STRAIGHT as STRAIGHT
from antway.kernels.search.lengths import octile

INF = 1 << 60  # cost where there is no path
# Indices of `state`: width of the padded grid, number of moves (4 or 8), number of side cells of a diagonal that must be free,
# start, goal, k_m, size of the queue, number of expansions.
WIDTH, MOVES, NEED, START, GOAL, KM, SIZE, EXPANDED = range(8)


class DStar(NamedTuple):
    """The memory of a search; the arrays [N] but `queue` are indexed by the flat cell of the padded grid."""

    free: Bools
    g: Ints
    rhs: Ints
    key: Ints  # [N, 2]
    queue: Ints  # [N]; heap of the cells where g and rhs differ
    place: Ints  # [N]; position in `queue`, or -1
    state: Ints  # [8]


@bare_kernel
def compute(d: DStar, steps: int) -> bool:
    """Expand at most `steps` cells; tell whether `rhs` of the start is now its distance to the goal."""
    start = d.state[START]
    for _ in range(steps):
        if d.state[SIZE] == 0:
            return True
        u = d.queue[0]
        first, second = _key(d, start)
        if not _less(d.key[u, 0], d.key[u, 1], first, second) and d.rhs[start] <= d.g[start]:
            return True
        first, second = _key(d, u)
        if _less(d.key[u, 0], d.key[u, 1], first, second):
            d.key[u, 0], d.key[u, 1] = first, second
            _sink(d, 0)
            continue
        d.state[EXPANDED] += 1
        old = d.g[u]
        d.g[u] = d.rhs[u] if old > d.rhs[u] else INF
        for k in range(d.state[MOVES]):
            s = u + _offset(d, k)
            cost = _cost(d, u, k)
            if cost == INF or s == d.state[GOAL]:
                continue
            before = d.rhs[s]
            if d.g[u] != INF:
                d.rhs[s] = min(before, cost + d.g[u])
            elif before == cost + old:
                d.rhs[s] = _look_ahead(d, s)
            if d.rhs[s] != before:
                _update(d, s)
        _update(d, u)
    return False


@bare_kernel
def change(d: DStar, cells: Ints, now_free: Bools) -> None:
    """Set the `cells` to `now_free` and update `rhs` around those that changed; `cells` is overwritten."""
    changed = 0
    for i in range(len(cells)):
        if d.free[cells[i]] != now_free[i]:
            d.free[cells[i]] = now_free[i]
            cells[changed] = cells[i]
            changed += 1
    for i in range(changed):
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                s = cells[i] + dr * d.state[WIDTH] + dc
                if s != d.state[GOAL]:
                    d.rhs[s] = _look_ahead(d, s)
                    _update(d, s)


@bare_kernel
def initialize(d: DStar) -> None:
    """Put the goal, at distance 0, on the queue."""
    d.rhs[d.state[GOAL]] = 0
    _update(d, d.state[GOAL])


@bare_kernel
def move(d: DStar, start: int) -> None:
    """Move the robot to `start`. k_m grows by the largest decrease of the heuristic, so that keys stay lower bounds."""
    d.state[KM] += _heuristic(d, d.state[START], start)
    d.state[START] = start


@kernel
def descend(d: DStar) -> tuple[NDArray[np.int32], int]:
    """Return a shortest path from the start as (row, col), and its number of diagonal moves; there must be one."""
    s, n, diagonals = d.state[START], 1, 0
    path = np.empty((d.rhs[s] // STRAIGHT + 1, 2), np.int32)  # no move is cheaper than a straight one
    path[0, 0], path[0, 1] = s // d.state[WIDTH] - 1, s % d.state[WIDTH] - 1
    while s != d.state[GOAL]:
        k = 0  # one of the moves leads to the neighbour that determines `rhs`
        while d.g[s + _offset(d, k)] + (STRAIGHT if k < 4 else DIAGONAL) != d.rhs[s] or _cost(d, s, k) == INF:
            k += 1
        path[n, 0], path[n, 1] = path[n - 1, 0] + ROW[k], path[n - 1, 1] + COL[k]
        s += _offset(d, k)
        n += 1
        diagonals += k >= 4
    return path[:n], diagonals


@bare_kernel
def _offset(d: DStar, k: int) -> int:
    """Return the flat offset of move `k`."""
    return int(ROW[k] * d.state[WIDTH] + COL[k])


@bare_kernel
def _cost(d: DStar, s: int, k: int) -> int:
    """Return the cost of move `k` from or to `s`; INF if it is illegal."""
    t = s + _offset(d, k)
    if not (d.free[s] and d.free[t]):
        return INF
    if k < 4:
        return STRAIGHT
    sides = int(d.free[s + ROW[k] * d.state[WIDTH]]) + int(d.free[s + COL[k]])
    return DIAGONAL if sides >= d.state[NEED] else INF


@bare_kernel
def _look_ahead(d: DStar, s: int) -> int:
    """Return the least cost from `s` to the goal through a neighbour."""
    best = INF
    if d.free[s]:
        for k in range(d.state[MOVES]):
            cost = _cost(d, s, k)
            if cost != INF:
                best = min(best, cost + d.g[s + _offset(d, k)])
    return best


@bare_kernel
def _heuristic(d: DStar, s: int, t: int) -> int:
    """Return the cost between two cells on an empty map."""
    width = d.state[WIDTH]
    shorter = STRAIGHT if d.state[MOVES] == 4 else DIAGONAL - STRAIGHT
    return octile(s // width, s % width, t // width, t % width, STRAIGHT, shorter)


@bare_kernel
def _key(d: DStar, s: int) -> tuple[int, int]:
    """Return the key of `s`."""
    least = min(d.g[s], d.rhs[s])
    return least + _heuristic(d, d.state[START], s) + d.state[KM], least


@bare_kernel
def _less(a: int, b: int, c: int, d: int) -> bool:
    """Compare the keys (a, b) and (c, d)."""
    return a < c or (a == c and b < d)


@bare_kernel
def _update(d: DStar, s: int) -> None:
    """Put `s` where it belongs in the queue, or take it out if it is consistent."""
    i = d.place[s]
    if d.g[s] != d.rhs[s]:
        d.key[s, 0], d.key[s, 1] = _key(d, s)
        if i < 0:
            i = d.state[SIZE]
            d.state[SIZE] += 1
            d.queue[i], d.place[s] = s, i
        _rise(d, i)
        _sink(d, d.place[s])
    elif i >= 0:
        d.place[s] = -1
        d.state[SIZE] -= 1
        last = d.queue[d.state[SIZE]]
        if last != s:
            d.queue[i], d.place[last] = last, i
            _rise(d, i)
            _sink(d, d.place[last])


@bare_kernel
def _rise(d: DStar, i: int) -> None:
    """Move the entry at `i` up to where no entry above it is greater."""
    s = d.queue[i]
    while i > 0:
        above = d.queue[(i - 1) >> 1]
        if not _less(d.key[s, 0], d.key[s, 1], d.key[above, 0], d.key[above, 1]):
            break
        d.queue[i], d.place[above] = above, i
        i = (i - 1) >> 1
    d.queue[i], d.place[s] = s, i


@bare_kernel
def _sink(d: DStar, i: int) -> None:
    """Move the entry at `i` down to where no entry below it is less."""
    s = d.queue[i]
    while 2 * i + 1 < d.state[SIZE]:
        j = 2 * i + 1
        if j + 1 < d.state[SIZE] and _less(
            d.key[d.queue[j + 1], 0], d.key[d.queue[j + 1], 1], d.key[d.queue[j], 0], d.key[d.queue[j], 1]
        ):
            j += 1
        below = d.queue[j]
        if not _less(d.key[below, 0], d.key[below, 1], d.key[s, 0], d.key[s, 1]):
            break
        d.queue[i], d.place[below] = below, i
        i = j
    d.queue[i], d.place[s] = s, i
