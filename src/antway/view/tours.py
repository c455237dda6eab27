"""The figure of a tour: where each robot drives on the map, and below it when it is where."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from antway.tours.plan import Route, TourPlan
from antway.view import stops, style

MOST_NUMBERED = 60  # stops that are numbered on the map; more are dots
MOST_LISTED = 40  # stops that the schedule has a row for


@style.styled
def plan_tour_figure(tour: TourPlan) -> Figure:
    """Draw a tour on its map, stops numbered in the order of their visits, and, where there are windows, its schedule.

    Parameters
    ----------
    tour : TourPlan
        Of at most 40 stops for a schedule, 60 for numbers.
    """
    task = tour.task
    visits = sum(len(route.order) for route in tour.routes)
    timed = bool((task.windows[:, 0] > 0).any() or np.isfinite(task.windows[:, 1]).any())
    scheduled = (timed or task.priorities is not None or math.isfinite(task.deadline)) and visits <= MOST_LISTED
    rows = visits + len(tour.routes) * (len(tour.routes) > 1)
    axes, times, points_per_metre = stops.map_and_schedule(task.grid, rows if scheduled else None, width=7.2)
    for k, route in enumerate(tour.routes):
        _draw_route(axes, tour, route, k)
    _draw_stops(axes, tour, visits, points_per_metre)
    axes.set_title(_title(tour))
    more: list[tuple[Artist, str]] = []
    if times is not None:
        _draw_schedule(times, tour)
        waits = any((route.waiting > 0).any() for route in tour.routes)
        shown = {"window": timed, "waits": waits, "service": True, "late": tour.lateness > 0}
        more = [(artist, name) for name, artist in stops.schedule_legend().items() if shown.get(name)]
    return style.legend_below(axes, more=more)


def _title(tour: TourPlan) -> str:
    visited = len(tour.task.stops) - len(tour.skipped)
    of = f" of {len(tour.task.stops)}" if tour.skipped else ""
    late = f", {tour.lateness:,.3g} s late" if tour.lateness > 0 else ""
    plural = "s" if len(tour.task.stops) != 1 else ""
    fleet = f" by {len(tour.routes)} robots" if len(tour.routes) > 1 else ""
    return f"Tour of {visited}{of} stop{plural}{fleet}: {tour.length:,.1f} m in {tour.duration:,.0f} s{late}"


def _draw_route(axes: Axes, tour: TourPlan, route: Route, k: int) -> None:
    """Draw where one robot drives, with arrows in the direction of travel."""
    if not route.legs:
        return
    colour, several = style.COLOURS[k % len(style.COLOURS)], len(tour.routes) > 1
    label = f"robot {k + 1}: {route.length:,.1f} m in {route.duration:,.0f} s" if several else "path"
    wide = 1.8 if len(route.order) <= MOST_NUMBERED else 1.1
    legs = [plan.xy(tour.task.grid) for plan in route.legs]
    style.draw_path(axes, np.vstack(legs), colour, wide, label=label)
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
    task, numbered, size = tour.task, visits <= MOST_NUMBERED, stops.number_size(visits)
    look: dict[str, Any] = {"linestyle": "", "clip_on": False}
    shown = [
        (stop, n, style.RED if _late(tour, route, n) > 0 else style.COLOURS[k % len(style.COLOURS)])
        for k, route in enumerate(tour.routes)
        for n, stop in enumerate(route.order.tolist())
    ]
    true = task.stops[[stop for stop, _, _ in shown]].reshape(-1, 2)
    end = task.end if isinstance(task.end, tuple) else None
    ends = np.array([task.start] + ([] if end is None else [end]))
    placed = stops.apart(true, ends, (size + 1.5) / points_per_metre) if numbered else true
    for (_, n, colour), stop, at in zip(shown, true.tolist(), placed.tolist()):
        if not numbered or stops.was_moved(stop, at, points_per_metre):
            stops.draw_leader(axes, stop, at, colour)
            edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.5}
            axes.plot(*stop, marker="o", color=colour, markersize=3.2, zorder=4.7, **edge, **look)
        if numbered:
            stops.draw_number(axes, n + 1, at, colour, size, clip_on=False)
    if tour.skipped:
        xy = task.stops[list(tour.skipped)]
        axes.plot(*xy.T, marker="x", color=style.INK, markersize=5.5, markeredgewidth=1.2, zorder=4.8, label="left out", **look)
    stops.draw_ends(axes, task.start, end, returns=task.end == "start", clip_on=False)


def _late(tour: TourPlan, route: Route, n: int) -> float:
    """Return by how much service begins after the window of the robot's n-th stop, s."""
    excess = route.arrival[n] + route.waiting[n] - tour.task.windows[int(route.order[n]), 1]
    return float(excess) if excess > 1e-9 * (1.0 + route.duration) else 0.0


def _draw_schedule(axes: Axes, tour: TourPlan) -> None:
    """Draw for each stop its window, and when the robot arrives, waits and serves, one row a stop."""
    task, labels = tour.task, list[str]()
    last = max(1e-9, tour.duration, *(w for w in task.windows[:, 1].tolist() if math.isfinite(w)))
    last = min(last, 1.6 * max(tour.duration, 1e-9))
    for k, route in enumerate(tour.routes):
        colour = style.COLOURS[k % len(style.COLOURS)]
        if len(tour.routes) > 1:
            axes.text(0.0, len(labels), f"robot {k + 1}", va="center", color=colour, weight="bold", fontsize=7.5)
            labels.append("")
        before = 0.0
        for n, stop in enumerate(route.order.tolist()):
            row = len(labels)
            stops.draw_window(axes, row, task.windows[stop].tolist(), 1.02 * last)
            arrival, late = float(route.arrival[n]), _late(tour, route, n) > 0
            start = arrival + float(route.waiting[n])
            end = start + float(task.service[stop])
            stops.draw_visit(axes, row, (before, arrival, start, end), colour, late=late, size=5 if late else 4.2)
            before = end
            labels.append(f"{task.names[stop]}  {n + 1}")
    if math.isfinite(task.deadline) and task.deadline <= 1.6 * last:
        axes.axvline(task.deadline, color=style.INK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
        axes.text(task.deadline, -0.9, "deadline ", ha="right", va="center", fontsize=7)
    stops.finish_schedule(axes, labels)
    axes.set(xlabel="time (s)", ylim=(len(labels) - 0.4, -1.3 if math.isfinite(task.deadline) else -0.6))
    axes.set_xlim(0, 1.03 * max(last, task.deadline if task.deadline <= 1.6 * last else 0.0))
    axes.set_title("Schedule")
