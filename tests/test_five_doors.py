"""C18: one table of wrong values, five doors; by whichever a value comes in, it meets the same class of error."""

from __future__ import annotations

import base64
import json
import math
import re
import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
import tomli_w

from antway import Grid, Problem, RobotSpec, Scenario, Task, Tracks, World, load_map, load_scenario, make_policy, solve
from antway.cli import app, main
from antway.console import Refused
from antway.errors import BadInput, BadMap, BadParameter, CellBlocked, OutOfBounds, TooLarge
from antway.policies.antway.policy import AntwayPolicy
from antway.ros2 import convert
from antway.ros2.settings import Settings, parameters
from antway.web.session import PARAMETERS, Session
from antway.world.motions import Line
from antway.world.sensor import Sensor
from antway.world.trace import Trace
from antway.world.tracefile import to_json
from antway.world.world import Obstacle
from fake_ros import defaults
from sample import sample_trace

NAN, INF = math.nan, math.inf

# field, wrong values, the class of error, the doors that have no such field
TABLE: list[tuple[str, list[Any], type[BadInput], str]] = [
    ("robot.radius", [-0.3, NAN, INF, "wide", True], BadParameter, ""),
    ("robot.v_max", [0, -1.0, NAN, INF, "fast"], BadParameter, ""),
    ("robot.a_max", [0, -1.0, NAN, "x"], BadParameter, ""),
    ("robot.drive", ["tracked", 3], BadParameter, ""),
    ("robot.dt", [0.0, -0.1, NAN, INF, False], BadParameter, ""),
    ("robot.sensor_range", [0, -4.0, NAN, "far"], BadParameter, ""),
    ("robot.turn_rate", [0, -2.0, NAN], BadParameter, ""),
    ("goal_tolerance", [0.0, -0.2, NAN, INF, "x"], BadParameter, ""),
    ("obstacle_speed", [-1.0, NAN, INF, True], BadParameter, ""),
    ("obstacle_surge", [-1.0, NAN, "x"], BadParameter, ""),
    ("obstacle.radius", [0.0, -0.3, NAN, INF, "x"], BadParameter, ""),
    ("obstacle.speed", [NAN, INF], BadParameter, ""),
    ("map.resolution", [0.0, -0.05, NAN, INF, 1e7, "fine"], BadParameter, ""),
    ("map.origin", [NAN, INF, 1e10, "here"], BadParameter, ""),
    ("map.yaw", [0.5], BadParameter, "file cli web"),  # a file's map is turned
    ("start", [(NAN, 1.5), ("x", 1.5)], BadParameter, ""),
    ("start", [(-1.0, 1.5), (1.5, 99.0)], OutOfBounds, ""),
    ("goal", [(1.5, INF), (False, 1.5)], BadParameter, ""),
    ("goal", [(20.0, 1.5), (1e30, 1.5)], OutOfBounds, ""),
    ("goal", [(10.0, 10.0), (11.5, 8.5)], CellBlocked, ""),
    # A pose has two numbers for a place.
    ("goal", [(1.5,), (1.0, 2.0, 3.0)], BadParameter, "ros"),
    # An array in memory has its size, and all of its cells.
    ("map.size", [10**9], TooLarge, "constructor"),
    ("map.cells", [399], BadMap, "constructor"),
    # Under ROS the sensor and the clock are the robot's own, chance is none, and the policy is the node itself.
    ("sensor.noise", [-0.1, NAN], BadParameter, "ros"),
    ("horizon", [0.0, NAN, "long"], BadParameter, "ros"),
    ("seed", [-1, 1.5, 2**64], BadParameter, "ros"),
    # What plans is chosen by who asks, not by the scenario.
    ("policy", ["magic"], BadParameter, "file ros"),
    ("planner", ["magic"], BadParameter, "file web"),
]


class Row(NamedTuple):
    """One wrong value."""

    field: str
    value: Any
    kind: type[BadInput]

    @property
    def parts(self) -> tuple[str, str]:
        """(table, key) of the field."""
        owner, _, name = self.field.rpartition(".")
        return owner, name

    def of(self, field: str, sound: Any) -> Any:
        """The wrong value where this row is about `field`, else `sound`."""
        return self.value if self.field == field else sound


WALLS = np.zeros((20, 20), dtype=bool)
WALLS[8:12, 8:12] = True
START, GOAL = (1.5, 1.5), (18.5, 18.5)
Attempts = Iterator[Callable[[], object]]


def write_place(row: Row, folder: Path) -> Path:
    """Write the files of a scenario with the wrong value of `row` in it."""
    size, cells = row.of("map.size", 20), row.of("map.cells", 400)
    grey = np.where(WALLS, 0, 254).astype(np.uint8).tobytes()
    (folder / "map.pgm").write_bytes(b"P5 %d %d 255\n" % (size, size) + grey[:cells])
    numbers = (row.of("map.resolution", 1.0), row.of("map.origin", 0.0), row.of("map.yaw", 0.0))
    size_, x, yaw = (f".{n}" if isinstance(n, float) and not math.isfinite(n) else n for n in numbers)
    about = f"image: map.pgm\nresolution: {size_}\norigin: [{x}, 0.0, {yaw}]\n"
    (folder / "map.yaml").write_text(about + "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n")
    line = {"radius": 0.3, "motion": "line", "start": (1.5, 18.5), "end": GOAL, "speed": 0.5}
    record: dict[str, Any] = {"map": "map.yaml", "start": START, "goal": GOAL, "robot": {}, "sensor": {}, "obstacles": [line]}
    owner, name = row.parts
    tables = {"": record, "robot": record["robot"], "sensor": record["sensor"], "obstacle": line}
    if owner in tables and row.field not in ("", "policy", "planner"):
        tables[owner][name] = row.value
    (folder / "place.toml").write_text(tomli_w.dumps(record))
    return folder / "place.toml"


def constructor(row: Row, folder: Path) -> Attempts:
    """The class or function that has the field."""
    owner, name = row.parts
    grid = Grid(WALLS)
    if owner in ("robot", "sensor"):
        yield lambda: {"robot": RobotSpec, "sensor": Sensor}[owner](**{name: row.value})
    elif owner == "obstacle":
        yield lambda: Obstacle(row.of("obstacle.radius", 0.3), Line(START, GOAL, row.of("obstacle.speed", 0.5)))
    elif owner == "map":
        origin = (row.of("map.origin", 0.0), 0.0, row.of("map.yaw", 0.0))
        yield lambda: World(Grid(WALLS, row.of("map.resolution", 1.0), origin))
    elif name == "planner":
        yield lambda: solve(Problem(grid, (0, 0), (1, 1)), row.value)
    elif name == "policy":
        yield lambda: make_policy(row.value)
    else:
        yield lambda: Scenario(World(grid), **{"start": START, "goal": GOAL, name: row.value})


def file(row: Row, folder: Path) -> Attempts:
    """A scenario with its map, the map alone, and a trace, each as far as it holds the field."""
    path = write_place(row, folder)
    yield lambda: load_scenario(path)
    owner, name = row.parts
    if owner == "map" and name != "yaw":
        yield lambda: load_map(folder / "map.yaml")
    record = json.loads(to_json(sample_trace(steps=6)))
    table = {"robot": record["task"]["robot"], "map": record["task"]["grid"], "": record["task"]}.get(owner, {})
    if (
        name in table and row.field != "map.origin" and row.kind is not CellBlocked
    ):  # a trace is of a robot that did stand there
        table[name] = [str(v) if v in (INF, NAN) else v for v in row.value] if isinstance(row.value, tuple) else row.value
        (folder / "trace.json").write_text(json.dumps(record).replace("NaN", '"nan"').replace("Infinity", '"inf"'))
        yield lambda: Trace.load(folder / "trace.json")


def cli(row: Row, folder: Path) -> Attempts:
    """`antway run` on a scenario's file, and `antway plan` where it has an option or a map for the field."""
    path = write_place(row, folder)
    ends = {name: ",".join(map(str, row.of(name, end))) for name, end in (("start", START), ("goal", GOAL))}
    commands = [["run", str(path), "--policy", row.of("policy", "stop")]]
    plan = ["plan", str(folder / "map.yaml"), f"--start={ends['start']}", f"--goal={ends['goal']}"]
    plan += [f"--radius={row.of('robot.radius', 0.3)}", f"--seed={row.of('seed', 0)}", f"--planner={row.of('planner', 'jps')}"]
    if row.field == "seed":
        commands.append(["run", "paper", f"--seed={row.value}"])
    if row.field == "planner":
        commands.pop()
    if row.field in ("start", "goal", "robot.radius", "seed", "planner") or (row.parts[0] == "map" and row.field != "map.yaw"):
        commands.append(plan)

    def attempt(command: list[str]) -> object:
        sys.argv = ["antway", *command]
        with pytest.raises(SystemExit) as end:
            main()
        assert end.value.code == 2
        try:
            return app(command, standalone_mode=False)
        except Refused as refused:
            raise refused.args[0] from None

    for command in commands:
        yield lambda command=command: attempt(command)


def web(row: Row, folder: Path) -> Attempts:
    """A scenario's files opened on the page, and the page's own message for the field, if it has one."""
    wishes: list[dict[str, Any]] = []
    if row.field == "policy":
        wishes.append({"op": "policies", "names": [row.value]})
    else:
        write_place(row, folder)
        wishes.append({"op": "open", "files": uploaded(folder)})
    if row.field in [parameter.field for parameter in PARAMETERS]:
        wishes.append({"op": "set", "field": row.field, "value": row.value})
    if row.field in ("start", "goal"):
        wishes.append({"op": "move", "end": row.field, "xy": list(row.value)})
    if row.parts[0] == "obstacle":
        radius, speed = row.of("obstacle.radius", 0.3), row.of("obstacle.speed", 0.5)
        wishes.append({"op": "drop", "xy": [5.5, 5.5], "velocity": [speed, 0.0], "radius": radius})
    for request in wishes:
        yield lambda request=request: session().apply(request)


@lru_cache(maxsize=1)
def session() -> Session:
    """One for all, in the room of the other doors: what is refused changes nothing."""
    made = Session()
    with tempfile.TemporaryDirectory() as folder:
        write_place(Row("", None, BadInput), Path(folder))
        made.apply({"op": "open", "files": uploaded(Path(folder))})
    return made


def uploaded(folder: Path) -> list[dict[str, str]]:
    """The files in `folder` as the page sends them."""
    return [{"name": f.name, "data": base64.b64encode(f.read_bytes()).decode()} for f in sorted(folder.iterdir())]


def ros(row: Row, folder: Path) -> Attempts:
    """The node's parameters, and the messages on its topics as the node takes them."""
    owner, name = row.parts
    values = defaults()
    named = {"obstacle.radius": "obstacle_radius", "planner": "planner"}.get(row.field)
    named = named or (f"task.{name}" if f"task.{name}" in values else row.field)
    if named in parameters():
        yield lambda: Settings.of(values | {named: row.value})
    if owner == "map":
        message = convert.grid_message(Grid(WALLS, 1.0, (0.0, 0.0, row.of("map.yaw", 0.0))))
        message.info.resolution = row.of("map.resolution", 1.0)
        message.info.origin.position.x = row.of("map.origin", 0.0)
        message.info.width = message.info.height = row.of("map.size", 20)
        message.data = message.data[: row.of("map.cells", 400)]
        yield lambda: Task(convert.read_grid(message), RobotSpec(), START, GOAL)
    if owner == "obstacle":
        ball = convert.markers_message(Tracks(np.zeros(1, np.int64), np.ones((1, 2)), np.ones((1, 2)), np.ones(1)), 0.0)
        ball.markers[1].scale.x = ball.markers[1].scale.y = row.of("obstacle.radius", 0.3)
        ball.markers[2].points[1].x = row.of("obstacle.speed", 0.5)
        yield lambda: convert.read_markers(ball)
    if name in ("start", "goal"):
        pose = convert.pose_message(0.0, 0.0, 0.0)
        pose.position.x, pose.position.y = row.value

        def drive() -> None:
            ends = {"start": START, "goal": GOAL, name: convert.read_pose(pose)[:2]}
            AntwayPolicy().reset(Task(Grid(WALLS), RobotSpec(), **ends), 0)

        yield drive


DOORS = {"constructor": constructor, "file": file, "cli": cli, "web": web, "ros": ros}
NAMES = {  # what an error may call a field, where that is not its key
    "map.yaw": r"origin\[2\]",
    "map.size": r"height x width|width \* ",
    "map.cells": r"bytes of pixels|data\.length",
    "obstacle.radius": r"radius|scale",
    "obstacle.speed": r"speed|velocity|points",
    "policy": r"policy|names",
    "start": r"start|xy|position",
    "goal": r"goal|xy|position",
}
ROWS = [(Row(field, value, kind), shut.split()) for field, values, kind, shut in TABLE for value in values]


@pytest.mark.parametrize("door", DOORS)
@pytest.mark.parametrize(("row", "shut"), ROWS, ids=[f"{row.field}={row.value}" for row, _ in ROWS])
def test_a_wrong_value_meets_the_same_error_at_every_door(
    door: str, row: Row, shut: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The class of the table, and the field by name; the command line says it in one line and ends with status 2."""
    monkeypatch.setattr(sys, "argv", [])
    attempts = [] if door in shut else list(DOORS[door](row, tmp_path))
    assert bool(attempts) != (door in shut)
    for attempt in attempts:
        with pytest.raises(BadInput) as caught:
            attempt()
        assert type(caught.value) is row.kind, caught.value
        assert re.search(NAMES.get(row.field, row.parts[1]), str(caught.value)), caught.value
        if door == "cli":
            printed = capsys.readouterr()
            lines = [line for line in printed.err.splitlines() if not line.endswith("...")]
            assert printed.out == "" and lines == [f"error: {caught.value}"]


def test_the_table_is_long_and_has_few_gaps() -> None:
    """Sixty wrong values go through all five doors; few others have a door that cannot take them."""
    assert sum(not shut for _, shut in ROWS) >= 60
    assert sum(len(shut) for _, shut in ROWS) <= 19
