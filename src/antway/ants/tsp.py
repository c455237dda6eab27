"""The travelling salesman problem by ants: the paper's chapter III, and what makes it competitive."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.ants.colony import NO_LOCAL_SEARCH, Colony
from antway.ants.immune import Immune
from antway.ants.persistence import Constant, Persistence
from antway.ants.rules import MaxMinAntSystem, Rule, make_rule
from antway.ants.tsplib import Tsp as Tsp
from antway.ants.tsplib import load_tsp as load_tsp
from antway.errors import BadParameter
from antway.kernels.colony.tsp import LocalSearchOptions
from antway.planning import Budget, Clock

# The local searches: candidates tried for the third edge, and cities in the part that a move displaces (None: all).
_SEARCHES: dict[str, tuple[int, int | None]] = {"2opt": (0, 0), "oropt": (5, 3), "3opt": (5, None)}
# With local search, tours are good from the start, so MMAS forgets faster and switches to the best so far (schedule of ACOTSP).
# With 7 choices, tau_min is tau_max / (2 n), as in ACOTSP.
MMAS_WITH_SEARCH = MaxMinAntSystem(
    persistence=Constant(0.8), choices=7.0, schedule=((0, 25), (25, 5), (75, 3), (125, 2), (250, 1))
)
# Temperatures in mean edge lengths of the best tour. Newly built tours need little; old ones would hardly change without.
_TEMPERATURE_REBUILT, _TEMPERATURE = 0.05, 0.8
_FOCUSED_FROM = 1000  # number of cities from which ants mostly change their last tours instead of building new ones
_REBUILD_EVERY = 4  # number of cycles after which such an ant builds a new tour; the ants take turns
_FOCUSED_ALONE_FROM = 2000  # number of cities from which ants build no new tours after the first cycle
_SEARCHED_FROM = 8  # least number of cities for local search: with fewer, the edges of a 3-opt move may coincide
_SLICE = 0.02  # s; time between two checks of the budget
Progress = Callable[[int, float, float], object]  # of tours made, best length, seconds


@dataclass(frozen=True, slots=True, eq=False)
class Tour:
    """What `solve_tsp` found.

    Attributes
    ----------
    order : int32[n]
        The cities in the order of the best tour.
    length : float
        Length of the closed tour, in the unit of the instance.
    history : float64[h, 3]
        (tours made, best length, seconds) at each improvement.
    pheromone : float64[n, k]
        Final pheromone on the candidate edges; pass it as `pheromone=` to continue.
    candidates : int32[n, k]
        The cities to which the candidate edges lead.
    tours : int
        Number of tours made; in focused construction each change of a tour counts as one.
    elapsed : float
        Seconds.
    optimum : float or None
        The shortest length, if it is known.
    """

    order: NDArray[np.int32]
    length: float
    history: NDArray[np.float64] = field(repr=False)
    pheromone: NDArray[np.float64] = field(repr=False)
    candidates: NDArray[np.int32] = field(repr=False)
    tours: int
    elapsed: float
    optimum: float | None

    def __post_init__(self) -> None:
        for array in (self.order, self.history, self.pheromone, self.candidates):
            array.flags.writeable = False

    @property
    def gap(self) -> float | None:
        """length / optimum - 1, if the optimum is known; infinite for a tour of some length where the optimum is 0."""
        if self.optimum is None:
            return None
        return self.length / self.optimum - 1.0 if self.optimum > 0.0 else math.inf if self.length > 0.0 else 0.0


def solve_tsp(
    instance: Tsp,
    rule: str | Rule = "mmas",
    *,
    local_search: str | None = None,
    persistence: Persistence | None = None,
    immune: Immune | None = None,
    ants: int | None = None,
    seconds: float | None = None,
    tours: int | None = None,
    cycles: int | None = None,
    seed: int = 0,
    threads: int = 1,
    candidates: int | None = None,
    focused: bool | None = None,
    pheromone: object = None,
    progress: Progress | None = None,
    cancel: threading.Event | None = None,
) -> Tour:
    """Look for the shortest closed tour through all cities.

    Parameters
    ----------
    instance : Tsp
    rule : str or Rule
        "as", "eas", "rank", "mmas", "acs", or a rule with its own parameters.
    local_search : str or None
        Local search that improves each tour before the deposit: "2opt", "oropt", "3opt"; None: no local search. Tours of fewer
        than 8 cities are not improved.
    persistence, ants : Persistence, int or None
        Override those of the rule.
    immune : Immune or None
        The immune operator, applied between construction and deposit.
    seconds, tours, cycles : float, int, int or None
        When to stop, whichever comes first; seconds may be infinite. Without any of them, after 1,000 cycles. The search also
        ends at a known optimum, and at a length of 0.
    seed : int
        In [0, 2**64 - 1]. The same seed and number of cycles or tours give the same bytes, with any number of threads.
    threads : int
        Number of threads for the ants; more than one pays with local search.
    candidates : int or None
        Number of edges of a city that hold pheromone, those to its nearest cities; None: 20, or 10 with local search.
    focused : bool or None
        Whether ants change a few edges of their last tours and repair them instead of building new tours (as in Skinderowicz
        2022); needs local search. None: ants build new tours and then change them in this way 2 n times; from 1,000 cities on
        each ant builds a new tour only every fourth cycle, and from 2,000 on None is the same as True.
    pheromone : array_like[n, k] or None
        Initial pheromone, such as that of an earlier `Tour` with as many candidates.
    progress : callable or None
        Called as progress(tours made, best length, seconds) between batches of cycles.
    cancel : threading.Event or None
        Ends the search when set; the best tour so far is returned.

    Raises
    ------
    BadParameter

    Examples
    --------
    >>> square = Tsp([(0, 0), (0, 2), (2, 2), (2, 0), (1, 0)])
    >>> solve_tsp(square, cycles=20).length
    8.0
    """
    checks.instance("instance", instance, Tsp)
    n = instance.size
    threads = checks.integer("threads", threads, low=1, high=256)
    if local_search is not None:
        checks.choice("local_search", local_search, _SEARCHES)
    tours = None if tours is None else checks.integer("tours", tours, low=0)
    cycles = None if cycles is None else checks.integer("cycles", cycles, low=0)
    if progress is not None and not callable(progress):
        raise BadParameter("progress", progress, "a function of tours made, best length and seconds, or None")
    if focused is not None:
        checks.instance("focused", focused, bool)
    options, chosen = local_search_options(n, rule, local_search, focused)
    chosen = make_rule(chosen, ants=default_ants(options) if ants is None else ants, persistence=persistence)
    seed = checks.seed(seed)
    if candidates is None:
        candidates = default_candidates(local_search)
    candidates = checks.integer("candidates", candidates, low=1)
    if immune is not None:
        checks.instance("immune", immune, Immune)
    if pheromone is not None:
        checks.array("pheromone", pheromone, (n, None))
    clock = Budget(seconds=seconds, cancel=cancel).start()
    order = np.arange(n, dtype=np.int32)
    length = instance.length(order)
    if n < 4 or length == 0.0:
        none = np.empty((n, 0))
        return Tour(order, length, np.empty((0, 3)), none, none.astype(np.int32), 0, clock.elapsed(), length)
    colony = Colony(instance, chosen, seed=seed, candidates=candidates, pheromone=pheromone, options=options, immune=immune)
    limits = [count for count in (cycles, None if tours is None else -(-tours // colony.tours)) if count is not None]
    limit = min(limits, default=1000 if seconds is None else 2**62)
    history = np.array(_run(colony, clock, limit, instance.optimum or 0.0, threads, progress), dtype=np.float64).reshape(-1, 3)
    order, learned, made = colony.best, (colony.pheromone, colony.candidates), colony.cycle * colony.tours
    return Tour(order, instance.length(order), history, *learned, made, clock.elapsed(), instance.optimum)


def _run(
    colony: Colony, clock: Clock, limit: int, target: float, threads: int, progress: Progress | None
) -> list[tuple[float, float, float]]:
    """Run the colony for `limit` cycles, until the clock is spent or a tour is at most `target` long.

    Returns (tours made, best length, seconds) at each improvement. Cycles are run in batches of about `_SLICE` s.
    """
    history: list[tuple[float, float, float]] = []
    batch = 1
    with nullcontext() if threads == 1 else ThreadPoolExecutor(threads) as pool:
        while colony.cycle < limit and not (colony.cycle and (clock.spent() or colony.best_cost <= target)):
            batch = min(batch, limit - colony.cycle)
            rows = np.empty((batch, 2))
            started = time.perf_counter()
            noted = colony.run(batch, rows, target, pool, threads)
            elapsed = clock.elapsed()
            history += [(cycle * colony.tours, best, elapsed) for cycle, best in rows[:noted].tolist()]
            if progress is not None:
                progress(colony.cycle * colony.tours, colony.best_cost, elapsed)
            # At most twice as many, so that an unusually slow or fast first cycle does not matter much.
            batch = max(1, min(2 * batch, 4096, int(batch * _SLICE / max(time.perf_counter() - started, 1e-9))))
    return history


def default_ants(options: LocalSearchOptions) -> int | None:
    """Return how many ants there are by default; None: as many as their rule has."""
    return None if options.attempts == 0 else 10 if options.rebuild_every else 4


def default_candidates(local_search: str | None) -> int:
    """Return how many of its nearest cities an ant looks at by default."""
    return 20 if local_search is None else 10


def local_search_options(
    n: int, rule: str | Rule, local_search: str | None, focused: bool | None
) -> tuple[LocalSearchOptions, str | Rule]:
    """Return how ants improve or change tours, and their rule."""
    if local_search is None or n < _SEARCHED_FROM:
        if focused and local_search is None:
            raise BadParameter("focused", focused, "False without a local_search")
        return NO_LOCAL_SEARCH, rule
    breadth, longest = _SEARCHES[local_search]
    rebuild_every = 0 if focused is not None or n >= _FOCUSED_ALONE_FROM else 1 if n < _FOCUSED_FROM else _REBUILD_EVERY
    attempts = 2 * n if rebuild_every == 1 else 0 if focused is False else min(10 * n, 5000)
    temperatures = _TEMPERATURE, _TEMPERATURE_REBUILT
    options = LocalSearchOptions(breadth, n if longest is None else longest, attempts, 30, *temperatures, rebuild_every)
    return options, MMAS_WITH_SEARCH if isinstance(rule, str) and rule == "mmas" else rule
