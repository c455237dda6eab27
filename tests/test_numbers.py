"""C17: every public parameter, by its signature, meets what is no number; it is refused by name or has a stated meaning."""

from __future__ import annotations

import enum
import importlib
import inspect
import math
import random
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import antway
from antway import Grid, Problem, RobotSpec, Status, World, distance_field, explore, sipp, solve, solve_tsp
from antway.ants.tsplib import Tsp
from antway.errors import BadInput, InvalidPlan
from antway.tours.time_windows import Tsptw
from antway.world.motions import Line

NASTY: list[Any] = [math.nan, math.inf, -math.inf, -0.0, 1e308, 10**400, -(10**30), True, "x", None]

# Answers and observations: antway makes them, and nobody hands them in but policies, whose commands the world reads with care.
RECORDS = "Plan TimedPath EpisodeResult Command Decision Observation Tracks"
# A protocol, and what takes whole objects alone.
NO_NUMBERS = "Policy check_plan check_episode check_motion run make_policy"
PARTS = {
    "antway.ants.front": "pareto alternatives",
    "antway.ants.gridpath": "ants explore",
    "antway.ants.immune": "Immune",
    "antway.ants.persistence": "Constant Adaptive Decay ByQuality",
    "antway.ants.rules": "AntSystem ElitistAntSystem RankBasedAntSystem MaxMinAntSystem AntColonySystem",
    "antway.ants.timed_front": "timed_front exact_front",
    "antway.ants.tsplib": "Tsp",
    "antway.arena.metrics": "wilson bootstrap time_ratio path_ratio real_difference",
    "antway.arena.suites": "load_suite episodes",
    "antway.arena.gym": "CrossingEnv",
    "antway.policies.guard": "Guard",
    "antway.policies.paper.policy": "PaperPolicy",
    "antway.policies.antway.policy": "AntwayPolicy",
    "antway.maps": "Limits",
    "antway.baselines.dwa": "Dwa",
    "antway.baselines.neural": "Neural Glasius",
    "antway.baselines.orca": "Orca",
    "antway.baselines.potential_field": "PotentialField",
    "antway.baselines.replan": "Stop Sipp Replan DStarLite",
    "antway.search.anyangle": "anyangle",
    "antway.search.astar": "astar",
    "antway.search.costs": "inflation_costs path_cost",
    "antway.search.distance_field": "dijkstra",
    "antway.search.dstarlite": "dstarlite DStarLite",
    "antway.search.jps": "jps",
    "antway.search.sipp": "Sipp",
    "antway.trajectory.profile": "stop_at_corners",
    "antway.world.motions": "Line BackAndForth Waypoints Bounce RandomWalk Replay",
    "antway.world.sensor": "Sensor",
    "antway.world.world": "Obstacle",
}

GRID = Grid(np.zeros((6, 6), dtype=bool))
WINDOWS = Tsptw([[0, 2, 2], [2, 0, 1], [2, 1, 0]], [[0, 10], [0, 9], [0, 3]])
PATH = [(0.5, 0.5), (4.5, 0.5), (4.5, 4.5)]
SOUND: dict[str, Any] = {  # by parameter, where it has no default
    "xy": [(0, 0), (1, 0), (1, 1), (0, 1)], "blocked": GRID.blocked, "grid": GRID, "world": World(GRID),
    "problem": Problem(GRID, (0, 0), (4, 4)),
    "robot": RobotSpec(), "start": (1, 1), "goal": (4, 4), "starts": [(1, 1)], "goals": [(4, 4)], "path": "nowhere.map",
    "instance": Tsp(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0], [2.0, 3.0]])),
    "radius": 0.3, "v_max": 1.0, "a_max": 1.0, "speed": 0.5, "end": (4.0, 4.0), "points": PATH, "t": (0.0, 1.0, 2.0),
    "motion": Line((1.0, 1.0), (2.0, 2.0), 0.5), "count": 2, "total": 4, "values": [1.0, 2.0], "time": [1.0], "bound": [1.0],
    "length": [1.0], "shortest": [1.0], "a": [1.0, 2.0], "b": [1.0, 3.0], "spec": "paper",
    "cells": [(0, 0), (0, 1)], "costs": np.ones((6, 6)), "inflation_radius": 1.0, "name": "stop",
}  # fmt: skip


def _callables() -> Iterator[tuple[str, Callable[..., Any]]]:
    apart = {*RECORDS.split(), *NO_NUMBERS.split(), "__version__", "PLANNERS", "POLICIES"}
    for name in antway.__all__:
        value = getattr(antway, name)
        if name not in apart and not (inspect.isclass(value) and issubclass(value, (Exception, enum.Enum))):
            yield name, value
    for module, names in PARTS.items():
        for name in names.split():
            yield f"{module.removeprefix('antway.')}.{name}", getattr(importlib.import_module(module), name)


CALLABLES = dict(_callables())

OWN: dict[str, dict[str, Any]] = {
    "show": {"record": GRID, "browser": False},
    "to_dataframe": {"table": []},
    "plan": {"start": (0.5, 0.5), "goal": (4.5, 4.5)},
    "sipp": {"start": (0.5, 0.5), "goal": (4.5, 4.5)},
    "search.sipp.Sipp": {"goal": (4.5, 4.5)},
    "Scenario": {"start": (0.5, 0.5), "goal": (4.5, 4.5)},
    "Task": {"start": (0.5, 0.5), "goal": (4.5, 4.5)},
    "solve_tsp": {"seconds": 0.0, "tours": 5},
    "smooth": {"path": antway.plan(GRID, (0.5, 0.5), (4.5, 4.5)), "trials": 2},
    "ants.tsplib.Tsp": {"xy": PATH},
    "search.costs.inflation_costs": {"radius": 0.3},
    "plan_tour": {"start": (0.5, 0.5), "stops": [(4.5, 4.5), (2.5, 0.5)], "cycles": 2},
    "check_tour": {"tour": antway.plan_tour(GRID, (0.5, 0.5), [(4.5, 4.5), (2.5, 0.5)], cycles=2)},
    "solve_tsptw": {"instance": WINDOWS, "cycles": 2},
    "check_tsptw": {"instance": WINDOWS, "order": [0, 2, 1]},
    "world.motions.Line": {"start": (1.0, 1.0)},
    "world.motions.Bounce": {"start": (1.0, 1.0)},
}
# How an error may call what it is about, where that is not the parameter's name.
NAMED = {
    "path": r"path|file|suffix|scenario",
    "spec": r"suite",
    "count": r"count|episodes",
    "hi": r"lo",  # the pair is out of order
    "robot_radius": r"robot_radius|start",
    "matrix": r"matrix|xy",
}


def sound(name: str, function: Callable[..., Any]) -> dict[str, Any]:
    """Arguments with which the call succeeds (or, for files, fails on one that is not there)."""
    needed = [key for key, parameter in inspect.signature(function).parameters.items() if parameter.default is parameter.empty]
    return {key: SOUND.get(key) for key in needed if key != "options"} | OWN.get(name, {})


def has_meaning(parameter: inspect.Parameter, value: Any, text: str) -> bool:
    """Whether the signature and the docstring give the value a meaning."""
    kind = str(parameter.annotation)
    if value is None or isinstance(value, (str, bool)):
        return value is parameter.default or {None: "None", True: "bool"}.get(value, "str") in kind
    if math.isnan(value) or value in (-math.inf, 10**400):
        return False
    if value == math.inf:
        return "infinite" in text or "inf" in text.split() or parameter.default == math.inf
    return "float" in kind or "Span" in kind or "ArrayLike" in kind


def outcome(function: Callable[..., Any], arguments: dict[str, Any]) -> BadInput | None:
    """The error that the call raises, if any; none other than a `BadInput` is let through."""
    try:
        function(**arguments)
    except BadInput as error:
        return error
    except InvalidPlan:  # which is an answer
        return None
    return None


@pytest.mark.parametrize("name", CALLABLES)
def test_what_is_no_number_is_refused_by_name(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each nasty value of each parameter raises a `BadInput` with name, value and what is allowed, unless it has a meaning."""
    monkeypatch.chdir(tmp_path)
    function = CALLABLES[name]
    text = str(inspect.getdoc(function))
    arguments = sound(name, function)
    expected = outcome(function, arguments)
    assert expected is None or "nowhere" in str(expected), expected
    for key, parameter in inspect.signature(function).parameters.items():
        for value in NASTY if parameter.kind is not parameter.VAR_KEYWORD else []:
            error = outcome(function, arguments | {key: value})
            if error is None or value is parameter.default or (value == "x" and "str" in str(parameter.annotation)):
                assert error is not None or has_meaning(parameter, value, text), f"{name}({key}={value!r}) is taken"
                continue
            assert re.search(f"{key}|{NAMED.get(key, key)}", error.field), f"{name}({key}={value!r}): {error}"
            shown = repr(value)[:15] in str(error) or re.search("shape|not both", str(error))
            assert shown, f"{name}({key}={value!r}): {error}"
            assert error.allowed


@pytest.mark.parametrize("name", CALLABLES)
def test_zero_has_no_sign(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What holds of 0.0 holds of -0.0."""
    monkeypatch.chdir(tmp_path)
    function = CALLABLES[name]
    arguments = sound(name, function)
    for key in inspect.signature(function).parameters.keys() - {"options"}:
        errors = [outcome(function, arguments | {key: zero}) for zero in (0.0, -0.0)]
        assert type(errors[0]) is type(errors[1]), key


def test_global_randomness_is_untouched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """C33: no public function moves the states of `random` and of `numpy.random`."""
    monkeypatch.chdir(tmp_path)
    for name, function in CALLABLES.items():
        before = random.getstate(), np.random.get_state()[1].tobytes()  # noqa: NPY002
        outcome(function, sound(name, function))
        assert (random.getstate(), np.random.get_state()[1].tobytes()) == before, name  # noqa: NPY002


def test_everything_public_is_asked() -> None:
    """No public name is left out but answers, errors, enumerations and tables."""
    asked = {*CALLABLES, *RECORDS.split(), *NO_NUMBERS.split(), "__version__", "PLANNERS", "POLICIES"}
    rest = [getattr(antway, name) for name in set(antway.__all__) - asked]
    assert all(issubclass(one, (Exception, enum.Enum)) for one in rest)


def test_none_of_it_is_not_no_limit() -> None:
    """A limit of 0 is a limit, None is none."""
    grid = Grid(np.zeros((30, 30), dtype=bool))
    problem = Problem(grid, (0, 0), (29, 29))
    for planner in ("dijkstra", "astar", "jps", "dstarlite", "ants"):
        assert solve(problem, planner, time_limit=0).status is Status.BUDGET
        assert solve(problem, planner, time_limit=None).status is Status.FOUND
    assert explore(problem, cycles=0).plan.status is Status.BUDGET
    ends = {"start": (0.5, 0.5), "goal": (9.5, 9.5), "radius": 0.3, "v_max": 1.0}
    assert sipp(grid, **ends, max_expanded=0).status is Status.BUDGET
    assert sipp(grid, **ends, max_expanded=None).status is Status.FOUND
    assert np.isfinite(distance_field(grid, (0, 0), within=0.0)).sum() <= 9 < np.isfinite(distance_field(grid, (0, 0))).sum()
    assert solve_tsp(SOUND["instance"], tours=0).tours == 0 < solve_tsp(SOUND["instance"], tours=20).tours


@pytest.mark.parametrize("kind", [np.uint8, np.int8])
@pytest.mark.filterwarnings("error")
def test_small_integers_of_numpy_count_as_what_they_are(kind: type) -> None:
    """Products of the numbers of ants and cycles, and sums with a limit of steps, used to overflow."""
    problem = Problem(Grid(np.zeros((12, 12), bool)), (0, 0), (11, 11))
    cities = Tsp(np.random.default_rng(0).random((40, 2)))

    def answers(kind: type) -> list[Any]:
        found = explore(problem, ants=kind(100), cycles=kind(20), step_limit=kind(20), threads=kind(2), seed=kind(120))
        tour = solve_tsp(cities, tours=kind(120), ants=kind(7), candidates=kind(10))
        return [found.plan.length, found.history.tolist(), tour.length, tour.tours]

    np.testing.assert_equal(answers(kind), answers(int))
