"""Time of a space-time query: SIPP with 20 moving discs on a 100 x 100 map, beside a plain SIPP in Python.

Run as `python benchmarks/timed.py [--json FILE]`. Every answer is compared with the peer's arrival.
"""

from __future__ import annotations

import argparse
import heapq
import math
import sys
import time
from functools import cache
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from antway import Grid, Moves, Status
from antway.kernels.spacetime.segments import timeline_segments, unsafe_departures, unsafe_stay
from antway.search.sipp import Sipp
from antway.world.timeline import Timeline
from naive.sipp import gaps as safe_intervals
from report import write

RADIUS, SPEED, SIZE, DISCS = 0.3, 1.0, 100, 20


def world(rng: np.random.Generator, resolution: float, density: float) -> tuple[Grid, Timeline]:
    """A map of blocks of 3 x 3 cells, and discs that cross it in straight lines at 0.3 to 0.9 m/s."""
    blocked = np.zeros((SIZE, SIZE), dtype=bool)
    while blocked.mean() < density:
        r, c = rng.integers(0, SIZE - 3, 2)
        blocked[r : r + 3, c : c + 3] = True
    side = SIZE * resolution
    trajectories = []
    for _ in range(DISCS):
        a, angle, pace = rng.uniform(0, side, 2), rng.uniform(0, 2 * np.pi), rng.uniform(0.3, 0.9)
        trajectories.append(([0.0, 100.0], [a, a + 100 * pace * np.array([np.cos(angle), np.sin(angle)])]))
    return Grid(blocked, resolution), Timeline.of(list(range(DISCS)), list(rng.uniform(0.2, 0.45, DISCS)), trajectories)


def python_sipp(search: Sipp, centre: np.ndarray, start: tuple[int, int], goal: tuple[int, int], timeline: Timeline) -> float:
    """The peer: SIPP as one writes it in Python, cell by cell as needed, with the same field and the same compiled tests."""
    segments = timeline_segments(timeline.trajectories, RADIUS, 0.0, np.inf)
    moves = list(enumerate(search.moves.offsets.tolist()))

    @cache
    def safe(cell: tuple[int, int]) -> list[tuple[float, float]]:
        return safe_intervals(*zip(*(unsafe_stay(*centre[cell], segments, p) for p in range(len(segments)))), 0.0)

    @cache
    def leave(cell: tuple[int, int]) -> list[tuple[tuple[int, int], float, list[tuple[float, float]]]]:
        x, y = centre[cell]
        found = []
        for k, (dr, dc) in moves:
            if int(search.mask[cell]) >> k & 1:
                to = (cell[0] + dr, cell[1] + dc)
                dx, dy = centre[to] - centre[cell]
                duration = math.hypot(dx, dy) / SPEED
                spans = [
                    unsafe_departures(x, y, dx / duration, dy / duration, duration, segments, p) for p in range(len(segments))
                ]
                found.append((to, duration, safe_intervals(*zip(*spans), 0.0)))
        return found

    best = {(start, 0): 0.0}
    heap = [(search.field[start], 0.0, start, 0)] if safe(start) and safe(start)[0][0] == 0.0 else []
    while heap:
        _, t, cell, i = heapq.heappop(heap)
        if cell == goal:
            return -t
        if -t > best[cell, i]:
            continue
        for other, duration, gaps in leave(cell):
            for j, (enter, end) in enumerate(safe(other)):
                for a, b in gaps:
                    s = max(-t, a, enter - duration)
                    if s <= min(b, safe(cell)[i][1], end - duration) and s + duration < best.get((other, j), np.inf):
                        best[other, j] = s + duration
                        heapq.heappush(heap, (s + duration + search.field[other], -s - duration, other, j))
    return np.inf


def measure(moves: Moves, resolution: float, density: float, queries: int, peers: int) -> dict[str, object]:
    rng = np.random.default_rng(0)
    times, prepare, cold, ratios, expanded, found = [], [], [], [], [], 0
    while len(times) < queries:
        grid, timeline = world(rng, resolution, density)
        clear = grid.clearance() > RADIUS
        start, goal = (tuple(int(i) for i in rng.choice(np.argwhere(clear))) for _ in range(2))
        started = time.perf_counter()
        search = Sipp(grid, grid.centre(goal), radius=RADIUS, v_max=SPEED, moves=moves)
        prepare.append(time.perf_counter() - started)
        if not search.field[start] * SPEED > SIZE * resolution / 2:
            continue  # only ways of half the map and more
        xy = grid.centre(start)
        runs = []
        for _ in range(5):
            started = time.perf_counter()
            segments = timeline_segments(timeline.trajectories, RADIUS, 0.0, np.inf)
            plan = search.search(xy, 0.0, segments)
            runs.append(time.perf_counter() - started)
        times.append(min(runs[1:]))
        cold.append(runs[0])
        expanded.append(plan.expanded)
        found += plan.status is Status.FOUND
        if len(ratios) < peers:
            centre = grid.to_xy(list(np.ndindex(grid.shape))).reshape(SIZE, SIZE, 2)
            started = time.perf_counter()
            arrival = python_sipp(search, centre, start, goal, timeline)
            ratios.append((time.perf_counter() - started) / times[-1])
            assert arrival == plan.arrival or abs(arrival - plan.arrival) < 1e-6, (arrival, plan.arrival)
    ms = 1e3 * np.array(times)
    return {
        "moves": moves.value,
        "resolution": resolution,
        "blocked": density,
        "queries": queries,
        "found": found,
        "median_ms": float(np.median(ms)),
        "p90_ms": float(np.percentile(ms, 90)),
        "p99_ms": float(np.percentile(ms, 99)),
        "first_run_median_ms": float(1e3 * np.median(cold)),
        "prepare_ms": float(1e3 * np.median(prepare)),
        "expanded": float(np.median(expanded)),
        "python_sipp_ratio": float(np.median(ratios)) if ratios else float("nan"),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--queries", type=int, default=200)
    parser.add_argument("--peers", type=int, default=5)
    options = parser.parse_args()
    rows = []
    for moves in (Moves.EIGHT, Moves.SIXTEEN, Moves.THIRTY_TWO):
        for resolution, density in ((0.2, 0.0), (0.2, 0.1), (0.5, 0.2)):
            rows.append(measure(moves, resolution, density, options.queries, options.peers))
            if len(rows) == 1:
                print("".join(f"{name:>20}" for name in rows[0]))
            print("".join(f"{value:>20.3f}" if isinstance(value, float) else f"{value:>20}" for value in rows[-1].values()))
    if options.json:
        write(options.json, rows)


if __name__ == "__main__":
    main()
