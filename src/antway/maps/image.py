"""Pictures and arrays as maps: PNG, PGM (plain and raw) and NumPy's .npy; the first line of the picture is row 0."""

from __future__ import annotations

import re
import struct
import warnings
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadMap
from antway.grid import Grid
from antway.maps.limits import HEAD, Limits
from antway.reading import opened, word_blocks

_SPACE = rb"(?:\s|#[^\r\n]*[\r\n])++"  # white space and comments between the numbers of a PGM header
_PGM = re.compile(rb"P([25])" + (_SPACE + rb"(\d{1,18})") * 3 + rb"(?:#[^\r\n]*)?\s")  # up to the first pixel
_PNG = b"\x89PNG\r\n\x1a\n"
_DEFLATE = 1032  # largest number of bytes that a byte of a PNG can expand to
_BAND = 2**20  # pixels converted to grey at a time
_NPY = {name: re.compile(rf"'{name}'\s*:\s*{value}".encode()) for name, value in {
    "descr": r"'([^']{1,40})'", "fortran_order": r"(True|False)", "shape": r"\(\s*(\d{1,18})\s*,\s*(\d{1,18})\s*,?\s*\)",
}.items()}  # fmt: skip

Picture = tuple[NDArray[np.uint8], NDArray[np.bool_] | None]  # grey 0 to 255, and where it is not fully opaque


class GreyTrapWarning(UserWarning):
    """Cells that were saved as unknown load as free, by `free_thresh` or `mode`, or all greys are 0 or 1 of 255."""


def read(path: Path, limits: Limits, occupied: int = 50) -> Grid:
    """Read a PNG or PGM: pixels of `occupied` % black are blocked, pixels that are not opaque unknown (and so blocked)."""
    grey, clear = read_grey(path, limits)
    blocked = grey <= 255 * (100 - occupied) // 100
    if grey.max() == 1 and blocked.all():
        warnings.warn(
            f"{path}: all pixels have grey 0 or 1 of 255, so every cell is blocked; save 0 and 255, or the array as .npy",
            GreyTrapWarning,
            stacklevel=3,
        )
    if clear is None:
        return Grid(blocked)
    return Grid(blocked | clear, unknown=clear)


def read_grey(path: Path, limits: Limits) -> Picture:
    """Read a PNG or PGM as grey values, uint8[H, W] with the top line first, and its transparent pixels."""
    with opened(path, limits.file_bytes) as (file, size):
        head = file.read(HEAD)
        if head.startswith(_PNG):
            return _png(file, head, size, path, limits)
        if head[:2] in (b"P2", b"P5"):
            return _pgm(file, head, size, path, limits), None
    raise BadMap("content", head[:8], "a PNG or a PGM (P2 or P5)", where=str(path))


def _pgm(file: BinaryIO, head: bytes, size: int, path: Path, limits: Limits) -> NDArray[np.uint8]:
    found = _PGM.match(head)
    if found is None:
        raise BadMap("header", head[:40], "P2 or P5, width, height and largest value", where=str(path))
    cols, rows, most = (int(n) for n in found.groups()[1:])
    limits.check_shape(rows, cols, path)
    if not 1 <= most <= 65535:
        raise BadMap("largest value", most, "an integer in [1, 65535]", where=str(path))
    count = rows * cols
    start, needed = found.end(), 2 * count - 1 if found[1] == b"2" else count * (1 if most < 256 else 2)
    if size - start < needed:
        raise BadMap("bytes of pixels", size - start, f"at least {needed} for {cols} x {rows} pixels", where=str(path))
    data = head[start:] + file.read()
    values: NDArray[np.unsignedinteger[Any]]
    if found[1] == b"2":
        values = _decimals(re.sub(rb"#[^\r\n]*", b"", data), count, path)
    else:
        if data[needed:].strip():
            raise BadMap("bytes of pixels", len(data), f"{needed} for {cols} x {rows} pixels", where=str(path))
        values = np.frombuffer(data, dtype=np.uint8 if most < 256 else ">u2", count=count)
    if values.max() > most:
        raise BadMap("pixel", int(values.max()), f"at most the largest value of the header, {most}", where=str(path))
    if most != 255:
        values = ((np.arange(most + 1) * 510 + most) // (2 * most)).astype(np.uint8)[values]
    return values.astype(np.uint8, copy=False).reshape(rows, cols)


def _decimals(data: bytes, count: int, path: Path) -> NDArray[np.uint16]:
    """Read `count` decimals of at most 5 digits, separated by white space, a block at a time."""
    values = np.empty(count, dtype=np.uint16)
    done = 0
    for words in word_blocks(data, 2**18):
        wrong = next((w for w in words if len(w) > 5 or not w.isdigit() or int(w) > 65535), None)
        if wrong is not None:
            raise BadMap("pixel", wrong, "an integer in [0, 65535]", where=str(path))
        if done + len(words) > count:
            raise BadMap("number of pixels", f"more than {count}", f"{count}", where=str(path))
        values[done : done + len(words)] = [int(w) for w in words]
        done += len(words)
    if done != count:
        raise BadMap("number of pixels", done, f"{count}", where=str(path))
    return values


def _png(file: BinaryIO, head: bytes, size: int, path: Path, limits: Limits) -> Picture:
    if len(head) < 33 or head[12:16] != b"IHDR":
        raise BadMap("header", head[8:24], "an IHDR chunk", where=str(path))
    cols, rows, depth, kind = struct.unpack(">IIBB", head[16:26])
    limits.check_shape(rows, cols, path)
    channels = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}.get(kind)
    if channels is None or depth not in (1, 2, 4, 8, 16):
        raise BadMap("colour type and depth", (kind, depth), "those of a PNG", where=str(path))
    if rows * cols * depth * channels // 8 > _DEFLATE * size:
        raise BadMap("size of the file", size, f"enough for {cols} x {rows} pixels", where=str(path))
    from PIL.PngImagePlugin import PngImageFile  # takes 0.2 s, so it comes after the checks against decompression bombs

    file.seek(0)
    grey = np.empty((rows, cols), dtype=np.uint8)
    clear = None
    try:
        picture = PngImageFile(file)
        picture.load()
        deep = picture.mode.startswith("I")
        key = picture.info.get("transparency")  # as stored, while Pillow compares it with pixels that it made 8 bits deep
        if key is not None and (kind, depth) in ((0, 2), (0, 4)):
            picture.info["transparency"] = key % 2**depth * 255 // (2**depth - 1)
        elif key is not None and (kind, depth) == (2, 16):
            picture.info["transparency"] = tuple(sample >> 8 for sample in key)
        step = max(1, _BAND // cols)
        for top in range(0, rows, step):
            band = picture.crop((0, top, cols, min(top + step, rows)))
            if deep:
                value = np.asarray(band).astype(np.uint32)
                grey[top : top + step] = (value * 255 + 32767) // 65535
                opaque = value != picture.info.get("transparency", -1)
            else:
                rgba = np.asarray(band.convert("RGBA")).astype(np.uint32)
                # the luma of Rec. 601 in 1024ths, as GraphicsMagick computes it for map_server; grey is unchanged
                grey[top : top + step] = (306 * rgba[..., 0] + 601 * rgba[..., 1] + 117 * rgba[..., 2]) >> 10
                opaque = rgba[..., 3] == 255
            if not opaque.all():
                clear = np.zeros((rows, cols), dtype=np.bool_) if clear is None else clear
                clear[top : top + step] = ~opaque
    except (OSError, SyntaxError, ValueError, EOFError, IndexError, KeyError, TypeError, struct.error, zlib.error) as fault:
        raise BadMap("content", path.name, f"a sound PNG ({fault})", where=str(path)) from None
    return grey, clear


def pgm(grey: NDArray[np.uint8]) -> bytes:
    """Return `grey`, uint8[H, W], as the bytes of a raw PGM."""
    return f"P5\n{grey.shape[1]} {grey.shape[0]}\n255\n".encode() + np.ascontiguousarray(grey).tobytes()


def write_pgm(grid: Grid, path: Path) -> None:
    """Write blocked cells black and free ones white."""
    path.write_bytes(pgm(_black_and_white(grid)))


def write_png(grid: Grid, path: Path) -> None:
    """Write blocked cells black and free ones white."""
    from PIL import Image

    Image.fromarray(_black_and_white(grid)).save(path, format="PNG")


def _black_and_white(grid: Grid) -> NDArray[np.uint8]:
    return np.where(grid.blocked, 0, 255).astype(np.uint8)


def read_npy(path: Path, limits: Limits) -> Grid:
    """Read a two-dimensional .npy of booleans, or of integers that are 0 or 1; objects (pickles) are refused unread."""
    where = str(path)
    with opened(path, limits.file_bytes) as (file, size):
        head = file.read(HEAD)
        if head[:6] != b"\x93NUMPY" or len(head) < 12 or head[6] not in (1, 2, 3):
            raise BadMap("header", head[:8], "that of an .npy file, version 1 to 3", where=where)
        header_end, length = (
            (10, struct.unpack("<H", head[8:10])[0]) if head[6] == 1 else (12, struct.unpack("<I", head[8:12])[0])
        )
        start = header_end + length
        found = {name: pattern.findall(head[header_end:start]) for name, pattern in _NPY.items()}
        if start > len(head) or any(len(values) != 1 for values in found.values()):
            allowed = "descr, fortran_order and a shape (rows, columns), each once"
            raise BadMap("header", head[header_end:start], allowed, where=where)
        kind = found["descr"][0].decode("latin-1")
        if re.fullmatch(r"\|b1|[|<>=][iu][1248]", kind) is None:
            raise BadMap("descr", kind, "a boolean or integer type (no objects, no pickles)", where=where)
        rows, cols = (int(n) for n in found["shape"][0])
        limits.check_shape(rows, cols, path)
        dtype = np.dtype(kind)
        if size - start != rows * cols * dtype.itemsize:
            raise BadMap("bytes of data", size - start, f"{rows * cols * dtype.itemsize} for shape {(rows, cols)}", where=where)
        values = np.frombuffer(head[start:] + file.read(), dtype=dtype if dtype.kind != "b" else np.uint8)
    if ((values != 0) & (values != 1)).any():
        wrong = int(values[(values != 0) & (values != 1)][0])
        raise BadMap("value", wrong, "0 or 1", where=where)
    return Grid(values.astype(np.bool_).reshape((rows, cols), order="F" if found["fortran_order"][0] == b"True" else "C"))


def write_npy(grid: Grid, path: Path) -> None:
    """Write the blocked cells as bool[H, W]."""
    with path.open("wb") as file:
        np.save(file, grid.blocked, allow_pickle=False)
