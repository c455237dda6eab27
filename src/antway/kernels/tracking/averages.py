"""Which average of a track's velocity foretells it best: the last one, what it was over some time, or that of its companions.

Places that are measured a little wrongly make velocities that are quite wrong, and people sway; whatever turns at once is
predicted best by its last velocity. People who walk together keep one velocity, so that each tells something about the others.
Each model is weighed by the mean distance between where it predicted tracks and where they were a little later; a mean of
distances, not of squares, for whatever turns at once and else goes straight is predicted exactly most of the time.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, SIGMA_V, VX, VY, X, Y

TIMES = (0.4, 1.2)  # s; velocities are averaged over these times, weights fall with age; 0.4 to 1.2 s fit eth and citr best
MODELS = len(TIMES) + 2  # the last velocity, those averages, and the first average mixed with that of companions
TOGETHER, ALIKE = 2.5, 0.7  # m, m/s; companions are no farther apart, and their averages differ by no more
# columns of a row: name, when seen, for each average its sums (x, y, weight), the average of companions; since when and from
# where each model predicts, its velocity then, and its errors
_NAME, _SEEN, _SUMS = 0, 1, 2
_TOGETHER = _SUMS + 3 * len(TIMES)
_SINCE = _TOGETHER + 2
_FROM = _SINCE + 1
_VELOCITIES = _FROM + 2
_ERROR = _VELOCITIES + 2 * MODELS
_COMPARED = _ERROR + MODELS
COLUMNS = _COMPARED + 1
_LATER = 0.8  # s; a predicted place is compared with the true one so much later
_KEPT, _POOL_KEPT = 0.8, 0.95  # share of old errors that is kept at each comparison: of one track, and of all
_POOL_WEIGHT = 2.0  # the errors of all tracks count as so many comparisons of its own
_BETTER = 0.9  # a model is taken in place of the last velocity if its error is smaller by this factor
_LOST = 1.0  # s; a track that is not seen for longer is forgotten
_AXIS = math.sqrt(2.0 / math.pi)  # standard deviation along an axis of a normal error whose mean distance is 1
POOL = MODELS + 1  # entries of `pool`: mean errors of the models over all tracks, m/s, and how many comparisons there were


@kernel
def averaged(
    rows: NDArray[np.float64],
    count: int,
    pool: NDArray[np.float64],
    estimates: NDArray[np.float64],
    t: float,
    out: NDArray[np.float64],
) -> int:
    """Copy `estimates` to `out` with the velocities that predict best; returns how many rows are in use.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        What is known of each track, rows below `count`.
    pool : float64[POOL]
        Mean error of each model over all tracks, m/s, and the number of comparisons; zeros at first.
    estimates, out : float64[K, 8]
        As in kernels/tracking/predict.py, at time `t` s.
    """
    kept = 0
    for i in range(count):
        if t - rows[i, _SEEN] <= _LOST:
            if kept != i:
                copy_row(rows[i], rows[kept])
            kept += 1
    count = kept
    at = np.full(len(estimates), -1)
    for k in range(len(estimates)):
        copy_row(estimates[k], out[k])
        if estimates[k, NAME] < 0.0 or estimates[k, SIGMA_V] >= UNKNOWN:
            continue
        i = 0
        while i < count and rows[i, _NAME] != estimates[k, NAME]:
            i += 1
        if i == len(rows):
            continue
        at[k] = i
        fresh = i == count
        if fresh:
            count += 1
            rows[i] = 0.0
            rows[i, _NAME], rows[i, _SEEN], rows[i, _SINCE] = estimates[k, NAME], t, -math.inf
        _average(rows[i], estimates[k, VX], estimates[k, VY], t - rows[i, _SEEN], fresh)
    _companions(rows, at, estimates)
    for k in range(len(estimates)):
        if at[k] < 0:
            continue
        row = rows[at[k]]
        if t > row[_SEEN] or row[_SINCE] == -math.inf:
            _compare(row, pool, estimates[k], t)
        row[_SEEN] = t
        best, least = 0, _BETTER * (row[_ERROR] + _POOL_WEIGHT * pool[0])
        for m in range(1, MODELS):
            if row[_ERROR + m] + _POOL_WEIGHT * pool[m] < least:
                best, least = m, row[_ERROR + m] + _POOL_WEIGHT * pool[m]
        out[k, VX], out[k, VY] = _velocity(row, best, estimates[k, VX], estimates[k, VY])
        off = _AXIS * (row[_ERROR + best] + _POOL_WEIGHT * pool[best]) / (row[_COMPARED] + _POOL_WEIGHT)
        out[k, SIGMA_V] = math.hypot(estimates[k, SIGMA_V], off)
    return count


@bare_kernel
def _average(row: NDArray[np.float64], vx: float, vy: float, dt: float, fresh: bool) -> None:
    """Take a velocity, `dt` s after the one before, into the averages of a track."""
    if dt <= 0.0 and not fresh:
        return
    for m in range(len(TIMES)):
        c = _SUMS + 3 * m
        old, weight = math.exp(-dt / TIMES[m]), 1.0 if fresh else 1.0 - math.exp(-dt / TIMES[m])
        row[c], row[c + 1], row[c + 2] = row[c] * old + vx * weight, row[c + 1] * old + vy * weight, row[c + 2] * old + weight


@bare_kernel
def _companions(rows: NDArray[np.float64], at: NDArray[np.int64], estimates: NDArray[np.float64]) -> None:
    """Note for each track the mean of its companions' first averages, its own among them; `at` is each one's row, or -1."""
    for k in range(len(at)):
        if at[k] < 0:
            continue
        x, y, n = 0.0, 0.0, 0
        own_x, own_y = _velocity(rows[at[k]], 1, 0.0, 0.0)
        for j in range(len(at)):
            if at[j] >= 0 and math.hypot(estimates[j, X] - estimates[k, X], estimates[j, Y] - estimates[k, Y]) <= TOGETHER:
                vx, vy = _velocity(rows[at[j]], 1, 0.0, 0.0)
                if math.hypot(vx - own_x, vy - own_y) <= ALIKE:
                    x, y, n = x + vx, y + vy, n + 1
        rows[at[k], _TOGETHER], rows[at[k], _TOGETHER + 1] = x / n, y / n


@bare_kernel
def _compare(row: NDArray[np.float64], pool: NDArray[np.float64], estimate: NDArray[np.float64], t: float) -> None:
    """Compare where each model predicted a track with where it is, if that is due, and predict anew."""
    since = t - row[_SINCE]
    if since < _LATER - 1e-6:
        return
    if since < 2.0 * _LATER:
        pool[MODELS] += 1.0
        step = max(1.0 - _POOL_KEPT, 1.0 / pool[MODELS])
        for m in range(MODELS):
            x, y = row[_FROM] + row[_VELOCITIES + 2 * m] * since, row[_FROM + 1] + row[_VELOCITIES + 2 * m + 1] * since
            off = math.hypot(estimate[X] - x, estimate[Y] - y) / since
            row[_ERROR + m] = _KEPT * row[_ERROR + m] + off
            pool[m] += step * (off - pool[m])
        row[_COMPARED] = _KEPT * row[_COMPARED] + 1.0
    row[_SINCE], row[_FROM], row[_FROM + 1] = t, estimate[X], estimate[Y]
    for m in range(MODELS):
        row[_VELOCITIES + 2 * m], row[_VELOCITIES + 2 * m + 1] = _velocity(row, m, estimate[VX], estimate[VY])


@bare_kernel
def _velocity(row: NDArray[np.float64], model: int, vx: float, vy: float) -> tuple[float, float]:
    """Velocity of a model, for a track whose last velocity is (vx, vy)."""
    if model == 0:
        return vx, vy
    if model == MODELS - 1:
        x, y = _velocity_over(row, 0)
        return 0.5 * (x + row[_TOGETHER]), 0.5 * (y + row[_TOGETHER + 1])
    return _velocity_over(row, model - 1)


@bare_kernel
def _velocity_over(row: NDArray[np.float64], m: int) -> tuple[float, float]:
    """Average velocity over TIMES[m]."""
    c = _SUMS + 3 * m
    return row[c] / row[c + 2], row[c + 1] / row[c + 2]
