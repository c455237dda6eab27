"""What else a robot could do about an obstacle, and what it would cost: to pass on its other side, or to wait."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import overload

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.records import CLEARANCE_RADIUS, CONTACT_RADIUS, T0, T1, VX, VY, Predictions, Terrain, X
from antway.kernels.crossing import Settings
from antway.kernels.spacetime.alternatives import free_time, passing
from antway.kernels.spacetime.ants import search
from antway.kernels.spacetime.context import PlanningContext
from antway.kernels.spacetime.memory import KNOTS, Memory
from antway.kernels.spacetime.motion import first_conflict, shorten, trace_back
from antway.kernels.tracking.predict import predict, time_shift
from antway.planning import TimedPath
from antway.policies.antway.state import make_memory, make_trails
from antway.world.policy import XY

CROSSING = ("pass in front", "pass behind")
ELSE = ("go round left", "go round right")
_WAITS, _LEG = 0.25, 0.5  # s between the waits that are tried, and of a leg of the path on which they are
_PAST = 1.0  # s; that long after the time at which a conflict was to begin it is over
_WALL = 3.0  # m; so far to one side of an obstacle the path is closed, to see what it would cost to pass on the other
_APART = 1.5  # times their radius: so close together discs leave no gap


@dataclass(frozen=True, slots=True, eq=False)
class Situation:
    """What a cycle knew; enough to weigh later on what else could have been done."""

    context: PlanningContext
    settings: Settings
    terrain: Terrain
    now: float  # s
    age: float  # s, of the track estimates
    xy: XY  # m, of the robot
    estimates: NDArray[np.float64]  # [K, 8]
    prediction: NDArray[np.float64]  # [K, STEPS, 2]
    segments: NDArray[np.float64]  # [P, 8]

    def _predictions(self, segments: NDArray[np.float64]) -> Predictions:
        return Predictions(segments, time_shift(self.settings.tubes), np.empty(2))

    def free(self) -> float:
        """Return the time to the goal if nothing moved, s."""
        return float(free_time(self.context, *self.xy, self.settings.colony.leg_cells))

    def segments_of(self, k: int) -> NDArray[np.float64]:
        """Return the prediction of track k alone, in order of time."""
        s, out, one = self.settings, np.empty((256, 8)), slice(k, k + 1)
        count = predict(
            self.estimates[one], self.now, self.age, s.horizon, *self.xy, s.tubes, self.terrain, self.prediction[one], out
        )
        return out[:count]

    def path(self, segments: NDArray[np.float64], memory: Memory | None = None) -> TimedPath | None:
        """Return the path among `segments` that the colony finds, or None; without a `memory` to work in it makes one."""
        context, s, (x, y) = self.context, self.settings, self.xy
        memory = make_memory(context.field.size) if memory is None else memory
        trails, state = make_trails(context.field.size), np.zeros(1, np.uint64)
        end = self.now + s.horizon
        predictions, settings = self._predictions(segments), s.colony._replace(amount=0.0)
        last, _, _ = search(memory, trails, context, predictions, settings, x, y, self.now, end, math.inf, s.expansions, state)
        if last < 0:
            return None
        knots = np.empty((KNOTS, 3))
        n = trace_back(memory, context, predictions, x, y, last, end, end + s.horizon, memory.knots)
        n = shorten(context, predictions, memory.knots, n, knots)
        return TimedPath(knots[:n, 0].copy(), knots[:n, 1:].copy())

    def straight(self, memory: Memory | None = None) -> TimedPath | None:
        """Return the path as if nothing moved, in legs so short that they tell when there would be a conflict."""
        path = self.path(self.segments[:0], memory)
        if path is None:
            return None
        t = np.union1d(path.t, np.arange(self.now, float(path.t[-1]), _LEG))
        return TimedPath(t, np.column_stack([np.interp(t, path.t, path.xy[:, k]) for k in (0, 1)]))

    def conflict(self, path: TimedPath, segments: NDArray[np.float64]) -> float:
        """Return when a robot on `path` first meets one of `segments`, s; infinite if never."""
        knots = np.column_stack((path.t, path.xy))
        return float(first_conflict(knots, self.now, self._predictions(segments)))

    def cost(self, path: TimedPath) -> float:
        """Return how much later than if nothing moved a robot on `path` is at the goal, s."""
        x, y = path.xy[-1].tolist()
        context = self.context
        row, col = (
            math.floor((y - context.y0) / context.resolution + 0.5),
            math.floor((x - context.x0) / context.resolution + 0.5),
        )
        rest = float(context.field[row * context.blocked.shape[1] + col])
        return max(float(path.t[-1]) - self.now + rest - self.free(), 0.0)


def manner(encounter: str, velocity: XY, path: TimedPath, segments: NDArray[np.float64], now: float) -> str:
    """Name how `path` passes the obstacle that `segments` predict: by where the robot is when it is nearest."""
    until = min(float(path.t[-1]), float(segments[-1, T1]))
    ax, ay, vx, vy = passing(np.column_stack((path.t, path.xy)), segments, now, until)
    if encounter.startswith("crossing"):
        return CROSSING[0] if ax * vx + ay * vy > 0.0 else CROSSING[1]
    return ELSE[0] if velocity[0] * ay - velocity[1] * ax > 0.0 else ELSE[1]


class Weighed(Sequence[tuple[str, float]]):
    """What is done and what else could be, with what it costs beyond the path if nothing moved, s; found when first asked for.

    Parameters
    ----------
    situation : Situation
    k : int
        The track that matters.
    encounter : str
        With it.
    velocity : (vx, vy)
        On which the robot would meet it.
    done : (name, cost in s)
        What is done.
    how : str
        The side on which that passes.
    """

    def __init__(self, situation: Situation, k: int, encounter: str, velocity: XY, done: tuple[str, float], how: str) -> None:
        self._asked = situation, k, encounter, velocity, how
        self._done = done

    def __deepcopy__(self, memo: object) -> Weighed:
        return self  # nothing in it ever changes

    @cached_property
    def _all(self) -> tuple[tuple[str, float], ...]:
        now, k, encounter, velocity, how = self._asked
        own = now.segments_of(k)
        sides = CROSSING if encounter.startswith("crossing") else ELSE
        other = sides[1 - sides.index(how)]
        path = now.path(np.vstack((now.segments, _wall(own, other, velocity, now.xy, now.now))))
        found = path is not None and manner(encounter, velocity, path, own, now.now) == other
        return self._done, (other, now.cost(path) if found and path is not None else math.inf), _wait(now)

    @overload
    def __getitem__(self, index: int) -> tuple[str, float]: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[tuple[str, float]]: ...
    def __getitem__(self, index: int | slice) -> tuple[str, float] | Sequence[tuple[str, float]]:
        return self._all[index]

    def __len__(self) -> int:
        return 3

    def __iter__(self) -> Iterator[tuple[str, float]]:
        return iter(self._all)


def _wall(own: NDArray[np.float64], leaving: str, velocity: XY, robot: XY, now: float) -> NDArray[np.float64]:
    """Return discs that move along with an obstacle, side by side, and leave one side of it open; none where the robot is."""
    left = np.array((-velocity[1], velocity[0])) / max(math.hypot(*velocity), 1e-9)
    rows = []
    for d in np.arange(1.0, _WALL / (_APART * float(own[0, CONTACT_RADIUS])) + 1.0):
        row = own.copy()
        row[:, CLEARANCE_RADIUS] = row[:, CONTACT_RADIUS]
        step = d * _APART * own[:, CONTACT_RADIUS, None]
        if leaving in CROSSING:
            ahead = own[:, VX : VY + 1] / np.maximum(np.hypot(own[:, VX], own[:, VY]), 1e-9)[:, None]
            row[:, X : X + 2] += step * (ahead if leaving == CROSSING[1] else -ahead)
        else:
            row[:, X : X + 2] += step * (-left if leaving == ELSE[0] else left)
        i = max(int(np.searchsorted(row[:, T0], now, side="right")) - 1, 0)
        x, y = row[i, X : X + 2] + (now - row[i, T0]) * row[i, VX : VY + 1]
        if math.hypot(x - robot[0], y - robot[1]) > row[i, CONTACT_RADIUS]:
            rows.append(row)
    return np.vstack(rows) if rows else own[:0]


def _wait(now: Situation) -> tuple[str, float]:
    """Of the waits after which the direct path is free the shortest; as far as can be foreseen."""
    path, farthest = now.straight(), -math.inf
    if path is None:
        return "wait, then the direct path", math.inf
    for wait in np.arange(0.0, now.settings.horizon, _WAITS).tolist():
        t, xy = np.concatenate((path.t[:1], path.t + wait)), np.vstack((path.xy[:1], path.xy))
        when = now.conflict(TimedPath(t, xy), now.segments) - wait
        if when < math.inf:
            farthest = max(farthest, when)
        elif farthest + wait + _PAST <= now.now + now.settings.horizon:
            return f"wait {wait:g} s, then the direct path" if wait else "the direct path", now.cost(path) + wait
    return "wait, then the direct path", math.inf
