"""Why an episode failed: what touched the robot, alone or in a group, and from which side."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence

import numpy as np

from antway.arena.store import Row
from antway.world.robots import body_gap
from antway.world.trace import Outcome, Trace

TOGETHER = 2.0  # m; people who walk together are at a smaller distance
ALIKE = 0.6  # m/s; the velocities of people who walk together differ by less
_SPLIT = "; "  # separates the outcome and its cause in the reason of a row


def cause(trace: Trace) -> str:
    """Return what touched the robot, as "one of 3 together, from behind"; empty for an episode that ended otherwise.

    From behind: its velocity is within 60 degrees of the direction from the robot to its goal; from ahead: within 60 degrees
    of the opposite; else from the side; standing: slower than 0.1 m/s.
    """
    if trace.outcome not in (Outcome.HIT_MOVING, Outcome.HIT_STANDING):
        return ""
    xy, velocity = trace.timeline.at(float(trace.t[-1]))
    k = int(np.argmin(body_gap(trace.task.robot, trace.xy[-1], trace.heading[-1], xy) - trace.timeline.radius))
    speed = math.hypot(*velocity[k].tolist())
    alike = np.hypot(*(velocity - velocity[k]).T) < ALIKE
    together = int((alike & (np.hypot(*(xy - xy[k]).T) < TOGETHER)).sum())
    ahead = np.array(trace.task.goal) - trace.xy[-1]
    share = float(velocity[k] @ ahead) / max(speed * math.hypot(*ahead.tolist()), 1e-12)
    side = "standing" if speed < 0.1 else "from behind" if share > 0.5 else "from ahead" if share < -0.5 else "from the side"
    fast = ", faster than declared" if speed > trace.task.obstacle_speed + 1e-6 else ""
    return f"{'one alone' if together == 1 else f'one of {together} together'}, {side}{fast}"


def with_cause(trace: Trace) -> str:
    """Return the reason of a trace with its cause."""
    why = cause(trace)
    return f"{trace.reason}{_SPLIT}{why}" if why else trace.reason


def errors(rows: Sequence[Row]) -> list[str]:
    """Return a line for each policy that ended episodes with an error: in how many, and the reason of the first."""
    lines = []
    for policy, played in Counter(row.policy for row in rows).items():
        reasons = [row.reason for row in rows if row.policy == policy and row.outcome == Outcome.ERROR.value]
        if reasons:
            lines.append(f"policy {policy} failed in {len(reasons)} of {played} episodes; first: {reasons[0]}")
    return lines


def by_cause(rows: Iterable[Row]) -> dict[str, int]:
    """Return the number of failed episodes for each cause, the most frequent first.

    If the clairvoyant optimum does not reach the goal either, the cause is "no path at all", except for errors of policies.
    """
    counts = Counter[str]()
    for row in rows:
        if not row.reached:
            _, _, why = row.reason.partition(_SPLIT)
            played = row.outcome != Outcome.ERROR.value  # what a policy's error says may contain `_SPLIT`
            name = f"{row.outcome}: {why}" if why and played else row.outcome
            counts["no path at all" if row.bound == math.inf and played else name] += 1
    return dict(sorted(counts.items(), key=lambda one: (-one[1], one[0])))
