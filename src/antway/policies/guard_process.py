"""A guard in its own process, between planner and robot, which brakes when the planner hangs, crashes or is killed.

Three sides share a file in memory, similar to Nav2's collision monitor. The robot side writes observations, and the planner
side writes the commands that it requests. The guard process answers each observation with the command that passes: the
planner's or, if none comes in time, the next command of the certified stop. The guard also brakes if observations cease,
because one process reads the sensors and plans. If that process has ended, the guard stops the robot and ends.

Examples
--------
A robot's side, with a planner that never answers; one that does is any process that calls `plan_for(guard.folder, policy)`.

>>> from antway import Grid, RobotSpec
>>> task = Task(Grid(np.zeros((20, 20), bool)), RobotSpec(), (5.0, 5.0), (15.0, 5.0))
>>> with GuardProcess(task) as guard:
...     number = guard.observe(Observation(0.0, (5.0, 5.0), (1.0, 0.0), 0.0, Tracks.none()))
...     guard.answer(number).command
Command(velocity=(0.0, 0.0), twist=None)
"""

from __future__ import annotations

import contextlib
import math
import os
import pickle
import select
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from antway import checks
from antway.errors import BadInput, BadParameter
from antway.policies.guard import Guard, longest_stop
from antway.policies.guard_memory import SIDES, SIZE, GuardAnswer, Link
from antway.processes import spare_collections
from antway.world.policy import Command, Observation, Policy, Task, Tracks

SILENT = "silent"
ALIVE = "running; start another one (the ROS 2 node does at its next configure)"
_LOOK = 1e-3  # s; period at which the guard looks for the planner's command; waking it would cost the planner 10 us
_TIMEOUT = 2.0  # s; time for the guard process to end, in which it releases the motors
_START = 300.0  # s; time for it to be ready for a new robot, for which it may have to compile
_READY = 5.0  # s; time for it to be ready for another task of the same robot
Driver = Callable[[Command, Observation], None]  # sends a passed command, which answers an observation, to the motors


class GuardProcess:
    """Starts the guard process, and is the robot side of it.

    Parameters
    ----------
    task : Task
    deadline : float
        Share in (0, 1] of the control period within which the planner must answer an observation.
    slack : float
        How much more than a control period may pass between two observations before the guard brakes, s, >= 0.
    emit : callable or None
        Opens a driver of motors. It is called once in the guard process, without arguments; the result is called with each
        passed command and its observation. It is pickled, so it must be a function of a module, or a `functools.partial`.
    guard : of `Guard`
        Options: mode, timeout, hold, lookahead.

    Raises
    ------
    BadParameter

    Notes
    -----
    The process requests a higher priority if it is allowed to. It ends with this object, or with the process that started it
    once the robot stands.
    """

    def __init__(
        self, task: Task, *, deadline: float = 0.7, slack: float = 0.0, emit: Callable[[], Driver] | None = None, **guard: Any
    ) -> None:
        checks.instance("task", task, Task)
        self.deadline = checks.number("deadline", deadline, low=0.0, high=1.0, open_low=True)
        self.slack = checks.number("slack", slack, low=0.0, unit="s")
        usable = emit is None or callable(emit)
        try:
            pickle.dumps(emit)
        except (AttributeError, TypeError, pickle.PicklingError):
            usable = False
        if not usable:
            raise BadParameter("emit", emit, "a function of a module, which can be pickled, or None")
        Guard(**guard)  # raises errors of its options here
        shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
        self.folder = tempfile.mkdtemp(prefix="antway-", dir=shared)
        with contextlib.ExitStack() as undo:
            undo.callback(shutil.rmtree, self.folder, ignore_errors=True)
            (Path(self.folder) / "memory").write_bytes(bytes(SIZE))
            for side in SIDES:
                os.mkfifo(f"{self.folder}/{side}")
            self.link, self.number = Link(self.folder, "robot"), 0
            undo.callback(self.link.close)
            command = [sys.executable, "-c", "from antway.policies.guard_process import main; main()"]
            self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
            undo.callback(self.close)
            self._tell((self.folder, self.deadline, self.slack, emit, guard, os.getpid()))
            self._reset(task, _START)
            undo.pop_all()

    def _tell(self, what: object) -> None:
        assert self.process.stdin is not None
        pickle.dump(what, self.process.stdin)
        self.process.stdin.flush()

    def reset(self, task: Task) -> None:
        """Start a new drive, and return when the guard is ready; the numbers of observations continue.

        Raises
        ------
        BadParameter
            If the process has ended, or is not ready within 5 s (300 s for a new robot); it is killed then. The robot needs
            another `GuardProcess` in either case. For what is no task the process goes on as before.
        """
        checks.instance("task", task, Task)
        self._reset(task, _READY if task.robot == self.task.robot else _START)

    def _reset(self, task: Task, seconds: float) -> None:
        assert self.process.stdout is not None
        if not self.alive:
            raise BadParameter("the guard's process", "ended", ALIVE)
        self.task, killer = task, threading.Timer(seconds, self.process.kill)
        killer.start()
        try:
            with contextlib.suppress(BrokenPipeError):  # a process that has ended is not ready
                self._tell(task)
            self.link.ring("guard")
            ready = self.process.stdout.readline()
        finally:
            killer.cancel()
        if not ready:
            allowed = f"such that the guard's process takes it up within {seconds:g} s; that process has ended now"
            raise BadParameter("task", task, allowed)

    @property
    def alive(self) -> bool:
        """Whether the process runs."""
        return self.process.poll() is None

    def observe(self, o: Observation) -> int:
        """Write an observation for guard and planner; return its number."""
        checks.instance("observation", o, Observation)
        self.link.observe(self.number + 1, o)
        self.number += 1
        self.link.ring("guard", "planner")
        return self.number

    def answer(self, number: int) -> GuardAnswer:
        """Return the answer, at the latest one control period from now; if the guard is silent or has ended, it is a stop."""
        until = time.monotonic() + self.task.robot.dt
        while True:
            found = self.link.replied(number)
            if found is not None:
                return found
            if time.monotonic() >= until or not self.alive:
                return GuardAnswer(number, standing(self.task), SILENT)
            self.link.wait(until)

    def limit(self, number: int, command: Command | None) -> GuardAnswer:
        """Return the guard's answer to a command that a planner in this process requests for that observation."""
        if command is not None:
            checks.instance("command", command, Command)
        self.link.ask(number, command)
        self.link.ring("guard")
        return self.answer(number)

    def rest(self, number: int) -> None:
        """Let the guard rest until the next observation; that of this number was the last before the robot stands."""
        self.limit(number, None)
        self.link.views["rest"][0] = number
        self.link.ring("guard")

    def close(self) -> None:
        """End the process, unless that has been done."""
        if not self.link.views:
            return
        self.link.views["rest"][0] = self.number
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(_TIMEOUT)
        self.process.kill()
        self.process.wait()
        self.link.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def standing(task: Task) -> Command:
    """Return the command to stand, which takes effect at once."""
    return Command((0.0, 0.0), (0.0, 0.0) if task.robot.wheels and not task.robot.stepwise else None)


def plan_for(folder: str, policy: Policy) -> None:
    """Let `policy`, which has been reset, answer observations as long as the guard's folder exists.

    Raises
    ------
    BadParameter
        For a folder that is not there or no guard's.
    """
    try:
        link = Link(folder, "planner")
    except (OSError, TypeError, ValueError):
        raise BadParameter("folder", folder, "that of a `GuardProcess` which runs") from None
    number = 0
    with contextlib.closing(link):
        while os.path.exists(folder):
            found = link.observed(number)
            if found is None:
                link.wait(time.monotonic() + 0.5)
                continue
            number, observation = found
            link.ask(number, policy.act(observation))


class _Server:
    """The guard process."""

    def __init__(
        self, folder: str, deadline: float, slack: float, emit: Callable[[], Driver] | None, options: dict[str, Any], maker: int
    ) -> None:
        self.link, self.guard, self.deadline, self.slack = Link(folder, "guard"), Guard(**options), deadline, slack
        self.link.poll.register(0, select.POLLIN)
        self.emit, self.maker = None if emit is None else emit(), maker
        self.number, self.due = 0, 0.0  # number of the last observation, and when the next one is due
        self.seen: Observation | None = None  # the last observation; None while the robot rests
        self.task: Task | None = None
        self.moves = False  # whether the last command that was emitted is not that to stand

    def reset(self, task: Task) -> None:
        """Start a task, and compile everything that answers need."""
        self.rest()
        self.guard.reset(task)
        one = Tracks(np.zeros(1, np.int64), np.array([task.start]), np.zeros((1, 2)), np.full(1, 0.1))
        heading = math.atan2(task.goal[1] - task.start[1], task.goal[0] - task.start[0])
        self.guard.limit(Observation(0.0, task.start, (0.0, 0.0), heading, one), Command((0.1, 0.0)))
        self.guard.reset(task)
        self.task, self.seen = task, None
        found = self.link.observed(self.number)
        self.number = self.number if found is None else found[0]

    def turn(self, task: Task) -> None:
        """Answer the next observation, or brake if none comes."""
        found = self.link.observed(self.number)
        if found is not None:
            self.answer(task, *found)
        elif self.seen is None or self.link.views["rest"][0] == self.number:
            self.rest()
            self.link.wait(time.monotonic() + 1.0)
        elif time.monotonic() < self.due + self.slack:
            self.link.wait(self.due + self.slack)
        else:
            self.brake(task)

    def answer(self, task: Task, number: int, seen: Observation) -> None:
        """Wait for the planner's command until its deadline, and send what passes."""
        now = time.monotonic()
        until, self.due = now + self.deadline * task.robot.dt, now + task.robot.dt
        self.number, self.seen = number, seen
        done, command = self.link.asked(number)
        while not done and time.monotonic() < until:
            called = self.link.wait(min(until, time.monotonic() + _LOOK))
            done, command = self.link.asked(number)
            if called:  # by the robot side, because the task is over or that side has ended
                break
        try:
            passed = self.guard.limit(seen, command)
        except BadInput:  # an invalid observation: brake, and so from now on, until a valid one comes
            self.seen = replace(seen, stamp=-math.inf, velocity=(0.0, 0.0), heading=0.0)
            passed = self.guard.passed(self.seen, None)
        self.give(passed)

    def brake(self, task: Task) -> None:
        """Send the next command of the stop, because an observation is missing."""
        assert self.seen is not None
        self.due += task.robot.dt
        self.seen = replace(self.seen, t=self.seen.t + task.robot.dt)
        self.give(self.guard.passed(self.seen, None))

    def leave(self) -> None:
        """Stop the robot, if it drives, because the parent process has ended."""
        if self.task is None or self.seen is None or self.link.views["rest"][0] == self.number:
            return
        robot = self.task.robot
        for _ in range(math.ceil((longest_stop(robot, self.seen.velocity) + robot.latency) / robot.dt) + 2):
            self.brake(self.task)
            time.sleep(robot.dt)

    def rest(self) -> None:
        """Send no more commands until the next observation; the last one is to stand, even if this process hung before."""
        seen, self.seen = self.seen, None
        if seen is not None and self.task is not None and self.moves:
            self.send(standing(self.task), seen)

    def give(self, passed: Command) -> None:
        """Send a passed command, and then tell the robot side, which may tell the robot to stand as soon as it knows."""
        assert self.seen is not None
        self.send(passed, self.seen)
        self.link.reply(self.number, passed, self.guard.did)
        self.link.ring("robot")

    def send(self, command: Command, seen: Observation) -> None:
        """Send a command to the motors."""
        self.moves = any(command.velocity) or any(command.twist or ())
        if self.emit is not None:
            self.emit(command, seen)


def main() -> None:
    """Run the guard process: settings and tasks come on stdin, and "ready" is written for each task."""
    with contextlib.suppress(OSError):
        os.nice(-10)
    incoming, out = open(0, "rb", closefd=False), os.dup(1)  # noqa: SIM115 - for as long as the process lives
    os.dup2(2, 1)  # other output must not mix with answers
    server = _Server(*pickle.load(incoming))
    while os.getppid() == server.maker:
        if server.task is not None and not select.select([incoming], [], [], 0.0)[0]:
            server.turn(server.task)
        elif incoming.peek(1):
            server.reset(pickle.load(incoming))
            spare_collections()
            os.write(out, b"ready\n")
        else:
            break
    server.leave()
    shutil.rmtree(server.link.folder, ignore_errors=True)
