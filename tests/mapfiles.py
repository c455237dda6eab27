"""Small sound map files of every format, and seeded ways to spoil them."""

from __future__ import annotations

import io
import random
import struct
import zlib
from pathlib import Path

import numpy as np
from PIL import Image

YAML = b"""image: a.pgm
mode: trinary
resolution: 0.05
origin: [-1.0, 2.5, 0.3]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
_WORDS = [
    b"\0", b"\r\n", b"\r", b"\n", b"\xef\xbb\xbf", b"-1", b"1e30", b"nan", b".nan", b".inf", b"NaN", b"99999999999", b"65536",
    b"0", b"", b" ", b"#", b"[", b"{", b"&a [*a]", b"!!python/object:os.system", b"\xff\xfe", b"256", b"3.5", b"true", b"P2",
    b"P5", b"\x89PNG\r\n\x1a\n", b"\x93NUMPY", b"type octile", b"version 1", "\u0663".encode(), b"-0", b"1_0", b"\\", b"'",
    b'"',
]  # fmt: skip


def seeds(folder: Path) -> list[Path]:
    """Write sound files of every map format into `folder` and return them; `a.pgm` is the picture of `a.yaml`."""
    rng = np.random.default_rng(5)
    grey = rng.choice(np.array([0, 100, 205, 254], dtype=np.uint8), (6, 5))
    rgba = rng.integers(0, 256, (6, 5, 4), dtype=np.uint8)
    files = {
        "a.pgm": b"P5\n# made by hand\n5 6\n255\n" + grey.tobytes(),
        "b.pgm": b"P2\n5 6 # wide, high\n254\n" + b"\n".join(b" ".join(b"%d" % v for v in row) for row in grey),
        "c.pgm": b"P5 5 6 65535\n" + (grey.astype(">u2") * 257).tobytes(),
        "a.yaml": YAML,
        "b.yml": b"# comment\nfree_thresh: 1e-1\nimage: 'd.png'\nmode: scale\nresolution: 1\norigin:\n- 0\n- 0.0\n- 0\n"
        b"negate: false\noccupied_thresh: 0.9\n",
        "a.map": b"type octile\nheight 3\nwidth 4\nmap\n.@GS\nTTOW\n....\n",
        "a.txt": b".@.#\n01.X\n",
        "a.scen": b"version 1\n0\tmaps/a.map\t4\t3\t0\t2\t3\t2\t3.0\n1\ta.map\t4\t3\t0\t0\t3\t0\t3.41421356\n",
    }
    pictures = {"d": Image.fromarray(grey), "e": Image.fromarray(rgba), "f": Image.fromarray(grey).convert("P")}
    for name, picture in pictures.items():
        buffer = io.BytesIO()
        picture.save(buffer, format="PNG")
        files[f"{name}.png"] = buffer.getvalue()
    for name, cells in {"a": grey > 99, "b": (grey > 99).astype(">i4"), "c": np.asfortranarray(grey > 99)}.items():
        buffer = io.BytesIO()
        np.save(buffer, cells)
        files[f"{name}.npy"] = buffer.getvalue()
    for name, data in files.items():
        (folder / name).write_bytes(data)
    return [folder / name for name in files]


def spoil(data: bytes, others: list[bytes], dice: random.Random) -> bytes:
    """Return `data` with one to four faults: flipped bits, cut, swapped heads, numbers and marks put in, parts doubled."""
    spoilt = bytearray(data)
    for _ in range(dice.randint(1, 4)):
        at = dice.randrange(len(spoilt) + 1)
        span = dice.randint(0, 6)
        fault = dice.randrange(8)
        if fault == 0 and spoilt:
            spoilt[dice.randrange(len(spoilt))] ^= 1 << dice.randrange(8)
        elif fault == 1:
            del spoilt[at:]
        elif fault == 2:
            other = dice.choice(others)
            cut = dice.randint(1, 40)
            spoilt[:cut] = other[:cut]
        elif fault in (3, 4):
            spoilt[at : at + span] = dice.choice(_WORDS)
        elif fault == 5:
            spoilt[at : at + 4] = struct.pack(dice.choice("<>") + "i", dice.choice([-1, 0, 1, 50000, 2**31 - 1]))
        elif fault == 6:
            spoilt[at:at] = spoilt[at : at + dice.randint(1, 60)] * dice.randint(1, 50)
        else:
            digits = [i for i, b in enumerate(spoilt) if 48 <= b <= 57]
            if digits:
                i = dice.choice(digits)
                spoilt[i : i + 1] = dice.choice([b"-7", b"1e30", b"65536", b"50000", b"NaN", b"0"])
    return bytes(spoilt)


def png(kind: int, depth: int, pixels: bytes, size: tuple[int, int] = (2, 1), **more: bytes) -> bytes:
    """A PNG of one line of pixels, with `more` chunks."""
    parts = {"IHDR": struct.pack(">IIBBBBB", *size, depth, kind, 0, 0, 0), **more}
    parts |= {"IDAT": zlib.compress(b"\0" + pixels), "IEND": b""}
    chunks = [(name.encode(), data) for name, data in parts.items()]
    packed = (struct.pack(">I", len(d)) + n + d + struct.pack(">I", zlib.crc32(n + d)) for n, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(packed)


def npy(descr: str = "|b1", order: bool = False, shape: str = "(1, 2)", data: bytes = b"\0\1", version: int = 1) -> bytes:
    """An array file."""
    head = f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY" + bytes([version, 0]) + struct.pack("<H" if version == 1 else "<I", len(head)) + head + data
