"""Cost maps: the cost of a metre in each cell.

A move costs its length times the mean of the costs of its two cells. Costs are finite and positive. A cost of 1 is plain
distance; a zone of cost 3 is crossed only where a detour would be three times as long.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter, OutOfBounds
from antway.grid import Grid

LEAST = 1e-6  # least cost; a smaller one would make A* as slow as Dijkstra, and 0 would make lengths meaningless
MOST = 1e6


def checked_costs(costs: ArrayLike, grid: Grid) -> NDArray[np.float64]:
    """Return `costs` as float64[H, W] if each is in [1e-6, 1e6], also for blocked cells, so that mistakes are noticed."""
    result = checks.array("costs", costs, grid.shape)
    low, high = float(result.min()), float(result.max())
    if low < LEAST or high > MOST:
        raise BadParameter("costs", low if low < LEAST else high, f"in [{LEAST:g}, {MOST:g}] throughout")
    return result


def inflation_costs(
    grid: Grid, radius: float, inflation_radius: float, scaling: float = 10.0, most: float = 253.0
) -> NDArray[np.float64]:
    """Return costs that decrease with the distance d to the nearest obstacle, as in the inflation layer of Nav2.

    The cost is 1 + (most - 1) exp(-scaling (d - radius)) for d in [radius, inflation_radius], `most` below, and 1 beyond.

    Parameters
    ----------
    grid : Grid
    radius : float
        The robot's (inscribed) radius, m, >= 0.
    inflation_radius : float
        Distance beyond which the cost is 1, m, >= radius, may be infinite.
    scaling : float
        Decay, 1/m, >= 0; `cost_scaling_factor` in Nav2.
    most : float
        Cost at the robot's radius, in [1, 1e6].

    Returns
    -------
    float64[H, W]

    Examples
    --------
    >>> blocked = np.zeros((1, 4), dtype=bool); blocked[0, 0] = True
    >>> inflation_costs(Grid(blocked), 0.5, 3.0, scaling=1.0, most=3.0).round(2).tolist()
    [[3.0, 3.0, 3.0, 3.0]]
    """
    checks.instance("grid", grid, Grid)
    radius = checks.number("radius", radius, low=0.0, unit="m")
    inflation_radius = checks.number("inflation_radius", inflation_radius, low=radius, infinite=True, unit="m")
    scaling = checks.number("scaling", scaling, low=0.0, unit="1/m")
    most = checks.number("most", most, low=1.0, high=MOST)
    d = grid.clearance()
    with np.errstate(over="ignore"):  # e^-inf = 0 is intended
        costs = 1 + (most - 1) * np.exp(-scaling * np.maximum(d - radius, 0.0))
    costs[d > inflation_radius] = 1.0
    return costs


def path_cost(cells: ArrayLike, costs: ArrayLike, grid: Grid) -> float:
    """Return the cost of a path in m: the sum over its moves of the length times the mean cost of both ends.

    Parameters
    ----------
    cells : int[N, 2]
        (row, col), a move apart.
    costs : float[H, W]
    grid : Grid

    Raises
    ------
    BadParameter, OutOfBounds

    Examples
    --------
    >>> path_cost([(0, 0), (0, 1)], [[1.0, 2.0]], Grid(np.zeros((1, 2), dtype=bool)))
    1.5
    """
    checks.instance("grid", grid, Grid)
    path, weights = checks.array("cells", cells, (None, 2)), checked_costs(costs, grid)
    outside = ((path < 0) | (path >= grid.shape)).any(axis=1)
    if outside.any():
        raise OutOfBounds("cells", tuple(path[outside][0].tolist()), f"on the map of {grid.shape}")
    whole = path.astype(np.int64)
    if (whole != path).any():
        raise BadParameter("cells", cells, "cells (row, col), which are whole numbers")
    at = weights[whole[:, 0], whole[:, 1]]
    lengths = np.hypot(*np.diff(path, axis=0).T)
    return float((lengths * (at[1:] + at[:-1]) / 2).sum()) * grid.resolution
