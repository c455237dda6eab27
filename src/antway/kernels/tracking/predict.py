"""Predictions of tracks: constant velocity, mirrored at walls, in tubes that widen with the uncertainty."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base import records
from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import first_wall, reflected
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import Terrain

X, Y, VX, VY, RADIUS, SIGMA, SIGMA_V, ID = range(8)  # columns of the track estimates, one row for each track
MIRRORS = 4  # a track is mirrored at walls at most this many times
STEP_TIME = 0.25  # s; a predicted trajectory has one velocity for each step of this length
NO_PREDICTIONS = np.empty((0, 1, 2))  # for tracks that all keep their velocity
_TIERS = (0.5, 1.0)  # s; a tube widens in steps, at these times from now
FAR_AHEAD = 2.5  # s; from this time on, tracks on predicted trajectories have a smaller clearance radius
_LESS_CLEARANCE = 0.1  # m; that clearance radius is smaller by this
_FULL = 1.5  # s; the extra clearance grows linearly up to this time ahead, so that an approaching robot may lose it gradually
_FINE = 1e-3  # m; a tube that would widen by less than this has one width
_KNOWN = 1.0  # s; tubes do not widen after this time, because a new plan exists by then and wider tubes would close every path


class TubeMargins(NamedTuple):
    """How wide the tubes of a prediction are."""

    robot_radius: float  # m
    margin: float = 0.0  # m; added to the radii
    quantile: float = 0.0  # 1; this many standard deviations of the place are added at each time
    speed_bound: float = 0.0  # m/s; no obstacle is faster
    acceleration_bound: float = 0.0  # m/s^2; no obstacle's speed grows faster
    # s; a moving robot keeps clear of all that an obstacle could reach from its place this long before
    stopping_time: float = 0.0
    # m/s^2; no obstacle's velocity vector changes faster. If finite, a moving robot keeps clear of all that an obstacle could
    # reach within the stopping time around its predicted place.
    vector_bound: float = math.inf
    drift_time: float = 0.0  # s; this times the standard deviation of a track's velocity is added to the margin
    # s; this times the same is added to the tube of a track that keeps its velocity, as far as there is space now
    extra_drift_time: float = 0.0
    edges: bool = True  # whether obstacles turn back at the edges of the map as they do at walls


@kernel
def time_shift(margins: TubeMargins) -> float:
    """Return how much earlier than the estimates the segments begin, s.

    Without a bound on the change of velocities, clearance is measured from where an obstacle was `stopping_time` s before.
    """
    return margins.stopping_time if margins.vector_bound == math.inf else 0.0


@kernel
def crosses_edge(estimates: Floats, terrain: Terrain) -> bool:
    """Tell whether the centre of any track is outside the map, which shows that obstacles do not turn back at the edges."""
    rows, cols = terrain.blocked.shape
    for k in range(len(estimates)):
        x, y = estimates[k, X] - terrain.x0, estimates[k, Y] - terrain.y0
        if min(x, y, cols * terrain.resolution - x, rows * terrain.resolution - y) < 0.0:
            return True
    return False


@bare_kernel
def _at_edge(terrain: Terrain, row: float, col: float, n_row: float, n_col: float, radius: float) -> bool:
    """Tell whether a disc at (row, col) that touches something in the direction -(n_row, n_col) touches an edge of the map."""
    rows, cols = terrain.blocked.shape
    row, col = row - n_row * radius, col - n_col * radius
    return bool(min(row + 0.5, rows - 0.5 - row, col + 0.5, cols - 0.5 - col) < 1e-3)


@bare_kernel
def _deviation_within_stopping_time(margins: TubeMargins, speed: float) -> float:
    """Return how far an obstacle with this speed may come from its predicted place before the robot has stopped, m."""
    if margins.speed_bound <= 0.0:
        return 0.0
    stopping_time, vector_bound = margins.stopping_time, margins.vector_bound
    distance = min(max(margins.speed_bound, speed), speed + margins.acceleration_bound * stopping_time) * stopping_time
    if vector_bound < math.inf:
        distance = min(0.5 * vector_bound * stopping_time * stopping_time, distance + speed * stopping_time)
    return distance


@bare_kernel
def _last_step_alike(trajectory: Floats, i: int) -> int:
    """Return the last step after step i that has the same velocity without a break; it does not cross FAR_AHEAD."""
    vx, vy = trajectory[i, 0], trajectory[i, 1]
    while i + 1 < len(trajectory) and trajectory[i + 1, 0] == vx and trajectory[i + 1, 1] == vy:
        if abs((i + 1) * STEP_TIME - FAR_AHEAD) < 1e-9:
            break
        i += 1
    return i


@inner_kernel
def tube_width(margins: TubeMargins, sigma: float, sigma_v: float, ahead: float, gap: float, keeps_velocity: bool) -> float:
    """Return the width of a tube beyond the radii of the bodies, m: it grows with the time `ahead` of the estimate, s.

    Where the track keeps its velocity, extra clearance is added as far as the present `gap` allows, m.
    """
    width = margins.margin + margins.drift_time * sigma_v
    width += margins.quantile * math.sqrt(sigma**2 + (sigma_v * min(ahead, _KNOWN)) ** 2)
    if keeps_velocity:
        width += min(margins.extra_drift_time * sigma_v * min(ahead / _FULL, 1.0), max(gap - width, 0.0))
    return width


@kernel
def predict(
    estimates: Floats,
    now: float,
    age: float,
    horizon: float,
    robot_x: float,
    robot_y: float,
    margins: TubeMargins,
    terrain: Terrain,
    prediction: Floats,
    out: Floats,
) -> int:
    """Turn track estimates into motion segments (kernels/spacetime/segments.py) for a robot at (robot_x, robot_y).

    Each row of `estimates`, float64[K, 8], has x, y (m), vx, vy (m/s), radius (m), standard deviations of place (m) and of
    velocity (m/s), and the track's id; they are `age` s old. It is predicted `horizon` s ahead. Segments begin `time_shift` s
    before the estimates. `prediction`, float64[N, S, 2], are velocities of the first N tracks in steps of STEP_TIME s, m/s. NaN
    marks a track that keeps its velocity; all tracks from N on keep theirs. Returns the number of segments written to `out`,
    float64[P, 8].

    If the robot is already within the margins of a track, the margins are reduced to the present distance. The robot may then
    stand there. The radii of the bodies are never reduced. The clearance radius is reduced likewise for the first
    `stopping_time` s. The robot may then leave at once if it comes no nearer before it is clear, as the guard requires. From
    FAR_AHEAD s after the estimates on, the clearance radius of a track on a predicted trajectory is smaller, because a new plan
    exists by then.
    """
    n = 0
    size = terrain.resolution
    quantile, stopping_time, shift = margins.quantile, margins.stopping_time, time_shift(margins)
    for k in range(len(estimates)):
        x, y, vx, vy = estimates[k, X], estimates[k, Y], estimates[k, VX], estimates[k, VY]
        radius, sigma, sigma_v = estimates[k, RADIUS], estimates[k, SIGMA], estimates[k, SIGMA_V]
        bodies = margins.robot_radius + radius
        gap = math.hypot(x + vx * age - robot_x, y + vy * age - robot_y) - bodies
        deviation = _deviation_within_stopping_time(margins, math.hypot(vx, vy))
        # The distance to the obstacle's place now, or to the one from which clearance is measured, whichever is less.
        present = min(gap + bodies, math.hypot(x + vx * (age - shift) - robot_x, y + vy * (age - shift) - robot_y))
        margin, extra = margins.margin + margins.drift_time * sigma_v, margins.extra_drift_time * sigma_v
        too_near = present < bodies + margin + quantile * math.hypot(sigma, sigma_v * (_TIERS[0] + age)) + deviation
        one_width = quantile * math.hypot(sigma, sigma_v * _KNOWN) + extra < _FINE
        x, y, t, mirrors = x - vx * shift, y - vy * shift, -age - shift, 0
        on_trajectory = k < len(prediction) and not math.isnan(prediction[k, 0, 0])
        while t < horizon and n < len(out):
            # A segment ends where the tube widens, the predicted velocity changes, or the reduced clearance does ...
            end = horizon
            if not one_width:
                for tier in _TIERS:
                    if tier > t + 1e-9:
                        end = min(tier, horizon)
                        break
            if on_trajectory and mirrors == 0:
                i = int((t + age + 1e-9) / STEP_TIME)
                if t < -age - 1e-9:
                    end = min(end, -age)
                elif i < len(prediction[k]):
                    vx, vy = prediction[k, i, 0], prediction[k, i, 1]
                    end = min(end, (_last_step_alike(prediction[k], i) + 1) * STEP_TIME - age)
            leaving = too_near and t < stopping_time - shift - 1e-9
            if leaving:
                end = min(end, stopping_time - shift)
            # ... or at a wall, which mirrors the track.
            col, row = (x - terrain.x0) / size - 0.5, (y - terrain.y0) / size - 0.5
            share, n_row, n_col = first_wall(
                terrain.blocked, row, col, vy * (end - t) / size, vx * (end - t) / size, radius / size, terrain.blocks
            )
            mirrored = share <= 1.0 and mirrors < MIRRORS
            if mirrored and not margins.edges:
                fraction = share * (end - t) / size
                mirrored = not _at_edge(terrain, row + vy * fraction, col + vx * fraction, n_row, n_col, radius / size)
            until = t + share * (end - t) if mirrored else end
            if until > t:
                width = tube_width(margins, sigma, sigma_v, max(until + age, 0.0), gap, not on_trajectory)
                contact = bodies + max(min(width, gap - 1e-6), 0.0)
                clearance = max(present - 1e-6, 0.0) if leaving else bodies + width + deviation
                if on_trajectory and t + age > FAR_AHEAD - 1e-9 and vx * vx + vy * vy > 0.01:
                    clearance = max(clearance - _LESS_CLEARANCE, contact)
                out[n, records.T0], out[n, records.T1] = now + t, now + until
                out[n, records.X], out[n, records.Y], out[n, records.VX], out[n, records.VY] = x, y, vx, vy
                out[n, records.CONTACT_RADIUS], out[n, records.CLEARANCE_RADIUS] = contact, clearance
                n += 1
                x, y, t = x + vx * (until - t), y + vy * (until - t), until
            if mirrored:
                mirrors += 1
                vx, vy = reflected(vx, vy, n_col, n_row)
    return n
