"""MovingAI benchmark files (Sturtevant 2012): `.map` grids and `.scen` lists of problems with their optimal lengths."""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path
from typing import NamedTuple

from antway import checks
from antway.errors import BadMap, BadScenario, TooLarge
from antway.grid import Cell, Grid
from antway.maps import text
from antway.maps.limits import DEFAULT, HEAD, Limits, as_path
from antway.reading import decoded, opened

_HEADER = re.compile(rb"\s*type[ \t]+(\S{1,40})\s+height[ \t]+(\d{1,18})\s+width[ \t]+(\d{1,18})\s+map[ \t]*\n")


class ScenRow(NamedTuple):
    """One problem of a `.scen` file: cells are (row, col), `length` is in cells (1 and sqrt 2 a move, no corner cutting)."""

    bucket: int
    map: str
    width: int
    height: int
    start: Cell
    goal: Cell
    length: float


def read(path: Path, limits: Limits) -> Grid:
    """Read a `.map`: `.`, `G` and `S` are free; `@`, `O`, `T` (trees) and `W` (water) blocked."""
    with opened(path, limits.file_bytes) as (file, size):
        head = file.read(HEAD)
        found = _HEADER.match(text.unify(head))
        if found is None:
            allowed = "the lines 'type octile', 'height H', 'width W', 'map'"
            raise BadMap("header", head[:60], allowed, where=str(path))
        if found[1] not in (b"octile", b"tile"):
            raise BadMap("type", found[1].decode("latin-1"), "octile or tile", where=str(path))
        rows, cols = int(found[2]), int(found[3])
        limits.check_shape(rows, cols, path)
        if size < rows * cols:
            raise BadMap("size of the file", size, f"enough for {rows} lines of {cols} characters", where=str(path))
        if size > rows * (cols + 2) + HEAD:
            raise BadMap("size of the file", size, f"that of {rows} lines of {cols} characters", where=str(path))
        body = text.unify(head + file.read())[found.end() :].rstrip(b"\n")
    return Grid(text.cells(body, rows, cols, path))


def write(grid: Grid, path: Path) -> None:
    """Write `grid` as a `.map` of type octile."""
    rows, cols = grid.shape
    path.write_bytes(f"type octile\nheight {rows}\nwidth {cols}\nmap\n".encode() + text.drawn(grid))


def load_scen(path: str | PathLike[str], *, limits: Limits = DEFAULT) -> list[ScenRow]:
    """Read the problems of a MovingAI `.scen` file; its (x, y), x from the left and y from the top, become (row, col) = (y, x).

    Raises
    ------
    BadScenario
        For a file that is no such list; names the line and the field.
    TooLarge
        For more rows or bytes than `limits`.
    """
    path = as_path(path)
    checks.instance("limits", limits, Limits)
    where = str(path)
    with opened(path, min(limits.file_bytes, 256 * limits.rows), error=BadScenario) as (file, _):
        data = text.unify(file.read())
    rows = data.rstrip(b"\n").count(b"\n")
    if rows > limits.rows:
        raise TooLarge("rows", rows, f"at most {limits.rows}", where=where)
    first, *lines = decoded(data, where, error=BadScenario).split("\n")
    if re.fullmatch(r"version[ \t]+1(\.0*)?[ \t]*", first) is None:
        raise BadScenario("line 1", first, "'version 1'", where=where)
    return [_row(line, f"{where}, line {i}") for i, line in enumerate(lines, 2) if line.strip()]


def _row(line: str, where: str) -> ScenRow:
    line = line.strip("\t ")
    parts = line.split("\t") if line.count("\t") == 8 else line.split()
    if len(parts) != 9:
        allowed = "9: bucket, map, width, height, start x, y, goal x, y, length"
        raise BadScenario("number of fields", len(parts), allowed, where=where)
    bucket = _count("bucket", parts[0], 10**9, where)
    width, height = _count("width", parts[2], 10**9, where), _count("height", parts[3], 10**9, where)
    names = ("start x", "start y", "goal x", "goal y")
    x, y, u, v = (_count(n, part, (width, height)[i % 2] - 1, where) for i, (n, part) in enumerate(zip(names, parts[4:8])))
    if re.fullmatch(r"\d{1,300}(\.\d{0,300})?([eE][-+]?\d{1,3})?", parts[8], re.ASCII) is None:
        raise BadScenario("length", parts[8], "a number >= 0", where=where)
    length = checks.number("length", float(parts[8]), low=0.0, error=BadScenario, where=where)
    return ScenRow(bucket, parts[1], width, height, (y, x), (v, u), length)


def _count(field: str, value: str, high: int, where: str) -> int:
    if re.fullmatch(r"\d{1,12}", value, re.ASCII) is None or int(value) > high:
        raise BadScenario(field, value, f"an integer in [0, {high}]", where=where)
    return int(value)
