"""The node under real ROS 2, in an environment of its own (.venv-ros, by `make ros`): each test runs processes there."""

from __future__ import annotations

import json
import os
import subprocess
import warnings
from itertools import pairwise
from pathlib import Path

import pytest

from common import costly

HERE = Path(__file__).resolve().parent
BIN = HERE.parent / ".venv-ros" / "bin"
NODE = ["antway", "ros2"]
PAPER = {
    "autostart": True,
    "robot.drive": "holonomic",
    "robot.sensor_range": 5.0,
    "task.obstacle_speed": 1.0,
}  # as scene "paper" has it
pytestmark = pytest.mark.skipif(not (BIN / ".ready").exists(), reason="no ROS 2 environment at .venv-ros (make ros)")


def environment(*paths: Path) -> dict[str, str]:
    """A domain of this process's own, on this machine alone; with `paths` to import from."""
    own = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "ROS_DOMAIN_ID": str(1 + os.getpid() % 100), "PYTHONFAULTHANDLER": "1"}
    return os.environ | own | {"PYTHONPATH": os.pathsep.join(filter(None, [*map(str, paths), os.environ.get("PYTHONPATH")]))}


def arguments(settings: dict) -> list[str]:
    """`settings` as ROS takes parameters."""
    return ["--ros-args", *(part for name, value in settings.items() for part in ("-p", f"{name}:={json.dumps(value)}"))]


class Crashed(AssertionError):
    """A script of tests/ros was ended by a signal: rclpy's native code crashed under it, which was seen once."""


def script(name: str, *options: object, timeout: float = 300) -> dict:
    """Run a script of tests/ros; returns the JSON object that it prints last."""
    done = subprocess.run(
        [BIN / "python", HERE / "ros" / name, *map(str, options)],
        env=environment(HERE),
        capture_output=True,
        text=True,
        timeout=timeout,
    )
    if done.returncode < 0:
        raise Crashed(f"{name} was ended by signal {-done.returncode}\n{done.stdout}{done.stderr}")
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def beside(
    command: list[str], settings: dict, path: Path, name: str, *options: object, stubs: bool = False, timeout: float = 300
) -> dict:
    """Run a script of tests/ros beside a node, which ends well when it is told to; once more if the script itself crashes."""
    try:
        return _beside(command, settings, path, name, *options, stubs=stubs, timeout=timeout)
    except Crashed as crash:
        warnings.warn(f"a script crashed and was started again, beside a new node: {crash}", stacklevel=2)
        return _beside(command, settings, path, name, *options, stubs=stubs, timeout=timeout)


def _beside(command: list[str], settings: dict, path: Path, name: str, *options: object, stubs: bool, timeout: float) -> dict:
    log = path / "node.log"
    with log.open("w") as out:
        node = subprocess.Popen(
            [BIN / command[0], *command[1:], *arguments(settings)],
            env=environment(HERE / "ros" / "stubs" if stubs else HERE / "ros"),
            stdout=out,
            stderr=subprocess.STDOUT,
        )
        try:
            result = script(name, *options, timeout=timeout)
        except AssertionError as error:
            raise type(error)(f"{error}\nthe node's log:\n{log.read_text()[-3000:]}") from None
        finally:
            node.terminate()
            status = node.wait(timeout=60)
    assert status == 0, log.read_text()
    print(result)
    return result


@pytest.mark.timeout(3000)
def test_a_robot_reaches_its_goal(tmp_path):
    """A simulated robot behind topics reaches its goal without contact, one command for each 0.1 s; each failure stops it.

    The map comes late and once malformed; sensors fall silent, the clock jumps, a goal is pre-empted and dropped: each time the
    node stops the robot and says why. GetPlan's path is as long as that of the verified planner.
    """
    episodes = costly(3, 20)
    result = beside(NODE, PAPER, tmp_path, "robot.py", episodes, timeout=300 + 120 * episodes)
    assert len(result["episodes"]) == episodes and result["paths"] > 0
    for one in result["episodes"]:
        assert one["outcome"] == "reached" and one["clearance"] > 0.0, one
        assert one["answers"] >= one["steps"], one


def test_every_end_of_the_actions(tmp_path):
    """compute_path_to_pose and follow_path end as Nav2's do, with its error codes: done, refused, cancelled, replaced, late.

    Under Nav2's own types where nav2_msgs can be imported, else under an action of test_msgs in their place.
    """
    settings = {"autostart": True, "robot.drive": "holonomic", "wait_timeout": 1.0, "progress_time": 3.0}
    found = beside(["python", str(HERE / "ros" / "stand_in.py")], settings, tmp_path, "actions.py")["ends"]
    drove, inactive, visited = found.pop("drove"), found.pop("inactive"), found.pop("visited")
    assert {name: tuple(end[:2]) for name, end in found.items()} == {
        "no map": ("aborted", 200),
        "no odometry": ("aborted", 202),
        "free": ("succeeded", 0),
        "from here": ("succeeded", 0),
        "no such planner": ("aborted", 201),
        "on the moon": ("aborted", 202),
        "start outside": ("aborted", 203),
        "goal outside": ("aborted", 204),
        "start occupied": ("aborted", 205),
        "goal occupied": ("aborted", 206),
        "closed": ("aborted", 208),
        "no such controller": ("aborted", 101),
        "way on the moon": ("aborted", 102),
        "no way": ("aborted", 103),
        "into the wall": ("aborted", 103),
        "way": ("succeeded", 0),
        "cancelled": ("cancelled", 0),
        "refreshed": ("aborted", 0),
        "replaced by goal_pose": ("aborted", 0),
        "refused on the way": ("aborted", 103),
        "ended by one that is refused": ("aborted", 100),
        "tour": ("succeeded", 0),
        "tour into the wall": ("aborted", 306),
        "visit": ("succeeded", 0),
        "visit and be cancelled": ("cancelled", 0),
        "visit a closet": ("aborted", 602),
        "silent": ("aborted", 104),
        "stuck": ("aborted", 105),
        "deactivated": ("aborted", 100),
        "active": ("succeeded", 0),
        "shut down": ("aborted", 100),
    }
    assert found["free"][2] > 20 and found["goal occupied"][2] == 0, "poses"
    assert drove == [True, True, True], "drove before the cancel, was answered, and went on when the path was refreshed"
    assert inactive == [False, False]
    assert found["tour"][2] > 50 and found["visit"][2] == 0, "poses of the tour's path, and stops that were missed"
    assert visited == [2, 1, 0], "in the best order, not in that given"


def test_frames_that_are_turned_and_a_laser(tmp_path):
    """On a turned map, with odometry placed by tf and a laser mounted askew, the goal is reached without contact.

    Odometry is refused while tf does not know its frame, and the robot stops when tf falls silent. For tf2_ros, which has no
    wheels, there is a stand-in.
    """
    settings = PAPER | {"obstacles_type": "sensor_msgs/msg/LaserScan"}
    result = beside(NODE, settings, tmp_path, "turned.py", stubs=True)
    assert result["outcome"] == "reached" and result["clearance"] > 0.0
    assert result["motion_to_goal"] < 1e-9 and result["predicted"] > 0


def test_obstacles_by_a_hook(tmp_path):
    """Obstacles of a type of one's own come through a converter; commands go out unstamped; what is in no frame is refused.

    The map changes on the way: a stop, and on.
    """
    settings = {
        "autostart": True,
        "robot.drive": "holonomic",
        "stamped": False,
        "obstacles_type": "geometry_msgs/msg/PolygonStamped",
        "obstacles_converter": "hook:read",
    }
    result = beside(NODE, settings, tmp_path, "inputs.py", "points", "unstamped")
    assert set(result["kind"]) == {"linear", "angular"}


def test_killed_and_started_again():
    """A node on simulated time that is killed on the way and started again takes the robot on without contact.

    Its map comes from the latched topic; it says that it has no goal, and drives when it is given one. The clock may go back.
    """
    settings = PAPER | {
        "use_sim_time": True,
        "obstacles_type": "geometry_msgs/msg/PoseArray",
        "obstacle_radius": 0.4,
    }
    result = script("restart.py", BIN / NODE[0], *NODE[1:], *arguments(settings))
    assert result["outcome"] == "reached" and result["clearance"] > 0.0 and len(result["killed"]) == 1


@pytest.mark.parametrize("name", ["SIGHUP", "SIGTERM"])
def test_a_node_that_is_ended_stops_the_robot_and_answers(name):
    """A terminal that closes used to leave the robot driving; who asked for the drive is told that it has ended."""
    command = [BIN / "python", HERE / "ros" / "stand_in.py", *arguments({"autostart": True, "robot.drive": "holonomic"})]
    result = script("hangup.py", name, *command)
    assert result == {"drove": True, "result": ["aborted", 100, 0], "status": 0}


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
def test_the_guards_process_brakes_for_a_node_that_is_stopped_or_killed(drive):
    """The first braking command comes within one period of the odometry that the node leaves unanswered; then it stands.

    The guard takes missing odometry for late, not for missing, for half a period. A machine that lets the process that sends
    odometry, or that of the guard, wait for so long makes it later by as much.
    """
    period, stops = 0.2, costly(3, 30)
    settings = {"autostart": True, "robot.drive": drive, "robot.dynamics": "ramps", "robot.dt": period, "guard_process": True}
    result = script("outlives.py", stops, period, BIN / NODE[0], *NODE[1:], *arguments(settings), timeout=120 + 20 * stops)
    assert len(result["took"]) == stops + 1
    for took, paused, speeds in zip(result["took"], result["paused"], result["speeds"], strict=True):
        assert took <= 2 * period + paused, result
        assert speeds[0] > 0.3 and speeds[-1] == 0.0 and all(b <= a for a, b in pairwise(speeds)), result
    assert result["guards"] == 1 and result["left"] == 0, "the guard's process ends once the robot of a killed node stands"


@pytest.mark.timeout(1200)
def test_up_and_down():
    """Up and down 100 times neither fails nor leaks memory or files; parameters have the ranges that their definitions have."""
    cycles = costly(100, 1000)
    result = script("cycles.py", cycles, timeout=300 + 2 * cycles)
    assert result["poses"] > 20, "a plan that was asked for is answered before the service closes"
    (early, files), (late, files_late) = result["resources"]
    assert late - early < 20_000 + 20 * cycles, f"{late - early} kB more after {cycles} cycles"
    assert files_late <= files + 2
    assert result["refused"]["successful"] is False and "chance" in result["refused"]["reason"]
    assert result["ranges"] == {
        "robot.radius": [5e-324, 1e10],
        "policy.chance": [1e-9, 0.999999999],
        "policy.expansions": [1, 2**63 - 1],
        "task.obstacle_surge": [0.0, float("inf")],
    }
    assert "one of dijkstra" in result["planner"]
    assert result["speeds"] == [1.0, 2.0], "of a named robot with a speed that is set to what is usual"


REFUSED = [
    ("robot.radius", "-1.0", "robot.radius"),
    ("robot.radius", "wide", "robot.radius = 'wide': must be a finite number"),
    ("robot.raduis", "0.3", "no parameter has this name; there is robot.radius"),
    ("autostart", "true", "robot.drive = '': must be holonomic"),
    ("robot.footprint", "{{}", "parse"),
]


def is_refused(status: int, errors: str, said: str) -> bool:
    """Whether one line says so, in these words, with status 2 and no traceback."""
    lines = [line for line in errors.splitlines() if line.startswith("error: ")]
    return status == 2 and len(lines) == 1 and said in lines[0] and "Traceback" not in errors


@pytest.fixture(scope="module")
def ended() -> dict[str, tuple[int, str]]:
    """Status and errors of the command with each setting of REFUSED, from one process: to start one takes seconds."""
    return script("refused.py", *(f"{name}:={value}" for name, value, _ in REFUSED))


@pytest.mark.parametrize(("name", "value", "said"), REFUSED)
def test_a_wrong_parameter_is_one_line_and_status_two(
    name: str, value: str, said: str, ended: dict[str, tuple[int, str]]
) -> None:
    """Values that a definition refuses, and names that there are not, end the node with one line that says which."""
    status, errors = ended[f"{name}:={value}"]
    assert is_refused(status, errors, said), (status, errors)


def test_a_wrong_parameter_ends_the_process() -> None:
    """The same where the command is a process of its own."""
    command = [BIN / "python", "-m", "antway", "ros2", "--ros-args", "-p", "robot.radius:=-1.0"]
    done = subprocess.run(command, env=environment(), capture_output=True, text=True, timeout=120, check=False)
    assert is_refused(done.returncode, done.stderr, "robot.radius"), done.stderr
