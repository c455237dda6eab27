"""The results file: an SQLite database with a row for each episode, written so that nothing finished is lost."""

from __future__ import annotations

import csv
import hashlib
import json
import math
import sqlite3
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, astuple, dataclass, fields
from os import PathLike
from pathlib import Path
from typing import Any

from antway import checks
from antway.errors import BadParameter, BadResults
from antway.world.tracefile import MAX_BYTES
from antway.writing import writing

EXPORTS = ("csv", "json", "parquet")
APPLICATION = 0x616E7477  # "antw"; application id that SQLite stores in the file
SCHEMA = 2  # version of the table; files of version 1 are converted when they are opened for writing
_RENAMED = {"flips": "side_changes", "survival": "difficulty"}  # old and new names of columns of version 1
Key = tuple[str, str, str, int, str]  # suite, episode, policy, seed, version


@dataclass(frozen=True, slots=True)
class Row:
    """The result of one episode under one policy; missing numbers are NaN. The first five fields are the key.

    Raises
    ------
    BadParameter
        For a seed or a number of times that is no integer in [0, 2**63 - 1].
    """

    suite: str
    episode: str
    policy: str
    seed: int
    version: str  # of antway
    group: str  # kind of episode; statistics are made for each group
    outcome: str  # value of `Outcome`
    reason: str  # a sentence about the outcome
    time: float = math.nan  # s
    length: float = math.nan  # m
    clearance: float = math.nan  # m; smallest distance to a moving obstacle; infinite if there are none
    discomfort: float = math.nan  # s; time spent nearer than 0.2 m to an obstacle
    side_changes: int = 0  # changes of the side on which an obstacle is passed
    replans: int = 0  # changes of plan
    waits: int = 0  # stops
    jerk: float = math.nan  # m/s^3; root mean square
    bound: float = math.nan  # this and the next two: `antway.arena.suites.Facts`
    shortest: float = math.nan
    difficulty: float = math.nan
    cycle_p50: float = math.nan  # ms; time of a control cycle; these columns alone differ between two runs of an episode
    cycle_p99: float = math.nan
    cycle_max: float = math.nan

    def __post_init__(self) -> None:
        checks.counts(self, "seed", "side_changes", "replans", "waits", low=0)  # such as SQLite can hold
        for f in fields(self):
            if f.type == "float":
                object.__setattr__(self, f.name, float(getattr(self, f.name)) + 0.0)  # SQLite knows no -0.0

    @property
    def key(self) -> Key:
        """The five columns that identify the row."""
        return self.suite, self.episode, self.policy, self.seed, self.version

    @property
    def reached(self) -> bool:
        """Whether the goal was reached."""
        return self.outcome == "reached"


COLUMNS = tuple(f.name for f in fields(Row))
_KINDS = {"str": "TEXT NOT NULL", "int": "INTEGER NOT NULL", "float": "REAL"}
_NAMES = ", ".join(f'"{name}"' for name in COLUMNS)
_KEY = "suite, episode, policy, seed, version"
_WITH_KEY = "suite = ? AND episode = ? AND policy = ? AND seed = ? AND version = ?"
_TABLE = (
    "CREATE TABLE episodes ("
    + ", ".join(f'"{f.name}" {_KINDS[str(f.type)]}' for f in fields(Row))
    + f", digest BLOB NOT NULL, trace BLOB, PRIMARY KEY ({_KEY}))"
)


class Results:
    """An open results file, created if it does not exist.

    Parameters
    ----------
    path : str or Path
    write : bool
        Whether rows will be added; if not, the file must exist and is not changed.

    Raises
    ------
    BadResults
        If the file is not a results file, has another schema, is damaged, or cannot be written. Nothing is overwritten.
    """

    def __init__(self, path: str | Path, *, write: bool = True) -> None:
        named = isinstance(path, (str, PathLike)) and "\0" not in str(path)
        if not named or (not write and not Path(path).is_file()):
            raise BadResults("results", str(path), "the name of a file" if write else "an existing file")
        self.path, self.write = Path(path), write
        with self._refusals():
            mode = "rwc" if write else "ro"
            if not write and not Path(f"{self.path}-wal").exists():  # nobody writes, so that SQLite need not lock or make files
                mode += "&immutable=1"
            uri = f"{self.path.absolute().as_uri()}?mode={mode}"
            self.db = sqlite3.connect(uri, uri=True, timeout=60.0, isolation_level=None)
            try:
                self._open()
            except BaseException:
                self.db.close()
                raise

    def _open(self) -> None:
        ids = [self.db.execute(f"PRAGMA {name}").fetchone()[0] for name in ("application_id", "user_version", "schema_version")]
        if self.write and ids == [0, 0, 0] and self.path.stat().st_size != 1:  # SQLite takes one byte for an empty file
            self.db.execute("PRAGMA journal_mode = WAL")
            self.db.execute("BEGIN IMMEDIATE")
            if not self.db.execute("PRAGMA schema_version").fetchone()[0]:
                self.db.execute(_TABLE)
                self.db.execute(f"PRAGMA application_id = {APPLICATION}")
                self.db.execute(f"PRAGMA user_version = {SCHEMA}")
            self.db.execute("COMMIT")
            ids = [APPLICATION, SCHEMA, 1]
        if ids[0] != APPLICATION:
            raise self._bad("a results file of antway")
        if ids[1] == 1 and self.write:
            self._bring_up_to_date()
        elif ids[1] == 1:
            this = "this one is of schema 1, which opening it for writing brings up to date"
            raise self._bad(f"a results file of schema {SCHEMA}; {this}")
        elif ids[1] != SCHEMA:
            raise self._bad(f"a results file of schema {SCHEMA}; this one is of schema {ids[1]}")
        if self.write:
            fault = self.db.execute("PRAGMA quick_check(1)").fetchone()[0]
            if fault != "ok":
                raise self._bad(f"undamaged; {fault}")
            self.rows()

    def _bring_up_to_date(self) -> None:
        """Rename the columns of a file of schema 1; its rows do not change."""
        self.db.execute("BEGIN IMMEDIATE")
        try:
            if self.db.execute("PRAGMA user_version").fetchone()[0] == 1:  # another process may have done it meanwhile
                for old, new in _RENAMED.items():
                    self.db.execute(f'ALTER TABLE episodes RENAME COLUMN "{old}" TO "{new}"')
                self.db.execute(f"PRAGMA user_version = {SCHEMA}")
            self.db.execute("COMMIT")
        except sqlite3.Error:
            self.db.execute("ROLLBACK")
            raise

    def __enter__(self) -> Results:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the file."""
        self.db.close()

    def add(self, row: Row, trace: str = "") -> None:
        """Write a finished row and the JSON of its trace, if there is one; an existing row with the same key is kept.

        Raises
        ------
        BadResults
            If it cannot be written, for example because the disk is full. Earlier rows remain.
        """
        values = astuple(checks.instance("row", row, Row))
        packed = zlib.compress(trace.encode(), 6) if trace else None
        marks = ", ".join("?" * (len(COLUMNS) + 2))
        with self._refusals():
            self.db.execute(
                f"INSERT OR IGNORE INTO episodes ({_NAMES}, digest, trace) VALUES ({marks})", (*values, _digest(values), packed)
            )

    def has(self, key: Key) -> bool:
        """Tell whether there is a row with that key."""
        query = f"SELECT 1 FROM episodes WHERE {_WITH_KEY}"
        with self._refusals():
            return self.db.execute(query, key).fetchone() is not None

    def rows(self) -> list[Row]:
        """Return all rows, sorted by key.

        Raises
        ------
        BadResults
            If a row is damaged.
        """
        found = []
        with self._refusals():
            for *values, digest in self.db.execute(f"SELECT {_NAMES}, digest FROM episodes ORDER BY {_KEY}"):
                values = [math.nan if value is None else value for value in values]
                if _digest(values) != digest:
                    raise self._bad(f"undamaged; the row of {values[:3]} is not as it was written")
                found.append(Row(*values))
        return found

    def trace(self, key: Key) -> str:
        """Return the JSON of that row's trace; empty if none was kept."""
        query = f"SELECT trace FROM episodes WHERE {_WITH_KEY}"
        with self._refusals():
            found = self.db.execute(query, key).fetchone()
        if found is None or found[0] is None:
            return ""
        try:
            unpacked = zlib.decompressobj()
            text = unpacked.decompress(found[0], MAX_BYTES).decode()
            if not unpacked.eof:
                raise zlib.error
        except (zlib.error, UnicodeDecodeError):
            raise self._bad(f"undamaged; the trace of {key[:3]} is not, or has more than {MAX_BYTES} bytes") from None
        return text

    @contextmanager
    def _refusals(self) -> Iterator[None]:
        """Turn errors of SQLite, and of keys that it cannot hold, into `BadResults`."""
        try:
            yield
        except (sqlite3.Error, UnicodeEncodeError, OverflowError) as error:
            raise self._bad(f"a results file that can be used; SQLite says: {error}") from None

    def _bad(self, allowed: str) -> BadResults:
        """Return the error that this file must be as `allowed` says."""
        return BadResults("results", str(self.path), allowed)


def export(rows: list[Row], path: str | Path) -> Path:
    """Write rows to a .csv, .json or .parquet file (the last needs pyarrow); return its path.

    In JSON, which has no such numbers, NaN is null and an infinite number is the text "inf" or "-inf".

    Raises
    ------
    BadParameter
        For another suffix, Parquet without pyarrow, or a file that cannot be written.
    """
    with writing("export", path, [f".{kind}" for kind in EXPORTS]) as target:
        kind = target.suffix.lower()
        if kind == ".csv":
            with target.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow(COLUMNS)
                writer.writerows(astuple(row) for row in rows)
        elif kind == ".json":
            plain = [{name: _plain(value) for name, value in asdict(row).items()} for row in rows]
            target.write_text(json.dumps(plain, indent=1, allow_nan=False) + "\n", encoding="utf-8")
        else:
            try:
                import pyarrow
                from pyarrow import parquet
            except ImportError:
                raise BadParameter("export", str(path), "a .csv or .json file, or install pyarrow") from None
            parquet.write_table(pyarrow.table({name: [getattr(row, name) for row in rows] for name in COLUMNS}), target)
    return target


def _plain(value: Any) -> Any:
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return None if math.isnan(value) else str(value)


def _digest(values: Any) -> bytes:
    """Return a checksum of the values of a row, because SQLite has none."""
    return hashlib.blake2b(repr(list(values)).encode(), digest_size=8).digest()
