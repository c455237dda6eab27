"""Compare the velocities that a sensor reports with those between its places."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import kernel
from antway.kernels.tracking.table import SEEN, TRACK_ID, Table, by_id, row_or_oldest

# Columns of a row after TRACK_ID and SEEN: when and where a track was at the beginning of a span, how far reported velocities
# have led since then, the velocity reported last, and that between the places of the span before.
_SINCE, _X, _Y, _DX, _DY, _VX, _VY, _PX, _PY = range(2, 11)
COLUMNS = 11
# Spans, s; the number of comparisons before reported velocities can be found wrong; and how many times as wrong as places they
# are then. From scan to scan every error shows at once if places are exact; in half a second zeros show where they are noisy.
SPANS = ((0.0, 10.0, 2.0), (0.5, 3.0, 1.3))
_MEMORY = 0.995  # 1; with each comparison, earlier ones count this much less
_LEAST = 0.03  # m/s; a smaller error does not matter
_MOST = 1.0  # m/s; a larger error counts as this, because somebody turned or jumped
_FAR = 0.5  # s; an older measurement is not compared


@kernel
def wrong(
    rows: Floats,
    used: Ints,
    state: Floats,
    t: float,
    track_id: Ints,
    xy: Floats,
    velocity: Floats,
    span: tuple[float, float, float],
) -> bool:
    """Tell, after one more scan, whether reported velocities predict places worse than the two places before do.

    They are wrong if their mean error is more than a few times that of the velocity between the two places before. The table
    with the last measurement of each track is given by `rows`, float64[M, COLUMNS], and `used`, int64[1]; Python hands on two
    arrays faster than the record. `state`, float64[3], is the number of comparisons, and the sums of both errors, m/s; zeros at
    first. The scan is as in kernels/tracking/kalman.py; a velocity of NaN is not reported. Table and state are of this one
    `span` of SPANS.
    """
    least, enough, times = span
    for k in by_id(track_id):
        px, py = math.nan, math.nan
        i, is_new = row_or_oldest(Table(rows, used, TRACK_ID), float(track_id[k]))
        row = rows[i]
        if not is_new:
            dt, between = t - row[SEEN], t - row[_SINCE]
            if dt <= 0.0:
                continue  # this scan was processed before
            row[_DX], row[_DY] = row[_DX] + row[_VX] * dt, row[_DY] + row[_VY] * dt
            if between < least - 1e-6 and dt <= _FAR:
                row[SEEN], row[_VX], row[_VY] = t, velocity[k, 0], velocity[k, 1]
                continue
            px, py = (xy[k, 0] - row[_X]) / between, (xy[k, 1] - row[_Y]) / between
            by_velocities = math.hypot(px - row[_DX] / between, py - row[_DY] / between)
            by_places = math.hypot(px - row[_PX], py - row[_PY])
            if dt <= _FAR and not math.isnan(by_velocities + by_places):
                state *= _MEMORY
                state[0] += 1.0
                state[1] += min(by_velocities, _MOST)
                state[2] += min(by_places, _MOST)
        row[TRACK_ID], row[SEEN], row[_SINCE] = track_id[k], t, t
        row[_X], row[_Y], row[_DX], row[_DY] = xy[k, 0], xy[k, 1], 0.0, 0.0
        row[_VX], row[_VY], row[_PX], row[_PY] = velocity[k, 0], velocity[k, 1], px, py
    return bool(state[0] >= enough and state[1] > times * state[2] + _LEAST * state[0])


@kernel
def wrong_in_spans(
    tables: tuple[Table, Table], states: Floats, t: float, track_id: Ints, xy: Floats, velocity: Floats
) -> tuple[bool, bool]:
    """Do as `wrong` for each of SPANS, with its table and its row of `states`, float64[2, 3]."""
    (rows, used, _), (later_rows, later_used, _) = tables
    return (
        wrong(rows, used, states[0], t, track_id, xy, velocity, SPANS[0]),
        wrong(later_rows, later_used, states[1], t, track_id, xy, velocity, SPANS[1]),
    )
