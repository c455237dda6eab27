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
    (row, col), yaw = grid.to_points([pose[:2]])[0], grid.origin[2]
    vx, vy = np.cos(angle - yaw) / grid.resolution, np.sin(angle - yaw) / grid.resolution
    for i in range(beams):
        cuts = [0.0]
        for start, v in ((col, vx[i]), (row, vy[i])):
            if abs(v) > 1e-12:
                ends = sorted((start, start + v * max_range))
                lines = np.arange(math.ceil(ends[0] - 0.5), math.floor(ends[1] - 0.5) + 1) + 0.5
                cuts += ((lines - start) / v).tolist()
        cuts = np.sort(cuts)
        middle = (cuts[:-1] + cuts[1:]) / 2
        r, c = np.floor(row + vy[i] * middle + 0.5).astype(int), np.floor(col + vx[i] * middle + 0.5).astype(int)
        inside = (r >= 0) & (c >= 0) & (r < grid.shape[0]) & (c < grid.shape[1])
        blocked = np.zeros(len(middle), bool)
        blocked[inside] = grid.blocked[r[inside], c[inside]]
        if blocked.any():
            best[i] = min(best[i], cuts[:-1][blocked.argmax()])
    return np.where(best <= max_range, best, math.inf)
