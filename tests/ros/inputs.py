"""Run in the ROS environment beside an active node: a short drive with obstacles of some kind; prints what came of it.

Arguments: the kind of obstacles (see harness.KINDS), and whether commands are stamped.
"""

from __future__ import annotations

import sys

import numpy as np
from harness import end, onwards, start

from antway import Grid
from antway.world.policy import Observation, Tracks


def main(kind: str, stamped: bool) -> None:
    robot = start(kind=kind, stamped=stamped)
    robot.charts(Grid(np.zeros((40, 40), bool), 0.2))
    side = Tracks(np.array([4]), np.array([[4.0, 7.0]]), np.zeros((1, 2)), np.array([0.4]))
    wall = Tracks(np.arange(9), np.column_stack((np.full(9, 4.0), np.arange(9.0))), np.zeros((9, 2)), np.full(9, 0.6))
    here = Observation(0.0, (2.0, 2.0), (0.0, 0.0), 0.0, side)

    # it drives when something stands aside, and on when the map changes; it tells of what stands ahead;
    # what comes in no frame is refused, which is silence
    free = onwards(robot, here, 1000.0)
    robot.go((6.0, 2.0))
    robot.until("driving", lambda: not robot.stands(), free)
    robot.hears("the map has changed", lambda: robot.charts(Grid(np.zeros((41, 40), bool), 0.2), 1.0))
    robot.until("driving on", lambda: not robot.stands(), free)
    ahead = onwards(robot, Observation(0.0, (2.0, 2.0), (0.0, 0.0), 0.0, wall), 2000.0)
    robot.printed.clear()
    robot.until("the obstacles", lambda: any("with obstacle" in text for _, text in robot.printed), ahead)
    bad = robot.scene(here, 3000.0)
    bad.header.frame_id = "moon"

    def refused() -> bool:
        return any("obstacles refused" in text and "moon" in text for _, text in robot.printed)

    robot.until("a refusal", refused, lambda: robot.out["obstacles"].publish(bad))
    robot.hears("the sensor is silent", lambda: ahead(obstacles=False))
    end(robot, kind=robot.twist.get_fields_and_field_types(), answered=robot.answered)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2] == "stamped")
