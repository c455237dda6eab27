"""Rate and jitter of cmd_vel on the wall's clock: odometry and 20 obstacles come in, commands go out.

Run as `.venv-ros/bin/python benchmarks/ros_rate.py [--rate HZ] [--seconds S] [--json FILE]`; it starts the node beside it.
As the peer, the intervals at which the odometry itself went out, by the same clock.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parents[1]
sys.path += [str(HERE / "tests"), str(HERE / "tests" / "ros")]
os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}

import rclpy  # noqa: E402
from harness import end, onwards, start  # noqa: E402

from antway import Grid  # noqa: E402
from antway.world.policy import Observation, Tracks  # noqa: E402
from report import write  # noqa: E402


def measure(rate: float, seconds: float) -> dict[str, float]:
    """Drive to and fro for so long with odometry at `rate` Hz; figures in Hz and ms."""
    robot = start(pictures=False)
    robot.charts(Grid(np.zeros((200, 200), bool), 0.1))
    rng = np.random.default_rng(0)
    tracks = Tracks(np.arange(20), rng.uniform(8, 18, (20, 2)), rng.uniform(-0.5, 0.5, (20, 2)), np.full(20, 0.3))
    o = Observation(0.0, (2.0, 10.0), (0.0, 0.0), 0.0, tracks)
    drive = onwards(robot, o, 1000.0, step=1.0 / rate)
    robot.go((18.0, 10.0))
    robot.until("the first command", lambda: robot.twist is not None, drive)
    sent, heard, known = [], [], robot.answered
    due = started = time.perf_counter()
    while due < started + seconds:
        late = False
        while not late:
            late = time.perf_counter() >= due
            rclpy.spin_once(robot, timeout_sec=max(due - time.perf_counter(), 0.0))
            if robot.answered > known:
                known = robot.answered
                heard.append(time.perf_counter())
        sent.append(time.perf_counter())
        drive()
        due += 1.0 / rate
    out, back = 1e3 * np.diff(sent), 1e3 * np.diff(heard)
    latency = [1e3 * min(t - s for s in sent if s <= t) for t in heard if t > sent[0]]
    result = {
        "odometry_hz": (len(sent) - 1) / (sent[-1] - sent[0]),
        "odometry_jitter_ms": float(out.std()),
        "cmd_vel_hz": (len(heard) - 1) / (heard[-1] - heard[0]),
        "cmd_vel_jitter_ms": float(back.std()),
        "longest_gap_ms": float(back.max()),
        "latency_median_ms": float(np.median(latency)),
        "latency_p99_ms": float(np.quantile(latency, 0.99)),
    }
    end(robot)
    return result


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rate", type=float, default=20.0)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    settings = ["autostart:=true", "robot.sensor_range:=30.0"]
    command = [str(HERE / ".venv-ros" / "bin" / "antway"), "ros2", "--ros-args", "--log-level", "error"]
    node = subprocess.Popen(command + [part for one in settings for part in ("-p", one)])
    try:
        result = measure(options.rate, options.seconds)
    finally:
        node.terminate()
        node.wait()
    for name, value in result.items():
        print(f"{name:20} {value:8.2f}")
    if options.json:
        write(options.json, result)


if __name__ == "__main__":
    main()
