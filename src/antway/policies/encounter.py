"""The kind of a coming encounter, and when and how close the closest approach will be."""

from __future__ import annotations

import math

from antway.world.nearby import STANDING
from antway.world.policy import XY


def closest_approach(xy: XY, velocity: XY, other: XY, other_velocity: XY) -> tuple[float, float]:
    """Return time (s, >= 0) and distance of the centres (m) at the closest approach of two points in uniform motion.

    Examples
    --------
    >>> closest_approach((0.0, 0.0), (1.0, 0.0), (4.0, 1.0), (-1.0, 0.0))
    (2.0, 1.0)
    """
    px, py = other[0] - xy[0], other[1] - xy[1]
    vx, vy = other_velocity[0] - velocity[0], other_velocity[1] - velocity[1]
    vv = vx * vx + vy * vy
    t = max(-(px * vx + py * vy) / vv, 0.0) if vv > 0.0 else 0.0
    return t, math.hypot(px + t * vx, py + t * vy)


def encounter(velocity: XY, other_velocity: XY) -> str:
    """Name the encounter of a robot and an obstacle by their velocities, m/s.

    head-on: directions within 45 degrees of opposite; overtaking: within 45 degrees of equal; crossing-left, crossing-right:
    the obstacle comes from that side of the robot; standing: the obstacle does not move. The velocity of a robot at rest has no
    direction, so every moving obstacle would be head-on: pass the velocity that the robot intends.

    Examples
    --------
    >>> encounter((1.0, 0.0), (0.0, 0.5))
    'crossing-right'
    """
    if math.hypot(*other_velocity) < STANDING:
        return "standing"
    turn = math.atan2(
        velocity[0] * other_velocity[1] - velocity[1] * other_velocity[0],
        velocity[0] * other_velocity[0] + velocity[1] * other_velocity[1],
    )
    if abs(turn) >= 0.75 * math.pi or math.hypot(*velocity) < STANDING:
        return "head-on"
    if abs(turn) <= 0.25 * math.pi:
        return "overtaking"
    return "crossing-right" if turn > 0 else "crossing-left"
