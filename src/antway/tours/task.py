"""The checked task of a tour on a map: its start, end and stops, their times, and the robots."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from antway import checks
from antway.errors import BadParameter, TooLarge
from antway.grid import Cell, Grid, Moves
from antway.planning import standing_cell
from antway.search.costs import checked_costs
from antway.tours.stops import MAX_STOPS, amounts

Point = tuple[float, float]
Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TourTask:
    """A task of `plan_tour`; its arguments are those of `plan_tour`, which it checks."""

    grid: Grid  # not inflated
    start: Point  # m
    stops: Floats  # [N, 2] m
    names: tuple[str, ...]
    end: Point | Literal["start"] | None  # where robots end: at that point in m, at the start, or at their last stops
    windows: Floats  # [N, 2] earliest and latest start of service in s; 0 and infinite if there is no window
    service: Floats  # [N] s
    priorities: Floats | None  # [N]; None: all stops must be visited
    deadline: float  # s; latest end of each robot
    robots: int
    objective: str  # "travel time" or "makespan"
    speed: float  # m/s
    robot_radius: float  # m
    moves: Moves
    costs: Floats | None  # [H, W] cost of each cell (see `search.costs`): the factor by which a metre takes longer there

    def __post_init__(self) -> None:
        grid = checks.instance("grid", self.grid, Grid)
        checks.instance("moves", self.moves, Moves)
        radius = checks.number("robot_radius", self.robot_radius, low=0.0, unit="m")
        free = grid.inflate(radius)
        origin = _point(self.start, "start")
        listed = checks.sequence("stops", self.stops, "a sequence of points (x, y) in m")
        if not listed:
            raise BadParameter("stops", listed, "one stop or more")
        if len(listed) > MAX_STOPS - 2:
            raise TooLarge("stops", len(listed), f"at most {MAX_STOPS - 2} stops")
        standing_cell("start", origin, grid, free, radius)
        n = len(listed)
        known = _names(self.names, n)
        named = [f" ({name})" for name in known] if self.names is not None else [""] * n  # names of the stops in errors
        first: dict[Cell, int] = {}
        points: list[Point] = []
        for i, place in enumerate(listed):
            field = f"stops[{i}]{named[i]}"
            points.append(_point(place, field))
            k = first.setdefault(standing_cell(field, points[i], grid, free, radius), i)
            if k != i:
                raise BadParameter(field, points[i], f"a stop of its own; stops[{k}]{named[k]} is in the same cell")
        end = self.end
        if isinstance(end, str) and end != "start":
            raise BadParameter("end", end, "a point (x, y) in m, start or None")
        if end is not None and not isinstance(end, str):
            end = _point(end, "end")
            standing_cell("end", end, grid, free, radius)
        service = 0.0 if self.service is None else self.service
        found = {
            "start": origin,
            "stops": checks.array("stops", points, (n, 2)),
            "names": known,
            "end": end,
            "windows": _windows(self.windows, n, named),
            "service": amounts("service", service, n),
            "priorities": None if self.priorities is None else amounts("priorities", self.priorities, n),
            "deadline": checks.number("deadline", self.deadline, low=0.0, infinite=True, unit="s"),
            "robots": checks.integer("robots", self.robots, low=1, high=1_000),
            "objective": checks.objective(self.objective),
            "speed": checks.number("speed", self.speed, low=1e-6, high=1e6, unit="m/s"),
            "robot_radius": radius,
            "costs": None if self.costs is None else checked_costs(self.costs, grid),
        }
        for name, value in found.items():
            object.__setattr__(self, name, value)

    def places(self) -> tuple[Grid, list[Cell]]:
        """Return the inflated grid and the cells of the start, of each stop, and of a separate end."""
        free = self.grid.inflate(self.robot_radius)
        points = [self.start, *((float(x), float(y)) for x, y in self.stops)]
        points += [self.end] if isinstance(self.end, tuple) else []
        return free, [free.cell_at(point) for point in points]


def _point(value: Iterable[float], name: str) -> Point:
    x, y = checks.point(name, value)
    return x, y


def _names(names: Sequence[str] | None, n: int) -> tuple[str, ...]:
    if names is None:
        return tuple(f"stop {i}" for i in range(n))
    listed = checks.sequence("names", names, "a sequence of names")
    if len(listed) != n:
        raise BadParameter("len(names)", len(listed), f"that of stops, {n}")
    return tuple(checks.instance(f"names[{i}]", name, str) for i, name in enumerate(listed))


def _windows(windows: Sequence[Iterable[float] | None] | ArrayLike | None, n: int, named: Sequence[str]) -> Floats:
    """Return windows, each of which may be None, as float64[n, 2]."""
    pairs = np.tile([0.0, math.inf], (n, 1))
    wanted = "(earliest, latest) in s, or None"
    listed = [None] * n if windows is None else checks.sequence("windows", windows, f"for each stop {wanted}")
    if len(listed) != n:
        raise BadParameter("len(windows)", len(listed), f"that of stops, {n}")
    for i, window in enumerate(listed):
        if window is not None:
            pairs[i] = checks.window(f"windows[{i}]{named[i]}", window, wanted)
    pairs.flags.writeable = False
    return pairs
