"""What the node uses of rclpy, without ROS: it hears what a test says, and its words and messages are kept."""

from __future__ import annotations

import importlib
import sys
from enum import Enum
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar
from unittest.mock import MagicMock

from antway.ros2 import convert, messages
from antway.ros2.settings import parameters

TIME = SimpleNamespace(sec=0, nanosec=0)


def defaults(**changes: Any) -> dict[str, Any]:
    """The default values of all parameters for a holonomic robot, with `changes`."""
    values = {name: one.default for name, one in parameters().items() if not name.startswith("robot.")}
    return values | {"robot.drive": "holonomic"} | changes


class Publisher:
    """A publisher with as many listeners as a test says."""

    def __init__(self, topic: str) -> None:
        self.topic_name, self.sent, self.listeners = f"/{topic.lstrip('/')}", list[Any](), 1

    def publish(self, message: Any) -> None:
        self.sent.append(message)

    def wait_for_all_acked(self, timeout: Any) -> bool:
        self.acknowledged = len(self.sent)
        return True

    def get_subscription_count(self) -> int:
        return self.listeners


class LifecycleNode:
    """A node in the namespace /one whose parameters were given by OVERRIDES."""

    overrides: ClassVar[dict[str, Any]] = {}

    def __init__(self, name: str) -> None:
        self.name, self.said = name, list[tuple[str, str]]()
        self.told, self.published, self.heard_on = dict[str, Any](), dict[str, Publisher](), dict[str, Any]()
        self.executor, self.time, self.simulated, self.drivers = None, 0.0, False, 1
        self._parameter_overrides = {key: SimpleNamespace(value=value) for key, value in self.overrides.items()}

    def declare_parameter(self, name: str, default: Any, about: Any) -> Any:
        self.told[name] = self.overrides.get(name, default)
        return SimpleNamespace(value=self.told[name])

    def has_parameter(self, name: str) -> bool:
        return name in self.told

    def add_on_set_parameters_callback(self, check: Any) -> None:
        self.check = check

    def set_parameters_atomically(self, given: list[Any]) -> Any:
        found = self.check(given)
        if found.successful:
            self.told |= {one.name: one.value for one in given}
        return found

    def create_lifecycle_publisher(self, kind: Any, topic: str, qos: Any) -> Publisher:
        return self.published.setdefault(topic, Publisher(topic))

    def create_subscription(self, kind: Any, topic: str, callback: Any, qos: Any) -> None:
        self.heard_on[topic] = callback

    def create_timer(self, period: float, tick: Any, clock: Any) -> None: ...
    def create_service(self, kind: Any, name: str, callback: Any) -> None: ...
    def destroy(self, part: Any) -> None: ...
    def destroy_node(self) -> None: ...
    def trigger_configure(self) -> Any:
        return self.on_configure(None)

    destroy_lifecycle_publisher = destroy_subscription = destroy_service = destroy_timer = destroy
    on_activate = on_deactivate = lambda self, state: None

    def get_logger(self) -> Any:
        def sayer(level: str) -> Any:
            return lambda text: self.said.append((level, text))

        return SimpleNamespace(**{level: sayer(level) for level in ("info", "warning", "error")})

    def get_clock(self) -> Any:
        now = SimpleNamespace(to_msg=lambda: TIME, nanoseconds=round(self.time * 1e9))
        return SimpleNamespace(now=lambda: now, ros_time_is_active=self.simulated)

    def count_publishers(self, topic: str) -> int:
        return self.drivers

    def resolve_topic_name(self, name: str) -> str:
        return f"/one/{name}"

    def get_namespace(self) -> str:
        return "/one"

    def get_fully_qualified_name(self) -> str:
        return f"/one/{self.name}"


def node_module(monkeypatch: Any) -> ModuleType:
    """Return `antway.ros2.node` on this stand-in; messages are plain objects, and nothing is compiled beforehand."""
    any_kind = type("Any", (), {"__init__": lambda self, *details, **more: None})
    have = {
        "rclpy": dict.fromkeys(("init", "shutdown"), any_kind),
        "rclpy.action": {
            "ActionServer": any_kind,
            "CancelResponse": Enum("CancelResponse", ["REJECT", "ACCEPT"]),
            "GoalResponse": Enum("GoalResponse", ["REJECT", "ACCEPT"]),
        },
        "rclpy._rclpy_pybind11": {"RCLError": type("RCLError", (RuntimeError,), {})},
        "rclpy.clock": {"Clock": any_kind, "ClockType": SimpleNamespace(STEADY_TIME=1)},
        "rclpy.duration": {"Duration": any_kind},
        "rclpy.exceptions": {"ParameterException": type("ParameterException", (Exception,), {})},
        "rclpy.executors": {"SingleThreadedExecutor": MagicMock},
        "rclpy.lifecycle": {
            "LifecycleNode": LifecycleNode,
            "TransitionCallbackReturn": Enum("TransitionCallbackReturn", ["SUCCESS", "FAILURE", "ERROR"]),
        },
        "rclpy.parameter": {"Parameter": lambda name, value: SimpleNamespace(name=name, value=value)},
        "rclpy.qos": {
            "QoSProfile": any_kind,
            "DurabilityPolicy": SimpleNamespace(TRANSIENT_LOCAL=1),
            "ReliabilityPolicy": SimpleNamespace(RELIABLE=1, BEST_EFFORT=2),
        },
        "rclpy.signals": {"SignalHandlerOptions": SimpleNamespace(NO=0)},
        "rclpy.task": {"Future": any_kind},
        "rclpy.time": {"Time": any_kind},
        "diagnostic_msgs": {},
    }
    for name, parts in have.items():
        module = ModuleType(name)
        module.__dict__.update(parts, __spec__=SimpleNamespace())
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(messages, "load", lambda kind: kind)
    monkeypatch.setattr(messages, "make", convert.plain)
    for name in ("declared", "driver", "tf", "actions", "markers", "node"):  # imported anew, and forgotten at the end
        monkeypatch.setitem(sys.modules, f"antway.ros2.{name}", None)
        del sys.modules[f"antway.ros2.{name}"]
    node = importlib.import_module("antway.ros2.node")
    monkeypatch.setattr(node, "compile_for", lambda settings: None)
    monkeypatch.setattr(node, "find_spec", lambda name: True)
    monkeypatch.setattr(importlib.import_module("antway.ros2.tf"), "find_spec", lambda name: None)
    return node
