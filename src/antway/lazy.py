"""Loads the drawing code of `antway.view` on demand, so that records below it can show themselves in notebooks."""

from __future__ import annotations

import importlib
from typing import Any


def drawing() -> Any:
    """Return the module that draws records."""
    return importlib.import_module("antway.view.notebook")
