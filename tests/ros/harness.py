"""The robot's side of the topics, for the scripts beside this one; every wait is for a message that must come."""

from __future__ import annotations

import json
import math
import time
from dataclasses import replace

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from antway.grid import Grid
from antway.ros2 import convert, frames
from antway.ros2.frames import HERE, Pose
from antway.ros2.messages import load, make
from antway.ros2.node import LATCHED
from antway.world.policy import Command, Decision, Observation, RobotSpec
from naive.laser import measured

TIMEOUT = 120.0  # s; on a machine under load
FEW = QoSProfile(depth=5)
KINDS = {
    "markers": ("obstacles", "visualization_msgs/msg/MarkerArray"),
    "poses": ("obstacles", "geometry_msgs/msg/PoseArray"),
    "points": ("obstacles", "geometry_msgs/msg/PolygonStamped"),
    "scan": ("scan", "sensor_msgs/msg/LaserScan"),
}


class Robot(Node):
    """A robot whose world stands at `world` in the map's frame, as that of odometry does at `odom` (None: it is the map's)."""

    def __init__(
        self,
        kind: str = "markers",
        world: Pose = HERE,
        odom: Pose | None = None,
        mount: Pose = HERE,
        stamped: bool = True,
        pictures: bool = True,
    ) -> None:
        super().__init__("robot")
        self.kind, self.world, self.odom, self.mount, self.grid = kind, world, odom, mount, None
        topic, name = KINDS[kind]
        self.out = {
            "map": self.create_publisher(load("nav_msgs/msg/OccupancyGrid"), "map", LATCHED),
            "obstacles": self.create_publisher(load(name), topic, FEW),
            "odom": self.create_publisher(load("nav_msgs/msg/Odometry"), "odom", FEW),
            "goal": self.create_publisher(load("geometry_msgs/msg/PoseStamped"), "goal_pose", 10),
        }
        if odom is not None:
            self.out["tf"] = self.create_publisher(load("geometry_msgs/msg/TransformStamped"), "tf_stand_in", 50)
        self.twist, self.printed, self.answered, self.paths, self.seen = None, [], 0, 0, {}
        kind = load("geometry_msgs/msg/TwistStamped" if stamped else "geometry_msgs/msg/Twist")
        self.create_subscription(kind, "cmd_vel", self.on_twist, 50)
        self.create_subscription(load("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", self.on_said, 50)
        self.create_subscription(load("nav_msgs/msg/Path"), "plan", self.on_path, LATCHED)
        for topic, name in (
            ("decisions", "visualization_msgs/msg/MarkerArray"),
            ("predictions", "visualization_msgs/msg/MarkerArray"),
            ("pheromone", "nav_msgs/msg/OccupancyGrid"),
        ) * pictures:
            qos = 10 if topic == "predictions" else LATCHED
            self.create_subscription(load(name), topic, lambda message, topic=topic: self.on_picture(topic, message), qos)

    def on_twist(self, message) -> None:
        self.twist = message
        self.answered += 1

    def on_said(self, message) -> None:
        self.printed.append((convert.seconds(message.header.stamp), message.status[0].message))

    def on_picture(self, topic: str, message) -> None:
        """Keep the newest, and of predictions the one with most in it."""
        before = self.seen.get(topic)
        if topic != "predictions" or before is None or len(message.markers) > len(before.markers):
            self.seen[topic] = message

    def on_path(self, message) -> None:
        self.paths += len(message.poses) > 1

    def until(self, what: str, true, again=lambda: None, every: float = 0.5) -> None:
        """Spin until `true()`; do `again` each `every` s, as sensors do that keep on sending."""
        end = time.monotonic() + TIMEOUT
        due = time.monotonic() + every
        while not true():
            rclpy.spin_once(self, timeout_sec=0.05)
            if time.monotonic() > end:
                raise SystemExit(f"waited in vain for {what}; the node said {self.printed[-3:]}")
            if time.monotonic() > due:
                again()
                due += every

    def meets(self) -> None:
        """Wait for the node."""
        self.printed.clear()
        self.until("the node", lambda: all(p.get_subscription_count() for p in self.out.values()))
        self.until("its publishers", lambda: self.count_publishers("cmd_vel") and self.count_publishers("plan"))
        self.until("its first words", lambda: self.printed)

    def stands(self) -> bool:
        if self.twist is None:  # never moved
            return True
        twist = getattr(self.twist, "twist", self.twist)
        return (twist.linear.x, twist.linear.y, twist.angular.z) == (0.0, 0.0, 0.0)

    def hears(self, text: str, again=lambda: None, every: float = 0.5) -> None:
        """Wait for a diagnostic that holds `text`, said from now on, and for the robot to be stopped."""
        self.printed.clear()
        again()
        self.until(f"'{text}'", lambda: any(text in one for _, one in self.printed), again, every)
        self.until(f"a stop at '{text}'", self.stands)

    def senses(self, o: Observation, base: float, obstacles: bool = True, tf: bool = True) -> None:
        """Send transforms, obstacles and odometry of `o`."""
        t, pose = base + o.t, (*o.xy, o.heading)
        if self.odom is not None and tf:
            self.transform("map", "odom", self.odom, t + 1.0)
            self.transform("base_link", "laser", self.mount, 0.0)
        if obstacles:
            self.out["obstacles"].publish(self.scene(o, t))
        there = frames.chain(self.world, pose)
        if self.odom is not None:
            there = frames.chain(frames.inverse(self.odom), there)
        twist = convert.twist_message(Command(o.velocity), (0.0, 0.0), o.heading, RobotSpec(), make)
        message = make(
            "nav_msgs/msg/Odometry",
            header=convert.header_message(t, "map" if self.odom is None else "odom", make),
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=convert.pose_message(*there, make)),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist),
        )
        self.out["odom"].publish(message)

    def scene(self, o: Observation, t: float):
        """What is sensed, in the kind of message that this robot sends."""
        tracks, header = frames.move_tracks(self.world, o.tracks), convert.header_message(t, "map", make)
        if self.kind == "markers":
            return convert.markers_message(tracks, t, make)
        if self.kind == "poses":
            poses = [convert.pose_message(x, y, 0.0, make) for x, y in tracks.xy.tolist()]
            return make("geometry_msgs/msg/PoseArray", header=header, poses=poses)
        if self.kind == "points":
            points = [make("geometry_msgs/msg/Point32", x=x, y=y, z=r) for (x, y), r in zip(tracks.xy.tolist(), tracks.radius)]
            return make(
                "geometry_msgs/msg/PolygonStamped", header=header, polygon=make("geometry_msgs/msg/Polygon", points=points)
            )
        pose = frames.chain((*o.xy, o.heading), self.mount)
        ranges = measured(self.grid, o.tracks.xy, o.tracks.radius, pose, 240, 5.5)
        return make(
            "sensor_msgs/msg/LaserScan",
            header=convert.header_message(t, "base_link" if self.odom is None else "laser", make),
            angle_min=-math.pi,
            angle_max=math.pi,
            angle_increment=2 * math.pi / len(ranges),
            range_min=0.05,
            range_max=5.5,
            ranges=ranges.tolist(),
        )

    def transform(self, parent: str, child: str, pose: Pose, t: float) -> None:
        """Say by tf where `child` is."""
        there = convert.pose_message(*pose, make)
        move = make(
            "geometry_msgs/msg/Transform",
            translation=make("geometry_msgs/msg/Vector3", x=there.position.x, y=there.position.y, z=0.0),
            rotation=there.orientation,
        )
        header = convert.header_message(t, parent, make)
        self.out["tf"].publish(make("geometry_msgs/msg/TransformStamped", header=header, child_frame_id=child, transform=move))

    def charts(self, grid: Grid, t: float = 0.0) -> None:
        """Send the map."""
        self.grid = grid
        turned = replace(grid, origin=frames.chain(self.world, grid.origin))
        self.out["map"].publish(convert.grid_message(turned, make, t=t))

    def pose(self, xy, frame: str = "map"):
        """A PoseStamped at a place of this robot's world."""
        pose = convert.pose_message(*frames.move_point(self.world, xy), 0.0, make)
        return make("geometry_msgs/msg/PoseStamped", header=convert.header_message(0.0, frame, make), pose=pose)

    def go(self, xy) -> None:
        self.out["goal"].publish(self.pose(xy))

    def answers(self, o: Observation, base: float, over=lambda: False) -> Command:
        """Send `o` and wait for its command, or until it is `over`, which may be before the first one."""
        t = base + o.t
        self.senses(o, base)
        self.until(
            f"cmd_vel for {t:.1f} s",
            lambda: over() or (self.twist is not None and abs(convert.seconds(self.twist.header.stamp) - t) < 0.01),
            lambda: self.senses(o, base),
        )
        return Command((0.0, 0.0)) if self.twist is None else convert.read_twist(self.twist.twist, o.heading)


class Remote:
    """A policy of antway.world that asks the node: observations out, cmd_vel in; `before` each answer, something may happen."""

    def __init__(self, robot: Robot, base: float, before=lambda o: None) -> None:
        self.robot, self.base, self.before = robot, base, before

    def reset(self, task, seed) -> None:
        self.robot.go(task.goal)

    def act(self, o: Observation) -> Command:
        stopped = self.before(o)
        return Command((0.0, 0.0)) if stopped else self.robot.answers(o, self.base)

    def explain(self) -> Decision:
        return DECISION


DECISION = Decision("follow", "as the node says")


def onwards(robot: Robot, o: Observation, base: float, step: float = 0.1):
    """A function that sends `o` again and again, each time `step` s later."""
    clock = iter(o.t + step * np.arange(1, 10**6))
    return lambda **options: robot.senses(replace(o, t=float(next(clock))), base, **options)


def start(**options) -> Robot:
    """Return a robot that has met the node."""
    rclpy.init()
    robot = Robot(**options)
    robot.meets()
    return robot


def end(robot: Robot, **results) -> None:
    """Print what came of it, and leave."""
    print(json.dumps(results))
    robot.destroy_node()
    rclpy.shutdown()
