"""Rollouts abreast: in each step all sequences of controls are driven and judged, in loops that become SIMD instructions.

One rollout after another would wait for each of its own results. Here what is known of a rollout stands in one column of
`Batch.value`. A loop over rollouts reads and writes rows that are a constant apart, so that LLVM can tell that they do not
overlap. When rollouts end, the others close up.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.controls.afterwards import cost_afterwards
from antway.kernels.controls.lookup import clearance, clearance_within, passes_corners, reaches, turning_loss
from antway.kernels.controls.motion import MotionState, motion_state, step
from antway.kernels.controls.problem import GOAL_SPEED, GOAL_X, GOAL_Y, TOLERANCE, Batch, ControlProblem, StaticField, near_at
from antway.kernels.controls.rollout import is_too_dear, lost_time, obstacle_cost, stop_behind_wall

BATCH = 64  # most rollouts that are stepped abreast
ROWS = 31  # numbers of each rollout
_ROWS = tuple(BATCH * row for row in range(ROWS))
# Rows of `Batch.value`. The first ones are kept when rollouts close up: the motion state at the end of a step, what the rollout
# has cost, and the step from which the robot brakes because it has reached the goal.
X, Y, COS, SIN, A, B, SPENT, BRAKES = _ROWS[:8]
# The command of a step, the place, heading and turn rate before it, the distance to walls, and what obstacles cost in the step.
ONE, TWO, X0, Y0, COS0, SIN0, B0, WALL, HARM = _ROWS[8:17]
# The static time to go, the time lost to the turning radius, the time to go that counts, the cost with it, and what happens.
TO_GO, TURNING, VALUE, WITH_VALUE, EVENT = _ROWS[17:22]
# A bilinear interpolation: the node, where the robot is in its square, two nodes with the changes to the next, and the result.
_LINE, _COL, _UP, _ALONG, _LOW, _LOW_CHANGE, _HIGH, _HIGH_CHANGE, SAMPLE = _ROWS[22:31]
_NEXT = np.uint64(1)  # the step to the next node, of the type of indices
_TOO_DEAR, _AT_GOAL, _BRAKES = 1, 2, 4  # values of EVENT, which are added up


@inner_kernel
def rollout_state(value: Floats, i: int) -> MotionState:
    """Return the motion state of rollout i."""
    return MotionState(value[X + i], value[Y + i], value[COS + i], value[SIN + i], value[A + i], value[B + i])


@inner_kernel
def set_rollout(value: Floats, i: int, at: MotionState) -> None:
    """Write the motion state of rollout i."""
    value[X + i], value[Y + i], value[COS + i], value[SIN + i], value[A + i], value[B + i] = at


@inner_kernel
def drive(value: Floats, n: int, limits: RobotLimits, dt: float) -> None:
    """Drive the first n rollouts for a period by their commands."""
    for i in range(n):
        at = rollout_state(value, i)
        value[X0 + i], value[Y0 + i], value[COS0 + i], value[SIN0 + i], value[B0 + i] = at.x, at.y, at.cos, at.sin, at.b
        set_rollout(value, i, step(at, value[ONE + i], value[TWO + i], limits, dt))


@inner_kernel
def _sample(value: Floats, n: int, field: NDArray[np.float32], frame: Floats) -> None:
    """Write to SAMPLE what `sample` returns for each of the first n rollouts."""
    x, y, nodes = frame[0], frame[1], frame[2]
    right, top = field.shape[1] - 1.001, field.shape[0] - 1.001
    for i in range(n):
        c, r = min(max((value[X + i] - x) * nodes, 0.0), right), min(max((value[Y + i] - y) * nodes, 0.0), top)
        line, col = np.floor(r), np.floor(c)
        value[_LINE + i], value[_COL + i], value[_UP + i], value[_ALONG + i] = line, col, r - line, c - col
    for i in range(n):  # unsigned indices need no test for negative ones
        line, col = np.uint64(np.int64(value[_LINE + i])), np.uint64(np.int64(value[_COL + i]))
        low, high = field[line, col], field[line + _NEXT, col]
        value[_LOW + i], value[_LOW_CHANGE + i] = low, field[line, col + _NEXT] - low
        value[_HIGH + i], value[_HIGH_CHANGE + i] = high, field[line + _NEXT, col + _NEXT] - high
    for i in range(n):
        low = value[_LOW + i] + value[_ALONG + i] * value[_LOW_CHANGE + i]
        high = value[_HIGH + i] + value[_ALONG + i] * value[_HIGH_CHANGE + i]
        value[SAMPLE + i] = low + value[_UP + i] * (high - low)


@inner_kernel
def wall_distances(value: Floats, n: int, problem: ControlProblem, enough: float) -> None:
    """Write to WALL what `clearance` returns for the first n rollouts, or `clearance_within` where corners could be passed.

    These are footprints without wheels, and robots of which `passes_corners` tells. Robots with wheels go along their heading,
    and pass narrow corridors sooner without it.
    """
    field, limits, has_box = problem.field, problem.limits, len(problem.field.discs) > 0
    within = (limits.drive == HOLONOMIC and has_box) or passes_corners(limits, problem.dt)
    _sample(value, n, field.wall, field.wall_frame)
    for i in range(n):
        value[WALL + i] = value[SAMPLE + i]
    if within:
        for i in range(n):
            before = MotionState(value[X0 + i], value[Y0 + i], value[COS0 + i], value[SIN0 + i], 0.0, 0.0)
            value[WALL + i] = clearance_within(field, before, rollout_state(value, i), value[WALL + i], enough, limits)
    elif has_box:
        for i in range(n):
            if value[WALL + i] < enough:
                value[WALL + i] = clearance(field, rollout_state(value, i), enough)


@inner_kernel
def times_to_go(value: Floats, n: int, field: StaticField) -> None:
    """Write to TO_GO and TURNING what `time_to_go` and `turning_loss` return for each of the first n rollouts."""
    _sample(value, n, field.time, field.time_frame)
    for i in range(n):
        value[TO_GO + i], value[TURNING + i] = max(value[SAMPLE + i], 0.0), 0.0
    if len(field.turning) > 1:
        for i in range(n):
            value[TURNING + i] = turning_loss(field, rollout_state(value, i), value[TO_GO + i])


@inner_kernel
def _count_near(value: Floats, n: int, k: int, problem: ControlProblem) -> None:
    """Write to HARM how many obstacles can cost each of the first n rollouts anything in step k, but for its stop."""
    outlook, dt, has_box = problem.outlook, problem.dt, len(problem.field.discs) > 0
    for i in range(n):
        value[HARM + i] = 0.0
    for j in range(outlook.near[k]):
        x, y, beyond = outlook.beyond[k, 0, j], outlook.beyond[k, 1, j], outlook.beyond[k, 2, j]
        disc = near_at(outlook, k, j)
        x0, y0 = x - disc.vx * dt, y - disc.vy * dt
        for i in range(n):
            dx, dy = value[X + i] - x, value[Y + i] - y
            square = dx * dx + dy * dy
            if has_box:  # a corner of it may have been nearer in the step than its centre is at the end
                dx, dy = value[X0 + i] - x0, value[Y0 + i] - y0
                square = min(square, dx * dx + dy * dy)
            value[HARM + i] += 1.0 if square < beyond else 0.0


@inner_kernel
def obstacle_costs(batch: Batch, n: int, k: int, decay: float, problem: ControlProblem) -> None:
    """Write to HARM what `obstacle_cost` returns for each of the first n rollouts in step k."""
    value, w = batch.value, problem.weights
    every = w.stop > 0.0 or (k == 0 and w.follow > 0.0)  # its stop can cost a rollout something that is far from obstacles
    _count_near(value, n, k, problem)
    for i in range(n):
        if every or value[HARM + i] > 0.0:
            before = MotionState(value[X0 + i], value[Y0 + i], value[COS0 + i], value[SIN0 + i], 0.0, 0.0)
            harm = batch.harm[batch.sequence[i]]
            value[HARM + i] = obstacle_cost(before, rollout_state(value, i), k, decay, problem, harm)


@inner_kernel
def _wall_costs(value: Floats, n: int, decay: float, problem: ControlProblem) -> None:
    """Add to SPENT what walls cost in a step."""
    w = problem.weights
    margin, width, firm, soft = w.wall_margin, w.wall_range, w.wall * decay, w.wall_risk * problem.dt * decay
    for i in range(n):
        wall, cost = value[WALL + i], value[SPENT + i]
        if wall < margin:
            cost += firm * (1.0 + 10.0 * (margin - wall))
        elif wall < margin + width:
            cost += soft * (margin + width - wall) / width
        value[SPENT + i] = cost


@inner_kernel
def _comfort_costs(value: Floats, n: int, turn_change: float) -> None:
    """Add to SPENT what changes of the turn rate cost in a step."""
    for i in range(n):
        value[SPENT + i] += turn_change * abs(value[B + i] - value[B0 + i])


@inner_kernel
def _time_costs(value: Floats, n: int, k: int, left: int, limit: float, problem: ControlProblem) -> int:
    """Write to VALUE, WITH_VALUE and EVENT what the time to go costs in step k and what happens; return the sum of events."""
    plan, goal, dt = problem.outlook.plan, problem.field.goal, problem.dt
    off_plan, progress = problem.weights.off_plan, problem.weights.progress
    plan_x, plan_y, plan_to_go = plan[k, 0], plan[k, 1], plan[k, 2]
    goal_x, goal_y, tolerance, slow = goal[GOAL_X], goal[GOAL_Y], goal[TOLERANCE], goal[GOAL_SPEED]
    events = 0
    for i in range(n):
        px, py, to_go = value[X + i] - plan_x, value[Y + i] - plan_y, value[TO_GO + i]
        worth = max(to_go, plan_to_go + off_plan * math.sqrt(px * px + py * py)) + value[TURNING + i]
        cost = value[SPENT + i] + progress * worth
        event = _TOO_DEAR * int(is_too_dear(limit, cost, left, to_go, plan_to_go, dt, progress))
        event += _BRAKES * int(value[BRAKES + i] < math.inf)
        event += _AT_GOAL * int(reaches(rollout_state(value, i), goal_x, goal_y, tolerance, slow))
        value[VALUE + i], value[WITH_VALUE + i], value[EVENT + i] = worth, cost, float(event)
        events += event
    return events


@inner_kernel
def close_up(batch: Batch, i: int, to: int) -> None:
    """Move what is kept of rollout i to column `to`."""
    value = batch.value
    set_rollout(value, to, rollout_state(value, i))
    value[SPENT + to], value[BRAKES + to] = value[SPENT + i], value[BRAKES + i]
    batch.sequence[to] = batch.sequence[i]


@inner_kernel
def _start(n: int, batch: Batch, problem: ControlProblem) -> None:
    """Put n rollouts at the start of the problem."""
    at = motion_state(problem.start)
    for i in range(n):
        set_rollout(batch.value, i, at)
        batch.value[SPENT + i], batch.value[BRAKES + i], batch.sequence[i] = 0.0, math.inf, i
    if problem.outlook.near.any():
        batch.harm[:n] = 0.0


@inner_kernel
def _commands(sequences: Floats, k: int, batch: Batch, n: int) -> None:
    """Write the commands of step k; a robot that has reached the goal brakes."""
    value = batch.value
    for i in range(n):
        drives = k < value[BRAKES + i]
        value[ONE + i] = sequences[batch.sequence[i], k, 0] if drives else 0.0
        value[TWO + i] = sequences[batch.sequence[i], k, 1] if drives else 0.0


@inner_kernel
def _end(cost: Floats, n: int, k: int, left: int, decay: float, limit: float, problem: ControlProblem) -> int:
    """Write the costs of the rollouts that end with step k, and return how many go on."""
    limits, dt, field, w, batch = problem.limits, problem.dt, problem.field, problem.weights, problem.batch
    value, to = batch.value, 0
    for i in range(n):
        at, mine, event = rollout_state(value, i), batch.sequence[i], value[EVENT + i]
        if _AT_GOAL <= event < _BRAKES:
            value[SPENT + i] -= left * dt
            value[BRAKES + i] = k + 1.0 + max(round(w.stopping_time / dt) - 1, 0)
        if event >= _AT_GOAL:
            if at.a == 0.0 and at.b == 0.0:
                cost[mine] = value[SPENT + i]
                continue
            if value[SPENT + i] > limit:
                cost[mine] = math.inf
                continue
            if left == 0:
                cost[mine] = value[SPENT + i] + w.wall * decay * stop_behind_wall(at, limits, field)
        else:
            value[SPENT + i] = value[WITH_VALUE + i]
            if left == 0:
                to_go = value[TO_GO + i]
                lost = value[TURNING + i] + w.ramps * lost_time(at, to_go, field, limits)
                total = value[SPENT + i] + max(value[VALUE + i], to_go + lost) + w.turn_change * abs(at.b)
                cost[mine] = math.inf
                if total <= limit:
                    cost[mine] = total + cost_afterwards(at, problem, decay, batch.harm[mine], limit - total)
            elif event == _TOO_DEAR:
                cost[mine] = math.inf
                continue
        close_up(batch, i, to)
        to += 1
    return to


@bare_kernel
def _judge_abreast(sequences: Floats, problem: ControlProblem, limit: float, cost: Floats) -> None:
    """Do as `judge_all` does, for at most BATCH sequences."""
    _, limits, dt, field, outlook, w, batch = problem
    value, n, steps = batch.value, len(sequences), sequences.shape[1]
    _start(n, batch, problem)
    decay, decay_of_step = 1.0, math.exp(-w.decay * dt)
    for k in range(steps):
        left = steps - 1 - k
        _commands(sequences, k, batch, n)
        drive(value, n, limits, dt)
        # What comfort, walls and obstacles cost in this step.
        _comfort_costs(value, n, w.turn_change)
        wall_distances(value, n, problem, w.wall_margin + w.wall_range)
        _wall_costs(value, n, decay, problem)
        if outlook.near[k] > 0:
            obstacle_costs(batch, n, k, decay, problem)
            for i in range(n):
                value[SPENT + i] += value[HARM + i]
        decay *= decay_of_step
        if k == 0:
            for i in range(n):
                value[SPENT + i] -= w.stand if value[A + i] == 0.0 and value[B + i] == 0.0 else 0.0
        # What the time to go costs, by the plan or, if that is more, by the map alone.
        times_to_go(value, n, field)
        events = _time_costs(value, n, k, left, limit, problem)
        if events == 0 and left > 0:
            for i in range(n):
                value[SPENT + i] = value[WITH_VALUE + i]
        else:
            n = _end(cost, n, k, left, decay, limit, problem)
            if n == 0:
                return


@bare_kernel
def judge_all(sequences: Floats, problem: ControlProblem, limit: float, cost: Floats) -> None:
    """Compute the cost of each sequence of controls, s; it is infinite if it is sure to be above `limit`, which may be so, too.

    `sequences`, float64[N, S, 2], are speed and turn rate, or the velocity's x and y, commanded in each period; `cost`,
    float64[N], is filled.

    At the end of each step, the time to go is the static one or, if that is more, the time that the plan still takes from its
    place at that time, plus the path to that place: behind a moving obstacle the static time is too short. The time that a car
    loses to turns is added. At the end of the sequence the time to go itself is added or, if that is more, the static one with
    what the robot will still lose to ramps, with those to a stop at the goal, and turns: a robot that waits loses nothing to
    them, and need not take a run-up or, where it has found no path (`ramps`), turn. What obstacles will cost afterwards is
    added (kernels/controls/afterwards.py). A robot that reaches the goal brakes as soon as a command given there acts; what it
    meets until it stands counts as before.
    """
    for first in range(0, len(sequences), BATCH):
        _judge_abreast(sequences[first : first + BATCH], problem, limit, cost[first : first + BATCH])
