"""What the node does without ROS: ways, parameters, and the pilot that stands whenever it must."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Callable
from dataclasses import astuple, replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from antway import Command, Decision, Grid, Moves, Observation, Outcome, Scenario, World, run
from antway.errors import BadInput, BadParameter
from antway.kernels.base.records import VY
from antway.kernels.crossing import SEGMENT_COUNT
from antway.kernels.tracking import kalman
from antway.planning import PLANNERS, Problem, solve
from antway.policies.antway import beside
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.guard_process import GuardProcess
from antway.ros2 import compile as compiling
from antway.ros2 import convert, frames, markers, nav2, tours
from antway.ros2.frames import Odometry
from antway.ros2.goals import ERROR, OK, STAND, WARN, End, Goal, PilotAnswer
from antway.ros2.markers import decision_message, predictions, predictions_message
from antway.ros2.path import around, corridor, keeps_near, tracking
from antway.ros2.pilot import OBSTACLES, ODOMETRY, Pilot
from antway.ros2.settings import Settings, parameters, refused
from antway.ros2.tours import TourGoal, find_tour
from antway.world.motions import Line
from antway.world.policy import Task, Tracks
from antway.world.world import Obstacle
from common import cases, random_grid
from fake_ros import defaults

ROOM = Grid(np.zeros((40, 60), bool), 0.2)
NOBODY = Tracks.none()


def settings(**changes) -> Settings:
    return Settings.of(defaults() | changes)


# Ways


def test_a_corridor_is_what_lies_near_the_way():
    """In a corridor are the map's free cells within its width of the way, to a cell's edge, at the places where they were."""
    rng = np.random.default_rng(6)
    for _ in range(cases(20, 1000)):
        grid = replace(random_grid(rng, low=5, high=40), resolution=0.25, origin=(1.0, -2.0, 0.0))
        rows, cols = grid.shape
        path = grid.to_xy(rng.uniform(0, (rows - 1, cols - 1), (4, 2)))
        width = rng.uniform(0.2, 3.0)
        part = corridor(grid, path, width)
        dense = np.vstack([np.linspace(a, b, 300) for a, b in pairwise(path)])
        own = {grid.cell_at(point) for point in dense}
        centres = grid.to_xy(np.array(sorted(own)))
        for cell in np.argwhere(~part.blocked):
            xy = part.centre(tuple(cell))
            assert grid.is_free(grid.cell_at(xy))
            assert np.hypot(*(centres - xy).T).min() <= width + 0.25 + 1e-9
        inside = part.to_xy(np.argwhere(~part.blocked))
        for cell in np.argwhere(~grid.blocked):
            xy = grid.to_xy([cell])[0]
            if np.hypot(*(centres - xy).T).min() <= width - 0.25:
                assert np.hypot(*(inside - xy).T).min() < 1e-9
        for _ in range(20):
            other = path[:2] + rng.normal(0.0, 0.7 * width, (2, 2))
            steps = max(math.ceil(2.0 * np.abs(np.diff(other, axis=0)).max() / 0.25), 1)  # each of half a cell at most
            cells = np.floor(part.to_points(np.linspace(*other, steps + 1)) + 0.5).astype(int).tolist()
            assert keeps_near(grid, path, other, width) == all(part.is_free((row, col)) for row, col in cells)
    beside = corridor(Grid(np.zeros((7, 9), bool)), np.array([[-3.5, -3.5], [3.5, 3.5], [12.5, 3.5]]), 2.0)
    cells = np.argwhere(np.ones(beside.shape, bool))  # the path is off the map at both ends, and the corridor ends with that
    near = np.array([*((k, k) for k in range(4)), *((3, k) for k in range(4, 9))])
    near_enough = np.hypot(*(cells[:, None] - near).transpose(2, 0, 1)).min(axis=1) <= 2.0
    assert beside.shape == (6, 9) and (beside.blocked.ravel() == ~near_enough).all()
    assert corridor(Grid(np.zeros((7, 9), bool)), np.array([[4.5, 6.5]]), 1.0).shape == (2, 3), "with the last row"
    straight = np.array([[1.0, 1.0], [9.0, 1.0]])
    assert keeps_near(ROOM, straight, straight + np.array([0.0, 0.4]), 0.5)
    assert not keeps_near(ROOM, straight, np.array([[1.0, 1.0], [9.0, 3.0]]), 0.5)
    detour, other = np.array([[1.0, 6.0], [1.0, 1.0], [11.0, 1.0], [11.0, 6.0]]), np.array([[1.0, 6.0], [11.0, 6.0]])
    assert not keeps_near(ROOM, detour, other, 1.0), "the ends alone are near"
    walls = ROOM.blocked.copy()
    walls[5, 30] = True
    assert not keeps_near(replace(ROOM, blocked=walls), straight + 0.1, straight + 0.1, 0.5), "there is a wall between the ends"


def test_tracking_measures_from_the_nearest_point():
    """Distance, side and rest of a way are those of the nearest of many points along it."""
    rng = np.random.default_rng(7)
    for _ in range(cases(200, 5000)):
        path, xy = rng.uniform(0, 10, (5, 2)), tuple(rng.uniform(0, 10, 2))
        share = np.linspace(0, 1, 2000)[:, None]
        dense = np.vstack([a + (b - a) * share for a, b in pairwise(path)])
        away = np.hypot(*(dense - xy).T)
        found = tracking(path, xy, 0.0)
        assert math.isclose(abs(found.aside), away.min(), abs_tol=0.01)
        i = int(away.argmin())
        assert math.isclose(found.left, np.hypot(*np.diff(dense[i:], axis=0).T).sum(), abs_tol=0.02) or found.index != i // 2000
        frame = (*rng.uniform(-9, 9, 2), rng.uniform(-3, 3))
        turned = tracking(frames.move(frame, path), frames.move_point(frame, xy), frame[2])
        if np.hypot(*(path - xy).T).min() > abs(found.aside) + 1e-6:  # else two segments are equally near
            assert astuple(turned) == pytest.approx(astuple(found), abs=1e-9), "whatever the direction"
    straight = np.array([[0.0, 0.0], [4.0, 0.0]])
    assert tracking(straight, (1.0, -0.5), 0.0).aside == -0.5, "to the right of the way"
    assert tracking(straight, (1.0, 0.0), -0.3).turned == 0.3, "turned to the right of the way"
    assert astuple(tracking(straight[:1], (3.0, 4.0), 0.5)) == (0, 0.0, 0.0, 5.0)
    repeated = tracking(straight[[0, 0, 0, 1, 1]], (-0.1, 0.5), 1.0)
    assert repeated == replace(tracking(straight, (-0.1, 0.5), 1.0), index=2), "a vertex may be repeated"
    assert tracking(straight[[0, 0]], (3.0, 4.0), 0.0).left == 0.0


def test_a_simulation_that_is_ten_times_as_fast_is_no_jump_of_the_clock() -> None:
    """A cycle of 0.15 s is 1.5 s there: the plan that it made used to be dropped, and was made again, for ever."""
    pilot, jump = Pilot(settings()), "odometry's clock jumped"
    pilot.receive_map(ROOM)
    pilot.go(Goal((10.0, 4.0)))
    reasons, now = [], 0.0
    for k in range(40):
        now += 0.15 if k % 8 == 7 else 0.01
        pilot.scan = (10.0 * now, NOBODY)
        answer = pilot.receive_odometry(Odometry(10.0 * now, (2.0, 4.0), (0.0, 0.0), 0.0), now)
        reasons.append(answer.reason if answer else "")
    assert not any(jump in reason for reason in reasons) and any("follow" in reason for reason in reasons)
    assert jump in pilot.receive_odometry(Odometry(10.0 * now + 2.0, (2.0, 4.0), (0.0, 0.0), 0.0), now + 0.01).reason


# Nav2


def test_paths_and_their_failures():
    """A path by way of stops is as long as its legs, each of the shortest; every failure has Nav2's code."""
    blocked = np.zeros((20, 20), bool)
    blocked[10, :12] = blocked[2:6, 15] = blocked[2:6, 18] = blocked[2, 15:19] = blocked[5, 15:19] = True
    grid = Grid(blocked, 0.5)
    room = grid.inflate(0.2)
    stops = [(1.0, 1.0), (6.5, 6.5), (1.0, 9.0)]
    path = nav2.find_path(grid, room, stops, 0.2, "jps", 600.0)
    cells = [grid.cell_at(stop) for stop in stops]
    legs = [solve(Problem(room, a, b)).length for a, b in pairwise(cells)]
    assert math.isclose(np.hypot(*np.diff(path, axis=0).T).sum(), sum(legs), rel_tol=1e-12)
    wall, closet, out, free = (2.25, 5.25), (8.4, 2.0), (-1.0, 1.0), (1.0, 1.0)
    for ends, code in (
        ([free, wall], nav2.GOAL_OCCUPIED),
        ([wall, free], nav2.START_OCCUPIED),
        ([free, out], nav2.GOAL_OUTSIDE_MAP),
        ([out, free], nav2.START_OUTSIDE_MAP),
        ([free, closet], nav2.NO_VALID_PATH),
        ([free, wall, free], nav2.GOAL_OCCUPIED),
    ):
        with pytest.raises(nav2.Failure) as caught:
            nav2.find_path(grid, room, ends, 0.2, "jps", 600.0)
        assert caught.value.code == code
    with pytest.raises(nav2.Failure) as caught:
        nav2.find_path(grid, room, stops, 0.2, "astar", 0.0)
    assert caught.value.code == nav2.PLAN_TIMEOUT
    near = nav2.find_path(grid, room, [free, wall], 0.2, "jps", 600.0, tolerance=1.0)[-1]
    assert room.is_free(room.cell_at(near)) and math.dist(near, wall) <= 1.0
    room, beside = grid.inflate(0.3), (1.1, 0.29)  # the robot's disc overlaps the edge of the map by 1 cm there
    first = nav2.find_path(grid, room, [beside, stops[1]], 0.3, "jps", 600.0)[0]
    assert not room.is_free(room.cell_at(beside)) and first.tolist() == [1.25, 0.75]
    with pytest.raises(nav2.Failure, match="start"):
        nav2.find_path(grid, room, [(1.1, 0.2), stops[1]], 0.3, "jps", 600.0)
    codes = [getattr(nav2, name) for name in dir(nav2) if name.isupper() and isinstance(getattr(nav2, name), int)]
    assert len(codes) == len(set(codes)) and set(nav2.ENDS) == set(End)


def test_results_have_the_fields_that_a_version_has(monkeypatch):
    """Without nav2_msgs there are no actions; with it, results and feedback get those of the fields that its version has."""
    monkeypatch.setattr(nav2, "find_spec", lambda name: None)
    assert nav2.nav2_kinds() == {}

    def message(*names: str):
        kind = type("Message", (SimpleNamespace,), {})
        kind.get_fields_and_field_types = classmethod(lambda cls: dict.fromkeys(names, "any"))
        return kind

    for feedback in (("distance_to_goal", "speed"), ("tracking_feedback",)):
        action = SimpleNamespace(Result=message("error_code", "error_msg"), Feedback=message(*feedback))
        monkeypatch.setattr(nav2, "find_spec", lambda name: name)
        monkeypatch.setattr(nav2, "load", lambda name, action=action: action)
        kind = nav2.nav2_kinds()["follow_path"]
        announced = kind.feedback(distance_to_goal=1.0, speed=2.0, tracking_feedback=3.0)
        assert set(vars(announced)) == set(feedback)
        assert vars(kind.result(error_code=7, error_msg="so", path=None)) == {"error_code": 7, "error_msg": "so"}


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        ("sequence<int32>", 3),
        ("sequence<nav2_msgs/MissedWaypoint>", ("nav2_msgs/msg/MissedWaypoint", {"index": 3, "error_code": 104})),
        (
            "sequence<nav2_msgs/WaypointStatus>",
            ("nav2_msgs/msg/WaypointStatus", {"waypoint_index": 3, "error_code": 104, "waypoint_status": 3}),
        ),
    ],
)
def test_missed_waypoints_are_told_as_a_version_has_them(monkeypatch, kind, told):
    """By their numbers in Humble, by messages in Iron and Jazzy, and by others from Kilted on."""

    class Result(SimpleNamespace):
        @classmethod
        def get_fields_and_field_types(cls):
            return {"missed_waypoints": kind, "error_code": "uint16"}

    monkeypatch.setattr(nav2, "find_spec", lambda name: name)
    monkeypatch.setattr(nav2, "load", lambda name: SimpleNamespace(Result=Result, Feedback=Result))
    monkeypatch.setattr(nav2, "make", lambda *made, **fields: (*made, fields))
    result = nav2.nav2_kinds()["visit_poses"].result(missed_waypoints=[(3, 104)], error_code=0, error_msg="missed [3]")
    assert result.missed_waypoints == [told]
    assert result.error_code == 0 and not hasattr(result, "error_msg")


def test_tours_and_their_failures():
    """The best order and the path through it; each failure has the code of Nav2's ComputePathToPose."""
    blocked = np.zeros((20, 40), bool)
    blocked[:, 30] = True
    grid = Grid(blocked, 0.5)
    places = [(1.0, 5.0, 0.0), (13.0, 5.0, 1.0), (4.0, 5.0, 2.0), (9.0, 5.0, 3.0)]
    order, path = find_tour(grid, places, 0.2)
    assert order == [1, 2, 0]
    assert np.hypot(*np.diff(path, axis=0).T).sum() == pytest.approx(12.25, abs=0.5)
    for ends, code in (
        ([places[0], (15.25, 5.0, 0.0)], 206),
        ([(15.25, 5.0, 0.0), places[0]], 205),
        ([places[0], (99.0, 5.0, 0.0)], 204),
        ([(99.0, 5.0, 0.0), places[0]], 203),
        ([places[0], (18.0, 5.0, 0.0)], 208),
        ([places[0]], 208),
    ):
        with pytest.raises(nav2.Failure) as caught:
            find_tour(grid, ends, 0.2)
        assert caught.value.code == code, ends


# Parameters


def test_parameters_have_the_ranges_of_their_definitions():
    """Each number is accepted at both ends of its range and refused just outside, in the words that the parameter tells."""
    found = parameters()
    usual = defaults()
    for name, one in found.items():
        if isinstance(one.default, bool) or not isinstance(one.default, (int, float)):
            continue
        whole = isinstance(one.default, int)
        for end, out in ((one.low, -1), (one.high, 1)):
            assert refused(usual, name, end) is None
            beyond = end + out if whole else math.nextafter(end, out * math.inf)
            if math.isfinite(end) and not (whole and abs(beyond) >= 2**63 - 1):
                wrong = refused(usual, name, beyond)
                assert wrong is not None and wrong.allowed == one.allowed and name in str(wrong)
    assert {"robot.radius", "task.goal_tolerance", "policy.chance", "timeout"} <= set(found)
    assert found["robot.v_reverse"].high > 1.0, "a faster robot may reverse faster"
    assert found["policy.moves"].default == Moves.THIRTY_TWO.value and "thirty-two" in found["policy.moves"].allowed


def test_converters_are_found_by_name():
    """A converter is imported by module:function; what cannot be is refused by name."""
    kind = {"obstacles_type": "geometry_msgs/msg/PolygonStamped"}
    reader = settings(**kind, obstacles_converter="antway.ros2.convert:read_markers").reader
    t, tracks = reader(convert.markers_message(Tracks.none(), 3.0))
    assert t == 3.0 and len(tracks) == 0
    for odd in (SimpleNamespace(), None, []):  # what a converter makes of them is an error of its own
        with pytest.raises(BadParameter, match="read each message"):
            settings(**kind, obstacles_converter="antway.ros2.convert:read_markers").reader(odd)
    with pytest.raises(BadParameter, match="tracks"):
        settings(**kind, obstacles_converter="math:modf").reader(1.5)
    for hook in ("nowhere:f", "antway.ros2.convert:nothing", "antway.ros2.convert", "antway.ros2.convert:SPHERE", ":f", "..:x"):
        with pytest.raises(BadParameter, match="obstacles_converter"):
            settings(**kind, obstacles_converter=hook)
    with pytest.raises(BadParameter, match="obstacles_type"):
        settings(**kind)


def nowhere(_: object) -> tuple[float, Tracks]:
    return 1.0, Tracks([1, 2], [[1.0, 1.0], [math.nan, 1.0]], np.full((2, 2), math.nan), [0.3, 0.3])


def longer(_: object) -> tuple[float, Tracks]:
    return 1.0, Tracks([1], [[1.0, 1.0], [2.0, 1.0]], np.zeros((2, 2)), [0.3, 0.3])


@pytest.mark.parametrize("name", ["nowhere", "longer"])
def test_what_converters_return_is_checked(name: str) -> None:
    """A place that is none would spoil the track for as long as it is seen, so the whole message is refused."""
    read = settings(obstacles_type="geometry_msgs/msg/PolygonStamped", obstacles_converter=f"test_ros_pilot:{name}").reader
    with pytest.raises(BadParameter, match="tracks"):
        read(None)


# The pilot


class Drive:
    """A pilot in an empty room, stepped by hand."""

    def __init__(self, **changes) -> None:
        self.pilot, self.t, self.now, self.xy = Pilot(settings(**changes)), 0.0, 0.0, (2.0, 2.0)

    def step(self, seen: Tracks | None = NOBODY, dt: float = 0.1, passed: float = 0.1):
        self.t, self.now = self.t + dt, self.now + passed
        if seen is not None:
            self.pilot.scan = self.t, seen
        return self.pilot.receive_odometry(Odometry(self.t, self.xy, (0.0, 0.0), 0.0), self.now)


def ready(goal: Goal | None = None, **changes) -> Drive:
    """A drive that is under way."""
    drive = Drive(**changes)
    drive.pilot.receive_map(ROOM)
    drive.pilot.go(goal or Goal((10.0, 2.0)))
    assert drive.step().drives
    return drive


def until(drive: Drive, done: Callable[[PilotAnswer], bool]) -> PilotAnswer:
    """Step until an answer is as wanted, which may take a thread that plans some time."""
    for _ in range(500):
        answer = drive.step()
        if done(answer):
            return answer
        time.sleep(0.01)
    raise AssertionError("not within 5 s")


def planned_for(drive: Drive, goal: Goal) -> AntwayPolicy:
    """Step until the policy for a goal drives, and return it."""
    until(drive, lambda answer: drive.pilot.bound_for is goal and answer.drives)
    return drive.pilot.policy


def test_the_pilot_waits_for_what_is_missing():
    """Without a map and without obstacles it stands and says so; with both it drives; at the goal it is done."""
    drive = Drive()
    assert drive.step() is None, "no goal"
    drive.pilot.go(Goal((10.0, 2.0)))
    drive.pilot.scan = None
    assert drive.step(None).reason == "waiting for a map"
    drive.pilot.receive_map(ROOM)
    assert drive.step(None).reason == "waiting for obstacles"
    assert drive.step().drives
    drive.xy = (9.95, 2.0)
    answer = drive.step()
    assert answer.end is End.ARRIVED and answer.command is STAND and drive.step() is None


def test_one_command_each_control_period():
    """Odometry at any rate and with jitter gives as many commands as there are control periods."""
    rng = np.random.default_rng(8)
    for rate in (10.0, 13.0, 20.0, 50.0, 100.0):
        drive, times = ready(), []
        for i in range(int(20 * rate)):
            drive.t = 1.0 + i / rate + rng.uniform(-0.2, 0.2) * min(1 / rate, 0.1)
            if drive.step(dt=0.0) is not None:
                times.append(drive.t)
        per_second = (len(times) - 1) / (times[-1] - times[0])
        expected = 10.0 if rate >= 20.0 or rate == 10.0 else rate / math.ceil(0.75 * rate / 10.0)
        assert 0.9 * min(expected, 10.0) <= per_second <= 10.2, (rate, per_second)


def test_it_stops_within_the_guards_time():
    """When obstacles fall silent the robot stands from the first cycle after `timeout` on, and drives when they are back."""
    drive = ready()
    seen = drive.t
    while drive.t - seen < 2.0:
        answer = drive.step(None)
        assert answer.drives == (drive.t - seen <= 0.5 + 1e-9), drive.t - seen
    assert "silent" in answer.reason and drive.step().drives
    assert drive.pilot.silent(0.4, 0.1) is None and "no odometry" in drive.pilot.silent(0.6, 0.1).reason


INERTIA = {"robot.drive": "differential", "robot.a_max": 1.0, "robot.alpha_max": 3.0}


def test_it_brakes_after_two_periods_without_odometry() -> None:
    """A command is certified for one period: by the second one the guard's stop begins, one command in each, looked at often.

    Odometry that is back is answered by driving on. It used to drive on until `timeout`, at any speed, into walls.
    """
    drive = ready(**INERTIA)
    drive.pilot.guard.dynamic.keep[1:3] = 0.5, 2.0  # the stop turns by 0.5 rad/s for two periods
    for held in (0.05, 0.15, 0.2):
        assert drive.pilot.silent(held, held) is None
    answers = {round(held, 3): drive.pilot.silent(held, held) for held in np.arange(0.225, 0.49, 0.025).tolist()}
    braked = {held: answer for held, answer in answers.items() if answer is not None}
    assert list(braked) == [0.225, 0.325, 0.425] and {answer.level for answer in braked.values()} == {WARN}
    assert [answer.command.twist for answer in braked.values()] == [(0.0, 0.5), (0.0, 0.5), None]
    assert "no odometry" in braked[0.225].reason
    assert drive.step().level == OK and drive.pilot.silent(0.1, 0.1) is None
    still = ready(**INERTIA)
    still.pilot.drop("on request")
    still.step()
    assert still.pilot.silent(0.4, 0.4) is None, "there is nothing to stop"


@pytest.mark.parametrize(("back", "commands"), [(0.23, 4), (0.26, 4), (0.29, 3)])
def test_odometry_that_is_back_does_not_cut_the_stop_short(back: float, commands: int) -> None:
    """Each command of a stop acts for half a period at least, also if odometry is back just after the pilot has braked."""
    drive = ready(**INERTIA)
    drive.pilot.guard.dynamic.keep[1:3] = 0.5, 2.0  # the stop turns by 0.5 rad/s for two periods
    sent, drive.pilot.scan = [drive.pilot.silent(0.225, 0.225).command.twist], None
    answer = drive.step(None, dt=back, passed=back)
    assert answer.reason == "waiting for obstacles"
    for _ in range(3):
        sent.append(answer.command.twist)
        answer = drive.step(None)
    assert sent == [(0.0, 0.5)] * (commands - 1) + [None] * (5 - commands)


@pytest.mark.parametrize("rate", [10.0, 20.0])
def test_odometry_whose_stamp_stands_still_is_not_driven_on(rate: float) -> None:
    """Such odometry, and messages that come twice, have no answer, so the robot brakes two periods after its last command."""
    drive = ready(**INERTIA)
    last = drive.now
    for _ in range(20):
        answer = drive.step(dt=1.0 / rate, passed=1.0 / rate)
        last = drive.now if answer is not None else last
        assert drive.step(dt=0.0, passed=0.0) is None, "the same message again"
    braked = []
    while not braked and drive.now < last + 1.0:
        assert drive.step(dt=0.0, passed=1.0 / rate) is None, drive.now - last
        braked = list(filter(None, [drive.pilot.silent(drive.now - last, drive.now - last)]))
    assert drive.now - last <= 0.3 + 1e-9 and braked[0].reason == "brake: no odometry for 2 control periods"


def test_a_slow_simulation_is_not_silent() -> None:
    """Where the clock of the simulation is slow, `held` is by that clock, and the time-out by a steady one."""
    drive = ready(**INERTIA)
    assert [drive.pilot.silent(seconds, 0.1) for seconds in (0.1, 0.3, 0.5)] == [None] * 3
    assert drive.pilot.silent(0.51, 0.1).level == ERROR and drive.pilot.silent(0.55, 0.1) is None


@pytest.mark.parametrize(
    ("rate", "jitter", "drives"),
    [(10.0, 0.03, True), (20.0, 0.02, True), (8.0, 0.03, True), (9.9, 0.03, True), (6.0, 0.0, False), (5.0, 0.02, False)],
)
def test_odometry_that_is_too_slow_is_not_driven_on(rate: float, jitter: float, drives: bool) -> None:
    """Commands would act for longer than they are certified for; usual jitter and rates that are a little low do not matter."""
    rng, drive, answers = np.random.default_rng(9), ready(), []
    times = 0.2 + np.arange(40) / rate + rng.uniform(-jitter, jitter, 40)
    drive.t, last = float(times[0]), float(times[0])
    for before, drive.t in pairwise(times.tolist()):
        if drives:
            answers += [drive.pilot.silent(t - before, t - last) for t in np.arange(before, drive.t, 0.025).tolist()]
        answers.append(drive.step(dt=0.0, passed=drive.t - before))
        last = last if answers[-1] is None else drive.t
    answers = list(filter(None, answers))
    assert len(answers) >= 19
    assert all(answer.drives for answer in answers[5:]) if drives else not any(answer.drives for answer in answers[5:])
    if drives:
        assert {answer.level for answer in answers} == {OK}, "it does not stutter"
    else:
        assert answers[-1].level == ERROR and "odometry comes each" in answers[-1].reason
        drive.t += 0.1
        for _ in range(11):
            answer = drive.step()
        assert answer.drives, "odometry is fast again"


def test_jumps_of_the_clock_stop_it_once():
    """A clock that jumps, forth or back, stops it and makes it forget; with fresh messages it drives again."""
    for jump in (-1000.0, -0.2, 0.7, 1e6):
        drive = ready()
        answer = drive.step(None, dt=jump)
        assert "jumped" in answer.reason and answer.command is STAND
        assert drive.step(None).reason == "waiting for obstacles" and drive.step().drives
    drive = ready()
    policy = drive.pilot.policy
    assert drive.step(dt=3.0, passed=3.0).drives and drive.pilot.policy is policy, (
        "odometry that was away, or a node that was busy"
    )


def test_a_goal_that_is_repeated_changes_nothing() -> None:
    """Tools publish goal_pose again and again; each time the robot used to stop, and to plan anew."""
    drive = ready(Goal((10.0, 2.0)))
    policy = drive.pilot.policy
    for _ in range(3):
        answer = drive.pilot.go(Goal((10.0, 2.0)))
        assert answer is not None and answer.drives and answer.end is End.REPLACED
        assert drive.step().drives and drive.pilot.policy is policy
    for other in (Goal((10.0, 2.1)), Goal((10.0, 2.1), yaw=1.0), Goal((10.0, 2.1), np.array([[2.0, 2.0], [10.0, 2.0]]))):
        answer = drive.pilot.go(other)
        assert answer is not None and "pre-empted" in answer.reason
        drive.step()


def test_odometry_that_was_overtaken_is_dropped() -> None:
    """A message that comes a moment after a newer one is no jump of the clock: the robot used to stop and plan anew."""
    drive = ready()
    policy = drive.pilot.policy
    for late in (0.01, 0.1):
        assert drive.step().drives
        assert drive.step(None, dt=-late, passed=0.0) is None
        assert drive.step(dt=0.1 + late).drives and drive.pilot.policy is policy


def test_the_robot_stands_while_a_thread_plans_on_a_large_map(monkeypatch: pytest.MonkeyPatch) -> None:
    """Meanwhile every odometry is answered, a refreshed path changes nothing, and another goal is planned for on the way."""
    run, go_on, started = beside.Beside._run, threading.Event(), []
    monkeypatch.setattr(beside, "_AT_ONCE", 0)
    monkeypatch.setattr(beside.Beside, "_run", lambda self, work: (started.append(1), go_on.wait(60.0), run(self, work)))
    drive = Drive()
    drive.pilot.receive_map(ROOM)
    way = np.array([[2.0, 2.0], [10.0, 2.0]])
    for path in (way, way + np.array([0.0, 0.1])):
        drive.pilot.go(Goal((10.0, 2.0), path))
        for _ in range(3):
            answer = drive.step()
            assert answer.command is STAND and "plans" in answer.reason
    drive.pilot.go(Goal((2.0, 3.2)))
    assert "plans" in drive.step().reason and len(started) == 1
    go_on.set()
    assert until(drive, lambda answer: answer.drives).command.velocity[0] > 0.5, "it drives to the first goal"
    until(drive, lambda answer: answer.command.velocity[1] > 0.5)
    drive.pilot.go(Goal((-5.0, 2.0)))
    for _ in range(200):
        answer = drive.step()
        if answer.end is not None:
            break
        time.sleep(0.02)
    assert answer.end is End.REFUSED


@pytest.mark.parametrize("what", ["goal", "map", "dropped"])
def test_goals_and_maps_that_come_faster_than_it_plans_do_not_keep_the_robot(monkeypatch, what: str) -> None:
    """One thread plans at a time, and the robot sets out by its plan; not so to a goal that was dropped meanwhile."""
    run, go_on, started, grid = beside.Beside._run, threading.Event(), [], ROOM
    monkeypatch.setattr(beside, "_AT_ONCE", 0)
    monkeypatch.setattr(beside.Beside, "_run", lambda self, work: (started.append(1), go_on.wait(60.0), run(self, work)))
    drive = Drive()
    drive.pilot.receive_map(ROOM)
    for k in range(5):
        if what == "map":
            blocked = ROOM.blocked.copy()
            blocked[12, 8 + k] = True  # in sight of the robot
            grid = Grid(blocked, 0.2)
            drive.pilot.receive_map(grid)
        if what == "dropped" and k > 0:
            drive.pilot.drop("on request")
        if what != "map" or k == 0:
            drive.pilot.go(Goal((10.0, 2.0) if k == 0 else (2.0, 5.0 + 0.4 * k)))
        assert "plans" in drive.step().reason
    assert len(started) == 1
    go_on.set()
    velocity = until(drive, lambda answer: answer.drives).command.velocity
    assert velocity[1] > 0.5 if what == "dropped" else velocity[0] > 0.5
    if what == "map":
        guarded = drive.pilot.policy.guard.grid
        assert guarded.blocked[guarded.cell_at(grid.centre((12, 12)))], "it keeps off the walls on the newest map"
    planned_for(drive, drive.pilot.goal)
    assert drive.pilot.policy.task.goal == drive.pilot.goal.xy and drive.pilot.policy.task.grid == grid


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_the_node_drives_to_every_goal_that_the_policy_takes(yaw: float) -> None:
    """Whether the robot can stand there is the policy's decision, and not that of the centre of the goal's cell."""
    blocked = np.zeros((12, 24), bool)
    blocked[:, 20:] = True
    grid = Grid(blocked, 0.5, (0.0, 0.0, yaw))
    for x, y, why in (
        (9.0, 0.31, ""),
        (9.0, 0.001, "where the robot can stand"),
        (11.0, 3.0, "blocked"),
        (13.0, 3.0, "on the map"),
    ):
        drive = Drive()
        drive.pilot.receive_map(grid)
        drive.xy, xy = (tuple(grid.to_xy([[y / 0.5 - 0.5, x / 0.5 - 0.5]])[0].tolist()) for x, y in ((2.0, 3.0), (x, y)))
        drive.pilot.go(Goal(xy))
        answer = drive.step()
        assert answer.drives if not why else answer.end is End.REFUSED and why in answer.reason
        assert not why or f"{xy[0]:.6g}" in answer.reason, "the place is told as it was given"


def test_time_for_planning_is_no_lack_of_progress() -> None:
    """On a large map the robot may set out so late that the next odometry comes after `progress_time`."""
    drive = ready(Goal((10.0, 2.0), gives_up=True), progress_time=3.0)
    assert drive.step(dt=25.0, passed=25.0).drives
    answers = [drive.step() for _ in range(40)]
    assert answers[20].end is None and any(answer.end is End.STUCK for answer in answers if answer is not None)


def test_maps_may_change_on_the_way():
    """A map that is the same changes nothing; a new one stops the robot once, and is driven on if it can be."""
    drive = ready()
    policy = drive.pilot.policy
    assert drive.pilot.receive_map(Grid(ROOM.blocked, 0.2)) is None and drive.pilot.policy is policy
    wall = ROOM.blocked.copy()
    wall[:30, 30] = True
    answer = drive.pilot.receive_map(Grid(wall, 0.2))
    assert answer.reason == "the map has changed" and answer.drives
    assert drive.pilot.policy is policy and policy.guard.grid.shape == (31, 31), "the walls near the robot count at once"
    policy = planned_for(drive, drive.pilot.goal)
    assert policy.guard.grid is drive.pilot.grid
    grown = np.pad(wall, ((5, 0), (10, 20)))  # as that of a SLAM, whose origin moves
    assert drive.pilot.receive_map(Grid(grown, 0.2, (-2.0, -1.0, 0.0))).drives
    assert planned_for(drive, drive.pilot.goal).task.goal == (10.0, 2.0)
    wall[5:15, 45:55] = True
    drive.pilot.receive_map(Grid(wall, 0.2))
    answer = until(drive, lambda answer: answer.end is not None)
    assert answer.end is End.REFUSED and "refused" in answer.reason
    drive = ready()
    wall = ROOM.blocked.copy()
    wall[9:12, 9:12] = True  # on the robot itself: it waits there for a better map
    drive.pilot.receive_map(Grid(wall, 0.2))
    until(drive, lambda answer: "cannot set out" in answer.reason)
    assert not drive.step().drives, "and does not drive on by the plan before"
    drive.pilot.receive_map(ROOM)
    planned_for(drive, drive.pilot.goal)
    answer = drive.pilot.receive_map(Grid(np.zeros((60, 60), bool), 0.2, (12.0, 0.0, math.pi / 2)))
    assert answer.command is STAND, "what it knows is in the frame of the map before"
    vx, vy = drive.step().command.velocity
    assert vx > 0.9 and abs(vy) < 0.1, "commands are in the map's frame, however its cells are turned"


def test_without_a_path_the_robot_stands_and_says_where_there_is_none() -> None:
    """A wall across the map on the way stops the robot; goals that give up end after `wait_timeout`, others wait for a map."""
    wall = ROOM.blocked.copy()
    wall[:, 30] = True
    for gives_up in (True, False):
        drive = ready(Goal((10.0, 2.0), gives_up=gives_up), wait_timeout=1.0)
        drive.pilot.receive_map(Grid(wall, 0.2))
        assert "stuck: the map has no path" in until(drive, lambda answer: not any(answer.command.velocity)).reason
        answers = [drive.step() for _ in range(14)]
        assert all(a.level == WARN and a.command.velocity == (0.0, 0.0) for a in answers if a is not None)
        ends = [a.end for a in answers if a is not None and a.end is not None]
        assert ends == ([End.WAITED] if gives_up else [])
        drive.pilot.receive_map(ROOM)
        if gives_up:
            assert drive.step() is None
        else:
            planned_for(drive, drive.pilot.goal)
    behind = np.array([[2.0, 2.0], [10.0, 2.0]])
    wall[30:, 30] = False
    drive = ready(Goal((10.0, 2.0), behind, gives_up=True))
    drive.pilot.receive_map(Grid(wall, 0.2))
    assert until(drive, lambda answer: not any(answer.command.velocity)).reason.endswith(
        "for this robot within 2 m of the path"
    )


def test_people_walk_through_the_edges_of_a_corridor() -> None:
    """They used to be predicted to turn back there, and the guard to let them: 12 of 24 robots were touched in crowds."""
    path = np.array([[2.0, 2.0], [10.0, 2.0]])
    drive = ready(Goal((10.0, 2.0), path), corridor=0.3, **INERTIA)
    crossing = Tracks(np.array([1]), np.array([[4.0, 4.0]]), np.array([[0.0, -1.0]]), np.array([0.3]))
    drive.step(crossing)
    state = drive.pilot.policy.state
    assert state.terrain.blocked.shape == ROOM.shape and state.task.grid.shape != ROOM.shape
    assert drive.pilot.policy.guard.grid is drive.pilot.grid
    rows = state.plan.segments[: int(state.plan.state[SEGMENT_COUNT])]
    assert (rows[:, VY] == -1.0).all(), "on through both edges, until the wall"
    again = Goal((10.0, 2.5), path + np.array([0.0, 0.5]))
    drive.pilot.go(again)
    policy = planned_for(drive, again)
    assert policy.state.terrain.blocked.shape == ROOM.shape and policy.guard.grid is drive.pilot.grid
    policy._suit_response(drive.t)
    assert policy.guard.grid is drive.pilot.grid


def test_goals_are_replaced_and_dropped():
    """A new goal ends the one before, and the robot drives on; the same path again changes nothing; what is dropped ends so."""
    drive = ready()
    goal = Goal((2.0, 6.0))
    answer = drive.pilot.go(goal)
    assert answer.end is End.REPLACED and answer.drives and "pre-empted" in answer.reason
    policy = planned_for(drive, goal)
    assert policy.task.goal == goal.xy and drive.pilot.command.velocity[1] > 0.5
    path = np.array([[2.0, 2.0], [6.0, 3.0], [10.0, 2.0]])
    goal = Goal((10.0, 2.0), path, gives_up=True)
    drive.pilot.go(goal)
    policy = planned_for(drive, goal)
    answer = drive.pilot.go(Goal((10.0, 2.0), path + np.array([0.0, 0.3]), gives_up=True))
    assert answer.end is End.REPLACED and answer.drives and drive.pilot.policy is policy
    off = 0.7 * drive.pilot.settings.corridor  # within it, but not in its inner half
    goal = Goal((10.0, 2.0), path + np.array([0.0, off]), gives_up=True)
    answer = drive.pilot.go(goal)
    assert answer.drives and planned_for(drive, goal) is not policy
    assert drive.pilot.drop("on request").end is End.DROPPED and drive.pilot.drop("again").end is None


def test_goals_that_come_faster_than_it_plans_are_followed() -> None:
    """A plan that has begun is finished and driven, although another goal has come; a goal that is refused ends the drive."""
    drive, goals = ready(), [Goal((10.0, 2.0 + 0.1 * k)) for k in range(1, 30)]
    first, bound_for = drive.pilot.policy, set()
    for goal in goals:
        assert drive.pilot.go(goal).drives
        assert drive.step().drives
        bound_for.add(drive.pilot.bound_for)
        time.sleep(0.02)
    assert len(bound_for) > 3 and drive.pilot.policy is not first
    planned_for(drive, goals[-1])
    drive.pilot.go(Goal((-5.0, 2.0)))
    answer = until(drive, lambda answer: answer.end is not None)
    assert answer.end is End.REFUSED and drive.pilot.policy is None


def test_replanning_does_not_hide_that_it_waits():
    """Paths that are refreshed each 0.5 s neither move a robot whose sensor is silent, nor put off the end of its patience."""
    path = np.array([[2.0, 2.0], [10.0, 2.0]])
    for refreshed in (path, np.array([[2.0, 2.0], [6.0, 6.0], [10.0, 2.0]])):
        drive = ready(Goal((10.0, 2.0), path, gives_up=True), wait_timeout=2.0)
        ends = []
        for i in range(40):
            answer = drive.step(None)
            if answer is None or answer.end is not None:
                break
            if drive.t > 0.75:
                assert answer.command is STAND
                if i % 5 == 0:
                    answer = drive.pilot.go(Goal((10.0, 2.0), refreshed, gives_up=True))
                    assert answer.command is STAND and answer.end is End.REPLACED
                    ends.append(answer.end)
        assert answer.end is End.WAITED and len(ends) >= 3


def test_a_path_is_kept_to():
    """On a path that leads round, the robot keeps within the corridor, where without it the straight way would be driven."""
    path = np.array([[2.0, 2.0], [2.0, 6.5], [10.0, 6.5], [10.0, 2.0]])
    for goal, most in ((Goal((10.0, 2.0)), math.inf), (Goal((10.0, 2.0), path, gives_up=True), 1.0 + 0.3)):
        drive, worst = ready(goal, corridor=1.0), 0.0
        for _ in range(400):
            answer = drive.step()
            if answer.end is not None:
                break
            vx, vy = answer.command.velocity
            drive.xy = drive.xy[0] + 0.1 * vx, drive.xy[1] + 0.1 * vy
            worst = max(worst, abs(tracking(path, drive.xy, 0.0).aside))
        assert answer.end is End.ARRIVED and worst <= most and (most < 9 or worst > 2.0), worst


def test_only_goals_that_give_up_end_by_waiting_or_without_progress():
    """follow_path's goals end when sensors are silent for longer than patience, or no progress is made; others wait on."""
    for gives_up in (True, False):
        ends = []
        for silent in (True, False):
            drive = ready(Goal((10.0, 2.0), gives_up=gives_up), wait_timeout=1.0, progress_time=3.0)
            answers = [drive.step(None if silent else NOBODY) for _ in range(60)]
            ends += [one.end for one in answers if one is not None and one.end]
        assert ends == ([End.WAITED, End.STUCK] if gives_up else [])
    drive = ready(Goal((10.0, 2.0), gives_up=True), wait_timeout=1.0)
    assert drive.pilot.silent(0.8, 0.8).end is None and drive.pilot.silent(1.2, 1.2).end is End.WAITED


def test_silence_before_a_goal_is_no_waiting_for_it() -> None:
    """Odometry has `wait_timeout` from the goal on, and again once it was back, to come."""
    drive = Drive(wait_timeout=1.0)
    pilot = drive.pilot
    assert pilot.silent(60.0, 60.0) is None, "no goal"
    pilot.go(Goal((10.0, 2.0), gives_up=True))
    assert pilot.silent(60.1, 60.1).end is None and pilot.silent(60.9, 60.9).end is None
    pilot.go(Goal((10.0, 2.0), gives_up=True))
    assert pilot.silent(61.1, 61.1).end is End.WAITED
    pilot.go(Goal((10.0, 2.0), gives_up=True))
    drive.step()
    assert pilot.silent(0.2, 0.2) is None and pilot.silent(0.9, 0.9).end is None and pilot.silent(1.1, 1.1).end is End.WAITED


def test_what_the_robot_was_told_before_it_stood_acts_no_more() -> None:
    """A robot with latency that stood between two goals, or without odometry, begins without commands that do not act yet."""
    slow = {"robot.latency": 0.3, "robot.a_max": 1.0}
    drive = ready(**slow)
    for _ in range(10):
        drive.step()
    assert np.abs(drive.pilot.sent).max() > 0.1
    assert drive.pilot.drop("on request").drives, "until the control period is over"
    assert drive.step().command is STAND
    for _ in range(5):
        assert drive.step() is None
    assert not drive.pilot.sent.any()
    drive = ready(**slow)
    for _ in range(10):
        drive.step()
    for k in range(5):
        drive.pilot.silent(1.0 + 0.1 * k, 1.0 + 0.1 * k)
    assert not drive.pilot.sent.any()


def test_older_obstacles_do_not_replace_newer_ones() -> None:
    """Messages out of order are overtaken; a clock that goes back by more than the time-out is another clock."""
    drive = ready()
    now = drive.pilot.scan[0]
    assert drive.pilot.overtaken(now - 0.1) and not drive.pilot.overtaken(now) and not drive.pilot.overtaken(now + 0.1)
    assert not drive.pilot.overtaken(now - 10.0) and not Pilot(settings()).overtaken(now)


def test_obstacles_seen_after_odometry_move_the_robot_on() -> None:
    """Place and heading are moved on to the time of the obstacles; obstacles too far ahead are called newer, not older."""
    pilot, seen = Pilot(settings(**{"robot.drive": "differential", "robot.alpha_max": 3.0})), []
    pilot.receive_map(ROOM)
    pilot.go(Goal((10.0, 2.0)))
    pilot.scan = (1.2, NOBODY)
    passed = pilot._passed
    pilot._passed = lambda decide, observation, t: seen.append(observation) or passed(decide, observation, t)
    pilot.receive_odometry(Odometry(1.0, (2.0, 2.0), (0.5, 0.0), 0.0, 1.0), 1.0)
    assert seen[0].xy == pytest.approx((2.1, 2.0)) and seen[0].heading == pytest.approx(0.2)
    pilot.goal = Goal((2.0, 2.0), yaw=2.0)
    pilot.settings = replace(pilot.settings, yaw_tolerance=0.1)
    pilot.guard, pilot.scan = None, (1.3, NOBODY)
    pilot.receive_odometry(Odometry(1.1, (2.0, 2.0), (0.0, 0.0), 0.0, 1.0), 1.1)
    assert seen[1].t == 1.3 and seen[1].heading == pytest.approx(0.2), "also where it turns to the goal's yaw"
    pilot.scan = (9.0, NOBODY)
    assert "newer than odometry" in pilot.receive_odometry(Odometry(1.2, (3.0, 2.0), (0.5, 0.0), 0.0, 1.0), 1.2).reason


def test_why_sensors_are_refused_is_told_once_that_matters() -> None:
    """While the last good obstacles are young it drives on; then it says why none came since, and the same of odometry."""
    drive = ready()
    faults = {what: f"{what} refused: so" for what in (OBSTACLES, ODOMETRY)}
    drive.pilot.faults = {what: (time.monotonic() + 99.0, why) for what, why in faults.items()}
    answers = [drive.step(None) for _ in range(8)]
    assert answers[0].drives and (answers[-1].level, answers[-1].reason) == (ERROR, "obstacles refused: so")
    assert drive.pilot.silent(9.0, 9.0).reason == "odometry refused: so"
    drive.pilot.faults = {what: (time.monotonic() - 0.6, why) for what, why in faults.items()}
    assert "silent" in drive.step(None).reason and "no odometry" in drive.pilot.silent(9.1, 9.1).reason


def test_a_path_beyond_any_map_may_be_sent_twice() -> None:
    """Nav2 sends a path again and again; before the robot has refused one that no map holds, another may come."""
    drive, far = ready(), np.array([[2.0, 2.0], [3.0e7, 2.0], [10.0, 2.0]])
    for _ in range(3):
        assert drive.pilot.go(Goal((10.0, 2.0), far.copy(), gives_up=True)).end is End.REPLACED


def test_a_sensor_that_sees_all_around_is_no_reason_to_look_farther_than_the_map() -> None:
    assert around(ROOM, (3.0, 3.0), math.inf) == around(ROOM, (3.0, 3.0), 1e30) == ROOM
    assert around(ROOM, (-0.1, 3.0), 1.0) is around(ROOM, (3.0, 1e9), 1.0) is None


def test_paths_that_lead_to_the_moon_are_refused() -> None:
    """A path of a billion metres ends the goal like any other from which the robot cannot set out; it takes no memory."""
    path = np.array([[2.0, 2.0], [1e9, 2.0], [10.0, 2.0]])
    drive = Drive(wait_timeout=1.0)
    drive.pilot.receive_map(ROOM)
    drive.pilot.go(Goal((10.0, 2.0), path, gives_up=True))
    answers = [drive.step() for _ in range(12)]
    assert "path" in answers[0].reason and answers[-1].end is End.WAITED


def test_a_path_that_leads_back_is_no_success() -> None:
    """A loop ends where the robot is: it was called driven before the robot had moved. The short rest of a path is driven."""
    loop, there = np.array([[2.0, 2.0], [6.0, 2.0], [6.0, 5.0], [2.1, 2.0]]), np.array([[2.0, 2.0], [6.0, 2.0], [2.0, 2.0]])
    for path, end in ((loop, End.REFUSED), (there, End.REFUSED), (loop[:1], End.ARRIVED), (loop[[0, 3]], End.ARRIVED)):
        drive = Drive()
        drive.pilot.receive_map(ROOM)
        drive.pilot.go(Goal(tuple(path[-1].tolist()), path, gives_up=True))
        answer = drive.step()
        assert answer.end is end and answer.command is STAND, answer


# Tours


def visit(loops: int = 0) -> tuple[SimpleNamespace, Callable[[], None], list]:
    """A tour in a node of which only what it uses is there; what lets its search end, and how the tour ended."""
    tasks: list = []
    node = SimpleNamespace(pilot=SimpleNamespace(map=ROOM), settings=settings(), orders=0, goals=[])
    node.executor = SimpleNamespace(create_task=lambda *task: tasks.append(task))

    def go(goal, done, feed) -> None:
        node.goals.append(goal)
        node.done = done

    node.go, ends = go, []
    TourGoal(node, (2.0, 2.0, 0.0), [(8.0, 2.0, 0.0), (4.0, 2.0, 0.0)], loops, lambda *end: ends.append(end), print)
    for _ in range(500):
        if tasks:
            break
        time.sleep(0.01)
    work, *arguments = tasks[0]
    return node, lambda: work(*arguments), ends


def test_a_tour_that_is_stopped_before_it_begins_does_not_begin(monkeypatch) -> None:
    """A stop, a cancel, another goal or another tour during the search for the best order ends the tour."""
    monkeypatch.setattr(tours, "SECONDS", 0.01)
    node, found, ends = visit()
    node.orders += 1
    found()
    assert node.goals == [] and ends[0][0] == nav2.TASK_EXECUTOR_FAILED and sorted(i for i, _ in ends[0][2]) == [0, 1]


def test_tours_repeat_as_often_as_is_said(monkeypatch) -> None:
    """Each round has the same order; billions of rounds take no memory, and end with what is left of them."""
    monkeypatch.setattr(tours, "SECONDS", 0.01)
    node, found, ends = visit(loops=1)
    found()
    for _ in range(4):
        assert not ends
        node.done(End.ARRIVED, "")
    assert [goal.xy[0] for goal in node.goals] == [4.0, 8.0, 4.0, 8.0] and ends == [(nav2.NONE, "", [])]
    node, found, ends = visit(loops=2**32 - 1)
    found()
    node.done(End.ARRIVED, "")
    node.done(End.DROPPED, "stopped")
    assert [i for i, _ in ends[0][2]] == [0, 1]


# What is shown


def test_markers_say_what_was_decided():
    """Decisions hold words, motion, target and obstacle; predictions a line and fading discs for each track."""
    tracks = Tracks(
        np.array([3, 4]), np.array([[4.0, 2.0], [5.0, 6.0]]), np.array([[0.5, 0.0], [np.nan, np.nan]]), np.array([0.3, 0.4])
    )
    drive = ready()
    announced = drive.pilot.decision()
    announced = replace(announced, obstacle=3, local_target=(3.0, 3.0), action="avoid")
    message = decision_message(announced, (2.0, 2.0), tracks, 1.0)
    spaces = [one.ns for one in message.markers[1:]]
    assert spaces == ["action", "motion", "target", "obstacle"] and message.markers[0].action == 3
    assert len({one.id for one in message.markers}) == len(message.markers)
    lines = predictions(tracks, ROOM, 3.0)
    np.testing.assert_allclose(lines[0][-1], [3.0, 5.5, 2.0])
    np.testing.assert_allclose(lines[1][-1], [3.0, 5.0, 6.0])
    shown = predictions_message(tracks, lines, 1.0).markers
    assert [one.ns for one in shown[1:]].count("places") == 6
    assert [round(one.pose.position.x, 9) for one in shown if one.ns == "places"][:3] == [4.5, 5.0, 5.5]
    fast = Tracks(np.array([1]), np.array([[10.0, 2.0]]), np.array([[2.0, 0.0]]), np.array([0.3]))
    (line,) = predictions(fast, ROOM, 3.0)
    assert len(line) == 3 and line[-1, 1] < line[1, 1] <= 12.0 - 0.3 + 1e-9, "mirrored at the wall"


def test_pheromone_is_shown_where_it_is():
    """The pheromone's costs lie in a window whose corner, on a turned map as well, is that of its first cell."""
    grid = replace(ROOM, origin=(1.0, 2.0, 0.6))
    drive = Drive()
    drive.xy = tuple(grid.to_xy([[10.0, 10.0]])[0].tolist())
    drive.pilot.receive_map(grid)
    drive.pilot.go(Goal(tuple(grid.to_xy([[10.0, 45.0]])[0].tolist())))
    ahead = grid.to_xy([[10.0, 20.0], [10.0, 28.0]])
    tracks = Tracks(np.arange(2), ahead, np.array([[-0.4, -0.3], [-0.3, -0.3]]), np.array([0.5, 0.6]))
    shown = None
    for _ in range(10):
        drive.step(tracks)
        shown = shown or drive.pilot.pheromone()
    assert shown is not None
    costs, corner = shown
    assert costs.max() == 100 and costs.min() >= 0
    window = Grid(np.zeros(costs.shape, bool), grid.resolution, corner)
    cell = np.rint(grid.to_points(window.to_xy([[0, 0]])))
    np.testing.assert_allclose(grid.to_xy(cell), window.to_xy([[0, 0]]), atol=1e-9)


def test_pheromone_is_shown_at_the_scale_of_its_own_map(monkeypatch) -> None:
    """While the robot drives on after a map of another resolution came, pheromone and its cells are those of the one before."""
    sent = []
    publisher = SimpleNamespace(publish=sent.append, get_subscription_count=lambda: 0)
    monkeypatch.setattr(markers, "make", convert.plain)
    drive = ready()
    shown = markers.Pictures(drive.pilot, "map", lambda *_: publisher)
    drive.step(Tracks(np.arange(2), [[4.0, 2.0], [5.6, 2.0]], [[-0.4, -0.3], [-0.3, -0.3]], [0.5, 0.6]))
    assert drive.pilot.pheromone() is not None
    drive.pilot.receive_map(Grid(np.zeros((80, 120), bool), 0.1))
    shown.show(drive.t)
    assert [message.info.resolution for message in sent if hasattr(message, "info")] == [np.float32(0.2)]


# Robots


def test_what_drives_the_robot_is_compiled_before(monkeypatch) -> None:
    """The robot itself drives among obstacles, and then one with inertia and latency whose speeds are not measured."""
    played = []
    monkeypatch.setattr(compiling, "run", lambda scenario, policy: played.append((scenario, policy)))
    usual = settings(**{"robot.drive": "differential", "robot.radius": 0.31, "policy.mode": "strict"})
    loaded = []
    compiling._plan.cache_clear()
    monkeypatch.setattr(compiling, "call", lambda kernel, *details: loaded.append(kernel))
    monkeypatch.setattr(compiling, "solve", lambda problem, planner, **limits: loaded.append(planner))
    tour = compiling.plan_tour
    monkeypatch.setattr(compiling, "plan_tour", lambda *details, **limits: loaded.append(len(tour(*details, **limits).order)))
    compiling.compile_for(usual)
    assert {*PLANNERS, kalman.raise_variances, 3, 16} <= set(loaded), "what is asked for on the way"
    (first, _), (second, unmeasured) = played
    assert first.robot == usual.robot and len(first.world.obstacles) == 4
    assert second.robot == replace(usual.robot, a_max=1.0, latency=0.1)
    unmeasured.reset(second.task, 0)
    command = unmeasured.act(Observation(0.0, second.start, (math.nan, 0.0), 0.0, NOBODY))  # of its speeds nothing is used
    assert command.twist is not None and all(policy.mode == "strict" for _, policy in played)
    compiling.compile_for(usual)
    assert len(played) == 2, "once in a process"


def test_no_drive_is_refused_and_a_name_is_enough() -> None:
    """The node does not start without a drive or a robot by name; what is said besides departs from the named robot."""
    unsaid = defaults()
    del unsaid["robot.drive"]
    with pytest.raises(BadInput, match=r"robot\.drive"):
        Settings.of(unsaid)
    assert Settings.of(unsaid | {"robot.name": "turtlebot4"}).robot.v_max == 0.31
    slow = Settings.of(unsaid | {"robot.name": "amr", "robot.v_max": 0.5, "robot.latency": 0.2}).robot
    assert (slow.v_max, slow.latency, slow.drive) == (0.5, 0.2, "differential") and slow.footprint is not None
    plain = {"robot.name": "amr", "robot.v_max": 1.0, "robot.footprint": "[]", "robot.radius": 0.3}
    usual = Settings.of(unsaid | plain | {"robot.a_max": math.inf, "robot.brake_max": 0.0}).robot
    assert (usual.v_max, usual.footprint, usual.radius, usual.braking) == (1.0, None, 0.3, math.inf), "as usual, but said"
    with pytest.raises(BadInput, match=r"^robot\.name = 'turtlebot5'"):
        Settings.of(unsaid | {"robot.name": "turtlebot5"})


def test_the_dynamics_of_old_traces_are_refused(tmp_path) -> None:
    """No real robot jumps to a velocity, and such a robot never turned to the goal's yaw; a named one is refused, too."""
    named = tmp_path / "old.toml"
    named.write_text('drive = "differential"\ndynamics = "steps"\n')
    for given in ({"robot.drive": "differential", "robot.dynamics": "steps"}, {"robot.drive": "", "robot.name": str(named)}):
        with pytest.raises(BadInput, match=r"robot\.dynamics"):
            settings(**given)


def test_a_footprint_is_as_nav2_writes_it() -> None:
    """Text of a list of corners with numbers as C writes them, no square brackets missing; a disc without corners."""
    box = "[[0.3, 0.2], [0.3, -0.2], [-0.3, -0.2], [-0.3, 0.2]]"
    robot = Settings.of(defaults() | {"robot.drive": "differential", "robot.footprint": box}).robot
    assert robot.footprint is not None and robot.radius == pytest.approx(math.hypot(0.3, 0.2))
    assert settings(**{"robot.footprint": "[ [.3, .2], [.3, -.2], [-.3, -.2], [-.3, .2], ]"}).robot.footprint == robot.footprint
    closed = box.replace("]]", "], [0.3, 0.2]]")
    assert settings(**{"robot.footprint": closed}).robot.footprint == robot.footprint, "the first corner may be the last, too"
    for disc in ("", "[]", " [ ] "):
        assert settings(**{"robot.footprint": disc}).robot.footprint is None
    for wrong in ("[[0.3, 0.2]", "{}", "[[0, 0], [1, 1], [1, 0], [0, 1]]", "[1, 2, 3]", "None", "[" * 10**5, 3.0):
        with pytest.raises(BadInput, match=r"robot\.footprint"):
            Settings.of(defaults() | {"robot.drive": "differential", "robot.footprint": wrong})


def test_wheels_turn_to_the_goals_yaw() -> None:
    """At the goal wheels turn in place until they point as the goal does, and have arrived then."""
    pilot = Pilot(settings(**{"robot.drive": "differential", "robot.alpha_max": 3.0, "yaw_tolerance": 0.1}))
    pilot.receive_map(Grid(np.zeros((20, 20), bool), 0.5))
    pilot.go(Goal((5.0, 5.0), yaw=2.0))
    heading = rate = t = 0.0
    for _ in range(100):
        pilot.scan = (t, Tracks.none())
        answer = pilot.receive_odometry(Odometry(t, (5.0, 5.05), (0.0, 0.0), heading, rate), t)
        if answer.end is not None:
            break
        rate = answer.command.twist[1]
        heading, t = heading + 0.1 * rate, t + 0.1
    assert answer.end is End.ARRIVED and abs(heading - 2.0) <= 0.1


LONG = {
    "robot.drive": "differential",
    "robot.footprint": "[[0.6, 0.3], [0.6, -0.3], [-0.6, -0.3], [-0.6, 0.3]]",
    "robot.a_max": 1.0,
    "robot.alpha_max": 3.0,
    "yaw_tolerance": 0.1,
    "progress_time": 1.0,
}  # longer than a corridor of 1 m is wide


def turned(pilot: Pilot, steps: int, t: float = 0.0) -> tuple[float, list]:
    """The heading, and the answers of a pilot whose robot stands at its goal and turns as it is told."""
    heading, rate, answers = 0.0, 0.0, []
    for k in range(steps):
        pilot.scan = (t + 0.1 * k, NOBODY)
        answers.append(pilot.receive_odometry(Odometry(t + 0.1 * k, (6.0, 2.05), (0.0, 0.0), heading, rate), t + 0.1 * k))
        if answers[-1] is None or answers[-1].end is not None:
            break
        rate = 0.0 if answers[-1].command.twist is None else answers[-1].command.twist[1]
        heading += 0.1 * rate
    return heading, answers


@pytest.mark.parametrize("large", [False, True])
def test_a_robot_that_turns_and_is_found_elsewhere_stops_to_turn(monkeypatch, large: bool) -> None:
    """Noise of its place does not matter. Farther away it brakes by the turn's guard, plans anew, and only then drives."""
    run, go_on = beside.Beside._run, threading.Event()
    monkeypatch.setattr(beside, "_AT_ONCE", 0 if large else 2**16)
    monkeypatch.setattr(beside.Beside, "_run", lambda self, work: (go_on.wait(60.0), run(self, work)))
    pilot = Pilot(settings(**INERTIA, yaw_tolerance=0.1))
    pilot.receive_map(ROOM)
    pilot.go(Goal((6.0, 2.0), yaw=3.0))
    heading, answers = turned(pilot, 8)
    t, rate = 0.8, answers[-1].command.twist[1]

    def step(x: float) -> PilotAnswer:
        nonlocal t, rate
        pilot.scan = (t, NOBODY)
        answer = pilot.receive_odometry(Odometry(t, (x, 2.0), (0.0, 0.0), heading, rate), t)
        t, rate = t + 0.1, (answer.command.twist or (0.0, 0.0))[1]
        return answer

    assert rate > 0.5 and "turns" in step(6.29).reason and "turns" in step(5.71).reason
    answers = [step(6.31)]
    assert "no longer at the goal" in answers[0].reason
    while answers[-1].drives and len(answers) < 20:
        answers.append(step(6.31))
    assert not answers[-1].drives, "the turn is braked"
    if large:
        assert [step(6.31).reason for _ in range(3)] == ["the robot plans before it sets out"] * 3
        go_on.set()
    for _ in range(200):
        if step(6.31).drives:
            break
        time.sleep(0.01)
    assert pilot.guard is pilot.policy.guard


def test_a_robot_that_cannot_turn_to_the_yaw_says_so_and_gives_up() -> None:
    """A long footprint in a narrow corridor stands askew: the guard brakes, and a goal that gives up ends without progress."""
    blocked = np.ones((40, 120), bool)
    blocked[15:25] = False
    corridor = Grid(blocked, 0.1)
    for gives_up in (True, False):
        pilot = Pilot(settings(**LONG))
        pilot.receive_map(corridor)
        pilot.go(Goal((6.0, 2.0), yaw=1.57, gives_up=gives_up))
        heading, answers = turned(pilot, 60)
        assert abs(heading) < 1.0 and "lets no turn" in answers[10].reason
        assert answers[-1].end is (End.STUCK if gives_up else None)


def test_a_robot_beside_the_map_says_that_it_cannot_turn_there() -> None:
    pilot = Pilot(settings(**{"robot.name": "diff", "robot.drive": "", "yaw_tolerance": 0.1}))
    pilot.receive_map(ROOM)
    pilot.go(Goal((-0.1, 2.0), yaw=1.5))
    pilot.scan = 0.1, NOBODY
    answer = pilot.receive_odometry(Odometry(0.1, (-0.05, 2.0), (0.0, 0.0), 0.0), 0.1)
    assert answer.level == ERROR and "cannot turn" in answer.reason and not answer.drives


def test_a_new_map_or_clock_counts_for_the_turn_to_the_yaw() -> None:
    """The guard of the turn knows the walls of a map that came during the turn, and obeys a clock that went back."""
    room, narrow = np.zeros((40, 120), bool), np.ones((40, 120), bool)
    narrow[15:25] = False
    pilot = Pilot(settings(**LONG))
    pilot.receive_map(Grid(room, 0.1))
    pilot.go(Goal((6.0, 2.0), yaw=1.57))
    turned(pilot, 2, t=50.0)
    pilot.receive_map(Grid(narrow, 0.1))
    heading, _ = turned(pilot, 40, t=50.2)
    assert abs(heading) < 1.0
    pilot.receive_map(Grid(room, 0.1))
    heading, answers = turned(pilot, 40, t=10.0)
    assert "jumped" in answers[0].reason and abs(heading - 1.57) < 0.1 and answers[-1].end is End.ARRIVED


# Stops of robots with inertia


class Piloted:
    """A policy: the pilot drives to a goal; at `when` s, `what` is done to it, as a node would."""

    def __init__(
        self, goal: tuple[float, float], robot: dict, when: float = math.inf, what: str = "", path: bool = False
    ) -> None:
        self.pilot, self.goal, self.when, self.what, self.path = Pilot(settings(**robot)), goal, when, what, path
        self.answer, self.ends = PilotAnswer(STAND, OK, ""), []

    def reset(self, task: Task, seed: int) -> None:
        self.grid = task.grid
        self.pilot.receive_map(task.grid)
        self.pilot.go(Goal(self.goal))

    def act(self, o: Observation) -> Command:
        pilot = self.pilot
        if o.t < self.when or self.what != "sensor":
            pilot.scan = o.t, o.tracks
        answers = []
        if self.what == "follow" and 0.5 < o.t < self.when and round(10.0 * o.t) % 5 == 0:
            self.goal = self.goal[0], self.goal[1] + 0.05
            path = np.array([o.xy, (5.0, 2.0), self.goal]) if self.path else None
            answers.append(pilot.go(Goal(self.goal, path)))
            assert answers[-1].drives
        elif self.when - 0.05 <= o.t < self.when + 0.05:
            blocked = self.grid.blocked.copy()
            blocked[28:32, 20:24] = True
            if self.what == "drop":
                answers.append(pilot.drop("on request"))
            elif self.what == "preempt":
                answers.append(pilot.go(Goal((2.0, 3.0))))
            elif self.what == "map":
                answers.append(pilot.receive_map(replace(self.grid, blocked=blocked)))
        answers.append(pilot.receive_odometry(Odometry(o.t, o.xy, o.velocity, o.heading, o.turn_rate), o.t))
        for answer in filter(None, answers):
            self.answer = answer
            self.ends += [answer.end] * (answer.end is not None)
        if pilot.outset.making is not None:
            pilot.outset.making.work.result()  # simulations are faster than real time
        return Command(twist=(0.0, 0.0)) if self.answer.command is STAND else self.answer.command

    def explain(self) -> Decision:
        return Decision("follow", "")


RECTANGLE = {
    "robot.drive": "differential",
    "robot.footprint": "[[0.4, 0.25], [0.4, -0.25], [-0.4, -0.25], [-0.4, 0.25]]",
    "robot.a_max": 0.8,
    "robot.alpha_max": 2.0,
    "robot.turn_rate": 1.5,
    "robot.v_reverse": 0.3,
}


def toward_the_wall(room: float, y: float, robot: dict, *event: object, horizon: float) -> Piloted:
    """Play on after the end of a drive to a place with this room before the wall at the end of a hall; nothing is touched."""
    hall = Grid(np.zeros((60, 100), bool), 0.1)
    spec = settings(**robot).robot
    policy = Piloted((10.0 - spec.radius - room, y), robot, *event)
    result = run(Scenario(World(hall), (5.0, 3.0), (1.0, 5.0), robot=spec, horizon=horizon), policy, record=False)
    assert result.outcome is Outcome.TIMEOUT, (robot, event, result.reason)
    return policy


@pytest.mark.parametrize("silent", ["obstacles", "odometry"])
@pytest.mark.parametrize("clock", [0.0, 1.7e9])
def test_after_a_silence_it_drives_on_by_any_clock(silent: str, clock: float) -> None:
    """The stop counted from 1970 and the policy from its start: for the guard the clock had gone back, and it braked on."""
    drive, velocity = Drive(**{"robot.name": "diff", "robot.drive": ""}), 0.0
    drive.t = clock
    drive.pilot.receive_map(ROOM)
    drive.pilot.go(Goal((10.0, 2.0)))

    def step(dt: float = 0.1, seen: bool = True) -> PilotAnswer | None:
        nonlocal velocity
        drive.t, drive.now, drive.xy = drive.t + dt, drive.now + dt, (drive.xy[0] + dt * velocity, 2.0)
        drive.pilot.scan = (drive.t, NOBODY) if seen else drive.pilot.scan
        answer = drive.pilot.receive_odometry(Odometry(drive.t, drive.xy, (velocity, 0.0), 0.0), drive.now)
        velocity = velocity if answer is None else (answer.command.twist or (0.0, 0.0))[0]
        return answer

    for _ in range(15):
        step()
    assert velocity > 0.5
    if silent == "obstacles":
        while drive.pilot.guard is not None:
            step(seen=False)
    else:
        assert "no odometry" in drive.pilot.silent(0.3, 0.3).reason
        velocity = (drive.pilot.command.twist or (0.0, 0.0))[0]
        step(0.4)
    answers = [step() for _ in range(20)]
    assert velocity > 0.5 and answers[-1].reason.startswith("follow"), answers[-1]


@pytest.mark.parametrize(
    ("robot", "room", "y"),
    [
        ({"robot.name": "diff", "robot.drive": ""}, 0.2, 3.25),
        ({"robot.name": "jackal", "robot.drive": ""}, 0.1, 3.25),
        (RECTANGLE, 0.2, 3.0),
    ],
)
def test_a_robot_that_arrives_before_a_wall_stops_by_the_guard(robot: dict, room: float, y: float) -> None:
    """Straight braking would touch the wall; the stop that the guard keeps certified does not, and ends with zeros."""
    policy = toward_the_wall(room, y, robot, horizon=7.5)
    assert policy.ends == [End.ARRIVED] and policy.answer.command is STAND and policy.pilot.guard is None


@pytest.mark.parametrize("path", [False, True])
@pytest.mark.parametrize("robot", ["holonomic", "inertia", "diff", "jackal"])
def test_a_goal_that_moves_is_followed_without_a_stop(robot: str, path: bool) -> None:
    """It moves by 5 cm twice a second; each time the robot used to stop, and to forget what it had learnt."""
    policy = Piloted((8.5, 3.0), {"robot.name": robot, "robot.drive": ""}, 3.4, "follow", path)
    hall, spec = Grid(np.zeros((60, 100), bool), 0.1), policy.pilot.settings.robot
    beside = Obstacle(0.3, Line((8.0, 5.0), (1.0, 5.0), speed=0.5))
    result = run(Scenario(World(hall, (beside,)), (1.0, 3.0), (9.0, 5.0), robot=spec, horizon=3.5), policy)
    assert result.outcome is Outcome.TIMEOUT
    assert len(policy.ends) >= 5 and set(policy.ends) == {End.REPLACED}
    speeds = np.hypot(*np.diff(result.trace.xy, axis=0).T) / spec.dt
    assert (speeds[12:] > 0.9 * min(spec.v_max, 1.0)).all(), speeds
    assert policy.pilot.policy.task.goal[1] > 3.1
    assert len(policy.pilot.policy.state.tracker.estimates) == 1 and policy.pilot.policy.state.started < 0.2


@pytest.mark.parametrize(
    ("what", "room", "when"), [("drop", 0.2, 2.9), ("preempt", 0.1, 3.0), ("map", 0.2, 2.9), ("sensor", 0.2, 2.9)]
)
def test_every_stop_before_a_wall_is_the_guards(what: str, room: float, when: float) -> None:
    """A goal dropped or pre-empted, a new map and a sensor that falls silent at high speed lead to no contact either."""
    toward_the_wall(room, 3.25, {"robot.name": "jackal", "robot.drive": ""}, when, what, horizon=when + 1.5)


def test_a_stop_that_turns_is_driven_to_its_end(monkeypatch) -> None:
    """Once in each control period, also without odometry and when the node ends; a new goal waits for its end."""
    monkeypatch.setattr(time, "sleep", lambda seconds: None)
    for way in ("odometry", "silent", "the node ends", "a new goal"):
        drive = ready(**{"robot.drive": "differential", "robot.a_max": 1.0, "robot.alpha_max": 3.0})
        pilot, last = drive.pilot, drive.pilot.command
        pilot.guard.dynamic.keep[1:3] = 0.5, 2.0
        assert pilot.drop("on request").command is last
        if way == "a new goal":
            pilot.go(Goal((2.0, 6.0)))
        if way == "the node ends":
            answers = list(pilot.braking())
        elif way == "silent":
            assert pilot.silent(0.1, 0.1) is None
            answers = [pilot.silent(0.2 + 0.1 * k, 0.2 + 0.1 * k) for k in range(3)]
            assert pilot.silent(0.5, 0.5) is None
        else:
            answers = [drive.step() for _ in range(3)]
        assert [one.command.twist for one in answers[:2]] == [(0.0, 0.5)] * 2 and answers[2].command is STAND
        assert {one.reason for one in answers} == {"on request"}
        after = drive.step()
        assert after.drives if way == "a new goal" else after is None


@pytest.mark.parametrize("yaw", [0.0, 0.5])
def test_a_stop_with_a_bend_is_driven_without_wheels(yaw: float) -> None:
    """A robot without wheels is sent the velocities of the guard's stop, in the frame of a map that may be turned."""
    drive = Drive(**{"robot.name": "inertia", "robot.drive": ""})
    pilot = drive.pilot
    pilot.receive_map(replace(ROOM, origin=(0.0, 0.0, yaw)))
    pilot.go(Goal((8.0, 6.0)))
    until(drive, lambda answer: answer.drives)
    pilot.guard.dynamic.keep[:3] = 0.5, 0.0, 2.0
    pilot.drop("on request")
    answers = [drive.step() for _ in range(3)]
    for answer in answers[:2]:
        assert answer.command.velocity == pytest.approx((0.5 * math.cos(yaw), 0.5 * math.sin(yaw)))
        assert convert.twist_message(answer.command, (0.0, 0.0), yaw, pilot.settings.robot).linear.x == pytest.approx(0.5)
    assert answers[2].command is STAND


@pytest.mark.parametrize("yaw", [0.5, math.pi / 2])
def test_a_map_of_another_yaw_does_not_turn_a_stop_with_a_bend(yaw: float) -> None:
    """The stop is that of the map in which the guard has certified it."""
    drive = Drive(**{"robot.name": "inertia", "robot.drive": ""})
    pilot = drive.pilot
    pilot.receive_map(ROOM)
    pilot.go(Goal((8.0, 6.0)))
    until(drive, lambda answer: answer.drives)
    pilot.guard.dynamic.keep[:3] = 0.5, 0.0, 2.0
    pilot.receive_map(replace(ROOM, origin=(0.0, 0.0, yaw)))
    answers = [drive.step() for _ in range(3)]
    assert [answer.command.velocity for answer in answers] == [(0.5, 0.0), (0.5, 0.0), (0.0, 0.0)]


def test_after_a_jump_of_the_clock_late_odometry_does_not_hold_the_stop() -> None:
    """Control periods that were missed before the jump do not count after it: the next command comes in time."""
    drive = ready(**INERTIA)
    pilot = drive.pilot
    pilot.guard.dynamic.keep[1:3] = 0.5, 12.0
    for late in (0.225, 0.325, 0.425, 0.525, 0.625, 0.725, 0.825):
        assert pilot.silent(late, late) is not None
    assert "jumped" in drive.step(None, dt=1000.0, passed=0.85).reason and pilot.answered == drive.now
    assert pilot.silent(0.1, 0.1) is None and pilot.silent(0.175, 0.175) is not None


def test_odometry_a_little_faster_than_the_period_is_answered_in_time() -> None:
    """After each message the next one is due a period later, however many came a little early before."""
    drive = ready()
    for k in range(200):
        assert drive.step(dt=0.095, passed=0.095) is not None
        assert k < 5 or drive.pilot.due <= drive.t + 0.1 + 1e-9
    drive.pilot.drop("on request")
    assert sum(drive.step(dt=0.05, passed=0.05) is not None for _ in range(8)) <= 4


# The guard's process


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork and named pipes")
def test_the_guards_process_sends_what_the_pilot_says():
    """With the guard's process the pilot drives as without it; when that is killed, it stands, says so, and never raises."""
    task = Task(ROOM, settings().robot, (2.0, 2.0), (9.0, 6.0))
    with GuardProcess(task, slack=0.05, mode=settings().policy["mode"]) as guard:
        guarded, plain = Pilot(settings(), guard), Pilot(settings())
        xy = (2.0, 2.0)
        for pilot in (guarded, plain):
            pilot.receive_map(ROOM)
            pilot.go(Goal((9.0, 6.0), gives_up=False))
        for k in range(20):
            t = 50.0 + 0.1 * k
            tracks = Tracks(np.array([1]), np.array([[5.0, 6.0 - 0.05 * k]]), np.array([[0.0, -0.5]]), np.array([0.3]))
            for pilot in (guarded, plain):
                pilot.scan = (t, tracks)
            answers = [pilot.receive_odometry(Odometry(t, xy, plain.command.velocity, 0.0), t) for pilot in (guarded, plain)]
            if answers[0].level == OK:  # this machine may be too slow for it
                assert answers[0].reason == answers[1].reason
                assert answers[0].command.velocity == pytest.approx(answers[1].command.velocity, abs=1e-12)
                number = guarded.number
                assert number > 0 and guard.link.replied(number).command == answers[0].command
            xy = tuple(a + 0.1 * v for a, v in zip(xy, answers[1].command.velocity, strict=True))
        assert guarded.silent(1.0, 1.0).command is STAND and guarded.number == 0
        time.sleep(0.3)
        assert guard.link.replied(number).did == "free", "it rests, and brakes no more"
        guard.process.kill()
        guard.process.wait()
        for _ in range(2):
            t += 0.1
            guarded.scan = (t, NOBODY)
            answer = guarded.receive_odometry(Odometry(t, xy, (0.0, 0.0), 0.0), t)
            assert not answer.drives and answer.reason.startswith("the guard's process has ended: deactivate, clean up")
            guarded.policy = None  # and it cannot set out either
        wheels = Pilot(settings(**{"robot.drive": "differential", "yaw_tolerance": 0.1}), guard)
        wheels.receive_map(ROOM)
        wheels.go(Goal((9.0, 6.0), yaw=2.0))
        for k in range(2):
            wheels.scan = (t + 0.1 * k, NOBODY)
            answer = wheels.receive_odometry(Odometry(t + 0.1 * k, (9.0, 6.0), (0.0, 0.0), 0.0), t)
            assert not answer.drives and "guard's process has ended" in answer.reason
