"""Run in the ROS environment beside an active `antway ros2`: a robot of antway.world behind topics; prints what came of it.

Arguments: how many episodes. Every wait is for a message that must come, never for a time.
"""

from __future__ import annotations

import json
import math
import sys
import time
from dataclasses import replace

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile

from antway import check_episode, load_scenario, run
from antway.ros2 import convert
from antway.ros2.messages import load, make
from antway.ros2.node import LATCHED
from antway.scenes import scene
from antway.world.policy import Command, Decision, Observation, RobotSpec, Tracks

PATIENCE = 60.0  # s; on a machine under load


class Robot(Node):
    """The robot's side of the topics."""

    def __init__(self) -> None:
        super().__init__("robot")
        self.out = {
            "map": self.create_publisher(load("nav_msgs/msg/OccupancyGrid"), "map", LATCHED),
            "obstacles": self.create_publisher(load("visualization_msgs/msg/MarkerArray"), "obstacles", QoSProfile(depth=5)),
            "odom": self.create_publisher(load("nav_msgs/msg/Odometry"), "odom", QoSProfile(depth=5)),
            "goal": self.create_publisher(load("geometry_msgs/msg/PoseStamped"), "goal_pose", 10),
        }
        self.plan = self.create_client(load("nav_msgs/srv/GetPlan"), "get_plan")
        self.twist, self.said, self.answered, self.paths = None, [], 0, 0
        self.create_subscription(load("geometry_msgs/msg/TwistStamped"), "cmd_vel", self.on_twist, 50)
        self.create_subscription(load("diagnostic_msgs/msg/DiagnosticArray"), "/diagnostics", self.on_said, 50)
        self.create_subscription(load("nav_msgs/msg/Path"), "plan", self.on_path, LATCHED)

    def on_twist(self, message) -> None:
        self.twist = message
        self.answered += 1

    def on_said(self, message) -> None:
        self.said.append(message.status[0].message)

    def on_path(self, message) -> None:
        self.paths += len(message.poses) > 1

    def until(self, what: str, true, again=lambda: None) -> None:
        """Spin until `true()`; do `again` twice a second, as sensors do that keep on sending."""
        end = time.monotonic() + PATIENCE
        due = time.monotonic() + 0.5
        while not true():
            rclpy.spin_once(self, timeout_sec=0.05)
            if time.monotonic() > end:
                raise SystemExit(f"waited in vain for {what}; the node said {self.said[-3:]}")
            if time.monotonic() > due:
                again()
                due += 0.5

    def hears(self, text: str, again=lambda: None) -> None:
        """Wait for a diagnostic that holds `text`, said from now on, and for the robot to be stopped."""
        self.said.clear()
        again()
        self.until(f"'{text}'", lambda: any(text in one for one in self.said), again)
        twist = self.twist.twist
        assert (twist.linear.x, twist.linear.y, twist.angular.z) == (0.0, 0.0, 0.0), f"not stopped at '{text}'"

    def senses(self, o: Observation, base: float, obstacles: bool = True) -> None:
        """Send obstacles and odometry of `o`."""
        if obstacles:
            self.out["obstacles"].publish(convert.markers_message(o.tracks, base + o.t, make))
        (vx, vy), pose = o.velocity, convert.pose_message(*o.xy, o.heading, make)
        twist = convert.twist_message(Command((vx, vy)), (0.0, 0.0), o.heading, RobotSpec(), make)
        message = make(
            "nav_msgs/msg/Odometry",
            header=convert.header_message(base + o.t, "map", make),
            pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose),
            twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist),
        )
        self.out["odom"].publish(message)

    def go(self, xy) -> None:
        pose = convert.pose_message(*xy, 0.0, make)
        self.out["goal"].publish(
            make("geometry_msgs/msg/PoseStamped", header=convert.header_message(0.0, "map", make), pose=pose)
        )


class Remote:
    """A policy of antway.world that asks the node: observations out, cmd_vel in."""

    def __init__(self, robot: Robot, base: float) -> None:
        self.robot, self.base = robot, base

    def reset(self, task, seed) -> None:
        self.task = task
        self.robot.go(task.goal)

    def act(self, o: Observation) -> Command:
        robot, t = self.robot, self.base + o.t
        robot.senses(o, self.base)
        robot.until(
            f"cmd_vel for {t:.1f} s",
            lambda: robot.twist is not None and abs(convert.seconds(robot.twist.header.stamp) - t) < 0.01,
            lambda: robot.senses(o, self.base),
        )
        return convert.read_twist(robot.twist.twist, o.heading)

    def explain(self) -> Decision:
        return DECISION


DECISION = Decision("follow", "as the node says")


def onwards(robot: Robot, o: Observation, base: float, step: float = 0.1):
    """A function that sends `o` again and again, each time `step` s later."""
    clock = iter(o.t + step * np.arange(1, 10**6))
    return lambda **options: robot.senses(replace(o, t=float(next(clock))), base, **options)


def main(episodes: int) -> None:
    rclpy.init()
    robot = Robot()
    place = load_scenario(scene("paper"))
    grid = place.task.grid
    robot.until(
        "the node", lambda: all(p.get_subscription_count() for p in robot.out.values()) and robot.plan.service_is_ready()
    )
    robot.until("its publishers", lambda: robot.count_publishers("cmd_vel") and robot.count_publishers("plan"))
    robot.until("its first words", lambda: robot.said)

    # a goal before the map; then a map that is malformed; then the map
    base = 1000.0
    still = Observation(0.0, place.start, (0.0, 0.0), 0.0, Tracks.none())
    robot.go(place.goal)
    robot.hears("waiting for a map", lambda: robot.senses(still, base))
    short = convert.grid_message(grid, make)
    short.data = short.data[:-1]
    robot.hears("map refused: OccupancyGrid: data.length", lambda: robot.out["map"].publish(short))
    robot.out["map"].publish(convert.grid_message(grid, make))

    # GetPlan is as long as what the verified planner finds
    from antway import plan

    request = make("nav_msgs/srv/GetPlan_Request")
    for end in ("start", "goal"):
        pose = convert.pose_message(*getattr(place, end), 0.0, make)
        setattr(request, end, make("geometry_msgs/msg/PoseStamped", header=convert.header_message(0.0, "map", make), pose=pose))
    answer = []
    while not answer:  # asked again until the map has arrived
        future = robot.plan.call_async(request)
        robot.until("get_plan", future.done)
        answer = convert.read_path(future.result().plan).tolist()
    expected = plan(grid, place.start, place.goal, robot_radius=place.robot.radius)
    served = float(np.hypot(*np.diff(np.array(answer), axis=0).T).sum())
    assert math.isclose(served, expected.length, rel_tol=1e-12), (served, expected.length)

    outcomes = []
    for seed in range(episodes):
        base += 1000.0
        robot.hears("jumped", lambda base=base: robot.senses(still, base - 0.2))
        before, begun = robot.answered, time.monotonic()
        result = run(place, Remote(robot, base), seed=seed)
        check_episode(result)
        outcomes.append(
            {
                "outcome": result.outcome.value,
                "reason": result.reason,
                "steps": len(result.cycle_ms),
                "answers": robot.answered - before,
                "wall": time.monotonic() - begun,
                "clearance": result.min_clearance,
            }
        )
        last = Observation(result.time, place.goal, (0.0, 0.0), 0.0, Tracks.none())
        later = onwards(robot, last, base)
        robot.hears("arrived", later)

    # an obstacle sensor, then odometry, that fall silent; a goal pre-empted; a clock that goes back
    robot.go(place.start)
    robot.hears("the sensor is silent", lambda: later(obstacles=False))
    robot.hears("no odometry for")
    robot.hears("pre-empted", lambda: robot.go(place.goal))
    robot.hears("jumped by -", onwards(robot, last, base, step=-1.0))
    print(json.dumps({"episodes": outcomes, "paths": robot.paths}))
    robot.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main(int(sys.argv[1]))
