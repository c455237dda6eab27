"""Data derived from a grid, computed once and kept as long as the grid exists. A grid never changes, so it stays valid."""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from antway.grid import Grid, Moves, kept
from antway.kernels.search.best_first import Graph
from antway.kernels.search.canonical import NEED, Lattice, successor_table, surroundings
from antway.kernels.search.jps import mirror, turn

Number = TypeVar("Number", bound=np.generic)
NEIGHBOURS = (Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT)  # the moves that a `Lattice` supports


def longer(array: NDArray[Number]) -> NDArray[Number]:
    """Return an array of twice the length that begins with `array`; the rest is not initialized."""
    return np.concatenate((array, np.empty_like(array)))


def graph(grid: Grid, moves: Moves) -> Graph:
    """Return the graph of `grid` under `moves`."""
    return kept(grid, ("graph", moves), lambda: _graph(grid, moves))


def _graph(grid: Grid, moves: Moves) -> Graph:
    margin = int(np.abs(moves.offsets).max())
    free, (rows, cols) = np.pad(~grid.blocked, margin).view(np.uint8), grid.shape
    legal, width = np.zeros(free.shape, np.uint32), free.shape[1]

    def beside(row: int, col: int) -> NDArray[np.uint8]:
        """Tell for each cell whether the one at this offset from it is free."""
        return free[margin + row : margin + row + rows, margin + col : margin + col + cols]

    for k, (to, touched) in enumerate(zip(moves.offsets.tolist(), moves.touched)):
        need = min(len(touched), NEED.get(moves.value, len(touched)))
        possible = beside(0, 0) & beside(*to) & (sum(beside(*cell) for cell in touched) >= need)
        legal[margin : margin + rows, margin : margin + cols] |= possible.astype(np.uint32) << np.uint32(k)
    offsets = moves.offsets.astype(np.int64) @ np.array([width, 1])
    return Graph(legal.ravel(), offsets, moves.lengths, width, margin)


def lattice(grid: Grid, moves: Moves) -> Lattice:
    """Return the lattice of `grid` under moves of 4 or 8 neighbours."""
    return kept(grid, ("lattice", moves), lambda: _lattice(grid, moves))


def _lattice(grid: Grid, moves: Moves) -> Lattice:
    width = grid.shape[1]
    offsets = Moves.EIGHT.offsets.astype(np.int64) @ np.array([width, 1])
    return Lattice(kept(grid, "around", lambda: _around(grid)), successor_table(NEED[moves.value]), offsets, width)


def _around(grid: Grid) -> NDArray[np.uint8]:
    around = np.empty(grid.shape, np.uint8)
    surroundings(grid.blocked.view(np.uint8), around)
    return around.ravel()


def packed_lines(stops: NDArray[np.bool_]) -> NDArray[np.uint64]:
    """Return a map, bool[H, W], packed into bits as `kernels.search.jps` describes; everything off the map is True."""
    height, width = stops.shape
    rows, columns = (height + 2, width // 64 + 3), (width + 2, height // 64 + 3)
    words = np.full(2 * (math.prod(rows) + math.prod(columns)), ~np.uint64(0))
    parts = np.split(words, np.cumsum([math.prod(rows), math.prod(columns), math.prod(rows)]))
    east, south, west, north = (part.reshape(shape) for part, shape in zip(parts, (rows, columns, rows, columns)))
    octets = np.packbits(stops, axis=1, bitorder="little")
    if width % 8:
        octets[:, -1] |= 0xFF << width % 8 & 0xFF
    east.view(np.uint8)[1:-1, 8 : 8 + octets.shape[1]] = octets
    turn(east, south, height, width)
    mirror(east, west, width)
    mirror(south, north, height)
    return words
