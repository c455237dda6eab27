"""A world: a static map and the obstacles that move on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, BadScenario, TooLarge
from antway.grid import Grid
from antway.kernels.robot.motions import first_inside
from antway.limits import MAX_PLACE, MAX_TIME
from antway.world.motions import MOTIONS, BackAndForth, Bounce, Draw, Line, Motion, Pursue, RandomWalk, Waypoints
from antway.world.timeline import Timeline

MAX_OBSTACLES = 10_000
_STANDS = 1e-9  # m/s; slower obstacles stand for any horizon
_SLACK = 1e-6  # m; tolerance, so that an obstacle that moves along a wall is not in contact by rounding
_TURN_BACK = (Bounce, RandomWalk, Pursue)  # motions that never enter a wall, unless they start in one


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A disc of `radius` m that moves by `motion`."""

    radius: float
    motion: Motion

    def __post_init__(self) -> None:
        checks.fields(self, "radius", low=0.0, high=MAX_PLACE, open_low=True, unit="m")
        if isinstance(self.motion, type) or not callable(getattr(self.motion, "trajectory", None)):
            raise BadParameter("motion", self.motion, f"a motion: {', '.join(kind.__name__ for kind in MOTIONS.values())}")


@dataclass(frozen=True, slots=True)
class World:
    """A static map and its moving obstacles.

    Parameters
    ----------
    grid : Grid
        Yaw must be 0.
    obstacles : sequence of Obstacle
        At most 10,000; obstacle k has the id k.

    Examples
    --------
    >>> import numpy as np
    >>> from antway.world.motions import Line
    >>> room = Grid(np.zeros((10, 10), dtype=bool))
    >>> world = World(room, [Obstacle(0.3, Line((1.0, 5.0), (9.0, 5.0), speed=0.5))])
    >>> world.timeline(seed=0, horizon=20.0).at(4.0)[0].tolist()
    [[3.0, 5.0]]
    """

    grid: Grid
    obstacles: tuple[Obstacle, ...] = ()

    def __post_init__(self) -> None:
        checks.instance("grid", self.grid, Grid)
        if self.grid.origin[2] != 0.0:
            raise BadParameter("grid.origin[2]", self.grid.origin[2], "0 in an episode (yaw): Grid.turned() turns the map")
        listed = checks.sequence("obstacles", self.obstacles, "a sequence of Obstacle")
        obstacles = tuple(checks.instance(f"obstacles[{k}]", one, Obstacle) for k, one in enumerate(listed))
        if len(obstacles) > MAX_OBSTACLES:
            raise TooLarge("obstacles.length", len(obstacles), f"at most {MAX_OBSTACLES}")
        object.__setattr__(self, "obstacles", obstacles)

    def timeline(self, seed: int, horizon: float) -> Timeline:
        """Return where every obstacle is from 0 to `horizon` s, with the random choices of `seed`.

        The motion of obstacle k depends only on the seed and on k, not on the other obstacles.

        Raises
        ------
        BadParameter, BadScenario
        """
        checks.seed(seed)
        checks.number("horizon", horizon, low=0.0, high=MAX_TIME, open_low=True, unit="s")
        trajectories = []
        for k, obstacle in enumerate(self.obstacles):
            try:
                trajectories.append(obstacle.motion.trajectory(Draw(seed, k), horizon, self.grid, obstacle.radius))
            except BadScenario as error:
                raise BadScenario(f"obstacles[{k}].{error.field}", error.value, error.allowed) from None
        return Timeline.of(list(range(len(trajectories))), [o.radius for o in self.obstacles], trajectories)


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
