"""Stops of a robot's rounds: where, when and how long; and the record of the visits."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
        set_ = object.__setattr__
        set_(self, "at", checks.point("at", self.at))
        checks.instance("name", self.name, str)
        set_(self, "window", checks.window("window", self.window))
        set_(self, "service", checks.number("service", self.service, low=0.0, high=1e9, unit="s"))


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
    """The record of a robot's rounds.

    Attributes
    ----------
    stops : tuple of Stop
    visits : tuple of Visit
        In the order of time.
    turns : tuple of Turn
        The first order, and each one that replaced it.
    """

    stops: tuple[Stop, ...]
    visits: tuple[Visit, ...] = ()
    turns: tuple[Turn, ...] = ()

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
                    "name": self.name(k),
                    "at": list(stop.at),
                    "window": [stop.window[0], stop.window[1] if math.isfinite(stop.window[1]) else None],
                    "service": stop.service,
                }
                for k, stop in enumerate(self.stops)
            ],
            "visits": [list(visit) for visit in self.visits],
            "turns": [[turn.t, list(turn.order), turn.reason] for turn in self.turns],
        }


def rounds_of(record: object, where: str = "") -> Rounds:
    """Return the rounds from a record of `Rounds.record`; a `BadParameter` names what is wrong."""

    def listed(field: str, value: object, parts: int | None = None) -> list[Any]:
        if not isinstance(value, list) or (parts is not None and len(value) != parts):
            raise BadParameter(field, value, "a list" if parts is None else f"a list of {parts}", where=where)
        return value

    def table(field: str, value: object, keys: Sequence[str]) -> dict[str, Any]:
        if not isinstance(value, dict) or any(key not in value for key in keys):
            raise BadParameter(field, value, f"a table of {', '.join(keys)}", where=where)
        return value

    parts = table("rounds", record, ("stops", "visits", "turns"))
    stops = []
    for k, one in enumerate(listed("rounds.stops", parts["stops"])):
        stop = table(f"rounds.stops[{k}]", one, ("name", "at", "window", "service"))
        early, late = listed(f"rounds.stops[{k}].window", stop["window"], 2)
        stops.append(Stop(stop["at"], stop["name"], (early, math.inf if late is None else late), stop["service"]))
    visits = []
    for k, one in enumerate(listed("rounds.visits", parts["visits"])):
        field = f"rounds.visits[{k}]"
        stop, *times = listed(field, one, 4)
        number = checks.integer(field, stop, low=0, high=len(stops) - 1, where=where)
        visits.append(Visit(number, *(checks.number(field, time, where=where) for time in times)))
    turns = []
    for k, one in enumerate(listed("rounds.turns", parts["turns"])):
        field = f"rounds.turns[{k}]"
        t, order, reason = listed(field, one, 3)
        numbers = [checks.integer(field, i, low=0, high=len(stops) - 1, where=where) for i in listed(field, order)]
        turns.append(Turn(checks.number(field, t, where=where), tuple(numbers), checks.instance(field, reason, str)))
    return Rounds(tuple(stops), tuple(visits), tuple(turns))
