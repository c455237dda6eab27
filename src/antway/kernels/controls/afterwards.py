"""What obstacles cost after the end of a rollout: the robot then takes the best of nine simple motions among them.

Without it, a sequence that flees before people who are faster costs only the detour, although they catch up with the robot
a little after its end.
"""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.controls.lookup import sample, slope
from antway.kernels.controls.motion import MotionState
from antway.kernels.controls.outlook import AFTERWARDS
from antway.kernels.controls.problem import ControlProblem, NearObstacle, StaticField, near_at

_DELAY = 0.5  # 1; share of its time that a motion costs which leads nowhere, as the robot need not keep it up to the end
_UNSURE = 0.3  # m; an obstacle whose place is less uncertain than this counts less, because the plan has reckoned with it
# Cosine and sine of the angle between each motion and the direction down the field; in the last one the robot stands.
_MOTIONS = tuple((math.cos(angle), math.sin(angle)) for angle in (0.25 * math.pi * k for k in (0, -1, 1, -2, 2, -3, 3, -4)))
_STAND = len(_MOTIONS)


@inner_kernel
def _none_near(x: float, y: float, n: int, beyond: Floats) -> bool:
    """Tell whether a robot at (x, y) is as far from all `n` obstacles as `beyond` says; the loop compares several at once."""
    near = 0
    for i in range(n):
        dx, dy = x - beyond[0, i], y - beyond[1, i]
        near += int(dx * dx + dy * dy < beyond[2, i])
    return near == 0


@bare_kernel
def cost_afterwards(at: MotionState, problem: ControlProblem, decay: float, costs: Floats, limit: float) -> float:
    """Return what obstacles cost a robot after it is `at` the end of a rollout, s, or `limit` if it is more.

    Each of nine motions costs the time that it loses, and for each obstacle the risk of contact where it is nearest, as far as
    that is more than the obstacle has cost before. The least of them counts. Obstacles that are slower than the robot count
    less, because they do not catch up with it. `decay` is the weight of risks by then, and `costs`, float64[M], the
    sequence's row of `Batch.harm`.
    """
    limits, field, outlook, w = problem.limits, problem.field, problem.outlook, problem.weights
    steps = len(outlook.plan)
    if w.risk == 0.0 or len(costs) == 0 or _none_near(at.x, at.y, outlook.near[steps], outlook.beyond[steps]):
        return 0.0
    gx, gy, steep = slope(field, at.x, at.y, 1.0 / field.time_frame[2])
    if steep < 1e-9:
        return 0.0
    least, beyond = limit, outlook.beyond[steps]
    for motion in range(_STAND + 1):
        c, s = _MOTIONS[motion] if motion < _STAND else (0.0, 0.0)
        cost = _DELAY * AFTERWARDS * (1.0 - c)
        if cost >= least:
            continue
        ux, uy, start = 0.0, 0.0, AFTERWARDS
        if motion < _STAND:
            ux, uy = (s * gy - c * gx) / steep, -(s * gx + c * gy) / steep
            speed, start = _set_out(at, ux, uy, limits)
            ux, uy = speed * ux, speed * uy
        end = start + _unblocked(at, ux, uy, AFTERWARDS - start, field, w.wall_margin)
        there_x, there_y = at.x + (end - start) * ux, at.y + (end - start) * uy
        for i in range(outlook.near[steps]):
            dx, dy = at.x - beyond[0, i], at.y - beyond[1, i]
            if dx * dx + dy * dy >= beyond[2, i]:
                continue  # too far away to come near
            disc = near_at(outlook, steps, i)
            square = _least_square(at.x, at.y, 0.0, 0.0, 0.0, start, disc)
            square = min(square, _least_square(at.x, at.y, ux, uy, start, end, disc))
            square = min(square, _least_square(there_x, there_y, 0.0, 0.0, end, AFTERWARDS, disc))
            if square < disc.risky * disc.risky:
                uncertain = disc.risky - disc.contact
                share = min((disc.risky - math.sqrt(square)) / uncertain, 1.0)
                its_speed = math.sqrt(disc.vx * disc.vx + disc.vy * disc.vy)
                share *= share * min(uncertain / _UNSURE, 1.0) * min(its_speed / limits.v_max, 1.0)
                cost += max(decay * w.risk * share - costs[int(disc.owner)], 0.0)
                if cost >= least:
                    break
        least = min(least, cost)
    return least


@inner_kernel
def _set_out(at: MotionState, ux: float, uy: float, limits: RobotLimits) -> tuple[float, float]:
    """Return at which speed the robot moves in the direction (ux, uy), m/s, and how much later it sets out for that, s."""
    if limits.drive == HOLONOMIC:
        change = math.hypot(limits.v_max * ux - at.a, limits.v_max * uy - at.b)
        return limits.v_max, min(0.5 * change / limits.a_max, AFTERWARDS)
    ahead, top, now = at.cos * ux + at.sin * uy, limits.v_max, at.a
    if ahead < 0.0 and limits.v_reverse > 0.0:
        ahead, top, now = -ahead, limits.v_reverse, -now
    turn = math.acos(min(max(ahead, -1.0), 1.0)) / limits.turn_rate
    return top, min(turn + 0.5 * max(top - max(now, 0.0), 0.0) / limits.a_max, AFTERWARDS)


@inner_kernel
def _unblocked(at: MotionState, ux: float, uy: float, span: float, field: StaticField, margin: float) -> float:
    """Return for which part of `span` s the robot can move at (ux, uy) m/s without a wall, in thirds, s."""
    for third in range(3):
        t = span * (third + 1) / 3.0
        if sample(field.wall, at.x + t * ux, at.y + t * uy, field.wall_frame) < margin:
            return span * third / 3.0
    return span


@inner_kernel
def _least_square(x: float, y: float, ux: float, uy: float, since: float, until: float, disc: NearObstacle) -> float:
    """Return the least squared distance of an obstacle from a robot that moves from (x, y) at (ux, uy) m/s in a time, m^2.

    What the obstacle does after a wall has changed its velocity does not count.
    """
    until = min(until, disc.straight)
    if until < since:
        return math.inf
    dx, dy = x - disc.x - disc.vx * since, y - disc.y - disc.vy * since
    wx, wy = ux - disc.vx, uy - disc.vy
    square = wx * wx + wy * wy
    t = min(max(-(dx * wx + dy * wy) / square, 0.0), until - since) if square > 1e-9 else 0.0
    dx, dy = dx + wx * t, dy + wy * t
    return float(dx * dx + dy * dy)
