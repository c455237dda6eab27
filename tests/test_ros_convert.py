"""Messages of ROS: read back as they were written, and refused by name where they are malformed."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest

from antway import Grid, RobotSpec, load_map, save_map, solve
from antway.errors import BadInput, BadMap, BadParameter, TooLarge
from antway.maps.ros import load_costs
from antway.planning import Problem
from antway.ros2 import convert
from antway.world.policy import Command, Tracks
from common import cases, free_cells, random_grid


def grids(count: int):
    rng = np.random.default_rng(8)
    for _ in range(count):
        grid = random_grid(rng, high=30)
        unknown = grid.blocked & (rng.random(grid.shape) < 0.3)
        size = float(np.float32(rng.uniform(0.01, 2.0)))
        yield rng, Grid(grid.blocked, size, (*rng.uniform(-50, 50, 2), 0.0), unknown if unknown.any() else None)


def test_maps_come_back_as_they_were():
    """A grid written as an OccupancyGrid and read back is equal, bit for bit."""
    for _, grid in grids(cases(200, 20_000)):
        assert convert.read_grid(convert.grid_message(grid)) == grid


def test_costs_are_those_of_map_server(tmp_path):
    """An OccupancyGrid of the costs that map_server reads of a file makes the grid that `load_map` makes of it."""
    for i, (_, grid) in enumerate(grids(cases(20, 500))):
        file = tmp_path / f"{i}.yaml"
        save_map(grid, file)
        costs = load_costs(file)
        assert (convert.grid_message(grid).data == costs.ravel()).all()
        assert convert.read_grid(convert.costs_message(costs, grid.resolution, grid.origin)) == load_map(file)


@pytest.mark.parametrize("yaw", [0.0, 0.3, -0.3, math.pi / 2, 3.0, -3.1])
def test_yaw_survives_the_quaternion(yaw):
    """The origin's yaw comes back to rounding, and every cell centre with it."""
    grid = Grid(np.zeros((5, 7), bool), 0.25, (1.0, -2.0, yaw))
    back = convert.read_grid(convert.grid_message(grid))
    assert math.isclose(back.origin[2], yaw, rel_tol=1e-15, abs_tol=1e-15)
    cells = free_cells(grid)
    np.testing.assert_allclose(back.to_xy(cells), grid.to_xy(cells), rtol=0, atol=1e-14)


@pytest.mark.parametrize("q", [(1.0, 0.0, 0.0, 1.0), (0.0, 0.05, 1.0, 0.0), (0.0, 1.0, 0.8, 0.0), (1.0, 0.0, math.nan, 0.0)])
def test_a_pose_is_level_only_with_a_quaternion_of_length_1(q) -> None:
    """All four parts count: of (1, 0, 0, 1) the last two alone have the length 1, and the tilt is 90 degrees."""
    pose, zero = convert.pose_message(1.0, 2.0, 0.0), convert.plain("", x=0.0, y=0.0, z=0.0)
    pose.orientation = convert.plain("", **dict(zip("xyzw", q)))
    odometry = convert.plain(
        "",
        header=convert.header_message(1.0, "odom"),
        pose=convert.plain("", pose=pose),
        twist=convert.plain("", twist=convert.plain("", linear=zero, angular=zero)),
    )
    path = convert.path_message([(0.0, 0.0), (1.0, 2.0)])
    path.poses[1].pose = pose
    for read, message in (
        (convert.read_pose, pose),
        (convert.read_mount, pose),
        (convert.read_odometry, odometry),
        (convert.read_path, path),
    ):
        with pytest.raises(BadParameter, match="orientation"):
            read(message)


def spoil(message, rng):
    """Spoil one part of an OccupancyGrid; the error it must raise."""
    info, data = message.info, message.data
    case = rng.integers(12)
    if case == 0:
        message.data = data[:-1]
    elif case == 1:
        message.data = np.append(data, 0)
    elif case == 2:
        info.width, info.height = 2**16, 2**16
        return TooLarge
    elif case == 3:
        info.width = int(rng.choice([0, -1, 2**32]))
    elif case == 4:
        info.height = 2**31
        return TooLarge
    elif case == 5:
        message.data = data.astype(np.int16)
        message.data[rng.integers(len(data))] = rng.choice([-2, -128, 101, 127, 255])
    elif case == 6:
        info.resolution = float(rng.choice([0.0, -0.05, math.nan, math.inf]))
    elif case == 7:
        setattr(info.origin.position, rng.choice(["x", "y"]), float(rng.choice([math.nan, math.inf])))
    elif case == 8:
        setattr(info.origin.orientation, rng.choice(["x", "y", "z", "w"]), math.nan)
    elif case == 9:
        info.origin.orientation.z = info.origin.orientation.w = 0.0
    elif case == 10:
        message.data = data.astype(np.float64)
    else:
        info.width = rng.choice([1.5, "3", None])
    return BadParameter if 6 <= case <= 9 else BadMap


def test_malformed_maps_are_refused_by_name():
    """Spoilt lengths, sizes, costs, origins and resolutions each raise a `BadInput` that names the field; nothing else."""
    for rng, grid in grids(cases(300, 100_000)):
        message = convert.grid_message(grid)
        expected = spoil(message, rng)
        with pytest.raises(expected) as caught:
            convert.read_grid(message)
        assert "OccupancyGrid" in str(caught.value)


def test_plans_come_back_as_they_were():
    """A plan written as a Path and read back has the same vertices; an empty Path stays empty; NaN is refused."""
    for rng, grid in grids(cases(100, 5_000)):
        free = free_cells(grid)
        if len(free) == 0:
            continue
        start, goal = (tuple(map(int, free[i])) for i in rng.integers(len(free), size=2))
        plan = solve(Problem(grid, start, goal))
        message = convert.path_message(plan.xy(grid))
        assert (convert.read_path(message) == plan.xy(grid)).all()
        yaws = [convert.read_pose(one.pose)[2] for one in message.poses]
        assert yaws[-1:] == (yaws[-2:-1] or [0.0] * len(yaws))
    assert convert.read_pose(convert.path_message([(1.0, 2.0)]).poses[0].pose) == (1.0, 2.0, 0.0)
    with pytest.raises(BadInput, match=r"poses\[0\].*position.x = nan"):
        convert.read_path(convert.path_message([(math.nan, 0.5)]))


def test_commands_come_back_as_they_were():
    """A holonomic command turned into the robot's frame and back is the same velocity; a differential one keeps the limits."""
    rng = np.random.default_rng(3)
    disc, cart = RobotSpec(), RobotSpec(drive="differential", a_max=0.8, turn_rate=1.0, dynamics="steps")
    wheels = convert.twist_message(Command(twist=(0.4, -0.7)), (0.0, 0.0), 1.0, RobotSpec(drive="differential"))
    assert (wheels.linear.x, wheels.linear.y, wheels.angular.z) == (0.4, 0.0, -0.7)
    for _ in range(cases(200, 5_000)):
        velocity, heading = rng.uniform(-1, 1, 2), rng.uniform(-math.pi, math.pi)
        twist = convert.twist_message(Command(tuple(velocity)), (0.0, 0.0), heading, disc)
        np.testing.assert_allclose(convert.read_twist(twist, heading).velocity, velocity, rtol=0, atol=1e-15)
        twist = convert.twist_message(Command(tuple(velocity)), (0.0, 0.0), heading, cart)
        assert twist.linear.y == 0.0 and 0.0 <= twist.linear.x <= 0.08 + 1e-12 and abs(twist.angular.z) <= 1.0 + 1e-12
        back = (-0.5 * math.cos(heading), -0.5 * math.sin(heading))
        assert convert.twist_message(Command(tuple(velocity)), back, heading, cart).linear.x == pytest.approx(-0.42)


def test_tracks_come_back_as_they_were():
    """Tracks written as markers read back the same, with unknown velocities unknown and the stamp to the nanosecond."""
    rng = np.random.default_rng(4)
    for n in range(cases(30, 300)):
        velocity = rng.uniform(-1, 1, (n, 2))
        velocity[rng.random(n) < 0.3] = math.nan
        tracks = Tracks(rng.permutation(n).astype(np.int64), rng.uniform(-9, 9, (n, 2)), velocity, rng.uniform(0.1, 1, n))
        t, back = convert.read_markers(convert.markers_message(tracks, 12.25 + n))
        assert t == 12.25 + n and (back.id == tracks.id).all()
        np.testing.assert_array_equal(back.xy, tracks.xy)
        np.testing.assert_array_equal(back.radius, tracks.radius)
        np.testing.assert_allclose(back.velocity, tracks.velocity, rtol=0, atol=1e-14)


def test_the_time_of_a_scene_is_that_of_its_oldest_disc() -> None:
    """Detections that are sent again and again under a new delete-all grow old; without discs delete-all tells the time."""
    tracks = Tracks(np.arange(2), np.array([[1.0, 2.0], [3.0, 4.0]]), np.full((2, 2), math.nan), np.full(2, 0.3))
    message = convert.markers_message(tracks, 20.0)
    message.markers[1].header = convert.header_message(10.0, "map")
    assert convert.read_markers(message)[0] == 10.0
    assert convert.read_markers(convert.markers_message(Tracks.none(), 20.0))[0] == 20.0


def test_discs_with_newer_stamps_are_moved_back_to_the_time_of_the_scene() -> None:
    """Who was at x = 3 m at 10.5 s, with 2 m/s, was at 2 m at 10 s; with an unknown velocity he stays."""
    velocity = np.array([[0.0, 0.0], [2.0, -1.0], [math.nan, math.nan]])
    tracks = Tracks(np.arange(3), np.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]), velocity, np.full(3, 0.3))
    message = convert.markers_message(tracks, 10.5)
    message.markers[1].header = convert.header_message(10.0, "map")
    t, found = convert.read_markers(message)
    assert t == 10.0 and found.xy.tolist() == [[1.0, 2.0], [2.0, 4.5], [5.0, 6.0]]


def test_the_points_of_an_arrow_are_in_the_frame_of_its_pose() -> None:
    """An arrow along x whose pose is turned by a right angle is a velocity along y, as RViz shows it; 0 0 0 0 is no turn."""
    for yaw, expected in ((0.0, (0.5, 0.0)), (math.pi / 2, (0.0, 0.5)), (-math.pi / 2, (0.0, -0.5)), (None, (0.5, 0.0))):
        tracks = Tracks(np.array([3]), np.array([[1.0, 2.0]]), np.array([[0.5, 0.0]]), np.array([0.3]))
        message = convert.markers_message(tracks, 1.0)
        q = convert.plain("", x=0.0, y=0.0, z=0.0, w=0.0)
        message.markers[-1].pose.orientation = q if yaw is None else convert.pose_message(4.0, 5.0, yaw).orientation
        assert convert.read_markers(message)[1].velocity[0] == pytest.approx(expected)


def test_only_what_is_used_of_markers_has_a_place() -> None:
    """A text in the robot's frame is ignored, as texts are; it used to make the robot stand."""
    tracks = Tracks(np.array([3]), np.array([[1.0, 2.0]]), np.array([[0.5, 0.0]]), np.array([0.3]))
    message = convert.markers_message(tracks, 1.0)
    for kind in (convert.TEXT, convert.LINE_STRIP, convert.LINE_LIST):
        header = convert.header_message(1.0, "base_link")
        message.markers.append(convert.marker_message(7, kind, header, convert.plain, space="words", text="a person"))
    assert {header.frame_id for header in convert.placed_headers(message)} == {"map"}
    assert len(convert.read_markers(message)[1]) == 1


def test_places_and_times_beyond_limits_are_refused() -> None:
    """A path to 1e300 m, and odometry of a time before 1970, of which no picture can be sent."""
    with pytest.raises(BadParameter, match=r"Path.poses\[1\]: position.x"):
        convert.read_path(convert.path_message([(0.0, 0.5), (1e300, 0.5)]))
    zero = convert.plain("", linear=convert.plain("", x=0.0, y=0.0), angular=convert.plain("", z=0.0))
    header = convert.plain("", stamp=convert.plain("", sec=-5, nanosec=0), frame_id="map")
    pose, twist = convert.plain("", pose=convert.pose_message(1.0, 2.0, 0.0)), convert.plain("", twist=zero)
    with pytest.raises(BadParameter, match=r"Odometry: header.stamp = -5"):
        convert.read_odometry(convert.plain("", header=header, pose=pose, twist=twist))


def test_a_tilt_is_told_by_its_angle() -> None:
    """The quaternion of a robot that lies on its side is sound: what is wrong is the tilt."""
    zero = convert.plain("", linear=convert.plain("", x=0.0, y=0.0), angular=convert.plain("", z=0.0))
    pose = convert.pose_message(1.0, 2.0, 0.0)
    pose.orientation = convert.plain("", x=math.sin(0.25), y=0.0, z=0.0, w=math.cos(0.25))
    pose, twist = convert.plain("", pose=pose), convert.plain("", twist=zero)
    with pytest.raises(BadParameter, match=r"tilt = 0\.5: must be .* <= 0\.35 \(rad\)"):
        convert.read_odometry(convert.plain("", header=convert.header_message(1.0, "map"), pose=pose, twist=twist))


def test_the_last_second_of_stamps_is_one() -> None:
    """A stamp of any time that a message can hold can be answered."""
    last = convert.plain("", sec=2**31 - 1, nanosec=850_000_000)
    assert convert.stamp_message(convert.seconds(last)).sec == 2**31 - 1


def test_malformed_tracks_are_refused_by_name():
    """No markers, one id twice, places that are not finite and stamps out of range are refused."""
    tracks = Tracks(np.array([3]), np.array([[1.0, 2.0]]), np.array([[0.5, 0.0]]), np.array([0.3]))
    message = convert.markers_message(tracks, 1.0)
    message.markers.append(message.markers[1])
    with pytest.raises(BadParameter, match=r"markers\[3\]: id = 3"):
        convert.read_markers(message)
    message.markers[:] = []
    with pytest.raises(BadParameter, match="delete-all"):
        convert.read_markers(message)
    message = convert.markers_message(tracks, 1.0)
    message.markers[1].pose.position.y = math.inf
    with pytest.raises(BadParameter, match=r"position.y = inf"):
        convert.read_markers(message)
    message = convert.markers_message(tracks, 1.0)
    message.markers[0].header.stamp.nanosec = 10**9
    with pytest.raises(BadParameter, match="nanosec"):
        convert.read_markers(message)
    poses = convert.plain("", header=convert.header_message(2.5, "map"), poses=[convert.pose_message(1.0, 2.0, 0.1)])
    poses.poses[0].orientation = convert.plain("", x=0.0, y=0.0, z=0.0, w=0.0)  # as detectors leave it: a disc has no yaw
    t, nameless = convert.read_poses(poses, 0.4)
    assert t == 2.5 and nameless.id.tolist() == [-1] and np.isnan(nameless.velocity).all() and nameless.radius.tolist() == [0.4]


def marker(kind: int, name: int = 1, wide: tuple[float, float] = (0.6, 0.8)) -> object:
    """A marker at (2, 3) in a message that says 1 s."""
    return convert.marker_message(
        name, kind, convert.header_message(1.0, "map"), convert.plain, space="", xy=(2.0, 3.0), size=(*wide, 1.0)
    )


def test_discs_of_several_namespaces_may_have_the_same_id() -> None:
    """Cars and people, each numbered from 0: they have no name. A velocity that may be of two discs is refused."""
    header, message = convert.header_message(1.0, "map"), convert.plain("", markers=[])

    def add(kind: int, space: str, name: int, x: float) -> None:
        ends = [(x, 0.0), (x + 0.1 * x, 0.0)] if kind == convert.ARROW else []
        about = {"points": ends} if ends else {"xy": (x, 0.0)}
        message.markers.append(convert.marker_message(name, kind, header, convert.plain, space=space, size=(0.6,) * 3, **about))

    for space, x in (("cars", 1.0), ("people", 2.0)):
        add(convert.CYLINDER, space, 0, x)
        add(convert.ARROW, space, 0, x)
    add(convert.CYLINDER, "people", 1, 3.0)
    add(convert.ARROW, "velocities", 1, 3.0)
    _, tracks = convert.read_markers(message)
    assert tracks.id.tolist() == [-1, -1, 1] and tracks.xy[:, 0].tolist() == [1.0, 2.0, 3.0]
    np.testing.assert_allclose(tracks.velocity[:, 0], [0.1, 0.2, 0.3])
    for name, x in ((-7, 4.0), (-8, 5.0)):  # ids are integers of 32 bits with a sign, such as parts of a hash
        add(convert.CYLINDER, "hashes", name, x)
        add(convert.ARROW, "hashes", name, x)
    _, tracks = convert.read_markers(message)
    assert tracks.id.tolist() == [-1, -1, 1, -1, -1]
    np.testing.assert_allclose(tracks.velocity[:, 0], 0.1 * tracks.xy[:, 0])
    add(convert.ARROW, "velocities", 0, 1.0)
    with pytest.raises(BadParameter, match=r"markers: id = 0: must be an arrow in the namespace of its disc"):
        convert.read_markers(message)


def test_solid_markers_are_obstacles_or_refused() -> None:
    """A cube is the disc around it. Meshes and lists of solids used to be left out, so that the robot drove into them."""
    for kind, radius in ((convert.SPHERE, 0.4), (convert.CYLINDER, 0.4), (convert.CUBE, 0.5)):
        _, tracks = convert.read_markers(convert.plain("", markers=[marker(kind)]))
        assert tracks.radius.tolist() == [pytest.approx(radius)] and tracks.xy.tolist() == [[2.0, 3.0]]
    for kind in (convert.ARROW, convert.LINE_STRIP, convert.LINE_LIST, convert.TEXT):
        assert len(convert.read_markers(convert.plain("", markers=[marker(kind)]))[1]) == 0
    for kind in (6, 7, 8, 10, 11, 12):
        with pytest.raises(BadParameter, match=r"markers\[0\]: type"):
            convert.read_markers(convert.plain("", markers=[marker(kind)]))


@pytest.mark.parametrize("yaw", [0.0, 1.2, -3.0])
def test_a_robot_on_a_ramp_has_the_heading_that_is_seen_from_above(yaw: float) -> None:
    """As an odometry with roll and pitch says it; one that is tilted by more, or no unit quaternion, is refused."""

    def turned(tilt: float, length: float = 1.0) -> object:
        (cp, sp), (cy, sy) = ((math.cos(0.5 * one), math.sin(0.5 * one)) for one in (tilt, yaw))
        x, y, z, w = (length * part for part in (-sy * sp, cy * sp, sy * cp, cy * cp))  # yaw, then pitch
        pose = convert.pose_message(1.0, 2.0, 0.0)
        pose.orientation = convert.plain("", x=x, y=y, z=z, w=w)
        zero = convert.plain("", x=0.5, y=0.0, z=0.1)
        return convert.plain(
            "",
            header=convert.header_message(1.0, "odom"),
            pose=convert.plain("", pose=pose),
            twist=convert.plain("", twist=convert.plain("", linear=zero, angular=zero)),
        )

    for tilt in (0.0, 0.15, -0.3):
        found = convert.read_odometry(turned(tilt))
        assert found.heading == pytest.approx(yaw, abs=1e-9) and math.hypot(*found.velocity) == pytest.approx(0.5)
    for wrong in (turned(0.5), turned(0.0, 0.99), turned(0.1, 0.99), turned(0.1, 0.9), turned(0.1, 1.1), turned(math.nan)):
        with pytest.raises(BadParameter, match=r"orientation|tilt = 0\.5"):
            convert.read_odometry(wrong)


@pytest.mark.parametrize("cost", [255, 256, -129, 0.5])
def test_an_update_with_costs_that_are_none_is_refused(cost: float) -> None:
    """Numbers beyond 8 bits were wrapped: 255 was unknown, and 256 free."""
    reader, grid = convert.MapReader("map", 100), Grid(np.ones((2, 3), bool))
    reader.read(convert.grid_message(grid))
    header = convert.header_message(1.0, "map")
    change = convert.plain("", header=header, x=1, y=0, width=1, height=2, data=[100, cost])
    with pytest.raises(BadMap, match="data"):
        reader.update(change)
    change.data = [0, -1]
    assert reader.update(change).blocked.tolist() == [[True, False, True], [True, True, True]]


def test_an_update_changes_its_window_or_is_refused_where_that_is_not_on_the_map() -> None:
    """Every window of a small map and beyond it, by its corner and size."""
    rng, header, (rows, cols) = np.random.default_rng(8), convert.header_message(1.0, "map"), (3, 4)
    for x, y, width, height in product(range(-1, cols + 1), range(-1, rows + 1), range(cols + 2), range(rows + 2)):
        reader, costs = convert.MapReader("map", 50), rng.integers(-1, 101, (rows, cols)).astype(np.int8)
        reader.read(convert.costs_message(costs, 0.5, (1.0, 2.0, 0.3)))
        part = rng.integers(-1, 101, (height, width)).astype(np.int8)
        change = convert.plain("", header=header, x=x, y=y, width=width, height=height, data=part.ravel())
        if not (0 <= x < cols and 0 <= y < rows and x + width <= cols and y + height <= rows):
            with pytest.raises(BadParameter, match="OccupancyGridUpdate"):
                reader.update(change)
            continue
        found, before = reader.update(change), costs.copy()
        for i, j in np.ndindex(height, width):
            costs[y + i, x + j] = part[i, j]
        if (costs == before).all():
            assert found is None
        else:
            assert found == convert.read_grid(convert.costs_message(costs, 0.5, (1.0, 2.0, 0.3)), occupied=50)


def test_a_map_or_an_update_without_a_stamp_is_not_older() -> None:
    """Older releases of Nav2 send updates of costmaps with the stamp 0, which were ignored; what is older still is."""
    reader = convert.MapReader("map", 100)

    def update(t: float, cost: int) -> Grid | None:
        header = convert.header_message(t, "map")
        return reader.update(convert.plain("", header=header, x=1, y=0, width=1, height=1, data=[cost]))

    reader.read(convert.grid_message(Grid(np.zeros((2, 3), bool)), t=50.0))
    assert update(0.0, 100).blocked.tolist() == [[False, True, False], [False] * 3]
    assert update(49.0, 0) is None and reader.costs[0, 1] == 100
    assert reader.read(convert.grid_message(Grid(np.ones((2, 3), bool)))).blocked.all()
    assert update(49.0, 0) is None and not update(50.0, 0).blocked[0, 1]


def test_a_map_that_was_refused_as_older_counts_once_time_went_back() -> None:
    """A simulation that begins anew sends its map once, often before its clock is seen to go back."""
    reader = convert.MapReader("map", 100)
    old, new = (convert.grid_message(Grid(np.full((2, 3), blocked), 0.5), t=t) for blocked, t in ((False, 50.0), (True, 1.0)))
    reader.read(old)
    with pytest.raises(BadMap, match="no older"):
        reader.read(new)
    assert reader.time_went_back() is new and reader.read(new).blocked.all()
    assert reader.time_went_back() is None
