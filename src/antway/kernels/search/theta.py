"""Line of sight on a grid in exact integers, and Theta* and Lazy Theta*, which use it.

Lengths are doubled: cell (r, c) covers rows 2r..2r+2 and columns 2c..2c+2, its centre is (2r+1, 2c+1), lattice lines are even.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.search.polyanya import EMPTY, FOUND, PAUSED


class Memory(NamedTuple):
    """A search between two slices, on a map of H x W cells with flat indices."""

    length: Floats  # [HW] length of the shortest path found to each cell, infinite at first
    parent: Ints  # [HW] previous cell of that path, which sees the cell (if lazy: once it is closed)
    closed: NDArray[np.bool_]  # [HW] whether each cell has been expanded
    heap: Floats  # [M, 2] open cells, once for each improvement
    counts: Ints  # [2] size of the heap, and number of expansions
    scratch: NDArray[np.int32]  # [2 * (H + W), 2] for `trace`


@bare_kernel
def theta(blocked: NDArray[np.bool_], start: int, goal: int, lazy: bool, memory: Memory, steps: int) -> int:
    """Run (Lazy) Theta* (Nash et al. 2007; Nash, Koenig, Tovey 2010) for at most `steps` expansions; return how it ended."""
    cols = blocked.shape[1]
    length, parent, closed, heap, counts = memory.length, memory.parent, memory.closed, memory.heap, memory.counts
    if counts[1] == 0:
        length[start], parent[start] = 0.0, start
        counts[0] = push(heap, 0, 0.0, start)
    stop = counts[1] + steps
    while counts[0] > 0:
        if counts[1] == stop or counts[0] + 8 > len(heap):
            return PAUSED
        s = int(heap[0, 1])
        counts[0] = pop(heap, counts[0])
        if closed[s]:
            continue
        closed[s] = True
        counts[1] += 1
        if lazy and not _sees(blocked, parent[s], s, memory.scratch):
            _choose_parent(blocked, s, memory)
        if s == goal:
            return FOUND
        r, c = s // cols, s % cols
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                t = s + dr * cols + dc
                if not _may_step(blocked, r, c, dr, dc) or closed[t]:
                    continue
                by = parent[s] if lazy or _sees(blocked, parent[s], t, memory.scratch) else s
                path = length[by] + _between(by, t, cols)
                if path < length[t]:
                    length[t], parent[t] = path, by
                    counts[0] = push(heap, counts[0], path + _between(t, goal, cols), t)
    return EMPTY


@bare_kernel
def _choose_parent(blocked: NDArray[np.bool_], s: int, memory: Memory) -> None:
    """Make the best of its closed neighbours the parent of cell `s`, which its present parent does not see."""
    cols, length = blocked.shape[1], memory.length
    length[s] = np.inf
    for dr in range(-1, 2):
        for dc in range(-1, 2):
            t = s + dr * cols + dc
            if _may_step(blocked, s // cols, s % cols, dr, dc) and memory.closed[t] and t != s:
                path = length[t] + math.sqrt(dr * dr + dc * dc)
                if path < length[s]:
                    length[s], memory.parent[s] = path, t


@bare_kernel
def _may_step(blocked: NDArray[np.bool_], r: int, c: int, dr: int, dc: int) -> bool:
    """Tell whether the step to a neighbour is free and does not pass between two blocked cells that touch diagonally."""
    return not is_wall(blocked, r + dr, c + dc) and not (is_wall(blocked, r + dr, c) and is_wall(blocked, r, c + dc))


@bare_kernel
def _between(s: int, t: int, cols: int) -> float:
    """Return the distance of two cells."""
    dr, dc = s // cols - t // cols, s % cols - t % cols
    return math.sqrt(dr * dr + dc * dc)


@bare_kernel
def _sees(blocked: NDArray[np.bool_], s: int, t: int, scratch: NDArray[np.int32]) -> bool:
    """Tell whether the segment between the centres of two cells is free."""
    cols = blocked.shape[1]
    return trace(blocked, 2 * (s // cols) + 1, 2 * (s % cols) + 1, 2 * (t // cols) + 1, 2 * (t % cols) + 1, scratch, 0) > 0


@kernel
def cells_along(blocked: NDArray[np.bool_], path: Ints) -> NDArray[np.int32]:
    """Return the free cells along the polyline `path`, doubled lattice points [N, 2]; empty if it is illegal."""
    crossings = 2
    for i in range(1, len(path)):
        crossings += abs(path[i, 0] - path[i - 1, 0]) + abs(path[i, 1] - path[i - 1, 1]) + 1
    cells, n = np.empty((crossings, 2), np.int32), 0
    for i in range(len(path)):
        a, b = path[max(i - 1, 0)], path[i]
        n = trace(blocked, a[0], a[1], b[0], b[1], cells, n)
        if n < 0:
            return cells[:0].copy()
    return cells[:n].copy()


@bare_kernel
def trace(blocked: NDArray[np.bool_], row0: int, col0: int, row1: int, col1: int, cells: NDArray[np.int32], n: int) -> int:
    """Append the free cells along a segment between doubled lattice points to `cells` [N, 2], after the first `n`.

    Between two crossings of lattice lines the segment is in one cell. Along a lattice line it is between two cells; the one
    nearer to the last cell is used if it is free. Returns the new `n`, or -1 if the segment enters a blocked cell, runs between
    two blocked cells, or passes a point where two of them touch diagonally. `cells` must be long enough for all crossings.
    """
    rise, run = row1 - row0, col1 - col0
    r, c = (row0 - (rise < 0)) >> 1, (col0 - (run < 0)) >> 1
    along_row, along_col = rise == 0 and row0 % 2 == 0, run == 0 and col0 % 2 == 0
    if along_row and n > 0:
        r = min(max(cells[n - 1, 0], r - 1), r)
    if along_col and n > 0:
        c = min(max(cells[n - 1, 1], c - 1), c)
    while True:
        if along_row and is_wall(blocked, r, c):
            r = row0 - 1 - r
        if along_col and is_wall(blocked, r, c):
            c = col0 - 1 - c
        if is_wall(blocked, r, c):
            return -1
        if n == 0 or cells[n - 1, 0] != r or cells[n - 1, 1] != c:
            if n > 0 and is_wall(blocked, r, cells[n - 1, 1]) and is_wall(blocked, cells[n - 1, 0], c):
                return -1
            cells[n, 0], cells[n, 1] = r, c
            n += 1
        to_row, to_col = abs(2 * (r + (rise > 0)) - row0), abs(2 * (c + (run > 0)) - col0)
        by_row = rise != 0 and (run == 0 or to_row * abs(run) <= to_col * abs(rise))
        by_col = run != 0 and (rise == 0 or to_col * abs(rise) <= to_row * abs(run))
        if not (by_row and to_row < abs(rise)) and not (by_col and to_col < abs(run)):
            return n
        if by_row:
            r += 1 if rise > 0 else -1
        if by_col:
            c += 1 if run > 0 else -1


@bare_kernel
def is_wall(blocked: NDArray[np.bool_], r: int, c: int) -> bool:
    """Tell whether (r, c) is blocked or off the map."""
    return r < 0 or c < 0 or r >= blocked.shape[0] or c >= blocked.shape[1] or bool(blocked[r, c])
