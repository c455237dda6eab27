"""Which average of a track's velocity foretells it best: the last one alone, or what it was over some time.

Places that are measured a little wrongly make velocities that are quite wrong, and people sway; whatever turns at once is
foretold best by what it does now. So each average is weighed by how well it has foretold where tracks were a little later.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import NAME, SIGMA_V, VX, VY, X, Y

TIMES = (0.4, 1.2)  # s; over which velocities are averaged, weights falling with age; 0.4 to 1.2 s fit eth and citr best
MODELS = len(TIMES) + 1  # the last velocity, and those averages
# columns of a row: name, when seen, for each average its sums (x, y, weight); since when and from where each model foretells,
# its velocity then, and its errors
_NAME, _SEEN, _SUMS = 0, 1, 2
_SINCE = _SUMS + 3 * len(TIMES)
_FROM = _SINCE + 1
_VELOCITIES = _FROM + 2
_ERROR = _VELOCITIES + 2 * MODELS
_COMPARED = _ERROR + MODELS
COLUMNS = _COMPARED + 1
_LATER = 0.8  # s after which a foretold place is compared with the true one
_KEPT, _POOL_KEPT = 0.8, 0.95  # what is left of old errors, of one track and of all, at each comparison
_POOL_WEIGHT = 2.0  # comparisons of its own that the errors of all tracks count as
_BETTER = 0.9  # an average is taken if its error is smaller by that than that of the last velocity
_LOST = 1.0  # s


@kernel
def averaged(
    rows: NDArray[np.float64],
    count: int,
    pool: NDArray[np.float64],
    estimates: NDArray[np.float64],
    t: float,
    out: NDArray[np.float64],
) -> int:
    """Copy `estimates` to `out` with the velocities that foretell best; returns how many rows are in use.

    Parameters
    ----------
    rows : float64[M, COLUMNS]
        What is known of each track, rows below `count`.
    pool : float64[MODELS]
        Errors of each model over all tracks.
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
    for k in range(len(estimates)):
        copy_row(estimates[k], out[k])
        if estimates[k, NAME] < 0.0 or estimates[k, SIGMA_V] >= UNKNOWN:
            continue
        i = 0
        while i < count and rows[i, _NAME] != estimates[k, NAME]:
            i += 1
        if i == len(rows):
            continue
        row, vx, vy = rows[i], estimates[k, VX], estimates[k, VY]
        fresh = i == count
        if fresh:
            count += 1
            row[:] = 0.0
            row[_NAME], row[_SEEN], row[_SINCE] = estimates[k, NAME], t, -math.inf
        dt = t - row[_SEEN]
        if dt > 0.0 or fresh:
            for m in range(len(TIMES)):
                c = _SUMS + 3 * m
                old, weight = math.exp(-dt / TIMES[m]), 1.0 if fresh else 1.0 - math.exp(-dt / TIMES[m])
                row[c], row[c + 1], row[c + 2] = (
                    row[c] * old + vx * weight,
                    row[c + 1] * old + vy * weight,
                    row[c + 2] * old + weight,
                )
            since = t - row[_SINCE]
            if since >= _LATER - 1e-6:
                if since < 2.0 * _LATER:
                    for m in range(MODELS):
                        x, y = (
                            row[_FROM] + row[_VELOCITIES + 2 * m] * since,
                            row[_FROM + 1] + row[_VELOCITIES + 2 * m + 1] * since,
                        )
                        off = ((estimates[k, X] - x) ** 2 + (estimates[k, Y] - y) ** 2) / (since * since)
                        row[_ERROR + m] = _KEPT * row[_ERROR + m] + off
                        pool[m] = _POOL_KEPT * pool[m] + (1.0 - _POOL_KEPT) * off
                    row[_COMPARED] = _KEPT * row[_COMPARED] + 1.0
                row[_SINCE], row[_FROM], row[_FROM + 1] = t, estimates[k, X], estimates[k, Y]
                for m in range(MODELS):
                    row[_VELOCITIES + 2 * m], row[_VELOCITIES + 2 * m + 1] = _velocity(row, m, vx, vy)
        row[_SEEN] = t
        best, least = 0, _BETTER * (row[_ERROR] + _POOL_WEIGHT * pool[0])
        for m in range(1, MODELS):
            if row[_ERROR + m] + _POOL_WEIGHT * pool[m] < least:
                best, least = m, row[_ERROR + m] + _POOL_WEIGHT * pool[m]
        out[k, VX], out[k, VY] = _velocity(row, best, vx, vy)
        squared = 0.5 * (row[_ERROR + best] + _POOL_WEIGHT * pool[best]) / (row[_COMPARED] + _POOL_WEIGHT)
        out[k, SIGMA_V] = math.sqrt(estimates[k, SIGMA_V] ** 2 + squared)
    return count


@kernel
def _velocity(row: NDArray[np.float64], model: int, vx: float, vy: float) -> tuple[float, float]:
    """Velocity of a model."""
    c = _SUMS + 3 * (model - 1)
    return (vx, vy) if model == 0 else (row[c] / row[c + 2], row[c + 1] / row[c + 2])
