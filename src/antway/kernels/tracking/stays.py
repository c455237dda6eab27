"""How long obstacles have stayed where they are: an obstacle in a doorway may stand there or go to and fro in it."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.predict import ID, RADIUS, VX, VY, X, Y
from antway.kernels.tracking.table import SEEN, Table, row_for

# Columns of a row after TRACK_ID and SEEN: when the stay of the track began, its radius, the box that holds its centre since,
# whether it was leaving when it was last seen (1 or 0), and when its first stay began.
SINCE, SIZE, LOW_X, LOW_Y, HIGH_X, HIGH_Y, LEAVING, FIRST = range(2, 10)
COLUMNS = 10
PLACE = 1.0  # m; an obstacle stays as long as the diagonal of the box that holds its centre is no longer than this
_LEAST_MEMORY = 1.0  # s; an obstacle that was not seen for longer than this and than its stay is forgotten
_LEAVES = 1.0  # s; an obstacle whose velocity would have led it out of its place within this time was leaving, and is forgotten
_MEMORY = 15.0  # s; an obstacle that stood is remembered for this long: a robot that goes round many sees only some at a time
_STOOD = 0.5  # s; an obstacle whose stay is shorter did not stand
STILL = 0.2  # m; an obstacle whose box has a longer diagonal did not stand


@bare_kernel
def _start_stay(row: Floats, estimate: Floats, t: float) -> None:
    """Begin a stay at time `t` s."""
    row[SINCE], row[SIZE] = t, estimate[RADIUS]
    row[LOW_X] = row[HIGH_X] = estimate[X]
    row[LOW_Y] = row[HIGH_Y] = estimate[Y]


@bare_kernel
def _diagonal(row: Floats) -> float:
    """Return the diagonal of the box that holds the centre of an obstacle since its stay began, m."""
    return math.hypot(row[HIGH_X] - row[LOW_X], row[HIGH_Y] - row[LOW_Y])


@kernel
def update_stays(table: Table, estimates: Floats, seen: Floats, t: float) -> None:
    """Update the stays with the tracks that are seen at time `t` s.

    `table` has the stays known so far, [M, COLUMNS]; when it is full, further tracks are left out. The estimates are those of
    kernels/tracking/predict.py, and `seen`, float64[K], is when each of them was last seen, s.
    """
    rows, kept = table.rows, 0
    for i in range(table.used[0]):
        stay = rows[i, SEEN] - rows[i, SINCE]
        stood = stay >= _STOOD and _diagonal(rows[i]) <= STILL
        memory = _LEAST_MEMORY if rows[i, LEAVING] else max(stay, _MEMORY if stood else _LEAST_MEMORY)
        if t - rows[i, SEEN] <= memory:
            if kept != i:
                copy_row(rows[i], rows[kept])
            kept += 1
    table.used[0] = kept
    for k in range(len(estimates)):
        if seen[k] != t:
            continue
        i, is_new = row_for(table, estimates[k, ID])
        if i < 0:
            continue
        row = rows[i]
        if is_new:
            _start_stay(row, estimates[k], t)
            row[FIRST] = t
        row[SEEN] = t
        row[LOW_X], row[HIGH_X] = min(row[LOW_X], estimates[k, X]), max(row[HIGH_X], estimates[k, X])
        row[LOW_Y], row[HIGH_Y] = min(row[LOW_Y], estimates[k, Y]), max(row[HIGH_Y], estimates[k, Y])
        if _diagonal(row) > PLACE:
            _start_stay(row, estimates[k], t)
        x, y = estimates[k, X] + _LEAVES * estimates[k, VX], estimates[k, Y] + _LEAVES * estimates[k, VY]
        width, height = max(row[HIGH_X], x) - min(row[LOW_X], x), max(row[HIGH_Y], y) - min(row[LOW_Y], y)
        row[LEAVING] = 1.0 if math.hypot(width, height) > PLACE else 0.0
