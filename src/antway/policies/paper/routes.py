"""Paths of a disc on the map as chains of nodes: found by Dijkstra, joined, timed, and driven exactly."""

from __future__ import annotations

import math

import numpy as np

from antway.grid import Cell, Grid, Moves
from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.jit import entry
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.motion import REST
from antway.kernels.search.distance_field import STRAIGHT
from antway.planning import TimedPath
from antway.search.derived import lattice
from antway.search.distance_field import DijkstraField
from antway.world.line_of_sight import clear, diagonal_radius, nearest_free
from antway.world.nearby import fastest_to_stop
from antway.world.policy import XY, Command, Observation, Task

STOP = Command((0.0, 0.0))
Nodes = Floats  # float64[N, 2], m; points that the robot has yet to drive to, without its own position


class PathsFrom:
    """Shortest paths between one cell and all cells within a distance (m) of it, by one run of Dijkstra's algorithm."""

    def __init__(self, inflated: Grid, cell: Cell, within: float = math.inf) -> None:
        self.inflated, self.net = inflated, lattice(inflated, Moves.EIGHT)
        self.field = DijkstraField(self.net, [cell], [], within / inflated.resolution)
        self.field.run(None)

    def distance(self) -> Floats:
        """Return the distance to each cell in m, float64[H, W]; infinite for cells that were not reached."""
        label = self.field.label
        known = np.where(label <= self.field.known, label, np.inf) * (self.inflated.resolution / STRAIGHT)
        return known.reshape(self.inflated.shape)

    def nodes(self, cell: Cell) -> Nodes:
        """Return the cell centres on the path from `cell` to the source cell; empty if there is none."""
        return self.inflated.to_xy(self.cells(cell))

    def cells(self, cell: Cell) -> Ints:
        """Return the cells on that path, int64[N, 2]."""
        label = self.field.label[self.net.at(cell)]
        if not (math.isfinite(label) and label <= self.field.known):
            return np.empty((0, 2), np.int64)
        return self.field.path_from(cell).astype(np.int64)


class StaticRoutes:
    """The static side of a task; its map is inflated by `diagonal_radius`."""

    def __init__(self, task: Task) -> None:
        self.task = task
        self.inflated = task.grid.inflate(diagonal_radius(task))
        goal = self.cell(task.goal)
        self.home = None if goal is None else PathsFrom(self.inflated, goal)
        robot = task.robot
        self.stops = robot.wheels or not robot.stepwise or robot.a_max * robot.dt < 2 * robot.v_max

    def clear(self, a: XY, b: XY) -> bool:
        """Tell whether the robot can drive straight from `a` to `b` among the map's walls."""
        return clear(self.task, a, b)

    def cell(self, xy: XY) -> Cell | None:
        """Return the cell at which paths from `xy` start: the nearest free one that can be reached straight."""
        return nearest_free(self.task.grid, self.inflated, xy, 3, self.task.robot.radius)

    def to_goal(self, xy: XY) -> Nodes:
        """Return the shortest path from `xy` to the goal (Step 2: Dijkstra); empty if there is none."""
        here = self.cell(xy)
        nodes = np.empty((0, 2)) if here is None or self.home is None else self.home.nodes(here)
        if not len(nodes):
            return nodes
        nodes = np.vstack((self.joined(xy, nodes), self.task.goal))
        return self.pulled(xy, nodes) if self.stops else nodes

    def cells(self, nodes: Nodes) -> Ints:
        """Return the (row, col) of the cells that contain `nodes`, int64[N, 2]."""
        cells: Ints = np.floor(self.inflated.to_points(nodes) + 0.5).astype(np.int64)
        return cells

    def rejoining(self, xy: XY, path: Nodes, within: float) -> Nodes:
        """Return the path from `xy`, which is off `path`, to one of its nodes and on along it; empty if there is none.

        It is the shortest one over all nodes, or one that joins earlier and is longer by less than the edge of a cell. Nodes
        within `within` m are tried first.
        """
        here = self.cell(xy)
        if here is None or not len(path):
            return np.empty((0, 2))
        cells = self.cells(path)
        steps = np.hypot(*np.diff(path, axis=0).T)
        onward = np.concatenate((np.cumsum(steps[::-1])[::-1], [0.0]))
        for farthest in (within, math.inf):
            found = PathsFrom(self.inflated, here, farthest)
            away = found.distance()[cells[:, 0], cells[:, 1]]
            whole = away + onward
            if np.isfinite(whole).any():
                k = int(np.argmin(np.where(whole < whole.min() + self.inflated.resolution, away, np.inf)))
                nodes = np.vstack((found.nodes((int(cells[k, 0]), int(cells[k, 1])))[:0:-1], path[k:]))
                nodes = self.joined(xy, nodes)
                return self.pulled(xy, nodes) if self.stops else nodes
        return np.empty((0, 2))

    def joined(self, xy: XY, nodes: Nodes) -> Nodes:
        """Return `nodes`, which start at the centre of a cell near `xy`, without that centre if `xy` sees the next."""
        if len(nodes) > 1 and self.clear(xy, (float(nodes[1, 0]), float(nodes[1, 1]))):
            return nodes[1:]
        return nodes

    def pulled(self, xy: XY, nodes: Nodes) -> Nodes:
        """Return `nodes` without those that are not needed: each leg, from `xy` on, leads as far along them as is clear."""
        points, kept, here = [xy, *map(tuple, nodes.tolist())], [], 0
        while here < len(nodes):
            there = here + 1
            while there < len(nodes) and self.clear(points[here], points[there + 1]):
                there += 1
            kept.append(points[there])
            here = there
        return np.array(kept)

    def timed(self, seen: Observation, nodes: Nodes, hold: float = 0.0) -> TimedPath:
        """Return the motion that stands for `hold` s and then drives along `nodes`, as fast as this robot can."""
        points = np.vstack((seen.xy, nodes))
        if self.stops:
            times, points = self._stop_and_go(seen, points)
        else:
            times = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T) / self.task.robot.v_max)))
        if hold > 0.0:
            times, points = np.concatenate(([0.0], hold + times)), np.vstack((seen.xy, points))
        return TimedPath(seen.t + times, points)

    def _stop_and_go(self, seen: Observation, points: Nodes) -> tuple[Floats, Nodes]:
        """Return times and positions of a robot that stops and turns at each corner: six knots for each leg."""
        spec = self.task.robot
        legs = np.diff(points, axis=0)
        points = points[np.concatenate(([True], np.hypot(*legs.T) > 1e-9))]
        legs = np.diff(points, axis=0)
        angle = np.arctan2(legs[:, 1], legs[:, 0])
        corner = np.concatenate(([True], np.abs(np.sin(np.diff(angle) / 2)) > 1e-6, [True])) if len(legs) else np.array([True])
        points = points[corner]
        if len(points) == 1:
            return np.zeros(1), points
        angle = angle[corner[:-1]]
        path = np.diff(points, axis=0)
        length = np.hypot(*path.T)
        along = math.cos(angle[0]) * seen.velocity[0] + math.sin(angle[0]) * seen.velocity[1]
        speed = math.hypot(*seen.velocity)
        on = speed - along < 1e-6  # it already drives along the first leg; else it stops first
        start = np.zeros(len(path))
        start[0] = along if on else 0.0
        pause = np.full(len(path), 2.0 * spec.dt)
        pause[0] = 0.0 if on else speed / spec.braking
        if spec.drive == "differential":
            turn = np.diff(np.concatenate(([seen.heading], angle)))
            pause += np.abs(turn - 2 * math.pi * np.round(turn / (2 * math.pi))) / spec.turn_rate
        top = np.full(len(path), spec.v_max)
        if math.isfinite(spec.a_max) or math.isfinite(spec.braking):
            # It speeds up over (v^2 - start^2) / 2a and brakes over v^2 / 2b; together at most the length of the leg.
            fastest = (length + start**2 / (2.0 * spec.a_max)) / (0.5 / spec.a_max + 0.5 / spec.braking)
            top = np.maximum(np.minimum(np.sqrt(fastest), top), start)
        up, down = (top - start) / spec.a_max, top / spec.braking
        gained, lost = (start + top) / 2 * up, top / 2 * down
        cruise = np.maximum(length - gained - lost, 0.0) / top
        half_up = (start + (start + top) / 2) / 2 * up / 2
        spans = np.column_stack((pause, up / 2, up / 2, cruise, down / 2, down / 2))
        done = np.column_stack((0 * length, half_up, gained, length - lost, length - lost / 4, length))
        share = np.minimum(np.maximum(done, 0.0), length[:, None]) / length[:, None]
        places = points[:-1, None, :] + share[:, :, None] * path[:, None, :]
        return np.concatenate(([0.0], np.cumsum(spans.ravel()))), np.vstack((points[:1], places.reshape(-1, 2)))

    def driven(self, seen: Observation, velocity: XY, push: float) -> TimedPath | None:
        """Return the motion of a robot that drives at `velocity` for `push` s and then stops; None if it meets a wall."""
        spec = self.task.robot
        (x, y), (vx, vy), heading, n = seen.xy, seen.velocity, seen.heading, 0
        limits = spec.limits
        step = entry(drive, 0.0, 0.0, 0.0, 0.0, 0.0, limits, spec.dt)
        points = [seen.xy]
        while n * spec.dt < push or math.hypot(vx, vy) > REST:
            cx, cy = velocity if n * spec.dt < push else (0.0, 0.0)
            vx, vy, heading = step(vx, vy, heading, cx, cy, limits, spec.dt)
            x, y, n = x + vx * spec.dt, y + vy * spec.dt, n + 1
            if not self.clear(points[-1], (x, y)):
                return None
            points.append((x, y))
        return TimedPath(seen.t + spec.dt * np.arange(n + 1, dtype=np.float64), np.array(points))

    @staticmethod
    def length(xy: XY, nodes: Nodes) -> float:
        """Return the length of the path from `xy` along `nodes`, m."""
        return float(np.hypot(*np.diff(np.vstack((xy, nodes)), axis=0).T).sum())

    @staticmethod
    def ahead(xy: XY, nodes: Nodes) -> Nodes:
        """Return `nodes` without those that the robot at `xy` has reached or passed; the last one always stays."""
        points, i = nodes.tolist(), 0
        while i < len(points) - 1 and (
            math.dist(xy, points[i]) < 1e-6
            or _straight(points[i], xy, points[i + 1])
            or _straight(points[i], points[i + 1], xy)  # it has come by several nodes in one period
        ):
            i += 1
        return nodes[i:]

    def passed(self, seen: Observation, nodes: Nodes) -> tuple[Command, Nodes]:
        """Return the command that drives along `nodes` for one control period, and the nodes left to drive to after it."""
        if self.stops:
            nodes = self.ahead(seen.xy, nodes)
            return self._to_corner(seen, nodes), nodes
        left, dt = self.task.robot.v_max * self.task.robot.dt, self.task.robot.dt
        here, rest = seen.xy, nodes
        while len(rest):
            x, y = rest[0].tolist()
            leg = math.dist(here, (x, y))
            if leg > left:
                here = (here[0] + (x - here[0]) * left / leg, here[1] + (y - here[1]) * left / leg)
                break
            if len(rest) < len(nodes) and not self.clear(seen.xy, (x, y)):
                break
            here, left, rest = (x, y), left - leg, rest[1:]
        if not self.clear(seen.xy, here):
            # The chord over a corner would touch a wall, so drive only to the corner.
            here, rest = (float(nodes[0, 0]), float(nodes[0, 1])), nodes[1:]
        return Command(((here[0] - seen.xy[0]) / dt, (here[1] - seen.xy[1]) / dt)), rest if len(rest) else nodes[-1:]

    def astray(self, seen: Observation, nodes: Nodes) -> bool:
        """Tell whether the robot does not see the next of `nodes` and can turn, at once or because it has stopped."""
        x, y = nodes[0].tolist()
        return (not self.stops or math.hypot(*seen.velocity) < 1e-6) and not self.clear(seen.xy, (x, y))

    def _to_corner(self, seen: Observation, nodes: Nodes) -> Command:
        """Drive straight to the next corner and stop there, so that a robot with inertia or wheels keeps to its path."""
        spec = self.task.robot
        i = 0
        while i + 1 < len(nodes) and _straight(seen.xy, nodes[i].tolist(), nodes[i + 1].tolist()):
            i += 1
        x, y = nodes[i].tolist()
        path = math.dist(seen.xy, (x, y))
        if path < 1e-9 or not self.clear(seen.xy, (x, y)):
            return STOP
        ux, uy = (x - seen.xy[0]) / path, (y - seen.xy[1]) / path
        aside = abs(ux * seen.velocity[1] - uy * seen.velocity[0])
        if aside > 1e-6 or ux * seen.velocity[0] + uy * seen.velocity[1] < -1e-6:
            return STOP
        if spec.drive == "differential" and math.cos(seen.heading) * ux + math.sin(seen.heading) * uy < 1.0 - 1e-12:
            return Command((ux * 1e-6, uy * 1e-6)) if math.hypot(*seen.velocity) < 1e-6 else STOP
        speed = fastest_to_stop(spec, path)
        return Command((ux * speed, uy * speed))


def _straight(a: XY, b: XY, c: XY) -> bool:
    """Tell whether b is between a and c on a straight line."""
    cross = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
    along = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return along >= 0.0 and abs(cross) <= 1e-9 * (math.dist(a, b) * math.dist(b, c) + 1e-12)
