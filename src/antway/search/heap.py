"""Best-first search over any moves and costs: what the planners use where no faster kernel applies."""

from __future__ import annotations

import math
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.grid import Cell, Grid, Moves
from antway.kernels.bestfirst import EXHAUSTED, FOUND, RUNNING, best_first, gauge, open_cell
from antway.planning import Clock, Plan, Problem, Status
from antway.search.derived import Graph, graph

STEPS = 1 << 16  # expansions between two looks at the clock, about 10 ms
_NO_COST = np.empty(0)
NO_FACES = np.empty((0, 2))


@cache
def faces(moves: Moves) -> NDArray[np.float64]:
    """Return the faces (p, q) of the moves' unit ball in the octant of (a, b), a >= b >= 0; see `kernels.bestfirst.gauge`."""
    corners = sorted({(max(abs(r), abs(c)), min(abs(r), abs(c))) for r, c in moves.offsets.tolist()}, key=lambda v: v[1] / v[0])
    if moves is Moves.FOUR:
        return np.ones((1, 2))
    return np.array([np.linalg.solve([u, v], [math.hypot(*u), math.hypot(*v)]) for u, v in pairwise(corners)])


class Labels(NamedTuple):
    """The state of a search; see `kernels.bestfirst.best_first`."""

    label: NDArray[np.float64]
    key: NDArray[np.float64]
    arrived: NDArray[np.int8]
    heap: NDArray[np.int32]
    place: NDArray[np.int32]
    state: NDArray[np.int64]


def search(
    net: Graph,
    sources: list[Cell],
    goal: int,
    cost: NDArray[np.float64],
    ball: NDArray[np.float64],
    within: float,
    clock: Clock | None,
) -> tuple[int, Labels]:
    """Search from `sources`; return EXHAUSTED, FOUND, or RUNNING where the clock ran out, and all labels."""
    cells = net.legal.size
    labels = Labels(
        np.full(cells, np.inf),
        np.full(cells, np.inf),
        np.full(cells, -1, np.int8),
        np.empty(cells, np.int32),
        np.full(cells, -1, np.int32),
        np.zeros(2, np.int64),
    )
    for source in map(net.at, sources):
        if labels.place[source] < 0:
            h = gauge(*divmod(source, net.width), *divmod(goal, net.width), ball) if ball.size else 0.0
            size = open_cell(source, 0.0, h, -1, *labels[:5], labels.state[0])
            labels.state[0] = size
    code = RUNNING
    while code == RUNNING and not (clock and clock.spent()):
        code = best_first(net.legal, net.offsets, net.lengths, cost, net.width, goal, within, ball, *labels, STEPS)
    return code, labels


def padded(net: Graph, costs: NDArray[np.float64] | None) -> NDArray[np.float64]:
    """Return the costs as a flat array with the graph's margin, or none."""
    return _NO_COST if costs is None else np.pad(costs, net.margin, constant_values=np.inf).ravel()


def heap_plan(problem: Problem, clock: Clock, heuristic: bool, costs: NDArray[np.float64] | None = None) -> Plan:
    """Solve `problem` by Dijkstra, or by A* with the exact distance on an empty map as the heuristic."""
    net = graph(problem.grid, problem.moves)
    cost = padded(net, costs)
    ball = NO_FACES
    if heuristic:
        cheapest = 1.0 if costs is None else float(costs[~problem.grid.blocked].min())
        ball = faces(problem.moves) * (cheapest * (1 - 1e-12))  # below rounding, so that it never overestimates
    goal = net.at(problem.goal)
    code, labels = search(net, [problem.start], goal, cost, ball, math.inf, clock)
    cells = None
    if code == FOUND:
        flat = [goal]
        while (move := labels.arrived[flat[-1]]) >= 0:
            flat.append(flat[-1] - int(net.offsets[move]))
        cells = np.column_stack(np.divmod(np.array(flat[::-1]), net.width)) - net.margin
    return answer(problem, code, cells, int(labels.state[1]), clock, shortest=costs is None)


def answer(
    problem: Problem, code: int, cells: NDArray[np.int64] | None, expanded: int, clock: Clock, *, shortest: bool = True
) -> Plan:
    """Return the plan for what a kernel found; its length is recounted from its moves."""
    if cells is None:
        status = Status.NO_PATH if code == EXHAUSTED else Status.BUDGET
        return Plan(status, expanded=expanded, elapsed=clock.elapsed())
    length = path_length(cells, problem.grid)
    bound = length if shortest else 0.0
    return Plan(Status.FOUND, cells.astype(np.int32), length, shortest, expanded, elapsed=clock.elapsed(), lower_bound=bound)


def path_length(cells: NDArray[np.int64], grid: Grid) -> float:
    """Return the length in m of a path of cells: for each kind of move its number times its length."""
    kinds, counts = np.unique((np.diff(cells, axis=0) ** 2).sum(axis=1), return_counts=True)
    return math.fsum(n * math.sqrt(kind) for kind, n in zip(kinds.tolist(), counts.tolist())) * grid.resolution
