"""Measures how long a computation takes, without the time in which kernels are compiled."""

from __future__ import annotations

import time
from collections.abc import Callable

from antway.kernels.base.jit import compile_seconds


def stopwatch() -> Callable[[], float]:
    """Return a function that returns the wall time since now, ms, without the time that this process compiles kernels."""
    compiled, started = compile_seconds(), time.perf_counter()
    return lambda: max(time.perf_counter() - started - (compile_seconds() - compiled), 0.0) * 1e3
