"""Any-angle paths: optimal ones by Polyanya on a mesh of the grid's free rectangles, and others by (Lazy) Theta*."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid, Moves, kept
from antway.kernels.base.jit import call
from antway.kernels.search import polyanya, theta
from antway.kernels.search.polyanya import BOTTOM, BOTTOM_END, EMPTY, EXPANDED, FOUND, NODES, PAUSED, START, TOP, TOP_END
from antway.planning import Budget, Clock, Plan, Problem, Status, start_clock
from antway.search.derived import longer
from antway.search.result import not_found

METHODS = ("polyanya", "theta", "lazy-theta")
STEPS = 1 << 14  # expansions between two looks at the clock
_ANGLES = (Moves.EIGHT, Moves.EIGHT_NOSQUEEZE, Moves.SIXTEEN, Moves.THIRTY_TWO)


def anyangle(problem: Problem, *, seed: int = 0, budget: Budget = Budget(), method: str = "polyanya") -> Plan:
    """Return a shortest path of straight segments in any direction, between the centres of the start and the goal.

    The path is in free cells. It may touch walls and corners of blocked cells, and taut paths do; it neither leaves the map nor
    passes where two blocked cells touch diagonally. For a robot with a radius, plan on `grid.inflate(radius)`, as `antway.plan`
    does for `robot_radius`. Then free cells have that clearance at their centres, and a path that touches their corners has at
    least `radius` minus half a cell's diagonal. To keep the whole radius, inflate by half a diagonal more.

    Parameters
    ----------
    problem : Problem
        Its moves must be EIGHT, EIGHT_NOSQUEEZE, SIXTEEN or THIRTY_TWO, which all give the same result. FOUR asks for fewer
        angles, and EIGHT_CUT passes between blocked cells where this planner does not.
    seed : int
        Without effect.
    budget : Budget
        Time and cancellation.
    method : str
        "polyanya": optimal (Cui, Harabor, Grastien, Compromise-free pathfinding on a navigation mesh, IJCAI 2017) on a
        mesh of the grid's free rectangles, in exact integer geometry. "theta" and "lazy-theta" turn at cell centres only and
        are not optimal (Nash, Daniel, Koenig, Felner, AAAI 2007; Nash, Koenig, Tovey, AAAI 2010).

    Returns
    -------
    Plan
        `points` are the start, the turning points (for polyanya corners of cells, with half-integers), and the goal. `cells`
        are the free cells along the segments from start to goal; they are a path under EIGHT_NOSQUEEZE. `lower_bound` is the
        length if the path is optimal, else the straight distance.

    Raises
    ------
    BadParameter
        For an unknown method, or moves as above.

    Examples
    --------
    >>> blocked = np.zeros((3, 3), dtype=bool); blocked[1, 1] = True
    >>> plan = anyangle(Problem(Grid(blocked), (0, 0), (1, 2)))
    >>> plan.points.tolist(), round(plan.length, 4)
    ([[0.0, 0.0], [0.5, 1.5], [1.0, 2.0]], 2.2882)
    """
    clock = start_clock(problem, seed, budget)
    checks.choice("method", method, METHODS)
    if problem.moves not in _ANGLES:
        raise BadParameter("moves", problem.moves.value, f"one of {', '.join(m.value for m in _ANGLES)} for paths of any angle")
    return _polyanya(problem, clock) if method == "polyanya" else _theta(problem, clock, lazy=method == "lazy-theta")


class Mesh(NamedTuple):
    """The free rectangles of a grid and their portals, see `kernels.search.polyanya`."""

    polygons: NDArray[np.int64]  # [S, 6]
    component: NDArray[np.int64]  # [S] connected component of each polygon
    portals: NDArray[np.int64]  # [P, 5]
    polygon_at: NDArray[np.int32]  # [H, W] polygon of each cell, or -1
    widest: int  # largest number of portals of a polygon
    spare: list[polyanya.Memory]  # unused memories, for the next searches


def _mesh(grid: Grid) -> Mesh:
    polygons, component, portals, polygon_at = polyanya.build_mesh(grid.blocked)
    exits = polygons[:, TOP_END] - polygons[:, TOP] + polygons[:, BOTTOM_END] - polygons[:, BOTTOM]
    return Mesh(polygons, component, portals, polygon_at, int(exits.max()), [])


def _memory(net: Mesh, nodes: int) -> polyanya.Memory:
    corners, ends, counts = 2 * len(net.portals), np.empty(6, np.int64), np.empty(4, np.int64)
    best, parent, node = np.empty(corners), np.empty(corners, np.int64), np.empty((nodes, 7), np.int64)
    return polyanya.Memory(net.polygons, net.portals, ends, best, parent, node, np.empty(nodes), np.empty((nodes, 2)), counts)


def _polyanya(problem: Problem, clock: Clock) -> Plan:
    if clock.spent():
        return not_found(False, 0, clock)
    net = kept(problem.grid, "mesh", lambda: _mesh(problem.grid))
    (sr, sc), (gr, gc) = problem.start, problem.goal
    first, last = net.polygon_at[sr, sc], net.polygon_at[gr, gc]
    if net.component[first] != net.component[last]:
        return not_found(True, 0, clock)
    most = 3 * net.widest
    memory = net.spare.pop() if net.spare else _memory(net, 2048 + most)
    memory.ends[:] = 2 * sc + 1, 2 * sr + 1, first, 2 * gc + 1, 2 * gr + 1, last
    memory.best.fill(np.inf)
    memory.counts[:] = 0, 0, 0, most
    code, corner = (FOUND if first == last else PAUSED), START
    try:
        while code == PAUSED and not clock.spent():
            code, corner = polyanya.search(memory, STEPS)
            if code == PAUSED and memory.counts[NODES] + most > len(memory.node):
                node, cost, heap = longer(memory.node), longer(memory.cost), longer(memory.heap)
                memory = memory._replace(node=node, cost=cost, heap=heap)
        path, expanded = polyanya.unwind(memory, corner) if code == FOUND else None, int(memory.counts[EXPANDED])
    finally:
        net.spare.append(memory)
    return not_found(False, expanded, clock) if path is None else _found(problem, path, expanded, clock, True)


def _theta(problem: Problem, clock: Clock, lazy: bool) -> Plan:
    rows, cols = problem.grid.shape
    (sr, sc), (gr, gc) = problem.start, problem.goal
    size, goal = rows * cols, gr * cols + gc
    length, parent, closed = np.full(size, np.inf), np.empty(size, np.int64), np.zeros(size, np.bool_)
    counts, scratch = np.zeros(2, np.int64), np.empty((2 * (rows + cols), 2), np.int32)
    memory = theta.Memory(length, parent, closed, np.empty((1024, 2)), counts, scratch)
    code = PAUSED
    while code == PAUSED and not clock.spent():
        code = call(theta.theta, problem.grid.blocked, sr * cols + sc, goal, lazy, memory, STEPS)
        if code == PAUSED and counts[0] + 8 > len(memory.heap):
            memory = memory._replace(heap=longer(memory.heap))
    if code == FOUND:
        flat = [goal]
        while parent[flat[-1]] != flat[-1]:
            flat.append(int(parent[flat[-1]]))
        path = 2 * np.column_stack(np.divmod(np.array(flat[::-1]), cols)) + 1
        return _found(problem, path, int(counts[1]), clock, False)
    return not_found(code == EMPTY, int(counts[1]), clock)


def _found(problem: Problem, path: NDArray[np.int64], expanded: int, clock: Clock, optimal: bool) -> Plan:
    """Return the plan along `path`, doubled lattice points, int64[N, 2]."""
    points = (path - 1) / 2
    res = problem.grid.resolution
    length = math.fsum(np.hypot(*np.diff(points, axis=0).T)) * res
    optimal = optimal or len(path) <= 2  # nothing is shorter than a straight line
    bound = length if optimal else min(length, math.dist(problem.start, problem.goal) * res)
    cells = theta.cells_along(problem.grid.blocked, path)
    return Plan(Status.FOUND, cells, length, optimal, expanded, clock.elapsed(), bound, points)
