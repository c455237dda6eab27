"""What docs/ names is there: tests in checks.md, functions in architecture.md; and no page uses words that were replaced."""

from __future__ import annotations

import ast
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CHECKS = (ROOT / "docs" / "checks.md").read_text(encoding="utf-8")
MAP = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
NAMED = sorted(set(re.findall(r"`(test_\w+\.py)::(\w+)`", CHECKS)))
INDEX = re.findall(
    r"^\| ([^|]+) \| ((?:`[^`|]+\.py`(?:, )?)+) \| ((?:`\w+`(?:, )?)+) \|$", MAP.split("## Where to find")[1], re.MULTILINE
)
OLD = r"rivals?|beliefs|errand|squad|labour|second_looks|way round|straight on"  # the words of the field stand in their place


def definitions(path: Path) -> set[str]:
    """Names of the functions and classes of a file."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    return {one.name for one in ast.walk(tree) if isinstance(one, ast.FunctionDef | ast.ClassDef)}


@pytest.mark.parametrize(("file", "name"), NAMED)
def test_every_test_named_is_there(file: str, name: str) -> None:
    """Each file::function of checks.md is a test."""
    assert name in definitions(ROOT / "tests" / file)


def test_every_check_has_its_row() -> None:
    """C1 to C50 have one row each, in order, with a test, a command, or the remark that it is to come."""
    rows = re.findall(r"^\| C(\d+) \|[^|]+\| ([^|]+) \|", CHECKS, re.MULTILINE)
    assert [int(number) for number, _ in rows] == list(range(1, 51))
    assert all("::" in tests or "python " in tests or tests == "to come" for _, tests in rows)


def test_every_promise_of_the_readme_has_its_checks() -> None:
    """The README's promises name checks that checks.md describes."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    numbers = [int(n) for row in re.findall(r"^\| P\d+ \|.*$", readme, re.MULTILINE) for n in re.findall(r"C(\d+)", row)]
    assert numbers and set(numbers) <= set(range(1, 51))


@pytest.mark.parametrize(("what", "files", "names"), INDEX, ids=[what for what, _, _ in INDEX])
def test_every_place_of_the_index_is_there(what: str, files: str, names: str) -> None:
    """Each row of "Where to find" names functions that its files define."""
    found = set[str]()
    for file in re.findall(r"`([^`]+)`", files):
        found |= definitions(ROOT / "src" / "antway" / file)
    assert set(re.findall(r"`([^`]+)`", names)) <= found


def test_the_index_is_read() -> None:
    """The index has as many rows as the test above finds."""
    assert (
        len(INDEX) == sum(line.startswith("| ") for line in MAP.split("## Where to find")[1].split("## ")[0].splitlines()) - 1
    )


def test_files_of_the_map_are_there() -> None:
    """Every file and folder in the tree of architecture.md exists."""
    tree = MAP.split("```text")[1].split("```")[0]
    for name in re.findall(r"^  (\w+(?:\.py|/))", tree, re.MULTILINE):
        assert (ROOT / "src" / "antway" / name).exists(), name
    for name in re.findall(r"^    (\w+(?:\.py|/))", tree, re.MULTILINE):
        assert (ROOT / "src" / "antway" / "kernels" / name).exists(), name


def test_no_page_uses_words_that_were_replaced() -> None:
    """README, CHANGELOG, docs and source keep to the words of the field."""
    done = subprocess.run(
        ["git", "grep", "-nwiE", OLD, "--", "src", "docs", "README.md", "CHANGELOG.md"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if done.returncode > 1:
        pytest.skip("not a git working copy")
    assert not done.stdout.splitlines()
