"""Estimate the noise of measured places where the sensor states none.

Each place is compared with the last measured place of the track moved on by the measured velocities or, where the sensor
measures none, by the velocity between its last two places.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.tracking.table import row_of

# Columns of a row: the last measurement of a track, and the time between its last two, NaN where there was one.
_NAME, _T, _X, _Y, _VX, _VY, _DT = range(7)
COLUMNS = 7
MEDIAN = 4.0 * math.log(2.0)  # 1; the median of the squared innovations by the variance of measured places
_LEAST = 1e-8  # m^2; a smaller variance counts as none
_STEP = 0.1  # 1; each innovation changes the logarithm of the median by this.
_FIRST_STEPS = 2.0  # 1; the n-th innovation without measured velocities changes it by this / n, if that is more than `_STEP`.
_UNSEEN = MEDIAN * 0.05**2  # m^2; the median at first, if velocities are not measured: less would give wrong ones
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
    state : float64[3]
        Number of rows in use, the median of the squared innovations, m^2, and the number of innovations; zeros at first.
    t, name, xy, velocity
        The scan, as in kernels/tracking/kalman.py; tracks without a name are ignored.

    Notes
    -----
    The innovation is the difference of two measured places less the motion between them. With noise of variance R along each
    axis, its squared length has the mean 4 R and the median 4 R ln 2. Where velocities are not measured, but taken from the two
    places before, its mean is 2 R (1 + (1 + r)^2 + r^2), where r is the ratio of the two times between; it is scaled to 4 R.
    The median is tracked by small steps up and down, so that an occasional turn or jump has little effect.
    """
    count = int(state[0])
    for k in range(len(name)):
        if name[k] < 0:
            continue
        vx, vy, dt = velocity[k, 0], velocity[k, 1], math.nan
        measured = not math.isnan(vx + vy)
        if not measured and state[1] == 0.0:
            state[1] = _UNSEEN
        i = row_of(rows, count, _NAME, float(name[k]))
        if i < count:
            dt = t - rows[i, _T]
            if dt <= 0.0:
                continue  # this scan was processed before
            dx, dy, scale = xy[k, 0] - rows[i, _X], xy[k, 1] - rows[i, _Y], 1.0
            old_vx, old_vy, ratio = rows[i, _VX], rows[i, _VY], dt / rows[i, _DT]
            if not measured:
                vx, vy, scale = dx / dt, dy / dt, 2.0 / (1.0 + (1.0 + ratio) ** 2 + ratio**2)
            else:
                old_vx, old_vy = 0.5 * (old_vx + vx), 0.5 * (old_vy + vy)
            ex, ey = dx - old_vx * dt, dy - old_vy * dt
            squared = scale * (ex * ex + ey * ey)
            if dt <= _FAR and not math.isnan(squared):
                state[2] += 1.0
                step = _STEP if measured else max(_STEP, _FIRST_STEPS / state[2])
                state[1] = max(state[1] * math.exp(step if squared > state[1] else -step), _LEAST)
        elif count < len(rows):
            count += 1
        else:
            i = int(np.argmin(rows[:, _T]))
        rows[i, _NAME], rows[i, _T], rows[i, _X], rows[i, _Y], rows[i, _DT] = name[k], t, xy[k, 0], xy[k, 1], dt
        rows[i, _VX], rows[i, _VY] = vx, vy
    state[0] = count
    variance: float = state[1] / MEDIAN
    return variance if variance > _LEAST else 0.0
