"""People of a recording who appear beside the robot: they are not there until they are farther off."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from antway.world.motions import Replay
from antway.world.policy import Task
from antway.world.timeline import Timeline
from antway.world.world import World

NEAR = 1.0  # m between the centres; whoever appears so near to the robot is not there yet
_FAR = 1000.0  # m from the robot; where whoever is not there is put, straight away from the robot
_INSTANT = 1e-6  # s; somebody leaves so long after a scan and is back so long before one, so that none sees it on its way


class Entries:
    """Who of one episode appears, and who of them is not there yet.

    A `Replay` whose record starts in the episode is looked at in the first control period after that: where its centre is
    within NEAR of the robot's, it is taken out of the world until a period at whose end it is farther off than that and the
    way that the robot can make meanwhile. Its trajectory then says so: it is `_FAR` away in between.
    """

    def __init__(self, world: World, task: Task) -> None:
        motions = [(k, one.motion) for k, one in enumerate(world.obstacles) if isinstance(one.motion, Replay)]
        self.task = task
        self.due = sorted((motion.record_start, k) for k, motion in motions if motion.record_start > 0.0)
        self.away: dict[int, tuple[Replay, NDArray[np.float64]]] = {}  # the motion, and where it was put
        self.motions = dict(motions)

    def go(self, i: int, robot: tuple[float, float], line: Timeline) -> Timeline:
        """Return the timeline from control period i on, at the start of which the robot is at `robot` (m)."""
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
    """Return two far places on a path round the origin from the far place `start` to `end`, float64[2, 2]."""
    ahead = end / math.hypot(*end)
    side = np.array([-ahead[1], ahead[0]])
    if float(side @ start) < 0.0:
        side = -side
    return np.vstack((side if float(ahead @ start) < 0.0 else ahead, ahead)) * _FAR


def _with(line: Timeline, changed: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]) -> Timeline:
    """Return the timeline with other trajectories of some discs."""
    parts = [changed.get(k, (line.knot_t[a:b], line.knot_xy[a:b])) for k, (a, b) in enumerate(pairwise(line.first.tolist()))]
    return Timeline.of(line.id.tolist(), line.radius.tolist(), parts)
