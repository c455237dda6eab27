"""Legal moves of a disc between the nodes of a map, and the exact field over these moves."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.geometry import segment_hits_square
from antway.kernels.base.jit import kernel


@kernel
def move_mask(
    blocked: Bools, offsets: NDArray[np.int32], radius: float, stride: int, first_row: int, first_col: int
) -> NDArray[np.uint32]:
    """Return which moves a disc can make from each node without contact with a blocked cell or the edge of the map.

    The stencil of a move is the set of cells that its swept disc touches, by an exact test. The move is legal where no cell of
    its stencil is blocked. A radius of 0 counts as 1e-6, so that a point cannot pass between two diagonal cells.

    The nodes are the centres of every stride-th cell along rows and columns; the first is (first_row, first_col), each number
    below `stride`. `offsets` are (d_row, d_col) of each move in nodes, int32[K, 2] with K <= 32; `radius` is in cells. Returns
    uint32[H', W']: bit k is set where move k is legal, and no bit where the disc cannot stand.
    """
    height, width = blocked.shape
    rows, cols = (height - first_row + stride - 1) // stride, (width - first_col + stride - 1) // stride
    around, every = stride * longest(offsets) + math.ceil(radius) + 1, np.uint32(0xFFFFFFFF >> (32 - len(offsets)))
    hit = _stencils(offsets, radius, stride, around, every)
    walls = np.ones((height + 4, width + 4), np.bool_)
    for row in range(height):  # loops, because expressions of whole arrays take seconds to compile
        for col in range(width):
            walls[row + 2, col + 2] = blocked[row, col]
    mask = np.empty((rows, cols), np.uint32)
    for i in range(rows):
        for j in range(cols):
            mask[i, j] = 0 if blocked[first_row + stride * i, first_col + stride * j] else every
    # Of the cells that a disc touches, the first one on the way from a free node has a free neighbour.
    for row in range(-1, height + 1):
        for col in range(-1, width + 1):
            if not walls[row + 2, col + 2] or walls[row + 1 : row + 4, col + 1 : col + 4].all():
                continue
            south, west = row - first_row, col - first_col
            top, left = max(-((around - south) // stride), 0), max(-((around - west) // stride), 0)
            for i in range(top, min((south + around) // stride + 1, rows)):
                legal, hits = mask[i], hit[around + south - stride * i]
                for j in range(left, min((west + around) // stride + 1, cols)):
                    legal[j] &= ~hits[around - west + stride * j]
    return mask


@kernel
def _stencils(offsets: NDArray[np.int32], radius: float, stride: int, around: int, every: np.uint32) -> NDArray[np.uint32]:
    """Return the set of moves whose stencils contain each cell up to `around` rows and columns away, columns mirrored.

    `every` is the set of all moves; the other parameters are those of `move_mask`.
    """
    hit = np.zeros((2 * around + 1, 2 * around + 1), np.uint32)
    body, rim = max(radius, 1e-6), max(radius, 1e-6) + 0.5
    for r in range(-around, around + 1):
        for c in range(-around, around + 1):
            if math.hypot(max(abs(r) - 0.5, 0.0), max(abs(c) - 0.5, 0.0)) < body - 1e-6:  # every stencil contains the disc
                hit[around + r, around - c] = every
                continue
            for k in range(len(offsets)):
                dr, dc = float(stride * offsets[k, 0]), float(stride * offsets[k, 1])
                near = min(0.0, dr) - rim < r < max(0.0, dr) + rim and min(0.0, dc) - rim < c < max(0.0, dc) + rim
                if near and segment_hits_square(0.0, 0.0, dr, dc, float(r), float(c), body):
                    hit[around + r, around - c] |= np.uint32(1) << np.uint32(k)
    return hit


@kernel
def longest(offsets: NDArray[np.int32]) -> int:
    """Return the largest number of rows or columns that any move crosses."""
    most = 0
    for k in range(len(offsets)):
        most = max(most, abs(offsets[k, 0]), abs(offsets[k, 1]))
    return most


@kernel
def move_field(mask: NDArray[np.uint32], offsets: NDArray[np.int32], lengths: Floats, goals: Ints) -> Floats:
    """Return the exact distance from each cell to the nearest goal over the legal moves: Dijkstra backwards with buckets.

    A bucket is one cell wide and no move is shorter, so the cells of a bucket cannot improve one another and need no order.
    Each bucket is a doubly linked list, and a cell is in at most one. All moves are shorter than 7 cells, so a ring of 8
    buckets suffices.

    `mask`, uint32[H, W], is the result of `move_mask`, or a window of it; moves that leave the window are not used. The moves'
    `lengths`, in [1, 7), and the result, float64[H, W], are in cells; it is infinite where none of `goals`, (row, col), can be
    reached.
    """
    rows, cols = mask.shape
    rim = longest(offsets)  # width of a border of cells that are never improved
    width = cols + 2 * rim
    field = np.full((rows + 2 * rim, width), -1.0)
    legal = np.zeros((rows + 2 * rim, width), np.uint32)
    for row in range(rows):
        for col in range(cols):
            field[row + rim, col + rim], legal[row + rim, col + rim] = np.inf, mask[row, col]
    far, may, jump = field.ravel(), legal.ravel(), np.empty(len(offsets), np.int64)
    for k in range(len(offsets)):
        jump[k] = offsets[k, 0] * width + offsets[k, 1]
    after, before = np.empty(far.size, np.int32), np.empty(far.size, np.int32)
    head = np.full(8, -1, np.int32)
    waiting = 0
    for i in range(len(goals)):
        cell = (goals[i, 0] + rim) * width + goals[i, 1] + rim
        if far[cell] > 0.0:
            far[cell] = 0.0
            _link(cell, 0, head, after, before)
            waiting += 1
    bucket = 0
    while waiting:
        cell = int(head[bucket & 7])
        if cell < 0:
            bucket += 1
            continue
        _unlink(cell, bucket & 7, head, after, before)
        waiting -= 1
        here = far[cell]
        for k in range(len(jump)):
            source, distance = cell - jump[k], here + lengths[k]
            old = far[source]
            if distance < old and may[source] >> np.uint32(k) & np.uint32(1):
                far[source] = distance
                new_bucket = int(distance)
                if old < np.inf:
                    if int(old) == new_bucket:
                        continue
                    _unlink(source, int(old) & 7, head, after, before)
                    waiting -= 1
                _link(source, new_bucket & 7, head, after, before)
                waiting += 1
    return field[rim : rim + rows, rim : rim + cols].copy()


@kernel
def _link(cell: int, bucket: int, head: NDArray[np.int32], after: NDArray[np.int32], before: NDArray[np.int32]) -> None:
    """Put a cell at the head of a bucket's list."""
    after[cell] = head[bucket]
    before[cell] = -1
    if head[bucket] >= 0:
        before[head[bucket]] = cell
    head[bucket] = cell


@kernel
def _unlink(cell: int, bucket: int, head: NDArray[np.int32], after: NDArray[np.int32], before: NDArray[np.int32]) -> None:
    """Take a cell out of a bucket's list."""
    if before[cell] >= 0:
        after[before[cell]] = after[cell]
    else:
        head[bucket] = after[cell]
    if after[cell] >= 0:
        before[after[cell]] = before[cell]
