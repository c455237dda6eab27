"""Traces as JSON, with lists of numbers for people and packed bytes for maps and pheromone; read strictly."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Callable, Mapping
from os.path import isfile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TypeVar

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadInput, BadScenario
from antway.grid import Grid
from antway.limits import MAX_DEPTH, MAX_LISTS, MAX_PLACE
from antway.planning import TimedPath
from antway.reading import Unpacked, check_nesting, count_lists, read_text
from antway.world.policy import Decision, RobotSpec, Task
from antway.world.stops import Rounds, Stop, Turn, Visit
from antway.world.timeline import COLUMNS, Timeline

if TYPE_CHECKING:
    from antway.world.trace import Trace

T = TypeVar("T")
FORMAT = "antway-trace"
VERSION = 2
READS = (1, VERSION)  # in version 1 the policy `antway` wrote total times to the goal as costs
MAX_BYTES = 32 * 2**20
MAX_UNPACKED = 128 * 2**20  # limit of bytes of all unpacked arrays of a trace together

_ARRAYS = {"t": 1, "xy": 2, "velocity": 2, "heading": 1, "command": 2}
_ROBOT = ("radius", "v_max", "a_max", "drive", "dt", "sensor_range", "turn_rate")
# Written only if they differ from the default:
_DYNAMICS = ("v_reverse", "brake_max", "alpha_max", "turning_radius", "latency", "footprint", "dynamics")
_TEXTS = ("action", "reason", "encounter", "guard")
_NUMBERS = ("time_to_closest", "distance_at_closest", "gap")


def to_json(trace: Trace, *, timing: bool = False) -> str:
    """Return `trace` as JSON text; `cycle_ms`, which differs between equal runs, is included only with `timing`."""
    task, grid = trace.task, trace.task.grid
    record = {
        "format": FORMAT,
        "version": VERSION,
        "policy": trace.policy,
        "scenario": trace.scenario,
        "seed": trace.seed,
        "outcome": trace.outcome.value,
        "reason": trace.reason,
        "config": dict(trace.config),
        "task": {
            "grid": {
                "resolution": grid.resolution,
                "origin": list(grid.origin),
                "blocked": _pack(grid.blocked),
                "unknown": None if grid.unknown is None else _pack(grid.unknown),
                **({"top_first": True} if grid.top_first else {}),
            },
            "robot": {name: getattr(task.robot, name) for name in _ROBOT} | _dynamics(task.robot),
            "start": list(task.start),
            "goal": list(task.goal),
            "goal_tolerance": task.goal_tolerance,
            "obstacle_speed": task.obstacle_speed,
            "obstacle_surge": task.obstacle_surge,
            **({} if math.isinf(task.obstacle_swerve) else {"obstacle_swerve": task.obstacle_swerve}),
        },
        **{name: getattr(trace, name).tolist() for name in _ARRAYS},
        **({} if task.robot.stepwise else {"turn_rate": trace.turn_rate.tolist()}),
        "timeline": {name: getattr(trace.timeline, name).tolist() for name in COLUMNS},
        "sensed": _pack(trace.sensed),
        "decisions": [{"step": step, **_decision_record(decision)} for step, decision in trace.decisions],
    }
    if trace.rounds is not None:
        record["rounds"] = trace.rounds.record()
    if timing:
        record["cycle_ms"] = trace.cycle_ms.tolist()
    return json.dumps(_finite(record), allow_nan=False, separators=(",", ":"))


def beyond_limits(trace: Trace, text: str) -> str:
    """Return in words which limit on reading a trace is exceeded, given its JSON text; empty if none."""
    grid, decisions = trace.task.grid, [decision for _, decision in trace.decisions]
    packed = [grid.blocked, grid.unknown, trace.sensed, *(one.predicted for one in decisions)]
    packed += [one.pheromone[2] for one in decisions if one.pheromone is not None]
    for what, size, most in (
        ("bytes", len(text), MAX_BYTES),
        ("lists and tables", count_lists(text), MAX_LISTS),
        ("bytes unpacked", sum(array.nbytes for array in packed if array is not None), MAX_UNPACKED),
    ):
        if size > most:
            return f"more than {most} {what}, {size}"
    return ""


def _dynamics(robot: RobotSpec) -> dict[str, Any]:
    default = RobotSpec()
    return {name: getattr(robot, name) for name in _DYNAMICS if getattr(robot, name) != getattr(default, name)}


def _decision_record(decision: Decision) -> dict[str, Any]:
    path, pheromone = decision.path, decision.pheromone
    return {
        **{name: getattr(decision, name) for name in (*_TEXTS, *_NUMBERS)},
        "obstacle": None if decision.obstacle is None else int(decision.obstacle),
        "local_target": None if decision.local_target is None else list(decision.local_target),
        "path": None if path is None else {"t": path.t.tolist(), "xy": path.xy.tolist()},
        "alternatives": [[name, cost] for name, cost in decision.alternatives],
        "pheromone": None if pheromone is None else [int(pheromone[0]), int(pheromone[1]), _pack(pheromone[2])],
        "history": None if decision.history is None else decision.history.tolist(),
        **({} if decision.predicted is None else {"predicted": _pack(decision.predicted)}),
    }


def _finite(value: Any) -> Any:
    """Replace numbers that JSON lacks by "nan", "inf" and "-inf", and NumPy's numbers by Python's."""
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(part) for part in value]
    if isinstance(value, np.generic):
        value = value.item()
    return value if not isinstance(value, float) or math.isfinite(value) else str(value)


def _pack(array: NDArray[Any]) -> dict[str, Any]:
    little = np.ascontiguousarray(array).astype(array.dtype.newbyteorder("<"))
    data = base64.b64encode(zlib.compress(little.tobytes(), 6)).decode()
    return {"dtype": little.dtype.str, "shape": list(array.shape), "zlib": data}


def read_fields(path: Path) -> dict[str, Any]:
    """Read the fields of a `Trace` from a file, the outcome as text.

    All errors are `BadInput`s that name the file and the key; they are `BadScenario`s unless a value is wrong.
    """
    where = str(path)
    if not isfile(path):
        raise BadScenario("trace", where, "an existing regular file", where=where)
    try:
        text = read_text(path, MAX_BYTES, error=BadScenario, field="trace")
        check_nesting(text, MAX_DEPTH, MAX_LISTS, where)
        record = json.loads(text, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        if isinstance(error, BadInput):
            raise
        raise BadScenario("trace", str(error), "JSON text in UTF-8", where=where) from None
    return _Reader(where).fields(record)


def _no_constant(name: str) -> NoReturn:
    raise ValueError(f"the constant {name} is not JSON")


class _Reader:
    """Converts a parsed record to the fields of a trace; errors name the file `where`."""

    def __init__(self, where: str) -> None:
        self.where, self.unpacked = where, Unpacked(MAX_UNPACKED, where)

    def fields(self, record: object) -> dict[str, Any]:
        top = self.table(
            "trace", record, "format version policy scenario seed outcome reason config task timeline sensed decisions"
        )
        if top["format"] != FORMAT or type(top["version"]) is not int or top["version"] not in READS:
            raise self.bad("format", (top["format"], top["version"]), f"{FORMAT!r} of version {' or '.join(map(str, READS))}")
        arrays = {name: self.floats(name, top.get(name), (None, 2)[:ndim]) for name, ndim in _ARRAYS.items()}
        if "turn_rate" in top:
            arrays["turn_rate"] = self.floats("turn_rate", top["turn_rate"], (None,))
        rows = len(arrays["t"])
        for name, array in arrays.items():
            if len(array) != rows - (name == "command"):
                raise self.bad(f"{name}.length", len(array), str(rows - (name == "command")))
            if name != "command" and not (np.abs(array) <= MAX_PLACE).all():
                raise self.bad(name, "a number that is not finite, or too large", f"finite throughout, up to {MAX_PLACE:g}")
        if (np.diff(arrays["t"]) < 0.0).any():
            raise self.bad("t", "times of which one is before the last", "times that do not fall")
        timeline = self.timeline(top["timeline"])
        sensed = self.unpack("sensed", top["sensed"], "|b1", 2)
        if sensed.shape != (rows, len(timeline)):
            raise self.bad("sensed.shape", sensed.shape, str((rows, len(timeline))))
        cycle_ms = self.floats("cycle_ms", top.get("cycle_ms", [0.0] * (rows - 1)), (rows - 1,))
        decisions = self.listed("decisions", top["decisions"])
        return dict(
            task=self.task(top["task"], "turn_rate" in top),
            policy=self.text("policy", top["policy"]),
            seed=checks.integer("seed", top["seed"], low=0, high=2**64 - 1, where=self.where),
            scenario=self.text("scenario", top["scenario"]),
            timeline=timeline,
            sensed=sensed,
            decisions=tuple(self.decision(f"decisions[{i}]", one, rows) for i, one in enumerate(decisions)),
            cycle_ms=cycle_ms,
            outcome=self.text("outcome", top["outcome"]),
            reason=self.text("reason", top["reason"]),
            config=self.config(top["config"]),
            rounds=None if top.get("rounds") is None else self.rounds(top["rounds"]),
            **arrays,
        )

    def rounds(self, record: object) -> Rounds:
        """Read how the stops were visited."""
        parts, stops = self.table("rounds", record, "stops visits turns"), list[Stop]()
        for k, one in enumerate(self.listed("rounds.stops", parts["stops"])):
            stop = self.table(f"rounds.stops[{k}]", one, "at name window service")
            early, late = self.listed(f"rounds.stops[{k}].window", stop["window"], 2)
            try:
                stops.append(Stop(stop["at"], stop["name"], (early, math.inf if late is None else late), stop["service"]))
            except BadInput as error:
                raise error.at(self.where, f"rounds.stops[{k}].{error.field}") from None

        def number_of(field: str, stop: object) -> int:
            return checks.integer(field, stop, low=0, high=len(stops) - 1, where=self.where)

        visits, turns = list[Visit](), list[Turn]()
        for k, one in enumerate(self.listed("rounds.visits", parts["visits"])):
            field = f"rounds.visits[{k}]"
            stop, *times = self.listed(field, one, 4)
            visits.append(Visit(number_of(field, stop), *(checks.number(field, time, where=self.where) for time in times)))
        for k, one in enumerate(self.listed("rounds.turns", parts["turns"])):
            field = f"rounds.turns[{k}]"
            t, order, reason = self.listed(field, one, 3)
            numbers = tuple(number_of(field, stop) for stop in self.listed(field, order))
            turns.append(Turn(checks.number(field, t, where=self.where), numbers, self.text(field, reason)))
        return Rounds(tuple(stops), tuple(visits), tuple(turns))

    def config(self, record: object) -> Mapping[str, Any]:
        """Read how the episode was set up; entries that are used elsewhere must have the right type."""
        parts = self.table("config", record, "")
        sensor = self.table("config.sensor", parts.get("sensor", {}), "")
        if not isinstance(sensor.get("occlusion", True), bool):
            raise self.bad("config.sensor.occlusion", sensor["occlusion"], "true or false")
        checks.number("config.horizon", parts.get("horizon", 0.0), low=0.0, where=self.where)
        return parts

    def task(self, record: object, ramps: bool) -> Task:
        """Read the task. In old traces, without turn rates, robots drove in steps."""
        parts = self.table("task", record, "grid robot start goal goal_tolerance obstacle_speed obstacle_surge")
        grid = self.table("task.grid", parts["grid"], "resolution origin blocked unknown")
        robot = self.table("task.robot", parts["robot"], " ".join(_ROBOT))
        values: dict[str, Any] = {k: robot[k] if k == "drive" else self.real(f"task.robot.{k}", robot[k]) for k in _ROBOT}
        if not ramps and (values["drive"] != "holonomic" or math.isfinite(values["a_max"])):
            values["dynamics"] = "steps"
        for name in _DYNAMICS:
            if name in robot:
                plain = name in ("footprint", "dynamics") or robot[name] is None
                values[name] = robot[name] if plain else self.real(f"task.robot.{name}", robot[name])
        x, y, yaw = (self.real("task.grid.origin", part) for part in self.listed("task.grid.origin", grid["origin"], 3))
        try:
            return Task(
                grid=Grid(
                    self.unpack("task.grid.blocked", grid["blocked"], "|b1", 2),
                    self.real("task.grid.resolution", grid["resolution"]),
                    (x, y, yaw),
                    None if grid["unknown"] is None else self.unpack("task.grid.unknown", grid["unknown"], "|b1", 2),
                    grid.get("top_first", False),
                ),
                robot=RobotSpec(**values),
                start=parts["start"],
                goal=parts["goal"],
                goal_tolerance=self.real("task.goal_tolerance", parts["goal_tolerance"]),
                obstacle_speed=self.real("task.obstacle_speed", parts["obstacle_speed"]),
                obstacle_surge=self.real("task.obstacle_surge", parts["obstacle_surge"]),
                obstacle_swerve=self.real("task.obstacle_swerve", parts.get("obstacle_swerve", "inf")),
            )
        except BadInput as error:
            raise error if error.where else error.at(self.where, f"task.{error.field}") from None

    def timeline(self, record: object) -> Timeline:
        parts = self.table("timeline", record, " ".join(COLUMNS))
        columns: dict[str, Any] = {}
        for name, kind in COLUMNS.items():
            most = MAX_PLACE if name in ("radius", "knot_xy") else math.inf
            array = self.floats(f"timeline.{name}", parts[name], (None, 2) if name == "knot_xy" else (None,), most)
            if kind is np.int64 and not ((array == np.round(array)) & (np.abs(array) < 2**53)).all():
                raise self.bad(f"timeline.{name}", parts[name], "integers below 2^53")
            columns[name] = array.astype(kind)
        try:
            return Timeline(**columns)
        except BadScenario as error:
            raise error.at(self.where) from None

    def decision(self, name: str, record: object, rows: int) -> tuple[int, Decision]:
        parts = self.table(
            name, record, "step obstacle local_target path alternatives pheromone history " + " ".join((*_TEXTS, *_NUMBERS))
        )

        def optional(key: str, read: Callable[[str, Any], T]) -> T | None:
            return None if parts.get(key) is None else read(f"{name}.{key}", parts[key])

        step = checks.integer(f"{name}.step", parts["step"], low=0, high=rows - 1, where=self.where)
        return step, Decision(
            **{key: self.text(f"{name}.{key}", parts[key]) for key in _TEXTS},  # type: ignore[arg-type]
            **{key: self.real(f"{name}.{key}", parts[key]) for key in _NUMBERS},  # type: ignore[arg-type]
            obstacle=optional("obstacle", self.whole),
            local_target=optional("local_target", self.point),
            path=optional("path", self.path),
            alternatives=self.alternatives(f"{name}.alternatives", parts["alternatives"]),
            pheromone=optional("pheromone", self.pheromone),
            history=optional("history", lambda name, value: self.floats(name, value, (None, 4))),
            predicted=optional("predicted", self.predicted),  # which old traces do not have
        )

    def path(self, name: str, value: object) -> TimedPath:
        """Read a planned motion."""
        parts = self.table(name, value, "t xy")
        t, xy = self.floats(f"{name}.t", parts["t"], (None,)), self.floats(f"{name}.xy", parts["xy"], (None, 2))
        if not (np.isfinite(t).all() and (np.abs(xy) <= MAX_PLACE).all()):
            raise self.bad(name, "a number that is not finite, or too large", f"of places up to {MAX_PLACE:g} m")
        if len(t) != len(xy):
            raise self.bad(f"{name}.xy.length", len(xy), str(len(t)))
        return TimedPath(t, xy)

    def alternatives(self, name: str, value: object) -> tuple[tuple[str, float], ...]:
        """Read the alternatives of a decision, also those of version 1, which had total times to the goal."""
        found = []
        for pair in self.listed(name, value):
            what, cost = self.listed(name, pair, 2)
            found.append((self.text(name, what), self.real(name, cost)))
        if [what for what, _ in found] == ["the plan", "no way is faster than"]:
            return (("the plan", found[0][1] - found[1][1]),)
        return tuple(found)

    def pheromone(self, name: str, value: object) -> tuple[int, int, NDArray[np.float32]]:
        """Read the pheromone of a decision: row and column of the window's corner, and an array."""
        row, col, window = self.listed(name, value, 3)
        return self.whole(f"{name}[0]", row), self.whole(f"{name}[1]", col), self.unpack(f"{name}[2]", window, "<f4", 2)

    def predicted(self, name: str, value: object) -> NDArray[np.float32]:
        """Read predicted motions."""
        rows: NDArray[np.float32] = self.unpack(name, value, "<f4", 2)
        if rows.shape[1] != 7 or not np.isfinite(rows).all():
            raise self.bad(f"{name}.shape", rows.shape, "N x 7, finite throughout")
        return rows

    def table(self, name: str, value: object, keys: str) -> Mapping[str, Any]:
        if not isinstance(value, dict):
            raise self.bad(name, value, "a table")
        for key in keys.split():
            if key not in value:
                raise self.bad(f"{name}.{key}", None, "present")
        return value

    def listed(self, name: str, value: object, size: int | None = None) -> list[Any]:
        if not isinstance(value, list) or (size is not None and len(value) != size):
            raise self.bad(name, value, "a list" if size is None else f"a list of {size}")
        return value

    def text(self, name: str, value: object) -> str:
        if not isinstance(value, str):
            raise self.bad(name, value, "a text")
        return value

    def whole(self, name: str, value: object) -> int:
        return checks.integer(name, value, where=self.where)

    def point(self, name: str, value: object) -> tuple[float, float]:
        x, y = checks.point(name, value, where=self.where)
        return x, y

    def real(self, name: str, value: object) -> float:
        if value in ("nan", "inf", "-inf"):
            return float(str(value))
        return checks.number(name, value, where=self.where)

    def floats(self, name: str, value: object, shape: tuple[int | None, ...], most: float = math.inf) -> NDArray[np.float64]:
        """Read an array of numbers up to `most`, which need not be finite; of two dimensions it may have no rows."""
        if len(shape) == 2 and isinstance(value, list) and all(row == [] for row in value):
            value = np.empty((0, shape[1] or 2))
        return checks.array(name, value, shape, finite=False, low=-most, high=most, error=BadScenario, where=self.where)

    def unpack(self, name: str, value: object, dtype: str, ndim: int) -> NDArray[Any]:
        parts = self.table(name, value, "dtype shape zlib")
        sizes = self.listed(f"{name}.shape", parts["shape"])
        shape = tuple(checks.integer(f"{name}.shape", n, low=0, where=self.where) for n in sizes)
        if parts["dtype"] != dtype or len(shape) != ndim:
            raise self.bad(f"{name}.dtype", (parts["dtype"], shape), f"{dtype} with {ndim} dimensions")
        size = math.prod(shape)
        kind = np.dtype(dtype)
        self.unpacked.take(f"{name}.shape", size * kind.itemsize)
        try:
            packed = base64.b64decode(self.text(name, parts["zlib"]), validate=True)
            data = zlib.decompressobj().decompress(packed, size * kind.itemsize + 1)
        except (ValueError, zlib.error) as error:
            raise self.bad(f"{name}.zlib", str(error), "bytes packed by zlib and base64") from None
        if len(data) != size * kind.itemsize:
            raise self.bad(f"{name}.zlib", f"{len(data)} bytes", f"{size * kind.itemsize} bytes")
        raw: NDArray[Any] = np.frombuffer(data, np.uint8 if dtype == "|b1" else kind).reshape(shape)
        return raw != 0 if dtype == "|b1" else raw.astype(kind.newbyteorder("="))

    def bad(self, name: str, value: object, allowed: str) -> BadScenario:
        return BadScenario(name, value, allowed, where=self.where)
