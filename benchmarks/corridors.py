"""How narrow a corridor a robot passes: python benchmarks/corridors.py --robots diff,inertia,jackal,amr.

A wall with a corridor divides a map of 8 x 6 m. For each gap between the robot and the corridor's walls, prints in how many of
the corridors (0.1, 0.5, 1 and 2 m long, starts at three places, cells of 2 cm) policy `antway` reaches the goal on the other
side within a minute, and the mean time. A footprint is as wide as its narrower side. docs/robots.md quotes it.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np

from antway import Grid, Scenario, World, run
from antway.world.robots import load_robot

CELL = 0.02  # m; edge of a cell
LENGTHS = (0.1, 0.5, 1.0, 2.0)  # m; of the corridor
STARTS = (1.0, 2.0, 3.0)  # m; the corridor's axis is at y = 3 m


def crossing_time(robot: str, gap: float, length: float, y: float) -> float:
    """Return the time in s to the goal behind a corridor with `gap` m on each side; infinite if the robot does not pass it."""
    spec = load_robot(robot)
    wide = round(2.0 * (spec.inscribed + gap) / CELL)
    blocked = np.zeros((round(6.0 / CELL), round(8.0 / CELL)), dtype=bool)
    blocked[:, round((4.0 - length / 2.0) / CELL) : round((4.0 + length / 2.0) / CELL)] = True
    blocked[(len(blocked) - wide) // 2 : (len(blocked) + wide) // 2] = False
    scenario = Scenario(World(Grid(blocked, CELL)), (1.0, y), (7.0, 6.0 - y), spec)
    result = run(scenario, "antway", seed=1)
    return result.time if result.reached else np.inf


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", default="diff,inertia,jackal,amr", help="names or files, separated by commas")
    parser.add_argument("--gaps", default="0.02,0.03,0.04,0.05,0.07,0.1", help="m on each side, separated by commas")
    options = parser.parse_args()
    gaps = [float(gap) for gap in options.gaps.split(",")]
    print("| robot | " + " | ".join(f"{100.0 * gap:g} cm" for gap in gaps) + " |")
    print("|---" * (1 + len(gaps)) + "|")
    with ProcessPoolExecutor() as workers:
        for robot in options.robots.split(","):
            cells = []
            for gap in gaps:
                times = np.array(list(workers.map(crossing_time, *zip(*product([robot], [gap], LENGTHS, STARTS)))))
                done = times[np.isfinite(times)]
                cells.append(f"{len(done)} of {len(times)}" + (f", {done.mean():.1f} s" if len(done) else ""))
            print(f"| {robot} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
