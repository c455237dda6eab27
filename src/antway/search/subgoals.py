"""Shortest paths on a map with many queries: a contraction hierarchy over its corners, made beforehand."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.grid import Grid, Moves, kept
from antway.kernels.base.jit import call
from antway.kernels.search.hierarchy import FREE, FULL, LINKED, OPEN, RANKED, RUNNING, Memory, contract, upward_graph
from antway.kernels.search.hierarchy_query import QueryMemory, UpwardGraph, route, route_all
from antway.kernels.search.subgoals import SubgoalMap, corners, link
from antway.planning import Budget, Clock, Plan, Problem, start_clock
from antway.search.derived import lattice, longer, packed_lines
from antway.search.jps import jps
from antway.search.result import found_shortest, not_found

CHUNK = 256  # queries between two moments at which Python handles signals
STEPS = 1 << 18  # steps of the preparation between two looks at the clock, about 10 ms
MOST_STEPS = 64, 32, 1 << 25  # limits: steps per cell; steps per corner, and a constant number: seconds on any map


def subgoals(problem: Problem, *, seed: int = 0, budget: Budget = Budget()) -> Plan:
    """Return a shortest path: for `Moves.EIGHT` by the hierarchy of the map where it has one, else as `jps` does.

    The hierarchy is made by `prepare`, or by the first query on a grid, which then takes longer, and is kept with the grid.
    Parameters and result are those of `antway.search.jps.jps`.

    Examples
    --------
    >>> subgoals(Problem(Grid(np.zeros((3, 3), dtype=bool)), (0, 0), (1, 2))).cells.tolist()
    [[0, 0], [1, 1], [1, 2]]
    """
    clock = start_clock(problem, seed, budget)
    if problem.moves is not Moves.EIGHT:
        return jps(problem, seed=seed, budget=budget)
    hierarchy = hierarchy_of(problem.grid)
    if not hierarchy.make(problem.grid, clock) or clock.spent():
        return not_found(False, 0, clock)
    return hierarchy.plan(problem, clock) if hierarchy.pays else jps(problem, seed=seed, budget=budget)


def prepare(grid: Grid) -> bool:
    """Make the hierarchy of `grid` for the planner `subgoals`, and tell whether it has one.

    There is none if so many corners see each other that making it would exceed a limit of work (not of time): on wide open
    maps, where jump points are best, and on maps with many isolated cells.

    Examples
    --------
    >>> prepare(Grid(np.zeros((3, 3), dtype=bool)))
    True
    """
    hierarchy = hierarchy_of(checks.instance("grid", grid, Grid))
    hierarchy.make(grid, Budget().start())
    return hierarchy.pays


def hierarchy_of(grid: Grid) -> Hierarchy:
    """Return the hierarchy of `grid`, which may not have been made yet."""
    return kept(grid, "subgoals", Hierarchy)


def _unlinked(n: int, edges: int) -> Memory:
    """Return a graph of n nodes that has no edges yet, and memory for `edges` of them."""
    first, rank, level, ends = np.full(n, -1, np.int32), np.full(n, -1, np.int32), *np.zeros((2, n), np.int32)
    order, local = np.column_stack((np.zeros(n, np.int64), np.arange(n))), np.zeros((n, 2), np.int64)
    state = np.zeros(6, np.int64)
    state[FREE], state[OPEN] = -1, n
    rows, weight, heap = np.empty((edges, 5), np.int32), np.empty(edges, np.int64), np.empty((edges, 2), np.int64)
    return Memory(first, rows, weight, order, level, rank, local, heap, ends, state)


class Hierarchy:
    """The contraction hierarchy over the corners of a map with `Moves.EIGHT`, if it `pays`; any thread may use it."""

    def __init__(self) -> None:
        self.lock, self.made, self.pays = threading.Lock(), False, True
        self.making: Iterator[bool] | None = None
        self.graphs: tuple[SubgoalMap, UpwardGraph]  # set once it is made
        self.sizes = (0, 0, 0, 0)
        self.spare: list[QueryMemory] = []

    def make(self, grid: Grid, clock: Clock) -> bool:
        """Continue making the hierarchy of `grid` until it is done or the clock runs out; tell whether it is done."""
        if not self.made:
            lattice(grid, Moves.EIGHT)  # kept with the grid, so that it can be made before the first look at the clock
        while not self.made and not clock.spent():
            with self.lock:
                try:
                    self.making = self.making or self._chunks(grid)
                    self.made = next(self.making, True)
                except BaseException:  # such as Ctrl-C, which ends the generator: the next call begins anew
                    self.making = None
                    raise
        return self.made

    def _chunks(self, grid: Grid) -> Iterator[bool]:
        """Make the hierarchy, and yield False after each part of the work, from where on it no longer needs the grid."""
        net = lattice(grid, Moves.EIGHT)
        is_corner = corners(net.around).reshape(grid.shape)
        nodes = np.flatnonzero(is_corner)
        number = np.full((grid.shape[0] + 2, grid.shape[1] + 2), -1, np.int32)
        number[1:-1, 1:-1][is_corner] = np.arange(len(nodes))
        subgoal_map = SubgoalMap(net, packed_lines(grid.blocked | is_corner), number.ravel())
        n, seeds, (by_cell, by_corner, besides) = len(nodes), 8 * max(grid.shape) + 16, MOST_STEPS
        left = min(by_cell * grid.blocked.size, by_corner * n + besides)
        del grid  # what is kept for a grid must not keep the grid
        yield False
        memory = _unlinked(n, 8 * n + seeds)
        while memory.state[RANKED] < n:
            if memory.state[LINKED] < n:
                code = link(subgoal_map, nodes, memory, STEPS)
            else:
                code = contract(memory, STEPS)
            if code == FULL:
                memory = memory._replace(edges=longer(memory.edges), weight=longer(memory.weight), heap=longer(memory.heap))
            elif code == RUNNING:
                left -= STEPS
            if left < 0:
                self.pays = False
                return
            yield False
        number[number >= 0] = memory.rank
        cells = np.empty((n, 2), np.int32)
        cells[memory.rank] = np.column_stack(np.divmod(nodes, net.width))
        row_start, up, parts = upward_graph(memory)
        self.graphs = subgoal_map, UpwardGraph(row_start, up, parts, cells)
        self.sizes = n, len(up) + seeds, seeds, int(memory.level.max(initial=0)) + 3

    def plan(self, problem: Problem, clock: Clock) -> Plan:
        """Solve a problem on this map."""
        work = self.spare.pop() if self.spare else self._workspace()
        try:
            path, diagonals, expanded = call(route, *self.graphs, work, *problem.start, *problem.goal)
        finally:
            self.spare.append(work)
        if not len(path):
            return not_found(True, int(expanded), clock)
        return found_shortest(problem.grid, path, diagonals, int(expanded), clock)

    def plan_all(
        self, ends: NDArray[np.int64], path_start: NDArray[np.int64], diagonals: NDArray[np.int64]
    ) -> NDArray[np.int32]:
        """Solve many queries; see the kernel `route_all`."""
        paths, query = np.empty((64 * len(ends) + 1024, 2), np.int32), 0
        work = self.spare.pop() if self.spare else self._workspace()
        try:
            while query < len(ends):
                last = min(query + CHUNK, len(ends))
                query = route_all(*self.graphs, work, ends[:last], query, path_start, paths, diagonals)
                if query < last:
                    paths = longer(paths)
        finally:
            self.spare.append(work)
        return paths

    def _workspace(self) -> QueryMemory:
        nodes, entries, seeds, deep = self.sizes
        label, came = np.zeros((2, nodes, 2), np.int64), np.empty((2, nodes, 2), np.int32)
        heaps, seen = np.empty((2, entries, 2), np.int64), np.empty((2, seeds, 2), np.int64)
        return QueryMemory(label, came, heaps, seen, np.empty((deep, 3), np.int32), np.zeros(1, np.int64))
