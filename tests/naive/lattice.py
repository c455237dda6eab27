"""Best-first search over arcs with a list of tuples, a dictionary and nothing kept from one search to the next."""

from __future__ import annotations

import heapq
import math

import numpy as np

from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.controls.rollout import (
    CostWeights,
    Outlook,
    StaticField,
    clearance,
    lost_time,
    met,
    sample,
    step,
    turning_loss,
)
from antway.kernels.controls.seeds import downhill

Pose = tuple[float, float, float, float, float, float]  # x, y, cosine and sine of the heading, and two speeds


def least_bound(
    held: np.ndarray,
    block: int,
    arcs: int,
    start: np.ndarray,
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    w: CostWeights,
) -> float:
    """The bound on the time to the goal of the first sequence of arcs that is complete."""
    outlook = outlook._replace(harm=np.empty(0))
    x, y, heading, a, b = start.tolist()
    heap: list[tuple[float, int, Pose, int, float, bool]] = [
        (0.0, 0, (x, y, math.cos(heading), math.sin(heading), a, b), 0, 0.0, False)
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
                state = np.array([at[0], at[1], math.atan2(at[3], at[2]), at[4], at[5]])
                downhill(commands, state, limits, dt, field, 0.5, limits.v_max / (1 + i - len(held)), 0.0, 0)
            driven = _drive(commands, at, n * block, limits, dt, field, outlook, w)
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
    commands: np.ndarray,
    at: Pose,
    first: int,
    limits: RobotLimits,
    dt: float,
    field: StaticField,
    outlook: Outlook,
    w: CostWeights,
) -> tuple[Pose, float, int, bool] | None:
    """Where an arc ends, what obstacles cost, how many periods it takes, and whether that is the goal; None: it touches."""
    harm = 0.0
    for q, (ca, cb) in enumerate(commands.tolist()):
        at = step(*at, ca, cb, limits, dt)
        x, y, c, s, a, b = at
        here = met(x, y, c, s, a, b, limits, first + q, 1.0, field, outlook, w)
        if clearance(x, y, c, s, w.wall_margin, field) < w.wall_margin or here >= w.contact:
            return None
        harm += here
        if math.hypot(x - field.goal[0], y - field.goal[1]) < field.goal[2]:
            return at, harm, q + 1, True
    return at, harm, len(commands), False


def _rest(pose: Pose, limits: RobotLimits, field: StaticField) -> float:
    x, y, c, s, a, b = pose
    to_go = max(sample(field.time, x, y, field.time_frame), 0.0)
    return to_go + lost_time(x, y, c, s, a, b, to_go, field, limits) + turning_loss(field, x, y, c, s)


def _alike(pose: Pose, limits: RobotLimits, longest: float) -> tuple[int, ...]:
    x, y, c, s, a, b = pose
    parts = b / limits.turn_rate if limits.drive != HOLONOMIC else 3.0 * b / limits.v_max
    numbers = x / (0.4 * longest), y / (0.4 * longest), 3.0 * a / limits.v_max + 0.5, parts + 0.5
    return *(math.floor(one) for one in numbers), math.floor(math.atan2(s, c) * 8.0 / math.pi + 0.5) % 16
