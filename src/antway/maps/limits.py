"""Every limit on the size of a map file."""

from __future__ import annotations

from dataclasses import dataclass, fields
from os import PathLike
from pathlib import Path

from antway import checks
from antway.errors import BadMap, TooLarge

HEAD = 2**16  # bytes in which the header of a map file must end


@dataclass(frozen=True, slots=True)
class Limits:
    """How large a map may be. Each limit is checked before memory is allocated for what it limits.

    Parameters
    ----------
    cells : int
        Rows times columns.
    file_bytes : int
        Size of a map or scenario file.
    yaml_bytes, yaml_events, yaml_depth, yaml_aliases : int
        Size of the description of a ROS map: bytes, parser events, nesting depth, references.
    rows : int
        Rows of a MovingAI scenario file.

    Examples
    --------
    >>> Limits(cells=100).cells
    100
    """

    cells: int = 2**25
    file_bytes: int = 2**28
    yaml_bytes: int = 2**16
    yaml_events: int = 4000
    yaml_depth: int = 16
    yaml_aliases: int = 8
    rows: int = 2**18

    def __post_init__(self) -> None:
        checks.counts(self, *(field.name for field in fields(self)), low=1)

    def check_shape(self, rows: int, cols: int, where: Path) -> None:
        """Raise `BadMap` for a map without cells and `TooLarge` for one with more than `cells`."""
        if rows < 1 or cols < 1:
            raise BadMap("height x width", (rows, cols), "at least 1 x 1", where=str(where))
        if rows * cols > self.cells:
            allowed = f"at most {self.cells} cells (limits=Limits(cells=...) allows more)"
            raise TooLarge("height x width", (rows, cols), allowed, where=str(where))


DEFAULT = Limits()


def as_path(value: str | PathLike[str]) -> Path:
    """Return `value` as a path, or raise `BadMap`."""
    try:
        return Path(value)
    except TypeError:
        raise BadMap("path", value, "a path") from None
