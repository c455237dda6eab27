"""What docs/ names is there: tests in checks.md, functions in architecture.md; and no page uses words that were replaced."""

from __future__ import annotations

import ast
import pkgutil
import re
import subprocess
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest

import antway
from antway import Grid, RobotSpec, Scenario, load_scenario, run, save_map
from antway.arena.store import COLUMNS
from antway.world.motions import MOTIONS
from antway.world.sensor import Sensor
from antway.world.stops import Stop
from antway.world.trace import Outcome

ROOT = Path(__file__).parents[1]
DOCS = sorted((ROOT / "docs").rglob("*.md"))
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
    """C1 to C50 have one row each, in order, with a test or a command."""
    rows = re.findall(r"^\| C(\d+) \|[^|]+\| ([^|]+) \|", CHECKS, re.MULTILINE)
    assert [int(number) for number, _ in rows] == list(range(1, 51))
    assert all("::" in tests or "python " in tests for _, tests in rows)


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


def test_what_the_equations_name_is_there() -> None:
    """Each module, function or class of antway that docs/equations.md names can be imported."""
    named = set(re.findall(r"`((?:kernels|ants)\.[\w.]+)`", (ROOT / "docs" / "equations.md").read_text()))
    assert len(named) > 15
    for name in sorted(named):
        pkgutil.resolve_name(f"antway.{name}")


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


def headings(text: str) -> set[str]:
    """The anchors of a page's headings, as GitHub and MyST make them."""
    found = re.findall(r"^#+ (.+)$", re.sub(r"```.*?```", "", text, flags=re.DOTALL), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", one.lower()).strip().replace(" ", "-") for one in found}


@pytest.mark.parametrize("page", [ROOT / "README.md", *DOCS], ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    """Every relative link of a page leads to a file, and its anchor to a heading; the reference is made when the site is."""
    for link, anchor in re.findall(r"\]\(([^)#:\s]*)(#[^)\s]*)?\)", page.read_text(encoding="utf-8")):
        target = page if not link else page.parent / link
        if target.name != "reference.md":
            assert target.exists(), link
            if anchor and target.suffix == ".md":
                assert anchor[1:] in headings(target.read_text(encoding="utf-8")), (link, anchor)


def test_no_page_has_a_name_of_sphinx() -> None:
    """Sphinx writes search.html and genindex.html itself, over a page of that name."""
    assert not {page.stem for page in DOCS if page.parent.name == "docs"} & {"search", "genindex", "py-modindex"}


SCENARIOS = (ROOT / "docs" / "scenarios.md").read_text(encoding="utf-8")
START, *PARTS = re.findall(r"^```toml\n(.*?)^```", SCENARIOS, re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: " ".join(part.split()[:6]))
def test_every_example_of_a_scenario_is_played(part: str, tmp_path: Path) -> None:
    """The examples of the scenario reference load, each after the first lines, and an episode of each runs for two seconds."""
    save_map(Grid(np.zeros((40, 60), bool), 0.1), tmp_path / "hall.yaml")
    (tmp_path / "my.toml").write_text(START + part)
    result = run(load_scenario(tmp_path / "my.toml"), "follow", horizon=2.0)
    assert result.outcome.value in ("timeout", "reached") or result.outcome.value.startswith("hit-"), result.reason


def test_every_key_and_motion_is_in_the_scenario_reference() -> None:
    """Each key of a scenario, robot, sensor and stop has a row, each motion a section with its keys and an example."""
    for kind in (Scenario, RobotSpec, Sensor, Stop):
        for one in fields(kind):
            if one.init and one.name not in ("world", "robot", "sensor", "stops"):
                assert f"| `{one.name}` |" in SCENARIOS, one.name
    for name, motion in MOTIONS.items():
        section = SCENARIOS.split(f"### `{name}`\n")[1].split("\n#")[0]
        assert all(f"`{one.name}`" in section for one in fields(motion) if one.init), name
        assert f'motion = "{name}"' in section


def test_public_classes_have_examples() -> None:
    """Classes that are made by their users show how."""
    for kind in (antway.Grid, antway.Moves, antway.Problem, antway.Budget, antway.RobotSpec, antway.World, antway.Tracks):
        assert ">>>" in str(kind.__doc__), kind


def test_every_column_of_results_is_described() -> None:
    """The table in the arena's page has each column of the results, and each outcome."""
    page = (ROOT / "docs" / "arena.md").read_text(encoding="utf-8")
    table = page.partition("## Columns of the results")[2].partition("## Suites")[0]
    assert set(COLUMNS) | {one.value for one in Outcome} == set(re.findall(r"`([\w-]+)`", table))
