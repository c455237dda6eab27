"""Charts of colonies: pheromone over time, convergence over seeds, sensitivity to a parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.ants.gridpath import Exploration
from antway.errors import BadParameter
from antway.grid import Grid, Moves
from antway.view import style


@style.styled
def pheromone_over_time_figure(grid: Grid, found: Mapping[int, Exploration]) -> Figure:
    """Draw pheromone and best path after several numbers of cycles, side by side.

    Parameters
    ----------
    grid : Grid
    found : mapping of int to Exploration
        By number of cycles: `explore` with the same problem and seed shows the same colony at several times.

    Examples
    --------
    >>> from antway import Problem
    >>> from antway.ants.gridpath import explore
    >>> grid = Grid(np.zeros((9, 9), dtype=bool))
    >>> problem = Problem(grid, (0, 0), (8, 8))
    >>> figure = pheromone_over_time_figure(grid, {t: explore(problem, cycles=t, ants=10, seed=1) for t in (1, 4)})
    """
    if not found:
        raise BadParameter("found", found, "at least one exploration")
    width, height = style.map_size(grid, width=3.6)
    fig = style.figure(width * len(found), height)
    row = fig.subplots(1, len(found), squeeze=False)[0]
    for axes, (cycles, exploration) in zip(row, found.items()):
        _draw_pheromone(axes, grid, exploration)
        best = f": {exploration.plan.length:.2f} m" if len(exploration.plan.cells) else ""
        axes.set_title(f"{cycles} cycle" + "s" * (cycles != 1) + best)
        if axes is not row[0]:
            axes.set_ylabel("")
    style.legend_below(row[-1])
    fig.suptitle("Pheromone over time")
    return fig


def _draw_pheromone(axes: Axes, grid: Grid, found: Exploration) -> None:
    """Draw the map, the pheromone relative to the strongest, and the best path."""
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
        style.draw_path(axes, found.plan.xy(grid), style.TEAL, 1.5, label="best path")


@style.styled
def seeds_figure(histories: Mapping[str, Sequence[NDArray[np.float64]]], *, optimum: float | None = None) -> Figure:
    """Draw the best length against the number of tours: the median over seeds, and the 10th to 90th percentiles.

    Parameters
    ----------
    histories : mapping of name to sequence of float64[h, 3]
        For each colony (at most six) the `Tour.history` of each seed.
    optimum : float or None
        If it is known, the gap to it is drawn, %.
    """
    if not 0 < len(histories) <= len(style.COLOURS) or not all(histories.values()):
        raise BadParameter("histories", list(histories), f"one to {len(style.COLOURS)} colonies of one or more seeds each")
    runs = {
        name: [checks.array(f"history of {name}", history, (None, 3)) for history in group] for name, group in histories.items()
    }
    for name, group in runs.items():
        if not all(len(run) for run in group):
            raise BadParameter(f"history of {name}", "no rows", "one row or more for each seed")
    last = max(run[-1, 0] for group in runs.values() for run in group)
    first = max(run[0, 0] for group in runs.values() for run in group)
    made = np.geomspace(first, max(last, 2 * first), 200)
    axes = style.figure(6.4, 4.4).subplots()
    for (name, group), colour, dash in zip(runs.items(), style.COLOURS, style.DASHES):
        best = np.array([run[np.searchsorted(run[:, 0], made * (1 + 1e-12), side="right") - 1, 1] for run in group])
        low, middle, high = np.quantile(best if optimum is None else 100 * (best / optimum - 1), (0.1, 0.5, 0.9), axis=0)
        axes.fill_between(made, low, high, color=colour, alpha=0.18, linewidth=0)
        axes.plot(made, middle, color=colour, linestyle=dash, linewidth=1.8, label=f"{name} ({len(group)} seeds)")
    axes.fill_between([], [], [], color=style.INK, alpha=0.18, linewidth=0, label="10th to 90th percentile; lines: median")
    axes.set(xscale="log", xlabel="tours made", title="Convergence over seeds")
    axes.set_ylabel("best length" if optimum is None else "over the optimum (%)")
    style.graph(axes)
    return style.legend_below(axes, columns=2)


@style.styled
def sensitivity_figure(parameter: str, values: Sequence[float], lengths: ArrayLike, *, optimum: float | None = None) -> Figure:
    """Draw the quality of answers against one parameter: a dot for each seed, and a line for the mean.

    Parameters
    ----------
    parameter : str
        Its name.
    values : sequence of float[V]
    lengths : array_like[V, S]
        Best length for each value and seed.
    optimum : float or None
        If it is known, the gap to it is drawn, %.
    """
    at = checks.array("values", values, (None,))
    table = checks.array("lengths", lengths, (len(at), None))
    if not table.shape[1]:
        raise BadParameter("lengths.shape", table.shape, "of one seed or more for each value")
    shown = table if optimum is None else 100 * (table / optimum - 1)
    axes = style.figure(5.6, 4.0).subplots()
    axes.plot(np.repeat(at, table.shape[1]), shown.ravel(), "o", color=style.CYAN, markersize=4, alpha=0.6, label="one seed")
    axes.plot(at, shown.mean(axis=1), color=style.BLUE, linewidth=1.8, marker="D", markersize=5, label="mean")
    axes.set(xlabel=parameter, ylabel="best length" if optimum is None else "over the optimum (%)")
    axes.set_title(f"Sensitivity to {parameter}")
    style.graph(axes)
    return style.legend_below(axes)
