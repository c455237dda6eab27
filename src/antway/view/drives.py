"""A picture of a smoothed plan: the motion on the map, coloured by speed, and its speed and turn rate over time."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon

from antway.errors import BadParameter
from antway.grid import Grid
from antway.planning import Plan
from antway.trajectory.smooth import Smoothed
from antway.view import style
from antway.world.robots import RobotSpec

_SHOWN = 12  # approximate number of outlines of the robot along its path
_SLOW_TO_FAST = "viridis"


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
    for when in np.linspace(0.0, motion.time, _SHOWN):
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
