"""The wheel, installed into a clean environment, does what README.md says: as a user without rights or HOME, elsewhere."""

from __future__ import annotations

import importlib.util
import os
import re
import shlex
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
PAGES = ("README.md", "docs/start.md", "docs/howto/map.md")

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
        site = next((folder / "venv").glob("lib/python*/site-packages"))
        with zipfile.ZipFile(wheel) as archive:
            archive.extractall(site)
        needed = next(Path(p) for p in sys.path if p.endswith("site-packages") and (Path(p) / "numba").is_dir())
        (site / "needed.pth").write_text(f"{needed}\n")
        for work in ("work", "tmp"):
            (folder / work).mkdir()
            (folder / work).chmod(0o777)
        folder.chmod(0o755)
        yield folder


def run(home: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the environment's Python in a folder of its own, as nobody if we are root and nobody may read this Python."""
    given = {"PATH": os.environ["PATH"], "TMPDIR": str(home / "tmp"), "PYTHONDONTWRITEBYTECODE": "1", "ANTWAY_QUIET": "1"}
    open_to_all = all(part.stat().st_mode & 0o5 == 0o5 for part in Path(interpreter()).parents)
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


def blocks(page: str) -> list[tuple[str, str]]:
    """The blocks of a page that are run, and how."""
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.findall(r"^```(python|console)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    steps: list[tuple[str, str]] = []
    for kind, body in found:
        steps += [("python", body)] if kind == "python" else [("console", line[2:]) for line in body.splitlines()]
    return steps


@pytest.mark.parametrize("page", PAGES)
def test_blocks_run_as_pasted(home: Path, page: str) -> None:
    """Blocks of Python and of shell run one after the other; in pull requests those that compile nothing."""
    program = "import sys\nfrom antway.cli import main\nsys.argv[0] = 'antway'\nmain()"
    for kind, text in blocks(page):
        quick = kind == "console" and re.match(r"antway (plan (office|house)|--help)", text) and "ants" not in text
        if SCALE <= 1.0 and not quick and not (kind == "python" and "antway.run(" not in text and page.endswith("map.md")):
            continue
        done = run(home, "-c", text) if kind == "python" else run(home, "-c", program, *shlex.split(text)[1:])
        assert done.returncode == 0, (text, done.stdout[-500:], done.stderr[-2000:])
