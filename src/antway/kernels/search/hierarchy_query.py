"""Shortest paths on a map through the contraction hierarchy of its subgoals (see `subgoals` and `hierarchy`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.search.astar import is_clear
from antway.kernels.search.hierarchy import NOWHERE
from antway.kernels.search.lengths import FINE_DIAGONAL, FINE_STRAIGHT, octile
from antway.kernels.search.subgoals import SubgoalMap, seen

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

_SHORTER = FINE_DIAGONAL - FINE_STRAIGHT  # cost of a cell along the shorter side of the bounding box (see `octile`)
_INVERSE = pow(FINE_DIAGONAL, -1, FINE_STRAIGHT)  # modulo FINE_STRAIGHT


class UpwardGraph(NamedTuple):
    """The hierarchy as queries use it: each edge belongs to its lower end (see `hierarchy.upward_graph`)."""

    row_start: Longs  # [N + 1] the edges up from node x are row_start[x] to row_start[x + 1]
    up: Longs  # [E, 2] upper end of each edge, and its cost
    parts: Ints  # [E, 3] for a shortcut, the node it bypasses and the edges from that node to both ends; else -1
    cells: Ints  # [N, 2] row and column of each node


class QueryMemory(NamedTuple):
    """The memory of a query, used again by the next one."""

    label: Longs  # [2, N, 2] for each end and node: the cost, and the number of the query that wrote it
    came: Ints  # [2, N, 2] edge by which the node was reached and its lower end; -1 where the end sees the node
    heaps: Longs  # [2, M, 2] with space for an entry for each edge and seed
    seeds: Longs  # [2, K, 2] the nodes that each end sees (see `subgoals.seen`)
    stack: Ints  # [L, 3] edges to unpack: edge, its lower end, whether the path goes up it
    state: Longs  # [1] number of the last query


@bare_kernel
def diagonals(cost: int) -> int:
    """Return the number of diagonal moves in a cost, which must be less than FINE_STRAIGHT."""
    return cost % FINE_STRAIGHT * _INVERSE % FINE_STRAIGHT


@bare_kernel
def count_moves(cost: int) -> int:
    """Return the number of all moves in a cost."""
    diagonal = diagonals(cost)
    return (cost - diagonal * FINE_DIAGONAL) // FINE_STRAIGHT + diagonal


@bare_kernel
def meet(graph: UpwardGraph, memory: QueryMemory, size: Longs, ends: Longs) -> tuple[int, int, int]:
    """Search upwards from both ends, each by A*; return the cost, the node where both meet, and the nodes expanded.

    `memory.seeds` holds the nodes that each end sees, `size`, int64[2], how many these are (it is overwritten), `memory.state`
    the number of this query, and `ends`, int64[2, 2], row and column of both ends.
    """
    row_start, up, cells = graph.row_start, graph.up, graph.cells
    label, came, heaps, seeds, now = memory.label, memory.came, memory.heaps, memory.seeds, memory.state[0]
    best, top, expanded = NOWHERE, -1, 0
    for side in range(2):
        count, size[side] = size[side], 0
        for i in range(count):
            x, g = seeds[side, i, 0], seeds[side, i, 1]
            label[side, x, 0], label[side, x, 1], came[side, x, 0] = g, now, -1
            key = g + octile(cells[x, 0], cells[x, 1], ends[1 - side, 0], ends[1 - side, 1], FINE_STRAIGHT, _SHORTER)
            size[side] = push(heaps[side], size[side], key, x)
    while True:
        least0 = heaps[0, 0, 0] if size[0] > 0 else NOWHERE
        least1 = heaps[1, 0, 0] if size[1] > 0 else NOWHERE
        if min(least0, least1) >= best:
            return best, top, expanded
        side = 0 if least0 <= least1 else 1
        row, col = ends[1 - side, 0], ends[1 - side, 1]
        key, x = heaps[side, 0, 0], heaps[side, 0, 1]
        size[side] = pop(heaps[side], size[side])
        g = label[side, x, 0]
        if key > g + octile(cells[x, 0], cells[x, 1], row, col, FINE_STRAIGHT, _SHORTER):
            continue
        expanded += 1
        if label[1 - side, x, 1] == now and g + label[1 - side, x, 0] < best:
            best, top = g + label[1 - side, x, 0], x
        if _is_stalled(graph, memory, side, x):
            continue
        for e in range(row_start[x], row_start[x + 1]):
            to, g_to = up[e, 0], g + up[e, 1]
            if label[side, to, 1] != now or g_to < label[side, to, 0]:
                key = g_to + octile(cells[to, 0], cells[to, 1], row, col, FINE_STRAIGHT, _SHORTER)
                if key < best:
                    label[side, to, 0], label[side, to, 1] = g_to, now
                    came[side, to, 0], came[side, to, 1] = e, x
                    size[side] = push(heaps[side], size[side], key, to)


@bare_kernel
def _is_stalled(graph: UpwardGraph, memory: QueryMemory, side: int, x: int) -> bool:
    """Tell whether a path to node x from above is shorter than its label, so that no shortest path leads up through x."""
    label, up, now = memory.label, graph.up, memory.state[0]
    stalled = False
    for e in range(graph.row_start[x], graph.row_start[x + 1]):
        to = up[e, 0]
        stalled |= label[side, to, 1] == now and label[side, to, 0] + up[e, 1] < label[side, x, 0]
    return bool(stalled)


@bare_kernel
def walk(path: Ints, at: int, step: int, row: int, col: int) -> int:
    """Append the moves from `path[at]` to a visible cell, diagonals first; indices advance by `step`. Return the last index."""
    r, c = path[at, 0], path[at, 1]
    while r != row or c != col:
        r += int(row > r) - int(row < r)
        c += int(col > c) - int(col < c)
        at += step
        path[at, 0], path[at, 1] = r, c
    return at


@bare_kernel
def unpack(graph: UpwardGraph, stack: Ints, edge: int, node: int, path: Ints, at: int, step: int) -> int:
    """Append the path from the upper end of `edge`, at `path[at]`, down to its lower end `node`; return the last index."""
    parts, cells = graph.parts, graph.cells
    stack[0, 0], stack[0, 1], stack[0, 2] = edge, node, 0
    n = 1
    while n > 0:
        n -= 1
        edge, node, ascends = stack[n, 0], stack[n, 1], stack[n, 2]
        if parts[edge, 0] < 0:
            at = walk(path, at, step, cells[node, 0], cells[node, 1])
            continue
        # A shortcut from a up to b that bypasses x. Going up, it is a down to x, x up to b; going down, b down to x, x up to a.
        stack[n, 0], stack[n, 1], stack[n, 2] = parts[edge, 1 + ascends], node, 1
        stack[n + 1, 0], stack[n + 1, 1], stack[n + 1, 2] = parts[edge, 2 - ascends], parts[edge, 0], 0
        n += 2
    return at


@kernel
def route(
    subgoals: SubgoalMap, graph: UpwardGraph, memory: QueryMemory, row: int, col: int, goal_row: int, goal_col: int
) -> tuple[Ints, int, int]:
    """Return a shortest path, int32[K, 2], empty if there is none, its number of diagonal moves, and the nodes expanded.

    Subgoals are numbered as the nodes of the hierarchy. Both ends are free cells.
    """
    lattice, number, cells = subgoals.lattice, subgoals.number, graph.cells
    label, came, seeds = memory.label, memory.came, memory.seeds
    if is_clear(lattice, row, col, goal_row, goal_col):
        a, b = abs(row - goal_row), abs(col - goal_col)
        path = np.empty((max(a, b) + 1, 2), np.int32)
        path[0, 0], path[0, 1] = row, col
        walk(path, 0, 1, goal_row, goal_col)
        return path, min(a, b), 0
    memory.state[0] += 1
    ends, size = np.array([[row, col], [goal_row, goal_col]]), np.empty(2, np.int64)
    for side in range(2):
        size[side] = 0
        x = number[(ends[side, 0] + 1) * (lattice.width + 2) + ends[side, 1] + 1]
        if x >= 0:
            seeds[side, 0, 0], seeds[side, 0, 1], size[side] = x, 0, 1
        else:
            size[side] = seen(subgoals, ends[side, 0], ends[side, 1], seeds[side])
    cost, top, expanded = meet(graph, memory, size, ends)
    if top < 0:
        return np.empty((0, 2), np.int32), 0, expanded
    path = np.empty((count_moves(cost) + 1, 2), np.int32)
    middle = count_moves(label[0, top, 0])  # start at the meeting node and go to both ends
    for side in range(2):
        path[middle, 0], path[middle, 1] = cells[top, 0], cells[top, 1]
        x, at, step = top, middle, 2 * side - 1
        while came[side, x, 0] >= 0:
            below = came[side, x, 1]
            at = unpack(graph, memory.stack, came[side, x, 0], below, path, at, step)
            x = below
        walk(path, at, step, ends[side, 0], ends[side, 1])
    return path, diagonals(cost), expanded


@kernel
def route_all(
    subgoals: SubgoalMap, graph: UpwardGraph, memory: QueryMemory,
    ends: Longs, query: int, path_start: Longs, paths: Ints, diagonal: Longs,
) -> int:  # fmt: skip
    """Solve the queries `ends`, int64[Q, 4], from number `query` on; return the next, less than Q if `paths` is too short.

    The path of query i is `paths[path_start[i]:path_start[i + 1]]`, with `diagonal[i]` diagonal moves, -1 without a path.
    The other parameters are those of `route`.
    """
    while query < len(ends):
        row, col, goal_row, goal_col = ends[query, 0], ends[query, 1], ends[query, 2], ends[query, 3]
        path, count, _ = route(subgoals, graph, memory, row, col, goal_row, goal_col)
        path_start[query + 1] = path_start[query] + len(path)
        if path_start[query + 1] > len(paths):
            break
        paths[path_start[query] : path_start[query + 1]] = path
        diagonal[query] = count if len(path) > 0 else -1
        query += 1
    return query
