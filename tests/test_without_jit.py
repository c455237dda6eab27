"""C7: kernels and their naive twins agree also where nothing is compiled, so that the code is right and not its compilation."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

TWINS = {
    "test_crossing_kernels": "sampling_finds or earliest_departure or gap_to_reach or motions_keep_clear or textbook",
    "test_dstarlite": "exact_after_every_change",
    "test_front": "costs_to_go_are_the_fixed_point",
    "test_geometry": "against_samples or exact_touching",
    "test_neural": "glasius_comes",
    "test_persistence": "like_the_twin",
    "test_rules": "like_the_twin",
    "test_search": "naive_twin",
    "test_sipp": "against_samples or against_heap or against_naive or against_unit",
    "test_tour": "local_optima",
    "test_grid_walk": "naive_ant or retreats",
    "test_world": "drive_agrees",
}


def test_twins_agree_without_compilation() -> None:
    """The comparisons pass with NUMBA_DISABLE_JIT, at a twentieth of their size; unsigned arithmetic may wrap, as it does."""
    tests = Path(__file__).parent
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "--no-header",
            "-p",
            "no:cacheprovider",
            "-W",
            "ignore:overflow encountered:RuntimeWarning",
        ]
        + [str(tests / f"{name}.py") for name in TWINS]
        + ["-k", " or ".join(f"({name} and ({words}))" for name, words in TWINS.items())],
        cwd=tests.parent,
        env={**os.environ, "NUMBA_DISABLE_JIT": "1", "ANTWAY_TEST_SCALE": "0.05"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-2000:]
    assert done.stdout.count(".") >= 40
