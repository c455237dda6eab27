"""A*."""

from __future__ import annotations

from numpy.typing import ArrayLike

from antway.planning import Budget, Plan, Problem
from antway.search import heap
from antway.search.costs import checked_costs


def astar(problem: Problem, *, seed: int = 0, budget: Budget = Budget(), costs: ArrayLike | None = None) -> Plan:
    """Return a shortest path, by A*; parameters and result as for `antway.search.dijkstra.dijkstra`."""
    clock = budget.start()
    return heap.plan(problem, clock, heuristic=True, costs=None if costs is None else checked_costs(costs, problem.grid))
