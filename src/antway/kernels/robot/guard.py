"""The guard's arithmetic: is a braking path free of every place that an obstacle could reach while the robot still moves?"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import TOUCH, first_wall, segment_hits_cells, swept_discs, wrap
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import Terrain
from antway.kernels.robot.dynamics import drive

FREE, SLOWED, BRAKED, STEPPED_ASIDE = 0, 1, 2, 3  # what the guard did
_FRACTIONS = 10  # speeds tried along the commanded direction
_SIDES = 16  # directions tried for a step aside
X, Y, VX, VY, RADIUS, SPEED_BOUND = range(6)  # columns of the tracks that count: m, m/s, m and m/s
_ID, _SEEN, _X, _Y, _VX, _VY, _RADIUS, _SPEED = range(8)  # columns of the table of tracks seen of late; _SEEN in s


@kernel
def fault(
    x: float,
    y: float,
    vx: float,
    vy: float,
    heading: float,
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
    radius: NDArray[np.float64],
) -> int:
    """Return what is wrong with the robot's state or a scan of K tracks: 0 nothing, 1 the state, 2 xy, 3 velocity, 4 radius.

    All must be finite and radii not negative; a velocity may be NaN (unknown).
    """
    if not math.isfinite(x + y + vx + vy + heading):
        return 1
    for k in range(len(radius)):
        if not math.isfinite(xy[k, 0] + xy[k, 1]):
            return 2
        if math.isinf(velocity[k, 0]) or math.isinf(velocity[k, 1]):
            return 3
        if not (math.isfinite(radius[k]) and radius[k] >= 0.0):
            return 4
    return 0


@kernel
def within_reach(
    table: NDArray[np.float64],
    count: int,
    now: float,
    stamp: float,
    hold: float,
    name: NDArray[np.int64],
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
    radius: NDArray[np.float64],
    spread: NDArray[np.float64],
    bounds: NDArray[np.float64],
    out: NDArray[np.float64],
) -> tuple[int, int]:
    """Write the rows x, y, vx, vy, radius, bound of all tracks that count: those of this scan, and those not long lost.

    Parameters
    ----------
    table : float64[M, 8]
        The tracks of late, rows below `count`: id, when seen, and the row, its speed then last; M is at least `count` + K.
    now, stamp, hold : float
        Time now and of the scan; how long a lost track counts; s.
    name, xy, velocity, radius : int64[K], float64[K, 2], float64[K, 2], float64[K]
        The scan; an unknown velocity is NaN.
    spread : float64[K]
        How far off the places may be, m.
    bounds : float64[3]
        No obstacle is faster than bounds[0] m/s, nor does its speed grow by more than bounds[1] m/s^2; the robot stands
        bounds[2] s after this command.

    Returns
    -------
    count, rows : int
        What could have been moved since a track was seen is added to its radius.
    """
    speed_bound, acceleration_bound, stopping_time = bounds[0], bounds[1], bounds[2]
    n = 0
    for k in range(len(name)):
        vx, vy = velocity[k, 0], velocity[k, 1]
        speed = math.hypot(vx, vy)
        if math.isnan(speed):
            vx, vy, speed = 0.0, 0.0, speed_bound
        i = 0
        while i < count and (table[i, _ID] != name[k] or name[k] < 0):
            i += 1
        if i == count:
            count += 1
        table[i, _ID], table[i, _SEEN], table[i, _X], table[i, _Y] = name[k], stamp, xy[k, 0], xy[k, 1]
        table[i, _VX], table[i, _VY], table[i, _RADIUS], table[i, _SPEED] = vx, vy, radius[k] + spread[k], speed
    kept = 0
    for i in range(count):
        age = now - table[i, _SEEN]
        if table[i, _SEEN] < stamp and age > hold:
            continue
        table[kept] = table[i]
        out[n] = table[i, _X:]
        out[n, SPEED_BOUND] = min(speed_bound, table[i, _SPEED] + acceleration_bound * (age + stopping_time))
        out[n, RADIUS] += out[n, SPEED_BOUND] * age
        kept, n = kept + 1, n + 1
    return kept, n


@kernel
def gap_to_reach(ax: float, ay: float, wx: float, wy: float, reach: float, growth: float, t: float) -> float:
    """Least of |a + w s| - (reach + growth s) over s in [0, t]; below 0 the growing disc around an obstacle is entered.

    Parameters
    ----------
    ax, ay : float
        The robot seen from the obstacle, m.
    wx, wy : float
        The robot's velocity, m/s.
    reach : float
        Sum of the radii and whatever the obstacle may have moved since it was seen, m.
    growth : float
        Bound on the obstacle's speed, m/s.
    t : float
        Length of the step, s.

    Notes
    -----
    The function is convex. With c the lateral distance and k = growth / |w| < 1 it is least where the way made since the
    closest point is c k / sqrt(1 - k^2); with k >= 1 at the end.
    """
    speed = math.hypot(wx, wy)
    s = t
    if speed > growth:
        k = growth / speed
        lateral = abs(ax * wy - ay * wx) / speed
        s = min(max((lateral * k / math.sqrt(1.0 - k * k) - (ax * wx + ay * wy) / speed) / speed, 0.0), t)
    return math.hypot(ax + wx * s, ay + wy * s) - reach - growth * s


@kernel
def brakes_free(
    px: float,
    py: float,
    wx: float,
    wy: float,
    tracks: NDArray[np.float64],
    limits: NDArray[np.float64],
    dt: float,
    terrain: Terrain,
) -> bool:
    """Tell whether a robot at (px, py) may drive one period with (wx, wy) and then brake, straight, to a stand.

    `tracks` is float64[K, 6]: x, y, vx, vy, radius, bound on the speed. Free means: until the robot stands, no obstacle can be
    in contact with it that moves in any way within its bound, and no wall is.
    """
    speed = math.hypot(wx, wy)
    if speed <= TOUCH:
        return True
    a_max, radius, resolution = limits[1], limits[4], terrain.resolution
    t, x, y = 0.0, px, py
    ux, uy = wx / speed, wy / speed
    while speed > TOUCH:
        for k in range(len(tracks)):
            reach, speed_bound = radius + tracks[k, RADIUS] + tracks[k, SPEED_BOUND] * t, tracks[k, SPEED_BOUND]
            if gap_to_reach(x - tracks[k, X], y - tracks[k, Y], ux * speed, uy * speed, reach, speed_bound, dt) < -TOUCH:
                return False
        x += ux * speed * dt
        y += uy * speed * dt
        t += dt
        speed -= a_max * dt
    ar, ac = (py - terrain.y0) / resolution - 0.5, (px - terrain.x0) / resolution - 0.5
    br, bc = (y - terrain.y0) / resolution - 0.5, (x - terrain.x0) / resolution - 0.5
    return not segment_hits_cells(terrain.blocked, ar, ac, br, bc, radius / resolution, True)


@kernel
def time_to_contact(x: float, y: float, vx: float, vy: float, tracks: NDArray[np.float64], radius: float) -> float:
    """Earliest contact in s of the robot at (x, y) keeping (vx, vy) with any track keeping its velocity; infinite if none."""
    earliest = math.inf
    for k in range(len(tracks)):
        ax, ay = tracks[k, X] - x, tracks[k, Y] - y
        ux, uy = tracks[k, VX] - vx, tracks[k, VY] - vy
        reach = radius + tracks[k, RADIUS]
        closing = ax * ux + ay * uy
        slack = ax * ax + ay * ay - reach * reach
        uu = ux * ux + uy * uy
        root = closing * closing - uu * slack
        if slack <= 0.0:
            return 0.0
        if closing < 0.0 and root > 0.0:
            earliest = min(earliest, slack / (-closing + math.sqrt(root)))
    return earliest


@kernel
def _aside(
    x: float, y: float, vx: float, vy: float, until: float, horizon: float, tracks: NDArray[np.float64], radius: float
) -> float:
    """Time of the first contact, at most `horizon` s, of a robot that drives with (vx, vy) until `until` s and then stands."""
    earliest = horizon
    for k in range(len(tracks)):
        ax, ay, ux, uy = tracks[k, X] - x, tracks[k, Y] - y, tracks[k, VX], tracks[k, VY]
        first, _, _ = swept_discs(ax, ay, ux - vx, uy - vy, radius + tracks[k, RADIUS], until)
        earliest = min(earliest, first)
        ax, ay = ax + (ux - vx) * until, ay + (uy - vy) * until
        first, _, _ = swept_discs(ax, ay, ux, uy, radius + tracks[k, RADIUS], horizon - until)
        earliest = min(earliest, until + first)
    return earliest


@kernel
def guarded(
    px: float,
    py: float,
    vx: float,
    vy: float,
    heading: float,
    cx: float,
    cy: float,
    tracks: NDArray[np.float64],
    limits: NDArray[np.float64],
    dt: float,
    lookahead: float,
    terrain: Terrain,
) -> tuple[float, float, int]:
    """Return the command (vx, vy) that the guard lets pass, and what it did.

    The commanded velocity (cx, cy) where the braking path of what the robot does with it is free; else the fastest along it of
    which that holds; else a stand. A robot that would stand in the way of a track within `lookahead` s steps aside where a side
    is free that puts the contact off. Wheels at rest turn towards the command.
    `limits` is float64[5]: those of `drive`, and the robot's radius.
    """
    v_max, radius, resolution = limits[0], limits[4], terrain.resolution
    speed = math.hypot(cx, cy)
    if speed > v_max:
        cx, cy, speed = cx * v_max / speed, cy * v_max / speed, v_max
    for k in range(_FRACTIONS, 0, -1):
        if speed <= TOUCH:
            break
        tx, ty = cx * k / _FRACTIONS, cy * k / _FRACTIONS
        wx, wy, _ = drive(vx, vy, heading, tx, ty, limits, dt)
        if brakes_free(px, py, wx, wy, tracks, limits, dt, terrain):
            return tx, ty, FREE if k == _FRACTIONS else SLOWED
    best = time_to_contact(px, py, 0.0, 0.0, tracks, radius)
    sx, sy = 0.0, 0.0
    for k in range(_SIDES if best <= lookahead else 0):
        tx, ty = v_max * math.cos(2 * math.pi * k / _SIDES), v_max * math.sin(2 * math.pi * k / _SIDES)
        wx, wy, _ = drive(vx, vy, heading, tx, ty, limits, dt)
        row, col, ahead = (py - terrain.y0) / resolution - 0.5, (px - terrain.x0) / resolution - 0.5, lookahead / resolution
        wall, _, _ = first_wall(terrain.blocked, row, col, ty * ahead, tx * ahead, radius / resolution)
        value = _aside(px, py, tx, ty, min(wall, 1.0) * lookahead, 2 * lookahead, tracks, radius)
        if value > best + TOUCH and brakes_free(px, py, wx, wy, tracks, limits, dt, terrain):
            best, sx, sy = value, tx, ty
    if sx == 0.0 and sy == 0.0:
        turn = wrap(math.atan2(cy, cx) - heading)
        if limits[3] != 0.0 and speed > TOUCH and math.hypot(vx, vy) <= TOUCH and abs(turn) > limits[2] * dt:
            side = heading + math.copysign(limits[2] * dt + math.pi / 2, turn)  # square to the heading then: nothing ahead
            return speed * math.cos(side), speed * math.sin(side), BRAKED
        return 0.0, 0.0, FREE if speed <= TOUCH else BRAKED
    return sx, sy, STEPPED_ASIDE
