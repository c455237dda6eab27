"""One control cycle of the simulated robot, with ramps, arcs and latency, which ends at the first contact."""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import knot_after, timeline_at, wrap
from antway.kernels.base.jit import bare_kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState, Trajectories, Walls
from antway.kernels.robot.contact import GOES_ON, HIT_MOVING, HIT_STANDING, HIT_WALL, REACHED, Record, at_goal
from antway.kernels.robot.motion import REST, clipped, holonomic_ramp, wheels_segment
from antway.kernels.robot.sweep import (
    Body,
    Disc,
    Segment,
    meets_disc,
    meets_wall,
    nearest_disc,
    pose,
    rolling,
    straight,
    top_speed,
)


@bare_kernel
def next_segment(
    state: RobotState, ca: float, cb: float, limits: RobotLimits, left: float
) -> tuple[Segment, float, float, float]:
    """Return the first segment under a command, its length, and the speeds (v, omega) or (vx, vy) at its end.

    The command is clipped to the limits; it acts for another `left` s.
    """
    x, y, theta, a, b = state
    ca, cb = clipped(ca, cb, limits)
    if limits.drive == HOLONOMIC:
        ax, ay, time = holonomic_ramp(a, b, ca, cb, limits)
        if time <= 0.0:
            return straight(x, y, theta, ca, cb, 0.0, 0.0), left, ca, cb
        if time <= left:
            return straight(x, y, theta, a, b, ax, ay), time, ca, cb
        return straight(x, y, theta, a, b, ax, ay), left, a + ax * left, b + ay * left
    h, v, acceleration, w, alpha, v_end, w_end = wheels_segment(a, b, ca, cb, limits, left)
    return rolling(x, y, theta, v, acceleration, w, alpha, h), h, v_end, w_end


@bare_kernel
def _first_contact(
    m: Segment, t: float, h: float, body: Body, discs: Trajectories, walls: Walls, aim: Floats
) -> tuple[int, int, float]:
    """Return what happens first on a segment that begins at time t, with which obstacle, and after how long."""
    what, obstacle, when = GOES_ON, -1, math.inf
    fastest = top_speed(m, h)
    for k in range(len(discs.radius)):
        s = 0.0
        while s < h and s < when:
            disc, until = _disc_at(discs, k, t + s)
            span, at = min(until - t - s, h - s), pose(m, s)
            away = math.hypot(at.x - disc.x, at.y - disc.y) - body.radius - disc.radius
            if away <= (fastest + math.hypot(disc.vx, disc.vy)) * span:
                hit = meets_disc(_later(m, s), span, body, disc)
                if s + hit < when:
                    what, obstacle, when = HIT_MOVING, k, s + hit
            s += max(span, 1e-12)
    wall = meets_wall(m, min(h, when), body, walls)
    if wall < when:
        what, obstacle, when = HIT_WALL, -1, wall
    x, y = m.x - aim[0], m.y - aim[1]
    away = math.hypot(x, y) - aim[2]
    if away < 0.0 < when:  # the robot is there already
        return REACHED, -1, 0.0
    if away <= fastest * h:
        centre = Body(body.centre, 0.0, 0.0, body.centre)
        arrival = meets_disc(m, min(h, when), centre, Disc(aim[0], aim[1], 0.0, 0.0, aim[2]))
        if arrival < when:
            what, obstacle, when = REACHED, -1, arrival
    return what, obstacle, when


@bare_kernel
def _disc_at(discs: Trajectories, k: int, t: float) -> tuple[Disc, float]:
    """Return disc k as it moves at time t, and the time until which it moves so, s; infinite after its last knot."""
    (x, y, vx, vy), i = timeline_at(t, discs, k), knot_after(discs, k, t)
    return Disc(x, y, vx, vy, discs.radius[k]), discs.knot_t[i] if i < discs.first[k + 1] else math.inf


@bare_kernel
def _later(m: Segment, s: float) -> Segment:
    """Return the rest of a segment from the time s on."""
    if s == 0.0:
        return m
    x, y, theta, vx, vy, w = pose(m, s)
    return Segment(m.curved, x, y, theta, vx, vy, m.ax, m.ay, m.v + m.a * s, m.a, w, m.b, m.bend, m.spin)


@bare_kernel
def _nearest(m: Segment, t: float, h: float, body: Body, discs: Trajectories, best: float) -> float:
    """Return the smallest gap to any obstacle on a segment that begins at time t, or `best` if that is smaller."""
    for k in range(len(discs.radius)):
        s = 0.0
        while True:
            disc, until = _disc_at(discs, k, t + s)
            span = min(until - t - s, h - s)
            best = nearest_disc(_later(m, s), span, body, disc, best)
            s += max(span, 1e-12)
            if s >= h:
                break
    return best


@bare_kernel
def play(
    i: int,
    dt: float,
    limits: RobotLimits,
    body: Body,
    record: Record,
    aim: Floats,
    walls: Walls,
    discs: Trajectories,
    least: float,
) -> tuple[int, int, float]:
    """Drive control cycle i of `dt` s, or until the first contact, and write row i + 1 of the record.

    A holonomic disc points in its direction of motion; a holonomic robot with a footprint keeps its heading. Rows and commands
    up to i are given. A command acts `limits.latency` s after the start of its cycle; before the first command acts, the robot
    is commanded to stand. `aim` has x, y and tolerance of the goal, m; a robot that is exactly that far from it at the end of
    the cycle has reached it.

    Returns what happened and the obstacle as `advance` in kernels/robot/contact.py, and the smallest distance between the edges
    of robot and obstacles in this cycle, or `least` if that is smaller, m.
    """
    wheels, disc = limits.drive != HOLONOMIC, len(body.corners) == 1
    t, (x, y), (vx, vy), theta = record.t[i], record.xy[i], record.velocity[i], record.heading[i]
    a, b = (vx * math.cos(theta) + vy * math.sin(theta), record.turn_rate[i]) if wheels else (vx, vy)
    whole = math.floor(limits.latency / dt + 1e-9)
    late = max(limits.latency - whole * dt, 0.0)
    if late <= 1e-9 * dt:
        late = 0.0
    started, what, obstacle = t, GOES_ON, -1
    for part in range(2):
        left = late if part == 0 else dt - late
        j = i - whole - 1 + part
        ca, cb = (record.command[j, 0], record.command[j, 1]) if j >= 0 else (0.0, 0.0)
        while left > 0.0 and what == GOES_ON:
            m, h, a1, b1 = next_segment(RobotState(x, y, theta, a, b), ca, cb, limits, left)
            what, obstacle, when = _first_contact(m, t, h, body, discs, walls, aim)
            s = min(when, h)
            least = _nearest(m, t, s, body, discs, least)
            x, y, theta, vx, vy, w = pose(m, s)
            if what == GOES_ON:
                a, b = a1, b1
                if wheels:
                    vx, vy = a * math.cos(theta), a * math.sin(theta)
                    w = b
                else:
                    vx, vy = a, b
            t += s
            left -= h
    if not wheels:
        w = 0.0
        if disc and math.hypot(vx, vy) > REST:
            theta = math.atan2(vy, vx)
    if what == HIT_MOVING and math.hypot(vx, vy) <= REST and (disc or abs(w) <= REST):
        what = HIT_STANDING
    record.t[i + 1] = (i + 1) * dt if what == GOES_ON else max(t, np.nextafter(started, math.inf))
    record.xy[i + 1, 0], record.xy[i + 1, 1] = x, y
    record.velocity[i + 1, 0], record.velocity[i + 1, 1] = vx, vy
    record.heading[i + 1], record.turn_rate[i + 1] = wrap(theta), w
    if what == GOES_ON and at_goal(x, y, aim):
        what = REACHED
    return what, obstacle, least
