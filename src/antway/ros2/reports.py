"""What the node reports, on its log and on diagnostics."""

from __future__ import annotations

import math
import re
import time
from typing import Any

from antway.ros2.goals import ERROR, OK, WARN
from antway.ros2.messages import make

SHOWN = 5.0  # s; for how long a trouble is shown on diagnostics beside what the node does


class Reports:
    """The log and the diagnostics of `node`; `publisher` sends a diagnostic_msgs/msg/DiagnosticArray, None: nothing does."""

    def __init__(self, node: Any, publisher: Any) -> None:
        self.node, self.publisher = node, publisher
        self.last = OK, ""  # level and reason
        self.trouble = -math.inf, OK, ""  # when it occurred (steady, s), level and reason
        self.logged = dict[str, float]()  # what was logged, without its numbers, and until when it is not logged again, s

    def say(self, level: int, reason: str) -> None:
        """Log what the node does or why it stands, and publish it on diagnostics, if that is new.

        What is the same but for its numbers is published, but not logged again; an error is new after a second.
        """
        before, self.last = self.last, (level, reason)
        if before == self.last or (level == ERROR and not self._is_new(reason)):
            return
        if level == ERROR or (level, _words(reason)) != (before[0], _words(before[1])):
            self._log(level, reason)
        self.publish()

    def add(self, level: int, reason: str) -> None:
        """Report a trouble beside what the node does; diagnostics show it for 5 s."""
        self.trouble = time.monotonic(), level, reason
        if self._is_new(reason):
            self._log(level, reason)
            self.publish()

    def note(self, level: int, reason: str) -> None:
        """Publish what does not change what the node does, such as a goal that moves, and log it once in 10 s."""
        before, self.last = self.last, (level, reason)
        self.publish()
        self.last = before
        if self._is_new(reason, 10.0):
            self._log(level, reason)

    def _is_new(self, reason: str, seconds: float = 1.0) -> bool:
        """Tell whether a reason, but for its numbers, was not logged within the last `seconds`."""
        now = time.monotonic()
        self.logged = {words: until for words, until in self.logged.items() if now < until}
        return self.logged.setdefault(_words(reason), now + seconds) == now + seconds

    def _log(self, level: int, reason: str) -> None:
        log = self.node.get_logger()
        if level == ERROR:  # rclpy wants one line of code for each severity
            log.error(reason)
        elif level == WARN:
            log.warning(reason)
        else:
            log.info(reason)

    def publish(self) -> None:
        """Publish what was reported last on diagnostics, with the trouble of the last 5 s."""
        if self.publisher is None or not self.node.active:
            return
        (level, reason), (then, worse, trouble) = self.last, self.trouble
        if time.monotonic() <= then + SHOWN:
            level, reason = max(level, worse), f"{reason} ({trouble})"
        name = self.node.get_fully_qualified_name().lstrip("/")  # which of several robots, each in its namespace
        status = make("diagnostic_msgs/msg/DiagnosticStatus", level=bytes([level]), name=name, message=reason, hardware_id="")
        now = make("std_msgs/msg/Header", stamp=self.node.get_clock().now().to_msg())
        self.publisher.publish(make("diagnostic_msgs/msg/DiagnosticArray", header=now, status=[status]))


def _words(reason: str) -> str:
    """Return a reason without its numbers."""
    return re.sub(r"[\d.]+", "", reason)
