"""The colony in the space of controls at work: what a robot with inertia or wheels drives, on top of its plan."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from antway.kernels.base.jit import entry
from antway.kernels.base.rng import stream
from antway.kernels.controls.colony import Archive, ColonySettings, forage, shift
from antway.kernels.controls.lattice import DOWNHILL, Lattice
from antway.kernels.controls.others import Averaging, average, restart
from antway.kernels.controls.rollout import CostWeights, Margins, Outlook, judge, look_ahead, spread_plan
from antway.kernels.robot.motion import RobotState
from antway.kernels.tracking.predict import SIGMA, VX, VY
from antway.planning import TimedPath
from antway.world.policy import Command, Observation, Task
from antway.world.robots import RobotSpec
from antway.world.rollouts import commanded, finite_limits, static_field, static_time

_DISCS = 64  # at most, near one another at one time; of more tracks some share an entry of what they cost
_AHEAD = 1.5  # m; a slow robot looks so far ahead, to get out of the way of what is faster
_NIMBLE = 0.8  # m/s; a robot slower than this takes so much longer to get out of somebody's way
_ALIKE = 0.3  # m; paths no farther apart are one
_BEARINGS = 12  # directions in which a robot without wheels sets out
_EXPANSIONS = 100  # of the search over arcs, at most, in a cycle
_STALL = 10.0  # s; for each such span, but the first, without coming nearer to the goal a robot fears risks half as much


@dataclass(frozen=True, slots=True)
class ControlOptions:
    """Numbers of the colony in the space of controls; times in s, lengths in m.

    Attributes
    ----------
    horizon, block : float
        Length of a sequence, longer for robots slower than 0.5 m/s, and of the spans in it that share a draw.
    archive, rounds, ants : int
        Sequences kept; rounds a cycle, and ants a round.
    choosiness, breath, curious : float
        Guides are picked by rank with a spread of `choosiness` times the archive; ants leave them by `breath` times the
        archive's mean distance; the share `curious` of them farther.
    progress, off_plan, trust : float
        Weight of the time to go at each step; s for each m off the plan; by how much s the plan's arrival may be bettered.
    unsure : float
        Velocities of obstacles that may swerve are taken to be wrong by at least this share of their speed, however well they
        were foretold.
    margin, wished, near : float
        Room kept to obstacles, room wished for beyond, and s for each m less at each step.
    risk, spread, spread_time, late : float
        s where contact begins, for each obstacle at the step where it is worst; it falls with the square to nothing at so many
        standard deviations of where a track will be (kernels/tracking/foretold.py). Those grow for `spread_time`, and are taken
        as they will be `late` s after, for a robot with inertia cannot answer at once. A robot that is n times as slow as 0.8
        m/s takes n times as long to get out of the way: both times are n times as long, the risk n**2 times as great, and it
        reaches n**0.5 times as far.
    wall_margin : float
        Room kept to walls.
    contact, decay : float
        s for a contact foreseen, once for each obstacle, fading by 1/s, for such slow robots n times as slowly.
    stop : float
        s for each m by which a stop could be cut off that the guard would not allow.
    search : str
        "ants" (ACO_R), or what they are compared with on the same rollouts and as many of them: "mppi", "cem" (each keeps a
        mean) or "random" (restarts around the seeds, without an archive).
    temperature, elite : float, int
        Of "mppi", s, and of "cem", sequences of a round that count.
    """

    horizon: float = 3.0
    block: float = 0.5
    archive: int = 24
    rounds: int = 8
    ants: int = 60
    choosiness: float = 0.15
    breath: float = 0.85
    curious: float = 0.15
    progress: float = 0.02
    off_plan: float = 0.5
    trust: float = 0.3
    unsure: float = 0.12
    margin: float = 0.01
    wished: float = 0.05
    near: float = 0.2
    risk: float = 6.0
    spread: float = 2.0
    spread_time: float = 1.2
    late: float = 0.4
    wall_margin: float = 0.03
    contact: float = 600.0
    decay: float = 0.1
    stop: float = 10.0
    search: str = "ants"
    temperature: float = 0.1
    elite: int = 6


class ControlColony:
    """Turns predictions and a plan into the command of the next period."""

    def __init__(
        self, options: ControlOptions, task: Task, time_to_goal: NDArray[np.float64], seed: int, swerve: float | None
    ) -> None:
        robot, o = task.robot, options
        self.options, self.robot = o, robot
        self.limits = finite_limits(robot)
        self.field = static_field(task.grid, robot, time_to_goal, task.goal, task.goal_tolerance)
        horizon = max(o.horizon, min(_AHEAD / robot.v_max, 2.0 * o.horizon))
        steps = max(math.ceil(horizon / robot.dt - 1e-9), 4)
        block = max(round(o.block / robot.dt), 1)
        discs, harm = np.zeros((steps, _DISCS, 10)), np.zeros(_DISCS)
        self.outlook = Outlook(np.zeros(steps, np.int64), discs, harm, np.full((steps, 3), -math.inf))
        self.outlook.plan[:, :2] = 0.0
        self.archive = Archive(
            np.zeros((o.archive, steps, 2)),
            np.full(o.archive, math.inf),
            np.zeros(o.archive, np.int64),
            np.zeros((o.archive, -(-steps // block), 2)),
            np.zeros(1, np.int64),
            np.zeros((steps, 2)),
            np.empty((0, 2)),
        )
        self.lattice = _lattice(robot, block)
        turn = robot.turn_rate if robot.wheels else robot.v_max
        self.settings = ColonySettings(
            rounds=o.rounds,
            ants=o.ants,
            block=block,
            choosiness=o.choosiness,
            breath=o.breath,
            least_a=0.03 * robot.v_max,
            least_b=0.03 * turn,
            curious=o.curious,
            wide_a=0.35 * robot.v_max,
            wide_b=0.35 * turn,
        )
        slowness = max(_NIMBLE / robot.v_max, 1.0)
        times = slowness * o.spread_time, slowness * o.late
        self.margins = Margins(o.margin, o.wished, math.sqrt(slowness) * o.spread, *times)
        self.unsure = 0.0 if math.isfinite(task.obstacle_swerve) else o.unsure
        self.averaging = None
        if o.search != "ants":
            self.averaging = Averaging(
                o.elite if o.search == "cem" else 0,
                o.temperature,
                np.zeros((o.ants, steps, 2)),
                np.zeros(o.ants),
                np.zeros((steps, 2)),
                np.zeros((-(-steps // block), 2)),
            )
        self.reaction = robot.latency + robot.dt
        self.weights = CostWeights(
            progress=o.progress,
            contact=o.contact,
            depth=o.contact,
            decay=o.decay / slowness,
            near=o.near,
            risk=o.risk * slowness**2,
            wall=100.0,
            wall_margin=o.wall_margin,
            off_plan=o.off_plan,
            stop=0.0 if swerve is None else o.stop,
            stopping_time=self.reaction,
            swerve=math.inf if swerve is None else swerve,
        )
        self.braking = self.reaction + robot.v_max / self.limits.brake_max
        self.growth = min(float(task.obstacle_surge) * self.braking, 1e3)
        self.speed_bound = float(task.obstacle_speed)
        self.random = np.array([stream(np.uint64(seed), np.uint64(1))], np.uint64)
        self.xy = np.zeros((steps, 2))
        self.path: TimedPath | None = None
        self.state = np.zeros(5)
        self.start = 0.0
        self.nearest, self.since = math.inf, 0.0  # the least time to the goal so far, s, and when it was that

    def spread(self, estimates: NDArray[np.float64], wrong: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return how wrong places (m) and velocities (m/s) of the tracks are, float64[K, 2].

        Parameters
        ----------
        estimates : float64[K, 8]
            Of kernels/tracking/predict.py.
        wrong : float64[K]
            Of kernels/tracking/foretold.py.
        """
        speed = np.hypot(estimates[:, VX], estimates[:, VY])
        return np.column_stack((estimates[:, SIGMA], np.maximum(wrong, self.unsure * speed)))

    def act(
        self,
        observation: Observation,
        start: float,
        state: RobotState,
        segments: NDArray[np.float64],
        sigma: NDArray[np.float64],
        knots: NDArray[np.float64],
        arrival: float,
    ) -> Command:
        """Return the command that begins to act at `start` s, when the robot is in `state`.

        Parameters
        ----------
        observation : Observation
            Whose heading turns a twist into a velocity.
        start : float
        state : x, y, heading, and (v, omega) or (vx, vy)
        segments : float64[P, 8]
            Predicted motion, one track after another.
        sigma : float64[K, 2]
            Standard deviations of each track's place (m) and velocity (m/s).
        knots : float64[N, 3]
            The plan (t, x, y); may be empty.
        arrival : float
            Of the plan, s.
        """
        self.state[:], self.start = state, start
        dt, o = self.robot.dt, self.options
        look = (
            segments,
            sigma,
            start,
            dt,
            self.state,
            self.robot.v_max,
            self.braking,
            self.margins,
            self.speed_bound,
            self.growth,
        )
        entry(look_ahead, *look, self.outlook)(*look, self.outlook)
        if len(knots):
            plan = knots, len(knots), start, dt, arrival, o.trust, self.outlook.plan
            entry(spread_plan, *plan)(*plan)
        else:
            self.outlook.plan[:, 2] = -math.inf
        shift(self.archive)
        weights = self._impatient(start, state)
        known = self.state, self.limits, dt, self.field, self.outlook, weights, self.random
        if self.averaging is None:
            arguments = self.archive, self.lattice, self.settings, *known
            entry(forage, *arguments)(*arguments)
        else:
            search = restart if o.search == "random" else average
            search(self.archive, self.lattice, self.settings, self.averaging, *known)
        one, two = self.archive.sequence[self.archive.order[0], 0].tolist()
        return commanded(one, two, observation.heading, self.robot)

    def _impatient(self, now: float, state: RobotState) -> CostWeights:
        """Return what rollouts cost: who comes no nearer to the goal takes more and more risk, or he would never arrive.

        Beside a place where somebody stands whose velocity is not known well, to wait would be better for ever.
        """
        to_go, (x, y, tolerance) = static_time(self.field, state), self.field.goal
        if to_go < self.nearest - self.robot.dt or math.dist((x, y), state[:2]) <= tolerance:
            self.nearest, self.since = to_go, now
        return self.weights._replace(risk=self.weights.risk * 0.5 ** max((now - self.since) / _STALL - 1.0, 0.0))

    def others(self) -> NDArray[np.float64]:
        """Return the first commands of all other sequences kept, best first, float64[N, 2]."""
        n = int(self.archive.used[0])
        others: NDArray[np.float64] = self.archive.sequence[self.archive.order[1:n], 0]
        return others

    def same_path(self) -> bool:
        """Tell whether the best ant goes where `path` does; if not, `path` is what it does from now on."""
        best = self.archive.sequence[self.archive.order[0]]
        known = self.state, self.limits, self.robot.dt, self.field, self.outlook, self.weights, math.inf
        judge(best, *known, self.xy)
        t = self.start + self.robot.dt * np.arange(len(best) + 1.0)
        path = TimedPath(t, np.vstack((self.state[:2], self.xy)))
        if self.path is not None and _alike(self.path, path):
            return True
        self.path = path
        return False


def _lattice(robot: RobotSpec, block: int) -> Lattice:
    """Return the commands that are held for `block` periods, and room for a search over them."""
    if robot.wheels:
        half = math.pi / (block * robot.dt)  # half a turn in an arc is enough for who could turn at once
        turn = min(robot.turn_rate, robot.v_max / max(robot.turning_radius, 1e-9), half)
        speeds = [robot.v_max, 0.5 * robot.v_max, 0.0] + [-robot.v_reverse] * (robot.v_reverse > 0.0)
        held = np.array([(v, turn * part) for v in speeds for part in (-1.0, -0.35, 0.0, 0.35, 1.0)])
    else:
        bearing = np.arange(_BEARINGS) * (2.0 * math.pi / _BEARINGS)
        full = robot.v_max * np.column_stack((np.cos(bearing), np.sin(bearing)))
        held = np.vstack((full, 0.5 * full, (0.0, 0.0)))
    nodes = 1 + _EXPANSIONS * (len(held) + DOWNHILL)
    return Lattice(
        held,
        np.zeros((nodes, 7)),
        np.zeros((nodes, 3), np.int64),
        np.zeros((nodes, block, 2)),
        np.zeros((nodes, 2)),
        np.zeros((4 * nodes, 2), np.int64),
        np.zeros(4 * nodes),
        np.zeros(1, np.int64),
        _EXPANSIONS,
        np.zeros(5),
        np.zeros(0),
    )


def _alike(one: TimedPath, other: TimedPath) -> bool:
    """Tell whether two paths are near each other for as long as both last, and for a second at least."""
    start, end = max(one.t[0], other.t[0]), min(one.t[-1], other.t[-1])
    if end < start + 1.0:
        return False
    t = np.linspace(start, end, 8)
    dx, dy = (np.interp(t, one.t, one.xy[:, i]) - np.interp(t, other.t, other.xy[:, i]) for i in range(2))
    return float(np.hypot(dx, dy).max()) < _ALIKE
