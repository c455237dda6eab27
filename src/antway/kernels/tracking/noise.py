"""Estimate the noise of measured places where the sensor states none.

Each place is compared with the last measured place of the track moved on by the measured velocities or, where the sensor
measures none, by the velocity between its last two places.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.tracking.table import NAMED, SEEN, Table, row_or_oldest

# Columns of a row after NAMED and SEEN: the last measurement of a track, and the time between its last two, NaN where there was
# one.
_X, _Y, _VX, _VY, _DT = range(2, 7)
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
    used: NDArray[np.int64],
    state: NDArray[np.float64],
    t: float,
    name: NDArray[np.int64],
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
) -> float:
    """Return the variance of measured places along one axis, m^2, after one more scan; 0 while it is below (0.1 mm)^2.

    Parameters
    ----------
    rows, used : float64[M, COLUMNS], int64[1]
        Of the table with the last measurement of each track; Python hands on two arrays faster than the record.
    state : float64[2]
        The median of the squared innovations, m^2, and the number of innovations; zeros at first.
    t, name, xy, velocity
        The scan, as in kernels/tracking/kalman.py; tracks without a name are ignored.

    Notes
    -----
    The innovation is the difference of two measured places less the motion between them. With noise of variance R along each
    axis, its squared length has the mean 4 R and the median 4 R ln 2. Where velocities are not measured, but taken from the two
    places before, its mean is 2 R (1 + (1 + r)^2 + r^2), where r is the ratio of the two times between; it is scaled to 4 R.
    The median is tracked by small steps up and down, so that an occasional turn or jump has little effect.
    """
    for k in range(len(name)):
        if name[k] < 0:
            continue
        vx, vy, dt = velocity[k, 0], velocity[k, 1], math.nan
        measured = not math.isnan(vx + vy)
        if not measured and state[0] == 0.0:
            state[0] = _UNSEEN
        i, is_new = row_or_oldest(Table(rows, used, NAMED), float(name[k]))
        row = rows[i]
        if not is_new:
            dt = t - row[SEEN]
            if dt <= 0.0:
                continue  # this scan was processed before
            dx, dy, scale = xy[k, 0] - row[_X], xy[k, 1] - row[_Y], 1.0
            old_vx, old_vy, ratio = row[_VX], row[_VY], dt / row[_DT]
            if not measured:
                vx, vy, scale = dx / dt, dy / dt, 2.0 / (1.0 + (1.0 + ratio) ** 2 + ratio**2)
            else:
                old_vx, old_vy = 0.5 * (old_vx + vx), 0.5 * (old_vy + vy)
            ex, ey = dx - old_vx * dt, dy - old_vy * dt
            squared = scale * (ex * ex + ey * ey)
            if dt <= _FAR and not math.isnan(squared):
                state[1] += 1.0
                step = _STEP if measured else max(_STEP, _FIRST_STEPS / state[1])
                state[0] = max(state[0] * math.exp(step if squared > state[0] else -step), _LEAST)
        row[NAMED], row[SEEN], row[_X], row[_Y], row[_VX], row[_VY], row[_DT] = name[k], t, xy[k, 0], xy[k, 1], vx, vy, dt
    variance: float = state[0] / MEDIAN
    return variance if variance > _LEAST else 0.0
