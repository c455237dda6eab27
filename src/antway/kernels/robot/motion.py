"""How a robot moves under a command: speeds ramp within a control cycle, and the resulting place is exact.

A command is (v, omega) for wheels and (vx, vy) for a holonomic robot, as the speeds in `RobotState` are. Under a constant
command both speeds are linear in time on a few *segments*. There the heading is quadratic in time, and the place is an
integral without a closed form, computed by Gauss-Legendre quadrature. Nothing depends on how a cycle is divided: driven in two
parts it ends where it does in one.

A command acts `latency` s after it was given. To look ahead, first drive the commands that do not act yet (`delayed`); after
that the robot follows new commands at once.
"""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import ACKERMANN, HOLONOMIC, RobotLimits, RobotState

REST = 1e-9  # m/s; a slower robot is at rest
_TURN = 0.8  # rad; largest turn of a part on which four nodes give the place to 1e-10 of its length
_ROUGHLY = 1.0  # rad; on longer turns `along_roughly` is wrong by more than half a thousandth of the path
_EVEN = 1e-9  # m^2/s^2; a ramp at a right angle to the command counts as braking in spite of rounding errors
_AT_END = 1e-12  # s; a speed that becomes 0 this near to the end of a command does not change sign before it
_SAME = 1e-290  # m/s; velocities that differ by less are the same: an acceleration divided by this would overflow
_SNAP = 1e-12  # rad/s; a turn rate this near to its bound is on it, so that no segment is as short as a rounding error

_NODE1, _NODE2 = 0.3399810435848563, 0.8611363115940526  # Gauss-Legendre nodes and weights on [-1, 1]
_WEIGHT1, _WEIGHT2 = 0.6521451548625461, 0.3478548451374538


@bare_kernel
def ramp(v: float, target: float, growth: float, fall: float) -> tuple[float, float, float, float]:
    """Return the first ramp of `v` to `target`: its magnitude grows by at most `growth` and falls by at most `fall` a second.

    Returns the value now (changed only by an infinite rate), its rate, its value at the end of this ramp (`target`, or 0 if the
    sign changes), and the length of the ramp; infinite if `v` is at `target`.
    """
    if v != target and v * (target - v) < 0.0:
        end = target if v * target >= 0.0 else 0.0
        if fall < math.inf:
            return v, math.copysign(fall, end - v), end, abs(end - v) / fall
        v = end
    if v == target:
        return v, 0.0, v, math.inf
    if growth == math.inf:
        return target, 0.0, target, math.inf
    return v, math.copysign(growth, target - v), target, abs(target - v) / growth


@bare_kernel
def clip_twist(cv: float, cw: float, limits: RobotLimits) -> tuple[float, float]:
    """Return a command of wheels clipped to the robot's limits; a command that is not finite means stop."""
    if not (math.isfinite(cv) and math.isfinite(cw)):
        return 0.0, 0.0
    return min(max(cv, -limits.v_reverse), limits.v_max), min(max(cw, -limits.turn_rate), limits.turn_rate)


@bare_kernel
def wheels_segment(
    v: float, omega: float, cv: float, cw: float, limits: RobotLimits, left: float
) -> tuple[float, float, float, float, float, float, float]:
    """Return the first segment of wheels under the clipped command (cv, cw), at most `left` s long.

    Steering keeps |omega| <= |v| / turning_radius at every instant: where the ramp of omega meets that bound, it follows it.

    Returns its length h in s; v0, a, w0 and b, so that on it v = v0 + a t and omega = w0 + b t; and both at its end, without
    rounding errors: exactly the value that ended it.
    """
    if limits.a_max == math.inf and left < _AT_END:
        return left, v, 0.0, omega, 0.0, v, omega
    v0, a, v_end, time = ramp(v, cv, limits.a_max, limits.brake_max)
    h = min(time, left)
    car = limits.drive == ACKERMANN and limits.turning_radius > 0.0
    if car:  # a speed that jumps limits the steering at once
        most = abs(v0) / limits.turning_radius
        omega = min(max(omega, -most), most)
    w0, b, w_end, w_time = ramp(omega, cw, limits.alpha_max, limits.alpha_max)
    if b != 0.0 and w_end != cw:  # growth and fall are limited alike, so the ramp goes straight through 0
        w_end, w_time = cw, abs(cw - w0) / limits.alpha_max
    if not car:
        h = min(h, w_time)
        return h, v0, a, w0, b, (v_end if h == time else v0 + a * h), (w_end if h == w_time else w0 + b * h)
    side = 1.0 if v0 > 0.0 or (v0 == 0.0 and a > 0.0) else -1.0
    growth = side * a / limits.turning_radius
    w0 = min(max(w0, -most), most)
    if b == 0.0 and w0 != cw:
        b = math.copysign(math.inf, cw - w0)  # alpha is infinite, but the steering limits the turn rate
    left_turn = w0 >= most - _SNAP and b >= growth
    if left_turn or (w0 <= -most + _SNAP and b <= -growth):  # it is on the bound, and follows it
        turn = 1.0 if left_turn else -1.0
        w0, b, w_end, w_time = turn * most, turn * growth, cw, math.inf
        if growth > 0.0 and turn * cw > most + _SNAP:
            w_time = (turn * cw - most) / growth
        elif growth > 0.0:
            b = 0.0
    else:  # it meets the bound to its left or to its right, or none
        for turn in (1.0, -1.0):
            closing = turn * b - growth
            if closing > 0.0 and (most - turn * w0) / closing < w_time:
                w_time = (most - turn * w0) / closing
                w_end = turn * (most + growth * w_time)
    h = min(h, w_time)
    v1 = v_end if h == time else v0 + a * h
    bound = abs(v1) / limits.turning_radius
    w1 = w_end if h == w_time else w0 + b * h
    return h, v0, a, w0, b, v1, min(max(w1, -bound), bound)


@bare_kernel
def along(theta: float, v: float, a: float, w: float, b: float, h: float) -> tuple[float, float]:
    """Return the displacement in m in h s: the integral of (v + a t) (cos, sin)(theta + w t + b t^2 / 2), to 1e-10."""
    if w == 0.0 and b == 0.0:
        path = (v + 0.5 * a * h) * h
        return path * math.cos(theta), path * math.sin(theta)
    turn = (max(abs(w), abs(w + b * h)) + 1.8 * math.sqrt(abs(b))) * h  # with a term for the quadratic part of the heading
    parts = 1 if turn <= _TURN else math.ceil(turn / _TURN)
    step = h / parts
    dx = dy = 0.0
    for part in range(parts):
        middle = (part + 0.5) * step
        for k in range(4):
            node, weight = (_NODE1, _WEIGHT1) if k < 2 else (_NODE2, _WEIGHT2)
            t = middle + (0.5 * step * node if k % 2 else -0.5 * step * node)
            angle = theta + (w + 0.5 * b * t) * t
            speed = 0.5 * step * weight * (v + a * t)
            dx += speed * math.cos(angle)
            dy += speed * math.sin(angle)
    return dx, dy


@bare_kernel
def along_roughly(theta: float, v: float, a: float, w: float, b: float, h: float) -> tuple[float, float]:
    """Do as `along` with one sine and cosine, of fourth order in h: within 1e-6 m for h = 0.1 s at 1 m/s and 2 rad/s."""
    half = 0.5 * h
    speed, turn = v + a * half, w + b * half
    angle = theta + (w + 0.5 * b * half) * half
    cube = h * h * h / 12.0
    ahead, left = speed * h - 0.5 * speed * turn * turn * cube, (a * turn + 0.5 * speed * b) * cube
    c, s = math.cos(angle), math.sin(angle)
    return ahead * c - left * s, ahead * s + left * c


@bare_kernel
def wheels_cycle(state: RobotState, cv: float, cw: float, limits: RobotLimits, dt: float, roughly: bool) -> RobotState:
    """Return the state of wheels after dt s under the command (cv, cw); theta is not wrapped.

    The place is exact to 1e-10 m by `along`, or computed by `along_roughly`.
    """
    x, y, theta, v, omega = state
    cv, cw = clip_twist(cv, cw, limits)
    left = dt
    while left > 0.0:
        h, v0, a, w0, b, v, omega = wheels_segment(v, omega, cv, cw, limits, left)
        dx, dy = along_roughly(theta, v0, a, w0, b, h) if roughly else along(theta, v0, a, w0, b, h)
        x += dx
        y += dy
        theta += (w0 + 0.5 * b * h) * h
        left -= h
    return RobotState(x, y, theta, v, omega)


@bare_kernel
def clip_velocity(cx: float, cy: float, limits: RobotLimits) -> tuple[float, float]:
    """Return a command of a holonomic robot clipped to its speed limit; a command that is not finite means stop."""
    if not (math.isfinite(cx) and math.isfinite(cy)):
        return 0.0, 0.0
    asked = math.hypot(cx, cy)
    if asked > limits.v_max:
        return cx * (limits.v_max / asked), cy * (limits.v_max / asked)
    return cx, cy


@bare_kernel
def clipped(ca: float, cb: float, limits: RobotLimits) -> tuple[float, float]:
    """Return a command of any robot clipped to its limits; a command that is not finite means stop."""
    return clip_velocity(ca, cb, limits) if limits.drive == HOLONOMIC else clip_twist(ca, cb, limits)


@bare_kernel
def holonomic_ramp(vx: float, vy: float, cx: float, cy: float, limits: RobotLimits) -> tuple[float, float, float]:
    """Return the acceleration (ax, ay) of the straight ramp from (vx, vy) to the clipped command (cx, cy), and its length in s.

    Its magnitude is brake_max if the speed falls along the whole ramp, else a_max; if that is infinite, the length is 0.
    """
    dx, dy = cx - vx, cy - vy
    change = math.hypot(dx, dy)
    rate = limits.brake_max if cx * dx + cy * dy <= _EVEN else limits.a_max
    if change < _SAME or rate == math.inf:
        return 0.0, 0.0, 0.0
    return dx * (rate / change), dy * (rate / change), change / rate


@bare_kernel
def holonomic_cycle(state: RobotState, cx: float, cy: float, limits: RobotLimits, dt: float) -> RobotState:
    """Return the exact state of a holonomic robot after dt s; theta is its direction of motion, and is kept at rest."""
    x, y, theta, vx, vy = state
    cx, cy = clip_velocity(cx, cy, limits)
    ax, ay, time = holonomic_ramp(vx, vy, cx, cy, limits)
    h = min(time, dt)
    x += (vx + 0.5 * ax * h) * h
    y += (vy + 0.5 * ay * h) * h
    if time <= dt:
        vx, vy = cx, cy
        x += cx * (dt - h)
        y += cy * (dt - h)
    else:
        vx += ax * h
        vy += ay * h
    if math.hypot(vx, vy) > REST:
        theta = math.atan2(vy, vx)
    return RobotState(x, y, theta, vx, vy)


@bare_kernel
def drive_cycle(state: RobotState, ca: float, cb: float, limits: RobotLimits, dt: float) -> RobotState:
    """Return the state of any robot after dt s under the command (ca, cb)."""
    if limits.drive == HOLONOMIC:
        return holonomic_cycle(state, ca, cb, limits, dt)
    return wheels_cycle(state, ca, cb, limits, dt, False)


@bare_kernel
def drive_roughly(state: RobotState, ca: float, cb: float, limits: RobotLimits, dt: float) -> RobotState:
    """Do as `drive_cycle`, within 1e-6 m for a cycle of 0.1 s; exactly where wheels could turn far meanwhile."""
    if limits.drive == HOLONOMIC:
        return holonomic_cycle(state, ca, cb, limits, dt)
    return wheels_cycle(state, ca, cb, limits, dt, limits.turn_rate * dt <= _ROUGHLY)


@bare_kernel
def delayed(state: RobotState, pending: Floats, limits: RobotLimits, dt: float) -> RobotState:
    """Return the state of the robot `latency` s from now, the start of a cycle of dt s, after the commands that do not act yet.

    These are the last M = ceil(latency / dt) commands, `pending`, float64[M, 2], oldest first; the oldest acts now, until the
    next one does.
    """
    count = len(pending)
    left = limits.latency
    for i in range(count):
        h = left - (count - 1 - i) * dt
        state = drive_cycle(state, pending[i, 0], pending[i, 1], limits, h)
        left -= h
    return state
