"""Hostile map files: spoilt ones, bombs, unsafe content. Each gives a `BadInput` or a map, in bounded time and memory."""

from __future__ import annotations

import os
import pickle
import random
import resource
import subprocess
import sys
import time
import warnings
import zlib
from pathlib import Path

import numpy as np
import pytest

from antway.errors import BadInput, BadMap, TooLarge
from antway.maps import Limits, load_costs, load_map, load_scen
from common import cases
from mapfiles import YAML, npy, png, seeds, spoil

REGRESSIONS = sorted((Path(__file__).parent / "regressions").glob("map-*"))


def attempt(path: Path) -> None:
    """Load `path`; whatever is not a `BadInput` gets through."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            load_scen(path) if path.suffix == ".scen" else load_map(path)
        except BadInput as wrong:
            assert str(wrong) and wrong.field and wrong.where.startswith(str(path.parent))


def spoilt_run(folder: Path, count: int, seed: int) -> float:
    """Load `count` spoilt files; returns the longest time in s."""
    files = seeds(folder)
    sound = {file: file.read_bytes() for file in files}
    dice = random.Random(seed)
    longest = 0.0
    for _ in range(count):
        file = dice.choice(files)
        data = spoil(sound[file], list(sound.values()), dice)
        file.write_bytes(data)
        started = time.perf_counter()
        try:
            attempt(folder / "a.yaml" if file.name == "a.pgm" and dice.random() < 0.5 else file)
        except Exception:
            print(file.suffix, data)
            raise
        longest = max(longest, time.perf_counter() - started)
        file.write_bytes(sound[file])
    return longest


def bounded(code: str, *, base: str = "import antway.maps.image, PIL.PngImagePlugin, test_maps_spoilt") -> float:
    """Run `code` in its own process and return by how many MiB it raised the peak of memory over `base`."""
    script = (
        f"import resource\n{base}\nfrom pathlib import Path\n"
        f"start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss\n{code}\n"
        "print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - start) / 1024)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, cwd=Path(__file__).parent, timeout=3600, check=False
    )
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr[-2000:]
    return float(done.stdout.split()[-1])


def test_spoilt_files_are_refused_or_read(tmp_path: Path) -> None:
    """C14: thousands of spoilt files each give a map or a `BadInput` within 2 s, and memory stays within 256 MiB."""
    code = f"assert test_maps_spoilt.spoilt_run(Path({str(tmp_path)!r}), {cases(5000, 500000)}, 1) < 2.0"
    assert bounded(code) < 256


@pytest.mark.parametrize("path", REGRESSIONS, ids=lambda p: p.name)
def test_regressions(path: Path) -> None:
    """Files that once got through as something else give a map or a `BadInput`."""
    attempt(path)


def _bombs(folder: Path) -> list[Path]:
    def chunk(kind: bytes, data: bytes) -> bytes:
        return len(data).to_bytes(4, "big") + kind + data + zlib.crc32(kind + data).to_bytes(4, "big")

    png = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", (50000).to_bytes(4, "big") * 2 + b"\x08\0\0\0\0")
    packer = zlib.compressobj(1)
    zeros = b"".join(packer.compress(bytes(50001)) for _ in range(2000)) + packer.flush()
    npy = b"{'descr': '|b1', 'fortran_order': False, 'shape': (100000, 100000), }\n"
    laughs = "a0: &a0 [x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 10))
    files = {
        "square.pgm": b"P5\n65536 65536\n255\n" + bytes(1000),
        "line.pgm": b"P2 1000000000 1 255\n0 0 0",
        "zeros.png": png + chunk(b"IDAT", zeros) + chunk(b"IEND", b""),
        "laughs.yaml": laughs.encode() + YAML,
        "deep.yaml": b"[" * 60000,
        "long.yaml": b"- a\n" * 100000,
        "tall.map": b"type octile\nheight 1000000000\nwidth 1\nmap\n.\n",
        "wide.npy": b"\x93NUMPY\x01\0" + len(npy).to_bytes(2, "little") + npy,
    }
    for name, data in files.items():
        (folder / name).write_bytes(data)
    sparse = folder / "gigabyte.txt"
    with sparse.open("wb") as file:
        file.truncate(10**9)
    return [*(folder / name for name in files), sparse]


def test_bombs(tmp_path: Path) -> None:
    """C15: what would unpack to more than the limit is `TooLarge` before memory is taken for it."""
    for path in _bombs(tmp_path):
        started = resource.getrusage(resource.RUSAGE_SELF)
        with pytest.raises(TooLarge):
            load_map(path)
        assert resource.getrusage(resource.RUSAGE_SELF).ru_utime - started.ru_utime < 2.0
    code = f"for p in {[str(p) for p in tmp_path.iterdir()]}:\n    test_maps_spoilt.attempt(Path(p))"
    assert bounded(code) <= 64


def test_limits_can_be_set(tmp_path: Path) -> None:
    """A map of exactly the limit loads and one of a cell more does not."""
    path = tmp_path / "a.txt"
    path.write_text("...\n...\n")
    assert load_map(path, limits=Limits(cells=6)).shape == (2, 3)
    assert load_map(path, limits=Limits(cells=np.int8(120))).shape == (2, 3), "three times as many bytes are no int8"
    with pytest.raises(TooLarge, match="at most 5 cells"):
        load_map(path, limits=Limits(cells=5))


@pytest.mark.parametrize(
    "image",
    [
        "../a.pgm",
        "/etc/passwd",
        "sub/../../a.pgm",
        "out.pgm",
        "folder.pgm",
        "pipe.pgm",
        "zero.pgm",
        "loop.pgm",
        "",
        "x" * 5000,
        "b.pgm",
    ],
)
def test_pictures_stay_in_the_folder(tmp_path: Path, image: str) -> None:
    """C16: nothing outside the folder of the YAML is read, and pipes and devices neither read nor waited for."""
    (tmp_path / "a.pgm").write_bytes(b"P5 1 1 255\n\0")
    home = tmp_path / "home"
    (home / "sub").mkdir(parents=True)
    (home / "folder.pgm").mkdir()
    os.symlink("../a.pgm", home / "out.pgm")
    os.symlink("/dev/zero", home / "zero.pgm")
    os.symlink("loop.pgm", home / "loop.pgm")
    os.mkfifo(home / "pipe.pgm")
    (home / "a.yaml").write_bytes(YAML.replace(b"a.pgm", b"'" + image.encode() + b"'"))
    with pytest.raises(BadMap) as caught:
        load_map(home / "a.yaml")
    assert str(home) in caught.value.where


def test_a_picture_in_the_folder_may_be_named_in_any_way(tmp_path: Path) -> None:
    """ROS 1 writes absolute names where it was told where to save the map."""
    (tmp_path / "sub").mkdir()
    seeds(tmp_path)
    known = load_map(tmp_path / "a.yaml")
    for image in (tmp_path / "a.pgm", f"../{tmp_path.name}/a.pgm", "./sub/../a.pgm"):
        (tmp_path / "b.yaml").write_bytes(YAML.replace(b"a.pgm", str(image).encode()))
        assert load_map(tmp_path / "b.yaml") == known


def test_linked_maps_load(tmp_path: Path) -> None:
    """A YAML and a picture that are both links into one other folder load, as workspaces of ROS install them."""
    home, installed = tmp_path / "src", tmp_path / "install"
    home.mkdir()
    installed.mkdir()
    seeds(home)
    for name in ("a.yaml", "a.pgm"):
        os.symlink(home / name, installed / name)
    assert load_map(installed / "a.yaml") == load_map(home / "a.yaml")


class _Trap:
    def __reduce__(self) -> tuple[object, ...]:
        return os.mkdir, ("executed",)


def test_nothing_is_executed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """C16: tags of Python objects and pickles are refused unread."""
    monkeypatch.chdir(tmp_path)
    Path("a.yaml").write_bytes(b"image: !!python/object/apply:os.mkdir [executed]\n" + YAML)
    np.save("a.npy", np.array([_Trap()], dtype=object), allow_pickle=True)
    Path("b.npy").write_bytes(pickle.dumps(_Trap()))
    for name in ("a.yaml", "a.npy", "b.npy"):
        with pytest.raises(BadMap):
            load_map(name)
    assert not Path("executed").exists()


@pytest.mark.parametrize(
    "name", ["missing.map", "folder.map", "pipe.map", "a.xyz", "none", "a\0.map", "x" * 3000 + ".map", "empty.map"]
)
def test_paths_that_are_no_map(tmp_path: Path, name: str) -> None:
    """A path that is missing, a folder, a pipe, empty or of no known suffix is a `BadMap` that names it."""
    (tmp_path / "folder.map").mkdir()
    os.mkfifo(tmp_path / "pipe.map")
    (tmp_path / "empty.map").touch()
    with pytest.raises(BadMap) as caught:
        load_map(tmp_path / name)
    assert caught.value.where == str(tmp_path / name)


@pytest.mark.parametrize("value", [None, 3, b"a.map", 1.5, []])
def test_what_is_no_path(value: object) -> None:
    """What is no path is a `BadMap`, from each of the loaders."""
    for load in (load_map, load_costs, load_scen):
        with pytest.raises(BadInput):
            load(value)  # type: ignore[operator]


@pytest.mark.parametrize(
    ("data", "field"),
    [
        (b"x" + npy(), "header"),
        (npy()[:11], "header"),
        (npy()[:30], "header"),
        (npy(version=4), "header"),
        (npy(shape="(2,)"), "header"),
        (npy(shape="(1, 2), 'shape': (1, 2)"), "header"),
        (npy("|O"), "descr"),
        (npy("<f8"), "descr"),
        (npy(shape="(0, 2)"), "height x width"),
        (npy(data=b"\0"), "bytes of data"),
        (npy(data=b"\0\0\0"), "bytes of data"),
        (npy(data=b"\0\2"), "value"),
        (npy("<i2", data=b"\1\0\xff\xff"), "value"),
    ],
)
def test_wrong_arrays(tmp_path: Path, data: bytes, field: str) -> None:
    """A wrong array is a `BadMap` that names what is wrong with it."""
    (tmp_path / "a.npy").write_bytes(data)
    with pytest.raises(BadMap) as wrong:
        load_map(tmp_path / "a.npy")
    assert (wrong.value.field, wrong.value.where) == (field, str(tmp_path / "a.npy"))


@pytest.mark.parametrize(
    ("name", "data", "field"),
    [
        ("a.txt", b"", "height x width"),
        ("a.txt", b"..\n.x\n", "character 2 of map line 2 = 'x'"),
        ("a.txt", b"..\n...\n", "length of map line 2 = 3"),
        ("a.txt", b"..\n\n..\n", "length of map line 2 = 0"),
        ("a.map", b"type hex\nheight 1\nwidth 2\nmap\n..\n", "type"),
        ("a.map", b"type octile\nheight 0\nwidth 2\nmap\n..\n", "height x width"),
        ("a.map", b"type octile\nheight 2\nwidth 2\nmap\n..\n", "number of map lines"),
        ("a.map", b"type octile\nheight 1\nwidth 2\nmap\n..\n..\n", "number of map lines"),
        ("a.map", b"type octile\nheight 1\nwidth 2\nmap\n.\n", "length of map line 1 = 1"),
        ("a.map", b"type octile\nheight 90\nwidth 2\nmap\n..\n", "size of the file"),
        ("a.map", b"type octile\nheight 1\nwidth 2\nmap\n..\n" + b"\n" * 2**17, "size of the file"),
        ("a.map", b"height 1\nwidth 2\nmap\n..\n", "header"),
    ],
)
def test_wrong_characters(tmp_path: Path, name: str, data: bytes, field: str) -> None:
    """A wrong map of characters is a `BadMap` that names what is wrong, and in which line."""
    (tmp_path / name).write_bytes(data)
    with pytest.raises(BadMap) as wrong:
        load_map(tmp_path / name)
    assert str(wrong.value).startswith(f"{tmp_path / name}: {field}") and wrong.value.where == str(tmp_path / name)


@pytest.mark.parametrize(
    ("data", "field"),
    [
        (b"P6 1 1 255 \0\0\0", "content"),
        (b"P5 x 1 255 \0", "header"),
        (b"P5 0 1 255 ", "height x width"),
        (b"P5 2 1 0 \0\0", "largest value"),
        (b"P5 2 1 65536 \0\0\0\0", "largest value"),
        (b"P5 2 1 255 \0", "bytes of pixels"),
        (b"P5 2 1 256 \0\0\0", "bytes of pixels"),
        (b"P5 2 1 255 \0\0\1", "bytes of pixels"),
        (b"P5 2 1 9 \0\x0a", "pixel"),
        (b"P2 2 1 255 1", "bytes of pixels"),
        (b"P2 2 1 255 100", "number of pixels"),
        (b"P2 2 1 255 1 2 3", "number of pixels"),
        (b"P2 2 1 255 1 x", "pixel"),
        (b"P2 2 1 255 1 000001", "pixel"),
        (b"P2 2 1 65535 1 65536", "pixel"),
        (png(0, 8, b"\0\0")[:30], "header"),
        (png(0, 8, b"", (0, 1)), "height x width"),
        (png(1, 8, b"\0\0"), "colour type and depth"),
        (png(0, 3, b"\0\0"), "colour type and depth"),
        (png(0, 8, b"\0\0", (5000, 5000)), "size of the file"),
        (png(0, 8, b"\0"), "content"),
    ],
)
def test_wrong_pictures(tmp_path: Path, data: bytes, field: str) -> None:
    """A wrong picture is a `BadMap` that names what is wrong with it."""
    (tmp_path / "a.pgm").write_bytes(data)
    with pytest.raises(BadMap) as wrong:
        load_map(tmp_path / "a.pgm", resolution=1.0)
    assert (wrong.value.field, wrong.value.where) == (field, str(tmp_path / "a.pgm"))


@pytest.mark.parametrize(("kind", "samples"), [(0, 1), (2, 3), (3, 1), (4, 2), (6, 4)])
def test_no_png_unpacks_to_more_than_a_file_can_hold(tmp_path: Path, kind: int, samples: int) -> None:
    """A byte unpacks to 1032 at most: whatever claims more is refused before memory is taken, and only that."""
    most = 1032 * len(png(kind, 8, b"")) // samples
    for width, field in ((most, "content"), (most + 1, "size of the file")):
        (tmp_path / "a.png").write_bytes(png(kind, 8, b"", (width, 1)))
        with pytest.raises(BadMap) as wrong:
            load_map(tmp_path / "a.png", resolution=1.0)
        assert wrong.value.field == field
