"""The kernels of the ants on a grid against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chisquare

from antway.ants.grid_walk import NO_TURN, AntGraph, Ants, Trail
from antway.ants.persistence import Adaptive, ByQuality, Constant, Decay, Printed
from antway.ants.rules import RULES, make_rule
from antway.grid import Grid, Moves
from antway.kernels.colony import grid_walk as kernel
from antway.kernels.colony.pheromone import persistence
from antway.planning import Budget, Problem
from common import cases, costly, free_cells, random_grid
from naive import grid_walk as naive

ANT_MOVES = [Moves.FOUR, Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT]


def random_ground(rng: np.random.Generator, low: int = 3, high: int = 14) -> AntGraph:
    """A random reachable problem under random moves."""
    while True:
        grid = random_grid(rng, low, high, (0.0, 0.45))
        cells = free_cells(grid)
        if len(cells) > 1:
            start, goal = (tuple(map(int, cell)) for cell in rng.choice(cells, 2, replace=False))
            graph = AntGraph(Problem(grid, start, goal, ANT_MOVES[rng.integers(4)]))
            if graph.bound < math.inf:
                return graph


def random_weights(rng: np.random.Generator, graph: AntGraph) -> np.ndarray:
    legal = graph.visibility("field", 1.0) > 0
    return np.where(legal, rng.random(legal.shape) + 0.01, 0.0).astype(np.float32)


def test_every_step_is_that_of_the_naive_ant_with_the_same_random_numbers():
    """Whatever the map, the moves, the greed, the turns and the retreat, the kernel walks as the naive twin does."""
    rng = np.random.default_rng(1)
    died = arrived = 0
    for _ in range(cases(60, 2000)):
        graph = random_ground(rng)
        weights, seed = random_weights(rng, graph), int(rng.integers(2**64, dtype=np.uint64))
        turn = NO_TURN if rng.random() < 0.5 else rng.random((9, 8)).astype(np.float32)
        greedy, retreat = float(rng.choice([0.0, 0.5])), bool(rng.integers(2))
        walkers = Ants(graph, 5, int(rng.integers(1, 60)), retreat=retreat)
        steps = walkers.walk(weights, seed, 7, Budget().start(), greedy=greedy, turn=turn)
        twins = [
            naive.walk(weights, graph.offsets, graph.start, graph.goal, walkers.limit, retreat, greedy, turn, seed, 7 + ant)
            for ant in range(5)
        ]
        assert steps == sum(made for _, made in twins)
        for ant, (path, _) in enumerate(twins):
            assert walkers.depth[ant] == (-1 if path is None else len(path))
            assert path is None or walkers.path(ant).tolist() == path
            assert walkers.length[ant] == pytest.approx(naive.length(path), abs=1e-12)
        died += sum(path is None for path, _ in twins)
        arrived += sum(path is not None for path, _ in twins)
    assert min(died, arrived) >= cases(50)


def test_the_roulette_draws_each_move_as_often_as_its_weight_says():
    """Over a million draws the counts pass a chi-square test, whether all neighbours are open or some were visited."""
    graph = AntGraph(Problem(Grid(np.zeros((5, 5), dtype=bool)), (2, 2), (0, 0)))
    weights = np.zeros((49, 8), np.float32)
    deposit_weight = np.array([0.3, 0.05, 0.1, 0.001, 0.2, 0.149, 0.15, 0.05])
    weights[:] = deposit_weight
    walkers = Ants(graph, 1_000_000, 1)
    walkers.walk(weights, 3, 0, Budget().start())
    assert chisquare(np.bincount(walkers.moves[:, 0], minlength=8), deposit_weight * 1e6).pvalue > 1e-4
    east = np.where(np.arange(8) == 0, np.float32(1), np.float32(0)) + np.zeros((49, 8), np.float32)
    east[graph.start + 1] = deposit_weight
    walkers = Ants(graph, 1_000_000, 2)
    walkers.walk(east, 3, 0, Budget().start())
    rest = np.where(np.arange(8) == 2, 0.0, deposit_weight)  # move 2 leads back to the start
    counts = np.bincount(walkers.moves[:, 1], minlength=8)
    assert counts[2] == 0
    assert chisquare(np.delete(counts, 2), np.delete(rest / rest.sum(), 2) * 1e6).pvalue > 1e-4


def test_an_ant_retreats_from_a_dead_end_and_arrives_without_loops():
    """With retreat and enough steps every ant arrives, on a path that visits no cell twice."""
    rng = np.random.default_rng(2)
    for _ in range(cases(60, 2000)):
        graph = random_ground(rng, 5, 20)
        walkers = Ants(graph, 8, 2 * graph.distance.size)
        walkers.walk(random_weights(rng, graph), 5, 0, Budget().start())
        for ant in range(8):
            cells = [cell for cell, _ in naive.edges(graph.offsets, graph.start, walkers.path(ant).tolist())] + [graph.goal]
            assert walkers.depth[ant] >= 0 and len(set(cells)) == len(cells)
    assert walkers.walk(np.zeros((graph.distance.size, 8), np.float32), 5, 8, Budget().start()) == 8  # there is no way on
    assert (walkers.depth == -1).all()


def test_weights_are_the_numerator_of_equation_1():
    """tau^alpha eta^beta, up to a factor of each cell, for the three heuristics, and 0 exactly on illegal moves."""
    rng = np.random.default_rng(3)
    for heuristic in ("field", "distance", "goal"):
        for alpha in (0.0, 1.0, 1.7):
            graph = random_ground(rng)
            legal = np.array([[bool(bits >> k & 1) for k in range(8)] for bits in graph.net.legal.tolist()])
            legal &= np.isfinite(graph.distance)[:, None]
            tau = np.where(legal, rng.random(legal.shape) + 0.1, 0.0)
            weights = np.zeros(tau.shape, np.float32)
            kernel.weigh(tau, graph.visibility(heuristic, 2.0), alpha, weights)
            assert ((weights > 0) == legal).all()
            for cell in np.flatnonzero(legal.any(axis=1)):
                expected = np.zeros(8)
                for k in np.flatnonzero(legal[cell]):
                    j = cell + graph.offsets[k]
                    if heuristic == "goal":
                        d = math.dist(divmod(j, graph.net.width), divmod(graph.goal, graph.net.width))
                    else:
                        d = graph.distance[j]
                    eta = 1 / max(d, kernel.NEAR)
                    if heuristic == "field":
                        eta = math.exp(-(Moves.EIGHT.lengths[k] + max(d, kernel.NEAR) - graph.distance[cell]))
                    expected[k] = tau[cell, k] ** alpha * eta**2
                np.testing.assert_allclose(weights[cell], expected / expected.max(), rtol=1e-6, atol=1e-29)


RULE_CASES = [make_rule(name, persistence=Constant(0.7), q=2.0) for name in RULES]
RULE_CASES += [make_rule("as", persistence=p) for p in (Adaptive(), Printed(), Decay(0.9, 0.8, 0.3), ByQuality(0.2, 0.9, 0.3))]
RULE_CASES += [make_rule("as", persistence=ByQuality(0.2, 0.9, 0.3), beta=0.0), make_rule("acs", persistence=Printed())]
RULE_CASES += [make_rule("mmas", schedule=((0, 1),)), make_rule("eas", elite=2.5), make_rule("rank", ranks=3)]
RULE_CASES += [make_rule("mmas", restart=2, schedule=((0, 2), (2, 1)), persistence=Decay(0.9, 0.8, 0.3))]


@pytest.mark.parametrize("rule", RULE_CASES, ids=lambda r: f"{type(r).__name__}-{type(r.persistence).__name__}")
def test_a_cycle_ends_with_the_pheromone_of_equation_2(rule):
    """Fading and deposits of every rule and persistence agree with the naive twin, edge by edge, to 1e-12; so do restarts."""
    rng, restart = np.random.default_rng(4), getattr(rule, "restart", 1000)
    for trial in range(costly(5, 100)):
        graph = random_ground(rng)
        trail = Trail(graph, rule, 6, "field")
        walkers = Ants(graph, 6, 40)
        began, improved = 0, -1
        for t in range(4 if restart == 1000 else 9):
            before, shortest = trail.tau.copy(), trail.best
            walkers.walk(trail.weights(), trial, 6 * t, Budget().start())
            trail.learn(walkers, t)
            paths = [walkers.path(ant).tolist() if walkers.depth[ant] >= 0 else None for ant in range(6)]
            best = trail.path.tolist() if trail.best < math.inf else None
            old = {(c, k): before[c, k] for c, k in np.argwhere(before > 0).tolist()}
            args = (old, trail.tau_0, trail.tau_min, trail.tau_max, graph.offsets, graph.start, paths, best, t - began)
            new = naive.update(rule, *args)
            improved = t if trail.best < shortest else improved
            if t - max(improved, began - 1) >= restart:
                new, began = dict.fromkeys(new, trail.tau_max), t + 1
            assert [tuple(edge) for edge in np.argwhere(trail.tau > 0).tolist()] == sorted(new)
            for (cell, k), value in new.items():
                assert trail.tau[cell, k] == pytest.approx(value, rel=1e-12)
        assert began > 0 or restart == 1000


POLICIES = {Adaptive(): 10_000, Constant(0.5): 10_000, Constant(0.0): 500, Decay(): 500, ByQuality(): 500}


@pytest.mark.parametrize("name", RULES)
def test_pheromone_keeps_within_its_limits_for_10000_cycles(name):
    """Pheromone is finite, positive and within the limits after every cycle, whatever the persistence."""
    blocked = np.zeros((5, 6), dtype=bool)
    blocked[2, 1:5] = True
    graph = AntGraph(Problem(Grid(blocked), (0, 0), (4, 5)))
    for policy, cycles in POLICIES.items():
        trail = Trail(graph, make_rule(name, persistence=policy), 4, "distance")
        walkers = Ants(graph, 4, 12, retreat=False)
        legal, numbers = trail.tau > 0, policy.numbers()
        for t in range(cycles):
            walkers.walk(trail.weights(), 1, 4 * t, Budget().start())
            trail.learn(walkers, t)
            values = trail.tau[legal]
            low, high = values.min(), values.max()  # NaN if one is NaN
            assert 0.0 < trail.tau_min <= low <= high <= trail.tau_max < math.inf
            if isinstance(policy, Adaptive):
                assert all(0.0 < persistence(numbers, v, low, t, 0.0) < 1.0 for v in (low, high))


def test_printed_persistence_leaves_every_limit():
    """As printed, III.D multiplies each edge by more than 1 each cycle, the weakest most: the literal formula overflows."""
    tau = np.array([1.0, 2.0, 4.0])
    policy = Printed().numbers()
    with np.errstate(over="ignore"):
        for t in range(800):
            rho = np.array([persistence(policy, v, tau.min(), t, 0.0) for v in tau])
            assert (rho > 1).all() and rho.argmax() == tau.argmin()
            tau = tau * rho
            if not np.isfinite(tau).all():
                break
    assert 600 < t < 800 and tau.max() == math.inf
    graph = AntGraph(Problem(Grid(np.zeros((4, 4), dtype=bool)), (0, 0), (3, 3)))
    trail = Trail(graph, make_rule("as", persistence=Printed()), 4, "distance")
    walkers = Ants(graph, 4, 20)
    for t in range(800):  # the colony lives on, clipped and blind: all edges are alike
        walkers.walk(trail.weights(), 1, 4 * t, Budget().start())
        trail.learn(walkers, t)
    values = trail.tau[trail.tau > 0]
    assert values.min() > 0.5 * values.max() and values.min() > 1e100
    assert kernel.entropy(trail.tau) > 0.99 * math.log(len(values))


def test_a_colony_that_stands_still_starts_again_from_the_upper_limit():
    """After `restart` cycles without a better path all pheromone is at tau_max, and the best is kept."""
    graph = AntGraph(Problem(Grid(np.zeros((4, 4), dtype=bool)), (0, 0), (3, 3)))
    trail = Trail(graph, make_rule("mmas", restart=5, beta=50.0, persistence=Constant(0.5)), 4, "field")
    walkers = Ants(graph, 4, 20)
    fresh = []
    for t in range(17):
        walkers.walk(trail.weights(), 1, 4 * t, Budget().start())
        trail.learn(walkers, t)
        fresh.append(bool((trail.tau[trail.tau > 0] == trail.tau_max).all()))
    assert trail.best == pytest.approx(graph.bound)  # found in cycle 0
    assert [t for t, new in enumerate(fresh) if new] == [5, 10, 15]


def test_entropy_is_that_of_the_shares_of_pheromone():
    """-sum p ln p over all moves: ln n where n are alike, 0 where one has all."""
    assert kernel.entropy(np.ones((5, 8))) == pytest.approx(math.log(40))
    assert kernel.entropy(np.array([[1.0, 1.0, 2.0, 0, 0, 0, 0, 0]])) == pytest.approx(1.5 * math.log(2))
    assert kernel.entropy(np.array([[1e150, 1e-150, 0, 0, 0, 0, 0, 0]])) == pytest.approx(0.0, abs=1e-12)
    assert kernel.entropy(np.zeros((2, 8))) == 0.0
