"""Drive as the ROS 2 node does: python benchmarks/ros_pilot.py --robot diff --corridors 0.3,1,2 --sensor laser.

The pilot of the node drives through episodes of suite `synthetic`. With `--corridors` it gets the shortest path over the map,
as Nav2 would give it to FollowPath, and stays within the corridor; with "none" it gets the goal alone. It is told all tracks,
or with `--sensor laser` the scans of a laser of 360 beams, which are wrong by 1 cm and see what is in sight up to 4.5 m.

Prints how many goals are reached, the mean time over the optimum without a corridor, and how far the robot came from the path
at most. docs/ros2.md quotes it.
"""

from __future__ import annotations

import argparse
import math
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from antway import Command, Decision, Grid, Observation, Outcome, Problem, Task, run, solve
from antway.arena.suites import SuiteEpisode, load_suite, stage
from antway.ros2.frames import HERE, Odometry
from antway.ros2.goals import OK, STAND, Goal, PilotAnswer
from antway.ros2.path import tracking
from antway.ros2.pilot import Pilot
from antway.ros2.scan import Background, Laser, ScanTracker, discs, without_ids
from antway.ros2.settings import Settings, parameters
from antway.world.policy import Tracks

BEAMS, RANGE, NOISE = 360, 4.5, 0.01  # number of beams; m; m, standard deviation of a range


class RosPilot:
    """The pilot of the ROS 2 node as a policy."""

    def __init__(self, robot: str, corridor: float | None, laser: bool) -> None:
        values: dict[str, Any] = {name: one.default for name, one in parameters().items() if not name.startswith("robot.")}
        values |= {"robot.name": robot, "task.stay": 0.0} | ({} if corridor is None else {"corridor": corridor})
        self.pilot, self.follows = Pilot(Settings.of(values)), corridor is not None
        self.laser, self.tracker = Laser(0.5) if laser else None, ScanTracker()
        self.answer, self.aside = PilotAnswer(STAND, OK, ""), 0.0

    def reset(self, task: Task, seed: int) -> None:
        """Give the pilot the map, and the path or the goal."""
        self.grid, self.rng = task.grid, np.random.default_rng(seed)
        self.background = Background(task.grid, self.pilot.settings.scan_clear)
        inflated = task.grid.inflate(task.robot.radius)
        cells = solve(Problem(inflated, inflated.cell_at(task.start), inflated.cell_at(task.goal))).cells
        self.path = np.vstack((task.start, inflated.to_xy(cells)[1:-1], task.goal))
        self.pilot.receive_map(task.grid)
        self.pilot.go(Goal(task.goal, self.path if self.follows else None))

    def act(self, seen: Observation) -> Command:
        """Give the pilot what is observed, and return its command."""
        self.pilot.scan = seen.t, seen.tracks if self.laser is None else self.scanned(self.laser, seen)
        self.aside = max(self.aside, abs(tracking(self.path, seen.xy, seen.heading).aside))
        odometry = Odometry(seen.t, seen.xy, seen.velocity, seen.heading, seen.turn_rate)
        self.answer = self.pilot.receive_odometry(odometry, seen.t) or self.answer
        stands = Command((0.0, 0.0), (0.0, 0.0) if self.pilot.settings.robot.wheels else None)
        return self.answer.command if self.answer.drives else stands

    def scanned(self, laser: Laser, seen: Observation) -> Tracks:
        """Return the tracks that the node finds in a scan."""
        settings = self.pilot.settings
        ranges = measured(self.grid, seen) + self.rng.normal(0.0, NOISE, BEAMS)
        step = 2.0 * math.pi / BEAMS
        message = SimpleNamespace(angle_min=0.0, angle_increment=step, range_min=0.05, range_max=RANGE, ranges=ranges)
        laser.moved(seen.t, (*seen.xy, seen.heading))
        points = self.background.off(laser.placed((seen.t, message), HERE, False, settings.scan_valid), seen.xy)
        places = discs(points, gap=settings.scan_gap, largest=settings.scan_radius)
        return self.tracker.update(seen.t, without_ids(places.xy, places.radius), seen.xy, places)

    def explain(self) -> Decision:
        """Return a decision without a reason."""
        return Decision("follow", "")


def measured(grid: Grid, seen: Observation) -> np.ndarray:
    """Return the range of each beam, float64[BEAMS] in m: to a wall (to 2 cm) or a disc; infinite where there is neither."""
    angle = seen.heading + 2.0 * math.pi * np.arange(BEAMS) / BEAMS
    ahead, along = np.column_stack((np.cos(angle), np.sin(angle))), np.arange(0.05, RANGE, 0.02)
    places = np.array(seen.xy) + ahead[:, None, :] * along[None, :, None]
    rows, cols = np.floor(grid.to_points(places.reshape(-1, 2)) + 0.5).astype(int).T
    inside = (rows >= 0) & (rows < grid.shape[0]) & (cols >= 0) & (cols < grid.shape[1])
    wall = ~inside
    wall[inside] = grid.blocked[rows[inside], cols[inside]]
    hit = wall.reshape(BEAMS, -1)
    ranges = np.where(hit.any(axis=1), along[hit.argmax(axis=1)], math.inf)
    for to, radius in zip(seen.tracks.xy - seen.xy, seen.tracks.radius):
        near = ahead @ to
        inner = near**2 - to @ to + radius**2
        ranges = np.where((inner > 0.0) & (near > 0.0), np.minimum(ranges, near - np.sqrt(np.maximum(inner, 0.0))), ranges)
    return ranges


def drive(robot: str, corridor: float | None, laser: bool, group: str, number: int) -> tuple[bool, float, float]:
    """Return whether the robot arrived, its time over the optimum, and how far it came from the path, m."""
    scenario, facts = stage(SuiteEpisode("synthetic", f"{load_suite('synthetic').name} on {robot}", group, number, robot))
    policy = RosPilot(robot, corridor, laser)
    result = run(scenario, policy, seed=number, record=False)
    if result.outcome is Outcome.ERROR:
        raise SystemExit(result.reason)
    return result.reached, result.time / facts.bound, policy.aside


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="diff")
    parser.add_argument("--corridors", default="none", help="m, separated by commas; none: a goal without a path")
    parser.add_argument("--sensor", default="tracks", choices=("tracks", "laser"))
    parser.add_argument("--groups", default="open/high,clutter/high,aisles/high")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=20, help="of each group")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.episodes)
    print("| corridor (m) | reached | time | farthest from the path (m) |\n|---|---|---|---|")
    with ProcessPoolExecutor() as workers:
        for name in options.corridors.split(","):
            corridor, laser = None if name == "none" else float(name), options.sensor == "laser"
            jobs = list(product([options.robot], [corridor], [laser], options.groups.split(","), numbers))
            reached, times, aside = zip(*workers.map(drive, *zip(*jobs)))
            mean = np.mean([time for time, arrived in zip(times, reached) if arrived])
            print(f"| {name} | {sum(reached)} of {len(jobs)} | {mean:.3f} | {max(aside):.2f} |", flush=True)


if __name__ == "__main__":
    main()
