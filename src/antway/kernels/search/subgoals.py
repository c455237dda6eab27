"""The subgoal graph of a map under `Moves.EIGHT`: its corners, and which of them see each other.

A subgoal is a free cell at a convex corner of an obstacle, where shortest paths turn. Two cells see each other if all shortest
paths between them on an empty map, i diagonal and j straight moves in any order, are free and pass no subgoal. For any two
cells there is a shortest path that runs from subgoal to subgoal, each of which sees the next (Uras, Koenig and Hernandez,
Subgoal graphs for optimal pathfinding in eight-neighbor grids, ICAPS 2013).

Costs are sums of the fine lengths (see `lengths`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.search.canonical import COL, ROW, Lattice
from antway.kernels.search.hierarchy import AFTER, BEFORE, BYPASSED, DONE, FULL, LINKED, NEXT, RUNNING, TO, USED, Memory
from antway.kernels.search.jps import place, place_beside
from antway.kernels.search.lengths import FINE_DIAGONAL, FINE_STRAIGHT


class SubgoalMap(NamedTuple):
    """A map and its subgoals."""

    lattice: Lattice
    stops: NDArray[np.uint64]  # blocked cells and subgoals, packed like the map in `jps`
    number: NDArray[np.int32]  # [(H + 2) * (W + 2)] number of each subgoal, -1 elsewhere; with a margin of 1 cell


def corners(around: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Return which cells are subgoals: they have a blocked diagonal between two free sides; `around` as in `canonical`."""
    free = np.arange(256)[:, None] >> np.arange(8) & 1 == 1
    table: NDArray[np.bool_] = (free[:, :4] & np.roll(free[:, :4], -1, axis=1) & ~free[:, 4:]).any(axis=1)
    return table[around]


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


@inner_kernel
def see_beside(
    subgoals: SubgoalMap, line: int, bit: int, at: int, step: int, g: int, wide: int, found: NDArray[np.int64], n: int
) -> tuple[int, int]:
    """Append the subgoal that ends the next row of a parallelogram to `found`; return the width of that row, and the new n.

    The parallelogram is as wide as its narrowest row so far, `wide` cells: a row that is no narrower shows nothing new.
    """
    if wide > 0:
        k = clear(subgoals.stops, line, bit)
        if k < wide:
            wide = k
            other = subgoals.number[at + (k + 1) * step]
            if other >= 0:
                found[n, 0], found[n, 1] = other, g + (k + 1) * FINE_STRAIGHT
                n += 1
    return wide, n


@bare_kernel
def seen(subgoals: SubgoalMap, row: int, col: int, found: NDArray[np.int64]) -> int:
    """Write number and cost of all subgoals that the cell sees to `found`, int64[M, 2]; return how many there are."""
    around, width = subgoals.lattice.around, subgoals.lattice.width
    stops, number = subgoals.stops, subgoals.number
    height, padded, n = around.size // width, width + 2, 0
    start = (row + 1) * padded + col + 1
    for d in range(4):
        line, bit, _ = place(d, row, col, height, width)
        k = clear(stops, line, bit) + 1
        other = number[start + k * (ROW[d] * padded + COL[d])]
        if other >= 0:
            found[n, 0], found[n, 1] = other, k * FINE_STRAIGHT
            n += 1
    for d in range(4, 8):
        one, two = d - 4, (d - 3) & 3  # the straight directions on both sides of d
        line1, bit1, _, next1 = place_beside(one, two, row, col, height, width)
        line2, bit2, _, next2 = place_beside(two, one, row, col, height, width)
        step, step1, step2 = ROW[d] * padded + COL[d], ROW[one] * padded + COL[one], ROW[two] * padded + COL[two]
        free_around = np.uint8(1 << one | 1 << two | 1 << d)
        x, at, g = row * width + col, start, 0
        wide1, wide2 = clear(stops, line1, bit1), clear(stops, line2, bit2)
        while around[x] & free_around == free_around:
            x += ROW[d] * width + COL[d]
            at += step
            g += FINE_DIAGONAL
            line1, bit1, line2, bit2 = line1 + next1, bit1 + 1, line2 + next2, bit2 + 1
            if number[at] >= 0:
                found[n, 0], found[n, 1] = number[at], g
                n += 1
                break
            wide1, n = see_beside(subgoals, line1, bit1, at, step1, g, wide1, found, n)
            wide2, n = see_beside(subgoals, line2, bit2, at, step2, g, wide2, found, n)
    return n


@bare_kernel
def link(subgoals: SubgoalMap, nodes: NDArray[np.int64], m: Memory, steps: int) -> int:
    """Add the edges from `nodes` to all that they see, for about `steps` steps; return RUNNING, DONE or FULL."""
    found, width = m.heap, subgoals.lattice.width
    while steps > 0:
        x = m.state[LINKED]
        if x == nodes.size:
            return DONE
        n = seen(subgoals, nodes[x] // width, nodes[x] % width, found)
        steps -= 16 + 4 * n
        if m.state[USED] + n > m.edges.shape[0]:
            return FULL
        for i in range(n):
            e = m.state[USED]
            m.edges[e, NEXT], m.edges[e, TO], m.weight[e] = m.first[x], found[i, 0], found[i, 1]
            m.edges[e, BYPASSED] = m.edges[e, BEFORE] = m.edges[e, AFTER] = -1
            m.first[x] = e
            m.state[USED] += 1
        m.state[LINKED] += 1
    return RUNNING
