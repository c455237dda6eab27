"""C48: `order_stops` against all permutations: windows, deadlines, priorities, several robots, open, closed and given ends."""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import replace

import numpy as np
import pytest

import naive.ordering as naive
from antway.errors import BadInput, BadParameter, TooLarge
from antway.kernels.base.rng import below, uniform
from antway.kernels.colony import fleet as kernel
from antway.tours.fleet import _fleet, layout
from antway.tours.ordering import Ordering, order_stops
from antway.tours.stops import Stops
from common import cases


def sound(answer: Ordering, matrix: np.ndarray, start: int, end: int | None, robots: int, whole: bool) -> None:
    """Assert that the routes begin and end where they should, and visit no stop twice."""
    assert len(answer.orders) == robots
    inner: list[int] = []
    for order in answer.orders:
        assert order[0] == start and (end is None or (len(order) > 1 and order[-1] == end))
        inner += order[1 : len(order) - (end is not None)].tolist()
    assert len(set(inner)) == len(inner) and not {start, end} & set(inner)
    if whole:
        assert {start, *inner} | ({end} - {None}) == set(range(len(matrix)))


def test_equal_to_all_permutations() -> None:
    rng, feasible = np.random.default_rng(1), 0
    for case in range(cases(80, 2_000)):
        n = int(rng.integers(2, 8))
        xy = rng.random((n, 2)) * 10
        matrix = np.hypot(*(xy[:, None] - xy[None]).T)
        if rng.random() < 0.4:
            matrix = matrix * rng.uniform(0.8, 1.2, matrix.shape)
        start = int(rng.integers(n))
        given = [None, "start", int(rng.integers(n))][rng.integers(3)]
        end = start if given == "start" else given
        robots = min(int(rng.choice([1, 1, 1, 2, 3])), 2 if n > 6 else 3)
        priorities = rng.integers(1, 6, n).astype(float) if rng.random() < 0.3 else None
        service = rng.random(n) * (rng.random() < 0.5)
        windows = np.tile([0.0, math.inf], (n, 1))
        if rng.random() < 0.5:
            begin = rng.random(n) * 15
            windows = np.c_[begin * (rng.random(n) < 0.5), begin + rng.random(n) * 25]
            windows[start] = 0.0, math.inf
        deadline = float(rng.uniform(8, 25)) if priorities is not None or rng.random() < 0.2 else math.inf
        makespan = bool(rng.integers(2))
        answer = order_stops(
            matrix,
            start=start,
            end=given,
            windows=windows,
            service=service,
            priorities=priorities,
            deadline=deadline,
            robots=robots,
            objective="makespan" if makespan else "travel time",
            cycles=20,
            seed=case,
        )
        sound(answer, matrix, start, end, robots, priorities is None)
        late = naive.lateness(matrix.tolist(), windows.tolist(), service.tolist(), deadline, answer.orders, end == start)
        assert answer.lateness == pytest.approx(late, abs=1e-6)
        best = naive.best(
            matrix.tolist(), start, end, windows.tolist(), service.tolist(), priorities, deadline, robots, makespan
        )
        assert answer.feasible == (best is not None), case
        if best is None:
            continue
        feasible += 1
        assert answer.collected == pytest.approx(best[0]), case
        assert answer.cost == pytest.approx(best[1], rel=1e-6), case
        assert answer.bound >= best[0] - 1e-9 if priorities is not None else answer.bound <= best[1] * (1 + 1e-12), case
    assert feasible > case / 2


@pytest.mark.parametrize("robots", [1, 2])
def test_nine_stops_equal_all_orders(robots: int) -> None:
    """Eight stops from a start, with windows: of all 40,320 orders, cut between two robots anywhere, none is cheaper."""
    rng = np.random.default_rng(6)
    for case in range(cases(4, 100)):
        xy = rng.random((9, 2)) * 10
        matrix = np.hypot(*(xy[:, None] - xy[None]).T) * rng.uniform(0.8, 1.2, (9, 9))
        begin = rng.random(9) * 15
        windows = np.c_[begin * (rng.random(9) < 0.3), begin + 15 + rng.random(9) * 20]
        windows[0] = 0.0, math.inf
        answer = order_stops(matrix, end="start", windows=windows, robots=robots, cycles=100, seed=case)
        orders = 1 + np.array(list(itertools.permutations(range(8))))
        best = math.inf
        for cut in range(9) if robots == 2 else (8,):
            cost = np.zeros(len(orders))
            for part in (orders[:, :cut], orders[:, cut:]):
                now, at = np.zeros(len(orders)), np.zeros(len(orders), int)
                for stop in part.T:
                    cost += matrix[at, stop]
                    now = np.maximum(now + matrix[at, stop], windows[stop, 0])
                    cost[now > windows[stop, 1]] = math.inf
                    at = stop
                cost += matrix[at, 0] * (part.shape[1] > 0)
            best = min(best, float(cost.min()))
        assert answer.feasible == math.isfinite(best)
        assert not answer.feasible or answer.cost == pytest.approx(best, rel=1e-9), case


def test_more_than_twelve_asymmetric_stops() -> None:
    """A cycle of cheap arcs one way is found, and its bound is its cost."""
    rng = np.random.default_rng(3)
    n = 40
    matrix = rng.uniform(5.0, 9.0, (n, n))
    ring = np.append(0, 1 + rng.permutation(n - 1))
    matrix[ring, np.roll(ring, -1)] = 1.0
    answer = order_stops(matrix, end="start", cycles=20)
    assert answer.cost == pytest.approx(n) and answer.gap < 1e-6
    assert answer.orders[0].tolist() == [*ring.tolist(), 0]


@pytest.mark.parametrize("timed", [False, True])
@pytest.mark.parametrize("end", [None, "start", 7])
def test_goes_on_from_a_former_answer(timed: bool, end: int | str | None) -> None:
    """With no cycle to run a former order is improved at most; stops that have come or gone find their place."""
    rng = np.random.default_rng(5)
    xy = rng.random((40, 2)) * 100
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    windows = np.tile([0.0, 2_000.0 if timed else math.inf], (40, 1))
    first = order_stops(matrix, end=end, windows=windows, cycles=30, seed=1)
    again = order_stops(matrix, end=end, windows=windows, cycles=1, seed=2, initial=first)
    assert again.cost <= first.cost * (1 + 1e-9) and again.feasible
    fewer = order_stops(matrix[:39, :39], end=end, windows=windows[:39], cycles=1, initial=first)
    assert fewer.feasible and fewer.cost <= first.cost * (1 + 1e-9)
    rougher = order_stops(matrix, end=end, windows=windows, cycles=1, initial=fewer.orders[0])
    sound(rougher, matrix, 0, 0 if end == "start" else end, 1, True)


def test_several_robots_go_on_too() -> None:
    rng = np.random.default_rng(6)
    xy = rng.random((30, 2)) * 100
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    first = order_stops(matrix, end="start", robots=3, objective="makespan", cycles=60, seed=1)
    again = order_stops(matrix, end="start", robots=3, objective="makespan", cycles=3, seed=2, initial=first)
    assert again.cost <= first.cost * (1 + 1e-9)
    assert first.bound <= first.cost and max(len(order) for order in first.orders) < 25


def test_same_seed_same_bytes() -> None:
    rng = np.random.default_rng(2)
    xy = rng.random((25, 2)) * 100
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    for more in (
        {},
        {"windows": np.tile([0.0, 900.0], (25, 1))},
        {"robots": 2},
        {"priorities": np.ones(25), "deadline": 150.0},
    ):
        one, two = (order_stops(matrix, cycles=10, seed=3, **more) for _ in range(2))
        assert one.cost == two.cost and all(a.tobytes() == b.tobytes() for a, b in zip(one.orders, two.orders))


@pytest.mark.parametrize("end", [None, "start", 4])
def test_most_pheromone_is_on_the_order_found(end: int | str | None) -> None:
    """Rows and columns of the pheromone are stops, wherever the tour starts."""
    xy = np.random.default_rng(4).random((12, 2)) * 100
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    answer = order_stops(matrix, start=9, end=end, windows=np.tile([0.0, 600.0], (12, 1)), cycles=6)
    assert answer.pheromone is not None and answer.pheromone.mean() < 0.4
    assert answer.pheromone[answer.orders[0][:-1], answer.orders[0][1:]].min() > 0.6


def test_the_makespan_comes_before_the_travel_time() -> None:
    """A detour of 1 ms of the last robot is worse than a minute's way of another one."""
    matrix = [[0, 50, 30], [50, 0, 20.001], [30, 20.001, 0]]
    assert order_stops(matrix, end="start", robots=2, objective="makespan", cycles=5).cost == 100.0


def test_what_never_binds_is_none() -> None:
    """Windows and deadlines after any possible end leave the task what it is without them."""
    rng = np.random.default_rng(7)
    xy = rng.random((30, 2)) * 100
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    opens = np.where(np.arange(30) == 4, 500.0, 0.0)
    plain = order_stops(matrix, end="start", cycles=5)
    for more in ({"windows": np.tile([0.0, 1e5], (30, 1))}, {"deadline": 1e6}):
        loose = order_stops(matrix, end="start", cycles=5, **more)
        assert (loose.cost, loose.bound) == (plain.cost, plain.bound) and loose.gap < 0.05
    for late in (1e4, math.inf):
        answer = order_stops(matrix, windows=np.c_[opens, np.full(30, late)], objective="makespan", cycles=5)
        assert answer.feasible and answer.arrival[0][-1] + answer.waiting[0][-1] >= 500.0


def test_what_binds_by_service_alone_binds() -> None:
    """Three stops are driven to in 2 s; with 5 s at each one the last two are late, as is the end."""
    for late, more in (2.0 + 8.0, {"windows": [(0, 4.0)] * 3}), (2.0, {"deadline": 15.0}):
        assert order_stops(np.ones((3, 3)), service=5.0, cycles=2, **more).lateness == pytest.approx(late)


@pytest.mark.parametrize("end", [None, "start"])
@pytest.mark.parametrize("objective", ["travel time", "makespan"])
def test_routes_that_cost_no_more_than_the_bound_end_the_search(end: str | None, objective: str) -> None:
    """One stop and three robots need no second."""
    order_stops([[0, 7], [7, 0]], end=end, robots=3, objective=objective, cycles=1)
    begun = time.perf_counter()
    answer = order_stops([[0, 7], [7, 0]], end=end, robots=3, objective=objective, seconds=30.0)
    assert time.perf_counter() - begun < 15.0  # far above, so that a busy machine fails nothing
    assert answer.gap < 1e-8 and answer.cost == pytest.approx(7.0 if end is None else 14.0)


def test_what_cannot_be_is_late_or_infinite() -> None:
    matrix = np.full((4, 4), 5.0)
    windows = np.tile([0.0, 3.0], (4, 1))
    for robots in (1, 2):
        answer = order_stops(matrix, windows=windows, robots=robots, cycles=5)
        assert answer.feasible is False and type(answer.lateness) is float and answer.lateness > 0.0
        sound(answer, matrix, 0, None, robots, True)
    cut = matrix.copy()
    cut[:, 3] = math.inf
    for robots in (1, 2):
        answer = order_stops(cut, robots=robots, cycles=5)
        assert not answer.feasible and answer.cost == math.inf
    assert 3 not in order_stops(cut, priorities=np.ones(4), cycles=5).orders[0]
    late = order_stops(matrix, deadline=2.0, end="start", cycles=5)
    assert not late.feasible and late.lateness == pytest.approx(18.0)


def test_several_robots_are_little_late_where_all_must_be() -> None:
    """No stop alone is better elsewhere, and few orders of all are less late than those found."""
    rng, worse, late = np.random.default_rng(8), 0, 0
    for case in range(cases(60, 1_000)):
        n, robots = int(rng.integers(4, 6)), int(rng.integers(2, 4))
        xy, begin = rng.random((n, 2)) * 10, rng.random(n) * 5
        matrix, windows = np.hypot(*(xy[:, None] - xy[None]).T), np.c_[begin, begin + rng.random(n) * 4]
        windows[0] = 0.0, math.inf
        answer = order_stops(matrix, windows=windows, service=1.0, robots=robots, cycles=5, seed=case)
        sound(answer, matrix, 0, None, robots, True)
        if answer.feasible:
            continue

        def lateness(orders: list[list[int]]) -> float:
            return naive.lateness(matrix.tolist(), windows.tolist(), [1.0] * n, math.inf, orders, False)  # noqa: B023

        orders = [order.tolist() for order in answer.orders]
        for stop in range(1, n):
            rest = [[one for one in order if one != stop] for order in orders]
            for k, order in enumerate(rest):
                for place in range(1, len(order) + 1):
                    assert (
                        answer.lateness <= lateness([*rest[:k], [*order[:place], stop, *order[place:]], *rest[k + 1 :]]) + 1e-3
                    )
        least = math.inf
        for order in itertools.permutations(range(1, n)):
            for cuts in itertools.combinations_with_replacement(range(n), robots - 1):
                ends = [0, *cuts, n - 1]
                least = min(least, lateness([[0, *order[a:b]] for a, b in itertools.pairwise(ends)]))
        late, worse = late + 1, worse + (answer.lateness > least + 1e-3)
    assert late > case / 2 and worse <= late / 20


def test_several_robots_are_as_little_late_by_time_as_by_cycles() -> None:
    """A budget in seconds leaves some of it for the stops that fit nowhere."""
    rng = np.random.default_rng(0)
    for _ in range(cases(6, 40)):
        xy = rng.random((6, 2)) * 100
        matrix, windows = np.hypot(*(xy[:, None] - xy[None]).T), np.tile([0.0, math.inf], (6, 1))
        windows[1:, 1] = rng.uniform(5, 40, 5)
        answer = order_stops(matrix, windows=windows, robots=2, seed=1, end="start", seconds=0.2)
        shared = itertools.product(itertools.permutations(range(1, 6)), range(6))
        routes = ([[0, *order[:cut], 0], [0, *order[cut:], 0]] for order, cut in shared)
        least = min(naive.lateness(matrix.tolist(), windows.tolist(), [0.0] * 6, math.inf, each, True) for each in routes)
        assert answer.lateness == pytest.approx(least, rel=1e-6)


@pytest.mark.parametrize("timed", [False, True])
def test_several_robots_find_routes_where_few_arcs_exist(timed: bool) -> None:
    """Of random arcs few are there, and those of routes that visit each stop; no stop fits between two others at first."""
    rng, found, count = np.random.default_rng(11), 0, cases(24, 300)
    for case in range(count):
        n, robots, end = 14, 2 + case % 3, (None, 0, 13)[case // 3 % 3]
        xy = rng.random((n, 2)) * 100
        full = np.hypot(*(xy[:, None] - xy[None]).T)
        matrix, windows = np.where(rng.random((n, n)) < 0.1, full, math.inf), np.tile([0.0, math.inf], (n, 1))
        inner = [stop for stop in range(1, n) if stop != end]
        for part in np.split(rng.permutation(inner), np.sort(rng.integers(0, len(inner) + 1, robots - 1))):
            route, now = [0, *part.tolist(), *([] if end is None else [end])], 0.0
            for here, there in itertools.pairwise(route):
                matrix[here, there] = full[here, there]
                now += full[here, there]
                if timed and there != end:
                    windows[there] = max(0.0, now - rng.random() * 100.0), now + rng.random() * 100.0
        answer = order_stops(matrix, end="start" if end == 0 else end, windows=windows, robots=robots, cycles=30, seed=case)
        sound(answer, matrix, 0, end, robots, True)
        found += answer.feasible
    assert found >= 0.7 * count


@pytest.mark.parametrize("initial", [None, [0, 3, 1, 2]])
def test_a_stop_of_priority_zero_is_left_out(initial: list[int] | None) -> None:
    """It would cost a way and collect nothing; only where the way through it is shorter it is a part of the tour."""
    xy = np.array([(0, 0), (3, 0), (9, 9), (9, 0)])
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    answer = order_stops(matrix, end="start", priorities=[0, 1, 0, 0], cycles=2, initial=initial)
    assert answer.orders[0].tolist() == [0, 1, 0] and answer.cost == 6.0 and answer.collected == 1.0
    matrix[0, 2] = matrix[2, 1] = 1.0
    short = order_stops(matrix, end="start", priorities=[0, 1, 0, 0], cycles=2, initial=initial)
    assert short.orders[0].tolist() == [0, 2, 1, 0] and short.cost == 5.0


def test_a_window_may_close_at_the_arrival_and_just_before() -> None:
    rng = np.random.default_rng(3)
    xy = rng.random((16, 2)) * 5
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    free = order_stops(matrix, end="start", cycles=20)
    windows = np.tile([0.0, math.inf], (16, 1))
    windows[free.orders[0][1], 1] = free.arrival[0][1]
    answer = order_stops(matrix, end="start", windows=windows, cycles=5)
    assert answer.feasible and answer.cost == pytest.approx(free.cost)
    windows[free.orders[0][1], 1] -= 0.05  # now nothing can be in time, and the cost still counts
    for known in None, free:
        late = order_stops(matrix, end="start", windows=windows, cycles=5, initial=known)
        assert late.lateness == pytest.approx(0.05) and late.cost == pytest.approx(free.cost)


def test_service_of_a_chosen_stop_is_no_cost() -> None:
    """Only one of two stops can be visited in time, and the near one takes 21 s."""
    matrix = np.abs(np.subtract.outer([0.0, -25.0, 5.0], [0.0, -25.0, 5.0]))
    answer = order_stops(matrix, service=[0, 0, 21], priorities=[0, 1, 1], deadline=29, cycles=2)
    assert answer.orders[0].tolist() == [0, 2] and answer.cost == 5.0
    matrix[0, 2] = matrix[2, 1] = 1.0  # a way through a stop without value saves time though that takes service
    answer = order_stops(matrix, service=[0, 0, 40], priorities=[0, 1, 0], cycles=2)
    assert answer.orders[0].tolist() == [0, 2, 1] and answer.cost == 2.0


def test_a_deadline_may_be_the_end() -> None:
    """0.1 + 0.1 + 0.1 is more than 0.3 by rounding alone."""
    matrix = 0.1 * np.abs(np.subtract.outer(np.arange(4.0), np.arange(4.0)))
    answer = order_stops(matrix, priorities=np.ones(4), deadline=0.3, cycles=2)
    assert answer.collected == 4.0 and answer.feasible
    # Service at the end must be over by then: there is no time for stop 1.
    answer = order_stops(matrix, end=3, service=[0, 0.1, 0, 0.1], priorities=np.ones(4), deadline=0.4, cycles=2)
    assert answer.collected == 3.0 and answer.feasible and answer.orders[0].tolist() == [0, 2, 3]


@pytest.mark.parametrize("robots", [1, 2])
def test_a_second_late_is_late_however_late_the_end_is(robots: int) -> None:
    """One window is missed by 0.9 s, and another opens after 30 years; a deadline of 30 years is missed by 0.5 s."""
    matrix = [[0, 0.9, 1], [1, 0, 1], [1, 1, 0]]
    answer = order_stops(matrix, windows=[[0, math.inf], [0, 0], [1e9, 1e9]], robots=robots, cycles=5)
    assert not answer.feasible and answer.lateness == pytest.approx(0.9)
    answer = order_stops(matrix, end="start", windows=[[0, math.inf], [0, math.inf], [1e9, 1e9]], deadline=1e9 + 0.5, cycles=5)
    assert not answer.feasible and answer.lateness == pytest.approx(0.5)


def test_what_cannot_be_reached_is_not_in_the_bound() -> None:
    """Without a deadline either: no robot collects what it has no path to, or no path to the end from."""
    for gone in (np.s_[:, 3], np.s_[3, :]):
        matrix = np.full((5, 5), 5.0)
        matrix[gone] = math.inf
        answer = order_stops(matrix, end=4, priorities=[0, 1, 2, 4, 0], cycles=5)
        assert answer.collected == answer.bound == 3.0 and answer.gap == 0.0


def test_no_robot_is_back_before_a_window_opens() -> None:
    answer = order_stops(np.ones((3, 3)), windows=[(0, 9), (8, 9), (0, 9)], robots=2, objective="makespan", cycles=2)
    assert answer.cost == 8.0 and answer.bound == pytest.approx(8.0)
    answer = order_stops(np.ones((3, 3)), windows=[(0, 9)] * 3, service=[5, 0, 0], objective="makespan", cycles=2)
    assert answer.cost == 7.0 and answer.bound == pytest.approx(7.0)
    windows = [(2, 3), (0, 99), (0, 99)]  # that of the start is for the departure, also where the tour ends there
    answer = order_stops(np.ones((3, 3)), end="start", windows=windows, service=[5, 0, 0], objective="makespan", cycles=2)
    assert answer.feasible and answer.cost == 10.0


def test_routes_stay_in_time_where_ways_through_a_stop_are_shorter() -> None:
    """Without stop 1 the robot comes to stop 2 too late, but would be back sooner."""
    windows = [(0, math.inf), (0, math.inf), (0, 3)]
    answer = order_stops([[0, 1, 5], [0, 0, 1], [10, 0, 0]], end="start", windows=windows, priorities=[0, 1, 1], cycles=5)
    assert answer.feasible and answer.orders[0].tolist() == [0, 1, 2, 0]


def test_a_late_answer_is_no_worse_than_the_former_one() -> None:
    matrix = [[0, 7, 1, 2], [7, 0, 7, 3], [1, 7, 0, 4], [2, 3, 4, 0]]
    known = order_stops(matrix, robots=2, cycles=1)
    known = replace(known, orders=(np.array([0, 2, 1], dtype=np.int32), np.array([0, 3], dtype=np.int32)))
    answer = order_stops(matrix, windows=[(0, 9), (0, 1), (0, 4), (0, 1)], robots=2, cycles=3, initial=known)
    assert answer.lateness < 8.0 or (answer.lateness == 8.0 and answer.cost <= 11.0)


def test_spends_no_more_than_it_may() -> None:
    rng = np.random.default_rng(9)
    xy = rng.random((60, 2)) * 100
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    for more in ({}, {"windows": np.tile([0.0, 2_000.0], (60, 1))}, {"robots": 2}):
        answer = order_stops(matrix, cycles=1, **more)
        assert 0.0 < answer.bound <= answer.cost
        begun = time.perf_counter()
        order_stops(matrix, seconds=0.05, **more)
        assert time.perf_counter() - begun < 10.0  # far above, so that a busy machine fails nothing
    many = 500
    xy = rng.random((many, 2)) * 100
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    windows = np.c_[np.zeros(many), rng.uniform(10.0, 2_000.0, many)]
    order_stops(matrix[:20, :20], windows=windows[:20], cycles=1)
    begun = time.process_time()
    order_stops(matrix, seconds=0.2, windows=windows)
    assert time.process_time() - begun < 2.0, "what windows decide alone would take a second and a half more"
    begun = time.process_time()
    answer = order_stops(matrix, seconds=0.2, windows=np.tile([0.0, 100.0], (many, 1)), robots=3)
    assert time.process_time() - begun < 4.0 and len(np.unique(np.concatenate(answer.orders))) == many
    begun = time.process_time()
    answer = order_stops(matrix, seconds=0.2, windows=windows, initial=[0])
    assert time.process_time() - begun < 4.0 and sorted(answer.orders[0]) == list(range(many))
    matrix = np.repeat(np.repeat(matrix, 4, axis=0), 4, axis=1) * rng.uniform(1.0, 1.1, (4 * many, 4 * many))
    begun = time.process_time()
    answer = order_stops(matrix, seconds=0.2)
    assert time.process_time() - begun < 4.0, "a local optimum from any order would take as long again"
    assert sorted(answer.orders[0]) == list(range(4 * many)) and answer.cost < matrix.mean() * many


def test_a_gap_of_nothing_collected_is_infinite() -> None:
    answer = order_stops([[0, 5], [5, 0]], priorities=[0, 3], deadline=1.0, seconds=0.0)
    assert answer.bound == 3.0 and answer.collected == 0.0 and answer.gap == math.inf


def test_times_of_routes_stay_right() -> None:
    """After any number of ruins the arrays of a route are those of a fresh one."""
    rng = np.random.default_rng(4)
    n, k = 14, 3
    xy = rng.random((n, 2)) * 10
    xy[-1] = xy[0]
    spans = np.ascontiguousarray(np.hypot(*(xy[:, None] - xy[None]).T))
    near = np.array([[j for j in np.argsort(spans[i]) if j not in (0, i, n - 1)][: n - 3] for i in range(n)], dtype=np.int32)
    opens = np.where(rng.random(n) < 0.3, 8.0, 0.0)
    opens[0] = 0.0
    fleet = kernel.Fleet(
        spans, spans, opens, np.full(n, 60.0), np.full(n, 99.0), np.full(n, np.inf), np.ones(n), near, 1.0, 1e-4
    )
    now, saved, best = (kernel.routes(n, k) for _ in range(3))
    cost, worth = kernel.start(fleet, saved, np.uint64(1))
    kernel.copy(saved, best)
    record = np.array([cost, worth, cost])
    for turn in range(30):
        kernel.anneal(fleet, now, saved, best, record, np.uint64(turn), 10, 3.0)
        fresh = kernel.routes(n, k)
        kernel.restore(fleet, saved, fresh)
        stops = sorted(int(stop) for r in range(k) for stop in saved.stops[r, 1 : saved.sizes[r] - 1])
        assert stops == [stop for stop in range(1, n - 1) if saved.route[stop] != kernel.OUT]
        total, last = 0.0, 0.0
        for r in range(k):
            route = saved.stops[r, : saved.sizes[r]].tolist()
            assert route[0] == 0 and route[-1] == n - 1
            done, travel, late = naive.timing(spans, np.c_[opens, np.full(n, 60.0)].tolist(), np.zeros(n), 60.0, route, True)
            assert late == 0.0 and fresh.ends[r] == pytest.approx(done) and fresh.travel[r] == pytest.approx(travel)
            total, last = total + travel, max(last, done)
        assert record[kernel.COST] == pytest.approx(last + 1e-4 * total + 99.0 * (n - 2 - len(stops)))


@pytest.mark.parametrize("more", [{"robots": 2}, {"priorities": [1, 0, 1, 2, 2]}])
def test_routes_that_become_late_by_waiting_are_late(more: dict) -> None:
    """A stop that is on the way, in times without triangle inequality, is left out: the next one opens after it must begin."""
    matrix = [[0, 9, 51, 49, 56], [9, 0, 66, 22, 48], [51, 66, 0, 4, 33], [49, 22, 4, 0, 14], [56, 48, 33, 14, 0]]
    windows = [[140, 140], [0, 0], [66, 66], [0, math.inf], [0, math.inf]]
    for cycles in (1, 2, 30):
        answer = order_stops(matrix, start=1, end=0, windows=windows, cycles=cycles, **more)
        assert answer.feasible and answer.lateness == 0.0 and set(np.concatenate(answer.orders).tolist()) == set(range(5)), (
            cycles
        )


@pytest.mark.parametrize(
    ("more", "field"),
    [
        ({"matrix": [[0.0, 1.0]]}, "matrix.shape"),
        ({"matrix": [[0.0, math.nan], [1.0, 0.0]]}, "matrix[0, 1]"),
        ({"matrix": [[0.0, -1.0], [1.0, 0.0]]}, "matrix[0, 1]"),
        ({"matrix": np.zeros((0, 0))}, "matrix.shape"),
        ({"start": 3}, "start"),
        ({"end": 5}, "end"),
        ({"end": "finish"}, "end"),
        ({"windows": [[0, 1], [5, 4], [0, 1]]}, "windows[1]"),
        ({"windows": [[0, 1], [0, 4], [0, math.nan]]}, "windows[2]"),
        ({"service": [0, 0, -1]}, "service[2]"),
        ({"priorities": [0, -2, 1]}, "priorities[1]"),
        ({"deadline": -1.0}, "deadline"),
        ({"robots": 0}, "robots"),
        ({"objective": "length"}, "objective"),
        ({"seconds": math.nan}, "seconds"),
        ({"cycles": 1.5}, "cycles"),
        ({"seed": -1}, "seed"),
        ({"initial": [0, 1.5, 2]}, "initial"),
        ({"initial": [0, 1, 2, 1]}, "initial"),
        ({"initial": "tour"}, "initial"),
    ],
)
def test_wrong_input_is_one_typed_error(more: dict, field: str) -> None:
    arguments = {"matrix": np.ones((3, 3)), **more}
    with pytest.raises(BadParameter) as caught:
        order_stops(arguments.pop("matrix"), **arguments)
    assert caught.value.field == field


def test_robots_that_start_elsewhere_visit_their_earlier_start_once() -> None:
    """It was in the order of each robot, and is now a stop like all others, whoever has time for it."""
    rng = np.random.default_rng(0)
    for _ in range(cases(60, 600)):
        xy = rng.random((8, 2)) * 10
        matrix = np.hypot(*(xy[:, None] - xy[None]).T)
        before = order_stops(matrix, robots=2, cycles=5)
        windows = np.c_[np.zeros(8), rng.random(8) * 12]  # there is always a late one
        after = order_stops(matrix, start=7, robots=2, windows=windows, initial=before, seconds=0.0, quick=True)
        sound(after, matrix, 7, None, 2, whole=True)


def random_routes(rng: np.random.Generator, n: int, k: int) -> tuple[kernel.Fleet, kernel.FleetRoutes]:
    """A task for kernels, and routes through some of its stops, with their times."""
    xy = rng.random((n, 2)) * 10
    spans = np.ascontiguousarray(np.hypot(*(xy[:, None] - xy[None]).T))
    opens, near = rng.uniform(0.0, 20.0, n), np.zeros((n, n - 3), dtype=np.int32)
    closes, most = opens + rng.uniform(2.0, 25.0, n), np.where(rng.random(n) < 0.5, np.inf, 4.0)
    opens[0], closes[[0, -1]] = 0.0, 90.0
    last_weight, sum_weight = [(0.0, 1.0), (1.0, 1e-4)][rng.integers(2)]
    fleet = kernel.Fleet(spans, spans, opens, closes, np.full(n, 99.0), most, np.ones(n), near, last_weight, sum_weight)
    routes = kernel.routes(n, k)
    for stop in (1 + rng.permutation(n - 2))[: n - 4].tolist():
        r = rng.integers(k)
        routes.stops[r, routes.sizes[r] - 1 : routes.sizes[r] + 1] = stop, n - 1
        routes.route[stop] = r
        routes.sizes[r] += 1
    for r in range(k):
        kernel.shorten(fleet, routes, r)
        size = routes.sizes[r]
        assert (routes.ready[r, :size] <= closes[routes.stops[r, :size]]).all()
    return fleet, routes


def listed(routes: kernel.FleetRoutes) -> list[list[int]]:
    """The stops of each route, with start and end."""
    return [row[:size].tolist() for row, size in zip(routes.stops, routes.sizes)]


def test_a_stop_is_inserted_where_it_costs_least() -> None:
    """In time, and with less than the greatest detour; one place in a hundred is not looked at."""
    rng, best, refused = np.random.default_rng(6), 0, 0
    for case in range(cases(150, 600)):
        n, k = int(rng.integers(6, 11)), int(rng.integers(1, 4))
        fleet, routes = random_routes(rng, n, k)
        stop = int(rng.choice(np.flatnonzero(routes.route[1:-1] == kernel.OUT) + 1))
        orders = listed(routes)
        windows, costs = np.c_[fleet.opens, fleet.closes].tolist(), {}
        for r, order in enumerate(orders):
            for p in range(1, len(order)):
                trial = [*order[:p], stop, *order[p:]]
                end, travel, late = naive.timing(fleet.time, windows, np.zeros(n), math.inf, trial, False)
                detour = travel - naive.timing(fleet.time, windows, np.zeros(n), math.inf, order, False)[1]
                if late == 0.0 and detour < fleet.most[stop]:
                    others = max((routes.ends[other] for other in range(k) if other != r), default=0.0)
                    costs[r, p] = fleet.sum_weight * detour + fleet.last_weight * (max(others, end) + 0.01 * end)
        assert kernel.insert(fleet, routes, stop, np.array([case], dtype=np.uint64)) or len(costs) < 2
        r = int(routes.route[stop])
        refused += r == kernel.OUT
        if r != kernel.OUT:
            order = listed(routes)[r]
            p = order.index(stop)
            assert order == [*orders[r][:p], stop, *orders[r][p:]] and (r, p) in costs
            best += costs[r, p] == pytest.approx(min(costs.values()))
    assert refused > 2 and best > 0.95 * (case + 1 - refused)


def test_of_late_routes_the_stops_that_save_most_time_for_their_price_are_left_out() -> None:
    """One by one, of those up to the first one that is late, until none is."""
    rng, removed = np.random.default_rng(11), 0
    for _ in range(cases(40, 400)):
        fleet, _ = random_routes(rng, 10, 1)
        fleet, routes, order = fleet._replace(price=rng.uniform(1.0, 9.0, 10)), kernel.routes(10, 1), [*range(10)]
        order[1:-1] = (1 + rng.permutation(8)).tolist()
        routes.stops[0], routes.sizes[0], routes.route[1:-1] = order, 10, 0
        kernel.shorten(fleet, routes, 0)
        while len(order) > 2:
            start, late = fleet.opens[0], None
            for p, (here, there) in enumerate(itertools.pairwise(order), 1):
                start = max(start + fleet.time[here, there], fleet.opens[there])
                late = p if late is None and start > fleet.closes[there] else late
            if late is None:
                break
            saved = [
                max(0.0, fleet.time[a, b] + fleet.time[b, c] - fleet.time[a, c]) / (fleet.price[b] + 1e-9)
                for a, b, c in zip(order, order[1:], order[2:])
            ]
            del order[1 + int(np.argmax(saved[:late]))]
            removed += 1
        assert listed(routes) == [order] and np.flatnonzero(routes.route == 0).tolist() == sorted(order[1:-1])
    assert removed > 40


def test_a_string_of_stops_is_removed_around_one() -> None:
    """A window of places that holds the stop, but for a run of stops that stay, at most as many as are removed."""
    rng = np.random.default_rng(7)
    for size, length, place in ((6, 2, 3), (6, 3, 6), (5, 1, 1), (4, 4, 2), (5, 3, 3)):
        fleet, _ = random_routes(rng, size + 2, 1)
        wanted: dict[tuple[int, ...], int] = {}  # the places removed, and how many stay
        for staying in range(min(length, size - length) + 1):
            for low in range(1, size - length - staying + 2):
                window = range(low, low + length + staying)
                for kept in range(low, low + length + 1) if place in window else ():
                    wanted.setdefault(tuple(p for p in window if not kept <= p < kept + staying), staying)
        found, state = set(), np.array([size], dtype=np.uint64)
        for _ in range(600):
            routes = kernel.routes(size + 2, 1)
            routes.stops[0], routes.sizes[0], routes.route[1:-1] = range(size + 2), size + 2, 0
            kernel.remove_string(fleet, routes, 0, place, length, state)
            left = listed(routes)[0]
            found.add(tuple(p for p in range(1, size + 1) if p not in left))
            assert left == sorted(left) and set(np.flatnonzero(routes.route != kernel.OUT)) == set(left[1:-1])
        most = max(wanted.values())
        assert {one for one, staying in wanted.items() if staying in (0, most)} <= found <= set(wanted)


def test_strings_are_removed_from_routes_near_a_stop() -> None:
    """Against `ruin` by its definition, with the kernel's removal of one string: how many, from which routes, and how long."""
    rng, numbers, last, empty = np.random.default_rng(12), set(), 0, 0
    for case in range(cases(150, 2_000)):
        n, k = 14, int(rng.choice([1, 3, 8]))
        fleet, given = random_routes(rng, n, k)
        near = np.array([[j for j in np.argsort(fleet.time[i]) if j not in (0, i, n - 1)][: n - 3] for i in range(n)], np.int32)
        fleet = fleet._replace(near=near, most=np.full(n, -math.inf))  # so that nothing is reinserted
        if case % 20 == 0:
            given, empty = kernel.routes(n, k), empty + 1
        now, trial, best, wanted = (kernel.routes(n, k) for _ in range(4))
        for target in (now, best, wanted):
            kernel.restore(fleet, given, target)
        record = np.array([math.inf, 0.0, 0.0])
        kernel.anneal(fleet, trial, now, best, record, np.uint64(case), 1, 1.0)
        state, sizes = np.array([case], dtype=np.uint64), wanted.sizes - 2
        if sizes.any():
            longest = min(10.0, sizes.sum() / (sizes > 0).sum())
            strings = int(1.0 + uniform(state) * (40.0 / (1.0 + longest)))
            seed = 1 + int(below(state, n - 2))
            if fleet.last_weight > 0.0 and uniform(state) < 0.5:
                r = int(np.argmax(wanted.ends))
                if sizes[r] > 0:
                    seed, last = int(wanted.stops[r, 1 + below(state, sizes[r])]), last + 1
            touched: list[int] = []
            for stop in (seed, *near[seed].tolist()):
                r = int(wanted.route[stop])
                if r not in (kernel.OUT, *touched) and len(touched) < strings:
                    touched.append(r)
                    length = int(1.0 + uniform(state) * min(float(sizes[r]), longest))
                    kernel.remove_string(fleet, wanted, r, stop, min(length, int(sizes[r])), state)
            numbers.add((len(touched) == strings, len(touched)))
        assert listed(now) == listed(wanted), case
    assert last > 0 and empty > 0 and {(True, 1), (True, 2), (True, 3), (False, 1)} <= numbers


def test_absent_stops_are_inserted_in_one_of_six_orders() -> None:
    """By time from the start or the other way round, by the end or the length of their windows, by price, or at random."""
    rng, seen = np.random.default_rng(9), set()
    fleet, _ = random_routes(rng, 9, 2)
    fleet = fleet._replace(price=rng.uniform(1.0, 9.0, 9))
    widths = fleet.closes - fleet.opens
    for seed in range(60):
        state, absent, keys = np.array([seed], dtype=np.uint64), np.zeros(9, dtype=np.int32), np.zeros(9)
        dice = state.copy()
        kind, routes = int(below(dice, 8)), kernel.routes(9, 2)
        for r in range(2):
            kernel.refresh(fleet, routes, r)
        kernel.recreate(fleet, routes, absent, keys, state)
        chance = np.array([uniform(dice) for _ in range(7)])
        wanted = [fleet.cost[0], -fleet.cost[0], fleet.closes, widths, *(None,) * 4][kind]
        wanted = chance if wanted is None else wanted[1:-1]
        wanted = -fleet.price[1:-1] * (0.5 + chance) if kind == 4 else wanted
        assert absent[:7].tolist() == (1 + np.argsort(wanted)).tolist() and keys[:7].tolist() == sorted(wanted)
        assert (routes.route[1:-1] != kernel.OUT).sum() == routes.sizes.sum() - 4 > 0
        seen.add(kind)
    assert seen == set(range(8))


@pytest.mark.parametrize("temperature", [0.0, 30.0])
def test_worse_routes_are_kept_as_often_as_the_temperature_says(temperature: float) -> None:
    """With the probability exp(-increase / temperature), and better ones always; the best routes are those of all."""
    rng, worse, kept, expected = np.random.default_rng(10), 0, 0, 0.0
    fleet, first = random_routes(rng, 10, 2)
    near = np.array([[j for j in np.argsort(fleet.time[i]) if j not in (0, i, 9)][:7] for i in range(10)], dtype=np.int32)
    fleet, (trial, now, best, given) = fleet._replace(near=near), (kernel.routes(10, 2) for _ in range(4))
    kernel.restore(fleet, first, given)
    start = np.array([math.inf, -math.inf, math.inf])
    kernel.anneal(fleet, trial, given, best, start, np.uint64(1), 100, 0.0)  # from where most changes are worse
    before, worth = start[:2].tolist()
    for seed in range(cases(300, 3_000)):
        for heat in (1e300, temperature):  # at first whatever is drawn is taken, but for late routes
            kernel.copy(given, now)
            kernel.copy(given, best)
            record = np.array([before, -math.inf if heat == 1e300 else worth, before])
            kernel.anneal(fleet, trial, now, best, record, np.uint64(seed), 1, heat)
            if heat == 1e300:
                made, (cost, found) = listed(now), record[:2].tolist()
        taken = listed(now) == made and record[kernel.COST] == cost
        assert taken or (listed(now) == listed(given) and record[kernel.COST] == before)
        better = taken and (found > worth or (found == worth and cost < before))
        assert record[1:].tolist() == ([found, cost] if better else [worth, before])
        assert listed(best) == (made if better else listed(given))
        assert taken or cost >= before
        if cost > before:
            chance = math.exp((before - cost) / temperature) if temperature else 0.0
            worse, kept, expected = worse + 1, kept + taken, expected + chance
    assert worse > 30 and abs(kept - expected) <= 4.0 * math.sqrt(expected)


def test_an_end_is_a_stop_or_the_start() -> None:
    with pytest.raises(BadParameter, match=r"an integer in \[0, 2\], start or None"):
        order_stops(np.ones((3, 3)), end="finish")


def test_all_other_stops_are_near_a_stop_also_where_few_arcs_exist() -> None:
    """A stop used to be near itself, in place of the last of the stops to which there is no path."""
    matrix = np.full((6, 6), math.inf)
    matrix[0], matrix[:, 0], matrix[1, 2], matrix[4, 1] = 1.0, 1.0, 1.0, 2.0
    stops = Stops(matrix, 0, None, None, None, None, math.inf, 2, "travel time")
    near = _fleet(stops, *layout(stops))[0].near
    assert [sorted(near[i]) for i in range(1, 6)] == [[j for j in range(1, 6) if j != i] for i in range(1, 6)]
    assert near[1].tolist() == [2, 4, 3, 5]


def test_too_many_stops() -> None:
    with pytest.raises(TooLarge) as caught:
        order_stops(np.zeros((5_001, 5_001)))
    assert isinstance(caught.value, BadInput)
