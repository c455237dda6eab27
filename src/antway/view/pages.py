"""What pages share: their files, numbers and pictures as text inside them, and the hashes of their security policies."""

from __future__ import annotations

import base64
import hashlib
import io
import math
import re
from collections.abc import Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from PIL import Image


def asset(name: str, package: str = "antway.view") -> str:
    """Return the text of a file in the folder `static` of a package."""
    return (files(package) / "static" / name).read_text(encoding="utf-8")


def filled(template: str, parts: Mapping[str, str]) -> str:
    """Return a template with the text of `parts` in place of each {{name}}."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: parts[match[1]], template)


def embedded(json: str) -> str:
    """Return JSON as it may stand inside a page, without characters that end its element."""
    return json.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def digest(text: str) -> str:
    """Return the hash by which a security policy allows a script or a style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def png_url(picture: Image.Image, **options: Any) -> str:
    """Return a picture as the address of a PNG; `options` are those of Pillow."""
    file = io.BytesIO()
    picture.save(file, "PNG", optimize=True, **options)
    return "data:image/png;base64," + base64.b64encode(file.getvalue()).decode()


def to_base64(values: NDArray[Any], dtype: str) -> str:
    """Return numbers as base64 of their bytes as `dtype`, such as "<f4"."""
    return base64.b64encode(np.ascontiguousarray(values).astype(dtype).tobytes()).decode()


def bits_to_base64(mask: NDArray[np.bool_]) -> str:
    """Return a mask as base64 of its bits, row by row, the lowest bit of a byte first."""
    return base64.b64encode(np.packbits(mask.ravel(), bitorder="little").tobytes()).decode()


def rounded(value: float, digits: int = 6) -> float | None:
    """Return a number with this many decimal places for JSON; None if it is not finite."""
    return round(float(value), digits) + 0.0 if math.isfinite(value) else None  # never -0.0


def faint_scale(amount: NDArray[Any]) -> NDArray[Any]:
    """Scale pheromone from 0 (least) to 1 (most), by the square root so that faint trails are visible."""
    low, high = float(amount.min()), float(amount.max())
    return np.sqrt((amount - low) / (high - low)) if high > low else np.zeros_like(amount)
