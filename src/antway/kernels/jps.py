"""Jump points on bit-packed maps: successors of a cell that lie a whole run of cells away, for diagonals between free cells only.

A straight jump goes on until a wall, the goal, or a jump point: a cell beside which an obstacle has just ended, so that a
shortest path may turn there. 63 cells are examined at once, with the words of the line and of both lines beside it. A diagonal
jump looks along both of its sides at every cell and takes the jump points found there at once, so that cells where it would
merely turn are never opened (Harabor and Grastien, Improving jump point search, ICAPS 2014: JPS (B + P)).

Maps are packed by rows and, transposed, by columns: line r + 1, bit c + 64, 1 where blocked; everything off the map is blocked.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.bits import clz, ctz
from antway.kernels.jit import kernel

_ONE, _LAST = np.uint64(1), np.uint64(63)
_ALL_BUT_HIGHEST, _ALL_BUT_LOWEST = ~(_ONE << _LAST), ~_ONE


@kernel
def ahead(lines: NDArray[np.uint64], line: int, bit: int) -> int:
    """Return how far up the line the next jump point is, or, negated, the next wall if that comes first."""
    start = bit
    wall = stop = np.uint64(0)
    while stop == 0:
        word, low = bit >> 6, np.uint64(bit & 63)
        high = _LAST - low
        here = lines[line, word] >> low | lines[line, word + 1] << _ONE << high
        above = lines[line - 1, word] >> low | lines[line - 1, word + 1] << _ONE << high
        below = lines[line + 1, word] >> low | lines[line + 1, word + 1] << _ONE << high
        wall = here >> _ONE
        stop = (wall | (above & ~(above >> _ONE)) | (below & ~(below >> _ONE))) & _ALL_BUT_HIGHEST
        bit += 63
    found = ctz(stop)
    distance = bit - 62 + found - start
    return -distance if wall >> np.uint64(found) & _ONE else distance


@kernel
def behind(lines: NDArray[np.uint64], line: int, bit: int) -> int:
    """Return the same down the line."""
    start = bit
    wall = stop = np.uint64(0)
    while stop == 0:
        word, low = bit >> 6, np.uint64(bit & 63)
        high = _LAST - low
        here = lines[line, word] << high | lines[line, word - 1] >> _ONE >> low
        above = lines[line - 1, word] << high | lines[line - 1, word - 1] >> _ONE >> low
        below = lines[line + 1, word] << high | lines[line + 1, word - 1] >> _ONE >> low
        wall = here << _ONE
        stop = (wall | (above & ~(above << _ONE)) | (below & ~(below << _ONE))) & _ALL_BUT_LOWEST
        bit -= 63
    found = clz(stop)
    distance = start - bit - 62 + found
    return -distance if wall << np.uint64(found) >> _LAST else distance


@kernel
def jump(rows: NDArray[np.uint64], cols: NDArray[np.uint64], row: int, col: int, d: int, goal_row: int, goal_col: int) -> int:
    """Return how far off in straight direction `d` the goal or the next jump point is; 0 if there is none before a wall."""
    if d == 0:
        reach, goal = ahead(rows, row + 1, col + 64), (goal_col - col if row == goal_row else 0)
    elif d == 1:
        reach, goal = ahead(cols, col + 1, row + 64), (goal_row - row if col == goal_col else 0)
    elif d == 2:
        reach, goal = behind(rows, row + 1, col + 64), (col - goal_col if row == goal_row else 0)
    else:
        reach, goal = behind(cols, col + 1, row + 64), (row - goal_row if col == goal_col else 0)
    if 0 < goal <= abs(reach):
        reach = goal
    return max(reach, 0)
