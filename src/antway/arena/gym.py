"""The synthetic worlds as an environment of Gymnasium (extra `arena`).

Importing this module registers `antway/Crossing-v0`; `gymnasium.make("antway.arena.gym:antway/Crossing-v0")` does both.
"""

from __future__ import annotations

import importlib
import math
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.arena.suites import drawn, load_suite
from antway.errors import BadParameter
from antway.kernels.base.geometry import first_wall
from antway.lazy import drawing
from antway.world.policy import Observation
from antway.world.robots import load_robot
from antway.world.scenario import Scenario, load_scenario
from antway.world.stage import Stage
from antway.world.trace import Outcome

SPAN = 32.0  # m and m/s; observations are clipped to this
RAYS = 16
COMFORT = 0.2  # m; gap to an obstacle below which a step costs


class CrossingEnv(gymnasium.Env[dict[str, Any], NDArray[np.float32]]):
    """Steer a robot through an episode of the suite `synthetic`, which is drawn at each reset.

    An action is the commanded velocity in units of v_max, float32[2] in [-1, 1]; for a robot with wheels it is the speed and
    the turn rate in units of their limits. An observation has three parts:

    * robot, float32[6]: offset of the goal x, y (m), velocity x, y (m/s), cosine and sine of the heading;
    * tracks, float32[tracks, 6]: for the nearest tracks, nearest first, place x, y relative to the robot (m), velocity x, y
      (m/s), radius (m) and 1; rows without a track are 0;
    * walls, float32[16]: how far the robot can go in the directions 2 pi k / 16 before a wall, up to its sensor's range, m.

    The reward is 1 at the goal and -0.25 for a contact. Within 0.2 m of an obstacle it is down to -0.1 for each second (Chen,
    Liu, Kreiss, Alahi: Crowd-robot interaction, ICRA 2019). An episode is terminated by goal or contact, and truncated by its
    horizon; `info["outcome"]` is the reason, and `info["time"]` the time (s).

    Parameters
    ----------
    group : str or None
        Group of the suite, such as "open/low"; None: any.
    tracks : int
        Number of observed tracks, >= 1.
    scenario : Scenario, str or None
        Replaces the suite: a scenario, its file, or the name of a shipped scene; seeds draw its random parts.
    robot : str or None
        Replaces the usual robot: a name or file for `antway.world.robots.load_robot`.
    render_mode : str or None
        "rgb_array": `render` returns a picture, uint8[H, W, 3]; "human": a Matplotlib window shows each step.

    Examples
    --------
    >>> env = gymnasium.make("antway/Crossing-v0", scenario="office", robot="turtlebot4")
    >>> env.reset(seed=1)[1]["group"]
    'office'
    """

    metadata = {"render_modes": ["rgb_array", "human"], "render_fps": 10}  # noqa: RUF012 (Gymnasium's own declaration)

    def __init__(
        self,
        group: str | None = None,
        tracks: int = 8,
        *,
        scenario: Scenario | str | None = None,
        robot: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        if render_mode is not None:
            checks.choice("render_mode", render_mode, self.metadata["render_modes"])
        self.render_mode, self.robot = render_mode, None if robot is None else load_robot(checks.instance("robot", robot, str))
        self.scenario = load_scenario(scenario) if isinstance(scenario, str) else scenario
        if self.scenario is not None:
            checks.instance("scenario", self.scenario, Scenario)
            if group is not None:
                raise BadParameter("group", group, "left out where a scenario is given")
            if self.scenario.stops:
                raise BadParameter("scenario", self.scenario.name, "without stops: an episode here ends at the goal")
        self.suite = load_suite("synthetic")
        self.groups = self.suite.groups if group is None else (checks.choice("group", group, self.suite.groups),)
        self.tracks = checks.integer("tracks", tracks, low=1, high=1000)

        def box(*shape: int) -> gymnasium.spaces.Box:
            return gymnasium.spaces.Box(-SPAN, SPAN, shape, np.float32)

        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
        self.observation_space = gymnasium.spaces.Dict(
            {"robot": box(6), "tracks": box(self.tracks, 6), "walls": gymnasium.spaces.Box(0.0, SPAN, (RAYS,), np.float32)}
        )
        self.stage: Stage | None = None
        self.picture: NDArray[np.uint8] | None = None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Any], dict[str, Any]]:
        """Start an episode; a seed determines it and all that follow."""
        super().reset(seed=seed)
        group = self.groups[int(self.np_random.integers(len(self.groups)))]
        number = int(self.np_random.integers(2**63))
        if self.scenario is None:
            scenario = drawn(self.suite, group, number, self.robot)
        else:
            group = self.scenario.name
            scenario = self.scenario if self.robot is None else self.scenario.driven_by(self.robot)
        self.stage, self.picture = Stage(scenario, number, scenario.horizon), None
        self._display()
        return self._observe(self.stage), {"group": group, "seed": number}

    def step(self, action: NDArray[np.float32]) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Drive for one control period; the robot brakes if a number of the action is NaN."""
        one, two = checks.array("action", action, (2,), finite=False).tolist()
        if self.stage is None:
            raise gymnasium.error.ResetNeeded("reset the environment before the first step and after the last")
        stage = self.stage
        robot = stage.task.robot
        stage.clearance = math.inf  # only the clearance of this step counts
        second = robot.turn_rate if robot.wheels and not stage.stepwise else robot.v_max
        outcome, _ = stage.drive(one * robot.v_max, two * second)
        self._display()
        observation, info = self._observe(stage), {"time": float(stage.t[stage.n])}
        if outcome is None:
            close = min(stage.clearance - COMFORT, 0.0)
            return observation, 0.5 * close * stage.task.robot.dt, False, False, info
        self.picture, self.stage = self._draw() if self.render_mode else None, None
        timeout, reached = outcome is Outcome.TIMEOUT, outcome is Outcome.REACHED
        reward = 0.0 if timeout else 1.0 if reached else -0.25
        return observation, reward, not timeout, timeout, info | {"outcome": outcome.value}

    def render(self) -> NDArray[np.uint8] | None:
        """Return the present picture, uint8[H, W, 3], with render mode "rgb_array"."""
        if self.render_mode != "rgb_array":
            return None
        return self._draw() if self.stage is not None else self.picture

    def _draw(self) -> NDArray[np.uint8]:
        assert self.stage is not None
        trace = self.stage.trace("environment", Outcome.TIMEOUT, "it goes on")
        found: NDArray[np.uint8] = drawing().pixels(trace, self.stage.n)
        return found

    def _display(self) -> None:
        if self.render_mode == "human":
            plot: Any = importlib.import_module("matplotlib.pyplot")
            plot.figure("antway").clear()
            plot.imshow(self._draw())
            plot.axis("off")
            plot.pause(0.001)

    def _observe(self, stage: Stage) -> dict[str, NDArray[np.float32]]:
        o, goal = stage.observe(), stage.task.goal
        robot = (goal[0] - o.xy[0], goal[1] - o.xy[1], *o.velocity, math.cos(o.heading), math.sin(o.heading))
        parts = {"robot": np.array(robot), "tracks": self._nearest(o), "walls": self._walls(stage, o)}
        return {name: np.clip(part, -SPAN, SPAN).astype(np.float32) for name, part in parts.items()}

    def _nearest(self, o: Observation) -> NDArray[np.float64]:
        seen, rows = o.tracks, np.zeros((self.tracks, 6))
        away = seen.xy - o.xy
        order = np.argsort(np.hypot(away[:, 0], away[:, 1]) - seen.radius, kind="stable")[: self.tracks]
        every = np.column_stack((away, np.nan_to_num(seen.velocity), seen.radius, np.ones(len(seen))))
        rows[: len(order)] = every[order]
        return rows

    def _walls(self, stage: Stage, o: Observation) -> NDArray[np.float64]:
        grid, robot = stage.task.grid, stage.task.robot
        (row, col), size = grid.to_points([o.xy])[0].tolist(), grid.resolution
        far, free = min(robot.sensor_range, SPAN), np.empty(RAYS)
        for k in range(RAYS):
            angle = 2 * math.pi * k / RAYS
            dr, dc = far / size * math.sin(angle), far / size * math.cos(angle)
            free[k] = far * min(first_wall(grid.blocked, row, col, dr, dc, robot.radius / size)[0], 1.0)
        return free


gymnasium.register("antway/Crossing-v0", "antway.arena.gym:CrossingEnv")
