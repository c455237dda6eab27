"""How the velocity of each track has changed since it was seen last; at a wall, the change from the mirrored velocity counts.

Predictions turn back at walls, so a bounce is nothing unforeseen. Changes that are larger than those of people are turns.
"""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Bools, Floats
from antway.kernels.base.geometry import reflected, wall_ahead
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.records import Terrain
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import ID, RADIUS, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.table import SEEN, Table, drop_lost, known_row

# Columns of a row after TRACK_ID and SEEN: where and with what velocity the track was last seen, and in how many scans.
_X, _Y, _VX, _VY, _SCANS = range(2, 7)
COLUMNS = 7
# Columns of a change: the velocity before, mirrored where the track has bounced off a wall since then, and the normal of that
# wall, (0, 0) without one. A track that is new has not changed its velocity.
BEFORE_VX, BEFORE_VY, N_X, N_Y = range(4)
SECONDS, TURNS, SUM = range(3)  # entries of `turns`: time observed in s, number of turns, and sum of their changes in m/s
FIRST_SECONDS = 10.0  # s; time without a turn that counts as observed before the first scan
_TURN = 0.7  # m/s; a larger change of velocity between two scans counts as a turn; people seldom make one
_GAP = 0.3  # s; a wall explains a change of velocity if the track would have touched it within this time
_CHANGED = 0.1  # m/s; a smaller change of velocity is not looked at as a bounce


@bare_kernel
def row_to_compare(table: Table, estimate: Floats, seen: bool) -> tuple[int, bool]:
    """Do as `known_row`, but a track whose velocity is not known has the row -1, too."""
    if estimate[SIGMA_V] >= UNKNOWN:
        return -1, True
    return known_row(table, estimate[ID], seen)


@kernel
def velocity_changes(
    table: Table, turns: Floats, estimates: Floats, seen: Bools, terrain: Terrain, t: float, out: Floats
) -> None:
    """Write how the velocity of each track has changed, and count the turns.

    `out`, float64[K, 4], is filled; see BEFORE_VX and the others above. `table` has the tracks known so far, [M, COLUMNS]. What
    the scan shows is added to `turns`, float64[3]; at first it is FIRST_SECONDS without a turn. The estimates are those of
    kernels/tracking/predict.py at time `t` s, and `seen`, bool[K], tells which of them the scan shows; others do not change.
    """
    drop_lost(table, t)
    for k in range(len(estimates)):
        vx, vy, before = estimates[k, VX], estimates[k, VY], out[k]
        before[BEFORE_VX], before[BEFORE_VY], before[N_X], before[N_Y] = vx, vy, 0.0, 0.0
        if not seen[k]:
            continue
        i, is_new = row_to_compare(table, estimates[k], True)
        if i < 0:
            continue
        row = table.rows[i]
        if not is_new:
            _compare(row, estimates[k], terrain, t - row[SEEN], before)
            # Trackers do not know the velocity at the first scan yet, and many report 0 then.
            if row[_SCANS] > 1.0 and 0.0 < t - row[SEEN] <= _GAP:
                change = math.hypot(vx - before[BEFORE_VX], vy - before[BEFORE_VY])
                turns[SECONDS] += t - row[SEEN]
                if change > _TURN:
                    turns[TURNS] += 1.0
                    turns[SUM] += change
        row[_SCANS] = 1.0 if is_new else row[_SCANS] + (1.0 if t > row[SEEN] else 0.0)  # a scan may be known for several cycles
        row[SEEN], row[_X], row[_Y], row[_VX], row[_VY] = t, estimates[k, X], estimates[k, Y], vx, vy


@bare_kernel
def _compare(row: Floats, estimate: Floats, terrain: Terrain, dt: float, out: Floats) -> None:
    """Write the change of a track that was seen `dt` s ago.

    It bounced if its new velocity is nearer to the last one, mirrored at a wall or an edge of the map, than to the last one.
    """
    vx, vy, last_vx, last_vy = estimate[VX], estimate[VY], row[_VX], row[_VY]
    out[BEFORE_VX], out[BEFORE_VY] = last_vx, last_vy
    change = math.hypot(vx - last_vx, vy - last_vy)
    if change >= _CHANGED:
        time = max(dt, _GAP)
        share, n_x, n_y = wall_ahead(terrain, row[_X], row[_Y], last_vx * time, last_vy * time, estimate[RADIUS])
        mirrored_vx, mirrored_vy = reflected(last_vx, last_vy, n_x, n_y)
        if share <= 1.0 and math.hypot(vx - mirrored_vx, vy - mirrored_vy) < change:
            out[BEFORE_VX], out[BEFORE_VY], out[N_X], out[N_Y] = mirrored_vx, mirrored_vy, n_x, n_y
