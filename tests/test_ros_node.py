"""The node under real ROS 2, in an environment of its own (.venv-ros, by `make ros`): each test runs processes there."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import pytest

from common import cases

HERE = Path(__file__).resolve().parent
BIN = HERE.parent / ".venv-ros" / "bin"
pytestmark = pytest.mark.skipif(not (BIN / ".ready").exists(), reason="no ROS 2 environment at .venv-ros (make ros)")


@pytest.fixture
def environment():
    """A domain of this process's own, on this machine alone."""
    return os.environ | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % 100)}


def script(name: str, argument: int, environment: dict[str, str], timeout: float) -> dict:
    """Run a script of tests/ros; returns the JSON object that it prints last."""
    done = subprocess.run(
        [BIN / "python", HERE / "ros" / name, str(argument)],
        env=environment,
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.timeout(3000)
def test_a_robot_reaches_its_goal(environment, tmp_path):
    """A simulated robot behind topics reaches its goal without contact, one command for each 0.1 s; each failure stops it.

    The map comes late and once malformed; sensors fall silent, the clock jumps, a goal is pre-empted: each time the node stops
    the robot and says why. GetPlan's path is as long as that of the verified planner.
    """
    episodes = cases(1, 20)
    settings = ["autostart:=true", "robot.sensor_range:=5.0", "task.obstacle_speed:=1.0"]
    arguments = [part for one in settings for part in ("-p", one)]
    log = tmp_path / "node.log"
    with log.open("w") as out:
        node = subprocess.Popen(
            [BIN / "antway", "ros2", "--ros-args", *arguments], env=environment, stdout=out, stderr=subprocess.STDOUT
        )
        try:
            result = script("robot.py", episodes, environment, timeout=300 + 120 * episodes)
        except AssertionError as error:
            raise AssertionError(f"{error}\nthe node's log:\n{log.read_text()[-3000:]}") from None
        finally:
            node.terminate()
            status = node.wait(timeout=60)
    print(result)
    assert status == 0, log.read_text()
    assert len(result["episodes"]) == episodes and result["paths"] > 0
    for one in result["episodes"]:
        assert one["outcome"] == "reached" and one["clearance"] > 0.0, one
        assert one["answers"] >= one["steps"], one


@pytest.mark.timeout(1200)
def test_up_and_down(environment):
    """Going up and down again and again neither fails nor leaks; a parameter out of its definition's range is refused."""
    cycles = cases(5, 100)
    result = script("cycles.py", cycles, environment, timeout=300 + 5 * cycles)
    early, late = result["memory"]
    assert late - early < 200 * cycles, f"{late - early} kB more after {cycles} cycles"
    assert result["refused"]["successful"] is False and "chance" in result["refused"]["reason"]
    assert result["lowest"] == 5e-324, "the least number above 0"
