"""Obstacles that follow the robot: their trajectories grow by one control period at a time."""

from __future__ import annotations

import math

import numpy as np

from antway.grid import Grid
from antway.kernels.base.geometry import first_wall
from antway.world.motions import Draw, Pursue
from antway.world.policy import XY, Task
from antway.world.timeline import Timeline
from antway.world.world import World


class Pursuit:
    """The pursuers of one episode, in a timeline of all obstacles.

    The trajectory of a pursuer is known up to the end of the present control period; then it stands.
    """

    def __init__(self, world: World, task: Task, seed: int, horizon: float, steps: int) -> None:
        self.task, self.timeline = task, world.timeline(seed, horizon)
        chosen = [(k, one.radius, one.motion) for k, one in enumerate(world.obstacles) if isinstance(one.motion, Pursue)]
        self.pursuers = [(k, radius, motion.drawn(Draw(seed, k))) for k, radius, motion in chosen]
        if chosen:
            t = np.arange(steps + 1, dtype=np.float64) * task.robot.dt
            stands = {k: (t, np.full((steps + 1, 2), motion.start)) for k, _, motion in chosen}
            self.use(self.timeline.with_trajectories(stands))

    def use(self, whole: Timeline) -> Timeline:
        """Continue with another timeline, in which the pursuers have the same knots; return it."""
        self.timeline = whole
        if self.pursuers:
            self.xy = whole.knot_xy.copy()
            live = self.xy.view()  # the timeline makes the view read-only, not the array
            self.timeline = Timeline(whole.id, whole.radius, whole.knot_t, live, whole.first)
        return self.timeline

    def extend(self, i: int, robot: XY) -> None:
        """Extend the trajectories by control period i, at the start of which the robot is at `robot` (m)."""
        t, dt = i * self.task.robot.dt, self.task.robot.dt
        for k, radius, (speed, gap, delay, follow_time) in self.pursuers:
            knots = self.xy[self.timeline.first[k] : self.timeline.first[k + 1]]
            if not delay <= t < delay + follow_time or i + 1 == len(knots):
                continue
            x, y = knots[i].tolist()
            away = math.dist((x, y), robot)
            left = away - radius - self.task.robot.radius - gap
            if left > 0.0:
                share = min(speed * dt, left) / away
                knots[i + 1 :] = _slide(self.task.grid, radius, (x, y), robot, share)


def _slide(grid: Grid, radius: float, at: XY, to: XY, share: float) -> XY:
    """Return the end of a disc's step, the fraction `share` from `at` to `to` (m), that slides along the first wall."""
    (x0, y0, _), size = grid.origin, grid.resolution
    row, col = (at[1] - y0) / size - 0.5, (at[0] - x0) / size - 0.5
    dr, dc = (to[1] - at[1]) * share / size, (to[0] - at[0]) * share / size
    for _ in range(2):
        gone, n_row, n_col = first_wall(grid.blocked, row, col, dr, dc, radius / size)
        part = min(gone, 1.0)
        row, col = row + dr * part, col + dc * part
        into = dr * n_row + dc * n_col
        dr, dc = (dr - into * n_row) * (1.0 - part), (dc - into * n_col) * (1.0 - part)
    return x0 + (col + 0.5) * size, y0 + (row + 0.5) * size
