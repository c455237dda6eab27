"""Rollouts of a robot that keeps one command: where it gets to, and when it touches what."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.geometry import hits_walls, segment_hits_cells, swept_discs
from antway.kernels.base.jit import inner_kernel, kernel
from antway.kernels.base.records import RobotLimits, Terrain
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.motion import REST, drive_roughly

_ROUGH = 1e-5  # m; bound on the error of places after a few periods


@kernel
def roll_out(
    candidates: NDArray[np.float64],
    state: NDArray[np.float64],
    limits: NDArray[np.float64],
    dt: float,
    steps: int,
    terrain: Terrain,
    radius: float,
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
    contact_radius: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Drive each candidate command for `steps` control periods, or to the first contact.

    Parameters
    ----------
    candidates : float64[C, 2]
        Commanded velocities, m/s.
    state : float64[5]
        x, y, vx, vy, heading of the robot, m, m/s, rad.
    limits : float64[4]
        As in `kernels.robot.dynamics.drive`.
    dt, steps
        Control period in s, and the number of periods.
    terrain, radius
        The map, and the robot's radius in m.
    xy, velocity, contact_radius : float64[K, 2], float64[K, 2], float64[K]
        Obstacles in uniform motion: present place, velocity, contact distance of the centres; m, m/s.
    out : float64[C, 5]
        For each candidate: time of the first contact in s (infinite if none), the index of the obstacle then touched (-1: a
        wall or none), speed at the end of the first period, and the robot's place after that period.
    """
    size = terrain.resolution
    for c in range(len(candidates)):
        x, y, vx, vy, heading = state[0], state[1], state[2], state[3], state[4]
        contact, obstacle = math.inf, -1
        for i in range(steps):
            vx, vy, heading = drive(vx, vy, heading, candidates[c, 0], candidates[c, 1], limits, dt)
            t = i * dt
            contact, obstacle = _first_contact(x, y, vx, vy, t, dt, xy, velocity, contact_radius)
            row, col = (y - terrain.y0) / size - 0.5, (x - terrain.x0) / size - 0.5
            to_row, to_col = row + vy * dt / size, col + vx * dt / size
            if contact > t and segment_hits_cells(terrain.blocked, row, col, to_row, to_col, radius / size, True):
                contact, obstacle = t, -1
            x, y = x + vx * dt, y + vy * dt
            if i == 0:
                out[c, 2], out[c, 3], out[c, 4] = math.hypot(vx, vy), x, y
            if contact < math.inf:
                break
        out[c, 0], out[c, 1] = contact, obstacle


@inner_kernel
def _first_contact(
    x: float,
    y: float,
    vx: float,
    vy: float,
    t: float,
    dt: float,
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
    contact_radius: NDArray[np.float64],
) -> tuple[float, int]:
    """Return the time of the first contact in the period that starts at t, or infinity, and the obstacle, or -1."""
    contact, obstacle = math.inf, -1
    for k in range(len(contact_radius)):
        px, py = xy[k, 0] + velocity[k, 0] * t - x, xy[k, 1] + velocity[k, 1] * t - y
        hit, _, _ = swept_discs(px, py, velocity[k, 0] - vx, velocity[k, 1] - vy, contact_radius[k], dt)
        if t + hit < contact:
            contact, obstacle = t + hit, k
    return contact, obstacle


@kernel
def roll_out_twists(
    candidates: NDArray[np.float64],
    state: NDArray[np.float64],
    limits: RobotLimits,
    dt: float,
    steps: int,
    aim: int,
    terrain: Terrain,
    xy: NDArray[np.float64],
    velocity: NDArray[np.float64],
    contact_radius: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """Drive each candidate twist for `steps` control periods, or to the first contact, by the dynamics of wheels with ramps.

    Parameters
    ----------
    candidates : float64[C, 2]
        Speed in m/s, negative in reverse, and turn rate in rad/s.
    state : float64[5]
        x, y, heading, speed and turn rate of the robot.
    limits : RobotLimits
    aim : int
        Number of periods, >= 1, after which place and heading are written.
    dt, steps, terrain, xy, velocity, contact_radius
        As in `roll_out`. Within a period the robot moves along the chord of its arc.
    out : float64[C, 7]
        For each candidate: time of the first contact in s (infinite if none), the index of the obstacle then touched (-1: a
        wall or none), speed at the end of the first period, x, y and heading after `aim` periods or where it stopped, and
        whether a period of the command followed by braking with its turn rate keeps clear of walls (`stops_clear`).
    """
    for c in range(len(candidates)):
        x, y, theta, a, b = state[0], state[1], state[2], state[3], state[4]
        contact, obstacle = math.inf, -1
        for i in range(steps):
            x1, y1, theta, a, b = drive_roughly(x, y, theta, a, b, candidates[c, 0], candidates[c, 1], limits, dt)
            t, vx, vy = i * dt, (x1 - x) / dt, (y1 - y) / dt
            contact, obstacle = _first_contact(x, y, vx, vy, t, dt, xy, velocity, contact_radius)
            if contact > t and hits_walls(terrain, x, y, x1, y1, limits.radius, True):
                contact, obstacle = t, -1
            x, y = x1, y1
            if i == 0:
                out[c, 2] = a
            if i < aim:
                out[c, 3], out[c, 4], out[c, 5] = x, y, theta
            if contact < math.inf:
                break
        out[c, 0], out[c, 1] = contact, obstacle
        out[c, 6] = stops_clear(candidates[c, 0], candidates[c, 1], state, limits, dt, terrain)


@kernel
def stops_clear(cv: float, cw: float, state: NDArray[np.float64], limits: RobotLimits, dt: float, terrain: Terrain) -> bool:
    """Tell whether a period of the command (cv, cw), followed by (0, cw) until the robot stands, keeps clear of walls.

    The disc that is tested along the chord of each period is enlarged by the distance of the arc from its chord. After such a
    command (0, cw) is safe, so a robot that uses only such commands never drives into a wall.
    """
    x, y, theta, a, b = state[0], state[1], state[2], state[3], state[4]
    first = True
    while first or abs(a) > REST:
        fastest = max(abs(a), abs(cv)) if first else abs(a)
        x1, y1, theta, a, b = drive_roughly(x, y, theta, a, b, cv if first else 0.0, cw, limits, dt)
        bulge = fastest * limits.turn_rate * dt * dt / 8.0 + (_ROUGH if fastest > REST else 0.0)
        if hits_walls(terrain, x, y, x1, y1, limits.radius + bulge, True):
            return False
        x, y, first = x1, y1, False
    return True
