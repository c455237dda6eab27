"""What becomes of policy `antway` outside the assumptions of its promise (C27).

Run as `python benchmarks/outside.py [--episodes N]`. Plays the crowds of tests/crossing.py: twelve discs at 0.3-0.9 m/s
that never yield, told to the robot as at most 0.9 m/s. Prints a table with 95 % intervals; writes benchmarks/out/outside.json.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from antway import RobotSpec, run
from antway.arena.metrics import wilson
from crossing import crowd
from report import write

CELLS: dict[str, dict[str, Any]] = {
    "within the assumptions": {},
    "obstacles 1.5 times as fast as told": {"speed": (0.45, 1.35), "obstacle_speed": 0.9},
    "obstacles twice as fast as told": {"speed": (0.6, 1.8), "obstacle_speed": 0.9},
    "sensor range 1 m": {"robot": RobotSpec(sensor_range=1.0)},
    "sensor range 0.5 m": {"robot": RobotSpec(sensor_range=0.5)},
    "twice as fast, range 1 m": {"speed": (0.6, 1.8), "obstacle_speed": 0.9, "robot": RobotSpec(sensor_range=1.0)},
}
OUTCOMES = ("reached", "hit-moving", "hit-standing", "timeout")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=1000)
    episodes = parser.parse_args().episodes
    table = Table("", *OUTCOMES, title=f"outcomes in %, {episodes} episodes each, 95 % intervals")
    rows = {}
    for name, changes in CELLS.items():
        counts = Counter(run(crowd(seed, **changes), seed=seed, record=False).outcome.value for seed in range(episodes))
        assert set(counts) <= set(OUTCOMES), counts
        rows[name] = {what: (counts[what], *wilson(counts[what], episodes)) for what in OUTCOMES}
        table.add_row(name, *(f"{100 * n / episodes:.1f} ({100 * a:.1f}-{100 * b:.1f})" for n, a, b in rows[name].values()))
    Console().print(table)
    write("outside.json", rows)


if __name__ == "__main__":
    main()
