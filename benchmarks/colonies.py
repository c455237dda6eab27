"""Colonies on the TSP beside other people's, and the quality they must hold.

Run as `python benchmarks/colonies.py [--quality] [--search] [--immune] [--tsplib FOLDER] [--seeds N] [--seconds S] [--out F]`.
`--tsplib` plays a folder's instances of 500 to 2,400 cities with 3-opt for S s, beside ACOTSP if installed. Without a flag:
ants a second and gap at equal time against acopy, colonyx, scikit-opt and Stuetzle's ACOTSP (the C program `acotsp`), as far as
they are installed, as ratios in this run. aco-routing walks graphs, see walk.py.
Instances are read from ../shared/data/tsplib. Prints tables, writes JSON.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from antway.ants.immune import Immune
from antway.ants.rules import RULES
from antway.ants.tsp import load_tsp, solve_tsp
from antway.ants.tsplib import Tsp
from report import DATA, OUT, show, write, written

INSTANCES = DATA / "tsplib"
PLAIN = {
    "eil51": {"mmas": 427.0, "acs": 429.0, "eas": 429.0, "rank": 431.0, "as": 440.0},
    "kroA100": {"mmas": 21320.0, "acs": 21450.0, "eas": 21560.0, "rank": 21650.0, "as": 22600.0},
}
# (seconds, threads, mean gap that must be held)
SEARCHED = {
    "d198": (4, 1, 0.0),
    "lin318": (4, 1, 0.0),
    "att532": (10, 1, 5e-4),
    "rat783": (15, 1, 1e-3),
    "pr2392": (60, 2, 6e-3),
}
Rows = list[dict[str, object]]


def instance(name: str) -> Tsp:
    return load_tsp(INSTANCES / f"{name}.tsp")


def processor() -> float:
    """Seconds of processor time of this process and its children: what else the machine does hardly counts."""
    return sum(os.times()[:4])


def ours(problem: Tsp, seconds: float, rule: str = "mmas") -> tuple[float, float]:
    endless = Tsp(problem.xy, metric=problem.metric)  # without its optimum, at which the search would stop
    started = processor()
    tour = solve_tsp(endless, rule, ants=25, seconds=seconds)
    return tour.tours / (processor() - started), tour.length


def acopy(problem: Tsp, seconds: float) -> tuple[float, float]:
    import acopy
    import networkx

    graph, table = networkx.Graph(), matrix(problem)
    for i in range(problem.size):
        for j in range(i):
            graph.add_edge(i, j, weight=max(float(table[i, j]), 1e-9))
    solver, colony = acopy.Solver(rho=0.1, q=1), acopy.Colony(alpha=1, beta=3)
    started, tours, best = processor(), 0, np.inf
    for tour in solver.optimize(graph, colony, gen_size=25, limit=10**9):
        tours, best = tours + 25, min(best, tour.cost)
        if processor() - started >= seconds:
            break
    return tours / (processor() - started), best


def colonyx(problem: Tsp, seconds: float) -> tuple[float, float]:
    from colonyx import AutoColony

    table = matrix(problem)

    def run(cycles: int) -> float:
        colony = AutoColony("aco", n_iterations=cycles, random_state=0, n_ants=25, use_two_opt=False)
        colony.fit(table)
        return float(colony.score())

    return doubled(run, seconds)


def scikit_opt(problem: Tsp, seconds: float) -> tuple[float, float]:
    vars(np)["int"] = int  # which NumPy dropped in 1.24 and scikit-opt 0.6.6 still asks for
    from sko.ACA import ACA_TSP

    table = matrix(problem)

    def length(order: np.ndarray) -> float:
        return float(table[order, np.roll(order, -1)].sum())

    def run(cycles: int) -> float:
        return float(ACA_TSP(length, problem.size, 25, cycles, table + 1e-9).run()[1])

    return doubled(run, seconds)


def doubled(run: Callable[[int], float], seconds: float) -> tuple[float, float]:
    """A colony without a budget of time: twice as many cycles until they last."""
    cycles = 4
    while True:
        started = processor()
        length = run(cycles)
        spent = processor() - started
        if spent >= seconds / 2:
            return 25 * cycles / spent, length
        cycles *= 2


def acotsp(problem: Tsp, seconds: float) -> tuple[float, float]:
    """MMAS by the C program; reading the file and preparing count, a few milliseconds."""
    file, command = INSTANCES / f"{problem.name}.tsp", shutil.which("acotsp") or ""
    options = ["-x", "-r", "1", "-m", "25", "-g", "20", "-a", "1", "-b", "2", "-e", "0.02", "-l", "0", "-o", "1", "-t", "0.01"]

    def run(cycles: int) -> float:
        words = [command, "-i", str(file), *options, "-s", str(25 * cycles)]
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(words, cwd=folder, check=True, capture_output=True)
            found = (Path(folder) / f"best.{problem.name}").read_text()
        return float(re.findall(r"^Best:\s+(\d+)", found, re.MULTILINE)[0])

    return doubled(run, seconds)


def matrix(problem: Tsp) -> np.ndarray:
    cities = problem.cities(problem.size - 1)
    table = np.zeros((problem.size, problem.size))
    np.put_along_axis(table, cities.near.astype(int), cities.gap, 1)
    return table


PEERS: dict[str, tuple[bool, Callable[[Tsp, float], tuple[float, float]]]] = {
    "ACOTSP": (shutil.which("acotsp") is not None, acotsp),
    "colonyx": (find_spec("colonyx") is not None, colonyx),
    "acopy": (find_spec("acopy") is not None, acopy),
    "scikit-opt": (find_spec("sko") is not None, scikit_opt),
}


def best_of(run: Callable[[Tsp, float], tuple[float, float]], problem: Tsp, seconds: float) -> tuple[float, float]:
    """The highest rate of three runs, and their middle length."""
    rates, lengths = zip(*(run(problem, seconds) for _ in range(3)))
    return max(rates), sorted(lengths)[1]


def speed(seconds: float) -> Rows:
    rows: Rows = []
    for name in ("eil51", "kroA100"):
        problem = instance(name)
        ours(problem, 0.1)
        runs = {f"antway {rule}": partial(ours, rule=rule) for rule in RULES} | {
            peer: run for peer, (installed, run) in PEERS.items() if installed
        }
        results = {who: best_of(run, problem, seconds) for who, run in runs.items()}
        base = results["antway mmas"][0]
        for who, (rate, length) in results.items():
            gap = f"{100 * (length / problem.optimum - 1):.2f}"
            rows.append(
                {
                    "instance": name,
                    "colony": who,
                    "tours/s": round(rate),
                    "gap %": gap,
                    "times slower": round(base / rate, 2),
                }
            )
    return rows


def quality(seeds: int, only: list[str]) -> Rows:
    rows: Rows = []
    for name, rule, bound in [(name, *held) for name, rules in PLAIN.items() for held in rules.items()]:
        if only and name not in only and rule not in only:
            continue
        problem = instance(name)
        found = [solve_tsp(problem, rule, tours=10_000 * problem.size, seed=seed).length for seed in range(seeds)]
        rows.append(
            {
                "instance": name,
                "rule": rule,
                "mean": float(np.mean(found)),
                "at most": bound,
                "held": bool(np.mean(found) <= bound),
            }
        )
        print(rows[-1], flush=True)
    return rows


def searched(seeds: int, only: list[str]) -> Rows:
    """Runs of so many seconds of a thread's processor time, so that what else the machine does hardly counts."""
    rows: Rows = []
    for name, (seconds, threads, bound) in SEARCHED.items():
        if only and name not in only:
            continue
        problem = instance(name)
        solve_tsp(problem, local_search="3opt", cycles=1)
        gaps, times = [], []
        for seed in range(seeds):
            stop, started, last = threading.Event(), time.process_time(), [np.inf, 0.0]

            def watch(_tours: int, best: float, _seconds: float) -> None:
                spent = (time.process_time() - started) / threads  # noqa: B023
                if best < last[0]:  # noqa: B023
                    last[:] = best, spent  # noqa: B023
                if spent >= seconds:  # noqa: B023
                    stop.set()  # noqa: B023

            options = {"threads": threads, "seed": seed, "progress": watch, "cancel": stop}
            gaps.append(solve_tsp(problem, local_search="3opt", seconds=np.inf, **options).gap)
            times.append(last[1])
        rows.append(
            {
                "instance": name,
                "seconds": seconds,
                "threads": threads,
                "mean gap %": round(100 * float(np.mean(gaps)), 4),
                "optimal": f"{sum(gap == 0.0 for gap in gaps)}/{seeds}",
                "s to best, mean": round(float(np.mean(times)), 2),
                "most": round(max(times), 2),
                "at most %": 100 * bound,
                "held": float(np.mean(gaps)) <= bound,
            }
        )
        print(rows[-1], flush=True)
    return rows


def tsplib(folder: Path, seconds: float, seeds: int, only: list[str]) -> Rows:
    """Mean gap after so many seconds of one thread's processor time, and that of ACOTSP (MMAS with 3-opt, 25 ants, rho 0.8)."""
    rows: Rows = []
    command = shutil.which("acotsp")
    for file in sorted(folder.glob("*.tsp")):
        problem = load_tsp(file)
        if not 500 <= problem.size <= 2400 or problem.optimum is None or (only and problem.name not in only):
            continue
        gaps, peer = [], []
        solve_tsp(problem, local_search="3opt", cycles=2)  # compiles what is not compiled yet
        for seed in range(seeds):
            stop, started = threading.Event(), time.process_time()

            def watch(_tours: int, _best: float, _seconds: float) -> None:
                if time.process_time() - started >= seconds:  # noqa: B023
                    stop.set()  # noqa: B023

            options = {"local_search": "3opt", "seconds": np.inf, "seed": seed, "progress": watch, "cancel": stop}
            gaps.append(100.0 * (solve_tsp(problem, **options).length / problem.optimum - 1.0))
            if command is not None and "EXPLICIT" not in file.read_text():  # ACOTSP reads no matrices
                words = [command, "-i", str(file.resolve()), "-x", "-l", "3", "-r", "1", "-e", "0.2", "-t", str(seconds)]
                with tempfile.TemporaryDirectory() as out:
                    subprocess.run([*words, "-o", str(int(problem.optimum))], cwd=out, check=True, capture_output=True)
                    found = re.findall(r"^Best:\s+(\d+)", (Path(out) / f"best.{problem.name}").read_text(), re.MULTILINE)
                peer.append(100.0 * (float(found[0]) / problem.optimum - 1.0))
        theirs = round(float(np.mean(peer)), 3) if peer else None
        rows.append({"instance": problem.name, "gap %": round(float(np.mean(gaps)), 3), "ACOTSP %": theirs})
        print(rows[-1], flush=True)
    return rows


def immune(seeds: int) -> Rows:
    """The immune operator and its parts, off and on, at equal tours and at equal time."""
    plain = Immune(vaccinated=0.0, temperature=0.0, overlap=1.0, stagnation=0)
    settings = {
        "none": None,
        "vaccines": Immune(temperature=0.0, overlap=1.0, stagnation=0),
        "selection": Immune(vaccinated=0.0, overlap=1.0, stagnation=0),
        "concentration": Immune(vaccinated=0.0, temperature=0.0, stagnation=0),
        "suppression": Immune(vaccinated=0.0, temperature=0.0, overlap=1.0),
        "all": Immune(),
        "nothing on": plain,
    }
    problem, rows = instance("eil51"), []
    for rule in ("as", "mmas"):
        for label, policy in settings.items():
            runs = [solve_tsp(problem, rule, immune=policy, ants=25, cycles=400, seed=seed) for seed in range(seeds)]
            timed = [solve_tsp(problem, rule, immune=policy, ants=25, seconds=0.5, seed=seed).length for seed in range(seeds)]
            rows.append(
                {
                    "rule": rule,
                    "immune": label,
                    "400 cycles": round(float(np.mean([run.length for run in runs])), 1),
                    "ms a cycle": round(float(np.median([1000 * run.elapsed * 25 / run.tours for run in runs])), 3),
                    "0.5 s": round(float(np.mean(timed)), 1),
                }
            )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    for flag in ("quality", "search", "immune"):
        parser.add_argument(f"--{flag}", action="store_true")
    parser.add_argument("--tsplib", type=Path)
    parser.add_argument("--only", nargs="*", default=[], help="instances (or rules, of --quality)")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=2.0)
    parser.add_argument("--out", type=Path, default=OUT / "colonies.json")
    options = parser.parse_args()
    tables: dict[str, Rows] = {}
    if options.quality:
        tables["no local search, 10,000 n tours"] = quality(options.seeds, options.only)
    if options.search:
        tables["3-opt"] = searched(options.seeds, options.only)
    if options.tsplib is not None:
        tables["TSPLIB, 3-opt, one thread"] = tsplib(options.tsplib, options.seconds, options.seeds, options.only)
    if options.immune:
        tables["immune operator, eil51"] = immune(options.seeds)
    if not tables:
        tables["tours a second, 25 ants"] = speed(options.seconds)
    for title, rows in tables.items():
        show(rows, title, width=120)
    write(options.out, written(options.out) | tables)


if __name__ == "__main__":
    main()
