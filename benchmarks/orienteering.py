"""The best of stops by a deadline, and several robots, beside OR-Tools and PyVRP with ten times the time.

python benchmarks/orienteering.py --cases 30 --seconds 1 (needs the extra `peers`). Generated cases in turn: one robot that
collects as much as it can by a deadline; 2 to 5 robots, least time until the last is done; 2 to 5 robots with time windows,
least sum of travel times. PyVRP has no objective like the second. 30 to 100 stops; constants were chosen on --seed 1.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass

import numpy as np

from antway.tours.ordering import order_stops
from peers import guided_search, ortools_route, pyvrp_routes

SCALE = 1_000  # peers count in whole numbers
KINDS = ("orienteering", "makespan", "windows")


@dataclass
class Case:
    """A closed task on a plane; row 0 is the start."""

    kind: str
    matrix: np.ndarray
    windows: np.ndarray
    service: np.ndarray
    priorities: np.ndarray | None
    deadline: float
    robots: int


def generated(rng: np.random.Generator, kind: str) -> Case:
    """A random case; windows stand around the visits of random robots, so that it can be done."""
    n = int(rng.integers(30, 101))
    xy = rng.random((n, 2)) * 100
    matrix = np.floor(np.hypot(*(xy[:, None] - xy[None]).T) * SCALE) / SCALE
    windows, service = np.tile([0.0, 1e5], (n, 1)), np.zeros(n)
    if kind == "orienteering":
        priorities = rng.integers(1, 11, n).astype(float)
        priorities[0] = 0.0
        return Case(
            kind, matrix, windows, service, priorities, float(np.round(rng.uniform(0.2, 0.6) * 7.5 * np.sqrt(n) * 10)), 1
        )
    robots = int(rng.integers(2, 6))
    if kind == "makespan":
        return Case(kind, matrix, windows, service, None, 1e5, robots)
    service[1:] = 5.0
    for stops in np.array_split(1 + rng.permutation(n - 1), robots):
        at, now = 0, 0.0
        # Each robot goes on to the nearest of its stops, and some of them have windows around that visit.
        left = set(stops.tolist())
        while left:
            to = min(left, key=lambda stop: matrix[at, stop])
            left.remove(to)
            now += service[at] + matrix[at, to]
            if rng.random() < 0.6:
                windows[to] = np.round([max(0.0, now - rng.uniform(0, 60)), now + rng.uniform(10, 60)], 2)
            at = to
    return Case(kind, matrix, windows, service, None, 1e5, robots)


def value(case: Case, routes: list[list[int]]) -> float:
    """What a peer's routes are worth: priorities, makespan or travel time; -inf or inf if they break a rule."""
    broken = -np.inf if case.priorities is not None else np.inf
    inner = [stop for route in routes for stop in route]
    if len(set(inner)) != len(inner) or (case.priorities is None and len(inner) != len(case.matrix) - 1):
        return broken
    ends, travel = [], 0.0
    for route in routes:
        now, at = 0.0, 0
        for stop in [*route, 0]:
            now += case.service[at] + case.matrix[at, stop]
            travel += case.matrix[at, stop]
            now = max(now, case.windows[stop, 0]) if stop else now
            if stop and now > case.windows[stop, 1] + 1e-6:
                return broken
            at = stop
        ends.append(now)
    if max(ends) > case.deadline + 1e-6:
        return broken
    if case.priorities is not None:
        return float(case.priorities[inner].sum())
    return max(ends) if case.kind == "makespan" else travel


def by_antway(case: Case, seconds: float | None, cycles: int | None, seed: int) -> float:
    found = order_stops(
        case.matrix,
        end="start",
        windows=case.windows,
        service=case.service,
        priorities=case.priorities,
        deadline=case.deadline,
        robots=case.robots,
        objective="makespan" if case.kind == "makespan" else "travel time",
        seconds=seconds,
        cycles=cycles,
        seed=seed,
    )
    worth = value(case, [order[1:-1].tolist() for order in found.orders])
    assert not found.feasible or abs(worth - (found.collected if case.priorities is not None else found.cost)) < 1e-6
    return worth


def by_ortools(case: Case, seconds: float) -> float:
    from ortools.constraint_solver import pywrapcp

    n = len(case.matrix)
    travel = np.rint(case.matrix * SCALE).astype(int)
    spans = travel + np.rint(case.service * SCALE).astype(int)[:, None]
    manager = pywrapcp.RoutingIndexManager(n, case.robots, 0)
    model = pywrapcp.RoutingModel(manager)
    model.SetArcCostEvaluatorOfAllVehicles(model.RegisterTransitMatrix(travel.tolist()))
    horizon = int(case.deadline * SCALE)
    model.AddDimension(model.RegisterTransitMatrix(spans.tolist()), horizon, horizon, case.kind != "windows", "time")
    clock = model.GetDimensionOrDie("time")
    for stop in range(1, n):
        index = manager.NodeToIndex(stop)
        clock.CumulVar(index).SetRange(*(int(end) for end in np.rint(case.windows[stop] * SCALE)))
        if case.priorities is not None:
            model.AddDisjunction([index], int(case.priorities[stop]) * 10**7)
    if case.kind == "makespan":
        clock.SetGlobalSpanCostCoefficient(100)
    found = model.SolveWithParameters(guided_search(seconds, "PARALLEL_CHEAPEST_INSERTION"))
    if found is None:
        return value(case, [[1, 1]])  # an answer that breaks the rules
    return value(case, [ortools_route(manager, model, found, robot)[1:] for robot in range(case.robots)])


def by_pyvrp(case: Case, seconds: float) -> float:
    import pyvrp
    from pyvrp.stop import MaxRuntime

    if case.kind == "makespan":
        return np.inf
    model = pyvrp.Model()
    n = len(case.matrix)
    whole, windows = np.rint(case.matrix * SCALE).astype(int), np.rint(case.windows * SCALE).astype(int)
    places = [model.add_location(0, 0) for _ in range(n)]
    depot = model.add_depot(places[0])
    for stop in range(1, n):
        prize = {} if case.priorities is None else {"prize": int(case.priorities[stop]) * 10**7, "required": False}
        model.add_client(
            places[stop],
            tw_early=int(windows[stop, 0]),
            tw_late=int(windows[stop, 1]),
            service_duration=int(case.service[stop] * SCALE),
            **prize,
        )
    model.add_vehicle_type(case.robots, start_depot=depot, end_depot=depot, tw_late=int(case.deadline * SCALE))
    for i in range(n):
        for j in range(n):
            if i != j:
                model.add_edge(places[i], places[j], distance=int(whole[i, j]), duration=int(whole[i, j]))
    found = model.solve(MaxRuntime(seconds), seed=1, display=False)
    return value(case, pyvrp_routes(found))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=30)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--cycles", type=int, help="of antway, instead of its seconds, on a machine with other work")
    parser.add_argument("--only", choices=KINDS)
    parser.add_argument("--times", type=float, default=10.0, help="how many times as long the peers search")
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--peers", default="ortools,pyvrp")
    told = parser.parse_args()
    rng = np.random.default_rng(told.seed)
    by_antway(generated(np.random.default_rng(0), "windows"), 0.1, None, 0)  # loads the kernels
    short: list[float] = []
    for number in range(told.cases):
        case = generated(rng, KINDS[number % 3])
        if told.only not in (None, case.kind):
            short.append(0.0)
            continue
        began, used = time.perf_counter(), time.process_time()
        seconds = told.seconds if told.cycles is None else None
        own, better = by_antway(case, seconds, told.cycles, number), case.priorities is not None
        took, used = time.perf_counter() - began, time.process_time() - used
        peers = {}
        if "ortools" in told.peers:
            peers["ortools"] = by_ortools(case, told.times * told.seconds)
        if "pyvrp" in told.peers:
            peers["pyvrp"] = by_pyvrp(case, told.times * told.seconds)
        best = max([own, *peers.values()]) if better else min([own, *peers.values()])
        short.append(1.0 - own / best if better else own / best - 1.0)
        others = "  ".join(f"{who} {worth:.6g}" for who, worth in peers.items())
        size = f"{len(case.matrix)} stops, {case.robots} robots"
        print(
            f"{case.kind:12} {size}: antway {own:.6g} in {took:.2f} s ({used:.2f} s of processor time)  "
            f"{others}  {100 * short[-1]:.3f} % short of the best",
            flush=True,
        )
    for place, kind in enumerate(KINDS):
        own_short = np.array(short[place::3])
        if len(own_short) and told.only in (None, kind):
            budget = f"{told.seconds:g} s" if told.cycles is None else f"{told.cycles} cycles"
            print(
                f"{kind}: {len(own_short)} cases, {budget}; short of the best by {100 * own_short.mean():.3f} %"
                f" on the mean, {100 * own_short.max():.3f} % at most; within 1 % on {(own_short <= 0.01).sum()}"
            )


if __name__ == "__main__":
    main()
