"""Count the turns of obstacles: changes of velocity from one scan to the next that are larger than those of people."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.base.records import Terrain
from antway.kernels.tracking.bounces import GAP, NAMED, SEEN, remember, velocity_change
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, SIGMA_V
from antway.kernels.tracking.table import drop_lost, row_of

TURN = 0.7  # m/s; a larger change of velocity between two scans counts as a turn; people seldom make one
SECONDS, TURNS, CHANGES = range(3)  # entries of `turns`: time observed in s, number of turns, and sum of their changes in m/s
FIRST_SECONDS = 10.0  # s; time without a turn that counts as observed before the first scan


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
    count = drop_lost(rows, count, SEEN, t)
    for k in range(len(estimates)):
        if estimates[k, NAME] < 0.0 or estimates[k, SIGMA_V] >= UNKNOWN:
            continue
        i = row_of(rows, count, NAMED, estimates[k, NAME])
        if i == len(rows):
            continue
        if i == count:
            count += 1
        elif 0.0 < t - rows[i, SEEN] <= GAP:
            change, _, _ = velocity_change(rows[i], estimates[k], t, terrain)
            turns[SECONDS] += t - rows[i, SEEN]
            if change > TURN:
                turns[TURNS] += 1.0
                turns[CHANGES] += change
        remember(rows[i], estimates[k], t)
    return count
