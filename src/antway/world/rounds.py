"""Rounds: any policy drives a robot from stop to stop, in an order that is revised when the situation changes."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence, Set
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadParameter
from antway.grid import Cell, Grid
from antway.kernels.base.jit import compile_seconds
from antway.kernels.colony.held_karp import earliest_of_few
from antway.search.distance_field import distance_field
from antway.tours.distances import stop_distances
from antway.tours.ordering import Ordering, order_stops
from antway.world.policy import Command, Decision, Observation, Policy, Task
from antway.world.stops import XY, Rounds, Stop, Turn, Visit

FEW = 13  # number of stops up to which a dynamic program finds the order in about 5 ms
CYCLES = 2  # cycles of the colony for more stops
MANY = 40  # number of stops beyond which only local search improves the last order, in a fraction of the time
SHAKES = 8  # cycles of that local search for MANY stops; for more stops fewer cycles, so that it takes no longer
PACE = 0.85  # mean speed of a robot among obstacles, as a share of its top speed
STAY = 1.0  # s; the robot should arrive at a stop when it can stand there for this time
REVIEW = 1.0  # s; period at which the order is reviewed
STANDS, FORGOTTEN = 3.0, 30.0  # s; an obstacle counts as a wall once it stood, and until it was unseen, for these times
EARLIER, LESS_LATE = 3.0, 0.5  # s; another order is taken if it ends this much earlier, or is this much less late
DETOUR = 1.0  # m; growth of the path to a stop from which the order is revised
SLOW = 0.05  # m/s; a slower obstacle counts as standing


class RoundsPolicy:
    """A policy that visits stops, and drives to each of them by another policy.

    The order minimises first the lateness and then the end time, with travel times at 0.85 of the top speed. It is revised at
    each departure; when the robot becomes late; when an obstacle that has stood for 3 s blocks the path to the next stop or
    makes it longer; and when a stop is added. The robot takes another order only if that avoids lateness, is 0.5 s less late or
    ends 3 s earlier. For up to 13 stops a dynamic program finds the order; for more the colony continues from its last answer.

    Parameters
    ----------
    policy : Policy
        Drives the robot.
    stops : sequence of Stop

    Attributes
    ----------
    homeward : bool
        Whether all stops have been visited and the robot is on its way to the goal.
    order_ms : list of float
        Time of each decision on the order, ms.
    """

    def __init__(self, policy: Policy, stops: Sequence[Stop]) -> None:
        self.policy, self.stops = policy, list(stops)
        self.order_ms: list[float] = []
        self.homeward = False

    @property
    def rounds(self) -> Rounds:
        """The record so far."""
        return Rounds(tuple(self.stops), tuple(self.visits), tuple(self.turns))

    def reset(self, task: Task, seed: int) -> None:
        """Decide on the first order, and start."""
        self.task, self.seed = task, seed
        self.visits: list[Visit] = []
        self.turns: list[Turn] = []
        self.order: list[int] = []
        self.left = list(range(len(self.stops)))
        self.known: tuple[tuple[int, ...], Ordering] | None = None  # the colony's last answer, and its stops
        self.standing: dict[int, tuple[float, float, float, float, float]] = {}  # by id: since, last seen, x, y, radius
        self.walls: frozenset[int] = frozenset()
        self.promised: tuple[float, float] = (0.0, 0.0)  # s; lateness and end time of the chosen order
        self.at: int | None = None  # the stop at which the robot is
        self.arrived = self.served = self.started = 0.0
        self.looked, self.legs, self.homeward = 0.0, 0, False
        self.now, self.xy = 0.0, task.start
        self.free = task.grid.inflate(task.robot.radius)
        self.around = self.free  # the free cells without standing obstacles
        self._explained: tuple[Decision | None, Decision] | None = None
        self._away = self._distances(self.free)
        self._decide("the first order", first=True)
        self._set_out()

    def add(self, stop: Stop) -> None:
        """Add a stop."""
        cell = self._cell(self.free, stop.at)
        if not math.isfinite(float(distance_field(self.free, self._cell(self.free, self.xy), until=cell)[cell])):
            raise BadParameter("stop", stop.at, "where a path leads")
        self.stops.append(stop)
        self.left.append(len(self.stops) - 1)
        self._away, self.homeward = self._distances(self.free), False
        before = self._target
        self._decide(f"{stop.name or 'a stop'} was added")
        if self.at is None and self._target != before:
            self._set_out()

    def act(self, observation: Observation) -> Command:
        """Return the command of the policy on the way to the next stop, or during service."""
        self.now, self.xy = observation.t, observation.xy
        self._watch(observation)
        if self.at is None and self.order and self._near(self.order[0]):
            self.at, self.arrived, self.served = self.order[0], self.now, 0.0
        if self.at is not None:
            self._serve()
        elif self.now - self.looked >= REVIEW:
            self._review()
        return self.policy.act(observation)

    def explain(self) -> Decision:
        """Return the decision of the policy, with the next stop."""
        inner = self.policy.explain()
        if self._explained is None or self._explained[0] is not inner:
            if self.at is not None:
                words, action = self._name(self.at), "arrived"
                early = self.stops[self.at].window[0]
                what = f"waits at {words} until {early:g} s" if early > self.now else f"at {words}"
                shown = replace(inner, action=action, reason=f"{what}; {inner.reason}")
            else:
                words = self._name(self.order[0]) if self.order else "the end"
                shown = replace(inner, reason=f"to {words}: {inner.reason}")
            self._explained = inner, shown
        return self._explained[1]

    def _name(self, stop: int) -> str:
        return self.stops[stop].name or "the next stop"

    def _near(self, stop: int, tolerances: float = 1.0) -> bool:
        return math.dist(self.xy, self.stops[stop].at) <= tolerances * self.task.goal_tolerance

    @property
    def _target(self) -> XY:
        return self.stops[self.order[0]].at if self.order else self.task.goal

    def _serve(self) -> None:
        """Wait for the window and serve while the robot is at the stop; then continue."""
        assert self.at is not None
        stop = self.stops[self.at]
        serves_from = max(self.arrived, stop.window[0])
        if self.now > serves_from and self._near(self.at, 2.0):  # after a step aside, service continues
            self.served += min(self.task.robot.dt, self.now - serves_from)
        if self.now < serves_from or self.served < stop.service - 1e-9:
            return
        self.visits.append(Visit(self.at, self.arrived, serves_from, self.now))
        self.left.remove(self.at)
        self.order.remove(self.at)
        self.at = None
        self._decide(f"{stop.name or 'a stop'} is done")
        self._set_out()

    def _set_out(self) -> None:
        """Let the policy drive to the next stop, or to the end."""
        self.homeward, self.started, self._explained = not self.left, self.now, None
        self.legs += 1
        task = replace(self.task, grid=self._seen(), start=self.xy, goal=self._target, stay=STAY if self.order else 0.0)
        self.policy.reset(task, (self.seed + self.legs - 1) % 2**64)

    def _watch(self, observation: Observation) -> None:
        """Record which obstacles stand, and since when."""
        tracks, now = observation.tracks, self.now
        for k in range(len(tracks)):
            number, (x, y) = int(tracks.id[k]), tracks.xy[k].tolist()
            old = self.standing.get(number)
            moved = math.hypot(*tracks.velocity[k].tolist()) > SLOW or (old is not None and math.dist((x, y), old[2:4]) > 0.2)
            since = now if old is None or moved else old[0]
            self.standing[number] = since, now, x, y, float(tracks.radius[k])
        self.standing = {number: one for number, one in self.standing.items() if now - one[1] < FORGOTTEN}

    def _review(self) -> None:
        """Revise the order if the path to the next stop has changed, or if the robot is late."""
        self.looked = self.now
        walls = frozenset(number for number, one in self.standing.items() if one[1] - one[0] >= STANDS)
        reason = ""
        if walls != self.walls:
            before = self._distance(self.around)
            self.walls, self.around = walls, self._with(walls)
            if abs(self._distance(self.around) - before) > DETOUR:
                reason = f"obstacle {min(walls)} stands in the way" if walls else "the path is free again"
        late, done = self._outlook(self.order)
        turned = bool(reason)
        if (
            not reason
            and self.order
            and (late > 0.0 == self.promised[0] or late > self.promised[0] + LESS_LATE or done > self.promised[1] + EARLIER)
        ):
            reason = f"{max(late - self.promised[0], done - self.promised[1]):.0f} s late"
            self.promised = late, done
        if reason:
            aim = self._target
            self._decide(reason)
            if turned or self._target != aim:
                self._set_out()

    def _with(self, walls: frozenset[int]) -> Grid:
        """Return the free cells in which the robot does not touch a standing obstacle."""
        return self._marked(self.free, walls & self.standing.keys(), self.task.robot.radius)

    def _seen(self) -> Grid:
        """Return the map with the cells that are completely inside standing obstacles blocked.

        Obstacles at the robot's place or destination are left out, because no policy plans to a place inside a wall, and they
        may move on.
        """
        grid, ends, apart = self.task.grid, (self.xy, self._target), set()
        for number in self.walls & self.standing.keys():
            _, _, x, y, radius = self.standing[number]
            if min(math.dist((x, y), end) for end in ends) >= radius + self.task.robot.radius + grid.resolution:
                apart.add(number)
        return self._marked(grid, apart, -0.71 * grid.resolution)  # half the diagonal of a cell

    def _marked(self, grid: Grid, walls: Set[int], wider: float) -> Grid:
        """Return `grid` with cells blocked whose centre is within the radius plus `wider` m of one of these obstacles."""
        if not walls:
            return grid
        rows, cols = np.indices(grid.shape)
        blocked = grid.blocked.copy()
        for number in walls:
            _, _, x, y, radius = self.standing[number]
            row, col = grid.to_points([(x, y)])[0]
            blocked |= np.hypot(rows - row, cols - col) < (radius + wider) / grid.resolution
        return replace(grid, blocked=blocked)

    def _distance(self, around: Grid) -> float:
        """Return the length of the path to the next stop, m."""
        here, there = self._cell(around, self.xy), self._cell(around, self._target)
        return float(min(distance_field(around, there, until=here)[here], 1e9))

    def check(self, task: Task) -> None:
        """Raise an error that names the first stop to which no path leads."""
        free = task.grid.inflate(task.robot.radius)
        field = distance_field(free, self._cell(free, task.start))
        for k, stop in enumerate(self.stops):
            if not math.isfinite(float(field[self._cell(free, stop.at)])):
                raise BadParameter(
                    f"stops[{k}]" + (f" ({stop.name})" if stop.name else ""), stop.at, "where a path leads from the start"
                )

    @staticmethod
    def _cell(grid: Grid, xy: XY) -> Cell:
        """Return the cell at `xy`, or the nearest free one."""
        row, col = grid.cell_at(xy)
        if not grid.blocked[row, col]:
            return row, col
        for span in (8, 32, max(grid.shape)):
            r0, c0 = max(row - span, 0), max(col - span, 0)
            free = np.argwhere(~grid.blocked[r0 : row + span + 1, c0 : col + span + 1])
            if len(free):
                near = free[np.argmin(np.hypot(free[:, 0] + r0 - row, free[:, 1] + c0 - col))]
                return int(near[0]) + r0, int(near[1]) + c0
        return row, col

    def _distances(self, grid: Grid) -> NDArray[np.float64]:
        """Return the path lengths among all stops and, last, the goal, m."""
        cells = [self._cell(grid, place) for place in (*(stop.at for stop in self.stops), self.task.goal)]
        return stop_distances(grid, cells)

    def _times(self, stops: Sequence[int]) -> NDArray[np.float64]:
        """Return the travel times among the present place, `stops` and the goal, s."""
        away = self._away if self.around is self.free else self._distances(self.around)
        rows = [*stops, len(self.stops)]
        field = distance_field(self.around, self._cell(self.around, self.xy))
        times = np.zeros((len(rows) + 1, len(rows) + 1))
        times[1:, 1:] = away[np.ix_(rows, rows)]
        places = (*(self.stops[stop].at for stop in stops), self.task.goal)
        times[0, 1:] = times[1:, 0] = [field[self._cell(self.around, place)] for place in places]
        result: NDArray[np.float64] = times / (PACE * self.task.robot.v_max)
        return result

    def _outlook(self, order: Sequence[int], times: NDArray[np.float64] | None = None) -> tuple[float, float]:
        """Return total lateness and end time if the robot visits `order` from here, s.

        Row k + 1 of `times` is the k-th stop of `order`. Without `times`, only the path from here is measured again.
        """
        scale = PACE * self.task.robot.v_max
        now, late = self.now, 0.0
        for k, stop in enumerate(order):
            if times is not None:
                now += float(times[k, k + 1])
            elif k == 0:
                now += self._distance(self.around) / scale
            else:
                now += float(self._away[order[k - 1], stop]) / scale
            early, latest = self.stops[stop].window
            now = max(now, early)
            late += max(0.0, now - latest)
            now += self.stops[stop].service
        if times is not None:
            home = float(times[len(order), len(order) + 1])
        else:
            home = float(self._away[order[-1] if order else -1, -1]) / scale
        return late, now + home

    def _decide(self, reason: str, first: bool = False) -> None:
        """Search for the best order of the remaining stops, and take it if it is clearly better."""
        compiled, started = compile_seconds(), time.perf_counter()
        if self.left:
            times = self._times(self.left)
            reachable = [k for k in range(len(self.left)) if math.isfinite(times[0, k + 1])]
            lost = [stop for k, stop in enumerate(self.left) if k not in reachable]  # unreachable now, so they come last
            rows = [0, *(k + 1 for k in reachable), len(self.left) + 1]
            stops = [self.left[k] for k in reachable]
            found = [stops[k] for k in self._best(stops, times[np.ix_(rows, rows)])] if stops else []
            place = {stop: k + 1 for k, stop in enumerate(self.left)}
            kept = [stop for stop in self.order if stop not in lost]
            better = first or set(kept) != set(found)
            if not better:
                new, old = (
                    self._outlook(order, times[np.ix_(*2 * [[0, *(place[s] for s in order), -1]])]) for order in (found, kept)
                )
                better = new[0] == 0.0 < old[0] or new[0] < old[0] - LESS_LATE
                better |= new[0] <= old[0] and new[1] < old[1] - EARLIER
            order = [*(found if better else kept), *lost]
            if order != self.order or not self.turns:
                self.turns.append(Turn(self.now, tuple(order), reason))
            self.order = order
            chosen = order[: len(order) - len(lost)]
            self.promised = self._outlook(chosen, times[np.ix_(*2 * [[0, *(place[s] for s in chosen), -1]])])
        self.order_ms.append((time.perf_counter() - started - (compile_seconds() - compiled)) * 1e3)

    def _known(self, stops: Sequence[int]) -> Ordering | None:
        """Return the colony's last answer for `stops`: the present order, and the pheromone."""
        if self.known is None:
            return None
        before, last = self.known
        place = {stop: k + 1 for k, stop in enumerate(stops)}
        order = np.array([0, *(place[stop] for stop in self.order if stop in place), len(stops) + 1], dtype=np.int32)
        learned = None
        if last.pheromone is not None:
            learned = np.full((len(stops) + 2, len(stops) + 2), float(last.pheromone.mean()))
            rows = [0, *(k + 1 for k, stop in enumerate(before) if stop in place), len(before) + 1]
            now = [0, *(place[stop] for stop in before if stop in place), len(stops) + 1]
            learned[np.ix_(now, now)] = last.pheromone[np.ix_(rows, rows)]
        return replace(last, orders=(order,), pheromone=learned)

    def _best(self, stops: Sequence[int], times: NDArray[np.float64]) -> list[int]:
        """Return the best order of `stops` as indices; `times` starts with the present place and ends with the goal."""
        windows = np.array([self.stops[stop].window for stop in stops])
        service = np.array([self.stops[stop].service for stop in stops])
        times = np.where(np.isfinite(times), times, 1e6)
        if len(stops) <= FEW:
            return [int(k) for k in earliest_of_few(np.ascontiguousarray(times), windows, service, self.now)]
        ahead = np.clip(windows - self.now, 0.0, None)
        ahead[windows[:, 1] < self.now, 1] = np.inf  # a missed window counts no more; the stop is visited anyway
        always = np.array([[0.0, np.inf]])
        found = order_stops(
            times,
            end=len(stops) + 1,
            windows=np.vstack((always, ahead, always)),
            service=np.r_[0.0, service, 0.0],
            objective="makespan",
            cycles=CYCLES if len(stops) <= MANY else max(1, SHAKES * MANY // len(stops)),
            seed=self.seed,
            initial=self._known(stops),
            quick=len(stops) > MANY,
        )
        self.known = tuple(stops), found
        return [int(row) - 1 for row in found.orders[0][1:-1]]
