"""Does a robot that drives through given places touch anything, and how many do that drive straight on?"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import segment_hits_cells, swept_timeline
from antway.kernels.base.jit import kernel


@kernel
def first_contact(
    t: NDArray[np.float64],
    xy: NDArray[np.float64],
    robot_radius: float,
    blocked: NDArray[np.bool_],
    frame: NDArray[np.float64],
    knot_t: NDArray[np.float64],
    knot_xy: NDArray[np.float64],
    first: NDArray[np.int64],
    radius: NDArray[np.float64],
) -> float:
    """When does a robot that goes straight from place to place touch an obstacle, or begin a leg that touches a wall?

    Parameters
    ----------
    t, xy : float64[N], float64[N, 2]
        s, increasing, and m.
    robot_radius : float
        m.
    blocked, frame : bool[H, W], float64[3]
        The map; x and y of its corner and the edge of a cell, m. Its edges count as walls.
    knot_t, knot_xy, first, radius
        The moving discs (kernels/base/geometry.py).

    Returns
    -------
    float
        s, infinite if never.
    """
    size = frame[2]
    for i in range(len(t) - 1):
        contact = math.inf
        for k in range(len(radius)):
            hit, _, _ = swept_timeline(
                xy[i, 0],
                xy[i, 1],
                xy[i + 1, 0],
                xy[i + 1, 1],
                t[i],
                t[i + 1],
                robot_radius + radius[k],
                knot_t,
                knot_xy,
                first[k],
                first[k + 1],
            )
            contact = min(contact, hit)
        row, col = (xy[i, 1] - frame[1]) / size - 0.5, (xy[i, 0] - frame[0]) / size - 0.5
        row_end, col_end = (xy[i + 1, 1] - frame[1]) / size - 0.5, (xy[i + 1, 0] - frame[0]) / size - 0.5
        if contact > t[i] and segment_hits_cells(blocked, row, col, row_end, col_end, robot_radius / size, True):
            contact = t[i]
        if contact < math.inf:
            return contact
    return math.inf


@kernel
def survivors(
    robots: NDArray[np.float64],
    robot_radius: float,
    horizon: float,
    blocked: NDArray[np.bool_],
    frame: NDArray[np.float64],
    knot_t: NDArray[np.float64],
    knot_xy: NDArray[np.float64],
    first: NDArray[np.int64],
    radius: NDArray[np.float64],
) -> int:
    """Count the robots, float64[R, 4] rows of x, y (m), vx, vy (m/s), that touch nothing in `horizon` s at that velocity.

    The other parameters are those of `first_contact`.
    """
    alive = 0
    t, xy = np.array([0.0, horizon]), np.empty((2, 2))
    for i in range(len(robots)):
        xy[0] = robots[i, :2]
        xy[1] = xy[0] + robots[i, 2:] * horizon
        alive += first_contact(t, xy, robot_radius, blocked, frame, knot_t, knot_xy, first, radius) == math.inf
    return alive
