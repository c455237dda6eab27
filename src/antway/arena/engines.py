"""Plays episodes in many processes, local or on a Ray cluster. Only the main process writes results."""

from __future__ import annotations

import importlib
import math
import multiprocessing
import os
import random
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.util import find_spec
from multiprocessing.connection import Connection, wait
from multiprocessing.context import ForkServerContext, SpawnContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, cast

import numpy as np
from numba.core import event

from antway import checks
from antway.arena import metrics
from antway.arena.causes import with_cause
from antway.arena.store import Key, Results, Row
from antway.arena.suites import LazySequence, SuiteEpisode, content_hash, stage
from antway.errors import BadParameter
from antway.processes import uninterrupted
from antway.version import __version__
from antway.world.episode import run
from antway.world.policy import make_policy
from antway.world.trace import Outcome
from antway.world.tracefile import beyond_limits, to_json

TIMEOUT = 120.0  # s; wall time after which an episode is abandoned
ENGINES = ("local", "ray")
Answer = tuple[Row, str]  # the row, and the JSON of the trace if the episode failed and it can be read again, else ""


@dataclass(frozen=True, slots=True)
class Job:
    """One episode to be played by one policy; `label` is the policy's name in rows, if that is another one."""

    episode: SuiteEpisode
    policy: str
    label: str = ""

    @property
    def key(self) -> Key:
        """The key of its row."""
        return self.episode.suite, self.episode.name, self.label or self.policy, self.episode.seed, __version__

    def failed(self, outcome: Outcome, reason: str) -> Answer:
        """Return the row of an episode that could not be played to the end."""
        return Row(*self.key, self.episode.group, outcome.value, reason), ""

    def abandoned(self, timeout: float) -> Answer:
        """Return the row of an episode that took longer than `timeout` s."""
        return self.failed(Outcome.TIMEOUT, f"given up after {timeout:g} s of wall time")


def play(job: Job) -> Answer:
    """Play an episode and measure it; errors of policies raise nothing."""
    episode = job.episode
    scenario, facts = stage(episode)
    result = run(scenario, job.policy, seed=episode.seed)
    trace = result.trace
    assert trace is not None
    row = Row(
        *job.key,
        group=episode.group,
        outcome=result.outcome.value,
        reason=with_cause(trace),
        time=result.time,
        length=result.length,
        clearance=result.min_clearance,
        discomfort=metrics.discomfort(trace),
        side_changes=metrics.side_changes(trace),
        replans=result.replans,
        waits=result.waits,
        jerk=metrics.jerk(trace),
        bound=facts.bound,
        shortest=facts.shortest,
        difficulty=facts.difficulty,
        cycle_p50=result.cycle(50),
        cycle_p99=result.cycle(99),
        cycle_max=result.cycle(100),
    )
    text = "" if result.reached else to_json(trace)
    return row, "" if beyond_limits(trace, text) else text  # what cannot be read again would end the report


def bench(
    jobs: Iterable[Job],
    results: Results,
    *,
    engine: str = "local",
    workers: int = 1,
    timeout: float = TIMEOUT,
    done: Callable[[Row | None], None] = lambda row: None,
) -> None:
    """Play all `jobs` that are not in `results` yet, and write each row when it is done.

    Parameters
    ----------
    jobs : iterable of Job
    results : Results
        Only this process writes it, so that killing any process at any time loses nothing that was finished.
    engine : str
        "local" (processes of this machine) or "ray".
    workers : int
        >= 1.
    timeout : float
        Limit of an episode's wall time, s, > 0; a longer one gets the outcome TIMEOUT.
    done : function of Row or None
        Called after each job, with None if its row existed already.

    Raises
    ------
    BadParameter
        For an unknown engine, or if Ray is not installed.
    BadResults
        If the results cannot be written.
    """
    check_engine(engine, workers, timeout)
    play_all = {"local": local, "ray": ray}[engine]

    def missing() -> Iterator[Job]:
        for job in jobs:
            if results.has(job.key):
                done(None)
            else:
                yield job

    for row, trace in play_all(missing(), workers, timeout):
        results.add(row, trace)
        done(row)


def check_engine(engine: str, workers: int, timeout: float) -> None:
    """Raise `BadParameter` for what `bench` cannot play with."""
    checks.integer("workers", workers, low=1, high=1024)
    checks.number("timeout", timeout, low=0.0, open_low=True, unit="s")
    if checks.choice("engine", engine, ENGINES) == "ray" and find_spec("ray") is None:
        raise BadParameter("engine", "ray", "local, or install ray")


def local(jobs: Iterator[Job], workers: int, timeout: float) -> Iterator[Answer]:
    """Play jobs on `workers` processes of this machine. A process that dies or hangs loses its episode and is replaced."""
    busy: list[_Worker] = []
    try:
        while True:
            while len(busy) < workers and (job := next(jobs, None)) is not None:
                busy.append(_Worker(job, timeout))
            if not busy:
                return
            first = min(worker.deadline for worker in busy)
            seconds = min(max(first - time.monotonic(), 0.0), 1e6)  # a call that waits for longer is an error
            ready = wait([worker.pipe for worker in busy], seconds)
            for worker in list(busy):
                answer = None
                if worker.pipe in ready or worker.pipe.poll():  # an answer may have come while others were written
                    answer = worker.collect()
                elif time.monotonic() >= worker.deadline:
                    answer = worker.job.abandoned(timeout)
                    worker.stop()
                if answer is None:
                    continue
                yield answer
                following = next(jobs, None) if worker.process.is_alive() else None
                if following is None:
                    worker.stop()
                    busy.remove(worker)
                else:
                    try:
                        worker.give(following)
                    except OSError:  # it has died since it answered
                        worker.stop()
                        busy[busy.index(worker)] = _Worker(following, timeout)
    finally:
        for worker in busy:
            worker.stop()


def _context() -> SpawnContext | ForkServerContext:
    """Return how workers start: on Linux forked from a process that has imported antway, else each with a second's imports."""
    if sys.platform != "linux":
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, "antway.policies.antway.policy"])
    return context


class _Worker:
    """A worker process and the job it has."""

    def __init__(self, job: Job, timeout: float) -> None:
        context = _context()
        self.pipe, far = context.Pipe()
        self.timeout = timeout
        self.process: BaseProcess = context.Process(target=_work, args=(far,), daemon=True)
        with uninterrupted():  # the main process decides when to stop
            self.process.start()
        far.close()
        self.job, self.deadline = job, math.inf
        with suppress(EOFError, OSError):  # a process that has died by now is known by its pipe
            self.pipe.recv()  # wait until the worker is ready, since start-up does not count as the policy's time
            self.give(job)

    def give(self, job: Job) -> None:
        self.job, self.deadline = job, time.monotonic() + self.timeout
        self.pipe.send(job)

    def collect(self) -> Answer | None:
        """Return the answer that has arrived, or a row with the outcome ERROR if the process died.

        None means that a kernel was compiled; then the time limit starts again.
        """
        try:
            answer = cast("Answer | None", self.pipe.recv())
            self.deadline = time.monotonic() + self.timeout
            return answer
        except (EOFError, OSError):
            self.process.join()
            return self.job.failed(Outcome.ERROR, f"the process died with exit status {self.process.exitcode}")

    def stop(self) -> None:
        self.process.kill()
        self.process.join()
        self.pipe.close()


def _work(pipe: Connection) -> None:
    """Play the jobs from the pipe until it is closed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    threading.Thread(target=lambda: (wait([parent.sentinel]), os._exit(1)), daemon=True).start()
    with suppress(OSError):  # where there is no stderr
        os.dup2(2, 1)  # what policies print does not belong to the answer on stdout
    warnings.filterwarnings("ignore", category=UserWarning, module=r"antway\.")  # said when the main process made the episodes
    line = _Line(pipe)
    line.send(None)
    event.register("numba:compile", _Compiled(line))  # type: ignore[no-untyped-call]
    while True:
        try:
            job = pipe.recv()
        except EOFError:
            return
        line.send(_safely(job))


class _Line:
    """The pipe to the main process, to which any thread may write: one that plans may compile while an answer is sent."""

    def __init__(self, pipe: Connection) -> None:
        self.pipe, self.lock = pipe, threading.RLock()

    def send(self, answer: Answer | None) -> None:
        with self.lock:
            self.pipe.send(answer)


class _Compiled(event.Listener):
    """Reports each compiled kernel to the main process, so that compiling does not count as the policy's time."""

    def __init__(self, line: _Line) -> None:
        self.line = line

    def on_start(self, event: object) -> None:
        pass

    def on_end(self, event: object) -> None:
        self.line.send(None)


def _safely(job: Job) -> Answer:
    """Play an episode in a process of its own, where policies that draw from global random state repeat themselves, too."""
    random.seed(job.episode.seed)
    np.random.seed(job.episode.seed % 2**32)  # noqa: NPY002 - what such policies use
    try:
        return play(job)
    except (Exception, SystemExit) as error:  # an episode that cannot start gets a row, too
        return job.failed(Outcome.ERROR, f"{type(error).__name__}: {error}")


def ray(jobs: Iterator[Job], workers: int, timeout: float) -> Iterator[Answer]:
    """Play jobs on the Ray cluster at RAY_ADDRESS, or on one that is started on this machine."""
    cluster: Any = importlib.import_module("ray")
    mine = not cluster.is_initialized()
    if mine:
        where = os.environ.get("RAY_ADDRESS")
        size = {} if where else {"num_cpus": workers, "include_dashboard": False}
        cluster.init(address=where, log_to_driver=False, logging_level="ERROR", **size)
    remote = cluster.remote(num_cpus=1, max_retries=0)(_safely)
    running: dict[Any, tuple[Job, float]] = {}
    try:
        while True:
            while len(running) < workers and (job := next(jobs, None)) is not None:
                running[remote.remote(job)] = job, time.monotonic() + timeout
            if not running:
                return
            ready, _ = cluster.wait(list(running), timeout=1.0)
            late = [one for one, (_, deadline) in running.items() if time.monotonic() > deadline and one not in ready]
            for one in late:
                cluster.cancel(one, force=True)
                yield running.pop(one)[0].abandoned(timeout)
            for one in ready:
                job, _ = running.pop(one)
                try:
                    yield cluster.get(one)
                except cluster.exceptions.RayError as error:
                    yield job.failed(Outcome.ERROR, f"the process died: {type(error).__name__}")
    finally:
        for one in running:
            cluster.cancel(one, force=True)
        if mine:
            cluster.shutdown()


def _label(policy: str) -> str:
    """Return a policy's name, and for MODULE:CLASS a hash of that file, so that rows of an earlier state do not count.

    The module has been imported.
    """
    module, colon, _ = policy.partition("/")[0].partition(":")
    file = getattr(sys.modules.get(module), "__file__", None) if colon else None
    if file is None or not Path(file).is_file():
        return policy
    return f"{policy}-{content_hash(file)}"


def table_jobs(episodes: Sequence[SuiteEpisode], policies: Iterable[str]) -> LazySequence[Job]:
    """Return the jobs of all policies on all episodes. `oracle` is not needed: every row has its optimum.

    Raises
    ------
    BadParameter
        For an unknown policy, or one that is given twice.
    """
    names = list(policies)
    for name in names:
        make_policy(name)
        if names.count(name) > 1:
            raise BadParameter("policies", name, "given once")
    labels = [_label(name) for name in names]

    def made(place: int) -> Job:
        episode, policy = divmod(place, len(names))
        return Job(episodes[episode], names[policy], labels[policy])

    return LazySequence(made, range(len(episodes) * len(names)))
