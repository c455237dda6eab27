"""How the robot really answers its commands, which is learnt where it is slower than declared."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from antway.kernels.base.jit import entry
from antway.kernels.robot.response import add_errors
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


class Response:
    """Compares the speeds of a robot with those that its spec foretells from the commands that it was given.

    Candidates are latencies of up to 0.4 s more than declared, and limits of acceleration and of the change of the turn rate
    down to a fifth of those declared. What is in use is kept until another candidate has at most half of its squared error.

    Attributes
    ----------
    declared, robot : RobotSpec
        The robot as it was declared, and as it is taken to be now.
    """

    def __init__(self, declared: RobotSpec) -> None:
        self.robot = self.declared = declared
        others = _STEP * np.arange(round((declared.latency + _LATER) / _STEP) + 1.0)
        others = others[np.abs(others - declared.latency) > 0.5 * _STEP]
        nearest = np.argsort(np.abs(others - declared.latency), kind="stable")
        self.latencies = np.append(declared.latency, others[nearest])
        limits = np.array([declared.a_max, declared.braking, declared.alpha_max])
        slower = [np.where(np.isinf(limits), end, factor * limits) for factor, end in zip(_FACTORS, _FINITE, strict=True)]
        self.ramps = np.array([limits, *slower])
        self.error = np.zeros((2, len(self.latencies), len(self.ramps)))
        self.used = 0, 0, 0  # indices of the latency, of the ramp of the speed, and of that of the turn rate
        most = math.ceil((self.latencies.max() + declared.dt) / declared.dt) + 1
        self.given, self.commands, self.known = np.zeros(most), np.zeros((most, 2)), 0  # the last commands, and how many
        self.before = np.full(3, math.nan)  # time and speeds of the last observation

    def update(self, o: Observation) -> bool:
        """Learn from the speeds of an observation; tell whether `robot` has changed."""
        now = np.array([o.t, *((o.speed, o.turn_rate) if self.declared.wheels else o.velocity)])
        before, self.before = self.before, now
        goes_on = 0.0 < now[0] - before[0] <= _GAP * self.declared.dt
        if not goes_on:
            self.known = 0
        self._take_pending(o)
        if not goes_on or self.known == 0:
            return False
        given, commands = self.given[-self.known :], self.commands[-self.known :]
        arguments = before, now, given, commands, self.declared.limits, self.latencies, self.ramps, _MEMORY, self.error
        entry(add_errors, *arguments)(*arguments)
        return self.error[:, 0, 0].sum() > _LEAST and self._choose()

    def _take_pending(self, o: Observation) -> None:
        """Take the commands that do not act yet, if they are told, in place of those that were recorded."""
        n = 0 if o.pending is None else min(len(o.pending), len(self.given))
        if o.pending is not None and n:
            self.commands[-n:] = o.pending[-n:]
            self.given[-n:] = o.t - self.declared.dt * np.arange(n, 0.0, -1.0)
            self.known = max(self.known, n)

    def _choose(self) -> bool:
        """Take the best candidate if it is clearly better than the one in use; tell whether it was."""
        speed, turn = self.error
        latency, ramp, turn_ramp = self.used
        total, present = speed.min(axis=1) + turn.min(axis=1), speed[latency, ramp] + turn[latency, turn_ramp]
        best = int(np.argmax(total <= total.min() + _TIE))
        if total[best] > min(_CLEAR * present, present - _LEAST):
            return False
        ramp, turn_ramp = (int(np.argmax(one[best] <= one[best].min() + _TIE)) for one in (speed, turn))
        self.used = best, ramp, turn_ramp
        a_max, brake_max, _ = self.ramps[ramp].tolist()
        alpha_max, late = float(self.ramps[turn_ramp, 2]), float(self.latencies[best])
        self.robot = replace(self.declared, latency=late, a_max=a_max, brake_max=brake_max, alpha_max=alpha_max)
        return True

    def record(self, o: Observation, command: Command) -> None:
        """Record the command that is sent in answer to an observation; a second one replaces the first."""
        if self.known == 0 or self.given[-1] != o.t:
            self.given[:-1], self.commands[:-1] = self.given[1:].copy(), self.commands[1:].copy()
            self.known = min(self.known + 1, len(self.given))
        self.given[-1], self.commands[-1] = o.t, command.acts(o, self.declared)

    def with_pending(self, o: Observation) -> Observation:
        """Return the observation with the commands that do not act yet on the robot as it is taken to be."""
        late = math.ceil(self.robot.latency / self.robot.dt - 1e-9)
        return replace(o, pending=self.commands[len(self.commands) - late :].copy())

    def __str__(self) -> str:
        """Say how the robot differs from what was declared; empty if it does not."""
        units = {"latency": "s", "a_max": "m/s^2", "alpha_max": "rad/s^2"}
        found = [(name, unit, getattr(self.robot, name), getattr(self.declared, name)) for name, unit in units.items()]
        differ = [f"{name} {now:.2g} in place of {was:.2g} {unit}" for name, unit, now, was in found if now != was]
        return f"the robot answers with {', '.join(differ)}" if differ else ""
