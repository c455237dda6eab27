"""Independent checks of answers, which share no code with any planner and follow only the definitions of the rules."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, InvalidPlan
from antway.grid import Cell, Grid, Moves
from antway.planning import Plan, Problem, Status
from antway.verify_motion import driven, dynamic_faults, dynamic_gaps, last_gaps
from antway.verify_rounds import last_end, rounds_faults

if TYPE_CHECKING:
    from antway.world.episode import EpisodeResult
    from antway.world.trace import Trace

_FARTHEST = {Moves.FOUR: 1, Moves.EIGHT: 1, Moves.EIGHT_NOSQUEEZE: 1, Moves.EIGHT_CUT: 1, Moves.SIXTEEN: 2, Moves.THIRTY_TWO: 3}

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
    """Return why the step from `a` to `b` is not legal under `moves`; empty if it is legal."""
    dr, dc = b[0] - a[0], b[1] - a[1]
    farthest = max(abs(dr), abs(dc))
    if farthest == 0:
        return "stays in place"
    if farthest > _FARTHEST[moves] or (moves is Moves.FOUR and dr and dc) or math.gcd(dr, dc) != 1:
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
    farthest = 0.5 + _EPS
    first, last = _inside(a, b, (r - farthest, c - farthest), (r + farthest, c + farthest))
    return first < last


def _near(a: Sequence[float], b: Sequence[float]) -> Iterator[Cell]:
    """Yield the cells within one cell of the segment (and a few more), row by row."""
    for r in range(math.floor(min(a[0], b[0])) - 1, math.ceil(max(a[0], b[0])) + 2):
        first, last = _inside(a, b, (r - 1.6, -math.inf), (r + 1.6, math.inf))
        if first <= last:
            ends = [a[1] + t * (b[1] - a[1]) for t in (first, last)]
            yield from ((r, c) for c in range(math.floor(min(ends)) - 1, math.ceil(max(ends)) + 2))


def _order_faults(points: list[list[float]], path: list[Cell]) -> list[str]:
    """Return the first cell that the polyline does not meet in order. Taking the earliest meeting of each is enough."""
    i, t, farthest = 0, 0.0, 0.5 + _EPS
    for k, (r, c) in enumerate(path):
        while True:
            if i >= max(len(points) - 1, 1):
                return [f"cell {k} {(r, c)} is not met in its turn by the points"]
            end = points[min(i + 1, len(points) - 1)]
            first, last = _inside(points[i], end, (r - farthest, c - farthest), (r + farthest, c + farthest))
            if max(first, t) <= last:
                t = max(first, t)
                break
            i, t = i + 1, 0.0
    return []


def _inside(a: Sequence[float], b: Sequence[float], low: tuple[float, float], high: tuple[float, float]) -> tuple[float, float]:
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


_NEAR = 1e-6  # m, m/s, rad; tolerance of an episode's rules


def check_episode(episode: EpisodeResult | Trace) -> None:
    """Raise `InvalidPlan` with all violations of the rules of an episode's robot, map and obstacles.

    Parameters
    ----------
    episode : EpisodeResult or Trace
        A result must have been run with `record=True`.

    Raises
    ------
    BadParameter
        If the argument is not an episode.
    InvalidPlan
        If times do not increase by the control period; if the robot starts elsewhere, jumps, exceeds a limit of speed,
        acceleration or turn rate, or passes through an obstacle or a wall; if the outcome or a figure contradicts the trace;
        or if a stop was not visited as recorded.
    """
    trace = _trace_of(episode)
    faults = _shape_faults(trace) or [*_motion_faults(trace), *_end_faults(trace), *rounds_faults(trace)]
    if hasattr(episode, "min_clearance") and not faults:
        faults = _figure_faults(cast("EpisodeResult", episode), trace)
    if faults:
        raise InvalidPlan(faults)


def _trace_of(episode: EpisodeResult | Trace) -> Trace:
    trace = getattr(episode, "trace", episode)
    if trace is None:
        raise InvalidPlan(["the result has no trace: run it with record=True"])
    if not all(hasattr(trace, name) for name in ("task", "timeline", "command", "decisions")):
        raise BadParameter("episode", episode, "an EpisodeResult or a Trace")
    return cast("Trace", trace)


def _shape_faults(trace: Trace) -> list[str]:
    n, k = len(trace.command), len(trace.timeline)
    shapes = {"t": (n + 1,), "xy": (n + 1, 2), "velocity": (n + 1, 2), "heading": (n + 1,), "command": (n, 2)}
    shapes |= {"sensed": (n + 1, k), "cycle_ms": (n,), "turn_rate": (n + 1,)}
    faults = [
        f"{name} has the shape {getattr(trace, name).shape}" for name in shapes if getattr(trace, name).shape != shapes[name]
    ]
    if not faults:
        faults = [
            f"{name} is not finite"
            for name in ("t", "xy", "velocity", "heading", "turn_rate")
            if not np.isfinite(getattr(trace, name)).all()
        ]
    if any(not 0 <= step <= n for step, _ in trace.decisions):
        faults.append("a decision stands outside the episode")
    return faults


def _motion_faults(trace: Trace) -> Iterator[str]:
    """Yield violations of times, of the robot's limits, and of contacts before the end."""
    spec, t, xy, v = trace.task.robot, trace.t, trace.xy, trace.velocity
    dt = np.diff(t)
    if t[0] != 0.0 or (dt <= 0).any():
        yield "times do not increase from 0"
        return
    if (np.abs(t[:-1] - np.arange(len(t) - 1) * spec.dt) > 1e-9 * (1 + t[:-1])).any() or (dt > spec.dt * (1 + 1e-9)).any():
        yield "steps are not the control period apart"
    if tuple(xy[0].tolist()) != trace.task.start:
        yield f"begins at {tuple(xy[0])}, not at the start {trace.task.start}"
    if not spec.stepwise:
        yield from dynamic_faults(trace)
        return
    if (np.abs(np.diff(xy, axis=0) - v[1:] * dt[:, None]) > _NEAR).any():
        yield "a place is not where its velocity leads"
    if (np.hypot(v[:, 0], v[:, 1]) > spec.v_max + _NEAR).any():
        yield "is faster than v_max"
    ahead = np.column_stack((np.cos(trace.heading), np.sin(trace.heading)))
    speed = (v * ahead).sum(axis=1)
    if spec.drive == "differential":
        turn = np.abs(np.angle(np.exp(1j * np.diff(trace.heading))))
        if (turn > spec.turn_rate * spec.dt + _NEAR).any():
            yield "turns faster than turn_rate"
        if (np.abs(v[:, 0] * ahead[:, 1] - v[:, 1] * ahead[:, 0]) > _NEAR).any() or (speed < -_NEAR).any():
            yield "moves aside or backwards, which a differential drive does not"
    change = np.abs(np.diff(speed)) if spec.drive == "differential" else np.hypot(*np.diff(v, axis=0).T)
    if (change > spec.a_max * spec.dt + _NEAR).any():
        yield "accelerates faster than a_max"
    gap = _gaps(trace)
    for k in np.flatnonzero(gap.min(axis=0) < -_NEAR).tolist() if gap.size else []:
        yield f"passes through obstacle {trace.timeline.id[k]} in step {int(np.argmin(gap[:, k]))}"
    depth = [_wall_gap(trace, i) for i in range(len(t) - 1)]
    if depth and min(depth) < -_NEAR:
        yield f"passes through a wall in step {depth.index(min(depth))}"


def _end_faults(trace: Trace) -> Iterator[str]:
    """Yield contradictions between the end of the trace and its outcome."""
    outcome = trace.outcome.value
    task, last = trace.task, trace.xy[-1]
    away = np.hypot(*(trace.xy - np.array(task.goal)).T)
    if outcome == "reached" and away[-1] > task.goal_tolerance + _NEAR:
        yield f"claims to have reached the goal from {away[-1]:g} m away"
    if ((away[:-1] < task.goal_tolerance - _NEAR) & (trace.t[:-1] > last_end(trace) + _NEAR)).any():
        yield "goes on after it reached the goal"
    stepwise = task.robot.stepwise
    near, wall = ([], math.inf) if stepwise else last_gaps(trace)
    touched = [gap <= _NEAR for gap in near] or [
        math.dist(last.tolist(), place) <= task.robot.radius + radius + _NEAR
        for place, radius in zip(_obstacles_at(trace, float(trace.t[-1])), trace.timeline.radius.tolist())
    ]
    moving = math.hypot(*trace.velocity[-1].tolist()) > 1e-9
    moving |= task.robot.footprint is not None and abs(float(trace.turn_rate[-1])) > 1e-9
    if outcome in ("hit-moving", "hit-standing"):
        if not any(touched):
            yield "claims a contact with an obstacle that it does not touch"
        if moving != (outcome == "hit-moving"):
            yield f"claims {outcome} though the robot was {'moving' if moving else 'at rest'}"
    if outcome == "hit-wall" and (len(trace.t) == 1 or (_wall_gap(trace, len(trace.t) - 2) if stepwise else wall) > _NEAR):
        yield "claims a contact with a wall that it does not touch"
    if outcome == "timeout" and trace.t[-1] < trace.config.get("horizon", 0.0) - _NEAR:
        yield "claims to have run out of time before the horizon"


def _figure_faults(result: EpisodeResult, trace: Trace) -> list[str]:
    stepwise = trace.task.robot.stepwise
    gap = _gaps(trace) if stepwise else dynamic_gaps(trace, *driven(trace)[:2])
    least = float(gap.min()) if gap.size else math.inf
    slack = _NEAR if stepwise else 1e-4  # for gaps that are sampled
    length = math.fsum(math.dist(a, b) for a, b in pairwise(trace.xy.tolist()))
    figures = {
        "time": (result.time, float(trace.t[-1])),
        "length": (result.length, length),
        "min_clearance": (result.min_clearance, least),
    }
    faults = [f"states {name} {a!r} but has {b!r}" for name, (a, b) in figures.items() if a != b and not abs(a - b) <= slack]
    if result.outcome is not trace.outcome or result.seed != trace.seed:
        faults.append("outcome or seed of result and trace differ")
    return faults


def _obstacles_at(trace: Trace, t: float) -> list[tuple[float, float]]:
    line = trace.timeline
    spans = [slice(a, b) for a, b in pairwise(line.first.tolist())]
    return [
        (float(np.interp(t, line.knot_t[s], line.knot_xy[s, 0])), float(np.interp(t, line.knot_t[s], line.knot_xy[s, 1])))
        for s in spans
    ]


def _gaps(trace: Trace) -> NDArray[np.float64]:
    """Return the smallest gap of robot and obstacle in each step, float64[N, K]; between knots both move straight."""
    line, t = trace.timeline, trace.t
    gap = np.empty((len(t) - 1, len(line)))
    for k, (low, high) in enumerate(pairwise(line.first.tolist())):
        knots, places = line.knot_t[low:high], line.knot_xy[low:high]
        every = np.union1d(t, knots[(knots > t[0]) & (knots < t[-1])])
        apart = np.column_stack([np.interp(every, t, trace.xy[:, a]) - np.interp(every, knots, places[:, a]) for a in (0, 1)])
        step = np.diff(apart, axis=0)
        square = (step**2).sum(axis=1)
        share = np.clip(-(apart[:-1] * step).sum(axis=1) / np.where(square > 0, square, 1.0), 0.0, 1.0)
        near = np.hypot(*(apart[:-1] + share[:, None] * step).T)
        np.minimum.reduceat(near, np.searchsorted(every, t[:-1]), out=gap[:, k])
        gap[:, k] -= line.radius[k] + trace.task.robot.radius
    return gap


def _wall_gap(trace: Trace, i: int) -> float:
    """Return the smallest gap of the robot and nearby blocked squares or map edges in step i, m."""
    grid, radius = trace.task.grid, trace.task.robot.radius / trace.task.grid.resolution
    rows, cols = grid.shape
    a, b = grid.to_points(trace.xy[i : i + 2]).tolist()
    least = min(min(p[0] + 0.5, rows - 0.5 - p[0], p[1] + 0.5, cols - 0.5 - p[1]) for p in (a, b))
    low = [math.floor(min(a[k], b[k]) - radius - 1) for k in (0, 1)]
    high = [math.ceil(max(a[k], b[k]) + radius + 1) for k in (0, 1)]
    near = grid.blocked[max(low[0], 0) : max(high[0] + 1, 0), max(low[1], 0) : max(high[1] + 1, 0)]
    for r, c in np.argwhere(near).tolist():
        least = min(least, _square_distance(a, b, r + max(low[0], 0), c + max(low[1], 0)))
    return float((least - radius) * grid.resolution)


def _square_distance(a: Sequence[float], b: Sequence[float], r: int, c: int) -> float:
    """Return the distance of the segment from the closed square of cell (r, c), in cells."""
    first, last = _inside(a, b, (r - 0.5, c - 0.5), (r + 0.5, c + 0.5))
    if first <= last:
        return 0.0
    ends = (math.hypot(max(abs(p[0] - r) - 0.5, 0.0), max(abs(p[1] - c) - 0.5, 0.0)) for p in (a, b))
    d = (b[0] - a[0], b[1] - a[1])
    square = d[0] * d[0] + d[1] * d[1]
    corners = []
    for p in ((r + i, c + j) for i in (-0.5, 0.5) for j in (-0.5, 0.5)):
        share = min(max(((p[0] - a[0]) * d[0] + (p[1] - a[1]) * d[1]) / square, 0.0), 1.0) if square else 0.0
        corners.append(math.dist(p, (a[0] + share * d[0], a[1] + share * d[1])))
    return min(*ends, *corners)
