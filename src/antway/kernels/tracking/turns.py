"""Count the turns of obstacles: changes of velocity from one scan to the next that are larger than those of people."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import kernel
from antway.kernels.base.records import Terrain
from antway.kernels.tracking.bounces import GAP, remember, row_to_compare, velocity_change
from antway.kernels.tracking.table import SEEN, Table, drop_lost

TURN = 0.7  # m/s; a larger change of velocity between two scans counts as a turn; people seldom make one
SECONDS, TURNS, CHANGES = range(3)  # entries of `turns`: time observed in s, number of turns, and sum of their changes in m/s
FIRST_SECONDS = 10.0  # s; time without a turn that counts as observed before the first scan


@kernel
def count_turns(
    table: Table,
    turns: NDArray[np.float64],
    estimates: NDArray[np.float64],
    terrain: Terrain,
    t: float,
) -> None:
    """Add what a scan shows of all tracks to `turns`, float64[3].

    Parameters
    ----------
    table : Table
        The tracks known so far, [M, COLUMNS] of kernels/tracking/bounces.py.
    estimates : float64[K, 8]
        As in kernels/tracking/predict.py, at time `t` s.
    terrain : Terrain
    """
    drop_lost(table, t)
    for k in range(len(estimates)):
        i, is_new = row_to_compare(table, estimates[k])
        if i < 0:
            continue
        row = table.rows[i]
        if not is_new and 0.0 < t - row[SEEN] <= GAP:
            change, _, _ = velocity_change(row, estimates[k], t, terrain)
            turns[SECONDS] += t - row[SEEN]
            if change > TURN:
                turns[TURNS] += 1.0
                turns[CHANGES] += change
        remember(row, estimates[k], t)
