"""Choose the options of the baselines by grid search, on episodes that no table counts.

Run as `python benchmarks/tune.py [--robot NAME] [--groups A,B] [--more N] [BASELINE ...]`. Every combination of a baseline's
options plays the suite `synthetic`, one episode of each of its 18 groups, or of those given, numbered from 10,000 on; the best
quarter, three at least, plays N more. The winner reached the goal most often and, among equals, in the least time over the
clairvoyant optimum. Prints the best five and writes them to benchmarks/out/tune.json.
"""

from __future__ import annotations

import argparse
from itertools import product

from antway.arena.engines import Job, play
from antway.arena.store import Row
from antway.arena.suites import SuiteEpisode, load_suite, robot_name
from antway.arena.summary import Summary, summarise
from report import write, written

FIRST = 10_000  # number of the first episode; tables count from 0
GRIDS: dict[str, dict[str, tuple[object, ...]]] = {
    "stop": {"lookahead": (0.5, 1.0, 2.0, 3.0), "margin": (0.05, 0.1, 0.2)},
    "replan": {"margin": (0.1, 0.2, 0.3, 0.45, 0.6)},
    "dstarlite": {"margin": (0.1, 0.2, 0.3, 0.45, 0.6)},
    "sipp": {"margin": (0.05, 0.1, 0.2, 0.3), "horizon": (3.0, 5.0, 8.0)},
    "sipp/predictions=mirrored": {"margin": (0.05, 0.1, 0.2, 0.3), "horizon": (3.0, 5.0, 8.0)},
    "potential-field": {"moving": (0.02, 0.05, 0.1, 0.2), "far": (0.7, 1.0, 1.5, 2.0), "brake": (1.0, 2.0, 4.0)},
    "neural": {"sweeps": (4, 12), "margin": (0.1, 0.2, 0.3, 0.4)},
    "glasius": {"gain": (0.95, 0.99), "margin": (0.1, 0.2, 0.3, 0.4)},
    "dwa": {"dist": (0.5, 1.0, 2.0), "horizon": (2.0, 3.0), "margin": (0.1, 0.2)},
    "orca": {"horizon": (1.0, 2.0, 3.0, 5.0), "margin": (0.01, 0.05, 0.1, 0.2)},
}
ON_WHEELS: dict[str, dict[str, tuple[object, ...]]] = {
    "mppi": {"temperature": (0.1, 0.3), "turn_noise": (0.25, 0.4), "margin": (0.08, 0.12)},
    "dwa": {"vel": (0.25, 0.5), "horizon": (2.0, 3.0), "aim": (0.7, 1.2), "margin": (0.1, 0.2)},
    "nh-orca": {"horizon": (1.0, 2.0), "wall_horizon": (0.5, 1.0, 2.0), "error": (0.05, 0.1, 0.2), "turn_time": (0.35, 0.7)},
}


def tune(baseline: str, robot: str, groups: tuple[str, ...], more: int) -> list[tuple[str, Summary]]:
    """Return the candidates of the second round, best first."""
    options = (ON_WHEELS if robot else GRIDS)[baseline]
    suite = f"synthetic on {robot_name(robot)}" if robot else "synthetic"
    specs = [f"{baseline}/" + "/".join(map("{}={}".format, options, values)) for values in product(*options.values())]
    rows: dict[str, list[Row]] = {spec: [] for spec in specs}
    for low, high, kept in ((0, 1, len(specs)), (1, 1 + more, max(3, len(specs) // 4))):
        specs = sorted(specs, key=lambda spec: _score(rows[spec]))[:kept]
        for number in range(FIRST + low, FIRST + high):
            for group in groups:
                episode = SuiteEpisode("synthetic", suite, group, number, robot)
                for spec in specs:
                    rows[spec].append(play(Job(episode, spec))[0])
    return [(spec, summarise(rows[spec])[-1]) for spec in sorted(specs, key=lambda spec: _score(rows[spec]))]


def _score(rows: list[Row]) -> tuple[int, float]:
    """Least is best: episodes not reached, and mean time over the optimum of the others."""
    return (sum(not row.reached for row in rows), summarise(rows)[-1].time_ratio) if rows else (0, 0.0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("baselines", nargs="*", metavar="BASELINE", help=f"{', '.join(GRIDS)}; all of them without any")
    parser.add_argument("--robot", default="", help=f"a robot on wheels, for {', '.join(ON_WHEELS)}")
    parser.add_argument("--groups", default="", help="of suite synthetic, separated by commas; all if left out")
    parser.add_argument("--more", type=int, default=3, help="episodes of each group that the best play beyond the first")
    arguments = parser.parse_args()
    groups = tuple(arguments.groups.split(",")) if arguments.groups else load_suite("synthetic").groups
    wanted = arguments.baselines or list(ON_WHEELS if arguments.robot else GRIDS)
    found = written("tune.json")
    for baseline in wanted:
        best = tune(baseline, arguments.robot, groups, arguments.more)[:5]
        for spec, one in best:
            print(f"{spec}: {100 * one.success:.1f} % of {one.episodes}, {one.time_ratio:.3f} of the optimum", flush=True)
        found[f"{baseline} {arguments.robot}".strip()] = {
            "best": best[0][0],
            "success": best[0][1].success,
            "time_ratio": best[0][1].time_ratio,
        }
        write("tune.json", found)


if __name__ == "__main__":
    main()
