"""The rules against hand-computed steps and a naive twin, and the roulette against its own probabilities."""

from __future__ import annotations

from dataclasses import fields
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chisquare

from antway import BadParameter
from antway.ants.colony import Colony
from antway.ants.persistence import Adaptive, ByQuality, Constant, Decay
from antway.ants.rules import (
    RULES,
    AntColonySystem,
    AntSystem,
    ElitistAntSystem,
    MaxMinAntSystem,
    RankBasedAntSystem,
    make_rule,
)
from antway.ants.tsplib import Tsp
from antway.kernels.base import rng
from antway.kernels.base.jit import kernel as compiled
from antway.kernels.colony import tsp as kernel
from naive import ants as naive

# Four cities; the tours 0123, 0132, 0213 are 16, 14 and 18 long.
FOUR = np.array([[0, 3, 4, 5], [3, 0, 5, 4], [4, 5, 0, 3], [5, 4, 3, 0]], dtype=float)
TOURS, LENGTHS = [[0, 1, 2, 3], [0, 1, 3, 2]], [16.0, 14.0]
PAIRS = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
# Pheromone on PAIRS after one cycle of those two tours, from 1 on every edge; 1/16 = .0625, and 1/14 is that of the best.
A, B = 1 / 16, 1 / 14
STEPS = [
    (AntSystem(persistence=Constant(0.5)), [0.5 + A + B, 0.5 + B, 0.5 + A, 0.5 + A, 0.5 + B, 0.5 + A + B]),
    (
        ElitistAntSystem(elite=3.0, persistence=Constant(0.5)),
        [0.5 + A + 4 * B, 0.5 + 4 * B, 0.5 + A, 0.5 + A, 0.5 + 4 * B, 0.5 + A + 4 * B],
    ),
    (
        RankBasedAntSystem(ranks=3, persistence=Constant(0.9)),
        [0.9 + A + 5 * B, 0.9 + 5 * B, 0.9 + A, 0.9 + A, 0.9 + 5 * B, 0.9 + A + 5 * B],
    ),
    # tau_max = 1 / (0.02 * 14) = 3.571 and tau_min = tau_max (1 - p) / ((4 / 2 - 1) p), p = 0.05 ** 0.25 = 0.4729:
    # above tau_max, and so equal to it.
    (MaxMinAntSystem(persistence=Constant(0.98)), [1 / 0.28] * 6),
    # p = 0.99 ** 0.25: tau_min = 3.571 * 0.00251 / 0.99749 = 0.009.
    (MaxMinAntSystem(p_best=0.99, persistence=Constant(0.98)), [0.98 + B, 0.98 + B, 0.98, 0.98, 0.98 + B, 0.98 + B]),
    (AntColonySystem(persistence=Constant(0.9)), [0.9 + 0.1 * B, 0.9 + 0.1 * B, 1.0, 1.0, 0.9 + 0.1 * B, 0.9 + 0.1 * B]),
]


def colony_of(rule, ants=2):
    colony = Colony(Tsp(matrix=FOUR), rule, ants=ants, candidates=3)
    colony.state.tau[:] = 1.0
    return colony


def pheromone(colony):
    """{edge: tau}, checked to be the same from both ends."""
    found = {}
    for i, row in enumerate(colony.candidates):
        for c, j in enumerate(row):
            assert found.setdefault(frozenset((i, int(j))), colony.state.tau[i, c]) == colony.state.tau[i, c]
    return found


@pytest.mark.parametrize(("rule", "expected"), STEPS)
def test_one_step_by_hand(rule, expected):
    """After one cycle on four cities every rule's pheromone is what it is on paper, to 1e-12."""
    colony = colony_of(rule)
    colony.tell(TOURS, LENGTHS)
    tau = pheromone(colony)
    assert np.abs([tau[frozenset(pair)] for pair in PAIRS] - np.array(expected)).max() <= 1e-12


MORE = [AntSystem(persistence=policy) for policy in (Adaptive(), Decay(0.9, 0.8, 0.3), ByQuality(0.2, 0.9, 0.3))]
MORE += [
    MaxMinAntSystem(choices=3.0),
    MaxMinAntSystem(persistence=Constant(0.9999)),
    MaxMinAntSystem(schedule=((0, 4), (20, 3), (40, 1))),
    MaxMinAntSystem(restart=5, schedule=((0, 3), (4, 2))),
]


@pytest.mark.parametrize("rule", [*RULES, *MORE], ids=str)
def test_many_steps_like_the_twin(rule):
    """Over 60 cycles of random tours each rule's pheromone follows the naive one, to a relative 1e-12, restarts included."""
    dice = np.random.default_rng(3)
    places = dice.random((7, 2))
    colony = Colony(Tsp(places), make_rule(rule, ants=4, q=2.0), candidates=6)
    tau, best, began, improved, restart = pheromone(colony), (np.inf, None), 0, 0, getattr(rule, "restart", 1000)
    for cycle in range(60):
        if cycle < 40:  # then the colony stands still
            tours = [dice.permutation(7).tolist() for _ in range(4)]
        lengths = [colony.instance.length(tour) for tour in tours]
        improved = cycle if min(lengths) < best[0] else improved
        best = min(best, min(zip(lengths, tours)))
        colony.tell(tours, lengths)
        tau = naive.step(colony.rule, tau, tours, lengths, cycle - began, best)
        if cycle - improved >= restart:  # all pheromone is at its upper limit, and the best so far no longer deposits
            tau = dict.fromkeys(tau, 2 / (0.02 * best[0]))
            best, began, improved = (np.inf, None), cycle + 1, cycle + 1
        found = pheromone(colony)
        assert max(abs(found[e] / tau[e] - 1) for e in tau) <= 1e-12
    assert (began > 0) == (restart < 1000)


def test_probabilities_by_hand():
    """Eq. (1): from city 0 with tau 2, 1, 3 and distances 3, 4, 5 (alpha 2, beta 1) the probabilities are 4/3 : 1/4 : 9/5."""
    colony = colony_of(AntSystem(alpha=2.0, beta=1.0))
    colony.state.tau[0] = [2.0, 1.0, 3.0]
    weight = np.empty((4, 3))
    kernel.combine(colony.state.tau, colony.state.eta, 2.0, weight, colony.state.row_sum)
    expected = np.array([4 / 3, 1 / 4, 9 / 5]) / (4 / 3 + 1 / 4 + 9 / 5)
    assert np.abs(weight[0] / colony.state.row_sum[0] - expected).max() <= 1e-12
    for scale in (1e-140, 1e140):  # only the ratios of pheromone count
        kernel.combine(scale * colony.state.tau, colony.state.eta, 2.0, colony.state.weight, colony.state.row_sum)
        assert colony.state.weight[0] / colony.state.row_sum[0] == pytest.approx(expected, rel=1e-6)


def test_heuristic_is_one_over_distance():
    """Short edges beside long ones, and two cities in one place, which count as a tenth of the shortest edge apart."""
    dice = np.random.default_rng(4)
    places = np.vstack((dice.uniform(0.0, 10.0, (20, 2)), dice.uniform(-1e4, 1e4, (4, 2))))
    colony = Colony(Tsp(places), AntSystem(beta=2.0), ants=2)
    away = np.linalg.norm(places[:, None] - places, axis=2)
    gap = np.take_along_axis(away, colony.candidates, axis=1)
    assert colony.state.eta == pytest.approx((gap[:, :1] / gap) ** 2.0)
    equal = Colony(Tsp([(0, 0), (0, 0), (2, 0), (100, 0)]), AntSystem(beta=1.0), ants=2)
    assert equal.state.eta[0] == pytest.approx([1.0, 0.1, 0.002])


def test_initial_pheromone_is_the_books():
    """Table 3.1 for 10 ants, 20 cities and a tour of 50, with the evaporation 1 - persistence in place of rho."""
    expected = {
        "as": 10 / 50,
        "eas": 20 / (0.5 * 50),
        "rank": 0.5 * 6 * 5 / (0.1 * 50),
        "mmas": 1 / 50,  # for limits that evaporation widens
        "acs": 1 / (20 * 50),
    }
    assert {name: make_rule(name).initial(10, 20, 50.0) for name in expected} == pytest.approx(expected)
    assert RankBasedAntSystem(ranks=1).initial(10, 20, 50.0) == pytest.approx(0.5 / (0.1 * 50))
    mmas = Colony(Tsp(matrix=FOUR), candidates=3)  # whose tour by greed is 14 long
    assert mmas.state.tau == pytest.approx(1 / (0.02 * 14))


def test_defaults_are_the_books():
    """Table 3.1: beta is 2 for the rules that concentrate on one tour; ACS has ten ants."""
    rules = [make_rule(name) for name in ("as", "eas", "rank", "mmas", "acs")]
    assert [(rule.alpha, rule.beta, rule.persistence.rho) for rule in rules] == [
        (1.0, 5.0, 0.5),
        (1.0, 5.0, 0.5),
        (1.0, 5.0, 0.9),
        (1.0, 2.0, 0.98),
        (1.0, 2.0, 0.9),
    ]
    assert (rules[2].ranks, rules[4].q0, rules[4].xi, rules[4].ants) == (6, 0.9, 0.1, 10)


@compiled
def roulette(weight, near, left, q0, came, state, draws):
    counts = np.zeros(near.shape[1], dtype=np.int64)
    sums, whole = np.empty(near.shape[1], dtype=np.float32), np.array([weight[0].astype(np.float64).sum()])
    for _ in range(draws):
        c, greedy = -1, rng.uniform(state) < q0
        if came >= 0 and not greedy:
            c = kernel.propose(weight, whole, near, left, 0, came, rng.uniform(state))
        if c < 0:
            share = np.float32(rng.next_bits(state) >> np.uint64(41)) / np.float32(2**23)
            c = kernel.choose(weight, near, left, 0, greedy, share, sums)
        counts[c] += 1
    return counts


@pytest.mark.parametrize(("q0", "came"), [(0.0, -1), (0.7, -1), (0.0, 2), (0.7, 2)])
def test_roulette_frequencies(q0, came):
    """A million draws fall as the weights say (chi-square p > 1e-4), never on a visited city; q0 of them on the best.

    So they do where guesses among all cities but the one the ant came from are tried first.
    """
    k = 12
    weight = np.random.default_rng(1).random((1, k)).astype(np.float32)
    near = np.arange(1, k + 1, dtype=np.uint32).reshape(1, k)
    left = (np.arange(k + 1) >= 5).astype(np.float32)  # cities 1 to 4 are visited
    sums = np.empty(k, dtype=np.float32)
    ends = [kernel.choose(weight, near, left, 0, False, np.float32(share), sums) for share in (0.0, 1.0 - 2.0**-23)]
    assert ends == [4, k - 1]
    state = np.array([rng.stream(np.uint64(7), np.uint64(0))])
    counts = roulette(weight, near, left, q0, came, state, 1_000_000)
    odds = np.where(near[0] >= 5, weight[0].astype(float), 0.0)
    odds = (1 - q0) * odds / odds.sum() + q0 * (np.arange(k) == np.argmax(odds))
    assert (counts[odds == 0] == 0).all()
    assert chisquare(counts[odds > 0], 1_000_000 * odds[odds > 0]).pvalue > 1e-4


@pytest.mark.parametrize(("candidates", "seed"), [(8, 6), *((2, seed) for seed in range(6, 12))])
def test_local_update_of_acs(candidates, seed):
    """ACS: an edge taken by one ant keeps (1 - xi) tau + xi tau_0, at both ends, the edge that closes its tour as well.

    So does no other, such as those that are taken because no candidate is left.
    """
    places, rule = np.random.default_rng(seed).random((9, 2)), AntColonySystem(xi=0.25, ants=1, alpha=2.0)
    colony = Colony(Tsp(places), rule, candidates=candidates)
    colony.state.tau[:] = 1.0
    first = colony.state.record[kernel.TAU_0]
    (tour,) = colony.ask().tolist()
    tau = pheromone(colony)
    taken = {frozenset((a, b)) for a, b in pairwise([*tour, tour[0]]) if b in colony.candidates[a]}
    for edge, value in tau.items():
        assert abs(value - (0.75 + 0.25 * first if edge in taken else 1.0)) <= 1e-12
    odds, state = colony.state.weight.copy(), colony.state
    kernel.combine(state.tau, state.eta, 2.0, state.weight, state.row_sum)  # up to a factor for each city
    assert odds / odds[:, :1] == pytest.approx(state.weight / state.weight[:, :1], rel=1e-5)


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (AntSystem, {"alpha": -1.0}),
        (AntSystem, {"beta": float("nan")}),
        (AntSystem, {"ants": 0}),
        (AntSystem, {"q": 1e-101}),
        (RankBasedAntSystem, {"q": 1e300}),
        (AntSystem, {"persistence": 0.5}),
        (ElitistAntSystem, {"elite": 1e300}),
        (RankBasedAntSystem, {"ranks": 0}),
        (MaxMinAntSystem, {"p_best": 1.0}),
        (MaxMinAntSystem, {"schedule": ((1, 5),)}),
        (MaxMinAntSystem, {"schedule": ((0, 5), (0, 7))}),
        (MaxMinAntSystem, {"schedule": ((0, 5), (3, 7, 9))}),
        (MaxMinAntSystem, {"schedule": ((0, 0),)}),
        (MaxMinAntSystem, {"restart": -1}),
        (MaxMinAntSystem, {"choices": 1.0}),
        (AntColonySystem, {"q0": 1.5}),
        (AntColonySystem, {"xi": "much"}),
    ],
)
def test_wrong_parameters(kind, wrong):
    """A parameter outside its range is a `BadParameter` that names it."""
    with pytest.raises(BadParameter) as caught:
        kind(**wrong)
    assert caught.value.field == next(iter(wrong))


def test_a_schedule_may_come_from_anything_that_yields_pairs():
    """It is kept as a tuple: iterators were empty once they had been checked."""
    rule = MaxMinAntSystem(schedule=((0, 25), (3, 2)))
    for schedule in ([[0, 25], [3, 2]], np.array([[0, 25], [3, 2]], np.uint8), zip((0, 3), (25, 2)), [iter((0, 25)), (3, 2)]):
        again = MaxMinAntSystem(schedule=schedule)
        assert again == rule and hash(again) == hash(rule)
        assert make_rule(again).numbers(2).schedule.tolist() == [[0, 25], [3, 2]]


@pytest.mark.parametrize("kind", RULES.values())
def test_no_parameter_is_negative(kind):
    """Every number of every rule, set to -1, is a `BadParameter` that names it."""
    numbers = [f.name for f in fields(kind) if isinstance(getattr(kind(), f.name), int | float) or f.name in ("ants", "elite")]
    assert {"ants", "alpha", "beta", "q"} <= set(numbers)
    for name in numbers:
        with pytest.raises(BadParameter) as caught:
            kind(**{name: -1})
        assert caught.value.field == name


@pytest.mark.parametrize("rule", [ElitistAntSystem(q=1e100, elite=1e100), MaxMinAntSystem(q=1e100), AntSystem(q=1e100)])
def test_pheromone_stays_finite_at_the_limits_of_parameters(rule):
    """Even where cities are so near to each other that Q / L exceeds what a float holds."""
    rng = np.random.default_rng(4)
    for instance in (Tsp(rng.random((10, 2)) * 1e-150), Tsp(matrix=np.full((10, 10), 1e-290))):
        colony = Colony(instance, rule)
        assert colony.run(3, np.empty((3, 2))) >= 1
        assert np.isfinite(colony.pheromone).all() and (colony.pheromone > 0.0).all()
