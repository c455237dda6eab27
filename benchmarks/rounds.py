"""Generated rounds among moving obstacles: python benchmarks/rounds.py --rounds 100 --policy antway.

Maps of the scenes office and rounds; 5 to 12 stops on free places, a third of them with a window around the time at which a
tour by travel times would be there; 4 to 8 discs that bounce about. Printed: how many rounds were done, contacts, stops
visited, windows kept, and how long decisions on the order took.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import Counter

import numpy as np

from antway import RobotSpec, Scenario, World, check_episode, distance_field, load_map, plan_tour, run
from antway.scenes import scene
from antway.world.motions import Bounce
from antway.world.stops import Stop
from antway.world.world import Obstacle

RADIUS = 0.25


def generated(seed: int) -> Scenario:
    """The scenario of a seed."""
    rng = np.random.default_rng(seed)
    grid = load_map(scene(("office", "rounds")[seed % 2]).with_suffix(".yaml"))
    inflated = grid.inflate(RADIUS + 0.1)
    free = np.argwhere(~inflated.blocked)
    reach = np.argwhere(np.isfinite(distance_field(inflated, tuple(free[rng.integers(len(free))]))))
    n = int(rng.integers(5, 13))
    places: list[tuple[float, float]] = []
    while len(places) < n + 1:
        x, y = grid.to_xy(reach[rng.integers(len(reach))][None])[0].tolist()
        if all(math.dist((x, y), other) > 1.0 for other in places):
            places.append((x, y))
    tour = plan_tour(grid, places[0], places[1:], end="start", service=3.0, robot_radius=RADIUS, speed=0.85, cycles=5)
    windows = {int(stop): float(at) for stop, at in zip(tour.order, tour.arrival) if rng.random() < 1 / 3}
    stops = tuple(Stop(place, f"stop {k}", _window(windows.get(k), rng), 3.0) for k, place in enumerate(places[1:]))
    obstacles: list[Obstacle] = []
    wanted = int(rng.integers(4, 9))
    while len(obstacles) < wanted:
        x, y = grid.to_xy(reach[rng.integers(len(reach))][None])[0].tolist()
        if math.dist((x, y), places[0]) > 2.0:
            obstacles.append(
                Obstacle(0.25, Bounce((x, y), float(rng.uniform(0.2, 0.8)), float(rng.uniform(-math.pi, math.pi))))
            )
    robot = RobotSpec(radius=RADIUS, v_max=1.0, sensor_range=5.0)
    world = World(grid, tuple(obstacles))
    horizon = 3.0 * tour.duration + 60.0
    return Scenario(world, places[0], places[0], robot, horizon=horizon, seed=seed, obstacle_speed=1.0, stops=stops)


def _window(at: float | None, rng: np.random.Generator) -> tuple[float, float]:
    return (0.0, math.inf) if at is None else (max(0.0, at - rng.uniform(0, 20)), at + rng.uniform(15, 40))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=100)
    parser.add_argument("--first", type=int, default=1000)
    parser.add_argument("--policy", default="antway")
    told = parser.parse_args()
    outcomes: Counter[str] = Counter()
    stops = visited = windows = kept = 0
    times: list[float] = []
    for seed in range(told.first, told.first + told.rounds):
        began = time.perf_counter()
        scenario = generated(seed)
        result = run(scenario, told.policy)
        check_episode(result)
        rounds = result.rounds
        assert rounds is not None
        late = [rounds.name(visit.stop) for visit in rounds.visits if rounds.lateness(visit) > 0]
        limited = {k for k, stop in enumerate(rounds.stops) if math.isfinite(stop.window[1])}
        stops, visited = stops + len(rounds.stops), visited + len(rounds.visits)
        windows += len(limited)
        kept += sum(visit.stop in limited and rounds.lateness(visit) == 0 for visit in rounds.visits)
        outcomes[result.outcome.value] += 1
        times += result.order_ms.tolist()
        print(f"{seed} {result.outcome.value} {result.time:.0f} s, {len(rounds.visits)} of {len(rounds.stops)} stops,"
              f" late {late}, {len(rounds.turns)} orders, {time.perf_counter() - began:.1f} s", flush=True)  # fmt: skip
    ms = np.array(times)
    print(f"\n{told.rounds} rounds from seed {told.first}, policy {told.policy}: {dict(outcomes)}")
    print(f"{visited} of {stops} stops visited, {kept} of {windows} windows kept")
    print(
        f"decisions on the order: {len(ms)}, {np.median(ms):.1f} ms, p99 {np.percentile(ms, 99):.1f} ms, most {ms.max():.1f} ms"
    )


if __name__ == "__main__":
    main()
