"""The command line: exit statuses, one line for wrong input, JSON alone on stdout."""

from __future__ import annotations

import importlib.util
import json
import os
import re
import signal
import subprocess
import sys
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from antway import Budget, Grid, Plan, Problem, save_map, solve
from antway.baselines.replan import Follow
from antway.cli import app, main
from antway.console import episode_bar, print_table, status_of
from antway.errors import BadInput, BadMap, BadParameter, BadResults, BadScenario, CellBlocked, OutOfBounds, TooLarge
from antway.world.trace import Trace
from common import SHARED, needs_data

ROOM = np.zeros((20, 30), dtype=bool)
ROOM[5:15, 12] = True
SEALED = ROOM.copy()
SEALED[:, 12] = True


@pytest.fixture
def room(tmp_path: Path) -> Path:
    save_map(Grid(ROOM, 0.5), tmp_path / "room.yaml")
    save_map(Grid(SEALED, 0.5), tmp_path / "sealed.yaml")
    return tmp_path / "room.yaml"


@pytest.fixture
def antway(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Any:
    """Run a command line in this process: (exit status, stdout, stderr)."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["antway", *map(str, arguments)])
        with pytest.raises(SystemExit) as end, warnings.catch_warnings():
            warnings.simplefilter("default")
            main()
        printed = capsys.readouterr()
        return int(end.value.code or 0), printed.out, printed.err

    return run


def test_a_plan_in_metres_and_in_cells(antway: Any, room: Path) -> None:
    """`plan` finds the same shortest path by points and by cells, says so, and --json prints one object and nothing else."""
    status, out, _ = antway("plan", room, "--start", "1.25,5.25", "--goal", "12.25,5.25", "--json")
    by_points = json.loads(out)
    assert status == 0 and by_points["status"] == "found" and by_points["optimal"] is True
    status, out, _ = antway("plan", room, "--cells", "--start", "10,2", "--goal", "10,24", "--json", "--planner", "dijkstra")
    by_cells = json.loads(out)
    assert by_cells["length"] == by_points["length"] and by_cells["cells"][0] == [10, 2]
    assert by_cells["xy"][-1] == [12.25, 5.25]
    status, out, _ = antway("plan", room, "--cells", "--start", "10,2", "--goal", "10,24")
    assert status == 0 and "the shortest" in out and f"{by_cells['length']:.3f} m" in out


def test_rounds_that_end_before_the_first_stop_have_no_table_of_stops(antway: Any) -> None:
    """Nor is the path to the stops visited, which are none, the shortest of anything."""
    status, out, _ = antway("run", "rounds", "--policy", "follow")
    assert status == 5 and "0 of 12 stops visited" in out and "arrives" not in out and "0.00 m │     " not in out


def test_the_page_names_the_packages_that_it_lacks(antway: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """They are named one by one, because antway itself is on no package index."""
    find = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name, *more: None if name == "uvicorn" else find(name, *more))
    status, _, err = antway("serve", "--no-browser", "--port", "0")
    assert status == 2 and err == "error: extra web = 'not installed': must be installed: pip install uvicorn\n"


def test_the_time_of_a_plan_is_that_of_the_search_alone(antway: Any, room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the first call of a planner takes to compile counts neither in `elapsed` nor for --time-limit."""
    import antway as package

    solve, calls = package.solve, []

    def slow_at_first(problem: Any, *arguments: Any, **options: Any) -> Any:
        calls.append(problem.grid.shape)
        answer = solve(problem, *arguments, **options)
        return replace(answer, elapsed=60.0) if len(calls) == 1 else answer

    monkeypatch.setattr(package, "solve", slow_at_first)
    status, out, _ = antway("plan", room, "--cells", "--start", "10,2", "--goal", "10,24", "--json")
    assert status == 0 and json.loads(out)["elapsed"] < 60.0
    assert len(calls) == 2 and calls[0] == (9, 9)


@pytest.mark.parametrize("planner", ["dijkstra", "astar", "jps", "anyangle", "dstarlite", "ants"])
def test_every_planner_has_its_name_on_the_command_line(antway: Any, room: Path, planner: str) -> None:
    """Each planner of the table answers, and the command checks its answer."""
    status, out, _ = antway("plan", room, "--cells", "--start", "10,2", "--goal", "10,24", "--planner", planner, "--json")
    assert status == 0 and json.loads(out)["planner"] == planner


def test_no_path_is_status_three_and_no_time_is_status_four(antway: Any, room: Path) -> None:
    """C22: a sealed room ends with 3, a time limit of nothing with 4; infinite lengths are null in JSON."""
    sealed = room.with_name("sealed.yaml")
    status, out, _ = antway("plan", sealed, "--cells", "--start", "10,2", "--goal", "10,24", "--json")
    assert status == 3 and json.loads(out)["length"] is None
    assert antway("plan", sealed, "--cells", "--start", "10,2", "--goal", "10,24")[1] == "no path\n"
    arguments = ("plan", room, "--cells", "--start", "10,2", "--goal", "10,24", "--time-limit", "0")
    assert antway(*arguments)[0] == 4


def test_a_plan_is_drawn(antway: Any, room: Path, tmp_path: Path) -> None:
    """--out writes a picture in the format of the suffix."""
    for suffix, magic in (("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")):
        file = tmp_path / f"plan.{suffix}"
        assert antway("plan", room, "--cells", "--start", "10,2", "--goal", "10,24", "--out", file)[0] == 0
        assert file.read_bytes().startswith(magic)


PLAN = ("plan", "room.yaml", "--start", "1,1", "--goal", "9,9")
BAD: list[tuple[tuple[str, ...], str]] = [
    (("plan", "nowhere.yaml", "--start", "1,1", "--goal", "9,9"), "nowhere.yaml"),
    (("plan", "room.tiff", "--start", "1,1", "--goal", "9,9"), "suffix"),
    ((*PLAN, "--start", "1"), "start = '1'"),
    ((*PLAN, "--start", "1,2,3"), "start = '1,2,3'"),
    ((*PLAN, "--start", "a,b"), "start = 'a,b'"),
    ((*PLAN, "--start", "nan,1"), "nan"),
    ((*PLAN, "--goal", "inf,1"), "inf"),
    ((*PLAN, "--start", "-5,1"), "start = (-5.0, 1.0)"),
    ((*PLAN, "--goal", "6.2,5"), "goal = (6.2, 5.0)"),
    ((*PLAN, "--goal", "5.9,5", "--radius", "0.4"), "with a radius of 0.4 m"),
    ((*PLAN, "--cells", "--start", "1.5,2"), "start = '1.5,2'"),
    ((*PLAN, "--cells", "--goal", "99,2"), "goal = (99, 2)"),
    ((*PLAN, "--cells", "--goal", "10,12"), "goal = (10, 12)"),
    ((*PLAN, "--planner", "magic"), "planner = 'magic'"),
    ((*PLAN, "--moves", "nine"), "moves = 'nine'"),
    ((*PLAN, "--radius", "-1"), "robot_radius = -1.0"),
    ((*PLAN, "--radius", "nan"), "robot_radius = nan"),
    ((*PLAN, "--radius", "wide"), "radius = 'wide'"),
    ((*PLAN, "--seed", "-1"), "seed = -1"),
    ((*PLAN, "--seed", "1.5"), "seed = '1.5'"),
    ((*PLAN, "--seed", str(2**64)), f"seed = {2**64}"),
    ((*PLAN, "--time-limit", "-1"), "time_limit = -1.0"),
    ((*PLAN, "--time-limit", "nan"), "time_limit = nan"),
    ((*PLAN, "--resolution", "1"), "resolution = 1.0"),
    ((*PLAN, "--out", "plan.bmp"), "out = 'plan.bmp'"),
    ((*PLAN, "--out", "nofolder/plan.png"), "out = 'nofolder/plan.png'"),
    ((*PLAN, "--pareto", "--planner", "magic"), "planner = 'magic'"),
    ((*PLAN, "--pareto", "--time-limit", "1"), "time_limit = 1.0"),
    ((*PLAN[:1], "office", "--start", "1.5,3", "--goal", "22,12.5", "--pareto"), "map = (140, 240): must be coarser"),
    (("plan", "room.yaml", "--start", "1,1"), "--goal"),
    ((*PLAN, "--nonsense"), "--nonsense"),
    (("plan", "room.yaml", "--start", "1.5", "3", "--goal", "9,9"), "(3); X,Y is written without a space"),
    (("fly",), "fly"),
    (("run", "nowhere.toml"), "nowhere.toml"),
    (("run", "room.yaml"), "room.yaml"),
    (("run", "paper", "--policy", "magic"), "policy = 'magic'"),
    (("run", "paper", "--seed", "x"), "seed = 'x'"),
    (("run", "paper", "--out", "five.tsp"), "out = 'five.tsp'"),
    (("run", "paper", "--out", "five.tsp/folder"), "out = 'five.tsp/folder'"),
    (("demo", "--out", "five.tsp"), "out = 'five.tsp'"),
    (("bench", "paper", "--policies", "stop,stop"), "policies = 'stop'"),
    (("bench", "paper", "--policies", "stop, stop"), "policies = 'stop'"),
    (("bench", "nope"), "tracks:FILE, barn (on the command line also predict, ants)"),
    (("bench", "predict", "walk.csv", "--robot", "jackal"), "robot = 'jackal': must be left out with predict"),
    (("bench", "predict", "walk.csv", "--out", "there"), "out = 'there': must be left out with predict"),
    (("bench", "ants", "--policies", "sipp"), "policies = 'sipp': must be left out with ants"),
    (("bench", "ants", "--workers", "0"), "workers = 0: must be left out with ants"),
    (("bench", "ants", "--export", "csv,json"), "export = 'csv,json': must be left out with ants"),
    (("bench", "paper", "--policies", "stop", "--engine", "steam"), "engine = 'steam'"),
    (("bench", "paper", "--policies", "stop", "--timeout", "nan"), "timeout = nan"),
    (("bench", "paper", "--policies", "stop", "--workers", "0"), "workers = 0"),
    (("bench", "paper", "--policies", "stop", "--out", "five.tsp"), "out = 'five.tsp'"),
    (("warmup", "plan", "--workers", "0"), "workers = 0"),
    (("view", "nowhere.json", "--out", "a.html"), "nowhere.json"),
    (("view", "room.yaml", "--out", "a.html"), "room.yaml"),
    (("view", "room.yaml", "--out", "a.doc"), "out = 'a.doc'"),
    (("view", "room.yaml", "--out", "a.html", "--at", "1"), "at = 1.0"),
    (("tour", "room.yaml", "--start", "1,1", "--stops", "s.csv", "--objective", "travel time"), "one of travel-time, makespan"),
    (("tour", "room.yaml", "--start", "1,1", "--stops", "s.csv", "--end", "home"), "two numbers X,Y (m), or start"),
    (("tsptw", "room.yaml", "--objective", "travel time"), "one of travel-time, makespan"),
    (("tsp", "nowhere.tsp"), "nowhere.tsp"),
    (("tsp", "five.tsp", "--rule", "magic"), "rule = 'magic'"),
    (("tsp", "five.tsp", "--local-search", "9opt"), "local_search = '9opt'"),
    (("tsp", "five.tsp", "--seconds", "-1"), "seconds = -1.0"),
    (("tsp", "five.tsp", "--threads", "0"), "threads = 0"),
]
FIVE = "NAME: five\nTYPE: TSP\nDIMENSION: 5\nEDGE_WEIGHT_TYPE: EUC_2D\nNODE_COORD_SECTION\n"
FIVE += "".join(f"{i} {x} {y}\n" for i, (x, y) in enumerate([(0, 0), (0, 20), (20, 20), (20, 0), (10, 0)], 1)) + "EOF\n"


@pytest.mark.parametrize(("arguments", "named"), BAD, ids=lambda value: " ".join(value) if isinstance(value, tuple) else "")
def test_wrong_input_is_one_line_and_status_two(
    antway: Any, room: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], named: str
) -> None:
    """C18, C22: wrong input ends with status 2, nothing on stdout and one line that names what is wrong, no traceback."""
    monkeypatch.chdir(room.parent)
    Path("five.tsp").write_text(FIVE)
    status, out, err = antway(*arguments)
    printed = [line for line in err.splitlines() if not line.endswith("...")]
    assert status == 2 and out == ""
    assert len(printed) == 1 and printed[0].startswith("error: ") and named in printed[0], err
    assert not Path("bench").exists() and not Path("demo").exists()


RAISED: dict[type[BadInput], tuple[str, ...]] = {
    BadMap: ("plan", "nowhere.yaml", "--start", "1,1", "--goal", "9,9"),
    BadScenario: ("run", "nowhere.toml"),
    BadParameter: (*PLAN, "--seed", "-1"),
    OutOfBounds: (*PLAN, "--start", "-5,1"),
    CellBlocked: (*PLAN, "--goal", "6.2,5"),
    TooLarge: ("plan", "huge.map", "--start", "1,1", "--goal", "9,9"),
    BadResults: ("bench", "paper", "--episodes", "1", "--policies", "stop", "--out", "spoilt"),
}


@pytest.mark.parametrize("kind", BadInput.__subclasses__())
def test_every_class_of_wrong_input_ends_with_status_two(
    antway: Any, room: Path, monkeypatch: pytest.MonkeyPatch, kind: type[BadInput]
) -> None:
    """C22: each class of the tree has a command that raises it; that is one line, naming what is wrong, and status 2."""
    monkeypatch.chdir(room.parent)
    Path("huge.map").write_text("type octile\nheight 65536\nwidth 65536\nmap\n")
    Path("spoilt").mkdir()
    Path("spoilt/results.db").write_text("no database")
    status, out, err = antway(*RAISED[kind])
    printed = [line for line in err.splitlines() if line.startswith("error: ")]
    assert (status, out, len(printed)) == (2, "", 1) and "must be" in printed[0] and "Traceback" not in err
    with pytest.raises(kind) as caught:
        app(list(RAISED[kind]), standalone_mode=False)
    assert type(caught.value) is kind and printed[0] == f"error: {caught.value}"


def test_help_and_version(antway: Any) -> None:
    """Help of the program and of every command comes with status 0; without a command the program prints its help."""
    status, out, _ = antway("--help")
    assert status == 0 and all(name in out for name in ("demo", "plan", "run", "view", "tsp"))
    assert antway()[1] == out
    for name in ("demo", "plan", "run", "view", "tsp", "warmup"):
        status, out, _ = antway(name, "--help")
        assert status == 0 and "Usage" in out and "[[" not in out
    assert antway("--version")[1].startswith("antway ")


def test_help_imports_nothing_heavy() -> None:
    """`antway --help` loads no NumPy, Numba, Matplotlib, SciPy or Rich: that is what keeps it quick."""
    code = "import sys, antway.cli\nsys.argv = ['antway', '--help']\ntry: antway.cli.main()\nexcept SystemExit: pass\n"
    code += "print(sorted({'numpy', 'numba', 'matplotlib', 'scipy', 'rich', 'PIL', 'yaml'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


def test_a_tour_of_five_cities(antway: Any, tmp_path: Path) -> None:
    """`tsp` prints the tour of a file, as words, as JSON and as a picture."""
    (tmp_path / "five.tsp").write_text(FIVE)
    status, out, _ = antway("tsp", tmp_path / "five.tsp", "--seconds", "0.2", "--json")
    tour = json.loads(out)
    assert status == 0 and tour["length"] == 80 and sorted(tour["order"]) == [0, 1, 2, 3, 4]
    status, out, _ = antway("tsp", tmp_path / "five.tsp", "--seconds", "0.2", "--out", tmp_path / "five.png")
    assert status == 0 and "five: 80" in out and (tmp_path / "five.png").stat().st_size > 10_000


def test_a_round_of_a_room_is_a_table(antway: Any, room: Path) -> None:
    """`tour` prints a row for each stop, its window in words where that has no end, and the totals."""
    stops = room.with_name("stops.csv")
    stops.write_text("x,y,name,earliest,latest\n13,8,far,40,\n1,8,any,,\n2,2,soon,0,60\n")
    status, out, _ = antway("tour", room, "--start", "1,1", "--stops", stops, "--seconds", "0.1")
    row = {cells[2]: cells[6] for cells in (re.split(r" *│ *", line) for line in out.splitlines()) if len(cells) == 9}
    assert status == 0 and row == {"any": "-", "soon": "0 - 60 s", "far": "from 40 s"} and "proved the best" in out


def test_progress_in_a_log_is_a_line_now_and_then(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Where stderr is no terminal, a bench tells in a plain line how far it is, each half minute and at the end."""
    clock = iter([0.0, 10.0, 29.0, 31.0, 32.0, 60.0, 62.0])
    monkeypatch.setattr("time.monotonic", lambda: next(clock))
    with episode_bar("synthetic", 6) as advance:
        for _ in range(6):
            advance()
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.splitlines() == [
        "synthetic: 3 of 6 episodes after 31 s",
        "synthetic: 6 of 6 episodes after 62 s",
    ]


@needs_data
def test_an_interrupt_ends_a_search_with_its_best_tour() -> None:
    """Ctrl-C during `tsp` prints the best tour so far and ends with status 0."""
    command = [sys.executable, "-c", "from antway.cli import main; main()", "tsp", str(SHARED / "tsplib" / "rat783.tsp")]
    process = subprocess.Popen(
        [*command, "--seconds", "300", "--json"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    assert process.stderr is not None
    assert process.stderr.readline().startswith("searching")  # printed a second after the search began, handler in place
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    tour = json.loads(out)
    assert process.returncode == 0, err
    assert sorted(tour["order"]) == list(range(783)) and "Traceback" not in err


@needs_data
def test_an_interrupt_is_said(antway: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C within a command ends it with a word and status 130."""

    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("antway.load_scenario", interrupted)
    assert antway("run", "office") == (130, "", "interrupted\n")


def test_a_closed_output_is_no_error() -> None:
    """A command that is started without stdout runs all the same, and without stderr it keeps its errors to itself."""
    command = f"{sys.executable} -m antway --version >&- && {sys.executable} -m antway fly 2>&-; echo $?"
    done = subprocess.run(["sh", "-c", command], capture_output=True, text=True, check=False)
    assert (done.stdout, done.stderr) == ("2\n", "")


def test_an_output_that_takes_nothing_has_its_status() -> None:
    """A reader that has ended is status 141, as for other programs in a pipe; a full disk is named as what it is."""
    for unbuffered in ("", "1"):
        reader, writer = os.pipe()
        os.close(reader)
        environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
        command = [sys.executable, "-m", "antway", "--version"]
        done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, env=environment, check=False)
        os.close(writer)
        assert (done.returncode, done.stderr) == (141, b"")
    with open("/dev/full", "w") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, check=False)
    assert (done.returncode, done.stderr) == (2, b"error: stdout cannot be written: No space left on device\n")


@needs_data
def test_a_warning_is_one_line(antway: Any) -> None:
    """The grey trap of ROS maps is said in one line on stderr, and the plan is made all the same."""
    depot = SHARED / "ros_maps" / "nav2_depot" / "depot.yaml"
    status, out, err = antway("plan", depot, "--start", "1,0.6", "--goal", "28.7,15", "--radius", "0.2", "--json")
    warned = [line for line in err.splitlines() if line.startswith("warning: ")]
    assert status == 0 and len(warned) == 1 and "205" in warned[0] and json.loads(out)["status"] == "found"


def test_two_runs_of_a_seed_write_the_same_files(antway: Any, tmp_path: Path) -> None:
    """C31: `run --out` of the same seed writes the same bytes, whatever ran before, but for what took how long."""
    for folder, before in (("one", 2), ("two", 5)):
        antway("run", "paper", "--policy", "antway", "--seed", before, "--json")
        assert antway("run", "paper", "--policy", "antway", "--seed", 3, "--out", tmp_path / folder)[0] == 0
    one, two = ({file.name: file.read_bytes() for file in (tmp_path / name).iterdir()} for name in ("one", "two"))
    assert len(one) >= 9 and one.keys() == two.keys()
    assert [name for name in sorted(one) if one[name] != two[name]] == ["timings.json"]


def test_an_episode_and_its_views(antway: Any, tmp_path: Path) -> None:
    """`run` prints the numbers of an episode and writes its files, and `view` turns the trace into each format."""
    status, out, _ = antway("run", "paper", "--policy", "paper", "--seed", 1, "--out", tmp_path, "--json")
    numbers = json.loads(out)
    summary, timings = (json.loads((tmp_path / f"{name}.json").read_text()) for name in ("summary", "timings"))
    assert status == 0 and numbers["reached"] and numbers == summary | {key: timings[key] for key in timings if key in numbers}
    magic = {"html": b"<!doctype html>", "gif": b"GIF89a", "png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for suffix, start in magic.items():
        file = tmp_path / f"view.{suffix}"
        assert antway("view", tmp_path / "trace.json", "--out", file)[0] == 0
        assert file.read_bytes().startswith(start)
    assert antway("view", tmp_path / "trace.json", "--out", tmp_path / "at.png", "--at", "3.05")[0] == 0
    assert antway("view", tmp_path / "trace.json", "--out", tmp_path / "at.png", "--at", "1e9")[0] == 2


def test_a_run_explains_itself(antway: Any, tmp_path: Path) -> None:
    """`run --explain` says the decisions that the trace holds: what was met, weighed, certified, guarded; anew each second."""
    status, out, _ = antway("run", "paper", "--seed", 1, "--explain", "--json", "--out", tmp_path)
    record = json.loads(out)
    trace = Trace.load(tmp_path / "trace.json")
    announced = record["decisions"]
    assert status == 0 and [one["reason"] for one in announced] == [one.reason for _, one in trace.decisions]
    assert all(one["guard"] in ("free", "slowed", "braked", "stepped-aside") for one in announced)
    assert all(one["gap"] >= 0.0 for one in announced if one["action"] != "wait")
    assert [one["weighed"] for one in announced] == [[list(pair) for pair in one.weighed()] for _, one in trace.decisions]
    assert all(list(one["alternatives"]) == [name for name, _ in one["weighed"]] for one in announced)
    met = [one for one in announced if one["obstacle"] is not None]
    assert met and all(one["encounter"] and one["time_to_closest"] > 0.0 for one in met)
    assert max(b["t"] - a["t"] for a, b in pairwise(announced)) < 1.2
    assert record["replans"] < len(announced), "the same plan explained anew is no other plan"
    status, out, _ = antway("run", "paper", "--seed", 1, "--explain")
    name, cost = met[0]["weighed"][1]
    assert status == 0 and met[0]["encounter"] in out and name in out and cost in out


def test_discs_that_would_overlap_are_closest_at_zero(capsys: pytest.CaptureFixture) -> None:
    """The table says the same distance as the reason beside it."""
    from antway.console import print_decisions

    one = {"t": 0.5, "action": "avoid", "obstacle": 2, "encounter": "standing", "weighed": [], "gap": 0.0, "guard": "free"}
    one |= {"time_to_closest": 4.2, "distance_at_closest": -0.23, "reason": "closest in 4.2 s at 0.0 m"}
    print_decisions([one, {**one, "t": 1.5}, {**one, "t": 2.5, "guard": "slowed"}])
    out = capsys.readouterr().out
    assert out.count("0.00 m in 4.2 s") == 2 and " 1.5 s" not in out, "what says nothing new has no row"


def test_a_contact_is_status_five(antway: Any, tmp_path: Path) -> None:
    """C22: a robot that something runs into, in a passage too narrow for both, ends with status 5."""
    save_map(Grid(np.zeros((1, 20), dtype=bool)), tmp_path / "hall.yaml")
    obstacle = "[[obstacles]]\nradius = 0.4\nmotion = 'line'\nstart = [19.0, 0.5]\nend = [1.0, 0.5]\nspeed = 1.0\n"
    (tmp_path / "hall.toml").write_text("map = 'hall.yaml'\nstart = [3.0, 0.5]\ngoal = [15.0, 0.5]\n" + obstacle)
    status, out, _ = antway("run", tmp_path / "hall.toml", "--policy", "paper", "--json")
    assert status == 5 and json.loads(out)["outcome"].startswith("hit-")


RAISING = """
class Lost:
    def reset(self, task, seed): pass
    def act(self, observation): return self.turn(observation)
    def turn(self, observation): raise KeyError("no such door")
    def explain(self): ...
"""


def test_a_policy_that_raises_is_status_one_and_named(antway: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a policy raises ends its run with status 1, with the line of its own that raised; time that ran out is status 4."""
    (tmp_path / "lost.py").write_text(RAISING)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    status, out, _ = antway("run", "office", "--policy", "lost:Lost")
    assert status == 1 and "lost:Lost at 0 s: KeyError: 'no such door' (lost.py, line 5, in turn)" in " ".join(out.split())
    save_map(Grid(np.zeros((10, 10), dtype=bool)), tmp_path / "hall.yaml")
    (tmp_path / "hall.toml").write_text("map = 'hall.yaml'\nstart = [1.0, 5.0]\ngoal = [9.0, 5.0]\nhorizon = 1.0\n")
    status, out, _ = antway("run", "hall.toml", "--policy", "follow")
    assert status == 4 and "timeout" in out
    assert antway("run", "hall.toml", "--policy", "follow/margin=-1")[0] == 2


@pytest.mark.parametrize("columns", [120, 80, 40])
def test_a_narrow_terminal_cuts_nothing_off(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], columns: int
) -> None:
    """A table that does not fit becomes a line for each of its cells."""
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", str(columns))
    numbers: dict[str, Any] = {"policy": "antway", "outcome": "hit-standing", "time": 24.8, "length": 24.76, "shortest": 24.57}
    numbers |= {"length_ratio": 1.016, "waits": 0, "replans": 7, "min_clearance": None, "cycle_ms_p50": 0.07}
    print_table([("office", numbers | {"reached": False, "cycle_ms_p99": 4.55})])
    printed = re.sub(r"\x1b\[\d*m", "", capsys.readouterr().out)
    for value in ("office", "hit-standing", "24.8 s", "24.76 m", "24.57 m", "+1.6 %", "0.07 /", "4.55"):
        assert value in printed, printed
    assert ("┃" in printed) == (columns == 120) and "…" not in printed
    assert max(map(len, printed.splitlines())) <= columns


def test_the_gravest_end_is_the_status() -> None:
    """Of several episodes a policy's fault counts before a contact, and a contact before time that ran out."""
    ends = [["reached"], ["reached", "timeout"], ["timeout", "hit-moving"], ["hit-wall", "error"]]
    assert [status_of(end) for end in ends] == [0, 4, 5, 1]


def test_the_shortest_says_among_which_paths(antway: Any) -> None:
    """The answer names the moves that it is the shortest for: at any angle the same question has a shorter one."""
    question = ("plan", "office", "--start", "1.5,3", "--goal", "22,12.5", "--radius", "0.25")
    eight, any_angle = (antway(*question, "--planner", planner)[1] for planner in ("jps", "anyangle"))
    assert "the shortest with eight directions" in eight and "the shortest at any angle" in any_angle
    assert float(any_angle.split()[0]) < float(eight.split()[0])


@pytest.mark.parametrize("arguments", [("run", "ofice"), ("plan", "ofice", "--start", "1,1", "--goal", "2,2")])
def test_a_misspelt_scene_names_the_scenes(antway: Any, arguments: tuple[str, ...]) -> None:
    """`run ofice` says which scenes there are."""
    status, _, err = antway(*arguments)
    assert status == 2 and "ofice" in err and "paper, office, warehouse, rounds" in err


def test_options_of_policies(antway: Any) -> None:
    """Options follow a policy's name in `run` as in `bench`; one that it does not have is named, and so are those it has."""
    status, out, _ = antway("run", "paper", "--policy", "sipp/margin=0.1", "--json")
    assert status == 0 and json.loads(out)["policy"] == "sipp/margin=0.1"
    status, _, err = antway("run", "paper", "--policy", "sipp/patience=3")
    assert status == 2 and "patience = 3: must be left out: the options of policy sipp are" in err and "__init__" not in err


def test_the_list_of_commands_is_not_cut_off(antway: Any) -> None:
    """Every command's line is whole at 80 columns."""
    listed = antway("--help")[1].split("Commands:")[1]
    assert "..." not in listed and "exit status 4 if a window or the deadline is missed" in " ".join(listed.split())


def test_the_shell_completes_names(monkeypatch: pytest.MonkeyPatch) -> None:
    """Completion offers scenes, policies and planners that begin as typed."""
    asked = {"run of": "office", "run office --policy antw": "antway", "plan office --planner sub": "subgoals"}
    for line, name in asked.items():
        given = {"_ANTWAY_COMPLETE": "complete_bash", "COMP_WORDS": f"antway {line}", "COMP_CWORD": str(len(line.split()))}
        command = [sys.executable, "-c", "import sys; sys.argv[0] = 'antway'; from antway.cli import main; main()"]
        done = subprocess.run(command, env={**os.environ, **given}, capture_output=True, text=True, check=False)
        assert name in done.stdout.split(), (line, done.stdout, done.stderr)


class Loud(Follow):
    """Prints when it is made."""

    def __init__(self) -> None:
        super().__init__()
        print("hello from a policy")


def loud(problem: Problem, *, seed: int, budget: Budget) -> Plan:
    print("hello from a planner")
    return solve(problem, "astar")


def test_what_planners_and_policies_print_is_not_in_the_answer(antway: Any, room: Path, tmp_path: Path) -> None:
    """With --json one object is on stdout, and nothing else."""
    plan = "plan", room, "--cells", "--start", "10,2", "--goal", "10,24", "--planner", "test_cli:loud"
    bench = "bench", "encounters", "--episodes", "1", "--policies", "test_cli:Loud", "--workers", "1", "--out", tmp_path / "b"
    for command in (plan, bench):
        status, out, err = antway(*command, "--json")
        assert status == 0 and json.loads(out) and "hello" in err
