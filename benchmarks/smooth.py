"""How often, how fast and how well plans are smoothed: on the shipped maps, on ROS maps, and on random ones.

Run as `python benchmarks/smooth.py [--pairs N] [--seed K] [--robots A,B] [--maps FOLDER]`. On each map N pairs of start and
goal are drawn at random; where the robot's disc has no path the pair is drawn anew. `car` is a car of 0.7 x 0.4 m (Ackermann,
turning radius 0.8 m). Prints for each robot and kind of map: plans, motions found (each has passed `check_motion`), curves and
straight legs among them, their time over the length of the plan at full speed and over the motion that stops at corners, and
seconds of processor time. Writes the table to benchmarks/out/smooth.json.
"""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np

from antway import CellBlocked, Grid, RobotSpec, Status, load_map, load_scenario, plan
from antway.tables import SHIPPED_SCENES
from antway.trajectory.smooth import smooth
from antway.world.robots import load_robot
from report import DATA, markdown, write

CAR = RobotSpec(
    v_max=1.5, a_max=1.0, drive="ackermann", turn_rate=1.9, alpha_max=3.0, turning_radius=0.8,
    footprint=((-0.35, -0.2), (0.35, -0.2), (0.35, 0.2), (-0.35, 0.2)),
)  # fmt: skip
TRIES = 200  # pairs drawn for each that is asked for


def random_map(rng: np.random.Generator) -> Grid:
    """20 x 15 m: rooms with doors of 1.5 m, or boxes strewn about."""
    blocked = np.zeros((150, 200), bool)
    if rng.random() < 0.5:
        for col in (50, 100, 150):
            blocked[:, col - 1 : col + 1] = True
            for door in rng.integers(5, 130, 2):
                blocked[door : door + 15, col - 1 : col + 1] = False
        blocked[74:76] = True
        for door in rng.integers(5, 180, 5):
            blocked[74:76, door : door + 15] = False
    for row, col in rng.integers(0, (145, 195), (25, 2)):
        blocked[row : row + rng.integers(2, 12), col : col + rng.integers(2, 12)] = True
    return Grid(blocked, 0.1)


def maps(folder: Path, count: int, seed: int) -> dict[str, list[tuple[str, Grid]]]:
    """The maps of each kind, by name."""
    rng = np.random.default_rng([seed, 0])
    kinds = {"shipped": [(name, load_scenario(name).world.grid) for name in SHIPPED_SCENES]}
    files = sorted(file for file in folder.glob("*/*.yaml") if "invalid" not in file.name and "_" not in file.stem[5:])
    kinds["ROS"] = [(file.stem, load_map(file)) for file in files]
    kinds["random"] = [(f"random {k}", random_map(rng)) for k in range(count)]
    return kinds


def pairs(grid: Grid, robot: RobotSpec, count: int, rng: np.random.Generator) -> list[tuple[tuple[float, float], ...]]:
    """Pairs of points between which the robot's disc has a path, a metre or more apart."""
    free, found = np.argwhere(~grid.inflate(robot.radius).blocked), []
    for _ in range(TRIES * count if len(free) else 0):
        if len(found) == count:
            break
        start, goal = (grid.centre((int(r), int(c))) for r, c in free[rng.integers(len(free), size=2)])
        if math.dist(start, goal) >= 1.0 and plan(grid, start, goal, robot_radius=robot.radius).status is Status.FOUND:
            found.append((start, goal))
    return found


def measure(robot: RobotSpec, places: list[tuple[str, Grid]], count: int, seed: int, verbose: bool) -> dict[str, float]:
    """Smooth the plans of all pairs on these maps."""
    rows, rng = [], np.random.default_rng([seed, 1])
    for name, grid in places:
        for start, goal in pairs(grid, robot, count, rng):
            try:
                path = plan(grid, start, goal, robot_radius=robot.radius)
            except CellBlocked:
                continue
            began = time.process_time()
            found = smooth(path, robot, grid=grid)
            spent = time.process_time() - began
            took = found.motion.time if found.motion else math.nan
            straight = found.motion is not None and len(found.motion.t) <= 4
            rows.append((found.motion is not None, found.bent, took, found.bound, found.stop_time, spent, straight))
            if verbose and not found.bent and not straight:
                print(f"{name} {start} {goal}: {found!r} {found.stop_time:.2f} {found.reason}", flush=True)
    table = np.array(rows, float).reshape(-1, 7)
    done = table[table[:, 0] > 0]
    stops = done[np.isfinite(done[:, 4])]
    return {
        "plans": len(table),
        "motions": len(done),
        "curves": int(done[:, 1].sum()),
        "straight": int(done[:, 6].sum()),
        "time over length / v_max": float(done[:, 2].sum() / done[:, 3].sum()) if len(done) else math.nan,
        "time over stops": float(stops[:, 2].sum() / stops[:, 4].sum()) if len(stops) else math.nan,
        "median s": float(np.median(table[:, 5])) if len(table) else math.nan,
        "worst s": float(table[:, 5].max()) if len(table) else math.nan,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=20, help="of each map; of random maps one, on so many maps")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--robots", default="holonomic,inertia,diff,turtlebot3_waffle,turtlebot4,jackal,amr,car")
    parser.add_argument("--maps", type=Path, default=DATA / "ros_maps")
    parser.add_argument("--verbose", action="store_true", help="tell of every plan that is not bent")
    arguments = parser.parse_args()
    kinds, rows = maps(arguments.maps, arguments.pairs, arguments.seed), []
    for name in arguments.robots.split(","):
        robot = CAR if name == "car" else load_robot(name)
        for kind, places in kinds.items():
            count = 1 if kind == "random" else arguments.pairs
            rows.append({"robot": name, "maps": kind, **measure(robot, places, count, arguments.seed, arguments.verbose)})
            print(markdown(rows[-1], ".3f"), flush=True)
    write("smooth.json", rows)


if __name__ == "__main__":
    main()
