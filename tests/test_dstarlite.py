"""D* Lite is exact after every change of the map and every move of the robot (C9, parts of C10)."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from antway.errors import BadParameter, CellBlocked, OutOfBounds
from antway.grid import Grid, Moves
from antway.planning import Budget, Problem, Status
from antway.search import dstarlite as module
from antway.search.distance_field import dijkstra
from antway.search.dstarlite import DStarLite, dstarlite
from antway.verify import check_plan
from common import cases, free_cells, random_grid
from naive.dstarlite import grid_distance

MOVES = (Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT)


def some_problem(rng: np.random.Generator, high: int, moves: Moves) -> Problem:
    while True:
        grid = random_grid(rng, 2, high, (0.0, 0.5))
        free = free_cells(grid)
        if len(free) >= 2:
            start, goal = ((int(r), int(c)) for r, c in rng.permutation(free)[:2])
            return Problem(grid, start, goal, moves)


@pytest.mark.parametrize("moves", MOVES)
def test_exact_after_every_change(moves: Moves) -> None:
    """Through random changes and moves every plan is legal on the new grid and as short as a fresh search's."""
    rng = np.random.default_rng(2002)
    for _ in range(cases(75, 2500)):
        problem = some_problem(rng, 16, moves)
        robot, blocked, start = DStarLite(problem), problem.grid.blocked.copy(), problem.start
        for _ in range(8):
            plan = robot.plan()
            now = robot.problem
            assert np.array_equal(now.grid.blocked, blocked)
            assert (now.start, now.goal, now.moves) == (start, problem.goal, moves)
            check_plan(now, plan)
            wanted = grid_distance(Grid(blocked), start, problem.goal, moves)
            assert plan.length == pytest.approx(wanted, rel=1e-9)
            assert plan.optimal == (plan.status is Status.FOUND) == math.isfinite(wanted)
            if plan.status is Status.FOUND and rng.random() < 0.7:
                start = tuple(plan.cells[rng.integers(len(plan.cells))].tolist())
            elif rng.random() < 0.3:
                start = tuple(rng.choice(np.argwhere(~blocked)).tolist())
            robot.move(start)
            for _ in range(rng.integers(0, 3)):
                count = int(rng.integers(0, 12))
                cells = np.column_stack([rng.integers(0, n, size=count) for n in blocked.shape])
                cells = cells[(cells != start).any(axis=1) & (cells != problem.goal).any(axis=1)]
                state = rng.random(len(cells)) < 0.5
                robot.change(cells, state)
                for cell, value in zip(cells, state):
                    blocked[tuple(cell)] = value


def test_first_plan_is_the_planner() -> None:
    """The planner function answers as the class does, and start and goal may coincide."""
    rng = np.random.default_rng(3)
    for k in range(cases(100, 5000)):
        problem = some_problem(rng, 40, MOVES[k % 4])
        plan = dstarlite(problem)
        check_plan(problem, plan)
        wanted = grid_distance(problem.grid, problem.start, problem.goal, problem.moves)
        assert plan.length == pytest.approx(wanted, rel=1e-9)
    same = replace(problem, goal=problem.start)
    check_plan(same, dstarlite(same))
    assert dstarlite(same).length == 0.0


def test_very_long_paths_are_the_shortest() -> None:
    """Of two paths that differ by 19,601 diagonal moves and 36 micrometres, on cells of a metre, it takes the shorter one."""
    end = 19911
    blocked = np.ones((58, end + 1), dtype=bool)
    blocked[0, 0::2] = blocked[1, 1::2] = False  # a zigzag of diagonal moves
    blocked[1:, 0] = blocked[2:, end] = blocked[57] = False  # and a way round without any, longer by some bays
    for col in range(5, 19794, 257):
        blocked[57, col + 1 : col + 40] = True
        blocked[3:57, col] = blocked[3:57, col + 40] = blocked[3, col : col + 40] = False
    problem = Problem(Grid(blocked), (0, 0), (1, end), Moves.EIGHT_CUT)
    plan, wanted = dstarlite(problem), dijkstra(problem)
    check_plan(problem, plan)
    assert plan.optimal and plan.length == wanted.length


def test_saves_expansions() -> None:
    """On a long way, a change near the robot costs a small part of the expansions of a fresh search."""
    rng = np.random.default_rng(4)
    blocked = rng.random((120, 120)) < 0.15
    blocked[1, 1] = blocked[118, 118] = False
    robot = DStarLite(Problem(Grid(blocked), (1, 1), (118, 118), Moves.EIGHT_NOSQUEEZE))
    plan = robot.plan()
    again = fresh = 0
    while len(plan.cells) > 12:
        robot.move(tuple(plan.cells[4].tolist()))
        robot.change(plan.cells[9:10], True)
        plan = robot.plan()
        again += plan.expanded
        fresh += dstarlite(robot.problem).expanded
    assert plan.status is Status.FOUND
    assert again < 0.5 * fresh


def test_changes_make_new_grids() -> None:
    """A change leaves every grid handed in or out as it was, read-only; what is now known is no longer unknown."""
    blocked = np.zeros((3, 3), dtype=bool)
    blocked[0, 2] = True
    robot = DStarLite(Problem(Grid(blocked, unknown=blocked), (0, 0), (2, 2)))
    before = robot.problem
    robot.change([(0, 2), (1, 1)], [False, True])
    after = robot.problem
    assert before.grid.blocked[0, 2]
    assert not before.grid.blocked[1, 1]
    assert after.grid.blocked[1, 1]
    assert not after.grid.blocked[0, 2]
    assert after.grid.unknown is not None
    assert not after.grid.unknown.any()
    assert robot.problem is after
    with pytest.raises(ValueError, match="read-only"):
        after.grid.blocked[0, 0] = True


def test_the_problem_is_the_one_searched_after_an_interruption(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C just after a change or move leaves both of them changed or moved."""
    robot = DStarLite(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2)))
    for name, call in (("change", lambda: robot.change([(1, 1)], True)), ("move", lambda: robot.move((0, 1)))):
        kernel = getattr(module, name)

        def interrupted(*arguments: object, kernel: Callable[..., None] = kernel) -> None:
            kernel(*arguments)
            raise KeyboardInterrupt

        assert robot.problem.start == (0, 0)
        monkeypatch.setattr(module, name, interrupted)
        with pytest.raises(KeyboardInterrupt):
            call()
    assert robot.problem.grid.blocked[1, 1]
    assert robot.problem.start == (0, 1)
    check_plan(robot.problem, robot.plan())


def test_goes_on_after_its_budget() -> None:
    """Without time or cancelled the answer is BUDGET, and the next call goes on to the exact path."""
    problem = Problem(Grid(np.zeros((50, 50), dtype=bool)), (0, 0), (49, 30))
    robot, cancelled = DStarLite(problem), threading.Event()
    cancelled.set()
    for budget in (Budget(seconds=0.0), Budget(cancel=cancelled)):
        plan = robot.plan(budget)
        check_plan(problem, plan)
        assert plan.status is Status.BUDGET
    assert robot.plan().length == pytest.approx(30 * math.sqrt(2) + 19)


def test_refuses_what_makes_no_sense() -> None:
    """Wrong arrays, cells off the map, blocked ends and long moves are refused by name, and nothing changes."""
    problem = Problem(Grid(np.zeros((4, 4), dtype=bool)), (0, 0), (3, 3))
    robot = DStarLite(problem)
    for cells, blocked, error in (
        ([(1.0, 2.0)], True, BadParameter),
        ([1, 2], True, BadParameter),
        ([(1, 2), (1,)], True, BadParameter),
        (None, True, BadParameter),
        ([(1, 2)], 1, BadParameter),
        ([(1, 2)], [True, False], BadParameter),
        ([(1, 2)], [[True], [True, False]], BadParameter),
        ([(1, 2), (4, 0)], True, OutOfBounds),
        ([(1, 2), (-1, 0)], True, OutOfBounds),
        ([(1, 2), (0, 0)], True, CellBlocked),
        ([(1, 2), (3, 3)], True, CellBlocked),
    ):
        with pytest.raises(error):
            robot.change(cells, blocked)
    robot.change([], True)
    robot.change([(0, 0)], False)
    assert robot.problem.grid == problem.grid
    robot.change([(1, 2)], True)
    for start, error in (
        ((1, 2), CellBlocked),
        ((4, 0), OutOfBounds),
        ((0.5, 1), BadParameter),
        (3, BadParameter),
        ((), BadParameter),
    ):
        with pytest.raises(error, match="start"):
            robot.move(start)
    assert robot.problem.start == (0, 0)
    with pytest.raises(BadParameter, match="budget"):
        robot.plan(5)  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match="moves"):
        DStarLite(replace(problem, moves=Moves.SIXTEEN))


def test_time_counts_from_before_the_set_up(monkeypatch) -> None:
    """The arrays of a large map take seconds; they used to be free."""
    late = threading.Event()

    class Slow(DStarLite):
        def __init__(self, problem: Problem) -> None:
            super().__init__(problem)
            late.set()

    monkeypatch.setattr(module, "DStarLite", Slow)
    problem = Problem(Grid(np.zeros((9, 9), dtype=bool)), (0, 0), (8, 8))
    clock = Budget(seconds=0.0)
    assert dstarlite(problem, budget=clock).status is Status.BUDGET
    assert dstarlite(problem, budget=Budget(cancel=late)).status is Status.BUDGET
