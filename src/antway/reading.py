"""Reads files from others within fixed limits of time and memory.

`opened` limits the bytes read, `Unpacked` the bytes unpacked, `check_nesting` and `check_yaml` the depth and number of lists.
Numbers in text are read block by block, so that these limits bound the memory, too. docs/limits.md lists all limits.
"""

from __future__ import annotations

import os
import re
import resource
import stat
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import Any, BinaryIO

import numpy as np
import yaml
from numpy.typing import NDArray

from antway.errors import BadInput, BadMap, BadScenario, TooLarge
from antway.limits import MAX_DEPTH, MAX_LISTS, MAX_TABLES

# Keys of many dotted parts. It starts at the start of a word and never goes back, so that its time grows with the text alone.
_DOTTED = re.compile(rf"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){{{MAX_DEPTH},}}")
# The head of a table, whose name may be quoted; lists have commas.
_TABLE = re.compile(
    r"""^[ \t]*\[{1,2}(?:[^\],\n"']++|"(?:[^"\\\n]++|\\.)*+"|'[^'\n]*+')*+\]{1,2}[ \t]*(?:\#.*)?$""", re.MULTILINE
)
# Brackets, and what hides them: strings and comments of JSON and TOML; a string without an end hides all that follows.
_BRACKETS = re.compile(
    r"""\"{3}(?:[^\\]|\\.)*?(?:\"{3,5}|\Z)|'{3}.*?(?:'{3,5}|\Z)|"(?:[^"\\\n]++|\\.)*+"?|'[^'\n]*+'?|\#[^\n]*+|[\[\]{}]""",
    re.DOTALL,
)
_PLAIN_TAG = re.compile(r"tag:yaml\.org,2002:(str|int|float|bool|seq|map|null)")
_SPACE = re.compile(rb"\s")
_BLOCK = 2**20  # bytes of text that are split into words at once


@contextmanager
def opened(path: Path, most: int, *, error: type[BadInput] = BadMap, field: str = "file") -> Iterator[tuple[BinaryIO, int]]:
    """Open the regular file `path` of at most `most` bytes; yield the file and its size in bytes.

    What does not exist, cannot be read, or is a folder, pipe or device is an `error`, and none of these blocks.
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
    except BadInput:
        raise
    except (OSError, ValueError) as fault:
        raise error(field, path.name, f"a readable file ({getattr(fault, 'strerror', None) or fault})", where=where) from None


def read_bytes(path: Path, most: int, *, error: type[BadInput] = BadMap, field: str = "file") -> bytes:
    """Return the content of the regular file `path`, at most `most` bytes even if the file grows meanwhile."""
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
        allowed = f"text in UTF-8 ({fault.reason} at byte {fault.start})"
        raise error(field, PurePath(where).name or data[:40], allowed, where=where) from None


def read_text(path: Path, most: int, *, error: type[BadInput] = BadMap, field: str = "file") -> str:
    """Return the UTF-8 text of the regular file `path` of at most `most` bytes."""
    return decoded(read_bytes(path, most, error=error, field=field), str(path), error=error, field=field)


def count_lists(text: str) -> int:
    """Return how many brackets open lists and tables in JSON or TOML, also in strings."""
    return text.count("[") + text.count("{")


def check_nesting(text: str, depth: int, lists: int, where: str) -> None:
    """Raise `TooLarge` for JSON or TOML with brackets nested deeper than `depth`, or, also in strings, more than `lists`."""
    found = count_lists(text)
    if found > lists:
        raise TooLarge("lists and tables", found, f"at most {lists}", where=where)
    now = deepest = 0
    for part in _BRACKETS.finditer(text):
        if part[0] in "[]{}":
            now = now + 1 if part[0] in "[{" else max(now - 1, 0)
            deepest = max(deepest, now)
    if deepest > depth:
        raise TooLarge("depth", deepest, f"at most {depth} brackets within brackets", where=where)


def read_toml_file(path: Path, most: int, field: str) -> dict[str, Any]:
    """Return the content of a TOML file of at most `most` bytes; a `BadScenario` names `field` and the file.

    Its depth is limited: the parser recurses, and its time is quadratic in the number of parts of a key.
    """
    where = str(path)
    text = read_text(path, most, error=BadScenario, field=field)
    deep = _DOTTED.search(text)
    if deep:
        raise TooLarge("key", deep[0], f"of at most {MAX_DEPTH} dotted parts", where=where)
    check_nesting(text, MAX_DEPTH, MAX_LISTS, where)
    tables = sum(1 for _ in _TABLE.finditer(text))
    if tables > MAX_TABLES:
        raise TooLarge("tables", tables, f"at most {MAX_TABLES} tables with heads", where=where)
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadScenario(field, path.name, f"a TOML file ({error})", where=where) from None


def check_yaml(data: bytes, where: str, *, events: int, depth: int, aliases: int, error: type[BadInput] = BadMap) -> list[str]:
    """Parse YAML without making objects, and return its scalars.

    What is not well-formed, or has tags that ask for objects, is an `error`; more events, nested lists or references than
    allowed are `TooLarge`, because a few references can expand to endless values.
    """
    letters = np.frombuffer(data, dtype=np.uint8)
    nested = np.cumsum(np.isin(letters, list(b"[{")).astype(np.int64) - np.isin(letters, list(b"]}")))
    if nested.max(initial=0) > depth:  # the time of parsers is quadratic in the depth
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
        raise error("YAML", PurePath(where).name, f"well-formed ({' '.join(str(fault).split())})", where=where) from None
    return scalars


def word_blocks(data: bytes, block: int = _BLOCK) -> Iterator[list[bytes]]:
    """Yield the words of `data`, which white space separates, in lists from about `block` bytes each."""
    at = 0
    while at < len(data):
        gap = _SPACE.search(data, at + block)
        end = gap.end() if gap else len(data)
        yield data[at:end].split()
        at = end


def numbers_in(data: bytes, most: int, where: str, *, field: str = "numbers") -> NDArray[np.float64]:
    """Return the numbers in `data`, separated by white space, float64[N]; more than `most`, or anything else, is a `BadMap`."""
    parts, count = [np.empty(0)], 0
    for words in word_blocks(data):
        count += len(words)
        if count > most:
            raise BadMap(field, f"more than {most}", f"at most {most} numbers", where=where)
        try:
            if any(b"_" in word for word in words):
                raise ValueError("an underscore")  # Python would accept it in numbers
            parts.append(np.array([float(word) for word in words]))
        except ValueError as fault:
            raise BadMap(field, str(fault), "numbers alone", where=where) from None
    return np.concatenate(parts)


class Unpacked:
    """Counts the bytes unpacked from all parts of one input together."""

    def __init__(self, most: int, where: str = "") -> None:
        self.left = self.most = most
        self.where = where

    def take(self, field: str, size: int) -> None:
        """Count `size` bytes before they are unpacked; raise `TooLarge` if they are more than are left."""
        if size > self.left:
            allowed = f"at most {self.most} bytes unpacked in all, of which {self.left} are left"
            raise TooLarge(field, f"{size} bytes", allowed, where=self.where)
        self.left -= size


def limit_process(memory: int, *, file: int | None = None) -> None:
    """Limit this process to `memory` bytes more than it has now, and each file that it writes to `file` bytes.

    Nothing is limited if the system does not report the memory of a process, as on macOS. A crash writes no core dump.
    """
    if not os.path.exists("/proc/self/statm"):
        return
    with open("/proc/self/statm", encoding="ascii") as about:
        pages = int(about.read().split()[0])
    most = pages * resource.getpagesize() + memory
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    if file is not None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (file, file))
