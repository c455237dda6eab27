"""The checks of motions and episodes accept what uses every limit of a robot in full, and refuse 5 % more, with the reason."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from antway import (
    Command,
    Decision,
    Grid,
    InvalidPlan,
    Observation,
    RobotSpec,
    Scenario,
    Task,
    World,
    check_episode,
    check_motion,
    run,
)
from antway.trajectory.motion import Motion
from antway.verify_motion import wall_gaps
from antway.world.trace import Trace
from common import cases

CAR = RobotSpec(
    drive="ackermann", v_max=1.0, v_reverse=0.5, a_max=1.0, brake_max=2.0, turn_rate=0.8, alpha_max=1.6, turning_radius=0.75
)
BOX = ((-0.3, -0.2), (0.4, -0.2), (0.4, 0.3), (-0.3, 0.2))
ROOM = Grid(np.zeros((10, 10), dtype=bool))
# time (s), speed (m/s), turn rate (rad/s)
CAR_DRIVES = [
    (0.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.5, 1.0, 0.8), (2.0, 1.0, 0.8), (2.2, 0.6, 0.8), (2.7, 0.6, 0.0), (3.0, 0.0, 0.0),
    (3.5, -0.5, 0.0), (3.7, -0.5, 0.0), (3.95, 0.0, 0.0), (4.2, 0.0, 0.0),
]  # fmt: skip
# time (s), velocity (m/s); the turn by a right angle at 2 s counts as braking
DISC_GLIDES = [(0.0, 0.0, 0.0), (1.0, 0.6, 0.8), (2.0, 0.6, 0.8), (2.5, 0.0, 0.0), (3.0, 0.3, -0.4), (3.25, 0.0, 0.0)]


def faults(grid: Grid, robot: RobotSpec, motion: Motion) -> tuple[str, ...]:
    """What the check says of a motion."""
    try:
        check_motion(grid, robot, motion)
    except InvalidPlan as error:
        return error.violations
    return ()


def driven(knots: list[tuple[float, float, float]], wheels: bool) -> Motion:
    """The motion from (5, 5) m with these speeds and turn rates, or velocities, at its knots."""
    return integrated(knots, wheels)[0]


def integrated(knots: list[tuple[float, float, float]], wheels: bool) -> tuple[Motion, np.ndarray]:
    """The motion, and its poses after each of the small steps in which it is integrated."""
    t, a, b = np.array(knots).T
    fine = np.union1d(t, np.linspace(0.0, t[-1], 100_001))
    h, first, second = np.diff(fine), np.interp(fine, t, a), np.interp(fine, t, b)
    heading = np.append(0.0, np.cumsum(h * (second[1:] + second[:-1]) / 2.0)) if wheels else np.zeros(len(fine))
    v = np.column_stack((first * np.cos(heading), first * np.sin(heading)) if wheels else (first, second))
    xy = 5.0 + np.vstack((np.zeros(2), np.cumsum(h[:, None] * (v[1:] + v[:-1]) / 2.0, axis=0)))
    at = np.searchsorted(fine, t)
    return Motion(t, xy[at], heading[at], v[at], b if wheels else np.zeros(len(t))), np.column_stack((xy, heading))


@pytest.mark.parametrize(
    ("limit", "less", "reason"),
    [
        ("v_max", 0.95, "is faster than v_max or v_reverse: 1 m/s at 1 s"),
        ("v_reverse", 0.95, "is faster than v_max or v_reverse, backwards: 0.5 m/s at 3.5 s"),
        ("turn_rate", 0.95, "turns faster than turn_rate: 0.8 rad/s at 1.5 s"),
        ("alpha_max", 0.95, "turns with more than alpha_max"),
        ("a_max", 0.95, "accelerates with more than a_max or brakes with more than brake_max"),
        ("brake_max", 0.95, "accelerates with more than a_max or brakes with more than brake_max"),
        ("turning_radius", 1.05, "turns tighter than turning_radius"),
    ],
)
def test_a_car_uses_its_limits_in_full_and_no_more(limit: str, less: float, reason: str) -> None:
    motion = driven(CAR_DRIVES, True)
    assert faults(ROOM, CAR, motion) == ()
    assert faults(ROOM, replace(CAR, **{limit: less * getattr(CAR, limit)}), motion) == (reason,)


@pytest.mark.parametrize("limit", ["v_max", "a_max", "brake_max"])
def test_a_disc_uses_its_limits_in_full_and_no_more(limit: str) -> None:
    motion, robot = driven(DISC_GLIDES, False), RobotSpec(a_max=1.0, brake_max=2.0)
    assert faults(ROOM, robot, motion) == ()
    (reason,) = faults(ROOM, replace(robot, **{limit: 0.95 * getattr(robot, limit)}), motion)
    assert limit in reason


def test_a_ramp_square_to_its_end_brakes_in_any_direction() -> None:
    """A velocity turned by 60 degrees and halved changes with as much as the robot brakes, whatever roundings say."""
    robot = RobotSpec(a_max=1.0, brake_max=2.0)
    for angle in np.arange(0.0, 6.2, 0.05).tolist():
        far, near = ((v * math.cos(a), v * math.sin(a)) for v, a in ((0.8, angle), (0.4, angle + math.pi / 3.0)))
        ends = 0.8, 0.8 + 0.2 * math.sqrt(3.0), 1.0 + 0.2 * math.sqrt(3.0)
        motion = driven([(0.0, 0.0, 0.0), (ends[0], *far), (ends[1], *near), (ends[2], 0.0, 0.0)], False)
        assert faults(ROOM, robot, motion) == (), angle
        assert faults(ROOM, replace(robot, brake_max=1.99), motion) != (), angle


@pytest.mark.parametrize("drive", ["differential", "holonomic"])
def test_a_speed_at_rest_may_be_rounded(drive: str) -> None:
    """A robot that brakes in full does not begin to speed up the other way where its last speed is 1e-17 m/s below 0."""
    last = 0.3 - 0.1 - 0.1 - 0.1
    knots = [(0.0, 0.0, 0.0), (0.3, 0.3, 0.0), (0.35, 0.2, 0.0), (0.4, 0.1, 0.0), (0.45, last, 0.0)]
    motion = driven(knots, drive != "holonomic")
    assert last < 0.0 and faults(ROOM, RobotSpec(drive=drive, a_max=1.0, brake_max=2.0), motion) == ()


@pytest.mark.parametrize(("more", "legal"), [(1.0, True), (1.05, False)])
def test_what_changes_at_once_does_so_with_1000_per_second(more: float, legal: bool) -> None:
    """Speeds and turn rates, forwards and when they fall, each alone."""
    dt = 1e-3 / more
    free = RobotSpec(drive="differential", alpha_max=math.inf, turn_rate=2.0)
    assert math.isinf(free.a_max)
    for name, change in (("a_max", (1.0, 0.0)), ("alpha_max", (0.0, 1.0))):
        for quick in ((dt, 2.0), (2.0, dt)):
            knots = [(0.0, 0.0, 0.0), (quick[0], *change), (1.0 + quick[0], *change), (1.0 + sum(quick), 0.0, 0.0)]
            motion = driven(knots, True)
            found = faults(ROOM, free, motion)
            assert len(found) == (not legal) and all(name in one for one in found), (name, quick, found)


@pytest.mark.parametrize(("off", "legal"), [(9.5e-4, True), (1.05e-3, False), (-1.05e-3, False)])
def test_a_knot_may_be_a_millimetre_beside_where_the_step_before_leads(off: float, legal: bool) -> None:
    """Or as much of a radian, and 1 % of what the robot can go in the step."""
    motion = driven(CAR_DRIVES, True)
    for row in range(1, len(motion.t) - 1):
        for field, change, reason in (
            ("xy", (off, 0.0), "a place is not where the velocities lead"),
            ("xy", (0.0, off), "a place is not where the velocities lead"),
            ("heading", off, "a heading is not where the turn rates lead"),
        ):
            array = getattr(motion, field).copy()
            array[row:] += change
            velocity = motion.velocity
            if field == "heading":
                speed = (velocity * np.column_stack((np.cos(motion.heading), np.sin(motion.heading)))).sum(axis=1)
                velocity = speed[:, None] * np.column_stack((np.cos(array), np.sin(array)))
            found = faults(ROOM, CAR, replace(motion, **{"velocity": velocity, field: array}))
            assert reason not in found if legal else reason in found, (row, field, found)
    quick = driven([(0.02 * k, 0.0, 0.0) for k in range(5)], True)
    allowed = 0.01 * 0.02 + 1e-6
    moved = quick.xy + np.outer(np.arange(5) > 1, (0.0, math.copysign(allowed * (0.95 if legal else 1.05), off)))
    assert faults(ROOM, CAR, replace(quick, xy=moved)) == (() if legal else ("a place is not where the velocities lead",))


def test_motions_begin_and_end_at_rest_upon_their_heading() -> None:
    """Whichever of speed and turn rate is not 0, at whichever end; wheels are at no knot moved aside."""
    motion = driven(CAR_DRIVES, True)
    for row in (0, -1):
        for field, change in (("velocity", (2e-6, 0.0)), ("velocity", (-2e-6, 0.0)), ("turn_rate", 2e-6), ("turn_rate", -2e-6)):
            array = getattr(motion, field).copy()
            array[row] += change
            assert "does not stand at both ends" in faults(ROOM, CAR, replace(motion, **{field: array}))
    for row in range(1, len(motion.t)):  # at rest, too, where roundings of its speed are no reversal
        velocity = motion.velocity.copy()
        velocity[row] += 2e-6 * np.array((-math.sin(motion.heading[row]), math.cos(motion.heading[row])))
        assert faults(ROOM, CAR, replace(motion, velocity=velocity)) == ("moves aside, which wheels do not",)
    box = RobotSpec(a_max=1.0, brake_max=2.0, footprint=BOX)
    glides = driven(DISC_GLIDES, False)
    assert faults(ROOM, box, glides) == ()
    for field in ("heading", "turn_rate"):
        array = getattr(glides, field).copy()
        array[2] -= 2e-6
        assert faults(ROOM, box, replace(glides, **{field: array})) == (
            "turns, and a holonomic robot with a footprint keeps its heading",
        )
        array = array - 0.5 * (np.arange(len(array)) == 2)  # a disc may point anywhere
        assert faults(ROOM, replace(box, footprint=None), replace(glides, **{field: array})) == ()


def test_times_of_motions_begin_at_0_and_there_is_one_at_least() -> None:
    motion = driven(CAR_DRIVES, True)
    none = Motion(np.zeros(0), np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2)), np.zeros(0))
    for wrong in (replace(motion, t=motion.t + 1e-3), replace(motion, t=motion.t - 1e-3), none):
        assert faults(ROOM, CAR, wrong) == ("times do not increase from 0",)


LATE = replace(CAR, turning_radius=0.9, latency=0.13)
TWISTS = [(2.0, 0.0)] * 14 + [(2.0, 2.0)] * 14 + [(0.6, 2.0)] * 6 + [(-2.0, -2.0)] * 18 + [(0.0, 0.0)] * 6


class Turns:
    """Asks for more speed and more turning than the robot has, to and fro; a holonomic robot it asks for velocities."""

    def reset(self, task: Task, seed: int) -> None:
        self.wheels = task.robot.wheels

    def act(self, o: Observation) -> Command:
        v, w = TWISTS[round(o.t / 0.1) % len(TWISTS)]
        return Command(twist=(v, w)) if self.wheels else Command((v, w))

    def explain(self) -> Decision:
        return Decision("follow", "turns")


@cache
def episode(robot: RobotSpec) -> Trace:
    """An episode of 7 s in an empty hall."""
    hall = World(Grid(np.zeros((40, 40), dtype=bool), 0.5))
    trace = run(Scenario(hall, (10.0, 10.0), (19.0, 10.0), robot, horizon=7.0), Turns()).trace
    assert trace is not None
    return trace


@pytest.mark.parametrize("share", [0.95, 1.05])
@pytest.mark.parametrize(
    "limit", ["v_max", "v_reverse", "turn_rate", "alpha_max", "a_max", "brake_max", "turning_radius", "latency"]
)
def test_an_episode_of_wheels_uses_its_limits_in_full_and_no_more(limit: str, share: float) -> None:
    """Driven again by a robot of which one limit is 5 % off, it has other speeds; what is beyond a limit is named."""
    trace = episode(LATE)
    check_episode(trace)
    other = replace(LATE, **{limit: share * getattr(LATE, limit)})
    with pytest.raises(InvalidPlan) as error:
        check_episode(replace(trace, task=replace(trace.task, robot=other)))
    found = {one.split(":")[0] for one in error.value.violations}
    beyond = {"v_max": "is faster than v_max or v_reverse", "v_reverse": "is faster than v_max or v_reverse, backwards",
              "turn_rate": "turns faster than turn_rate"}.get(limit)  # fmt: skip
    assert "a speed is not what its command leads to" in found
    assert found - {
        "a speed is not what its command leads to", "a place is not where its command leads",
        "a heading is not where its command turns it",
    } == ({beyond} if beyond and share < 1.0 else set())  # fmt: skip


@pytest.mark.parametrize("share", [0.95, 1.05])
@pytest.mark.parametrize("limit", ["v_max", "a_max", "brake_max", "latency"])
def test_an_episode_without_wheels_uses_its_limits_in_full_and_no_more(limit: str, share: float) -> None:
    robot = RobotSpec(a_max=1.0, brake_max=2.0, latency=0.13)
    trace = episode(robot)
    check_episode(trace)
    other = replace(robot, **{limit: share * getattr(robot, limit)})
    with pytest.raises(InvalidPlan, match="a speed is not what its command leads to") as error:
        check_episode(replace(trace, task=replace(trace.task, robot=other)))
    assert ("is faster than v_max" in str(error.value)) == (limit == "v_max" and share < 1.0)


@pytest.mark.parametrize("robot", [LATE, RobotSpec(a_max=1.0, brake_max=2.0, latency=0.13)], ids=["wheels", "holonomic"])
def test_what_the_last_command_leads_to_is_compared_part_by_part(robot: RobotSpec) -> None:
    """A place, a heading, a speed or a turn rate that is a little off in the last row, forwards or backwards, is one fault."""
    trace = episode(robot)
    place, speed = "a place is not where its command leads", "a speed is not what its command leads to"
    ahead, turn = np.array((math.cos(trace.heading[-1]), math.sin(trace.heading[-1]))), 5e-4
    cases = [("xy", (off, 0.0), place) for off in (1e-4, -1e-4)] + [("xy", (0.0, off), place) for off in (1e-4, -1e-4)]
    if robot.wheels:
        cases += [("velocity", off * ahead, speed) for off in (0.006, -0.006)]
        cases += [("turn_rate", off, speed) for off in (0.005, -0.005)]
    cases += [("heading", off, "a heading is not where its command turns it") for off in (turn, -turn)]
    for field, off, what in cases:
        array = getattr(trace, field).copy()
        array[-1] += off
        with pytest.raises(InvalidPlan) as error:
            check_episode(replace(trace, **{field: array}))
        assert what in error.value.violations, (field, off)


def test_motions_touch_walls_where_a_pose_on_their_way_does() -> None:
    """Few long steps among walls, of discs and polygons, on turned maps, against a thousand poses and another computation."""
    rng, seen = np.random.default_rng(5), [0, 0]
    for case in range(cases(60, 3000)):
        size, wheels = rng.uniform(0.1, 1.0), case % 2 == 0
        robot = RobotSpec(drive="differential" if wheels else "holonomic", v_max=9.0, v_reverse=9.0 * wheels, turn_rate=9.0)
        robot = replace(robot, radius=rng.uniform(0.1, 0.5), footprint=BOX if case % 3 else None)
        knots = [(t, *(rng.normal(0.0, 1.0, 2) if 0.0 < t < 4.0 else (0.0, 0.0))) for t in (0.0, 1.0, 2.0, 4.0)]
        motion, poses = integrated(knots, wheels)
        low = poses[:, :2].min(axis=0) - rng.uniform(0.3, 0.7, 2)
        shape = np.ceil((poses[:, :2].max(axis=0) + rng.uniform(0.3, 0.7, 2) - low) / size).astype(int)
        grid = Grid(rng.random(shape[::-1]) < rng.choice([0.0, 0.02, 0.05]), size, (*low.tolist(), 0.0))
        gaps = wall_gaps(SimpleNamespace(task=SimpleNamespace(grid=grid, robot=robot)), poses[::100])
        turn = rng.uniform(-3.0, 3.0)
        about = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
        turned = Grid(grid.blocked, size, (*(low @ about).tolist(), turn))
        motion = Motion(motion.t, motion.xy @ about, motion.heading + turn, motion.velocity @ about, motion.turn_rate)
        if wheels:
            found = faults(turned, robot, motion)
        else:  # it points where it did, so that the map cannot be turned
            found = faults(grid, robot, driven(knots, False))
        if abs(gaps.min()) > 5e-3:
            assert bool(found) == (gaps.min() < 0.0) and all("wall" in one for one in found), (case, gaps.min(), found)
            seen[bool(found)] += 1
    assert min(seen) > 0.2 * sum(seen)
