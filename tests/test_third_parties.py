"""Planners and policies of other packages join by an entry point or as MODULE:NAME, everywhere where a name is asked for."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest

from antway import BadParameter, Grid, Problem, load_scenario, make_policy, run, solve
from antway.cli import main
from antway.conformance import check_planner, check_policy
from antway.planning import PLANNERS, find
from antway.scenes import scene
from common import free_cells

THEIRS = """
from antway.baselines.replan import Stop
from antway.search.astar import astar

class Patient(Stop):
    def __init__(self, *, patience: float = 2.0):
        super().__init__(lookahead=patience)

def theirs(problem, *, seed=0, **options):
    return astar(problem, seed=seed, **options)

def none(problem, *, seed, budget):
    pass
"""
POINTS = "[antway.policies]\npatient = their_package:Patient\n\n[antway.planners]\ntheirs = their_package:theirs\n"
PROBLEM = Problem(Grid([[False, False]]), (0, 0), (0, 1))


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """A package of someone else's, as pip would lay it down."""
    (tmp_path / "their_package.py").write_text(THEIRS)
    info = tmp_path / "their_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(POINTS)
    monkeypatch.syspath_prepend(tmp_path)
    return tmp_path


@pytest.mark.parametrize("name", ["patient", "their_package:Patient"])
def test_policies_of_others(installed, name):
    """By both names a policy plays, takes options, and keeps the contract."""
    result = run(load_scenario(scene("paper")), name, seed=3)
    assert result.outcome.value != "error" and result.trace.policy == name
    assert make_policy(f"{name}/patience=3.0").lookahead == 3.0
    check_policy(lambda: make_policy(name), seconds=30.0)


@pytest.mark.parametrize("name", ["theirs", "their_package:theirs"])
def test_planners_of_others(installed, name):
    """By both names a planner answers `solve`; it keeps the contract."""
    grid = Grid([[False, True, False], [False, False, False]])
    start, *_, goal = (tuple(cell) for cell in free_cells(grid).tolist())
    assert solve(Problem(grid, start, goal), name).length == solve(Problem(grid, start, goal), "dijkstra").length
    check_planner(find("planner", name, PLANNERS, "antway.planners"))


def test_what_is_not_there_is_named(installed):
    """A wrong name lists the shipped ones and those of others; a wrong import says why."""
    with pytest.raises(BadParameter, match=r"policy = 'impatient': must be one of .*antway.*, patient, or MODULE:NAME"):
        make_policy("impatient")
    (installed / "unfinished.py").write_text("def planner(problem:\n")
    (installed / "misspelt.py").write_text("plannner = planer\n")
    wrong = ["their_package:Nothing", "no_such_package:Patient", ":", "their_package:", ".x:y", "..:x", "os:path"]
    for name in [*wrong, "unfinished:planner", "misspelt:planner"]:
        for use in (make_policy, lambda name: solve(PROBLEM, name)):
            with pytest.raises(BadParameter, match="MODULE:NAME"):
                use(name)
    with pytest.raises(BadParameter, match="colour = 'red': must be left out: the options of policy patient are"):
        make_policy("patient", colour="red")


@pytest.mark.parametrize("name", ["math:sqrt", "builtins:dict", "their_package:Patient", "their_package:none"])
def test_what_is_no_planner_is_refused(installed, name):
    """A function of something else, and one that returns no plan."""
    with pytest.raises(BadParameter, match=f"planner = '{name}'"):
        solve(PROBLEM, name)


COMMANDS = """
import sys
from antway.cli import main
for line in sys.argv[1:]:
    sys.argv = ["antway", *line.split()]
    try:
        main()
    except SystemExit as ended:
        print(f"status {ended.code};")
"""


def test_the_commands_take_modules_of_the_working_directory(installed):
    """`antway run --policy` and `antway plan --planner` find MODULE:NAME where they are started."""
    (installed / "map.txt").write_text("...\n.@.\n...\n")

    plan = "plan map.txt --start 0,0 --goal 2,2 --cells --json --planner their_package:"
    lines = "run paper --policy their_package:Patient --seed 3 --json", f"{plan}theirs", f"{plan}nothing"
    done = subprocess.run([sys.executable, "-c", COMMANDS, *lines], cwd=installed, capture_output=True, text=True, check=True)
    (ran, played), (planned, found), (_, refused) = (part.split("status ") for part in done.stdout.split(";")[:-1])
    assert json.loads(ran)["policy"] == "their_package:Patient" and int(played) in (0, 5), done.stderr
    assert json.loads(planned)["planner"] == "their_package:theirs" and int(found) == 0, done.stderr
    assert int(refused) == 2 and "MODULE:NAME" in done.stderr


RAISING = """
from dataclasses import replace
from antway.search.astar import astar

def raises(problem, *, seed, budget):
    return problem.grid["door"]

def lies(problem, *, seed, budget):
    found = astar(problem, seed=seed, budget=budget)
    return replace(found, length=found.length / 2)
"""


RAISED = {"raises": r"TypeError: .* \(raising.py, line 6, in raises\)", "lies": "InvalidPlan: "}


@pytest.mark.parametrize(("name", "told"), RAISED.items())
def test_what_a_planner_raises_is_one_line_and_status_one(name, told, tmp_path, monkeypatch, capsys):
    """`antway plan` names the line of a planner that raises, and what is wrong with the plan of one that lies."""
    (tmp_path / "raising.py").write_text(RAISING)
    (tmp_path / "map.txt").write_text("...\n.@.\n...\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    line = f"antway plan map.txt --cells --start 0,0 --goal 2,2 --planner raising:{name}"
    monkeypatch.setattr("sys.argv", line.split())
    with pytest.raises(SystemExit) as ended:
        main()
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert ended.value.code == 1 and len(error) == 1 and re.match(f"error: planner raising:{name}: {told}", error[0]), error


BROKEN = {
    "a constructor": ("class P:\n    def __init__(self): raise OSError('no\\nluck')\n", "OSError: no luck", 2, "__init__"),
    "a script": ("import sys\nsys.exit(3)\n", "SystemExit: 3", 2, "<module>"),
    "a module": ("{}['door']\n", "KeyError: 'door'", 1, "<module>"),
}


@pytest.mark.parametrize("what", BROKEN)
def test_a_policy_that_cannot_be_made_is_refused_with_its_line(what, tmp_path, monkeypatch):
    """Whatever a module or a constructor raises, also by ending, is one line of wrong input and names the line of theirs."""
    text, error, line, name = BROKEN[what]
    module = "broken_" + what.replace(" ", "_")
    (tmp_path / f"{module}.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(BadParameter) as caught:
        make_policy(f"{module}:P")
    told = str(caught.value)
    assert told.startswith(f"policy = '{module}:P': must be") and f"{error} ({module}.py, line {line}, in {name})" in told
    assert "\n" not in told


def test_an_announced_policy_that_cannot_be_imported_is_refused(installed):
    """The entry point of a broken package is wrong input as well."""
    (installed / "their_package-1.0.dist-info" / "entry_points.txt").write_text("[antway.policies]\ngone = no_such_module:P\n")
    with pytest.raises(BadParameter, match=r"policy = 'gone': must be .*ModuleNotFoundError: No module named 'no_such_module'"):
        make_policy("gone")
