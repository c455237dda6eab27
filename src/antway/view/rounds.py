"""The figure of rounds: the path from stop to stop, and the times at the stops."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from antway.view import stops, style
from antway.world.stops import Rounds
from antway.world.trace import Trace


@style.styled
def rounds_figure(trace: Trace) -> Figure:
    """Draw the rounds of an episode with stops: a map with the stops numbered by visit, and the times at each below it."""
    rounds = trace.rounds if trace.rounds is not None else Rounds(())
    axes, times, points_per_metre = stops.map_and_schedule(trace.task.grid, max(1, len(rounds.stops)), width=7.6)
    assert times is not None
    for k in range(len(trace.obstacle_id)):
        label = "tracks of what moves" if k == 0 else None
        axes.plot(*trace.obstacle_xy[:, k].T, color=style.RED, linewidth=0.7, alpha=0.45, label=label, zorder=2)
    style.draw_path(axes, trace.xy, style.BLUE, 1.6, label="driven")
    _draw_stops(axes, trace, rounds, points_per_metre)
    late = sum(rounds.lateness(visit) > 0 for visit in rounds.visits)
    verdict = f"{late} of them late" if late else "all in time"
    axes.set_title(f"Rounds: {len(rounds.visits)} of {len(rounds.stops)} stops in {trace.t[-1]:,.0f} s, {verdict}")
    _draw_times(times, trace, rounds)
    shown = ["window", "waits", "service"] + ["new order"] * any(turn.t > 0 for turn in rounds.turns)
    legend = stops.schedule_legend()
    return style.legend_below(axes, more=[(legend[name], name) for name in shown])


def _draw_stops(axes: Axes, trace: Trace, rounds: Rounds, points_per_metre: float) -> None:
    """Draw the stops, numbered in the order of the visits; those not visited are crosses."""
    size = stops.number_size(len(rounds.stops))
    true = np.array([rounds.stops[visit.stop].at for visit in rounds.visits]).reshape(-1, 2)
    ends = np.array([trace.task.start, trace.task.goal])
    placed = stops.apart(true, ends, (size + 1.5) / points_per_metre)
    for n, (visit, stop, at) in enumerate(zip(rounds.visits, true.tolist(), placed.tolist()), 1):
        colour = style.RED if rounds.lateness(visit) > 0 else style.BLUE
        if stops.was_moved(stop, at, points_per_metre):
            stops.draw_leader(axes, stop, at, colour)
        stops.draw_number(axes, n, at, colour, size, clip_on=True)
    if rounds.missed:
        xy = np.array([rounds.stops[stop].at for stop in rounds.missed])
        axes.plot(*xy.T, "x", color=style.INK, markersize=6, markeredgewidth=1.4, zorder=5, label="not visited")
    same = trace.task.start == trace.task.goal
    stops.draw_ends(axes, trace.task.start, None if same else trace.task.goal, returns=same, clip_on=True)


def _draw_times(axes: Axes, trace: Trace, rounds: Rounds) -> None:
    """Draw a row for each stop: its window, and the times of driving, waiting and service."""
    end, before, labels = float(trace.t[-1]), 0.0, []
    order = [*(visit.stop for visit in rounds.visits), *rounds.missed]
    for row, stop in enumerate(order):
        stops.draw_window(axes, row, rounds.stops[stop].window, 1.03 * end)
        labels.append(f"{rounds.name(stop)}  {row + 1 if row < len(rounds.visits) else '-'}")
        if row < len(rounds.visits):
            visit = rounds.visits[row]
            times, late = (before, visit.arrival, visit.start, visit.end), rounds.lateness(visit) > 0
            stops.draw_visit(axes, row, times, style.BLUE, late=late, size=4.4)
            before = visit.end
    for turn in rounds.turns:
        if turn.t > 0:
            axes.axvline(turn.t, color=style.ORANGE, linewidth=1.0, linestyle=(0, (4, 2)), zorder=1.5)
    stops.finish_schedule(axes, labels)
    axes.set(xlabel="time (s)", xlim=(0, 1.03 * end), ylim=(len(order) - 0.4, -0.6))
    axes.set_title("When the robot was where")
