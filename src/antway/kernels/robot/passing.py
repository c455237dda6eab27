"""The command that passes the guard of a robot with inertia.

It is the command as given, the same command slower, a step aside, or the certified stop.
"""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import TOUCH, free_distance
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import HOLONOMIC, RobotState
from antway.kernels.robot.brake import BEND_A, BEND_B, CYCLES, SIDE, STRAIGHT, Robot, Situation, situation_of, stop_for
from antway.kernels.robot.guard import BRAKED, FREE, LEAST_HARM, SLOWED, STEPPED_ASIDE, time_to_contact
from antway.kernels.robot.motion import REST, clipped, drive_roughly
from antway.kernels.robot.reach import AGE, RADIUS, VX, VY, X, Y

_FRACTIONS = 5  # number of speeds tried below the commanded one
_SPEEDS = 3  # number of speeds tried for a step aside on wheels
_SLOW = 0.4  # share of the full speed of the slower ones forward
_TURNS = 5  # number of turn rates tried with each of these speeds
_SIDES = 16  # number of directions tried for a step aside without wheels
_KEEP = 0.3  # s; the value of a step aside grows by this if it keeps to the side taken last
_DRIVES = 0.6  # share of the time looked ahead for which a robot drives when it steps aside, before it stands


@bare_kernel
def _safe_for(state: RobotState, ca: float, cb: float, robot: Robot, tracks: Floats, until: float, horizon: float) -> float:
    """Return the time of the robot's first contact with any track if all tracks keep their velocities, s, at most `horizon`.

    The robot drives under the command (ca, cb) for `until` s, or up to a wall, and then stands. Contacts are tested once in a
    control cycle.
    """
    radius = robot.body.radius
    t = robot.limits.latency
    standing = False
    while t < horizon:
        if not standing:
            if t > until:
                ca, cb = 0.0, 0.0
            later = drive_roughly(state, ca, cb, robot.limits, robot.dt)
            moved = math.hypot(later.x - state.x, later.y - state.y)
            if free_distance(robot.walls, later.x, later.y) < radius and moved > TOUCH:
                standing = True
            else:
                state = later
                standing = t > until and math.hypot(state.a, state.b) <= REST
        t += robot.dt
        for k in range(len(tracks)):
            age = t + tracks[k, AGE]
            dx, dy = tracks[k, X] + tracks[k, VX] * age - state.x, tracks[k, Y] + tracks[k, VY] * age - state.y
            if math.hypot(dx, dy) < radius + tracks[k, RADIUS]:
                return t
    return horizon


@bare_kernel
def _aside(situation: Situation, tracks: Floats, lookahead: float) -> tuple[float, float, bool]:
    """Return a command that steps aside for a track that would touch the standing robot, and whether there is one.

    Wheels try arcs forward and backward; other robots try all directions. Of the commands that can be certified, the one whose
    first contact comes latest is taken. The side taken last is preferred a little, so that the robot does not sway.
    """
    state, robot = situation.state, situation.robot
    limits, keep = robot.limits, robot.keep
    wheels = limits.drive != HOLONOMIC
    still = time_to_contact(state.x, state.y, tracks, robot.body.radius)
    if still > lookahead:
        return 0.0, 0.0, False
    best, one, two, chosen = still + robot.dt, 0.0, 0.0, -1.0
    for k in range(_SPEEDS * _TURNS if wheels else _SIDES):
        if wheels:
            ca = (limits.v_max, _SLOW * limits.v_max, -limits.v_reverse)[k // _TURNS]
            cb = limits.turn_rate * (k % _TURNS - _TURNS // 2) / (_TURNS // 2)
            if ca == 0.0:
                continue
        else:
            ca, cb = limits.v_max * math.cos(2.0 * math.pi * k / _SIDES), limits.v_max * math.sin(2.0 * math.pi * k / _SIDES)
        worth = _safe_for(state, ca, cb, robot, tracks, _DRIVES * lookahead, 2.0 * lookahead)
        if keep[SIDE] == k:
            worth += _KEEP
        if worth > best and stop_for(situation, ca, cb):
            best, one, two, chosen = worth, ca, cb, float(k)
    if chosen < 0.0:
        return 0.0, 0.0, False
    keep[SIDE] = chosen
    return one, two, True


@bare_kernel
def _slower(situation: Situation, ca: float, cb: float) -> tuple[float, float, bool]:
    """Return the fastest of the slower commands that is certified, and whether there is one.

    Wheels keep the commanded turn rate or else the commanded arc, and at last only turn, if they can turn in place.
    """
    wheels = situation.robot.limits.drive != HOLONOMIC
    turns = wheels and situation.robot.limits.turning_radius == 0.0
    for k in range(_FRACTIONS - 1, -1 if turns else 0, -1):
        share = k / _FRACTIONS
        for kind in range(2 if wheels and abs(cb) > STRAIGHT and k > 0 else 1):
            one, two = ca * share, cb if wheels and kind == 0 else cb * share
            if stop_for(situation, one, two):
                return one, two, True
    return 0.0, 0.0, False


@bare_kernel
def passed_command(
    state: RobotState, ca: float, cb: float, tracks: Floats, robot: Robot, lookahead: float
) -> tuple[float, float, int]:
    """Return the command that passes the guard, and what the guard did (FREE and the others).

    `state` is that of the robot when the command begins to act. A command (ca, cb) that is not finite means stop. The robot
    steps aside if one of `tracks` (kernels/robot/reach.py) would touch it at rest within `lookahead` s.
    """
    wheels = robot.limits.drive != HOLONOMIC
    ca, cb = clipped(ca, cb, robot.limits)
    situation = situation_of(state, robot, tracks)
    aside = situation if robot.strict else Situation(state, robot, situation.margin, situation.near[:0])
    moves = (abs(ca) if wheels else math.hypot(ca, cb)) > REST
    one, two, slowed = 0.0, 0.0, False
    if moves:
        if stop_for(situation, ca, cb):
            robot.keep[SIDE] = -1.0
            return ca, cb, FREE
        one, two, slowed = _slower(situation, ca, cb)
        if slowed and not (wheels and abs(one) <= REST):
            return one, two, SLOWED
    side_a, side_b, stepped = _aside(aside, tracks, lookahead)
    if stepped:
        return side_a, side_b, STEPPED_ASIDE
    if slowed:
        return one, two, SLOWED
    if not moves and stop_for(situation, ca, cb):
        return ca, cb, FREE
    if stop_for(situation, 0.0, 0.0):
        return 0.0, 0.0, BRAKED
    return fallback(robot.keep)


@bare_kernel
def passed_among(
    state: RobotState, commands: Floats, tracks: Floats, robot: Robot, lookahead: float
) -> tuple[float, float, int]:
    """Do as `passed_command`, but with the first of `commands`, float64[N, 2], that passes unchanged, if one does.

    Whoever gives several commands has weighed contacts. So if `robot.strict` is false, only walls count then; what was done is
    LEAST_HARM if the command would not pass among the obstacles.
    """
    if len(commands) == 1:
        return passed_command(state, commands[0, 0], commands[0, 1], tracks, robot, lookahead)
    counted, ahead = (tracks, lookahead) if robot.strict else (tracks[:0], 0.0)
    situation, i = situation_of(state, robot, counted), 0
    while i < len(commands) and not stop_for(situation, *clipped(commands[i, 0], commands[i, 1], robot.limits)):
        i += 1
    i = i if i < len(commands) else 0  # the first one, if none passes unchanged
    one, two, did = passed_command(state, commands[i, 0], commands[i, 1], counted, robot, ahead)
    if did == FREE and not robot.strict and not stop_for(situation_of(state, robot, tracks), one, two):
        did = LEAST_HARM
    return one, two, did


@bare_kernel
def fallback(keep: Floats) -> tuple[float, float, int]:
    """Return the next command of the kept stop, which was certified when its command was given."""
    if keep[CYCLES] > 0.0:
        keep[CYCLES] -= 1.0
        return keep[BEND_A], keep[BEND_B], BRAKED
    return 0.0, 0.0, BRAKED
