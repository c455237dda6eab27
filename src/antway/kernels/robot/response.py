"""How a robot answers its commands: candidates for its latency and its ramps, compared with the speeds that it reaches."""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState
from antway.kernels.robot.motion import drive_roughly
from antway.kernels.robot.odometry import LAST_X, PREDICTED_A, PREDICTED_B, A, B, T, X, Y, compare_speeds, middle_heading

GROWS, SLOWS, TURNS = 0, 1, 2  # kinds of errors, each of which depends on one of the candidates' three limits
# The entries of `place`: the error of the robot's place in x and y, m; the sum of its squares, m^2, and of their weights; and
# the two sums, m^2, whose ratio is the factor by which speeds are wrong.
ERROR_X, ERROR_Y, SQUARES, WEIGHT, FACTOR, LED = range(6)
PLACE = 6  # entries of `place`
_PLACE_MEMORY = 3.0  # s; errors of the robot's place are forgotten in this time
_LEAST = 1e-9  # s; rounding errors of times are shorter, and without inertia any time is enough to change the speeds
_RIGHT = 1e-12  # 1; while the squared error of the first candidate is less, the others are not tried


class Period(NamedTuple):
    """The time between two successive observations, and the commands that were given before its end."""

    before: Floats  # [COLUMNS] the observations, as in kernels/robot/odometry.py
    now: Floats  # [COLUMNS]
    sent: Floats  # [M, 3] the commands, in their order: when each was given in s, and its two numbers


@bare_kernel
def answered(state: RobotState, period: Period, limits: RobotLimits) -> RobotState:
    """Return the state at the end of a period of a robot that is in `state` at its start.

    A command acts from `limits.latency` s after it was given until the next one does. What acts before the first is not known,
    and the speeds then stay.
    """
    start, end, sent = period.before[T], period.now[T], period.sent
    known = min(sent[0, 0] + limits.latency, end) if len(sent) else end
    if known - start > _LEAST:
        later = drive_roughly(state, state.a, state.b, limits, known - start)
        state = RobotState(later.x, later.y, later.theta, state.a, state.b)
    for i in range(len(sent)):
        first = max(sent[i, 0] + limits.latency, start)
        last = min(sent[i + 1, 0] + limits.latency, end) if i + 1 < len(sent) else end
        if last - first > _LEAST:
            state = drive_roughly(state, sent[i, 1], sent[i, 2], limits, last - first)
    return state


@bare_kernel
def learn_place(before: Floats, now: Floats, predicted: RobotState, holonomic: bool, memory: float, place: Floats) -> float:
    """Return the standard deviation of the errors of the robot's place in x and in y, m; the parameters as in `learn`.

    A miss is the distance of the robot from the place predicted, corrected by the error of the speeds predicted, as if that had
    grown evenly. An error is the sum of all misses, which are forgotten within a few seconds: a place that jumps stays wrong
    until it jumps again. Speeds that are wrong by a constant factor do not count. `predicted` is the state now if it was at
    (0, 0), with the heading 0, before.
    """
    passed = now[T] - before[T]
    more_a, more_b = 0.5 * passed * (now[A] - predicted.a), 0.5 * passed * (now[B] - predicted.b)
    if holonomic:
        led_x, led_y = predicted.x + more_a, predicted.y + more_b
    else:  # ramps of fast wheels lead some millimetres to the side of the middle heading
        half, middle = 0.5 * predicted.theta, middle_heading(before, now, predicted.theta)
        ahead = predicted.x * math.cos(half) + predicted.y * math.sin(half) + more_a
        left = predicted.y * math.cos(half) - predicted.x * math.sin(half)
        led_x = ahead * math.cos(middle) - left * math.sin(middle)
        led_y = ahead * math.sin(middle) + left * math.cos(middle)
    miss_x, miss_y = now[X] - before[X] - led_x, now[Y] - before[Y] - led_y
    place[FACTOR] = memory * place[FACTOR] + miss_x * led_x + miss_y * led_y
    place[LED] = memory * place[LED] + led_x * led_x + led_y * led_y
    factor = place[FACTOR] / place[LED] if place[LED] > 0.0 else 0.0
    kept = math.exp(-passed / _PLACE_MEMORY)
    place[ERROR_X] = kept * place[ERROR_X] + miss_x - factor * led_x
    place[ERROR_Y] = kept * place[ERROR_Y] + miss_y - factor * led_y
    place[SQUARES] = memory * place[SQUARES] + place[ERROR_X] ** 2 + place[ERROR_Y] ** 2
    place[WEIGHT] = memory * place[WEIGHT] + 1.0
    return math.sqrt(0.5 * place[SQUARES] / place[WEIGHT])


@bare_kernel
def _limited(limits: RobotLimits, a_max: float, brake_max: float, alpha_max: float, latency: float) -> RobotLimits:
    """Return the limits with another latency and other ramps."""
    drive, v_max, v_reverse, _, _, turn_rate, _, turning_radius, _, radius = limits
    return RobotLimits(drive, v_max, v_reverse, a_max, brake_max, turn_rate, alpha_max, turning_radius, latency, radius)


@kernel
def learn(
    period: Period,
    limits: RobotLimits,
    latencies: Floats,
    ramps: Floats,
    memory: float,
    used: Ints,
    error: Floats,
    place: Floats,
    odometry: Floats,
) -> tuple[float, float, float, float]:
    """Add the errors with which each candidate predicts the present speeds from those before.

    While the first candidate has been right, only its own errors are added. The candidates replace the limits' latency by one
    of `latencies`, float64[L], s, and a_max, brake_max (m/s^2) and alpha_max (rad/s^2) by one of each column of `ramps`,
    float64[R, 3]. `used`, int64[4], is the candidate in use: the index of its latency, and of each of its limits in `ramps`.
    `memory` is the share in (0, 1] of the earlier errors that is kept. `error`, float64[3, L, R], are sums of squared errors of
    the speed, as shares of the top speed, while it grows or stays (GROWS) and while it falls (SLOWS), and of the turn rate as
    shares of its limit (TURNS), 0 for a holonomic robot. `place` is what is known of the errors of the robot's place, zeros at
    first, and `odometry` as in `compare_speeds`.

    Returns the sum of the squared errors of the first candidate; the standard deviation of the errors of the robot's place in x
    and in y, m; and the root mean squares of the errors of speed and turn rate of the candidate in use, as shares like `error`.
    """
    before, now, holonomic = period.before, period.now, limits.drive == HOLONOMIC
    state = RobotState(0.0, 0.0, 0.0, before[A], before[B])
    in_use = _limited(limits, ramps[used[1], 0], ramps[used[2], 1], ramps[used[3], 2], latencies[used[0]])
    predicted = answered(state, period, in_use)
    if math.isnan(odometry[LAST_X]):
        odometry[PREDICTED_A], odometry[PREDICTED_B] = before[A], before[B]
    alone = RobotState(0.0, 0.0, 0.0, odometry[PREDICTED_A], odometry[PREDICTED_B])
    declared = _limited(limits, ramps[0, 0], ramps[0, 1], ramps[0, 2], latencies[0])
    compare_speeds(before, now, answered(alone, period, declared), holonomic, memory, odometry)
    misplaced = learn_place(before, now, predicted, holonomic, memory, place)
    slows = math.hypot(now[A], now[B]) < math.hypot(before[A], before[B]) if holonomic else abs(now[A]) < abs(before[A])
    for i in range(len(latencies)):
        for k in range(len(ramps)):
            one = _limited(limits, ramps[k, 0], ramps[k, 1], ramps[k, 2], latencies[i])
            later = answered(state, period, one)
            miss_a, miss_b = (later.a - now[A]) / limits.v_max, later.b - now[B]
            if holonomic:
                miss_a, miss_b = math.hypot(miss_a, miss_b / limits.v_max), 0.0
            else:
                miss_b /= limits.turn_rate
            for kind in (GROWS, SLOWS, TURNS):
                error[kind, i, k] *= memory
            error[SLOWS if slows else GROWS, i, k] += miss_a * miss_a
            error[TURNS, i, k] += miss_b * miss_b
            if i == 0 and k == 0 and error[:, 0, 0].sum() < _RIGHT:
                return 0.0, misplaced, 0.0, 0.0
    speed = error[GROWS, used[0], used[1]] + error[SLOWS, used[0], used[2]]
    turn = error[TURNS, used[0], used[3]]
    return error[:, 0, 0].sum(), misplaced, math.sqrt(speed / place[WEIGHT]), math.sqrt(turn / place[WEIGHT])
