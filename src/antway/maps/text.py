"""Maps as characters, one for each cell and one line for each row; the first line is row 0."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadMap, BadParameter
from antway.grid import Grid
from antway.maps.limits import Limits
from antway.reading import opened

FREE, BLOCKED = ".GS0_", "@OTW#X1"
_BAD = 2
_MEANING = np.full(256, _BAD, dtype=np.uint8)
_MEANING[[ord(c) for c in FREE]] = 0
_MEANING[[ord(c) for c in BLOCKED]] = 1


def read(path: Path, limits: Limits) -> Grid:
    """Read a text map: `.`, `G`, `S`, `0` and `_` are free, `@`, `O`, `T`, `W`, `#`, `X` and `1` blocked."""
    with opened(path, min(limits.file_bytes, 3 * limits.cells + 16)) as (file, _):
        body = unify(file.read()).rstrip(b"\n")
    first = body.find(b"\n")
    cols = len(body) if first < 0 else first
    rows = body.count(b"\n") + 1
    limits.check_shape(rows, cols, path)
    return Grid(cells(body, rows, cols, path))


def write(grid: Grid, path: Path) -> None:
    """Write `grid` with `.` for free and `@` for blocked cells."""
    path.write_bytes(drawn(grid))


def drawn(grid: Grid) -> bytes:
    """Return the cells of `grid` as characters, a line for each row."""
    rows, cols = grid.shape
    letters = np.full((rows, cols + 1), ord("\n"), dtype=np.uint8)
    letters[:, :cols] = np.where(grid.blocked, ord("@"), ord("."))
    return letters.tobytes()


def unify(data: bytes) -> bytes:
    """Drop a byte-order mark and make every line end with a line feed only."""
    return data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")


def cells(body: bytes, rows: int, cols: int, where: Path) -> NDArray[np.bool_]:
    """Read `rows` lines of `cols` characters, joined by line feeds, as bool[rows, cols], True where blocked."""
    letters = np.frombuffer(body + b"\n", dtype=np.uint8)
    sound = len(letters) == rows * (cols + 1) and bool((letters[cols :: cols + 1] == ord("\n")).all())
    if not sound or body.count(b"\n") != rows - 1:
        ends = np.flatnonzero(letters == ord("\n"))
        wrong = np.flatnonzero(np.diff(ends, prepend=-1) != cols + 1)
        if len(wrong):
            line = int(wrong[0])
            length = int(ends[line] - (ends[line - 1] if line else -1) - 1)
            raise BadMap(f"length of map line {line + 1}", length, f"the width, {cols}", where=str(where))
        if len(ends) != rows:
            raise BadMap("number of map lines", len(ends), f"the height, {rows}", where=str(where))
    meaning = _MEANING[letters.reshape(rows, cols + 1)[:, :cols]]
    if meaning.max() == _BAD:
        row, col = (int(i) for i in np.argwhere(meaning == _BAD)[0])
        letter = chr(letters[row * (cols + 1) + col])
        allowed = f"one of {' '.join(FREE)} (free) or {' '.join(BLOCKED)} (blocked)"
        raise BadMap(f"character {col + 1} of map line {row + 1}", letter, allowed, where=str(where))
    return meaning.astype(np.bool_)


def bare(grid: Grid, kind: str) -> None:
    """Refuse a grid with more than blocked cells, because formats of `kind` store nothing else."""
    if grid.resolution != 1.0:
        raise BadParameter("resolution", grid.resolution, f"1.0: {kind} keeps none; save as .yaml, or save Grid(grid.blocked)")
    if grid.origin != (0.0, 0.0, 0.0):
        raise BadParameter("origin", grid.origin, f"(0, 0, 0): {kind} keeps none; save as .yaml, or save Grid(grid.blocked)")
    if grid.unknown is not None and grid.unknown.any():
        raise BadParameter("unknown", int(grid.unknown.sum()), f"0 cells: {kind} keeps none; save as .yaml")
