"""A world: a static map and the obstacles that move on it."""

from __future__ import annotations

from dataclasses import dataclass

from antway import checks
from antway.errors import BadParameter, BadScenario, TooLarge
from antway.grid import Grid
from antway.limits import MAX_PLACE, MAX_TIME
from antway.world.motions import MOTIONS, Draw, Motion
from antway.world.timeline import Timeline

MAX_OBSTACLES = 10_000


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
