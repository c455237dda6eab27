"""The node's parameters: declared with their ranges, checked when they are set, and shown as they are in force."""

from __future__ import annotations

import difflib
from typing import Any

from rclpy.parameter import Parameter

from antway.errors import BadInput, BadParameter
from antway.ros2.messages import make
from antway.ros2.settings import Settings, parameter_values, parameters
from antway.world.policy import RobotSpec

_OF_ROS = ("use_sim_time", "qos_overrides", "start_type_description_service")


class Declared:
    """The parameters of `node`.

    `configured` tells whether the node uses other values than those that are set from now on.

    Raises
    ------
    BadParameter
        For values that a definition refuses, and names that no parameter has.
    """

    def __init__(self, node: Any) -> None:
        self.node, self.configured, self.telling = node, False, False
        self.values: dict[str, Any] = {}  # of robot.* those that somebody has set: a named robot has its own for the others
        given = getattr(node, "_parameter_overrides", {})
        for name, one in parameters().items():
            about = make("rcl_interfaces/msg/ParameterDescriptor", description=one.text, additional_constraints=one.allowed)
            ends = {"from_value": one.low, "to_value": one.high}
            if isinstance(one.default, float):
                about.dynamic_typing = True  # `robot.radius:=1` is an integer for ROS
                about.floating_point_range = [make("rcl_interfaces/msg/FloatingPointRange", **ends)]
            elif type(one.default) is int:
                about.integer_range = [make("rcl_interfaces/msg/IntegerRange", **ends, step=1)]
            value = node.declare_parameter(name, one.default, about).value
            if name in given or not name.startswith("robot."):
                self.values[name] = value
        for name, parameter in given.items():
            if not node.has_parameter(name) and not name.startswith(_OF_ROS):
                near = difflib.get_close_matches(name, parameters(), 3) or list(parameters())
                raise BadParameter(name, parameter.value, f"left out: no parameter has this name; there is {', '.join(near)}")
        # Without these the robot is still unspecified: parameters may be set before the node is configured.
        bare = not any(self.values.get(name) for name in ("robot.name", "robot.drive", "autostart"))
        Settings.of(self.values | {"robot.drive": "holonomic"} if bare else self.values)
        node.add_on_set_parameters_callback(self._on_set)

    def _on_set(self, changed: list[Any]) -> Any:
        values = self.values | {one.name: one.value for one in changed if one.name in parameters()}
        try:
            Settings.of(values)
        except BadInput as wrong:
            return make("rcl_interfaces/msg/SetParametersResult", successful=False, reason=str(wrong))
        if not self.telling:
            self.values = values
        reason = "it takes effect at the next configure" if self.configured else ""
        if reason and not self.telling:  # rclpy answers with the reason of its own callback
            self.node.get_logger().info(f"{', '.join(one.name for one in changed)}: {reason}")
        return make("rcl_interfaces/msg/SetParametersResult", successful=True, reason=reason)

    def tell(self, robot: RobotSpec) -> None:
        """Let the parameters show what is in force: a named robot has numbers of its own."""
        self.telling = True
        self.node.set_parameters_atomically([Parameter(name, value=value) for name, value in parameter_values(robot).items()])
        self.telling = False
