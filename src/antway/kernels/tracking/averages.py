"""Choose for each track the velocity that predicts it best: the last one, an average over time, or one with companions.

Places that are measured with a small error give velocities with a large one, and people sway; whatever turns at once is
predicted best by its last velocity. People who walk together keep one velocity, so that each tells something about the others.
Each of these models is judged by its errors (kernels/tracking/prediction_error.py). Where a track bounces off a wall, its
averages are mirrored as well. Where its last velocity shows that somebody has stopped, set out or turned, they may begin anew.
"""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.geometry import reflected
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.changes import N_X, N_Y, row_to_compare
from antway.kernels.tracking.predict import SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.prediction_error import (
    LATER,
    add_error,
    add_to_pool,
    count_comparison,
    summed_error,
    velocity_error,
)
from antway.kernels.tracking.table import SEEN, Table, drop_lost

TIMES = (0.4, 1.2)  # s; velocities are averaged over these times, weights fall with age; 0.4 to 1.2 s fit eth and citr best
MODELS = len(TIMES) + 2  # the last velocity, those averages, and the mean of the first average and that of companions
COMPANION_DISTANCE = 2.5  # m; companions are no farther apart than this
COMPANION_SPEED = 0.7  # m/s; the averages of companions differ by no more than this
# Columns of a row after TRACK_ID and SEEN: the sums (x, y, weight) of each average, the mean average of companions; when and
# where each model predicted from, and its velocity then. The last POOL are its errors (see `count_comparison`).
_SUMS = 2
_COMPANIONS = _SUMS + 3 * len(TIMES)
_SINCE = _COMPANIONS + 2
_FROM = _SINCE + 1
_VELOCITIES = _FROM + 2
POOL = MODELS + 1  # entries of `pool`
COLUMNS = _VELOCITIES + 2 * MODELS + POOL
_SUDDEN = 0.7  # m/s; an average begins anew where the last velocity differs from it by more: people seldom turn by so much
_STOPS = 0.5  # m/s; an average begins anew where the last velocity is slower by more than this, because somebody stops
_STANDS = 0.3  # m/s; below this average somebody stands, and sets out where the last velocity differs from it by _STOPS
_NOISE = 3.0  # 1; a difference of fewer standard deviations of the last velocity may be noise, and begins no average
_BETTER = 0.9  # 1; another model replaces the last velocity if its error is below this share


@kernel
def averaged(
    table: Table, pool: Floats, estimates: Floats, seen: Bools, changes: Floats, t: float, restart: bool, out: Floats
) -> None:
    """Copy `estimates`, float64[K, 8] (kernels/tracking/predict.py), to `out` with the velocities that predict best at `t` s.

    `seen`, bool[K], tells which of them the scan shows; the others keep their averages. `table` has the tracks known so far,
    [M, COLUMNS]; `pool`, float64[POOL], is that of `add_to_pool`, zeros at first; and `changes`, float64[K, 4], are those
    of `velocity_changes`. If `restart`, averages begin anew where somebody stops, sets out or turns. A robot with inertia
    needs to know that at once, though places a second and more ahead are predicted a little worse by it.
    """
    rows = table.rows
    drop_lost(table, t)
    row_at = np.full(len(estimates), -1)  # the row of each estimate, or -1 if it has none
    for k in range(len(estimates)):
        copy_row(estimates[k], out[k])
        i, is_new = row_to_compare(table, estimates[k], seen[k])
        if i < 0:
            continue
        row_at[k] = i
        if is_new:
            rows[i, SEEN], rows[i, _SINCE] = t, -math.inf
        elif changes[k, N_X] != 0.0 or changes[k, N_Y] != 0.0:
            _mirror(rows[i], changes[k, N_X], changes[k, N_Y])
        if not seen[k]:
            continue
        dt = t - rows[i, SEEN]
        _average(rows[i], estimates[k, VX], estimates[k, VY], dt, is_new)
        if restart and dt > 0.0:
            noise = _NOISE * math.hypot(estimates[k, SIGMA_V], velocity_error(rows[i], pool, 0))
            _restart_averages(rows[i], estimates[k, VX], estimates[k, VY], dt, noise)
    _average_companions(rows, row_at, estimates)
    scan = np.zeros(POOL)
    for k in range(len(estimates)):
        if row_at[k] >= 0 and seen[k]:
            row = rows[row_at[k]]
            if t > row[SEEN] or row[_SINCE] == -math.inf:
                _compare(row, scan, estimates[k], t)
            row[SEEN] = t
    add_to_pool(pool, scan)
    for k in range(len(estimates)):
        if row_at[k] < 0:
            continue
        row = rows[row_at[k]]
        best, least = 0, _BETTER * summed_error(row, pool, 0)
        for m in range(1, MODELS):
            if summed_error(row, pool, m) < least:
                best, least = m, summed_error(row, pool, m)
        out[k, VX], out[k, VY] = _velocity(row, best, estimates[k, VX], estimates[k, VY])
        out[k, SIGMA_V] = math.hypot(estimates[k, SIGMA_V], velocity_error(row, pool, best))


@bare_kernel
def _mirror(row: Floats, n_x: float, n_y: float) -> None:
    """Mirror the averages of a track that has bounced off a wall with this normal, and compare no earlier prediction."""
    row[_SINCE] = -math.inf
    for m in range(len(TIMES)):
        c = _SUMS + 3 * m
        row[c], row[c + 1] = reflected(row[c], row[c + 1], n_x, n_y)


@bare_kernel
def _average(row: Floats, vx: float, vy: float, dt: float, is_new: bool) -> None:
    """Take a velocity, `dt` s after the one before, into the averages of a track."""
    if dt <= 0.0 and not is_new:
        return
    for m in range(len(TIMES)):
        c = _SUMS + 3 * m
        old, weight = math.exp(-dt / TIMES[m]), 1.0 if is_new else 1.0 - math.exp(-dt / TIMES[m])
        row[c], row[c + 1], row[c + 2] = row[c] * old + vx * weight, row[c + 1] * old + vy * weight, row[c + 2] * old + weight


@bare_kernel
def _restart_averages(row: Floats, vx: float, vy: float, dt: float, noise: float) -> None:
    """Let those averages of a track begin anew from which its last velocity differs too much, and by more than `noise` m/s."""
    for m in range(len(TIMES)):
        c = _SUMS + 3 * m
        x, y = _average_over(row, m)
        speed, change = math.hypot(x, y), math.hypot(vx - x, vy - y)
        paused = change if speed < _STANDS else speed - (vx * x + vy * y) / speed
        if change > max(_SUDDEN, noise) or paused > max(_STOPS, noise):
            weight = 1.0 - math.exp(-dt / TIMES[m])
            row[c], row[c + 1], row[c + 2] = vx * weight, vy * weight, weight


@bare_kernel
def _average_companions(rows: Floats, row_at: Ints, estimates: Floats) -> None:
    """Store for each track the mean of the first averages of its companions and itself."""
    for k in range(len(row_at)):
        if row_at[k] < 0:
            continue
        x, y, n = 0.0, 0.0, 0
        own_x, own_y = _average_over(rows[row_at[k]], 0)
        for j in range(len(row_at)):
            dx, dy = estimates[j, X] - estimates[k, X], estimates[j, Y] - estimates[k, Y]
            if max(abs(dx), abs(dy)) > COMPANION_DISTANCE:  # most are, and this is faster than the distance
                continue
            if row_at[j] >= 0 and math.hypot(dx, dy) <= COMPANION_DISTANCE:
                vx, vy = _average_over(rows[row_at[j]], 0)
                if math.hypot(vx - own_x, vy - own_y) <= COMPANION_SPEED:
                    x, y, n = x + vx, y + vy, n + 1
        rows[row_at[k], _COMPANIONS], rows[row_at[k], _COMPANIONS + 1] = x / n, y / n


@bare_kernel
def _compare(row: Floats, scan: Floats, estimate: Floats, t: float) -> None:
    """Compare where each model predicted a track with where it is, if that is due, and predict anew."""
    since = t - row[_SINCE]
    if since < LATER - 1e-6:
        return
    if since < 2.0 * LATER:
        count_comparison(row, scan)
        for m in range(MODELS):
            x, y = row[_FROM] + row[_VELOCITIES + 2 * m] * since, row[_FROM + 1] + row[_VELOCITIES + 2 * m + 1] * since
            add_error(row, scan, m, math.hypot(estimate[X] - x, estimate[Y] - y) / since)
    row[_SINCE], row[_FROM], row[_FROM + 1] = t, estimate[X], estimate[Y]
    for m in range(MODELS):
        row[_VELOCITIES + 2 * m], row[_VELOCITIES + 2 * m + 1] = _velocity(row, m, estimate[VX], estimate[VY])


@bare_kernel
def _velocity(row: Floats, model: int, vx: float, vy: float) -> tuple[float, float]:
    """Return the velocity of a model, for a track whose last velocity is (vx, vy)."""
    if model == 0:
        return vx, vy
    if model == MODELS - 1:
        x, y = _average_over(row, 0)
        return 0.5 * (x + row[_COMPANIONS]), 0.5 * (y + row[_COMPANIONS + 1])
    return _average_over(row, model - 1)


@bare_kernel
def _average_over(row: Floats, m: int) -> tuple[float, float]:
    """Return the average velocity over TIMES[m]."""
    c = _SUMS + 3 * m
    return row[c] / row[c + 2], row[c + 1] / row[c + 2]
