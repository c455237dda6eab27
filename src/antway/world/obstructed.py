"""Refuses scenarios in which an obstacle moves through walls, unless they say that this is intended."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadScenario
from antway.grid import Grid
from antway.kernels.robot.motions import first_inside
from antway.world.motions import BackAndForth, Bounce, Draw, Line, Pursue, RandomWalk, Waypoints
from antway.world.world import Obstacle, World

_STANDS = 1e-9  # m/s; slower obstacles stand for any horizon
_SLACK = 1e-6  # m; tolerance, so that an obstacle that moves along a wall is not in contact by rounding
_TURN_BACK = (Bounce, RandomWalk, Pursue)  # motions that never enter a wall, unless they start in one


def refuse_through_walls(world: World, seed: int, horizon: float) -> None:
    """Refuse obstacles that start in a wall or move through one. Touching walls and leaving the map are legal.

    The motions are those of the episode with `seed` up to `horizon` s. Motions along a fixed line are tested on the whole line,
    because another seed may draw another speed and phase.

    Raises
    ------
    BadScenario
        Names the obstacle, and the first time at which it is in a wall, s.
    """
    if not world.grid.blocked.any():
        return
    for k, obstacle in enumerate(world.obstacles):
        when = _first(world.grid, obstacle, Draw(seed, k), horizon)
        if when < math.inf:
            allowed = "clear of walls throughout; through_walls = true in the scenario lets obstacles pass"
            raise BadScenario(f"obstacles[{k}].motion", f"in a wall at {when:.2f} s", allowed)


def _first(grid: Grid, obstacle: Obstacle, draw: Draw, horizon: float) -> float:
    """Return when the obstacle is in a wall for the first time, s; infinite if never."""
    motion, radius = obstacle.motion, obstacle.radius
    if isinstance(motion, _TURN_BACK):
        return _first_on(grid, radius, np.zeros(1), np.array([motion.start]))
    t, xy = motion.trajectory(draw, horizon, grid, radius)
    count = int((t <= horizon).sum()) + 1  # including the leg that contains the horizon
    when = _first_on(grid, radius, np.asarray(t[:count], np.float64), np.asarray(xy[:count], np.float64))
    if when <= horizon:
        return when
    if not isinstance(motion, Line | BackAndForth | Waypoints):
        return math.inf
    points = list(motion.points) if isinstance(motion, Waypoints) else [motion.start, motion.end]
    ends = np.array(points + points[:1] if isinstance(motion, Waypoints) and motion.loop else points)
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(ends, axis=0).T))))
    speed = motion.speed[1] if isinstance(motion.speed, tuple) else motion.speed  # the highest
    return _first_on(grid, radius, along / speed, ends) if speed > _STANDS else math.inf


def _first_on(grid: Grid, radius: float, t: NDArray[np.float64], xy: NDArray[np.float64]) -> float:
    """Return when a disc on this trajectory is in a wall for the first time, s; infinite if never."""
    return float(first_inside(grid.blocked, t, grid.to_points(xy), max(radius - _SLACK, 0.0) / grid.resolution))
