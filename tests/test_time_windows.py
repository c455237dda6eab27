"""C48: tours with time windows against all permutations and dynamic programming; the independent check; files."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import random
import sys
import threading
import time
from itertools import pairwise

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

import naive.time_windows as naive
from antway import BadInput, BadMap, BadParameter, InvalidPlan, TooLarge, check_tsptw, load_tsptw, solve_tsptw
from antway.cli import main
from antway.kernels.base import rng as random_kernel
from antway.kernels.colony import time_windows as beams
from antway.kernels.colony import window_colony as colonies
from antway.kernels.colony import windows as kernel
from antway.kernels.colony.window_repair import lateness, least_late_place, repair
from antway.kernels.colony.window_search import MoveOptions, refresh, settle, shake, timed_order, value
from antway.tours.ordering import order_stops
from antway.tours.time_windows import Tsptw, parse
from antway.tours.windowed import Path
from common import SHARED, cases, costly, needs_data
from mapfiles import spoil

TSPTW = SHARED / "tsptw"
SMALL = b"""4
0 2 3 9
2 0 4 8
3 4 0 7   # a comment
9 8 7 0
0 100
0 10
5 20
0 90
# Sum of service times: 0
"""


def task(rng: np.random.Generator, low: int, high: int, tight: float | None = None) -> Tsptw:
    """A random instance, mostly feasible: windows stand around a random order; whole, decimal or any numbers."""
    n = int(rng.integers(low, high + 1))
    xy = rng.random((n, 2)) * 40
    matrix = np.hypot(*(xy[:, None] - xy[None]).T)
    if rng.random() < 0.4:
        matrix = matrix * rng.uniform(0.7, 1.3, matrix.shape)  # asymmetric, and the triangle inequality need not hold
    kind = rng.integers(3)
    matrix = np.round(matrix) if kind == 0 else np.round(matrix, 4) if kind == 1 else matrix
    width = rng.choice([15.0, 40.0, 120.0]) if tight is None else tight
    windows, now, order = np.zeros((n, 2)), 0.0, [0, *(1 + rng.permutation(n - 1)).tolist()]
    for here, there in pairwise(order):
        now += matrix[here, there] + rng.random() * 5
        windows[there] = max(0.0, now - rng.random() * width), now + rng.random() * width
    windows[0] = 0.0, now + matrix[order[-1], 0] + 50 if rng.random() < 0.9 else now * 0.8
    return Tsptw(matrix, np.round(windows, 3) if kind < 2 else windows)


@pytest.mark.parametrize("makespan", [False, True])
def test_equal_to_all_permutations(makespan: bool) -> None:
    rng, feasible = np.random.default_rng(17 + makespan), 0
    for case in range(cases(60, 2_000)):
        instance = task(rng, 2, 8)
        best = naive.best(instance.matrix.tolist(), instance.windows.tolist(), makespan)
        result = solve_tsptw(instance, objective="makespan" if makespan else "travel time", cycles=40, seed=case)
        check_tsptw(
            instance, result.order, result.cost, objective="makespan" if makespan else "travel time", feasible=result.feasible
        )
        assert result.feasible == (best < math.inf), case
        if result.feasible:
            feasible += 1
            assert result.cost == pytest.approx(best, rel=1e-9), case
            assert result.bound <= best * (1 + 1e-9) and result.conflict == ()
            assert result.bound == result.cost or not result.proven
        else:
            assert result.lateness > 0.0
    assert feasible > case / 3


@pytest.mark.parametrize("makespan", [False, True])
def test_no_order_costs_less_than_the_bound_beside_long_arcs(makespan: bool) -> None:
    """Arcs of 1e9 s make the units of time coarse, to which steps are rounded up; the bound allows for it."""
    rng = np.random.default_rng(5)
    for _ in range(cases(40, 400)):
        matrix = rng.choice([0.0, 0.1, 0.1, 1e9], (6, 6))
        windows = np.tile([0.0, math.inf], (6, 1))
        result = solve_tsptw(Tsptw(matrix, windows), objective="makespan" if makespan else "travel time", cycles=0)
        assert result.bound <= naive.best(matrix.tolist(), windows.tolist(), makespan) * (1 + 1e-12)


def test_an_order_beside_long_arcs_is_proven_but_for_rounding() -> None:
    """Of orders whose costs differ by less than the units of time, one that is not the best used to be the bound."""
    rng = np.random.default_rng(1)
    for seed in range(cases(8, 80)):
        matrix = np.where(rng.random((5, 5)) < 0.3, 1e9, 1.0 + 1e-6 * rng.random((5, 5)))
        windows = np.tile([0.0, 3e9], (5, 1))
        best = naive.best(matrix.tolist(), windows.tolist(), False)
        result = solve_tsptw(Tsptw(matrix, windows), cycles=8, seed=seed)
        answer = order_stops(matrix, windows=windows, end="start", cycles=8, seed=seed)
        assert 0.999 * best < min(result.bound, answer.bound) and max(result.bound, answer.bound) <= best * (1 + 1e-12)
        assert result.proven == (best > 1e9)


def test_equal_to_dynamic_programming() -> None:
    rng = np.random.default_rng(5)
    for case in range(cases(8, 300)):
        instance = task(rng, *((13, 13) if case < 2 else (10, 12)), 30.0)
        makespan = bool(case % 2)
        best = naive.dynamic_programming(instance.matrix.tolist(), instance.windows.tolist(), makespan)
        result = solve_tsptw(instance, objective="makespan" if makespan else "travel time", cycles=64, seed=case)
        check_tsptw(
            instance, result.order, result.cost, objective="makespan" if makespan else "travel time", feasible=result.feasible
        )
        assert (result.cost if result.feasible else math.inf) == pytest.approx(best, rel=1e-9), case
        assert not result.proven or result.bound <= result.cost * (1 + 1e-9)


def test_the_end_comes_before_the_travel_time_where_an_order_is_proven() -> None:
    """Nodes open so late that an order may be back sooner whose travel time is more than a million times as much longer."""
    rng, proven = np.random.default_rng(4), 0
    for case in range(cases(60, 1_000)):
        n = int(rng.integers(3, 7))
        matrix = np.where(rng.random((n, n)) < 0.3, 1.4e6, rng.integers(1, 10, (n, n)))
        windows = np.c_[np.where(rng.random(n) < 0.4, 3e6 + rng.integers(0, 10, n), 0.0), np.full(n, 1e8)]
        result = solve_tsptw(Tsptw(matrix, windows), objective="makespan", cycles=20, seed=case)
        best = naive.best(matrix.tolist(), windows.tolist(), True)
        proven += result.proven
        assert result.cost == best or not result.proven, case
        assert result.history[-1, 1] == result.cost, case
    assert proven > case / 2
    matrix = [[0, 5, 1.4e6], [9, 0, 5], [5, 1.4e6, 0]]
    answer = order_stops(matrix, end="start", windows=[(0, 1e8), (3e6, 1e8), (0, 1e8)], objective="makespan", cycles=20)
    assert answer.orders[0].tolist() == [0, 2, 1, 0] and answer.bound <= answer.cost == 3_000_009.0


def test_a_target_of_the_makespan_is_met_by_the_end() -> None:
    """The best order is back a millionth after the first target, which is not met then: the search ends by its proof."""
    windows = [[0, 1e9], [0, 1e9], [0, 1e9], [1e6, 1e9]]
    slow = Tsptw([[0, 1, 1, 1], [1, 0, 1, 1], [1, 1, 0, 1], [3, 2, 1, 0]], windows)
    for target, met in (1_000_001.0, False), (1_000_002.0, True):
        result = solve_tsptw(slow, objective="makespan", cycles=50, target=target, initial=[0, 1, 2, 3])
        assert result.cost == 1_000_002.0 and result.proven != met


def test_tightening_excludes_no_feasible_order() -> None:
    """Windows, precedence and arcs hold for every feasible order, and a stuck task has none."""
    rng, seen = np.random.default_rng(3), 0
    for case in range(cases(60, 3_000)):
        instance = task(rng, 2, 6)
        n = instance.size
        again = np.append(np.arange(n), 0)
        path = Path(instance.matrix[np.ix_(again, again)], instance.windows[again, 0], instance.windows[again, 1])
        orders = list(naive.feasible_orders(instance.matrix.tolist(), instance.windows.tolist()))
        assert path.feasible or not orders, case
        if not path.feasible:
            conflict = path.conflict()
            assert len(set(conflict)) == len(conflict)
            continue
        for order in orders:
            seen += 1
            full, now = [*order[:-1], n], path.opens[0]
            for p, (i, j) in enumerate(pairwise(full)):
                assert path.windows.time[i, j] == path.time[i, j], case
                now = max(now + path.time[i, j], path.opens[j])
                assert now <= path.windows.closes[j], case
                must = {k for k in range(n + 1) if path.windows.before[j, k // 64] >> np.uint64(k % 64) & np.uint64(1)}
                assert must <= set(full[: p + 1]), case
    assert seen > 100


def test_tightening_finds_all_that_its_rules_find() -> None:
    rng, left, stuck, dropped = np.random.default_rng(14), 0, 0, 0
    for case in range(cases(60, 1_000)):
        instance = task(rng, 3, 6)
        again = np.append(np.arange(instance.size), 0)
        path = Path(instance.matrix[np.ix_(again, again)], instance.windows[again, 0], instance.windows[again, 1])
        time, opens, closes, n = path.time.copy(), path.opens.copy(), path.closes.copy(), instance.size + 1
        twin = naive.tightened(time.tolist(), path.far.tolist(), opens.tolist(), closes.tolist())
        first = np.zeros((n, n), dtype=np.bool_)
        assert (kernel.tighten(time, path.far, opens, closes, first) >= 0) == (twin is None), case
        stuck += twin is None
        if twin is not None:
            assert np.c_[opens, closes].tolist() == list(map(list, twin[0])), case
            assert set(map(tuple, np.argwhere(np.isfinite(time)))) == twin[1], case
            assert set(map(tuple, np.argwhere(first))) == twin[2], case
            left += len(twin[1])
            dropped += (n - 1) ** 2 - len(twin[1])
    assert stuck and min(left, dropped) > 3 * case


def test_tightening_ends_where_two_stops_are_reached_soonest_from_each_other() -> None:
    """Stops 1 and 2 lie side by side, and all ways to them from elsewhere begin late: each window shifts the other by 10 ms."""
    late, lane = 1e6, 3e6
    matrix = [
        [0, lane, lane, 10, 10],
        [10, 0, 0.01, 10, 10],
        [10, 0.01, 0, 10, 10],
        [10, 10, lane, 0, 10],
        [10, 10, lane, 10, 0],
    ]
    windows = [[0, math.inf], [0, 2 * late], [0, 2 * late], [late, 2 * late], [late, 2 * late]]
    solve_tsptw(Tsptw(np.ones((5, 5)), windows), cycles=5)  # compiles
    begun = time.process_time()
    result = solve_tsptw(Tsptw(matrix, windows), cycles=5)
    assert time.process_time() - begun < 5.0, "a hundred million rounds would take about 15 s"
    assert result.proven and result.order.tolist() == [0, 3, 1, 2, 4]


def test_conflicts_name_stops_that_no_order_visits() -> None:
    """Each conflict is real, and as small as can be: without one of its stops the others can be visited."""
    rng, sizes = np.random.default_rng(8), set()
    for _ in range(cases(300, 3_000)):
        n = 6
        xy = rng.random((n, 2)) * 30
        matrix = np.round(np.hypot(*(xy[:, None] - xy[None]).T))
        begin = rng.random(n) * 60
        windows = np.c_[begin, begin + rng.random(n) * 25].round()
        windows[0] = 0, 500
        result = solve_tsptw(Tsptw(matrix, windows), cycles=4)
        if result.conflict:
            assert not result.feasible and result.proven
            sizes.add(len(result.conflict))
            nodes = [0, *result.conflict]
            far = kernel.shortest(matrix)  # other stops may lie on the way

            def possible(chosen: list[int], far: np.ndarray = far, windows: np.ndarray = windows) -> bool:
                return naive.best(far[np.ix_(chosen, chosen)].tolist(), windows[chosen].tolist(), False) < math.inf

            assert not possible(nodes)
            assert all(possible([0, *set(result.conflict) - {stop}]) for stop in result.conflict)
    assert sizes == {1, 2, 3}


def test_duals_of_the_assignment() -> None:
    rng = np.random.default_rng(2)
    for _ in range(cases(50)):
        n = int(rng.integers(1, 12))
        cost = rng.integers(0, 50, (n, n)).astype(float)
        rows, columns = kernel.assignment(cost)
        assert (rows[:, None] + columns <= cost + 1e-9).all()
        assert rows.sum() + columns.sum() == pytest.approx(cost[linear_sum_assignment(cost)].sum())


@pytest.mark.parametrize("makespan", [False, True])
@pytest.mark.parametrize("width", [1, 8, 300])
def test_a_beam_that_drops_nothing_finds_the_best_order(width: int, makespan: bool) -> None:
    """What a narrow beam finds may be worse, as it says."""
    rng, whole, dropped = np.random.default_rng(width), 0, 0
    for case in range(cases(30, 300)):
        instance = task(rng, 5, 7, float(rng.choice([40.0, 120.0])))
        n = instance.size
        again = np.append(np.arange(n), 0)
        path = Path(instance.matrix[np.ix_(again, again)], instance.windows[again, 0], instance.windows[again, 1])
        if not path.feasible:
            continue
        limit = math.inf if case % 2 else 1.0 + naive.best(instance.matrix.tolist(), instance.windows.tolist(), makespan)
        choice = beams.Choice(1.0, 0.0, 0.0, makespan, limit * path.scale)
        order, none, memory = np.zeros(n + 1, dtype=np.int32), np.zeros((n + 1, n + 1)), beams.workspace(n + 1, width)
        cost, all_kept = beams.search(path.windows, none, choice, width, np.uint64(1), memory, order)
        best = naive.best(path.time[:n, [n, *range(1, n)]].tolist(), np.c_[path.opens, path.closes][:n].tolist(), makespan)
        whole, dropped = whole + all_kept, dropped + (not all_kept)
        assert cost == pytest.approx(best) if all_kept else cost >= best - 1e-6 * path.scale, case
        if cost < math.inf:
            windows = np.c_[path.opens, path.closes].tolist()
            travelled, end, late = naive.drive(path.time.tolist(), windows, order.tolist())
            assert sorted(order) == list(range(n + 1)) and late == 0.0
            assert cost == pytest.approx(end if makespan else travelled)
    assert whole if width > 1 else dropped


def test_of_candidates_with_the_same_stops_those_that_are_neither_sooner_nor_shorter_are_dropped() -> None:
    """Others stay, however late or long they are; then those of least keys are kept, in their order."""
    rng = np.random.default_rng(7)
    for _ in range(cases(30, 300)):
        width, count = int(rng.integers(1, 9)), 0
        beam = beams.workspace(2, width)
        given = rng.integers(0, (2, 12, 3, 3), (6 * width, 4)).tolist()  # mark, last stop, time, cost
        for one in given:
            beam.c_mark[count], beam.c_stop[count], beam.c_ready[count], beam.c_cost[count] = one
            beam.c_key[count] = rng.integers(5)
            count += beams.enter(beam, count)
        wanted = {
            (mark, stop, ready, cost)
            for mark, stop, ready, cost in given
            if not any(
                one[:2] == [mark, stop] and one[2] <= ready and one[3] <= cost and one[2:] != [ready, cost] for one in given
            )
        }
        found = np.c_[beam.c_mark, beam.c_stop, beam.c_ready, beam.c_cost][:count].tolist()
        left = [c for c in range(count) if beam.c_key[c] < math.inf]
        assert sorted(map(tuple, (found[c] for c in left))) == sorted(wanted)
        most = int(rng.integers(1, len(left) + 2))
        kept = [found[c] for c in sorted(sorted(left, key=lambda c: beam.c_key[c])[:most])]
        assert beams.keep(beam, count, most) == (len(kept), len(left) > most)
        assert np.c_[beam.c_mark, beam.c_stop, beam.c_ready, beam.c_cost][: len(kept)].tolist() == kept
        assert (beam.table == -1).all()


def test_the_best_orders_so_far_and_since_the_restart_are_kept() -> None:
    rng, orders = np.random.default_rng(11), np.zeros((3, 1), dtype=np.int32)
    record = np.array([math.inf, math.inf, 0.0, 0.0])
    colony = colonies.WindowColony(np.zeros((1, 1)), np.zeros((1, 1)), orders, record)
    costs, since = rng.permutation(40).astype(float), 0
    for number, cost in enumerate(costs):
        if number % 7 == 0:
            record[colonies.RESTART_BEST], since = math.inf, number
        colonies.note(colony, np.array([number], dtype=np.int32), cost)
        best, lately = costs[: number + 1].argmin(), since + costs[since : number + 1].argmin()
        assert record.tolist() == [costs[best], costs[lately], 0.0, 0.0] and orders[:, 0].tolist() == [best, lately, 0]


def test_an_order_that_random_moves_make_worse_is_left_again() -> None:
    """At temperature 0 none is taken; times are then those of the order before, and the best order is that of the cycle."""
    rng = np.random.default_rng(12)
    path = Path(rng.uniform(1.0, 9.0, (12, 12)), np.zeros(12), np.full(12, math.inf))
    t, fresh = timed_order(12), timed_order(12)
    for seed in range(20):
        record, state = np.array([math.inf, math.inf, 0.0, 0.0]), np.array([seed], dtype=np.uint64)
        colony = colonies.WindowColony(np.zeros((12, 12)), np.zeros((12, 12)), np.zeros((3, 12), dtype=np.int32), record)
        options = colonies.ColonyOptions(0, seed % 4, 0.1, 0.0, path.step, 0.0, MoveOptions(False, 8, 1e-9))
        t.order[:] = fresh.order[:] = [0, *(1 + rng.permutation(10)), 11]
        refresh(path.windows, t)
        refresh(path.windows, fresh)
        fresh.look[:] = True
        settle(path.windows, fresh, options.moves)
        colonies.improve(path.windows, colony, options, t, state)
        assert value(t, False) < value(fresh, False) or t.order.tolist() == fresh.order.tolist()
        fresh.order[:] = t.order
        refresh(path.windows, fresh)
        assert [row.tolist() for row in t[1:5]] == [row.tolist() for row in fresh[1:5]]
        best = colony.orders[colonies.OF_CYCLE]
        assert record[:2].tolist() == [value(t, False)] * 2 and (best == t.order).all() and (colony.orders == best).all()


def test_pheromone_moves_towards_the_best_orders() -> None:
    rng, restarts = np.random.default_rng(9), 0
    for _ in range(cases(100, 1_000)):
        n, evaporation = int(rng.integers(3, 7)), float(rng.uniform(0.05, 0.9))
        orders = np.array([[0, *(1 + rng.permutation(n - 2)), n - 1] for _ in range(3)], dtype=np.int32)
        tau = rng.random((n, n)) ** 8 if rng.random() < 0.5 else 1.0 - rng.random((n, n)) ** 8
        record = np.array([1.0, 1.0, 0.0, rng.choice([0.0, 0.39, 0.4, 0.59, 0.6, 0.79, 0.8, 0.95])])
        so_far, since_restart, of_cycle = orders.tolist()
        wanted, convergence = naive.learned(tau.tolist(), (of_cycle, since_restart, so_far), record[3], evaporation)
        colonies.learn(colonies.WindowColony(tau, np.zeros((n, n)), orders, record), evaporation)
        assert tau == pytest.approx(np.array(wanted), rel=1e-12) and record[3] == pytest.approx(convergence)
        assert record.tolist()[:3] == [1.0, math.inf if convergence == 0.0 else 1.0, 0.0]
        restarts += convergence == 0.0
    assert restarts > 3


@pytest.mark.parametrize("backward", [False, True])
def test_ants_follow_the_pheromone_in_both_directions(backward: bool) -> None:
    """Nearly all of it is on one order, and times hardly count; a beam of one ant takes this order nearly always."""
    rng, found = np.random.default_rng(10), 0
    for seed in range(cases(60, 600)):
        path = Path(rng.uniform(1.0, 9.0, (8, 8)), np.zeros(8), np.full(8, math.inf))
        wanted = np.array([0, *(1 + rng.permutation(6)), 7], dtype=np.int32)
        tau = np.full((8, 8), colonies.TAU_MIN)
        tau[wanted[:-1], wanted[1:]] = colonies.TAU_MAX
        record = np.array([math.inf, math.inf, float(backward), 0.0])
        colony = colonies.WindowColony(tau, np.zeros((8, 8)), np.zeros((3, 8), dtype=np.int32), record)
        options = colonies.ColonyOptions(1, 0, 0.1, 0.0, 1e9 * path.step, 0.0, MoveOptions(False, 8, 1e-9))
        state = np.array([random_kernel.stream(np.uint64(seed), np.uint64(0))], dtype=np.uint64)
        cost = colonies.build(path.windows, path.mirror, colony, options, beams.workspace(8, 1), state)
        order = colony.orders[colonies.OF_CYCLE]
        assert sorted(order) == list(range(8)) and cost == pytest.approx(path.time[order[:-1], order[1:]].sum())
        found += order.tolist() == wanted.tolist()
    assert found > 0.8 * (seed + 1)


@pytest.mark.parametrize("makespan", [False, True])
def test_local_search_against_driving(makespan: bool) -> None:
    """Moves keep a feasible order feasible, its times right, and settling leaves no better exchange of neighbouring parts."""
    rng, settled = np.random.default_rng(4), 0
    for case in range(costly(40, 1_000)):
        instance = task(rng, 5, 9, 60.0)
        n = instance.size
        again = np.append(np.arange(n), 0)
        path = Path(instance.matrix[np.ix_(again, again)], instance.windows[again, 0], instance.windows[again, 1])
        order = next(naive.feasible_orders(instance.matrix.tolist(), instance.windows.tolist()), None)
        if order is None or not path.feasible:
            continue
        longest = n if case % 2 else 2
        t, moves = timed_order(n + 1), MoveOptions(makespan, longest, 1e-9 * path.step)
        state = np.array([random_kernel.stream(np.uint64(case), np.uint64(0))], dtype=np.uint64)
        t.order[:] = [*order[:-1], n]
        refresh(path.windows, t)
        for _ in range(20):
            shake(path.windows, t, moves, path.step, state)
            assert sorted(t.order.tolist()) == list(range(n + 1)) and t.order[0] == 0 and t.order[n] == n
            travelled, end, late = naive.drive(path.time.tolist(), np.c_[path.opens, path.closes].tolist(), t.order.tolist())
            assert late == 0.0
            assert value(t, False) == pytest.approx(travelled)
            assert value(t, True) == pytest.approx(end + 1e-6 * travelled)
        before = value(t, makespan)
        while True:  # stops that a move has not touched are not looked at again, though windows may now allow more
            t.look[:] = True
            last = value(t, makespan)
            settle(path.windows, t, moves)
            if value(t, makespan) == last:
                break
        here = t.order.tolist()
        assert last <= before
        windows = np.c_[path.opens, path.closes].tolist()

        def worth(order: list[int], path: Path = path, windows: list[list[float]] = windows) -> float:
            travelled, end, late = naive.drive(path.time.tolist(), windows, order)
            return math.inf if late > 0.0 else end + 1e-6 * travelled if makespan else travelled

        settled += 1
        for i in range(1, n):
            for k in range(i + 1, n):
                others = [here[:i] + here[i : k + 1][::-1] + here[k + 1 :]]
                for j in range(i, k):
                    one, two = here[i : j + 1], here[j + 1 : k + 1]
                    swapped = [(two, one)] if min(len(one), len(two)) <= longest else []
                    swapped += [(two, one[::-1])] if len(one) <= longest else []
                    swapped += [(two[::-1], one)] if len(two) <= longest else []
                    others += [here[:i] + first + second + here[k + 1 :] for first, second in swapped]
                assert min(map(worth, others)) >= worth(here) - 1e-6 * path.step - 1e-6, case
    assert settled > 10


@pytest.mark.parametrize("makespan", [False, True])
def test_local_search_makes_the_best_move_at_a_place(makespan: bool) -> None:
    """Of swaps of a short part that begins or ends there, also reversed, and of reversals of a part that begins there."""
    rng, made, here, last = np.random.default_rng(16), 0, list(range(10)), 9
    for case in range(cases(24, 300)):
        away, longest = rng.uniform(1.0, 9.0, (10, 10)), 1 + case % 3
        now, width = np.append(0.0, np.cumsum(away[here[:-1], here[1:]])), rng.choice([15.0, 40.0, 400.0])
        opens, closes = np.maximum(now - width * rng.random(10), 0.0), now + width * rng.random(10)
        if case % 4 == 0:  # the robot waits, or goes a longer way
            opens[rng.integers(1, last)], closes = now[last], closes + 2.0 * now[last]
        path = Path(away, opens, closes)
        windows, t, moves = np.c_[path.opens, path.closes].tolist(), timed_order(10), MoveOptions(makespan, longest, 0.0)

        def worth(order: list[int], path: Path = path, windows: list[list[float]] = windows) -> float:
            travelled, end, late = naive.drive(path.time.tolist(), windows, order)
            return math.inf if late > 0.0 else end + 1e-6 * travelled if makespan else travelled

        for i in range(1, last):
            trials = [here[:i] + here[i : j + 1][::-1] + here[j + 1 :] for j in range(i + 1, last)]
            for h, j, k in itertools.combinations(range(last), 3):
                one, two = here[h + 1 : j + 1], here[j + 1 : k + 1]
                parts = [(two, one), (two, one[::-1])] if h + 1 == i and len(one) <= longest else []
                if k == i and len(two) <= longest:
                    parts += [(two[::-1], one)] if len(two) > 1 else []
                    parts += [(two, one)] if len(one) > len(two) else []
                trials += [here[: h + 1] + first + second + here[k + 1 :] for first, second in parts]
            t.order[:], t.look[:], t.look[i] = here, False, True
            refresh(path.windows, t)
            settle(path.windows, t, moves, i, 1)
            assert value(t, makespan) == pytest.approx(min(map(worth, [here, *trials])), rel=1e-12), (case, i)
            made += t.order.tolist() != here
    assert made > 2 * case


def test_repair_finds_orders_in_time() -> None:
    rng, found = np.random.default_rng(6), 0
    for case in range(cases(30, 500)):
        instance = task(rng, 5, 8, 15.0)
        n = instance.size
        again = np.append(np.arange(n), 0)
        path = Path(instance.matrix[np.ix_(again, again)], instance.windows[again, 0], instance.windows[again, 1])
        order = np.arange(n + 1, dtype=np.int32)
        late = repair(path.finite, path.opens, path.closes, order, 200, np.uint64(case))
        assert sorted(order.tolist()) == list(range(n + 1)) and order[0] == 0 and order[n] == n
        assert late == lateness(path.finite, path.opens, path.closes, order, math.inf)
        twin = naive.drive(path.finite.tolist(), np.c_[path.opens, path.closes].tolist(), order.tolist())[2]
        assert late == pytest.approx(twin)
        best = naive.best(instance.matrix.tolist(), instance.windows.tolist(), False)
        found += (late == 0.0) == (best < math.inf)
    assert found > 0.9 * case


def test_a_descent_ends_where_no_single_stop_is_better_elsewhere() -> None:
    rng, late = np.random.default_rng(15), 0
    for seed in range(cases(30, 500)):
        n = int(rng.integers(4, 8))
        away, opens = rng.integers(1, 9, (n, n)).astype(float), rng.integers(0, 20, n).astype(float)
        closes, order = opens + rng.integers(0, 9, n), np.array([0, *(1 + rng.permutation(n - 2)), n - 1], dtype=np.int32)
        least = repair(away, opens, closes, order, 0, np.uint64(seed))
        late += least > 0.0
        for p, q in itertools.permutations(range(1, n - 1), 2):
            trial = np.insert(np.delete(order, p), q, order[p])
            assert lateness(away, opens, closes, trial, math.inf) >= least, seed
    assert late > 0.8 * (seed + 1)


def test_a_stop_is_inserted_where_the_order_is_least_late_then_shortest() -> None:
    rng = np.random.default_rng(3)
    for case in range(60):
        n = int(rng.integers(3, 9))
        away, opens = np.round(rng.uniform(1.0, 9.0, (n, n))), np.round(rng.uniform(0.0, 9.0, n))
        closes = opens + rng.integers(0, 40, n)
        order = np.array([0, *(1 + rng.permutation(n - 3)), n - 1], dtype=np.int32)
        windows = np.c_[opens, closes].tolist()
        trials = [np.insert(order, p, n - 2).tolist() for p in range(1, n - 1)]
        costs = [naive.drive(away.tolist(), windows, trial) for trial in trials]
        best = min(range(len(trials)), key=lambda k: (costs[k][2], costs[k][0]))
        assert least_late_place(away, opens, closes, order, n - 2) == best + 1, case


def test_local_search_in_slices_is_the_same() -> None:
    rng = np.random.default_rng(8)
    path = Path(rng.uniform(1.0, 9.0, (30, 30)), np.zeros(30), np.full(30, math.inf))
    whole, sliced, moves = timed_order(30), timed_order(30), MoveOptions(False, 8, 1e-9)
    for t in (whole, sliced):
        t.order[:] = np.arange(30)
        refresh(path.windows, t)
    assert settle(path.windows, whole, moves) == 0
    place, slices = 1, 0
    while place := settle(path.windows, sliced, moves, place, 3):
        slices += 1
    assert slices > 9 and sliced.order.tolist() == whole.order.tolist() != list(range(30))


def test_same_seed_same_bytes() -> None:
    instance = task(np.random.default_rng(1), 40, 40, 120.0)
    first, again = (solve_tsptw(instance, cycles=12, seed=7) for _ in range(2))
    assert first.order.tobytes() == again.order.tobytes() and first.cost == again.cost
    assert [row[:2] for row in first.history.tolist()] == [row[:2] for row in again.history.tolist()]


def test_stops_when_told() -> None:
    instance = task(np.random.default_rng(2), 60, 60, 400.0)
    stop = threading.Event()
    stop.set()
    assert solve_tsptw(instance, cancel=stop).cycles <= 1
    assert solve_tsptw(instance, seconds=0.0).cycles <= 1
    reached = solve_tsptw(instance, cycles=20)
    assert solve_tsptw(instance, cycles=10_000, target=reached.cost).cost <= reached.cost * (1 + 1e-9)
    warm = solve_tsptw(instance, cycles=0, initial=reached.order)
    assert warm.feasible and warm.cost <= reached.cost * (1 + 1e-12)


def test_check_refuses_broken_orders() -> None:
    instance = parse(SMALL)
    check_tsptw(instance, [0, 1, 2, 3], 22.0)
    check_tsptw(instance, [0, 1, 2, 3], 22.0, objective="makespan")
    check_tsptw(instance, [0, 3, 2, 1], 22.0, feasible=False)
    for order, cost in (
        ([0, 3, 2, 1], 22.0),
        ([0, 1, 2], None),
        ([0, 1, 2, 2], None),
        ([1, 0, 2, 3], None),
        ([0, 1, 2, 3], 21.0),
    ):
        with pytest.raises(InvalidPlan):
            check_tsptw(instance, order, cost)
    tenths = Tsptw([[0, 0.1, 1], [1, 0, 0.2], [1, 1, 0]], [[0, 9], [0, 9], [0, 0.3]])  # 0.1 + 0.2 > 0.3 in floats alone
    check_tsptw(tenths, [0, 1, 2], 1.3)
    assert solve_tsptw(tenths, cycles=5).order.tolist() == [0, 1, 2]


@pytest.mark.parametrize("makespan", [False, True])
def test_check_says_what_driving_says(makespan: bool) -> None:
    """Of any order, whether it is in time and what it costs, waiting included, but for 1e-11 and 1e-9 of the sums."""
    rng, told = np.random.default_rng(13), set()
    for _ in range(cases(200, 2_000)):
        n, scale = int(rng.integers(1, 5)), float(rng.choice([1.0, 1e6]))
        matrix = rng.integers(1, 9, (n, n)) * scale
        begin = rng.integers(0, 20, n) * scale
        windows = np.c_[begin, np.where(rng.random(n) < 0.2, math.inf, begin + rng.integers(0, 40, n) * scale)]
        order = [0, *(1 + rng.permutation(n - 1)).tolist()]
        travelled, end, late = naive.drive(matrix.tolist(), windows.tolist(), [*order, 0] if n > 1 else [0])
        cost = end if makespan else travelled
        windows[:, 1] = np.maximum(windows[:, 1] - rng.choice([0.0, 9e-12]) * scale, begin)  # rounding explains that
        for off, feasible in (0.0, True), (0.0, False), (0.9e-9 * cost, True), (3e-9 * (1 + cost), True):
            right = off < 1e-9 * (1 + cost) and not (feasible and late > 0.0)
            told.add((right, late > 0.0, feasible))
            with contextlib.nullcontext() if right else pytest.raises(InvalidPlan):
                objective = "makespan" if makespan else "travel time"
                check_tsptw(Tsptw(matrix, windows), order, cost + off, objective=objective, feasible=feasible)
    assert len(told) == 5


def test_windows_that_end_at_the_arrival_are_kept() -> None:
    """Also with numbers that are not decimal; what is late by no more than sums of floats are rounded is in time."""
    third, late = 1 / 3, 2 / 3 - 1e-10
    for closes in (third, 2 / 3), (9.0, math.nextafter(2 / 3, 0.0)), (9.0, late):
        edge = Tsptw([[0, third, 9], [9, 0, third], [third, 9, 0]], [[0, 9], [0, closes[0]], [0, closes[1]]])
        result = solve_tsptw(edge, cycles=5)
        check_tsptw(edge, result.order, result.cost, feasible=result.feasible)
        assert result.order.tolist() == [0, 1, 2] and result.conflict == (() if result.feasible else (2,))
        assert result.feasible == (result.lateness == 0.0) == (closes[1] != late) and result.proven


def test_reads_the_format() -> None:
    instance = parse(SMALL)
    assert instance.size == 4 and instance.matrix[3, 0] == 9.0 and instance.windows.tolist()[2] == [5.0, 20.0]
    result = solve_tsptw(instance, cycles=10)
    assert (result.order.tolist(), result.cost, result.feasible) == ([0, 1, 3, 2], 20.0, True)


@pytest.mark.parametrize(
    ("text", "field"),
    [
        (b"", "n"),
        (b"x", "n"),
        (b"0", "n"),
        (b"2 0 1 1 0 0 9 0", "numbers"),
        (b"2 0 1 1 0 0 9 0 9 9", "numbers"),
        (b"2 0 1 one 0 0 9 0 9", "numbers"),
        (b"2 0 nan 1 0 0 9 0 9", "numbers"),
        (b"2 0 -1 1 0 0 9 0 9", "matrix[0, 1]"),
        (b"2 0 1 1 0 0 9 5 4", "windows[1]"),
        (b"\xff\xfe", "file"),
    ],
)
def test_refuses_wrong_files(text: bytes, field: str) -> None:
    with pytest.raises(BadMap) as caught:
        parse(text, "a.txt")
    assert caught.value.field == field and caught.value.where == "a.txt"


def test_spoilt_files_raise_typed_errors() -> None:
    source = random.Random(3)
    for _ in range(cases(300, 100_000)):
        with contextlib.suppress(BadInput):
            assert parse(spoil(SMALL, [b"3 0 1 1"], source)).size <= 1_000


def test_refuses_wrong_arguments() -> None:
    with pytest.raises(TooLarge):
        parse(b"1001 ")
    for wrong in (
        {"matrix": [[0, 1]], "windows": [[0, 1]]},
        {"matrix": np.zeros((0, 0)), "windows": np.zeros((0, 2))},
        {"matrix": [[0, math.nan], [1, 0]], "windows": [[0, 1], [0, 1]]},
        {"matrix": [[0, math.inf], [1, 0]], "windows": [[0, 1], [0, 1]]},
        {"matrix": [[0, 1], [1, 0]], "windows": [[0, 1]]},
        {"matrix": [[0, 1], [1, 0]], "windows": [[0, 1], [0, math.nan]]},
    ):
        with pytest.raises(BadParameter):
            Tsptw(**wrong)
    instance = parse(SMALL)
    for wrong in (
        {"objective": "length"},
        {"seconds": -1.0},
        {"cycles": -1},
        {"seed": -1},
        {"target": math.nan},
        {"initial": [1, 0, 2, 3]},
        {"initial": [0, 1, 1, 3]},
    ):
        with pytest.raises(BadParameter):
            solve_tsptw(instance, **wrong)
    with pytest.raises(BadParameter):
        solve_tsptw("a file")


def test_one_node_and_two() -> None:
    assert solve_tsptw(Tsptw([[0]], [[0, 5]]), cycles=1).cost == 0.0
    for own in (0.0, 1e12, math.inf, math.nan):  # the diagonal is ignored
        result = solve_tsptw(Tsptw([[own, 3], [4, own]], [[1, 9], [0, 4]]), cycles=1)
        assert (result.cost, result.feasible, result.proven) == (7.0, True, True)


@pytest.mark.parametrize("addresses", [1, 2, 3])
def test_several_stops_at_one_address(addresses: int) -> None:
    """No time passes between them; a typical step of 0 made ants write beyond their memory."""
    place = np.arange(8) % addresses
    matrix = 7.0 * np.abs(place[:, None] - place[None])
    for closes in (math.inf, 480.0, 7.0 * addresses):
        instance = Tsptw(matrix, np.tile([0.0, closes], (8, 1)))
        best = naive.best(instance.matrix.tolist(), instance.windows.tolist(), False)
        for seed in range(5):
            result = solve_tsptw(instance, cycles=8, seed=seed)
            check_tsptw(instance, result.order, result.cost, feasible=result.feasible)
            assert (result.cost if result.feasible else math.inf) == best


def test_command(tmp_path, monkeypatch, capsys) -> None:
    file = tmp_path / "a.txt"

    def run(*options: str) -> tuple[int, str]:
        monkeypatch.setattr(sys, "argv", ["antway", "tsptw", str(file), "--seconds", "0.2", *options])
        with pytest.raises(SystemExit) as end:
            main()
        return int(end.value.code or 0), capsys.readouterr().out

    file.write_bytes(SMALL)
    status, text = run("--json")
    answer = json.loads(text)
    assert status == 0 and answer["order"] == [0, 1, 3, 2] and answer["proven"]
    file.write_bytes(SMALL.replace(b"0 90", b"0 5"))
    status, text = run()
    assert status == 3 and "cannot all be visited in time: 3" in text and "costs less" not in text
    assert run("--seconds", "inf")[0] == 2
    file.write_bytes(SMALL.replace(b"0 90", b"0"))
    assert run()[0] == 2


def test_sums_of_square_roots_that_end_with_a_window_are_in_time() -> None:
    """Windows close at arrivals along one order, as floats add them up; by 1e-16 s another order would be late, or this one."""
    for seed in range(cases(60, 400)):
        rng = np.random.default_rng(seed)
        places = rng.integers(0, 4, (5, 2))
        matrix = np.hypot(*(places[:, None] - places).transpose(2, 0, 1))
        windows, now = np.tile([0.0, math.inf], (5, 1)), 0.0
        for here, there in pairwise([0, *rng.permutation([1, 2, 3, 4])]):
            now += matrix[here, there]
            if rng.random() < 0.6:
                windows[there, 1] = now
        instance = Tsptw(matrix, windows)
        result = solve_tsptw(instance, cycles=50)
        assert result.feasible and result.proven and result.lateness == 0.0, seed
        check_tsptw(instance, result.order, result.cost)


@needs_data
def test_benchmark_instances() -> None:
    """A few instances of each set at their best known values, all files readable."""
    for folder in ("AFG", "Dumas", "SolomonPesant", "SolomonPotvinBengio"):
        known = {
            words[0]: float(words[1])
            for line in (TSPTW / "best_known_sol" / f"{folder}.txt").read_text().splitlines()
            if (words := line.split()) and words[0] != "#"
        }
        files = sorted((TSPTW / folder).iterdir())
        for place, file in enumerate(files):
            instance = load_tsptw(file)
            if place % (len(files) // 4) or file.name not in known:
                continue
            result = solve_tsptw(instance, cycles=200, seed=1, target=known[file.name] + 0.01)
            check_tsptw(instance, result.order, result.cost, feasible=result.feasible)
            assert result.feasible and result.cost <= known[file.name] * 1.01, file.name
