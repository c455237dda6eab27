"""The contract between a world and what steers the robot: Task and Observation in, Command and Decision out."""

from __future__ import annotations

import ast
import inspect
import math
import numbers
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, OutOfBounds
from antway.grid import Grid
from antway.limits import MAX_PLACE, MAX_SPEED, MAX_STAY
from antway.planning import TimedPath, find
from antway.tables import POLICIES as POLICIES
from antway.world.robots import RobotSpec as RobotSpec
from antway.world.timeline import Timeline

XY = tuple[float, float]  # m, or m/s


@dataclass(frozen=True, slots=True)
class Task:
    """What a policy is told before an episode: the known map, the robot, both ends, and how fast an obstacle may be.

    Attributes
    ----------
    grid : Grid
        The static map as it is (not inflated); yaw must be 0.
    robot : RobotSpec
    start, goal : (x, y)
        m; the robot's disc must be free of the map's blocked cells at both.
    goal_tolerance : float
        The goal is reached within this distance, m, > 0.
    obstacle_speed : float
        Declared bound on the speed of moving obstacles, m/s, >= 0 (an assumption of the guard's promise).
    obstacle_surge : float
        Declared bound on how fast an obstacle's speed grows, m/s^2, >= 0; infinite: it may be at full speed at once.
    obstacle_swerve : float
        Declared bound on how fast an obstacle's velocity changes as a vector, m/s^2, >= 0; infinite: it may turn at once. One
        that touches a wall may turn at once in any case. Only what is told to robots with inertia.
    stay : float
        For how long the robot is to stand at the goal, s, in [0, 60]: policy `antway` arrives when it is clear for so long.

    Raises
    ------
    BadParameter, OutOfBounds
        Whether the robot has room at the ends is for `Scenario` and for policies to say.

    Examples
    --------
    >>> import numpy as np
    >>> from antway import Grid, RobotSpec
    >>> Task(Grid(np.zeros((40, 60), bool), 0.1), RobotSpec(radius=0.2), (1.0, 1.0), (5.0, 3.0)).goal
    (5.0, 3.0)
    """

    grid: Grid
    robot: RobotSpec
    start: XY
    goal: XY
    goal_tolerance: float = 0.2
    obstacle_speed: float = 1.5
    obstacle_surge: float = math.inf
    obstacle_swerve: float = math.inf
    stay: float = 0.0

    def __post_init__(self) -> None:
        checks.instance("grid", self.grid, Grid)
        checks.instance("robot", self.robot, RobotSpec)
        if self.grid.origin[2] != 0.0:
            raise BadParameter("grid.origin[2]", self.grid.origin[2], "0 in an episode (yaw): Grid.turned() turns the map")
        for name in ("start", "goal"):
            object.__setattr__(self, name, checks.point(name, getattr(self, name)))
            try:
                self.grid.cell_at(getattr(self, name))
            except OutOfBounds as error:
                raise error.at("", name) from None
        checks.number("goal_tolerance", self.goal_tolerance, low=0.0, high=MAX_PLACE, open_low=True, unit="m")
        checks.number("obstacle_speed", self.obstacle_speed, low=0.0, high=MAX_SPEED, unit="m/s")
        for name in ("obstacle_surge", "obstacle_swerve"):
            checks.number(name, getattr(self, name), low=0.0, infinite=True, unit="m/s^2")
        checks.number("stay", self.stay, low=0.0, high=MAX_STAY, unit="s")


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Moving obstacles as sensed: K discs. Arrays of another type or layout, and lists, are copied into the types below.

    Attributes
    ----------
    id : int64[K]
        The same obstacle keeps its number from one observation to the next; a negative one is none. Where a number occurs
        twice, policies and guards take these tracks as tracks without a number.
    xy, velocity : float64[K, 2]
        m, m/s.
    radius : float64[K]
        m, > 0.
    covariance : float64[K, 4, 4] or None
        Of (x, y, vx, vy), where the sensor is noisy.

    Raises
    ------
    BadParameter
        For what holds no numbers. What the numbers may be is checked where they are used.

    Examples
    --------
    >>> Tracks([7], [[1, 2]], [[0.5, 0]], [0.3]).xy.dtype
    dtype('float64')
    """

    id: NDArray[np.int64]
    xy: NDArray[np.float64]
    velocity: NDArray[np.float64]
    radius: NDArray[np.float64]
    covariance: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        # Kernels are compiled for each type and layout of their arrays, which takes seconds: they meet these alone.
        for name, kind in _TRACKS:
            array = getattr(self, name)
            if array is None and name == "covariance":
                continue
            if type(array) is not np.ndarray or array.dtype is not kind or not array.flags.carray:
                object.__setattr__(self, name, _plain_array(f"tracks.{name}", array, kind))

    def __len__(self) -> int:
        return len(self.id)

    def distinct(self) -> Tracks:
        """Return these tracks; those whose number another one has too, as floats tell numbers apart, have none then (-1).

        Examples
        --------
        >>> Tracks([7, 8, 7], np.zeros((3, 2)), np.zeros((3, 2)), np.ones(3)).distinct().id.tolist()
        [-1, 8, -1]
        """
        _, place, times = np.unique(self.id.astype(np.float64), return_inverse=True, return_counts=True)
        if (times == 1).all():
            return self
        return replace(self, id=np.where((times[place] > 1) | (self.id < 0), -1, self.id))

    @staticmethod
    def none() -> Tracks:
        """Return no tracks."""
        return Tracks(np.empty(0, np.int64), np.empty((0, 2)), np.empty((0, 2)), np.empty(0))


_REAL, _WHOLE = np.dtype(np.float64), np.dtype(np.int64)
_TRACKS = (("id", _WHOLE), ("xy", _REAL), ("velocity", _REAL), ("radius", _REAL), ("covariance", _REAL))


def _plain_array(field: str, value: object, kind: np.dtype[Any]) -> NDArray[Any]:
    """Return `value` as a writeable array of `kind` in C order; whole numbers stay whole."""
    try:
        array = np.array(value)
        if array.dtype.kind not in "iuf" and array.size:
            raise TypeError
        with np.errstate(invalid="ignore"):
            result = np.array(array, dtype=kind, order="C")
        if kind is _WHOLE and not (array == result).all():
            raise TypeError
    except (TypeError, ValueError, OverflowError):
        raise BadParameter(field, value, f"an array of numbers, {kind.name}") from None
    return result


@dataclass(frozen=True, slots=True, eq=False)
class Observation:
    """What the robot knows at time `t`: its own state, and the tracks sensed at `stamp` (`t` unless the sensor lags).

    Raises
    ------
    BadParameter
        For what is no number, or no pair of numbers; what the numbers may be is checked where they are used.

    Examples
    --------
    >>> import numpy as np
    >>> from antway import Tracks
    >>> nobody = Tracks(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)), np.zeros(0))
    >>> Observation(0.0, (1.0, 1.0), (0.5, 0.0), 0.0, nobody).speed
    0.5
    """

    t: float  # s
    xy: XY  # m
    velocity: XY  # m/s
    heading: float  # rad
    tracks: Tracks
    stamp: float = math.nan  # s; NaN: sensed now
    turn_rate: float = 0.0  # rad/s
    pending: NDArray[np.float64] | None = None  # float64[M, 2]: the commands on their way to a robot with latency, oldest first

    def __post_init__(self) -> None:
        for name in ("t", "heading", "stamp", "turn_rate"):
            if type(getattr(self, name)) is not float:
                object.__setattr__(self, name, _real(f"observation.{name}", getattr(self, name)))
        for name in ("xy", "velocity"):
            pair = getattr(self, name)
            if type(pair) is not tuple or len(pair) != 2 or type(pair[0]) is not float or type(pair[1]) is not float:
                object.__setattr__(self, name, _pair(f"observation.{name}", pair))
        if self.pending is not None:
            array = self.pending
            if type(array) is not np.ndarray or array.dtype is not _REAL or not array.flags.carray:
                object.__setattr__(self, "pending", _plain_array("observation.pending", array, _REAL))
        checks.instance("observation.tracks", self.tracks, Tracks)

    @property
    def sensed_at(self) -> float:
        """When the tracks were where they are said to be, s."""
        return self.t if math.isnan(self.stamp) else self.stamp

    @property
    def speed(self) -> float:
        """Speed along the heading, m/s; negative in reverse."""
        return self.velocity[0] * math.cos(self.heading) + self.velocity[1] * math.sin(self.heading)


def _real(field: str, value: object) -> float:
    """Return `value` as a float, which need not be finite."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (numbers.Real, np.number)):
        raise BadParameter(field, value, "a number")
    try:
        return float(value)
    except (OverflowError, TypeError):
        raise BadParameter(field, value, "a number") from None


def _pair(field: str, value: object) -> XY:
    if isinstance(value, (str, bytes, dict)) or not isinstance(value, (Iterable, np.ndarray)):
        raise BadParameter(field, value, "two numbers")
    parts = list(value)
    if len(parts) != 2:
        raise BadParameter(field, value, "two numbers")
    return _real(field, parts[0]), _real(field, parts[1])


@dataclass(frozen=True, slots=True)
class Command:
    """What to drive with until the next cycle.

    Attributes
    ----------
    velocity : (vx, vy)
        m/s in the world's frame: for holonomic robots, and for wheels where `twist` is None.
    twist : (v, omega) or None
        For wheels: speed along the heading in m/s, negative in reverse, and turn rate in rad/s.

    Examples
    --------
    >>> Command((0.5, 0.0)).velocity
    (0.5, 0.0)
    >>> Command(twist=(0.4, -0.2)).twist  # wheels: 0.4 m/s, turning right
    (0.4, -0.2)
    """

    velocity: XY = (0.0, 0.0)
    twist: XY | None = None

    def acts(self, observation: Observation, robot: RobotSpec) -> XY:
        """Return the two numbers that the robot follows: (vx, vy), or for wheels (v, omega).

        Wheels that are given a velocity alone turn towards it, as fast as they can still stop turning there, and meanwhile
        drive forward at its part along the heading, never backwards.
        """
        if not robot.wheels:
            return self.velocity
        if self.twist is not None:
            return self.twist
        return towards(self.velocity, observation.heading, robot)


def towards(velocity: XY, heading: float, robot: RobotSpec) -> XY:
    """Return the (v, omega) of wheels with that heading in rad that are to drive with `velocity` in the world's frame."""
    asked = math.hypot(*velocity)
    if not asked > 1e-9:
        return asked, 0.0  # also what is not a number
    turn = math.remainder(math.atan2(velocity[1], velocity[0]) - heading, 2.0 * math.pi)
    rate = min(robot.turn_rate, abs(turn) / robot.dt)
    if math.isfinite(robot.alpha_max):
        gain = robot.alpha_max * robot.dt
        rate = min(rate, math.sqrt(gain * gain / 4.0 + 2.0 * robot.alpha_max * abs(turn)) - gain / 2.0)
    return max(asked * math.cos(turn), 0.0), math.copysign(rate, turn)


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """Why a policy does what it does in one cycle; every field but the first two may be empty.

    Attributes
    ----------
    action : str
        follow, avoid, wait, step-back, brake, step-aside, arrived or stuck.
    reason : str
        One sentence for people.
    obstacle : int or None
        Id of the track that matters.
    encounter : str
        head-on, crossing-left, crossing-right, overtaking, standing, or empty.
    time_to_closest, distance_at_closest : float
        Of the closest approach to that obstacle on the present course, s and m between the discs' edges; NaN if none.
    local_target : (x, y) or None
        Where the detour ends, m.
    path : TimedPath or None
        The motion planned from here on.
    alternatives : sequence of (name, cost in s)
        What was weighed, and how much later than if nothing moved the goal is reached so; infinite where no path was found.
    gap : float
        Certified gap of the choice (0.01 is 1 %), NaN if nothing is certified.
    guard : str
        What the guard did: free, slowed, braked, stepped-aside, or empty.
    pheromone : (row0, col0, float32[h, w]) or None
        The ants' pheromone by cell in the window with that corner, for pictures.
    history : float64[C, 4] or None
        By ant cycle: best length, mean length (m), share of ants that arrived, pheromone entropy (nats).
    predicted : float32[P, 7] or None
        Where the policy takes the tracks to go, for pictures: rows (t0, t1, x, y, vx, vy, radius), each a disc of `radius` m
        that moves uniformly from (x, y) m with (vx, vy) m/s from t0 to t1 s.

    Examples
    --------
    >>> decision = Decision("wait", "someone crosses from the left", obstacle=3, encounter="crossing-left")
    >>> decision.action, decision.obstacle
    ('wait', 3)
    """

    action: str
    reason: str
    obstacle: int | None = None
    encounter: str = ""
    time_to_closest: float = math.nan
    distance_at_closest: float = math.nan
    local_target: XY | None = None
    path: TimedPath | None = None
    alternatives: Sequence[tuple[str, float]] = ()
    gap: float = math.nan
    guard: str = ""
    pheromone: tuple[int, int, NDArray[np.float32]] | None = None
    history: NDArray[np.float64] | None = field(default=None)
    predicted: NDArray[np.float32] | None = field(default=None)

    def weighed(self) -> list[tuple[str, str]]:
        """Return the alternatives in words, as every table and page shows them: what, and what it costs."""
        return [(name, f"+{cost:.1f} s" if math.isfinite(cost) else "no path found") for name, cost in self.alternatives]


class Policy(Protocol):
    """What steers a robot. One instance plays one episode at a time; `reset` begins each.

    Examples
    --------
    >>> from antway import Command, Decision, load_scenario, run
    >>> class Straight:
    ...     def reset(self, task, seed):
    ...         self.task = task
    ...     def act(self, observation):
    ...         (x, y), (gx, gy) = observation.xy, self.task.goal
    ...         return Command((0.1 * (gx - x), 0.1 * (gy - y)))
    ...     def explain(self):
    ...         return Decision("follow", "straight to the goal, whatever is in between")
    >>> run(load_scenario("office"), Straight(), horizon=1.0).outcome.value
    'timeout'
    """

    def reset(self, task: Task, seed: int) -> None:
        """Forget everything and prepare for `task`."""

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period."""

    def explain(self) -> Decision:
        """Return why the last command was what it was."""


@runtime_checkable
class Foresees(Protocol):
    """A policy that is told where every obstacle will be: only an oracle, which bounds what others can reach, should be."""

    def foresee(self, timeline: Timeline) -> None:
        """Take in where all obstacles will be; comes before `reset`."""


@runtime_checkable
class Plans(Protocol):
    """A policy that tells the motion in use without an explanation."""

    def planned(self) -> TimedPath | None:
        """Return the motion in use, as the explanation would have it."""


def make_policy(name: str, **options: Any) -> Policy:
    """Return a new policy of that name: of `POLICIES`, of the entry points in the group `antway.policies`, or MODULE:CLASS.

    A name may be followed by /OPTION=VALUE as often as needed, in place of keyword options.

    Raises
    ------
    BadParameter
        For an unknown name or option, and an option that is given twice.

    Examples
    --------
    >>> type(make_policy("sipp/predictions=mirrored/margin=0.1")).__name__
    'Sipp'
    """
    if isinstance(name, str) and "/" in name:
        spec, (name, *parts) = name, name.split("/")
        for part in parts:
            key, equals, text = part.partition("=")
            if not key.isidentifier() or not equals or key in options:
                raise BadParameter("policy", spec, "NAME or MODULE:CLASS, then /OPTION=VALUE once for each option")
            try:
                options[key] = ast.literal_eval(text)
            except (ValueError, SyntaxError):
                options[key] = text
    kind = find("policy", name, POLICIES, "antway.policies")
    try:
        parameters = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):
        raise BadParameter("policy", name, "a class, or a function that returns a policy") from None
    known = [p.name for p in parameters if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD)]
    if not any(p.kind is p.VAR_KEYWORD for p in parameters):
        for key, value in options.items():
            if key not in known:
                raise BadParameter(key, value, f"left out: the options of policy {name} are {', '.join(known) or 'none'}")
    for p in parameters:
        if p.kind in (p.KEYWORD_ONLY, p.POSITIONAL_OR_KEYWORD) and p.default is p.empty and p.name not in options:
            raise BadParameter(p.name, None, f"given: policy {name} needs this option")
    try:
        return cast(Policy, kind(**options))
    except TypeError as error:
        raise BadParameter("policy", name, f"a policy, with options that it can take; {error}") from None
