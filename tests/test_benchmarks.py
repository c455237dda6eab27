"""Every benchmark program starts: what it imports is still there, and its options can be read."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"
SHARED = {"report", "peers"}  # modules for the programs
IN_ROS = {"ros_rate"}  # starts in the environment of ROS 2 alone
PROGRAMS = sorted(file.stem for file in FOLDER.glob("*.py") if file.stem not in SHARED | IN_ROS)
START = """
import contextlib, io, json, runpy, sys, traceback
_, folder, *names = sys.argv
found, paths = {}, sys.path[1:]
for name in names:
    sys.argv, sys.path, said, status = [f"{folder}/{name}.py", "--help"], [folder, *paths], io.StringIO(), None
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            runpy.run_path(sys.argv[0], run_name="__main__")
        except SystemExit as end:
            status = end.code or 0
        except BaseException:
            traceback.print_exc()
    found[name] = status, said.getvalue()
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def started() -> dict[str, tuple[int | None, str]]:
    """The status and the words of each program under --help, all in one process: what they import takes a second each time."""
    command = [sys.executable, "-c", START, str(FOLDER), *PROGRAMS]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    return json.loads(ran.stdout.splitlines()[-1])  # type: ignore[no-any-return]


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_benchmark_starts(program: str, started: dict[str, tuple[int | None, str]]) -> None:
    status, said = started[program]
    assert status == 0, said
    assert "usage:" in said.lower()
