"""What one tab of the live page does: a scenario that can be edited, and one or two policies that play it in step.

A session knows nothing of sockets: `apply` takes a message as the page sends it and returns the messages to send back.
"""

from __future__ import annotations

import base64
import math
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, TooLarge
from antway.planning import Problem, solve
from antway.scenes import SCENES, scene
from antway.web.files import MAX_OBSTACLES, packed, read_upload, replay_file, scenario_file, trace_file
from antway.world.episode import Episode
from antway.world.motions import Bounce, Line
from antway.world.policy import Decision
from antway.world.scenario import Scenario, load_scenario
from antway.world.world import Obstacle, World

Message = dict[str, Any]

POLICIES = (
    "antway",
    "paper",
    "follow",
    "stop",
    "replan",
    "dstarlite",
    "sipp",
    "potential-field",
    "neural",
    "glasius",
    "oracle",
)
SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)
MAX_UNDO = 100
_SHADES = 40_000  # cells of pheromone in one frame
_KNOTS = 300  # of a planned way in one frame
_ROWS = 300  # of the way driven in one frame


@dataclass(frozen=True, slots=True)
class Parameter:
    """A number that the page lets people set: a field of the scenario, its range there, and what it means."""

    field: str
    label: str
    unit: str
    low: float
    high: float
    step: float
    meaning: str


PARAMETERS = (
    Parameter("seed", "Seed", "", 0, 2**32 - 1, 1, "Draws where obstacles begin and how fast they are; same seed, same run."),
    Parameter("robot.radius", "Robot's radius", "m", 0.05, 2.0, 0.05, "Half the robot's width."),
    Parameter("robot.v_max", "Robot's top speed", "m/s", 0.1, 5.0, 0.1, "The robot never drives faster."),
    Parameter("robot.sensor_range", "Sensed range", "m", 0.5, 50.0, 0.5, "How far the robot senses what moves."),
    Parameter("sensor.noise", "Sensor's noise", "m", 0.0, 1.0, 0.01, "Standard deviation of the places it senses."),
    Parameter("sensor.dropout", "Missed obstacles", "", 0.0, 0.9, 0.05, "Share of the scans that miss an obstacle."),
    Parameter("obstacle_speed", "Fastest obstacle", "m/s", 0.1, 5.0, 0.1, "The bound that the guard counts on."),
    Parameter("horizon", "Time limit", "s", 1.0, 600.0, 1.0, "The run ends then at the latest."),
)


class Lane:
    """One policy at work, and what of it the page has been told."""

    def __init__(self, scenario: Scenario, policy: str) -> None:
        self.episode = Episode(scenario, policy)
        self.told = 0  # rows of the record
        self.decision: Decision | None = None

    def step(self) -> None:
        if self.episode.outcome is None:
            self.episode.step()

    def frame(self, lanes: int) -> Message:
        """Return what is new since the last frame."""
        episode, stage, n = self.episode, self.episode.stage, self.episode.steps
        places, velocities = stage.timeline.at(float(stage.t[n]))
        sensed = stage.sensed[max(n - 1, 0)]
        begin, end = self.told, min(n + 1, self.told + _ROWS)
        self.told = end
        record: Message = {
            "t": _short(stage.t[n]),
            "robot": [_short(v) for v in (*stage.xy[n], stage.heading[n])],
            "speed": _short(math.hypot(*stage.velocity[n])),
            "obstacles": [
                [_short(v) for v in (*place, *velocity)] + [int(seen)]
                for place, velocity, seen in zip(places, velocities, sensed)
            ],
            "from": begin,
            "trail": [[_short(v) for v in row] for row in stage.xy[begin:end]],
            "ms": [_short(v) for v in stage.cycle_ms[max(begin - 1, 0) : end - 1]],
            "clearance": _short(stage.clearance),
            "outcome": None if episode.outcome is None else episode.outcome.value,
            "ending": episode.reason[:400],
        }
        latest = episode.decisions[-1][1] if episode.decisions else None
        if latest is not self.decision:
            self.decision = latest
            record["decision"] = None if latest is None else _decision(latest, lanes)
        return record


class Session:
    """The state behind one tab.

    Attributes
    ----------
    playing : bool
    speed : float
        Simulated seconds for one of the clock.
    closed : threading.Event
        Set when the tab is gone: long work ends.
    """

    def __init__(self) -> None:
        self.closed = threading.Event()
        self.playing, self.speed = False, 1.0
        self.policies: tuple[str, ...] = ("antway",)
        self.history: list[Scenario] = []
        self.place = -1
        self._open(load_scenario(scene(SCENES[0])))
        self.operations: dict[str, Callable[[Message], list[Message]]] = {
            "play": self._play,
            "step": self._step,
            "reset": self._reset,
            "speed": self._speed,
            "policies": self._policies,
            "scene": self._scene,
            "open": self._files,
            "set": self._set,
            "paint": self._paint,
            "move": self._move,
            "drop": self._drop,
            "remove": self._remove,
            "undo": lambda message: self._go(-1),
            "redo": lambda message: self._go(1),
            "export": self._export,
        }

    @property
    def scenario(self) -> Scenario:
        return self.history[self.place]

    @property
    def ended(self) -> bool:
        return all(lane.episode.outcome is not None for lane in self.lanes)

    def apply(self, message: object) -> list[Message]:
        """Do what `message` asks and return what to send; a scene or a frame is due after it in any case.

        Raises
        ------
        BadInput
            For wrong messages; nothing has changed then.
        """
        if not isinstance(message, dict):
            raise BadParameter("message", message, "a JSON object")
        return self.operations[checks.choice("op", message.get("op"), self.operations)](message)

    def advance(self, steps: int) -> None:
        """Play so many control cycles, of all policies in step."""
        for _ in range(steps):
            if self.closed.is_set():
                return
            for lane in self.lanes:
                lane.step()
        if self.ended:
            self.playing = False

    def frame(self) -> Message:
        """Return what the page shows of this moment: at most 60 kB as JSON."""
        lanes = [lane.frame(len(self.lanes)) for lane in self.lanes]
        return {"kind": "frame", "playing": self.playing, "speed": self.speed, "lanes": lanes}

    def describe(self) -> Message:
        """Return everything that stands still: map, ends, obstacles, parameters, names."""
        scenario, grid = self.scenario, self.scenario.world.grid
        room = grid.inflate(scenario.robot.radius)
        start, goal = room.cell_at(scenario.start), room.cell_at(scenario.goal)
        found = room.is_free(start) and room.is_free(goal)
        way = solve(Problem(room, start, goal), "jps").xy(grid).tolist() if found else []
        return {
            "kind": "scene",
            "name": scenario.name,
            "map": {
                "rows": grid.shape[0],
                "cols": grid.shape[1],
                "resolution": grid.resolution,
                "x": grid.origin[0],
                "y": grid.origin[1],
                "blocked": packed(grid.blocked if grid.unknown is None else grid.blocked & ~grid.unknown),
                "unknown": None if grid.unknown is None else packed(grid.unknown),
            },
            "start": scenario.start,
            "goal": scenario.goal,
            "tolerance": scenario.goal_tolerance,
            "radius": scenario.robot.radius,
            "range": _short(scenario.robot.sensor_range),
            "dt": scenario.robot.dt,
            "fastest": scenario.obstacle_speed,
            "radii": [obstacle.radius for obstacle in scenario.world.obstacles],
            "shortest": [[_short(v) for v in point] for point in way],
            "policies": self.policies,
            "parameters": {p.field: _short(_get(scenario, p.field)) for p in PARAMETERS},
            "undo": self.place > 0,
            "redo": self.place + 1 < len(self.history),
        }

    def _lay(self, scenario: Scenario, policies: tuple[str, ...]) -> None:
        """Begin again with these; where that is refused, all stays as it was."""
        if len(scenario.world.obstacles) > MAX_OBSTACLES:
            raise TooLarge("obstacles.length", len(scenario.world.obstacles), f"at most {MAX_OBSTACLES} on the page")
        self.lanes = [Lane(scenario, policy) for policy in policies]

    def _open(self, scenario: Scenario) -> list[Message]:
        """Make `scenario` the present one, as a step that can be undone."""
        self._lay(scenario, self.policies)
        self.history = [*self.history[: self.place + 1], scenario][-MAX_UNDO:]
        self.place = len(self.history) - 1
        return [self.describe()]

    def _go(self, steps: int) -> list[Message]:
        place = self.place + steps
        if not 0 <= place < len(self.history):
            return []
        self._lay(self.history[place], self.policies)
        self.place = place
        return [self.describe()]

    def _play(self, message: Message) -> list[Message]:
        self.playing = checks.instance("on", message.get("on"), bool) and not self.ended
        return []

    def _step(self, message: Message) -> list[Message]:
        self.playing = False
        self.advance(1)
        return []

    def _reset(self, message: Message) -> list[Message]:
        self.playing = False
        self._lay(self.scenario, self.policies)
        return [self.describe()]

    def _speed(self, message: Message) -> list[Message]:
        speed = checks.number("speed", message.get("speed"))
        if speed not in SPEEDS:
            raise BadParameter("speed", speed, f"one of {', '.join(f'{s:g}' for s in SPEEDS)}")
        self.speed = speed
        return []

    def _policies(self, message: Message) -> list[Message]:
        names = message.get("names")
        if not isinstance(names, list) or not 1 <= len(names) <= 2:
            raise BadParameter("names", names, "one or two names of policies")
        policies = tuple(checks.choice(f"names[{i}]", name, POLICIES) for i, name in enumerate(names))
        self._lay(self.scenario, policies)
        self.policies = policies
        return [self.describe()]

    def _scene(self, message: Message) -> list[Message]:
        self.playing = False
        return self._open(load_scenario(scene(message.get("name"))))  # type: ignore[arg-type]

    def _files(self, message: Message) -> list[Message]:
        scenario = read_upload(message.get("files"))
        self.playing = False
        return self._open(scenario)

    def _set(self, message: Message) -> list[Message]:
        name = checks.choice("field", message.get("field"), [p.field for p in PARAMETERS])
        known = next(p for p in PARAMETERS if p.field == name)
        whole = checks.integer if known.step == 1 and name == "seed" else None
        value: float
        if whole:
            value = whole(name, message.get("value"), low=int(known.low), high=int(known.high))
        else:
            value = checks.number(name, message.get("value"), low=known.low, high=known.high, unit=known.unit)
        return self._open(_put(self.scenario, name, value))

    def _paint(self, message: Message) -> list[Message]:
        blocked = checks.instance("blocked", message.get("blocked"), bool)
        cells = checks.array("cells", message.get("cells"), (None, 2))
        grid = self.scenario.world.grid
        if (cells != np.round(cells)).any() or (cells < 0).any() or (cells >= grid.shape).any():
            raise BadParameter("cells", message.get("cells"), f"cells (row, col) of the map of {grid.shape}")
        rows, cols = cells.astype(np.int64).T
        walls = grid.blocked.copy()
        walls[rows, cols] = blocked
        unknown = grid.unknown
        if unknown is not None:
            unknown = unknown.copy()
            unknown[rows, cols] = False
        return self._change(world=World(replace(grid, blocked=walls, unknown=unknown), self.scenario.world.obstacles))

    def _move(self, message: Message) -> list[Message]:
        end = checks.choice("end", message.get("end"), ("start", "goal"))
        return self._change(**{end: checks.point("xy", message.get("xy"))})

    def _drop(self, message: Message) -> list[Message]:
        world, limit = self.scenario.world, self.scenario.obstacle_speed
        x, y = checks.point("xy", message.get("xy"))
        vx, vy = checks.point("velocity", message.get("velocity"))
        speed = checks.number("speed", math.hypot(vx, vy), low=0.0, high=limit * (1 + 1e-9), unit="m/s")
        radius = checks.number("radius", message.get("radius"), low=0.05, high=5.0, unit="m")
        row, col = world.grid.cell_at((x, y))
        if world.grid.blocked[row, col]:
            raise BadParameter("xy", (x, y), "where the map is free")
        motion = Bounce((x, y), min(speed, limit), math.atan2(vy, vx)) if speed > 0.0 else Line((x, y), (x, y), 0.0)
        return self._change(world=World(world.grid, (*world.obstacles, Obstacle(radius, motion))))

    def _remove(self, message: Message) -> list[Message]:
        world = self.scenario.world
        k = checks.integer("obstacle", message.get("obstacle"), low=0, high=len(world.obstacles) - 1)
        return self._change(world=World(world.grid, world.obstacles[:k] + world.obstacles[k + 1 :]))

    def _change(self, **changes: Any) -> list[Message]:
        return self._open(replace(self.scenario, **changes))

    def _export(self, message: Message) -> list[Message]:
        """Play a copy of each episode to its end and return it as a file, or return the scenario."""
        what = checks.choice("what", message.get("what"), ("scenario", "trace", "replay"))
        if what == "scenario":
            return [scenario_file(self.scenario)]
        lane = checks.integer("lane", message.get("lane", 0), low=0, high=len(self.lanes) - 1)
        episode = Episode(self.scenario, self.policies[lane])
        while episode.outcome is None:
            if self.closed.is_set():
                return []
            episode.step()
        trace = episode.result().trace
        assert trace is not None
        return [trace_file(trace) if what == "trace" else replay_file(trace)]


def _decision(decision: Decision, lanes: int) -> Message:
    path = None if decision.path is None else decision.path.xy
    if path is not None and len(path) > _KNOTS:
        path = path[np.linspace(0, len(path) - 1, _KNOTS).astype(np.int64)]
    record: Message = {
        "action": decision.action,
        "reason": decision.reason[:400],
        "obstacle": None if decision.obstacle is None else int(decision.obstacle),
        "encounter": decision.encounter,
        "closest": [_short(decision.time_to_closest), _short(decision.distance_at_closest)],
        "target": None if decision.local_target is None else [_short(v) for v in decision.local_target],
        "path": None if path is None else [[_short(v) for v in point] for point in path],
        "alternatives": [[name[:80], _short(cost)] for name, cost in decision.alternatives[:8]],
        "gap": _short(decision.gap),
        "guard": decision.guard,
        "pheromone": None if decision.pheromone is None else _heat(*decision.pheromone, _SHADES // lanes),
    }
    return record


def _heat(row: int, col: int, amount: NDArray[np.float32], most: int) -> Message:
    """Return pheromone in 16 shades, two to a byte, the largest of each block of cells where there are more than `most`."""
    height, width = amount.shape
    block = max(1, math.ceil(math.sqrt(height * width / most)))
    rows, cols = -(-height // block), -(-width // block)
    padded = np.full((rows * block, cols * block), float(amount.min()), np.float32)
    padded[:height, :width] = amount
    coarse = padded.reshape(rows, block, cols, block).max(axis=(1, 3))
    low, high = float(coarse.min()), float(coarse.max())
    share = (coarse - low) / (high - low) if high > low else np.zeros_like(coarse)
    shades = np.round(15 * np.sqrt(share)).astype(np.uint8).ravel()
    if len(shades) % 2:
        shades = np.append(shades, np.uint8(0))
    data = base64.b64encode((shades[::2] | (shades[1::2] << 4)).tobytes()).decode()
    return {"row": row, "col": col, "height": rows * block, "width": cols * block, "rows": rows, "cols": cols, "shades": data}


def _get(scenario: Scenario, name: str) -> float:
    value: Any = scenario
    for part in name.split("."):
        value = getattr(value, part)
    return float(value) if name != "seed" else value


def _put(scenario: Scenario, name: str, value: float) -> Scenario:
    table, _, field = name.rpartition(".")
    changes: dict[str, Any] = {field: value}
    return replace(scenario, **({table: replace(getattr(scenario, table), **changes)} if table else changes))


def _short(value: float) -> float | None:
    return round(float(value), 3) if math.isfinite(value) else None
