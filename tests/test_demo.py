"""The demo: every file it promises, and numbers that are those of the episodes."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from PIL import Image

from antway import BadScenario, Outcome, check_episode, run
from antway.demo import FLOW_CHARTS, run_demo, scene, static_shortest, summary
from antway.scenes import SCENES
from antway.world.trace import Trace

PICTURES = ("figure4_global_path.png", "figure5_encounter.png", "figure6_avoidance.png", "figure7_final_path.png")
FILES = (*PICTURES, "demo.gif", "replay.html", "trace.json", "summary.json")


def test_the_demo_writes_what_it_promises(tmp_path: Path) -> None:
    """Three scenes, each reached; all figures, animation, page, trace and summary are there, open, and agree."""
    said: list[tuple[str, str]] = []
    rows = dict(run_demo(tmp_path, policy="paper", said=lambda *what: said.append(what)))
    assert tuple(rows) == SCENES and all(numbers["reached"] for numbers in rows.values())
    assert ("office", "animation") in said
    for folder in (tmp_path, *(tmp_path / name for name in SCENES)):
        assert all((folder / name).stat().st_size > 200 for name in FILES), folder
    for picture in (*PICTURES, *FLOW_CHARTS, "convergence.png"):
        with Image.open(tmp_path / picture) as image:
            assert min(image.size) > 400
            image.load()
    for name, numbers in rows.items():
        assert json.loads((tmp_path / name / "summary.json").read_text()) == numbers
        trace = Trace.load(tmp_path / name / "trace.json")
        check_episode(trace)
        assert trace.outcome is Outcome.REACHED and numbers["length"] == pytest.approx(trace.length)
        assert numbers["length_ratio"] >= 1 - trace.task.grid.resolution / numbers["shortest"]


def test_a_summary_of_an_episode_without_obstacles_has_no_clearance() -> None:
    """What there is not is None, never infinity or NaN, so that it is JSON."""
    from dataclasses import replace

    empty = scene("paper")
    result = run(replace(empty, world=replace(empty.world, obstacles=())), "paper")
    numbers = summary(result, empty.task)
    assert numbers["min_clearance"] is None and numbers["reached"]
    assert numbers["length_ratio"] == pytest.approx(result.length / static_shortest(empty.task), rel=0.02)
    assert all(not isinstance(value, float) or math.isfinite(value) for value in numbers.values())


def test_a_scene_is_a_shipped_name_or_a_file() -> None:
    """Shipped names load; anything else is the path of a file."""
    assert [scene(name).name for name in SCENES] == list(SCENES)
    with pytest.raises(BadScenario, match=r"nowhere\.toml"):
        scene("nowhere.toml")
