"""What a late start costs a robot that knows the future: python benchmarks/late_start.py --episodes 34.

For each level of suite `synthetic`, prints the mean time of the clairvoyant optimum of a robot without inertia that stands for
a while before it starts, over that of one that starts at once. A robot that reaches 1 m/s with 1 m/s^2 is 0.5 s late, and each
turn by 90 degrees at 1.9 rad/s makes it later by 0.3 s. docs/robots.md compares these times with those of robots on wheels.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from antway.arena.suites import SuiteEpisode, build, facts
from antway.arena.synthetic import FAMILIES
from antway.search.sipp import Sipp
from antway.world.line_of_sight import goal_of_cells


def ratios(episode: SuiteEpisode, delays: list[float]) -> list[float]:
    """Return the optimum of each delayed start over that of a start at once; NaN if the robot is hit while it stands."""
    scenario = build(episode)
    task, bound = scenario.task, facts(scenario, episode.seed).bound
    timeline = scenario.world.timeline(episode.seed, scenario.horizon)
    search = Sipp(task.grid, goal_of_cells(task), radius=task.robot.radius, v_max=task.robot.v_max)
    at_once = search.plan(task.start, timeline, horizon=scenario.horizon).arrival
    late = [search.plan(task.start, timeline, t=delay, horizon=scenario.horizon).arrival for delay in delays]
    return [1.0 + (arrival - at_once) / bound if np.isfinite(arrival) else np.nan for arrival in late]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=34, help="of each family of environments")
    parser.add_argument("--delays", default="0.5,0.75,1", help="s, separated by commas")
    options = parser.parse_args()
    delays = [float(delay) for delay in options.delays.split(",")]
    numbers = range(options.first, options.first + options.episodes)
    print("| level | " + " | ".join(f"{delay:g} s late" for delay in delays) + " |")
    print("|---" * (1 + len(delays)) + "|")
    with ProcessPoolExecutor() as workers:
        for level in ("low", "medium", "high"):
            episodes = [SuiteEpisode("synthetic", "synthetic", f"{family}/{level}", k) for family in FAMILIES for k in numbers]
            table = np.array(list(workers.map(ratios, episodes, [delays] * len(episodes))))
            print(f"| {level} | " + " | ".join(f"{value:.3f}" for value in np.nanmean(table, axis=0)) + " |")


if __name__ == "__main__":
    main()
