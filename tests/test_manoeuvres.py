"""A car beside its goal: how long its manoeuvres take, and that it drives them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, InvalidPlan, RobotSpec, Scenario, World, check_episode
from antway.world.episode import Episode
from antway.world.manoeuvres import manoeuvre_losses, manoeuvre_times
from common import costly
from naive import manoeuvres as naive

CAR = RobotSpec(drive="ackermann", v_max=1.5, a_max=1.0, brake_max=1.4, v_reverse=0.3, turning_radius=0.8)


@pytest.mark.parametrize("v_reverse", [0.0, 0.3])
def test_manoeuvres_take_as_long_as_the_slow_twin_finds(v_reverse: float) -> None:
    rng, robot = np.random.default_rng(3), replace(CAR, v_reverse=v_reverse)
    times = manoeuvre_times(robot.limits, 0.2)
    assert times.shape == (121, 121) and np.isfinite(times).all() and times[60, 60] < 0.01
    assert times == pytest.approx(times[::-1])  # to the left as to the right
    differences = []
    for i, j in rng.integers(0, 121, (costly(6, 200), 2)).tolist():
        goal = 0.04 * (j - 60), 0.04 * (i - 60)
        differences.append(times[i, j] - naive.least_time(goal, 0.2, robot))
    # The tolerance is that of whole nodes, up to 0.04 m too short, and pieces have fewer lengths.
    assert min(differences) > -0.12 and max(differences) < 0.5 and abs(np.median(differences)) < 0.1


def test_nothing_is_lost_where_one_turn_leads_to_the_goal() -> None:
    losses, frame = manoeuvre_losses(CAR.limits, 0.2)
    assert (losses >= 0.0).all() and losses[60, 61:].max() < 1e-6 and losses[66:72, 60].min() > 0.6
    assert (losses[[0, -1]] == 0.0).all() and frame == pytest.approx([-2.4, -2.4, 25.0, 1.5])
    assert manoeuvre_losses(RobotSpec(drive="differential", a_max=1.0).limits, 0.2)[0].size == 0


@pytest.mark.parametrize("v_reverse", [0.0, 0.3])
@pytest.mark.parametrize("degrees", [45, 90, 135, 180])
def test_a_car_does_not_go_to_and_fro_beside_its_goal(degrees: int, v_reverse: float) -> None:
    """It had taken up to 17 s and 58 changes of direction, and without reverse it stood for ever."""
    robot, hall = replace(CAR, v_reverse=v_reverse, radius=0.3), World(Grid(np.zeros((90, 90), np.bool_), 0.1))
    for distance in (0.4, 0.8, 1.2):
        goal = 4.5 + distance * math.cos(math.radians(degrees)), 4.5 + distance * math.sin(math.radians(degrees))
        episode = Episode(Scenario(hall, (4.5, 4.5), goal, robot, horizon=20.0), "antway", seed=1)
        episode.stage.heading[0] = 0.0
        while episode.outcome is None:
            episode.step()
        result = episode.result()
        with pytest.raises(InvalidPlan, match="does not begin with its heading towards the goal") as fault:
            check_episode(result)
        assert len(fault.value.violations) == 1
        assert result.reached and result.time < 5.0
        trace = result.trace
        ahead = trace.velocity[:, 0] * np.cos(trace.heading) + trace.velocity[:, 1] * np.sin(trace.heading)
        signs = np.sign(np.round(ahead, 3))
        assert (np.diff(signs[signs != 0.0]) != 0.0).sum() <= 3
