"""Bags of ROS 2 (rosbag2, sqlite3 or mcap), by the library rosbags: writes traces, reads maps and tracks."""

from __future__ import annotations

import math
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator
from os.path import isdir, isfile
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Nodetype, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from antway import checks
from antway.errors import BadInput, BadMap, BadParameter, BadScenario, TooLarge
from antway.grid import Grid
from antway.reading import check_yaml, limit_process, read_bytes
from antway.ros2 import convert
from antway.world.policy import Command, RobotSpec, Tracks
from antway.world.trace import Trace
from antway.writing import writing

MAX_BYTES = 2**30  # limit of a bag, of the memory for reading it, and of a file unpacked from it
MAX_METADATA = 2**20  # limit of bytes of metadata.yaml
_YAML = {"events": 50_000, "depth": 16, "aliases": 8}  # limits of the metadata
MAX_MESSAGES = 1_000_000  # limit of messages read from a topic
STORES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
_TYPES = get_typestore(Stores.ROS2_JAZZY)
_PLAIN = 40  # characters; longer texts in the metadata are checked as YAML, too
_KINDS = {
    "/map": "nav_msgs/msg/OccupancyGrid",
    "/odom": "nav_msgs/msg/Odometry",
    "/obstacles": "visualization_msgs/msg/MarkerArray",
    "/plan": "nav_msgs/msg/Path",
    "/cmd_vel": "geometry_msgs/msg/TwistStamped",
}
_LATCHED = Qos(
    QosHistory.KEEP_LAST,
    1,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    QosTime(0, 0),
    QosTime(0, 0),
    QosLiveliness.AUTOMATIC,
    QosTime(0, 0),
    False,
)


def make(kind: str, **fields: Any) -> Any:
    """Make a message of rosbags; other fields are zero or empty."""
    values = {name: _zero(*about) for name, about in _TYPES.fielddefs[kind][1] if name not in fields}
    return _TYPES.types[kind](**fields, **values)


def _zero(sort: Nodetype, about: Any) -> Any:
    if sort is Nodetype.NAME:
        return make(about)
    if sort is Nodetype.BASE:
        return {"string": "", "bool": False}.get(about[0], 0)
    (inner, of), length = about
    if inner is Nodetype.BASE and of[0] != "string":
        return np.zeros(length, of[0])
    return [_zero(inner, of) for _ in range(length)]


def save_bag(trace: Trace, path: str | Path, *, storage: str = "mcap", start: float = 0.0) -> dict[str, int]:
    """Write `trace` as the new bag folder `path`; its time 0 s is `start` s of the bag.

    Topics: /map once (transient local), /odom and /obstacles (what the robot sensed) at each control step and at the end,
    /cmd_vel (in the robot's frame, as `antway ros2` sends it) at each step with a command, /plan whenever the plan changed.

    Returns
    -------
    dict of str to int
        Number of messages of each topic.

    Raises
    ------
    BadParameter
        For a storage other than mcap and sqlite3, a `start` with which the trace ends at 2^31 s or later, and a path that
        cannot be written to.
    BadScenario
        If `path` exists.
    """
    checks.instance("trace", trace, Trace)
    plugin = STORES[checks.choice("storage", storage, STORES)]
    start, last = checks.number("start", start, low=0.0, unit="s"), float(trace.t[-1])
    if start + last >= 2.0**31:
        raise BadParameter(
            "start", start, f"so early that the trace, of {last:g} s, ends before 2^31 s: stamps hold no later times"
        )
    counts = dict.fromkeys(_KINDS, 0)
    with writing("bag", path) as folder:
        if folder.exists():
            raise BadScenario("bag", str(folder), "a folder that does not exist yet")
        with Writer(folder, version=9, storage_plugin=plugin) as writer:
            topics = {
                topic: writer.add_connection(
                    topic, kind, typestore=_TYPES, offered_qos_profiles=[_LATCHED] if topic == "/map" else []
                )
                for topic, kind in _KINDS.items()
            }
            for topic, t, message in _messages(trace, start):
                writer.write(topics[topic], round((start + t) * 1e9), _TYPES.serialize_cdr(message, _KINDS[topic]))
                counts[topic] += 1
    return counts


def _messages(trace: Trace, start: float) -> Iterator[tuple[str, float, Any]]:
    """Yield (topic, t in s, message) in the order of time."""
    robot, plans = trace.task.robot, {step: one.path for step, one in trace.decisions if one.path is not None}
    yield "/map", 0.0, convert.grid_message(trace.task.grid, make, t=start)
    for i, t in enumerate(trace.t.tolist()):
        (vx, vy), heading = trace.velocity[i].tolist(), float(trace.heading[i])
        header = convert.header_message(start + t, "map", make)
        turned = convert.twist_message(Command((vx, vy)), (0.0, 0.0), heading, RobotSpec(), make)
        turned.angular.z = float(trace.turn_rate[i])
        x, y = trace.xy[i].tolist()
        pose = convert.pose_message(x, y, heading, make)
        yield (
            "/odom",
            t,
            make(
                _KINDS["/odom"],
                header=header,
                child_frame_id="base_link",
                pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose),
                twist=make("geometry_msgs/msg/TwistWithCovariance", twist=turned),
            ),
        )
        seen, line = trace.sensed[i], trace.timeline
        xy, velocity = line.at(t)
        tracks = Tracks(line.id[seen], xy[seen], velocity[seen], line.radius[seen])
        yield "/obstacles", t, convert.markers_message(tracks, start + t, make)
        if i in plans:
            yield "/plan", t, convert.path_message(plans[i].xy, make, t=start + t)
        if i < len(trace) and all(map(math.isfinite, trace.command[i])):
            pair = (float(trace.command[i, 0]), float(trace.command[i, 1]))
            asked = Command(twist=pair) if robot.wheels and not robot.stepwise else Command(pair)
            twist = convert.twist_message(asked, (vx, vy), heading, robot, make)
            base = convert.header_message(start + t, "base_link", make)
            yield "/cmd_vel", t, make(_KINDS["/cmd_vel"], header=base, twist=twist)


def load_bag_map(path: str | Path, topic: str = "/map") -> Grid:
    """Return the last map on `topic` of the bag `path`.

    Raises
    ------
    BadMap, TooLarge
        If there is no such topic, there are fewer messages than stated, or the map is invalid (see `convert.read_grid`).
    """
    grids: list[Grid] = _read_apart(path, topic, None)
    return grids[-1]


def load_bag_tracks(path: str | Path, topic: str = "/obstacles", *, radius: float = 0.3) -> list[tuple[float, Tracks]]:
    """Return (t in s, tracks) of each MarkerArray or PoseArray on `topic` of the bag `path`; poses are discs of `radius` m.

    Raises
    ------
    BadScenario, BadParameter
        If there is no such topic, there are fewer messages than stated, or one is invalid.
    """
    radius = checks.number("radius", radius, low=0.0, open_low=True, unit="m")
    tracks: list[tuple[float, Tracks]] = _read_apart(path, topic, radius)
    return tracks


def check_bag(path: str, error: type[BadMap] | type[BadScenario]) -> None:
    """Refuse a bag that is too large, or whose metadata is not plain YAML of limited size."""
    size = sum(file.stat().st_size for file in Path(path).iterdir() if file.is_file()) if isdir(path) else 0
    if size > MAX_BYTES:
        raise TooLarge("bag", f"{size} bytes", f"at most {MAX_BYTES} bytes", where=path)
    if isfile(Path(path) / "metadata.yaml"):
        for text in check_yaml(read_bytes(Path(path) / "metadata.yaml", MAX_METADATA, error=error), path, error=error, **_YAML):
            if len(text) > _PLAIN:  # the settings of a topic may be YAML inside a text
                check_yaml(text.encode(), path, error=error, **_YAML)


def _read_apart(path: str | Path, topic: str, radius: float | None) -> list[Any]:
    """Read `topic` in a process with limited memory and files, because a bag may unpack to any size."""
    error = BadMap if radius is None else BadScenario
    check_bag(str(path), error)
    command = [sys.executable, "-c", "from antway.ros2.bags import serve; serve()"]
    done = subprocess.run(command, input=pickle.dumps((str(path), topic, radius)), stdout=subprocess.PIPE, check=False)
    if done.returncode != 0:
        raise error("bag", f"its reader ended with status {done.returncode}", "a readable bag of ROS 2", where=str(path))
    answer = pickle.loads(done.stdout)
    if isinstance(answer, BadInput):
        raise answer
    found: list[Any] = answer
    return found


def serve() -> None:
    """Read a topic for the parent process."""
    limit_process(MAX_BYTES, file=MAX_BYTES)
    try:
        answer: object = read_topic(*pickle.load(sys.stdin.buffer))
    except BadInput as error:
        answer = error
    sys.stdout.buffer.write(pickle.dumps(answer))


def read_topic(path: str, topic: str, radius: float | None) -> list[Any]:
    """Read all messages on `topic`; their number must be that in the metadata.

    If `radius` is None, they are maps, of which the last is returned, else (t in s, tracks); poses are discs of `radius` m.
    """
    error: type[BadMap] | type[BadScenario] = BadMap if radius is None else BadScenario
    readers: dict[str, Callable[[Any], Any]] = {"nav_msgs/msg/OccupancyGrid": convert.read_grid}
    if radius is not None:
        readers = {
            "visualization_msgs/msg/MarkerArray": convert.read_markers,
            "geometry_msgs/msg/PoseArray": lambda message: convert.read_poses(message, radius),
        }
    found, count = list[Any](), 0
    try:
        with AnyReader([Path(path)], default_typestore=_TYPES) as reader:
            lines = [line for line in reader.connections if line.topic == topic and line.msgtype in readers]
            promised = sum(line.msgcount for line in lines)
            if promised == 0:
                there = ", ".join(sorted(f"{line.topic} ({line.msgtype})" for line in reader.connections)) or "nothing"
                raise error("topic", topic, f"one with messages of {' or '.join(readers)}; the bag has {there}", where=path)
            if promised > MAX_MESSAGES:
                raise TooLarge(f"messages on {topic}", promised, f"at most {MAX_MESSAGES}", where=path)
            for line, _, data in reader.messages(connections=lines):
                count += 1
                if radius is None:
                    found.clear()
                found.append(readers[line.msgtype](reader.deserialize(data, line.msgtype)))
    except BadInput:
        raise
    except MemoryError:
        raise TooLarge("bag", "unpacks to more", f"what {MAX_BYTES} bytes of memory hold", where=path) from None
    except Exception as fault:  # for damaged bytes the library raises exceptions of any type
        raise error("bag", f"{type(fault).__name__}: {fault}"[:200], "a readable bag of ROS 2", where=path) from None
    if count != promised:
        raise error(f"messages on {topic}", count, f"the {promised} of the bag's metadata", where=path)
    return found
