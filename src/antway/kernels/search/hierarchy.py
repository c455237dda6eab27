"""A contraction hierarchy: nodes are removed from a graph one by one, the least important first, and shortcuts replace shortest
paths through them. A query then searches only upwards from both ends, and both searches meet at the top of a shortest path
(Geisberger, Sanders, Schultes and Delling, Contraction hierarchies, WEA 2008).

Each node has a linked list of edges that starts at `first`. An edge is a row of `edges`, int32[M, 5]: the next in the list,
the node it leads to, and for a shortcut the bypassed node and the edges from that node to its start and its end, else -1.
`weight` int64[M] is its cost. Of two nodes the one that was removed first keeps the edge.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, kernel

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

RUNNING, DONE, FULL = 0, 1, 2
NEXT, TO, OUT, BEFORE, AFTER = range(5)
USED, FREE, OPEN, RANKED, ROUND, LINKED = range(6)
"""Indices of `state`: edges ever used, first recycled edge, nodes in the heap, nodes removed, number of the last local search,
nodes whose edges have been made."""
MOST_SETTLED = 24  # limit of nodes settled in a local search; an unnecessary shortcut does no harm
NOWHERE = 1 << 62


@bare_kernel
def join(
    first: Ints, edges: Ints, weight: Longs, state: Longs, a: int, b: int, cost: int, out: int, before: int, after: int
) -> None:
    """Add an edge from a to b at `cost`, or lower the cost of the existing one."""
    e = first[a]
    while e >= 0 and edges[e, TO] != b:
        e = edges[e, NEXT]
    if e < 0:
        e = state[FREE]
        if e >= 0:
            state[FREE] = edges[e, NEXT]
        else:
            e = state[USED]
            state[USED] += 1
        edges[e, NEXT], edges[e, TO] = first[a], b
        first[a] = e
    elif weight[e] <= cost:
        return
    edges[e, OUT], edges[e, BEFORE], edges[e, AFTER] = out, before, after
    weight[e] = cost


@bare_kernel
def leave(first: Ints, edges: Ints, state: Longs, a: int, b: int) -> None:
    """Remove the edge from a to b."""
    e, last = first[a], -1
    while edges[e, TO] != b:
        last, e = e, edges[e, NEXT]
    if last < 0:
        first[a] = edges[e, NEXT]
    else:
        edges[last, NEXT] = edges[e, NEXT]
    edges[e, NEXT] = state[FREE]
    state[FREE] = e


@bare_kernel
def measure(
    first: Ints, edges: Ints, weight: Longs, state: Longs, local: Longs, heap: Longs, source: int, avoid: int, within: int
) -> int:
    """Write distances from `source` that avoid `avoid` to `local`, int64[N, 2], distance and round; return the work."""
    state[ROUND] += 1
    now = state[ROUND]
    local[source, 0], local[source, 1] = 0, now
    size, settled = push(heap, 0, 0, source), 0
    work = 0
    while size > 0 and settled < MOST_SETTLED:
        g, x = heap[0, 0], heap[0, 1]
        if g > within:
            break
        size = pop(heap, size)
        if local[x, 0] < g:
            continue
        settled += 1
        e = first[x]
        while e >= 0:
            to, g_to = edges[e, TO], g + weight[e]
            if to != avoid and g_to <= within and (local[to, 1] != now or g_to < local[to, 0]):
                local[to, 0], local[to, 1] = g_to, now
                size = push(heap, size, g_to, to)
            work += 1
            e = edges[e, NEXT]
    return work


@bare_kernel
def bypass(
    first: Ints, edges: Ints, weight: Longs, state: Longs, local: Longs, heap: Longs, ends: Ints, x: int, really: bool
) -> tuple[int, int, int]:
    """Count the shortcuts needed to remove node x, and add them if `really`; return their number, x's degree, and the work."""
    n, needed, work = 0, 0, 0
    e = first[x]
    while e >= 0:
        ends[n] = e
        n += 1
        e = edges[e, NEXT]
    for i in range(n - 1):
        a, to_a = edges[ends[i], TO], weight[ends[i]]
        farthest = 0
        for j in range(i + 1, n):
            farthest = max(farthest, weight[ends[j]])
        work += measure(first, edges, weight, state, local, heap, a, x, to_a + farthest)
        for j in range(i + 1, n):
            b, cost = edges[ends[j], TO], to_a + weight[ends[j]]
            if local[b, 1] != state[ROUND] or local[b, 0] > cost:
                needed += 1
                if really:
                    join(first, edges, weight, state, a, b, cost, x, ends[i], ends[j])
                    join(first, edges, weight, state, b, a, cost, x, ends[j], ends[i])
    return needed, n, work + n


@bare_kernel
def contract(
    first: Ints,
    edges: Ints,
    weight: Longs,
    state: Longs,
    local: Longs,
    heap: Longs,
    ends: Ints,
    order: Longs,
    level: Ints,
    rank: Ints,
    steps: int,
) -> int:
    """Remove nodes in the order of their importance for about `steps` steps; return RUNNING, DONE or FULL.

    Parameters
    ----------
    first, edges, weight, state
        The graph, as above. FULL means that `edges` and `weight` must be longer.
    local, heap, ends
        Scratch for local searches: int64[N, 2], zero at first; int64[M, 2] for M edges; int32[N].
    order : int64[N, 2]
        A heap of the remaining nodes: priority (least first) and node. All priorities are zero at first; the priority of a
        node is computed whenever it reaches the top.
    level, rank : int32[N]
        The depth of nested shortcuts below a node, zero at first; the order in which nodes were removed.
    """
    while steps > 0:
        if state[RANKED] == rank.size:
            return DONE
        x = order[0, 1]
        needed, n, work = bypass(first, edges, weight, state, local, heap, ends, x, False)
        steps -= work + 1
        turn = 1000 * level[x] + 2000 * needed // max(n, 1) + needed
        state[OPEN] = pop(order, state[OPEN])
        if state[OPEN] > 0 and turn > order[0, 0]:
            state[OPEN] = push(order, state[OPEN], turn, x)
            continue
        if state[USED] + 2 * needed > edges.shape[0]:
            state[OPEN] = push(order, state[OPEN], -1, x)
            return FULL
        bypass(first, edges, weight, state, local, heap, ends, x, True)
        for i in range(n):
            other = edges[ends[i], TO]
            leave(first, edges, state, other, x)
            level[other] = max(level[other], level[x] + 1)
        rank[x] = state[RANKED]
        state[RANKED] += 1
    return RUNNING


@kernel
def upward_graph(first: Ints, edges: Ints, weight: Longs, rank: Ints) -> tuple[Longs, Longs, Ints]:
    """Return the edges of the hierarchy, grouped by node; nodes are numbered by `rank`.

    They are `row_start`, `up` and `parts` of `ch_query.UpwardGraph`.
    """
    node = np.argsort(rank)
    place = np.full(edges.shape[0] + 1, -1, np.int32)  # the last entry is for -1
    row_start = np.zeros(rank.size + 1, np.int64)
    n = 0
    for x in range(rank.size):
        e = first[node[x]]
        while e >= 0:
            place[e] = n
            n += 1
            e = edges[e, NEXT]
        row_start[x + 1] = n
    up, parts = np.empty((n, 2), np.int64), np.full((n, 3), -1, np.int32)
    for e in range(edges.shape[0]):
        k = place[e]
        if k >= 0:
            up[k, 0], up[k, 1] = rank[edges[e, TO]], weight[e]
            if edges[e, OUT] >= 0:
                parts[k, 0] = rank[edges[e, OUT]]
                parts[k, 1], parts[k, 2] = place[edges[e, BEFORE]], place[edges[e, AFTER]]
    return row_start, up, parts
