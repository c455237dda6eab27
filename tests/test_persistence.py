"""Persistence policies against their formulas; pheromone keeps its invariants, but not under the formula as printed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import BadParameter
from antway.ants.colony import Colony
from antway.ants.persistence import Adaptive, ByQuality, Constant, Decay, Printed
from antway.ants.rules import RULES, AntSystem, make_rule
from antway.ants.tsplib import Tsp
from antway.kernels.colony import pheromone as kernel
from antway.kernels.colony import tsp
from common import cases
from naive import ants as naive

POLICIES = [Constant(0.8), Adaptive(), Printed(), Decay(), ByQuality()]
PLACES = np.random.default_rng(11).random((12, 2))


@pytest.mark.parametrize("policy", POLICIES, ids=lambda p: type(p).__name__)
def test_evaporation_like_the_twin(policy):
    """Each policy's kernel multiplies every edge by the rho of its formula, to a relative 1e-14."""
    dice = np.random.default_rng(2)
    for t in (0, 1, 5, 300):
        tau = dice.random((6, 4)) + 0.01
        excess = float(dice.random())
        least = tau.min()
        expected = np.array([[v * naive.persistence(policy, v, least, t, excess) for v in row] for row in tau])
        kernel.evaporate(tau, policy.numbers(), t, excess)
        assert np.allclose(tau, expected, rtol=1e-14, atol=0)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("policy", [Constant(0.9), Adaptive(), Decay(), ByQuality()], ids=lambda p: type(p).__name__)
def test_pheromone_keeps_its_invariants(rule, policy):
    """Each cycle pheromone is finite and > 0, the same at both ends, and within the limits for MMAS; 10,000 cycles at night."""
    colony = Colony(Tsp(PLACES), make_rule(rule, ants=3, persistence=policy), candidates=11)
    history = np.empty((1, 2))
    near, back = colony.cities.near, colony.cities.back
    record = colony.state.record
    for _ in range(cases(500, 10_000) if not isinstance(policy, Constant) else 10_000):
        colony.run(1, history)
        tau = colony.state.tau
        assert tau.min() > 0.0 and tau.max() < math.inf
        if rule == "mmas":
            assert record[tsp.TAU_MIN] <= tau.min() and tau.max() <= record[tsp.TAU_MAX]
    assert (back >= 0).all() and (colony.state.tau == colony.state.tau[near, back]).all()


def test_adaptive_persistence_is_a_share():
    """0 < lo <= rho <= hi < 1 whatever pheromone and time are."""
    persistence_rule = Adaptive().numbers()
    for tau in np.geomspace(1e-150, 1e150, 61):
        for tau_min in tau * np.array([0.0, 1e-9, 0.5, 1.0]):
            for t in (0, 1, 10, 10_000):
                assert 0.1 <= kernel.persistence(persistence_rule, tau, tau_min, t, 0.0) <= 0.9


def test_printed_persistence_takes_nothing_from_the_best_tour_of_acs():
    """Where more than all persists there is nothing to deposit: a negative amount would make pheromone negative."""
    colony = Colony(Tsp(PLACES), make_rule("acs", persistence=Printed()), candidates=11)
    before = colony.pheromone.min()
    colony.run(20, np.empty((20, 2)))
    assert colony.pheromone.min() >= before and np.isfinite(colony.pheromone).all()


def test_printed_persistence_diverges():
    """The formula as printed has rho > 1 on every edge: pheromone only grows and leaves the finite numbers."""
    colony = Colony(Tsp(PLACES), AntSystem(ants=3, persistence=Printed()), candidates=11)
    history = np.empty((1, 2))
    before = np.zeros_like(colony.pheromone)
    while np.isfinite(after := colony.pheromone).all() and colony.cycle < 2000:
        assert (after > before).all()
        before = after
        colony.run(1, history)
    assert colony.cycle < 2000
    # The ants go on all the same: with no usable pheromone each goes to the nearest city left.
    assert sorted(colony.ask()[0].tolist()) == list(range(12))


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (Constant, {"rho": 1.01}),
        (Constant, {"rho": -0.01}),
        (Constant, {"rho": float("nan")}),
        (Adaptive, {"lo": 0.95}),
        (Decay, {"factor": -0.1}),
        (Decay, {"first": 1.01}),
        (Decay, {"lo": 1.01}),
        (ByQuality, {"lo": 0.96}),
        (ByQuality, {"spread": 0.0}),
        (ByQuality, {"hi": "1"}),
    ],
)
def test_wrong_policies(kind, wrong):
    """A parameter outside its range is a `BadParameter` that names it."""
    with pytest.raises(BadParameter) as caught:
        kind(**wrong)
    assert caught.value.field == next(iter(wrong))
