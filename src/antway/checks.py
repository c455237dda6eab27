"""Checks of input at the boundary: each returns the value in the type in which it is used, or raises a `BadInput`."""

from __future__ import annotations

import math
import numbers
import operator
from collections.abc import Iterable
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadInput, BadParameter

T = TypeVar("T")
LOWEST, WORD = -(2**63), 2**63 - 1  # the least and the largest integer that a kernel takes


def number(
    field: str,
    value: object,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    open_low: bool = False,
    infinite: bool = False,
    unit: str = "",
    error: type[BadInput] = BadParameter,
    where: str = "",
) -> float:
    """Return `value` as a float in [low, high] ((low, high] where `open_low`); infinite only where allowed, never NaN.

    Examples
    --------
    >>> number("radius", 1, low=0.0, unit="m")
    1.0
    """
    try:
        result = float(value) if isinstance(value, numbers.Real) and not isinstance(value, (bool, np.bool_)) else math.nan
    except OverflowError:  # an integer that no float can hold
        result = math.nan
    if not low <= result <= high or (open_low and result == low) or (math.isinf(result) and not infinite):
        allowed = f"a {'' if infinite else 'finite '}number{_range(low, high, open_low)}{f' ({unit})' if unit else ''}"
        raise error(field, value, allowed, where=where)
    return result


def fields(record: object, *names: str, **limits: Any) -> None:
    """Check these fields of a record, which may be frozen, as `number` does within `limits`; store them as floats."""
    for name in names:
        object.__setattr__(record, name, number(name, getattr(record, name), **limits))


def counts(record: object, *names: str, **limits: Any) -> None:
    """Check these fields of a record, which may be frozen, as `integer` does within `limits`; store them as ints.

    Small integers of NumPy would overflow in what is computed of them.
    """
    for name in names:
        object.__setattr__(record, name, integer(name, getattr(record, name), **limits))


def integer(
    field: str,
    value: object,
    *,
    low: int | None = None,
    high: int | None = None,
    error: type[BadInput] = BadParameter,
    where: str = "",
) -> int:
    """Return `value` as an int in [low, high], by default of 64 bits with a sign; booleans, floats and strings are refused.

    Examples
    --------
    >>> integer("ants", 50, low=1)
    50
    """
    try:
        result = None if isinstance(value, (bool, np.bool_)) else operator.index(value)  # type: ignore[arg-type]
    except TypeError:
        result = None
    if result is None or not (LOWEST if low is None else low) <= result <= (WORD if high is None else high):
        huge = isinstance(value, int) and not LOWEST <= value <= WORD
        least, most = (LOWEST, WORD) if huge else (-math.inf, math.inf)
        span = _range(least if low is None else low, most if high is None else high, False)
        raise error(field, value, f"an integer{span}", where=where)
    return result


def seed(value: object) -> int:
    """Return `value` as a seed, an integer in [0, 2**64 - 1]."""
    return integer("seed", value, low=0, high=2**64 - 1)


def choice(field: str, value: object, allowed: Iterable[str], *, error: type[BadInput] = BadParameter, where: str = "") -> str:
    """Return `value`, one of the `allowed` names."""
    names = list(allowed)
    if not isinstance(value, str) or value not in names:
        raise error(field, value, f"one of {', '.join(names)}", where=where)
    return value


def objective(value: object) -> str:
    """Return the objective of a tour; "travel-time", as on the command line, is "travel time"."""
    return choice("objective", "travel time" if str(value) == "travel-time" else value, ("travel time", "makespan"))


def instance(field: str, value: object, kind: type[T]) -> T:
    """Return `value` if it is a `kind`."""
    if not isinstance(value, kind):
        raise BadParameter(field, value, f"a {kind.__name__}")
    return value


def sequence(field: str, value: object, allowed: str, *, size: int | None = None, where: str = "") -> list[Any]:
    """Return the elements of the iterable `value`, `size` of them unless None."""
    no_sequence = isinstance(value, (str, bytes, dict, set, frozenset)) or getattr(value, "ndim", 1) == 0
    if isinstance(value, Iterable) and not no_sequence:
        parts = list(value)
        if size is None or len(parts) == size:
            return parts
    raise BadParameter(field, value, allowed, where=where)


def point(field: str, value: object, *, size: int = 2, where: str = "") -> tuple[float, ...]:
    """Return `value` as a tuple of `size` finite floats, such as (x, y) in m."""
    parts = sequence(field, value, f"{size} finite numbers", size=size, where=where)
    return tuple(number(f"{field}[{i}]", part, where=where) for i, part in enumerate(parts))


def window(field: str, value: object, allowed: str = "(earliest, latest) in s") -> tuple[float, float]:
    """Return `value` as the earliest, >= 0, and the latest time of a service, s; the latest may be infinite."""
    parts = sequence(field, value, allowed, size=2)
    early, late = (number(field, part, infinite=True, unit="s") for part in parts)
    if early > late or late < 0.0 or early > 1e9:
        allowed = "an earliest time of at most 1e9 s and a latest no earlier, >= 0"
        raise BadParameter(field, (early, late), allowed)
    return max(early, 0.0), late


def raw(field: str, value: object, allowed: str) -> NDArray[Any]:
    """Return `value` as an array of any type and shape, which rows of different lengths are not."""
    try:
        return np.asarray(value)
    except ValueError:
        raise BadParameter(field, value, allowed) from None


def array(
    field: str,
    value: object,
    shape: tuple[int | None, ...],
    *,
    finite: bool = True,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
    error: type[BadInput] = BadParameter,
    where: str = "",
) -> NDArray[np.float64]:
    """Return `value` as a fresh read-only float64 array of `shape` (None: any length), with no number outside [low, high].

    All numbers are finite unless said otherwise.
    """
    wanted = "x".join("N" if n is None else str(n) for n in shape)
    try:
        if np.iscomplexobj(cast(Any, value)):
            raise TypeError  # NumPy would only warn that it drops the imaginary parts
        result = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise error(field, value, f"an array of numbers of shape {wanted}", where=where) from None
    if result.ndim != len(shape) or any(n is not None and n != m for n, m in zip(shape, result.shape)):
        raise error(f"{field}.shape", result.shape, wanted, where=where)
    if finite and not np.isfinite(result).all():
        raise error(field, float(result[~np.isfinite(result)][0]), "finite throughout", where=where)
    outside = (result < low) | (result > high)
    if outside.any():
        allowed = f"numbers{_range(low, high, False)}{f' ({unit})' if unit else ''}"
        raise error(field, float(result[outside][0]), allowed, where=where)
    result.flags.writeable = False
    return result


def _range(low: float, high: float, open_low: bool) -> str:
    if math.isinf(low) and math.isinf(high):
        return ""
    if math.isinf(high):
        return f" {'>' if open_low else '>='} {_end(low)}"
    if math.isinf(low):
        return f" <= {_end(high)}"
    return f" in {'(' if open_low else '['}{_end(low)}, {_end(high)}]"


def _end(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"
