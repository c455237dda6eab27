"""A problem, a plan, the budget of a planner, and the one table of planners."""

from __future__ import annotations

import importlib
import inspect
import math
import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, fields
from enum import Enum
from functools import lru_cache
from importlib.metadata import entry_points
from os import PathLike
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, CellBlocked, OutOfBounds, described_error
from antway.grid import Cell, Grid, Moves, checked_cell
from antway.lazy import drawing
from antway.tables import PLANNERS as PLANNERS


@dataclass(frozen=True, slots=True)
class Problem:
    """Go from `start` to `goal`, both (row, col), on `grid` by `moves`.

    Raises
    ------
    OutOfBounds, CellBlocked, BadParameter
        If an end is not on the map, is blocked, or is not a pair of integers.

    Examples
    --------
    >>> Problem(Grid(np.zeros((2, 2), dtype=bool)), (0, 0), (5, 0))
    Traceback (most recent call last):
    antway.errors.OutOfBounds: goal = (5, 0): must be on the map of 2 rows and 2 columns
    """

    grid: Grid
    start: Cell
    goal: Cell
    moves: Moves = Moves.EIGHT

    def __post_init__(self) -> None:
        grid = checks.instance("grid", self.grid, Grid)
        checks.instance("moves", self.moves, Moves)
        start, goal = free_cell("start", self.start, grid), free_cell("goal", self.goal, grid)
        if start is not self.start or goal is not self.goal:
            object.__setattr__(self, "start", start)
            object.__setattr__(self, "goal", goal)


def free_cell(name: str, value: object, grid: Grid) -> Cell:
    """Return `value` as a free (row, col) of `grid`, or raise the error that says what is wrong."""
    cell = checked_cell(name, value)
    if not grid.contains(cell):
        rows, cols = grid.blocked.shape
        raise OutOfBounds(name, cell, f"on the map of {rows} rows and {cols} columns")
    if grid.blocked[cell]:
        raise CellBlocked(name, cell, "a free cell; this one is blocked")
    return cell


def standing_cell(name: str, xy: Iterable[float], grid: Grid, inflated: Grid, radius: float) -> Cell:
    """Return the cell that contains (x, y) in m. It must be free in `inflated`, which is `grid` inflated by `radius`."""
    point = checks.point(name, xy)
    try:
        cell = inflated.cell_at(point)
    except OutOfBounds as error:
        raise error.at("", name) from None
    if inflated.blocked[cell]:
        near = f" with a radius of {radius:g} m; a wall or the map's edge is nearer to the centre of its cell"
        raise CellBlocked(name, point, f"where the robot can stand{'; this cell is blocked' if grid.blocked[cell] else near}")
    return cell


class Status(Enum):
    """How a search ended: with a path, with the proof that there is none, or out of budget (a path found so far is kept).

    Examples
    --------
    >>> import numpy as np
    >>> from antway import Grid, Problem, solve
    >>> wall = Grid(np.array([[False, True, False]]), 1.0)
    >>> solve(Problem(wall, (0, 0), (0, 2))).status is Status.NO_PATH
    True
    """

    FOUND = "found"
    NO_PATH = "no-path"
    BUDGET = "budget"


@dataclass(frozen=True, slots=True)
class Budget:
    """When a planner stops: after `seconds` (None or infinite: no limit), after `cycles` of a colony, or when `cancel` is set.

    A planner calls `start()` once and then asks the returned clock; the two tests cost about 0.1 microseconds.

    Examples
    --------
    >>> Budget(seconds=0.0).start().spent()
    True
    """

    seconds: float | None = None
    cycles: int | None = None
    cancel: threading.Event | None = None

    def __post_init__(self) -> None:
        if self.seconds is not None:
            checks.fields(self, "seconds", low=0.0, infinite=True, unit="s")
        if self.cycles is not None:
            checks.counts(self, "cycles", low=0)
        if self.cancel is not None:
            checks.instance("cancel", self.cancel, threading.Event)

    def start(self) -> Clock:
        """Start a clock."""
        started = time.perf_counter()
        return Clock(started, math.inf if self.seconds is None else started + self.seconds, self.cancel)


class Clock(NamedTuple):
    """A running budget."""

    started: float  # s, by `time.perf_counter`
    end: float  # s; infinite without a limit
    cancel: threading.Event | None

    def spent(self) -> bool:
        """Tell whether time is up or the work was cancelled."""
        return time.perf_counter() >= self.end or (self.cancel is not None and self.cancel.is_set())

    def elapsed(self) -> float:
        """Return the seconds since the start."""
        return time.perf_counter() - self.started


def start_clock(problem: Problem, seed: int, budget: Budget) -> Clock:
    """Check the arguments that all planners share, and start the clock."""
    checks.instance("problem", problem, Problem)
    checks.seed(seed)
    return checks.instance("budget", budget, Budget).start()


_NO_CELLS = np.empty((0, 2), dtype=np.int32)
_NO_CELLS.flags.writeable = False


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """A planner's answer.

    Attributes
    ----------
    status : Status
    cells : int32[N, 2]
        (row, col) from start to goal, consecutive ones a move apart; empty unless a path was found.
    length : float
        Length in m (moves times resolution); infinite without a path.
    optimal : bool
        Whether the planner proved that no path of its moves is shorter.
    expanded : int
        Nodes expanded, or ant steps made. Planners count differently: `dijkstra` leaves out cells within straight runs,
        `jps` all but jump points.
    elapsed : float
        Time taken in s.
    lower_bound : float
        Lower bound of the length of any path, m; length / lower_bound - 1 is a certified gap.
    points : float64[M, 2] or None
        For an any-angle path its vertices as real-valued (row, col), integers at cell centres. `cells` are then the free cells
        along it, in which each is one of the 8 neighbours of the one before, and `length` is that of the polyline.
    grid : Grid or None
        The map, for pictures.

    Examples
    --------
    >>> from antway import load_map, plan
    >>> plan(load_map("office"), (1.5, 3.0), (22.0, 12.5), robot_radius=0.25)
    Plan(found, 26.017 m, 233 cells, optimal)
    """

    status: Status
    cells: NDArray[np.int32] = field(default_factory=lambda: _NO_CELLS)
    length: float = math.inf
    optimal: bool = False
    expanded: int = 0
    elapsed: float = 0.0
    lower_bound: float = 0.0
    points: NDArray[np.float64] | None = None
    grid: Grid | None = field(default=None, repr=False)

    def __repr__(self) -> str:
        if not len(self.cells):
            return f"Plan({self.status.value})"
        within = f"within {100 * self.gap:.1f} % of the best" if math.isfinite(self.gap) else "nothing proved"
        proof = "optimal" if self.optimal else within
        cells = f"{len(self.cells)} cell{'s' * (len(self.cells) > 1)}"
        return f"Plan({self.status.value}, {self.length:.3f} m, {cells}, {proof})"

    def _repr_html_(self) -> str:
        return str(drawing().html(self))

    def plot(self, grid: Grid | None = None, *, out: str | PathLike[str] | None = None) -> Any:
        """Draw the plan on its map, or on `grid`, as a Matplotlib figure; `out` is a .png, .svg or .pdf to write it to.

        Raises
        ------
        BadParameter
            If no map is known (plans of `plan` and `solve` know theirs), or for another suffix.
        """
        figure = drawing().figure_of(self, grid)
        if out is not None:
            drawing().style.save(figure, out)
        return figure

    def __post_init__(self) -> None:
        checks.instance("cells", self.cells, np.ndarray).setflags(write=False)
        if self.points is not None:
            checks.instance("points", self.points, np.ndarray).setflags(write=False)

    def __reduce__(self) -> tuple[object, ...]:
        # Copies and unpickled plans use the constructor, so that their arrays are read-only too.
        return type(self), tuple(getattr(self, one.name) for one in fields(self))

    def xy(self, grid: Grid) -> NDArray[np.float64]:
        """Return the path's vertices in m, float64[N, 2]."""
        return checks.instance("grid", grid, Grid).to_xy(self.cells if self.points is None else self.points)

    @property
    def gap(self) -> float:
        """The certified gap: the length is at most (1 + gap) times the shortest one; infinite if nothing is certified."""
        if self.length == self.lower_bound:
            return 0.0
        return self.length / self.lower_bound - 1 if self.lower_bound > 0 else math.inf


@dataclass(frozen=True, slots=True, eq=False)
class TimedPath:
    """A path in time: it is at `xy[i]` m at `t[i]` s (increasing), and straight at constant speed in between.

    Raises
    ------
    BadParameter
        For arrays that do not fit together, or times that fall by more than rounding does, 1e-6 s.

    Examples
    --------
    >>> import numpy as np
    >>> TimedPath(np.array([0.0, 2.0]), np.array([[0.0, 0.0], [4.0, 2.0]])).at(1.0)
    (2.0, 1.0)
    """

    t: NDArray[np.float64]
    xy: NDArray[np.float64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "t", checks.array("t", self.t, (None,), finite=False))
        object.__setattr__(self, "xy", checks.array("xy", self.xy, (len(self.t), 2), finite=False))
        rises = self.t >= np.append(self.t[:1], self.t[:-1]) - 1e-6  # False for NaN
        if not rises.all():
            raise BadParameter("t", float(self.t[~rises][0]), "increasing (s)")

    def __reduce__(self) -> tuple[object, ...]:
        return TimedPath, (self.t, self.xy)

    def at(self, t: float) -> tuple[float, float]:
        """Return the place at time `t` s; it is constant before the first and after the last knot.

        Raises
        ------
        BadParameter
            If the path has no knots.
        """
        if not len(self.t):
            raise BadParameter("path", "no knots", "one that was found, to be at a place")
        return float(np.interp(t, self.t, self.xy[:, 0])), float(np.interp(t, self.t, self.xy[:, 1]))


class Planner(Protocol):
    """A planner: a function of a problem, a seed, a budget and its own keyword options that returns a plan."""

    def __call__(self, problem: Problem, *, seed: int = 0, budget: Budget = Budget()) -> Plan: ...


@lru_cache(maxsize=64)
def _load(target: str) -> Any:
    module, _, attribute = target.partition(":")
    return getattr(importlib.import_module(module), attribute)


def find(kind: str, name: object, table: dict[str, str], group: str) -> Any:
    """Return the object called `name`: from `table`, from an entry point of `group`, or imported as MODULE:NAME."""
    if not isinstance(name, str) or name in table:
        return _load(table[checks.choice(kind, name, table)])
    points = {point.name: point for point in reversed(tuple(entry_points(group=group)))}  # the first of a name counts
    if name not in points and ":" not in name:
        raise BadParameter(kind, name, f"one of {', '.join([*table, *sorted(points)])}, or MODULE:NAME")
    try:
        if name in points:
            return points[name].load()
        found = _load(name)
    except (Exception, SystemExit) as error:  # whatever the module raises, and a script that exits when it is imported
        raise BadParameter(kind, name, f"MODULE:NAME of what can be imported; {described_error(error)}") from error
    if not callable(found):
        raise BadParameter(kind, name, f"MODULE:NAME of a {kind}; it is of type {type(found).__name__}")
    return found


def solve(problem: Problem, planner: str = "jps", *, seed: int = 0, time_limit: float | None = None, **options: Any) -> Plan:
    """Solve `problem` with the planner of that name.

    Parameters
    ----------
    problem : Problem
    planner : str
        A name of `PLANNERS`, of an entry point in the group `antway.planners`, or MODULE:NAME.
    seed : int
        In [0, 2**64 - 1]; exact planners ignore it.
    time_limit : float or None
        Seconds, >= 0 (0 is a limit); None or infinite: no limit.
    **options
        The planner's own.

    Raises
    ------
    BadParameter
        For an unknown planner, seed, limit or option, and for a planner that cannot be called as one or returns no plan.

    Examples
    --------
    >>> grid = Grid(np.zeros((3, 3), dtype=bool))
    >>> solve(Problem(grid, (0, 0), (0, 2)), planner="dijkstra").length
    2.0
    """
    checks.instance("problem", problem, Problem)
    if time_limit is not None:
        time_limit = checks.number("time_limit", time_limit, low=0.0, infinite=True, unit="s")
    seed, budget = checks.seed(seed), Budget(seconds=time_limit)
    run = cast(Planner, find("planner", planner, PLANNERS, "antway.planners"))
    if options or planner not in PLANNERS:
        _check_options(planner, run, options)
    found = run(problem, seed=seed, budget=budget, **options)
    if not isinstance(found, Plan):
        raise BadParameter("planner", planner, f"one that returns a Plan; this one returns {found!r:.60}")
    object.__setattr__(found, "grid", problem.grid)
    return found


def _check_options(planner: str, run: Planner, options: dict[str, Any]) -> None:
    """Raise `BadParameter` for no planner, or an option that it does not have; a planner with **options checks them itself."""
    try:
        signature = inspect.signature(run)
        parameters = signature.parameters.values()
        own = {p.name for p in parameters if p.kind is p.KEYWORD_ONLY} - {"seed", "budget"}
        free = any(p.kind is p.VAR_KEYWORD for p in parameters)
        wrong = [name for name in options if name not in own and (name == "budget" or not free)]
        signature.bind(None, seed=0, budget=None, **{name: options[name] for name in options.keys() - wrong})
    except (TypeError, ValueError) as error:
        raise BadParameter("planner", planner, f"a function of a problem, a seed and a budget; {error}") from None
    for name in wrong:
        allowed = f"left out: the planner's own options are {', '.join(sorted(own)) or 'none'}"
        raise BadParameter(name, options[name], allowed)


def plan(
    grid: Grid,
    start: Iterable[float],
    goal: Iterable[float],
    *,
    robot_radius: float = 0.0,
    planner: str = "jps",
    moves: Moves = Moves.EIGHT,
    seed: int = 0,
    time_limit: float | None = None,
    **options: Any,
) -> Plan:
    """Plan from `start` to `goal`, both (x, y) in m, for a disc robot of `robot_radius` m; otherwise as `solve`.

    `time_limit` is in s, None or infinite for no limit. The plan's cells are those of `grid`; the ends are the centres of the
    cells that hold the points. Paths at any angle run along corners of the inflated cells, which may be nearer to walls than
    their centres by 0.71 cells: add that to `robot_radius` for a robot that drives them as they are.

    Examples
    --------
    >>> grid = Grid(np.zeros((20, 20), dtype=bool), resolution=0.1)
    >>> plan(grid, (0.55, 0.55), (1.55, 0.55), robot_radius=0.2, planner="dijkstra").length
    1.0
    """
    checks.instance("grid", grid, Grid)
    if "problem" in options:
        raise BadParameter("problem", options["problem"], "left out: it is made of grid, start, goal and moves")
    inflated = grid.inflate(robot_radius)
    source, target = (standing_cell(name, xy, grid, inflated, robot_radius) for name, xy in (("start", start), ("goal", goal)))
    problem = Problem(inflated, source, target, moves)
    found = solve(problem, planner, seed=seed, time_limit=time_limit, **options)
    object.__setattr__(found, "grid", grid)
    return found
