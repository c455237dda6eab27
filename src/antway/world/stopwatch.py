"""Measures how long a computation takes, without the time in which kernels are compiled."""

from __future__ import annotations

import time

from antway.kernels.base.jit import compile_seconds


class Stopwatch:
    """Wall time since the watch was made, without the time that this process spent compiling kernels."""

    def __init__(self) -> None:
        self.compiled, self.started = compile_seconds(), time.perf_counter()

    def ms(self) -> float:
        """Return the time, ms."""
        taken = time.perf_counter() - self.started - (compile_seconds() - self.compiled)
        return max(taken, 0.0) * 1e3
