"""An independent check of episodes, which shares no code with what plays them and follows only the definitions of the rules."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, cast

import numpy as np

from antway.errors import BadParameter, InvalidPlan
from antway.verify_motion import driven, dynamic_faults, dynamic_gaps, finite_faults, last_gaps, shape_faults
from antway.verify_rounds import last_end, rounds_faults
from antway.verify_steps import step_faults, step_gaps, wall_gap

if TYPE_CHECKING:
    from antway.world.episode import EpisodeResult
    from antway.world.trace import Trace

_NEAR = 1e-6  # m, m/s, s; tolerance of an episode's rules


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
        If times do not increase by the control period; if the robot starts elsewhere, jumps, exceeds a limit of speed,
        acceleration or turn rate, or passes through an obstacle or a wall; if the outcome or a figure contradicts the trace;
        or if a stop was not visited as recorded.
    """
    trace = _trace_of(episode)
    faults = _shape_faults(trace) or [*_motion_faults(trace), *_end_faults(trace), *rounds_faults(trace)]
    if hasattr(episode, "min_clearance") and not faults:
        faults = _figure_faults(cast("EpisodeResult", episode), trace)
    if faults:
        raise InvalidPlan(faults)


def _trace_of(episode: EpisodeResult | Trace) -> Trace:
    trace = getattr(episode, "trace", episode)
    if trace is None:
        raise InvalidPlan(["the result has no trace: run it with record=True"])
    if not all(hasattr(trace, name) for name in ("task", "timeline", "command", "decisions")):
        raise BadParameter("episode", episode, "an EpisodeResult or a Trace")
    return cast("Trace", trace)


def _shape_faults(trace: Trace) -> list[str]:
    n, k = len(trace.command), len(trace.timeline)
    shapes = {"t": (n + 1,), "xy": (n + 1, 2), "velocity": (n + 1, 2), "heading": (n + 1,), "command": (n, 2)}
    shapes |= {"sensed": (n + 1, k), "cycle_ms": (n,), "turn_rate": (n + 1,)}
    faults = shape_faults(trace, shapes)
    if not faults:
        faults = finite_faults(trace, ("t", "xy", "velocity", "heading", "turn_rate"))
    if any(not 0 <= step <= n for step, _ in trace.decisions):
        faults.append("a decision stands outside the episode")
    return faults


def _motion_faults(trace: Trace) -> Iterator[str]:
    """Yield violations of times, of the robot's limits, and of contacts before the end."""
    spec, t, dt = trace.task.robot, trace.t, np.diff(trace.t)
    if t[0] != 0.0 or (dt <= 0).any():
        yield "times do not increase from 0"
        return
    if (np.abs(t[:-1] - np.arange(len(t) - 1) * spec.dt) > 1e-9 * (1 + t[:-1])).any() or (dt > spec.dt * (1 + 1e-9)).any():
        yield "steps are not the control period apart"
    if tuple(trace.xy[0].tolist()) != trace.task.start:
        yield f"begins at {tuple(trace.xy[0])}, not at the start {trace.task.start}"
    yield from step_faults(trace) if spec.stepwise else dynamic_faults(trace)


def _end_faults(trace: Trace) -> Iterator[str]:
    """Yield contradictions between the end of the trace and its outcome."""
    outcome = trace.outcome.value
    task = trace.task
    away = np.hypot(*(trace.xy - np.array(task.goal)).T)
    if outcome == "reached" and away[-1] > task.goal_tolerance + _NEAR:
        yield f"claims to have reached the goal from {away[-1]:g} m away"
    if ((away[:-1] < task.goal_tolerance - _NEAR) & (trace.t[:-1] > last_end(trace) + _NEAR)).any():
        yield "goes on after it reached the goal"
    gaps, wall = last_gaps(trace)
    if task.robot.stepwise and len(trace) > 0:
        wall = wall_gap(trace, len(trace) - 1)
    moving = math.hypot(*trace.velocity[-1].tolist()) > 1e-9
    moving |= task.robot.footprint is not None and abs(float(trace.turn_rate[-1])) > 1e-9
    if outcome in ("hit-moving", "hit-standing"):
        if not any(gap <= _NEAR for gap in gaps):
            yield "claims a contact with an obstacle that it does not touch"
        if moving != (outcome == "hit-moving"):
            yield f"claims {outcome} though the robot was {'moving' if moving else 'at rest'}"
    if outcome == "hit-wall" and (len(trace) == 0 or wall > _NEAR):
        yield "claims a contact with a wall that it does not touch"
    if outcome == "timeout" and trace.t[-1] < trace.config.get("horizon", 0.0) - _NEAR:
        yield "claims to have run out of time before the horizon"


def _figure_faults(result: EpisodeResult, trace: Trace) -> list[str]:
    stepwise = trace.task.robot.stepwise
    gap = step_gaps(trace) if stepwise else dynamic_gaps(trace, *driven(trace)[:2])
    least = float(gap.min()) if gap.size else math.inf
    slack = _NEAR if stepwise else 1e-4  # for gaps that are sampled
    length = math.fsum(math.dist(a, b) for a, b in pairwise(trace.xy.tolist()))
    figures = {
        "time": (result.time, float(trace.t[-1])),
        "length": (result.length, length),
        "min_clearance": (result.min_clearance, least),
    }
    faults = [f"states {name} {a!r} but has {b!r}" for name, (a, b) in figures.items() if a != b and not abs(a - b) <= slack]
    if result.outcome is not trace.outcome or result.seed != trace.seed:
        faults.append("outcome or seed of result and trace differ")
    return faults
