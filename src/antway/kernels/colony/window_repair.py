"""Reduces the lateness of orders: single stops are moved, first where that helps, then at random."""

from __future__ import annotations

import numpy as np

from antway.kernels.base import rng
from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.colony.windows import Ids

WORK = 600_000_000  # limit of stops evaluated in one descent, about a second
QUICK_WORK = 150_000_000  # the same limit where there is less time


@bare_kernel
def lateness(time: Floats, opens: Floats, closes: Floats, order: Ids, most: float) -> float:
    """Return the sum of the lateness of all services; if it is more than `most`, any number above `most`."""
    late, now = 0.0, opens[order[0]]
    for p in range(1, len(order)):
        j = order[p]
        now = max(now + time[order[p - 1], j], opens[j])
        if now > closes[j]:
            late += now - closes[j]
            if late > most:
                break
    return late


@bare_kernel
def move(order: Ids, p: int, q: int) -> None:
    """Move the stop at place p to place q."""
    stop = order[p]
    step = 1 if q > p else -1
    while p != q:
        order[p] = order[p + step]
        p += step
    order[q] = stop


@kernel
def least_late_place(time: Floats, opens: Floats, closes: Floats, order: Ids, stop: int) -> int:
    """Return the place at which to insert `stop` into `order` so that it becomes least late, then shortest."""
    trial = np.empty(len(order) + 1, dtype=np.int32)
    trial[0], trial[1] = order[0], stop
    for p in range(1, len(order)):
        trial[p + 1] = order[p]
    best, least, place = np.inf, np.inf, 1
    for p in range(1, len(order)):
        late = lateness(time, opens, closes, trial, best)
        detour = time[order[p - 1], stop] + time[stop, order[p]] - time[order[p - 1], order[p]]
        if late < best or (late == best and detour < least):
            best, least, place = late, detour, p
        trial[p], trial[p + 1] = trial[p + 1], trial[p]
    return place


@bare_kernel
def descend(time: Floats, opens: Floats, closes: Floats, order: Ids, late: float, work: int, state: rng.State) -> float:
    """Move single stops as long as that reduces the lateness, or until `work` is done; return the lateness."""
    n = len(order)
    quiet, p, left = 0, 1 + rng.below(state, n - 2), max(work // (n * n), 1)
    while quiet < n - 2 and late > 0.0 and left > 0:
        left -= 1
        best, to = late, p
        # The stop moves through all places one by one, so that each trial takes one exchange.
        at = p
        for turn in range(2):
            step = -1 if turn == 0 else 1
            move(order, at, p)
            at = p
            while 1 <= at + step <= n - 2:
                move(order, at, at + step)
                at += step
                here = lateness(time, opens, closes, order, best)
                if here < best:
                    best, to = here, at
        move(order, at, to)
        if to != p:
            late, quiet = best, 0
        else:
            quiet += 1
            p = p + 1 if p < n - 2 else 1
    return late


@kernel
def repair(time: Floats, opens: Floats, closes: Floats, order: Ids, attempts: int, seed: np.uint64, work: int = WORK) -> float:
    """Reduce the lateness of `order` in place, by `attempts` rounds of one to eight random moves; return its lateness.

    Each descent evaluates at most `work` stops. The first and the last stop stay (variable neighbourhoods: da Silva, Urrutia
    2010). time : [n, n] finite.
    """
    state = np.array([seed], dtype=np.uint64)
    late = lateness(time, opens, closes, order, np.inf)
    if len(order) < 4:
        return late
    late = descend(time, opens, closes, order, late, work, state)
    trial = order.copy()
    level = 1
    for _ in range(attempts):
        if late == 0.0:
            break
        copy_row(order, trial)
        for _ in range(level):
            move(trial, 1 + rng.below(state, len(order) - 2), 1 + rng.below(state, len(order) - 2))
        here = descend(time, opens, closes, trial, lateness(time, opens, closes, trial, np.inf), work, state)
        level = level + 1 if level < 8 else 1
        if here < late:
            late, level = here, 1
            copy_row(trial, order)
        elif here == late:
            copy_row(trial, order)
    return late
