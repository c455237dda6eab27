"""What is done on demand: drawing code is loaded for records that show themselves in notebooks, alternatives are computed."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any


def drawing() -> Any:
    """Return the module that draws records."""
    return importlib.import_module("antway.view.notebook")


class Later(Sequence[tuple[str, float]]):
    """Alternatives of a decision that are computed when they are first used, and so are not looked at in the episode.

    Whoever makes them warrants that each of them is a name, a str, and a cost in s, a float.
    """
