"""Instructions that Numba has no name for; where compiling is switched off (NUMBA_DISABLE_JIT), Python that does the same."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

PLAIN = os.environ.get("NUMBA_DISABLE_JIT", "0") != "0"


def _instruction(name: str, plain: Callable[[Any], int], meaning: str) -> Callable[[Any], int]:
    if PLAIN:
        return plain

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


def _prefetch(typing_context: Any, array: Any, index: Any) -> Any:
    """Have `array[index]` fetched into the cache; any index will do, it is never read."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        data = context.make_array(signature.args[0])(context, builder, args[0]).data
        byte, number = ir.IntType(8).as_pointer(), ir.IntType(32)
        kind = ir.FunctionType(ir.VoidType(), [byte, number, number, number])
        function = builder.module.globals.get(_PREFETCH) or ir.Function(builder.module, kind, _PREFETCH)
        read, keep, data_cache = (ir.Constant(number, value) for value in (0, 3, 1))
        builder.call(function, [builder.bitcast(builder.gep(data, [args[1]]), byte), read, keep, data_cache])
        return context.get_dummy_value()

    return types.void(array, index), generate


_PREFETCH = "llvm.prefetch.p0"
prefetch = cast(Callable[[NDArray[Any], int], None], (lambda array, index: None) if PLAIN else intrinsic(_prefetch))
