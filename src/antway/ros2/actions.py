"""The services of the node: GetPlan, Nav2's actions compute_path_to_pose and follow_path, and two actions for tours."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from antway.errors import BadInput
from antway.grid import Grid
from antway.planning import PLANNERS
from antway.ros2 import convert, frames, nav2
from antway.ros2.frames import Pose
from antway.ros2.goals import End, Goal
from antway.ros2.messages import load, make
from antway.ros2.nav2 import Failure, Kind, in_thread
from antway.ros2.outset import inflated
from antway.ros2.path import tracking
from antway.ros2.pilot import Pilot
from antway.ros2.tours import TourGoal, find_tour

if TYPE_CHECKING:
    from antway.ros2.node import AntwayNode

_THROUGH = 100  # offset of error codes of ComputePathThroughPoses from those of ComputePathToPose


class Served:
    """The service and the actions of a configured node. Planning runs in parallel to the executor, which drives."""

    def __init__(self, node: AntwayNode, kinds: dict[str, Kind]) -> None:
        self.node, self.kinds, self.open = node, kinds, True
        self.asked = 0  # number of plans that the service has not answered yet
        self.ending = 0  # number of goals that have ended, whose results the executor has not sent yet
        self.following: Any = None  # the goal handle of follow_path or visit_poses
        self.service = node.create_service(load("nav_msgs/srv/GetPlan"), "get_plan", self._get_plan)
        self.servers = [
            ActionServer(
                node,
                kinds[name].type,
                name,
                execute_callback=lambda handle: None,  # replaced when a goal ends
                goal_callback=lambda goal: GoalResponse.ACCEPT if node.active else GoalResponse.REJECT,
                handle_accepted_callback=accepted,
                cancel_callback=cancel,
            )
            for name, accepted, cancel in (
                ("compute_path_to_pose", self._compute, lambda handle: CancelResponse.ACCEPT),
                ("follow_path", self._follow, self._cancel),
                ("compute_tour", self._compute_tour, lambda handle: CancelResponse.ACCEPT),
                ("visit_poses", self._visit, self._cancel),
            )
            if name in kinds
        ]

    def close(self) -> None:
        """Close service and actions. Pending plans of actions are dropped; those of the service are answered first."""
        self.open = False
        if not self.asked:
            self.node.destroy_service(self.service)
        for server in self.servers:
            if self.ending:  # a task makes their results, and another sends them; this one comes after both
                self.node.executor.create_task(self.node.executor.create_task, server.destroy)
            else:
                server.destroy()

    @property
    def unanswered(self) -> bool:
        """Whether results have not been sent yet; a task makes each, and another sends it."""
        return self.following is not None or self.ending > 0

    # Plans

    def _plan(
        self, stops: list[Any], planner: str, done: Callable[[Any, Failure | None], None], tolerance: float = 0.0
    ) -> None:
        """Plan through the PoseStampeds `stops` (None: the robot's place); `done` gets a Path, empty on failure."""
        node, settings, path = self.node, self.node.settings, self._no_path()
        try:
            places = [self._place(stop) for stop in stops]
            grid = self._map()
        except Failure as failure:
            return done(path, failure)

        def answer(xy: Any, failure: Failure | None) -> None:
            if failure is None:
                path.poses = convert.path_message(xy, make, frame=settings.frame).poses
                path.poses[-1].pose.orientation = convert.pose_message(*places[-1], make).orientation
            done(path, failure)

        def work() -> NDArray[np.float64]:
            radius = settings.robot.radius
            wide = inflated(grid, radius)
            return nav2.find_path(grid, wide, [p[:2] for p in places], radius, planner, settings.plan_time, tolerance)

        return in_thread(node.executor, work, answer)

    def _no_path(self) -> Any:
        """Return a nav_msgs/msg/Path without poses."""
        return make("nav_msgs/msg/Path", header=convert.header_message(0.0, self.node.settings.frame, make))

    def _map(self) -> Grid:
        """Return the map, or raise `Failure` if there is none yet."""
        if self.node.pilot.map is None:
            raise Failure(nav2.PLAN_UNKNOWN, "no map yet")
        return self.node.pilot.map

    def _place(self, stop: Any) -> Pose:
        """Return a PoseStamped (None: the robot's place) in the map's frame, or raise `Failure`."""
        if stop is None:
            odometry = self.node.pilot.odometry
            if odometry is None:
                raise Failure(nav2.PLAN_TF_ERROR, "where the robot is, is not known: no odometry yet")
            return (*odometry.xy, odometry.heading)
        try:
            return self.node.place(stop.header, stop.pose)
        except BadInput as wrong:
            raise Failure(nav2.PLAN_TF_ERROR, str(wrong)) from None

    async def _get_plan(self, request: Any, response: Any) -> Any:
        """Serve nav_msgs/srv/GetPlan; if there is no path, it is empty and the log says why."""
        node, ready = self.node, Future()
        self.asked += 1
        self._plan(
            [request.start, request.goal],
            node.settings.planner,
            lambda *found: ready.set_result(found),
            float(request.tolerance),
        )
        response.plan, failure = await ready
        self.asked -= 1
        if not self.open and not self.asked:
            node.executor.create_task(node.destroy_service, self.service)
        node.get_logger().info(f"get_plan: {failure.reason if failure else f'{len(response.plan.poses)} poses'}")
        return response

    def _compute(self, handle: Any) -> None:
        """Serve compute_path_to_pose."""
        settings, kind, started = self.node.settings, self.kinds["compute_path_to_pose"], time.monotonic()
        goal = kind.read(handle.request)

        def done(path: Any, failure: Failure | None) -> None:
            self._planned(handle, "compute_path_to_pose", started, path, failure)

        planner = settings.planner if goal.planner_id in ("", settings.planner_id) else goal.planner_id
        if planner not in PLANNERS:
            allowed = ", ".join((settings.planner_id, *PLANNERS))
            return done(
                make("nav_msgs/msg/Path"), Failure(nav2.INVALID_PLANNER, f"planner_id = {planner!r}: must be one of {allowed}")
            )
        start = goal.start if goal.use_start else None
        return self._plan([start, *getattr(goal, "viapoints", ()), goal.goal], planner, done)

    def _planned(self, handle: Any, name: str, started: float, path: Any, failure: Failure | None) -> None:
        """End a goal whose result is a path that was requested at `started` s of the steady clock."""
        if not self.open:
            return
        offset = _THROUGH if name == "compute_tour" else 0
        code, reason = (nav2.NONE, "") if failure is None else (offset + failure.code, failure.reason)
        if reason:
            self.node.get_logger().error(f"{name}: {reason}")
        seconds = time.monotonic() - started
        took = make("builtin_interfaces/msg/Duration", sec=int(seconds), nanosec=int(seconds % 1.0 * 1e9))
        self._finish(handle, self.kinds[name], code, path=path, planning_time=took, error_code=code, error_msg=reason)

    def _compute_tour(self, handle: Any) -> None:
        """Serve compute_tour: the path through all goals in the best order, with the goals' yaws."""
        node, kind, started = self.node, self.kinds["compute_tour"], time.monotonic()
        goal, path = kind.read(handle.request), self._no_path()
        try:
            grid = self._map()
            goals = getattr(goal.goals, "goals", goal.goals)  # nav_msgs/msg/Goals in newer releases, a list in older ones
            if len(goals) == 0:
                code = getattr(getattr(kind.type, "Result", None), "NO_VIAPOINTS_GIVEN", _THROUGH + nav2.NO_VALID_PATH)
                raise Failure(code - _THROUGH, "goals = []: must be at least one")
            places = [self._place(goal.start if goal.use_start else None), *(self._place(one) for one in goals)]
        except Failure as failure:
            return self._planned(handle, "compute_tour", started, path, failure)

        def answer(xy: Any, failure: Failure | None) -> None:
            if failure is None:
                path.poses = convert.path_message(xy, make, frame=node.settings.frame).poses
                for place in places[1:]:
                    nearest = int(np.hypot(*(xy - place[:2]).T).argmin())
                    path.poses[nearest].pose.orientation = convert.pose_message(*place, make).orientation
            self._planned(handle, "compute_tour", started, path, failure)

        return in_thread(node.executor, lambda: find_tour(grid, places, node.settings.robot.radius)[1], answer)

    # Driving

    def _visit(self, handle: Any) -> None:
        """Serve visit_poses: drive to all poses in the best order."""
        kind = self.kinds["visit_poses"]
        goal = kind.read(handle.request)

        def ended(code: int, reason: str, missed: list[tuple[int, int]]) -> None:
            if self.following is handle:
                self.following = None
            if self.open:
                self._finish(handle, kind, code, missed_waypoints=missed, error_code=code, error_msg=reason)

        def feed(index: int) -> None:
            if handle.is_active:
                handle.publish_feedback(kind.feedback(current_waypoint=index))

        try:
            self._map()
            start, *poses = [self._place(None), *(self._place(one) for one in goal.poses)]
        except Failure as failure:
            return ended(nav2.NO_VALID_WAYPOINTS, failure.reason, [])
        if self.node.pilot.goal is not None:
            self.node.drop("pre-empted by a tour")
        self.following = handle
        TourGoal(self.node, start, poses, int(goal.number_of_loops), ended, feed)
        return None

    def _follow(self, handle: Any) -> None:
        """Serve follow_path."""
        node, kind = self.node, self.kinds["follow_path"]
        goal = kind.read(handle.request)
        error = None
        if goal.controller_id not in ("", node.settings.controller_id):
            error = nav2.INVALID_CONTROLLER, f"controller_id = {goal.controller_id!r}: must be {node.settings.controller_id}"
        elif len(goal.path.poses) == 0:
            error = nav2.INVALID_PATH, "path.poses = []: must be at least one pose"
        else:
            try:
                path = frames.move(node.frame(goal.path.header.frame_id), convert.read_path(goal.path))
            except BadInput as wrong:
                tf = wrong.field == "header.frame_id" or "tf" in wrong.field
                error = nav2.FOLLOW_TF_ERROR if tf else nav2.INVALID_PATH, str(wrong)
        if error is not None:
            if node.busy:  # as in Nav2, where a goal ends the one before it whether it can be followed or not
                node.drop("pre-empted by a goal that is refused")
            node.get_logger().error(f"follow_path: {error[1]}")
            return self._finish(handle, kind, error[0], error_code=error[0], error_msg=error[1])

        def done(end: End, reason: str) -> None:
            if self.following is handle:
                self.following = None
            self._finish(handle, kind, nav2.ENDS[end], end is End.REPLACED, error_code=nav2.ENDS[end], error_msg=reason)

        end = float(path[-1, 0]), float(path[-1, 1])
        node.orders += 1
        node.go(Goal(end, path, gives_up=True), done, lambda: self._feed(handle, kind, path))
        self.following = handle
        return None

    def _feed(self, handle: Any, kind: Kind, path: NDArray[np.float64]) -> None:
        """Publish feedback of follow_path."""
        pilot: Pilot = self.node.pilot
        if not handle.is_active or pilot.odometry is None:
            return
        t, xy, velocity, heading, _ = pilot.odometry
        found = tracking(path, xy, heading)
        speed = math.hypot(*velocity)
        fields = {"distance_to_goal": found.left, "speed": speed}
        if "tracking_feedback" in kind.type.Feedback.get_fields_and_field_types():
            header = convert.header_message(t, self.node.settings.frame, make)
            fields["tracking_feedback"] = make(
                "nav2_msgs/msg/TrackingFeedback",
                header=header,
                position_tracking_error=found.aside,
                heading_tracking_error=found.turned,
                current_path_index=found.index,
                robot_pose=make("geometry_msgs/msg/PoseStamped", header=header, pose=convert.pose_message(*xy, heading, make)),
                distance_to_goal=math.dist(xy, path[-1]),
                speed=speed,
                remaining_path_length=found.left,
            )
        handle.publish_feedback(kind.feedback(**fields))

    def _cancel(self, handle: Any) -> CancelResponse:
        """Stop the robot, if it drives to this goal."""
        if self.following is None or handle.goal_id != self.following.goal_id:
            return CancelResponse.REJECT
        self.node.drop("the goal is cancelled")
        return CancelResponse.ACCEPT

    def _finish(self, handle: Any, kind: Kind, code: int, aborted: bool = False, **fields: Any) -> None:
        """End a goal: cancelled if requested, aborted with an error code or if replaced, else a success."""

        def end(handle: Any) -> Any:
            self.ending -= 1
            if handle.is_cancel_requested:
                fields["error_code"] = nav2.NONE
                handle.canceled()
            elif aborted or code != nav2.NONE:
                handle.abort()
            else:
                handle.succeed()
            return kind.result(**fields)

        self.ending += 1
        handle.execute(end)
