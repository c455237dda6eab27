"""The guard: can the robot brake to a stand without entering any place that an obstacle can reach by then?"""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base.arrays import Floats, Ints
from antway.kernels.base.geometry import TOUCH, leads_clear, swept_discs, wall_ahead, wrap
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import DIFFERENTIAL, RobotLimits, RobotState, Terrain
from antway.kernels.base.rows import copy_row
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.harm import least_harm
from antway.kernels.robot.reach import ACCEL, AGE, RADIUS, SPEED, VX, VY, X, Y, reach_gap_along
from antway.limits import MAX_ANGLE, MAX_PLACE, MAX_SPEED

FREE, SLOWED, BRAKED, STEPPED_ASIDE, LEAST_HARM = 0, 1, 2, 3, 4  # what the guard did
SOUND, BAD_ROBOT, BAD_PLACE, BAD_VELOCITY, BAD_RADIUS, SAME_ID = range(6)  # results of `fault`
_FRACTIONS = 10  # number of speeds tried in the commanded direction
_SIDES = 16  # number of directions tried for a step aside
_LEARNS = 0.01  # 1; share by which, in each control cycle, the learnt speed bound moves towards the fastest speed seen
# Columns of the table of recent tracks. _SEEN is a time in s; _SPEED is -1 if unknown. The next two are the largest values
# observed: the speed and its growth. _ERROR is that of the latest speed, m/s.
_ID, _SEEN, _X, _Y, _VX, _VY, _RADIUS, _SPEED, _FASTEST, _GROWTH, _ERROR = range(11)
TABLE_COLUMNS, TRACK_SPEED = 11, _SPEED

# Entries of the bounds on obstacles: the speed in m/s; the growth of the speed and the change of the velocity vector in m/s^2;
# a speed in m/s learnt from all obstacles, which any of them may have; and the time in s after which the robot stands.
BOUND_SPEED, BOUND_GROWTH, BOUND_CHANGE, BOUND_KIND, STOPPING_TIME = range(5)


class Rules(NamedTuple):
    """How the guard decides, for which robot and on which map."""

    limits: RobotLimits
    terrain: Terrain
    dt: float  # s; control period
    lookahead: float  # s; a standing robot steps aside if an obstacle would touch it within this time
    strict: bool  # whether only commands that are certain to be safe pass


@kernel
def fault(
    x: float, y: float, vx: float, vy: float, heading: float, track_id: Ints, xy: Floats, velocity: Floats, radius: Floats
) -> int:
    """Return what is wrong with the robot's state or a scan of K tracks.

    SAME_ID means that two tracks have the same id, compared as floats because tables of tracks hold floats. BAD_ROBOT and
    the others say what is beyond the limits of `antway.limits`. A radius must not be negative; a velocity may be NaN (unknown).
    """
    placed = abs(x) <= MAX_PLACE and abs(y) <= MAX_PLACE and abs(heading) <= MAX_ANGLE
    if not (placed and math.hypot(vx, vy) <= MAX_SPEED):
        return BAD_ROBOT
    sorted_ids = True
    for k in range(len(radius)):
        if not (abs(xy[k, 0]) <= MAX_PLACE and abs(xy[k, 1]) <= MAX_PLACE):
            return BAD_PLACE
        if math.hypot(velocity[k, 0], velocity[k, 1]) > MAX_SPEED:
            return BAD_VELOCITY
        if not 0.0 <= radius[k] <= MAX_PLACE:
            return BAD_RADIUS
        if k > 0 and float(track_id[k]) <= float(track_id[k - 1]):
            sorted_ids = False
    for k in range(0 if sorted_ids else len(track_id)):
        for i in range(k if track_id[k] >= 0 else 0):
            if float(track_id[i]) == float(track_id[k]):
                return SAME_ID
    return SOUND


@kernel
def within_reach(
    table: Floats,
    count: int,
    now: float,
    stamp: float,
    hold: float,
    track_id: Ints,
    xy: Floats,
    velocity: Floats,
    radius: Floats,
    spread: Floats,
    bounds: Floats,
    out: Floats,
) -> int:
    """Write the rows (kernels/robot/reach.py) of the tracks of this scan and of those that were lost recently; return how many.

    The recent tracks, in the first `count` rows of `table`, float64[M, TABLE_COLUMNS], are brought up to date; M is at least
    `count` + K. It is `now`, and the scan of K tracks is from the time `stamp`; a lost track still counts for `hold` s. A
    velocity of NaN is unknown, and `spread`, float64[K], is the error of the places, m. A third column of `velocity` is the
    error of the speeds, m/s. `bounds` are described at BOUND_SPEED and the others above; that at BOUND_KIND rises slowly to the
    fastest speed seen. Observations of a track raise its own bounds at once. `out`, float64[M, 8], is filled with a row for
    each recent track.
    """
    top, stopping_time = bounds[BOUND_KIND], bounds[STOPPING_TIME]
    for k in range(len(track_id)):
        vx, vy = velocity[k, 0], velocity[k, 1]
        speed = math.hypot(vx, vy)
        known, exact = not math.isnan(speed), spread[k] == 0.0  # noise makes changes look larger than they are
        i = 0
        while i < count and (table[i, _ID] != track_id[k] or track_id[k] < 0):
            i += 1
        if i == count:
            count += 1
            table[i, _FASTEST], table[i, _GROWTH] = 0.0, 0.0
        elif known and exact and stamp > table[i, _SEEN] and table[i, _SPEED] >= 0.0:
            table[i, _GROWTH] = max(table[i, _GROWTH], (speed - table[i, _SPEED]) / (stamp - table[i, _SEEN]))
        if known:
            if exact:
                table[i, _FASTEST], top = max(table[i, _FASTEST], speed), max(top, speed)
        else:
            vx, vy, speed = 0.0, 0.0, -1.0
        table[i, _ID], table[i, _SEEN], table[i, _X], table[i, _Y] = track_id[k], stamp, xy[k, 0], xy[k, 1]
        table[i, _VX], table[i, _VY], table[i, _RADIUS], table[i, _SPEED] = vx, vy, radius[k] + spread[k], speed
        table[i, _ERROR] = velocity[k, 2] if velocity.shape[1] > 2 else 0.0
    bounds[BOUND_KIND] += _LEARNS * (top - bounds[BOUND_KIND])
    kept = 0
    for i in range(count):
        age = now - table[i, _SEEN]
        if table[i, _SEEN] < stamp and age > hold:
            continue
        copy_row(table[i], table[kept])
        copy_row(table[i, _X:_SPEED], out[kept, :SPEED])
        fastest, speed = max(bounds[BOUND_SPEED], bounds[BOUND_KIND], table[i, _FASTEST]), table[i, _SPEED]
        growth = max(bounds[BOUND_GROWTH], table[i, _GROWTH]) * (age + stopping_time)
        out[kept, SPEED] = min(fastest, speed + table[i, _ERROR] + growth) if speed >= 0.0 else fastest
        out[kept, ACCEL], out[kept, AGE] = bounds[BOUND_CHANGE] if speed >= 0.0 else math.inf, age
        kept += 1
    return kept


@kernel
def brakes_free(x: float, y: float, wx: float, wy: float, tracks: Floats, rules: Rules) -> bool:
    """Tell whether a robot at (x, y) can drive one period with (wx, wy) and then brake, straight, to a stand.

    `tracks` is float64[K, 8], as in kernels/robot/reach.py. Until the robot stands, no obstacle that stays within its bounds
    may touch it, however it moves, and no wall may.
    """
    speed = math.hypot(wx, wy)
    if speed <= TOUCH:
        return True
    limits, dt, t, start_x, start_y = rules.limits, rules.dt, 0.0, x, y
    ux, uy = wx / speed, wy / speed
    while speed > TOUCH:
        for k in range(len(tracks)):
            if reach_gap_along(tracks[k], x, y, ux * speed, uy * speed, t, t + dt) < limits.radius - TOUCH:
                return False
        x += ux * speed * dt
        y += uy * speed * dt
        t += dt
        speed -= limits.a_max * dt
    return leads_clear(rules.terrain, start_x, start_y, x, y, limits.radius)


@kernel
def time_to_contact(x: float, y: float, tracks: Floats, radius: float) -> float:
    """Return when the first track touches a robot that stands at (x, y) if all keep their velocities, s; else infinity."""
    earliest = math.inf
    for k in range(len(tracks)):
        ux, uy = tracks[k, VX], tracks[k, VY]
        ax, ay = tracks[k, X] + ux * tracks[k, AGE] - x, tracks[k, Y] + uy * tracks[k, AGE] - y
        reach = radius + tracks[k, RADIUS]
        closing = ax * ux + ay * uy
        slack = ax * ax + ay * ay - reach * reach
        uu = ux * ux + uy * uy
        root = closing * closing - uu * slack
        if slack <= 0.0:
            return 0.0
        if closing < 0.0 and root > 0.0:
            earliest = min(earliest, slack / (-closing + math.sqrt(root)))
    return earliest


@kernel
def _time_to_contact_after(
    x: float, y: float, vx: float, vy: float, until: float, horizon: float, tracks: Floats, radius: float
) -> float:
    """Return the time of the first contact, at most `horizon`, of a robot that drives until `until` and then stands, s."""
    earliest = horizon
    for k in range(len(tracks)):
        ux, uy, age = tracks[k, VX], tracks[k, VY], tracks[k, AGE]
        ax, ay = tracks[k, X] + ux * age - x, tracks[k, Y] + uy * age - y
        first, _, _ = swept_discs(ax, ay, ux - vx, uy - vy, radius + tracks[k, RADIUS], until)
        earliest = min(earliest, first)
        ax, ay = ax + (ux - vx) * until, ay + (uy - vy) * until
        first, _, _ = swept_discs(ax, ay, ux, uy, radius + tracks[k, RADIUS], horizon - until)
        earliest = min(earliest, until + first)
    return earliest


@kernel
def _aside(state: RobotState, standing: float, tracks: Floats, rules: Rules) -> tuple[float, float]:
    """Return the velocity of the step aside with the latest contact, if that is later than `standing` s, else (0, 0).

    The robot drives at full speed for `rules.lookahead` s, or up to a wall, and then stands. Its braking path must be free.
    """
    (x, y, heading, vx, vy), limits, ahead = state, rules.limits, rules.lookahead
    v_max, radius = limits.v_max, limits.radius
    best, ax, ay = standing, 0.0, 0.0
    for k in range(_SIDES):
        tx, ty = v_max * math.cos(2 * math.pi * k / _SIDES), v_max * math.sin(2 * math.pi * k / _SIDES)
        wall, _, _ = wall_ahead(rules.terrain, x, y, tx * ahead, ty * ahead, radius)
        contact = _time_to_contact_after(x, y, tx, ty, min(wall, 1.0) * ahead, 2 * ahead, tracks, radius)
        wx, wy, _ = drive(vx, vy, heading, tx, ty, limits, rules.dt)
        if contact > best + TOUCH and brakes_free(x, y, wx, wy, tracks, rules):
            best, ax, ay = contact, tx, ty
    return ax, ay


@kernel
def guarded(state: RobotState, cx: float, cy: float, tracks: Floats, rules: Rules) -> tuple[float, float, int]:
    """Return the command (vx, vy) that the guard passes, and what it did.

    The commanded velocity (cx, cy) passes if the robot's braking path after it is free; else the fastest velocity in the same
    direction whose braking path is free; else the robot stands. If a track would touch the standing robot within `lookahead` s,
    the robot steps aside, if that delays the contact; where `rules.strict` is false, it takes the command of `least_harm`
    instead, certain or not. Wheels at rest that turn by at most a right angle in a period turn towards the command. The state
    has the velocity (vx, vy), whatever the drive.
    """
    (x, y, heading, vx, vy), limits, dt, speed = state, rules.limits, rules.dt, math.hypot(cx, cy)
    v_max = limits.v_max
    if speed > v_max:
        cx, cy, speed = cx * v_max / speed, cy * v_max / speed, v_max
    for k in range(_FRACTIONS, 0, -1):
        if speed <= TOUCH:
            break
        tx, ty = cx * k / _FRACTIONS, cy * k / _FRACTIONS
        wx, wy, _ = drive(vx, vy, heading, tx, ty, limits, dt)
        if brakes_free(x, y, wx, wy, tracks, rules):
            return tx, ty, FREE if k == _FRACTIONS else SLOWED
    standing = time_to_contact(x, y, tracks, limits.radius)
    if standing <= rules.lookahead:
        if not rules.strict:
            ax, ay = least_harm(state, cx, cy, tracks, limits, dt, rules.terrain)
            return ax, ay, LEAST_HARM if ax != 0.0 or ay != 0.0 else BRAKED if speed > TOUCH else FREE
        ax, ay = _aside(state, standing, tracks, rules)
        if ax != 0.0 or ay != 0.0:
            return ax, ay, STEPPED_ASIDE
    turn, most = wrap(math.atan2(cy, cx) - heading), limits.turn_rate * dt
    stands = speed > TOUCH and math.hypot(vx, vy) <= TOUCH
    if limits.drive == DIFFERENTIAL and stands and most < abs(turn) and most <= math.pi / 2:
        # A right angle to the heading after the turn: the robot turns without driving.
        side = heading + math.copysign(most + math.pi / 2, turn)
        return speed * math.cos(side), speed * math.sin(side), BRAKED
    return 0.0, 0.0, FREE if speed <= TOUCH else BRAKED
