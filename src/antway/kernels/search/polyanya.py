"""Any-angle search over the free polygons of a grid, with exact integer geometry.

Lengths are doubled: cell (r, c) covers y = 2r..2r+2 and x = 2c..2c+2, its centre is (2r+1, 2c+1), lattice lines are even.

A *polygon* of the mesh is a stack of equal maximal row runs of free cells: a rectangle with walls left and right. Its exits are
the *portals* of its top and bottom side, where it overlaps a polygon above or below. An end of a portal where one of the two
polygons extends further is a corner of an obstacle, where a taut path may turn: corner 2k is the left end of portal k, 2k+1
the right. Blocked cells that touch diagonally leave no portal between them, so no path passes there.

A *node* is an interval of a portal as seen from a root, which is the start or a corner: int64[7] with the portal, the direction
through it (0 up, 1 down), the root, and the points (x, y) of the rays from the root to the interval's left and right end. As a
ray is given by a lattice point, the sign of an integer tells whether a point is left of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.heap import pop, push
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rows import copy_row

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

FOUND, EMPTY, PAUSED = 1, 2, 3  # how a slice of the search ended
START, HIDDEN = -1, -2  # values in place of a corner
X0, X1, NEAR = 0, 1, 2  # columns of a polygon [6]: left, right; from NEAR on the ranges of its top and bottom portals
Y, LEFT, RIGHT, POLYGON = 0, 1, 2, 3  # columns of a portal [5]: y, left, right; the polygons above and below


class Memory(NamedTuple):
    """The map and the memory of a search."""

    mesh: Ints  # [S, 6]; polygons
    ports: Ints  # [P, 5]; portals
    ends: Ints  # [6]; x, y and polygon of start and goal
    best: Floats  # [2P]; length of the shortest path found to each corner
    parent: Ints  # [2P]; the corner before it
    node: Ints  # [M, 7]; nodes
    cost: Floats  # [M]; length to the root of each node
    heap: Floats  # [M, 2]; open nodes, ordered by the least length of a path through them
    counts: Ints  # [4]; number of nodes, open nodes and expansions, and the most successors of a node


@kernel
def build_mesh(blocked: NDArray[np.bool_]) -> tuple[Ints, Ints, Ints, NDArray[np.int32]]:
    """Return the polygons [S, 6], their connected components [S], the portals [P, 5], and each cell's polygon or -1 [H, W]."""
    rows, cols = blocked.shape
    at = np.full((rows, cols), -1, np.int32)
    runs = 0
    for r in range(rows):
        for c in range(cols):
            runs += not blocked[r, c] and (c == 0 or blocked[r, c - 1])
    mesh, part, ports = np.zeros((runs, 6), np.int64), np.arange(runs), np.empty((2 * runs, 5), np.int64)
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
            if above >= 0 and mesh[above, X0] == 2 * left and mesh[above, X1] == 2 * right:
                at[r, left:right] = above
                continue
            at[r, left:right] = s
            mesh[s, X0], mesh[s, X1], mesh[s, NEAR] = 2 * left, 2 * right, k
            c = left if r > 0 else right
            while c < right:
                above = at[r - 1, c]
                if above < 0:
                    c += 1
                    continue
                end = min(mesh[above, X1] // 2, right)
                ports[k, Y], ports[k, LEFT], ports[k, RIGHT], ports[k, POLYGON], ports[k, POLYGON + 1] = (
                    2 * r,
                    2 * c,
                    2 * end,
                    above,
                    s,
                )
                if mesh[above, NEAR + 3] == 0:
                    mesh[above, NEAR + 2] = k
                k += 1
                mesh[above, NEAR + 3] = k
                part[_part(part, above)] = _part(part, s)
                c = end
            mesh[s, NEAR + 1] = k
            s += 1
    for i in range(s):
        part[i] = _part(part, i)
    return mesh[:s].copy(), part[:s].copy(), ports[:k].copy(), at


@kernel
def _part(part: Ints, s: int) -> int:
    """Return the root of `s` in the forest `part`, halving the path to it."""
    while part[s] != s:
        part[s] = part[part[s]]
        s = part[s]
    return s


@bare_kernel
def search(m: Memory, steps: int) -> tuple[int, int]:
    """Run Polyanya (Cui, Harabor, Grastien, IJCAI 2017) for at most `steps` expansions, or until the node arrays are full.

    Returns how the slice ended, and the corner before the goal if FOUND.
    """
    new = 0
    if m.counts[0] == 0:
        for side in range(2):
            for k in range(m.mesh[m.ends[2], NEAR + 2 * side], m.mesh[m.ends[2], NEAR + 2 * side + 1]):
                _add(m, k, side, START, 0.0, m.ports[k, LEFT], m.ports[k, Y], m.ports[k, RIGHT], m.ports[k, Y])
    else:
        new = m.counts[0]
    stop = m.counts[2] + steps
    while True:
        for n in range(new, m.counts[0]):
            beyond = m.ports[m.node[n, 0], POLYGON + m.node[n, 1]]
            exits = m.mesh[beyond, NEAR + 1] - m.mesh[beyond, NEAR] + m.mesh[beyond, NEAR + 3] - m.mesh[beyond, NEAR + 2]
            if exits > 1 or beyond == m.ends[5]:
                m.counts[1] = push(m.heap, m.counts[1], m.cost[n] + _least(m, n), n)
        new = m.counts[0]
        if m.counts[1] == 0:
            return EMPTY, START
        if m.counts[2] >= stop or new + m.counts[3] > len(m.node):
            return PAUSED, START
        n = int(m.heap[0, 1])
        m.counts[1] = pop(m.heap, m.counts[1])
        root = m.node[n, 2]
        if root != START and m.cost[n] > m.best[root]:
            continue
        m.counts[2] += 1
        if m.ports[m.node[n, 0], POLYGON + m.node[n, 1]] != m.ends[5]:
            _expand(m, n)
        else:
            last = _before_goal(m, n)
            if last != HIDDEN:
                return FOUND, last


@bare_kernel
def _expand(m: Memory, n: int) -> None:
    """Add the successors of node `n`: what its root sees of the next portals, and what is around the interval's ends."""
    k, down, root = m.node[n, 0], m.node[n, 1], m.node[n, 2]
    y, polygon, path = m.ports[k, Y], m.ports[k, POLYGON + down], m.cost[n]
    x0, y0 = _place(m, root)
    first, end = m.mesh[polygon, NEAR + 2 * down], m.mesh[polygon, NEAR + 2 * down + 1]
    if y0 == y:  # the root is a corner of this polygon and sees all of it
        for j in range(first, end):
            _add(m, j, down, root, path, m.ports[j, LEFT], m.ports[j, Y], m.ports[j, RIGHT], m.ports[j, Y])
        _add_flat(m, k, down, 1 - (root & 1), root, path)
        return
    ax, ay, bx, by = m.node[n, 3], m.node[n, 4], m.node[n, 5], m.node[n, 6]
    left, left_rise, right, right_rise = ax - x0, abs(ay - y0), bx - x0, abs(by - y0)
    for j in range(first, end):
        y1, x1, x2 = m.ports[j, Y], m.ports[j, LEFT], m.ports[j, RIGHT]
        rise = abs(y1 - y0)
        at_1, at_2 = left * rise - (x1 - x0) * left_rise, right * rise - (x2 - x0) * right_rise
        if left * rise < (x2 - x0) * left_rise and right * rise > (x1 - x0) * right_rise:
            px, py = (ax, ay) if at_1 > 0 else (x1, y1)
            qx, qy = (bx, by) if at_2 < 0 else (x2, y1)
            _add(m, j, down, root, path, px, py, qx, qy)
    for side in range(2):
        x, corner, sign = m.ports[k, LEFT + side], 2 * k + side, 1 - 2 * side
        further = path + _length(x - x0, y - y0)
        if not (_may_turn(m, n, side) and _improve(m, corner, root, further)):
            continue
        for j in range(first, end):
            y1, outer, inner = m.ports[j, Y], m.ports[j, LEFT + side], m.ports[j, RIGHT - side]
            rise, span = abs(y1 - y0), abs(y - y0)
            if sign * ((outer - x0) * span - (x - x0) * rise) < 0:
                px, py = (inner, y1) if sign * ((inner - x0) * span - (x - x0) * rise) <= 0 else (2 * x - x0, 2 * y - y0)
                if side == 0:
                    _add(m, j, down, corner, further, outer, y1, px, py)
                else:
                    _add(m, j, down, corner, further, px, py, outer, y1)
        _add_flat(m, k, down, side, corner, further)


@bare_kernel
def _add_flat(m: Memory, k: int, down: int, side: int, root: int, path: float) -> None:
    """Add the portals left (0) or right (1) of `k` on the same side of the polygon, which are reached along the wall."""
    polygon = m.ports[k, POLYGON + down]
    first, end = m.mesh[polygon, NEAR + 2 - 2 * down], m.mesh[polygon, NEAR + 3 - 2 * down]
    if side == 0:
        end = k
    else:
        first = k + 1
    for j in range(first, end):
        corner = 2 * j + 1 - side
        further = path + abs(m.ports[root >> 1, LEFT + (root & 1)] - m.ports[j, RIGHT - side])
        if _improve(m, corner, root, further):
            _add(m, j, 1 - down, corner, further, m.ports[j, LEFT], m.ports[j, Y], m.ports[j, RIGHT], m.ports[j, Y])


@bare_kernel
def _before_goal(m: Memory, n: int) -> int:
    """Return the last corner on the path through node `n` to the goal in the next polygon; HIDDEN if it is not taut."""
    k, root = m.node[n, 0], m.node[n, 2]
    x0, y0 = _place(m, root)
    if y0 == m.ports[k, Y]:
        return int(root)
    for side in range(2):
        x, rise = m.node[n, 3 + 2 * side] - x0, abs(m.node[n, 4 + 2 * side] - y0)
        if (1 - 2 * side) * ((m.ends[3] - x0) * rise - x * abs(m.ends[4] - y0)) < 0:
            if not _may_turn(m, n, side):
                return HIDDEN
            _improve(m, 2 * k + side, root, m.cost[n] + _length(x, rise))
            return int(2 * k + side)
    return int(root)


@bare_kernel
def _may_turn(m: Memory, n: int, side: int) -> bool:
    """Tell whether the left (0) or right (1) end of the interval of node `n` is an end of its portal and a corner."""
    k = m.node[n, 0]
    if m.node[n, 3 + 2 * side] != m.ports[k, LEFT + side] or m.node[n, 4 + 2 * side] != m.ports[k, Y]:
        return False
    return bool(m.mesh[m.ports[k, POLYGON], X0 + side] != m.mesh[m.ports[k, POLYGON + 1], X0 + side])


@bare_kernel
def _place(m: Memory, corner: int) -> tuple[int, int]:
    """Return (x, y) of a corner, or of the start."""
    if corner == START:
        return int(m.ends[0]), int(m.ends[1])
    return int(m.ports[corner >> 1, LEFT + (corner & 1)]), int(m.ports[corner >> 1, Y])


@bare_kernel
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


@bare_kernel
def _add(m: Memory, k: int, down: int, root: int, path: float, ax: int, ay: int, bx: int, by: int) -> None:
    """Add the node of portal `k` between the rays from `root` through (ax, ay) and (bx, by)."""
    n = m.counts[0]
    m.counts[0] = n + 1
    m.node[n, 0], m.node[n, 1], m.node[n, 2], m.cost[n] = k, down, root, path
    m.node[n, 3], m.node[n, 4], m.node[n, 5], m.node[n, 6] = ax, ay, bx, by


@bare_kernel
def _least(m: Memory, n: int) -> float:
    """Return the least length from the root of `n` through its interval to the goal, mirrored if it is on the near side."""
    y, x1, y1 = m.ports[m.node[n, 0], Y], m.ends[3], m.ends[4]
    x0, y0 = _place(m, m.node[n, 2])
    if y0 == y:
        return _length(x1 - x0, y1 - y0)
    if (y1 > y) != (m.node[n, 1] == 1):
        y1 = 2 * y - y1
    rise = abs(y - y0)
    left = (m.node[n, 3] - x0) * rise / abs(m.node[n, 4] - y0)
    right = (m.node[n, 5] - x0) * rise / abs(m.node[n, 6] - y0)
    x = min(max((x1 - x0) * rise / abs(y1 - y0), left), right)
    return _length(x, rise) + _length(x1 - x0 - x, y1 - y)


@bare_kernel
def _length(x: float, y: float) -> float:
    """Return the length of (x, y), whose squares cannot overflow."""
    return math.sqrt(x * x + y * y)


@kernel
def unwind(m: Memory, corner: int) -> Ints:
    """Return the turning points (row, col) of the path through `corner`, doubled, int64[N, 2], from start to goal.

    Corners in the middle of a straight line are left out.
    """
    count, c = 2, corner
    while c != START:
        c = m.parent[c]
        count += 1
    path = np.empty((count, 2), np.int64)
    path[count - 1, 1], path[count - 1, 0] = m.ends[3], m.ends[4]
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
