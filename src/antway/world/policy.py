"""The contract between a world and a policy: Task and Observation in, Command and Decision out."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadInput, BadParameter, OutOfBounds, described_error
from antway.grid import Grid
from antway.kernels.base.records import RobotState
from antway.kernels.robot.motion import delayed
from antway.limits import MAX_ORIGIN, MAX_PLACE, MAX_SPEED, MAX_STAY
from antway.planning import TimedPath, find
from antway.tables import POLICIES as POLICIES
from antway.world.options import check_options, take_options
from antway.world.robots import RobotSpec as RobotSpec
from antway.world.robots import towards
from antway.world.timeline import Timeline

XY = tuple[float, float]  # m, or m/s
BOUNDS = ("goal_tolerance", "obstacle_speed", "obstacle_surge", "obstacle_swerve")  # of a task, and of a scenario


@dataclass(frozen=True, slots=True)
class Task:
    """What a policy knows before an episode: the map, the robot, start and goal, and bounds on the obstacles' motion.

    Attributes
    ----------
    grid : Grid
        The static map, not inflated; yaw must be 0, and the origin within 1e6 m of 0, as floats are too coarse farther away.
    robot : RobotSpec
    start, goal : (x, y)
        m; the robot's disc must be free of the map's blocked cells at both.
    goal_tolerance : float
        The goal is reached within this distance, m, > 0.
    obstacle_speed : float
        Declared bound on the speed of moving obstacles, m/s, >= 0; the guard's guarantee assumes it.
    obstacle_surge : float
        Declared bound on the growth of an obstacle's speed, m/s^2, >= 0; infinite: it may reach full speed at once.
    obstacle_swerve : float
        Declared bound on the change of an obstacle's velocity vector, m/s^2, >= 0; infinite: it may turn at once. An obstacle
        that touches a wall may always do so. It matters for robots with inertia, and for how far `antway` trusts predictions.
    stay : float
        How long the robot is to stand at the goal, s, in [0, 60]: policy `antway` arrives when the goal is free for that time,
        and if it is more than 0, so slowly that the robot can stand there. With 0, a robot with inertia may brake beyond the
        goal, and comes back.

    Raises
    ------
    BadParameter, OutOfBounds
        `Scenario` and policies check whether the robot has room at start and goal.

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
        if max(map(abs, self.grid.origin[:2])) > MAX_ORIGIN:
            allowed = f"within {MAX_ORIGIN:g} m of 0 in an episode: subtract the map's origin from all places"
            raise BadParameter("grid.origin", self.grid.origin, allowed)
        for name in ("start", "goal"):
            object.__setattr__(self, name, checks.point(name, getattr(self, name)))
            try:
                self.grid.cell_at(getattr(self, name))
            except OutOfBounds as error:
                raise error.at("", name) from None
        checks.fields(self, "goal_tolerance", low=0.0, high=MAX_PLACE, open_low=True, unit="m")
        checks.fields(self, "obstacle_speed", low=0.0, high=MAX_SPEED, unit="m/s")
        checks.fields(self, "obstacle_surge", "obstacle_swerve", low=0.0, infinite=True, unit="m/s^2")
        checks.fields(self, "stay", low=0.0, high=MAX_STAY, unit="s")


@dataclass(frozen=True, slots=True, eq=False)
class Tracks:
    """Sensed moving obstacles: K discs. Lists and arrays of another type or layout are converted to the types below.

    Attributes
    ----------
    id : int64[K]
        An obstacle keeps its id from one observation to the next; a negative one means that the sensor gives none. If an id
        occurs twice, policies and guards treat these tracks as tracks without one.
    xy, velocity : float64[K, 2]
        m, m/s.
    radius : float64[K]
        m, >= 0.
    covariance : float64[K, 4, 4] or None
        Covariance of (x, y, vx, vy), if the sensor is noisy.

    Raises
    ------
    BadParameter
        For anything but numbers. Their ranges are checked where they are used.

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
        # Kernels are compiled for each type and layout of arrays, which takes seconds, so there is only one.
        for name, kind in _TRACKS:
            array = getattr(self, name)
            if array is None and name == "covariance":
                continue
            if type(array) is not np.ndarray or array.dtype is not kind or not array.flags.carray:
                object.__setattr__(self, name, _plain_array(f"tracks.{name}", array, kind))

    def __len__(self) -> int:
        return len(self.id)

    def variances(self, first: int) -> NDArray[np.float64]:
        """Return the larger variance of each track's place (`first` = 0, m^2) or velocity (2, m^2/s^2) over all directions.

        Examples
        --------
        >>> Tracks([7], [[1, 2]], [[0.5, 0]], [0.3], [np.diag([1, 4, 0, 0])]).variances(0).tolist()
        [4.0]
        """
        c = cast(NDArray[np.float64], self.covariance)[:, first : first + 2, first : first + 2]
        a, b = c[:, 0, 0], c[:, 1, 1]
        larger: NDArray[np.float64] = 0.5 * (a + b) + np.hypot(0.5 * (a - b), 0.5 * (c[:, 0, 1] + c[:, 1, 0]))
        return larger

    def distinct(self) -> Tracks:
        """Return these tracks with -1 in place of numbers that occur twice, compared as floats.

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
    """What the robot knows at time `t`: its own state, and the tracks sensed at `stamp` (`t` unless the sensor has a delay).

    Raises
    ------
    BadParameter
        For anything but numbers or pairs of numbers. Their ranges are checked where they are used.

    Examples
    --------
    >>> from antway import Tracks
    >>> Observation(0.0, (1.0, 1.0), (0.5, 0.0), 0.0, Tracks.none()).speed
    0.5
    """

    t: float  # s; after a clock that goes back, the guard brakes until the old time is reached, unless `reset` is called
    xy: XY  # m
    velocity: XY  # m/s
    heading: float  # rad
    tracks: Tracks
    stamp: float = math.nan  # s; NaN: sensed now; at most 0.05 s later than t, else the robot brakes
    turn_rate: float = 0.0  # rad/s
    pending: NDArray[np.float64] | None = None  # float64[ceil(latency / dt), 2]; commands that do not act yet; None: not told

    def __post_init__(self) -> None:
        for name in ("t", "heading", "stamp", "turn_rate"):
            if type(getattr(self, name)) is not float:
                object.__setattr__(self, name, _real(f"observation.{name}", getattr(self, name)))
        for name in ("xy", "velocity"):
            pair = getattr(self, name)
            if type(pair) is not tuple or len(pair) != 2 or type(pair[0]) is not float or type(pair[1]) is not float:
                object.__setattr__(self, name, _pair(f"observation.{name}", pair))
        array = self.pending
        if array is not None and (type(array) is not np.ndarray or array.dtype is not _REAL or not array.flags.carray):
            object.__setattr__(self, "pending", _plain_array("observation.pending", array, _REAL))
        checks.instance("observation.tracks", self.tracks, Tracks)

    @property
    def sensed_at(self) -> float:
        """Time of the tracks, s."""
        return self.t if math.isnan(self.stamp) else self.stamp

    @property
    def speed(self) -> float:
        """Speed along the heading, m/s; negative in reverse."""
        return self.velocity[0] * math.cos(self.heading) + self.velocity[1] * math.sin(self.heading)

    def state_at_action(self, robot: RobotSpec) -> RobotState:
        """Return the robot's state when a command given now begins to act; without wheels, a footprint keeps its heading."""
        one, two = (self.speed, self.turn_rate) if robot.wheels else self.velocity
        state = RobotState(float(self.xy[0]), float(self.xy[1]), float(self.heading), float(one), float(two))
        if robot.latency == 0.0 or self.pending is None:
            return state
        then = delayed(state, self.pending[-robot.late_commands :], robot.limits, robot.dt)
        return then if robot.wheels or robot.footprint is None else then._replace(theta=state.theta)


def _real(field: str, value: object) -> float:
    """Return `value` as a float, which need not be finite."""
    if isinstance(value, (bool, np.bool_)) or not isinstance(value, (numbers.Real, np.number)):
        raise BadParameter(field, value, "a number")
    try:
        return float(value)
    except (OverflowError, TypeError):
        raise BadParameter(field, value, "a number") from None


def _pair(field: str, value: object) -> XY:
    one, two = checks.sequence(field, value, "two numbers", size=2)
    return _real(field, one), _real(field, two)


@dataclass(frozen=True, slots=True)
class Command:
    """What the robot is to do until the next cycle.

    Attributes
    ----------
    velocity : (vx, vy)
        m/s in the world's frame: for holonomic robots, for the dynamics "steps", and for wheels where `twist` is None.
    twist : (v, omega) or None
        For other wheels: speed along the heading in m/s, negative in reverse, and turn rate in rad/s.

    Examples
    --------
    >>> Command(twist=(0.4, -0.2)).twist  # wheels: 0.4 m/s, turning right
    (0.4, -0.2)
    """

    velocity: XY = (0.0, 0.0)
    twist: XY | None = None

    def acts(self, observation: Observation, robot: RobotSpec) -> XY:
        """Return the two numbers that the robot follows: (vx, vy), or for wheels (v, omega).

        For a velocity without a twist, wheels turn towards it, as fast as they can still stop turning there. Meanwhile they
        drive forward with its component along the heading, never backwards. The heading is that at which the command acts.
        """
        if not robot.wheels:
            return self.plain("a robot without wheels")
        return self.twist or towards(self.velocity, observation.state_at_action(robot).theta, robot)

    def plain(self, of: str) -> XY:
        """Return the velocity, which alone counts for a robot of a kind; a twist without one is refused."""
        if self.twist and any(self.twist) and not any(self.velocity):
            raise BadParameter("command.twist", self.twist, f"left out for {of}, which takes a velocity")
        return self.velocity


def commanded(one: float, two: float, heading: float, robot: RobotSpec) -> Command:
    """Return the command (vx, vy), or for wheels with that heading in rad the twist (v, omega)."""
    if not robot.wheels:
        return Command((one, two))
    turned = heading + two * robot.dt if robot.stepwise else heading
    return Command((one * math.cos(turned), one * math.sin(turned)), (one, two))


@dataclass(frozen=True, slots=True, eq=False)
class Decision:
    """The reason of a policy's command in one cycle; every field but the first two may be empty.

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
        Closest approach to that obstacle at present velocities: time, s, and distance of the edges, m; NaN if none.
    local_target : (x, y) or None
        Where the detour ends, m.
    path : TimedPath or None
        The motion planned from here on.
    alternatives : sequence of (name, cost in s)
        Alternatives, and how much later than without obstacles each reaches the goal; infinite if no path was found.
    gap : float
        Certified optimality gap of the choice (0.01 is 1 %), NaN if nothing is certified.
    guard : str
        What the guard did: free, slowed, braked, stepped-aside, least-harm, or empty.
    pheromone : (row0, col0, float32[h, w]) or None
        Pheromone by cell in the window with that corner, for pictures.
    history : float64[C, 4] or None
        For each ant cycle: best length, mean length (m), share of ants that arrived, pheromone entropy (nats).
    predicted : float32[P, 7] or None
        Predicted motions of the tracks, for pictures: rows (t0, t1, x, y, vx, vy, radius), each a disc of `radius` m that moves
        uniformly from (x, y) m with (vx, vy) m/s from t0 to t1 s.

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
    history: NDArray[np.float64] | None = None
    predicted: NDArray[np.float32] | None = None

    def weighed(self) -> list[tuple[str, str]]:
        """Return the alternatives in words, as tables and pages show them: the name, and the cost."""
        return [(name, f"+{cost:.1f} s" if math.isfinite(cost) else "no path found") for name, cost in self.alternatives]


@runtime_checkable
class Policy(Protocol):
    """What steers a robot. An instance plays one episode at a time; `reset` starts each.

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
        """Forget everything, and prepare for `task`."""

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period."""

    def explain(self) -> Decision:
        """Return the reason of the last command."""


@runtime_checkable
class Foresees(Protocol):
    """A policy that knows where every obstacle will be, which only an oracle should, as a bound for other policies."""

    def foresee(self, timeline: Timeline) -> None:
        """Receive where all obstacles will be; called before `reset`."""


@runtime_checkable
class Plans(Protocol):
    """A policy that returns its planned motion without an explanation."""

    def planned(self) -> TimedPath | None:
        """Return the planned motion, the same as in the explanation."""


def as_policy(policy: object) -> Policy:
    """Return `policy` if it is one."""
    if isinstance(policy, type) or not isinstance(policy, Policy):
        raise BadParameter("policy", policy, "a policy with the methods reset, act and explain, an instance and no class")
    return policy


def make_policy(name: str, **options: Any) -> Policy:
    """Return a new policy: a name of `POLICIES`, of an entry point in the group `antway.policies`, or MODULE:CLASS.

    Options may also follow the name as /OPTION=VALUE.

    Raises
    ------
    BadParameter
        For an unknown name or option, an option that is given twice, and a policy that cannot be imported or made.

    Examples
    --------
    >>> type(make_policy("sipp/predictions=mirrored/margin=0.1")).__name__
    'Sipp'
    """
    if isinstance(name, str) and "/" in name:
        name = take_options(name, options)
    kind = find("policy", name, POLICIES, "antway.policies")
    check_options(name, kind, options)
    try:
        return as_policy(kind(**options))
    except BadInput:
        raise
    except (Exception, SystemExit) as error:  # whatever a policy raises
        raise BadParameter("policy", name, f"a policy, with options that it can take; {described_error(error)}") from error
