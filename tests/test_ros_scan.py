"""Frames, and tracks out of laser scans: what is found is where it is, and a robot that sees nothing else gets along."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from antway import Grid, check_episode, load_scenario, run
from antway.errors import BadParameter
from antway.ros2 import frames
from antway.ros2.goals import Goal
from antway.ros2.pilot import Pilot
from antway.ros2.scan import (
    FIRST_ID,
    Background,
    Laser,
    ScanTracker,
    _of_radius,
    discs,
    newest_reached,
    read_points,
    without_ids,
)
from antway.ros2.settings import Settings
from antway.scenes import scene
from antway.world.policy import Command, Decision, Observation, Tracks
from common import cases, costly, random_grid
from fake_ros import defaults
from naive.laser import measured

# Frames


def test_a_frame_undone_is_none():
    """Chained with its inverse a pose is none; points, vectors and tracks moved into a frame and back are the same."""
    rng = np.random.default_rng(1)
    for _ in range(cases(100, 2000)):
        a, b = ((*rng.uniform(-9, 9, 2), rng.uniform(-3, 3)) for _ in range(2))
        np.testing.assert_allclose(frames.chain(a, frames.inverse(a)), frames.HERE, atol=1e-14)
        xy = rng.uniform(-9, 9, (5, 2))
        np.testing.assert_allclose(frames.move(frames.chain(a, b), xy), frames.move(a, frames.move(b, xy)), atol=1e-13)
        states = rng.normal(size=(5, 9, 2, 2))  # place and velocity
        spread, turned = (
            np.array([np.cov(one.reshape(9, 4).T) for one in many])
            for many in (states, frames.move((0, 0, a[2]), states).reshape(states.shape))
        )
        tracks = Tracks(np.arange(5), xy, rng.uniform(-1, 1, (5, 2)), np.ones(5), spread)
        moved = frames.move_tracks(a, tracks)
        np.testing.assert_allclose(moved.covariance, turned, atol=1e-13)
        back = frames.move_tracks(frames.inverse(a), moved)
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
    assert frames.level(flat)[0] is flat
    for yaw in (0.0, 0.3):  # UTM coordinates are too far away for an episode
        far = replace(flat, origin=(512345.0, 5412345.0, yaw))
        near, frame = frames.level(far)
        assert max(map(abs, near.origin)) < 1e5 and frames.chain(frame, near.origin) == pytest.approx(far.origin, abs=1e-8)


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
        xy, radius, fitted, _ = discs(
            Background(grid, 0.05).off(frames.move(pose, read_points(scan_of(ranges))[0]), pose[:2]), gap=0.3, largest=0.8
        )
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
                assert fitted[near.argmin()]
    assert found > 5, found


def test_what_is_no_arc_is_held_by_its_discs():
    """Boards and corners become discs that hold every point of them, none larger than allowed; lone points are noise."""
    rng = np.random.default_rng(4)
    for _ in range(cases(100, 2000)):
        a, b, c = rng.uniform(-3, 3, (3, 2))
        share = np.linspace(0, 1, int(rng.integers(10, 60)))[:, None]
        corner = np.vstack((a + (b - a) * share, b + (c - b) * share[1:]))
        xy, radius, *_ = discs(np.vstack((corner, [[50.0, 50.0]])), gap=1.0, largest=0.8)
        assert (radius <= 0.8 + 0.5).all() and len(xy)
        holds = np.hypot(*(corner[:, None] - xy).transpose(2, 0, 1)) <= radius + 0.03
        assert holds.any(axis=1).all()
        assert np.hypot(*(xy - 50.0).T).min() > 10.0
    assert len(discs(np.empty((0, 2)), gap=0.3, largest=0.8)[0]) == 0
    boards = np.array([(0.0, 0.0), (0.1, 0.0), (5.0, 0.0), (5.1, 0.0)])
    assert discs(boards, gap=0.3, largest=0.8)[0][:, 0] == pytest.approx([0.05, 5.05]), "in the order of beams"


def test_points_at_one_place_are_a_disc() -> None:
    """Rounding made the square of the radius of a circle through them negative, which ended the node."""
    rng = np.random.default_rng(0)
    for _ in range(cases(300, 5000)):
        place, n = rng.uniform(-300, 300, 2), int(rng.integers(5, 12))
        xy, radius, *_ = discs(place + 1e-15 * rng.normal(size=(n, 2)), gap=0.3, largest=0.8)
        np.testing.assert_allclose(xy, [place], atol=1e-12)
        assert 0.0 <= radius[0] < 1e-12


def test_points_of_the_map_are_those_near_its_walls() -> None:
    """Every cell of the square around a point is looked at, on any map; one look at a large map takes no time for each beam."""
    rng = np.random.default_rng(12)
    for _ in range(cases(60, 5000)):
        grid = Grid(rng.random((30, 20)) < 0.05, rng.uniform(0.05, 0.5), (3.0, -2.0, rng.uniform(-3, 3)))
        clear, points = rng.uniform(0.01, 1.0), grid.to_xy(rng.uniform(-2, (31, 21), (200, 2)))
        laser = tuple(grid.to_xy(rng.uniform(0, (29, 19), (1, 2)))[0].tolist())
        free = []
        for (y, x), point in zip(grid.to_points(points) + 0.5, points, strict=True):
            near = (clear + 0.02 * math.dist(point, laser)) / grid.resolution  # 0.02 rad: the heading is never exact
            rows, cols = (
                range(math.floor(y - near), math.floor(y + near) + 1),
                range(math.floor(x - near), math.floor(x + near) + 1),
            )
            free.append(all(grid.is_free((row, col)) for row in rows for col in cols))
        np.testing.assert_array_equal(Background(grid, clear).off(points, laser), points[free])
    walls, many = Background(Grid(np.zeros((2000, 2000), bool), 0.01), 1.0), rng.uniform(2.0, 18.0, (1080, 2))
    started = time.perf_counter()
    assert len(walls.off(many, (10.0, 10.0))) == 1080 and time.perf_counter() - started < 0.1


def test_each_beam_is_placed_by_where_the_robot_was() -> None:
    """While the robot turns and drives, a sweep of 0.1 s smears no wall of the map, and finds the disc; nonsense is ignored."""
    blocked = np.zeros((60, 60), bool)
    blocked[[0, -1]] = blocked[:, [0, -1]] = True
    grid, laser, places = Grid(blocked, 0.2), Laser(0.5), np.array([[8.0, 4.0]])

    def pose(t: float) -> frames.Pose:
        return 4.0 + t, 5.0, 3.0 + 2.0 * t  # from 3.0 rad to beyond pi

    for k in range(-10, 30):
        laser.moved(0.05 * k, pose(0.05 * k))
    one = []
    for i in range(360):
        x, y, yaw = pose(0.1 * i / 360)
        one += measured(grid, places, np.array([0.4]), (x, y, yaw + 2 * math.pi * i / 360), 1, 12.0).tolist()
    for increment, found in ((0.1 / 360, 1), (math.nan, 0), (0.1, 0), (-0.001, 0)):
        laser.receive(0.0, scan_of(one, range_max=12.0, time_increment=increment))
        scan = newest_reached(laser.waiting, 0.2)
        points = Background(grid, 0.15).off(laser.placed(scan, frames.HERE, False, 0.2), pose(0.0)[:2])
        if found:
            assert laser.middle(scan) == pytest.approx(0.05, abs=1e-3)
            np.testing.assert_allclose(discs(points, gap=0.3, largest=0.8)[0], places, atol=0.03)
        else:
            assert laser.middle(scan) == 0.0 and len(points) > 40, "walls that are smeared are obstacles"


def test_malformed_scans_are_refused():
    """Ranges that say nothing are left out, -inf is as near as can be, and numbers that cannot be are refused by name."""
    points, beams = read_points(scan_of([math.nan, math.inf, -math.inf, 1.0, 9.0, 0.01]))
    assert beams.tolist() == [2, 3]
    np.testing.assert_allclose(np.hypot(*points.T), [0.05, 1.0])
    points, beams = read_points(scan_of([0.0, 0.01, 1.0, 50.0, math.inf], range_min=0.0, range_max=math.inf))
    assert beams.tolist() == [1, 2, 3], "0 is no return, and pointcloud_to_laserscan does not limit ranges"
    assert read_points(scan_of([6.0, 5.99, 6.0]), 1.0)[1].tolist() == [1], "range_max is no return, but a valid one"
    for name, value in (
        ("angle_increment", 0.0),
        ("angle_increment", 1.7e308),
        ("angle_min", math.nan),
        ("range_max", math.nan),
        ("range_max", -math.inf),
    ):
        with pytest.raises(BadParameter, match=name):
            read_points(scan_of([1.0], **{name: value}))
    with pytest.raises(BadParameter, match="ranges"):
        read_points(SimpleNamespace(angle_min=0.0, angle_increment=0.1, range_min=0.0, range_max=1.0, ranges=[]))


def test_scans_of_a_clock_that_is_ahead_are_dropped() -> None:
    """They used to be waited for, so that the robot drove on by scans that were old."""
    laser = Laser(0.5)
    laser.moved(10.0, (0.0, 0.0, 0.0))
    for stamp in (10.7, 10.8):
        laser.receive(stamp, scan_of([1.0]))
    assert laser.drop_newer(10.3, 0.5) == 0.0 and len(laser.waiting) == 2
    assert laser.drop_newer(10.0, 0.5) == pytest.approx(0.7) and not laser.waiting
    assert laser.drop_newer(10.0, 0.5) == 0.0 and laser.newest == 10.0 and Laser(0.5).newest == -math.inf


@pytest.mark.parametrize("rate", [10, 200])
def test_scans_wait_for_late_odometry_at_any_rate(rate: int) -> None:
    """Odometry that is 0.4 s late reached no scan of a fast laser: only the last 20 were kept, which are of 0.1 s at 200 Hz."""
    laser, reached = Laser(0.5), list[float]()
    for k in range(3 * rate):
        t = k / rate
        laser.receive(t, scan_of([1.0]))
        if k % (rate // 10) == 0 and t > 0.39:
            laser.moved(t - 0.39, (0.0, 0.0, 0.0))
            found = newest_reached(laser.waiting, t - 0.39)
            reached += [] if found is None else [found[0]]
            assert laser.drop_newer(t - 0.39, 0.5) == 0.0
    assert len(reached) > 20 and max(np.diff(reached)) < 0.11


def test_a_scan_with_too_few_valid_beams_is_none():
    """D14: a laser that is covered, or whose numbers make no sense, does not say that the place is empty."""
    nan, inf = math.nan, math.inf
    for ranges, sound in (
        ([nan] * 8, 0.0),
        ([0.0] * 8, 0.0),
        ([nan] * 6 + [1.0, inf], 0.25),
        ([inf] * 8, 1.0),
        ([-inf, 9.0, 1.0, nan], 0.5),
        ([-inf] * 8, 0.0),
    ):
        read_points(scan_of(ranges), sound)
        with pytest.raises(BadParameter, match="valid"):
            read_points(scan_of(ranges), sound + 0.01)
    for near, far in ((2.0, 1.0), (-1.0, 1.0)):
        with pytest.raises(BadParameter, match="range_min"):
            read_points(scan_of([1.5], range_min=near, range_max=far))


def test_the_tracker_names_and_measures():
    """Nameless discs that move keep one name each, and their velocities are found; what is lost is kept for a second."""
    rng = np.random.default_rng(5)
    for _ in range(cases(20, 300)):
        n = int(rng.integers(1, 6))
        start = np.column_stack((3.0 * np.arange(n), rng.uniform(0, 1, n)))
        velocity, tracker = rng.uniform(-1.0, 1.0, (n, 2)), ScanTracker()
        for i in range(30):
            t = 0.1 * i
            order = rng.permutation(n)
            xy = start + velocity * np.array([0.0, 1.0]) * t + rng.normal(0, 0.01, (n, 2))
            tracks = tracker.update(t, without_ids(xy[order], np.full(n, 0.3)))
        assert sorted(tracks.id) == list(range(FIRST_ID, FIRST_ID + n)) and len({*tracks.id.tolist()}) == n
        column = np.rint(tracks.xy[:, 0] / 3.0).astype(int)
        np.testing.assert_allclose(tracks.velocity[:, 1], velocity[column, 1], atol=0.12)
        assert (tracks.covariance.diagonal(axis1=1, axis2=2) > 0.0).all()
        lost, spread = tracker.update(t + 0.5, Tracks.none()), tracks.covariance
        np.testing.assert_allclose(lost.covariance[:, 0, 2], spread[:, 0, 2] + 0.5 * spread[:, 2, 2])
        assert len(lost) == n and len(tracker.update(t + 1.5, Tracks.none())) == 0
        assert len(tracker.update(0.0, without_ids(xy, np.full(n, 0.3)))) == n, "time that goes back begins anew"
    first = Tracks(np.array([0]), np.zeros((1, 2)), np.zeros((1, 2)), np.ones(1))
    named = replace(first, id=np.array([7]))
    for complete in (first, named):
        assert ScanTracker().update(0.0, complete) is complete
    unknown = replace(named, velocity=np.full((1, 2), math.nan))
    assert ScanTracker().update(0.0, unknown).id.tolist() == [7]


@pytest.mark.parametrize("what", ["another has none", "stated", "exact"])
def test_measured_velocities_are_as_wrong_as_they_are(what: str) -> None:
    """They are not exact because a name, or the velocity of another track, is missing; errors that are stated count."""
    rng, tracker, found = np.random.default_rng(0), ScanTracker(), []
    noise, names = (0.0 if what == "exact" else 0.4), [-1, 8] if what == "stated" else [7, 8]
    covariance = np.diag([0.05**2, 0.05**2, noise**2, noise**2])[None].repeat(2, axis=0) if what == "stated" else None
    for k in range(150):
        t, velocity = 0.1 * k, np.array([[0.5, 0.0], [0.0, 0.0]]) + rng.normal(0.0, noise, (2, 2))
        if what != "stated":
            velocity[1] = math.nan
        xy = np.array([[1.0 + 0.5 * t, 1.0], [8.0, 8.0]]) + rng.normal(0.0, noise / 8.0, (2, 2))
        tracks = tracker.update(t, Tracks(names, xy, velocity, [0.3, 0.3], covariance))
        found.append((*(tracks.velocity[0] - (0.5, 0.0)), *np.sqrt(np.diagonal(tracks.covariance[0]))))
    vx, vy, place, _, speed, _ = np.array(found[30:]).T
    error = math.hypot(vx.std(), vy.std()) / math.sqrt(2.0)
    if what == "exact":
        assert error < 1e-6 and speed.max() < 1e-6
    else:
        assert error < 0.2 and 0.5 < speed.mean() / error < 2.0 and 0.01 < place.mean() < 0.05


def test_nameless_tracks_are_told_apart_by_nearness() -> None:
    """Two crossing discs without names keep their own velocities; one that vanishes is forgotten after a second."""
    tracker, nan = ScanTracker(), np.full((2, 2), math.nan)
    for i in range(40):
        t = i * 0.1
        xy = np.array([[-2.0 + t, 0.0], [0.6, -2.0 + t]])
        tracks = tracker.update(t, Tracks(np.array([-1, -1]), xy[:: (-1) ** i].copy(), nan, np.full(2, 0.3)))
        assert len(tracks) == 2
    assert {tuple(v) for v in (np.round(tracks.velocity, 1) + 0.0).tolist()} == {(1.0, 0.0), (0.0, 1.0)}
    for t, left in ((4.5, 2), (6.0, 0)):
        assert len(tracker.update(t, Tracks.none())) == left


def test_a_false_alarm_is_returned_once():
    """Who was seen twice is remembered for a second; the policy decides about who was seen once, as it knows the map."""
    tracker, none = ScanTracker(), without_ids(np.empty((0, 2)), np.empty(0))
    one, two = np.array([[1.0, 1.0]]), np.array([[1.0, 1.0], [5.0, 5.0]])
    assert len(tracker.update(0.0, without_ids(one, np.full(1, 0.3)))) == 1
    assert len(tracker.update(0.1, without_ids(two, np.full(2, 0.3)))) == 2
    found = tracker.update(0.2, none)
    assert len(found) == 1 and found.xy[0] == pytest.approx((1.0, 1.0))
    assert len(tracker.update(1.2, none)) == 0


def test_of_more_discs_than_it_can_follow_it_follows_the_nearest() -> None:
    """Those around the robot, wherever they are listed."""
    xy = np.column_stack((np.arange(400.0), np.zeros(400)))
    for at in (0.0, 200.0, 399.0):
        found = ScanTracker().update(0.0, without_ids(xy, np.full(400, 0.3)), (at, 0.0))
        assert len(found) == 128 and np.abs(found.xy[:, 0] - at).max() <= 128.0


def test_numbers_that_are_missing_or_occur_twice_are_replaced() -> None:
    """Whoever has a number of his own keeps it, and the others get numbers that nobody has."""
    tracker, xy, velocity, radius = (
        ScanTracker(),
        np.array([[0.0, 0.0], [3.0, 0.0], [6.0, 0.0], [9.0, 0.0]]),
        np.zeros((4, 2)),
        np.ones(4),
    )
    first = tracker.update(0.0, Tracks(np.array([4, -1, 7, 7]), xy, velocity, radius)).id.tolist()
    assert first == [4, FIRST_ID, FIRST_ID + 1, FIRST_ID + 2]
    assert tracker.update(0.1, Tracks(np.array([-1, 4, -1, -1]), xy[[1, 0, 3, 2]], velocity, radius)).id.tolist() == first


def test_own_numbers_are_none_that_a_sensor_gives() -> None:
    """Somebody with the number 0 who comes after one without a number is not taken for the same one, who ran."""
    tracker, nan, radius = ScanTracker(), np.full((1, 2), math.nan), np.full(1, 0.3)
    for k in range(5):
        nameless = tracker.update(0.1 * k, Tracks([-1], [[1.0, 1.0]], nan, radius))
    both = tracker.update(0.5, Tracks([0], [[5.0, 5.0]], nan, radius))
    assert len(both) == 2 and set(both.id.tolist()) == {*nameless.id.tolist(), 0} and not both.velocity.any()


def test_a_part_of_a_rim_of_known_radius_tells_the_centre() -> None:
    """From an arc of 40 degrees on; a straight row of points, two points, and a rim elsewhere tell none."""
    rng = np.random.default_rng(9)
    for _ in range(cases(50, 1000)):
        radius, centre, first = rng.uniform(0.2, 0.6), rng.uniform(-5.0, 5.0, 2), rng.uniform(-math.pi, math.pi)
        angle = first + np.linspace(0.0, rng.uniform(0.7, 2.0), int(rng.integers(5, 20)))
        points = centre + radius * np.column_stack((np.cos(angle), np.sin(angle)))
        near = centre + rng.uniform(-0.35, 0.35, 2) * radius
        assert _of_radius(points, radius, near) == pytest.approx(centre, abs=1e-3)
        noisy = points + rng.normal(0.0, 0.002, points.shape)
        assert math.dist(_of_radius(noisy, radius, near), centre) < 0.05
        assert _of_radius(points[:2], radius, near) is None
        assert _of_radius(points, radius, centre + 3.0 * (centre - points.mean(axis=0)) / radius) is None
        row = near + np.outer(np.linspace(-1.0, 1.0, 9), (math.cos(first), math.sin(first))) + 1e-3
        assert _of_radius(row, radius, near) is None


def test_what_passes_behind_another_keeps_its_velocity() -> None:
    """Half hidden it looks like a smaller disc beside its centre, and joined to the other like a large one between the two.

    With 5 cm for the standard deviation of every place its velocity was wrong by up to 3.6 m/s.
    """
    grid, pose, still = Grid(np.zeros((80, 80), bool), 0.2, (-8.0, -8.0, 0.0)), (0.0, 0.0, 0.0), np.array([2.0, 0.0])
    for behind in (2.75, 3.0, 3.5):
        rng, tracker, worst = np.random.default_rng(3), ScanTracker(), [0.0, 0.0]
        for k in range(60):
            t = 0.1 * k
            moves = np.array([behind, -2.4 + 0.8 * t])
            ranges = measured(grid, np.array([still, moves]), np.array([0.3, 0.35]), pose, 360, 6.0)
            points, _ = read_points(scan_of(ranges + rng.normal(0.0, 0.01, 360)))
            places = discs(points, gap=0.3, largest=0.8)
            found = tracker.update(t, without_ids(places.xy, places.radius), (0.0, 0.0), places)
            for i, (place, velocity) in enumerate(((still, (0.0, 0.0)), (moves, (0.0, 0.8)))):
                away = np.hypot(*(found.xy - place).T)
                if k > 10 and away.min() < 0.5:
                    worst[i] = max(worst[i], math.dist(found.velocity[away.argmin()], velocity))
        assert max(worst) < 1.0, (behind, worst)


class Seeing:
    """A policy of antway.world that sees by a laser alone, and drives by a pilot in a frame that is turned and shifted."""

    def __init__(self, world: frames.Pose, **changes) -> None:
        self.world, self.pilot, self.tracker = (
            world,
            Pilot(Settings.of(defaults() | changes)),
            ScanTracker(),
        )
        self.drove: list[Decision] = []

    def reset(self, task, seed) -> None:
        self.grid = replace(task.grid, origin=frames.chain(self.world, task.grid.origin))
        self.pilot.receive_map(self.grid)
        self.pilot.go(Goal(frames.move_point(self.world, task.goal)))

    def act(self, o: Observation) -> Command:
        pose = frames.chain(self.world, (*o.xy, o.heading))
        truth = frames.move_tracks(self.world, o.tracks)
        points, _ = read_points(scan_of(measured(self.grid, truth.xy, truth.radius, pose, 240, 5.5)))
        seen = discs(Background(self.grid, 0.15).off(frames.move(pose, points), pose[:2]), gap=0.3, largest=0.8)
        self.pilot.scan = o.t, self.tracker.update(o.t, without_ids(seen.xy, seen.radius), pose[:2], seen)
        answer = self.pilot.receive_odometry(
            frames.Odometry(o.t, pose[:2], frames.turn(self.world[2], o.velocity), pose[2]), o.t
        )
        assert answer is not None, "one command each control period"
        announced = self.pilot.decision()
        if announced is not None:
            self.drove.append(announced)
        return Command(frames.turn(-self.world[2], answer.command.velocity))

    def explain(self) -> Decision:
        return Decision("follow", "as the pilot says")


def test_a_robot_that_sees_by_laser_alone_reaches_its_goal():
    """In scene paper, on a map that is turned, among obstacles seen by laser alone: no contact, and the goal is reached."""
    place = load_scenario(scene("paper"))
    for seed in range(costly(1, 40)):
        robot = Seeing((3.0, -2.0, 0.7), **{"task.obstacle_speed": 1.0})
        result = run(place, robot, seed=seed)
        check_episode(result)
        assert result.outcome.value == "reached", (seed, result.outcome, result.reason)
        assert any(one.action == "avoid" for one in robot.drove)
