"""The tables of names are complete, and help texts and guides are made from them.

`python tests/test_tables.py` writes the tables in docs/ anew.
"""

from __future__ import annotations

import importlib
import math
import re
from pathlib import Path

import pytest
from typer.main import get_command

from antway.ants.rules import RULES
from antway.cli import app
from antway.grid import Moves
from antway.ros2.settings import parameters
from antway.tables import ABOUT, OF_FILES, PLANNERS, POLICIES, SUITES

DOCS = Path(__file__).parents[1] / "docs"
TABLES = {"planners": PLANNERS, "policies": POLICIES, "suites": SUITES}
HEADS = {"planners": "planner", "policies": "policy", "suites": "suite"}
PAGES = {"planners": "guide.md", "policies": "arena.md", "suites": "arena.md", "parameters": "ros2.md"}


def parameter_rows() -> list[str]:
    """A row for each parameter of the ROS 2 node, the node's own first: name, default, what it is."""
    rows = []
    for name, one in sorted(parameters().items(), key=lambda item: "." in item[0] and item[0] != "robot.name"):
        shown = {"True": "true", "False": "false", "inf": ".inf", str(math.pi): "pi", "": '""'}
        default = shown.get(str(one.default), one.default)
        rows.append(f"| `{name}` | {default} | {one.text.replace('|', '/')} |")
    return rows


def section(kind: str) -> str:
    """The Markdown table of a kind of names."""
    if kind == "parameters":
        head = ["<!-- parameters -->", "| parameter | default | what it is |", "|---|---|---|"]
        return "\n".join([*head, *parameter_rows(), "<!-- end -->"])
    names = {name: f"{name}:FILE" if kind == "suites" and name in OF_FILES else name for name in TABLES[kind]}
    rows = [f"| `{names[name]}` | {about} |" for name, about in ABOUT[kind].items()]
    return "\n".join([f"<!-- {kind} -->", f"| {HEADS[kind]} | what it is |", "|---|---|", *rows, "<!-- end -->"])


def place(kind: str) -> re.Pattern[str]:
    """Where the table of a kind of names stands in its page."""
    return re.compile(rf"<!-- {kind} -->.*?<!-- end -->", re.DOTALL)


@pytest.mark.parametrize("kind", TABLES)
def test_every_name_is_found_and_described(kind: str) -> None:
    """Each name leads to something that can be imported, and has its sentence."""
    assert list(ABOUT[kind]) == list(TABLES[kind])
    for target in TABLES[kind].values():
        module, _, attribute = target.partition(":")
        if "Orca" not in attribute:  # needs a package that is not always there
            assert callable(getattr(importlib.import_module(module), attribute))


@pytest.mark.parametrize("kind", PAGES)
def test_guides_show_the_tables(kind: str) -> None:
    """The table in docs/ is the one made from the table in the code: `python tests/test_tables.py` writes it."""
    found = place(kind).findall((DOCS / PAGES[kind]).read_text())
    assert found == [section(kind)]


def test_help_texts_name_every_choice() -> None:
    """Planners, policies, suites, moves and rules in the help texts are those there are."""
    commands = get_command(app).commands  # type: ignore[attr-defined]
    for command, option, choices in (
        ("plan", "planner", PLANNERS),
        ("plan", "moves", [moves.value for moves in Moves]),
        ("run", "policy", POLICIES),
        ("bench", "suite", [f"{name}:FILE" if name in OF_FILES else name for name in SUITES]),
        ("tsp", "rule", RULES),
    ):
        text = next(str(one.help) for one in commands[command].params if one.name == option)
        assert set(choices) <= set(re.findall(r"[\w:-]+", text)), (command, option, text)


def write() -> None:
    """Write the tables in docs/ anew."""
    for kind, page in PAGES.items():
        path = DOCS / page
        path.write_text(place(kind).sub(section(kind).replace("\\", r"\\"), path.read_text()))


if __name__ == "__main__":
    write()
