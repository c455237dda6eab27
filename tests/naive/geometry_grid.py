"""Slow, obvious twins of what `grid.py` computes."""

from __future__ import annotations

import math

import numpy as np


def clearance(blocked: np.ndarray) -> np.ndarray:
    """Distance in cells from each centre to the nearest blocked square or the edge of the map, square by square."""
    rows, cols = blocked.shape
    out = np.empty((rows, cols))
    for r in range(rows):
        for c in range(cols):
            nearest = min(r, c, rows - 1 - r, cols - 1 - c) + 0.5
            for i in range(rows):
                for j in range(cols):
                    if blocked[i, j]:
                        nearest = min(nearest, math.hypot(max(abs(i - r) - 0.5, 0.0), max(abs(j - c) - 0.5, 0.0)))
            out[r, c] = 0.0 if blocked[r, c] else nearest
    return out


def touched(dr: int, dc: int, samples: int = 9240) -> set[tuple[int, int]]:
    """Cells whose closed squares hold one of many exact points of the segment from (0, 0) to (dr, dc), the ends left out."""
    found = set()
    for i in range(samples + 1):
        # the point (dr i / samples, dc i / samples) in units of half a cell: squares are odd intervals
        for r in range(-4, 5):
            for c in range(-4, 5):
                if abs(2 * (dr * i - r * samples)) <= samples and abs(2 * (dc * i - c * samples)) <= samples:
                    found.add((r, c))
    return found - {(0, 0), (dr, dc)}
