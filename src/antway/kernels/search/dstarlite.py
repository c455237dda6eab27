"""D* Lite on a padded flat grid: when cells change or the robot moves, only the affected part is searched again.

Koenig and Likhachev, D* Lite, AAAI 2002, optimised version; `g`, `rhs`, the keys and k_m are the paper's. A step costs 5741
and a diagonal 8119, a convergent of the square root of 2: paths compare as by their true lengths if their numbers of diagonals
differ by less than 5741.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, kernel

Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]

STEP, DIAGONAL = 5741, 8119
INF = 1 << 60
WIDTH, MOVES, NEED, START, GOAL, KM, SIZE, EXPANDED = range(8)  # indices of `state`


@bare_kernel
def compute(free: Bools, g: Ints, rhs: Ints, key: Ints, queue: Ints, place: Ints, state: Ints, steps: int) -> bool:
    """Expand at most `steps` cells; tell whether `rhs` of the start is now its distance to the goal.

    `free`, `g`, `rhs`, `key` [N, 2] and `place`, the position in `queue` or -1, are indexed by flat cell, padded by one.
    `queue` [N] is a heap of the cells where g and rhs differ. `state` [8] is the width of the padded grid, the number of moves
    (4 or 8), the side cells of a diagonal that must be free, start, goal, k_m, the size of the queue, and the expansions.
    """
    start = state[START]
    for _ in range(steps):
        if state[SIZE] == 0:
            return True
        u = queue[0]
        first, second = _key(g, rhs, state, start)
        if not _less(key[u, 0], key[u, 1], first, second) and rhs[start] <= g[start]:
            return True
        first, second = _key(g, rhs, state, u)
        if _less(key[u, 0], key[u, 1], first, second):
            key[u, 0], key[u, 1] = first, second
            _sink(key, queue, place, state, 0)
            continue
        state[EXPANDED] += 1
        old = g[u]
        g[u] = rhs[u] if old > rhs[u] else INF
        for k in range(state[MOVES]):
            s = u + _offset(state, k)
            cost = _cost(free, state, u, k)
            if cost == INF or s == state[GOAL]:
                continue
            before = rhs[s]
            if g[u] != INF:
                rhs[s] = min(before, cost + g[u])
            elif before == cost + old:
                rhs[s] = _look_ahead(free, g, state, s)
            if rhs[s] != before:
                _update(g, rhs, key, queue, place, state, s)
        _update(g, rhs, key, queue, place, state, u)
    return False


@bare_kernel
def change(
    free: Bools, g: Ints, rhs: Ints, key: Ints, queue: Ints, place: Ints, state: Ints, cells: Ints, now_free: Bools
) -> None:
    """Set the `cells` to `now_free` and update `rhs` around those that changed; `cells` is overwritten."""
    changed = 0
    for i in range(len(cells)):
        if free[cells[i]] != now_free[i]:
            free[cells[i]] = now_free[i]
            cells[changed] = cells[i]
            changed += 1
    for i in range(changed):
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                s = cells[i] + dr * state[WIDTH] + dc
                if s != state[GOAL]:
                    rhs[s] = _look_ahead(free, g, state, s)
                    _update(g, rhs, key, queue, place, state, s)


@bare_kernel
def initialize(g: Ints, rhs: Ints, key: Ints, queue: Ints, place: Ints, state: Ints) -> None:
    """Put the goal, at distance 0, on the queue."""
    rhs[state[GOAL]] = 0
    _update(g, rhs, key, queue, place, state, state[GOAL])


@bare_kernel
def move(state: Ints, start: int) -> None:
    """Move the robot to `start`. k_m grows by the largest decrease of the heuristic, so that keys stay lower bounds."""
    state[KM] += _heuristic(state, state[START], start)
    state[START] = start


@kernel
def descend(free: Bools, g: Ints, rhs: Ints, state: Ints) -> tuple[NDArray[np.int32], int]:
    """Return a shortest path from the start as (row, col), and its number of diagonal moves; there must be one."""
    s, n, diagonals = state[START], 1, 0
    path = np.empty((rhs[s] // STEP + 1, 2), np.int32)  # no move is cheaper than a step
    path[0, 0], path[0, 1] = s // state[WIDTH] - 1, s % state[WIDTH] - 1
    while s != state[GOAL]:
        k = 0  # one of the moves leads to the neighbour that determines `rhs`
        while g[s + _offset(state, k)] + (STEP if k < 4 else DIAGONAL) != rhs[s] or _cost(free, state, s, k) == INF:
            k += 1
        down, right = _step(k)
        path[n, 0], path[n, 1] = path[n - 1, 0] + down, path[n - 1, 1] + right
        s += _offset(state, k)
        n += 1
        diagonals += k >= 4
    return path[:n], diagonals


@bare_kernel
def _step(k: int) -> tuple[int, int]:
    """Return the (row, col) of move `k`: right, down, left, up, then the diagonals clockwise from down-right."""
    if k < 4:
        return (k == 1) - (k == 3), (k == 0) - (k == 2)
    return 1 if k < 6 else -1, -1 if 4 < k < 7 else 1


@bare_kernel
def _offset(state: Ints, k: int) -> int:
    """Return the flat offset of move `k`."""
    down, right = _step(k)
    return int(down * state[WIDTH] + right)


@bare_kernel
def _cost(free: Bools, state: Ints, s: int, k: int) -> int:
    """Return the cost of move `k` from or to `s`; INF if it is illegal."""
    t = s + _offset(state, k)
    if not (free[s] and free[t]):
        return INF
    if k < 4:
        return STEP
    sides = int(free[s + (state[WIDTH] if k < 6 else -state[WIDTH])]) + int(free[s + (-1 if 4 < k < 7 else 1)])
    return DIAGONAL if sides >= state[NEED] else INF


@bare_kernel
def _look_ahead(free: Bools, g: Ints, state: Ints, s: int) -> int:
    """Return the least cost from `s` to the goal through a neighbour."""
    best = INF
    if free[s]:
        for k in range(state[MOVES]):
            cost = _cost(free, state, s, k)
            if cost != INF:
                best = min(best, cost + g[s + _offset(state, k)])
    return best


@bare_kernel
def _heuristic(state: Ints, s: int, t: int) -> int:
    """Return the cost between two cells on an empty map."""
    row, to_row = s // state[WIDTH], t // state[WIDTH]
    dr, dc = abs(row - to_row), abs(s - t - (row - to_row) * state[WIDTH])
    if state[MOVES] == 4:
        return int(STEP * (dr + dc))
    return int(STEP * max(dr, dc) + (DIAGONAL - STEP) * min(dr, dc))


@bare_kernel
def _key(g: Ints, rhs: Ints, state: Ints, s: int) -> tuple[int, int]:
    """Return the key of `s`."""
    least = min(g[s], rhs[s])
    if least == INF:
        return INF, INF
    return least + _heuristic(state, state[START], s) + state[KM], least


@bare_kernel
def _less(a: int, b: int, c: int, d: int) -> bool:
    """Compare the keys (a, b) and (c, d)."""
    return a < c or (a == c and b < d)


@bare_kernel
def _update(g: Ints, rhs: Ints, key: Ints, queue: Ints, place: Ints, state: Ints, s: int) -> None:
    """Put `s` where it belongs in the queue, or take it out if it is consistent."""
    i = place[s]
    if g[s] != rhs[s]:
        key[s, 0], key[s, 1] = _key(g, rhs, state, s)
        if i < 0:
            i = state[SIZE]
            state[SIZE] += 1
            queue[i], place[s] = s, i
        _rise(key, queue, place, i)
        _sink(key, queue, place, state, place[s])
    elif i >= 0:
        place[s] = -1
        state[SIZE] -= 1
        last = queue[state[SIZE]]
        if last != s:
            queue[i], place[last] = last, i
            _rise(key, queue, place, i)
            _sink(key, queue, place, state, place[last])


@bare_kernel
def _rise(key: Ints, queue: Ints, place: Ints, i: int) -> None:
    """Move the entry at `i` up to where no entry above it is greater."""
    s = queue[i]
    while i > 0:
        above = queue[(i - 1) >> 1]
        if not _less(key[s, 0], key[s, 1], key[above, 0], key[above, 1]):
            break
        queue[i], place[above] = above, i
        i = (i - 1) >> 1
    queue[i], place[s] = s, i


@bare_kernel
def _sink(key: Ints, queue: Ints, place: Ints, state: Ints, i: int) -> None:
    """Move the entry at `i` down to where no entry below it is less."""
    s = queue[i]
    while 2 * i + 1 < state[SIZE]:
        j = 2 * i + 1
        if j + 1 < state[SIZE] and _less(key[queue[j + 1], 0], key[queue[j + 1], 1], key[queue[j], 0], key[queue[j], 1]):
            j += 1
        below = queue[j]
        if not _less(key[below, 0], key[below, 1], key[s, 0], key[s, 1]):
            break
        queue[i], place[below] = below, i
        i = j
    queue[i], place[s] = s, i
