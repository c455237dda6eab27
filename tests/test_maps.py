"""Map files: what each format means, that it comes back as it was saved, and what is said of a wrong one."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from antway import BadInput, BadMap, BadParameter, Grid, load_map, save_map
from antway.errors import BadScenario, TooLarge
from antway.maps import GreyTrapWarning, ResolutionWarning, image, load_costs, load_scen
from antway.maps.image import read_grey
from antway.maps.limits import DEFAULT, Limits
from common import SHARED, cases, needs_data, random_grid
from mapfiles import YAML, npy, png, seeds

SUFFIXES = [".yaml", ".yml", ".pgm", ".png", ".map", ".txt", ".npy"]


def cost(grey: int, alpha: int, mode: str, negate: bool, free: float, occupied: float) -> int:
    """The cost of one pixel in map_server, step by step in single precision."""
    if mode == "raw":
        return grey if grey <= 100 else -1
    o = np.float32(grey) / np.float32(255)
    if not negate:
        o = np.float32(1) - o
    if alpha < 255:
        return -1
    if o <= np.float32(free):
        return 0
    if o >= np.float32(occupied):
        return 100
    if mode == "trinary":
        return -1
    return int(np.floor((o - np.float32(free)) / np.float32(occupied - free) * np.float32(100) + np.float32(0.5)))


@pytest.mark.filterwarnings("ignore::antway.maps.GreyTrapWarning")
@pytest.mark.parametrize("mode", ["trinary", "scale", "raw"])
@pytest.mark.parametrize("negate", [False, True])
@pytest.mark.parametrize(("free", "occupied"), [(0.196, 0.65), (0.25, 0.65), (0.2, 0.6), (0.0, 1.0), (0.4, 0.4), (0.5, 0.5)])
def test_every_grey_is_read_as_map_server_does(tmp_path: Path, mode: str, negate: bool, free: float, occupied: float) -> None:
    """All 256 greys, opaque and not, in each mode; thresholds are inclusive and free wins a tie."""
    pixels = np.full((2, 256, 2), 255, dtype=np.uint8)
    pixels[:, :, 0] = np.arange(256)
    pixels[1, :, 1] = np.arange(256)[::-1]
    Image.fromarray(pixels).save(tmp_path / "a.png")
    text = YAML.decode().replace("a.pgm", "a.png").replace("trinary", mode.upper()).replace("0.196", repr(free))
    (tmp_path / "a.yaml").write_text(text.replace("0.65", repr(occupied)).replace("negate: 0", f"negate: {negate}"))
    costs, grid = load_costs(tmp_path / "a.yaml"), load_map(tmp_path / "a.yaml")
    wanted = [[cost(int(g), int(a), mode, negate, free, occupied) for g, a in row] for row in pixels[::-1]]
    assert costs.dtype == np.int8 and costs.tolist() == wanted
    assert np.array_equal(grid.blocked, (costs == 100) | (costs == -1))
    assert np.array_equal(grid.unknown if grid.unknown is not None else costs == -2, costs == -1)
    assert (grid.resolution, grid.origin) == (0.05, (-1.0, 2.5, 0.3))


def test_other_largest_values_are_scaled_to_the_nearest_grey(tmp_path: Path) -> None:
    for text, greys in (("100 0 1 50 100", [0, 3, 128, 255]), ("254 0 100 200 254", [0, 100, 201, 255])):
        (tmp_path / "a.pgm").write_text(f"P2 4 1 {text}")
        assert read_grey(tmp_path / "a.pgm", DEFAULT)[0].tolist() == [greys]


def test_arrays_of_any_order_and_type(tmp_path: Path) -> None:
    """Booleans and integers, by rows or by columns, of each version of the format."""
    for data in (
        npy("|b1", False, "(2, 2)", b"\0\1\1\1"),
        npy("|u1", True, "(2, 2)", b"\0\1\1\1", 2),
        npy(">i2", False, "(2, 2)", b"\0\0\0\1\0\1\0\1", 3),
    ):
        (tmp_path / "a.npy").write_bytes(data)
        assert load_map(tmp_path / "a.npy").blocked.astype(int).tolist() == [[0, 1], [1, 1]]
    (tmp_path / "a.npy").write_bytes(npy("<i4", True, "(2, 2)", b"\0\0\0\0" + b"\1\0\0\0" + b"\0" * 8))
    assert load_map(tmp_path / "a.npy").blocked.astype(int).tolist() == [[0, 0], [1, 0]]


def test_pictures_as_other_programs_write_them(tmp_path: Path) -> None:
    """Comments, white space before the end, two bytes a pixel, bits, palettes, colours, and 16 bits."""
    palette = {"PLTE": b"\xff\xff\xff\0\0\0\xff\xff\xff"}
    for data, blocked, unknown in (
        (b"P5\n# CREATOR: GIMP\n2\t1\r\n# 9 9\n255\n\xff\0\n", [0, 1], None),
        (b"P2 2 # wide\n1 15\n15 # white\n0 # black\n", [0, 1], None),
        (b"P5 2 1 65535 \xff\xff\0\xff", [0, 1], None),
        (b"P5 2 1 256 \1\0\0\x80", [0, 0], None),
        (b"P5 2 1 1 \1\0", [0, 1], None),
        (b"P5 2 1 255#\n\xff\n", [0, 1], None),
        (b"P2 2 1 65535 65535 10000", [0, 1], None),
        (png(0, 1, b"\x80"), [0, 1], None),
        (png(3, 8, b"\0\1", **palette), [0, 1], None),
        (png(3, 8, b"\2\1", **palette, tRNS=b"\xff\xff\0"), [1, 1], [1, 0]),
        (png(2, 8, b"\0\xff\0\xff\0\0"), [0, 1], None),  # green is bright, and red is not
        (png(4, 8, b"\xff\xff\xff\xfe"), [0, 1], [0, 1]),
        (png(4, 16, b"\xff\xff\xff\xff\0\xff\xff\xff"), [0, 1], None),
        (png(6, 8, b"\xff\xff\xff\0\xff\xff\xff\xff"), [1, 0], [1, 0]),
        (png(0, 16, b"\x7f\xff\x80\x00"), [1, 0], None),
    ):
        (tmp_path / "a.png").write_bytes(data)
        grid = load_map(tmp_path / "a.png", resolution=1.0)
        assert grid.blocked.astype(int).tolist() == [blocked], data
        assert (None if grid.unknown is None else grid.unknown.astype(int).tolist()) == (unknown and [unknown]), data


def test_large_pictures_are_read_in_bands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The bands, and the blocks of decimals, join without a seam."""
    monkeypatch.setattr(image, "_BAND", 7)  # two rows of three pixels
    rng = np.random.default_rng(8)
    for pixels in (rng.integers(0, 65536, (7, 3), np.uint16), rng.integers(0, 256, (7, 3, 2), np.uint8)):
        Image.fromarray(pixels).save(tmp_path / "a.png")
        grey, clear = read_grey(tmp_path / "a.png", DEFAULT)
        if clear is None:
            assert grey.tolist() == np.rint(pixels / 257).tolist()
        else:
            assert grey.tolist() == pixels[:, :, 0].tolist() and clear.tolist() == (pixels[:, :, 1] < 255).tolist()
    decimals = rng.integers(0, 256, 120_000)
    (tmp_path / "a.pgm").write_text("P2 400 300 255\n" + "\n".join(map(str, decimals)))
    assert np.array_equal(read_grey(tmp_path / "a.pgm", DEFAULT)[0].ravel(), decimals)


def test_what_load_map_is_given_is_checked(tmp_path: Path) -> None:
    """Limits and thresholds out of range, what a ROS map holds itself, and what is neither a file nor a scene."""
    (tmp_path / "a.pgm").write_bytes(b"P5 2 1 255 \xfd\xfc")
    (tmp_path / "a.yaml").write_bytes(YAML)
    assert load_map(tmp_path / "a.pgm", resolution=1.0, occupied=1).blocked.tolist() == [[False, True]]
    for name, given in (("a.pgm", {"limits": 3}), ("a.pgm", {"occupied": 0}), ("a.pgm", {"occupied": 101})):
        with pytest.raises(BadParameter, match=next(iter(given))):
            load_map(tmp_path / name, resolution=1.0, **given)  # type: ignore[arg-type]
    for given in ({"resolution": 0.05}, {"origin": (0.0, 0.0, 0.0)}):
        with pytest.raises(BadParameter, match="which holds its own"):
            load_map(tmp_path / "a.yaml", **given)  # type: ignore[arg-type]
    with pytest.raises(BadMap, match="a shipped scene: paper"):
        load_map("ofice")


def test_grey_trap(tmp_path: Path) -> None:
    """Unknown cells that load as free are counted in a warning that says what to set; at 0.196 there is none."""
    Image.fromarray(np.array([[205, 205, 0, 254]], dtype=np.uint8)).save(tmp_path / "a.png")
    text = YAML.replace(b"a.pgm", b"a.png")
    (tmp_path / "a.yaml").write_bytes(text.replace(b"0.196", b"0.25"))
    with pytest.warns(GreyTrapWarning, match=r"2 cells .*set free_thresh to 0\.196") as warned:
        assert load_map(tmp_path / "a.yaml").blocked.tolist() == [[False, False, True, False]]
        assert load_costs(tmp_path / "a.yaml").tolist() == [[0, 0, 100, 0]]
    assert [one.filename for one in warned] == [__file__] * 2, "warnings name the line that asked for the map"
    (tmp_path / "a.yaml").write_bytes(
        text.replace(b"0.196", b"0.9").replace(b"0.65", b"0.95").replace(b"negate: 0", b"negate: 1")
    )
    assert load_costs(tmp_path / "a.yaml").tolist() == [[0, 0, 0, 100]], "with `negate` that grey means something else"
    (tmp_path / "a.yaml").write_bytes(text.replace(b"0.196", b"0.25"))
    Image.fromarray(np.array([[204, 0, 254]], dtype=np.uint8)).save(tmp_path / "a.png")  # no cell of that grey
    assert not load_costs(tmp_path / "a.yaml").flags.writeable
    Image.fromarray(np.array([[205, 205, 0, 254]], dtype=np.uint8)).save(tmp_path / "a.png")
    (tmp_path / "a.yaml").write_bytes(text)
    grid = load_map(tmp_path / "a.yaml")
    assert grid.unknown is not None and grid.unknown.tolist() == [[True, True, False, False]]
    (tmp_path / "a.yaml").write_bytes(text.replace(b"trinary", b"scale"))  # a threshold of 0.196 was advised, which it has
    with pytest.warns(GreyTrapWarning, match=r"2 cells .* because in mode scale .* set mode to trinary"):
        assert load_costs(tmp_path / "a.yaml").tolist() == [[0, 0, 100, 0]]


def test_a_picture_of_noughts_and_ones(tmp_path: Path) -> None:
    """Greys of 0 and 1 in a picture of 255 are both black; a warning says so, unless the threshold tells them apart."""
    Image.fromarray(np.eye(3, dtype=np.uint8)).save(tmp_path / "a.png")
    with pytest.warns(GreyTrapWarning, match=r"every cell is blocked; save 0 and 255") as warned:
        assert load_map(tmp_path / "a.png", resolution=1.0).blocked.all()
    assert warned[0].filename == __file__
    assert not load_map(tmp_path / "a.png", resolution=1.0, occupied=100).blocked.diagonal().any()
    Image.fromarray(np.zeros((3, 3), dtype=np.uint8)).save(tmp_path / "black.png")
    assert load_map(tmp_path / "black.png", resolution=1.0).blocked.all()


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_round_trip(tmp_path: Path, suffix: str) -> None:
    """C19: what is saved loads as it was, and is saved again as the same bytes."""
    rng = np.random.default_rng(6)
    for i in range(cases(150, 1000)):
        grid = random_grid(rng, 1, 30)
        if suffix in (".yaml", ".yml"):
            unknown = rng.random(grid.shape) < 0.5
            grid = Grid(grid.blocked, float(rng.uniform(1e-3, 9)), tuple(rng.uniform(-50, 50, 3)), unknown)
        first, second = tmp_path / f"{i}" / f"m{suffix}", tmp_path / f"{i}b" / f"m{suffix}"
        for file in (first, second):
            file.parent.mkdir()
        save_map(grid, first)
        again = load_map(first)
        assert again == grid
        save_map(again, second)
        assert [f.read_bytes() for f in sorted(first.parent.iterdir())] == [
            f.read_bytes() for f in sorted(second.parent.iterdir())
        ]


def test_awkward_names(tmp_path: Path) -> None:
    """A map whose name YAML would read otherwise still finds its picture."""
    for name in ("a: b", "#x", "yes", "'q\"", "ünï", "0x1f", "- a", " s "):
        save_map(Grid(np.eye(2, dtype=bool)), tmp_path / f"{name}.yaml")
        assert load_map(tmp_path / f"{name}.yaml").blocked.sum() == 2


@pytest.mark.parametrize("suffix", [s for s in SUFFIXES if not s.startswith(".y")])
def test_formats_refuse_what_they_cannot_hold(tmp_path: Path, suffix: str) -> None:
    """Resolution, origin and unknown cells are never dropped silently; they can be given at loading."""
    cells = np.ones((2, 2), dtype=bool)
    for grid, field in (
        (Grid(cells, 0.5), "resolution"),
        (Grid(cells, origin=(0.0, 1.0, 0.0)), "origin"),
        (Grid(cells, unknown=cells), "unknown"),
    ):
        with pytest.raises(BadParameter) as caught:
            save_map(grid, tmp_path / f"a{suffix}")
        assert caught.value.field == field
    save_map(Grid(cells, unknown=~cells), tmp_path / f"a{suffix}")
    placed = load_map(tmp_path / f"a{suffix}", resolution=0.5, origin=(1.0, 2.0, 0.5))
    assert placed == Grid(cells, 0.5, (1.0, 2.0, 0.5))
    for wrong in ({"resolution": -1.0}, {"origin": (0.0, 0.0)}):
        with pytest.raises(BadParameter):
            load_map(tmp_path / f"a{suffix}", **wrong)  # type: ignore[arg-type]


def test_saving_where_one_cannot(tmp_path: Path) -> None:
    """A folder that is not there and an unknown suffix are `BadMap`; what is no grid is `BadParameter`."""
    for name in ("no/a.txt", "a.xyz", "a\0b.map", "a" * 5000 + ".yaml"):
        with pytest.raises(BadMap):
            save_map(Grid(np.zeros((1, 1), dtype=bool)), tmp_path / name)
    with pytest.raises(BadParameter):
        save_map("grid", tmp_path / "a.txt")  # type: ignore[arg-type]


def test_what_names_no_file() -> None:
    """Names that no file can have, and what is no name."""

    class Bytes(os.PathLike[bytes]):
        def __fspath__(self) -> bytes:
            return b"a.map"

    for wrong in ("a" * 5000, "a\0b", "a\0b.map", b"a.map", 3, Bytes()):
        with pytest.raises(BadMap):
            load_map(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("kind", "depth", "pixels", "key"),
    [
        (0, 1, b"\x80", b"\0\1"),
        (0, 2, b"\x90", b"\0\2"),
        (0, 4, b"\xa7", b"\0\x0a"),
        (0, 8, b"\xa7\xff", b"\0\xa7"),
        (0, 16, b"\xa7\x12\xff\xff", b"\xa7\x12"),
        (2, 8, b"\xa7\xa7\xa7\xff\xff\xff", b"\0\xa7" * 3),
        (2, 16, b"\xa7\x12" * 3 + b"\xff\xff" * 3, b"\xa7\x12" * 3),
    ],
)
def test_the_transparent_colour_of_every_kind_of_png(tmp_path: Path, kind: int, depth: int, pixels: bytes, key: bytes) -> None:
    """The first of two pixels has the colour that the file declares to be transparent, and so it is unknown."""
    (tmp_path / "a.png").write_bytes(png(kind, depth, pixels, tRNS=key))
    grid = load_map(tmp_path / "a.png", resolution=1.0)
    assert grid.unknown is not None
    assert grid.unknown.tolist() == [[True, False]]


KINDS = {0: (1, 2, 4, 8, 16), 2: (8, 16), 3: (1, 2, 4, 8), 4: (8, 16), 6: (8, 16)}  # of PNG: the bits of a sample


@pytest.mark.parametrize(("kind", "depth"), [(kind, depth) for kind, depths in KINDS.items() for depth in depths])
def test_pixels_of_every_kind_are_what_the_standard_says(tmp_path: Path, kind: int, depth: int) -> None:
    """Greys, colours, palettes and alpha, with and without a transparent colour; of colours of 16 bits the first 8 count."""
    rng, top = np.random.default_rng(depth), 2**depth - 1
    for case in range(cases(8, 300)):
        shape = 9, {2: 3, 4: 2, 6: 4}.get(kind, 1)
        samples = rng.choice((0, 1, top // 2, top), shape) if case % 2 else rng.integers(0, top + 1, shape)
        palette, alpha = rng.integers(0, 256, (top + 1, 3)), rng.choice((0, 254, 255), top + 1)
        more = {"PLTE": palette.astype(np.uint8).tobytes()} if kind == 3 else {}
        eight = samples >> max(depth - 8, 0)
        colours = palette[samples[:, 0]] if kind == 3 else eight[:, :3]
        grey = eight[:, 0] if kind == 4 else np.rint(samples[:, 0] * 255 / top)
        if kind in (2, 3, 6):
            grey = colours @ (306, 601, 117) >> 10  # the luma of Rec. 601 in 1024ths
        clear = eight[:, -1] < 255 if kind in (4, 6) else np.zeros(9, bool)
        if kind in (0, 2, 3) and case % 4 < 2:
            more["tRNS"] = (alpha.astype(np.uint8) if kind == 3 else samples[4].astype(">u2")).tobytes()
            compared = eight if kind == 2 else samples
            clear = alpha[samples[:, 0]] < 255 if kind == 3 else (compared == compared[4]).all(axis=1)
        bits = "".join(f"{sample:0{depth}b}" for sample in samples.ravel())
        bits += "0" * (-len(bits) % 8)
        (tmp_path / "a.png").write_bytes(png(kind, depth, int(bits, 2).to_bytes(len(bits) // 8, "big"), (9, 1), **more))
        found, transparent = read_grey(tmp_path / "a.png", DEFAULT)
        assert found.tolist() == [grey.tolist()]
        assert (np.zeros((1, 9), bool) if transparent is None else transparent).tolist() == [clear.tolist()]


def test_all_seeds_load(tmp_path: Path) -> None:
    """The sound files load, and the three PGM and three array files hold the same cells."""
    grids = {f.name: load_map(f) for f in seeds(tmp_path) if f.suffix != ".scen"}
    assert grids["a.pgm"] == grids["c.pgm"] == grids["d.png"] == grids["f.png"] == grids["b.pgm"]
    assert grids["a.npy"] == grids["b.npy"] == grids["c.npy"]
    assert grids["a.map"].blocked.astype(int).tolist() == [[0, 1, 0, 0], [1, 1, 1, 1], [0, 0, 0, 0]]
    assert grids["a.txt"].blocked.astype(int).tolist() == [[0, 1, 0, 1], [0, 1, 0, 1]]
    rows = load_scen(tmp_path / "a.scen")
    assert rows[0] == (0, "maps/a.map", 4, 3, (2, 0), (2, 3), 3.0)
    assert len(rows) == 2


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        (b"resolution: 0.05", b"", "resolution"),
        (b"0.05", b"-0.05", "resolution"),
        (b"0.05", b".nan", "resolution"),
        (b"0.05", b"1e30", "resolution"),
        (b"0.05", b"[1]", "resolution"),
        (b"0.05", b"1_0", "resolution"),
        (b"[-1.0, 2.5, 0.3]", b"[1, 2]", "origin"),
        (b"[-1.0, 2.5, 0.3]", b"[1, .inf, 0]", "origin[1]"),
        (b"negate: 0", b"", "negate"),
        (b"negate: 0", b"negate: maybe", "negate"),
        (b"0.65", b"65", "occupied_thresh"),
        (b"0.65", b"0.1", "free_thresh"),
        (b"0.196", b"nan", "free_thresh"),
        (b"trinary", b"binary", "mode"),
        (b"mode:", b"image:", "image"),
        (b"image: a.pgm", b"", "image"),
        (b"image: a.pgm", b"image: none.pgm", "file"),
        (b"image: a.pgm", b"image: a.yaml", "content"),
        (YAML, b"- a", "YAML"),
        (YAML, b"", "YAML"),
        (YAML, b"a: [", "YAML"),
    ],
)
def test_wrong_descriptions(tmp_path: Path, old: bytes, new: bytes, field: str) -> None:
    """Each wrong value of a ROS description is a `BadParameter`, each missing or doubled part a `BadMap`; both name it."""
    seeds(tmp_path)
    assert old in YAML
    (tmp_path / "a.yaml").write_bytes(YAML.replace(old, new))
    with pytest.raises(BadInput) as caught:
        load_map(tmp_path / "a.yaml")
    structure = new in (b"", b"image:", b"- a", b"a: [") or new.startswith(b"image: ")
    assert type(caught.value) is (BadMap if structure else BadParameter)
    assert caught.value.field == field
    assert caught.value.where.startswith(str(tmp_path)) and "must be" in str(caught.value)


def test_scen_faults(tmp_path: Path) -> None:
    """A wrong row of a .scen names its line and field."""
    for row, field in (
        ("0 a 4 3 4 0 0 0 1", "start x"),
        ("0 a 4 3 0 3 0 0 1", "start y"),
        ("0 a 4 3 0 0 4 0 1", "goal x"),
        ("0 a 4 3 0 0 0 3 1", "goal y"),
        ("0 a 0 3 0 0 0 0 1", "start x"),
        ("0 a 9999999999 3 0 0 0 0 1", "width"),
        ("0 a 4 9999999999 0 0 0 0 1", "height"),
        ("0 a 4 3 0 0 0 0 nan", "length"),
        ("0 a 4 3 0 0 0 0 1e999", "length"),
        ("0 a 4 3 0 0 0 0 1_0", "length"),
        ("9999999999 a 4 3 0 0 0 0 1", "bucket"),
        ("0 a 4 3 0 0 0 0", "number of fields"),
        ("-1 a 4 3 0 0 0 0 1", "bucket"),
    ):
        (tmp_path / "a.scen").write_text(f"version 1\n{row}\n")
        with pytest.raises(BadScenario) as caught:
            load_scen(tmp_path / "a.scen")
        assert caught.value.field == field and "line 2" in caught.value.where
    (tmp_path / "a.scen").write_text("version 1.0 \n\n3\ta map.map\t4\t3\t3\t2\t0\t1\t4.5e0\t\n0 b 4 3 0 0 0 0 1\n")
    first, second = load_scen(tmp_path / "a.scen", limits=Limits(rows=3))
    assert first == (3, "a map.map", 4, 3, (2, 3), (1, 0), 4.5) and second.map == "b"
    for text in ("version 1.0 \n\n3\ta\n0 b\n", "version 1\n3 a\n0 b\n1 c"):
        (tmp_path / "b.scen").write_text(text)
        with pytest.raises(TooLarge, match="rows = 3: must be at most 2"):
            load_scen(tmp_path / "b.scen", limits=Limits(rows=2))
    (tmp_path / "b.scen").write_text("version 1\n0 b 4 3 0 0 0 0 0\n\n\n")
    (row,) = load_scen(tmp_path / "b.scen", limits=Limits(rows=1))  # what is empty behind the last row is no row
    assert row.length == 0.0
    (tmp_path / "b.scen").write_text("version 1" + " " * 248)
    with pytest.raises(TooLarge, match="at most 256 bytes"):
        load_scen(tmp_path / "b.scen", limits=Limits(rows=1))
    with pytest.raises(BadParameter, match="limits"):
        load_scen(tmp_path / "a.scen", limits=3)  # type: ignore[arg-type]
    (tmp_path / "a.scen").write_text("version 2\n")
    with pytest.raises(BadScenario, match="version 1"):
        load_scen(tmp_path / "a.scen")
    for field in ("cells", "rows"):
        with pytest.raises(BadParameter, match=field):
            Limits(**{field: 0})


@needs_data
@pytest.mark.filterwarnings("ignore::antway.maps.GreyTrapWarning")
def test_real_maps() -> None:
    """Every real map loads: ROS maps with the cells of map_server's rule, MovingAI maps with every problem's ends free."""
    blocked = {"depot": 5947, "depot_keepout": 31213, "depot_speed": 3735, "tb3_sandbox": 139553, "testmap": 29,
               "lse_arena": 345, "corridor": 3684, "maze": 1494}  # fmt: skip
    for name, count in blocked.items():
        (path,) = (SHARED / "ros_maps").glob(f"*/{name}.yaml")
        assert load_map(path).blocked.sum() == count, name
    for path in sorted((SHARED / "movingai").glob("*.map")):
        grid = load_map(path)
        for row in load_scen(path.with_suffix(".map.scen")):
            assert grid.shape == (row.height, row.width) and grid.is_free(row.start) and grid.is_free(row.goal)
    for path in [*(SHARED / "mapf_yaml").glob("*.yaml"), SHARED / "ros_maps/nav2_test/invalid_image.yaml"]:
        with pytest.raises(BadInput):
            load_map(path)


@pytest.mark.filterwarnings("default:.*a picture does not say")
def test_a_picture_without_a_resolution_says_so(tmp_path):
    """A pixel of 1 m is said aloud, unless the resolution is given; formats made of cells say nothing."""
    grid = Grid(np.eye(3, dtype=bool))
    for suffix, warned in ((".png", 1), (".pgm", 1), (".map", 0), (".txt", 0), (".npy", 0)):
        file = tmp_path / f"map{suffix}"
        save_map(grid, file)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            assert load_map(file).top_first == (suffix != ".npy")
            assert [(one.category, one.filename) for one in caught] == [(ResolutionWarning, __file__)] * warned
            load_map(file, resolution=0.05)
            assert len(caught) == warned


def test_occupancy_between_free_and_certain(tmp_path):
    """`occupied` says from which cost of a ROS map a cell is blocked; unknown cells are blocked at any."""
    (tmp_path / "a.pgm").write_bytes(b"P5 4 1 255\n" + bytes([0, 50, 99, 255]))
    (tmp_path / "a.yaml").write_text(
        "image: a.pgm\nresolution: 0.5\norigin: [0, 0, 0]\nnegate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.2\nmode: raw\n"
    )
    (tmp_path / "b.txt").write_text("..\n@.\n")
    for occupied, blocked in ((100, [0, 0, 0, 1]), (99, [0, 0, 1, 1]), (50, [0, 1, 1, 1])):
        assert load_map(tmp_path / "a.yaml", occupied=occupied).blocked.astype(int).tolist() == [blocked]
    for occupied, blocked in ((None, [0, 1, 1]), (50, [0, 1, 1]), (40, [1, 1, 1]), (100, [0, 0, 1]), (99, [0, 0, 1])):
        Image.fromarray(np.array([[153, 127, 0]], np.uint8)).save(tmp_path / "b.png")  # 40, just over 50 and 100 % black
        assert load_map(tmp_path / "b.png", resolution=1.0, occupied=occupied).blocked.astype(int).tolist() == [blocked]
    with pytest.raises(BadParameter, match="occupied"):
        load_map(tmp_path / "a.yaml", occupied=0)
    with pytest.raises(BadParameter, match="occupied"):
        load_map(tmp_path / "b.txt", occupied=50)
