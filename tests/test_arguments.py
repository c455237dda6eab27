"""Every argument of the public functions and records, given values of every wrong kind: a typed error, or it is accepted."""

from __future__ import annotations

import inspect
import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numpy as np
import pytest

import antway
from antway import POLICIES, Grid, Plan, Problem, RobotSpec, Tracks, load_scenario, make_policy, plan, plan_tour, run, solve
from antway.ants.tsp import Tsp
from antway.errors import BadInput, BadParameter, InvalidPlan
from antway.tours.time_windows import Tsptw
from antway.world.policy import Foresees

WRONG = (
    *(np.zeros(3), np.array(3.0), np.zeros((0, 2)), np.array(["a"]), np.array(["a", "b"]), np.array([None])),
    *(3, -1, True, 10**400, 2.5, float("nan"), float("inf"), 1j),
    *("x", "", "\ud800", b"x", None, object(), int, {"a": 1}, {1}, [1], [[1, 2], [3]], (1, 2, 3), ()),
)
SQUARE = Grid(np.zeros((8, 8), dtype=bool))
CORNERS = Problem(SQUARE, (0, 0), (7, 7))
IN_METRES: dict[str, Any] = {"grid": SQUARE, "start": (0.5, 0.5), "goal": (7.5, 7.5)}
POINTS = np.random.default_rng(0).random((8, 2))
NOBODY = Tracks(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
PAPER = load_scenario("paper")
WINDOWS = Tsptw(np.ones((4, 4)) - np.eye(4), np.array([[0.0, 99.0]] * 4))
FREE = ("options", "progress")  # are passed on, or called


def _path() -> Plan:
    return plan(**IN_METRES)


# Right arguments, of which one at a time is replaced.
RIGHT: dict[str, Callable[[], dict[str, Any]]] = {
    "explore": lambda: {"problem": CORNERS, "cycles": 1, "ants": 2},
    "alternatives": lambda: {"problem": CORNERS, "cycles": 1, "ants": 2},
    "pareto": lambda: {"problem": CORNERS, "cycles": 1, "ants": 2},
    "solve_tsp": lambda: {"instance": Tsp(POINTS), "cycles": 1},
    "solve_tsptw": lambda: {"instance": WINDOWS, "cycles": 1, "seconds": 0.1},
    "plan_tour": lambda: IN_METRES | {"stops": [(1.5, 1.5), (6.5, 2.5)], "cycles": 1},
    "distance_field": lambda: {"grid": SQUARE, "goal": (3, 3)},
    "solve_many": lambda: {"grid": SQUARE, "starts": [(0, 0)], "goals": [(7, 7)]},
    "sipp": lambda: IN_METRES | {"radius": 0.3, "v_max": 1.0},
    "smooth": lambda: {"path": _path(), "robot": RobotSpec(), "trials": 1},
    "plan": lambda: IN_METRES,
    "solve": lambda: {"problem": CORNERS},
    "run": lambda: {"scenario": PAPER, "policy": "stop", "horizon": 0.2},
    "show": lambda: {"record": _path(), "browser": False},
    "to_dataframe": lambda: {"table": _path()},
    "make_policy": lambda: {"name": "stop"},
    "load_map": lambda: {"path": "office"},
    "load_scenario": lambda: {"path": "paper"},
    "load_tsp": lambda: {"path": "none.tsp"},
    "load_costs": lambda: {"path": "none.yaml"},
    "load_scen": lambda: {"path": "none.scen"},
    "load_tsptw": lambda: {"path": "none.txt"},
    "save_map": lambda: {"grid": SQUARE, "path": os.devnull},
    "check_plan": lambda: {"problem": CORNERS, "plan": solve(CORNERS)},
    "check_tour": lambda: {"tour": plan_tour(SQUARE, (0.5, 0.5), [(1.5, 1.5)], cycles=1)},
    "check_episode": lambda: {"episode": run(PAPER, "stop", horizon=0.2)},
    "check_motion": lambda: {"grid": SQUARE, "robot": RobotSpec(), "motion": None},
    "check_tsptw": lambda: {"instance": WINDOWS, "order": [1, 2, 3]},
    "Grid": lambda: {"blocked": np.zeros((3, 3), bool)},
    "Scenario": lambda: {"world": PAPER.world, "start": PAPER.start, "goal": PAPER.goal},
    "World": lambda: {"grid": SQUARE},
    "RobotSpec": dict,
    "Task": lambda: IN_METRES | {"robot": RobotSpec()},
    "Tracks": lambda: {"id": np.zeros(1, int), "xy": np.zeros((1, 2)), "velocity": np.zeros((1, 2)), "radius": np.ones(1)},
    "Observation": lambda: {"t": 0.0, "xy": (1.0, 1.0), "velocity": (0.0, 0.0), "heading": 0.0, "tracks": NOBODY},
    "Command": dict,
    "Budget": dict,
    "Problem": lambda: {"grid": SQUARE, "start": (0, 0), "goal": (7, 7)},
    "TimedPath": lambda: {"t": np.arange(2.0), "xy": np.zeros((2, 2))},
}


@pytest.mark.parametrize("name", RIGHT)
@pytest.mark.filterwarnings("ignore::antway.maps.ResolutionWarning")
def test_wrong_arguments_end_in_typed_errors(name: str, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """C16: each argument in turn is of a wrong kind; whatever is refused is refused by a `BadInput`."""
    monkeypatch.chdir(tmp_path)
    function, right = getattr(antway, name), RIGHT[name]()
    if name == "plan_tour":
        del right["goal"]
    untyped = []
    for argument in inspect.signature(function).parameters:
        for wrong in WRONG if argument not in FREE else ():
            try:
                with suppress(BadInput, InvalidPlan):
                    function(**{**right, argument: wrong})
            except Exception as error:
                untyped.append(f"{argument}={wrong!r}: {error!r}")
    assert not untyped


def test_policies_refuse_what_is_no_task_or_no_seed() -> None:
    """So does each policy at its reset."""
    task, timeline = PAPER.task, PAPER.world.timeline(0, 1.0)
    for name in POLICIES:
        for wrong in ((3, 0), (None, 0), (task, -1), (task, 0.5), (task, "x")):
            policy = make_policy(name)
            if isinstance(policy, Foresees):
                policy.foresee(timeline)
            with pytest.raises(BadParameter, match="seed" if wrong[0] is task else "task"):
                policy.reset(*wrong)


def test_a_plan_refuses_an_option_that_is_an_argument_of_solve() -> None:
    """`plan` makes the problem itself."""
    with pytest.raises(BadParameter, match="problem"):
        plan(**IN_METRES, problem=3)


def test_nothing_public_is_left_out() -> None:
    """All functions and records of the package but those that hold results are tested here."""
    results = {
        "Decision",
        "EpisodeResult",
        "Plan",
        "Outcome",
        "Status",
        "Policy",
        "Moves",
        "PLANNERS",
        "POLICIES",
        "__version__",
    }
    errors = {
        one for one in antway.__all__ if isinstance(getattr(antway, one), type) and issubclass(getattr(antway, one), Exception)
    }
    assert set(antway.__all__) - results - errors == set(RIGHT)
