"""The immune operator keeps tours tours and paths paths, and never makes an ant worse by a vaccine."""

from __future__ import annotations

from functools import partial

import numpy as np

from antway.ants.grid_walk import AntGraph, Ants, Trail
from antway.ants.immune import (
    Immune,
    Immunity,
    concentration,
    edges,
    select,
    vaccinate_path,
    vaccinate_tour,
    vaccines,
)
from antway.ants.rules import make_rule
from antway.grid import Grid
from antway.kernels.base import rng
from antway.planning import Problem
from common import cases


def test_vaccinated_tours_are_tours():
    """A vaccinated tour is a permutation that has the vaccine as a run."""
    dice = np.random.default_rng(1)
    for _ in range(cases(200, 2000)):
        n = int(dice.integers(5, 30))
        order, vaccine = dice.permutation(n), dice.permutation(n)[: dice.integers(3, n)]
        child = vaccinate_tour(order, vaccine)
        assert sorted(child) == list(range(n))
        at = child.tolist().index(vaccine[0])
        assert child[at : at + len(vaccine)].tolist() == vaccine.tolist()


def test_vaccinated_paths_are_paths():
    """A vaccinated path keeps its ends, visits no node twice and has edges of the path and the vaccine alone."""
    dice = np.random.default_rng(2)
    for _ in range(cases(200, 2000)):
        path, vaccine = dice.permutation(12)[:8], dice.permutation(12)[:4]
        child = vaccinate_path(path, vaccine)
        assert child[0] == path[0] and child[-1] == path[-1] and len(set(child)) == len(child)
        assert set(edges(child, False)) <= set(edges(path, False)) | set(edges(vaccine, False))


def test_vaccines_are_shared():
    """Every edge of a vaccine is in at least the wanted share of the elites."""
    dice = np.random.default_rng(3)
    base = dice.permutation(20)
    elites = [np.roll(base, s) if s % 2 else np.concatenate((base[:12], base[12:][::-1])) for s in range(10)]
    found = vaccines(elites, 0.6, True)
    assert found
    for vaccine in found:
        for edge in edges(vaccine, False):
            assert sum(edge in edges(elite, True) for elite in elites) >= 6


def test_concentration_counts_the_alike():
    """Ants with the same edges, whatever their start and direction, are alike; those with none in common are not."""
    tour = np.arange(10)
    other = np.array([0, 2, 4, 6, 8, 1, 3, 5, 7, 9])
    assert concentration([tour, np.roll(tour, 3), tour[::-1], other], 0.9, True).tolist() == [3, 3, 3, 1]


def test_selection_keeps_the_best_and_prefers_the_short():
    """The best ant is always selected; short tours are drawn more often than long ones, the more so the colder it is."""
    costs = np.array([110.0, 100.0, 130.0])
    draw = partial(rng.uniform, rng.make_state(4, 0))
    counts = np.zeros(3)
    for _ in range(2000):
        chosen = select(costs, 0.1, draw)
        assert chosen[0] == 1
        counts += np.bincount(chosen[1:], minlength=3)
    odds = np.exp((1 - costs / 100) / 0.1)
    assert np.abs(counts / counts.sum() - odds / odds.sum()).max() < 0.03


def test_no_ant_gets_worse_by_vaccination():
    """Without selection every ant's cost after the operator is at most its cost before."""
    dice = np.random.default_rng(5)
    xy = dice.random((15, 2))

    def cost(order):
        return float(np.hypot(*(xy[order] - xy[np.roll(order, 1)]).T).sum())

    immunity = Immunity(Immune(temperature=0.0, vaccinated=1.0, share=0.3), True, 0, [])
    for cycle in range(cases(20, 200)):
        ants = [dice.permutation(15) for _ in range(6)]
        costs = np.array([cost(ant) for ant in ants])
        tours, after, scale = immunity.respond(cycle, ants, costs, cost, vaccinate_tour)
        assert (after <= costs).all() and np.allclose(after, [cost(tour) for tour in tours])
        assert ((scale > 0) & (scale <= 1)).all()
        assert len(immunity.elites) <= 10 and immunity.elites[0][0] <= after.min()


def test_a_vaccinated_path_may_be_as_long_as_an_ant_may_go():
    """A path of as many moves as there are steps is kept; it used to be dropped, though ants may walk it."""
    graph = AntGraph(Problem(Grid(np.zeros((5, 3), dtype=bool)), (0, 0), (4, 1)))
    straight = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (4, 1)]
    oblique, elsewhere = [(0, 0), (1, 1), (2, 0), (3, 1), (4, 1)], [*straight[:-1], (3, 2)]
    best, path, other = (np.array([graph.net.at(cell) for cell in cells]) for cells in (straight, oblique, elsewhere))
    immunity = Immunity(Immune(temperature=0.0, vaccinated=1.0, share=1.0), False, 0, [(5.0, best), (5.0, other)])
    walkers, trail = Ants(graph, 1, 5), Trail(graph, make_rule("as"), 1, "field")
    walkers.moves[0, :4], walkers.depth[0], walkers.length[0] = graph.moves(path), 4, 1 + 3 * 2**0.5
    trail.learn(walkers, 0, immunity)
    assert trail.best == 5.0 and graph.cells(trail.path).tolist() == best.tolist()
