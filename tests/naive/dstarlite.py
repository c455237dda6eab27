"""A fresh search for every question: the slow, obvious twin of D* Lite, by SciPy's Dijkstra."""

from __future__ import annotations

import math

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from antway.grid import Cell, Grid, Moves

NEED = {Moves.EIGHT: 2, Moves.EIGHT_NOSQUEEZE: 1, Moves.EIGHT_CUT: 0}  # free cells beside a diagonal


def grid_distance(grid: Grid, start: Cell, goal: Cell, moves: Moves) -> float:
    """The length in cells of a shortest path, infinite where there is none."""
    rows, cols = grid.shape
    index = np.arange(rows * cols).reshape(rows, cols)
    free = np.pad(~grid.blocked, 1).astype(int)
    links = []
    for dr, dc in ((0, 1), (1, 0)) if moves is Moves.FOUR else ((0, 1), (1, 0), (1, 1), (1, -1)):
        here, there = free[1:-1, 1:-1], free[1 + dr : rows + 1 + dr, 1 + dc : cols + 1 + dc]
        sides = free[1 + dr : rows + 1 + dr, 1:-1] + free[1:-1, 1 + dc : cols + 1 + dc]
        legal = (here & there) == 1
        if dr and dc:
            legal &= sides >= NEED[moves]
        links.append((index[legal], index[legal] + dr * cols + dc, np.full(legal.sum(), math.hypot(dr, dc))))
    a, b, w = (np.concatenate(x) for x in zip(*links))
    graph = coo_matrix((w, (a, b)), shape=(rows * cols, rows * cols)).tocsr()
    return float(dijkstra(graph, directed=False, indices=int(index[start]))[index[goal]])
