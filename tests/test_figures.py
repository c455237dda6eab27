"""Figures, flow charts and animations: what is in them, where, and that nothing lies over anything else."""

from __future__ import annotations

import io
import sys
from dataclasses import replace
from functools import cache
from itertools import combinations
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from PIL import Image

from antway import BadParameter, Grid, Plan, Problem, RobotSpec, Scenario, Status, World, load_map, plan, plan_tour, run, smooth
from antway.ants.gridpath import explore
from antway.ants.timed_front import timed_front
from antway.ants.tsp import Tsp, solve_tsp
from antway.arena.store import Row
from antway.arena.summary import summarise
from antway.view import animation, charts, colonies, diagrams, figures, plans
from antway.view.animation import CAPTION, LEGEND, write_animation
from antway.view.notebook import pixels
from antway.view.replay import write_replay
from antway.view.style import BLUE, ORANGE, RED, TEAL, WALL
from antway.view.tours import plan_tour_figure, rounds_figure
from antway.world.motions import Line
from antway.world.robots import load_robot
from antway.world.stops import Stop
from antway.world.world import Obstacle
from sample import sample_trace

TRACE = sample_trace(150, 3)
HISTORY = np.column_stack((50 - np.arange(20), 70 - np.arange(20), np.linspace(0, 1, 20), np.zeros(20)))
HISTORY[0, :2] = np.inf, np.nan
RATIOS = {"antway": 1.02, "paper": 1.1, "follow": 1.4, "stop": 1.6, "replan": 1.2, "sipp": 1.05, "dwa": 1.3, "orca": 1.25}
ROWS = [
    Row("s", f"{level}-{e}", policy, 0, "1", f"x/{level}", "reached" if e % 4 else "timeout", "", 10 * ratio + e, bound=10.0)
    for policy, ratio in RATIOS.items() for level in ("sparse", "dense") for e in range(8)
]  # fmt: skip
NAMES = (
    "plan",
    "no path",
    "turned",
    "wide",
    "tall",
    "meet",
    "avoid",
    "end",
    "final",
    "strip",
    "convergence",
    "tour",
    "pheromone over time",
    "seeds",
    "sensitivity",
    "motion",
    "front",
    "success",
    "time-ratio",
    "chart 1",
    "chart 2",
    "chart 3",
)  # of the figures below


@cache
def shortest_path() -> Plan:
    return figures.shortest(TRACE.task)


def motion_figure() -> Figure:
    """A smoothed plan of a robot with a footprint."""
    office, robot = load_map("office"), load_robot("jackal")
    path = plan(office, (1.5, 3.0), (22.0, 12.5), robot_radius=robot.radius)
    return plans.motion_figure(office, path, smooth(path, robot), robot)


@cache
def every_figure() -> dict[str, Figure]:
    """All that are looked at below, drawn when the first test asks, not where tests are merely collected."""
    square = Tsp([(0, 0), (0, 2), (2, 2), (2, 0), (1, 0)], name="five")
    square_room = TRACE.task.grid
    turned = Grid(np.eye(6, dtype=bool), 0.3, (-2.0, 1.0, 0.7))
    return {
        "plan": figures.plan_figure(TRACE.task.grid, shortest_path()),
        "no path": figures.plan_figure(TRACE.task.grid, Plan(Status.NO_PATH), ends=((0.5, 0.5), (18.5, 18.5)), title="No path"),
        "turned": figures.plan_figure(turned, plan(turned, turned.centre((0, 1)), turned.centre((0, 5)))),
        "wide": figures.plan_figure(Grid(np.zeros((4, 90), bool)), Plan(Status.NO_PATH)),
        "tall": figures.plan_figure(Grid(np.zeros((90, 6), bool)), Plan(Status.NO_PATH)),
        "meet": figures.moment_figure(TRACE, 40, title="About to meet a moving obstacle", path=shortest_path()),
        "avoid": figures.moment_figure(TRACE, 70, title="Going round it", path=shortest_path(), pheromone=True),
        "end": figures.moment_figure(TRACE, len(TRACE), title="At the goal"),
        "final": figures.final_figure(TRACE, path=shortest_path()),
        "strip": figures.strip_figure(TRACE, [10, 50, 80, 120], path=shortest_path()),
        "convergence": figures.convergence_figure({"constant": HISTORY, "adaptive": HISTORY - 3}, optimum=27.0),
        "tour": figures.tour_figure(square, solve_tsp(square, cycles=20)),
        "pheromone over time": colonies.pheromone_over_time_figure(
            square_room, {t: explore(Problem(square_room, (0, 0), (18, 18)), cycles=t, ants=9) for t in (1, 3)}
        ),
        "seeds": colonies.seeds_figure(
            {rule: [solve_tsp(square, rule, cycles=20, seed=s).history for s in range(3)] for rule in ("mmas", "as")},
            optimum=8.0,
        ),
        "sensitivity": colonies.sensitivity_figure("beta", [1, 2, 5], [[9, 8.5], [8, 8], [8, 9]], optimum=8.0),
        "motion": motion_figure(),
        "front": plans.front_figure(square_room, timed_front(Problem(square_room, (0, 0), (18, 18)), radius=0.3, horizon=60.0)),
        "success": charts.success_figure(summarise(ROWS)),
        "time-ratio": charts.time_ratio_figure(ROWS),
        "chart 1": diagrams.ant_system_chart(),
        "chart 2": diagrams.improved_chart(),
        "chart 3": diagrams.avoidance_chart(),
    }


@pytest.mark.parametrize("name", NAMES)
def test_no_text_lies_over_another_or_off_the_page(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every word of a figure is on the page and clear of every other word."""
    fig, drawn, draw = every_figure()[name], [], Text.draw
    monkeypatch.setattr(Text, "draw", lambda text, renderer: (drawn.append(text), draw(text, renderer))[1])
    fig.canvas.draw()
    boxes = [(text.get_text(), text.get_window_extent()) for text in drawn if text.get_visible() and text.get_text().strip()]
    page = fig.bbox
    for words, box in boxes:
        assert page.x0 - 1 <= box.x0 and box.x1 <= page.x1 + 1 and page.y0 - 1 <= box.y0 and box.y1 <= page.y1 + 1, words
    for (a, one), (b, other) in combinations(boxes, 2):
        across = min(one.x1, other.x1) - max(one.x0, other.x0)
        along = min(one.y1, other.y1) - max(one.y0, other.y0)
        assert across <= 1 or along <= 1, f"{a!r} lies over {b!r}"


def test_every_figure_is_looked_at() -> None:
    """A figure that is added is added to the names as well."""
    assert tuple(every_figure()) == NAMES


TITLED = ["plan", "meet", "avoid", "final", "strip", "convergence", "pheromone over time", "success", "time-ratio"]


@pytest.mark.parametrize("name", TITLED)
def test_figures_are_titled_and_name_their_units(name: str) -> None:
    """Each figure has a title, and axes that carry numbers say of what and in which unit."""
    axes = every_figure()[name].axes[0]
    assert axes.get_title(loc="left") and "(" in axes.get_ylabel()


def test_obstacles_side_by_side_both_have_their_numbers() -> None:
    """Where two numbers above would overlap, the second stands below."""
    discs = tuple(Obstacle(0.3, Line((x, 5.0), (x, 5.0), 0.0)) for x in (5.0, 5.4))
    scenario = Scenario(World(Grid(np.zeros((20, 20), bool)), discs), (1.0, 1.0), (18.0, 18.0))
    axes = figures.moment_figure(run(scenario, "follow", horizon=0.2).trace, 1, title="Two").axes[0]
    above, below = (text.get_position()[1] for text in axes.texts)
    assert above > 5.0 > below and [text.get_text() for text in axes.texts] == ["0", "1"]


def test_the_drawing_leaves_matplotlib_as_it_was(tmp_path: Path) -> None:
    """No figure touches pyplot's state or the global settings."""
    before = dict(mpl.rcParams)
    figures.save(figures.final_figure(TRACE), tmp_path / "figure.png")
    assert dict(mpl.rcParams) == before
    assert "matplotlib.pyplot" not in sys.modules or not sys.modules["matplotlib.pyplot"].get_fignums()


def shares(fig: Figure, colour: str) -> float:
    """The share of a figure's pixels that are near a colour."""
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=80)
    pixels = np.asarray(Image.open(buffer).convert("RGB")).astype(int)
    wanted = np.array(mpl.colors.to_rgb(colour)) * 255
    return float((np.abs(pixels - wanted).sum(axis=2) < 30).mean())


@pytest.mark.parametrize("cells", [900, 2000, 5000])
def test_a_wall_of_one_cell_is_drawn_on_a_large_map(cells: int) -> None:
    """Where a pixel shows several cells, a wall one cell thick is drawn wherever it is, on one map and on two side by side."""
    for col in range(cells // 2, cells // 2 + 3):
        blocked = np.zeros((cells, cells), bool)
        blocked[:, col] = True
        trace = replace(TRACE, task=replace(TRACE.task, grid=Grid(blocked, 20 / cells)))
        figs = [figures.final_figure(trace)]
        if cells == 900:
            figs.append(figures.strip_figure(trace, [10, 60]))
        for fig in figs:
            fig.canvas.draw()
            for axes in [one for one in fig.axes if one.get_xlabel()]:
                left, low, right, high = axes.bbox.extents.round().astype(int)
                picture = np.asarray(fig.canvas.buffer_rgba())[::-1][low + 5 : high - 5, left + 5 : right - 5, :3].astype(int)  # type: ignore[attr-defined]
                wall = np.abs(picture - [int(WALL[k : k + 2], 16) for k in (1, 3, 5)]).max(axis=2) < 12
                assert wall.any(axis=1).mean() > 0.8, (cells, col)


def test_what_moves_is_red_and_only_that() -> None:
    """The plan on the empty map has no red; where obstacles are, red shows; the robot's way is blue, the chosen one green."""
    assert shares(every_figure()["plan"], RED) == 0.0 and shares(every_figure()["plan"], BLUE) > 1e-3
    for name in ("meet", "avoid", "final"):
        assert shares(every_figure()[name], RED) > 3e-4, name
    assert shares(every_figure()["avoid"], TEAL) > 3e-4


def test_colours_are_told_apart_by_the_colour_blind() -> None:
    """Robot, obstacle and chosen way stay far apart in CIE lightness or hue as seen with deuteranopia and protanopia."""
    deutan = np.array([[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]])
    protan = np.array([[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]])
    for seen in (np.eye(3), deutan, protan):
        colours = [seen @ np.array(mpl.colors.to_rgb(c)) ** 2.2 for c in (BLUE, RED, TEAL, "#454B54")]
        for a, b in combinations(colours, 2):
            assert np.linalg.norm(np.clip(a, 0, 1) ** (1 / 2.2) - np.clip(b, 0, 1) ** (1 / 2.2)) > 0.2


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_the_same_figure_is_the_same_bytes(tmp_path: Path, suffix: str) -> None:
    """A figure drawn twice gives equal files, raster and vector."""
    for k in range(2):
        figures.save(figures.moment_figure(TRACE, 70, title="Twice", pheromone=True), tmp_path / f"{k}.{suffix}")
    assert (tmp_path / f"0.{suffix}").read_bytes() == (tmp_path / f"1.{suffix}").read_bytes()


def test_wrong_steps_and_names_are_refused(tmp_path: Path) -> None:
    """A step outside the trace, an unknown suffix and a history of another shape are named."""
    with pytest.raises(BadParameter, match="step = 151"):
        figures.moment_figure(TRACE, 151, title="")
    with pytest.raises(BadParameter, match="steps"):
        figures.strip_figure(TRACE, [])
    with pytest.raises(BadParameter, match="out"):
        figures.save(every_figure()["plan"], tmp_path / "a.bmp")
    with pytest.raises(BadParameter, match="history of ants"):
        figures.convergence_figure({"ants": np.zeros((3, 2))})
    with pytest.raises(BadParameter, match="out"):
        write_animation(TRACE, tmp_path / "a.avi")
    for field, number in (("frames", 0), ("frames", 2.5), ("width", 0), ("width", "wide")):
        with pytest.raises(BadParameter, match=field):
            write_animation(TRACE, tmp_path / "a.gif", **{field: number})
    with pytest.raises(BadParameter, match="lengths"):
        colonies.sensitivity_figure("beta", [1, 2], np.empty((2, 0)))


def test_the_legend_of_a_motion_names_what_is_drawn_in_that_colour() -> None:
    """Blue are the robot's outlines; the motion has the colours of the bar beside it, and its time stands in the title."""
    names = [text.get_text() for text in every_figure()["motion"].legends[0].get_texts()]
    assert names == ["plan", "robot, at equal time steps"]
    assert every_figure()["motion"].axes[0].get_title(loc="left").startswith("Smoothed plan: ")


def test_what_cannot_be_written_is_one_error_with_its_field(tmp_path: Path) -> None:
    """A folder that does not exist, a name with a zero byte, and what is no path, by each writer."""
    away = tmp_path / "nofolder"
    for wrong in (away / "a.png", "a\0.png", 3):
        with pytest.raises(BadParameter, match=r"out = .*: must be a path"):
            figures.save(every_figure()["plan"], wrong)
    with pytest.raises(BadParameter, match=r"out = .*folder.*written to"):
        write_replay(TRACE, away / "a.html")
    with pytest.raises(BadParameter, match=r"out = .*folder.*written to"):
        write_animation(TRACE, away / "a.gif", frames=1)


def test_names_with_signs_of_formulas_are_drawn_as_they_are() -> None:
    """A reason with a dollar sign is no formula."""
    figures.moment_figure(sample_trace(30, 1, reason="costs $5 and $x^{$"), 12, title="Money").canvas.draw()


def test_titles_and_rows_with_signs_of_formulas_are_drawn_as_they_are() -> None:
    """Names of scenarios, instances, stops, policies and levels with dollar signs are no formulas, not even wrong ones."""
    name = r"$\frac$ of $5_ and \$6^"
    stops = (Stop((4.0, 3.0), name),)
    grid = TRACE.task.grid
    five = Tsp([(0, 0), (0, 2), (2, 2), (2, 0), (1, 0)], name=name)
    rows = [Row("s", f"{name}-0", name, 0, "1", f"x/{name}", "reached", "", 10.0, bound=10.0)]
    drawn = [
        figures.plan_figure(grid, shortest_path(), title=name),
        figures.moment_figure(TRACE, 40, title=name),
        figures.final_figure(TRACE, title=name),
        figures.tour_figure(five, solve_tsp(five, cycles=3)),
        rounds_figure(run(Scenario(World(grid), (1.0, 1.0), (1.0, 1.0), stops=stops), "follow").trace),
        plan_tour_figure(plan_tour(grid, (1.0, 1.0), [(4.0, 3.0)], names=[name], windows=[(0.0, 90.0)], seconds=0.1)),
        charts.success_figure(summarise(rows)),
        charts.time_ratio_figure(rows),
    ]
    for figure in drawn:
        figure.canvas.draw()
        texts = [text for text in figure.findobj(Text) if "frac" in text.get_text()]
        assert texts and all(text._preprocess_math(text.get_text())[0].count(name) == 1 for text in texts)
    assert pixels(replace(TRACE, scenario=name), 40).shape[2] == 3, "what is drawn outside the common style too"


def test_an_animation_shows_the_whole_episode(tmp_path: Path) -> None:
    """A GIF has at most as many frames as asked for, loops, and its first and last differ by more than the robot's place."""
    with Image.open(write_animation(TRACE, tmp_path / "a.gif", shortest=shortest_path(), frames=12, width=200)) as gif:
        assert gif.n_frames == 12 and gif.size[0] == 200 and gif.info["loop"] == 0
        first = np.asarray(gif.convert("RGB")).astype(int)
        gif.seek(11)
        last = np.asarray(gif.convert("RGB")).astype(int)
        assert (np.abs(first - last).sum(axis=2) > 60).sum() > 500
        rows, cols = TRACE.task.grid.shape
        strip = gif.height - round(200 * rows / cols) - CAPTION
        assert strip >= 3 * LEGEND and strip % LEGEND == 0, "what is drawn is named in as many lines as it takes"
        assert (first[-strip:] == last[-strip:]).all() and len(np.unique(first[-strip:].reshape(-1, 3), axis=0)) > 10


def test_an_episode_that_ends_at_its_start_is_a_film_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It has one frame of no duration, and the rate of an MP4 used to be one by that."""
    rates: list[float] = []
    monkeypatch.setattr(animation.shutil, "which", lambda name: name)
    monkeypatch.setattr(animation, "_write_mp4", lambda pictures, path, rate: rates.append(rate) or path.write_bytes(b"film"))
    result = run(Scenario(World(Grid(np.zeros((10, 10), bool))), (5.0, 5.0), (5.1, 5.0)))
    assert result.reached and result.trace is not None and len(result.trace) == 0
    for name in ("a.mp4", "a.gif"):
        assert write_animation(result.trace, tmp_path / name, width=100).stat().st_size > 0
    assert rates == [50.0]


def test_the_encounter_is_found() -> None:
    """The moments worth a picture are in the encounter, and without one at the closest approach."""
    meet, midst = figures.moments(TRACE)
    assert 50 <= meet < 100 and midst == min(meet + 15, 99) and TRACE.decision_at(midst).action == "avoid"
    calm = sample_trace(150, 1)
    object.__setattr__(calm, "decisions", calm.decisions[:1])
    meet, midst = figures.moments(calm)
    gaps = np.hypot(*(calm.obstacle_xy[:, 0] - calm.xy).T)
    assert gaps[midst] == gaps.min() and meet <= midst
    assert figures.moments(sample_trace(1, 0)) == (0, 0)


def test_a_tour_over_the_date_line_stays_on_its_map() -> None:
    """Its leg there is drawn at both sides of the map, not across it."""
    places = [(0.0, 170.0), (5.0, -170.0), (-5.0, -160.0), (-5.0, 160.0)]
    instance = Tsp(places, metric="GEO")
    axes = figures.tour_figure(instance, solve_tsp(instance, cycles=2)).axes[0]
    low, high = axes.get_xlim()
    assert -190.0 < low < -170.0 and 170.0 < high < 190.0
    legs = [np.abs(np.diff(line.get_xdata())).max() for line in axes.lines if line.get_linestyle() == "-"]
    assert len(legs) == 3 and max(legs) < 60.0


def test_every_colony_is_drawn_or_all_are_refused() -> None:
    """Six colonies have six looks and six entries; a seventh is refused, not left out."""
    fig = figures.convergence_figure({f"colony {k}": HISTORY + k for k in range(6)})
    assert len(fig.axes[0].lines) == 12 and len(fig.legends[0].get_texts()) == 12
    assert len({(line.get_color(), line.get_linestyle()) for line in fig.axes[1].lines}) == 6
    with pytest.raises(BadParameter, match=r"histories.*at most 6 colonies"):
        figures.convergence_figure({f"colony {k}": HISTORY for k in range(7)})


def test_the_legend_of_a_strip_names_what_is_in_any_panel() -> None:
    """What the last panel does not show, such as a prediction, is named as well, once."""
    fig = figures.strip_figure(TRACE, [70, 80, len(TRACE)], path=shortest_path())
    named = [text.get_text() for text in fig.legends[0].get_texts()]
    shown = {label for axes in fig.axes for label in axes.get_legend_handles_labels()[1]}
    assert shown == set(named) and len(named) == len(shown) and "chosen path" in named and "pheromone" in named


@pytest.mark.parametrize("dt", [0.1, 0.4, 3.0])
def test_marks_of_every_five_seconds_are_at_those_times(dt: float) -> None:
    """Each is at the first cycle that ends 5, 10, 15 ... s after the start or later."""
    scenario = Scenario(
        World(Grid(np.zeros((60, 60), bool))), (5.0, 5.0), (35.0, 5.0), RobotSpec(dt=dt, v_max=1.0), horizon=60.0
    )
    trace = run(scenario, "follow", horizon=21.0).trace
    (marks,) = (line for line in figures.final_figure(trace).axes[0].lines if line.get_label() == "every 5 s")
    at = [float(trace.t[np.abs(trace.xy - place).sum(axis=1).argmin()]) for place in marks.get_xydata()]
    assert len(at) == int(trace.t[-1] / 5 + 1e-9) >= 4
    assert all(-1e-6 <= time - 5 * (k + 1) < dt - 1e-6 for k, time in enumerate(at))


def test_the_legend_of_an_animation_names_what_it_shows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A policy that predicts nothing has no entry for it; rounds have one for their stops, which are drawn."""
    shown: list[str] = []
    monkeypatch.setattr(animation.ImageDraw.ImageDraw, "text", lambda draw, xy, text, **look: shown.append(text))
    bare = replace(TRACE, decisions=tuple((step, replace(one, predicted=None)) for step, one in TRACE.decisions))
    for trace, there in ((TRACE, True), (bare, False)):
        shown.clear()
        animation._legend([trace], False, 480)
        assert ("predicted" in shown) is there and "stop" not in shown
    scenario = Scenario(World(Grid(np.zeros((12, 12), bool))), (1.5, 1.5), (10.5, 10.5), stops=(Stop((6.5, 1.5)),))
    trace = run(scenario, "follow", horizon=0.3).trace
    shown.clear()
    animation._legend([trace], False, 480)
    assert "stop" in shown
    picture = np.asarray(animation.last_moment(trace, 240)).astype(int)
    orange = np.abs(picture - [int(ORANGE[k : k + 2], 16) for k in (1, 3, 5)]).max(axis=2) < 60
    rows, cols = np.nonzero(orange[100:])  # below the legend
    assert len(rows) > 10 and np.abs([cols.mean() - 130, rows.mean() + 100 - 210]).max() < 3


def test_a_policy_without_episodes_on_the_levels_shown_is_named_without_bars() -> None:
    """Its rows over all levels are left out, and it is no error."""
    rows = summarise(ROWS)
    table = [row for row in rows if row.policy != "stop" or not row.level]
    if all(row.level for row in table):
        table.append(replace(next(row for row in rows if row.policy == "stop"), level=""))
    assert "stop" in [text.get_text() for text in charts.success_figure(table).legends[0].get_texts()]


def test_a_colony_without_a_history_is_refused() -> None:
    """Three cities need no search, so their tour has no history to draw."""
    with pytest.raises(BadParameter, match="history of three"):
        colonies.seeds_figure({"three": [solve_tsp(Tsp(np.eye(3, 2)), cycles=1).history]})
