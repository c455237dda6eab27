"""Structured cases of valid types and absurd numbers: scenarios, observations, messages, requests, each played for five steps.

A case may be refused by a `BadInput`, or played. No process may end, nothing may take over 2 s of processor time or 300 MiB,
and nothing may be raised that is not typed. `ANTWAY_TEST_SCALE=10` runs the 20,000 cases of a night.
"""

from __future__ import annotations

import json
import math
import select
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as some

from common import costly

pytestmark = pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="measures memory by /proc")
SECONDS, MEBIBYTES = 2.0, 300.0  # of processor time, less compilation
PATIENCE = 600.0  # s of the clock, compilation on a machine under load within; then a case hangs

ABSURD = [0.0, -0.0, 5e-324, 1e-300, 1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e10, 1e12, 1e18, 1e19, 1e100, 1e300, 1.7e308]
absurd = some.one_of(
    some.sampled_from([*ABSURD, *(-value for value in ABSURD)]), some.floats(allow_nan=False, allow_infinity=False)
)
SELDOM = 13  # of the integers from 0 to 19


def mostly(sensible: some.SearchStrategy[Any], other: some.SearchStrategy[Any] = absurd) -> some.SearchStrategy[Any]:
    """A sensible value as a rule, so that most cases of many values get past the first check."""
    return some.integers(0, 19).flatmap(lambda k: other if k == SELDOM else sensible)


SENSIBLE = mostly(some.floats(0.05, 3.0))
PLACE = mostly(some.floats(0.5, 9.5))
xy = some.tuples(PLACE, PLACE).map(list)
whole = some.one_of(some.integers(0, 9), some.sampled_from([-1, -(2**63), 2**31, 2**53 + 1, 2**63 - 1]))


def few(**fields: Any) -> some.SearchStrategy[dict[str, Any]]:
    """Some of the fields."""
    return some.fixed_dictionaries({}, optional=fields)


MOTIONS = some.one_of(
    some.fixed_dictionaries(
        {"motion": some.just("line"), "start": xy, "end": xy, "speed": SENSIBLE}, optional={"delay": SENSIBLE}
    ),
    some.fixed_dictionaries(
        {"motion": some.just("back-and-forth"), "start": xy, "end": xy, "speed": SENSIBLE}, optional={"phase": SENSIBLE}
    ),
    some.fixed_dictionaries(
        {"motion": some.just("waypoints"), "points": some.lists(xy, min_size=1, max_size=4), "speed": SENSIBLE},
        optional={"pause": SENSIBLE, "loop": some.booleans()},
    ),
    some.fixed_dictionaries({"motion": some.just("bounce"), "start": xy, "speed": SENSIBLE}, optional={"heading": SENSIBLE}),
    some.fixed_dictionaries(
        {"motion": some.just("random-walk"), "start": xy, "speed": SENSIBLE}, optional={"turn_every": SENSIBLE}
    ),
    some.fixed_dictionaries(
        {"motion": some.just("pursue"), "start": xy, "speed": SENSIBLE}, optional={"gap": SENSIBLE, "follow_time": SENSIBLE}
    ),
    some.fixed_dictionaries(
        {
            "motion": some.just("replay"),
            "t": some.lists(SENSIBLE, min_size=2, max_size=2),
            "points": some.lists(xy, min_size=2, max_size=2),
        }
    ),
)
ROBOT = few(
    radius=SENSIBLE, v_max=SENSIBLE, a_max=SENSIBLE, dt=SENSIBLE, sensor_range=SENSIBLE, turn_rate=SENSIBLE, alpha_max=SENSIBLE,
    v_reverse=SENSIBLE, brake_max=SENSIBLE, latency=SENSIBLE, turning_radius=SENSIBLE,
    drive=some.sampled_from(["holonomic", "differential", "ackermann"]), dynamics=some.sampled_from(["ramps", "steps"]),
    footprint=mostly(
        some.just([[0.4, 0.3], [0.4, -0.3], [-0.3, 0.0]]),
        some.lists(some.tuples(absurd, absurd).map(list), min_size=3, max_size=5),
    ),
)  # fmt: skip
SENSOR = few(
    period=SENSIBLE, latency=SENSIBLE, dropout=some.floats(0, 1), noise=SENSIBLE, velocity_noise=SENSIBLE, agility=SENSIBLE,
    velocity=some.sampled_from(["exact", "estimated", "none"]), occlusion=some.booleans(),
)  # fmt: skip
OBSTACLE = some.tuples(MOTIONS, SENSIBLE).map(lambda pair: {**pair[0], "radius": pair[1]})
SCENARIO = some.fixed_dictionaries(
    {
        "start": mostly(some.just([2.5, 2.5]), xy),
        "goal": mostly(some.just([17.5, 17.5]), xy),
        "obstacles": some.lists(OBSTACLE, max_size=3),
    },
    optional={
        "robot": ROBOT, "sensor": SENSOR, "goal_tolerance": SENSIBLE, "obstacle_speed": SENSIBLE, "obstacle_surge": SENSIBLE,
        "obstacle_swerve": SENSIBLE, "horizon": SENSIBLE, "seed": some.integers(0, 2**63 - 1),
        "stops": some.lists(few(at=xy, service=SENSIBLE), max_size=2),
    },
)  # fmt: skip


def tracks(n: int) -> some.SearchStrategy[dict[str, Any]]:
    """Tracks of n obstacles, flat."""
    return some.fixed_dictionaries(
        {
            "id": some.lists(whole, min_size=n, max_size=n),
            "xy": some.lists(PLACE, min_size=2 * n, max_size=2 * n),
            "velocity": some.lists(SENSIBLE, min_size=2 * n, max_size=2 * n),
            "radius": some.lists(SENSIBLE, min_size=n, max_size=n),
        }
    )


TRACKS = some.integers(0, 4).flatmap(tracks)


OWN = {
    "t": mostly(some.floats(0, 10)), "xy": mostly(some.just([2.0, 2.0]), xy),
    "velocity": mostly(some.just([0.5, 0.0]), some.tuples(absurd, absurd).map(list)), "heading": mostly(some.floats(-3, 3)),
    "stamp": mostly(some.just(math.nan), some.one_of(some.just(-math.inf), absurd)), "turn_rate": mostly(some.just(0.0)),
}  # fmt: skip
SEEN = some.fixed_dictionaries(OWN | {"tracks": TRACKS})
SCAN = some.fixed_dictionaries(
    {
        "angle_min": mostly(some.floats(-3, 3)), "angle_increment": mostly(some.floats(0.01, 0.5)),
        "range_min": mostly(some.just(0.05)), "range_max": mostly(some.just(12.0)),
        "ranges": some.lists(
            mostly(some.floats(0.1, 6.0), some.one_of(absurd, some.sampled_from([math.nan, math.inf, -math.inf]))), max_size=12
        ),
    }
)  # fmt: skip
ODOMETRY = some.tuples(*(mostly(some.just(float(v))) for v in (2, 2, 0, 0, 0, 0))).map(list)
MESSAGE = some.fixed_dictionaries({"tracks": TRACKS, "scan": SCAN, "odometry": ODOMETRY})
REQUEST = some.one_of(
    some.fixed_dictionaries(
        {
            "op": some.just("set"),
            "field": some.sampled_from(["robot.radius", "robot.v_max", "horizon", "seed"]),
            "value": absurd,
        }
    ),
    some.fixed_dictionaries({"op": some.just("move"), "end": some.sampled_from(["start", "goal"]), "xy": xy}),
    some.fixed_dictionaries(
        {"op": some.just("drop"), "xy": xy, "velocity": some.tuples(SENSIBLE, SENSIBLE).map(list), "radius": SENSIBLE}
    ),
    some.fixed_dictionaries(
        {"op": some.just("drop"), "points": some.lists(xy, max_size=3), "speed": SENSIBLE, "radius": SENSIBLE}
    ),
    some.fixed_dictionaries(
        {
            "op": some.just("paint"),
            "blocked": some.booleans(),
            "runs": some.lists(some.tuples(whole, whole, whole).map(list), max_size=3),
        }
    ),
    some.fixed_dictionaries({"op": some.just("stop"), "xy": xy}),
    some.fixed_dictionaries({"op": some.just("speed"), "speed": absurd}),
    some.fixed_dictionaries({"op": some.just("remove"), "obstacle": whole}),
    some.fixed_dictionaries({"op": some.sampled_from(["undo", "redo", "step", "ants", "reset"])}),
)
KINDS = {
    "scenario": {"scenario": SCENARIO, "policy": some.sampled_from(["antway", "antway", "follow", "paper"])},
    "observation": {
        "robot": some.sampled_from(["holonomic", "inertia", "diff"]), "mode": some.sampled_from(["strict", "least-harm"]),
        "task": few(obstacle_speed=SENSIBLE, obstacle_surge=SENSIBLE, obstacle_swerve=SENSIBLE),
        "seen": some.lists(SEEN, min_size=1, max_size=3), "command": some.tuples(SENSIBLE, SENSIBLE).map(list),
    },
    "message": {
        "drive": some.sampled_from(["holonomic", "differential"]), "messages": some.lists(MESSAGE, min_size=1, max_size=2),
    },
    "page": {"requests": some.lists(REQUEST, min_size=1, max_size=4)},
}  # fmt: skip


class Player:
    """The process that plays cases; a new one where it ends."""

    process: subprocess.Popen[str] | None = None

    def play(self, case: dict[str, Any]) -> tuple[str, float, float]:
        """Return what came of a case, its seconds and its MiB."""
        if self.process is None or self.process.poll() is not None:
            self.close()
            command = [sys.executable, str(Path(__file__).with_name("absurd.py"))]
            self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1)
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps(case) + "\n")
        if not select.select([self.process.stdout], [], [], PATIENCE)[0]:
            self.close()
            return "hangs", PATIENCE, 0.0
        line = self.process.stdout.readline()
        if not line:
            return f"ends the process with status {self.process.wait()}", 0.0, 0.0
        what, seconds, size = json.loads(line)
        return what, seconds, size

    def close(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()


@pytest.fixture(scope="module")
def player() -> Iterator[Player]:
    made = Player()
    yield made
    made.close()


@pytest.mark.timeout(36_000)
@pytest.mark.parametrize("kind", KINDS)
def test_absurd_cases_are_refused_or_played(kind: str, player: Player) -> None:
    """No crash, no hang, no error that is not typed, no case over its time and memory; and enough of them are played."""
    count: dict[str, int] = {"ok": 0, "refused": 0}

    @settings(
        max_examples=costly(500, 5000), deadline=None, database=None, derandomize=True,
        suppress_health_check=list(HealthCheck), print_blob=False,
    )  # fmt: skip
    @given(some.fixed_dictionaries({"kind": some.just(kind), **KINDS[kind]}))
    def attempt(case: dict[str, Any]) -> None:
        what, seconds, size = player.play(case)
        assert what in count, what
        assert seconds <= SECONDS and size <= MEBIBYTES, (seconds, size)
        count[what] += 1

    attempt()
    print(f"{kind}: {count}")
    assert count["ok"] >= 0.05 * sum(count.values()), count
