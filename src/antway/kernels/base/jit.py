"""The one way a kernel is compiled: cached on disk, without the global lock, IEEE arithmetic in program order.

Where compiling is switched off (NUMBA_DISABLE_JIT) kernels are plain Python, and Numba is not even imported.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar, cast

P = ParamSpec("P")
R = TypeVar("R")
F = TypeVar("F", bound=Callable[..., object])
PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") != "0"

if not PLAIN:
    from antway.kernels.base import dispatch


def compile_seconds() -> float:
    """Return how long this process has spent compiling kernels, s. It is subtracted from measured times of policies."""
    return 0.0 if PLAIN else dispatch.watch.seconds


def _compiled(function: F, shared: bool = False, **options: bool) -> F:
    if PLAIN:
        return function
    return cast(F, dispatch.for_kernels_and_python(function, {"nogil": True, "error_model": "numpy", **options}, shared))


def kernel(function: F) -> F:
    """Compile `function` with Numba at its first call; no fastmath, so that results are the same everywhere."""
    return _compiled(function)


def shared_kernel(function: F) -> F:
    """Compile `function` as `kernel` does, but once for Python and for kernels, which call it with the same types."""
    return _compiled(function, shared=True)


def bare_kernel(function: F) -> F:
    """Compile `function` as `kernel` does, without reference counts of arrays, which can take half the time of small kernels.

    With them, each call that hands on a record counts a reference to each of its arrays. This is for kernels that only read and
    write their arguments: Numba refuses to compile an allocation here.
    """
    return _compiled(function, _nrt=False)


def inner_kernel(function: F) -> F:
    """Compile `function` as `bare_kernel` does, and always inline it: passing many arrays takes 200 cycles."""
    return _compiled(function, _nrt=False, forceinline=True)


_entries: dict[Any, Any] = {}


def entry(function: F, *sample: object) -> F:
    """Return the kernel `function` compiled for arguments of the types of `sample`. Call it only with arguments of these types.

    An integer in place of a float is converted; a float in place of an integer loses its fraction without a warning. A normal
    call of a kernel determines the types of all arguments each time, which takes 0.2 us for each part of a tuple.
    """
    if PLAIN:
        return function
    if function not in _entries:
        _entries[function] = dispatch.compiled_for(function, sample)
    return cast(F, _entries[function])


def call(function: Callable[P, R], *arguments: P.args, **none: P.kwargs) -> R:
    """Call the kernel `function` as `entry` compiles it, for the types of the arguments of its first call."""
    compiled: Callable[..., R] = _entries.get(function) or entry(function, *arguments)
    return compiled(*arguments)
