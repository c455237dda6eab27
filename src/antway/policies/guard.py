"""The guard: a command passes only if the robot can still stop before any obstacle can reach it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from antway import checks
from antway.errors import BadParameter, TooLarge
from antway.grid import Grid
from antway.kernels.base.jit import call, entry
from antway.kernels.base.records import PEOPLE_ACCEL, RobotState, Walls
from antway.kernels.robot import guard as kernel
from antway.kernels.robot.brake import BENT, Robot
from antway.kernels.robot.passing import fallback, passed_among
from antway.kernels.robot.reach import ACCEL, AGE, COLUMNS, RADIUS, SPEED, split_at_walls
from antway.limits import MAX_ANGLE, MAX_CLOCK, MAX_PLACE, MAX_SPEED, MAX_TRACKS
from antway.world.policy import (
    XY,
    Command,
    Decision,
    Foresees,
    Observation,
    Policy,
    RobotSpec,
    Task,
    Tracks,
    as_policy,
    commanded,
)
from antway.world.terrain import body_of, terrain_of, walls_of
from antway.world.timeline import Timeline

_EARLY = 1e-6  # s; a stamp that is ahead by less is now
_NEWER = 0.05  # s; a scan that is newer than the robot's place by more is not used
_MARGIN = 0.01  # m; distance that robots with inertia keep from walls
_TRACKS = 128  # number of tracks for which there is memory at first
DID = ("free", "slowed", "braked", "stepped-aside", "least-harm")
MODES = ("strict", "least-harm")
_STOP = Command((0.0, 0.0))
_AT_REST = RobotState(0.0, 0.0, 0.0, 0.0, 0.0)
_FAULTS = ("observation.xy, velocity, heading", "tracks.xy", "tracks.velocity", "tracks.radius")
_ALLOWED = (
    f"finite; places up to {MAX_PLACE:g} m, speeds up to {MAX_SPEED:g} m/s",
    f"finite, up to {MAX_PLACE:g} (m)",
    f"finite, up to {MAX_SPEED:g} m/s, or NaN where unknown",
    f"in [0, {MAX_PLACE:g}] (m)",
)


def check_observation(o: Observation) -> Observation:
    """Return `o` for policies and guards: without numbers that several tracks share, and not earlier than its scan.

    Where obstacles were seen up to 0.05 s after the robot's place was measured, the robot is moved on by its speeds until then.

    Raises
    ------
    BadParameter
        If the robot's state or a track is not finite or beyond the limits of `antway.limits`, or if a track's arrays differ in
        length.
    TooLarge
        For more tracks than the limit.
    """
    check_shapes(checks.instance("observation", o, Observation))
    t, n = o.tracks, len(o.tracks)
    if n > MAX_TRACKS:
        raise TooLarge("tracks", n, f"at most {MAX_TRACKS}")
    what = kernel.fault(*o.xy, *o.velocity, o.heading, t.id, t.xy, t.velocity, t.radius)
    if what not in (kernel.SOUND, kernel.SAME_ID):
        value = ((o.xy, o.velocity, o.heading), t.xy, t.velocity, t.radius)[what - 1]
        raise BadParameter(_FAULTS[what - 1], value, _ALLOWED[what - 1])
    stamped = abs(o.stamp) <= MAX_CLOCK or math.isnan(o.stamp) or o.stamp == -math.inf
    if not (abs(o.t) <= MAX_CLOCK and stamped and abs(o.turn_rate) <= MAX_ANGLE):
        allowed = f"within {MAX_CLOCK:g} s and {MAX_ANGLE:g} rad/s; a stamp may be NaN (now) or -inf (nothing sensed yet)"
        raise BadParameter("observation.t, stamp, turn_rate", (o.t, o.stamp, o.turn_rate), allowed)
    if o.pending is not None and not np.isfinite(o.pending).all():
        raise BadParameter("observation.pending", o.pending, "float64[M, 2], finite")
    if t.covariance is not None:
        spread = t.covariance.diagonal(axis1=1, axis2=2)
        if not ((spread >= 0.0) & (spread <= MAX_PLACE**2)).all() or not np.isfinite(t.covariance).all():
            raise BadParameter("tracks.covariance", t.covariance, f"float64[{n}, 4, 4] of finite numbers, variances >= 0")
    if _EARLY < o.stamp - o.t <= _NEWER:
        o = at_scan(o)
    return replace(o, tracks=t.distinct()) if what == kernel.SAME_ID else o


def at_scan(o: Observation) -> Observation:
    """Return `o` at the time of its scan, until which the robot is moved on by its speeds."""
    ahead = o.stamp - o.t
    place = o.xy[0] + o.velocity[0] * ahead, o.xy[1] + o.velocity[1] * ahead
    return replace(o, t=o.stamp, xy=place, heading=o.heading + o.turn_rate * ahead)


def check_shapes(o: Observation) -> None:
    """Raise `BadParameter` if the arrays of tracks differ in length, or covariances or pending commands in shape."""
    t, n = o.tracks, len(o.tracks)
    if t.id.shape != (n,) or t.xy.shape != (n, 2) or t.velocity.shape != (n, 2) or t.radius.shape != (n,):
        raise BadParameter("tracks", (t.xy.shape, t.velocity.shape, t.radius.shape), f"of {n} tracks each, as id is")
    if t.covariance is not None and t.covariance.shape != (n, 4, 4):
        raise BadParameter("tracks.covariance", t.covariance, f"float64[{n}, 4, 4]")
    if o.pending is not None and (o.pending.ndim != 2 or o.pending.shape[1] != 2):
        raise BadParameter("observation.pending", o.pending, "float64[M, 2]")


def assumed_accel(task: Task, mode: str) -> float:
    """Return the bound on changes of velocity, m/s^2, for plans: that of people in mode "least-harm", else none.

    For robots with inertia there is none, because the space-time search only guides the colony in the space of controls.
    """
    return PEOPLE_ACCEL if mode != "strict" and task.robot.stepwise else math.inf


def assumed_swerve(task: Task, mode: str) -> float:
    """Return the bound on changes of velocity, m/s^2, for certified manoeuvres: the declared one, or people's if smaller."""
    return float(task.obstacle_swerve) if mode == "strict" else min(float(task.obstacle_swerve), PEOPLE_ACCEL)


def relative_swerve(task: Task) -> float:
    """Return the declared bound on changes of velocity as a share of that of people, at most 1."""
    return min(float(task.obstacle_swerve) / PEOPLE_ACCEL, 1.0)


def longest_stop(robot: RobotSpec, velocity: tuple[float, float] = (0.0, 0.0)) -> float:
    """Return how long a certified stop takes at most, s: without wheels, a robot may brake along one axis after the other.

    A robot that drives with `velocity`, m/s, may be beyond its top speed, because it was pushed or rolls downhill.
    """
    return max(math.hypot(*velocity), robot.v_max) / robot.braking * (1.0 if robot.wheels else BENT)


class Guard:
    """Passes a command if its braking path is free of every place that an obstacle can reach before the robot stands.

    Otherwise it passes the fastest command in the same direction whose braking path is free, or brakes. A robot at rest in the
    path of an obstacle steps aside if a side is free. If the sensor is silent or the policy gives no command, the robot stops.

    Parameters
    ----------
    timeout : float
        Age of the last scan at which the sensor counts as silent, s, > 0.
    hold : float
        How long a track that is no longer seen still counts, s, >= 0; the places that it can reach grow meanwhile.
    lookahead : float
        A robot at rest steps aside if an obstacle would touch it within this time, s, >= 0.
    mode : str
        "strict": only certain commands pass. "least-harm": obstacles are assumed to change their velocities no faster than
        people do; if no command is certain, the one passes whose predicted contact is least likely, latest and slowest. Walls
        are certain in both modes: no command passes after which a robot with inertia could touch one.

    Notes
    -----
    The mode "strict" guarantees passive safety: there is no contact while the robot moves. It assumes that obstacles are seen
    early enough and stay within the declared bounds on their speed, its growth and the change of their velocity
    (`Task.obstacle_speed`, `obstacle_surge`, `obstacle_swerve`). The bound on the change of velocity does not apply where a
    wall may reflect an obstacle, or if the last scan does not show it exactly and with a velocity, and it
    is infinite unless declared. Obstacles may still run into a robot that has stopped. Observations raise a track's bounds on
    its speed and on the growth of that at once, and the speed bound of all tracks slowly. "least-harm" guarantees nothing, but
    has fewer contacts in total among people (docs/people.md).
    """

    def __init__(self, *, timeout: float = 0.5, hold: float = 0.5, lookahead: float = 1.5, mode: str = "strict") -> None:
        self.timeout = checks.number("timeout", timeout, low=0.0, open_low=True, unit="s")
        self.hold = checks.number("hold", hold, low=0.0, unit="s")
        self.lookahead = checks.number("lookahead", lookahead, low=0.0, unit="s")
        self.mode = checks.choice("mode", mode, MODES)

    def reset(self, task: Task) -> None:
        """Prepare for `task`."""
        checks.instance("task", task, Task)
        self.bounds = np.array([task.obstacle_speed, task.obstacle_surge, math.inf, 0.0, 0.0])
        self.table, self.count = np.zeros((_TRACKS, kernel.TABLE_COLUMNS)), 0
        self.tracks, self.spread = np.empty((_TRACKS, COLUMNS)), np.zeros(_TRACKS)
        self.seen = np.zeros(0, np.bool_)  # which tracks the last scan shows with a velocity
        self.last_stamp = -math.inf
        self.did = self.why = ""
        self.dynamic: _Dynamic | None = None
        self.set_robot(task)

    def set_robot(self, task: Task, grid: Grid | None = None) -> None:
        """Guard the robot of `task` from now on, which is that of `reset` with other latency, accelerations or top speeds.

        `grid` has the walls, if not all those of the task's map are walls; it may be the part of a map that is near the robot.
        """
        robot, self.task = task.robot, task
        strict, self.grid = self.mode == "strict", task.grid if grid is None else grid
        self.dynamic = None if robot.stepwise else _Dynamic(task, self.grid, self.mode, self.dynamic)
        self.walls = walls_of(self.grid) if strict and robot.stepwise else None
        self.bounds[kernel.BOUND_CHANGE] = assumed_accel(task, self.mode)
        self.rules = kernel.Rules(robot.limits, terrain_of(self.grid), robot.dt, self.lookahead, strict)
        # The kernel is loaded now, because to load it in the first cycle would delay that.
        entry(kernel.guarded, _AT_REST, 0.0, 0.0, self.tracks[:0], self.rules)

    def limit(self, observation: Observation, command: Command | None) -> Command:
        """Return the command that passes; `did` then says what the guard did.

        If it brakes because a clock went back or the scan is not of now, `why` says so in words; otherwise it is empty.

        For None that is the next command of the stop that the guard keeps certified, by which a robot stops at any time.

        Raises
        ------
        BadParameter
            For an observation that is not finite, and for what is neither a command nor None.
        """
        return self.passed(check_observation(observation), command)

    def passed(self, observation: Observation, command: Command | None, others: NDArray[np.float64] | None = None) -> Command:
        """Do as `limit` for an observation that has been checked already.

        A robot with inertia may get `others`, float64[N, 2], in place of a command that does not pass: the first that passes.
        """
        o, robot = observation, self.task.robot
        stamp = o.sensed_at
        if command is not None:
            checks.instance("command", command, Command)
        self.why = ""
        if stamp < self.last_stamp:
            self.why = f"the guard brakes until {self.last_stamp:.1f} s, because the clock went back"
        elif not -_EARLY <= o.t - stamp <= self.timeout:
            self.why = "the guard brakes, because there is no scan of now"
        else:  # what is in sight is remembered, even if there is no command
            self.last_stamp, tracks = stamp, self._within_reach(o, stamp)
        acts: XY | tuple[()] = ()
        if command is not None:
            plain = robot.wheels and self.dynamic is None
            acts = command.plain('the dynamics "steps"') if plain else command.acts(o, robot)
        if self.why or command is None or not all(map(math.isfinite, acts)):
            self.did = DID[kernel.BRAKED]
            return _STOP if self.dynamic is None else self.dynamic.stop(o)
        if self.dynamic is not None:
            asked = np.array([acts], np.float64)
            if others is not None:
                asked = np.vstack((asked, others))
            passed, did = self.dynamic.passed(o, asked, tracks, self.seen, self.lookahead)
            self.did = DID[did]
            return passed
        state = RobotState(*o.xy, o.heading, *o.velocity)
        vx, vy = map(float, command.velocity)
        vx, vy, did = call(kernel.guarded, state, vx, vy, tracks, self.rules)
        self.did = DID[did]
        return Command((vx, vy))

    def _within_reach(self, o: Observation, stamp: float) -> NDArray[np.float64]:
        """Return the rows of all tracks that count (kernels/robot/reach.py)."""
        t, robot = o.tracks, self.task.robot
        # The robot can brake from whatever it drives after this command, and from more if it is pushed or rolls downhill.
        speed = math.hypot(*o.velocity)
        stopping = robot.dt + min(speed / robot.braking + robot.dt, max(speed, robot.v_max) / robot.braking)
        if self.dynamic is not None:
            stopping = self.dynamic.stopping(o)
        most = self.count + len(t)
        if most > len(self.table):
            self.table = np.resize(self.table, (2 * most, kernel.TABLE_COLUMNS))
            self.tracks, self.spread = np.empty((2 * most, COLUMNS)), np.zeros(2 * most)
        self.spread[: len(t)] = 0.0 if t.covariance is None else 2.0 * np.sqrt(t.variances(0))
        velocity = t.velocity
        if self.mode == "strict" and t.covariance is not None:
            velocity = np.column_stack((velocity, 2.0 * np.sqrt(t.variances(2))))
        self.bounds[kernel.STOPPING_TIME], scan = stopping, (t.id, t.xy, velocity, t.radius)
        n = self.count = kernel.within_reach(
            self.table, self.count, o.t, stamp, self.hold, *scan, self.spread, self.bounds, self.tracks
        )
        if self.dynamic is None and self.walls is None:
            return self.tracks[:n]
        # Whose velocity is not known may go anywhere, as may an obstacle that the last scan does not show.
        self.seen = (self.tracks[:n, AGE] <= o.t - stamp) & (self.table[:n, kernel.TRACK_SPEED] >= 0.0)
        swerve = self.task.obstacle_swerve
        if self.walls is None or t.covariance is not None or swerve == math.inf:
            return self.tracks[:n]
        rows = np.empty((2 * n, COLUMNS))
        rows[:n] = self.tracks[:n]
        return rows[: _bounded(rows, n, self.seen, swerve, self.walls, o.t - stamp + stopping)]


def _bounded(rows: NDArray[np.float64], n: int, seen: NDArray[np.bool_], swerve: float, walls: Walls, time: float) -> int:
    """Bound the changes of velocity of those of `n` rows that are `seen` with a velocity; return the new number of rows.

    An obstacle that could meet a wall within `time` s from the scan on gets a second row for the time after that. Any other
    obstacle may go anywhere with its speed.
    """
    rows[:n, ACCEL] = np.where(seen, swerve, math.inf)
    return split_at_walls(rows, n, walls, time)


class _Dynamic:
    """The guard's part for robots with inertia, wheels, latency or a footprint."""

    def __init__(self, task: Task, grid: Grid, mode: str, before: _Dynamic | None) -> None:
        robot = self.robot = task.robot
        self.strict, self.swerve = mode == "strict", assumed_swerve(task, mode)
        self.late = robot.late_commands
        self.rows, near, self.keep = np.empty((_TRACKS, COLUMNS)), np.empty((_TRACKS, COLUMNS)), np.array([0.0, 0.0, 0.0, -1.0])
        self.record = Robot(robot.limits, body_of(robot), walls_of(grid), robot.dt, _MARGIN, self.strict, near, self.keep)
        # The kernel is loaded now, because to load it in the first cycle would delay that.
        entry(passed_among, _AT_REST, self.rows[:0, :2].copy(), self.rows[:0], self.record, 0.0)
        self.sent = np.zeros((self.late, 2))
        if before is not None:  # the stop that is certified, and the commands that do not act yet
            self.keep[:] = before.keep
            self.sent = np.vstack((self.sent, before.sent))[len(before.sent) :]
        aside = math.pi / 2 / robot.turn_rate + robot.turn_rate / robot.alpha_max if robot.wheels else 0.0
        # Time to turn and to get out of the path of a disc as large as the robot.
        self.aside = robot.latency + aside + 2.0 * math.sqrt(2.0 * robot.radius / robot.a_max)

    def passed(
        self,
        o: Observation,
        asked: NDArray[np.float64],
        tracks: NDArray[np.float64],
        seen: NDArray[np.bool_],
        lookahead: float,
    ) -> tuple[Command, int]:
        """Return the first of the given commands that passes, or another one, and what was done.

        `seen` tells of each track whether the last scan shows it with a velocity, whose changes are bounded.
        """
        if 2 * len(tracks) > len(self.rows):
            self.rows = np.empty((4 * len(tracks), COLUMNS))
            self.record = self.record._replace(rows=np.empty((4 * len(tracks), COLUMNS)))
        rows, n = self.rows, len(tracks)
        bounded = o.tracks.covariance is None and self.swerve < math.inf
        # What may go anywhere becomes a track that is seen now: a disc of all places that it can have reached.
        age = np.where(seen & bounded, 0.0, tracks[:, AGE])
        rows[:n] = tracks
        rows[:n, RADIUS] += tracks[:, SPEED] * age
        rows[:n, ACCEL], rows[:n, AGE] = math.inf, tracks[:, AGE] - age
        if bounded:
            n = _bounded(rows, n, seen, self.swerve, self.record.walls, o.t - o.sensed_at + self.stopping(o))
        state = self.state_at_action(o)
        one, two, did = call(passed_among, state, asked, rows[:n], self.record, lookahead + self.aside)
        return self._command(o, one, two), did

    def stopping(self, o: Observation) -> float:
        """Return the longest time until the end of any certified manoeuvre, s; longer for a robot beyond its limits."""
        robot = self.robot
        turning = 0.0 if robot.footprint is None else 2.0 * max(robot.turn_rate, abs(o.turn_rate)) / robot.alpha_max
        return robot.latency + 2.0 * robot.dt + max(longest_stop(robot, o.velocity), turning) + turning

    def state_at_action(self, o: Observation) -> RobotState:
        """Return the robot's state when a command given now begins to act."""
        if self.late and o.pending is None:
            o = replace(o, pending=self.sent)
        if o.pending is not None and len(o.pending) < self.late:
            raise BadParameter("observation.pending", o.pending, f"{self.late} commands, as many as do not act yet, or None")
        return o.state_at_action(self.robot)

    def stop(self, o: Observation) -> Command:
        """Return the next command of the certified stop."""
        one, two, _ = fallback(self.keep)
        return self._command(o, one, two)

    def _command(self, o: Observation, one: float, two: float) -> Command:
        if self.late:
            self.sent = np.vstack((self.sent[1:], [(one, two)]))
        return commanded(one, two, o.heading, self.robot)


@runtime_checkable
class LearnsResponse(Protocol):
    """A policy that learns from the commands that are sent to the robot, and has to know them all."""

    def sent(self, observation: Observation, command: Command) -> None:
        """Take note of the command that was sent in place of the one returned for an observation."""


def copied(t: Tracks) -> Tracks:
    """Return tracks with arrays of their own, so that a policy that changes them does not change what the guard sees."""
    return Tracks(
        t.id.copy(), t.xy.copy(), t.velocity.copy(), t.radius.copy(), None if t.covariance is None else t.covariance.copy()
    )


class Guarded:
    """A policy with a guard between the policy and the robot.

    Parameters
    ----------
    policy : Policy
    guard : Guard or None
        None: a guard with default settings.
    """

    def __init__(self, policy: Policy, guard: Guard | None = None) -> None:
        self.policy = as_policy(policy)
        self.guard = Guard() if guard is None else checks.instance("guard", guard, Guard)
        self.inner: Decision | None = None
        self.last_decision: Decision | None = None
        self.learner = policy if isinstance(policy, LearnsResponse) else None

    def foresee(self, timeline: Timeline) -> None:
        """Hand on where all obstacles will be, if the policy is to know that."""
        if isinstance(self.policy, Foresees):
            self.policy.foresee(timeline)

    def reset(self, task: Task, seed: int) -> None:
        """Start an episode."""
        self.guard.reset(task)
        self.policy.reset(task, seed)

    def depart(self, task: Task, seed: int) -> None:
        """Let the policy depart, or reset it, for another task of the same robot. The guard keeps its stop and its tracks."""
        self.guard.set_robot(task)
        getattr(self.policy, "depart", self.policy.reset)(task, seed)

    def act(self, observation: Observation) -> Command:
        """Return the policy's command as the guard passes it.

        Raises
        ------
        BadParameter
            For an observation that is not finite, before the policy sees it.
        """
        observation = check_observation(observation)
        pending = None if observation.pending is None else observation.pending.copy()
        shown = replace(observation, tracks=copied(observation.tracks), pending=pending)
        command = self.guard.passed(observation, self.policy.act(shown))
        if self.learner is not None:
            self.learner.sent(observation, command)
        return command

    def explain(self) -> Decision:
        """Return the policy's reason and what the guard did; the same object while both are unchanged."""
        decision = self.policy.explain()
        if self.last_decision is None or decision is not self.inner or self.guard.did != self.last_decision.guard:
            self.inner, self.last_decision = decision, replace(decision, guard=self.guard.did)
        return self.last_decision
