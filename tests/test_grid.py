"""Grid: coordinates, clearance and inflation, moves, immutability."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from antway import BadParameter, Grid, Moves, OutOfBounds, load_map
from common import cases, random_grid
from naive import geometry_grid

ORIGINS = [(0.0, 0.0, 0.0), (-13.7, -250.3, 0.0), (5.0, -3.0, 0.7), (-1e4, 1e4, -2.9), (0.1, 0.2, math.pi / 2)]


@pytest.mark.parametrize("origin", ORIGINS)
@pytest.mark.parametrize("resolution", [0.05, 1.0, 0.3])
def test_points_there_and_back(origin: tuple[float, float, float], resolution: float) -> None:
    """C20: 1e5 points go to cells and metres and back to 1e-6 cells, whatever the origin and yaw."""
    grid = Grid(np.zeros((300, 400), dtype=bool), resolution, origin)
    points = np.random.default_rng(1).uniform(-0.5, 299.5, (cases(100_000, 1_000_000), 2))
    assert np.abs(grid.to_points(grid.to_xy(points)) - points).max() < 1e-6
    # an independent rotation: complex numbers
    z = complex(*origin[:2]) + np.exp(1j * origin[2]) * ((points[:, 1] + 0.5) + 1j * (points[:, 0] + 0.5)) * resolution
    assert np.abs(grid.to_xy(points) - np.column_stack((z.real, z.imag))).max() < 1e-9
    for cell in np.random.default_rng(2).integers(0, 300, (500, 2)).tolist():
        assert grid.cell_at(grid.centre((cell[0], cell[1]))) == tuple(cell)


def test_cells_by_exact_arithmetic() -> None:
    """C20: the cell of a point is the floor of its exact quotient, never a rounding, and off the map is `OutOfBounds`."""
    rng = np.random.default_rng(3)
    grid = Grid(np.zeros((40, 50), dtype=bool), 0.25, (-3.5, 2.25, 0.0))
    xs, ys = rng.uniform(-5, 10, cases(20_000)), rng.uniform(1, 14, cases(20_000))
    edges = np.arange(-4, 56) * 0.25 - 3.5
    pairs = [*zip(xs, ys), *((x, 2.25 + 0.25 * k) for k, x in enumerate(edges)), (np.nextafter(-3.5, -9), 3.0)]
    for x, y in pairs:
        col = math.floor((Fraction(x) + Fraction(7, 2)) * 4)
        row = math.floor((Fraction(y) - Fraction(9, 4)) * 4)
        if 0 <= row < 40 and 0 <= col < 50:
            assert grid.cell_at((x, y)) == (row, col)
        else:
            with pytest.raises(OutOfBounds):
                grid.cell_at((x, y))


@pytest.mark.parametrize("xy", [(1e308, 0.0), (-1e308, 1e308), (-1e-300, 0.5), (3.0, 0.5)])
def test_points_far_off(xy: tuple[float, float]) -> None:
    """Points just or far off the map are `OutOfBounds`, also turned ones, without a warning."""
    for yaw in (0.0, 0.5):
        with pytest.raises(OutOfBounds):
            Grid(np.zeros((3, 3), dtype=bool), 1e-3 if xy[0] > 4 else 1.0, (0.0, 0.0, yaw)).cell_at((xy[0], xy[1] - 9 * yaw))


def test_clearance_is_exact() -> None:
    """Clearance and inflation equal distances square by square, the map's edge counted as blocked."""
    rng = np.random.default_rng(4)
    for _ in range(cases(60, 2000)):
        grid = random_grid(rng, 1, 10, (0.0, 0.3))
        resolution = float(rng.choice([0.05, 1.0, 0.3]))
        grid = Grid(grid.blocked, resolution)
        exact = geometry_grid.clearance(grid.blocked)
        assert np.allclose(grid.clearance(), exact * resolution, rtol=1e-12, atol=0)
        for radius in (0.0, 0.5, math.sqrt(0.5), 1.2, 1.5, 40.0):
            if radius:
                metres = float(f"{radius * resolution:.15g}")  # as people write it: 0.45 is more than 1.5 * 0.3
                assert np.array_equal(grid.inflate(metres).blocked, grid.blocked | (exact < radius - 1e-9))
    assert grid.inflate(0.0) is grid


@pytest.mark.parametrize("moves", Moves)
def test_moves_touch_what_they_touch(moves: Moves) -> None:
    """The cells of each move are those whose closed squares hold a point of it, by exact sampling; moves are distinct."""
    assert len({tuple(o) for o in moves.offsets.tolist()}) == len(moves.offsets) == len(moves.touched)
    for (dr, dc), length, cells in zip(moves.offsets.tolist(), moves.lengths, moves.touched):
        assert length == math.hypot(dr, dc)
        assert set(cells) == geometry_grid.touched(dr, dc, 24)


def test_nothing_can_be_changed() -> None:
    """Arrays of a grid and of moves refuse to be written, and a grid keeps no hold on the array it came from."""
    blocked = np.zeros((2, 2), dtype=bool)
    grid = Grid(blocked, unknown=blocked)
    blocked[0, 0] = True
    assert not grid.blocked.any()
    assert grid.unknown is not None
    for array in (grid.blocked, grid.unknown, Moves.EIGHT.offsets, Moves.EIGHT.lengths):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1
    with pytest.raises(AttributeError):
        grid.resolution = 2.0  # type: ignore[misc]


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("blocked.shape", {"blocked": np.zeros(3, dtype=bool)}),
        ("blocked.shape", {"blocked": np.zeros((0, 3), dtype=bool)}),
        ("blocked.dtype", {"blocked": np.full((2, 2), 0.5)}),
        ("blocked.dtype", {"blocked": np.full((2, 2), 2)}),
        ("blocked", {"blocked": [[True], [True, False]]}),
        ("resolution", {"resolution": 0.0}),
        ("resolution", {"resolution": 1.1e6}),
        ("resolution", {"resolution": math.nan}),
        ("resolution", {"resolution": True}),
        ("origin[2]", {"origin": (0.0, 0.0, math.inf)}),
        ("origin[0]", {"origin": (1e10, 0.0, 0.0)}),
        ("origin", {"origin": (0.0, 0.0)}),
        ("unknown.shape", {"unknown": np.zeros((3, 3), dtype=bool)}),
    ],
)
def test_wrong_grids(name: str, arguments: dict[str, object]) -> None:
    """Each wrong argument of a grid is a `BadParameter` that names it."""
    with pytest.raises(BadParameter) as caught:
        Grid(**{"blocked": np.zeros((2, 2), dtype=bool), **arguments})  # type: ignore[arg-type]
    assert caught.value.field == name


@given(
    st.integers(1, 30), st.integers(1, 30), st.floats(1e-3, 1e3), st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-7, 7)
)
def test_centres_lie_in_their_cells(rows: int, cols: int, resolution: float, x: float, y: float, yaw: float) -> None:
    """The centre of the corner cells lies in them, for any place of the map."""
    grid = Grid(np.zeros((rows, cols), dtype=bool), resolution, (x, y, yaw))
    for cell in ((0, 0), (rows - 1, cols - 1), (0, cols - 1)):
        assert grid.cell_at(grid.centre(cell)) == cell


def test_wrong_points_are_refused_by_name() -> None:
    """Neither texts nor odd numbers of coordinates are points."""
    grid = Grid(np.zeros((3, 3), dtype=bool))
    for wrong in ("abc", [1, 2, 3], [[1, 2], [3]], None, [("1", "2")], [(10**400, 0)], [(1j, 0)]):
        for convert, name in ((grid.to_xy, "points"), (grid.to_points, "xy")):
            with pytest.raises(BadParameter, match=name):
                convert(wrong)
    with pytest.raises(BadParameter, match="xy"):
        grid.cell_at(np.array(5.0))


def test_equality_is_by_meaning() -> None:
    """Grids are equal when cells, place and unknown cells are; no mask is a mask of nothing, and free cells are not unknown."""
    none = np.zeros((2, 2), dtype=bool)
    assert Grid(none) == Grid(none, unknown=none) == Grid(none, unknown=~none)
    assert Grid(none) != Grid(none, 2.0) and Grid(none) != Grid(~none)
    assert Grid(~none) != Grid(~none, unknown=~none)
    assert Grid(none) != "grid"


@pytest.mark.parametrize("yaw", [0.3, -1.2, 2.5, math.pi / 4])
def test_a_turned_map_frees_nothing(yaw):
    """C: what is free on the turned map was free before, whole cells of it; what is far from walls stays free."""
    rng = np.random.default_rng(7)
    blocked = rng.random((12, 17)) < 0.1
    unknown = rng.random((12, 17)) < 0.05
    grid = Grid(blocked | unknown, 0.4, (3.0, -2.0, yaw), unknown)
    turned = grid.turned()
    assert turned.origin[2] == 0.0 and turned.resolution == grid.resolution
    free = np.argwhere(~turned.blocked)
    assert len(free) > 20
    for at in rng.uniform(-0.499, 0.499, (40, 2)):  # points within the free cells
        for xy in turned.to_xy(free + at):
            assert not grid.blocked[grid.cell_at(xy)]
    clear = np.argwhere(grid.clearance() > 0.4 * math.sqrt(2.0))
    assert all(not turned.blocked[turned.cell_at(xy)] for xy in grid.to_xy(clear))
    assert (turned.unknown <= turned.blocked).all()
    assert not any(turned.unknown[turned.cell_at(xy)] for xy in grid.to_xy(np.argwhere(blocked & ~unknown)))


@pytest.mark.parametrize(("quarters", "as_numpy"), [(1, -1), (2, 2), (-1, 1)])
def test_quarter_turns_lose_nothing(quarters, as_numpy):
    """A map turned by a right angle is the same map with rows and columns exchanged."""
    blocked = np.random.default_rng(1).random((4, 7)) < 0.4
    turned = Grid(blocked, 0.25, (1.0, 2.0, quarters * math.pi / 2)).turned()
    assert np.array_equal(turned.blocked, np.rot90(blocked, as_numpy)) and turned.unknown is None
    assert Grid(blocked).turned() == Grid(blocked)


@pytest.mark.parametrize("cell", [(0.5, 0.5), (0,), "00", None])
def test_what_is_no_cell_is_refused(cell: object) -> None:
    grid = Grid(np.zeros((2, 2), dtype=bool))
    assert grid.is_free(np.array([1, 0])) and not grid.is_free([2, 0])  # type: ignore[arg-type]
    for ask in (grid.is_free, grid.contains):
        with pytest.raises(BadParameter, match="cell"):
            ask(cell)  # type: ignore[arg-type]


def test_a_place_off_the_map_is_told_where_the_map_is() -> None:
    """In metres, which shows whoever has swapped x and y what is wrong."""
    with pytest.raises(OutOfBounds, match=r"x from 0 to 24, y from 0 to 14 \(m\)"):
        load_map("office").cell_at((3.0, 22.0))


def test_a_turned_picture_is_still_shown_as_drawn() -> None:
    """Which side is on top does not depend on the yaw."""
    for yaw in (0.0, 0.3, 2 * math.pi):
        drawn = Grid(np.eye(4, dtype=bool), origin=(0.0, 0.0, yaw), top_first=True)
        assert drawn.turned().top_first


@pytest.mark.parametrize("points", [np.zeros((2, 4)), np.zeros(6), np.zeros((1, 2, 2)), np.zeros((2, 0, 3))[0].T], ids=np.shape)
def test_what_is_no_list_of_pairs_is_refused(points: np.ndarray) -> None:
    """An array of another shape is not read as pairs, even if its size is even; one without numbers has no pairs."""
    grid = Grid(np.zeros((9, 9), dtype=bool))
    if points.size:
        with pytest.raises(BadParameter, match="pairs"):
            grid.to_xy(points)
    with pytest.raises(BadParameter, match="pairs"):
        grid.centre(("a", 1))
    assert grid.to_xy([]).shape == (0, 2) and grid.to_xy((1.0, 2.0)).shape == (1, 2)


def test_cells_are_booleans_or_0_and_1() -> None:
    """Other integers, and floats, are no cells."""
    assert Grid([[0, 1]]) == Grid([[False, True]])
    for wrong in ([[0, 2]], [[0, 1], [-1, 0]], [[0.0, 1.0]], [["0", "1"]]):
        with pytest.raises(BadParameter, match=r"blocked\.dtype"):
            Grid(wrong)


def test_a_turned_cell_is_blocked_by_what_it_overlaps_and_by_nothing_else() -> None:
    """Squares overlap if their shadows do on the axes of both maps; what is off the map is unknown."""
    rng = np.random.default_rng(6)
    for _ in range(cases(20, 500)):
        rows, cols = rng.integers(1, 6, 2).tolist()
        blocked, hidden = rng.random((2, rows, cols)) < 0.3
        yaw = float(rng.uniform(-4.0, 4.0))
        grid = Grid(blocked, 0.5, (*rng.uniform(-3.0, 3.0, 2).tolist(), yaw), hidden)
        turned = grid.turned()
        around = np.indices((rows + 6, cols + 6)).reshape(2, -1).T - 3
        corners = np.array([(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)])
        old, new = (
            of.to_xy((cells[:, None] + corners).reshape(-1, 2)).reshape(-1, 4, 2)
            for of, cells in ((grid, around), (turned, np.argwhere(np.ones(turned.shape))))
        )
        overlap = np.ones((len(new), len(old)), np.bool_)
        for angle in (0.0, math.pi / 2, yaw, yaw + math.pi / 2):
            a, b = (squares @ (math.cos(angle), math.sin(angle)) for squares in (new, old))
            overlap &= np.minimum(a.max(1)[:, None], b.max(1)) - np.maximum(a.min(1)[:, None], b.min(1)) > 1e-7
        walls, dark = np.pad(blocked & ~hidden, 3), np.pad(blocked & hidden, 3, constant_values=True)
        wall, unknown = ((overlap & part.ravel()).any(axis=1).reshape(turned.shape) for part in (walls, dark))
        assert np.array_equal(turned.blocked, wall | unknown)
        assert np.array_equal(np.zeros_like(wall) if turned.unknown is None else turned.unknown, unknown & ~wall)
