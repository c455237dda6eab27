"""The common style of pictures: colours for colour-blind people, sizes, and the map as a background."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, Literal, ParamSpec, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patheffects import Normal, Stroke
from matplotlib.transforms import Affine2D
from numpy.typing import ArrayLike

from antway.grid import Grid
from antway.writing import PICTURES, writing

P = ParamSpec("P")
R = TypeVar("R")

# Tol's "vibrant" scheme, which is safe for common kinds of colour blindness; red is reserved for moving obstacles.
BLUE, CYAN, TEAL, ORANGE, RED = "#0077BB", "#33BBEE", "#009988", "#EE7733", "#CC3311"
INK, WALL, UNKNOWN, RULE = "#1B1F24", "#454B54", "#D3D7DC", "#E3E6EA"
GOLD, VIOLET = "#FFD23F", "#5E3C99"  # goals, and the outline of pheromone
PURPLE, OCHRE, GREY = "#AA3377", "#997700", "#9AA3AD"  # further paths, and waiting in schedules
COLOURS = (BLUE, ORANGE, TEAL, PURPLE, OCHRE, CYAN)  # of paths, colonies and policies, one after another
DASHES: tuple[Any, ...] = ("-", "--", "-.", ":", (0, (5, 1, 1, 1, 1, 1)), (0, (1, 3)))  # of their lines
_VIOLET = [(0.45, 0.25, 0.65, 0.0), (0.45, 0.25, 0.65, 0.55), (0.25, 0.05, 0.45, 0.95)]
PHEROMONE = LinearSegmentedColormap.from_list("pheromone", _VIOLET)

_STYLE: dict[str, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.edgecolor": INK,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.unicode_minus": True,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.solid_capstyle": "round",
    "lines.solid_joinstyle": "round",
    "savefig.facecolor": "white",
    "svg.fonttype": "none",
    "svg.hashsalt": "antway",
    "pdf.fonttype": 42,
}


def styled(draw: Callable[P, R]) -> Callable[P, R]:
    """Run `draw` in the common style, and restore Matplotlib's settings."""

    @wraps(draw)
    def inside(*args: P.args, **kwargs: P.kwargs) -> R:
        with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
            return draw(*args, **kwargs)

    return inside


def figure(width: float, height: float) -> Figure:
    """Return an empty figure of `width` x `height` inches with its own Agg canvas."""
    result = Figure(figsize=(width, height), dpi=160, layout="constrained")
    result.get_layout_engine().set(w_pad=0.08, h_pad=0.08)  # type: ignore[call-arg, union-attr]
    FigureCanvasAgg(result)
    return result


@styled
def save(fig: Figure, path: str | Path) -> Path:
    """Write `fig` to `path`, whose suffix is .png, .svg or .pdf; the same figure gives the same bytes.

    Raises
    ------
    BadParameter
        For another suffix, or if the file cannot be written.
    """
    dateless = {".png": {"Software": "antway"}, ".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    with writing("out", path, PICTURES) as file:
        kind = file.suffix.lower()
        fig.savefig(file, format=kind[1:], metadata=dateless[kind], bbox_inches="tight", pad_inches=0.12)
    return file


@styled
def svg(fig: Figure) -> str:
    """Return `fig` as an SVG element for a page: transparent, and without styles that a page's policy forbids."""
    file = io.StringIO()
    fig.savefig(file, format="svg", metadata={"Date": None}, transparent=True)
    text = file.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>|<style.*?</style>", "", text[text.index("<svg ") :], flags=re.DOTALL)
    text = re.sub(r'<g id="[^"]*"', "<g", text)  # figures on one page would share these names

    def attributes(found: re.Match[str]) -> str:
        pairs = (pair.split(":", 1) for pair in found[1].split(";") if ":" in pair)
        return " ".join(f'{name.strip()}="{value.strip()}"' for name, value in pairs)

    text = re.sub(r'style="([^"]*)"', attributes, text)
    return re.sub(r'<svg [^>]*?viewBox="([^"]*)"[^>]*>', r'<svg viewBox="\1" stroke-linejoin="round">', text, count=1)


def plain(text: str) -> str:
    """Return a text such that Matplotlib shows it as it is, and no part of it as a formula."""
    return text.replace("$", r"\$")


def map_size(grid: Grid, *, width: float = 6.4, extra: float = 1.35) -> tuple[float, float]:
    """Return the size in inches of a figure that shows `grid` undistorted with room for title and legend."""
    low, high = grid.bounds().tolist()
    return box_size(low, high, width=width, extra=extra)


def box_size(low: Sequence[float], high: Sequence[float], *, width: float, extra: float) -> tuple[float, float]:
    """Return the size in inches of a figure that shows the box from `low` to `high`, (x, y) in m, undistorted."""
    ratio = float((high[1] - low[1]) / (high[0] - low[0]))
    height = (width - 0.8) * ratio
    if height > 6.4:
        width, height = max(5.2, 6.4 / ratio + 0.8), 6.4
    return width, max(height, 1.2) + extra


class _Cells(AxesImage):
    """The cells of a map; where several share a pixel, it shows a wall if one of them is one."""

    def __init__(self, axes: Axes, grid: Grid) -> None:
        super().__init__(axes, origin="lower", interpolation="nearest", zorder=0)
        self.shade, self.resolution = np.zeros(grid.shape, dtype=np.uint8), grid.resolution
        self.shade[grid.blocked] = 2
        if grid.unknown is not None:
            self.shade[grid.unknown] = 1
        self.merge(1)

    def merge(self, block: int) -> None:
        """Show `block` x `block` cells as one."""
        rows, cols = (-(-cells // block) for cells in self.shade.shape)
        whole = np.zeros((rows * block, cols * block), dtype=np.uint8)
        whole[: self.shade.shape[0], : self.shade.shape[1]] = self.shade
        colours = np.array([mpl.colors.to_rgb(c) for c in ("white", UNKNOWN, WALL)])
        self.set_data((colours[whole.reshape(rows, block, cols, block).max(axis=(1, 3))] * 255).astype(np.uint8))
        self.set_extent((0, whole.shape[1] * self.resolution, 0, whole.shape[0] * self.resolution))

    def make_image(self, renderer: Any, magnification: float = 1.0, unsampled: bool = False) -> Any:
        size = np.abs([np.ptp(self.axes.get_xlim()), np.ptp(self.axes.get_ylim())]) / self.resolution
        self.merge(max(1, math.ceil((size / (np.array(self.axes.bbox.size) * magnification)).max() - 1e-6)))
        return super().make_image(renderer, magnification, unsampled)


def draw_map(axes: Axes, grid: Grid) -> None:
    """Draw walls dark, unknown cells light grey, free ones white, in metres; cell lines if there are at most 50 a side."""
    rows, cols = grid.shape
    size = (cols * grid.resolution, rows * grid.resolution)
    x, y, yaw = grid.origin
    place = Affine2D().rotate(yaw).translate(x, y) + axes.transData
    cells = _Cells(axes, grid)
    cells.set_transform(place)
    cells.set_clip_path(axes.patch)
    axes.add_image(cells)
    if max(rows, cols) <= 50:
        lines: dict[str, Any] = {"color": RULE, "linewidth": 0.5, "zorder": 0.5, "transform": place}
        for k in range(1, cols):
            axes.plot([k * grid.resolution] * 2, [0, size[1]], **lines)
        for k in range(1, rows):
            axes.plot([0, size[0]], [k * grid.resolution] * 2, **lines)
    low, high = grid.bounds().tolist()
    axes.set(xlabel="x (m)", ylabel="y (m)", aspect="equal")
    show_box(axes, grid, low, high)
    shape = (high[1] - low[1]) / (high[0] - low[0])
    ticks: tuple[tuple[Literal["x", "y"], float], ...] = (("x", 5.6 / max(1.0, shape)), ("y", 5.6 * min(1.0, shape)))
    for axis, inches in ticks:
        axes.locator_params(axis, nbins=max(1, min(8, int(2.2 * inches))), steps=[1, 2, 5, 10])


def show_box(axes: Axes, grid: Grid, low: Sequence[float], high: Sequence[float]) -> None:
    """Show the part of a map from `low` to `high`, (x, y) in m, with row 0 on top for `Grid.top_first`."""
    axes.set(xlim=(low[0], high[0]), ylim=(high[1], low[1]) if grid.top_first else (low[1], high[1]))


def casing(width: float) -> list[Any]:
    """Return path effects that draw a white edge around a line of `width` points, so that it is visible everywhere."""
    return [Stroke(linewidth=width + 1.6, foreground="white"), Normal()]


def draw_path(axes: Axes, xy: ArrayLike, colour: str, width: float, *, label: str | None = None, zorder: float = 3) -> None:
    """Draw a polyline, float[N, 2], as a line of `width` points with a white edge."""
    axes.plot(*np.asarray(xy).T, color=colour, linewidth=width, path_effects=casing(width), label=label, zorder=zorder)


def graph(axes: Axes, *, below: bool = False) -> None:
    """Give the axes of a graph grid lines, `below` everything else or not, and no frame at the top and on the right."""
    axes.grid(color=RULE, linewidth=0.6)
    if below:
        axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def legend_below(axes: Axes, columns: int = 4, more: Sequence[tuple[Artist, str]] = ()) -> Figure:
    """Put the legend under the axes, where it covers nothing, with entries `more` at its end; return the figure."""
    fig = axes.get_figure(root=True)
    assert fig is not None
    handles, labels = axes.get_legend_handles_labels()
    handles, labels = [*handles, *(handle for handle, _ in more)], [*labels, *(label for _, label in more)]
    fig.legend(handles, labels, loc="outside lower center", ncols=min(columns, max(1, len(labels))))
    return fig
