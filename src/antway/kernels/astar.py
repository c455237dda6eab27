"""A* on 4 and 8 neighbours: integer costs, a queue of buckets, canonical successors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.bits import ctz
from antway.kernels.buckets import BOUND, CUT, DIAGONAL, EXPANDED, FREE, KEY, KEYS, LAST, LIMIT, STRAIGHT, USED, next_block
from antway.kernels.jit import kernel
from antway.kernels.jps import jump, place

RUNNING, DONE, FULL = 0, 1, 2

_ROW = np.array([0, 1, 0, -1, 1, 1, -1, -1])
_COL = np.array([1, 0, -1, 0, 1, -1, -1, 1])


@kernel
def octile(row: int, col: int, goal_row: int, goal_col: int, shorter: int) -> int:
    """Return the distance on an empty map: `shorter` is what a cell costs of the shorter side of the box between both."""
    a, b = abs(row - goal_row), abs(col - goal_col)
    return STRAIGHT * max(a, b) + shorter * min(a, b)


@kernel
def expand(
    around: NDArray[np.uint8],
    table: NDArray[np.uint8],
    width: int,
    goal_row: int,
    goal_col: int,
    shorter: int,
    base: int,
    label: NDArray[np.int32],
    came: NDArray[np.uint8],
    parent: NDArray[np.int32],
    reached: NDArray[np.int32],
    jumping: bool,
    words: NDArray[np.uint64],
    first: NDArray[np.int32],
    filled: NDArray[np.uint64],
    entries: NDArray[np.int32],
    state: NDArray[np.int64],
    steps: int,
) -> int:
    """Expand up to `steps` cells; return RUNNING, DONE (the goal's label is final, or nothing is left), or FULL (`entries`).

    Parameters
    ----------
    around, table, width
        The map and its canonical successors (see `canonical`), cells in a row.
    goal_row, goal_col, shorter
        See `octile`.
    base, label, came
        `label[cell] - base` is the cost of the best path to the cell so far, and `came` its last move; labels of earlier
        searches are at least `base + LIMIT`, so nothing is cleared between searches.
    first, filled, entries, state
        The queue (see `buckets`).
    """
    height, goal = around.size // width, goal_row * width + goal_col
    goal_lines, goal_bits = np.empty(4, np.int64), np.empty(4, np.int64)
    for d in range(4):
        goal_lines[d], goal_bits[d], _ = place(d, goal_row, goal_col, height, width)
    used, free, at, bound = state[USED], state[FREE], state[KEY], state[BOUND]
    code = RUNNING
    for _ in range(steps):
        if used > entries.shape[0] - 4 * reached.shape[0]:
            code = FULL
            break
        # Take an entry of the least key off the queue.
        word = (at & (KEYS - 1)) >> 6
        while word < filled.size and filled[word] == 0:
            word += 1
        if word == filled.size:
            at = next_block(first, filled, entries, at, state[LAST])
            if at < 0:
                code = DONE
                break
            continue
        bucket = 64 * word + ctz(filled[word])
        at = (at >> 14 << 14) + bucket
        entry = first[bucket]
        first[bucket] = entries[entry, 0]
        if entries[entry, 0] < 0:
            filled[word] &= filled[word] - np.uint64(1)
        entries[entry, 0] = free
        free = entry
        row, col, g = entries[entry, 1], entries[entry, 2], entries[entry, 3]
        cell = row * width + col
        if label[cell] != base + g:
            continue
        if cell == goal:
            code = DONE
            break
        state[EXPANDED] += 1
        moves = np.uint64(table[9 * np.int64(around[cell]) + came[cell]])
        n = 0
        while moves:
            d = ctz(moves)
            moves &= moves - np.uint64(1)
            if not jumping:
                reached[n, 0], reached[n, 1] = row + _ROW[d], col + _COL[d]
                reached[n, 2], reached[n, 3] = g + (STRAIGHT if d < 4 else DIAGONAL), d
                n += 1
            elif d < 4:
                line, bit, length = place(d, row, col, height, width)
                k = jump(words, line, bit, length)
                if line == goal_lines[d] and bit < goal_bits[d] <= bit + abs(k):
                    k = goal_bits[d] - bit
                reached[n, 0], reached[n, 1] = row + k * _ROW[d], col + k * _COL[d]
                reached[n, 2], reached[n, 3] = g + k * STRAIGHT, d
                n += k > 0
            else:
                one, other = d - 4, (d - 3) & 3
                line1, bit1, length1 = place(one, row, col, height, width)
                line2, bit2, length2 = place(other, row, col, height, width)
                # In the part of one side the other side is the step from line to line.
                side1 = length1 if other < 2 else -length1
                side2 = length2 if one < 2 else -length2
                free_around = np.uint8(1 << one | 1 << other | 1 << d)
                r, c, g_here, x = row, col, g, cell
                while around[x] & free_around == free_around:
                    r += _ROW[d]
                    c += _COL[d]
                    x = r * width + c
                    g_here += DIAGONAL
                    line1, bit1, line2, bit2 = line1 + side1, bit1 + 1, line2 + side2, bit2 + 1
                    if x == goal:
                        reached[n, 0], reached[n, 1], reached[n, 2], reached[n, 3] = r, c, g_here, d
                        n += 1
                        break
                    if around[x] >> one & 1:
                        k = jump(words, line1, bit1, length1)
                        if line1 == goal_lines[one] and bit1 < goal_bits[one] <= bit1 + abs(k):
                            k = goal_bits[one] - bit1
                        reached[n, 0], reached[n, 1] = r + k * _ROW[one], c + k * _COL[one]
                        reached[n, 2], reached[n, 3] = g_here + k * STRAIGHT, one
                        n += k > 0
                    if around[x] >> other & 1:
                        k = jump(words, line2, bit2, length2)
                        if line2 == goal_lines[other] and bit2 < goal_bits[other] <= bit2 + abs(k):
                            k = goal_bits[other] - bit2
                        reached[n, 0], reached[n, 1] = r + k * _ROW[other], c + k * _COL[other]
                        reached[n, 2], reached[n, 3] = g_here + k * STRAIGHT, other
                        n += k > 0
        for i in range(n):
            to_row, to_col, g_to = reached[i, 0], reached[i, 1], reached[i, 2]
            to = to_row * width + to_col
            if base + g_to >= label[to]:
                continue
            key = g_to + octile(to_row, to_col, goal_row, goal_col, shorter)
            if key >= bound:
                state[CUT] |= key >= LIMIT
                continue
            label[to], came[to] = base + g_to, reached[i, 3]
            if jumping:
                parent[to] = cell
            if to == goal:
                bound = key
            # Put it into the queue.
            entry = free
            if entry >= 0:
                free = entries[entry, 0]
            else:
                entry = used
                used += 1
            entries[entry, 1], entries[entry, 2], entries[entry, 3], entries[entry, 4] = to_row, to_col, g_to, key
            bucket = key & (KEYS - 1)
            if key >> 14 == at >> 14:
                filled[bucket >> 6] |= np.uint64(1) << np.uint64(bucket & 63)
            else:
                bucket = KEYS + (key >> 14)
                state[LAST] = max(state[LAST], key >> 14)
            entries[entry, 0] = first[bucket]
            first[bucket] = entry
    state[USED], state[FREE], state[KEY], state[BOUND] = used, free, at, bound
    return code


@kernel
def trace(came: NDArray[np.uint8], row: int, col: int, width: int) -> NDArray[np.int32]:
    """Return the path to (row, col), int32[N, 2], by the moves that its cells were reached by."""
    r, c, n = row, col, 1
    while came[r * width + c] < 8:
        d = came[r * width + c]
        r -= _ROW[d]
        c -= _COL[d]
        n += 1
    path = np.empty((n, 2), np.int32)
    for i in range(n - 1, -1, -1):
        path[i, 0], path[i, 1] = row, col
        d = came[row * width + col]
        if d < 8:
            row -= _ROW[d]
            col -= _COL[d]
    return path


@kernel
def trace_jumps(parent: NDArray[np.int32], start: int, goal: int, width: int) -> NDArray[np.int32]:
    """Return the path from `start` to `goal`, int32[N, 2], with the cells of each jump: diagonal first, then straight."""
    n, x = 1, goal
    while x != start:
        p = parent[x]
        n += max(abs(x // width - p // width), abs(x % width - p % width))
        x = p
    path = np.empty((n, 2), np.int32)
    x = goal
    row, col = x // width, x % width
    path[n - 1, 0], path[n - 1, 1] = row, col
    n -= 1
    while x != start:
        x = parent[x]
        to_row, to_col = x // width, x % width
        while row != to_row or col != to_col:
            dr, dc = to_row - row, to_col - col
            if abs(dr) >= abs(dc):
                row += np.sign(dr)
            if abs(dc) >= abs(dr):
                col += np.sign(dc)
            n -= 1
            path[n, 0], path[n, 1] = row, col
    return path
