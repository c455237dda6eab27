"""Errors of earlier predictions: each track's predicted place is compared with its place a little later.

An error is the distance between the two places by the time between them, m/s. Means are of distances, not of squares, so that
one sudden turn does not dominate the errors of a track that otherwise goes straight. A track has too few comparisons of its
own, so the mean error of all tracks, the pool, counts like some more of them.
"""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base import records
from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import ID, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.table import SEEN, Table, drop_lost, known_row, row_of

# Columns of a row after TRACK_ID and SEEN: when the track's place was predicted, for which time, and that place. The last two
# are its errors (see `count_comparison`).
_SINCE, _DUE, _X, _Y = range(2, 6)
COLUMNS = 8
LATER = 0.8  # s; a predicted place is compared with the true one after this time
_KEPT = 0.8  # 1; each comparison multiplies the weight of the track's earlier errors by this
_POOL_KEPT = 0.95  # 1; each comparison multiplies the weight of the earlier errors of all tracks by this
_POOL_WEIGHT = 2.0  # the mean error of all tracks counts like this many comparisons of the track itself
_AXIS = math.sqrt(2.0 / math.pi)  # 1; standard deviation along one axis of a normal error whose mean distance is 1
# The pool before the first comparison: the mean error of people, m/s, which counts as one comparison.
POOL = (0.1 / _AXIS, 1.0)
_MISS = 0.25  # m/s; a larger error is a miss: the obstacle has turned, stopped or set out
_OFTEN = 0.05  # 1; share of misses from which on no prediction is relied on; it is also the share assumed at first
_FIRST = 10.0  # the share assumed at first counts like this many comparisons


@bare_kernel
def count_comparison(row: Floats, scan: Floats) -> None:
    """Count one more comparison of the predictions of M models; `add_error` then adds the error of each model.

    The last M + 1 entries of a track's `row` are the weighted sum of the errors of each model, m/s, and the weighted number of
    comparisons. Those of `scan`, float64[M + 1], are the sums over all comparisons of this scan; zeros at first.
    """
    row[-1] = _KEPT * row[-1] + 1.0
    scan[-1] += 1.0


@bare_kernel
def add_error(row: Floats, scan: Floats, model: int, error: float) -> None:
    """Add the error of a model, m/s, to those of the track and of the scan."""
    row[len(row) - len(scan) + model] = _KEPT * row[len(row) - len(scan) + model] + error
    scan[model] += error


@bare_kernel
def add_to_pool(pool: Floats, scan: Floats) -> None:
    """Add the errors of a scan to those of all tracks, once all of it is compared, so that the order of tracks does not matter.

    `pool`, float64[M + 1], has the mean errors of all tracks, m/s, and the number of comparisons.
    """
    if scan[-1] > 0.0:
        pool[-1] += scan[-1]
        share = max(1.0 - _POOL_KEPT ** scan[-1], scan[-1] / pool[-1])
        for model in range(len(pool) - 1):
            pool[model] += share * (scan[model] / scan[-1] - pool[model])


@bare_kernel
def summed_error(row: Floats, pool: Floats, model: int) -> float:
    """Return the weighted sum of a model's errors for a track, those of all tracks included, m/s."""
    return float(row[len(row) - len(pool) + model] + _POOL_WEIGHT * pool[model])


@bare_kernel
def velocity_error(row: Floats, pool: Floats, model: int) -> float:
    """Return the standard deviation along one axis of the velocity that a model predicts for a track, m/s."""
    return float(_AXIS * summed_error(row, pool, model) / (row[-1] + _POOL_WEIGHT))


def distrust(pool: Floats, missed: Ints) -> float:
    """Return how little to rely on predictions: 1 if one in twenty misses or more, as is assumed at first, 0 if none ever does.

    `pool` and `missed` are those of `compare_predictions`.
    """
    compared = pool[-1] - POOL[-1]
    return float(min((_FIRST * _OFTEN + missed[0]) / (_FIRST + compared) / _OFTEN, 1.0))


@kernel
def compare_predictions(
    table: Table, pool: Floats, missed: Ints, estimates: Floats, seen: Bools, t: float, out: Floats
) -> None:
    """Write the standard deviation of each track's predicted velocity along one axis, m/s, to `out`, float64[K].

    `table` has the tracks known so far, [M, COLUMNS]. `pool`, float64[2], is as in `add_to_pool`, with one model; at first
    it is POOL. `missed`, int64[1], is the number of predictions of all tracks that missed; at first it is 0. The estimates are
    those of kernels/tracking/predict.py at time `t` s; those that the scan does not show, as `seen`, bool[K], tells, are not
    compared: they are where they were predicted.
    """
    drop_lost(table, t)
    scan, row_at = np.zeros(len(pool)), np.full(len(estimates), -1)  # the row of each estimate, or -1 if it has none
    for k in range(len(estimates)):
        i, is_new = known_row(table, estimates[k, ID], seen[k])
        row_at[k] = i
        if i < 0 or not seen[k]:
            continue
        row = table.rows[i]
        if is_new:
            row[_DUE] = -math.inf
        overdue = t - row[_DUE]
        if -1e-6 < overdue < 0.5 * LATER:
            x, y = estimates[k, X] - estimates[k, VX] * overdue, estimates[k, Y] - estimates[k, VY] * overdue
            count_comparison(row, scan)
            error = math.hypot(x - row[_X], y - row[_Y]) / (row[_DUE] - row[_SINCE])
            add_error(row, scan, 0, error)
            missed[0] += int(error > _MISS)
        if overdue > -1e-6:
            row[_DUE] = -math.inf
        row[SEEN] = t
    add_to_pool(pool, scan)
    for k in range(len(estimates)):
        out[k] = velocity_error(table.rows[row_at[k]], pool, 0) if row_at[k] >= 0 else _AXIS * pool[0]


@kernel
def store_predictions(table: Table, estimates: Floats, t: float, segments: Floats) -> None:
    """Store the place predicted for `LATER` s after `t` of each track that has no stored prediction.

    Other than in `compare_predictions`, SIGMA_V of the estimates is the standard deviation that the filter gives. `segments`
    are those that `predict` wrote for these estimates, track after track.
    """
    first = 0
    for k in range(len(estimates)):
        last = first + 1  # one past the last segment of the track
        while last < len(segments) and segments[last, records.T0] >= segments[last - 1, records.T1]:
            last += 1
        start, first = first, last
        i = row_of(table, estimates[k, ID])
        if i < 0 or table.rows[i, _DUE] > -math.inf or estimates[k, SIGMA_V] >= UNKNOWN:
            continue
        row = table.rows[i]
        for p in range(start, min(last, len(segments))):
            due = t + LATER
            if segments[p, records.T0] <= due < segments[p, records.T1]:
                row[_SINCE], row[_DUE] = t, due
                row[_X] = segments[p, records.X] + segments[p, records.VX] * (due - segments[p, records.T0])
                row[_Y] = segments[p, records.Y] + segments[p, records.VY] * (due - segments[p, records.T0])
