"""What a robot can do: drive, limits, latency and footprint; and the robots that antway knows by name."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, fields
from os.path import isfile
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadInput, BadParameter, BadScenario
from antway.kernels.base.records import RobotLimits
from antway.limits import MAX_ANGLE, MAX_PLACE, MAX_SPEED, MAX_TIME, MIN_PERIOD
from antway.reading import read_toml_file

DRIVES = ("holonomic", "differential", "ackermann")  # in the order of kernels/base/records.py
DYNAMICS = ("ramps", "steps")
T = TypeVar("T")
_MOST_CORNERS = 64  # limit of corners of a footprint
_MAX_BYTES = 2**20  # limit of a robot's file


@dataclass(frozen=True, slots=True)
class RobotSpec:
    """A robot: its shape, and how it follows a command.

    Parameters
    ----------
    radius : float
        Radius of a disc, m, > 0. With a `footprint` it becomes that of the disc around (0, 0) that contains the footprint.
    v_max : float
        Speed limit in m/s, > 0.
    a_max : float
        Limit of acceleration, m/s^2, > 0; infinite: the speed changes at once.
    drive : str
        "holonomic" (any direction; a disc points where it goes, a footprint keeps its heading), "differential" or "ackermann".
    dt : float
        Control period in s, >= 1e-6.
    sensor_range : float
        How far the robot senses moving obstacles, m, > 0.
    turn_rate : float
        Limit of the turn rate of wheels in rad/s, > 0.
    v_reverse : float
        Speed limit of wheels in reverse, m/s, in [0, v_max], without a sign.
    brake_max : float or None
        Limit of deceleration, m/s^2, > 0; None: `a_max`.
    alpha_max : float
        Limit of change of the turn rate, rad/s^2, > 0.
    turning_radius : float
        Smallest radius of an arc in m; > 0 for ackermann, else 0.
    latency : float
        Delay between a command and its effect, s, >= 0.
    footprint : sequence of (x, y) or None
        Corners in m of a convex polygon in the robot's frame (x ahead, y left, rotation about (0, 0)); None: a disc.
    dynamics : str
        "ramps": speeds ramp within a control period and wheels drive arcs. "steps": velocity and heading jump at the start of
        each period, and the robot drives straight; for old traces, without ackermann, reverse, latency, `brake_max` and
        footprint.

    Raises
    ------
    BadParameter

    Examples
    --------
    >>> RobotSpec(drive="differential", a_max=1.0, v_reverse=0.3).limits.brake_max
    1.0
    """

    radius: float = 0.3
    v_max: float = 1.0
    a_max: float = math.inf
    drive: str = "holonomic"
    dt: float = 0.1
    sensor_range: float = 4.0
    turn_rate: float = 2.0
    v_reverse: float = 0.0
    brake_max: float | None = None
    alpha_max: float = math.inf
    turning_radius: float = 0.0
    latency: float = 0.0
    footprint: tuple[tuple[float, float], ...] | None = None
    dynamics: str = "ramps"

    def __post_init__(self) -> None:
        def checked(name: str, unit: str, **limits: Any) -> None:
            value = checks.number(f"robot.{name}", getattr(self, name), unit=unit, **limits)
            object.__setattr__(self, name, value)

        checked("radius", "m", low=0.0, high=MAX_PLACE, open_low=True)
        checked("v_max", "m/s", low=0.0, high=MAX_SPEED, open_low=True)
        checked("dt", "s", low=MIN_PERIOD, high=MAX_TIME)
        checked("turn_rate", "rad/s", low=0.0, high=MAX_ANGLE, open_low=True)
        for name, unit in (("a_max", "m/s^2"), ("sensor_range", "m"), ("alpha_max", "rad/s^2")):
            checked(name, unit, low=0.0, open_low=True, infinite=True)
        checks.choice("robot.drive", self.drive, DRIVES)
        checks.choice("robot.dynamics", self.dynamics, DYNAMICS)
        steers = self.drive == "ackermann"
        unit = "m/s; a speed without sign, 0 with a holonomic drive"
        checked("v_reverse", unit, low=0.0, high=self.v_max if self.wheels else 0.0)
        if self.brake_max is not None:
            checked("brake_max", "m/s^2", low=0.0, open_low=True, infinite=True)
        unit = "m; > 0 with an ackermann drive, else 0"
        checked("turning_radius", unit, low=0.0, high=math.inf if steers else 0.0, open_low=steers)
        checked("latency", "s, 100 dt", low=0.0, high=100.0 * self.dt)
        if self.footprint is not None:
            corners = convex_footprint("robot.footprint", self.footprint)
            object.__setattr__(self, "footprint", corners)
            object.__setattr__(self, "radius", max(math.hypot(x, y) for x, y in corners))
        ramps = steers or self.v_reverse or self.latency or self.brake_max is not None or self.footprint is not None
        if self.dynamics == "steps" and ramps:
            allowed = '"ramps" with an ackermann drive, reverse, latency, brake_max or a footprint'
            raise BadParameter("robot.dynamics", self.dynamics, allowed)

    @property
    def wheels(self) -> bool:
        """Whether it drives only along its heading, so that commands are twists."""
        return self.drive != "holonomic"

    @property
    def stepwise(self) -> bool:
        """Whether it moves straight at constant speed throughout each cycle.

        This holds for holonomic discs without inertia and latency, and for the dynamics "steps".
        """
        at_once = math.isinf(self.a_max) and math.isinf(self.braking) and self.latency == 0.0
        return self.dynamics == "steps" or (not self.wheels and self.footprint is None and at_once)

    @property
    def late_commands(self) -> int:
        """Number of the last commands that do not act yet."""
        return math.ceil(self.latency / self.dt - 1e-9)

    @property
    def braking(self) -> float:
        """Limit of deceleration, m/s^2."""
        return self.a_max if self.brake_max is None else self.brake_max

    @property
    def stop_time(self) -> float:
        """Time to stop from full speed, s, without the latency."""
        return self.v_max / self.braking

    @property
    def limits(self) -> RobotLimits:
        """The limits as a record for kernels."""
        bounds = self.v_max, self.v_reverse, self.a_max, self.braking, self.turn_rate, self.alpha_max, self.turning_radius
        return RobotLimits(DRIVES.index(self.drive), *bounds, self.latency, self.radius)

    @property
    def corners(self) -> NDArray[np.float64]:
        """Corners of the footprint, counterclockwise, float64[N, 2], m; for a disc its centre."""
        return np.array(self.footprint) if self.footprint is not None else np.zeros((1, 2))

    @property
    def inscribed(self) -> float:
        """Radius of the largest disc around (0, 0) inside the body, m; 0 if the footprint does not contain that point.

        Examples
        --------
        >>> RobotSpec(footprint=((-0.5, -0.3), (0.5, -0.3), (0.5, 0.3), (-0.5, 0.3))).inscribed
        0.3
        """
        if self.footprint is None:
            return self.radius
        corners = self.corners
        x, y = (np.roll(corners, -1, axis=0) - corners).T
        return max(float(((x * -corners[:, 1] + y * corners[:, 0]) / np.hypot(x, y)).min()), 0.0)

    @property
    def rounding(self) -> float:
        """By how much the body extends beyond the convex hull of `corners`, m: the radius of a disc, else 0."""
        return self.radius if self.footprint is None else 0.0


def convex_footprint(field: str, value: object) -> tuple[tuple[float, float], ...]:
    """Return the corners of a convex polygon counterclockwise.

    Raises
    ------
    BadParameter
        For fewer than 3 or more than 64 corners, corners that are not finite, and an outline that crosses itself, is not convex
        or has no area.

    Examples
    --------
    >>> convex_footprint("footprint", [(1, 0), (0, 0), (0, 1)])
    ((0.0, 1.0), (0.0, 0.0), (1.0, 0.0))
    """
    allowed = "the corners of a convex polygon, which does not cross itself, in order, (x, y) in m"
    listed = checks.sequence(field, value, allowed)
    if not 3 <= len(listed) <= _MOST_CORNERS:
        raise BadParameter(field, listed, f"3 to {_MOST_CORNERS} corners")
    corners = np.array([checks.point(f"{field}[{i}]", corner) for i, corner in enumerate(listed)])
    if np.abs(corners).max() > 1e6:
        raise BadParameter(field, float(np.abs(corners).max()), "at most 1e6 (m)")
    edges = np.roll(corners, -1, axis=0) - corners
    after = np.roll(edges, -1, axis=0)
    turns = np.arctan2(edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0], (edges * after).sum(axis=1))
    around = float(turns.sum())
    slack = 1e-9
    round_once = abs(abs(around) - 2.0 * math.pi) < 1e-6
    twice = (corners[:, 0] * edges[:, 1] - corners[:, 1] * edges[:, 0]).sum()  # twice the area; of a slanted line, rounding
    flat = abs(twice) <= 2e-12 * (corners**2).sum(axis=1).max()
    if flat or not round_once or (turns * math.copysign(1.0, around) < -slack).any() or (np.hypot(*edges.T) <= 0.0).any():
        raise BadParameter(field, [tuple(map(float, corner)) for corner in corners], allowed)
    ordered = corners if around > 0 else corners[::-1]
    return tuple((float(x), float(y)) for x, y in ordered)


def _box(back: float, front: float, side: float, **limits: Any) -> RobotSpec:
    """Return a rectangle on two wheels, from `back` to `front` of the centre of rotation, and `side` m to each side."""
    corners = ((back, -side), (front, -side), (front, side), (back, side))
    return RobotSpec(drive="differential", footprint=corners, **limits)


# name: (the specification, where its numbers come from)
ROBOTS: dict[str, tuple[RobotSpec, str]] = {
    "holonomic": (RobotSpec(), "a disc of 0.3 m that drives in any direction at once: the robot of antway's first suites"),
    "inertia": (RobotSpec(a_max=1.0), "a holonomic disc of 0.3 m with an acceleration of 1 m/s^2"),
    "diff": (
        RobotSpec(radius=0.3, v_max=1.0, a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3, drive="differential"),
        "a disc of 0.3 m on two wheels: the robot of antway's tables on wheels",
    ),
    "turtlebot3_burger": (
        _box(-0.105, 0.041, 0.105, v_max=0.22, v_reverse=0.22, a_max=2.5, turn_rate=2.75, alpha_max=3.2, sensor_range=3.5),
        "ROBOTIS-GIT/turtlebot3, turtlebot3_navigation/param: dwa_local_planner_params_burger, costmap_common_params_burger",
    ),
    "turtlebot3_waffle": (
        _box(-0.205, 0.077, 0.145, v_max=0.26, v_reverse=0.26, a_max=2.5, turn_rate=1.82, alpha_max=3.2, sensor_range=3.5),
        "ROBOTIS-GIT/turtlebot3, turtlebot3_navigation/param: dwa_local_planner_params_waffle, costmap_common_params_waffle",
    ),
    "turtlebot4": (
        RobotSpec(radius=0.175, v_max=0.31, a_max=0.9, turn_rate=1.9, alpha_max=3.2, sensor_range=8.0, drive="differential"),
        "TurtleBot 4 user manual (0.31 m/s in safe mode, 1.9 rad/s); Create 3 (0.9 m/s^2 at the wheels, no reverse in safe "
        "mode); turtlebot/turtlebot4, turtlebot4_navigation/config/nav2.yaml (angular acceleration 3.2 rad/s^2)",
    ),
    "jackal": (
        _box(-0.254, 0.254, 0.215, v_max=2.0, v_reverse=2.0, a_max=2.0, turn_rate=4.0, alpha_max=6.0, sensor_range=8.0),
        "Clearpath Jackal, 508 x 430 mm, 2.0 m/s and 4.0 rad/s (jackal/jackal, jackal_control/config/control.yaml); the "
        "20 m/s^2 and 25 rad/s^2 are too large to limit anything; 2 m/s^2 and 6 rad/s^2 are what tyres can transmit to a floor",
    ),
    "amr": (
        _box(
            -0.5,
            0.5,
            0.35,
            v_max=1.5,
            v_reverse=0.3,
            a_max=0.7,
            brake_max=1.2,
            turn_rate=1.2,
            alpha_max=1.5,
            latency=0.1,
            sensor_range=8.0,
        ),
        "a warehouse robot of 1.0 x 0.7 m with the limits that such robots have when loaded: no one maker's",
    ),
}


def load_robot(name: str | Path) -> RobotSpec:
    """Return the robot of that name (`ROBOTS`), or the one in a TOML file, whose keys are the fields of `RobotSpec`.

    They may stand in a table [robot], if there is nothing else in the file.

    Raises
    ------
    BadParameter, BadScenario
        For an unknown name, and for errors in the file.

    Examples
    --------
    >>> load_robot("turtlebot4").v_max
    0.31
    """
    if isinstance(name, str) and name in ROBOTS:
        return ROBOTS[name][0]
    path = Path(name) if isinstance(name, (str, Path)) else None
    if path is None or path.suffix != ".toml" or not isfile(path):
        raise BadParameter("robot", str(name), f"one of {', '.join(ROBOTS)}, or the name of a .toml file that exists")
    record = read_toml_file(path, _MAX_BYTES, "robot")
    if "robot" in record:
        check_keys(record, "", ("robot",), (), str(path))
    return robot_of(record.get("robot", record), str(path))


def robot_of(record: object, where: str) -> RobotSpec:
    """Return the robot that the table `record` of the file `where` describes."""
    if isinstance(record, dict) and "footprint" in record and "radius" in record:
        raise BadScenario("robot.footprint", record["footprint"], "left out where robot.radius is given", where=where)
    return from_table("robot", RobotSpec, record, where)


def from_table(name: str, kind: type[T], record: object, where: str) -> T:
    """Make a `kind` of the table `record` of a file; what its own checks refuse is named after the table."""
    if not isinstance(record, dict):
        raise BadScenario(name, record, "a table", where=where)
    known = [f for f in fields(kind) if f.init]  # type: ignore[arg-type]
    check_keys(record, name, tuple(f.name for f in known), tuple(f.name for f in known if f.default is MISSING), where)
    try:
        return kind(**record)
    except BadInput as error:
        raise error.at(where, f"{name}.{error.field.removeprefix(f'{name}.')}") from None


def check_keys(record: dict[str, Any], name: str, allowed: tuple[str, ...], needed: tuple[str, ...], where: str) -> None:
    """Raise `BadScenario` for a key of a table that is not allowed, and for one that is needed and missing."""
    dot = f"{name}." if name else ""
    for key in record:
        if key not in allowed:
            raise BadScenario(f"{dot}{key}", record[key], f"left out; the keys are {', '.join(allowed)}", where=where)
    for key in needed:
        if key not in record:
            raise BadScenario(f"{dot}{key}", None, "given", where=where)


def towards(velocity: tuple[float, float], heading: float, robot: RobotSpec) -> tuple[float, float]:
    """Return (v, omega) of wheels with a heading in rad that are to drive with `velocity` in the world's frame."""
    asked = math.hypot(*velocity)
    if not asked > 1e-9:
        return asked, 0.0  # also for NaN
    turn = math.remainder(math.atan2(velocity[1], velocity[0]) - heading, 2.0 * math.pi)
    rate = min(robot.turn_rate, abs(turn) / robot.dt)
    if math.isfinite(robot.alpha_max):
        gain = robot.alpha_max * robot.dt
        rate = min(rate, math.sqrt(gain * gain / 4.0 + 2.0 * robot.alpha_max * abs(turn)) - gain / 2.0)
    return max(asked * math.cos(turn), 0.0), math.copysign(rate, turn)


def body_gap(
    robot: RobotSpec, xy: NDArray[np.float64], heading: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance of points, float64[..., 2], from the edge of a robot's body, m; below 0 inside.

    `xy`, float64[..., 2], and `heading`, float64[...], are the robot's place (m) and heading (rad) for each point.
    """
    away = points - xy
    if robot.footprint is None:
        return np.asarray(np.hypot(away[..., 0], away[..., 1]) - robot.radius)
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = cos * away[..., 0] + sin * away[..., 1], cos * away[..., 1] - sin * away[..., 0]
    corners = robot.corners
    edges, off = np.roll(corners, -1, axis=0) - corners, np.stack((x, y), axis=-1)[..., None, :] - corners
    share = np.clip((off * edges).sum(axis=-1) / (edges**2).sum(axis=-1), 0.0, 1.0)
    gap = np.hypot(*np.moveaxis(off - share[..., None] * edges, -1, 0)).min(axis=-1)
    inside = (edges[:, 0] * off[..., 1] > edges[:, 1] * off[..., 0]).all(axis=-1)  # corners are counterclockwise
    return np.asarray(np.where(inside, -gap, gap))
