"""Estimates of moving obstacles: a Kalman filter for each track.

Each axis has the state (place, velocity) under white acceleration; both axes share one covariance, because noise and motion
are alike in x and y (Bar-Shalom, Li, Kirubarajan: Estimation with Applications to Tracking and Navigation, 2001, ch. 6).
"""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.geometry import hits_walls, reflected, wall_ahead
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.kalman import measure_place
from antway.kernels.base.records import Terrain
from antway.kernels.tracking.noise import EXACT
from antway.kernels.tracking.predict import ID, RADIUS, SIGMA, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.table import Table, drop_lost, row_of, row_or_oldest

# Columns of the track table after those of a track estimate, of which SIGMA and SIGMA_V are not used: the time of the last
# scan with the track, the variances of its place (m^2) and velocity (m^2/s^2) then, with their covariance between them, and the
# number of scans with it.
T, P11, P12, P22, SCANS = range(8, 13)
COLUMNS = 13  # of the track table
UNKNOWN = 1.0  # m/s; standard deviation of the velocity of a track that was seen once without a measured velocity
FAR = 0.3  # m; a track farther than this from its predicted place may be another one
_INSIDE = 0.3  # m; who is expected nearer to the edge of the sensor's range may have left it
_SHRINK = 0.1  # 1; a radius grows at once, and shrinks by this share of the difference with each scan
_SWAYS = 0.08  # m/s; whoever is slower stands, and sways: with his last velocity he would be elsewhere in a few seconds.
_AHEAD = 1.5  # 1; a bounce is looked for on the motion until now times this: places are wrong.
_TURNED = 4.0  # standard deviations; a track farther than this from its predicted place has turned


@kernel
def update(
    rows: Floats,
    used: Ints,
    t: float,
    track_id: Ints,
    xy: Floats,
    velocity: Floats,
    radius: Floats,
    variance: Floats,
    agility: float,
    estimates: Floats,
) -> tuple[int, float, bool]:
    """Update the track table with one scan.

    Returns the number of estimates written, the speed of the fastest one, m/s, and whether the scan has all velocities.

    The table is given by `rows`, float64[M, COLUMNS], and `used`, int64[1]; Python hands on two arrays faster than the record.
    In the scan of the time `t`, s, every track has an id >= 0, and a velocity of NaN is estimated. `variance`, float64[K, 2],
    are the variances of the places (m^2) and of the velocities (m^2/s^2); 0 means exact. A negative variance of the place means
    that the scan is the output of a filter with the absolute values as variances; it then replaces the estimate. `agility` is
    the standard deviation of the obstacles' acceleration, m/s^2. `estimates`, float64[N, 8], are filled with the tracks that
    were seen within the last second, predicted to time `t`. Who only sways has no velocity.
    """
    table, measured, fastest = Table(rows, used, ID), True, 0.0
    for k in range(len(track_id)):
        i, is_new = row_or_oldest(table, float(track_id[k]))
        row = table.rows[i]
        known = not math.isnan(velocity[k, 0] + velocity[k, 1])
        measured = measured and known
        row[SCANS] = 1.0 if is_new else row[SCANS] + (1.0 if t > row[T] else 0.0)
        if is_new or variance[k, 0] < 0.0:
            row[ID], row[T], row[X], row[Y] = float(track_id[k]), t, xy[k, 0], xy[k, 1]
            row[VX], row[VY] = (velocity[k, 0], velocity[k, 1]) if known else (0.0, 0.0)
            row[P11], row[P12] = abs(variance[k, 0]), 0.0
            row[P22] = abs(variance[k, 1]) if known else UNKNOWN * UNKNOWN
        else:
            dt = t - row[T]
            if dt <= 0.0:
                continue  # this scan was processed before
            vx, vy = row[VX], row[VY]
            x, y = row[X] + vx * dt, row[Y] + vy * dt
            rx, ry = xy[k, 0] - x, xy[k, 1] - y
            if not known:
                spread = row[P11] + dt * (2.0 * row[P12] + dt * row[P22]) + variance[k, 0]
                residual = math.hypot(rx, ry)
                if residual > _TURNED * math.sqrt(spread + agility * agility * dt**4 / 3):
                    row[P22] += (residual / dt) ** 2  # the track turned, so its old velocity is useless
            g1, g2, p11, p12, p22 = measure_place(row[P11], row[P12], row[P22], dt, agility, variance[k, 0])
            x, y, vx, vy = x + g1 * rx, y + g1 * ry, vx + g2 * rx, vy + g2 * ry
            if known:
                s = p22 + variance[k, 1]
                wx, wy = velocity[k, 0] - vx, velocity[k, 1] - vy
                jump = math.hypot(wx, wy)
                if jump > 3.0 * math.sqrt(s) + 0.02:  # the track turned since the last scan, so its predicted place is wrong
                    p11 = min(p11 + (jump * dt) ** 2, variance[k, 0])
                    if variance[k, 0] < (jump * dt) ** 2:
                        x, y = xy[k, 0], xy[k, 1]
                g1, g2 = (p12 / s, p22 / s) if s > 0.0 else (0.0, 1.0)
                x, y, vx, vy = x + g1 * wx, y + g1 * wy, vx + g2 * wx, vy + g2 * wy
                p11, p12, p22 = p11 - g1 * p12, (1 - g2) * p12, (1 - g2) * p22
            row[X], row[Y], row[VX], row[VY], row[T] = x, y, vx, vy, t
            row[P11], row[P12], row[P22] = p11, p12, p22
        if is_new or radius[k] >= row[RADIUS]:
            row[RADIUS] = radius[k]
        else:
            row[RADIUS] += _SHRINK * (radius[k] - row[RADIUS])
    drop_lost(table, t)
    known_tracks = min(table.used[0], len(estimates))
    for i in range(known_tracks):
        row, estimate = table.rows[i], estimates[i]
        age = t - row[T]
        estimate[X], estimate[Y] = row[X] + row[VX] * age, row[Y] + row[VY] * age
        speed = math.hypot(row[VX], row[VY])
        estimate[VX], estimate[VY] = (row[VX], row[VY]) if speed >= _SWAYS else (0.0, 0.0)
        estimate[RADIUS], estimate[ID] = row[RADIUS], row[ID]
        estimate[SIGMA] = math.sqrt(max(row[P11] + 2 * age * row[P12] + age * age * row[P22], 0.0))
        estimate[SIGMA_V] = math.sqrt(max(row[P22], 0.0))
        fastest = max(fastest, speed)
    return known_tracks, fastest, measured


@kernel
def forget_ghosts(
    rows: Floats, used: Ints, terrain: Terrain, t: float, track_id: Ints, x: float, y: float, sensor_range: float
) -> None:
    """Forget the tracks that the sensor saw in one scan alone, though nothing hides them now: probably nobody was there.

    Such false alarms are common, and would be remembered for a second, like those whom something hides. `rows` and `used` are
    of the track table, before `update`, which drops what is forgotten. The robot is at (x, y), and its sensor sees
    `sensor_range` m.
    """
    for i in range(used[0]):
        row = rows[i]
        if row[SCANS] == 1.0 and row[T] < t and not _has(track_id, row[ID]):
            dx, dy = _seen_from(row, t, x, y)
            if math.hypot(dx, dy) < sensor_range - _INSIDE and not _may_be_hidden(rows[: used[0]], i, terrain, t, x, y):
                row[SCANS] = 0.0
    for i in range(used[0]):  # once all are found, as one may have hidden another
        if rows[i, SCANS] == 0.0:
            rows[i, T] = -math.inf


@bare_kernel
def _seen_from(row: Floats, t: float, x: float, y: float) -> tuple[float, float]:
    """Return where from (x, y) a track is expected at time `t` s, m."""
    age = t - row[T]
    return row[X] + row[VX] * age - x, row[Y] + row[VY] * age - y


@bare_kernel
def _may_be_hidden(rows: Floats, i: int, terrain: Terrain, t: float, x: float, y: float) -> bool:
    """Tell whether a wall or another track hides a part of track i from (x, y)."""
    (dx, dy), radius = _seen_from(rows[i], t, x, y), rows[i, RADIUS]
    distance = math.hypot(dx, dy)
    if distance <= radius:
        return False
    ux, uy = dx / distance, dy / distance
    for side in (-radius, 0.0, radius):
        if hits_walls(terrain, x, y, x + dx - side * uy, y + dy + side * ux, 0.0, False):
            return True
    for j in range(len(rows)):
        px, py = _seen_from(rows[j], t, x, y)
        before = 0.0 < px * ux + py * uy < distance
        if j != i and before and abs(px * uy - py * ux) < rows[j, RADIUS] + radius:
            return True
    return False


@kernel
def raise_variances(rows: Floats, used: Ints, before: Floats, now: Floats) -> None:
    """Raise the variances of all estimates after measurements have turned out to be worse than they were taken for.

    An estimate from measurements that counted as exact would stay as it is: no later measurement would have any weight.
    `before` and `now`, float64[2], are the variances of measured places (m^2) and velocities (m^2/s^2): those with which the
    estimates were made, and others.
    """
    for column, kind in ((P11, 0), (P22, 1)):
        if now[kind] > before[kind]:
            for i in range(used[0]):
                share = rows[i, column] / before[kind] if before[kind] > 0.0 else 1.0
                rows[i, column] = max(rows[i, column], min(share, 1.0) * now[kind])


@kernel
def bounce(
    rows: Floats, used: Ints, terrain: Terrain, t: float, track_id: Ints, xy: Floats, velocity: Floats, variance: Floats
) -> None:
    """Mirror the tracks that a scan shows to have bounced off a wall, so that they move on to where they are after it.

    Where places are noisy, the filter would take a second to find their new velocity. A track has bounced if it would be at a
    wall by now, and the scan is more likely if it has. The parameters are those of `update`.
    """
    for k in range(len(track_id)):
        if variance[k, 0] <= EXACT:
            continue
        i = row_of(Table(rows, used, ID), float(track_id[k]))
        if i < 0 or t <= rows[i, T]:
            continue
        row, dt = rows[i], t - rows[i, T]
        dx, dy = row[VX] * _AHEAD * dt, row[VY] * _AHEAD * dt
        share, n_x, n_y = wall_ahead(terrain, row[X], row[Y], dx, dy, row[RADIUS])
        if share > 1.0:
            continue
        back_x, back_y = reflected(share * dx, share * dy, n_x, n_y)
        x, y = row[X] + share * dx - back_x, row[Y] + share * dy - back_y  # the mirror image, behind the wall
        vx, vy = reflected(row[VX], row[VY], n_x, n_y)
        measured = xy[k, 0], xy[k, 1], velocity[k, 0], velocity[k, 1]
        place, speed = row[P11] + variance[k, 0], row[P22] + variance[k, 1]
        straight = _unlikely(measured, row[X] + row[VX] * dt, row[Y] + row[VY] * dt, row[VX], row[VY], place, speed)
        if _unlikely(measured, x + vx * dt, y + vy * dt, vx, vy, place, speed) < straight:
            row[X], row[Y], row[VX], row[VY] = x, y, vx, vy


@bare_kernel
def _unlikely(
    measured: tuple[float, float, float, float], x: float, y: float, vx: float, vy: float, place: float, speed: float
) -> float:
    """Return how unlikely a measured place and velocity are if others are expected: the sum of squares over the variances."""
    squares = ((measured[0] - x) ** 2 + (measured[1] - y) ** 2) / place
    if math.isnan(measured[2] + measured[3]):
        return squares
    return squares + ((measured[2] - vx) ** 2 + (measured[3] - vy) ** 2) / speed


@kernel
def needs_ids(rows: Floats, used: Ints, t: float, track_id: Ints, xy: Floats) -> bool:
    """Tell whether a track has no id, or one that is in doubt at time `t` s.

    A known id is, if its track was predicted more than `FAR` away; a new one, if a track of the last scan that is not in this
    one was predicted within that distance. One that has been hidden for longer may be predicted where somebody else appears.
    """
    last = -math.inf  # s; time of the last scan with tracks
    for i in range(used[0]):
        last = max(last, rows[i, T])
    for k in range(len(track_id)):
        if track_id[k] < 0:
            return True
        i = row_of(Table(rows, used, ID), float(track_id[k]))
        if i >= 0 and _distance(rows[i], t, xy[k]) > FAR:
            return True
        for other in range(used[0] if i < 0 else 0):
            near = rows[other, T] == last and _distance(rows[other], t, xy[k]) <= FAR
            if near and not _has(track_id, rows[other, ID]):
                return True
    return False


@bare_kernel
def _has(ids: Ints, wanted: float) -> bool:
    found = False
    for one in ids:
        found = found or float(one) == wanted
    return found


@bare_kernel
def _distance(row: Floats, t: float, xy: Floats) -> float:
    """Return how far `xy` is from where a track was predicted at time `t` s, m."""
    age = t - row[T]
    return math.hypot(xy[0] - row[X] - row[VX] * age, xy[1] - row[Y] - row[VY] * age)
