"""The node with actions of test_msgs in the place of Nav2's, which has no wheels: goals by number, error codes back as numbers.

What is tested so is everything but Nav2's own message classes; those are used where nav2_msgs can be imported.
"""

from __future__ import annotations

import sys
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np
from test_msgs.action import Fibonacci

from antway import Grid
from antway.ros2 import convert
from antway.ros2.messages import make
from antway.ros2.nav2 import Kind, nav2_kinds
from antway.ros2.node import main

NAV2 = find_spec("nav2_msgs") is not None


def room() -> Grid:
    """A room of 8 m by 12 m with a wall that leaves a way round, and a closet without a door."""
    blocked = np.zeros((40, 60), bool)
    blocked[0:28, 30] = blocked[30:36, 5] = blocked[30:36, 12] = blocked[30, 5:13] = blocked[35, 5:13] = True
    return Grid(blocked, 0.2)


START, GOAL, WALL, CLOSET, OUT = (2.0, 2.0), (10.0, 2.0), (6.1, 2.1), (1.7, 6.6), (50.0, 2.0)
ROUND = [START, (4.0, 5.0), (6.1, 6.6), (8.0, 5.0), GOAL]
BESIDE = [(2.0, 2.2), (4.1, 5.1), (6.1, 6.7), (8.0, 5.1), GOAL]


def stamped(xy, frame: str = "map"):
    header, pose = convert.header_message(0.0, frame, make), convert.pose_message(*xy, 0.5, make)
    return make("geometry_msgs/msg/PoseStamped", header=header, pose=pose)


def compute(start, goal, planner: str = "", frame: str = "map") -> dict:
    ends = {"start": stamped(START if start is None else start), "goal": stamped(goal, frame)}
    return {**ends, "planner_id": planner, "use_start": start is not None}


def follow(xy, controller: str = "", frame: str = "map") -> dict:
    return {"path": convert.path_message(xy, make, frame=frame), "controller_id": controller}


def tour(*goals) -> dict:
    return {"start": stamped(START), "goals": [stamped(xy) for xy in goals], "use_start": True}


def visit(*poses) -> dict:
    return {"number_of_loops": 0, "poses": [stamped(xy) for xy in poses]}


GOALS = {
    "free": compute(START, GOAL, "GridBased"),
    "from here": compute(None, GOAL, "dijkstra"),
    "no such planner": compute(START, GOAL, "teleport"),
    "on the moon": compute(START, GOAL, frame="moon"),
    "start outside": compute(OUT, GOAL),
    "goal outside": compute(START, OUT),
    "start occupied": compute(WALL, GOAL),
    "goal occupied": compute(START, WALL),
    "closed": compute(START, CLOSET),
    "way": follow(ROUND, "FollowPath"),
    "way beside": follow(BESIDE),
    "way back": follow(ROUND[::-1]),
    "no such controller": follow(ROUND, "Teleport"),
    "way on the moon": follow(ROUND, frame="moon"),
    "no way": follow([]),
    "into the wall": follow([START, WALL]),
    "tour": tour(GOAL, ROUND[1], ROUND[3], ROUND[2]),
    "tour into the wall": tour(GOAL, WALL),
    "visit": visit(ROUND[2], ROUND[1], (2.0, 4.0)),
    "visit and be cancelled": visit(START, GOAL),
    "visit a closet": visit(GOAL, CLOSET),
}
SERVERS = {"goal": "compute_path_to_pose", "path": "follow_path", "goals": "compute_tour", "poses": "visit_poses"}


def server_of(name: str) -> str:
    """The action that a goal is for."""
    return next(server for field, server in SERVERS.items() if field in GOALS[name])


def _fibonacci() -> Kind:
    def read(goal):
        return SimpleNamespace(**GOALS[list(GOALS)[goal.order]])

    def result(**fields):
        many = fields["path"].poses if "path" in fields else fields.get("missed_waypoints", [])
        return Fibonacci.Result(sequence=[fields["error_code"], len(many)])

    def feedback(**fields):
        if "current_waypoint" in fields:
            return Fibonacci.Feedback(sequence=[fields["current_waypoint"]])
        return Fibonacci.Feedback(sequence=[round(1000 * fields["distance_to_goal"]), round(1000 * fields["speed"])])

    return Kind(Fibonacci, read, result, feedback)


def kinds() -> dict[str, Kind]:
    """Nav2's actions if they can be had, else those of test_msgs."""
    return nav2_kinds() or dict.fromkeys(SERVERS.values(), _fibonacci())


def goal_message(name: str, server: str):
    """The goal of that name, as a message of whichever it is."""
    if NAV2:
        return kinds()[server].type.Goal(**GOALS[name])
    return Fibonacci.Goal(order=list(GOALS).index(name))


def numbers(result) -> tuple[int, int]:
    """The error code and the number of poses in a result."""
    if NAV2:
        return result.error_code, len(result.path.poses if hasattr(result, "path") else getattr(result, "missed_waypoints", []))
    return tuple(result.sequence)


def distance(feedback) -> float:
    """How far the goal is, m, in a feedback."""
    if NAV2:
        return feedback.tracking_feedback.remaining_path_length
    return feedback.sequence[0] / 1000


def waypoint(feedback) -> int:
    """The number of the pose that is driven to, in a feedback."""
    return feedback.current_waypoint if NAV2 else feedback.sequence[0]


if __name__ == "__main__":
    sys.exit(main(["antway", *sys.argv[1:]], kinds()))
