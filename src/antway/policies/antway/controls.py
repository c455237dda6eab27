"""The colony in the space of controls at work: what a robot with inertia or wheels drives, on top of its plan."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from antway.grid import Grid
from antway.kernels.base.jit import entry
from antway.kernels.base.rng import stream
from antway.kernels.controls.colony import Archive, ColonySettings, forage, shift
from antway.kernels.controls.rollout import (
    CostWeights,
    Outlook,
    StaticField,
    beyond_walls,
    judge,
    look_ahead,
    spread_plan,
    wall_distance,
)
from antway.kernels.robot.motion import delayed
from antway.planning import TimedPath
from antway.world.policy import XY, Command, Observation, Task
from antway.world.robots import RobotSpec

_NODE = 0.05  # m; distances to walls are exact at nodes no farther apart
_NODES = 4_000_000  # at most
_LAYERS = 4  # cells by which the time to the goal is continued into walls
_DISCS = 64  # at most, near one another at one time
_ALIKE = 0.3  # m; paths no farther apart are one
_FAST = 1e3  # m/s^2, rad/s^2: as good as at once

RobotState = tuple[float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class ControlOptions:
    """Numbers of the colony in the space of controls; times in s, lengths in m.

    Attributes
    ----------
    horizon, block : float
        Length of a sequence, and of the spans in it that share a draw.
    archive, rounds, ants : int
        Sequences kept; rounds a cycle, and ants a round.
    choosiness, breath, curious : float
        Guides are picked by rank with a spread of `choosiness` times the archive; ants leave them by `breath` times the
        archive's mean distance; the share `curious` of them farther.
    progress, off_plan, trust : float
        Weight of the time to go at each step; s for each m off the plan; by how much s the plan's arrival may be bettered.
    margin, wished, near : float
        Room kept to obstacles, room wished for beyond, and s for each m less at each step.
    wall_margin : float
        Room kept to walls.
    contact, decay : float
        s for a contact foreseen, fading by 1/s.
    stop : float
        s for each m by which a stop could be cut off that the guard would not allow.
    """

    horizon: float = 3.0
    block: float = 0.5
    archive: int = 24
    rounds: int = 8
    ants: int = 60
    choosiness: float = 0.15
    breath: float = 0.85
    curious: float = 0.15
    progress: float = 0.02
    off_plan: float = 0.5
    trust: float = 0.3
    margin: float = 0.03
    wished: float = 0.12
    near: float = 0.2
    wall_margin: float = 0.03
    contact: float = 30.0
    decay: float = 0.3
    stop: float = 10.0


class ControlColony:
    """Turns predictions and a plan into the command of the next period."""

    def __init__(
        self, options: ControlOptions, task: Task, time_to_goal: NDArray[np.float64], seed: int, guarded: bool
    ) -> None:
        robot, o = task.robot, options
        self.options, self.robot = o, robot
        self.limits = robot.limits._replace(
            a_max=min(robot.a_max, _FAST), brake_max=min(robot.braking, _FAST), alpha_max=min(robot.alpha_max, _FAST)
        )
        self.field = static_field(task.grid, robot, time_to_goal, task.goal, task.goal_tolerance)
        steps = max(math.ceil(o.horizon / robot.dt - 1e-9), 4)
        block = max(round(o.block / robot.dt), 1)
        self.outlook = Outlook(np.zeros(steps, np.int64), np.zeros((steps, _DISCS, 8)), np.full((steps, 3), -math.inf))
        self.outlook.plan[:, :2] = 0.0
        self.archive = Archive(
            np.zeros((o.archive, steps, 2)),
            np.full(o.archive, math.inf),
            np.zeros(o.archive, np.int64),
            np.zeros((o.archive, -(-steps // block), 2)),
            np.zeros(1, np.int64),
            np.zeros((steps, 2)),
            np.empty((0, 2)),
        )
        turn = robot.turn_rate if robot.wheels else robot.v_max
        self.settings = ColonySettings(
            rounds=o.rounds,
            ants=o.ants,
            block=block,
            choosiness=o.choosiness,
            breath=o.breath,
            least_a=0.03 * robot.v_max,
            least_b=0.03 * turn,
            curious=o.curious,
            wide_a=0.35 * robot.v_max,
            wide_b=0.35 * turn,
        )
        self.reaction = robot.latency + robot.dt
        self.weights = CostWeights(
            progress=o.progress,
            contact=o.contact,
            depth=o.contact,
            decay=o.decay,
            near=o.near,
            wall=100.0,
            wall_margin=o.wall_margin,
            off_plan=o.off_plan,
            stop=o.stop if guarded else 0.0,
            stopping_time=self.reaction,
            swerve=float(task.obstacle_swerve),
        )
        self.braking = self.reaction + robot.v_max / self.limits.brake_max
        self.growth = min(float(task.obstacle_surge) * self.braking, 1e3)
        self.speed_bound = float(task.obstacle_speed)
        self.random = np.array([stream(np.uint64(seed), np.uint64(1))], np.uint64)
        self.xy = np.zeros((steps, 2))
        self.path: TimedPath | None = None
        self.state = np.zeros(5)
        self.start = 0.0

    def act(
        self,
        observation: Observation,
        start: float,
        state: RobotState,
        segments: NDArray[np.float64],
        knots: NDArray[np.float64],
        arrival: float,
    ) -> Command:
        """Return the command that begins to act at `start` s, when the robot is in `state`.

        Parameters
        ----------
        observation : Observation
            Whose heading turns a twist into a velocity.
        start : float
        state : x, y, heading, and (v, omega) or (vx, vy)
        segments : float64[P, 8]
            Predicted motion.
        knots : float64[N, 3]
            The plan (t, x, y); may be empty.
        arrival : float
            Of the plan, s.
        """
        self.state[:], self.start = state, start
        dt, o = self.robot.dt, self.options
        look = (
            segments,
            start,
            dt,
            self.state,
            self.robot.v_max,
            self.braking,
            o.margin,
            o.wished,
            self.speed_bound,
            self.growth,
        )
        entry(look_ahead, *look, self.outlook)(*look, self.outlook)
        if len(knots):
            plan = knots, len(knots), start, dt, arrival, o.trust, self.outlook.plan
            entry(spread_plan, *plan)(*plan)
        else:
            self.outlook.plan[:, 2] = -math.inf
        shift(self.archive)
        known = self.archive, self.settings, self.state, self.limits, dt, self.field, self.outlook, self.weights, self.random
        entry(forage, *known)(*known)
        one, two = self.archive.sequence[self.archive.order[0], 0].tolist()
        if not self.robot.wheels:
            return Command((one, two))
        return Command((one * math.cos(observation.heading), one * math.sin(observation.heading)), (one, two))

    def others(self) -> NDArray[np.float64]:
        """Return the first commands of all other sequences kept, best first, float64[N, 2]."""
        n = int(self.archive.used[0])
        others: NDArray[np.float64] = self.archive.sequence[self.archive.order[1:n], 0]
        return others

    def same_path(self) -> bool:
        """Tell whether the best ant goes where `path` does; if not, `path` is what it does from now on."""
        best = self.archive.sequence[self.archive.order[0]]
        known = self.state, self.limits, self.robot.dt, self.field, self.outlook, self.weights, math.inf
        judge(best, *known, self.xy)
        t = self.start + self.robot.dt * np.arange(len(best) + 1.0)
        path = TimedPath(t, np.vstack((self.state[:2], self.xy)))
        if self.path is not None and _alike(self.path, path):
            return True
        self.path = path
        return False


def has_inertia(robot: RobotSpec) -> bool:
    """Tell whether a robot's speed takes time to change, so that the colony in the space of controls drives it."""
    return not robot.stepwise and math.isfinite(robot.a_max)


def acting(o: Observation, robot: RobotSpec) -> tuple[float, Observation, RobotState]:
    """Return after how many s a command given now begins to act, and what is known of the robot and its state then."""
    one, two = (o.speed, o.turn_rate) if robot.wheels else o.velocity
    state = float(o.xy[0]), float(o.xy[1]), float(o.heading), float(one), float(two)
    if robot.latency == 0.0 or o.pending is None:
        return 0.0, o, state
    state = delayed(*state, o.pending, robot.limits, robot.dt)
    return robot.latency, replace(o, t=o.t + robot.latency, xy=state[:2]), state


def _alike(one: TimedPath, other: TimedPath) -> bool:
    """Tell whether two paths are near each other for as long as both last, and for a second at least."""
    start, end = max(one.t[0], other.t[0]), min(one.t[-1], other.t[-1])
    if end < start + 1.0:
        return False
    t = np.linspace(start, end, 8)
    dx, dy = (np.interp(t, one.t, one.xy[:, i]) - np.interp(t, other.t, other.xy[:, i]) for i in range(2))
    return float(np.hypot(dx, dy).max()) < _ALIKE


def static_field(grid: Grid, robot: RobotSpec, time_to_goal: NDArray[np.float64], goal: XY, tolerance: float) -> StaticField:
    """Return the map as the centre of a robot meets it.

    Parameters
    ----------
    time_to_goal : float64[H, W]
        s to the goal at full speed, infinite where the robot cannot be.
    """
    size, (x, y, _), cells = grid.resolution, grid.origin, grid.blocked.size
    factor = max(min(math.ceil(size / _NODE - 1e-9), math.isqrt(_NODES // cells)), 1)
    wall = wall_distance(grid.blocked, size, factor) - np.float32(robot.radius)
    time = beyond_walls(time_to_goal - tolerance / robot.v_max, 2.0 * size / robot.v_max, _LAYERS)
    return StaticField(
        wall,
        np.array([x, y, factor / size]),
        time,
        np.array([x + size / 2, y + size / 2, 1.0 / size]),
        np.array([*goal, tolerance]),
    )
