"""The robot's sensor for moving obstacles: range, occlusion, rate, latency, noise, losses, and velocity."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter
from antway.kernels.base.jit import call
from antway.kernels.base.rng import stream
from antway.kernels.robot.sensor import Errors, degrade, scan
from antway.limits import MAX_PLACE, MAX_SPEED, MAX_TIME, MIN_PERIOD
from antway.world.policy import Task, Tracks
from antway.world.terrain import terrain_of
from antway.world.timeline import Timeline

_STREAM = 2**32  # random stream of the episode's seed; smaller numbers are for obstacles


@dataclass(frozen=True, slots=True)
class Sensor:
    """How well the robot senses moving obstacles; its range is `RobotSpec.sensor_range`.

    Parameters
    ----------
    period : float
        Time between scans in s, >= 0; 0: a scan in each control cycle. Between scans the last one remains.
    latency : float
        Age at which a scan reaches the policy, s, >= 0.
    occlusion : bool
        Whether walls hide obstacles.
    dropout : float
        Probability in [0, 1] that a scan misses an obstacle.
    noise : float
        Standard deviation of the places, m, >= 0.
    velocity : str
        "exact" (with `velocity_noise`), "estimated" from the places by a Kalman filter, or "none" (NaN).
    velocity_noise : float
        Standard deviation of exact velocities, m/s, >= 0.
    agility : float
        Acceleration of obstacles that the estimate assumes, m/s^2, > 0.
    """

    period: float = 0.0
    latency: float = 0.0
    occlusion: bool = True
    dropout: float = 0.0
    noise: float = 0.0
    velocity: str = "exact"
    velocity_noise: float = 0.0
    agility: float = 1.0

    def __post_init__(self) -> None:
        checks.fields(self, "period", "latency", low=0.0, high=MAX_TIME, unit="s")
        checks.fields(self, "noise", low=0.0, high=MAX_PLACE, unit="m")
        checks.fields(self, "velocity_noise", low=0.0, high=MAX_SPEED, unit="m/s")
        if 0.0 < self.period < MIN_PERIOD:
            raise BadParameter("period", self.period, f"0 (each control cycle), or at least {MIN_PERIOD:g} (s)")
        checks.fields(self, "dropout", low=0.0, high=1.0)
        checks.fields(self, "agility", low=0.0, high=MAX_SPEED / MIN_PERIOD, open_low=True, unit="m/s^2")
        checks.choice("velocity", self.velocity, ("exact", "estimated", "none"))
        if not isinstance(self.occlusion, bool):
            raise BadParameter("occlusion", self.occlusion, "true or false")


class Scan(NamedTuple):
    """What the robot knows of the obstacles."""

    stamp: float  # s; time of the scan, minus infinity before the first one
    tracks: Tracks
    seen: NDArray[np.int64]  # [K] numbers of the sensed obstacles in the timeline, in the order of the tracks


class Scanner:
    """A sensor at work in one episode."""

    def __init__(self, sensor: Sensor, task: Task, timeline: Timeline, seed: int) -> None:
        self.sensor, self.timeline = sensor, timeline
        self.sensor_range, self.terrain = task.robot.sensor_range, terrain_of(task.grid)
        self.seed = np.uint64(stream(np.uint64(seed), np.uint64(_STREAM)))
        count = len(timeline)
        self.seen, self.state = np.empty(count, np.int64), np.empty((count, 4))
        self.plain = sensor.dropout == sensor.noise == sensor.velocity_noise == 0.0 and sensor.velocity == "exact"
        if not self.plain:
            self.tracker, self.covariance = np.full((count, 8), math.nan), np.empty((count, 4, 4))
        self.scans, self.due = 0, 0.0
        self.in_transit: deque[Scan] = deque()
        self.latest = Scan(-math.inf, Tracks.none(), np.empty(0, np.int64))

    def observe(self, t: float, x: float, y: float) -> Scan:
        """Return what the robot at (x, y) m knows at t s."""
        if t >= self.due - 1e-9:
            self.in_transit.append(self._scan(t, x, y))
            if self.sensor.period > 0.0:
                self.due = self.sensor.period * (math.floor((t + 1e-9) / self.sensor.period) + 1)
        while self.in_transit and t >= self.in_transit[0].stamp + self.sensor.latency - 1e-9:
            self.latest = self.in_transit.popleft()
        return self.latest

    def _scan(self, t: float, x: float, y: float) -> Scan:
        """Return a new scan."""
        line, sensor = self.timeline, self.sensor
        at, out = (float(t), float(x), float(y)), (self.seen, self.state)
        n = call(scan, *at, self.sensor_range, sensor.occlusion, self.terrain, line.trajectories, *out)
        covariance = None
        if not self.plain:
            agility = sensor.agility if sensor.velocity == "estimated" else 0.0
            errors = Errors(sensor.dropout, sensor.noise, sensor.velocity_noise, max(1.0, 1.5 * sensor.period), agility)
            n = degrade(n, t, self.seed, self.scans, errors, self.seen, self.state, self.tracker, self.covariance)
            covariance = self.covariance[:n].copy()
        self.scans += 1
        seen, xy, velocity = self.seen[:n].copy(), self.state[:n, :2].copy(), self.state[:n, 2:].copy()
        if sensor.velocity == "none":
            velocity[:] = math.nan
        tracks = Tracks(line.id[seen], xy, velocity, line.radius[seen], covariance)
        return Scan(t, tracks, seen)
