"""Alternatives to the plan, and what they cost: pass an obstacle on its other side, or wait."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.records import CLEARANCE_RADIUS, CONTACT_RADIUS, T0, T1, VX, VY, Predictions, Terrain, X
from antway.kernels.crossing import PolicySettings
from antway.kernels.spacetime.ants import search
from antway.kernels.spacetime.context import PlanningContext, free_time
from antway.kernels.spacetime.memory import KNOTS, SEGMENTS, Memory
from antway.kernels.spacetime.motion import first_conflict, passing, shorten, trace_back
from antway.kernels.tracking.predict import predict, time_shift
from antway.lazy import Later
from antway.planning import TimedPath
from antway.policies.antway.detours import node_near
from antway.policies.antway.state import make_memory, make_trails
from antway.world.policy import XY

CROSSING = ("pass in front", "pass behind")
ELSE = ("go round left", "go round right")
_WAITS = 0.25  # s; step between the waits that are tried
_LEG = 0.5  # s; longest leg of the direct path
_PAST = 1.0  # s; a conflict is over this long after its predicted start
_WALL = 3.0  # m; one side of an obstacle is closed up to this distance, so that the path passes on the other side
_APART = 1.5  # 1; discs this many radii apart leave no gap between them


@dataclass(frozen=True, slots=True, eq=False)
class Snapshot:
    """The data of a control cycle, from which alternatives can be computed later."""

    context: PlanningContext
    settings: PolicySettings
    terrain: Terrain
    now: float  # s
    age: float  # s, of the track estimates
    xy: XY  # m, of the robot
    estimates: Floats  # [K, 8]
    prediction: Floats  # [K, STEPS, 2]
    segments: Floats  # [P, 8]

    def _predictions(self, segments: Floats) -> Predictions:
        return Predictions(segments, time_shift(self.settings.tubes))

    def free(self) -> float:
        """Return the time to the goal without moving obstacles, s."""
        return float(free_time(self.context, *self.xy, self.settings.colony.leg_cells))

    def segments_of(self, k: int) -> Floats:
        """Return the prediction of track k alone, in order of time."""
        s, out, one = self.settings, np.empty((256, 8)), slice(k, k + 1)
        count = predict(
            self.estimates[one], self.now, self.age, s.horizon, *self.xy, s.tubes, self.terrain, self.prediction[one], out
        )
        return out[:count]

    def path(self, segments: Floats, memory: Memory | None = None) -> TimedPath | None:
        """Return the path that the colony finds among `segments`, or None, also if they are more than SEGMENTS.

        Without a `memory` it makes one.
        """
        if len(segments) > SEGMENTS:
            return None
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
        n = shorten(context, predictions, memory.knots[:n], knots)
        return TimedPath(knots[:n, 0], knots[:n, 1:])

    def straight(self, memory: Memory | None = None) -> TimedPath | None:
        """Return the direct path, without moving obstacles, in legs short enough to tell when a conflict begins."""
        path = self.path(self.segments[:0], memory)
        if path is None:
            return None
        t = np.union1d(path.t, np.arange(self.now, float(path.t[-1]), _LEG))
        return TimedPath(t, np.column_stack([np.interp(t, path.t, path.xy[:, k]) for k in (0, 1)]))

    def conflict(self, path: TimedPath, segments: Floats) -> float:
        """Return when the first leg of `path` begins on which a robot meets one of `segments`, s; infinite if none does."""
        knots = np.column_stack((path.t, path.xy))
        return float(first_conflict(knots, self.now, self._predictions(segments)))

    def cost(self, path: TimedPath) -> float:
        """Return how much later a robot on `path` reaches the goal than it would without moving obstacles, s."""
        x, y = path.xy[-1].tolist()
        rest = float(self.context.field[node_near(self.context, (x, y))])
        return max(float(path.t[-1]) - self.now + rest - self.free(), 0.0)


def manner(encounter: str, velocity: XY, path: TimedPath, segments: Floats, now: float) -> str:
    """Name the side on which `path` passes the obstacle predicted by `segments`, where the two are nearest."""
    until = min(float(path.t[-1]), float(segments[-1, T1]))
    ax, ay, vx, vy = passing(np.column_stack((path.t, path.xy)), segments, now, until)
    if encounter.startswith("crossing"):
        return CROSSING[0] if ax * vx + ay * vy > 0.0 else CROSSING[1]
    return ELSE[0] if velocity[0] * ay - velocity[1] * ax > 0.0 else ELSE[1]


class Weighed(Later):
    """The robot's action and its alternatives, each with its cost in s; computed when first used.

    The cost is the additional time compared with the path without moving obstacles. The robot avoids the track of row k; it
    would meet it at `velocity`, m/s, in an `encounter` of this kind. `done` is its action with the cost of that, and `how` the
    side on which this action passes the track.
    """

    def __init__(self, snapshot: Snapshot, k: int, encounter: str, velocity: XY, done: tuple[str, float], how: str) -> None:
        self._asked = snapshot, k, encounter, velocity, how
        self._done = done

    def __deepcopy__(self, memo: object) -> Weighed:
        return self  # the object is immutable

    def __reduce__(self) -> tuple[Any, ...]:
        return tuple, (self._all,)  # not the data of the cycle, which are large, and whose copies are of other types to kernels

    @cached_property
    def _all(self) -> tuple[tuple[str, float], ...]:
        now, k, encounter, velocity, how = self._asked
        own = now.segments_of(k)
        sides = CROSSING if encounter.startswith("crossing") else ELSE
        other = sides[1 - sides.index(how)]
        path = now.path(np.vstack((now.segments, _wall(own, other, velocity, now.xy, now.now))))
        found = path is not None and manner(encounter, velocity, path, own, now.now) == other
        return self._done, (other, now.cost(path) if found and path is not None else math.inf), _wait(now)

    def __getitem__(self, index: Any) -> Any:
        return self._all[index]

    def __len__(self) -> int:
        return 3


def _wall(own: Floats, leaving: str, velocity: XY, robot: XY, now: float) -> Floats:
    """Return discs that move with an obstacle and close one of its sides; no disc is placed on the robot."""
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


def _wait(now: Snapshot) -> tuple[str, float]:
    """Return the shortest wait after which the direct path is free within the horizon, and its cost."""
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
