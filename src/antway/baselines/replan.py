"""Baselines that replan in every cycle: `follow`, `stop`, `replan`, `dstarlite`, `sipp`; and what other baselines share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadInput, CellBlocked
from antway.grid import Cell, Moves
from antway.kernels.base.geometry import wall_ahead
from antway.kernels.baselines.dwa import stops_clear
from antway.kernels.tracking.predict import NO_PREDICTIONS, TubeMargins, crosses_edge, predict
from antway.kernels.tracking.tubes import first_conflict
from antway.planning import Problem, TimedPath
from antway.search.distance_field import distance_field
from antway.search.dstarlite import DStarLite as Search
from antway.search.sipp import NO_SEGMENTS
from antway.search.sipp import Sipp as SpaceTime
from antway.world.line_of_sight import clear, goal_of_cells, nearest_free
from antway.world.nearby import STRAIGHT_IN, TAKEN, approach, contact_radii, keeping_velocity, now, renewed
from antway.world.policy import XY, Command, Decision, Observation, Task, commanded
from antway.world.rollouts import acting
from antway.world.terrain import terrain_of

STOP = Command((0.0, 0.0))
SHORT = 1e-6  # m; distance to a wall that a step leaves
SLOWER = (1.0, 0.75, 0.5, 0.25, 0.0)  # shares of the commanded speed that are tried before walls
FOREVER = 1e6  # s; whoever is predicted for so long stays, and a path that waits for their end is closed


class Follow:
    """Drive the shortest path over the map and avoid nothing.

    The path is exact over moves in 32 directions (A* with the exact distance field as the heuristic).
    """

    knows_inertia = False  # whether the method allows for a robot's ramps and turns itself

    def reset(self, task: Task, seed: int) -> None:
        """Prepare the distance field, for a robot with inertia with room to spare at walls if a path has that."""
        checks.instance("task", task, Task)
        checks.seed(seed)
        self.task, robot = task, task.robot
        spare = 0.0 if robot.stepwise or self.knows_inertia else robot.v_max * robot.dt / 2
        for width in sorted({robot.radius + spare, robot.radius}, reverse=True):
            self.wide = replace(task, robot=replace(robot, radius=width, footprint=None))
            try:
                self.search = SpaceTime(task.grid, goal_of_cells(self.wide), radius=width, v_max=robot.v_max)
            except BadInput:  # no room at the goal, or a radius of too many cells
                if width == robot.radius:
                    raise
                continue
            if math.isfinite(self.search.field[task.grid.cell_at(task.start)]):
                break
        self.searches = [self.search]
        self.decision = Decision("follow", "the shortest path over the map")
        self.turning = 0.0  # rad/s; turn rate of the last command of wheels

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o = acting(observation, self.task.robot)[0]
        path = self.found(o)
        if len(path.t):
            self.decide("follow", "the shortest path over the map")
        return self.braked(o, drive(self.task, o, path))

    def found(self, o: Observation) -> TimedPath:
        """Return the path over the map; if there is none, the decision says so."""
        path = self.path(o)
        if not len(path.t):
            self.decide("stuck", "the map has no path for this robot")
        return path

    def path(self, o: Observation, segments: NDArray[np.float64] = NO_SEGMENTS) -> TimedPath:
        """Return the path that arrives first from the robot's place, empty if there is none.

        If the disc around a footprint overlaps a wall, although the footprint does not, the path first leads to the nearest
        cell with room for the disc.
        """
        if self.search.stands(o.xy):
            return self._first(o.xy, o.t, segments)
        grid = self.task.grid
        centres = grid.to_xy(np.argwhere(~grid.inflate(self.search.radius).blocked))
        away = np.hypot(*(centres - o.xy).T)
        i = int(np.argmin(away))
        path = self._first(centres[i], o.t + away[i] / self.task.robot.v_max, segments)
        return TimedPath(np.append(o.t, path.t), np.vstack((o.xy, path.xy))) if len(path.t) else path

    def _first(self, start: Iterable[float], t: float, segments: NDArray[np.float64]) -> TimedPath:
        """Return that path of all searches which is first within the goal's tolerance."""
        paths = [each.search(start, t, segments).path for each in self.searches]
        return min(paths, key=lambda path: arrival_time(path, self.task))

    def target(self, o: Observation, within: float, beyond: float = 0.0) -> XY | None:
        """Return the farthest visible node of the path, at most `within` m along it, or the goal if that is visible.

        If it is nearer than `beyond` m, the first node that is not takes its place. Without a path there is no target.
        """
        path, task = self.found(o), self.task
        if not len(path.t):
            return None
        if clear(task, o.xy, task.goal):
            return task.goal
        until = o.t + within / task.robot.v_max
        nodes = [(float(x), float(y)) for t, (x, y) in zip(path.t, path.xy) if o.t + 1e-9 < t <= until]
        nodes = nodes or [path.at(until)]
        seen = next((i for i in reversed(range(len(nodes))) if clear(task, o.xy, nodes[i])), 0)
        return next((node for node in nodes[seen:] if math.dist(o.xy, node) >= beyond), nodes[-1])

    def braked(self, o: Observation, command: Command) -> Command:
        """Return a command at whose time all is observed, slowed down so that the robot can still brake before walls.

        Methods for robots without inertia need it on others. Wheels that are too near brake on the arc that was clear before.
        """
        robot = self.task.robot
        if robot.stepwise or self.knows_inertia or not clear(self.task, o.xy, o.xy):
            return command
        one, two = command.acts(o, robot)
        state, terrain = o.state_at_action(robot), terrain_of(self.task.grid)
        for share in SLOWER:
            ca, cb = share * one, two if robot.wheels else share * two
            if stops_clear(ca, cb, state, robot.limits, robot.dt, terrain):
                self.turning = cb
                return commanded(ca, cb, o.heading, robot)
        return commanded(0.0, self.turning, o.heading, robot) if robot.wheels else STOP

    def explain(self) -> Decision:
        """Return the present decision."""
        return self.decision

    def decide(self, action: str, reason: str, **more: Any) -> None:
        """Set the decision, unless it is the present one in words and about the same obstacle."""
        self.decision = renewed(self.decision, action, reason, **more)


class Avoider(Follow, ABC):
    """Steer by a method of one's own, and drive straight into the goal's tolerance if somebody stands at the goal.

    Methods that drive to the goal itself would wait for good where somebody stands so near to it that they do not come closer.
    """

    kept: float  # m; whoever stands nearer to a robot at the goal than this keeps the method from it
    at_goal: int | None = None  # who stands at the goal, if no free place within its tolerance can be reached

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        seen, obstacle, command = approach(self.task, observation, self.kept)
        self.at_goal = None if command is not None else obstacle
        o = acting(seen, self.task.robot)[0]
        if command is None:
            command = self.steer(o)
        else:
            self.decide("avoid", STRAIGHT_IN, obstacle=obstacle)
        return self.braked(o, command)

    @abstractmethod
    def steer(self, observation: Observation) -> Command:
        """Return the command of the method for the control period that begins when it acts, at which time all is observed."""

    def decide(self, action: str, reason: str, **more: Any) -> None:
        """Do as in `Follow`; the reason is that somebody stands at the goal if no place there can be reached."""
        if self.at_goal is not None:
            reason, more = TAKEN, {**more, "obstacle": self.at_goal}
        super().decide(action, reason, **more)


class Stop(Avoider):
    """Drive the shortest path over the map, and wait while an obstacle would be met on the next part of it.

    Every obstacle is assumed to keep its velocity. This is what most industrial vehicles do.

    Parameters
    ----------
    lookahead : float
        How far ahead conflicts count, s, > 0.
    margin : float
        m, >= 0.
    """

    def __init__(self, *, lookahead: float = 2.0, margin: float = 0.05) -> None:
        self.lookahead = checks.number("lookahead", lookahead, low=0.0, open_low=True, unit="s")
        self.margin = checks.number("margin", margin, low=0.0, unit="m")

    def reset(self, task: Task, seed: int) -> None:
        """Prepare the distance field."""
        super().reset(task, seed)
        self.kept = self.margin + task.grid.resolution  # paths end at the centre of a cell

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o, robot, path = observation, self.task.robot, self.found(observation)
        if not len(path.t):
            return STOP
        radius = contact_radii(o, now(o)[0], o.xy, robot, self.margin) - robot.radius
        discs = keeping_velocity(o, radius, self.lookahead)
        if first_conflict(path.t, path.xy, o.t + self.lookahead, robot.radius, 0.0, discs)[0] < math.inf:
            self.decide("wait", "an obstacle crosses the path ahead")
            return STOP
        self.decide("follow", "the path ahead is free")
        return drive(self.task, o, path)


class Sipp(Avoider):
    """Search in space and time exactly in every cycle (SIPP: Phillips, Likhachev, ICRA 2011), with predicted obstacles.

    Parameters
    ----------
    predictions : str
        "constant" (velocity), "mirrored" (constant velocity, mirrored at walls: antway's own prediction) or "frozen".
    horizon : float
        How far ahead obstacles are predicted, s, > 0, may be infinite.
    margin : float or None
        Distance kept from predicted obstacles, m; None: v_max dt / 2, the deviation from a plan between two commands.
    """

    ends_beside = True  # whether paths may end elsewhere within the goal's tolerance

    def __init__(self, *, predictions: str = "constant", horizon: float = 5.0, margin: float | None = None) -> None:
        self.predictions = checks.choice("predictions", predictions, ("constant", "mirrored", "frozen"))
        self.horizon = checks.number("horizon", horizon, low=0.0, open_low=True, infinite=True, unit="s")
        self.margin = None if margin is None else checks.number("margin", margin, low=0.0, unit="m")

    def reset(self, task: Task, seed: int) -> None:
        """Prepare the distance field."""
        super().reset(task, seed)
        if self.ends_beside:
            self.searches += within_tolerance(self.wide)
        self.edges = True  # whether obstacles are assumed to bounce off the map's edges, until one is seen to cross them
        self.clearance = task.robot.v_max * task.robot.dt / 2 if self.margin is None else self.margin
        self.kept = self.clearance + task.grid.resolution - (task.goal_tolerance if self.ends_beside else 0.0)

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o = observation
        for margin in (self.clearance, 0.0):
            path = self.path(o, self._segments(o, margin))
            if len(path.t) and path.t[-1] < o.t + FOREVER:
                self.decide("avoid", "the path that arrives first, as the obstacles are predicted")
            elif len(path.t):
                self.decide("wait", "every path is closed by what is predicted to stay there")
            if len(path.t):
                return drive(self.task, o, path)
        self.decide("brake", "there is no path")
        return STOP

    def _segments(self, o: Observation, margin: float) -> NDArray[np.float64]:
        """Return the predictions as motion segments (kernels/spacetime/segments.py)."""
        robot, horizon = self.task.robot, min(self.horizon, FOREVER)
        xy, velocity = now(o)
        n = len(xy)
        if self.predictions == "mirrored":
            out = np.empty((16 * n + 1, 8))
            estimates = np.column_stack((xy, velocity, o.tracks.radius, np.zeros((n, 3))))
            terrain = terrain_of(self.task.grid)
            seen = np.column_stack((o.tracks.xy, estimates[:, 2:]))  # not extrapolated: it may have turned back
            self.edges = self.edges and not crosses_edge(seen, terrain)
            margins = TubeMargins(robot.radius, margin, edges=self.edges)
            return out[: predict(estimates, o.t, 0.0, horizon, *o.xy, margins, terrain, NO_PREDICTIONS, out)]
        contact_radius = contact_radii(o, xy, o.xy, robot, margin)
        if self.predictions == "frozen":
            velocity = np.zeros_like(velocity)
        span = np.tile((o.t, o.t + horizon), (n, 1))
        return np.column_stack((span, xy, velocity, contact_radius, contact_radius))


class Replan(Sipp):
    """In every cycle find the shortest path with all sensed obstacles frozen; wait if there is none.

    This is what navigation stacks do that put moving obstacles into a costmap. A* finds it with an exact heuristic.

    Parameters
    ----------
    margin : float
        Distance kept from obstacles, m, >= 0.
    """

    ends_beside = False  # among frozen obstacles, paths to places beside the goal come and go as these move

    def __init__(self, *, margin: float = 0.45) -> None:
        margin = checks.number("margin", margin, low=0.0, unit="m")
        super().__init__(predictions="frozen", horizon=math.inf, margin=margin)


class DStarLite(Avoider):
    """Do as `replan` by D* Lite (Koenig, Likhachev, AAAI 2002), which repairs the last answer, over 8 neighbours.

    Parameters
    ----------
    margin : float
        Distance kept from obstacles, m, >= 0.
    """

    def __init__(self, *, margin: float = 0.2) -> None:
        self.margin = checks.number("margin", margin, low=0.0, unit="m")

    def reset(self, task: Task, seed: int) -> None:
        """Start the search at the goal."""
        super().reset(task, seed)
        size = task.grid.resolution
        self.kept = self.margin + size
        self.repair = None
        for radius in (math.hypot(task.robot.radius, size / math.sqrt(2)), task.robot.radius):  # with room to spare, or without
            self.inflated = task.grid.inflate(radius)
            start, goal = self._cell(task.start), self._cell(task.goal)
            if start is not None and goal is not None:
                self.repair = Search(Problem(self.inflated, start, goal, Moves.EIGHT))
                if math.isfinite(distance_field(self.inflated, goal)[start]):
                    break
        self.cells = np.argwhere(~self.inflated.blocked)
        self.centres = self.inflated.to_xy(self.cells)
        self.closed = np.zeros(len(self.cells), np.bool_)

    def steer(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        o = observation
        here = self._cell(o.xy)
        if self.repair is None or here is None:
            self.decide("stuck", "no free cell is near the robot, or near its goal")
            return STOP
        closed = np.zeros_like(self.closed)
        contact_radius = o.tracks.radius + self.task.robot.radius + self.margin
        for (x, y), r in zip(now(o)[0].tolist(), contact_radius.tolist()):
            closed |= np.hypot(self.centres[:, 0] - x, self.centres[:, 1] - y) < r
        for cell in (here, self.repair.problem.goal):
            closed[(self.cells == cell).all(axis=1)] = False
        self.repair.change(self.cells[self.closed & ~closed], False)
        self.repair.move(here)
        self.repair.change(self.cells[~self.closed & closed], True)
        self.closed = closed
        nodes = self.inflated.to_xy(self.repair.plan().cells)
        if not len(nodes):
            self.decide("wait", "every path is closed")
            return STOP
        self.decide("avoid", "the shortest detour around what is sensed")
        if len(nodes) == 1 or clear(self.task, o.xy, (float(nodes[1, 0]), float(nodes[1, 1]))):
            nodes = np.vstack((nodes[1:], self.task.goal))
        points = np.vstack((o.xy, nodes))
        times = np.hypot(*np.diff(points, axis=0).T) / self.task.robot.v_max
        return drive(self.task, o, TimedPath(o.t + np.concatenate(([0.0], np.cumsum(times))), points))

    def _cell(self, xy: XY) -> Cell | None:
        """Return the nearest free cell that can be reached in a straight line."""
        return nearest_free(self.task.grid, self.inflated, xy, 2, self.task.robot.radius)


def searches_for(task: Task) -> list[SpaceTime]:
    """Return the search to the goal's cell, and that of `within_tolerance`."""
    return [
        SpaceTime(task.grid, goal_of_cells(task), radius=task.robot.radius, v_max=task.robot.v_max),
        *within_tolerance(task),
    ]


def within_tolerance(task: Task) -> list[SpaceTime]:
    """Return the search to the first of the cells within the goal's tolerance, if there are any."""
    robot, tolerance = task.robot, task.goal_tolerance
    with suppress(CellBlocked):  # cells may be larger than the tolerance
        return [SpaceTime(task.grid, task.goal, radius=robot.radius, v_max=robot.v_max, goal_tolerance=tolerance)]
    return []


def arrival_time(path: TimedPath, task: Task) -> float:
    """Return when a motion comes within the tolerance of the goal, s, infinite if empty.

    From its end the motion leads straight to the goal, which is not tested for contacts.
    """
    t, xy, goal, tolerance = path.t, path.xy, task.goal, task.goal_tolerance
    if not len(t):
        return math.inf
    if math.dist(xy[0], goal) <= tolerance:
        return float(t[0])
    t, xy = np.append(t, t[-1] + math.dist(xy[-1], goal) / task.robot.v_max), np.vstack((xy, goal))
    for i in range(1, len(t)):
        step, away = xy[i] - xy[i - 1], xy[i - 1] - goal
        a, b, c = float(step @ step), float(step @ away), float(away @ away) - tolerance**2
        square = b * b - a * c
        passes_by = b < 0.0 <= square and -b - math.sqrt(square) <= a
        if passes_by or math.dist(xy[i], goal) <= tolerance:
            fraction = (-b - math.sqrt(max(square, 0.0))) / a
            return float(t[i - 1] + fraction * (t[i] - t[i - 1]))
    raise AssertionError("the motion ends at the goal")


def drive(task: Task, o: Observation, path: TimedPath) -> Command:
    """Return the command that takes the robot to where `path` is at the end of the control period.

    If the straight line there would touch a wall, the command leads only to the next corner of the path.
    """
    if not len(path.t):
        return STOP
    end, dt, last = o.t + task.robot.dt, task.robot.dt, tuple(path.xy[-1].tolist())
    # The path ends at the centre of the goal's cell. From there, or if that is behind the robot, go to the goal.
    back = math.dist(o.xy, task.goal) < math.dist(last, task.goal)
    there = path.t[-1] - (math.dist(o.xy, last) / task.robot.v_max if back else 0.0)
    target = task.goal if end >= there and clear(task, o.xy, task.goal) else path.at(end)
    if not clear(task, o.xy, target):
        i = min(int(np.searchsorted(path.t, o.t + 1e-9, side="right")), len(path.t) - 1)
        target = (float(path.xy[i, 0]), float(path.xy[i, 1]))
    vx, vy = (target[0] - o.xy[0]) / dt, (target[1] - o.xy[1]) / dt
    speed = math.hypot(vx, vy)
    if speed > task.robot.v_max:
        vx, vy = vx * task.robot.v_max / speed, vy * task.robot.v_max / speed
    return Command((vx, vy))


def short_of_walls(task: Task, o: Observation, vx: float, vy: float) -> Command:
    """Return the command (vx, vy) in m/s, limited to full speed, and slowed down before walls."""
    robot = task.robot
    speed = math.hypot(vx, vy)
    if speed > robot.v_max:
        vx, vy, speed = vx * robot.v_max / speed, vy * robot.v_max / speed, robot.v_max
    if speed == 0.0:
        return STOP
    span = robot.dt + speed / (2 * robot.braking)
    share, _, _ = wall_ahead(terrain_of(task.grid), *o.xy, vx * span, vy * span, robot.radius)
    if share <= 1.0:
        # As the braking distance is v^2 / 2a, a proportional reduction of v is enough for any a.
        share = max(share - SHORT / (speed * span), 0.0)
        vx, vy = vx * share, vy * share
    return Command((vx, vy))
