"""The path given to follow_path: the corridor around it, and where the robot is along it; no ROS import."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from antway.errors import BadParameter
from antway.grid import Grid
from antway.kernels.base.geometry import wrap
from antway.world.policy import XY

_MOST = 4_000_000  # limit of a path's length in half cells


def corridor(grid: Grid, path: NDArray[np.float64], width: float) -> Grid:
    """Return the part of `grid` around `path`, float64[N, 2] in m, with cells farther than `width` m from it blocked.

    Distances are those between cell centres.

    Raises
    ------
    BadParameter
        For a path that is longer than any on a map.

    Examples
    --------
    >>> part = corridor(Grid(np.zeros((9, 9), bool)), np.array([[0.5, 4.5], [8.5, 4.5]]), 1.0)
    >>> part.origin, part.shape
    ((0.0, 3.0, 0.0), (3, 9))
    """
    cells = _cells_along(grid, path)
    part, low = _window(grid, cells, width)
    far = np.ones(part.shape, bool)
    inside = ((cells >= low) & (cells < low + part.shape)).all(axis=1)
    far[tuple((cells[inside] - low).T)] = False
    far = scipy.ndimage.distance_transform_edt(far) * grid.resolution > width
    return replace(part, blocked=part.blocked | far)


def around(grid: Grid, xy: XY, away: float) -> Grid | None:
    """Return the part of `grid` up to `away` m from the row and column of `xy`; None if that is not on the map."""
    cell = _cells_of(grid, np.array([xy]))
    return _window(grid, cell, away)[0] if ((cell >= 0) & (cell < grid.shape)).all() else None


def _window(grid: Grid, cells: NDArray[np.int64], pad: float) -> tuple[Grid, NDArray[np.int64]]:
    """Return the smallest part of `grid` that holds what is on it of `cells` and `pad` m around them, and its first cell."""
    more, last = math.ceil(min(pad / grid.resolution, max(grid.shape))), np.array(grid.shape) - 1
    low, high = np.clip(cells.min(axis=0) - more, 0, last), np.clip(cells.max(axis=0) + more, 0, last)
    part = slice(low[0], high[0] + 1), slice(low[1], high[1] + 1)
    unknown = None if grid.unknown is None else grid.unknown[part]
    x, y = grid.origin[0] + float(low[1]) * grid.resolution, grid.origin[1] + float(low[0]) * grid.resolution
    return Grid(grid.blocked[part], grid.resolution, (x, y, 0.0), unknown), low


def keeps_near(grid: Grid, path: NDArray[np.float64], other: NDArray[np.float64], width: float) -> bool:
    """Tell whether the path `other` leads through free cells of `grid` that `corridor` leaves around `path` alone.

    Raises
    ------
    BadParameter
        For a path that is longer than any on a map.
    """
    along, cells = _cells_along(grid, path), _cells_along(grid, other)
    along, inside = (one[((one >= 0) & (one < grid.shape)).all(axis=1)] for one in (along, cells))
    if len(inside) < len(cells) or grid.blocked[tuple(cells.T)].any():
        return False
    away = np.asarray(scipy.spatial.cKDTree(along).query(cells)[0]) * grid.resolution
    return bool((away <= width).all())


def _cells_along(grid: Grid, path: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cells of a path's vertices and of points at most half a cell apart between them, int64[M, 2]."""
    steps = np.maximum(np.ceil(2.0 * np.abs(np.diff(path, axis=0)).max(axis=1) / grid.resolution), 1.0)
    if steps.sum() > _MOST:
        raise BadParameter("path", f"{steps.sum():.3g} half cells long", f"at most {_MOST}, as no path on a map is longer")
    dense = [np.linspace(a, b, n, endpoint=False) for a, b, n in zip(path, path[1:], steps.astype(int).tolist())]
    return _cells_of(grid, np.vstack((*dense, path[-1:])))


def _cells_of(grid: Grid, xy: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the cells of places, on the map or beside it."""
    return np.floor(grid.to_points(xy) + 0.5).astype(np.int64)


@dataclass(frozen=True, slots=True)
class Tracking:
    """Where a robot is along a path."""

    index: int  # of the vertex at which the nearest segment starts
    aside: float  # m; distance from the path, positive to its left
    turned: float  # rad; direction of the path minus the heading, positive if the robot is turned to the right of the path
    left: float  # m; length of the path from there to its end


def tracking(path: NDArray[np.float64], xy: XY, heading: float) -> Tracking:
    """Return where a robot at `xy` m with that heading is along `path`, float64[N, 2] in m.

    Examples
    --------
    >>> tracking(np.array([[0.0, 0.0], [4.0, 0.0]]), (1.0, 0.5), 0.25)
    Tracking(index=0, aside=0.5, turned=-0.25, left=3.0)
    """
    if len(path) == 1:
        return Tracking(0, 0.0, 0.0, math.dist(xy, path[0]))
    start, step = path[:-1], np.diff(path, axis=0)
    to = np.array(xy) - start
    share = np.clip((to * step).sum(axis=1) / np.maximum((step**2).sum(axis=1), 1e-300), 0.0, 1.0)
    away = np.hypot(*(to - share[:, None] * step).T)
    lengths = np.hypot(*step.T)
    i = int(np.argmin(np.where(lengths > 0.0, away, math.inf)))  # from a vertex to itself there is no direction
    side = math.copysign(float(away[i]), float(step[i, 0] * to[i, 1] - step[i, 1] * to[i, 0]))
    left = float((1.0 - share[i]) * lengths[i] + lengths[i + 1 :].sum())
    return Tracking(i, side, wrap(math.atan2(step[i, 1], step[i, 0]) - heading), left)


def length_after(path: NDArray[np.float64], xy: XY, within: float) -> float:
    """Return the length of a path, float64[N, 2] in m, after the first of its vertices that is within `within` m of `xy`.

    Before the first vertex that is so near, nothing counts; without one it is 0.

    Examples
    --------
    >>> loop = np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 0.0]])
    >>> length_after(loop, (0.1, 0.0), 0.2), length_after(loop, (4.0, 2.9), 0.2)
    (12.0, 5.0)
    """
    near = np.flatnonzero(np.hypot(*(path - xy).T) <= within)
    return float(np.hypot(*np.diff(path[near[0] :], axis=0).T).sum()) if len(near) else 0.0
