"""Compare the speeds that a robot measures with its places."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import wrap
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import RobotState

# Columns of observations: time in s, place in m, heading in rad, and the two speeds as in `RobotState`.
T, X, Y, HEADING, A, B = range(6)
COLUMNS = 6
# The entries of `odometry`: sums of the errors, m/s, of the measured speeds, of the velocity between the two places before, and
# of the speeds that are predicted from the commands alone; the sum of their weights; the velocity between the last two places,
# m/s; and the speeds that are so predicted for now.
MEASURED, BETWEEN, PREDICTED, COMPARED, LAST_X, LAST_Y, PREDICTED_A, PREDICTED_B = range(8)
ODOMETRY = 8  # entries of `odometry`


@bare_kernel
def chord(state: RobotState) -> float:
    """Return how far wheels that began at (0, 0) with the heading 0 are from there, m; negative in reverse."""
    half = 0.5 * state.theta
    return math.copysign(math.hypot(state.x, state.y), state.x * math.cos(half) + state.y * math.sin(half))


@bare_kernel
def middle_heading(before: Floats, now: Floats, predicted: float) -> float:
    """Return the heading half way between two observations, rad, which is that of the chord of an arc.

    Headings tell a turn up to whole turns; it is the one that is nearest to the turn `predicted`, rad.
    """
    turn = wrap(now[HEADING] - before[HEADING])
    return float(before[HEADING] + 0.5 * turn + math.pi * round((predicted - turn) / (2.0 * math.pi)))


@bare_kernel
def _beside(ahead: float, left: float, a: float, b: float, more_a: float, more_b: float) -> tuple[float, float]:
    """Return how far the velocity (ahead, left) is from the nearest of those from (a, b) to (a + more_a, b + more_b), m/s."""
    square = more_a * more_a + more_b * more_b
    part = min(max(((ahead - a) * more_a + (left - b) * more_b) / square, 0.0), 1.0) if square > 0.0 else 0.0
    return ahead - a - part * more_a, left - b - part * more_b


@bare_kernel
def compare_speeds(
    before: Floats, now: Floats, predicted: RobotState, holonomic: bool, memory: float, odometry: Floats
) -> None:
    """Add the errors of measured speeds, of the velocity between the two places before, and of the speeds that are predicted.

    Each is compared with the velocity between the last two places, from the observation `before` to that of `now`. Measured
    speeds have no error if it lies between those before and now, as far as these lead along the chord of an arc, or as far
    beside them as is predicted: a command that begins to act within the period may lead there. `predicted` is where the robot
    as it is declared would be now if it was at (0, 0), with the heading 0, before, and had always followed its commands.
    `memory` is the share in (0, 1] of the earlier errors that is kept, and `odometry` what is known of the errors: zeros at
    first, and no number for LAST_X.
    """
    passed, heading = now[T] - before[T], 0.0 if holonomic else middle_heading(before, now, predicted.theta)
    c, s = math.cos(heading), math.sin(heading)
    vx, vy = (now[X] - before[X]) / passed, (now[Y] - before[Y]) / passed
    ahead, left = c * vx + s * vy, c * vy - s * vx
    a, b, more_a, more_b = before[A], before[B], now[A] - before[A], now[B] - before[B]
    was_a, was_b = odometry[PREDICTED_A], odometry[PREDICTED_B]
    led_a, led_b, grown_a, grown_b = predicted.x / passed, predicted.y / passed, predicted.a - was_a, predicted.b - was_b
    if not holonomic:
        b, more_b, was_b, grown_b, led_a, led_b = 0.0, 0.0, 0.0, 0.0, chord(predicted) / passed, 0.0
        half = heading - before[HEADING]
        shorter = math.sin(half) / half if half != 0.0 else 1.0  # a chord than its arc
        a, more_a, was_a, grown_a = a * shorter, more_a * shorter, was_a * shorter, grown_a * shorter
    if not math.isnan(odometry[LAST_X]):
        beside_a, beside_b = _beside(ahead, left, a, b, more_a, more_b)
        as_led_a, as_led_b = _beside(led_a, led_b, was_a, was_b, grown_a, grown_b)
        measured = min(math.hypot(beside_a, beside_b), math.hypot(beside_a - as_led_a, beside_b - as_led_b))
        between = math.hypot(vx - odometry[LAST_X], vy - odometry[LAST_Y])
        odometry[MEASURED] = memory * odometry[MEASURED] + measured
        odometry[BETWEEN] = memory * odometry[BETWEEN] + between
        odometry[PREDICTED] = memory * odometry[PREDICTED] + math.hypot(ahead - led_a, left - led_b)
        odometry[COMPARED] = memory * odometry[COMPARED] + 1.0
    odometry[LAST_X], odometry[LAST_Y], odometry[PREDICTED_A], odometry[PREDICTED_B] = vx, vy, predicted.a, predicted.b
