"""Types, fields and error codes of the actions of Nav2's planner and controller servers; no ROS import."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadInput, OutOfBounds
from antway.grid import Cell, Grid
from antway.planning import Problem, Status, solve, standing_cell
from antway.ros2.goals import End
from antway.ros2.messages import load, make
from antway.world.line_of_sight import start_cell
from antway.world.policy import XY

T = TypeVar("T")

NONE = 0
# error codes of nav2_msgs/action/ComputePathToPose and FollowPath, the same from Jazzy on; FollowWaypoints has its own
PLAN_UNKNOWN, INVALID_PLANNER, PLAN_TF_ERROR, START_OUTSIDE_MAP, GOAL_OUTSIDE_MAP = 200, 201, 202, 203, 204
START_OCCUPIED, GOAL_OCCUPIED, PLAN_TIMEOUT, NO_VALID_PATH = 205, 206, 207, 208
FOLLOW_UNKNOWN, INVALID_CONTROLLER, FOLLOW_TF_ERROR, INVALID_PATH, PATIENCE_EXCEEDED = 100, 101, 102, 103, 104
FAILED_TO_MAKE_PROGRESS = 105
TASK_EXECUTOR_FAILED, NO_VALID_WAYPOINTS = 601, 602
WAYPOINT_FAILED = 3  # of nav2_msgs/msg/WaypointStatus
ENDS = {
    End.ARRIVED: NONE,
    End.REPLACED: NONE,
    End.DROPPED: FOLLOW_UNKNOWN,
    End.REFUSED: INVALID_PATH,
    End.WAITED: PATIENCE_EXCEEDED,
    End.STUCK: FAILED_TO_MAKE_PROGRESS,
}


@dataclass(frozen=True, slots=True)
class Kind:
    """The type of an action, how to read its goals, and how to make results and feedback from Nav2's fields."""

    type: Any
    read: Callable[[Any], Any]
    result: Callable[..., Any]
    feedback: Callable[..., Any]


def nav2_kinds() -> dict[str, Kind]:
    """Return Nav2's actions by the node's names for them; none if nav2_msgs cannot be imported.

    compute_tour is a ComputePathThroughPoses, and visit_poses a FollowWaypoints, with poses in any order.
    """
    if find_spec("nav2_msgs") is None:
        return {}

    def fitting(kind: Any) -> Callable[..., Any]:
        names = kind.get_fields_and_field_types()
        return lambda **fields: kind(**{name: value for name, value in fields.items() if name in names})

    def kind(name: str) -> Kind:
        action = load(f"nav2_msgs/action/{name}")
        return Kind(action, lambda goal: goal, fitting(action.Result), fitting(action.Feedback))

    def waypoints() -> Kind:
        made = kind("FollowWaypoints")
        listed = made.type.Result.get_fields_and_field_types().get("missed_waypoints", "").partition("<")[2].rstrip(">")

        def missed(index: int, code: int) -> Any:
            """Return a pose that was missed as Humble, Iron and Jazzy, or later releases tell it."""
            if listed == "int32":
                return index
            if listed.endswith("/MissedWaypoint"):
                return make("nav2_msgs/msg/MissedWaypoint", index=index, error_code=code)
            return make("nav2_msgs/msg/WaypointStatus", waypoint_index=index, error_code=code, waypoint_status=WAYPOINT_FAILED)

        def result(missed_waypoints: list[tuple[int, int]], **fields: Any) -> Any:
            return fitting(made.type.Result)(missed_waypoints=[missed(*one) for one in missed_waypoints], **fields)

        return replace(made, result=result)

    return {
        "compute_path_to_pose": kind("ComputePathToPose"),
        "follow_path": kind("FollowPath"),
        "compute_tour": kind("ComputePathThroughPoses"),
        "visit_poses": waypoints(),
    }


class Failure(Exception):
    """Why there is no plan: an error code of ComputePathToPose, and a text."""

    def __init__(self, code: int, reason: str) -> None:
        self.code, self.reason = code, reason
        super().__init__(reason)


def in_thread(executor: Any, work: Callable[[], T], answer: Callable[[T | None, Failure | None], Any]) -> None:
    """Do `work` in a thread while the executor drives the robot; the executor then calls `answer(result, failure)`.

    Whatever `work` raises is a failure: who asked is always answered.
    """

    def run() -> None:
        result, failure = None, None
        try:
            result = work()
        except Failure as found:
            failure = found
        except Exception as error:
            failure = Failure(PLAN_UNKNOWN, f"{type(error).__name__}: {error}")
        executor.create_task(answer, result, failure)

    threading.Thread(target=run, daemon=True).start()


def find_path(
    grid: Grid, inflated: Grid, stops: list[XY], radius: float, planner: str, limit: float, tolerance: float = 0.0
) -> NDArray[np.float64]:
    """Return the cell centres, float64[N, 2] in m, of the shortest path through `stops`, planned within `limit` s.

    `inflated` is `grid` inflated by the robot's `radius`. If the robot cannot stand at the last stop, the path leads to the
    nearest possible place within `tolerance` m. The first stop may be in a wall by some centimetres (`start_cell`). A `Failure`
    with Nav2's error code says why there is no path.
    """
    cells = []
    for i, xy in enumerate(stops):
        try:
            cells.append(standing_cell("goal" if i else "start", xy, grid, inflated, radius))
        except BadInput as wrong:
            near = None
            if i == 0:
                near = start_cell(grid, inflated, xy, math.ceil(radius / grid.resolution) + 1, radius)
            elif i == len(stops) - 1:
                near = _nearest(inflated, xy, tolerance)
            if near is None:
                raise Failure(code_of(wrong, i == 0), str(wrong)) from None
            cells.append(near)
    end, legs = time.monotonic() + limit, list[NDArray[np.float64]]()
    for a, b in pairwise(cells):
        plan = solve(Problem(inflated, a, b), planner, time_limit=max(end - time.monotonic(), 0.0))
        if plan.status is Status.BUDGET:
            raise Failure(PLAN_TIMEOUT, f"no path within {limit:g} s")
        if plan.status is Status.NO_PATH:
            raise Failure(NO_VALID_PATH, "there is no path")
        legs.append(plan.xy(grid)[1 if legs else 0 :])
    return np.vstack(legs)


def code_of(wrong: BadInput, is_start: bool) -> int:
    """Return the error code for the start, or a goal, where the robot cannot stand."""
    if isinstance(wrong, OutOfBounds):
        return START_OUTSIDE_MAP if is_start else GOAL_OUTSIDE_MAP
    return START_OCCUPIED if is_start else GOAL_OCCUPIED


def _nearest(inflated: Grid, xy: XY, tolerance: float) -> Cell | None:
    """Return the free cell of `inflated` nearest to `xy` m, if its centre is within `tolerance` m."""
    free = np.argwhere(~inflated.blocked)
    away = np.hypot(*(inflated.to_xy(free) - xy).T)
    if len(free) == 0 or not away.min() <= tolerance:
        return None
    row, col = free[away.argmin()].tolist()
    return row, col
