"""Figures of tours and of rounds: the path from stop to stop on the map, and below it when the robot is where."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

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


class _Visit(NamedTuple):
    """A stop as it is drawn, and its visit, if there is one."""

    at: XY  # m
    name: str
    window: tuple[float, float]  # s
    number: int = 0  # among the visits of its robot, from 1 on; 0: it is not visited
    times: tuple[float, ...] = (math.nan,) * 4  # s; the robot sets out, arrives, begins service and ends it
    colour: str = style.INK  # of the robot
    late: bool = False


@style.styled
def plan_tour_figure(tour: TourPlan) -> Figure:
    """Draw a tour on its map, stops numbered in the order of their visits, and, where there are windows, its schedule.

    Parameters
    ----------
    tour : TourPlan
        Of at most 40 stops for a schedule, 60 for numbers.
    """
    task, robots = tour.task, [_visits_of(tour, k) for k in range(len(tour.routes))]
    visits = [visit for mine in robots for visit in mine]
    timed = bool((task.windows[:, 0] > 0).any() or np.isfinite(task.windows[:, 1]).any())
    scheduled = (timed or task.priorities is not None or math.isfinite(task.deadline)) and len(visits) <= MOST_LISTED
    rows = len(visits) + len(robots) * (len(robots) > 1)
    axes, times, points_per_metre = _map_and_schedule(task.grid, rows if scheduled else None, width=7.2)
    for k, route in enumerate(tour.routes):
        _draw_route(axes, tour, route, k)
    skipped = [_Visit(_place(task.stops[stop]), task.names[stop], (0.0, math.inf)) for stop in tour.skipped]
    ends = [task.start] if task.end is None else [task.start, task.end if isinstance(task.end, tuple) else task.start]
    _draw_stops(axes, visits + skipped, ends, "left out", points_per_metre)
    axes.set_title(_title(tour))
    more: list[tuple[Artist, str]] = []
    if times is not None:
        _draw_tour_times(times, tour, robots)
        waits = any((route.waiting > 0).any() for route in tour.routes)
        shown = {"window": timed, "waits": waits, "service": True, "late": tour.lateness > 0}
        more = [(artist, name) for name, artist in _schedule_legend().items() if shown.get(name)]
    return style.legend_below(axes, more=more)


def _colour_of(robot: int) -> str:
    return style.COLOURS[robot % len(style.COLOURS)]


def _place(xy: NDArray[np.float64]) -> XY:
    return float(xy[0]), float(xy[1])


def _visits_of(tour: TourPlan, robot: int) -> list[_Visit]:
    """Return the visits of a robot in their order."""
    task, route, before, visits = tour.task, tour.routes[robot], 0.0, list[_Visit]()
    for n, stop in enumerate(route.order.tolist()):
        arrival = float(route.arrival[n])
        start = arrival + float(route.waiting[n])
        end = start + float(task.service[stop])
        earliest, latest = task.windows[stop].tolist()
        times, late = (before, arrival, start, end), start - latest > 1e-9 * (1.0 + route.duration)
        about = _place(task.stops[stop]), task.names[stop], (earliest, latest)
        visits.append(_Visit(*about, n + 1, times, _colour_of(robot), late))
        before = end
    return visits


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
    colour, several = _colour_of(k), len(tour.routes) > 1
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


def _draw_stops(axes: Axes, stops: Sequence[_Visit], ends: Sequence[XY], left_out: str, points_per_metre: float) -> None:
    """Draw the stops and both ends, or the start alone.

    Stops are numbered in the order of the visits, and dots if they are many. Numbers that would lie over each other stand
    beside their stops. Stops that are not visited are crosses, which the legend calls `left_out`.
    """
    visits, missed = [one for one in stops if one.number], [one.at for one in stops if not one.number]
    numbered, size = len(visits) <= MOST_NUMBERED, 11.5 if len(visits) <= 25 else 9.0  # points; diameter of numbers
    look: dict[str, Any] = {"linestyle": "", "clip_on": False}
    true = np.array([visit.at for visit in visits]).reshape(-1, 2)
    placed = _apart(true, np.array(list(dict.fromkeys(ends))), (size + 1.5) / points_per_metre) if numbered else true
    for visit, at in zip(visits, placed.tolist()):
        colour = style.RED if visit.late else visit.colour
        if not numbered or math.dist(visit.at, at) * points_per_metre > _MOVED:
            axes.plot(*zip(visit.at, at), color=colour, linewidth=0.8, zorder=4.6)
            edge: dict[str, Any] = {"markeredgecolor": "white", "markeredgewidth": 0.5}
            axes.plot(*visit.at, marker="o", color=colour, markersize=3.2, zorder=4.7, **edge, **look)
        if numbered:
            edge = {"markeredgecolor": "white", "markeredgewidth": 1.0}
            axes.plot(*at, marker="o", color=colour, markersize=size, zorder=5, **edge, **look)
            font: dict[str, Any] = {"ha": "center", "va": "center_baseline", "fontsize": 0.58 * size, "weight": "bold"}
            axes.annotate(str(visit.number), (at[0], at[1]), color="white", zorder=6, **font)
    if missed:
        axes.plot(
            *zip(*missed), marker="x", color=style.INK, markersize=5.5, markeredgewidth=1.2, zorder=4.8, label=left_out, **look
        )
    start, *end = ends
    look |= {"markeredgecolor": style.INK, "zorder": 5.8}
    label = "start and end" if end == [start] else "start"
    axes.plot(*start, marker="s", color="white", markersize=8, markeredgewidth=1.6, label=label, **look)
    if label == "start" and end:
        axes.plot(*end[0], marker="*", color=style.GOLD, markersize=13, markeredgewidth=0.9, label="end", **look)


def _draw_tour_times(axes: Axes, tour: TourPlan, robots: Sequence[Sequence[_Visit]]) -> None:
    """Draw the schedule of a tour, and its deadline."""
    task = tour.task
    last = max(1e-9, tour.duration, *(w for w in task.windows[:, 1].tolist() if math.isfinite(w)))
    last = min(last, 1.6 * max(tour.duration, 1e-9))
    rows = _draw_schedule(axes, robots, 1.02 * last)
    if math.isfinite(task.deadline) and task.deadline <= 1.6 * last:
        axes.axvline(task.deadline, color=style.INK, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
        axes.text(task.deadline, -0.9, "deadline ", ha="right", va="center", fontsize=7)
    axes.set_ylim(rows - 0.4, -1.3 if math.isfinite(task.deadline) else -0.6)
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
    visits = _visits_in(rounds)
    _draw_stops(axes, visits, [trace.task.start, trace.task.goal], "not visited", points_per_metre)
    late = sum(visit.late for visit in visits)
    verdict = f"{late} of them late" if late else "all in time"
    axes.set_title(f"Rounds: {len(rounds.visits)} of {len(rounds.stops)} stops in {trace.t[-1]:,.0f} s, {verdict}")
    end, turns = 1.03 * float(trace.t[-1]), [turn.t for turn in rounds.turns if turn.t > 0]
    rows = _draw_schedule(times, [visits], end)
    for turn in turns:
        times.axvline(turn, color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
    times.set(xlim=(0, end), ylim=(rows - 0.4, -0.6), title="When the robot was where")
    shown = ["window", "waits", "service"] + ["new order"] * (len(turns) > 0)
    legend = _schedule_legend()
    return style.legend_below(axes, more=[(legend[name], name) for name in shown])


def _visits_in(rounds: Rounds) -> list[_Visit]:
    """Return the visits of a robot's rounds in their order, then the stops that were not visited."""
    stops = [_Visit(stop.at, rounds.name(k), stop.window) for k, stop in enumerate(rounds.stops)]
    before, visits = 0.0, list[_Visit]()
    for n, visit in enumerate(rounds.visits, 1):
        times, late = (before, visit.arrival, visit.start, visit.end), rounds.lateness(visit) > 0
        visits.append(stops[visit.stop]._replace(number=n, times=times, colour=style.BLUE, late=late))
        before = visit.end
    return visits + [stops[k] for k in rounds.missed]


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


def _draw_schedule(axes: Axes, robots: Sequence[Sequence[_Visit]], last: float) -> int:
    """Draw for each stop its window up to `last` s, and when the robot drives, waits and serves; return the number of rows."""
    labels = list[str]()
    for k, visits in enumerate(robots):
        if len(robots) > 1:
            axes.text(0.0, len(labels), f"robot {k + 1}", va="center", color=_colour_of(k), weight="bold", fontsize=7.5)
            labels.append("")
        for visit in visits:
            _draw_row(axes, len(labels), visit, last)
            labels.append(f"{visit.name}  {visit.number or '-'}")
    axes.set_yticks(range(len(labels)), [style.plain(label) for label in labels], fontsize=7.5)
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_xlabel("time (s)")
    return len(labels)


def _draw_row(axes: Axes, row: int, visit: _Visit, last: float) -> None:
    """Draw a stop in its row of a schedule: its window up to `last` s, unless it is always open, and its visit."""
    (earliest, latest), (out, arrival, start, end) = visit.window, visit.times
    if earliest > 0 or math.isfinite(latest):
        look: dict[str, Any] = {"facecolor": style.RULE, "edgecolor": style.GREY, "linewidth": 0.6, "zorder": 1}
        axes.barh(row, min(latest, last) - earliest, left=earliest, height=0.72, **look)
    axes.plot([out, arrival], [row, row], color=visit.colour, linewidth=1.1, zorder=2)
    axes.plot([arrival, start], [row, row], color=style.GREY, linewidth=1.4, linestyle=_WAITING, zorder=2)
    axes.plot([start, end], [row, row], color=style.INK, linewidth=4.2, solid_capstyle="butt", zorder=3)
    dot: dict[str, Any] = {"marker": "o", "color": visit.colour, "markersize": 4.2}
    if visit.late:
        dot = {"marker": "D", "color": style.RED, "markersize": 5}
    axes.plot(arrival, row, zorder=4, **dot)


def _schedule_legend() -> dict[str, Artist]:
    """Return the entries of a schedule's legend by name."""
    return {
        "window": Patch(facecolor=style.RULE, edgecolor=style.GREY, linewidth=0.6),
        "waits": Line2D([], [], color=style.GREY, linewidth=1.4, linestyle=_WAITING),
        "service": Line2D([], [], color=style.INK, linewidth=4.2, solid_capstyle="butt"),
        "late": Line2D([], [], color=style.RED, marker="D", linestyle="", markersize=5),
        "new order": Line2D([], [], color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2))),
    }
