"""Pictures of what `antway plan` finds besides a path: fronts of time, distance and clearance, and motions along a plan."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from antway.ants.timed_front import TimedFront
from antway.errors import BadParameter
from antway.grid import Grid
from antway.planning import Plan
from antway.trajectory.smooth import Smoothed
from antway.view import style
from antway.view.figures import draw_ends
from antway.world.robots import RobotSpec
from antway.world.timeline import Timeline

_PATHS = 6  # limit of paths, spread over the front
_OUTLINES = 12  # approximate number of outlines of the robot along its path
_SLOW_TO_FAST = "viridis"


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
    chosen = np.unique(np.linspace(0, len(front.paths) - 1, _PATHS).round().astype(int)).tolist()
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


@style.styled
def motion_figure(grid: Grid, path: Plan, smoothed: Smoothed, robot: RobotSpec) -> Figure:
    """Draw the motion of a smoothed plan on its map, which is not inflated, with outlines of the robot at equal time steps."""
    motion = smoothed.motion
    if motion is None:
        raise BadParameter("smoothed", smoothed.status.value, "an answer with a motion")
    width, height = style.map_size(grid)
    fig = style.figure(width, height + 1.7)
    axes, below = fig.subplots(2, 1, height_ratios=(height, 1.5))
    style.draw_map(axes, grid)
    axes.plot(*path.xy(grid).T, color=style.INK, linewidth=1.0, linestyle=(0, (4, 2)), label="plan", zorder=2.5)
    speed = np.hypot(*motion.velocity.T)
    steps = np.stack((motion.xy[:-1], motion.xy[1:]), axis=1)
    line = LineCollection(list(steps), cmap=_SLOW_TO_FAST, linewidth=2.2, zorder=4)
    line.set_array((speed[:-1] + speed[1:]) / 2.0)
    line.set_clim(0.0, robot.v_max)
    axes.add_collection(line)
    fig.colorbar(line, ax=axes, label="speed (m/s)", fraction=0.03, pad=0.02)
    for when in np.linspace(0.0, motion.time, _OUTLINES):
        x, y, heading = (float(np.interp(when, motion.t, one)) for one in (*motion.xy.T, motion.heading))
        if robot.footprint is None:
            outline: Circle | Polygon = Circle((x, y), robot.radius)
        else:
            cos, sin = np.cos(heading), np.sin(heading)
            outline = Polygon(robot.corners @ np.array([[cos, sin], [-sin, cos]]) + (x, y))
        outline.set(fill=False, edgecolor=style.BLUE, linewidth=0.8, zorder=3)
        axes.add_patch(outline)
    ring: dict[str, Any] = {"color": style.BLUE, "markerfacecolor": "none", "markersize": 8, "markeredgewidth": 0.8}
    axes.plot([], [], "o", label="robot, at equal time steps", **ring)
    axes.set_title(f"Smoothed plan: {motion.time:.1f} s, {motion.length:.2f} m, {smoothed.how}")
    below.plot(motion.t, speed, color=style.BLUE, linewidth=1.4, label="speed (m/s)")
    if robot.wheels:
        below.plot(motion.t, motion.turn_rate, color=style.ORANGE, linewidth=1.2, label="turn rate (rad/s)")
    below.set_xlabel("time (s)")
    style.graph(below)
    below.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2, frameon=False)
    return style.legend_below(axes, columns=2)
