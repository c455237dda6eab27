"""The figure of rounds: the path from stop to stop, and the times at the stops."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from antway.view import style
from antway.view.tours import apart, shown_part
from antway.world.stops import Rounds
from antway.world.trace import Trace

EDGE = "#9AA3AD"


@style.styled
def rounds_figure(trace: Trace, *, title: str = "") -> Figure:
    """Draw an episode's rounds: a map with stops numbered by visit, and below the times of arrival, waiting and service.

    Parameters
    ----------
    trace : Trace
        Of a scenario with stops.
    title : str
        By default the number of visited stops, and the times.
    """
    rounds = trace.rounds if trace.rounds is not None else Rounds(())
    low, high = shown_part(trace.task.grid)
    width, height = style.box_size(low.tolist(), high.tolist(), width=7.6, extra=1.5)
    below = 0.75 + 0.19 * max(1, len(rounds.stops))
    fig = style.figure(max(width, 6.4), height + below)
    axes, times = fig.subplots(2, 1, height_ratios=(height - 1.0, below))
    style.draw_map(axes, trace.task.grid)
    style.show_box(axes, trace.task.grid, low.tolist(), high.tolist())
    for k in range(len(trace.obstacle_id)):
        label = "tracks of what moves" if k == 0 else None
        axes.plot(*trace.obstacle_xy[:, k].T, color=style.RED, linewidth=0.7, alpha=0.45, label=label, zorder=2)
    axes.plot(*trace.xy.T, color=style.BLUE, linewidth=1.6, path_effects=style.casing(1.6), label="driven", zorder=3)
    _draw_stops(axes, trace, rounds, 72 * (width - 0.8) / float(high[0] - low[0]))
    late = sum(rounds.lateness(visit) > 0 for visit in rounds.visits)
    verdict = f"{late} of them late" if late else "all in time"
    default = f"Rounds: {len(rounds.visits)} of {len(rounds.stops)} stops in {trace.t[-1]:,.0f} s, {verdict}"
    axes.set_title(title or default)
    _draw_times(times, trace, rounds)
    handles, labels = axes.get_legend_handles_labels()
    handles += [
        Patch(facecolor=style.RULE, edgecolor=EDGE, linewidth=0.6),
        Line2D([], [], color=EDGE, linewidth=1.4, linestyle=(0, (1.2, 1.2))),
        Line2D([], [], color=style.INK, linewidth=4.2, solid_capstyle="butt"),
    ]
    labels += ["window", "waits", "service"]
    if any(turn.t > 0 for turn in rounds.turns):
        handles.append(Line2D([], [], color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2))))
        labels.append("new order")
    fig.legend(handles, labels, loc="outside lower center", ncols=4)
    return fig


def _draw_stops(axes: Axes, trace: Trace, rounds: Rounds, points_per_metre: float) -> None:
    """Draw the stops, numbered in the order of the visits; those not visited are crosses."""
    size = 11.5 if len(rounds.stops) <= 25 else 9.0
    true = np.array([rounds.stops[visit.stop].at for visit in rounds.visits]).reshape(-1, 2)
    ends = np.array([trace.task.start, trace.task.goal])
    placed = apart(true, ends, (size + 1.5) / points_per_metre)
    for n, (visit, (x, y), (u, v)) in enumerate(zip(rounds.visits, true, placed), 1):
        colour = style.RED if rounds.lateness(visit) > 0 else style.BLUE
        if math.hypot(u - x, v - y) * points_per_metre > 1.5:
            axes.plot([x, u], [y, v], color=colour, linewidth=0.8, zorder=4.6)
        axes.plot(u, v, "o", color=colour, markersize=size, markeredgecolor="white", markeredgewidth=1.0, zorder=5)
        axes.annotate(
            str(n), (u, v), ha="center", va="center_baseline", color="white", fontsize=0.58 * size, weight="bold", zorder=6
        )
    if rounds.missed:
        xy = np.array([rounds.stops[stop].at for stop in rounds.missed])
        axes.plot(*xy.T, "x", color=style.INK, markersize=6, markeredgewidth=1.4, zorder=5, label="not visited")
    same = trace.task.start == trace.task.goal
    edge = {"markeredgecolor": style.INK, "linestyle": "", "zorder": 5.8}
    label = "start and end" if same else "start"
    axes.plot(*trace.task.start, marker="s", color="white", markersize=8, markeredgewidth=1.6, label=label, **edge)  # type: ignore[arg-type]
    if not same:
        axes.plot(*trace.task.goal, marker="*", color="#FFD23F", markersize=13, markeredgewidth=0.9, label="end", **edge)  # type: ignore[arg-type]


def _draw_times(axes: Axes, trace: Trace, rounds: Rounds) -> None:
    """Draw a row for each stop: its window, and the times of driving, waiting and service."""
    end, before, labels = float(trace.t[-1]), 0.0, []
    order = [*(visit.stop for visit in rounds.visits), *rounds.missed]
    for row, stop in enumerate(order):
        early, latest = rounds.stops[stop].window
        if early > 0 or math.isfinite(latest):
            right = min(latest, 1.03 * end)
            axes.barh(
                row, right - early, left=early, height=0.72, facecolor=style.RULE, edgecolor=EDGE, linewidth=0.6, zorder=1
            )
        labels.append(f"{rounds.name(stop)}  {row + 1 if row < len(rounds.visits) else '-'}")
        if row >= len(rounds.visits):
            continue
        visit = rounds.visits[row]
        late = rounds.lateness(visit) > 0
        axes.plot([before, visit.arrival], [row, row], color=style.BLUE, linewidth=1.1, zorder=2)
        axes.plot([visit.arrival, visit.start], [row, row], color=EDGE, linewidth=1.4, linestyle=(0, (1.2, 1.2)), zorder=2)
        axes.plot([visit.start, visit.end], [row, row], color=style.INK, linewidth=4.2, solid_capstyle="butt", zorder=3)
        colour, marker = (style.RED, "D") if late else (style.BLUE, "o")
        axes.plot(visit.arrival, row, marker=marker, color=colour, markersize=4.4, zorder=4)
        before = visit.end
    for turn in rounds.turns:
        if turn.t > 0:
            axes.axvline(turn.t, color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
    axes.set_yticks(range(len(order)), labels, fontsize=7.5)
    axes.tick_params(axis="y", length=0)
    axes.set(xlabel="time (s)", xlim=(0, 1.03 * end), ylim=(len(order) - 0.4, -0.6))
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.set_title("When the robot was where")
