"""Makes Numba compile antway's kernels to the same machine code in three quarters of the time.

Most of the time is spent in Python. For every `a + b` Numba searches a dozen implementations for the one that suits the types,
and the garbage collector scans a million objects that are all in use. `quick_compiler` avoids both while it is active.
Kernels of other packages are compiled as usual.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.targetconfig import ConfigStack
from numba.core.types import BaseFunction as _BaseFunction

_GARBAGE = 100_000  # allocations between two collections of the youngest generation; Python's default is 700
_YOUNG = 1_000  # collections of a generation before the next older one is collected; Python's default is 10

BaseFunction: Any = _BaseFunction
FlagsStack: Any = ConfigStack
_HANDED_ON = "nrt", "fastmath", "error_model", "forceinline"  # flags that a kernel passes on to the kernels it calls
_get_call_type = BaseFunction.get_call_type
_typed: dict[Any, Any] = {}  # signature and implementation of a function, by argument types and flags
_handed_on: dict[int, tuple[Any, Any, str]] = {}  # by id of the flags: the flags (kept alive), those passed on, their summary


def _flags_handed_on() -> tuple[Any, str]:
    """Return the flags that matter to called kernels, and their summary."""
    flags = FlagsStack.top_or_none()
    if flags is None:
        return None, ""
    if id(flags) not in _handed_on:
        few = type(flags)()
        for name in _HANDED_ON:
            setattr(few, name, getattr(flags, name))
        _handed_on[id(flags)] = flags, few, few.summary()
    return _handed_on[id(flags)][1:]


def _known_call_type(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Return the signature of a call, from the cache if it was found before.

    Flags that do not matter to the callee are left out of the key: otherwise Numba would compile it once for each of them.
    """
    flags, summary = _flags_handed_on()
    key = self, context, tuple(args), tuple(kws.items()), summary
    if key not in _typed:
        with nullcontext() if flags is None else FlagsStack().enter(flags):
            signature = _get_call_type(self, context, args, kws)
        _typed[key] = signature, self._impl_keys[signature.args]
    signature, self._impl_keys[signature.args] = _typed[key]
    return signature


@contextmanager
def quick_compiler() -> Iterator[None]:
    """Make Numba compile faster within this context. Only one thread compiles at a time."""
    with global_compiler_lock:
        if BaseFunction.get_call_type is _known_call_type:  # a nested compilation
            yield
            return
        garbage = gc.get_threshold()
        gc.set_threshold(max(garbage[0], _GARBAGE) if garbage[0] else 0, *(max(count, _YOUNG) for count in garbage[1:]))
        BaseFunction.get_call_type = _known_call_type
        try:
            yield
        finally:
            BaseFunction.get_call_type = _get_call_type
            gc.set_threshold(*garbage)
