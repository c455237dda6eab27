"""Where compiled kernels are kept, and whether a kernel is there. It does not import Numba, so it answers at once."""

from __future__ import annotations

import hashlib
import os
import re
import sys
import tempfile
from functools import cache
from pathlib import Path

from antway.version import __version__

_IMPORT = re.compile(r"^from (antway[\w.]*) import (\([^)]*\)|[^\n]*)", re.MULTILINE)


def _writable(folder: Path, mine: bool = True) -> bool:
    """Tell whether `folder` can be written to and, if `mine`, belongs to this user; it is made if it does not exist."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return not mine or folder.stat().st_uid == os.getuid()
    except (OSError, RuntimeError):
        return False


def cache_folder() -> str:
    """Return the folder that keeps compiled kernels: beside the package, else among the user's caches, else a temporary one.

    In a checkout, and where NUMBA_CACHE_DIR is set to a folder that can be written to, the answer is "": Numba chooses.
    """
    package, chosen = Path(__file__).parents[2], os.environ.get("NUMBA_CACHE_DIR")
    if chosen and _writable(Path(chosen), mine=False):
        return ""
    if not chosen and (package.parents[1] / "pyproject.toml").is_file() and _writable(package / "__pycache__"):
        return ""
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    folders = (
        package / "__pycache__" / f"kernels-{__version__}",
        Path(caches) / "antway" / __version__,
        Path(tempfile.gettempdir()) / f"antway-{os.getuid()}" / __version__,
    )
    return str(next((folder for folder in folders if _writable(folder)), None) or tempfile.mkdtemp(prefix="antway-"))


@cache
def _source(path: Path) -> tuple[bytes, list[Path]]:
    """Return a hash of a file of kernels, and the files of antway that it imports."""
    text, top = path.read_text(encoding="utf-8"), Path(__file__).parents[2]
    found = []
    for module, names in _IMPORT.findall(text):
        place = top.joinpath(*module.split(".")[1:])
        parts = [place.with_suffix(".py"), *(place / f"{name}.py" for name in re.findall(r"\w+", names))]
        found += [part for part in parts if part.is_file()]
    return hashlib.blake2b(text.encode()).digest(), found


@cache
def source_stamp(file: str) -> bytes:
    """Return a hash of a kernel's file and all files of antway that it imports, whose kernels become part of its code.

    Numba looks at the kernel's own file alone, and would go on with code from before a kernel that it calls was changed.
    """
    known: dict[Path, bytes] = {}
    left = [Path(file)]
    while left:
        path = left.pop()
        if path not in known:
            known[path], imported = _source(path)
            left += imported
    return hashlib.blake2b(b"".join(known[path] for path in sorted(known))).digest()


def is_compiled(folder: str, kernel: str) -> bool:
    """Tell whether this version of Python has compiled a kernel, "file.function" of a folder of kernels, and kept it.

    Examples
    --------
    >>> is_compiled("search", "astar.no_such_kernel")
    False
    """
    where = cache_folder() or os.environ.get("NUMBA_CACHE_DIR") or str(Path(__file__).parents[1] / folder / "__pycache__")
    name = f"{kernel}-*.py{sys.version_info.major}{sys.version_info.minor}*.nbi"
    return any(Path(where).rglob(name))
