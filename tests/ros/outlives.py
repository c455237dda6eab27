"""Run in the ROS environment: a node that is stopped on the way, time and again, and at last killed; prints how it braked.

The robot moves in real time. Arguments: how many times the node is stopped, the control period in s, the command of the node.
"""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from harness import Robot, end

from antway import Grid
from antway.world.policy import Observation, Tracks

ENDS = ((2.0, 2.0), (18.0, 18.0))
RATE = 20.0  # Hz, of odometry
TURN = 0.02  # s; a turn of the loop that sends odometry takes less if the machine is quiet


class Base(Robot):
    """Drives as the newest command says, on wheels or in any direction, and notes when each came, and how late."""

    def __init__(self) -> None:
        super().__init__(pictures=False)
        self.xy, self.heading, self.v, self.commands = np.array(ENDS[0]), math.pi / 4, (0.0, 0.0, 0.0), []
        self.now = self.due = time.monotonic()
        self.paused = 0.0  # s; for how long in all the machine has let this process, and with it odometry, wait

    def on_twist(self, message) -> None:
        super().on_twist(message)
        linear, angular = message.twist.linear, message.twist.angular
        self.v = linear.x, linear.y, angular.z
        now = time.monotonic()
        late = self.paused + max(now - self.now - TURN, 0.0)
        self.commands.append((now, math.hypot(linear.x, linear.y), abs(angular.z), late))

    def drive(self, true, patience: float) -> bool:
        """Move and send what is sensed until `true()`; False if that does not come in so many s."""
        until = time.monotonic() + patience
        while not true():
            rclpy.spin_once(self, timeout_sec=0.002)
            now = time.monotonic()
            (x, y, turn), dt, self.now = self.v, now - self.now, now
            self.paused += max(dt - TURN, 0.0)
            cos, sin = math.cos(self.heading), math.sin(self.heading)
            self.xy = self.xy + dt * np.array([cos * x - sin * y, sin * x + cos * y])
            self.heading = math.remainder(self.heading + dt * turn, 2 * math.pi)
            if now >= self.due:
                self.due += 1 / RATE
                velocity = cos * x - sin * y, sin * x + cos * y
                self.senses(Observation(now, tuple(self.xy.tolist()), velocity, self.heading, Tracks.none()), 0.0)
            if now > until:
                return False
        return True


def status(pid: int) -> list[str]:
    """Return what /proc says of a process after its name, from its state on; nothing if there is no such process."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    except (FileNotFoundError, ProcessLookupError):
        return []


def waited(pid: int) -> float:
    """Return for how long a process has waited for a processor so far, s; 0 if there is no such process."""
    try:
        return int(Path(f"/proc/{pid}/schedstat").read_text().split()[1]) / 1e9
    except (FileNotFoundError, ProcessLookupError):
        return 0.0


def runs(pid: int) -> bool:
    return status(pid)[:1] not in ([], ["Z"])


def children(pid: int) -> list[int]:
    pids = [int(path.name) for path in Path("/proc").iterdir() if path.name.isdigit()]
    return [one for one in pids if status(one)[1:2] == [str(pid)]]


def main(stops: int, period: float, command: list[str]) -> None:
    rclpy.init()
    node, rng = subprocess.Popen(command), np.random.default_rng(5)
    robot, took, rest, paused, guards = Base(), [], [], [], []

    def fast() -> bool:
        return bool(robot.commands) and robot.commands[-1][1] > 0.3

    def slow() -> bool:
        return not fast()

    try:
        robot.meets()
        robot.charts(Grid(np.zeros((40, 40), bool), 0.5))
        for k in range(stops + 1):
            goal = max(ENDS, key=lambda place: math.dist(place, robot.xy))
            moment = float(rng.uniform(0.0, 2 * period))
            # The turn in which the moment comes may bring the guard's command to brake: the machine may let odometry wait.
            while not (robot.drive(fast, 5.0) and math.dist(goal, robot.xy) > 6.0 and not robot.drive(slow, moment) and fast()):
                goal = max(ENDS, key=lambda place: math.dist(place, robot.xy))
                robot.go(goal)
                robot.commands.clear()
            guards = children(node.pid)
            os.kill(node.pid, signal.SIGSTOP if k < stops else signal.SIGKILL)
            before, ended = robot.commands[-1], time.monotonic()
            robot.commands.clear()
            robot.paused, so_far = 0.0, sum(map(waited, guards))
            robot.drive(lambda: len(robot.commands) > 1 and robot.commands[-1][1:3] == (0.0, 0.0), 10.0)
            # What the node sent before it was stopped may come after that; it is as late as the machine lets this process wait.
            later = [one for one in robot.commands if one[0] > ended + TURN + one[3] or one[1] < before[1]]
            took.append(later[0][0] - ended if later else math.inf)
            paused.append(robot.paused + max(sum(map(waited, guards)) - so_far, 0.0))
            rest.append([one[1] for one in [before, *later]])
            if k < stops:
                os.kill(node.pid, signal.SIGCONT)
                robot.commands.clear()
        node.wait()
        robot.drive(lambda: not any(map(runs, guards)), 30.0)
        left = sum(map(runs, guards))
    finally:
        node.kill()
        node.wait()
    end(robot, took=took, paused=paused, speeds=rest, guards=len(guards), left=left)


if __name__ == "__main__":
    main(int(sys.argv[1]), float(sys.argv[2]), sys.argv[3:])
