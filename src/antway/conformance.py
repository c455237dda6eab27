"""The contract of policies and planners as a test that third parties can run on their own ones.

>>> from antway.conformance import check_policy
>>> from antway.baselines.replan import Follow
>>> check_policy(Follow)
"""

from __future__ import annotations

import inspect
import math
import random
import time
from collections.abc import Callable
from copy import deepcopy
from dataclasses import replace

import numpy as np

from antway import checks
from antway.errors import BadParameter, InvalidPlan
from antway.grid import Grid
from antway.planning import Budget, Plan, Planner, Problem, Status
from antway.verify import check_plan
from antway.world.episode import checked_command, run
from antway.world.motions import Bounce, Line
from antway.world.policy import Decision, Foresees, Observation, Policy, RobotSpec, Task, Tracks, as_policy
from antway.world.scenario import Scenario
from antway.world.sensor import Sensor
from antway.world.world import Obstacle, World

_SENSED = "id", "xy", "velocity", "radius"  # of the tracks of an observation
OVERRUN = 0.5  # s; by how much a planner may exceed its time limit, on a slow machine


def check_policy(make: Callable[[], Policy], *, seconds: float = 1.0) -> None:
    """Check that a policy keeps the contract.

    It must return finite commands in time, explain them, forget everything at `reset`, depend only on task, seed and
    observations, not use the global random state of NumPy or Python, and cope with what sensors deliver: no tracks, no
    velocities, old scans.

    Parameters
    ----------
    make : function
        Returns a new policy, for instance its class.
    seconds : float
        Time limit of a control cycle, except the first, s.

    Raises
    ------
    BadParameter
        For what cannot be called, makes no policy, or is no time limit.
    InvalidPlan
        With every breach found.
    """
    if not callable(make):
        raise BadParameter("make", make, "a function that returns a new policy, for instance its class")
    checks.number("seconds", seconds, low=0.0, unit="s")
    faults: list[str] = []
    scenario = _scenario()
    policy = _made(make)
    before = _global_state()
    first = run(scenario, policy, seed=1)
    if first.outcome.value == "error":
        raise InvalidPlan([f"fails in a room with a wall and two moving discs: {first.reason}"])
    if _global_state() != before:
        faults.append("global state: it changes the random state of NumPy or of Python")
    if first.trace is not None and not np.isfinite(first.trace.command).all():
        faults.append("commands: not all of them are finite, and the robot brakes then")
    if len(first.cycle_ms) > 1 and first.cycle_ms[1:].max() > 1e3 * seconds:
        faults.append(f"time limit: a cycle took {first.cycle_ms[1:].max():.0f} ms, more than {1e3 * seconds:g} ms")
    runs = {
        "reset: a second episode differs from the first": policy,
        "seeding: another instance gives other commands": _made(make),
    }
    for fault, player in runs.items():
        again = run(scenario, player, seed=1)
        assert first.trace is not None and again.trace is not None
        if not np.array_equal(first.trace.command, again.trace.command, equal_nan=True):
            faults.append(f"{fault}: {again.reason}" if again.outcome.value == "error" else fault)
    faults += _odd_observations(make, scenario.task)
    if faults:
        raise InvalidPlan(faults)


def _made(make: Callable[[], Policy]) -> Policy:
    """Return a new policy."""
    try:
        made: object = make()
    except Exception as error:  # any exception of a third party is reported
        raise InvalidPlan([f"it cannot be made: {type(error).__name__}: {error}"]) from error
    return as_policy(made)


def check_planner(planner: Planner) -> None:
    """Check that a planner keeps the contract: legal answers, no answer where there is none, seeds, budgets, global state.

    Parameters
    ----------
    planner : function (problem, *, seed, budget) -> Plan
        `seed` and `budget` are always given, so they need no defaults.

    Raises
    ------
    InvalidPlan
        With every breach found.
    """
    faults: list[str] = []
    open_, closed = np.zeros((2, 24, 24), np.bool_)
    open_[4:, 8], open_[:20, 16], closed[:, 12] = True, True, True
    problem = Problem(Grid(open_), (2, 2), (20, 21))
    try:
        inspect.signature(planner).bind(problem, seed=5, budget=Budget())
    except (TypeError, ValueError) as wrong:  # the second for what is built into Python
        raise InvalidPlan([f"it cannot be called as planner(problem, seed=5, budget=Budget()): {wrong}"]) from None
    before = _global_state()
    plans = [_answer(planner, problem, seed=seed) for seed in (5, 6, 5)]
    if _global_state() != before:
        faults.append("global state: it changes the random state of NumPy or of Python")
    faults += _plan_faults("", problem, plans[0], Status.FOUND)
    if not np.array_equal(plans[0].cells, plans[2].cells):
        faults.append("seeding: the same problem and seed have two answers")
    walled = Problem(Grid(closed), (2, 2), (2, 21))
    faults += _plan_faults("unreachable: ", walled, _answer(planner, walled), Status.NO_PATH)
    here = Problem(problem.grid, (2, 2), (2, 2))
    faults += _plan_faults("start at the goal: ", here, _answer(planner, here), Status.FOUND)
    started = time.perf_counter()
    late = _answer(planner, problem, seconds=0.0)
    if time.perf_counter() - started > OVERRUN:
        faults.append("time limit: it goes on after its time is spent")
    faults += _plan_faults("out of budget: ", problem, late, late.status)
    if faults:
        raise InvalidPlan(faults)


def _answer(planner: Planner, problem: Problem, *, seed: int = 5, seconds: float | None = None) -> Plan:
    """Return the answer of a planner."""
    try:
        plan: object = planner(problem, seed=seed, budget=Budget(seconds=seconds))
    except Exception as error:  # any exception of a third party is reported
        raise InvalidPlan([f"it raises {type(error).__name__}: {error}"]) from error
    if not isinstance(plan, Plan):
        raise InvalidPlan([f"it returns {plan!r:.60}, not a Plan"])
    return plan


def _plan_faults(what: str, problem: Problem, plan: Plan, status: Status) -> list[str]:
    if plan.status is not status:
        return [f"{what}its status is {plan.status.value}, not {status.value}"]
    try:
        check_plan(problem, plan)
    except InvalidPlan as error:
        return [f"{what}{violation}" for violation in error.violations]
    return []


def _scenario() -> Scenario:
    walls = np.zeros((40, 40), np.bool_)
    walls[12:28, 18:22] = True
    obstacles = (Obstacle(0.3, Bounce((6.0, 1.5), 0.5, 1.0)), Obstacle(0.4, Line((7.0, 6.5), (1.0, 6.5), 0.6, 2.0)))
    return Scenario(
        World(Grid(walls, 0.2), obstacles),
        (1.1, 4.1),
        (6.9, 4.1),
        RobotSpec(),
        Sensor(noise=0.02),
        horizon=20.0,
        name="conformance",
    )


def _odd_observations(make: Callable[[], Policy], task: Task) -> list[str]:
    """Show a new policy the unusual observations that sensors deliver."""
    tracks = Tracks(np.array([3, 9]), np.array([[3.0, 4.0], [5.0, 1.0]]), np.zeros((2, 2)), np.array([0.3, 0.4]))
    typical = Observation(0.0, task.start, (0.0, 0.0), 0.0, tracks)
    unknown = replace(tracks, velocity=np.full((2, 2), math.nan))
    unusual = {
        "no tracks": replace(typical, tracks=Tracks.none()),
        "NaN: unknown velocities": replace(typical, tracks=unknown),
        "an old scan": replace(typical, t=2.0, stamp=1.0),
        "no scan yet": replace(typical, tracks=Tracks.none(), stamp=-math.inf),
        "an obstacle in contact": replace(typical, tracks=replace(tracks, xy=np.array([task.start, (5.0, 1.0)]))),
    }
    faults = []
    for name, unchanged in unusual.items():
        policy, observation = _made(make), deepcopy(unchanged)
        if isinstance(policy, Foresees):
            policy.foresee(_scenario().world.timeline(0, 20.0))
        try:
            policy.reset(task, 0)
            command = checked_command(policy.act(observation))
            decision = policy.explain()
        except Exception as error:  # any exception of a third party is reported
            faults.append(f"{name}: {type(error).__name__}: {error}")
            continue
        seen, before = observation.tracks, unchanged.tracks
        if not all(np.array_equal(getattr(seen, part), getattr(before, part), equal_nan=True) for part in _SENSED):
            faults.append(f"{name}: it changes the observation, which others use as well")
        if command is not None and not all(math.isfinite(part) for part in command.velocity):
            faults.append(f"{name}: its command {command.velocity} is not finite")
        if not isinstance(decision, Decision):
            faults.append(f"{name}: explain() returns no Decision")
    return faults


def _global_state() -> tuple[object, ...]:
    name, keys, *rest = np.random.get_state(legacy=True)  # noqa: NPY002 - the old global state is what is watched
    return random.getstate(), name, np.asarray(keys).tobytes(), tuple(rest)
