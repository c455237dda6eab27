"""An independent check of episodes, which shares no code with what plays them and follows only the definitions of the rules."""

from __future__ import annotations

import math
from collections.abc import Iterator
from enum import Enum
from itertools import pairwise
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadParameter, InvalidPlan
from antway.verify import number_faults
from antway.verify_motion import CLOSE, REST, Again, array_faults, dynamic_faults, last_gaps
from antway.verify_steps import step_faults, step_gaps

if TYPE_CHECKING:
    from antway.world.episode import EpisodeResult
    from antway.world.stops import Visit
    from antway.world.trace import Trace

_NEAR = 1e-6  # m, m/s, s; tolerance of an episode's rules
_DEEP = 1e-5  # m; a robot that is less far within the goal may have passed by it


def check_episode(episode: EpisodeResult | Trace) -> None:
    """Raise `InvalidPlan` with all violations of the rules of an episode's robot, map and obstacles.

    Parameters
    ----------
    episode : EpisodeResult or Trace
        A result must have been run with `record=True`.

    Raises
    ------
    BadParameter
        If the argument is not an episode.
    InvalidPlan
        If times do not increase by the control period; if the robot does not start at rest with its heading towards the goal,
        jumps, does not follow its commands within its limits, passes through an obstacle or a wall, or senses an obstacle that
        was never in range; if the outcome or a figure contradicts the trace; or if a stop was not visited as recorded.
    """
    trace = _trace_of(episode)
    faults = _type_faults(episode, trace) or _shape_faults(trace)
    again = Again(trace)
    faults = faults or [*_motion_faults(again), *_end_faults(again), *rounds_faults(trace)]
    if hasattr(episode, "min_clearance") and not faults:
        faults = _figure_faults(cast("EpisodeResult", episode), again)
    if faults:
        raise InvalidPlan(faults)


def _trace_of(episode: EpisodeResult | Trace) -> Trace:
    trace = getattr(episode, "trace", episode)
    if trace is None:
        raise InvalidPlan(["the result has no trace: run it with record=True"])
    if not all(hasattr(trace, name) for name in ("task", "timeline", "command", "decisions")):
        raise BadParameter("episode", episode, "an EpisodeResult or a Trace")
    return cast("Trace", trace)


def _type_faults(episode: EpisodeResult | Trace, trace: Trace) -> list[str]:
    """Return which parts of an episode are not of their type; nothing else can be said of such an episode."""
    faults = [] if isinstance(trace.outcome, Enum) else [f"outcome {trace.outcome!r} is not an Outcome"]
    if not isinstance(trace.config, dict) or not isinstance(trace.config.get("horizon", 0.0), (int, float)):
        faults.append(f"config is no table, or its horizon is no number: {trace.config!r}")
    faults += [
        f"{entry!r} is not the number of a step and a Decision"
        for entry in trace.decisions
        if not (isinstance(entry, tuple) and len(entry) == 2 and isinstance(entry[0], int) and hasattr(entry[1], "path"))
    ]
    if not (isinstance(trace.sensed, np.ndarray) and trace.sensed.dtype == bool):
        faults.append("sensed is no array of booleans")
    return faults + (number_faults(episode, "time", "length", "min_clearance") if hasattr(episode, "min_clearance") else [])


def _shape_faults(trace: Trace) -> list[str]:
    n, k = len(trace.command), len(trace.timeline)
    shapes = {"t": (n + 1,), "xy": (n + 1, 2), "velocity": (n + 1, 2), "heading": (n + 1,), "command": (n, 2)}
    shapes |= {"sensed": (n + 1, k), "cycle_ms": (n,), "turn_rate": (n + 1,)}
    faults = array_faults(trace, shapes, ("t", "xy", "velocity", "heading", "turn_rate", "cycle_ms"))
    steps = [step for step, _ in trace.decisions]
    if any(not 0 <= step <= n for step in steps) or any(a >= b for a, b in pairwise(steps)):
        faults.append("a decision stands outside the episode, or not after the one before")
    return faults


def _motion_faults(again: Again) -> Iterator[str]:
    """Yield violations of times, of the robot's limits, and of contacts before the end."""
    trace = again.trace
    spec, t, dt = trace.task.robot, trace.t, np.diff(trace.t)
    if t[0] != 0.0 or (dt <= 0).any():
        yield "times do not increase from 0"
        return
    if (np.abs(t[:-1] - np.arange(len(t) - 1) * spec.dt) > 1e-9 * (1 + t[:-1])).any() or (dt > spec.dt * (1 + 1e-9)).any():
        yield "steps are not the control period apart"
    if tuple(trace.xy[0].tolist()) != trace.task.start:
        yield f"begins at {tuple(trace.xy[0])}, not at the start {trace.task.start}"
    if trace.velocity[0].any() or trace.turn_rate[0] != 0.0:
        yield f"does not begin at rest, but with {trace.velocity[0].tolist()} m/s and {float(trace.turn_rate[0])!r} rad/s"
    ahead = np.subtract(trace.task.goal, trace.task.start)
    if abs(math.remainder(trace.heading[0] - math.atan2(ahead[1], ahead[0]), 2.0 * math.pi)) > _NEAR:
        yield "does not begin with its heading towards the goal"
    if (spec.drive == "holonomic" or spec.stepwise) and trace.turn_rate.any():
        yield "states turn rates, which only wheels with ramps have"
    if (trace.cycle_ms < 0.0).any():
        yield "a cycle took less than 0 ms"
    yield from _sensor_faults(trace)
    yield from step_faults(trace) if spec.stepwise else dynamic_faults(again)


def _sensor_faults(trace: Trace) -> Iterator[str]:
    """Yield contradictions between tracks and the range of the sensor; noise, latency and walls are not considered."""
    line, sensed = trace.timeline, trace.sensed
    for k, (low, high) in enumerate(pairwise(line.first.tolist())):
        at = (np.interp(trace.t, line.knot_t[low:high], line.knot_xy[low:high, axis]) for axis in (0, 1))
        near = np.hypot(*(trace.xy.T - list(at))) - line.radius[k] <= trace.task.robot.sensor_range + _NEAR
        if (sensed[:, k] & ~np.logical_or.accumulate(near)).any():
            yield f"senses obstacle {line.id[k]} before it was in range"
    if len(trace) and (sensed[-1] != sensed[-2]).any():
        yield "senses something in the last row, in which it does not decide"


def _end_faults(again: Again) -> Iterator[str]:
    """Yield contradictions between the end of the trace and its outcome."""
    trace = again.trace
    outcome, task = trace.outcome.value, trace.task
    away = np.hypot(*(trace.xy - np.array(task.goal)).T)
    if outcome == "reached" and away[-1] > task.goal_tolerance + _NEAR:
        yield f"claims to have reached the goal from {away[-1]:.7g} m away; the tolerance is {task.goal_tolerance:g} m"
    homeward = trace.t > last_end(trace) + _NEAR if trace.rounds is not None else np.full(len(trace.t), True)
    goes_on = trace.t < trace.t[-1] - _NEAR if outcome == "reached" else len(trace) > 0  # who was never driven does not go on
    edge = np.full(len(away), task.goal_tolerance)
    edge[-1] -= _NEAR * outcome.startswith("hit")  # a contact may come just before the robot arrives
    if ((away <= edge) & homeward & goes_on).any():
        yield "goes on after it reached the goal"
    elif (_passes_goal(again) & homeward[:-1])[: len(trace) - (outcome == "reached")].any():
        yield "goes on after it passed the goal"
    gaps, wall = last_gaps(trace)
    moving = math.hypot(*trace.velocity[-1].tolist()) > REST
    moving |= task.robot.footprint is not None and abs(float(trace.turn_rate[-1])) > REST
    if outcome in ("hit-moving", "hit-standing"):
        if not any(gap <= _NEAR for gap in gaps):
            yield "claims a contact with an obstacle that it does not touch"
        if moving != (outcome == "hit-moving"):
            yield f"claims {outcome} though the robot was {'moving' if moving else 'at rest'}"
    if outcome == "hit-wall" and (len(trace) == 0 or wall > _NEAR):
        yield "claims a contact with a wall that it does not touch"
    horizon = trace.config.get("horizon", math.nan)  # a trace that another program wrote may have none
    early = trace.t[-1] < horizon - _NEAR
    if "horizon" in trace.config and not trace.t[-1] <= horizon + task.robot.dt + _NEAR:
        yield f"goes on to {trace.t[-1]:g} s, and its horizon is {horizon:g} s"
    if outcome == "timeout" and early:
        yield "claims to have run out of time before the horizon"
    at_rest = not moving and abs(float(trace.turn_rate[-1])) <= REST
    if outcome == "error" and early and len(trace) and not at_rest:
        yield "claims an error before the horizon, and the robot was not braked"
    if outcome in ("timeout", "error") and trace.t[-1] < len(trace) * task.robot.dt - _NEAR:
        yield "ends amid a control period, as only a contact or the goal ends one"


def _passes_goal(again: Again) -> NDArray[np.bool_]:
    """Tell of each step whether the robot is at the goal within it."""
    trace = again.trace
    places = np.stack((trace.xy[:-1], trace.xy[1:]), axis=1) if trace.task.robot.stepwise else again.cycles[1][:, :, :2]
    away, step = places[:, :-1] - np.array(trace.task.goal), np.diff(places, axis=1)
    square = (step**2).sum(axis=2)
    share = np.clip(-(away * step).sum(axis=2) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
    nearest: NDArray[np.float64] = np.hypot(*np.moveaxis(away + share[:, :, None] * step, 2, 0)).min(axis=1)
    return nearest < trace.task.goal_tolerance - _DEEP


def _figure_faults(result: EpisodeResult, again: Again) -> list[str]:
    trace = again.trace
    stepwise = trace.task.robot.stepwise
    gap = step_gaps(trace) if stepwise else again.gaps
    least = float(gap.min()) if gap.size else math.inf
    sampled = {} if stepwise else {"min_clearance": CLOSE}
    length = math.fsum(math.dist(a, b) for a, b in pairwise(trace.xy.tolist()))
    figures = {
        "time": (result.time, float(trace.t[-1])),
        "length": (result.length, length),
        "min_clearance": (result.min_clearance, least),
    }
    rests = np.hypot(*trace.velocity[1:].T) <= REST
    paths = [decision.path for _, decision in trace.decisions if decision.path is not None]
    figures["waits"] = (result.waits, int(rests[:1].sum() + (rests[1:] & ~rests[:-1]).sum()))
    figures["replans"] = (result.replans, sum(a is not b for a, b in pairwise(paths)))
    faults = [
        f"states {name} {a!r} but has {b!r}"
        for name, (a, b) in figures.items()
        if a != b and not abs(a - b) <= sampled.get(name, _NEAR)
    ]
    faults += [
        f"states {name} {getattr(result, name)!r}, and its trace {getattr(trace, name)!r}"
        for name in ("outcome", "seed", "reason", "rounds", "config")
        if getattr(result, name) != getattr(trace, name)
    ]
    if not np.array_equal(result.cycle_ms, trace.cycle_ms):
        faults.append("states other times of cycles (cycle_ms) than its trace")
    return faults


def last_end(trace: Trace) -> float:
    """Return the time at which the robot leaves the last stop for the goal, s; infinite if it has not visited all stops."""
    if trace.rounds is None:
        return 0.0
    visits = trace.rounds.visits
    if len({visit.stop for visit in visits}) < len(trace.rounds.stops):
        return math.inf
    return max((visit.end for visit in visits), default=0.0)


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
    t, away = trace.t[rows], np.hypot(*(trace.xy[rows] - np.array(stop.at)).T)
    served = np.clip(t - visit.start, 0.0, trace.task.robot.dt)  # s; in the period before each row, if the robot is near then
    if not len(away) or away[0] > trace.task.goal_tolerance + _NEAR:
        yield f"is {away[0] if len(away) else math.inf:g} m away when it arrives"
    elif served[away <= 2 * trace.task.goal_tolerance + _NEAR].sum() < stop.service - _NEAR:
        yield "is not near for as long as the service takes"
