"""How a robot answers its commands: candidates for its latency and its ramps, compared with the speeds that it reaches."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import wrap
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState
from antway.kernels.robot.motion import drive_roughly

T, X, Y, HEADING, A, B = range(6)  # columns of observations
COLUMNS = 6
GROWS, SLOWS, TURNS = 0, 1, 2  # kinds of errors, each of which depends on one of the candidates' three limits
_LEAST = 1e-9  # s; rounding errors of times are shorter, and without inertia any time is enough to change the speeds
_RIGHT = 1e-12  # 1; while the squared error of the first candidate is less, the others are not tried


@bare_kernel
def answered(
    a: float, b: float, start: float, end: float, given: NDArray[np.float64], commands: NDArray[np.float64], limits: RobotLimits
) -> tuple[float, float]:
    """Return the speeds at `end` s of a robot with speeds (a, b) at `start` s, to which commands were given before.

    Parameters
    ----------
    a, b : float
        (v, omega) of wheels, (vx, vy) of a holonomic robot.
    start, end : float
    given : float64[M]
        When each command was given, s, in this order; it acts from `limits.latency` s later until the next one does. What acts
        before the first is not known, and the speeds then stay.
    commands : float64[M, 2]
    limits : RobotLimits
    """
    for i in range(len(given)):
        first = max(given[i] + limits.latency, start)
        last = min(given[i + 1] + limits.latency, end) if i + 1 < len(given) else end
        if last - first > _LEAST:
            later = drive_roughly(RobotState(0.0, 0.0, 0.0, a, b), commands[i, 0], commands[i, 1], limits, last - first)
            a, b = later.a, later.b
    return a, b


@bare_kernel
def place_miss(before: NDArray[np.float64], now: NDArray[np.float64], holonomic: bool) -> float:
    """Return how far the robot is from where its speeds led it since the observation before, m; the parameters as in `learn`.

    The speeds have changed evenly or, without inertia, at once; the smaller distance counts.
    """
    passed = now[T] - before[T]
    heading = before[HEADING] + 0.5 * wrap(now[HEADING] - before[HEADING])
    least = math.inf
    for share in (0.5, 1.0):
        vx = share * now[A] + (1.0 - share) * before[A]
        vy = share * now[B] + (1.0 - share) * before[B]
        if not holonomic:
            vx, vy = vx * math.cos(heading), vx * math.sin(heading)
        least = min(least, math.hypot(now[X] - before[X] - passed * vx, now[Y] - before[Y] - passed * vy))
    return least


@kernel
def learn(
    before: NDArray[np.float64],
    now: NDArray[np.float64],
    given: NDArray[np.float64],
    commands: NDArray[np.float64],
    limits: RobotLimits,
    latencies: NDArray[np.float64],
    ramps: NDArray[np.float64],
    memory: float,
    used: NDArray[np.int64],
    error: NDArray[np.float64],
    place: NDArray[np.float64],
) -> tuple[float, float, float, float]:
    """Add how wrong each candidate foretells the speeds of now from those before; only the first, while it has been right.

    Parameters
    ----------
    before, now : float64[6]
        Two successive observations: time in s (T), place in m (X, Y), heading in rad (HEADING), and the two speeds as in
        `RobotState` (A, B).
    given, commands : float64[M], float64[M, 2]
        As in `answered`.
    limits : RobotLimits
        Of the robot; each candidate replaces its latency, a_max, brake_max and alpha_max.
    latencies : float64[L]
        Candidates for the latency, s.
    ramps : float64[R, 3]
        Candidates for a_max, brake_max (m/s^2) and alpha_max (rad/s^2).
    memory : float
        Share in (0, 1] of the earlier errors that is kept.
    used : int64[4]
        The candidate in use: index of the latency, and of each of the three limits in `ramps`.
    error : float64[3, L, R]
        Sums of squared errors of the speed, as shares of the top speed, while it grows or stays (GROWS) and while it falls
        (SLOWS), and of the turn rate as shares of its limit (TURNS), 0 for a holonomic robot.
    place : float64[2]
        Sum of the squares of `place_miss`, m^2, and of their weights.

    Returns
    -------
    first : float
        Sum of the squared errors of the first candidate.
    misplaced : float
        Standard deviation of the errors of the robot's place in x and in y, m, by `place_miss`.
    speed, turn : float
        Root mean squares of the errors of the candidate in use, as shares like `error`.
    """
    holonomic = limits.drive == HOLONOMIC
    miss = place_miss(before, now, holonomic)
    place[0] = memory * place[0] + miss * miss
    place[1] = memory * place[1] + 1.0
    slows = math.hypot(now[A], now[B]) < math.hypot(before[A], before[B]) if holonomic else abs(now[A]) < abs(before[A])
    for i in range(len(latencies)):
        for k in range(len(ramps)):
            one = RobotLimits(
                limits.drive,
                limits.v_max,
                limits.v_reverse,
                ramps[k, 0],
                ramps[k, 1],
                limits.turn_rate,
                ramps[k, 2],
                limits.turning_radius,
                latencies[i],
                limits.radius,
            )
            a, b = answered(before[A], before[B], before[T], now[T], given, commands, one)
            miss_a, miss_b = (a - now[A]) / limits.v_max, b - now[B]
            if holonomic:
                miss_a, miss_b = math.hypot(miss_a, miss_b / limits.v_max), 0.0
            elif limits.turn_rate < math.inf:
                miss_b /= limits.turn_rate
            error[:, i, k] *= memory
            error[SLOWS if slows else GROWS, i, k] += miss_a * miss_a
            error[TURNS, i, k] += miss_b * miss_b
            if i == 0 and k == 0 and error[:, 0, 0].sum() < _RIGHT:
                return 0.0, 0.5 * math.sqrt(place[0] / place[1]), 0.0, 0.0
    speed = error[GROWS, used[0], used[1]] + error[SLOWS, used[0], used[2]]
    turn = error[TURNS, used[0], used[3]]
    # Both places of a distance are wrong, in both directions.
    misplaced = 0.5 * math.sqrt(place[0] / place[1])
    return error[:, 0, 0].sum(), misplaced, math.sqrt(speed / place[1]), math.sqrt(turn / place[1])
