"""A* with canonical successors, one move or one jump away."""

from __future__ import annotations

import mmap

import numpy as np
from numpy.typing import ArrayLike

from antway.grid import Grid, Moves, kept
from antway.kernels.base.jit import call
from antway.kernels.search.astar import DONE, FULL, HIGHEST, LOWEST, RUNNING, Memory, SearchMap, solve
from antway.kernels.search.buckets import BLOCKS, CUT, KEYS, LIMIT, Queue
from antway.kernels.search.lengths import DIAGONAL, STRAIGHT, octile
from antway.planning import Budget, Clock, Plan, Problem, start_clock
from antway.search import best_first as heap
from antway.search.derived import NEIGHBOURS, lattice, longer, packed_lines
from antway.search.distance_field import spread_plan
from antway.search.result import found_shortest, not_found

STEPS = 1 << 16  # steps of the kernel between two looks at the clock, about 5 ms
MOST_CELLS = 1 << 27  # limit of cells, because 16 times the index of a cell must fit into 32 bits
_NO_WORDS = np.empty(0, np.uint64)


def astar(problem: Problem, *, seed: int = 0, budget: Budget = Budget(), costs: ArrayLike | None = None) -> Plan:
    """Return a shortest path, by A*; parameters and result as for `antway.search.distance_field.dijkstra`.

    Examples
    --------
    >>> astar(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (2, 2))).cells.tolist()
    [[0, 0], [1, 1], [2, 2]]
    """
    clock = start_clock(problem, seed, budget)
    if costs is not None or problem.moves not in NEIGHBOURS:
        return heap.plan(problem, clock, heuristic=True, costs=costs)
    return searcher(problem.grid, problem.moves, jumping=False).plan(problem, clock)


class Workspace:
    """The memory of a search, which all searches on the same map reuse, so that a query clears and allocates nothing.

    Labels of a search are in [base, base + LIMIT), below those of all earlier searches and below 0, the value of fresh memory.
    When the range of int32 is used up, after 46 searches and then after every 92, the labels are cleared.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        # From a start, jumps lead in 8 directions: each cell of 4 diagonals appends up to 2 successors, and one more is tried.
        cells, longest = shape[0] * shape[1], 4 * min(shape) + 16
        self.base = 0
        # np.zeros would use huge pages, but jumps touch only a few cells all over the map.
        nodes = np.frombuffer(mmap.mmap(-1, 8 * cells), np.int32).reshape(cells, 2)
        first, filled = np.full(KEYS + BLOCKS, -1, np.int32), np.zeros(KEYS // 64, np.uint64)
        queue = Queue(first, filled, np.empty((16 * longest, 5), np.int32), np.zeros(7, np.int64))
        self.memory = Memory(nodes, np.empty((longest, 4), np.int32), queue)

    def initialize(self) -> None:
        """Choose the labels of the next search."""
        self.base -= LIMIT
        if self.base < LOWEST:
            self.memory.nodes.fill(HIGHEST)
            self.base = HIGHEST - LIMIT

    def grow(self) -> None:
        """Double the capacity for entries of the queue."""
        queue = self.memory.queue
        self.memory = self.memory._replace(queue=queue._replace(entries=longer(queue.entries)))


class Searcher:
    """Searches on one map with moves of 4 or 8 neighbours, and the workspaces they use; any thread may call it."""

    def __init__(self, grid: Grid, moves: Moves, jumping: bool) -> None:
        shorter = STRAIGHT if moves is Moves.FOUR else DIAGONAL - STRAIGHT
        words = kept(grid, "packed", lambda: packed_lines(grid.blocked)) if jumping else _NO_WORDS
        self.map = SearchMap(lattice(grid, moves), words, shorter)
        self.shape = grid.shape
        self.far = octile(0, 0, *grid.shape, STRAIGHT, shorter) >= LIMIT  # whether a path may be too long for 32-bit integers
        self.large = grid.blocked.size >= MOST_CELLS
        self.spare: list[Workspace] = kept(grid, "workspaces", list)

    def workspace(self) -> Workspace:
        """Return a workspace for this map; append it to `spare` after use."""
        return self.spare.pop() if self.spare else Workspace(self.shape)

    def plan(self, problem: Problem, clock: Clock) -> Plan:
        """Solve `problem`, which must be one on this map."""
        (row, col), (goal_row, goal_col) = problem.start, problem.goal
        if self.large or (self.far and octile(row, col, goal_row, goal_col, STRAIGHT, self.map.shorter) >= LIMIT):
            return spread_plan(problem, clock)
        work = self.workspace()
        try:
            work.initialize()
            code, fresh, expanded = RUNNING, True, 0
            while code != DONE and not clock.spent():
                ends, memory = (row, col, goal_row, goal_col), (work.memory, work.base)
                code, path, diagonals, expanded = call(solve, self.map, *memory, *ends, fresh, STEPS)
                fresh = False
                if code == FULL:
                    work.grow()
            cut = code == DONE and not len(path) and bool(work.memory.queue.state[CUT])
        finally:
            self.spare.append(work)
        if code == DONE and len(path):
            return found_shortest(problem.grid, path, diagonals, int(expanded), clock)
        if cut:  # all remaining paths are too long for 32-bit integers
            return spread_plan(problem, clock)
        return not_found(code == DONE, int(expanded), clock)


def searcher(grid: Grid, moves: Moves, jumping: bool) -> Searcher:
    """Return the searcher of `grid`; made once."""
    return kept(grid, (moves, jumping), lambda: Searcher(grid, moves, jumping))
