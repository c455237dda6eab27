"""Cases at the edges of small kernels: rest, repeated scans, first scans, names and losses."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, RobotSpec, Task
from antway.kernels.robot.dynamics import drive
from antway.kernels.tracking import noise, reported
from antway.kernels.tracking.table import make_table
from antway.world.sensor import Scanner, Sensor
from antway.world.timeline import Timeline


def scanner(sensor: Sensor, *places: tuple[float, float], reach: float = 4.0) -> Scanner:
    task = Task(Grid(np.zeros((20, 20), dtype=bool)), RobotSpec(sensor_range=reach), (1.0, 1.0), (2.0, 2.0))
    still = Timeline.of(range(len(places)), [0.3] * len(places), [([0.0], [place]) for place in places])
    return Scanner(sensor, task, still, 0)


def test_a_disc_around_the_sensor_is_seen() -> None:
    """Nothing hides it, and there is no direction to it."""
    _, tracks, _ = scanner(Sensor(), (3.0, 4.0)).observe(0.0, 3.0, 4.0)
    assert tracks.xy.tolist() == [[3.0, 4.0]]


def test_the_noise_of_a_disc_does_not_depend_on_which_others_are_seen() -> None:
    sensor = Sensor(noise=0.05, velocity_noise=0.1)
    both, one = scanner(sensor, (3.0, 5.0), (5.0, 4.0)), scanner(sensor, (30.0, 5.0), (5.0, 4.0))
    for i in range(3):
        seen, alone = both.observe(0.1 * i, 3.0, 4.0)[1], one.observe(0.1 * i, 3.0, 4.0)[1]
        assert seen.id.tolist() == [0, 1] and alone.id.tolist() == [1]
        assert seen.xy[1].tobytes() == alone.xy[0].tobytes() and seen.velocity[1].tobytes() == alone.velocity[0].tobytes()


def test_covariances_say_what_the_sensor_does() -> None:
    """Measured velocities have the variance that is added to them; estimated ones begin at 2 m/s and depend on the place."""
    measured = scanner(Sensor(noise=0.05, velocity_noise=0.1), (3.0, 5.0)).observe(0.0, 3.0, 4.0)[1].covariance
    assert np.diag(measured[0]) == pytest.approx([0.05**2, 0.05**2, 0.1**2, 0.1**2])
    eyes = scanner(Sensor(noise=0.0, velocity="estimated", agility=0.2), (3.0, 5.0))
    first = eyes.observe(0.0, 3.0, 4.0)[1].covariance
    assert np.diag(first[0]) == pytest.approx([1e-8, 1e-8, 4.0, 4.0])
    second = eyes.observe(0.1, 3.0, 4.0)[1].covariance
    assert second[0, 0, 2] > 0.0 and np.array_equal(second[0], second[0].T) and np.diag(second[0])[2:].max() < 0.1
    kept = eyes.observe(1.05, 3.0, 4.0)[1].covariance
    assert kept[0, 2, 2] < 0.5, "a disc that was not seen for less than a second keeps its filter"
    again = eyes.observe(2.1, 3.0, 4.0)[1].covariance
    assert again[0, 2, 2] == 4.0, "and it begins anew after that"


def test_a_robot_at_rest_keeps_its_heading() -> None:
    """Holonomic or on wheels, and a command of next to nothing turns no wheels; headings stay within a turn."""
    robot = RobotSpec()
    wheels = replace(robot, drive="differential").limits
    assert drive(0.0, 0.0, 1.0, 0.0, 0.0, robot.limits, 0.1) == (0.0, 0.0, 1.0)
    assert drive(0.0, 0.0, 1.0, 0.0, -1e-12, wheels, 0.1)[2] == 1.0
    assert drive(0.0, 0.0, 3.1, -1.0, -0.1, wheels, 0.1)[2] == pytest.approx(math.atan2(-0.1, -1.0))


def test_a_scan_that_comes_twice_teaches_nothing() -> None:
    table, state = make_table(4, noise.COLUMNS), np.zeros(noise.STATE)
    name, xy, velocity = np.array([0]), np.zeros((1, 2)), np.ones((1, 2))
    for i in range(5):
        found = noise.measured_noise(*table[:2], state, 0.1 * i, name, xy + 0.3 * i, velocity)
    assert state[noise.COUNT] == 4
    before = state.copy()
    assert noise.measured_noise(*table[:2], state, 0.4, name, xy + 9.0, velocity) == found
    assert state.tolist() == before.tolist()


def test_the_variance_of_velocities_is_at_most_what_places_allow() -> None:
    """However wrong velocities are: it is that of the mean velocity between two places."""
    table, state, rng = make_table(4, noise.COLUMNS), np.zeros(noise.STATE), np.random.default_rng(1)
    for i in range(300):
        velocity = rng.normal(0.0, 20.0, (1, 2))
        places, speeds = noise.measured_noise(
            *table[:2], state, 0.1 * i, np.array([0]), rng.normal(0.0, 0.05, (1, 2)), velocity
        )
    assert speeds == pytest.approx(4.0 * places / 0.1**2) and speeds < state[noise.VELOCITY] / noise.MEDIAN


@pytest.mark.parametrize("large", [True, False])
def test_medians_take_longer_steps_from_the_tenth_of_a_run_on(large: bool) -> None:
    """Of a run of large values; small ones, and the first nine, move the logarithm by 0.1 each."""
    state = np.zeros(noise.STATE)
    state[noise.PLACE] = 1e-6
    for _ in range(12):
        noise._step(state, noise.PLACE, 1.0, 0.5 if large else 2.0, 0.1)
    assert math.log(state[noise.PLACE] / 1e-6) == pytest.approx(0.1 * (9 + 2 + 3 + 4 if large else 12))


def test_one_jump_counts_as_one_metre_per_second() -> None:
    """Of an error of 50 m/s, which a place that jumps seems to be; both ways of predicting it err alike."""
    table, state, span = make_table(4, reported.COLUMNS), np.zeros(3), (0.0, 10.0, 2.0)
    for t, x in ((0.0, 0.0), (0.1, 0.1), (0.2, 5.2)):
        args = t, np.array([0]), np.array([[x, 0.0]]), np.array([[1.0, 0.0]])
        assert not reported.wrong(*table[:2], state, *args, span)
    assert state == pytest.approx([1.0, 1.0, 1.0])
