"""The one way in which files of others are read: what reading may cost is known beforehand, and is not exceeded.

Bytes taken in are bounded by `opened`, bytes unpacked by `Unpacked`, depth and number of lists by `check_nesting` and
`check_yaml`; numbers in text are read a block at a time, so that memory follows from these. The table of all limits is
docs/limits.md.
"""

from __future__ import annotations

import os
import re
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import yaml
from numpy.typing import NDArray

from antway.errors import BadInput, BadMap, TooLarge
from antway.limits import MAX_DEPTH, MAX_LISTS

_DOTTED = re.compile(rf"(?:[\w\"'-]+[ \t]*\.[ \t]*){{{MAX_DEPTH},}}")
_PLAIN_TAG = re.compile(r"tag:yaml\.org,2002:(str|int|float|bool|seq|map|null)")
_BLOCK = 2**20  # bytes of text that are split into words at a time


@contextmanager
def opened(path: Path, most: int, *, error: type[BadInput] = BadMap, field: str = "file") -> Iterator[tuple[BinaryIO, int]]:
    """Open the regular file `path` of at most `most` bytes; yields the file and its size in bytes.

    Raises
    ------
    error
        If there is no such file, it cannot be read, or it is a folder, pipe or device (none of which blocks).
    TooLarge
        If it is larger.
    """
    where = str(path)
    try:
        number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC | os.O_NOCTTY)
        try:
            info = os.fstat(number)
            if not stat.S_ISREG(info.st_mode):
                raise error(field, path.name, "a regular file, not a folder, pipe or device", where=where)
            if info.st_size > most:
                raise TooLarge("size of the file", info.st_size, f"at most {most} bytes", where=where)
            with os.fdopen(number, "rb", closefd=False) as file:
                yield file, info.st_size
        finally:
            os.close(number)
    except OSError as fault:
        raise error(field, path.name, f"a readable file ({fault.strerror or fault})", where=where) from None
    except ValueError as fault:
        if isinstance(fault, BadInput):
            raise
        raise error(field, path.name, f"a readable file ({fault})", where=where) from None


def is_file(path: Path) -> bool:
    """Tell whether there is a regular file `path`; False also for names that no file can have."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def is_folder(path: Path) -> bool:
    """Tell whether there is a folder `path`; False also for names that no folder can have."""
    try:
        return path.is_dir()
    except (OSError, ValueError):
        return False


def read_bytes(path: Path, most: int, *, error: type[BadInput] = BadMap, field: str = "file") -> bytes:
    """Return what the regular file `path` holds, at most `most` bytes, also of one that grows meanwhile."""
    with opened(path, most, error=error, field=field) as (file, _):
        data = file.read(most + 1)
    if len(data) > most:
        raise TooLarge("size of the file", len(data), f"at most {most} bytes", where=str(path))
    return data


def decoded(data: bytes, where: str, *, error: type[BadInput] = BadMap, field: str = "file") -> str:
    """Return `data` as text in UTF-8, without a byte order mark."""
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as fault:
        raise error(field, data[:40], f"text in UTF-8 ({fault.reason} at byte {fault.start})", where=where) from None


def read_text(path: Path, most: int, *, error: type[BadInput] = BadMap, field: str = "file") -> str:
    """Return the text in UTF-8 that the regular file `path` of at most `most` bytes holds."""
    return decoded(read_bytes(path, most, error=error, field=field), str(path), error=error, field=field)


def check_lines(data: bytes, most: int, where: str) -> None:
    """Raise `TooLarge` for text of more than `most` lines: each costs more memory than it has bytes."""
    lines = data.count(b"\n") + data.count(b"\r")
    if lines > most:
        raise TooLarge("lines", lines, f"at most {most}", where=where)


def check_nesting(text: str, depth: int, lists: int, where: str) -> None:
    """Raise `TooLarge` for JSON or TOML with more than `depth` brackets within brackets, or more than `lists` of them.

    Brackets within strings count as well.
    """
    found = text.count("[") + text.count("{")
    if found > lists:
        raise TooLarge("lists and tables", found, f"at most {lists}", where=where)
    now = deepest = 0
    for bracket in re.finditer(r"[\[\]{}]", text):
        now = now + 1 if bracket[0] in "[{" else max(now - 1, 0)
        deepest = max(deepest, now)
    if deepest > depth:
        raise TooLarge("depth", deepest, f"at most {depth} brackets within brackets", where=where)


def read_toml(text: str, where: str) -> dict[str, Any]:
    """Parse TOML that is not deep, for the time of the parser grows with the square of the parts of a key, and it recurses.

    Raises
    ------
    TooLarge, ValueError
    """
    deep = _DOTTED.search(text)
    if deep:
        raise TooLarge("key", deep[0], f"of at most {MAX_DEPTH} dotted parts", where=where)
    check_nesting(text, MAX_DEPTH, MAX_LISTS, where)
    return tomllib.loads(text)


def check_yaml(data: bytes, where: str, *, events: int, depth: int, aliases: int, error: type[BadInput] = BadMap) -> list[str]:
    """Parse YAML, without making objects of it; returns its scalars.

    Raises
    ------
    TooLarge
        If there are more pieces, lists within lists or references than this; few references can stand for endless values.
    error
        If it is not well-formed, or asks for objects by tags.
    """
    letters = np.frombuffer(data, dtype=np.uint8)
    nested = np.cumsum(np.isin(letters, list(b"[{")).astype(np.int64) - np.isin(letters, list(b"]}")))
    if nested.max(initial=0) > depth:  # parsers take a square of the depth before they say anything
        raise TooLarge("YAML depth", int(nested.max()), f"at most {depth}", where=where)
    deep = references = 0
    scalars = []
    try:
        for count, event in enumerate(yaml.parse(data, Loader=yaml.SafeLoader)):
            deep += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            references += isinstance(event, yaml.AliasEvent)
            for name, value, most in (
                ("YAML events", count, events),
                ("YAML depth", deep, depth),
                ("YAML aliases", references, aliases),
            ):
                if value > most:
                    raise TooLarge(name, value, f"at most {most}", where=where)
            tag = getattr(event, "tag", None)
            if tag not in (None, "!") and not _PLAIN_TAG.fullmatch(tag):
                raise error("YAML tag", tag, "none: plain YAML, which makes no objects", where=where)
            if isinstance(event, yaml.ScalarEvent):
                scalars.append(event.value)
    except BadInput:
        raise
    except (yaml.YAMLError, OverflowError, ValueError) as fault:
        raise error("YAML", str(fault), "well-formed", where=where) from None
    return scalars


def numbers_in(data: bytes, most: int, where: str, *, field: str = "numbers") -> NDArray[np.float64]:
    """Return the numbers in `data`, separated by white space, float64[N]; at most `most`, a block at a time.

    Raises
    ------
    BadMap
        If there are more than `most` numbers, or something else than numbers.
    """
    parts, count, at = [np.empty(0)], 0, 0
    space = re.compile(rb"\s")
    while at < len(data):
        gap = space.search(data, at + _BLOCK)
        end = gap.end() if gap else len(data)
        words = data[at:end].split()
        count, at = count + len(words), end
        if count > most:
            raise BadMap(field, f"more than {most}", f"at most {most} numbers", where=where)
        try:
            if any(b"_" in word for word in words):
                raise ValueError("an underscore")  # which Python takes within numbers
            parts.append(np.array([float(word) for word in words]))
        except ValueError as fault:
            raise BadMap(field, str(fault), "numbers alone", where=where) from None
    return np.concatenate(parts)


class Unpacked:
    """Counts bytes that are unpacked, of all parts of one input together."""

    def __init__(self, most: int, where: str = "") -> None:
        self.left = self.most = most
        self.where = where

    def take(self, field: str, size: int) -> None:
        """Note that `size` bytes are about to be unpacked; raises `TooLarge` if that is more than is left."""
        if size > self.left:
            allowed = f"at most {self.most} bytes unpacked in all, of which {self.left} are left"
            raise TooLarge(field, f"{size} bytes", allowed, where=self.where)
        self.left -= size


def limit_process(memory: int, *, file: int | None = None) -> None:
    """Limit this process to the memory that it has and `memory` bytes more, and each file that it writes to `file` bytes.

    Where the system does not say how much memory a process has, as on macOS, nothing is limited. A crash writes no dump.
    """
    if not os.path.exists("/proc/self/statm"):
        return
    import resource

    with open("/proc/self/statm", encoding="ascii") as about:
        pages = int(about.read().split()[0])
    most = pages * resource.getpagesize() + memory
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if file is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (file, file))
