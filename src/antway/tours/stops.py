"""The stops of a tour: travel times, windows, service, priorities and robots, checked once; and the times of an order."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, TooLarge

MAX_STOPS = 5_000
MAX_TIME = 1e9  # s; limit of a travel time
_ROUNDING = 1e-11  # share of the time; what is late by less is in time, as sums of floats are rounded
Floats = NDArray[np.float64]
Order = NDArray[np.int32]


@dataclass(frozen=True, slots=True, eq=False)
class Stops:
    """A task of `order_stops`, whose arguments it checks; `end` is None for an open tour, `start` for a closed one."""

    matrix: Floats  # [n, n] travel time in s, infinite where there is no path
    start: int
    end: int | None
    windows: Floats  # [n, 2] earliest and latest start of service in s
    service: Floats  # [n] s
    priorities: Floats | None  # [n]
    deadline: float  # s
    robots: int
    objective: str

    def __post_init__(self) -> None:
        matrix = checked_matrix(self.matrix, MAX_STOPS, "stops", finite=False)
        n, end = len(matrix), self.end
        start = checks.integer("start", self.start, low=0, high=n - 1)
        if isinstance(end, str):
            if end != "start":
                raise BadParameter("end", end, f"an integer in [0, {n - 1}], start or None")
            end = start
        found = {
            "matrix": matrix,
            "start": start,
            "end": None if end is None else checks.integer("end", end, low=0, high=n - 1),
            "windows": checked_windows(self.windows, n),
            "service": np.zeros(n) if self.service is None else amounts("service", self.service, n),
            "priorities": None if self.priorities is None else amounts("priorities", self.priorities, n),
            "deadline": checks.number("deadline", self.deadline, low=0.0, infinite=True, unit="s"),
            "robots": checks.integer("robots", self.robots, low=1, high=1_000),
            "objective": checks.objective(self.objective),
        }
        for name, value in found.items():
            object.__setattr__(self, name, value)
        if np.isfinite(matrix).all():
            # No robot ends later than this, so that what closes then never does.
            end_of_all = float(self.windows[:, 0].max() + matrix.max(axis=1).sum() + self.service.sum()) * (1.0 + 1e-9)
            self.windows[self.windows[:, 1] >= end_of_all, 1] = math.inf
            object.__setattr__(self, "deadline", self.deadline if self.deadline < end_of_all else math.inf)

    @property
    def closed(self) -> bool:
        """Whether the tour ends at its start."""
        return self.end == self.start

    @property
    def timed(self) -> bool:
        """Whether there is a window or a deadline."""
        return bool(np.isfinite(self.windows[:, 1]).any() or (self.windows[:, 0] > 0.0).any() or self.deadline < math.inf)

    @property
    def ends(self) -> list[int]:
        """The start, and the end if it is another stop."""
        return [self.start] if self.end is None or self.closed else [self.start, self.end]

    @property
    def inner(self) -> Order:
        """The stops without start and end, int32[m]."""
        return np.delete(np.arange(len(self.matrix), dtype=np.int32), self.ends)

    def timing(self, order: Order) -> tuple[Floats, Floats, float, float]:
        """Return arrival and waiting at each stop of `order`, the end time of the robot, and its lateness, in s.

        Lateness is the sum of the delays of service after the ends of windows, and of the end after the deadline.
        """
        arrival, waiting, now, late = np.empty(len(order)), np.empty(len(order)), 0.0, 0.0
        for p, stop in enumerate(order):
            if p > 0:
                now += self.matrix[order[p - 1], stop]
            # In a closed tour the window of the start is for the departure; the deadline is for the return.
            home = p > 0 and p == len(order) - 1 and self.closed
            earliest, latest = (0.0, math.inf) if home else self.windows[stop]
            arrival[p], waiting[p] = now, max(0.0, earliest - now)
            now += waiting[p]
            late += overdue(now, latest)
            now += 0.0 if home else self.service[stop]
        return arrival, waiting, now, late + overdue(now, self.deadline)

    def travel(self, order: Order) -> float:
        """Return the sum of the travel times along `order`, in s."""
        return float(self.matrix[order[:-1], order[1:]].sum())

    def cost(self, orders: list[Order]) -> float:
        """Return the objective of the orders of all robots, in s."""
        if self.objective == "makespan":
            return max(self.timing(order)[2] for order in orders)
        return sum(self.travel(order) for order in orders)


def overdue(now: float, latest: float) -> float:
    """Return by how much `now` is after `latest`, in s; 0.0 if rounding errors of sums may explain it."""
    return now - latest if now > latest + _ROUNDING * (1.0 + latest) else 0.0


def typical_step(nearest: Floats, times: Floats) -> float:
    """Return the mean time to the nearest stops, or if that is 0 of all `times`, or else 1 s; infinite times do not count."""
    means = (float(each[np.isfinite(each)].mean()) for each in (nearest, times) if np.isfinite(each).any())
    return next(filter(None, means), 1.0)


def amounts(name: str, value: object, n: int) -> Floats:
    """Return one number in [0, 1e9] for each stop; a single number holds for all."""
    if not isinstance(value, Iterable):
        return np.full(n, checks.number(name, value, low=0.0, high=1e9))
    listed = checks.sequence(name, value, "a number, or one for each stop")
    if len(listed) != n:
        raise BadParameter(f"len({name})", len(listed), f"that of stops, {n}")
    return np.array([checks.number(f"{name}[{i}]", one, low=0.0, high=1e9) for i, one in enumerate(listed)])


def checked_matrix(matrix: object, most: int, of: str, *, finite: bool) -> Floats:
    """Return `matrix` as float64[n, n] of times in [0, 1e9] or, unless `finite`, infinite; its diagonal is set to 0.

    n is at most `most`; errors call the rows `of`, such as "stops".
    """
    times = checks.array("matrix", matrix, (None, None), finite=False)
    n = len(times)
    if n == 0 or times.shape != (n, n):
        raise BadParameter("matrix.shape", times.shape, "square and not empty")
    if n > most:
        raise TooLarge("matrix", n, f"of at most {most} {of}")
    times = times.copy()
    np.fill_diagonal(times, 0.0)
    allowed = "in [0, 1e9]" if finite else "in [0, 1e9], or infinite where there is no path (s)"
    for i, j in np.argwhere(~((times >= 0.0) & ((times <= MAX_TIME) | (np.isposinf(times) & (not finite)))))[:1]:
        raise BadParameter(f"matrix[{i}, {j}]", float(times[i, j]), allowed)
    return times


def checked_windows(windows: object, n: int) -> Floats:
    """Return `windows` as float64[n, 2], each from a time >= 0 to a later one, which may be infinite."""
    if windows is None:
        return np.tile([0.0, math.inf], (n, 1))
    result = checks.array("windows", windows, (n, 2), finite=False)
    for i in np.flatnonzero(~((result[:, 0] <= result[:, 1]) & (result[:, 1] >= 0.0) & (result[:, 0] <= 1e9))):
        checks.window(f"windows[{i}]", result[i])
    return np.maximum(result, 0.0)
