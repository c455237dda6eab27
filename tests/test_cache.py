"""Where compiled kernels are kept: beside the package, among the user's caches, or in a temporary folder, never nowhere."""

from __future__ import annotations

import gc
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import antway
from antway import warmup
from antway.kernels.base.jit import PLAIN, kernel

PROGRAM = """
from antway.kernels.base import cache
from antway.kernels.base.geometry import wrap
assert abs(wrap(7.0) - (7.0 - 2 * 3.141592653589793)) < 1e-12
print(cache.cache_folder())
"""


def run(package: Path, **environment: str) -> str:
    """Compile a kernel of the copy of the package in `package`; returns the folder that keeps it."""
    given = {"PATH": os.environ["PATH"], "PYTHONPATH": str(package), **environment}
    done = subprocess.run([sys.executable, "-c", PROGRAM], env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """A copy of the package as if it were installed, without what was compiled."""
    folder = tmp_path / "site"
    shutil.copytree(Path(antway.__file__).parent, folder / "antway", ignore=shutil.ignore_patterns("__pycache__"))
    return folder


def test_kernels_are_kept_by_version_beside_an_installed_package(installed: Path, tmp_path: Path) -> None:
    """A folder that can be written holds them, and its name the version: a new version finds none of the old one's."""
    folder = run(installed, HOME=str(tmp_path))
    assert folder == str(installed / "antway" / "__pycache__" / f"kernels-{antway.__version__}")
    assert list(Path(folder).rglob("*.nbi"))


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
@pytest.mark.parametrize("chosen", [False, True])
def test_a_kernel_is_compiled_again_when_one_that_it_calls_has_changed(installed: Path, tmp_path: Path, chosen: bool) -> None:
    """As after an upgrade: Numba looks at the kernel's own file alone, and went on with the old code."""
    kernels, head = installed / "antway" / "kernels", "from antway.kernels.base.jit import kernel\n"
    (kernels / "outer.py").write_text(
        f"{head}from antway.kernels.robot.inner import more\n\n@kernel\ndef outer(x):\n    return more(x)\n"
    )
    given = {"PATH": os.environ["PATH"], "PYTHONPATH": str(installed), "HOME": str(tmp_path)}
    given |= {"NUMBA_CACHE_DIR": str(tmp_path / "chosen")} if chosen else {}
    program = [sys.executable, "-c", "from antway.kernels.outer import outer; print(outer(1.0))"]
    for amount in (1.0, 12.0):  # files of another length, or Python might go on with its own cache
        (kernels / "robot" / "inner.py").write_text(f"{head}\n@kernel\ndef more(x):\n    return x + {amount}\n")
        done = subprocess.run(program, env=given, capture_output=True, text=True, check=True)
        assert float(done.stdout) == 1.0 + amount


def test_a_chosen_folder_that_cannot_be_written_is_not_used(installed: Path, tmp_path: Path) -> None:
    """Then the usual folders keep kernels; it was a traceback of Numba's."""
    (tmp_path / "file").write_text("a file where a folder would be: not even root can write in it")
    folder = run(installed, HOME=str(tmp_path), NUMBA_CACHE_DIR=str(tmp_path / "file"))
    assert folder.startswith(str(installed)) and list(Path(folder).rglob("*.nbi"))
    assert run(installed, HOME=str(tmp_path), NUMBA_CACHE_DIR=str(tmp_path / "good")) == ""
    assert list((tmp_path / "good").rglob("*.nbi"))


def test_without_home_and_a_writable_package_kernels_are_kept_in_a_temporary_folder(installed: Path, tmp_path: Path) -> None:
    """As user nobody in a container: no RuntimeError, and compiled once, for the next process finds them."""
    (installed / "antway" / "__pycache__").write_text("a file where a folder would be: not even root can write in it")
    nowhere = tmp_path / "nowhere"
    nowhere.write_text("")
    folder = run(installed, HOME=str(nowhere), TMPDIR=str(tmp_path), PYTHONDONTWRITEBYTECODE="1")
    assert folder.startswith(str(tmp_path / "antway-"))
    assert list(Path(folder).rglob("*.nbi"))
    assert run(installed, HOME=str(nowhere), TMPDIR=str(tmp_path), PYTHONDONTWRITEBYTECODE="1") == folder


PLAN = """
import sys
from antway.cli import main
sys.argv = ["antway", "plan", "office", "--start", "1.5,3", "--goal", "22,12.5", "--radius", "0.25", "--json"]
try:
    main()
finally:
    print("numba" in sys.modules, file=sys.stderr)
"""


def test_a_small_map_is_searched_before_anything_is_compiled(tmp_path: Path) -> None:
    """Without compiled kernels `antway plan` interprets them on a small map, with the answer that compiled ones give."""
    answers = []
    for disable in (None, "0"):
        given = {"NUMBA_CACHE_DIR": str(tmp_path)} if disable is None else {"NUMBA_DISABLE_JIT": disable}
        done = subprocess.run(
            [sys.executable, "-c", PLAN], env={**os.environ, **given}, capture_output=True, text=True, check=True
        )
        answers.append(json.loads(done.stdout))
        if disable is None:
            assert done.stderr.split()[-1] == "False" and not list(tmp_path.rglob("*.nbi"))
    assert {**answers[0], "elapsed": 0} == {**answers[1], "elapsed": 0} and answers[0]["status"] == "found"


SAID = """
from antway.kernels.base.geometry import wrap, wrap_below_pi
wrap(7.0), wrap_below_pi(7.0)
"""


@pytest.mark.parametrize(("quiet", "told"), [("", 1), ("1", 0)])
def test_compiling_is_said_once_and_can_be_silenced(tmp_path: Path, quiet: str, told: int) -> None:
    """From Python the first compilation says so once on stderr, unless ANTWAY_QUIET is set."""
    given = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "ANTWAY_QUIET": quiet}
    done = subprocess.run([sys.executable, "-c", SAID], env=given, capture_output=True, text=True, check=True)
    assert done.stderr.count("compiling kernels") == told and done.stderr.count("\n") == told
    again = subprocess.run([sys.executable, "-c", SAID], env=given, capture_output=True, text=True, check=True)
    assert again.stderr == ""


def printed(program: str, folder: Path) -> list[str]:
    """Run a program that compiles kernels of its own, and keeps them in `folder`; returns the words that it prints."""
    (folder / "program.py").write_text(program)
    given = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"} | {"ANTWAY_QUIET": "1"}
    done = subprocess.run([sys.executable, "program.py"], cwd=folder, env=given, capture_output=True, text=True, check=True)
    return done.stdout.split()


SLOW = """
import numpy as np
import antway
from antway.kernels.base.jit import compile_seconds, kernel

@kernel
def twice(x):
    return x + x

class Compiles:
    def reset(self, task, seed): pass
    def act(self, observation):
        twice(np.zeros(3))
        return antway.Command((1.0, 0.0))
    def explain(self): return antway.Decision("follow", "on its way")

room = antway.Scenario(antway.World(antway.Grid(np.zeros((10, 10), bool))), (1.0, 5.0), (9.0, 5.0), horizon=1.0)
result = antway.run(room, Compiles())
first = compile_seconds()
print(result.cycle_ms[0] / 1e3, first)
"""


def test_compile_time_is_in_no_cycle(tmp_path: Path) -> None:
    """The first cycle of a policy that compiles a kernel is not charged with that."""
    cycle, compiled = map(float, printed(SLOW, tmp_path))
    assert compiled > 0.05 and cycle < 0.5 * compiled


BOTH = """
from antway.kernels.base.jit import kernel

@kernel
def more(x):
    return x + 1.0

@kernel
def twice(x):
    return 2.0 * more(x)

print(twice(1.0), more(1.0))
"""


def test_a_kernel_may_be_called_by_kernels_and_from_python(tmp_path: Path) -> None:
    """Compiled, found on disk, and without what Python needs where only kernels call it: the answers are the same."""
    for _ in range(2):
        assert printed(BOTH, tmp_path) == ["4.0", "2.0"]
    kept = {path.name.split("-")[0] for path in tmp_path.rglob("*.inner.nbi")}
    assert kept == {"program.more"}


MACHINE_CODE = """
from numba.core.codegen import JITCPUCodegen

made, add_module = [], JITCPUCodegen._add_module

def add(self, module):
    made.append(module.name)
    return add_module(self, module)

JITCPUCodegen._add_module = add
"""


@pytest.mark.skipif(PLAIN, reason="kernels are plain Python here")
def test_machine_code_is_made_of_what_python_calls_alone(tmp_path: Path) -> None:
    """A kernel that another one calls is part of that one's code: made on its own as well, it took a sixth of a first run."""
    program = MACHINE_CODE + BOTH.replace("print(twice(1.0), more(1.0))", "print(twice(1.0), *made)")
    assert printed(program, tmp_path) == ["4.0", "nrt", "twice"]  # the first is what Numba counts references by


@pytest.mark.parametrize(("policy", "compiled", "started"), [("antway", False, 1), ("antway", True, 0), ("paper", False, 0)])
def test_a_first_run_compiles_in_two_processes(
    policy: str, compiled: bool, started: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The other process is started where the kernels are not there yet, and is gone when the episode is over."""
    processes: list[subprocess.Popen[bytes]] = []

    def popen(command: list[str], env: dict[str, str]) -> subprocess.Popen[bytes]:
        assert "late()" in command[-1] and env["ANTWAY_QUIET"] == "1"
        processes.append(real([sys.executable, "-c", "import time; time.sleep(600)"]))
        return processes[-1]

    real = subprocess.Popen
    monkeypatch.setattr(warmup, "is_compiled", lambda folder, kernel: compiled)
    monkeypatch.setattr(warmup.os, "cpu_count", lambda: 2)
    monkeypatch.setattr(warmup.subprocess, "Popen", popen)
    with warmup.compiling_beside(policy):
        assert len(processes) == started
    assert all(process.poll() is not None for process in processes)


@pytest.mark.parametrize("kind", warmup.WARM)
def test_what_is_compiled_beforehand_can_be_done(kind: str) -> None:
    """Each task of each kind is done without an error on the maps and scenes as they are shipped now."""
    for name, argument in warmup._TASKS[kind]:
        warmup._DO[name](argument)


def test_what_an_episode_needs_late_can_be_compiled() -> None:
    """What the other process does is done without an error, whatever is compiled already."""
    warmup.late()


@pytest.mark.skipif(PLAIN, reason="nothing is compiled")
def test_the_compiler_is_left_as_it_was() -> None:
    """Numba is hurried for antway's kernels alone, also where one cannot be compiled."""
    from numba.core.codegen import JITCodeLibrary
    from numba.core.errors import TypingError
    from numba.core.registry import cpu_target
    from numba.core.types import BaseFunction

    from antway.kernels.base import compiler

    def found() -> tuple[object, ...]:
        codegen = cpu_target.target_context.codegen()
        return BaseFunction.get_call_type, codegen._library_class, gc.get_threshold()

    before = found()
    assert before[1] is JITCodeLibrary

    def nonsense(x: float) -> float:
        return x + "text"  # type: ignore[operator]

    with compiler.quick_compiler():
        assert found()[0] is not before[0] and gc.get_threshold()[0] > 10_000
    with pytest.raises(TypingError):
        kernel(nonsense)(1.0)
    assert found() == before
