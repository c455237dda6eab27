"""The ROS 2 node: a lifecycle node that serves plans and drives a robot to goals among tracked obstacles."""

from __future__ import annotations

import math
import signal
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np
import rclpy
from rclpy._rclpy_pybind11 import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from antway.errors import BadInput, BadParameter
from antway.grid import Grid
from antway.policies.guard_process import GuardProcess
from antway.ros2 import convert, frames
from antway.ros2.actions import Served
from antway.ros2.compile import compile_for
from antway.ros2.declared import Declared
from antway.ros2.driver import open_driver, stamp_twist, twist_type
from antway.ros2.frames import Odometry, Pose
from antway.ros2.goals import ERROR, OK, STAND, WARN, End, Goal, PilotAnswer
from antway.ros2.markers import Pictures
from antway.ros2.messages import load, make
from antway.ros2.nav2 import Kind, nav2_kinds
from antway.ros2.pilot import OBSTACLES, ODOMETRY, Pilot
from antway.ros2.reports import Reports
from antway.ros2.scan import Background, Laser, ScanTracker, discs, newest_reached, without_ids
from antway.ros2.settings import LASER, Settings
from antway.ros2.tf import Transforms
from antway.world.policy import Command, Task, Tracks

T = TypeVar("T")
LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
UPDATES = QoSProfile(depth=10, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)
NEWEST = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # older odometry is of no use to a node that was busy
_SENT_IN = 0.3  # s; tasks of the executor send results within this time, among the messages that still come in
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


class AntwayNode(LifecycleNode):  # type: ignore[misc]
    """Converts messages for the pilot, and its answers to messages.

    Its actions are of these `kinds`, by name; None: those of Nav2, if nav2_msgs can be imported.
    """

    def __init__(self, kinds: Mapping[str, Kind] | None = None) -> None:
        super().__init__("antway")
        self.kinds = nav2_kinds() if kinds is None else dict(kinds)
        self.declared = Declared(self)
        self.parts: list[tuple[Callable[[Any], Any], Any]] = []
        self.active = self.compiling = False
        self.orders = 0  # number of goals, tours and stops that were asked for; it only grows, because tours compare it

    # Up and down

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Check the parameters, compile every kernel that driving needs, and open topics, services and actions."""
        try:
            self.settings = settings = Settings.of(self.declared.values)
            try:
                kind = load(settings.obstacles_type)
            except (ImportError, AttributeError) as error:
                allowed = f"a type that can be imported ({error})"
                raise BadParameter("obstacles_type", settings.obstacles_type, allowed) from None
            self.get_logger().info(f"the robot is {settings.robot}")
            self.compiling = True
            compile_for(settings)
            self.declared.tell(settings.robot)
            self._open(kind)
        except Exception as error:  # rclpy would say nothing
            self.get_logger().error(str(error) if isinstance(error, BadInput) else f"{type(error).__name__}: {error}")
            self.on_cleanup(state)
            return TransitionCallbackReturn.FAILURE
        finally:
            self.compiling = False
        self.declared.configured = True
        return TransitionCallbackReturn.SUCCESS

    def _open(self, kind: Any) -> None:
        """Start without map, obstacles and goal; `kind` is the class of messages on obstacles."""
        self.tracker = ScanTracker()
        self.done: Callable[[End, str], None] | None = None  # called with how the drive to the goal ended
        self.feed: Callable[[], None] | None = None  # called after each command
        self.maps = convert.MapReader(self.settings.frame, self.settings.map_occupied)
        self.laser = Laser(self.settings.timeout)
        self.background: Background | None = None  # of the map, for laser scans
        self.heard = time.monotonic()  # s; when odometry was last good
        self.answered = self._seconds()  # s; when it was last answered
        self.stood = -math.inf, 0.0  # s; when the robot was last told to stand, and when that is to be repeated
        self._open_publishers()
        self._open_subscriptions(kind)
        self.parts.append((self.destroy_service, self.create_service(load("std_srvs/srv/Trigger"), "~/stop", self._serve_stop)))
        self.transforms = Transforms(self)
        self.parts.append((Transforms.close, self.transforms))
        self.served = Served(self, self.kinds)
        self.parts.append((Served.close, self.served))
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # unaffected by jumps of the ROS clock
        for period, tick in ((self.settings.robot.dt / 4, self._watch), (1.0, self.reports.publish)):
            self.parts.append((self.destroy_timer, self.create_timer(period, tick, clock=steady)))

    def _open_publishers(self) -> None:
        """Open the topics that the node sends to, and make the pilot, whose guard process sends commands to one of them."""
        settings = self.settings

        def publisher(kind: str, topic: str, qos: Any = 10) -> Any:
            made = self.create_lifecycle_publisher(load(kind), topic, qos)
            self.parts.append((self.destroy_lifecycle_publisher, made))
            return made

        self.cmd_vel = publisher(twist_type(settings.stamped), "cmd_vel")
        task = Task(Grid(np.zeros((8, 8), bool)), settings.robot, (2.0, 2.0), (6.0, 6.0), **settings.task)
        self.pilot = Pilot(settings, self._guard_process(task))
        self.pictures = Pictures(
            self.pilot, settings.frame, lambda kind, topic, latched: publisher(kind, topic, LATCHED if latched else 10)
        )
        known = find_spec("diagnostic_msgs")
        self.reports = Reports(self, publisher("diagnostic_msgs/msg/DiagnosticArray", "/diagnostics") if known else None)

    def _open_subscriptions(self, kind: Any) -> None:
        """Open the topics that the node receives; `kind` is the class of messages on obstacles."""
        settings = self.settings
        scans = settings.obstacles_type == LASER and settings.reader is None
        wanted = [
            (kind, "scan" if scans else "obstacles", SENSOR, self._on_scan if scans else self._on_obstacles),
            (load("nav_msgs/msg/OccupancyGrid"), "map", LATCHED, self._on_map),
            (load("nav_msgs/msg/Odometry"), "odom", NEWEST, self._on_odometry),
            (load("geometry_msgs/msg/PoseStamped"), "goal_pose", 10, self._on_goal),
        ]
        if find_spec("map_msgs"):  # as Nav2 sends them beside a costmap
            topic, update = f"{self.resolve_topic_name('map')}_updates", load("map_msgs/msg/OccupancyGridUpdate")
            wanted.append((update, topic, UPDATES, self._on_map))
        for message, topic, qos, callback in wanted:
            self.parts.append((self.destroy_subscription, self.create_subscription(message, topic, callback, qos)))

    def _guard_process(self, task: Task) -> GuardProcess | None:
        """Start the guard process, if requested, which sends commands to the topic of this node."""
        settings = self.settings
        if not settings.guard_process:
            return None
        driver = partial(
            open_driver,
            self.cmd_vel.topic_name,
            settings.base_frame if settings.stamped else None,
            settings.robot,
            self.get_namespace(),
        )
        made = GuardProcess(task, slack=settings.robot.dt / 2, emit=driver, mode=settings.policy["mode"])
        self.parts.append((GuardProcess.close, made))
        return made

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Start driving to goals."""
        done = super().on_activate(state)
        self.active, self.heard, self.answered = True, time.monotonic(), self._seconds()
        self.reports.say(OK, "no goal")
        return done

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Stop the robot and drop the goal."""
        self.halt("deactivated")
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Close topics, services and actions, and forget map and obstacles."""
        for destroy, part in self.parts:
            destroy(part)
        self.parts.clear()
        self.declared.configured = False
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Stop the robot and close everything."""
        self.halt("shut down")
        return self.on_cleanup(state)

    def on_error(self, state: Any) -> TransitionCallbackReturn:
        """Close everything after a transition that raised an error: the node is not configured then."""
        self.active = False
        return self.on_cleanup(state)

    def halt(self, reason: str) -> None:
        """Stop the robot if the node drives it."""
        if self.active:
            self.drop(reason)
            for answer in self.pilot.braking():
                self._do(answer)
            self.active = False
            self.cmd_vel.wait_for_all_acked(Duration(seconds=1.0))  # or the stop is lost with the node

    # What comes in

    def place(self, header: Any, pose: Any) -> Pose:
        """Return a geometry_msgs/msg/Pose in the frame of `header` in the map's frame, or raise `BadInput`."""
        return frames.chain(self.frame(header.frame_id), convert.read_pose(pose))

    def frame(self, name: str) -> Pose:
        """Return the pose of the frame `name` in the map's."""
        t = self.pilot.odometry.t if self.pilot.odometry else -math.inf
        return self.transforms.pose(name, self.settings.frame, t, self.settings.timeout)

    def _read(self, what: str, read: Callable[[Any], T], message: Any) -> T | None:
        """Read a message; an invalid one, or one in an unknown frame, is refused and reported on diagnostics."""
        try:
            found = read(message)
        except BadInput as wrong:
            reason = f"{what} refused: {wrong}"
            self.pilot.faults[what] = time.monotonic(), reason
            self.reports.say(ERROR, reason)
            return None
        self.pilot.faults.pop(what, None)
        return found

    def _on_map(self, message: Any) -> None:
        """Receive a map, or an update of a part of it, unless it is older than the map in use."""
        grid = self._read("map", self.maps.read if hasattr(message, "info") else self.maps.update, message)
        if grid is not None:
            self._do(self.pilot.receive_map(grid))

    def _on_goal(self, message: Any) -> None:
        if not self.active:
            self.get_logger().warning("goal_pose is ignored, because the node is not active")
        elif pose := self._read("goal_pose", lambda goal: self.place(goal.header, goal.pose), message):
            self.orders += 1
            self.go(Goal(pose[:2], yaw=pose[2]))
        elif self.busy:  # whoever sent it does not want the robot to go where it was going
            self.drop(self.pilot.faults["goal_pose"][1], ERROR)

    def _on_obstacles(self, message: Any) -> None:
        """Receive obstacles, whose missing names and velocities the tracker adds."""

        def read(message: Any) -> tuple[float, Tracks] | None:
            assert self.settings.reader is not None
            t, tracks = self.settings.reader(message)
            if self.pilot.overtaken(t):
                return self.pilot.scan
            headers = [message.header] if hasattr(message, "header") else convert.placed_headers(message)
            names = {header.frame_id for header in headers}
            if len(names) > 1:
                raise BadParameter("header.frame_id", sorted(names), "the same throughout a message")
            frame = self.frame(names.pop()) if names else frames.HERE
            here = self.pilot.odometry.xy if self.pilot.odometry else (0.0, 0.0)
            return t, self.tracker.update(t, frames.move_tracks(frame, tracks), here)

        found = self._read(OBSTACLES, read, message)
        if found is not None:
            self.pilot.scan = found

    def _on_scan(self, message: Any) -> None:
        """Keep a laser scan until odometry tells where the robot was at its time."""
        stamp = self._read(OBSTACLES, lambda scan: convert.seconds(scan.header.stamp), message)
        if stamp is not None:
            self.laser.receive(stamp, message)

    def _see(self, t: float) -> None:
        """Use the newest of the kept scans whose times odometry, now at `t` s, has reached."""
        settings, grid, laser = self.settings, self.pilot.map, self.laser
        reached = None if grid is None else newest_reached(laser.waiting, t)
        if (ahead := laser.drop_newer(t, settings.timeout)) > 0.0:
            self.pilot.faults[OBSTACLES] = time.monotonic(), f"scans are {ahead:.2f} s newer than odometry"
        if grid is None or reached is None or self.pilot.overtaken(laser.middle(reached)):
            return

        def read(scan: tuple[float, Any]) -> tuple[float, Tracks]:
            seen, (_, (x, y, _)) = laser.middle(scan), laser.trail[-1]
            mount = self.transforms.mount(scan[1].header.frame_id, settings.base_frame, scan[0], settings.timeout)
            if self.background is None or self.background.grid is not grid:
                self.background = Background(grid, settings.scan_clear)
            points = self.background.off(laser.placed(scan, *mount, settings.scan_valid), (x, y))
            places = discs(points, gap=settings.scan_gap, largest=settings.scan_radius)
            return seen, self.tracker.update(seen, without_ids(places.xy, places.radius), (x, y), places)

        found = self._read(OBSTACLES, read, reached)
        if found is not None:
            self.pilot.scan = found

    def _on_odometry(self, message: Any) -> None:
        """Receive odometry, which starts a control cycle when one is due."""

        def read(message: Any) -> Odometry:
            odometry = convert.read_odometry(message)
            frames.check_age(odometry, self.get_clock().now().nanoseconds * 1e-9, self.settings.timeout)
            frame = self.transforms.pose(message.header.frame_id, self.settings.frame, odometry.t, self.settings.timeout)
            return frames.move_odometry(frame, odometry)

        odometry = self._read(ODOMETRY, read, message)
        if odometry is None:
            return
        t, now, late = odometry.t, time.monotonic(), self.laser.newest - odometry.t
        if self.pilot.is_late(t):
            return
        if late > 0.0 and (refused := self.maps.time_went_back()) is not None:  # an older map may be newer then
            self._on_map(refused)
        self.laser.moved(t, (*odometry.xy, odometry.heading))
        self._see(t)
        policy, answer = self.pilot.policy, self.pilot.receive_odometry(odometry, now)
        drives, took = self._do(answer), time.monotonic() - now
        if answer is not None:
            self.answered = self._seconds()
        if drives:
            self.pictures.show(t)
            if took > self.settings.robot.dt and policy is self.pilot.policy:  # to set out may take longer
                self.reports.add(WARN, f"a control cycle took {took:.2f} s, longer than robot.dt: the computer is too slow")
        if late == 0.0:  # what does not move on is silent
            self.pilot.faults[ODOMETRY] = now, f"odometry's stamp stays at {t:.3f} s"
        else:
            self.heard = time.monotonic()  # the time for the start does not count as silence

    def _seconds(self) -> float:
        """Return the time by the clock of a simulation, which may be slow, or by a steady one, s."""
        clock = self.get_clock()
        return float(clock.now().nanoseconds * 1e-9) if clock.ros_time_is_active else time.monotonic()

    def _watch(self) -> None:
        """Brake if odometry is late, and repeat the command to stand for `timeout`, unless others may drive the robot."""
        now, (stood, again), settings = time.monotonic(), self.stood, self.settings
        self._do(self.pilot.silent(now - self.heard, self._seconds() - self.answered))
        if self.active and self.pilot.rests and again <= now <= stood + settings.timeout:
            self.stood = stood, again + settings.robot.dt
            if self.count_publishers(self.cmd_vel.topic_name) <= 1 + settings.guard_process:
                self._send(STAND)

    def _serve_stop(self, request: Any, response: Any) -> Any:
        stops = self.active and (self.busy or not self.pilot.rests)
        response.success, response.message = stops, "stopped" if stops else "there was no goal, and the robot stands"
        if self.active:
            self.drop("stopped on request")
        return response

    # What goes out

    def go(self, goal: Goal, done: Callable[[End, str], None] | None = None, feed: Callable[[], None] | None = None) -> None:
        """Drive to `goal`; `done` is called with how that ended, `feed` after each command."""
        if self.pilot.goal is None:
            self._check_topics()
        self._do(self.pilot.go(goal))
        self.done, self.feed = done, feed

    def _check_topics(self) -> None:
        """Warn of topics with which no drive can go well."""
        dt, period, topic = self.settings.robot.dt, self.pilot.period(), self.cmd_vel.topic_name
        if not (period < 0.6 * dt or 0.9 * dt < period < 1.1 * dt):
            self.reports.say(
                WARN, f"odometry comes each {period:.2f} s: it should each robot.dt, {dt:g} s, or at least twice as often"
            )
        if self.cmd_vel.get_subscription_count() == 0:
            kind, other = twist_type(self.settings.stamped), twist_type(not self.settings.stamped)
            self.reports.say(WARN, f"nothing takes {kind} on {topic}; if the base takes {other} there, change `stamped`")

    def drop(self, reason: str, level: int = OK) -> None:
        """Stop the robot and drop the goal."""
        self.orders += 1
        self._do(self.pilot.drop(reason, level=level))

    @property
    def busy(self) -> bool:
        """Whether the robot drives to a goal, or a tour is being planned."""
        return self.pilot.goal is not None or self.served.following is not None

    def _do(self, answer: PilotAnswer | None) -> bool:
        """Send the pilot's answer, if there is one; True where the robot drives."""
        if answer is None or not self.active:
            return False
        if not answer.drives:
            now = time.monotonic()
            self.stood = now, now + self.settings.robot.dt
        if not (answer.drives and self.settings.guard_process):  # else the guard process has sent it
            self._send(answer.command)
        say = self.reports.note if answer.drives and answer.end is End.REPLACED else self.reports.say
        say(answer.level, answer.reason)
        if answer.end is not None and self.done is not None:
            done, self.done, self.feed = self.done, None, None
            done(answer.end, answer.reason)
        elif self.feed is not None:
            self.feed()
        return answer.drives

    def _send(self, command: Command) -> None:
        """Send a command to the robot."""
        settings = self.settings
        t, _, velocity, heading, _ = self.pilot.odometry or Odometry(0.0, (0.0, 0.0), (0.0, 0.0), 0.0)
        twist = make("geometry_msgs/msg/Twist")
        if command is not STAND:
            twist = convert.twist_message(command, velocity, heading, settings.robot, make)
        self.cmd_vel.publish(stamp_twist(twist, t, settings.base_frame if settings.stamped else None))


def main(arguments: list[str], kinds: Mapping[str, Kind] | None = None) -> int:
    """Run the node (with the actions `kinds`, if given) until SIGINT, SIGTERM or SIGHUP, and stop the robot at the end."""
    over, node = False, None

    def end(*_: Any) -> None:
        nonlocal over
        before, over = over, True
        if node is not None and node.compiling and not before:  # which may take minutes, and nothing moves
            raise KeyboardInterrupt

    numbers = [signal.SIGINT, signal.SIGTERM]
    if signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:  # which nohup wants
        numbers.append(signal.SIGHUP)
    before = {number: signal.signal(number, end) for number in numbers}
    try:
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        executor, node = SingleThreadedExecutor(), AntwayNode(kinds)
    except (BadInput, ParameterException, RCLError) as error:
        rclpy.try_shutdown()
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    executor.add_node(node)
    try:
        if node.declared.values["autostart"] and node.trigger_configure() is TransitionCallbackReturn.SUCCESS:
            node.trigger_activate()
        if not node.declared.configured:
            name = node.get_fully_qualified_name()
            node.get_logger().info(f"waiting for a lifecycle manager, or `ros2 lifecycle set {name} configure` and `activate`")
        while not over:
            executor.spin_once(timeout_sec=0.1)
    except KeyboardInterrupt:
        node.get_logger().info("ended while it compiled")
    finally:
        node.halt("shut down")
        _deliver(node, executor)
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()
        for number, handler in before.items():
            signal.signal(number, handler)
    return 0


def _deliver(node: AntwayNode, executor: Any) -> None:
    """Let the executor send the results of actions that have ended with the drive, for at most a second."""
    now = time.monotonic()
    until, more = now + 1.0, now + _SENT_IN * node.declared.configured
    while time.monotonic() < min(until, more):
        if node.served.unanswered:
            more = time.monotonic() + _SENT_IN
        executor.spin_once(timeout_sec=0.02)
