"""Canonical successors on 4 and 8 neighbours: of all shortest paths between two cells only those with diagonals first remain.

A successor n of cell x, reached from p, is dropped if the cells around x contain a path from p to n that is shorter than the
one through x, or as long with the diagonal earlier (with 4 moves: the vertical move earlier). This is correct for any optimal
parent p, because the other path leads to n at no greater cost (Harabor and Grastien, Online graph pruning for
pathfinding on grid maps, AAAI 2011; Sturtevant and Rabin, Canonical orderings on grids, IJCAI 2016).

Directions are those of `Moves.EIGHT`: 0-3 are E, S, W, N and diagonal 4 + i lies between i and i + 1 (mod 4). Bit d of a
cell's surroundings is set if its neighbour in direction d is free.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel

START = 8  # direction of arrival at the start cell; there all legal moves are successors
NEED = {"four": -1, "eight": 2, "eight-nosqueeze": 1, "eight-cut": 0}  # free side cells that a diagonal needs; -1: no diagonals

ROW = np.array([0, 1, 0, -1, 1, 1, -1, -1])  # change of the row in each direction
COL = np.array([1, 0, -1, 0, 1, -1, -1, 1])  # change of the column in each direction


class Lattice(NamedTuple):
    """The map for moves to 4 or 8 neighbours, cell (r, c) at r * width + c, and its canonical successors."""

    around: NDArray[np.uint8]  # [cells] surroundings of each cell, one bit for each direction
    table: NDArray[np.uint8]  # [9 * 256] set of successors at 256 * direction of arrival + surroundings
    offsets: NDArray[np.int64]  # [8] flat step of each direction
    width: int  # cells in a row

    def at(self, cell: tuple[int, int]) -> int:
        """Return the flat index of `cell`."""
        return cell[0] * self.width + cell[1]


@kernel
def surroundings(blocked: NDArray[np.uint8], around: NDArray[np.uint8]) -> None:
    """Write to `around` which of the 8 neighbours of each cell of a map of 0 and 1 are free; 0 for blocked cells.

    One loop over shifted views of three rows with margins compiles to vector instructions.
    """
    height, width = blocked.shape
    free = np.zeros((3, width + 2), np.uint8)
    # Loops, because assignments to slices would take Numba several seconds longer to compile.
    for i in range(width):
        free[1, i + 1] = blocked[0, i] ^ np.uint8(1)
    for row in range(height):
        above, here, below = free[row % 3], free[(row + 1) % 3], free[(row + 2) % 3]
        if row + 1 < height:
            for i in range(width):
                below[i + 1] = blocked[row + 1, i] ^ np.uint8(1)
        else:
            for i in range(width):
                below[i + 1] = np.uint8(0)
        out = around[row]
        n, ne, x, e, s, se = above[1:], above[2:], here[1:], here[2:], below[1:], below[2:]
        for i in range(width):
            straight = e[i] | s[i] << 1 | here[i] << 2 | n[i] << 3
            out[i] = x[i] * (straight | se[i] << 4 | below[i] << 5 | above[i] << 6 | ne[i] << 7)


@cache
def successor_table(need: int) -> NDArray[np.uint8]:
    """Return the canonical successors, uint8[9 * 256]: a set of directions at 256 * direction of arrival + surroundings.

    NumPy computes all 256 surroundings at once in milliseconds; a kernel would take seconds to compile.
    """
    table = np.zeros((9, 256), np.uint8)
    for to in range(8):
        legal = _may_move(0, 0, int(ROW[to]), int(COL[to]), need)
        table[START] |= np.where(legal, 1 << to, 0).astype(np.uint8)
        for came in range(8 if need >= 0 else 4):
            table[came] |= np.where(legal & ~_is_beaten(came, to, need), 1 << to, 0).astype(np.uint8)
    return table.ravel()


def _is_free(row: int, col: int) -> NDArray[np.bool_]:
    """Tell for each of the 256 surroundings of a free cell x whether the cell at the offset (row, col) is free."""
    if row == 0 and col == 0:
        return np.ones(256, np.bool_)
    direction = np.flatnonzero((row == ROW) & (col == COL))
    return np.arange(256) >> direction[0] & 1 == 1 if len(direction) else np.zeros(256, np.bool_)


def _may_move(row: int, col: int, to_row: int, to_col: int, need: int) -> NDArray[np.bool_]:
    """Tell for each of the surroundings whether the step between two cells, at offsets from x, is legal."""
    apart = max(abs(row - to_row), abs(col - to_col))
    if apart != 1 or (need < 0 and row != to_row and col != to_col):
        return np.zeros(256, np.bool_)
    if row == to_row or col == to_col:
        return _is_free(to_row, to_col)
    sides = _is_free(row, to_col).astype(np.int64) + _is_free(to_row, col)
    return _is_free(to_row, to_col) & (sides >= need)


def _is_beaten(came: int, to: int, need: int) -> NDArray[np.bool_]:
    """Tell for each of the surroundings whether a path around x reaches the cell in direction `to` as well."""
    row, col, to_row, to_col = -int(ROW[came]), -int(COL[came]), int(ROW[to]), int(COL[to])
    if row == to_row and col == to_col:
        return np.ones(256, np.bool_)
    through = math.hypot(row, col) + math.hypot(to_row, to_col)
    beaten = _may_move(row, col, to_row, to_col, need)
    for r, c in zip(ROW.tolist(), COL.tolist()):
        first, second = math.hypot(r - row, c - col), math.hypot(to_row - r, to_col - c)
        earlier = first > math.hypot(row, col) if need >= 0 else c == col
        if first + second < through - 1e-9 or (first + second < through + 1e-9 and earlier):
            beaten |= _may_move(row, col, r, c, need) & _may_move(r, c, to_row, to_col, need)
    return beaten
