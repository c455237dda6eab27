"""Recorded episodes that somebody altered are refused, and the check names what is wrong (C8)."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from antway import EpisodeResult, Grid, InvalidPlan, Outcome, RobotSpec, Scenario, World, check_episode, run
from antway.planning import TimedPath
from antway.verify_motion import last_gaps, wall_gaps
from antway.verify_steps import step_gaps, wall_gap
from antway.world.motions import Line
from antway.world.policy import Command, Decision
from antway.world.timeline import Timeline
from antway.world.trace import Trace
from antway.world.world import Obstacle
from common import cases, costly

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


def bent(trace: Trace, field: str, change: float | np.ndarray, row: int = 20) -> dict[str, Any]:
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
    r"times do not increase from 0": lambda t: {"t": t.t + 1e-3},
    r"control period apart": lambda t: bent(t, "t", 1e-3),
    r"not the control period apart": lambda t: {"t": 0.999 * t.t},
    r"steps are not the control period apart": lambda t: bent(t, "t", 1e-3, row=-1),
    r"and 0\.1 rad/s": lambda t: bent(t, "turn_rate", 0.1, row=0),
    r"does not begin with its heading": lambda t: bent(t, "heading", -0.1, row=0),
    r"a cycle took less than 0 ms": lambda t: bent(t, "cycle_ms", -1e6),
    r"a decision stands outside": lambda t: {"decisions": ((-1, t.decisions[0][1]),)},
    r"\('0', Decision.* is not the number": lambda t: {"decisions": (("0", t.decisions[0][1]),)},
    r"claims a contact with an obstacle that it does not touch": lambda t: {"outcome": Outcome.HIT_MOVING},
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


class Weaves(Straight):
    """Drives velocities at random, some beyond the limit, some not finite, and replans now and then."""

    def reset(self, task, seed) -> None:
        self.rng, self.path = np.random.default_rng(seed), None

    def act(self, o) -> Command:
        if self.rng.random() < 0.3:
            self.path = TimedPath(np.arange(2.0), np.zeros((2, 2))) if self.rng.random() < 0.7 else None
        vx, vy = self.rng.normal(0.0, 1.0, 2).tolist()
        return Command((0.0, 0.0) if self.rng.random() < 0.1 else (vx, math.nan) if self.rng.random() < 0.1 else (vx, vy))

    def explain(self) -> Decision:
        return Decision("follow", "weaves", path=self.path)


STEPS = [
    RobotSpec(),
    RobotSpec(drive="differential", a_max=2.0, turn_rate=2.0, dynamics="steps"),
    RobotSpec(a_max=3.0, dynamics="steps"),
]


@pytest.mark.parametrize("robot", STEPS, ids=["at-once", "differential", "inertia"])
def test_steps_are_as_commanded(robot: RobotSpec) -> None:
    """Of robots that drive straight in each step: what is played passes, and what is off by three micrometres does not."""
    hall = World(Grid(np.zeros((100, 160), dtype=bool), 0.25))
    result = run(Scenario(hall, (20.0, 12.0), (30.0, 7.0), robot, horizon=6.0), Weaves(), seed=4)
    trace = result.trace
    check_episode(result)
    assert result.replans > 3 and result.waits > 1
    for change in ({"replans": result.replans + 1}, {"waits": result.waits - 1}):
        with pytest.raises(InvalidPlan, match=next(iter(change))):
            check_episode(replace(result, **change))
    stands = Timeline.of([7], [0.1], [([0.0, 9.0], np.tile(trace.xy[30], (2, 1)))])
    with pytest.raises(InvalidPlan, match="passes through obstacle 7 in step"):
        check_episode(replace(trace, timeline=stands, sensed=np.zeros((len(trace.t), 1), dtype=bool)))
    moves = np.hypot(*trace.velocity.T)
    for row in range(1, len(trace.t)):
        for field, off, what in (
            ("velocity", (3e-6, 0.0), "a velocity is not"),
            ("velocity", (0.0, -3e-6), "a velocity is not"),
            ("heading", 3e-6 * (-1) ** row, "a heading is not"),
            ("turn_rate", 3e-6, "states turn rates"),
            ("xy", (-3e-6, 0.0), "a place is not"),
            ("xy", (0.0, 3e-6), "a place is not"),
        ):
            if robot.drive == "differential" or field != "heading" or moves[row] > 0.0:
                with pytest.raises(InvalidPlan, match=what):
                    check_episode(replace(trace, **bent(trace, field, off, row)))


@pytest.mark.parametrize("robot", [RobotSpec(), RobotSpec(a_max=1.0, latency=0.05)], ids=["steps", "ramps"])
def test_a_goal_is_passed_within_its_tolerance_alone(robot: RobotSpec) -> None:
    """Wherever within a step it is nearest; behind the start it is not."""
    trace = drive(robot).trace
    middle = trace.xy[20] + 0.3 * (trace.xy[21] - trace.xy[20])
    for place, off, passed in (
        *((middle, (0.0, off), abs(off) < 0.01) for off in (0.00998, -0.00998, 0.010005, -0.010005)),
        *((trace.xy[0], (-0.010005, 0.0), False), (trace.xy[-1], (0.010005, 0.0), False)),
    ):
        goal = place + np.array(off)
        faults = ""
        try:
            check_episode(replace(trace, task=replace(trace.task, goal=tuple(goal.tolist()), goal_tolerance=0.01)))
        except InvalidPlan as error:  # also that the heading is not towards such a goal
            faults = str(error)
        assert ("goes on after it passed the goal" in faults) == passed, (goal, faults)


def test_a_goal_at_a_corner_within_a_step_is_passed() -> None:
    """The robot turns by a right angle half a period after its command, 35 mm from the line between the two places."""

    class Turns(Straight):
        def act(self, o) -> Command:
            return Command((1.0, 0.0) if o.t < 1.0 else (0.0, 1.0))

    hall = World(Grid(np.zeros((20, 40), dtype=bool), 0.25))
    trace = run(Scenario(hall, (0.5, 0.5), (9.0, 0.5), RobotSpec(latency=0.05), horizon=2.0), Turns()).trace
    for goal, passed in (((1.5, 0.5), True), ((1.5 - 0.04, 0.5 + 0.04), False)):
        with pytest.raises(InvalidPlan) as error:  # if only as the heading is not towards such a goal
            check_episode(replace(trace, task=replace(trace.task, goal=goal, goal_tolerance=0.01)))
        assert ("goes on after it passed the goal" in str(error.value)) == passed


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


def test_a_bar_that_turns_strikes_posts_between_samples() -> None:
    """Its end moves by centimetres from sample to sample, and bar and post are a fifth of a millimetre thick."""
    bar = RobotSpec(
        drive="differential", footprint=((0.0, -1e-4), (1.0, -1e-4), (1.0, 1e-4), (0.0, 1e-4)), turn_rate=6.0, dt=1.0
    )

    class Spins(Straight):
        def act(self, o) -> Command:
            return Command(twist=(0.0, 6.0))

    hall = World(Grid(np.zeros((20, 40), dtype=bool), 0.25))
    trace = run(Scenario(hall, (2.0, 2.0), (8.0, 2.0), bar, horizon=1.0), Spins()).trace
    check_episode(trace)
    for k in range(8):
        x, y = 2.0 + 0.9 * math.cos(1.0 + k / 300.0), 2.0 + 0.9 * math.sin(1.0 + k / 300.0)
        stands = Timeline.of([7], [1e-4], [([0.0], [(x, y)])])
        with pytest.raises(InvalidPlan, match="passes through obstacle 7 in step 0"):
            check_episode(replace(trace, timeline=stands, sensed=np.zeros((len(trace.t), 1), dtype=bool)))


@pytest.mark.parametrize(
    "robot",
    [
        RobotSpec(v_max=20.0, a_max=20.0, dt=0.5),
        RobotSpec(v_max=20.0, a_max=20.0, dt=0.5, drive="differential"),
        RobotSpec(v_max=4.0, a_max=4.0, dt=1.0, footprint=((-0.4, -0.3), (0.4, -0.3), (0.4, 0.3), (-0.4, 0.3))),
    ],
    ids=["disc", "wheels", "footprint"],
)
def test_the_least_distance_is_that_between_samples(robot: RobotSpec) -> None:
    """A fast robot passes somebody far between two samples; no figure may be wrong by more than its tolerance."""

    class Hurries(Straight):
        def act(self, o) -> Command:
            return Command((robot.v_max, 0.0), (robot.v_max, 0.0))

    hall = Grid(np.zeros((10, 100), dtype=bool))
    for k in range(costly(5, 100)):
        stands = (41.3 + 0.7 * k, 5.7)
        world = World(hall, (Obstacle(0.05, Line(stands, stands, 0.0)), Obstacle(0.1, Line((90.0, 6.0), (2.0, 5.8), 3.0))))
        result = run(Scenario(world, (3.0, 5.0), (97.0, 5.0), robot, horizon=30.0), Hurries())
        assert result.reached
        check_episode(result)
        for field, off in (("min_clearance", 2e-4), ("min_clearance", -2e-4), ("time", 5e-5), ("length", -5e-5)):
            with pytest.raises(InvalidPlan, match=f"^states {field} [^;]*$"):
                check_episode(replace(result, **{field: getattr(result, field) + off}))
    empty = replace(result.trace, **without_rows(result.trace, 1), outcome=Outcome.ERROR)
    check_episode(empty)


@pytest.mark.parametrize("kind", ["holonomic", "differential", "ackermann"])
def test_speeds_are_exact_however_quickly_they_change(kind: str) -> None:
    """Ramps of a millisecond end amid a small step, and no speed may be off by 1 % for that."""
    robot = RobotSpec(drive=kind, a_max=1000.0, brake_max=700.0, alpha_max=900.0, turning_radius=0.5 * (kind == "ackermann"))

    class Swerves(Straight):
        def act(self, o) -> Command:
            speed = 0.3 + 0.7 * (round(10.0 * o.t) % 3 == 0)
            return Command((speed, 0.5 - speed), (speed, 0.9 - speed))

    hall = World(Grid(np.zeros((20, 20), dtype=bool)))
    trace = run(Scenario(hall, (9.0, 9.0), (19.0, 9.0), robot, horizon=4.0), Swerves()).trace
    check_episode(trace)
    for row in (7, 8, -1):
        ahead = 0.01 * np.array((math.cos(trace.heading[row]), math.sin(trace.heading[row])))
        for field, off in (("velocity", ahead), ("velocity", -ahead), *((("turn_rate", 0.01),) if robot.wheels else ())):
            with pytest.raises(InvalidPlan, match="a speed is not what its command leads to"):
                check_episode(replace(trace, **bent(trace, field, off, row)))


@pytest.mark.parametrize("rates", [{}, {"a_max": 1.0}], ids=["at-once", "inertia"])
def test_a_contact_that_is_called_an_error_is_refused(rates: dict[str, float]) -> None:
    """Something that runs into a robot at rest ends the episode amid a control period, which no error and no horizon does."""

    class Stands(Straight):
        def act(self, o) -> Command:
            return Command((0.0, 0.0))

    comes, stays = Obstacle(0.3, Line((6.03, 2.0), (1.0, 2.0), 1.0)), Obstacle(0.3, Line((7.0, 3.5), (7.0, 3.5), 0.0))
    hall = World(Grid(np.zeros((40, 80), dtype=bool), 0.1), (comes, stays))
    trace = run(Scenario(hall, (2.0, 2.0), (7.0, 2.0), RobotSpec(**rates), horizon=20.0), Stands()).trace
    assert trace.outcome is Outcome.HIT_STANDING
    check_episode(trace)
    for outcome, horizon in ((Outcome.ERROR, 20.0), (Outcome.TIMEOUT, float(trace.t[-1]))):
        with pytest.raises(InvalidPlan, match="ends amid a control period"):
            check_episode(replace(trace, outcome=outcome, config={**trace.config, "horizon": horizon}))


@pytest.mark.parametrize(("kind", "radius"), [("differential", 1e-4), ("holonomic", 1e-4), ("holonomic", 4e-6)])
def test_contacts_between_samples_are_seen(kind: str, radius: float) -> None:
    """A robot of a fifth of a millimetre passes neither a wall nor an obstacle as thin, wherever the check takes samples."""
    small = RobotSpec(drive=kind, a_max=10.0, radius=radius, latency=0.1 if kind == "holonomic" else 0.0)
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
        was_there = Timeline.of([7], [1e-4], [([-1.0, -0.5], [trace.xy[0], (0.1, 0.1)])])
        check_episode(replace(trace, timeline=was_there, sensed=np.zeros((len(trace.t), 1), dtype=bool)))
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


@pytest.mark.parametrize("kind", ["holonomic", "differential"])
def test_a_command_that_would_act_after_the_contact_does_not_act(kind: str) -> None:
    """Speeds change at once, half a period late, and the robot is stopped by a wall in the first half of a period."""
    robot, early = RobotSpec(drive=kind, latency=0.05, footprint=((-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1))), 0

    class Changes(Straight):
        def act(self, o) -> Command:
            speed = 1.0 - 0.5 * (round(10.0 * o.t) % 2)
            return Command((speed, 0.0), (speed, 1e-3 * speed))

    blocked = np.zeros((4, 40), dtype=bool)
    blocked[:, 12] = True
    for k in range(5):
        result = run(Scenario(World(Grid(blocked, 0.25)), (0.5 + 0.02 * k, 0.5), (9.0, 0.5), robot, horizon=9.0), Changes())
        assert result.outcome is Outcome.HIT_WALL
        check_episode(result)
        early += result.time % 0.1 < 0.05
    assert 0 < early < 5


@pytest.mark.parametrize("turn", range(4))
def test_a_step_past_a_corner_is_as_near_as_the_corner(turn: int) -> None:
    """Of all four corners of a cell; both ends of the step are far away."""
    blocked, robot = np.zeros((9, 9), dtype=bool), RobotSpec(radius=0.1)
    blocked[4, 4] = True
    c, s = math.cos(0.5 * math.pi * turn), math.sin(0.5 * math.pi * turn)
    xy = 4.5 + np.array([(-0.5, 1.5), (1.5, -0.5)]) @ [(c, s), (-s, c)] + 0.1 * np.array([(c - s, s + c)])
    trace: Any = SimpleNamespace(xy=xy, task=SimpleNamespace(grid=Grid(blocked), robot=robot))
    assert wall_gap(trace, 0) == pytest.approx(0.1 * math.sqrt(2.0) - 0.1)


def depth(grid: Grid, places: np.ndarray) -> float:
    """The least distance of points [N, 2] to blocked cells and to what is off the map, m; the negative depth off the map."""
    size, (rows, cols) = grid.resolution, grid.shape
    x, y = (places - grid.origin[:2]).T
    least = np.min([x, cols * size - x, y, rows * size - y])
    for row, col in np.argwhere(grid.blocked):
        aside = np.maximum(np.abs(x - (col + 0.5) * size) - size / 2.0, 0.0)
        above = np.maximum(np.abs(y - (row + 0.5) * size) - size / 2.0, 0.0)
        least = min(least, np.hypot(aside, above).min())
    return float(least)


def test_gaps_are_those_of_points_sampled_densely() -> None:
    """Of a disc along a step, from blocked cells, the map's edges and an obstacle; and of discs and polygons in one pose."""
    rng = np.random.default_rng(3)
    for case in range(cases(150, 3000)):
        size, origin = rng.uniform(0.2, 1.5), (*rng.uniform(-3.0, 3.0, 2).tolist(), 0.0)
        grid = Grid(rng.random((5, 7)) < rng.choice([0.0, 0.1, 0.3]), size, origin)
        radius, body = float(rng.uniform(0.1, 1.5) * size), None
        if case % 3 == 0:
            body = ((-0.7 * size, -0.2 * size), (0.5 * size, -0.3 * size), (0.4 * size, 0.4 * size))
        robot = RobotSpec(radius=radius, footprint=body)
        xy = origin[:2] + rng.uniform(0.3, 0.7, 2) * (7 * size, 5 * size) + rng.uniform(-1.0, 1.0, (2, 2)) * 3.0 * size
        xy[1] = xy[0] if case % 10 == 0 else xy[1]
        knots = xy.mean(axis=0) + rng.normal(0.0, 2.0 * size, (4, 2))
        line = Timeline.of([0], [0.1], [([0.0, 0.3, 0.6, 1.5], knots)])
        trace: Any = SimpleNamespace(xy=xy, t=np.array([0.2, 1.0]), timeline=line, task=SimpleNamespace(grid=grid, robot=robot))
        along = np.linspace(0.0, 1.0, 2001)[:, None]
        places = xy[0] + along * (xy[1] - xy[0])
        expected = depth(grid, places) - robot.radius
        near = 1e-9 if case % 10 == 0 else 1e-3 * size  # who stands is at one of the points
        assert min(wall_gap(trace, 0), size) == pytest.approx(min(expected, size), rel=0.0, abs=near), case
        t = 0.2 + 0.8 * along[:, 0]
        there = np.column_stack([np.interp(t, [0.0, 0.3, 0.6, 1.5], knots[:, axis]) for axis in (0, 1)])
        turns = np.column_stack((xy, rng.uniform(-4.0, 4.0, 2)))
        for pose, gap in zip(turns, wall_gaps(trace, turns)):
            c, s = math.cos(pose[2]), math.sin(pose[2])
            corners = pose[:2] + np.array(body or [(0.0, 0.0)]) @ [(c, s), (-s, c)]
            inside = np.concatenate([a + np.linspace(0.0, 1.0, 400)[:, None] * (b - a) for a in corners for b in corners])
            true = depth(grid, inside) - (0.0 if body else radius)
            assert gap <= true + 1e-9 and (gap > 0.0) == (true > 0.0), case  # between polygons it is a lower bound
            assert body or min(gap, size) == pytest.approx(min(true, size)), case
            trace.heading = pose[2:]
            trace.xy = np.vstack((pose[:2], pose[:2]))
            (away,), wall = last_gaps(trace)
            true = np.hypot(*(inside - there[-1]).T).min()  # from the edges of a polygon, also to a point within
            away += 0.1 + (0.0 if body else radius)
            assert wall == gap and abs(away) == pytest.approx(true, abs=1e-2 * size), case
        trace.xy = xy
        assert step_gaps(trace)[0, 0] == pytest.approx(
            np.hypot(*(there - places).T).min() - 0.1 - robot.radius, abs=5e-3 * size
        ), case
