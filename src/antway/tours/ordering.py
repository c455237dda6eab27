"""The best order of stops from a matrix of travel times, the one function that tours on maps call."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from antway import checks
from antway.errors import BadParameter
from antway.kernels.colony.window_colony import TAU_0
from antway.kernels.colony.window_repair import least_late_place
from antway.planning import Budget, Clock
from antway.tours.bounds import lower_bound, quick_bound, worth_bound
from antway.tours.fleet import best_routes, inner_places, layout, without_end
from antway.tours.stops import Floats, Order, Stops
from antway.tours.untimed import FEW, improved_order, is_untimed, shortest_order
from antway.tours.windowed import Path, search

_QUICK = 0.2  # s; with less time, an earlier answer is only improved by local search
_PREPARATION = 6e-8  # s per cubed number of stops; with less time, the analysis of windows (a quarter of it) is left out
_SOON = 50  # number of stops up to which the bound takes a few ms, so that the search for several routes may end at it
_NEAR = 1e-9  # share of the cost by which the bound of a proven order is lower


@dataclass(frozen=True, slots=True, eq=False)
class Ordering:
    """The result of `order_stops`.

    Attributes
    ----------
    orders : tuple of int32[m]
        For each robot the stops in order, as rows of the matrix: first `start`, last the given end (for a closed tour `start`
        again). The order of a robot that is not used is only `start`, or start and end.
    arrival, waiting : tuple of float64[m]
        Arrival at each stop, and waiting there until the window opens, in s.
    cost : float
        The objective: the sum of travel times, or the end time of the last robot, in s.
    lateness : float
        Sum of the delays of service after the ends of windows, and of robots after the deadline, in s. Delays of less than
        1e-11 of the time do not count, which sums of floats are wrong by.
    feasible : bool
        Whether lateness is 0 and every required stop is visited.
    collected : float
        Sum of the priorities of the visited stops; 0.0 without priorities.
    bound : float
        No feasible answer costs less (with priorities: none collects more than `bound`).
    gap : float
        cost / bound - 1 (with priorities bound / collected - 1): an upper bound of the distance from the optimum.
    pheromone : float64[n, n] or None
        Pheromone of the colony. Pass the whole answer as `initial` to continue after a small change.
    """

    orders: tuple[Order, ...]
    arrival: tuple[Floats, ...]
    waiting: tuple[Floats, ...]
    cost: float
    lateness: float
    feasible: bool
    collected: float
    bound: float
    gap: float
    pheromone: Floats | None = None


def order_stops(
    matrix: object,
    *,
    start: int = 0,
    end: int | Literal["start"] | None = None,
    windows: object = None,
    service: object = None,
    priorities: object = None,
    deadline: float = math.inf,
    robots: int = 1,
    objective: str = "travel time",
    seconds: float | None = None,
    cycles: int | None = None,
    seed: int = 0,
    initial: Ordering | object = None,
    quick: bool = False,
) -> Ordering:
    """Search for the best order in which to visit all stops or, with `priorities`, the best of them.

    Parameters
    ----------
    matrix : array_like[n, n]
        Travel time in s from row to column, in [0, 1e9], infinite if there is no path; it may be asymmetric. For several robots
        and with `priorities` it should hold shortest times: routes that are in time only through further stops may be missed.
    start : int
        Where all robots start, at t = 0 s or when the window of `start` opens.
    end : int, "start" or None
        Where robots end: at that stop, at the start, or at their last stops.
    windows : array_like[n, 2] or None
        Earliest and latest start of service in s, infinite if there is none. A robot that is early waits.
    service : float, array_like[n] or None
        Duration of each stop, in s.
    priorities : array_like[n] or None
        Value of each stop, >= 0: the sum collected by `deadline` is maximised, then the cost is minimised; stops of value 0
        are left out, unless the route through them takes less time. None: every stop must be visited.
    deadline : float
        Latest end time of each robot, in s.
    robots : int
        Number of robots that share the stops.
    objective : str
        "travel time" (the sum over all robots) or "makespan" (the end time of the last robot).
    seconds, cycles : float, int or None
        When to stop, whichever comes first; with neither, after 1 s. A first order and a bound are always completed,
        which takes about 0.5 s of processor time for 1,000 stops and 3 s for 4,000; with windows and without `seconds`, the
        analysis of the windows is completed as well, whose time grows with the cube of the stops: 0.6 s for 400.
    seed : int
        In [0, 2**64 - 1]. The same seed and number of cycles give the same bytes.
    initial : Ordering, sequence of int, or None
        An earlier answer or order from which the search continues; stops from n on no longer exist and are left out.
    quick : bool
        Whether only local search improves `initial`, with a weak bound; this is always so with less than 0.2 s.

    Raises
    ------
    BadParameter, TooLarge

    Examples
    --------
    >>> away = [[0, 1, 2, 3], [1, 0, 1, 2], [2, 1, 0, 1], [3, 2, 1, 0]]
    >>> order_stops(away, end="start", cycles=10).cost
    6.0
    """
    asked: Any = matrix, start, end, windows, service, priorities, deadline, robots, objective
    stops = Stops(*asked)
    checks.seed(seed)
    known, learned = _initial(stops, initial)
    budget = Budget(seconds=1.0 if seconds is None and cycles is None else seconds, cycles=cycles)
    clock = budget.start()
    # A robot that waits for a new order should not wait for a good bound.
    quick = known is not None and (quick or (seconds is not None and seconds < _QUICK))
    if is_untimed(stops):
        if not quick or len(stops.matrix) <= FEW:
            order, shortest = shortest_order(stops, clock, cycles, seed, None if known is None else known[0])
            stays = float(stops.service.sum()) if stops.objective == "makespan" else 0.0
            return finished(stops, [order], shortest + stays)
        assert known is not None
        known = [improved_order(stops, known[0])]
    quick = quick or (budget.seconds is not None and budget.seconds < _PREPARATION * len(stops.matrix) ** 3)
    off, pheromone, least = math.inf, None, -math.inf
    if stops.robots > 1 or stops.priorities is not None:
        if stops.priorities is None and not quick and len(stops.matrix) <= _SOON:
            least = lower_bound(stops)
        orders = best_routes(stops, clock, cycles, seed, known, least)
    else:
        order, off, pheromone = _best_order(stops, clock, cycles, seed, None if known is None else known[0], learned, quick)
        orders = [order]
    answer = finished(stops, orders, 0.0, pheromone)
    if answer.lateness > 0.0 and known is not None and len(known) == stops.robots:
        before = finished(stops, known, 0.0, pheromone)
        whole = len(np.unique(np.concatenate(known))) == len(stops.matrix)
        if whole and (before.lateness, before.cost) < (answer.lateness, answer.cost):
            answer = before
    if quick:
        bound = quick_bound(stops)
    elif stops.priorities is not None:
        bound = worth_bound(stops)
    elif off < math.inf and answer.feasible:
        bound = max(0.0, min(answer.cost * (1.0 - _NEAR), answer.cost - off))
    else:
        bound = (least if math.isfinite(least) else lower_bound(stops)) if math.isfinite(answer.cost) else 0.0
    return replace(answer, bound=bound, gap=_gap(stops, answer.cost, answer.collected, bound))


def _best_order(
    stops: Stops, clock: Clock, cycles: int | None, seed: int, initial: Order | None, pheromone: Floats | None, quick: bool
) -> tuple[Order, float, Floats | None]:
    """Return the best order found for one robot, by how much another may cost less, in s, and pheromone, float64[n, n].

    The second result is infinite unless the order is feasible and proven to be the best but for rounding.
    """
    rows, spans, opens, closes = layout(stops)
    n, m = len(stops.matrix), len(rows)
    path = Path(spans, opens, closes, quick)
    tau = None
    # Rows of the pheromone are stops. The start of a closed tour is at both ends of the path.
    ids = np.where(rows < 0, 0, rows)
    if pheromone is not None and pheromone.shape == (n, n):
        tau = np.ascontiguousarray(pheromone[np.ix_(ids, ids)])
    first = None
    if initial is not None:
        (kept,), missing = inner_places(rows, [initial])
        first = _inserted(path, [0, *kept, m - 1], missing, clock)
    makespan = stops.objective == "makespan"
    found = search(path, clock, makespan=makespan, cycles=cycles, seed=seed, initial=first, pheromone=tau)
    off = found.off if found.proven and found.late == 0.0 else math.inf
    order = found.order if found.late == 0.0 or first is None or found.late < path.late(first) else first
    if found.late > 0.0 and not clock.spent() and np.isfinite(spans[order[:-1], order[1:]]).all():
        # With windows that are longer by the delays of this order, the rest of the budget is for its cost.
        eased = Path(spans, opens, np.maximum(closes, path.starts(order)), quick)
        left = None if cycles is None else max(cycles - found.cycles, 1)
        found = search(eased, clock, makespan=makespan, cycles=left, seed=seed, initial=order, pheromone=tau)
        order = found.order
    learned = None
    if found.pheromone.size:
        learned = np.full((n, n), TAU_0)
        learned[np.ix_(ids[:-1], ids[1:-1])] = found.pheromone[:-1, 1:-1]
        if rows[-1] >= 0:
            learned[ids[1:-1], rows[-1]] = found.pheromone[1:-1, -1]
    return without_end(stops, rows[order]), off, learned


def _inserted(path: Path, known: list[int], missing: list[int], clock: Clock) -> Order:
    """Insert the missing stops where the order becomes least late, then shortest; once the clock is spent only shortest."""
    order, time = np.array(known, dtype=np.int32), path.finite
    for stop in missing:
        if clock.spent():
            here, then = order[:-1], order[1:]
            place = 1 + int(np.argmin(time[here, stop] + time[stop, then] - time[here, then]))
        else:
            place = least_late_place(time, path.opens, path.closes, order, stop)
        order = np.insert(order, place, stop)
    return order


def _gap(stops: Stops, cost: float, collected: float, bound: float) -> float:
    high, low = (cost, bound) if stops.priorities is None else (bound, collected)
    if high <= low:
        return 0.0
    return high / low - 1.0 if low > 0.0 else math.inf


def _initial(stops: Stops, initial: Ordering | object) -> tuple[list[Order] | None, Floats | None]:
    """Return the initial orders and pheromone, without stops that no longer exist."""
    if initial is None:
        return None, None
    if isinstance(initial, Ordering):
        given, learned = list(initial.orders), initial.pheromone
    else:
        given, learned = [checks.array("initial", initial, (None,))], None  # type: ignore[list-item]
    n, orders, taken = len(stops.matrix), [], set(stops.ends)
    for order in given:
        listed = order.tolist()
        # A closed tour has its start at both ends.
        seen = Counter(listed[:-1] if len(listed) > 1 and listed[0] == listed[-1] else listed)
        wrong = [stop for stop, times in seen.items() if times > 1 or not (stop >= 0 and stop == int(stop))]
        if wrong:
            raise BadParameter("initial", wrong[0], f"stops 0 to {n - 1}, each at most once")
        # An earlier start is in the order of each robot; it is now a stop of the first one.
        inner = [int(stop) for stop in seen if stop < n and int(stop) not in taken]
        taken.update(inner)
        tail = [] if stops.end is None else [stops.end]
        orders.append(np.array([stops.start, *inner, *tail], dtype=np.int32))
    return orders or None, learned


def finished(stops: Stops, orders: list[Order], bound: float, pheromone: Floats | None = None) -> Ordering:
    """Return the `Ordering` of `orders`, with times computed from the matrix."""
    arrival, waiting, _, lateness = zip(*(stops.timing(order) for order in orders))
    cost = float(stops.cost(orders))
    late = float(sum(lateness))
    visited = np.unique(np.concatenate(orders))
    collected = 0.0 if stops.priorities is None else float(stops.priorities[visited].sum())
    whole = stops.priorities is not None or len(visited) == len(stops.matrix)
    feasible, gap = late == 0.0 and math.isfinite(cost) and whole, _gap(stops, cost, collected, bound)
    return Ordering(tuple(orders), arrival, waiting, cost, late, feasible, collected, bound, gap, pheromone)
