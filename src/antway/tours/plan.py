"""A tour on a map: distances among the stops, their best order, and a path for each leg."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Cell, Grid, Moves
from antway.lazy import drawing
from antway.planning import Plan, Problem, solve
from antway.search.astar import astar
from antway.tours.distances import stop_distances
from antway.tours.ordering import Ordering, order_stops
from antway.tours.stops import MAX_TIME
from antway.tours.task import Floats, TourTask


@dataclass(frozen=True, slots=True, eq=False)
class Route:
    """What one robot drives.

    Attributes
    ----------
    order : int32[m]
        The stops in the order of the visits, as indices into the task's stops.
    arrival, waiting : float64[m]
        Arrival at each stop, and waiting there until the window opens, s.
    legs : tuple of Plan
        The paths from the start to the first stop, from each stop to the next, and to the end if one is given; empty for a
        robot without stops, unless it has an end.
    length : float
        Of all legs, m.
    duration : float
        Time from t = 0 s to the end, s.
    """

    order: NDArray[np.int32]
    arrival: Floats
    waiting: Floats
    legs: tuple[Plan, ...]
    length: float
    duration: float

    def __post_init__(self) -> None:
        for array in (self.order, self.arrival, self.waiting):
            array.flags.writeable = False


@dataclass(frozen=True, slots=True, eq=False)
class TourPlan:
    """The result of `plan_tour`; `order`, `arrival`, `waiting` and `legs` are those of the first robot.

    Attributes
    ----------
    task : TourTask
    routes : tuple of Route
        One for each robot.
    skipped : tuple of int
        Stops that are not visited; empty unless the stops have priorities.
    length : float
        Of all routes, m.
    duration : float
        End time of the last robot, s.
    cost : float
        The objective: the total driving time of all robots, or for "makespan" the duration, s.
    lateness : float
        Sum of the delays of service after the ends of windows, and of robots after the deadline, s.
    feasible : bool
        Whether nothing is late.
    collected : float
        Sum of the priorities of the visited stops; 0.0 without priorities.
    bound : float
        No feasible tour costs less, s; with priorities: none collects more.
    gap : float
        cost / bound - 1 (with priorities bound / collected - 1): an upper bound of the distance from the optimum.
    elapsed : float
        Seconds of planning.
    ordering : Ordering
        The result of the search for the order, from which a plan with `initial` continues.
    """

    task: TourTask
    routes: tuple[Route, ...]
    skipped: tuple[int, ...]
    length: float
    duration: float
    cost: float
    lateness: float
    feasible: bool
    collected: float
    bound: float
    gap: float
    elapsed: float
    ordering: Ordering

    def __repr__(self) -> str:
        robots = f", {len(self.routes)} robots" if len(self.routes) > 1 else ""
        visits = sum(len(route.order) for route in self.routes)
        return f"TourPlan({visits} visits{robots}, {self.length:.1f} m, {self.duration:.1f} s, {self.lateness:.1f} s late)"

    def _repr_html_(self) -> str:
        return str(drawing().html(self))

    @property
    def order(self) -> NDArray[np.int32]:
        """The stops that the first robot visits, in order, int32[m]."""
        return self.routes[0].order

    @property
    def arrival(self) -> Floats:
        """Arrival of the first robot at each of its stops, s, float64[m]."""
        return self.routes[0].arrival

    @property
    def waiting(self) -> Floats:
        """Waiting of the first robot at each of its stops until the window opens, s, float64[m]."""
        return self.routes[0].waiting

    @property
    def legs(self) -> tuple[Plan, ...]:
        """The paths that the first robot drives."""
        return self.routes[0].legs


def plan_tour(
    grid: Grid,
    start: Iterable[float],
    stops: ArrayLike | Sequence[Iterable[float]],
    *,
    end: Iterable[float] | str | None = None,
    windows: Sequence[Iterable[float] | None] | ArrayLike | None = None,
    service: ArrayLike | None = None,
    priorities: ArrayLike | None = None,
    deadline: float = math.inf,
    robots: int = 1,
    objective: str = "travel time",
    speed: float = 1.0,
    robot_radius: float = 0.0,
    moves: Moves = Moves.EIGHT,
    costs: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    seconds: float | None = None,
    cycles: int | None = None,
    seed: int = 0,
    initial: TourPlan | None = None,
) -> TourPlan:
    """Plan a tour that visits all stops in the best order or, with `priorities`, the best of them.

    Parameters
    ----------
    grid : Grid
    start : (x, y)
        Where all robots start at t = 0 s, m.
    stops : sequence of (x, y)
        Stops in m; at most 4,998, no two in the same cell.
    end : (x, y), "start" or None
        Where robots end: at that point in m, at the start, or at their last stops.
    windows : sequence of (earliest, latest) or None
        For each stop the times at which service may start, s; None for any time. A robot that is early waits.
    service : float or float[N]
        Duration of each stop, s.
    priorities : float[N] or None
        Value of each stop, >= 0: the sum collected within windows and deadline is maximised, then the cost is minimised;
        stops of value 0 are left out. None: all stops are visited.
    deadline : float
        Latest end time of each robot, s.
    robots : int
        Number of robots that share the stops.
    objective : str
        "travel time": the total driving time of all robots; "makespan": the end time of the last robot.
    speed, robot_radius : float
        m/s, m.
    moves : Moves
    costs : float[H, W] or None
        Cost of each cell, see `antway.search.costs`: the factor by which a metre takes longer there.
    names : sequence of str or None
        Names of the stops.
    seconds, cycles : float, int or None
        When the search for the order stops, whichever comes first; without both, after 1 s. Seconds may be infinite.
    seed : int
        In [0, 2**64 - 1]; the same seed and number of cycles give the same bytes.
    initial : TourPlan or None
        An earlier tour through the same stops from which to continue; map and windows may have changed.

    Raises
    ------
    BadParameter, OutOfBounds, CellBlocked, TooLarge
        For example for a stop in a wall, off the map, in the cell of another stop or unreachable, or for a window that ends
        before it starts; the error names the stop.

    Examples
    --------
    >>> tour = plan_tour(Grid(np.zeros((3, 9), dtype=bool)), (0.5, 1.5), [(8.5, 1.5), (3.5, 1.5), (6.5, 1.5)], cycles=10)
    >>> tour.order.tolist(), tour.arrival.tolist(), tour.length
    ([1, 2, 0], [3.0, 6.0, 8.0], 8.0)
    """
    began = time.perf_counter()
    asked: Any = grid, start, stops, names, end, windows, service, priorities, deadline, robots, objective
    driven: Any = speed, robot_radius, moves, costs
    task = TourTask(*asked, *driven)
    free, cells = task.places()
    away = stop_distances(free, cells, moves, costs=costs) / task.speed
    _check_connected(task, away)
    _check_times(task, away)
    known = None
    if initial is not None:
        checks.instance("initial", initial, TourPlan)
        if len(initial.task.stops) != len(task.stops) or initial.task.robots != task.robots:
            sizes = len(initial.task.stops), initial.task.robots
            raise BadParameter("initial", sizes, f"a tour of {len(task.stops)} stops and {task.robots} robots")
        known = initial.ordering
    ordering = order_stops(away, **arguments(task), seconds=seconds, cycles=cycles, seed=seed, initial=known)
    return _finished(task, free, cells, ordering, began)


def arguments(task: TourTask) -> dict[str, Any]:
    """Return the arguments of `order_stops` for `task`; row 0 is the start, row i + 1 stop i, and the last a separate end."""
    head, tail = np.zeros(1), np.zeros(1 if isinstance(task.end, tuple) else 0)
    always = np.array([[0.0, math.inf]])
    return {
        "end": len(task.stops) + 1 if len(tail) else task.end,
        "windows": np.concatenate((always, task.windows, always[: len(tail)])),
        "service": np.concatenate((head, task.service, tail)),
        "priorities": None if task.priorities is None else np.concatenate((head, task.priorities, tail)),
        "deadline": task.deadline,
        "robots": task.robots,
        "objective": task.objective,
    }


def _check_connected(task: TourTask, away: Floats) -> None:
    """Raise an error that names all stops that cannot be reached from the start."""
    lost = np.flatnonzero(np.isinf(away[0, 1:]))
    if not len(lost):
        return
    if lost[0] == len(task.stops):
        raise BadParameter("end", task.end, "where a path leads from the start")
    fields = [f"stops[{i}] ({task.names[i]})" for i in lost.tolist() if i < len(task.stops)]
    also = f"; nor does one to {', '.join(fields[1:10])}" if fields[1:] else ""
    also += f" and {len(fields) - 10} more" if len(fields) > 10 else ""
    raise BadParameter(fields[0], tuple(task.stops[lost[0]].tolist()), f"where a path leads from the start{also}")


def _check_times(task: TourTask, away: Floats) -> None:
    """Raise an error that names what makes the travel time between two places longer than `order_stops` takes."""
    for _, there in np.argwhere(away > MAX_TIME)[:1].tolist():
        place = f"stops[{there - 1}] ({task.names[there - 1]})" if there <= len(task.stops) else "the end"
        allowed = f"such that no way to {place} takes more than {MAX_TIME:g} s"
        raise BadParameter(*(("speed", task.speed) if task.costs is None else ("costs", float(task.costs.max()))), allowed)


def _finished(task: TourTask, free: Grid, cells: list[Cell], ordering: Ordering, began: float) -> TourPlan:
    """Return the tour of `ordering`, with a path for each leg."""
    routes = tuple(
        _route(task, free, cells, order, arrival, waiting)
        for order, arrival, waiting in zip(ordering.orders, ordering.arrival, ordering.waiting)
    )
    visited = {int(stop) for route in routes for stop in route.order}
    skipped = tuple(i for i in range(len(task.stops)) if i not in visited)
    length, duration = math.fsum(route.length for route in routes), max(route.duration for route in routes)
    found = ordering.cost, ordering.lateness, ordering.feasible, ordering.collected, ordering.bound, ordering.gap
    return TourPlan(task, routes, skipped, length, duration, *found, time.perf_counter() - began, ordering)


def _route(task: TourTask, free: Grid, cells: list[Cell], order: NDArray[np.int32], arrival: Floats, waiting: Floats) -> Route:
    """Return the route along `order`, whose stops are numbered as `cells`, with both ends."""
    rows = order.tolist()
    problems = [Problem(free, cells[a], cells[b], task.moves) for a, b in pairwise(rows)]
    found = (solve(one, "jps") if task.costs is None else astar(one, costs=task.costs) for one in problems)
    legs = tuple(replace(leg, grid=task.grid) for leg in found)  # not the inflated map, as for `antway.plan`
    inner = np.array([k for k, row in enumerate(rows) if 0 < row <= len(task.stops)], dtype=np.int64)
    last = int(rows[-1])
    stays = float(task.service[last - 1]) if 0 < last <= len(task.stops) else 0.0
    length, duration = math.fsum(one.length for one in legs), float(arrival[-1] + waiting[-1]) + stays
    return Route((order[inner] - 1).astype(np.int32), arrival[inner], waiting[inner], legs, length, duration)


def tour_record(tour: TourPlan) -> dict[str, Any]:
    """Return `tour` as numbers, strings and lists.

    Examples
    --------
    >>> import numpy as np
    >>> from antway import Grid, plan_tour
    >>> tour = plan_tour(Grid(np.zeros((1, 9), dtype=bool)), (0.5, 0.5), [(8.5, 0.5), (3.5, 0.5)], cycles=10)
    >>> [visit["name"] for visit in tour_record(tour)["routes"][0]["visits"]]
    ['stop 1', 'stop 0']
    """
    task = tour.task
    routes = [
        {
            "length": route.length,
            "duration": route.duration,
            "visits": [
                {
                    "stop": stop,
                    "name": task.names[stop],
                    "xy": task.stops[stop].tolist(),
                    "arrival": float(route.arrival[n]),
                    "waiting": float(route.waiting[n]),
                    "window": task.windows[stop].tolist(),
                    "service": float(task.service[stop]),
                }
                for n, stop in enumerate(route.order.tolist())
            ],
            "legs": [plan.xy(task.grid).tolist() for plan in route.legs],
        }
        for route in tour.routes
    ]
    figures = ("length", "duration", "cost", "bound", "gap", "feasible", "lateness", "collected")
    whole = {name: getattr(tour, name) for name in figures}
    return {**whole, "skipped": list(tour.skipped), "elapsed": tour.elapsed, "routes": routes}
