"""`order_stops` by the definitions: all subsets, permutations and ways to share them out among the robots."""

from __future__ import annotations

import itertools
import math


def timing(matrix, windows, service, deadline, order, closed):
    """(when the robot is done, travel time, lateness) of one route."""
    now, travel, late = 0.0, 0.0, 0.0
    for p, stop in enumerate(order):
        if p > 0:
            now += matrix[order[p - 1]][stop]
            travel += matrix[order[p - 1]][stop]
        if closed and p == len(order) - 1 and p > 0:
            break
        now = max(now, windows[stop][0])
        late += max(0.0, now - windows[stop][1])
        now += service[stop]
    return now, travel, late + max(0.0, now - deadline)


def best(matrix, start, end, windows, service, priorities, deadline, robots, makespan):
    """(most that can be collected, least cost of that) without lateness, or None."""
    closed = end == start
    inner = [i for i in range(len(matrix)) if i not in (start, end)]
    tail = [] if end is None else [end]
    found = None
    chosen = (
        [inner] if priorities is None else [list(s) for k in range(len(inner) + 1) for s in itertools.combinations(inner, k)]
    )
    for some in chosen:
        visited = {*some, start, *tail}
        worth = 0.0 if priorities is None else sum(priorities[i] for i in sorted(visited))
        if found is not None and worth < found[0]:
            continue
        for order in itertools.permutations(some):
            for cuts in itertools.combinations_with_replacement(range(len(order) + 1), robots - 1):
                ends = (0, *cuts, len(order))
                routes = [[start, *order[a:b], *tail] for a, b in itertools.pairwise(ends)]
                times = [timing(matrix, windows, service, deadline, route, closed) for route in routes]
                if sum(late for _, _, late in times) > 1e-9:
                    continue
                cost = max(done for done, _, _ in times) if makespan else sum(travel for _, travel, _ in times)
                if found is None or (-worth, cost) < (-found[0], found[1]):
                    found = worth, cost
    return found


def lateness(matrix, windows, service, deadline, orders, closed):
    """Sum of the lateness of several routes; infinite where there is no path."""
    late = sum(timing(matrix, windows, service, deadline, order, closed)[2] for order in orders)
    return math.inf if math.isnan(late) else late
