"""Slow and obvious twins of the space-time kernels."""

from __future__ import annotations

import heapq

import numpy as np

from naive.geometry import hits_cells


def move_mask(blocked, offsets, radius):
    """Legal moves by sampling the distance to each blocked cell; also the margin by which each move was decided."""
    rows, cols = blocked.shape
    legal = np.zeros((rows, cols, len(offsets)), dtype=bool)
    margin = np.empty((rows, cols, len(offsets)))
    for (r, c, k), _ in np.ndenumerate(legal):
        least = hits_cells(blocked, (r, c), (r + offsets[k, 0], c + offsets[k, 1]), radius, True, samples=41)
        legal[r, c, k], margin[r, c, k] = least >= radius, abs(least - radius)
    return legal, margin


def move_field(mask, offsets, lengths, goals):
    """Dijkstra backwards with a heap and a dictionary."""
    rows, cols = mask.shape
    best = {tuple(goal): 0.0 for goal in goals}
    heap = [(0.0, tuple(goal)) for goal in goals]
    while heap:
        d, (row, col) = heapq.heappop(heap)
        if d > best[row, col]:
            continue
        for k, (dr, dc) in enumerate(offsets):
            r, c = row - dr, col - dc
            if 0 <= r < rows and 0 <= c < cols and mask[r, c] >> k & 1 and d + lengths[k] < best.get((r, c), np.inf):
                best[r, c] = d + lengths[k]
                heapq.heappush(heap, (best[r, c], (r, c)))
    field = np.full((rows, cols), np.inf)
    for cell, d in best.items():
        field[cell] = d
    return field
