"""C10: what every planner in the table must do, whoever wrote it."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from antway import PLANNERS, Budget, Grid, Plan, Problem, Status, check_plan, distance_field, solve
from antway.errors import BadParameter
from antway.planning import Planner, find
from common import cases, free_cells, random_grid

EXACT = ("dijkstra", "astar", "jps", "subgoals", "dstarlite")


def planner_of(name: str) -> Planner:
    """The planner of that name."""
    found: Planner = find("planner", name, PLANNERS, "antway.planners")
    return found


def verified(problem: Problem, plan: Plan) -> Plan:
    """`plan`, checked."""
    check_plan(problem, plan)
    return plan


@pytest.fixture(params=PLANNERS)
def name(request: pytest.FixtureRequest) -> str:
    """Each name of the table."""
    return str(request.param)


def test_solves_again_and_the_same(name: str) -> None:
    """A legal plan, no shorter than the shortest its moves allow; the same bytes for the same seed, whatever came between."""
    rng = np.random.default_rng(0)
    for _ in range(cases(12, 200)):
        grid = random_grid(rng, 4, 24, (0.0, 0.3))
        free = free_cells(grid)
        start, goal = (tuple(map(int, free[i])) for i in rng.integers(len(free), size=2))
        problem = Problem(grid, start, goal)
        exact = float(distance_field(grid, goal)[start])
        plan = verified(problem, solve(problem, name, seed=3))
        if name in EXACT:
            assert plan.optimal == np.isfinite(exact)
            assert plan.length == pytest.approx(exact, rel=1e-9)
        elif name == "ants":
            assert plan.length >= exact * (1 - 1e-9)
            assert not plan.optimal or plan.length == pytest.approx(exact, rel=1e-9)
        assert plan.lower_bound <= exact * (1 + 1e-9)
        solve(Problem(grid, goal, start), name, seed=4)
        again = solve(problem, name, seed=3)
        assert (again.status, again.length, again.cells.tobytes()) == (plan.status, plan.length, plan.cells.tobytes())


def test_start_is_goal(name: str) -> None:
    """Where nothing is to be done the plan is that one cell."""
    problem = Problem(Grid(np.zeros((5, 5), dtype=bool)), (2, 2), (2, 2))
    plan = verified(problem, solve(problem, name))
    assert (plan.status, plan.length, plan.cells.tolist()) == (Status.FOUND, 0.0, [[2, 2]])


def test_unreachable(name: str) -> None:
    """A goal behind a wall, or boxed in: no path, with empty cells and infinite length."""
    wall, box = np.zeros((9, 9), dtype=bool), np.zeros((9, 9), dtype=bool)
    wall[:, 4] = True
    box[3:6, 3:6] = True
    box[4, 4] = False
    for blocked, goal in ((wall, (8, 8)), (box, (4, 4))):
        for start, end in (((0, 0), goal), (goal, (0, 0))):
            problem = Problem(Grid(blocked), start, end)
            plan = verified(problem, solve(problem, name))
            assert (plan.status, len(plan.cells), plan.length) == (Status.NO_PATH, 0, np.inf)


def test_expired_budget(name: str) -> None:
    """With no time at all, or cancelled before it begins, a planner returns at once: BUDGET, or a legal plan."""
    problem = Problem(Grid(np.zeros((64, 64), dtype=bool)), (0, 0), (63, 40))
    cancelled = threading.Event()
    cancelled.set()
    for budget in (Budget(seconds=0.0), Budget(cancel=cancelled)):
        plan = verified(problem, planner_of(name)(problem, budget=budget))
        assert plan.status in (Status.BUDGET, Status.FOUND)
        assert name not in EXACT or plan.status is Status.BUDGET


def test_tiny_budgets(name: str) -> None:
    """Whatever the time limit, the answer is legal; with none, it is found."""
    rng = np.random.default_rng(1)
    grid = Grid(np.where(np.add.outer(np.arange(96), np.arange(96)) % 191 == 0, False, rng.random((96, 96)) < 0.2))
    free = free_cells(grid)
    field = distance_field(grid, tuple(map(int, free[0])))
    ends = [cell for cell in map(tuple, free.tolist()) if np.isfinite(field[cell])]
    problem = Problem(grid, ends[0], ends[-1])
    for limit in (1e-9, 1e-5, 1e-4, 1e-3, 1e-2):
        plan = verified(problem, solve(problem, name, time_limit=limit))
        assert plan.status in (Status.BUDGET, Status.FOUND)
    assert solve(problem, name).status is Status.FOUND


class _SetAtLook(threading.Event):
    """An event that is set from its n-th look on."""

    def __init__(self, n: int) -> None:
        super().__init__()
        self.left = n

    def is_set(self) -> bool:
        """Count a look."""
        self.left -= 1
        return self.left < 0


@pytest.mark.parametrize("exact", EXACT[:3])
def test_cancelled_amid_a_search(exact: str) -> None:
    """A long search looks at its clock every so many steps, stops when cancelled, and leaves nothing behind for the next."""
    blocked = np.random.default_rng(2).random((1200, 1200)) < 0.25
    blocked[0:3, 0:3] = True  # the goal is boxed in, so that everything must be searched
    blocked[1, 1] = blocked[600, 600] = False
    problem = Problem(Grid(blocked), (600, 600), (1, 1))
    plan = planner_of(exact)(problem, budget=Budget(cancel=_SetAtLook(2)))
    assert plan.status is Status.BUDGET
    assert 0 < plan.expanded <= 2 * (1 << 18)
    assert planner_of(exact)(problem).status is Status.NO_PATH


def test_bad_options(name: str) -> None:
    """An unknown planner, a bad seed or limit, and a problem that is none raise the error that names them."""
    problem = Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2))
    for options, field in (({"seed": -1}, "seed"), ({"seed": 0.5}, "seed"), ({"time_limit": -1.0}, "time_limit")):
        with pytest.raises(BadParameter, match=field):
            solve(problem, name, **options)
    for option in ("wings", "budget", "seconds"):
        with pytest.raises(BadParameter, match=f"{option} = 3.*left out"):
            solve(problem, name, **{option: 3})
    with pytest.raises(BadParameter, match="planner"):
        solve(problem, name + "x")
    with pytest.raises(BadParameter, match="problem"):
        solve((0, 0), name)
