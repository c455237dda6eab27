"""What the node does without ROS: frames, scans, ways, parameters, and the pilot that stands whenever it must."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from antway import Grid, Moves, check_episode, load_scenario, run
from antway.errors import BadInput, BadParameter
from antway.planning import Problem, solve
from antway.ros2 import frames, nav2
from antway.ros2.markers import decision_message, predictions, predictions_message
from antway.ros2.pilot import STAND, End, Goal, Pilot
from antway.ros2.scan import Tracker, discs, nameless, off_the_map, read_points
from antway.ros2.settings import Settings, parameters
from antway.ros2.ways import corridor, keeps_within, tracking
from antway.scenes import scene
from antway.world.policy import Command, Decision, Observation, Tracks
from common import cases, random_grid
from naive.laser import measured

ROOM = Grid(np.zeros((40, 60), bool), 0.2)
NOBODY = Tracks.none()


def settings(**changes) -> Settings:
    return Settings.of({name: one.default for name, one in parameters().items()} | changes)


# Frames


def test_a_frame_undone_is_none():
    """Chained with its inverse a pose is none; points, vectors and tracks moved into a frame and back are the same."""
    rng = np.random.default_rng(1)
    for _ in range(cases(100, 2000)):
        a, b = ((*rng.uniform(-9, 9, 2), rng.uniform(-3, 3)) for _ in range(2))
        np.testing.assert_allclose(frames.chain(a, frames.inverse(a)), frames.HERE, atol=1e-14)
        xy = rng.uniform(-9, 9, (5, 2))
        np.testing.assert_allclose(frames.move(frames.chain(a, b), xy), frames.move(a, frames.move(b, xy)), atol=1e-13)
        spread = np.array([np.cov(rng.normal(size=(4, 9))) for _ in range(5)])
        tracks = Tracks(np.arange(5), xy, rng.uniform(-1, 1, (5, 2)), np.ones(5), spread)
        back = frames.move_tracks(frames.inverse(a), frames.move_tracks(a, tracks))
        np.testing.assert_allclose(back.xy, tracks.xy, atol=1e-13)
        np.testing.assert_allclose(back.velocity, tracks.velocity, atol=1e-13)
        np.testing.assert_allclose(back.covariance, spread, atol=1e-13)


def test_a_levelled_map_has_its_cells_where_they_were():
    """Every cell of a levelled map, seen from the map's frame, is where it was; yaw 0 stays the same object."""
    rng = np.random.default_rng(2)
    for _ in range(cases(50, 500)):
        grid = replace(random_grid(rng), origin=(*rng.uniform(-9, 9, 2), rng.uniform(-3, 3)))
        flat, frame = frames.level(grid)
        cells = np.argwhere(np.ones(grid.shape, bool))
        assert flat.origin[2] == 0.0
        np.testing.assert_allclose(frames.move(frame, flat.to_xy(cells)), grid.to_xy(cells), atol=1e-12)
    assert frames.level(ROOM)[0] is ROOM


# Laser scans


def scan_of(ranges, **changes):
    fields = {"angle_min": -math.pi, "angle_increment": 2 * math.pi / len(ranges), "range_min": 0.05, "range_max": 6.0}
    return SimpleNamespace(**fields | changes, ranges=ranges)


def test_discs_in_a_scan_are_found():
    """Discs in a room, measured by an exact laser from anywhere, are found with their centres and radii; walls are not."""
    rng, found = np.random.default_rng(3), 0
    for _ in range(cases(12, 2000)):
        blocked = np.zeros((40, 40), bool)
        blocked[[0, -1]] = blocked[:, [0, -1]] = True
        r, c = rng.integers(4, 32, 2)
        blocked[r : r + 4, c : c + 4] = True
        grid = Grid(blocked, 0.25, (-3.0, 2.0, rng.uniform(-3, 3)))
        pose = (*grid.to_xy(rng.uniform(3, 36, (1, 2)))[0], rng.uniform(-3, 3))
        places, radii = grid.to_xy(rng.uniform(3, 36, (3, 2))), rng.uniform(0.2, 0.5, 3)
        ranges = measured(grid, places, radii, pose, 480, 6.0)
        xy, radius = discs(off_the_map(read_points(scan_of(ranges)), pose, grid, 0.05), gap=0.3, largest=0.8)
        for place, size in zip(xy, radius):  # whatever is found belongs to a disc, never to a wall
            assert (np.hypot(*(places - place).T) < radii + size + 0.05).any()
        empty = measured(grid, np.empty((0, 2)), np.empty(0), pose, 480, 6.0)
        for i, (place, size) in enumerate(zip(places, radii)):
            away, wide = math.dist(place, pose[:2]), grid.inflate(size + 0.3)
            alone = measured(grid, places[i : i + 1], radii[i : i + 1], pose, 480, 6.0)
            hit = alone < empty
            apart = all(math.dist(place, q) > size + s + 0.4 for j, (q, s) in enumerate(zip(places, radii)) if j != i)
            if not apart or not 0.3 + size < away < 4.0 or not wide.is_free(wide.cell_at(place)):
                continue
            whole = hit.sum() >= 480 / math.pi * math.asin(size / away) - 2 and (ranges[hit] == alone[hit]).all()
            if whole:  # no part of it is hidden
                found += 1
                near = np.hypot(*(xy - place).T)
                assert near.min() < 0.03 and abs(radius[near.argmin()] - size) < 0.03, (place, size, xy, radius)
    assert found > 5, found


def test_what_is_no_arc_is_held_by_its_discs():
    """Boards and corners become discs that hold every point of them, none larger than allowed; lone points are noise."""
    rng = np.random.default_rng(4)
    for _ in range(cases(100, 2000)):
        a, b, c = rng.uniform(-3, 3, (3, 2))
        share = np.linspace(0, 1, int(rng.integers(10, 60)))[:, None]
        corner = np.vstack((a + (b - a) * share, b + (c - b) * share[1:]))
        xy, radius = discs(np.vstack((corner, [[50.0, 50.0]])), gap=1.0, largest=0.8)
        assert (radius <= 0.8 + 0.5).all() and len(xy)
        holds = np.hypot(*(corner[:, None] - xy).transpose(2, 0, 1)) <= radius + 0.03
        assert holds.any(axis=1).all()
        assert np.hypot(*(xy - 50.0).T).min() > 10.0
    assert len(discs(np.empty((0, 2)), gap=0.3, largest=0.8)[0]) == 0


def test_malformed_scans_are_refused():
    """Ranges that say nothing are left out, -inf is as near as can be, and numbers that cannot be are refused by name."""
    points = read_points(scan_of([math.nan, math.inf, -math.inf, 1.0, 9.0, 0.01]))
    assert len(points) == 2
    np.testing.assert_allclose(np.hypot(*points.T), [0.05, 1.0])
    for name, value in (("angle_increment", 0.0), ("angle_min", math.nan), ("range_max", math.inf)):
        with pytest.raises(BadParameter, match=name):
            read_points(scan_of([1.0], **{name: value}))
    with pytest.raises(BadParameter, match="ranges"):
        read_points(SimpleNamespace(angle_min=0.0, angle_increment=0.1, range_min=0.0, range_max=1.0, ranges=[]))


def test_the_tracker_names_and_measures():
    """Nameless discs that move keep one name each, and their velocities are found; what is lost is kept for a second."""
    rng = np.random.default_rng(5)
    for _ in range(cases(20, 300)):
        n = int(rng.integers(1, 6))
        start = np.column_stack((3.0 * np.arange(n), rng.uniform(0, 1, n)))
        velocity, tracker = rng.uniform(-1.0, 1.0, (n, 2)), Tracker()
        for i in range(30):
            t = 0.1 * i
            order = rng.permutation(n)
            xy = start + velocity * np.array([0.0, 1.0]) * t + rng.normal(0, 0.01, (n, 2))
            tracks = tracker.update(t, nameless((xy[order], np.full(n, 0.3))))
        assert sorted(tracks.id) == list(range(n)) and len({*tracks.id.tolist()}) == n
        column = np.rint(tracks.xy[:, 0] / 3.0).astype(int)
        np.testing.assert_allclose(tracks.velocity[:, 1], velocity[column, 1], atol=0.12)
        assert (tracks.covariance.diagonal(axis1=1, axis2=2) > 0.0).all()
        assert len(tracker.update(t + 0.5, NOBODY)) == n and len(tracker.update(t + 1.5, NOBODY)) == 0
        assert len(tracker.update(0.0, nameless((xy, np.full(n, 0.3))))) == n, "time that goes back begins anew"
    named = Tracks(np.array([7]), np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))
    assert Tracker().update(0.0, named) is named
    unknown = replace(named, velocity=np.full((1, 2), math.nan))
    assert Tracker().update(0.0, unknown).id.tolist() == [7]
    with pytest.raises(BadParameter, match=r"tracks\.id"):
        Tracker().update(0.0, Tracks(np.array([1, -1]), np.zeros((2, 2)), np.zeros((2, 2)), np.ones(2)))


class Seeing:
    """A policy of antway.world that sees by a laser alone, and drives by a pilot in a frame that is turned and shifted."""

    def __init__(self, world: frames.Pose, **changes) -> None:
        self.world, self.pilot, self.tracker = world, Pilot(settings(**changes)), Tracker()
        self.drove: list[Decision] = []

    def reset(self, task, seed) -> None:
        self.grid = replace(task.grid, origin=frames.chain(self.world, task.grid.origin))
        self.pilot.chart(self.grid)
        self.pilot.go(Goal(frames.move_point(self.world, task.goal)))

    def act(self, o: Observation) -> Command:
        pose = frames.chain(self.world, (*o.xy, o.heading))
        truth = frames.move_tracks(self.world, o.tracks)
        points = read_points(scan_of(measured(self.grid, truth.xy, truth.radius, pose, 240, 5.5)))
        seen = discs(off_the_map(points, pose, self.grid, 0.15), gap=0.3, largest=0.8)
        self.pilot.scan = o.t, self.tracker.update(o.t, nameless(seen))
        answer = self.pilot.hear(o.t, pose[:2], frames.turn(self.world[2], o.velocity), pose[2], o.t)
        assert answer is not None, "one command each control period"
        told = self.pilot.decision()
        if told is not None:
            self.drove.append(told)
        return Command(frames.turn(-self.world[2], answer.command.velocity))

    def explain(self) -> Decision:
        return Decision("follow", "as the pilot says")


def test_a_robot_that_sees_by_laser_alone_reaches_its_goal():
    """In scene paper, on a map that is turned, among obstacles seen by laser alone: no contact, and the goal is reached."""
    place = load_scenario(scene("paper"))
    for seed in range(cases(1, 40)):
        robot = Seeing((3.0, -2.0, 0.7), **{"task.obstacle_speed": 1.0})
        result = run(place, robot, seed=seed)
        check_episode(result)
        assert result.outcome.value == "reached", (seed, result.outcome, result.reason)
        assert any(one.action == "avoid" for one in robot.drove)


# Ways


def test_a_corridor_is_what_lies_near_the_way():
    """In a corridor are the map's free cells within its width of the way, to a cell's edge, at the places where they were."""
    rng = np.random.default_rng(6)
    for _ in range(cases(20, 1000)):
        grid = replace(random_grid(rng, low=5, high=40), resolution=0.25, origin=(1.0, -2.0, 0.0))
        rows, cols = grid.shape
        way = grid.to_xy(rng.uniform(0, (rows - 1, cols - 1), (4, 2)))
        width = rng.uniform(0.2, 3.0)
        part = corridor(grid, way, width)
        dense = np.vstack([np.linspace(a, b, 300) for a, b in pairwise(way)])
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
        assert keeps_within(replace(part, blocked=part.blocked & False), way)
    assert not keeps_within(corridor(ROOM, np.array([[1.0, 1.0], [9.0, 1.0]]), 0.5), np.array([[1.0, 1.0], [9.0, 3.0]]))


def test_tracking_measures_from_the_nearest_point():
    """Distance, side and rest of a way are those of the nearest of many points along it."""
    rng = np.random.default_rng(7)
    for _ in range(cases(200, 5000)):
        way, xy = rng.uniform(0, 10, (5, 2)), tuple(rng.uniform(0, 10, 2))
        share = np.linspace(0, 1, 2000)[:, None]
        dense = np.vstack([a + (b - a) * share for a, b in pairwise(way)])
        away = np.hypot(*(dense - xy).T)
        found = tracking(way, xy, 0.0)
        assert math.isclose(abs(found.aside), away.min(), abs_tol=0.01)
        i = int(away.argmin())
        assert math.isclose(found.left, np.hypot(*np.diff(dense[i:], axis=0).T).sum(), abs_tol=0.02) or found.index != i // 2000
    straight = np.array([[0.0, 0.0], [4.0, 0.0]])
    assert tracking(straight, (1.0, -0.5), 0.0).aside == -0.5, "to the right of the way"
    assert tracking(straight, (1.0, 0.0), -0.3).turned == 0.3, "turned to the right of the way"
    assert tracking(straight[:1], (3.0, 4.0), 0.0).left == 5.0


# Nav2


def test_paths_and_their_failures():
    """A path by way of stops is as long as its legs, each of the shortest; every failure has Nav2's code."""
    blocked = np.zeros((20, 20), bool)
    blocked[10, :12] = blocked[2:6, 15] = blocked[2:6, 18] = blocked[2, 15:19] = blocked[5, 15:19] = True
    grid = Grid(blocked, 0.5)
    room = grid.inflate(0.2)
    stops = [(1.0, 1.0), (6.5, 6.5), (1.0, 9.0)]
    path = nav2.find_path(grid, room, stops, 0.2, "jps", 5.0)
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
            nav2.find_path(grid, room, ends, 0.2, "jps", 5.0)
        assert caught.value.code == code
    with pytest.raises(nav2.Failure) as caught:
        nav2.find_path(grid, room, stops, 0.2, "astar", 0.0)
    assert caught.value.code == nav2.PLAN_TIMEOUT
    near = nav2.find_path(grid, room, [free, wall], 0.2, "jps", 5.0, tolerance=1.0)[-1]
    assert room.is_free(room.cell_at(near)) and math.dist(near, wall) <= 1.0
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
        told = kind.feedback(distance_to_goal=1.0, speed=2.0, tracking_feedback=3.0)
        assert set(vars(told)) == set(feedback)
        assert vars(kind.result(error_code=7, error_msg="so", path=None)) == {"error_code": 7, "error_msg": "so"}


# Parameters


def test_parameters_have_the_ranges_of_their_definitions():
    """Each number is accepted at both ends of its range and refused just outside, in the words that the parameter tells."""
    found = parameters()
    defaults = {name: one.default for name, one in found.items()}
    for name, one in found.items():
        if isinstance(one.default, bool) or not isinstance(one.default, (int, float)):
            continue
        whole = isinstance(one.default, int)
        for end, out in ((one.low, -1), (one.high, 1)):
            Settings.of(defaults | {name: end})
            beyond = end + out if whole else math.nextafter(end, out * math.inf)
            if math.isfinite(end) and not (whole and abs(beyond) >= 2**63 - 1):
                with pytest.raises(BadInput) as caught:
                    Settings.of(defaults | {name: beyond})
                assert caught.value.allowed == one.allowed and name in str(caught.value)
    assert {"robot.radius", "task.goal_tolerance", "policy.chance", "timeout"} <= set(found)
    assert found["policy.moves"].default == Moves.THIRTY_TWO.value and "thirty-two" in found["policy.moves"].allowed


def test_converters_are_found_by_name():
    """A converter is imported by module:function; what cannot be is refused by name."""
    kind = {"obstacles_type": "geometry_msgs/msg/PolygonStamped"}
    reader = settings(**kind, obstacles_converter="antway.ros2.convert:read_markers").reader
    assert reader is not None and reader.__name__ == "read_markers"
    for hook in ("nowhere:f", "antway.ros2.convert:nothing", "antway.ros2.convert", "antway.ros2.convert:SPHERE", ":f"):
        with pytest.raises(BadParameter, match="obstacles_converter"):
            settings(**kind, obstacles_converter=hook)
    with pytest.raises(BadParameter, match="obstacles_type"):
        settings(**kind)


# The pilot


class Drive:
    """A pilot in an empty room, stepped by hand."""

    def __init__(self, **changes) -> None:
        self.pilot, self.t, self.now, self.xy = Pilot(settings(**changes)), 0.0, 0.0, (2.0, 2.0)

    def step(self, seen: Tracks | None = NOBODY, dt: float = 0.1, passed: float = 0.1):
        self.t, self.now = self.t + dt, self.now + passed
        if seen is not None:
            self.pilot.scan = self.t, seen
        return self.pilot.hear(self.t, self.xy, (0.0, 0.0), 0.0, self.now)


def ready(goal: Goal | None = None, **changes) -> Drive:
    """A drive that is under way."""
    drive = Drive(**changes)
    drive.pilot.chart(ROOM)
    drive.pilot.go(goal or Goal((10.0, 2.0)))
    assert drive.step().drives
    return drive


def test_the_pilot_waits_for_what_is_missing():
    """Without a map and without obstacles it stands and says so; with both it drives; at the goal it is done."""
    drive = Drive()
    assert drive.step() is None, "no goal"
    drive.pilot.go(Goal((10.0, 2.0)))
    drive.pilot.scan = None
    assert drive.step(None).reason == "waiting for a map"
    drive.pilot.chart(ROOM)
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
    assert drive.pilot.silent(0.4) is None and "no odometry" in drive.pilot.silent(0.6).reason


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


def test_maps_may_change_on_the_way():
    """A map that is the same changes nothing; a new one stops the robot once, and is driven on if it can be."""
    drive = ready()
    policy = drive.pilot.policy
    assert drive.pilot.chart(Grid(ROOM.blocked, 0.2)) is None and drive.pilot.policy is policy
    wall = ROOM.blocked.copy()
    wall[:30, 30] = True
    assert drive.pilot.chart(Grid(wall, 0.2)).reason == "the map has changed"
    assert drive.step().drives and drive.pilot.policy is not policy
    wall[5:15, 45:55] = True
    drive.pilot.chart(Grid(wall, 0.2))
    answer = drive.step()
    assert answer.end is End.REFUSED and "refused" in answer.reason
    drive = ready()
    wall = ROOM.blocked.copy()
    wall[9:12, 9:12] = True  # on the robot itself: it waits there for a better map
    drive.pilot.chart(Grid(wall, 0.2))
    assert "cannot set out" in drive.step().reason
    drive.pilot.chart(ROOM)
    assert drive.step().drives


def test_goals_are_replaced_and_dropped():
    """A new goal ends the one before with a stop, the same way again without; what is dropped ends as dropped."""
    drive = ready()
    answer = drive.pilot.go(Goal((2.0, 6.0)))
    assert answer.end is End.REPLACED and answer.command is STAND and "pre-empted" in answer.reason
    assert drive.step().drives
    way = np.array([[2.0, 2.0], [6.0, 3.0], [10.0, 2.0]])
    drive.pilot.go(Goal((10.0, 2.0), way, hurried=True))
    drive.step()
    policy = drive.pilot.policy
    answer = drive.pilot.go(Goal((10.0, 2.0), way + np.array([0.0, 0.3]), hurried=True))
    assert answer.end is End.REPLACED and answer.drives and drive.pilot.policy is policy
    answer = drive.pilot.go(Goal((10.0, 2.0), np.array([[2.0, 2.0], [6.0, 7.0], [10.0, 2.0]]), hurried=True))
    assert answer.command is STAND and drive.pilot.policy is None
    assert drive.pilot.drop("on request").end is End.DROPPED and drive.pilot.drop("again").end is None


def test_replanning_does_not_hide_that_it_waits():
    """Paths that are refreshed each 0.5 s neither move a robot whose sensor is silent, nor put off the end of its patience."""
    way = np.array([[2.0, 2.0], [10.0, 2.0]])
    for refreshed in (way, np.array([[2.0, 2.0], [6.0, 6.0], [10.0, 2.0]])):
        drive = ready(Goal((10.0, 2.0), way, hurried=True), patience=2.0)
        ends = []
        for i in range(40):
            answer = drive.step(None)
            if answer is None or answer.end is not None:
                break
            if drive.t > 0.75:
                assert answer.command is STAND
                if i % 5 == 0:
                    answer = drive.pilot.go(Goal((10.0, 2.0), refreshed, hurried=True))
                    assert answer.command is STAND and answer.end is End.REPLACED
                    ends.append(answer.end)
        assert answer.end is End.WAITED and len(ends) >= 3


def test_a_path_is_kept_to():
    """On a path that leads round, the robot keeps within the corridor, where without it the straight way would be driven."""
    way = np.array([[2.0, 2.0], [2.0, 6.5], [10.0, 6.5], [10.0, 2.0]])
    for goal, most in ((Goal((10.0, 2.0)), math.inf), (Goal((10.0, 2.0), way, hurried=True), 1.0 + 0.3)):
        drive, worst = ready(goal, corridor=1.0), 0.0
        for _ in range(400):
            answer = drive.step()
            if answer.end is not None:
                break
            vx, vy = answer.command.velocity
            drive.xy = drive.xy[0] + 0.1 * vx, drive.xy[1] + 0.1 * vy
            worst = max(worst, abs(tracking(way, drive.xy, 0.0).aside))
        assert answer.end is End.ARRIVED and worst <= most and (most < 9 or worst > 2.0), worst


def test_patience_and_progress_end_hurried_goals_alone():
    """follow_path's goals end when sensors are silent for longer than patience, or no progress is made; others wait on."""
    for hurried in (True, False):
        ends = []
        for silent in (True, False):
            drive = ready(Goal((10.0, 2.0), hurried=hurried), patience=1.0, progress_time=3.0)
            answers = [drive.step(None if silent else NOBODY) for _ in range(60)]
            ends += [one.end for one in answers if one is not None and one.end]
        assert ends == ([End.WAITED, End.HELD] if hurried else [])
    drive = ready(Goal((10.0, 2.0), hurried=True), patience=1.0)
    assert drive.pilot.silent(0.8).end is None and drive.pilot.silent(1.2).end is End.WAITED


# What is shown


def test_markers_say_what_was_decided():
    """Decisions hold words, motion, target and obstacle; predictions a line and fading discs for each track."""
    tracks = Tracks(
        np.array([3, 4]), np.array([[4.0, 2.0], [5.0, 6.0]]), np.array([[0.5, 0.0], [np.nan, np.nan]]), np.array([0.3, 0.4])
    )
    drive = ready()
    told = drive.pilot.decision()
    told = replace(told, obstacle=3, local_target=(3.0, 3.0), action="avoid")
    message = decision_message(told, (2.0, 2.0), tracks, 1.0)
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
    drive.pilot.chart(grid)
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
