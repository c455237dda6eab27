"""Work that takes longer than a control cycle on a large map: a thread does it while the robot drives on."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from copy import deepcopy
from threading import Thread
from typing import Generic, TypeVar

R = TypeVar("R")

_AT_ONCE = 2**16  # number of nodes, of a car in all headings; work on a smaller map is done within the cycle
_PACE = 5e5  # nodes/s; a result is used after the time that its map takes at this pace, at which it is there long since


class Beside(Generic[R]):
    """The result of some work, which is used from a time on that depends on the size of the map alone: `due`, s.

    So an episode is the same on a slow and on a fast machine. Only where a simulation is faster than real time does it wait.

    `nodes` is the size of the map; for a car, times the number of headings. Up to `at_once` nodes (None: 65,536) the work is
    done within the cycle, and `due` is `now`, s. It changes nothing that others use; kernels release Python's global lock.
    """

    def __init__(self, nodes: int, now: float, work: Callable[[], R], at_once: int | None = None) -> None:
        self._done: Future[R] = Future()
        self.due = now
        if nodes <= (_AT_ONCE if at_once is None else at_once):
            self._done.set_result(work())
        else:
            self.due += nodes / _PACE
            Thread(target=self._run, args=(work,), daemon=True).start()

    def _run(self, work: Callable[[], R]) -> None:
        try:
            self._done.set_result(work())
        except BaseException as error:
            self._done.set_exception(error)

    @property
    def done(self) -> bool:
        """Whether the result is there."""
        return self._done.done()

    def result(self) -> R:
        """Return the result once it is there; raise what the work raised."""
        return self._done.result()

    def __deepcopy__(self, memo: dict[int, object]) -> Beside[R]:
        """Return a copy with a copy of the result, for which it waits."""
        copy: Beside[R] = Beside(0, self.due, lambda: deepcopy(self.result(), memo))
        return copy
