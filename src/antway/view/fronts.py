"""Pictures of fronts of time, distance and clearance among moving obstacles."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from antway.ants.timed_front import TimedFront
from antway.errors import BadParameter
from antway.grid import Grid
from antway.view import style
from antway.view.figures import draw_ends
from antway.world.timeline import Timeline

_SHOWN = 6  # limit of paths, spread over the front


@style.styled
def front_figure(grid: Grid, front: TimedFront, obstacles: Timeline | None = None) -> Figure:
    """Draw paths of a front on the map, and the whole front as distance against time, with clearances as numbers.

    Parameters
    ----------
    grid : Grid
        The map, not inflated.
    front : TimedFront
        With at least one path; if there are more than six, six are drawn.
    obstacles : Timeline or None
        Moving obstacles, drawn as circles at their initial places, with tracks up to the last arrival.

    Examples
    --------
    >>> from antway import Problem
    >>> from antway.ants.timed_front import timed_front
    >>> grid = Grid(np.zeros((5, 7), dtype=bool))
    >>> figure = front_figure(grid, timed_front(Problem(grid, (2, 0), (2, 6)), radius=0.3))
    """
    if not len(front.paths):
        raise BadParameter("front", front.status.value, "a front with a path")
    width, height = style.map_size(grid, width=5.2)
    left, right = style.figure(2 * width, height).subplots(1, 2)
    style.draw_map(left, grid)
    last = float(front.values[-1, 0])
    if obstacles is not None and len(obstacles):
        tracks = obstacles.places(np.linspace(0.0, last, 200)).transpose(1, 0, 2)
        for track, radius in zip(tracks, obstacles.radius.tolist()):
            left.plot(*track.T, color=style.RED, linewidth=0.9, alpha=0.5)
            left.add_patch(Circle((track[0, 0], track[0, 1]), radius, fill=False, edgecolor=style.RED, zorder=3))
        look: dict[str, Any] = {"color": style.RED, "markerfacecolor": "none", "markersize": 8, "linewidth": 0.9}
        left.plot([], [], "o-", label="obstacle when the robot starts, and its track", **look)
    chosen = np.unique(np.linspace(0, len(front.paths) - 1, _SHOWN).round().astype(int)).tolist()
    others = np.delete(front.values, chosen, axis=0)
    if len(others):
        grey: dict[str, Any] = {"color": style.RULE, "markeredgecolor": style.INK, "markersize": 6}
        right.plot(*others[:, :2].T, "o", label="path that is not on the map", **grey)
    for i, colour, dash in zip(chosen, style.COLOURS, style.DASHES):
        time, distance, clearance = front.values[i].tolist()
        label = f"{time:.1f} s, {distance:.1f} m, clearance {clearance:.2f} m"
        left.plot(*front.paths[i].xy.T, color=colour, linestyle=dash, linewidth=1.8, label=label, zorder=4)
        right.plot(time, distance, "o", color=colour, markersize=8, zorder=3)
    for time, distance, clearance in front.values.tolist():
        right.annotate(f"{clearance:.2f}", (time, distance), (0, 7), textcoords="offset points", ha="center", fontsize=7.0)
    draw_ends(left, *front.paths[0].xy[[0, -1]])
    left.set_title("Trade-offs of time, distance and clearance")
    count = f"{len(front.paths)} path{'' if len(front.paths) == 1 else 's'}"
    right.set(title=f"The front: {count}, with clearance in m", xlabel="time (s)", ylabel="distance (m)")
    style.graph(right)
    right.margins(0.12)
    return style.legend_below(left, columns=3, more=list(zip(*right.get_legend_handles_labels())))
