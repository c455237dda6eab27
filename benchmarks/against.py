"""This checkout beside another one of antway, each in a process of its own, timed in turns.

Run as `python benchmarks/against.py OTHER [--rounds N] [--only WORD]`, where OTHER is the folder of another checkout (for an
older commit: `git worktree add OTHER COMMIT`). Each job is run by both, in turns, `--rounds` times after one that is not
counted, in CPU time; what is shown is the least of each and their ratio: the other's time over that of this checkout, so that
less than 1 means that this checkout is slower. Jobs use public names alone, which both checkouts have.
"""

from __future__ import annotations

import argparse
import importlib
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from report import DATA

HERE = Path(__file__).resolve().parent
PLANNERS = {"astar": 60, "jps": 400, "dijkstra": 6, "theta": 6, "subgoals": 400}  # queries a turn
MAPS = ("open", "scattered 20 %", "rooms")


def cpu(work: Callable[[], object]) -> float:
    """CPU time of `work` in all threads, s."""
    started = time.process_time()
    work()
    return time.process_time() - started


def jobs() -> dict[str, Callable[[], float]]:
    """What is timed, by name; each does its work once and returns the seconds that count."""
    import antway
    from search import generated

    found: dict[str, Callable[[], float]] = {}
    grids = generated(256)
    rng = np.random.default_rng(1)

    def queries(grid, planner, count):
        free = np.argwhere(~grid.blocked)
        ends = [grid.to_xy(free[rng.integers(len(free), size=2)]).tolist() for _ in range(count)]
        return lambda: [antway.plan(grid, start, goal, planner=planner) for start, goal in ends]

    for planner, count in PLANNERS.items():
        if planner in antway.PLANNERS:
            for name in MAPS:
                work = queries(grids[name], planner, count)
                found[f"{planner}, {name}"] = lambda work=work: cpu(work)
    for name in MAPS:
        grid = grids[name]
        cell = tuple(np.argwhere(~grid.blocked)[0].tolist())
        found[f"distance field, {name}"] = lambda grid=grid, cell=cell: cpu(
            lambda: [antway.distance_field(grid, cell) for _ in range(8)]
        )
        free = np.argwhere(~grid.blocked)
        starts, goals = free[rng.integers(len(free), size=(2, 2000))]
        found[f"many, {name}"] = lambda grid=grid, ends=(starts, goals): cpu(lambda: antway.solve_many(grid, *ends))
    walk = grids["scattered 20 %"]
    free = np.argwhere(~walk.blocked)
    problem = antway.Problem(walk, tuple(free[0].tolist()), tuple(free[-1].tolist()))
    found["explore, scattered 20 %"] = lambda: cpu(lambda: antway.explore(problem, seed=1))
    if (DATA / "tsplib" / "d198.tsp").exists():
        cities = antway.load_tsp(DATA / "tsplib" / "d198.tsp")
        found["TSP d198"] = lambda: cpu(lambda: antway.solve_tsp(cities, seed=1, cycles=100))
    for scene in ("paper", "office", "warehouse"):
        scenario = antway.load_scenario(importlib.import_module("antway.scenes").scene(scene))
        for policy in ("antway", "paper", "orca", "dwa"):

            def drive(scenario=scenario, policy=policy) -> float:
                result = antway.run(scenario, policy, seed=3)
                return float(np.median(result.cycle_ms)) / 1e3

            found[f"cycle of {policy}, scene {scene}"] = drive
    return found


def serve() -> None:
    """Do the jobs that are asked for by name on standard input, and print the seconds of each."""
    done = jobs()
    print(*done, "", sep="\n", flush=True)
    for line in sys.stdin:
        try:
            print(done[line.strip()](), flush=True)
        except Exception as error:
            print(f"failed: {type(error).__name__}: {error}", flush=True)


class Checkout:
    """A process that has imported antway from a checkout."""

    def __init__(self, folder: Path) -> None:
        paths = os.pathsep.join([str(folder / "src"), str(HERE)])
        self.process = subprocess.Popen(
            [sys.executable, __file__, "--serve"],
            env=os.environ | {"PYTHONPATH": paths},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self.names = []
        while line := self.line():
            self.names.append(line)

    def line(self) -> str:
        """The next line that it prints."""
        return self.process.stdout.readline().strip()

    def seconds(self, name: str) -> float:
        """Have a job done; returns its seconds, NaN where it failed."""
        self.process.stdin.write(name + "\n")
        self.process.stdin.flush()
        answer = self.line()
        if answer.startswith("failed"):
            print(f"{name}: {answer}", file=sys.stderr)
            return float("nan")
        return float(answer)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("other", type=Path)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--only", default="", help="do only jobs whose name has this in it")
    options = parser.parse_args()
    this, other = Checkout(HERE.parent), Checkout(options.other)
    table = Table("job", "other (ms)", "this (ms)", "ratio", title=f"The other over this checkout, least of {options.rounds}")
    ratios = []
    for name in this.names:
        if options.only in name and name in other.names:
            times = [(other.seconds(name), this.seconds(name)) for _ in range(options.rounds + 1)][1:]
            before, now = (min(column) for column in zip(*times, strict=True))
            ratios.append(before / now)
            table.add_row(name, f"{before * 1e3:.3f}", f"{now * 1e3:.3f}", f"{before / now:.3f}")
            print(f"{name}: {before / now:.3f}", file=sys.stderr)
    Console(width=100).print(table)
    print(f"least {np.nanmin(ratios):.3f}, geometric mean {np.exp(np.nanmean(np.log(ratios))):.3f} of {len(ratios)} jobs")


if __name__ == "__main__":
    if "--serve" in sys.argv:
        serve()
    else:
        main()
