"""The guard outlives the planner: whatever becomes of that, the robot brakes within one control period."""

from __future__ import annotations

import os
import subprocess
import sys
import time

import numpy as np
import pytest

from antway import BadInput, Command, Grid, Observation, Outcome, RobotSpec, Task, Tracks
from antway.policies.guard import Guard
from antway.policies.guard_process import MAX_TRACKS, GuardProcess, Link
from common import cases
from guard_drives import PERIOD, drives

pytestmark = pytest.mark.skipif(not hasattr(os, "fork") or sys.platform == "win32", reason="needs sockets of Unix")
TASK = Task(Grid(np.zeros((40, 40), bool), 0.25), RobotSpec(dt=PERIOD), (5.0, 5.0), (9.0, 5.0))


def seen(t: float, *places: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> Observation:
    n = len(places)
    tracks = Tracks(np.arange(n), np.reshape(places, (n, 2)), np.zeros((n, 2)), np.full(n, 0.3))
    return Observation(t, (5.0, 5.0), velocity, 0.0, tracks)


def test_a_planner_that_is_killed_or_stopped_yields_braking_within_one_period() -> None:
    """In every drive: each answer comes within a period, after the planner's end all of them brake, and nothing is touched."""
    count, ends = cases(3, 200), []
    for drive in drives(count, seed=1):
        ends.append(drive.how)
        reached = drive.outcome is Outcome.REACHED and not drive.after
        assert reached or set(drive.did) == {"braked"}, drive
        assert drive.outcome in (None, Outcome.REACHED, Outcome.HIT_STANDING), "no contact in motion, and none with a wall"
        assert drive.outcome is not None or drive.speed < 1e-6
        assert len(drive.before) > 2 and "silent" not in drive.did
    assert len(ends) == count


@pytest.fixture(scope="module")
def process():
    with GuardProcess(TASK, mode="strict") as made:
        yield made


def test_the_answer_is_the_guards(process: GuardProcess) -> None:
    """What passes is what the same guard in this process lets pass, whether the planner asks in time or not at all."""
    process.reset(TASK)
    link, here = Link(process.folder, "planner"), Guard(mode="strict")
    here.reset(TASK)
    wishes = [Command((1.0, 0.0)), Command((0.3, 0.4)), Command((5.0, 0.0)), None, Command((float("nan"), 0.0))]
    for k, wish in enumerate(wishes):
        o = seen(PERIOD * k, (5.9, 5.0), (5.0, 7.0))
        number = process.observe(o)
        assert link.observed(number - 1)[0] == number
        link.ask(number - 1, Command((0.9, 0.9)))  # too late, and for another one
        link.ask(number, wish)
        link.ring("guard")
        answer = process.answer(number)
        assert answer.command == here.limit(o, wish) and answer.did == here.did
    link.close()


def test_observations_come_over_as_they_are(process: GuardProcess) -> None:
    """Every number, covariances and commands under way among them."""
    process.reset(TASK)
    rng, n = np.random.default_rng(3), MAX_TRACKS
    tracks = Tracks(rng.integers(-1, 2**62, n), *(rng.normal(size=(n, 2)) for _ in "ab"), rng.random(n), rng.random((n, 4, 4)))
    o = Observation(1.0, (2.0, 3.0), (0.1, 0.2), 0.5, tracks, 0.9, 0.3, rng.normal(size=(3, 2)))
    link = Link(process.folder, "planner")
    number = process.observe(o)
    _, there = link.observed(number - 1)
    for name in ("t", "xy", "velocity", "heading", "stamp", "turn_rate"):
        assert getattr(there, name) == getattr(o, name)
    for name in ("id", "xy", "velocity", "radius", "covariance"):
        np.testing.assert_array_equal(getattr(there.tracks, name), getattr(tracks, name))
    np.testing.assert_array_equal(there.pending, o.pending)
    process.link.views["observation"][0] = -1.0  # as while it is written
    assert link.observed(number - 1) is None
    link.close()
    many = np.zeros((n + 1, 2))
    with pytest.raises(BadInput):
        process.observe(Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, Tracks(np.arange(n + 1), many, many, np.ones(n + 1))))


def test_an_observation_that_makes_no_sense_brakes(process: GuardProcess) -> None:
    """The guard's process lives on, and stands."""
    process.reset(TASK)
    answer = process.answer(process.observe(seen(0.0, (float("nan"), 1.0))))
    assert answer.did == "braked" and answer.command == Command((0.0, 0.0))
    assert process.process.poll() is None


def test_without_observations_it_brakes_too(process: GuardProcess) -> None:
    """One process that senses and plans, and hangs: a stop is handed on within one period of the last observation's."""
    process.reset(TASK)
    link = Link(process.folder, "planner")
    number = process.observe(seen(0.0, velocity=(1.0, 0.0)))
    link.ask(number, Command((1.0, 0.0)))
    link.ring("guard")
    assert process.answer(number).command == Command((1.0, 0.0))
    until = time.monotonic() + 30.0
    while process.link.replied(number).did == "free" and time.monotonic() < until:
        time.sleep(0.01)
    assert process.link.replied(number).command == Command((0.0, 0.0))
    link.close()


def test_a_guard_that_is_gone_means_stop() -> None:
    """If the guard's own process is killed, the robot's side stops the robot itself."""
    with GuardProcess(TASK) as process:
        process.process.kill()
        process.process.wait()
        answer = process.answer(process.observe(seen(0.0)))
        assert answer.did == "silent" and answer.command == Command((0.0, 0.0))
        folder = process.folder
    assert not os.path.exists(folder)


def test_the_guard_ends_with_the_process_that_made_it() -> None:
    """A robot's side that is killed leaves no process behind."""
    program = (
        "import numpy as np, os\nfrom antway import Grid, RobotSpec, Task\n"
        "from antway.policies.guard_process import GuardProcess\n"
        "task = Task(Grid(np.zeros((9, 9), bool)), RobotSpec(), (2.0, 2.0), (6.0, 6.0))\n"
        "guard = GuardProcess(task)\nprint(guard.process.pid, flush=True)\nos.kill(os.getpid(), 9)\n"
    )
    done = subprocess.run([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True)
    pid, until = int(done.stdout), time.monotonic() + 30.0
    while os.path.exists(f"/proc/{pid}") and time.monotonic() < until:
        time.sleep(0.05)
    assert not os.path.exists(f"/proc/{pid}")


@pytest.mark.parametrize("wrong", [{"deadline": 0.0}, {"deadline": 2.0}, {"emit": 3}, {"mode": "x"}, {"task": None}])
def test_wrong_settings_raise(wrong: dict) -> None:
    """They are refused before a process starts, or end it."""
    with pytest.raises(BadInput):
        GuardProcess(**{"task": TASK} | wrong)
