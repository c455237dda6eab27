"""A machine instruction that Numba does not offer. With NUMBA_DISABLE_JIT set, plain Python does the same."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from antway.kernels.base.jit import PLAIN


def _count_trailing_zeros() -> Callable[[Any], int]:
    if PLAIN:
        return lambda word: (int(word) & -int(word)).bit_length() - 1
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    def ctz(typing_context: Any, word: Any) -> Any:
        """Return the number of zero bits below the lowest one of a uint64 that is not 0."""

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return builder.cttz(args[0], ir.Constant(ir.IntType(1), 1))

        return types.int64(types.uint64), generate

    return cast(Callable[[Any], int], intrinsic(ctz))


ctz = _count_trailing_zeros()
