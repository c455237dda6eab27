"""Take in a scan in one call: forget false alarms, mirror bounces, filter, and look for turns and for the best velocities."""

from __future__ import annotations

from typing import NamedTuple

from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import Terrain
from antway.kernels.base.rows import copy_rows
from antway.kernels.tracking import kalman
from antway.kernels.tracking.averages import averaged
from antway.kernels.tracking.changes import velocity_changes
from antway.kernels.tracking.predict import crosses_edge
from antway.kernels.tracking.table import Table


class Known(NamedTuple):
    """What is kept of tracks from scan to scan."""

    filtered: Table  # [M, kalman.COLUMNS]
    compared: Table  # [M, changes.COLUMNS]
    turns: Floats  # [3], see `velocity_changes`
    averages: Table  # [M, averages.COLUMNS]
    pool: Floats  # [averages.POOL]


class TrackEstimates(NamedTuple):
    """What is known of each track after a scan."""

    estimates: Floats  # [M, 8] as in kernels/tracking/predict.py
    seen: Bools  # [M] whether the scan shows it
    changes: Floats  # [M, 4] how its velocity has changed, see kernels/tracking/changes.py
    averaged: Floats  # [M, 8] the estimates with the velocities of kernels/tracking/averages.py, or as they are


@kernel
def take_in(
    known: Known,
    terrain: Terrain,
    t: float,
    scan: tuple[Ints, Floats, Floats, Floats, Floats],
    robot: tuple[float, float],
    sensor_range: float,
    agility: float,
    averages: bool,
    restart: bool,
    out: TrackEstimates,
) -> tuple[int, float, bool, bool]:
    """Take in a scan at time `t` s, and write what is known of each track then to `out`.

    The scan is (track_id, xy, velocity, radius, variance) as in `kalman.update`, to which `agility` belongs as well. False
    alarms are forgotten within `sensor_range` m of the `robot` at (x, y). Velocities are averaged if `averages`, and begin anew
    if `restart` (kernels/tracking/averages.py).

    Returns the number of tracks; the speed of the fastest one, m/s; whether the scan has all velocities; and whether it shows a
    track beyond an edge of the map.
    """
    (track_id, xy, velocity, _, variance), (rows, used, _) = scan, known.filtered
    kalman.forget_ghosts(rows, used, terrain, t, track_id, robot[0], robot[1], sensor_range)
    kalman.bounce(rows, used, terrain, t, track_id, xy, velocity, variance)
    n, fastest, measured = kalman.update(rows, used, t, *scan, agility, out.estimates)
    estimates, seen, changes, best = out.estimates[:n], out.seen[:n], out.changes[:n], out.averaged[:n]
    for k in range(n):
        seen[k] = rows[k, kalman.T] == t
    velocity_changes(known.compared, known.turns, estimates, seen, terrain, t, changes)
    if averages:
        averaged(known.averages, known.pool, estimates, seen, changes, t, restart, best)
    else:
        copy_rows(estimates, best)
    return n, fastest, measured, crosses_edge(estimates[seen], terrain)
