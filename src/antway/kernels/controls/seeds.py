"""Seeds for the colony in the space of controls: sequences that turn and go, follow the field down, or follow a plan."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.controls.rollout import HEADING, SX, SY, A, B, Outlook, StaticField, slope


@inner_kernel
def _off(angle: float) -> float:
    """Return the angle wrapped to [-pi, pi), rad."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@inner_kernel
def _turning(off: float, b: float, limits: RobotLimits, dt: float, soft: float) -> float:
    """Return the next turn rate of the fastest turn by `off` rad that does not overshoot and takes at least `soft` s, rad/s."""
    target = min(limits.turn_rate, math.sqrt(1.6 * limits.alpha_max * abs(off)), abs(off) / max(soft, dt))
    gain = limits.alpha_max * dt
    return min(max(math.copysign(target, off), b - gain), b + gain)


@inner_kernel
def _follow(
    x: float, y: float, heading: float, a: float, b: float, tx: float, ty: float, speed: float, limits: RobotLimits, dt: float
) -> tuple[float, float, float, float, float]:
    """Return the state after a period of steering to (tx, ty) at `speed` m/s; its last two entries are also the command."""
    dx, dy = tx - x, ty - y
    span = math.hypot(dx, dy)
    if limits.drive == HOLONOMIC:
        ca, cb = (speed * dx / span, speed * dy / span) if span > 1e-9 else (0.0, 0.0)
        change = math.hypot(ca - a, cb - b)
        if change > limits.a_max * dt:
            ca, cb = a + (ca - a) * limits.a_max * dt / change, b + (cb - b) * limits.a_max * dt / change
        return x + 0.5 * (a + ca) * dt, y + 0.5 * (b + cb) * dt, heading, ca, cb
    off = _off(math.atan2(dy, dx) - heading) if span > 0.05 else 0.0
    turn = _turning(off, b, limits, dt, 2.0 * dt)
    go = speed * max(1.0 - (off / 1.2) * (off / 1.2), 0.0)
    go = min(max(go, a - limits.brake_max * dt), a + limits.a_max * dt)
    middle = heading + 0.25 * (b + turn) * dt
    x += 0.5 * (a + go) * dt * math.cos(middle)
    y += 0.5 * (a + go) * dt * math.sin(middle)
    return x, y, heading + 0.5 * (b + turn) * dt, go, turn


@bare_kernel
def turn_and_go(
    ant: NDArray[np.float64], state: NDArray[np.float64], limits: RobotLimits, dt: float, bearing: float, speed: float
) -> None:
    """Write the sequence that turns to a bearing in rad and then goes straight at `speed` m/s; below 0 it goes backwards."""
    if limits.drive == HOLONOMIC:
        for k in range(len(ant)):
            ant[k, 0], ant[k, 1] = speed * math.cos(bearing), speed * math.sin(bearing)
        return
    off = _off(bearing - state[HEADING] + (math.pi if speed < 0.0 else 0.0))
    b = state[B]
    for k in range(len(ant)):
        turn = _turning(off, b, limits, dt, dt)
        off -= 0.5 * (b + turn) * dt
        b = turn
        ant[k, 0], ant[k, 1] = speed * max(1.0 - (off / 1.2) * (off / 1.2), 0.0), turn


@bare_kernel
def downhill(
    ant: NDArray[np.float64],
    state: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    distance: float,
    speed: float,
    aside: float,
    until: int,
) -> None:
    """Write the sequence that follows the time-to-goal field down, steering to the point `distance` m down the field.

    In the first `until` steps it steers to a point `aside` m to the left of that; a negative value is to the right.
    """
    x, y, heading, a, b = state[SX], state[SY], state[HEADING], state[A], state[B]
    e = 0.1
    for k in range(len(ant)):
        px, py, gone = x, y, 0.0
        while gone < distance:
            gx, gy, steep = slope(field, px, py, e)
            if steep < 1e-9:
                break
            px, py, gone = px - e * gx / steep, py - e * gy / steep, gone + e
        if k < until and gone > 0.0:
            dx, dy = (px - x) / gone, (py - y) / gone
            px, py = px - aside * dy, py + aside * dx
        x, y, heading, a, b = _follow(x, y, heading, a, b, px, py, speed, limits, dt)
        ant[k, 0], ant[k, 1] = a, b


@bare_kernel
def along_plan(
    ant: NDArray[np.float64],
    state: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    outlook: Outlook,
    lead: int,
    late: int,
) -> None:
    """Write the sequence that follows the plan `late` steps behind it, steering to the place `lead` steps ahead."""
    x, y, heading, a, b = state[SX], state[SY], state[HEADING], state[A], state[B]
    last = len(outlook.plan) - 1
    for k in range(len(ant)):
        j = min(max(k + lead - late, 0), last)
        tx, ty = outlook.plan[j, 0], outlook.plan[j, 1]
        speed = min(math.hypot(tx - x, ty - y) / (lead * dt), limits.v_max)
        x, y, heading, a, b = _follow(x, y, heading, a, b, tx, ty, speed, limits, dt)
        ant[k, 0], ant[k, 1] = a, b
