"""Every example of a docstring does what it shows, and every public class has one."""

from __future__ import annotations

import doctest
import importlib
from pathlib import Path

import pytest

import antway

SOURCE = Path(antway.__file__).parent
MODULES = sorted(
    ".".join(("antway", *path.relative_to(SOURCE).with_suffix("").parts)).removesuffix(".__init__")
    for path in SOURCE.rglob("*.py")
    if ">>>" in path.read_text(encoding="utf-8")
)
CLASSES = [name for name in antway.__all__ if isinstance(getattr(antway, name), type)]


@pytest.mark.parametrize("name", MODULES)
def test_examples_do_what_they_show(name: str) -> None:
    """The examples of a module's docstrings, each docstring for itself."""
    failed, tried = doctest.testmod(importlib.import_module(name))
    assert tried and not failed


@pytest.mark.parametrize("name", CLASSES)
def test_public_classes_have_an_example(name: str) -> None:
    """Who looks up a class of the package sees one made or met."""
    assert ">>>" in str(getattr(antway, name).__doc__)
