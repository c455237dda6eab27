"""Tours on maps beside OR-Tools, PyVRP and LKH (elkai), each with the same time: python benchmarks/tours.py --tours 50.

Needs the extra `peers` and the maps of ../shared/data (see its SOURCES.md). Tours of 10 to 200 stops on random free places of
one part of a map; a third each is open, closed, or has a given end. All solvers get the same matrix of distances, as one closed
tour over a further node (see antway.tours.untimed). elkai has no limit of time: it makes its ten runs, however long they take.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

import antway
from antway.search.distance_field import distance_field
from antway.tours.distances import stop_distances
from antway.tours.ordering import order_stops
from peers import guided_search, ortools_route, pyvrp_routes
from report import DATA, write


def closed_matrix(away: np.ndarray, end: int | str | None) -> np.ndarray:
    """The matrix whose closed tours are tours with that end, as integers of up to 1e7."""
    n = len(away)
    if end != "start":
        away = np.pad(away, (0, 1), constant_values=2 * away.max())
        away[n, n] = away[0, n] = away[n, 0] = 0.0
        if end is not None:
            away[end, n] = away[n, end] = 0.0
    return np.rint(away * (1e7 / away.max())).astype(np.int64)


def as_order(ring: list[int], n: int) -> list[int]:
    """A closed tour over the matrix as an order that starts at 0."""
    ring = ring[:-1] if ring[0] == ring[-1] else ring
    at = ring.index(0)
    ring = ring[at:] + ring[:at]
    if n in ring:
        ring = ring if ring[-1] == n else [0, *ring[:0:-1]]
        ring.remove(n)
    return ring


def by_elkai(whole: np.ndarray, seconds: float) -> list[int]:
    import elkai

    return list(elkai.DistanceMatrix(whole.tolist()).solve_tsp())


def by_ortools(whole: np.ndarray, seconds: float) -> list[int]:
    from ortools.constraint_solver import pywrapcp

    manager = pywrapcp.RoutingIndexManager(len(whole), 1, 0)
    model = pywrapcp.RoutingModel(manager)
    rows = whole.tolist()
    model.SetArcCostEvaluatorOfAllVehicles(model.RegisterTransitMatrix(rows))
    return ortools_route(manager, model, model.SolveWithParameters(guided_search(seconds)))


def by_pyvrp(whole: np.ndarray, seconds: float) -> list[int]:
    import pyvrp
    from pyvrp.stop import MaxRuntime

    model = pyvrp.Model()
    places = [model.add_location(0, 0) for _ in whole]
    depot = model.add_depot(places[0])
    for place in places[1:]:
        model.add_client(place)
    model.add_vehicle_type(1, start_depot=depot, end_depot=depot)
    for i, a in enumerate(places):
        for j, b in enumerate(places):
            if i != j:
                model.add_edge(a, b, int(whole[i, j]))
    found = model.solve(MaxRuntime(seconds), seed=1, display=False)
    return [0, *(stop for route in pyvrp_routes(found) for stop in route)]


PEERS: dict[str, Callable[[np.ndarray, float], list[int]]] = {"elkai": by_elkai, "ortools": by_ortools, "pyvrp": by_pyvrp}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--tours", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--seed", type=int, default=2026)
    parser.add_argument("--peers", default="elkai,ortools,pyvrp")
    parser.add_argument("--out", type=Path)
    told = parser.parse_args()
    warnings.simplefilter("ignore")
    files = sorted((DATA / "movingai").glob("*.map")) + sorted((DATA / "ros_maps").glob("*/*.yaml"))
    grids = [(file.stem, antway.load_map(file)) for file in files if "invalid" not in file.stem]
    rng = np.random.default_rng(told.seed)
    order_stops(np.abs(np.subtract.outer(np.arange(20.0), np.arange(20.0))) % 7, cycles=2)  # loads the kernels
    rows: list[dict[str, object]] = []
    peers = [name for name in told.peers.split(",") if name]
    while len(rows) < told.tours:
        name, grid = grids[int(rng.integers(len(grids)))]
        free, n = np.argwhere(~grid.blocked), int(rng.integers(10, 201))
        reach = np.argwhere(np.isfinite(distance_field(grid, tuple(free[rng.integers(len(free))]))))
        if len(reach) < 4 * n:
            continue
        cells = [tuple(map(int, cell)) for cell in reach[rng.choice(len(reach), n, replace=False)]]
        end = (None, "start", n - 1)[len(rows) % 3]
        began = time.perf_counter()
        away = stop_distances(grid, cells)
        row: dict[str, object] = {"map": name, "stops": n, "end": end, "distances_s": time.perf_counter() - began}
        began = time.perf_counter()
        found = order_stops(away, end=end, seconds=told.seconds, seed=len(rows))
        row |= {"antway": found.cost, "antway_s": time.perf_counter() - began, "bound": found.bound}
        whole = closed_matrix(away, end)
        for peer in peers:
            began = time.perf_counter()
            order = as_order(PEERS[peer](whole, told.seconds), n)
            order += {None: [], "start": [0]}.get(end, [])
            assert sorted(set(order)) == list(range(n)) and order[0] == 0 and (end in (None, "start") or order[-1] == end)
            row |= {peer: float(away[order[:-1], order[1:]].sum()), f"{peer}_s": time.perf_counter() - began}
        rows.append(row)
        print("  ".join(f"{k} {v:.6g}" if isinstance(v, float) else f"{v}" for k, v in row.items()), flush=True)
    best = np.array([min(float(row[k]) for k in ["antway", *peers]) for row in rows])  # type: ignore[arg-type]
    print(f"\n{len(rows)} tours, {told.seconds:g} s each, seed {told.seed}")
    for who in ["antway", *peers]:
        over = np.array([float(row[who]) for row in rows]) / best - 1  # type: ignore[arg-type]
        took = np.array([float(row[f"{who}_s"]) for row in rows])  # type: ignore[arg-type]
        share, mean, worst = 100 * (over < 1e-6).mean(), 100 * over.mean(), 100 * over.max()
        times = f"{took.mean():.2f} s on the mean, {took.max():.2f} s at most"
        print(f"{who:8} best in {share:5.1f} %, mean {mean:.4f} %, worst {worst:.4f} % over; {times}")
    gap = 1 - np.array([float(row["bound"]) for row in rows]) / best  # type: ignore[arg-type]
    low, mean, high = 100 * gap.min(), 100 * gap.mean(), 100 * gap.max()
    print(f"bound: {mean:.3f} % below the best on the mean, {high:.3f} % at most, {low:.2g} % at least")
    if told.out is not None:
        write(told.out, rows)


if __name__ == "__main__":
    main()
