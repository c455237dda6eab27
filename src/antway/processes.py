"""Starts worker processes that Ctrl-C, which a terminal sends to all of them, ends without a word."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignore Ctrl-C, as the processes do that are started meanwhile: from their first import on, and until they are ended."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may change this
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@contextmanager
def pool(count: int) -> Iterator[ProcessPoolExecutor]:
    """Yield `count` workers that start now; an error or Ctrl-C ends them at once.

    A script that calls this must guard its own code by `if __name__ == "__main__"`.
    """
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as workers:
        try:
            with uninterrupted():
                for _ in range(count):
                    workers.submit(int)  # an executor starts a process for a task if none is idle
            yield workers
        except BaseException:
            for process in list(workers._processes.values()):
                process.kill()
            raise
