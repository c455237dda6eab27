"""Records in notebooks: pictures with text, replay pages in a frame, tables as data frames."""

from __future__ import annotations

import base64
import html as markup
import importlib
import io
import sys
import tempfile
import webbrowser
from collections.abc import Iterable
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid
from antway.planning import Plan
from antway.tours.plan import TourPlan
from antway.view import figures, style, tours
from antway.world.episode import EpisodeResult
from antway.world.trace import Trace


class Page:
    """HTML that a notebook shows.

    Examples
    --------
    >>> Page("<b>so</b>")._repr_html_()
    '<b>so</b>'
    """

    def __init__(self, text: str) -> None:
        self.text = text

    def _repr_html_(self) -> str:
        return self.text


@style.styled
def grid_figure(grid: Grid) -> Figure:
    """Draw a map."""
    fig = style.figure(*style.map_size(grid, extra=0.8))
    style.draw_map(fig.subplots(), grid)
    return fig


def figure_of(record: object, grid: Grid | None = None) -> Figure | None:
    """Return the picture of a record, or None for an episode without a trace."""
    if isinstance(record, Grid):
        return grid_figure(record)
    if isinstance(record, Plan):
        place = record.grid if grid is None else checks.instance("grid", grid, Grid)
        if place is None:
            raise BadParameter("grid", None, "given: this plan does not know its map")
        return figures.plan_figure(place, record)
    if isinstance(record, TourPlan):
        return tours.plan_tour_figure(record)
    trace = record.trace if isinstance(record, EpisodeResult) else record
    if trace is None:
        return None
    return figures.final_figure(checks.instance("record", trace, Trace), title="Path driven")


def pixels(trace: Trace, step: int) -> NDArray[np.uint8]:
    """Return the picture of a moment of an episode, uint8[H, W, 3]."""
    fig = figures.moment_figure(trace, step, title=trace.scenario, caption="")
    fig.set_dpi(80)
    canvas: Any = FigureCanvasAgg(fig)
    canvas.draw()
    return np.ascontiguousarray(np.asarray(canvas.buffer_rgba())[..., :3])


def html(record: object) -> str:
    """Return the HTML of a record for a notebook: its text, and its picture if there is one."""
    words = f"<p><code>{markup.escape(repr(record))}</code></p>"
    if isinstance(record, Plan) and record.grid is None:
        return words
    fig = figure_of(record)
    if fig is None:
        return words
    buffer = io.BytesIO()
    fig.savefig(buffer, format="png", dpi=96, bbox_inches="tight")
    data = base64.b64encode(buffer.getvalue()).decode()
    return f'{words}<img alt="{markup.escape(repr(record))}" style="max-width:100%" src="data:image/png;base64,{data}">'


def show(record: object, *, height: int = 720, browser: bool = True) -> Page:
    """Show a record: an episode as a page that replays it, anything else as its picture.

    In a notebook the returned page shows itself; elsewhere it opens in the browser.

    Parameters
    ----------
    record : Grid, Plan, TourPlan, EpisodeResult or Trace
    height : int
        Height of the frame in a notebook, pixels.
    browser : bool
        Whether to open the browser outside notebooks.

    Raises
    ------
    BadParameter
        For anything else.

    Examples
    --------
    >>> show(Grid([[False, True]]), browser=False)._repr_html_().startswith("<p><code>Grid(1 x 2 cells")
    True
    """
    from antway.view.replay import replay_page

    height = checks.integer("height", height, low=100, high=10_000)
    if not isinstance(record, Grid | Plan | TourPlan | EpisodeResult | Trace):
        raise BadParameter("record", record, "a Grid, Plan, TourPlan, EpisodeResult or Trace")
    trace = record.trace if isinstance(record, EpisodeResult) else record
    page = replay_page(trace) if isinstance(trace, Trace) else html(record)
    if "ipykernel" in sys.modules:
        if isinstance(trace, Trace):
            page = f'<iframe style="width:100%;height:{height}px;border:0" srcdoc="{markup.escape(page)}"></iframe>'
    elif checks.instance("browser", browser, bool):
        file = Path(tempfile.mkdtemp(prefix="antway-")) / "antway.html"
        file.write_text(page, encoding="utf-8")
        webbrowser.open(file.as_uri())
    return Page(page)


def to_dataframe(table: object) -> Any:
    """Return a table as a pandas DataFrame.

    Parameters
    ----------
    table : EpisodeResult, Trace, TourPlan, Plan, or rows
        An episode has a row for each control step (t in s, x and y in m, vx and vy in m/s, heading in rad, cycle_ms), a tour
        for each visit, a plan for each cell, and results of the arena (`Results.rows()`, `summarise(rows)`) for each row.

    Raises
    ------
    BadParameter
        For anything else, for an episode without a trace, or if pandas is not installed.
    """
    records = _records(table)
    try:
        pandas = importlib.import_module("pandas")
    except ImportError:
        raise BadParameter("pandas", None, "installed: pip install pandas") from None
    return pandas.DataFrame(records)


def _records(table: object) -> dict[str, Any] | list[dict[str, Any]]:
    if isinstance(table, EpisodeResult):
        if table.trace is None:
            raise BadParameter("table", table, "an episode that was recorded (record=True)")
        table = table.trace
    if isinstance(table, Trace):
        n = len(table)
        columns: dict[str, Any] = {"t": table.t[:n], "x": table.xy[:n, 0], "y": table.xy[:n, 1], "vx": table.velocity[:n, 0]}
        return columns | {"vy": table.velocity[:n, 1], "heading": table.heading[:n], "cycle_ms": table.cycle_ms}
    if isinstance(table, Plan):
        cells = {"row": table.cells[:, 0], "col": table.cells[:, 1]}
        return cells if table.grid is None else cells | dict(zip("xy", table.grid.to_xy(table.cells).T))
    if isinstance(table, TourPlan):
        visits = [(k, route, n) for k, route in enumerate(table.routes) for n in range(len(route.order))]
        columns = {"robot": [k for k, _, _ in visits], "stop": [int(route.order[n]) for _, route, n in visits]}
        columns["name"] = [table.task.names[stop] for stop in columns["stop"]]
        columns |= {name: [getattr(route, name)[n] for _, route, n in visits] for name in ("arrival", "waiting")}
        return columns | {"leg": [route.legs[n].length for _, route, n in visits]}
    if isinstance(table, Iterable) and not isinstance(table, str | bytes | np.ndarray):
        rows = list(table)
        if all(is_dataclass(row) and not isinstance(row, type) for row in rows):
            return [asdict(row) for row in rows]
    raise BadParameter("table", table, "an episode, a trace, a tour, a plan, or rows of the arena")
