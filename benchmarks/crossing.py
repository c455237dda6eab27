"""The colony in space and time beside exact search, and the processor time of a control cycle.

Run as `python benchmarks/crossing.py [--seeds N]`. Prints two tables and writes them to benchmarks/out/crossing.json. With
`--robot NAME`, such as diff, it prints the second one alone, for that robot.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from antway import Grid, RobotSpec, Scenario, Status, World, run
from antway.arena.crossing import orca_tracks
from antway.arena.suites import Chance
from antway.arena.synthetic import make as suite
from antway.kernels.base.records import Predictions
from antway.kernels.spacetime import ants as spacetime
from antway.planning import TimedPath
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.state import make_memory, make_trails
from antway.search.sipp import Sipp
from antway.world.motions import Bounce, Replay
from antway.world.policy import Command, Decision, Observation, Task
from antway.world.robots import load_robot
from antway.world.sensor import Sensor
from antway.world.world import Obstacle
from crossing import local_problem
from report import show, write

MIXED, SLACK = np.array([100.0, 30.0, 10.0, 100.0]), np.array([9.0, 0.0, 0.05, 0.2])
GREEDY = np.full(4, 100.0)
HORIZON = 20.0  # s
IMPROVEMENT = 0.001  # s; least improvement of a path that counts
EXPANSIONS = 10**6  # limit of moves tested in a search
COLONIES = {"mixed ants, no pheromone": (MIXED, 0.0), "mixed ants, pheromone": (MIXED, 20.0), "greedy ants": (GREEDY, 0.0)}


def local(seeds: int) -> list[dict[str, object]]:
    """Local problems, each by SIPP and by every colony: share solved, gap of the way from now to the goal, time.

    No wait is bound to end within `HORIZON`; problems whose optimum arrives within it count.
    """
    rng = np.random.default_rng(0)
    memory = make_memory(31 * 31, 1 << 16, 1 << 18)
    gaps: dict[str, list[float]] = {name: [] for name in COLONIES}
    ms: dict[str, list[float]] = {name: [] for name in (*COLONIES, "SIPP")}
    unsound = 0
    for seed in range(seeds):
        grid, robot, start, goal, context, segments = local_problem(rng)
        x, y = grid.centre(start)
        sipp = Sipp(grid, grid.centre(goal), radius=robot.radius, v_max=robot.v_max)
        exact, best = None, math.inf
        for _ in range(3):
            started = time.process_time()
            exact = sipp.search((x, y), 0.0, segments)
            best = min(best, time.process_time() - started)
        solvable = exact.status is Status.FOUND and exact.arrival < HORIZON - 1.0
        if solvable:
            ms["SIPP"].append(1e3 * best)
        predictions = Predictions(segments, 0.0)
        for name, (betas, amount) in COLONIES.items():
            settings, best = spacetime.AntSettings(0, betas, SLACK, IMPROVEMENT, amount, 0.0, 0.0), math.inf
            for _ in range(3):
                trails, state = make_trails(31 * 31), np.array([seed], np.uint64)
                started = time.process_time()
                end, arrival, bound = spacetime.search(
                    memory, trails, context, predictions, settings, x, y, 0.0, HORIZON, math.inf, EXPANSIONS, state
                )
                best = min(best, time.process_time() - started)
            if solvable:
                gaps[name].append(arrival / exact.arrival - 1.0 if end >= 0 else math.inf)
                ms[name].append(1e3 * best)
                unsound += bound > exact.arrival + 1e-6 or arrival < exact.arrival - 1e-6
            elif exact.status is Status.NO_PATH:
                unsound += arrival < HORIZON - 1.0
    assert not unsound, f"{unsound} answers contradict exact search"
    rows = []
    for name, times in ms.items():
        gap = np.array(gaps.get(name, [0.0] * len(times)))
        solved = np.isfinite(gap)
        rows.append(
            {
                "search": name,
                "solvable": len(gap),
                "solved %": 100 * solved.mean(),
                "mean gap %": 100 * gap[solved].mean(),
                "p95 gap %": 100 * np.percentile(gap[solved], 95),
                "median ms": float(np.median(times)),
                "p99 ms": float(np.percentile(times, 99)),
                "times SIPP": float(np.median(np.array(times) / np.array(ms["SIPP"]))),
            }
        )
    return rows


def hall(seed: int, discs: int) -> Scenario:
    """An open hall of 16 x 16 m with bouncing discs that never yield."""
    rng = np.random.default_rng(seed)
    obstacles: list[Obstacle] = []
    while len(obstacles) < discs:
        xy, radius = rng.uniform(1.0, 15.0, 2), float(rng.uniform(0.2, 0.45))
        if math.dist(xy, (1.5, 1.5)) > 2.0:
            motion = Bounce(tuple(xy.tolist()), float(rng.uniform(0.3, 0.9)), float(rng.uniform(-math.pi, math.pi)))
            obstacles.append(Obstacle(radius, motion))
    bounds = {"obstacle_speed": 0.9, "obstacle_surge": 0.5}
    world = World(Grid(np.zeros((80, 80), dtype=bool), 0.2), tuple(obstacles))
    return Scenario(world, (1.5, 1.5), (14.5, 14.5), RobotSpec(sensor_range=30.0), Sensor(occlusion=False), **bounds)


def throng(seed: int, people: int) -> Scenario:
    """People who cross a circle of 8 m radius as in suite `crossing`: they avoid one another, and do not see the robot."""
    rng, far = np.random.default_rng(seed), 8.0
    walks: list[tuple[tuple[float, float], tuple[float, float]]] = []
    while len(walks) < people:
        angle, (dx, dy) = rng.uniform(0.0, 2 * math.pi), rng.uniform(-0.5, 0.5, 2).tolist()
        x, y = far * math.cos(angle) + dx, far * math.sin(angle) + dy
        taken = [end for walk in [((0.0, -far), (0.0, far)), *walks] for end in walk]
        if all(math.dist((x, y), other) > 0.8 for other in taken):
            walks.append(((x, y), (-x, -y)))
    tracks = orca_tracks(walks, 160)
    t = tuple(0.25 * k + 1e-6 for k in range(161))
    world = World(
        Grid(np.zeros((101, 101), dtype=bool), 0.2, (-10.1, -10.1, 0.0)),
        tuple(Obstacle(0.3, Replay(t, tuple(path))) for path in tracks),
    )
    robot, sensor = RobotSpec(dt=0.25, sensor_range=math.inf), Sensor(occlusion=False)
    return Scenario(world, (0.0, -far), (0.0, far), robot, sensor, horizon=40.0, goal_tolerance=0.3, obstacle_speed=1.0)


class Timed:
    """A policy, and the processor time of each of its cycles."""

    def __init__(self) -> None:
        self.policy, self.ms = AntwayPolicy(), []

    def reset(self, task: Task, seed: int) -> None:
        self.policy.reset(task, seed)
        self.ms = []

    def act(self, observation: Observation) -> Command:
        started = time.process_time()
        command = self.policy.act(observation)
        self.ms.append(1e3 * (time.process_time() - started))
        return command

    def explain(self) -> Decision:
        return self.policy.explain()

    def planned(self) -> TimedPath | None:
        return self.policy.planned()


def driven_by(scenario: Scenario, robot: str) -> Scenario:
    """Return the scenario with a robot that is known by name, or with its own if there is no name; the sensor sees as far."""
    if not robot:
        return scenario
    own = scenario.robot
    return replace(scenario, robot=replace(load_robot(robot), dt=own.dt, sensor_range=own.sensor_range))


def cycles(episodes: int, robot: str = "") -> list[dict[str, object]]:
    """Processor time of a control cycle, and how much faster than time itself an unrecorded episode is; best of three plays."""
    policy = Timed()
    places: dict[str, list[Callable[[int], Scenario]]] = {}
    for discs in (0, 5, 10, 20, 30):
        places[f"hall, {discs} in range"] = [partial(hall, discs=discs)]
    for people in (5, 20):
        places[f"throng, {people} who avoid one another"] = [partial(throng, people=people)]
    for level in ("low", "medium", "high"):
        groups = [f"{family}/{level}" for family in ("open", "clutter", "aisles")]
        places[f"synthetic, {level}"] = [lambda seed, group=group: suite(group, Chance(seed)) for group in groups]
    rows = []
    for name, makers in places.items():
        ms, simulated, taken, reached = [], 0.0, 0.0, 0
        run(driven_by(makers[0](0), robot), policy, record=False)
        for seed in range(episodes):
            scenario, plays, best = driven_by(makers[seed % len(makers)](seed), robot), [], math.inf
            for _ in range(3):
                started = time.process_time()
                result = run(scenario, policy, seed=seed, record=False)
                best = min(best, time.process_time() - started)
                plays.append(policy.ms)
            ms.append(np.min(plays, axis=0))
            simulated, taken, reached = simulated + result.time, taken + best, reached + result.reached
        every = np.concatenate(ms)
        rows.append(
            {
                "place": name,
                "episodes": episodes,
                "reached": reached,
                "median ms": float(np.median(every)),
                "p99 ms": float(np.percentile(every, 99)),
                "times real time": simulated / taken,
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=1000)
    parser.add_argument("--episodes", type=int, default=30)
    parser.add_argument("--robot", default="", help="which robot drives, as in `antway bench`; else a disc without inertia")
    options = parser.parse_args()
    if options.robot:
        show(cycles(options.episodes, options.robot), f"policy antway with {options.robot}, a control cycle", floats=".4g")
        return
    local(3)  # compile
    tables = {"local": local(options.seeds), "cycle": cycles(options.episodes)}
    title = "31 x 31 cells, 12 % blocked, 3-14 discs, against exact search over the same moves"
    show(tables["local"], title, floats=".4g")
    show(tables["cycle"], "policy antway, a control cycle and a whole episode, one core", floats=".4g")
    write("crossing.json", tables)


if __name__ == "__main__":
    main()
