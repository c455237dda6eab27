"""Run in the ROS environment: a robot whose node, on simulated time, is killed on the way and started again; prints the end.

Obstacles come as a PoseArray, without names and velocities. Arguments: the command of the node.
"""

from __future__ import annotations

import subprocess
import sys
import time

from harness import Remote, end, onwards, start

from antway import check_episode, load_scenario, run
from antway.ros2 import convert
from antway.ros2.messages import load, make
from antway.scenes import scene
from antway.world.policy import Observation, Tracks

ACTIONS = ("follow:", "avoid:", "wait:", "brake:", "step")


def main(command: list[str]) -> None:
    nodes = [subprocess.Popen(command)]
    try:
        drive(command, nodes)
    finally:
        for node in nodes:
            node.kill()
            node.wait()


def drive(command: list[str], nodes: list[subprocess.Popen]) -> None:
    robot = start(kind="poses")
    clock = robot.create_publisher(load("rosgraph_msgs/msg/Clock"), "/clock", 10)
    base, killed = 5000.0, []

    def tick(t: float) -> None:
        clock.publish(make("rosgraph_msgs/msg/Clock", clock=convert.stamp_message(t, make)))

    def before(o: Observation) -> bool:
        """Tick; once nothing is near, kill the node. The base stands, hearing nothing; a second later there is a new node."""
        tick(base + o.t)
        if len(nodes) == 2 or (not killed and (o.t < 4.0 or len(o.tracks))):
            return False
        if not killed:
            nodes[0].kill()
            nodes[0].wait()
            killed.append(o.t)
        if o.t < killed[0] + 1.0:
            return True
        robot.printed.clear()
        nodes.append(subprocess.Popen(command))
        robot.until(
            "'no goal'", lambda: any(text == "no goal" for _, text in robot.printed)
        )  # the goal is gone, and it says so

        def again() -> None:
            robot.go(place.goal)
            robot.senses(o, base)

        robot.until("setting out", lambda: any(text.startswith(ACTIONS) for _, text in robot.printed), again)
        return False  # the map came from the latched topic

    place = load_scenario(scene("paper"))
    robot.charts(place.task.grid)
    started = time.monotonic()
    result = run(place, Remote(robot, base, before), seed=11)
    check_episode(result)

    # on simulated time diagnostics carry the simulation's; its clock goes back, and then it stands still
    still = Observation(result.time, place.goal, (0.0, 0.0), 0.0, Tracks.none())
    later = onwards(robot, still, base)
    robot.hears("arrived", later)
    tick(base + 500.0)
    robot.until("simulated time", lambda: any(abs(t - base - 500.0) < 1.0 for t, _ in robot.printed))
    robot.go(place.start)
    robot.until("driving", lambda: not robot.stands(), later)
    tick(100.0)
    robot.hears("jumped by -", onwards(robot, still, 100.0))
    robot.until("driving again", lambda: not robot.stands(), onwards(robot, still, 101.0))
    robot.hears("no odometry for")
    end(robot, outcome=result.outcome.value, clearance=result.min_clearance, killed=killed, wall=time.monotonic() - started)


if __name__ == "__main__":
    main(sys.argv[1:])
