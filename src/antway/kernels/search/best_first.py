"""Best-first search (Dijkstra, A*) with a heap over any set of moves and any positive costs: the general case.

The map is flat, with a margin of blocked cells as wide as the longest move, so that no index needs a test. Moves of 4 and 8
neighbours without costs have faster kernels of their own: `field`, `astar` and `jps`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel

RUNNING, FOUND, EXHAUSTED = 0, 1, 2


@kernel
def legal_moves(
    free: NDArray[np.uint8],
    offsets: NDArray[np.int64],
    touched: NDArray[np.int64],
    first: NDArray[np.int64],
    need: NDArray[np.int64],
) -> NDArray[np.uint32]:
    """Return the set of legal moves of each cell, bit k for move k: the target and `need[k]` of the touched cells are free.

    The cells that move k touches are at `touched[first[k]:first[k + 1]]`, as flat offsets from where it begins.
    """
    legal = np.zeros(free.size, np.uint32)
    for cell in range(free.size):
        if free[cell]:
            moves = 0
            for k in range(offsets.size):
                if free[cell + offsets[k]]:
                    open_cells = 0
                    for j in range(first[k], first[k + 1]):
                        open_cells += free[cell + touched[j]]
                    if open_cells >= need[k]:
                        moves |= 1 << k
            legal[cell] = moves
    return legal


@kernel
def gauge(row: int, col: int, goal_row: int, goal_col: int, faces: NDArray[np.float64]) -> float:
    """Return the length of a shortest path on an empty map: the norm whose unit ball is the polygon of the moves.

    For the larger side a and the smaller side b of the box between both cells it is the maximum of p a + q b over the faces
    (p, q) of the polygon in one octant: 1 face for 4 and 8 moves, 2 for 16, 4 for 32.
    """
    a, b = abs(row - goal_row), abs(col - goal_col)
    if a < b:
        a, b = b, a
    best = 0.0
    for k in range(faces.shape[0]):
        best = max(best, faces[k, 0] * a + faces[k, 1] * b)
    return best


@kernel
def open_cell(
    cell: int, g: float, h: float, came_by: int, label: Any, key: Any, arrived: Any, heap: Any, place: Any, size: int
) -> int:
    """Label `cell` and put it on the heap or raise it there; return the new size of the heap."""
    label[cell], key[cell], arrived[cell] = g, g + h, came_by
    hole = place[cell]
    if hole < 0:
        hole = size
        size += 1
    while hole > 0:
        above = (hole - 1) >> 2
        if key[heap[above]] <= g + h:
            break
        heap[hole] = heap[above]
        place[heap[hole]] = hole
        hole = above
    heap[hole] = cell
    place[cell] = hole
    return size


@kernel
def pop(key: Any, heap: Any, place: Any, size: int) -> int:
    """Take the least cell off the 4-ary heap of `size` cells and return it."""
    top: int = heap[0]
    place[top] = -1
    size -= 1
    if size > 0:
        moved = heap[size]
        hole = 0
        while True:
            child = 4 * hole + 1
            if child >= size:
                break
            least = child
            for other in range(child + 1, min(child + 4, size)):
                if key[heap[other]] < key[heap[least]]:
                    least = other
            if key[heap[least]] >= key[moved]:
                break
            heap[hole] = heap[least]
            place[heap[hole]] = hole
            hole = least
        heap[hole] = moved
        place[moved] = hole
    return top


@kernel
def best_first(
    legal: NDArray[np.uint32],
    offsets: NDArray[np.int64],
    lengths: NDArray[np.float64],
    cost: NDArray[np.float64],
    width: int,
    goal: int,
    within: float,
    faces: NDArray[np.float64],
    label: NDArray[np.float64],
    key: NDArray[np.float64],
    arrived: NDArray[np.int8],
    heap: NDArray[np.int32],
    place: NDArray[np.int32],
    state: NDArray[np.int64],
    steps: int,
) -> int:
    """Expand up to `steps` cells; return RUNNING, FOUND (`goal` was taken off the heap) or EXHAUSTED.

    Parameters
    ----------
    legal, offsets, lengths
        Moves of each cell (see `legal_moves`), and for each move its flat offset and its length in cells.
    cost : float64[cells], or float64[0] for 1 everywhere
        A move costs its length times the mean of `cost` at both ends.
    width, faces
        Cells in a row, and the faces of the heuristic (see `gauge`), none for Dijkstra.
    goal, within
        Stop at this cell (-1: none), or when all that is left is farther than `within`.
    label, key, arrived, heap, place, state
        The search between calls: path cost, priority and last move of each cell, the heap, the place of each cell in it
        (-1: not there); `state` is the size of the heap and the number of cells expanded.
    """
    size, expanded = state[0], state[1]
    goal_row, goal_col = goal // width, goal % width
    code = RUNNING
    for _ in range(steps):
        if size == 0 or key[heap[0]] > within:
            code = EXHAUSTED
            break
        cell = pop(key, heap, place, size)
        size -= 1
        if cell == goal:
            code = FOUND
            break
        expanded += 1
        moves = legal[cell]
        for k in range(offsets.size):
            if moves >> np.uint32(k) & np.uint32(1):
                to = cell + offsets[k]
                step = lengths[k]
                if cost.size:
                    step *= 0.5 * (cost[cell] + cost[to])
                g = label[cell] + step
                if g < label[to]:
                    h = gauge(to // width, to % width, goal_row, goal_col, faces) if faces.size else 0.0
                    size = open_cell(to, g, h, k, label, key, arrived, heap, place, size)
    state[0], state[1] = size, expanded
    return code
