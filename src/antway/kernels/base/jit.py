"""The one way a kernel is compiled: cached on disk, without the global lock, IEEE arithmetic in program order."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

from numba import njit, typeof

F = TypeVar("F", bound=Callable[..., object])


def kernel(function: F) -> F:
    """Compile `function` with Numba at its first call; no fastmath, so that results are the same everywhere."""
    return cast(F, njit(cache=True, nogil=True, error_model="numpy")(function))


def bare_kernel(function: F) -> F:
    """Compile `function` as `kernel` does, without counting references to arrays: that can be half the time of small helpers.

    For kernels that only read and write the arrays they are handed: Numba refuses to compile an allocation here.
    """
    return cast(F, njit(cache=True, nogil=True, error_model="numpy", _nrt=False)(function))  # type: ignore[call-overload]


def inner_kernel(function: F) -> F:
    """Compile `function` as `bare_kernel` does, always as a part of its caller: to hand over many arrays takes 200 cycles."""
    return cast(F, njit(cache=True, nogil=True, error_model="numpy", _nrt=False, forceinline=True)(function))  # type: ignore[call-overload]


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
