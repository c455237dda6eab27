"""One control step of the simulated robot, first contact with walls, and discs that bounce off them."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import TOUCH, swept_discs, swept_timeline
from antway.kernels.base.jit import bare_kernel, kernel
from antway.kernels.base.rng import State, uniform

# What ended a step, in the order that decides ties.
GOES_ON, HIT_MOVING, HIT_STANDING, HIT_WALL, REACHED = 0, 1, 2, 3, 4

REST = 1e-9  # m/s; a robot slower than this stands


@kernel
def drive(
    vx: float, vy: float, heading: float, cx: float, cy: float, limits: NDArray[np.float64], dt: float
) -> tuple[float, float, float]:
    """Velocity and heading of the next step: the commanded velocity (cx, cy) as far as the robot's limits allow.

    A holonomic robot changes its velocity vector by at most a_max dt. A differential drive turns towards the command by at most
    turn_rate dt and drives forward along its heading at the command's part in that direction, its speed changed by at most
    a_max dt. A command that is not finite means stop.

    Parameters
    ----------
    vx, vy, heading : float
        Present velocity in m/s and heading in rad.
    cx, cy : float
        Command, m/s.
    limits : float64[4]
        v_max in m/s, a_max in m/s^2, turn_rate in rad/s, 1 for a differential drive and 0 for a holonomic one.
    dt : float
        Control period, s.
    """
    v_max, gain = limits[0], limits[1] * dt
    if not (math.isfinite(cx) and math.isfinite(cy)):
        cx, cy = 0.0, 0.0
    asked = math.hypot(cx, cy)
    if asked > v_max:
        cx, cy, asked = cx * (v_max / asked), cy * (v_max / asked), v_max
    if limits[3] == 0.0:
        dx, dy = cx - vx, cy - vy
        change = math.hypot(dx, dy)
        if change > gain:
            cx, cy = vx + dx * (gain / change), vy + dy * (gain / change)
        if math.hypot(cx, cy) > REST:
            heading = math.atan2(cy, cx)
        return cx, cy, heading
    speed = vx * math.cos(heading) + vy * math.sin(heading)
    if asked > REST:
        most = limits[2] * dt
        turn = wrap(math.atan2(cy, cx) - heading)
        heading = wrap(heading + min(max(turn, -most), most))
    wanted = max(cx * math.cos(heading) + cy * math.sin(heading), 0.0)
    speed = min(max(wanted, speed - gain), speed + gain)
    return speed * math.cos(heading), speed * math.sin(heading), heading


@kernel
def wrap(angle: float) -> float:
    """Return `angle` in rad as the same direction within [-pi, pi]."""
    return angle - 2.0 * math.pi * round(angle / (2.0 * math.pi))


@bare_kernel
def advance(
    i: int,
    cx: float,
    cy: float,
    dt: float,
    robot: NDArray[np.float64],
    aim: NDArray[np.float64],
    t: NDArray[np.float64],
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
    heading: NDArray[np.float64],
    blocked: NDArray[np.bool_],
    frame: NDArray[np.float64],
    knot_t: NDArray[np.float64],
    knot_xy: NDArray[np.float64],
    first: NDArray[np.int64],
    radius: NDArray[np.float64],
) -> tuple[int, int, float]:
    """Drive control step i under the command (cx, cy) and write row i + 1 of the robot's record.

    The robot goes straight at constant speed from t[i] to (i + 1) dt, or to whatever comes first on the way: contact with an
    obstacle, contact with a wall, the goal. Row i + 1 is then that instant.

    Parameters
    ----------
    robot : float64[5]
        Limits as in `drive`, and the robot's radius in m.
    aim : float64[3]
        Goal x, y and tolerance, m.
    t, xy, velocity, heading
        The record; rows up to i are given.
    blocked, frame : bool[H, W], float64[3]
        The map; x and y of its corner and the edge of a cell, m.
    knot_t, knot_xy, first, radius
        The obstacles (kernels/base/geometry.py).

    Returns
    -------
    what : int
        `GOES_ON`, `HIT_MOVING`, `HIT_STANDING`, `HIT_WALL` or `REACHED`.
    who : int
        Index of the obstacle touched, else -1.
    clearance : float
        Least distance between robot and obstacle edges up to row i + 1, m; infinite without obstacles.
    """
    vx, vy, new_heading = drive(velocity[i, 0], velocity[i, 1], heading[i], cx, cy, robot, dt)
    t0, t1 = t[i], (i + 1) * dt
    h = t1 - t0
    ax, ay = xy[i, 0], xy[i, 1]
    bx, by = ax + vx * h, ay + vy * h
    what, who, when, clearance = GOES_ON, -1, t1, math.inf
    for k in range(len(radius)):
        reach = robot[4] + radius[k]
        hit, distance, _ = swept_timeline(ax, ay, bx, by, t0, t1, reach, knot_t, knot_xy, first[k], first[k + 1])
        clearance = min(clearance, distance - reach)
        if hit < when or (hit == when and what == GOES_ON):
            when, who = hit, k
            what = HIT_MOVING if math.hypot(vx, vy) > REST else HIT_STANDING
    s = frame[2]
    row0, col0 = (ay - frame[1]) / s - 0.5, (ax - frame[0]) / s - 0.5
    wall, _, _ = first_wall(blocked, row0, col0, vy * h / s, vx * h / s, robot[4] / s)
    if t0 + wall * h < when:
        what, who, when = HIT_WALL, -1, t0 + wall * h
    arrival, _, _ = swept_discs(aim[0] - ax, aim[1] - ay, -vx, -vy, aim[2], h)
    if t0 + arrival < when:
        what, who, when = REACHED, -1, t0 + arrival
    if what != GOES_ON:
        when = max(when, np.nextafter(t0, math.inf))
        bx, by = ax + vx * (when - t0), ay + vy * (when - t0)
        clearance = math.inf
        for k in range(len(radius)):
            reach = robot[4] + radius[k]
            _, distance, _ = swept_timeline(ax, ay, bx, by, t0, when, reach, knot_t, knot_xy, first[k], first[k + 1])
            clearance = min(clearance, distance - reach)
    t[i + 1] = when
    xy[i + 1, 0], xy[i + 1, 1] = bx, by
    velocity[i + 1, 0], velocity[i + 1, 1] = vx, vy
    heading[i + 1] = new_heading
    return what, who, clearance


@kernel
def first_wall(
    blocked: NDArray[np.bool_], row: float, col: float, dr: float, dc: float, radius: float
) -> tuple[float, float, float]:
    """First contact of a disc that goes from (row, col) by (dr, dc) with a blocked cell or an edge of the map.

    All in cells, integers at cell centres. The way is scanned in pieces of a few cells, so that a long one costs what it needs.

    Returns
    -------
    share : float
        Share of the way gone at contact, in [0, 1]; infinite if there is none. A disc that already touches what it does not
        move towards has no contact with it.
    n_row, n_col : float
        Unit normal there, from the wall to the disc.
    """
    rows, cols = blocked.shape
    r = max(radius - TOUCH, 0.0)
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
    pieces = max(1, math.ceil(max(abs(dr), abs(dc)) / 4.0))
    margin = r + 0.5
    for piece in range(pieces):
        if best <= piece / pieces:
            break
        r0, c0 = row + dr * (piece / pieces), col + dc * (piece / pieces)
        r1, c1 = row + dr * ((piece + 1) / pieces), col + dc * ((piece + 1) / pieces)
        for i in range(max(math.ceil(min(r0, r1) - margin), 0), min(math.floor(max(r0, r1) + margin), rows - 1) + 1):
            for j in range(max(math.ceil(min(c0, c1) - margin), 0), min(math.floor(max(c0, c1) + margin), cols - 1) + 1):
                if blocked[i, j]:
                    share, n0, n1 = _first_square(row - i, col - j, dr, dc, r)
                    if share < best:
                        best, n_row, n_col = share, n0, n1
    return best, n_row, n_col


@kernel
def _first_square(p: float, q: float, dp: float, dq: float, r: float) -> tuple[float, float, float]:
    """First contact of a point going from (p, q) by (dp, dq) with the unit square around 0 rounded by r, and its normal."""
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
    """Unit normal of the unit square around 0 towards (p, q), and the distance from the square (not above 0 inside)."""
    u, v = p - min(max(p, -0.5), 0.5), q - min(max(q, -0.5), 0.5)
    distance = math.hypot(u, v)
    if distance > 0.0:
        return u / distance, v / distance, distance
    if abs(p) >= abs(q):
        return math.copysign(1.0, p), 0.0, abs(p) - 0.5
    return 0.0, math.copysign(1.0, q), abs(q) - 0.5


@kernel
def _enter_box(p: float, q: float, dp: float, dq: float, a: float, b: float) -> float:
    """Share of the way (dp, dq) from (p, q) at which it enters the open box |p| < a, |q| < b; infinite if it never does."""
    enter, leave = 0.0, math.inf
    for x, d, half in ((p, dp, a), (q, dq, b)):
        if d == 0.0:
            if abs(x) >= half:
                return math.inf
        else:
            s, t = (-half - x) / d, (half - x) / d
            enter, leave = max(enter, min(s, t)), min(leave, max(s, t))
    return enter if enter < leave else math.inf


@kernel
def bounce(
    blocked: NDArray[np.bool_],
    row: float,
    col: float,
    speed: float,
    angle: float,
    radius: float,
    turn_every: float,
    horizon: float,
    state: State,
    knot_t: NDArray[np.float64],
    knot_rc: NDArray[np.float64],
) -> int:
    """Course of a disc that goes straight, is mirrored at walls and edges, and now and then turns at random.

    Parameters
    ----------
    blocked, row, col, radius
        The map, and the disc's centre at time 0 and radius, in cells.
    speed, angle : float
        Speed in cells/s; direction of the start, atan2(d_row, d_col), rad.
    turn_every : float
        Time between random changes of direction, s; infinite for none.
    horizon : float
        s.
    state : uint64[1]
        Of the random generator.
    knot_t, knot_rc : float64[M], float64[M, 2]
        Filled with the knots.

    Returns
    -------
    int
        Number of knots; M + 1 if they did not fit.
    """
    vr, vc = speed * math.sin(angle), speed * math.cos(angle)
    t, turn, n = 0.0, turn_every, 1
    knot_t[0], knot_rc[0, 0], knot_rc[0, 1] = 0.0, row, col
    standing = 0  # mirrorings without a way gone between them: more than a few and the disc is wedged until its next turn
    while t < horizon:
        end = min(turn, horizon)
        if standing > 8:
            vr, vc = 0.0, 0.0
        share, n_row, n_col = first_wall(blocked, row, col, vr * (end - t), vc * (end - t), radius)
        mirrored = share <= 1.0
        later = t + share * (end - t) if mirrored else end
        if later > t:
            if n == len(knot_t):
                return n + 1
            row, col, t = row + vr * (later - t), col + vc * (later - t), later
            knot_t[n], knot_rc[n, 0], knot_rc[n, 1] = t, row, col
            n += 1
            standing = 0
        if mirrored:
            standing += 1
            into = vr * n_row + vc * n_col
            vr, vc = vr - 2.0 * into * n_row, vc - 2.0 * into * n_col
        elif t >= turn:
            angle = 2.0 * math.pi * uniform(state)
            vr, vc = speed * math.sin(angle), speed * math.cos(angle)
            turn += turn_every
            standing = 0
    return n
