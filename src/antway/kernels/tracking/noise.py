"""Estimate the noise of measured places and velocities where the sensor states none.

Each place is compared with the last measured place of the track moved on by the measured velocities or, where the sensor
measures none, by the velocity between its last two places. Each velocity is compared with the last one.
"""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.tracking.table import SEEN, TRACK_ID, Table, by_id, row_or_oldest

# Columns of a row after TRACK_ID and SEEN: the last measurement of a track, and the time between its last two, NaN where there
# was one.
_X, _Y, _VX, _VY, _DT = range(2, 7)
COLUMNS = 7
# Entries of `state`: the medians of the squared innovations, m^2, and of the squared changes of velocity, m^2/s^2; from RUN on,
# how many of either were large and above the median one after another; the time between the scans compared last, s; the number
# of innovations, and how many of the first ones show errors of places; and from FIRST on, the first squared innovations and the
# first squared changes.
PLACE, VELOCITY, RUN, _, BETWEEN, COUNT, SHOW, FIRST = range(8)
_FIRST_ONES = 16  # number of the first innovations and of the first changes that are kept
STATE = FIRST + 2 * _FIRST_ONES
MEDIAN = 4.0 * math.log(2.0)  # 1; the median of the squared innovations by the variance of measured places
LEAST = 1e-8  # m^2; a smaller variance counts as none
EXACT = 1e-4  # m^2; while the variance of places is smaller, velocities count as exact: what changes is how people sway.
_STEP = 0.1  # 1; each innovation changes the logarithm of the median by this, ...
_ENOUGH = 8  # ... and by two, three times this and so on from the tenth of a run of large ones on.
_FIRST_STEPS = 2.0  # 1; the n-th innovation without measured velocities changes it by this / n, if that is more than `_STEP`.
_UNSEEN = MEDIAN * 0.05**2  # m^2; the median at first, if velocities are not measured: less would give wrong ones
_FEW = 6  # 1; from so many innovations on, while all are kept, their median counts, if most show more than `EXACT`.
_FAR = 0.5  # s; an older measurement is not compared


@kernel
def measured_noise(
    rows: Floats, used: Ints, state: Floats, t: float, track_id: Ints, xy: Floats, velocity: Floats
) -> tuple[float, float]:
    """Return the variances of measured places, m^2, and velocities, m^2/s^2, along one axis after one more scan.

    That of places is 0 while it is below (0.1 mm)^2, and that of velocities while that of places is below (1 cm)^2. The table
    with the last measurement of each track is given by `rows`, float64[M, COLUMNS], and `used`, int64[1]; Python hands on two
    arrays faster than the record. `state`, float64[STATE], is described at PLACE and the others above; zeros at first. The scan
    is as in kernels/tracking/kalman.py.

    The innovation is the difference of two measured places less the motion between them. With noise of variance R along each
    axis, its squared length has the mean 4 R and the median 4 R ln 2. Where velocities are not measured, but taken from the two
    places before, its mean is 2 R (1 + (1 + r)^2 + r^2), where r is the ratio of the two times between; it is scaled to 4 R.
    The median is tracked by small steps up and down, so that an occasional turn or jump has little effect. It would take a
    second to come up from 0, so of 6 to 16 innovations it is the median itself, if most of them show places that are wrong by
    more than 1 cm. An innovation of half the change of velocity, times the time between, shows only that this change came then.

    The change of a velocity with noise of variance R has the same median. But people change theirs as well: velocities that are
    wrong lead to wrong places, so their variance is at most that of the innovations' mean velocity, 4 R / dt^2 of places.
    """
    for k in by_id(track_id):
        vx, vy, dt = velocity[k, 0], velocity[k, 1], math.nan
        measured = not math.isnan(vx + vy)
        if not measured and state[PLACE] == 0.0:
            state[PLACE] = _UNSEEN
        i, is_new = row_or_oldest(Table(rows, used, TRACK_ID), float(track_id[k]))
        row = rows[i]
        if not is_new:
            dt = t - row[SEEN]
            if dt <= 0.0:
                continue  # this scan was processed before
            dx, dy, scale = xy[k, 0] - row[_X], xy[k, 1] - row[_Y], 1.0
            old_vx, old_vy, ratio, change = row[_VX], row[_VY], dt / row[_DT], math.nan
            if not measured:
                vx, vy, scale = dx / dt, dy / dt, 2.0 / (1.0 + (1.0 + ratio) ** 2 + ratio**2)
            else:
                change = (vx - old_vx) ** 2 + (vy - old_vy) ** 2
                old_vx, old_vy = 0.5 * (old_vx + vx), 0.5 * (old_vy + vy)
            ex, ey = dx - old_vx * dt, dy - old_vy * dt
            squared = scale * (ex * ex + ey * ey)
            if dt <= _FAR and not math.isnan(squared):
                state[COUNT] += 1.0
                _step(state, PLACE, squared, EXACT, _STEP if measured else max(_STEP, _FIRST_STEPS / state[COUNT]))
                if measured:
                    _step(state, VELOCITY, change, 0.0, _STEP)
                    state[BETWEEN] = dt
                    _count_first(state, squared, change, dt)
        row[TRACK_ID], row[SEEN], row[_DT] = track_id[k], t, dt
        row[_X], row[_Y], row[_VX], row[_VY] = xy[k, 0], xy[k, 1], vx, vy
    variance = state[PLACE] / MEDIAN
    if variance <= EXACT or state[BETWEEN] == 0.0:
        return (variance if variance > LEAST else 0.0), 0.0
    return variance, min(state[VELOCITY] / MEDIAN, 4.0 * variance / state[BETWEEN] ** 2)


@kernel
def _count_first(state: Floats, squared: float, change: float, dt: float) -> None:
    """Take in one of the first innovations and the change of velocity over the same `dt` s, both squared."""
    count, changes = int(state[COUNT]), FIRST + _FIRST_ONES
    if count > _FIRST_ONES:
        return
    state[FIRST + count - 1], state[changes + count - 1] = squared, change
    if math.sqrt(squared) - 0.5 * math.sqrt(change) * dt > math.sqrt(MEDIAN * EXACT):
        state[SHOW] += 1.0
    if count >= _FEW and 2.0 * state[SHOW] > count:
        state[PLACE] = float(np.median(state[FIRST : FIRST + count]))
        state[VELOCITY] = float(np.median(state[changes : changes + count]))


@bare_kernel
def _step(state: Floats, entry: int, value: float, large: float, step: float) -> None:
    """Let a median in `state` take a step, of its logarithm, towards a value; a longer one after a run of `large` values."""
    above, run = value > state[entry], entry + RUN
    state[run] = state[run] + 1.0 if above and value > large else 0.0
    state[entry] = max(state[entry] * math.exp(step * max(state[run] - _ENOUGH, 1.0) if above else -step), LEAST)
