"""Estimate the noise of measured places where the sensor states none.

Each place is compared with the last measured place of the track moved on by the measured velocities.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.tracking.table import row_of

_NAME, _T, _X, _Y, _VX, _VY = range(6)  # columns of a row: the last measurement of a track
COLUMNS = 6
_LEAST = 1e-8  # m^2; a smaller variance counts as none
_STEP = 0.1  # 1; each measurement changes the logarithm of the median by this
_FAR = 0.5  # s; an older measurement is not compared


@kernel
def place_noise(
    rows: NDArray[np.float64],
    state: NDArray[np.float64],
    t: float,
    name: NDArray[np.int64],
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> float:
    """Return the variance of measured places along one axis, m^2, after one more scan; 0 while it is below (0.1 mm)^2.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        The last measurement of each track.
    state : float64[2]
        Number of rows in use, and the median of the squared innovations, m^2.
    t, name, xy, velocity
        The scan, as in kernels/tracking/kalman.py; tracks without name or velocity are ignored.

    Notes
    -----
    The innovation is the difference of two measured places less the motion between them. With noise of variance R along each
    axis, its squared length has the mean 4 R and the median 4 R ln 2. The median is tracked by small steps up and down, so that
    an occasional turn or jump has little effect.
    """
    count = int(state[0])
    for k in range(len(name)):
        if name[k] < 0 or math.isnan(velocity[k, 0]):
            continue
        i = row_of(rows, count, _NAME, float(name[k]))
        if i < count:
            dt = t - rows[i, _T]
            if 0.0 < dt <= _FAR:
                ex = xy[k, 0] - rows[i, _X] - 0.5 * (rows[i, _VX] + velocity[k, 0]) * dt
                ey = xy[k, 1] - rows[i, _Y] - 0.5 * (rows[i, _VY] + velocity[k, 1]) * dt
                up = ex * ex + ey * ey > state[1]
                state[1] = max(state[1] * math.exp(_STEP if up else -_STEP), _LEAST)
        elif count < len(rows):
            count += 1
        else:
            i = int(np.argmin(rows[:, _T]))
        rows[i, _NAME], rows[i, _T], rows[i, _X], rows[i, _Y] = name[k], t, xy[k, 0], xy[k, 1]
        rows[i, _VX], rows[i, _VY] = velocity[k, 0], velocity[k, 1]
    state[0] = count
    variance: float = state[1] / (4.0 * math.log(2.0))
    return variance if variance > _LEAST else 0.0
