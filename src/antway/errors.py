"""All errors: wrong input raises a `BadInput`; outcomes of a search are `Status` values, never exceptions.

A wrong value raises the same class wherever it comes from: an argument, a file, the command line, the page, a ROS message.
`BadMap` and `BadScenario` are for files and messages with a wrong structure: another format, parts that are missing, unknown,
repeated or inconsistent, and references to nothing.
"""

from __future__ import annotations

import math
import traceback
from functools import partial
from pathlib import Path
from typing import Self


class AntwayError(Exception):
    """Base class of all errors that antway raises on purpose.

    Examples
    --------
    >>> from antway import load_map
    >>> try:
    ...     load_map("offce")
    ... except AntwayError as error:
    ...     print(type(error).__name__)
    BadMap
    """


class BadInput(AntwayError, ValueError):
    """Input that antway refuses; the error names the field, its value and what is allowed.

    Parameters
    ----------
    field : str
        Name of the wrong argument, key or part of a file.
    value : object
        Its value; shortened in the message.
    allowed : str
        What is allowed, as the end of a sentence that starts with "must be".
    where : str
        File, line or call that contains the field, if any.

    Examples
    --------
    >>> str(BadParameter("resolution", -1.0, "a finite number > 0 (m per cell)"))
    'resolution = -1.0: must be a finite number > 0 (m per cell)'
    >>> str(BadParameter("start", (1.2345678901, 2.0), "inside the map"))
    'start = (1.23457, 2.0): must be inside the map'
    """

    def __init__(self, field: str, value: object, allowed: str, *, where: str = "") -> None:
        self.field, self.value, self.allowed, self.where = field, value, allowed, where
        super().__init__(field, value, allowed, where)

    def __str__(self) -> str:
        place = f"{self.where}: " if self.where else ""
        return f"{place}{_short(self.field, 200)} = {_short(_shown(self.value), 80)}: must be {self.allowed}"

    def at(self, where: str, field: str | None = None) -> Self:
        """Return the same error for the part `field` of the file, line or call `where`."""
        return type(self)(self.field if field is None else field, self.value, self.allowed, where=where)

    def __reduce__(self) -> tuple[object, ...]:
        return partial(type(self), where=self.where), (self.field, self.value, self.allowed)


def _short(text: str, most: int) -> str:
    """Return a text of at most about `most` characters: the first and the last ones of a longer one."""
    return text if len(text) <= most else text[: most - 20] + "..." + text[-15:]


def _shown(value: object) -> str:
    """Return a value for a message: numbers with six digits, unless that would turn a fraction into a whole number."""
    if isinstance(value, float) and math.isfinite(value):
        short = float(f"{value:.6g}")
        return repr(float(value) if short.is_integer() and short != value else short)
    if type(value) is tuple:
        return f"({', '.join(map(_shown, value))}{',' if len(value) == 1 else ''})"
    if type(value) is list and len(value) < 100:
        return f"[{', '.join(map(_shown, value))}]"
    try:
        return " ".join(repr(value).split())  # arrays are of several lines
    except ValueError:  # an integer of more digits than Python prints
        return f"<{type(value).__name__}>"


class BadMap(BadInput):
    """A map file or message that cannot be read as a map.

    Examples
    --------
    >>> from antway import load_map
    >>> load_map("offce")  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    antway.errors.BadMap: no such map
    """


class BadScenario(BadInput):
    """A scenario, track or trace that cannot be read, or whose parts do not fit together.

    Examples
    --------
    >>> from antway import load_scenario
    >>> load_scenario("ofice")  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    antway.errors.BadScenario: no such file or scene
    """


class BadResults(BadInput):
    """A file that is not a results file, is damaged, has another schema, or cannot be written."""


class BadParameter(BadInput):
    """A number, name or array that is not allowed.

    Examples
    --------
    >>> from antway import Budget
    >>> Budget(seconds=-1)
    Traceback (most recent call last):
    antway.errors.BadParameter: seconds = -1: must be a number >= 0 (s)
    """


class OutOfBounds(BadInput):
    """A cell or point outside the map.

    Examples
    --------
    >>> from antway import load_map
    >>> load_map("office").cell_at((-1.0, 3.0))  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    antway.errors.OutOfBounds: outside the map
    """


class CellBlocked(BadInput):
    """A start or goal in an obstacle.

    Examples
    --------
    >>> from antway import load_map, plan
    >>> plan(load_map("office"), (0.05, 0.05), (22.0, 12.5))  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    antway.errors.CellBlocked: the start is in a wall
    """


class TooLarge(BadInput):
    """An input that exceeds a limit of size; it is refused before memory is allocated for it.

    Examples
    --------
    >>> from antway import Grid, errors, limits
    >>> issubclass(TooLarge, errors.BadInput)
    True
    """


class InvalidPlan(AntwayError):
    """A plan or episode that breaks rules; it holds all violations found.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from antway import Problem, check_plan, load_map, solve
    >>> problem = Problem(load_map("office"), (30, 15), (125, 220))
    >>> check_plan(problem, replace(solve(problem), length=1.0))  # doctest: +IGNORE_EXCEPTION_DETAIL
    Traceback (most recent call last):
    antway.errors.InvalidPlan: the length is another one
    """

    def __init__(self, violations: list[str]) -> None:
        self.violations = tuple(violations)
        super().__init__("; ".join(violations))


def described_error(error: BaseException) -> str:
    """Return the message of an exception in one line, and the last frame of its traceback in a file.

    Examples
    --------
    >>> described_error(KeyError("no such door"))
    "KeyError: 'no such door'"
    """
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not frame.filename.startswith("<frozen")]
    where = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno}, in {frames[-1].name})" if frames else ""
    return f"{type(error).__name__}: {' '.join(str(error).split())}{where}"
