"""Where moving obstacles are at every instant: discs on piecewise linear trajectories."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway.errors import BadScenario
from antway.kernels.base.geometry import timeline_at
from antway.kernels.base.records import Trajectories

Trajectory = tuple[NDArray[np.float64], NDArray[np.float64]]  # t float64[M] in s, xy float64[M, 2] in m
COLUMNS = {"id": np.int64, "radius": np.float64, "knot_t": np.float64, "knot_xy": np.float64, "first": np.int64}


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """The exact trajectories of K discs, in the layout that all kernels use.

    Disc k has the knots `first[k] <= i < first[k + 1]`. It is at `knot_xy[i]` at time `knot_t[i]`, moves straight at constant
    speed in between, and stands before the first knot and after the last.

    Raises
    ------
    BadScenario
        If the arrays do not fit together or contain numbers that are not finite.

    Examples
    --------
    >>> course = Timeline.of([7], [0.3], [([0.0, 2.0], [(0.0, 0.0), (4.0, 0.0)])])
    >>> course.at(0.5)[0].tolist()
    [[1.0, 0.0]]
    """

    id: NDArray[np.int64]  # [K] distinct
    radius: NDArray[np.float64]  # [K] m, > 0
    knot_t: NDArray[np.float64]  # [M] s, strictly increasing within a disc
    knot_xy: NDArray[np.float64]  # [M, 2] m
    first: NDArray[np.int64]  # [K + 1] first[0] = 0, first[K] = M; each disc has at least one knot

    def __post_init__(self) -> None:
        for name, kind in COLUMNS.items():
            given = getattr(self, name)
            try:
                with np.errstate(invalid="ignore"):
                    array: NDArray[Any] = np.ascontiguousarray(given, dtype=kind)
                if kind is np.int64 and not np.array_equal(array, given):
                    raise ValueError
            except (TypeError, ValueError, OverflowError):
                allowed = "integers of 64 bits" if kind is np.int64 else "numbers"
                raise BadScenario(f"timeline.{name}", given, f"an array of {allowed}") from None
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        count, knots = len(self.id), len(self.knot_t)
        shapes = {"id": (count,), "radius": (count,), "knot_t": (knots,), "knot_xy": (knots, 2), "first": (count + 1,)}
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise BadScenario(f"timeline.{name}.shape", getattr(self, name).shape, str(shape))
        if len(np.unique(self.id)) != count:
            raise BadScenario("timeline.id", self.id.tolist(), "distinct")
        if not (np.isfinite(self.radius).all() and (self.radius > 0).all()):
            raise BadScenario("timeline.radius", self.radius.tolist(), "finite and > 0 (m)")
        if self.first[0] != 0 or self.first[-1] != knots or (np.diff(self.first) < 1).any():
            raise BadScenario("timeline.first", self.first.tolist(), f"increasing from 0 to {knots}")
        for name, unit in (("knot_t", "s"), ("knot_xy", "m")):
            if not np.isfinite(getattr(self, name)).all():
                raise BadScenario(f"timeline.{name}", "a number that is not finite", f"finite throughout ({unit})")
        rising = np.diff(self.knot_t) > 0
        rising[self.first[1:-1] - 1] = True
        if not rising.all():
            raise BadScenario("timeline.knot_t", float(self.knot_t[int(np.argmin(rising)) + 1]), "strictly increasing (s)")

    @staticmethod
    def of(ids: Sequence[int], radii: Sequence[float], trajectories: Sequence[tuple[ArrayLike, ArrayLike]]) -> Timeline:
        """Return the timeline of discs with these ids, radii (m) and trajectories (t in s, xy in m)."""
        t = [np.asarray(trajectory[0], np.float64) for trajectory in trajectories]
        xy = [np.asarray(trajectory[1], np.float64).reshape(-1, 2) for trajectory in trajectories]
        for k, (times, places) in enumerate(zip(t, xy)):
            if len(times) != len(places):
                raise BadScenario(f"timeline.knot_xy of disc {k}", len(places), f"a place for each of {len(times)} times")
        return Timeline(
            np.array(ids),
            np.array(radii),
            np.concatenate(t) if t else np.empty(0),
            np.concatenate(xy) if xy else np.empty((0, 2)),
            np.cumsum([0, *map(len, t)], dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self.id)

    @property
    def trajectories(self) -> Trajectories:
        """The same as a record for kernels."""
        return Trajectories(self.knot_t, self.knot_xy, self.first, self.radius)

    def trajectory(self, k: int) -> Trajectory:
        """Return the knots of disc number k."""
        low, high = self.first[k], self.first[k + 1]
        return self.knot_t[low:high], self.knot_xy[low:high]

    def with_trajectories(self, trajectories: Mapping[int, Trajectory]) -> Timeline:
        """Return the timeline with other trajectories of the discs with these numbers."""
        every = [trajectories[k] if k in trajectories else self.trajectory(k) for k in range(len(self))]
        return Timeline.of(self.id.tolist(), self.radius.tolist(), every)

    def at(self, t: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return places in m and velocities in m/s at time t, float64[K, 2] each."""
        trajectories = self.trajectories
        states = [timeline_at(float(t), trajectories, k) for k in range(len(self))]
        both = np.array(states, np.float64).reshape(-1, 4)
        return both[:, :2], both[:, 2:]

    def places(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the places at all times `t`, float64[N, K, 2] in m."""
        out = np.empty((len(t), len(self), 2))
        for k in range(len(self)):
            knot_t, knot_xy = self.trajectory(k)
            for axis in (0, 1):
                out[:, k, axis] = np.interp(t, knot_t, knot_xy[:, axis])
        return out
