"""Messages of rclpy by the names of their types."""

from __future__ import annotations

import importlib
from array import array
from typing import Any

import numpy as np


def load(kind: str) -> Any:
    """Return the class of a type such as nav_msgs/msg/Path."""
    package, folder, name = kind.split("/")
    return getattr(importlib.import_module(f"{package}.{folder}"), name)


def make(kind: str, **values: Any) -> Any:
    """Make a message of rclpy; arrays of costs are converted to the type of its fields."""
    return load(kind)(**{k: array("b", v.tobytes()) if isinstance(v, np.ndarray) else v for k, v in values.items()})
