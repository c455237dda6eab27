"""The guard: no command passes after which the robot could not stop before an obstacle can reach it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.kernels.guard import BRAKED, guarded
from antway.world.policy import Command, Decision, Observation, Policy, Task

DID = ("free", "slowed", "braked", "stepped-aside")
_STOP = Command((0.0, 0.0))


class Guard:
    """Lets a command pass if its braking path is free of every place that an obstacle could reach before the robot stands.

    Else it passes the fastest command in that direction whose braking path is free, else it brakes. A robot at rest in the way
    of an obstacle steps aside where a free side exists. A silent sensor, and a policy that gives no command, mean stop.

    Parameters
    ----------
    timeout : float
        Age of the last scan at which the sensor counts as silent, s, > 0.
    hold : float
        How long a track that is no longer seen still counts, s, >= 0; what it could reach grows meanwhile.
    lookahead : float
        A robot at rest steps aside for what would touch it within so long, s, >= 0.

    Notes
    -----
    The promise is passive safety: while the robot moves there is no contact, if obstacles keep to the declared bounds of their
    speed (`Task.obstacle_speed`, `Task.obstacle_surge`; they may turn in no time), are seen early enough, and do not drive into
    a robot that has stopped.
    """

    def __init__(self, *, timeout: float = 0.5, hold: float = 0.5, lookahead: float = 1.5) -> None:
        self.timeout = checks.number("timeout", timeout, low=0.0, open_low=True, unit="s")
        self.hold = checks.number("hold", hold, low=0.0, unit="s")
        self.lookahead = checks.number("lookahead", lookahead, low=0.0, unit="s")

    def reset(self, task: Task) -> None:
        """Prepare for `task`."""
        robot, (x, y, _) = task.robot, task.grid.origin
        self.task, self.frame = task, (task.grid.blocked, task.grid.resolution, x, y)
        self.stopping = robot.dt + (0.0 if math.isinf(robot.a_max) else robot.stop_time)
        self.seen: dict[int, tuple[float, NDArray[np.float64]]] = {}
        self.tracks = np.empty((64, 6))
        self.last_stamp = -math.inf
        self.did = ""

    def limit(self, observation: Observation, command: Command | None) -> Command:
        """Return the command that may pass; `did` then says what was done to it."""
        o, robot = observation, self.task.robot
        stamp = o.t if math.isnan(o.stamp) else o.stamp
        if (
            o.t - stamp > self.timeout
            or stamp < self.last_stamp
            or command is None
            or not all(map(math.isfinite, command.velocity))
        ):
            self.did = DID[BRAKED]
            return _STOP
        self.last_stamp = stamp
        tracks = self._within_reach(o, stamp)
        vx, vy, did = guarded(
            *o.xy,
            *o.velocity,
            *command.velocity,
            tracks,
            robot.radius,
            robot.v_max,
            robot.a_max,
            robot.dt,
            self.lookahead,
            *self.frame,
        )
        self.did = DID[did]
        return Command((vx, vy))

    def _within_reach(self, o: Observation, stamp: float) -> NDArray[np.float64]:
        """Rows x, y, vx, vy, radius, bound of all tracks that count; what could have been moved since it was seen widens it."""
        t, task = o.tracks, self.task
        n = len(t)
        if n + len(self.seen) > len(self.tracks):
            self.tracks = np.empty((2 * (n + len(self.seen)), 6))
        rows = self.tracks
        rows[:n, 0:2] = t.xy
        rows[:n, 2:4] = t.velocity
        unknown = np.isnan(rows[:n, 2])
        rows[:n, 2:4][unknown] = 0.0
        rows[:n, 5] = task.obstacle_speed
        if not math.isinf(task.obstacle_surge):
            speed = np.hypot(rows[:n, 2], rows[:n, 3]) + task.obstacle_surge * (self.stopping + o.t - stamp)
            rows[:n, 5] = np.where(unknown, task.obstacle_speed, np.minimum(speed, task.obstacle_speed))
        rows[:n, 4] = t.radius + rows[:n, 5] * (o.t - stamp)
        if t.covariance is not None:
            rows[:n, 4] += 2.0 * np.sqrt(t.covariance[:, 0, 0])
        if self.hold > 0.0:
            ids = t.id.tolist()
            for name, (when, row) in list(self.seen.items()):
                age = o.t - when
                if age > self.hold:
                    del self.seen[name]
                elif name not in ids:
                    rows[n] = row
                    rows[n, 4] += row[5] * age
                    n += 1
            for i, name in enumerate(ids):
                self.seen[name] = (o.t, rows[i].copy())
        return rows[:n]


class Guarded:
    """A policy with a guard between it and the robot.

    Parameters
    ----------
    policy : Policy
    guard : Guard or None
        None: one with the default settings.
    """

    def __init__(self, policy: Policy, guard: Guard | None = None) -> None:
        self.policy, self.guard = policy, Guard() if guard is None else guard

    def reset(self, task: Task, seed: int) -> None:
        """Begin an episode."""
        self.guard.reset(task)
        self.policy.reset(task, seed)

    def act(self, observation: Observation) -> Command:
        """Return what the guard lets pass of the policy's command."""
        return self.guard.limit(observation, self.policy.act(observation))

    def explain(self) -> Decision:
        """Return the policy's reason, and what the guard did."""
        from dataclasses import replace

        return replace(self.policy.explain(), guard=self.guard.did)
