"""Routes of several robots, or with optional stops, by ruin and recreate; see `antway.kernels.colony.fleet`."""

from __future__ import annotations

import itertools
import math
import time

import numpy as np

from antway.kernels.base.rng import stream
from antway.kernels.colony import fleet as kernel
from antway.planning import Clock
from antway.tours.stops import Floats, Order, Stops, typical_step

_ITERATIONS = 100  # iterations between two looks at the clock
_ANNEALINGS = 8  # limit of annealings that share the budget; the best one counts
_ENOUGH = 250  # iterations per stop from which another annealing is better than a slower one
_FIRST = 3  # number of looks at the clock after which the number of annealings is decided
_HOT, _COLD = 3.0, 0.1  # initial and final temperature, in typical steps
_KEPT = 0.25  # share of the time that is kept for stops that fit nowhere
_PAIRED = 20  # limit of stops of which pairs are moved as well
_TIE = 1e-7  # weight of the travel time where the makespan counts, so that it decides between equal ones alone
_SAME = 1.0 + 1e-8  # factor up to which a cost is that of a bound
_PRICE = 3.0  # price of leaving out a stop of mean priority, in typical steps


def layout(stops: Stops) -> tuple[Order, Floats, Floats, Floats]:
    """Return rows of the matrix from start to end (-1 for no end), times, opens and closes, as kernels use them.

    A time includes the service at its first stop, so that the start of a closed tour is served once, and a given end later.
    """
    inner = stops.inner
    end = -1 if stops.end is None else stops.end
    rows = np.concatenate(([stops.start], inner, [end])).astype(np.int32)
    n = len(rows)
    spans = np.zeros((n, n))
    spans[:-1, :-1] = stops.matrix[np.ix_(rows[:-1], rows[:-1])] + stops.service[rows[:-1], None]
    spans[:-1, -1] = stops.service[rows[:-1]] + (0.0 if end < 0 else stops.matrix[rows[:-1], end])
    opens, closes = stops.windows[rows, 0].copy(), stops.windows[rows, 1].copy()
    if end < 0 or stops.closed:
        opens[-1], closes[-1] = 0.0, stops.deadline
    else:
        closes[-1] = min(closes[-1], stops.deadline - stops.service[end])
    return rows, spans, opens, closes


def inner_places(rows: Order, orders: list[Order]) -> tuple[list[list[int]], list[int]]:
    """Return each order as inner places in `rows`, every stop once and if it still exists, and the places in no order."""
    place = {int(row): i for i, row in enumerate(rows[:-1]) if i > 0}
    kept = [[place.pop(int(stop)) for stop in order if int(stop) in place] for order in orders]
    return kept, sorted(place.values())


def best_routes(
    stops: Stops, clock: Clock, cycles: int | None, seed: int, initial: list[Order] | None, least: float
) -> list[Order]:
    """Search for the best routes of all robots until they cost `least`, time is up or `cycles` of 100 iterations are done.

    `least` is a lower bound, s; -inf where none is known, and then no cost is compared with it.

    An annealing ends in one local optimum, and slower cooling helps little. If the budget allows, there are several, each from
    its own routes. If stops that must be visited fit nowhere, the last quarter of the time is theirs; see `_complete`.
    """
    rows, spans, opens, closes = layout(stops)
    n = len(rows)
    if n == 2:
        return [without_end(stops, rows[[0, 1]]) for _ in range(stops.robots)]
    fleet, step = _fleet(stops, rows, spans, opens, closes)
    scratch, current, best = (kernel.routes(n, stops.robots) for _ in range(3))

    def drawn(number: int) -> np.uint64:
        """Return the seed of a call of the kernels."""
        return np.uint64(stream(np.uint64(seed), np.uint64(number)))

    if initial is not None:
        _fill(current, rows, initial)
    first, worth = kernel.start(fleet, current, drawn(0))
    kernel.copy(current, best)
    record, cost = np.array([first, worth, first]), math.inf
    done, limit, started = 0, 2**62 if cycles is None else cycles, time.perf_counter()
    hot, runs, run = _COLD if initial is not None else _HOT, 1, 0
    while done < limit and not (done and clock.spent()):
        # The temperature falls with the used share of an annealing's budget.
        passed = (time.perf_counter() - started) / max(clock.end - clock.started, 1e-9)
        used = done / limit if cycles is not None else min(1.0, passed)
        if done and passed > 1.0 - _KEPT and stops.priorities is None and (best.route[1:-1] == kernel.OUT).any():
            break
        if done == _FIRST and initial is None and used > 0.0:
            runs = min(max(int(done / used * _ITERATIONS / (_ENOUGH * n)), 1), _ANNEALINGS)
        if int(used * runs) > run and used < 1.0:
            run = int(used * runs)
            current = kernel.routes(n, stops.robots)
            record[kernel.COST], _ = kernel.start(fleet, current, drawn(2**63 + run))
        temperature = step * hot * (_COLD / hot) ** (used * runs - run)
        kernel.anneal(fleet, scratch, current, best, record, drawn(done + 1), _ITERATIONS, temperature)
        done += 1
        if math.isfinite(least) and record[kernel.BEST_COST] < cost:
            cost = record[kernel.BEST_COST]
            if (best.route[1:-1] != kernel.OUT).all() and stops.cost(_orders(stops, rows, best)) <= least * _SAME:
                break
    orders = _orders(stops, rows, best)
    if stops.priorities is None:
        orders = _complete(stops, orders, rows[1:-1][best.route[1:-1] == kernel.OUT].tolist(), clock)
    return orders


def _fleet(stops: Stops, rows: Order, spans: Floats, opens: Floats, closes: Floats) -> tuple[kernel.Fleet, float]:
    """Return the record for kernels, and a typical step in s."""
    n, known = len(rows), np.isfinite(spans)
    times = np.where(known, spans, 0.0)
    horizon = float(opens.max() + times.max(axis=1).sum()) + 1.0
    closes = np.minimum(closes, horizon) + 8 * n * np.spacing(horizon)  # more than the rounding errors of sums
    inner = np.minimum(spans[1:-1, 1:-1], spans[1:-1, 1:-1].T)
    np.fill_diagonal(inner, np.nan)  # sorted last, after stops to which there is no path
    near = np.pad(1 + np.argsort(inner, axis=1, kind="stable")[:, : n - 3].astype(np.int32), ((1, 1), (0, 0)))
    step = typical_step(np.sort(inner, axis=1)[:, :3], spans)
    worth, price, most = np.zeros(n), np.zeros(n), np.full(n, math.inf)
    last = 1.0 if stops.objective == "makespan" else 0.0
    total = _TIE if last else 0.1 if stops.priorities is not None else 1.0
    # So that many stops can find their places, a search goes over steps without a path, but at a cost that no other saves.
    costs = times if known.all() else np.where(known, spans, horizon / total)
    if stops.priorities is None:
        worth[1:-1], price[1:-1] = 1.0, horizon
    else:
        worth[1:-1] = stops.priorities[rows[1:-1]]
        price[1:-1] = worth[1:-1] / (float(worth[1:-1].mean()) or 1.0) * _PRICE * step
        if not last:
            # Times include service. Leaving out a stop costs as much, so that only the travel time decides.
            price[1:-1] += total * stops.service[rows[1:-1]]
        # A stop that is worth nothing is visited only where that saves time, and no other is worth a step without a path.
        most = np.where(worth > 0.0, 0.5 * horizon / total, price / total - 1e-9)
    return kernel.Fleet(times, costs, opens, closes, price, most, worth, near, last, total), step


def _fill(routes: kernel.FleetRoutes, rows: Order, orders: list[Order]) -> None:
    """Start with `orders`, without stops that no longer exist."""
    last = len(rows) - 1
    for k, inner in enumerate(inner_places(rows, orders[: len(routes.sizes)])[0]):
        routes.stops[k, 1 : 1 + len(inner)] = inner
        routes.stops[k, 1 + len(inner)] = last
        routes.sizes[k] = len(inner) + 2
        routes.route[inner] = k


def _orders(stops: Stops, rows: Order, routes: kernel.FleetRoutes) -> list[Order]:
    """Return the routes as orders of stops."""
    return [without_end(stops, rows[routes.stops[k, : routes.sizes[k]]]) for k in range(stops.robots)]


def without_end(stops: Stops, order: Order) -> Order:
    """Return the route without the artificial end that kernels use for open tours."""
    return order[:-1].astype(np.int32) if stops.end is None else order.astype(np.int32)


def _complete(stops: Stops, orders: list[Order], left: list[int], clock: Clock) -> list[Order]:
    """Insert the stops that no robot can visit in time where the lateness is least, and then move stops to reduce it.

    Once the clock is spent, robots go on to the nearest one from the ends of their routes.
    """
    if not left:
        return orders
    while left:
        hurry, found = clock.spent(), []
        for k, order in enumerate(orders):
            last = len(order) if stops.end is None else len(order) - 1
            stop = left[int(np.argmin(stops.matrix[order[last - 1], left])) if hurry else 0]
            found.append((*_least_late(stops, order, stop, last if hurry else 1), k, stop))
        _, place, k, stop = min(found, key=lambda trial: trial[0])
        orders[k] = np.insert(orders[k], place, stop)
        left.remove(stop)
    groups: list[tuple[int, ...]] = [(stop,) for stop in stops.inner.tolist()]
    if len(groups) <= _PAIRED:
        groups += itertools.permutations(stops.inner.tolist(), 2)
    late, tried = [_late(stops, order) for order in orders], 0  # groups tried since the last gain
    for group in itertools.cycle(groups):
        if tried == len(groups) or clock.spent():
            break
        (moved, then), tried = _moved(stops, orders, late, group), tried + 1
        if sum(then) < sum(late):
            orders, late, tried = moved, then, 0
    return orders


def _least_late(stops: Stops, order: Order, stop: int, first: int = 1) -> tuple[float, int]:
    """Return how late the route is, and the place, if `stop` is inserted where that is least; see `kernel.least_late_place`."""
    task = stops.matrix, stops.windows, stops.service, stops.deadline, stops.closed, stops.end is None
    value, place = kernel.least_late_place(*task, order, stop, first)
    return float(value), int(place)


def _moved(stops: Stops, orders: list[Order], late: list[float], group: tuple[int, ...]) -> tuple[list[Order], list[float]]:
    """Take these stops out and put them in again, one by one, where all routes are least late; return routes and lateness."""
    orders, late = orders.copy(), late.copy()
    for k, order in enumerate(orders):
        if (given := np.isin(order, group)).any():
            orders[k] = order[~given]
            late[k] = _late(stops, orders[k])
    for stop in group:
        trials = [_least_late(stops, order, stop) for order in orders]
        k = int(np.argmin([value - then if value < np.inf else np.inf for (value, _), then in zip(trials, late, strict=True)]))
        orders[k] = np.insert(orders[k], trials[k][1], stop)
        late[k] = _late(stops, orders[k])
    return orders, late


def _late(stops: Stops, order: Order) -> float:
    """Return the lateness of a route plus a millionth of its end time, s."""
    *_, end, late = stops.timing(order)
    return late + 1e-6 * end
