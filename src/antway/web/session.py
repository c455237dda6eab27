"""One tab of the live page: a scenario that can be edited, and one or two policies that play it in step."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from importlib.util import find_spec
from itertools import pairwise
from operator import attrgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, TooLarge
from antway.grid import Grid
from antway.limits import MAX_PAGE_SEED
from antway.planning import Problem, solve
from antway.policies.paper.routes import PathsFrom
from antway.scenes import SCENES, scene
from antway.tables import NEED_PYRVO
from antway.view.pages import bits_to_base64
from antway.view.replay import map_record
from antway.web.files import EXPORTS, MAX_OBSTACLES, exported_scenario
from antway.web.tab import Tab
from antway.web.view import Message, View, shades, short, short_rows
from antway.web.workers import EXPORT_SECONDS
from antway.world import policy
from antway.world.motions import Bounce, Line, Waypoints
from antway.world.scenario import MAX_STEPS, Scenario, load_scenario
from antway.world.stops import Stop
from antway.world.world import Obstacle, World

POLICIES = tuple(name for name in policy.POLICIES if name not in NEED_PYRVO or find_spec("pyrvo"))
MAX_UNDO = 100
MAX_UNDO_BYTES = 16 * 2**20  # limit of bytes of the maps kept for undo
MAX_STOPS = 40
MAX_WAYPOINTS = 50
FIELD = 40_000  # limit of cells of the distance field that is sent to the page


@dataclass(frozen=True, slots=True)
class PageParameter:
    """A number that users can set on the page: a field of the scenario, its range, and its meaning."""

    field: str
    label: str
    unit: str
    low: float
    high: float
    meaning: str


PARAMETERS = (
    PageParameter(
        "seed", "Seed", "", 0, MAX_PAGE_SEED, "Draws where obstacles start and how fast; the same seed gives the same run."
    ),
    PageParameter("robot.radius", "Robot's radius", "m", 0.05, 2.0, "Half the robot's width."),
    PageParameter("robot.v_max", "Robot's top speed", "m/s", 0.1, 5.0, "The robot never drives faster."),
    PageParameter("robot.sensor_range", "Sensed range", "m", 0.5, 50.0, "How far the robot senses what moves."),
    PageParameter("sensor.noise", "Sensor's noise", "m", 0.0, 1.0, "Standard deviation of the positions it measures."),
    PageParameter("sensor.dropout", "Missed obstacles", "", 0.0, 0.9, "Share of the scans that miss an obstacle."),
    PageParameter("obstacle_speed", "Fastest obstacle", "m/s", 0.1, 5.0, "The bound on their speed that the guard relies on."),
    PageParameter("horizon", "Time limit", "s", 1.0, 600.0, "The run ends after this time at the latest."),
)


@cache
def _first() -> Scenario:
    """Return what a tab shows at first; all tabs share it, because scenarios and maps are immutable."""
    return load_scenario(scene(SCENES[0]))


class Session(Tab):
    """The state behind one tab; its speed is the number of simulated seconds in a second of the clock."""

    SPEEDS = (0.25, 0.5, 1.0, 2.0, 4.0, 8.0)

    def __init__(self) -> None:
        super().__init__(1.0)
        self.policies: tuple[str, ...] = ("antway",)
        self.history: list[Scenario] = []
        self.position = -1
        self.at = 0  # number of control cycles that are shown
        self._open(_first())

    @property
    def scenario(self) -> Scenario:
        return self.history[self.position]

    @property
    def period(self) -> float:
        """Seconds of the clock that a control cycle takes."""
        return self.scenario.robot.dt / self.speed

    @property
    def steps(self) -> int:
        """Number of control cycles played, of which `at` are shown."""
        return max(view.episode.steps for view in self.views)

    @property
    def ended(self) -> bool:
        return self.at == self.steps and all(view.episode.outcome is not None for view in self.views)

    def advance(self) -> None:
        """Show the next control cycle of all policies in step, and play it if it was not played yet."""
        if self.closed.is_set():
            return
        if self.at == self.steps:
            for view in self.views:
                view.step()
        self.at = min(self.at + 1, self.steps)
        if self.ended:
            self.playing = False

    def frame(self) -> Message:
        """Return the content of the page at this moment, at most 60 kB as JSON."""
        views = [view.frame(len(self.views), self.at) for view in self.views]
        shown = {"at": self.at, "steps": self.steps}
        return {"kind": "frame", "playing": self.playing, "speed": self.speed, **shown, "views": views}

    @property
    def is_behind(self) -> bool:
        """Whether the page lacks a part of a driven path."""
        return any(view.sent <= view.episode.steps for view in self.views)

    def describe(self) -> Message:
        """Return everything static: map, start and goal, obstacles, parameters, names."""
        scenario, grid = self.scenario, self.scenario.world.grid
        inflated = grid.inflate(scenario.robot.radius)
        start, goal = inflated.cell_at(scenario.start), inflated.cell_at(scenario.goal)
        found = inflated.is_free(start) and inflated.is_free(goal)
        path = self._shortest(inflated) if found else []
        far = PathsFrom(inflated, goal).distance() if found else np.full(grid.shape, np.inf)
        most = far.max(initial=0.0, where=np.isfinite(far)) or 1.0
        near = np.where(np.isfinite(far), 0.04 + 0.96 * (1.0 - far / most) ** 2, 0.0)  # shades() takes the root
        return {
            "kind": "scene",
            "name": scenario.name,
            "map": map_record(grid, bits_to_base64),
            "start": scenario.start,
            "goal": scenario.goal,
            "tolerance": scenario.goal_tolerance,
            "radius": scenario.robot.radius,
            "range": short(scenario.robot.sensor_range),
            "dt": scenario.robot.dt,
            "occlusion": scenario.sensor.occlusion,
            "fastest": scenario.obstacle_speed,
            "acceleration": short(scenario.obstacle_surge),
            "field": {"row": 0, "col": 0, **shades(near, FIELD)} if found else None,
            "radii": [obstacle.radius for obstacle in scenario.world.obstacles],
            "shortest": short_rows(path),
            "stops": [stop.at for stop in scenario.stops],
            "policies": self.policies,
            "parameters": {p.field: short(attrgetter(p.field)(scenario)) for p in PARAMETERS} | {"seed": str(scenario.seed)},
            "undo": self.position > 0,
            "redo": self.position + 1 < len(self.history),
        }

    def _shortest(self, inflated: Grid) -> list[list[float]]:
        """Return the shortest path from start to goal, through the stops in the first order, in m."""
        scenario, tour = self.scenario, self.views[0].episode.tour
        order = () if tour is None else tour.turns[0].order
        places = [scenario.start, *(scenario.stops[stop].at for stop in order), scenario.goal]
        cells = [inflated.cell_at(place) for place in places]
        # The centre of a cell may be too near to a wall, although a stop in it is not.
        legs = [(a, b) for a, b in pairwise(cells) if inflated.is_free(a) and inflated.is_free(b)]
        return [point for a, b in legs for point in solve(Problem(inflated, a, b), "jps").xy(inflated).tolist()]

    def _set_up(self, scenario: Scenario, policies: tuple[str, ...]) -> None:
        """Restart with these; if that is refused, nothing changes."""
        if len(scenario.world.obstacles) > MAX_OBSTACLES:
            raise TooLarge("obstacles.length", len(scenario.world.obstacles), f"at most {MAX_OBSTACLES} on the page")
        self.views = [View(scenario, policy) for policy in policies]
        self.at = 0

    def _open(self, scenario: Scenario) -> list[Message]:
        """Make `scenario` the present one; this can be undone."""
        self._set_up(scenario, self.policies)
        return self._remember(scenario)

    def _remember(self, scenario: Scenario) -> list[Message]:
        self.history = [*self.history[: self.position + 1], scenario][-MAX_UNDO:]
        while len(self.history) > 1 and sum(_masks(self.history)) > MAX_UNDO_BYTES:
            del self.history[0]
        self.position = len(self.history) - 1
        return [self.describe()]

    def do_undo(self, message: Message) -> list[Message]:
        return self._go(-1)

    def do_redo(self, message: Message) -> list[Message]:
        return self._go(1)

    def _go(self, steps: int) -> list[Message]:
        position = self.position + steps
        if not 0 <= position < len(self.history):
            return []
        self._set_up(self.history[position], self.policies)
        self.position = position
        return [self.describe()]

    def do_at(self, message: Message) -> None:
        """Show an earlier moment of the run, or the latest: the run may have been started again since the page asked."""
        step = checks.integer("step", message.get("step"), low=0, high=MAX_STEPS)
        self.playing, self.at = False, min(step, self.steps)
        for view in self.views:
            view.look, view.idle = None, ""

    def do_ants(self, message: Message) -> None:
        """Run one more ant cycle in the control cycle; if no ants take part in it, play it and say why."""
        self.playing, self.at = False, self.steps
        looked = [view.look_inside() for view in self.views]
        if True not in looked:
            idle = [view.idle for view in self.views]
            self.advance()
            for view, why in zip(self.views, idle):
                view.idle = why

    def do_reset(self, message: Message) -> list[Message]:
        self.playing = False
        self._set_up(self.scenario, self.policies)
        return [self.describe()]

    def do_policies(self, message: Message) -> list[Message]:
        names = message.get("names")
        if not isinstance(names, list) or not 1 <= len(names) <= 2:
            raise BadParameter("names", names, "one or two names of policies")
        policies = tuple(checks.choice(f"names[{i}]", name, POLICIES) for i, name in enumerate(names))
        self._set_up(self.scenario, policies)
        self.policies = policies
        return [self.describe()]

    def do_scene(self, message: Message) -> list[Message]:
        self.playing = False
        return self._open(load_scenario(scene(message.get("name"))))  # type: ignore[arg-type]

    def do_open(self, message: Message) -> list[Message]:
        scenario: Scenario = self.work("upload", message.get("files"))
        self.playing = False
        return self._open(scenario)

    def do_set(self, message: Message) -> list[Message]:
        name = checks.choice("field", message.get("field"), [p.field for p in PARAMETERS])
        known = next(p for p in PARAMETERS if p.field == name)
        value: float
        if name == "robot.radius" and self.scenario.robot.footprint is not None:
            raise BadParameter(name, message.get("value"), "left as it is: this robot's footprint gives its radius")
        if name == "seed":
            value = checks.integer(name, message.get("value"), low=int(known.low), high=int(known.high))
        else:
            value = checks.number(name, message.get("value"), low=known.low, high=known.high, unit=known.unit)
        return self._open(_put(self.scenario, name, value))

    def _painted(self, message: Message) -> NDArray[np.bool_]:
        """Return which cells of the map are in `runs`, (row, first column, last column)."""
        runs, shape = message.get("runs"), self.scenario.world.grid.shape
        given = checks.array("runs", runs, (None, 3))
        if (given != np.round(given)).any() or (given < 0).any() or (given[:, [0, 2]] >= shape).any():
            raise BadParameter("runs", runs, f"runs (row, from col, to col) of the map of {shape}")
        if (given[:, 1] > given[:, 2]).any():
            raise BadParameter("runs", runs, "runs (row, from col, to col) that do not end before they begin")
        change, (row, first, last) = np.zeros((shape[0], shape[1] + 1), dtype=np.int32), given.astype(np.int64).T
        np.add.at(change, (row, first), 1)
        np.add.at(change, (row, last + 1), -1)
        return change.cumsum(axis=1)[:, :-1] > 0

    def do_paint(self, message: Message) -> list[Message]:
        blocked = checks.instance("blocked", message.get("blocked"), bool)
        painted, grid = self._painted(message), self.scenario.world.grid
        walls = np.where(painted, blocked, grid.blocked)
        unknown = None if grid.unknown is None else grid.unknown & ~painted
        return self._change(world=World(replace(grid, blocked=walls, unknown=unknown), self.scenario.world.obstacles))

    def do_move(self, message: Message) -> list[Message]:
        end = checks.choice("end", message.get("end"), ("start", "goal"))
        return self._change(**{end: checks.point("xy", message.get("xy"))})

    def do_drop(self, message: Message) -> list[Message]:
        world, limit = self.scenario.world, self.scenario.obstacle_speed
        radius = checks.number("radius", message.get("radius"), low=0.05, high=5.0, unit="m")
        motion: Line | Bounce | Waypoints
        if "points" in message:
            points = checks.array("points", message["points"], (None, 2))
            checks.integer("points.length", len(points), low=2, high=MAX_WAYPOINTS)
            speed = checks.number("speed", message.get("speed"), low=0.0, open_low=True, high=limit, unit="m/s")
            motion = Waypoints(tuple((x, y) for x, y in points.tolist()), speed)
        else:
            points = np.array([checks.point("xy", message.get("xy"))])
            (x, y), (vx, vy) = points[0].tolist(), checks.point("velocity", message.get("velocity"))
            speed = checks.number("speed", math.hypot(vx, vy), low=0.0, high=limit * (1 + 1e-9), unit="m/s")
            motion = Bounce((x, y), min(speed, limit), math.atan2(vy, vx)) if speed > 0.0 else Line((x, y), (x, y), 0.0)
        for place in points.tolist():
            if world.grid.blocked[world.grid.cell_at(place)]:
                raise BadParameter("xy", tuple(place), "where the map is free")
        return self._change(world=World(world.grid, (*world.obstacles, Obstacle(radius, motion))))

    def do_stop(self, message: Message) -> list[Message]:
        """Add a stop at a point, or remove the one there; a stop can be added to rounds in progress."""
        x, y = checks.point("xy", message.get("xy"))
        near = max(self.scenario.goal_tolerance, self.scenario.world.grid.resolution)
        kept = tuple(stop for stop in self.scenario.stops if math.dist(stop.at, (x, y)) > near)
        stops = (*kept, Stop((x, y))) if len(kept) == len(self.scenario.stops) else kept
        if len(stops) > MAX_STOPS:
            raise TooLarge("stops.length", len(stops), f"at most {MAX_STOPS} on the page")
        tours = [view.episode.tour for view in self.views if view.episode.steps and view.episode.outcome is None]
        if len(stops) == len(kept) or not tours or None in tours:
            return self._change(stops=stops)
        scenario = replace(self.scenario, stops=stops)
        for tour in tours:
            assert tour is not None
            tour.add(stops[-1])
        for view in self.views:  # one that has arrived, too: the page gets everything again
            view.added()
        self.at = self.steps
        return self._remember(scenario)

    def do_remove(self, message: Message) -> list[Message]:
        world = self.scenario.world
        k = checks.integer("obstacle", message.get("obstacle"), low=0, high=len(world.obstacles) - 1)
        return self._change(world=World(world.grid, world.obstacles[:k] + world.obstacles[k + 1 :]))

    def _change(self, **changes: Any) -> list[Message]:
        return self._open(replace(self.scenario, **changes))

    def do_export(self, message: Message) -> list[Message]:
        """Return a file of the episodes (a trace: of one view), played to their ends on copies; or the scenario or a link."""
        what = checks.choice("what", message.get("what"), ("scenario", "link", "keep", *EXPORTS))
        if what not in EXPORTS:
            return [exported_scenario(what, self.scenario, self.policies)]
        view = checks.integer("view", message.get("view", 0), low=0, high=len(self.views) - 1)
        policies = self.policies[view : view + 1] if what == "trace" or "view" in message else self.policies
        return [self.work("export", what, self.scenario, policies, seconds=EXPORT_SECONDS)]


def _masks(history: list[Scenario]) -> list[int]:
    """Return the sizes of the different maps in `history`, bytes."""
    grids = {id(one.world.grid): one.world.grid for one in history}.values()
    return [grid.blocked.nbytes * (1 if grid.unknown is None else 2) for grid in grids]


def _put(scenario: Scenario, name: str, value: float) -> Scenario:
    table, _, field = name.rpartition(".")
    changes: dict[str, Any] = {field: value}
    return replace(scenario, **({table: replace(getattr(scenario, table), **changes)} if table else changes))
