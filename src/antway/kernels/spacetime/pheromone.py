"""Pheromone in space and time on edges (cell, move, bin of arrival), in a small hash table of the edges that carry any."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Bools, Ints
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel

TRAILS = 1 << 12  # number of slots of the table, a power of two
_BINS = (1 << 16) - 1  # bins of arrival are counted up to this and then from 0 on, so that no clock makes a key negative
_LEAST_PERSISTENCE, _GREATEST_PERSISTENCE = 0.1, 0.9  # 1; limits of rho in `evaporate`
_HARDLY_MORE = 1.05  # 1; an edge with less pheromone than this is as good as one without


class Trails(NamedTuple):
    """Pheromone above the floor of 1 that every edge has."""

    key: Ints  # [TRAILS] code of (bin of arrival, cell, move); -1 is empty
    tau: NDArray[np.float32]  # [TRAILS]
    mark: Bools  # [cells] whether the cell carries pheromone
    bin: float  # s; width of a bin of arrival


@bare_kernel
def edge(trails: Trails, cell: int, move: int, t: float) -> int:
    """Return the key of the edge that leaves `cell`, reached at time t, by `move`."""
    return ((math.floor(t / trails.bin) & _BINS) * len(trails.mark) + cell) * 64 + move


@inner_kernel
def slot(trails: Trails, key: int) -> int:
    """Return the slot of `key`, or the empty slot where it belongs; -1 if all slots tried are taken."""
    h = (np.uint64(key) * np.uint64(0x9E3779B97F4A7C15)) >> np.uint64(40)
    for i in range(16):
        j: int = np.int64((h + np.uint64(i)) & np.uint64(TRAILS - 1))  # type: ignore[assignment]
        if trails.key[j] == key or trails.key[j] < 0:
            return j
    return -1


@bare_kernel
def lay(trails: Trails, key: int, amount: float) -> None:
    """Add `amount` to an edge; nothing is added if the edge finds no slot."""
    j = slot(trails, key)
    if j >= 0:
        if trails.key[j] < 0:
            trails.key[j], trails.tau[j] = key, 0.0
        trails.tau[j] += np.float32(amount)
        trails.mark[(key // 64) % len(trails.mark)] = True


@kernel
def evaporate(trails: Trails, now: float, cycle: float) -> None:
    """Let all pheromone evaporate: tau becomes rho tau with rho = clip(exp(-tau_min / tau) + exp(-cycle), 0.1, 0.9).

    This is the paper's adaptive persistence with its lost minus sign restored (`antway.ants.persistence.Adaptive`); tau_min is
    1, the floor of every edge. Edges whose bin of arrival is over at the time `now`, s, and those that are left with hardly
    more than the floor are dropped. The bins are absolute, so the pheromone need not be shifted in time.
    """
    bins, first = len(trails.mark) * 64, math.ceil(now / trails.bin) - 1  # the first bin that is not over
    keys, taus = trails.key.copy(), trails.tau.copy()
    trails.key[:] = -1
    trails.mark[:] = False
    for j in range(TRAILS):
        if keys[j] >= 0 and (keys[j] // bins - first) & _BINS <= _BINS // 2:
            tau = 1.0 + taus[j]
            rho = min(max(math.exp(-1.0 / tau) + math.exp(-cycle), _LEAST_PERSISTENCE), _GREATEST_PERSISTENCE)
            if rho * tau > _HARDLY_MORE:
                lay(trails, keys[j], rho * tau - 1.0)


@kernel
def window(trails: Trails, cols: int) -> tuple[int, int, NDArray[np.float32]]:
    """Return the maximum pheromone of each cell over moves and times, in the smallest window that holds all of it.

    The map has `cols` columns. Returns the row and column of the window's corner, and the window, float32[h, w]; it is empty if
    there is no pheromone.
    """
    cells = len(trails.mark)
    top, left, bottom, right = cells, cells, -1, -1
    for key in trails.key:
        if key >= 0:
            row, col = divmod(key // 64 % cells, cols)
            top, left, bottom, right = min(top, row), min(left, col), max(bottom, row), max(right, col)
    out = np.zeros((max(bottom - top + 1, 0), max(right - left + 1, 0)), np.float32)
    for j in range(TRAILS):
        if trails.key[j] >= 0:
            row, col = divmod(trails.key[j] // 64 % cells, cols)
            out[row - top, col - left] = max(out[row - top, col - left], trails.tau[j])
    return top, left, out
