"""Bounds of tours: no answer beats them, and they are as good as other solvers say."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import minimum_spanning_tree

import naive.ordering as naive
from antway.kernels.colony import held_karp
from antway.tours.bounds import lower_bound, quick_bound, travel_bound, worth_bound
from antway.tours.stops import Stops
from common import cases


def task(rng: np.random.Generator, n: int, **more: object) -> Stops:
    """Stops with times from very small to very large or infinite, service and windows, which the best order may miss."""
    matrix = rng.choice([0.0, 0.1, 1.0, 2.5, 7.0, 1e6], (n, n)) if rng.random() < 0.5 else rng.random((n, n)) * 5.0
    matrix = np.minimum(matrix, matrix.T) if rng.random() < 0.4 else matrix
    matrix = np.where(rng.random((n, n)) < 0.3, math.inf, matrix) if rng.random() < 0.4 else matrix
    begin = rng.integers(0, 9, n) * (rng.random(n) < 0.5)
    windows = np.c_[begin, begin + rng.choice([4.0, 20.0, math.inf], n)] if rng.random() < 0.5 else None
    asked = {
        "matrix": matrix,
        "start": int(rng.integers(n)),
        "end": [None, "start", int(rng.integers(n))][rng.integers(3)],
        "windows": windows,
        "service": rng.choice([0.0, 1.0, 3.0], n) if rng.random() < 0.5 else None,
        "priorities": None,
        "deadline": float(rng.integers(5, 30)) if rng.random() < 0.3 else math.inf,
        "robots": int(rng.integers(1, 4)),
        "objective": ["travel time", "makespan"][rng.integers(2)],
    }
    return Stops(**{**asked, **more})  # type: ignore[arg-type]


def shortest(matrix: np.ndarray) -> np.ndarray:
    """Lengths of shortest paths; SciPy takes arcs of length 0 for none."""
    far = matrix.copy()
    for k in range(len(far)):
        far = np.minimum(far, far[:, k, None] + far[k])
    return far


def test_no_answer_beats_a_bound() -> None:
    rng, binding = np.random.default_rng(1), 0
    for case in range(cases(250, 5_000)):
        n = int(rng.integers(1, 6))
        priorities = rng.integers(0, 5, n) if case % 3 == 0 else None
        stops = task(rng, n, priorities=priorities)
        given = stops.matrix.tolist(), stops.start, stops.end, stops.windows.tolist(), stops.service.tolist(), stops.priorities
        best = naive.best(*given, stops.deadline, stops.robots, stops.objective == "makespan")
        if best is None or not math.isfinite(best[1]):
            continue
        if priorities is None:
            slack = 1e-12 * best[1]
            assert 0.0 <= quick_bound(stops) <= best[1] + slack and 0.0 <= lower_bound(stops) <= best[1] + slack, case
            binding += lower_bound(stops) > 0.9 * best[1] > 0.0
        else:
            assert quick_bound(stops) >= worth_bound(stops) >= best[0], case
    assert binding > case / 5


@pytest.mark.parametrize("end", [None, "start", "last"])
@pytest.mark.parametrize("infinite", [False, True])
def test_robots_travel_no_less_than_the_least_assignment(end: str | None, infinite: bool) -> None:
    """Of the stops to those that come next, over shortest paths where arcs are missing or robots may return in between."""
    rng = np.random.default_rng(2)
    for _ in range(cases(40, 400)):
        n, robots = int(rng.integers(2, 10)), 1 + int(rng.integers(2)) * (end == "start")
        matrix = rng.random((n, n)) * 10
        if infinite:
            matrix[rng.integers(n, size=n), rng.integers(n, size=n)] = math.inf
        last = n - 1 if end == "last" else end
        more = {"windows": None, "robots": robots, "deadline": math.inf, "objective": "makespan"}
        stops = task(rng, n, matrix=matrix, start=0, end=last, **more)
        away = shortest(stops.matrix)
        if not np.isfinite(away).all():
            continue
        away = away if robots > 1 or not np.isfinite(stops.matrix).all() else stops.matrix.copy()
        np.fill_diagonal(away, math.inf)
        if end is None:
            away[:, 0] = 0.0  # the last stop has no next one
        elif end == "last":
            away[:, 0], away[n - 1], away[n - 1, 0] = math.inf, math.inf, 0.0
        least = float(away[linear_sum_assignment(away)].sum())
        assert travel_bound(stops) == pytest.approx(least)
        assert robots > 1 or lower_bound(stops) >= (least + stops.service.sum()) * (1.0 - 1e-8)


def test_equal_ways_there_and_back_have_a_better_bound() -> None:
    rng = np.random.default_rng(6)
    for _ in range(cases(10, 100)):
        xy = rng.random((9, 2)) * 10
        matrix = np.hypot(*(xy[:, None] - xy[None]).T)
        order = held_karp.best_of_few(matrix, 0)
        stops = task(rng, 9, matrix=matrix, start=0, end="start", robots=1)
        assert travel_bound(stops) > 0.95 * matrix[order, np.roll(order, -1)].sum()


def test_a_robot_takes_as_long_as_its_way_to_any_stop_and_to_the_end() -> None:
    """So many robots have nothing else to do."""
    rng = np.random.default_rng(5)
    for _ in range(cases(60, 600)):
        n = int(rng.integers(2, 6))
        stops = task(rng, n, matrix=rng.random((n, n)) * 5.0, robots=1000, deadline=math.inf, objective="makespan")
        windows = np.c_[stops.windows[:, 0], np.full(n, math.inf)]
        windows[stops.ends[1:], 0] = 0.0
        given = shortest(stops.matrix).tolist(), windows.tolist(), stops.service.tolist(), math.inf
        tail = [] if stops.end is None else [stops.end]
        alone = [naive.timing(*given, [stops.start, stop, *tail], stops.closed)[0] for stop in stops.inner.tolist()]
        idle = windows[stops.start, 0] + stops.service[stops.ends].sum()
        assert lower_bound(stops) == pytest.approx(max([idle, *alone]), rel=1e-2, abs=0.02)


def test_the_quick_bound_is_of_the_shortest_arcs_into_stops() -> None:
    rng = np.random.default_rng(7)
    for _ in range(cases(40, 400)):
        n, robots = int(rng.integers(2, 6)), int(rng.integers(1, 4))
        stops = task(rng, n, matrix=rng.random((n, n)) * 5.0, robots=robots)
        entered = [min(np.delete(stops.matrix[:, j], j)) for j in range(n) if j != stops.start or stops.closed]
        share = robots if stops.objective == "makespan" else 1
        assert quick_bound(stops) == pytest.approx(sum(entered) / share)


def test_robots_on_open_routes_travel_no_less_than_the_least_tree() -> None:
    rng = np.random.default_rng(3)
    for _ in range(cases(20, 200)):
        matrix = rng.random((9, 9)) + 0.1
        stops = task(rng, 9, matrix=matrix, end=None, windows=None, service=None, robots=2, objective="travel time")
        away = shortest(stops.matrix)
        assert travel_bound(stops) == pytest.approx(minimum_spanning_tree(np.minimum(away, away.T)).sum())


def test_the_bound_of_priorities_is_of_stops_that_can_be_visited_alone() -> None:
    rng = np.random.default_rng(4)
    for case in range(cases(200, 2_000)):
        n = int(rng.integers(2, 7))
        stops = task(rng, n, priorities=rng.integers(0, 9, n), deadline=float(rng.integers(4, 16)))
        windows = stops.windows.copy()
        windows[stops.ends, 1] = math.inf  # whether the ends are in time does not count
        windows[stops.ends[1:], 0] = 0.0
        far, possible = shortest(stops.matrix), set(stops.ends)
        for stop in stops.inner.tolist():
            route = [stops.start, stop, *([] if stops.end is None else [stops.end])]
            given = far.tolist(), windows.tolist(), stops.service.tolist(), stops.deadline, route, stops.closed
            done, _, late = naive.timing(*given)
            possible |= {stop} if late <= 1e-9 and done < math.inf else set()
        assert worth_bound(stops) == stops.priorities[list(possible)].sum(), case
