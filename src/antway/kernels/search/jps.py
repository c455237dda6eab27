"""Jump points on a bit-packed map: successors that are a whole run of cells away, for the moves of `Moves.EIGHT`.

A straight jump continues until a wall, the goal, or a jump point: a cell beside which an obstacle has just ended, so that a
shortest path may turn there. The words of a line and of both neighbouring lines give 63 cells at once. A diagonal jump looks
along both of its sides at every cell and adds the jump points found there directly, so that cells where it would only turn are
never opened (Harabor and Grastien, Improving jump point search, ICAPS 2014: JPS (B + P)).

The map is packed four times, once for each straight direction, so that every jump runs along increasing bits of a line. Part d
of the array `words` has H + 2 lines of W // 64 + 3 words for directions along rows, and W + 2 lines of H // 64 + 3 words for
directions along columns. A bit is 1 where the map is blocked, and everything off the map is blocked. Line 1, bit 64 is cell
(0, 0) for E and S, cell (0, W - 1) for W, and cell (H - 1, 0) for N.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, kernel

_ONE, _LAST = np.uint64(1), np.uint64(63)
_ALL_BUT_LAST = ~(_ONE << _LAST)


@bare_kernel
def place(d: int, row: int, col: int, height: int, width: int) -> tuple[int, int, int]:
    """Return where part `d` has a cell: the first word of its line, the bit in the line, and the words in a line."""
    row_words, col_words = width // 64 + 3, height // 64 + 3
    row_part, col_part = (height + 2) * row_words, (width + 2) * col_words
    if d == 0:
        return (row + 1) * row_words, col + 64, row_words
    if d == 1:
        return row_part + (col + 1) * col_words, row + 64, col_words
    if d == 2:
        return row_part + col_part + (row + 1) * row_words, width - 1 - col + 64, row_words
    return 2 * row_part + col_part + (col + 1) * col_words, height - 1 - row + 64, col_words


@bare_kernel
def place_beside(d: int, other: int, row: int, col: int, height: int, width: int) -> tuple[int, int, int, int]:
    """Return what `place` does, and the number of words from that line to the line of the cell one step in direction `other`.

    `other` is at right angles to `d`, so that the step leads to the next line of part `d`, or to the line before.
    """
    line, bit, length = place(d, row, col, height, width)
    return line, bit, length, length if other < 2 else -length


@bare_kernel
def jump(words: NDArray[np.uint64], line: int, bit: int, length: int) -> int:
    """Return how far along the line the next jump point is, or the negated distance of the next wall if that is nearer."""
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
def turn(lines: NDArray[np.uint64], turned: NDArray[np.uint64], height: int, width: int) -> None:
    """Write the columns of a packed map as lines, which are all 1 before: the part for S from the part for E."""
    square = np.empty(64, np.uint64)
    for i in range(1, turned.shape[1] - 1):
        rows = min(64, height - 64 * (i - 1))
        for j in range(1, lines.shape[1] - 1):
            square[:] = ~np.uint64(0)
            for k in range(rows):
                square[k] = lines[64 * (i - 1) + k + 1, j]
            transpose(square)
            for k in range(min(64, width - 64 * (j - 1))):
                turned[64 * (j - 1) + k + 1, i] = square[k]


@kernel
def transpose(square: NDArray[np.uint64]) -> None:
    """Transpose 64 x 64 bits: swap the halves, then the quarters within each half, and so on."""
    step, low = 32, np.uint64(0xFFFFFFFF)
    while step:
        shift = np.uint64(step)
        for k in range(64):
            if k & step == 0:
                swap = (square[k] >> shift ^ square[k + step]) & low
                square[k] ^= swap << shift
                square[k + step] ^= swap
        step >>= 1
        low ^= low << np.uint64(step)


@kernel
def mirror(lines: NDArray[np.uint64], mirrored: NDArray[np.uint64], length: int) -> None:
    """Write packed lines of `length` cells with the last cell first into lines that are all 1."""
    words = lines.shape[1]
    spare = np.uint64(63 - length % 64)  # the reversed cells must be moved down by this and one more bit
    for line in range(lines.shape[0]):
        here = reverse(lines[line, words - 1])
        for i in range(words - 1):
            ahead = reverse(lines[line, words - 2 - i])
            mirrored[line, i] = here >> spare >> _ONE | ahead << (_LAST - spare)
            here = ahead


@kernel
def reverse(word: np.uint64) -> np.uint64:
    """Return a word with its bits in reverse order."""
    step, low = 32, np.uint64(0xFFFFFFFF)
    while step:
        shift = np.uint64(step)
        word = word >> shift & low | (word & low) << shift
        step >>= 1
        low ^= low << np.uint64(step)
    return word
