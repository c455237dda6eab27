"""Policies among recorded people, and worlds changed: python benchmarks/people.py tracks:../shared/data/tracks/eth.csv.

Plays the episodes FIRST to FIRST + EPISODES - 1 of every group of a suite (any that `antway bench` knows) with each policy, and
prints success, contacts of a robot that moved and that stood, the mean time over the clairvoyant optimum, the time beside that
of the last policy where both arrive, and the failures by cause. The figures of docs/people.md come from it. `--change` makes
worlds that no suite has:

noise           places are wrong by 0.05 m, and no covariance tells it
noisy-zeros     places are wrong by 0.03 m, all velocities are reported as 0, and no covariance tells it
no-velocity     the sensor gives no velocities
noisy-places    both: no velocities, and places that are wrong by 0.05 m, which no covariance tells
zero-velocity   all velocities are reported as 0
noisy-velocity  velocities are wrong by 0.5 m/s, and no covariance tells it
late-velocity   velocities are averages over half a second
noisy-tracks    places are wrong by 0.03 m and velocities by 0.25 m/s, and no covariance tells it
nameless        nobody has a number
swaps           in one of twenty scans, two obstacles swap their numbers for good
radius          each scan has other radii, wrong by up to 20 %
untold          nothing is declared but a speed of 1.5 m/s, whatever the obstacles do
circles         discs go round on circles, and only a speed of 1.5 m/s is declared (suite synthetic, groups open/...)
fast            discs go from key frame to key frame at 0.5 to 2.5 m/s, the robot drives 2 m/s, and nobody tells (suite barn)
"""

from __future__ import annotations

import argparse
import math
import os
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from itertools import repeat

import numpy as np

from antway import Command, Decision, Observation, Policy, Scenario, Task, Tracks, check_episode, make_policy, run
from antway.arena.causes import by_cause, with_cause
from antway.arena.store import Row
from antway.arena.suites import SuiteEpisode, build, episodes, facts
from antway.version import __version__
from antway.world.motions import Bounce, Replay, Waypoints

Told = Callable[[Tracks], Tracks]
SLOWEST = 10  # number of episodes that are named because they lose most time


class Untold:
    """A policy that is told less of the tracks, or wrongly: what `change` makes of them, given random numbers."""

    def __init__(self, policy: Policy, change: Callable[[np.random.Generator], Told]) -> None:
        self.policy, self.change = policy, change

    def reset(self, task: Task, seed: int) -> None:
        """Begin an episode."""
        self.told = self.change(np.random.default_rng(seed))
        self.policy.reset(task, seed)

    def act(self, observation: Observation) -> Command:
        """Return the policy's command."""
        return self.policy.act(replace(observation, tracks=self.told(observation.tracks)))

    def explain(self) -> Decision:
        """Return the policy's decision."""
        return self.policy.explain()


def fast(scenario: Scenario) -> Scenario:
    """Let the discs of suite barn, which go at 0.3 to 0.8 m/s, go at 0.5 to 2.5 m/s, and the robot at 2 m/s."""
    faster = []
    for one in scenario.world.obstacles:
        assert isinstance(one.motion, Waypoints) and isinstance(one.motion.speed, float), "for suite barn"
        faster.append(replace(one, motion=replace(one.motion, speed=0.5 + 4.0 * (one.motion.speed - 0.3))))
    world = replace(scenario.world, obstacles=tuple(faster))
    return replace(scenario, world=world, robot=replace(scenario.robot, v_max=2.0), obstacle_speed=1.5)


def circles(scenario: Scenario) -> Scenario:
    """Let the discs of suite synthetic go round on circles of 0.7 to 3 m, on the side of the map's middle."""
    world, t, discs = scenario.world, np.arange(0.0, scenario.horizon + 0.05, 0.1), []
    rows, cols = world.grid.shape
    middle = np.array(world.grid.centre((rows // 2, cols // 2)))
    for i, one in enumerate(world.obstacles):
        assert isinstance(one.motion, Bounce) and isinstance(one.motion.heading, float), "for suite synthetic"
        radius, start = 0.7 + 2.3 * (one.motion.heading / math.tau % 1.0), np.array(one.motion.start)
        out = start - middle if math.dist(start, middle) > 0.0 else np.array([1.0, 0.0])
        arm = radius * out / np.hypot(*out)
        angle = (-1) ** i * one.motion.speed / radius * t
        turned = np.outer(np.cos(angle), arm) + np.outer(np.sin(angle), (-arm[1], arm[0]))
        points = tuple(map(tuple, (start - arm + turned).tolist()))
        discs.append(replace(one, motion=Replay(tuple(t.tolist()), points)))
    return CHANGES["untold"](replace(scenario, world=replace(world, obstacles=tuple(discs))))


CHANGES: dict[str, Callable[[Scenario], Scenario]] = {
    "noise": lambda scenario: replace(scenario, sensor=replace(scenario.sensor, noise=0.05)),
    "noisy-places": lambda scenario: replace(scenario, sensor=replace(scenario.sensor, noise=0.05, velocity="none")),
    "noisy-tracks": lambda scenario: replace(scenario, sensor=replace(scenario.sensor, noise=0.03, velocity_noise=0.25)),
    "noisy-zeros": lambda scenario: replace(scenario, sensor=replace(scenario.sensor, noise=0.03)),
    "no-velocity": lambda scenario: replace(scenario, sensor=replace(scenario.sensor, velocity="none")),
    "untold": lambda scenario: replace(scenario, obstacle_speed=1.5, obstacle_surge=math.inf, obstacle_swerve=math.inf),
    "circles": circles,
    "fast": fast,
}


def swaps(rng: np.random.Generator, share: float = 0.05) -> Told:
    """Swap the numbers of two obstacles for good, in this share of the scans."""
    names: dict[int, int] = {}

    def told(tracks: Tracks) -> Tracks:
        if len(tracks) > 1 and rng.random() < share:
            one, other = rng.choice(tracks.id, 2, replace=False).tolist()
            names[one], names[other] = names.get(other, other), names.get(one, one)
        return replace(tracks, id=np.array([names.get(name, name) for name in tracks.id.tolist()], np.int64))

    return told


def late(rng: np.random.Generator) -> Told:
    """Report averages of velocities, in which what is 0.5 s old counts e times less than what is new, from 0 on."""
    before: dict[int, list[float]] = {}

    def told(tracks: Tracks) -> Tracks:
        velocity = tracks.velocity.copy()
        for i, name in enumerate(tracks.id.tolist()):
            velocity[i] += math.exp(-0.1 / 0.5) * (np.array(before.get(name, (0.0, 0.0))) - velocity[i])
            before[name] = velocity[i].tolist()
        return replace(tracks, velocity=velocity)

    return told


# What the policy is told of the tracks.
TOLD: dict[str, Callable[[np.random.Generator], Told]] = {
    "noise": lambda rng: lambda tracks: replace(tracks, covariance=None),
    "noisy-places": lambda rng: lambda tracks: replace(tracks, covariance=None),
    "noisy-tracks": lambda rng: lambda tracks: replace(tracks, covariance=None),
    "noisy-zeros": lambda rng: lambda tracks: replace(tracks, velocity=np.zeros((len(tracks), 2)), covariance=None),
    "nameless": lambda rng: lambda tracks: replace(tracks, id=np.full(len(tracks), -1)),
    "swaps": swaps,
    "zero-velocity": lambda rng: lambda tracks: replace(tracks, velocity=np.zeros((len(tracks), 2))),
    "noisy-velocity": lambda rng: (
        lambda tracks: replace(tracks, velocity=tracks.velocity + rng.normal(0.0, 0.5, (len(tracks), 2)))
    ),
    "late-velocity": late,
    "radius": lambda rng: lambda tracks: replace(tracks, radius=tracks.radius * rng.uniform(0.8, 1.2, len(tracks))),
}


def play(episode: SuiteEpisode, names: list[str], change: str, check: bool) -> list[Row]:
    """Return a row for each policy."""
    scenario = build(episode)
    if change in CHANGES:
        scenario = CHANGES[change](scenario)
    bound, rows = facts(scenario, episode.seed).bound, []
    for name in names:
        policy = make_policy(name)
        if change in TOLD:
            policy = Untold(policy, TOLD[change])
        result = run(scenario, policy, seed=episode.seed)
        assert result.trace is not None
        if check:
            check_episode(result)
        key = episode.suite, episode.name, name, episode.seed, __version__, episode.group
        rows.append(
            Row(*key, result.outcome.value, with_cause(result.trace), result.time, bound=bound, cycle_p50=result.cycle(50))
        )
    return rows


def line(group: str, name: str, rows: list[Row], base: dict[str, Row]) -> str:
    """Return a line of the table: a policy in a group, beside the rows of another policy by episode."""
    done = [row for row in rows if row.reached and math.isfinite(row.bound)]
    ratio = sum(row.time / row.bound for row in done) / len(done) if done else math.nan
    both = [(row.time, base[row.episode].time) for row in rows if row.reached and base[row.episode].reached]
    beside = sum(a for a, _ in both) / sum(b for _, b in both) if both else math.nan
    moving, standing = (sum(row.outcome == f"hit-{how}" for row in rows) for how in ("moving", "standing"))
    share = 100.0 * sum(row.reached for row in rows) / len(rows)
    mean = sum(row.time for row in rows if row.reached) / max(sum(row.reached for row in rows), 1)
    return f"| {group} | {name} | {len(rows)} | {share:.1f} | {moving} + {standing} | {ratio:.4f} | {mean:.2f} | {beside:.4f} |"


def main() -> None:
    """Play, and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("suite")
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--episodes", type=int, default=250)
    parser.add_argument("--groups", default="", help="separated by commas; all if left out")
    parser.add_argument("--policies", default="antway,sipp/predictions=mirrored", help="separated by commas")
    parser.add_argument("--change", choices=["none", *CHANGES | TOLD], default="none")
    parser.add_argument("--robot", default="", help="which robot drives, as in `antway bench`; else the suite's own")
    parser.add_argument("--check", action="store_true", help="check every episode by check_episode")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes that play; the rows stay the same")
    options = parser.parse_args()
    named, names = episodes(options.suite, 1, options.robot), options.policies.split(",")
    print(
        "| group | policy | episodes | success, % | contacts moving + standing | time / optimum | time, s | beside the last |"
    )
    print("|---|---|--:|--:|--:|--:|--:|--:|")
    failures: list[Row] = []
    losses: list[tuple[float, Row]] = []
    with ProcessPoolExecutor(options.workers) as pool:
        for group in options.groups.split(",") if options.groups else [one.group for one in named]:
            numbers = range(options.first, options.first + options.episodes)
            wanted = [SuiteEpisode(options.suite, named[0].suite, group, number, options.robot) for number in numbers]
            played = list(pool.map(play, wanted, repeat(names), repeat(options.change), repeat(options.check)))
            rows = {name: [episode[i] for episode in played] for i, name in enumerate(names)}
            base = {row.episode: row for row in rows[names[-1]]}
            for name in names:
                print(line(group, name, rows[name], base), flush=True)
                failures += [row for row in rows[name] if not row.reached]
                losses += [(row.time / row.bound, row) for row in rows[name] if row.reached and math.isfinite(row.bound)]
    for name in names:
        for why, count in by_cause(row for row in failures if row.policy == name).items():
            print(f"{name}: {count} x {why}")
    print("episodes failed:", ", ".join(f"{row.policy} {row.episode}" for row in failures) or "none")
    losses.sort(key=lambda one: -one[0])
    print("slowest:", ", ".join(f"{row.policy} {row.episode} ({ratio:.2f})" for ratio, row in losses[:SLOWEST]) or "none")


if __name__ == "__main__":
    main()
