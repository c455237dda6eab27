"""Which moments of an episode to show, and their captions."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from antway.planning import Plan, Status
from antway.policies.paper.routes import StaticRoutes
from antway.world.policy import Decision, Task
from antway.world.trace import Trace


def shortest(task: Task) -> Plan:
    """Return the shortest path of 8 moves for the robot on the static map: Step 2 of the paper.

    Of equally short paths it is the one that policy `paper` follows.
    """
    routes = StaticRoutes(task)
    start = routes.cell(task.start)
    cells = np.empty((0, 2)) if start is None or routes.home is None else routes.home.cells(start)
    if not len(cells):
        return Plan(Status.NO_PATH)
    length = float(np.hypot(*np.diff(cells, axis=0).T).sum()) * routes.inflated.resolution
    return Plan(Status.FOUND, cells.astype(np.int32), length, True, lower_bound=length)


def global_path(trace: Trace) -> Plan | None:
    """Return the shortest path of an episode's task; None with stops, which it does not pass."""
    return None if trace.rounds is not None else shortest(trace.task)


def moments(trace: Trace) -> tuple[int, int]:
    """Return two steps to show: (shortly before an encounter, while avoiding the obstacle).

    The first is the step of the decision for the detour that leads farthest from the shortest path; without detours, of the
    first decision not to follow it; else the closest approach. The second is that step, or one at most 1.5 s later at which the
    robot still reacts in the same way to the same obstacle.
    """
    busy = [(n, step, decision) for n, (step, decision) in enumerate(trace.decisions) if decision.obstacle is not None]
    detours = [one for one in busy if one[2].action == "avoid" and one[2].path is not None]
    if busy:
        nodes = shortest(trace.task).xy(trace.task.grid)
        n, meet, one = max(detours, key=lambda one: _largest_deviation(one[2], nodes)) if detours else busy[0]
        same = (one.action, one.obstacle)
        later = (step for step, other in trace.decisions[n + 1 :] if (other.action, other.obstacle) != same)
        meet, end = min(meet, len(trace)), next(later, len(trace) + 1) - 1
        return meet, max(meet, min(end, meet + round(1.5 / trace.task.robot.dt), len(trace)))
    if len(trace.obstacle_id):
        gaps = np.hypot(*(trace.obstacle_xy - trace.xy[:, None]).transpose(2, 0, 1)) - trace.obstacle_radius
        midst = int(gaps.min(axis=1).argmin())
    else:
        midst = len(trace) // 2
    before = max(0, midst - round(0.5 / trace.task.robot.dt))
    return before if trace.sensed[before].any() else midst, midst


def _largest_deviation(decision: Decision, nodes: NDArray[np.float64]) -> float:
    """Return the largest distance of the path of a decision from the nearest of these nodes, m."""
    if decision.path is None or not len(nodes):
        return 0.0
    away = np.hypot(*(decision.path.xy[:, None] - nodes[None]).transpose(2, 0, 1))
    return float(away.min(axis=1).max())


def in_words(text: str) -> str:
    """Return the name of an encounter, or a text that begins with one, in words."""
    return text.replace("crossing-", "crossing from the ")


def meeting(decision: Decision | None) -> str:
    """Return the caption before an encounter: what the robot would meet, and when, at its present velocity."""
    if decision is None or decision.obstacle is None:
        return "no obstacle is in the robot's way"
    kind = f" ({in_words(decision.encounter)})" if decision.encounter else ""
    when, near = decision.time_to_closest, max(decision.distance_at_closest, 0.0)
    if not np.isfinite(when):
        return f"obstacle {decision.obstacle}{kind} will be in the robot's way"
    how = "would meet" if near == 0.0 else f"would come within {near:.1f} m of"
    return f"obstacle {decision.obstacle}{kind} {how} the robot in {when:.1f} s"


def title_of(decision: Decision | None) -> str:
    """Return the title during an encounter: how the robot reacts to the obstacle."""
    if decision is not None and decision.action == "follow" and decision.obstacle is None:
        return "On its way"
    doing = {"avoid": "Going round it", "wait": "Waiting for it", "brake": "Braking for it", "stuck": "Stuck"}
    doing |= {"step-back": "Stepping back from it", "step-aside": "Stepping aside"}
    return doing.get("" if decision is None else decision.action, "Passing it")
