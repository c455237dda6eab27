"""Run in the ROS environment: take the node up and down; prints resident memory in kB and open files, early and late.

Arguments: how many cycles.
"""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path

import rclpy
from harness import TIMEOUT
from rclpy.executors import SingleThreadedExecutor
from rclpy.lifecycle import TransitionCallbackReturn
from stand_in import GOAL, START, kinds, room, stamped

from antway.ros2 import actions, nav2
from antway.ros2.messages import load, make
from antway.ros2.node import AntwayNode
from antway.ros2.settings import Settings


def a_node() -> AntwayNode:
    """Return a node that knows its drive, without which it refuses to be configured."""
    node = AntwayNode(kinds())
    node.set_parameters([rclpy.parameter.Parameter("robot.drive", value="holonomic")])
    return node


def resources() -> tuple[int, int]:
    """Resident memory in kB, and open files."""
    line = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]), len(list(Path("/proc/self/fd").iterdir()))


def asked_while_closing(node: AntwayNode, executor: SingleThreadedExecutor) -> int:
    """Take the node down while a plan is being made for GetPlan; returns the poses in the answer, which comes all the same."""
    client, gate, find_path = rclpy.create_node("client"), threading.Event(), nav2.find_path
    executor.add_node(client)
    node.trigger_configure()
    node.trigger_activate()
    node.pilot.receive_map(room())
    get_plan = client.create_client(load("nav_msgs/srv/GetPlan"), "get_plan")
    while not get_plan.service_is_ready():
        executor.spin_once(timeout_sec=0.1)
    nav2.find_path = lambda *details: gate.wait(TIMEOUT) and find_path(*details)
    answer = get_plan.call_async(make("nav_msgs/srv/GetPlan_Request", start=stamped(START), goal=stamped(GOAL)))
    served = next(part for _, part in node.parts if isinstance(part, actions.Served))
    while not served.asked:
        executor.spin_once(timeout_sec=0.1)
    node.trigger_deactivate()
    node.trigger_cleanup()
    gate.set()
    while not answer.done() or served.service in list(node.services):
        executor.spin_once(timeout_sec=0.1)
    nav2.find_path = find_path
    executor.remove_node(client)
    client.destroy_node()
    return len(answer.result().plan.poses)


def main(cycles: int) -> None:
    rclpy.init()
    executor, node, found = SingleThreadedExecutor(), a_node(), []
    executor.add_node(node)
    poses = asked_while_closing(node, executor)
    for i in range(cycles):
        for step in (node.trigger_configure, node.trigger_activate, node.trigger_deactivate, node.trigger_cleanup):
            assert step() == TransitionCallbackReturn.SUCCESS, step
            executor.spin_once(timeout_sec=0)
        assert not node.parts
        if i in (cycles // 5, cycles - 1):
            found.append(resources())
    wrong = node.set_parameters([rclpy.parameter.Parameter("policy.chance", value=1.5)])[0]
    ranges = {}
    for name in ("robot.radius", "policy.chance", "policy.expansions", "task.obstacle_surge"):
        about = node.describe_parameter(name)
        (one,) = about.floating_point_range or about.integer_range
        ranges[name] = one.from_value, one.to_value
    planner = node.describe_parameter("planner").additional_constraints
    said = {"robot.drive": "", "robot.name": "jackal", "robot.v_max": 1}
    given = [rclpy.parameter.Parameter(name, value=value) for name, value in said.items()]
    assert node.set_parameters_atomically(given).successful
    robot = Settings.of(node.declared.values).robot
    node.destroy_node()
    for _ in range(max(cycles // 10, 1)):  # whole nodes as well
        node = a_node()
        node.trigger_configure()
        node.destroy_node()
    executor.shutdown()
    rclpy.shutdown()
    refused = {"successful": wrong.successful, "reason": wrong.reason}
    speeds = robot.v_max, robot.a_max
    print(
        json.dumps(
            {"poses": poses, "resources": found, "refused": refused, "ranges": ranges, "planner": planner, "speeds": speeds}
        )
    )


if __name__ == "__main__":
    main(int(sys.argv[1]))
