"""Run in the ROS environment: take the node up and down; prints resident memory in kB, early and late.

Arguments: how many cycles.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import rclpy
from rclpy.lifecycle import TransitionCallbackReturn

from antway.ros2.node import AntwayNode


def resident() -> int:
    return int(next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmRSS")).split()[1])


def main(cycles: int) -> None:
    rclpy.init()
    node, memory = AntwayNode(), []
    for i in range(cycles):
        for step in (node.trigger_configure, node.trigger_activate, node.trigger_deactivate, node.trigger_cleanup):
            assert step() == TransitionCallbackReturn.SUCCESS, step
        assert not node.parts
        if i in (cycles // 5, cycles - 1):
            memory.append(resident())
    wrong = node.set_parameters([rclpy.parameter.Parameter("policy.chance", value=1.5)])[0]
    about = node.describe_parameter("robot.radius")
    lowest = about.floating_point_range[0].from_value
    node.destroy_node()
    for _ in range(max(cycles // 10, 1)):  # whole nodes as well
        node = AntwayNode()
        node.trigger_configure()
        node.destroy_node()
    rclpy.shutdown()
    refused = {"successful": wrong.successful, "reason": wrong.reason}
    print(json.dumps({"memory": memory, "refused": refused, "lowest": lowest}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
