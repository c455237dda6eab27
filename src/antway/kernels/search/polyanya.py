"""Any-angle search over the free polygons of a grid, with exact integer geometry.

Lengths are doubled: cell (r, c) covers y = 2r..2r+2 and x = 2c..2c+2, its centre is (2r+1, 2c+1), lattice lines are even.

A *polygon* of the mesh is a stack of equal maximal row runs of free cells: a rectangle with walls left and right. Its exits are
the *portals* of its top and bottom side, where it overlaps a polygon above or below. An end of a portal where one of the two
polygons extends further is a corner of an obstacle, where a taut path may turn: corner 2k is the left end of portal k, 2k+1
the right. Blocked cells that touch diagonally leave no portal between them, so no path passes there.

A *node* is an interval of a portal as seen from a root: the start or a corner. It is bounded by two rays from the root,
each given by a lattice point on it, so that the sign of an integer tells whether a point is left of a ray.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.rows import copy_row

FOUND, EMPTY, PAUSED = 1, 2, 3  # how a slice of the search ended
START, HIDDEN = -1, -2  # values in place of a corner
# Columns of polygons: left and right; the first portal of the top side and the one after its last, the same for the bottom.
X0, X1, TOP, TOP_END, BOTTOM, BOTTOM_END = range(6)
# Columns of portals: y, left and right; the polygons above and below.
Y, LEFT, RIGHT, ABOVE, BELOW = range(5)
# Columns of nodes: portal; 1 if the path goes down through it, else 0; root; points on the rays through the interval's ends.
PORTAL, DOWN, ROOT, LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y = range(7)
START_X, START_Y, START_POLYGON, GOAL_X, GOAL_Y, GOAL_POLYGON = range(6)  # indices of `ends`
NODES, OPEN, EXPANDED, MOST = range(4)  # indices of `counts`: nodes, open nodes, expansions, most successors of a node


class Memory(NamedTuple):
    """The map and the memory of a search."""

    polygons: Ints  # [S, 6]
    portals: Ints  # [P, 5]
    ends: Ints  # [6]
    best: Floats  # [2P]; length of the shortest path found to each corner
    parent: Ints  # [2P]; the corner before it
    node: Ints  # [M, 7]
    cost: Floats  # [M]; length to the root of each node
    heap: Floats  # [M, 2]; open nodes, ordered by the least length of a path through them
    counts: Ints  # [4]


@kernel
def build_mesh(blocked: NDArray[np.bool_]) -> tuple[Ints, Ints, Ints, NDArray[np.int32]]:
    """Return the polygons [S, 6], their connected components [S], the portals [P, 5], and each cell's polygon or -1 [H, W]."""
    rows, cols = blocked.shape
    at = np.full((rows, cols), -1, np.int32)
    runs = 0
    for r in range(rows):
        for c in range(cols):
            runs += not blocked[r, c] and (c == 0 or blocked[r, c - 1])
    polygons, component, portals = np.zeros((runs, 6), np.int64), np.arange(runs), np.empty((2 * runs, 5), np.int64)
    s = k = 0
    for r in range(rows):
        right = -1
        while right < cols:
            left = right + 1
            while left < cols and blocked[r, left]:
                left += 1
            right = left
            while right < cols and not blocked[r, right]:
                right += 1
            if left == cols:
                break
            above = at[r - 1, left] if r > 0 else -1
            if above >= 0 and polygons[above, X0] == 2 * left and polygons[above, X1] == 2 * right:
                at[r, left:right] = above
                continue
            at[r, left:right] = s
            polygons[s, X0], polygons[s, X1], polygons[s, TOP] = 2 * left, 2 * right, k
            if r > 0:
                k = _add_portals(polygons, component, portals, at, s, r, k)
            polygons[s, TOP_END] = k
            s += 1
    for i in range(s):
        component[i] = _component(component, i)
    return polygons[:s].copy(), component[:s].copy(), portals[:k].copy(), at


@inner_kernel
def _add_portals(polygons: Ints, component: Ints, portals: Ints, at: NDArray[np.int32], s: int, r: int, k: int) -> int:
    """Add the portals between polygon `s`, which begins in row `r`, and the polygons above it; return the new number `k`."""
    c, right = polygons[s, X0] // 2, polygons[s, X1] // 2
    while c < right:
        above = at[r - 1, c]
        if above < 0:
            c += 1
            continue
        end = min(polygons[above, X1] // 2, right)
        portals[k, Y], portals[k, LEFT], portals[k, RIGHT] = 2 * r, 2 * c, 2 * end
        portals[k, ABOVE], portals[k, BELOW] = above, s
        if polygons[above, BOTTOM_END] == 0:
            polygons[above, BOTTOM] = k
        k += 1
        polygons[above, BOTTOM_END] = k
        component[_component(component, above)] = _component(component, s)
        c = end
    return k


@bare_kernel
def _component(component: Ints, s: int) -> int:
    """Return the representative of the set of `s` in the disjoint sets `component`, halving the path to it."""
    while component[s] != s:
        component[s] = component[component[s]]
        s = component[s]
    return s


@bare_kernel
def _is_dead_end(m: Memory, polygon: int) -> bool:
    """Tell whether a polygon without the goal has no portal but the one by which it is entered."""
    top = m.polygons[polygon, TOP_END] - m.polygons[polygon, TOP]
    bottom = m.polygons[polygon, BOTTOM_END] - m.polygons[polygon, BOTTOM]
    return bool(top + bottom <= 1 and polygon != m.ends[GOAL_POLYGON])


@bare_kernel
def search(m: Memory, steps: int) -> tuple[int, int]:
    """Run Polyanya (Cui, Harabor, Grastien, IJCAI 2017) for at most `steps` expansions, or until the node arrays are full.

    Returns how the slice ended, and the corner before the goal if FOUND.
    """
    new = m.counts[NODES]
    if new == 0:
        for side in range(2):
            for k in range(*_portals_of(m, m.ends[START_POLYGON], side)):
                _add_whole(m, k, side, START, 0.0)
    stop = m.counts[EXPANDED] + steps
    while True:
        for n in range(new, m.counts[NODES]):
            if not _is_dead_end(m, _polygon_beyond(m, n)):
                m.counts[OPEN] = push(m.heap, m.counts[OPEN], m.cost[n] + _least(m, n), n)
        new = m.counts[NODES]
        if m.counts[OPEN] == 0:
            return EMPTY, START
        if m.counts[EXPANDED] >= stop or new + m.counts[MOST] > len(m.node):
            return PAUSED, START
        n = int(m.heap[0, 1])
        m.counts[OPEN] = pop(m.heap, m.counts[OPEN])
        root = m.node[n, ROOT]
        if root != START and m.cost[n] > m.best[root]:
            continue
        m.counts[EXPANDED] += 1
        if _polygon_beyond(m, n) != m.ends[GOAL_POLYGON]:
            _expand(m, n)
        else:
            last = _before_goal(m, n)
            if last != HIDDEN:
                return FOUND, last


@bare_kernel
def _expand(m: Memory, n: int) -> None:
    """Add the successors of node `n`: what its root sees of the next portals, and what is around the interval's ends."""
    k, down, root, path = m.node[n, PORTAL], m.node[n, DOWN], m.node[n, ROOT], m.cost[n]
    if _place(m, root)[1] == m.portals[k, Y]:  # the root is a corner of this polygon and sees all of it
        for j in range(*_portals_of(m, _polygon_beyond(m, n), down)):
            _add_whole(m, j, down, root, path)
        _add_flat(m, k, down, 1 - (root & 1), root, path)
    else:
        _add_observable(m, n)
        for side in range(2):
            _add_non_observable(m, n, side)


@inner_kernel
def _add_observable(m: Memory, n: int) -> None:
    """Add what the root of node `n` sees of the next portals, between its rays (the paper's observable successors)."""
    down, root = m.node[n, DOWN], m.node[n, ROOT]
    x0, y0 = _place(m, root)
    ax, ay, bx, by = m.node[n, LEFT_X], m.node[n, LEFT_Y], m.node[n, RIGHT_X], m.node[n, RIGHT_Y]
    left, left_rise, right, right_rise = ax - x0, abs(ay - y0), bx - x0, abs(by - y0)
    for j in range(*_portals_of(m, _polygon_beyond(m, n), down)):
        y1, x1, x2 = m.portals[j, Y], m.portals[j, LEFT], m.portals[j, RIGHT]
        rise = abs(y1 - y0)
        at_1, at_2 = left * rise - (x1 - x0) * left_rise, right * rise - (x2 - x0) * right_rise
        if left * rise < (x2 - x0) * left_rise and right * rise > (x1 - x0) * right_rise:
            px, py = (ax, ay) if at_1 > 0 else (x1, y1)
            qx, qy = (bx, by) if at_2 < 0 else (x2, y1)
            _add(m, j, down, root, m.cost[n], px, py, qx, qy)


@inner_kernel
def _add_non_observable(m: Memory, n: int, side: int) -> None:
    """Add what lies around the left (0) or right (1) end of the interval of node `n` (the paper's non-observable successors).

    That end becomes the root, if a taut path may turn there and no shorter path to it is known.
    """
    k, down, root = m.node[n, PORTAL], m.node[n, DOWN], m.node[n, ROOT]
    x0, y0 = _place(m, root)
    x, y, corner, sign = m.portals[k, LEFT + side], m.portals[k, Y], 2 * k + side, 1 - 2 * side
    path = m.cost[n] + _length(x - x0, y - y0)
    if not (_may_turn(m, n, side) and _improve(m, corner, root, path)):
        return
    for j in range(*_portals_of(m, _polygon_beyond(m, n), down)):
        y1, outer, inner = m.portals[j, Y], m.portals[j, LEFT + side], m.portals[j, RIGHT - side]
        rise, span = abs(y1 - y0), abs(y - y0)
        if sign * ((outer - x0) * span - (x - x0) * rise) < 0:
            px, py = (inner, y1) if sign * ((inner - x0) * span - (x - x0) * rise) <= 0 else (2 * x - x0, 2 * y - y0)
            if side == 0:
                _add(m, j, down, corner, path, outer, y1, px, py)
            else:
                _add(m, j, down, corner, path, px, py, outer, y1)
    _add_flat(m, k, down, side, corner, path)


@bare_kernel
def _add_flat(m: Memory, k: int, down: int, side: int, root: int, path: float) -> None:
    """Add the portals left (0) or right (1) of `k` on the same side of the polygon, which are reached along the wall."""
    first, end = _portals_of(m, m.portals[k, ABOVE + down], 1 - down)
    if side == 0:
        end = k
    else:
        first = k + 1
    for j in range(first, end):
        corner = 2 * j + 1 - side
        further = path + abs(m.portals[root >> 1, LEFT + (root & 1)] - m.portals[j, RIGHT - side])
        if _improve(m, corner, root, further):
            _add_whole(m, j, 1 - down, corner, further)


@bare_kernel
def _before_goal(m: Memory, n: int) -> int:
    """Return the last corner on the path through node `n` to the goal in the next polygon; HIDDEN if it is not taut."""
    k, root = m.node[n, PORTAL], m.node[n, ROOT]
    x0, y0 = _place(m, root)
    if y0 == m.portals[k, Y]:
        return int(root)
    for side in range(2):
        x, rise = m.node[n, LEFT_X + 2 * side] - x0, abs(m.node[n, LEFT_Y + 2 * side] - y0)
        if (1 - 2 * side) * ((m.ends[GOAL_X] - x0) * rise - x * abs(m.ends[GOAL_Y] - y0)) < 0:
            if not _may_turn(m, n, side):
                return HIDDEN
            _improve(m, 2 * k + side, root, m.cost[n] + _length(x, rise))
            return int(2 * k + side)
    return int(root)


@inner_kernel
def _may_turn(m: Memory, n: int, side: int) -> bool:
    """Tell whether the left (0) or right (1) end of the interval of node `n` is an end of its portal and a corner."""
    k = m.node[n, PORTAL]
    if m.node[n, LEFT_X + 2 * side] != m.portals[k, LEFT + side] or m.node[n, LEFT_Y + 2 * side] != m.portals[k, Y]:
        return False
    return bool(m.polygons[m.portals[k, ABOVE], X0 + side] != m.polygons[m.portals[k, BELOW], X0 + side])


@inner_kernel
def _place(m: Memory, corner: int) -> tuple[int, int]:
    """Return (x, y) of a corner, or of the start."""
    if corner == START:
        return int(m.ends[START_X]), int(m.ends[START_Y])
    return int(m.portals[corner >> 1, LEFT + (corner & 1)]), int(m.portals[corner >> 1, Y])


@inner_kernel
def _improve(m: Memory, corner: int, root: int, path: float) -> bool:
    """Record a path to `corner` if it is shorter than all before.

    Of two equal paths the first is enough: if a shortest path continues from the corner, either both are taut or one of them
    is not shortest.
    """
    if path >= m.best[corner]:
        return False
    m.best[corner] = path
    m.parent[corner] = root
    return True


@inner_kernel
def _portals_of(m: Memory, polygon: int, side: int) -> tuple[int, int]:
    """Return the first portal of the top (0) or bottom (1) side of a polygon, and the one after the last."""
    return int(m.polygons[polygon, TOP + 2 * side]), int(m.polygons[polygon, TOP_END + 2 * side])


@inner_kernel
def _polygon_beyond(m: Memory, n: int) -> int:
    """Return the polygon that the paths of node `n` enter through its portal."""
    return int(m.portals[m.node[n, PORTAL], ABOVE + m.node[n, DOWN]])


@inner_kernel
def _add_whole(m: Memory, k: int, down: int, root: int, path: float) -> None:
    """Add the node of portal `k` that `root` sees all of."""
    _add(m, k, down, root, path, m.portals[k, LEFT], m.portals[k, Y], m.portals[k, RIGHT], m.portals[k, Y])


@inner_kernel
def _add(m: Memory, k: int, down: int, root: int, path: float, ax: int, ay: int, bx: int, by: int) -> None:
    """Add the node of portal `k` between the rays from `root` through (ax, ay) and (bx, by)."""
    n = m.counts[NODES]
    m.counts[NODES] = n + 1
    m.node[n, PORTAL], m.node[n, DOWN], m.node[n, ROOT], m.cost[n] = k, down, root, path
    m.node[n, LEFT_X], m.node[n, LEFT_Y], m.node[n, RIGHT_X], m.node[n, RIGHT_Y] = ax, ay, bx, by


@bare_kernel
def _least(m: Memory, n: int) -> float:
    """Return the least length from the root of `n` through its interval to the goal, mirrored if it is on the near side."""
    y, x1, y1 = m.portals[m.node[n, PORTAL], Y], m.ends[GOAL_X], m.ends[GOAL_Y]
    x0, y0 = _place(m, m.node[n, ROOT])
    if y0 == y:
        return _length(x1 - x0, y1 - y0)
    if (y1 > y) != (m.node[n, DOWN] == 1):
        y1 = 2 * y - y1
    rise = abs(y - y0)
    left = (m.node[n, LEFT_X] - x0) * rise / abs(m.node[n, LEFT_Y] - y0)
    right = (m.node[n, RIGHT_X] - x0) * rise / abs(m.node[n, RIGHT_Y] - y0)
    x = min(max((x1 - x0) * rise / abs(y1 - y0), left), right)
    return _length(x, rise) + _length(x1 - x0 - x, y1 - y)


@bare_kernel
def _length(x: float, y: float) -> float:
    """Return the length of (x, y), whose squares cannot overflow."""
    return math.sqrt(x * x + y * y)


@kernel
def unwind(m: Memory, corner: int) -> Ints:
    """Return the turning points of the path through `corner`, doubled (row, col), int64[N, 2], not those on straight lines."""
    count, c = 2, corner
    while c != START:
        c = m.parent[c]
        count += 1
    path = np.empty((count, 2), np.int64)
    path[count - 1, 1], path[count - 1, 0] = m.ends[GOAL_X], m.ends[GOAL_Y]
    for i in range(count - 2, -1, -1):
        path[i, 1], path[i, 0] = _place(m, corner)
        corner = m.parent[corner] if i > 0 else START
    n = 1
    for i in range(1, count):
        (r0, c0), (r1, c1), (r2, c2) = path[n - 1], path[i], path[min(i + 1, count - 1)]
        on_the_path = (r1 - r0) * (c2 - c1) == (c1 - c0) * (r2 - r1)
        if (on_the_path and i + 1 < count) or (r0 == r1 and c0 == c1):
            continue
        copy_row(path[i], path[n])
        n += 1
    return path[:n].copy()
