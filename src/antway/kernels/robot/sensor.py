"""Which moving discs a range sensor sees, and how noise, losses and a tracker change the measurements."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.geometry import hits_walls, timeline_at
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.kalman import measure_place
from antway.kernels.base.records import Terrain, Trajectories
from antway.kernels.base.rng import State, stream, uniform

# Columns of the filters in `degrade`: place, velocity, variance of the place, covariance, variance of the velocity, time.
_X, _Y, _VX, _VY, _P11, _P12, _P22, _T = range(8)


@bare_kernel
def scan(
    t: float,
    x: float,
    y: float,
    sensor_range: float,
    occlusion: bool,
    terrain: Terrain,
    trajectories: Trajectories,
    seen: Ints,
    state: Floats,
) -> int:
    """Find the discs seen from (x, y): their edge is within `sensor_range` m and, with `occlusion`, no wall hides them.

    A disc is hidden if walls block the line of sight to its nearest point and to both its sides. `seen`, int64[K], and `state`,
    float64[K, 4], are filled with the index and (x, y, vx, vy) of each disc that is seen, in the order of the indices. Returns
    how many are.
    """
    radius = trajectories.radius
    n = 0
    for k in range(len(radius)):
        ox, oy, vx, vy = timeline_at(t, trajectories, k)
        dx, dy = ox - x, oy - y
        distance = math.hypot(dx, dy)
        if distance - radius[k] > sensor_range:
            continue
        if occlusion and distance > radius[k]:
            ux, uy = dx / distance, dy / distance
            r = radius[k]
            if (
                hits_walls(terrain, x, y, ox - r * ux, oy - r * uy, 0.0, False)
                and hits_walls(terrain, x, y, ox - r * uy, oy + r * ux, 0.0, False)
                and hits_walls(terrain, x, y, ox + r * uy, oy - r * ux, 0.0, False)
            ):
                continue
        seen[n] = k
        state[n, 0], state[n, 1], state[n, 2], state[n, 3] = ox, oy, vx, vy
        n += 1
    return n


@kernel
def normal(state: State) -> float:
    """Step `state` twice and return a standard normal number (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
    return radius * math.cos(2.0 * math.pi * uniform(state))


class Errors(NamedTuple):
    """How a sensor measures; see `antway.world.sensor.Sensor`."""

    dropout: float  # 1; probability
    noise: float  # m; standard deviation of places
    velocity_noise: float  # m/s; standard deviation of velocities
    forgotten: float  # s; the filter of a disc restarts after so long a time without it
    agility: float  # m/s^2; assumed acceleration of obstacles where velocities are estimated, else 0


@kernel
def degrade(
    n: int, t: float, seed: np.uint64, tick: int, errors: Errors, seen: Ints, state: Floats, tracker: Floats, covariance: Floats
) -> int:
    """Apply losses, noise and tracking to the n discs that `scan` saw, in place; return how many are left.

    Each disc is lost with probability `dropout`. Its place gets normal noise of `noise` m, its velocity of `velocity_noise`
    m/s. With `agility` > 0 the velocity is not measured but estimated from the places by a Kalman filter for constant velocity
    with white acceleration of that standard deviation (m/s^2). Each disc has its own filter, which restarts once the disc was
    not seen for `forgotten` s. The noise of a disc in scan `tick` depends only on seed, tick and disc. The filters are the rows
    of `tracker`, float64[K, 8], kept from scan to scan, with the same variances in x and y; their time is NaN before the first.
    `covariance`, float64[K, 4, 4], is filled with that of (x, y, vx, vy).
    """
    dropout, noise, velocity_noise, forgotten, agility = errors
    kept = 0
    draw = np.empty(1, np.uint64)
    for m in range(n):
        k = seen[m]
        draw[0] = stream(stream(seed, np.uint64(tick)), np.uint64(k))
        if uniform(draw) < dropout:
            continue
        x, y = state[m, 0] + noise * normal(draw), state[m, 1] + noise * normal(draw)
        vx, vy = state[m, 2] + velocity_noise * normal(draw), state[m, 3] + velocity_noise * normal(draw)
        pp, pv, vv = noise * noise, 0.0, velocity_noise * velocity_noise
        if agility > 0.0:
            x, y, vx, vy, pp, pv, vv = _track(tracker[k], t, x, y, noise, forgotten, agility)
        seen[kept] = k
        state[kept, 0], state[kept, 1], state[kept, 2], state[kept, 3] = x, y, vx, vy
        covariance[kept] = 0.0
        for axis in range(2):
            covariance[kept, axis, axis] = pp
            covariance[kept, axis, axis + 2] = covariance[kept, axis + 2, axis] = pv
            covariance[kept, axis + 2, axis + 2] = vv
        kept += 1
    return kept


@kernel
def _track(
    f: Floats, t: float, x: float, y: float, noise: float, forgotten: float, agility: float
) -> tuple[float, float, float, float, float, float, float]:
    """Update the filter `f` with the measured place and return its estimate."""
    measured = max(noise * noise, 1e-8)
    dt = t - f[_T]
    if not dt <= forgotten:
        f[_X], f[_Y], f[_VX], f[_VY] = x, y, 0.0, 0.0
        f[_P11], f[_P12], f[_P22] = measured, 0.0, 4.0  # a standard deviation of 2 m/s: an obstacle may walk or stand
    else:
        x0, y0 = f[_X] + f[_VX] * dt, f[_Y] + f[_VY] * dt
        g1, g2, f[_P11], f[_P12], f[_P22] = measure_place(f[_P11], f[_P12], f[_P22], dt, agility, measured)
        f[_X], f[_Y] = x0 + g1 * (x - x0), y0 + g1 * (y - y0)
        f[_VX], f[_VY] = f[_VX] + g2 * (x - x0), f[_VY] + g2 * (y - y0)
    f[_T] = t
    return f[_X], f[_Y], f[_VX], f[_VY], f[_P11], f[_P12], f[_P22]
