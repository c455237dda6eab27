"""What the README and the guide show is run, word for word, and so is every example."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from antway.cli import main

ROOT = Path(__file__).resolve().parents[1]
GUIDES = [f"docs/howto/{name}.md" for name in ("map", "policy", "robot")]
PAGES = ("README.md", "docs/start.md", "docs/guide.md", "docs/architecture.md", "docs/colonies.md", *GUIDES)
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


@pytest.mark.parametrize("script", sorted((ROOT / "examples").glob("*.py")), ids=lambda script: script.stem)
def test_examples_run(script: Path, tmp_path: Path) -> None:
    """Every example has at most forty lines and runs without a word on stderr."""
    assert len(script.read_text(encoding="utf-8").splitlines()) <= 40
    done = subprocess.run(
        [sys.executable, "-W", "error", str(script)],
        cwd=tmp_path,
        env={**os.environ, "TMPDIR": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0 and done.stderr == "", done.stderr
    assert done.stdout
