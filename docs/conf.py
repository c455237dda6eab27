"""Sphinx: pages are Markdown (MyST), the reference is made of docstrings, links out of docs/ lead to the repository."""

from __future__ import annotations

import logging
import os
import re
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "src"))

from antway import _HOME  # noqa: E402
from antway.version import __version__  # noqa: E402

project, author, release = "antway", "the antway authors", __version__
project_copyright = author
extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
html_theme, html_title = "furo", f"antway {__version__}"
html_static_path, html_css_files = ["static"], ["site.css"]
exclude_patterns = ["build", "_build", "jupyter_execute"]
nb_merge_streams, nb_execution_raise_on_error, nb_execution_timeout = True, True, 300  # tutorials are run when the site is made
logging.getLogger("traitlets").setLevel(logging.WARNING)
os.environ |= {
    "ANTWAY_QUIET": "1",
    "PYTHONPATH": os.pathsep.join(filter(None, (str(ROOT / "src"), os.environ.get("PYTHONPATH")))),
}
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 3
suppress_warnings = ["misc.highlighting_failure"]  # console blocks and TOML fragments are checked by the tests
autodoc_typehints, autodoc_class_signature = "none", "mixed"
napoleon_google_docstring = False
napoleon_use_ivar = True  # attributes of a class are described once, where the class is
REPOSITORY = "https://github.com/antway/antway/blob/main/"


def _outward(app: Any, name: str, source: list[str]) -> None:
    """Let links from a page to files outside docs/ lead to the repository."""
    ups = "../" * (name.count("/") + 1)
    source[0] = re.sub(rf"\]\({re.escape(ups)}(?!\.\./)", f"]({REPOSITORY}", source[0])


def _reference(app: Any) -> None:
    """Write the page of every public name, grouped by the module that defines it."""
    lines = ["# Reference", "", "Every public name of `antway` with its docstring, grouped by module. Errors come last.", ""]
    for module, names in sorted(_HOME.items(), key=lambda item: item[0] == "errors"):
        lines += [f"## antway.{module}", "", "```{eval-rst}"]
        for name in names.split():
            value = getattr(__import__("antway"), name)
            kind = "data" if isinstance(value, dict) else "class" if isinstance(value, type) else "function"
            if kind == "data":
                lines += [f".. py:data:: antway.{name}", "", f"   {', '.join(value)}.", ""]
            else:
                members = ["   :members:"] if kind == "class" and not issubclass(value, Exception) else []
                lines += [f".. auto{kind}:: antway.{name}", *members, ""]
        lines += ["```", ""]
    text = "\n".join(lines)
    page = Path(app.srcdir) / "reference.md"
    if not page.is_file() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def _indented(app: Any, what: str, name: str, value: Any, options: Any, lines: list[str]) -> None:
    """Set what reStructuredText would take for its own: stars and bars in formulas, and lines that go on."""
    for i, line in enumerate(lines):
        if not line.lstrip().startswith((">>>", "...")):
            lines[i] = re.sub(r"(?<![`*\w])\*(?=\*?\w)", r"\\*", re.sub(r"\|(?=\w)", r"\\|", line))


def setup(app: Any) -> None:
    """Connect the above."""
    app.connect("source-read", _outward)
    app.connect("builder-inited", _reference)
    app.connect("autodoc-process-docstring", _indented)
