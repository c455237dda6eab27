"""An independent check of tours, which shares no code with the planner and follows only the definitions of the rules."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from antway.errors import BadParameter, InvalidPlan
from antway.grid import Cell
from antway.planning import Plan, Problem, Status
from antway.verify import check_plan, number_faults
from antway.verify_motion import array_faults

if TYPE_CHECKING:
    from antway.tours.plan import Route, TourPlan

_NEAR = 1e-9  # share of the duration; tolerance of sums of times


def check_tour(tour: TourPlan) -> None:
    """Raise `InvalidPlan` with all reasons why `tour` is not a legal answer to its own task.

    Parameters
    ----------
    tour : TourPlan

    Raises
    ------
    BadParameter
        If the argument is not a `TourPlan`.
    InvalidPlan
        If a stop is visited twice or, without priorities, not at all; if a leg is not a legal path (see `check_plan`) from the
        end of the previous leg to the next stop; if arrivals, waiting, length, duration, cost, lateness or collected priorities
        differ from what legs, windows and service give; if the tour claims to be feasible but is late; or if the bound
        contradicts the tour.

    Examples
    --------
    >>> import numpy as np
    >>> from antway import Grid, plan_tour
    >>> check_tour(plan_tour(Grid(np.zeros((3, 9), dtype=bool)), (0.5, 1.5), [(8.5, 1.5), (3.5, 1.5)], cycles=10))
    """
    if type(tour).__name__ != "TourPlan":  # its module cannot be imported here, because the check shares no code with it
        raise BadParameter("tour", tour, "a TourPlan")
    faults = _type_faults(tour) or list(_visit_faults(tour))
    late, driven, done = 0.0, 0.0, [0.0]
    if not faults:
        for k, route in enumerate(tour.routes):
            own, times, end, lateness = _drive(tour, route)
            faults += [f"robot {k}: {fault}" for fault in own]
            late += lateness
            driven += times
            done.append(end)
        faults = faults or list(_sum_faults(tour, late, driven, max(done)))
    if faults:
        raise InvalidPlan(faults)


def _type_faults(tour: TourPlan) -> list[str]:
    """Return which parts of a tour are not of their type; nothing else can be said of such a tour."""
    faults = number_faults(tour, "length", "duration", "cost", "lateness", "collected", "bound", "gap")
    if not isinstance(tour.feasible, bool):
        faults.append(f"feasible {tour.feasible!r} is not of type bool")
    if not (isinstance(tour.skipped, tuple) and all(isinstance(stop, int) for stop in tour.skipped)):
        faults.append(f"skipped {tour.skipped!r} is no tuple of integers")
    for k, route in enumerate(tour.routes):
        faults += [f"robot {k}: {fault}" for fault in number_faults(route, "length", "duration")]
        if not all(isinstance(leg, Plan) for leg in route.legs):
            faults.append(f"robot {k} has legs that are no plans")
    return faults


def _visit_faults(tour: TourPlan) -> Iterator[str]:
    """Yield the stops that are not visited as they should be."""
    task, count = tour.task, len(tour.task.stops)
    if len(tour.routes) != task.robots:
        yield f"has {len(tour.routes)} routes for {task.robots} robots"
    seen: set[int] = set()
    for k, route in enumerate(tour.routes):
        listed = np.asarray(route.order)
        if listed.ndim != 1 or (len(listed) and listed.dtype.kind not in "iu"):
            yield f"robot {k} has an order that is no list of integers: {listed.tolist()}"
            continue
        order = [int(stop) for stop in listed]
        for stop in order:
            if not 0 <= stop < count:
                yield f"robot {k} visits stop {stop}, and there are {count}"
            elif stop in seen:
                yield f"stop {stop} ({task.names[stop]}) is visited twice"
            seen.add(stop)
        shapes = dict.fromkeys(("arrival", "waiting"), (len(order),))
        yield from (f"robot {k}: {fault}" for fault in array_faults(route, shapes, ()))
        legs = len(order) + (task.end is not None)
        if len(route.legs) != legs:
            yield f"robot {k} has {len(route.legs)} legs for {legs} places to go to"
    missing = set(range(count)) - seen
    if task.priorities is None:
        yield from (f"stop {stop} ({task.names[stop]}) is not visited" for stop in sorted(missing))
    if sorted(tour.skipped) != sorted(missing):
        yield f"says that stops {sorted(tour.skipped)} are left out, and these are: {sorted(missing)}"


def _drive(tour: TourPlan, route: Route) -> tuple[list[str], float, float, float]:
    """Drive along the legs; return the faults of the route, the driving time, the end time, and the lateness."""
    task, faults = tour.task, []
    free = task.grid.inflate(task.robot_radius)
    at, now, driven, late = free.cell_at(task.start), 0.0, 0.0, 0.0
    targets, broken = list[int | None](int(stop) for stop in route.order), False
    if task.end is not None:
        targets.append(None)
    for k, (stop, plan) in enumerate(zip(targets, route.legs)):
        place = task.stops[stop] if stop is not None else task.start if task.end == "start" else task.end
        assert place is not None and not isinstance(place, str)
        target = free.cell_at((float(place[0]), float(place[1])))
        name = "the end" if stop is None else f"stop {stop} ({task.names[stop]})"
        try:
            check_plan(Problem(free, at, target, task.moves), plan)
            why = "" if plan.status is Status.FOUND else f" is no path: {plan.status.value}"
        except InvalidPlan as error:
            why = f": {error}"
        if why:
            faults.append(f"leg {k} to {name}{why}")
        at, broken = target, broken or bool(why)
        if broken:
            continue  # nothing can be said of times
        took = _time(tour, plan)
        now, driven = now + took, driven + took
        if stop is None:
            continue
        earliest, latest = (float(t) for t in task.windows[stop])
        waits = max(0.0, earliest - now)
        for what, stated, true in (("an arrival at", route.arrival[k], now), ("a wait of", route.waiting[k], waits)):
            if not math.isclose(stated, true, rel_tol=_NEAR, abs_tol=_NEAR * (1.0 + now)):
                faults.append(f"states for {name} {what} {float(stated)!r} s; it is {true!r} s")
        now += waits
        late += max(0.0, now - latest)
        now += float(task.service[stop])
    if broken:
        return faults, driven, now, late
    late += max(0.0, now - task.deadline)
    for what, stated, true in (
        ("length", route.length, math.fsum(plan.length for plan in route.legs)),
        ("duration", route.duration, now),
    ):
        if not math.isclose(stated, true, rel_tol=_NEAR, abs_tol=_NEAR):
            faults.append(f"states a {what} of {stated!r}; it is {true!r}")
    return faults, driven, now, late


def _time(tour: TourPlan, plan: Plan) -> float:
    """Return the time of a leg: the sum over its moves of length times mean cost of both ends, divided by the speed."""
    task = tour.task
    if task.costs is None:
        return plan.length / task.speed
    path: list[Cell] = [(int(r), int(c)) for r, c in plan.cells]
    moves = (math.dist(a, b) * (float(task.costs[a]) + float(task.costs[b])) / 2 for a, b in pairwise(path))
    return math.fsum(moves) * task.grid.resolution / task.speed


def _sum_faults(tour: TourPlan, late: float, driven: float, done: float) -> Iterator[str]:
    """Yield the figures of the whole tour that its routes contradict."""
    task, near = tour.task, _NEAR * (1.0 + done) * (1 + len(tour.task.stops))  # s
    worth = 0.0
    if task.priorities is not None:
        worth = math.fsum(float(task.priorities[stop]) for route in tour.routes for stop in route.order)
    for what, stated, true, slack in (
        ("length", tour.length, math.fsum(route.length for route in tour.routes), 0.0),
        ("duration", tour.duration, done, near),
        ("cost", tour.cost, done if task.objective == "makespan" else driven, near),
        ("lateness", tour.lateness, late, near),
        ("sum of priorities", tour.collected, worth, 0.0),
    ):
        if not math.isclose(stated, true, rel_tol=_NEAR, abs_tol=slack):
            yield f"states a {what} of {stated!r}; it is {true!r}"
    if tour.feasible and late > near:
        yield f"is called feasible and is {late!r} s late"
    if not tour.feasible and late == 0.0:
        yield "is called infeasible and is never late"
    best, least, slack = (tour.bound, tour.collected, 0.0) if task.priorities is not None else (tour.cost, tour.bound, near)
    if math.isnan(tour.bound) or tour.bound < 0 or (tour.feasible and least > best * (1 + _NEAR) + slack):
        yield f"has a bound of {tour.bound!r} that its own {'priorities' if task.priorities is not None else 'cost'} contradict"
    gap = 0.0 if best <= least else best / least - 1.0 if least > 0.0 else math.inf
    if not math.isclose(gap, tour.gap, rel_tol=_NEAR, abs_tol=_NEAR):
        yield f"states a gap of {tour.gap!r}; it is {gap!r}"
