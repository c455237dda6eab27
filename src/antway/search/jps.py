"""The default planner."""

from __future__ import annotations

from antway.planning import Budget, Plan, Problem
from antway.search.astar import astar


def jps(problem: Problem, *, seed: int = 0, budget: Budget = Budget()) -> Plan:
    """Return a shortest path."""
    return astar(problem, seed=seed, budget=budget)
