"""Ants in space and time: a colony on the graph of safe intervals, with exact times and a shared memory.

A state is a cell together with an interval of time in which a robot may stand there. From a state an ant moves to a neighbour
cell: it waits for the first safe departure and drives. The colony remembers for each state the earliest arrival and the state
it came from, so every ant continues from the best way known to wherever it is, and which moves have been tried. Ants are
recruited to where untried moves promise most; when no promise beats the best way it is optimal, so the colony is complete.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.bits import ctz
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.rng import uniform
from antway.kernels.spacetime.context import PlanningContext, centre, clear
from antway.kernels.spacetime.memory import LEGS, Memory, leave, note_box, open_cell, pop, push
from antway.kernels.spacetime.pheromone import Trails, edge, lay, slot
from antway.kernels.spacetime.segments import TOUCH

_EXP = np.exp(-np.arange(1024) / 64.0).astype(np.float32)  # weights are drawn, never compared: 1/64 is fine enough


@inner_kernel
def _expand(
    memory: Memory,
    context: PlanningContext,
    s: int,
    cell: int,
    duration: float,
    x: float,
    y: float,
    longest_move: float,
    t0: float,
    horizon: float,
    segments: NDArray[np.float64],
    stopping_time: float,
    work: NDArray[np.float64],
) -> int:
    """Drive from state s at (x, y) to every safe interval of `cell` as early as can be; keep what is earlier than known.

    Returns the first state that is reached earlier than before, or -1.
    """
    soonest = -1
    gx, gy = centre(context, cell)
    if memory.stamp[cell] != memory.counter[0]:
        open_cell(memory, cell, gx, gy, longest_move, t0, horizon, segments)
    memory.counter[2] += 1
    vx, vy = ((gx - x) / duration, (gy - y) / duration) if duration > 0.0 else (0.0, 0.0)
    since = memory.arrival[s]
    limit = min(memory.high[s], horizon)
    for c in range(memory.first[cell], memory.first[cell] + memory.intervals[cell]):
        if memory.high[c] <= since + duration:
            continue
        soon = max(since, memory.low[c] - duration)
        if soon > limit:
            break
        if soon + duration >= memory.arrival[c] - TOUCH:
            continue
        depart = leave(memory, memory.cell[s], x, y, vx, vy, duration, soon, limit, segments, stopping_time, work)
        if depart == math.inf:
            break
        arrival = depart + duration
        if arrival < memory.high[c] and arrival < memory.arrival[c] - TOUCH:
            memory.arrival[c], memory.depart[c], memory.parent[c] = arrival, depart, s
            memory.tried[c] = np.uint64(0)
            push(memory, arrival + context.field[cell], c)
            if soonest < 0:
                soonest = c
    if soonest >= 0:
        memory.latest[cell] = memory.arrival[memory.first[cell] : memory.first[cell] + memory.intervals[cell]].max()
    return soonest


@kernel
def deposit(memory: Memory, trails: Trails, context: PlanningContext, end: int, amount: float) -> None:
    """Lay `amount` on each edge (cell, move, bin of arrival) of the way that leads to state `end`, Eq. (2)."""
    s = end
    while memory.cell[s] >= 0 and memory.cell[memory.parent[s]] >= 0:
        p = memory.parent[s]
        for k in range(len(context.offset)):
            if memory.cell[p] + context.offset[k] == memory.cell[s]:
                lay(trails, edge(trails, memory.cell[p], k, memory.arrival[p]), amount)
        s = p


@kernel
def _legs(memory: Memory, context: PlanningContext, x: float, y: float, leg_cells: int) -> int:
    """Fill in the first moves: straight legs from (x, y) to the cells at most `leg_cells` cells around; returns how many."""
    rows, cols = context.blocked.shape
    col0 = math.floor((x - context.x0) / context.resolution + 0.5)
    row0 = math.floor((y - context.y0) / context.resolution + 0.5)
    n = 0
    for row in range(max(row0 - leg_cells, 0), min(row0 + leg_cells, rows - 1) + 1):
        for col in range(max(col0 - leg_cells, 0), min(col0 + leg_cells, cols - 1) + 1):
            cell = row * cols + col
            if context.field[cell] < math.inf and n < LEGS:
                memory.leg_cell[n] = cell
                gx, gy = centre(context, cell)
                memory.leg_time[n] = math.hypot(gx - x, gy - y) / context.speed
                n += 1
    return n


@bare_kernel
def _weigh(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    base: int,
    offset: NDArray[np.int64],
    time: NDArray[np.float64],
    moves: np.uint64,
    now: float,
    promised: float,
    beta: float,
    limit: float,
    scented: bool,
    move: NDArray[np.int64],
    cost: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> tuple[int, float]:
    """Write those of `moves`, bits, that promise to arrive before `limit`, their promises and weights by Eq. (1).

    Move k goes to the cell `base` + offset[k] in time[k] s; who comes there no earlier than others came has nothing to gain.
    Returns how many they are and the sum of the weights.
    """
    n, total = 0, 0.0
    while moves:
        k = ctz(moves)
        moves &= moves - np.uint64(1)
        target, then = base + offset[k], now + time[k]
        move[n], cost[n] = k, then + context.field[target]
        if (cost[n] < limit) & ((memory.stamp[target] != memory.counter[0]) | (then < memory.latest[target])):
            n += 1
    trail = edge(trails, base, 0, now)
    for m in range(n):
        likely = float(_EXP[min(int(max(beta * (cost[m] - promised), 0.0) * 64.0), 1023)])
        if scented:
            i = slot(trails, trail + move[m])
            likely *= 1.0 + trails.tau[i] if i >= 0 and trails.key[i] >= 0 else 1.0
        weight[m] = likely
        total += likely
    return n, total


@kernel
def search(
    memory: Memory,
    trails: Trails,
    context: PlanningContext,
    segments: NDArray[np.float64],
    stopping_time: float,
    x: float,
    y: float,
    t0: float,
    horizon: float,
    leg_cells: int,
    betas: NDArray[np.float64],
    slack: NDArray[np.float64],
    minimum_improvement: float,
    limit: float,
    max_expansions: int,
    amount: float,
    state: NDArray[np.uint64],
) -> tuple[int, float, float]:
    """Send ants from (x, y) at t0; returns (best end state or -1, its arrival at the goal, a lower bound on any), in s.

    Parameters
    ----------
    segments, stopping_time : float64[P, 8], float
        Predicted obstacles, margins included, and the lag of those that a moving robot keeps clear of; kernels/spacetime/segments.py.
    horizon : float
        Absolute time after which obstacles are forgotten: a way that ends then is charged the field from there.
    leg_cells : int
        How many cells around (x, y) the first move may end.
    betas, slack : float64[B]
        Of ants 0, 1, ... in turn: greed in 1/s, and how much an ant lets the cost of its way grow before it gives up, s.
    minimum_improvement : float
        s; a way counts as better only by more than this.
    limit : float
        Arrival that has to be bettered (that of the plan in use), s; infinite for none.
    max_expansions : int
        Moves tested in all.
    amount : float
        Q of the deposit Q / L on a way that is better than all before, L its duration in s; 0 for no pheromone.
    state : uint64[1]
        Of the random generator.

    Notes
    -----
    Each ant is recruited to the open state whose untried moves promise the least cost, and walks from there. It chooses by
    Eq. (1) with the heuristic exp(-beta * extra), extra = step + field(next) - field(here) >= 0: a move is drawn first and
    tested after. The promise of the best open state bounds every way not yet tried, so the gap of the best is certified.
    """
    memory.counter[0] += 1
    memory.counter[1:] = 0
    legs = _legs(memory, context, x, y, leg_cells)
    here = math.inf  # static bound at the start
    for k in range(legs):
        here = min(here, memory.leg_time[k] + context.field[memory.leg_cell[k]])
    if here == math.inf or t0 + here >= limit - minimum_improvement:
        return -1, limit, t0 + here
    for p in range(len(segments)):
        note_box(memory, segments, p)
    open_cell(memory, -1, x, y, memory.leg_time[:legs].max() * context.speed, t0, horizon, segments)
    if memory.counter[1] == 0 or memory.low[0] > t0:
        return -1, math.inf, t0 + here
    work, weight, cost, move = np.empty(2), np.empty(LEGS), np.empty(LEGS), np.empty(LEGS, np.int64)
    time, all_legs = context.step[:, 2].copy(), ~np.uint64(0) >> np.uint64(64 - legs)
    longest_move = time.max() * context.speed
    memory.counter[1] = 1  # the start's later intervals cannot be reached without leaving it
    memory.arrival[0], memory.parent[0] = t0, -1
    push(memory, t0 + here, 0)
    best, best_cost, bound = -1, limit, t0 + here
    one = np.uint64(1)
    ant = 0
    while memory.counter[2] < max_expansions and memory.counter[1] < len(memory.cell) - 64:
        while memory.counter[4] > 0 and memory.heap_key[0] != memory.key[memory.heap_state[0]]:
            pop(memory)  # stale
        bound = memory.heap_key[0] if memory.counter[4] > 0 else math.inf
        if bound >= best_cost - minimum_improvement:
            break
        s = memory.heap_state[0]
        pop(memory)
        beta = betas[ant % len(betas)]
        most = bound + slack[ant % len(slack)]
        ant += 1
        while memory.counter[2] < max_expansions:
            cell, now = memory.cell[s], memory.arrival[s]
            # A robot that may stand here until obstacles are forgotten can go on along the field then.
            done = now if cell == context.goal else max(now, horizon) if memory.high[s] >= horizon else math.inf
            if cell >= 0 and done + context.field[cell] < best_cost - minimum_improvement:
                best, best_cost = s, done + context.field[cell]
                deposit(memory, trails, context, s, amount / (best_cost - t0))
            if cell == context.goal or now >= horizon:
                memory.key[s] = math.inf
                break
            memory.counter[3] += 1
            if s == 0:
                n, total = _weigh(
                    memory,
                    trails,
                    context,
                    0,
                    memory.leg_cell,
                    memory.leg_time,
                    all_legs & ~memory.tried[0],
                    now,
                    now + here,
                    beta,
                    best_cost - minimum_improvement,
                    False,
                    move,
                    cost,
                    weight,
                )
            else:
                n, total = _weigh(
                    memory,
                    trails,
                    context,
                    cell,
                    context.offset,
                    time,
                    context.legal[cell] & ~memory.tried[s],
                    now,
                    now + context.field[cell],
                    beta,
                    best_cost - minimum_improvement,
                    trails.mark[cell],
                    move,
                    cost,
                    weight,
                )
            sx, sy = (x, y) if s == 0 else centre(context, cell)
            then = -1
            while then < 0 and total > 1e-9:
                spin, i = uniform(state) * total, -1
                for m in range(n):
                    if weight[m] > 0.0:
                        i = m
                        spin -= weight[m]
                        if spin < 0.0:
                            break
                k = move[i]
                memory.tried[s] |= one << np.uint64(k)
                total -= weight[i]
                weight[i], cost[i] = 0.0, math.inf
                target, duration = (memory.leg_cell[k], memory.leg_time[k]) if s == 0 else (cell + context.offset[k], time[k])
                if s == 0 and not clear(context, x, y, *centre(context, target)):
                    continue
                then = _expand(
                    memory, context, s, target, duration, sx, sy, longest_move, t0, horizon, segments, stopping_time, work
                )
            memory.key[s], least = math.inf, cost[:n].min() if n else math.inf
            if least < math.inf:
                push(memory, least, s)
            if then < 0 or memory.key[then] > most:
                break
            s = then
    return best, best_cost, max(min(bound, best_cost - minimum_improvement), t0 + here)  # what would gain less was passed over
