"""A contraction hierarchy: nodes are removed from a graph one by one, the least important first, and shortcuts replace shortest
paths through them. A query then searches only upwards from both ends, and both searches meet at the top of a shortest path
(Geisberger, Sanders, Schultes and Delling, Contraction hierarchies, WEA 2008).

Each node has a linked list of edges. Of two nodes the one that was removed first keeps the edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, kernel

Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

RUNNING, DONE, FULL = 0, 1, 2
NEXT, TO, BYPASSED, BEFORE, AFTER = range(5)  # columns of `edges`
# Indices of `state`: edges ever used, first recycled edge, nodes in the heap, nodes removed, number of the last witness search,
# nodes whose edges have been made.
USED, FREE, OPEN, RANKED, SEARCH, LINKED = range(6)
MOST_SETTLED = 24  # limit of nodes settled in a witness search; an unnecessary shortcut does no harm
NOWHERE = 1 << 62  # cost where there is no path


class Memory(NamedTuple):
    """A graph of N nodes, from which nodes are being removed."""

    first: Ints  # [N]; first edge of each node, or -1
    edges: Ints  # [M, 5]; next edge, node it leads to; of a shortcut the bypassed node and its edges to both ends, else -1
    weight: Longs  # [M]; cost of each edge
    order: Longs  # [N, 2]; heap of the remaining nodes: priority (least first, 0 at first) and node
    level: Ints  # [N]; depth of nested shortcuts below a node, 0 at first
    rank: Ints  # [N]; order in which nodes were removed
    local: Longs  # [N, 2]; distance of each node in a witness search, and the number of that search; 0 at first
    heap: Longs  # [M, 2]; scratch
    ends: Ints  # [N]; scratch
    state: Longs  # [6]


@bare_kernel
def add_edge(m: Memory, a: int, b: int, cost: int, bypassed: int, before: int, after: int) -> None:
    """Add an edge from a to b at `cost`, or lower the cost of the existing one."""
    e = m.first[a]
    while e >= 0 and m.edges[e, TO] != b:
        e = m.edges[e, NEXT]
    if e < 0:
        e = m.state[FREE]
        if e >= 0:
            m.state[FREE] = m.edges[e, NEXT]
        else:
            e = m.state[USED]
            m.state[USED] += 1
        m.edges[e, NEXT], m.edges[e, TO] = m.first[a], b
        m.first[a] = e
    elif m.weight[e] <= cost:
        return
    m.edges[e, BYPASSED], m.edges[e, BEFORE], m.edges[e, AFTER] = bypassed, before, after
    m.weight[e] = cost


@bare_kernel
def remove_edge(m: Memory, a: int, b: int) -> None:
    """Remove the edge from a to b."""
    e, last = m.first[a], -1
    while m.edges[e, TO] != b:
        last, e = e, m.edges[e, NEXT]
    if last < 0:
        m.first[a] = m.edges[e, NEXT]
    else:
        m.edges[last, NEXT] = m.edges[e, NEXT]
    m.edges[e, NEXT] = m.state[FREE]
    m.state[FREE] = e


@bare_kernel
def witness_search(m: Memory, source: int, avoid: int, within: int) -> int:
    """Write distances from `source` up to `within`, of paths that avoid the node `avoid`, to `local`; return the work."""
    m.state[SEARCH] += 1
    now = m.state[SEARCH]
    m.local[source, 0], m.local[source, 1] = 0, now
    size, settled = push(m.heap, 0, 0, source), 0
    work = 0
    while size > 0 and settled < MOST_SETTLED:
        g, x = m.heap[0, 0], m.heap[0, 1]
        if g > within:
            break
        size = pop(m.heap, size)
        if m.local[x, 0] < g:
            continue
        settled += 1
        e = m.first[x]
        while e >= 0:
            to, g_to = m.edges[e, TO], g + m.weight[e]
            if to != avoid and g_to <= within and (m.local[to, 1] != now or g_to < m.local[to, 0]):
                m.local[to, 0], m.local[to, 1] = g_to, now
                size = push(m.heap, size, g_to, to)
            work += 1
            e = m.edges[e, NEXT]
    return work


@bare_kernel
def shortcuts(m: Memory, x: int, add: bool) -> tuple[int, int, int]:
    """Count the shortcuts needed to remove node x, and add them if `add`; return their number, x's degree, and the work."""
    n, needed, work = 0, 0, 0
    e = m.first[x]
    while e >= 0:
        m.ends[n] = e
        n += 1
        e = m.edges[e, NEXT]
    for i in range(n - 1):
        a, to_a = m.edges[m.ends[i], TO], m.weight[m.ends[i]]
        farthest = 0
        for j in range(i + 1, n):
            farthest = max(farthest, m.weight[m.ends[j]])
        work += witness_search(m, a, x, to_a + farthest)
        for j in range(i + 1, n):
            b, cost = m.edges[m.ends[j], TO], to_a + m.weight[m.ends[j]]
            if m.local[b, 1] != m.state[SEARCH] or m.local[b, 0] > cost:
                needed += 1
                if add:
                    add_edge(m, a, b, cost, x, m.ends[i], m.ends[j])
                    add_edge(m, b, a, cost, x, m.ends[j], m.ends[i])
    return needed, n, work + n


@bare_kernel
def contract(m: Memory, steps: int) -> int:
    """Remove nodes in the order of their importance for about `steps` steps; return RUNNING, DONE or FULL.

    FULL means that `edges`, `weight` and `heap` must be longer. The priority of a node is computed whenever it reaches the top.
    """
    while steps > 0:
        if m.state[RANKED] == m.rank.size:
            return DONE
        x = m.order[0, 1]
        needed, n, work = shortcuts(m, x, False)
        steps -= work + 1
        priority = 1000 * m.level[x] + 2000 * needed // max(n, 1) + needed
        m.state[OPEN] = pop(m.order, m.state[OPEN])
        if m.state[OPEN] > 0 and priority > m.order[0, 0]:
            m.state[OPEN] = push(m.order, m.state[OPEN], priority, x)
            continue
        if m.state[USED] + n * (n - 1) > m.edges.shape[0]:  # more may be needed than counted: edges that are added hide paths
            m.state[OPEN] = push(m.order, m.state[OPEN], -1, x)
            return FULL
        shortcuts(m, x, True)
        for i in range(n):
            other = m.edges[m.ends[i], TO]
            remove_edge(m, other, x)
            m.level[other] = max(m.level[other], m.level[x] + 1)
        m.rank[x] = m.state[RANKED]
        m.state[RANKED] += 1
    return RUNNING


@kernel
def upward_graph(m: Memory) -> tuple[Longs, Longs, Ints]:
    """Return `row_start`, `up` and `parts` of `hierarchy_query.UpwardGraph`, whose nodes are numbered by `rank`."""
    node = np.argsort(m.rank)
    place = np.full(m.edges.shape[0] + 1, -1, np.int32)  # the last entry is for -1
    row_start = np.zeros(m.rank.size + 1, np.int64)
    n = 0
    for x in range(m.rank.size):
        e = m.first[node[x]]
        while e >= 0:
            place[e] = n
            n += 1
            e = m.edges[e, NEXT]
        row_start[x + 1] = n
    up, parts = np.empty((n, 2), np.int64), np.full((n, 3), -1, np.int32)
    for e in range(m.edges.shape[0]):
        k = place[e]
        if k >= 0:
            up[k, 0], up[k, 1] = m.rank[m.edges[e, TO]], m.weight[e]
            if m.edges[e, BYPASSED] >= 0:
                parts[k, 0] = m.rank[m.edges[e, BYPASSED]]
                parts[k, 1], parts[k, 2] = place[m.edges[e, BEFORE]], place[m.edges[e, AFTER]]
    return row_start, up, parts
