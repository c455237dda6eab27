"""What the tests share: how large they run, where the test data lies, random grids."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from antway import Grid
from antway.kernels.base.records import Terrain
from antway.kernels.controls.abreast import judge_all
from antway.kernels.controls.problem import ControlProblem
from antway.kernels.tracking import changes
from antway.kernels.tracking.table import make_table

SCALE = float(os.environ.get("ANTWAY_TEST_SCALE", "1"))
SHARED = Path(__file__).resolve().parents[2] / "shared" / "data"
needs_data = pytest.mark.skipif(not SHARED.is_dir(), reason=f"no test data at {SHARED}")


def cases(pull_request: int, nightly: int | None = None) -> int:
    """How many cases to run: `pull_request` in `make test`; SCALE times as many, up to `nightly`, in `make nightly`."""
    return max(1, int(min(pull_request * SCALE, nightly or pull_request * SCALE)))


def costly(pull_request: int, nightly: int | None = None) -> int:
    """As `cases`, for cases that take long and are much alike: `make test` plays a third of them, `make nightly` all."""
    n = cases(pull_request, nightly)
    return n if SCALE > 1 else max(1, math.ceil(n / 3))


def judge(controls: np.ndarray, problem: ControlProblem, limit: float = math.inf) -> float:
    """What one sequence of controls costs."""
    cost = np.empty(1)
    judge_all(controls[None], problem, limit, cost)
    return float(cost[0])


def play(tab: Any, steps: int) -> None:
    """Play this many steps of a tab of the live page."""
    for _ in range(steps):
        tab.advance()


def all_seen(estimates: np.ndarray) -> np.ndarray:
    """Tell of all tracks that the scan shows them."""
    return np.ones(len(estimates), np.bool_)


def changes_of(scans: list[tuple[float, np.ndarray]], terrain: Terrain) -> list[np.ndarray]:
    """How the velocities of tracks change from each scan, (t, estimates), to the next."""
    table, turns, found = make_table(64, changes.COLUMNS), np.zeros(3), []
    for t, estimates in scans:
        found.append(np.empty((len(estimates), 4)))
        changes.velocity_changes(table, turns, estimates, all_seen(estimates), terrain, t, found[-1])
    return found


def random_grid(rng: np.random.Generator, low: int = 2, high: int = 64, density: tuple[float, float] = (0.0, 0.6)) -> Grid:
    """A seeded random grid of `low` to `high` cells a side with a random share of blocked cells."""
    rows, cols = rng.integers(low, high + 1, size=2)
    return Grid(rng.random((rows, cols)) < rng.uniform(*density))


def free_cells(grid: Grid) -> np.ndarray:
    """The free cells of `grid`, int[N, 2]."""
    return np.argwhere(~grid.blocked)


def pick(rng: np.random.Generator, grid: Grid, n: int) -> list[tuple[int, int]]:
    """n random free cells."""
    free = free_cells(grid)
    return [(int(r), int(c)) for r, c in free[rng.integers(len(free), size=n)]]


def solvable(rng: np.random.Generator, **size: int) -> Grid:
    """A random grid with a free cell."""
    while not len(free_cells(grid := random_grid(rng, **size))):
        pass
    return grid
