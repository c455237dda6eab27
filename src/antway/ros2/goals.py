"""What the pilot is asked, and what it answers; no ROS import."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from antway.world.policy import XY, Command

OK, WARN, ERROR = 0, 1, 2  # levels of diagnostic_msgs/msg/DiagnosticStatus
STAND = Command((0.0, 0.0))


class End(Enum):
    """How the drive to a goal ended."""

    ARRIVED = "arrived"
    REPLACED = "replaced"  # by another goal
    DROPPED = "dropped"  # on request
    REFUSED = "refused"  # the robot cannot stand there
    WAITED = "waited"  # longer than its `wait_timeout`, without map, odometry, obstacles or a place to set out from
    STUCK = "stuck"  # made no progress


@dataclass(frozen=True, slots=True)
class PilotAnswer:
    """What to do, in the map's frame, and why; `end` is set when the goal has ended."""

    command: Command
    level: int
    reason: str
    end: End | None = None

    @property
    def drives(self) -> bool:
        """Whether the policy drives, or the guard's stop still turns."""
        return self.command is not STAND


@dataclass(frozen=True, slots=True)
class Goal:
    """A goal."""

    xy: XY  # m
    path: NDArray[np.float64] | None = None  # float64[N, 2], m; the robot stays within `corridor` m of it
    gives_up: bool = False  # whether the robot gives the goal up after `wait_timeout`, or without progress
    yaw: float = math.nan  # rad; final heading of wheels; NaN: any
