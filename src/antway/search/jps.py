"""Jump point search, and the default planner: jumps on open maps, single moves on cluttered ones."""

from __future__ import annotations

from antway.grid import Moves
from antway.planning import Budget, Plan, Problem
from antway.search.astar import astar, searcher


def jps(problem: Problem, *, seed: int = 0, budget: Budget = Budget()) -> Plan:
    """Return a shortest path."""
    if problem.moves is not Moves.EIGHT:
        return astar(problem, seed=seed, budget=budget)
    return searcher(problem.grid, problem.moves, jumping=True).plan(problem, budget.start())
