"""The local target: the node of the global path at which a detour around an obstacle ends."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from antway.kernels.base.arrays import Bools, Floats
from antway.world.policy import XY


def local_target(
    route: Floats, taken: Bools, on_path: Bools, beyond: float, xy: XY, sensing_range: float, sight: Callable[[XY], bool]
) -> tuple[int, str]:
    """Return the index of the local target among the nodes ahead, one on the global path, and the reason for it.

    It is the first node past the conflict that the robot can reach after the obstacle has cleared it, outside every tube;
    else the farthest node in sensing range with free line of sight; else the last one ("a suitable node in the shortest path").

    The robot at `xy` has yet to drive to the nodes `route`, m, and meets an obstacle `beyond` m along them. `taken` tells which
    are in a predicted tube when the robot can be there, and `on_path` which are on the global path, at least one; nodes of an
    earlier detour cannot be targets. `sight` tells whether the robot has a free line of sight to a place.
    """
    along = np.cumsum(np.hypot(*np.diff(np.vstack((xy, route)), axis=0).T))
    past = np.flatnonzero((along > beyond) & ~taken & on_path)
    if len(past):
        return int(past[0]), "first node of the path past the obstacle that is free when the robot gets there"
    ahead = np.flatnonzero(on_path).tolist()
    for i in reversed(ahead):
        x, y = route[i].tolist()
        if math.dist(xy, (x, y)) <= sensing_range and sight((x, y)):
            return i, "farthest node of the path in sensing range and sight"
    return ahead[-1], "last node of the path in the window"
