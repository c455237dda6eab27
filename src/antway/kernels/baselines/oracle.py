"""The first contact of a robot on a given path."""

from __future__ import annotations

import math

from antway.kernels.base.arrays import Floats
from antway.kernels.base.geometry import hits_walls
from antway.kernels.base.jit import kernel
from antway.kernels.base.records import Terrain, Trajectories
from antway.kernels.tracking.tubes import first_met


@kernel
def first_contact(t: Floats, xy: Floats, robot_radius: float, terrain: Terrain, trajectories: Trajectories) -> float:
    """Return when, s, a robot at `xy[i]` m at `t[i]` s touches a disc or starts a leg into a wall or an edge; else infinity."""
    for i in range(len(t) - 1):
        ax, ay, bx, by = xy[i, 0], xy[i, 1], xy[i + 1, 0], xy[i + 1, 1]
        contact, _ = first_met(ax, ay, bx, by, t[i], t[i + 1], robot_radius, 0.0, trajectories)
        if contact > t[i] and hits_walls(terrain, ax, ay, bx, by, robot_radius, True):
            contact = t[i]
        if contact < math.inf:
            return contact
    return math.inf
