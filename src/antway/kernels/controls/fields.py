"""The map as fields that a rollout looks up: the distance to walls, and the time to the goal continued into them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel

_SIDES = 3.0  # cells; next to one wall cell, times differ by no more than it takes to go round it


@kernel
def wall_distance(blocked: NDArray[np.bool_], resolution: float, factor: int) -> NDArray[np.float32]:
    """Exact distance in m from each node of a lattice to the nearest blocked cell, a closed square, or edge of the map.

    The lattice has `factor` nodes to a cell's edge, its first at the map's corner. The nearest point of a square to a node is
    a node itself, so that the distance transform over nodes is exact (Felzenszwalb and Huttenlocher, Theory of Computing 2012).
    """
    rows, cols = blocked.shape[0] * factor + 1, blocked.shape[1] * factor + 1
    far = float(rows + cols) ** 2
    square = np.full((rows, cols), far)
    square[0, :] = square[-1, :] = 0.0
    square[:, 0] = square[:, -1] = 0.0
    for i in range(blocked.shape[0]):
        for j in range(blocked.shape[1]):
            if blocked[i, j]:
                square[i * factor : (i + 1) * factor + 1, j * factor : (j + 1) * factor + 1] = 0.0
    n = max(rows, cols)
    at, value = np.empty(n, np.int64), np.empty(n)
    edge = np.empty(n + 1)
    for i in range(rows):
        _envelope(square[i], at, value, edge)
    for j in range(cols):
        _envelope(square[:, j], at, value, edge)
    return (np.sqrt(square) * (resolution / factor)).astype(np.float32)


@kernel
def _envelope(line: NDArray[np.float64], at: NDArray[np.int64], value: NDArray[np.float64], edge: NDArray[np.float64]) -> None:
    """Replace f(q) by min over p of (p - q)^2 + f(p): the lower envelope of parabolas."""
    n = len(line)
    k = 0
    at[0], edge[0], edge[1] = 0, -np.inf, np.inf
    for q in range(1, n):
        value[q] = 0.0
        while True:
            p = at[k]
            cut = ((line[q] + q * q) - (line[p] + p * p)) / (2.0 * (q - p))
            if cut > edge[k]:
                break
            k -= 1
        k += 1
        at[k], edge[k], edge[k + 1] = q, cut, np.inf
    k = 0
    for q in range(n):
        value[q] = line[q]
    for q in range(n):
        while edge[k + 1] < q:
            k += 1
        line[q] = (q - at[k]) ** 2 + value[at[k]]


@kernel
def beyond_walls(field: NDArray[np.float64], step: float, layers: int) -> NDArray[np.float32]:
    """Continue a field of times, infinite in walls, into them, `step` s a cell, so that it can be interpolated near them.

    Where a wall is so thin that its two sides meet, and are far apart in time, it goes on from the later side: else the field
    would lead through the wall, and a robot would stand before it for ever.
    """
    rows, cols = field.shape
    out = field.copy()
    top = 0.0
    for i in range(rows):
        for j in range(cols):
            if math.isfinite(field[i, j]):
                top = max(top, field[i, j])
    for _ in range(layers):
        before = out.copy()
        for i in range(rows):
            for j in range(cols):
                if math.isinf(before[i, j]):
                    low, high = math.inf, -math.inf
                    for di in range(-1, 2):
                        for dj in range(-1, 2):
                            r, c = i + di, j + dj
                            if 0 <= r < rows and 0 <= c < cols and math.isfinite(before[r, c]):
                                low = min(low, before[r, c] + step * math.hypot(di, dj))
                                high = max(high, before[r, c])
                    out[i, j] = low if high <= low + _SIDES * step else high + step
    for i in range(rows):
        for j in range(cols):
            if math.isinf(out[i, j]):
                out[i, j] = top + layers * step
    return out.astype(np.float32)
