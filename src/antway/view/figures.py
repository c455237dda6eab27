"""Figures of plans, episodes, colonies and tours. Each function returns a Matplotlib `Figure`; `save` writes it."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.ticker import NullFormatter
from numpy.typing import NDArray

from antway import checks
from antway.ants.tsp import Tour, Tsp
from antway.errors import BadParameter
from antway.grid import Grid
from antway.planning import Plan
from antway.view import style
from antway.view.moments import global_path, in_words, meeting, moments, shortest, title_of
from antway.view.pages import faint_scale
from antway.view.style import save
from antway.world.policy import Decision
from antway.world.trace import Trace

__all__ = ["convergence_figure", "final_figure", "moment_figure", "moments", "plan_figure", "save", "shortest"]
__all__ += ["global_path", "meeting", "strip_figure", "title_of", "tour_figure"]

HORIZON = 3.0  # s; time for which predictions are drawn


@style.styled
def plan_figure(
    grid: Grid,
    path: Plan,
    *,
    title: str = "Shortest path on the known map",
    ends: tuple[Sequence[float], Sequence[float]] | None = None,
) -> Figure:
    """Draw a plan on its map (Fig. 4 of the paper).

    Parameters
    ----------
    grid : Grid
        The map, not inflated.
    path : Plan
        If it has no path, only the map and the ends are drawn.
    title : str
    ends : ((x, y), (x, y)) or None
        Start and goal in m; None: those of the path.
    """
    axes = style.figure(*style.map_size(grid)).subplots()
    style.draw_map(axes, grid)
    xy = path.xy(grid) if len(path.cells) else np.empty((0, 2))
    if len(xy):
        label = f"{'shortest ' if path.optimal else ''}path, {path.length:.2f} m"
        style.draw_path(axes, xy, style.BLUE, 2.2, label=label, zorder=4)
        ends = ends or (xy[0], xy[-1])
    if ends is not None:
        draw_ends(axes, *ends)
    axes.set_title(style.plain(title))
    return style.legend_below(axes)


@style.styled
def moment_figure(
    trace: Trace, step: int, *, title: str, caption: str | None = None, path: Plan | None = None, pheromone: bool = False
) -> Figure:
    """Draw an episode at one step (Figs. 5 and 6 of the paper); moving obstacles are red and have their numbers.

    Their predicted motions in the next 3 s are drawn if the decision of that step has them.

    Parameters
    ----------
    trace : Trace
    step : int
        In [0, len(trace)].
    title : str
    caption : str or None
        Text under the picture; None: the decision in words.
    path : Plan or None
        The global path, drawn dashed.
    pheromone : bool
        Draw the ants' pheromone and the path that was chosen, if the decision of that step has them.
    """
    step = checks.integer("step", step, low=0, high=len(trace))
    axes = style.figure(*style.map_size(trace.task.grid, extra=1.6)).subplots()
    _draw_moment(axes, trace, step, path, pheromone)
    decision = trace.decision_at(step)
    axes.set_title(style.plain(f"{title}  (t = {trace.t[step]:.1f} s)"))
    if caption is None and decision is not None:
        caption = f"{decision.action.replace('-', ' ')}: {in_words(decision.reason)}"
    if caption is not None:
        lines = textwrap.wrap(caption, 90, max_lines=2, placeholder=" ...")
        axes.set_xlabel("x (m)\n" + style.plain("\n".join(lines)))
    return style.legend_below(axes, columns=3)


@style.styled
def final_figure(trace: Trace, *, path: Plan | None = None, title: str = "Final path of the robot") -> Figure:
    """Draw the path that a robot drove, the global path, and the tracks of the obstacles in red (Fig. 7 of the paper)."""
    axes = style.figure(*style.map_size(trace.task.grid, extra=1.6)).subplots()
    style.draw_map(axes, trace.task.grid)
    if path is not None:
        _draw_global(axes, trace.task.grid, path)
    for k in range(len(trace.obstacle_id)):
        label = "moving obstacle: its track, and where it ended" if k == 0 else None
        axes.plot(*trace.obstacle_xy[:, k].T, color=style.RED, linewidth=0.9, alpha=0.7, label=label, zorder=2)
        _disc(axes, trace.obstacle_xy[-1, k], trace.obstacle_radius[k], style.RED, zorder=5)
    _draw_numbers(axes, trace, len(trace))
    label = f"driven, {trace.length:.2f} m in {trace.t[-1]:.1f} s"
    style.draw_path(axes, trace.xy, style.BLUE, 2.2, label=label, zorder=4)
    marks = trace.xy[np.searchsorted(trace.t, np.arange(5.0, trace.t[-1] + 1e-9, 5.0) - 1e-9)]
    axes.plot(*marks.T, "o", color="white", markeredgecolor=style.BLUE, markersize=4, label="every 5 s", zorder=4.5)
    _draw_stops(axes, trace)
    draw_ends(axes, trace.task.start, trace.task.goal)
    axes.set_title(style.plain(f"{title}: {trace.outcome.value.replace('-', ' ')}"))
    return style.legend_below(axes, columns=3)


@style.styled
def strip_figure(trace: Trace, steps: Sequence[int], *, path: Plan | None = None) -> Figure:
    """Draw an episode at several steps side by side."""
    steps = [checks.integer("steps", step, low=0, high=len(trace)) for step in steps]
    if not steps:
        raise BadParameter("steps", steps, "at least one step")
    width, height = style.map_size(trace.task.grid, width=2.7, extra=0.75)
    row = style.figure(width * len(steps), height + 0.3).subplots(1, len(steps), squeeze=False)[0]
    for axes, step in zip(row, steps):
        _draw_moment(axes, trace, step, path, pheromone=True, labelled=False)
        axes.set_title(f"t = {trace.t[step]:.1f} s")
        if axes is not row[0]:
            axes.set_ylabel("")
    last = row[-1].get_legend_handles_labels()[1]
    others = {label: handle for axes in row for handle, label in zip(*axes.get_legend_handles_labels()) if label not in last}
    more = [(handle, label) for label, handle in others.items()]
    return style.legend_below(row[-1], columns=4 if len(steps) > 2 else 2, more=more)


@style.styled
def convergence_figure(histories: Mapping[str, NDArray[np.float64]], *, optimum: float | None = None) -> Figure:
    """Draw the best length so far and the cycle's mean length against the cycle, for several colonies.

    Parameters
    ----------
    histories : mapping of name to float64[C, 4]
        For each colony (at most six) and cycle: best length, mean length (m), share of ants that arrived, pheromone entropy
        (nats), as in `Decision`.
    optimum : float or None
        The shortest length, m, drawn as a line.
    """
    if len(histories) > len(style.COLOURS):
        raise BadParameter("histories", list(histories), f"at most {len(style.COLOURS)} colonies")
    lengths, arrived = style.figure(6.4, 5.2).subplots(2, 1, sharex=True, height_ratios=(2.4, 1))
    for (name, history), colour, dash in zip(histories.items(), style.COLOURS, style.DASHES):
        table = checks.array(f"history of {name}", history, (None, 4), finite=False)
        cycle, look = np.arange(1, len(table) + 1), {"color": colour, "linestyle": dash}
        best, mean, share, _ = np.where(np.isfinite(table), table, np.nan).T
        lengths.plot(cycle, best, linewidth=2.0, label=f"{name}: best so far", **look)
        lengths.plot(cycle, mean, linewidth=0.9, alpha=0.75, label=f"{name}: mean of the cycle", **look)
        arrived.plot(cycle, 100 * share, linewidth=1.4, **look)
    if optimum is not None:
        lengths.axhline(optimum, color=style.INK, linewidth=0.8, label=f"shortest path, {optimum:.2f} m")
    lengths.set(ylabel="path length (m)", title="Ants on a static map: convergence")
    arrived.set(ylabel="ants that arrive (%)", xlabel="cycle", ylim=(-3, 103))
    for axes in (lengths, arrived):
        style.graph(axes)
        axes.margins(x=0.01)
    return style.legend_below(lengths, columns=2)


@style.styled
def tour_figure(instance: Tsp, tour: Tour, *, title: str = "") -> Figure:
    """Draw a tour, if its cities have places, and the best length against the number of tours."""
    mapped = instance.xy is not None
    fig = style.figure(10.4 if mapped else 5.6, 5.2)
    *left, right = fig.subplots(1, 2 if mapped else 1, squeeze=False, width_ratios=(1.35, 1) if mapped else None)[0]
    for axes in left:
        _draw_cities(axes, instance, tour)
        axes.set_title(style.plain(title or instance.name))
        axes.spines[["top", "right"]].set_visible(False)
    _draw_lengths(right, tour)
    return fig


def _draw_cities(axes: Axes, instance: Tsp, tour: Tour) -> None:
    """Draw the cities of an instance with places, and a tour through them."""
    geographic = instance.metric == "GEO"
    xy = np.asarray(instance.xy, dtype=np.float64)
    if geographic:
        xy = xy[:, ::-1]
    x, y = xy[np.append(tour.order, tour.order[:1])].T
    if geographic:  # a leg across the date line leaves the map on one side and returns on the other
        x = np.unwrap(x, period=360.0)
        margin = 0.03 * float(np.ptp(xy[:, 0])) or 1.0
        axes.set_xlim(xy[:, 0].min() - margin, xy[:, 0].max() + margin)
    for shift in (-360.0, 0.0, 360.0) if geographic else (0.0,):
        axes.plot(x + shift, y, color=style.BLUE, linewidth=1.2 if len(xy) < 1000 else 0.5)
    axes.plot(*xy.T, "o", color=style.INK, markersize=max(0.6, 5.0 - np.log2(max(len(xy), 1)) / 2.5), markeredgewidth=0)
    names = ("longitude (degrees.minutes)", "latitude (degrees.minutes)") if geographic else ("x", "y")
    axes.set(xlabel=names[0], ylabel=names[1], aspect="equal")
    axes.locator_params(nbins=7, steps=[1, 2, 5, 10])


def _draw_lengths(axes: Axes, tour: Tour) -> None:
    """Draw the best length so far against the number of tours, and the optimum if it is known."""
    made, best, _ = np.vstack((tour.history, [tour.tours, tour.length, tour.elapsed])).T
    dot: dict[str, Any] = {"marker": "o"} if len(set(made)) == 1 else {}  # a line with one point would be invisible
    label = f"best tour, {tour.length:,.6g}"
    axes.step(np.maximum(made, 1), best, where="post", color=style.BLUE, linewidth=1.8, label=label, **dot)
    if tour.optimum is not None:
        axes.axhline(tour.optimum, color=style.INK, linewidth=0.8, label=f"optimum, {tour.optimum:,.6g}")
    axes.set(title="Best length so far", xlabel="tours made", ylabel="length", xscale="log")
    axes.xaxis.set_minor_formatter(NullFormatter())
    style.graph(axes)
    axes.legend()


def _draw_moment(axes: Axes, trace: Trace, step: int, path: Plan | None, pheromone: bool, labelled: bool = True) -> None:
    """Draw an episode at a step; what to draw is as in `moment_figure`, and `labelled` as in `_draw_choice`."""
    task = trace.task
    style.draw_map(axes, task.grid)
    decision = trace.decision_at(step)
    if path is not None:
        _draw_global(axes, task.grid, path)
    if pheromone and decision is not None:
        _draw_choice(axes, task.grid, decision, labelled)
    sensed = Circle(tuple(trace.xy[step]), task.robot.sensor_range, fill=False, linestyle=(0, (1, 2)), edgecolor=style.INK)
    if np.isfinite(task.robot.sensor_range):
        axes.add_patch(sensed)
        axes.plot([], [], color=style.INK, linestyle=(0, (1, 2)), label="sensed range")
    _draw_predictions(axes, trace, step)
    for xy, radius, seen in zip(trace.obstacle_xy[step], trace.obstacle_radius, trace.sensed[step]):
        _disc(axes, xy, radius, style.RED, zorder=5, filled=bool(seen))
    _draw_obstacle_labels(axes, trace, step)
    _draw_numbers(axes, trace, step)
    style.draw_path(axes, trace.xy[: step + 1], style.BLUE, 2.2, label="driven", zorder=4)
    _draw_stops(axes, trace)
    draw_ends(axes, task.start, task.goal)
    _disc(axes, trace.xy[step], task.robot.radius, style.BLUE, zorder=6)
    axes.plot([], [], "o", color=style.BLUE, markersize=8, label="robot")
    nose = trace.xy[step] + task.robot.radius * np.array([np.cos(trace.heading[step]), np.sin(trace.heading[step])])
    axes.plot(*np.array([trace.xy[step], nose]).T, color="white", linewidth=1.2, zorder=6.5)


def _draw_stops(axes: Axes, trace: Trace) -> None:
    """Draw the stops of an episode, if it has any."""
    if trace.rounds is not None:
        at = np.array([stop.at for stop in trace.rounds.stops])
        axes.plot(
            *at.T, "D", color="white", markeredgecolor=style.ORANGE, markeredgewidth=1.6, markersize=7, label="stop", zorder=3
        )


def _draw_choice(axes: Axes, grid: Grid, decision: Decision, labelled: bool) -> None:
    """Draw the pheromone of a decision with its scale, `labelled` or not, the path that was chosen, and the local target."""
    if decision.pheromone is not None and (decision.pheromone[2] > 0).any():
        row, col, amount = decision.pheromone
        x, y, _ = grid.origin
        d, (h, w) = grid.resolution, amount.shape
        extent = (x + col * d, x + (col + w) * d, y + row * d, y + (row + h) * d)
        shades = faint_scale(amount.astype(np.float64))
        image = axes.imshow(shades, origin="lower", extent=extent, cmap=style.PHEROMONE, vmin=0, vmax=1, zorder=1.5)
        image.set_interpolation("nearest")
        look: dict[str, Any] = {"edgecolor": style.VIOLET, "linewidth": 0.9}
        axes.add_patch(Rectangle(extent[::2], w * d, h * d, fill=False, zorder=1.6, **look))
        axes.add_patch(Rectangle((0, 0), 0, 0, facecolor=style.PHEROMONE(0.7), label="pheromone", **look))
        bar = axes.figure.colorbar(image, ax=axes, shrink=0.5, pad=0.02, ticks=[0, 1])
        bar.ax.set_yticklabels(["least", "most"])
        bar.set_label("pheromone" if labelled else "")
    if decision.path is not None and len(decision.path.xy):
        style.draw_path(axes, decision.path.xy, style.TEAL, 2.0, label="chosen path", zorder=3.5)
    if decision.local_target is not None:
        diamond: dict[str, Any] = {"color": style.TEAL, "markeredgecolor": "white", "markersize": 7}
        axes.plot(*decision.local_target, "D", label="local target", zorder=5.5, **diamond)


def _draw_predictions(axes: Axes, trace: Trace, step: int) -> None:
    """Draw the predicted bands that obstacles sweep in the next 1, 2 and 3 s, paler with time."""
    for ahead in (HORIZON, HORIZON * 2 / 3, HORIZON / 3):
        for a, b, radius in predicted(trace, step, ahead):
            axes.add_patch(Polygon(_band(a, b, radius), facecolor=style.ORANGE, alpha=0.25, linewidth=0, zorder=3))
    if predicted(trace, step, HORIZON):
        label = f"predicted, next {HORIZON:.0f} s"
        axes.add_patch(Polygon([(0, 0)], facecolor=style.ORANGE, alpha=0.5, linewidth=0, label=label))


def predicted(trace: Trace, step: int, ahead: float) -> list[tuple[NDArray[np.float64], NDArray[np.float64], float]]:
    """Return the predicted motions of obstacles in the next `ahead` s, from the decision of that step.

    Each part is the straight motion of a disc: start and end, (x, y) in m, and its radius in m.
    """
    decision, now = trace.decision_at(step), float(trace.t[step])
    found = []
    for t0, t1, x, y, vx, vy, radius in [] if decision is None or decision.predicted is None else decision.predicted.tolist():
        start, end = max(t0, now), min(t1, now + ahead)
        if start < end:
            place, velocity = np.array([x, y]), np.array([vx, vy])
            found.append((place + velocity * (start - t0), place + velocity * (end - t0), radius))
    return found


def _band(a: NDArray[np.float64], b: NDArray[np.float64], radius: float) -> NDArray[np.float64]:
    """Return the outline of the area that a disc of `radius` sweeps from `a` to `b`, float64[50, 2]."""
    heading = np.arctan2(*(b - a)[::-1])
    angle = heading + np.linspace(-0.5, 0.5, 25) * np.pi
    ahead = np.column_stack((np.cos(angle), np.sin(angle))) * radius
    return np.vstack((b + ahead, a - ahead))


def _draw_numbers(axes: Axes, trace: Trace, step: int) -> None:
    """Write each obstacle's number above it, or below; where numbers would overlap in both places, only the first."""
    fig = axes.get_figure(root=True)
    assert fig is not None
    inches = axes.get_position().width * fig.get_figwidth()
    apart, kept = 0.14 / inches * float(np.ptp(axes.get_xlim())), np.empty((0, 2))  # the space of a number is in inches
    up = np.array([0.0, -1.0 if trace.task.grid.top_first else 1.0])
    for k, place in enumerate(trace.obstacle_xy[step]):
        places = place + up * trace.obstacle_radius[k], place - up * (trace.obstacle_radius[k] + apart)
        at = next((one for one in places if (np.abs(kept - one) > apart).any(axis=1).all()), None)
        if at is not None:
            kept = np.vstack((kept, at))
            look: dict[str, Any] = {"color": style.RED, "fontsize": 7.5, "fontweight": "bold", "zorder": 7, "clip_on": True}
            axes.text(at[0], at[1], str(trace.obstacle_id[k]), ha="center", va="bottom", path_effects=style.casing(0.0), **look)


def _draw_obstacle_labels(axes: Axes, trace: Trace, step: int) -> None:
    sensed = trace.sensed[step]
    look: dict[str, Any] = {"color": style.RED, "linestyle": "", "markersize": 8}
    if sensed.any():
        axes.plot([], [], "o", **look, label="moving obstacle")
    if not sensed.all():
        axes.plot([], [], "o", markerfacecolor="none", **look, label="moving obstacle, not sensed")


def _draw_global(axes: Axes, grid: Grid, path: Plan) -> None:
    if len(path.cells):
        label = f"shortest path on the grid, {path.length:.2f} m"
        axes.plot(*path.xy(grid).T, color=style.INK, linewidth=1.2, linestyle=(0, (4, 2)), label=label, zorder=2.5)


def draw_ends(axes: Axes, start: Sequence[float], goal: Sequence[float]) -> None:
    """Mark the start by a circle and the goal by a star, each at (x, y) in m."""
    look: dict[str, Any] = {"linestyle": "", "markeredgecolor": style.INK, "clip_on": False, "zorder": 5.8}
    axes.plot(*start, marker="o", color="white", markersize=7, markeredgewidth=1.6, label="start", **look)
    axes.plot(*goal, marker="*", color=style.GOLD, markersize=13, markeredgewidth=0.9, label="goal", **look)


def _disc(axes: Axes, centre: NDArray[np.float64], radius: float, colour: str, *, zorder: float, filled: bool = True) -> None:
    face = colour if filled else "none"
    axes.add_patch(Circle((centre[0], centre[1]), radius, facecolor=face, edgecolor=colour, linewidth=1.2, zorder=zorder))
