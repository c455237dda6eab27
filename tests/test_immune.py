"""The immune operator keeps tours tours and paths paths, and never makes an ant worse by a vaccine."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

from antway.ants.grid_walk import AntGraph, Ants, Trail
from antway.ants.immune import (
    Immune,
    Immunity,
    concentration,
    edges,
    scaled,
    select,
    vaccinate_path,
    vaccinate_tour,
    vaccines,
)
from antway.ants.persistence import Constant
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


def test_a_vaccine_is_taken_in_the_direction_of_the_path():
    assert vaccinate_path(np.array([0, 3, 5, 6, 1, 4]), np.array([1, 2, 3])).tolist() == [0, 3, 2, 1, 4]


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


def test_vaccines_have_two_edges_or_more_but_not_all():
    best = np.arange(7)
    assert [run.tolist() for run in vaccines([best, np.array([0, 1, 2, 8, 3, 4, 9, 5, 6])], 1.0, False)] == [[0, 1, 2]]
    assert vaccines([best, best], 1.0, False) == []


def test_each_vaccine_is_given_as_often_to_as_many_ants_as_shall_be_vaccinated():
    best, given = np.arange(9), []
    immunity = Immunity(Immune(vaccinated=0.4, share=1.0, temperature=0.0), False, 3)
    immunity.elites[:] = [(1.0, best), (2.0, np.array([0, 1, 2, 20, 3, 4, 5, 21, 6, 7, 8]))]

    def note(ant, vaccine):
        given.append(vaccine.tolist())
        return ant

    immunity.respond(0, [best] * 900, np.full(900, 1.0), len, note)
    counts = [given.count(run) for run in ([0, 1, 2], [3, 4, 5], [6, 7, 8])]
    assert sum(counts) == len(given) and abs(len(given) - 360) < 60 and min(counts) > 80


def test_pheromone_of_the_best_is_suppressed_now_and_then():
    for stagnation, wanted in ((3, [3, 6, 9]), (0, [])):
        immunity = Immunity(Immune(stagnation=stagnation), False, 0)
        assert [unchanged for unchanged in range(10) if immunity.suppresses(unchanged)] == wanted


def test_selection_gets_colder():
    """At first it hardly prefers the best ant to those a tenth longer, later it takes no other, but never only the best."""
    immunity, first = Immunity(Immune(temperature=1.0, cooling=0.5, vaccinated=0.0), False, 0), np.arange(40) == 7

    def chosen(cycle, longer):
        ants = [np.array([k, 50, 51]) for k in range(40)]
        return (immunity.respond(cycle, ants, np.where(first, 100.0, longer), len, vaccinate_path)[1] == 100.0).sum()

    assert chosen(0, 110.0) < 5 < chosen(5, 110.0) < 30 and chosen(30, 110.0) == 40
    assert chosen(3000, 101.0) < 10  # at a hundredth of the temperature


def test_all_ants_together_deposit_as_much_as_without_factors():
    rule = make_rule("rank", ranks=4).numbers(5)
    costs, factor = np.array([3.0, 1.0, np.inf, 2.0, 4.0]), np.array([0.5, 0.25, 0.0, 1.0, 1.0])
    weights = rule.deposit_weight * factor[[1, 3, 0, 4, 2]]
    assert rule.deposit_weight[:4].sum() > weights.sum() > 0.0
    assert np.allclose(
        scaled(rule, costs, factor).deposit_weight, weights * rule.deposit_weight[:4].sum() / weights.sum(), rtol=1e-12
    )
    assert not scaled(rule, costs, np.zeros(5)).deposit_weight.any()


def test_concentration_counts_the_alike():
    """Ants with the same edges, whatever their start and direction, are alike; those with none in common are not."""
    tour = np.arange(10)
    other = np.array([0, 2, 4, 6, 8, 1, 3, 5, 7, 9])
    assert concentration([tour, np.roll(tour, 3), tour[::-1], other], 0.9, True).tolist() == [3, 3, 3, 1]
    assert concentration([tour, tour], 1.0, True).tolist() == [1, 1]


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
        ants = [dice.permutation(15) for _ in range(5)]
        ants.append(ants[0])
        costs = np.array([cost(ant) for ant in ants])
        tours, after, scale = immunity.respond(cycle, ants, costs, cost, vaccinate_tour)
        assert (after <= costs).all() and np.allclose(after, [cost(tour) for tour in tours])
        assert ((scale > 0) & (scale <= 1)).all()
        assert len(immunity.elites) <= 10 and immunity.elites[0][0] <= after.min()
        known = [cost for cost, _ in immunity.elites]
        assert known == sorted(set(known))  # one for each cost, best first


@pytest.mark.parametrize("steps", [4, 5])
def test_a_vaccinated_path_may_be_as_long_as_an_ant_may_go(steps):
    """A path of as many moves as there are steps is kept; it used to be dropped, though ants may walk it."""
    graph = AntGraph(Problem(Grid(np.zeros((5, 3), dtype=bool)), (0, 0), (4, 1)))
    straight = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (4, 1)]
    oblique, elsewhere = [(0, 0), (1, 1), (2, 0), (3, 1), (4, 1)], [*straight[:-1], (3, 2)]
    best, path, other = (np.array([graph.net.at(cell) for cell in cells]) for cells in (straight, oblique, elsewhere))
    immunity = Immunity(Immune(temperature=0.0, vaccinated=1.0, share=1.0), False, 0, [(5.0, best), (5.0, other)])
    walkers, trail = Ants(graph, 1, steps), Trail(graph, make_rule("as"), 1, "field")
    walkers.moves[0, :4], walkers.depth[0], walkers.length[0] = graph.moves(path), 4, 1 + 3 * 2**0.5
    trail.learn(walkers, 0, immunity)
    assert trail.best == (5.0 if steps == 5 else 1 + 3 * 2**0.5)
    assert graph.cells(trail.path).tolist() == (best if steps == 5 else path).tolist()


def test_suppression_lowers_the_pheromone_of_the_best_that_stays_the_same():
    graph = AntGraph(Problem(Grid(np.zeros((3, 5), dtype=bool)), (0, 0), (0, 3)))
    left = []
    for suppression in (1.0, 0.25):
        immunity = Immunity(Immune(temperature=0.0, vaccinated=0.0, stagnation=1, suppression=suppression), False, 0)
        walkers, trail = Ants(graph, 1, 3), Trail(graph, make_rule("as", persistence=Constant(0.5)), 1, "field")
        walkers.moves[0], walkers.depth[0], walkers.length[0] = graph.moves(graph.start + np.arange(4)), 3, 3.0
        trail.learn(walkers, 0, immunity)
        before = trail.tau.copy()
        trail.learn(walkers, 1, immunity)
        left.append(trail.tau)
    gone, on_path = left[0] - left[1], before != before[before > 0].min()
    assert on_path.sum() >= 3 and np.allclose(gone[on_path], 0.5 * 0.75 * before[on_path]) and not gone[~on_path].any()
