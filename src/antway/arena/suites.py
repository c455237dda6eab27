"""Suites of episodes: worlds drawn from seeds that depend only on the episode's name, so that suites are independent."""

from __future__ import annotations

import hashlib
import importlib
import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TypeVar, overload

import numpy as np
import scipy

from antway import checks
from antway.baselines.oracle import paths_to_goal
from antway.baselines.replan import arrival_time, searches_for
from antway.errors import BadParameter, CellBlocked
from antway.kernels.base.rng import below, make_state, uniform
from antway.kernels.baselines.oracle import first_contact
from antway.tables import OF_FILES, SUITES, names
from antway.world.motions import Pursue
from antway.world.robots import ROBOTS, RobotSpec, load_robot
from antway.world.scenario import Scenario
from antway.world.terrain import terrain_of

T = TypeVar("T")
_ON = " on "  # separates the names of suite and robot
_TRIES = 100  # limit of worlds drawn for a robot that does not fit into the first one
SAMPLES = 200  # number of robots at constant velocity that measure how difficult an episode is
DRIVE = 5.0  # s; how long these robots drive


def seed_of(*parts: object) -> int:
    """Return a seed in [0, 2**63) from these parts, by a hash that is the same on every machine.

    Examples
    --------
    >>> seed_of("synthetic", "open/low", 0) == seed_of("synthetic", "open/low", 0) != seed_of("synthetic", "open/low", 1)
    True
    """
    text = "\0".join(map(str, parts)).encode()
    return int.from_bytes(hashlib.blake2b(text, digest_size=8).digest(), "big") >> 1


def content_hash(*files: str | Path) -> str:
    """Return eight hexadecimal digits that tell the contents of these files, for names in tables."""
    return hashlib.blake2b(b"".join(Path(file).read_bytes() for file in files), digest_size=4).hexdigest()


class Chance:
    """A stream of random choices from a seed."""

    def __init__(self, seed: int) -> None:
        self.state = make_state(seed, 0)

    def between(self, low: float, high: float) -> float:
        """Return a number drawn uniformly from [low, high)."""
        return low + (high - low) * float(uniform(self.state))

    def integer(self, low: int, high: int) -> int:
        """Return an integer drawn uniformly from [low, high)."""
        return low + int(below(self.state, high - low))

    def turn(self) -> float:
        """Return a direction, rad."""
        return self.between(-math.pi, math.pi)


@dataclass(frozen=True, slots=True)
class Suite:
    """A named family of scenarios, each of a group."""

    name: str  # part of every episode's key; for a suite from a file it depends on the file's content
    groups: tuple[str, ...]  # kinds of episode that are counted together, "kind/level" if a kind has several levels
    make: Callable[[str, Chance], Scenario]
    default: int = 100  # number of episodes of each group, unless another is given
    lasting: Callable[[str, Chance, float], Scenario] | None = None  # for so many times the horizon of `make`, if that differs


@dataclass(frozen=True, slots=True)
class SuiteEpisode:
    """One episode of a suite: `spec` is the argument of `load_suite`, and `suite`, `group` and `number` identify the episode.

    A `robot` (a name or a file) replaces the robot of the suite; then `suite` ends in " on " and its name. The world and all
    randomness are those of the suite. An episode made by hand whose name leaves the robot out has a world of its own.
    """

    spec: str
    suite: str
    group: str
    number: int
    robot: str = ""

    @property
    def name(self) -> str:
        """The episode's name within its suite."""
        return f"{self.group}/{self.number:04d}"

    @property
    def seed(self) -> int:
        """The seed of all randomness: world, sensor and policy."""
        return seed_of(self.own_suite, self.group, self.number)

    @property
    def own_suite(self) -> str:
        """The name of the suite without that of the robot."""
        return self.suite.rpartition(_ON + Path(self.robot).stem)[0] if self.robot else self.suite


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts about an episode that do not depend on policies.

    The bound is the clairvoyant optimum: the arrival time of SIPP (32 directions, known future) within the goal's tolerance;
    infinite if it does not arrive in time, NaN if an obstacle follows the robot, so that the future is unknown. Difficulty is
    the share of 200 robots with random starts and constant velocities at full speed that touch nothing for 5 s: a low share
    means a difficult episode.
    """

    bound: float  # s
    shortest: float  # m; length of the shortest path of the same moves without obstacles, up to the goal's tolerance
    difficulty: float


class LazySequence(Sequence[T]):
    """A sequence whose items are made when they are asked for, since a million of them would fill the memory."""

    def __init__(self, make: Callable[[int], T], places: range) -> None:
        self.make, self.places = make, places

    def __len__(self) -> int:
        return len(self.places)

    @overload
    def __getitem__(self, index: int) -> T: ...
    @overload
    def __getitem__(self, index: slice) -> LazySequence[T]: ...
    def __getitem__(self, index: int | slice) -> T | LazySequence[T]:
        if isinstance(index, slice):
            return LazySequence(self.make, self.places[index])
        return self.make(self.places[index])


def load_suite(spec: str) -> Suite:
    """Return the suite that `spec` names: a name of `SUITES`, or maps:FILE, tracks:FILE.

    Raises
    ------
    BadParameter
        If the suite is unknown, or its file is missing.
    BadMap, BadScenario
        If the file cannot be read.
    """
    name, _, argument = checks.instance("suite", spec, str).partition(":")
    if name not in SUITES:
        raise BadParameter("suite", spec, f"one of {names(SUITES)} (on the command line also predict, ants)")
    if (name in OF_FILES) != bool(argument):
        raise BadParameter("suite", spec, f"{name}:FILE" if not argument else f"{name}, which takes no file")
    module, _, attribute = SUITES[name].partition(":")
    make = getattr(importlib.import_module(module), attribute)
    suite: Suite = make(argument) if argument else make()
    return suite


def episodes(spec: str, count: int | None = None, robot: str = "") -> LazySequence[SuiteEpisode]:
    """Return the first `count` episodes of each group (None: the default of the suite), ordered by number, then group.

    `robot`, a name or a file (`antway.world.robots.load_robot`), replaces the robot of the suite.

    Examples
    --------
    >>> [episode.name for episode in episodes("synthetic", 1)][:2]
    ['open/low/0000', 'open/medium/0000']
    """
    suite = load_suite(spec)
    checks.instance("robot", robot, str)
    count = suite.default if count is None else checks.integer("episodes", count, low=1, high=1_000_000)
    name = _named(suite, robot)
    groups = suite.groups

    def made(place: int) -> SuiteEpisode:
        number, group = divmod(place, len(groups))
        return SuiteEpisode(spec, name, groups[group], number, robot)

    return LazySequence(made, range(count * len(groups)))


@lru_cache(maxsize=4)
def _suite(spec: str, name: str) -> Suite:
    """Return the suite that `spec` names; it is read again if its file has changed since, and so its name."""
    return load_suite(spec)


def _named(suite: Suite, robot: str) -> str:
    """Return the name of a suite for its own robot, or for `robot`, a name or a file."""
    return suite.name + (f"{_ON}{robot_name(robot)}" if robot else "")


def robot_name(robot: str) -> str:
    """Return the name of a robot in tables: its own, or that of its file with part of a hash of the content."""
    spec = load_robot(robot)
    return robot if robot in ROBOTS else f"{Path(robot).stem}:{seed_of(spec) % 16**8:08x}"


def build(episode: SuiteEpisode) -> Scenario:
    """Return the scenario of an episode.

    A robot that is larger than that of the suite gets the first drawn world in which it fits at both ends and has a path.

    Raises
    ------
    BadParameter
        If there is none among a hundred, or the file of the suite or robot is another than when the episode got its name.
    """
    suite = _suite(episode.spec, episode.own_suite)
    checks.choice("group", episode.group, suite.groups)
    now = _named(suite, episode.robot)
    if episode.own_suite and now != episode.suite:  # whoever makes an episode by hand may leave the robot out of its name
        raise BadParameter("suite", now, f"{episode.suite}, for which this episode was made; a file has changed since")
    return drawn(suite, episode.group, episode.seed, load_robot(episode.robot) if episode.robot else None)


def drawn(suite: Suite, group: str, seed: int, robot: RobotSpec | None) -> Scenario:
    """Return the scenario that is drawn from a seed, or the first that a larger robot fits into; it raises as `build` does."""
    scenario = suite.make(group, Chance(seed))
    if robot is None:
        return scenario
    own = scenario.robot
    for attempt in range(_TRIES):
        since = seed_of(seed, attempt - 1) if attempt else seed
        if suite.lasting is not None and robot.v_max < own.v_max:
            scenario = suite.lasting(group, Chance(since), own.v_max / robot.v_max)
        elif attempt:
            scenario = suite.make(group, Chance(since))
        with suppress(CellBlocked):
            driven = scenario.driven_by(robot)
            if robot.radius <= own.radius or _connected(driven, seed):
                return driven
    raise BadParameter("robot", f"{robot.radius:g} m in radius", f"one that has room in a world of {suite.name}, {group}")


def _connected(scenario: Scenario, seed: int) -> bool:
    """Tell whether the robot has a path from start to goal on the map, and no obstacle starts too near with that seed."""
    world, radius = scenario.world, scenario.robot.radius
    regions, _ = scipy.ndimage.label(~world.grid.inflate(radius).blocked)
    start, goal = (regions[world.grid.cell_at(end)] for end in (scenario.start, scenario.goal))
    at_start = world.timeline(seed, 1.0).places(np.zeros(1))[0].tolist()
    clear = all(math.dist(at, scenario.start) > radius + one.radius for at, one in zip(at_start, world.obstacles))
    return bool(start == goal != 0) and clear


@lru_cache(maxsize=8)
def stage(episode: SuiteEpisode) -> tuple[Scenario, Facts]:
    """Return the scenario of an episode and the facts about it."""
    scenario = build(episode)
    return scenario, facts(scenario, episode.seed)


def facts(scenario: Scenario, seed: int) -> Facts:
    """Return the facts about a scenario with the given seed."""
    task, robot = scenario.task, scenario.robot
    timeline = scenario.world.timeline(seed, scenario.horizon)
    searches = searches_for(task)
    end = math.ceil(scenario.horizon / robot.dt - 1e-9) * robot.dt  # of the last control period, as in an episode
    paths = (paths_to_goal(task, searches, known, horizon=end)[0] for known in (timeline, None))
    arrival, shortest = (arrival_time(path, task) for path in paths)
    follows = any(isinstance(one.motion, Pursue) for one in scenario.world.obstacles)
    return Facts(
        bound=math.nan if follows else arrival if arrival <= end else math.inf,
        shortest=shortest * robot.v_max,
        difficulty=_difficulty(scenario, seed),
    )


def _difficulty(scenario: Scenario, seed: int) -> float:
    """Return the share of random robots at constant velocity that touch nothing in `DRIVE` s."""
    task, robot = scenario.task, scenario.robot
    chance = Chance(seed_of("survival", seed))  # this word is part of the seed and must not change
    inflated = task.grid.inflate(robot.radius)
    free = inflated.to_xy(np.argwhere(~inflated.blocked))
    trajectories, terrain = scenario.world.timeline(seed, DRIVE).trajectories, terrain_of(task.grid)
    times, alive = np.array([0.0, DRIVE]), 0
    for _ in range(SAMPLES):
        angle = chance.turn()
        start = free[chance.integer(0, len(free))]
        end = start + np.array([math.cos(angle), math.sin(angle)]) * robot.v_max * DRIVE
        alive += first_contact(times, np.array([start, end]), robot.radius, terrain, trajectories) == math.inf
    return alive / SAMPLES
