"""How well predictions have held: where each track was foretold to be, beside where it is a little later."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base import records
from antway.kernels.base.jit import kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, SIGMA_V, VX, VY, X, Y

# columns of a row: name, when seen, since when a place is foretold, for when, that place, and the errors
_NAME, _SEEN, _SINCE, _DUE, _X, _Y, _ERROR, _COMPARED = range(8)
COLUMNS = 8
LATER = 0.8  # s after which a foretold place is compared with the true one
_KEPT, _POOL_KEPT = 0.8, 0.95  # what is left of old errors, of one track and of all, at each comparison
_POOL_WEIGHT = 2.0  # comparisons of its own that the errors of all tracks count as
_LOST = 1.0  # s
_AXIS = math.sqrt(2.0 / math.pi)  # standard deviation along an axis of what is normal, for a mean distance of 1
# Of all tracks: the mean error, m/s, and how many were compared. A mean of distances, not of squares: what turns at once, and
# else goes straight, is not foretold badly all the time.
MEAN, SEEN = range(2)
FIRST = 0.1 / _AXIS  # m/s; that mean before any was compared, as of people


@kernel
def compared(
    rows: NDArray[np.float64],
    count: int,
    pool: NDArray[np.float64],
    estimates: NDArray[np.float64],
    t: float,
    out: NDArray[np.float64],
) -> int:
    """Write how wrong velocities foretold have been, along one axis, m/s; returns how many rows are in use.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        What is known of each track, rows below `count`.
    pool : float64[2]
        Of all tracks, see MEAN and SEEN.
    estimates : float64[K, 8]
        As in kernels/tracking/predict.py, at time `t` s.
    out : float64[K]
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
            step = max(1.0 - _POOL_KEPT, 1.0 / (1.0 + pool[SEEN]))  # what it begins with counts as one
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
    """Note where tracks will be `LATER` s after `t`, of all for which that is not noted yet.

    Parameters
    ----------
    rows, count, estimates, t
        As of `compared`, but with the velocities' standard deviations as the filter has them.
    segments : float64[P, 8]
        What `predict` made of the estimates: those of one track after those of another, walls and whom it avoids included.
    """
    first = 0
    for k in range(len(estimates)):
        last = first + 1  # behind the track's last segment
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
