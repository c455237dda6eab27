"""Sends commands to the robot's base from the guard process, in which a separate node publishes them."""

from __future__ import annotations

import atexit

import rclpy
from rclpy.signals import SignalHandlerOptions

from antway.policies.guard_process import Driver
from antway.ros2 import convert
from antway.ros2.messages import load, make
from antway.world.policy import Command, Observation, RobotSpec


def twist_type(stamped: bool) -> str:
    """Return the type of commands."""
    return "geometry_msgs/msg/TwistStamped" if stamped else "geometry_msgs/msg/Twist"


def stamp_twist(twist: object, t: float, frame: str | None) -> object:
    """Return a twist in `frame` with the stamp `t` s, or unchanged if the frame is None."""
    if frame is None:
        return twist
    return make("geometry_msgs/msg/TwistStamped", header=convert.header_message(max(t, 0.0), frame, make), twist=twist)


def open_driver(topic: str, frame: str | None, robot: RobotSpec, namespace: str) -> Driver:
    """Open a publisher of commands on `topic`, stamped in `frame` unless it is None, by a node in `namespace`."""
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("antway_guard", namespace=namespace, enable_rosout=False, start_parameter_services=False)
    publisher = node.create_publisher(load(twist_type(frame is not None)), topic, 10)

    def drive(command: Command, seen: Observation) -> None:
        """Publish a command; the common frame of command and observation does not matter."""
        twist = convert.twist_message(command, seen.velocity, seen.heading, robot, make)
        publisher.publish(stamp_twist(twist, seen.t, frame))

    def close() -> None:
        node.destroy_node()
        rclpy.try_shutdown()

    atexit.register(close)
    convert.twist_message(Command((0.1, 0.0)), (0.0, 0.0), 0.0, robot, make)  # compiles what it needs
    return drive
