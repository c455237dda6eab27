"""Jump point search, the default planner."""

from __future__ import annotations

from antway.grid import Grid, Moves, kept
from antway.planning import Budget, Plan, Problem, start_clock
from antway.search.astar import astar, searcher


def jps(problem: Problem, *, seed: int = 0, budget: Budget = Budget()) -> Plan:
    """Return a shortest path: for `Moves.EIGHT` by jump points on the bit-packed map where they pay, else as `astar` does.

    The packed map is made at the first query on a grid and kept.

    Parameters
    ----------
    problem : Problem
    seed : int
        Not used.
    budget : Budget

    Examples
    --------
    >>> jps(Problem(Grid([[0] * 3] * 3), (0, 0), (1, 2))).cells.tolist()
    [[0, 0], [1, 1], [1, 2]]
    """
    clock = start_clock(problem, seed, budget)
    if problem.moves is not Moves.EIGHT:
        return astar(problem, seed=seed, budget=budget)
    grid = problem.grid
    return kept(grid, "jps", lambda: searcher(grid, Moves.EIGHT, jumps_pay(grid))).plan(problem, clock)


def jumps_pay(grid: Grid) -> bool:
    """Tell whether jumps are at least as fast as single moves, which they are not on large maps with many isolated cells.

    On such maps every jump stops after a few cells, while diagonals are long, and beyond about a million cells the lines that
    diagonals look along no longer fit into the cache. Nor are they used on maps of more than 2^18 rows or columns, on which a
    jump could be too long for costs in 32 bits.
    """
    if max(grid.shape) > 1 << 18:
        return False
    return grid.blocked.size <= 1 << 20 or kept(grid, "isolated", lambda: _isolated(grid)) < 0.1


def _isolated(grid: Grid) -> float:
    """Return the share of the blocked cells without a blocked neighbour, in a sample of about half a million cells."""
    every = max(1, grid.blocked.size >> 19)
    above, here, below = (grid.blocked[i : i - 2 or None : every] for i in range(3))
    beside = above | below
    beside[:, 1:] |= here[:, :-1]
    beside[:, :-1] |= here[:, 1:]
    return float((here & ~beside).sum()) / max(1.0, float(here.sum()))
