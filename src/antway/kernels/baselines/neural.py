"""Activity over the cells of a map: shunting neurons (Yang, Meng), bounded relaxation (Glasius), and the ascending path.

A sweep updates the cells in place in one of four orders, so that activity crosses a map in a few sweeps. The stationary state
does not depend on the order. `kind` is `FREE`, `CLOSED` or `TARGET` for each cell. All arrays have a rim of closed cells around
the map, which are never visited.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import inner_kernel, kernel

FREE, CLOSED, TARGET = 0, 1, 2
DIAGONAL = 1.0 / math.sqrt(2.0)


@kernel
def stamp(kind: NDArray[np.uint8], frame: Floats, xy: Floats, contact_radius: Floats) -> None:
    """Close the free cells whose centres are nearer than `contact_radius[k]` to `xy[k]`, float64[K] and float64[K, 2], m.

    `frame` is x and y of the corner of the map, rim included, and the edge of a cell, float64[3], m.
    """
    size = frame[2]
    for k in range(len(contact_radius)):
        row, col, span = (xy[k, 1] - frame[1]) / size - 0.5, (xy[k, 0] - frame[0]) / size - 0.5, contact_radius[k] / size
        for i in range(max(math.ceil(row - span), 0), min(math.floor(row + span), kind.shape[0] - 1) + 1):
            for j in range(max(math.ceil(col - span), 0), min(math.floor(col + span), kind.shape[1] - 1) + 1):
                if kind[i, j] == FREE and math.hypot(i - row, j - col) < span:
                    kind[i, j] = CLOSED


@kernel
def shunt(
    x: Floats,
    kind: NDArray[np.uint8],
    decay: float,
    upper: float,
    lower: float,
    mu: float,
    drive: float,
    span: float,
    order: int,
) -> float:
    """Let `span` s pass for each neuron: dx/dt = -A x + (B - x)(max(I, 0) + sum_j mu [x_j]+ / d_j) - (D + x) max(-I, 0).

    With constant neighbours the equation is linear, and its exact solution is an exponential; with an infinite `span` each
    neuron gets its stationary value. `decay`, `upper`, `lower`, `mu` and `drive` are A, B, D, mu and E of the papers. The input
    I is `drive` at targets, -`drive` at closed cells, else 0. The activities x stay within [-D, B]; `order`, 0 to 3, is the
    direction in which rows and columns are visited. Returns the largest change relative to the activity before.
    """
    rows, cols = x.shape
    change = 0.0
    for i in range(1, rows - 1):
        row = i if order & 1 == 0 else rows - 1 - i
        for j in range(1, cols - 1):
            col = j if order & 2 == 0 else cols - 1 - j
            excited = mu * _around(x, kind, row, col, DIAGONAL) + (drive if kind[row, col] == TARGET else 0.0)
            inhibited = drive if kind[row, col] == CLOSED else 0.0
            rate = decay + excited + inhibited
            rest = (upper * excited - lower * inhibited) / rate
            new = rest + (x[row, col] - rest) * math.exp(-rate * span)
            change = max(change, _set(x, row, col, new))
    return change


@kernel
def relax(x: Floats, kind: NDArray[np.uint8], slope: float, diagonal: float, order: int) -> float:
    """Set each cell to `slope` times its neighbours' sum, diagonal ones `diagonal` times; targets to 1, closed cells to 0.

    The parameters are those of `shunt`; 0 < slope < 1 / (4 + 4 diagonal) keeps activity within [0, 1].
    """
    rows, cols = x.shape
    change = 0.0
    for i in range(1, rows - 1):
        row = i if order & 1 == 0 else rows - 1 - i
        for j in range(1, cols - 1):
            col = j if order & 2 == 0 else cols - 1 - j
            if kind[row, col] == TARGET:
                new = 1.0
            else:
                new = 0.0 if kind[row, col] == CLOSED else slope * _around(x, kind, row, col, diagonal)
            change = max(change, _set(x, row, col, new))
    return change


@inner_kernel
def _set(x: Floats, row: int, col: int, new: float) -> float:
    """Set one activity, and return its change relative to the larger of both values."""
    old: float = x[row, col]
    if new == old:
        return 0.0
    x[row, col] = new
    return abs(new - old) / max(abs(new), abs(old))


@kernel
def _around(x: Floats, kind: NDArray[np.uint8], row: int, col: int, weight: float) -> float:
    """Return the sum of the positive activities of the neighbours; diagonal ones count `weight` times, if `_linked`."""
    straight = max(x[row - 1, col], 0.0) + max(x[row, col - 1], 0.0) + max(x[row, col + 1], 0.0) + max(x[row + 1, col], 0.0)
    diagonal = 0.0
    for r in (row - 1, row + 1):
        for c in (col - 1, col + 1):
            if x[r, c] > 0.0 and _linked(kind, row, col, r, c):
                diagonal += x[r, c]
    return float(straight + weight * diagonal)


@kernel
def _linked(kind: NDArray[np.uint8], row: int, col: int, r: int, c: int) -> bool:
    """Tell whether a robot can go to a neighbour; diagonal moves must not touch a closed cell."""
    return not (kind[row, c] == CLOSED or kind[r, col] == CLOSED)


@kernel
def ascend(x: Floats, kind: NDArray[np.uint8], row: int, col: int, steps: int) -> Ints:
    """Go from cell to most active neighbour for at most `steps` steps, or until no neighbour is more active.

    Returns the cells after the first, int64[N, 2]; empty if no neighbour is active and more active than the cell.
    """
    path = np.empty((steps, 2), np.int64)
    for n in range(steps):
        best, to_row, to_col = max(x[row, col], 0.0), -1, -1
        for r in range(row - 1, row + 2):
            for c in range(col - 1, col + 2):
                if x[r, c] > best and (r == row or c == col or _linked(kind, row, col, r, c)):
                    best, to_row, to_col = x[r, c], r, c
        if to_row < 0:
            return path[:n]
        row, col = to_row, to_col
        path[n] = row, col
    return path
