"""Pareto fronts and diverse ways against exact fronts, naive twins and their own promises."""

from __future__ import annotations

import json
import math
import threading
from itertools import permutations

import numpy as np
import pytest

from antway.ants.front import OBJECTIVES, Front, alternatives, pareto
from antway.ants.grid_walk import Ants
from antway.errors import BadInput, TooLarge
from antway.grid import Grid, Moves
from antway.kernels.colony import grid_walk as kernel
from antway.planning import Budget, Problem, Status
from antway.search.distance_field import dijkstra
from antway.verify import check_plan
from common import SHARED, cases, costly, needs_data
from naive import grid_walk as naive
from test_grid_walk import random_ground, random_weights


def costs_to_go(graph: kernel.GridGraph, cost: np.ndarray, turn: float, steps: int) -> np.ndarray:
    """The costs to go, computed in slices of `steps` cells."""
    known = kernel.no_costs(graph)
    while not kernel.costs_to_go(graph, cost, turn, known, steps):
        pass
    return known.value


def test_costs_to_go_are_the_fixed_point_of_bellmans_equation():
    """Least costs over cells and headings agree with the naive sweeps, whatever the costs of cells and turns."""
    rng = np.random.default_rng(1)
    for _ in range(cases(15, 300)):
        graph = random_ground(rng, 3, 8)
        cost, turn = rng.random(graph.distance.size) + 0.1, float(rng.choice([0.0, 0.3, 5.0]))
        wanted = naive.costs_to_go(graph.net.legal, graph.offsets, Moves.EIGHT.lengths, cost, turn, graph.goal)
        whole = costs_to_go(graph.for_kernels, cost, turn, 10**9)
        np.testing.assert_allclose(whole, wanted, rtol=1e-9)
        np.testing.assert_array_equal(costs_to_go(graph.for_kernels, cost, turn, int(rng.integers(1, 9))), whole)
    plain = costs_to_go(graph.for_kernels, np.ones(cost.size), 0.0, 10**9)
    assert plain[graph.start].min() == pytest.approx(graph.bound)


def test_scores_are_those_of_each_path():
    """Length, turns, narrowest clearance and integrals of the ants' paths agree with the naive twin."""
    rng = np.random.default_rng(2)
    for _ in range(cases(20, 300)):
        graph = random_ground(rng)
        walkers = Ants(graph, 6, 40)
        walkers.walk(random_weights(rng, graph), 1, 0, Budget().start())
        clearance, danger = rng.random((2, graph.distance.size))
        found = kernel.score(graph.for_kernels, walkers.moves, walkers.depth, clearance, danger)
        for ant in range(6):
            if walkers.depth[ant] < 0:
                assert np.isinf(found[ant]).all()
            else:
                args = (graph.offsets, Moves.EIGHT.lengths, graph.start, walkers.path(ant).tolist(), clearance, danger)
                np.testing.assert_allclose(found[ant], naive.score(*args), rtol=1e-12)


@needs_data
def test_fronts_of_length_and_turns_are_found_whole():
    """On all six shared grids the front of the exhaustive search comes out whole in at least 95 % of the seeds."""
    fronts = json.loads((SHARED / "grids" / "optima.json").read_text())["front_nosqueeze"]
    for name, exact in fronts.items():
        rows = (SHARED / "grids" / f"{name}.txt").read_text().split()
        grid = Grid(np.array([[cell == "@" for cell in row] for row in rows]))
        problem = Problem(grid, (0, 0), (grid.shape[0] - 1, grid.shape[1] - 1), Moves.EIGHT_NOSQUEEZE)
        seeds, whole = costly(5, 100), 0
        for seed in range(seeds):
            front = pareto(problem, seed=seed)
            for plan in front.plans:
                check_plan(problem, plan)
            found = [(turns, round(length, 4)) for length, turns in front.values.tolist()]
            whole += found == [(turns, pytest.approx(length, abs=2e-4)) for turns, length in exact]
        assert whole >= 0.95 * seeds, name


def test_fronts_of_small_maps_are_exact():
    """On random small maps under all moves the front of length and turns is the exact one in at least 95 % of the cases."""
    rng = np.random.default_rng(3)
    whole, number = 0, costly(30, 500)
    for seed in range(number):
        graph = random_ground(rng, 3, 12)
        front = pareto(graph.problem, seed=seed)
        exact = naive.front(graph.net.legal, graph.offsets, Moves.EIGHT.lengths, graph.start, graph.goal)
        whole += len(exact) == len(front.values) and np.allclose(front.values, exact)
        for plan in front.plans:
            check_plan(graph.problem, plan)
    assert whole >= 0.95 * number


def test_no_plan_of_a_front_is_beaten_whatever_the_objectives():
    """For all objectives: legal plans with the values stated, the shortest path among them, none dominated by another."""
    rng = np.random.default_rng(4)
    blocked = rng.random((16, 20)) < 0.12
    blocked[0, 0] = blocked[-1, -1] = False
    problem = Problem(Grid(blocked, resolution=0.5), (0, 0), (15, 19))
    risk = rng.random((16, 20)) ** 4 * 5
    clearance = problem.grid.clearance()
    for names in (OBJECTIVES, ("clearance", "length"), ("exposure",), ("turns", "exposure")):
        front = pareto(problem, objectives=names, exposure=risk, cycles=6)
        assert front.status is Status.FOUND and len(front.plans) == len(front.values) > 0
        assert (np.diff(front.values[:, 0]) * (-1 if names[0] == "clearance" else 1) >= 0).all()
        costs = front.values * [-1 if name == "clearance" else 1 for name in names]
        for i, plan in enumerate(front.plans):
            check_plan(problem, plan)
            steps = np.diff(plan.cells, axis=0)
            at = tuple(plan.cells.T)
            far = np.hypot(*steps.T) * 0.5
            exposed = (far * (risk[at][1:] + risk[at][:-1]) / 2).sum()
            turns = (np.diff(steps, axis=0) != 0).any(axis=1).sum()
            stated = {"length": plan.length, "turns": turns, "clearance": clearance[at].min(), "exposure": exposed}
            np.testing.assert_allclose(front.values[i], [stated[name] for name in names], rtol=1e-9)
            assert not ((costs <= costs[i] + 1e-9).all(axis=1) & (costs < costs[i] - 1e-9).any(axis=1)).any()


def test_a_front_trades_length_for_clearance():
    """Through a gap of one cell, or round by the wide way: both are on the front, and its ends are what they must be."""
    blocked = np.zeros((15, 15), dtype=bool)
    blocked[3:, 7] = True
    blocked[10, 7] = False
    front = pareto(Problem(Grid(blocked), (10, 3), (10, 11)), objectives=("length", "clearance"))
    assert front.values[0].tolist() == [8.0, 0.5] and front.values[-1, 1] == 1.5
    assert (np.diff(front.values, axis=0) > 0).all()


@pytest.mark.parametrize("moves", [Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT])
def test_who_cuts_a_corner_has_no_clearance(moves):
    """Fronts of length and clearance are those of shortest paths over cells with each clearance, and 0 for cut corners."""
    rng = np.random.default_rng(8)
    for seed in range(costly(8, 100)):
        blocked = rng.random((7, 9)) < 0.2
        blocked[0, 0] = blocked[-1, -1] = False
        grid, (start, goal) = Grid(blocked, 0.5), ((0, 0), (6, 8))
        clearance, wanted = grid.clearance(), [(dijkstra(Problem(grid, start, goal, moves)).length, 0.0)]
        for level in np.unique(clearance[~blocked & (clearance <= min(clearance[start], clearance[goal]))]):
            rest = dijkstra(Problem(Grid(clearance < level, 0.5), start, goal))
            wanted += [(rest.length, level)] if rest.status is Status.FOUND else []
        wanted = [one for one in wanted if math.isfinite(one[0]) and not any(is_worse(one, other) for other in wanted)]
        found = pareto(Problem(grid, start, goal, moves), objectives=("length", "clearance"), seed=seed)
        np.testing.assert_allclose(found.values, np.array(sorted(wanted)).reshape(-1, 2))


def is_worse(one: tuple[float, float], other: tuple[float, float]) -> bool:
    """Whether the other path is as short and as far from walls, but not the same in both."""
    return other != one and other[0] <= one[0] + 1e-9 and other[1] >= one[1]


def test_alternatives_are_different_short_and_legal():
    """Paths share no more cells than allowed, are no longer than allowed, and the first is a shortest path."""
    blocked = np.zeros((21, 31), dtype=bool)
    blocked[3:9, 8:23] = blocked[12:18, 8:23] = True
    problem = Problem(Grid(blocked, resolution=0.5), (10, 0), (10, 30))
    paths = alternatives(problem, 3, overlap=0.55, seed=1)
    assert len(paths) == 3 and paths[0].optimal and paths[-1].length <= 1.5 * paths[0].length
    assert [path.length for path in paths] == sorted(path.length for path in paths)
    rows = sorted(int(path.cells[len(path.cells) // 2, 0]) for path in paths)
    assert rows[0] < 3 and 9 <= rows[1] < 12 and rows[2] >= 18  # above, between and below the blocks
    for path in paths:
        check_plan(problem, path)
    assert len(alternatives(problem, 3, path_ratio=1.01)) == 1
    corridor = Problem(Grid(np.zeros((1, 9), dtype=bool)), (0, 0), (0, 8))
    assert [path.length for path in alternatives(corridor, 4)] == [8.0]


def test_of_two_alternatives_neither_covers_the_other():
    """Also of the shorter path, no more than the allowed part is near a longer one, which may wind about it."""
    for seed in range(12):
        blocked = np.random.default_rng(seed).random((12, 24)) < 0.25
        blocked[6, 1] = blocked[6, 22] = False
        paths = alternatives(Problem(Grid(blocked), (6, 1), (6, 22)), 4, overlap=0.4, apart=1, path_ratio=2.0)
        for one, other in permutations([path.cells for path in paths if len(path.cells)], 2):
            away = abs(one[:, None] - other).max(axis=2).min(axis=1)
            assert (away <= 1).mean() <= 0.4


def test_fronts_and_ways_are_repeatable_with_any_number_of_threads():
    """The same seed gives the same bytes for 1, 2 and 4 threads."""
    blocked = np.zeros((12, 12), dtype=bool)
    blocked[4:8, 4:8] = True
    problem = Problem(Grid(blocked), (5, 0), (6, 11))
    fronts = [pareto(problem, seed=5, cycles=3, ants=9, threads=threads) for threads in (1, 2, 4)]
    paths = [alternatives(problem, seed=5, threads=threads) for threads in (1, 2, 4)]
    for i in (1, 2):
        assert fronts[i].values.tobytes() == fronts[0].values.tobytes()
        assert [p.cells.tobytes() for p in fronts[i].plans] == [p.cells.tobytes() for p in fronts[0].plans]
        assert [p.cells.tobytes() for p in paths[i]] == [p.cells.tobytes() for p in paths[0]]


def test_no_way_no_time_and_no_distance_are_told():
    """NO_PATH where walls part the ends, BUDGET where time ran out, one plan of one cell where start is goal."""
    blocked = np.zeros((5, 5), dtype=bool)
    blocked[:, 2] = True
    apart = Problem(Grid(blocked), (0, 0), (0, 4))
    assert pareto(apart).status is Status.NO_PATH and pareto(apart).plans == ()
    assert [plan.status for plan in alternatives(apart)] == [Status.NO_PATH]
    near = Problem(Grid(blocked), (0, 0), (4, 1))
    late = Budget(seconds=0.0)
    assert pareto(near, budget=late).status is Status.BUDGET
    assert [plan.status for plan in alternatives(near, budget=late)] == [Status.BUDGET]
    here = Problem(Grid(blocked), (0, 0), (0, 0))
    assert pareto(here).values.tolist() == [[0.0, 0.0]]
    assert [plan.length for plan in alternatives(here)] == [0.0]
    for plan in (*pareto(here).plans, *alternatives(here)):
        check_plan(here, plan)
    beside = Problem(Grid(blocked), (0, 0), (0, 1))
    assert [plan.length for plan in alternatives(beside, 1)] == [1.0] and pareto(beside).values.tolist() == [[1.0, 0.0]]


class Later(threading.Event):
    """An event that is set at the look with this number."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number, self.looks = number, 0

    def is_set(self) -> bool:
        self.looks += 1
        return self.looks >= self.number


@pytest.mark.parametrize("find", [pareto, alternatives])
def test_a_front_ends_wherever_its_time_runs_out(find) -> None:
    """Cancelled at one of the first looks at the clock, a search prepares nothing more, and what it has found is legal."""
    problem = Problem(Grid(np.zeros((30, 30), dtype=bool)), (0, 0), (29, 20))
    for number in range(1, 9):
        cancel = Later(number)
        found = find(problem, budget=Budget(cycles=10, cancel=cancel), ants=3)
        assert cancel.looks < number + 40
        for plan in found.plans if isinstance(found, Front) else found:
            if len(plan.cells):
                check_plan(problem, plan)


@pytest.mark.parametrize(
    "options",
    [
        {"objectives": ("speed",)},
        {"objectives": ()},
        {"objectives": ("length", "length")},
        {"objectives": ("length", "exposure")},
        {"objectives": ("exposure",), "exposure": np.full((3, 3), -1.0)},
        {"objectives": ("exposure",), "exposure": np.zeros((2, 3))},
        {"ants": 0},
        {"cycles": -1},
        {"threads": 0},
        {"seed": -1},
    ],
)
def test_wrong_options_of_a_front_are_refused(options):
    """Each raises a BadInput."""
    with pytest.raises(BadInput):
        pareto(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2)), **options)


def test_a_front_that_needs_too_much_memory_is_refused() -> None:
    """The costs of 54 weightings take 3.5 kB a cell."""
    free = Grid(np.zeros((1, 1_300_000), bool))
    problem = Problem(free, (0, 0), (0, 9), moves=Moves.EIGHT_NOSQUEEZE)
    with pytest.raises(TooLarge, match="at most 1242756 cells"):
        pareto(problem, objectives=OBJECTIVES, exposure=np.zeros(free.shape))


@pytest.mark.parametrize("options", [{"k": 0}, {"overlap": 1.1}, {"apart": -1}, {"path_ratio": 0.9}, {"overlap": math.nan}])
def test_wrong_options_of_alternatives_are_refused(options):
    """Each raises a BadInput."""
    with pytest.raises(BadInput):
        alternatives(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2)), **options)


def test_more_cycles_than_powers_of_two_fit():
    """In a corridor there is no second path, however many cycles look for it."""
    corridor = Problem(Grid(np.zeros((1, 12), dtype=bool)), (0, 0), (0, 11))
    assert len(alternatives(corridor, 2, cycles=1100, ants=2)) == 1


@pytest.mark.parametrize("within", [0.0, 1.0, 254.0, 1e9])
def test_risk_in_walls_changes_no_front(within: float) -> None:
    """Cost maps have large numbers in walls; the end of the front with the least exposure is found all the same."""
    blocked = np.zeros((9, 15), bool)
    blocked[2:7, 5:10] = True
    exposure = np.random.default_rng(0).random((9, 15))
    exposure[blocked] = within
    front = pareto(Problem(Grid(blocked), (4, 0), (4, 14)), objectives=("length", "exposure"), exposure=exposure)
    assert front.values[:, 1].min() < 5.2


@pytest.mark.parametrize("unit", [2.0**-100, 2.0**60, 2.0**300])
def test_a_front_is_the_same_in_any_unit_of_risk(unit: float) -> None:
    """Large risks had plans that were better by rounding alone, and small ones only the plans of least length and turns."""
    rng = np.random.default_rng(0)
    blocked = rng.random((9, 12)) < 0.1
    blocked[4, [0, -1]] = False
    problem = Problem(Grid(blocked, resolution=0.5), (4, 0), (4, 11))
    for exposure in (rng.random((9, 12)), np.full((9, 12), 0.7)):
        names = ("length", "turns", "exposure")
        one, other = (pareto(problem, objectives=names, exposure=exposure * u, cycles=3) for u in (1.0, unit))
        assert np.array_equal(one.values * (1.0, 1.0, unit), other.values)
        assert all(np.array_equal(a.cells, b.cells) for a, b in zip(one.plans, other.plans, strict=True))


def test_alternatives_are_different_paths() -> None:
    """Also where each may be wholly near an earlier one."""
    found = alternatives(Problem(Grid(np.zeros((1, 10), bool)), (0, 0), (0, 9)), 3, overlap=1.0)
    assert len(found) == 1
    with pytest.raises(BadInput):
        pareto(Problem(Grid(np.zeros((3, 3), bool)), (0, 0), (2, 2)), objectives=("exposure",), exposure=np.full((3, 3), 1e308))
