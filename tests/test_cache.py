"""Where compiled kernels are kept: beside the package, among the user's caches, or in a temporary folder, never nowhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import antway

PROGRAM = """
from antway.kernels.base import jit
from antway.kernels.base.geometry import wrap
assert abs(wrap(7.0) - (7.0 - 2 * 3.141592653589793)) < 1e-12
print(jit.cache_folder())
"""


def run(package: Path, **environment: str) -> str:
    """Compile a kernel of the copy of the package in `package`; returns the folder that keeps it."""
    given = {"PATH": os.environ["PATH"], "PYTHONPATH": str(package), **environment}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A copy of the package as if it were installed, without what was compiled."""
    folder = tmp_path / "site"
    shutil.copytree(Path(antway.__file__).parent, folder / "antway", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def test_kernels_are_kept_by_version_beside_an_installed_package(installed: Path, tmp_path: Path) -> None:
    """A folder that can be written holds them, and its name the version: a new version finds none of the old one's."""
    folder = run(installed, HOME=str(tmp_path))
    assert folder == str(installed / "antway" / "__pycache__" / f"kernels-{antway.__version__}")
    assert list(Path(folder).rglob("*.nbi"))


def test_without_home_and_a_writable_package_kernels_are_kept_in_a_temporary_folder(installed: Path, tmp_path: Path) -> None:
    """As user nobody in a container: no RuntimeError, and compiled once, for the next process finds them."""
    (installed / "antway" / "__pycache__").write_text("a file where a folder would be: not even root can write in it")
    nowhere = tmp_path / "nowhere"
    nowhere.write_text("")
    folder = run(installed, HOME=str(nowhere), TMPDIR=str(tmp_path), PYTHONDONTWRITEBYTECODE="1")
    assert folder.startswith(str(tmp_path / "antway-"))
    assert list(Path(folder).rglob("*.nbi"))
    assert run(installed, HOME=str(nowhere), TMPDIR=str(tmp_path), PYTHONDONTWRITEBYTECODE="1") == folder
