"""Orders with time windows by the definitions: all permutations, and dynamic programming over sets of stops."""

from __future__ import annotations

import itertools
import math


def drive(matrix, windows, order):
    """(travel time, end, lateness) of the path `order`, from when the first window opens."""
    now, travelled, late = windows[order[0]][0], 0.0, 0.0
    for here, there in itertools.pairwise(order):
        travelled += matrix[here][there]
        now = max(now + matrix[here][there], windows[there][0])
        late += max(0.0, now - windows[there][1])
    return travelled, now, late


def feasible_orders(matrix, windows):
    """All closed tours from 0 that miss no window, as paths that end at 0 once more."""
    for rest in itertools.permutations(range(1, len(matrix))):
        order = (0, *rest, 0)
        if drive(matrix, windows, order)[2] == 0.0:
            yield order


def best(matrix, windows, makespan):
    """Least cost of a closed tour that misses no window, infinite if there is none."""
    return min((drive(matrix, windows, order)[makespan] for order in feasible_orders(matrix, windows)), default=math.inf)


def dynamic_programming(matrix, windows, makespan):
    """The same by Held and Karp's recursion, with all (time, cost) of a set and a last node of which none beats another."""
    n = len(matrix)
    layer = {(1, 0): [(windows[0][0], 0.0)]}
    for _ in range(n - 1):
        following = {}
        for (visited, last), labels in layer.items():
            for j in range(1, n):
                if visited >> j & 1:
                    continue
                for now, cost in labels:
                    then = max(now + matrix[last][j], windows[j][0])
                    if then <= windows[j][1]:
                        following.setdefault((visited | 1 << j, j), []).append((then, cost + matrix[last][j]))
        layer = {}
        for key, labels in following.items():
            kept, least = [], math.inf
            for now, cost in sorted(set(labels)):
                if cost < least:
                    kept.append((now, cost))
                    least = cost
            layer[key] = kept
    ends = []
    for (_, last), labels in layer.items():
        for now, cost in labels:
            back = max(now + matrix[last][0], windows[0][0])
            if back <= windows[0][1] and n > 1:
                ends.append(back if makespan else cost + matrix[last][0])
    return min(ends, default=math.inf)


def learned(tau, orders, convergence, evaporation):
    """(pheromone, convergence) after a cycle, from that before and the orders of the cycle, since the restart, and so far.

    Pheromone, in [0.001, 0.999], moves towards these orders: the three of them share 1 by how far the colony has converged.
    """
    of_cycle, since_restart, so_far = orders
    if convergence < 0.4:
        shares = [(of_cycle, 1.0)]
    elif convergence < 0.6:
        shares = [(of_cycle, 2 / 3), (since_restart, 1 / 3)]
    elif convergence < 0.8:
        shares = [(of_cycle, 1 / 3), (since_restart, 2 / 3)]
    else:
        shares = [(since_restart, 1 / 2), (so_far, 1 / 2)]
    tau = [[(1 - evaporation) * value for value in row] for row in tau]
    for order, share in shares:
        for i, j in itertools.pairwise(order):
            tau[i][j] += evaporation * share
    tau = [[min(max(value, 0.001), 0.999) for value in row] for row in tau]
    strength = [tau[i][j] for i, j in itertools.pairwise(since_restart)]
    mean = sum(strength) / len(strength)
    return ([[0.5] * len(tau)] * len(tau), 0.0) if mean > 0.97 else (tau, mean)


def tightened(time, far, opens, closes):
    """(windows, arcs that are left, pairs of which the first comes before the second) once no rule changes anything, or None.

    The path goes from the first to the last stop. None: some window is empty, or some stop comes before itself.
    """
    n, opens, closes = len(time), list(opens), list(closes)
    arcs = {(i, j) for i in range(n) for j in range(n) if i != j and time[i][j] < math.inf}
    first = {(0, j) for j in range(1, n)} | {(i, n - 1) for i in range(n - 1)}
    while True:
        before = list(opens), list(closes), len(arcs), len(first)
        first |= {(i, j) for i, j in itertools.permutations(range(n), 2) if opens[j] + far[j][i] > closes[i]}
        for k in range(n):
            first |= {(i, j) for i in range(n) for j in range(n) if {(i, k), (k, j)} <= first}
        if any(i == j for i, j in first):
            return None
        for i, j in sorted(arcs):
            there = max(opens[i] + time[i][j], opens[j])
            possible = (j, i) not in first and there <= closes[j] and j > 0 and i < n - 1
            for k in set(range(n)) - {i, j}:
                here = opens[k] + far[k][i]
                sooner = (i, k) not in first and here <= closes[i] and max(here, opens[i]) + time[i][j] <= closes[j]
                later = (k, j) not in first and there + far[j][k] <= closes[k]
                possible = possible and (sooner or later)
            if not possible:
                arcs.remove((i, j))
        for j in range(n):
            if j > 0:
                opens[j] = max([opens[j], *(opens[i] + far[i][j] for i in range(n) if (i, j) in first)])
                opens[j] = max(opens[j], min((opens[i] + time[i][j] for i in range(n) if (i, j) in arcs), default=math.inf))
                arrival = max((closes[i] + time[i][j] for i in range(n) if (i, j) in arcs), default=-math.inf)
                closes[j] = min(closes[j], max(opens[j], arrival))
            if j < n - 1:
                closes[j] = min([closes[j], *(closes[i] - far[j][i] for i in range(n) if (j, i) in first)])
                closes[j] = min(closes[j], max((closes[i] - time[j][i] for i in range(n) if (j, i) in arcs), default=-math.inf))
            if opens[j] > closes[j]:
                return None
        if before == (opens, closes, len(arcs), len(first)):
            return [*zip(opens, closes)], arcs, first
