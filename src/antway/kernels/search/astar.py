"""A* on 4 and 8 neighbours: integer costs, a queue of buckets, canonical successors."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import kernel
from antway.kernels.search.buckets import (
    BOUND,
    CUT,
    DIAGONAL,
    EXPANDED,
    FREE,
    KEY,
    KEYS,
    LAST,
    LIMIT,
    STRAIGHT,
    USED,
    next_block,
    reset,
)
from antway.kernels.search.canonical import START
from antway.kernels.search.jps import jump, place

RUNNING, DONE, FULL, NO_SPACE = 0, 1, 2, 3
LOWEST, HIGHEST = -(2**31), 2**31 - 1

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
    words: NDArray[np.uint64],
    width: int,
    shorter: int,
    nodes: NDArray[np.int32],
    reached: NDArray[np.int32],
    first: NDArray[np.int32],
    filled: NDArray[np.uint64],
    entries: NDArray[np.int32],
    state: NDArray[np.int64],
    base: int,
    goal_row: int,
    goal_col: int,
    steps: int,
) -> int:
    """Take about `steps` steps, cells expanded or passed diagonally, and return where the search stands.

    RUNNING, DONE (the label of the goal is final, or nothing is left), or FULL (`entries` must be longer).

    Parameters
    ----------
    around, table, words, width, shorter
        The map: see `canonical` for the first two, `jps` for `words` (empty: no jumps), `octile` for `shorter`.
    nodes : int32[cells, 2]
        The label, base + cost of the best path so far, and the link, last move + 16 * the cell it was reached from.
        Labels of earlier searches are at least `base + LIMIT`, so that nothing has to be cleared between searches.
    reached : int32[M, 4]
        Room for the successors of one cell: row, col, cost, last move.
    first, filled, entries, state
        The queue (see `buckets`).
    base, goal_row, goal_col, steps
        Base of the labels, the goal, about how many steps to take.
    """
    jumping = words.size > 0
    height, goal = around.size // width, goal_row * width + goal_col
    used, free, at, bound = state[USED], state[FREE], state[KEY], state[BOUND]
    code = RUNNING
    while steps > 0:
        steps -= 1
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
        if nodes[cell, 0] != base + g:
            continue
        if cell == goal:
            code = DONE
            break
        state[EXPANDED] += 1
        moves = np.uint64(table[(nodes[cell, 1] & 15) << 8 | np.int64(around[cell])])
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
                goal_line, goal_bit, _ = place(d, goal_row, goal_col, height, width)
                if line == goal_line and bit < goal_bit <= bit + abs(k):
                    k = goal_bit - bit
                reached[n, 0], reached[n, 1] = row + k * _ROW[d], col + k * _COL[d]
                reached[n, 2], reached[n, 3] = g + k * STRAIGHT, d
                n += k > 0
            else:
                one, other = d - 4, (d - 3) & 3
                line1, bit1, length1 = place(one, row, col, height, width)
                line2, bit2, length2 = place(other, row, col, height, width)
                goal_line1, goal_bit1, _ = place(one, goal_row, goal_col, height, width)
                goal_line2, goal_bit2, _ = place(other, goal_row, goal_col, height, width)
                # In the part of one side the other side is the step from line to line.
                side1 = length1 if other < 2 else -length1
                side2 = length2 if one < 2 else -length2
                free_around = np.uint8(1 << one | 1 << other | 1 << d)
                r, c, g_here, x = row, col, g, cell
                while around[x] & free_around == free_around:
                    steps -= 1
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
                        if line1 == goal_line1 and bit1 < goal_bit1 <= bit1 + abs(k):
                            k = goal_bit1 - bit1
                        reached[n, 0], reached[n, 1] = r + k * _ROW[one], c + k * _COL[one]
                        reached[n, 2], reached[n, 3] = g_here + k * STRAIGHT, one
                        n += k > 0
                    if around[x] >> other & 1:
                        k = jump(words, line2, bit2, length2)
                        if line2 == goal_line2 and bit2 < goal_bit2 <= bit2 + abs(k):
                            k = goal_bit2 - bit2
                        reached[n, 0], reached[n, 1] = r + k * _ROW[other], c + k * _COL[other]
                        reached[n, 2], reached[n, 3] = g_here + k * STRAIGHT, other
                        n += k > 0
        for i in range(n):
            to_row, to_col, g_to = reached[i, 0], reached[i, 1], reached[i, 2]
            to = to_row * width + to_col
            if base + g_to >= nodes[to, 0]:
                continue
            key = g_to + octile(to_row, to_col, goal_row, goal_col, shorter)
            if key >= bound:
                state[CUT] |= key >= LIMIT
                continue
            nodes[to, 0], nodes[to, 1] = base + g_to, cell << 4 | reached[i, 3]
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
def initialize(
    nodes: NDArray[np.int32],
    first: NDArray[np.int32],
    filled: NDArray[np.uint64],
    entries: NDArray[np.int32],
    state: NDArray[np.int64],
    base: int,
    cell: int,
    row: int,
    col: int,
    key: int,
) -> None:
    """Empty the queue and put the start into it."""
    reset(first, filled, state)
    nodes[cell, 0], nodes[cell, 1] = base, START
    entries[0, 0], entries[0, 1], entries[0, 2], entries[0, 3], entries[0, 4] = -1, row, col, 0, key
    first[KEYS + key // KEYS] = 0
    state[USED], state[LAST], state[KEY] = 1, key // KEYS, -KEYS


@kernel
def trace(nodes: NDArray[np.int32], goal: int, width: int) -> tuple[NDArray[np.int32], int]:
    """Return the path to `goal`, int32[N, 2], with the cells of each jump, diagonal first, and the number of diagonal moves."""
    n, diagonals, x = 1, 0, goal
    while nodes[x, 1] != START:
        parent = nodes[x, 1] >> 4
        dr, dc = abs(x // width - parent // width), abs(x % width - parent % width)
        n += max(dr, dc)
        diagonals += min(dr, dc)
        x = parent
    path = np.empty((n, 2), np.int32)
    x = goal
    row, col = x // width, x % width
    path[n - 1, 0], path[n - 1, 1] = row, col
    n -= 1
    while nodes[x, 1] != START:
        x = nodes[x, 1] >> 4
        to_row, to_col = x // width, x % width
        while row != to_row or col != to_col:
            dr, dc = to_row - row, to_col - col
            if abs(dr) >= abs(dc):
                row += 1 if dr > 0 else -1
            if abs(dc) >= abs(dr):
                col += 1 if dc > 0 else -1
            n -= 1
            path[n, 0], path[n, 1] = row, col
    return path, diagonals


@kernel
def is_clear(
    around: NDArray[np.uint8], table: NDArray[np.uint8], width: int, row: int, col: int, goal_row: int, goal_col: int
) -> bool:
    """Tell whether diagonal and then straight moves lead to the goal: with diagonals no path is shorter."""
    down, right = np.sign(goal_row - row), np.sign(goal_col - col)
    diagonal = (4 if right > 0 else 5) if down > 0 else (7 if right > 0 else 6)
    while row != goal_row and col != goal_col:
        if not table[START << 8 | np.int64(around[row * width + col])] >> diagonal & 1:
            return False
        row += down
        col += right
    straight = (0 if right > 0 else 2) if row == goal_row else (1 if down > 0 else 3)
    down, right = np.sign(goal_row - row), np.sign(goal_col - col)
    while row != goal_row or col != goal_col:
        if not table[START << 8 | np.int64(around[row * width + col])] >> straight & 1:
            return False
        row += down
        col += right
    return True


@kernel
def solve(
    around: NDArray[np.uint8],
    table: NDArray[np.uint8],
    words: NDArray[np.uint64],
    width: int,
    shorter: int,
    nodes: NDArray[np.int32],
    reached: NDArray[np.int32],
    first: NDArray[np.int32],
    filled: NDArray[np.uint64],
    entries: NDArray[np.int32],
    state: NDArray[np.int64],
    base: int,
    row: int,
    col: int,
    goal_row: int,
    goal_col: int,
    fresh: bool,
    steps: int,
) -> tuple[int, NDArray[np.int32], int, int]:
    """Begin a search if it is `fresh`, take about `steps` steps; return the code, path, its diagonals, and cells expanded.

    The path is empty unless the search is DONE and found the goal. Other parameters as for `expand`.
    """
    if fresh:
        key = octile(row, col, goal_row, goal_col, shorter)
        initialize(nodes, first, filled, entries, state, base, row * width + col, row, col, key)
    goal = goal_row * width + goal_col
    if fresh and shorter != STRAIGHT and is_clear(around, table, width, row, col, goal_row, goal_col):
        if row != goal_row or col != goal_col:
            nodes[goal, 0], nodes[goal, 1] = base, (row * width + col) << 4
        code = DONE
    else:
        code = expand(
            around, table, words, width, shorter, nodes, reached, first, filled, entries, state, base, goal_row, goal_col, steps
        )
    if code != DONE or nodes[goal, 0] >= base + LIMIT:
        return code, np.empty((0, 2), np.int32), 0, state[EXPANDED]
    path, diagonals = trace(nodes, goal, width)
    return code, path, diagonals, state[EXPANDED]


@kernel
def solve_all(
    around: NDArray[np.uint8],
    table: NDArray[np.uint8],
    words: NDArray[np.uint64],
    width: int,
    shorter: int,
    nodes: NDArray[np.int32],
    reached: NDArray[np.int32],
    first: NDArray[np.int32],
    filled: NDArray[np.uint64],
    entries: NDArray[np.int32],
    state: NDArray[np.int64],
    base: int,
    ends: NDArray[np.int64],
    query: int,
    begins: NDArray[np.int64],
    cells: NDArray[np.int32],
    diagonals: NDArray[np.int64],
) -> tuple[int, int, int]:
    """Solve the queries `ends`, int64[Q, 4], from number `query` on; return the next query, the base, and why it stopped there.

    DONE with all, FULL where `entries` or NO_ROOM where `cells` must be longer; the same query then begins anew. The path of
    query i is at `cells[begins[i]:begins[i + 1]]`, with `diagonals[i]` diagonal moves, or -1 without a path, -2 where the
    integers do not reach.
    """
    while query < ends.shape[0]:
        row, col, goal_row, goal_col = ends[query, 0], ends[query, 1], ends[query, 2], ends[query, 3]
        begins[query + 1] = begins[query]
        diagonals[query] = -2
        if octile(row, col, goal_row, goal_col, shorter) < LIMIT:
            base -= LIMIT
            if base < LOWEST:
                nodes[:, 0] = HIGHEST
                base = HIGHEST - LIMIT
            code, path, turns, _ = solve(
                around,
                table,
                words,
                width,
                shorter,
                nodes,
                reached,
                first,
                filled,
                entries,
                state,
                base,
                row,
                col,
                goal_row,
                goal_col,
                True,
                1 << 62,
            )
            if code == FULL:
                return query, base, FULL
            if path.shape[0] > 0:
                if begins[query] + path.shape[0] > cells.shape[0]:
                    return query, base, NO_SPACE
                begins[query + 1] += path.shape[0]
                cells[begins[query] : begins[query + 1]] = path
                diagonals[query] = turns
            elif not state[CUT]:
                diagonals[query] = -1
        query += 1
    return query, base, DONE
