"""Discs cover every point of the polygon they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from antway import BadParameter
from antway.trajectory.footprint import covering_discs
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


def test_wrong_polygons_raise() -> None:
    """Fewer than three corners, and no discs, raise `BadParameter`."""
    with pytest.raises(BadParameter):
        covering_discs([(0, 0), (1, 1)], 2)
    with pytest.raises(BadParameter):
        covering_discs([(0, 0), (1, 1), (0, 1)], 0)
