"""Lower bounds of the cost of answers of `order_stops` (with priorities: upper bounds of what they collect)."""

from __future__ import annotations

import numpy as np

from antway.kernels.colony.windows import assignment, shortest
from antway.tours.stops import Floats, Stops
from antway.tours.untimed import SAFE, closed_matrix, held_karp_bound, rounded_down


def quick_bound(stops: Stops) -> float:
    """Return a weak bound quickly: the sum of the shortest arcs into each stop; with priorities their sum."""
    if stops.priorities is not None:
        return float(stops.priorities.sum())
    steps = stops.matrix.copy()
    np.fill_diagonal(steps, np.inf)
    entered = steps.min(axis=0)
    entered[stops.start] = entered[stops.start] if stops.closed else 0.0
    travel = float(entered.sum()) * SAFE if np.isfinite(entered).all() else 0.0
    return travel if stops.objective == "travel time" else travel / stops.robots


def lower_bound(stops: Stops) -> float:
    """Return a lower bound of the cost of any feasible answer."""
    travel = travel_bound(stops)
    if stops.objective == "travel time":
        return travel
    far = shortest(stops.matrix)
    inner = stops.inner
    # Some robot goes to each stop and then to the end; and the work is divided among the robots, but for that at the ends.
    leaves = float(stops.windows[stops.start, 0])
    each = (
        np.maximum(leaves + stops.service[stops.start] + far[stops.start, inner], stops.windows[inner, 0])
        + stops.service[inner]
    )
    if stops.end is not None:
        home = 0.0 if stops.closed else float(stops.service[stops.end])
        each = each + far[inner, stops.end] + home
    shared = leaves + (travel + float(stops.service[inner].sum())) / stops.robots
    return max(float(each.max(initial=0.0)) * SAFE, shared + float(stops.service[stops.ends].sum()) * SAFE)


def travel_bound(stops: Stops) -> float:
    """Return a lower bound of the travel time of all robots together."""
    n, matrix = len(stops.matrix), stops.matrix
    if stops.robots > 1 or not np.isfinite(matrix).all():
        matrix = shortest(matrix)
    if n < 2 or not np.isfinite(matrix).all():
        return 0.0
    if n == 2:
        there, back = matrix[stops.start, 1 - stops.start], matrix[1 - stops.start, stops.start]
        return float(there + (back if stops.closed else 0.0)) * SAFE
    if stops.robots > 1 and not stops.closed:
        # Routes with a common start form a tree; a given end is ignored.
        return _tree(np.minimum(matrix, matrix.T)) * SAFE
    if np.array_equal(matrix, matrix.T):
        return held_karp_bound(*closed_matrix(stops, matrix)[:2])
    path = matrix.copy()
    np.fill_diagonal(path, np.inf)
    rows, columns = np.arange(n), np.arange(n)
    if not stops.closed:
        columns = columns[columns != stops.start]
        if stops.end is None:
            path = np.column_stack((path, np.zeros(n)))
            columns = np.append(columns, n)
        else:
            rows = rows[rows != stops.end]
    leave, enter = assignment(np.ascontiguousarray(path[np.ix_(rows, columns)]))
    return rounded_down(float(leave.sum() + enter.sum()), matrix)


def worth_bound(stops: Stops) -> float:
    """Return the sum of the priorities of all stops that a robot can visit in time if it visits no other."""
    assert stops.priorities is not None
    far, windows, start = shortest(stops.matrix), stops.windows, stops.start
    first = np.maximum(windows[start, 0] + stops.service[start] + far[start], windows[:, 0])
    done = first + stops.service
    if stops.end is not None and stops.end != start:
        done = done + far[:, stops.end] + stops.service[stops.end]
    elif stops.closed:
        done = done + far[:, start]
    latest, over = windows[:, 1] + 1e-9 * (1.0 + windows[:, 1]), stops.deadline + 1e-9 * (1.0 + stops.deadline)
    possible = (first <= latest) & (done <= over) & np.isfinite(done)
    possible[stops.ends] = True
    return float(stops.priorities[possible].sum())


def _tree(matrix: Floats) -> float:
    """Return the length of the minimum spanning tree."""
    nearest, used, total = matrix[0].copy(), np.zeros(len(matrix), dtype=bool), 0.0
    used[0] = True
    for _ in range(len(matrix) - 1):
        then = int(np.argmin(np.where(used, np.inf, nearest)))
        used[then] = True
        total += float(nearest[then])
        nearest = np.minimum(nearest, matrix[then])
    return total
