"""Distances, walks and local search against naive twins; local search never makes a tour worse."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway.ants.colony import Colony
from antway.ants.rules import AntColonySystem
from antway.ants.tsp import Tsp, solve_tsp
from antway.kernels.colony import local_search as search
from antway.kernels.colony import tour as kernel
from antway.kernels.colony import tsp
from common import cases
from naive import ants, tour

METRICS = ["EUCLID", "EUC_2D", "CEIL_2D", "ATT"]


def random_places(dice, n):
    """Places in general position, on a lattice with many ties, or some in one place."""
    kind = dice.integers(3)
    xy = dice.random((n, 2)) * 1000 if kind == 0 else dice.integers(0, 12, (n, 2)).astype(float) * 10
    if kind == 2:
        xy[dice.integers(0, n, n // 3)] = xy[0]
    return xy


@pytest.mark.parametrize("metric", METRICS)
def test_distances_and_candidates(metric):
    """Lengths are those of TSPLIB's definitions, and candidates are k other cities at the k least distances."""
    dice = np.random.default_rng(5)
    for _ in range(cases(20, 200)):
        n = int(dice.integers(4, 40))
        xy = random_places(dice, n)
        matrix = tour.table(metric, xy.tolist())
        instance = Tsp(xy, metric=metric)
        order = dice.permutation(n)
        assert instance.length(order) == pytest.approx(tour.length(matrix, order), rel=1e-12)
        k = int(dice.integers(1, n))
        cities = instance.cities(k)
        for i in range(n):
            assert i not in cities.near[i] and len(set(cities.near[i])) == k
            wanted = sorted(matrix[i][j] for j in range(n) if j != i)[:k]
            assert np.allclose(cities.gap[i], wanted, rtol=1e-12)
            for c, j in enumerate(cities.near[i]):
                assert cities.gap[i, c] == pytest.approx(matrix[i][j])
                back = cities.back[i, c]
                assert (cities.near[j, back] == i) if back >= 0 else (i not in cities.near[j])


@pytest.mark.parametrize("metric", ["EUCLID", "GEO"])
def test_candidates_lie_on_every_side(metric):
    """Candidates by quadrant against their twin; on a globe east and north are those of the map as seen from the city."""
    dice = np.random.default_rng(9)
    for _ in range(cases(5, 50)):
        n, k = int(dice.integers(40, 260)), 10
        xy = dice.normal(dice.uniform(-50, 50, (4, 2))[dice.integers(0, 4, n)], 6.0)  # clusters
        if metric == "GEO":  # where longitudes jump by 360 degrees
            xy[:, 1] = (xy[:, 1] + 330.0) % 360.0 - 180.0
        instance = Tsp(xy, metric=metric)
        near = instance.cities(k, by_quadrant=True).near
        for i in range(n):
            others = [j for j in range(n) if j != i]
            if metric == "GEO":
                degrees = np.trunc(xy) + (xy - np.trunc(xy)) / 0.6
                gaps = [instance.table[i, j] for j in others]
                turn = (degrees[others, 1] - degrees[i, 1] + 180.0) % 360.0 - 180.0
                offsets = list(zip(turn, degrees[others, 0] - degrees[i, 0], strict=True))
            else:
                offsets = (xy[others] - xy[i]).tolist()
                gaps = [np.hypot(*offset) for offset in offsets]
            wanted = tour.candidates_by_quadrant(gaps, offsets, k)
            assert set(near[i].tolist()) == {others[j] for j in wanted}


def test_computed_and_tabled_distances_agree():
    """Below and above the size up to which distances are tabled, tours have the same length."""
    xy = np.random.default_rng(6).random((1200, 2)) * 1e4
    cities = Tsp(xy, metric="EUC_2D").cities(5)
    assert cities.metric.matrix.size == 0
    order = np.arange(1200, dtype=np.uint32)
    table = kernel.gaps(cities.metric, np.tile(order, (1200, 1)))
    tabled = cities._replace(metric=kernel.Metric(kernel.MATRIX, cities.metric.xy, table))
    assert kernel.length(cities.metric, order) == kernel.length(tabled.metric, order)


@pytest.mark.parametrize("rule", ["mmas", AntColonySystem(q0=0.5, xi=0.0), AntColonySystem(q0=0.5, xi=1e-300)], ids=str)
def test_walk_like_the_twin(rule):
    """An ant's tour is the naive roulette's, draw by draw, also where candidates run out; the local update here is tiny."""
    dice = np.random.default_rng(8)
    for case in range(cases(30, 300)):
        n = int(dice.integers(5, 30))
        instance = Tsp(random_places(dice, n) + dice.random((n, 2)))
        colony = Colony(instance, rule, ants=3, candidates=int(dice.integers(1, n)), seed=case)
        state = colony.state
        state.tau[:] = dice.random(state.tau.shape) + 0.01
        state.record[tsp.CYCLE] = case % 3
        tours = colony.ask()
        matrix = tour.table("EUCLID", instance.xy.tolist())
        for ant in range(3):
            how = colony.numbers.q0, colony.numbers.xi == 0.0
            number = case % 3 * 3 + ant
            assert tours[ant].tolist() == ants.walk(matrix, colony.candidates, state.weight, case, number, *how)
            assert state.lengths[ant] == pytest.approx(tour.length(matrix, tours[ant]), rel=1e-12)


def test_of_equally_near_cities_the_least_number_is_next():
    """On a lattice with many ties; of cities in the same place it is the next one in their order."""
    dice = np.random.default_rng(4)
    for _ in range(cases(20, 200)):
        n = int(dice.integers(4, 30))
        xy = dice.integers(0, 4, (n, 2)).astype(float)
        cities, left = Tsp(xy).cities(1), (dice.random(n) < 0.6).astype(np.float32)
        for i in np.flatnonzero(left == 0.0):
            others = [j % n for j in range(i + 1, i + n) if left[j % n] > 0.0]
            away = {j: float(np.hypot(*(xy[i] - xy[j]))) for j in others}
            if others:
                j, least = tsp.nearest_left(cities, left, np.uint32(i))
                wanted = min(others, key=lambda j: (away[j], j if away[j] else others.index(j)))
                assert (j, least) == (wanted, away[wanted])


@pytest.mark.parametrize("breadth", [0, 5])
@pytest.mark.parametrize("longest", [0, 3, 1000])
def test_local_search_never_worse(breadth, longest):
    """From random tours: a permutation, shorter by exactly the gain that is claimed, never longer."""
    dice = np.random.default_rng(9)
    for _ in range(cases(40, 400)):
        n = int(dice.integers(5, 80))
        cities = Tsp(random_places(dice, n), metric=METRICS[dice.integers(4)]).cities(int(dice.integers(1, 12)))
        order = dice.permutation(n).astype(np.uint32)
        before = kernel.length(cities.metric, order)
        gain = search.improve(cities, search.workspace(n, 0), order, min(breadth, cities.near.shape[1]), longest)
        assert sorted(order) == list(range(n))
        assert gain >= 0.0
        assert kernel.length(cities.metric, order) == pytest.approx(before - gain, abs=1e-6)


def test_local_optima_are_optima():
    """With all cities as candidates no 2-opt move is left after 2-opt, and no Or-opt move either after Or-opt and 3-opt."""
    dice = np.random.default_rng(10)
    for _ in range(cases(25, 250)):
        n = int(dice.integers(6, 14))
        instance = Tsp(dice.random((n, 2)))
        cities, matrix = instance.cities(n - 1), tour.table("EUCLID", instance.xy.tolist())
        for breadth, longest, neighbours in (
            (0, 0, [tour.two_opt_moves]),
            (n - 1, 3, [tour.two_opt_moves, tour.or_opt_moves]),
            (n - 1, n, [tour.two_opt_moves, tour.or_opt_moves]),
        ):
            order = dice.permutation(n).astype(np.uint32)
            # A pass looks again at the ends of its moves alone; a pass without gain has looked at all.
            while search.improve(cities, search.workspace(n, 0), order, breadth, longest) > 0.0:
                pass
            found = order.tolist()
            length = tour.length(matrix, found)
            for moves in neighbours:
                assert all(tour.length(matrix, other) > length - 1e-9 for other in moves(found))


def test_undo_restores_the_tour():
    """Reversals that are logged and taken back leave the closed tour as it was."""
    dice = np.random.default_rng(12)
    for _ in range(cases(50, 500)):
        n = int(dice.integers(8, 60))
        work = search.workspace(n, 50)
        order = dice.permutation(n).astype(np.uint32)
        search.set_tour(work, order)
        for _ in range(int(dice.integers(1, 50))):
            i, j = (int(v) for v in dice.choice(n, 2, replace=False))
            a, c = order[i], order[j]
            search.flip(work, a, search.beside(work, a, True), c, search.beside(work, c, True))
        assert sorted(work.order) == list(range(n)) and (work.order[work.place] == np.arange(n)).all()
        search.undo(work)
        assert {frozenset(e) for e in zip(work.order, np.roll(work.order, 1))} == {
            frozenset(e) for e in zip(order, np.roll(order, 1))
        }
        assert work.counts[search.LOGGED] == 0


def test_a_search_ends_where_its_log_is_full():
    """What it gained is the difference in length, and undone it leaves the closed tour as it was."""
    dice = np.random.default_rng(16)
    for case in range(cases(84, 500)):
        cities, order, log = Tsp(dice.random((40, 2))).cities(8), dice.permutation(40).astype(np.uint32), 3 + case % 7
        if case % 2:  # nearly all moves that are left are 3-opt
            search.improve(cities, search.workspace(40, 0), order, 0, 40)
        work, before = search.workspace(40, log), kernel.length(cities.metric, order)
        search.set_tour(work, order)
        for city in order:
            search.push(work, city)
        gain = search.settle(cities, work, 5, 40)
        assert gain == pytest.approx(before - kernel.length(cities.metric, work.order), abs=1e-12)
        assert (0 if case % 2 else log - 2) <= work.counts[search.LOGGED] <= log and work.counts[search.SIZE] == 0
        search.undo(work)
        assert kernel.length(cities.metric, work.order) == pytest.approx(before)


def test_a_double_bridge_puts_three_parts_in_reverse_order():
    """Its gain is the difference in length, and undone it leaves the closed tour as it was."""
    dice = np.random.default_rng(15)
    for _ in range(cases(50, 500)):
        n = int(dice.integers(8, 40))
        instance = Tsp(dice.random((n, 2)))
        cities, work, order = instance.cities(5), search.workspace(n, 50), dice.permutation(n).astype(np.uint32)
        p, (b, c, d) = int(dice.integers(n)), np.sort(1 + dice.choice(n - 2, 3, replace=False)).tolist()
        search.set_tour(work, order)
        gain = tsp.bridge(cities, work, p, b, c, d)
        old = np.roll(order, -p).tolist()
        assert [tsp.places_ahead(work, p, city) for city in work.order] == [(place - p) % n for place in range(n)]
        new = old[:1] + old[c + 1 : d + 1] + old[b + 1 : c + 1] + old[1 : b + 1] + old[d + 1 :]
        assert set(ants.tour_edges(work.order.tolist())) == set(ants.tour_edges(new))
        assert gain == pytest.approx(instance.length(old) - instance.length(new), abs=1e-12)
        search.undo(work)
        assert set(ants.tour_edges(work.order.tolist())) == set(ants.tour_edges(old))


@pytest.mark.parametrize("options", [{}, {"local_search": "2opt"}, {"local_search": "3opt", "focused": True}])
def test_small_instances_are_solved(options):
    """Up to eight cities the ants find what trying all tours finds."""
    dice = np.random.default_rng(13)
    for n in (1, 2, 3, 4, 5, 6, 7, 8, 8):
        for _ in range(cases(2, 20)):
            instance = Tsp(random_places(dice, n), metric="EUC_2D")
            found = solve_tsp(instance, cycles=60, **options)
            assert sorted(found.order) == list(range(n))
            wanted = tour.shortest(tour.table("EUC_2D", instance.xy.tolist()))
            assert found.length == instance.length(found.order) == wanted


def test_focused_changes_keep_the_books():
    """A focused ant's length is that of its tour after every cycle, never rises, and falls in the end."""
    instance = Tsp(np.random.default_rng(14).random((150, 2)) * 1000, metric="EUC_2D")
    colony = Colony(instance, ants=3, candidates=8, options=tsp.LocalSearchOptions(5, 150, 100, 30))
    colony.run(1, np.empty((1, 2)))
    first = before = colony.state.lengths.copy()
    for _ in range(cases(20, 200)):
        colony.run(1, np.empty((1, 2)))
        lengths = [instance.length(order) for order in colony.state.orders]
        assert lengths == colony.state.lengths.tolist()
        assert (colony.state.lengths <= before).all()
        before = colony.state.lengths.copy()
    assert (before < first).all()


def changed(instance, colony, order, best, stream):
    """An ant's tour after a cycle of focused construction, its length, and the numbers of worse changes kept and undone.

    By the definition, with the kernels' double bridge, local search and undoing, which have tests of their own.
    """
    cities, (breadth, longest, attempts, window, temperature, *_) = colony.cities, colony.options
    n, work, kept, undone = len(order), search.workspace(len(order), 500), 0, 0
    search.set_tour(work, order)
    now = instance.length(order)
    window, hot = min(window, (n - 2) // 3), temperature * min(best, now) / n
    for a in range(attempts):
        p = ((stream.bits() >> 32) * n) >> 32
        u = work.order[p]
        ahead = [(work.order.tolist().index(city) - p) % n for city in cities.near[u]]
        legal = [c for c, q in enumerate(ahead) if 3 <= q <= 2 * window]
        if not legal:
            continue
        sums = np.cumsum(colony.state.weight[u, legal], dtype=np.float32)
        share = np.float32(stream.bits() >> 41) * np.float32(2.0**-23) * sums[-1]
        q = ahead[legal[int((sums > share).argmax())]]
        b = 1 + (((stream.bits() >> 32) * (q - 2)) >> 32)
        tsp.bridge(cities, work, p, b, q - 1, q + (((stream.bits() >> 32) * window) >> 32))
        search.settle(cities, work, breadth, longest)
        gain = now - instance.length(work.order)
        if gain < 0.0 and math.exp(gain / (hot * (1.0 - a / attempts))) <= 1.0 - (stream.bits() >> 11) * 2.0**-53:
            search.undo(work)
            undone += 1
        else:
            work.counts[search.LOGGED], now, kept = 0, now - gain, kept + (gain < 0.0)
    return work.order.tolist(), now, kept, undone


def test_focused_changes_are_drawn_and_kept_by_the_definition():
    """`refine` against its twin: where to change, by which edge and how far, and which longer tours are kept."""
    kept, undone = 0, 0
    for n, window in ((60, 30), (60, 4), (9, 30)):
        instance = Tsp(np.random.default_rng(17).integers(0, 900, (n, 2)), metric="EUC_2D")
        options = tsp.LocalSearchOptions(5, n, 40, window, 0.8)
        colony = Colony(instance, ants=3, candidates=6, options=options, seed=5)
        colony.run(1, np.empty((1, 2)))
        for cycle in range(1, cases(4, 40)):
            orders, best = colony.state.orders.copy(), colony.best_cost
            colony.run(1, np.empty((1, 2)))
            for ant, order in enumerate(orders):
                wanted, length, *worse = changed(instance, colony, order, best, ants.Stream(5, cycle * 3 + ant))
                assert colony.state.orders[ant].tolist() == wanted and colony.state.lengths[ant] == length
                kept, undone = kept + worse[0], undone + worse[1]
    assert kept > 0 and undone > 0


@pytest.mark.parametrize("anew", [0, 1, 2, 4])
def test_ants_go_on_from_the_better_of_two_tours(anew):
    """`select` against its twin, over many cycles; it does nothing where ants always or never build anew, and at first."""
    dice = np.random.default_rng(8)
    colony = Colony(Tsp(dice.random((30, 2))), "mmas", ants=9, seed=3)
    plan = colony.options._replace(rebuild_every=anew)
    for cycle in range(cases(20, 200)):
        seed = int(dice.integers(0, 2**63))
        orders = [dice.permutation(30).tolist() for _ in range(9)]
        lengths = dice.integers(1, 6, 9).astype(float).tolist()
        state = colony.state
        state.orders[:], state.lengths[:], state.record[tsp.CYCLE] = orders, lengths, cycle
        tsp.select(state, plan, np.uint64(seed))
        wanted = ants.select(orders, lengths, seed, cycle) if anew >= 2 and cycle > 0 else (orders, lengths)
        assert (state.orders.tolist(), state.lengths.tolist()) == wanted
