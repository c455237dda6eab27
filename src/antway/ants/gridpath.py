"""Ants as an anytime planner on a grid: the paper's colony, its improvements, and its history for pictures.

On a static grid exact search is always faster. Ants are useful where the search is local, has several objectives
(`front.pareto`), or must give several paths (`front.alternatives`).
"""

from __future__ import annotations

import inspect
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.ants.grid_walk import NO_PATH, AntGraph, Ants, Trail, plan_of
from antway.ants.immune import Immune, Immunity
from antway.ants.persistence import Constant, Persistence
from antway.ants.rules import MaxMinAntSystem, Rule, make_rule
from antway.errors import BadParameter
from antway.grid import Grid, Moves
from antway.kernels.colony.grid_walk import entropy
from antway.planning import Budget, Plan, Problem, Status, start_clock

BETA = {"field": 8.0, "distance": 7.0, "goal": 7.0}  # default beta for each heuristic, see `explore`
# With few cycles a colony must forget fast: with the usual 0.98 more than a third of the initial pheromone is left after 50.
MMAS_ON_GRIDS = MaxMinAntSystem(persistence=Constant(0.8))
Window = tuple[int, int, int, int]  # (row, col, rows, columns)


@dataclass(frozen=True, slots=True, eq=False)
class Exploration:
    """The result of a colony.

    Attributes
    ----------
    plan : Plan
        Its cells are those of the whole map; `optimal`, `lower_bound` and NO_PATH refer to paths within the window that avoid
        the forbidden cells.
    history : float64[C, 4]
        For each cycle: length of the best path so far and mean length of the cycle's paths (m), share of the ants that arrived,
        entropy of the pheromone over all moves (nats); infinite and NaN if there is no path.
    pheromone : float64[h, w, 8]
        For each cell of the window and each move, in the order of `Moves.EIGHT.offsets`; 0 if a move is not legal.
    window : (row, col, rows, columns)
    """

    plan: Plan
    history: NDArray[np.float64]
    pheromone: NDArray[np.float64]
    window: Window

    @property
    def pheromone_by_cell(self) -> NDArray[np.float32]:
        """Sum of the pheromone over the moves of each cell of the window, float32[h, w]."""
        return np.array(self.pheromone.sum(axis=2), np.float32)


def ants(problem: Problem, *, seed: int = 0, budget: Budget = Budget(), **options: Any) -> Plan:
    """Return the best path that a colony finds; it stops once the lower bound proves that path optimal.

    Parameters
    ----------
    problem : Problem
        Its moves must be to the 4 or 8 neighbours.
    seed : int
    budget : Budget
        When time runs out, the best path so far is returned with `Status.BUDGET`. The clock is read every 2^15 cells and every
        2^18 ant steps.
    **options
        Those of `explore` from `rule` to `threads`.

    Examples
    --------
    >>> from antway import Grid
    >>> plan = ants(Problem(Grid(np.zeros((9, 9), dtype=bool)), (0, 0), (8, 8)))
    >>> round(plan.length, 3), plan.optimal
    (11.314, True)
    """
    set_here = ("problem", "seed", "budget", "record", "stop_at_bound")
    known = [name for name in inspect.signature(explore).parameters if name not in set_here]
    for name in options:
        if name not in known:
            raise BadParameter(name, options[name], f"left out: the options are {', '.join(known)}")
    return explore(problem, seed=seed, budget=budget, record=False, stop_at_bound=True, **options).plan


def explore(
    problem: Problem,
    *,
    seed: int = 0,
    budget: Budget = Budget(),
    rule: str | Rule = "as",
    persistence: Persistence | None = None,
    ants: int | None = None,
    cycles: int = 50,
    alpha: float | None = None,
    beta: float | None = None,
    heuristic: str = "field",
    step_limit: int | None = None,
    retreat: bool = True,
    pheromone: str | ArrayLike = "uniform",
    window: Window | None = None,
    forbidden: ArrayLike | None = None,
    immune: Immune | None = None,
    threads: int = 1,
    record: bool = True,
    stop_at_bound: bool = False,
) -> Exploration:
    """Let a colony search a grid, or a window of it, and return the best path with the pheromone and the history.

    Parameters
    ----------
    problem : Problem
        Its moves must be to the 4 or 8 neighbours.
    seed : int
    budget : Budget
        Its cycles, if any, replace `cycles`.
    rule : str or Rule
        as, eas, rank, mmas, acs, or a rule of `antway.ants.rules`; `persistence`, `ants`, `alpha`, `beta` override it. The
        name mmas stands for `MMAS_ON_GRIDS`.
    persistence : Persistence or None
        How much pheromone remains after a cycle; None: that of the rule.
    ants : int or None
        Ants in a cycle; None: that of the rule, or 50.
    cycles : int
    alpha, beta : float or None
        Exponents of pheromone and heuristic in Eq. (1), in [0, 100]; None: those of the rule, with beta 7 or 8 for a name.
    heuristic : str
        field: eta = exp(-detour by the move), in cells, by exact distances to the goal; distance: eta = 1 / exact distance of
        the next cell to the goal; goal: eta = 1 / straight distance of the next cell to the goal.
    step_limit : int or None
        Number of steps after which an ant dies; None: 64 plus 8 times the length of the shortest path in cells.
    retreat : bool
        Whether an ant leaves a dead end again and never returns; otherwise it dies there.
    pheromone : str or float[h, w, 8]
        Initial pheromone: uniform; corridor (the less, the longer the shortest path over a move); or that of an earlier colony.
    window : (row, col, rows, columns) or None
        The search stays within this rectangle.
    forbidden : bool[H, W] or None
        Cells of the whole map to avoid besides the blocked ones; the start is never forbidden.
    immune : Immune or None
        The immune operator, applied between construction and deposit; see `antway.ants.immune`.
    threads : int
        The answer is the same for any number.
    record : bool
        Whether to keep the history.
    stop_at_bound : bool
        Whether to stop once the best path is proved optimal.

    Raises
    ------
    BadParameter, TooLarge
        For a parameter out of range, or more than 4,194,304 cells in the window.

    References
    ----------
    Eqs. (1), (2), III.D and Steps 4-7 of the paper; docs/equations.md.

    Examples
    --------
    >>> from antway import Grid
    >>> found = explore(Problem(Grid(np.zeros((20, 30), dtype=bool)), (5, 5), (5, 12)), window=(0, 0, 10, 15), cycles=3)
    >>> found.plan.length, found.history.shape, found.pheromone_by_cell.shape
    (7.0, (3, 4), (10, 15))
    """
    clock = start_clock(problem, seed, budget)
    for name, flag in (("retreat", retreat), ("record", record), ("stop_at_bound", stop_at_bound)):
        checks.instance(name, flag, bool)
    cycles = checks.integer("cycles", cycles if budget.cycles is None else budget.cycles, low=0)
    checks.choice("heuristic", heuristic, BETA)
    if isinstance(rule, str):
        beta = BETA[heuristic] if beta is None else beta
        rule = MMAS_ON_GRIDS if rule == "mmas" else rule
    colony = make_rule(rule, persistence=persistence, ants=ants, alpha=alpha, beta=beta)
    number = colony.ants or 50
    checks.integer("ants * cycles", number * cycles, high=2**31 - 2)
    threads = checks.integer("threads", threads, low=1, high=256)
    if step_limit is not None:
        step_limit = checks.integer("step_limit", step_limit, low=0, high=2**24)
    immunity = None if immune is None else Immunity(checks.instance("immune", immune, Immune), False, seed)
    local, window = _local(problem, window, forbidden)
    if isinstance(pheromone, str):
        checks.choice("pheromone", pheromone, ("uniform", "corridor"))
    else:
        pheromone = checks.array("pheromone", pheromone, (*window[2:], 8))

    def result(status: Status, path: NDArray[np.uint8] | None = None, bound: float = 0.0, steps: int = 0) -> Exploration:
        tau = np.zeros((*window[2:], 8)) if trail is None else trail.tau.reshape(window[2] + 2, -1, 8)[1:-1, 1:-1]
        plan = plan_of(problem, status, path, bound, steps, clock)
        return Exploration(plan, np.array(history).reshape(-1, 4), tau, window)

    trail: Trail | None = None
    history: list[tuple[float, float, float, float]] = []
    if local is None:
        return result(Status.NO_PATH)
    graph = AntGraph(local)
    if clock.spent() or not graph.known(clock):
        return result(Status.BUDGET)
    if graph.bound == math.inf:
        return result(Status.NO_PATH)
    if graph.bound == 0.0:
        return result(Status.FOUND, NO_PATH)
    if clock.spent():
        return result(Status.BUDGET, bound=graph.bound)
    trail = Trail(graph, colony, number, heuristic, clock)
    _set_pheromone(trail, pheromone)
    steps, proved, spent = 0, False, False
    most = int(8 * graph.bound) + 64 if step_limit is None else step_limit
    with Ants(graph, number, most, retreat=retreat, threads=threads) as walkers:
        for t in range(cycles):
            weights, spent = trail.weights(), clock.spent()
            if spent:
                break
            steps += walkers.walk(weights, seed, t * number, clock, greedy=trail.numbers.q0)
            trail.learn(walkers, t, immunity)
            if record:
                history.append(_row(walkers, trail, local.grid.resolution))
            proved, spent = trail.best <= graph.bound * (1 + 1e-9), clock.spent()
            if spent or (proved and stop_at_bound):
                break
    done = trail.best < math.inf and (proved or not spent)
    return result(Status.FOUND if done else Status.BUDGET, trail.path if trail.best < math.inf else None, graph.bound, steps)


def _local(problem: Problem, window: Window | None, forbidden: ArrayLike | None) -> tuple[Problem | None, Window]:
    """Return the problem on the window, None if its goal is forbidden, and the window."""
    grid, shape = problem.grid, problem.grid.shape
    if window is None:
        window = (0, 0, *shape)
    row, col, rows, cols = rectangle = tuple(int(v) for v in checks.point("window", window, size=4))
    on_map = row >= 0 and col >= 0 and row + rows <= shape[0] and col + cols <= shape[1]
    inside = all(row <= r < row + rows and col <= c < col + cols for r, c in (problem.start, problem.goal))
    if rectangle != tuple(window) or not (on_map and inside):
        raise BadParameter("window", window, "a rectangle (row, col, rows, columns) on the map that holds start and goal")
    mask = None
    if forbidden is not None:
        mask = np.array(checks.raw("forbidden", forbidden, "bool[H, W]"), dtype=bool)
        if mask.shape != shape:
            raise BadParameter("forbidden.shape", mask.shape, f"that of the map, {shape}")
        if mask[problem.goal] and problem.goal != problem.start:
            return None, (row, col, rows, cols)
        mask[problem.start] = False
    if mask is not None or (rows, cols) != shape:
        part = slice(row, row + rows), slice(col, col + cols)
        blocked = grid.blocked[part] if mask is None else grid.blocked[part] | mask[part]
        grid = Grid(blocked, resolution=grid.resolution)
    start, goal = ((r - row, c - col) for r, c in (problem.start, problem.goal))
    return Problem(grid, start, goal, problem.moves), (row, col, rows, cols)


def _set_pheromone(trail: Trail, pheromone: str | NDArray[np.float64]) -> None:
    """Set the initial pheromone of a colony, if it is not uniform."""
    if isinstance(pheromone, str) and pheromone == "uniform":
        return
    graph = trail.graph
    legal = trail.tau > 0
    if isinstance(pheromone, str):
        from_cell = graph.distance_from(graph.problem.start)
        cell, move = np.nonzero(legal)
        over = from_cell[cell] + Moves.EIGHT.lengths[move] + graph.distance[cell + graph.offsets[move]]
        trail.tau[cell, move] *= np.exp(graph.bound - over)
    else:
        trail.tau = np.where(legal, graph.flat(pheromone), 0.0)
        if not (trail.tau[legal] > 0).all():
            raise BadParameter("pheromone", float(trail.tau[legal].min()), "> 0 on every legal move")
    trail.tau[legal] = trail.tau[legal].clip(trail.tau_min, trail.tau_max)


def _row(walkers: Ants, trail: Trail, resolution: float) -> tuple[float, float, float, float]:
    """Return a row of the history."""
    arrived = walkers.length[walkers.depth >= 0]
    mean = float(arrived.mean()) * resolution if arrived.size else math.nan
    return trail.best * resolution, mean, arrived.size / walkers.length.size, entropy(trail.tau)
