"""Speeds along a polyline: as fast as limits of speed and acceleration allow, exact, by one pass forward and one back."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid
from antway.kernels.base.geometry import segment_hits_cells
from antway.kernels.base.records import Predictions
from antway.kernels.spacetime.motion import first_conflict
from antway.planning import TimedPath


def speed_profile(
    points: ArrayLike, v_max: float, a_max: float, *, dt: float = 0.1, t: float = 0.0, corner: float = 0.0
) -> TimedPath:
    """Return the fastest motion along a polyline that stands at both ends.

    Parameters
    ----------
    points : float64[N, 2]
        m, N >= 2; equal neighbours count once.
    v_max, a_max : float
        m/s and m/s^2, > 0; with an infinite `a_max` all of it is driven at full speed.
    dt : float
        While it accelerates or brakes the motion has a knot every `dt` s at most, > 0; and one at every vertex.
    t : float
        When it begins, s.
    corner : float
        The velocity vector turns at once at a vertex; it may change by at most a_max * `corner` there, s, >= 0. With the angle
        phi between two legs that is a speed of a_max * corner / (2 sin(phi / 2)); 0: the motion stands at every corner.

    Returns
    -------
    TimedPath
        Knots lie on the exact motion: s = v t + a t^2 / 2 on each ramp. Straight and at constant speed between knots, it has
        the mean speed of its ramp there, so it is never faster than v_max.

    Raises
    ------
    BadParameter

    Notes
    -----
    v_i <= sqrt(v_{i-1}^2 + 2 a_max l_i) forward and the same backward; each leg is then driven up, level and down. No leg takes
    longer than the trapezoid that stands at both of its ends.

    Examples
    --------
    >>> path = speed_profile([(0.0, 0.0), (4.0, 0.0)], 1.0, 1.0)
    >>> round(float(path.t[-1]), 9)
    5.0
    """
    xy = checks.array("points", points, (None, 2))
    v_max = checks.number("v_max", v_max, low=0.0, open_low=True, unit="m/s")
    a_max = checks.number("a_max", a_max, low=0.0, open_low=True, infinite=True, unit="m/s^2")
    dt, t = checks.number("dt", dt, low=0.0, open_low=True, unit="s"), checks.number("t", t, unit="s")
    corner = checks.number("corner", corner, low=0.0, unit="s")
    xy = xy[np.concatenate(([True], (np.diff(xy, axis=0) != 0.0).any(axis=1)))]
    if len(xy) < 2:
        raise BadParameter("points", len(xy), "at least 2 different points")
    legs = np.diff(xy, axis=0)
    length = np.hypot(legs[:, 0], legs[:, 1])
    if math.isinf(a_max):
        return TimedPath(t + np.concatenate(([0.0], np.cumsum(length / v_max))), xy.copy())
    speed = _corner_speeds(legs / length[:, None], v_max, a_max * corner)
    for i in range(1, len(speed)):
        speed[i] = min(speed[i], math.sqrt(speed[i - 1] ** 2 + 2.0 * a_max * length[i - 1]))
    for i in range(len(speed) - 2, -1, -1):
        speed[i] = min(speed[i], math.sqrt(speed[i + 1] ** 2 + 2.0 * a_max * length[i]))
    times, places, now = [t], [xy[:1]], t
    for i, whole in enumerate(length.tolist()):
        share, spent = _leg(whole, float(speed[i]), float(speed[i + 1]), v_max, a_max, dt)
        times.extend((now + spent).tolist())
        places.append(xy[i] + share[:, None] * legs[i])
        places[-1][-1] = xy[i + 1]
        now = times[-1]
    return TimedPath(np.array(times), np.vstack(places))


def _corner_speeds(directions: NDArray[np.float64], v_max: float, change: float) -> NDArray[np.float64]:
    """Return the greatest speed at each vertex: 0 at the ends, and what a jump of velocity by `change` m/s allows."""
    jump = np.hypot(*np.diff(directions, axis=0).T)  # 2 sin(phi / 2)
    straight = jump < 1e-9
    inner = np.where(straight, v_max, np.minimum(change / np.where(straight, 1.0, jump), v_max))
    return np.concatenate(([0.0], inner, [0.0]))


def _leg(
    length: float, start: float, end: float, v_max: float, a_max: float, dt: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the knots of one leg after its first: shares of its length, and times since its begin, s."""
    peak = min(v_max, math.sqrt(a_max * length + (start * start + end * end) / 2.0))
    up, down = (peak - start) / a_max, (peak - end) / a_max
    level = max(length - (peak * peak - start * start + peak * peak - end * end) / (2.0 * a_max), 0.0) / peak
    since, gone, now, path = [], [], 0.0, 0.0
    for duration, speed, rate in ((up, start, a_max), (level, peak, 0.0), (down, peak, -a_max)):
        steps = math.ceil(duration / dt) if rate else 1
        if duration > 1e-12:
            z = duration * np.arange(1, steps + 1) / steps
            since.append(now + z)
            gone.append(path + speed * z + rate * z * z / 2.0)
            now, path = now + duration, float(gone[-1][-1])
    return np.concatenate(gone) / path, np.concatenate(since)


def is_clear(path: TimedPath, grid: Grid, radius: float, segments: NDArray[np.float64] | None = None) -> bool:
    """Tell, by the exact swept test, whether a disc of `radius` m on `path` touches neither walls nor moving obstacles.

    `segments` is float64[P, 8] as in `antway.kernels.spacetime.segments`, radii included.
    """
    checks.instance("path", path, TimedPath)
    checks.instance("grid", grid, Grid)
    radius = checks.number("radius", radius, low=0.0, unit="m")
    if segments is not None:
        checks.array("segments", segments, (None, 8), finite=False)
    points = grid.to_points(path.xy).tolist()
    for (ar, ac), (br, bc) in pairwise(points):
        if segment_hits_cells(grid.blocked, ar, ac, br, bc, radius / grid.resolution, True):
            return False
    if segments is None or not len(segments):
        return True
    knots = np.column_stack((path.t, path.xy))
    return first_conflict(knots, float(path.t[0]), Predictions(segments, 0.0, np.empty(2))) == math.inf
