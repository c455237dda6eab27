"""Twins of kernels/colony/held_karp.py: the best order by trying all, and the cheapest 1-tree by trying all edges in turn."""

from __future__ import annotations

import itertools

import numpy as np


def best_cost(cost: np.ndarray, end: int | None) -> float:
    """The cost of the best order of all nodes from 0 to `end` (0: back to 0; None: anywhere)."""
    n = len(cost)
    inner = [i for i in range(1, n) if i != end]
    last = [] if end is None or (end == 0 and n == 1) else [end]
    return min(sum(cost[a, b] for a, b in itertools.pairwise([0, *order, *last])) for order in itertools.permutations(inner))


def one_tree(cost: np.ndarray, price: np.ndarray) -> float:
    """The cheapest spanning tree of nodes 1, 2, ... by Kruskal, and the two cheapest edges of node 0."""
    n = len(cost)
    dear = cost + price[:, None] + price
    part = list(range(n))
    total = 0.0
    edges = [(dear[i, j], i, j) for i in range(1, n) for j in range(i + 1, n)]
    for _, i, j in sorted(edges):
        if part[i] != part[j]:
            total += dear[i, j]
            part = [part[j] if p == part[i] else p for p in part]
    return total + float(np.sort(dear[0, 1:])[:2].sum())
