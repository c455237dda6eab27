"""The order in which a robot visits its stops: travel times on the present map, and the search for the best order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from antway.errors import BadParameter
from antway.grid import Cell, Grid
from antway.kernels.base.arrays import Floats
from antway.kernels.colony.held_karp import earliest_of_few
from antway.search.distance_field import distance_field
from antway.tours.distances import stop_distances
from antway.tours.ordering import Ordering, order_stops
from antway.world.policy import XY, Task
from antway.world.stops import Stop

FEW = 13  # stops; for so many or fewer, a dynamic program finds the best order in about 5 ms
MANY = 40  # stops; beyond this number only local search improves the last order, in a fraction of the colony's time
CYCLES = 2  # cycles of the colony for more than FEW stops
SHAKES = 8  # cycles of the local search for MANY stops; more stops get fewer cycles, so that the search takes no longer
PACE = 0.85  # mean speed of a robot among obstacles, as a fraction of its top speed
LESS_LATE = 0.5  # s; by how much lateness has to change before the robot takes another order
EARLIER = 3.0  # s; by how much the end has to change before the robot takes another order, if neither is late
_FAR = 1e9  # m; length of a path that does not exist, where only its change counts
_UNREACHABLE = 1e6  # s; travel time in place of an infinite one, for the search


class OrderOutlook(NamedTuple):
    """What an order promises if the robot follows it from now on."""

    lateness: float  # s; sum over the remaining stops
    end: float  # s; time of arrival at the goal

    def clearly_better_than(self, other: OrderOutlook) -> bool:
        """Tell whether it avoids all lateness, is clearly less late, or is not later and ends clearly earlier."""
        less_late = self.lateness == 0.0 < other.lateness or self.lateness < other.lateness - LESS_LATE
        return less_late or (self.lateness <= other.lateness and self.end < other.end - EARLIER)

    def clearly_worse_than(self, promised: OrderOutlook) -> bool:
        """Tell whether the robot is late for the first time, or clearly later than it was promised."""
        later = self.lateness > 0.0 == promised.lateness or self.lateness > promised.lateness + LESS_LATE
        return later or self.end > promised.end + EARLIER


class OrderPlanner:
    """Finds the order in which a robot visits its stops on the way to its goal.

    More stops may be appended to the list; then `measure` has to be called. The map `inflated` is so by the robot's radius;
    `present` is the same with the obstacles that stand on it now, set by the owner.
    """

    def __init__(self, task: Task, stops: list[Stop], seed: int) -> None:
        self.task, self.stops, self.seed = task, stops, seed
        self.inflated = self.present = task.grid.inflate(task.robot.radius)
        self.speed = PACE * task.robot.v_max
        self.answer: tuple[tuple[int, ...], Ordering] | None = None  # the colony's last answer, and the stops it was for
        self.measure()

    def measure(self) -> None:
        """Measure the distances among all stops and, last, the goal, on the map without moving obstacles."""
        self.distances = self._distances(self.inflated)

    def _distances(self, grid: Grid) -> Floats:
        places = [*(stop.at for stop in self.stops), self.task.goal]
        return stop_distances(grid, [nearest_cell(grid, place) for place in places])

    def occupied(self, place: XY) -> bool:
        """Tell whether standing obstacles keep the robot farther from a place than the goal's tolerance."""
        near, now = (self.present.centre(nearest_cell(grid, place)) for grid in (self.inflated, self.present))
        return math.dist(near, now) > self.task.goal_tolerance

    def path_length(self, start: XY, end: XY) -> float:
        """Return the length of the present path, m; very long if there is none, or the end is occupied."""
        if self.occupied(end):
            return _FAR
        source, target = nearest_cell(self.present, start), nearest_cell(self.present, end)
        return float(min(distance_field(self.present, target, until=source)[source], _FAR))

    def leads_to(self, start: XY, end: XY) -> bool:
        """Tell whether there is a path on the map without moving obstacles."""
        source, target = nearest_cell(self.inflated, start), nearest_cell(self.inflated, end)
        return math.isfinite(float(distance_field(self.inflated, source, until=target)[target]))

    def travel_times(self, xy: XY, remaining: Sequence[int]) -> Floats:
        """Return the present travel times among the place `xy`, the remaining stops in this order and the goal, s."""
        distances = self.distances if self.present is self.inflated else self._distances(self.present)
        rows = [*remaining, len(self.stops)]
        field = distance_field(self.present, nearest_cell(self.present, xy))
        lengths = np.zeros((len(rows) + 1, len(rows) + 1))
        lengths[1:, 1:] = distances[np.ix_(rows, rows)]
        places = [*(self.stops[stop].at for stop in remaining), self.task.goal]
        lengths[0, 1:] = lengths[1:, 0] = [field[nearest_cell(self.present, place)] for place in places]
        times: Floats = lengths / self.speed
        return times

    def outlook(self, xy: XY, now: float, order: Sequence[int]) -> OrderOutlook:
        """Return what an order of at least one stop promises at time `now`, s.

        Only the path from `xy` to the first stop is measured anew; the others are those without moving obstacles.
        """
        lengths = [self.path_length(xy, self.stops[order[0]].at), *self.distances[order, [*order[1:], -1]].tolist()]
        return self._followed(order, [length / self.speed for length in lengths], now)

    def _followed(self, order: Sequence[int], legs: Sequence[float], now: float) -> OrderOutlook:
        """Return the outlook of an order with these travel times to each stop and, last, to the goal, s."""
        lateness = 0.0
        for stop, leg in zip(order, legs, strict=False):
            earliest, latest = self.stops[stop].window
            now = max(now + leg, earliest)
            lateness += max(0.0, now - latest)
            now += self.stops[stop].service
        return OrderOutlook(lateness, now + legs[-1])

    def improve(self, xy: XY, now: float, remaining: Sequence[int], order: Sequence[int]) -> tuple[list[int], OrderOutlook]:
        """Search for the best order of the remaining stops, and take it in place of `order` if it is clearly better.

        Stops that cannot be reached at present, or are occupied, come last, and the outlook leaves them out.
        """
        times = self.travel_times(xy, remaining)
        row = {stop: k + 1 for k, stop in enumerate(remaining)}
        reachable = [
            stop for stop in remaining if math.isfinite(times[0, row[stop]]) and not self.occupied(self.stops[stop].at)
        ]
        unreachable = [stop for stop in remaining if stop not in reachable]
        kept = [stop for stop in order if stop not in unreachable]
        rows = [0, *(row[stop] for stop in reachable), -1]
        found = self._best(reachable, times[np.ix_(rows, rows)], now, order) if reachable else []

        def outlook(stops: Sequence[int]) -> OrderOutlook:
            rows = [0, *(row[stop] for stop in stops), -1]
            return self._followed(stops, times[rows[:-1], rows[1:]].tolist(), now)

        better = set(kept) != set(found) or outlook(found).clearly_better_than(outlook(kept))
        chosen = found if better else kept
        return [*chosen, *unreachable], outlook(chosen)

    def _best(self, stops: Sequence[int], times: Floats, now: float, order: Sequence[int]) -> list[int]:
        """Return the best order of `stops`; `times` starts with the present place and ends with the goal."""
        windows = np.array([self.stops[stop].window for stop in stops])
        service = np.array([self.stops[stop].service for stop in stops])
        times = np.where(np.isfinite(times), times, _UNREACHABLE)
        if len(stops) <= FEW:
            return [stops[k] for k in earliest_of_few(np.ascontiguousarray(times), windows, service, now)]
        ahead = np.clip(windows - now, 0.0, None)
        ahead[windows[:, 1] < now, 1] = np.inf  # a missed window counts no more; the stop is visited anyway
        always = np.array([[0.0, np.inf]])
        found = order_stops(
            times,
            end=len(stops) + 1,
            windows=np.vstack((always, ahead, always)),
            service=np.r_[0.0, service, 0.0],
            objective="makespan",
            cycles=CYCLES if len(stops) <= MANY else max(1, SHAKES * MANY // len(stops)),
            seed=self.seed,
            initial=self.continued(stops, order),
            quick=len(stops) > MANY,
        )
        self.answer = tuple(stops), found
        return [stops[row - 1] for row in found.orders[0][1:-1]]

    def continued(self, stops: Sequence[int], order: Sequence[int]) -> Ordering | None:
        """Return the colony's last answer for other stops: `order` as far as it visits them, and what is known of pheromone."""
        if self.answer is None:
            return None
        before, last = self.answer
        row = {stop: k + 1 for k, stop in enumerate(stops)}
        rows = np.array([0, *(row[stop] for stop in order if stop in row), len(stops) + 1], dtype=np.int32)
        learned = None
        if last.pheromone is not None:
            learned = np.full((len(stops) + 2, len(stops) + 2), float(last.pheromone.mean()))
            old = [0, *(k + 1 for k, stop in enumerate(before) if stop in row), len(before) + 1]
            new = [0, *(row[stop] for stop in before if stop in row), len(stops) + 1]
            learned[np.ix_(new, new)] = last.pheromone[np.ix_(old, old)]
        return replace(last, orders=(rows,), pheromone=learned)


def check_reachable(task: Task, stops: Sequence[Stop]) -> None:
    """Raise an error that names the first stop to which no path leads from the start."""
    inflated = task.grid.inflate(task.robot.radius)
    field = distance_field(inflated, nearest_cell(inflated, task.start))
    for k, stop in enumerate(stops):
        if not math.isfinite(float(field[nearest_cell(inflated, stop.at)])):
            name = f"stops[{k}]" + (f" ({stop.name})" if stop.name else "")
            raise BadParameter(name, stop.at, "where a path leads from the start")


def nearest_cell(grid: Grid, xy: XY) -> Cell:
    """Return the cell at `xy`, m, or the nearest free one."""
    row, col = grid.cell_at(xy)
    if not grid.blocked[row, col]:
        return row, col
    for span in (8, 32, max(grid.shape)):
        r0, c0 = max(row - span, 0), max(col - span, 0)
        free = np.argwhere(~grid.blocked[r0 : row + span + 1, c0 : col + span + 1])
        away = np.hypot(free[:, 0] + r0 - row, free[:, 1] + c0 - col)
        if len(free) and (away.min() <= span or span == max(grid.shape)):  # farther ones may not be in a corner of the square
            near = free[away.argmin()]
            return int(near[0]) + r0, int(near[1]) + c0
    return row, col
