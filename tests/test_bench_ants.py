"""What ants add: each method beside its twins."""

from __future__ import annotations

import math

import pytest

from antway import BadParameter
from antway.arena.ants import TWINS, compare, markdown


def test_pheromone_and_exact_search_stand_where_they_must() -> None:
    """On grids with eta = 1 / d ants without pheromone are far worse, and nobody beats exact search."""
    rows = list(compare(("grid", "tsptw"), runs=2))
    grid = dict(rows[0].values)
    assert tuple(grid) == TWINS and grid["exact"] == 0.0 <= grid["ants"] < 0.5 * grid["no pheromone"]
    assert rows[0].runs == 2 and all(value >= 0.0 or math.isnan(value) for row in rows for _, value in row.values)
    table = markdown(rows).splitlines()
    assert len(table) == 4 and table[0].count("|") == table[2].count("|") and "–" in table[3]


def test_wrong_parts_and_numbers_are_refused() -> None:
    """Unknown parts and numbers of runs out of range."""
    with pytest.raises(BadParameter, match="parts"):
        list(compare(("bees",)))
    with pytest.raises(BadParameter, match="episodes"):
        list(compare(runs=0))
