"""Play the shipped scenes with policies, many seeds each, and print how they came out; times are means of runs that arrived.

python benchmarks/scenes.py [--policy paper] [--seeds 50]
"""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

import numpy as np

from antway import check_episode, load_scenario, run
from antway.scenes import SCENES, scene
from report import write


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--policy", nargs="*", default=["paper", "antway"])
    parser.add_argument("--scene", nargs="*", default=SCENES)
    parser.add_argument("--seeds", type=int, default=50)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--json", type=Path, help="file to write the rows to")
    args = parser.parse_args()
    rows = []
    print("policy     scene      reached   time s  length m  replans  waits  clearance m  cycle ms p50    p99    max  others")
    for policy in args.policy:
        for name in args.scene:
            scenario = load_scenario(scene(name))
            results = [run(scenario, policy, seed=seed) for seed in range(args.first, args.first + args.seeds)]
            for result in results:
                check_episode(result)
            cycles = np.concatenate([result.cycle_ms for result in results[1:] or results])  # the first may compile kernels
            outcomes = Counter(result.outcome.value for result in results)
            row = {
                "policy": policy,
                "scene": name,
                "reached": outcomes["reached"],
                "seeds": args.seeds,
                "time": float(np.mean([r.time for r in results if r.reached])) if outcomes["reached"] else float("nan"),
                "length": float(np.mean([r.length for r in results])),
                "replans": float(np.mean([r.replans for r in results])),
                "waits": float(np.mean([r.waits for r in results])),
                "clearance": min(r.min_clearance for r in results),
                "p50": float(np.percentile(cycles, 50)),
                "p99": float(np.percentile(cycles, 99)),
                "max": float(cycles.max()),
                "others": {f"seed {r.seed}": r.outcome.value for r in results if not r.reached},
            }
            rows.append(row)
            print(
                f"{policy:10} {name:10} {row['reached']:3} / {args.seeds:<3} {row['time']:6.1f} {row['length']:9.1f} "
                f"{row['replans']:8.1f} {row['waits']:6.1f} {row['clearance']:12.3f} {row['p50']:13.2f} {row['p99']:6.1f} "
                f"{row['max']:6.1f}  {row['others'] or ''}",
                flush=True,
            )
    if args.json:
        write(args.json, rows)


if __name__ == "__main__":
    main()
