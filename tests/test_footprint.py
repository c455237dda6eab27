"""Discs cover every point of the polygon they stand for."""

from __future__ import annotations

import numpy as np

from antway.trajectory.smooth import covering_discs
from common import cases


def test_discs_cover_the_polygon() -> None:
    """Random convex combinations of the corners lie in a covering disc."""
    rng = np.random.default_rng(0)
    for _ in range(cases(200, 5000)):
        polygon = rng.uniform(-1, 1, (int(rng.integers(3, 8)), 2)) * (1.0, 0.4)
        inside = rng.dirichlet(np.ones(len(polygon)), 200) @ polygon
        centres, radius = covering_discs(polygon, int(rng.integers(1, 6)))
        gap = np.hypot(*(inside[:, None] - centres).transpose(2, 0, 1)).min(axis=1)
        assert gap.max() <= radius + 1e-12
