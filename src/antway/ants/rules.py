"""The classical colonies. A rule says how ants choose and how much they deposit; one loop runs all of them.

Dorigo, Stuetzle: Ant Colony Optimization, MIT Press 2004, chapter 3; the defaults are those of its table 3.1. Every rule has
the exponents alpha (of pheromone) and beta (of the heuristic) of Eq. (1), Q of Eq. (2) in [1e-100, 1e100], the number of ants
(None: it depends on the problem) and a persistence, 1 minus the evaporation that the book calls rho. `numbers()` returns the
rule for the kernels.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from antway import checks
from antway.ants.persistence import Constant, Persistence
from antway.errors import BadParameter
from antway.kernels.colony.pheromone import Numbers, persistence


class Rule(Protocol):
    """A colony's rule."""

    @property
    def ants(self) -> int | None: ...
    @property
    def persistence(self) -> Persistence: ...
    def numbers(self, ants: int) -> Numbers:
        """Return the rule for `ants` ants as plain numbers and arrays."""
        ...

    def initial(self, ants: int, nodes: int, length: float) -> float:
        """Return the initial pheromone from the length > 0 of a greedy solution and the number of nodes of a solution."""
        ...


@dataclass(frozen=True, slots=True)
class _RuleFields:
    """The fields that all rules have."""

    ants: int | None = None
    alpha: float = 1.0
    beta: float = 5.0
    q: float = 1.0

    def __post_init__(self) -> None:
        rule: Any = self
        if rule.ants is not None:
            checks.counts(rule, "ants", low=1, high=1_000_000)
        checks.fields(rule, "alpha", "beta", low=0.0, high=100.0)
        checks.fields(rule, "q", low=1e-100, high=1e100)
        if isinstance(rule.persistence, type) or not hasattr(rule.persistence, "numbers"):
            raise BadParameter("persistence", rule.persistence, "a persistence policy such as Constant(0.9)")


@dataclass(frozen=True, slots=True)
class AntSystem(_RuleFields):
    """Every ant deposits Q / L_k (Dorigo, Maniezzo, Colorni 1996); the paper's III.B."""

    persistence: Persistence = field(default=Constant(0.5))

    def numbers(self, ants: int) -> Numbers:
        return _numbers(self, deposit_weight=np.ones(ants))

    def initial(self, ants: int, nodes: int, length: float) -> float:
        return ants * self.q / length


@dataclass(frozen=True, slots=True)
class ElitistAntSystem(_RuleFields):
    """Ant System in which the best so far also deposits `elite` times Q / L_best (None: the number of ants)."""

    elite: float | None = None
    persistence: Persistence = field(default=Constant(0.5))

    def __post_init__(self) -> None:
        _RuleFields.__post_init__(self)
        if self.elite is not None:
            checks.fields(self, "elite", low=0.0, high=1e100)

    def numbers(self, ants: int) -> Numbers:
        return _numbers(self, deposit_weight=np.ones(ants), elite=self._weight(ants))

    def initial(self, ants: int, nodes: int, length: float) -> float:
        return (self._weight(ants) + ants) * self.q / (_evaporation(self) * length)

    def _weight(self, ants: int) -> float:
        return float(ants) if self.elite is None else self.elite


@dataclass(frozen=True, slots=True)
class RankBasedAntSystem(_RuleFields):
    """The r-th best ant deposits (ranks - r) Q / L_r, the best so far ranks Q / L_best (Bullnheimer et al. 1999)."""

    ranks: int = 6
    persistence: Persistence = field(default=Constant(0.9))

    def __post_init__(self) -> None:
        _RuleFields.__post_init__(self)
        checks.counts(self, "ranks", low=1)

    def numbers(self, ants: int) -> Numbers:
        return _numbers(self, deposit_weight=np.maximum(self.ranks - 1.0 - np.arange(ants), 0.0), elite=float(self.ranks))

    def initial(self, ants: int, nodes: int, length: float) -> float:
        return 0.5 * self.ranks * (self.ranks - 1.0 if self.ranks > 1 else 1.0) * self.q / (_evaporation(self) * length)


@dataclass(frozen=True, slots=True)
class MaxMinAntSystem(_RuleFields):
    """Only one ant deposits, and pheromone has limits (Stuetzle, Hoos 2000).

    tau_max = Q / ((1 - rho) L_best); tau_min is such that a converged colony builds its best with probability `p_best`.

    Parameters
    ----------
    schedule : tuple of (cycle, every)
        From `cycle` on, the best so far deposits every `every` cycles, else the best of the cycle. The first pair has cycle 0.
    p_best : float
        In (0, 1).
    choices : float or None
        Average number of alternatives at a step, > 1, which determines tau_min; None: n / 2 for n cities, as in the book, or
        the average number of moves from a cell.
    restart : int
        Number of cycles without improvement after which pheromone is reset to tau_max; the best solution is kept. 0: never.
    """

    beta: float = 2.0
    p_best: float = 0.05
    choices: float | None = None
    schedule: tuple[tuple[int, int], ...] = ((0, 25),)
    restart: int = 1000
    persistence: Persistence = field(default=Constant(0.98))

    def __post_init__(self) -> None:
        _RuleFields.__post_init__(self)
        checks.fields(self, "p_best", low=1e-300, high=1.0 - 1e-9)
        if self.choices is not None:
            checks.fields(self, "choices", low=1.0, open_low=True)
        checks.counts(self, "restart", low=0)
        allowed = "(cycle, every) pairs of rising cycles from 0"
        pairs = [checks.sequence("schedule", pair, allowed) for pair in checks.sequence("schedule", self.schedule, allowed)]
        cycles = [checks.integer("schedule", pair[0], low=0) for pair in pairs if len(pair) == 2]
        if cycles[:1] != [0] or cycles != sorted(set(cycles)) or len(cycles) < len(pairs):
            raise BadParameter("schedule", self.schedule, allowed)
        often = [checks.integer("schedule", every, low=1) for _, every in pairs]
        object.__setattr__(self, "schedule", tuple(zip(cycles, often)))

    def numbers(self, ants: int) -> Numbers:
        schedule = np.array(self.schedule, dtype=np.int64)
        deposit_weight = (np.arange(ants) == 0).astype(np.float64)
        limits = {"p_best": self.p_best, "choices": self.choices or 0.0}
        return _numbers(self, deposit_weight=deposit_weight, elite=1.0, schedule=schedule, restart=self.restart, **limits)

    def initial(self, ants: int, nodes: int, length: float) -> float:
        return self.q / length


@dataclass(frozen=True, slots=True)
class AntColonySystem(_RuleFields):
    """Pseudo-random proportional choice and local update; only the best tour deposits (Dorigo, Gambardella 1997).

    With probability `q0` an ant takes the best edge, else it draws. On each edge taken, tau <- (1 - xi) tau + xi tau_0. After a
    cycle, tau <- rho tau + max(1 - rho, 0) Q / L_best on the edges of the best so far.
    """

    ants: int | None = 10
    beta: float = 2.0
    q0: float = 0.9
    xi: float = 0.1
    persistence: Persistence = field(default=Constant(0.9))

    def __post_init__(self) -> None:
        _RuleFields.__post_init__(self)
        checks.fields(self, "q0", "xi", low=0.0, high=1.0)

    def numbers(self, ants: int) -> Numbers:
        return _numbers(self, deposit_weight=np.zeros(ants), elite=1.0, q0=self.q0, xi=self.xi, best_only=True)

    def initial(self, ants: int, nodes: int, length: float) -> float:
        return self.q / (nodes * length)


RULES: dict[str, type[Any]] = {
    "as": AntSystem,
    "eas": ElitistAntSystem,
    "rank": RankBasedAntSystem,
    "mmas": MaxMinAntSystem,
    "acs": AntColonySystem,
}


def make_rule(rule: object, **changes: object) -> Rule:
    """Return `rule`, a name of `RULES` or a rule, with the `changes` that are not None.

    Examples
    --------
    >>> make_rule("acs", ants=20).ants
    20
    """
    found: Any = rule if isinstance(rule, tuple(RULES.values())) else RULES[checks.choice("rule", rule, RULES)]()
    result: Rule = replace(found, **{name: value for name, value in changes.items() if value is not None})
    return result


def _evaporation(rule: Any) -> float:
    """Return how much evaporates in the first cycle, at least 1/1000, by which the book divides initial pheromone."""
    return max(1.0 - float(persistence(rule.persistence.numbers(), 1.0, 0.0, 0, 0.0)), 1e-3)


def _numbers(rule: Any, **own: Any) -> Numbers:
    """Return the fields that all rules have, and a rule's own ones."""
    return Numbers(alpha=rule.alpha, beta=rule.beta, q=rule.q, persistence_rule=rule.persistence.numbers(), **own)
