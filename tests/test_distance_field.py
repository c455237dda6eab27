"""Distance fields, canonical successors, and costs of cells: C7, early stops, bad input."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from antway import Grid, Moves, Problem, distance_field
from antway.errors import BadParameter, CellBlocked, OutOfBounds
from antway.kernels.search.canonical import NEED, START, successor_table
from antway.kernels.search.distance_field import EXPANDED
from antway.kernels.search.lengths import FINE_DIAGONAL, FINE_STRAIGHT
from antway.search import derived
from antway.search.astar import astar
from antway.search.costs import inflation_costs, path_cost
from antway.search.derived import NEIGHBOURS, lattice
from antway.search.distance_field import DijkstraField, dijkstra
from common import cases, pick, random_grid, solvable
from naive import search as naive


@pytest.mark.parametrize("moves", NEIGHBOURS)
def test_canonical_tables(moves: Moves) -> None:
    """C7: the surroundings and canonical successors equal their naive twins, for all 256 surroundings and all directions."""
    table = successor_table(NEED[moves.value]).reshape(9, 256)
    for bits in range(256):
        legal = {d for d in range(8) if bits >> d & 1 and (d < 4 or moves is not Moves.FOUR)}
        for came in range(4 if moves is Moves.FOUR else 8):
            assert {d for d in range(8) if table[came, bits] >> d & 1} == naive.canonical(bits, came, moves)
        assert {d for d in range(8) if table[START, bits] >> d & 1} <= legal
    rng = np.random.default_rng(8)
    for _ in range(cases(30, 300)):
        grid = random_grid(rng, 1, 20)
        assert np.array_equal(derived.lattice(grid, moves).around.reshape(grid.shape), naive.surroundings(grid))


def test_early_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    """A field with `until` or `within` is exact wherever it is finite, covers what was asked, and nothing farther."""
    rng, early = np.random.default_rng(7), dict.fromkeys(Moves, 0)
    monkeypatch.setattr("antway.search.best_first.STEPS", 9)
    for moves, _ in itertools.product(Moves, range(cases(40, 400))):
        grid = Grid(solvable(rng, low=2, high=40).blocked, 0.1)
        goal, *targets = pick(rng, grid, int(rng.integers(2, 4)))
        target = max(targets, key=(full := distance_field(grid, [goal], moves)).__getitem__)  # the last to be reached
        partial = distance_field(grid, goal, moves, until=targets if len(targets) > 1 else target)
        finite = np.isfinite(partial)
        assert np.array_equal(partial[finite], full[finite])
        assert partial[target] == full[target]
        assert (full[~finite] >= full[target]).all()
        early[moves] += finite.sum() < np.isfinite(full).sum()
        limit = float(rng.choice(full[np.isfinite(full)]))
        near = full <= limit * (1 + 1e-12)  # sums of other moves may differ in their last digit
        assert np.array_equal(distance_field(grid, goal, moves, within=limit), np.where(near, full, np.inf))
    assert min(early.values()) >= cases(40, 400) // 20


def test_lists_grow() -> None:
    """A field whose open cells outgrow their first room, from many goals at once, is exact."""
    grid = Grid(np.random.default_rng(10).random((200, 200)) < 0.3)
    goals = pick(np.random.default_rng(11), grid, 1000)
    search = DijkstraField(derived.lattice(grid, Moves.EIGHT), goals, [])
    room = len(search.memory.entries)
    search.run(None)
    assert len(search.memory.entries) > room
    np.testing.assert_allclose(distance_field(grid, goals), naive.field(grid, goals, Moves.EIGHT), rtol=1e-12)


def test_bad_fields() -> None:
    """Goals that are no free cells of the map, and numbers out of range, raise the error that names them."""
    blocked = np.zeros((3, 3), dtype=bool)
    blocked[1, 1] = True
    grid = Grid(blocked)
    for error, goal in ((OutOfBounds, (3, 0)), (CellBlocked, (1, 1)), (CellBlocked, [(0, 0), (1, 1)]), (BadParameter, "00")):
        with pytest.raises(error, match="goal"):
            distance_field(grid, goal)
    for goal in ([], 7, (0.5, 0), (0, 0, 0), None, np.array(5)):
        with pytest.raises(BadParameter, match="goal"):
            distance_field(grid, goal)
    with pytest.raises(BadParameter, match="within"):
        distance_field(grid, (0, 0), within=math.nan)
    with pytest.raises(CellBlocked, match="until"):
        distance_field(grid, (0, 0), until=(1, 1))


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
    assert (inflation_costs(grid, 0.2, 0.8, most=1.0) == 1.0).all()
    assert (inflation_costs(grid, 0.0, math.inf, scaling=0.0) == 253.0).all()
    assert np.array_equal(inflation_costs(grid, 0.2, 0.8), inflation_costs(grid, 0.2, 0.8, scaling=10.0, most=253.0))
    assert np.array_equal(inflation_costs(grid, 0.2, 0.2), np.where(clearance <= 0.2, 253.0, 1.0))


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


def test_a_path_has_whole_cells() -> None:
    """Fractions of cells, and cells off the map, have no cost."""
    grid, costs = Grid(np.zeros((2, 3), dtype=bool)), np.ones((2, 3))
    assert path_cost([(0.0, 0.0), (0.0, 2.0)], costs, grid) == 2.0
    for error, path in ((BadParameter, [(0.9, 0.2), (1, 0.2)]), (OutOfBounds, [(0, 0), (0, 3)]), (OutOfBounds, [(1e300, 0)])):
        with pytest.raises(error, match="cells"):
            path_cost(path, costs, grid)


@pytest.mark.parametrize("bad", [-1.0, 0.0, 9e-7, math.nan, math.inf, 1.1e6], ids=str)
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
    for edge in (1e-6, 1e6):
        assert math.isclose(path_cost([(0, 0), (0, 1)], np.full((3, 3), edge), grid), edge)
    with pytest.raises(BadParameter, match=r"costs\.shape"):
        dijkstra(Problem(grid, (0, 0), (2, 2)), costs=np.ones((3, 4)))


def test_a_search_that_starts_again_ends_at_its_targets() -> None:
    """As few cells are expanded after a restart as in a search of its own, and distances are the same."""
    net = lattice(Grid(np.zeros((400, 400), dtype=bool)), Moves.EIGHT)
    field = DijkstraField(net, [(200, 200)], [(200, 210)])
    field.run(None)
    first, target = int(field.state[EXPANDED]), np.array([net.at((200, 210))])
    for _ in range(3):
        field.restart(net.at((200, 200)), target)
        field.run(None)
        assert field.distances(target)[0] == 10 * FINE_STRAIGHT
        assert int(field.state[EXPANDED]) == first < 1000


def test_distances_after_a_restart_are_those_of_a_new_search() -> None:
    """Also along a diagonal, the longest path for its cells, and where labels become too large for float64 and are cleared."""
    n = 500
    net = lattice(Grid(~np.eye(n, dtype=bool)), Moves.EIGHT_CUT)
    cells = np.arange(n) * (n + 1)
    field = DijkstraField(net, [(0, 0)], [])
    for k in range(6):
        if k == 3:
            field.base = 3 * n - 2**53 // FINE_STRAIGHT
        source = k % 2 * (n - 1)
        field.restart(int(cells[source]), np.empty(0, np.int64))
        field.run(None)
        assert field.distances(cells).tolist() == [abs(i - source) * FINE_DIAGONAL for i in range(n)]
