"""The first contact of a robot on a given path."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import segment_hits_cells
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import Terrain, Trajectories
from antway.kernels.tracking.tubes import first_met


@kernel
def first_contact(
    t: NDArray[np.float64],
    xy: NDArray[np.float64],
    robot_radius: float,
    terrain: Terrain,
    trajectories: Trajectories,
) -> float:
    """When does a robot that goes straight from place to place touch an obstacle, or begin a leg that touches a wall?

    Parameters
    ----------
    t, xy : float64[N], float64[N, 2]
        s, increasing, and m.
    robot_radius : float
        m.
    terrain : Terrain
        Its edges count as walls.
    trajectories : Trajectories
        The moving discs.

    Returns
    -------
    float
        s, infinite if never.
    """
    size = terrain.resolution
    for i in range(len(t) - 1):
        ax, ay, bx, by = xy[i, 0], xy[i, 1], xy[i + 1, 0], xy[i + 1, 1]
        contact, _ = first_met(ax, ay, bx, by, t[i], t[i + 1], robot_radius, 0.0, trajectories)
        row, col = (ay - terrain.y0) / size - 0.5, (ax - terrain.x0) / size - 0.5
        row_end, col_end = (by - terrain.y0) / size - 0.5, (bx - terrain.x0) / size - 0.5
        if contact > t[i] and segment_hits_cells(terrain.blocked, row, col, row_end, col_end, robot_radius / size, True):
            contact = t[i]
        if contact < math.inf:
            return contact
    return math.inf
