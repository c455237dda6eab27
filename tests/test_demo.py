"""The demo: every file it promises, and numbers that are those of the episodes."""

from __future__ import annotations

import json
import math
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from antway import BadParameter, BadScenario, Grid, RobotSpec, Scenario, World, check_episode, load_scenario, run
from antway.demo import FLOW_CHARTS, figure_names, run_demo, static_shortest, summary, write_episode
from antway.scenes import SCENES
from antway.world.trace import Trace
from common import cases

PICTURES = (*figure_names("paper"), *figure_names("antway"))
FILES = (*PICTURES, "demo.gif", "replay.html", "trace.json", "summary.json")


def test_the_demo_writes_what_it_promises(tmp_path: Path) -> None:
    """Both policies on three scenes, all reached; figures, animation, page, traces and summaries are there, open, and agree."""
    on_progress: list[tuple[str, str]] = []
    rows = list(run_demo(tmp_path, on_progress=lambda *what: on_progress.append(what)))
    played = [*product(SCENES, ("paper", "antway")), ("rounds", "antway")]
    assert sorted((name, numbers["policy"]) for name, numbers in rows) == sorted(played)
    assert all((tmp_path / "rounds" / name).stat().st_size > 200 for name in ("rounds.png", "replay.html", "summary.json"))
    assert all(numbers["reached"] for _, numbers in rows) and ("office", "episodes") in on_progress
    for folder in (tmp_path, *(tmp_path / name for name in SCENES)):
        assert all((folder / name).stat().st_size > 200 for name in FILES), folder
        page = (folder / "replay.html").read_text()
        assert page.count('"policy":"paper"') == page.count('"policy":"antway"') == 1
    for picture in (*PICTURES, *FLOW_CHARTS, "convergence.png"):
        with Image.open(tmp_path / picture) as image:
            assert min(image.size) > 400
            image.load()
    with Image.open(tmp_path / "demo.gif") as gif:
        assert gif.size[0] > 1.6 * gif.size[1] and gif.n_frames == 100, "two square maps side by side"
    for name, numbers in rows:
        folder = tmp_path / name / ("paper" if numbers["policy"] == "paper" else "")
        timings = json.loads((folder / "timings.json").read_text())
        trace = Trace.load(folder / "trace.json")
        assert len(timings.pop("cycle_ms")) == len(trace) and isinstance(timings.pop("order_ms"), list)
        assert json.loads((folder / "summary.json").read_text()) | timings == numbers
        check_episode(trace)
        assert trace.policy == numbers["policy"] and numbers["length"] == pytest.approx(trace.length)
        near = trace.task.grid.resolution + 2 * trace.task.goal_tolerance * numbers.get("stops", 0)
        assert numbers["length_ratio"] >= 1 - near / numbers["shortest"]


def test_a_demo_of_no_policy_is_refused(tmp_path: Path) -> None:
    """Unknown names and an empty list are wrong input, before anything is written."""
    for policies in ([], ["nobody"], ["nobody", "antway"]):
        with pytest.raises(BadParameter, match="polic"):
            list(run_demo(tmp_path / "out", policies=policies))


def test_a_summary_of_an_episode_without_obstacles_has_no_clearance() -> None:
    """What there is not is None, never infinity or NaN, so that it is JSON."""
    from dataclasses import replace

    empty = load_scenario("paper")
    result = run(replace(empty, world=replace(empty.world, obstacles=())), "paper")
    numbers = summary(result, empty.task)
    assert numbers["min_clearance"] is None and numbers["reached"]
    assert numbers["length_ratio"] == pytest.approx(result.length / static_shortest(empty.task), rel=0.02)
    assert all(not isinstance(value, float) or math.isfinite(value) for value in numbers.values())


def test_a_scene_is_a_shipped_name_or_a_file() -> None:
    """Shipped names load; anything else is the path of a file."""
    assert [load_scenario(name).name for name in SCENES] == list(SCENES)
    with pytest.raises(BadScenario, match=r"nowhere\.toml"):
        load_scenario("nowhere.toml")


def test_two_runs_of_a_seed_write_the_same_bytes(tmp_path: Path) -> None:
    """C49: of the files of an episode, at night of a demo, with figures, animations and pages, only timings differ."""
    one, two = tmp_path / "one", tmp_path / "two"
    for folder in (one, two):
        if cases(1, 2) > 1:
            list(run_demo(folder))
        else:
            write_episode(run(load_scenario("warehouse"), "paper", seed=3), folder)
    files, others = ({path.relative_to(folder) for path in folder.rglob("*") if path.is_file()} for folder in (one, two))
    assert len(files) >= 9 and files == others
    differ = {name.name for name in files if (one / name).read_bytes() != (two / name).read_bytes()}
    assert differ == {"timings.json"}


def test_where_no_path_leads_from_cell_to_cell_there_is_no_ratio() -> None:
    """In a corridor of two wide cells no centre of a cell has space for the robot, which drives between them."""
    walls = np.ones((6, 24), dtype=bool)
    walls[2:4, 1:23] = False
    corridor = Scenario(World(Grid(walls, 0.5)), start=(1.5, 1.5), goal=(10.0, 1.5), robot=RobotSpec(radius=0.3))
    numbers = summary(run(corridor), corridor.task)
    assert numbers["reached"] and numbers["shortest"] is None and numbers["length_ratio"] is None
