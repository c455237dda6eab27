"""Records that travel together through the kernels: named tuples of numbers and arrays."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PEOPLE_ACCEL = 2.2  # m/s^2; 99.9 % of the changes of velocity in the recordings zara01 and students01 are smaller
HOLONOMIC, DIFFERENTIAL, ACKERMANN = range(3)  # drives: any direction; two wheels; steering


class RobotLimits(NamedTuple):
    """What a robot can do. All limits but v_max and v_reverse may be infinite."""

    drive: int  # HOLONOMIC, DIFFERENTIAL or ACKERMANN
    v_max: float  # m/s, > 0
    v_reverse: float  # m/s, >= 0; the speed limit of wheels in reverse
    a_max: float  # m/s^2, > 0; limit of acceleration
    brake_max: float  # m/s^2, > 0; limit of deceleration
    turn_rate: float  # rad/s, > 0
    alpha_max: float  # rad/s^2, > 0; limit of change of the turn rate
    turning_radius: float  # m, >= 0; for ACKERMANN |omega| <= |v| / turning_radius
    latency: float  # s, >= 0; delay between a command and its effect
    radius: float  # m; radius of the smallest disc around the robot's centre that contains the robot


class RobotState(NamedTuple):
    """Where a robot is and how fast it moves.

    For the dynamics "steps" (kernels/robot/dynamics.py) a and b are vx and vy, whatever the drive.
    """

    x: float  # m
    y: float  # m
    theta: float  # rad; heading
    a: float  # m/s; vx of a holonomic robot; of wheels the speed v along the heading, negative in reverse
    b: float  # vy of a holonomic robot, m/s; the turn rate omega of wheels, rad/s


BLOCK = 8  # number of rows and of columns in a block of cells


class Terrain(NamedTuple):
    """A map of blocked cells and where it lies in the world."""

    blocked: NDArray[np.bool_]  # [H, W]
    blocks: NDArray[np.bool_]  # [ceil(H / BLOCK), ceil(W / BLOCK)] whether any cell of each block is blocked
    x0: float  # m; x and y of the outer corner of cell (0, 0)
    y0: float
    resolution: float  # m; edge of a cell

    def __deepcopy__(self, memo: object) -> Terrain:
        """Return itself: nothing writes to a map. Kernels would be compiled anew for copies, which could be written to."""
        return self


class Walls(NamedTuple):
    """A `Terrain` with the distances to its walls."""

    blocked: NDArray[np.bool_]  # [H, W]
    clearance: NDArray[np.float64]  # [H, W] m; from a cell's centre to the nearest blocked square or map edge
    x0: float  # m; x and y of the outer corner of cell (0, 0)
    y0: float
    resolution: float  # m; edge of a cell

    def __deepcopy__(self, memo: object) -> Walls:
        """Return itself, as `Terrain` does."""
        return self


class Trajectories(NamedTuple):
    """Piecewise linear motions of K discs (kernels/base/geometry.py)."""

    knot_t: NDArray[np.float64]  # [M] s
    knot_xy: NDArray[np.float64]  # [M, 2] m
    first: NDArray[np.int64]  # [K + 1]; disc k has the knots first[k]:first[k + 1]
    radius: NDArray[np.float64]  # [K] m


# Columns of a motion segment, one row of float64[P, 8] (kernels/spacetime/segments.py). From T0 to T1 s an obstacle moves
# uniformly from (X, Y) m with (VX, VY) m/s. A standing robot keeps CONTACT_RADIUS m away, a moving one CLEARANCE_RADIUS m.
T0, T1, X, Y, VX, VY, CONTACT_RADIUS, CLEARANCE_RADIUS = range(8)


class Predictions(NamedTuple):
    """Predicted obstacles, which a robot has to keep clear of."""

    segments: NDArray[np.float64]  # [P, 8]
    stopping_time: float  # s; a moving robot keeps clear of where each obstacle was up to this time before
