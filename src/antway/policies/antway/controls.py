"""The colony in the space of controls at work: it drives robots with inertia or wheels, on top of the plan."""

from __future__ import annotations

import math

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.jit import call
from antway.kernels.base.records import RobotState
from antway.kernels.base.rng import make_state
from antway.kernels.controls.colony import Archive, ControlColonySettings, forage, shift
from antway.kernels.controls.lattice import DOWNHILL, ControlLattice
from antway.kernels.controls.lookup import depth_in_wall
from antway.kernels.controls.others import Averaging, average, restart
from antway.kernels.controls.outlook import Margins, SpeedBounds, look_ahead, spread_plan
from antway.kernels.controls.path import same_path
from antway.kernels.controls.problem import GOAL_SPEED, TOLERANCE, CostWeights, StaticField
from antway.kernels.controls.seeds import SEEDS
from antway.kernels.tracking.predict import SIGMA, VX, VY
from antway.planning import TimedPath
from antway.policies.antway.control_options import ControlOptions
from antway.policies.guard import assumed_swerve, relative_swerve
from antway.world.policy import Command, Observation, Task, commanded
from antway.world.robots import RobotSpec
from antway.world.rollouts import control_problem, finite_limits, make_batch, static_time

_AGILE = 0.8  # m/s; the numbers of `ControlOptions` are for robots with this top speed or more
_SLOWEST = 4.0  # 1; robots slower than `_AGILE` by more than this drive as if it were this, or they flee from all that moves
_LEAST_PATH = 1.5  # m; sequences last until a robot at full speed has driven this far, up to twice `horizon`
_WALL_COST = 100.0  # s; cost of a step at which the robot is nearer to a wall than `wall_margin`
_BEARINGS = 12  # number of directions in which arcs lead a robot without wheels
_EXPANSIONS = 100  # most nodes that the search over arcs expands in a cycle
_DODGE = 2.0  # 1; factor on the robot's acceleration away from obstacles that turn, because few of them turn straight at it
_SPREADS = 2.0  # 1; beyond the margin to walls, room is kept for this many standard deviations of the robot's place
# 1; a robot stands unless moving is better by this share of what falling behind the plan costs in a period. It would stand for
# good if it could reach full speed in a period, and then put off a turn again and again.
_STAND = 0.3
_SLACK = 0.05  # s; far from obstacles a robot may arrive earlier than plans by this and by the time for the goal's tolerance
_DEEPER = 1e-3  # m; a robot whose place is in a wall gets no deeper in it than this
_AT_REST = 0.2  # m/s; an obstacle that is slower is at rest, and turns are expected of those that move
_REGAINED = 2.0  # 1; for each second that the robot gets nearer to its goal, so many of the seconds without it are forgotten.
_BACK = 3.0  # s; a robot that is farther from its goal by this than it was goes round something, or was carried or pushed back
_WEAK = 1.5  # s; a robot has weak brakes if it takes longer than this to stop from its top speed
_CREEP = 0.2  # 1; with those, a robot before a strict guard keeps room for stops from this share of its top speed at least
_PUTS_OFF = 2.0  # s; a car that does not get nearer to its goal for so long may put off to move
_STALL = 10.0  # s; after this time without getting nearer to the goal, the weight of risks halves in each such time


class ControlColony:
    """Turns predictions and a plan into the command of the next period.

    `strict` tells whether a guard in mode "strict" judges the commands: it does not pass stops that an obstacle could enter.
    """

    def __init__(self, options: ControlOptions, task: Task, time_to_goal: Floats, seed: int, strict: bool) -> None:
        robot, o = task.robot, options
        self.options, self.robot, self.task, self.strict = o, robot, task, strict
        horizon = max(o.horizon, min(max(_LEAST_PATH / robot.v_max, _quarter_turn(robot)), 2.0 * o.horizon))
        steps = max(math.ceil(horizon / robot.dt - 1e-9), 4)
        block = max(round(o.block / robot.dt), 1)
        self.slowness = min(max(_AGILE / robot.v_max, 1.0), _SLOWEST)
        weights, batch = _weights(o, robot, self.slowness, task, strict), make_batch(robot.v_max * steps * robot.dt)
        self.problem = control_problem(task, time_to_goal.reshape(task.grid.shape), steps, weights, batch)
        if task.stay > 0.0:
            self._stand_at_goal()
        self.margins, self.bounds = self._by_response()
        self.archive = _archive(o, steps, block)
        self.lattice = _lattice(robot, block)
        limits = np.array([robot.v_max, robot.turn_rate if robot.wheels else robot.v_max])
        self.settings = ControlColonySettings(
            rounds=o.rounds,
            ants=o.ants,
            locality=o.locality,
            xi=o.xi,
            least=tuple((0.03 * limits).tolist()),
            exploration=o.exploration,
            wide=tuple((0.35 * limits).tolist()),
        )
        self.unsure = o.unsure * relative_swerve(task)
        self.averaging = None if o.search == "ants" else _averaging(o, steps, block)
        self.random = make_state(seed, 1)
        self._shown, self._best = np.full((2, steps + 1, 3), math.inf)  # t, x and y of paths
        self.began = 0.0  # s; when the last command begins to act
        self.has_arrived = False  # whether the robot has been at the goal
        self.nearest, self.since = math.inf, 0.0  # s; the least time to the goal so far, and when the robot reached it

    def _by_response(self) -> tuple[Margins, SpeedBounds]:
        """Return the distances to keep and the bounds on obstacles' speeds, which depend on how fast the robot can respond."""
        o, robot, slowness, limits = self.options, self.robot, self.slowness, self.problem.limits
        margins = Margins(
            margin=o.margin,
            preferred_gap=o.preferred_gap,
            spread=math.sqrt(slowness) * o.spread,
            spread_time=slowness * o.spread_time,
            late=slowness * o.late,
            response=robot.latency + robot.dt,
            agility=_DODGE * limits.a_max,
        )
        stopping_time = self.problem.weights.stopping_time + robot.v_max / limits.brake_max
        growth = min(float(self.task.obstacle_surge) * stopping_time, 1e3)
        return margins, SpeedBounds(robot.v_max, stopping_time, float(self.task.obstacle_speed), growth)

    def _stand_at_goal(self) -> None:
        """Arrive at the goal from now on no faster than the robot can brake within a period."""
        goal = self.problem.field.goal
        goal[GOAL_SPEED] = min(goal[GOAL_SPEED], self.problem.limits.brake_max * self.robot.dt)

    def set_response(self, robot: RobotSpec) -> None:
        """Drive from now on the same robot with another latency or other accelerations."""
        spread = self.margins.margin - self.options.margin
        self.robot = robot
        weights = _weights(self.options, robot, self.slowness, self.task, self.strict)
        self.problem = self.problem._replace(limits=finite_limits(robot), weights=weights)
        self.margins, self.bounds = self._by_response()
        self.set_spread(spread)
        if self.task.stay > 0.0:
            self._stand_at_goal()

    def set_spread(self, spread: float) -> None:
        """Keep more room from walls and obstacles where the robot's place is wrong by this standard deviation, m."""
        o, weights = self.options, self.problem.weights
        if self.margins.margin == o.margin + spread:
            return
        weights = weights._replace(wall_margin=o.wall_margin + spread, wall_range=_SPREADS * spread)
        self.problem = self.problem._replace(weights=weights)
        self.margins = self.margins._replace(margin=o.margin + spread)

    def set_field(self, field: StaticField) -> None:
        """Drive from now on by another field of times to the goal."""
        before, last = self.problem.field, self.problem.start
        self.problem = self.problem._replace(field=field)
        self.nearest += static_time(field, last) - static_time(before, last)

    def deviations(self, estimates: Floats, velocity_error: Floats, distrust: float, turns: tuple[float, float]) -> Floats:
        """Return the standard deviations of the tracks' places (m) and velocities (m/s), float64[K, 2].

        The estimates are those of kernels/tracking/predict.py, with the errors of predicted velocities and the distrust, 0 to
        1, of kernels/tracking/prediction_error.py; of `ControlOptions.unsure` that share applies. `turns` are those of `act`.
        """
        rate, change = turns
        turned = math.sqrt(0.5 * rate * self.options.turned) * change  # along one axis
        speed = np.hypot(estimates[:, VX], estimates[:, VY])
        unsure = self.unsure * min(self.slowness * distrust, 1.0)
        least = np.maximum(unsure * speed, np.where(speed < _AT_REST, 0.0, turned))
        return np.column_stack((estimates[:, SIGMA], np.maximum(velocity_error, least)))

    def act(
        self,
        observation: Observation,
        start: float,
        state: RobotState,
        segments: Floats,
        sigma: Floats,
        knots: Floats,
        arrival: float,
        turns: tuple[float, float],
    ) -> Command:
        """Return the command that begins to act at `start` s, when the robot is in `state`.

        The heading of the observation turns a twist into a velocity. `segments` are those of the predicted motion, one track
        after another, and `sigma`, float64[K, 2], the standard deviations of each track's place (m) and velocity (m/s).
        `knots`, float64[N, 3], are those (t, x, y) of the plan, which may be empty; it arrives at the time `arrival`, s.
        `turns` says how often obstacles turn, 1/s, and by how much their velocities change then, m/s.
        """
        rate, change = turns
        if math.dist(observation.xy, self.task.goal) <= self.task.goal_tolerance:  # it has arrived, and stays
            self.has_arrived = True
            self._stand_at_goal()
        self.problem, self.began = self.problem._replace(start=state), start
        problem, margins = self.problem, self.margins
        outlook = problem.outlook
        call(look_ahead, segments, sigma, start, problem.dt, problem.start, self.bounds, margins, change, outlook)
        problem = problem._replace(weights=self._weights_now(start, state, rate, len(knots) > 0))
        if self.has_arrived and self._is_met():
            problem = problem._replace(field=_without_end(problem.field))
        if len(knots):
            early = self.options.trust
            if not outlook.near.any():
                early = max(early, self.task.goal_tolerance / self.robot.v_max + _SLACK)
            call(spread_plan, knots, start, problem.dt, arrival, early, outlook.plan)
        else:
            outlook.plan[:, 2] = -math.inf
        shift(self.archive)
        arguments = self.archive, self.lattice, self.settings, problem, self.random
        if self.averaging is None:
            call(forage, *arguments)
        else:
            search = restart if self.options.search == "random" else average
            search(*arguments, self.averaging)
        one, two = self.archive.sequence[self.archive.order[0], 0].tolist()
        return commanded(one, two, observation.heading, self.robot)

    def _weights_now(self, now: float, state: RobotState, turn_rate: float, has_plan: bool) -> CostWeights:
        """Return the weights of costs where obstacles turn so often, 1/s, with or without a plan.

        The weight of risks and the least speed of stops are lower if the robot has not got nearer to the goal for long.
        Otherwise it might wait forever beside an obstacle that stands and whose velocity is not known well, or that leaves
        little room. Standing is worth nothing to a car whose manoeuvres gain little in a period: it would put off to move.
        """
        field, weights = self.problem.field, self.problem.weights
        to_go, there = static_time(field, state), math.dist(self.task.goal, state[:2]) <= self.task.goal_tolerance
        if to_go > self.nearest + _BACK:
            self.nearest = math.inf  # how near it was does not count any more
        if to_go < self.nearest - self.robot.dt or there:
            self.since = now if there else min(now, self.since + _REGAINED * (self.nearest - to_go))
            self.nearest = to_go
        caution = 0.5 ** max((now - self.since) / _STALL - 1.0, 0.0)
        risk, turn_risk, least = weights.risk * caution, turn_rate * weights.turn_risk, weights.least_speed * caution
        weights = weights._replace(risk=risk, turn_risk=turn_risk, least_speed=least, ramps=float(has_plan))
        if self.robot.turning_radius > 0.0 and now - self.since > _PUTS_OFF and not self.problem.outlook.near.any():
            weights = weights._replace(stand=0.0)
        depth = call(depth_in_wall, field, state)
        return weights if depth == 0.0 else weights._replace(wall_margin=-depth - _DEEPER)

    def _is_met(self) -> bool:
        """Tell whether an obstacle is expected to touch the robot if that stands at its place or, away from the goal, there."""
        near, disc = self.problem.outlook.near[:-1], self.problem.outlook.disc[:-1]
        (goal_x, goal_y), (x, y) = self.task.goal, self.problem.start[:2]
        share = min(self.task.goal_tolerance / max(math.hypot(x - goal_x, y - goal_y), 1e-9), 1.0)
        x, y = goal_x + share * (x - goal_x), goal_y + share * (y - goal_y)  # the nearest place within the tolerance
        touches = np.hypot(disc[:, :, 0] - x, disc[:, :, 1] - y) < disc[:, :, 2]
        return bool((touches & (np.arange(disc.shape[1]) < near[:, None])).any())

    def stand(self) -> Command:
        """Return a stop, for which there is no other command."""
        self.archive.used[0] = 0
        return Command((0.0, 0.0))

    def others(self) -> Floats:
        """Return the first commands of all sequences in the archive but the best, in the order of cost, float64[N, 2]."""
        n = int(self.archive.used[0])
        return np.asarray(self.archive.sequence[self.archive.order[1:n], 0])

    def same_path(self) -> bool:
        """Tell whether the best sequence leads along `path`; if not, `path` becomes where it leads."""
        best = self.archive.sequence[self.archive.order[0]]
        return call(same_path, best, self.problem, self.began, self._shown, self._best)

    def path(self) -> TimedPath:
        """Return the path that the best sequence led along when it last led elsewhere than before."""
        return TimedPath(self._shown[:, 0], self._shown[:, 1:])


def _without_end(field: StaticField) -> StaticField:
    """Return the field with a goal at which no rollout ends: one that ends there does not see who comes later."""
    goal = field.goal.copy()
    goal[TOLERANCE], goal[GOAL_SPEED] = 0.0, math.inf
    return field._replace(goal=goal)


def _quarter_turn(robot: RobotSpec) -> float:
    """Return how long wheels need for a quarter of a turn from rest to rest, s; 0 without wheels."""
    if not robot.wheels:
        return 0.0
    change = finite_limits(robot).alpha_max
    fastest = min(robot.turn_rate, math.sqrt(0.5 * math.pi * change))
    return 0.5 * math.pi / fastest + fastest / change


def _weights(o: ControlOptions, robot: RobotSpec, slowness: float, task: Task, strict: bool) -> CostWeights:
    """Return what rollouts cost."""
    return CostWeights(
        progress=o.progress,
        contact=o.contact,
        decay=o.decay / slowness,
        near=o.near,
        risk=o.risk * slowness**2,
        turn_risk=o.turn_risk if slowness == 1.0 else 0.0,
        wall=_WALL_COST,
        wall_margin=o.wall_margin,
        wall_risk=o.wall_risk,
        wall_range=0.0,
        ramps=1.0,
        off_plan=o.off_plan,
        stop=o.stop if strict else 0.0,
        follow=0.0 if strict else o.follow,
        stopping_time=robot.latency + robot.dt,
        least_speed=_CREEP * robot.v_max if strict and robot.v_max > _WEAK * robot.braking else 0.0,
        stand=_STAND * o.off_plan * robot.v_max * robot.dt if robot.a_max * robot.dt < robot.v_max else 0.0,
        turn_change=o.comfort / robot.turn_rate if robot.wheels else 0.0,
        swerve=assumed_swerve(task, "strict" if strict else "least-harm"),
    )


def _archive(o: ControlOptions, steps: int, block: int) -> Archive:
    """Return an empty archive for sequences of `steps` steps, of which `block` at a time share a draw."""
    most = max(o.archive, o.ants + 1, SEEDS + 1)
    return Archive(
        sequence=np.zeros((o.archive, steps, 2)),
        cost=np.full(o.archive, math.inf),
        order=np.zeros(o.archive, np.int64),
        spread=np.zeros((o.archive, math.ceil(steps / block), 2)),
        used=np.zeros(1, np.int64),
        ants=np.zeros((most, steps, 2)),
        ant_cost=np.zeros(most),
        block=block,
    )


def _averaging(o: ControlOptions, steps: int, block: int) -> Averaging:
    """Return what a search that averages works with."""
    return Averaging(
        elite=o.elite if o.search == "cem" else 0,
        temperature=o.temperature,
        mean=np.zeros((steps, 2)),
        spread=np.zeros((math.ceil(steps / block), 2)),
    )


def _lattice(robot: RobotSpec, block: int) -> ControlLattice:
    """Return the commands that are held for `block` periods, and memory for a search over them."""
    if robot.wheels:
        half = math.pi / (block * robot.dt)  # rad/s; half a turn in an arc is enough for robots that could turn faster
        turn = min(robot.turn_rate, robot.v_max / max(robot.turning_radius, 1e-9), half)
        speeds = [robot.v_max, 0.5 * robot.v_max, 0.0] + [-robot.v_reverse] * (robot.v_reverse > 0.0)
        held = np.array([(v, turn * part) for v in speeds for part in (-1.0, -0.35, 0.0, 0.35, 1.0)])
    else:
        bearing = np.arange(_BEARINGS) * (2.0 * math.pi / _BEARINGS)
        full = robot.v_max * np.column_stack((np.cos(bearing), np.sin(bearing)))
        held = np.vstack((full, 0.5 * full, (0.0, 0.0)))
    nodes = 1 + _EXPANSIONS * (len(held) + DOWNHILL)
    return ControlLattice(
        held=held,
        node=np.zeros((nodes, 7)),
        link=np.zeros((nodes, 3), np.int64),
        command=np.zeros((nodes, block, 2)),
        heap=np.zeros((nodes, 2)),
        key=np.zeros((4 * nodes, 2), np.int64),
        least=np.zeros(4 * nodes),
        search=np.zeros(1, np.int64),
        expansions=_EXPANSIONS,
    )
