"""Tracks that turn at a constant rate: they are predicted on a circle where that has been better than a straight line.

The model is that of constant turn rate and velocity (Schubert, Richter and Wanielik: Comparison and evaluation of advanced
motion models for vehicle tracking, Fusion 2008).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Bools, Floats
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.tracking.changes import BEFORE_VX, BEFORE_VY, N_X, N_Y, row_to_compare
from antway.kernels.tracking.crowd import STEPS, straighten
from antway.kernels.tracking.predict import STEP_TIME, VX, VY, X, Y
from antway.kernels.tracking.prediction_error import add_error, add_to_pool, count_comparison, summed_error
from antway.kernels.tracking.table import SEEN, Table, drop_lost

# Columns of a row after TRACK_ID and SEEN: the average turn rate and the weight of what went into it; when and where the models
# predicted from, the velocity of the straight line, and velocity and turn rate of the circle. The last POOL are the errors of
# both (see `count_comparison`).
_RATE = 2
_WEIGHT = _RATE + 1
_SINCE = _RATE + 2
_FROM = _RATE + 3
_LINE = _RATE + 5
_CIRCLE = _RATE + 7
POOL = 3  # entries of `pool`
COLUMNS = _CIRCLE + 3 + POOL
_STRAIGHT, _TURNING = range(2)  # the models
_LATER = 0.4  # s; a predicted place is compared with the true one after this time
_MEMORY = 0.3  # s; turn rates are averaged over this time
_STANDS = 0.05  # m/s; a slower track has no direction that could turn
_JUMP = 4.0  # rad/s; a track that turns faster has changed its direction at once
_BETTER = 0.5  # 1; a track is predicted on a circle if the error of that is below this share
_TURNS_FOR = 1.5  # s; after this time ahead a track that turns is predicted to go along the tangent
_MOST = 32  # only so many tracks are predicted on circles, because the memory for motion segments is limited


class Turning(NamedTuple):
    """What is known of the turns of tracks."""

    table: Table  # [M, COLUMNS]
    pool: Floats  # [POOL] errors of all tracks together, see `add_to_pool`; zeros at first
    rate: Floats  # [M] rad/s; turn rate with which a track is predicted, 0 for a straight line


@kernel
def turn_rates(turning: Turning, estimates: Floats, seen: Bools, straight: Floats, changes: Floats, t: float) -> None:
    """Write to `turning.rate` with which turn rate each track is predicted at time `t` s.

    The estimates are those of kernels/tracking/predict.py, and `seen`, bool[K], tells which of them the scan shows; the others
    are predicted on straight lines from where they were last seen. `straight` is the same with the velocities of these lines; a
    track that turns gets its last velocity there. `changes`, float64[K, 4], are those of `velocity_changes`.
    """
    table, pool, rate = turning
    drop_lost(table, t)
    scan, row_at = np.zeros(POOL), np.full(len(estimates), -1)  # the row of each estimate that is seen, or -1
    for k in range(len(estimates)):
        i, is_new = row_to_compare(table, estimates[k], seen[k])
        if i < 0 or not seen[k]:
            continue
        row_at[k], row = i, table.rows[i]
        if is_new:
            row[_SINCE] = -math.inf
        elif t > row[SEEN]:
            _average(row, estimates[k], changes[k], t - row[SEEN])
            _compare(row, scan, estimates[k], straight[k], t)
        row[SEEN] = t
    add_to_pool(pool, scan)
    for k in range(len(estimates)):
        rate[k], row = 0.0, table.rows[row_at[k]]
        if row_at[k] >= 0 and summed_error(row, pool, _TURNING) < _BETTER * summed_error(row, pool, _STRAIGHT):
            rate[k] = row[_RATE]
            straight[k, VX], straight[k, VY] = estimates[k, VX], estimates[k, VY]


@bare_kernel
def _average(row: Floats, estimate: Floats, change: Floats, dt: float) -> None:
    """Take the turn in the `dt` s since a track was seen last into its average turn rate.

    A bounce mirrors the rate, and a jump of the direction ends the turn; neither is a turn itself.
    """
    vx, vy = change[BEFORE_VX], change[BEFORE_VY]
    if change[N_X] != 0.0 or change[N_Y] != 0.0:
        row[_RATE], row[_SINCE] = -row[_RATE], -math.inf
    turn = 0.0
    if min(math.hypot(vx, vy), math.hypot(estimate[VX], estimate[VY])) > _STANDS:
        turn = math.atan2(vx * estimate[VY] - vy * estimate[VX], vx * estimate[VX] + vy * estimate[VY])
    if abs(turn) > _JUMP * dt:
        row[_RATE], row[_WEIGHT], row[_SINCE] = 0.0, 0.0, -math.inf
        return
    old = math.exp(-dt / _MEMORY) * row[_WEIGHT]
    row[_WEIGHT] = old + 1.0 - math.exp(-dt / _MEMORY)
    row[_RATE] += (1.0 - old / row[_WEIGHT]) * (turn / dt - row[_RATE])


@bare_kernel
def _compare(row: Floats, scan: Floats, estimate: Floats, straight: Floats, t: float) -> None:
    """Compare where both models predicted a track with where it is, if that is due, and predict anew."""
    since = t - row[_SINCE]
    if since < _LATER - 1e-6:
        return
    if since < 2.0 * _LATER:
        ux, uy = (estimate[X] - row[_FROM]) / since, (estimate[Y] - row[_FROM + 1]) / since  # what was its mean velocity
        vx, vy = mean_velocity(row[_CIRCLE], row[_CIRCLE + 1], row[_CIRCLE + 2], 0.0, since)
        count_comparison(row, scan)
        add_error(row, scan, _STRAIGHT, math.hypot(ux - row[_LINE], uy - row[_LINE + 1]))
        add_error(row, scan, _TURNING, math.hypot(ux - vx, uy - vy))
    row[_SINCE], row[_FROM], row[_FROM + 1] = t, estimate[X], estimate[Y]
    row[_LINE], row[_LINE + 1] = straight[VX], straight[VY]
    row[_CIRCLE], row[_CIRCLE + 1], row[_CIRCLE + 2] = estimate[VX], estimate[VY], row[_RATE]


@bare_kernel
def mean_velocity(vx: float, vy: float, rate: float, start: float, end: float) -> tuple[float, float]:
    """Return the mean velocity from `start` to `end` s ahead of a track that turns at `rate` rad/s."""
    half, middle = 0.5 * rate * (end - start), 0.5 * rate * (start + end)
    shorter = math.sin(half) / half if abs(half) > 1e-9 else 1.0  # the chord of the arc by its length
    c, s = shorter * math.cos(middle), shorter * math.sin(middle)
    return vx * c - vy * s, vx * s + vy * c


@kernel
def predict_turns(estimates: Floats, rate: Floats, prediction: Floats) -> None:
    """Write the velocities of tracks that turn, with the `rate` of `turn_rates`, to `prediction`, unless it has others of them.

    The estimates and `prediction`, float64[N, STEPS, 2], are as `predict` takes them.
    """
    last, written = round(_TURNS_FOR / STEP_TIME), 0
    for k in range(len(estimates)):
        if rate[k] == 0.0 or not math.isnan(prediction[k, 0, 0]) or written == _MOST:
            continue
        written += 1
        for s in range(STEPS):
            start = min(s, last) * STEP_TIME
            end = start + STEP_TIME if s < last else start
            vx, vy = mean_velocity(estimates[k, VX], estimates[k, VY], rate[k], start, end)
            prediction[k, s, 0], prediction[k, s, 1] = vx, vy
        straighten(prediction[k], 0, last)
