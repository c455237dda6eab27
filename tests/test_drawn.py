"""A map that was drawn, in a picture or in letters, is shown as drawn: in figures, animations, pages; a ROS map with y up."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageColor

from antway import Grid, RobotSpec, Scenario, World, load_map, load_scenario, save_map
from antway.errors import BadParameter
from antway.view import style
from antway.view.animation import last_moment, write_animation
from antway.view.notebook import grid_figure
from antway.view.replay import replay_page, write_replay
from antway.world.scenario import save_scenario
from antway.world.trace import Trace
from browser import DESKTOP, chromium, needs_browser, opened
from sample import sample_trace

DRAWN = "@@@@@@@@@@\n" + 7 * "..........\n" + "@.........\n"  # a wall along the first line, one cell in the last


@pytest.fixture
def grid(tmp_path: Path) -> Grid:
    file = tmp_path / "m.txt"
    file.write_text(DRAWN)
    return load_map(file)


def on_map(grid: Grid) -> Trace:
    """An episode without obstacles, drawn on that map."""
    trace = sample_trace(20, 0)
    cells = replace(grid, resolution=2.0)
    task = replace(trace.task, grid=cells, robot=RobotSpec(radius=0.1), start=(3.0, 9.0), goal=(17.0, 9.0))
    return replace(trace, task=task, xy=np.linspace((3.0, 9.0), (17.0, 9.0), 21), decisions=())


def walls(picture: np.ndarray) -> tuple[float, float]:
    """How much of the upper and of the lower half of a picture is as dark as walls."""
    grey = picture[..., :3].mean(axis=2) < 110
    half = len(grey) // 2
    return float(grey[:half].mean()), float(grey[half:].mean())


def pixels(file: Path) -> np.ndarray:
    with Image.open(file) as picture:
        return np.asarray(picture.convert("RGB"))


@pytest.mark.parametrize("suffix", [".txt", ".map", ".png", ".pgm", ".npy", ".yaml"])
def test_what_was_drawn_keeps_row_0_on_top(tmp_path: Path, grid: Grid, suffix: str) -> None:
    """Pictures and letters are shown as drawn, arrays and ROS maps with y up; the cells are the same either way."""
    file = tmp_path / f"other{suffix}"
    save_map(grid, file)
    found = load_map(file, **({} if suffix == ".yaml" else {"resolution": 1.0}))
    assert found == grid and found.top_first == (suffix not in (".npy", ".yaml"))
    assert found.inflate(0.4).top_first == found.top_first


@pytest.mark.parametrize("top_first", [True, False])
def test_a_saved_scenario_is_shown_as_before(tmp_path: Path, grid: Grid, top_first: bool) -> None:
    """Also the page keeps edits so: what was drawn used to be shown upside down once it was restored."""
    cells = replace(grid, top_first=top_first)
    save_scenario(Scenario(World(cells), (1.5, 4.5), (8.5, 4.5)), tmp_path / "s.toml")
    found = load_scenario(tmp_path / "s.toml").world.grid
    assert found == cells and found.top_first == top_first
    (tmp_path / "s.toml").write_text("top_first = 2\n" + (tmp_path / "s.toml").read_text().removeprefix("top_first = true\n"))
    with pytest.raises(BadParameter, match="top_first"):
        load_scenario(tmp_path / "s.toml")


@pytest.mark.parametrize(("rows", "cols"), [(80, 12), (1200, 3), (12, 80), (4, 2000)])
def test_animations_of_long_maps_show_all_that_happened(rows: int, cols: int) -> None:
    """On a map that is far longer than wide, or wider than high, robot and goal are seen where they are on the map."""
    grid, trace = Grid(np.zeros((rows, cols), bool), resolution=0.2), sample_trace(20, 0)
    length, width = 0.2 * max(rows, cols), 0.1 * min(rows, cols)
    ends = np.array([(0.1 * length, width), (0.9 * length, width)])
    ends = ends[:, ::-1] if rows > cols else ends
    robot = RobotSpec(radius=0.1, sensor_range=1.0)
    task = replace(trace.task, grid=grid, robot=robot, start=tuple(ends[0]), goal=tuple(ends[1]))
    halfway = np.linspace(ends[0], ends.mean(axis=0), 21)
    picture = np.asarray(last_moment(replace(trace, task=task, xy=halfway, decisions=()), 480)).astype(int)
    high, wide = picture.shape[:2]
    assert wide >= 160 and high >= 40
    for colour, at in ((style.GOLD, 0.9), (style.BLUE, 0.3)):  # the middle of the goal's star, and of what was driven
        places = np.argwhere(np.abs(picture - ImageColor.getrgb(colour)).max(axis=2) < 30)
        y, x = (places.min(axis=0) + places.max(axis=0)) / 2
        across, along = (x / wide, 1 - y / high) if rows > cols else (y / high, x / wide)
        assert abs(across - 0.5) < 0.05 and abs(along - at) < 0.02


@pytest.mark.parametrize("top_first", [True, False])
def test_figures_and_animations_show_it_so(tmp_path: Path, grid: Grid, top_first: bool) -> None:
    """The wall of row 0 is in the upper half of a figure and of each frame, or in the lower half where y points up."""
    shown = replace(grid, top_first=top_first)
    figure = tmp_path / "f.png"
    style.save(grid_figure(shown), figure)
    file = write_animation(on_map(shown), tmp_path / "a.gif", width=200)
    for name, part in ((figure, slice(None)), (file, slice(0, 180))):
        upper, lower = walls(pixels(name)[part])
        assert (upper > 3 * lower) == top_first and (lower > 3 * upper) != top_first


def test_a_trace_keeps_it(tmp_path: Path, grid: Grid) -> None:
    """A trace written and read again is shown in the same way, and one that shows y up says nothing of it."""
    trace = on_map(grid)
    trace.save(tmp_path / "t.json")
    assert Trace.load(tmp_path / "t.json").task.grid.top_first
    assert "top_first" not in (sample_trace(20, 0).save(tmp_path / "u.json") or (tmp_path / "u.json").read_text())


@needs_browser
@pytest.mark.parametrize("top_first", [True, False])
def test_the_page_shows_it_so(tmp_path: Path, grid: Grid, top_first: bool) -> None:
    """On the page the wall of row 0 is on top as well, and a place on the screen is the place in the world that it shows."""
    trace = on_map(replace(grid, top_first=top_first))
    assert f'"top_first":{str(top_first).lower()}' in replay_page(trace)
    with chromium() as browser:
        page, complaints = opened(browser, write_replay(trace, tmp_path / "r.html").as_uri(), ("file:", "data:"), **DESKTOP)
        shot: Any = page.locator("#stage").screenshot(path=tmp_path / "s.png")
        upper, lower = walls(pixels(tmp_path / "s.png"))
        assert shot and complaints == [] and (upper > 2 * lower) == top_first and (lower > 2 * upper) != top_first
