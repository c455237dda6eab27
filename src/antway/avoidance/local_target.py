"""The local target: the node of the global path that a way round an obstacle leads to."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from antway.avoidance.tubes import Tubes
from antway.world.policy import XY

CLEAR = 1.0  # s for which a local target must stay free after the robot's arrival


def local_target(
    route: NDArray[np.float64],
    beyond: float,
    xy: XY,
    v_max: float,
    reach: float,
    body: float,
    tubes: Tubes,
    sight: Callable[[XY], bool],
) -> tuple[int, str]:
    """Return the index of the local target among the nodes of the global path that lies ahead, and why it is that one.

    The first node past the conflict that the robot can reach after the obstacle has cleared it, outside every predicted tube;
    else the farthest node in sensing range with free line of sight; else the goal ("a suitable node in the shortest path").

    Parameters
    ----------
    route : float64[N, 2]
        Nodes of the global path from the robot on, m; the last is the goal.
    beyond : float
        Way along them to the conflict, m.
    xy, v_max
        Where the robot is, m, and its speed, m/s.
    reach : float
        Sensing range, m.
    body : float
        The robot's radius with margin, m.
    tubes : Tubes
    sight : function of (x, y)
        Whether the robot has a free line of sight to the point.
    """
    legs = np.hypot(*np.diff(np.vstack((np.array([xy]), route)), axis=0).T)
    along = np.cumsum(legs)
    for i in np.flatnonzero(along > beyond).tolist():
        node = route[i : i + 1]
        arrival = tubes.t + 1.1 * math.dist(xy, node[0].tolist()) / v_max
        if tubes.conflict(np.array([arrival]), node, arrival + CLEAR, body)[0] == math.inf:
            return i, "first node of the path that is free when the robot gets there"
    for i in range(len(route) - 1, -1, -1):
        x, y = route[i].tolist()
        if math.dist(xy, (x, y)) <= reach and sight((x, y)):
            return i, "farthest node of the path in sensing range and sight"
    return len(route) - 1, "the goal"
