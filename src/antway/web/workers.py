"""Work on data from the network in separate processes: one that crashes, hangs or needs too much memory costs one request.

The server sends a process the name of a task and its arguments. The process is kept for the next request, and is ended if it
takes too long or the tab is closed. The memory that it may use in addition to its initial memory is limited.
"""

from __future__ import annotations

import os
import pickle
import select
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any, BinaryIO

from antway.errors import BadInput, BadParameter
from antway.reading import limit_process

MEMORY = 512 * 2**20  # bytes of address space that a task may use beyond the initial memory of the process
SECONDS = 20.0  # s; time limit for reading a file
EXPORT_SECONDS = 120.0  # s; time limit of an export
IDLE = 2  # number of processes that are kept for the next request
MOST = 3  # limit of processes at a time; further requests wait
_LENGTH = struct.Struct("<Q")


def _upload(files: object) -> object:
    """Read a scenario, and play its first step, so that a crash happens here."""
    from antway.web.files import read_upload
    from antway.world.episode import Episode

    scenario = read_upload(files)
    episode = Episode(scenario, "follow")
    if episode.outcome is None:
        episode.step()
    return scenario


def _export(what: str, scenario: Any, policy: str) -> object:
    from antway.web.files import exported
    from antway.world.episode import Episode

    episode = Episode(scenario, policy)
    while episode.outcome is None:
        episode.step()
    trace = episode.result().trace
    assert trace is not None
    return exported(what, trace)


def _instance(data: bytes, name: str) -> object:
    from antway.ants.tsplib import parse

    return parse(data, name)


WORK: dict[str, Callable[..., object]] = {"upload": _upload, "export": _export, "instance": _instance}


class Workers:
    """A few processes that work for all tabs."""

    def __init__(self) -> None:
        self.turns, self.lock = threading.Semaphore(MOST), threading.Lock()
        self.idle: list[subprocess.Popen[bytes]] = []

    def run(self, work: str, *given: object, seconds: float = SECONDS, closed: threading.Event | None = None) -> Any:
        """Return what WORK[work](*given) returns in another process.

        Raises
        ------
        BadInput
            As raised by the task; also if its process ends, or has to be ended.
        """
        with self.turns:
            with self.lock:
                process = self.idle.pop() if self.idle else None
            if process is None or process.poll() is not None:
                process = _started()
            try:
                answer = _asked(process, pickle.dumps((work, given)), time.monotonic() + seconds, closed)
            except BaseException:
                _end(process)
                raise
            with self.lock:
                kept = len(self.idle) < IDLE
                if kept:
                    self.idle.append(process)
            if not kept:
                _end(process)
        if isinstance(answer, BadInput):
            raise answer
        return answer

    def close(self) -> None:
        """End the idle processes."""
        with self.lock:
            while self.idle:
                _end(self.idle.pop())


def _started() -> subprocess.Popen[bytes]:
    command = [sys.executable, "-c", "from antway.web.workers import serve; serve()"]
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, bufsize=0, start_new_session=True)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()
    process.wait()


def _asked(process: subprocess.Popen[bytes], request: bytes, until: float, closed: threading.Event | None) -> object:
    """Send a request and return the answer, or raise a `BadParameter` if none comes in time."""
    assert process.stdin is not None and process.stdout is not None
    incoming, outgoing = process.stdout.fileno(), process.stdin.fileno()
    left, data, wanted = memoryview(_LENGTH.pack(len(request)) + request), bytearray(), _LENGTH.size
    os.set_blocking(outgoing, False)
    while len(data) < wanted:
        if closed is not None and closed.is_set():
            raise BadParameter("request", "of a tab that is closed", "one of an open tab")
        if time.monotonic() > until:
            raise BadParameter("request", "took too long", "done in time; its process was ended")
        reads, writes, _ = select.select([incoming], [outgoing] if left else [], [], 0.1)
        try:
            if writes:
                left = left[os.write(outgoing, left[:65536]) :]
            part = os.read(incoming, 2**20) if reads else None
        except BrokenPipeError:
            part = b""
        if part == b"":
            status = process.wait()
            raise BadParameter("request", f"its process ended with status {status}", "of files that can be worked on")
        data += part or b""
        if wanted == _LENGTH.size and len(data) >= wanted:
            wanted += _LENGTH.unpack_from(data)[0]
    return pickle.loads(data[_LENGTH.size :])


def serve() -> None:
    """Work for the parent process until it closes the pipe."""
    out: BinaryIO = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # other output must not mix with answers
    import antway.view.animation
    import antway.web.files
    import antway.world.episode  # noqa: F401 - so that their memory is not counted

    limit_process(MEMORY)
    incoming = sys.stdin.buffer
    while len(head := incoming.read(_LENGTH.size)) == _LENGTH.size:
        work, given = pickle.loads(incoming.read(_LENGTH.unpack(head)[0]))
        try:
            answer: object = WORK[work](*given)
        except BadInput as error:
            answer = error
        except MemoryError:
            answer = BadParameter("files", "too much memory", f"of a kind that takes at most {MEMORY} bytes to work on")
        data = pickle.dumps(answer)
        left = memoryview(_LENGTH.pack(len(data)) + data)
        while left:
            left = left[out.write(left) :]
