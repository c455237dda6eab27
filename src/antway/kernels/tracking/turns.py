"""Count the turns of obstacles: changes of velocity from one scan to the next that are larger than those of people."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, SIGMA_V, VX, VY
from antway.kernels.tracking.table import drop_lost, row_of

TURN = 0.7  # m/s; a larger change of velocity between two scans counts as a turn; people seldom make one
_GAP = 0.3  # s; scans of a track that are farther apart than this are not compared
_NAME, _SEEN, _VX, _VY = range(4)  # columns of a row: the name of the track, and when and with what velocity it was last seen
COLUMNS = 4
SECONDS, TURNS, CHANGES = range(3)  # entries of `turns`: time observed in s, number of turns, and sum of their changes in m/s
FIRST_SECONDS = 10.0  # s; time without a turn that counts as observed before the first scan


@kernel
def count_turns(
    rows: NDArray[np.float64], count: int, turns: NDArray[np.float64], estimates: NDArray[np.float64], t: float
) -> int:
    """Add what a scan shows of all tracks to `turns`, float64[3]; return how many rows are in use.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        The tracks known so far are the rows below `count`.
    estimates : float64[K, 8]
        As in kernels/tracking/predict.py, at time `t` s.
    """
    count = drop_lost(rows, count, _SEEN, t)
    for k in range(len(estimates)):
        if estimates[k, NAME] < 0.0 or estimates[k, SIGMA_V] >= UNKNOWN:
            continue
        i = row_of(rows, count, _NAME, estimates[k, NAME])
        if i == len(rows):
            continue
        vx, vy = estimates[k, VX], estimates[k, VY]
        if i == count:
            count += 1
        elif t - rows[i, _SEEN] <= _GAP:
            change = math.hypot(vx - rows[i, _VX], vy - rows[i, _VY])
            turns[SECONDS] += t - rows[i, _SEEN]
            if change > TURN:
                turns[TURNS] += 1.0
                turns[CHANGES] += change
        rows[i, _NAME], rows[i, _SEEN], rows[i, _VX], rows[i, _VY] = estimates[k, NAME], t, vx, vy
    return count
