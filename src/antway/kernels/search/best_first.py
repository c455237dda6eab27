"""Best-first search (Dijkstra, A*) with a heap over any set of moves and any positive costs: the general case.

The map is flat, with a margin of blocked cells as wide as the longest move, so that no index needs a bounds check. Moves to 4
and 8 neighbours without costs have faster kernels: `distance_field`, `astar` and `jps`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.heap import pop_item, put_item
from antway.kernels.base.jit import bare_kernel

RUNNING, FOUND, EXHAUSTED = 0, 1, 2


class Graph(NamedTuple):
    """The flat map with a margin: cell (r, c) has index (r + margin) * width + c + margin."""

    legal: NDArray[np.uint32]  # [cells] set of legal moves of each cell, bit k for move k
    offsets: Ints  # [moves] flat step of each move
    lengths: Floats  # [moves] length of each move, cells
    width: int  # cells in a row
    margin: int  # cells

    def at(self, cell: tuple[int, int]) -> int:
        """Return the flat index of `cell`."""
        return (cell[0] + self.margin) * self.width + cell[1] + self.margin

    def inner(self, flat: NDArray[Any]) -> NDArray[Any]:
        """Return a flat array without its margin, as [H, W]."""
        m = self.margin
        return flat.reshape(-1, self.width)[m : flat.size // self.width - m, m : self.width - m]


class Memory(NamedTuple):
    """A search between two calls."""

    label: Floats  # [cells] cost of the best path to each cell so far, infinite if there is none
    key: Floats  # [cells] label + heuristic
    arrived: NDArray[np.int8]  # [cells] last move of that path, -1 at a source
    heap: NDArray[np.int32]  # [cells] the open cells
    place: NDArray[np.int32]  # [cells] position of each cell in the heap, or -1
    state: Ints  # [2] size of the heap, cells expanded


@bare_kernel
def gauge(row: int, col: int, goal_row: int, goal_col: int, faces: Floats) -> float:
    """Return the length of a shortest path on an empty map: the norm whose unit ball is the polygon of the moves.

    With the larger side a and the smaller side b of the bounding box it is the maximum of p a + q b over the faces (p, q) of
    the polygon in one octant. There are 1 face for 4 and 8 moves, 2 for 16, and 4 for 32.
    """
    a, b = abs(row - goal_row), abs(col - goal_col)
    if a < b:
        a, b = b, a
    best = 0.0
    for k in range(faces.shape[0]):
        best = max(best, faces[k, 0] * a + faces[k, 1] * b)
    return best


@bare_kernel
def open_cell(cell: int, g: float, h: float, came_by: int, memory: Memory, size: int) -> int:
    """Label `cell` and put it on the heap, or move it up there; return the new size of the heap."""
    memory.label[cell], memory.key[cell], memory.arrived[cell] = g, g + h, came_by
    return put_item(memory.key, memory.heap, memory.place, size, cell)


@bare_kernel
def best_first(net: Graph, cost: Floats, goal: int, within: float, faces: Floats, memory: Memory, steps: int) -> int:
    """Expand up to `steps` cells; return RUNNING, FOUND (`goal` was taken off the heap) or EXHAUSTED.

    A move costs its length times the mean of `cost` at both ends, float64[cells], or float64[0] for 1 everywhere. The search
    stops at the cell `goal` (-1: none), or when all open cells are farther than `within`. `faces`, float64[F, 2], are those of
    the heuristic (see `gauge`), none for Dijkstra.
    """
    legal, offsets, lengths, width = net.legal, net.offsets, net.lengths, net.width
    label, key, heap, place, state = memory.label, memory.key, memory.heap, memory.place, memory.state
    size, expanded = state[0], state[1]
    goal_row, goal_col = goal // width, goal % width
    code = RUNNING
    for _ in range(steps):
        if size == 0 or key[heap[0]] > within:
            code = EXHAUSTED
            break
        cell = pop_item(key, heap, place, size)
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
                    size = open_cell(to, g, h, k, memory, size)
    state[0], state[1] = size, expanded
    return code
