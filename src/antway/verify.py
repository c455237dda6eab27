"""Independent checks of answers: this file shares no code with any planner and knows the rules from their definitions alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
        forbid, begins or ends elsewhere, or states a length or bound that its own cells contradict.

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
            f"segment {i} from {tuple(a)} to {tuple(b)} passes through a blocked cell or leaves the map"
            for i, (a, b) in enumerate(zip(points.tolist(), points[1:].tolist()))
            if not _segment_free(problem.grid, a, b)
        ]
        length = math.fsum(math.dist(a, b) for a, b in zip(points.tolist(), points[1:].tolist()))
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
        if _meets(a, b, r, c, 1e-9)
    )
    return next((f"touches the blocked cell {cell}" for cell in touched if not _free(grid, cell)), "")


def _segment_free(grid: Grid, a: Sequence[float], b: Sequence[float]) -> bool:
    """Tell whether the segment keeps on the map and out of the open squares of blocked cells (corners may be touched)."""
    rows, cols = grid.blocked.shape
    for p in (a, b):
        if not (-0.5 <= p[0] <= rows - 0.5 and -0.5 <= p[1] <= cols - 0.5):
            return False
    low = [math.floor(min(a[k], b[k]) + 0.5) for k in (0, 1)]
    high = [math.ceil(max(a[k], b[k]) - 0.5) for k in (0, 1)]
    for r in range(max(low[0], 0), min(high[0], rows - 1) + 1):
        for c in range(max(low[1], 0), min(high[1], cols - 1) + 1):
            if grid.blocked[r, c] and _meets(a, b, r, c, -1e-9):
                return False
    return True


def _meets(a: Sequence[float], b: Sequence[float], r: int, c: int, grow: float) -> bool:
    """Tell whether the segment enters the open square of cell (r, c) grown by `grow` cells on every side (slab method)."""
    first, last = 0.0, 1.0
    for p, q, centre in ((a[0], b[0], r), (a[1], b[1], c)):
        low, high, d = centre - 0.5 - grow, centre + 0.5 + grow, q - p
        if d == 0:
            if not low < p < high:
                return False
            continue
        enter, leave = (low - p) / d, (high - p) / d
        first, last = max(first, min(enter, leave)), min(last, max(enter, leave))
    return first < last
