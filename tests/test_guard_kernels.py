"""The kernels of the guard, each against what it has to hold, looked at in small steps of time and angle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, RobotSpec
from antway.kernels.base.records import RobotState
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.guard import BRAKED, FREE, Rules, guarded
from antway.world.terrain import terrain_of

DT = 0.1
HALL = terrain_of(Grid(np.zeros((60, 60), dtype=bool), 0.1))


def standing(*places: tuple[float, float]) -> np.ndarray:
    """Rows of discs of 0.3 m that stand at these places and may not move."""
    return np.array([(x, y, 0.0, 0.0, 0.3, 0.0, math.inf, 0.0) for x, y in places])


@pytest.mark.parametrize("turn_rate", [2.0, 12.0, 15.7, 16.0, 20.0, 30.0])
def test_wheels_that_brake_turn_without_driving(turn_rate: float) -> None:
    """People touch the robot all around. It does not drive, and turns as far as it can by at most 90 degrees in a period."""
    robot, most = RobotSpec(radius=0.3, drive="differential", turn_rate=turn_rate, dynamics="steps"), turn_rate * DT
    around = standing(*((3.0 + 0.6000001 * math.cos(k), 3.0 + 0.6000001 * math.sin(k)) for k in np.arange(0.0, 6.2, 0.7)))
    for heading in (0.0, 1.3, -3.0):
        for turn in np.linspace(-3.1, 3.1, 32):
            command = math.cos(heading + turn), math.sin(heading + turn)
            state = RobotState(3.0, 3.0, heading, 0.0, 0.0)
            vx, vy, did = guarded(state, *command, around, Rules(robot.limits, HALL, DT, 0.0, True))
            *velocity, after = drive(0.0, 0.0, heading, vx, vy, robot.limits, DT)
            assert did in (FREE, BRAKED) and math.hypot(*velocity) < 1e-9
            turned = math.remainder(after - heading, 2.0 * math.pi)
            assert turned == pytest.approx(math.copysign(most, turn) if most < min(abs(turn), math.pi / 2) else 0.0)
