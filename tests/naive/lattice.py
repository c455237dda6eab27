"""Best-first search over arcs with a list of tuples, a dictionary and nothing kept from one search to the next."""

from __future__ import annotations

import heapq
import math

import numpy as np

from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState
from antway.kernels.controls.lookup import clearance, clearance_within, sample, turning_loss
from antway.kernels.controls.motion import MotionState, step
from antway.kernels.controls.problem import ControlProblem, StaticField
from antway.kernels.controls.rollout import lost_time, obstacle_cost
from antway.kernels.controls.seeds import descend, downhill
from naive.rollout import spacing_of


def least_bound(
    held: np.ndarray,
    block: int,
    arcs: int,
    problem: ControlProblem,
) -> float:
    """The bound on the time to the goal of the first sequence of arcs that is complete."""
    limits, dt, field = problem.limits, problem.dt, problem.field
    x, y, heading, a, b = problem.start
    heap: list[tuple[float, int, MotionState, int, float, bool]] = [
        (0.0, 0, MotionState(x, y, math.cos(heading), math.sin(heading), a, b), 0, 0.0, False)
    ]
    least: dict[tuple[int, ...], float] = {}
    pushed = 0
    while heap:
        bound, _, at, n, cost, done = heapq.heappop(heap)
        if done or n == arcs:
            return bound
        for i in range(len(held) + 2):
            commands = np.empty((block, 2))
            if i < len(held):
                commands[:] = held[i]
            else:
                here = problem._replace(start=RobotState(at.x, at.y, math.atan2(at.sin, at.cos), at.a, at.b))
                path = np.empty((100, 2))
                points = descend(path, field, at.x, at.y, limits.v_max * block * dt)
                downhill(commands, here, path, points, limits.v_max / (1 + i - len(held)), 0.0, 0)
            driven = _drive(commands, at, n * block, problem)
            if driven is None:
                continue
            pose, harm, spent, there = driven
            price = cost + harm / block + spent * dt
            bound = price + (0.0 if there else _rest(pose, limits, field))
            key = (n + 1, *_alike(pose, limits, limits.v_max * block * dt))
            if least.get(key, math.inf) <= bound:
                continue
            least[key] = bound
            pushed += 1
            heapq.heappush(heap, (bound, pushed, pose, n + 1, price, there))
    return math.inf


def _drive(
    commands: np.ndarray, at: MotionState, first: int, problem: ControlProblem
) -> tuple[MotionState, float, int, bool] | None:
    """Where an arc ends, what obstacles cost, how many periods it takes, and whether that is the goal; None: it touches."""
    harm, field, w = 0.0, problem.field, problem.weights
    for q, (ca, cb) in enumerate(commands.tolist()):
        before, at = at, step(at, ca, cb, problem.limits, problem.dt)
        here = obstacle_cost(before, at, first + q, 1.0, problem, np.empty(0))
        wall = clearance(field, at, w.wall_margin)
        limits, boxed = problem.limits, len(field.discs) > 0
        if (boxed and not limits.drive) or spacing_of(limits, problem.dt) < math.inf:
            disc = sample(field.wall, at.x, at.y, field.wall_frame)
            wall = clearance_within(field, before, at, disc, w.wall_margin, limits)
        if wall < w.wall_margin or here >= w.contact:
            return None
        harm += here
        pace = math.hypot(at.a, at.b)
        if math.hypot(at.x - field.goal[0], at.y - field.goal[1]) < field.goal[2] and pace <= field.goal[3]:
            return at, harm, q + 1, True
    return at, harm, len(commands), False


def _rest(pose: MotionState, limits: RobotLimits, field: StaticField) -> float:
    to_go = max(sample(field.time, pose.x, pose.y, field.time_frame), 0.0)
    return to_go + lost_time(pose, to_go, field, limits) + turning_loss(field, pose, to_go)


def _alike(pose: MotionState, limits: RobotLimits, longest: float) -> tuple[int, ...]:
    x, y, c, s, a, b = pose
    parts = b / limits.turn_rate if limits.drive != HOLONOMIC else 3.0 * b / limits.v_max
    numbers = x / (0.4 * longest), y / (0.4 * longest), 3.0 * a / limits.v_max + 0.5, parts + 0.5
    return *(math.floor(one) for one in numbers), math.floor(math.atan2(s, c) * 8.0 / math.pi + 0.5) % 16
