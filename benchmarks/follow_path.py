"""Drive along paths as the ROS 2 node does for Nav2: python benchmarks/follow_path.py --robot diff --corridors 0.3,1,2.

The pilot of the node gets the shortest path over the map of an episode of suite `synthetic`, as Nav2 would give
it to FollowPath, and drives to its end within the corridor. Prints how many of the goals are reached, the mean time over the
optimum without a corridor, and how far the robot came from the path at most. docs/ros2.md quotes it.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from itertools import product

import numpy as np

from antway import Command, Decision, Observation, Outcome, Problem, Task, run, solve
from antway.arena.suites import Episode, load_suite, stage
from antway.ros2.frames import Odometry
from antway.ros2.goals import OK, STAND, Answer, Goal
from antway.ros2.path import tracking
from antway.ros2.pilot import Pilot
from antway.ros2.settings import Settings, parameters


class FollowsPath:
    """The pilot of the ROS 2 node as a policy, with the shortest path to follow."""

    def __init__(self, robot: str, corridor: float) -> None:
        values = {name: one.default for name, one in parameters().items() if not name.startswith("robot.")}
        settings = Settings.of(values | {"robot.name": robot, "corridor": corridor, "task.stay": 0.0})
        self.pilot, self.answer, self.aside = Pilot(settings), Answer(STAND, OK, ""), 0.0

    def reset(self, task: Task, seed: int) -> None:
        """Give the pilot the map and the path."""
        inflated = task.grid.inflate(task.robot.radius)
        cells = solve(Problem(inflated, inflated.cell_at(task.start), inflated.cell_at(task.goal))).cells
        self.path = np.vstack((task.start, inflated.to_xy(cells)[1:-1], task.goal))
        self.pilot.receive_map(task.grid)
        self.pilot.go(Goal(task.goal, self.path))

    def act(self, seen: Observation) -> Command:
        """Give the pilot what is observed, and return its command."""
        self.pilot.scan = seen.t, seen.tracks
        self.aside = max(self.aside, abs(tracking(self.path, seen.xy, seen.heading).aside))
        odometry = Odometry(seen.t, seen.xy, seen.velocity, seen.heading, seen.turn_rate)
        self.answer = self.pilot.receive_odometry(odometry, seen.t) or self.answer
        stands = Command((0.0, 0.0), (0.0, 0.0) if self.pilot.settings.robot.wheels else None)
        return self.answer.command if self.answer.drives else stands

    def explain(self) -> Decision:
        """Return a decision without a reason."""
        return Decision("follow", "")


def drive(robot: str, corridor: float, group: str, number: int) -> tuple[bool, float, float]:
    """Return whether the robot arrived, its time over the optimum, and how far it came from the path, m."""
    scenario, facts = stage(Episode("synthetic", f"{load_suite('synthetic').name} on {robot}", group, number, robot))
    policy = FollowsPath(robot, corridor)
    result = run(scenario, policy, seed=number, record=False)
    if result.outcome is Outcome.ERROR:
        raise SystemExit(result.reason)
    return result.reached, result.time / facts.bound, policy.aside


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="diff")
    parser.add_argument("--corridors", default="0.3,1,2", help="m, separated by commas")
    parser.add_argument("--groups", default="open/high,clutter/high,aisles/high")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=20, help="of each group")
    options = parser.parse_args()
    numbers = range(options.first, options.first + options.episodes)
    print("| corridor (m) | reached | time | farthest from the path (m) |\n|---|---|---|---|")
    with ProcessPoolExecutor() as workers:
        for corridor in map(float, options.corridors.split(",")):
            jobs = list(product([options.robot], [corridor], options.groups.split(","), numbers))
            reached, times, aside = zip(*workers.map(drive, *zip(*jobs)))
            mean = np.mean([time for time, arrived in zip(times, reached) if arrived])
            print(f"| {corridor:g} | {sum(reached)} of {len(jobs)} | {mean:.3f} | {max(aside):.2f} |", flush=True)


if __name__ == "__main__":
    main()
