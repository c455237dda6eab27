"""Exact swept tests in closed form: disc against disc, disc against blocked squares, disc against a timeline.

Two bodies are in contact if they are nearer than the sum of their radii by more than `TOUCH`; touching is legal. All lengths
of a call have the same unit. Tests against cells use (row, col) points, integers at cell centres, and lengths in cells.

A *timeline* is the piecewise linear motion of a disc, one of several in a record `Trajectories`. Disc k is at `knot_xy[i]` at
the time `knot_t[i]` s (strictly increasing) for i in `first[k]:first[k + 1]`, moves straight at constant speed in between, and
stands before its first knot and after its last.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import bare_kernel, inner_kernel, kernel
from antway.kernels.base.records import BLOCK, Terrain, Trajectories, Walls

TOUCH = 1e-9  # in the unit of the call; a contact is a distance smaller than the contact radius by more than this


@kernel
def swept_discs(px: float, py: float, vx: float, vy: float, contact_radius: float, dt: float) -> tuple[float, float, float]:
    """Return the first contact and the closest approach over [0, dt] of two discs in uniform linear motion.

    The second disc starts at p = (px, py) with the velocity v = (vx, vy), both seen from the first; `contact_radius` is the sum
    of the radii. Returns the time of the first contact in s, infinite if there is none: the smaller root of |p + v t|^2 =
    contact_radius^2; the least distance of the centres; and its time in s: -p.v / v.v held within [0, dt].
    """
    vv = vx * vx + vy * vy
    pv = px * vx + py * vy
    when = min(max(-pv / vv, 0.0), dt) if vv > 0.0 else 0.0
    distance = math.hypot(px + vx * when, py + vy * when)
    if distance >= contact_radius - TOUCH:
        return math.inf, distance, when
    now = math.hypot(px, py)
    if now < contact_radius - TOUCH:
        return 0.0, distance, when
    cross = px * vy - py * vx
    # Here |p| >= contact_radius - TOUCH and p.v < 0: this form of the smaller root loses no digits.
    first = (
        (now - contact_radius)
        * (now + contact_radius)
        / (-pv + math.sqrt(max(vv * contact_radius * contact_radius - cross * cross, 0.0)))
    )
    return min(max(first, 0.0), when), distance, when


@bare_kernel
def swept_timeline(
    ax: float, ay: float, bx: float, by: float, t0: float, t1: float, contact_radius: float, trajectories: Trajectories, k: int
) -> tuple[float, float, float]:
    """Return first contact and closest approach of timeline k and a disc that goes from (ax, ay) at t0 to (bx, by) at t1.

    The step is straight at constant speed; with t0 == t1 the disc stands at (ax, ay). `contact_radius` is the sum of the radii.
    The results are those of `swept_discs`, with absolute times.
    """
    span = t1 - t0
    ux, uy = ((bx - ax) / span, (by - ay) / span) if span > 0.0 else (0.0, 0.0)
    first, distance, when = math.inf, math.inf, t0
    i = knot_after(trajectories, k, t0)
    t = t0
    while True:
        end = min(t1, trajectories.knot_t[i]) if i < trajectories.first[k + 1] else t1
        ox, oy, vx, vy = _place(trajectories, k, i, t)
        step = swept_discs(ox - ax - ux * (t - t0), oy - ay - uy * (t - t0), vx - ux, vy - uy, contact_radius, end - t)
        if step[1] < distance:
            distance, when = step[1], min(t + step[2], end)
        if step[0] < math.inf and first == math.inf:
            first = min(t + step[0], end)
        if end >= t1:
            return first, distance, when
        t = end
        i += 1


@bare_kernel
def knot_after(trajectories: Trajectories, k: int, t: float) -> int:
    """Return the number of the first knot of timeline k after the time t; the number after its last if there is none."""
    low, high = trajectories.first[k], trajectories.first[k + 1]
    return int(low + np.searchsorted(trajectories.knot_t[low:high], t, side="right"))


@bare_kernel
def _place(trajectories: Trajectories, k: int, i: int, t: float) -> tuple[float, float, float, float]:
    """Return place and velocity at time t on the part of timeline k that ends at knot i."""
    knot_t, knot_xy, low, high = trajectories.knot_t, trajectories.knot_xy, trajectories.first[k], trajectories.first[k + 1]
    if i in (low, high):
        j = min(i, high - 1)
        return knot_xy[j, 0], knot_xy[j, 1], 0.0, 0.0
    span = knot_t[i] - knot_t[i - 1]
    vx = (knot_xy[i, 0] - knot_xy[i - 1, 0]) / span
    vy = (knot_xy[i, 1] - knot_xy[i - 1, 1]) / span
    s = t - knot_t[i - 1]
    return knot_xy[i - 1, 0] + vx * s, knot_xy[i - 1, 1] + vy * s, vx, vy


@bare_kernel
def timeline_at(t: float, trajectories: Trajectories, k: int) -> tuple[float, float, float, float]:
    """Return (x, y, vx, vy) at time t on timeline k; at a knot, of the part that begins there."""
    return _place(trajectories, k, knot_after(trajectories, k, t), t)


@kernel
def segment_square_distance(ar: float, ac: float, br: float, bc: float, row: float, col: float, half: float) -> float:
    """Return the distance of the segment (ar, ac)-(br, bc) from the closed square of half edge `half` around (row, col).

    It is 0 where they meet. Otherwise it is the distance at an end of the segment or at a corner of the square.
    """
    if _enters(ar, ac, br, bc, row, col, half):
        return 0.0
    least = min(_point_square(ar - row, ac - col, half), _point_square(br - row, bc - col, half))
    dr, dc = br - ar, bc - ac
    dd = dr * dr + dc * dc
    for k in range(4):
        pr = row + (half if k & 1 else -half) - ar
        pc = col + (half if k & 2 else -half) - ac
        s = min(max((pr * dr + pc * dc) / dd, 0.0), 1.0) if dd > 0.0 else 0.0
        least = min(least, math.hypot(pr - s * dr, pc - s * dc))
    return least


@kernel
def _point_square(r: float, c: float, half: float) -> float:
    """Return the distance of the point (r, c) from the closed square of half edge `half` around (0, 0)."""
    return math.hypot(max(abs(r) - half, 0.0), max(abs(c) - half, 0.0))


@kernel
def _enters(ar: float, ac: float, br: float, bc: float, row: float, col: float, half: float) -> bool:
    """Tell whether the segment meets the closed square (method of slabs)."""
    enter, leave = 0.0, 1.0
    for p, d in ((ar - row, br - ar), (ac - col, bc - ac)):
        if d == 0.0:
            if abs(p) > half:
                return False
        else:
            s, t = (-half - p) / d, (half - p) / d
            enter, leave = max(enter, min(s, t)), min(leave, max(s, t))
    return enter <= leave


@kernel
def segment_hits_square(ar: float, ac: float, br: float, bc: float, row: float, col: float, radius: float) -> bool:
    """Tell whether a disc whose centre moves from (ar, ac) to (br, bc) comes into contact with the cell (row, col).

    A disc of radius 0 is a point, which may move along edges and through corners but not through the interior.
    """
    if radius <= 2 * TOUCH:
        return _enters(ar, ac, br, bc, row, col, 0.5 - TOUCH)
    return segment_square_distance(ar, ac, br, bc, row, col, 0.5) < radius - TOUCH


@kernel
def segment_hits_cells(
    blocked: NDArray[np.bool_], ar: float, ac: float, br: float, bc: float, radius: float, walled: bool
) -> bool:
    """Tell whether a disc whose centre moves from (ar, ac) to (br, bc) comes into contact with a blocked cell.

    The points are real-valued (row, col), integers at cell centres, and the radius is in cells. If `walled`, everything off the
    map counts as blocked.
    """
    rows, cols = blocked.shape
    least, most = radius - TOUCH - 0.5, 0.5 - radius + TOUCH
    if walled and (
        min(ar, br) < least or max(ar, br) > rows - 1 + most or min(ac, bc) < least or max(ac, bc) > cols - 1 + most
    ):
        return True
    margin = radius + 0.5
    dr, dc = br - ar, bc - ac
    for row in range(max(math.ceil(min(ar, br) - margin), 0), min(math.floor(max(ar, br) + margin), rows - 1) + 1):
        # Only the part of the segment that is within `margin` of this row can come near its cells.
        s, t = 0.0, 1.0
        if dr != 0.0:
            p, q = (row - margin - ar) / dr, (row + margin - ar) / dr
            s, t = min(max(min(p, q), 0.0), 1.0), min(max(max(p, q), 0.0), 1.0)
        c0, c1 = ac + s * dc, ac + t * dc
        for col in range(max(math.ceil(min(c0, c1) - margin), 0), min(math.floor(max(c0, c1) + margin), cols - 1) + 1):
            if blocked[row, col] and segment_hits_square(ar, ac, br, bc, row, col, radius):
                return True
    return False


@inner_kernel
def hits_walls(terrain: Terrain, ax: float, ay: float, bx: float, by: float, radius: float, walled: bool) -> bool:
    """Do as `segment_hits_cells` for places and a radius in m."""
    size = terrain.resolution
    ar, ac = (ay - terrain.y0) / size - 0.5, (ax - terrain.x0) / size - 0.5
    br, bc = (by - terrain.y0) / size - 0.5, (bx - terrain.x0) / size - 0.5
    return segment_hits_cells(terrain.blocked, ar, ac, br, bc, radius / size, walled)


@kernel
def leads_clear(terrain: Terrain, ax: float, ay: float, bx: float, by: float, radius: float) -> bool:
    """Tell whether a disc of `radius` m can move straight from (ax, ay) to (bx, by) without contact with a wall.

    Where it is in a wall at (ax, ay), because its place or the map is wrong, the motion must lead out of that wall.
    """
    if not hits_walls(terrain, ax, ay, bx, by, radius, True):
        return True
    in_wall = hits_walls(terrain, ax, ay, ax, ay, radius, True)
    return in_wall and wall_ahead(terrain, ax, ay, bx - ax, by - ay, radius)[0] > 1.0


@kernel
def wrap(angle: float) -> float:
    """Return `angle` in rad as the same direction within [-pi, pi]."""
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))


@inner_kernel
def wrap_below_pi(angle: float) -> float:
    """Return `angle` in rad as the same direction within [-pi, pi)."""
    return angle - 2.0 * math.pi * math.floor(angle / (2.0 * math.pi) + 0.5)


@kernel
def first_wall(
    blocked: NDArray[np.bool_],
    row: float,
    col: float,
    dr: float,
    dc: float,
    radius: float,
    blocks: NDArray[np.bool_] | None = None,
) -> tuple[float, float, float]:
    """Return the first contact of a disc that moves from (row, col) by (dr, dc) with a blocked cell or an edge of the map.

    All lengths are in cells, integers at cell centres. The segment is scanned a few cells at a time; with the `blocks` of a
    `Terrain`, those that are free are not. Returns the share of the segment, in [0, 1], at which the contact happens, infinite
    if there is none, and the unit normal (n_row, n_col) there, from the wall to the disc. A wall that the disc touches but does
    not move towards does not count.
    """
    rows, cols = blocked.shape
    r = max(radius - TOUCH, 0.0)
    margin = r + 0.5
    best, n_row, n_col = _first_edge(rows, cols, row, col, dr, dc, r)
    first, last, parts = _parts_on_map(rows, cols, row, col, dr, dc, margin)
    for part in range(first, last):
        if best <= part / parts:
            break
        r0, c0 = row + dr * (part / parts), col + dc * (part / parts)
        r1, c1 = row + dr * ((part + 1) / parts), col + dc * ((part + 1) / parts)
        low_i, high_i = max(math.ceil(min(r0, r1) - margin), 0), min(math.floor(max(r0, r1) + margin), rows - 1)
        low_j, high_j = max(math.ceil(min(c0, c1) - margin), 0), min(math.floor(max(c0, c1) + margin), cols - 1)
        if blocks is not None and not _any_blocked(blocks, low_i, high_i, low_j, high_j):
            continue
        for i in range(low_i, high_i + 1):
            for j in range(low_j, high_j + 1):
                if blocked[i, j]:
                    share, n0, n1 = _first_square(row - i, col - j, dr, dc, r)
                    if share < best:
                        best, n_row, n_col = share, n0, n1
    return best, n_row, n_col


@bare_kernel
def _any_blocked(blocks: NDArray[np.bool_], low_i: int, high_i: int, low_j: int, high_j: int) -> bool:
    """Tell whether any block that reaches into these rows and columns, first and last, has a blocked cell."""
    for i in range(low_i // BLOCK, high_i // BLOCK + 1):
        for j in range(low_j // BLOCK, high_j // BLOCK + 1):
            if blocks[i, j]:
                return True
    return False


@kernel
def wall_ahead(terrain: Terrain, x: float, y: float, dx: float, dy: float, radius: float) -> tuple[float, float, float]:
    """Return what `first_wall` does for a motion by (dx, dy), for places and a radius in m: the share, and (n_x, n_y)."""
    size = terrain.resolution
    row, col = (y - terrain.y0) / size - 0.5, (x - terrain.x0) / size - 0.5
    share, n_row, n_col = first_wall(terrain.blocked, row, col, dy / size, dx / size, radius / size, terrain.blocks)
    return share, n_col, n_row


@bare_kernel
def reflected(vx: float, vy: float, n_x: float, n_y: float) -> tuple[float, float]:
    """Return a velocity after its reflection at a wall with the unit normal (n_x, n_y)."""
    into_wall = vx * n_x + vy * n_y
    return vx - 2.0 * into_wall * n_x, vy - 2.0 * into_wall * n_y


@kernel
def _first_edge(rows: int, cols: int, row: float, col: float, dr: float, dc: float, r: float) -> tuple[float, float, float]:
    """Return the first contact of a disc of radius r with an edge of the map, as `first_wall`."""
    best, n_row, n_col = math.inf, 0.0, 0.0
    for axis in range(2):
        p, d, most = (row, dr, rows - 0.5 - r) if axis == 0 else (col, dc, cols - 0.5 - r)
        for side in (1.0, -1.0):
            limit = most if side > 0.0 else r - 0.5
            if side * d > 0.0 and side * (p + d - limit) > 0.0:
                share = max((limit - p) / d, 0.0)
                if share < best:
                    best = share
                    n_row, n_col = (-side, 0.0) if axis == 0 else (0.0, -side)
    return best, n_row, n_col


@kernel
def _parts_on_map(rows: int, cols: int, row: float, col: float, dr: float, dc: float, margin: float) -> tuple[int, int, int]:
    """Divide a segment into parts of at most 4 cells; return which of them (first, last + 1) may come near the map, and all.

    A part is near where it is within `margin` of the centre of a cell, by rows and by columns.
    """
    parts = max(1, math.ceil(max(abs(dr), abs(dc)) / 4.0))
    enter, leave = 0.0, 1.0
    for p, d, size in ((row, dr, rows), (col, dc, cols)):
        if d == 0.0:
            if p < -margin or p > size - 1.0 + margin:
                leave = -1.0
        else:
            a, b = (-margin - p) / d, (size - 1.0 + margin - p) / d
            enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    if enter > leave:
        return 0, 0, parts
    return max(int(enter * parts) - 1, 0), min(int(leave * parts) + 2, parts), parts


@kernel
def _first_square(p: float, q: float, dp: float, dq: float, r: float) -> tuple[float, float, float]:
    """Return the first contact of a point that moves from (p, q) by (dp, dq) with the unit square around 0 rounded by r."""
    n0, n1, depth = _square_normal(p, q)
    if depth < r:
        return (0.0, n0, n1) if n0 * dp + n1 * dq < 0.0 else (math.inf, 0.0, 0.0)
    share = min(_enter_box(p, q, dp, dq, 0.5 + r, 0.5), _enter_box(p, q, dp, dq, 0.5, 0.5 + r))
    dd = dp * dp + dq * dq
    for corner in range(4):
        u, v = p - (0.5 if corner & 1 else -0.5), q - (0.5 if corner & 2 else -0.5)
        b, c = u * dp + v * dq, u * u + v * v - r * r
        under = b * b - dd * c
        if b < 0.0 and under > 0.0 and c >= 0.0:
            share = min(share, c / (-b + math.sqrt(under)))
    if share > 1.0:
        return math.inf, 0.0, 0.0
    n0, n1, _ = _square_normal(p + share * dp, q + share * dq)
    return (share, n0, n1) if n0 * dp + n1 * dq < 0.0 else (math.inf, 0.0, 0.0)


@kernel
def _square_normal(p: float, q: float) -> tuple[float, float, float]:
    """Return the unit normal of the unit square around 0 towards (p, q), and the signed distance from the square."""
    u, v = p - min(max(p, -0.5), 0.5), q - min(max(q, -0.5), 0.5)
    distance = math.hypot(u, v)
    if distance > 0.0:
        return u / distance, v / distance, distance
    if abs(p) >= abs(q):
        return math.copysign(1.0, p), 0.0, abs(p) - 0.5
    return 0.0, math.copysign(1.0, q), abs(q) - 0.5


@kernel
def _enter_box(p: float, q: float, dp: float, dq: float, a: float, b: float) -> float:
    """Return the share of the segment (dp, dq) from (p, q) at which it enters the open box |p| < a, |q| < b; else infinity."""
    enter, leave = 0.0, math.inf
    for x, d, half in ((p, dp, a), (q, dq, b)):
        if d == 0.0:
            if abs(x) >= half:
                return math.inf
        else:
            s, t = (-half - x) / d, (half - x) / d
            enter, leave = max(enter, min(s, t)), min(leave, max(s, t))
    return enter if enter < leave else math.inf


@bare_kernel
def free_distance(walls: Walls, x: float, y: float) -> float:
    """Return a lower bound >= 0 of the distance in m of (x, y) from blocked squares and from the map's edges."""
    s = walls.resolution
    rows, cols = walls.blocked.shape
    u, v = (x - walls.x0) / s, (y - walls.y0) / s
    if not (0.0 <= u < cols and 0.0 <= v < rows):
        return 0.0
    i, j = int(v), int(u)
    free: float = max(walls.clearance[i, j] - s * math.hypot(u - j - 0.5, v - i - 0.5), 0.0)
    return free
