"""Figures compared with pictures of them kept in tests/baselines: small, and without words.

Words are left out because each FreeType draws them, and lays out what is round them, a little otherwise; tests/test_figures.py
tests them. After a wanted change: `python tests/test_pictures.py` writes them anew, to be looked at before they are committed.
"""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from antway import Grid, Moves, Problem, solve
from antway.ants.gridpath import Exploration
from antway.ants.tsp import Tsp, solve_tsp
from antway.arena.store import Row
from antway.arena.summary import summarise
from antway.errors import BadParameter
from antway.planning import Plan, Status
from antway.view import charts, colonies, diagrams, figures
from antway.view.animation import write_animation
from sample import sample_trace

FOLDER = Path(__file__).parent / "baselines"
DPI = 50
WORST, SHARE = 32.0, 0.001  # of 255: by how much a pixel may differ, and how many may by more


def episodes() -> list[Row]:
    """Results of three policies on three levels, drawn from a formula."""
    rows = []
    for k, policy in enumerate(("antway", "paper", "stop")):
        for i, level in enumerate(("easy", "medium", "hard")):
            for e in range(20):
                reached = (7 * e + 3 * i) % 20 >= 6 * k + 2 * i
                facts: dict[str, Any] = {"time": 10.0 + k + (e % 5) / 2, "bound": 10.0, "difficulty": 1.0 - i / 4}
                rows.append(
                    Row("s", f"{level}-{e}", policy, 0, "1", f"x/{level}", "reached" if reached else "timeout", "", **facts)
                )
    return rows


def colony(grid: Grid) -> Exploration:
    """What a colony might leave: most pheromone along the diagonal, less beside it."""
    row, col, move = np.indices((*grid.shape, 8))
    steps = Moves.EIGHT.offsets[move]
    free = np.pad(~grid.blocked, 1)[row + 1 + steps[..., 0], col + 1 + steps[..., 1]] & ~grid.blocked[row, col]
    tau = np.where(free & (steps.sum(axis=-1) > 0), 0.1 + np.exp(-np.abs(row - col) / 1.5), 0.1 * free)
    return Exploration(solve(Problem(grid, (0, 0), (18, 18)), "dijkstra"), np.empty((0, 4)), tau, (0, 0, *grid.shape))


def pictures() -> dict[str, Figure]:
    trace = sample_trace(150, 3)
    path = figures.shortest(trace.task)
    history = np.column_stack((50 - np.arange(20), 70 - np.arange(20), np.linspace(0, 1, 20), np.zeros(20)))
    angle = 2 * np.pi * np.arange(24) / 24
    ring = Tsp(np.column_stack((np.cos(angle), np.sin(angle))) * 100, name="ring")
    grid = trace.task.grid
    return {
        "plan": figures.plan_figure(grid, path),
        "no-path": figures.plan_figure(grid, Plan(Status.NO_PATH), ends=((0.5, 0.5), (18.5, 18.5)), title="No path"),
        "meet": figures.moment_figure(trace, 40, title="About to meet a moving obstacle", path=path),
        "avoid": figures.moment_figure(trace, 50, title="Going round it", path=path, pheromone=True),
        "final": figures.final_figure(trace, path=path),
        "strip": figures.strip_figure(trace, [10, 50, 80, 120], path=path),
        "convergence": figures.convergence_figure({"constant": history, "adaptive": history - 3}, optimum=27.0),
        "tour": figures.tour_figure(ring, solve_tsp(ring, local_search="2opt", cycles=3)),
        "chart": diagrams.avoidance_chart(),
        "pheromone": colonies.pheromone_over_time_figure(grid, {1: colony(grid)}),
        "success": charts.success_figure(summarise(episodes())),
        "time-ratio": charts.time_ratio_figure(episodes()),
    }


def raster(figure: Figure) -> Image.Image:
    """Draw a figure small, without its words and legends."""
    for words in (*figure.findobj(Text), *figure.legends, *(one for axes in figure.axes for one in [axes.get_legend()] if one)):
        words.set_visible(False)
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    return Image.open(buffer).convert("RGB")


def unlike(one: Image.Image, other: Image.Image) -> float:
    """The share of pixels in which two pictures differ by more than edges drawn a little otherwise do."""
    if max(abs(a - b) for a, b in zip(one.size, other.size)) > 2:
        return 1.0
    size = (min(one.width, other.width), min(one.height, other.height))

    def soft(image: Image.Image) -> NDArray[np.float64]:
        return np.asarray(image.convert("RGB").crop((0, 0, *size)).filter(ImageFilter.BoxBlur(1)), dtype=np.float64)

    return float((np.abs(soft(one) - soft(other)).max(axis=2) > WORST).mean())


@pytest.fixture(scope="module")
def drawn() -> dict[str, Figure]:
    return pictures()


NAMES = ("plan", "no-path", "meet", "avoid", "final", "strip", "convergence", "tour", "chart", "pheromone")
NAMES += ("success", "time-ratio")


@pytest.mark.parametrize("name", NAMES)
def test_a_figure_looks_as_it_did(drawn: dict[str, Figure], name: str, tmp_path: Path) -> None:
    """Each figure, drawn small, is the picture kept of it."""
    with Image.open(FOLDER / f"{name}.png") as kept:
        share = unlike(raster(drawn[name]), kept)
    if share > SHARE:
        raster(drawn[name]).save(tmp_path / f"{name}.png")
    assert share <= SHARE, f"{share:.4f} of the pixels differ; drawn now: {tmp_path / name}.png"


def test_what_is_missing_is_seen(drawn: dict[str, Figure]) -> None:
    """The comparison tells all figures apart, and a figure from the same one without its path, pheromone or tubes, or later."""
    images = {name: raster(figure) for name, figure in drawn.items()}
    for a in images:
        assert all(unlike(images[a], images[b]) > SHARE for b in images if b != a), a
    trace = sample_trace(150, 3)
    path = figures.shortest(trace.task)
    options: dict[str, Any] = {"title": "Going round it", "path": path, "pheromone": True}
    whole = raster(figures.moment_figure(trace, 50, **options))
    bare = replace(trace, decisions=tuple((step, replace(one, predicted=None)) for step, one in trace.decisions))
    assert unlike(raster(figures.moment_figure(bare, 50, **options)), whole) > SHARE, "without tubes"
    for step, change in ((50, {"path": None}), (50, {"pheromone": False}), (54, {})):
        assert unlike(raster(figures.moment_figure(trace, step, **{**options, **change})), whole) > SHARE, (step, change)


def test_pictures_kept_are_small() -> None:
    """All baselines are of figures drawn here, and take less than 300 kB."""
    files = sorted(FOLDER.glob("*.png"))
    assert {file.stem for file in files} == {*NAMES, "animation"} and sum(file.stat().st_size for file in files) < 300_000


def test_an_animation_looks_as_it_did(tmp_path: Path) -> None:
    """A frame in the midst of the encounter, but for its caption, is the picture kept of it."""
    with Image.open(FOLDER / "animation.png") as kept, Image.open(frame(tmp_path)) as now:
        assert unlike(now, kept) <= SHARE


def frame(folder: Path) -> Path:
    trace = sample_trace(150, 3)
    file = write_animation(trace, folder / "a.gif", shortest=figures.shortest(trace.task), frames=11, width=240)
    with Image.open(file) as gif:
        gif.seek(5)
        gif.convert("RGB").crop((0, 0, gif.width, gif.width)).save(folder / "animation.png")
    return folder / "animation.png"


def test_charts_refuse_what_they_cannot_draw() -> None:
    """No rows and no bound are named."""
    with pytest.raises(BadParameter, match="table"):
        charts.success_figure([])
    with pytest.raises(BadParameter, match="rows"):
        charts.time_ratio_figure([Row("s", "e", "p", 0, "1", "g", "reached", "")])


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, figure in pictures().items():
        raster(figure).save(FOLDER / f"{name}.png", optimize=True)
    frame(FOLDER)
    (FOLDER / "a.gif").unlink()
