"""Writes files: a path that cannot be written to is one `BadParameter`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path

from antway.errors import BadParameter

PICTURES = (".png", ".svg", ".pdf")
VIEWS = (".html", ".gif", ".mp4", *PICTURES)  # what an episode can be turned into


@contextmanager
def writing(field: str, path: str | PathLike[str], suffixes: Sequence[str] = ()) -> Iterator[Path]:
    """Yield `path` as a `Path`, for what writes there. Any other object or suffix, and a failure, is a `BadParameter`."""
    if not isinstance(path, (str, PathLike)) or "\0" in str(path):
        raise BadParameter(field, path, "a path")
    target = Path(path)
    if suffixes and target.suffix.lower() not in suffixes:
        raise BadParameter(field, target.name, f"a file name that ends in {', '.join(suffixes)}")
    try:
        yield target
    except OSError as fault:
        raise BadParameter(field, str(path), f"a path that can be written to ({fault.strerror or fault})") from None
    except UnicodeEncodeError as fault:
        raise BadParameter(field, str(path), f"a place for text in UTF-8 ({fault})") from None


def check_target(field: str, path: str | PathLike[str], suffixes: Sequence[str] = ()) -> Path:
    """Return `path` as a `Path`, before the work for it begins: a file with one of `suffixes`, without them a folder.

    Errors are those of `writing`, also if a file's folder does not exist, or a folder's place is taken by a file.
    """
    with writing(field, path, suffixes) as target:
        if suffixes:
            os.stat(f"{target.parent}/.")
        else:
            with suppress(FileNotFoundError):
                os.stat(f"{target}/.")
    return target
