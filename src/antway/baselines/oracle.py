"""Policy `oracle`, which knows where every obstacle will be and drives the path that arrives first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from antway.baselines.replan import drive
from antway.kernels.base.records import Trajectories
from antway.kernels.baselines.oracle import first_contact
from antway.planning import TimedPath
from antway.search.sipp import Sipp
from antway.world.line_of_sight import goal_of_cells
from antway.world.policy import Command, Decision, Observation, Task, Tracks
from antway.world.terrain import terrain_of
from antway.world.timeline import Timeline

MARGINS = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # margins tried, in units of the deviation from a plan between two commands
GRAZE = 1e-6  # m; allowance for rounding of touches and arrivals


class Oracle:
    """Search in space and time once, by SIPP over 32 directions with known futures, and drive the result.

    Between two commands the robot moves straight, so it deviates by up to v_max dt / 2 from a plan that turns or starts in
    between. The policy takes the plan with the smallest margin that touches nothing when it is driven in simulation. Obstacles
    that follow the robot have no known future; they are assumed to stand.

    Source: Phillips, Likhachev: SIPP: Safe Interval Path Planning for Dynamic Environments, ICRA 2011.
    """

    def foresee(self, timeline: Timeline) -> None:
        """Learn where every obstacle will be."""
        self.timeline = timeline

    def reset(self, task: Task, seed: int) -> None:
        """Plan the whole path, from 0 s on."""
        self.task, self.is_first = task, True
        self._plan(0.0)

    def _plan(self, t: float) -> None:
        """Plan the whole path from `t` s on."""
        task, robot = self.task, self.task.robot
        self.path = TimedPath(np.empty(0), np.empty((0, 2)))
        self.decision = Decision("stuck", "no path reaches the goal among the known motions")
        search = Sipp(task.grid, goal_of_cells(task), radius=robot.radius, v_max=robot.v_max)
        for share in MARGINS:
            wide = self.timeline.radius + share * robot.v_max * robot.dt / 2
            plan = search.plan(task.start, replace(self.timeline, radius=wide), t=t)
            if math.isfinite(plan.arrival) and self._touches_nothing(plan.path, t):
                self.path = plan.path
                self.decision = Decision(
                    "follow", "the path that arrives first among the known motions", path=plan.path, gap=0.0
                )
                return

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period."""
        if self.is_first and observation.t > 0.0:  # as on the way to the next of several stops
            self._plan(observation.t)
        self.is_first = False
        return drive(self.task, observation, self.path)

    def explain(self) -> Decision:
        """Return the plan."""
        return self.decision

    def _touches_nothing(self, path: TimedPath, start: float) -> bool:
        """Tell whether driving the path from `start` s on touches no obstacle and no wall."""
        task, line, dt = self.task, self.timeline, self.task.robot.dt
        t, xy, at = [start], [task.start], task.start
        while math.dist(at, task.goal) > task.goal_tolerance - GRAZE and t[-1] < path.t[-1] + 1.0:
            velocity = drive(task, Observation(t[-1], at, (0.0, 0.0), 0.0, Tracks.none()), path).velocity
            at = at[0] + velocity[0] * dt, at[1] + velocity[1] * dt
            t.append(start + len(t) * dt)
            xy.append(at)
        discs = Trajectories(line.knot_t, line.knot_xy, line.first, line.radius + GRAZE)
        contact = first_contact(np.array(t), np.array(xy), task.robot.radius, terrain_of(task.grid), discs)
        return contact == math.inf
