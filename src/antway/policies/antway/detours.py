"""Detours around obstacles that stay: times to the goal that count with how long they have stayed already."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from antway.grid import Moves
from antway.kernels.base.arrays import Bools, Floats
from antway.kernels.base.jit import call
from antway.kernels.spacetime.context import PlanningContext
from antway.kernels.tracking import stays
from antway.kernels.tracking.stays import update_stays
from antway.kernels.tracking.table import SEEN, TRACK_ID, make_table, rows_in_use
from antway.search.sipp import timed_field
from antway.world.policy import XY

Contexts = tuple[PlanningContext, ...]
Times = tuple[Contexts, list[Floats]]  # contexts, and for each float64[H * W], s

_INTERVAL = 0.25  # s; scans are looked at as often as that
_ROWS = 128  # limit of obstacles whose stays are known
_STALLED = 3.0  # s; a robot that comes no nearer to its goal for this time looks for detours around what has stayed as long
_PROGRESS = 0.3  # s; a robot whose time to the goal has fallen by less than this has come no nearer
_LATE = 1.0  # s; a plan that arrives later by this than the times to the goal say may lead around somebody who stands
_DIFFERS = 1.0  # s; if it has done so for this time, the times are to count with those who stand
_AGAIN = 10.0  # s; if a stay ends and the plan is not faster than these times, they are not computed anew before this
_STANDS = 1.0  # s; whoever has stood for this time is expected to stand for as long as plans expect it
_ARRIVED = 0.5  # s; nearer to the goal than this, the robot has no use for detours


class Detours:
    """The times to the goal on a map where obstacles stay.

    Plans know the obstacles up to their horizon only, and take the path to be free after it. Behind an obstacle that stays in a
    doorway, a robot would wait forever, though there may be another door. How long an obstacle will stay is not known. The
    longer it has stayed, the longer it is likely to, so it is expected to stay as long again as it has stayed already. A robot
    then waits before a doorway at most about as long as the detour takes in addition, as in the ski rental problem.

    Plans expect whoever stands to stand until their horizon. Where rollouts drive the robot, its times to the goal have to
    agree with the plan. Otherwise it drives into a U of people who stand, out of which the plan leads, and hesitates there.

    `contexts` are the maps for which there are such times: that of plans and, for a robot that rollouts drive, theirs. By the
    last one the robot's progress is judged. `narrow` are both for a disc as narrow as the robot, which passes obstacles
    lengthwise; None if they are the same. Where the robot is held up and they lead past what stays, they are tried first; after
    that `contexts` and `narrow` are tried alternately. Those who stand are expected to stand for `horizon` s at least: the
    horizon of plans, or 0 if the robot follows plans.
    """

    def __init__(self, moves: Moves, contexts: Contexts, narrow: Contexts | None = None, horizon: float = 0.0) -> None:
        self.moves, self.horizon = moves, horizon
        self.contexts, self.wide, self.narrow = contexts, contexts, narrow or contexts
        self.times = [context.field for context in contexts]  # the times to the goal in each context, float64[H * W], s
        self.stays = make_table(_ROWS, stays.COLUMNS)  # how long obstacles have stayed (kernels/tracking/stays.py)
        self._agreed = self._counted_at = 0.0  # s; when the plan and the times last agreed, and when these were last computed
        self._expected: set[tuple[float, float]] = set()  # the stays that `times` count with
        self.due, self.to_go, self._xy = -math.inf, math.inf, (0.0, 0.0)  # s; when the next scan is due, and the time to go
        self._nearest = self._since = math.inf  # s; the least time to the goal, and when the robot reached it or began
        # The times of the last two updates by the disc, the nodes, and those left out; they seldom change from one to the next.
        self._before: dict[tuple[float, tuple[int, int], bytes], Floats] = {}
        self._known: dict[tuple[float, tuple[int, int], bytes], Floats] = {}

    def update(
        self, estimates: Floats, seen: Floats, t: float, xy: XY, arrival: float = math.inf, busy: bool = False
    ) -> Callable[[], Times] | None:
        """Take in the scan at time `t` s, when the robot is at `xy`; return what computes other times, if they are to change.

        The estimates, float64[K, 8], are those of kernels/tracking/kalman.py; each was last `seen`, float64[K], at a time in s.
        The plan in use reaches the goal at the time `arrival`, s (infinite without a plan). If `busy`, other times are being
        computed already.
        """
        self.due, self._xy = t + _INTERVAL - 1e-6, xy
        call(update_stays, self.stays, estimates, seen, t)
        to_go = self.to_go = _time_to_go(self.contexts, self.times, xy)
        if busy:
            return None
        rows = rows_in_use(self.stays)
        # In a crowd stays end all the time, and each computation takes longer than the rest of a control cycle.
        worthwhile = self.horizon == 0.0 or arrival < t + to_go - _PROGRESS or t >= self._counted_at + _AGAIN
        if worthwhile and self._expected and not self._expected <= _stays(rows):
            return self._expect(t, self.contexts)
        if not t + to_go + _LATE < arrival < math.inf or to_go < _ARRIVED:
            self._agreed = t
        if t - self._agreed >= _DIFFERS - 1e-6 and not _stays(rows[self._stands(rows)]) <= self._expected:
            return self._expect(t, self.contexts)
        if to_go < self._nearest - _PROGRESS or to_go < _ARRIVED:
            self._nearest, self._since = to_go, t
        self._since = min(self._since, t)
        if t - self._since < _STALLED - 1e-6:
            return None
        other = self.narrow if self.contexts is self.wide else self.wide
        return self._expect(t, other)

    def go_on(self, before: Detours) -> None:
        """Go on with the stays that were known `before`; if times counted with them, they are to do so again at once."""
        self.stays = before.stays
        if before.expects:
            self._nearest, self._since = _time_to_go(self.contexts, self.times, before._xy), -math.inf

    def adopt(self, found: Times) -> None:
        """Use other times from now on."""
        self.contexts, self.times = found
        self._nearest = _time_to_go(*found, self._xy)

    @property
    def expects(self) -> bool:
        """Whether the times count with any obstacle."""
        return bool(self._expected)

    def timed(self, context: PlanningContext) -> PlanningContext:
        """Return `context`, which is the first one for this or another speed, with the present times at its speed."""
        return context._replace(field=self.times[0] * (self.contexts[0].speed / context.speed))

    def without(self, context: PlanningContext) -> PlanningContext:
        """Do as `timed`, but with the times on the map alone."""
        if not self.expects:
            return context
        return context._replace(field=self.contexts[0].field * (self.contexts[0].speed / context.speed))

    def is_cut_off(self, xy: XY, far: int) -> bool:
        """Tell whether the robot can stand at nodes up to `far` rows and columns from `xy`, and none has a path to the goal."""
        context = self.contexts[-1]
        row, col = row_col(context, xy)
        near = np.s_[max(row - far, 0) : max(row + far + 1, 0), max(col - far, 0) : max(col + far + 1, 0)]
        legal, field = (each.reshape(context.rows, context.cols)[near] for each in (context.legal, context.field))
        return bool(legal.any() and np.isinf(field[legal > 0]).all())

    def _expect(self, t: float, contexts: Contexts) -> Callable[[], Times] | None:
        """Return what computes times in these contexts with all that have stayed for long; None if nothing changes."""
        self._since = self._agreed = t
        rows = rows_in_use(self.stays)
        stay, stands = rows[:, SEEN] - rows[:, stays.SINCE], self._stands(rows)
        long = stands | (stay >= _STALLED - 1e-6)
        stay = np.where(stands, np.maximum(stay, self.horizon), stay)
        if not (long.any() or self.expects):
            return None
        self._expected, self._counted_at = _stays(rows[long]), t
        return partial(self._counted, contexts if self._expected else self.wide, rows[long], stay[long], self._xy)

    def _stands(self, rows: Floats) -> Bools:
        """Tell who of these is expected to stand until the horizon of plans, bool[N]."""
        return (
            (self.horizon > 0.0) & (diagonals(rows) <= stays.STILL) & (rows[:, SEEN] - rows[:, stays.SINCE] >= _STANDS - 1e-6)
        )

    def _counted(self, contexts: Contexts, rows: Floats, stay: Floats, xy: XY) -> Times:
        """Return the times where these obstacles are expected to stay for `stay` s: in `contexts` if they are shorter there."""
        self._before, self._known = self._known, {}
        found = self.wide, [self._times(context, rows, stay) for context in self.wide]
        if contexts is not self.wide:
            other = contexts, [self._times(context, rows, stay) for context in contexts]
            if not _time_to_go(*other, xy) > _time_to_go(*found, xy) - _PROGRESS:
                return other
        return found

    def _times(self, context: PlanningContext, rows: Floats, stay: Floats) -> Floats:
        """Return the times to the goal where these obstacles are expected to stay for `stay` s.

        It is the least, over all obstacles i, of the time around all that stay longer than i, plus the time that i stays. Those
        that stay about as long, up to twice, count as one.
        """
        if not len(rows):
            return context.field
        octave = np.floor(np.log2(stay))
        times: Floats = context.field + stay.max()
        for least in np.unique(octave):
            around = self._around(context, rows[octave >= least])
            times = np.minimum(times, around + stay[octave < least].max(initial=0.0))
        return times

    def _around(self, context: PlanningContext, rows: Floats) -> Floats:
        """Return the times to the goal on paths around the places of these stays."""
        shape, size, mask = (context.rows, context.cols), context.resolution, without(context, rows)
        key = context.radius, shape, np.flatnonzero((mask == 0) & (context.legal.reshape(shape) != 0)).tobytes()
        times = self._known.get(key, self._before.get(key))
        if times is None:
            goal = divmod(context.goal, shape[1])
            times = timed_field(mask, self.moves, goal, scale=size / context.speed).ravel()
        self._known[key] = times
        return times


def _time_to_go(contexts: Contexts, times: list[Floats], xy: XY) -> float:
    """Return the time to the goal from the cell at `xy` or, if that is not free, from a neighbour; infinite without one."""
    context = contexts[-1]
    here = float(times[-1][node_near(context, xy)])
    if math.isinf(here):
        row, col = row_col(context, xy)
        field = times[-1].reshape(context.rows, context.cols)
        here = float(field[max(row - 1, 0) : row + 2, max(col - 1, 0) : col + 2].min(initial=math.inf))
    return here


def without(context: PlanningContext, rows: Floats, xy: XY | None = None) -> NDArray[np.uint32]:
    """Return the legal moves from nodes, [context.rows, context.cols], but none at the places of these stays.

    Whoever moves about while he stays takes more room, but none that the robot at `xy` has.
    """
    size, mask = context.resolution, context.legal.reshape(context.rows, context.cols).copy()
    for row, diagonal, x, y in zip(rows, diagonals(rows), *middles(rows), strict=True):
        spread = 0.5 * diagonal
        contact = context.radius + row[stays.SIZE]
        if xy is not None:
            spread = min(spread, max(math.dist(xy, (x, y)) - contact, 0.0))
        far = (contact + spread) / size
        r, c = (y - context.y0) / size, (x - context.x0) / size
        low_r, low_c = max(math.ceil(r - far), 0), max(math.ceil(c - far), 0)
        window = mask[low_r : max(math.floor(r + far) + 1, 0), low_c : max(math.floor(c + far) + 1, 0)]
        i, j = np.ogrid[: window.shape[0], : window.shape[1]]
        window[np.hypot(i + low_r - r, j + low_c - c) < far] = 0
    return mask


def middles(rows: Floats) -> tuple[Floats, Floats]:
    """Return x and y of the middle of the place of each stay, m."""
    return 0.5 * (rows[:, stays.LOW_X] + rows[:, stays.HIGH_X]), 0.5 * (rows[:, stays.LOW_Y] + rows[:, stays.HIGH_Y])


def diagonals(rows: Floats) -> Floats:
    """Return the diagonal of the place of each stay, m."""
    return np.hypot(rows[:, stays.HIGH_X] - rows[:, stays.LOW_X], rows[:, stays.HIGH_Y] - rows[:, stays.LOW_Y])


def row_col(context: PlanningContext, xy: XY) -> tuple[int, int]:
    """Return row and column of the place of nodes that is nearest to `xy`, on the map or beside it."""
    return round((xy[1] - context.y0) / context.resolution), round((xy[0] - context.x0) / context.resolution)


def node_near(context: PlanningContext, xy: XY) -> int:
    """Return the node, free or not, that is nearest to a place."""
    row, col = row_col(context, xy)
    return min(max(row, 0), context.rows - 1) * context.cols + min(max(col, 0), context.cols - 1)


def _stays(rows: Floats) -> set[tuple[float, float]]:
    """Return the id and the beginning of the stay in each row of kernels/tracking/stays.py."""
    return set(zip(rows[:, TRACK_ID].tolist(), rows[:, stays.SINCE].tolist(), strict=True))
