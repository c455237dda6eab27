"""Tours for the node's actions compute_tour and visit_poses: many places in the best order."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadInput, CellBlocked, OutOfBounds
from antway.grid import Grid
from antway.ros2 import nav2
from antway.ros2.frames import Pose
from antway.ros2.goals import End, Goal
from antway.ros2.nav2 import Failure, in_thread
from antway.tours.plan import plan_tour

if TYPE_CHECKING:
    from antway.ros2.node import AntwayNode

SECONDS = 1.0  # s; time of the search for the best order


def find_tour(grid: Grid, places: list[Pose], radius: float) -> tuple[list[int], NDArray[np.float64]]:
    """Return the best order of `places` after the first, which is the start, and the path through them, float64[N, 2] in m.

    A `Failure` with Nav2's error code says why there is none.
    """
    start, *stops = [place[:2] for place in places]
    try:
        tour = plan_tour(grid, start, stops, robot_radius=radius, seconds=SECONDS)
    except (OutOfBounds, CellBlocked) as wrong:
        raise Failure(nav2.code_of(wrong, wrong.field == "start"), str(wrong)) from None
    except BadInput as wrong:
        raise Failure(nav2.NO_VALID_PATH, str(wrong)) from None
    return tour.order.tolist(), np.vstack([np.array([start]), *(leg.xy(grid) for leg in tour.legs)])


class TourGoal:
    """A goal of visit_poses: drives from `start` to `poses` in the best order, and skips those that it cannot reach.

    After the first round there are `loops` repetitions. `ended` is called once, with Nav2's error code, a text, and (index,
    code) of each pose that was missed; `feed` after each command, with the index of the present destination.
    """

    def __init__(
        self,
        node: AntwayNode,
        start: Pose,
        poses: list[Pose],
        loops: int,
        ended: Callable[[int, str, list[tuple[int, int]]], None],
        feed: Callable[[int], None],
    ) -> None:
        self.node, self.poses, self.loops, self.ended, self.feed = node, poses, loops, ended, feed
        node.orders += 1
        self.order, self.left = list[int](), list[int]()
        self.missed: list[tuple[int, int]] = []
        grid, radius = node.pilot.map, node.settings.robot.radius
        assert grid is not None, "a map comes first"
        work, asked = lambda: find_tour(grid, [start, *poses], radius)[0], node.orders
        in_thread(node.executor, work, lambda order, failure: self._set_out(order, failure, asked))

    def _set_out(self, order: list[int] | None, failure: Failure | None, asked: int) -> None:
        """Drive to the first pose, or end if no order was found or the robot got another order than that number meanwhile."""
        if failure is not None:
            return self.ended(nav2.NO_VALID_WAYPOINTS, failure.reason, [])
        assert order is not None, "a failure says why there is none"
        if self.node.orders != asked:
            reason = "the robot was stopped or sent elsewhere before the tour began"
            return self.ended(nav2.TASK_EXECUTOR_FAILED, reason, [(i, nav2.TASK_EXECUTOR_FAILED) for i in order])
        self.order, self.left = order, order.copy()
        return self._next()

    def _next(self) -> None:
        """Drive to the next pose, or end."""
        if not self.left and self.loops > 0:
            self.loops, self.left = self.loops - 1, self.order.copy()
        if not self.left:
            reason = f"missed {[index for index, _ in self.missed]}" if self.missed else ""
            return self.ended(nav2.NONE, reason, self.missed)
        index = self.left[0]
        x, y, yaw = self.poses[index]
        return self.node.go(Goal((x, y), gives_up=True, yaw=yaw), self._arrived, lambda: self.feed(index))

    def _arrived(self, end: End, reason: str) -> None:
        """Continue after a pose, unless the robot was sent elsewhere or stopped."""
        index = self.left.pop(0)
        if end in (End.REPLACED, End.DROPPED):
            left = [index, *self.left, *(self.order if self.loops else [])]
            away = [(i, nav2.TASK_EXECUTOR_FAILED) for i in dict.fromkeys(left)]
            return self.ended(nav2.TASK_EXECUTOR_FAILED, reason, self.missed + away)
        if end is not End.ARRIVED:
            self.missed.append((index, nav2.ENDS[end]))
        return self._next()
