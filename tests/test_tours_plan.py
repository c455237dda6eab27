"""Tours on maps: distances among stops, plan_tour against exhaustive search, check_tour, wrong input, files and doors."""

from __future__ import annotations

import csv
import itertools
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

import antway
from antway import BadInput, Grid, InvalidPlan, Moves, Plan, check_tour, distance_field, plan_tour
from antway.planning import Status
from antway.tours.distances import stop_distances
from antway.tours.plan import TourPlan
from antway.tours.stopfile import load_stops
from common import SHARED, cases, needs_data

ALL_MOVES = (Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT, Moves.SIXTEEN, Moves.THIRTY_TWO)


def connected(rng: np.random.Generator, n: int, *, side: int = 24) -> tuple[Grid, list[tuple[float, float]]]:
    """A random map and n free points of one part of it, in m, no two in a cell."""
    while True:
        grid = Grid(rng.random((side, side)) < rng.uniform(0.0, 0.3), resolution=0.5)
        free = np.argwhere(~grid.blocked)
        reach = np.argwhere(np.isfinite(distance_field(grid, tuple(free[rng.integers(len(free))]))))
        if len(reach) >= n:
            xy = grid.to_xy(reach[rng.choice(len(reach), n, replace=False)])
            return grid, [(float(x), float(y)) for x, y in xy]


def cell_list(grid: Grid, points: list[tuple[float, float]]) -> list[tuple[int, int]]:
    return [grid.cell_at(point) for point in points]


def matrix_of(grid: Grid, points: list[tuple[float, float]]) -> np.ndarray:
    """The distances by one field each, which is what `stop_distances` must equal."""
    cells = cell_list(grid, points)
    rows, cols = np.array(cells).T
    return np.array([distance_field(grid, cell)[rows, cols] for cell in cells])


@pytest.mark.parametrize("moves", ALL_MOVES)
@pytest.mark.parametrize("costly", [False, True])
def test_distances_are_those_of_dijkstra(moves: Moves, costly: bool) -> None:
    rng = np.random.default_rng(5)
    for _ in range(cases(4, 100)):
        grid = Grid(rng.random((17, 23)) < rng.uniform(0.0, 0.5), resolution=0.25)
        free = np.argwhere(~grid.blocked)
        cells = [tuple(map(int, cell)) for cell in free[rng.choice(len(free), min(9, len(free)), replace=False)]]
        costs = rng.uniform(0.5, 4.0, grid.shape) if costly else None
        found = stop_distances(grid, cells, moves, costs=costs)
        rows, cols = np.array(cells).T
        for i, cell in enumerate(cells):
            np.testing.assert_allclose(found[i], distance_field(grid, cell, moves, costs=costs)[rows, cols], rtol=1e-12)


@pytest.mark.parametrize("cores", [1, 3, 16])
def test_distances_among_many_stops_are_the_same_on_several_cores(monkeypatch, cores: int) -> None:
    """Threads take turns at the stops; each row must come back to its own stop."""
    monkeypatch.setattr("os.cpu_count", lambda: cores)
    rng = np.random.default_rng(6)
    grid = Grid(rng.random((30, 40)) < 0.25)
    free = np.argwhere(~grid.blocked)
    cells = [tuple(map(int, cell)) for cell in free[rng.choice(len(free), 70, replace=False)]]
    found, (rows, cols) = stop_distances(grid, cells), np.array(cells).T
    for i, cell in enumerate(cells):
        np.testing.assert_allclose(found[i], distance_field(grid, cell)[rows, cols], rtol=1e-12)


@needs_data
def test_distances_on_a_large_map() -> None:
    grid = antway.load_map(SHARED / "movingai" / "Berlin_0_1024.map")
    rng = np.random.default_rng(0)
    free = np.argwhere(~grid.blocked)
    cells = [tuple(map(int, cell)) for cell in free[rng.choice(len(free), 12, replace=False)]]
    found = stop_distances(grid, cells)
    rows, cols = np.array(cells).T
    for i in (0, 5, 11):
        np.testing.assert_allclose(found[i], distance_field(grid, cells[i])[rows, cols], rtol=1e-12)


@pytest.mark.parametrize("end", [None, "start", "point"])
def test_tours_are_as_short_as_the_best_of_all_orders(end: str | None) -> None:
    rng = np.random.default_rng(11)
    for case in range(cases(6, 200)):
        grid, points = connected(rng, 2 + int(rng.integers(1, 8)))
        start, last, stops = points[0], points[1], points[2:]
        where = (np.array(last) if case % 2 else last) if end == "point" else end
        tour = plan_tour(grid, start, stops, end=where, cycles=200, seed=case)
        check_tour(tour)
        away = matrix_of(grid, points)
        home = {"point": [1], "start": [0]}.get(str(end), [])
        best = min(
            sum(away[a, b] for a, b in itertools.pairwise([0, *order, *home]))
            for order in itertools.permutations(range(2, len(points)))
        )
        assert tour.cost == pytest.approx(best)
        assert tour.bound <= best * (1 + 1e-9)
        assert tour.length == pytest.approx(best)


def best_in_time(away: np.ndarray, windows: np.ndarray, service: np.ndarray) -> float:
    """The least travel time of an open tour from 0 that is never late, by dynamic programming over (visited, last, travel).

    Waiting makes time and travel differ, so every state keeps the pairs (time, travel) that no other betters in both.
    """
    n = len(away)
    states: dict[tuple[int, int], list[tuple[float, float]]] = {(1, 0): [(0.0, 0.0)]}
    for _ in range(n - 1):
        onward: dict[tuple[int, int], list[tuple[float, float]]] = {}
        for (seen, at), pairs in states.items():
            for to in range(1, n):
                if seen >> to & 1:
                    continue
                for now, travel in pairs:
                    begin = max(now + away[at, to], windows[to, 0])
                    if begin <= windows[to, 1]:
                        onward.setdefault((seen | 1 << to, to), []).append((begin + service[to], travel + away[at, to]))
        states = {}
        for key, pairs in onward.items():
            least, kept = math.inf, []
            for pair in sorted(pairs):
                if pair[1] < least:
                    least = pair[1]
                    kept.append(pair)
            states[key] = kept
    return min((travel for pairs in states.values() for _, travel in pairs), default=math.inf)


def test_tours_with_windows_are_as_short_as_the_dynamic_program_says() -> None:
    rng = np.random.default_rng(12)
    for case in range(cases(5, 150)):
        n = 13 if case == 0 else 4 + int(rng.integers(0, 7))
        grid, points = connected(rng, n)
        away = matrix_of(grid, points)
        order = [0, *(1 + rng.permutation(n - 1))]
        service = np.r_[0.0, rng.uniform(0.0, 3.0, n - 1)]
        windows, now = np.tile([0.0, math.inf], (n, 1)), 0.0
        for a, b in itertools.pairwise(order):
            now += away[a, b]
            if rng.random() < 0.6:
                windows[b] = max(0.0, now - rng.uniform(0, 8)), now + rng.uniform(0, 8)
            now = max(now, windows[b, 0]) + service[b]
        tour = plan_tour(grid, points[0], points[1:], windows=windows[1:], service=service[1:], cycles=300, seed=case)
        check_tour(tour)
        best = best_in_time(away, windows, service)
        assert tour.feasible
        assert tour.cost == pytest.approx(best)
        assert tour.bound <= best * (1 + 1e-9)


def some_tour() -> TourPlan:
    grid, points = connected(np.random.default_rng(3), 7)
    windows = [None, (0.0, 1e4), (300.0, 900.0), None, None]
    return plan_tour(
        grid, points[0], points[1:6], end=points[6], windows=windows, service=2.0, cycles=20, names=["a", "b", "c", "d", "e"]
    )


def spoil(tour: TourPlan, **changes: object) -> TourPlan:
    return replace(tour, routes=(replace(tour.routes[0], **changes), *tour.routes[1:]))


def exchanged(tour: TourPlan) -> TourPlan:
    order = tour.order.copy()
    order[:2] = order[1::-1]
    return spoil(tour, order=order)


def twice(tour: TourPlan) -> TourPlan:
    order = tour.order.copy()
    order[0] = order[1]
    return spoil(tour, order=order)


def through_a_wall(tour: TourPlan) -> TourPlan:
    leg = max(tour.legs, key=lambda plan: len(plan.cells))
    straight = leg.cells[[0, -1]].copy()
    plan = Plan(leg.status, straight, float(np.hypot(*np.diff(straight, axis=0)[0]) * tour.task.grid.resolution))
    return spoil(tour, legs=tuple(plan if one is leg else one for one in tour.legs))


def closed_early(tour: TourPlan) -> TourPlan:
    windows = tour.task.windows.copy()
    windows[tour.order[0], 1] = 5.0
    return replace(tour, task=replace(tour.task, windows=windows))


def off_the_map(leg: Plan) -> Plan:
    return replace(leg, cells=np.vstack((leg.cells[:1], leg.cells[1:-1] + 1000, leg.cells[-1:])))


def late(tour: TourPlan, **changes: object) -> TourPlan:
    return replace(tour, task=replace(tour.task, deadline=tour.duration / 2), **changes)


BROKEN: dict[str, Callable[[TourPlan], TourPlan]] = {
    r"is visited twice": twice,
    r"leg 0 to stop . \(.\): ends at": exchanged,
    r"stop . \(.\) is not visited": lambda t: spoil(t, order=t.order[:-1], arrival=t.arrival[:-1], waiting=t.waiting[:-1]),
    r"visits stop 5, and there are 5": lambda t: spoil(t, order=np.r_[t.order[:-1], 5].astype(np.int32)),
    r"waiting has the shape \(4,\) in place of \(5,\)": lambda t: spoil(t, waiting=t.waiting[:-1]),
    r"robot 0: arrival is no array of numbers": lambda t: spoil(t, arrival=t.arrival.astype(str)),
    r"leg 0 .* is blocked or off the map.*leg 2 to .* length None": lambda t: replace(
        spoil(t, legs=(off_the_map(t.legs[0]), t.legs[1], replace(t.legs[2], length=None), *t.legs[3:])),
        task=replace(t.task, costs=np.ones(t.task.grid.shape)),
    ),
    r"has 5 legs for 6 places": lambda t: spoil(t, legs=t.legs[:-1]),
    r"is no such move": through_a_wall,
    r"is no path": lambda t: spoil(t, legs=(Plan(Status.NO_PATH, t.legs[0].cells[:0], math.inf), *t.legs[1:])),
    r"leg 0 to stop . \(.\): begins at": lambda t: spoil(t, legs=(t.legs[1], t.legs[0], *t.legs[2:])),
    r"states for stop . \(.\) an arrival": lambda t: spoil(t, arrival=t.arrival - np.eye(len(t.arrival))[2]),
    r"states for stop . \(.\) a wait of 0.0 s": lambda t: spoil(t, waiting=np.zeros_like(t.waiting)),
    r"order that is no list of integers: \[.*\.5": lambda t: spoil(t, order=t.order + 0.5),
    r"an arrival at nan": lambda t: spoil(t, arrival=t.arrival * math.nan),
    r"states a duration of nan": lambda t: spoil(t, duration=math.nan),
    r"states a cost of nan": lambda t: replace(t, cost=math.nan),
    r"states a gap of nan": lambda t: replace(t, gap=math.nan),
    r"states a lateness of nan": lambda t: replace(t, lateness=math.nan),
    r"states a sum of priorities of nan": lambda t: replace(t, collected=math.nan),
    r"states a length": lambda t: replace(t, length=t.length * 0.999),
    r"states a duration": lambda t: replace(t, duration=t.duration - 1.0),
    r"states a cost": lambda t: replace(t, cost=t.cost - 1e-3),
    r"states a sum of priorities": lambda t: replace(t, collected=1.0),
    r"states a gap": lambda t: replace(t, gap=-5.0),
    r"states a gap of 0.0; it is inf": lambda t: replace(t, bound=0.0, gap=0.0),
    r"lateness of 0.0; it is 157": late,
    r"lateness of 0.0; it is 2.9": closed_early,
    r"cost None is not of type float": lambda t: replace(t, cost=None),
    r"gap 'a' is not of type float": lambda t: replace(t, gap="a"),
    r"robot 0: length None is not of type float": lambda t: spoil(t, length=None),
    r"robot 0 has legs that are no plans": lambda t: spoil(t, legs=(None, *t.legs[1:])),
    r"skipped None is no tuple of integers": lambda t: replace(t, skipped=None),
    r"skipped \(None, 1\) is no tuple of integers": lambda t: replace(t, skipped=(None, 1)),
    r"feasible 'yes' is not of type bool": lambda t: replace(t, feasible="yes"),
    r"is called feasible and is .* late": lambda t: late(t, lateness=t.duration / 2),
    r"is called infeasible and is never late": lambda t: replace(t, feasible=False),
    r"has a bound of 28.* cost contradict": lambda t: replace(t, bound=t.cost * 1.01),
    r"has a bound of -1.0": lambda t: replace(t, bound=-1.0, gap=math.inf),
    r"has a bound of nan": lambda t: replace(t, bound=math.nan),
    r"has 1 routes for 2 robots": lambda t: replace(t, task=replace(t.task, robots=2)),
    r"leg 0 .* not at the start": lambda t: replace(t, task=replace(t.task, start=tuple(t.task.stops[0]))),
    r"leg 5 to the end: ends at": lambda t: replace(t, task=replace(t.task, end="start")),
    r"an arrival at 7.9.* it is 3.9": lambda t: replace(t, task=replace(t.task, speed=2.0)),
    r"says that stops \[1\] are left out": lambda t: replace(t, skipped=(1,)),
}


def test_check_tour_names_what_is_wrong() -> None:
    tour = some_tour()
    check_tour(tour)
    assert (tour.waiting > 0).any()
    for what, wrong in BROKEN.items():
        with pytest.raises(InvalidPlan, match=what):
            check_tour(wrong(tour))


def test_a_late_tour_may_cost_less_than_the_bound() -> None:
    """No tour in time costs less; of one that is late and says so, cost and bound say nothing."""
    tour = some_tour()
    wrong = {"lateness": tour.duration / 2, "feasible": False, "bound": 2 * tour.cost, "gap": 0.0}
    check_tour(late(tour, **wrong))
    with pytest.raises(InvalidPlan, match=r"gap of -0\.5; it is 0\.0"):
        check_tour(late(tour, **{**wrong, "gap": -0.5}))


def test_a_tour_that_leaves_stops_out_is_feasible() -> None:
    """With priorities a stop may be left out; infeasible is only what is late."""
    tour = plan_tour(HALL, (3.5, 1.5), [(1.5, 1.5), (5.5, 1.5)], priorities=[1, 1], deadline=3.0, cycles=5)
    assert tour.skipped
    check_tour(tour)
    with pytest.raises(InvalidPlan, match="infeasible"):
        check_tour(replace(tour, feasible=False))


def test_several_robots_costs_and_moves_pass_the_check() -> None:
    rng = np.random.default_rng(8)
    grid, points = connected(rng, 9)
    costs = rng.uniform(1.0, 3.0, grid.shape)
    for kwargs in (
        {"robots": 3, "objective": "makespan", "end": "start"},
        {"robots": 2},
        {"speed": 0.5, "service": 2.0},
        {"costs": costs, "end": "start", "speed": 0.5},
        {"moves": Moves.SIXTEEN},
        {"robot_radius": 0.2, "end": points[8]},
    ):
        tour = plan_tour(grid, points[0], points[1:8], cycles=30, **kwargs)
        check_tour(tour)
        assert sorted(stop for route in tour.routes for stop in route.order.tolist()) == list(range(7))


def test_the_same_seed_gives_the_same_tour() -> None:
    grid, points = connected(np.random.default_rng(9), 12)
    one, two = (plan_tour(grid, points[0], points[1:], cycles=20, seed=5) for _ in range(2))
    assert one.order.tobytes() == two.order.tobytes()
    assert one.arrival.tobytes() == two.arrival.tobytes()


HALL = Grid(np.array([[False] * 6 + [True] + [False] * 5] * 4), resolution=1.0)
GOOD = [(1.5, 1.5), (3.5, 2.5)]
WRONG: dict[str, tuple[dict[str, object], str]] = {
    "in a wall": ({"stops": [*GOOD, (6.5, 1.5)]}, r"stops\[2\] = \(6.5, 1.5\): .*blocked"),
    "nearer to a wall than its radius": ({"stops": [*GOOD, (0.5, 0.5)], "robot_radius": 0.7}, r"stops\[2\]"),
    "off the map": ({"stops": [*GOOD, (99.0, 1.5)]}, r"stops\[2\] = \(99.0, 1.5\): .*on the map"),
    "twice": ({"stops": [*GOOD, (1.6, 1.6)]}, r"stops\[2\] = .*stops\[0\]"),
    "out of reach": ({"stops": [*GOOD, (8.5, 1.5), (9.5, 1.5)]}, r"stops\[2\].*path leads from the start.*stops\[3\]"),
    "not a number": ({"stops": [(1.5, math.nan)]}, r"stops\[0\]"),
    "three numbers": ({"stops": [(1.5, 1.5, 1.5)]}, r"stops\[0\]"),
    "none": ({"stops": []}, "stops"),
    "10,001 of them": ({"stops": [(0.5, 0.5)] * 10_001}, "stops = 10001: must be at most"),
    "one more than the limit": ({"stops": [(0.5, 0.5)] * 4_999}, "stops = 4999: must be at most 4998 stops"),
    "as many as the limit, in one cell": ({"stops": [(0.5, 0.5)] * 4_998}, r"stops\[1\] = .*stops\[0\]"),
    "a deadline below zero": ({"deadline": -1.0}, "deadline"),
    "a window that ends before it begins": ({"windows": [None, (5.0, 4.0)]}, r"windows\[1\] = \(5.0, 4.0\)"),
    "a window of NaN": ({"windows": [(math.nan, 4.0), None]}, r"windows\[0\]"),
    "a window too few": ({"windows": [None]}, "windows"),
    "service below zero": ({"service": [1.0, -1.0]}, r"service\[1\] = -1.0"),
    "priority of NaN": ({"priorities": [1.0, math.nan]}, r"priorities\[1\]"),
    "no robots": ({"robots": 0}, "robots = 0"),
    "a speed of zero": ({"speed": 0.0}, "speed"),
    "rows of service of different lengths": ({"service": [1.0, [2.0, 3.0]]}, r"service\[1\] = \[2.0, 3.0\]"),
    "rows of priorities of different lengths": ({"priorities": [[1.0], [2.0, 3.0]]}, r"priorities\[0\]"),
    "an unknown end": ({"end": "home"}, r"end = 'home': must be a point \(x, y\) in m, start or None"),
    "an end in the wall": ({"end": (6.5, 0.5)}, "end"),
    "an end out of reach": ({"end": (9.5, 0.5)}, "end"),
    "a start in the wall": ({"start": (6.5, 0.5)}, "start"),
    "an unknown objective": ({"objective": "beauty"}, "objective"),
    "costs of zero": ({"costs": np.zeros((4, 12))}, "costs"),
    "an earlier tour of other stops": ({"initial": "tour"}, "initial"),
}


@pytest.mark.parametrize("what", WRONG)
def test_wrong_input_is_one_error_that_names_the_stop(what: str) -> None:
    arguments, words = WRONG[what]
    arguments = {"start": (0.5, 0.5) if what != "nearer to a wall than its radius" else (2.5, 1.5), "stops": GOOD, **arguments}
    if arguments.get("initial") is not None:
        arguments["initial"] = some_tour()
    with pytest.raises(BadInput) as caught:
        plan_tour(HALL, cycles=1, **arguments)  # type: ignore[arg-type]
    assert re.search(words, str(caught.value)), str(caught.value)


def test_what_an_earlier_tour_lacks_is_told() -> None:
    """Also where only the number of robots is another one."""
    with pytest.raises(BadInput, match=r"initial = \(2, 1\): must be a tour of 2 stops and 2 robots"):
        plan_tour(HALL, (0.5, 0.5), GOOD, robots=2, cycles=1, initial=plan_tour(HALL, (0.5, 0.5), GOOD, cycles=1))


def test_stops_that_are_none_are_refused() -> None:
    for wrong in (None, 3, [], {(0, 0)}, [(0, 0), 3]):
        with pytest.raises(BadInput, match="stops"):
            stop_distances(HALL, wrong)  # type: ignore[arg-type]


def test_points_may_be_iterators() -> None:
    """What can be read only once is read once."""
    stops = (iter(stop) for stop in GOOD)
    tour = plan_tour(HALL, iter((0.5, 0.5)), stops, end=iter((2.5, 0.5)), service=iter((1, 2)), cycles=1)
    plain = plan_tour(HALL, (0.5, 0.5), GOOD, end=(2.5, 0.5), service=(1, 2), cycles=1)
    assert tour.order.tolist() == plain.order.tolist() and tour.arrival.tolist() == plain.arrival.tolist()


def test_times_that_are_too_long_name_what_makes_them_so() -> None:
    """The matrix of times is no argument of `plan_tour`: speed or costs are too little or too much for a way of 2 km."""
    field, there = Grid(np.zeros((1, 3), dtype=bool), resolution=1e3), [(1500.0, 500.0), (2500.0, 500.0)]
    with pytest.raises(BadInput, match=r"speed = 1e-06: must be such that no way to stops\[1\] \(lab\) takes more"):
        plan_tour(field, (500.0, 500.0), there, speed=1e-6, names=["ward", "lab"])
    with pytest.raises(BadInput, match=r"costs = 1000000.0: must be such that no way to the end takes"):
        plan_tour(field, (500.0, 500.0), there[:1], end=there[1], costs=np.full((1, 3), 1e6))


def test_a_robot_without_stops_drives_to_the_end_too() -> None:
    tour = plan_tour(HALL, (0.5, 0.5), GOOD, end=(4.5, 0.5), robots=2, priorities=[1, 1], deadline=1.0, cycles=5)
    assert [len(route.legs) for route in tour.routes] == [1, 1] and len(tour.skipped) == 2
    tour = plan_tour(HALL, (0.5, 0.5), GOOD, end=(4.5, 0.5), robots=2, cycles=5)
    k = next(k for k, route in enumerate(tour.routes) if not len(route.order))
    check_tour(tour)
    idle = replace(tour.routes[k], legs=(), length=0.0, duration=0.0)
    rest = sum(route.length for route in tour.routes) - tour.routes[k].length
    routes = tuple(idle if i == k else route for i, route in enumerate(tour.routes))
    with pytest.raises(InvalidPlan, match=f"robot {k} has 0 legs for 1 places to go to"):
        check_tour(replace(tour, routes=routes, length=rest, cost=rest, bound=0.0, gap=math.inf))


@pytest.mark.parametrize("costly", [False, True])
def test_legs_know_the_map_as_it_is(costly: bool) -> None:
    """A leg is smoothed where only the robot's centre has room: it knew the inflated map, or with costs none at all."""
    blocked = np.ones((5, 12), dtype=bool)
    blocked[1:-1, 1:-1] = False
    grid, costs = Grid(blocked, 1.0), np.ones(blocked.shape) if costly else None
    tour = plan_tour(grid, (3.5, 2.5), [(9.5, 2.5), (6.5, 2.5)], robot_radius=1.2, costs=costs, cycles=1)
    assert all(leg.grid is grid for leg in tour.legs)
    found = antway.smooth(tour.legs[0], antway.RobotSpec(radius=1.2), trials=1)
    assert found.motion is not None and found.motion.length == pytest.approx(3.0)


def test_sums_of_lengths_and_priorities_are_exact_however_long_a_tour_takes() -> None:
    """Rounding of the times of a day is no reason for a priority of a thousandth to be wrong."""
    tour = plan_tour(HALL, (0.5, 0.5), GOOD, priorities=[1e-3, 2e-3], service=1e5, cycles=5)
    check_tour(tour)
    for wrong, what in (
        (replace(tour, length=tour.length * (1 + 1e-6)), "states a length"),
        (replace(tour, collected=tour.collected * (1 + 1e-6)), "states a sum of priorities"),
        (replace(tour, bound=tour.collected * (1 - 1e-6)), "priorities contradict"),
    ):
        with pytest.raises(InvalidPlan, match=what):
            check_tour(wrong)


def test_errors_call_stops_by_their_names() -> None:
    with pytest.raises(BadInput, match=r"stops\[1\] \(lab\) = \(6.5, 1.5\)"):
        plan_tour(HALL, (0.5, 0.5), [(1.5, 1.5), (6.5, 1.5)], names=["ward", "lab"])


def test_a_file_of_stops_is_read(tmp_path) -> None:
    file = tmp_path / "stops.csv"
    file.write_text("# a comment\nname,x,y,earliest,latest,service,priority\nlab,1.5,2,10,20,3,5\n,3,4,,,,\n", encoding="utf-8")
    read = load_stops(file)
    assert read.stops == ((1.5, 2.0), (3.0, 4.0))
    assert read.names == ("lab", "stop 1")
    assert read.windows == ((10.0, 20.0), (0.0, math.inf))
    assert read.service == (3.0, 0.0)
    assert read.priorities == (5.0, 1.0)
    file.write_text("x,y,priority\n1,2,\n3,4,\n", encoding="utf-8")
    assert load_stops(file).priorities is None
    file.write_text("1,2\n3,4\n", encoding="utf-8")
    assert load_stops(file).stops == ((1.0, 2.0), (3.0, 4.0))
    file.write_text('#,"a\nx,y\n1,2\n # 5",6\n3,4\n', encoding="utf-8")  # quotes in comments used to hide a stop
    assert load_stops(file).stops == ((1.0, 2.0), (3.0, 4.0))
    file.write_text('name,x,y\n"#1",1,2\nb,3,4\n', encoding="utf-8")  # a name is no comment
    assert load_stops(file).names == ("#1", "b")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "stops"),
        ("x,y,color\n1,2,red\n", "column = 'color'"),
        ("x,name\n1,a\n", "columns"),
        ("x,y\n1\n", r"stops.csv:2: entries = 1"),
        ("x,y\n1,abc\n", r"stops.csv:2: y = 'abc'"),
        ("x,y\n1,nan\n", r"stops.csv:2: y = nan"),
        ("x,y,earliest,latest\n1,2,9,8\n", r"stops.csv:2: latest = 8.0"),
        ("x,y,earliest\n1,2,inf\n", r"stops.csv:2: earliest = inf"),
        ("x,y,service\n1,2,2e9\n", r"stops.csv:2: service = 2000000000.0"),
        ("x,y,x\n1,2,3\n", "given once"),
        ("x,y\n", "one stop or more"),
        ('x,y\n"1,2\n', "comma-separated"),
        ('x,y,name\n1,2,"a\nb"\n3,abc,c\n', r"stops.csv:4: y = 'abc'"),
    ],
)
def test_a_wrong_file_of_stops_says_where(tmp_path, text: str, words: str) -> None:
    file = tmp_path / "stops.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(BadInput, match=words):
        load_stops(file)


def test_the_command_plans_draws_and_prints(tmp_path, capsys) -> None:
    from antway.cli import app
    from antway.console import Refused

    antway.save_map(HALL, tmp_path / "hall.yaml")
    stops = tmp_path / "stops.csv"
    stops.write_text("name,x,y,latest\nlab,4.5,1.5,\nward,1.5,2.5,30\n", encoding="utf-8")
    told = ["tour", str(tmp_path / "hall.yaml"), "--start", "0.5,0.5", "--stops", str(stops), "--seconds", "0.1"]
    assert not app([*told, "--out", str(tmp_path / "tour.png"), "--end", "start"], standalone_mode=False)
    assert "lab" in capsys.readouterr().out
    assert (tmp_path / "tour.png").stat().st_size > 10_000
    assert not app([*told, "--json"], standalone_mode=False)
    record = json.loads(capsys.readouterr().out)
    assert [visit["name"] for visit in record["routes"][0]["visits"]] == ["ward", "lab"]
    assert record["feasible"] is True
    stops.write_text("name,x,y,latest\nlab,4.5,1.5,0.5\n", encoding="utf-8")
    assert app(told, standalone_mode=False) == 4
    assert app([*told, "--distances", str(tmp_path / "d.csv"), "--end", "4.5,2.5"], standalone_mode=False) == 4
    head, *lines = csv.reader((tmp_path / "d.csv").read_text(encoding="utf-8").splitlines())
    assert head == ["", "start", "lab", "end"] and [line[0] for line in lines] == head[1:]
    cells = [HALL.cell_at(place) for place in ((0.5, 0.5), (4.5, 1.5), (4.5, 2.5))]
    assert np.array([list(map(float, line[1:])) for line in lines]).tolist() == stop_distances(HALL, cells).tolist()
    with pytest.raises(BadInput, match="seconds = inf"):
        app([*told, "--seconds", "inf"], standalone_mode=False)
    stops.write_text("x,y,priority\n4.5,1.5,0\n", encoding="utf-8")
    assert not app(told, standalone_mode=False) and "every stop is left out" in capsys.readouterr().err
    with pytest.raises(Refused, match=r"\.csv"):
        app([*told, "--distances", str(tmp_path / "d.png")], standalone_mode=False)


def test_the_command_says_what_a_bound_on_priorities_proves(capsys) -> None:
    """That no tour collects more, which says nothing about its length."""
    from antway.console import print_tour

    for more, words in (({}, "; no tour collects more"), ({"deadline": 3.0}, "; at most 50.0 % more can be collected")):
        print_tour(plan_tour(HALL, (2.5, 1.5), [*GOOD, (2.5, 3.5)], priorities=[1, 1, 1], cycles=2, **more))
        printed = capsys.readouterr().out
        assert re.search(words, printed) and "best" not in printed, printed
