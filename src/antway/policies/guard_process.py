"""A guard in a process of its own, between what plans and the robot: when the planner hangs, crashes or is killed, it brakes.

Three sides share a file in memory. The robot's side writes what is seen; the planner's side writes the command it asks for; the
guard's process answers each observation with the command that passes: the planner's, or, where none comes in time, the next one
of the stop that the guard keeps certified. Nav2's collision monitor is the model. Where observations cease as well, because one
process reads the sensors and plans, the guard brakes all the same.

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
import mmap
import os
import pickle
import select
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from antway import checks
from antway.errors import BadInput, BadParameter, TooLarge
from antway.policies.guard import DID, Guard
from antway.world.policy import Command, Observation, Policy, Task, Tracks

MAX_TRACKS = 1024  # of an observation
_PENDING = 128  # commands on their way to the robot
_OBSERVATION = 13  # numbers of an observation without its tracks
_SILENT = "silent"
_PARTS = {  # what lies in the shared memory: type and shape
    "observation": ("<f8", (_OBSERVATION,)),
    "names": ("<i8", (MAX_TRACKS,)),
    "xy": ("<f8", (MAX_TRACKS, 2)),
    "velocity": ("<f8", (MAX_TRACKS, 2)),
    "radius": ("<f8", (MAX_TRACKS,)),
    "covariance": ("<f8", (MAX_TRACKS, 4, 4)),
    "pending": ("<f8", (_PENDING, 2)),
    "asked": ("<f8", (5,)),
    "answer": ("<f8", (8,)),
}
_TRACKS = ("names", "xy", "velocity", "radius")
_SIZE = sum(math.prod(shape) * 8 for _, shape in _PARTS.values())


@dataclass(frozen=True, slots=True)
class Answer:
    """What the robot is to do.

    Attributes
    ----------
    number : int
        Of the observation that it answers.
    command : Command
    did : str
        What the guard did (`antway.policies.guard.DID`); "silent": the guard's process gave no answer, and the robot brakes.
    """

    number: int
    command: Command
    did: str


class Link:
    """One side's hold on the shared memory; each record has its number at both ends, so that no half of one is ever read."""

    def __init__(self, folder: str, side: str) -> None:
        self.folder, self.side = folder, side
        with open(Path(folder) / "memory", "r+b") as file:
            self.memory = mmap.mmap(file.fileno(), _SIZE)
        at, views = 0, {}
        for name, (kind, shape) in _PARTS.items():
            views[name] = np.frombuffer(self.memory, kind, math.prod(shape), at).reshape(shape)
            at += math.prod(shape) * 8
        self.views: dict[str, Any] = views
        self.bell = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.bell.setblocking(False)
        self.addresses = {other: f"{folder}/{other}" for other in ("robot", "planner", "guard")}
        own = Path(folder) / side
        own.unlink(missing_ok=True)  # of a planner that was there before
        self.bell.bind(str(own))
        self.poll = select.poll()
        self.poll.register(self.bell, select.POLLIN)

    def close(self) -> None:
        """Let go of the memory."""
        self.bell.close()
        self.views.clear()
        with contextlib.suppress(BufferError):
            self.memory.close()

    def ring(self, *sides: str) -> None:
        """Wake other sides that wait; who is not there, or does not listen, is no concern."""
        for side in sides:
            try:  # noqa: SIM105 - in half the time
                self.bell.sendto(b".", self.addresses[side])
            except OSError:
                pass

    def wait(self, until: float) -> None:
        """Return when the bell rings, or at time `until` s of the steady clock."""
        if self.poll.poll(max((until - time.monotonic()) * 1e3, 0.0)):
            with contextlib.suppress(OSError):
                while True:
                    self.bell.recv(1)

    def _cleared(self, name: str) -> Any:
        view = self.views[name]
        view[-1] = -1.0
        view[0] = -1.0
        return view

    def observe(self, number: int, o: Observation) -> None:
        """Write an observation."""
        t, n = o.tracks, len(o.tracks)
        pending = 0 if o.pending is None else len(o.pending)
        if n > MAX_TRACKS or pending > _PENDING:
            raise TooLarge("tracks, pending", (n, pending), f"at most {MAX_TRACKS} and {_PENDING}")
        if t.xy.shape != (n, 2) or t.velocity.shape != (n, 2) or t.radius.shape != (n,):
            raise BadParameter("tracks", (t.xy.shape, t.velocity.shape, t.radius.shape), f"of {n} tracks each, as id is")
        view, views = self._cleared("observation"), self.views
        views["names"][:n], views["xy"][:n], views["velocity"][:n], views["radius"][:n] = t.id, t.xy, t.velocity, t.radius
        if t.covariance is not None:
            views["covariance"][:n] = t.covariance
        if o.pending is not None:
            views["pending"][:pending] = o.pending
        noisy = float(t.covariance is not None)
        view[1:-1] = (
            o.t,
            *o.xy,
            *o.velocity,
            o.heading,
            o.stamp,
            o.turn_rate,
            n,
            pending if o.pending is not None else -1,
            noisy,
        )
        view[-1] = view[0] = number

    def observed(self, after: int) -> tuple[int, Observation] | None:
        """Return the last observation and its number, if there is one after number `after` and nobody is writing it."""
        view, views = self.views["observation"], self.views
        number = view[0]
        if number <= after:
            return None
        parts = view.tolist()
        n, m = int(parts[9]), int(parts[10])
        if number != parts[-1] or not 0 <= n <= MAX_TRACKS:
            return None
        covariance = views["covariance"][:n].copy() if parts[11] else None
        names, xy, velocity, radius = (views[name][:n].copy() for name in _TRACKS)
        tracks = Tracks(names, xy, velocity, radius, covariance)
        pending = views["pending"][:m].copy() if m >= 0 else None
        t, x, y, vx, vy, heading, stamp, rate = parts[1:9]
        if view[0] != number:
            return None
        return int(number), Observation(t, (x, y), (vx, vy), heading, tracks, stamp, rate, pending)

    def ask(self, number: int, command: Command | None) -> None:
        """Write the command that the planner asks for in answer to that observation."""
        view = self._cleared("asked")
        pair = (0.0, 0.0) if command is None else command.velocity if command.twist is None else command.twist
        view[1:-1] = 0.0 if command is None else 1.0 if command.twist is None else 2.0, *pair
        view[-1] = view[0] = number

    def asked(self, number: int) -> tuple[bool, Command | None]:
        """Return whether the planner has answered that observation, and the command that it asks for."""
        first, kind, one, two, last = self.views["asked"].tolist()
        if not first == last == number:
            return False, None
        return True, None if kind == 0.0 else Command((one, two)) if kind == 1.0 else Command(twist=(one, two))

    def reply(self, number: int, command: Command, did: str) -> None:
        """Write the guard's answer."""
        view = self._cleared("answer")
        v, omega = (math.nan, math.nan) if command.twist is None else command.twist
        view[1:-1] = *command.velocity, v, omega, DID.index(did), time.monotonic()
        view[-1] = view[0] = number

    def replied(self, number: int) -> Answer | None:
        """Return the guard's answer to that observation, if it is there."""
        first, vx, vy, v, omega, did, _, last = self.views["answer"].tolist()
        if not first == last == number:
            return None
        return Answer(number, Command((vx, vy), None if math.isnan(v) else (v, omega)), DID[int(did)])


class GuardProcess:
    """Starts the guard's process, and is the robot's side of it.

    Parameters
    ----------
    task : Task
    deadline : float
        Share in (0, 1) of the control period after which a planner that has not answered an observation counts as gone.
    emit : str
        module:function that the guard's process calls with each command that passes, as a driver of motors would; it is called
        without arguments first, and returns what takes the commands. Empty: none.
    guard : of `Guard`
        Its options: mode, timeout, hold, lookahead.

    Raises
    ------
    BadParameter

    Notes
    -----
    The process asks for a higher priority where it may. It ends with this object, or with the process that made it.
    """

    def __init__(self, task: Task, *, deadline: float = 0.7, emit: str = "", **guard: Any) -> None:
        checks.instance("task", task, Task)
        self.deadline = checks.number("deadline", deadline, low=0.0, high=1.0, open_low=True)
        checks.instance("emit", emit, str)
        Guard(**guard)  # what it refuses is refused here
        shared = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
        self.folder = tempfile.mkdtemp(prefix="antway-", dir=shared)
        (Path(self.folder) / "memory").write_bytes(bytes(_SIZE))
        self.link, self.number = Link(self.folder, "robot"), 0
        command = [sys.executable, "-c", "from antway.policies.guard_process import main; main()"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        try:
            self._tell((self.folder, self.deadline, emit, guard, os.getpid()))
            self.reset(task)
        except BaseException:
            self.close()
            raise

    def _tell(self, what: object) -> None:
        assert self.process.stdin is not None
        pickle.dump(what, self.process.stdin)
        self.process.stdin.flush()

    def reset(self, task: Task) -> None:
        """Begin a new drive, and return when the guard is ready for it; observations count on."""
        assert self.process.stdout is not None
        self.task = task
        self._tell(task)
        self.link.ring("guard")
        if not self.process.stdout.readline():
            raise BadParameter("task", task, "such that the guard's process takes it up")

    def observe(self, o: Observation) -> int:
        """Show the guard and the planner what is seen; returns the observation's number."""
        self.number += 1
        self.link.observe(self.number, o)
        self.link.ring("guard", "planner")
        return self.number

    def answer(self, number: int) -> Answer:
        """Return what to drive with, at the latest one control period from now: where the guard is silent, a stop."""
        until = time.monotonic() + self.task.robot.dt
        while True:
            found = self.link.replied(number)
            if found is not None:
                return found
            if time.monotonic() >= until:
                twist = (0.0, 0.0) if self.task.robot.wheels and not self.task.robot.stepwise else None
                return Answer(number, Command((0.0, 0.0), twist), _SILENT)
            self.link.wait(until)

    def close(self) -> None:
        """End the process."""
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout):
            if pipe is not None:
                with contextlib.suppress(OSError):
                    pipe.close()
        self.link.close()
        shutil.rmtree(self.folder, ignore_errors=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def plan_for(folder: str, policy: Policy) -> None:
    """Let `policy`, which was reset, answer what is observed, for as long as the guard's folder is there."""
    link, number = Link(folder, "planner"), 0
    while os.path.exists(folder):
        found = link.observed(number)
        if found is None:
            link.wait(time.monotonic() + 0.5)
            continue
        number, observation = found
        link.ask(number, policy.act(observation))
        link.ring("guard")


class _Server:
    """The guard's process."""

    def __init__(self, folder: str, deadline: float, emit: str, options: dict[str, Any], parent: int) -> None:
        self.link, self.guard, self.deadline, self.parent = Link(folder, "guard"), Guard(**options), deadline, parent
        self.emit = _function(emit)() if emit else None
        self.number, self.last = 0, 0.0  # of the last observation, and when it came
        self.seen: Observation | None = None
        self.task: Task | None = None

    def reset(self, task: Task) -> None:
        """Take up a task, with everything compiled that an answer needs."""
        self.guard.reset(task)
        one = Tracks(np.zeros(1, np.int64), np.array([task.start]), np.zeros((1, 2)), np.full(1, 0.1))
        heading = math.atan2(task.goal[1] - task.start[1], task.goal[0] - task.start[0])
        self.guard.limit(Observation(0.0, task.start, (0.0, 0.0), heading, one), Command((0.1, 0.0)))
        self.guard.reset(task)
        self.task, self.seen = task, None
        found = self.link.observed(self.number)
        self.number = self.number if found is None else found[0]

    def turn(self) -> None:
        """Answer the next observation, or brake where none comes."""
        assert self.task is not None
        dt = self.task.robot.dt
        found = self.link.observed(self.number)
        if found is None:
            late = self.seen is not None and time.monotonic() >= self.last + dt
            if late and self.seen is not None:
                self.last += dt
                self.seen = replace(self.seen, t=self.seen.t + dt)
                self.give(self.guard.passed(self.seen, None))
            else:
                self.link.wait(self.last + dt if self.seen is not None else time.monotonic() + 1.0)
            return
        self.last = time.monotonic()
        self.number, self.seen = found
        until = self.last + self.deadline * dt
        done, command = self.link.asked(self.number)
        while not done and time.monotonic() < until:
            self.link.wait(until)
            done, command = self.link.asked(self.number)
        try:
            passed = self.guard.limit(self.seen, command)
        except BadInput:  # an observation that makes no sense
            self.guard.did = DID[2]
            passed = self.guard.passed(replace(self.seen, stamp=-math.inf, heading=0.0), None)
        self.give(passed)

    def give(self, passed: Command) -> None:
        """Hand on the command that passes."""
        self.link.reply(self.number, passed, self.guard.did)
        self.link.ring("robot")
        if self.emit is not None:
            self.emit(passed)


def _function(name: str) -> Any:
    """Return the function module:name."""
    from importlib import import_module

    module, _, attribute = name.partition(":")
    return getattr(import_module(module), attribute)


def main() -> None:
    """Be the guard's process: settings and tasks come on stdin, and "ready" goes out for each task."""
    with contextlib.suppress(OSError):
        os.nice(-10)
    incoming, out = open(0, "rb", closefd=False), os.dup(1)  # noqa: SIM115 - for as long as the process lives
    os.dup2(2, 1)  # what anything prints is no answer
    server = _Server(*pickle.load(incoming))
    while os.getppid() == server.parent:
        if server.task is not None and not select.select([incoming], [], [], 0.0)[0]:
            server.turn()
        elif incoming.peek(1):
            server.reset(pickle.load(incoming))
            os.write(out, b"ready\n")
        else:
            break  # the robot's side has ended
