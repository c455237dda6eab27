"""An independent check of plans, which shares no code with any planner and follows only the definitions of the rules."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from antway import checks
from antway.errors import InvalidPlan
from antway.grid import Cell, Grid, Moves
from antway.planning import Plan, Problem, Status

_FARTHEST = {Moves.SIXTEEN: 2, Moves.THIRTY_TWO: 3}  # most rows or columns that a move crosses; 1 for all other moves
_EPS = 1e-9  # cells; tolerance far below any distance between cell centres and corners


def check_plan(problem: Problem, plan: Plan) -> None:
    """Raise `InvalidPlan` with all reasons why `plan` is not a legal answer to `problem`.

    Parameters
    ----------
    problem : Problem
    plan : Plan

    Raises
    ------
    BadParameter
        If an argument is not a problem or a plan.
    InvalidPlan
        If the plan leaves the map, enters a blocked cell, jumps, cuts a corner against the rule of its moves, starts or ends
        elsewhere, or if its status, length or bound contradicts its cells. An any-angle plan (with `points`) may touch blocked
        cells but not run between two of them, neither along their border nor where they touch diagonally. Its `cells` are
        neighbouring free cells from start to goal, whose closed squares the polyline meets in this order.

    Examples
    --------
    >>> problem = Problem(Grid(np.zeros((2, 2), dtype=bool)), (0, 0), (1, 1))
    >>> check_plan(problem, Plan(Status.FOUND, np.array([[0, 0], [1, 1]], dtype=np.int32), math.sqrt(2)))
    """
    checks.instance("problem", problem, Problem)
    faults = _faults(problem, checks.instance("plan", plan, Plan))
    if faults:
        raise InvalidPlan(faults)


def _faults(problem: Problem, plan: Plan) -> list[str]:
    faults, cells = _type_faults(plan), plan.cells
    if faults:
        return faults
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
        vertices: list[Sequence[float]] = [*path]
        faults += [
            f"move {i} from {a} to {b} {why}"
            for i, (a, b) in enumerate(pairwise(path))
            if (why := _move_fault(problem.grid, problem.moves, a, b))
        ]
    else:
        vertices = plan.points.tolist()
        faults += _any_angle_faults(problem, path, vertices)
    length = math.fsum(math.dist(a, b) for a, b in pairwise(vertices)) * problem.grid.resolution
    if not math.isclose(plan.length, length, rel_tol=1e-9, abs_tol=1e-12):
        faults.append(f"states a length of {plan.length!r} m but has {length!r} m")
    return faults


def _any_angle_faults(problem: Problem, path: list[Cell], points: list[Sequence[float]]) -> Iterator[str]:
    """Yield why a polyline, (row, col) with integers at cell centres, is not legal or does not go along the cells of `path`."""
    if tuple(points[0]) != problem.start or tuple(points[-1]) != problem.goal:
        yield "points do not run from start to goal"
    rows, cols = problem.grid.shape
    for i, (r, c) in enumerate(points):
        if not (abs(2 * r - rows + 1) <= rows + 2 * _EPS and abs(2 * c - cols + 1) <= cols + 2 * _EPS):
            yield f"point {i} {(r, c)} is off the map"
            return  # a segment to it may pass any number of cells
    for i, (p, q) in enumerate(pairwise(points)):
        why = _segment_fault(problem.grid, p, q)
        if why:
            yield f"segment {i} from {tuple(p)} to {tuple(q)} {why}"
    for i, (a, b) in enumerate(pairwise(path)):
        if _move_fault(problem.grid, Moves.EIGHT_NOSQUEEZE, a, b):
            yield f"cells {i} {a} and {b} are no neighbours or touch between two blocked cells"
    yield from _order_faults(points, path)


def _type_faults(plan: Plan) -> list[str]:
    """Return which parts of a plan are not of their type; nothing else can be said of such a plan."""
    faults = [] if isinstance(plan.status, Status) else [f"status {plan.status!r} is not a Status"]
    faults += number_faults(plan, "length", "lower_bound", "elapsed") + number_faults(plan, "expanded", kind=int)
    if not isinstance(plan.optimal, bool):
        faults.append(f"optimal {plan.optimal!r} is not of type bool")
    if not _pairs(plan.cells, np.int32):
        faults.append("cells are not an int32[N, 2] array")
    points = plan.points
    if points is not None and not (_pairs(points, np.float64) and len(points) and np.isfinite(points).all()):
        faults.append("points are not a finite float64[M, 2] array")
    return faults


def number_faults(record: object, *names: str, kind: type = float) -> list[str]:
    """Return which parts of a record are no numbers of this kind, or integers that no float is as large as."""
    values = {name: getattr(record, name) for name in names}
    return [
        f"{name} {value!r:.80} is not of type {kind.__name__}"
        for name, value in values.items()
        if isinstance(value, bool) or not isinstance(value, (int, kind)) or (isinstance(value, int) and abs(value) >= 2**1023)
    ]


def _pairs(value: object, kind: type[np.generic]) -> bool:
    return isinstance(value, np.ndarray) and value.ndim == 2 and value.shape[1] == 2 and value.dtype == kind


def _number_faults(plan: Plan) -> list[str]:
    faults = []
    if not 0 <= plan.lower_bound <= plan.length * (1 + 1e-9):
        faults.append(f"lower bound {plan.lower_bound!r} is above the length {plan.length!r} or no length")
    if plan.optimal and not math.isclose(plan.lower_bound, plan.length, rel_tol=1e-9, abs_tol=1e-12):
        faults.append("claims to be optimal but its lower bound is below its length")
    if plan.expanded < 0 or not plan.elapsed >= 0:
        faults.append("expanded and elapsed must not be negative")
    return faults


def _free(grid: Grid, cell: Cell) -> bool:
    rows, cols = grid.blocked.shape
    return 0 <= cell[0] < rows and 0 <= cell[1] < cols and not bool(grid.blocked[cell])


def _move_fault(grid: Grid, moves: Moves, a: Cell, b: Cell) -> str:
    """Return why the step from `a` to `b` is not legal under `moves`; empty if it is legal."""
    dr, dc = b[0] - a[0], b[1] - a[1]
    farthest = max(abs(dr), abs(dc))
    if farthest > _FARTHEST.get(moves, 1) or (moves is Moves.FOUR and dr and dc) or math.gcd(dr, dc) != 1:
        return "is no such move"
    if farthest == 1:
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
    """Return why a point must not move along the segment; empty if it may.

    Blocked cells and the outside of the map may be touched, but the border between two blocked cells belongs to their inside,
    and a point where two blocked cells touch diagonally must not be touched at all.
    """
    gap = 2 * _EPS
    for r, c in _near(a, b):
        free, below, beside, across = (_free(grid, (r + i, c + j)) for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)))
        for tall, wide in ((0, 0), (1, 0), (0, 1)):
            if free or (tall and below) or (wide and beside):
                continue
            first, last = inside_box(a, b, (r - 0.5 + _EPS, c - 0.5 + _EPS), (r + tall + 0.5 - _EPS, c + wide + 0.5 - _EPS))
            if first < last:
                two = f" or runs between it and {(r + tall, c + wide)}" if tall or wide else ""
                return f"enters {(r, c)}, blocked or off the map{two}"
        corner = (r + 0.5, c + 0.5)
        if free == across != below == beside:
            first, last = inside_box(a, b, (corner[0] - gap, corner[1] - gap), (corner[0] + gap, corner[1] + gap))
            if first < last:
                return f"passes {corner}, where two blocked cells touch diagonally"
    return ""


def _meets(a: Cell, b: Cell, r: int, c: int) -> bool:
    """Tell whether the segment touches the closed square of cell (r, c)."""
    farthest = 0.5 + _EPS
    first, last = inside_box(a, b, (r - farthest, c - farthest), (r + farthest, c + farthest))
    return first < last


def _near(a: Sequence[float], b: Sequence[float]) -> Iterator[Cell]:
    """Yield the cells within one cell of the segment (and a few more), row by row."""
    for r in range(math.floor(min(a[0], b[0])) - 1, math.ceil(max(a[0], b[0])) + 2):
        first, last = inside_box(a, b, (r - 1.6, -math.inf), (r + 1.6, math.inf))
        if first <= last:
            ends = [a[1] + t * (b[1] - a[1]) for t in (first, last)]
            yield from ((r, c) for c in range(math.floor(min(ends)) - 1, math.ceil(max(ends)) + 2))


def _order_faults(points: list[Sequence[float]], path: list[Cell]) -> list[str]:
    """Return the first cell that the polyline does not meet in order. Taking the earliest meeting of each is enough."""
    i, t, farthest = 0, 0.0, 0.5 + _EPS
    for k, (r, c) in enumerate(path):
        while True:
            if i >= max(len(points) - 1, 1):
                return [f"cell {k} {(r, c)} is not met in its turn by the points"]
            end = points[min(i + 1, len(points) - 1)]
            first, last = inside_box(points[i], end, (r - farthest, c - farthest), (r + farthest, c + farthest))
            if max(first, t) <= last:
                t = max(first, t)
                break
            i, t = i + 1, 0.0
    return []


def inside_box(
    a: Sequence[float], b: Sequence[float], low: tuple[float, float], high: tuple[float, float]
) -> tuple[float, float]:
    """Return the part of the segment in the open box, as shares of its length; empty if first >= last."""
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
