"""The robot's dynamics in rollouts: ramps of speed, and one control period after another."""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base.jit import inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState


class MotionState(NamedTuple):
    """A robot's state as rollouts step it: its heading is kept as cosine and sine."""

    x: float  # m
    y: float  # m
    cos: float  # of the heading
    sin: float
    a: float  # m/s; speed of a robot on wheels, else the velocity's x
    b: float  # rad/s; turn rate of a robot on wheels, else the velocity's y in m/s


@inner_kernel
def motion_state(state: RobotState) -> MotionState:
    """Return the motion state of a robot in `state`."""
    return MotionState(state.x, state.y, math.cos(state.theta), math.sin(state.theta), state.a, state.b)


@inner_kernel
def ramp(now: float, target: float, rise: float, fall: float) -> tuple[float, float]:
    """Return the speed at the end of a period and its mean over it, on a linear ramp to `target`.

    In the period the magnitude of the speed can increase by `rise` and decrease by `fall`. A ramp across zero stops at zero.
    """
    if now * target < 0.0:
        target = 0.0 if abs(now) > fall else target
    most = rise if abs(target) > abs(now) else fall
    change = target - now
    if change > most:
        return now + most, now + 0.5 * most
    if change < -most:
        return now - most, now - 0.5 * most
    return target, target - 0.5 * change * abs(change) / most if most > 0.0 else target


@inner_kernel
def step(at: MotionState, one: float, two: float, limits: RobotLimits, dt: float) -> MotionState:
    """Return the motion state after a period of `dt` s under the command (one, two), whose units are those of a and b.

    The motion is that of kernels/robot/motion.py, except that the arc is replaced by its chord in the direction of the heading
    at half time. The error is less than a millimetre.
    """
    # Square roots, unlike `math.hypot`, become SIMD instructions where rollouts are stepped abreast.
    x, y, c, s, a, b = at
    if limits.drive == HOLONOMIC:
        speed = math.sqrt(one * one + two * two)
        if speed > limits.v_max:
            one, two = one * limits.v_max / speed, two * limits.v_max / speed
        da, db = one - a, two - b
        change = math.sqrt(da * da + db * db)
        most = (limits.brake_max if one * one + two * two < a * a + b * b else limits.a_max) * dt
        if change > most:
            da, db = da * most / change, db * most / change
            return MotionState(x + (a + 0.5 * da) * dt, y + (b + 0.5 * db) * dt, c, s, a + da, b + db)
        late = 0.5 * change / most if change > 0.0 else 0.0
        return MotionState(x + (a + da * (1.0 - late)) * dt, y + (b + db * (1.0 - late)) * dt, c, s, a + da, b + db)
    a, mean = ramp(a, min(max(one, -limits.v_reverse), limits.v_max), limits.a_max * dt, limits.brake_max * dt)
    tightest = abs(mean) / limits.turning_radius if limits.turning_radius > 0.0 else math.inf
    most = min(limits.turn_rate, tightest)
    b, spin = ramp(b, min(max(two, -most), most), limits.alpha_max * dt, limits.alpha_max * dt)
    if limits.turning_radius > 0.0:  # in the mean, a car that sets out or brakes turns as its mean speed allows
        last = abs(a) / limits.turning_radius
        spin, b = min(max(spin, -tightest), tightest), min(max(b, -last), last)
    # Cosine and sine of half the turn from their Taylor series, which takes less time than the functions of the library.
    half = 0.5 * spin * dt
    q = half * half
    ch = 1.0 - q * (0.5 - q * (1.0 / 24.0 - q * (1.0 / 720.0)))
    sh = half * (1.0 - q * (1.0 / 6.0 - q * (1.0 / 120.0 - q * (1.0 / 5040.0))))
    mc, ms = c * ch - s * sh, s * ch + c * sh
    return MotionState(x + mean * dt * mc, y + mean * dt * ms, mc * ch - ms * sh, ms * ch + mc * sh, a, b)


@inner_kernel
def within_limits(one: float, two: float, limits: RobotLimits) -> tuple[float, float]:
    """Return a command whose two parts are limited, each by itself, to what the robot can do."""
    holonomic = limits.drive == HOLONOMIC
    slowest = -limits.v_max if holonomic else -limits.v_reverse
    most = limits.v_max if holonomic else limits.turn_rate
    return min(max(one, slowest), limits.v_max), min(max(two, -most), most)
