"""The memory of a search on one map, used again by every search there, so that a query allocates and clears nothing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from antway.grid import Grid
from antway.kernels.buckets import BLOCKS, KEY, KEYS, LAST, LIMIT, USED, reset
from antway.search.derived import kept

_TOP = 2**31 - 1


class Workspace:
    """Labels, last moves, parents and queue of a search; see `kernels.astar` and `kernels.buckets`.

    Labels of a search lie in [base, base + LIMIT), below those of all searches before it; once in 92 searches, when the range
    of int32 is used up, they are cleared.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        cells = shape[0] * shape[1]
        self.label = np.full(cells, _TOP, np.int32)
        self.came = np.empty(cells, np.uint8)
        self.parent = np.empty(cells, np.int32)
        self.reached = np.empty((2 * max(shape) + 8, 4), np.int32)
        self.first = np.full(KEYS + BLOCKS, -1, np.int32)
        self.filled = np.zeros(KEYS // 64, np.uint64)
        self.entries = np.empty((16 * len(self.reached), 5), np.int32)
        self.state = np.zeros(8, np.int64)
        self.base = _TOP

    def begin(self) -> None:
        """Prepare for a search."""
        reset(self.first, self.filled, self.state)
        self.base -= LIMIT
        if self.base < -(2**31):
            self.label.fill(_TOP)
            self.base = _TOP - LIMIT

    def open(self, row: int, col: int, key: int) -> None:
        """Put the start into the queue."""
        self.entries[0] = -1, row, col, 0, key
        block = key // KEYS
        self.first[KEYS + block] = 0
        self.state[USED], self.state[LAST], self.state[KEY] = 1, block, -KEYS

    def grow(self) -> None:
        """Double the room for entries of the queue."""
        self.entries = np.concatenate((self.entries, np.empty_like(self.entries)))


@contextmanager
def workspace(grid: Grid) -> Iterator[Workspace]:
    """Lend a workspace for `grid`; each thread that asks at the same time gets its own."""
    spare: list[Workspace] = kept(grid, "workspaces", list)
    work = spare.pop() if spare else Workspace(grid.shape)
    work.begin()
    try:
        yield work
    finally:
        spare.append(work)
