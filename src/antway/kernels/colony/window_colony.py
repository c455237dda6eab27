"""A colony for stops with time windows: a beam of ants, local search with random moves, and pheromone of the best orders.

Pheromone is in [0, 1] and moves towards the best orders of the cycle, since the restart, and so far; the more the colony has
converged, the more the later ones count (Blum, Dorigo, IEEE Transactions on Systems, Man, and Cybernetics B 34, 2004).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base import rng
from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.colony.time_windows import Beam, Choice, search
from antway.kernels.colony.window_search import MoveOptions, TimedOrder, refresh, settle, shake, value
from antway.kernels.colony.windows import Ids, Windows

# Elements of `WindowColony.record`.
BEST = 0  # cost of the best order so far, infinite while none is known
RESTART_BEST = 1  # cost of the best order since the last restart, infinite while none is known
CYCLE = 2  # number of cycles done
CONVERGENCE = 3  # mean pheromone on the arcs of the best order since the restart: 1 if the colony builds only this order
# Rows of `WindowColony.orders`.
SO_FAR, SINCE_RESTART, OF_CYCLE = range(3)
TAU_0, TAU_MIN, TAU_MAX = 0.5, 0.001, 0.999  # initial pheromone after a restart, and its limits
CONVERGED = 0.97  # convergence above which the colony restarts


class WindowColony(NamedTuple):
    """The state of the colony, which kernels change in place."""

    tau: Floats  # [n, n] pheromone
    penalty: Floats  # [n, n] scratch: penalty of each arc by its pheromone
    orders: Ids  # [3, n] the best order so far (SO_FAR), since the last restart (SINCE_RESTART), and of the cycle (OF_CYCLE)
    record: Floats  # [4] see BEST ... CONVERGENCE


class ColonyOptions(NamedTuple):
    """Settings that are the same in all cycles."""

    width: int  # width of the ants' beam; 0: no ants, only random moves
    attempts: int  # random moves in a cycle
    evaporation: float  # share of pheromone that is replaced in a cycle
    temperature: float  # s; by about how much worse an order may become at first
    scale: float  # s; a typical step
    hurry: float  # largest weight of a second of arrival time for ants, relative to a second of lower bound
    moves: MoveOptions  # which moves the local search tries


@bare_kernel
def deposit(tau: Floats, order: Ids, amount: float) -> None:
    """Add `amount` to the pheromone on the arcs of `order`."""
    for p in range(1, len(order)):
        tau[order[p - 1], order[p]] += amount


@bare_kernel
def deposit_weights(convergence: float) -> tuple[float, float, float]:
    """Return the weights of the deposits for the best orders of the cycle, since the restart, and so far; their sum is 1."""
    if convergence >= 0.8:
        return 0.0, 0.5, 0.5
    if convergence >= 0.6:
        return 1.0 / 3.0, 2.0 / 3.0, 0.0
    if convergence >= 0.4:
        return 2.0 / 3.0, 1.0 / 3.0, 0.0
    return 1.0, 0.0, 0.0


@bare_kernel
def learn(colony: WindowColony, evaporation: float) -> None:
    """Evaporate and deposit; restart once all orders are alike."""
    tau, orders, record, n = colony.tau, colony.orders, colony.record, colony.tau.shape[0]
    of_cycle, since_restart, so_far = deposit_weights(record[CONVERGENCE])
    for i in range(n):
        for j in range(n):
            tau[i, j] *= 1.0 - evaporation
    deposit(tau, orders[OF_CYCLE], evaporation * of_cycle)
    deposit(tau, orders[SINCE_RESTART], evaporation * since_restart)
    deposit(tau, orders[SO_FAR], evaporation * so_far)
    for i in range(n):
        for j in range(n):
            tau[i, j] = min(max(tau[i, j], TAU_MIN), TAU_MAX)
    total = 0.0
    for p in range(1, n):
        total += tau[orders[SINCE_RESTART, p - 1], orders[SINCE_RESTART, p]]
    record[CONVERGENCE] = total / (n - 1)
    if record[CONVERGENCE] > CONVERGED:
        tau[:] = TAU_0
        record[RESTART_BEST], record[CONVERGENCE] = np.inf, 0.0


@kernel
def note(colony: WindowColony, order: Ids, cost: float) -> None:
    """Keep `order` as the best so far and since the restart, if it is."""
    if cost < colony.record[BEST]:
        colony.record[BEST] = cost
        copy_row(order, colony.orders[SO_FAR])
    if cost < colony.record[RESTART_BEST]:
        colony.record[RESTART_BEST] = cost
        copy_row(order, colony.orders[SINCE_RESTART])


@kernel
def adopt(problem: Windows, colony: WindowColony, moves: MoveOptions, t: TimedOrder, order: Ids, place: int, looks: int) -> int:
    """Improve and keep `order`, which comes from elsewhere and has no late stop, by up to `looks` looks at a stop.

    Returns the `place` from which another call goes on, or 0 when there is nothing more to improve; the first call has place 0.
    """
    if place == 0:
        copy_row(order, t.order)
        t.look[:] = True
        refresh(problem, t)
        place = 1
    place = settle(problem, t, moves, place, looks)
    note(colony, t.order, value(t, moves.makespan))
    return place


@kernel
def improve(problem: Windows, colony: WindowColony, options: ColonyOptions, t: TimedOrder, state: rng.State) -> None:
    """Alternate random moves and local search (simulated annealing over local optima). No order has a late stop.

    The best order becomes that of the cycle.
    """
    moves, best_order, last = options.moves, colony.orders[OF_CYCLE], t.saved
    t.look[:] = True
    settle(problem, t, moves)
    here = value(t, moves.makespan)
    best = here
    copy_row(t.order, best_order)
    copy_row(t.order, last)
    for a in range(options.attempts):
        for _ in range(1 + rng.below(state, 4)):
            shake(problem, t, moves, options.scale, state)
        settle(problem, t, moves)
        cost = value(t, moves.makespan)
        allowed = -options.temperature * (1.0 - a / options.attempts) * math.log(1.0 - rng.uniform(state))
        if cost <= here + allowed:
            here = cost
            copy_row(t.order, last)
            if cost < best - moves.least:
                best = cost
                copy_row(t.order, best_order)
        else:
            copy_row(last, t.order)
            refresh(problem, t)
    note(colony, best_order, best)


@kernel
def build(
    problem: Windows, mirror: Windows, colony: WindowColony, options: ColonyOptions, beam: Beam, state: rng.State
) -> float:
    """Let a beam of ants build the order of the cycle, in every other cycle backwards; return its cost or infinity."""
    n = len(problem.opens)
    backward = int(colony.record[CYCLE]) % 2 == 1
    for i in range(n):
        for j in range(n):
            penalty = -math.log(colony.tau[i, j])
            if backward:
                colony.penalty[n - 1 - j, n - 1 - i] = penalty
            else:
                colony.penalty[i, j] = penalty
    bound = (0.2 + 2.0 * rng.uniform(state)) / options.scale
    hurry = bound * options.hurry * rng.uniform(state) * rng.uniform(state)
    choice = Choice(bound, hurry, 1.0, options.moves.makespan and not backward, np.inf)
    order, task = colony.orders[OF_CYCLE], mirror if backward else problem
    found, _ = search(task, colony.penalty, choice, options.width, rng.next_bits(state), beam, order)
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
    colony: WindowColony,
    options: ColonyOptions,
    seed: np.uint64,
    count: int,
    beam: Beam,
    t: TimedOrder,
) -> int:
    """Run up to `count` cycles until an order is better; return how many. `mirror` is backwards: stop i is n - 1 - i."""
    state = np.zeros(1, dtype=np.uint64)
    record = colony.record
    best = record[BEST]
    for done in range(count):
        state[0] = rng.stream(seed, np.uint64(record[CYCLE]))
        found = build(problem, mirror, colony, options, beam, state) if options.width > 0 else np.inf
        record[CYCLE] += 1
        if found == np.inf and record[BEST] == np.inf:
            continue
        copy_row(colony.orders[OF_CYCLE if found < np.inf else SO_FAR], t.order)
        refresh(problem, t)
        improve(problem, colony, options, t, state)
        learn(colony, options.evaporation)
        if record[BEST] < best:
            return done + 1
    return count
