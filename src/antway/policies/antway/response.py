"""How the robot really answers its commands, which is learnt where it does less than declared."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from antway.kernels.base.jit import call
from antway.kernels.robot.odometry import COLUMNS, HEADING, A, B, T, X, Y
from antway.kernels.robot.response import GROWS, PLACE, SLOWS, TURNS, Period, learn
from antway.policies.antway.odometry import OdometryCheck
from antway.world.policy import Command, Observation
from antway.world.robots import RobotSpec

_STEP = 0.05  # s; distance of the candidates for the latency
_LATER = 0.4  # s; the latency may be longer than declared by this much
_FACTORS = (0.85, 0.7, 0.6, 0.5, 0.42, 0.35, 0.3, 0.25, 0.2)  # candidates for accelerations, as shares of those declared
_FINITE = (8.0, 5.0, 3.0, 2.0, 1.5, 1.0, 0.7, 0.5, 0.3)  # m/s^2, rad/s^2; candidates for those that were declared infinite
_MEMORY = 0.99  # 1; share of the earlier errors that a control cycle keeps
_CLEAR = 0.5  # 1; another candidate is taken if its squared error is at most this share of that of the one in use
_LEAST = 3e-4  # 1; and lower by this, which is the square of 2 % of the top speed
_TIE = 3e-5  # 1; candidates whose errors differ by less count as equally good; that nearest to the declared one is taken
_GAP = 1.5  # control periods; after a longer gap between observations, earlier commands are forgotten
_SAME = 0.02  # 1; a speed that changes by less, as a share of the declared top speed, stays
_DRIFT = 0.3  # s; speeds that are predicted wrongly make the robot's place wrong for this time
_LEAST_SPREAD = 0.002  # m; a smaller uncertainty of the robot's place does not count
_SHOWN = 0.01  # m; from this uncertainty on, explanations tell it
_AT_ONCE = 8.0  # m/s^2; stands for an infinite acceleration where the robot's place is not known exactly
_MORE = 0.05  # 1; a robot that stays at a speed though it was asked for this much more, as such a share, cannot go faster
_CARRIED = 1.0  # m; a robot that is by so much more away from its last place than it can drive was carried or found anew
_STILL = 0.1  # 1; a robot that measures no speed and moves by less than this share of what was commanded stands
_KINDS = np.arange(3)  # of errors: GROWS, SLOWS and TURNS


class Response:
    """Compares the speeds of a robot with those that its spec predicts from the commands that it was given.

    Candidates are latencies of up to 0.4 s more than declared, and limits of acceleration, of braking and of the change of the
    turn rate down to a fifth of those declared. What is in use is kept until another candidate has at most half of its squared
    error. A speed or turn rate at which the robot stays, while faster ones are commanded, becomes its top speed or turn rate.

    The uncertainty of the robot's place, `spread`, is the standard deviation of its errors in x and in y, m, as far as they
    change between observations, and how far it is from where wrong speeds lead it; 0 while it is less than 2 mm.
    """

    def __init__(self, declared: RobotSpec) -> None:
        self.robot = self.declared = declared  # as it is taken to be now, and as it was declared
        self.limited = declared  # with the top speeds that were learnt
        others = _STEP * np.arange(round((declared.latency + _LATER) / _STEP) + 1.0)
        others = others[np.abs(others - declared.latency) > 0.5 * _STEP]
        nearest = np.argsort(np.abs(others - declared.latency), kind="stable")
        self.limits = declared.limits  # of `limited`
        self.latencies = np.append(declared.latency, others[nearest])
        rates = np.array([declared.a_max, declared.braking, declared.alpha_max])
        slower = [np.where(np.isinf(rates), end, factor * rates) for factor, end in zip(_FACTORS, _FINITE, strict=True)]
        self.ramps = np.array([rates, *slower])
        self.error = np.zeros((3, len(self.latencies), len(self.ramps)))
        self.used = np.zeros(4, np.int64)  # indices of the latency in use, and of a_max, brake_max and alpha_max in `ramps`
        most = math.ceil((self.latencies.max() + declared.dt) / declared.dt) + 1
        self.sent, self.known = np.zeros((most, 3)), 0  # the last commands, each after when it was given, and how many
        self.seen = np.full((most, COLUMNS), math.nan)  # the last observations
        self.spread, self.place = 0.0, np.zeros(PLACE)
        self.odometry, self.held = OdometryCheck(declared), False  # `held`: does not move although it is told to

    def update(self, o: Observation) -> bool:
        """Learn from the robot's place and speeds; tell whether `robot` has changed."""
        speeds = (o.speed, o.turn_rate) if self.declared.wheels else o.velocity
        before = self.seen[-1].tolist()
        self.seen[:-1] = self.seen[1:]
        self.seen[-1] = o.t, *o.xy, o.heading, *speeds
        if not (before[T] < o.t <= before[T] + _GAP * self.declared.dt):
            self.odometry.pause()
            self.known = 0
            self._take_pending(o)
            return False
        self._take_pending(o)
        if math.dist(o.xy, before[X : Y + 1]) > _CARRIED + self.declared.v_max * self.declared.dt:
            self.odometry.pause()
            self.place[:], self.spread = 0.0, 0.0  # the new place is as certain as the first one
            return False
        self.held = not any(speeds) and self._held()
        if self.held:  # it does not answer at all, so what was learnt meanwhile is wrong
            self.error[:], self.place[:], self.spread = 0.0, 0.0, 0.0
            return self._trust_declared()
        period = Period(self.seen[-2], self.seen[-1], self.sent[len(self.sent) - self.known :])
        self.odometry.correct(period, self.robot.limits)
        tables = self.limits, self.latencies, self.ramps, _MEMORY, self.used, self.error, self.place, self.odometry.table
        first, misplaced, speed, turn = call(learn, period, *tables)
        wrong = self.odometry.check(self.seen[-2], self.seen[-1])
        if wrong:  # what was learnt came from wrong speeds
            first = speed = turn = 0.0
            self.error[:] = 0.0
            self._trust_declared()
        if self.odometry.turn_rate is not None:
            self.odometry.turn(period, self.robot.limits)
            self.error[TURNS] = turn = 0.0
        changed = (first > _LEAST and (self._limit() or self._choose())) or wrong
        if changed:  # places were predicted by another candidate
            self.place[:], misplaced = 0.0, 0.0
        turn *= self.robot.turn_rate
        self.spread = misplaced + _DRIFT * self.robot.v_max * (speed + _DRIFT * turn)
        if self.spread <= _LEAST_SPREAD:
            self.spread = 0.0
        if self.spread > 0.0 and self.robot.stepwise:
            self.robot, changed = replace(self.robot, a_max=_AT_ONCE), True
        return changed

    def _take_pending(self, o: Observation) -> None:
        """Take the commands that do not act yet, if they are told, in place of those that were recorded."""
        n = 0 if o.pending is None else min(len(o.pending), len(self.sent))
        if o.pending is not None and n:
            self.sent[-n:, 1:] = o.pending[-n:]
            self.sent[-n:, 0] = o.t - self.declared.dt * np.arange(n, 0.0, -1.0)
            self.known = max(self.known, n)

    def _held(self) -> bool:
        """Tell whether the robot does not move although it was asked to drive for as long as the slowest answer takes."""
        robot, (before, now) = self.declared, self.seen[-2:]
        if self.known < len(self.sent) or self.seen[:, [A, B]].any():
            return False
        top = robot.v_max, robot.turn_rate if robot.wheels else robot.v_max
        asked = np.hypot(*(self.sent[:, 1:] / top).T)
        if robot.turning_radius > 0.0:  # a car that is only asked to turn stays where it is
            asked = np.abs(self.sent[:, 1]) / top[0]
        turned = math.remainder(now[HEADING] - before[HEADING], math.tau) if robot.wheels else 0.0
        moved = math.hypot(math.dist(before[X : Y + 1], now[X : Y + 1]) / top[0], turned / top[1])
        return bool(asked.min() > _MORE and moved < _STILL * asked[-1] * (now[T] - before[T]))

    def _trust_declared(self) -> bool:
        """Take the robot to be as declared; tell whether that changes anything."""
        changed = self.robot is not self.declared
        self.used[:], self.robot = 0, self.declared
        self.limited, self.limits = self.declared, self.declared.limits
        return changed

    def _limit(self) -> bool:
        """Take speeds at which the robot stays as its top speeds, those declared if it is faster; tell whether they change."""
        if self.known < len(self.sent):
            return False
        robot, (speed, turn), (_, asked, asked_turn) = self.declared, self.seen[:, [A, B]].T, self.sent.T
        side = math.copysign(1.0, turn[-1])
        driven = {"v_max": (speed, asked), "v_reverse": (-speed, -asked), "turn_rate": (side * turn, side * asked_turn)}
        if not robot.wheels:
            driven = {"v_max": (np.hypot(speed, turn), np.hypot(asked, asked_turn))}
        found = {}
        for name, (fast, wanted) in driven.items():
            declared, used, most = getattr(robot, name), getattr(self.limited, name), float(fast.max())
            if np.ptp(fast) < _SAME * declared < fast.min() and min(wanted.min(), declared) > most + _MORE * declared:
                found[name] = most
            elif used < declared and fast[-1] > used + _MORE * declared:
                found[name] = declared
        if not found:
            return False
        v_max = found.get("v_max", self.limited.v_max)
        v_reverse = min(found.get("v_reverse", self.limited.v_reverse), v_max)
        turn_rate = found.get("turn_rate", self.limited.turn_rate)
        self.limited = replace(robot, v_max=v_max, v_reverse=v_reverse, turn_rate=turn_rate)
        self.limits = self.limited.limits
        self.error[:], self.used[:], self.robot = 0.0, 0, self.limited
        return True

    def _choose(self) -> bool:
        """Take the best candidate if it is clearly better than the one in use; tell whether it was."""
        total, present = self.error.min(axis=2).sum(axis=0), self.error[_KINDS, self.used[0], self.used[1:]].sum()
        best = int(np.argmax(total <= total.min() + _TIE))
        if total[best] > min(_CLEAR * present, present - _LEAST):
            return False
        as_good = self.error[:, best] <= self.error[:, best].min(axis=1, keepdims=True) + _TIE
        self.used[:] = best, *np.argmax(as_good, axis=1)
        if as_good[SLOWS, self.used[1 + GROWS]]:  # it brakes as weakly as it accelerates, until it is seen to brake better
            self.used[1 + SLOWS] = self.used[1 + GROWS]
        self.robot = self.limited
        if self.used.any():
            a_max, brake_max, alpha_max = self.ramps[self.used[1:], _KINDS].tolist()
            late = float(self.latencies[best])
            self.robot = replace(self.limited, latency=late, a_max=a_max, brake_max=brake_max, alpha_max=alpha_max)
        return True

    def record(self, o: Observation, command: Command) -> None:
        """Record the command that is sent in answer to an observation; a second one replaces the first."""
        if self.known == 0 or self.sent[-1, 0] != o.t:
            self.sent[:-1] = self.sent[1:]
            self.known = min(self.known + 1, len(self.sent))
        self.sent[-1] = o.t, *command.acts(o, self.declared)

    def completed(self, o: Observation) -> Observation:
        """Return the observation with the commands that do not act yet on the robot as it is taken to be.

        Speeds that are wrong are replaced by those that fit its places, and a turn rate that is not measured by that predicted.
        """
        return self.with_pending(self.odometry.completed(o, self.seen[-1]))

    def with_pending(self, o: Observation) -> Observation:
        """Return the observation with the commands that do not act yet: those recorded, unless it tells them as declared.

        A robot that was given no command for longer than _GAP periods is taken to be told to stop.
        """
        if self.robot is self.declared and (o.pending is not None or self.robot.latency == 0.0):
            return o
        late, dt = self.robot.late_commands, self.robot.dt
        given, commands = self.sent[len(self.sent) - late :, 0], self.sent[len(self.sent) - late :, 1:]
        if late and np.diff(given, append=o.t).max() > _GAP * dt:  # each acts in its turn, and none where a gap is
            starts = o.t - dt * np.arange(late, 0.0, -1.0)
            last = np.searchsorted(given, starts + 0.5 * dt) - 1
            known = (last >= 0) & (starts - given[last] <= _GAP * dt)
            commands = np.where(known[:, None], commands[last], 0.0)
        return replace(o, pending=commands.copy())

    def __str__(self) -> str:
        """Say how the robot differs from what was declared, if its place is uncertain by 1 cm, and what else is wrong."""
        units = {"latency": "s", "v_max": "m/s", "v_reverse": "m/s", "turn_rate": "rad/s"}
        units |= {"a_max": "m/s^2", "braking": "m/s^2", "alpha_max": "rad/s^2"}
        found = [(name, unit, getattr(self.robot, name), getattr(self.declared, name)) for name, unit in units.items()]
        differ = [f"{name} {now:.2g} in place of {was:.2g} {unit}" for name, unit, now, was in found if now != was]
        parts = [f"the robot answers with {', '.join(differ)}"] if differ else []
        parts += [f"its place is uncertain by {self.spread:.2g} m"] if self.spread >= _SHOWN else []
        parts += ["it does not move although it is told to"] if self.held else []
        parts += [] if self.odometry.measured else ["its measured speeds do not fit its places and are not used"]
        return "; ".join(parts)


def tops(robot: RobotSpec) -> tuple[float, float, float]:
    """Return the top speed, that in reverse (m/s) and the top turn rate (rad/s)."""
    return robot.v_max, robot.v_reverse, robot.turn_rate
