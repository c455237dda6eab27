"""Ants in the space of controls beside MPPI weights, the cross-entropy method and random restarts, on the same rollouts.

Run as `python benchmarks/controls.py [--episodes N] [--robot NAME] [--first K]`. Each search draws as many sequences a cycle,
begins with the same seeds, judges by the same costs and drives with the same guard on the same episodes of suite `synthetic`,
numbered from K on. Prints a table and writes it to benchmarks/out/controls.json.
"""

from __future__ import annotations

import argparse
import time

import numpy as np

from antway.arena.suites import SuiteEpisode, load_suite, robot_name, stage
from antway.policies.antway.control_options import ControlOptions
from antway.policies.antway.policy import AntwayPolicy
from antway.world.episode import run
from antway.world.trace import Outcome
from report import markdown, write

SEARCHES = {
    "ants (ACO_R)": ControlOptions(),
    "MPPI weights": ControlOptions(search="mppi"),
    "cross-entropy method": ControlOptions(search="cem"),
    "random restarts": ControlOptions(search="random"),
}
LEVELS = ("low", "medium", "high")


def measure(name: str, level: str, episodes: int, first: int, robot: str) -> dict[str, object]:
    """Play the episodes of a level with one search."""
    suite = load_suite("synthetic")
    groups = [group for group in suite.groups if group.endswith(f"/{level}")]
    ratios, ms, outcomes = [], [], []
    for i in range(episodes):
        number, group = first + i // len(groups), groups[i % len(groups)]
        episode = SuiteEpisode("synthetic", f"synthetic on {robot_name(robot)}", group, number, robot)
        scenario, facts = stage(episode)
        result = run(scenario, AntwayPolicy(controls=SEARCHES[name]), seed=episode.seed, record=False)
        outcomes.append(result.outcome)
        ms.append(result.cycle_ms)
        if result.reached:
            ratios.append(result.time / facts.bound)
    return {
        "search": name,
        "level": level,
        "episodes": episodes,
        "success %": 100 * outcomes.count(Outcome.REACHED) / episodes,
        "time over the optimum": float(np.mean(ratios)),
        "contacts moving": outcomes.count(Outcome.HIT_MOVING),
        "contacts standing": outcomes.count(Outcome.HIT_STANDING),
        "median ms": float(np.median(np.concatenate(ms))),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=24, help="of each level")
    parser.add_argument("--first", type=int, default=0, help="number of the first episode")
    parser.add_argument("--robot", default="diff")
    arguments = parser.parse_args()
    started, rows = time.time(), []
    for name in SEARCHES:
        for level in LEVELS:
            rows.append(measure(name, level, arguments.episodes, arguments.first, arguments.robot))
            print(markdown(rows[-1], ".4g"), flush=True)
    write("controls.json", rows)
    print(f"{time.time() - started:.0f} s")


if __name__ == "__main__":
    main()
