"""What policy antway knows in an episode, and what its colony is given: the planning context, a memory, pheromone."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from antway.errors import CellBlocked, OutOfBounds
from antway.grid import Grid, Moves
from antway.kernels.base.records import Terrain
from antway.kernels.controls.problem import StaticField
from antway.kernels.crossing import ARRIVAL, KNOT_COUNT, Crowd, PlanInUse, PolicySettings
from antway.kernels.spacetime.context import PlanningContext
from antway.kernels.spacetime.memory import HEAP, KNOTS, LEGS, NEAR, SEGMENTS, STATES, Memory
from antway.kernels.spacetime.pheromone import TRAILS, Trails
from antway.kernels.tracking import crowd, curves, prediction_error
from antway.kernels.tracking.predict import ID
from antway.kernels.tracking.scan import TrackEstimates
from antway.kernels.tracking.table import make_table
from antway.planning import TimedPath
from antway.policies.antway.controls import ControlColony
from antway.policies.antway.detours import Detours, Times
from antway.policies.antway.nodes import ContextPair, contexts_for
from antway.policies.antway.response import Response
from antway.policies.antway.tracker import MOST_ROWS, Tracker
from antway.policies.antway.yielding import Dance, Yielding
from antway.policies.guard import relative_swerve
from antway.world.ants import LaidTrails
from antway.world.policy import XY, Decision, Observation, RobotSpec, Task
from antway.world.rollouts import with_times

_BRAKES = 0.5  # s; with tracks in sight, a robot that follows the plan drives no faster than it can brake from in this time
_BIN = 0.5  # s; pheromone is kept for bins of arrival of this width
_OUTSET = 0.5  # s; during this time after the start, the velocities of tracks are not known well yet
_NEARBY = 3.0  # s; during the outset, the robot plans around predictions only up to this time ahead
_WALKS = 0.3  # m/s; once a track was faster than this, the fastest observed speed is taken as the preferred speed of all
Paces = tuple[tuple[PlanningContext, float], ...]  # each with its stopping time, s


@dataclass(slots=True, eq=False)
class State:
    """All that policy antway knows in one episode; `AntwayPolicy.reset` makes a new one."""

    task: Task
    surroundings: Grid  # the map on which obstacles move; that of the task may be a part of it
    terrain: Terrain  # the same for kernels
    settings: PolicySettings
    paces: Paces  # for full speed while no track is known, and for the slower pace among tracks
    context: PlanningContext  # that of the pace in use
    memory: Memory | None  # to search in; None: that of the thread (`shared_memory`)
    trails: Trails
    plan: PlanInUse
    tracker: Tracker
    crowd: Crowd
    seed: int  # of the episode
    rng: NDArray[np.uint64]  # [1] state of the random generator
    detours: Detours  # times to the goal that count with obstacles which stay
    response: Response  # how the robot answers commands
    yielding: Yielding  # what the robot waits for, and what it was asked for while it gives way
    dance: Dance = field(default_factory=Dance)  # whether it stands after it and an obstacle kept stepping aside for each other
    controls: ControlColony | None = None  # what drives a robot with inertia or wheels
    started: float = math.nan  # s; time of the first observation
    path: TimedPath | None = None  # the plan in use, as it was made
    # The control cycle that the explanation is about: what was observed, when the plan arrives at the goal, and a lower bound
    # on any arrival, s; and what the guard did then, and whether the command was to stand.
    cycle: tuple[Observation, float, float] | None = None
    did: tuple[str, bool] = ("", False)
    decision: Decision | None = None  # the explanation; None: it has to be made
    until: float = math.inf  # s; time at which the explanation is renewed at the latest


Counted = tuple[Times, StaticField | None]  # times to the goal, and the field for them of the colony in the space of controls
_SHARED = threading.local()


def shared_memory(cells: int) -> Memory:
    """Return the one memory of this thread for searches on maps of so many cells; each search begins with an empty one."""
    memory: Memory | None = getattr(_SHARED, "memory", None)
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
        span=np.zeros((SEGMENTS, 2)),
        knots=np.zeros((KNOTS, 3)),
        segments=np.zeros((SEGMENTS, 8)),
        counter=np.zeros(5, np.int64),
    )


def make_trails(cells: int) -> Trails:
    """Return an empty table of pheromone for a map of so many cells."""
    return Trails(np.full(TRAILS, -1, np.int64), np.zeros(TRAILS, np.float32), np.zeros(cells, np.bool_), _BIN)


def make_plan() -> PlanInUse:
    """Return the record of a plan, without one yet."""
    state = np.array([0.0, math.inf, 0.0, 0.0, 0.0, 0.0, 0.0])
    return PlanInUse(np.empty((KNOTS, 3)), np.empty((SEGMENTS, 8)), state)


def make_crowd(task: Task, tracks: TrackEstimates) -> Crowd:
    """Return empty tables for predictions of `tracks`, which a tracker updates.

    The less obstacles may swerve, the less wrong predictions seem at first.
    """
    rows, (error, weight) = MOST_ROWS, prediction_error.POOL
    return Crowd(
        people=make_table(rows, crowd.COLUMNS, ID),
        prediction=np.empty((rows, crowd.STEPS, 2)),
        tracks=tracks,
        turning=curves.Turning(make_table(rows, curves.COLUMNS), np.zeros(curves.POOL), np.zeros(rows)),
        stored=make_table(rows, prediction_error.COLUMNS),
        pool=np.array([error * relative_swerve(task), weight]),
        missed=np.zeros(1, np.int64),
        velocity_error=np.zeros(rows),
    )


def drop_plan(plan: PlanInUse) -> None:
    """Let the next cycle plan anew."""
    plan.state[KNOT_COUNT], plan.state[ARRIVAL] = 0, math.inf


def other_times(s: State, counted: Callable[[], Times]) -> Counted:
    """Return the times that `Detours.update` has returned a call for, and the field for them."""
    times, c = counted(), s.controls
    return times, None if c is None else with_times(c.problem.field, c.task, times[1][1].reshape(c.task.grid.shape))


def set_times(s: State, times: Times, field: StaticField | None) -> None:
    """Plan and drive from now on by these results of `other_times`."""
    s.detours.adopt(times)
    s.paces = tuple((s.detours.timed(context), stopping_time) for context, stopping_time in s.paces)
    drop_plan(s.plan)
    if s.controls is not None and field is not None:
        s.controls.set_field(field)


def carried_on(new: State, old: State) -> State:
    """Return the state `new` with what is known of obstacles in `old`, and without a plan."""
    drop_plan(old.plan)
    new.detours.go_on(old.detours)
    settings = new.settings if old.settings.tubes.edges else without_edges(new.settings)
    names = "surroundings", "terrain", "plan", "crowd", "tracker", "started", "yielding", "dance"
    return replace(new, settings=settings, **{name: getattr(old, name) for name in names})


def contexts_from(place: XY | None, task: Task, moves: Moves, heading: float) -> tuple[ContextPair, ContextPair | None]:
    """Return `contexts_for` of a robot at `place`, m, or at the start of the task if that is None or it does not fit there."""
    if place is not None:
        with suppress(CellBlocked, OutOfBounds):
            return contexts_for(replace(task, start=place), moves, heading)
    return contexts_for(task, moves, heading)


def is_cut_off(s: State, o: Observation) -> bool:
    """Tell whether the map has no path to the goal from where the robot is, or from nearby."""
    return s.detours.is_cut_off(o.xy, s.settings.colony.leg_cells)


def taken_over(new: State, old: State) -> State:
    """Return the state `new` for another task of the robot, with what is known of it and of obstacles in `old`."""
    own = {name: getattr(new, name) for name in ("surroundings", "terrain", "yielding", "dance")}
    return replace(carried_on(new, old), response=old.response, **own)


def laid_trails(trails: Trails, context: PlanningContext) -> LaidTrails:
    """Return the pheromone on moves between places, its maximum over all times of arrival."""
    used = np.flatnonzero(trails.key >= 0)
    cell, move = trails.key[used] // 64 % (context.rows * context.cols), trails.key[used] % 64
    key, at = np.unique(cell * 64 + move, return_inverse=True)
    amount = np.zeros(len(key))
    np.maximum.at(amount, at, trails.tau[used])
    row, col = np.divmod(key // 64, context.cols)
    here = np.column_stack((context.x0 + col * context.resolution, context.y0 + row * context.resolution))
    return LaidTrails(here, here + context.step[key % 64, :2], amount)


def full_and_careful(context: PlanningContext, stopping_time: float, robot: RobotSpec, guarded: bool) -> Paces:
    """Return the planning context and stopping time without and with tracks in sight, for a robot that follows the plan.

    A braking path grows with the square of the speed, so a slower robot passes gaps at which a faster one would wait.
    """
    slow = min(robot.v_max, _BRAKES * robot.a_max)
    share = robot.v_max / slow
    careful = context._replace(field=context.field * share, step=context.step * [1.0, 1.0, share], speed=slow)
    return (context, stopping_time), (careful, robot.dt + slow / robot.a_max if guarded else 0.0)


def update_tracks(s: State, o: Observation) -> None:
    """Update the track estimates with a scan."""
    robot = s.task.robot
    s.tracker.update(o.tracks, o.sensed_at, s.terrain, o.xy, robot.sensor_range, not robot.stepwise)
    if s.tracker.beyond_edge and s.settings.tubes.edges:
        s.settings = without_edges(s.settings)


def adapt_settings(s: State, now: float, horizon: float) -> None:
    """Choose the pace, the preferred speed and the horizon, at most `horizon` s, by what is known of the tracks."""
    s.context, stopping_time = s.paces[len(s.tracker.estimates) > 0]
    if math.isnan(s.started):
        s.started = now
    preferred = s.tracker.fastest if s.tracker.fastest > _WALKS else float(s.task.obstacle_speed)
    if preferred != s.settings.preferred_speed:
        s.settings = s.settings._replace(preferred_speed=preferred)
    is_known = now >= s.started + _OUTSET - 1e-6
    if stopping_time != s.settings.tubes.stopping_time or is_known != s.settings.stores_predictions:
        s.settings = s.settings._replace(
            horizon=horizon if is_known else min(horizon, _NEARBY),
            stores_predictions=is_known,
            tubes=s.settings.tubes._replace(stopping_time=stopping_time),
            wide_tubes=s.settings.wide_tubes._replace(stopping_time=stopping_time),
        )


def without_edges(settings: PolicySettings) -> PolicySettings:
    """Return the settings for obstacles that do not turn back at the edges of the map, as one was seen to cross them."""
    open_ended = {name: getattr(settings, name)._replace(edges=False) for name in ("tubes", "narrow_tubes", "wide_tubes")}
    return settings._replace(**open_ended)
