"""Files of stops: tables of comma-separated values with one stop in each line."""

from __future__ import annotations

import csv
import io
import math
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

from antway import checks
from antway.errors import BadMap, BadParameter, TooLarge
from antway.maps.limits import as_path
from antway.reading import read_text
from antway.tours.distances import stop_distances
from antway.tours.stops import MAX_STOPS
from antway.tours.task import TourTask
from antway.writing import writing

MAX_BYTES = 2_000_000
COLUMNS = ("x", "y", "name", "earliest", "latest", "service", "priority")


@dataclass(frozen=True, slots=True)
class StopFile:
    """The content of a file of stops, named as the arguments of `plan_tour`."""

    stops: tuple[tuple[float, float], ...]  # (x, y), m
    names: tuple[str, ...]
    windows: tuple[tuple[float, float], ...]  # (earliest, latest), s
    service: tuple[float, ...]  # s
    priorities: tuple[float, ...] | None  # None if no stop has one

    def arguments(self) -> dict[str, Any]:
        """Return everything except the stops, as keyword arguments of `plan_tour`."""
        return {"names": self.names, "windows": self.windows, "service": self.service, "priorities": self.priorities}


def load_stops(path: str | PathLike[str]) -> StopFile:
    """Read a file of stops: a heading and one stop in each line.

    The columns are x and y (m) and, optionally, name, earliest and latest (the window for the start of service, s), service (s)
    and priority, in any order. Entries may be empty; an empty priority is 1 if another stop has one. Without a heading the
    columns are x and y. Lines that start with # are comments.

    Raises
    ------
    BadMap, BadParameter, TooLarge
        The error names file, line and column.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> file = pathlib.Path(tempfile.mkdtemp()) / "stops.csv"
    >>> _ = file.write_text("name,x,y,latest\\nward 1,2.0,3.5,60\\n")
    >>> load_stops(file).windows
    ((0.0, 60.0),)
    """
    file = as_path(path)
    text = read_text(file, MAX_BYTES)
    try:
        # Comments go first: quotes in them mean nothing, and a quoted name may begin with #.
        lines = csv.reader(("\n" if line.lstrip().startswith("#") else line for line in io.StringIO(text)), strict=True)
        rows = [(lines.line_num, [entry.strip() for entry in row]) for row in lines if any(entry.strip() for entry in row)]
    except csv.Error as fault:
        raise BadMap("file", file.name, f"comma-separated values in UTF-8 ({fault})", where=str(file)) from None
    columns = _columns(rows[0][1], f"{file}:{rows[0][0]}") if rows else []
    if columns:
        rows = rows[1:]
    if not rows:
        raise BadMap("stops", 0, "one stop or more", where=str(file))
    if len(rows) > MAX_STOPS - 2:
        raise TooLarge("stops", len(rows), f"at most {MAX_STOPS - 2} stops", where=str(file))
    stops = [_stop(columns or ["x", "y"], row, f"{file}:{number}") for number, row in rows]
    priorities = [one["priority"] for one in stops]
    return StopFile(
        tuple((one["x"], one["y"]) for one in stops),
        tuple(one["name"] or f"stop {i}" for i, one in enumerate(stops)),
        tuple((one["earliest"], one["latest"]) for one in stops),
        tuple(one["service"] for one in stops),
        tuple(1.0 if one is None else one for one in priorities) if priorities != [None] * len(stops) else None,
    )


def _columns(heading: list[str], where: str) -> list[str]:
    """Return the names of the columns; empty if the first line is a stop."""
    try:
        float(heading[0])
        return []
    except ValueError:
        pass
    names = [name.lower() for name in heading]
    for name in names:
        checks.choice("column", name, COLUMNS, error=BadMap, where=where)
        if names.count(name) > 1:
            raise BadMap("column", name, "given once", where=where)
    for name in ("x", "y"):
        if name not in names:
            raise BadMap("columns", ",".join(names), "x, y and more", where=where)
    return names


def _stop(columns: list[str], row: list[str], where: str) -> dict[str, Any]:
    if len(row) != len(columns):
        raise BadMap("entries", len(row), f"{len(columns)}: {', '.join(columns)}", where=where)
    defaults: dict[str, Any] = {"name": "", "earliest": 0.0, "latest": math.inf, "service": 0.0, "priority": None}
    for name, text in zip(columns, row):
        if name == "name":
            defaults[name] = text
        elif text or name in ("x", "y"):
            try:
                value = float(text)
            except ValueError:
                raise BadParameter(name, text, "a number", where=where) from None
            low, open_end = -1e9 if name in ("x", "y", "earliest") else 0.0, name == "latest"
            high = math.inf if open_end else 1e9
            defaults[name] = checks.number(name, value, low=low, high=high, infinite=open_end, where=where)
    if defaults["latest"] < defaults["earliest"]:
        raise BadParameter("latest", defaults["latest"], f"no earlier than earliest, {defaults['earliest']:g} s", where=where)
    return defaults


def save_distances(task: TourTask, path: Path) -> None:
    """Write a table of the exact distances, in m, among start, stops and a separate end, with their names.

    With a cost map they are the least costs, in m at the cost 1.
    """
    free, cells = task.places()
    away = stop_distances(free, cells, task.moves, costs=task.costs)
    names = ["start", *task.names, *["end"] * (len(cells) - 1 - len(task.names))]
    with writing("distances", path), path.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(["", *names])
        table.writerows([name, *row] for name, row in zip(names, away.tolist(), strict=True))
