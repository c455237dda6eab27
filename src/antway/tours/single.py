"""One robot that visits all stops in time, by the colony of `solve_tsptw`."""

from __future__ import annotations

import numpy as np

from antway.kernels.colony.window_colony import TAU_0
from antway.kernels.colony.window_repair import least_late_place
from antway.planning import Clock
from antway.tours.fleet import inner_places, layout
from antway.tours.stops import Floats, Order, Stops
from antway.tours.windowed import Path, search


def best_order(
    stops: Stops, clock: Clock, cycles: int | None, seed: int, initial: Order | None, pheromone: Floats | None, quick: bool
) -> tuple[Order, bool, Floats | None]:
    """Return the best order found, whether it is proven optimal and feasible, and the pheromone, float64[n, n]."""
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
    proven = found.proven and found.late == 0.0
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
    order = rows[order]
    order = order[:-1] if stops.end is None else order
    return order.astype(np.int32), proven, learned


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
