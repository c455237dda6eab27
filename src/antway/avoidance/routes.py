"""Ways of a disc robot on the map as chains of nodes: found by Dijkstra, joined, timed, and driven exactly."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.errors import OutOfBounds
from antway.grid import Cell, Grid, Moves
from antway.kernels.field import STRAIGHT, descend
from antway.kernels.geometry import segment_hits_cells
from antway.planning import TimedPath
from antway.search.derived import lattice
from antway.search.dijkstra import Wave
from antway.world.policy import XY, Command, Observation, Task

STOP = Command((0.0, 0.0))
Nodes = NDArray[np.float64]  # float64[N, 2], m: a chain of points still to be driven to, the robot's own place not among them


class Ways:
    """Shortest ways between one cell and all cells within some way (m) of it, found at once by Dijkstra's algorithm."""

    def __init__(self, room: Grid, cell: Cell, within: float = math.inf) -> None:
        self.room, self.net = room, lattice(room, Moves.EIGHT)
        self.wave = Wave(self.net, [cell], [], within / room.resolution)
        self.wave.run(None)

    def distance(self) -> NDArray[np.float64]:
        """Return the way to each cell in m, float64[H, W]; infinite for those not reached."""
        label = self.wave.label
        known = np.where(label <= self.wave.known, label, np.inf) * (self.room.resolution / STRAIGHT)
        return known.reshape(self.room.shape)

    def nodes(self, cell: Cell) -> Nodes:
        """Return the centres of the cells on the way from `cell` to the one cell; empty if there is none."""
        at, net = self.net.at(cell), self.net
        if not self.wave.label[at] <= self.wave.known:
            return np.empty((0, 2))
        flat = descend(net.around, net.table, net.offsets, self.wave.label, at)
        return self.room.to_xy(np.column_stack(np.divmod(flat, net.width)))


class Routes:
    """The static side of a task.

    Attributes
    ----------
    room : Grid
        The map inflated so that the robot's disc fits on every legal move between its free cells. On cells at least as wide as
        the robot that is the plain inflation; on finer ones a diagonal dips towards a corner by at most half its length.
    """

    def __init__(self, task: Task) -> None:
        radius, size = task.robot.radius, task.grid.resolution
        self.task = task
        self.room = task.grid.inflate(radius if size >= 2 * radius else math.hypot(radius, size / math.sqrt(2)))
        goal = self.cell(task.goal)
        self.home = None if goal is None else Ways(self.room, goal)
        self.stops = task.robot.drive == "differential" or task.robot.a_max * task.robot.dt < 2 * task.robot.v_max

    def clear(self, a: XY, b: XY) -> bool:
        """Tell whether the robot can drive straight from `a` to `b` among the map's walls."""
        grid = self.task.grid
        (ar, ac), (br, bc) = grid.to_points((a, b)).tolist()
        return not segment_hits_cells(grid.blocked, ar, ac, br, bc, self.task.robot.radius / grid.resolution, True)

    def cell(self, xy: XY) -> Cell | None:
        """Return the cell from which ways from `xy` begin: free, in straight reach, and the nearest such."""
        try:
            row, col = self.task.grid.cell_at(xy)
        except OutOfBounds:
            return None
        around = [(row + i, col + j) for i in range(-3, 4) for j in range(-3, 4)]
        free = [cell for cell in around if self.room.is_free(cell)]
        free.sort(key=lambda cell: (math.dist(self.room.centre(cell), xy), cell))
        return next((cell for cell in free if self.clear(xy, self.room.centre(cell))), None)

    def to_goal(self, xy: XY) -> Nodes:
        """Return the shortest way from `xy` to the goal (Step 2: Dijkstra); empty if there is none."""
        here = self.cell(xy)
        nodes = np.empty((0, 2)) if here is None or self.home is None else self.home.nodes(here)
        return np.vstack((self.joined(xy, nodes), self.task.goal)) if len(nodes) else nodes

    def joined(self, xy: XY, nodes: Nodes) -> Nodes:
        """Return `nodes`, a way that begins at the centre of a cell near `xy`, without that centre where `xy` sees the next."""
        if len(nodes) > 1 and self.clear(xy, (float(nodes[1, 0]), float(nodes[1, 1]))):
            return nodes[1:]
        return nodes

    def timed(self, t: float, xy: XY, nodes: Nodes, hold: float = 0.0) -> TimedPath:
        """Return the motion that stands at `xy` from `t` for `hold` s and then drives along `nodes` at full speed."""
        points = np.vstack((xy, xy, nodes)) if hold > 0.0 else np.vstack((xy, nodes))
        times = np.hypot(*np.diff(points, axis=0).T) / self.task.robot.v_max
        if hold > 0.0:
            times[0] = hold
        return TimedPath(t + np.concatenate(([0.0], np.cumsum(times))), points)

    @staticmethod
    def length(xy: XY, nodes: Nodes) -> float:
        """Return the length of the way from `xy` along `nodes`, m."""
        return float(np.hypot(*np.diff(np.vstack((xy, nodes)), axis=0).T).sum())

    @staticmethod
    def ahead(xy: XY, nodes: Nodes) -> Nodes:
        """Return `nodes` without those that the robot at `xy` has reached or passed, the last apart."""
        i = 0
        while i < len(nodes) - 1 and (
            math.dist(xy, nodes[i].tolist()) < 1e-6 or _straight(nodes[i].tolist(), xy, nodes[i + 1].tolist())
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
            # The chord over a corner would touch a wall: drive to the corner and no farther.
            here, rest = (float(nodes[0, 0]), float(nodes[0, 1])), nodes[1:]
        return Command(((here[0] - seen.xy[0]) / dt, (here[1] - seen.xy[1]) / dt)), rest if len(rest) else nodes[-1:]

    def _to_corner(self, seen: Observation, nodes: Nodes) -> Command:
        """Drive straight to the next corner and stop there: a robot with inertia or one that must turn keeps on its way so."""
        spec = self.task.robot
        i = 0
        while i + 1 < len(nodes) and _straight(seen.xy, nodes[i].tolist(), nodes[i + 1].tolist()):
            i += 1
        x, y = nodes[i].tolist()
        way = math.dist(seen.xy, (x, y))
        if way < 1e-9:
            return STOP
        ux, uy = (x - seen.xy[0]) / way, (y - seen.xy[1]) / way
        aside = abs(ux * seen.velocity[1] - uy * seen.velocity[0])
        if aside > 1e-6 or ux * seen.velocity[0] + uy * seen.velocity[1] < -1e-6:
            return STOP
        if spec.drive == "differential" and math.cos(seen.heading) * ux + math.sin(seen.heading) * uy < 1.0 - 1e-12:
            return Command((ux * 1e-6, uy * 1e-6)) if math.hypot(*seen.velocity) < 1e-6 else STOP
        # Fastest speed v with v dt + v^2 / 2a <= way, so that it can still stop at the corner.
        speed = way / spec.dt
        if math.isfinite(spec.a_max):
            gain = spec.a_max * spec.dt
            speed = min(speed, 2 * way * spec.a_max / (gain + math.sqrt(gain * gain + 2 * spec.a_max * way)))
        speed = min(speed, spec.v_max)
        return Command((ux * speed, uy * speed))


def _straight(a: XY, b: XY, c: XY) -> bool:
    """Tell whether b lies between a and c on a straight line."""
    cross = (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0])
    along = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return along >= 0.0 and abs(cross) <= 1e-9 * (math.dist(a, b) * math.dist(b, c) + 1e-12)
