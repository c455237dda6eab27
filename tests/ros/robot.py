"""Run in the ROS environment beside an active `antway ros2`: a robot of antway.world behind topics; prints what came of it.

Arguments: how many episodes.
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from harness import Remote, end, onwards, start

from antway import Grid, check_episode, load_scenario, plan, run
from antway.ros2 import convert
from antway.ros2.messages import load, make
from antway.scenes import scene
from antway.world.policy import Observation, Tracks


def main(episodes: int) -> None:
    robot = start()
    service = robot.create_client(load("nav_msgs/srv/GetPlan"), "get_plan")
    robot.until("get_plan", service.service_is_ready)
    place = load_scenario(scene("paper"))
    grid = place.task.grid

    # a goal before the map; then a map that is malformed; then the map
    base = 1000.0
    still = Observation(0.0, place.start, (0.0, 0.0), 0.0, Tracks.none())
    robot.go(place.goal)
    robot.hears("waiting for a map", lambda: robot.senses(still, base))
    short = convert.grid_message(grid, make)
    short.data = short.data[:-1]
    robot.hears("map refused: OccupancyGrid: data.length", lambda: robot.out["map"].publish(short))
    robot.hears("the map has changed", lambda: robot.charts(grid, 10.0))  # a latched topic keeps only the newest on its way
    robot.hears("map refused: header.stamp = 9.0", lambda: robot.charts(Grid(~grid.blocked), 9.0))
    robot.charts(grid, 10.0)

    # GetPlan is as long as what the verified planner finds; to a goal in a wall, it leads as near as is tolerated
    def ask(goal, tolerance: float = 0.0) -> np.ndarray:
        request = make(
            "nav_msgs/srv/GetPlan_Request", start=robot.pose(place.start), goal=robot.pose(goal), tolerance=tolerance
        )
        future = service.call_async(request)
        robot.until("get_plan", future.done)
        return convert.read_path(future.result().plan)

    answer = []
    while len(answer) == 0:  # asked again until the map has arrived
        answer = ask(place.goal)
    expected = plan(grid, place.start, place.goal, robot_radius=place.robot.radius)
    served = float(np.hypot(*np.diff(answer, axis=0).T).sum())
    assert math.isclose(served, expected.length, rel_tol=1e-12), (served, expected.length)
    wall = grid.to_xy(np.argwhere(grid.blocked)[:1])[0].tolist()
    assert len(ask(wall)) == 0
    near = ask(wall, 3.0 * grid.resolution)[-1]
    room = grid.inflate(place.robot.radius)
    assert room.is_free(room.cell_at(near)) and math.dist(near, wall) <= 3.0 * grid.resolution

    outcomes = []
    for seed in range(episodes):
        base += 1000.0
        robot.hears("jumped", lambda base=base: robot.senses(still, base - 0.2))
        before, started = robot.answered, time.monotonic()
        result = run(place, Remote(robot, base), seed=seed)
        check_episode(result)
        outcomes.append(
            {
                "outcome": result.outcome.value,
                "reason": result.reason,
                "steps": len(result.cycle_ms),
                "answers": robot.answered - before,
                "wall": time.monotonic() - started,
                "clearance": result.min_clearance,
            }
        )
        last = Observation(result.time, place.goal, (0.0, 0.0), 0.0, Tracks.none())
        later = onwards(robot, last, base)
        robot.hears("arrived", later)

    # an obstacle sensor, then odometry, that fall silent; a goal pre-empted, and dropped; a clock that goes back
    robot.go(place.start)
    later()
    robot.hears("the sensor is silent", lambda: later(obstacles=False))
    late = float(next(text for _, text in robot.printed if "silent" in text).split()[2])
    assert 0.5 < late < 0.5 + 0.1 + 0.01, late  # it stopped in the first cycle after the guard's time
    started = time.monotonic()
    robot.hears("no odometry for")
    quiet = time.monotonic() - started
    robot.hears("pre-empted", lambda: robot.go(place.goal))
    stop = robot.create_client(load("std_srvs/srv/Trigger"), "/antway/stop")
    robot.until("stop", stop.service_is_ready)
    called = []
    robot.hears("stopped on request", lambda: called or called.append(stop.call_async(make("std_srvs/srv/Trigger_Request"))))
    robot.until("its answer", called[0].done)
    assert called[0].result().success
    robot.hears("jumped by -", onwards(robot, last, base, step=-1.0))
    robot.until("pictures", lambda: {"decisions", "pheromone", "predictions"} <= set(robot.seen))
    spaces = {m.ns for m in robot.seen["decisions"].markers}
    assert {"action", "motion"} <= spaces, spaces
    assert robot.seen["pheromone"].info.width > 0
    end(robot, episodes=outcomes, paths=robot.paths, quiet=quiet)


if __name__ == "__main__":
    main(int(sys.argv[1]))
