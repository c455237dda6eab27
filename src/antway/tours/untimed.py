"""Stops without windows for one robot: the travelling salesman problem, closed, open or with a given end."""

from __future__ import annotations

import math
import time

import numpy as np
from numpy.typing import NDArray

from antway.ants.tsp import Tsp, solve_tsp
from antway.kernels.colony import held_karp
from antway.kernels.colony.local_search import improve, workspace
from antway.planning import Clock
from antway.tours.stops import Floats, Order, Stops

FEW = 12  # number of stops up to which a dynamic program finds the best order in about 1 ms
ROUNDS = 60, 400  # least and largest number of subgradient steps for the bound
HASTY = 10  # least number where there is less time
SAFE = 1.0 - 1e-9  # factor that allows for rounding errors of sums
PACE = 2.5e8  # work of the bound in a second
FOR_BOUND = 0.3  # part of the time that the bound may take
WORK = 20_000_000  # work of the bound that determines the number of these steps, about 50 ms


def is_untimed(stops: Stops) -> bool:
    """Tell whether one robot must visit all stops, at any time, and distances are symmetric."""
    away = stops.matrix
    few = len(away) <= FEW
    plain = not stops.timed and stops.robots == 1 and stops.priorities is None
    return plain and bool(np.isfinite(away).all()) and (few or bool((away == away.T).all()))


def shortest_order(
    stops: Stops, clock: Clock, cycles: int | None, seed: int, initial: Order | None = None
) -> tuple[Order, float]:
    """Return the best order of untimed `stops` that ants find until the clock runs out, and a lower bound on its travel time.

    For up to 12 stops a dynamic program finds the best order directly. `initial` is an order that 3-opt improves first.
    """
    away, n = stops.matrix, len(stops.matrix)
    first = rows_from_start(stops)
    if n <= FEW:
        end = -1 if stops.end is None else int(np.argsort(first)[stops.end])
        whole = _as_order(held_karp.best_of_few(np.ascontiguousarray(away[np.ix_(first, first)]), end), stops)
        return whole, stops.travel(whole)
    closed, extra, end = closed_matrix(stops, away)
    least = held_karp_bound(closed, extra, FOR_BOUND * (clock.end - clock.started))
    instance = Tsp(matrix=closed, optimum=least * (1 + 2e-9) + extra)
    known = None if initial is None else _improved(instance, np.argsort(first)[initial], end)
    if known is not None and cycles == 0:
        return _as_order(_from_start(known, n, end), stops), least
    left = None if clock.end == math.inf else max(0.0, clock.end - time.perf_counter())
    cycles = None if cycles is None else max(cycles, 1)  # only a tour that ants have built has the end where it must be
    tour = solve_tsp(instance, local_search="3opt", seconds=left, cycles=cycles, seed=seed, cancel=clock.cancel)
    order = tour.order if known is None or tour.length < instance.length(known) else known
    return _as_order(_from_start(order, n, end), stops), least


def improved_order(stops: Stops, initial: Order) -> Order:
    """Return `initial` with all stops, improved by 3-opt."""
    first, n = rows_from_start(stops), len(stops.matrix)
    closed, _, end = closed_matrix(stops, stops.matrix)
    order = _improved(Tsp(matrix=closed), np.argsort(first)[initial], end)
    return _as_order(_from_start(order, n, end), stops)


def rows_from_start(stops: Stops) -> Order:
    """Return the stops with the start as number 0."""
    return np.concatenate(([stops.start], np.delete(np.arange(len(stops.matrix)), stops.start))).astype(np.int32)


def closed_matrix(stops: Stops, away: Floats) -> tuple[Floats, float, int]:
    """Return distances whose closed tours are the tours of `stops`, their extra length, and the row of the end or -1.

    An open tour is a closed one over one more node, with the distance 0 to both ends and 2 max d, or 1 if all d are 0, to
    all others. A tour that does not use both of these arcs saves less than it costs.
    """
    first, n = rows_from_start(stops), len(away)
    end = -1 if stops.end is None else int(np.argsort(first)[stops.end])
    closed = away[np.ix_(first, first)]
    far = 2.0 * float(away.max()) or 1.0
    if end != 0:
        closed = np.pad(closed, (0, 1), constant_values=far)
        closed[n, n] = closed[0, n] = closed[n, 0] = 0.0
        if end > 0:
            closed[end, n] = closed[n, end] = 0.0
    return np.ascontiguousarray(closed), far if end < 0 else 0.0, end


def held_karp_bound(closed: Floats, extra: float, seconds: float = math.inf) -> float:
    """Return a lower bound of tours over `closed_matrix` of 3 nodes or more, minus `extra`, weaker if `seconds` are few."""
    rounds = max(ROUNDS[0], min(ROUNDS[1], WORK // len(closed) ** 2))
    rounds = int(max(HASTY, min(rounds, PACE * seconds / len(closed) ** 2)))
    return rounded_down(held_karp.bound(closed, _nearest_first(closed), rounds) - extra, closed)


def rounded_down(bound: float, away: Floats) -> float:
    """Return `bound`, a sum of distances `away` and their dual values, so much lower that no rounding lifts it above a tour."""
    n = len(away)
    return max(0.0, min(bound * SAFE, bound - n * float(np.spacing(n * away.max()))))


def _improved(instance: Tsp, known: NDArray[np.int64], end: int) -> Order:
    """Return the order `known` as a closed tour of all nodes; missing ones are inserted where that costs least."""
    away = instance.matrix
    assert away is not None
    order = known[:-1].tolist() if end == 0 and len(known) > 1 else known.tolist()
    n = len(away)
    if end != 0:
        order.append(n - 1)
    for node in sorted(set(range(n)) - set(order)):
        here = np.array(order)
        then = np.roll(here, -1)
        order.insert(int(np.argmin(away[here, node] + away[node, then] - away[here, then])) + 1, node)
    result = np.array(order, dtype=np.uint32)
    improve(instance.cities(min(10, n - 1)), workspace(n, 0), result, 5, n)
    return result.astype(np.int32)


def _from_start(order: Order, n: int, end: int) -> Order:
    """Return a closed tour over rows of `closed_matrix` from row 0 to `end`, without the extra node `n`."""
    order = np.roll(order, -int(np.flatnonzero(order == 0)[0]))
    if end != 0:
        if order[1] == n:
            order = np.r_[order[:1], order[:0:-1]]
        assert order[-1] == n
        order = order[:-1]
    return order


def _as_order(rows: Order, stops: Stops) -> Order:
    """Return rows of `closed_matrix` as stops; a closed tour gets its start again at the end."""
    order = rows_from_start(stops)[rows]
    return np.append(order, order[:1]) if stops.closed else order


def _nearest_first(away: Floats) -> float:
    """Return the cost of the closed tour that always goes to the nearest unvisited node."""
    left = np.ones(len(away), dtype=bool)
    at, total = 0, 0.0
    left[0] = False
    for _ in range(len(away) - 1):
        to = int(np.argmin(np.where(left, away[at], np.inf)))
        total += float(away[at, to])
        left[to] = False
        at = to
    return total + float(away[at, 0])
