"""A colony for stops with time windows: a beam of ants, local search with random moves, and pheromone of the best orders.

Pheromone is in [0, 1] and moves towards the best orders of the cycle, since the restart, and so far; the more the colony has
converged, the more the later ones count (Blum, Dorigo, IEEE Transactions on Systems, Man, and Cybernetics B 34, 2004).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base import rng
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.colony.time_windows import Beam, Draw, search
from antway.kernels.colony.window_search import Moves, Trail, refresh, settle, shake, value
from antway.kernels.colony.windows import Floats, Ids, Windows

BEST, SINCE, CYCLE, CONVERGED = range(4)


class Colony(NamedTuple):
    """The state of the colony, which kernels change in place."""

    tau: Floats  # [n, n] pheromone
    score: Floats  # [n, n] scratch: penalty of each arc by its pheromone
    orders: Ids  # [3, n] best so far, best since the last restart, best of the cycle
    record: Floats  # [4] see BEST ... CONVERGED; costs are infinite while no order is known


class Habits(NamedTuple):
    """Settings that are the same in all cycles."""

    width: int  # width of the ants' beam; 0: no ants, only random moves
    attempts: int  # random moves in a cycle
    evaporation: float  # share of pheromone that is replaced in a cycle
    temperature: float  # s; by about how much worse an order may become at first
    scale: float  # s; a typical step
    hurry: float  # largest weight of a second of arrival time for ants, relative to a second of lower bound


@bare_kernel
def toward(tau: Floats, order: Ids, share: float) -> None:
    """Move the pheromone on the arcs of `order` towards 1 by `share`."""
    for p in range(1, len(order)):
        tau[order[p - 1], order[p]] += share


@bare_kernel
def learn(colony: Colony, habits: Habits) -> None:
    """Evaporate and deposit; restart once all orders are alike."""
    tau, record, n = colony.tau, colony.record, colony.tau.shape[0]
    near = record[CONVERGED]
    share = 1.0, 0.0, 0.0
    if near >= 0.4:
        share = 2.0 / 3.0, 1.0 / 3.0, 0.0
    if near >= 0.6:
        share = 1.0 / 3.0, 2.0 / 3.0, 0.0
    if near >= 0.8:
        share = 0.0, 0.5, 0.5
    for i in range(n):
        for j in range(n):
            tau[i, j] *= 1.0 - habits.evaporation
    toward(tau, colony.orders[2], habits.evaporation * share[0])
    toward(tau, colony.orders[1], habits.evaporation * share[1])
    toward(tau, colony.orders[0], habits.evaporation * share[2])
    total, low, high = 0.0, 0.001, 0.999
    for i in range(n):
        for j in range(n):
            tau[i, j] = min(max(tau[i, j], low), high)
    for p in range(1, n):
        total += tau[colony.orders[1, p - 1], colony.orders[1, p]]
    record[CONVERGED] = total / (n - 1)
    if record[CONVERGED] > 0.97:
        tau[:] = 0.5
        record[SINCE], record[CONVERGED] = np.inf, 0.0


@kernel
def note(colony: Colony, order: Ids, cost: float) -> None:
    """Keep `order` as the best so far and since the restart, if it is."""
    if cost < colony.record[BEST]:
        colony.record[BEST] = cost
        copy_row(order, colony.orders[0])
    if cost < colony.record[SINCE]:
        colony.record[SINCE] = cost
        copy_row(order, colony.orders[1])


@kernel
def adopt(problem: Windows, colony: Colony, moves: Moves, t: Trail, order: Ids) -> None:
    """Improve and keep `order`, which comes from elsewhere and has no late stop."""
    copy_row(order, t.order)
    t.look[:] = True
    refresh(problem, t)
    settle(problem, t, moves)
    note(colony, t.order, value(t, moves.makespan))


@kernel
def wander(problem: Windows, colony: Colony, habits: Habits, moves: Moves, t: Trail, state: rng.State) -> None:
    """Alternate random moves and local search; the best order of the cycle stays in orders[2]. No order has a late stop."""
    t.look[:] = True
    settle(problem, t, moves)
    here = value(t, moves.makespan)
    best = here
    copy_row(t.order, colony.orders[2])
    last = t.saved
    copy_row(t.order, last)
    for a in range(habits.attempts):
        for _ in range(1 + rng.below(state, 4)):
            shake(problem, t, moves, habits.scale, state)
        settle(problem, t, moves)
        cost = value(t, moves.makespan)
        allowed = -habits.temperature * (1.0 - a / habits.attempts) * math.log(1.0 - rng.uniform(state))
        if cost <= here + allowed:
            here = cost
            copy_row(t.order, last)
            if cost < best - moves.least:
                best = cost
                copy_row(t.order, colony.orders[2])
        else:
            copy_row(last, t.order)
            refresh(problem, t)
    note(colony, colony.orders[2], best)


@kernel
def walk(
    problem: Windows, mirror: Windows, colony: Colony, habits: Habits, moves: Moves, beam: Beam, state: rng.State
) -> float:
    """Let a beam of ants build orders[2], in every other cycle backwards from the end; return its cost or infinity."""
    n = len(problem.opens)
    backward = int(colony.record[CYCLE]) % 2 == 1
    for i in range(n):
        for j in range(n):
            score = -math.log(colony.tau[i, j])
            if backward:
                colony.score[n - 1 - j, n - 1 - i] = score
            else:
                colony.score[i, j] = score
    bound = (0.2 + 2.0 * rng.uniform(state)) / habits.scale
    draw = Draw(
        bound, bound * habits.hurry * rng.uniform(state) * rng.uniform(state), 1.0, moves.makespan and not backward, np.inf
    )
    order = colony.orders[2]
    task = mirror if backward else problem
    found, _ = search(task, task.before, colony.score, draw, habits.width, rng.next_bits(state), beam, order)
    if backward and found < np.inf:
        for p in range(n // 2):
            order[p], order[n - 1 - p] = order[n - 1 - p], order[p]
        for p in range(n):
            order[p] = n - 1 - order[p]
    return found


@kernel
def cycles(
    problem: Windows,
    mirror: Windows,
    colony: Colony,
    habits: Habits,
    moves: Moves,
    seed: np.uint64,
    count: int,
    beam: Beam,
    t: Trail,
) -> int:
    """Run up to `count` cycles, until there is a better order; return the number of cycles.

    mirror : the same task backwards in time: stop i becomes stop n - 1 - i.
    """
    state = np.zeros(1, dtype=np.uint64)
    record = colony.record
    best = record[BEST]
    for done in range(count):
        state[0] = rng.stream(seed, np.uint64(record[CYCLE]))
        found = walk(problem, mirror, colony, habits, moves, beam, state) if habits.width > 0 else np.inf
        record[CYCLE] += 1
        if found == np.inf and record[BEST] == np.inf:
            continue
        copy_row(colony.orders[2 if found < np.inf else 0], t.order)
        refresh(problem, t)
        wander(problem, colony, habits, moves, t, state)
        learn(colony, habits)
        if record[BEST] < best:
            return done + 1
    return count
