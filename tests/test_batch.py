"""Many queries on one map at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from antway import Grid, Moves, Plan, Problem, Status, check_plan
from antway.errors import BadParameter, CellBlocked, OutOfBounds
from antway.kernels.search.astar import solve_all
from antway.search.astar import searcher
from antway.search.batch import solve_many
from antway.search.derived import NEIGHBOURS
from antway.search.distance_field import dijkstra
from antway.search.jps import jps
from antway.search.subgoals import prepare, subgoals
from common import cases, costly, pick, solvable


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
            assert math.isclose(routes.lengths[i], expected.length, rel_tol=1e-12)
            assert np.array_equal(routes[i], expected.cells)
    assert len(solve_many(grid, [], [], moves)) == 0
    blocked = np.zeros((301, 301), dtype=bool)
    blocked[1::4, :-1] = blocked[3::4, 1:] = True
    winding = Grid(blocked)
    ends = [((0, 0), (0, 300)), ((0, 0), (300, 300)), ((300, 300), (300, 0))]
    routes = solve_many(winding, [a for a, _ in ends], [b for _, b in ends], moves)
    for i, (a, b) in enumerate(ends):
        plan = dijkstra(Problem(winding, a, b, moves))
        assert math.isclose(routes.lengths[i], plan.length, rel_tol=1e-12)
        check_plan(Problem(winding, a, b, moves), Plan(Status.FOUND, routes[i].copy(), float(routes.lengths[i])))


def test_many_queries_on_a_prepared_map() -> None:
    """On a prepared map routes have the same lengths, are legal, and are those of the planner `subgoals`."""
    rng = np.random.default_rng(12)
    for size in (2, 24):
        grid = Grid(np.kron(rng.random((size, size + 9)) < 0.2, np.ones((4, 4), dtype=bool)), 0.5)
        starts, goals = pick(rng, grid, costly(600, 5000)), pick(rng, grid, costly(600, 5000))
        plain = solve_many(Grid(grid.blocked, 0.5), starts, goals)
        assert prepare(grid)
        routes = solve_many(grid, starts, goals)
        assert np.array_equal(routes.lengths, plain.lengths)
        for i, (a, b) in enumerate(zip(starts, goals)):
            assert np.array_equal(routes[i], subgoals(Problem(grid, a, b)).cells)
            if len(routes[i]):
                check_plan(Problem(grid, a, b), Plan(Status.FOUND, routes[i].copy(), float(routes.lengths[i])))
    blocked = np.zeros((301, 301), dtype=bool)
    blocked[1::4, :-1] = blocked[3::4, 1:] = True
    winding = Grid(blocked)
    assert prepare(winding)
    ends = [(0, 0)] * 40, [(300, 300)] * 40
    assert np.array_equal(solve_many(winding, *ends).lengths, solve_many(Grid(blocked), *ends).lengths)


def test_an_interruption_spoils_no_later_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C just after the kernel leaves no workspace behind whose labels look newer than they are."""
    blocked = np.zeros((9, 9), dtype=bool)
    blocked[4, :-1] = True
    grid = Grid(blocked)

    def interrupted(*arguments: Any) -> None:
        solve_all(*arguments)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("antway.search.batch.solve_all", interrupted)
        with pytest.raises(KeyboardInterrupt):
            solve_many(grid, [(0, 0)] * 9, [(8, 0)] * 9)
    assert jps(Problem(grid, (0, 0), (8, 1))).status is Status.FOUND


def test_paths_of_more_cells_than_there_is_room_for_at_first() -> None:
    """A few paths through a winding corridor: the room for all cells grows more than once."""
    blocked = np.zeros((61, 61), dtype=bool)
    blocked[1::4, :-1] = blocked[3::4, 1:] = True
    grid, ends = Grid(blocked), [((60, 60), (0, 0)), ((0, 0), (0, 9)), ((0, 0), (60, 60)), ((60, 60), (0, 0))]
    routes = solve_many(grid, *zip(*ends))
    assert len(routes.cells) > 2 * (64 * len(ends) + 1024)
    for i, pair in enumerate(ends):
        plan = jps(Problem(grid, *pair))
        assert routes.lengths[i] == plan.length and np.array_equal(routes[i], plan.cells)


@pytest.mark.parametrize("moves", NEIGHBOURS)
def test_a_queue_that_is_full_grows(moves: Moves) -> None:
    """With room for two entries at first, one query and many have the answers that they have with room for all."""
    rng = np.random.default_rng(13)
    grid = Grid(rng.random((40, 40)) < 0.3)
    ends = [pick(rng, grid, 2) for _ in range(20)]
    search = searcher(grid, moves, moves is Moves.EIGHT)
    expected = solve_many(Grid(grid.blocked), *zip(*ends), moves)
    for many in (True, False):
        work = search.workspace()
        few = np.empty((len(work.memory.reached) + 2, 5), np.int32)
        work.memory = work.memory._replace(queue=work.memory.queue._replace(entries=few))
        search.spare[:] = [work]
        one_by_one = (jps(Problem(grid, *pair, moves)).cells for pair in ends)
        found = list(solve_many(grid, *zip(*ends), moves) if many else one_by_one)
        assert all(map(np.array_equal, found, expected))
        assert search.spare == [work] and len(work.memory.queue.entries) > len(few)


def test_bad_batches() -> None:
    """Ends that are blocked, outside, of the wrong kind or number raise the error that names which."""
    blocked = np.zeros((3, 4), dtype=bool)
    blocked[1, 3] = True
    grid = Grid(blocked)
    with pytest.raises(CellBlocked, match=r"goals\[1\]"):
        solve_many(grid, [(0, 0), (0, 0)], [(0, 1), (1, 3)])
    for row in (-1, 3):
        with pytest.raises(OutOfBounds, match=r"starts\[1\]"):
            solve_many(grid, [(0, 0), (row, 0)], [(0, 1), (0, 1)])
    for starts, goals in (
        ([(0.5, 0)], [(0, 0)]),
        ([(0, 0)], [(0, 0), (0, 0)]),
        ([0, 0], [0, 0]),
        ("ab", "cd"),
        ([(0, 0), (1,)], []),
        ([[], []], []),
        (np.empty((0, 3)), []),
    ):
        with pytest.raises(BadParameter):
            solve_many(grid, starts, goals)
    with pytest.raises(BadParameter, match="moves"):
        solve_many(grid, [(0, 0)], [(0, 0)], Moves.SIXTEEN)
