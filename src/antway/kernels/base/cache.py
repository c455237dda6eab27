"""Where compiled kernels are kept, and whether a kernel is there. It does not import Numba, so it answers at once."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path

from antway.version import __version__


def _writable(folder: Path) -> bool:
    """Tell whether `folder` belongs to this user and can be written to; it is made if it does not exist."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()
    except (OSError, RuntimeError):
        return False


def cache_folder() -> str:
    """Return the folder that keeps compiled kernels: beside the package, else among the user's caches, else a temporary one.

    The name contains the version, because Numba does not notice that a kernel called by another kernel has changed. In a
    checkout, and where NUMBA_CACHE_DIR is set, the answer is "": Numba chooses.
    """
    package = Path(__file__).parents[2]
    if os.environ.get("NUMBA_CACHE_DIR") or (
        (package.parents[1] / "pyproject.toml").is_file() and _writable(package / "__pycache__")
    ):
        return ""
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    user = os.getuid() if hasattr(os, "getuid") else 0
    folders = (
        package / "__pycache__" / f"kernels-{__version__}",
        Path(caches) / "antway" / __version__,
        Path(tempfile.gettempdir()) / f"antway-{user}" / __version__,
    )
    return str(next((folder for folder in folders if _writable(folder)), None) or tempfile.mkdtemp(prefix="antway-"))


def is_compiled(folder: str, kernel: str) -> bool:
    """Tell whether this version of Python has compiled a kernel, "file.function" of a folder of kernels, and kept it.

    Examples
    --------
    >>> is_compiled("search", "astar.no_such_kernel")
    False
    """
    where = os.environ.get("NUMBA_CACHE_DIR") or cache_folder() or str(Path(__file__).parents[1] / folder / "__pycache__")
    name = f"{kernel}-*.py{sys.version_info.major}{sys.version_info.minor}*.nbi"
    return any(Path(where).rglob(name))
