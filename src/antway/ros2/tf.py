"""Transforms between frames by tf if tf2_ros can be imported; otherwise only the identity is known."""

from __future__ import annotations

import importlib
import math
from importlib.util import find_spec
from typing import Any

from rclpy.time import Time

from antway.errors import BadParameter
from antway.ros2 import convert
from antway.ros2.frames import HERE, Pose

POSTDATED = 2.0  # s; by how much a transform may be post-dated: localisations do that (Nav2's AMCL by 1 s) as long as they hold


class Transforms:
    """The latest transforms received by `node`."""

    def __init__(self, node: Any) -> None:
        self.tf2: Any = importlib.import_module("tf2_ros") if find_spec("tf2_ros") else None
        self.t = -math.inf  # s; for which time there was a transform last
        if self.tf2:
            self.buffer = self.tf2.Buffer()
            self.listener = self.tf2.TransformListener(self.buffer, node)

    def close(self) -> None:
        """Stop listening."""
        if self.tf2:
            self.listener.unregister()
            self.tf2 = None

    def pose(self, frame: str, within: str, t: float, timeout: float) -> Pose:
        """Return the latest pose of `frame` in the frame `within`; see `mount`."""
        pose, upside_down = self.mount(frame, within, t, timeout)
        if upside_down:
            raise BadParameter(f"tf from {within} to {frame}", "upside down", "level")
        return pose

    def mount(self, frame: str, within: str, t: float, timeout: float) -> tuple[Pose, bool]:
        """Return the latest pose of `frame` in the frame `within`, and whether it is upside down: its y axis is then mirrored.

        A `BadParameter` says that there is none, that it is more than `timeout` s older or `timeout` + POSTDATED s newer than
        `t` s, or that it is tilted; static ones (time 0) have no age. Before the first odometry `t` is -inf.
        """
        if frame == within:
            return HERE, False
        if not self.tf2:
            raise BadParameter("header.frame_id", frame, f"{within} (tf2_ros, which would know others, cannot be imported)")
        try:
            found = self.buffer.lookup_transform(within, frame, Time())
        except self.tf2.TransformException as error:
            raise BadParameter("header.frame_id", frame, f"{within}, or a frame that tf knows ({error})") from None
        stamp, move = convert.seconds(found.header.stamp), found.transform
        if stamp != 0.0 and not -POSTDATED - timeout <= t - stamp <= timeout:
            if stamp > t and 0.0 < t < self.t:  # time went back, and tf would go on telling what it knew then
                self.buffer.clear()
            why = "tf is silent" if stamp < t else "the message, or tf, has a wrong stamp"
            if t == -math.inf:
                raise BadParameter(f"age of tf from {within} to {frame}", "unknown", "known: there is no odometry yet")
            age, allowed = f"{t - stamp:.2f} s", f"at most {timeout:g} s (down to -{POSTDATED + timeout:g} s): {why}"
            raise BadParameter(f"age of tf from {within} to {frame}", age, allowed)
        self.t = t
        place = convert.plain("", position=move.translation, orientation=move.rotation)
        return convert.read_mount(place, where=f"tf from {within} to {frame}")
