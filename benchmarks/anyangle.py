"""Any-angle paths beside A*, Theta* and Lazy Theta*, and D* Lite beside a fresh A* after every change.

Run as `python benchmarks/anyangle.py [--json FILE] [--queries N]`, on generated maps, and on the MovingAI maps where they are
found at ../shared/data/movingai. Times are the best of three for each query, in ms, and ratios within this run.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from antway import Grid, Moves, Plan, Problem, Status, check_plan, load_map
from antway.search.anyangle import anyangle
from antway.search.astar import astar
from antway.search.dstarlite import DStarLite
from report import DATA, write

MOVINGAI = DATA / "movingai"


def generated() -> dict[str, Grid]:
    """Scattered cells, blocks and a floor of rooms, 512 cells a side."""
    rng = np.random.default_rng(0)
    blocks, rooms = np.zeros((512, 512), dtype=bool), np.zeros((512, 512), dtype=bool)
    for r, c in rng.integers(0, 480, (300, 2)):
        blocks[r : r + rng.integers(4, 32), c : c + rng.integers(4, 32)] = True
    rooms[::32] = rooms[:, ::32] = True
    for r in range(0, 512, 32):
        for c in range(0, 512, 32):
            rooms[r, c + rng.integers(2, 28) : c + 30] = rooms[r + rng.integers(2, 28) : r + 30, c] = False
    return {"scattered": Grid(rng.random((512, 512)) < 0.1), "blocks": Grid(blocks), "rooms": Grid(rooms)}


def problems(name: str, grid: Grid, count: int) -> list[Problem]:
    """Long queries: of the scenario where there is one, else between random free cells."""
    rng = np.random.default_rng(1)
    scenario = MOVINGAI / f"{name}.map.scen"
    if scenario.is_file():
        rows = [line.split("\t") for line in scenario.read_text().splitlines()[1:]]
        picked = [list(map(int, rows[k][4:8])) for k in rng.permutation(len(rows))[:count]]
        return [Problem(grid, (r0, c0), (r1, c1)) for c0, r0, c1, r1 in picked]
    free = np.argwhere(~grid.blocked)
    return [Problem(grid, *(tuple(map(int, c)) for c in rng.choice(free, 2, replace=False))) for _ in range(count)]


def best(run: Callable[[], Plan]) -> tuple[float, Plan]:
    times = []
    for _ in range(3):
        started = time.perf_counter()
        plan = run()
        times.append(time.perf_counter() - started)
    return min(times) * 1e3, plan


def measure(name: str, grid: Grid, count: int) -> dict[str, object]:
    """Mean times of the planners on one map, and how much longer than optimal their paths are."""
    planners: dict[str, Callable[[Problem], Plan]] = {
        "astar": astar,
        "anyangle": anyangle,
        "theta": lambda problem: anyangle(problem, method="theta"),
        "lazy_theta": lambda problem: anyangle(problem, method="lazy-theta"),
    }
    total, excess = dict.fromkeys(planners, 0.0), dict.fromkeys(planners, 0.0)
    for problem in problems(name, grid, count):
        shortest = anyangle(problem)
        check_plan(problem, shortest)
        for planner, run in planners.items():
            ms, plan = best(lambda run=run, problem=problem: run(problem))  # type: ignore[misc]
            total[planner] += ms / count
            if shortest.status is Status.FOUND and shortest.length > 0 and plan.status is Status.FOUND:
                excess[planner] += (plan.length / shortest.length - 1) / count
    return {
        "map": name,
        **{f"{planner}_ms": ms for planner, ms in total.items()},
        "anyangle/astar": total["anyangle"] / total["astar"],
        "theta/anyangle": total["theta"] / total["anyangle"],
        **{f"{planner}_excess_%": 100 * excess[planner] for planner in ("astar", "theta", "lazy_theta")},
    }


def replan(name: str, grid: Grid) -> dict[str, object]:
    """Walk along the path; every few cells a cell ahead turns out blocked: D* Lite beside a fresh A*."""
    problem = max(problems(name, grid, 20), key=lambda p: plan.length if math.isfinite((plan := astar(p)).length) else 0.0)
    robot = DStarLite(Problem(grid, problem.start, problem.goal, Moves.EIGHT))
    plan, changes, expanded, fresh_expanded, ms, fresh_ms = robot.plan(), 0, 0, 0, 0.0, 0.0
    robot.move(problem.start)
    robot.change([problem.start], False)  # nothing new: loads the kernels
    while len(plan.cells) > 20 and changes < 100:
        started = time.perf_counter()
        robot.move(tuple(plan.cells[3].tolist()))
        robot.change(plan.cells[9:10], True)
        plan = robot.plan()
        ms += (time.perf_counter() - started) * 1e3
        fresh_expanded += DStarLite(robot.problem).plan().expanded
        peer_ms, peer = best(lambda: astar(robot.problem))
        assert plan.length == peer.length or math.isclose(plan.length, peer.length, rel_tol=1e-9)
        changes, expanded, fresh_ms = changes + 1, expanded + plan.expanded, fresh_ms + peer_ms
    return {
        "map": name,
        "changes": changes,
        "dstarlite_ms": ms / changes,
        "fresh_astar_ms": fresh_ms / changes,
        "time_ratio": ms / fresh_ms,
        "expanded_ratio": expanded / fresh_expanded,
    }


def show(rows: list[dict[str, object]]) -> None:
    print("  ".join(f"{name:>18}" for name in rows[0]))
    for row in rows:
        print("  ".join(f"{value:>18.3f}" if isinstance(value, float) else f"{value!s:>18.18}" for value in row.values()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--queries", type=int, default=50)
    options = parser.parse_args()
    maps = generated() | {path.stem: load_map(path) for path in sorted(MOVINGAI.glob("*.map"))}
    paths = [measure(name, grid, options.queries) for name, grid in maps.items()]
    show(paths)
    ratios = [float(str(row["anyangle/astar"])) for row in paths]
    print(f"geometric mean of anyangle/astar: {math.prod(ratios) ** (1 / len(ratios)):.3f}")
    replans = [replan(name, grid) for name, grid in maps.items()]
    show(replans)
    if options.json:
        write(options.json, {"paths": paths, "replans": replans})


if __name__ == "__main__":
    main()
