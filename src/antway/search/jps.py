"""Jump point search, the default planner."""

from __future__ import annotations

from antway.grid import Moves
from antway.planning import Budget, Plan, Problem
from antway.search.astar import astar, searcher


def jps(problem: Problem, *, seed: int = 0, budget: Budget = Budget()) -> Plan:
    """Return a shortest path, by jump points on the bit-packed map for `Moves.EIGHT`, and as `astar` does for other moves.

    Jumps look at 63 cells at a time, and a way that is clear is answered at once, so that nothing is lost against single moves
    even on cluttered maps (see `benchmarks/search.py`). The packed map is made at the first query on a grid and kept with it.

    Parameters
    ----------
    problem : Problem
    seed : int
        Not used.
    budget : Budget

    Returns
    -------
    Plan

    Examples
    --------
    >>> import numpy as np
    >>> from antway.grid import Grid
    >>> jps(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (1, 2))).cells.tolist()
    [[0, 0], [1, 1], [1, 2]]
    """
    if problem.moves is not Moves.EIGHT:
        return astar(problem, seed=seed, budget=budget)
    return searcher(problem.grid, problem.moves, jumping=True).plan(problem, budget.start())
