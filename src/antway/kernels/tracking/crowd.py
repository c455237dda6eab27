"""Prediction of people who avoid one another: learn the goal of each person, then simulate all of them with ORCA.

A person who avoids others takes the allowed velocity nearest to the preferred one (kernels/tracking/orca.py). Conversely, the
preferred velocity is the velocity taken plus a sum of the outward normals of the lines on which it lies. The length of the
preferred velocity is known. If the velocity lies on at most one line, the preferred velocity is therefore known exactly; else
it lies in an arc. Bearings of the preferred velocity from several places determine the goal. The prediction is used only if
its recent errors were smaller than those of constant velocity.
"""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Bools, Floats, Ints
from antway.kernels.base.geometry import wrap_below_pi
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row
from antway.kernels.tracking.orca import beyond, half_plane, least_violation, nearest
from antway.kernels.tracking.predict import FAR_AHEAD, ID, RADIUS, STEP_TIME, VX, VY, X, Y
from antway.kernels.tracking.table import Table, row_of

# Columns of a row after those of a track estimate: the time of the estimate, the goal, the information matrix of the goal, the
# next velocity as predicted, and the summed squared errors of constant velocity and of this prediction.
_SEEN, _GX, _GY, _A11, _A12, _A22, _PX, _PY, _CONSTANT_ERROR, _ORCA_ERROR = range(8, 18)
COLUMNS = 18  # of a row
STEPS = 36  # number of steps of a predicted trajectory
_HORIZON = 5.0  # s; people avoid contacts within this time
_SKIN = 0.01  # m; each person keeps this distance around itself
_NEAR = 10.0  # m; people farther apart than this do not avoid one another
_MOST = 32  # a larger crowd is predicted by constant velocity alone, because this prediction would take too long
_EASE = 1.0  # s; a person slows down when the goal is nearer than the distance walked in this time
_AHEAD = 10.0  # m; the goal is assumed this far ahead when only a bearing is known
_DOUBT = 0.2  # 1; relative standard deviation of that assumed distance
_SURE = 0.01  # rad; standard deviation of a bearing that is known exactly
_ON = 0.005  # m/s; a velocity this near to a line lies on it
_EXACT = 4  # number of first steps of a predicted trajectory that are not straightened
_DEVIATION = 0.01  # m; straightening moves a person no farther than this from the predicted place
_FAR_STEP = round(FAR_AHEAD / STEP_TIME)  # the clearance radius shrinks at this step, so no straight stretch crosses it
_BETTER = 0.8  # 1; the prediction is used if its squared errors are below this share of those of constant velocity
_DECAY = 0.8  # 1; share of the sum of squared errors that is left after each scan


@bare_kernel
def _lines(rows: Floats, step: float, lines: Floats, count: Ints) -> None:
    """Write the lines that restrict the velocity of each person k among all of `rows` to lines[k, : count[k]].

    The lines of two people are symmetric, so each pair is computed once. A contact is to end within `step` s.
    """
    count[:] = 0
    for k in range(len(rows)):
        for j in range(k + 1, len(rows)):
            ax, ay = rows[j, X] - rows[k, X], rows[j, Y] - rows[k, Y]
            if ax * ax + ay * ay > _NEAR * _NEAR:
                continue
            ux, uy = rows[k, VX] - rows[j, VX], rows[k, VY] - rows[j, VY]
            contact_radius = rows[k, RADIUS] + rows[j, RADIUS] + 2 * _SKIN
            x, y, dx, dy = half_plane(ax, ay, ux, uy, contact_radius, _HORIZON, step)
            n, m = count[k], count[j]
            lines[k, n, 0], lines[k, n, 1], lines[k, n, 2], lines[k, n, 3] = rows[k, VX] + x, rows[k, VY] + y, dx, dy
            lines[j, m, 0], lines[j, m, 1], lines[j, m, 2], lines[j, m, 3] = rows[j, VX] - x, rows[j, VY] - y, -dx, -dy
            count[k], count[j] = n + 1, m + 1


@bare_kernel
def _learn_goal(row: Floats, vx: float, vy: float, preferred_speed: float, lines: Floats, n: int) -> None:
    """Update the goal of a person at `row` that took the velocity (vx, vy) under lines[:n]."""
    speed, own, active, low, high = math.hypot(vx, vy), math.atan2(vy, vx), 0, 0.0, 0.0
    for i in range(n):
        violation = beyond(lines, i, vx, vy)
        if violation > _ON:
            return  # the velocity is not allowed, so it tells nothing about the preferred one
        if violation > -_ON:
            nx, ny = lines[i, 3], -lines[i, 2]
            along = vx * nx + vy * ny
            root = along * along - speed * speed + preferred_speed * preferred_speed
            more = max(math.sqrt(root) - along, 0.0) if root > 0.0 else 0.0
            turn = wrap_below_pi(math.atan2(vy + more * ny, vx + more * nx) - own)
            low, high = (min(low, turn), max(high, turn)) if active else (turn, turn)
            active += 1
    if active and speed > preferred_speed - 0.001:  # at full speed the preferred velocity may lie anywhere in the arc
        low, high = min(low, 0.0), max(high, 0.0)
    information, gx, gy = row[_A11] + row[_A22], row[_GX], row[_GY]
    if not active and speed < preferred_speed - 0.01:  # a slow person on no line is arriving at its goal
        row[_GX], row[_GY] = row[X] + _EASE * vx, row[Y] + _EASE * vy
        row[_A11] = row[_A22] = 1.0 / (10 * _SURE) ** 2
        row[_A12] = 0.0
        return
    if speed < 0.1 or (information == 0.0 and high - low > 1.0):
        return
    far, across, along = _AHEAD, _SURE, 0.0
    if information == 0.0:
        bearing, across, along = own + 0.5 * (low + high), math.hypot(_SURE, (high - low) / math.sqrt(12.0)), _DOUBT
    else:
        far = max(math.hypot(gx - row[X], gy - row[Y]), 1.0)
        turn = wrap_below_pi(math.atan2(gy - row[Y], gx - row[X]) - own)
        if low + _SURE < turn < high - _SURE:
            return  # the observation agrees with the goal
        bearing = own + min(max(turn, low), high)
    dx, dy = math.cos(bearing), math.sin(bearing)
    if information > 0.0 and high - low > 2 * _SURE:
        # Move the goal to its likeliest place at the end of the arc, and keep the information.
        qx, qy = -row[_A22] * dy - row[_A12] * dx, row[_A12] * dy + row[_A11] * dx
        shift = (dx * (gy - row[Y]) - dy * (gx - row[X])) / (dx * qy - dy * qx)
        row[_GX], row[_GY] = gx - qx * shift, gy - qy * shift
        return
    p, q = 1.0 / (across * far) ** 2, 1.0 / (along * far) ** 2 if along > 0.0 else 0.0
    px, py = row[X] + (far * dx if along > 0.0 else 0.0), row[Y] + (far * dy if along > 0.0 else 0.0)
    m11, m12, m22 = p * dy * dy + q * dx * dx, (q - p) * dx * dy, p * dx * dx + q * dy * dy
    bx = row[_A11] * gx + row[_A12] * gy + m11 * px + m12 * py
    by = row[_A12] * gx + row[_A22] * gy + m12 * px + m22 * py
    row[_A11], row[_A12], row[_A22] = row[_A11] + m11, row[_A12] + m12, row[_A22] + m22
    det = row[_A11] * row[_A22] - row[_A12] * row[_A12]
    row[_GX], row[_GY] = (row[_A22] * bx - row[_A12] * by) / det, (row[_A11] * by - row[_A12] * bx) / det


@bare_kernel
def straighten(prediction: Floats, first: int, last: int) -> None:
    """Replace runs of steps in [first, last) by their mean velocity where that moves the person by at most _DEVIATION m.

    Steps with one velocity become one motion segment (kernels/tracking/predict.py), which makes planning faster.
    """
    while first < last:
        until = first + 1
        while until < last:
            mx, my = 0.0, 0.0
            for s in range(first, until + 1):
                mx, my = mx + prediction[s, 0], my + prediction[s, 1]
            mx, my = mx / (until + 1 - first), my / (until + 1 - first)
            dx, dy, deviation = 0.0, 0.0, 0.0
            for s in range(first, until):
                dx, dy = dx + (prediction[s, 0] - mx) * STEP_TIME, dy + (prediction[s, 1] - my) * STEP_TIME
                deviation = max(deviation, math.hypot(dx, dy))
            if deviation > _DEVIATION:
                break
            until += 1
        mx, my = 0.0, 0.0
        for s in range(first, until):
            mx, my = mx + prediction[s, 0], my + prediction[s, 1]
        for s in range(first, until):
            prediction[s, 0], prediction[s, 1] = mx / (until - first), my / (until - first)
        first = until


@kernel
def foresee(table: Table, estimates: Floats, seen: Bools, t: float, preferred_speed: float, prediction: Floats) -> None:
    """Update the rows with one scan, and predict.

    `table` has the people known so far, [M, COLUMNS] with ids in ID: one row for each of the `estimates`, float64[K, 8]
    (kernels/tracking/predict.py), in the same order, and none for a crowd of more than _MOST. From a track that is not `seen`,
    bool[K], in this scan nothing is learnt. People walk at `preferred_speed` m/s if nothing is near. `prediction`,
    float64[N, STEPS, 2], is filled with each person's velocity in steps of STEP_TIME s from `t` on, m/s. NaN in the first step
    means that the track is not predicted here.
    """
    rows, n = table.rows, len(estimates)
    prediction[:n, 0, 0] = math.nan
    if n > _MOST:
        table.used[0] = 0
        return
    most = max(n, table.used[0])
    lines, line_count = np.empty((most, most, 4)), np.empty(most, np.int64)
    people, work, out = np.zeros((n, COLUMNS)), np.empty((n, 4)), np.empty(2)
    _update(table, estimates, seen, t, preferred_speed, lines, line_count, people)
    for k in range(n):
        copy_row(people[k], rows[k])
    table.used[0] = n
    avoiding = people[:, _ORCA_ERROR].sum() < _BETTER * people[:, _CONSTANT_ERROR].sum()
    after = people.copy()
    for s in range(STEPS if avoiding else 1):
        _lines(people, STEP_TIME, lines, line_count)
        for k in range(n):
            _avoid(people[k], preferred_speed, lines[k], line_count[k], out, work)
            if s == 0:
                rows[k, _PX], rows[k, _PY] = out[0], out[1]
            if avoiding:
                prediction[k, s, 0], prediction[k, s, 1] = out[0], out[1]
                after[k, VX], after[k, VY] = out[0], out[1]
                after[k, X], after[k, Y] = people[k, X] + out[0] * STEP_TIME, people[k, Y] + out[1] * STEP_TIME
        people, after = after, people
    if avoiding:
        for k in range(n):
            straighten(prediction[k], _EXACT, _FAR_STEP)
            straighten(prediction[k], _FAR_STEP, STEPS)


@bare_kernel
def _update(
    table: Table,
    estimates: Floats,
    seen: Bools,
    t: float,
    preferred_speed: float,
    lines: Floats,
    line_count: Ints,
    out: Floats,
) -> None:
    """Write to `out` the rows of the people of one scan, updated from those before it; `lines` and `line_count` are scratch."""
    known = table.rows[: table.used[0]]
    dt = t - known[0, _SEEN] if len(known) > 0 else 0.0  # all are as old as the scan before
    if dt > 0.0:
        _lines(known, max(dt, 0.01), lines, line_count)
    for k in range(len(estimates)):
        row = out[k]
        before = row_of(table, estimates[k, ID])
        if before >= 0:
            copy_row(known[before], row)
            if dt > 0.0 and seen[k]:
                vx, vy = estimates[k, VX], estimates[k, VY]
                if row[_A11] + row[_A22] > 0.0:  # only predictions with a known goal are compared
                    row[_CONSTANT_ERROR] = _DECAY * row[_CONSTANT_ERROR] + (vx - row[VX]) ** 2 + (vy - row[VY]) ** 2
                    row[_ORCA_ERROR] = _DECAY * row[_ORCA_ERROR] + (vx - row[_PX]) ** 2 + (vy - row[_PY]) ** 2
                _learn_goal(row, vx, vy, preferred_speed, lines[before], line_count[before])
        copy_row(estimates[k], row[:8])
        row[_SEEN] = t


@bare_kernel
def _avoid(person: Floats, preferred_speed: float, lines: Floats, n: int, out: Floats, work: Floats) -> None:
    """Write to `out` the velocity that a person on the path to its goal takes under lines[:n].

    Without a known goal the person keeps its direction. `work` is scratch, float64[n, 4].
    """
    vx, vy = person[VX], person[VY]
    speed = max(math.hypot(vx, vy), 1e-9)
    known = person[_A11] + person[_A22] > 0.0
    wx, wy = (person[_GX] - person[X], person[_GY] - person[Y]) if known else (vx / speed * 9.0, vy / speed * 9.0)
    scale = preferred_speed / max(math.hypot(wx, wy), _EASE)
    infeasible = nearest(lines, n, preferred_speed, wx * scale, wy * scale, False, out)
    if infeasible < n:
        least_violation(lines, n, infeasible, preferred_speed, out, work)
