"""Robots that answer their commands otherwise than declared: python benchmarks/response.py --robot diff.

Plays the episodes FIRST to FIRST + EPISODES - 1 of the three kinds of a level of suite `synthetic` with each policy. The policy
is told the robot as it is declared, but another one drives, or its place and speeds are measured wrongly:

declared          nothing is different
latency 0.1, 0.2  commands act so many seconds later
weak              acceleration and braking are 0.7 of what is declared (1 m/s^2 if that is infinite)
slow turns        the turn rate changes by at most half of what is declared
lag 0.1, 0.3      speeds approach the command exponentially, with this time constant in s
lag, latency      both, 0.2 and 0.1 s
slow              top speed and turn rate are 0.7 of what is declared
noise             places are wrong by 1 cm, speeds by 2 cm/s and 0.02 rad/s
jumps 0.05, 0.1   the robot's place on the map is wrong by so many m along each axis, its heading by 0.02 or 0.04 rad; both jump
                  once a second on average, and the obstacles, which are seen from the robot, with them
no speeds         speeds are reported as 0
robot's frame     the velocity is reported in the robot's frame, in place of the map's
late speeds       speeds are reported 0.3 s late

The table has how many episodes reach the goal, contacts with obstacles and with walls, and the mean time over the optimum.
"""

from __future__ import annotations

import argparse
import math
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np

from antway import Command, Decision, Observation, Policy, RobotSpec, Task, make_policy, run
from antway.arena.suites import SuiteEpisode, build, facts
from antway.ros2.frames import chain, inverse, move_tracks, turn

KINDS = ("open", "clutter", "aisles")


@dataclass(frozen=True)
class Change:
    """How the robot differs from what the policy is told."""

    latency: float = 0.0  # s, more
    accelerations: float = 1.0  # factor
    turns: float = 1.0  # factor of alpha_max
    lag: float = 0.0  # s, time constant
    noise: float = 0.0  # m, standard deviation
    tops: float = 1.0  # factor of the top speed and the turn rate
    jumps: float = 0.0  # m, standard deviation
    speeds: str = ""  # how they are reported: as "zero", in the "robot's frame", or "late"

    def of(self, robot: RobotSpec) -> RobotSpec:
        """Return the robot that drives."""
        real = {name: getattr(robot, name) * self.tops for name in ("v_max", "v_reverse", "turn_rate")}
        if self.accelerations != 1.0:
            rates = {"a_max": robot.a_max, "brake_max": robot.braking}
            real |= {name: min(rate * self.accelerations, 1.0) for name, rate in rates.items()}
        return replace(robot, latency=robot.latency + self.latency, alpha_max=robot.alpha_max * self.turns, **real)


CHANGES = {
    "declared": Change(),
    "latency 0.1": Change(latency=0.1),
    "latency 0.2": Change(latency=0.2),
    "weak": Change(accelerations=0.7),
    "slow turns": Change(turns=0.5),
    "lag 0.1": Change(lag=0.1),
    "lag 0.3": Change(lag=0.3),
    "lag, latency": Change(latency=0.1, lag=0.2),
    "slow": Change(tops=0.7),
    "noise": Change(noise=0.01),
    "jumps 0.05": Change(jumps=0.05),
    "jumps 0.1": Change(jumps=0.1),
    "no speeds": Change(speeds="zero"),
    "robot's frame": Change(speeds="robot's frame"),
    "late speeds": Change(speeds="late"),
}
JUMPS_EVERY = 1.0  # s, on average
LATE = 3  # control periods; late speeds are as old as this
TURNED = 0.4  # rad/m; standard deviation of the heading over that of the place


class Misled:
    """A policy that is told `declared`, and whose robot changes otherwise."""

    def __init__(self, policy: Policy, declared: RobotSpec, change: Change) -> None:
        self.policy, self.declared, self.change = policy, declared, change

    def reset(self, task: Task, seed: int) -> None:
        """Begin an episode."""
        self.rng, self.lagging, self.off = np.random.default_rng(seed), np.zeros(2), (0.0, 0.0, 0.0)
        self.speeds: list[tuple[tuple[float, float], float]] = []  # those of all observations
        self.policy.reset(replace(task, robot=self.declared), seed)

    def act(self, observation: Observation) -> Command:
        """Return the policy's command as the robot answers it."""
        o, noise = observation, self.change.noise
        if noise > 0.0:
            x, y, vx, vy = self.rng.normal(0.0, (noise, noise, 2.0 * noise, 2.0 * noise))
            turn_noise = self.rng.normal(0.0, 2.0 * noise)
            place, velocity = (o.xy[0] + x, o.xy[1] + y), (o.velocity[0] + vx, o.velocity[1] + vy)
            o = replace(o, xy=place, velocity=velocity, turn_rate=o.turn_rate + turn_noise)
        if self.change.jumps > 0.0:
            o = self._misplaced(o)
        if self.change.speeds:
            o = self._with_other_speeds(o)
        if self.change.latency > 0.0 and self.declared.latency == 0.0:
            o = replace(o, pending=None)
        command = self.policy.act(o)
        if self.change.lag == 0.0:
            return command
        asked = np.array(command.acts(o, self.declared))
        self.lagging += (1.0 - math.exp(-self.declared.dt / self.change.lag)) * (asked - self.lagging)
        one, two = self.lagging.tolist()
        return Command(twist=(one, two)) if self.declared.wheels else Command((one, two))

    def _misplaced(self, o: Observation) -> Observation:
        """Return the observation of a robot that is taken to be elsewhere on the map."""
        if self.rng.random() < self.declared.dt / JUMPS_EVERY:
            sigma = self.change.jumps
            self.off = tuple(self.rng.normal(0.0, (sigma, sigma, TURNED * sigma)).tolist())
        x, y, angle = self.off
        place = o.xy[0] + x, o.xy[1] + y
        moved = chain((*place, angle), inverse((*o.xy, 0.0)))
        velocity, tracks = turn(angle, o.velocity), move_tracks(moved, o.tracks)
        return replace(o, xy=place, velocity=velocity, heading=o.heading + angle, tracks=tracks)

    def _with_other_speeds(self, o: Observation) -> Observation:
        """Return the observation of a robot whose speeds are reported wrongly."""
        self.speeds.append((o.velocity, o.turn_rate))
        if self.change.speeds == "zero":
            return replace(o, velocity=(0.0, 0.0), turn_rate=0.0)
        if self.change.speeds == "late":
            velocity, turn_rate = self.speeds[max(len(self.speeds) - 1 - LATE, 0)]
            return replace(o, velocity=velocity, turn_rate=turn_rate)
        return replace(o, velocity=turn(-o.heading, o.velocity))

    def explain(self) -> Decision:
        """Return the policy's decision."""
        return self.policy.explain()


def play(episode: SuiteEpisode, name: str, change: Change) -> tuple[str, float]:
    """Return the outcome, and the time over the optimum."""
    scenario = build(episode)
    misled = Misled(make_policy(name), scenario.robot, change)
    result = run(replace(scenario, robot=change.of(scenario.robot)), misled, seed=episode.seed, record=False)
    return result.outcome.value, result.time / facts(scenario, episode.seed).bound


def main() -> None:
    """Play, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robot", default="diff", help="which robot is declared, as in `antway bench`")
    parser.add_argument("--level", default="medium")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=20, help="of each kind of the level")
    parser.add_argument("--policies", default="antway,antway/learns_response=False", help="separated by commas")
    parser.add_argument("--changes", default=",".join(name.replace(", ", "+") for name in CHANGES), help="separated by commas")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes that play; the rows stay the same")
    options = parser.parse_args()
    robot = "" if options.robot == "holonomic" else options.robot
    print("| change | policy | reached | obstacles | walls | time / optimum |\n|---|---|--:|--:|--:|--:|")
    with ProcessPoolExecutor(options.workers) as pool:
        for change in (name.replace("+", ", ") for name in options.changes.split(",")):
            for name in options.policies.split(","):
                numbers = range(options.first, options.first + options.episodes)
                wanted = [
                    SuiteEpisode("synthetic", "synthetic", f"{kind}/{options.level}", k, robot)
                    for kind in KINDS
                    for k in numbers
                ]
                played = list(pool.map(play, wanted, repeat(name), repeat(CHANGES[change])))
                outcomes = [outcome for outcome, _ in played]
                contacts = sum(outcome in ("hit-moving", "hit-standing") for outcome in outcomes)
                times = [time for outcome, time in played if outcome == "reached"]
                row = f"{outcomes.count('reached')} of {len(played)} | {contacts} | {outcomes.count('hit-wall')}"
                print(f"| {change} | {name} | {row} | {np.mean(times) if times else math.nan:.3f} |", flush=True)


if __name__ == "__main__":
    main()
