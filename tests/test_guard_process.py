"""The guard outlives the planner: whatever becomes of that, the robot brakes within one control period."""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from antway import BadInput, BadParameter, Command, Grid, Observation, Outcome, RobotSpec, Task, Tracks, make_policy
from antway.policies import guard_process
from antway.policies.guard import Guard
from antway.policies.guard_memory import MAX_TRACKS, SIDES, SIZE, Link
from antway.policies.guard_process import GuardProcess, plan_for
from common import cases
from guard_drives import PERIOD, drives

TASK = Task(Grid(np.zeros((40, 40), bool), 0.25), RobotSpec(dt=PERIOD), (5.0, 5.0), (9.0, 5.0))


def seen(t: float, *places: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0)) -> Observation:
    n = len(places)
    tracks = Tracks(np.arange(n), np.reshape(places, (n, 2)), np.zeros((n, 2)), np.full(n, 0.3))
    return Observation(t, (5.0, 5.0), velocity, 0.0, tracks)


def test_a_planner_that_is_killed_or_stopped_yields_braking_within_one_period() -> None:
    """In every drive: each answer comes within a period, after the planner's end all of them brake, and nothing is touched.

    A busy machine may once keep the guard's process from its answer: then the robot's own side brakes.
    """
    count, ends = cases(3, 200), []
    for drive in drives(count, seed=1):
        ends.append(drive.how)
        reached = drive.outcome is Outcome.REACHED and not drive.after
        assert reached or (set(drive.did) <= {"braked", "silent"} and drive.did.count("silent") <= 1), drive
        assert drive.outcome in (None, Outcome.REACHED, Outcome.HIT_STANDING), "no contact in motion, and none with a wall"
        assert drive.outcome is not None or drive.speed < 1e-6
        assert len(drive.before) > 2
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
    wishes += [
        Command((0.3, 0.4), (0.5, 0.0)),
        Command((0.3, 0.4), (float("nan"), 0.0)),
        Command((float("nan"), 0.0), (0.5, 0.0)),
    ]
    for k, wish in enumerate(wishes):
        o = seen(PERIOD * k, (5.9, 5.0), (5.0, 7.0))
        number = process.observe(o)
        assert link.observed(number - 1)[0] == number
        link.ask(number - 1, Command((0.9, 0.9)))  # too late, and for another one
        link.ask(number, wish)
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
    many, before = np.zeros((n + 1, 2)), process.link.views["observation"].tolist()
    wrong = [replace(o, tracks=Tracks(np.arange(n + 1), many, many, np.ones(n + 1))), replace(o, pending=np.zeros((2, 3)))]
    wrong += [replace(o, tracks=replace(tracks, covariance=tracks.covariance[:1]))]
    for one in wrong:  # what is refused is not written, and has no number
        with pytest.raises(BadInput):
            process.observe(one)
    assert process.link.views["observation"].tolist() == before and process.number == number


def test_an_observation_that_makes_no_sense_brakes(process: GuardProcess) -> None:
    """The guard's process lives on, and stands."""
    process.reset(TASK)
    answer = process.answer(process.observe(seen(0.0, (float("nan"), 1.0))))
    assert answer.did == "braked" and answer.command == Command((0.0, 0.0))
    assert process.process.poll() is None


@pytest.mark.parametrize("wrong", [{"heading": math.nan}, {"velocity": (math.nan, 0.0)}])
def test_after_an_observation_that_makes_no_sense_it_brakes_with_numbers(tmp_path: Path, wrong: dict) -> None:
    """Such as a heading that is not a number, after which no observation comes and the process that senses ends.

    The command used to be (nan, nan), and the process ended without a stop if it was the speed.
    """
    (tmp_path / "memory").write_bytes(bytes(SIZE))
    for side in SIDES:
        os.mkfifo(tmp_path / side)
    robot, sent = RobotSpec(dt=1e-3, a_max=5.0, drive="differential"), []
    task = replace(TASK, robot=robot)
    server = guard_process._Server(str(tmp_path), 0.7, 0.0, lambda: lambda command, _: sent.append(command), {}, os.getpid())
    server.reset(task)
    server.answer(task, 1, replace(seen(0.0, velocity=(0.5, 0.0)), **wrong))
    server.brake(task)
    server.leave()
    assert len(sent) > 0.5 / robot.a_max / robot.dt and set(sent) == {Command((0.0, 0.0), (0.0, 0.0))}
    server.link.close()


def test_without_observations_it_brakes_too(process: GuardProcess) -> None:
    """One process that senses and plans, and hangs: a stop is handed on within one period of the last observation's."""
    process.reset(TASK)
    link = Link(process.folder, "planner")
    number = process.observe(seen(0.0, velocity=(1.0, 0.0)))
    link.ask(number, Command((1.0, 0.0)))
    assert process.answer(number).command == Command((1.0, 0.0))
    until = time.monotonic() + 30.0
    while process.link.replied(number).did == "free" and time.monotonic() < until:
        time.sleep(0.01)
    assert process.link.replied(number).command == Command((0.0, 0.0))
    link.close()


def test_an_interrupt_leaves_no_timer_and_a_guard_that_is_gone_means_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C while a guard gets ready ends at once, and not after the time that it has for that.

    If the guard's own process is killed, the robot's side stops the robot itself. It may be closed twice, as by a node that
    fails while it is taken down, and is taken down again.
    """

    def interrupted(*_: str) -> None:
        raise KeyboardInterrupt

    with GuardProcess(TASK) as process:
        with monkeypatch.context() as patch:
            patch.setattr(process.link, "ring", interrupted)
            with pytest.raises(KeyboardInterrupt):
                process.reset(TASK)
        timers = [thread for thread in threading.enumerate() if isinstance(thread, threading.Timer)]
        assert all(timer.finished.is_set() for timer in timers), "the interpreter would wait for it"
        process.process.kill()
        process.process.wait()
        started = time.monotonic()
        answers = [process.answer(process.observe(seen(PERIOD * k))) for k in range(100)]
        assert {answer.did for answer in answers} == {"silent"} and answers[0].command == Command((0.0, 0.0))
        assert time.monotonic() - started < 20 * PERIOD, "nobody waits for it"
        folder = process.folder
    assert not os.path.exists(folder)
    process.close()
    with pytest.raises(BadInput, match=r"the guard's process = 'ended': must be running; start another one"):
        process.reset(TASK)


def test_a_guard_that_hangs_is_told_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is stopped does not hold up who gives it a task, however large that is; it is killed."""
    monkeypatch.setattr(guard_process, "_READY", 0.1)
    with GuardProcess(TASK) as process:
        os.kill(process.process.pid, signal.SIGSTOP)
        with pytest.raises(BadInput, match=r"takes it up within 0\.1 s"):
            process.reset(Task(Grid(np.zeros((600, 600), bool), 0.25), TASK.robot, TASK.start, TASK.goal))
        assert process.process.wait(10.0) == -signal.SIGKILL


def told(path: str):
    """A driver of motors that writes what it is told, and when, into a file."""

    def drive(command: Command, seen: Observation) -> None:
        with open(path, "a") as file:
            file.write(json.dumps([time.monotonic(), seen.t, *(command.twist or command.velocity)]) + "\n")

    return drive


def slowly_told(path: str):
    """A driver of motors like `told`, which takes a while."""
    drive = told(path)
    return lambda command, seen: (time.sleep(PERIOD / 3), drive(command, seen))


@pytest.mark.parametrize("drive", ["holonomic", "inertia"])
def test_the_guard_stops_the_robot_of_a_process_that_is_killed_and_ends(drive: str, tmp_path: Path) -> None:
    """Who senses and plans is killed in the drive: the guard brakes at once, to a stand, and leaves nothing behind."""
    program = (
        "import json, os, time\nfrom functools import partial\n"
        "from antway import Command, Observation, Task, Tracks\nfrom antway.policies.guard_process import GuardProcess\n"
        "from guard_drives import ROBOTS\nfrom test_guard_process import TASK, told\n"
        f"task = Task(TASK.grid, ROBOTS[{drive!r}], TASK.start, TASK.goal)\n"
        f"guard = GuardProcess(task, slack=0.1, emit=partial(told, {str(tmp_path / 'told')!r}))\n"
        "number = guard.observe(Observation(1.0, (5.0, 5.0), (1.0, 0.0), 0.0, Tracks.none()))\n"
        "assert guard.limit(number, Command((1.0, 0.0))).did == 'free'\n"
        "print(json.dumps([guard.process.pid, guard.folder, time.monotonic()]), flush=True)\nos.kill(os.getpid(), 9)\n"
    )
    paths = os.pathsep.join([str(Path(__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])])
    done = subprocess.run(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env=os.environ | {"PYTHONPATH": paths}
    )
    (pid, folder, killed), until = json.loads(done.stdout), time.monotonic() + 30.0
    while os.path.exists(f"/proc/{pid}") and time.monotonic() < until:
        time.sleep(0.05)
    assert not os.path.exists(f"/proc/{pid}") and not os.path.exists(folder)
    sent = [json.loads(line) for line in (tmp_path / "told").read_text().splitlines()]
    speeds = [abs(one[2]) for one in sent]
    assert sent[0][1:] == [1.0, 1.0, 0.0] and speeds[1] < 1.0 and speeds[-1] == 0.0
    assert all(b <= a for a, b in pairwise(speeds)) and sent[1][0] - killed < PERIOD
    assert np.allclose(np.diff([one[1] for one in sent]), PERIOD)


def test_a_guard_rests_when_it_is_told_to(process: GuardProcess) -> None:
    """It does not brake on while the robot is told to stand by others, and answers the next observation."""
    process.reset(TASK)
    number = process.observe(seen(0.0, velocity=(1.0, 0.0)))
    assert process.limit(number, Command((1.0, 0.0))).did == "free"
    process.rest(number)
    before = process.link.views["answer"].tolist()  # with the time of the answer
    time.sleep(3 * PERIOD)
    assert process.link.views["answer"].tolist() == before
    assert process.limit(process.observe(seen(1.0)), Command((0.5, 0.0))).did == "free"


@pytest.fixture
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the guard's process import this file, for the drivers in it."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(path for path in sys.path if path))


@pytest.mark.usefixtures("importable")
def test_a_guard_that_hung_leaves_the_robot_standing(tmp_path: Path) -> None:
    """What it still emits when it goes on, after it was told to rest, is followed by the command to stand.

    The robot side tells the robot to stand in the meantime, and then says nothing more: a late command would drive on for ever.
    A command is sent before it is told of: who learns of it may tell the robot to stand, which may not come first.
    """
    told_to = tmp_path / "told"
    with GuardProcess(TASK, slack=0.1, emit=partial(slowly_told, str(told_to))) as process:
        number = process.observe(seen(0.0, velocity=(1.0, 0.0)))
        assert process.limit(number, Command((1.0, 0.0))).did == "free" and told_to.exists()
        os.kill(process.process.pid, signal.SIGSTOP)
        process.link.ask(number + 1, Command((1.0, 0.0)))
        number = process.observe(seen(PERIOD, velocity=(1.0, 0.0)))
        assert process.answer(number).did == "silent"
        process.link.views["rest"][0] = number
        process.link.ring("guard")
        os.kill(process.process.pid, signal.SIGCONT)
        until, speeds = time.monotonic() + 30.0, [1.0]
        while speeds[-1] != 0.0 and time.monotonic() < until:
            time.sleep(0.01)
            speeds = [json.loads(line)[2] for line in told_to.read_text().splitlines() if line.endswith("]")]
        assert speeds == [1.0, 1.0, 0.0]


@pytest.mark.parametrize(
    "wrong",
    [{"deadline": 0.0}, {"deadline": 2.0}, {"slack": -1.0}, {"emit": 3}, {"emit": lambda: None}, {"mode": "x"}, {"task": None}],
)
def test_wrong_settings_raise(wrong: dict) -> None:
    """They are refused before a process starts, or end it."""
    with pytest.raises(BadInput):
        GuardProcess(**{"task": TASK} | wrong)


def test_what_is_no_task_is_refused_and_the_guard_goes_on(process: GuardProcess) -> None:
    """It was an AttributeError; so it was for what is no observation or no command."""
    for wrong, name in ((process.reset, "task"), (process.observe, "observation"), (partial(process.limit, 0), "command")):
        with pytest.raises(BadParameter, match=name):
            wrong(3)  # type: ignore[operator]
    process.reset(TASK)
    assert process.alive


@pytest.mark.parametrize("folder", ["none", ".", "", "\0", 3, None])
def test_a_planner_without_its_guard_is_told_so(folder: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Such as one that starts after the guard has ended: it was a FileNotFoundError."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "memory").write_bytes(b"other")
    with pytest.raises(BadParameter, match="which runs"):
        plan_for(folder, make_policy("follow"))  # type: ignore[arg-type]


def _link(folder: Path) -> Link:
    """Return the robot's side of a memory of its own."""
    (folder / "memory").write_bytes(bytes(SIZE))
    for side in SIDES:
        os.mkfifo(folder / side)
    return Link(str(folder), "robot")


def test_an_answer_that_is_given_anew_while_it_is_read_is_not_mixed(tmp_path: Path) -> None:
    """The guard answers the same number again while it brakes; half of the one answer with half of the other is none."""
    robot, guard = _link(tmp_path), Link(str(tmp_path), "guard")
    guard.reply(7, Command(twist=(1.0, 0.5)), "free")
    record = robot.views["answer"]

    class Torn:
        def tolist(self) -> list[float]:
            first = [record[i].item() for i in range(5)]
            guard.reply(7, Command(twist=(0.0, -1.0)), "braked")
            return first + [record[i].item() for i in range(5, len(record))]

    robot.views["answer"] = Torn()
    assert robot.replied(7) is None or robot.replied(7).command.twist == (0.0, -1.0)
    robot.views["answer"] = record
    assert robot.replied(7).command.twist == (0.0, -1.0)
    robot.close()
    guard.close()


def test_nothing_is_left_where_a_guard_cannot_start_or_its_folder_is_gone(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """No folder after a process that does not start, and no open file after a planner whose guard has ended."""
    made: list[str] = []
    real = guard_process.tempfile.mkdtemp
    monkeypatch.setattr(guard_process.tempfile, "mkdtemp", lambda **kind: made.append(real(**kind)) or made[-1])
    monkeypatch.setattr(guard_process.subprocess, "Popen", lambda *_, **__: (_ for _ in ()).throw(OSError("no process")))
    opened = len(os.listdir("/proc/self/fd"))
    with pytest.raises(OSError, match="no process"):
        GuardProcess(TASK)
    assert made and not os.path.exists(made[0])
    folder = tmp_path / "guard"
    folder.mkdir()
    _link(folder).close()
    monkeypatch.setattr(guard_process.os.path, "exists", lambda _: False)
    guard_process.plan_for(str(folder), None)
    assert len(os.listdir("/proc/self/fd")) == opened
