"""The travelling salesman problem by ants: the paper's chapter III, and as much beside it as makes it good."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.ants.colony import Colony
from antway.ants.immune import Immune
from antway.ants.persistence import Constant, Persistence
from antway.ants.rules import MaxMinAntSystem, Rule
from antway.ants.tsplib import Tsp as Tsp
from antway.ants.tsplib import load_tsp as load_tsp
from antway.errors import BadParameter
from antway.kernels.colony.tsp import LocalSearchOptions
from antway.planning import Budget

# The local searches: candidates tried for a third edge, and cities in the part that a move displaces (None: all).
_SEARCHES: dict[str, tuple[int, int | None]] = {"2opt": (0, 0), "oropt": (5, 3), "3opt": (5, None)}
# With local search tours are good from the start, so that MMAS forgets faster and turns to the best so far (ACOTSP's schedule);
# with 7 choices tau_min is tau_max / (2 n), as in ACOTSP.
MMAS_WITH_SEARCH = MaxMinAntSystem(
    persistence=Constant(0.8), choices=7.0, schedule=((0, 25), (25, 5), (75, 3), (125, 2), (250, 1))
)
# Temperatures in mean edges of the best tour: tours built anew need little; ants that change their old ones would stay.
_TEMPERATURE_ANEW, _TEMPERATURE = 0.05, 0.8
_FOCUSED_FROM = 1000  # cities from which an ant changes its last tour in most cycles, instead of building one anew
_ANEW_EVERY = 4  # cycles from one in which it builds anew to the next; the ants take turns
_FOCUSED_ALONE_FROM = 2000  # cities from which they never build anew after the first cycle
_SEARCHED_FROM = 8  # cities; the edges of a 3-opt move may coincide below, and ants find the best of few tours anyway
_SLICE = 0.02  # s: how long cycles run before the budget is looked at


@dataclass(frozen=True, slots=True, eq=False)
class Tour:
    """What `solve_tsp` found.

    Attributes
    ----------
    order : int32[n]
        The cities in the best tour's order.
    length : float
        Its length, the way back included, in the instance's unit.
    history : float64[h, 3]
        (tours made, best length, seconds) whenever the best became better.
    pheromone : float64[n, k]
        At the end, on each city's candidate edges; a later call starts from it by `pheromone=`.
    candidates : int32[n, k]
        The cities that those edges lead to.
    tours : int
        Tours made; a change of a tour counts as one in focused construction.
    elapsed : float
        Seconds.
    optimum : float or None
        The shortest length, where it is known.
    """

    order: NDArray[np.int32]
    length: float
    history: NDArray[np.float64]
    pheromone: NDArray[np.float64]
    candidates: NDArray[np.int32]
    tours: int
    elapsed: float
    optimum: float | None

    def __post_init__(self) -> None:
        for array in (self.order, self.history, self.pheromone, self.candidates):
            array.flags.writeable = False

    @property
    def gap(self) -> float | None:
        """length / optimum - 1, where the optimum is known."""
        if self.optimum is None:
            return None
        return self.length / self.optimum - 1.0 if self.optimum > 0.0 else 0.0


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
    progress: Callable[[int, float, float], object] | None = None,
    cancel: threading.Event | None = None,
) -> Tour:
    """Look for the shortest closed tour through all cities.

    Parameters
    ----------
    instance : Tsp
    rule : str or Rule
        "as", "eas", "rank", "mmas", "acs", or a rule with its own parameters.
    local_search : str or None
        What improves each ant's tour before it deposits: "2opt", "oropt", "3opt"; None: nothing.
    persistence, ants : Persistence, int or None
        In place of the rule's own.
    immune : Immune or None
        The immune operator between construction and deposit.
    seconds, tours, cycles : float, int, int or None
        When to stop, whichever comes first (infinite seconds: never); with none of them, after 1,000 cycles. The search ends at
        a known optimum too.
    seed : int
        In [0, 2**64 - 1]. The same seed and number of cycles or tours give the same bytes, with any number of threads.
    threads : int
        Threads that the ants are spread over; worth it with a local search.
    candidates : int or None
        Edges per city that hold pheromone, those to its nearest others; None: 20, or 10 with a local search.
    focused : bool or None
        Whether ants change a few edges of their last tour at a time and repair it, instead of building tours anew (in the
        manner of Skinderowicz 2022); needs a local search. None: they build tours anew and then change them so, 2 n times;
        from 1,000 cities on each builds anew in every fourth cycle only, and from 2,000 on as with True.
    pheromone : array_like[n, k] or None
        Where to start from, such as the pheromone of an earlier `Tour` with as many candidates.
    progress : callable or None
        Called as progress(tours made, best length, seconds) between batches of cycles.
    cancel : threading.Event or None
        Ends the search when set; the best tour so far is returned.

    Returns
    -------
    Tour

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
    checks.integer("threads", threads, low=1, high=256)
    if local_search is not None:
        checks.choice("local_search", local_search, _SEARCHES)
    for name, value in (("tours", tours), ("cycles", cycles)):
        if value is not None:
            checks.integer(name, value, low=0)
    if progress is not None and not callable(progress):
        raise BadParameter("progress", progress, "a function of tours made, best length and seconds, or None")
    if focused is not None:
        checks.instance("focused", focused, bool)
    options, chosen = local_search_options(n, rule, local_search, focused)
    clock = Budget(seconds=seconds, cancel=cancel).start()
    if n < 4 or (not np.any(instance.cities(1).gap > 0.0) and instance.length(np.arange(n)) == 0.0):
        order = np.arange(n, dtype=np.int32)
        none, length = np.empty((n, 0)), instance.length(order)
        return Tour(order, length, np.empty((0, 3)), none, none.astype(np.int32), 0, clock.elapsed(), length)
    colony = Colony(
        instance,
        chosen,
        ants=ants if ants is not None or options.attempts == 0 else 10 if options.anew else 4,
        persistence=persistence,
        seed=seed,
        candidates=(20 if local_search is None else 10) if candidates is None else candidates,
        pheromone=pheromone,
        options=options,
        immune=immune,
    )
    per_cycle = colony.tours
    limit = _cycles(cycles, tours, seconds, per_cycle)
    target = -np.inf if instance.optimum is None else instance.optimum
    history: list[tuple[float, float, float]] = []
    batch = 1
    with nullcontext() if threads == 1 else ThreadPoolExecutor(threads) as pool:
        while colony.cycle < limit and not (colony.cycle and (clock.spent() or colony.best_cost <= target)):
            batch = min(batch, limit - colony.cycle)
            slack = np.empty((batch, 2))
            started = time.perf_counter()
            noted = colony.run(batch, slack, target, pool, threads)
            elapsed = clock.elapsed()
            history += [(cycle * per_cycle, best, elapsed) for cycle, best in slack[:noted].tolist()]
            if progress is not None:
                progress(colony.cycle * per_cycle, colony.best_cost, elapsed)
            # Twice as many at most, so that one slow first cycle, or a fast one, does not decide.
            batch = max(1, min(2 * batch, 4096, int(batch * _SLICE / max(time.perf_counter() - started, 1e-9))))
    order = colony.best
    return Tour(
        order,
        instance.length(order),
        np.array(history, dtype=np.float64).reshape(-1, 3),
        colony.pheromone,
        colony.candidates,
        colony.cycle * per_cycle,
        clock.elapsed(),
        instance.optimum,
    )


def local_search_options(
    n: int, rule: str | Rule, local_search: str | None, focused: bool | None
) -> tuple[LocalSearchOptions, str | Rule]:
    """Return what ants do besides walking, and the rule they follow."""
    if local_search is None or n < _SEARCHED_FROM:
        if focused and local_search is None:
            raise BadParameter("focused", focused, "False without a local_search")
        return LocalSearchOptions(-1, 0, 0, 0), rule
    breadth, longest = _SEARCHES[local_search]
    anew = 0 if focused is not None or n >= _FOCUSED_ALONE_FROM else 1 if n < _FOCUSED_FROM else _ANEW_EVERY
    attempts = 2 * n if anew == 1 else 0 if focused is False else min(10 * n, 5000)
    temperatures = _TEMPERATURE, _TEMPERATURE_ANEW
    options = LocalSearchOptions(breadth, n if longest is None else longest, attempts, 30, *temperatures, anew)
    return options, MMAS_WITH_SEARCH if rule == "mmas" else rule


def _cycles(cycles: int | None, tours: int | None, seconds: float | None, per_cycle: int) -> int:
    """Return how many cycles the budget allows."""
    limits = [] if cycles is None else [cycles]
    if tours is not None:
        limits.append(-(-tours // per_cycle))
    if seconds is None and not limits:
        limits.append(1000)
    return min(limits, default=2**62)
