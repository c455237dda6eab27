"""The one way a kernel is compiled: cached on disk, without the global lock, IEEE arithmetic in program order.

Where compiling is switched off (NUMBA_DISABLE_JIT) kernels are plain Python, and Numba is not even imported.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

F = TypeVar("F", bound=Callable[..., object])
PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") != "0"

if not PLAIN:
    from antway.kernels.base import dispatch


def compile_seconds() -> float:
    """Return how long this process has compiled kernels so far, s; the difference of two calls is no time of a policy's own."""
    return 0.0 if PLAIN else dispatch.watch.seconds


def _compiled(function: F, shared: bool = False, **options: bool) -> F:
    if PLAIN:
        return function
    return cast(F, dispatch.for_kernels_and_python(function, {"nogil": True, "error_model": "numpy", **options}, shared))


def kernel(function: F) -> F:
    """Compile `function` with Numba at its first call; no fastmath, so that results are the same everywhere."""
    return _compiled(function)


def shared_kernel(function: F) -> F:
    """Compile `function` as `kernel` does, for large ones that Python and kernels call with the same types: once for both."""
    return _compiled(function, shared=True)


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
    if PLAIN:
        return function
    if function not in _entries:
        _entries[function] = dispatch.compiled_for(function, sample)
    return cast(F, _entries[function])
