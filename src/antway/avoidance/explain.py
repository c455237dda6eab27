"""A cycle of the antway policy in words and numbers."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.avoidance.encounter import closest_approach, encounter
from antway.planning import TimedPath
from antway.world.policy import XY, Decision, Observation

_STEPS = {"braked": "brake", "stepped-aside": "step-aside"}


def explain(
    o: Observation,
    path: TimedPath | None,
    cost: float,
    bound: float,
    guard: str,
    pheromone: tuple[int, int, NDArray[np.float32]] | None,
) -> Decision:
    """Say what a cycle decided.

    Parameters
    ----------
    o : Observation
    path : TimedPath or None
        The plan in use, from before or at `o.t` on.
    cost, bound : float
        Time that the plan needs from here to the goal, and what no plan can better, s.
    guard : str
        What the guard did.
    pheromone
        As in `Decision`.
    """
    if path is None:
        return Decision("wait", "no way is safe at the moment: stand", guard=guard, pheromone=pheromone)
    course = _course(path, o.t)
    bound = min(cost, bound)  # which holds over the grid's moves: a way at any angle may be faster
    other, t, gap = _nearest(o, course, float(path.t[-1]) - o.t)
    waiting = wait_of(path, o.t)
    action = _STEPS.get(guard, "wait" if waiting > 0.0 else "follow")
    reason, kind = "the way is free", ""
    if other is not None:
        i = int(np.flatnonzero(o.tracks.id == other)[0])
        velocity = (float(o.tracks.velocity[i, 0]), float(o.tracks.velocity[i, 1]))
        kind = encounter(course, velocity)
        manner = f"wait {waiting:.1f} s" if waiting > 0.0 else _manner(o, i, path)
        if waiting == 0.0 and action == "follow":
            action = "avoid"
        delay = cost - bound
        reason = f"{kind} with obstacle {other}, closest in {t:.1f} s at {max(gap, 0.0):.1f} m: {manner}, +{delay:.1f} s"
    if guard in _STEPS or guard == "slowed":
        reason += f"; guard: {guard}"
    return Decision(
        action,
        reason,
        obstacle=other,
        encounter=kind,
        time_to_closest=t,
        distance_at_closest=gap,
        local_target=(float(path.xy[-1, 0]), float(path.xy[-1, 1])),
        path=path,
        alternatives=(("the plan", cost), ("no way is faster than", bound)),
        gap=cost / bound - 1.0 if bound > 0.0 else 0.0,
        guard=guard,
        pheromone=pheromone,
    )


def _course(path: TimedPath, now: float) -> XY:
    """Velocity at which the plan next moves, m/s."""
    i = max(int(np.searchsorted(path.t, now, side="right")), 1)
    while i < len(path.t) - 1 and (path.xy[i] == path.xy[i - 1]).all():
        i += 1
    i = min(i, len(path.t) - 1)
    span = float(path.t[i] - path.t[i - 1])
    way = (path.xy[i] - path.xy[i - 1]) / span if span > 0.0 else path.xy[i] * 0.0
    return float(way[0]), float(way[1])


def wait_of(path: TimedPath, now: float) -> float:
    """For how long from now on the plan stands, s."""
    i = int(np.searchsorted(path.t, now, side="right"))
    if 0 < i < len(path.t) and (path.xy[i] == path.xy[i - 1]).all():
        return float(path.t[i]) - now
    return 0.0


def _nearest(o: Observation, course: XY, ahead: float) -> tuple[int | None, float, float]:
    """Of the tracks that would come within half a metre on the present course, the first: id, time, gap."""
    best: tuple[int | None, float, float] = (None, math.nan, math.nan)
    t, ahead = o.tracks, min(ahead, 5.0)
    rows = zip(t.id.tolist(), t.xy.tolist(), t.velocity.tolist(), t.radius.tolist(), strict=True)
    for name, (x, y), (vx, vy), radius in rows:
        when, distance = closest_approach(o.xy, course, (x, y), (vx, vy))
        if 0.0 < when < ahead and distance - radius < 0.8 and not when >= best[1]:
            best = (name, when, distance - radius)
    return best


def _manner(o: Observation, i: int, path: TimedPath) -> str:
    """Whether the plan passes in front of or behind track i where it comes closest."""
    t = np.linspace(o.t, min(float(path.t[-1]), o.t + 5.0), 51)
    robot = np.column_stack((np.interp(t, path.t, path.xy[:, 0]), np.interp(t, path.t, path.xy[:, 1])))
    away = robot - o.tracks.xy[i] - (t - o.t)[:, None] * o.tracks.velocity[i]
    nearest = away[int(np.argmin(np.hypot(away[:, 0], away[:, 1])))]
    speed = math.hypot(*o.tracks.velocity[i].tolist())
    if speed < 0.05:
        return "go round"
    return "pass in front" if float(nearest @ o.tracks.velocity[i]) > 0.0 else "pass behind"
