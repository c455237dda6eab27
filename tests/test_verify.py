"""check_plan accepts every legal plan and rejects every broken one (C8)."""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from antway.errors import InvalidPlan
from antway.grid import Cell, Grid, Moves
from antway.planning import Plan, Problem, Status
from antway.verify import check_plan
from common import cases, free_cells, random_grid

RULES = (Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT, Moves.SIXTEEN, Moves.THIRTY_TWO)


def some_plan(rng: np.random.Generator, problem: Problem) -> Plan | None:
    """A legal plan by breadth-first search over the moves, or None where there is none."""
    grid, moves = problem.grid, problem.moves
    parent: dict[Cell, Cell] = {problem.start: problem.start}
    queue = deque([problem.start])
    while queue:
        cell = queue.popleft()
        for k in rng.permutation(len(moves.offsets)):
            dr, dc = moves.offsets[k]
            to = (cell[0] + int(dr), cell[1] + int(dc))
            sides = [grid.is_free((cell[0] + r, cell[1] + c)) for r, c in moves.touched[k]]
            if moves is Moves.EIGHT_CUT:
                sides = []
            elif moves is Moves.EIGHT_NOSQUEEZE:
                sides = [any(sides)] if sides else []
            if grid.is_free(to) and all(sides) and to not in parent:
                parent[to] = cell
                queue.append(to)
    if problem.goal not in parent:
        return None
    cells = [problem.goal]
    while cells[-1] != problem.start:
        cells.append(parent[cells[-1]])
    array = np.array(cells[::-1], dtype=np.int32)
    length = math.fsum(np.hypot(*np.diff(array, axis=0).T.astype(float))) * grid.resolution
    return Plan(Status.FOUND, array, length)


def with_cells(plan: Plan, cells: np.ndarray) -> Plan:
    length = math.fsum(np.hypot(*np.diff(cells, axis=0).T.astype(float)))
    return replace(plan, cells=cells.astype(np.int32), length=length)


def jump(problem: Problem, plan: Plan) -> Plan:
    return with_cells(plan, np.vstack((plan.cells[:1], plan.cells[:1] + 9, plan.cells[1:])))


def off_map(problem: Problem, plan: Plan) -> Plan:
    return with_cells(plan, np.vstack((plan.cells[:1], [[-1, 0]], plan.cells[1:])))


def through_wall(problem: Problem, plan: Plan) -> Plan:
    wall = np.argwhere(problem.grid.blocked)[:1]
    return with_cells(plan, np.vstack((plan.cells[:1], wall, plan.cells[1:])))


BREAK: dict[str, Callable[[Problem, Plan], Plan]] = {
    "jump": jump,
    "off the map": off_map,
    "through a wall": through_wall,
    "wrong start": lambda problem, plan: with_cells(plan, plan.cells[1:]),
    "wrong end": lambda problem, plan: with_cells(plan, plan.cells[:-1]),
    "reversed": lambda problem, plan: with_cells(plan, plan.cells[::-1].copy()),
    "stays in place": lambda problem, plan: with_cells(plan, np.repeat(plan.cells, 2, axis=0)),
    "NaN length": lambda problem, plan: replace(plan, length=math.nan),
    "too short a length": lambda problem, plan: replace(plan, length=plan.length * 0.999),
    "too long a length": lambda problem, plan: replace(plan, length=plan.length * 1.001),
    "found but empty": lambda problem, plan: replace(plan, cells=np.empty((0, 2), np.int32)),
    "optimal without a bound": lambda problem, plan: replace(plan, optimal=True, lower_bound=plan.length * 0.9),
    "bound above the length": lambda problem, plan: replace(plan, lower_bound=plan.length * 1.1),
    "no path, but cells": lambda problem, plan: replace(plan, status=Status.NO_PATH),
    "floats for cells": lambda problem, plan: replace(plan, cells=plan.cells.astype(float)),
    "negative expanded": lambda problem, plan: replace(plan, expanded=-1),
    "negative elapsed": lambda problem, plan: replace(plan, elapsed=-1.0),
    "NaN elapsed": lambda problem, plan: replace(plan, elapsed=math.nan),
    "NaN bound": lambda problem, plan: replace(plan, lower_bound=math.nan),
    "a text for the status": lambda problem, plan: replace(plan, status="no-path"),
    "no length": lambda problem, plan: replace(plan, length=None),
    "no bound": lambda problem, plan: replace(plan, lower_bound=None),
    "no time": lambda problem, plan: replace(plan, elapsed=None),
    "an array for a number": lambda problem, plan: replace(plan, expanded=np.int64(3)),
    "a length beyond all floats": lambda problem, plan: replace(plan, length=10**400),
    "a bound beyond all floats": lambda problem, plan: replace(plan, lower_bound=10**400),
    "a text for whether it is optimal": lambda problem, plan: replace(plan, optimal="no"),
    "points of objects": lambda problem, plan: replace(plan, points=plan.cells.astype(object)),
    "points far off": lambda problem, plan: replace(plan, points=plan.cells * 2.0 + 1e300),
}


def legal_plans(count: int) -> list[tuple[Problem, Plan]]:
    rng = np.random.default_rng(8)
    found: list[tuple[Problem, Plan]] = []
    while len(found) < count:
        grid = random_grid(rng, 4, 16, (0.05, 0.4))
        free = free_cells(grid)
        if len(free) < 2 or not grid.blocked.any():
            continue
        start, goal = (tuple(map(int, c)) for c in rng.choice(free, 2, replace=False))
        problem = Problem(grid, start, goal, RULES[len(found) % len(RULES)])
        plan = some_plan(rng, problem)
        if plan is not None:
            found.append((problem, plan))
    return found


@pytest.fixture(scope="module")
def plans() -> list[tuple[Problem, Plan]]:
    return legal_plans(cases(500, 5000))


def test_accepts_every_legal_plan(plans: list[tuple[Problem, Plan]]) -> None:
    """No legal plan under any move rule is rejected."""
    for problem, plan in plans:
        check_plan(problem, plan)


@pytest.mark.parametrize("fault", BREAK)
def test_rejects_every_broken_plan(fault: str, plans: list[tuple[Problem, Plan]]) -> None:
    """A legal plan broken in this one way is rejected, always."""
    for problem, plan in plans:
        with pytest.raises(InvalidPlan):
            check_plan(problem, BREAK[fault](problem, plan))


@pytest.mark.parametrize(
    ("moves", "side", "legal"),
    [
        (Moves.EIGHT, 0, True),
        (Moves.EIGHT, 1, False),
        (Moves.EIGHT, 2, False),
        (Moves.EIGHT_NOSQUEEZE, 1, True),
        (Moves.EIGHT_NOSQUEEZE, 2, False),
        (Moves.EIGHT_CUT, 2, True),
        (Moves.FOUR, 0, False),
        (Moves.THIRTY_TWO, 1, False),
    ],
)
def test_corner_rules(moves: Moves, side: int, legal: bool) -> None:
    """A diagonal step past `side` blocked side cells is legal exactly where the rule says so."""
    blocked = np.zeros((2, 2), dtype=bool)
    blocked[0, 1] = side > 0
    blocked[1, 0] = side > 1
    plan = Plan(Status.FOUND, np.array([[0, 0], [1, 1]], np.int32), math.sqrt(2))
    problem = Problem(Grid(blocked), (0, 0), (1, 1), moves)
    if legal:
        check_plan(problem, plan)
    else:
        with pytest.raises(InvalidPlan):
            check_plan(problem, plan)


def test_a_long_move_needs_every_touched_cell() -> None:
    """A (2, 3) move is rejected exactly when a cell that its segment touches is blocked."""
    k = next(i for i, (r, c) in enumerate(Moves.THIRTY_TWO.offsets.tolist()) if (r, c) == (2, 3))
    touched = set(Moves.THIRTY_TWO.touched[k])
    line = np.linspace(0, 1, 10001)
    sampled = {(int(r), int(c)) for r, c in np.floor(np.column_stack((2 * line, 3 * line)) + 0.5)} - {(0, 0), (2, 3)}
    assert sampled <= touched
    plan = Plan(Status.FOUND, np.array([[0, 0], [2, 3]], np.int32), math.hypot(2, 3))
    for up, back, r, c in itertools.product((False, True), (False, True), range(3), range(4)):
        if (r, c) in ((0, 0), (2, 3)):
            continue
        blocked = np.zeros((3, 4), dtype=bool)
        blocked[r, c] = True
        ends = [(2 - i if up else i, 3 - j if back else j) for i, j in ((0, 0), (2, 3))]
        turned = replace(plan, cells=np.array(ends, np.int32))
        problem = Problem(
            Grid(np.flip(blocked, [axis for axis, flip in enumerate((up, back)) if flip])), *ends, Moves.THIRTY_TWO
        )
        if (r, c) in touched:
            with pytest.raises(InvalidPlan, match="touches"):
                check_plan(problem, turned)
        else:
            check_plan(problem, turned)


def test_says_every_violation() -> None:
    """All faults of a plan are in the error, not only the first."""
    problem = Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2))
    plan = Plan(Status.FOUND, np.array([[1, 1], [1, 1]], np.int32), 5.0, lower_bound=9.0)
    with pytest.raises(InvalidPlan) as caught:
        check_plan(problem, plan)
    assert len(caught.value.violations) == 5


def test_names_what_is_of_another_type() -> None:
    """A text is no status even without cells, and each part of another type is named."""
    problem = Problem(Grid(np.zeros((9, 9), dtype=bool)), (0, 0), (4, 4))
    with pytest.raises(InvalidPlan, match=r"status 'found' is not a Status; expanded .* is not of type int"):
        check_plan(problem, Plan("found", expanded=np.int64(3)))  # type: ignore[arg-type]
    cells = np.array([[k, k] for k in range(5)], np.int32)
    with pytest.raises(InvalidPlan, match=r"point 1 .* is off the map"):
        check_plan(problem, Plan(Status.FOUND, cells, 1.0, points=np.array([[0.0, 0.0], [1e300, 1e300], [4.0, 4.0]])))
    with pytest.raises(InvalidPlan, match=r"point 1 .* is off the map"):
        check_plan(problem, Plan(Status.FOUND, cells, 1.0, points=np.array([[0.0, 0.0], [8.6, 4.0], [4.0, 4.0]])))


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({"status": Status.FOUND}, "FOUND without cells"),
        ({"length": 1.0, "lower_bound": 1.0}, "must have infinite length"),
        ({"points": np.zeros((1, 2))}, "no points"),
        ({"optimal": True, "lower_bound": math.inf}, "not be optimal"),
        ({"optimal": 1}, "optimal 1 is not of type bool"),
        ({"expanded": True}, "expanded True is not of type int"),
        ({"points": np.zeros((0, 2))}, "points are not a finite"),
        ({"points": np.zeros((1, 3))}, "points are not a finite"),
        ({"points": np.zeros((2, 2, 2))}, "points are not a finite"),
        ({"cells": np.zeros((2, 2, 1), np.int32)}, "cells are not an"),
    ],
)
def test_each_part_of_an_empty_plan_is_checked(changes: dict, what: str) -> None:
    problem = Problem(Grid(np.zeros((9, 9), dtype=bool)), (0, 0), (4, 4))
    nothing = Plan(Status.NO_PATH)
    check_plan(problem, nothing)
    with pytest.raises(InvalidPlan, match=what):
        check_plan(problem, replace(nothing, **changes))


def test_cells_are_met_in_their_order_and_points_are_on_the_map() -> None:
    """Cells may not go back along a segment; the outer edges of the map belong to it."""
    problem, row = Problem(Grid(np.zeros((1, 6), dtype=bool)), (0, 0), (0, 5)), [0, 1, 2, 3, 4, 5]
    for columns, what in ((row, ""), ([0, 1, 2, 3, 2, 1, 2, 3, 4, 5], r"cell 5 \(0, 1\) is not met in its turn")):
        cells = np.array([(0, c) for c in columns], np.int32)
        plan = Plan(Status.FOUND, cells, 5.0, points=np.array([(0.0, 0.0), (0.0, 5.0)]))
        with pytest.raises(InvalidPlan, match=what) if what else nullcontext():
            check_plan(problem, plan)
    for at, legal in (((-0.5, 2.0), True), ((0.5, 2.0), True), ((-0.51, 2.0), False), ((0.51, 2.0), False)):
        points = np.array([(0.0, 0.0), at, (0.0, 5.0)])
        for turned in (False, True):
            task = replace(problem, grid=Grid(problem.grid.blocked.T), goal=(5, 0)) if turned else problem
            length = float(np.hypot(*np.diff(points, axis=0).T).sum())
            plan = Plan(Status.FOUND, np.array([(0, c) for c in row], np.int32), length, points=points)
            if turned:
                plan = replace(plan, cells=plan.cells[:, ::-1].copy(), points=points[:, ::-1].copy())
            with nullcontext() if legal else pytest.raises(InvalidPlan, match=r"point 1 .* off the map"):
                check_plan(task, plan)


def test_segments_that_enter_blocked_cells_are_refused() -> None:
    """As points sampled along them do, in whatever direction; those that stay away from them by a little are not."""
    rng, seen = np.random.default_rng(6), [0, 0]
    for _ in range(cases(400, 8000)):
        grid = Grid(rng.random((7, 9)) < 0.12)
        free = free_cells(grid)
        start, goal = (tuple(map(int, cell)) for cell in free[rng.integers(len(free), size=2)])
        points = np.array([start, rng.uniform((0.0, 0.0), (6.0, 8.0)), goal])
        along = np.linspace(0.0, 1.0, 1001)[:, None]
        places = np.concatenate([a + along * (b - a) for a, b in pairwise(points)])
        off = np.abs(places[:, None] - np.argwhere(grid.blocked)).max(axis=2).min(initial=9.0)
        if abs(off - 0.5) < 0.02:
            continue
        seen[int(off < 0.5)] += 1
        plan = Plan(Status.FOUND, np.array([start, goal], np.int32), 1.0, points=points)
        try:
            check_plan(Problem(grid, start, goal), plan)
            faults = ""
        except InvalidPlan as error:  # also for its length and its cells
            faults = str(error)
        assert ("blocked or off the map" in faults) == (off < 0.5)
    assert min(seen) > 50


def test_start_is_goal() -> None:
    """A path of one cell and no length is legal where the ends coincide."""
    problem = Problem(Grid(np.zeros((1, 1), dtype=bool)), (0, 0), (0, 0))
    check_plan(problem, Plan(Status.FOUND, np.array([[0, 0]], np.int32), 0.0, optimal=True))


@pytest.mark.parametrize(
    ("moves", "step"),
    [
        *((Moves.SIXTEEN, (2, 0)), (Moves.SIXTEEN, (2, 2)), (Moves.THIRTY_TWO, (3, 3)), (Moves.THIRTY_TWO, (0, 2))),
        *((moves, (1, 2)) for moves in (Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT)),
        *((Moves.SIXTEEN, (3, 2)), (Moves.THIRTY_TWO, (1, 4)), (Moves.FOUR, (1, 1)), (Moves.EIGHT, (0, 2))),
    ],
)
def test_longer_moves_are_no_move(moves: Moves, step: Cell) -> None:
    """Neither those that are several of another one, nor those of rules with more moves, though all they touch is free."""
    problem = Problem(Grid(np.zeros((5, 5), bool)), (0, 0), step, moves)
    with pytest.raises(InvalidPlan, match="no such move"):
        check_plan(problem, Plan(Status.FOUND, np.array([(0, 0), step], np.int32), math.hypot(*step)))


@pytest.mark.parametrize("turned", [False, True])
def test_no_line_passes_where_two_blocked_cells_touch(turned: bool) -> None:
    """Neither where they touch from the upper left to the lower right, nor the other way."""
    ends = [(0, 0), (1, 1)] if turned else [(0, 1), (1, 0)]
    problem = Problem(Grid(np.eye(2, dtype=bool) != turned), *ends)
    cells = np.array(ends, np.int32)
    with pytest.raises(InvalidPlan, match=r"passes \(0\.5, 0\.5\)"):
        check_plan(problem, Plan(Status.FOUND, cells, math.sqrt(2.0), points=cells.astype(float)))
