"""Space-time search against its slow twins (C5, C7)."""

from __future__ import annotations

import numpy as np
import pytest

from antway.search.sipp import TIMED_MOVES, timed_field, timed_moves
from common import cases, random_grid
from naive import timed as naive


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_moves_against_samples(moves):
    """A move is in the mask exactly where no sample of its way comes nearer than the radius to a blocked cell or the edge."""
    rng = np.random.default_rng(1)
    step = moves.lengths.max() / 40 / 2
    for _ in range(cases(6, 300)):
        grid = random_grid(rng, 1, 8, (0.0, 0.3))
        radius = rng.uniform(0.05, 1.5)
        mask = timed_moves(grid, radius, moves)
        legal, margin = naive.move_mask(grid.blocked, moves.offsets, radius)
        bits = (mask[..., None] >> np.arange(len(moves.offsets), dtype=np.uint32) & 1).astype(bool)
        assert not (bits & ~legal).any()
        assert not (legal & ~bits & (margin > step)).any()


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_moves_of_a_point(moves):
    """Without a radius the legal moves are those of the grid: every touched cell must be free."""
    rng = np.random.default_rng(2)
    for _ in range(cases(20)):
        grid = random_grid(rng, 1, 9)
        mask = timed_moves(grid, 0.0, moves)
        for (r, c), bits in np.ndenumerate(mask):
            for k, (dr, dc) in enumerate(moves.offsets):
                need = [(r, c), (r + dr, c + dc), *((r + i, c + j) for i, j in moves.touched[k])]
                assert bool(bits >> k & 1) == all(grid.is_free(cell) for cell in need)


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_field_against_heap(moves):
    """The bucketed field equals Dijkstra's with a heap to the last bit; whole maps, windows, several goals (C7)."""
    rng = np.random.default_rng(3)
    for _ in range(cases(40, 4000)):
        grid = random_grid(rng, 1, 20, (0.0, 0.4))
        mask = timed_moves(grid, rng.uniform(0.0, 0.9), moves)
        r, c = rng.integers(0, grid.shape)
        window = mask[r:, c:]
        goals = np.argwhere(window)[: rng.integers(1, 4)]
        if len(goals):
            field = timed_field(window, moves, goals)
            assert np.array_equal(field, naive.move_field(window, moves.offsets, moves.lengths, goals))
