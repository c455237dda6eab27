"""Any-angle paths are legal by exact geometry, and the optimal ones as short as the visibility graph's (C4)."""

from __future__ import annotations

import math
import threading
from dataclasses import replace
from itertools import pairwise, product

import numpy as np
import pytest

from antway.errors import BadParameter, InvalidPlan
from antway.grid import Grid, Moves
from antway.kernels.search.theta import cells_along
from antway.planning import Budget, Plan, Problem, Status
from antway.search.anyangle import METHODS, _mesh, anyangle
from antway.verify import _segment_fault, check_plan
from common import SHARED, cases, costly, free_cells, needs_data, random_grid
from naive.dstarlite import grid_distance
from naive.visibility import VisibilityGraph

GREEDY = ("theta", "lazy-theta")


def ends(rng: np.random.Generator, grid: Grid) -> list[tuple[int, int]]:
    return [(int(r), int(c)) for r, c in rng.permutation(free_cells(grid))[:2]]


def test_optimal_on_random_grids() -> None:
    """On random grids up to 20 x 20 the length equals the visibility graph's optimum to 1e-9, and never exceeds the grid's."""
    rng = np.random.default_rng(4)
    for k in range(costly(300, 5000)):
        grid = random_grid(rng, 2, 20 if k % 10 == 0 else 11, (0.05, 0.6))
        if len(free_cells(grid)) < 2:
            continue
        pairs = [ends(rng, grid) for _ in range(4)]
        graph = VisibilityGraph(grid, {cell for pair in pairs for cell in pair})
        for start, goal in pairs:
            problem = Problem(grid, start, goal, Moves.EIGHT_NOSQUEEZE)
            plan = anyangle(problem)
            check_plan(problem, plan)
            wanted = graph.distances(start).get(goal, math.inf)
            assert plan.length == pytest.approx(wanted, rel=1e-9, abs=1e-9)
            assert plan.optimal == (plan.status is Status.FOUND)
            assert plan.length <= grid_distance(grid, start, goal, problem.moves) * (1 + 1e-12)


def test_all_small_grids() -> None:
    """On every grid of 3 x 3 cells, and nightly of 3 x 4, every pair of cells gets the visibility graph's optimum."""
    cols = 3 if cases(1, 2) == 1 else 4
    for bits in range(2 ** (3 * cols)):
        grid = Grid(np.array([bits >> k & 1 for k in range(3 * cols)], dtype=bool).reshape(3, cols))
        cells = [(int(r), int(c)) for r, c in free_cells(grid)]
        graph = VisibilityGraph(grid, cells)
        for start in cells:
            lengths = graph.distances(start)
            for goal in cells:
                assert anyangle(Problem(grid, start, goal)).length == pytest.approx(lengths.get(goal, math.inf), rel=1e-12)


@pytest.mark.parametrize("method", GREEDY)
def test_theta_is_legal_and_no_shorter_than_optimal(method: str) -> None:
    """Theta* and Lazy Theta* find a legal path exactly where there is one, no shorter than the optimum and the stated bound."""
    rng = np.random.default_rng(5)
    for _ in range(cases(150, 5000)):
        grid = replace(random_grid(rng, 2, 40, (0.05, 0.5)), resolution=0.5)
        if len(free_cells(grid)) < 2:
            continue
        problem = Problem(grid, *ends(rng, grid))
        best, plan = anyangle(problem), anyangle(problem, method=method)
        check_plan(problem, plan)
        assert plan.status is best.status
        assert plan.length >= best.length * (1 - 1e-12)
        assert plan.optimal == (plan.status is Status.FOUND and plan.gap == 0.0)
        assert not plan.optimal or plan.length == pytest.approx(best.length, rel=1e-12)
        assert plan.status is Status.NO_PATH or plan.lower_bound <= best.length


@pytest.mark.parametrize("method", GREEDY)
def test_theta_is_nearly_optimal(method: str) -> None:
    """On average its paths exceed the optimum by less than half of what the grid's shortest paths exceed it by."""
    rng = np.random.default_rng(10)
    found, shortest = [], []
    for _ in range(60):
        grid = random_grid(rng, 10, 30, (0.05, 0.35))
        problem = Problem(grid, *ends(rng, grid), Moves.EIGHT_NOSQUEEZE)
        best = anyangle(problem).length
        if math.isfinite(best):
            found.append(anyangle(problem, method=method).length / best - 1)
            shortest.append(grid_distance(grid, problem.start, problem.goal, problem.moves) / best - 1)
    assert np.mean(found) < 0.5 * np.mean(shortest)


@pytest.mark.parametrize("turn", [False, True])
def test_cells_along_a_line_of_the_lattice_are_on_the_side_of_the_last_one(turn: bool) -> None:
    """Both sides are free until a wall begins; the last two cells are beside it."""
    blocked = np.zeros((4, 8), bool)
    blocked[0, 4:] = True
    grid = Grid(blocked.T if turn else blocked)
    for row, rows in ((1, (0, 0, 0, 0, 1, 1)), (3, (1, 1, 1, 1, 1, 1))):
        path, cells = np.array([(row, 1), (2, 4), (2, 12)]), np.column_stack((rows, range(6)))
        if turn:
            path, cells = path[:, ::-1].copy(), cells[:, ::-1]
        assert cells_along(grid.blocked, path).tolist() == cells.tolist()


def test_equal_rows_are_one_rectangle_and_dead_ends_are_not_entered() -> None:
    """Of the teeth of a comb only that with the goal is looked into."""
    blocked = np.zeros((9, 31), bool)
    blocked[3:, ::3] = True
    grid = Grid(blocked)
    polygons, portals = _mesh(grid)[0], _mesh(grid)[2]
    assert (len(polygons), len(portals)) == (11, 10)
    assert anyangle(Problem(grid, (2, 0), (8, 29))).expanded == 1


def test_symmetries_keep_the_length() -> None:
    """Mirrored, transposed and with ends swapped, a problem keeps its any-angle length; scaled, the length scales (C6)."""
    rng = np.random.default_rng(6)
    for _ in range(cases(200, 2000)):
        grid = random_grid(rng, 2, 50, (0.0, 0.5))
        if len(free_cells(grid)) < 2:
            continue
        start, goal = ends(rng, grid)
        rows, _ = grid.shape
        length = anyangle(Problem(grid, start, goal)).length
        mirrored = Problem(Grid(grid.blocked[::-1]), (rows - 1 - start[0], start[1]), (rows - 1 - goal[0], goal[1]))
        others = [mirrored, Problem(Grid(grid.blocked.T), start[::-1], goal[::-1]), Problem(grid, goal, start)]
        for other in others:
            assert anyangle(other).length == pytest.approx(length, rel=1e-12)
        assert anyangle(Problem(replace(grid, resolution=0.1), start, goal)).length == pytest.approx(0.1 * length, rel=1e-12)


def test_many_equal_ways() -> None:
    """A chain of obstacles with two equal ways round each does not double the work with every obstacle."""
    blocked = np.zeros((5, 241), dtype=bool)
    blocked[2, 2::3] = True
    blocked[1:4, 1::24] = True
    plan = anyangle(Problem(Grid(blocked), (2, 0), (2, 240)))
    assert plan.expanded < 4000


@pytest.mark.parametrize("method", METHODS)
def test_start_is_goal(method: str) -> None:
    """Where the ends coincide the path is that point, of length 0."""
    problem = Problem(Grid(np.zeros((2, 2), dtype=bool)), (1, 0), (1, 0))
    plan = anyangle(problem, method=method)
    check_plan(problem, plan)
    assert (plan.length, plan.cells.tolist(), plan.points.tolist()) == (0.0, [[1, 0]], [[1.0, 0.0]])


@pytest.mark.parametrize("method", METHODS)
def test_never_squeezes(method: str) -> None:
    """Two diagonally touching blocked cells are a wall."""
    blocked = np.array([[False, True], [True, False]])
    plan = anyangle(Problem(Grid(blocked), (0, 0), (1, 1)), method=method)
    assert plan.status is Status.NO_PATH


@pytest.mark.parametrize("method", METHODS)
def test_expired_budget(method: str) -> None:
    """No time, or a cancellation, is Status.BUDGET without a path; the same call with time then succeeds."""
    blocked = np.zeros((9, 9), dtype=bool)
    blocked[:8, 4] = True
    problem = Problem(Grid(blocked), (0, 0), (0, 8))
    cancelled = threading.Event()
    cancelled.set()
    for budget in (Budget(seconds=0.0), Budget(cancel=cancelled)):
        plan = anyangle(problem, budget=budget, method=method)
        check_plan(problem, plan)
        assert plan.status is Status.BUDGET
    check_plan(problem, anyangle(problem, method=method))


@pytest.mark.parametrize("method", METHODS)
def test_large_searches_go_on_in_slices(method: str) -> None:
    """A search of more nodes than one slice or its first arrays hold ends with the same answer from both ends."""
    rng = np.random.default_rng(7)
    grid = Grid(rng.random((300, 300)) < 0.3)
    free = free_cells(grid)
    start, goal = tuple(map(int, free[0])), tuple(map(int, free[-1]))
    there, back = (anyangle(Problem(grid, *pair), method=method) for pair in ((start, goal), (goal, start)))
    check_plan(Problem(grid, start, goal), there)
    assert there.status is Status.FOUND
    assert there.expanded > 2048
    assert method != "polyanya" or there.length == pytest.approx(back.length, rel=1e-12)


@pytest.mark.parametrize("moves", [Moves.FOUR, Moves.EIGHT_CUT])
def test_refuses_moves_that_contradict(moves: Moves) -> None:
    """Moves that no any-angle path keeps to are refused by name, and so is an unknown method."""
    problem = Problem(Grid(np.zeros((2, 2), dtype=bool)), (0, 0), (1, 1), moves)
    with pytest.raises(BadParameter, match="moves"):
        anyangle(problem)
    with pytest.raises(BadParameter, match="method"):
        anyangle(replace(problem, moves=Moves.EIGHT), method="anya")


@needs_data
def test_known_maps() -> None:
    """On the benchmark maps, optimal paths are legal, no longer than the grid optimum and than Theta*'s."""
    rng = np.random.default_rng(8)
    for path in sorted((SHARED / "movingai").glob("*.map")):
        lines = path.read_text().splitlines()
        grid = Grid(np.array([[c not in ".G" for c in line] for line in lines[4:]]))
        rows = [line.split("\t") for line in path.with_suffix(".map.scen").read_text().splitlines()[1:]]
        for k in rng.permutation(len(rows))[: costly(6, 500)]:
            c0, r0, c1, r1 = map(int, rows[k][4:8])
            problem = Problem(grid, (r0, c0), (r1, c1))
            plan = anyangle(problem)
            check_plan(problem, plan)
            assert plan.length <= float(rows[k][8]) + 0.006
            assert plan.length <= anyangle(problem, method="lazy-theta").length * (1 + 1e-12)


def any_angle_plan(points: list[tuple[float, float]], cells: list[tuple[int, int]]) -> Plan:
    length = math.fsum(math.dist(a, b) for a, b in pairwise(points))
    return Plan(Status.FOUND, np.array(cells, dtype=np.int32), length, points=np.array(points, dtype=float))


def maps(*rows: str) -> Grid:
    return Grid(np.array([[c == "#" for c in row] for row in rows]))


@pytest.mark.parametrize(
    ("grid", "points", "cells", "fault"),
    [
        (maps("...", ".#.", "..."), [(0, 0), (0.5, 1.5), (1, 2)], [(0, 0), (0, 1), (1, 2)], ""),
        (maps("...", ".#.", "..."), [(0, 0), (0.5, 1.5), (1, 2)], [(0, 0), (0, 1), (0, 2), (1, 2)], ""),
        (maps("...", ".#.", "..."), [(0, 0), (0.5, 0.5), (0.5, 1.5), (0, 2)], [(0, 0), (0, 1), (0, 2)], ""),
        (maps("...", ".#.", "..."), [(0, 0), (0.6, 1.5), (1, 2)], [(0, 0), (0, 1), (1, 2)], r"enters \(1, 1\)"),
        (maps("...", ".#.", "..."), [(0, 0), (0.5, 1.5), (1, 2)], [(0, 0), (1, 2)], "neighbours"),
        (maps("...", ".#.", "..."), [(0, 0), (0.5, 1.5), (1, 2)], [(0, 0), (1, 0), (0, 1), (1, 2)], "in its turn"),
        (maps(".#", "#."), [(0, 0), (1, 1)], [(0, 0), (1, 1)], "touch diagonally"),
        (maps(".#.", ".#."), [(0, 0), (-0.5, 0.5), (-0.5, 1.5), (0, 2)], [(0, 0), (0, 1), (0, 2)], "runs between"),
        (maps(".##.", ".##."), [(0, 0), (0.5, 0.5), (0.5, 2.5), (0, 3)], [(0, 0), (0, 1), (0, 2), (0, 3)], "runs between"),
        (maps("..", ".."), [(0, 0), (-0.5, 0.5), (0, 1)], [(0, 0), (0, 1)], ""),
        (maps("..", ".."), [(0, 0), (-0.6, 0.5), (0, 1)], [(0, 0), (0, 1)], "off the map"),
        (maps("..", ".."), [(0, 0), (-3.0, 0.5), (0, 1)], [(0, 0), (0, 1)], "off the map"),
        (maps("..", ".."), [(0, 0), (0, 0.9)], [(0, 0), (0, 1)], "from start to goal"),
        (maps("..", ".."), [(0, 0), (0, math.nan)], [(0, 0), (0, 1)], "finite"),
    ],
)
def test_check_of_segments(grid: Grid, points: list[tuple[float, float]], cells: list[tuple[int, int]], fault: str) -> None:
    """The verifier takes what touches from outside, and names what enters, squeezes, leaves, jumps or strays."""
    problem = Problem(grid, cells[0], cells[-1])
    plan = any_angle_plan(points, cells)
    if not fault:
        check_plan(problem, plan)
        return
    with pytest.raises(InvalidPlan, match=fault):
        check_plan(problem, plan if math.isfinite(plan.length) else replace(plan, length=1.0))


def test_check_agrees_with_exact_sight() -> None:
    """For all segments between lattice points of small grids, the verifier says what exact integers say."""
    rng = np.random.default_rng(9)
    for _ in range(cases(20, 500)):
        grid = random_grid(rng, 2, 5, (0.1, 0.6))
        graph = VisibilityGraph(grid, [])
        lattice = [(y, x) for y, x in product(range(2 * grid.shape[0] + 1), range(2 * grid.shape[1] + 1)) if (y + x) % 2 == 0]
        for _ in range(200):
            p, q = (np.array(lattice[k]) for k in rng.integers(len(lattice), size=2))
            if (p != q).any():
                assert (_segment_fault(grid, (p - 1) / 2, (q - 1) / 2) == "") == graph.sees(p, q)
