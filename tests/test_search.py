"""Exact search: C1, C2, C3, C6, C7, C9, C21, costs, early stops."""

from __future__ import annotations

import gc
import itertools
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra as scipy_dijkstra

from antway import Grid, Moves, Plan, Problem, Status, check_plan, distance_field, load_map
from antway.errors import BadParameter, CellBlocked, OutOfBounds
from antway.kernels.bestfirst import gauge
from antway.kernels.canonical import START
from antway.kernels.jps import jump, place
from antway.maps.movingai import load_scen
from antway.search import derived
from antway.search import dijkstra as dijkstra_module
from antway.search.astar import Searcher, astar, searcher
from antway.search.batch import solve_many
from antway.search.costs import inflation_costs, path_cost
from antway.search.dijkstra import dijkstra
from antway.search.heap import faces
from antway.search.jps import jps, jumps_pay
from antway.search.subgoals import subgoals
from common import SHARED, cases, free_cells, needs_data, random_grid
from naive import search as naive

EXACT = {"dijkstra": dijkstra, "astar": astar, "jps": jps, "subgoals": subgoals}
NEIGHBOURS = [Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT]
CORNER_RULES = {"cut": Moves.EIGHT_CUT, "nosqueeze": Moves.EIGHT_NOSQUEEZE, "nocut": Moves.EIGHT}


def scipy_field(grid: Grid, goal: tuple[int, int], moves: Moves) -> np.ndarray:
    """Distances in cells by SciPy's Dijkstra on the explicit graph of the three corner rules."""
    rows, cols = grid.shape
    free = np.pad(~grid.blocked, 1)
    here = free[1:-1, 1:-1]
    number = np.arange(rows * cols).reshape(rows, cols)
    begin, end, length = [], [], []
    for dr, dc in [(0, 1), (1, 0), (1, 1), (1, -1)]:
        there = free[1 + dr : rows + 1 + dr, 1 + dc : cols + 1 + dc]
        one, other = free[1 + dr : rows + 1 + dr, 1:-1], free[1:-1, 1 + dc : cols + 1 + dc]
        sides = {Moves.EIGHT: one & other, Moves.EIGHT_NOSQUEEZE: one | other}.get(moves, True) if dr and dc else True
        at = np.nonzero(here & there & sides)
        begin.append(number[at])
        end.append(number[at] + dr * cols + dc)
        length.append(np.full(len(at[0]), math.hypot(dr, dc)))
    shape = (rows * cols, rows * cols)
    graph = coo_array((np.concatenate(length), (np.concatenate(begin), np.concatenate(end))), shape=shape).tocsr()
    return scipy_dijkstra(graph, directed=False, indices=number[goal]).reshape(rows, cols)


def pick(rng: np.random.Generator, grid: Grid, n: int) -> list[tuple[int, int]]:
    """n random free cells."""
    free = free_cells(grid)
    return [(int(r), int(c)) for r, c in free[rng.integers(len(free), size=n)]]


def solvable(rng: np.random.Generator, **size: int) -> Grid:
    """A random grid with a free cell."""
    while not len(free_cells(grid := random_grid(rng, **size))):
        pass
    return grid


def same(length: float, expected: float) -> bool:
    """Equal to 1e-9, or both infinite."""
    return length == expected or math.isclose(length, expected, rel_tol=1e-9, abs_tol=1e-9)


@pytest.mark.parametrize("moves", CORNER_RULES.values(), ids=CORNER_RULES.keys())
def test_random_grids_against_scipy(moves: Moves) -> None:
    """C1: on random grids every planner and the distance field equal SciPy's Dijkstra to 1e-9, under each corner rule."""
    rng = np.random.default_rng(1)
    for _ in range(cases(2000, 200_000)):
        grid = solvable(rng)
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
        grid = solvable(rng, low=2, high=12)
        start, goal, other = pick(rng, grid, 3)
        costs = rng.uniform(0.5, 5.0, grid.shape)
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

    jps and subgoals on every row, the others on every row in `make nightly` and on each fourth else.
    """
    grid = load_map(path)
    for i, row in enumerate(load_scen(f"{path}.scen")):
        problem = Problem(grid, row.start, row.goal)
        for planner in EXACT.values() if i % 4 == 0 or cases(1, 2) > 1 else [jps, subgoals]:
            plan = planner(problem)
            assert plan.optimal
            assert abs(plan.length - row.length) <= 0.006
        if i % 20 == 0:
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


@pytest.mark.parametrize("moves", NEIGHBOURS)
def test_many_queries_at_once(moves: Moves) -> None:
    """Routes of many queries have the lengths and, cell by cell, are as legal as those of one query each."""
    rng = np.random.default_rng(11)
    for size in (6, 90):
        grid = Grid(solvable(rng, low=size, high=size + 9).blocked, 0.5)
        ends = [pick(rng, grid, 2) for _ in range(cases(600, 5000))]
        routes = solve_many(grid, [a for a, _ in ends], [b for _, b in ends], moves)
        for i, (a, b) in enumerate(ends):
            expected = jps(Problem(grid, a, b, moves))
            assert same(routes.lengths[i], expected.length)
            assert np.array_equal(routes[i], expected.cells)
    assert len(solve_many(grid, [], [], moves)) == 0
    blocked = np.zeros((301, 301), dtype=bool)
    blocked[1::4, :-1] = blocked[3::4, 1:] = True
    winding = Grid(blocked)
    ends = [((0, 0), (0, 300)), ((0, 0), (300, 300)), ((300, 300), (300, 0))]
    routes = solve_many(winding, [a for a, _ in ends], [b for _, b in ends], moves)
    for i, (a, b) in enumerate(ends):
        plan = dijkstra(Problem(winding, a, b, moves))
        assert same(routes.lengths[i], plan.length)
        check_plan(Problem(winding, a, b, moves), Plan(Status.FOUND, routes[i].copy(), float(routes.lengths[i])))


def test_bad_batches() -> None:
    """Ends that are blocked, outside, of the wrong kind or number raise the error that names which."""
    blocked = np.zeros((3, 3), dtype=bool)
    blocked[1, 1] = True
    grid = Grid(blocked)
    with pytest.raises(CellBlocked, match=r"goals\[1\]"):
        solve_many(grid, [(0, 0), (0, 0)], [(0, 1), (1, 1)])
    with pytest.raises(OutOfBounds, match=r"starts\[0\]"):
        solve_many(grid, [(-1, 0)], [(0, 1)])
    for starts, goals in (([(0.5, 0)], [(0, 0)]), ([(0, 0)], [(0, 0), (0, 0)]), ([0, 0], [0, 0]), ("ab", "cd")):
        with pytest.raises(BadParameter):
            solve_many(grid, starts, goals)
    with pytest.raises(BadParameter, match="moves"):
        solve_many(grid, [(0, 0)], [(0, 0)], Moves.SIXTEEN)


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
    before = len(derived._KEPT)
    grid = Grid(np.zeros((8, 8), dtype=bool))
    jps(Problem(grid, (0, 0), (7, 7)))
    assert len(derived._KEPT) == before + 1
    del grid
    gc.collect()
    assert len(derived._KEPT) == before


def test_early_stops() -> None:
    """A field with `until` or `within` is exact wherever it is finite, covers what was asked, and nothing farther."""
    rng = np.random.default_rng(7)
    for moves, _ in itertools.product(Moves, range(cases(40, 400))):
        grid = Grid(solvable(rng, low=2, high=40).blocked, 0.1)
        goal, target = pick(rng, grid, 2)
        full = distance_field(grid, goal, moves)
        partial = distance_field(grid, goal, moves, until=target)
        finite = np.isfinite(partial)
        assert np.array_equal(partial[finite], full[finite])
        assert partial[target] == full[target]
        limit = float(rng.choice(full[np.isfinite(full)]))
        assert np.array_equal(distance_field(grid, goal, moves, within=limit), np.where(full <= limit, full, np.inf))


@pytest.mark.parametrize("moves", NEIGHBOURS)
def test_canonical_tables(moves: Moves) -> None:
    """C7: the surroundings and canonical successors equal their naive twins, for all 256 surroundings and all directions."""
    table = derived.successors(moves).reshape(256, 9)
    for bits in range(256):
        legal = {d for d in range(8) if bits >> d & 1 and (d < 4 or moves is not Moves.FOUR)}
        for came in range(4 if moves is Moves.FOUR else 8):
            assert {d for d in range(8) if table[bits, came] >> d & 1} == naive.canonical(bits, came, moves)
        assert {d for d in range(8) if table[bits, START] >> d & 1} <= legal
    rng = np.random.default_rng(8)
    for _ in range(cases(30, 300)):
        grid = random_grid(rng, 1, 20)
        assert np.array_equal(derived.lattice(grid, moves).around.reshape(grid.shape), naive.surroundings(grid))


def test_jumps() -> None:
    """C7: a jump along packed words ends where one along cells ends, for lines of up to 200 cells."""
    rng = np.random.default_rng(9)
    for _ in range(cases(40, 400)):
        rows, cols = rng.integers(1, 200, size=2)
        grid = Grid(rng.random((rows, cols)) < rng.choice([0.002, 0.02, 0.2]))
        words = derived.packed(grid)
        for cell in [(int(r), int(c)) for r, c in free_cells(grid)[:: max(1, grid.blocked.size // 100)]]:
            for d in range(4):
                assert jump(words, *place(d, *cell, rows, cols)) == naive.jump(grid, cell, d)


@pytest.mark.parametrize("moves", Moves)
def test_heuristics_are_exact_on_empty_maps(moves: Moves) -> None:
    """The heuristic of A* is the exact distance on an empty map."""
    expected = naive.field(Grid(np.zeros((25, 25), dtype=bool)), [(12, 12)], moves)
    for row, col in itertools.product(range(4, 21), repeat=2):
        assert math.isclose(gauge(row, col, 12, 12, faces(moves)), expected[row, col], rel_tol=1e-12)


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


def test_inflation_costs() -> None:
    """Costs fall off as in Nav2's inflation layer: the formula, the plateau, the edge."""
    blocked = np.zeros((21, 41), dtype=bool)
    blocked[10, 20] = True
    grid = Grid(blocked, resolution=0.1)
    costs = inflation_costs(grid, 0.2, 0.8, scaling=5.0, most=253.0)
    clearance = grid.clearance()
    decay = 1 + 252 * np.exp(-5.0 * (clearance - 0.2))
    expected = np.where(clearance <= 0.2, 253.0, np.where(clearance <= 0.8, decay, 1.0))
    np.testing.assert_allclose(costs, expected, rtol=1e-12)


def test_costs_change_the_way() -> None:
    """A dear corridor is left for a detour just when the detour costs less."""
    blocked = np.zeros((5, 9), dtype=bool)
    blocked[1:4, 2:7] = True
    blocked[2, 2:7] = False
    costs = np.ones(blocked.shape)
    problem = Problem(Grid(blocked), (2, 0), (2, 8))
    for dear, straight in ((1.2, True), (3.0, False)):
        costs[2, 2:7] = dear
        assert (len(np.unique(astar(problem, costs=costs).cells[:, 0])) == 1) == straight


@pytest.mark.parametrize("bad", [-1.0, 0.0, math.nan, math.inf, 1e7], ids=str)
def test_bad_costs(bad: float) -> None:
    """A cost that is negative, zero, NaN, infinite or too large is refused by name, wherever it stands."""
    blocked = np.zeros((3, 3), dtype=bool)
    blocked[1, 1] = True
    grid = Grid(blocked)
    for cell in ((0, 0), (1, 1)):
        costs = np.ones((3, 3))
        costs[cell] = bad
        for call in (
            lambda costs=costs: dijkstra(Problem(grid, (0, 0), (2, 2)), costs=costs),
            lambda costs=costs: astar(Problem(grid, (0, 0), (2, 2)), costs=costs),
            lambda costs=costs: distance_field(grid, (0, 0), costs=costs),
        ):
            with pytest.raises(BadParameter, match="costs"):
                call()
    with pytest.raises(BadParameter, match=r"costs\.shape"):
        dijkstra(Problem(grid, (0, 0), (2, 2)), costs=np.ones((3, 4)))


def test_bad_fields() -> None:
    """Goals that are no free cells of the map, and numbers out of range, raise the error that names them."""
    blocked = np.zeros((3, 3), dtype=bool)
    blocked[1, 1] = True
    grid = Grid(blocked)
    for error, goal in ((OutOfBounds, (3, 0)), (CellBlocked, (1, 1)), (CellBlocked, [(0, 0), (1, 1)]), (BadParameter, "00")):
        with pytest.raises(error, match="goal"):
            distance_field(grid, goal)
    for goal in ([], 7, (0.5, 0), (0, 0, 0), None):
        with pytest.raises(BadParameter, match="goal"):
            distance_field(grid, goal)
    with pytest.raises(BadParameter, match="within"):
        distance_field(grid, (0, 0), within=math.nan)
    with pytest.raises(CellBlocked, match="until"):
        distance_field(grid, (0, 0), until=(1, 1))


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
    assert [jumps_pay(Grid(blocked)) for blocked in (strewn, small, walls)] == [False, True, True]
    grid = Grid(strewn)
    start, goal = pick(rng, grid, 2)
    assert jps(Problem(grid, start, goal)).length == astar(Problem(grid, start, goal)).length


def test_lists_grow() -> None:
    """A field whose open lists outgrow their first room, from many goals at once, is exact."""
    grid = Grid(np.zeros((200, 200), dtype=bool))
    goals = [(r, c) for r in range(0, 200, 2) for c in range(0, 200, 2)]
    assert len(goals) * 3 > 1 << 12
    field = distance_field(grid, goals)
    assert set(np.unique(field.round(9))) == {0.0, 1.0, round(math.sqrt(2), 9)}
    assert isinstance(dijkstra_module.STEPS, int)
    assert isinstance(jps(Problem(grid, (0, 0), (5, 5))), Plan)
