"""Run in the ROS environment: a node that is ended by a signal while it drives along a path; prints what became of both.

Arguments: the name of the signal, the command of the node.
"""

from __future__ import annotations

import signal
import subprocess
import sys

from actions import Asked, Body
from harness import end, start
from rclpy.action import ActionClient
from stand_in import kinds, room


def main(name: str, command: list[str]) -> None:
    node = subprocess.Popen(command)
    try:
        robot = start()
        body, client = Body(robot), ActionClient(robot, kinds()["follow_path"].type, "follow_path")
        robot.until("follow_path", client.server_is_ready)
        robot.charts(room())
        asked = Asked(robot, client, "way", "follow_path")
        for _ in range(5):
            body.step()
        drove = not robot.stands()
        node.send_signal(signal.Signals[name])
        robot.until("a result, or the node's end", lambda: asked.ended() or node.poll() is not None)
        result = asked.result() if asked.ended() else None
        status = node.wait(30.0)
        robot.until("a stop", robot.stands)
    finally:
        node.kill()
        node.wait()
    end(robot, drove=drove, result=result, status=status)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2:])
