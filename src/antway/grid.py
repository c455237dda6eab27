"""The map: an immutable grid of free and blocked cells, its place in the world, and the moves a robot makes on it."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter, OutOfBounds
from antway.lazy import drawing

T = TypeVar("T")
Cell = tuple[int, int]  # (row, col)
_KEPT: dict[int, dict[object, Any]] = {}  # what is derived from grids, by the id of their read-only array


class Moves(Enum):
    """The moves between cells, and when a move is legal.

    `FOUR` and `EIGHT` lead to neighbours. A diagonal of `EIGHT` needs both side cells free (no corner cutting, the only rule
    that is safe for a body), one of `EIGHT_NOSQUEEZE` at least one, one of `EIGHT_CUT` none. `SIXTEEN` and `THIRTY_TWO` add
    longer moves. Such a move needs all cells free whose closed square touches the segment between the cell centres; for
    diagonals this is the rule of `EIGHT`.

    Examples
    --------
    >>> Moves.EIGHT.lengths.round(3).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.414, 1.414, 1.414, 1.414]
    """

    FOUR = "four"
    EIGHT = "eight"
    EIGHT_NOSQUEEZE = "eight-nosqueeze"
    EIGHT_CUT = "eight-cut"
    SIXTEEN = "sixteen"
    THIRTY_TWO = "thirty-two"

    @cached_property
    def offsets(self) -> NDArray[np.int32]:
        """(d_row, d_col) of each move, int32[K, 2]: the 4 straight ones first, then the diagonals, then longer ones."""
        rows = [(0, 1), (1, 0), (0, -1), (-1, 0)]
        if self is not Moves.FOUR:
            rows += [(1, 1), (1, -1), (-1, -1), (-1, 1)]
        longer = {Moves.SIXTEEN: [(1, 2)], Moves.THIRTY_TWO: [(1, 2), (1, 3), (2, 3)]}
        for a, b in longer.get(self, []):
            rows += [(s * i, t * j) for i, j in ((a, b), (b, a)) for s in (1, -1) for t in (1, -1)]
        return _read_only(np.array(rows, dtype=np.int32))

    @cached_property
    def lengths(self) -> NDArray[np.float64]:
        """Length of each move in cells, float64[K]."""
        return _read_only(np.hypot(self.offsets[:, 0], self.offsets[:, 1]).astype(np.float64))

    @cached_property
    def touched(self) -> tuple[tuple[Cell, ...], ...]:
        """The cells that the segment of each move touches besides its two ends, relative to its start; all must be free."""
        return tuple(_touched(int(dr), int(dc)) for dr, dc in self.offsets)


def _touched(dr: int, dc: int) -> tuple[Cell, ...]:
    """Return the cells, except the ends, whose closed squares touch the segment from (0, 0) to (dr, dc).

    A closed square [r-1/2, r+1/2] x [c-1/2, c+1/2] meets the segment if and only if its four corners are not all strictly on
    one side of the line and it overlaps the segment's bounding box. With doubled coordinates, cross products are integers.
    """
    rows = range(min(0, dr), max(0, dr) + 1)
    cols = range(min(0, dc), max(0, dc) + 1)
    found = []
    for r in rows:
        for c in cols:
            corners = [dr * (2 * c + sc) - dc * (2 * r + sr) for sr in (-1, 1) for sc in (-1, 1)]
            if min(corners) <= 0 <= max(corners) and (r, c) not in ((0, 0), (dr, dc)):
                found.append((r, c))
    return tuple(found)


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """An occupancy grid. It is immutable, so that data derived from it stays valid.

    Parameters
    ----------
    blocked : bool[H, W]
        True where the robot cannot be. Row 0 is at the origin: the lowest y of a ROS map, the first line of a text map.
    resolution : float
        Edge of a cell in m, > 0.
    origin : (x, y, yaw)
        Pose of the outer corner of cell (0, 0) in m, m, rad.
    unknown : bool[H, W] or None
        True where a cell is blocked only because nothing is known about it; where a cell is free it does not count.
    top_first : bool
        Whether figures and pages show row 0 on top and y down, so that a map from a picture or a text looks as drawn. Nothing
        else depends on it, not even equality.

    Raises
    ------
    BadParameter
        For arrays that are empty or not two-dimensional and boolean (or 0 and 1), and for numbers out of range.

    Examples
    --------
    >>> grid = Grid(np.zeros((3, 4), dtype=bool), resolution=0.5)
    >>> grid.cell_at((1.9, 0.2)), grid.centre((0, 3))
    ((0, 3), (1.75, 0.25))
    """

    blocked: NDArray[np.bool_]
    resolution: float = 1.0
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    unknown: NDArray[np.bool_] | None = field(default=None)
    top_first: bool = False

    def __post_init__(self) -> None:
        blocked = _bool_array("blocked", self.blocked)
        set_ = object.__setattr__
        set_(self, "blocked", blocked)
        checks.fields(self, "resolution", low=1e-6, high=1e6, unit="m per cell")
        x, y, yaw = checks.point("origin", self.origin, size=3)
        for name, value in (("origin[0]", x), ("origin[1]", y)):
            checks.number(name, value, low=-1e9, high=1e9, unit="m")
        set_(self, "origin", (x, y, yaw))
        checks.instance("top_first", self.top_first, bool)
        if self.unknown is not None:
            unknown = _bool_array("unknown", self.unknown)
            if unknown.shape != blocked.shape:
                raise BadParameter("unknown.shape", unknown.shape, f"that of blocked, {blocked.shape}")
            set_(self, "unknown", _read_only(unknown & blocked))

    @property
    def shape(self) -> tuple[int, int]:
        """(rows, columns)."""
        return self.blocked.shape[0], self.blocked.shape[1]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Grid):
            return NotImplemented
        mine, theirs = (np.zeros_like(g.blocked) if g.unknown is None else g.unknown for g in (self, other))
        same_place = bool(self.resolution == other.resolution and self.origin == other.origin)
        return same_place and bool(np.array_equal(self.blocked, other.blocked) and np.array_equal(mine, theirs))

    def __hash__(self) -> int:
        return hash((self.shape, self.resolution, self.origin))

    def __repr__(self) -> str:
        (rows, cols), turn = self.shape, "" if self.origin[2] == 0.0 else f", turned by {self.origin[2]:.3g} rad"
        return f"Grid({rows} x {cols} cells of {self.resolution:g} m, {100 * self.blocked.mean():.0f} % blocked{turn})"

    def _repr_html_(self) -> str:
        return str(drawing().html(self))

    def __reduce__(self) -> tuple[object, ...]:
        # Copies and unpickled grids use the constructor, so that their arrays are read-only too.
        return Grid, (self.blocked, self.resolution, self.origin, self.unknown, self.top_first)

    def contains(self, cell: Cell) -> bool:
        """Tell whether `cell` is on the map."""
        (row, col), (rows, cols) = checked_cell("cell", cell), self.blocked.shape
        return bool(0 <= row < rows and 0 <= col < cols)

    def is_free(self, cell: Cell) -> bool:
        """Tell whether `cell` is on the map and not blocked."""
        cell = checked_cell("cell", cell)
        return self.contains(cell) and not bool(self.blocked[cell])

    def centre(self, cell: Cell) -> tuple[float, float]:
        """Return the (x, y) in m of the centre of `cell`."""
        x, y = self.to_xy([cell])[0]
        return float(x), float(y)

    def to_xy(self, points: ArrayLike) -> NDArray[np.float64]:
        """Map (row, col) points, float[N, 2] with integers at cell centres, to (x, y) in m, float64[N, 2]."""
        p = _pairs("points", points)
        u, v = (p[:, 1] + 0.5) * self.resolution, (p[:, 0] + 0.5) * self.resolution
        x, y, yaw = self.origin
        out = np.empty_like(p)
        if yaw == 0.0:
            out[:, 0], out[:, 1] = x + u, y + v
        else:
            cos, sin = math.cos(yaw), math.sin(yaw)
            out[:, 0], out[:, 1] = x + cos * u - sin * v, y + sin * u + cos * v
        return out

    def to_points(self, xy: ArrayLike) -> NDArray[np.float64]:
        """Map (x, y) in m, float[N, 2], to real-valued (row, col), integers at cell centres; the inverse of `to_xy`."""
        p = _pairs("xy", xy)
        x, y, yaw = self.origin
        dx, dy = p[:, 0] - x, p[:, 1] - y
        if yaw != 0.0:
            cos, sin = math.cos(yaw), math.sin(yaw)
            dx, dy = cos * dx + sin * dy, cos * dy - sin * dx
        out = np.empty_like(p)
        out[:, 0], out[:, 1] = dy / self.resolution - 0.5, dx / self.resolution - 0.5
        return out

    def cell_at(self, xy: Iterable[float]) -> Cell:
        """Return the cell that contains the point (x, y) in m; a point on an edge belongs to the cell of higher index.

        Raises
        ------
        OutOfBounds
            If the point is not on the map.
        """
        x, y = checks.point("xy", xy)
        dx, dy = x - self.origin[0], y - self.origin[1]
        if self.origin[2] != 0.0:
            cos, sin = math.cos(self.origin[2]), math.sin(self.origin[2])
            dx, dy = cos * dx + sin * dy, cos * dy - sin * dx
        row, col = dy / self.resolution, dx / self.resolution
        rows, cols = self.shape
        if not (0 <= row < rows and 0 <= col < cols):
            (x0, y0), (x1, y1) = self.bounds().tolist()
            turned = f", turned by {self.origin[2]:g} rad" if self.origin[2] != 0.0 else ""
            allowed = f"on the map{turned}: x from {x0:g} to {x1:g}, y from {y0:g} to {y1:g} (m), less than the upper ends"
            raise OutOfBounds("xy", (x, y), allowed)
        return int(row), int(col)

    def bounds(self) -> NDArray[np.float64]:
        """Return the least and the greatest (x, y) of the map, float64[2, 2], m.

        Examples
        --------
        >>> Grid(np.zeros((3, 4), dtype=bool), resolution=0.5, origin=(1.0, 0.0, 0.0)).bounds().tolist()
        [[1.0, 0.0], [3.0, 1.5]]
        """
        rows, cols = self.shape
        corners = self.to_xy([(row - 0.5, col - 0.5) for row in (0, rows) for col in (0, cols)])
        return np.array((corners.min(axis=0), corners.max(axis=0)))

    def turned(self) -> Grid:
        """Return the map with cells along the axes of the world, which episodes need; it matters only if the yaw is not 0.

        A new cell is blocked if it overlaps a blocked cell or anything off the map, so that everything free was free before;
        free cells along slanted walls are lost. Cells keep their size.

        Examples
        --------
        >>> Grid(np.array([[0, 0, 1]]), origin=(1.0, 0.0, math.pi / 2)).turned().blocked.astype(int).tolist()
        [[0], [0], [1]]
        """
        yaw = math.remainder(self.origin[2], 2.0 * math.pi)
        if yaw == 0.0:
            return self if self.origin[2] == 0.0 else replace(self, origin=(*self.origin[:2], 0.0))
        (low, high), size, slack = self.bounds(), self.resolution, 1e-9
        width, height = (max(1, math.ceil(span / size - slack)) for span in (high - low).tolist())
        origin, nothing = (float(low[0]), float(low[1]), 0.0), np.zeros((height, width), np.bool_)
        here = replace(self, blocked=nothing, origin=origin, unknown=None)
        centres = self.to_points(here.to_xy(np.argwhere(~here.blocked)))
        near = np.rint(centres).astype(np.int64)
        hidden = np.zeros_like(self.blocked) if self.unknown is None else self.unknown
        known, dark = np.pad(self.blocked & ~hidden, 2), np.pad(hidden, 2, constant_values=True)
        cos, sin = math.cos(yaw), math.sin(yaw)
        limit = 0.5 + 0.5 * (abs(cos) + abs(sin)) - slack  # two unit squares overlap if their offset is smaller in both frames
        blocked, unknown = (np.zeros(len(near), np.bool_) for _ in range(2))
        for dr in (-1, 0, 1):
            for dc in (-1, 0, 1):
                cells = near + np.array((dr, dc))
                r, c = (cells - centres).T
                overlap = (np.abs(r) < limit) & (np.abs(c) < limit)
                overlap &= (np.abs(cos * r + sin * c) < limit) & (np.abs(cos * c - sin * r) < limit)
                at = np.clip(cells + 2, 0, np.array(self.shape) + 3)
                blocked |= overlap & known[at[:, 0], at[:, 1]]
                unknown |= overlap & dark[at[:, 0], at[:, 1]]
        blocked, unknown = (blocked | unknown).reshape(here.shape), (unknown & ~blocked).reshape(here.shape)
        return replace(here, blocked=blocked, unknown=unknown if unknown.any() else None)

    def clearance(self) -> NDArray[np.float64]:
        """Return for each cell centre the exact distance in m to the nearest blocked square or edge of the map, float64[H, W].

        The nearest point of a square is always on the doubled lattice, so an exact distance transform of that is enough.
        """
        from scipy.ndimage import distance_transform_edt

        rows, cols = self.shape
        free = np.zeros((2 * rows + 1, 2 * cols + 1), dtype=bool)
        free[1:-1, 1:-1] = True
        r, c = np.nonzero(self.blocked)
        for dr in range(3):
            for dc in range(3):
                free[2 * r + dr, 2 * c + dc] = False
        distance: NDArray[np.float64] = distance_transform_edt(free)
        return np.ascontiguousarray(distance[1::2, 1::2]) * (self.resolution / 2)

    def inflate(self, radius: float) -> Grid:
        """Return the grid in which all cells with a clearance below `radius` m are blocked, so that a disc can be a point.

        Everything off the map counts as blocked; touching is allowed.
        """
        radius = checks.number("robot_radius", radius, low=0.0, unit="m")
        if radius == 0.0:
            return self
        return replace(self, blocked=self.blocked | (self.clearance() < radius * (1 - 1e-12)))


def kept(grid: Grid, name: object, make: Callable[[], T]) -> T:
    """Return the value kept under `name` for the cells of this grid; `make` computes it the first time."""
    key = id(grid.blocked)
    known = _KEPT.get(key)
    if known is None:
        weakref.finalize(grid.blocked, _KEPT.pop, key, None).atexit = False
        known = _KEPT.setdefault(key, {})
    value = known.get(name)
    if value is None:
        value = known[name] = make()
    return cast(T, value)


def checked_cell(name: str, value: object) -> Cell:
    """Return `value` as (row, col)."""
    if type(value) is tuple and len(value) == 2 and type(value[0]) is type(value[1]) is int:
        return value  # the usual case, without further checks
    row, col = checks.sequence(name, value, "a cell (row, col)", size=2)
    return checks.integer(f"{name}[0]", row), checks.integer(f"{name}[1]", col)


def _pairs(name: str, value: ArrayLike) -> NDArray[np.float64]:
    try:
        pairs = np.asarray(value)
        if pairs.dtype.kind in "USc":
            raise TypeError  # NumPy would read numbers in texts, and drop imaginary parts
        pairs = pairs.astype(np.float64, copy=False)
    except (TypeError, ValueError, OverflowError):
        pairs = np.empty(1)
    if pairs.size and (pairs.shape[-1:] != (2,) or pairs.ndim > 2):
        raise BadParameter(name, value, "pairs of numbers, float[N, 2]")
    return pairs.reshape(-1, 2)


def _bool_array(name: str, value: ArrayLike) -> NDArray[np.bool_]:
    array = checks.raw(name, value, "a two-dimensional array of booleans")
    if array.ndim != 2 or 0 in array.shape:
        raise BadParameter(f"{name}.shape", array.shape, "(rows, columns), both at least 1")
    if array.dtype != np.bool_ and not (np.issubdtype(array.dtype, np.integer) and ((array == 0) | (array == 1)).all()):
        raise BadParameter(f"{name}.dtype", str(array.dtype), "bool, or integers that are 0 or 1")
    return _read_only(array.astype(np.bool_, copy=True, order="C"))


def _read_only(array: NDArray[np.generic]) -> NDArray:  # type: ignore[type-arg]
    array.flags.writeable = False
    return array
