"""Stops of a robot's rounds: where, when and how long; and the record of the visits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from antway import checks
from antway.errors import BadParameter, OutOfBounds, TooLarge
from antway.world.line_of_sight import check_clear
from antway.world.policy import XY, Task

MAX_STOPS = 500


@dataclass(frozen=True, slots=True)
class Stop:
    """A place to visit.

    Parameters
    ----------
    at : (x, y)
        m.
    name : str
    window : (earliest, latest)
        Times at which service may start, s; the robot waits for the first, and is late after the second.
    service : float
        Duration of the service, s, >= 0.
    """

    at: XY
    name: str = ""
    window: tuple[float, float] = (0.0, math.inf)
    service: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "at", checks.point("at", self.at))
        checks.instance("name", self.name, str)
        object.__setattr__(self, "window", checks.window("window", self.window))
        checks.fields(self, "service", low=0.0, high=1e9, unit="s")


def checked_stops(stops: object, task: Task) -> tuple[Stop, ...]:
    """Return `stops` if each is on the map, clear of walls and in a cell of its own.

    Raises
    ------
    BadParameter, OutOfBounds, CellBlocked, TooLarge
        Each names the stop.
    """
    listed = checks.sequence("stops", stops, "a sequence of stops")
    if len(listed) > MAX_STOPS:
        raise TooLarge("stops", len(listed), f"at most {MAX_STOPS}")
    grid, cells = task.grid, dict[tuple[int, int], int]()
    for k, stop in enumerate(listed):
        label = f"stops[{k}]" + (f" ({stop.name})" if checks.instance(f"stops[{k}]", stop, Stop).name else "")
        try:
            cell = grid.cell_at(stop.at)
        except OutOfBounds as error:
            raise error.at("", label) from None
        check_clear(task, label, stop.at)
        if cells.setdefault(cell, k) != k:
            raise BadParameter(label, stop.at, f"a stop of its own; stops[{cells[cell]}] is in the same cell")
    return tuple(listed)


class Visit(NamedTuple):
    """A visit of a stop: times of arrival, start of service, and departure, s."""

    stop: int
    arrival: float
    start: float
    end: float


class Turn(NamedTuple):
    """A decision on the order: its time, s, the remaining stops in order, and the reason."""

    t: float
    order: tuple[int, ...]
    reason: str


@dataclass(frozen=True, slots=True)
class Rounds:
    """The record of a robot's rounds."""

    stops: tuple[Stop, ...]
    visits: tuple[Visit, ...] = ()  # in the order of time
    turns: tuple[Turn, ...] = ()  # the first order, and each one that replaced it

    def lateness(self, visit: Visit) -> float:
        """Return by how much service started after the window, s."""
        return max(0.0, visit.start - self.stops[visit.stop].window[1])

    @property
    def missed(self) -> tuple[int, ...]:
        """The stops that were not visited."""
        visited = {visit.stop for visit in self.visits}
        return tuple(stop for stop in range(len(self.stops)) if stop not in visited)

    def name(self, stop: int) -> str:
        """Return the name of a stop, or "stop N"."""
        return self.stops[stop].name or f"stop {stop}"

    def record(self) -> dict[str, Any]:
        """Return the rounds as JSON values; the end of an unlimited window is None."""
        return {
            "stops": [
                {
                    "name": stop.name,
                    "at": list(stop.at),
                    "window": [stop.window[0], stop.window[1] if math.isfinite(stop.window[1]) else None],
                    "service": stop.service,
                }
                for stop in self.stops
            ],
            "visits": [list(visit) for visit in self.visits],
            "turns": [[turn.t, list(turn.order), turn.reason] for turn in self.turns],
        }
