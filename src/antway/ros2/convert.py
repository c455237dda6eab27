"""Converts ROS 2 messages to antway's types and back, without ROS: any object with the fields of a message will do.

Messages are made by `make("nav_msgs/msg/Path", header=..., poses=...)`, which rclpy, rosbags and `plain` implement. Cells of
maps are those of Nav2's map_server: row 0 has the lowest y, 0 is free, 100 blocked, -1 unknown.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadInput, BadMap, BadParameter, TooLarge
from antway.grid import Grid
from antway.kernels.base.geometry import wrap
from antway.kernels.robot.dynamics import drive
from antway.limits import MAX_ANGLE, MAX_PLACE, MAX_SPEED
from antway.maps.limits import DEFAULT
from antway.ros2.frames import Odometry, Pose, turn
from antway.world.policy import XY, Command, RobotSpec, Tracks
from antway.world.robots import towards

Make = Callable[..., Any]
# constants of visualization_msgs/msg/Marker: types, then actions
ARROW, CUBE, SPHERE, CYLINDER, LINE_STRIP, LINE_LIST, TEXT = 0, 1, 2, 3, 4, 5, 9
ADD, DELETE_ALL = 0, 3
OBSTACLE = (0.8, 0.3, 0.1)  # red, green, blue; colour of obstacles and of their predictions
_RAMP = 0.35  # rad; a robot on a ramp is tilted by no more than this
_TILT = 1e-3  # tolerance of a quaternion, which must be a unit rotation about z


def plain(_kind: str, **fields: Any) -> Any:
    """Make a message as a plain object with these fields."""
    return SimpleNamespace(**fields)


def seconds(stamp: Any) -> float:
    """Return a builtin_interfaces/msg/Time in s."""
    sec = checks.integer("stamp.sec", stamp.sec)
    return sec + checks.integer("stamp.nanosec", stamp.nanosec, low=0, high=999_999_999) * 1e-9


def stamp_message(t: float, make: Make = plain) -> Any:
    """Return `t` s, >= 0, as a builtin_interfaces/msg/Time, to the nearest ns."""
    total = round(checks.number("t", t, low=0.0, high=math.nextafter(2.0**31, 0.0), unit="s") * 1e9)
    return make("builtin_interfaces/msg/Time", sec=total // 10**9, nanosec=total % 10**9)


def header_message(t: float, frame: str, make: Make = plain) -> Any:
    """Return a std_msgs/msg/Header of time `t` s in `frame`."""
    return make("std_msgs/msg/Header", stamp=stamp_message(t, make), frame_id=frame)


def pose_message(x: float, y: float, yaw: float, make: Make = plain) -> Any:
    """Return a geometry_msgs/msg/Pose on the floor: m, m, rad."""
    turn = {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}
    return make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0),
        orientation=make("geometry_msgs/msg/Quaternion", **turn),
    )


def _is_unit(*parts: float) -> bool:
    """Tell whether these parts of a quaternion have the length 1, within `_TILT`."""
    return abs(math.hypot(*parts) - 1.0) <= _TILT


def read_pose(pose: Any, *, where: str = "pose") -> Pose:
    """Return (x, y, yaw) of a geometry_msgs/msg/Pose in m, m, rad; refuse a pose that is not finite or is tilted."""
    x, y = _xy(pose.position, where, most=math.inf, unit="")
    q = [checks.number(f"orientation.{n}", getattr(pose.orientation, n), where=where) for n in "xyzw"]
    if not (_is_unit(*q[2:]) and _is_unit(*q)):
        raise BadParameter("orientation", tuple(q), "a unit quaternion of a turn about z", where=where)
    return x, y, wrap(2.0 * math.atan2(q[2], q[3]))


def read_mount(pose: Any, *, where: str = "pose") -> tuple[Pose, bool]:
    """Return (x, y, yaw) of the pose of a frame that is level, or upside down with its y axis mirrored, and whether it is.

    Examples
    --------
    >>> over = plain("", position=plain("", x=0.2, y=0.0), orientation=plain("", x=0.0, y=1.0, z=0.0, w=0.0))
    >>> read_mount(over)  # turned by pi about y, its x axis points back
    ((0.2, 0.0, 3.141592653589793), True)
    """
    q = pose.orientation
    if not (_is_unit(q.x, q.y) and _is_unit(q.x, q.y, q.z, q.w)):
        return read_pose(pose, where=where), False
    level = plain("", x=0.0, y=0.0, z=q.y, w=q.x)  # a turn by pi about (x, y) mirrors y, then turns by twice their angle
    return read_pose(plain("", position=pose.position, orientation=level), where=where), True


def _xy(vector: Any, where: str, part: str = "position", most: float = MAX_PLACE, unit: str = "m") -> XY:
    """Return x and y of a vector, which errors call `part`, each within `most`."""
    x, y = (checks.number(f"{part}.{n}", getattr(vector, n), low=-most, high=most, unit=unit, where=where) for n in "xy")
    return x, y


def read_grid(message: Any, *, occupied: int = 100) -> Grid:
    """Return the map in a nav_msgs/msg/OccupancyGrid; cells of cost `occupied` or more, or -1 (unknown), are blocked.

    The message has the resolution in single precision, which is used as it is, as by readers of map_server.

    Raises
    ------
    BadMap
        For a length of data other than width times height, and costs other than -1 to 100.
    BadParameter
        For a resolution or origin out of range.
    TooLarge
        For more cells than a map may have.

    Examples
    --------
    >>> grid = Grid(np.array([[False, True]]), resolution=0.5)
    >>> read_grid(grid_message(grid)) == grid
    True
    """
    where, info = "OccupancyGrid", message.info
    cols, rows = (
        checks.integer(f"info.{n}", getattr(info, n), low=1, high=2**32 - 1, error=BadMap, where=where)
        for n in ("width", "height")
    )
    if rows * cols > DEFAULT.cells:
        raise TooLarge("info.width * info.height", rows * cols, f"at most {DEFAULT.cells} cells", where=where)
    if len(message.data) != rows * cols:
        raise BadMap("data.length", len(message.data), f"info.width * info.height, {rows * cols}", where=where)
    origin = read_pose(info.origin, where=f"{where}.info.origin")
    costs = np.asarray(message.data)
    if costs.dtype.kind not in "iu" or costs.ndim != 1:
        raise BadMap("data", costs.dtype.name, "integers", where=where)
    wrong = (costs < -1) | (costs > 100)
    if wrong.any():
        i = int(np.argmax(wrong))
        raise BadMap(f"data[{i}]", int(costs[i]), "-1 (unknown), or 0 (free) to 100 (blocked)", where=where)
    costs = costs.reshape(rows, cols)
    unknown = costs == -1
    try:
        return Grid((costs >= occupied) | unknown, info.resolution, origin, unknown if unknown.any() else None)
    except BadInput as wrong:
        raise wrong.at(where, f"info.{wrong.field}") from None


class MapReader:
    """Reads maps in `frame`, and updates of parts of the last one, as costmaps send them.

    Cells of cost `occupied` or more, or -1 (unknown), are blocked. What has the stamp 0 is not older than anything: older
    releases of Nav2 send updates of costmaps so.
    """

    def __init__(self, frame: str, occupied: int) -> None:
        self.frame, self.occupied = frame, occupied
        self.info: Any = None  # the meta data of the map in use
        self.early: Any = None  # an update that came before its map
        self.refused: Any = None  # a map that is older than the one in use; it is sent once only
        self.stamp = -math.inf  # s

    def time_went_back(self) -> Any:
        """Let a map or update follow that is older than the last one; return a map that was refused for that, or None."""
        self.stamp, refused, self.refused = -math.inf, self.refused, None
        return refused

    def _stamp(self, message: Any) -> float:
        """Return the stamp of a message in s, or that of the map in use if the message has none."""
        checks.choice("header.frame_id", message.header.frame_id, [self.frame])
        return seconds(message.header.stamp) or max(self.stamp, 0.0)

    def read(self, message: Any) -> Grid:
        """Return the map in a nav_msgs/msg/OccupancyGrid; raise `BadInput` if it is malformed or older than the one in use."""
        stamp = self._stamp(message)
        if stamp < self.stamp:
            self.refused = message
            raise BadMap("header.stamp", stamp, f"no older than that of the map in use, {self.stamp} s")
        grid = read_grid(message, occupied=self.occupied)
        self.stamp, self.info, early, self.early, self.refused = stamp, message.info, self.early, None, None
        self.costs = np.array(message.data, np.int8).reshape(grid.shape)
        try:
            return grid if early is None else self.update(early) or grid
        except BadInput:  # it was of another map
            return grid

    def update(self, message: Any) -> Grid | None:
        """Return the map with the cells of a map_msgs/msg/OccupancyGridUpdate; None without a map, or if that has them."""
        stamp = self._stamp(message)
        if self.info is None:
            self.early = message
            return None
        if stamp < self.stamp:
            return None
        (rows, cols), where = self.costs.shape, "OccupancyGridUpdate"
        x = checks.integer("x", message.x, low=0, high=cols - 1, where=where)
        y = checks.integer("y", message.y, low=0, high=rows - 1, where=where)
        width = checks.integer("width", message.width, low=0, high=cols - x, where=where)
        height = checks.integer("height", message.height, low=0, high=rows - y, where=where)
        if len(message.data) != width * height:
            raise BadMap("data.length", len(message.data), f"width * height, {width * height}", where=where)
        window, part = np.s_[y : y + height, x : x + width], np.asarray(message.data).reshape(height, width)
        if np.array_equal(self.costs[window], part):
            return None
        costs = self.costs.astype(np.result_type(self.costs, part))  # so that `read_grid` sees what the update says
        costs[window] = part
        grid = read_grid(plain("", info=self.info, data=costs.ravel()), occupied=self.occupied)
        self.stamp, self.costs = stamp, costs.astype(np.int8)
        return grid


def costs_message(
    costs: NDArray[np.int8], resolution: float, origin: Pose, make: Make = plain, *, t: float = 0.0, frame: str = "map"
) -> Any:
    """Return costs, int8[H, W] from -1 to 100, as a nav_msgs/msg/OccupancyGrid."""
    info = make(
        "nav_msgs/msg/MapMetaData",
        map_load_time=stamp_message(t, make),
        resolution=float(np.float32(resolution)),
        width=costs.shape[1],
        height=costs.shape[0],
        origin=pose_message(*origin, make),
    )
    return make(
        "nav_msgs/msg/OccupancyGrid", header=header_message(t, frame, make), info=info, data=costs.astype(np.int8).ravel()
    )


def grid_message(grid: Grid, make: Make = plain, *, t: float = 0.0) -> Any:
    """Return `grid` as a nav_msgs/msg/OccupancyGrid: 0 free, 100 blocked, -1 blocked because unknown."""
    costs = np.where(grid.blocked, 100, 0).astype(np.int8)
    if grid.unknown is not None:
        costs[grid.unknown] = -1
    return costs_message(costs, grid.resolution, grid.origin, make, t=t)


def path_message(xy: ArrayLike, make: Make = plain, *, t: float = 0.0, frame: str = "map") -> Any:
    """Return vertices, float[N, 2] in m, as a nav_msgs/msg/Path; each pose points to the next one."""
    points = np.asarray(xy, dtype=np.float64).reshape(-1, 2)
    yaw = np.arctan2(*np.diff(points, axis=0).T[::-1])
    yaw = np.append(yaw, yaw[-1:] if len(yaw) else [0.0] * len(points))
    header = header_message(t, frame, make)
    poses = [
        make("geometry_msgs/msg/PoseStamped", header=header, pose=pose_message(x, y, turn, make))
        for (x, y), turn in zip(points.tolist(), yaw.tolist())
    ]
    return make("nav_msgs/msg/Path", header=header, poses=poses)


def read_path(message: Any) -> NDArray[np.float64]:
    """Return the vertices of a nav_msgs/msg/Path, float64[N, 2] in m.

    A `BadParameter` names a pose that is not finite, is tilted, or is beyond limits (docs/limits.md).
    """
    places, turns = ([getattr(one.pose, part) for one in message.poses] for part in ("position", "orientation"))
    xy = np.array([(p.x, p.y) for p in places], np.float64).reshape(-1, 2)
    q = np.array([(q.x, q.y, q.z, q.w) for q in turns], np.float64).reshape(-1, 4)
    norms = np.column_stack((np.hypot(q[:, 2], q[:, 3]), np.hypot.reduce(q, axis=1)))
    sound = (abs(xy) <= MAX_PLACE).all(axis=1) & (abs(norms - 1.0) <= _TILT).all(axis=1)
    for i in np.flatnonzero(~sound).tolist():  # these say what is wrong
        where = f"Path.poses[{i}]"
        _xy(places[i], where)
        read_pose(message.poses[i].pose, where=where)
    return xy


def twist_message(command: Command, velocity: XY, heading: float, robot: RobotSpec, make: Make = plain) -> Any:
    """Return `command`, in the map's frame, as a geometry_msgs/msg/Twist in the robot's.

    A holonomic robot gets the velocity turned by -heading. Wheels get the twist of the command, or the twist that turns them
    towards its velocity (`antway.world.robots.towards`); with the dynamics "steps", the forward speed and turn rate by which
    `antway.world` would follow the command in a control period.
    """
    if robot.wheels and not robot.stepwise:
        (forward, rate), left = command.twist or towards(command.velocity, heading, robot), 0.0
    elif robot.drive == "differential":
        wx, wy, turned = drive(*velocity, heading, *command.velocity, robot.limits, robot.dt)
        forward, left, rate = wx * math.cos(turned) + wy * math.sin(turned), 0.0, wrap(turned - heading) / robot.dt
    else:
        (forward, left), rate = turn(-heading, command.velocity), 0.0
    return make(
        "geometry_msgs/msg/Twist",
        linear=make("geometry_msgs/msg/Vector3", x=forward, y=left, z=0.0),
        angular=make("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=rate),
    )


def read_twist(message: Any, heading: float) -> Command:
    """Return the velocity of a geometry_msgs/msg/Twist, given in the frame of a robot with that heading, as a command."""
    return Command(turn(heading, _xy(message.linear, "Twist", "linear", MAX_SPEED, "m/s")))


def read_odometry(message: Any) -> Odometry:
    """Return what a nav_msgs/msg/Odometry says, in its frame; the message has the velocity in the robot's.

    The robot may be on a ramp, tilted by up to 0.35 rad; its heading is then that of its x axis seen from above.
    """
    pose, where = message.pose.pose, "Odometry.pose"
    (x, y), q = _xy(pose.position, where), pose.orientation
    if _is_unit(q.x, q.y, q.z, q.w):
        tilt = 2.0 * math.acos(min(math.hypot(q.z, q.w), 1.0))
        checks.number("tilt", tilt, high=_RAMP, unit="rad", where=where)
        heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y**2 + q.z**2))
    else:
        _, _, heading = read_pose(pose, where=where)  # which says what is wrong
    t = checks.number("header.stamp", seconds(message.header.stamp), low=0.0, unit="s", where="Odometry")
    twist = message.twist.twist
    velocity, rate = read_twist(twist, heading).velocity, twist.angular.z
    rate = checks.number("angular.z", rate, low=-MAX_ANGLE, high=MAX_ANGLE, unit="rad/s", where="Odometry.twist")
    return Odometry(t, (x, y), velocity, heading, rate)


def read_poses(message: Any, radius: float) -> tuple[float, Tracks]:
    """Return (t in s, tracks) of a geometry_msgs/msg/PoseArray: discs of `radius` m without names, velocities and yaws."""
    places = [_xy(pose.position, f"PoseArray.poses[{i}]") for i, pose in enumerate(message.poses)]
    n = len(places)
    xy = np.array(places, np.float64).reshape(n, 2)
    return seconds(message.header.stamp), Tracks(np.full(n, -1, np.int64), xy, np.full((n, 2), math.nan), np.full(n, radius))


def read_markers(message: Any) -> tuple[float, Tracks]:
    """Return (t in s, tracks) of a visualization_msgs/msg/MarkerArray.

    Each added sphere or cylinder is a disc whose diameter is the larger of scale.x and scale.y, named by its id; a cube is the
    disc around it. Discs of several namespaces that have the same id have no name, nor have those with ids below 0. An added
    arrow with the id of a disc from points[0] to points[1] is its velocity (m in 1 s): that of its namespace, or one whose
    namespace has no such disc. Without an arrow the velocity is unknown. Lines, texts, other arrows and other actions are
    ignored. The time is the oldest stamp of a disc, until which discs with newer stamps are moved back by their velocities, or,
    in a scene without discs, the latest stamp, so that even an empty scene needs a marker: delete-all.

    Raises
    ------
    BadParameter
        If there is no marker, two discs of a namespace have the same id, an arrow may be of two discs, numbers are out of
        range, or a marker is of another type, such as a mesh or a list of spheres.
    """
    if len(message.markers) == 0:
        raise BadParameter("MarkerArray.markers", [], "at least a delete-all marker, which carries the time")
    discs: dict[tuple[str, int], tuple[float, float, float]] = {}
    arrows: dict[tuple[str, int], XY] = {}
    stamps = list[float]()  # s; of discs
    for i, marker in enumerate(message.markers):
        where = f"MarkerArray.markers[{i}]"
        if marker.action != ADD:
            continue
        name = marker.ns, checks.integer("id", marker.id, where=where)
        if marker.type in (CUBE, SPHERE, CYLINDER):
            if name in discs:
                raise BadParameter("id", marker.id, "the id of only one disc of its namespace", where=where)
            wide = [checks.number(f"scale.{n}", getattr(marker.scale, n), low=0.0, high=MAX_PLACE, where=where) for n in "xy"]
            x, y = _xy(marker.pose.position, where)
            stamps.append(seconds(marker.header.stamp))
            diameter = math.hypot(*wide) if marker.type == CUBE else max(wide)
            discs[name] = (x, y, checks.number("scale", diameter, low=0.0, open_low=True, unit="m", where=where) / 2)
        elif marker.type == ARROW and len(marker.points) == 2:
            (x0, y0), (x1, y1) = (_xy(end, where, "points", math.inf, "") for end in marker.points)
            q = marker.pose.orientation  # points are in the frame of the marker's pose; many leave all of it 0
            vx, vy = turn(2.0 * math.atan2(q.z, q.w), (x1 - x0, y1 - y0))
            checks.number("points", math.hypot(vx, vy), high=MAX_SPEED, unit="m apart, which says m/s", where=where)
            arrows[name] = (vx, vy)
        elif marker.type not in (ARROW, LINE_STRIP, LINE_LIST, TEXT):
            raise BadParameter("type", marker.type, "a sphere, cylinder or cube, or an arrow, line or text", where=where)
    rows, ids = np.array(list(discs.values()), np.float64).reshape(-1, 3), [number for _, number in discs]
    others = {number: arrow for (space, number), arrow in arrows.items() if (space, number) not in discs}
    for number, discs_with_it in Counter(ids).items():
        if discs_with_it > 1 and number in others:
            raise BadParameter("id", number, "an arrow in the namespace of its disc", where="MarkerArray.markers")
    arrow = [arrows.get(name, others.get(name[1], (math.nan, math.nan))) for name in discs]
    velocity = np.array(arrow, np.float64).reshape(-1, 2)
    t = min(stamps) if stamps else max(seconds(marker.header.stamp) for marker in message.markers)
    xy = rows[:, :2] - (np.array(stamps) - t)[:, None] * np.nan_to_num(velocity)
    return t, Tracks(np.maximum(np.array(ids, np.int64), -1), xy, velocity, rows[:, 2].copy()).distinct()


def placed_headers(message: Any) -> list[Any]:
    """Return the headers of the discs and arrows that a visualization_msgs/msg/MarkerArray adds: nothing else of it is used."""
    used = (ARROW, CUBE, SPHERE, CYLINDER)
    added = [one for one in getattr(message, "markers", []) if getattr(one, "action", ADD) == ADD]
    return [marker.header for marker in added if getattr(marker, "type", ARROW) in used]


def marker_message(
    name: int,
    kind: int,
    header: Any,
    make: Make,
    *,
    space: str,
    action: int = ADD,
    xy: XY = (0.0, 0.0),
    z: float = 0.0,
    size: tuple[float, float, float] = (0.0, 0.0, 0.0),
    colour: tuple[float, float, float] = (0.0, 0.0, 0.0),
    alpha: float = 1.0,
    points: Sequence[Sequence[float]] = (),
    text: str = "",
) -> Any:
    """Return a visualization_msgs/msg/Marker of type `kind` with the id `name` in the namespace `space`."""
    r, g, b = colour
    pose = pose_message(*xy, 0.0, make)
    pose.position.z = z
    return make(
        "visualization_msgs/msg/Marker",
        header=header,
        ns=space,
        id=name,
        type=kind,
        action=action,
        pose=pose,
        scale=make("geometry_msgs/msg/Vector3", **dict(zip("xyz", size))),
        color=make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=alpha),
        points=[make("geometry_msgs/msg/Point", x=float(x), y=float(y), z=0.0) for x, y in points],
        text=text,
    )


def markers_message(tracks: Tracks, t: float, make: Make = plain) -> Any:
    """Return `tracks` as a visualization_msgs/msg/MarkerArray for `read_markers`, which RViz can show, too."""
    header = header_message(t, "map", make)

    def marker(name: int, kind: int, space: str, **about: Any) -> Any:
        return marker_message(name, kind, header, make, space=space, colour=OBSTACLE, alpha=0.8, **about)

    markers = [marker(0, ARROW, "obstacles", action=DELETE_ALL)]
    rows = zip(tracks.id.tolist(), tracks.xy.tolist(), tracks.velocity.tolist(), tracks.radius.tolist())
    for name, (x, y), (vx, vy), radius in rows:
        markers.append(marker(name, CYLINDER, "obstacles", xy=(x, y), size=(2 * radius, 2 * radius, 1.0)))
        if not math.isnan(vx):
            ends = [(x, y), (x + vx, y + vy)]
            markers.append(marker(name, ARROW, "velocities", size=(0.05, 0.1, 0.1), points=ends))
    return make("visualization_msgs/msg/MarkerArray", markers=markers)
