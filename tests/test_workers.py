"""Files that come over the network are read in processes of their own: what crashes, hangs or swells costs one request."""

from __future__ import annotations

import base64
import os
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from antway.errors import BadInput
from antway.web import workers
from antway.web.session import Session
from antway.web.workers import Workers

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="limits memory by what /proc says")

WRONG = {  # what a flaw in a reader could do
    "crash": "import ctypes; ctypes.string_at(0)",
    "hang": "import time; time.sleep(1000)",
    "spin": "while True: pass",
    "swell": "b'x' * 2**31",
    "leave": "import os; os._exit(0)",
}


@pytest.fixture
def processes(monkeypatch: pytest.MonkeyPatch) -> Iterator[Workers]:
    """Processes that also do what is wrong."""
    program = f"from antway.web import workers; workers.WORK['wrong'] = lambda what: exec({WRONG!r}[what]); workers.serve()"
    started = workers.subprocess.Popen

    def start(command: list[str], **options: object) -> object:
        return started([*command[:2], program], stderr=workers.subprocess.DEVNULL, **options)

    monkeypatch.setattr(workers.subprocess, "Popen", start)
    made = Workers()
    yield made
    made.close()


def files(text: str, name: str = "m.txt") -> list[dict[str, str]]:
    return [{"name": name, "data": base64.b64encode(text.encode()).decode()}]


def test_work_that_goes_wrong_costs_one_request(processes: Workers) -> None:
    """A segmentation fault, an endless loop, gigabytes: each is a typed error, and the next request is answered."""
    room = "\n".join(["." * 10] * 10) + "\n"
    for wrong in WRONG:
        started = time.monotonic()
        with pytest.raises(BadInput):
            processes.run("wrong", wrong, seconds=3.0)
        assert time.monotonic() - started < 60.0, "with the time to start a process on a busy machine"
    session = Session()
    session.workers = processes
    (scene,) = session.apply({"op": "open", "files": files(room)})
    assert scene["name"] == "m" and len(processes.idle) == 1
    with pytest.raises(BadInput, match="name"):
        session.apply({"op": "open", "files": files(room, "../m.txt")})
    (name,) = {one["name"] for one in session.apply({"op": "export", "what": "trace"})}
    assert name == "m-antway.json"


def test_a_tab_that_is_closed_ends_its_export(processes: Workers) -> None:
    """Nobody waits for what nobody will see."""
    closed = threading.Event()
    threading.Timer(0.5, closed.set).start()
    started = time.monotonic()
    with pytest.raises(BadInput, match="closed"):
        processes.run("wrong", "hang", seconds=600.0, closed=closed)
    assert time.monotonic() - started < 60.0 and not processes.idle


def test_two_do_not_wait_for_each_other(processes: Workers) -> None:
    """D11: while one export takes long, another one is done."""
    closed = threading.Event()

    def wait() -> None:
        with pytest.raises(BadInput, match="closed"):
            processes.run("wrong", "hang", closed=closed, seconds=600.0)

    long = threading.Thread(target=wait)
    long.start()
    with pytest.raises(BadInput, match="status"):
        processes.run("wrong", "leave")
    assert long.is_alive()
    closed.set()
    long.join()


def test_no_process_is_left(processes: Workers) -> None:
    """What waits for work ends with the server."""
    with pytest.raises(BadInput):
        processes.run("upload", None)
    (worker,) = processes.idle
    processes.close()
    with pytest.raises(ProcessLookupError):
        os.kill(worker.process.pid, 0)


def test_a_process_that_takes_no_request_costs_one_request(monkeypatch: pytest.MonkeyPatch) -> None:
    """A request that is larger than a pipe and that nobody reads ends in time, too."""
    started, before = workers.subprocess.Popen, threading.active_count()
    monkeypatch.setattr(workers.subprocess, "Popen", lambda _, **options: started(["sleep", "60"], **options))
    with pytest.raises(BadInput, match="took too long"):
        Workers().run("instance", bytes(2**22), "name", seconds=0.1)
    assert threading.active_count() == before, "who sends is done before the connection is closed"
