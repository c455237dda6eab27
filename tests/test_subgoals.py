"""Subgoals: what sees what, the contraction hierarchy, preparation in pieces, and where it does not pay."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra as scipy_dijkstra

from antway import Budget, Grid, Problem, Status, check_plan, solve
from antway.errors import BadParameter
from antway.grid import Moves
from antway.kernels.search import hierarchy
from antway.kernels.search.hierarchy_query import QueryMemory, UpwardGraph, diagonals, meet
from antway.kernels.search.lengths import FINE_DIAGONAL, FINE_STRAIGHT
from antway.kernels.search.subgoals import SubgoalMap, corners, seen
from antway.search import subgoals as module
from antway.search.derived import lattice, packed_lines
from antway.search.distance_field import dijkstra
from antway.search.subgoals import hierarchy_of, prepare, subgoals
from common import cases, free_cells, random_grid
from naive import search as naive


def test_what_sees_what() -> None:
    """C7: the corners of a map, and which of them a cell sees, are those of the definition, at the costs of an empty map."""
    rng = np.random.default_rng(0)
    for k in range(cases(60, 600)):
        grid, every = random_grid(rng, 1, 14), int(rng.integers(1, 5))
        if k % 20 == 0:  # lines of several words
            grid, every = Grid(rng.permuted(np.arange(750) < 3).reshape((3, 250) if k % 40 else (250, 3))), 25
        net = lattice(grid, Moves.EIGHT)
        is_corner = corners(net.around).reshape(grid.shape)
        nodes = [(int(r), int(c)) for r, c in np.argwhere(is_corner)]
        assert nodes == [cell for cell in np.ndindex(grid.shape) if naive.is_corner(grid, cell)]
        number = np.full((grid.shape[0] + 2, grid.shape[1] + 2), -1, np.int32)
        number[1:-1, 1:-1][is_corner] = np.arange(len(nodes))
        subgoal_map = SubgoalMap(net, packed_lines(grid.blocked | is_corner), number.ravel())
        found = np.empty((200, 2), np.int64)
        for cell in [(int(r), int(c)) for r, c in free_cells(grid)[::every]]:
            n = seen(subgoal_map, *cell, found)
            assert {nodes[i] for i in found[:n, 0]} == {node for node in nodes if node != cell and naive.sees(grid, cell, node)}
            for i, cost in found[:n].tolist():
                a, b = sorted(abs(np.subtract(nodes[i], cell)).tolist())
                assert (cost, diagonals(cost)) == ((b - a) * FINE_STRAIGHT + a * FINE_DIAGONAL, a)


def test_hierarchies_keep_distances() -> None:
    """C7: in the hierarchy of a random graph all distances are those of the graph, whatever order nodes are taken out in."""
    rng = np.random.default_rng(1)
    for case in range(cases(30, 300)):
        n, m = int(rng.integers(2, 40)), int(rng.integers(1, 120))
        if case % 3 == 2:  # a ring with few chords: even the first node that is removed needs a shortcut
            n, m = n + 2, m // 40
        pairs = {tuple(sorted(rng.integers(n, size=2).tolist())) for _ in range(m)}
        pairs |= {(k, k + 1) for k in range(n - 1)} | {(0, n - 1)} if case % 3 == 2 else set()
        ends = np.array([pair for pair in pairs if pair[0] < pair[1]])
        if not len(ends):
            continue
        cost = rng.integers(1, 20, len(ends))
        first, edges, weight = np.full(n, -1, np.int32), np.full((4 * n * n, 5), -1, np.int32), np.zeros(4 * n * n, np.int64)
        state = np.array([2 * len(ends), -1, n, 0, 0, 0])
        for e, ((a, b), w) in enumerate(zip(np.vstack((ends, ends[:, ::-1])).tolist(), np.tile(cost, 2).tolist())):
            edges[e, :2], weight[e], first[a] = (first[a], b), w, e
        order, rank = np.column_stack((np.zeros(n, np.int64), rng.permutation(n))), np.full(n, -1, np.int32)
        local, heap, level = np.zeros((n, 2), np.int64), np.empty((len(edges), 2), np.int64), np.zeros(n, np.int32)
        made = hierarchy.Memory(first, edges, weight, order, level, rank, local, heap, np.empty(n, np.int32), state)
        while hierarchy.contract(made, 50) != hierarchy.DONE:
            pass
        row_start, up, parts = hierarchy.upward_graph(made)
        assert sorted(rank.tolist()) == list(range(n))
        graph = coo_array((cost.astype(float), (ends[:, 0], ends[:, 1])), shape=(n, n)).tocsr()
        expected = scipy_dijkstra(graph, directed=False)
        node = np.argsort(rank)
        for x in range(n):
            for e in range(row_start[x], row_start[x + 1]):
                to, (out, before, after) = up[e, 0], parts[e]
                assert to > x
                assert up[e, 1] >= expected[node[x], node[to]]
                if out >= 0:
                    assert out < x
                    assert up[e, 1] == up[before, 1] + up[after, 1]
                    assert (up[before, 0], up[after, 0]) == (x, to)
        label, came, heaps = (
            np.zeros((2, n, 2), np.int64),
            np.empty((2, n, 2), np.int32),
            np.empty((2, len(up) + 9, 2), np.int64),
        )
        cells, at = np.zeros((n, 2), np.int32), np.zeros((2, 2), np.int64)
        for now, (a, b) in enumerate(np.ndindex(n, n), 1):
            seeds = np.array([[[rank[a], 0]], [[rank[b], 0]]])
            upward = UpwardGraph(row_start, up, parts, cells)
            memory = QueryMemory(label, came, heaps, seeds, np.empty((0, 3), np.int32), np.array([now]))
            best, _, _ = meet(upward, memory, np.ones(2, np.int64), at)
            assert best == expected[a, b] or (best == hierarchy.NOWHERE and np.isinf(expected[a, b]))


def test_preparation_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    """A preparation cut into many pieces gives the same paths; time that runs out within it is a matter of the budget."""
    rng = np.random.default_rng(2)
    blocked = rng.random((60, 60)) < 0.2
    blocked[0, 0] = blocked[-1, -1] = False
    whole = solve(Problem(Grid(blocked), (0, 0), (59, 59)), "subgoals")
    monkeypatch.setattr(module, "STEPS", 1 << 8)
    grid = Grid(blocked)
    problem = Problem(grid, (0, 0), (59, 59))
    segments = 0
    hierarchy = hierarchy_of(grid)
    hierarchy.making = hierarchy._chunks(grid)
    for done in hierarchy.making:
        assert not done
        assert subgoals(problem, budget=Budget(seconds=0)).status is Status.BUDGET
        segments += 1
    assert segments > 10
    assert np.array_equal(subgoals(problem).cells, whole.cells)


def test_an_interrupted_preparation_begins_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C amid the preparation leaves no half of a hierarchy behind."""
    grid = Grid(np.pad(np.ones((1, 1), dtype=bool), 2))

    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(module, "contract", interrupted)
        with pytest.raises(KeyboardInterrupt):
            prepare(grid)
    assert prepare(grid)
    assert len(subgoals(Problem(grid, (2, 0), (2, 4))).cells) == 5


def test_where_preparation_does_not_pay(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the work reaches its bound there is no hierarchy, and the paths are those of jps; a map without corners has one."""
    rng = np.random.default_rng(3)
    assert prepare(Grid(np.zeros((9, 9), dtype=bool)))
    monkeypatch.setattr(module, "STEPS", 1 << 8)
    monkeypatch.setattr(module, "MOST_STEPS", (1, 1, 1))
    grid = Grid(rng.random((60, 60)) < 0.2)
    assert not prepare(grid)
    (a, b), (c, d) = free_cells(grid)[[0, -1]].tolist()
    problem = Problem(grid, (a, b), (c, d))
    plan = subgoals(problem)
    check_plan(problem, plan)
    assert plan.length == dijkstra(problem).length
    with pytest.raises(BadParameter, match="grid"):
        prepare("map")  # type: ignore[arg-type]
