"""Ants in space and time: a colony on the graph of safe intervals, with exact times and a shared memory.

A state is a cell together with an interval of time in which the robot may stand there. From a state, an ant moves to a
neighbour cell: it waits for the first safe departure and drives. For each state the colony remembers the earliest arrival, the
parent state and the moves that were tried, so every ant continues from the best known path to its state. Ants are recruited to
the state whose untried moves promise the lowest cost. When no promise is lower than the cost of the best path, that path is
optimal, so the colony is complete.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel, shared_kernel
from antway.kernels.base.records import Predictions
from antway.kernels.base.rng import State, uniform
from antway.kernels.spacetime.context import PlanningContext, block_around, centre, clear
from antway.kernels.spacetime.memory import (
    EXPANSIONS,
    GENERATION,
    HEAP_SIZE,
    LEGS,
    STATE_COUNT,
    Memory,
    keep_earlier,
    leave,
    note_boxes,
    open_cell,
    pop,
    push,
)
from antway.kernels.spacetime.pheromone import Trails, edge, lay, slot
from antway.kernels.spacetime.segments import TOUCH

# exp(-k / 64); steps of 1 / 64 are fine enough for weights that only serve to draw a move
_EXP = np.exp(-np.arange(1024) / 64.0).astype(np.float32)


class AntSettings(NamedTuple):
    """How the ants of one search behave."""

    leg_cells: int  # the first move ends at most this many cells around the robot
    betas: Floats  # [B] 1/s; greediness of ants 0, 1, ... in turn
    slack: Floats  # [B] s; an ant gives up when the cost of its path has grown by more than this
    minimum_improvement: float  # s; a path counts as better only by more than this
    amount: float  # s; Q of the deposit Q / L on a path of cost L that is better than all before; 0 means no pheromone
    distance_weight: float  # s/m; cost of a metre in addition to its time
    stay: float  # s; a path may end at the goal only if the robot can stay there for this time
    moves: np.uint64 = ~np.uint64(0)  # bits of the moves that ants may choose


class _Steps(NamedTuple):
    """Moves from which an ant may choose: move k goes to the flat cell `base` + offset[k] in time[k] s."""

    base: np.int64
    offset: Ints  # [K]
    time: Floats  # [K]
    spent: float  # s; cost of the distance so far
    cost_rate: float  # see `_Shared`


class _Choices(NamedTuple):
    """Scratch for the moves that may improve the best path, their promised costs, and their weights."""

    move: Ints  # [LEGS]
    cost: Floats  # [LEGS] s; earliest arrival at the goal plus the cost of the distance
    weight: Floats  # [LEGS]


class _Shared(NamedTuple):
    """What the ants of one search share, and where and when it starts."""

    memory: Memory
    trails: Trails
    context: PlanningContext
    predictions: Predictions
    choices: _Choices
    state: State  # of the random generator
    x: float  # m
    y: float
    t0: float  # s
    horizon: float  # s, absolute
    here: float  # s; time to the goal without moving obstacles
    legs: np.uint64  # bits of the first moves
    longest_move: float  # m
    cost_rate: float  # 1; cost of a second of driving in addition to its time: the weight of a metre times the speed
    time: Floats  # [K] s; duration of each move
    moves: np.uint64  # see `AntSettings`


@inner_kernel
def _expand(shared: _Shared, s: int, cell: int, duration: float, x: float, y: float) -> int:
    """Drive from state s at (x, y) as early as possible to each safe interval of `cell`; keep the cheaper arrivals.

    Without a cost of distance the cheaper arrival is the earlier one. Returns the first state that was improved, or -1.
    """
    memory, context, predictions, improved = shared.memory, shared.context, shared.predictions, -1
    gx, gy = centre(context, cell)
    if memory.stamp[cell] != memory.counter[GENERATION]:
        open_cell(memory, cell, gx, gy, shared.longest_move, shared.t0, shared.horizon, predictions.segments)
    memory.counter[EXPANSIONS] += 1
    vx, vy = ((gx - x) / duration, (gy - y) / duration) if duration > 0.0 else (0.0, 0.0)
    since = memory.arrival[s]
    limit, distance_cost = min(memory.high[s], shared.horizon), memory.distance_cost[s] + shared.cost_rate * duration
    for c in range(memory.first[cell], memory.first[cell] + memory.intervals[cell]):
        if memory.high[c] <= since + duration:
            continue
        soon = max(since, memory.low[c] - duration)
        if soon > limit:
            break
        known = memory.arrival[c] + memory.distance_cost[c]
        if soon + duration + distance_cost >= known - TOUCH:
            continue
        depart = leave(memory, memory.cell[s], x, y, vx, vy, duration, soon, limit, predictions)
        if depart == math.inf:
            break
        arrival = depart + duration
        if arrival < memory.high[c] and arrival + distance_cost < known - TOUCH:
            if arrival > memory.arrival[c] and not keep_earlier(memory, c):
                continue
            memory.arrival[c], memory.depart[c], memory.parent[c] = arrival, depart, s
            memory.tried[c], memory.distance_cost[c] = np.uint64(0), distance_cost
            push(memory, arrival + context.field[cell] + (distance_cost + shared.cost_rate * context.field[cell]), c)
            if improved < 0:
                improved = c
    if improved >= 0 and shared.cost_rate == 0.0:  # if distance costs, a later arrival may be cheaper
        memory.latest[cell] = memory.arrival[memory.first[cell] : memory.first[cell] + memory.intervals[cell]].max()
    return improved


@kernel
def deposit(memory: Memory, trails: Trails, context: PlanningContext, end: int, amount: float) -> None:
    """Deposit `amount` on each edge (cell, move, bin of arrival) of the path to state `end`, Eq. (2)."""
    s = end
    while memory.cell[s] >= 0 and memory.cell[memory.parent[s]] >= 0:
        p = memory.parent[s]
        for k in range(len(context.offset)):
            if memory.cell[p] + context.offset[k] == memory.cell[s]:
                lay(trails, edge(trails, memory.cell[p], k, memory.arrival[p]), amount)
        s = p


@kernel
def _legs(memory: Memory, context: PlanningContext, x: float, y: float, leg_cells: int) -> tuple[int, float]:
    """Write legs from (x, y) to cells up to `leg_cells` away; return how many, and the time to the goal if nothing moves, s."""
    top, bottom, left, right = block_around(context, x, y, leg_cells)
    n, here = 0, math.inf
    for row in range(top, bottom):
        for cell in range(row * context.cols + left, row * context.cols + right):
            if context.field[cell] < math.inf and n < LEGS:
                memory.leg_cell[n] = cell
                gx, gy = centre(context, cell)
                memory.leg_time[n] = math.hypot(gx - x, gy - y) / context.speed
                here = min(here, memory.leg_time[n] + context.field[cell])
                n += 1
    return n, here


@bare_kernel
def _weigh(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    steps: _Steps,
    moves: np.uint64,
    now: float,
    promised: float,
    beta: float,
    limit: float,
    has_pheromone: bool,
    choices: _Choices,
) -> tuple[int, float]:
    """Write those of `moves` (bits) that promise a cost below `limit`, with their promises and their weights by Eq. (1).

    A move that reaches a cell later than all known arrivals there is left out. `promised` is the promise of the present state.
    Returns the number of moves written and the sum of their weights.
    """
    base, offset, time = steps.base, steps.offset, steps.time
    move, cost, weight = choices.move, choices.cost, choices.weight
    n, total = 0, 0.0
    while moves:
        k = ctz(moves)
        moves &= moves - np.uint64(1)
        target, then = base + offset[k], now + time[k]
        move[n], cost[n] = k, then + context.field[target] + (steps.spent + steps.cost_rate * (time[k] + context.field[target]))
        if (cost[n] < limit) & ((memory.stamp[target] != memory.counter[GENERATION]) | (then < memory.latest[target])):
            n += 1
    trail = edge(trails, int(base), 0, now)
    for m in range(n):
        likely = float(_EXP[int(min(max(beta * (cost[m] - promised), 0.0) * 64.0, 1023.0))])
        if has_pheromone:
            i = slot(trails, trail + move[m])
            likely *= 1.0 + float(trails.tau[i]) if i >= 0 and trails.key[i] >= 0 else 1.0
        weight[m] = likely
        total += likely
    return n, total


@inner_kernel
def _draw(choices: _Choices, n: int, total: float, state: State) -> int:
    """Return the index of a choice drawn in proportion to its weight; `total` is the sum of the weights."""
    spin, i = uniform(state) * total, -1
    for m in range(n):
        if choices.weight[m] > 0.0:
            i = m
            spin -= choices.weight[m]
            if spin < 0.0:
                break
    return i


@inner_kernel
def _step(shared: _Shared, s: int, beta: float, limit: float) -> int:
    """Let an ant in state s draw moves by Eq. (1) until one improves a state; return that state, or -1.

    The least promise of the untried moves becomes the key of s among the open states.
    """
    memory, trails, context, choices = shared.memory, shared.trails, shared.context, shared.choices
    cell, now = memory.cell[s], memory.arrival[s]
    if s == 0:
        steps = _Steps(np.int64(0), memory.leg_cell, memory.leg_time, 0.0, shared.cost_rate)
        promised, untried = now + shared.here + shared.cost_rate * shared.here, shared.legs & ~memory.tried[0]
        n, total = _weigh(memory, trails, context, steps, untried, now, promised, beta, limit, False, choices)
    else:
        steps = _Steps(np.int64(cell), context.offset, shared.time, memory.distance_cost[s], shared.cost_rate)
        untried, field = context.legal[cell] & shared.moves & ~memory.tried[s], context.field[cell]
        promised = now + field + (memory.distance_cost[s] + shared.cost_rate * field)
        n, total = _weigh(memory, trails, context, steps, untried, now, promised, beta, limit, trails.mark[cell], choices)
    x, y = (shared.x, shared.y) if s == 0 else centre(context, cell)
    then = -1
    while then < 0 and total > 1e-9:
        i = _draw(choices, n, total, shared.state)
        if i < 0:  # all were drawn, and `total` is what rounding has left
            break
        k = choices.move[i]
        memory.tried[s] |= np.uint64(1) << np.uint64(k)
        total -= choices.weight[i]
        choices.weight[i], choices.cost[i] = 0.0, math.inf
        target, duration = (memory.leg_cell[k], memory.leg_time[k]) if s == 0 else (cell + context.offset[k], shared.time[k])
        if s == 0 and not clear(context, x, y, *centre(context, target)):
            continue
        then = _expand(shared, s, target, duration, x, y)
    memory.key[s], least = math.inf, choices.cost[:n].min() if n else math.inf
    if least < math.inf:
        push(memory, least, s)
    return then


@bare_kernel
def _promise(memory: Memory) -> float:
    """Remove stale entries from the top of the heap; return the least key of an open state, infinite if none is open."""
    while memory.counter[HEAP_SIZE] > 0 and memory.heap_key[0] != memory.key[memory.heap_state[0]]:
        pop(memory)
    return memory.heap_key[0] if memory.counter[HEAP_SIZE] > 0 else math.inf


@inner_kernel
def _cost(shared: _Shared, stay: float, s: int) -> tuple[bool, float]:
    """Tell whether state s is at the goal, where the robot can stay for `stay` s, and return the cost of its path, s.

    A robot that may stand elsewhere until the horizon follows the field from there; without this the cost is infinite.
    """
    memory, context = shared.memory, shared.context
    cell, now, high = memory.cell[s], memory.arrival[s], memory.high[s]
    if cell < 0:
        return False, math.inf
    arrived = cell == context.goal and high >= now + stay
    done = now if arrived else max(now, shared.horizon) if high >= shared.horizon else math.inf
    return arrived, done + context.field[cell] + (memory.distance_cost[s] + shared.cost_rate * context.field[cell])


@shared_kernel
def search(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    predictions: Predictions,
    settings: AntSettings,
    x: float,
    y: float,
    t0: float,
    horizon: float,
    limit: float,
    max_expansions: int,
    state: State,
) -> tuple[int, float, float]:
    """Send ants from (x, y) at t0; return (best end state or -1, its cost, a lower bound on any cost), in s.

    The cost of a path is its arrival at the goal plus `distance_weight` for each metre. With a weight, the memory keeps the
    cheapest path to each state, which need not be part of the best path. The bound is then the cost of a path without moving
    obstacles.

    The `predictions` include all margins. From the absolute time `horizon` on, s, obstacles are ignored; the rest of a path
    that ends then costs its time by the field. The path found must cost less than `limit` (the cost of the plan in use), s;
    infinite for no limit. At most `max_expansions` moves are tested in all.

    Each ant is recruited to the open state whose untried moves promise the least cost, and walks from there. It draws a move by
    Eq. (1) with the heuristic exp(-beta * extra), where extra = step + field(next) - field(here) >= 0, and then tests the move.
    The promise of the best open state bounds the cost of all untried paths, which certifies the gap of the best path.
    """
    # Empty the memory, write the first moves, and compute the bound without moving obstacles.
    memory.counter[GENERATION] += 1
    memory.counter[1:] = 0
    legs, here = _legs(memory, context, x, y, settings.leg_cells)
    if here == math.inf:  # no way out: the bound is infinite, also where metres have no cost
        return -1, limit, math.inf
    cost_rate = settings.distance_weight * context.speed
    least = t0 + here + cost_rate * here
    if least >= limit - settings.minimum_improvement:
        return -1, limit, least
    # Find the intervals in which the robot can stand at its place.
    note_boxes(memory, predictions.segments)
    open_cell(memory, -1, x, y, memory.leg_time[:legs].max() * context.speed, t0, horizon, predictions.segments)
    if memory.counter[STATE_COUNT] == 0 or memory.low[0] > t0:
        return -1, math.inf, least
    choices = _Choices(np.empty(LEGS, np.int64), np.empty(LEGS), np.empty(LEGS))
    time, bits = context.step[:, 2].copy(), ~np.uint64(0) >> np.uint64(64 - legs)
    known, farthest = (memory, trails, context, predictions, choices, state), time.max() * context.speed
    shared = _Shared(*known, x, y, t0, horizon, here, bits, farthest, cost_rate, time, settings.moves)
    memory.counter[STATE_COUNT] = 1  # later intervals of the start cannot be reached by waiting there
    memory.arrival[0], memory.parent[0] = t0, -1
    push(memory, least, 0)
    # Send ants one by one until no promise is below the cost of the best path or the budget is spent.
    best, best_cost, bound = -1, limit, least
    ant = 0
    while memory.counter[EXPANSIONS] < max_expansions and memory.counter[STATE_COUNT] < len(memory.cell) - 64:
        bound = _promise(memory)
        if bound >= best_cost - settings.minimum_improvement:
            break
        s = memory.heap_state[0]
        pop(memory)
        beta = settings.betas[ant % len(settings.betas)]
        most = bound + settings.slack[ant % len(settings.slack)]
        ant += 1
        while memory.counter[EXPANSIONS] < max_expansions:
            below = best_cost - settings.minimum_improvement
            arrived, cost = _cost(shared, settings.stay, s)
            if cost < below:
                best, best_cost, below = s, cost, cost - settings.minimum_improvement
                deposit(memory, trails, context, s, settings.amount / (best_cost - t0))  # Eq. (2)
            if arrived or memory.arrival[s] >= horizon:
                memory.key[s] = math.inf
                break
            then = _step(shared, s, beta, below)
            if then < 0 or memory.key[then] > most:
                break
            s = then
    # Paths that improve by less than the minimum improvement were left out, so the bound is lower by that much.
    return best, best_cost, max(min(bound, best_cost - settings.minimum_improvement), least) if cost_rate == 0.0 else least
