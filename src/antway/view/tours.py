"""The figure of a tour: where each robot drives on the map, and below it when it is where."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from antway.grid import Grid
from antway.tours.plan import Route, TourPlan
from antway.view import style

COLOURS = (style.BLUE, style.ORANGE, style.TEAL, "#AA3377", "#997700", style.CYAN)
MOST_NUMBERED = 60  # stops that are numbered on the map; more are dots
MOST_LISTED = 40  # stops that the schedule has a row for


@style.styled
def plan_tour_figure(tour: TourPlan, *, title: str = "") -> Figure:
    """Draw a tour on its map, stops numbered in the order of their visits, and, where there are windows, its schedule.

    Parameters
    ----------
    tour : TourPlan
        Of at most 40 stops for a schedule, 60 for numbers.
    title : str
        By default what the tour costs.
    """
    task = tour.task
    visits = sum(len(route.order) for route in tour.routes)
    timed = bool(
        np.isfinite(task.windows).any(axis=1).any() and ((task.windows[:, 0] > 0) | np.isfinite(task.windows[:, 1])).any()
    )
    scheduled = (timed or task.priorities is not None or math.isfinite(task.deadline)) and visits <= MOST_LISTED
    low, high = shown_part(task.grid)
    width, height = style.box_size(low.tolist(), high.tolist(), width=7.2, extra=1.5)
    rows = visits + len(tour.routes) * (len(tour.routes) > 1)
    below = 0.75 + 0.19 * rows if scheduled else 0.0
    fig = style.figure(max(width, 6.4) if scheduled else width, height + below)
    if scheduled:
        axes, times = fig.subplots(2, 1, height_ratios=(height - 1.0, below))
        _draw_schedule(times, tour)
    else:
        axes = fig.subplots()
    style.draw_map(axes, task.grid)
    style.show_box(axes, task.grid, low.tolist(), high.tolist())
    for k, route in enumerate(tour.routes):
        _draw_route(axes, tour, route, k)
    _draw_stops(axes, tour, visits, 72 * (width - 0.8) / float(high[0] - low[0]))
    axes.set_title(title or _title(tour))
    handles, labels = axes.get_legend_handles_labels()
    if scheduled:
        more: list[tuple[Artist, str]] = [
            *([(Patch(facecolor=style.RULE, edgecolor="#9AA3AD", linewidth=0.6), "window")] if timed else []),
            (Line2D([], [], color=style.INK, linewidth=4.2, solid_capstyle="butt"), "service"),
        ]
        if any((route.waiting > 0).any() for route in tour.routes):
            more.insert(int(timed), (Line2D([], [], color="#9AA3AD", linewidth=1.4, linestyle=(0, (1.2, 1.2))), "waits"))
        if tour.lateness > 0:
            more.append((Line2D([], [], color=style.RED, marker="D", linestyle="", markersize=5), "late"))
        handles, labels = [*handles, *(h for h, _ in more)], [*labels, *(label for _, label in more)]
    fig.legend(handles, labels, loc="outside lower center", ncols=min(4, max(1, len(labels))))
    return fig


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


def _title(tour: TourPlan) -> str:
    visited = len(tour.task.stops) - len(tour.skipped)
    of = f" of {len(tour.task.stops)}" if tour.skipped else ""
    late = f", {tour.lateness:,.0f} s late" if tour.lateness > 0 else ""
    plural = "s" if visited != 1 else ""
    fleet = f" by {len(tour.routes)} robots" if len(tour.routes) > 1 else ""
    return f"Tour of {visited}{of} stop{plural}{fleet}: {tour.length:,.1f} m in {tour.duration:,.0f} s{late}"


def _draw_route(axes: Axes, tour: TourPlan, route: Route, k: int) -> None:
    """Draw where one robot drives, with arrows in the direction of travel."""
    if not route.legs:
        return
    colour, several = COLOURS[k % len(COLOURS)], len(tour.routes) > 1
    label = f"robot {k + 1}: {route.length:,.1f} m in {route.duration:,.0f} s" if several else "path"
    wide = 1.8 if len(route.order) <= MOST_NUMBERED else 1.1
    legs = [plan.xy(tour.task.grid) for plan in route.legs]
    axes.plot(*np.vstack(legs).T, color=colour, linewidth=wide, path_effects=style.casing(wide), label=label, zorder=3)
    span = max(np.ptp(np.asarray(axes.get_xlim())), np.ptp(np.asarray(axes.get_ylim())))
    for xy in legs:
        placed = _middle(xy)
        if placed is None or np.hypot(*np.diff(xy, axis=0).T).sum() < 0.06 * span:
            continue
        (x, y), (dx, dy) = placed
        size = 0.004 * span
        look: dict[str, Any] = {"arrowstyle": "-|>,head_length=0.42,head_width=0.24", "color": colour, "linewidth": wide}
        axes.annotate("", (x + size * dx, y + size * dy), (x - size * dx, y - size * dy), arrowprops=look, zorder=3.2)


def _middle(xy: NDArray[np.float64]) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return the point half way along a polyline, and the direction there."""
    steps = np.diff(xy, axis=0)
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*steps.T))))
    if len(steps) == 0 or along[-1] == 0:
        return None
    half = along[-1] / 2
    i = int(np.clip(np.searchsorted(along, half, side="right") - 1, 0, len(steps) - 1))
    length = along[i + 1] - along[i]
    point = xy[i] + steps[i] * (half - along[i]) / length
    return (float(point[0]), float(point[1])), (float(steps[i, 0] / length), float(steps[i, 1] / length))


def _draw_stops(axes: Axes, tour: TourPlan, visits: int, points_per_metre: float) -> None:
    """Draw the stops, numbered in the order of the visits; numbers that would lie over each other stand beside their stops."""
    task, numbered = tour.task, visits <= MOST_NUMBERED
    size = 11.5 if visits <= 25 else 9.0
    look: dict[str, Any] = {"linestyle": "", "clip_on": False}
    shown = [
        (stop, n, style.RED if _late(tour, route, n) > 0 else COLOURS[k % len(COLOURS)])
        for k, route in enumerate(tour.routes)
        for n, stop in enumerate(route.order.tolist())
    ]
    true = task.stops[[stop for stop, _, _ in shown]].reshape(-1, 2)
    ends = np.array([task.start] + ([task.end] if isinstance(task.end, tuple) else []))
    placed = apart(true, ends, (size + 1.5) / points_per_metre) if numbered else true
    for (_, n, colour), (x, y), (u, v) in zip(shown, true, placed):
        if not numbered or math.hypot(u - x, v - y) * points_per_metre > 1.5:
            axes.plot([x, u], [y, v], color=colour, linewidth=0.8, zorder=4.6)
            axes.plot(
                x, y, marker="o", color=colour, markersize=3.2, markeredgecolor="white", markeredgewidth=0.5, zorder=4.7, **look
            )
        if numbered:
            edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 1.0}
            axes.plot(u, v, marker="o", color=colour, markersize=size, zorder=5, **edge, **look)
            words: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 0.58 * size, "weight": "bold"}
            axes.annotate(str(n + 1), (u, v), color="white", zorder=6, **words)
    if tour.skipped:
        xy = task.stops[list(tour.skipped)]
        axes.plot(*xy.T, marker="x", color=style.INK, markersize=5.5, markeredgewidth=1.2, zorder=4.8, label="left out", **look)
    place = "start" if task.end != "start" else "start and end"
    look |= {"markeredgecolor": style.INK, "zorder": 5.8}
    axes.plot(*task.start, marker="s", color="white", markersize=8, markeredgewidth=1.6, label=place, **look)
    if isinstance(task.end, tuple):
        axes.plot(*task.end, marker="*", color="#FFD23F", markersize=13, markeredgewidth=0.9, label="end", **look)


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


def _late(tour: TourPlan, route: Route, n: int) -> float:
    """Return by how much service begins after the window of the robot's n-th stop, s."""
    excess = route.arrival[n] + route.waiting[n] - tour.task.windows[int(route.order[n]), 1]
    return float(excess) if excess > 1e-9 * (1.0 + route.duration) else 0.0


def _draw_schedule(axes: Axes, tour: TourPlan) -> None:
    """Draw for each stop its window, and when the robot arrives, waits and serves, one row a stop."""
    task, row, ticks, labels = tour.task, 0, [], []
    last = max(1e-9, tour.duration, *(w for w in task.windows[:, 1].tolist() if math.isfinite(w)), 0.0)
    last = min(last, 1.6 * max(tour.duration, 1e-9))
    for k, route in enumerate(tour.routes):
        colour = COLOURS[k % len(COLOURS)]
        if len(tour.routes) > 1:
            axes.text(0.0, row, f"robot {k + 1}", va="center", color=colour, weight="bold", fontsize=7.5)
            ticks.append(row)
            labels.append("")
            row += 1
        before = 0.0
        for n, stop in enumerate(route.order.tolist()):
            earliest, latest = task.windows[stop].tolist()
            if earliest > 0 or math.isfinite(latest):
                end = min(latest, 1.02 * last)
                axes.barh(
                    row,
                    end - earliest,
                    left=earliest,
                    height=0.72,
                    facecolor=style.RULE,
                    edgecolor="#9AA3AD",
                    linewidth=0.6,
                    zorder=1,
                )
            arrival, waiting = float(route.arrival[n]), float(route.waiting[n])
            late = _late(tour, route, n) > 0
            axes.plot([before, arrival], [row, row], color=colour, linewidth=1.1, zorder=2)
            axes.plot(
                [arrival, arrival + waiting], [row, row], color="#9AA3AD", linewidth=1.4, linestyle=(0, (1.2, 1.2)), zorder=2
            )
            start = arrival + waiting
            axes.plot(
                [start, start + task.service[stop]], [row, row], color=style.INK, linewidth=4.2, solid_capstyle="butt", zorder=3
            )
            axes.plot(
                arrival,
                row,
                marker="D" if late else "o",
                color=style.RED if late else colour,
                markersize=5 if late else 4.2,
                zorder=4,
            )
            before = start + float(task.service[stop])
            ticks.append(row)
            labels.append(f"{task.names[stop]}  {n + 1}")
            row += 1
    if math.isfinite(task.deadline) and task.deadline <= 1.6 * last:
        axes.axvline(task.deadline, color=style.INK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
        axes.text(task.deadline, -0.9, "deadline ", ha="right", va="center", fontsize=7)
    axes.set_yticks(ticks, labels, fontsize=7.5)
    axes.tick_params(axis="y", length=0)
    axes.set(xlabel="time (s)", ylim=(row - 0.4, -1.3 if math.isfinite(task.deadline) else -0.6))
    axes.set_xlim(0, 1.03 * max(last, task.deadline if task.deadline <= 1.6 * last else 0.0))
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_title("Schedule")
