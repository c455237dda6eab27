"""Jump points on a bit-packed map: successors that lie a whole run of cells away, for the moves of `Moves.EIGHT`.

A straight jump goes on until a wall, the goal, or a jump point: a cell beside which an obstacle has just ended, so that a
shortest path may turn there. 63 cells are examined at once, with the words of the line and of both lines beside it. A diagonal
jump looks along both of its sides at every cell and takes the jump points found there at once, so that cells where it would
merely turn are never opened (Harabor and Grastien, Improving jump point search, ICAPS 2014: JPS (B + P)).

The map is packed four times, once for each straight direction, so that every jump runs up a line: part d of the array `words`
has H + 2 lines of W // 64 + 3 words for the directions along rows, W + 2 lines of H // 64 + 3 words for those along columns.
A bit is 1 where the map is blocked, and everything off the map is blocked. Line 1, bit 64 is cell (0, 0) for E and S, cell
(0, W - 1) for W, cell (H - 1, 0) for N.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.bits import ctz
from antway.kernels.jit import kernel

_ONE, _LAST = np.uint64(1), np.uint64(63)
_ALL_BUT_LAST = ~(_ONE << _LAST)


@kernel
def place(d: int, row: int, col: int, height: int, width: int) -> tuple[int, int, int]:
    """Return where part `d` has a cell: the word at which its line begins, the bit in the line, and the words in a line."""
    row_words, col_words = width // 64 + 3, height // 64 + 3
    row_part, col_part = (height + 2) * row_words, (width + 2) * col_words
    if d == 0:
        return (row + 1) * row_words, col + 64, row_words
    if d == 1:
        return row_part + (col + 1) * col_words, row + 64, col_words
    if d == 2:
        return row_part + col_part + (row + 1) * row_words, width - 1 - col + 64, row_words
    return 2 * row_part + col_part + (col + 1) * col_words, height - 1 - row + 64, col_words


@kernel
def jump(words: NDArray[np.uint64], line: int, bit: int, length: int) -> int:
    """Return how far up the line the next jump point is, or, negated, the next wall if that comes first."""
    start = bit
    wall = stop = np.uint64(0)
    while stop == 0:
        low = np.uint64(bit & 63)
        high = _LAST - low
        i = line + (bit >> 6)
        here = words[np.uint64(i)] >> low | words[np.uint64(i + 1)] << _ONE << high
        above = words[np.uint64(i - length)] >> low | words[np.uint64(i - length + 1)] << _ONE << high
        below = words[np.uint64(i + length)] >> low | words[np.uint64(i + length + 1)] << _ONE << high
        wall = here >> _ONE
        stop = (wall | (above & ~(above >> _ONE)) | (below & ~(below >> _ONE))) & _ALL_BUT_LAST
        bit += 63
    found = ctz(stop)
    distance = bit - 62 + found - start
    return -distance if wall >> np.uint64(found) & _ONE else distance


@kernel
def pack_columns(blocked: NDArray[np.uint8], words: NDArray[np.uint64]) -> None:
    """Write the columns of a map of 0 and 1 into `words`, uint64[W + 2, H // 64 + 3] full of 1, as lines laid out as above."""
    height, width = blocked.shape
    for top in range(0, height, 64):
        part = np.zeros(width, np.uint64)
        for k in range(64):
            for col in range(width):
                part[col] |= np.uint64(blocked[top + k, col] if top + k < height else 1) << np.uint64(k)
        words[1:-1, 1 + top // 64] = part
