"""Processes: workers that Ctrl-C, which a terminal sends to all of them, ends without a word, and pauses that are spared."""

from __future__ import annotations

import gc
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import lru_cache
from multiprocessing import get_context, resource_tracker


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Put off Ctrl-C, which processes that are started meanwhile never get: from their first import until they are ended."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread may change this
        return
    resource_tracker.ensure_running()  # it would start with the first process, and let signals through again
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)


@lru_cache(maxsize=1)
def spare_collections() -> None:
    """Leave what is there at the first call out of all later collections of garbage.

    Numba keeps some 100,000 objects, and to look at all of them takes 60 to 100 ms, in the middle of a control cycle. This is
    for processes that control a robot, once what they need is loaded. Garbage that is there then stays: to collect it would
    take as long, while the robot's odometry comes.
    """
    gc.freeze()


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
