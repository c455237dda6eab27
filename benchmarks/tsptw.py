"""Tours with time windows on four public sets, beside OR-Tools, PyVRP and Beam-ACO.

Run as `python benchmarks/tsptw.py --seeds 5 --seconds 10 [--sets S] [--every N] [--half new] [--peers ortools,pyvrp,beam-aco]`.
Needs ../shared/data/tsptw (see SOURCES.md there) and, for --peers, the extra `peers`. Each instance is solved once a seed, on
one core, until it costs no more than the best known value of the set's list, or for --seconds of processor time. Every answer
is checked by `check_tsptw`; "best" means the listed value or less. The constants of the search were chosen on SolomonPesant
rc20?.0 and .2, SolomonPotvinBengio rc_20?.1 and .3, AFG rbg0??a and rbg201a, and Dumas *.001 and *.004, and how wide beams
alternate on AFG rbg050b, rbg193 and rbg233 too; `--half new` shows the others alone. Peers search for as many seconds an
instance, in one run, as they take no best known value to stop at. Beam-ACO is its authors' own program (`beamaco_tsptw`, built
by `make DEBUG=0 NUMBER_TYPE=DOUBLE` from github.com/MLopez-Ibanez/beam-aco-tsptw); of its two runs, with the options that it
comes with and with a beam of ten, each with the whole time, the better one counts.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import threading
import time
from pathlib import Path

import numpy as np

from antway import InvalidPlan, check_tsptw, load_tsptw, solve_tsptw
from antway.tours.time_windows import Tsptw
from peers import guided_search, ortools_route, pyvrp_routes
from report import DATA

INSTANCES = DATA / "tsptw"
SETS = ("SolomonPotvinBengio", "SolomonPesant", "Dumas", "AFG")
TUNED = re.compile(
    r"rc20\d\.[02]$|rc_20\d\.[13]\.txt|rbg0\d\da\.tw|rbg201a|rbg050b|rbg193\.tw|rbg233\.tw|n\d+w\d+\.00[14]\.txt"
)
NEAR = 0.01  # the lists have two places, some of them cut off


def known_values(folder: str) -> dict[str, float]:
    """The best known values of a set, by file."""
    lines = (INSTANCES / "best_known_sol" / f"{folder}.txt").read_text(encoding="utf-8").splitlines()
    return {words[0]: float(words[1]) for line in lines if (words := line.split()) and words[0] != "#"}


def by_antway(instance: Tsptw, seconds: float, seed: int, target: float) -> tuple[float, float]:
    """(cost, seconds of processor time); infinite if no order in time was found."""
    stop, over = threading.Event(), threading.Event()

    def watch(end: float) -> None:
        while not over.wait(0.01):
            if time.process_time() >= end:
                stop.set()

    began = time.process_time()
    watcher = threading.Thread(target=watch, args=(began + seconds,))
    watcher.start()
    result = solve_tsptw(instance, seconds=np.inf, seed=seed, target=target, cancel=stop)
    took = time.process_time() - began
    over.set()
    watcher.join()
    check_tsptw(instance, result.order, result.cost, feasible=result.feasible)
    return result.cost if result.feasible else np.inf, took


def checked(instance: Tsptw, order: list[int], began: float) -> tuple[float, float]:
    """(cost, seconds) of a peer's order; infinite if it is none or late."""
    took = time.perf_counter() - began
    try:
        check_tsptw(instance, order)
    except InvalidPlan:
        return np.inf, took
    return float(sum(instance.matrix[a, b] for a, b in zip(order, [*order[1:], 0]))), took


def whole_numbers(instance: Tsptw) -> tuple[list[list[int]], list[list[int]]]:
    """Times and windows as integers."""
    scale = 1 if np.array_equal(np.rint(instance.matrix), instance.matrix) else 10_000
    return np.rint(instance.matrix * scale).astype(int).tolist(), np.rint(instance.windows * scale).astype(int).tolist()


def by_ortools(instance: Tsptw, seconds: float) -> tuple[float, float]:
    from ortools.constraint_solver import pywrapcp

    began = time.perf_counter()
    matrix, windows = whole_numbers(instance)
    manager = pywrapcp.RoutingIndexManager(instance.size, 1, 0)
    model = pywrapcp.RoutingModel(manager)
    transit = model.RegisterTransitMatrix(matrix)
    model.SetArcCostEvaluatorOfAllVehicles(transit)
    horizon = windows[0][1]
    model.AddDimension(transit, horizon, horizon, False, "time")
    clock = model.GetDimensionOrDie("time")
    for node in range(1, instance.size):
        clock.CumulVar(manager.NodeToIndex(node)).SetRange(*windows[node])
    found = model.SolveWithParameters(guided_search(seconds))
    order = [] if found is None else ortools_route(manager, model, found)
    return checked(instance, order, began)


def by_pyvrp(instance: Tsptw, seconds: float) -> tuple[float, float]:
    import pyvrp
    from pyvrp.stop import MaxRuntime

    began = time.perf_counter()
    matrix, windows = whole_numbers(instance)
    model = pyvrp.Model()
    places = [model.add_location(0, 0) for _ in matrix]
    depot = model.add_depot(places[0])
    for node in range(1, instance.size):
        model.add_client(places[node], tw_early=windows[node][0], tw_late=windows[node][1])
    model.add_vehicle_type(1, start_depot=depot, end_depot=depot, tw_early=windows[0][0], tw_late=windows[0][1])
    for i, a in enumerate(places):
        for j, b in enumerate(places):
            if i != j:
                model.add_edge(a, b, distance=matrix[i][j], duration=matrix[i][j])
    found = model.solve(MaxRuntime(seconds), seed=1, display=False)
    order = [0, *(stop for route in pyvrp_routes(found) for stop in route)]
    return checked(instance, order, began)


def by_beam_aco(file: Path, instance: Tsptw, seconds: float, seed: int) -> tuple[float, float]:
    """The better of the authors' default options and of a beam of ten partial orders, with their local search in both."""
    program, found = shutil.which("beamaco_tsptw"), []
    if program is None:
        raise SystemExit("Beam-ACO: no program beamaco_tsptw on the PATH (--help says where it comes from)")
    began = time.perf_counter()
    for options in ((), ("-b", "10", "-m", "1.5", "-S", "5", "--sample-rate", "10")):
        words = [program, "-i", str(file), "-s", str(seed + 1), "-t", str(seconds), "-r", "1", "--ls=first", *options]
        said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
        # After "begin try": cost, seconds, makespan, two penalties, violated windows, then the order without the depot.
        line = said.partition("# begin try")[2].splitlines()[1].split()
        order = [0, *map(int, line[6:])]
        found.append(checked(instance, order, began)[0])
    return min(found), (time.perf_counter() - began) / len(found)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", default=",".join(SETS))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--every", type=int, default=1, help="take every so many instances of a set")
    parser.add_argument("--half", choices=("all", "new"), default="all", help="new: those on which no constant was chosen")
    parser.add_argument("--peers", default="", help="ortools,pyvrp,beam-aco")
    told = parser.parse_args()
    peers = [name for name in told.peers.split(",") if name]
    solve_tsptw(Tsptw(np.ones((8, 8)), np.tile([0.0, 99.0], (8, 1))), cycles=8)  # loads the kernels
    for folder in told.sets.split(","):
        known = known_values(folder)
        names = sorted(file.name for file in (INSTANCES / folder).iterdir() if file.name in known)
        names = [name for name in names if told.half == "all" or not TUNED.search(name)][:: told.every]
        gaps: dict[str, list[list[float]]] = {who: [] for who in ["antway", *peers]}
        took: dict[str, list[float]] = {who: [] for who in gaps}
        for name in names:
            instance, best = load_tsptw(INSTANCES / folder / name), known[name]
            runs = {"antway": [by_antway(instance, told.seconds, seed, best + NEAR) for seed in range(told.seeds)]}
            if "ortools" in peers:
                runs["ortools"] = [by_ortools(instance, told.seconds)]
            if "pyvrp" in peers:
                runs["pyvrp"] = [by_pyvrp(instance, told.seconds)]
            if "beam-aco" in peers:
                runs["beam-aco"] = [
                    by_beam_aco(INSTANCES / folder / name, instance, told.seconds, seed) for seed in range(told.seeds)
                ]
            for who, results in runs.items():
                gaps[who].append([0.0 if abs(cost - best) <= NEAR else cost / best - 1.0 for cost, _ in results])
                took[who] += [seconds for _, seconds in results]
            if max(gaps["antway"][-1]) > 0.0:
                print(f"  {folder} {name}: best known {best:g}, found {', '.join(f'{cost:.6g}' for cost, _ in runs['antway'])}")
        print(f"{folder}: {len(names)} instances, {told.seconds:g} s, {told.seeds} seeds (one of ortools and pyvrp)")
        for who, rows in gaps.items():
            reached = sum(max(row) <= 0.0 for row in rows)
            found = np.array([max(0.0, gap) for row in rows for gap in row if np.isfinite(gap)])
            none = sum(not np.isfinite(gap) for row in rows for gap in row)
            less = sum(min(row) < 0.0 for row in rows)
            print(
                f"  {who:8} best known in every run on {reached} of {len(rows)} (below it on {less}), mean gap"
                f" {100 * found.mean() if len(found) else np.inf:.4f} %, {none} runs without an order in time;"
                f" {np.mean(took[who]):.2f} s a run, {np.max(took[who]):.2f} s at most",
                flush=True,
            )


if __name__ == "__main__":
    main()
