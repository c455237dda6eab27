"""The search in `solve_tsptw` and `order_stops`: a path through all stops in time, by a colony and widening beams."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.rng import mix, stream
from antway.kernels.colony import time_windows as beams
from antway.kernels.colony import window_colony as colonies
from antway.kernels.colony import windows as kernel
from antway.kernels.colony.window_repair import QUICK_WORK, WORK, lateness, repair
from antway.kernels.colony.window_search import MoveOptions, TimedOrder, timed_order
from antway.planning import Clock
from antway.tours.stops import Floats, Order, typical_step

_WIDER = 128  # width of a wide beam for each cycle before it
_FEW_ATTEMPTS = 10  # random moves between two looks at the clock when an earlier order must be repaired quickly
_LONGEST = 8  # largest number of stops in a moved part of an order
_ATTEMPTS = 100  # random moves of an ant's order in a cycle
_EVAPORATION = 0.1  # share of pheromone that is replaced in a cycle
_TEMPERATURE = 0.5  # typical steps; by about how much worse an order may become at first
_HURRY = 3.0  # largest weight of a second of arrival time for ants, relative to a second of lower bound
_WIDTH = 30  # partial orders in the beam of a cycle
_LOOKS = 200_000  # stops looked at between two checks of the budget, times stops
_PACE = 1e8  # stops evaluated in a second, when an order is repaired on a busy machine
_STATES = 4_000_000  # limit of partial orders times stops in a beam, 12 bytes each
_SLICE = 0.02  # s; time between two checks of the budget


@dataclass(frozen=True, slots=True)
class Found:
    """The best order found. `late` is 0 if it is feasible; `proven`: no order costs less, or not by more than `off`, in s."""

    order: Order
    late: float
    proven: bool
    conflict: tuple[int, ...]
    cycles: int
    history: list[tuple[int, float, float]]
    pheromone: Floats
    off: float = 0.0


class Path:
    """A path from the first stop through all others to the last one, in whole units so that sums are exact.

    `time`, float64[n, n], is that of service and travel, infinite without a path. Service may start from `opens` to `closes`,
    float64[n], which may be infinite. If `quick`, the analysis of windows is left out, which only local search can do without.

    Decimal numbers with at most six places become whole numbers. Others are rounded to 50 bits of the horizon, and windows end
    later by more than what rounding adds: an order that is in time with the given numbers is in time here.
    """

    def __init__(self, time: Floats, opens: Floats, closes: Floats, quick: bool = False) -> None:
        n = len(time)
        steps = time.copy()
        np.fill_diagonal(steps, np.inf)
        steps[:, 0] = steps[-1, :] = np.inf
        # Any reasonable order ends before this.
        longest = np.where(np.isfinite(steps), steps, 0.0).max(axis=1).sum()
        horizon = float(opens.max() + longest) + 1.0
        ends = np.minimum(closes, horizon)
        self.scale = _decimal(np.concatenate([steps[np.isfinite(steps)], opens, ends]), horizon)
        self.exact = self.scale > 0.0
        if self.exact:
            steps, opens, ends = (np.round(values * self.scale) for values in (steps, opens, ends))
        else:
            self.scale = 2.0 ** (50 - math.ceil(math.log2(horizon)))
            # Each step and each sum may add a unit.
            steps, opens, ends = np.ceil(steps * self.scale), np.ceil(opens * self.scale), np.floor(ends * self.scale) + 2 * n
        self.time, self.opens, self.closes = steps, opens.copy(), ends.copy()
        whole = steps.copy()
        np.fill_diagonal(whole, 0.0)
        self.quick = quick
        self.far = whole if quick else kernel.shortest(whole)
        # For orders that are late in any case: a missing arc takes as long as all others together.
        self.finite = np.where(np.isfinite(whole), whole, np.ceil(horizon * self.scale))
        self.windows, self.feasible = self._prepare()
        self.mirror = _mirror(self.windows) if self.feasible and not quick else self.windows
        self.step = typical_step(np.sort(steps, axis=1)[:-1, : min(3, n - 1)], steps)

    def _prepare(self) -> tuple[kernel.Windows, bool]:
        steps, opens, closes, far = self.time.copy(), self.opens.copy(), self.closes.copy(), self.far
        first = np.zeros(steps.shape, dtype=np.bool_)
        leave, enter = np.zeros((2, len(steps)))
        feasible = True
        for _ in range(0 if self.quick else 2):
            if kernel.tighten(steps, far, opens, closes, first) >= 0:  # a stop that no order visits in time
                feasible = False
                break
            loops = steps.copy()
            np.fill_diagonal(loops, 0.0)
            far = kernel.shortest(loops)
        if feasible and not self.quick:
            leave[:-1], enter[1:] = kernel.assignment(np.ascontiguousarray(steps[:-1, 1:]))
        return _record(steps, far, opens, closes, first, leave, enter), feasible

    def conflict(self) -> tuple[int, ...]:
        """Return up to three stops that no order visits in time."""
        return tuple(stop for stop in kernel.conflict(self.far, self.opens, self.closes) if stop >= 0)

    def bound(self, makespan: bool) -> float:
        """Return a lower bound of the cost of feasible orders."""
        if not self.feasible:
            return 0.0
        opens, least = self.windows.opens, self.windows.bound
        if makespan:
            least = max(float(opens[-1]), least + float(opens[0]))
        # Each step, and each opening, may have been rounded up by a unit.
        return max(least - (0 if self.exact else 2 * len(opens)), 0.0) / self.scale

    def late(self, order: Order) -> float:
        """Return the sum of the delays of service."""
        return float(lateness(self.finite, self.opens, self.closes, order, math.inf)) / self.scale

    def end(self, order: Order) -> float:
        """Return the start of service at the last stop, in units; no stop of `order` is late."""
        left = np.append(np.cumsum(self.finite[order[:-1], order[1:]][::-1])[::-1], 0.0)
        return float((self.opens[order] + left).max())

    def starts(self, order: Order) -> Floats:
        """Return the start of service at each stop."""
        starts = self.opens.copy()
        for here, there in pairwise(order.tolist()):
            starts[there] = max(starts[here] + self.finite[here, there], starts[there])
        return starts / self.scale


def _decimal(values: Floats, horizon: float) -> float:
    """Return the power of ten that makes all values whole and sums of them exact, or 0."""
    for places in range(7):
        scale = 10.0**places
        if 4.0 * horizon * scale >= 2.0**53:
            return 0.0
        if np.array_equal(np.round(values * scale) / scale, values):
            return scale
    return 0.0


def _record(
    steps: Floats, far: Floats, opens: Floats, closes: Floats, first: NDArray[np.bool_], leave: Floats, enter: Floats
) -> kernel.Windows:
    """Return the record for kernels. Without precedence, which any analysis of windows finds, it is for local search alone."""
    n = len(steps)
    reduced = steps - leave[:, None] - enter[None, :]
    words = (n + 63) // 64
    padded = np.zeros((n, words * 64), dtype=np.uint8)
    padded[:, :n] = first.T
    before = np.packbits(padded, axis=1, bitorder="little").view("<u8").astype(np.uint64)
    after = np.argsort(reduced[:, : n * first.any()], axis=1, kind="stable").astype(np.int32)
    afters = np.isfinite(reduced).sum(axis=1).astype(np.int32)
    by_closing = np.argsort(closes, kind="stable").astype(np.int32)
    farthest = np.where(np.isfinite(far), far, 0.0).max(axis=1)
    mark = np.array([mix(np.uint64(i + 1)) for i in range(n)], dtype=np.uint64)
    steps, far, before = np.ascontiguousarray(steps), np.ascontiguousarray(far), np.ascontiguousarray(before)
    bound = float(leave.sum() + enter.sum())
    return kernel.Windows(steps, far, opens, closes, after, afters, before, by_closing, farthest, leave, enter, mark, bound)


def _mirror(windows: kernel.Windows) -> kernel.Windows:
    """Return the same task backwards in time."""
    n, horizon = len(windows.opens), windows.closes[-1]
    before = np.unpackbits(windows.before.astype("<u8").view(np.uint8), axis=1, bitorder="little")[:, :n].astype(np.bool_)
    opens, closes = (horizon - windows.closes)[::-1].copy(), (horizon - windows.opens)[::-1].copy()
    first, leave, enter = np.ascontiguousarray(before[::-1, ::-1]), windows.enter[::-1].copy(), windows.leave[::-1].copy()
    return _record(windows.time[::-1, ::-1].T, windows.far[::-1, ::-1].T, opens, closes, first, leave, enter)


def search(
    path: Path,
    clock: Clock,
    *,
    makespan: bool = False,
    cycles: int | None = None,
    seed: int = 0,
    target: float = -math.inf,
    initial: Order | None = None,
    pheromone: Floats | None = None,
    evaporation: float = _EVAPORATION,
    width: int = _WIDTH,
) -> Found:
    """Search until the clock is spent, `cycles` are done, an order costs at most `target`, or none can be better.

    `evaporation` is the share of the pheromone that is replaced in a cycle, 0 for ants that do not learn. `width` is the width
    of the ants' beams, 0 for no ants.
    """
    n = len(path.time)
    if initial is not None:
        start = initial.astype(np.int32)
    else:  # by the middles of the windows
        due = 1 + np.argsort((path.opens + path.closes)[1:-1], kind="stable")
        start = np.concatenate(([0], due, [n - 1])).astype(np.int32)
        if path.quick:
            start = min(start, _earliest_first(path), key=lambda order: (path.late(order), path.starts(order)[-1]))
    if not path.feasible or n <= 3:
        late = float(repair(path.finite, path.opens, path.closes, start, 0 if n <= 3 else 20, np.uint64(seed)))
        conflict = () if path.feasible else path.conflict()
        return Found(start, late / path.scale, True, conflict, 0, [], np.zeros((0, 0)))
    step = path.step
    moves = MoveOptions(makespan, _LONGEST, 0.5 if path.exact and not makespan else 1e-9 * step)
    width, attempts = (0, _FEW_ATTEMPTS) if path.quick else (min(width, _WIDTH), _ATTEMPTS)
    options = colonies.ColonyOptions(width, attempts, evaporation, _TEMPERATURE * step, step, _HURRY, moves)
    target = target * path.scale * (1.0 + 1e-9) if math.isfinite(target) else target
    tau = np.full((n, n), colonies.TAU_0) if pheromone is None or pheromone.shape != (n, n) else pheromone.copy()
    record = np.array([math.inf, math.inf, 0.0, 0.0])
    colony = colonies.WindowColony(tau, np.zeros((n, n)), np.zeros((3, n), dtype=np.int32), record)
    scratch = beams.workspace(n, _WIDTH), timed_order(n)
    return _Run(path, clock, options, np.uint64(seed), target, start, initial is not None, colony, *scratch).go(cycles)


def _earliest_first(path: Path) -> Order:
    """Return the order that always goes on to the stop at which service can start first."""
    n = len(path.time)
    order, now, visited = np.arange(n, dtype=np.int32), path.opens[0], np.zeros(n)
    visited[[0, -1]] = math.inf
    for p in range(1, n - 1):
        starts = np.maximum(now + path.finite[order[p - 1]], path.opens) + visited
        order[p] = np.argmin(starts)
        now, visited[order[p]] = starts[order[p]], math.inf
    return order


@dataclass(slots=True)
class _Run:
    """One run of `search`."""

    path: Path
    clock: Clock
    options: colonies.ColonyOptions
    seed: np.uint64
    target: float
    start: Order
    warm: bool
    colony: colonies.WindowColony
    beam: beams.Beam
    timed: TimedOrder
    proven: bool = False
    history: list[tuple[int, float, float]] = field(default_factory=list)

    def _cost(self) -> float:
        """Return the cost of the best order in units, infinite while none is known; for the makespan it is the end alone."""
        best = float(self.colony.record[colonies.BEST])
        return self.path.end(self.colony.orders[0]) if self.options.moves.makespan and best < math.inf else best

    def _note(self) -> None:
        best = self._cost() / self.path.scale
        if math.isfinite(best) and (not self.history or best < self.history[-1][1]):
            self.history.append((int(self.colony.record[colonies.CYCLE]), best, self.clock.elapsed()))

    def _adopt(self, order: Order) -> None:
        """Improve `order`, in which no stop is late, until the clock is spent, and give it to the colony."""
        place, looks = 0, max(1, _LOOKS // len(order))
        while place := colonies.adopt(self.path.windows, self.colony, self.options.moves, self.timed, order, place, looks):
            if self.clock.spent():
                break

    def _widen(self, width: int, backward: bool) -> None:
        """Search with a beam of `width` partial orders, from the start or from the end."""
        path, record = self.path, self.colony.record
        n = len(path.time)
        width = min(width, _STATES // n)
        order = np.zeros(n, dtype=np.int32)
        moves = self.options.moves
        choice = beams.Choice(1.0, 0.0, 0.0, moves.makespan, record[colonies.BEST] - moves.least * moves.makespan)
        task, none = path.mirror if backward else path.windows, np.zeros((n, n))
        cost, whole = beams.search(task, none, choice, width, np.uint64(1), beams.workspace(n, width), order)
        if cost < math.inf:
            order = n - 1 - order[::-1] if backward else order
            self._adopt(order)
            if whole and moves.makespan and cost < self._cost():
                # Local search prefers an order that ends later, but saves more than a million times as much travel time.
                self.colony.orders[0] = order
        self.proven = bool(whole)

    def _repair(self, attempts: int, draw: int) -> float:
        """Reduce the lateness of the initial order, and give it to the colony once it is in time; return its lateness."""
        path = self.path
        drawn = np.uint64(stream(self.seed, np.uint64(draw)))
        left = max(0.0, self.clock.end - time.perf_counter())
        work = int(min(QUICK_WORK if path.quick else WORK, _PACE * left))
        late = float(repair(path.finite, path.opens, path.closes, self.start, attempts, drawn, work))
        if late == 0.0:
            self._adopt(self.start)
        return late

    def go(self, cycles: int | None) -> Found:
        """Run the cycles; after 4, 8, 16, ... of them a wide beam follows that takes about as long as they did."""
        path, record = self.path, self.colony.record
        limit = 2**62 if cycles is None else cycles
        late = self._repair(0, 0) if self.warm else math.inf
        self._note()
        batch, done, widened, beam_time, backward = 1, 0, 4, 0.0, False
        while done < limit and not self.proven and self._cost() > self.target:
            if (done or self.warm) and self.clock.spent():
                break
            batch = min(batch, limit - done, widened - done)
            started = time.perf_counter()
            ran = colonies.cycles(path.windows, path.mirror, self.colony, self.options, self.seed, batch, self.beam, self.timed)
            done += ran
            each = max(time.perf_counter() - started, 1e-9) / ran
            batch = max(1, min(2 * batch, 4096, int(_SLICE / each)))
            if record[colonies.BEST] == math.inf:
                # One cycle at a time, so that the result does not depend on the time.
                late, batch = self._repair(1, done), 1
            if done == widened:
                # Each beam takes twice as long as the one before, and is not started if that time is not left.
                before = time.perf_counter()
                if before + 2.0 * beam_time < self.clock.end and not path.quick:
                    self._widen(_WIDER * done, backward)
                    beam_time = time.perf_counter() - before
                widened *= 2
                backward = not backward and not self.options.moves.makespan
            self._note()
        if record[colonies.BEST] < math.inf:
            moves = self.options.moves
            off = 0.0 if path.exact else (2 * len(path.time) + moves.least * moves.makespan) / path.scale  # as in `Path.bound`
            return Found(self.colony.orders[0].copy(), 0.0, self.proven, (), done, self.history, self.colony.tau, off)
        late = self._repair(10, 0) if math.isinf(late) else late
        conflict = path.conflict() if self.proven else ()
        return Found(self.start, late / path.scale, self.proven, conflict, done, self.history, self.colony.tau)
