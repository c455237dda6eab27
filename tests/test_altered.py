"""Recorded episodes that somebody altered are refused, and the check names what is wrong (C8)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from antway import EpisodeResult, Grid, InvalidPlan, Outcome, RobotSpec, Scenario, World, check_episode, run
from antway.world.motions import Line
from antway.world.policy import Command, Decision
from antway.world.timeline import Timeline
from antway.world.trace import Trace
from antway.world.world import Obstacle

WHEELS = RobotSpec(drive="differential", a_max=1.0, turn_rate=2.0, alpha_max=3.0)


class Straight:
    """Drives along x at full speed."""

    def reset(self, task, seed) -> None:
        pass

    def act(self, o) -> Command:
        return Command((1.0, 0.0))

    def explain(self) -> Decision:
        return Decision("follow", "drives on")


@cache
def drive(robot: RobotSpec) -> EpisodeResult:
    """An episode of 4 s in an empty hall, in which a robot drives from (0.5, 0.5) m along x."""
    hall = World(Grid(np.zeros((4, 40), dtype=bool), 0.25))
    return run(Scenario(hall, (0.5, 0.5), (9.0, 0.5), robot, horizon=4.0), Straight())


def bent(trace: Trace, field: str, change: float, row: int = 20) -> dict[str, Any]:
    values = np.array(getattr(trace, field))
    values[row] += change
    return {field: values}


def without_rows(trace: Trace, left: int) -> dict[str, Any]:
    """The first `left` rows of the record."""
    steps = max(left - 1, 0)
    rows = {name: getattr(trace, name)[:left].copy() for name in ("t", "xy", "velocity", "heading", "turn_rate", "sensed")}
    return {**rows, "command": trace.command[:steps].copy(), "cycle_ms": trace.cycle_ms[:steps].copy(), "decisions": ()}


def jumps(trace: Trace) -> dict[str, Any]:
    xy = trace.xy.copy()
    xy[20:] += (2e-5, 0.0)
    return {"xy": xy}


def other_robot(trace: Trace, **changes: float) -> dict[str, Any]:
    return {"task": replace(trace.task, robot=replace(trace.task.robot, **changes))}


ALTERED: dict[str, Callable[[Trace], dict[str, Any]]] = {
    r"xy is not finite in row 20": lambda t: bent(t, "xy", math.nan),
    r"velocity is not finite in row 20": lambda t: bent(t, "velocity", math.inf),
    r"heading is not finite in row 20": lambda t: bent(t, "heading", math.nan),
    r"turn_rate is not finite in row 20": lambda t: bent(t, "turn_rate", math.nan),
    r"cycle_ms is not finite in row 20": lambda t: bent(t, "cycle_ms", math.nan),
    r"times do not increase": lambda t: bent(t, "t", -0.1),
    r"control period apart": lambda t: bent(t, "t", 1e-3),
    r"a place is not where its command leads": jumps,
    r"is faster than v_max or v_reverse: 1 m/s at 1.* s": lambda t: other_robot(t, v_max=1.0 - 1e-5),
    r"not at the start": lambda t: {"task": replace(t.task, start=(0.5 + 1e-7, 0.5))},
    r"does not begin at rest, but with \[0.1, 0.1\] m/s": lambda t: bent(t, "velocity", 0.1, row=0),
    r"t has the shape \(0,\) in place of \(1,\)": lambda t: without_rows(t, 0),
    r"claims to have run out of time": lambda t: without_rows(t, 1),
    r"claims to have reached the goal from 8\.5 m away; the tolerance is": lambda t: (
        without_rows(t, 1) | {"outcome": Outcome.REACHED}
    ),
    r"claims a contact with a wall": lambda t: {"outcome": Outcome.HIT_WALL},
    r"and the robot was not braked": lambda t: without_rows(t, 20) | {"outcome": Outcome.ERROR},
    r"goes on to 4 s, and its horizon is 2 s": lambda t: {"config": {**t.config, "horizon": 2.0}},
    r"goes on to 4 s, and its horizon is nan s": lambda t: {"config": {**t.config, "horizon": math.nan}},
    r"horizon is no number": lambda t: {"config": {**t.config, "horizon": "4"}},
    r"config is no table": lambda t: {"config": None},
    r"outcome 'timeout' is not an Outcome": lambda t: {"outcome": "timeout"},
    r"sensed is no array of booleans": lambda t: {"sensed": 2 * t.sensed.astype(int)},
    r"\(0, None\) is not the number of a step": lambda t: {"decisions": ((0, None),)},
    r"3 is not the number of a step": lambda t: {"decisions": (3,)},
    r"goes on after it passed the goal": lambda t: {
        "task": replace(t.task, goal=tuple((0.5 * (t.xy[20] + t.xy[21])).tolist()), goal_tolerance=0.01)
    },
    r"goes on after it reached the goal": lambda t: {"task": replace(t.task, goal=tuple((t.xy[-1]).tolist()))},
}


@pytest.mark.parametrize("robot", [WHEELS, RobotSpec(a_max=1.0, latency=0.05)], ids=["wheels", "holonomic"])
@pytest.mark.parametrize("what", ALTERED)
def test_altered_episodes_are_refused(what: str, robot: RobotSpec) -> None:
    """A jump of 20 micrometres, a speed a little above the limit, a NaN, a row too few, a false end."""
    trace = drive(robot).trace
    if robot.drive == "holonomic":
        what, alter = what.replace(" or v_reverse", ""), ALTERED[what]
        what = what.replace("does not begin at rest, but with [0.1, 0.1] m/s", "does not begin at rest")
    else:
        alter = ALTERED[what]
    with pytest.raises(InvalidPlan, match=what):
        check_episode(replace(trace, **alter(trace)))


def test_results_that_contradict_their_trace_are_refused() -> None:
    """In any of their figures, in words and in the times of cycles."""
    result = drive(WHEELS)
    check_episode(result)
    wrong: dict[str, Any] = {
        "time": math.nan, "length": math.nan, "min_clearance": math.nan, "waits": 5, "replans": 1, "reason": "it is there",
        "cycle_ms": result.cycle_ms + 1.0, "outcome": Outcome.REACHED, "config": {},
    }  # fmt: skip
    for field, value in wrong.items():
        with pytest.raises(InvalidPlan, match=field):
            check_episode(replace(result, **{field: value}))
    for field, value in {"time": "3", "length": None, "min_clearance": None}.items():
        with pytest.raises(InvalidPlan, match=f"{field} .* is not of type float"):
            check_episode(replace(result, **{field: value}))


@pytest.mark.parametrize("rates", [{}, {"a_max": 1.0}], ids=["at-once", "inertia"])
def test_a_contact_that_is_called_an_error_is_refused(rates: dict[str, float]) -> None:
    """Something that runs into a robot at rest ends the episode amid a control period, which no error and no horizon does."""

    class Stands(Straight):
        def act(self, o) -> Command:
            return Command((0.0, 0.0))

    comes = Obstacle(0.3, Line((6.03, 2.0), (1.0, 2.0), 1.0))
    hall = World(Grid(np.zeros((40, 80), dtype=bool), 0.1), (comes,))
    trace = run(Scenario(hall, (2.0, 2.0), (7.0, 2.0), RobotSpec(**rates), horizon=20.0), Stands()).trace
    assert trace.outcome is Outcome.HIT_STANDING
    check_episode(trace)
    for outcome, horizon in ((Outcome.ERROR, 20.0), (Outcome.TIMEOUT, float(trace.t[-1]))):
        with pytest.raises(InvalidPlan, match="ends amid a control period"):
            check_episode(replace(trace, outcome=outcome, config={**trace.config, "horizon": horizon}))


@pytest.mark.parametrize("kind", ["differential", "holonomic"])
def test_contacts_between_samples_are_seen(kind: str) -> None:
    """A robot of a fifth of a millimetre passes neither a wall nor an obstacle as thin, wherever the check takes samples."""
    small = RobotSpec(drive=kind, a_max=10.0, radius=1e-4, latency=0.1 if kind == "holonomic" else 0.0)
    hall = World(Grid(np.zeros((40, 2000), dtype=bool), 2.5e-4))
    trace = run(Scenario(hall, (0.1, 0.005), (0.49, 0.005), small, horizon=0.4, goal_tolerance=0.001), Straight()).trace
    check_episode(trace)
    grid = trace.task.grid
    for k in range(4):
        blocked = grid.blocked.copy()
        blocked[15:25, round((trace.xy[3, 0] + 0.03) / grid.resolution) + k] = True
        with pytest.raises(InvalidPlan, match="passes through a wall in step 3"):
            check_episode(replace(trace, task=replace(trace.task, grid=replace(grid, blocked=blocked))))
        when = 0.35 + 2e-4 * k
        x = float(np.interp(when, trace.t, trace.xy[:, 0]))
        flies = Timeline.of([7], [1e-4], [([when - 0.1, when + 0.1], [(x, -0.1), (x, 0.11)])])
        with pytest.raises(InvalidPlan, match="passes through obstacle 7 in step 3"):
            check_episode(replace(trace, timeline=flies, sensed=np.zeros((len(trace.t), 1), dtype=bool)))


@pytest.mark.parametrize(
    ("robot", "command"),
    [
        (RobotSpec(a_max=30.0, dt=0.5), Command((1.0, 0.3))),
        (RobotSpec(drive="differential", a_max=1.0, alpha_max=100.0, dt=0.5), Command(twist=(0.5, 1.5))),
        (RobotSpec(drive="ackermann", a_max=30.0, alpha_max=90.0, turning_radius=0.5, dt=0.5), Command(twist=(0.9, 1.5))),
    ],
)
def test_ramps_that_end_within_a_small_step_are_right(robot: RobotSpec, command: Command) -> None:
    """The check drives long periods in steps of 1.25 ms; quick ramps end within one of them."""

    class Turns(Straight):
        def act(self, o) -> Command:
            return command if round(o.t) % 2 else Command(twist=(0.1, -0.3)) if robot.wheels else Command((0.0, 0.2))

    hall = World(Grid(np.zeros((40, 40), dtype=bool), 0.25))
    check_episode(run(Scenario(hall, (4.0, 4.0), (9.0, 9.0), robot, horizon=4.0), Turns()))
