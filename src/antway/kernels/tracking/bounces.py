"""How the velocity of a track has changed since its last scan; at a wall, the change from the mirrored velocity counts.

Predictions turn back at walls, so a bounce is nothing unforeseen.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import reflected, wall_ahead
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import Terrain
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, RADIUS, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.table import NAMED, SEEN, Table, row_for

# Columns of a row after NAMED and SEEN in tables that compare scans: where and with what velocity the track was last seen.
_X, _Y, LAST_VX, LAST_VY = range(2, 6)
COLUMNS = 6
GAP = 0.3  # s; a wall explains a change of velocity if the track would have touched it within this time
_CHANGED = 0.1  # m/s; a smaller change of velocity is not looked at as a bounce


@bare_kernel
def row_to_compare(table: Table, estimate: NDArray[np.float64]) -> tuple[int, bool]:
    """Do as `row_for`, but a track without a name, or whose velocity is not known, has the row -1, too."""
    if estimate[NAME] < 0.0 or estimate[SIGMA_V] >= UNKNOWN:
        return -1, True
    return row_for(table, estimate[NAME])


@bare_kernel
def remember(row: NDArray[np.float64], estimate: NDArray[np.float64], t: float) -> None:
    """Store when, where and with what velocity a track is seen."""
    row[NAMED], row[SEEN], row[_X], row[_Y] = estimate[NAME], t, estimate[X], estimate[Y]
    row[LAST_VX], row[LAST_VY] = estimate[VX], estimate[VY]


@bare_kernel
def velocity_change(
    row: NDArray[np.float64], estimate: NDArray[np.float64], t: float, terrain: Terrain
) -> tuple[float, float, float]:
    """Return the change of a track's velocity since it was last seen, m/s, and the normal of the wall that it bounced off.

    If the new velocity is nearer to the last one, mirrored at a wall or an edge of the map, the change is measured from that.
    Otherwise the normal is (0, 0).
    """
    vx, vy, last_vx, last_vy = estimate[VX], estimate[VY], row[LAST_VX], row[LAST_VY]
    change = math.hypot(vx - last_vx, vy - last_vy)
    if change >= _CHANGED:
        time = max(t - row[SEEN], GAP)
        share, n_x, n_y = wall_ahead(terrain, row[_X], row[_Y], last_vx * time, last_vy * time, estimate[RADIUS])
        mirrored_vx, mirrored_vy = reflected(last_vx, last_vy, n_x, n_y)
        mirrored_change = math.hypot(vx - mirrored_vx, vy - mirrored_vy)
        if share <= 1.0 and mirrored_change < change:
            return mirrored_change, n_x, n_y
    return change, 0.0, 0.0
