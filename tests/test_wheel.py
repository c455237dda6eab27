"""The wheel, installed into a clean environment, does what README.md says: as a user without rights or HOME, elsewhere."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from common import SCALE

ROOT = Path(__file__).resolve().parents[1]
NOBODY = 65534

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("hatchling") is None, reason="hatchling, which builds wheels, is missing"
)


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    program = "import sys; from hatchling.build import build_wheel; print(build_wheel(sys.argv[1]))"
    done = subprocess.run([sys.executable, "-c", program, str(out)], cwd=ROOT, capture_output=True, text=True, check=True)
    return out / done.stdout.split()[-1]


def interpreter() -> str:
    """A Python of this version that everybody may run; this one if there is no other."""
    system = Path(f"/usr/bin/python{sys.version_info.major}.{sys.version_info.minor}")
    for python in (Path(os.path.realpath(sys.executable)), system):
        if python.is_file() and all(part.stat().st_mode & 0o5 == 0o5 for part in python.parents):
            return str(python)
    return sys.executable


@pytest.fixture(scope="module")
def home(wheel: Path) -> Iterator[Path]:
    """An environment with the wheel, and with the packages that it needs from the one that runs the tests; open to all."""
    with tempfile.TemporaryDirectory(prefix="antway-wheel-") as name:
        folder = Path(name)
        subprocess.run([interpreter(), "-m", "venv", "--without-pip", str(folder / "venv")], check=True)
        install = ["install", "--no-deps", "--no-index", "--quiet", str(wheel)]
        subprocess.run([sys.executable, "-m", "pip", "--python", str(folder / "venv" / "bin" / "python"), *install], check=True)
        site = next((folder / "venv").glob("lib/python*/site-packages"))
        needed = next(Path(p) for p in sys.path if p.endswith("site-packages") and (Path(p) / "numba").is_dir())
        (site / "needed.pth").write_text(f"{needed}\n")
        for work in ("work", "tmp"):
            (folder / work).mkdir()
            (folder / work).chmod(0o777)
        folder.chmod(0o755)
        yield folder


def run(home: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the environment's Python in a folder of its own, as nobody if we are root and nobody may read all that it needs."""
    path = f"{home / 'venv' / 'bin'}{os.pathsep}{os.environ['PATH']}"
    given = {"PATH": path, "TMPDIR": str(home / "tmp"), "PYTHONDONTWRITEBYTECODE": "1", "ANTWAY_QUIET": "1"}
    needed = Path(next((home / "venv").glob("lib/python*/site-packages/needed.pth")).read_text().strip())
    folders = (*Path(interpreter()).parents, needed, *needed.parents)  # a checkout in a folder of mktemp -d is closed to others
    open_to_all = all(part.stat().st_mode & 0o5 == 0o5 for part in folders)
    user = {"user": NOBODY, "group": NOBODY} if os.getuid() == 0 and open_to_all else {}
    command = [str(home / "venv" / "bin" / "python"), *arguments]
    return subprocess.run(command, cwd=home / "work", env=given, capture_output=True, text=True, check=False, **user)


def test_a_wheel_is_small_and_whole(wheel: Path) -> None:
    """Under 1 MB, with the scenes, the pages' files and the marker of types; nothing of tests or caches."""
    assert wheel.stat().st_size < 1_000_000
    names = zipfile.ZipFile(wheel).namelist()
    for part in ("antway/scenes/office.toml", "antway/scenes/office.yaml", "antway/py.typed", "antway/web/static/"):
        assert any(name.startswith(part) for name in names), part
    assert not [name for name in names if "__pycache__" in name or name.startswith("tests")]


def test_links_of_the_readme_lead_somewhere_from_the_package_index(wheel: Path) -> None:
    """In the wheel every link and picture of the README is absolute, and those into the repository name a file of it."""
    archive = zipfile.ZipFile(wheel)
    name = next(name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    links = re.findall(r"\]\(([^)\s]+)\)", archive.read(name).decode())
    inside = [link for link in links if "/antway/antway/" in link]
    assert len(links) > 10 and all(link.startswith("https://") for link in links)
    assert any("raw.githubusercontent.com" in link for link in inside)
    assert all((ROOT / link.split("/main/")[1].split("#")[0]).exists() for link in inside)


def test_the_installed_package_is_the_wheels(home: Path) -> None:
    """What is imported is the wheel, not the checkout; the version is that of pyproject.toml."""
    done = run(home, "-c", "import antway; print(antway.__file__, antway.__version__)")
    version = re.search(r'^version = "(.+)"', (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE)
    assert done.stdout.split() == [
        str(next((home / "venv").glob("lib/python*/site-packages")) / "antway/__init__.py"),
        version[1],
    ]


def blocks(page: str) -> list[tuple[str, str, str]]:
    """The blocks of Python and of shell of a page, and why one is not run: a comment above it says so."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.findall(r"^(?:<!-- not run: (.+?) -->\n)?```(python|console|sh)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    pasted = [(kind, "".join(line.removeprefix("$ ") for line in body.splitlines(True)), why) for why, kind, body in found]
    return [(kind, body if kind == "python" else body.strip(), why) for kind, body, why in pasted]


PAGES = [str(page.relative_to(ROOT)) for page in (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))]
PASTED = [page for page in PAGES if any(not why for *_, why in blocks(page))]
LEFT = [(page, text, why) for page in PAGES for _, text, why in blocks(page) if why]
PASTE = """
import json, subprocess, sys
names = {"__name__": "__main__"}
for kind, text in json.loads(sys.argv[1]):
    print("---", text, flush=True)
    if kind == "python":
        exec(compile(text, "block", "exec"), names)
    else:
        subprocess.run(["sh", "-ec", text], check=True)
"""


@pytest.mark.parametrize("page", PASTED)
def test_blocks_run_as_pasted(home: Path, page: str) -> None:
    """A page's blocks run one after the other, Python's in one session; in pull requests those that compile nothing."""
    steps = [(kind, text) for kind, text, why in blocks(page) if not why]
    if SCALE <= 1.0:
        plain = page.endswith("howto/map.md")
        quick = [
            line for _, text in steps for line in text.splitlines() if re.match(r"antway (plan (office|house)|--help)", line)
        ]
        steps = [one for one in steps if one[0] == "python" and plain] + [
            ("sh", line) for line in quick if not re.search("ants|smooth", line)
        ]
    done = run(home, "-c", PASTE, json.dumps(steps))
    assert done.returncode == 0, (done.stdout[-500:], done.stderr[-2000:])


@pytest.mark.parametrize(("page", "text", "why"), LEFT)
def test_blocks_that_are_not_run(page: str, text: str, why: str) -> None:
    """A block that is left out says why, for whoever reads the page's source and the list of skipped tests."""
    pytest.skip(f"{page}, `{text.splitlines()[0]}`: {why}")
