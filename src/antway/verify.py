"""Independent checks of answers: this file shares no code with any planner and knows the rules from their definitions alone."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from antway.errors import InvalidPlan
from antway.grid import Cell, Grid, Moves
from antway.planning import Plan, Problem, Status

_REACH = {
    Moves.FOUR: 1,
    Moves.EIGHT: 1,
    Moves.EIGHT_NOSQUEEZE: 1,
    Moves.EIGHT_CUT: 1,
    Moves.SIXTEEN: 2,
    Moves.THIRTY_TWO: 3,
}

_EPS = 1e-9  # cells; far below any gap on the lattice of cell centres and corners


def check_plan(problem: Problem, plan: Plan) -> None:
    """Raise `InvalidPlan` with every way in which `plan` is no legal answer to `problem`.

    Parameters
    ----------
    problem : Problem
    plan : Plan

    Raises
    ------
    InvalidPlan
        If the plan claims what it does not have, leaves the map, enters a blocked cell, jumps, cuts a corner that the moves
        forbid, begins or ends elsewhere, or states a length or bound that its own cells contradict. An any-angle plan (one with
        `points`) may touch blocked cells but not run between two, neither along their border nor where they touch diagonally;
        its `cells` are free neighbours from start to goal whose closed squares the polyline meets in this order.

    Examples
    --------
    >>> problem = Problem(Grid(np.zeros((2, 2), dtype=bool)), (0, 0), (1, 1))
    >>> check_plan(problem, Plan(Status.FOUND, np.array([[0, 0], [1, 1]], dtype=np.int32), math.sqrt(2)))
    """
    faults = _faults(problem, plan)
    if faults:
        raise InvalidPlan(faults)


def _faults(problem: Problem, plan: Plan) -> list[str]:
    cells = plan.cells
    if not isinstance(cells, np.ndarray) or cells.ndim != 2 or cells.shape[1] != 2 or cells.dtype != np.int32:
        return ["cells are not an int32[N, 2] array"]
    faults = _number_faults(plan)
    if len(cells) == 0:
        if plan.status is Status.FOUND:
            faults.append("FOUND without cells")
        if plan.length != math.inf or plan.points is not None or plan.optimal:
            faults.append("a plan without cells must have infinite length, no points and not be optimal")
        return faults
    if plan.status is Status.NO_PATH:
        faults.append("NO_PATH with cells")
    path: list[Cell] = [(int(r), int(c)) for r, c in cells]
    if path[0] != problem.start:
        faults.append(f"begins at {path[0]}, not at the start {problem.start}")
    if path[-1] != problem.goal:
        faults.append(f"ends at {path[-1]}, not at the goal {problem.goal}")
    faults += [f"cell {i} {cell} is blocked or off the map" for i, cell in enumerate(path) if not _free(problem.grid, cell)]
    if plan.points is None:
        faults += [
            f"move {i} from {a} to {b} {why}"
            for i, (a, b) in enumerate(pairwise(path))
            if (why := _move_fault(problem.grid, problem.moves, a, b))
        ]
        length = math.fsum(math.hypot(b[0] - a[0], b[1] - a[1]) for a, b in pairwise(path))
    else:
        points = plan.points
        if points.ndim != 2 or points.shape[1] != 2 or len(points) == 0 or not np.isfinite(points).all():
            return [*faults, "points are not a finite float64[M, 2] array"]
        if tuple(points[0]) != problem.start or tuple(points[-1]) != problem.goal:
            faults.append("points do not run from start to goal")
        faults += [
            f"segment {i} from {tuple(a)} to {tuple(b)} {why}"
            for i, (a, b) in enumerate(pairwise(points.tolist()))
            if (why := _segment_fault(problem.grid, a, b))
        ]
        faults += [
            f"cells {i} {a} and {b} are no neighbours or touch between two blocked cells"
            for i, (a, b) in enumerate(pairwise(path))
            if _move_fault(problem.grid, Moves.EIGHT_NOSQUEEZE, a, b)
        ]
        faults += _order_faults(points.tolist(), path)
        length = math.fsum(math.dist(a, b) for a, b in pairwise(points.tolist()))
    if not math.isclose(plan.length, length * problem.grid.resolution, rel_tol=1e-9, abs_tol=1e-12):
        faults.append(f"states a length of {plan.length!r} m but has {length * problem.grid.resolution!r} m")
    return faults


def _number_faults(plan: Plan) -> list[str]:
    faults = []
    if math.isnan(plan.length) or plan.length < 0:
        faults.append(f"length {plan.length!r} is not a length")
    if math.isnan(plan.lower_bound) or plan.lower_bound < 0 or plan.lower_bound > plan.length * (1 + 1e-9):
        faults.append(f"lower bound {plan.lower_bound!r} is above the length {plan.length!r} or no length")
    if plan.optimal and not math.isclose(plan.lower_bound, plan.length, rel_tol=1e-9, abs_tol=1e-12):
        faults.append("claims to be optimal but its lower bound is below its length")
    if not isinstance(plan.expanded, int) or plan.expanded < 0 or not plan.elapsed >= 0:
        faults.append("expanded and elapsed must not be negative")
    return faults


def _free(grid: Grid, cell: Cell) -> bool:
    rows, cols = grid.blocked.shape
    return 0 <= cell[0] < rows and 0 <= cell[1] < cols and not bool(grid.blocked[cell])


def _move_fault(grid: Grid, moves: Moves, a: Cell, b: Cell) -> str:
    """Say why the step from `a` to `b` is not legal under `moves`; empty if it is."""
    dr, dc = b[0] - a[0], b[1] - a[1]
    reach = max(abs(dr), abs(dc))
    if reach == 0:
        return "stays in place"
    if reach > _REACH[moves] or (moves is Moves.FOUR and dr and dc) or math.gcd(dr, dc) != 1:
        return "is no such move"
    if reach == 1:
        sides = [_free(grid, (a[0] + dr, a[1])), _free(grid, (a[0], a[1] + dc))] if dr and dc else []
        if moves is Moves.EIGHT_CUT:
            return ""
        if moves is Moves.EIGHT_NOSQUEEZE:
            return "" if not sides or any(sides) else "squeezes between two blocked cells"
        return "" if all(sides) else "cuts a corner"
    touched = (
        (r, c)
        for r in range(min(a[0], b[0]), max(a[0], b[0]) + 1)
        for c in range(min(a[1], b[1]), max(a[1], b[1]) + 1)
        if _meets(a, b, r, c)
    )
    return next((f"touches the blocked cell {cell}" for cell in touched if not _free(grid, cell)), "")


def _segment_fault(grid: Grid, a: Sequence[float], b: Sequence[float]) -> str:
    """Say why a point may not go along the segment; empty if it may.

    What is blocked (cells, and all beyond the map) may be touched from outside, but the border between two blocked cells is
    inside, and a point where two blocked cells touch diagonally between two free ones must not be touched at all.
    """
    gap = 2 * _EPS
    for r, c in _near(a, b):
        free, below, beside, across = (_free(grid, (r + i, c + j)) for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)))
        for tall, wide in ((0, 0), (1, 0), (0, 1)):
            if free or (tall and below) or (wide and beside):
                continue
            first, last = _inside(a, b, (r - 0.5 + _EPS, c - 0.5 + _EPS), (r + tall + 0.5 - _EPS, c + wide + 0.5 - _EPS))
            if first < last:
                two = f" or runs between it and {(r + tall, c + wide)}" if tall or wide else ""
                return f"enters {(r, c)}, blocked or off the map{two}"
        corner = (r + 0.5, c + 0.5)
        if free == across != below == beside:
            first, last = _inside(a, b, (corner[0] - gap, corner[1] - gap), (corner[0] + gap, corner[1] + gap))
            if first < last:
                return f"passes {corner}, where two blocked cells touch diagonally"
    return ""


def _meets(a: Cell, b: Cell, r: int, c: int) -> bool:
    """Tell whether the segment touches the closed square of cell (r, c)."""
    reach = 0.5 + _EPS
    first, last = _inside(a, b, (r - reach, c - reach), (r + reach, c + reach))
    return first < last


def _near(a: Sequence[float], b: Sequence[float]) -> Iterator[Cell]:
    """Yield the cells within a cell of the segment, row by row (and a few more)."""
    for r in range(math.floor(min(a[0], b[0])) - 1, math.ceil(max(a[0], b[0])) + 2):
        first, last = _inside(a, b, (r - 1.6, -math.inf), (r + 1.6, math.inf))
        if first <= last:
            ends = [a[1] + t * (b[1] - a[1]) for t in (first, last)]
            yield from ((r, c) for c in range(math.floor(min(ends)) - 1, math.ceil(max(ends)) + 2))


def _order_faults(points: list[list[float]], path: list[Cell]) -> list[str]:
    """Say which cell the polyline does not meet, in their order along it; the earliest meeting will do for each."""
    i, t, reach = 0, 0.0, 0.5 + _EPS
    for k, (r, c) in enumerate(path):
        while True:
            if i >= max(len(points) - 1, 1):
                return [f"cell {k} {(r, c)} is not met in its turn by the points"]
            end = points[min(i + 1, len(points) - 1)]
            first, last = _inside(points[i], end, (r - reach, c - reach), (r + reach, c + reach))
            if max(first, t) <= last:
                t = max(first, t)
                break
            i, t = i + 1, 0.0
    return []


def _inside(a: Sequence[float], b: Sequence[float], low: tuple[float, float], high: tuple[float, float]) -> tuple[float, float]:
    """Return from where to where the segment is in the open box, as shares of its length; nowhere if first >= last."""
    first, last = 0.0, 1.0
    for p, q, least, most in zip(a, b, low, high):
        d = q - p
        if d == 0:
            if not least < p < most:
                return 1.0, 0.0
            continue
        enter, leave = (least - p) / d, (most - p) / d
        first, last = max(first, min(enter, leave)), min(last, max(enter, leave))
    return first, last
