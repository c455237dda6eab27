"""Figures of tours and of rounds: the path from stop to stop on the map, and below it when the robot is where."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
from antway.world.policy import XY
from antway.world.stops import Rounds
from antway.world.trace import Trace

MOST_NUMBERED = 60  # stops that are numbered on the map; more are dots
MOST_LISTED = 40  # stops that the schedule has a row for
_WAITING = (0, (1.2, 1.2))  # points; dots of the line of a robot that waits
_MOVED = 1.5  # points; a line joins a number that was moved farther to its stop


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
    axes, times, points_per_metre = _map_and_schedule(task.grid, rows if scheduled else None, width=7.2)
    for k, route in enumerate(tour.routes):
        _draw_route(axes, tour, route, k)
    _draw_stops(axes, tour, visits, points_per_metre)
    axes.set_title(_title(tour))
    more: list[tuple[Artist, str]] = []
    if times is not None:
        _draw_schedule(times, tour)
        waits = any((route.waiting > 0).any() for route in tour.routes)
        shown = {"window": timed, "waits": waits, "service": True, "late": tour.lateness > 0}
        more = [(artist, name) for name, artist in _schedule_legend().items() if shown.get(name)]
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
    task, numbered, size = tour.task, visits <= MOST_NUMBERED, _number_size(visits)
    look: dict[str, Any] = {"linestyle": "", "clip_on": False}
    shown = [
        (stop, n, style.RED if _late(tour, route, n) > 0 else style.COLOURS[k % len(style.COLOURS)])
        for k, route in enumerate(tour.routes)
        for n, stop in enumerate(route.order.tolist())
    ]
    true = task.stops[[stop for stop, _, _ in shown]].reshape(-1, 2)
    end = task.end if isinstance(task.end, tuple) else None
    ends = np.array([task.start] + ([] if end is None else [end]))
    placed = _apart(true, ends, (size + 1.5) / points_per_metre) if numbered else true
    for (_, n, colour), stop, at in zip(shown, true.tolist(), placed.tolist()):
        if not numbered or _was_moved(stop, at, points_per_metre):
            _draw_leader(axes, stop, at, colour)
            edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.5}
            axes.plot(*stop, marker="o", color=colour, markersize=3.2, zorder=4.7, **edge, **look)
        if numbered:
            _draw_number(axes, n + 1, at, colour, size, clip_on=False)
    if tour.skipped:
        xy = task.stops[list(tour.skipped)]
        axes.plot(*xy.T, marker="x", color=style.INK, markersize=5.5, markeredgewidth=1.2, zorder=4.8, label="left out", **look)
    _draw_ends(axes, task.start, end, returns=task.end == "start", clip_on=False)


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
            _draw_window(axes, row, task.windows[stop].tolist(), 1.02 * last)
            arrival, late = float(route.arrival[n]), _late(tour, route, n) > 0
            start = arrival + float(route.waiting[n])
            end = start + float(task.service[stop])
            _draw_visit(axes, row, (before, arrival, start, end), colour, late=late, size=5 if late else 4.2)
            before = end
            labels.append(f"{task.names[stop]}  {n + 1}")
    if math.isfinite(task.deadline) and task.deadline <= 1.6 * last:
        axes.axvline(task.deadline, color=style.INK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
        axes.text(task.deadline, -0.9, "deadline ", ha="right", va="center", fontsize=7)
    _finish_schedule(axes, labels)
    axes.set(xlabel="time (s)", ylim=(len(labels) - 0.4, -1.3 if math.isfinite(task.deadline) else -0.6))
    axes.set_xlim(0, 1.03 * max(last, task.deadline if task.deadline <= 1.6 * last else 0.0))
    axes.set_title("Schedule")


@style.styled
def rounds_figure(trace: Trace) -> Figure:
    """Draw the rounds of an episode with stops: a map with the stops numbered by visit, and the times at each below it."""
    rounds = trace.rounds if trace.rounds is not None else Rounds(())
    axes, times, points_per_metre = _map_and_schedule(trace.task.grid, max(1, len(rounds.stops)), width=7.6)
    assert times is not None
    for k in range(len(trace.obstacle_id)):
        label = "tracks of what moves" if k == 0 else None
        axes.plot(*trace.obstacle_xy[:, k].T, color=style.RED, linewidth=0.7, alpha=0.45, label=label, zorder=2)
    style.draw_path(axes, trace.xy, style.BLUE, 1.6, label="driven")
    _draw_visits(axes, trace, rounds, points_per_metre)
    late = sum(rounds.lateness(visit) > 0 for visit in rounds.visits)
    verdict = f"{late} of them late" if late else "all in time"
    axes.set_title(f"Rounds: {len(rounds.visits)} of {len(rounds.stops)} stops in {trace.t[-1]:,.0f} s, {verdict}")
    _draw_times(times, trace, rounds)
    shown = ["window", "waits", "service"] + ["new order"] * any(turn.t > 0 for turn in rounds.turns)
    legend = _schedule_legend()
    return style.legend_below(axes, more=[(legend[name], name) for name in shown])


def _draw_visits(axes: Axes, trace: Trace, rounds: Rounds, points_per_metre: float) -> None:
    """Draw the stops, numbered in the order of the visits; those not visited are crosses."""
    size = _number_size(len(rounds.stops))
    true = np.array([rounds.stops[visit.stop].at for visit in rounds.visits]).reshape(-1, 2)
    ends = np.array([trace.task.start, trace.task.goal])
    placed = _apart(true, ends, (size + 1.5) / points_per_metre)
    for n, (visit, stop, at) in enumerate(zip(rounds.visits, true.tolist(), placed.tolist()), 1):
        colour = style.RED if rounds.lateness(visit) > 0 else style.BLUE
        if _was_moved(stop, at, points_per_metre):
            _draw_leader(axes, stop, at, colour)
        _draw_number(axes, n, at, colour, size, clip_on=True)
    if rounds.missed:
        xy = np.array([rounds.stops[stop].at for stop in rounds.missed])
        axes.plot(*xy.T, "x", color=style.INK, markersize=6, markeredgewidth=1.4, zorder=5, label="not visited")
    same = trace.task.start == trace.task.goal
    _draw_ends(axes, trace.task.start, None if same else trace.task.goal, returns=same, clip_on=True)


def _draw_times(axes: Axes, trace: Trace, rounds: Rounds) -> None:
    """Draw a row for each stop: its window, and the times of driving, waiting and service."""
    end, before, labels = float(trace.t[-1]), 0.0, []
    order = [*(visit.stop for visit in rounds.visits), *rounds.missed]
    for row, stop in enumerate(order):
        _draw_window(axes, row, rounds.stops[stop].window, 1.03 * end)
        labels.append(f"{rounds.name(stop)}  {row + 1 if row < len(rounds.visits) else '-'}")
        if row < len(rounds.visits):
            visit = rounds.visits[row]
            times, late = (before, visit.arrival, visit.start, visit.end), rounds.lateness(visit) > 0
            _draw_visit(axes, row, times, style.BLUE, late=late, size=4.4)
            before = visit.end
    for turn in rounds.turns:
        if turn.t > 0:
            axes.axvline(turn.t, color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
    _finish_schedule(axes, labels)
    axes.set(xlabel="time (s)", xlim=(0, 1.03 * end), ylim=(len(order) - 0.4, -0.6))
    axes.set_title("When the robot was where")


def _map_and_schedule(grid: Grid, rows: int | None, *, width: float) -> tuple[Axes, Axes | None, float]:
    """Return the map of `grid` and the schedule of `rows` rows (None: none) in a new figure, and the map's points per metre.

    The figure is about `width` inches wide.
    """
    low, high = (corner.tolist() for corner in _shown_part(grid))
    width, height = style.box_size(low, high, width=width, extra=1.5)
    if rows is None:
        axes, times = style.figure(width, height).subplots(), None
    else:
        below = 0.75 + 0.19 * rows
        axes, times = style.figure(max(width, 6.4), height + below).subplots(2, 1, height_ratios=(height - 1.0, below))
    style.draw_map(axes, grid)
    style.show_box(axes, grid, low, high)
    return axes, times, 72 * (width - 0.8) / (high[0] - low[0])


def _shown_part(grid: Grid) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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


def _number_size(stops: int) -> float:
    """Return the diameter of the discs that number so many stops, points."""
    return 11.5 if stops <= 25 else 9.0


def _was_moved(stop: Sequence[float], placed: Sequence[float], points_per_metre: float) -> bool:
    """Tell whether the number of a stop stands beside it, so that a line has to join them."""
    return math.dist(stop, placed) * points_per_metre > _MOVED


def _draw_leader(axes: Axes, stop: Sequence[float], placed: Sequence[float], colour: str) -> None:
    """Draw a line from a stop to its number."""
    axes.plot(*zip(stop, placed), color=colour, linewidth=0.8, zorder=4.6)


def _draw_number(axes: Axes, number: int, placed: Sequence[float], colour: str, size: float, *, clip_on: bool) -> None:
    """Draw the number of a stop in a disc of `size` points at `placed`."""
    edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 1.0, "clip_on": clip_on}
    axes.plot(*placed, "o", color=colour, markersize=size, zorder=5, **edge)
    font: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 0.58 * size, "weight": "bold"}
    axes.annotate(str(number), (placed[0], placed[1]), color="white", zorder=6, **font)


def _draw_ends(axes: Axes, start: XY, end: XY | None, *, returns: bool, clip_on: bool) -> None:
    """Draw a square at the start, m, and a star at the end, if it is another place; `returns`: the start is the end, too."""
    look: dict[str, Any] = {"linestyle": "", "markeredgecolor": style.INK, "clip_on": clip_on, "zorder": 5.8}
    label = "start and end" if returns else "start"
    axes.plot(*start, marker="s", color="white", markersize=8, markeredgewidth=1.6, label=label, **look)
    if end is not None:
        axes.plot(*end, marker="*", color=style.GOLD, markersize=13, markeredgewidth=0.9, label="end", **look)


def _apart(xy: NDArray[np.float64], fixed: NDArray[np.float64], least: float) -> NDArray[np.float64]:
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


def _draw_window(axes: Axes, row: int, window: tuple[float, float], last: float) -> None:
    """Draw the time window of a stop, s, up to `last` s; nothing for a stop that is always open."""
    earliest, latest = window
    if earliest > 0 or math.isfinite(latest):
        look: dict[str, Any] = {"facecolor": style.RULE, "edgecolor": style.GREY, "linewidth": 0.6, "zorder": 1}
        axes.barh(row, min(latest, last) - earliest, left=earliest, height=0.72, **look)


def _draw_visit(axes: Axes, row: int, times: Sequence[float], colour: str, *, late: bool, size: float) -> None:
    """Draw a visit in its row: the robot sets out, arrives, begins service, and ends it at these four `times`, s."""
    out, arrival, start, end = times
    axes.plot([out, arrival], [row, row], color=colour, linewidth=1.1, zorder=2)
    axes.plot([arrival, start], [row, row], color=style.GREY, linewidth=1.4, linestyle=_WAITING, zorder=2)
    axes.plot([start, end], [row, row], color=style.INK, linewidth=4.2, solid_capstyle="butt", zorder=3)
    axes.plot(arrival, row, marker="D" if late else "o", color=style.RED if late else colour, markersize=size, zorder=4)


def _finish_schedule(axes: Axes, labels: Sequence[str]) -> None:
    """Name the rows of a schedule, and remove its frame but for the axis of time."""
    axes.set_yticks(range(len(labels)), [style.plain(label) for label in labels], fontsize=7.5)
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)


def _schedule_legend() -> dict[str, Artist]:
    """Return the entries of a schedule's legend by name."""
    return {
        "window": Patch(facecolor=style.RULE, edgecolor=style.GREY, linewidth=0.6),
        "waits": Line2D([], [], color=style.GREY, linewidth=1.4, linestyle=_WAITING),
        "service": Line2D([], [], color=style.INK, linewidth=4.2, solid_capstyle="butt"),
        "late": Line2D([], [], color=style.RED, marker="D", linestyle="", markersize=5),
        "new order": Line2D([], [], color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2))),
    }
