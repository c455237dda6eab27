"""The record of an episode, exact enough to replay it bit for bit, and its file, which can be read safely."""

from __future__ import annotations

import hashlib
import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadScenario
from antway.world.policy import Decision, Task
from antway.world.stops import Rounds
from antway.world.timeline import Timeline
from antway.world.tracefile import beyond_limits, read_fields, to_json
from antway.writing import writing


class Outcome(Enum):
    """How an episode ended.

    A contact is `HIT_MOVING` if the robot was moving at that instant, `HIT_STANDING` if it was at rest. `TIMEOUT`: the horizon
    was reached. `ERROR`: the policy failed, and the robot was braked.

    Examples
    --------
    >>> from antway import load_scenario, run
    >>> run(load_scenario("paper"), "follow", horizon=1.0).outcome is Outcome.TIMEOUT
    True
    """

    REACHED = "reached"
    HIT_MOVING = "hit-moving"
    HIT_STANDING = "hit-standing"
    HIT_WALL = "hit-wall"
    TIMEOUT = "timeout"
    ERROR = "error"


@dataclass(frozen=True, eq=False, repr=False)
class Trace:
    """An episode of N control steps among K obstacles.

    Attributes
    ----------
    task : Task
    policy, scenario : str
        Names.
    seed : int
    t : float64[N + 1]
        Increasing from 0, s. Steps are `task.robot.dt` apart; the last may be cut short by the goal or a contact.
    xy, velocity : float64[N + 1, 2]
        Centre of the robot in m, and its velocity in m/s at arrival there. The velocity is constant over the step before if the
        dynamics are "steps", or without inertia, latency and footprint.
    heading : float64[N + 1]
        rad.
    command : float64[N, 2]
        The commands, before the robot's limits: (vx, vy) in m/s, for wheels (v, omega) in m/s and rad/s; NaN without a
        command.
    timeline : Timeline
        The exact trajectories of all obstacles.
    sensed : bool[N + 1, K]
        Of which obstacles the robot had a track when it decided at t[i] (the last row repeats the one before).
    decisions : tuple of (step, Decision)
        The policy's decisions, with the step of each new one.
    cycle_ms : float64[N]
        Wall time of the policy, ms; the only part that differs between two equal runs.
    outcome : Outcome
    reason : str
        One sentence about the outcome.
    config : mapping
        How the episode was set up, as JSON values: version, sensor, horizon.
    turn_rate : float64[N + 1]
        Of wheels, rad/s.
    rounds : Rounds or None
        The stops, if the scenario has any, and how they were visited.
    """

    task: Task
    policy: str
    seed: int
    scenario: str
    t: NDArray[np.float64]
    xy: NDArray[np.float64]
    velocity: NDArray[np.float64]
    heading: NDArray[np.float64]
    command: NDArray[np.float64]
    timeline: Timeline
    sensed: NDArray[np.bool_]
    decisions: tuple[tuple[int, Decision], ...]
    cycle_ms: NDArray[np.float64]
    outcome: Outcome
    reason: str = ""
    config: Mapping[str, Any] = field(default_factory=dict)
    rounds: Rounds | None = None
    turn_rate: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def __post_init__(self) -> None:
        if not len(self.turn_rate):
            object.__setattr__(self, "turn_rate", np.zeros(len(self.t)))
        for name in ("t", "xy", "velocity", "heading", "turn_rate", "command", "sensed", "cycle_ms"):
            array = getattr(self, name)
            if array.flags.writeable:  # whoever gave it may go on writing to it
                object.__setattr__(self, name, array := array.copy())
                array.flags.writeable = False

    def __repr__(self) -> str:
        """Return one line, because arrays of an episode fill a screen hundreds of times."""
        name, seconds = self.scenario or "no name", float(self.t[-1])
        return f"Trace({name!r}, policy {self.policy!r}, {len(self)} steps in {seconds:.2f} s: {self.outcome.value})"

    def __len__(self) -> int:
        """Return the number of control steps."""
        return len(self.command)

    @property
    def obstacle_id(self) -> NDArray[np.int64]:
        """int64[K]."""
        return self.timeline.id

    @property
    def obstacle_radius(self) -> NDArray[np.float64]:
        """float64[K], m."""
        return self.timeline.radius

    @cached_property
    def obstacle_xy(self) -> NDArray[np.float64]:
        """The obstacles' places at each `t`, float64[N + 1, K, 2], m."""
        places = self.timeline.places(self.t)
        places.flags.writeable = False
        return places

    @property
    def length(self) -> float:
        """Length of the path driven, m."""
        return math.fsum(np.hypot(*np.diff(self.xy, axis=0).T).tolist())

    def decision_at(self, step: int) -> Decision | None:
        """Return the decision that was valid in control step `step`, if any."""
        return next((decision for i, decision in reversed(self.decisions) if i <= step), None)

    def digest(self) -> str:
        """Return the SHA-256 of everything but `cycle_ms`: two runs are the same if and only if their digests agree."""
        return hashlib.sha256(to_json(self).encode()).hexdigest()

    def save(self, path: str | Path, *, timing: bool = False) -> None:
        """Write the trace as JSON with exact numbers; `cycle_ms`, which differs between equal runs, only with `timing`.

        Warns
        -----
        UserWarning
            If it is beyond a limit of `load` (docs/limits.md), as those of hundreds of thousands of steps are.
        """
        text = to_json(self, timing=timing) + "\n"
        with writing("path", path) as file:
            file.write_text(text, encoding="utf-8")
        excess = beyond_limits(self, text)
        if excess:
            warnings.warn(f"{path}: Trace.load refuses a trace of {excess}", stacklevel=2)

    @staticmethod
    def load(path: str | Path) -> Trace:
        """Read what `save` wrote.

        Raises
        ------
        BadScenario, TooLarge
            If the file cannot be read as a trace (the error names the key), or exceeds the limit.
        """
        if not isinstance(path, (str, PathLike)):
            raise BadScenario("path", path, "a path")
        fields = read_fields(Path(path))
        outcome = checks.choice("outcome", fields["outcome"], [o.value for o in Outcome], where=str(path))
        return Trace(**fields | {"outcome": Outcome(outcome)})
