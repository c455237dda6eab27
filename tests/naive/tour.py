"""Tours by the definitions: TSPLIB's distances in Python's own arithmetic, all permutations, all 2-opt and Or-opt moves."""

from __future__ import annotations

import itertools
import math


def distance(metric, a, b):
    """Distance of two places by its name in TSPLIB; EUCLID is not rounded."""
    square = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2
    if metric == "EUC_2D":
        return float(int(math.sqrt(square) + 0.5))
    if metric == "CEIL_2D":
        return float(math.ceil(math.sqrt(square)))
    if metric == "ATT":
        r = math.sqrt(square / 10.0)
        t = int(r + 0.5)
        return float(t + 1 if t < r else t)
    return math.sqrt(square)


def table(metric, xy):
    """All distances, as lists."""
    return [[distance(metric, a, b) for b in xy] for a in xy]


def length(matrix, order):
    """Length of a closed tour."""
    return sum(matrix[order[i - 1]][order[i]] for i in range(len(order)))


def shortest(matrix):
    """Length of the shortest tour, by trying all."""
    return min(length(matrix, (0, *rest)) for rest in itertools.permutations(range(1, len(matrix))))


def two_opt_moves(order):
    """All tours that differ from `order` by the reversal of a part."""
    n = len(order)
    for i in range(n - 1):
        for j in range(i + 2, n + 1):
            yield order[:i] + order[i:j][::-1] + order[j:]


def or_opt_moves(order, longest=3):
    """All tours that differ by a part of up to three cities put elsewhere, either way round."""
    n = len(order)
    for size in range(1, longest + 1):
        for i in range(n):
            turned = order[i:] + order[:i]
            part, rest = turned[:size], turned[size:]
            for j in range(1, len(rest)):
                yield rest[:j] + part + rest[j:]
                yield rest[:j] + part[::-1] + rest[j:]


def candidates_by_quadrant(gaps, offsets, k):
    """The k candidates of a city from (gap, offset east, offset north) to all others, as a set of their numbers.

    The k // 5 nearest of each quadrant among the 12 k nearest, then the nearest of the rest.
    """
    nearest = sorted(range(len(gaps)), key=lambda j: gaps[j])[: 12 * k]
    quadrants = {0: [], 1: [], 2: [], 3: []}
    for j in nearest:
        x, y = offsets[j]
        number = 0 if x > 0 and y >= 0 else 1 if x <= 0 and y > 0 else 2 if x < 0 and y <= 0 else 3
        quadrants[number].append(j)
    taken = [j for members in quadrants.values() for j in members[: k // 5]]
    return set(taken + [j for j in nearest if j not in taken][: k - len(taken)])
