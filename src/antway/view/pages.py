"""What the HTML pages share: their files, the data and pictures inside them, and the hashes of their security policies."""

from __future__ import annotations

import base64
import hashlib
import io
import re
from collections.abc import Mapping
from importlib.resources import files
from typing import TYPE_CHECKING, Any

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
