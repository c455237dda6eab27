"""Memory of a colony in space and time within one search: opened cells, their safe intervals, and the open states."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import CLEARANCE_RADIUS, T0, T1, VX, VY, Predictions, X, Y
from antway.kernels.spacetime.segments import TOUCH, delayed, insert_interval, unsafe_stay, within

KNOTS = 2048  # most knots of a plan
SEGMENTS = 2048  # most motion segments of all predictions together
NEAR = 1 << 16  # most pairs of an open cell and a motion segment near it in one search
STATES = 1 << 14  # most states of a search; when they are used up, the search ends with the best path so far
HEAP = 1 << 15  # most entries of the heap of open states, including stale ones
LEGS = 64  # most first moves, which go from the robot's place to the centres of cells around it
# Entries of `Memory.counter`: the number of searches so far; then the numbers of states, tested moves, heap entries and rows of
# `near_segment` in the present search.
GENERATION, STATE_COUNT, EXPANSIONS, HEAP_SIZE, NEAR_COUNT = range(5)


class Memory(NamedTuple):
    """Memory of the colony within one search. Stamps mark the valid cells, so the arrays need not be cleared."""

    stamp: NDArray[np.int32]  # [cells] number of the search in which the cell was opened
    first: NDArray[np.int32]  # [cells] first state of the cell
    intervals: NDArray[np.int32]  # [cells] number of states of the cell
    latest: Floats  # [cells] s; latest arrival among the cell's states; a later one improves nothing
    near: NDArray[np.int32]  # [cells + 1, 2] rows [first, last) of `near_segment` near a cell; the last is the start's
    near_segment: NDArray[np.int32]  # [NEAR]
    near_time: Floats  # [NEAR, 2] s; start and end of the time for which the segment matters
    box: Floats  # [SEGMENTS, 4] m; bounding box of a motion segment
    cell: NDArray[np.int32]  # [STATES] flat cell, or -1 for the start
    low: Floats  # [STATES] s; start of the safe interval
    high: Floats
    arrival: Floats  # [STATES] s; earliest arrival so far
    depart: Floats  # [STATES] s; departure from the parent
    distance_cost: Floats  # [STATES] s; cost of the distance of the path in addition to its time
    parent: NDArray[np.int32]  # [STATES]
    tried: NDArray[np.uint64]  # [STATES] bits of the moves tried at the present arrival
    key: Floats  # [STATES] s; least promise of its untried moves, infinite if there are none
    heap_key: Floats  # [HEAP] s; keys of the open states, least first; entries may be stale
    heap_state: NDArray[np.int32]  # [HEAP]
    leg_cell: Ints  # [LEGS] cells of the first moves
    leg_time: Floats  # [LEGS] s
    span: Floats  # [SEGMENTS, 2] scratch
    knots: Floats  # [KNOTS, 3] scratch, rows (t, x, y)
    segments: Floats  # [SEGMENTS, 8] scratch
    counter: Ints  # [5] see GENERATION and the others above


@bare_kernel
def note_boxes(memory: Memory, segments: Floats) -> None:
    """Store the bounding box of each motion segment."""
    for p in range(len(segments)):
        x, y, span = segments[p, X], segments[p, Y], segments[p, T1] - segments[p, T0]
        clearance_radius = segments[p, CLEARANCE_RADIUS]
        ex, ey = x + segments[p, VX] * span, y + segments[p, VY] * span
        memory.box[p, 0], memory.box[p, 1] = min(x, ex) - clearance_radius, max(x, ex) + clearance_radius
        memory.box[p, 2], memory.box[p, 3] = min(y, ey) - clearance_radius, max(y, ey) + clearance_radius


@bare_kernel
def open_cell(
    memory: Memory, cell: int, x: float, y: float, longest_move: float, t0: float, horizon: float, segments: Floats
) -> None:
    """Create the states of a cell: the intervals of [t0, inf) in which it is safe to stand at (x, y).

    The motion segments that come near enough to matter for a move out of the cell are stored. No move is longer than
    `longest_move` m.
    """
    n, near = 0, memory.counter[NEAR_COUNT]
    if near + len(segments) > len(memory.near_segment):  # the memory is full, so the cell stays closed
        memory.stamp[cell], memory.intervals[cell] = memory.counter[GENERATION], 0
        return
    for p in range(len(segments)):
        box = memory.box[p]
        if x + longest_move < box[0] or x - longest_move > box[1] or y + longest_move < box[2] or y - longest_move > box[3]:
            continue
        since, until = within(x, y, segments[p, CLEARANCE_RADIUS] + longest_move, segments, p)
        if since >= until:
            continue
        memory.near_segment[near], memory.near_time[near, 0], memory.near_time[near, 1] = p, since, until
        near += 1
        low, high = unsafe_stay(x, y, segments, p)
        if high <= t0 or low >= high:
            continue
        n = insert_interval(memory.span, n, low, high)
    memory.near[cell, 0], memory.near[cell, 1] = memory.counter[NEAR_COUNT], near  # the start is cell -1, the last row
    memory.counter[NEAR_COUNT] = near
    start = memory.counter[STATE_COUNT]
    if cell >= 0:
        memory.stamp[cell] = memory.counter[GENERATION]
        memory.first[cell] = start
    since = t0
    for i in range(n + 1):
        until = memory.span[i, 0] if i < n else math.inf
        if until > since + TOUCH and memory.counter[STATE_COUNT] < len(memory.cell) and since < horizon:
            s = memory.counter[STATE_COUNT]
            memory.cell[s], memory.low[s], memory.high[s] = cell, since, until
            memory.arrival[s] = memory.key[s] = math.inf
            memory.tried[s], memory.distance_cost[s] = np.uint64(0), 0.0
            memory.counter[STATE_COUNT] += 1
        if i < n:
            since = max(since, memory.span[i, 1])
    if cell >= 0:
        memory.intervals[cell] = memory.counter[STATE_COUNT] - start
        memory.latest[cell] = math.inf if memory.counter[STATE_COUNT] > start else -math.inf


@bare_kernel
def keep_earlier(memory: Memory, s: int) -> bool:
    """Copy state s to a new state, so that s can be reached later at a lower cost; return False if the memory is full.

    Paths that continue from s then continue from the copy, because the later arrival at s may be too late for them.
    """
    new = memory.counter[STATE_COUNT]
    if new >= len(memory.cell):
        return False
    memory.counter[STATE_COUNT] += 1
    memory.cell[new], memory.low[new], memory.high[new] = memory.cell[s], memory.low[s], memory.high[s]
    memory.arrival[new], memory.depart[new], memory.parent[new] = memory.arrival[s], memory.depart[s], memory.parent[s]
    memory.distance_cost[new], memory.tried[new] = memory.distance_cost[s], memory.tried[s]
    for other in range(new):
        if memory.parent[other] == s:
            memory.parent[other] = new
    push(memory, memory.key[s], new)
    return True


@bare_kernel
def leave(
    memory: Memory,
    cell: int,
    x: float,
    y: float,
    vx: float,
    vy: float,
    duration: float,
    s: float,
    limit: float,
    predictions: Predictions,
) -> float:
    """Do as `earliest_departure`, for an open cell: only the motion segments near the cell are tested."""
    first, last = memory.near[cell, 0], memory.near[cell, 1]
    stopping_time = predictions.stopping_time
    i, clear = first, 0
    while clear < last - first and s <= limit:
        later = s
        if memory.near_time[i, 0] <= s - stopping_time + duration and memory.near_time[i, 1] >= s - stopping_time:
            later = delayed(x, y, vx, vy, duration, s, predictions, memory.near_segment[i])
        clear = clear + 1 if later == s else 1
        s, i = later, i + 1 if i + 1 < last else first
    return s if s <= limit else math.inf


@bare_kernel
def push(memory: Memory, key: float, s: int) -> None:
    """Push state s onto the heap of open states with `key`, the least promise of its moves; older entries become stale."""
    memory.key[s] = key
    if memory.counter[HEAP_SIZE] == len(memory.heap_key):
        _drop_stale(memory)
    if memory.counter[HEAP_SIZE] < len(memory.heap_key):
        _insert(memory, key, s)


@bare_kernel
def _drop_stale(memory: Memory) -> None:
    """Remove all stale entries from a heap that is full of them."""
    n, memory.counter[HEAP_SIZE] = memory.counter[HEAP_SIZE], 0
    for i in range(n):  # the heap of those before entry i takes no more room than they did
        key, s = memory.heap_key[i], memory.heap_state[i]
        if key == memory.key[s]:
            _insert(memory, key, s)


@bare_kernel
def _insert(memory: Memory, key: float, s: int) -> None:
    """Insert an entry into the heap, which has room for it."""
    i = memory.counter[HEAP_SIZE]
    memory.counter[HEAP_SIZE] += 1
    while i > 0 and memory.heap_key[(i - 1) // 2] > key:
        memory.heap_key[i], memory.heap_state[i] = memory.heap_key[(i - 1) // 2], memory.heap_state[(i - 1) // 2]
        i = (i - 1) // 2
    memory.heap_key[i], memory.heap_state[i] = key, s


@bare_kernel
def pop(memory: Memory) -> None:
    """Remove the least entry from the heap."""
    memory.counter[HEAP_SIZE] -= 1
    n = memory.counter[HEAP_SIZE]
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
