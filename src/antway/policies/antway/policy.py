"""The policy `antway`: ants plan around moving obstacles in space and time; the exact field over the map does the rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Grid, Moves
from antway.kernels.base.jit import call
from antway.kernels.base.records import CONTACT_RADIUS
from antway.kernels.base.rng import make_state
from antway.kernels.crossing import ARRIVAL, BOUND, KEPT, KNOT_COUNT, NEW, NEXT_SEARCH, SEGMENT_COUNT, cycle
from antway.kernels.sidestep import sidestep
from antway.kernels.spacetime.memory import EXPANSIONS, Memory
from antway.kernels.spacetime.pheromone import window
from antway.kernels.tracking.prediction_error import distrust
from antway.limits import MAX_AHEAD
from antway.planning import TimedPath
from antway.policies.antway import state as states
from antway.policies.antway.beside import Beside
from antway.policies.antway.control_options import ControlOptions
from antway.policies.antway.controls import ControlColony
from antway.policies.antway.detours import Detours
from antway.policies.antway.explain import explain_cycle
from antway.policies.antway.nodes import is_turned, on_cells, with_fine_cells
from antway.policies.antway.rehearsal import rehearse
from antway.policies.antway.response import Response, tops
from antway.policies.antway.settings import make_settings
from antway.policies.antway.state import Counted, State
from antway.policies.antway.tracker import Tracker
from antway.policies.antway.yielding import Yielding
from antway.policies.guard import MODES, Guard, check_observation
from antway.world.ants import AntStep, LaidTrails
from antway.world.policy import XY, Command, Decision, Observation, Task
from antway.world.rollouts import acting
from antway.world.terrain import terrain_of

_STANDS = 1e-3  # m/s and rad/s; a slower command is to stand
_EXPANSIONS_SHOWN = 5  # number of moves that the ants test in one displayed cycle


class AntwayPolicy:
    """Drive to a goal among moving obstacles by ants in space and time.

    Each cycle predicts the tracks and tests the plan in use against them. The colony then looks for a better plan until the
    best one is certified optimal or the expansions are used up. The plan in use is kept unless it is in conflict or another
    one is better by `hysteresis`. The guard then checks the command. docs/crossing.md explains each step.

    Parameters
    ----------
    horizon : float
        How far ahead obstacles are predicted, s, > 0, at most 1000.
    margin : float or None
        Least distance to predicted obstacles, m, >= 0. None means 0.005 m. In mode "least-harm", a robot that follows the plan
        itself adds 0.2 s times the standard deviation of a track's velocity.
    chance : float
        Probability in (0, 1) with which an uncertain track may leave its tube at any one time.
    hysteresis : float
        s, >= 0; the plan in use is replaced only by one that arrives sooner by this much.
    minimum_improvement : float
        s, > 0; the colony does not search for smaller gains.
    expansions : int
        Most moves that the colony tests in a cycle without a valid plan, >= 1.
    improvement_expansions : int
        Most moves that the colony tests in a cycle with a valid plan, >= 0.
    moves : Moves
        How the ants move from cell to cell: in eight, sixteen or thirty-two directions.
    deposit : float
        Q of the deposit Q / L on a path that is better than all earlier ones, s; 0 switches the pheromone off.
    distance_weight : float
        s/m, >= 0; cost of a metre in addition to its time. It must be 0 for a robot that is driven by `controls`.
    guard : bool
        Whether commands pass the guard.
    controls : ControlOptions or None
        Numbers of the colony in the space of controls; None means the defaults. That colony drives all robots except a disc
        that can take any velocity at once.
    mode : str
        Mode of the guard, "strict" or "least-harm". With "least-harm", a plan with additional clearance is preferred to one
        that arrives a little sooner. If no path keeps the margins, a path without margins is taken.
    learns_response : bool
        Whether latency and accelerations are learnt where the robot answers slower than declared; not with `distance_weight`.

    Raises
    ------
    BadParameter
        For numbers out of range.
    """

    def __init__(
        self,
        *,
        horizon: float = 9.0,
        margin: float | None = None,
        chance: float = 0.05,
        hysteresis: float = 0.05,
        minimum_improvement: float = 0.02,
        expansions: int = 8000,
        improvement_expansions: int = 400,
        moves: Moves = Moves.THIRTY_TWO,
        deposit: float = 20.0,
        distance_weight: float = 0.0,
        guard: bool = True,
        controls: ControlOptions | None = None,
        mode: str = "least-harm",
        learns_response: bool = True,
    ) -> None:
        self.horizon = checks.number("horizon", horizon, low=0.0, high=MAX_AHEAD, open_low=True, unit="s")
        self.margin = None if margin is None else checks.number("margin", margin, low=0.0, unit="m")
        chance = checks.number("chance", chance, low=1e-9, high=1.0 - 1e-9)
        self.quantile = max(NormalDist().inv_cdf(1.0 - chance), 0.0)  # of the error towards the robot
        self.hysteresis = checks.number("hysteresis", hysteresis, low=0.0, unit="s")
        self.minimum_improvement = checks.number("minimum_improvement", minimum_improvement, low=0.0, open_low=True, unit="s")
        self.expansions = checks.integer("expansions", expansions, low=1)
        self.improvement_expansions = checks.integer("improvement_expansions", improvement_expansions, low=0)
        if checks.instance("moves", moves, Moves) not in (Moves.EIGHT, Moves.SIXTEEN, Moves.THIRTY_TWO):
            raise BadParameter("moves", moves.value, "eight, sixteen or thirty-two")
        self.moves = moves
        self.deposit = checks.number("deposit", deposit, low=0.0, unit="s")
        self.distance_weight = checks.number("distance_weight", distance_weight, low=0.0, high=1e3, unit="s/m")
        self.controls = ControlOptions() if controls is None else checks.instance("controls", controls, ControlOptions)
        self.mode = checks.choice("mode", mode, MODES)
        self.learns_response = checks.instance("learns_response", learns_response, bool) and distance_weight == 0.0
        self.guard = Guard(mode=mode) if checks.instance("guard", guard, bool) else None

        self.state: State | None = None
        self._in_common = False
        self._departs = False  # whether the next `reset` is a departure amid a drive
        self._heading = math.nan  # rad; heading of a robot that cannot turn; NaN for one that can, and before the first cycle
        self._place: XY | None = None  # m; of the last observation; None before the first cycle
        self._cut_off_at = (0.0, 0.0)  # m; from where a path to the goal was looked for last: at first, the start
        self._beside: Beside[State | Counted] | None = None
        self._outdated = False  # whether the state is to be computed anew, once what is computed beside is done

    @property
    def task(self) -> Task:
        """The task of the episode."""
        return self._state.yielding.asked(self._state.task)

    @property
    def _state(self) -> State:
        assert self.state is not None, "reset comes first"
        return self.state

    def reset(self, task: Task, seed: int) -> None:
        """Begin an episode; it raises `OutOfBounds` or `CellBlocked` if the robot does not fit at the start or at the goal."""
        checks.instance("task", task, Task)
        checks.seed(seed)
        old, self._departs = self.state if self._departs else None, False
        rehearse(AntwayPolicy, task.robot, mode=self.mode, guard=self.guard is not None, controls=self.controls)
        self._beside, self._outdated, self._cut_off_at = None, False, task.start
        if old is not None:
            task = replace(task, robot=old.response.robot)
            self.state = states.taken_over(self._made(task, seed, old.response, self._heading), old)
        else:
            self._heading, self._place = math.nan, None
            self.state = self._made(task, seed, Response(task.robot), self._heading)
        if self.guard is not None:
            (self.guard.reset if old is None else self.guard.set_robot)(task)

    def depart(self, task: Task, seed: int) -> None:
        """Do as `reset` for another task of the same robot, which may drive: what was learnt, seen and certified is kept."""
        self._departs = True
        self.reset(task, seed)  # which a subclass may have extended

    def set_surroundings(self, grid: Grid) -> None:
        """Predict and guard on `grid`, of which the task's map is a part: obstacles do not bounce off a path's corridor."""
        s = self._state
        s.surroundings, s.terrain = grid, terrain_of(grid)
        if self.guard is not None:
            self.guard.set_robot(s.task, grid)

    def take_over(self, other: AntwayPolicy, t: float) -> None:
        """Go on at `t` s where `other` drives the same robot, with all that it knows and its guard, for the task of `reset`."""
        self.state, self.guard, self._place = states.taken_over(self._state, other._state), other.guard, other._place
        self._suit_response(t)

    def _made(self, task: Task, seed: int, response: Response, heading: float, place: XY | None = None) -> State:
        """Return the state of an episode at its start, or of one that goes on with the robot at `place`, m."""
        robot, controls, horizon, tracker = task.robot, None, 0.0, Tracker(self.mode == "strict")
        fine = task if robot.stepwise else with_fine_cells(task)
        (context, kept), narrow = states.contexts_from(place, fine, self.moves, heading)
        context, radius = (narrow[0], narrow[0].radius) if narrow else (context, robot.radius)
        settings = make_settings(self, task, radius)
        paces = states.full_and_careful(context, settings.tubes.stopping_time, robot, self.guard is not None)
        if not robot.stepwise:
            if self.distance_weight > 0.0:
                raise BadParameter("distance_weight", self.distance_weight, "0 for a robot with inertia, wheels or latency")
            paces = (context, 0.0), (context, 0.0)
            # Without a strict guard, a stop is not better than the best ant.
            strict = self.guard is not None and self.mode == "strict"
            controls, horizon = ControlColony(self.controls, fine, kept.field, seed, strict), self.horizon
        cells = context.rows * context.cols
        return State(
            task=task,
            surroundings=task.grid,
            terrain=terrain_of(task.grid),
            settings=settings,
            paces=paces,
            context=context,
            memory=None if self._in_common else states.make_memory(cells),
            trails=states.make_trails(cells),
            plan=states.make_plan(),
            tracker=tracker,
            crowd=states.make_crowd(task, tracker.tracks),
            seed=seed,
            rng=make_state(seed, 0),
            response=response,
            yielding=Yielding(),
            controls=controls,
            detours=Detours(self.moves, (context,) if controls is None else (context, kept), narrow, horizon),
        )

    def _compute_anew(self, t: float, task: Task, at_once: int | None = None) -> None:
        """Go on with another task, or another robot, heading or place."""
        self._outdated = False
        work = partial(self._made, task, self._state.seed, self._state.response, self._heading, self._place)
        self._compute(t, work, at_once)

    def _compute(self, t: float, work: Callable[[], State | Counted], at_once: int | None = None) -> None:
        """Compute another state, or other times to the goal, beside the control cycles where the map is large."""
        s = self._state
        poses = 0 if s.controls is None else s.controls.problem.field.turning.size  # a car has times for each heading
        self._beside = Beside(max(s.detours.wide[-1].field.size, poses), t, work, at_once)
        self._adopt(t)

    def _adopt(self, t: float) -> None:
        """Use what was computed, once it is due."""
        if self._beside is None or t < self._beside.due:
            return
        found, self._beside = self._beside.result(), None
        outdated, self._outdated = self._outdated, False
        if not isinstance(found, State):
            states.set_times(self._state, *found)
            if outdated:
                self._compute_anew(t, self._state.task)
            return
        self.state = states.carried_on(found, self._state)
        if found.controls is not None:
            found.controls.set_spread(found.response.spread)
        if found.task.robot != found.response.robot:  # more has been learnt meanwhile
            self._suit_response(t)

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period.

        Raises
        ------
        BadParameter
            For an observation that is not finite.
        """
        observation = check_observation(observation)
        self._place = observation.xy
        as_sensed = self._learn_response(observation)
        self._adopt(observation.t)
        self._suit_place(observation)
        s = self._state
        doubted = s.tracker.doubts_velocities
        observation = s.tracker.corrected(as_sensed)
        if s.tracker.doubts_velocities != doubted:  # predictions were from other velocities
            s.crowd = states.make_crowd(s.task, s.tracker.tracks)
        states.update_tracks(s, observation)
        if observation.sensed_at >= s.detours.due:
            self._look_for_detours(observation)
            s = self._state
        drive = self._follow_plan if s.controls is None else self._roll_out
        command, what = drive(observation)
        command = Command((0.0, 0.0)) if s.dance.stands(observation, s.task.robot.v_max, s.rng) else command
        if self.guard is not None:
            others = None if s.controls is None else s.controls.others()
            # Where the sensor gives no names, names are guesses, so a strict guard gets the observation without them.
            seen = s.tracker.for_guard(as_sensed if self.mode == "strict" else observation)
            command = self.guard.passed(seen, command, others)
        did = ("" if self.guard is None else self.guard.did), math.hypot(*(command.twist or command.velocity)) < _STANDS
        if what != KEPT or did != s.did or observation.t >= s.until:
            s.decision, s.until = None, math.inf
            if what != KEPT:
                s.path = self._planned()
        if s.decision is None:
            s.cycle, s.did = (observation, s.plan.state.item(ARRIVAL), s.plan.state.item(BOUND)), did
        self.sent(observation, command)
        return command

    def _learn_response(self, o: Observation) -> Observation:
        """Learn how the robot answers commands; return the observation with what it lacks."""
        s = self._state
        if not self.learns_response or s.response.declared.dynamics == "steps":
            return s.response.with_pending(o)
        if s.response.update(o):
            self._suit_response(o.t)
            s = self._state
        if s.controls is not None:
            s.controls.set_spread(s.response.spread)
        return s.response.completed(o)

    def _suit_response(self, t: float) -> None:
        """Plan and drive from now on for the robot as it has turned out to be."""
        s = self._state
        task = replace(s.task, robot=s.response.robot)
        if (s.controls is None) != task.robot.stepwise or tops(task.robot) != tops(s.task.robot):
            self._outdated = True  # other ants drive it, or the times to the goal are others
        if self._outdated and self._beside is None:
            self._compute_anew(t, task)
            s = self._state
        if s.controls is not None:
            s.controls.set_response(task.robot)
        if self.guard is not None:
            self.guard.set_robot(task, s.surroundings)
        s.task, s.decision, s.until = task, None, -math.inf

    def _suit_place(self, o: Observation) -> None:
        """Plan anew for a robot that was turned, or that has no path from where it is now, once for each place."""
        s, moved = self._state, math.dist(o.xy, self._cut_off_at) > self._state.task.robot.radius
        if self._beside is not None:
            return
        if is_turned(s.task.robot, self._heading, o.heading):
            first, self._heading = math.isnan(self._heading), o.heading
            self._compute_anew(o.t, s.task, None if first and not any(o.velocity) else 0)  # one that drives has no time
        elif moved and s.plan.state[KNOT_COUNT] == 0 and states.is_cut_off(s, o):
            self._cut_off_at = o.xy
            self._compute_anew(o.t, s.task)  # margins and nodes are chosen by the path from a place

    def sent(self, observation: Observation, command: Command) -> None:
        """Take note of the command that was sent in place of the one returned for an observation."""
        self._state.response.record(observation, command)

    def _look_for_detours(self, o: Observation) -> None:
        """If obstacles have stayed where they are for long, plan anew with times that count with that, or give way to one."""
        s, t, busy = self._state, float(o.sensed_at), self._beside is not None
        arrival = s.plan.state.item(ARRIVAL)
        counted = s.detours.update(s.tracker.estimates, s.tracker.last_seen, t, o.xy, arrival, busy)
        s.dance.update(s.task, s.detours.to_go, t, o.xy)
        if busy:
            return
        if (task := s.yielding.next_task(s.task, s.detours, t, o.xy)) is not s.task:
            self._compute_anew(o.t, task)
        elif counted is not None:
            self._compute(o.t, partial(states.other_times, s, counted))

    def _follow_plan(self, o: Observation) -> tuple[Command, int]:
        """Plan; return the command that follows the plan, and what was done with the plan."""
        vx, vy, what = self._plan(o)
        return Command(self._aside(o, o.t - o.sensed_at, (vx, vy))), what

    def _roll_out(self, o: Observation) -> tuple[Command, int]:
        """Do as `_follow_plan`, but the ants in the space of controls find the command."""
        s = self._state
        assert s.controls is not None
        acting_at, robot = acting(o, s.task.robot)
        self._plan(acting_at)
        n, m, estimates = int(s.plan.state[KNOT_COUNT]), int(s.plan.state[SEGMENT_COUNT]), s.tracker.estimates
        if n == 0 and states.is_cut_off(s, o):
            return s.controls.stand(), KEPT  # all rollouts are as bad as any other
        turns, doubt = s.tracker.turns, distrust(s.crowd.pool, s.crowd.missed)
        sigma = s.controls.deviations(estimates, s.crowd.velocity_error[: len(estimates)], doubt, turns)
        segments, narrower = s.plan.segments[:m], s.task.robot.radius - s.settings.tubes.robot_radius
        if narrower > 0.0:  # the plan is for a narrow disc; rollouts expect the disc around the body
            segments = segments.copy()
            segments[:, CONTACT_RADIUS] += narrower
        command = s.controls.act(o, acting_at.t, robot, segments, sigma, s.plan.knots[:n], s.plan.state.item(ARRIVAL), turns)
        return command, KEPT if s.controls.same_path() else NEW

    def _plan(self, o: Observation) -> tuple[float, float, int]:
        """Predict and plan in one cycle of kernels/crossing.py; return what `cycle` returns."""
        s = self._state
        states.adapt_settings(s, o.t, self.horizon)
        now = float(o.t), float(o.sensed_at), (float(o.xy[0]), float(o.xy[1]))
        known = s.context, s.terrain, s.settings, s.plan, s.crowd, len(s.tracker.estimates), *now, s.rng
        return call(cycle, s.memory or self.memory(), s.trails, *known)

    def _aside(self, o: Observation, age: float, command: XY) -> XY:
        """Return the velocity on the plan, or one beside the plan where people are near whose velocity may change."""
        s = self._state
        known = len(s.tracker.estimates)
        if s.settings.wide_tubes.robot_radius == 0.0 or known == 0:
            return command
        knots, at = s.plan.knots[: int(s.plan.state[KNOT_COUNT])], (float(o.xy[0]), float(o.xy[1]))
        averaged, dt = s.crowd.tracks.averaged[:known], s.settings.dt
        return call(sidestep, knots, float(o.t), float(age), at, command, averaged, s.context, dt, s.tracker.turns[0])

    def _planned(self) -> TimedPath | None:
        """Return a copy of the plan in use, or the path of the best ant in the space of controls."""
        s = self._state
        if s.controls is not None:
            return s.controls.path()
        n = int(s.plan.state[KNOT_COUNT])
        return TimedPath(s.plan.knots[:n, 0], s.plan.knots[:n, 1:]) if n else None

    def explain(self) -> Decision:
        """Return the reasons for the last command.

        It is the same object for up to 1 s while the plan, the wait and the guard's action stay the same.
        """
        s = self._state
        if s.decision is None:
            s.decision = explain_cycle(s, self.guard.why if self.guard else "", self.pheromone(), self.memory())
        return s.decision

    def planned(self) -> TimedPath | None:
        """Return the motion in use, as shown by the explanation."""
        return self._state.path

    def pheromone(self) -> tuple[int, int, NDArray[np.float32]] | None:
        """Return the pheromone by cell, its maximum over moves and times, in the smallest window that holds all of it."""
        s = self._state
        top, left, pheromone = window(s.trails, s.context.cols)
        return on_cells(s.context, s.task.grid, top, left, pheromone) if pheromone.size else None

    def memory(self) -> Memory:
        """Return the memory that the ants search in."""
        return self._state.memory or states.shared_memory(self._state.context.rows * self._state.context.cols)

    def use_common_memory(self) -> None:
        """Search from now on in the memory that all policies of a thread share; this is safe, as each search starts empty."""
        self._in_common = True
        if self.state is not None:
            self.state.memory = None

    def step_ants(self, cycles: int, act: Callable[[], object]) -> AntStep:
        """Run the control cycle of `act` with at most this many displayed cycles of the ants, and return its result."""
        s, budget = self._state, _EXPANSIONS_SHOWN * cycles
        expansions, improvement, due = s.settings.expansions, s.settings.improvement_expansions, s.plan.state[NEXT_SEARCH]
        least = min(expansions, budget), min(improvement, budget)
        s.settings = s.settings._replace(expansions=least[0], improvement_expansions=least[1])
        try:
            act()
        finally:
            after = self._state  # that of a reset, if there was one
            after.settings = after.settings._replace(expansions=expansions, improvement_expansions=improvement)
        idle, tested = "", int(self.memory().counter[EXPANSIONS])
        if tested == 0:
            idle = "No ants in this control cycle: no other plan can be better."
            if s.plan.state[NEXT_SEARCH] == due:
                idle = f"No ants in this control cycle: all goes as foreseen. They look for a better plan from {due:.2f} s on."
        return AntStep(idle, tested < budget or budget >= expansions, self.explain())

    def trails(self) -> LaidTrails:
        """Return the pheromone on moves between places, its maximum over all times of arrival."""
        return states.laid_trails(self._state.trails, self._state.context)
