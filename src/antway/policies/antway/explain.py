"""Explain a control cycle of the antway policy in words and numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.records import CONTACT_RADIUS, T0
from antway.kernels.base.records import VY as VY_OF
from antway.kernels.crossing import SEGMENT_COUNT
from antway.kernels.spacetime.memory import Memory
from antway.kernels.tracking.predict import ID, RADIUS, VX, VY, X, Y
from antway.planning import TimedPath
from antway.policies.antway.alternatives import Snapshot, Weighed, manner
from antway.policies.antway.state import State
from antway.policies.antway.tracker import FIRST_OWN_ID
from antway.policies.encounter import closest_approach, encounter
from antway.world.policy import XY, Decision
from antway.world.rollouts import acting

Pheromone = tuple[int, int, NDArray[np.float32]]  # as in `Decision`

_STEPS = {"braked": "brake", "stepped-aside": "step-aside"}
_SHOWN = 6.0  # s; a decision contains the prediction up to this time ahead
_STANDS = 1.0  # s; an explanation is renewed after this time, even if the plan stays
_DOUBT = "the velocities of obstacles that the sensor reports do not fit their places and are not used"
CUT_OFF = "the map has no path to the goal for this robot"
_LATE = 0.05  # s; a robot that loses less time than this is not held up
_AWAY = 2.0  # s; a robot on wheels that loses more time than its plan by what it drives next keeps away from obstacles
_STEP = 0.1  # s; a plan is looked at in steps of this length


def explain_cycle(s: State, why: str, pheromone: Pheromone | None, memory: Memory) -> Decision:
    """Return the explanation of the cycle that `s.cycle` tells of; `why` is the guard's reason, the rest is as in `explain`."""
    assert s.cycle is not None, "act comes first"
    (seen, arrival, bound), known = s.cycle, len(s.tracker.estimates)
    t, (x, y) = float(seen.t), seen.xy
    wait = 0.0 if s.path is None else wait_of(s.path, t)
    s.until = t + (min(wait, _STANDS) if wait > 0.0 else _STANDS)
    now = t, float(seen.t - seen.sensed_at), (float(x), float(y))
    tracks = s.crowd.tracks.averaged[:known].copy(), s.crowd.prediction[:known].copy()
    segments = s.plan.segments[: int(s.plan.state[SEGMENT_COUNT])].copy()
    snapshot = Snapshot(s.detours.without(s.context), s.settings, s.terrain, *now, *tracks, segments)
    if s.detours.is_cut_off(seen.xy, s.settings.colony.leg_cells):
        made = Decision("stuck", CUT_OFF, guard=s.did[0], pheromone=pheromone)
    else:
        then, _ = acting(seen, s.task.robot)  # until the command acts, nothing but the robot's latency delays it
        free = replace(snapshot, xy=then.xy).free()
        made = explain(s, snapshot, arrival - then.t, bound - then.t, free, pheromone, memory)
    doubt = _DOUBT if s.tracker.doubts_velocities else ""
    notes = made.reason, why, str(s.yielding), str(s.dance), str(s.response), doubt
    return replace(made, reason="; ".join(filter(None, notes)))


def explain(
    s: State, now: Snapshot, cost: float, bound: float, free: float, pheromone: Pheromone | None, memory: Memory
) -> Decision:
    """Return the decision of a control cycle, with the plan in use.

    From where the command acts it needs `cost` s to the goal, any plan at least `bound` s, and `free` s if nothing moved.
    `memory` is that in which the ants search.
    """
    path, (guard, stands) = s.path, s.did
    if path is None:
        return Decision("wait", "no motion is safe at the moment: stand", guard=guard, pheromone=pheromone)
    velocity = _velocity(path, now.now)
    bound = min(cost, bound)  # the bound holds for the moves of the grid, and an any-angle path may be faster
    late = max(cost - free, 0.0)
    waiting = wait_of(path, now.now)
    action = _STEPS.get(guard, "wait" if waiting > 0.0 and stands else "follow")
    k, t, gap = _nearest(now, velocity, float(path.t[-1]) - now.now)
    met = f"closest in {t:.1f} s at {max(gap, 0.0):.1f} m"
    if k is None and (waiting > 0.0 or late > _LATE):
        k, when, velocity = _hindrance(now, memory)
        met = f"in {when - now.now:.1f} s on the direct path"
        if k is not None:
            t, gap = _approach(now, now.estimates[k].tolist(), velocity)
    reason, kind, track_id = "the path is free", "", None
    alternatives: Sequence[tuple[str, float]] = (("on along the path", late),)
    if k is not None:
        track_id = int(now.estimates[k, ID])
        track_id = -1 if track_id >= FIRST_OWN_ID else track_id
        kind = encounter(velocity, (float(now.estimates[k, VX]), float(now.estimates[k, VY])))
        how = manner(kind, velocity, path, now.segments_of(k), now.now)
        stays = (path.xy[np.searchsorted(path.t, now.now, side="right") :] == path.xy[-1]).all()
        wait = f"wait {waiting:.1f} s" if waiting > 0.0 else "stand for now" if stands else ""
        past = "" if waiting > 0.0 and stays else how
        if kind == "standing" and _leads_through(path, now, k):
            past = "nothing leads past it"
        does = ", ".join(filter(None, (wait, past)))
        if action == "follow":
            action = "wait" if stands else "avoid"
        whom = f"obstacle {track_id}" if track_id >= 0 else "an obstacle"
        reason = f"{kind} with {whom}, {met}: {does}, {f'+{late:.1f} s' if late < math.inf else 'no path found'}"
        alternatives = Weighed(now, k, kind, velocity, (does, late), how)
    elif stands and late < math.inf and _needs_certainty(s, now):
        reason = "the plan is free, but no motion is known that is certain to be safe"
        action = "wait" if action == "follow" else action
    elif late > _LATE:
        reason = "a detour around what moves" if late < math.inf else "no motion that gets nearer to the goal is known"
        action = "wait" if stands and action == "follow" else action
    elif len(now.estimates) and now.cost(path) > _AWAY:
        reason = "the plan is free, but the robot keeps away from what moves"
        action = "wait" if stands else "avoid" if action == "follow" else action
    if guard in _STEPS or guard == "slowed":
        reason += f"; guard: {guard}"
    return Decision(
        action,
        reason,
        obstacle=track_id,
        encounter=kind,
        time_to_closest=t,
        distance_at_closest=gap,
        local_target=(float(path.xy[-1, 0]), float(path.xy[-1, 1])),
        path=path,
        alternatives=alternatives,
        gap=cost / bound - 1.0 if bound > 0.0 else 0.0,
        guard=guard,
        pheromone=pheromone,
        predicted=_predicted(now),
    )


def _needs_certainty(s: State, now: Snapshot) -> bool:
    """Tell whether the guard, or ants that know what it asks, has found no motion for a robot that is not at its goal."""
    asks = s.did[0] == "braked" or (len(now.estimates) > 0 and s.controls is not None and s.controls.strict)
    return asks and math.dist(now.xy, s.task.goal) > s.task.goal_tolerance


def _predicted(now: Snapshot) -> NDArray[np.float32] | None:
    """Return the prediction in the form of `Decision`, with the radii of the tubes."""
    rows = now.segments[now.segments[:, T0] < now.now + _SHOWN]
    if not len(rows):
        return None
    radius = rows[:, CONTACT_RADIUS] - now.settings.tubes.robot_radius
    return np.column_stack((rows[:, : VY_OF + 1], np.maximum(radius, 0.0))).astype(np.float32)


def _velocity(path: TimedPath, now: float) -> XY:
    """Return the velocity of the plan when it next moves, m/s."""
    i = max(int(np.searchsorted(path.t, now, side="right")), 1)
    while i < len(path.t) - 1 and (path.xy[i] == path.xy[i - 1]).all():
        i += 1
    i = min(i, len(path.t) - 1)
    span = float(path.t[i] - path.t[i - 1])
    velocity = (path.xy[i] - path.xy[i - 1]) / span if span > 0.0 else path.xy[i] * 0.0
    return float(velocity[0]), float(velocity[1])


def wait_of(path: TimedPath, now: float) -> float:
    """Return how long from now the plan stands still, s."""
    i = start = max(int(np.searchsorted(path.t, now, side="right")), 1)
    while i < len(path.t) and (path.xy[i] == path.xy[i - 1]).all():
        i += 1
    return float(path.t[i - 1]) - now if i > start else 0.0


def _leads_through(path: TimedPath, now: Snapshot, k: int) -> bool:
    """Tell whether the rest of `path` leads through the place of track k, after the time for which it is predicted to stand."""
    row, t = now.estimates[k], np.arange(now.now, float(path.t[-1]), _STEP)
    x, y = (np.interp(t, path.t, path.xy[:, axis]) for axis in (0, 1))
    return bool((np.hypot(x - row[X], y - row[Y]) < row[RADIUS] + now.settings.tubes.robot_radius).any())


def _approach(now: Snapshot, row: Sequence[float], velocity: XY) -> tuple[float, float]:
    """Return when a track comes closest to a robot with this velocity, s, and the gap between their edges then, m."""
    at = (row[X] + row[VX] * now.age, row[Y] + row[VY] * now.age)
    when, distance = closest_approach(now.xy, velocity, at, (row[VX], row[VY]))
    return when, distance - row[RADIUS] - now.settings.tubes.robot_radius


def _nearest(now: Snapshot, velocity: XY, ahead: float) -> tuple[int | None, float, float]:
    """Return the row, time and gap of the first track that would come within 0.5 m at the present velocity."""
    best: tuple[int | None, float, float] = (None, math.nan, math.nan)
    for k, row in enumerate(now.estimates.tolist()):
        when, gap = _approach(now, row, velocity)
        if 0.0 < when < min(ahead, 5.0) and gap < 0.5 and not when >= best[1]:
            best = (k, when, gap)
    return best


def _hindrance(now: Snapshot, memory: Memory) -> tuple[int | None, float, XY]:
    """Return the row of the first track met on the direct path, the time in s, and the robot's velocity then."""
    path, best, first = now.straight(memory), None, math.inf
    if path is None or now.conflict(path, now.segments) == math.inf:
        return None, math.nan, (0.0, 0.0)
    for k in range(len(now.estimates)):
        when = now.conflict(path, now.segments_of(k))
        if when < first:
            best, first = k, when
    return best, first, _velocity(path, min(first, float(path.t[-1])))
