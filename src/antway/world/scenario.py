"""A scenario: a world, a robot, and its start and goal; also as a TOML file."""

from __future__ import annotations

import io
import math
import warnings
from dataclasses import dataclass, field, fields, replace
from itertools import chain
from os import PathLike
from os.path import isfile, lexists
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadInput, BadParameter, BadScenario, TooLarge
from antway.grid import Grid
from antway.limits import MAX_PLACE, MAX_TIME
from antway.maps import load_map, save_map
from antway.reading import opened, read_toml_file
from antway.scenes import shipped
from antway.tables import SHIPPED_SCENES, names
from antway.world.line_of_sight import check_clear
from antway.world.motions import MAX_KNOTS, MOTIONS, Replay
from antway.world.policy import BOUNDS, XY, RobotSpec, Task
from antway.world.robots import check_keys, from_table, load_robot, robot_of
from antway.world.sensor import Sensor
from antway.world.stops import Stop, checked_stops
from antway.world.world import MAX_OBSTACLES, Obstacle, World, refuse_through_walls
from antway.writing import writing

MAX_STEPS = 1_000_000
MAX_BYTES = 16 * 2**20


@dataclass(frozen=True, slots=True)
class Scenario:
    """A world, a robot and its task.

    Parameters
    ----------
    world : World
    start, goal : (x, y)
        m; the robot's disc must be clear of blocked cells and of the map's edges at both.
    robot : RobotSpec
    sensor : Sensor
    horizon : float
        Latest end of the episode, s, > 0. A control period that it falls into is driven to its end, and a goal reached by then
        counts.
    seed : int
        Default seed of `run`.
    goal_tolerance : float
        The goal is reached within this distance, m, > 0.
    obstacle_swerve : float
        Declared bound on the change of the obstacles' velocity vectors, away from walls, m/s^2, >= 0, may be infinite.
    obstacle_speed : float
        Declared bound on the obstacles' speed, m/s, in [0, 1000].
    obstacle_surge : float
        Declared bound on the growth of their speed, m/s^2, >= 0, may be infinite.
    name : str
    map : str
        The map's file as named in the scenario file; empty for a world made in Python.
    stops : tuple of Stop
        Stops that the robot visits in the best order before it goes to the goal; see `antway.world.rounds`.
    through_walls : bool
        Whether obstacles may start in walls and move through them; otherwise such obstacles are refused. They may always leave
        the map.

    Raises
    ------
    BadParameter, BadScenario, OutOfBounds, CellBlocked, TooLarge

    Examples
    --------
    >>> import numpy as np
    >>> from antway import Grid, World
    >>> scenario = Scenario(World(Grid(np.zeros((40, 60), bool), 0.1)), (1.0, 1.0), (5.0, 3.0))
    >>> scenario.task.goal
    (5.0, 3.0)
    """

    world: World
    start: XY
    goal: XY
    robot: RobotSpec = field(default_factory=RobotSpec)
    sensor: Sensor = field(default_factory=Sensor)
    horizon: float = 60.0
    seed: int = 0
    goal_tolerance: float = 0.2
    obstacle_speed: float = 1.5
    obstacle_surge: float = math.inf
    obstacle_swerve: float = math.inf
    name: str = "scenario"
    map: str = ""
    stops: tuple[Stop, ...] = ()
    through_walls: bool = False
    task: Task = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        set_ = object.__setattr__
        checks.instance("world", self.world, World)
        checks.instance("sensor", self.sensor, Sensor)
        checks.fields(self, "horizon", low=0.0, high=MAX_TIME, open_low=True, unit="s")
        set_(self, "seed", checks.seed(self.seed))
        for text in ("name", "map"):
            checks.instance(text, getattr(self, text), str)
        ends = (self.start, self.goal, self.goal_tolerance)
        task = Task(self.world.grid, self.robot, *ends, self.obstacle_speed, self.obstacle_surge, self.obstacle_swerve)
        set_(self, "task", task)
        for name in BOUNDS:
            set_(self, name, getattr(task, name))
        if self.horizon / self.robot.dt > MAX_STEPS:
            raise TooLarge("horizon", self.horizon, f"at most {MAX_STEPS} control periods")
        for end in ("start", "goal"):
            set_(self, end, getattr(task, end))
            check_clear(task, end, getattr(task, end))
        set_(self, "stops", checked_stops(self.stops, task))
        if not checks.instance("through_walls", self.through_walls, bool):
            refuse_through_walls(self.world, self.seed, self.horizon)

    def driven_by(self, robot: RobotSpec) -> Scenario:
        """Return the same scenario for another robot; a slower robot gets more time.

        Raises
        ------
        CellBlocked
            If it has no room at start or goal.
        """
        checks.instance("robot", robot, RobotSpec)
        return replace(self, robot=robot, horizon=self.horizon * max(self.robot.v_max / robot.v_max, 1.0))


_PLAIN = ("name", "map", "start", "goal", *BOUNDS, "horizon", "seed", "through_walls")
_TOP = (*_PLAIN, "resolution", "occupied", "top_first", "robot", "sensor", "obstacles", "stops")


def load_scenario(path: str | Path) -> Scenario:
    """Read a scenario from a TOML file, or a shipped scene: "paper", "office", "warehouse" or "rounds".

    Keys are the fields of `Scenario`. The tables `[robot]` and `[sensor]` have the fields of `RobotSpec` and `Sensor`. Each
    `[[obstacles]]` has `radius`, `motion` (line, back-and-forth, waypoints, bounce, random-walk, replay, pursue) and the fields
    of that motion (`antway.world.motions`). Each `[[stops]]` has the fields of `antway.world.stops.Stop`. `map` is a file in
    the folder of the scenario or below; so is the `file` of a replay, with CSV lines t,x,y. `resolution` is the edge of a cell
    in m, for maps that do not store it; `occupied` is the cost from which a cell of a ROS map is blocked. `top_first` says
    whether pages and figures show row 0 on top (`Grid.top_first`), if not as `load_map` has it. A map whose yaw is not 0 is
    turned (`Grid.turned`).

    `robot` is a table, or the name of a robot that antway knows (`antway.world.robots.ROBOTS`). Instead of `radius` a robot may
    have a `footprint`, a list of corners [x, y] in m relative to its centre of rotation. Guard and contact tests use the turned
    footprint. Planning uses the disc around it, which is safe for any heading but misses paths that need a certain heading;
    policy `antway` then plans for a smaller disc, and passes such places lengthwise, or where a robot that cannot turn fits
    through in the heading that it has.

    Raises
    ------
    BadScenario
        If the file is not TOML, or parts are missing, unknown, not tables, or name files that do not exist.
    BadMap, BadParameter, OutOfBounds, CellBlocked, TooLarge
        As raised by `load_map`, `Scenario` and its parts; the error names the file, the table and the key.
    """
    if not isinstance(path, (str, PathLike)):
        raise BadScenario("path", path, "a path")
    path = shipped(path) or Path(path)
    if not isfile(path):
        raise BadScenario("scenario", str(path), f"an existing regular file, or a shipped scene: {names(SHIPPED_SCENES)}")
    return _scenario(read_toml_file(path, MAX_BYTES, "scenario"), path.parent, str(path))


def _scenario(record: dict[str, Any], folder: Path, where: str) -> Scenario:
    values = dict(record)
    robot = _robot(values.pop("robot", {}), where)  # first: keys of the scenario that stand below [robot] are named so
    sensor = from_table("sensor", Sensor, values.pop("sensor", {}), where)
    check_keys(record, "", _TOP, ("map", "start", "goal"), where)
    size = {name: values.pop(name) for name in ("resolution", "occupied") if name in values}
    shown = {name: values.pop(name) for name in ("top_first",) if name in values}
    map_file = _file_below(values["map"], "map", folder, where)
    listed = values.pop("obstacles", [])
    if not isinstance(listed, list):
        raise BadScenario("obstacles", listed, "a list of tables [[obstacles]]", where=where)
    if len(listed) > MAX_OBSTACLES:
        raise TooLarge("obstacles.length", len(listed), f"at most {MAX_OBSTACLES}", where=where)
    obstacles = tuple(_obstacle(f"obstacles[{k}]", one, folder, where) for k, one in enumerate(listed))
    visits = values.pop("stops", [])
    if not isinstance(visits, list):
        raise BadScenario("stops", visits, "a list of tables [[stops]]", where=where)
    stops = tuple(from_table(f"stops[{k}]", Stop, one, where) for k, one in enumerate(visits))
    try:
        world = World(replace(load_map(map_file, **size).turned(), **shown), obstacles)
        return Scenario(world=world, robot=robot, sensor=sensor, stops=stops, **values)
    except BadInput as error:
        raise error if error.where else error.at(where) from None


def _robot(value: object, where: str) -> RobotSpec:
    """Return the robot given by a name or a table."""
    if isinstance(value, str):
        try:
            return load_robot(value)
        except BadInput as error:
            raise error.at(where) from None
    return robot_of(value, where)


def _obstacle(name: str, record: object, folder: Path, where: str) -> Obstacle:
    if not isinstance(record, dict):
        raise BadScenario(name, record, "a table", where=where)
    values = dict(record)
    check_keys(values, name, tuple(values), ("radius", "motion"), where)
    given = values.pop("radius")
    radius = checks.number(f"{name}.radius", given, low=0, high=MAX_PLACE, open_low=True, unit="m", where=where)
    kind = MOTIONS[checks.choice(f"{name}.motion", values.pop("motion"), MOTIONS, where=where)]
    if kind is Replay and "file" in values:
        check_keys(values, name, ("file",), (), where)
        file = _file_below(values["file"], f"{name}.file", folder, where)
        table = _read_csv(file, f"{name}.file", where)
        if table.ndim != 2 or table.shape[1] != 3:
            raise BadScenario(f"{name}.file", table.shape, "CSV lines t,x,y in s and m", where=where)
        values = {"t": table[:, 0], "points": table[:, 1:]}
    return Obstacle(radius, from_table(name, kind, values, where))


def _read_csv(file: Path, name: str, where: str) -> NDArray[np.float64]:
    """Read CSV lines of numbers from a plain text file, which `np.loadtxt` must not unpack because of its suffix."""
    with opened(file, MAX_BYTES, error=BadScenario, field=name) as (lines, _), warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about files without lines, whose shape is refused later
        try:
            rows = (line for line in io.TextIOWrapper(lines, encoding="utf-8-sig") if line.partition("#")[0].strip())
            first = next(rows, "")
            heading = first.partition("#")[0].replace(" ", "").strip().lower() == "t,x,y"
            return np.loadtxt(rows if heading else chain((first,), rows), delimiter=",", ndmin=2, max_rows=MAX_KNOTS + 1)
        except ValueError as error:
            raise BadScenario(name, str(error), "CSV lines t,x,y in s and m", where=where) from None


def _file_below(value: object, name: str, folder: Path, where: str) -> Path:
    """Return the file `value` in `folder` or below; links that lead out of it are refused."""
    allowed = "the relative path of a file in the scenario's folder or below it"
    if not isinstance(value, str) or not value or "\0" in value or PurePosixPath(value).is_absolute():
        raise BadScenario(name, value, allowed, where=where)
    file = folder / value
    try:
        found = file.resolve().is_relative_to(folder.resolve()) and isfile(file)
    except (OSError, ValueError):  # such as a name longer than a file's may be
        found = False
    if not found:
        missing = " (there is no such file)" if ".." not in file.parts and not lexists(file) else ""
        raise BadScenario(name, value, allowed + missing, where=where)
    return file


def to_toml(scenario: Scenario) -> str:
    """Return `scenario` as the text of a TOML file, every field written out; `load_scenario` reads it back equal."""
    lines = [f"{key} = {_toml(getattr(scenario, key))}" for key in _PLAIN]
    for table in ("robot", "sensor"):
        part = getattr(scenario, table)
        given = {f.name: getattr(part, f.name) for f in fields(part)}
        if given.get("footprint") is not None:
            del given["radius"]
        lines += ["", f"[{table}]", *(f"{name} = {_toml(value)}" for name, value in given.items() if value is not None)]
    names = {kind: name for name, kind in MOTIONS.items()}
    for k, obstacle in enumerate(scenario.world.obstacles):
        kind = type(obstacle.motion)
        if kind not in names:
            raise BadParameter(f"obstacles[{k}].motion", obstacle.motion, f"one of {', '.join(MOTIONS)} to be written")
        lines += ["", "[[obstacles]]", f"radius = {_toml(obstacle.radius)}", f"motion = {_toml(names[kind])}"]
        lines += [f"{f.name} = {_toml(getattr(obstacle.motion, f.name))}" for f in fields(kind) if f.init]
    for stop in scenario.stops:
        lines += ["", "[[stops]]", *(f"{f.name} = {_toml(getattr(stop, f.name))}" for f in fields(stop))]
    return "\n".join(lines) + "\n"


def save_scenario(scenario: Scenario, path: str | Path) -> None:
    """Write `scenario` to `path` and its map beside it, as <name>_map.yaml and .pgm.

    A file of that name that holds the same map already is left alone: it may say more than which cells are blocked.
    """
    checks.instance("scenario", scenario, Scenario)
    with writing("path", path) as file:
        map_path = file.parent / f"{file.stem}_map.yaml"
        shown = "top_first = true\n" if scenario.world.grid.top_first else ""  # which a ROS map does not store
        file.write_text(shown + to_toml(replace(scenario, map=map_path.name)), encoding="utf-8")
        if not _holds(map_path, scenario.world.grid):
            save_map(scenario.world.grid, map_path)


def _holds(file: Path, grid: Grid) -> bool:
    """Tell whether there is a map file that scenarios read as this grid."""
    try:
        return isfile(file) and load_map(file).turned() == grid
    except BadInput:
        return False


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        escaped = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c >= " " and c != "\x7f" else f"\\u{ord(c):04X}" for c in escaped) + '"'
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return repr(value)
