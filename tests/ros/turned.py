"""Run in the ROS environment beside an active node with the stand-in of tf2_ros: odometry and sensors in frames of their own.

The map's origin is turned, odometry comes in a frame that tf places, and the robot sees by a laser that is mounted askew. As
Nav2's localisation does, it post-dates its transforms.
"""

from __future__ import annotations

import math

from harness import Remote, end, onwards, start

from antway import check_episode, load_scenario, run
from antway.ros2 import frames
from antway.scenes import scene
from antway.world.policy import Observation, Tracks


def main() -> None:
    robot = start(kind="scan", world=(3.0, -2.0, 0.7), odom=(-4.0, 5.0, -2.0), mount=(0.15, 0.05, 0.4))
    place = load_scenario(scene("paper"))
    robot.charts(place.task.grid)
    base = 1000.0
    still = Observation(0.0, place.start, (0.0, 0.0), 0.0, Tracks.none())

    # before tf knows odom, odometry is refused; then tf is heard of, and falls silent
    robot.hears("header.frame_id = 'odom'", lambda: robot.senses(still, base, tf=False))
    later = onwards(robot, still, base)
    robot.printed.clear()
    robot.go(place.goal)
    robot.until("driving", lambda: not robot.stands() if robot.twist else False, later)
    for _ in range(2):
        robot.hears("tf is silent", lambda: [later(tf=False) for _ in range(5)], every=0.1)
    assert not any("no odometry" in text for _, text in robot.printed), "the cause is told, not that it comes to nothing"

    base += 1000.0
    robot.hears("jumped", lambda: robot.senses(still, base - 0.2))
    result = run(place, Remote(robot, base), seed=3)
    check_episode(result)
    lines = [m for m in robot.seen["decisions"].markers if m.ns == "motion"]
    tip = lines[-1].points[-1]
    goal = frames.move_point(robot.world, place.goal)
    robot.until("predictions", lambda: "predictions" in robot.seen)
    discs = [m for m in robot.seen["predictions"].markers if m.ns == "places"]
    end(
        robot,
        outcome=result.outcome.value,
        clearance=result.min_clearance,
        steps=len(result.cycle_ms),
        motion_to_goal=math.dist((tip.x, tip.y), goal),
        predicted=len(discs),
    )


if __name__ == "__main__":
    main()
