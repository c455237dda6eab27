"""SIPP: the earliest arrival of a disc among moving discs, exact in real-valued time.

Phillips, Likhachev: SIPP: Safe Interval Path Planning for Dynamic Environments, ICRA 2011. Partial expansion: Yoshizumi,
Miura, Ishida: A* with partial expansion for large branching factor problems, AAAI 2000.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.geometry import segment_hits_cells
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import Predictions
from antway.kernels.spacetime.segments import NEVER, Segments, earliest_departure, insert_interval, unsafe_stay

FOUND, NO_PATH, BUDGET, FULL = 0, 1, 2, 3
QUERY, STATES, ENTRIES = range(3)  # indices of `SippMemory.counts`: number of the query, and of its states and heap entries
SLACK = 1e-9  # s; costs closer than this are equal


class Frame(NamedTuple):
    """Placement of the cells of a map."""

    x0: float  # m; centre of cell (0, 0)
    y0: float
    resolution: float  # m; edge of a cell
    cols: int


class TimedMove(NamedTuple):
    """A move from (x, y) m by (dx, dy) m in `duration` s to the flat cell `cell`."""

    x: float
    y: float
    dx: float
    dy: float
    duration: float
    cell: int


class SippMemory(NamedTuple):
    """Memory of `sipp` for maps of N cells, reused by later queries; `stamp` marks the cells opened by the present query.

    A state is a safe interval of a cell, or the start (state 0, cell -1).
    """

    counts: Ints  # [3] see QUERY, STATES and ENTRIES
    stamp: Ints  # [N]
    first: NDArray[np.int32]  # [N] first state of a cell
    size: NDArray[np.int32]  # [N] number of states of a cell
    cell: NDArray[np.int32]  # [S]
    parent: NDArray[np.int32]  # [S] state from which it is reached
    since: Floats  # [S] s; start of the safe interval
    end: Floats  # [S] s; end of the safe interval
    arrival: Floats  # [S] s; earliest known arrival
    depart: Floats  # [S] s; departure from the parent
    done: Floats  # [S] s; moves whose extra cost over the field is at most this have been made
    todo: Floats  # [S] s; least extra cost of the moves not yet made
    heap_key: Floats  # [Q] s; arrival + field, rounded to nanoseconds
    heap_time: Floats  # [Q] s; arrival
    heap_state: NDArray[np.int32]  # [Q]
    spans: Floats  # [P, 2] s; unsafe times of a cell


class Moving(NamedTuple):
    """A disc robot, the map, its moves on the map, and the exact field over them."""

    blocked: Bools  # [H, W]
    mask: NDArray[np.uint32]  # [H, W] legal moves, from `move_mask`
    field: Floats  # [H, W] s, from `move_field`
    offsets: NDArray[np.int32]  # [K, 2] (d_row, d_col) of the moves
    lengths: Floats  # [K] cells
    frame: Frame
    radius: float  # m
    speed: float  # m/s


@kernel
def sipp(
    moving: Moving,
    start: tuple[float, float],
    at: tuple[float, float],
    now: float,
    segments: Segments,
    max_expanded: int,
    ws: SippMemory,
) -> tuple[int, int, int, float]:
    """Find the earliest arrival of a disc among moving discs: A* over safe intervals with the exact field as heuristic.

    The cost of a state is its arrival. A robot may wait within its interval, so the earliest arrival in each interval is best.
    Moves are made in the order of their extra cost over the field, and only when the search needs them (partial expansion).

    The robot leaves `start`, (x, y) in m, at the time `now`, s. If that is not the centre of a cell, it first goes straight to
    a centre up to 3 rows and columns away. `at` is the start as the (row, col) that was found to be free of walls; rounded in
    another way, a robot that touches a wall there might be in contact with it. The contact radii of the moving discs
    (`segments`, see segments.py) include the robot's radius. At most `max_expanded` states are expanded.

    Returns FOUND, NO_PATH, BUDGET, or FULL if the workspace is too small; the state of the goal if found, else -1; how many
    states were expanded; and a lower bound on the arrival of any path, s.
    """
    field, frame = moving.field, moving.frame
    predictions = Predictions(segments, 0.0)  # the stopping time is 0, because this robot reaches any speed at once
    if len(ws.cell) <= len(segments) or len(ws.spans) < len(segments):
        return FULL, -1, 0, now
    ws.counts[QUERY] += 1
    ws.counts[STATES] = ws.counts[ENTRIES] = 0
    _open(-1, start[0], start[1], now, segments, ws)
    if ws.counts[STATES] == 0 or ws.since[0] > now:
        return NO_PATH, -1, 0, np.inf
    ws.arrival[0] = now
    fits, bound = _leave_start(moving, start, at, now, predictions, ws)
    if not fits:
        return FULL, -1, 0, bound
    expanded = 0
    while ws.counts[ENTRIES]:
        key, time, i = ws.heap_key[0], ws.heap_time[0], ws.heap_state[0]
        _pop(ws)
        if time > ws.arrival[i]:
            continue
        bound = max(bound, key - SLACK)
        here = field[ws.cell[i] // frame.cols, ws.cell[i] % frame.cols]
        if here == 0.0:
            return FOUND, i, expanded, bound
        if ws.done[i] < 0.0:
            if expanded == max_expanded:
                return BUDGET, -1, expanded, bound
            expanded += 1
        if not _make_moves(i, moving, now, predictions, ws):
            return FULL, -1, expanded, bound
        if ws.todo[i] < np.inf:
            _push(time + here + ws.todo[i], time, i, ws)
    return NO_PATH, -1, expanded, np.inf


@bare_kernel
def _leave_start(
    moving: Moving, start: tuple[float, float], at: tuple[float, float], now: float, predictions: Predictions, ws: SippMemory
) -> tuple[bool, float]:
    """Go straight from the start to the centres around it; return False if `ws` is full, and a lower bound on the arrival."""
    field, (x0, y0, size, cols) = moving.field, moving.frame
    col_at, row_at = (start[0] - x0) / size, (start[1] - y0) / size
    row, col = round(row_at), round(col_at)
    block = 0 if math.hypot(row_at - row, col_at - col) < 1e-9 else 3
    bound = np.inf
    for r in range(max(row - block, 0), min(row + block, len(field) - 1) + 1):
        for c in range(max(col - block, 0), min(col + block, cols - 1) + 1):
            if field[r, c] == np.inf or segment_hits_cells(moving.blocked, at[0], at[1], r, c, moving.radius / size, True):
                continue
            dx, dy = x0 + c * size - start[0], y0 + r * size - start[1]
            duration = math.hypot(dx, dy) / moving.speed
            bound = min(bound, now + duration + field[r, c])
            leg = TimedMove(start[0], start[1], dx, dy, duration, r * cols + c)
            if not _enter(0, leg, field[r, c], moving.frame, now, predictions, ws):
                return False, bound
    return True, bound


@inner_kernel
def _make_moves(i: int, moving: Moving, now: float, predictions: Predictions, ws: SippMemory) -> bool:
    """Make the next moves of state i in the order of their extra cost over the field; return False if `ws` is full."""
    field, frame = moving.field, moving.frame
    row, col = divmod(ws.cell[i], frame.cols)
    x, y = _centre(frame, ws.cell[i])
    limit, rest = 2 * ws.todo[i] + SLACK, np.inf  # doubled, so that all moves are made in few rounds
    for k in range(len(moving.offsets)):
        if moving.mask[row, col] >> np.uint32(k) & np.uint32(1):
            r, c = row + moving.offsets[k, 0], col + moving.offsets[k, 1]
            duration = moving.lengths[k] * frame.resolution / moving.speed
            extra = max(duration + field[r, c] - field[row, col], 0.0)
            if extra > limit:
                rest = min(rest, extra)
            elif extra > ws.done[i]:
                dx, dy = moving.offsets[k, 1] * frame.resolution, moving.offsets[k, 0] * frame.resolution
                move = TimedMove(x, y, dx, dy, duration, r * frame.cols + c)
                if not _enter(i, move, field[r, c], frame, now, predictions, ws):
                    return False
    ws.done[i], ws.todo[i] = limit, rest
    return True


@bare_kernel
def _centre(frame: Frame, cell: int) -> tuple[float, float]:
    """Return the centre (x, y) of a flat cell, m."""
    return frame.x0 + cell % frame.cols * frame.resolution, frame.y0 + cell // frame.cols * frame.resolution


@bare_kernel
def _enter(
    i: int, move: TimedMove, remaining: float, frame: Frame, now: float, predictions: Predictions, ws: SippMemory
) -> bool:
    """Make a move of state i into each safe interval of its target cell whose arrival it improves; False if `ws` is full."""
    x, y, dx, dy, duration, cell = move
    if ws.stamp[cell] != ws.counts[QUERY]:
        first = ws.counts[STATES]
        if first + len(predictions.segments) + 1 > len(ws.cell):
            return False
        _open(cell, *_centre(frame, cell), now, predictions.segments, ws)
        ws.stamp[cell], ws.first[cell], ws.size[cell] = ws.counts[QUERY], first, ws.counts[STATES] - first
    if ws.counts[ENTRIES] + ws.size[cell] + 1 > len(ws.heap_key):
        return False
    vx, vy = (dx / duration, dy / duration) if duration > 0.0 else (0.0, 0.0)
    for j in range(ws.first[cell], ws.first[cell] + ws.size[cell]):
        if max(ws.arrival[i] + duration, ws.since[j]) >= ws.arrival[j]:
            continue
        depart = max(ws.arrival[i], ws.since[j] - duration)
        latest = min(ws.end[i], ws.end[j] - duration)
        if depart > latest:
            continue
        depart = earliest_departure(x, y, vx, vy, duration, depart, latest, predictions)
        arrival = max(depart + duration, ws.since[j])
        if arrival < ws.arrival[j]:
            ws.arrival[j], ws.depart[j], ws.parent[j] = arrival, depart, i
            ws.done[j], ws.todo[j] = -1.0, 0.0
            _push(arrival + remaining, arrival, j, ws)
    return True


@bare_kernel
def _open(cell: int, x: float, y: float, now: float, segments: Segments, ws: SippMemory) -> None:
    """Append the safe intervals from `now` on of a robot standing at (x, y) as states."""
    spans, n = ws.spans, 0
    for p in range(len(segments)):
        low, high = unsafe_stay(x, y, segments, p)
        if low < high:
            n = insert_interval(spans, n, low, high)
    since = now
    for i in range(n + 1):
        end = spans[i, 0] if i < n else NEVER
        if end >= since + SLACK:
            j = ws.counts[STATES]
            ws.cell[j], ws.since[j], ws.end[j], ws.arrival[j], ws.parent[j] = cell, since, end, np.inf, -1
            ws.counts[STATES] += 1
        if i < n:
            since = max(since, spans[i, 1])


@bare_kernel
def _push(key: float, time: float, state: int, ws: SippMemory) -> None:
    """Push onto the heap, whose top has the least key and, among equals, the latest time."""
    key = np.rint(key / SLACK) * SLACK
    i = ws.counts[ENTRIES]
    ws.counts[ENTRIES] += 1
    while i > 0:
        up = (i - 1) >> 1
        if ws.heap_key[up] < key or (ws.heap_key[up] == key and ws.heap_time[up] >= time):
            break
        ws.heap_key[i], ws.heap_time[i], ws.heap_state[i] = ws.heap_key[up], ws.heap_time[up], ws.heap_state[up]
        i = up
    ws.heap_key[i], ws.heap_time[i], ws.heap_state[i] = key, time, state


@bare_kernel
def _pop(ws: SippMemory) -> None:
    """Remove the top of the heap."""
    ws.counts[ENTRIES] -= 1
    entries = ws.counts[ENTRIES]
    key, time, state = ws.heap_key[entries], ws.heap_time[entries], ws.heap_state[entries]
    i = 0
    while 2 * i + 1 < entries:
        down, right = 2 * i + 1, 2 * i + 2
        if right < entries and (
            ws.heap_key[right] < ws.heap_key[down]
            or (ws.heap_key[right] == ws.heap_key[down] and ws.heap_time[right] > ws.heap_time[down])
        ):
            down = right
        if key < ws.heap_key[down] or (key == ws.heap_key[down] and time >= ws.heap_time[down]):
            break
        ws.heap_key[i], ws.heap_time[i], ws.heap_state[i] = ws.heap_key[down], ws.heap_time[down], ws.heap_state[down]
        i = down
    ws.heap_key[i], ws.heap_time[i], ws.heap_state[i] = key, time, state


@kernel
def sipp_path(state: int, start: tuple[float, float], frame: Frame, ws: SippMemory) -> tuple[Floats, Floats]:
    """Return the path to `state` of the last query: t float64[N] s, strictly increasing, and xy float64[N, 2] m."""
    n, i = 1, state
    while i > 0:
        n, i = n + 2, ws.parent[i]
    t, xy = np.empty(n), np.empty((n, 2))
    i, k = state, n
    while True:
        x, y = start if i == 0 else _centre(frame, ws.cell[i])
        if k == n or t[k] > ws.arrival[i]:
            k -= 1
            t[k], xy[k, 0], xy[k, 1] = ws.arrival[i], x, y
        if i == 0:
            return t[k:], xy[k:]
        parent = ws.parent[i]
        if ws.depart[i] > ws.arrival[parent]:
            x, y = start if parent == 0 else _centre(frame, ws.cell[parent])
            k -= 1
            t[k], xy[k, 0], xy[k, 1] = ws.depart[i], x, y
        i = parent
