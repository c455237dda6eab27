"""The immune operator between construction and deposit. The paper only names it in its keywords; the definitions are ours.

Wang, Pan, Jiao 2000 (vaccines, immune test, annealed selection); Qi, Liu, Jiao 2008 (vaccines from elites); IJARS 2016, doi
10.5772/63737 (immunosuppression). The functions take node sequences, which are closed tours or open paths, so that every
colony can use them. `docs/colonies.md` says how much they help.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.kernels.base import rng
from antway.kernels.colony.pheromone import Numbers

Nodes = NDArray[np.integer]
Draw = Callable[[], float]  # the next uniform number in [0, 1)


@dataclass(frozen=True, slots=True)
class Immune:
    """How strongly a colony is immunised.

    Parameters
    ----------
    archive : int
        Number of elites, from which vaccines are made.
    share : float
        An edge belongs to a vaccine if at least this share of the elites has it, in (0, 1].
    vaccinated : float
        Share of a cycle's ants that are vaccinated, in [0, 1].
    temperature, cooling : float
        Selection draws ants with probability exp(f / T_k) / sum exp(f / T_k), where f = 1 - L / L_min and
        T_k = temperature cooling^k, at least a hundredth of `temperature`; temperature = 0: no selection.
    overlap : float
        Two ants are alike if the overlap of their edges, |A and B| / |A or B|, is larger than this. The deposit of an ant is
        divided by the number of ants like it. 1: never.
    stagnation, suppression : int, float
        After `stagnation` cycles with the same best, the pheromone on its edges is multiplied by `suppression`; 0: never.
    """

    archive: int = 10
    share: float = 0.8
    vaccinated: float = 0.3
    temperature: float = 0.1
    cooling: float = 0.99
    overlap: float = 0.9
    stagnation: int = 100
    suppression: float = 0.5

    def __post_init__(self) -> None:
        checks.counts(self, "archive", low=2, high=1000)
        checks.counts(self, "stagnation", low=0)
        checks.fields(self, "share", "suppression", low=0.0, high=1.0, open_low=True)
        checks.fields(self, "vaccinated", "cooling", "overlap", low=0.0, high=1.0)
        checks.fields(self, "temperature", low=0.0)


@dataclass(slots=True)
class Immunity:
    """The memory of an immunised colony: its elites, best first, as (cost, nodes)."""

    policy: Immune
    closed: bool
    seed: int
    elites: list[tuple[float, Nodes]] = field(default_factory=list)

    def respond(
        self,
        cycle: int,
        ants: Sequence[Nodes],
        costs: NDArray[np.float64],
        evaluate: Callable[[Nodes], float],
        vaccinate: Callable[[Nodes, Nodes], Nodes],
    ) -> tuple[list[Nodes], NDArray[np.float64], NDArray[np.float64]]:
        """Vaccinate, test and select; return the ants of the cycle, their costs, and the factors of their deposits.

        `evaluate(nodes)` returns the cost, `vaccinate(nodes, vaccine)` a child with the vaccine.
        """
        policy = self.policy
        draw = partial(rng.uniform, rng.make_state(self.seed, 2**63 + cycle))
        population, values = list(ants), costs.copy()
        found = vaccines([nodes for _, nodes in self.elites], policy.share, self.closed) if self.elites else []
        for ant in range(len(population)):
            if found and draw() < policy.vaccinated:
                child = vaccinate(population[ant], found[int(draw() * len(found))])
                cost = evaluate(child)
                # The immune test: a child worse than its parent is dropped.
                if cost < values[ant]:
                    population[ant], values[ant] = child, cost
        if policy.temperature > 0.0:
            temperature_now = policy.temperature * max(policy.cooling**cycle, 0.01)
            chosen = select(values, temperature_now, draw)
            population, values = [population[ant] for ant in chosen], values[chosen]
        self._remember(population, values)
        alike = concentration(population, policy.overlap, self.closed)
        return population, values, 1.0 / alike

    def suppresses(self, unchanged: int) -> bool:
        """Tell whether the pheromone of the best is suppressed in a cycle, after `unchanged` cycles with the same best."""
        return self.policy.stagnation > 0 and unchanged > 0 and unchanged % self.policy.stagnation == 0

    def _remember(self, population: Sequence[Nodes], costs: NDArray[np.float64]) -> None:
        """Keep the best of elites and ants, one for each cost."""
        known = {cost for cost, _ in self.elites}
        for ant in np.argsort(costs, kind="stable")[: self.policy.archive]:
            if costs[ant] not in known:
                known.add(float(costs[ant]))
                self.elites.append((float(costs[ant]), np.array(population[ant])))
        self.elites.sort(key=lambda elite: elite[0])
        del self.elites[self.policy.archive :]


def scaled(numbers: Numbers, costs: NDArray[np.float64], factor: NDArray[np.float64]) -> Numbers:
    """Return the rule with each ant's deposit times its factor, 0 at infinite cost; all together deposit as much as before."""
    deposit_weight = numbers.deposit_weight * factor[np.argsort(costs, kind="stable")]
    before = float(numbers.deposit_weight[: np.count_nonzero(np.isfinite(costs))].sum())
    return numbers._replace(deposit_weight=deposit_weight * (before / deposit_weight.sum() if deposit_weight.any() else 1.0))


def edges(nodes: Nodes, closed: bool) -> NDArray[np.int64]:
    """Return the undirected edges {a, b} of a path or closed tour in its order, each as min * 2**32 + max.

    Examples
    --------
    >>> [divmod(edge, 2**32) for edge in edges(np.array([0, 2, 1]), closed=True).tolist()]
    [(0, 2), (1, 2), (0, 1)]
    """
    a = nodes.astype(np.int64)
    b = np.roll(a, -1)
    codes = np.minimum(a, b) * 2**32 + np.maximum(a, b)
    return codes if closed else codes[:-1]


def vaccines(elites: Sequence[Nodes], share: float, closed: bool) -> list[Nodes]:
    """Return the vaccines: the longest runs of at least two edges of the best elite that a `share` of the elites has.

    Examples
    --------
    >>> [v.tolist() for v in vaccines([np.array([0, 1, 2, 3]), np.array([0, 1, 2, 4, 3])], 1.0, closed=False)]
    [[0, 1, 2]]
    """
    best = elites[0]
    codes, counts = np.unique(np.concatenate([np.unique(edges(elite, closed)) for elite in elites]), return_counts=True)
    common = np.isin(edges(best, False), codes[counts >= share * len(elites)])
    runs = np.split(best, np.flatnonzero(~common) + 1)
    return [run for run in runs if 3 <= len(run) < len(best)]


def vaccinate_tour(order: Nodes, vaccine: Nodes) -> Nodes:
    """Return the tour with `vaccine` as one run at the place of its first city; the other cities keep their order.

    Examples
    --------
    >>> vaccinate_tour(np.array([0, 1, 2, 3, 4]), np.array([1, 3, 0])).tolist()
    [1, 3, 0, 2, 4]
    """
    kept = order[~np.isin(order, vaccine[1:])]
    at = int(np.flatnonzero(kept == vaccine[0])[0])
    return np.concatenate((kept[:at], vaccine, kept[at + 1 :]))


def vaccinate_path(path: Nodes, vaccine: Nodes) -> Nodes:
    """Return the path with the part between both ends of `vaccine`, if it passes them, replaced by it, without loops.

    Examples
    --------
    >>> vaccinate_path(np.array([0, 1, 5, 6, 3, 4]), np.array([1, 2, 3])).tolist()
    [0, 1, 2, 3, 4]
    """
    first, last = np.flatnonzero(path == vaccine[0]), np.flatnonzero(path == vaccine[-1])
    if len(first) == 0 or len(last) == 0:
        return path
    i, j, run = int(first[0]), int(last[0]), vaccine
    if i > j:
        i, j, run = j, i, vaccine[::-1]
    result: list[int] = []
    seen: dict[int, int] = {}
    for node in np.concatenate((path[:i], run, path[j + 1 :])).tolist():
        if node in seen:
            for gone in result[seen[node] + 1 :]:
                del seen[gone]
            del result[seen[node] + 1 :]
        else:
            seen[node] = len(result)
            result.append(node)
    return np.array(result, dtype=path.dtype)


def select(costs: NDArray[np.float64], temperature: float, draw: Draw) -> NDArray[np.int64]:
    """Draw as many ants as there are, with probability ~ exp(f / T), f = 1 - L / L_min; the best one stays."""
    costs = np.maximum(costs, 1e-300)
    with np.errstate(over="ignore"):  # far from the best, the probability is 0
        weights = np.cumsum(np.exp((1.0 - costs / costs.min()) / max(temperature, 1e-300)))
    chosen = [int(np.argmin(costs))]
    chosen += [int(np.searchsorted(weights, draw() * weights[-1], side="right")) for _ in range(len(costs) - 1)]
    return np.array(chosen)


def concentration(ants: Sequence[Nodes], overlap: float, closed: bool) -> NDArray[np.float64]:
    """Return for each ant how many ants, with itself, have an overlap of edges |A and B| / |A or B| > `overlap`."""
    sets = [np.unique(edges(ant, closed)) for ant in ants]
    codes, column = np.unique(np.concatenate(sets), return_inverse=True)
    has = np.zeros((len(sets), len(codes)))
    has[np.repeat(np.arange(len(sets)), [len(own) for own in sets]), column] = 1.0
    both = has @ has.T
    size = np.diag(both)
    alike = both > overlap * (size[:, None] + size[None, :] - both)
    return np.asarray(np.maximum(alike.sum(axis=1), 1), dtype=np.float64)
