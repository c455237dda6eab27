"""Charts: an encounter in space and time, a colony's pheromone, and results of the arena."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any

import numpy as np
import scipy
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, to_rgba
from matplotlib.figure import Figure
from numpy.typing import NDArray

from antway import checks
from antway.ants.gridpath import Exploration
from antway.arena import metrics
from antway.arena.store import Row
from antway.arena.summary import Summary
from antway.errors import BadParameter
from antway.grid import Grid, Moves
from antway.planning import Plan
from antway.view import style
from antway.view.figures import shortest
from antway.world.trace import Trace

_STEP = 0.05  # m; distance between the sampled points of a path
_LOOKS = tuple(zip(style.COLOURS, "os^DvP", style.DASHES, strict=True))  # of policies: colour, marker and line


@style.styled
def space_time_figure(trace: Trace, *, start: float = 0.0, end: float | None = None, path: Plan | None = None) -> Figure:
    """Draw the robot's progress along the global path against time, and the parts of the path that obstacles occupy.

    Parameters
    ----------
    trace : Trace
    start, end : float, float or None
        The span of time to draw, s; None: to the end.
    path : Plan or None
        The path; None: the shortest over the cells.

    Notes
    -----
    On the path the robot must avoid the occupied parts: it waits below them, or has passed above them. Off the path, drawn
    dotted, it makes a detour.
    """
    last = float(trace.t[-1])
    start = checks.number("start", start, low=0.0, high=last, unit="s")
    end = checks.number("end", last if end is None else end, low=start, high=last, unit="s")
    path = shortest(trace.task) if path is None else path
    if len(path.cells) < 2:
        raise BadParameter("path", path.status.value, "a path of two cells or more")
    points, along = _points(path.xy(trace.task.grid))
    rows = np.flatnonzero((trace.t >= start - 1e-9) & (trace.t <= end + 1e-9))
    t, xy = trace.t[rows], trace.xy[rows]
    away = np.hypot(*(xy[:, None] - points).transpose(2, 0, 1))
    progress = along[away.argmin(axis=1)]
    beside = away.min(axis=1) > trace.task.robot.radius / 2 + trace.task.grid.resolution / 4

    fig = style.figure(6.4, 4.2)
    axes = fig.subplots()
    half = trace.task.robot.dt / 2
    extent = (t[0] - half, t[-1] + half, along[0], along[-1])
    numbers: list[tuple[int, int, str]] = []
    for k, radius in enumerate(trace.obstacle_radius.tolist()):
        gap = np.hypot(*(trace.obstacle_xy[rows, k][:, None] - points).transpose(2, 0, 1))
        taken = gap < radius + trace.task.robot.radius
        if taken.any():
            look = ListedColormap([(0.0, 0.0, 0.0, 0.0), to_rgba(style.RED, 0.42)])
            axes.imshow(taken.T, origin="lower", extent=extent, aspect="auto", cmap=look, vmin=0, vmax=1, zorder=1)
            parts, count = scipy.ndimage.label(taken)
            middles = scipy.ndimage.center_of_mass(taken, parts, range(1, count + 1))
            numbers += [(round(when), round(where), str(trace.obstacle_id[k])) for when, where in middles]
    axes.plot([], [], "s", color=style.RED, alpha=0.42, markersize=9, label="taken by an obstacle (its number)")
    style.draw_path(axes, np.column_stack((t, progress)), style.BLUE, 2.0, label="robot")
    if beside.any():
        off = np.where(beside, progress, np.nan)
        axes.plot(t, off, color="white", linewidth=1.2, linestyle=(0, (1, 1.5)), zorder=3.5)
        axes.plot([], [], color=style.BLUE, linewidth=2.0, linestyle=(0, (1, 0.8)), label="robot beside the path")
    axes.set(xlabel="time (s)", ylabel="along the path (m)", title="The encounter in space and time")
    low, high = max(0.0, progress.min() - 2.0), min(along[-1], progress.max() + 3.0)
    axes.set(xlim=(t[0], t[-1] + 1e-9), ylim=(low, high))
    for when, where, words in _apart(numbers, 0.03 * len(t), 0.06 * (high - low) / _STEP):
        axes.text(t[when], along[where], words, ha="center", va="center", color=style.RED, weight="bold", clip_on=True)
    style.graph(axes, below=True)
    style.legend_below(axes)
    return fig


@style.styled
def pheromone_figure(grid: Grid, found: Exploration) -> Figure:
    """Draw the pheromone of a colony on every move, bolder for more, and the best path."""
    fig = style.figure(*style.map_size(grid))
    axes = fig.subplots()
    draw_pheromone(axes, grid, found, f"best path, {found.plan.length:.2f} m")
    axes.set_title("Pheromone on the moves between cells")
    style.legend_below(axes)
    return fig


def draw_pheromone(axes: Axes, grid: Grid, found: Exploration, words: str) -> None:
    """Draw the map, the pheromone relative to the strongest, and the best path, with `words` in the legend."""
    style.draw_map(axes, grid)
    tau, (row0, col0, _, _) = found.pheromone, found.window
    low, high = (float(tau[tau > 0.0].min()), float(tau.max())) if (tau > 0.0).any() else (0.0, 1.0)
    row, col, move = np.nonzero(tau > low + 0.02 * (high - low))
    here = np.column_stack((row + row0, col + col0))
    there = here + Moves.EIGHT.offsets[move]
    share = np.sqrt((tau[row, col, move] - low) / max(high - low, 1e-300))
    order = np.argsort(share, kind="stable")
    colours = style.PHEROMONE(0.25 + 0.75 * share[order])
    ends = np.stack((grid.to_xy(here), grid.to_xy(there)), axis=1)[order]
    widths = 0.6 + 3.4 * share[order]
    axes.add_collection(LineCollection(list(ends), colors=colours, linewidths=widths, capstyle="round", zorder=2))
    axes.plot([], [], color=style.PHEROMONE(1.0), linewidth=4.0, label="most pheromone")
    axes.plot([], [], color=style.PHEROMONE(0.45), linewidth=1.4, label="little")
    if len(found.plan.cells):
        style.draw_path(axes, found.plan.xy(grid), style.TEAL, 1.5, label=words)


@style.styled
def success_figure(table: Sequence[Summary]) -> Figure:
    """Draw the share of episodes that reached the goal, by level and policy, with 95 % intervals.

    Parameters
    ----------
    table : sequence of Summary
        From `antway.arena.summary.summarise`; rows over all levels are left out if there are others.
    """
    if not table:
        raise BadParameter("table", table, "at least one summary")
    levels = list(dict.fromkeys(row.level for row in table if row.level)) or [""]
    policies = list(dict.fromkeys(row.policy for row in table))
    fig = style.figure(6.0, 4.2)
    axes = fig.subplots()
    for k, (policy, (colour, marker, _)) in enumerate(zip(policies, cycle(_LOOKS))):
        rows = {row.level: row for row in table if row.policy == policy}
        known = [(i, rows[level]) for i, level in enumerate(levels) if level in rows]
        x = np.array([i for i, _ in known]) + 0.5 * (k - (len(policies) - 1) / 2) / max(len(policies), 2)
        share = np.array([100 * row.success for _, row in known])
        low, high = 100 * np.array([row.success_interval for _, row in known]).T
        bars = np.maximum([share - low, high - share], 0.0)
        look: dict[str, Any] = {"color": colour, "marker": marker, "linestyle": "", "markersize": 5}
        axes.errorbar(x, share, yerr=bars, capsize=2.5, elinewidth=1.0, **look)
        axes.plot([], [], label=policy, **look)
    axes.set_xticks(range(len(levels)), [level or "all" for level in levels])
    if sum(map(len, levels)) > 48:  # letters that fit side by side
        axes.tick_params("x", rotation=25)
    axes.set(xlabel="level", ylabel="reached (%)", title="Episodes in which the goal was reached")
    axes.set(ylim=(-3, 103), xlim=(-0.5, len(levels) - 0.5))
    style.graph(axes, below=True)
    style.legend_below(axes)
    return fig


@style.styled
def time_ratio_figure(rows: Sequence[Row]) -> Figure:
    """Draw for each policy the share of all episodes that reached the goal within a multiple of the clairvoyant optimum.

    Parameters
    ----------
    rows : sequence of Row
        Rows without a bound are left out; failed episodes count as never reached.
    """
    bound = [row for row in rows if np.isfinite(row.bound)]
    if not bound:
        raise BadParameter("rows", len(rows), "rows with a bound")
    fig = style.figure(6.0, 4.2)
    axes = fig.subplots()
    most = 1.0
    for policy, (colour, _, dash) in zip(dict.fromkeys(row.policy for row in bound), cycle(_LOOKS)):
        mine = [row for row in bound if row.policy == policy]
        reached = [row for row in mine if row.reached]
        ratio = np.sort(metrics.time_ratio([row.time for row in reached], [row.bound for row in reached]))
        share = 100 * np.arange(1, len(ratio) + 1) / len(mine)
        most = max(most, float(np.percentile(ratio, 98)) if len(ratio) else 1.0)
        x, y = np.concatenate(([0.0], ratio, [1e9])), np.concatenate(([0.0], share, share[-1:] if len(share) else [0.0]))
        axes.step(x, y, where="post", color=colour, linestyle=dash, linewidth=1.8, label=policy)
    axes.set(xlabel="time / optimum", ylabel="episodes (%)", title="Time over the clairvoyant optimum")
    axes.set(xlim=(0.95, 1.05 * most + 0.05), ylim=(-3, 103))
    style.graph(axes, below=True)
    style.legend_below(axes)
    return fig


def _points(nodes: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return points every `_STEP` m of a polyline, float64[M, 2], and their distances along it, m."""
    ends = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(nodes, axis=0).T))))
    along = np.linspace(0.0, ends[-1], max(2, int(ends[-1] / _STEP) + 1))
    return np.column_stack([np.interp(along, ends, nodes[:, i]) for i in (0, 1)]), along


def _apart(numbers: list[tuple[int, int, str]], wide: float, high: float) -> list[tuple[int, int, str]]:
    """Return the labels that do not overlap an earlier one."""
    kept: list[tuple[int, int, str]] = []
    for one in numbers:
        if all(abs(one[0] - other[0]) > wide or abs(one[1] - other[1]) > high for other in kept):
            kept.append(one)
    return kept
