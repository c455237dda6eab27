"""Whether an obstacle's motion leads through walls: a scenario refuses such a motion, unless it says that it is meant."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadScenario
from antway.grid import Grid
from antway.kernels.robot.motions import first_inside
from antway.world.motions import BackAndForth, Bounce, Draw, Line, Pursue, RandomWalk, Span, Waypoints
from antway.world.world import Obstacle, World

_STANDS = 1e-9  # m/s; what is slower gets nowhere in any horizon
_SLACK = 1e-6  # m; an obstacle that goes along a wall touches it, and rounding must not make that a contact
_TURN_BACK = (Bounce, RandomWalk, Pursue)  # these never enter a wall that they do not begin in


def refuse_through_walls(world: World, seed: int, horizon: float) -> None:
    """Refuse obstacles that begin in a wall or move through one; touching is legal, and so is leaving the map.

    The motions are those that chance gives in the episode of `seed` up to `horizon` s. What goes along a fixed line is tested
    on the whole of it, whatever speed and phase another seed may draw.

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
    """Return when the obstacle is in a wall for the first time, s; infinite if it never is."""
    motion = obstacle.motion
    if isinstance(motion, _TURN_BACK):
        return _inside(grid, obstacle.radius, np.zeros(1), np.array([motion.start]))
    t, xy = motion.trajectory(draw, horizon, grid, obstacle.radius)
    before = t <= horizon
    before[: min(len(t), int(before.sum()) + 1)] = True  # and the leg that the horizon cuts
    when = _inside(grid, obstacle.radius, np.asarray(t[before], np.float64), np.asarray(xy[before], np.float64))
    if when <= horizon or not isinstance(motion, Line | BackAndForth | Waypoints):
        return when if when <= horizon else math.inf
    points = list(motion.points) if isinstance(motion, Waypoints) else [motion.start, motion.end]
    ends = np.array(points + points[:1] if isinstance(motion, Waypoints) and motion.loop else points)
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(ends, axis=0).T))))
    speed = _highest(motion.speed)
    return _inside(grid, obstacle.radius, along / speed, ends) if speed > _STANDS else math.inf


def _highest(span: Span) -> float:
    return span[1] if isinstance(span, tuple) else span


def _inside(grid: Grid, radius: float, t: NDArray[np.float64], xy: NDArray[np.float64]) -> float:
    return float(first_inside(grid.blocked, t, grid.to_points(xy), max(radius - _SLACK, 0.0) / grid.resolution))
