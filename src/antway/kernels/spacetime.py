"""Ants in space and time: a colony on the graph of safe intervals, with exact times and a shared memory.

A state is a cell together with an interval of time in which a robot may stand there. From a state an ant moves to a neighbour
cell: it waits for the first safe departure and drives. The colony remembers for each state the earliest arrival and the state
it came from, so every ant continues from the best way known to wherever it is, and which moves have been tried. Ants are
recruited to where untried moves promise most; when no promise beats the best way it is optimal, so the colony is complete.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.jit import bare_kernel, kernel
from antway.kernels.pieces import TOUCH, earliest_departure, unsafe_stay
from antway.kernels.place import Place, centre, clear
from antway.kernels.rng import uniform
from antway.kernels.trails import Trails, edge, lay, scent

PIECES = 2048  # of all predictions at most
STATES = 1 << 14  # of the memory; a search that fills it ends with what it has
HEAP = 1 << 15
LEGS = 64  # first moves at most: from wherever the robot is to cells around
_EXP = np.exp(-np.arange(1024) / 64.0).astype(np.float32)  # weights are drawn, never compared: 1/64 is fine enough


class Memory(NamedTuple):
    """What the colony knows within one search; stamps in place of clearing."""

    stamp: NDArray[np.int32]  # [cells] search in which a cell's intervals were made
    first: NDArray[np.int32]  # [cells] its first state
    intervals: NDArray[np.int32]  # [cells] how many
    cell: NDArray[np.int32]  # [STATES] -1: the start
    low: NDArray[np.float64]  # [STATES] the safe interval, s
    high: NDArray[np.float64]
    arrival: NDArray[np.float64]  # [STATES] earliest so far, s
    depart: NDArray[np.float64]  # [STATES] when the parent was left for it, s
    parent: NDArray[np.int32]  # [STATES]
    tried: NDArray[np.uint64]  # [STATES] moves tried at the present arrival
    key: NDArray[np.float64]  # [STATES] least cost that its untried moves promise, s; infinite if there are none
    heap_key: NDArray[np.float64]  # [HEAP] the open states, least key first; entries may be stale
    heap_state: NDArray[np.int32]  # [HEAP]
    leg_cell: NDArray[np.int32]  # [LEGS] cells of the first moves
    leg_time: NDArray[np.float64]  # [LEGS] s
    span: NDArray[np.float64]  # [2, PIECES] scratch
    counter: NDArray[np.int64]  # [5] searches, states, moves tested, ant steps, heap entries


@bare_kernel
def _open(memory: Memory, cell: int, x: float, y: float, t0: float, horizon: float, pieces: NDArray[np.float64]) -> None:
    """Make the states of a cell: the intervals of [t0, inf) in which it is safe to stand at (x, y)."""
    lows, highs = memory.span[0], memory.span[1]
    n = 0
    for p in range(len(pieces)):
        low, high = unsafe_stay(x, y, pieces, p)
        if high <= t0 or low >= high:
            continue
        i = n  # insert in order of `low`
        while i > 0 and lows[i - 1] > low:
            lows[i], highs[i] = lows[i - 1], highs[i - 1]
            i -= 1
        lows[i], highs[i] = low, high
        n += 1
    begin = memory.counter[1]
    if cell >= 0:
        memory.stamp[cell] = memory.counter[0]
        memory.first[cell] = begin
    since = t0
    for i in range(n + 1):
        until = lows[i] if i < n else math.inf
        if until > since + TOUCH and memory.counter[1] < len(memory.cell) and since < horizon:
            s = memory.counter[1]
            memory.cell[s], memory.low[s], memory.high[s] = cell, since, until
            memory.arrival[s] = memory.key[s] = math.inf
            memory.tried[s] = np.uint64(0)
            memory.counter[1] += 1
        if i < n:
            since = max(since, highs[i])
    if cell >= 0:
        memory.intervals[cell] = memory.counter[1] - begin


@bare_kernel
def _push(memory: Memory, key: float, s: int) -> None:
    """Put state s on the heap of open states under `key`, its least cost over untried moves; older entries become stale."""
    memory.key[s] = key
    i = memory.counter[4]
    if i == len(memory.heap_key):
        return
    memory.counter[4] += 1
    while i > 0 and memory.heap_key[(i - 1) // 2] > key:
        memory.heap_key[i], memory.heap_state[i] = memory.heap_key[(i - 1) // 2], memory.heap_state[(i - 1) // 2]
        i = (i - 1) // 2
    memory.heap_key[i], memory.heap_state[i] = key, s


@bare_kernel
def _pop(memory: Memory) -> None:
    """Take the least entry off the heap."""
    memory.counter[4] -= 1
    n = memory.counter[4]
    key, s = memory.heap_key[n], memory.heap_state[n]
    i = 0
    while 2 * i + 1 < n:
        child = 2 * i + 1
        if child + 1 < n and memory.heap_key[child + 1] < memory.heap_key[child]:
            child += 1
        if memory.heap_key[child] >= key:
            break
        memory.heap_key[i], memory.heap_state[i] = memory.heap_key[child], memory.heap_state[child]
        i = child
    memory.heap_key[i], memory.heap_state[i] = key, s


@bare_kernel
def _expand(
    memory: Memory,
    place: Place,
    s: int,
    cell: int,
    duration: float,
    x: float,
    y: float,
    t0: float,
    horizon: float,
    pieces: NDArray[np.float64],
    lag: float,
    work: NDArray[np.float64],
) -> int:
    """Drive from state s at (x, y) to every safe interval of `cell` as early as can be; keep what is earlier than known.

    Returns the first state that is reached earlier than before, or -1.
    """
    soonest = -1
    gx, gy = centre(place, cell)
    if memory.stamp[cell] != memory.counter[0]:
        _open(memory, cell, gx, gy, t0, horizon, pieces)
    memory.counter[2] += 1
    vx, vy = ((gx - x) / duration, (gy - y) / duration) if duration > 0.0 else (0.0, 0.0)
    since = memory.arrival[s]
    limit = min(memory.high[s], horizon)
    for c in range(memory.first[cell], memory.first[cell] + memory.intervals[cell]):
        if memory.high[c] <= since + duration:
            continue
        if memory.low[c] - duration > limit:
            break
        depart = earliest_departure(x, y, vx, vy, duration, max(since, memory.low[c] - duration), limit, pieces, lag, work)
        if depart == math.inf:
            break
        arrival = depart + duration
        if arrival < memory.high[c] and arrival < memory.arrival[c] - TOUCH:
            memory.arrival[c], memory.depart[c], memory.parent[c] = arrival, depart, s
            memory.tried[c] = np.uint64(0)
            _push(memory, arrival + place.field[cell], c)
            if soonest < 0:
                soonest = c
    return soonest


@kernel
def deposit(memory: Memory, trails: Trails, place: Place, end: int, amount: float) -> None:
    """Lay `amount` on each edge (cell, move, bin of arrival) of the way that leads to state `end`, Eq. (2)."""
    s = end
    while memory.cell[s] >= 0 and memory.cell[memory.parent[s]] >= 0:
        p = memory.parent[s]
        for k in range(len(place.offset)):
            if memory.cell[p] + place.offset[k] == memory.cell[s]:
                lay(trails, edge(trails, memory.cell[p], k, memory.arrival[p]), amount)
        s = p


@kernel
def _legs(memory: Memory, place: Place, x: float, y: float, reach: int) -> int:
    """Fill in the first moves: straight legs from (x, y) to the cells at most `reach` cells around; returns how many."""
    rows, cols = place.blocked.shape
    col0 = math.floor((x - place.x0) / place.resolution + 0.5)
    row0 = math.floor((y - place.y0) / place.resolution + 0.5)
    n = 0
    for row in range(max(row0 - reach, 0), min(row0 + reach, rows - 1) + 1):
        for col in range(max(col0 - reach, 0), min(col0 + reach, cols - 1) + 1):
            cell = row * cols + col
            if place.field[cell] < math.inf and n < LEGS:
                memory.leg_cell[n] = cell
                gx, gy = centre(place, cell)
                memory.leg_time[n] = math.hypot(gx - x, gy - y) / place.speed
                n += 1
    return n


@kernel
def search(
    memory: Memory,
    trails: Trails,
    place: Place,
    pieces: NDArray[np.float64],
    lag: float,
    x: float,
    y: float,
    t0: float,
    horizon: float,
    reach: int,
    betas: NDArray[np.float64],
    slack: NDArray[np.float64],
    gain: float,
    limit: float,
    max_tests: int,
    amount: float,
    state: NDArray[np.uint64],
) -> tuple[int, float, float]:
    """Send ants from (x, y) at t0; returns (best end state or -1, its arrival at the goal, a lower bound on any), in s.

    Parameters
    ----------
    pieces, lag : float64[P, 8], float
        Predicted obstacles, margins included, and the lag of those that a moving robot keeps clear of; kernels/pieces.py.
    horizon : float
        Absolute time after which obstacles are forgotten: a way that ends then is charged the field from there.
    reach : int
        How many cells around (x, y) the first move may end.
    betas, slack : float64[B]
        Of ants 0, 1, ... in turn: greed in 1/s, and how much an ant lets the cost of its way grow before it gives up, s.
    gain : float
        s; a way counts as better only by more than this.
    limit : float
        Arrival that has to be bettered (that of the plan in use), s; infinite for none.
    max_tests : int
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
    memory.counter[:] = np.array([memory.counter[0] + 1, 0, 0, 0, 0])
    work = np.empty(2)
    weight = np.empty(LEGS)
    cost = np.empty(LEGS)
    legs = _legs(memory, place, x, y, reach)
    _open(memory, -1, x, y, t0, horizon, pieces)
    here = math.inf  # static bound at the start
    for k in range(legs):
        here = min(here, memory.leg_time[k] + place.field[memory.leg_cell[k]])
    if here == math.inf or memory.counter[1] == 0 or memory.low[0] > t0:
        return -1, math.inf, t0 + here
    memory.counter[1] = 1  # the start's later intervals cannot be reached without leaving it
    memory.arrival[0], memory.parent[0] = t0, -1
    _push(memory, t0 + here, 0)
    best, best_cost, bound = -1, limit, t0 + here
    one = np.uint64(1)
    ant = 0
    while memory.counter[2] < max_tests and memory.counter[1] < len(memory.cell) - 64:
        while memory.counter[4] > 0 and memory.heap_key[0] != memory.key[memory.heap_state[0]]:
            _pop(memory)  # stale
        bound = memory.heap_key[0] if memory.counter[4] > 0 else math.inf
        if bound >= best_cost - gain:
            break
        s = memory.heap_state[0]
        _pop(memory)
        beta = betas[ant % len(betas)]
        most = bound + slack[ant % len(slack)]
        ant += 1
        while memory.counter[2] < max_tests:
            cell, now = memory.cell[s], memory.arrival[s]
            # A robot that may stand here until obstacles are forgotten can go on along the field then.
            done = now if cell == place.goal else max(now, horizon) if memory.high[s] >= horizon else math.inf
            if cell >= 0 and done + place.field[cell] < best_cost - gain:
                best, best_cost = s, done + place.field[cell]
                deposit(memory, trails, place, s, amount / (best_cost - t0))
            if cell == place.goal or now >= horizon:
                memory.key[s] = math.inf
                break
            memory.counter[3] += 1
            moves = legs if s == 0 else len(place.offset)
            at = here if s == 0 else place.field[cell]
            sx, sy = (x, y) if s == 0 else centre(place, cell)
            scented = s != 0 and trails.mark[cell]
            total, least = 0.0, math.inf
            for k in range(moves):
                weight[k], cost[k] = 0.0, math.inf
                if memory.tried[s] >> np.uint64(k) & one:
                    continue
                if s == 0:
                    extra = memory.leg_time[k] + place.field[memory.leg_cell[k]] - at
                elif (place.legal[cell] >> np.uint32(k)) & np.uint32(1):
                    extra = place.step[k, 2] + place.field[cell + place.offset[k]] - at
                else:
                    continue
                cost[k] = now + at + extra
                if cost[k] >= best_cost - gain:
                    continue
                weight[k] = float(_EXP[min(int(max(beta * extra, 0.0) * 64.0), 1023)])
                if scented:
                    weight[k] *= scent(trails, edge(trails, cell, k, now))
                total += weight[k]
            then = -1
            while then < 0 and total > 1e-9:
                spin, k = uniform(state) * total, -1
                for i in range(moves):
                    if weight[i] > 0.0:
                        k = i
                        spin -= weight[i]
                        if spin < 0.0:
                            break
                memory.tried[s] |= one << np.uint64(k)
                total -= weight[k]
                weight[k], cost[k] = 0.0, math.inf
                target = memory.leg_cell[k] if s == 0 else cell + place.offset[k]
                if s == 0 and not clear(place, x, y, *centre(place, target)):
                    continue
                duration = memory.leg_time[k] if s == 0 else place.step[k, 2]
                then = _expand(memory, place, s, target, duration, sx, sy, t0, horizon, pieces, lag, work)
            for k in range(moves):
                if cost[k] < best_cost - gain:
                    least = min(least, cost[k])
            memory.key[s] = math.inf
            if least < math.inf:
                _push(memory, least, s)
            if then < 0 or memory.key[then] > most:
                break
            s = then
    return best, best_cost, max(min(bound, best_cost - gain), t0 + here)  # what would gain less was passed over
