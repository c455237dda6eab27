"""The visibility graph of a small grid: the slow, obvious twin of the any-angle search, in exact integers.

Lengths are doubled: cell (r, c) is the square [2r, 2r+2] x [2c, 2c+2], its centre is (2r+1, 2c+1).
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from scipy.sparse.csgraph import dijkstra

from antway.grid import Cell, Grid


class VisibilityGraph:
    """The centres of `cells` and all corners of obstacles that a path may turn at, and which of them see each other."""

    def __init__(self, grid: Grid, cells: Iterable[Cell]) -> None:
        wall = np.pad(grid.blocked, 1, constant_values=True)
        boxes = [(2 * r - 2, 2 * c - 2, 2 * r, 2 * c) for r, c in np.argwhere(wall)]
        boxes += [(2 * r - 2, 2 * c - 2, 2 * r, 2 * c + 2) for r, c in np.argwhere(wall[:, :-1] & wall[:, 1:])]
        boxes += [(2 * r - 2, 2 * c - 2, 2 * r + 2, 2 * c) for r, c in np.argwhere(wall[:-1] & wall[1:])]
        self.boxes = np.array(boxes).reshape(-1, 4)
        blocked = [wall[:-1, :-1], wall[:-1, 1:], wall[1:, 1:], wall[1:, :-1]]
        pinched = (blocked[0] & blocked[2] & ~blocked[1] & ~blocked[3]) | (blocked[1] & blocked[3] & ~blocked[0] & ~blocked[2])
        self.pinches = 2 * np.argwhere(pinched)
        self.corners = 2 * np.argwhere(sum(b.astype(int) for b in blocked) == 1)
        self.cells = np.array(list(cells), dtype=int).reshape(-1, 2)
        self.points = np.vstack((2 * self.cells + 1, self.corners))
        count = len(self.points)
        self.lengths = np.zeros((count, count))
        for i, p in enumerate(self.points):
            for j in range(i):
                if self.sees(p, self.points[j]):
                    self.lengths[i, j] = self.lengths[j, i] = np.hypot(*(p - self.points[j])) / 2

    def sees(self, p: np.ndarray, q: np.ndarray) -> bool:
        """Tell whether the segment from `p` to `q` keeps out of the open blocked boxes and clear of every pinch."""
        low, high = np.minimum(p, q), np.maximum(p, q)
        top, left, bottom, right = self.boxes.T
        near = (high[0] > top) & (low[0] < bottom) & (high[1] > left) & (low[1] < right)
        d = q - p
        sides = [d[0] * (x - p[1]) - d[1] * (y - p[0]) for y in (top[near], bottom[near]) for x in (left[near], right[near])]
        if ((np.min(sides, axis=0) < 0) & (np.max(sides, axis=0) > 0)).any():
            return False
        at = self.pinches - p
        on_line = d[0] * at[:, 1] == d[1] * at[:, 0]
        return not (on_line & (self.pinches >= low).all(axis=1) & (self.pinches <= high).all(axis=1)).any()

    def distances(self, start: Cell) -> dict[Cell, float]:
        """Return the length in cells of the shortest any-angle path from `start` to every one of `cells` that it reaches."""
        source = int(np.flatnonzero((self.cells == start).all(axis=1))[0])
        found = dijkstra(self.lengths, indices=source)
        return {tuple(map(int, cell)): float(d) for cell, d in zip(self.cells, found) if np.isfinite(d)}
