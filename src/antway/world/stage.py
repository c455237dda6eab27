"""The simulated part of an episode: the robot, the obstacles, what the robot senses, and the record of all this."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from antway import checks
from antway.errors import BadScenario
from antway.kernels.base.jit import call
from antway.kernels.robot.contact import GOES_ON, HIT_MOVING, HIT_WALL, REACHED, Record, advance
from antway.kernels.robot.cycle import play
from antway.kernels.robot.motion import REST
from antway.world.entries import Entries
from antway.world.policy import Command, Observation
from antway.world.pursuit import Pursuit
from antway.world.robots import body_gap
from antway.world.scenario import MAX_STEPS, Scenario
from antway.world.sensor import Scanner
from antway.world.terrain import body_of, terrain_of, walls_of
from antway.world.trace import Outcome, Trace


class Stage:
    """Robot, obstacles and record of one episode, driven one control cycle at a time by commands from outside.

    The arrays of the record are as in `Trace` with `steps` control cycles, of which `n` have been played and are filled.
    """

    def __init__(self, scenario: Scenario, seed: int, horizon: float) -> None:
        self.scenario, self.seed, self.horizon = scenario, seed, horizon
        task = self.task = scenario.task
        spec = task.robot
        self.steps = checks.integer("horizon / dt", math.ceil(horizon / spec.dt - 1e-9), low=1, high=MAX_STEPS)
        self.pursuit = Pursuit(scenario.world, task, seed, horizon, self.steps)
        self.timeline = self.pursuit.timeline  # as far as it is known: what depends on the robot grows with the episode
        self.entries = Entries(scenario.world, task)
        self.scanner = Scanner(scenario.sensor, task, self.timeline, seed)
        self.aim = np.array([*task.goal, task.goal_tolerance])
        rows = self.steps + 1
        self.t, self.xy, self.velocity, self.heading = np.zeros(rows), np.zeros((rows, 2)), np.zeros((rows, 2)), np.zeros(rows)
        self.turn_rate, self.sensed = np.zeros(rows), np.zeros((rows, len(self.timeline)), np.bool_)
        self.command, self.cycle_ms = np.full((self.steps, 2), math.nan), np.zeros(self.steps)
        self.xy[0] = task.start
        self.heading[0] = math.atan2(task.goal[1] - task.start[1], task.goal[0] - task.start[0])
        self.n, self.clearance = 0, math.inf  # m; the smallest distance so far between the edges of robot and obstacles
        self._check_start()
        self.pursuit.extend(0, task.start)
        self.limits, self.stepwise = spec.limits, spec.stepwise
        self.log = Record(self.t, self.xy, self.velocity, self.heading, self.turn_rate, self.command)
        if self.stepwise:
            self.terrain = terrain_of(task.grid)
        else:
            self.late = spec.late_commands
            self.body, self.walls = body_of(spec), walls_of(task.grid)

    def _check_start(self) -> None:
        """Refuse an obstacle that touches the robot at the start."""
        places = self.timeline.places(self.t[:1])[0]
        gaps = body_gap(self.task.robot, self.xy[0], self.heading[0], places) - self.timeline.radius
        for k in np.flatnonzero(gaps < 0.0).tolist():
            allowed = f"clear of the robot at {self.task.start} (overlap {-gaps[k]:.3g} m)"
            raise BadScenario(f"obstacles[{k}].start", tuple(places[k].tolist()), allowed)

    @property
    def at_rest(self) -> bool:
        """Whether the robot stands now."""
        return math.hypot(*self.velocity[self.n].tolist()) <= REST and abs(float(self.turn_rate[self.n])) <= REST

    def end_at_goal(self, ends: bool) -> None:
        """Say whether the episode ends when the robot reaches the goal; it does not while there are stops to be visited."""
        self.aim[2] = self.task.goal_tolerance if ends else -1.0

    def observe(self) -> Observation:
        """Return what the robot senses now."""
        i = self.n
        now, (x, y), (vx, vy) = float(self.t[i]), self.xy[i].tolist(), self.velocity[i].tolist()
        stamp, tracks, seen = self.scanner.observe(now, x, y)
        self.sensed[i, seen] = True
        pending = None
        if not self.stepwise and self.late:
            pending = np.zeros((self.late, 2))
            known = min(self.late, i)
            late = self.command[i - known : i]
            pending[self.late - known :] = np.where(np.isfinite(late).all(axis=1, keepdims=True), late, 0.0)  # none: stop
        return Observation(now, (x, y), (vx, vy), float(self.heading[i]), tracks, stamp, float(self.turn_rate[i]), pending)

    def controls(self, command: Command | None, observation: Observation) -> tuple[float, float]:
        """Return the two numbers of a command that the robot follows, for `drive`; NaN if there is no command."""
        if command is None:
            return math.nan, math.nan
        robot = self.task.robot
        plain = self.stepwise and robot.wheels
        one, two = command.plain('the dynamics "steps"') if plain else command.acts(observation, robot)
        return float(one), float(two)

    def drive(self, one: float, two: float) -> tuple[Outcome | None, str]:
        """Drive one control cycle by the two numbers of a command: (vx, vy), for wheels (v, omega).

        Return the outcome, or None if the episode continues, and the reason.
        """
        self.command[self.n] = one, two
        event, obstacle, clearance = self._drive()
        self.n, self.clearance = self.n + 1, min(self.clearance, clearance)
        if event == GOES_ON:
            self._extend_timeline()
            late = self.n == self.steps
            return (Outcome.TIMEOUT, f"the horizon of {self.horizon:g} s came first") if late else (None, "")
        if event == REACHED:
            return Outcome.REACHED, "the robot is at the goal"
        if event == HIT_WALL:
            return Outcome.HIT_WALL, "the robot ran into a wall"
        met = f"obstacle {self.timeline.id[obstacle]} met the robot, which"
        moving = event == HIT_MOVING
        return (Outcome.HIT_MOVING, f"{met} was moving") if moving else (Outcome.HIT_STANDING, f"{met} was at rest")

    def _drive(self) -> tuple[int, int, float]:
        """Drive one control cycle; return the event, the obstacle in contact, and the smallest distance, m."""
        dt, obstacles = self.task.robot.dt, self.timeline.trajectories
        if not self.stepwise:
            return play(self.n, dt, self.limits, self.body, self.log, self.aim, self.walls, obstacles, self.clearance)
        return call(advance, self.n, dt, self.limits, self.aim, self.log, self.terrain, obstacles)

    def _extend_timeline(self) -> None:
        """Move the obstacles that depend on the robot for the next control cycle."""
        x, y = self.xy[self.n].tolist()
        self.pursuit.extend(self.n, (x, y))
        line = self.entries.update(self.n, (x, y), self.timeline)
        if line is not self.timeline:
            self.timeline = self.scanner.timeline = self.pursuit.use(line)

    def trace(self, policy: str, outcome: Outcome, reason: str, **more: Any) -> Trace:
        """Return the record so far, with these descriptions of the episode, and `more` fields of `Trace`."""
        n = self.n
        return Trace(
            task=self.task,
            policy=policy,
            seed=self.seed,
            scenario=self.scenario.name,
            **{name: getattr(self, name)[: n + 1] for name in ("t", "xy", "velocity", "heading", "turn_rate")},
            **{name: getattr(self, name)[:n] for name in ("command", "cycle_ms")},
            timeline=self.timeline,
            sensed=np.concatenate((self.sensed[:n], self.sensed[max(n - 1, 0) : max(n, 1)])),
            outcome=outcome,
            reason=reason,
            **{"decisions": (), **more},
        )
