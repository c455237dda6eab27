"""What the figures of tours and of rounds share: a map above a schedule, numbered stops, and rows with times."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from antway.grid import Grid
from antway.view import style
from antway.world.policy import XY

_WAITING = (0, (1.2, 1.2))  # points; dots of the line of a robot that waits
_MOVED = 1.5  # points; a line joins a number that was moved farther to its stop


def map_and_schedule(grid: Grid, rows: int | None, *, width: float) -> tuple[Axes, Axes | None, float]:
    """Return the map of `grid` and the schedule of `rows` rows (None: none) in a new figure, and the map's points per metre.

    The figure is about `width` inches wide.
    """
    low, high = (corner.tolist() for corner in shown_part(grid))
    width, height = style.box_size(low, high, width=width, extra=1.5)
    if rows is None:
        axes, times = style.figure(width, height).subplots(), None
    else:
        below = 0.75 + 0.19 * rows
        axes, times = style.figure(max(width, 6.4), height + below).subplots(2, 1, height_ratios=(height - 1.0, below))
    style.draw_map(axes, grid)
    style.show_box(axes, grid, low, high)
    return axes, times, 72 * (width - 0.8) / (high[0] - low[0])


def shown_part(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two corners in m of what is drawn: the known part of the map and a margin."""
    known = np.ones(grid.shape, dtype=bool) if grid.unknown is None else ~grid.unknown
    rows, cols = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    if not len(rows):
        rows, cols = np.arange(grid.shape[0]), np.arange(grid.shape[1])
    edge = 0.03 * max(np.ptp(rows), np.ptp(cols))
    ends = [
        (min(max(row + side * edge, -0.5), grid.shape[0] - 0.5), min(max(col + turn * edge, -0.5), grid.shape[1] - 0.5))
        for row, side in ((rows[0], -1), (rows[-1], 1))
        for col, turn in ((cols[0], -1), (cols[-1], 1))
    ]
    xy = grid.to_xy(ends)
    return xy.min(axis=0), xy.max(axis=0)


def number_size(stops: int) -> float:
    """Return the diameter of the discs that number so many stops, points."""
    return 11.5 if stops <= 25 else 9.0


def was_moved(stop: Sequence[float], placed: Sequence[float], points_per_metre: float) -> bool:
    """Tell whether the number of a stop stands beside it, so that a line has to join them."""
    return math.dist(stop, placed) * points_per_metre > _MOVED


def draw_leader(axes: Axes, stop: Sequence[float], placed: Sequence[float], colour: str) -> None:
    """Draw a line from a stop to its number."""
    axes.plot(*zip(stop, placed), color=colour, linewidth=0.8, zorder=4.6)


def draw_number(axes: Axes, number: int, placed: Sequence[float], colour: str, size: float, *, clip_on: bool) -> None:
    """Draw the number of a stop in a disc of `size` points at `placed`."""
    edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 1.0, "clip_on": clip_on}
    axes.plot(*placed, "o", color=colour, markersize=size, zorder=5, **edge)
    font: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 0.58 * size, "weight": "bold"}
    axes.annotate(str(number), (placed[0], placed[1]), color="white", zorder=6, **font)


def draw_ends(axes: Axes, start: XY, end: XY | None, *, returns: bool, clip_on: bool) -> None:
    """Draw a square at the start, m, and a star at the end, if it is another place; `returns`: the start is the end, too."""
    look: dict[str, Any] = {"linestyle": "", "markeredgecolor": style.INK, "clip_on": clip_on, "zorder": 5.8}
    label = "start and end" if returns else "start"
    axes.plot(*start, marker="s", color="white", markersize=8, markeredgewidth=1.6, label=label, **look)
    if end is not None:
        axes.plot(*end, marker="*", color=style.GOLD, markersize=13, markeredgewidth=0.9, label="end", **look)


def apart(xy: NDArray[np.float64], fixed: NDArray[np.float64], least: float) -> NDArray[np.float64]:
    """Move points apart until no two, and none and a fixed one, are nearer than `least`, each as little as that needs."""
    placed, still = xy.copy(), len(fixed)
    for _ in range(60):
        everything = np.vstack((fixed, placed))
        away = everything[:, None] - everything[None]
        gap = np.hypot(away[..., 0], away[..., 1])
        np.fill_diagonal(gap, np.inf)
        close = gap < least
        if not close[still:].any():
            break
        turn = np.arange(len(everything)) * 2.4  # where two lie in one place they part in directions of their own
        unit = np.where(
            gap[..., None] > 1e-9, away / np.maximum(gap, 1e-9)[..., None], np.stack((np.cos(turn), np.sin(turn)), -1)
        )
        push = np.where(close, 0.55 * (least - np.minimum(gap, least)), 0.0)[..., None] * unit
        placed += push[still:].sum(axis=1)
    return placed


def draw_window(axes: Axes, row: int, window: tuple[float, float], last: float) -> None:
    """Draw the time window of a stop, s, up to `last` s; nothing for a stop that is always open."""
    earliest, latest = window
    if earliest > 0 or math.isfinite(latest):
        look: dict[str, Any] = {"facecolor": style.RULE, "edgecolor": style.GREY, "linewidth": 0.6, "zorder": 1}
        axes.barh(row, min(latest, last) - earliest, left=earliest, height=0.72, **look)


def draw_visit(axes: Axes, row: int, times: Sequence[float], colour: str, *, late: bool, size: float) -> None:
    """Draw a visit in its row: the robot sets out, arrives, begins service, and ends it at these four `times`, s."""
    out, arrival, start, end = times
    axes.plot([out, arrival], [row, row], color=colour, linewidth=1.1, zorder=2)
    axes.plot([arrival, start], [row, row], color=style.GREY, linewidth=1.4, linestyle=_WAITING, zorder=2)
    axes.plot([start, end], [row, row], color=style.INK, linewidth=4.2, solid_capstyle="butt", zorder=3)
    axes.plot(arrival, row, marker="D" if late else "o", color=style.RED if late else colour, markersize=size, zorder=4)


def finish_schedule(axes: Axes, labels: Sequence[str]) -> None:
    """Name the rows of a schedule, and remove its frame but for the axis of time."""
    axes.set_yticks(range(len(labels)), [style.plain(label) for label in labels], fontsize=7.5)
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)


def schedule_legend() -> dict[str, Artist]:
    """Return the entries of a schedule's legend by name."""
    return {
        "window": Patch(facecolor=style.RULE, edgecolor=style.GREY, linewidth=0.6),
        "waits": Line2D([], [], color=style.GREY, linewidth=1.4, linestyle=_WAITING),
        "service": Line2D([], [], color=style.INK, linewidth=4.2, solid_capstyle="butt"),
        "late": Line2D([], [], color=style.RED, marker="D", linestyle="", markersize=5),
        "new order": Line2D([], [], color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2))),
    }
