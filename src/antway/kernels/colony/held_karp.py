"""A lower bound of tours, and the best tour of few stops: the bound and the dynamic program of Held and Karp.

Every tour is a 1-tree: a spanning tree of all nodes but one, and two edges to that one. A tour pays the price of each node
twice. Prices make nodes with too many edges expensive and nodes with too few cheap. For any prices, the cheapest 1-tree minus
twice the prices is a lower bound (Held and Karp, The traveling-salesman problem and minimum spanning trees, 1970).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import bare_kernel, kernel


@bare_kernel
def one_tree(cost: Floats, price: Floats, near: Floats, link: Ints, degree: Ints) -> float:
    """Return the cost of the cheapest 1-tree under `price`, whose tree leaves node 0 out, and write the degree of each node.

    This is Prim's algorithm in n^2 steps. `near`, float64[n], and `link`, int64[n], are scratch; `degree` is int64[n].
    """
    n = len(cost)
    degree[:] = 0
    total = 0.0
    for i in range(2, n):
        near[i], link[i] = cost[1, i] + price[1] + price[i], 1
    near[1] = -1.0
    link[1] = -1
    for _ in range(n - 2):
        best, node = np.inf, -1
        for i in range(2, n):
            if link[i] >= 0 and near[i] < best:
                best, node = near[i], i
        total += best
        degree[node] += 1
        degree[link[node]] += 1
        link[node] = -1
        for i in range(2, n):
            if link[i] >= 0:
                longer = cost[node, i] + price[node] + price[i]
                if longer < near[i]:
                    near[i], link[i] = longer, node
    return total + _two_edges(cost, price, degree)


@bare_kernel
def _two_edges(cost: Floats, price: Floats, degree: Ints) -> float:
    """Return the cost of the two cheapest edges of node 0 under `price`, and count them in the degrees."""
    first, second, one, two = np.inf, np.inf, -1, -1
    for i in range(1, len(cost)):
        away = cost[0, i] + price[0] + price[i]
        if away < first:
            second, two, first, one = first, one, away, i
        elif away < second:
            second, two = away, i
    degree[0] = 2
    degree[one] += 1
    degree[two] += 1
    return first + second


@kernel
def bound(cost: Floats, tour: float, rounds: int) -> float:
    """Return a lower bound on closed tours over the symmetric `cost`, float64[n, n] with n >= 3, by subgradients.

    `tour` is the cost of any tour, which determines the length of the first step (Volgenant and Jonker 1982).
    """
    n = len(cost)
    price, last, degree = np.zeros(n), np.zeros(n), np.zeros(n, np.int64)
    near, link = np.empty(n), np.empty(n, np.int64)
    best = -np.inf
    step_0 = 0.0
    for k in range(rounds):
        found = one_tree(cost, price, near, link, degree)
        if k == 0:
            step_0 = max(1e-3 * tour, 0.5 * (tour - found), 1e-12) / n
        for i in range(n):
            found -= 2.0 * price[i]
        best = max(best, found)
        is_tour = True
        for i in range(n):
            is_tour &= degree[i] == 2
        if is_tour:
            break
        step = step_0 * (1.0 - k / rounds) ** 2
        for i in range(n):
            slope = degree[i] - 2.0
            price[i] += step * (0.7 * slope + 0.3 * last[i])
            last[i] = slope
    return best


@kernel
def best_of_few(cost: Floats, end: int) -> NDArray[np.int32]:
    """Return the cheapest order of all n <= 14 nodes from node 0 to `end` (0: back to 0; -1: anywhere), by dynamic programming.

    `cost`, float64[n, n], is finite and may be asymmetric. The cost of a closed tour includes the last leg; the order omits the
    second 0.
    """
    m = len(cost) - 1
    least = np.full((1 << m, m), np.inf)
    came = np.full((1 << m, m), -1, np.int8)
    for i in range(m):
        least[1 << i, i] = cost[0, i + 1]
    for seen in range(1, 1 << m):
        for i in range(m):
            here = least[seen, i]
            if here == np.inf or i == end - 1:  # nothing comes after the end
                continue
            for j in range(m):
                if not seen >> j & 1:
                    further = here + cost[i + 1, j + 1]
                    if further < least[seen | 1 << j, j]:
                        least[seen | 1 << j, j] = further
                        came[seen | 1 << j, j] = i
    best, last = np.inf, 0
    for i in range(m):
        whole = least[(1 << m) - 1, i] + (cost[i + 1, 0] if end == 0 else 0.0)
        if whole < best:
            best, last = whole, i
    return _traced(came, last, 1)


@kernel
def earliest_of_few(away: Floats, windows: Floats, service: Floats, now: float) -> NDArray[np.int32]:
    """Return the order of m <= 14 stops with the least lateness and, if there is none, the earliest end.

    A label is the lateness so far and the time. Of two labels with the same stops and the same last stop, the less late one is
    kept, then the earlier one. Without lateness the earlier label dominates, so the earliest order without lateness is found
    if there is one. Otherwise the lateness found is only an approximation of the least.

    Of the travel times `away`, float64[m + 2, m + 2], all finite, row 0 is the robot's place, rows 1 to m are the stops, row
    m + 1 is the end. The robot departs at the time `now`. All times, with `windows`, float64[m, 2], and `service`, float64[m],
    are in s.
    """
    m = len(service)
    late, done = np.full((1 << m, m), np.inf), np.full((1 << m, m), np.inf)
    came = np.full((1 << m, m), -1, np.int8)
    for seen in range(1 << m):
        for i in range(m if seen else 1):
            if seen and not seen >> i & 1:
                continue
            lateness, leaves, row = (late[seen, i], done[seen, i], i + 1) if seen else (0.0, now, 0)
            for j in range(m):
                if seen >> j & 1:
                    continue
                starts = max(leaves + away[row, j + 1], windows[j, 0])
                later, ends = lateness + max(0.0, starts - windows[j, 1]), starts + service[j]
                both = seen | 1 << j
                if later < late[both, j] or (later == late[both, j] and ends < done[both, j]):
                    late[both, j], done[both, j], came[both, j] = later, ends, i if seen else -1
    seen, at, least, first = (1 << m) - 1, -1, np.inf, np.inf
    for i in range(m):
        home = done[seen, i] + away[i + 1, m + 1]
        if late[seen, i] < least or (late[seen, i] == least and home < first):
            least, first, at = late[seen, i], home, i
    return _traced(came, at, 0)


@kernel
def _traced(came: NDArray[np.int8], last: int, first: int) -> NDArray[np.int32]:
    """Return the order of all stops that ends with `last`; came[seen, i] is the stop before i among the bits `seen`.

    With `first` = 1 they are numbered from 1 on, and 0 comes before them.
    """
    m = came.shape[1]
    order, seen = np.zeros(first + m, np.int32), (1 << m) - 1
    for k in range(m - 1, -1, -1):
        order[first + k] = first + last
        last, seen = int(came[seen, last]), seen ^ (1 << last)
    return order
