"""Compare the velocities that a sensor reports with those between its places."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.tracking.table import NAMED, SEEN, Table, row_or_oldest

# Columns of a row after NAMED and SEEN: the last place of a track, the velocity reported then, and that from the place before.
_X, _Y, _VX, _VY, _PX, _PY = range(2, 8)
COLUMNS = 8
_MEMORY = 0.995  # 1; with each comparison, earlier ones count this much less
_ENOUGH = 10.0  # number of comparisons before reported velocities can be found wrong
_LEAST = 0.03  # m/s; a smaller error does not matter
_MOST = 1.0  # m/s; a larger error counts as this, because somebody turned or jumped
_FAR = 0.5  # s; an older measurement is not compared


@kernel
def wrong(
    rows: NDArray[np.float64],
    used: NDArray[np.int64],
    state: NDArray[np.float64],
    t: float,
    name: NDArray[np.int64],
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> bool:
    """Tell, after one more scan, whether reported velocities foretell places worse than the two places before do.

    They are wrong if their mean error is more than twice that of the velocity between the two places before.

    Parameters
    ----------
    rows, used : float64[M, COLUMNS], int64[1]
        Of the table with the last measurement of each track; Python hands on two arrays faster than the record.
    state : float64[3]
        Number of comparisons, and the sums of both errors, m/s; zeros at first.
    t, name, xy, velocity
        The scan, as in kernels/tracking/kalman.py; a velocity of NaN is not reported.
    """
    for k in range(len(name)):
        px, py = math.nan, math.nan
        i, is_new = row_or_oldest(Table(rows, used, NAMED), float(name[k]))
        row = rows[i]
        if not is_new:
            dt = t - row[SEEN]
            if dt <= 0.0:
                continue  # this scan was processed before
            px, py = (xy[k, 0] - row[_X]) / dt, (xy[k, 1] - row[_Y]) / dt
            reported = math.hypot(px - row[_VX], py - row[_VY])
            between = math.hypot(px - row[_PX], py - row[_PY])
            if dt <= _FAR and not math.isnan(reported + between):
                state *= _MEMORY
                state[0] += 1.0
                state[1] += min(reported, _MOST)
                state[2] += min(between, _MOST)
        row[NAMED], row[SEEN], row[_X], row[_Y] = name[k], t, xy[k, 0], xy[k, 1]
        row[_VX], row[_VY], row[_PX], row[_PY] = velocity[k, 0], velocity[k, 1], px, py
    found: bool = state[0] >= _ENOUGH and state[1] > 2.0 * state[2] + _LEAST * state[0]
    return found
