"""People of a recording who would appear next to the robot: they are absent until they are farther away."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from antway.world.motions import Replay, place_at
from antway.world.policy import Task
from antway.world.timeline import Timeline, Trajectory
from antway.world.world import World

NEAR = 1.0  # m; a person who appears at a smaller distance of centres from the robot is absent at first
_FAR = 1000.0  # m; distance from the robot at which absent people are placed
_INSTANT = 1e-6  # s; people leave at most so long after a scan and return so long before one, so that no scan sees them move

Place = NDArray[np.float64]  # float64[2], m


class Entries:
    """The people who appear during an episode, and those who are absent at present.

    A `Replay` whose record starts during the episode is examined in the next control period. If its centre is within NEAR of
    the robot's, it is removed from the world until the end of a period at which its distance exceeds NEAR plus the distance
    that the robot can drive in the period. Meanwhile its trajectory is `_FAR` away.
    """

    def __init__(self, world: World, task: Task) -> None:
        self.motions = {k: one.motion for k, one in enumerate(world.obstacles) if isinstance(one.motion, Replay)}
        self.task, self.instant = task, min(_INSTANT, task.robot.dt / 8)
        self.due = sorted((motion.record_start, k) for k, motion in self.motions.items() if motion.record_start > 0.0)
        self.absent: dict[int, Place] = {}  # by number, the far place at which each is kept

    def update(self, i: int, robot: tuple[float, float], line: Timeline) -> Timeline:
        """Return the timeline for control period i, at the start of which the robot is at `robot` (m)."""
        t, here = i * self.task.robot.dt, np.array(robot)
        found = {k: self._return(k, t, here, line) for k in list(self.absent)}
        while self.due and self.due[0][0] <= t + 1e-9:
            _, k = self.due.pop(0)
            found[k] = self._leave(k, t, here, line)
        changed = {k: trajectory for k, trajectory in found.items() if trajectory is not None}
        return line.with_trajectories(changed) if changed else line

    def _return(self, k: int, t: float, here: Place, line: Timeline) -> Trajectory | None:
        """Return the trajectory of an absent person who comes back in the control period from time t; None if too near."""
        (recorded_t, recorded_xy), robot = self.motions[k].arrays, self.task.robot
        end = t + robot.dt - self.instant  # before the next scan
        offset = place_at((recorded_t, recorded_xy), end) - here
        if math.hypot(*offset) <= max(NEAR, robot.radius + float(line.radius[k])) + robot.v_max * robot.dt:
            return None
        far = self.absent.pop(k)
        old_t, old_xy = line.trajectory(k)
        later = recorded_t > end
        times = np.array([t, t + robot.dt / 4, t + robot.dt / 2, end])
        places = np.vstack((far, _detour(far - here, offset) + here, offset + here))
        return np.concatenate((old_t, times, recorded_t[later])), np.vstack((old_xy, places, recorded_xy[later]))

    def _leave(self, k: int, t: float, here: Place, line: Timeline) -> Trajectory | None:
        """Return the trajectory of a person who would appear next to the robot at time t and leaves; None for any other."""
        knot_t, xy = trajectory = line.trajectory(k)
        place = place_at(trajectory, t)
        apart = math.dist(place, here)
        if apart > NEAR:
            return None
        far = self.absent[k] = here + (place - here) * (_FAR / apart)
        known = knot_t < t - 1e-9
        times = np.array([t, t + self.instant, t + self.task.robot.dt / 2])
        places = np.vstack((place, place_at(trajectory, t + self.instant), far))
        return np.concatenate((knot_t[known], times)), np.vstack((xy[known], places))


def _detour(start: Place, end: Place) -> NDArray[np.float64]:
    """Return two far places on a path around the origin from the far place `start` to `end`, float64[2, 2]."""
    ahead = end / math.hypot(*end)
    side = np.array([-ahead[1], ahead[0]])
    if float(side @ start) < 0.0:
        side = -side
    return np.vstack((side if float(ahead @ start) < 0.0 else ahead, ahead)) * _FAR
