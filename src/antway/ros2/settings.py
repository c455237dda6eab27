"""The parameters of the ROS 2 node, derived from the definitions of robot, task and policy; no ROS import."""

from __future__ import annotations

import ast
import importlib
import inspect
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any

import numpy as np

from antway import checks
from antway.errors import BadInput, BadParameter
from antway.grid import Grid, Moves
from antway.limits import MAX_PLACE, MAX_SPEED
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.guard import check_observation
from antway.ros2 import convert
from antway.tables import PLANNERS, ROBOTS, names
from antway.world.policy import Observation, RobotSpec, Task, Tracks
from antway.world.robots import DRIVES, load_robot

LASER = "sensor_msgs/msg/LaserScan"


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter: its default, its description, and what is accepted, in words and, for numbers, as a range."""

    default: Any
    text: str
    allowed: str
    low: float
    high: float


def _own(default: Any, text: str) -> Any:
    """Return the field of a parameter that is of the node itself, with its default and description."""
    return field(default=default, metadata={"text": text})


@dataclass(frozen=True, slots=True)
class Settings:
    """The parameters, checked by the definitions they come from, named as in `parameters` without prefixes."""

    robot: RobotSpec
    task: dict[str, float]
    policy: dict[str, Any]
    reader: Callable[[Any], Any] | None  # None for laser scans
    yaw_tolerance: float = _own(math.pi, "rad; tolerance of the final heading of wheels; pi or more: any heading.")
    autostart: bool = _own(False, "Configure and activate at start, without a lifecycle manager.")
    map_occupied: int = _own(
        100, "1 to 100; cost from which a cell of the map is blocked (lethal cells of a costmap have 100)."
    )
    frame: str = _own("map", "Frame of the map; messages in other frames need tf.")
    base_frame: str = _own("base_link", "Frame of the robot; commands are in this frame.")
    planner: str = _own("jps", f"Planner for get_plan and compute_path_to_pose: {names(PLANNERS)}.")
    planner_id: str = _own("GridBased", "Name of that planner for compute_path_to_pose, besides the names of all planners.")
    controller_id: str = _own("FollowPath", "Name of this controller for follow_path.")
    plan_time: float = _own(5.0, "s; time limit of a plan.")
    timeout: float = _own(
        0.5, "s; the robot stands if obstacles or tf are silent, or odometry is silent or old, for this time."
    )
    corridor: float = _own(2.0, "m; how far the robot may leave the path of follow_path to avoid obstacles.")
    wait_timeout: float = _own(5.0, "s; follow_path fails if the robot must wait longer for map, odometry or obstacles.")
    progress_radius: float = _own(0.5, "m; distance that the robot must move within progress_time, or follow_path fails.")
    progress_time: float = _own(20.0, "s; time within which the robot must move by progress_radius, or follow_path fails.")
    guard_process: bool = _own(
        False, "Run the guard in a separate process, which sends the commands, and brakes if the node hangs or is killed."
    )
    stamped: bool = _own(True, "Whether cmd_vel is a TwistStamped (stamped with the odometry that it answers) or a Twist.")
    obstacles_type: str = _own("visualization_msgs/msg/MarkerArray", f"Type of messages on obstacles; {LASER} comes on scan.")
    obstacles_converter: str = _own(
        "", "module:function that converts such a message to (t in s, Tracks); empty for built-in types."
    )
    obstacle_radius: float = _own(0.3, "m; radius of obstacles from a PoseArray.")
    scan_gap: float = _own(0.3, "m; points of a laser scan that are farther apart belong to different obstacles.")
    scan_clear: float = _own(0.15, "m; points of a laser scan within this distance of blocked cells belong to the map.")
    scan_valid: float = _own(0.2, "1; least share of valid beams in a laser scan.")
    scan_radius: float = _own(0.8, "m; largest radius of an obstacle from a laser scan; larger ones are divided.")

    @staticmethod
    def of(values: Mapping[str, Any]) -> Settings:
        """Check `values` by name; raise `BadInput` for whatever a definition refuses.

        What is left out of `robot.*` is as the named robot has it, or else as `RobotSpec` has it.
        """

        def part(prefix: str) -> dict[str, Any]:
            return {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}

        def named(build: Callable[..., Any], prefix: str, options: dict[str, Any]) -> Any:
            try:
                return build(**options)
            except BadInput as wrong:
                raise wrong.at("", f"{prefix}{wrong.field.removeprefix(prefix)}") from None

        policy = part("policy.")
        policy["moves"] = Moves(checks.choice("policy.moves", policy["moves"], [m.value for m in Moves]))
        named(AntwayPolicy, "policy.", policy)
        robot = named(_robot, "robot.", part("robot."))
        place = Grid(np.zeros((1, 1), bool))
        named(lambda **options: Task(place, robot, (0.5, 0.5), (0.5, 0.5), **options), "task.", part("task."))
        own: dict[str, Any] = {}
        for name, (default, text) in _OWN.items():
            if isinstance(default, float):
                most, unit = 1.0 if name in ("scan_valid", "scan_clear") else MAX_PLACE, text.partition(";")[0]
                own[name] = checks.number(name, values[name], low=0.0, high=most, open_low=True, unit=unit)
        for name in ("autostart", "guard_process", "stamped", "frame", "base_frame", "planner_id", "controller_id"):
            own[name] = checks.instance(name, values[name], type(_OWN[name][0]))
            if name.endswith("frame") and not own[name]:
                raise BadParameter(name, values[name], "the name of a frame")
        kind = values["obstacles_type"]
        return Settings(
            robot=robot,
            task=part("task."),
            policy=policy,
            map_occupied=checks.integer("map_occupied", values["map_occupied"], low=1, high=100),
            planner=checks.choice("planner", values["planner"], PLANNERS),
            reader=_reader(kind, values["obstacles_converter"], own["obstacle_radius"]),
            obstacles_type=kind,
            obstacles_converter=values["obstacles_converter"],
            **own,
        )


_OWN = {f.name: (f.default, f.metadata["text"]) for f in fields(Settings) if f.metadata}
_TASK_DEFAULTS = {"stay": 1.0}  # of a task, in place of its defaults: a robot is to stand at its goal
_UNSAID = {"drive": "", "brake_max": 0.0, "footprint": "[]"}  # for parameters without a default, or that may be None


def _robot(name: str = "", drive: str = "", **given: Any) -> RobotSpec:
    """Return the robot of that name with what is given besides or, without a name, the robot of what is given.

    If neither a name nor a drive is given, that is a `BadParameter`, because a holonomic robot is no sensible default.
    """
    if "brake_max" in given:
        given["brake_max"] = checks.number("brake_max", given["brake_max"], low=0.0, infinite=True, unit="m/s^2; 0: as a_max")
        given["brake_max"] = given["brake_max"] or None
    if "footprint" in given:
        given["footprint"] = _footprint(given["footprint"])
    try:
        base = load_robot(checks.instance("name", name, str)) if name else None
    except BadInput as wrong:
        raise wrong.at("", "name" if wrong.field == "robot" else wrong.field) from None
    checks.choice("dynamics", given.get("dynamics", "ramps" if base is None else base.dynamics), ["ramps"])
    if base is not None:
        slower = RobotSpec(v_max=given.get("v_max", base.v_max)).v_max  # which is then its limit in reverse, too
        given.setdefault("v_reverse", min(base.v_reverse, slower))
        return replace(base, **given, drive=drive or base.drive)
    if drive == "":
        allowed = f"{', '.join(DRIVES)}; or robot.name one of {', '.join(ROBOTS)} or a .toml file"
        raise BadParameter("drive", "", allowed)
    return RobotSpec(**given, drive=drive)


def parameter_values(robot: RobotSpec) -> dict[str, Any]:
    """Return the values of the parameters that describe `robot`, by their names."""
    values = {f"robot.{f.name}": getattr(robot, f.name) for f in fields(RobotSpec)}
    corners = [list(corner) for corner in robot.footprint or ()]
    return values | {"robot.brake_max": robot.brake_max or 0.0, "robot.footprint": str(corners)}


def _footprint(text: object) -> Any:
    """Return the corners of a footprint in Nav2's format, "[[0.2, 0.1], [0.2, -.1], [-0.2, 0.0]]"; None for "[]" or ""."""
    allowed = 'the corners of a convex polygon as Nav2 writes them, "[[x, y], [x, y], [x, y]]" in m, or "[]" for a disc'
    try:
        found = ast.literal_eval(checks.instance("footprint", text, str).strip() or "[]")
    except (ValueError, SyntaxError, MemoryError, RecursionError):
        found = ()
    if not isinstance(found, list):
        raise BadParameter("footprint", text, allowed)
    if len(found) > 3 and found[-1] == found[0]:  # a polygon that is closed, which Nav2 takes, too
        del found[-1]
    return found or None


def _reader(kind: str, hook: str, radius: float) -> Callable[[Any], Any] | None:
    """Return the reader of obstacles of type `kind`: the function named by `hook`, or the built-in one."""
    readers: dict[str, Callable[[Any], Any] | None] = {
        "visualization_msgs/msg/MarkerArray": convert.read_markers,
        "geometry_msgs/msg/PoseArray": lambda message: convert.read_poses(message, radius),
        LASER: None,
    }
    if not hook:
        return readers[checks.choice("obstacles_type (without obstacles_converter)", kind, readers)]
    module, _, name = checks.instance("obstacles_converter", hook, str).partition(":")
    try:
        reader = getattr(importlib.import_module(module), name)
    except Exception as error:  # whatever the module raises
        raise BadParameter("obstacles_converter", hook, f"module:function that can be imported ({error})") from None
    if not callable(reader):
        raise BadParameter("obstacles_converter", hook, "module:function; this is none")
    if len(str(kind).split("/")) != 3:
        raise BadParameter("obstacles_type", kind, "the name of a type, such as geometry_msgs/msg/PoseArray")

    def read(message: Any) -> tuple[float, Tracks]:
        try:
            t, tracks = reader(message)
        except BadInput:
            raise
        except Exception as error:  # whatever the function raises; the robot stands, and the node says why
            raise BadParameter("obstacles_converter", hook, f"able to read each message ({error!r})") from None
        seen = Observation(t, (0.0, 0.0), (0.0, 0.0), 0.0, checks.instance("tracks", tracks, Tracks))
        return check_observation(seen).t, tracks

    return read


def refused(values: Mapping[str, Any], name: str, value: Any) -> BadInput | None:
    """Return why `value` is refused for the parameter `name` besides `values`, for any drive; None if it is not."""
    wrong = None
    for drive in DRIVES if name.startswith("robot.") else DRIVES[:1]:
        needed = {"robot.turning_radius": 0.5} if drive == "ackermann" else {}
        needed |= {"robot.v_max": MAX_SPEED} if name == "robot.v_reverse" else {}
        try:
            Settings.of({**values, "robot.drive": drive, **needed, name: value})
        except BadInput as error:
            wrong = error
        else:
            return None
    return wrong


def described(kind: type) -> dict[str, str]:
    """Return what the docstring of a class says about each parameter or attribute, as one line.

    Examples
    --------
    >>> described(RobotSpec)["dt"]
    'Control period in s, >= 1e-6.'
    """
    found: dict[str, str] = {}
    for keys, _, text in re.findall(
        r"^(\w+(?:, \w+)*) : ([^\n]*)\n((?: {4}[^\n]*\n?)*)", f"{inspect.getdoc(kind)}\n", re.MULTILINE
    ):
        found |= dict.fromkeys(keys.split(", "), " ".join(text.split()))
    return found


@lru_cache(maxsize=1)
def parameters() -> dict[str, Parameter]:
    """Return every parameter by name, as `RobotSpec`, `Task` and `AntwayPolicy` define them, and the node's own.

    What a definition accepts is found by trying: the words come from its error, the range from the refused values.
    """
    robot = described(RobotSpec)
    found = {f"robot.{f.name}": (_UNSAID.get(f.name, f.default), robot[f.name]) for f in fields(RobotSpec)}
    found["robot.brake_max"] = (0.0, f"{robot['brake_max'].partition(';')[0]}; 0: as robot.a_max.")
    found["robot.footprint"] = (
        "[]",
        'Corners in m of a convex polygon in the robot\'s frame, as Nav2 writes it, "[[x, y], ...]"; []: a disc.',
    )
    found["robot.dynamics"] = ("ramps", "Speeds ramp within a control period, and wheels drive arcs; no other is driven.")
    found["robot.drive"] = ("", f"{robot['drive']} Needed, unless robot.name is given.")
    task = described(Task)
    found |= {
        f"task.{f.name}": (_TASK_DEFAULTS.get(f.name, f.default), task[f.name])
        for f in fields(Task)
        if isinstance(f.default, float)
    }
    options = described(AntwayPolicy)
    for name, option in inspect.signature(AntwayPolicy).parameters.items():
        if option.default is None:
            continue  # ROS has no type for values that the policy computes if they are not given
        default = option.default.value if isinstance(option.default, Moves) else option.default
        found[f"policy.{name}"] = (default, options[name])
    found["robot.name"] = ("", f"Robot: {names(ROBOTS)}, or a .toml file; other robot.* parameters that are set override it.")
    found |= _OWN
    defaults = {name: default for name, (default, _) in found.items()}
    result = {}
    for name, (default, text) in found.items():
        wrong, low, high = refused(defaults, name, None), 0.0, 0.0
        if isinstance(default, (int, float)) and not isinstance(default, bool):
            most = math.inf if isinstance(default, float) else 2**63 - 1
            low, high = (
                _end(lambda value: refused(defaults, name, value) is None, default, sign * most)  # noqa: B023
                for sign in (-1, 1)
            )
        result[name] = Parameter(default, text, "" if wrong is None else wrong.allowed, low, high)
    return result


def _end(accepts: Callable[[Any], bool], inside: Any, outside: Any) -> Any:
    """Return the last accepted number from `inside` towards `outside`, by bisection over whole numbers or ranks of floats."""
    if isinstance(inside, float):
        return _ranked(_end(lambda rank: accepts(_ranked(rank)), _rank(inside), _rank(outside)))
    step = 1 if outside > inside else -1
    for likely in (outside, outside - step, 0, 1):
        if accepts(likely) and (likely == outside or not accepts(likely + step)):
            return likely
    while abs(outside - inside) > 1:
        middle = (inside + outside) // 2
        inside, outside = (middle, outside) if accepts(middle) else (inside, middle)
    return inside


def _rank(value: float) -> int:
    """Return the place of a float in the order of all: those next to 0.0, of rank 0, have the ranks -1 and 1."""
    return int(math.copysign(1.0, value)) * int(np.float64(abs(value)).view(np.int64))


def _ranked(rank: int) -> float:
    """Return the float of a rank."""
    return math.copysign(float(np.int64(abs(rank)).view(np.float64)), rank)
