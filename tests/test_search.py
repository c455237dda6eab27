"""Exact search: C1, C2, C3, C6, C7, C9, C21, costs, early stops."""

from __future__ import annotations

import gc
import itertools
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra as scipy_dijkstra

from antway import Grid, Moves, Plan, Problem, Status, check_plan, distance_field, load_map
from antway import grid as grids
from antway.errors import BadParameter
from antway.kernels.search.best_first import gauge
from antway.kernels.search.jps import jump, place
from antway.maps.movingai import load_scen
from antway.planning import Budget, Clock, start_clock
from antway.search import derived
from antway.search.astar import Searcher, astar, searcher
from antway.search.batch import solve_many
from antway.search.best_first import faces
from antway.search.costs import path_cost
from antway.search.derived import NEIGHBOURS
from antway.search.distance_field import dijkstra, spread_plan
from antway.search.jps import jps, jumps_pay
from antway.search.subgoals import hierarchy_of, subgoals
from common import SHARED, cases, free_cells, needs_data, pick, solvable
from naive import search as naive

EXACT = {"dijkstra": dijkstra, "astar": astar, "jps": jps, "subgoals": subgoals}
CORNER_RULES = {"cut": Moves.EIGHT_CUT, "nosqueeze": Moves.EIGHT_NOSQUEEZE, "nocut": Moves.EIGHT}


def scipy_field(grid: Grid, goal: tuple[int, int], moves: Moves) -> np.ndarray:
    """Distances in cells by SciPy's Dijkstra on the explicit graph of the three corner rules."""
    rows, cols = grid.shape
    free = np.pad(~grid.blocked, 1)
    here = free[1:-1, 1:-1]
    number = np.arange(rows * cols).reshape(rows, cols)
    since, end, length = [], [], []
    for dr, dc in [(0, 1), (1, 0), (1, 1), (1, -1)]:
        there = free[1 + dr : rows + 1 + dr, 1 + dc : cols + 1 + dc]
        one, other = free[1 + dr : rows + 1 + dr, 1:-1], free[1:-1, 1 + dc : cols + 1 + dc]
        sides = {Moves.EIGHT: one & other, Moves.EIGHT_NOSQUEEZE: one | other}.get(moves, True) if dr and dc else True
        at = np.nonzero(here & there & sides)
        since.append(number[at])
        end.append(number[at] + dr * cols + dc)
        length.append(np.full(len(at[0]), math.hypot(dr, dc)))
    shape = (rows * cols, rows * cols)
    graph = coo_array((np.concatenate(length), (np.concatenate(since), np.concatenate(end))), shape=shape).tocsr()
    return scipy_dijkstra(graph, directed=False, indices=number[goal]).reshape(rows, cols)


def same(length: float, expected: float) -> bool:
    """Equal to 1e-9, or both infinite."""
    return length == expected or math.isclose(length, expected, rel_tol=1e-9, abs_tol=1e-9)


@pytest.mark.parametrize("moves", CORNER_RULES.values(), ids=CORNER_RULES.keys())
def test_random_grids_against_scipy(moves: Moves) -> None:
    """C1: on random grids every planner and the distance field equal SciPy's Dijkstra to 1e-9, under each corner rule."""
    rng = np.random.default_rng(1)
    for k in range(cases(2000, 200_000)):
        grid = solvable(rng, high=80 if k % 25 == 0 else 64)  # some with more cells in a line than a word has bits
        start, goal = pick(rng, grid, 2)
        expected = scipy_field(grid, goal, moves)
        expected[grid.blocked] = np.inf
        np.testing.assert_allclose(distance_field(grid, goal, moves), expected, rtol=1e-9)
        problem = Problem(grid, start, goal, moves)
        for planner in EXACT.values():
            plan = planner(problem)
            assert same(plan.length, expected[start])
            assert plan.optimal == (plan.status is Status.FOUND) == math.isfinite(expected[start])
        check_plan(problem, plan)


@pytest.mark.parametrize("moves", Moves)
def test_random_grids_against_the_naive_twin(moves: Moves) -> None:
    """C7: under all moves the planners and fields, with and without costs, equal plain Dijkstra; every plan is legal."""
    rng = np.random.default_rng(2)
    for _ in range(cases(60, 1000)):
        grid = solvable(rng, low=2, high=10)
        start, goal, other = pick(rng, grid, 3)
        costs = rng.uniform(0.5, 5.0, grid.shape) * rng.choice([0.1, 1.0])
        expected = naive.field(grid, [goal], moves)
        np.testing.assert_allclose(distance_field(grid, goal, moves), expected, rtol=1e-12)
        np.testing.assert_allclose(
            distance_field(grid, [goal, other], moves), naive.field(grid, [goal, other], moves), rtol=1e-12
        )
        dear = naive.field(grid, [goal], moves, costs)
        np.testing.assert_allclose(distance_field(grid, goal, moves, costs=costs), dear, rtol=1e-12)
        problem = Problem(grid, start, goal, moves)
        for planner in EXACT.values():
            plan = planner(problem)
            check_plan(problem, plan)
            assert same(plan.length, expected[start])
        for planner in (dijkstra, astar):
            plan = planner(problem, costs=costs)
            check_plan(problem, plan)
            assert (plan.status is Status.FOUND) == math.isfinite(dear[start])
            if plan.status is Status.FOUND:
                assert not plan.optimal
                assert same(path_cost(plan.cells, costs, grid), dear[start])


def test_all_small_grids() -> None:
    """C2: on all grids up to 3 x 4, or a sample of them, all planners are right for all pairs of ends and all corner rules."""
    rng = np.random.default_rng(3)
    shapes = [(r, c) for r in range(1, 4) for c in range(1, 5)]
    for shape in shapes:
        patterns = np.arange(2 ** (shape[0] * shape[1]))
        for pattern in rng.permutation(patterns)[: cases(12, 4096)]:
            grid = Grid((pattern >> np.arange(shape[0] * shape[1]) & 1).astype(bool).reshape(shape))
            free = [(int(r), int(c)) for r, c in free_cells(grid)]
            for moves in NEIGHBOURS:
                for goal in free:
                    expected = naive.field(grid, [goal], moves)
                    assert np.allclose(distance_field(grid, goal, moves), expected, rtol=1e-12)
                    for start in free:
                        for planner in (astar, jps, subgoals):
                            assert same(planner(Problem(grid, start, goal, moves)).length, expected[start])


@needs_data
@pytest.mark.parametrize("path", sorted((SHARED / "movingai").glob("*.map")), ids=lambda path: path.stem)
def test_every_movingai_row(path) -> None:
    """C3: every planner finds the lengths of the MovingAI scenarios (rounded there: tolerance 0.006).

    On each fourth row, and in `make nightly` on every row.
    """
    grid, every = load_map(path), 1 if cases(1, 2) > 1 else 4
    for i, row in enumerate(load_scen(f"{path}.scen")[::every]):
        problem = Problem(grid, row.start, row.goal)
        for planner in EXACT.values():
            plan = planner(problem)
            assert plan.optimal
            assert abs(plan.length - row.length) <= 0.006
        if i % 5 == 0:
            check_plan(problem, plan)


@needs_data
def test_published_ant_grids() -> None:
    """The optima of the grids that ant papers share are reproduced under all corner rules."""
    optima = json.loads((SHARED / "grids" / "optima.json").read_text())["optimum"]
    for name, rules in optima.items():
        grid = load_map(SHARED / "grids" / f"{name}.txt")
        for rule, (length, _) in rules.items():
            problem = Problem(grid, (0, 0), (grid.shape[0] - 1, grid.shape[1] - 1), CORNER_RULES[rule])
            for planner in EXACT.values():
                assert abs(planner(problem).length - length) <= 1e-4


def test_metamorphic() -> None:
    """C6: mirrored, transposed and swapped problems cost the same; another blocked cell never less; resolution scales."""
    rng = np.random.default_rng(4)
    for _ in range(cases(1000, 20_000)):
        grid = solvable(rng, low=2, high=24)
        rows, cols = grid.shape
        (a, b), (c, d) = pick(rng, grid, 2)
        moves = NEIGHBOURS[rng.integers(4)]
        planner = list(EXACT.values())[rng.integers(len(EXACT))]
        length = planner(Problem(grid, (a, b), (c, d), moves)).length
        assert same(planner(Problem(Grid(grid.blocked[::-1]), (rows - 1 - a, b), (rows - 1 - c, d), moves)).length, length)
        assert same(planner(Problem(Grid(grid.blocked.T), (b, a), (d, c), moves)).length, length)
        assert same(planner(Problem(grid, (c, d), (a, b), moves)).length, length)
        assert same(planner(Problem(Grid(grid.blocked, 0.25), (a, b), (c, d), moves)).length, 0.25 * length)
        more = grid.blocked.copy()
        more[rng.integers(rows), rng.integers(cols)] = True
        if not (more[a, b] or more[c, d]):
            assert planner(Problem(Grid(more), (a, b), (c, d), moves)).length >= length - 1e-9


def test_queries_do_not_disturb_each_other() -> None:
    """C6, C9: used workspaces, past the point where labels are cleared, and threads give the answers of fresh ones."""
    from concurrent.futures import ThreadPoolExecutor

    rng = np.random.default_rng(5)
    grid = solvable(rng, low=40, high=60)
    ends = [pick(rng, grid, 2) for _ in range(300)]

    def lengths(planner) -> list[float]:
        return [planner(Problem(grid, a, b)).length for a, b in ends]

    expected = [float(distance_field(grid, b)[a]) for a, b in ends]
    for planner in (astar, jps, subgoals):
        assert np.allclose(lengths(planner), expected, rtol=1e-12)
        with ThreadPoolExecutor(4) as pool:
            for result in pool.map(lengths, [planner] * 4):
                assert np.allclose(result, expected, rtol=1e-12)


def test_changed_maps() -> None:
    """C9: a changed map is a new grid and is answered as such; the arrays of grids and plans refuse to be written."""
    rng = np.random.default_rng(6)
    for _ in range(cases(300, 3000)):
        grid = solvable(rng, low=2, high=16)
        start, goal = pick(rng, grid, 2)
        plan = jps(Problem(grid, start, goal))
        blocked = grid.blocked.copy()
        for r, c in plan.cells[1:-1]:
            blocked[r, c] = True
        changed = Grid(blocked)
        expected = naive.field(changed, [goal], Moves.EIGHT)[start]
        assert same(jps(Problem(changed, start, goal)).length, expected)
        assert same(jps(Problem(grid, start, goal)).length, plan.length)
        for array in (grid.blocked, plan.cells):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 1


def test_what_is_derived_dies_with_the_grid() -> None:
    """The data kept for a grid are freed with it."""
    gc.collect()
    before = len(grids._KEPT)
    grid = Grid(np.pad([[True]], (3, 4)))
    jps(Problem(grid, (0, 0), (7, 7)))
    solve_many(grid, [(0, 0)], [(7, 7)])
    times = iter([False, True])
    assert not hierarchy_of(grid).make(grid, SimpleNamespace(spent=lambda: next(times))), "time ran out amid the preparation"
    assert len(grids._KEPT) == before + 1
    del grid
    gc.collect()
    assert len(grids._KEPT) == before


def test_jumps() -> None:
    """C7: a jump along packed words ends where one along cells ends, for lines of up to 200 cells."""
    rng = np.random.default_rng(9)
    for _ in range(cases(40, 400)):
        rows, cols = rng.integers(1, 200, size=2)
        grid = Grid(rng.random((rows, cols)) < rng.choice([0.002, 0.02, 0.2]))
        words = derived.packed_lines(grid.blocked)
        for cell in [(int(r), int(c)) for r, c in free_cells(grid)[:: max(1, grid.blocked.size // 100)]]:
            for d in range(4):
                assert jump(words, *place(d, *cell, rows, cols)) == naive.jump(grid, cell, d)


@pytest.mark.parametrize("moves", Moves)
def test_heuristics_are_exact_on_empty_maps(moves: Moves) -> None:
    """The heuristic of A* is the exact distance on an empty map."""
    expected = naive.field(Grid(np.zeros((17, 17), dtype=bool)), [(8, 8)], moves)
    for row, col in itertools.product(range(17), repeat=2):
        assert math.isclose(gauge(row, col, 8, 8, faces(moves)), expected[row, col], rel_tol=1e-12)


@pytest.mark.parametrize("moves", Moves)
def test_astar_expands_what_it_has_to(moves: Moves) -> None:
    """Along a free line hardly more than the line, and where there is no path each cell that can be reached once."""
    rng, costs = np.random.default_rng(14), np.ones((17, 17))
    blocked = np.zeros((17, 17), dtype=bool)
    blocked[8, 4] = True  # so that the goal is not in sight
    for options in ({}, {"costs": costs}):
        assert 4 < astar(Problem(Grid(blocked), (8, 0), (8, 16), moves), **options).expanded < 80
        for _ in range(3):
            grid = Grid((rng.random((17, 17)) < 0.2) | (np.arange(17) == 12))
            row, col = free_cells(grid)[0].tolist()
            plan = astar(Problem(grid, (row, col), tuple(free_cells(grid)[-1].tolist()), moves), **options)
            assert plan.status is Status.NO_PATH
            assert plan.expanded == np.isfinite(naive.field(grid, [(row, col)], moves)).sum()


def test_paths_too_long_for_small_integers() -> None:
    """A path of more than 8,119 cells, beyond what the integers of A* can order, is still found, and exact."""
    blocked = np.zeros((301, 301), dtype=bool)
    blocked[1::4, :-1] = blocked[3::4, 1:] = True
    grid = Grid(blocked)
    problem = Problem(grid, (0, 0), (300, 300))
    expected = dijkstra(problem).length
    assert expected > 8119
    for planner in (astar, jps, subgoals):
        plan = planner(problem)
        check_plan(problem, plan)
        assert plan.length == expected


@pytest.mark.parametrize("moves", NEIGHBOURS)
def test_maps_too_long_for_small_integers(moves: Moves) -> None:
    """Across a map of more than 8,119 columns, and from its end round a wall to the same end, paths are found, and exact."""
    blocked = np.zeros((3, 9000), dtype=bool)
    blocked[1, :-1] = True
    grid = Grid(blocked)
    ends = [((0, 0), (0, 8999)), ((0, 0), (2, 0)), ((0, 8999), (2, 8900))]
    expected = [dijkstra(Problem(grid, *pair, moves)).length for pair in ends]
    assert expected[:2] == [8999.0, pytest.approx(2 * 8999, abs=2.0)]
    for planner in (astar, jps, subgoals):
        assert [planner(Problem(grid, *pair, moves)).length for pair in ends] == expected
    routes = solve_many(grid, *zip(*ends), moves)
    assert routes.lengths.tolist() == expected
    assert [path[-1].tolist() for path in routes] == [list(goal) for _, goal in ends]


def test_maps_of_more_cells_than_labels_can_name(monkeypatch: pytest.MonkeyPatch) -> None:
    """They are answered by Dijkstra's search, and refused for many queries at once."""
    asked: list[Problem] = []
    monkeypatch.setattr("antway.search.astar.MOST_CELLS", 12)
    monkeypatch.setattr("antway.search.batch.MOST_CELLS", 12)

    def asked_plan(problem: Problem, clock: Clock) -> Plan:
        asked.append(problem)
        return spread_plan(problem, clock)

    monkeypatch.setattr("antway.search.astar.spread_plan", asked_plan)
    for columns in (11, 12):
        grid = Grid(np.zeros((1, columns), dtype=bool))
        assert astar(Problem(grid, (0, 0), (0, 3))).length == 3.0
        assert len(asked) == (columns == 12)
    with pytest.raises(BadParameter, match=r"grid\.shape"):
        solve_many(grid, [(0, 0)], [(0, 3)])


@given(st.integers(2, 9), st.integers(0, 2**81 - 1), st.sampled_from(NEIGHBOURS))
def test_jps_equals_dijkstra(size: int, bits: int, moves: Moves) -> None:
    """Hypothesis finds no grid, corner to corner, on which jps and Dijkstra differ."""
    blocked = (np.array([bits >> i & 1 for i in range(size * size)], dtype=bool)).reshape(size, size)
    blocked[0, 0] = blocked[-1, -1] = False
    problem = Problem(Grid(blocked), (0, 0), (size - 1, size - 1), moves)
    assert same(jps(problem).length, dijkstra(problem).length)


@pytest.mark.skipif(cases(1, 2) == 1, reason="large maps run in make nightly")
def test_large_maps() -> None:
    """C21: a map of 4096 x 4096 cells is answered by every planner and the field."""
    rng = np.random.default_rng(10)
    grid = Grid(np.kron(rng.random((256, 256)) < 0.2, np.ones((16, 16), dtype=bool)))
    start, goal = pick(rng, grid, 2)
    field = distance_field(grid, goal)
    for planner in EXACT.values():
        assert same(planner(Problem(grid, start, goal)).length, field[start])


def test_the_searcher_is_made_once() -> None:
    """What is derived from a grid is made once and shared; another grid gets its own."""
    grid = Grid(np.zeros((4, 4), dtype=bool))
    assert isinstance(searcher(grid, Moves.EIGHT, True), Searcher)
    assert searcher(grid, Moves.EIGHT, True) is searcher(grid, Moves.EIGHT, True)
    assert searcher(Grid(grid.blocked), Moves.EIGHT, True) is not searcher(grid, Moves.EIGHT, True)


def test_where_jumps_pay() -> None:
    """Jumps are left out on large maps strewn with single cells alone, and the answer is the same."""
    rng = np.random.default_rng(12)
    strewn, small = rng.random((1100, 1100)) < 0.1, rng.random((500, 500)) < 0.1
    walls = np.zeros((1100, 1100), dtype=bool)
    walls[::50, :-5] = True
    assert [jumps_pay(Grid(blocked)) for blocked in (strewn, small, walls, walls.T)] == [False, True, True, True]
    grid = Grid(strewn)
    start, goal = pick(rng, grid, 2)
    assert jps(Problem(grid, start, goal)).length == astar(Problem(grid, start, goal)).length


def test_a_start_with_as_many_jump_points_as_can_be() -> None:
    """From the middle of a hall with pillars beside its walls, diagonals pass jump points at each cell, all with space."""
    for n in (21, 101, 201):
        pillars, middle = np.zeros((n, n), dtype=bool), n // 2
        far = np.arange(6, n - 6, 3)
        pillars[2, far] = pillars[n - 3, far] = pillars[far, 2] = pillars[far, n - 3] = True
        pillars[1, : middle + 3] = True  # the goal is not in sight
        problem = Problem(Grid(pillars), (middle, middle), (0, middle))
        search = searcher(problem.grid, Moves.EIGHT, jumping=True)
        work = search.workspace()
        rows = len(work.memory.reached)
        whole = np.full((2 * rows, 4), -7, np.int32)
        work.memory = work.memory._replace(reached=whole[:rows])
        search.spare.append(work)
        plan = search.plan(problem, start_clock(problem, 0, Budget()))
        check_plan(problem, plan)
        assert plan.length == dijkstra(problem).length
        assert (whole[rows:] == -7).all() and (whole[: 2 * n] != -7).any()


def test_no_jump_is_longer_than_costs_in_32_bits() -> None:
    """A jump along a very long map could lead far beyond the goal; there the search moves cell by cell."""
    assert jumps_pay(Grid(np.zeros((1, 2**18), dtype=bool))) and not jumps_pay(Grid(np.zeros((1, 2**18 + 1), dtype=bool)))
