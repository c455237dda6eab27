"""The policy `antway`: ants in space and time around what moves, the exact field over the map for the rest."""

from __future__ import annotations

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter
from antway.grid import Moves
from antway.kernels.base.jit import entry
from antway.kernels.base.rng import stream
from antway.kernels.crossing import COUNT, FORESEEN, KEPT, Crowd, Plan, Settings, cycle
from antway.kernels.spacetime.memory import SEGMENTS
from antway.kernels.spacetime.pheromone import window
from antway.kernels.spacetime.prepare import move_mask
from antway.kernels.tracking import crowd
from antway.kernels.tracking import kalman as track
from antway.kernels.tracking.predict import NAME, RADIUS, SIGMA, SIGMA_V
from antway.planning import TimedPath, standing_cell
from antway.policies.antway.alternatives import Situation
from antway.policies.antway.explain import explain, wait_of
from antway.policies.antway.state import make_context, make_memory, make_trails
from antway.policies.guard import Guard, check_observation
from antway.world.policy import Command, Decision, Observation, Task, Tracks

_KNOTS = 2048  # of a plan
_AGILITY = 1.0  # m/s^2; acceleration that the filter expects of obstacles
_BRAKES = 0.5  # s; with tracks in sight no robot cruises at a speed from which it needs longer to stand
_OUTSET, _NEARBY = 0.5, 3.0  # s; at first, when nobody's course is known well, no way round is made for what is farther ahead
_STANDS = 1.0  # s; for how long an explanation stands while the plan does
_NEAR = 0.8  # m; how far from its prediction a track without a name may be found


class AntwayPolicy:
    """Cross a place among moving obstacles by ants in space and time.

    Each cycle predicts the tracks, tests the plan in use against them, and lets the colony look for a better one until the gap
    is certified to be nil or the budget of tests is spent. A plan is kept unless it is in conflict or another is better by
    `hysteresis`. What comes out passes the guard.

    Parameters
    ----------
    horizon : float
        How far ahead obstacles are predicted, s, > 0.
    margin : float
        Least distance to predicted obstacles, m, >= 0.
    chance : float
        Probability in (0, 1) with which an uncertain track may leave its tube at any one time.
    hysteresis : float
        s; a plan is left for another only if that arrives so much sooner, >= 0.
    minimum_improvement : float
        s; differences below are not worth a search, > 0.
    expansions, improvement_expansions : int
        Moves that the colony may test in a cycle that needs a new plan, >= 1, and in one that has a plan, >= 0.
    moves : Moves
        EIGHT, SIXTEEN or THIRTY_TWO.
    deposit : float
        Q of the deposit Q / L on a way that is better than all before, s; 0 switches pheromone off.
    guard : bool
        Whether commands pass the guard.

    Raises
    ------
    BadParameter
        For numbers out of range.
    """

    def __init__(
        self,
        *,
        horizon: float = 9.0,
        margin: float = 0.005,
        chance: float = 0.05,
        hysteresis: float = 0.05,
        minimum_improvement: float = 0.02,
        expansions: int = 8000,
        improvement_expansions: int = 400,
        moves: Moves = Moves.THIRTY_TWO,
        deposit: float = 20.0,
        guard: bool = True,
    ) -> None:
        self.horizon = checks.number("horizon", horizon, low=0.0, open_low=True, unit="s")
        self.margin = checks.number("margin", margin, low=0.0, unit="m")
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
        self.guard = Guard() if checks.instance("guard", guard, bool) else None

    def reset(self, task: Task, seed: int) -> None:
        """Begin an episode.

        Raises
        ------
        OutOfBounds, CellBlocked
            If the robot does not fit at the start or at the goal.
        """
        self.task, robot, grid = task, task.robot, task.grid
        # what Grid.inflate tells, from a stencil of the few cells round a robot
        stands = move_mask(grid.blocked, np.zeros((1, 2), np.int32), robot.radius / grid.resolution)
        inflated = replace(grid, blocked=stands == 0)
        standing_cell("start", task.start, grid, inflated, robot.radius)
        goal = standing_cell("goal", task.goal, grid, inflated, robot.radius)
        context = make_context(grid, robot, goal, self.moves)
        cells = grid.blocked.size
        self.memory, self.trails = make_memory(cells), make_trails(cells)
        self.frame = np.array([grid.origin[0], grid.origin[1], grid.resolution])
        self.plan = Plan(np.empty((_KNOTS, 3)), np.empty((_KNOTS, 3)), np.array([0.0, math.inf, 0.0, 0.0, 0.0, 0.0]))
        self.segments = np.empty((SEGMENTS, 8))
        stopping = robot.dt + (0.0 if math.isinf(robot.a_max) else robot.stop_time)
        self.settings = Settings(
            dt=robot.dt,
            robot_radius=robot.radius,
            horizon=self.horizon,
            margin=self.margin,
            speed_bound=float(task.obstacle_speed) if self.guard else 0.0,
            preferred_speed=float(task.obstacle_speed),
            surge_bound=float(task.obstacle_surge) if self.guard else 0.0,
            stopping_time=stopping if self.guard else 0.0,
            quantile=self.quantile,
            minimum_improvement=self.minimum_improvement,
            hysteresis=self.hysteresis,
            tracking_tolerance=0.02,
            expansions=self.expansions,
            improvement_expansions=self.improvement_expansions,
            amount=self.deposit,
            leg_cells=2,
            low=0.1,
            high=0.9,
            goal_x=task.goal[0],
            goal_y=task.goal[1],
            betas=np.array([100.0, 30.0, 10.0, 100.0]),
            slack=np.array([9.0, 0.0, 0.05, 0.2]),
        )
        # The room that a braking path needs grows with the square of the speed: slower, a robot gets through where it waited.
        slow = min(robot.v_max, _BRAKES * robot.a_max)
        share = robot.v_max / slow
        careful = context._replace(field=context.field * share, step=context.step * [1.0, 1.0, share], speed=slow)
        stopping_time = robot.dt + slow / robot.a_max if self.guard else 0.0
        self.paces = (context, self.settings.stopping_time), (careful, stopping_time)
        self.state = np.array([stream(np.uint64(seed), np.uint64(0))], np.uint64)
        self.table, self.count = np.zeros((256, track.COLUMNS)), 0
        self.estimates, self.variance = np.zeros((256, 8)), np.zeros((64, 2))
        self.crowd = Crowd(np.zeros((256, crowd.COLUMNS)), np.zeros(1, np.int64), np.empty((256, crowd.STEPS, 2)))
        if self.guard:
            self.guard.reset(task)
        self.started = math.nan
        self.decision: Decision | None = None
        self.path: TimedPath | None = None
        self.did, self.until = "", math.inf

    def act(self, observation: Observation) -> Command:
        """Return the command for the next control period.

        Raises
        ------
        BadParameter
            For an observation that is not finite.
        """
        check_observation(observation)
        o, t = observation, observation.tracks
        stamp = o.t if math.isnan(o.stamp) else o.stamp
        n = len(t)
        if n > len(self.variance):
            self.variance = np.zeros((2 * n, 2))
        variance = self.variance[:n]
        if t.covariance is not None:
            estimated = np.where(t.covariance[:, 0, 2] != 0.0, -1.0, 1.0)  # a filter correlates place and velocity
            variance[:, 0], variance[:, 1] = t.covariance[:, 0, 0] * estimated, t.covariance[:, 2, 2] * estimated
        else:
            variance[:] = 0.0
        self.count, known = track.update(
            self.table,
            self.count,
            stamp,
            t.id,
            t.xy,
            t.velocity,
            t.radius,
            variance,
            _AGILITY,
            _NEAR,
            self.estimates,
        )
        self.context, stopping_time = self.paces[known > 0]
        if math.isnan(self.started):
            self.started = o.t
        horizon = min(self.horizon, _NEARBY) if o.t < self.started + _OUTSET - 1e-6 else self.horizon
        if stopping_time != self.settings.stopping_time or horizon != self.settings.horizon:
            self.settings = self.settings._replace(stopping_time=stopping_time, horizon=horizon)
        arguments = (
            self.memory,
            self.trails,
            self.context,
            self.settings,
            self.plan,
            self.crowd,
            self.estimates[:known],
            float(o.t),
            float(o.t - stamp),
            float(o.xy[0]),
            float(o.xy[1]),
            self.frame,
            self.segments,
            self.state,
        )
        vx, vy, what, arrival, bound = entry(cycle, *arguments)(*arguments)
        command = Command((vx, vy))
        if self.guard:
            command = self.guard.passed(o if t.covariance is None else self._estimated(o, known), command)
        did = self.guard.did if self.guard else ""
        if what != KEPT or did != self.did or o.t >= self.until:
            self.decision, self.until = None, math.inf
            if what != KEPT:
                n = int(self.plan.state[COUNT])
                self.path = TimedPath(self.plan.knots[:n, 0].copy(), self.plan.knots[:n, 1:].copy()) if n else None
        if self.decision is None:
            self.now, self.known, self.age, self.did, self.arrival, self.bound = o, known, o.t - stamp, did, arrival, bound
        return command

    def _estimated(self, o: Observation, known: int) -> Observation:
        """Return what is seen, as the filter sees it."""
        b = self.estimates[:known]
        covariance = np.zeros((known, 4, 4))
        covariance[:, 0, 0] = covariance[:, 1, 1] = b[:, SIGMA] ** 2
        covariance[:, 2, 2] = covariance[:, 3, 3] = b[:, SIGMA_V] ** 2
        return replace(o, tracks=Tracks(b[:, NAME].astype(np.int64), b[:, :2], b[:, 2:4], b[:, RADIUS], covariance))

    def explain(self) -> Decision:
        """Return why the last command was what it was.

        The same object while the plan, what it waits for and the guard's part stay, for 1 s at most.
        """
        if self.decision is None:
            now = self.now.t
            wait = 0.0 if self.path is None else wait_of(self.path, now)
            self.until = now + (min(wait, _STANDS) if wait > 0.0 else _STANDS)
            known = Situation(
                self.context,
                self.settings,
                self.frame,
                float(now),
                float(self.age),
                (float(self.now.xy[0]), float(self.now.xy[1])),
                self.estimates[: self.known].copy(),
                self.crowd.prediction[: self.known].copy(),
                self.segments[: int(self.plan.state[FORESEEN])].copy(),
            )
            cost, bound = self.arrival - now, self.bound - now
            self.decision = explain(known, self.path, cost, bound, self.did, self.pheromone(), self.memory)
        return self.decision

    def planned(self) -> TimedPath | None:
        """Return the motion in use, as the explanation has it."""
        return self.path

    def pheromone(self) -> tuple[int, int, NDArray[np.float32]] | None:
        """Return the pheromone by cell, the largest over moves and times, in the window that holds any."""
        top, left, pheromone = window(self.trails, self.task.grid.shape[1])
        return (top, left, pheromone) if pheromone.size else None
