"""How Numba is made to compile antway's kernels in three quarters of its time, to the same machine code.

Most of its time is Python's: for every `a + b` Numba finds out anew which of a dozen implementations suits these types, and
Python looks again and again for garbage among a million objects that are all in use. Both are put right within `quick_compiler`
and put back after it, so that kernels of other packages are compiled as ever.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from typing import Any

from numba.core.compiler_lock import global_compiler_lock
from numba.core.targetconfig import ConfigStack
from numba.core.types import BaseFunction as _BaseFunction

_GARBAGE = 100_000  # objects made until garbage is looked for among the young ones; Python's own number is 700
_YOUNG = 1_000  # times that it is until older ones are looked at too, which are in use; Python's own number is 10

BaseFunction: Any = _BaseFunction
FlagsStack: Any = ConfigStack
_HANDED_ON = "nrt", "fastmath", "error_model", "forceinline"  # flags that a kernel hands on to what it calls
_get_call_type = BaseFunction.get_call_type
_typed: dict[Any, Any] = {}  # the signature and the implementation of a function for arguments of these types, with these flags
_handed_on: dict[int, tuple[Any, Any, str]] = {}  # flags, kept so that no others have their id, those handed on, what they say


def _flags_handed_on() -> tuple[Any, str]:
    """Return flags with those alone that matter to what is called, and what they say."""
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
    """Return the signature of a call: one that has been found before is not looked for again.

    Numba compiles what is called anew for kernels with other flags, whether those matter to it or not.
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
    """Let Numba compile in less time within; one thread at a time does."""
    with global_compiler_lock:
        if BaseFunction.get_call_type is _known_call_type:  # within a compilation that began so
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
