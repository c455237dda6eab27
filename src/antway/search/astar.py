"""A*."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from antway.grid import Moves
from antway.kernels.astar import DONE, FULL, RUNNING, expand, octile, trace, trace_jumps
from antway.kernels.buckets import CUT, DIAGONAL, EXPANDED, LIMIT, STRAIGHT
from antway.kernels.canonical import START
from antway.planning import Budget, Clock, Plan, Problem
from antway.search import heap
from antway.search.costs import checked_costs
from antway.search.derived import NEIGHBOURS, lattice, packed
from antway.search.dijkstra import spread_plan
from antway.search.result import found, not_found
from antway.search.workspace import workspace

STEPS = 1 << 16  # cells expanded between two looks at the clock, about 5 ms
_NO_WORDS = np.empty(0, np.uint64)


def astar(problem: Problem, *, seed: int = 0, budget: Budget = Budget(), costs: ArrayLike | None = None) -> Plan:
    """Return a shortest path, by A*; parameters and result as for `antway.search.dijkstra.dijkstra`."""
    clock = budget.start()
    if costs is not None or problem.moves not in NEIGHBOURS:
        weights = None if costs is None else checked_costs(costs, problem.grid)
        return heap.plan(problem, clock, heuristic=True, costs=weights)
    return canonical_astar(problem, clock)


def canonical_astar(problem: Problem, clock: Clock, jumping: bool = False) -> Plan:
    """Solve a problem with 4 or 8 moves by A* with canonical successors, one move or (8 moves only) one jump away."""
    grid, (row, col), (goal_row, goal_col) = problem.grid, problem.start, problem.goal
    net = lattice(grid, problem.moves)
    shorter = STRAIGHT if problem.moves is Moves.FOUR else DIAGONAL - STRAIGHT
    estimate = octile(row, col, goal_row, goal_col, shorter)
    if estimate >= LIMIT:
        return spread_plan(problem, clock)
    words = packed(grid) if jumping else _NO_WORDS
    with workspace(grid) as work:
        code, start = RUNNING, net.at(problem.start)
        work.label[start], work.came[start] = work.base, START
        work.open(row, col, estimate)
        while code != DONE and not clock.spent():
            code = expand(
                *(net.around, net.table, net.width, goal_row, goal_col, shorter, work.base, work.label, work.came),
                *(work.parent, work.reached, jumping, words),
                *(work.first, work.filled, work.entries, work.state, STEPS),
            )
            if code == FULL:
                work.grow()
        expanded = int(work.state[EXPANDED])
        if code == DONE and work.label[net.at(problem.goal)] < work.base + LIMIT:
            if jumping:
                return found(problem, trace_jumps(work.parent, start, net.at(problem.goal), net.width), expanded, clock)
            return found(problem, trace(work.came, goal_row, goal_col, net.width), expanded, clock)
        if code == DONE and work.state[CUT]:
            return spread_plan(problem, clock)
    return not_found(code == DONE, expanded, clock)
