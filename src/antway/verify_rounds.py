"""The part of `check_episode` about stops, which follows only the definitions."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from antway.world.stops import Visit
    from antway.world.trace import Trace

_NEAR = 1e-6  # m, s; tolerance


def last_end(trace: Trace) -> float:
    """Return the time at which the robot leaves the last stop for the goal, s; 0 in an episode without stops."""
    if trace.rounds is None:
        return 0.0
    return max((visit.end for visit in trace.rounds.visits), default=math.inf if trace.rounds.stops else 0.0)


def rounds_faults(trace: Trace) -> Iterator[str]:
    """Yield the invalid visits of an episode's rounds, and false claims that they are complete."""
    rounds = trace.rounds
    if rounds is None:
        return
    seen: set[int] = set()
    before = 0.0
    for visit in rounds.visits:
        if not 0 <= visit.stop < len(rounds.stops):
            yield f"visits stop {visit.stop}, and there are {len(rounds.stops)}"
            return
        name = f"stop {visit.stop} ({rounds.stops[visit.stop].name})"
        if visit.stop in seen:
            yield f"{name} is visited twice"
        seen.add(visit.stop)
        if visit.arrival < before - _NEAR:
            yield f"arrives at {name} before it leaves the stop before"
        before = visit.end
        yield from (f"{name}: {fault}" for fault in _visit_faults(trace, visit))
    if trace.outcome.value == "reached" and len(seen) < len(rounds.stops):
        yield f"claims to be done without stops {sorted(set(range(len(rounds.stops))) - seen)}"
    for turn in rounds.turns:
        left = set(range(len(rounds.stops))) - {visit.stop for visit in rounds.visits if visit.end < turn.t - _NEAR}
        if len(set(turn.order)) != len(turn.order) or not set(turn.order) <= left:
            yield f"the order decided on at {turn.t:g} s has stops twice, or visited before"


def _visit_faults(trace: Trace, visit: Visit) -> Iterator[str]:
    assert trace.rounds is not None
    stop = trace.rounds.stops[visit.stop]
    if not 0.0 <= visit.arrival <= visit.start <= visit.end <= trace.t[-1] + _NEAR:
        yield f"arrives at {visit.arrival:g} s, begins at {visit.start:g} s, ends at {visit.end:g} s"
        return
    if abs(visit.start - max(visit.arrival, stop.window[0])) > _NEAR:
        yield f"begins at {visit.start:g} s; it arrived at {visit.arrival:g} s, and its window opens at {stop.window[0]:g} s"
    if visit.end - visit.start < stop.service - _NEAR:
        yield f"is served for {visit.end - visit.start:g} s in place of {stop.service:g} s"
    rows = (trace.t >= visit.arrival - _NEAR) & (trace.t <= visit.end + _NEAR)
    away = np.hypot(*(trace.xy[rows] - np.array(stop.at)).T)
    if not len(away) or away[0] > trace.task.goal_tolerance + _NEAR:
        yield f"is {away[0] if len(away) else math.inf:g} m away when it arrives"
    elif (
        stop.service > 0.0
        and trace.task.robot.dt * (away <= 2 * trace.task.goal_tolerance + _NEAR).sum() < stop.service - _NEAR
    ):
        yield "is not near for as long as the service takes"
