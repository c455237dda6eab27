"""How long obstacles have stayed where they are: an obstacle in a doorway may stand there or go to and fro in it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.predict import NAME, RADIUS, X, Y
from antway.kernels.tracking.table import row_of

# Columns of a row: the name of the track, when its stay began and when it was last seen, its radius, and the box that holds its
# centre since then.
NAMED, SINCE, SEEN, SIZE, LOW_X, LOW_Y, HIGH_X, HIGH_Y = range(8)
COLUMNS = 8
PLACE = 1.0  # m; an obstacle stays as long as the diagonal of the box that holds its centre is no longer than this
_LEAST_MEMORY = 1.0  # s; an obstacle that was not seen for longer than this and than its stay is forgotten


@bare_kernel
def _start_stay(row: NDArray[np.float64], estimate: NDArray[np.float64], t: float) -> None:
    """Begin a stay at time `t` s."""
    row[NAMED], row[SINCE], row[SIZE] = estimate[NAME], t, estimate[RADIUS]
    row[LOW_X] = row[HIGH_X] = estimate[X]
    row[LOW_Y] = row[HIGH_Y] = estimate[Y]


@kernel
def update_stays(
    rows: NDArray[np.float64], count: int, estimates: NDArray[np.float64], seen: NDArray[np.float64], t: float
) -> int:
    """Update the stays with the tracks that are seen at time `t` s; return how many rows are in use.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        The stays known so far are the rows below `count`. Where the rows are used up, further tracks are left out.
    estimates : float64[K, 8]
        As in kernels/tracking/predict.py. Tracks without a name are left out.
    seen : float64[K]
        When each of them was last seen, s.
    """
    kept = 0
    for i in range(count):
        if t - rows[i, SEEN] <= max(rows[i, SEEN] - rows[i, SINCE], _LEAST_MEMORY):
            if kept != i:
                copy_row(rows[i], rows[kept])
            kept += 1
    count = kept
    for k in range(len(estimates)):
        if estimates[k, NAME] < 0.0 or seen[k] != t:
            continue
        i = row_of(rows, count, NAMED, estimates[k, NAME])
        if i == len(rows):
            continue
        row = rows[i]
        if i == count:
            count += 1
            _start_stay(row, estimates[k], t)
        row[SEEN] = t
        row[LOW_X], row[HIGH_X] = min(row[LOW_X], estimates[k, X]), max(row[HIGH_X], estimates[k, X])
        row[LOW_Y], row[HIGH_Y] = min(row[LOW_Y], estimates[k, Y]), max(row[HIGH_Y], estimates[k, Y])
        if math.hypot(row[HIGH_X] - row[LOW_X], row[HIGH_Y] - row[LOW_Y]) > PLACE:
            _start_stay(row, estimates[k], t)
    return count
