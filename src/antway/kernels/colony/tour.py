"""Cities: the distances of TSPLIB, the length of a tour, candidate edges."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel

MATRIX, EUC_2D, CEIL_2D, ATT, EUCLID = range(5)  # kinds of distances, see `Metric`

Index = int | np.integer[Any]
Ids = NDArray[np.uint32]  # unsigned, so that an index needs no test for negative values


class Metric(NamedTuple):
    """The distances among n cities."""

    kind: int  # how they are defined: MATRIX, EUC_2D, CEIL_2D, ATT (rounded as in TSPLIB) or EUCLID (not rounded)
    xy: Floats  # [n, 2] places; unused with a matrix
    matrix: Floats  # [n, n] distances, or empty


class Cities(NamedTuple):
    """n cities and the candidate edges to the k nearest of each."""

    metric: Metric
    near: Ids  # [n, k] nearest other cities, nearest first
    gap: Floats  # [n, k] the distances to them
    least: float  # differences in length up to this may be rounding errors
    back: NDArray[np.int32]  # [n, k] column of i in near[near[i, c]], the same edge from its other end, or -1


@bare_kernel
def distance(metric: Metric, i: Index, j: Index) -> float:
    """Return the distance between cities i and j by the definitions of TSPLIB."""
    kind, xy, matrix = metric.kind, metric.xy, metric.matrix
    if kind == MATRIX:
        return float(matrix[i, j])
    dx, dy = xy[i, 0] - xy[j, 0], xy[i, 1] - xy[j, 1]
    square = dx * dx + dy * dy
    if kind == EUC_2D:
        return math.floor(math.sqrt(square) + 0.5)
    if kind == CEIL_2D:
        return math.ceil(math.sqrt(square))
    if kind == ATT:
        return math.ceil(math.sqrt(square / 10.0))
    return math.sqrt(square)


@bare_kernel
def length(metric: Metric, order: Ids) -> float:
    """Return the length of the closed tour `order`."""
    total = 0.0
    before = order[-1]
    for city in order:
        total += distance(metric, before, city)
        before = city
    return total


@kernel
def gaps(metric: Metric, near: Ids) -> Floats:
    """Return the distances of the candidate edges, float64[n, k]."""
    result = np.empty(near.shape)
    for i in range(near.shape[0]):
        for c in range(near.shape[1]):
            result[i, c] = distance(metric, i, near[i, c])
    return result


@bare_kernel
def column(near: Ids, i: Index, j: Index) -> int:
    """Return the column of j among the candidates of i, or -1."""
    for c in range(near.shape[1]):
        if near[i, c] == j:
            return c
    return -1


@kernel
def backs(near: Ids) -> NDArray[np.int32]:
    """Return the column of each candidate edge at its other end, or -1."""
    result = np.empty(near.shape, dtype=np.int32)
    for i in range(near.shape[0]):
        for c in range(near.shape[1]):
            result[i, c] = column(near, near[i, c], i)
    return result
