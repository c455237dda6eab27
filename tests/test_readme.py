"""What the README and the guide show is run, word for word, and so is every example."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import tempfile
import warnings
from functools import cache
from pathlib import Path

import pytest

from antway.cli import main

ROOT = Path(__file__).resolve().parents[1]
GUIDES = [f"docs/howto/{name}.md" for name in ("map", "policy", "robot")]
PAGES = ("README.md", "docs/start.md", "docs/guide.md", "docs/tours.md", "docs/colonies.md", *GUIDES)
BLOCKS = [
    (page, kind, text)
    for page in PAGES
    for kind, text in re.findall(r"^```(\w+)\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
]


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which the repository's files lie, and what is written is thrown away."""
    for name in ("src", "examples", "docs"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("page", PAGES)
def test_blocks_run_in_order(page: str, place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every Python block and every `antway` command of a page runs, each after those before it; commands end with status 0."""
    names: dict[str, object] = {}
    for where, kind, text in BLOCKS:
        if where == page and kind == "python":
            exec(compile(text, page, "exec"), names)
        for line in text.splitlines() if where == page and kind == "console" else ():
            assert line.startswith("$ antway"), line
            monkeypatch.setattr(sys, "argv", shlex.split(line[2:]))
            with pytest.raises(SystemExit) as end, warnings.catch_warnings():
                main()
            assert not end.value.code, line


@pytest.mark.parametrize("page", PAGES)
def test_links_and_pictures_are_there(page: str) -> None:
    """Every relative link of a page leads to a file."""
    for link in re.findall(r"\]\(([^)#:]+)\)", (ROOT / page).read_text(encoding="utf-8")):
        assert (ROOT / page).parent.joinpath(link).exists(), link


@cache
def played(script: Path) -> subprocess.CompletedProcess[str]:
    """What came of an example, run in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        return subprocess.run(
            [sys.executable, "-W", "error", str(script)],
            cwd=folder,
            env={**os.environ, "TMPDIR": folder, "ANTWAY_QUIET": "1"},
            capture_output=True,
            text=True,
        )


@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda script: script.stem)
def test_examples_run(script: Path) -> None:
    """Every example has at most forty lines and runs without a word on stderr."""
    assert len(script.read_text(encoding="utf-8").splitlines()) <= 40
    done = played(script)
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert done.stdout


README = (ROOT / "README.md").read_text(encoding="utf-8")


def table(text: str, head: str) -> dict[str, list[str]]:
    """The rows of the table below a line that begins so, by their first cells, without what makes cells bold or code."""
    rows = text[text.index(head) :].split("\n\n")[0].splitlines()[2:]
    cells = [[cell.strip(" *`") for cell in row.strip("|").split("|")] for row in rows]
    return {first: rest for first, *rest in cells}


def test_lengths_of_ants_are_what_the_example_prints() -> None:
    """The README's table of ants and exact search has the gaps that examples/ants_or_exact.py prints, to a percent."""
    done = played(ROOT / "examples" / "ants_or_exact.py")
    done.check_returncode()
    gaps = [float(gap) for gap in re.findall(r"([\d.]+) %", done.stdout)]
    named = [row[0] for row in table(README, "| planner | length over").values()]
    assert named == [f"{gap:.0f} %" for gap in (gaps[0], *gaps[2:])]


def test_the_readme_repeats_what_the_pages_of_docs_say() -> None:
    """The README's figures of speed and of robots are those of docs/shortest_paths.md and docs/robots.md, rounded."""
    search = table((ROOT / "docs/shortest_paths.md").read_text(encoding="utf-8"), "| map | nano-astar |")
    for name, (jps, subgoals, prepared) in table(README, "| map | `jps`").items():
        *_, faster, fastest, taken = search[name]
        for shown, whole in ((jps, faster), (subgoals, fastest)):
            assert shown == (whole if "." in shown else f"{float(whole):.0f}"), name
        assert taken.endswith(prepared), name
    robots = table((ROOT / "docs/robots.md").read_text(encoding="utf-8"), "| suite `synthetic` on `diff` |")
    for level, cells in table(README, "| level | `antway`").items():
        for shown, whole in zip(cells, robots[level]):
            assert re.findall(r"[\d.]+", shown) == re.findall(r"[\d.]+", re.sub(r" of \d+", "", whole)), level
    colonies = (ROOT / "docs/colonies.md").read_text(encoding="utf-8")
    assert (
        "5.1 and 7.5 times as many tours a second as ACOTSP" in README
        and "5.1 and 7.5 times as many tours a second as ACOTSP" in colonies
    )


def test_figures_that_the_readme_sums_up_are_those_of_docs() -> None:
    """The README's first lines, and its line on people, follow from the tables of docs/robots.md and docs/people.md."""
    robots, people = ((ROOT / f"docs/{name}.md").read_text(encoding="utf-8") for name in ("robots", "people"))
    rows = table(robots, "| suite `synthetic` on `diff` |").values()
    numbers = [[float(number) for cell in row[:2] for number in re.findall(r"[\d.]+", cell)] for row in rows]
    reached = sum(round(300 * success / 100) for success, *_ in numbers)
    others, longer = [row[2] for row in numbers], [100 * (row[3] / row[1] - 1) for row in numbers]
    found = [
        f"a differential robot reaches {reached} of 900 goals",
        f"reaches {min(others):.0f} to {max(others):.0f} %, and takes {min(longer):.0f} to {max(longer):.0f} % longer",
    ]
    recordings = table(people, "| recording | episodes |").values()
    cells = [[float(re.findall(r"[\d.]+", cell)[0]) for cell in row] for row in recordings]
    episodes, ours, exact = sum(row[0] for row in cells), *(sum(round(row[0] * row[k] / 100) for row in cells) for k in (1, 2))
    found += [f"{ours} of {episodes:.0f} robots without inertia arrive"]
    found += [f"{exact} do, up to {100 * (max(row[-1] for row in cells) - 1):.0f} % sooner"]
    without, learning = re.findall(r"\d+", table(robots, "| how the robot differs |")["answers 0.2 s later"][0])[:2]
    found += [f"`diff` reaches {learning} of 60 goals, and {without} without learning"]
    suites = table(robots, "| suite | episodes | success |")
    among = sorted(float(row[1].split()[0]) for suite, row in suites.items() if suite.startswith("tracks:"))
    found += [f"`diff` reaches {among[0]:.0f} to {among[2]:.0f} % of its goals in three of four recordings"]
    text = " ".join(README.split())
    assert not [one for one in found if one not in text]
