"""Contact in continuous time of a body on a segment of motion: with discs that move and grow, and with walls.

The body is the convex hull of its corners, rounded; a disc has one corner, its centre, and its radius as rounding. A contact is
a gap below -`TOUCH`; touching is legal. The method is conservative advancement. Along the axis n of the present gap d, the gap
stays above the quadratic d + c s + q s^2 / 2, where c is exact; q is exact on straight segments and a bound on the
acceleration of every corner on curved ones. Stepping from root to root never skips a contact and converges to it as fast as
Newton's method.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import TOUCH, free_distance
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import Walls
from antway.kernels.robot.motion import along

_CLOSE = 1e-12  # m; a smaller gap that is closing is a contact
_LEAST = 1e-9  # s; the shortest step of conservative advancement
DIRECTIONS = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))  # along the axes of the map
_SLACK = 1e-6  # m; cells farther than this from every place of the body are left out


class Body(NamedTuple):
    """The robot's shape: the convex hull of its corners, rounded."""

    corners: Floats  # float64[N, 2], m, in the robot's frame, counterclockwise; a disc has one at (0, 0)
    rounding: float  # m; the radius of a disc, 0 of a polygon
    radius: float  # m; radius of the disc around (0, 0) that contains it
    centre: Floats  # float64[1, 2] of zeros


@inner_kernel
def enlarged(body: Body, margin: float) -> Body:
    """Return the body with a margin in m around it."""
    return Body(body.corners, body.rounding + margin, body.radius + margin, body.centre)


class Pose(NamedTuple):
    """Where a body is at an instant of its motion, and how fast it moves."""

    x: float  # m
    y: float  # m
    theta: float  # rad
    vx: float  # m/s
    vy: float  # m/s
    w: float  # rad/s; turn rate


class Segment(NamedTuple):
    """A part of motion from (x, y, theta): straight with a constant acceleration, or an arc (kernels/robot/motion.py)."""

    curved: bool
    x: float  # m
    y: float  # m
    theta: float  # rad
    vx: float  # m/s
    vy: float  # m/s
    ax: float  # m/s^2
    ay: float  # m/s^2
    v: float  # m/s, on an arc
    a: float  # m/s^2, on an arc
    w: float  # rad/s
    b: float  # rad/s^2
    bend: float  # m/s^2; bound on the acceleration of the body's centre, 0 if straight
    spin: float  # rad/s^2; bound on the further acceleration of a corner, for each metre from the centre


@bare_kernel
def straight(x: float, y: float, theta: float, vx: float, vy: float, ax: float, ay: float) -> Segment:
    """Return the segment of a body that keeps its heading."""
    return Segment(False, x, y, theta, vx, vy, ax, ay, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@bare_kernel
def rolling(x: float, y: float, theta: float, v: float, a: float, w: float, b: float, h: float) -> Segment:
    """Return the segment of wheels with the speed v + a t and the turn rate w + b t, `h` s long."""
    c, s = math.cos(theta), math.sin(theta)
    if w == 0.0 and b == 0.0:
        return Segment(False, x, y, theta, v * c, v * s, a * c, a * s, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    fastest, turn = max(abs(v), abs(v + a * h)), max(abs(w), abs(w + b * h))
    bend, spin = abs(a) + fastest * turn, abs(b) + turn * turn
    return Segment(True, x, y, theta, v * c, v * s, 0.0, 0.0, v, a, w, b, bend, spin)


@bare_kernel
def pose(m: Segment, s: float) -> Pose:
    """Return place, heading, velocity and turn rate after s s."""
    if not m.curved:
        x, y = m.x + (m.vx + 0.5 * m.ax * s) * s, m.y + (m.vy + 0.5 * m.ay * s) * s
        return Pose(x, y, m.theta, m.vx + m.ax * s, m.vy + m.ay * s, 0.0)
    dx, dy = along(m.theta, m.v, m.a, m.w, m.b, s)
    theta, speed = m.theta + (m.w + 0.5 * m.b * s) * s, m.v + m.a * s
    return Pose(m.x + dx, m.y + dy, theta, speed * math.cos(theta), speed * math.sin(theta), m.w + m.b * s)


@bare_kernel
def top_speed(m: Segment, h: float) -> float:
    """Return the greatest speed on a segment, `h` s long, m/s."""
    if m.curved:
        return max(abs(m.v), abs(m.v + m.a * h))
    return max(math.hypot(m.vx, m.vy), math.hypot(m.vx + m.ax * h, m.vy + m.ay * h))


@bare_kernel
def when_lost(d: float, c: float, q: float) -> float:
    """Return the first s > 0 at which d + c s + q s^2 / 2 is 0, for d > 0; infinite if there is none."""
    under = c * c - 2.0 * q * d
    if under < 0.0 or (q >= 0.0 and c >= 0.0):
        return math.inf
    root = math.sqrt(under)
    return 2.0 * d / (root - c) if c <= 0.0 else (c + root) / -q


@bare_kernel
def axis_gap(
    m: Segment, at: Pose, corners: Floats, nx: float, ny: float, level: float, rate: float, growth: float
) -> tuple[float, float, float]:
    """Return the gap of the body from the half plane n.p <= level, its rate, and for how long it surely stays above 0.

    n is the unit axis from the obstacle to the body, and `level` how far the obstacle and the body's rounding extend along it,
    m; it rises with `rate` m/s, which grows by `growth` m/s^2. `at` is the motion's `pose` now. Gap (m) and rate (m/s) are
    those of the nearest corner, and the time (s) is the shortest over all corners. A body that overlaps the half plane already,
    because its place was not known well, stays above the present gap.
    """
    x, y, theta, vx, vy, w = at
    c, s = math.cos(theta), math.sin(theta)
    gap, opening, time, least = math.inf, 0.0, math.inf, 0.0
    base, speed = nx * x + ny * y - level, nx * vx + ny * vy - rate
    push = (nx * m.ax + ny * m.ay if not m.curved else -m.bend) - growth
    for _ in range(2):
        time = math.inf
        for i in range(len(corners)):
            rx, ry = c * corners[i, 0] - s * corners[i, 1], s * corners[i, 0] + c * corners[i, 1]
            d, closing = base + nx * rx + ny * ry, speed + w * (ny * rx - nx * ry)
            bend = push - m.spin * math.hypot(rx, ry) if m.curved else push
            if d < gap:
                gap, opening = d, closing
            time = min(time, when_lost(max(d - least, _CLOSE), closing, bend))
        if gap >= least:
            break
        least = gap
    return gap, opening, time


@bare_kernel
def disc_axis(at: Pose, corners: Floats, ox: float, oy: float) -> tuple[float, float]:
    """Return the unit axis along which the hull of the corners is farthest from the point (ox, oy)."""
    x, y, theta = at.x, at.y, at.theta
    n = len(corners)
    if n == 1:
        dx, dy = x - ox, y - oy
        away = math.hypot(dx, dy)
        return (dx / away, dy / away) if away > 0.0 else (1.0, 0.0)
    c, s = math.cos(theta), math.sin(theta)
    px, py = c * (ox - x) + s * (oy - y), c * (oy - y) - s * (ox - x)  # the point in the body's frame
    best, bx, by = -math.inf, 1.0, 0.0
    for i in range(n):
        j = i + 1 if i + 1 < n else 0
        ex, ey = corners[j, 0] - corners[i, 0], corners[j, 1] - corners[i, 1]
        length = math.hypot(ex, ey)
        mx, my = ey / length, -ex / length  # outward normal of a counterclockwise edge
        outside = mx * (px - corners[i, 0]) + my * (py - corners[i, 1])
        if outside > best:
            best, bx, by = outside, -mx, -my
            if outside > 0.0:
                share = ((px - corners[i, 0]) * ex + (py - corners[i, 1]) * ey) / (length * length)
                if share < 0.0 or share > 1.0:
                    k = i if share < 0.0 else j
                    # Beyond the edge's end the corner is nearest, unless a later edge is farther away.
                    qx, qy = corners[k, 0] - px, corners[k, 1] - py
                    away = math.hypot(qx, qy)
                    if away > 0.0:
                        bx, by = qx / away, qy / away
    return c * bx - s * by, s * bx + c * by


@bare_kernel
def _point_axis(dx: float, dy: float, half: float) -> tuple[float, float]:
    """Return the unit axis from the square around (0, 0) to the point (dx, dy)."""
    u, v = dx - min(max(dx, -half), half), dy - min(max(dy, -half), half)
    away = math.hypot(u, v)
    if away > 0.0:
        return u / away, v / away
    return (math.copysign(1.0, dx), 0.0) if abs(dx) >= abs(dy) else (0.0, math.copysign(1.0, dy))


@bare_kernel
def square_axis(at: Pose, corners: Floats, cx: float, cy: float, half: float) -> tuple[float, float]:
    """Return the unit axis along which the hull of the corners is farthest from the square around (cx, cy)."""
    x, y, theta = at.x, at.y, at.theta
    n = len(corners)
    if n == 1:
        return _point_axis(x - cx, y - cy, half)
    c, s = math.cos(theta), math.sin(theta)
    best, bx, by = -math.inf, 1.0, 0.0
    low_x, low_y, high_x, high_y = math.inf, math.inf, -math.inf, -math.inf
    near, qx, qy = math.inf, 0.0, 0.0
    ix, iy = corners[n - 1, 0], corners[n - 1, 1]
    px, py = x + c * ix - s * iy - cx, y + s * ix + c * iy - cy
    for i in range(n):
        ix, iy = corners[i, 0], corners[i, 1]
        kx, ky = x + c * ix - s * iy - cx, y + s * ix + c * iy - cy  # relative to the square's centre
        low_x, low_y, high_x, high_y = min(low_x, kx), min(low_y, ky), max(high_x, kx), max(high_y, ky)
        ex, ey = kx - px, ky - py
        length = math.hypot(ex, ey)
        mx, my = ey / length, -ex / length
        outside = -(mx * px + my * py) - half * (abs(mx) + abs(my))
        if outside > best:
            best, bx, by = outside, -mx, -my
        u, v = kx - math.copysign(half, kx), ky - math.copysign(half, ky)  # relative to the square's nearest corner
        if u * u + v * v < near:
            near, qx, qy = u * u + v * v, u, v
        px, py = kx, ky
    for side in range(4):
        outside = (low_x, -high_x, low_y, -high_y)[side] - half
        if outside > best:
            best = outside
            bx, by = DIRECTIONS[side]
    if best > 0.0 and near > 0.0:
        away = math.sqrt(near)
        mx, my = qx / away, qy / away
        least = math.inf
        for i in range(n):
            ix, iy = corners[i, 0], corners[i, 1]
            least = min(least, mx * (x + c * ix - s * iy - cx) + my * (y + s * ix + c * iy - cy))
        if least - half * (abs(mx) + abs(my)) > best:
            bx, by = mx, my
    return bx, by


class Disc(NamedTuple):
    """A disc that moves on a straight line."""

    x: float  # m; centre at the start of a segment
    y: float
    vx: float  # m/s
    vy: float
    radius: float  # m


@bare_kernel
def meets_disc(m: Segment, h: float, body: Body, disc: Disc) -> float:
    """Return the time in s of the first contact with a disc on a segment, `h` s long; infinite if there is none."""
    s = 0.0
    while s <= h:
        at = pose(m, s)
        px, py = disc.x + disc.vx * s, disc.y + disc.vy * s
        nx, ny = disc_axis(at, body.corners, px, py)
        level = nx * px + ny * py + disc.radius + body.rounding - TOUCH
        gap, opening, time = axis_gap(m, at, body.corners, nx, ny, level, nx * disc.vx + ny * disc.vy, 0.0)
        if gap <= _CLOSE and opening < 0.0:
            return s
        s += max(time, _LEAST)
    return math.inf


@bare_kernel
def nearest_disc(m: Segment, h: float, body: Body, disc: Disc, best: float) -> float:
    """Return the smallest gap in m to a disc on a segment, or `best` if that is smaller.

    The segment, `h` s long, is sampled every 4 ms wherever the gap may be smaller than the best so far. Around each local
    minimum of the samples the minimum is refined, if both can move so far between two samples that it may be the smallest.
    """
    corners, around = body.corners, disc.radius + body.rounding
    apart = max(h / math.ceil(max(h / 0.004, 1.0)), _LEAST)
    turn = max(abs(m.w), abs(m.w + m.b * h))
    dip = 0.5 * apart * (top_speed(m, h) + turn * body.radius + math.hypot(disc.vx, disc.vy))
    s, last, before, last_gap, gap_before = 0.0, 0.0, 0.0, math.inf, math.inf
    while True:
        s = s if s < h - _LEAST else h  # no last step is as short as a rounding error, or it alone would be refined
        at = pose(m, s)
        px, py = disc.x + disc.vx * s, disc.y + disc.vy * s
        nx, ny = disc_axis(at, corners, px, py)
        gap, _, _ = axis_gap(m, at, corners, nx, ny, nx * px + ny * py + around, nx * disc.vx + ny * disc.vy, 0.0)
        best = min(best, gap)
        if last_gap <= gap_before and last_gap <= gap and last_gap < best + dip:
            low, high = max(before, last - apart), min(last + apart, s)
            best = _lowest(m, corners, around, disc, low, high, best)
        if s >= h:
            break
        before, gap_before, last, last_gap = last, last_gap, s, gap
        level = nx * px + ny * py + around + best
        _, _, time = axis_gap(m, at, corners, nx, ny, level, nx * disc.vx + ny * disc.vy, 0.0)
        s += max(time, apart)
    if gap <= last_gap and gap < best + dip:
        best = _lowest(m, corners, around, disc, max(last, h - apart), h, best)
    return best


@bare_kernel
def _lowest(m: Segment, corners: Floats, around: float, disc: Disc, low: float, high: float, best: float) -> float:
    """Return the smallest gap to a disc enlarged to radius `around` in [low, high], which holds one minimum, or `best`."""
    first = math.inf
    for _ in range(40):  # thirds
        for side in range(2):
            s = (2.0 * low + high) / 3.0 if side == 0 else (low + 2.0 * high) / 3.0
            at = pose(m, s)
            px, py = disc.x + disc.vx * s, disc.y + disc.vy * s
            nx, ny = disc_axis(at, corners, px, py)
            gap, _, _ = axis_gap(m, at, corners, nx, ny, nx * px + ny * py + around, 0.0, 0.0)
            if side == 0:
                first = gap
        best = min(best, first, gap)
        if first <= gap:
            high = (low + 2.0 * high) / 3.0
        else:
            low = (2.0 * low + high) / 3.0
    return best


@bare_kernel
def meets_wall(m: Segment, h: float, body: Body, walls: Walls) -> float:
    """Return the time in s of the first contact with a wall or the map's edge on a segment, `h` s long; else infinity."""
    fastest = top_speed(m, h)
    window = max(walls.resolution, 0.05)  # m; length of the part of the path that is tested against nearby walls at once
    s = 0.0
    while s < h:
        at = pose(m, s)
        free = free_distance(walls, at.x, at.y) - body.radius
        if free > 0.25 * window:
            s += free / fastest if fastest > 0.0 else math.inf
            continue
        end = min(s + window / fastest, h) if fastest > 0.0 else h
        first = _meets_near(m, at, s, end, body, fastest * (end - s), walls)
        if first < math.inf:
            return first
        s = end
    return math.inf


@bare_kernel
def _meets_near(m: Segment, at: Pose, start: float, end: float, body: Body, moved: float, walls: Walls) -> float:
    """Return the first contact in [start, end] with the map's edges and with blocked cells; `at` is the pose at `start`.

    A cell among blocked ones is tested only if the body touches a wall at `start`: from free space it meets others first.
    The body's centre moves by at most `moved` m.
    """
    rows, cols = walls.blocked.shape
    size, corners, (x, y, theta) = walls.resolution, body.corners, (at.x, at.y, at.theta)
    best, touches = _meets_edges(m, at, start, end, body, moved, walls)
    turn = max(abs(m.w + m.b * start), abs(m.w + m.b * end))
    beyond = moved + turn * (end - start) * (body.radius - body.rounding) + body.rounding + _SLACK
    c, s = math.cos(theta), math.sin(theta)
    x0 = y0 = u0 = v0 = math.inf  # the box around the corners, along the map and along the body
    x1 = y1 = u1 = v1 = -math.inf
    px, py = x, y
    for k in range(len(corners)):
        u, v = corners[k, 0], corners[k, 1]
        px, py = x + c * u - s * v, y + s * u + c * v
        x0, y0, x1, y1 = min(x0, px), min(y0, py), max(x1, px), max(y1, py)
        u0, v0, u1, v1 = min(u0, u), min(v0, v), max(u1, u), max(v1, v)
    i, j = math.floor((py - walls.y0) / size), math.floor((px - walls.x0) / size)
    touches = touches or not (0 <= i < rows and 0 <= j < cols) or walls.blocked[i, j]  # the body may be inside a wall
    top, bottom = math.floor((y0 - beyond - walls.y0) / size), math.floor((y1 + beyond - walls.y0) / size)
    left, right = math.floor((x0 - beyond - walls.x0) / size), math.floor((x1 + beyond - walls.x0) / size)
    beyond += 0.5 * math.sqrt(2.0) * size  # from the body to the centre of a cell that it may meet
    for buried in (False, True):
        if buried and not touches:
            break
        for i in range(max(top, 0), min(bottom, rows - 1) + 1):
            j, cy = max(left, 0), walls.y0 + (i + 0.5) * size
            while j <= min(right, cols - 1) and best > start:
                if walls.blocked[i, j]:
                    cx = walls.x0 + (j + 0.5) * size
                    u, v = c * (cx - x) + s * (cy - y), c * (cy - y) - s * (cx - x)
                    near = u0 - beyond < u < u1 + beyond and v0 - beyond < v < v1 + beyond
                    if near and _buried(walls, i, j) == buried:
                        first, touched = _meets_square(m, at, start, min(end, best), body, cx, cy, 0.5 * size)
                        best, touches = min(best, first), touches or touched
                j += max(int(walls.clearance[i, j] / size + 0.5), 1)  # no cell on the way there is blocked
    return best


@bare_kernel
def _meets_edges(m: Segment, at: Pose, start: float, end: float, body: Body, moved: float, walls: Walls) -> tuple[float, bool]:
    """Return the first contact in [start, end] with the map's edges, and whether the body touches one at `start`."""
    rows, cols = walls.blocked.shape
    right, top = walls.x0 + cols * walls.resolution, walls.y0 + rows * walls.resolution
    best, touches = math.inf, False
    for side in range(4):
        nx, ny = DIRECTIONS[side]
        edge = (walls.x0, -right, walls.y0, -top)[side]
        if nx * at.x + ny * at.y - edge > body.radius + moved + TOUCH:
            continue
        t, last = start, min(end, best)
        while t <= last:
            gap, opening, time = axis_gap(m, pose(m, t), body.corners, nx, ny, edge + body.rounding - TOUCH, 0.0, 0.0)
            touches = touches or (gap <= _CLOSE and t == start)
            if gap <= _CLOSE and opening < 0.0:
                best = t
                break
            t += max(time, _LEAST)
    return best, touches


@bare_kernel
def _buried(walls: Walls, i: int, j: int) -> bool:
    """Tell whether the eight cells around a cell are blocked or outside the map."""
    rows, cols = walls.blocked.shape
    for r in range(max(i - 1, 0), min(i + 2, rows)):
        for c in range(max(j - 1, 0), min(j + 2, cols)):
            if not walls.blocked[r, c]:
                return False
    return True


@bare_kernel
def _meets_square(
    m: Segment, at: Pose, start: float, end: float, body: Body, cx: float, cy: float, half: float
) -> tuple[float, bool]:
    """Return the first contact in [start, end] with a square, and whether the body touches the square at `start`.

    The square is that around (cx, cy) whose edges are 2 `half` m long; `at` is the pose at `start`.
    """
    s, touches = start, False
    while s <= end:
        if s > start:
            at = pose(m, s)
        nx, ny = square_axis(at, body.corners, cx, cy, half)
        level = nx * cx + ny * cy + half * (abs(nx) + abs(ny)) + body.rounding - TOUCH
        gap, opening, time = axis_gap(m, at, body.corners, nx, ny, level, 0.0, 0.0)
        touches = touches or (gap <= _CLOSE and s == start)
        if gap <= _CLOSE and opening < 0.0:
            return s, touches
        s += max(time, _LEAST)
    return math.inf, touches
