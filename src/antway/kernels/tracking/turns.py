"""Count the turns of obstacles: changes of velocity from one scan to the next that are larger than those of people.

At a wall, what counts is the difference from the mirrored velocity, because predictions turn back at walls as well.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.records import Terrain
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, RADIUS, SIGMA_V, VX, VY, X, Y, reflected, wall_ahead
from antway.kernels.tracking.table import drop_lost, row_of

TURN = 0.7  # m/s; a larger change of velocity between two scans counts as a turn; people seldom make one
_GAP = 0.3  # s; scans of a track that are farther apart than this are not compared
# Columns of a row: the name of the track, and when, where and with what velocity it was last seen.
_NAME, _SEEN, _X, _Y, _VX, _VY = range(6)
COLUMNS = 6
SECONDS, TURNS, CHANGES = range(3)  # entries of `turns`: time observed in s, number of turns, and sum of their changes in m/s
FIRST_SECONDS = 10.0  # s; time without a turn that counts as observed before the first scan


@bare_kernel
def _from_mirrored(last: NDArray[np.float64], vx: float, vy: float, radius: float, terrain: Terrain) -> float:
    """Return how much a velocity differs from the last one, mirrored at the wall that the track would soon touch, m/s.

    It is infinite if the track, as it was last seen, would touch no wall or edge of the map within `_GAP` s.
    """
    touches, n_x, n_y = wall_ahead(last[_X], last[_Y], last[_VX], last[_VY], radius, _GAP, terrain)
    if not touches:
        return math.inf
    reflected_vx, reflected_vy = reflected(last[_VX], last[_VY], n_x, n_y)
    return math.hypot(vx - reflected_vx, vy - reflected_vy)


@kernel
def count_turns(
    rows: NDArray[np.float64],
    count: int,
    turns: NDArray[np.float64],
    estimates: NDArray[np.float64],
    terrain: Terrain,
    t: float,
) -> int:
    """Add what a scan shows of all tracks to `turns`, float64[3]; return how many rows are in use.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        The tracks known so far are the rows below `count`.
    estimates : float64[K, 8]
        As in kernels/tracking/predict.py, at time `t` s.
    terrain : Terrain
    """
    count = drop_lost(rows, count, _SEEN, t)
    for k in range(len(estimates)):
        if estimates[k, NAME] < 0.0 or estimates[k, SIGMA_V] >= UNKNOWN:
            continue
        i = row_of(rows, count, _NAME, estimates[k, NAME])
        if i == len(rows):
            continue
        row, vx, vy = rows[i], estimates[k, VX], estimates[k, VY]
        if i == count:
            count += 1
        elif t - row[_SEEN] <= _GAP:
            change = math.hypot(vx - row[_VX], vy - row[_VY])
            turns[SECONDS] += t - row[_SEEN]
            if change > TURN:
                change = min(change, _from_mirrored(row, vx, vy, estimates[k, RADIUS], terrain))
            if change > TURN:
                turns[TURNS] += 1.0
                turns[CHANGES] += change
        row[_NAME], row[_SEEN], row[_VX], row[_VY] = estimates[k, NAME], t, vx, vy
        row[_X], row[_Y] = estimates[k, X], estimates[k, Y]
    return count
