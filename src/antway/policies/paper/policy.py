"""Policy `paper`: Dijkstra on the known map, and ants around moving obstacles in the sensed window (Steps 1-8 of the paper).

Beyond the printed steps the robot waits if that is shorter, steps back if it is boxed in, and if nothing is free takes the
velocity that delays contact longest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from antway import checks
from antway.ants.gridpath import BETA, Exploration, explore
from antway.ants.persistence import Adaptive
from antway.grid import Cell, Grid, Moves
from antway.kernels.base.arrays import Bools
from antway.kernels.tracking.tubes import first_conflict
from antway.limits import MAX_AHEAD
from antway.planning import Problem, Status, TimedPath
from antway.policies.encounter import closest_approach, encounter
from antway.policies.guard import Guard, check_observation
from antway.policies.paper.local_target import local_target
from antway.policies.paper.routes import STOP, Nodes, PathsFrom, StaticRoutes
from antway.policies.paper.tubes import Ahead, Tubes
from antway.world.ants import AntStep, LaidTrails
from antway.world.nearby import STRAIGHT_IN, TAKEN, approach, renewed
from antway.world.policy import XY, Command, Decision, Observation, Task, Tracks
from antway.world.rollouts import acting

WAITS = 0.5  # s; step between the waiting times that are compared, and pause between two searches for a detour while waiting
NEAR = 2.0  # s; a conflict later than this, for which no detour is known yet, does not make the robot stop
REFUGES = 30  # number of cells to step back to that are tried
_REMEMBERED = 1.0  # s; the last place of a track that was not seen for longer is forgotten
Costs = tuple[tuple[str, float], ...]
Window = tuple[int, int, int, int]  # row and column of the corner, and numbers of rows and columns


@dataclass(frozen=True, slots=True, eq=False)
class Detour:
    """A detour that ants found: its nodes to the goal, the local target and the colony's pheromone."""

    nodes: Nodes
    target: XY
    reason: str
    found: Exploration


class PaperPolicy:
    """The paper's method. Step 1: parameters; 2: `reset`; 3: `act`; 4-7: `_detour`; 8: continue along the path, `_drive`.

    Parameters
    ----------
    ants, cycles : int
        Size of the colony and number of its cycles, >= 1.
    margin : float
        Distance kept from predicted obstacles, m, >= 0.
    growth : float
        How fast that distance grows with the time predicted, m/s, >= 0.
    lookahead : float
        How far ahead motion is predicted, s, > 0, at most 1000.
    heuristic : str
        Heuristic of the ants: "goal", the paper's eta = 1 / d with the straight distance to the local target; "distance",
        1 / exact distance; "field", the detour of the move, with which they find the shortest path in their first cycle.
    alpha, beta : float or None
        Exponents of pheromone and heuristic in Eq. (1), in [0, 100]; None: 1 for the one, 7 or 8 for the other.
    distance_weight : float
        Cost of a metre besides its time, s/m, >= 0: the paper's least distance weighed against its least time.
    """

    nodes: Nodes  # the path from the robot on
    held: float  # s; the robot stands until then
    retreating: bool  # whether the nodes lead to a refuge, not to the goal

    def __init__(
        self,
        *,
        ants: int = 30,
        cycles: int = 20,
        margin: float = 0.15,
        growth: float = 0.03,
        lookahead: float = 5.0,
        heuristic: str = "goal",
        alpha: float | None = None,
        beta: float | None = None,
        distance_weight: float = 0.0,
    ) -> None:
        self.ants, self.cycles = checks.integer("ants", ants, low=1), checks.integer("cycles", cycles, low=1)
        self.margin = checks.number("margin", margin, low=0.0, unit="m")
        self.growth = checks.number("growth", growth, low=0.0, unit="m/s")
        self.lookahead = checks.number("lookahead", lookahead, low=0.0, high=MAX_AHEAD, open_low=True, unit="s")
        self.heuristic = checks.choice("heuristic", heuristic, BETA)
        for name, value in (("alpha", alpha), ("beta", beta)):
            if value is not None:
                checks.number(name, value, low=0.0, high=100.0)
        self.alpha, self.beta = alpha, beta
        self.distance_weight = checks.number("distance_weight", distance_weight, low=0.0, unit="s/m")

    def reset(self, task: Task, seed: int) -> None:
        """Steps 1 and 2: find the shortest path over the known map with Dijkstra's algorithm."""
        checks.instance("task", task, Task)
        checks.seed(seed)
        self.routes = StaticRoutes(task)
        self.guard = Guard() if self.routes.stops else None  # the paper's robot stops and turns at once and needs no guard
        if self.guard is not None:
            self.guard.reset(task)
        self._start(task, seed)

    def depart(self, task: Task, seed: int) -> None:
        """Do as `reset` for another task of the same robot; the guard keeps its certified stop and its tracks."""
        self.routes = StaticRoutes(task)
        if self.guard is not None:
            self.guard.set_robot(task)
        self._start(task, seed)

    def _start(self, task: Task, seed: int) -> None:
        """Take the shortest path from the start, and forget obstacles and ants."""
        self.seed, self.spec = checks.seed(seed), task.robot
        self.wider = self.margin + (self.spec.v_max * self.spec.stop_time / 2 if self.routes.stops else 0.0)
        self.kept = self.wider + self.growth * self.lookahead + task.grid.resolution
        self.path = self.routes.to_goal(task.start)
        self.path_cells = set(map(tuple, self.routes.cells(self.path).tolist()))
        self._take(self.path)
        self.asked = -math.inf  # s; time of the latest comparison of detours and waits
        self.here = task.start  # m; where the robot was in the latest cycle
        self.colonies = 0
        self.found: Exploration | None = None  # by the last colony
        self.places: dict[int, tuple[float, float, float, float, float]] = {}  # of each track: t, x, y, vx, vy
        if len(self.nodes):
            path = self.routes.timed(Observation(0.0, task.start, (0.0, 0.0), 0.0, Tracks.none()), self.nodes)
            self.decision = Decision("follow", "the shortest path over the map", path=path)
        else:
            self.decision = Decision("stuck", "the map has no path to the goal for this robot")

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period; for a robot with inertia or wheels it has passed the guard.

        Raises
        ------
        BadParameter
            If the observation is not finite.
        """
        observation = check_observation(observation)
        self.here = observation.xy
        seen, obstacle, command = approach(self.routes.task, observation, self.kept)
        if command is not None:
            self._take(np.array([self.here]), retreating=True)  # if they go away, the robot rejoins its path from there
            self.decision = renewed(self.decision, "avoid", STRAIGHT_IN, obstacle=obstacle)
        else:
            command = self._steer(acting(seen, self.spec)[0])
            if obstacle is not None:
                self.decision = renewed(self.decision, self.decision.action, TAKEN, obstacle=obstacle)
        if self.guard is not None:
            command = self.guard.passed(observation, command)
            if self.guard.did != self.decision.guard:
                self.decision = replace(self.decision, guard=self.guard.did)
        return command

    def _steer(self, observation: Observation) -> Command:
        """Step 3: look ahead along the path; if an obstacle will be met, take a detour, wait or step back; else continue."""
        if not len(self.nodes):
            return STOP
        now = observation.t
        ahead = self._look(observation)
        if self.retreating:
            home = self._home(observation.xy)
            if len(home) and self._free(ahead, home, longer=self.lookahead / 2):
                self._resume(observation, home)
        self.nodes = self.routes.ahead(observation.xy, self.nodes)
        if self.routes.astray(observation, self.nodes):
            home = self._home(observation.xy)
            if not len(home):  # the nodes stay, for when the robot's place is right again
                self.decision = renewed(self.decision, "stuck", "no path leads back to the shortest one")
                return STOP
            self._resume(observation, home)
        when, obstacle = self._conflict(ahead, self.nodes)
        if when == math.inf:
            if self.decision.action in ("wait", "brake", "step-aside", "stuck") and not self.retreating:
                self._resume(observation, self.nodes)
            self.held = -math.inf
            return self._drive(observation)
        if self.held > now and now < self.asked + WAITS and self._free(ahead, self.nodes, self.held - now):
            return self._drive(observation)
        if self.held == -math.inf and when > now + NEAR and now < self.asked + WAITS and not self.retreating:
            return self._drive(observation)
        return self._choose(ahead, when, obstacle)

    def explain(self) -> Decision:
        """Return the present decision."""
        return self.decision

    def use_common_memory(self) -> None:
        """Do nothing: this policy's colonies keep no memory from one search to the next."""

    def step_ants(self, cycles: int, act: Callable[[], object]) -> AntStep:
        """Return the result of the control cycle that `act` plays, with at most `cycles` ant cycles."""
        before, most = self.colonies, self.cycles
        self.cycles = min(cycles, most)
        try:
            act()
        finally:
            self.cycles = most
        found, decision = self.found, self.decision
        if found is None or self.colonies == before:
            idle = "No ants in this control cycle: policy paper uses them only for a detour around an obstacle ahead."
            return AntStep(idle, True, decision)
        nodes = np.vstack((self.here, found.plan.xy(self.routes.inflated)))  # whether or not this path was taken
        path = TimedPath(np.arange(len(nodes), dtype=np.float64), nodes)
        decision = replace(decision, path=path, pheromone=(*found.window[:2], found.pheromone_by_cell), history=found.history)
        done = cycles >= most or len(found.history) < cycles
        return AntStep("", done, decision)

    def trails(self) -> LaidTrails:
        """Return the pheromone of the last colony on moves between cells, where it is more than the least on any."""
        found, none, grid = self.found, np.empty((0, 2)), self.routes.task.grid
        if found is None:
            return LaidTrails(none, none, np.empty(0))
        tau = found.pheromone
        least = tau.min(initial=np.inf, where=tau > 0.0)
        row, col, move = np.nonzero(tau > 1.01 * least)
        here = np.column_stack((row + found.window[0], col + found.window[1]))
        there = here + Moves.EIGHT.offsets[move]
        return LaidTrails(grid.to_xy(here), grid.to_xy(there), tau[row, col, move])

    def _look(self, seen: Observation) -> Ahead:
        """Predict the range of motion of every track; a missing velocity is that between its last two places, or none."""
        tracks, velocity = seen.tracks, seen.tracks.velocity.copy()
        now = seen.sensed_at if seen.sensed_at > -math.inf else seen.t
        self.places = {number: place for number, place in self.places.items() if now - place[0] <= _REMEMBERED}
        for k, (number, (x, y)) in enumerate(zip(tracks.id.tolist(), tracks.xy.tolist())):
            t, px, py, vx, vy = self.places.get(number, (now, x, y, 0.0, 0.0))
            if now > t:
                vx, vy = (x - px) / (now - t), (y - py) / (now - t)
            if not np.isfinite(velocity[k]).all():
                velocity[k] = (vx, vy) if number >= 0 else (0.0, 0.0)
            self.places[number] = now, x, y, vx, vy
        discs = np.column_stack((tracks.xy, velocity, tracks.radius))
        tubes = Tubes.predict(seen.t, now, discs, self.routes.task.grid, 2 * self.lookahead)
        inflated = self.wider
        if len(tracks):
            gaps = np.hypot(tracks.xy[:, 0] - seen.xy[0], tracks.xy[:, 1] - seen.xy[1]) - tracks.radius - self.spec.radius
            inflated = max(min(inflated, float(gaps.min()) - 0.01), 0.0)
        return Ahead(seen, tubes, self.spec.radius + inflated, velocity, seen.t + self.lookahead, self.growth)

    def _home(self, xy: XY) -> Nodes:
        """Return the path from `xy`, which is off the global path, that rejoins it and continues along it."""
        return self.routes.rejoining(xy, self.path, self.lookahead * self.spec.v_max)

    def _conflict(self, ahead: Ahead, nodes: Nodes, hold: float = 0.0, longer: float = 0.0) -> tuple[float, int]:
        return ahead.conflict(self.routes.timed(ahead.seen, nodes, hold), ahead.until + hold + longer)

    def _free(self, ahead: Ahead, nodes: Nodes, hold: float = 0.0, longer: float = 0.0) -> bool:
        return self._conflict(ahead, nodes, hold, longer)[0] == math.inf

    def _choose(self, ahead: Ahead, when: float, obstacle: int) -> Command:
        """Resolve a coming conflict by whatever costs the least time: a detour, a wait, or a step back."""
        seen, length = ahead.seen, self.routes.length
        self.asked = seen.t
        waits = np.arange(WAITS, self.lookahead, WAITS).tolist()
        wait = next((w for w in waits if not self.retreating and self._free(ahead, self.nodes, w)), math.inf)
        path = self._home(seen.xy) if self.retreating else self.nodes
        detour, extra = self._detour(ahead, when, path), math.inf
        if detour is not None:
            more = length(seen.xy, detour.nodes) - length(seen.xy, path)
            extra = more * (1.0 / self.spec.v_max + self.distance_weight)
        costs = ((f"wait {wait:g} s" if wait < math.inf else "wait", wait), ("go round", max(extra, 0.0)))
        if detour is not None and extra <= wait:
            self._take(detour.nodes)
            self._decide("avoid", f"ants found a detour; local target: {detour.reason}", ahead, obstacle, costs, detour)
        elif when > seen.t + NEAR and not self.retreating and (wait == math.inf or self.held == -math.inf):
            self.held = -math.inf  # the conflict is so late that much may change before it
        elif wait < math.inf:
            self.held = seen.t + wait
            self._decide("wait", f"waiting {wait:g} s is shorter than any detour", ahead, obstacle, costs)
        elif (refuge := self._refuge(ahead)) is not None:
            self._take(refuge, retreating=True)
            self._decide("step-back", "boxed in: to the nearest place that stays free", ahead, obstacle, costs)
        else:
            return self._last_resort(ahead, obstacle, costs)
        return self._drive(seen)

    def _detour(self, ahead: Ahead, when: float, route: Nodes) -> Detour | None:
        """Steps 4-7: ants search the sensed window for a path to a local target; only those that arrive deposit pheromone.

        `route` is the path on which the conflict was found; of its nodes those on the global path can be local targets.
        """
        seen, spec, routes, inflated = ahead.seen, self.spec, self.routes, self.routes.inflated
        here = routes.cell(seen.xy)
        if here is None or not len(route):
            return None
        sensing_range = min(spec.sensor_range, self.lookahead * spec.v_max)
        window = _window(inflated, here, sensing_range)
        cells = routes.cells(route)
        inside = ((cells >= window[:2]) & (cells < np.add(window[:2], window[2:]))).all(axis=1)
        count = len(route) if inside.all() else int(np.argmin(inside))
        route, cells, rest = route[:count], cells[:count], route[count:]
        on_path = np.array([tuple(cell) in self.path_cells for cell in cells.tolist()], dtype=bool)
        if not on_path.any():
            return None
        beyond = 0.0 if self.retreating else (when - seen.t) * spec.v_max
        for whole in (False, True):
            closed = ahead.tubes.close(
                inflated, window, seen.xy, spec.v_max, ahead.body + self.margin / 2, self.lookahead, whole=whole
            )
            taken = closed[cells[:, 0], cells[:, 1]]
            i, reason = local_target(route, taken, on_path, beyond, seen.xy, sensing_range, lambda p: routes.clear(seen.xy, p))
            target = (int(cells[i, 0]), int(cells[i, 1]))
            if target == here or closed[target] or not inflated.is_free(target):
                continue
            found = self._explore(Problem(inflated, here, target), window, closed)
            if found.plan.status is Status.NO_PATH or not len(found.plan.cells):
                continue
            for joins, nodes in self._joined(found.plan.xy(inflated), np.vstack((route[i:], rest))):
                nodes = routes.joined(seen.xy, nodes)
                for candidate in (routes.pulled(seen.xy, nodes), nodes) if routes.stops else (nodes,):
                    if self._free(ahead, candidate):
                        return Detour(candidate, joins, reason, found)
        return None

    def _explore(self, problem: Problem, window: Window, closed: Bools) -> Exploration:
        """Send a colony of ants through the open cells of the window."""
        self.colonies += 1
        self.found = explore(
            problem,
            seed=(self.seed + self.colonies) % 2**64,
            persistence=Adaptive(),
            ants=self.ants,
            cycles=self.cycles,
            heuristic=self.heuristic,
            alpha=self.alpha,
            beta=self.beta,
            stop_at_bound=self.heuristic == "field",
            window=window,
            forbidden=closed,
        )
        return self.found

    def _joined(self, found: Nodes, onward: Nodes) -> Iterator[tuple[XY, Nodes]]:
        """Yield the ants' path to the first of the nodes `onward`, joined to these, with the node where they join.

        If it meets the global path beyond its target on the way there, the first path joins there, to avoid driving back.
        """
        later = {cell: k for k, cell in enumerate(map(tuple, self.routes.cells(onward).tolist())) if cell in self.path_cells}
        for n, cell in enumerate(map(tuple, self.routes.cells(found).tolist())):
            k = later.get(cell, 0)
            if k > 0:
                x, y = onward[k].tolist()
                yield (x, y), np.vstack((found[:n], onward[k:]))
                break
        x, y = onward[0].tolist()
        yield (x, y), np.vstack((found[:-1], onward))

    def _refuge(self, ahead: Ahead) -> Nodes | None:
        """Return the path to the nearest cell where the robot can stand for a long time, or else for now."""
        seen, routes, v_max = ahead.seen, self.routes, self.spec.v_max
        here = routes.cell(seen.xy)
        if here is None:
            return None
        found_paths = PathsFrom(routes.inflated, here, self.lookahead * v_max)
        field = found_paths.distance()
        cells = np.argwhere(np.isfinite(field))
        cells = cells[np.argsort(field[cells[:, 0], cells[:, 1]], kind="stable")]
        there, xy = seen.t + field[cells[:, 0], cells[:, 1]] / v_max, routes.inflated.to_xy(cells)
        for until in (ahead.until + self.lookahead, ahead.until):
            for row, col in cells[ahead.tubes.standing(there, xy, until, ahead.body, self.growth, REFUGES)].tolist():
                nodes = routes.joined(seen.xy, found_paths.nodes((row, col))[::-1])
                nodes = routes.pulled(seen.xy, nodes) if routes.stops else nodes
                if ahead.conflict(routes.timed(seen, nodes), until)[0] == math.inf:
                    return nodes
        return None

    def _last_resort(self, ahead: Ahead, obstacle: int, costs: Costs) -> Command:
        """If nothing is free, take the velocity that delays contact longest; rest comes first among equals."""
        seen, spec = ahead.seen, self.spec
        push = max(spec.dt, 0.3) + (math.pi / 2 / spec.turn_rate if spec.drive == "differential" else 0.0)
        best, velocity = -math.inf, (0.0, 0.0)
        for k in range(17):
            angle, speed = 2 * math.pi * k / 16, spec.v_max if k else 0.0
            v = (speed * math.cos(angle), speed * math.sin(angle))
            path = self.routes.driven(seen, v, push if k else 0.0)
            if path is not None:
                discs = ahead.tubes.trajectories
                contact, _ = first_conflict(path.t, path.xy, ahead.until, spec.radius + 0.02, 0.0, discs)
                if contact > best:
                    best, velocity = contact, v
        self._take(np.array([seen.xy]), retreating=True)
        action = "brake" if velocity == (0.0, 0.0) else "step-aside"
        self._decide(action, "nothing is free: contact is put off as long as can be", ahead, obstacle, costs)
        return Command(velocity)

    def _decide(
        self, action: str, reason: str, ahead: Ahead, obstacle: int, costs: Costs, detour: Detour | None = None
    ) -> None:
        """Record the decision, the encounter at the present velocity, and the colony's pheromone."""
        seen, tracks, spec = ahead.seen, ahead.seen.tracks, self.spec
        aim = self.nodes[0].tolist()
        to_aim = math.dist(seen.xy, aim)
        velocity = seen.velocity
        if to_aim:
            velocity = (aim[0] - seen.xy[0]) / to_aim * spec.v_max, (aim[1] - seen.xy[1]) / to_aim * spec.v_max
        (x, y), (vx, vy) = tracks.xy[obstacle].tolist(), ahead.velocity[obstacle].tolist()
        time, distance = closest_approach(seen.xy, velocity, (x, y), (vx, vy))
        colony = None if detour is None else detour.found
        self.decision = Decision(
            action,
            reason,
            obstacle=int(tracks.id[obstacle]),
            encounter=encounter(velocity, (vx, vy)),
            time_to_closest=time,
            distance_at_closest=distance - spec.radius - float(tracks.radius[obstacle]),
            alternatives=costs,
            predicted=ahead.tubes.rows(),
            path=self.routes.timed(seen, self.nodes) if action in ("avoid", "step-back") else None,
            local_target=None if detour is None else detour.target,
            pheromone=None if colony is None else (*colony.window[:2], colony.pheromone_by_cell),
            history=None if colony is None else colony.history,
        )

    def _take(self, nodes: Nodes, *, retreating: bool = False) -> None:
        """Drive along `nodes` from now on, without a wait."""
        self.nodes, self.held, self.retreating = nodes, -math.inf, retreating

    def _resume(self, seen: Observation, nodes: Nodes) -> None:
        """Take the path `nodes` to the goal, which is free."""
        self._take(nodes)
        path = self.routes.timed(seen, nodes)
        self.decision = Decision("follow", "the path is free again", path=path)

    def _drive(self, seen: Observation) -> Command:
        """Step 8: continue exactly along the path, or stand while the robot has to wait."""
        if self.held > seen.t:
            return STOP
        command, self.nodes = self.routes.passed(seen, self.nodes)
        return command


def _window(grid: Grid, here: Cell, half: float) -> Window:
    """Return the window of the grid that extends `half` m from the cell `here` to each side."""
    cells = math.ceil(half / grid.resolution)
    row, col = (max(here[k] - cells, 0) for k in (0, 1))
    rows, cols = (min(here[k] + cells + 1, grid.shape[k]) - low for k, low in enumerate((row, col)))
    return row, col, rows, cols
