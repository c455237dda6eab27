"""A laser that measures exactly: the nearest crossing of each beam with the edges of blocked cells and with discs."""

from __future__ import annotations

import math

import numpy as np

from antway import Grid


def measured(grid: Grid, places: np.ndarray, radii: np.ndarray, pose, beams: int, max_range: float) -> np.ndarray:
    """Ranges in m of beams from -pi on, relative to the laser's heading; infinite where nothing is within `max_range` m."""
    angle = pose[2] - math.pi + 2 * math.pi * np.arange(beams) / beams
    ux, uy = np.cos(angle), np.sin(angle)
    best = np.full(beams, math.inf)
    for (ox, oy), radius in zip(places, radii):
        along = (ox - pose[0]) * ux + (oy - pose[1]) * uy
        square = radius**2 - ((ox - pose[0]) ** 2 + (oy - pose[1]) ** 2 - along**2)
        hit = (square >= 0.0) & (along >= 0.0)
        best[hit] = np.minimum(best[hit], (along - np.sqrt(np.maximum(square, 0.0)))[hit])
    # in the grid's own frame, in cells: between two crossings with lines at k - 1/2 a beam stays within one cell
    (row, col), yaw, reach = grid.to_points([pose[:2]])[0], grid.origin[2], max_range / grid.resolution
    vx, vy = np.cos(angle - yaw)[:, None] / grid.resolution, np.sin(angle - yaw)[:, None] / grid.resolution
    cuts = [np.zeros((beams, 1))]
    for start, v in ((col, vx), (row, vy)):
        lines = np.arange(math.ceil(start - reach - 0.5), math.floor(start + reach - 0.5) + 1) + 0.5
        crossed = (lines - start) / np.where(np.abs(v) > 1e-12, v, math.nan)
        cuts.append(np.where((crossed >= 0.0) & (crossed <= max_range), crossed, math.inf))
    cuts = np.sort(np.concatenate(cuts, axis=1), axis=1)
    within = np.isfinite(cuts[:, 1:])
    middle = np.where(within, (cuts[:, :-1] + cuts[:, 1:]) / 2, 0.0)
    r, c = np.floor(row + vy * middle + 0.5).astype(int), np.floor(col + vx * middle + 0.5).astype(int)
    within &= (r >= 0) & (c >= 0) & (r < grid.shape[0]) & (c < grid.shape[1])
    blocked = within & grid.blocked[np.where(within, r, 0), np.where(within, c, 0)]
    hit = blocked.any(axis=1)
    best[hit] = np.minimum(best[hit], cuts[hit, blocked.argmax(axis=1)[hit]])
    return np.where(best <= max_range, best, math.inf)
