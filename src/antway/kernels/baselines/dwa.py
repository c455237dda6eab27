"""Rollouts of a robot that keeps one command: where it gets to, and when it touches what."""

from __future__ import annotations

import math
from typing import NamedTuple

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import hits_walls, swept_discs
from antway.kernels.base.jit import inner_kernel, kernel
from antway.kernels.base.records import HOLONOMIC, RobotLimits, RobotState, Terrain
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.motion import REST, drive_roughly

_ROUGH = 1e-5  # m; bound on the error of places after a few periods


class Obstacles(NamedTuple):
    """K obstacles that keep their velocities."""

    xy: Floats  # float64[K, 2], m; present places
    velocity: Floats  # float64[K, 2], m/s
    contact_radius: Floats  # float64[K], m; distance of the robot's centre at contact


@kernel
def roll_out(
    candidates: Floats,
    state: RobotState,
    limits: RobotLimits,
    dt: float,
    steps: int,
    terrain: Terrain,
    obstacles: Obstacles,
    out: Floats,
) -> None:
    """Drive each candidate velocity, m/s, for `steps` control periods of `dt` s, or to the first contact.

    The state has the velocity (vx, vy), and the robot moves as in `kernels.robot.dynamics.drive`. Written to `out`,
    float64[C, 4], for each candidate: time of the first contact in s (infinite if none), speed at the end of the first period,
    and the robot's place after that period.
    """
    for c in range(len(candidates)):
        x, y, heading, vx, vy = state
        contact = math.inf
        for i in range(steps):
            vx, vy, heading = drive(vx, vy, heading, candidates[c, 0], candidates[c, 1], limits, dt)
            t = i * dt
            contact = _first_contact(x, y, vx, vy, t, dt, obstacles)
            if contact > t and hits_walls(terrain, x, y, x + vx * dt, y + vy * dt, limits.radius, True):
                contact = t
            x, y = x + vx * dt, y + vy * dt
            if i == 0:
                out[c, 1], out[c, 2], out[c, 3] = math.hypot(vx, vy), x, y
            if contact < math.inf:
                break
        out[c, 0] = contact


@inner_kernel
def _first_contact(x: float, y: float, vx: float, vy: float, t: float, dt: float, obstacles: Obstacles) -> float:
    """Return the time of the first contact with an obstacle in the period that starts at t, or infinity."""
    xy, velocity, contact_radius = obstacles
    contact = math.inf
    for k in range(len(contact_radius)):
        px, py = xy[k, 0] + velocity[k, 0] * t - x, xy[k, 1] + velocity[k, 1] * t - y
        hit, _, _ = swept_discs(px, py, velocity[k, 0] - vx, velocity[k, 1] - vy, contact_radius[k], dt)
        contact = min(contact, t + hit)
    return contact


@kernel
def roll_out_twists(
    candidates: Floats,
    state: RobotState,
    limits: RobotLimits,
    dt: float,
    steps: int,
    aim: int,
    terrain: Terrain,
    obstacles: Obstacles,
    out: Floats,
) -> None:
    """Drive each candidate twist for `steps` control periods, or to the first contact, by the dynamics of wheels with ramps.

    A twist is a speed in m/s, negative in reverse, and a turn rate in rad/s. Within a period the robot moves along the chord of
    its arc. Written to `out`, float64[C, 6], for each candidate: the first two as in `roll_out`, x, y and heading after `aim`
    periods, >= 1, or where it stopped, and whether a period of the command followed by braking with its turn rate keeps clear
    of walls (`stops_clear`).
    """
    for c in range(len(candidates)):
        now, contact = state, math.inf
        for i in range(steps):
            later = drive_roughly(now, candidates[c, 0], candidates[c, 1], limits, dt)
            x, y, t, vx, vy = now.x, now.y, i * dt, (later.x - now.x) / dt, (later.y - now.y) / dt
            contact = _first_contact(x, y, vx, vy, t, dt, obstacles)
            if contact > t and hits_walls(terrain, x, y, later.x, later.y, limits.radius, True):
                contact = t
            now = later
            if i == 0:
                out[c, 1] = now.a
            if i < aim:
                out[c, 2], out[c, 3], out[c, 4] = now.x, now.y, now.theta
            if contact < math.inf:
                break
        out[c, 0] = contact
        out[c, 5] = stops_clear(candidates[c, 0], candidates[c, 1], state, limits, dt, terrain)


@kernel
def stops_clear(ca: float, cb: float, state: RobotState, limits: RobotLimits, dt: float, terrain: Terrain) -> bool:
    """Tell whether a period of the command (ca, cb), and then braking until the robot stands, keeps clear of walls.

    Wheels brake with the turn rate of the command. The disc that is tested along the chord of each period is enlarged by the
    distance of the arc from its chord. After such a command braking is safe, so a robot that uses only such commands never
    drives into a wall.
    """
    holonomic, first = limits.drive == HOLONOMIC, True
    while first or math.hypot(state.a, state.b if holonomic else 0.0) > REST:
        later = drive_roughly(state, ca if first else 0.0, cb if first or not holonomic else 0.0, limits, dt)
        if holonomic:
            bulge = math.hypot(later.a - state.a, later.b - state.b) * dt / 8.0
        else:
            fastest = max(abs(state.a), abs(ca)) if first else abs(state.a)
            bulge = fastest * limits.turn_rate * dt * dt / 8.0 + (_ROUGH if fastest > REST else 0.0)
        if hits_walls(terrain, state.x, state.y, later.x, later.y, limits.radius + bulge, True):
            return False
        state, first = later, False
    return True
