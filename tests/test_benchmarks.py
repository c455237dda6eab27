"""Every benchmark program starts: what it imports is still there, and its options can be read."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"
SHARED = {"report", "peers"}  # modules for the programs
IN_ROS = {"ros_rate"}  # starts in the environment of ROS 2 alone
PROGRAMS = sorted(file.stem for file in FOLDER.glob("*.py") if file.stem not in SHARED | IN_ROS)


@pytest.mark.parametrize("program", PROGRAMS)
def test_a_benchmark_starts(program: str) -> None:
    ran = subprocess.run([sys.executable, FOLDER / f"{program}.py", "--help"], capture_output=True, text=True, timeout=120)
    assert ran.returncode == 0, ran.stderr
    assert "usage:" in ran.stdout.lower()
