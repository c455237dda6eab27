"""People of a recording who would appear next to the robot: they are absent until they are farther away."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from antway.world.motions import Replay
from antway.world.policy import Task
from antway.world.timeline import Timeline
from antway.world.world import World

NEAR = 1.0  # m; a person who appears at a smaller distance of centres from the robot is absent at first
_FAR = 1000.0  # m; distance from the robot at which absent people are placed
_INSTANT = 1e-6  # s; people leave this long after a scan and return this long before one, so that no scan sees them move


class Entries:
    """The people who appear during an episode, and those who are absent at present.

    A `Replay` whose record starts during the episode is examined in the next control period. If its centre is within NEAR of
    the robot's, it is removed from the world until the end of a period at which its distance exceeds NEAR plus the distance
    that the robot can drive in the period. Meanwhile its trajectory is `_FAR` away.
    """

    def __init__(self, world: World, task: Task) -> None:
        motions = [(k, one.motion) for k, one in enumerate(world.obstacles) if isinstance(one.motion, Replay)]
        self.task = task
        self.due = sorted((motion.record_start, k) for k, motion in motions if motion.record_start > 0.0)
        self.away: dict[int, tuple[Replay, NDArray[np.float64]]] = {}  # the motion, and the far place
        self.motions = dict(motions)

    def go(self, i: int, robot: tuple[float, float], line: Timeline) -> Timeline:
        """Return the timeline for control period i, at the start of which the robot is at `robot` (m)."""
        dt, changed = self.task.robot.dt, {}
        t, here = i * dt, np.array(robot)
        for k, (motion, far) in list(self.away.items()):
            knot_t, xy = (np.array(part) for part in (motion.t, motion.points))
            soon = t + dt - _INSTANT  # before the next scan
            there = _place(knot_t, xy, soon) - here
            farthest = max(NEAR, self.task.robot.radius + float(line.radius[k])) + self.task.robot.v_max * dt
            if math.hypot(*there) > farthest:
                del self.away[k]
                old_t, old_xy = line.trajectory(k)
                late = knot_t > soon
                back = _round(far - here, there) + here
                times = np.array([t, t + dt / 4, t + dt / 2, soon])
                places = np.vstack((far, back, there + here))
                changed[k] = np.concatenate((old_t, times, knot_t[late])), np.vstack((old_xy, places, xy[late]))
        while self.due and self.due[0][0] <= t + 1e-9:
            _, k = self.due.pop(0)
            knot_t, xy = line.trajectory(k)
            at = _place(knot_t, xy, t)
            apart = math.dist(at, robot)
            if 0.0 < apart <= NEAR:
                far = here + (at - here) * (_FAR / apart)
                self.away[k] = self.motions[k], far
                known = knot_t < t - 1e-9
                times = np.array([t, t + _INSTANT, t + dt / 2])
                places = np.vstack((at, _place(knot_t, xy, t + _INSTANT), far))
                changed[k] = np.concatenate((knot_t[known], times)), np.vstack((xy[known], places))
        return _with(line, changed) if changed else line


def _place(t: NDArray[np.float64], xy: NDArray[np.float64], when: float) -> NDArray[np.float64]:
    return np.array([np.interp(when, t, xy[:, 0]), np.interp(when, t, xy[:, 1])])


def _round(start: NDArray[np.float64], end: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return two far places on a path around the origin from the far place `start` to `end`, float64[2, 2]."""
    ahead = end / math.hypot(*end)
    side = np.array([-ahead[1], ahead[0]])
    if float(side @ start) < 0.0:
        side = -side
    return np.vstack((side if float(ahead @ start) < 0.0 else ahead, ahead)) * _FAR


def _with(line: Timeline, changed: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]) -> Timeline:
    """Return the timeline with the trajectories of some discs replaced."""
    parts = [changed.get(k, (line.knot_t[a:b], line.knot_xy[a:b])) for k, (a, b) in enumerate(pairwise(line.first.tolist()))]
    return Timeline.of(line.id.tolist(), line.radius.tolist(), parts)
