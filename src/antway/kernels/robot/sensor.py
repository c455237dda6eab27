"""What a range sensor sees of moving discs, and how noise, losses and a tracker change it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import segment_hits_cells, timeline_at
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rng import State, stream, uniform


@bare_kernel
def scan(
    t: float,
    x: float,
    y: float,
    sensor_range: float,
    occlusion: bool,
    blocked: NDArray[np.bool_],
    frame: NDArray[np.float64],
    knot_t: NDArray[np.float64],
    knot_xy: NDArray[np.float64],
    first: NDArray[np.int64],
    radius: NDArray[np.float64],
    seen: NDArray[np.int64],
    state: NDArray[np.float64],
) -> int:
    """See from (x, y) at time t the discs whose edge is within `sensor_range` m and, with `occlusion`, not hidden by blocked cells.

    A disc is hidden if walls cut the sight of its nearest point and of both its sides.

    Parameters
    ----------
    blocked, frame, knot_t, knot_xy, first, radius
        Map and obstacles, as in kernels/robot/dynamics.py.
    seen, state : int64[K], float64[K, 4]
        Filled with the index and the (x, y, vx, vy) of each disc seen, in the order of the indices.

    Returns
    -------
    int
        How many are seen.
    """
    n = 0
    for k in range(len(radius)):
        ox, oy, vx, vy = timeline_at(t, knot_t, knot_xy, first[k], first[k + 1])
        dx, dy = ox - x, oy - y
        distance = math.hypot(dx, dy)
        if distance - radius[k] > sensor_range:
            continue
        if occlusion and distance > radius[k]:
            ux, uy = dx / distance, dy / distance
            r = radius[k]
            if (
                _hidden(blocked, frame, x, y, ox - r * ux, oy - r * uy)
                and _hidden(blocked, frame, x, y, ox - r * uy, oy + r * ux)
                and _hidden(blocked, frame, x, y, ox + r * uy, oy - r * ux)
            ):
                continue
        seen[n] = k
        state[n, 0], state[n, 1], state[n, 2], state[n, 3] = ox, oy, vx, vy
        n += 1
    return n


@kernel
def _hidden(blocked: NDArray[np.bool_], frame: NDArray[np.float64], x: float, y: float, px: float, py: float) -> bool:
    s = frame[2]
    r0, c0 = (y - frame[1]) / s - 0.5, (x - frame[0]) / s - 0.5
    r1, c1 = (py - frame[1]) / s - 0.5, (px - frame[0]) / s - 0.5
    return segment_hits_cells(blocked, r0, c0, r1, c1, 0.0, False)


@kernel
def normal(state: State) -> float:
    """Step `state` twice and return a standard normal number (Box and Muller)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
    return radius * math.cos(2.0 * math.pi * uniform(state))


@kernel
def degrade(
    n: int,
    t: float,
    seed: np.uint64,
    tick: int,
    dropout: float,
    noise: float,
    velocity_noise: float,
    agility: float,
    seen: NDArray[np.int64],
    state: NDArray[np.float64],
    tracker: NDArray[np.float64],
    covariance: NDArray[np.float64],
) -> int:
    """Lose, blur and track what `scan` saw.

    Each disc is lost with probability `dropout`; its place gets normal noise of `noise` m, its velocity of `velocity_noise`
    m/s. With `agility` > 0 the velocity is not measured but estimated from the places by a Kalman filter for constant velocity
    and white acceleration of that standard deviation (m/s^2), one per disc, begun anew after a second unseen. The noise of a
    disc in scan number `tick` depends on nothing but seed, tick and disc.

    Parameters
    ----------
    n, seen, state
        From `scan`; changed in place.
    tracker : float64[K, 8]
        By disc: x, y, vx, vy, the variances of place and velocity and their covariance (alike in x and y), time; kept from one
        scan to the next, with time NaN before the first.
    covariance : float64[K, 4, 4]
        Filled, of (x, y, vx, vy).

    Returns
    -------
    int
        How many are left.
    """
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
            x, y, vx, vy, pp, pv, vv = _track(tracker[k], t, x, y, noise, agility)
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
    f: NDArray[np.float64], t: float, x: float, y: float, noise: float, agility: float
) -> tuple[float, float, float, float, float, float, float]:
    """Take the measured place into the filter `f` and return its estimate."""
    measured = max(noise * noise, 1e-8)
    dt = t - f[7]
    if not dt <= 1.0:
        f[0], f[1], f[2], f[3] = x, y, 0.0, 0.0
        f[4], f[5], f[6], f[7] = measured, 0.0, 4.0, t  # 2 m/s: a standing start may hide any usual speed
    else:
        q = agility * agility
        x0, y0 = f[0] + f[2] * dt, f[1] + f[3] * dt
        pp = f[4] + 2.0 * dt * f[5] + dt * dt * f[6] + q * dt**4 / 4.0
        pv = f[5] + dt * f[6] + q * dt**3 / 2.0
        vv = f[6] + q * dt * dt
        gain_p, gain_v = pp / (pp + measured), pv / (pp + measured)
        f[0], f[1] = x0 + gain_p * (x - x0), y0 + gain_p * (y - y0)
        f[2], f[3] = f[2] + gain_v * (x - x0), f[3] + gain_v * (y - y0)
        f[4], f[5], f[6], f[7] = (1.0 - gain_p) * pp, (1.0 - gain_p) * pv, vv - gain_v * pv, t
    return f[0], f[1], f[2], f[3], f[4], f[5], f[6]
