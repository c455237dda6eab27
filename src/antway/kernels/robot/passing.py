"""Which command of a robot with inertia passes its guard: as it is, slower, a step aside, or the stop that is certified."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import TOUCH
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import HOLONOMIC
from antway.kernels.robot.brake import CYCLES, SIDE, TURN, Robot, margin_left, nearby, stop_for
from antway.kernels.robot.motion import REST, clip_twist, clip_velocity, drive_cycle, drive_roughly
from antway.kernels.robot.reach import AGE, RADIUS, VX, VY, X, Y
from antway.kernels.robot.sweep import free_distance

FREE, SLOWED, BRAKED, STEPPED_ASIDE = 0, 1, 2, 3  # what the guard did
_FRACTIONS = 5  # parts of the commanded speed tried
_SPEEDS, _TURNS = 3, 5  # arcs tried for a step aside
_SIDES = 16  # directions tried for one, without wheels
_KEEP = 0.3  # s; what it is worth to keep to the side taken


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
        if worth > best and stop_for(x, y, theta, a, b, ca, cb, robot, margin, rows, keep):
            best, one, two, chosen = worth, ca, cb, float(k)
    if chosen < 0.0:
        return 0.0, 0.0, False
    stop_for(x, y, theta, a, b, one, two, robot, margin, rows, keep)  # the last one certified need not be the best
    keep[SIDE] = chosen
    return one, two, True


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
    near = rows[: nearby(x, y, a, b, robot, tracks, rows)]
    free = near if robot.strict else near[:0]
    margin = margin_left(x, y, theta, robot)
    asked = abs(ca) if wheels else math.hypot(ca, cb)
    if asked > REST and stop_for(x, y, theta, a, b, ca, cb, robot, margin, near, keep):
        keep[SIDE] = -1.0
        return ca, cb, FREE
    if asked > REST:
        for k in range(_FRACTIONS - 1, -1 if wheels else 0, -1):
            share = k / _FRACTIONS
            for kind in range(2 if wheels and abs(cb) > 0.01 and k > 0 else 1):
                one, two = ca * share, cb * share if kind == 1 or not wheels else cb
                if stop_for(x, y, theta, a, b, one, two, robot, margin, near, keep):
                    if abs(one) <= REST and wheels:
                        oa, ob, stepped = _aside(x, y, theta, a, b, robot, margin, tracks, free, lookahead, keep)
                        if stepped:
                            return oa, ob, STEPPED_ASIDE
                        stop_for(x, y, theta, a, b, one, two, robot, margin, near, keep)
                    return one, two, SLOWED
    one, two, stepped = _aside(x, y, theta, a, b, robot, margin, tracks, free, lookahead, keep)
    if stepped:
        return one, two, STEPPED_ASIDE
    if asked <= REST and stop_for(x, y, theta, a, b, ca, cb, robot, margin, near, keep):
        return ca, cb, FREE
    if stop_for(x, y, theta, a, b, 0.0, 0.0, robot, margin, near, keep):
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
    near = rows[: nearby(x, y, a, b, robot, tracks, rows)]
    margin = margin_left(x, y, theta, robot)
    for i in range(len(commands)):
        if wheels:
            ca, cb = clip_twist(commands[i, 0], commands[i, 1], robot.limits)
        else:
            ca, cb = clip_velocity(commands[i, 0], commands[i, 1], robot.limits)
        if stop_for(x, y, theta, a, b, ca, cb, robot, margin, near, keep):
            return i
    return 0


@bare_kernel
def passes(
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
    keep: NDArray[np.float64],
) -> bool:
    """Tell whether a command within the robot's limits passes as it is; parameters as in `passed_command`."""
    near = rows[: nearby(x, y, a, b, robot, tracks, rows)]
    return stop_for(x, y, theta, a, b, ca, cb, robot, margin_left(x, y, theta, robot), near, keep)


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
