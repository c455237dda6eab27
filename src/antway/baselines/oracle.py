"""Policy `oracle`, which knows where every obstacle will be and drives the path that arrives first."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from antway import checks
from antway.baselines.replan import arrival_time, drive, searches_for
from antway.errors import BadParameter
from antway.kernels.base.records import Trajectories
from antway.kernels.baselines.oracle import first_contact
from antway.planning import TimedPath
from antway.search.sipp import Sipp
from antway.world.policy import Command, Decision, Observation, Task, Tracks
from antway.world.terrain import terrain_of
from antway.world.timeline import Timeline

MARGINS = (0.0, 0.1, 0.25, 0.5, 1.0, 2.0, 4.0)  # margins tried, in units of the deviation from a plan between two commands
NEAR = 2.0  # m; nearer to the goal's tolerance than this, a path that waits may go straight into it
LATER = 600.0  # s; a goal that is taken so long after the last known motion counts as free then, and the path waits beside it
MOST = 1000  # times in a wait at which it is tried
GRAZE = 1e-6  # m; allowance for rounding of touches and arrivals


class Oracle:
    """Search in space and time once, by SIPP over 32 directions with known futures, and drive the result.

    The path ends at the goal or elsewhere within its tolerance, whichever is sooner.

    Between two commands the robot moves straight, so it deviates by up to v_max dt / 2 from a plan that turns or starts in
    between. The policy takes the plan with the smallest margin that touches nothing when it is driven in simulation. Obstacles
    that follow the robot have no known future; they are assumed to stand.

    Source: Phillips, Likhachev: SIPP: Safe Interval Path Planning for Dynamic Environments, ICRA 2011.
    """

    timeline: Timeline | None = None

    def foresee(self, timeline: Timeline) -> None:
        """Learn where every obstacle will be."""
        self.timeline = timeline

    def reset(self, task: Task, seed: int) -> None:
        """Plan the whole path, from 0 s on; `foresee` comes before."""
        checks.instance("task", task, Task)
        checks.seed(seed)
        if self.timeline is None:
            raise BadParameter("policy", "oracle", "another where the future is not known: `foresee` has not been called")
        self.task, self.is_first = task, True
        self._plan(0.0)

    def _plan(self, t: float) -> None:
        """Plan the whole path from `t` s on."""
        assert self.timeline is not None
        task, robot, known = self.task, self.task.robot, self.timeline
        self.path = TimedPath(np.empty(0), np.empty((0, 2)))
        self.decision = Decision("stuck", "no path reaches the goal among the known motions")
        horizon = float(known.knot_t.max(initial=t)) + LATER
        searches = searches_for(task)
        for share in MARGINS:
            wide = known.radius + share * robot.v_max * robot.dt / 2
            for path in paths_to_goal(task, searches, replace(known, radius=wide), t, horizon):
                if len(path.t) and self._touches_nothing(path, t, known):
                    self.path = path
                    self.decision = Decision(
                        "follow", "the path that arrives first among the known motions", path=path, gap=0.0
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

    def _touches_nothing(self, path: TimedPath, start: float, line: Timeline) -> bool:
        """Tell whether driving the path from `start` s on touches no obstacle and no wall."""
        task, dt = self.task, self.task.robot.dt
        t, xy, at = [start], [task.start], task.start
        while math.dist(at, task.goal) > task.goal_tolerance and t[-1] < path.t[-1] + 1.0:
            velocity = drive(task, Observation(t[-1], at, (0.0, 0.0), 0.0, Tracks.none()), path).velocity
            at = at[0] + velocity[0] * dt, at[1] + velocity[1] * dt
            t.append(start + len(t) * dt)
            xy.append(at)
        driven = TimedPath(np.array(t), np.array(xy))
        end = arrival_time(driven, task)  # within the last step, or behind it
        if end < t[-1]:
            before = driven.t < end
            driven = TimedPath(np.append(driven.t[before], end), np.vstack((driven.xy[before], driven.at(end))))
        discs = Trajectories(line.knot_t, line.knot_xy, line.first, line.radius + GRAZE)
        contact = first_contact(driven.t, driven.xy, task.robot.radius, terrain_of(task.grid), discs)
        return contact == math.inf


def paths_to_goal(
    task: Task, searches: list[Sipp], timeline: Timeline | None, t: float = 0.0, horizon: float = math.inf
) -> list[TimedPath]:
    """Return paths from `t` s on, that which arrives first in front.

    They are those of `searches_for`; where they would wait near the goal, they go straight into the tolerance if that is free.
    Without a timeline nothing moves.
    """
    paths = [each.plan(task.start, timeline, t=t, horizon=horizon).path for each in searches]
    if timeline is not None:
        paths = [_straight_in(path, task, timeline) for path in paths]
    return sorted(paths, key=lambda path: arrival_time(path, task))


def _straight_in(path: TimedPath, task: Task, timeline: Timeline) -> TimedPath:
    """Return the path or, where it waits near the goal, one that goes straight into the tolerance as soon as that is free."""
    best, least, goal, radius = path, arrival_time(path, task), np.asarray(task.goal), task.robot.radius - GRAZE
    for i in range(len(path.t) - 1):
        xy, away = path.xy[i], math.dist(path.xy[i], goal)
        if not 0.0 < away - task.goal_tolerance < NEAR or (path.xy[i + 1] != xy).any():
            continue
        length = away - task.goal_tolerance + GRAZE  # a little inside
        wait = path.t[i + 1] - path.t[i]
        for t in np.linspace(path.t[i], path.t[i + 1], min(math.ceil(wait / task.robot.dt), MOST), endpoint=False):
            end = t + length / task.robot.v_max
            times, places = np.array([t, end]), np.vstack((xy, xy + (goal - xy) * (length / away)))
            if end < least and first_contact(times, places, radius, terrain_of(task.grid), timeline.trajectories) == math.inf:
                last = slice(int(t == path.t[i]), 2)
                best, least = (
                    TimedPath(np.append(path.t[: i + 1], times[last]), np.vstack((path.xy[: i + 1], places[last]))),
                    end,
                )
                break
    return best
