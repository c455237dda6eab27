"""Shape and timing of a path by a nonlinear program: time-optimal, clear of walls and of what moves (extra `smooth`: CasADi).

The discrete path fixes on which side of everything the path goes; the program bends it within that. Every answer is checked by
the exact swept test and against all limits, and the speed profile of the polyline is returned in place of one that fails.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import AntwayError
from antway.grid import Grid
from antway.planning import TimedPath
from antway.trajectory.profile import is_clear, speed_profile

_SHORTEST = 1e-3  # s, of a step
_SLOWEST = 5e-4  # m/s; a differential drive does not reverse
_TOLERANCE = 1e-6  # m/s, m/s^2, rad/s, rad/s^2
_FINE = 4  # between cell centres a linear distance would be too large near corners


class MissingExtra(AntwayError, ImportError):
    """A part of antway that needs a package which is not installed."""


@dataclass(frozen=True, slots=True)
class Smoothed:
    """The answer of `smooth`.

    Attributes
    ----------
    path : TimedPath
    smooth : bool
        Whether it is the program's; else the checked speed profile of the polyline.
    clear : bool
        Whether the swept test finds the path free; False only where the polyline itself is not.
    reason : str
        Why the program's answer was discarded, if it was.
    """

    path: TimedPath
    smooth: bool
    clear: bool
    reason: str = ""


def smooth(
    points: ArrayLike,
    grid: Grid,
    *,
    radius: float,
    v_max: float,
    a_max: float,
    drive: str = "holonomic",
    turn_rate: float = 2.0,
    turn_acceleration: float = 4.0,
    margin: float = 0.02,
    segments: NDArray[np.float64] | None = None,
    knots: int = 40,
    weights: tuple[float, float, float] = (1.0, 0.1, 0.01),
) -> Smoothed:
    """Bend a polyline into the fastest motion near it, from stand to stand.

    Parameters
    ----------
    points : float64[N, 2]
        m, N >= 2.
    grid : Grid
        The map as it is, not inflated; yaw 0.
    radius, margin : float
        Of the robot, and what more to keep from walls and obstacles, m, >= 0.
    v_max, a_max : float
        m/s, m/s^2, > 0 and finite.
    drive, turn_rate, turn_acceleration
        "holonomic" or "differential"; of the latter rad/s and rad/s^2, > 0. It begins and ends in the directions of the
        polyline and never reverses.
    segments : float64[P, 8] or None
        Predicted obstacles, the robot's radius included (`antway.kernels.spacetime.segments`); the motion starts at time 0.
    knots : int
        Intervals of the program, 4 to 200.
    weights : (w_T, w_L, w_S)
        Of time (1/s), length (1/m) and the sum of squared changes of velocity between knots (s^2/m^2).

    Returns
    -------
    Smoothed

    Raises
    ------
    BadParameter
    MissingExtra
        Without CasADi.

    Notes
    -----
    min w_T sum dt_k + w_L sum |p_k+1 - p_k| + w_S sum |v_k+1 - v_k|^2 subject to p_k+1 = p_k + dt_k v_k, |v_k| <= v_max,
    |v_k+1 - v_k| <= a_max (dt_k + dt_k+1) / 2, first and last velocity within a_max dt / 2 of 0, d(p_k) >= radius + margin in
    the distance field of the walls, |p_k - o_j(t_k)| >= reach_j + margin, both at midpoints too. Differential:
    v_k = speed_k (cos theta_k, sin theta_k) with limits on speed, turn rate and their changes.
    """
    casadi = _casadi()
    xy = checks.array("points", points, (None, 2))
    radius, margin = checks.number("radius", radius, low=0.0, unit="m"), checks.number("margin", margin, low=0.0, unit="m")
    v_max = checks.number("v_max", v_max, low=0.0, high=1e6, open_low=True, unit="m/s")
    a_max = checks.number("a_max", a_max, low=0.0, open_low=True, unit="m/s^2")
    turn_rate = checks.number("turn_rate", turn_rate, low=0.0, open_low=True, unit="rad/s")
    turn_acceleration = checks.number("turn_acceleration", turn_acceleration, low=0.0, open_low=True, unit="rad/s^2")
    differential = checks.choice("drive", drive, ("holonomic", "differential")) == "differential"
    n = checks.integer("knots", knots, low=4, high=200)
    weights = checks.point("weights", weights, size=3)  # type: ignore[assignment]
    checks.instance("grid", grid, Grid)
    if segments is not None:
        checks.array("segments", segments, (None, 8), finite=False)
    guess = speed_profile(xy, v_max, a_max)
    solved, reason = None, ""
    turning = (turn_rate, turn_acceleration) if differential else None
    try:
        solved = _solve(casadi, guess, grid, radius + margin, margin, v_max, a_max, turning, segments, n, weights)
    except RuntimeError as error:  # how CasADi says that IPOPT found no solution
        reason = f"no solution: {str(error).splitlines()[0][:80]}"
    if solved is not None:
        if not is_clear(solved, grid, radius, segments):
            reason = "the solution touches something between its knots"
        elif not _within_limits(solved, v_max, a_max, turning):
            reason = "the solution exceeds a limit"
        elif float(solved.t[-1]) > float(guess.t[-1]) and is_clear(guess, grid, radius, segments) and not differential:
            reason = "the solution is slower than the polyline"
        else:
            return Smoothed(solved, True, True)
    return Smoothed(guess, False, is_clear(guess, grid, radius, segments), reason)


def _within_limits(path: TimedPath, v_max: float, a_max: float, turning: tuple[float, float] | None) -> bool:
    """Tell whether no speed, acceleration, turn rate or change of it is over its limit by more than the solver's tolerance."""
    dt = np.diff(path.t)
    v = np.diff(path.xy, axis=0) / dt[:, None]
    span = (dt[1:] + dt[:-1]) / 2
    ends = np.hypot(*v[[0, -1]].T) / dt[[0, -1]] * 2
    change = np.concatenate((np.hypot(*np.diff(v, axis=0).T) / span, ends))
    fine = np.hypot(*v.T).max() <= v_max + _TOLERANCE and change.max() <= a_max + _TOLERANCE
    if turning and fine:
        rate = np.arctan2(v[1:, 1] * v[:-1, 0] - v[1:, 0] * v[:-1, 1], (v[1:] * v[:-1]).sum(axis=1)) / span
        twist = np.diff(rate, prepend=0.0) / span
        fine = np.abs(rate).max() <= turning[0] + _TOLERANCE and np.abs(twist).max() <= turning[1] + _TOLERANCE
    return bool(fine)


def _casadi() -> ModuleType:
    try:
        import casadi
    except ImportError:
        raise MissingExtra("smooth needs CasADi: install antway[smooth]") from None
    return casadi


def _solve(
    casadi: Any,
    guess: TimedPath,
    grid: Grid,
    clearance: float,
    margin: float,
    v_max: float,
    a_max: float,
    turning: tuple[float, float] | None,
    segments: NDArray[np.float64] | None,
    n: int,
    weights: tuple[float, float, float],
) -> TimedPath:
    opti = casadi.Opti()
    p, v, dt = opti.variable(2, n + 1), opti.variable(2, n), opti.variable(n)
    times = np.linspace(guess.t[0], guess.t[-1], n + 1)
    places = np.column_stack([np.interp(times, guess.t, guess.xy[:, k]) for k in (0, 1)])
    opti.set_initial(p, places.T)
    opti.set_initial(v, (np.diff(places, axis=0) / np.diff(times)[:, None]).T)
    opti.set_initial(dt, np.diff(times))
    opti.subject_to(opti.bounded(_SHORTEST, dt, times[-1] / n))  # long steps would jump corners
    opti.subject_to(p[:, 0] == places[0])
    opti.subject_to(p[:, n] == places[-1])
    distance = _distance(casadi, grid)
    a_max = min(a_max, 2 * v_max / _SHORTEST)  # more binds nothing, and its square may be no number
    now, objective = 0.0, 0.0
    for k in range(n):
        opti.subject_to(p[:, k + 1] == p[:, k] + dt[k] * v[:, k])
        opti.subject_to(casadi.sumsqr(v[:, k]) <= v_max**2)
        step = p[:, k + 1] - p[:, k]
        objective += weights[0] * dt[k] + weights[1] * casadi.sqrt(casadi.sumsqr(step) + 1e-8)
        if k:
            change, span = v[:, k] - v[:, k - 1], (dt[k] + dt[k - 1]) / 2
            opti.subject_to(casadi.sumsqr(change / span) <= a_max**2)  # to the solver's tolerance, however short the step
            objective += weights[2] * casadi.sumsqr(change)
        for share in (0.5, 1.0) if k < n - 1 else (0.5,):
            place, at = p[:, k] + share * step, now + share * dt[k]
            opti.subject_to(distance(place) >= clearance)
            for t0, t1, x, y, ux, uy, radius, _ in segments if segments is not None else ():
                if t0 <= times[k] + share * (times[k + 1] - times[k]) <= t1:  # the piece that holds by the guess
                    gap = place - casadi.vertcat(x + ux * (at - t0), y + uy * (at - t0))
                    opti.subject_to(casadi.sumsqr(gap) >= (radius + margin) ** 2)
        now = now + dt[k]
    for k in (0, n - 1):
        opti.subject_to(casadi.sumsqr(v[:, k] / dt[k]) <= (a_max / 2) ** 2)
    if turning:
        _wheels(casadi, opti, v, dt, places, turning, n)
    opti.minimize(objective)
    opti.solver("ipopt", {"print_time": False, "verbose": False}, {"print_level": 0, "sb": "yes", "max_iter": 300})
    solution = opti.solve()
    t = np.concatenate(([0.0], np.cumsum(solution.value(dt))))
    return TimedPath(t, np.ascontiguousarray(solution.value(p).T))


def _wheels(casadi: Any, opti: Any, v: Any, dt: Any, places: NDArray[np.float64], turning: tuple[float, float], n: int) -> None:
    """Tie velocities to a heading that turns within its limits of rate and acceleration."""
    heading = np.unwrap(np.arctan2(*np.diff(places, axis=0).T[::-1]))
    theta, speed = opti.variable(n), opti.variable(n)
    opti.set_initial(theta, heading)
    opti.set_initial(speed, 0.5)
    opti.subject_to(speed >= _SLOWEST)
    opti.subject_to(theta[0] == heading[0])
    opti.subject_to(theta[n - 1] == heading[-1])
    rate = 0.0
    for k in range(n):
        opti.subject_to(v[:, k] == speed[k] * casadi.vertcat(casadi.cos(theta[k]), casadi.sin(theta[k])))
        if k:
            span = (dt[k] + dt[k - 1]) / 2
            turn, before = (theta[k] - theta[k - 1]) / span, rate
            opti.subject_to(opti.bounded(-turning[0], turn, turning[0]))
            opti.subject_to(opti.bounded(-turning[1], (turn - before) / span, turning[1]))
            rate = turn


def _distance(casadi: Any, grid: Grid) -> Any:
    """Return the distance to walls and to the edges of the map, m, linear between points a quarter of a cell apart."""
    fine = Grid(np.kron(grid.blocked, np.ones((_FINE, _FINE), np.bool_)), grid.resolution / _FINE, grid.origin)
    field = np.pad(fine.clearance(), 1, constant_values=-fine.resolution)
    (x, y, _), size = fine.origin, fine.resolution
    rows, cols = field.shape
    axes = [(x + (np.arange(cols) - 0.5) * size).tolist(), (y + (np.arange(rows) - 0.5) * size).tolist()]
    return casadi.interpolant("distance", "linear", axes, np.minimum(field, math.hypot(rows, cols) * size).ravel())
