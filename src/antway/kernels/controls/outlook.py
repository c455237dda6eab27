"""What is expected during a rollout: where obstacles will be at the end of each step, and where the plan leads by then."""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base import records
from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import inner_kernel, kernel
from antway.kernels.base.records import RobotState
from antway.kernels.controls.problem import NearObstacle, Outlook, near_at, set_near

AFTERWARDS = 3.0  # s; after the end of a rollout, obstacles count for this time (kernels/controls/afterwards.py)
_SHORT = 0.101  # s; in shorter steps whoever is met between their ends is 1 cm deep at most, at a relative speed of 2.5 m/s


class Margins(NamedTuple):
    """Distances to keep from obstacles, and how uncertain their places become."""

    margin: float  # m; is added to the contact radius
    preferred_gap: float  # m; a gap beyond the margin of this or more costs nothing
    spread: float  # 1; the risk of contact begins at this many standard deviations of the place
    spread_time: float  # s; the standard deviation of a place grows for this time ahead, and then stays
    late: float  # s; standard deviations are those of a time this much later, as a robot with inertia cannot respond at once
    response: float  # s; delay before the robot responds to an obstacle that turns
    agility: float  # m/s^2; acceleration with which it then gets out of the way


class SpeedBounds(NamedTuple):
    """How fast the robot and obstacles can be."""

    v_max: float  # m/s; top speed of the robot
    stopping_time: float  # s; longest time from the end of a step until the robot can stand
    obstacle: float  # m/s; no obstacle becomes faster than this; one that is faster already keeps its speed
    growth: float  # m/s; no obstacle's speed grows by more than this


@kernel
def write_beyond(v_max: float, dt: float, outlook: Outlook) -> None:
    """Write from which distance on each obstacle of `outlook` costs a robot nothing whose top speed is `v_max` m/s.

    Distances are those at the end of a step of `dt` s. One that passes the obstacle within a long step has been nearer: at a
    right angle to their relative motion.
    """
    steps = len(outlook.plan)
    for k in range(steps + 1):
        for i in range(outlook.near[k]):
            disc = near_at(outlook, k, i)
            distance = max(disc.preferred, disc.risky, disc.turn_distance)
            speed = v_max + math.hypot(disc.vx, disc.vy)
            outlook.beyond[k, 0, i], outlook.beyond[k, 1, i] = disc.x, disc.y
            if k < steps:
                outlook.beyond[k, 2, i] = distance * distance + ((speed * dt) ** 2 if dt > _SHORT else 0.0)
            else:
                outlook.beyond[k, 2, i] = (distance + speed * AFTERWARDS) ** 2


@inner_kernel
def _place_for(outlook: Outlook, k: int, start: RobotState, gap: float) -> int:
    """Return the place in step k of an obstacle so far from contact with the robot at the start, m, or -1.

    Where all are taken, it is that of the farthest obstacle, if that is farther.
    """
    n, place = outlook.near[k], -1
    if n < outlook.disc.shape[1]:
        outlook.near[k] += 1
        return int(n)
    for i in range(n):
        disc = near_at(outlook, k, i)
        other = math.hypot(disc.x - start.x, disc.y - start.y) - disc.contact
        if other > gap:
            place, gap = i, other
    return place


@inner_kernel
def _straight_until(segments: Floats, p: int) -> float:
    """Return when the velocity of the obstacle on segment p changes, s; infinite if it does not, or only its tube widens."""
    vx, vy = segments[p, records.VX], segments[p, records.VY]
    while p + 1 < len(segments) and segments[p + 1, records.T0] == segments[p, records.T1]:
        p += 1
        if segments[p, records.VX] != vx or segments[p, records.VY] != vy:
            return float(segments[p, records.T0])
    return math.inf


@kernel
def look_ahead(
    segments: Floats,
    sigma: Floats,
    now: float,
    dt: float,
    start: RobotState,
    bounds: SpeedBounds,
    margins: Margins,
    change: float,
    outlook: Outlook,
) -> None:
    """Fill `outlook` with the obstacles of motion segments that the robot could come near to.

    The segments of one obstacle come after those of another, each in the order of time (kernels/spacetime/segments.py).
    `sigma`, float64[K, 2], are standard deviations of each obstacle's place (m) and velocity (m/s). Step k ends at now + (k +
    1) dt. `change` is by how much the velocities of obstacles change when they turn, m/s; 0 if they do not turn.
    """
    v_max, stopping_time = bounds.v_max, bounds.stopping_time
    steps, size = len(outlook.plan), outlook.disc.shape[1]
    outlook.near[:] = 0
    obstacle, last, owner = -1, -1, -1  # `last` came near last, and `owner` numbers those that do
    for p in range(len(segments)):
        segment = segments[p]
        t0, t1 = segment[records.T0], segment[records.T1]
        vx, vy = segment[records.VX], segment[records.VY]
        if p == 0 or t0 < segments[p - 1, records.T1]:
            obstacle += 1
        pace = math.hypot(vx, vy)
        speed = min(pace + bounds.growth, max(bounds.obstacle, pace))  # who is faster than declared stays so
        until = _straight_until(segments, p)
        for k in range(max(math.floor((t0 - now) / dt) - 1, 0), steps + 1):
            t = now + min(k + 1, steps) * dt
            if t >= t1 - 1e-9:  # the same as below, so that one of two successive segments counts
                break
            if t < t0 - 1e-9:
                continue
            x, y = segment[records.X] + vx * (t - t0), segment[records.Y] + vy * (t - t0)
            grown = sigma[obstacle, 1] * (margins.late + min(t - now, margins.spread_time))
            uncertain = margins.spread * math.sqrt(sigma[obstacle, 0] ** 2 + grown * grown)
            contact = segment[records.CONTACT_RADIUS] + margins.margin
            turn_time = min(t - now, margins.response + change / margins.agility)
            turned = change * turn_time - 0.5 * margins.agility * max(turn_time - margins.response, 0.0) ** 2
            while_stopping = speed * stopping_time + 0.5 * v_max * stopping_time
            span = v_max * min(k + 1, steps) * dt + ((v_max + pace) * AFTERWARDS if k == steps else 0.0)
            far = contact + max(margins.preferred_gap, uncertain, turned, while_stopping) + span + 0.01
            dx, dy = x - start.x, y - start.y
            if dx * dx + dy * dy < far * far:
                preferred, risky, turning = contact + margins.preferred_gap, contact + uncertain, contact + turned
                if obstacle != last:
                    last, owner = obstacle, owner + 1
                column = float(owner % size)
                disc = NearObstacle(x, y, contact, preferred, speed, vx, vy, until - t, risky, column, turning, turn_time)
                place = _place_for(outlook, k, start, math.hypot(dx, dy) - contact)
                if place >= 0:
                    set_near(outlook, k, place, disc)
    write_beyond(v_max, dt, outlook)


@kernel
def spread_plan(knots: Floats, now: float, dt: float, arrival: float, trust: float, plan: Floats) -> None:
    """Write to `plan`, float64[S, 3], where the plan is at the end of each step, and the time that it still takes.

    `knots`, float64[N, 3], are those of the plan, (t, x, y), at least one. Step k ends at now + (k + 1) dt. The plan arrives at
    the time `arrival`, s, and the robot may be able to arrive `trust` s before that.
    """
    i, n = 0, len(knots)
    for k in range(len(plan)):
        t = now + (k + 1) * dt
        while i < n and knots[i, 0] <= t:
            i += 1
        if i == 0 or i == n:
            j = 0 if i == 0 else n - 1
            plan[k, 0], plan[k, 1] = knots[j, 1], knots[j, 2]
        else:
            u = (t - knots[i - 1, 0]) / (knots[i, 0] - knots[i - 1, 0])
            plan[k, 0] = knots[i - 1, 1] + u * (knots[i, 1] - knots[i - 1, 1])
            plan[k, 1] = knots[i - 1, 2] + u * (knots[i, 2] - knots[i - 1, 2])
        plan[k, 2] = arrival - t - trust
