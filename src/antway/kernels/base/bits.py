"""Machine instructions that Numba does not offer. With NUMBA_DISABLE_JIT set, plain Python does the same."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast

from antway.kernels.base.jit import PLAIN


def _instruction(name: str, plain: Callable[[Any], int], meaning: str) -> Callable[[Any], int]:
    if PLAIN:
        return plain
    from llvmlite import ir
    from numba import types
    from numba.extending import intrinsic

    def typed(typing_context: Any, word: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            return getattr(builder, name)(args[0], ir.Constant(ir.IntType(1), 1))

        return types.int64(types.uint64), generate

    typed.__doc__ = meaning
    return cast(Callable[[Any], int], intrinsic(typed))


ctz = _instruction(
    "cttz",
    lambda word: (int(word) & -int(word)).bit_length() - 1,
    "Return the number of zero bits below the lowest one of a uint64 that is not 0.",
)
clz = _instruction(
    "ctlz",
    lambda word: 64 - int(word).bit_length(),
    "Return the number of zero bits above the highest one of a uint64 that is not 0.",
)
