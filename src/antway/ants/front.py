"""Paths that exact search does not give cheaply: for several objectives at once (the Pareto front), and diverse paths.

Each group of ants follows its own weighting of the objectives, by the exact costs of that weighting over cells and headings
(`kernels.colony.grid_walk.costs_to_go`). It follows them closely in some cycles and loosely in others, so that it also finds
paths that are optimal for no weighting. The ants leave no pheromone: with it, fronts were no more complete in measurements.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.ants.grid_walk import NO_PATH, PART, AntGraph, Ants, plan_of
from antway.errors import BadParameter, TooLarge
from antway.grid import Moves
from antway.kernels.colony import grid_walk as kernel
from antway.planning import Budget, Clock, Plan, Problem, Status, start_clock

OBJECTIVES = ("length", "turns", "clearance", "exposure")
KEEN = (2.0, 4.0, 8.0)  # 1 / cells; beta in successive cycles
PURE = 100.0  # cells; with such a weight of another objective, length only breaks ties
WEIGHTS = {0: 1, 1: 12, 2: 5, 3: 3}  # number of weights for each objective besides length, by the number of these
SPREAD = 16.0  # weights go from 1 / SPREAD to SPREAD times the exchange rate between the ends of the front
_MOST_RISK = 1e100  # per m; integrals of it are finite
_MOST_BYTES = 1 << 32  # limit of memory for the costs of all weightings: 64 bytes a cell and weighting
_CUTTING = (Moves.EIGHT_NOSQUEEZE, Moves.EIGHT_CUT)  # moves that may cut corners
_SAME = 1e-9


@dataclass(frozen=True, slots=True, eq=False)
class Front:
    """Plans that do not dominate each other, the best by the first objective first.

    Attributes
    ----------
    status : Status
        FOUND, NO_PATH (proved), or BUDGET if time ran out (the plans so far are kept).
    objectives : tuple of str
    values : float64[P, M]
        For each plan: length (m), turns (changes of heading), clearance (smallest distance of the centres of its cells to a
        blocked cell or map edge, m, or 0 if a move cuts a corner; more is better), exposure (integral of the risk along the
        path).
    plans : tuple of Plan
    """

    status: Status
    objectives: tuple[str, ...]
    values: NDArray[np.float64]
    plans: tuple[Plan, ...]


def pareto(
    problem: Problem,
    *,
    objectives: Sequence[str] = ("length", "turns"),
    exposure: ArrayLike | None = None,
    seed: int = 0,
    budget: Budget = Budget(),
    ants: int = 30,
    cycles: int = 20,
    threads: int = 1,
) -> Front:
    """Return paths that trade several objectives against one another.

    Parameters
    ----------
    problem : Problem
        Its moves must be to the 4 or 8 neighbours.
    objectives : sequence of str
        At least one of length, turns, clearance, exposure.
    exposure : float[H, W] or None
        Risk of each cell per m of path, 0 to 1e100; needed if exposure is an objective.
    seed : int
    budget : Budget
        Its cycles, if any, replace `cycles`.
    ants : int
        Ants for each weighting and cycle. There are 12 weightings for one objective besides length, 25 for two, 27 for three;
        twice as many for clearance where moves may cut corners.
    cycles : int
    threads : int
        The answer is the same for any number.

    Raises
    ------
    BadParameter, TooLarge
        If an argument is not as above, or if all weightings need more than 4 GiB: from 1.2 million cells on for four
        objectives, and not at all for two.

    Examples
    --------
    >>> from antway import Grid
    >>> blocked = np.zeros((5, 8), dtype=bool); blocked[1, 2] = blocked[2, 5] = True
    >>> pareto(Problem(Grid(blocked), (0, 0), (4, 7))).values.round(2).tolist()
    [[9.24, 2.0], [11.0, 1.0]]
    """
    clock = start_clock(problem, seed, budget)
    listed = checks.sequence("objectives", objectives, f"names out of {', '.join(OBJECTIVES)}")
    names = tuple(checks.choice("objectives", name, OBJECTIVES) for name in listed)
    if not names or len(set(names)) < len(names):
        raise BadParameter("objectives", names, "one or more different objectives")
    grid = problem.grid
    risk = np.zeros(grid.shape)
    if "exposure" in names or exposure is not None:
        risk = checks.array("exposure", exposure, grid.shape)
        checks.number("exposure", float(risk.min()), low=0.0)
        checks.number("exposure", float(risk.max()), high=_MOST_RISK)
    extra = len(set(names) - {"length"})
    weightings = WEIGHTS[extra] ** extra * (1 + ("clearance" in names and problem.moves in _CUTTING))
    if 64 * weightings * grid.blocked.size > _MOST_BYTES:
        raise TooLarge("grid.shape", grid.shape, f"at most {_MOST_BYTES // (64 * weightings)} cells for these objectives")
    colony = _WeightedColony(problem, seed, ants, threads, clock)
    graph, archive = colony.graph, _Archive([OBJECTIVES.index(name) for name in names])
    cycles = checks.integer("cycles", cycles if budget.cycles is None else budget.cycles, low=0, high=5000)
    status, unit = colony.status(), 1.0
    if status is Status.FOUND:
        clearance = np.zeros(graph.distance.size)
        if "clearance" in names:
            clearance = graph.flat(grid.clearance() / grid.resolution)
        danger = np.where(np.isfinite(graph.distance), np.pad(risk, 1).ravel(), 0.0)  # no path is elsewhere
        # Scores are compared with the tolerance _SAME, whatever the unit of the risk. A power of two changes no digit of them.
        unit = 2.0 ** np.frexp(danger.max())[1]
        danger /= unit
        with colony.walkers:
            aims = _weightings(colony, archive, names, clearance, danger)
            for t in range(cycles):
                for value, turn in aims:
                    if colony.walk(value, turn, KEEN[t % len(KEEN)]):
                        archive.take(colony.score(clearance, danger), colony.walkers)
    if status is Status.FOUND and (clock.spent() or not archive.paths):
        status = Status.BUDGET
    order = np.argsort(archive.scores[:, 0], kind="stable")
    size = grid.resolution
    units = {"length": size, "turns": 1.0, "clearance": -size, "exposure": unit * size}
    values = archive.scores[order] * [units[name] for name in names]
    plans = tuple(plan_of(problem, Status.FOUND, archive.paths[i], graph.bound, 0, clock) for i in order)
    return Front(status, names, values, plans)


def alternatives(
    problem: Problem,
    k: int = 3,
    *,
    overlap: float = 0.6,
    apart: int = 2,
    path_ratio: float = 1.5,
    seed: int = 0,
    budget: Budget = Budget(),
    ants: int = 30,
    cycles: int = 8,
    threads: int = 1,
) -> tuple[Plan, ...]:
    """Return up to `k` different paths, the shortest first.

    Each further path is the shortest one that ants find while cells near the earlier paths become more and more expensive.

    Parameters
    ----------
    problem : Problem
        Its moves must be to the 4 or 8 neighbours.
    k : int
    overlap : float
        Largest part of a path that may be near another one, in [0, 1].
    apart : int
        Distance that counts as near, in cells; a diagonal counts as one.
    path_ratio : float
        Largest ratio of the longest to the shortest path, >= 1.
    seed : int
    budget : Budget
        Its cycles, if any, replace `cycles`.
    ants : int
        Ants in a cycle.
    cycles : int
        Cycles for each path; the cost near the other paths doubles with each cycle.
    threads : int
        The answer is the same for any number.

    Returns
    -------
    tuple of Plan
        At least one; without a path it has no cells, and its status says why.

    Examples
    --------
    >>> from antway import Grid
    >>> blocked = np.zeros((9, 15), dtype=bool); blocked[2:7, 5:10] = True
    >>> [round(plan.length, 2) for plan in alternatives(Problem(Grid(blocked), (4, 0), (4, 14)))]
    [16.49, 16.49]
    """
    clock = start_clock(problem, seed, budget)
    k = checks.integer("k", k, low=1, high=1000)
    overlap = checks.number("overlap", overlap, low=0.0, high=1.0)
    apart = checks.integer("apart", apart, low=0, high=1000)
    path_ratio = checks.number("path_ratio", path_ratio, low=1.0)
    colony = _WeightedColony(problem, seed, ants, threads, clock)
    cycles = checks.integer("cycles", cycles if budget.cycles is None else budget.cycles, low=0, high=5000)
    status, graph = colony.status(), colony.graph
    if status is not Status.FOUND or graph.bound == 0.0:
        return (plan_of(problem, status, NO_PATH if status is Status.FOUND else None, 0.0, 0, clock),)
    paths: list[NDArray[np.uint8]] = []
    near: list[NDArray[np.bool_]] = []  # the cells near each path

    def new_path(dearer: float) -> NDArray[np.uint8] | None:
        """Return the shortest new path of a cycle."""
        cost = 1.0 + dearer * sum((zone.astype(float) for zone in near), np.zeros(graph.distance.size))
        value = colony.costs_to_go(cost, 0.0, graph.for_kernels)
        found, longest = None, path_ratio * graph.bound * (1 + 1e-9)
        for beta in KEEN:
            if not colony.walk(value, 0.0, beta):
                continue
            for ant in np.argsort(colony.walkers.length, kind="stable"):
                if colony.walkers.length[ant] > longest:
                    break
                path = colony.walkers.path(ant)
                if all(zone[graph.cells(path)].mean() <= overlap for zone in near) and is_new(path):
                    found, longest = path, float(colony.walkers.length[ant]) * (1 - 1e-9)
                    break
        return found

    def places(path: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Return the cells of a path as (row, col)."""
        return np.column_stack(np.divmod(graph.cells(path), graph.net.width))

    def is_new(path: NDArray[np.uint8]) -> bool:
        """Tell whether a path is none of the earlier ones, and not too much of any of these is near it."""
        if any(np.array_equal(path, other) for other in paths):
            return False
        tree = scipy.spatial.KDTree(places(path))
        away = (np.asarray(tree.query(places(other), p=math.inf)[0]) for other in paths)
        return all((cells <= apart).mean() <= overlap for cells in away)

    with colony.walkers:
        for _ in range(k):
            tries = (new_path(2.0 ** min(cycle, 60)) for cycle in range(-2, cycles - 2) if not clock.spent())
            path = next((path for path in tries if path is not None), None)
            if path is None:
                break
            paths.append(path)
            passed = np.zeros(graph.distance.size, dtype=bool)
            passed[graph.cells(path)] = True
            near.append(np.pad(scipy.ndimage.maximum_filter(graph.net.inner(passed), 2 * apart + 1), 1).ravel())
    if not paths:
        return (plan_of(problem, Status.BUDGET, None, graph.bound, 0, clock),)
    plans = (plan_of(problem, Status.FOUND, path, graph.bound, 0, clock) for path in paths)
    return tuple(sorted(plans, key=lambda plan: plan.length))


class _WeightedColony:
    """Ants on the graph of a problem, which use one weighting of the objectives after another."""

    def __init__(self, problem: Problem, seed: int, ants: int, threads: int, clock: Clock) -> None:
        self.graph, self.clock, self.seed = AntGraph(problem), clock, checks.seed(seed)
        self._ants = checks.integer("ants", ants, low=1, high=10_000)
        self._threads = checks.integer("threads", threads, low=1, high=256)
        self._walked = 0

    @cached_property
    def around(self) -> kernel.GridGraph | None:
        """The graph without the moves that cut corners; None if there are no such moves."""
        problem = self.graph.problem
        if problem.moves not in _CUTTING:
            return None
        return AntGraph(replace(problem, moves=Moves.EIGHT)).for_kernels

    def status(self) -> Status:
        """Return NO_PATH or BUDGET if there is nothing to search; else prepare the search and return FOUND."""
        if self.clock.spent() or not self.graph.known(self.clock):
            return Status.BUDGET
        bound = self.graph.bound
        if bound == math.inf:
            return Status.NO_PATH
        self.walkers = Ants(self.graph, self._ants, int(8 * bound) + 64, threads=self._threads)
        return Status.FOUND

    def costs_to_go(self, cost: NDArray[np.float64], turn: float, legal: kernel.GridGraph) -> NDArray[np.float64]:
        """Return `kernels.colony.grid_walk.costs_to_go`, unfinished if the clock is spent: then no ant walks by them."""
        known = kernel.no_costs(legal)
        while not self.clock.spent() and not kernel.costs_to_go(legal, cost, turn, known, PART):
            pass
        return known.value

    def walk(self, value: NDArray[np.float64], turn: float, beta: float) -> bool:
        """Let the ants walk by the result of `costs_to_go`, unless the clock is spent; tell whether any ant arrived."""
        if self.clock.spent():
            return False
        heading = np.full((9, 8), max(math.exp(-beta * turn), 1e-5), dtype=np.float32)
        heading[range(8), range(8)] = heading[8] = 1.0
        self.walkers.walk(kernel.weights_by_cost(value, beta), self.seed, self._walked, self.clock, turn=heading)
        self._walked += self._ants
        return bool((self.walkers.depth >= 0).any())

    def score(self, clearance: NDArray[np.float64], danger: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the result of `kernels.colony.grid_walk.score` for the ants that walked last; who cuts a corner touches it."""
        walkers, graph, around = self.walkers, self.graph, self.around
        scores = kernel.score(graph.for_kernels, walkers.moves, walkers.depth, clearance, danger)
        if around is None:
            return scores
        for ant in np.flatnonzero(walkers.depth >= 0).tolist():
            path = walkers.path(ant)
            if not (around.legal[graph.cells(path)[:-1]] >> path & 1).all():
                scores[ant, 2] = -0.0
        return scores


class _Archive:
    """Paths that do not dominate each other in some columns of their scores."""

    def __init__(self, columns: list[int]) -> None:
        self.columns = columns
        self.scores = np.empty((0, len(columns)))
        self.paths: list[NDArray[np.uint8]] = []

    def take(self, scores: NDArray[np.float64], walkers: Ants) -> None:
        """Keep the paths that no other dominates; of equal ones the first."""
        for ant, own in enumerate(scores[:, self.columns]):
            if math.isinf(own[0]) or (self.scores <= own + _SAME).all(axis=1).any():
                continue
            keep = ~(self.scores >= own - _SAME).all(axis=1)
            self.scores = np.vstack((self.scores[keep], own))
            self.paths = [path for path, kept in zip(self.paths, keep) if kept] + [walkers.path(ant)]


def _weightings(
    colony: _WeightedColony,
    archive: _Archive,
    names: Sequence[str],
    clearance: NDArray[np.float64],
    danger: NDArray[np.float64],
) -> list[tuple[NDArray[np.float64], float]]:
    """Return the costs to go of each weighting, and the cost of a turn in it.

    Turns and exposure cost a number of cells of length. These rates are spread around the exchange rate between the ends of the
    front, the paths that are best by length or by one other objective alone. Clearance is a constraint: less than a level costs
    PURE, and where moves may cut corners, each weighting is also used without these moves.
    """

    def aim(turn: float, exposure: float, level: float, legal: kernel.GridGraph) -> tuple[NDArray[np.float64], float]:
        cost = 1.0 + exposure * danger + PURE * (clearance < level)
        return colony.costs_to_go(cost, turn, legal), turn

    graph = colony.graph
    widest = min(clearance[graph.start], clearance[graph.goal])
    most = {"turns": PURE, "exposure": PURE / max(float(danger.max()), 1e-300), "clearance": widest}
    extra = [name for name in most if name in names]
    ends = []
    for end in (None, *extra):
        turn, exposure, level = (most[name] * (1.0 if name == end else 1e-5) for name in most)  # the others break ties
        value, turn = aim(turn, exposure, level, graph.for_kernels)
        if colony.walk(value, turn, KEEN[-1]):
            scores = colony.score(clearance, danger)
            archive.take(scores, colony.walkers)
            column = OBJECTIVES.index(end or "length")
            ends.append(scores[np.lexsort((scores[:, 0], scores[:, column]))[0]])
    span = np.ptp(np.array(ends), axis=0) if ends else np.zeros(len(OBJECTIVES))
    number = WEIGHTS[len(extra)]
    rates = np.geomspace(1 / SPREAD, SPREAD, number)
    levels = np.unique(clearance[np.isfinite(graph.distance) & (clearance <= widest)])
    choices = {"clearance": levels[np.linspace(0, len(levels) - 1, number).round().astype(int)]}
    for name, column in (("turns", 1), ("exposure", 3)):
        known = span[0] > _SAME and span[column] > _SAME
        choices[name] = rates * (span[0] / span[column] if known else most[name] / PURE)
    graphs = [graph.for_kernels]
    if "clearance" in names and colony.around is not None:
        graphs.append(colony.around)
    chosen = product(*(choices[name] if name in extra else (0.0,) for name in most))
    wanted = ((*numbers, legal) for numbers in chosen for legal in graphs if not colony.clock.spent())
    return [aim(*one) for one in wanted]
