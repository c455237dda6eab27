"""A way up the house for what draws: a record shows itself in a notebook by what stands above it, loaded when it is asked."""

from __future__ import annotations

import importlib
from typing import Any


def drawing() -> Any:
    """Return the module that draws records."""
    return importlib.import_module("antway.view.notebook")
