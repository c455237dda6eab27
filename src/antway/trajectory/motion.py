"""A motion: poses, velocities and turn rates over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway import checks


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Poses and velocities at the knots of a motion, all in the map's frame.

    Between two knots wheels change speed and turn rate linearly in time and roll along their heading; a holonomic robot changes
    its velocity linearly. `antway.verify_drive.check_motion` checks a motion against a map and a robot.

    Attributes
    ----------
    t : float64[N]
        s, increasing from 0.
    xy : float64[N, 2]
        m.
    heading : float64[N]
        rad, not wrapped.
    velocity : float64[N, 2]
        m/s.
    turn_rate : float64[N]
        rad/s.
    """

    t: NDArray[np.float64]
    xy: NDArray[np.float64]
    heading: NDArray[np.float64]
    velocity: NDArray[np.float64]
    turn_rate: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("t", "xy", "heading", "velocity", "turn_rate"):
            array = checks.raw(name, getattr(self, name), "an array of numbers").copy()
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    def __repr__(self) -> str:
        return f"Motion({self.time:.2f} s, {self.length:.2f} m)"

    @property
    def time(self) -> float:
        """Duration, s."""
        return float(self.t[-1])

    @property
    def length(self) -> float:
        """Length of the path, m."""
        return float(np.hypot(*np.diff(self.xy, axis=0).T).sum())
