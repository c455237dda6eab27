"""A colony that is asked for tours and told their costs; `solve_tsp` runs the same colony inside a kernel."""

from __future__ import annotations

import math
from concurrent.futures import Executor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.ants.immune import Immune, Immunity, scaled, vaccinate_tour
from antway.ants.persistence import Persistence
from antway.ants.rules import MaxMinAntSystem, Rule, make_rule
from antway.ants.tsplib import Tsp, permutation
from antway.errors import BadParameter, TooLarge
from antway.kernels.colony import tour as cities_kernel
from antway.kernels.colony import tsp as kernel
from antway.kernels.colony.pheromone import CEILING, Numbers, limits
from antway.kernels.colony.pheromone import persistence as persistence_of

MAX_EDGES = 30_000_000  # limit of cities times candidates, about 60 bytes each; all pairs of a matrix are fewer
MAX_PLACES = 100_000_000  # limit of cities times ants, 4 bytes each
NO_LOCAL_SEARCH = kernel.LocalSearchOptions(-1, 0, 0, 0)


class Colony:
    """Ants that build closed tours over the cities of a TSP: construct, evaluate, deposit.

    The caller supplies the costs: `tell` takes any positive numbers. The heuristic comes from the instance's distances.

    Parameters
    ----------
    instance : Tsp
        With at least four cities.
    rule : str or Rule
        A name of `RULES` ("as", "eas", "rank", "mmas", "acs"), or a rule with its parameters.
    ants, persistence : int, Persistence or None
        Number of ants in a cycle, and persistence; None: those of the rule, or else 25 ants for MMAS and as many as cities, at
        most 100, for other rules.
    seed : int
        In [0, 2**64 - 1]. The same seed and the same answers give the same bytes.
    candidates : int
        Number of edges of a city that hold pheromone: those to the nearest other cities.
    pheromone : array_like[n, k] or None
        Initial pheromone, such as that of an earlier colony; > 0.
    options : LocalSearchOptions
        How ants improve or change their tours; by default they do not.
    immune : Immune or None
        The immune operator; only `run` applies it.

    Examples
    --------
    >>> colony = Colony(Tsp([(0, 0), (0, 1), (1, 1), (1, 0), (2, 0)]), seed=1)
    >>> for _ in range(3):
    ...     tours = colony.ask()
    ...     colony.tell(tours, [colony.instance.length(tour) for tour in tours])
    >>> round(colony.best_cost, 3)
    5.414
    """

    def __init__(
        self,
        instance: Tsp,
        rule: str | Rule = "mmas",
        *,
        ants: int | None = None,
        persistence: Persistence | None = None,
        seed: int = 0,
        candidates: int = 20,
        pheromone: object = None,
        options: kernel.LocalSearchOptions = NO_LOCAL_SEARCH,
        immune: Immune | None = None,
    ) -> None:
        self.instance = checks.instance("instance", instance, Tsp)
        self.rule = make_rule(rule, ants=ants, persistence=persistence)
        self.options = options
        self._seed = np.uint64(checks.seed(seed))
        self._immunity = None if immune is None else Immunity(checks.instance("immune", immune, Immune), True, seed)
        checks.integer("candidates", candidates, low=1)
        if instance.size < 4:
            raise BadParameter("instance.size", instance.size, "at least 4 cities")
        n = instance.size
        m = self.rule.ants or (25 if isinstance(self.rule, MaxMinAntSystem) else min(n, 100))
        if n * min(candidates, n - 1) > MAX_EDGES:
            raise TooLarge("candidates", candidates, f"at most {MAX_EDGES // n} for {n} cities")
        if n * m > MAX_PLACES:
            raise TooLarge("ants", m, f"at most {MAX_PLACES // n} for {n} cities")
        self.cities = instance.cities(candidates, by_quadrant=options.breadth >= 0)
        k = self.cities.near.shape[1]
        self.numbers = self.rule.numbers(m)
        # The heuristic is 1 / distance, scaled to 1 for the nearest city. Equal places count as a tenth of the shortest edge.
        gap = self.cities.gap
        least = float(gap.min(where=gap > 0.0, initial=math.inf))
        gap = np.where(gap > 0.0, gap, (0.1 * least or least) if math.isfinite(least) else 1.0)
        eta = (gap[:, :1] / gap) ** self.numbers.beta
        tau = np.ones((n, k))
        weight, row_sum = np.ones((n, k), dtype=np.float32), np.ones(n)
        orders, bests = np.tile(np.arange(n, dtype=np.uint32), (m, 1)), np.zeros((2, n), dtype=np.uint32)
        record = np.array([math.inf, 0, 0, 0, math.inf, 1.0, 0, 0])
        self.state = kernel.ColonyState(tau, eta, weight, row_sum, orders, np.zeros(m), bests, record)
        kernel.combine(tau, eta, 1.0, weight, row_sum)
        greedy = kernel.walk_once(self.cities, self.state, self.numbers._replace(q0=1.0, xi=0.0), self._seed)
        greedy = max(greedy, 1e-300)  # all cities may be in one place
        bests[:] = orders[0]
        first = self.rule.initial(m, n, greedy)
        if self.numbers.p_best > 0.0:  # rules with limits begin with tau_max, for which only the length matters
            rho = persistence_of(self.numbers.persistence_rule, 1.0, 0.0, 0, 0.0)
            _, first = limits(self.numbers, rho, greedy, 2, 2.0)
        record[kernel.TAU_0] = tau[:] = min(first, CEILING)
        if pheromone is not None:
            field = checks.array("pheromone", pheromone, (n, k))
            if not (field > 0.0).all():
                raise BadParameter("pheromone", float(field.min()), "> 0 throughout")
            tau[:] = field

    @property
    def best(self) -> NDArray[np.int32]:
        """The best tour told so far, int32[n]."""
        return np.array(self.state.bests[0], np.int32)

    @property
    def best_cost(self) -> float:
        """The cost of the best tour; infinite before the first cycle."""
        return float(self.state.record[kernel.BEST])

    @property
    def cycle(self) -> int:
        """Number of cycles done."""
        return int(self.state.record[kernel.CYCLE])

    @property
    def tours(self) -> int:
        """Number of tours made in a cycle; in focused construction each change of a tour counts as one."""
        return len(self.state.lengths) * (1 if self.options.rebuild_every else max(self.options.attempts, 1))

    @property
    def pheromone(self) -> NDArray[np.float64]:
        """A copy of the pheromone on the candidate edges, float64[n, k]; `candidates` are their other ends."""
        return self.state.tau.copy()

    @property
    def candidates(self) -> NDArray[np.int32]:
        """The cities to which the candidate edges of each city lead, int32[n, k], nearest first."""
        return self.cities.near.astype(np.int32)

    def ask(self, pool: Executor | None = None, threads: int = 1) -> NDArray[np.int32]:
        """Let the ants walk by Eq. (1), and improve their tours if local search is on; return the tours, int32[m, n]."""
        self._construct(pool, threads)
        return self.state.orders.astype(np.int32)

    def tell(self, tours: object, costs: object) -> None:
        """End the cycle: deposit by the rule, Eq. (2), for `tours` (int[m, n]) of `costs` (float[m], finite, > 0)."""
        m, n = self.state.orders.shape
        rows = checks.array("tours", tours, (m, n))
        values = checks.array("costs", costs, (m,))
        if not (values > 0.0).all():
            raise BadParameter("costs", float(values.min()), "> 0")
        for ant in range(m):
            self.state.orders[ant] = permutation(f"tours[{ant}]", rows[ant], n)
        self.state.lengths[:] = values
        kernel.learn(self.cities, self.state, self.numbers)

    def run(
        self,
        cycles: int,
        history: NDArray[np.float64],
        target: float = -math.inf,
        pool: Executor | None = None,
        threads: int = 1,
    ) -> int:
        """Run up to `cycles` cycles with the lengths of the instance, until a tour is at most `target` long.

        Writes (cycle, best length) to `history`, float64[cycles, 2], at each improvement; returns the number of improvements.
        """
        if threads == 1 and self._immunity is None:
            return int(kernel.cycles(self.cities, self.state, self.numbers, self.options, self._seed, cycles, target, history))
        noted = 0
        for _ in range(cycles):
            self._construct(pool, threads)
            numbers = self.numbers if self._immunity is None else self._immunise(self._immunity)
            if kernel.learn(self.cities, self.state, numbers):
                history[noted] = self.cycle, self.best_cost
                noted += 1
                if self.best_cost <= target:
                    break
        return noted

    def _immunise(self, immunity: Immunity) -> Numbers:
        """Apply the immune operator to the tours of the cycle; return the rule with deposits scaled by concentration."""
        state = self.state
        tours, costs, scale = immunity.respond(
            self.cycle,
            list(state.orders),
            state.lengths,
            lambda order: float(cities_kernel.length(self.cities.metric, order.astype(np.uint32))),
            vaccinate_tour,
        )
        state.orders[:], state.lengths[:] = np.array(tours), costs
        if immunity.suppresses(self.cycle - int(state.record[kernel.IMPROVED])):
            kernel.deposit(self.cities.near, state.tau, state.bests[1], immunity.policy.suppression, 0.0)
        return scaled(self.numbers, costs, scale)

    def _construct(self, pool: Executor | None, threads: int) -> None:
        """Build the tours of the cycle, on all threads except for ACS, whose ants change pheromone as they walk."""
        m = len(self.state.lengths)
        kernel.combine(self.state.tau, self.state.eta, self.numbers.alpha, self.state.weight, self.state.row_sum)
        kernel.select(self.state, self.options, self._seed)
        whole = (self.cities, self.state, self.numbers, self.options, self._seed)
        if pool is None or threads == 1 or self.numbers.xi > 0.0:
            kernel.build(*whole, 0, m)
            return
        cuts = [m * i // threads for i in range(threads + 1)]
        for job in [pool.submit(kernel.build, *whole, a, b) for a, b in pairwise(cuts)]:
            job.result()
