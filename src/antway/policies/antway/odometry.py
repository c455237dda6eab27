"""The speeds of the robot: as measured while they fit its places, else as its commands and places tell them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from antway.kernels.base.arrays import Floats
from antway.kernels.base.records import RobotLimits, RobotState
from antway.kernels.robot import odometry as kernel
from antway.kernels.robot.odometry import HEADING, A, B, T, X, Y
from antway.kernels.robot.response import Period, answered
from antway.world.policy import Observation
from antway.world.robots import RobotSpec

_ENOUGH = 3.0  # number of comparisons before measured speeds can be found wrong
_SLIP = 0.05  # m/s; a smaller error of measured speeds does not matter
_UNSEEN = 0.05  # rad; a robot that turns by more in a cycle at a turn rate of 0 does not measure it


class OdometryCheck:
    """Tells whether the speeds that a robot measures are right, and what they are where they are wrong.

    They are wrong if the velocity from one place to the next lies outside of what is measured at both, and is predicted twice
    as well by the velocity before, or by the commands alone.
    """

    def __init__(self, robot: RobotSpec) -> None:
        self.wheels, self.measured = robot.wheels, True  # `measured`: the speeds that are measured are used
        self.table = np.zeros(kernel.ODOMETRY)  # see kernels/robot/odometry.py
        self.turn_rate: float | None = None  # rad/s; as predicted; None while it is measured
        self.pause()

    def pause(self) -> None:
        """Compare nothing with the last observation: the next one comes too late."""
        self.table[kernel.LAST_X] = math.nan

    def check(self, before: Floats, now: Floats) -> bool:
        """Tell whether speeds turn out to be wrong; those of the observation `now` are then corrected."""
        wrong, (error, between, predicted, compared) = False, self.table[: kernel.COMPARED + 1].tolist()
        if self.measured and compared >= _ENOUGH and error > 2.0 * min(between, predicted) + _SLIP * compared:
            vx, vy = self.table[[kernel.LAST_X, kernel.LAST_Y]].tolist()
            if self.wheels:
                now[A] = vx * math.cos(now[HEADING]) + vy * math.sin(now[HEADING])
            else:
                now[A], now[B] = vx, vy
            self.measured, wrong = False, True
        if self.wheels and self.turn_rate is None and (wrong or self._turns_unseen(before, now)):
            self.turn_rate, wrong = 0.0, True
        return wrong

    def _turns_unseen(self, before: Floats, now: Floats) -> bool:
        """Tell whether the robot turned as it was told to without measuring a turn rate; if otherwise, its place has jumped."""
        if now[B] != 0.0 or before[B] != 0.0:
            return False
        turned = math.remainder(now[HEADING] - before[HEADING], math.tau)
        asked = self.table[kernel.PREDICTED_B] * (now[T] - before[T])
        return bool(abs(turned) > _UNSEEN and abs(turned - asked) < abs(asked))

    def correct(self, period: Period, limits: RobotLimits) -> None:
        """Replace wrong speeds in the observation of now by those that are predicted.

        How much farther the robot came in this cycle than was predicted is added to them, as a speed.
        """
        if self.measured:
            return
        before, now = period.before, period.now
        passed, dx, dy = now[T] - before[T], now[X] - before[X], now[Y] - before[Y]
        predicted = answered(RobotState(0.0, 0.0, 0.0, before[A], before[B]), period, limits)
        if self.wheels:
            middle = kernel.middle_heading(before, now, predicted.theta)
            ahead = dx * math.cos(middle) + dy * math.sin(middle)
            now[A] = predicted.a + (ahead - kernel.chord(predicted)) / passed
        else:
            now[A], now[B] = predicted.a + (dx - predicted.x) / passed, predicted.b + (dy - predicted.y) / passed

    def turn(self, period: Period, limits: RobotLimits) -> None:
        """Predict the turn rate, if it is not measured."""
        if self.turn_rate is not None:
            state = RobotState(0.0, 0.0, 0.0, float(period.now[A]), self.turn_rate)
            self.turn_rate = answered(state, period, limits).b

    def completed(self, o: Observation, now: Floats) -> Observation:
        """Return the observation with the speeds of `now` in place of wrong ones, and the turn rate in place of none."""
        if not self.measured:
            one, two = now[[A, B]].tolist()
            o = replace(o, velocity=(one * math.cos(o.heading), one * math.sin(o.heading)) if self.wheels else (one, two))
        return o if self.turn_rate is None else replace(o, turn_rate=self.turn_rate)
