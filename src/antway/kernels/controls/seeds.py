"""Seeds for the colony in the space of controls: sequences that turn and go, descend the field, or follow the plan."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import wrap_below_pi
from antway.kernels.base.jit import inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState
from antway.kernels.controls.lookup import slope
from antway.kernels.controls.problem import GOAL_SPEED, GOAL_X, GOAL_Y, TOLERANCE, ControlProblem, StaticField

SEEDS = 42  # number of seeds that `write_seed` knows
_ON_THE_SPOT = 1.2  # rad; a robot on wheels that has to turn by this or more turns on the spot
_SAFE = 1.6  # 1; the fastest motion that stops at its target has 2 here, and would overshoot in periods of a finite length
_NO_TURN = 0.05  # m; a robot on wheels does not turn to a target nearer than this
_E = 0.1  # m; length of a step down the field, and half the distance over which its slope is taken
_AHEAD = 5  # such steps; a robot that follows the path down the field steers to the point this far along it


@inner_kernel
def _turn_rate(off: float, b: float, limits: RobotLimits, dt: float, least: float) -> float:
    """Return the next turn rate, after b, of the fastest turn by `off` rad without overshoot, in `least` s or more, rad/s."""
    target = min(limits.turn_rate, math.sqrt(_SAFE * limits.alpha_max * abs(off)), abs(off) / max(least, dt))
    change = limits.alpha_max * dt
    return min(max(math.copysign(target, off), b - change), b + change)


@inner_kernel
def _speed_off(off: float) -> float:
    """Return the part of its speed at which a robot on wheels drives while it still has to turn by `off` rad."""
    return max(1.0 - (off / _ON_THE_SPOT) * (off / _ON_THE_SPOT), 0.0)


@inner_kernel
def _steer(state: RobotState, tx: float, ty: float, speed: float, problem: ControlProblem) -> RobotState:
    """Return the state after a period of steering to (tx, ty) at `speed` m/s; its last two entries are also the command."""
    limits, dt = problem.limits, problem.dt
    x, y, heading, a, b = state
    dx, dy = tx - x, ty - y
    distance = math.hypot(dx, dy)
    goal = problem.field.goal
    if goal[GOAL_SPEED] < math.inf:  # the robot is to stand at the goal
        rest = math.hypot(x - goal[GOAL_X], y - goal[GOAL_Y]) - 0.5 * goal[TOLERANCE]
        speed = min(speed, math.sqrt(_SAFE * limits.brake_max * max(rest, 0.0)))
    if limits.drive == HOLONOMIC:
        vx, vy = (speed * dx / distance, speed * dy / distance) if distance > 1e-9 else (0.0, 0.0)
        change = math.hypot(vx - a, vy - b)
        if change > limits.a_max * dt:
            vx, vy = a + (vx - a) * limits.a_max * dt / change, b + (vy - b) * limits.a_max * dt / change
        return RobotState(x + 0.5 * (a + vx) * dt, y + 0.5 * (b + vy) * dt, heading, vx, vy)
    off = wrap_below_pi(math.atan2(dy, dx) - heading) if distance > _NO_TURN else 0.0
    turn = _turn_rate(off, b, limits, dt, 2.0 * dt)
    go = speed * _speed_off(off)
    go = min(max(go, a - limits.brake_max * dt), a + limits.a_max * dt)
    middle = heading + 0.25 * (b + turn) * dt
    x += 0.5 * (a + go) * dt * math.cos(middle)
    y += 0.5 * (a + go) * dt * math.sin(middle)
    return RobotState(x, y, heading + 0.5 * (b + turn) * dt, go, turn)


@inner_kernel
def turn_and_go(ant: Floats, problem: ControlProblem, bearing: float, speed: float) -> None:
    """Write the sequence that turns to a bearing in rad and then goes straight at `speed` m/s; below 0 it goes backwards."""
    limits, dt = problem.limits, problem.dt
    if limits.drive == HOLONOMIC:
        for k in range(len(ant)):
            ant[k, 0], ant[k, 1] = speed * math.cos(bearing), speed * math.sin(bearing)
        return
    off = wrap_below_pi(bearing - problem.start.theta + (math.pi if speed < 0.0 else 0.0))
    b = problem.start.b
    for k in range(len(ant)):
        turn = _turn_rate(off, b, limits, dt, dt)
        off -= 0.5 * (b + turn) * dt
        b = turn
        ant[k, 0], ant[k, 1] = speed * _speed_off(off), turn


@inner_kernel
def descent_points(length: float) -> int:
    """Return the number of points of a path of `length` m down the field, in addition to the 0.5 m that are steered ahead."""
    return math.ceil(length / _E) + _AHEAD + 1


@inner_kernel
def descend(path: Floats, field: StaticField, x: float, y: float, length: float) -> int:
    """Write the path from (x, y) down the field of times, up to `length` m and 0.5 m more; return its number of points.

    It is shorter if `path` has fewer rows: these are for the robot's top speed at first, and it may turn out to be faster.
    """
    n, most = 1, min(descent_points(length), len(path))
    path[0, 0], path[0, 1] = x, y
    while n < most:
        gx, gy, steep = slope(field, x, y, _E)
        if steep < 1e-9:
            break
        x, y = x - _E * gx / steep, y - _E * gy / steep
        path[n, 0], path[n, 1] = x, y
        n += 1
    return n


@inner_kernel
def downhill(ant: Floats, problem: ControlProblem, path: Floats, n: int, speed: float, aside: float, until: int) -> None:
    """Write the sequence that follows the first n points of a path of `descend` (pure pursuit), 0.5 m ahead.

    In the first `until` steps it steers to a point `aside` m to the left of that; a negative value is to the right.
    """
    state, nearest = problem.start, 0
    for k in range(len(ant)):
        dx, dy = path[nearest, 0] - state.x, path[nearest, 1] - state.y
        square = dx * dx + dy * dy
        while nearest + 1 < n:
            dx, dy = path[nearest + 1, 0] - state.x, path[nearest + 1, 1] - state.y
            if dx * dx + dy * dy > square:
                break
            nearest, square = nearest + 1, dx * dx + dy * dy
        ahead = min(nearest + _AHEAD, n - 1)
        px, py = path[ahead, 0], path[ahead, 1]
        if k < until and ahead > nearest:
            gone = (ahead - nearest) * _E
            dx, dy = (px - state.x) / gone, (py - state.y) / gone
            px, py = px - aside * dy, py + aside * dx
        state = _steer(state, px, py, speed, problem)
        ant[k, 0], ant[k, 1] = state.a, state.b


@inner_kernel
def along_plan(ant: Floats, problem: ControlProblem, lead: int, late: int) -> None:
    """Write the sequence that follows the plan `late` steps behind it, steering to its place `lead` steps ahead."""
    plan, state = problem.outlook.plan, problem.start
    last = len(plan) - 1
    for k in range(len(ant)):
        j = min(max(k + lead - late, 0), last)
        tx, ty = plan[j, 0], plan[j, 1]
        speed = min(math.hypot(tx - state.x, ty - state.y) / (lead * problem.dt), problem.limits.v_max)
        state = _steer(state, tx, ty, speed, problem)
        ant[k, 0], ant[k, 1] = state.a, state.b


@inner_kernel
def write_seed(ant: Floats, problem: ControlProblem, path: Floats, n: int, i: int) -> bool:
    """Write seed i, 0 to SEEDS - 1, to `ant`, float64[S, 2]; return False if this problem has no such seed.

    `path` and n are the path from the start down the field, and its number of points.

    ======== =========================================================================================================
    0 to 23  turn to one of 12 bearings and go, at full or half speed
    24 to 26 turn the back to one of three bearings and go in reverse, on wheels
    27       stop
    28, 29   descend the field, at full or 0.6 of full speed
    30 to 35 descend the field, and at first pass an obstacle on its left or right
    36 to 41 follow the plan, 3 or 6 steps ahead, and 0, 4 or 8 steps late
    ======== =========================================================================================================
    """
    limits, heading, steps = problem.limits, problem.start.theta, len(ant)
    if i < 24:
        turn_and_go(ant, problem, heading + (i // 2) * math.pi / 6.0, limits.v_max if i % 2 == 0 else 0.5 * limits.v_max)
    elif i < 27:
        if limits.drive == HOLONOMIC or limits.v_reverse == 0.0:
            return False
        turn_and_go(ant, problem, heading + math.pi + (i - 25) * 0.5, -limits.v_reverse)
    elif i == 27:
        ant[:] = 0.0
    elif i < 30:
        downhill(ant, problem, path, n, limits.v_max if i == 28 else 0.6 * limits.v_max, 0.0, 0)
    elif i < 36:
        aside = 0.25 if i < 34 else 0.7
        until = steps // 2 if 32 <= i < 34 else steps // 4
        downhill(ant, problem, path, n, limits.v_max, aside if i % 2 == 0 else -aside, until)
    else:
        if problem.outlook.plan[0, 2] == -math.inf:
            return False
        along_plan(ant, problem, 3 if i < 39 else 6, 4 * (i % 3))
    return True
