"""The parameters of the ROS 2 node, taken from the definitions of robot, task and policy; no ROS import."""

from __future__ import annotations

import importlib
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from importlib.util import find_spec
from typing import Any

import numpy as np

from antway import checks
from antway.avoidance.policy import AntwayPolicy
from antway.errors import BadParameter
from antway.grid import Grid, Moves
from antway.planning import PLANNERS
from antway.ros2 import convert
from antway.world.policy import RobotSpec, Task

_OWN = {
    "autostart": (False, "Configure and activate at start, without a lifecycle manager."),
    "frame": ("map", "Frame of the map, in which odometry, obstacles and goals must come."),
    "planner": ("jps", "What serves get_plan: " + ", ".join(PLANNERS) + "."),
    "timeout": (0.5, "s; robot stops when odometry or obstacles are silent for so long."),
    "stamped": (True, "Whether cmd_vel is a TwistStamped (stamped with the odometry that it answers) or a Twist."),
    "obstacles_type": ("visualization_msgs/msg/MarkerArray", "Type of the messages on obstacles."),
    "obstacles_converter": (
        "",
        "module:function that turns such a message into (t in s, Tracks); empty for the types built in.",
    ),
    "obstacle_radius": (0.3, "m; of obstacles that come as a PoseArray."),
}


def parameters() -> dict[str, tuple[Any, str]]:
    """Return name -> (default, description) of every parameter, as `RobotSpec`, `Task` and `AntwayPolicy` define them."""
    found = {f"robot.{f.name}": (f.default, f"Field {f.name} of RobotSpec.") for f in fields(RobotSpec)}
    found |= {f"task.{f.name}": (f.default, f"Field {f.name} of Task.") for f in fields(Task) if isinstance(f.default, float)}
    for name, option in inspect.signature(AntwayPolicy).parameters.items():
        default = option.default.value if isinstance(option.default, Moves) else option.default
        found[f"policy.{name}"] = (default, f"Option {name} of AntwayPolicy.")
    return found | _OWN


@dataclass(frozen=True, slots=True)
class Settings:
    """The parameters, checked by the definitions they come from."""

    robot: RobotSpec
    task: dict[str, float]
    policy: dict[str, Any]
    frame: str
    planner: str
    timeout: float
    stamped: bool
    obstacles_type: str
    reader: Callable[[Any], Any]

    @staticmethod
    def of(values: Mapping[str, Any]) -> Settings:
        """Check `values` by name; raises `BadInput` for whatever a definition refuses."""

        def part(prefix: str) -> dict[str, Any]:
            return {name.removeprefix(prefix): value for name, value in values.items() if name.startswith(prefix)}

        policy = part("policy.")
        policy["moves"] = Moves(checks.choice("policy.moves", policy["moves"], [m.value for m in Moves]))
        AntwayPolicy(**policy)
        robot = RobotSpec(**part("robot."))
        Task(Grid(np.zeros((1, 1), bool)), robot, (0.5, 0.5), (0.5, 0.5), **part("task."))
        radius = checks.number("obstacle_radius", values["obstacle_radius"], low=0.0, open_low=True, unit="m")
        readers = {
            "visualization_msgs/msg/MarkerArray": convert.read_markers,
            "geometry_msgs/msg/PoseArray": lambda message: convert.read_poses(message, radius),
        }
        kind, hook = values["obstacles_type"], values["obstacles_converter"]
        if hook:
            module, _, name = hook.partition(":")
            if not name or find_spec(module) is None:
                raise BadParameter("obstacles_converter", hook, "module:function of a module that can be imported")
            reader = getattr(importlib.import_module(module), name)
        else:
            reader = readers[checks.choice("obstacles_type (without obstacles_converter)", kind, readers)]
        return Settings(
            robot=robot,
            task=part("task."),
            policy=policy,
            frame=values["frame"],
            planner=checks.choice("planner", values["planner"], PLANNERS),
            timeout=checks.number("timeout", values["timeout"], low=0.0, open_low=True, unit="s"),
            stamped=values["stamped"],
            obstacles_type=kind,
            reader=reader,
        )
