"""Fields over the map that a rollout looks up: the distance to walls, and the time to the goal, extended into walls.

For cars, the time to the goal depends on the heading as well, because the turning radius limits where a car can go.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.jit import inner_kernel, kernel
from antway.kernels.controls.lookup import clearance
from antway.kernels.controls.motion import MotionState
from antway.kernels.controls.problem import StaticField

_SETTLED = 0.05  # s; the iteration of a car's times ends when no time changes by more than this
_STEP = 1.4  # cells; length of a car's straight step, which ends nearest to one of the neighbouring cells
_STUCK = 60.0  # s; a car's time exceeds that of a robot that turns on the spot by at most this
_SIDES = 3.0  # cells; times on two sides of one wall cell differ by at most the time for this distance, which leads around it


@kernel
def wall_distance(blocked: Bools, resolution: float, factor: int) -> NDArray[np.float32]:
    """Return the exact distance from each node of a lattice to the nearest blocked cell (closed square) or map edge, m.

    The lattice has `factor` nodes along the edge of a cell, and its first node is at the corner of the map. The point of a
    square nearest to a node is itself a node, so the distance transform over nodes is exact (Felzenszwalb and Huttenlocher,
    Theory of Computing 2012).
    """
    rows, cols = blocked.shape[0] * factor + 1, blocked.shape[1] * factor + 1
    far = float(rows + cols) ** 2
    square = np.full((rows, cols), far)
    square[0, :] = square[-1, :] = 0.0
    square[:, 0] = square[:, -1] = 0.0
    for i in range(blocked.shape[0]):
        for j in range(blocked.shape[1]):
            if blocked[i, j]:
                square[i * factor : (i + 1) * factor + 1, j * factor : (j + 1) * factor + 1] = 0.0
    n = max(rows, cols)
    at, value = np.empty(n, np.int64), np.empty(n)
    edge = np.empty(n + 1)
    for i in range(rows):
        _envelope(square[i], at, value, edge)
    for j in range(cols):
        _envelope(square[:, j], at, value, edge)
    return (np.sqrt(square) * (resolution / factor)).astype(np.float32)


@kernel
def _envelope(line: Floats, at: Ints, value: Floats, edge: Floats) -> None:
    """Replace f(q) by the minimum over p of (p - q)^2 + f(p), the lower envelope of parabolas."""
    n = len(line)
    k = 0
    at[0], edge[0], edge[1] = 0, -np.inf, np.inf
    for q in range(1, n):
        value[q] = 0.0
        while True:
            p = at[k]
            cut = ((line[q] + q * q) - (line[p] + p * p)) / (2.0 * (q - p))
            if cut > edge[k]:
                break
            k -= 1
        k += 1
        at[k], edge[k], edge[k + 1] = q, cut, np.inf
    k = 0
    for q in range(n):
        value[q] = line[q]
    for q in range(n):
        while edge[k + 1] < q:
            k += 1
        line[q] = (q - at[k]) ** 2 + value[at[k]]


@kernel
def beyond_walls(field: Floats, step: float, layers: int) -> NDArray[np.float32]:
    """Extend a field of times into walls, where it is infinite, by `step` s a cell, so that it can be interpolated near them.

    The extensions from the two sides of a thin wall may meet with very different times. There the later side is extended,
    because the field would otherwise lead through the wall, and a robot would stand in front of it forever.
    """
    rows, cols = field.shape
    out = field.copy()
    top = 0.0
    for i in range(rows):
        for j in range(cols):
            if math.isfinite(field[i, j]):
                top = max(top, field[i, j])
    for _ in range(layers):
        before = out.copy()
        for i in range(rows):
            for j in range(cols):
                if math.isinf(before[i, j]):
                    out[i, j] = _beside(before, i, j, step)
    for i in range(rows):
        for j in range(cols):
            if math.isinf(out[i, j]):
                out[i, j] = top + layers * step
    return out.astype(np.float32)


@inner_kernel
def _beside(times: Floats, i: int, j: int, step: float) -> float:
    """Return the time of cell (i, j) in a wall by its neighbours, `step` s a cell; infinite if none of them has a time."""
    low, high = math.inf, -math.inf
    for r in range(max(i - 1, 0), min(i + 2, times.shape[0])):
        for c in range(max(j - 1, 0), min(j + 2, times.shape[1])):
            if math.isfinite(times[r, c]):
                low, high = min(low, times[r, c] + step * math.hypot(r - i, c - j)), max(high, times[r, c])
    return low if high <= low + _SIDES * step else high + step


@kernel
def fitting_poses(field: StaticField, frame: Floats, headings: int, rows: int, cols: int, slack: float) -> Bools:
    """Tell of each heading and cell whether the robot's body is in no wall by more than `slack` m, bool[headings, rows, cols].

    `frame` is that of the cells' centres, as in `StaticField`, and heading k is 2 pi k / headings, rad.
    """
    fits = np.empty((headings, rows, cols), np.bool_)
    for k in range(headings):
        cos, sin = math.cos(2.0 * math.pi * k / headings), math.sin(2.0 * math.pi * k / headings)
        for r in range(rows):
            for c in range(cols):
                at = MotionState(frame[0] + c / frame[2], frame[1] + r / frame[2], cos, sin, 0.0, 0.0)
                fits[k, r, c] = clearance(field, at, 0.0) >= -slack
    return fits


@kernel
def turning_times(
    times: Floats, fits: Bools, size: float, radius: float, turn_rate: float, v_max: float, v_reverse: float, sweeps: int
) -> Floats:
    """Return the time to the goal from each cell and heading for a car that goes straight or turns at its turning radius, s.

    `times`, float64[H, W], are those of a robot that turns in no time, infinite where its centre cannot be, and 0 at the goal.
    `fits`, bool[headings, H, W], tells whether the robot's body has room in each cell and heading, if its centre has; heading k
    is 2 pi k / headings, rad. `size` and `radius` are the edge of a cell and the turning radius, m, `turn_rate` is the limit of
    the turn rate, rad/s, and `v_max` and `v_reverse`, which may be 0, are the top speeds ahead and in reverse, m/s. If more
    than `sweeps` iterations over all poses would be needed, the times of some poses are too short. The result,
    float64[headings, H, W], is at most 60 s more than `times`. Poses without a path to the goal have that value; a car without
    reverse in front of a wall is an example, and so is one in front of a gap whose turns are finer than the cells. It is
    infinite where the body has no room.

    Value iteration from `times`, a lower bound for a car: t(pose) is the minimum over the steps of the step's duration plus t
    at its end, interpolated between cells. An arc turns from one heading to the next, and a straight step is 1.4 cells long.
    Nearer to the goal than that, the heading does not matter.
    """
    headings, rows, cols = fits.shape
    by_heading = np.where(fits, times, np.inf)
    steps = _steps_of_car(headings, size, radius, turn_rate, v_max, v_reverse)
    may = np.zeros((headings, 6, rows, cols), np.bool_)  # whether a step crosses only free cells
    for k in range(headings):
        for n in range(6):
            if steps[k, n, 3] < math.inf:
                for r in range(rows):
                    for c in range(cols):
                        may[k, n, r, c] = by_heading[k, r, c] < math.inf and _leads_over_free(by_heading, k, r, c, steps[k, n])
    arrives = times * v_max <= _STEP * size
    leads_there = _leads_there(arrives, may, steps)
    by_heading = np.where(leads_there, by_heading, by_heading + _STUCK)
    sweep, change = 0, math.inf
    while change > _SETTLED and sweep < sweeps:
        change = 0.0
        for i in range(headings):
            k = i if sweep % 2 == 0 else headings - 1 - i
            for m in range(rows):
                r = m if sweep & 2 else rows - 1 - m
                for n in range(cols):
                    c = n if sweep & 4 else cols - 1 - n
                    if arrives[r, c] or not leads_there[k, r, c]:
                        continue
                    best = times[r, c] + _STUCK
                    for j in range(6):
                        if may[k, j, r, c]:
                            taken = steps[k, j]
                            best = min(best, taken[3] + _between(by_heading[int(taken[0])], r + taken[1], c + taken[2]))
                    change = max(change, abs(best - by_heading[k, r, c]))
                    by_heading[k, r, c] = best
        sweep += 1
    return by_heading


@kernel
def _leads_there(arrives: Bools, may: Bools, steps: Floats) -> Bools:
    """Tell from which poses steps lead to a cell of `arrives`, bool[H, W], bool[headings, H, W].

    `may`, bool[headings, 6, H, W], tells which steps may be taken, and `steps` are those of `_steps_of_car`. The
    poses are found backwards from these cells. A step ends between four cells, and counts as leading to each of them.
    """
    headings, (rows, cols) = len(steps), arrives.shape
    found = np.zeros((headings, rows, cols), np.bool_)
    stack = np.empty((found.size, 3), np.int64)
    n = 0
    for k in range(headings):
        for r in range(rows):
            for c in range(cols):
                if arrives[r, c]:
                    found[k, r, c] = True
                    stack[n] = k, r, c
                    n += 1
    while n > 0:
        n -= 1
        to, row, col = stack[n]
        for j in range(6):
            k = (to - (j // 2 - 1)) % headings
            down, right = steps[k, j, 1], steps[k, j, 2]
            for a in range(2 if down % 1.0 > 0.0 else 1):
                for b in range(2 if right % 1.0 > 0.0 else 1):
                    r, c = row - math.floor(down) - a, col - math.floor(right) - b
                    if 0 <= r < rows and 0 <= c < cols and may[k, j, r, c] and not found[k, r, c]:
                        found[k, r, c] = True
                        stack[n] = k, r, c
                        n += 1
    return found


@kernel
def _steps_of_car(headings: int, size: float, radius: float, turn_rate: float, v_max: float, v_reverse: float) -> Floats:
    """Return the steps of a car in each heading, float64[headings, 6, 4]: next heading, rows, columns, and duration in s.

    They lead right, straight and left, each forward and in reverse; the parameters are those of `turning_times`.
    """
    steps, turn = np.empty((headings, 6, 4)), 2.0 * math.pi / headings
    for k in range(headings):
        for n in range(6):
            back, side = n % 2 == 1, n // 2 - 1
            far = (2.0 * radius * math.sin(0.5 * turn) / size if side else _STEP) * (-1.0 if back else 1.0)
            angle = (k + 0.5 * side) * turn
            speed = v_reverse if back else v_max
            length = max(radius, speed / turn_rate) * turn if side else _STEP * size  # m; driven at full speed in that time
            took = length / speed if speed > 0.0 else math.inf
            steps[k, n] = float((k + side) % headings), far * math.sin(angle), far * math.cos(angle), took
    return steps


@inner_kernel
def _leads_over_free(times: Floats, k: int, r: int, c: int, step: Floats) -> bool:
    """Tell whether a step from a cell in heading k crosses only poses with a time, tested once in a cell.

    Its first half is tested in heading k, and its second half in the heading at its end.
    """
    rows, cols = step[1], step[2]
    if not (0.0 <= r + rows <= times.shape[1] - 1.0 and 0.0 <= c + cols <= times.shape[2] - 1.0):
        return False
    looks = math.ceil(math.hypot(rows, cols))
    for i in range(1, looks + 1):
        heading = k if 2 * i < looks else int(step[0])
        if math.isinf(times[heading, int(r + rows * i / looks + 0.5), int(c + cols * i / looks + 0.5)]):
            return False
    return True


@inner_kernel
def _between(times: Floats, y: float, x: float) -> float:
    """Return the time at row y and column x, interpolated between those of four cells that are free; the nearest is."""
    i, j = min(int(y), times.shape[0] - 2), min(int(x), times.shape[1] - 2)
    u, w, total, weight = y - i, x - j, 0.0, 0.0
    for a in range(2):
        for b in range(2):
            time, share = times[i + a, j + b], (u if a else 1.0 - u) * (w if b else 1.0 - w)
            if time < math.inf:
                total, weight = total + share * time, weight + share
    return total / weight
