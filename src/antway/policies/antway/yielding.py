"""Giving way: out of a passage of one width in which the robot and somebody else wait for one another, and after a dance."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.ndimage import distance_transform_edt

from antway.kernels.base.arrays import Bools, Floats
from antway.kernels.base.jit import call
from antway.kernels.base.rng import State, uniform
from antway.kernels.spacetime.context import PlanningContext
from antway.kernels.tracking import stays
from antway.kernels.tracking.table import SEEN, TRACK_ID, rows_in_use
from antway.policies.antway.detours import Detours, diagonals, middles, node_near, without
from antway.search.sipp import timed_field
from antway.world.policy import XY, Observation, Task

_WAIT = 5.0  # s; an obstacle that has stayed for this long may be waiting for the robot, and the robot for the obstacle
_UNSURE = 20.0  # s; the same for an obstacle that was not seen to come, or that the robot could pass but does not
_LONGEST = 40.0  # s; if the obstacle does not use the room, the robot waits for twice as long the next time, up to this
_CAME = 0.4  # m; an obstacle that has moved this far since it was first seen counts as one that came here
_GAP = 0.3  # m; gap that the robot leaves to the obstacle that passes it
_TOLERANCE = 0.15  # m; the robot drives to its refuge as nearly as this
_WALKS = 2.0  # s; an obstacle that has stayed for less than this may be walking
_SCANS = 9  # number of scans, a quarter of a second apart, by which it is told whether the robot goes to and fro
_MOVES = 0.25  # 1; a robot that goes to and fro drives faster than this share of its top speed, and the obstacle leaves slower
_TO_AND_FRO = 0.35  # 1; it ends nearer to where it began than this share of the distance driven
_PROGRESS = 0.3  # s; meanwhile its time to the goal falls by less than this
_AGAIN = 1.0  # s; an obstacle counts as going to and fro once it has been in sight for this time
_PAUSE = 1.0, 3.0  # s; the robot then stands for a time between these


class Yielding:
    """Tells when the robot and an obstacle wait for each other, and where the robot lets the obstacle pass.

    They do if both have stayed for long, and no path leads the obstacle past the robot. The refuge is the nearest place beside
    its path out, which is taken to lead past the robot to the robot's start, and to the farthest place behind it. The robot
    waits there until the obstacle has passed, or has stayed for long again, and then drives on to its goal.
    """

    def __init__(self) -> None:
        self._wait = _WAIT
        self._place, self._since = (math.inf, math.inf), 0.0  # where the robot stays, and since when
        self._due = -math.inf  # s; the next look
        self._asked: Task | None = None  # what the robot goes on with; None while it gives no way
        self._other = -1.0  # the id of whom it gives way to

    def __str__(self) -> str:
        return "" if self._asked is None else "the robot gives way to an obstacle that waits for it"

    def asked(self, task: Task) -> Task:
        """Return the task that the robot was given, with the robot of `task`."""
        a = self._asked
        return task if a is None else replace(task, goal=a.goal, goal_tolerance=a.goal_tolerance, stay=a.stay)

    def next_task(self, task: Task, detours: Detours, t: float, xy: XY) -> Task:
        """Return `task`, or what the robot at `xy` is to do instead from now, `t` s, on: drive to a refuge, or to its goal."""
        rows = rows_in_use(detours.stays)
        if math.dist(xy, self._place) > min(0.2 * _WAIT * task.robot.v_max, stays.PLACE):
            self._place, self._since = xy, t
        if self._asked is not None:
            other = rows[rows[:, TRACK_ID] == self._other]
            if len(other) and not self._has_passed(self._asked.goal, detours, other, t, xy):
                if t < max(self._since, other[0, stays.SINCE]) + self._wait:
                    return task
            else:
                self._wait = _WAIT
            task, self._asked, self._since = self.asked(task), None, t
        elif refuge := self._refuge(task, detours, rows, t, xy):
            self._asked, self._since, self._wait = task, t, min(2.0 * self._wait, _LONGEST)
            task = replace(task, goal=refuge, goal_tolerance=min(task.goal_tolerance, _TOLERANCE), stay=0.0)
        return task

    def _has_passed(self, goal: XY, detours: Detours, other: Floats, t: float, xy: XY) -> bool:
        """Tell whether the other, who may be walking, leaves a way to `goal`."""
        return t - other[0, stays.SINCE] < _WALKS and math.isfinite(_Paths(detours, other, xy).to(goal))

    def _refuge(self, task: Task, detours: Detours, rows: Floats, t: float, xy: XY) -> XY | None:
        """Return where the robot is to let somebody pass who waits for it; None if nobody does, or there is no such place."""
        if t < max(self._due, self._since + self._wait) or math.dist(xy, task.goal) <= task.goal_tolerance:
            return None
        k = _nearest_waiting(rows, xy)
        if k < 0:
            return None
        self._due, stay, row = t + _WAIT, rows[:, SEEN] - rows[:, stays.SINCE], rows[k]
        paths = _Paths(detours, rows[stay >= 0.5 * _WAIT], xy)
        came = row[stays.SINCE] > row[stays.FIRST] or diagonals(rows)[k] > _CAME
        needed = _WAIT if came and math.isinf(paths.to(task.goal)) else _UNSURE
        if min(stay[k], t - self._since) < needed - 1e-6:
            return None
        ends = paths.node(task.start), int(np.where(np.isfinite(paths.times), paths.times, -1.0).argmax())
        if _leads_past(detours, row, xy, ends):
            return None
        context = detours.wide[0]
        times = np.where(_lets_pass(task, context, paths, row, xy, ends), paths.times, math.inf)
        best = int(times.argmin())
        if times[best] > t - self._since:  # not before it has waited for as long as the way to the refuge takes
            return None
        self._other = float(row[TRACK_ID])
        i, j = divmod(best, context.cols)
        return context.x0 + j * context.resolution, context.y0 + i * context.resolution


def _middle(row: Floats) -> XY:
    """Return the middle of where the obstacle of a row has stayed."""
    x, y = middles(row[None])
    return float(x[0]), float(y[0])


def _nearest_waiting(rows: Floats, xy: XY) -> int:
    """Return the row of the obstacle nearest to the robot at `xy` of those that have stayed for long; -1 if none has."""
    x, y = middles(rows)
    waits = rows[:, SEEN] - rows[:, stays.SINCE] >= _WAIT - 1e-6
    return int(np.where(waits, np.hypot(x - xy[0], y - xy[1]), math.inf).argmin()) if waits.any() else -1


def _leads_past(detours: Detours, row: Floats, xy: XY, ends: tuple[int, int]) -> bool:
    """Tell whether a path leads the obstacle of `row` past the robot, which stays at `xy`, to one of the nodes `ends`."""
    robot = row.copy()
    robot[[stays.LOW_X, stays.LOW_Y]] = robot[[stays.HIGH_X, stays.HIGH_Y]] = xy
    return bool(np.isfinite(_Paths(detours, robot[None], _middle(row)).times[list(ends)]).any())


def _lets_pass(task: Task, context: PlanningContext, paths: _Paths, row: Floats, xy: XY, ends: tuple[int, int]) -> Bools:
    """Tell of each node whether a robot that stands there lets the obstacle of `row` pass.

    The obstacle comes along the line to the robot's place `xy`, and goes on along the paths from there to the nodes `ends`.
    """
    size, clear, other = context.resolution, np.ones(paths.free.shape, bool), _middle(row)
    line = np.linspace(xy, other, 2 + int(math.dist(xy, other) / size))
    cols, lines = np.rint((line - (context.x0, context.y0)) / size).astype(np.int64).T
    clear[lines.clip(0, context.rows - 1), cols.clip(0, context.cols - 1)] = False
    clear.ravel()[[node for end in ends for node in paths.path_from(end)]] = False
    gap = size * distance_transform_edt(clear).ravel() - task.robot.radius - row[stays.SIZE]
    wall = size * distance_transform_edt(context.legal.reshape(clear.shape) != 0).ravel() + context.radius - size
    fits: Bools = (gap >= _GAP) & (wall >= task.robot.radius - 1e-9)
    return fits


class Dance:
    """Tells when the robot and an obstacle keep stepping aside for each other, and lets the robot stand for a while then.

    Two robots with the same policy step aside at the same time, see it, and both drive on at the same time. So the robot stands
    for a time that is drawn at random: one of the two drives on first, and only the other steps aside. This is for robots that
    can take any velocity at once, as others hesitate by themselves. Standing costs time in crowds.
    """

    def __init__(self) -> None:
        self.until = self._expires = -math.inf  # s; up to when the robot stands, and up to when it counts as going to and fro
        self._scans: deque[tuple[float, XY, float]] = deque(maxlen=_SCANS)  # time, place and time to the goal at the last scans
        self._first: dict[int, tuple[float, XY]] = {}  # when and where each obstacle was first seen meanwhile

    def __str__(self) -> str:
        return (
            "" if self.until == -math.inf else "the robot waits, because it and an obstacle keep stepping aside for each other"
        )

    def update(self, task: Task, to_go: float, t: float, xy: XY) -> None:
        """Take in that the robot is at `xy` at the time `t` s of a scan, `to_go` s before the goal."""
        self._scans.append((t, xy, to_go))
        since, place, before = self._scans[0]
        if not (task.robot.stepwise and len(self._scans) == _SCANS and to_go > before - _PROGRESS):
            return
        driven = sum(math.dist(one[1], after[1]) for one, after in pairwise(self._scans))
        if driven > _MOVES * task.robot.v_max * (t - since) and math.dist(place, xy) < _TO_AND_FRO * driven:
            self._expires = t + _WAIT

    def stands(self, o: Observation, v_max: float, rng: State) -> bool:
        """Tell whether the robot, whose top speed is `v_max` m/s, is to stand now."""
        if o.t < self.until:
            return True
        self.until = -math.inf
        if o.t > self._expires or len(o.tracks) > 1:
            self._first.clear()
            return False
        for number, place in zip(o.tracks.id.tolist(), o.tracks.xy.tolist(), strict=True):
            since, first = self._first.setdefault(number, (o.t, place))
            if o.t - since > _AGAIN and math.dist(first, place) < _MOVES * v_max * (o.t - since):
                self.until = o.t + _PAUSE[0] + (_PAUSE[1] - _PAUSE[0]) * float(call(uniform, rng))
                self._expires = -math.inf
                self._scans.clear()
                return True
        return False


class _Paths:
    """Times from a place to all nodes, where obstacles stay."""

    def __init__(self, detours: Detours, rows: Floats, xy: XY) -> None:
        context = self.context = detours.wide[0]
        self.free = without(context, rows, xy)
        here = divmod(self.node(xy), context.cols)
        field = timed_field(self.free, detours.moves, here, scale=context.resolution / context.speed)
        self.times = np.where(self.free == 0, math.inf, field).ravel()

    def to(self, xy: XY) -> float:
        """Return the time to a place, s; infinite if its node is not free."""
        return float(self.times[node_near(self.context, xy)])

    def node(self, xy: XY) -> int:
        """Return the free node that is nearest to a place, or any if none is free."""
        context, (rows, cols) = self.context, np.nonzero(self.free)
        x, y = context.x0 + cols * context.resolution, context.y0 + rows * context.resolution
        if not len(rows):
            return context.goal
        i = int(np.hypot(x - xy[0], y - xy[1]).argmin())
        return int(rows[i]) * context.cols + int(cols[i])

    def path_from(self, node: int) -> list[int]:
        """Return the nodes on the fastest path from a node to the place, as far as there is one."""
        context, legal, nodes = self.context, self.free.ravel(), [node]
        while 0.0 < self.times[node] < math.inf:
            moves = np.flatnonzero(legal[node] >> np.arange(len(context.offset), dtype=np.uint32) & 1)
            to = node + context.offset[moves]
            node = int(to[(self.times[to] + context.step[moves, 2]).argmin()])
            nodes.append(node)
        return nodes
