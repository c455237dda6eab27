"""Errors of earlier predictions: each track's predicted place is compared with its place a little later."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base import records
from antway.kernels.base.jit import kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, SIGMA_V, VX, VY, X, Y

# Columns of a row: the track's name, when it was last seen, when its place was predicted, for which time, that place, the
# weighted sum of its errors, and the weighted number of comparisons.
_NAME, _SEEN, _SINCE, _DUE, _X, _Y, _ERROR, _COMPARED = range(8)
COLUMNS = 8
LATER = 0.8  # s; a predicted place is compared with the true one after this time
_KEPT = 0.8  # 1; each comparison multiplies the weight of the track's earlier errors by this
_POOL_KEPT = 0.95  # 1; each comparison multiplies the weight of the earlier errors of all tracks by this
_POOL_WEIGHT = 2.0  # the mean error of all tracks counts like this many comparisons of the track itself
_LOST = 1.0  # s; a row whose track was not seen for longer is dropped
_AXIS = math.sqrt(2.0 / math.pi)  # 1; standard deviation along one axis of a normal error whose mean distance is 1
# Entries of `pool`: the mean error of all tracks in m/s, and the number of comparisons. The mean is of distances, not of
# squares, so that one sudden turn does not dominate the errors of a track that otherwise goes straight.
MEAN, SEEN = range(2)
FIRST = 0.1 / _AXIS  # m/s; the mean error before the first comparison is that of people


@kernel
def compared(
    rows: NDArray[np.float64],
    count: int,
    pool: NDArray[np.float64],
    estimates: NDArray[np.float64],
    t: float,
    out: NDArray[np.float64],
) -> int:
    """Write the standard deviation of each track's predicted velocity along one axis, m/s; return how many rows are in use.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        The tracks known so far are the rows below `count`.
    pool : float64[2]
        Errors of all tracks together, see MEAN and SEEN.
    estimates : float64[K, 8]
        As in kernels/tracking/predict.py, at time `t` s.
    out : float64[K]
        Filled.
    """
    kept = 0
    for i in range(count):
        if t - rows[i, _SEEN] <= _LOST:
            if kept != i:
                copy_row(rows[i], rows[kept])
            kept += 1
    count = kept
    for k in range(len(estimates)):
        i = 0
        while i < count and rows[i, _NAME] != estimates[k, NAME]:
            i += 1
        out[k] = _AXIS * pool[MEAN]
        if estimates[k, NAME] < 0.0 or i == len(rows):
            continue
        row = rows[i]
        if i == count:
            count += 1
            row[:] = 0.0
            row[_NAME], row[_DUE] = estimates[k, NAME], -math.inf
        over = t - row[_DUE]
        if -1e-6 < over < 0.5 * LATER:
            x, y = estimates[k, X] - estimates[k, VX] * over - row[_X], estimates[k, Y] - estimates[k, VY] * over - row[_Y]
            off = math.hypot(x, y) / (row[_DUE] - row[_SINCE])
            row[_ERROR] = _KEPT * row[_ERROR] + off
            row[_COMPARED] = _KEPT * row[_COMPARED] + 1.0
            pool[SEEN] += 1.0
            step = max(1.0 - _POOL_KEPT, 1.0 / (1.0 + pool[SEEN]))  # the first value of the mean counts as one comparison
            pool[MEAN] += step * (off - pool[MEAN])
        if over > -1e-6:
            row[_DUE] = -math.inf
        row[_SEEN] = t
        out[k] = _AXIS * (row[_ERROR] + _POOL_WEIGHT * pool[MEAN]) / (row[_COMPARED] + _POOL_WEIGHT)
    return count


@kernel
def foretell(
    rows: NDArray[np.float64], count: int, estimates: NDArray[np.float64], t: float, segments: NDArray[np.float64]
) -> None:
    """Store the place predicted for `LATER` s after `t` of each track that has no stored prediction.

    Parameters
    ----------
    rows, count, estimates, t
        As in `compared`; SIGMA_V is the standard deviation that the filter gives.
    segments : float64[P, 8]
        The motion segments that `predict` wrote for these estimates, track after track.
    """
    first = 0
    for k in range(len(estimates)):
        last = first + 1  # one past the last segment of the track
        while last < len(segments) and segments[last, records.T0] >= segments[last - 1, records.T1]:
            last += 1
        start, first = first, last
        i = 0
        while i < count and rows[i, _NAME] != estimates[k, NAME]:
            i += 1
        if i == count or rows[i, _DUE] > -math.inf or estimates[k, SIGMA_V] >= UNKNOWN:
            continue
        for p in range(start, min(last, len(segments))):
            due = t + LATER
            if segments[p, records.T0] <= due < segments[p, records.T1]:
                rows[i, _SINCE], rows[i, _DUE] = t, due
                rows[i, _X] = segments[p, records.X] + segments[p, records.VX] * (due - segments[p, records.T0])
                rows[i, _Y] = segments[p, records.Y] + segments[p, records.VY] * (due - segments[p, records.T0])
