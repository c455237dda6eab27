"""The guard for robots with inertia: does a command leave a manoeuvre to a stand that nothing can cut off?

A manoeuvre is: one control cycle of the command, then brake while the turn rate goes to some value for some cycles, then brake
and stop turning. It is certified if its true path (ramps, arcs, the footprint) keeps a margin to walls and stays out of
every place that an obstacle could reach by then (kernels/robot/reach.py). What an obstacle could reach by a given time shrinks
with each look at it, so a manoeuvre certified once stays certified: the guard keeps the last one and falls back on it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import TOUCH
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits
from antway.kernels.robot.cycle import Body, next_segment
from antway.kernels.robot.motion import REST, clip_twist, clip_velocity, drive_cycle, drive_roughly
from antway.kernels.robot.reach import ACCEL, AGE, RADIUS, SPEED, VX, VY, X, Y
from antway.kernels.robot.sweep import Segment, Walls, axis_gap, disc_axis, free_distance, meets_wall, pose

FREE, SLOWED, BRAKED, STEPPED_ASIDE = 0, 1, 2, 3  # what the guard did
TURN, CYCLES, SIDE = range(3)  # of the state kept: turn rate of the stop held, how many cycles of it are left, last side taken
_FRACTIONS = 5  # parts of the commanded speed tried
_CLOSE = 1e-12
_LEAST = 1e-9
_SPEEDS, _TURNS = 3, 5  # arcs tried for a step aside
_SIDES = 16  # directions tried for one, without wheels
_KEEP = 0.3  # s; what it is worth to keep to the side taken


class Robot(NamedTuple):
    """What the guard knows of the robot and its map for an episode."""

    limits: RobotLimits
    body: Body
    walls: Walls
    dt: float  # s
    margin: float  # m kept from walls


@bare_kernel
def _stays_clear(m: Segment, t: float, h: float, body: Body, row: NDArray[np.float64]) -> bool:
    """Tell whether the body on a segment, which begins t s from now, stays out of where one obstacle could be.

    It could be in a disc round where it was seen that grows by its speed, and in one that drifts on with its velocity and grows
    by its acceleration: it is in both, so to be out of one at each time is enough.
    """
    s = 0.0
    while s <= h:
        at = pose(m, s)
        later = t + s + row[AGE]
        nx, ny = disc_axis(at, body.corners, row[X], row[Y])
        level = nx * row[X] + ny * row[Y] + row[RADIUS] + row[SPEED] * later + body.rounding - TOUCH
        gap, _, time = axis_gap(m, at, body.corners, nx, ny, level, row[SPEED], 0.0)
        if row[ACCEL] < math.inf and (gap <= _CLOSE or s + time < h):
            px, py = row[X] + row[VX] * later, row[Y] + row[VY] * later
            nx, ny = disc_axis(at, body.corners, px, py)
            level = nx * px + ny * py + row[RADIUS] + 0.5 * row[ACCEL] * later * later + body.rounding - TOUCH
            rate = nx * row[VX] + ny * row[VY] + row[ACCEL] * later
            other, _, longer = axis_gap(m, at, body.corners, nx, ny, level, rate, row[ACCEL])
            if gap <= _CLOSE:
                gap, time = other, longer
            elif other > _CLOSE:
                time = max(time, longer)
        if gap <= _CLOSE:
            return False
        s += max(time, _LEAST)
    return True


@bare_kernel
def certified(
    x: float,
    y: float,
    theta: float,
    a: float,
    b: float,
    ca: float,
    cb: float,
    turn: float,
    cycles: int,
    robot: Robot,
    margin: float,
    rows: NDArray[np.float64],
) -> bool:
    """Tell whether the command (ca, cb) and then a stop are certified.

    Parameters
    ----------
    x, y, theta, a, b : float
        State of the robot when the command begins to act, which is the latency from now.
    turn, cycles : float, int
        The stop: brake with the command (0, turn) for so many cycles, then with (0, 0).
    margin : float
        m kept from walls; `robot.margin`, or what there is.
    rows : float64[K, 8]
        Obstacles, as in `kernels/robot/reach.py`: those near enough.
    """
    limits, body, t = robot.limits, robot.body, robot.limits.latency
    holonomic, disc = limits.drive == HOLONOMIC, len(robot.body.corners) == 1
    for phase in range(3):
        if phase == 1 and cycles == 0:
            continue
        left = robot.dt if phase == 0 else cycles * robot.dt if phase == 1 else math.inf
        one, two = (ca, cb) if phase == 0 else (0.0, turn if phase == 1 else 0.0)
        while left > 0.0:
            if phase > 0:
                still = math.hypot(a, b) <= REST if holonomic else abs(a) <= REST and (disc or (phase == 2 and abs(b) <= REST))
                if still:
                    if phase == 2 or disc:
                        return True
                    if abs(b - turn) <= REST and abs(b) <= REST:
                        break
            m, h, a1, b1 = next_segment(x, y, theta, a, b, one, two, limits, min(left, 3600.0))
            moves = m.curved or abs(m.vx) + abs(m.vy) + abs(m.ax) + abs(m.ay) > REST
            if moves and not (disc and m.curved and abs(m.v) + abs(m.v + m.a * h) <= REST):
                for k in range(len(rows)):
                    if not _stays_clear(m, t, h, body, rows[k]):
                        return False
                if meets_wall(m, h, body.corners, body.rounding + margin, body.radius + margin, robot.walls) < math.inf:
                    return False
            x, y, theta, _, _, _ = pose(m, h)
            a, b = a1, b1
            t += h
            left -= h
    return True


@bare_kernel
def _stop_for(
    x: float,
    y: float,
    theta: float,
    a: float,
    b: float,
    ca: float,
    cb: float,
    robot: Robot,
    margin: float,
    rows: NDArray[np.float64],
    keep: NDArray[np.float64],
) -> bool:
    """Find a stop that certifies the command (ca, cb) and keep it: turn rate to 0, held, full left, full right.

    `keep` is float64[3], changed where one is found.
    """
    limits = robot.limits
    if limits.drive == HOLONOMIC:
        if certified(x, y, theta, a, b, ca, cb, 0.0, 0, robot, margin, rows):
            keep[TURN], keep[CYCLES] = 0.0, 0.0
            return True
        return False
    _, _, _, v, w = drive_roughly(x, y, theta, a, b, ca, cb, limits, robot.dt)
    cycles = math.ceil(abs(v) / (limits.brake_max * robot.dt) - 1e-9) if abs(v) > REST else 0
    for kind in range(4 if cycles > 0 else 1):
        turn = 0.0
        if kind == 1:
            turn = w
        elif kind > 1:
            turn = limits.turn_rate if kind == 2 else -limits.turn_rate
        if kind == 1 and abs(w) < 0.01:
            continue
        count = cycles if kind > 0 else 0
        if certified(x, y, theta, a, b, ca, cb, turn, count, robot, margin, rows):
            keep[TURN], keep[CYCLES] = turn, float(count)
            return True
    return False


@bare_kernel
def nearby(x: float, y: float, speed: float, robot: Robot, tracks: NDArray[np.float64], rows: NDArray[np.float64]) -> int:
    """Copy to `rows` the obstacles that a manoeuvre of one cycle and a stop could come near; return how many."""
    limits, n = robot.limits, 0
    accelerates = limits.a_max < math.inf
    fastest = min(speed + limits.a_max * robot.dt, limits.v_max) if accelerates else limits.v_max
    if limits.drive != HOLONOMIC:
        fastest = max(fastest, min(limits.v_reverse, limits.a_max * robot.dt if accelerates else limits.v_reverse))
    stop = fastest / limits.brake_max if limits.brake_max < math.inf else 0.0
    turning = limits.turn_rate / limits.alpha_max if len(robot.body.corners) > 1 and limits.alpha_max < math.inf else 0.0
    time = limits.latency + 2.0 * robot.dt + max(stop, turning) + turning
    far = fastest * (robot.dt + stop) + robot.body.radius + 0.01
    for k in range(len(tracks)):
        away = math.hypot(tracks[k, X] - x, tracks[k, Y] - y) - tracks[k, RADIUS]
        if away - tracks[k, SPEED] * (tracks[k, AGE] + time) <= far:
            for j in range(8):
                rows[n, j] = tracks[k, j]
            n += 1
    return n


@bare_kernel
def first_touch(x: float, y: float, tracks: NDArray[np.float64], radius: float) -> float:
    """Earliest contact in s of a disc that stands at (x, y) with a track that keeps its velocity; infinite if none."""
    earliest = math.inf
    for k in range(len(tracks)):
        vx, vy = tracks[k, VX], tracks[k, VY]
        ax, ay = tracks[k, X] + vx * tracks[k, AGE] - x, tracks[k, Y] + vy * tracks[k, AGE] - y
        contact_radius = radius + tracks[k, RADIUS]
        closing = ax * vx + ay * vy
        apart = ax * ax + ay * ay - contact_radius * contact_radius
        vv = vx * vx + vy * vy
        root = closing * closing - vv * apart
        if apart <= 0.0:
            return 0.0
        if closing < 0.0 and root > 0.0:
            earliest = min(earliest, apart / (-closing + math.sqrt(root)))
    return earliest


@bare_kernel
def _safe_for(
    x: float,
    y: float,
    theta: float,
    a: float,
    b: float,
    ca: float,
    cb: float,
    robot: Robot,
    tracks: NDArray[np.float64],
    until: float,
    horizon: float,
) -> float:
    """How long in s, at most `horizon`, a robot touches no track that keeps its velocity, if it drives so and then stands.

    It drives under the command for `until` s, or to a wall, and stands from there; looked at in steps of a control cycle.
    """
    limits, radius = robot.limits, robot.body.radius
    t = limits.latency
    standing = False
    while t < horizon:
        if not standing:
            if t > until:
                ca, cb = 0.0, 0.0
            x1, y1, theta1, a1, b1 = drive_roughly(x, y, theta, a, b, ca, cb, limits, robot.dt)
            if free_distance(robot.walls, x1, y1) < radius and math.hypot(x1 - x, y1 - y) > TOUCH:
                standing = True
            else:
                x, y, theta, a, b = x1, y1, theta1, a1, b1
                standing = t > until and math.hypot(a, b) <= REST
        t += robot.dt
        for k in range(len(tracks)):
            later = t + tracks[k, AGE]
            dx, dy = tracks[k, X] + tracks[k, VX] * later - x, tracks[k, Y] + tracks[k, VY] * later - y
            if math.hypot(dx, dy) < radius + tracks[k, RADIUS]:
                return t
    return horizon


@bare_kernel
def _aside(
    x: float,
    y: float,
    theta: float,
    a: float,
    b: float,
    robot: Robot,
    margin: float,
    tracks: NDArray[np.float64],
    rows: NDArray[np.float64],
    lookahead: float,
    keep: NDArray[np.float64],
) -> tuple[float, float, bool]:
    """Command that steps aside for a track that would touch the robot where it stands; whether there is one.

    Arcs forward and backward, or all directions without wheels; what is kept longest from contact is taken, if it can be
    certified, and the side taken last counts for a little more.
    """
    limits = robot.limits
    wheels = limits.drive != HOLONOMIC
    still = first_touch(x, y, tracks, robot.body.radius)
    if still > lookahead:
        return 0.0, 0.0, False
    horizon = 2.0 * lookahead
    best, one, two, chosen = still + robot.dt, 0.0, 0.0, -1.0
    count = _SPEEDS * _TURNS if wheels else _SIDES
    for k in range(count):
        if wheels:
            speed = (limits.v_max, 0.4 * limits.v_max, -limits.v_reverse)[k // _TURNS]
            turn = limits.turn_rate * (k % _TURNS - _TURNS // 2) / (_TURNS // 2)
            if speed == 0.0:
                continue
            ca, cb = speed, turn
        else:
            ca, cb = limits.v_max * math.cos(2.0 * math.pi * k / _SIDES), limits.v_max * math.sin(2.0 * math.pi * k / _SIDES)
        worth = _safe_for(x, y, theta, a, b, ca, cb, robot, tracks, 0.6 * lookahead, horizon)
        if keep[SIDE] == k:
            worth += _KEEP
        if worth > best and _stop_for(x, y, theta, a, b, ca, cb, robot, margin, rows, keep):
            best, one, two, chosen = worth, ca, cb, float(k)
    if chosen < 0.0:
        return 0.0, 0.0, False
    _stop_for(x, y, theta, a, b, one, two, robot, margin, rows, keep)  # the last one certified need not be the best
    keep[SIDE] = chosen
    return one, two, True


@bare_kernel
def margin_left(x: float, y: float, theta: float, robot: Robot) -> float:
    """Margin to walls that a robot at rest there has left, at most `robot.margin`, at least 0."""
    low, high = 0.0, robot.margin
    if free_distance(robot.walls, x, y) >= robot.body.radius + robot.margin:
        return robot.margin
    for _ in range(6):
        middle = 0.5 * (low + high)
        if _clear_of_walls(x, y, theta, robot, middle):
            low = middle
        else:
            high = middle
    return low if low < high or low > 0.0 else 0.0


@bare_kernel
def _clear_of_walls(x: float, y: float, theta: float, robot: Robot, margin: float) -> bool:
    """Tell whether the body, wider by the margin, touches no wall where it stands: nothing it creeps towards is met at once."""
    for side in range(4):
        ux, uy = ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))[side]
        m = Segment(False, x, y, theta, 1e-6 * ux, 1e-6 * uy, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if meets_wall(m, 1e-3, robot.body.corners, robot.body.rounding + margin, robot.body.radius + margin, robot.walls) < 1.0:
            return False
    return True


@bare_kernel
def passed_command(
    x: float,
    y: float,
    theta: float,
    a: float,
    b: float,
    ca: float,
    cb: float,
    tracks: NDArray[np.float64],
    rows: NDArray[np.float64],
    robot: Robot,
    lookahead: float,
    keep: NDArray[np.float64],
) -> tuple[float, float, int]:
    """Return the command that passes and what was done to it.

    Parameters
    ----------
    x, y, theta, a, b : float
        State of the robot when the command begins to act.
    ca, cb : float
        The command; not finite means stop.
    tracks, rows : float64[K, 8], float64[>= K, 8]
        All obstacles known, and free_distance for those that are near.
    lookahead : float
        For what would touch a robot at rest within so long it steps aside, s.
    keep : float64[3]
        The guard's state from cycle to cycle: the certified stop and the side taken.
    """
    limits = robot.limits
    wheels = limits.drive != HOLONOMIC
    ca, cb = clip_twist(ca, cb, limits) if wheels else clip_velocity(ca, cb, limits)
    near = rows[: nearby(x, y, abs(a) if wheels else math.hypot(a, b), robot, tracks, rows)]
    margin = margin_left(x, y, theta, robot)
    asked = abs(ca) if wheels else math.hypot(ca, cb)
    if asked > REST and _stop_for(x, y, theta, a, b, ca, cb, robot, margin, near, keep):
        keep[SIDE] = -1.0
        return ca, cb, FREE
    if asked > REST:
        for k in range(_FRACTIONS - 1, -1 if wheels else 0, -1):
            share = k / _FRACTIONS
            for kind in range(2 if wheels and abs(cb) > 0.01 and k > 0 else 1):
                one, two = ca * share, cb * share if kind == 1 or not wheels else cb
                if _stop_for(x, y, theta, a, b, one, two, robot, margin, near, keep):
                    if abs(one) <= REST and wheels:
                        oa, ob, stepped = _aside(x, y, theta, a, b, robot, margin, tracks, near, lookahead, keep)
                        if stepped:
                            return oa, ob, STEPPED_ASIDE
                        _stop_for(x, y, theta, a, b, one, two, robot, margin, near, keep)
                    return one, two, SLOWED
    one, two, stepped = _aside(x, y, theta, a, b, robot, margin, tracks, near, lookahead, keep)
    if stepped:
        return one, two, STEPPED_ASIDE
    if asked <= REST and _stop_for(x, y, theta, a, b, ca, cb, robot, margin, near, keep):
        return ca, cb, FREE
    if _stop_for(x, y, theta, a, b, 0.0, 0.0, robot, margin, near, keep):
        return 0.0, 0.0, BRAKED
    return fallback(keep, wheels)


@bare_kernel
def first_certified(
    x: float,
    y: float,
    theta: float,
    a: float,
    b: float,
    commands: NDArray[np.float64],
    tracks: NDArray[np.float64],
    rows: NDArray[np.float64],
    robot: Robot,
    keep: NDArray[np.float64],
) -> int:
    """Return the first of `commands`, float64[N, 2], that passes as it is, or 0; else as `passed_command`."""
    wheels = robot.limits.drive != HOLONOMIC
    near = rows[: nearby(x, y, abs(a) if wheels else math.hypot(a, b), robot, tracks, rows)]
    margin = margin_left(x, y, theta, robot)
    for i in range(len(commands)):
        if wheels:
            ca, cb = clip_twist(commands[i, 0], commands[i, 1], robot.limits)
        else:
            ca, cb = clip_velocity(commands[i, 0], commands[i, 1], robot.limits)
        if _stop_for(x, y, theta, a, b, ca, cb, robot, margin, near, keep):
            return i
    return 0


@bare_kernel
def fallback(keep: NDArray[np.float64], wheels: bool) -> tuple[float, float, int]:
    """Return the next command of the stop kept, which was certified when it was taken."""
    if wheels and keep[CYCLES] > 0.0:
        keep[CYCLES] -= 1.0
        return 0.0, keep[TURN], BRAKED
    return 0.0, 0.0, BRAKED


@bare_kernel
def when_it_acts(
    x: float,
    y: float,
    theta: float,
    vx: float,
    vy: float,
    turn_rate: float,
    pending: NDArray[np.float64],
    robot: Robot,
) -> tuple[float, float, float, float, float]:
    """State of the robot when a command given now begins to act."""
    limits = robot.limits
    a, b = vx, vy
    if limits.drive != HOLONOMIC:
        a, b = vx * math.cos(theta) + vy * math.sin(theta), turn_rate
    left = limits.latency
    for i in range(len(pending)):
        h = left - (len(pending) - 1 - i) * robot.dt
        x, y, pointing, a, b = drive_cycle(x, y, theta, a, b, pending[i, 0], pending[i, 1], limits, h)
        if limits.drive != HOLONOMIC:
            theta = pointing  # without wheels a footprint keeps its heading, and a disc's does not matter
        left -= h
    return x, y, theta, a, b
