"""How obstacles move: each motion, with random draws and a horizon, gives a piecewise linear trajectory.

A *span* is a number, or a pair (low, high) from which the seed of an episode draws a number uniformly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, BadScenario
from antway.grid import Grid
from antway.kernels.base.rng import make_state, uniform
from antway.kernels.robot.motions import bounce
from antway.limits import MAX_ANGLE, MAX_PLACE, MAX_SPEED, MAX_TIME, MIN_SPEED
from antway.world.policy import XY
from antway.world.timeline import Trajectory

Span = float | tuple[float, float]

MAX_KNOTS = 100_000  # limit of knots of an obstacle


class Draw:
    """Random draws of one obstacle in one episode: stream `index` of the episode's seed."""

    def __init__(self, seed: int, index: int) -> None:
        self.state = make_state(seed, index)

    def of(self, span: Span) -> float:
        """Return `span` if it is a number, else a number drawn from it."""
        if isinstance(span, tuple):
            return span[0] + (span[1] - span[0]) * float(uniform(self.state))
        return span


class Motion(Protocol):
    """The motion of an obstacle."""

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        """Return the trajectory of a disc of `radius` m from 0 to at least `horizon` s, or until it stands for good."""


@dataclass(frozen=True, slots=True)
class Line:
    """Straight from `start` to `end` (m) at `speed` (m/s) after `delay` (s); the obstacle stands before and after."""

    start: XY
    end: XY
    speed: Span
    delay: Span = 0.0

    def __post_init__(self) -> None:
        _points(self, "start", "end")
        _spans(self, speed="m/s", delay="s")

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        speed, delay = draw.of(self.speed), draw.of(self.delay)
        arrival = delay + math.dist(self.start, self.end) / speed if speed else delay
        if arrival == delay:  # also if rounding alone tells start and end apart
            return _standing(self.start)
        return np.array([delay, arrival]), np.array([self.start, self.end])


@dataclass(frozen=True, slots=True)
class BackAndForth:
    """Back and forth between `start` and `end` (m) at `speed` (m/s), starting at the share `phase` of a round trip."""

    start: XY
    end: XY
    speed: Span
    phase: Span = 0.0

    def __post_init__(self) -> None:
        _points(self, "start", "end")
        _spans(self, speed="m/s", phase="")

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        return Waypoints((self.start, self.end), self.speed, phase=self.phase).trajectory(draw, horizon, grid, radius)


@dataclass(frozen=True, slots=True)
class Waypoints:
    """Along `points` (m) at `speed` (m/s), with `pause` s at each; in a loop for ever, or once without `loop`.

    A loop starts at the fraction `phase` in [0, 1] of the time of a round, in which pauses count.
    """

    points: tuple[XY, ...]
    speed: Span
    loop: bool = True
    pause: Span = 0.0
    phase: Span = 0.0

    def __post_init__(self) -> None:
        _track(self)
        if not isinstance(self.loop, bool):
            raise BadParameter("loop", self.loop, "true or false")
        _spans(self, speed="m/s", pause="s", phase="")

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        speed, pause, phase = draw.of(self.speed), draw.of(self.pause), draw.of(self.phase)
        stops = np.array(self.points)
        if self.loop:
            stops = np.vstack((stops, stops[:1]))
        legs = np.hypot(*np.diff(stops, axis=0).T)
        if speed == 0.0 or legs.sum() == 0.0:
            return _standing(self.points[0])
        # Each leg consists of a drive and a pause at its end.
        durations = np.column_stack((legs / speed, np.full(len(legs), pause))).ravel()
        t = np.concatenate(([0.0], np.cumsum(durations)))
        xy = np.vstack((stops[:1], np.repeat(stops[1:], 2, axis=0)))
        if self.loop:
            period = t[-1]
            rounds = math.ceil(min(horizon / period, MAX_KNOTS)) + 1
            if rounds * (len(t) - 1) > MAX_KNOTS:
                raise BadScenario("speed", speed, f"such that the path has at most {MAX_KNOTS} knots")
            t = np.concatenate((t[:1], *(t[1:] + i * period for i in range(rounds))))
            xy = np.vstack((xy[:1], *[xy[1:]] * rounds))
            t, xy = _from((t, xy), phase * period)
        keep = np.concatenate(([True], np.diff(t) > 0))
        return t[keep], xy[keep]


@dataclass(frozen=True, slots=True)
class Bounce:
    """From `start` (m) at `speed` (m/s) in the direction `heading` (rad), reflected at walls and at the map's edges."""

    start: XY
    speed: Span
    heading: Span = (-math.pi, math.pi)

    def __post_init__(self) -> None:
        _points(self, "start")
        _spans(self, speed="m/s")
        _spans(self, low=-math.inf, heading="rad")

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        return _bounce(self.start, draw.of(self.speed), draw.of(self.heading), math.inf, draw, horizon, grid, radius)


@dataclass(frozen=True, slots=True)
class RandomWalk:
    """As `Bounce`, with a new direction at random every `turn_every` s."""

    start: XY
    speed: Span
    turn_every: Span = 3.0
    heading: Span = (-math.pi, math.pi)

    def __post_init__(self) -> None:
        _points(self, "start")
        _spans(self, speed="m/s")
        _spans(self, low=1e-3, turn_every="s")
        _spans(self, low=-math.inf, heading="rad")

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        speed, heading, every = draw.of(self.speed), draw.of(self.heading), draw.of(self.turn_every)
        return _bounce(self.start, speed, heading, every, draw, horizon, grid, radius)


@dataclass(frozen=True, slots=True)
class Replay:
    """A recorded track: it is at `points[i]` (m) at `t[i]` (s, increasing), and stands before and after.

    The record itself may start later than the first point, at the time `record_start` > 0 (s) of the episode; earlier points
    only say where the disc comes from. If its centre is then within 1 m of the robot's, it is absent until it is farther away
    (`antway.world.entries`).
    """

    t: tuple[float, ...]
    points: tuple[XY, ...]
    record_start: float = 0.0
    arrays: Trajectory = field(init=False, repr=False, compare=False)  # `t` and `points` as arrays

    def __post_init__(self) -> None:
        _track(self)
        t = checks.array("t", self.t, (len(self.points),))
        if (np.diff(t) <= 0).any():
            raise BadParameter("t", float(t[int(np.argmax(np.diff(t) <= 0)) + 1]), "increasing (s)")
        checks.number("t", float(t[np.abs(t).argmax()]), low=-MAX_TIME, high=MAX_TIME, unit="s")
        with np.errstate(divide="ignore", over="ignore"):
            speeds = np.hypot(*np.diff(np.array(self.points), axis=0).T) / np.diff(t)
        checks.number("points", float(speeds.max(initial=0.0)), high=MAX_SPEED, infinite=True, unit="m/s between two of them")
        checks.fields(self, "record_start", low=-MAX_TIME, high=MAX_TIME, unit="s")
        object.__setattr__(self, "t", tuple(t.tolist()))
        object.__setattr__(self, "arrays", (t, np.array(self.points)))

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        return self.arrays


@dataclass(frozen=True, slots=True)
class Pursue:
    """From `start` (m) straight towards the present place of the robot, at `speed` (m/s), after `delay` s for `follow_time` s.

    It keeps `gap` m between its edge and the robot's, so it never runs into a standing robot, and it slides along walls. As its
    trajectory depends on the robot, it is not known beforehand: `trajectory` is that of standing at the start, and an episode
    extends the true one period by period.
    """

    start: XY
    speed: Span
    gap: Span = 0.3
    delay: Span = 0.0
    follow_time: Span = 20.0

    def __post_init__(self) -> None:
        _points(self, "start")
        _spans(self, speed="m/s", gap="m", delay="s", follow_time="s")

    def drawn(self, draw: Draw) -> tuple[float, float, float, float]:
        """Return speed, gap, delay and time of following, drawn for an episode."""
        return draw.of(self.speed), draw.of(self.gap), draw.of(self.delay), draw.of(self.follow_time)

    def trajectory(self, draw: Draw, horizon: float, grid: Grid, radius: float) -> Trajectory:
        return _standing(self.start)


MOTIONS: dict[str, type[Line | BackAndForth | Waypoints | Bounce | RandomWalk | Replay | Pursue]] = {
    "line": Line,
    "back-and-forth": BackAndForth,
    "waypoints": Waypoints,
    "bounce": Bounce,
    "random-walk": RandomWalk,
    "replay": Replay,
    "pursue": Pursue,
}


def _bounce(
    start: XY, speed: float, heading: float, turn_every: float, draw: Draw, horizon: float, grid: Grid, radius: float
) -> Trajectory:
    row, col = grid.to_points(start)[0].tolist()
    scale = grid.resolution
    size = 256
    started = draw.state.copy()
    while True:
        t, rc = np.empty(size), np.empty((size, 2))
        draw.state[:] = started
        n = bounce(grid.blocked, row, col, speed / scale, heading, radius / scale, turn_every, horizon, draw.state, t, rc)
        if n <= size:
            return t[:n], grid.to_xy(rc[:n])
        if size > MAX_KNOTS:
            allowed = (
                f"such that the path has at most {MAX_KNOTS} knots, or walls farther apart than the disc, {2 * radius:g} m"
            )
            raise BadScenario("speed", speed, allowed)
        size *= 8


def _standing(place: XY) -> Trajectory:
    return np.zeros(1), np.array([place])


def place_at(trajectory: Trajectory, when: float) -> NDArray[np.float64]:
    """Return where a trajectory is at the time `when`, float64[2], m."""
    t, xy = trajectory
    return np.array([np.interp(when, t, xy[:, 0]), np.interp(when, t, xy[:, 1])])


def _from(trajectory: Trajectory, since: float) -> Trajectory:
    """Cut off everything before the time `since`, which becomes 0."""
    t, xy = trajectory
    i = int(np.searchsorted(t, since * (1 + 1e-12), side="right"))  # not a knot at that time but for rounding
    return np.concatenate(([0.0], t[i:] - since)), np.vstack((place_at(trajectory, since), xy[i:]))


def _points(motion: object, *names: str) -> None:
    """Check these places of a motion."""
    for name in names:
        place = checks.point(name, getattr(motion, name))
        for i, part in enumerate(place):
            checks.number(f"{name}[{i}]", part, low=-MAX_PLACE, high=MAX_PLACE, unit="m")
        object.__setattr__(motion, name, place)


def _track(motion: Waypoints | Replay) -> None:
    """Check the places `points` of a motion."""
    points = checks.array("points", motion.points, (None, 2), low=-MAX_PLACE, high=MAX_PLACE, unit="m")
    if not 1 <= len(points) <= MAX_KNOTS:
        raise BadParameter("points.length", len(points), f"in [1, {MAX_KNOTS}]")
    object.__setattr__(motion, "points", tuple(map(tuple, points.tolist())))


_MOST = {"m/s": MAX_SPEED, "s": MAX_TIME, "m": MAX_PLACE, "rad": MAX_ANGLE, "": 1.0}  # largest number of each unit; "": a phase


def _spans(motion: object, *, low: float = 0.0, **units: str) -> None:
    """Check these spans of a motion, given with their units: numbers of at least `low`."""
    for name, unit in units.items():
        span = getattr(motion, name)
        if isinstance(span, (tuple, list, np.ndarray)):
            span = checks.point(name, span)
            for i, end in enumerate(span):
                _number(f"{name}[{i}]", end, low, unit)
            if span[0] > span[1]:
                raise BadParameter(name, span, "a pair (low, high) with low <= high")
        else:
            span = _number(name, span, low, unit)
        object.__setattr__(motion, name, span)


def _number(name: str, value: object, low: float, unit: str) -> float:
    """Return a number of a motion; speeds so small that travel times overflow are refused."""
    number = checks.number(name, value, low=low, high=_MOST[unit], unit=unit)
    if unit == "m/s" and 0.0 < number < MIN_SPEED:
        raise BadParameter(name, number, f"0, or at least {MIN_SPEED:g} ({unit})")
    return number
