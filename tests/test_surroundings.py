"""Whatever surrounds it, antway ends with an answer or with one line that says why: disks, homes, signals, switches."""

from __future__ import annotations

import contextlib
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from antway.errors import BadInput
from antway.world.trace import Trace
from common import costly

RUN = ("run", "paper", "--policy", "follow")


def antway(*arguments: str, switches: tuple[str, ...] = (), **options: Any) -> subprocess.CompletedProcess[str]:
    """Run `python -m antway`."""
    command = [sys.executable, *switches, "-m", "antway", *arguments]
    return subprocess.run(command, stderr=subprocess.PIPE, stdout=options.pop("stdout", subprocess.PIPE), text=True, **options)


def is_one_line(errors: str) -> bool:
    """Whether what is said is progress, and one line on what is wrong."""
    lines = [line for line in errors.splitlines() if not line.endswith("...") and "compiling" not in line]
    return len(lines) == 1 and lines[0].startswith("error: ")


def test_answers_do_not_hang_on_assertions() -> None:
    """With -O the same answer comes, and wrong input is refused as ever."""
    plain, optimised = (antway(*RUN, "--json", switches=switches) for switches in ((), ("-O",)))
    assert plain.returncode == optimised.returncode == 5
    cut = plain.stdout.index('"cycle_ms_p50"')
    assert plain.stdout[:cut] == optimised.stdout[:cut]
    wrong = antway("plan", "office", "--start=nan,1", "--goal=2,2", switches=("-O",))
    assert wrong.returncode == 2 and is_one_line(wrong.stderr)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
def test_a_full_disk_is_one_line() -> None:
    """Nobody reads on: the answer that cannot be written is an error, and no traceback."""
    with open("/dev/full", "w") as full:
        done = antway(*RUN, "--json", stdout=full)
    assert done.returncode == 2 and is_one_line(done.stderr), done.stderr


def test_files_that_cannot_be_written_are_one_line(tmp_path: Path) -> None:
    """A disk that is full after 20 kB, and a folder that is a file; what was written so far is refused or sound."""
    done = antway(
        *RUN, "--out", str(tmp_path / "out"), preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
    )
    assert done.returncode == 2 and is_one_line(done.stderr), done.stderr
    if (tmp_path / "out" / "trace.json").exists():
        with contextlib.suppress(BadInput):
            Trace.load(tmp_path / "out" / "trace.json")
    (tmp_path / "file").write_text("")
    done = antway(*RUN, "--out", str(tmp_path / "file"))
    assert done.returncode == 2 and is_one_line(done.stderr), done.stderr


def test_without_a_home_pictures_are_drawn(tmp_path: Path) -> None:
    """Neither a home nor a folder for settings that can be written is needed."""
    nowhere = tmp_path / "nowhere"
    nowhere.write_text("")
    bare = {key: value for key, value in os.environ.items() if key not in ("HOME", "XDG_CACHE_HOME", "MPLCONFIGDIR")}
    (tmp_path / "m.txt").write_text("....\n" * 4)
    plan = ("plan", str(tmp_path / "m.txt"), "--start=0.5,0.5", "--goal=3.5,3.5", "--out", str(tmp_path / "plan.png"))
    done = antway(*plan, env={**bare, "HOME": str(nowhere), "XDG_CONFIG_HOME": str(nowhere)})
    assert done.returncode == 0 and (tmp_path / "plan.png").stat().st_size > 1000, done.stderr
    assert "Traceback" not in done.stderr


def interrupted(delay: float, number: int, out: Path) -> tuple[int, str]:
    """Start a run, send it a signal after `delay` s, and return its status and what it said."""
    command = [sys.executable, "-m", "antway", *RUN, "--out", str(out)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        while process.poll() is None and b"antway" not in Path(f"/proc/{process.pid}/cmdline").read_bytes():
            time.sleep(0.001)
        time.sleep(delay)
        process.send_signal(number)
        assert process.stderr is not None
        errors = process.stderr.read()
        return process.wait(), errors


@pytest.fixture(scope="module")
def seconds(tmp_path_factory: pytest.TempPathFactory) -> float:
    """How long a run takes."""
    started = time.monotonic()
    assert antway(*RUN, "--out", str(tmp_path_factory.mktemp("whole"))).returncode == 5
    return time.monotonic() - started


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="looks at processes in /proc")
def test_an_interrupt_at_any_time_is_quiet(tmp_path: Path, seconds: float) -> None:
    """Ctrl-C ends a run with status 130 and no more than a word, from its imports to its files; or it was done already.

    It comes once in each part of the time that a run takes here.
    """
    rng, n = np.random.default_rng(1), costly(3, 200)
    for share in (np.arange(n) + rng.random(n)) / n:
        delay = seconds * (0.3 + 0.7 * float(share))
        status, errors = interrupted(delay, signal.SIGINT, tmp_path / "out")
        assert status in (130, 5), (delay, status, errors)
        assert "Traceback" not in errors and "Error" not in errors, (delay, errors)


def ended(run: str) -> subprocess.CompletedProcess[str]:
    """Let the command line do `run`, a statement, then wait for 100 s, and return how it ended, which must be soon."""
    code = f"import ctypes, signal, time, antway.cli\ndef run(): {run}; time.sleep(100)\nantway.cli.main = run\n"
    code += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"  # ignored where the tests run in the background
    code += "from antway.__main__ import main; main()"
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)


def test_an_interrupt_ends_workers_without_a_word() -> None:
    """Ctrl-C reaches every process of a terminal, also workers that have hardly started; they end with the command."""
    code = (
        "import os, signal, time\nfrom antway.processes import pool\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
    )
    code += "with pool(2) as workers: workers.submit(time.sleep, 60); os.killpg(0, signal.SIGINT); time.sleep(60)\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=50, start_new_session=True)
    assert done.stderr.count("Traceback") == 1 and done.stderr.endswith("\nKeyboardInterrupt\n"), done.stderr


def test_an_interrupt_that_a_compiler_swallows_comes_again() -> None:
    """LLVM calls Python to keep what it compiled, and ignores what is raised there: Ctrl-C then ends the run all the same."""
    done = ended("ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))()")
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


@pytest.mark.parametrize("module", ["importlib._bootstrap", "llvmlite.binding.ffi", "numba.core.serialize"])
def test_an_interrupt_waits_until_a_delicate_module_is_left(module: str) -> None:
    """An exception at any line of these modules becomes another error or crashes: Ctrl-C comes again when they are left."""
    done = ended(f"exec('import signal; signal.raise_signal(signal.SIGINT); print(1)', {{'__name__': '{module}'}})")
    assert (done.returncode, done.stdout, done.stderr) == (130, "1\n", "interrupted\n")


@pytest.mark.skipif(not Path("/proc/self/cmdline").exists(), reason="looks at processes in /proc")
def test_what_a_killed_run_leaves_is_sound_or_refused(tmp_path: Path, seconds: float) -> None:
    """kill -9 leaves no trace, a sound one, or one that is refused; the next run to the same folder succeeds."""
    rng, out = np.random.default_rng(2), tmp_path / "out"
    for share in rng.uniform(0.3, 1.1, costly(2, 50)):
        status, _ = interrupted(seconds * float(share), signal.SIGKILL, out)
        assert status in (-signal.SIGKILL, 5)
        if (out / "trace.json").exists():
            try:
                Trace.load(out / "trace.json")
            except BadInput as error:
                assert str(error)
    assert antway(*RUN, "--out", str(out)).returncode == 5
    assert len(Trace.load(out / "trace.json")) > 0
