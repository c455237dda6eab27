"""The subgoal graph of a map under `Moves.EIGHT`: its corners, and which of them see each other.

A subgoal is a free cell at a convex corner of an obstacle, where shortest paths turn. Two cells see each other if all shortest
paths between them on an empty map, i diagonal and j straight moves in any order, are free and pass no subgoal. For any two
cells there is a shortest path that runs from subgoal to subgoal, each of which sees the next (Uras, Koenig and Hernandez,
Subgoal graphs for optimal pathfinding in eight-neighbor grids, ICAPS 2013).

`stops` is packed like the map in `jps`; a bit is set for blocked cells and subgoals. `number` is the number of each subgoal,
-1 elsewhere, on a flat map with a margin of 1. Costs are integers, STRAIGHT or DIAGONAL for a move.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.search.canonical import COL, ROW
from antway.kernels.search.hierarchy import AFTER, BEFORE, DONE, FULL, LINKED, NEXT, OUT, RUNNING, TO, USED, Memory
from antway.kernels.search.jps import place

STRAIGHT, DIAGONAL = 38613965, 54608393


@kernel
def corners(around: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which cells are subgoals: they have a blocked diagonal between two free sides; `around` as in `canonical`."""
    table = np.zeros(256, np.bool_)
    for bits in range(256):
        for d in range(4):
            table[bits] |= bits >> d & 1 and bits >> ((d + 1) & 3) & 1 and not bits >> (d + 4) & 1
    found = np.empty(around.size, np.bool_)
    for i in range(around.size):
        found[i] = table[around[i]]
    return found


@bare_kernel
def clear(stops: NDArray[np.uint64], line: int, bit: int) -> int:
    """Return how many cells along the line are free before the next set bit."""
    bit += 1
    i = line + (bit >> 6)
    word = stops[i] >> np.uint64(bit & 63)
    if word:
        return ctz(word)
    n = 64 - (bit & 63)
    i += 1
    while stops[i] == 0:
        n += 64
        i += 1
    return n + ctz(stops[i])


@bare_kernel
def seen(
    around: NDArray[np.uint8],
    stops: NDArray[np.uint64],
    number: NDArray[np.int32],
    width: int,
    row: int,
    col: int,
    found: NDArray[np.int64],
) -> int:
    """Write number and cost of all subgoals that the cell sees to `found`, int64[M, 2]; return how many there are."""
    height, wide, n = around.size // width, width + 2, 0
    at = (row + 1) * wide + col + 1
    for d in range(4):
        line, bit, _ = place(d, row, col, height, width)
        k = clear(stops, line, bit) + 1
        other = number[at + k * (ROW[d] * wide + COL[d])]
        if other >= 0:
            found[n, 0], found[n, 1] = other, k * STRAIGHT
            n += 1
    for d in range(4, 8):
        one, two = d - 4, (d - 3) & 3
        line1, bit1, length1 = place(one, row, col, height, width)
        line2, bit2, length2 = place(two, row, col, height, width)
        # In the packed part of one side direction, a step in the other side direction leads to the next line.
        side1 = length1 if two < 2 else -length1
        side2 = length2 if one < 2 else -length2
        step, step1, step2 = ROW[d] * wide + COL[d], ROW[one] * wide + COL[one], ROW[two] * wide + COL[two]
        free_around = np.uint8(1 << one | 1 << two | 1 << d)
        x, y, g = row * width + col, at, 0
        # The parallelogram is as wide as its narrowest row so far.
        wide1, wide2 = clear(stops, line1, bit1), clear(stops, line2, bit2)
        while around[x] & free_around == free_around:
            x += ROW[d] * width + COL[d]
            y += step
            g += DIAGONAL
            line1, bit1, line2, bit2 = line1 + side1, bit1 + 1, line2 + side2, bit2 + 1
            if number[y] >= 0:
                found[n, 0], found[n, 1] = number[y], g
                n += 1
                break
            if wide1 > 0:
                k = clear(stops, line1, bit1)
                if k < wide1:
                    wide1 = k
                    other = number[y + (k + 1) * step1]
                    if other >= 0:
                        found[n, 0], found[n, 1] = other, g + (k + 1) * STRAIGHT
                        n += 1
            if wide2 > 0:
                k = clear(stops, line2, bit2)
                if k < wide2:
                    wide2 = k
                    other = number[y + (k + 1) * step2]
                    if other >= 0:
                        found[n, 0], found[n, 1] = other, g + (k + 1) * STRAIGHT
                        n += 1
    return n


@bare_kernel
def link(
    around: NDArray[np.uint8],
    stops: NDArray[np.uint64],
    number: NDArray[np.int32],
    width: int,
    nodes: NDArray[np.int64],
    m: Memory,
    steps: int,
) -> int:
    """Add the edges from `nodes` to all that they see, for about `steps` steps; return RUNNING, DONE or FULL."""
    found = m.heap
    while steps > 0:
        x = m.state[LINKED]
        if x == nodes.size:
            return DONE
        n = seen(around, stops, number, width, nodes[x] // width, nodes[x] % width, found)
        steps -= 16 + 4 * n
        if m.state[USED] + n > m.edges.shape[0]:
            return FULL
        for i in range(n):
            e = m.state[USED]
            m.edges[e, NEXT], m.edges[e, TO], m.weight[e] = m.first[x], found[i, 0], found[i, 1]
            m.edges[e, OUT] = m.edges[e, BEFORE] = m.edges[e, AFTER] = -1
            m.first[x] = e
            m.state[USED] += 1
        m.state[LINKED] += 1
    return RUNNING
