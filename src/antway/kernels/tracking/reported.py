"""Compare the velocities that a sensor reports with those between its places."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.tracking.table import row_of

# Columns of a row: the last measurement of a track with the velocity that was reported, and the velocity from the place before.
_NAME, _T, _X, _Y, _VX, _VY, _PX, _PY = range(8)
COLUMNS = 8
_MEMORY = 0.995  # 1; with each comparison, earlier ones count this much less
_ENOUGH = 10.0  # number of comparisons before reported velocities can be found wrong
_LEAST = 0.03  # m/s; a smaller error does not matter
_MOST = 1.0  # m/s; a larger error counts as this, because somebody turned or jumped
_FAR = 0.5  # s; an older measurement is not compared


@kernel
def wrong(
    rows: NDArray[np.float64],
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
    rows : float64[M, COLUMNS]
        The last measurement of each track.
    state : float64[4]
        Number of rows in use, number of comparisons, and the sums of both errors, m/s; zeros at first.
    t, name, xy, velocity
        The scan, as in kernels/tracking/kalman.py; a velocity of NaN is not reported.
    """
    count = int(state[0])
    for k in range(len(name)):
        px, py = math.nan, math.nan
        i = row_of(rows, count, _NAME, float(name[k]))
        if i < count:
            row, dt = rows[i], t - rows[i, _T]
            if dt <= 0.0:
                continue  # this scan was processed before
            px, py = (xy[k, 0] - row[_X]) / dt, (xy[k, 1] - row[_Y]) / dt
            reported = math.hypot(px - row[_VX], py - row[_VY])
            between = math.hypot(px - row[_PX], py - row[_PY])
            if dt <= _FAR and not math.isnan(reported + between):
                state[1:] *= _MEMORY
                state[1] += 1.0
                state[2] += min(reported, _MOST)
                state[3] += min(between, _MOST)
        elif count < len(rows):
            count += 1
        else:
            i = int(np.argmin(rows[:, _T]))
        rows[i, _NAME], rows[i, _T], rows[i, _X], rows[i, _Y] = name[k], t, xy[k, 0], xy[k, 1]
        rows[i, _VX], rows[i, _VY], rows[i, _PX], rows[i, _PY] = velocity[k, 0], velocity[k, 1], px, py
    state[0] = count
    found: bool = state[1] >= _ENOUGH and state[2] > 2.0 * state[3] + _LEAST * state[1]
    return found
