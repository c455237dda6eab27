"""Records that travel together through the kernels: named tuples of numbers and arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

HOLONOMIC, DIFFERENTIAL, ACKERMANN = range(3)  # drives: any direction; two wheels; steering


class RobotLimits(NamedTuple):
    """What a robot can do. Limits may be infinite, but for v_max and v_reverse."""

    drive: int  # HOLONOMIC, DIFFERENTIAL or ACKERMANN
    v_max: float  # m/s, > 0
    v_reverse: float  # m/s, >= 0; wheels drive backwards at most so fast
    a_max: float  # m/s^2, > 0; growth of the speed
    brake_max: float  # m/s^2, > 0; fall of the speed
    turn_rate: float  # rad/s, > 0
    alpha_max: float  # rad/s^2, > 0; growth and fall of the turn rate
    turning_radius: float  # m, >= 0; for ACKERMANN |omega| <= |v| / turning_radius
    latency: float  # s, >= 0; a command acts so long after it was given
    radius: float  # m; of the disc around the robot's centre that holds all of it


class Terrain(NamedTuple):
    """A map of blocked cells and where it lies in the world."""

    blocked: NDArray[np.bool_]  # [H, W]
    x0: float  # m; x and y of the outer corner of cell (0, 0)
    y0: float
    resolution: float  # m; edge of a cell


class Trajectories(NamedTuple):
    """Piecewise linear motions of K discs (kernels/base/geometry.py)."""

    knot_t: NDArray[np.float64]  # [M] s
    knot_xy: NDArray[np.float64]  # [M, 2] m
    first: NDArray[np.int64]  # [K + 1]; disc k has the knots first[k]:first[k + 1]
    radius: NDArray[np.float64]  # [K] m


# Columns of a motion segment, one row of float64[P, 8] (kernels/spacetime/segments.py): from T0 to T1 s an obstacle moves
# uniformly from (X, Y) m with (VX, VY) m/s; a standing robot keeps CONTACT_RADIUS m, a moving one CLEARANCE_RADIUS m away.
T0, T1, X, Y, VX, VY, CONTACT_RADIUS, CLEARANCE_RADIUS = range(8)


class Predictions(NamedTuple):
    """What a robot has to keep clear of."""

    segments: NDArray[np.float64]  # [P, 8]
    stopping_time: float  # s; a moving robot keeps clear of where each obstacle was so long before
    work: NDArray[np.float64]  # [2] scratch
