"""Whole answers of `solve_tsp`, and TSPLIB files, sound and spoilt."""

from __future__ import annotations

import math
import random
import threading
import time
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

from antway import BadInput, BadMap, BadParameter, TooLarge, load_tsp, solve_tsp
from antway.ants.colony import Colony
from antway.ants.immune import Immune
from antway.ants.persistence import Constant
from antway.ants.rules import RULES, AntSystem
from antway.ants.tsp import local_search_options
from antway.ants.tsplib import Tsp, parse
from antway.kernels.colony.tsp import walk_once
from common import SCALE, SHARED, cases, needs_data
from mapfiles import spoil

TSPLIB = SHARED / "tsplib"
RANDOM = Tsp(np.random.default_rng(1).random((60, 2)) * 1000, metric="EUC_2D")
MANY = Tsp(np.random.default_rng(2).random((120, 2)) * 1e4, metric="EUC_2D")
BURMA = """NAME: burma14\nTYPE: TSP\nDIMENSION: 14\nEDGE_WEIGHT_TYPE: GEO\nNODE_COORD_SECTION
1 16.47 96.10\n2 16.47 94.44\n3 20.09 92.54\n4 22.39 93.37\n5 25.23 97.24\n6 22.00 96.05\n7 20.47 97.02
8 17.20 96.29\n9 16.30 97.38\n10 14.05 98.12\n11 16.53 97.38\n12 21.52 95.59\n13 19.41 97.13\n14 20.09 94.55\nEOF\n"""
PLANE = "NAME : p\nTYPE : TSP\nDIMENSION : 4\nEDGE_WEIGHT_TYPE : {}\nNODE_COORD_SECTION\n1 0 0\n2 0 3.4\n3 4 3\n4 4 0\nEOF\n"
EXPLICIT = (
    "NAME: e\nTYPE: TSP\nDIMENSION: 3\nEDGE_WEIGHT_TYPE: EXPLICIT\nEDGE_WEIGHT_FORMAT: {}\nEDGE_WEIGHT_SECTION\n{}\nEOF\n"
)
FORMATS = {
    "FULL_MATRIX": "0 1 2\n1 0 3\n2 3 0",
    "UPPER_ROW": "1 2\n3",
    "UPPER_DIAG_ROW": "0 1 2 0 3 0",
    "UPPER_COL": "1 2 3",
    "UPPER_DIAG_COL": "0 1 0 2 3 0",
    "LOWER_ROW": "1\n2 3",
    "LOWER_DIAG_ROW": "0\n1 0\n2 3 0",
    "LOWER_COL": "1 2 3",
    "LOWER_DIAG_COL": "0 1 2 0 3 0",
}


def contents(tour):
    """What must be the same in every run."""
    return tour.order.tobytes(), tour.length, tour.pheromone.tobytes(), tour.history[:, :2].tobytes(), tour.tours


OPTIONS = [
    {"rule": "mmas"},
    {"rule": "acs"},
    {"rule": "rank", "local_search": "2opt"},
    {"local_search": "3opt"},
    {"rule": "mmas", "local_search": "3opt", "focused": True},
    {"rule": "eas", "immune": Immune()},
]


@pytest.mark.parametrize("options", OPTIONS, ids=str)
def test_same_seed_same_bytes_with_any_threads(options):
    """The same seed gives the same tour, pheromone and history with 1, 2 and 8 threads; another seed, other pheromone."""
    one = solve_tsp(RANDOM, cycles=8, seed=5, **options)
    for threads in (1, 2, 8):
        assert contents(solve_tsp(RANDOM, cycles=8, seed=5, threads=threads, **options)) == contents(one)
    assert solve_tsp(RANDOM, cycles=8, seed=6, **options).pheromone.tobytes() != one.pheromone.tobytes()


def test_same_seed_same_bytes_where_ants_take_turns(monkeypatch):
    """From 1,000 cities on ants select, change and build anew in turns: with any number of threads to the same bytes."""
    assert [local_search_options(n, "mmas", "3opt", None)[0].rebuild_every for n in (999, 1000, 2000)] == [1, 4, 0]
    monkeypatch.setattr("antway.ants.tsp._FOCUSED_FROM", 100)
    runs = [contents(solve_tsp(MANY, local_search="3opt", cycles=5, seed=5, threads=threads)) for threads in (1, 2, 3)]
    assert runs[0] == runs[1] == runs[2]


@pytest.mark.parametrize("rule", ["as", "eas", "rank", "mmas", "acs"])
@pytest.mark.parametrize("local_search", [None, "2opt", "oropt", "3opt"])
def test_answers_are_tours(rule, local_search):
    """Every rule with every local search gives a permutation of the length it says, with a falling history."""
    tour = solve_tsp(RANDOM, rule, local_search=local_search, cycles=5, ants=4)
    assert sorted(tour.order) == list(range(60))
    assert tour.length == RANDOM.length(tour.order) == tour.history[-1, 1]
    assert (np.diff(tour.history[:, 1]) < 0).all() and (np.diff(tour.history[:, [0, 2]], axis=0) >= 0).all()
    assert tour.tours == 20 and tour.gap is None


def test_budgets_warm_start_and_cancel():
    """Tours and cycles end a run exactly, time and cancellation soon; pheromone handed on is where the next run starts."""
    assert solve_tsp(RANDOM, tours=100, ants=10).tours == 100
    started = time.perf_counter()
    stop = threading.Event()
    seen = []

    def progress(tours, best, seconds):
        seen.append((tours, best, seconds))
        if len(seen) == 3:
            stop.set()

    first = solve_tsp(RANDOM, progress=progress, cancel=stop, seconds=60)
    assert len(seen) == 3 and seen[-1][:2] == (first.tours, first.length)
    assert solve_tsp(RANDOM, seconds=0.0).tours > 0 and time.perf_counter() - started < 60
    cold, warm = (solve_tsp(RANDOM, cycles=1, pheromone=p) for p in (None, solve_tsp(RANDOM, cycles=400).pheromone))
    assert warm.length < cold.length


def test_degenerate_instances():
    """One, two, three cities, and cities all in one place, have the tours they have."""
    for n in (1, 2, 3):
        tour = solve_tsp(Tsp(np.arange(2.0 * n).reshape(n, 2)), local_search="3opt")
        assert tour.order.tolist() == list(range(n)) and tour.gap == 0.0
        rows = "".join(f"{i + 1} {i} 0\n" for i in range(n))
        text = PLANE.format("EUC_2D").replace("DIMENSION : 4", f"DIMENSION : {n}").split("1 0 0")[0] + rows + "EOF\n"
        assert solve_tsp(parse(text.encode())).length == 2 * (n - 1)
    assert solve_tsp(Tsp([(2.0, 2.0)] * 9)).length == 0.0
    assert solve_tsp(Tsp([(0, 0)] * 9 + [(3, 4)] * 9), cycles=20, local_search="2opt").length == 10.0


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("local_search", [None, "2opt", "3opt"])
def test_few_cities_have_their_shortest_tour(rule, local_search):
    """One to seven cities, some of them in one place or in a row, get the shortest of all tours."""
    dice = np.random.default_rng(9)
    for n in range(1, 8):
        for places in (dice.random((n, 2)), dice.integers(0, 3, (n, 2)).astype(float), np.outer(dice.random(n), [3.0, 4.0])):
            instance = Tsp(places)
            table = np.linalg.norm(places[:, None] - places, axis=-1)
            tours = np.array([[0, *rest] for rest in permutations(range(1, n))])
            shortest = table[tours, np.roll(tours, -1, axis=1)].sum(axis=1).min()
            tour = solve_tsp(instance, rule, local_search=local_search, cycles=60, ants=10)
            assert sorted(tour.order) == list(range(n))
            assert tour.length == pytest.approx(shortest, abs=1e-9)


def test_the_gap_of_a_tour_of_some_length_is_infinite_where_the_shortest_has_none():
    """One ant does not find the ring of length 0 in its first tour, and many do later."""
    rng = np.random.default_rng(2)
    matrix, ring = (rng.random((12, 12)) < 0.85) * 5.0, rng.permutation(12)
    matrix[ring, np.roll(ring, 1)] = 0.0
    instance = Tsp(matrix=np.minimum(matrix, matrix.T), optimum=0.0)
    first = solve_tsp(instance, "as", ants=1, cycles=1, candidates=3, seed=2)
    best = solve_tsp(instance, "mmas", local_search="3opt", cycles=200)
    assert (first.length > 0.0, first.gap) == (True, math.inf) and (best.length, best.gap) == (0.0, 0.0)


def test_many_cities_in_one_place():
    """A city among more equals than it has candidates is still none of its own."""
    cities = Tsp(np.zeros((40, 2))).cities(5)
    assert (cities.near != np.arange(40)[:, None]).all()


def test_a_walk_among_many_equal_places_stays_until_all_are_visited():
    """It need not look at all cities at each step: 40,000 in 40 places take a fraction of a second."""
    n, dice = 40_000, np.random.default_rng(0)
    spot = dice.permutation(np.arange(n) % 40)
    cities = Tsp(np.column_stack((spot % 10, spot // 10)).astype(float)).cities(1)
    ones = np.ones((n, 1))
    state = Colony(Tsp(dice.random((9, 2))), candidates=1)
    colony = state.state._replace(weight=ones.astype(np.float32), row_sum=ones[:, 0], orders=np.zeros((1, n), np.uint32))
    started = time.process_time()
    length = walk_once(cities, colony, state.numbers, np.uint64(1))
    assert time.process_time() - started < 1.5
    order = colony.orders[0]
    assert (np.bincount(order, minlength=n) == 1).all() and length < 80.0
    assert np.count_nonzero(np.diff(spot[order])) == 39


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("immune", [None, Immune(), Immune(temperature=1e-320)])
def test_a_tour_of_no_length_is_the_shortest(rule, immune):
    """Distances may all be rounded to 0 on the best tour; the search for it ends there."""
    rounded = Tsp([(0, 0), (0.8, 0), (0.4, 0), (0.4, 0)], metric="EUC_2D")
    matrix = np.full((6, 6), 3.0)
    hidden = np.array([0, 3, 1, 5, 2, 4])
    matrix[hidden, np.roll(hidden, 1)] = matrix[np.roll(hidden, 1), hidden] = 0.0
    for instance in (rounded, Tsp(matrix=matrix)):
        tour = solve_tsp(instance, rule, immune=immune, cycles=200, candidates=2)
        assert tour.length == 0.0 and np.isfinite(tour.pheromone).all()
    assert tour.tours < 200 * 6


@pytest.mark.parametrize("n", [9, 50])
@pytest.mark.parametrize("local_search", ["oropt", "3opt"])
def test_local_search_takes_few_candidates(n, local_search):
    """With fewer candidates than the local search looks at, it looks at those."""
    instance = Tsp(np.random.default_rng(0).random((n, 2)) * 100)
    for candidates in (1, 2, 3, 4):
        tour = solve_tsp(instance, local_search=local_search, candidates=candidates, cycles=10)
        assert tour.length == pytest.approx(tour.history[-1, 1]) and tour.candidates.shape == (n, candidates)


def test_the_diagonal_of_a_matrix_is_ignored():
    """However long the way from a city to itself may be, or unknown, gains of the others count."""
    matrix, tours = np.linalg.norm(RANDOM.xy[:, None] - RANDOM.xy, axis=-1) / 1e4, []
    for far in (0.0, 1e12, math.inf, math.nan):
        np.fill_diagonal(matrix, far)
        tours.append(contents(solve_tsp(Tsp(matrix=matrix), local_search="3opt", cycles=3)))
    assert tours[1:] == tours[:1] * 3


@pytest.mark.parametrize("form", FORMATS)
def test_matrix_formats(form):
    """Every EXPLICIT format gives the distances 1, 2, 3 of three cities."""
    matrix = parse(EXPLICIT.format(form, FORMATS[form]).encode()).matrix
    assert matrix.tolist() == [[0, 1, 2], [1, 0, 3], [2, 3, 0]]


def test_geographic_optimum():
    """burma14, of GEO distances, has its optimum of 3,323, and so has a copy of another name; its places may be replaced."""
    burma = parse(BURMA.encode())
    assert solve_tsp(burma, local_search="2opt", cycles=50).length == 3323
    assert solve_tsp(replace(burma, name="copy"), local_search="2opt", cycles=50).length == 3323
    assert replace(burma, xy=[(0.0, 0.0), (0.0, 90.0)]).length([0, 1]) == Tsp([(0.0, 0.0), (0.0, 90.0)], metric="GEO").length(
        [0, 1]
    )


@needs_data
@pytest.mark.parametrize("name", ["eil51", "kroA100", "d198", "lin318", "att532"])
def test_benchmark_files(name):
    """The files of TSPLIB load, with their number of cities and optimum; the ants come within 3 %."""
    instance = load_tsp(TSPLIB / f"{name}.tsp")
    assert instance.size == int("".join(c for c in name if c.isdigit()))
    assert 0.0 <= solve_tsp(instance, local_search="3opt", cycles=6).gap < 0.03


@needs_data
@pytest.mark.skipif(SCALE == 1, reason="nightly")
@pytest.mark.parametrize("name", ["eil51", "kroA100"])
def test_quality(name):
    """Over 30 seeds MMAS with 2-opt is within 1 % at the median, and plain Ant System within 8 %."""
    instance = load_tsp(TSPLIB / f"{name}.tsp")
    searched = [solve_tsp(instance, local_search="2opt", cycles=100, seed=seed).gap for seed in range(30)]
    plain = [solve_tsp(instance, "as", tours=1000 * instance.size, seed=seed).gap for seed in range(30)]
    assert np.median(searched) <= 0.01 and np.median(plain) <= 0.08


@pytest.mark.parametrize(
    ("text", "kind", "field"),
    [
        ("", BadMap, "DIMENSION"),
        (PLANE.format("EUC_3D"), BadMap, "EDGE_WEIGHT_TYPE"),
        (PLANE.format("EUC_2D").replace("DIMENSION : 4", "DIMENSION : 5"), BadMap, "NODE_COORD_SECTION"),
        (PLANE.format("EUC_2D").replace("DIMENSION : 4", "DIMENSION : 0"), BadMap, "DIMENSION"),
        (PLANE.format("EUC_2D").replace("DIMENSION : 4", "DIMENSION : 999999999"), TooLarge, "DIMENSION"),
        (PLANE.format("EUC_2D").replace("3.4", "nan"), BadMap, "NODE_COORD_SECTION"),
        (PLANE.format("EUC_2D").replace("3.4", "1e30"), BadMap, "NODE_COORD_SECTION"),
        (PLANE.format("EUC_2D").replace("3.4", "three"), BadMap, "NODE_COORD_SECTION"),
        (PLANE.format("EUC_2D").replace("\n2 ", "\n1 "), BadMap, "NODE_COORD_SECTION"),
        (PLANE.format("ATT").replace(": TSP", ": ATSP"), BadMap, "TYPE"),
        (EXPLICIT.format("FULL_MATRIX", "0 1 2 9 0 3 2 3 0"), BadMap, "EDGE_WEIGHT_SECTION"),
        (EXPLICIT.format("FULL_MATRIX", "0 1 2"), BadMap, "EDGE_WEIGHT_SECTION"),
        (EXPLICIT.format("UPPER_ROW", "1 -2 3"), BadMap, "EDGE_WEIGHT_SECTION"),
        (EXPLICIT.format("SIDEWAYS", "1 2 3"), BadMap, "EDGE_WEIGHT_FORMAT"),
        (PLANE.format("EUC_2D").replace("EOF", "FIXED_EDGES_SECTION\n1 3\n-1"), BadMap, "FIXED_EDGES_SECTION"),
    ],
)
def test_wrong_files(tmp_path, text, kind, field):
    """A wrong file is refused with the field that is wrong and the file's name."""
    path = tmp_path / "wrong.tsp"
    path.write_text(text)
    with pytest.raises(kind) as caught:
        load_tsp(path)
    assert caught.value.field == field and caught.value.where.startswith(str(path))


def test_a_comment_may_take_several_lines(tmp_path):
    """As in TSPLIB's usa13509; no other key may come twice."""
    path, comment = tmp_path / "told.tsp", "COMMENT : by two people\n"
    path.write_text(PLANE.format("EUC_2D").replace("DIMENSION", f"{comment}{comment}DIMENSION"))
    assert load_tsp(path).size == 4
    path.write_text(PLANE.format("EUC_2D").replace("DIMENSION", "TYPE : TSP\nDIMENSION"))
    with pytest.raises(BadMap, match="the only one of its key"):
        load_tsp(path)


def test_an_optimum_belongs_to_a_name_and_a_number_of_cities():
    """A part of a well-known instance that kept its name has no known optimum."""
    assert parse(BURMA.encode()).optimum == 3323
    assert parse(PLANE.format("GEO").replace(": p", ": burma14").encode()).optimum is None


def test_weights_that_differ_are_shown():
    """Both ways between the first two cities that have two distances."""
    with pytest.raises(BadMap, match=r"= \(1.0, 9.0\): .* between the cities 1 and 2"):
        parse(EXPLICIT.format("FULL_MATRIX", "0 1 2 9 0 3 2 3 0").encode())


def test_spoilt_files():
    """A file with flipped bits, parts cut out or numbers put in is an instance or a `BadInput`, within two seconds."""
    sound = [PLANE.format(kind).encode() for kind in ("EUC_2D", "CEIL_2D", "ATT")] + [BURMA.encode()]
    sound += [EXPLICIT.format(form, rows).encode() for form, rows in FORMATS.items()]
    dice = random.Random(4)
    read = 0
    for _ in range(cases(1000, 100_000)):
        data = spoil(dice.choice(sound), sound, dice)
        started = time.perf_counter()
        try:
            instance = parse(data)
            assert np.isfinite(instance.length(np.arange(instance.size)))
            read += 1
        except BadInput:
            pass
        assert time.perf_counter() - started < 2.0
    assert read > 0


@pytest.mark.parametrize(
    "wrong",
    [
        {"rule": "queen"},
        {"local_search": "4opt"},
        {"ants": 0},
        {"seed": -1},
        {"seconds": float("nan")},
        {"tours": -1},
        {"threads": 0},
        {"candidates": 0},
        {"focused": True},
        {"pheromone": [[1.0]]},
        {"persistence": 3},
        {"persistence": Constant},
        {"immune": 3},
        {"rule": np.array(["mmas", "as"]), "local_search": "2opt"},
    ],
    ids=str,
)
def test_wrong_options(wrong):
    """An option outside its range is a `BadParameter`, also where there is nothing to search."""
    for instance in (RANDOM, Tsp([(0, 0)] * 9), Tsp([(0, 0), (1, 1)])):
        with pytest.raises(BadParameter):
            solve_tsp(instance, **{"cycles": 1, **wrong})


@pytest.mark.parametrize("wrong", [{"candidates": 10**6}, {"candidates": 151}, {"ants": 501}, {"rule": AntSystem(ants=10**6)}])
def test_colonies_that_would_take_all_memory_are_refused(wrong):
    """Before memory is taken: all 200,000 cities as candidates would be 160 GB."""
    with pytest.raises(TooLarge, match=r"at most (150|500) for 200000 cities"):
        solve_tsp(Tsp(np.arange(400_000.0).reshape(-1, 2)), cycles=1, **wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        {"xy": [(0, 0), (1, float("nan"))]},
        {"xy": [(0, 0), (1, 1e30)]},
        {"xy": []},
        {"xy": [(0, 0, 0)]},
        {"xy": [(0, 0)], "metric": "MANHATTAN"},
        {"xy": [(0, 0)], "optimum": -1.0},
        {"xy": [(0, 0)], "optimum": math.nan},
        {"matrix": [[0, 1], [2, 0]]},
        {"matrix": [[0, -1], [-1, 0]]},
        {"matrix": [[0, math.nan], [math.nan, 0]]},
        {"matrix": [[0, math.inf], [math.inf, 0]]},
        {"matrix": [[0, 1], [1, 0]], "metric": "EUC_2D"},
        {"matrix": [[0, 1], [1, 0]], "metric": "nonsense"},
        {},
    ],
    ids=str,
)
def test_wrong_instances(wrong):
    """Places that are no places and distances that are no distances are refused."""
    with pytest.raises(BadParameter):
        Tsp(**wrong)


@pytest.mark.parametrize("n", [100, 400])
def test_the_first_cycle_is_no_random_walk(n: int) -> None:
    """Focused construction is as good as in a cycle that knows a best tour; it took every worse tour at first."""
    from antway.ants.rules import make_rule
    from antway.ants.tsp import default_ants, local_search_options
    from antway.kernels.colony.tsp import BEST

    instance = Tsp(np.random.default_rng(n).random((n, 2)) * 1000.0)
    options, name = local_search_options(n, "mmas", "3opt", None)
    mean = []
    for known in (False, True):
        colony = Colony(instance, make_rule(name, ants=default_ants(options)), seed=0, candidates=10, options=options)
        if known:
            colony.state.record[BEST] = 0.7124 * math.sqrt(n * 1e6) * 1.08
        mean.append(np.mean([instance.length(tour) for tour in colony.ask()]))
    assert mean[0] < 1.005 * mean[1]
