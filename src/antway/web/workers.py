"""Work on data from the network in separate processes: one that crashes, hangs or needs too much memory costs one request.

The server sends a process the name of a task and its arguments. The process is kept for the next request, and is ended if it
takes too long or the tab is closed. The memory that it may use in addition to its initial memory is limited.
"""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import Any, NamedTuple

from antway.errors import BadInput, BadParameter
from antway.reading import limit_process

MEMORY = 512 * 2**20  # bytes of address space that a task may use beyond the initial memory of the process
SECONDS = 20.0  # s; time limit for reading a file
EXPORT_SECONDS = 120.0  # s; time limit of an export
IDLE = 2  # number of processes that are kept for the next request
MOST = 3  # limit of processes at a time; further requests wait


def _upload(files: object) -> object:
    """Read a scenario, and play its first step, so that a crash happens here."""
    from antway.web.files import read_upload
    from antway.world.episode import Episode

    scenario = read_upload(files)
    episode = Episode(scenario, "follow")
    if episode.outcome is None:
        episode.step()
    return scenario


def _export(what: str, scenario: Any, policies: Sequence[str]) -> object:
    from antway.web.files import exported
    from antway.world.episode import run

    traces = []
    for policy in policies:
        trace = run(scenario, policy).trace
        assert trace is not None
        traces.append(trace)
    return exported(what, *traces)


def _instance(data: bytes, name: str) -> object:
    from antway.ants.tsplib import parse

    return parse(data, name)


WORK: dict[str, Callable[..., object]] = {"upload": _upload, "export": _export, "instance": _instance}


class Worker(NamedTuple):
    """A process, and the connection to it."""

    process: subprocess.Popen[bytes]
    pipe: Connection[Any, Any]


class Workers:
    """A few processes that work for all tabs."""

    def __init__(self) -> None:
        self.turns, self.lock = threading.Semaphore(MOST), threading.Lock()
        self.idle: list[Worker] = []

    def run(self, work: str, *given: object, seconds: float = SECONDS, closed: threading.Event | None = None) -> Any:
        """Return what WORK[work](*given) returns in another process, or raise the `BadInput` that it raises.

        There is a `BadInput` also if the process ends, or has to be ended.
        """
        with self.turns:
            with self.lock:
                worker = self.idle.pop() if self.idle else None
            if worker is None or worker.process.poll() is not None:
                worker = _started()
            try:
                answer = _asked(worker, (work, given), time.monotonic() + seconds, closed)
            except BaseException:
                _end(worker)
                raise
            with self.lock:
                kept = len(self.idle) < IDLE
                if kept:
                    self.idle.append(worker)
            if not kept:
                _end(worker)
        if isinstance(answer, BadInput):
            raise answer
        return answer

    def close(self) -> None:
        """End the idle processes."""
        with self.lock:
            while self.idle:
                _end(self.idle.pop())


def _started() -> Worker:
    ours, theirs = Pipe()
    command = [sys.executable, "-c", "from antway.web.workers import serve; serve()"]
    with theirs:
        return Worker(subprocess.Popen(command, stdin=theirs.fileno(), stdout=2, start_new_session=True), ours)


def _end(worker: Worker) -> None:
    worker.process.kill()
    worker.process.wait()
    worker.pipe.close()


def _asked(worker: Worker, request: object, until: float, closed: threading.Event | None) -> object:
    """Send a request and return the answer, or raise a `BadParameter` if none comes in time."""

    def send() -> None:
        with suppress(OSError):
            worker.pipe.send(request)

    sender = threading.Thread(target=send, daemon=True)
    sender.start()
    try:
        while not worker.pipe.poll(0.1):
            if closed is not None and closed.is_set():
                raise BadParameter("request", "of a tab that is closed", "one of an open tab")
            if time.monotonic() > until:
                raise BadParameter("request", "took too long", "done in time; its process was ended")
        return worker.pipe.recv()
    except (EOFError, OSError):
        status = worker.process.wait()
        raise BadParameter("request", f"its process ended with status {status}", "of files that can be worked on") from None
    except BaseException:
        worker.process.kill()  # or a process that hangs would never take the request up, which the sender waits for
        raise
    finally:
        sender.join()


def serve() -> None:
    """Work for the parent process, which is at the other end of stdin, until it closes the connection."""
    import antway.view.animation
    import antway.web.files
    import antway.world.episode  # noqa: F401 - so that their memory is not counted

    limit_process(MEMORY)
    with suppress(EOFError, ConnectionError):
        pipe: Connection[Any, Any] = Connection(0)
        while True:
            work, given = pipe.recv()
            try:
                answer: object = WORK[work](*given)
            except BadInput as error:
                answer = error
            except MemoryError:
                answer = BadParameter("files", "too much memory", f"of a kind that takes at most {MEMORY} bytes to work on")
            pipe.send(answer)
