"""A* on 4 and 8 neighbours: integer costs, a queue of buckets, canonical successors."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.search.buckets import BOUND, CUT, EXPANDED, FREE, KEY, KEYS, LAST, LIMIT, USED, Queue, put, reset, take
from antway.kernels.search.canonical import COL, ROW, START, Lattice
from antway.kernels.search.jps import jump, place, place_beside
from antway.kernels.search.lengths import DIAGONAL, STRAIGHT, octile

RUNNING, DONE, FULL, NO_SPACE = 0, 1, 2, 3
LOWEST, HIGHEST = -(2**31), 2**31 - 1  # range of int32, the type of labels


class SearchMap(NamedTuple):
    """A map, prepared for A*."""

    lattice: Lattice
    words: NDArray[np.uint64]  # the map packed into bits (see `jps`), with which a successor is a jump away; empty: a move
    shorter: int  # as in `octile`


class Memory(NamedTuple):
    """The memory of a search, used again by the next one."""

    nodes: NDArray[np.int32]  # [cells, 2] label: base + cost of the best path; link: last move + 16 * previous cell
    reached: NDArray[np.int32]  # [M, 4] successors of the expanded cell: row, col, cost, last move; no cell has as many as M
    queue: Queue


@inner_kernel
def jump_straight(
    words: NDArray[np.uint64], line: int, bit: int, length: int, goal_line: int, goal_bit: int,
    d: int, row: int, col: int, g: int, reached: NDArray[np.int32], n: int,
) -> int:  # fmt: skip
    """Append the jump point or the goal straight ahead in direction d, if there is one, to `reached`; return the new n."""
    k = jump(words, line, bit, length)
    if line == goal_line and bit < goal_bit <= bit + abs(k):
        k = goal_bit - bit
    reached[n, 0], reached[n, 1] = row + k * ROW[d], col + k * COL[d]
    reached[n, 2], reached[n, 3] = g + k * STRAIGHT, d
    return n + int(k > 0)


@inner_kernel
def jump_diagonal(
    search_map: SearchMap, d: int, row: int, col: int, g: int, goal_row: int, goal_col: int, reached: NDArray[np.int32], n: int
) -> tuple[int, int]:
    """Append the jump points beside the diagonal in direction d, and the goal, to `reached`; return n and the cells passed."""
    around, width, words = search_map.lattice.around, search_map.lattice.width, search_map.words
    height = around.size // width
    one, other = d - 4, (d - 3) & 3  # the straight directions on both sides of d
    line1, bit1, length1, step1 = place_beside(one, other, row, col, height, width)
    line2, bit2, length2, step2 = place_beside(other, one, row, col, height, width)
    goal_line1, goal_bit1, _ = place(one, goal_row, goal_col, height, width)
    goal_line2, goal_bit2, _ = place(other, goal_row, goal_col, height, width)
    free_around = np.uint8(1 << one | 1 << other | 1 << d)
    x, goal, passed = row * width + col, goal_row * width + goal_col, 0
    while around[x] & free_around == free_around:
        passed += 1
        row += ROW[d]
        col += COL[d]
        x = row * width + col
        g += DIAGONAL
        line1, bit1, line2, bit2 = line1 + step1, bit1 + 1, line2 + step2, bit2 + 1
        if x == goal:
            reached[n, 0], reached[n, 1], reached[n, 2], reached[n, 3] = row, col, g, d
            n += 1
            break
        if around[x] >> one & 1:
            n = jump_straight(words, line1, bit1, length1, goal_line1, goal_bit1, one, row, col, g, reached, n)
        if around[x] >> other & 1:
            n = jump_straight(words, line2, bit2, length2, goal_line2, goal_bit2, other, row, col, g, reached, n)
    return n, passed


@inner_kernel
def successors(
    search_map: SearchMap, moves: np.uint64, row: int, col: int, g: int,
    goal_row: int, goal_col: int, reached: NDArray[np.int32],
) -> tuple[int, int]:  # fmt: skip
    """Write the successors of a cell in the directions of the set `moves` to `reached`, each one move or one jump away.

    Returns how many there are, and the number of cells passed diagonally.
    """
    words, width = search_map.words, search_map.lattice.width
    height = search_map.lattice.around.size // width
    n = passed = 0
    while moves:
        d = ctz(moves)
        moves &= moves - np.uint64(1)
        if words.size == 0:
            reached[n, 0], reached[n, 1] = row + ROW[d], col + COL[d]
            reached[n, 2], reached[n, 3] = g + (STRAIGHT if d < 4 else DIAGONAL), d
            n += 1
        elif d < 4:
            line, bit, length = place(d, row, col, height, width)
            goal_line, goal_bit, _ = place(d, goal_row, goal_col, height, width)
            n = jump_straight(words, line, bit, length, goal_line, goal_bit, d, row, col, g, reached, n)
        else:
            n, along = jump_diagonal(search_map, d, row, col, g, goal_row, goal_col, reached, n)
            passed += along
    return n, passed


@bare_kernel
def expand(search_map: SearchMap, memory: Memory, base: int, goal_row: int, goal_col: int, steps: int) -> int:
    """Take about `steps` steps (cells expanded or passed diagonally) and return the state of the search.

    The state is RUNNING, DONE (the label of the goal is final, or the queue is empty), or FULL (the queue's `entries` must be
    longer). A*: Hart, Nilsson and Raphael, A formal basis for the heuristic determination of minimum cost paths, 1968;
    successors: Harabor and Grastien, ICAPS 2014. Of entries with equal keys, the one added last is taken first if they were
    added while their block was the current one; of those that waited in a later block, the one added first
    (`buckets.next_block`).

    Labels start at `base`, and those of earlier searches are at least `base + LIMIT`, so that nothing needs to be cleared
    between searches.
    """
    around, table, width = search_map.lattice.around, search_map.lattice.table, search_map.lattice.width
    nodes, reached, queue = memory.nodes, memory.reached, memory.queue
    entries, state = queue.entries, queue.state
    goal = goal_row * width + goal_col
    used, free, at, bound = state[USED], state[FREE], state[KEY], state[BOUND]
    code = RUNNING
    while steps > 0:
        steps -= 1
        if used > entries.shape[0] - reached.shape[0]:
            code = FULL
            break
        # Select the open cell of least cost g + h. This closes it, and its entry can be used again.
        entry, at = take(queue, at)
        if entry < 0:
            code = DONE
            break
        entries[entry, 0] = free
        free = entry
        row, col, g = entries[entry, 1], entries[entry, 2], entries[entry, 3]
        cell = row * width + col
        if nodes[cell, 0] != base + g:  # it has been reached at less cost since
            continue
        if cell == goal:
            code = DONE
            break
        # Generate its canonical successors.
        state[EXPANDED] += 1
        moves = np.uint64(table[(nodes[cell, 1] & 15) << 8 | np.int64(around[cell])])
        n, passed = successors(search_map, moves, row, col, g, goal_row, goal_col, reached)
        steps -= passed
        # Open the successors that were reached for the first time, or at less cost than before.
        for i in range(n):
            to_row, to_col, g_to = reached[i, 0], reached[i, 1], reached[i, 2]
            to = to_row * width + to_col
            if base + g_to >= nodes[to, 0]:
                state[CUT] |= g_to >= LIMIT  # one jump can lead so far, to a cell that no path has reached yet
                continue
            key = g_to + octile(to_row, to_col, goal_row, goal_col, STRAIGHT, search_map.shorter)
            if key >= bound:
                state[CUT] |= key >= LIMIT
                continue
            nodes[to, 0], nodes[to, 1] = base + g_to, cell << 4 | reached[i, 3]
            if to == goal:
                bound = key
            entry = free
            if entry >= 0:
                free = entries[entry, 0]
            else:
                entry = used
                used += 1
            put(queue, entry, at, to_row, to_col, g_to, key)
    state[USED], state[FREE], state[KEY], state[BOUND] = used, free, at, bound
    return code


@bare_kernel
def initialize(nodes: NDArray[np.int32], queue: Queue, base: int, cell: int, row: int, col: int, key: int) -> None:
    """Empty the queue and add the start."""
    reset(queue)
    first, entries, state = queue.first, queue.entries, queue.state
    nodes[cell, 0], nodes[cell, 1] = base, START
    entries[0, 0], entries[0, 1], entries[0, 2], entries[0, 3], entries[0, 4] = -1, row, col, 0, key
    first[KEYS + key // KEYS] = 0
    state[USED], state[LAST], state[KEY] = 1, key // KEYS, -KEYS


@kernel
def trace(nodes: NDArray[np.int32], goal: int, width: int) -> tuple[NDArray[np.int32], int]:
    """Return the path to `goal`, int32[N, 2], with all cells of each jump, and its number of diagonal moves."""
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


@bare_kernel
def is_clear(lattice: Lattice, row: int, col: int, goal_row: int, goal_col: int) -> bool:
    """Tell whether diagonal and then straight moves lead to the goal. With diagonal moves no path is shorter."""
    around, table, width = lattice.around, lattice.table, lattice.width
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
    search_map: SearchMap, memory: Memory, base: int, row: int, col: int, goal_row: int, goal_col: int, fresh: bool, steps: int
) -> tuple[int, NDArray[np.int32], int, int]:
    """Start a search if it is `fresh`, and take about `steps` steps; return state, path, its diagonals, and cells expanded.

    The path is empty unless the search is DONE and has found the goal. The other parameters are those of `expand`.
    """
    nodes, queue, width = memory.nodes, memory.queue, search_map.lattice.width
    if fresh:
        key = octile(row, col, goal_row, goal_col, STRAIGHT, search_map.shorter)
        initialize(nodes, queue, base, row * width + col, row, col, key)
    goal = goal_row * width + goal_col
    if fresh and search_map.shorter != STRAIGHT and is_clear(search_map.lattice, row, col, goal_row, goal_col):
        if row != goal_row or col != goal_col:
            nodes[goal, 0], nodes[goal, 1] = base, (row * width + col) << 4
        code = DONE
    else:
        code = expand(search_map, memory, base, goal_row, goal_col, steps)
    if code != DONE or nodes[goal, 0] >= base + LIMIT:
        return code, np.empty((0, 2), np.int32), 0, queue.state[EXPANDED]
    path, diagonals = trace(nodes, goal, width)
    return code, path, diagonals, queue.state[EXPANDED]


@kernel
def solve_all(
    search_map: SearchMap, memory: Memory, base: int, ends: NDArray[np.int64], query: int,
    path_start: NDArray[np.int64], cells: NDArray[np.int32], diagonals: NDArray[np.int64],
) -> tuple[int, int, int]:  # fmt: skip
    """Solve the queries `ends`, int64[Q, 4], from number `query` on; return the next query, the base, and the state.

    The state is DONE after the last query, FULL where the queue's `entries` or NO_SPACE where `cells` must be longer; then the
    same query has to be started again. The path of query i is `cells[path_start[i]:path_start[i + 1]]`, with `diagonals[i]`
    diagonal moves; that is -1 if there is no path, and -2 if its cost would exceed LIMIT.
    """
    while query < ends.shape[0]:
        row, col, goal_row, goal_col = ends[query, 0], ends[query, 1], ends[query, 2], ends[query, 3]
        path_start[query + 1] = path_start[query]
        diagonals[query] = -2
        if octile(row, col, goal_row, goal_col, STRAIGHT, search_map.shorter) < LIMIT:
            base -= LIMIT
            if base < LOWEST:
                memory.nodes[:, 0] = HIGHEST
                base = HIGHEST - LIMIT
            code, path, count, _ = solve(search_map, memory, base, row, col, goal_row, goal_col, True, 1 << 62)
            if code == FULL:
                return query, base, FULL
            if path.shape[0] > 0:
                if path_start[query] + path.shape[0] > cells.shape[0]:
                    return query, base, NO_SPACE
                path_start[query + 1] += path.shape[0]
                cells[path_start[query] : path_start[query + 1]] = path
                diagonals[query] = count
            elif not memory.queue.state[CUT]:
                diagonals[query] = -1
        query += 1
    return query, base, DONE
