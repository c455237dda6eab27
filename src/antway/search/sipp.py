"""Space-time search: safe interval path planning (SIPP) for a disc among moving discs, exact in real-valued time.

Phillips, Likhachev: SIPP: Safe Interval Path Planning for Dynamic Environments, ICRA 2011.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid, Moves
from antway.kernels import timed

TIMED_MOVES = (Moves.FOUR, Moves.EIGHT, Moves.SIXTEEN, Moves.THIRTY_TWO)


def timed_moves(grid: Grid, radius: float, moves: Moves = Moves.THIRTY_TWO) -> NDArray[np.uint32]:
    """Return which moves a disc can make from each cell: bit k stands for `moves.offsets[k]`.

    Parameters
    ----------
    grid : Grid
    radius : float
        Of the robot in m, >= 0. Touching is legal, contact with blocked cells or the edge of the map is not.
    moves : Moves
        FOUR, EIGHT, SIXTEEN or THIRTY_TWO: those that cut no corner.

    Returns
    -------
    uint32[H, W]
        0 where the disc cannot stand.

    Raises
    ------
    BadParameter
        For other moves, or a radius out of range.

    Examples
    --------
    >>> timed_moves(Grid(np.zeros((1, 3), dtype=bool)), 0.5, Moves.FOUR).tolist()
    [[1, 5, 4]]
    """
    checks.instance("grid", grid, Grid)
    checks.instance("moves", moves, Moves)
    if moves not in TIMED_MOVES:
        raise BadParameter("moves", moves, f"one of {', '.join(m.name for m in TIMED_MOVES)}")
    radius = checks.number("radius", radius, low=0.0, high=1000 * grid.resolution, unit="m, at most 1000 cells")
    return timed.move_mask(grid.blocked, moves.offsets, radius / grid.resolution)


def timed_field(mask: NDArray[np.uint32], moves: Moves, goals: ArrayLike, scale: float = 1.0) -> NDArray[np.float64]:
    """Return the exact distance of every cell to the nearest goal over the legal moves of `mask`.

    Parameters
    ----------
    mask : uint32[H, W]
        From `timed_moves` with the same moves, or a window of it.
    moves : Moves
    goals : int[G, 2] or (row, col)
    scale : float
        What a cell's edge counts: the resolution for metres, resolution / speed for seconds, > 0.

    Returns
    -------
    float64[H, W]
        Infinite where no goal can be reached.

    Raises
    ------
    BadParameter
        For a mask or goals of wrong type or shape, or goals off the mask.

    Examples
    --------
    >>> mask = timed_moves(Grid(np.zeros((1, 3), dtype=bool)), 0.5, Moves.FOUR)
    >>> timed_field(mask, Moves.FOUR, (0, 0), scale=0.5).tolist()
    [[0.0, 0.5, 1.0]]
    """
    if not isinstance(mask, np.ndarray) or mask.dtype != np.uint32 or mask.ndim != 2:
        raise BadParameter("mask", mask, "a uint32[H, W] array from timed_moves")
    cells = np.atleast_2d(np.asarray(goals))
    if not np.issubdtype(cells.dtype, np.integer) or cells.ndim != 2 or cells.shape[1] != 2:
        raise BadParameter("goals", goals, "cells, int[G, 2]")
    if (cells < 0).any() or (cells >= mask.shape).any():
        raise BadParameter("goals", goals, f"cells of the mask, {mask.shape[0]} x {mask.shape[1]}")
    scale = checks.number("scale", scale, low=0.0, open_low=True)
    return timed.move_field(mask, moves.offsets, moves.lengths, cells.astype(np.int64)) * scale
