"""Plays one case after another in a process of its own: absurd but finite values may be refused, and nothing else may go wrong.

Each line of stdin is a case as JSON, {"kind": ..., ...}; each line of stdout what came of it: "ok", "refused", or what went
wrong, the seconds of processor time that it took (less compilation), and by how many MiB memory was larger at its peak.
"""

from __future__ import annotations

import contextlib
import json
import math
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import tomli_w
from numba.core import event

from antway import BadInput, Command, Grid, Observation, Task, Tracks, load_scenario, make_policy
from antway.policies.guard import Guard
from antway.ros2 import convert
from antway.ros2.goals import Goal
from antway.ros2.pilot import Pilot
from antway.ros2.scan import Background, ScanTracker, discs, read_points, without_ids
from antway.ros2.settings import Settings
from antway.web.session import Session
from antway.world.episode import Episode
from antway.world.robots import load_robot
from antway.world.trace import Outcome
from common import play
from fake_ros import defaults

WALLS = np.zeros((20, 20), bool)
WALLS[8:12, 8:12] = True
ROOM = Grid(WALLS, 0.5)


class Compiling(event.Listener):
    """Counts the processor time of compilation, outermost events alone."""

    def __init__(self) -> None:
        self.depth, self.started, self.seconds = 0, 0.0, 0.0

    def on_start(self, event: object) -> None:
        if self.depth == 0:
            self.started = time.process_time()
        self.depth += 1

    def on_end(self, event: object) -> None:
        self.depth -= 1
        if self.depth == 0:
            self.seconds += time.process_time() - self.started


class Wrong(Exception):
    """What a policy raised within an episode, which keeps it as its outcome."""


def scenario(case: dict[str, Any]) -> None:
    """Load a scenario's file and play five control cycles."""
    with tempfile.TemporaryDirectory() as name:
        (Path(name) / "m.txt").write_text("\n".join("".join("#" if cell else "." for cell in row) for row in WALLS) + "\n")
        (Path(name) / "s.toml").write_text(tomli_w.dumps({"map": "m.txt", **case["scenario"]}))
        place = load_scenario(Path(name) / "s.toml")
    episode = Episode(place, case["policy"])
    for _ in range(5):
        if episode.outcome is None:
            episode.step()
    if episode.outcome is Outcome.ERROR or episode._fault:
        kind = (episode._fault or episode.reason).split(": ")[1]
        if kind not in ("BadParameter", "TooLarge", "OutOfBounds", "CellBlocked", "BadScenario"):
            raise Wrong(episode._fault or episode.reason)


def observation(case: dict[str, Any]) -> None:
    """Show five observations to a policy and to a guard."""
    robot = load_robot(case["robot"])
    task = Task(ROOM, robot, (2.0, 2.0), (8.0, 8.0), **case["task"])
    policy, guard = make_policy("antway", mode=case["mode"]), Guard(mode=case["mode"])
    policy.reset(task, 0)
    guard.reset(task)
    errors = []
    for k in range(5):
        one = case["seen"][k % len(case["seen"])]
        try:
            tracks = read_tracks(one["tracks"])
            seen = Observation(tracks=tracks, **{key: one[key] for key in _OWN})
            command = policy.act(seen)
            policy.explain()
            for passed in (command, guard.limit(seen, Command(tuple(case["command"])))):
                if not all(map(math.isfinite, (*passed.velocity, *(passed.twist or ())))):
                    raise Wrong(f"the command {passed} is not finite")
        except BadInput as error:
            errors.append(error)
    if len(errors) == 5:
        raise errors[0]


def read_tracks(given: dict[str, Any]) -> Tracks:
    """Return the tracks of a case."""
    return Tracks(given["id"], np.reshape(given["xy"], (-1, 2)), np.reshape(given["velocity"], (-1, 2)), given["radius"])


_OWN = ("t", "xy", "velocity", "heading", "stamp", "turn_rate")


def message(case: dict[str, Any]) -> None:
    """Let the pilot of the ROS node drive by messages."""
    pilot = Pilot(Settings.of(defaults(**{"robot.drive": case["drive"]})))
    pilot.receive_map(ROOM)
    pilot.go(Goal((8.0, 8.0), gives_up=False))
    tracker = ScanTracker()
    for k in range(5):
        one = case["messages"][k % len(case["messages"])]
        t = 1.0 + 0.1 * k
        try:
            scan, _ = read_points(SimpleNamespace(**one["scan"]), 0.2)
            points = Background(ROOM, 0.1).off(scan + 2.0, (2.0, 2.0))
            tracker.update(t, without_ids(*discs(points, gap=0.3, largest=0.8)[:2]))
        except BadInput:
            pass
        tracks = Tracks.none()
        with contextlib.suppress(BadInput):
            _, tracks = convert.read_markers(convert.markers_message(read_tracks(one["tracks"]), t))
        pilot.scan = (t, tracks)
        x, y, yaw, vx, vy, rate = one["odometry"]
        twist = SimpleNamespace(linear=SimpleNamespace(x=vx, y=vy, z=0.0), angular=SimpleNamespace(x=0.0, y=0.0, z=rate))
        pose = convert.pose_message(x, y, yaw)
        odometry = SimpleNamespace(
            header=convert.header_message(t, "map"), pose=SimpleNamespace(pose=pose), twist=SimpleNamespace(twist=twist)
        )
        with contextlib.suppress(BadInput):
            pilot.receive_odometry(convert.read_odometry(odometry), t)
        pilot.predictions(3.0)


def page(case: dict[str, Any]) -> None:
    """Send requests to a tab of the live page; a refused one changes nothing, and what is left plays five steps."""
    session = Session()
    refused = []
    for request in case["requests"]:
        try:
            session.apply(request)
        except BadInput as error:
            refused.append(error)
    play(session, 5)
    json.dumps(session.frame(), allow_nan=False)
    json.dumps(session.describe(), allow_nan=False)
    if len(refused) == len(case["requests"]):
        raise refused[0]


KINDS: dict[str, Callable[[dict[str, Any]], None]] = {
    "scenario": scenario,
    "observation": observation,
    "message": message,
    "page": page,
}


def memory(field: str) -> float:
    """A size of this process, MiB."""
    text = Path("/proc/self/status").read_text()
    return int(text.split(f"{field}:")[1].split()[0]) / 1024


def main() -> None:
    warnings.simplefilter("error")
    compiling = Compiling()
    with event.install_listener("numba:compile", compiling):
        for line in sys.stdin:
            case = json.loads(line)
            Path("/proc/self/clear_refs").write_text("5")
            before, compiled, started = memory("VmRSS"), compiling.seconds, time.process_time()
            try:
                KINDS[case["kind"]](case)
                what = "ok"
            except BadInput as error:
                what = "refused"
                str(error)
            except Exception as error:
                where = traceback.extract_tb(error.__traceback__)[-1]
                what = f"{type(error).__name__}: {error} ({where.filename.rpartition('/')[2]}:{where.lineno})"
            seconds = time.process_time() - started - (compiling.seconds - compiled)
            print(json.dumps([what, seconds, memory("VmHWM") - before]), flush=True)


if __name__ == "__main__":
    main()
