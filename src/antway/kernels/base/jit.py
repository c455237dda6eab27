"""The one way a kernel is compiled: cached on disk, without the global lock, IEEE arithmetic in program order."""

from __future__ import annotations

import logging
import multiprocessing
import os
import time
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
from numba import typeof
from numba.core import event

from antway.kernels.base.cache import cache_folder
from antway.kernels.base.dispatch import for_kernels_and_python

F = TypeVar("F", bound=Callable[..., object])
config: Any = numba.config


_CACHE = cache_folder()
_log = logging.getLogger("antway")


class _Watch(event.Listener):
    """Adds up the time that compiling takes, and says once that kernels are being compiled.

    One thread compiles at a time, and what a kernel calls is compiled while it is: the outermost compilation counts.
    """

    def __init__(self) -> None:
        self.depth, self.began, self.seconds, self.announced = 0, 0.0, 0.0, False

    def on_start(self, event: object) -> None:
        if not self.depth:
            self.began = time.perf_counter()
        self.depth += 1
        if not self.announced:
            self.announced = True
            if multiprocessing.parent_process() is None and not os.environ.get("ANTWAY_QUIET"):
                _log.warning("antway: compiling the kernels; this happens once and is kept on disk (see antway warmup) ...")

    def on_end(self, event: object) -> None:
        self.depth -= 1
        if not self.depth:
            self.seconds += time.perf_counter() - self.began


_watch = _Watch()
event.register("numba:compile", _watch)  # type: ignore[no-untyped-call]


def compile_seconds() -> float:
    """Return how long this process has compiled kernels so far, s; the difference of two calls is no time of a policy's own."""
    return _watch.seconds


def _compiled(function: F, **options: bool) -> F:
    settings = {"nogil": True, "error_model": "numpy", **options}
    before = config.CACHE_DIR
    config.CACHE_DIR = before or _CACHE  # for this kernel alone: other packages keep theirs where they did
    try:
        if config.DISABLE_JIT:
            return function
        return cast(F, for_kernels_and_python(function, settings))
    finally:
        config.CACHE_DIR = before


def kernel(function: F) -> F:
    """Compile `function` with Numba at its first call; no fastmath, so that results are the same everywhere."""
    return _compiled(function)


def bare_kernel(function: F) -> F:
    """Compile `function` as `kernel` does, without counting references to arrays: that can be half the time of small helpers.

    For kernels that only read and write the arrays they are handed: Numba refuses to compile an allocation here.
    """
    return _compiled(function, _nrt=False)


def inner_kernel(function: F) -> F:
    """Compile `function` as `bare_kernel` does, always as a part of its caller: to hand over many arrays takes 200 cycles."""
    return _compiled(function, _nrt=False, forceinline=True)


_entries: dict[Any, Any] = {}


def entry(function: F, *sample: object) -> F:
    """Return the kernel `function` as compiled for arguments like these at its first use, to be called with such alone.

    An integer that comes where there was a float is taken as one; a float where there was an integer loses its fraction unsaid.
    A call of the kernel itself finds out the types of all arguments each time, at 0.2 us for each part of a tuple.
    """
    if function not in _entries:
        compiled = getattr(function, "compile", None)  # None where compiling is switched off (NUMBA_DISABLE_JIT)
        _entries[function] = compiled(tuple(map(typeof, sample))) if compiled else function
    return cast(F, _entries[function])
