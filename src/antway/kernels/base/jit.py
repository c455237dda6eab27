"""The one way a kernel is compiled: cached on disk, without the global lock, IEEE arithmetic in program order."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
from numba import njit, typeof

from antway.version import __version__

F = TypeVar("F", bound=Callable[..., object])
config: Any = numba.config


def _writable(folder: Path) -> bool:
    """Tell whether `folder` is, or can be made, a folder of this user's alone to write to."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()
    except (OSError, RuntimeError):
        return False


def cache_folder() -> str:
    """Return the folder that keeps compiled kernels: beside the package, else among the user's caches, else a temporary one.

    Its name holds the version, for Numba does not notice that a kernel called by another one has changed. A checkout keeps
    Numba's own choice, "", as does whoever sets NUMBA_CACHE_DIR.
    """
    package = Path(__file__).parents[2]
    if config.CACHE_DIR or ((package.parents[1] / "pyproject.toml").is_file() and _writable(package / "__pycache__")):
        return ""
    caches = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    user = os.getuid() if hasattr(os, "getuid") else 0
    folders = (
        package / "__pycache__" / f"kernels-{__version__}",
        Path(caches) / "antway" / __version__,
        Path(tempfile.gettempdir()) / f"antway-{user}" / __version__,
    )
    return str(next((folder for folder in folders if _writable(folder)), None) or tempfile.mkdtemp(prefix="antway-"))


_CACHE = cache_folder()


def _compiled(function: F, **options: bool) -> F:
    before = config.CACHE_DIR
    config.CACHE_DIR = before or _CACHE  # for this kernel alone: other packages keep theirs where they did
    try:
        return cast(F, njit(cache=True, nogil=True, error_model="numpy", **options)(function))  # type: ignore[call-overload]
    finally:
        config.CACHE_DIR = before


def kernel(function: F) -> F:
    """Compile `function` with Numba at its first call; no fastmath, so that results are the same everywhere."""
    return _compiled(function)


def bare_kernel(function: F) -> F:
    """Compile `function` as `kernel` does, without counting references to arrays: that can be half the time of small helpers.

    For kernels that only read and write the arrays they are handed: Numba refuses to compile an allocation here.
    """
    return _compiled(function, _nrt=False)


def inner_kernel(function: F) -> F:
    """Compile `function` as `bare_kernel` does, always as a part of its caller: to hand over many arrays takes 200 cycles."""
    return _compiled(function, _nrt=False, forceinline=True)


_entries: dict[Any, Any] = {}


def entry(function: F, *sample: object) -> F:
    """Return the kernel `function` as compiled for arguments like these at its first use, to be called with such alone.

    An integer that comes where there was a float is taken as one; a float where there was an integer loses its fraction unsaid.
    A call of the kernel itself finds out the types of all arguments each time, at 0.2 us for each part of a tuple.
    """
    if function not in _entries:
        compiled = getattr(function, "compile", None)  # None where compiling is switched off (NUMBA_DISABLE_JIT)
        _entries[function] = compiled(tuple(map(typeof, sample))) if compiled else function
    return cast(F, _entries[function])
