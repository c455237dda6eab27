"""What policy antway knows in an episode, and what its colony is given: the planning context, a memory, pheromone."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from antway.errors import OutOfBounds
from antway.grid import Cell, Grid, Moves
from antway.kernels.base.records import Terrain
from antway.kernels.crossing import Crowd, Plan, Settings
from antway.kernels.spacetime.context import PlanningContext
from antway.kernels.spacetime.memory import HEAP, KNOTS, LEGS, NEAR, SEGMENTS, STATES, Memory
from antway.kernels.spacetime.pheromone import TRAILS, Trails
from antway.kernels.spacetime.prepare import move_mask
from antway.kernels.tracking import crowd, prediction_error
from antway.planning import TimedPath, standing_cell
from antway.policies.antway.controls import ControlColony
from antway.policies.antway.detours import Detours
from antway.policies.antway.tracker import MOST_ROWS, ROWS, Tracker, longer
from antway.policies.guard import relative_swerve
from antway.search.sipp import timed_field, timed_moves
from antway.world.line_of_sight import nearest_free
from antway.world.policy import XY, Decision, Observation, RobotSpec, Task

_HERE = np.zeros((1, 2), np.int32)  # a single move of length 0; read-only like all moves, so that the kernel is compiled once
_HERE.flags.writeable = False
_BRAKES = 0.5  # s; with tracks in sight, a robot that follows the plan drives no faster than it can brake from in this time
_RADII = 6  # number of discs tried, from the one around the footprint to the one inside it
_LEAST_RADIUS = 0.1  # 1; no disc is smaller than this share of the first, because a footprint may turn about a point beside it
_FAR_CELLS = 20  # number of cells around the start and the goal among which a free one is searched for
_MOST_CELLS = 1_000_000  # limit of cells of a map after its cells are divided
_WALL_MARGIN = 0.05  # m; robots with inertia keep this from walls where they can, because ramps within a cycle cut corners
_FINE = 0.4  # 1; cells of the field that such robots follow are no larger than this share of the radius
_ENDS = 1.0  # m; no wall margin is kept this near to the start and the goal, where one of them is too near to a wall
_SEGMENTS = 48  # limit of motion segments of a track: the steps of its trajectory, the widths of its tube, four walls
Paces = tuple[tuple[PlanningContext, float], ...]


class Cycle(NamedTuple):
    """The control cycle that the explanation is about."""

    observation: Observation
    arrival: float  # s; arrival of the plan at the goal, absolute
    bound: float  # s; lower bound on any arrival, absolute


@dataclass(slots=True, eq=False)
class State:
    """All that policy antway knows in one episode; `AntwayPolicy.reset` makes a new one.

    Attributes
    ----------
    paces : pair of (PlanningContext, stopping time in s)
        For full speed while no track is known, and for the slower pace among tracks.
    context : PlanningContext
        That of the pace in use.
    memory : Memory or None
        To search in; None: that of the thread (`shared_memory`).
    tracker : Tracker
        The track estimates.
    rng : uint64[1]
        State of the random generator.
    detours : Detours
        Times to the goal that count with obstacles which stay.
    controls : ControlColony or None
        What drives a robot with inertia or wheels.
    started : float
        Time of the first observation, s; NaN before.
    path : TimedPath or None
        The plan in use, as it was made.
    cycle : Cycle or None
        The control cycle that the explanation is about.
    guard_did : str
        What the guard did then.
    decision : Decision or None
        The explanation; None: it has to be made.
    until : float
        Time at which the explanation is renewed at the latest, s.
    """

    task: Task
    terrain: Terrain
    settings: Settings
    paces: Paces
    context: PlanningContext
    memory: Memory | None
    trails: Trails
    plan: Plan
    crowd: Crowd
    rng: NDArray[np.uint64]
    detours: Detours
    controls: ControlColony | None = None
    tracker: Tracker = field(default_factory=Tracker)
    started: float = math.nan
    path: TimedPath | None = None
    cycle: Cycle | None = None
    guard_did: str = ""
    decision: Decision | None = None
    until: float = math.inf


class _Shared(threading.local):
    memory: Memory | None = None


_SHARED = _Shared()


def shared_memory(cells: int) -> Memory:
    """Return the one memory of this thread for searches on maps of so many cells; each search begins with an empty one."""
    memory = _SHARED.memory
    if memory is None or len(memory.stamp) != cells:
        memory = _SHARED.memory = make_memory(cells)
    return memory


def make_memory(cells: int, states: int = STATES, heap: int = HEAP) -> Memory:
    """Return an empty memory for a map of so many cells."""

    def ints(n: int) -> NDArray[np.int32]:
        return np.zeros(n, np.int32)

    return Memory(
        stamp=ints(cells),
        first=ints(cells),
        intervals=ints(cells),
        latest=np.zeros(cells),
        near=np.zeros((cells + 1, 2), np.int32),
        near_segment=ints(NEAR),
        near_time=np.zeros((NEAR, 2)),
        box=np.zeros((SEGMENTS, 4)),
        cell=ints(states),
        low=np.zeros(states),
        high=np.zeros(states),
        arrival=np.zeros(states),
        depart=np.zeros(states),
        distance_cost=np.zeros(states),
        parent=ints(states),
        tried=np.zeros(states, np.uint64),
        key=np.zeros(states),
        heap_key=np.zeros(heap),
        heap_state=ints(heap),
        leg_cell=np.zeros(LEGS, np.int64),
        leg_time=np.zeros(LEGS),
        span=np.zeros((2, SEGMENTS)),
        knots=np.zeros((KNOTS, 3)),
        segments=np.zeros((SEGMENTS, 8)),
        counter=np.zeros(6, np.int64),
    )


def make_trails(cells: int, bin: float = 0.5) -> Trails:
    """Return an empty table of pheromone for a map of so many cells and bins of arrival of `bin` s."""
    return Trails(np.full(TRAILS, -1, np.int64), np.zeros(TRAILS, np.float32), np.zeros(cells, np.bool_), bin)


def make_plan() -> Plan:
    """Return the record of a plan, without one yet."""
    state = np.array([0.0, math.inf, 0.0, 0.0, 0.0, 0.0, 0.0])
    return Plan(np.empty((KNOTS, 3)), np.empty((most_segments(ROWS), 8)), state)


def make_crowd(task: Task) -> Crowd:
    """Return the predictions of no tracks yet. The less obstacles may swerve, the less wrong predictions seem at first."""
    error, weight = prediction_error.POOL
    return Crowd(
        rows=np.zeros((ROWS, crowd.COLUMNS)),
        counts=np.zeros(2, np.int64),
        prediction=np.empty((ROWS, crowd.STEPS, 2)),
        averaged=np.zeros((ROWS, 8)),
        stored=np.zeros((ROWS, prediction_error.COLUMNS)),
        pool=np.array([error * relative_swerve(task), weight]),
        missed=np.zeros(1, np.int64),
        velocity_error=np.zeros(ROWS),
    )


def planning_context(task: Task, moves: Moves) -> tuple[PlanningContext, Cell, Cell]:
    """Return the planning context of a task, and the cells at which its paths start and end.

    The context is that of the largest disc that has a path, of a few from the disc around the footprint down to the one inside
    it. A smaller disc finds the path through a door that is hardly wider than the robot, and its path leads through the middle.
    Rollouts and the guard test the footprint itself.

    Raises
    ------
    OutOfBounds, CellBlocked
        If the robot does not fit at the start or at the goal.
    """
    grid, robot = task.grid, task.robot
    ends = {"start": task.start, "goal": task.goal}
    widest = None
    narrowest = max(robot.inscribed, _LEAST_RADIUS * robot.radius)
    for radius in dict.fromkeys(np.linspace(robot.radius, narrowest, _RADII).tolist()):
        # The same as Grid.inflate, but faster for a robot of few cells.
        stands = move_mask(grid.blocked, _HERE, radius / grid.resolution)
        inflated = replace(grid, blocked=stands == 0)
        start, goal = (_end_cell(task, inflated, radius, name, xy) for name, xy in ends.items())
        if start is None or goal is None:
            continue
        context = make_context(grid, replace(robot, radius=radius, footprint=None), goal, moves)
        if math.isfinite(context.field[start[0] * grid.shape[1] + start[1]]):
            return context, start, goal
        widest = widest or (context, start, goal)
    if widest is None:
        for name, xy in ends.items():
            standing_cell(name, xy, grid, inflated, radius)
    assert widest is not None, "standing_cell has raised the error"
    return widest


def _end_cell(task: Task, inflated: Grid, radius: float, name: str, xy: XY) -> Cell | None:
    """Return the cell of `xy` if it is free, or else the nearest free one to which the robot can drive straight, or None."""
    try:
        cell = inflated.cell_at(xy)
    except OutOfBounds as error:
        raise error.at("", name) from None
    if inflated.is_free(cell):
        return cell
    inscribed = task.robot.inscribed
    cells = min(2 + math.ceil((radius - inscribed) / inflated.resolution), _FAR_CELLS)
    return nearest_free(task, inflated, xy, cells, inscribed)


def make_context(
    grid: Grid, robot: RobotSpec, goal: Cell, moves: Moves = Moves.THIRTY_TWO, mask: NDArray[np.uint32] | None = None
) -> PlanningContext:
    """Return the moves that the disc of `robot` can make on `grid`, and the exact field to `goal` over them.

    With `mask` those moves of `timed_moves` alone.
    """
    (x, y, _), size, cols = grid.origin, grid.resolution, grid.shape[1]
    mask = timed_moves(grid, robot.radius, moves) if mask is None else mask
    field = timed_field(mask, moves, goal, scale=size / robot.v_max)
    offsets = moves.offsets.astype(np.int64)
    return PlanningContext(
        blocked=grid.blocked,
        legal=mask.ravel(),
        field=field.ravel(),
        offset=offsets[:, 0] * cols + offsets[:, 1],
        step=np.column_stack((offsets[:, 1] * size, offsets[:, 0] * size, moves.lengths * (size / robot.v_max))),
        resolution=size,
        x0=x + size / 2,
        y0=y + size / 2,
        radius=robot.radius,
        speed=robot.v_max,
        goal=goal[0] * cols + goal[1],
    )


def full_and_careful(context: PlanningContext, stopping_time: float, robot: RobotSpec, guarded: bool) -> Paces:
    """Return the planning context and stopping time without and with tracks in sight, for a robot that follows the plan.

    A braking path grows with the square of the speed, so a slower robot passes gaps at which a faster one would wait.
    """
    slow = min(robot.v_max, _BRAKES * robot.a_max)
    share = robot.v_max / slow
    careful = context._replace(field=context.field * share, step=context.step * [1.0, 1.0, share], speed=slow)
    return (context, stopping_time), (careful, robot.dt + slow / robot.a_max if guarded else 0.0)


def most_segments(tracks: int) -> int:
    """Return how many motion segments may be predicted of so many tracks."""
    return min(_SEGMENTS * tracks, SEGMENTS)


def fit_tables(s: State, tracks: int) -> None:
    """Make the tables of tracks longer, up to MOST_ROWS, if the `tracks` of a scan and all known before might not fit."""
    tracker = s.tracker
    needed = max(tracker.count, tracker.averages_count, int(s.crowd.counts.max())) + tracks
    n = min(2 * needed, MOST_ROWS)
    if needed <= len(tracker.table) or n <= len(tracker.table):
        return
    tracker.resize(n)
    s.plan = s.plan._replace(segments=longer(s.plan.segments, most_segments(n)))
    c = s.crowd
    s.crowd = c._replace(
        rows=longer(c.rows, n),
        prediction=longer(c.prediction, n),
        averaged=longer(c.averaged, n),
        stored=longer(c.stored, n),
        velocity_error=longer(c.velocity_error, n),
    )


def without_edges(settings: Settings) -> Settings:
    """Return the settings for obstacles that do not turn back at the edges of the map, as one was seen to cross them."""
    open_ended = {name: getattr(settings, name)._replace(edges=False) for name in ("tubes", "narrow_tubes", "wide_tubes")}
    return settings._replace(**open_ended)


def away_from_walls(task: Task, context: PlanningContext, start: Cell, goal: Cell, moves: Moves) -> PlanningContext:
    """Return the context of `planning_context` with a margin to walls, if a path from the start to the goal keeps it.

    If there is none, because an end is too near to a wall, the margin is left out near both ends, or else everywhere.
    """
    grid, radius = task.grid, context.radius
    wide = timed_moves(grid, radius + _WALL_MARGIN, moves)
    rows, cols = np.ogrid[: grid.shape[0], : grid.shape[1]]
    ends = np.zeros(grid.shape, dtype=bool)
    for row, col in (start, goal):
        ends |= np.hypot(rows - row, cols - col) * grid.resolution <= _ENDS
    mixed = np.where(ends, context.legal.reshape(grid.shape), wide)
    for mask, kept in ((wide, radius + _WALL_MARGIN), (mixed, radius)):
        found = make_context(grid, replace(task.robot, radius=kept, footprint=None), goal, moves, mask)
        if math.isfinite(found.field[start[0] * grid.shape[1] + start[1]]):
            return found
    return context


def with_fine_cells(task: Task) -> Task:
    """Return the task on the same map in cells no larger than a part of the robot, as far as they are not too many.

    Moves of 32 directions lead through cells in whose centre a robot cannot stand. If such cells are larger than the robot, a
    field that is interpolated between centres has a ridge across these moves, before which the robot would stop. Large
    cells also do not show whether a passage is slightly wider than the robot or too narrow.
    """
    grid = task.grid
    finer = min(math.ceil(grid.resolution / (_FINE * task.robot.radius) - 1e-9), math.isqrt(_MOST_CELLS // grid.blocked.size))
    if finer <= 1:
        return task
    cells = np.repeat(np.repeat(grid.blocked, finer, axis=0), finer, axis=1)
    return replace(task, grid=replace(grid, blocked=cells, resolution=grid.resolution / finer))
