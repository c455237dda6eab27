"""Ants on grids: steps a second beside peers, the paper's persistence, the shared grids, Pareto fronts, the immune operator.

Run as `python benchmarks/walk.py [--json FILE] [--quick]`. All ratios are within one run, best of several. With `--rules` it
compares the rules of a colony at their default 50 cycles, and nothing else.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from functools import partial
from itertools import count, product
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit

from antway import Budget, Grid, Moves, Problem
from antway.ants.front import pareto
from antway.ants.grid_walk import AntGraph, Ants, Trail
from antway.ants.gridpath import ants, explore
from antway.ants.immune import Immune
from antway.ants.persistence import Adaptive, Constant, Persistence, Printed
from antway.ants.rules import RULES, make_rule
from report import DATA, write

PERSISTENCE: dict[str, Persistence] = {"constant 0.7": Constant(0.7), "printed": Printed(), "corrected": Adaptive()}


def shared(name: str, moves: Moves) -> Problem:
    rows = (DATA / "grids" / f"{name}.txt").read_text().split()
    grid = Grid(np.array([[cell == "@" for cell in row] for row in rows]))
    return Problem(grid, (0, 0), (grid.shape[0] - 1, grid.shape[1] - 1), moves)


def scattered(size: int = 50, density: float = 0.25) -> AntGraph:
    """A seeded random square with the ends in its corners."""
    for seed in range(100):
        blocked = np.random.default_rng(seed).random((size, size)) < density
        blocked[0, 0] = blocked[-1, -1] = False
        graph = AntGraph(Problem(Grid(blocked), (0, 0), (size - 1, size - 1)))
        if np.isfinite(graph.bound):
            return graph
    raise AssertionError("no map")


def best_rates(runs: dict[str, Callable[[], int]], repeats: int) -> dict[str, float]:
    """Million steps a second of each run, which returns the steps it made: best of `repeats` rounds that take all in turn."""
    rates = dict.fromkeys(runs, 0.0)
    for turn in range(repeats + 1):
        for name, run in runs.items():
            started = time.perf_counter()
            rate = run() / (time.perf_counter() - started) / 1e6
            rates[name] = max(rates[name], rate) if turn else 0.0  # the first round compiles
    return rates


@njit
def casual(blocked, goal, tau, distance, alpha, beta, ants, limit):  # type: ignore[no-untyped-def]
    """The walk as one writes it down at first: neighbours and powers at each step, NumPy's random numbers, no retreat."""
    rows, cols = blocked.shape
    steps = 0
    for _ in range(ants):
        visited = np.zeros((rows, cols), dtype=np.bool_)
        r, c = 0, 0
        visited[r, c] = True
        for _ in range(limit):
            weights = np.zeros(8)
            k = 0
            for dr in range(-1, 2):
                for dc in range(-1, 2):
                    if dr == 0 and dc == 0:
                        continue
                    i, j = r + dr, c + dc
                    free = 0 <= i < rows and 0 <= j < cols and not blocked[i, j] and not visited[i, j]
                    if free and not (dr and dc and (blocked[i, c] or blocked[r, j])):
                        weights[k] = tau[r, c, k] ** alpha * (1.0 / max(distance[i, j], 1e-3)) ** beta
                    k += 1
            total = weights.sum()
            if total == 0.0:
                break
            drawn, k = np.random.random() * total, 0  # noqa: NPY002
            while k < 7 and drawn >= weights[k]:
                drawn -= weights[k]
                k += 1
            k += k >= 4
            r, c = r + k // 3 - 1, c + k % 3 - 1
            visited[r, c] = True
            steps += 1
            if (r, c) == goal:
                break
    return steps


def routing(graph: AntGraph) -> Callable[[], int] | None:
    """A walk of ten ants of the package aco-routing on the same graph, None if it is not installed."""
    try:
        import networkx as nx
        from aco_routing.aco import ACO
        from aco_routing.ant import Ant
    except ImportError:
        return None
    network = nx.DiGraph()
    for cell, bits in enumerate(graph.net.legal.tolist()):
        for k in range(8):
            if bits >> k & 1:
                network.add_edge(str(cell), str(cell + int(graph.offsets[k])), cost=float(Moves.EIGHT.lengths[k]))
    colony = ACO(network, ant_max_steps=100, num_iterations=1, ant_random_spawn=False)

    def run() -> int:
        colony.search_ants = [Ant(colony.graph_api, str(graph.start), str(graph.goal)) for _ in range(10)]
        colony._deploy_forward_search_ants()
        return sum(len(ant.path) - 1 for ant in colony.search_ants)

    return run


def speed(repeats: int) -> dict[str, float]:
    """Million ant steps a second on one core: the walk alone, peers, and whole cycles by rule."""
    graph, clock = scattered(), Budget().start()
    runs: dict[str, Callable[[], int]] = {}

    def walker(heuristic: str, rule: str) -> Callable[[], int]:
        trail = Trail(graph, make_rule(rule, beta=8.0 if heuristic == "field" else 7.0), 2000, heuristic)
        walkers, number = Ants(graph, 2000, 700), count(0, 2000)
        return lambda: walkers.walk(trail.weights(), 1, next(number), clock, greedy=trail.numbers.q0)

    runs["walk, field"] = walker("field", "as")
    runs["walk, distance"] = walker("distance", "as")
    runs["walk, field, greed of acs"] = walker("field", "acs")
    distance = graph.distance.reshape(-1, graph.net.width)[1:-1, 1:-1].copy()
    tau = np.ones((*distance.shape, 8))
    blocked, goal = graph.problem.grid.blocked, graph.problem.goal
    runs["casual Numba, distance"] = lambda: casual(blocked, goal, tau, distance, 1.0, 7.0, 500, 700)
    peer = routing(graph)
    if peer:
        runs["aco-routing"] = peer
    for rule in RULES:
        runs[f"20 cycles of 500 ants, {rule}"] = partial(cycles_of, graph.problem, rule)
    return best_rates(runs, repeats)


def cycles_of(problem: Problem, rule: str) -> int:
    return explore(problem, rule=rule, ants=500, cycles=20, record=False).plan.expanded


def paper(seeds: int) -> dict[str, Any]:
    """Ant System as printed, 50 ants x 50 cycles on the 30 x 30 grid (optimum 44.527), by persistence."""
    problem, rows = shared("iq30", Moves.EIGHT_NOSQUEEZE), {}
    for name, persistence in PERSISTENCE.items():
        runs = [
            explore(
                problem,
                seed=s,
                rule="as",
                ants=50,
                cycles=50,
                persistence=persistence,
                heuristic="goal",
                retreat=False,
                step_limit=100,
            )
            for s in range(seeds)
        ]
        rows[name] = {
            "mean length": float(np.mean([run.plan.length for run in runs])),
            "optimal": float(np.mean([run.plan.optimal for run in runs])),
            "arrived": float(np.mean([run.history[:, 2].mean() for run in runs])),
        }
    return rows


def immunity(seeds: int) -> dict[str, Any]:
    """The immune operator and its parts on the 30 x 30 grid: 50 ants x 50 cycles by the straight distance to the goal."""
    problem, rows = shared("iq30", Moves.EIGHT_NOSQUEEZE), {}
    none = {"vaccinated": 0.0, "temperature": 0.0, "overlap": 1.0, "stagnation": 0}
    parts: dict[str, Immune | None] = {
        "without": None,
        "whole": Immune(),
        "vaccination": Immune(**(none | {"vaccinated": 0.3})),
        "selection": Immune(**(none | {"temperature": 0.1})),
        "concentration": Immune(**(none | {"overlap": 0.9})),
    }
    for rule in ("as", "mmas"):
        for name, immune in parts.items():
            options: dict[str, Any] = {"rule": rule, "persistence": Constant(0.7), "heuristic": "goal", "step_limit": 200}
            started = time.perf_counter()
            runs = [explore(problem, seed=s, immune=immune, cycles=50, **options) for s in range(seeds)]
            rows[f"{rule}, {name}"] = {
                "mean length": float(np.mean([run.plan.length for run in runs])),
                "optimal": float(np.mean([run.plan.optimal for run in runs])),
                "seconds": (time.perf_counter() - started) / seeds,
            }
    return rows


def grids(seeds: int) -> dict[str, Any]:
    """Default ants on the shared grids: share optimal, cycles needed, time; and the share of whole fronts."""
    table = json.loads((DATA / "grids" / "optima.json").read_text())
    rows: dict[str, Any] = {}
    for name, lengths in table["optimum"].items():
        for rule, moves in (("nocut", Moves.EIGHT), ("nosqueeze", Moves.EIGHT_NOSQUEEZE)):
            problem = shared(name, moves)
            plans = [ants(problem, seed=seed) for seed in range(seeds)]
            needed = [len(explore(problem, seed=seed, stop_at_bound=True).history) for seed in range(seeds)]
            row = {
                "optimal": float(np.mean([abs(plan.length - lengths[rule][0]) < 1e-3 for plan in plans])),
                "cycles": float(np.mean(needed)),
                "ms median": 1e3 * float(np.median([plan.elapsed for plan in plans])),
                "ms most": 1e3 * max(plan.elapsed for plan in plans[1:]),
            }
            if rule == "nosqueeze":
                exact = [(turns, round(length, 3)) for turns, length in table["front_nosqueeze"][name]]
                started = time.perf_counter()
                fronts = [pareto(problem, seed=seed).values.tolist() for seed in range(seeds)]
                row["front s"] = (time.perf_counter() - started) / seeds
                row["front whole"] = float(np.mean([[(t, round(v, 3)) for v, t in front] == exact for front in fronts]))
            rows[f"{name} {rule}"] = row
    return rows


def show(title: str, rows: dict[str, Any]) -> None:
    print(f"\n{title}")
    for name, row in rows.items():
        cells = row.items() if isinstance(row, dict) else [("", row)]
        print(f"  {name:34}" + "  ".join(f"{key} {value:.3f}".strip() for key, value in cells))


def rules() -> None:
    """Print by how many % the best of 50 ants x 50 cycles is over the shortest path, two seeds on each of six maps."""
    for heuristic, side, density in product(("goal", "distance"), (30, 50), (0.2, 0.3)):
        if (side, density) in ((30, 0.3), (50, 0.2)):
            continue
        over: dict[str, list[float]] = {rule: [] for rule in (*RULES, "mmas, rho 0.98")}
        for seed in count(90_000):
            blocked = np.random.default_rng(seed).random((side, side)) < density
            blocked[0, 0] = blocked[-1, -1] = False
            problem = Problem(Grid(blocked), (0, 0), (side - 1, side - 1))
            if not math.isfinite(AntGraph(problem).bound):
                continue
            for rule, found in over.items():
                own = make_rule("mmas", beta=7.0) if rule == "mmas, rho 0.98" else rule
                for draw in (seed, seed + 1):
                    plan = explore(problem, rule=own, heuristic=heuristic, seed=draw).plan
                    found.append(100.0 * (plan.length / plan.lower_bound - 1.0))
            if len(over["as"]) == 12:
                break
        means = "  ".join(f"{rule} {np.mean(found):.2f}" for rule, found in over.items())
        print(f"eta by {heuristic}, {side} x {side}, {100 * density:.0f} % blocked: {means}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--quick", action="store_true", help="few repeats and seeds")
    parser.add_argument("--rules", action="store_true")
    given = parser.parse_args()
    if given.rules:
        rules()
        return
    seeds, repeats = (3, 3) if given.quick else (30, 15)
    rates = speed(repeats)
    result: dict[str, Any] = {"million steps a second": rates}
    result["ratios"] = {f"walk, distance / {peer}": rates["walk, distance"] / rates[peer] for peer in rates if peer[0] in "ca"}
    result["ratios"]["slowest rule / as, time"] = max(
        rates["20 cycles of 500 ants, as"] / rates[f"20 cycles of 500 ants, {rule}"] for rule in RULES
    )
    if DATA.is_dir():
        result["persistence on 30 x 30, optimum 44.527"] = paper(seeds)
        result["immune operator on 30 x 30, optimum 44.527"] = immunity(seeds)
        result["shared grids, default ants"] = grids(seeds)
    else:
        print(f"no {DATA}: the persistence, the immune operator and the shared grids are left out")
    for title, rows in result.items():
        show(title, rows)
    if given.json:
        write(given.json, result)


if __name__ == "__main__":
    main()
