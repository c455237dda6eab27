"""Best-first search over any moves and costs, which planners use where no faster kernel applies."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway.grid import Cell, Grid, Moves
from antway.kernels.search.best_first import EXHAUSTED, FOUND, RUNNING, Graph, Memory, best_first, gauge, open_cell
from antway.planning import Clock, Plan, Problem
from antway.search.costs import checked_costs
from antway.search.derived import graph
from antway.search.result import found, not_found

STEPS = 1 << 16  # expansions between two looks at the clock, about 10 ms
_NO_COST = np.empty(0)
_NO_FACES = np.empty((0, 2))


@cache
def faces(moves: Moves) -> NDArray[np.float64]:
    """Return the faces (p, q) of the moves' unit ball in the octant of (a, b), a >= b >= 0; see the kernel `gauge`."""
    corners = sorted({(max(abs(r), abs(c)), min(abs(r), abs(c))) for r, c in moves.offsets.tolist()}, key=lambda v: v[1] / v[0])
    if moves is Moves.FOUR:
        return np.ones((1, 2))
    return np.array([np.linalg.solve([u, v], [math.hypot(*u), math.hypot(*v)]) for u, v in pairwise(corners)])


class Search:
    """A search from `sources` by the kernel `best_first`, in slices; `label`, float64[cells], has the costs in cells so far."""

    def __init__(
        self, net: Graph, sources: list[Cell], goal: Cell | None, costs: NDArray[np.float64] | None, faces: NDArray[np.float64]
    ) -> None:
        cells = net.legal.size
        self.net, self.faces = net, faces
        self.goal = -1 if goal is None else net.at(goal)
        self.cost = _NO_COST if costs is None else np.pad(costs, net.margin, constant_values=np.inf).ravel()
        label, key, arrived = np.full(cells, np.inf), np.full(cells, np.inf), np.full(cells, -1, np.int8)
        self.memory = Memory(
            label, key, arrived, np.empty(cells, np.int32), np.full(cells, -1, np.int32), np.zeros(2, np.int64)
        )
        self.label, self.state = label, self.memory.state
        for source in {net.at(cell) for cell in sources}:
            h = gauge(*divmod(source, net.width), *divmod(self.goal, net.width), faces) if faces.size else 0.0
            self.state[0] = open_cell(source, 0.0, h, -1, self.memory, self.state[0])

    @property
    def least(self) -> float:
        """The least priority of all open cells; infinite if there is none."""
        return float(self.memory.key[self.memory.heap[0]]) if self.state[0] else math.inf

    def run(self, within: float = math.inf) -> int:
        """Expand up to `STEPS` cells; return RUNNING, FOUND or EXHAUSTED."""
        return best_first(self.net, self.cost, self.goal, within, self.faces, self.memory, STEPS)

    def path(self) -> NDArray[np.int32]:
        """Return the cells of the path that was found, int32[N, 2]."""
        flat = [self.goal]
        while (move := self.memory.arrived[flat[-1]]) >= 0:
            flat.append(flat[-1] - int(self.net.offsets[move]))
        return (np.column_stack(np.divmod(np.array(flat[::-1]), self.net.width)) - self.net.margin).astype(np.int32)


def plan(problem: Problem, clock: Clock, heuristic: bool, costs: ArrayLike | None) -> Plan:
    """Solve `problem` by Dijkstra, or by A* with the exact distance on an empty map as the heuristic; `costs` are checked."""
    weights, ball = None if costs is None else checked_costs(costs, problem.grid), _NO_FACES
    if heuristic:
        cheapest = 1.0 if weights is None else float(weights[~problem.grid.blocked].min())
        ball = faces(problem.moves) * (cheapest * (1 - 1e-12))  # below rounding, so that it never overestimates
    search = Search(graph(problem.grid, problem.moves), [problem.start], problem.goal, weights, ball)
    code = RUNNING
    while code == RUNNING and not clock.spent():
        code = search.run()
    expanded = int(search.state[1])
    if code == FOUND:
        return found(problem, search.path(), expanded, clock, shortest=costs is None)
    return not_found(code == EXHAUSTED, expanded, clock)


def field(
    grid: Grid, moves: Moves, goals: list[Cell], targets: list[Cell], within: float, costs: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], float]:
    """Return the cost in cells from every cell to the nearest goal, float64[H, W], and the value up to which it is final."""
    net = graph(grid, moves)
    search = Search(net, goals, None, costs, _NO_FACES)
    ends = [net.at(cell) for cell in targets]
    while search.run(within) == RUNNING and not (ends and search.label[ends].max() < search.least):
        pass
    known = min(within, np.nextafter(search.least, 0.0)) if targets else within
    return np.ascontiguousarray(net.inner(search.label)), known
