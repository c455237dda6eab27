"""The pilot: drives to goals by the policy, and stops by its guard with a reason whenever it cannot; no ROS import."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from antway.errors import BadInput
from antway.grid import Grid
from antway.kernels.base.geometry import wrap
from antway.policies.antway.explain import CUT_OFF
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.guard import Guard
from antway.policies.guard_process import SILENT, GuardProcess
from antway.ros2 import frames
from antway.ros2.frames import Odometry, Pose
from antway.ros2.goals import ERROR, OK, STAND, WARN, End, Goal, PilotAnswer
from antway.ros2.markers import predictions, shades
from antway.ros2.outset import Outset, Planned, observed, same_path, sensed_part
from antway.ros2.path import length_after
from antway.ros2.settings import Settings
from antway.world.policy import XY, Command, Decision, Observation, Task, Tracks
from antway.world.robots import towards

ODOMETRY, OBSTACLES = "odometry", "obstacles"
GUARD_ENDED = "the guard's process has ended: deactivate, clean up, configure and activate the node, which starts another one"
LATE = 2.0  # control periods; a robot brakes if odometry has not answered its last command for longer than this
_LOOP = 5.0  # tolerances at the goal; a path that is longer than this, and ends where the robot is, is a loop
_TURNS = 1.5  # tolerances at the goal; a robot that turns there goes on within this, because its place is noisy
SLOW = 1.5  # control periods; a robot stands if odometry comes, at the median, more slowly than this


class Pilot:
    """Receives the robot's data in the map's frame, and answers odometry with a command in each control period.

    Internally the policy uses a frame in which the map's yaw is 0. With a guard process, commands go through it: it sends what
    passes to the robot itself, and brakes if none comes. A robot with inertia always stops by the guard, whose certified stop
    may turn: the last command acts until its period is over, then that stop is driven, and only then a drive may begin.
    """

    def __init__(self, settings: Settings, guard_process: GuardProcess | None = None) -> None:
        self.settings, self.guard_process = settings, guard_process
        self.number = 0  # number of the guard process's observation; 0 while it rests
        self.map: Grid | None = None
        self.frame = frames.HERE  # of the map, in which its yaw is 0
        self.goal: Goal | None = None
        self.scan: tuple[float, Tracks] | None = None
        self.odometry: Odometry | None = None
        self.faults: dict[str, tuple[float, str]] = {}  # when odometry or obstacles were last refused (steady, s), and why
        self.sent = np.zeros((settings.robot.late_commands, 2))  # commands that do not act yet
        self.policy: AntwayPolicy | None = None
        self.bound_for: Goal | None = None  # the goal that the policy drives to: not yet a new one
        self.outset = Outset(settings)
        self.turner: Guard | None = None  # while it turns in place at a goal
        self.guard: Guard | GuardProcess | None = None  # keeps the stop that follows the last command; None: STAND stops it
        self.guard_frame = self.frame  # in which that stop is
        self.command, self.why = STAND, (OK, "")  # the last command, and level and reason of the last stop
        self.last_decision: tuple[Decision, Decision] | None = None  # of the policy, and the same in the map's frame
        self.due = self.started = -math.inf  # s; when odometry is to be answered next, and when the policy started
        self.acts_until = -math.inf  # s; until when a command of the stop acts that was sent without odometry
        self.now = self.answered = -math.inf  # s of a steady clock; when odometry last arrived, and was last answered
        self.gaps: deque[tuple[float, float]] = deque(maxlen=11)  # s; between the latest odometry, by stamps and a steady clock
        self.missed = 0  # number of control periods in which the robot brakes because odometry is late
        self.silence = 0.0  # s; for how long there has been no odometry, as `silent` was last told
        self._restart()

    def _restart(self) -> None:
        """Forget since when the robot waits, and when and where it last made progress."""
        self.waiting_since, self.progress = math.nan, (math.nan, (0.0, 0.0))
        self.silent_before = self.silence  # s; which does not count as waiting for the goal

    # What comes in

    def receive_map(self, grid: Grid) -> PilotAnswer | None:
        """Receive a map; if it is new, the robot plans again.

        A robot that drives keeps off the new walls around it at once, and drives on; not so with a guard process.
        """
        if self.map is not None and grid == self.map:
            return None
        before, self.map, self.bound_for = self.frame, grid, None
        self.grid, self.frame = frames.level(grid)
        policy, o, stands = self.policy, self.odometry, self.turner is not None or self.guard_process is not None
        if policy is not None and o is not None and not stands and self.frame == before:
            near = sensed_part(self.settings, (self.grid, self.frame), o.xy)
            if near is not None:
                policy.set_surroundings(near)
                return PilotAnswer(self.command, WARN, "the map has changed")
        self.policy = self.turner = None
        return None if self.goal is None else self._hold(WARN, "the map has changed")

    def overtaken(self, t: float) -> bool:
        """Tell whether obstacles seen at `t` s come after newer ones; by more than `timeout` is a jump of the clock."""
        return self.scan is not None and 0.0 < self.scan[0] - t <= self.settings.timeout

    def is_late(self, t: float) -> bool:
        """Tell whether odometry of `t` s comes after newer odometry; by more than a control period is a jump of the clock."""
        return self.odometry is not None and 0.0 < self.odometry.t - t <= self.settings.robot.dt

    def go(self, goal: Goal) -> PilotAnswer | None:
        """Receive a goal, which replaces the previous one.

        A robot that drives to the previous one does so until it has planned for this one, and drives on without a stop.
        Waiting time and progress continue if the new goal is at the same place.
        """
        before, self.goal = self.goal, goal
        if before is None or math.dist(before.xy, goal.xy) > self.settings.task["goal_tolerance"]:
            self._restart()
        if self.turner is not None:
            self.policy = self.turner = None
        if self.policy is None and self.guard is None:
            self.due = -math.inf
        if before is None:
            return None
        reason = f"the goal {frames.shown(before.xy)} is pre-empted by {frames.shown(goal.xy)}"
        if self.policy is None:
            return self._hold(OK, reason, End.REPLACED)
        if same_path(before, goal, (self.grid, self.frame), self.settings.corridor):
            # The place stays, too: small steps of it would add up, and the policy would stand where the goal has been.
            self.goal, reason = replace(goal, xy=before.xy, path=before.path), "the path is refreshed"
            self.bound_for = self.goal if self.bound_for is before else self.bound_for
        return PilotAnswer(self.command, OK, reason, End.REPLACED)

    def drop(self, reason: str, end: End = End.DROPPED, level: int = OK) -> PilotAnswer:
        """Stop, and end the goal."""
        done = None if self.goal is None else end
        self.goal = self.policy = self.turner = None
        self.outset.forget()
        return self._hold(level, reason, done)

    def silent(self, seconds: float, held: float) -> PilotAnswer | None:
        """Brake if odometry is late; a stop that has begun continues.

        There was no good odometry for `seconds` s of a steady clock. The last command that answers odometry was sent `held` s
        ago, by a clock that is slow where the robot's is. It is certified for one control period. After two the robot brakes,
        by one command in each, until odometry is back: so late it is lost, and does not just jitter.
        """
        dt, timeout = self.settings.robot.dt, self.settings.timeout
        self.silent_before, self.silence = self.silent_before if seconds >= self.silence else 0.0, seconds
        over = max(held / dt - (1.5 if self._stopping else LATE), (seconds - timeout) / dt)
        if over <= self.missed or (self.goal is None and not self._stopping):
            return None
        self.missed = math.floor(over) + 1
        if self._stopping:
            self.due += dt
            return self.brake()
        if seconds <= timeout and self.command is STAND:
            return None
        if seconds > timeout or not isinstance(self.guard, GuardProcess):  # that brakes by itself
            self.brake()
            self.acts_until = self.due + held
        if seconds <= timeout:
            return self._hold(WARN, self._fault(ODOMETRY) or f"brake: no odometry for {LATE:g} control periods")
        reason = self._fault(ODOMETRY) or f"no odometry for {timeout:g} s"
        waited = seconds - self.silent_before
        if self.goal is not None and self.goal.gives_up and waited > self.settings.wait_timeout:
            return self.drop(reason, End.WAITED, ERROR)
        return self._hold(ERROR, reason)

    def period(self) -> float:
        """Return how far apart the stamps of odometry have been lately, s; 0 if that is not known."""
        return float(np.median([gap for gap, _ in self.gaps])) if len(self.gaps) > 2 else 0.0

    def _fault(self, what: str) -> str:
        """Return why odometry or obstacles were refused within the last `timeout`; empty if they were not."""
        refused, reason = self.faults.get(what, (-math.inf, ""))
        return reason if time.monotonic() <= refused + self.settings.timeout else ""

    def receive_odometry(self, odometry: Odometry, now: float) -> PilotAnswer | None:
        """Receive odometry that arrived at `now` s of a steady clock; answer once in each control period.

        A jump of odometry's clock is answered at once: it went back, or forward by `timeout` more than the steady one, or than
        lately where a simulation is faster. What is older by no more than a control period was overtaken by a newer message,
        and is dropped. A stamp that stands still is answered no more.
        """
        before, dt = self.odometry, self.settings.robot.dt
        if self.is_late(odometry.t):
            return None
        self.odometry, passed, self.now = odometry, now - self.now, now
        gap = 0.0 if before is None else odometry.t - before.t
        stamps, steady = np.sum(self.gaps or [(0.0, 1.0)], axis=0).tolist()
        if not 0.0 <= gap <= self.settings.timeout + passed * max(stamps / max(steady, 1e-9), 1.0):
            self.scan = self.policy = self.turner = None  # earlier observations and plans are invalid now
            self.brake()
            self.due = -math.inf if self.guard is None else odometry.t + dt
            self.missed, self.answered = 0, now
            self._restart()
            return self._hold(WARN, f"odometry's clock jumped by {gap:.3f} s")
        if gap > 0.0:
            self.gaps.append((gap, passed))
        every = gap > 0.0 and self.period() > 0.9 * dt and not self._stopping  # if it jitters by more than a quarter, too
        if odometry.t < self.due - dt / 4 and not every:
            return None
        self.due = (odometry.t if every or odometry.t - self.due >= dt else self.due) + dt
        self.missed, self.answered = 0, now
        if self.goal is None or self._stopping:
            stood, answer = self.guard is None, self.brake(odometry.t)
            return None if stood else answer
        if (period := self.period()) > SLOW * dt:
            reason = f"odometry comes each {period:.2f} s: commands are certified for robot.dt, {dt:g} s, and no longer"
            return self._wait(odometry.t, ERROR, reason)
        return self._decide(self.goal, odometry)

    # Stopping

    @property
    def rests(self) -> bool:
        """Whether the robot stands and has no goal."""
        return self.goal is None and self.guard is None

    @property
    def _stopping(self) -> bool:
        """Whether the robot follows a certified stop, or begins it in the next control period."""
        return self.guard is not None and self.policy is None and self.turner is None

    def _hold(self, level: int, reason: str, end: End | None = None) -> PilotAnswer:
        """Answer with the last command, after which the guard's stop is certified, or STAND if there is no such stop."""
        self.why = level, reason
        if self.guard is not None:
            return PilotAnswer(self.command, level, reason, end)
        if self.guard_process is not None and self.number:
            self.guard_process.rest(self.number)
            self.number = 0
        return PilotAnswer(STAND, level, reason, end)

    def brake(self, t: float = math.inf) -> PilotAnswer:
        """Answer with the stop's next command, or at `t` s with one that acts for half a period more; the last one is STAND."""
        guard, o, acts = self.guard, self.odometry, STAND.velocity
        if t < self.acts_until - self.settings.robot.dt / 2:
            return self._hold(*self.why)
        if guard is not None and o is not None:
            at = frames.move_odometry(frames.inverse(self.guard_frame), o)
            # It senses nothing, at no time: the clock of a policy's guard counts from when the policy started.
            seen = Observation(at.t, at.xy, at.velocity, at.heading, Tracks.none(), -math.inf)
            if isinstance(guard, GuardProcess):
                self.number = guard.observe(seen)
                acts = guard.limit(self.number, None).command.acts(seen, self.settings.robot)
            else:
                acts = guard.limit(seen, None).acts(seen, guard.task.robot)
        self._send(acts)
        self.command = Command(twist=acts) if self.settings.robot.wheels else Command(frames.turn(self.guard_frame[2], acts))
        if not any(acts):
            self.command, self.guard = STAND, None
        return self._hold(*self.why)

    def braking(self) -> Iterator[PilotAnswer]:
        """Drive the guard's stop to its end, which needs no odometry; yield each answer when it is due."""
        since = self.answered
        while self.guard is not None:
            time.sleep(max(since + self.settings.robot.dt - time.monotonic(), 0.0))
            since = time.monotonic()
            yield self.brake()

    # Driving

    def _decide(self, goal: Goal, odometry: Odometry) -> PilotAnswer:
        """Return the command of a control period, or why the robot stands."""
        settings, t, xy, tolerance = self.settings, odometry.t, odometry.xy, self.settings.task["goal_tolerance"]
        anew = self.policy is None or self.bound_for is not goal
        if math.dist(goal.xy, xy) <= tolerance * (1.0 if self.turner is None else _TURNS):
            if anew and goal.path is not None and length_after(goal.path, xy, tolerance) > _LOOP * tolerance:
                reason = "the path is refused: it ends where the robot is, and loops are not driven"
                return self.drop(reason, End.REFUSED, ERROR)
            off = math.nan
            if settings.robot.wheels and settings.robot.turning_radius == 0.0:
                off = wrap(goal.yaw - odometry.heading)
            if not abs(off) > settings.yaw_tolerance:
                self.brake(t)
                return self.drop(f"arrived at {frames.shown(goal.xy)}", End.ARRIVED)
            return self._turn(goal, odometry)
        if self.map is None:
            return self._wait(t, WARN, "waiting for a map")
        if (self.scan is None or abs(t - self.scan[0]) > settings.timeout) and self._fault(OBSTACLES):
            return self._wait(t, ERROR, self._fault(OBSTACLES))
        if self.scan is None:
            return self._wait(t, WARN, "waiting for obstacles")
        stamp = self.scan[0]
        if abs(t - stamp) > settings.timeout:
            age, late = ("older", "the sensor") if stamp < t else ("newer", "odometry")
            reason = f"obstacles are {abs(t - stamp):.2f} s {age} than odometry: {late} is silent, or its clock is late"
            return self._wait(t, ERROR, reason)
        if self.turner is not None:  # the guard of the turn knows how it stops
            self.policy = self.turner = None
            self.brake(t)
            return self._hold(OK, "brakes, because it is no longer at the goal")
        if anew:
            try:
                refused = self._set_out(goal, self.map, odometry)
            except BadInput as wrong:
                self.policy = None
                return self._wait(t, ERROR, self._guard_ended() or f"the robot cannot set out: {wrong}")
            if refused is not None:
                return self.drop(f"the goal is refused: {refused}", End.REFUSED, ERROR)
        if self.policy is None:
            return self._hold(OK, "the robot plans before it sets out")
        # Planning may have taken long, so progress counts from the next odometry on.
        if self.started < t and (math.isnan(self.progress[0]) or math.dist(xy, self.progress[1]) >= settings.progress_radius):
            self.progress = (t, xy)
        elif goal.gives_up and t - self.progress[0] > settings.progress_time:
            self.brake(t)
            return self.drop(f"no progress in {settings.progress_time:g} s", End.STUCK, ERROR)
        found = self._passed(self.policy.act, observed(self.frame, odometry, self.scan, self.sent, self.started), self.started)
        if isinstance(found, PilotAnswer):
            return found
        passed, did = found
        self.command = Command(frames.turn(self.frame[2], passed.velocity), passed.twist)
        decision = self.policy.explain()
        if decision.action == "stuck":
            reason = f"stuck: {CUT_OFF}" + ("" if goal.path is None else f" within {settings.corridor:g} m of the path")
            return self._impatient(t, WARN, reason) or PilotAnswer(self.command, WARN, reason)
        self.waiting_since = math.nan
        if did == "braked" and decision.guard != did:
            return PilotAnswer(self.command, WARN, "brake: the guard's process had no command in time, or let none pass")
        return PilotAnswer(self.command, OK, f"{decision.action}: {decision.reason}")

    def _passed(
        self, decide: Callable[[Observation], Command], seen: Observation, start: float
    ) -> tuple[Command, str] | PilotAnswer:
        """Return the command that `decide` answers to an observation, and what became of it, or why the robot stands.

        The guard process gets the observation before `decide` starts, at its time on odometry's clock (the observation's counts
        from `start` s), and the command afterwards; what passes it, and what it did, is returned. Without a guard process a
        command passes unchanged.
        """
        guard, did = self.guard_process, ""
        keeper = guard or self.turner or (None if self.policy is None else self.policy.guard)
        try:
            if guard is not None:
                self.number = guard.observe(replace(seen, t=seen.t + start, stamp=seen.stamp + start))
            command = decide(seen)
        except BadInput as wrong:
            return self._wait(seen.t + start, ERROR, str(wrong))
        if guard is not None:
            answer = guard.limit(self.number, command)
            command, did = answer.command, answer.did
            if self.policy is not None:
                self.policy.sent(seen, command)
        self.guard, self.guard_frame = None if keeper is None or keeper.task.robot.stepwise else keeper, self.frame
        if did == SILENT:
            self.guard = None
            return self._wait(seen.t + start, ERROR, self._guard_ended() or "the guard's process is silent")
        acts = command.acts(seen, self.settings.robot)
        self._send(acts)
        return replace(command, twist=acts) if self.settings.robot.wheels else command, did

    def _guard_ended(self) -> str:
        """Return what to do about a guard's process that has ended; empty if it runs, or is not used."""
        return GUARD_ENDED if self.guard_process is not None and not self.guard_process.alive else ""

    def _send(self, pair: XY) -> None:
        """Record a command that does not act yet."""
        self.sent, self.acts_until = np.vstack((self.sent, [pair]))[1:], -math.inf

    def _turn(self, goal: Goal, odometry: Odometry) -> PilotAnswer:
        """Turn in place towards the goal's yaw, as far as the guard lets a footprint turn."""
        settings, t = self.settings, odometry.t
        if self.map is None or self.scan is None or abs(t - self.scan[0]) > settings.timeout:
            return self._wait(t, WARN, "waiting for a map and obstacles before it turns")
        if self.guard is not None and self.turner is None:
            self.policy = None
            self.brake(t)
            return self._hold(OK, "brakes before it turns to the goal's yaw")
        seen = observed(self.frame, odometry, self.scan, self.sent)
        _, rate = towards((math.cos(goal.yaw), math.sin(goal.yaw)), odometry.heading, settings.robot)
        if self.turner is None:
            self.progress = (t, odometry.xy)
            there = frames.move_point(frames.inverse(self.frame), goal.xy)
            try:
                task = Task(self.grid, settings.robot, seen.xy, there, **settings.task)
                if self.guard_process is not None:
                    self.guard_process.reset(task)
            except BadInput as wrong:
                return self._wait(t, ERROR, self._guard_ended() or f"the robot cannot turn: {wrong}")
            self.turner = Guard()
            self.turner.reset(task)
        guard, self.waiting_since = self.turner, math.nan
        if goal.gives_up and t - self.progress[0] > settings.progress_time + math.pi / settings.robot.turn_rate:
            self.brake(t)
            return self.drop(f"it cannot turn to the goal's yaw {goal.yaw:.2f} rad", End.STUCK, ERROR)
        found = self._passed(lambda seen: guard.limit(seen, Command(twist=(0.0, rate))), seen, 0.0)
        if isinstance(found, PilotAnswer):
            return found
        self.command = Command((0.0, 0.0), found[0].twist)
        if "braked" in (guard.did, found[1]):
            return PilotAnswer(self.command, WARN, f"brake: the guard lets no turn to the goal's yaw {goal.yaw:.2f} rad pass")
        return PilotAnswer(self.command, OK, f"turns to the goal's yaw {goal.yaw:.2f} rad")

    def _wait(self, t: float, level: int, reason: str) -> PilotAnswer:
        """Stop and keep the goal, until `wait_timeout` has passed."""
        self.brake(t)
        return self._impatient(t, level, reason) or self._hold(level, reason)

    def _impatient(self, t: float, level: int, reason: str) -> PilotAnswer | None:
        """End a goal that gives up, once the robot has waited for `wait_timeout`."""
        if math.isnan(self.waiting_since):
            self.waiting_since = t
        long = self.goal is not None and self.goal.gives_up and t - self.waiting_since > self.settings.wait_timeout
        return self.drop(reason, End.WAITED, level) if long else None

    def _set_out(self, goal: Goal, grid: Grid, odometry: Odometry) -> BadInput | None:
        """Set out for a goal, once a thread has planned where the robot drives or the map is large; return why it is refused.

        A plan for an earlier goal or map is finished first and driven on the way, because they may come faster than it plans.
        On an earlier map the robot keeps off the walls that are around it now.
        """
        level = self.grid, self.frame
        found = self.outset.plan(grid, level, goal, odometry.xy, self.policy is not None)
        if not isinstance(found, Planned):
            return found
        planned, near = found.policy, None if found.grid is grid else sensed_part(self.settings, level, odometry.xy)
        if found.grid is not grid and near is None:
            return None
        if self.policy is None:
            if self.guard_process is not None:
                self.guard_process.reset(replace(planned.task, grid=self.grid))
            self.started, self.progress = odometry.t, (math.nan, odometry.xy)
        else:
            planned.take_over(self.policy, odometry.t - self.started)
        if near is not None:
            planned.set_surroundings(near)
        bound_for = goal if same_path(found.goal, goal, level, self.settings.corridor) else found.goal
        self.policy, self.bound_for = planned, bound_for if near is None else None
        return None

    # What is shown

    def decision(self) -> Decision | None:
        """Return the reason of the last command in the map's frame (the same object while unchanged); None: no policy."""
        if self.policy is None:
            return None
        last = self.policy.explain()
        if self.last_decision is None or last is not self.last_decision[0]:
            self.last_decision = last, last if self.frame == frames.HERE else frames.move_decision(self.frame, last)
        return self.last_decision[1]

    def predictions(self, horizon: float) -> list[NDArray[np.float64]]:
        """Return where each track will be until `horizon` s from now, (t, x, y) in s and m: float64[M, 3] each."""
        tracks = Tracks.none() if self.scan is None else frames.move_tracks(frames.inverse(self.frame), self.scan[1])
        return [np.column_stack((a[:, 0], frames.move(self.frame, a[:, 1:]))) for a in predictions(tracks, self.grid, horizon)]

    def pheromone(self) -> tuple[NDArray[np.int8], Pose] | None:
        """Return the ants' pheromone as costs from 0 to 100 in its bounding window, and the pose of the window's corner."""
        found = None if self.policy is None else self.policy.explain().pheromone
        return None if found is None or self.policy is None else shades(*found, self.policy.task.grid, self.frame)
