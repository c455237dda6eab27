"""The ROS 2 node: a lifecycle node that serves plans and drives a robot to goals among tracked obstacles."""

from __future__ import annotations

import importlib
import math
import signal
import time
from array import array
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from antway import checks
from antway.avoidance.policy import AntwayPolicy
from antway.errors import BadInput
from antway.grid import Grid
from antway.planning import Plan, Problem, solve, standing_cell
from antway.ros2 import convert
from antway.ros2.settings import Settings, parameters
from antway.world.episode import run
from antway.world.policy import XY, Decision, Observation, Task
from antway.world.scenario import Scenario
from antway.world.world import World

T = TypeVar("T")
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
OK, WARN, ERROR = 0, 1, 2  # of diagnostic_msgs/msg/DiagnosticStatus


def make(kind: str, **values: Any) -> Any:
    """Make a message, service or action type's message of rclpy."""
    return load(kind)(**{k: array("b", v.tobytes()) if isinstance(v, np.ndarray) else v for k, v in values.items()})


def load(kind: str) -> Any:
    """Return the class of a type such as nav_msgs/msg/Path."""
    package, folder, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), name)


class AntwayNode(LifecycleNode):  # type: ignore[misc]
    """Drive to what comes on `goal_pose`, and stop, saying why, whenever it cannot be done safely.

    Each odometry message begins a control cycle (not oftener than robot.dt); a steady clock, which no jump of the ROS clock
    moves, stops the robot when odometry falls silent. Obstacles that fall silent stop it too.
    """

    def __init__(self) -> None:
        super().__init__("antway")
        self.values: dict[str, Any] = {}
        for name, (default, text) in parameters().items():
            about = make("rcl_interfaces/msg/ParameterDescriptor", description=text)
            if isinstance(default, float):
                about.floating_point_range = [make("rcl_interfaces/msg/FloatingPointRange", from_value=0.0, to_value=math.inf)]
            elif isinstance(default, int) and not isinstance(default, bool):
                about.integer_range = [make("rcl_interfaces/msg/IntegerRange", from_value=0, to_value=2**31, step=1)]
            self.values[name] = self.declare_parameter(name, default, about).value
        self.add_on_set_parameters_callback(self._on_parameters)
        self.parts: list[tuple[Callable[[Any], Any], Any]] = []
        self.active = False
        self._forget()

    def _forget(self) -> None:
        self.grid: Grid | None = None
        self.odometry: tuple[float, XY, XY, float] | None = None
        self.scan: tuple[float, Any] | None = None
        self.goal: XY | None = None
        self.policy: AntwayPolicy | None = None
        self.decision: Decision | None = None
        self.heard, self.begun, self.acted, self.said = -math.inf, 0.0, -math.inf, (OK, "")

    def _on_parameters(self, changed: list[Any]) -> Any:
        values = self.values | {one.name: one.value for one in changed if one.name in self.values}
        try:
            Settings.of(values)
        except BadInput as wrong:
            return make("rcl_interfaces/msg/SetParametersResult", successful=False, reason=str(wrong))
        self.values = values
        return make("rcl_interfaces/msg/SetParametersResult", successful=True)

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Check the parameters, compile every kernel that driving needs, and open topics and services."""
        try:
            self.settings = settings = Settings.of(self.values)
        except BadInput as wrong:
            self.get_logger().error(str(wrong))
            return TransitionCallbackReturn.FAILURE
        room = World(Grid(np.zeros((8, 8), bool)))
        run(Scenario(room, (2.0, 2.0), (6.0, 6.0), horizon=1.0), AntwayPolicy(**settings.policy), record=False)
        solve(Problem(room.grid, (0, 0), (7, 7)), settings.planner, time_limit=1.0)
        self._forget()

        def publisher(kind: str, topic: str, qos: Any = 10) -> Any:
            made = self.create_lifecycle_publisher(load(kind), topic, qos)
            self.parts.append((self.destroy_lifecycle_publisher, made))
            return made

        self.cmd_vel = publisher("geometry_msgs/msg/TwistStamped" if settings.stamped else "geometry_msgs/msg/Twist", "cmd_vel")
        self.plan = publisher("nav_msgs/msg/Path", "plan", LATCHED)
        self.pheromone = publisher("nav_msgs/msg/OccupancyGrid", "pheromone", LATCHED)
        self.diagnostics = None
        if find_spec("diagnostic_msgs"):
            self.diagnostics = publisher("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics")
        for kind, topic, qos, callback in (
            (settings.obstacles_type, "obstacles", SENSOR, self._on_obstacles),
            ("nav_msgs/msg/OccupancyGrid", "map", LATCHED, self._on_map),
            ("nav_msgs/msg/Odometry", "odom", SENSOR, self._on_odometry),
            ("geometry_msgs/msg/PoseStamped", "goal_pose", 10, self._on_goal),
        ):
            self.parts.append((self.destroy_subscription, self.create_subscription(load(kind), topic, callback, qos)))
        for kind, name, serve in (
            ("nav_msgs/srv/GetPlan", "get_plan", self._serve_plan),
            ("std_srvs/srv/Trigger", "~/stop", self._serve_stop),
        ):
            self.parts.append((self.destroy_service, self.create_service(load(kind), name, serve)))
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        for period, tick in ((settings.robot.dt, self._watch), (1.0, self._diagnose)):
            self.parts.append((self.destroy_timer, self.create_timer(period, tick, clock=steady)))
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Begin to drive to goals."""
        done = super().on_activate(state)
        self.active = True
        self._say(OK, "no goal")
        return done

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Stop the robot and drop the goal."""
        self._drop(OK, "deactivated")
        self.active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Close topics and services, and forget map and obstacles."""
        for destroy, part in self.parts:
            destroy(part)
        self.parts.clear()
        self._forget()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Stop the robot and close everything."""
        self.halt()
        return self.on_cleanup(state)

    def halt(self) -> None:
        """Stop the robot if the node drives it."""
        if self.active:
            self._drop(OK, "shut down")
            self.active = False

    # What comes in

    def _read(self, what: str, read: Callable[[Any], T], message: Any) -> T | None:
        """Read a message; one that is malformed or in another frame is refused and named on diagnostics."""
        headers = [message.header] if hasattr(message, "header") else [one.header for one in getattr(message, "markers", [])]
        try:
            for header in headers:
                checks.choice("header.frame_id", header.frame_id, [self.settings.frame], where=what)
            return read(message)
        except BadInput as wrong:
            self._say(ERROR, f"{what} refused: {wrong}")
            return None

    def _on_map(self, message: Any) -> None:
        grid = self._read("map", convert.read_grid, message)
        if grid is not None and (self.grid is None or grid != self.grid):
            self.grid, self.policy = grid, None

    def _on_obstacles(self, message: Any) -> None:
        scan = self._read("obstacles", self.settings.reader, message)
        if scan is not None:
            self.scan = scan

    def _on_goal(self, message: Any) -> None:
        pose = self._read("goal_pose", lambda goal: convert.read_pose(goal.pose), message)
        if pose is None or not self.active:
            return
        if self.goal is not None:
            self._stop(OK, f"the goal {self.goal} is pre-empted by {pose[:2]}")
        self.goal, self.policy = pose[:2], None

    def _on_odometry(self, message: Any) -> None:
        now = self._read("odom", convert.read_odometry, message)
        if now is None:
            return
        before, self.odometry, self.heard = self.odometry, now, time.monotonic()
        if before is not None and not 0.0 <= now[0] - before[0] <= self.settings.timeout:
            self.scan = self.policy = None  # what was seen and planned before means nothing any more
            self.acted = -math.inf
            self._stop(WARN, f"odometry's clock jumped by {now[0] - before[0]:.3f} s")
        elif self.active and self.goal is not None and now[0] - self.acted >= 0.75 * self.settings.robot.dt:
            self.acted = now[0]
            self._cycle(self.goal, *now)

    # Driving

    def _cycle(self, goal: XY, t: float, xy: XY, velocity: XY, heading: float) -> None:
        """Decide and send one command."""
        settings = self.settings
        if math.dist(goal, xy) <= settings.task["goal_tolerance"]:
            return self._drop(OK, f"arrived at {goal}")
        if self.grid is None:
            return self._stop(WARN, "waiting for a map")
        if self.scan is None:
            return self._stop(WARN, "waiting for obstacles")
        stamp, tracks = self.scan
        if abs(t - stamp) > settings.timeout:
            return self._stop(ERROR, f"obstacles are {t - stamp:.2f} s older than odometry: the sensor is silent")
        if stamp > t:  # seen after the robot's place was measured
            xy, t = (xy[0] + velocity[0] * (stamp - t), xy[1] + velocity[1] * (stamp - t)), stamp
        try:
            if self.policy is None:
                policy = AntwayPolicy(**settings.policy)
                policy.reset(Task(self.grid, settings.robot, xy, goal, **settings.task), 0)
                self.policy, self.begun, self.decision = policy, t, None
            command = self.policy.act(Observation(t - self.begun, xy, velocity, heading, tracks, stamp - self.begun))
        except BadInput as wrong:
            return self._drop(ERROR, f"the goal {goal} is refused: {wrong}")
        self._send(convert.twist_message(command, velocity, heading, settings.robot, make))
        decision = self.policy.explain()
        if decision is not self.decision:
            self.decision = decision
            self._show(decision, t)
        return self._say(OK, f"{decision.action}: {decision.reason}")

    def _show(self, decision: Decision, t: float) -> None:
        """Publish the planned motion and the pheromone."""
        frame, grid = self.settings.frame, self.grid
        if decision.path is not None:
            self.plan.publish(convert.path_message(decision.path.xy, make, t=t, frame=frame))
        if decision.pheromone is not None and grid is not None:
            row, col, tau = decision.pheromone
            costs = np.zeros(grid.shape, np.int8)
            costs[row : row + tau.shape[0], col : col + tau.shape[1]] = np.rint(100.0 * tau / max(float(tau.max()), 1e-30))
            self.pheromone.publish(convert.costs_message(costs, grid.resolution, grid.origin, make, t=t, frame=frame))

    def _watch(self) -> None:
        silent = time.monotonic() - self.heard
        if self.active and self.goal is not None and silent > self.settings.timeout:
            self._stop(ERROR, f"no odometry for {self.settings.timeout:g} s")

    def _send(self, twist: Any) -> None:
        if self.settings.stamped:
            t = self.odometry[0] if self.odometry is not None else 0.0
            twist = make("geometry_msgs/msg/TwistStamped", header=convert.header_message(t, "base_link", make), twist=twist)
        self.cmd_vel.publish(twist)

    def _stop(self, level: int, reason: str) -> None:
        """Stop the robot, keep the goal, and say why."""
        self._send(make("geometry_msgs/msg/Twist"))
        self._say(level, reason)

    def _drop(self, level: int, reason: str) -> None:
        """Stop the robot, drop the goal, and say why."""
        self.goal = self.policy = None
        self._stop(level, reason)

    # What is said

    def _say(self, level: int, reason: str) -> None:
        if (level, reason) != self.said:
            self.said = level, reason
            log = self.get_logger()
            if level == ERROR:  # rclpy wants one line of code for each severity
                log.error(reason)
            elif level == WARN:
                log.warning(reason)
            else:
                log.info(reason)
            self._diagnose()

    def _diagnose(self) -> None:
        if self.diagnostics is None or not self.active:
            return
        level, reason = self.said
        status = make(
            "diagnostic_msgs/msg/DiagnosticStatus", level=bytes([level]), name=self.get_name(), message=reason, hardware_id=""
        )
        now = make("std_msgs/msg/Header", stamp=self.get_clock().now().to_msg())
        self.diagnostics.publish(make("diagnostic_msgs/msg/DiagnosticArray", header=now, status=[status]))

    # Services

    def _serve_plan(self, request: Any, response: Any) -> Any:
        """Serve nav_msgs/srv/GetPlan; the path is empty if there is none, and the log says why."""
        ends = [
            self._read(f"get_plan.{name}", lambda end: convert.read_pose(end.pose), getattr(request, name))
            for name in ("start", "goal")
        ]
        response.plan = make("nav_msgs/msg/Path", header=convert.header_message(0.0, self.settings.frame, make))
        if self.grid is None or ends[0] is None or ends[1] is None:
            self.get_logger().warning("get_plan: " + ("no map yet" if self.grid is None else "ends refused"))
            return response
        try:
            plan = self._plan(self.grid, ends[0][:2], ends[1][:2], float(request.tolerance))
        except BadInput as wrong:
            self.get_logger().warning(f"get_plan: {wrong}")
            return response
        self.get_logger().info(f"get_plan: {plan.status.value}")
        response.plan = convert.path_message(plan.xy(self.grid), make, frame=self.settings.frame)
        return response

    def _plan(self, grid: Grid, start: XY, goal: XY, tolerance: float) -> Plan:
        """Plan to `goal`, or to the nearest place within `tolerance` m where the robot can stand."""
        radius = self.settings.robot.radius
        room = grid.inflate(radius)
        free = np.argwhere(~room.blocked)
        try:
            target = standing_cell("goal", goal, grid, room, radius)
        except BadInput:
            away = np.hypot(*(grid.to_xy(free) - goal).T)
            if len(free) == 0 or not away.min() <= tolerance:
                raise
            target = (int(free[away.argmin()][0]), int(free[away.argmin()][1]))
        return solve(Problem(room, standing_cell("start", start, grid, room, radius), target), self.settings.planner)

    def _serve_stop(self, request: Any, response: Any) -> Any:
        response.success, response.message = (
            self.active and self.goal is not None,
            "stopped" if self.goal else "there was no goal",
        )
        if self.active:
            self._drop(OK, "stopped on request")
        return response


def main(arguments: list[str]) -> int:
    """Run the node until SIGINT or SIGTERM; the robot is stopped on the way out."""
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    over = False

    def end(*_: Any) -> None:
        nonlocal over
        over = True

    before = {number: signal.signal(number, end) for number in (signal.SIGINT, signal.SIGTERM)}
    executor, node = SingleThreadedExecutor(), AntwayNode()
    executor.add_node(node)
    try:
        if node.values["autostart"]:
            node.trigger_configure()
            node.trigger_activate()
        while not over:
            executor.spin_once(timeout_sec=0.1)
    finally:
        node.halt()
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0
