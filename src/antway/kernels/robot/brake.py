"""The guard for robots with inertia: after a command, is there a manoeuvre that surely stops the robot without contact?

A manoeuvre is one control cycle of the command, then a bend for some cycles, then braking along a straight line. In a bend
wheels brake with some turn rate; a holonomic robot brakes along one axis of the map and keeps its speed along the other, such
as that along a wall. The manoeuvre is certified if the true path of the footprint (ramps, arcs) keeps a margin to walls and out
of every place that an obstacle can reach by that time (kernels/robot/reach.py). What an obstacle can reach by a given time
shrinks with each observation, so a certified manoeuvre stays certified: the guard keeps the last one and falls back on it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base.arrays import Bools, Floats
from antway.kernels.base.geometry import TOUCH, free_distance
from antway.kernels.base.jit import bare_kernel, inner_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState, Walls
from antway.kernels.base.rows import copy_row
from antway.kernels.robot.cycle import next_segment
from antway.kernels.robot.motion import REST, drive_roughly
from antway.kernels.robot.reach import ACCEL, AGE, RADIUS, SPEED, VX, VY, X, Y
from antway.kernels.robot.sweep import DIRECTIONS, Body, Segment, axis_gap, disc_axis, enlarged, meets_wall, pose, straight

# Entries of the guard's state: the command in the bend of the kept stop, the cycles left of it, and the last side taken.
BEND_A, BEND_B, CYCLES, SIDE = range(4)
BENT = math.sqrt(2.0)  # 1; without wheels a stop takes up to this times as long, as it may brake along one axis after the other
STRAIGHT = 0.01  # rad/s, m/s; a smaller turn rate or speed along an axis counts as none
_SLACK = 0.01  # m; obstacles beyond the farthest place of a manoeuvre by more than this are left out
_CLOSE = 1e-12  # m; a smaller gap is a contact
_IN_WALL = 1e-3  # m; a body that is deeper in a wall than this is so because its place or the map is wrong
DEEPEST = 0.3  # 1; it may get out again if it is no deeper than this share of its radius
_LEAST = 1e-9  # s; the shortest step of conservative advancement
_APART, _RINGS = 0.05, 8  # m, 1; distance and number of rings of places at which a body is tried
_HEADINGS = 72  # number of headings in which it is tried


class Robot(NamedTuple):
    """What the guard knows about the robot and its map, and what it keeps from cycle to cycle."""

    limits: RobotLimits
    body: Body
    walls: Walls
    dt: float  # s
    margin: float  # m; distance kept from walls
    strict: bool  # whether steps aside are certified against obstacles too, not only against walls
    rows: Floats  # float64[N, 8]; scratch memory for the obstacles that are near, at least as many as there are
    keep: Floats  # float64[4]; the guard's state from cycle to cycle: the certified stop and the last side taken


class Situation(NamedTuple):
    """Everything by which a command is certified."""

    state: RobotState  # of the robot when the command begins to act, one latency from now
    robot: Robot
    margin: float  # m; distance kept from walls: `robot.margin`, or what is left of it; below 0 as deep as the robot is in one
    near: Floats  # float64[N, 8]; the obstacles that are near enough to matter, as in kernels/robot/reach.py


@bare_kernel
def _stays_clear(m: Segment, t: float, h: float, body: Body, row: Floats) -> bool:
    """Tell whether the body, on a segment that begins t s from now, stays out of every place where one obstacle can be.

    The obstacle is in a disc around its last place that grows with its speed, and also in a disc that moves with its last
    velocity and grows with its acceleration. So it is enough if the body is outside one of them at each time. A row of negative
    age is of places that the obstacle cannot reach before that time.
    """
    s = max(0.0, -row[AGE] - t)
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


@inner_kernel
def _segment_is_clear(m: Segment, t: float, h: float, situation: Situation) -> bool:
    """Tell whether the body, on a segment of `h` s that begins t s from now, keeps clear of obstacles and walls."""
    body = situation.robot.body
    for k in range(len(situation.near)):
        if not _stays_clear(m, t, h, body, situation.near[k]):
            return False
    return meets_wall(m, h, enlarged(body, situation.margin), situation.robot.walls) == math.inf


@bare_kernel
def certified(situation: Situation, ca: float, cb: float, bend_a: float, bend_b: float, cycles: int) -> bool:
    """Tell whether the command (ca, cb) is certified together with the stop that follows it.

    The stop is the command (bend_a, bend_b) for `cycles` cycles, then (0, 0).
    """
    state, robot = situation.state, situation.robot
    limits, t = robot.limits, robot.limits.latency
    holonomic, disc = limits.drive == HOLONOMIC, len(robot.body.corners) == 1
    for phase in range(3):  # the command, the bend of the stop, its straight end
        left = (robot.dt, cycles * robot.dt, math.inf)[phase]
        one, two = ((ca, cb), (bend_a, bend_b), (0.0, 0.0))[phase]
        while left > 0.0:
            if phase > 0:
                turn_ends = disc or (phase == 2 and abs(state.b) <= REST)  # a disc may go on turning in place
                if math.hypot(state.a, state.b) <= REST if holonomic else abs(state.a) <= REST and turn_ends:
                    return True
            m, h, a, b = next_segment(state, one, two, limits, min(left, 3600.0))
            moves = m.curved or abs(m.vx) + abs(m.vy) + abs(m.ax) + abs(m.ay) > REST
            turns_in_place = disc and m.curved and abs(m.v) + abs(m.v + m.a * h) <= REST
            if moves and not turns_in_place and not _segment_is_clear(m, t, h, situation):
                return False
            end = pose(m, h)
            state = RobotState(end.x, end.y, end.theta, a, b)
            t += h
            left -= h
    return True


@bare_kernel
def stop_for(situation: Situation, ca: float, cb: float) -> bool:
    """Tell whether some stop certifies the command (ca, cb), and keep that stop in `robot.keep`.

    The stops tried have no bend; or wheels brake with the present turn rate, full left and full right, and a holonomic robot
    brakes first across the map's axis along which it is faster, or across the other one.
    """
    robot = situation.robot
    limits, keep = robot.limits, robot.keep
    if certified(situation, ca, cb, 0.0, 0.0, 0):
        keep[BEND_A], keep[BEND_B], keep[CYCLES] = 0.0, 0.0, 0.0
        return True
    _, _, _, a, b = drive_roughly(situation.state, ca, cb, limits, robot.dt)
    holonomic = limits.drive == HOLONOMIC
    for kind in range(2 if holonomic else 3):
        if holonomic:
            along_x = (abs(a) > abs(b)) == (kind == 0)
            bend_a, bend_b, lost = (a, 0.0, abs(b)) if along_x else (0.0, b, abs(a))
            if min(abs(a), abs(b)) < STRAIGHT:
                continue
        else:
            bend_a, bend_b, lost = 0.0, (b, limits.turn_rate, -limits.turn_rate)[kind], abs(a)
            if lost <= REST or abs(bend_b) < STRAIGHT:
                continue
        cycles = math.ceil(lost / (limits.brake_max * robot.dt) - 1e-9)
        if cycles > 0 and certified(situation, ca, cb, bend_a, bend_b, cycles):
            keep[BEND_A], keep[BEND_B], keep[CYCLES] = bend_a, bend_b, float(cycles)
            return True
    return False


@bare_kernel
def situation_of(state: RobotState, robot: Robot, tracks: Floats) -> Situation:
    """Return the robot's situation among all known obstacles."""
    return Situation(state, robot, _margin_left(state, robot), robot.rows[: _nearby(state, robot, tracks)])


@bare_kernel
def _nearby(state: RobotState, robot: Robot, tracks: Floats) -> int:
    """Copy the obstacles that a cycle and a stop could come near to `robot.rows`; return how many there are."""
    (x, y, _, a, b), limits, n = state, robot.limits, 0
    holonomic = limits.drive == HOLONOMIC
    speed = math.hypot(a, b) if holonomic else abs(a)
    fastest = max(speed, min(speed + limits.a_max * robot.dt, limits.v_max))
    stop = fastest / limits.brake_max if limits.brake_max < math.inf else 0.0
    spin = limits.turn_rate if holonomic else max(limits.turn_rate, abs(b))
    turning = spin / limits.alpha_max if len(robot.body.corners) > 1 and limits.alpha_max < math.inf else 0.0
    time = limits.latency + 2.0 * robot.dt + max(BENT * stop if holonomic else stop, turning) + turning
    far = fastest * (2.0 * robot.dt + stop) + robot.body.radius + _SLACK
    for k in range(len(tracks)):
        away = math.hypot(tracks[k, X] - x, tracks[k, Y] - y) - tracks[k, RADIUS]
        if away - tracks[k, SPEED] * (tracks[k, AGE] + time) <= far:
            copy_row(tracks[k], robot.rows[n])
            n += 1
    return n


@bare_kernel
def _margin_left(state: RobotState, robot: Robot) -> float:
    """Return the distance to walls that a robot at rest has, at most `robot.margin`, m.

    It is below 0 if the robot is in a wall on the map, and then says how deep: the robot may move on, but get no deeper.
    """
    if free_distance(robot.walls, state.x, state.y) >= robot.body.radius + robot.margin:
        return robot.margin
    low, high, halvings = 0.0, robot.margin, 6
    if not _clear_of_walls(state, enlarged(robot.body, -_IN_WALL), robot.walls):
        low, high, halvings = -DEEPEST * robot.body.radius, -_IN_WALL, 20
    for _ in range(halvings):
        middle = 0.5 * (low + high)
        if _clear_of_walls(state, enlarged(robot.body, middle), robot.walls):
            low = middle
        else:
            high = middle
    return low


@bare_kernel
def _clear_of_walls(state: RobotState, body: Body, walls: Walls) -> bool:
    """Tell whether the body touches no wall: creeping in any direction meets none at once."""
    for side in range(4):
        ux, uy = DIRECTIONS[side]
        m = straight(state.x, state.y, state.theta, 1e-6 * ux, 1e-6 * uy, 0.0, 0.0)
        if meets_wall(m, 1e-3, body, walls) < 1.0:
            return False
    return True


@bare_kernel
def fits_near(x: float, y: float, far: float, body: Body, walls: Walls) -> bool:
    """Tell whether the body fits between the walls in some heading at most `far` m from (x, y).

    It is tried in 72 headings at (x, y) and at places at most 5 cm apart, or an eighth of `far` if that is more.
    """
    rings = min(max(math.ceil(far / _APART), 1), _RINGS)
    for ring in range(rings + 1):
        for i in range(max(6 * ring, 1)):
            angle, away = math.pi * i / max(3 * ring, 1), far * ring / rings
            px, py = x + away * math.cos(angle), y + away * math.sin(angle)
            for k in range(_HEADINGS):
                state = RobotState(px, py, 2.0 * math.pi * k / _HEADINGS, 0.0, 0.0)
                if _clear_of_walls(state, body, walls):
                    return True
    return False


@bare_kernel
def fits_at(x0: float, y0: float, step: float, heading: float, body: Body, walls: Walls, fits: Bools) -> None:
    """Write for places in rows and columns `step` m apart, from (x0, y0) on, whether the body fits there in this heading."""
    for row in range(fits.shape[0]):
        for col in range(fits.shape[1]):
            state = RobotState(x0 + col * step, y0 + row * step, heading, 0.0, 0.0)
            far = free_distance(walls, state.x, state.y) >= body.radius
            fits[row, col] = far or _clear_of_walls(state, body, walls)
