"""Records that travel together through the kernels: named tuples of numbers and arrays."""

from __future__ import annotations

from typing import NamedTuple

HOLONOMIC, DIFFERENTIAL, ACKERMANN = range(3)  # drives: any direction; two wheels; steering


class RobotLimits(NamedTuple):
    """What a robot can do. Limits may be infinite, but for v_max and v_reverse."""

    drive: int  # HOLONOMIC, DIFFERENTIAL or ACKERMANN
    v_max: float  # m/s, > 0
    v_reverse: float  # m/s, >= 0; wheels drive backwards at most so fast
    a_max: float  # m/s^2, > 0; growth of the speed
    brake_max: float  # m/s^2, > 0; fall of the speed
    turn_rate: float  # rad/s, > 0
    alpha_max: float  # rad/s^2, > 0; growth and fall of the turn rate
    turning_radius: float  # m, >= 0; for ACKERMANN |omega| <= |v| / turning_radius
    latency: float  # s, >= 0; a command acts so long after it was given
    radius: float  # m; of the disc around the robot's centre that holds all of it
