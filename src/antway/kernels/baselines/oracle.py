"""The first contact of a robot on a given path, and how many robots at constant velocity touch something."""

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


@kernel
def survivors(
    robots: NDArray[np.float64],
    robot_radius: float,
    horizon: float,
    terrain: Terrain,
    trajectories: Trajectories,
) -> int:
    """Count the robots, float64[R, 4] rows of x, y (m), vx, vy (m/s), that touch nothing in `horizon` s at that velocity.

    The other parameters are those of `first_contact`.
    """
    alive = 0
    t, xy = np.array([0.0, horizon]), np.empty((2, 2))
    for i in range(len(robots)):
        xy[0] = robots[i, :2]
        xy[1] = xy[0] + robots[i, 2:] * horizon
        alive += first_contact(t, xy, robot_radius, terrain, trajectories) == math.inf
    return alive
