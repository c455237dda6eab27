"""Problem, Budget, solve and plan check their input once, at the door (C9, C17, C22)."""

from __future__ import annotations

import copy
import math
import pickle
import threading

import numpy as np
import pytest

import antway
from antway import BadInput, BadParameter, Budget, CellBlocked, Grid, Moves, OutOfBounds, Plan, Problem, Status
from antway.errors import TooLarge
from antway.planning import TimedPath

OPEN = Grid(np.zeros((4, 5), dtype=bool), resolution=0.5)
NASTY: list[object] = [math.nan, math.inf, -math.inf, 1e308, -1, 10**30, True, "3", None, b"x", [], {}, 1 + 2j, ...]


@pytest.mark.parametrize("value", NASTY, ids=repr)
@pytest.mark.parametrize("place", ["start", "goal"])
def test_a_problem_refuses_bad_ends(place: str, value: object) -> None:
    """Whatever is no pair of integers on the map is a typed error that names the end."""
    for bad in (value, (value, 0), (0, value), (0, 0, 0)):
        ends: dict[str, object] = {"start": (0, 0), "goal": (1, 1), place: bad}
        with pytest.raises(BadInput) as caught:
            Problem(OPEN, **ends)  # type: ignore[arg-type]
        assert caught.value.field.startswith(place)
        assert caught.value.allowed in str(caught.value)


def test_a_problem_names_what_is_wrong_with_an_end() -> None:
    """Off the map and blocked are errors of their own; negative indices never wrap round."""
    with pytest.raises(OutOfBounds, match=r"goal = \(4, 0\)"):
        Problem(OPEN, (0, 0), (4, 0))
    with pytest.raises(OutOfBounds):
        Problem(OPEN, (-1, 0), (0, 0))
    with pytest.raises(CellBlocked):
        Problem(Grid(np.eye(3, dtype=bool)), (0, 0), (0, 1))
    with pytest.raises(BadParameter, match="goal = array"):
        Problem(OPEN, (0, 0), np.array(3))  # type: ignore[arg-type]


def test_ends_become_pairs_of_plain_integers() -> None:
    """Lists and integers of NumPy are cells as well, and can be used as keys afterwards."""
    for start, goal in (([0, 1], (2, 3)), ((0, 1), [2, 3]), (np.array((0, 1)), np.array((2, 3), np.uint8))):
        problem = Problem(OPEN, start, goal)  # type: ignore[arg-type]
        assert {problem.start: 1, problem.goal: 2} == {(0, 1): 1, (2, 3): 2}
        assert all(type(value) is int for value in problem.start + problem.goal)


def test_a_plan_in_metres_keeps_the_map_that_was_given() -> None:
    """Not the inflated one; a robot without a radius is a point."""
    assert antway.plan(OPEN, (1.0, 1.0), (1.6, 1.0), robot_radius=0.3).grid is OPEN
    assert antway.plan(Grid(np.zeros((1, 3), dtype=bool), 0.1), (0.05, 0.05), (0.25, 0.05)).length == pytest.approx(0.2)


def test_no_time_is_not_no_limit() -> None:
    """A limit of 0 s is spent at once; None never; a cancelled budget always."""
    assert Budget(seconds=0).start().spent()
    assert not Budget().start().spent() and not Budget(cycles=0).start().spent()
    cancel = threading.Event()
    clock = Budget(cancel=cancel).start()
    assert not clock.spent()
    cancel.set()
    assert clock.spent()


def test_unknown_planners_are_named() -> None:
    """An unknown name is refused with the list of those allowed."""
    for name in ("nope", 3, None):
        with pytest.raises(BadParameter, match="dijkstra"):
            antway.solve(Problem(OPEN, (0, 0), (1, 1)), planner=name)  # type: ignore[arg-type]


def with_any_options(problem: Problem, *, seed: int, budget: Budget, **options: object) -> Plan:
    """A planner of somebody else; it says how many options it was given."""
    return Plan(Status.NO_PATH, expanded=len(options))


def test_a_planner_that_takes_any_options_is_given_all_but_a_budget() -> None:
    """It checks them itself; the budget is made of the time limit."""
    problem, name = Problem(OPEN, (0, 0), (1, 1)), f"{__name__}:with_any_options"
    assert antway.solve(problem, name, wings=2, legs=4).expanded == 2
    with pytest.raises(BadParameter, match=r"budget = 3.*left out"):
        antway.solve(problem, name, budget=3)


@pytest.mark.parametrize("value", NASTY, ids=repr)
def test_plan_refuses_bad_metres(value: object) -> None:
    """Points and radii that are no finite numbers, or off the map, are typed errors."""
    for bad in (value, (value, 0.5)):
        with pytest.raises(BadInput):
            antway.plan(OPEN, bad, (0.5, 0.5), planner="dijkstra")  # type: ignore[arg-type]
    if value not in (1e308, 10**30):
        with pytest.raises(BadParameter) as caught:
            antway.plan(OPEN, (0.5, 0.5), (0.6, 0.6), robot_radius=value, planner="dijkstra")  # type: ignore[arg-type]
        assert caught.value.field == "robot_radius"


def test_a_robot_too_large_for_its_start_is_blocked() -> None:
    """A radius larger than the clearance of the start is a blocked start, not a path."""
    with pytest.raises(CellBlocked):
        antway.plan(OPEN, (0.3, 0.3), (2.0, 0.3), robot_radius=0.4, planner="dijkstra")


def test_every_error_is_one_of_the_tree_and_travels() -> None:
    """Each kind of wrong input is a BadInput and a ValueError, keeps its fields through pickling, and shortens long values."""
    for kind in (antway.BadMap, antway.BadScenario, BadParameter, OutOfBounds, CellBlocked, TooLarge):
        error = kind("field", "v" * 500, "short", where="file.yaml")
        assert isinstance(error, BadInput) and isinstance(error, ValueError)
        again = pickle.loads(pickle.dumps(error))
        assert type(again) is kind and str(again) == str(error) and len(str(error)) < 200


def test_arrays_of_answers_cannot_be_written() -> None:
    """A grid copies what it is given; grids and plans are read-only."""
    blocked = np.zeros((2, 2), dtype=bool)
    grid = Grid(blocked)
    blocked[0, 0] = True
    assert not grid.blocked.any()
    with pytest.raises(ValueError):
        grid.blocked[0, 0] = True
    plan = Plan(Status.FOUND, np.array([[0, 0]], np.int32), 0.0)
    with pytest.raises(ValueError):
        plan.cells[0, 0] = 1
    with pytest.raises(AttributeError):
        grid.resolution = 2.0  # type: ignore[misc]


def test_arrays_of_copies_cannot_be_written() -> None:
    """A plan that was pickled or copied is the same, and as read-only."""
    cells, points = np.array([[0, 0], [1, 1]], np.int32), np.array([[0.0, 0.0], [1.0, 1.0]])
    plan = Plan(Status.FOUND, cells, 0.7, optimal=True, expanded=3, points=points, grid=OPEN)
    timed = TimedPath(np.array([0.0, 1.0]), points.copy())
    for copied in (lambda one: pickle.loads(pickle.dumps(one)), copy.deepcopy):
        again, later = copied(plan), copied(timed)
        assert repr(again) == repr(plan) and again.expanded == 3 and (again.points == points).all()
        assert (again.grid.blocked == OPEN.blocked).all() and later.at(0.5) == timed.at(0.5)
        for array in (again.cells, again.points, later.t, later.xy):
            assert not array.flags.writeable


def test_plans_of_lists_are_refused() -> None:
    """A planner of a third party that returns lists is told which field must be an array."""
    with pytest.raises(BadParameter, match="cells"):
        Plan(Status.FOUND, [[0, 0]])  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match="points"):
        Plan(Status.FOUND, np.zeros((1, 2), np.int32), points=[[0.0, 0.0]])  # type: ignore[arg-type]


def test_times_of_a_path_do_not_fall() -> None:
    """A wait of no length and rounding are no fault; else a place in between would be none on the path."""
    assert TimedPath(np.array([0.0, 1.0, 1.0, 1.0 - 1e-9]), np.zeros((4, 2))).at(0.5) == (0.0, 0.0)
    with pytest.raises(BadParameter, match=r"t = 1\.5: must be increasing"):
        TimedPath(np.array([0.0, 2.0, 1.5, 3.0]), np.zeros((4, 2)))
    with pytest.raises(BadParameter, match=r"t = 0\.99999: must be increasing"):
        TimedPath(np.array([0.0, 1.0, 1.0 - 1e-5]), np.zeros((3, 2)))
    for t in ([0.0, math.nan, 3.0], [math.nan, 1.0], [math.nan]):
        with pytest.raises(BadParameter, match="t = nan: must be increasing"):
            TimedPath(np.array(t), np.zeros((len(t), 2)))


def test_a_path_without_knots_is_nowhere() -> None:
    """As that of a search in time that found none."""
    with pytest.raises(BadParameter, match="path = 'no knots'"):
        TimedPath(np.empty(0), np.empty((0, 2))).at(1.0)


def test_moves_name_their_offsets() -> None:
    """Offsets come in pairs of opposites, straight ones first, and 8, 16, 32 of them as named."""
    for moves, count in ((Moves.FOUR, 4), (Moves.EIGHT, 8), (Moves.SIXTEEN, 16), (Moves.THIRTY_TWO, 32)):
        rows = {tuple(row) for row in moves.offsets.tolist()}
        assert len(rows) == count == len(moves.lengths)
        assert all((-r, -c) in rows for r, c in rows)
        assert (moves.lengths[:4] == 1).all()


def test_a_plan_knows_its_metres_and_its_gap() -> None:
    """Cells become metres through the grid; the gap is 0 at the bound and infinite without one."""
    plan = Plan(Status.FOUND, np.array([[0, 0], [0, 1]], np.int32), 0.5, lower_bound=0.5)
    assert plan.xy(OPEN).tolist() == [[0.25, 0.25], [0.75, 0.25]]
    with pytest.raises(BadParameter, match="grid"):
        plan.xy(OPEN.blocked)  # type: ignore[arg-type]
    assert plan.gap == 0.0
    unproved = Plan(Status.FOUND, plan.cells, 0.5)
    assert unproved.gap == math.inf and repr(unproved).endswith("nothing proved)")
    assert repr(Plan(Status.FOUND, plan.cells[:1], 0.0, optimal=True)) == "Plan(found, 0.000 m, 1 cell, optimal)"
