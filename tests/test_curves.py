"""Tracks that turn at a constant rate: they are noticed, and predicted on circles."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, Observation, Scenario, Tracks, World, check_episode, run
from antway.kernels.base import records
from antway.kernels.base.records import Terrain
from antway.kernels.crossing import SEGMENT_COUNT
from antway.kernels.tracking import curves
from antway.kernels.tracking.predict import ID, RADIUS, VX, VY, X, Y
from antway.kernels.tracking.table import make_table
from antway.policies.antway.policy import AntwayPolicy
from antway.world.motions import Replay
from antway.world.policy import RobotSpec, Task
from antway.world.robots import load_robot
from antway.world.terrain import terrain_of
from antway.world.world import Obstacle
from common import all_seen, cases, changes_of, costly
from naive import people as naive

AIR = Terrain(np.zeros((1, 1), np.bool_), np.zeros((1, 1), np.bool_), -1e6, -1e6, 2e6)


def _rates(scans, terrain: Terrain = AIR) -> np.ndarray:
    turning = curves.Turning(make_table(64, curves.COLUMNS), np.zeros(curves.POOL), np.zeros(64))
    for (t, estimates), changed in zip(scans, changes_of(scans, terrain), strict=True):
        curves.turn_rates(turning, estimates, all_seen(estimates), estimates.copy(), changed, t)
    return turning.rate[: len(estimates)]


def _rows(places: dict[int, tuple[float, float, float, float]]) -> np.ndarray:
    """Return estimates of tracks with these names, places and velocities."""
    estimates = np.zeros((len(places), 8))
    for row, (name, motion) in zip(estimates, places.items(), strict=True):
        row[[X, Y, VX, VY]], row[ID] = motion, name
    return estimates


def test_turn_rates_are_those_of_the_slow_twin() -> None:
    """Tracks on circles, on straight lines and on paths that turn at random come and go."""
    turning = 0
    for seed in range(cases(20, 400)):
        rng, scans = np.random.default_rng(seed), []
        step, at = float(rng.choice([0.05, 0.1, 0.25])), rng.uniform(0, 9, 6) + 1j * rng.uniform(0, 9, 6)
        rate = np.where(np.arange(6) < 3, rng.uniform(-1.5, 1.5, 6), 0.0)
        v = rng.uniform(0, 1, 6) * np.exp(1j * rng.uniform(0, 6, 6))
        for i in range(80):
            seen = {k: (at[k].real, at[k].imag, v[k].real, v[k].imag) for k in range(6) if k < 5 or i % 20 > 3}
            scans.append((step * i, seen))
            jump = np.where((np.arange(6) > 3) & (rng.random(6) < 0.02), rng.uniform(-2, 2, 6), 0.0)
            at, v = at + v * step, v * np.exp(1j * (rate * step + jump))
        told, out = naive.turn_rates(scans), _rates([(t, _rows(seen)) for t, seen in scans])
        assert out == pytest.approx([told[k] for k in scans[-1][1]], abs=1e-6)
        turning += np.count_nonzero(out)
    assert turning > 10


def test_a_disc_that_bounces_does_not_turn() -> None:
    """A disc crosses an aisle to and fro aslant: its direction changes at the walls alone."""
    aisle, x, y, vx, vy, scans = terrain_of(Grid(np.zeros((15, 200), np.bool_), 0.1)), 2.0, 0.7, 0.4, 0.6, []
    for i in range(100):
        estimates = _rows({7: (x, y, vx, vy)})
        estimates[0, RADIUS] = 0.3
        scans.append((0.1 * i, estimates))
        x, y = x + 0.1 * vx, y + 0.1 * vy
        if not 0.3 <= y <= 1.2:
            y, vy = 2.0 * min(max(y, 0.3), 1.2) - y, -vy
        assert _rates(scans[-30:], aisle)[0] == 0.0


def test_a_disc_that_turns_turns_the_other_way_after_a_bounce() -> None:
    """On a circle it comes to the edge of the map at y = 10 m, and goes on along the mirrored circle."""
    room, scans = terrain_of(Grid(np.zeros((100, 100), np.bool_), 0.1)), []
    for i in range(58):  # the last step is the bounce
        turn = 0.75 * np.exp(1j * (2.5 + 0.08 * i))
        at, v = 5.0 + 9.2j + turn, 0.8j * turn
        if i == 57:
            at, v = complex(at.real, 19.4 - at.imag), v.conjugate()
        estimates = _rows({7: (at.real, at.imag, v.real, v.imag)})
        estimates[0, RADIUS] = 0.3
        scans.append((0.1 * i, estimates))
    assert [_rates(some, room)[0] for some in (scans[:-1], scans)] == pytest.approx([0.8, -0.8])


def test_mean_velocities_lead_along_the_circle() -> None:
    for rate in (-2.0, -1e-12, 0.0, 0.3, 5.0):
        moments = 0.4 + (np.arange(4000) + 0.5) * 0.7 / 4000
        mean = ((0.6 - 0.8j) * np.exp(1j * rate * moments)).mean()
        assert curves.mean_velocity(0.6, -0.8, rate, 0.4, 1.1) == pytest.approx((mean.real, mean.imag), abs=1e-6)


def _circle(x: float, y: float, radius: float, rate: float, t: np.ndarray) -> np.ndarray:
    return np.column_stack((x + radius * np.cos(rate * t), y + radius * np.sin(rate * t)))


def test_the_policy_predicts_who_goes_in_circles_and_nobody_else() -> None:
    """After four seconds a disc on a circle of 1.5 m and one on a line are where they are expected 1.2 s later."""
    policy = AntwayPolicy()
    policy.reset(Task(Grid(np.zeros((120, 120), np.bool_), 0.1), RobotSpec(dt=0.1), (1.0, 1.0), (11.0, 11.0)), 3)
    t = 0.1 * np.arange(61)
    places = np.stack((_circle(6.0, 6.0, 1.5, 0.6, t), np.column_stack((2.0 + 0.5 * t, 0.0 * t + 9.0))))
    for i in range(41):
        velocity = (places[:, i + 1] - places[:, i]) / 0.1
        tracks = Tracks(np.array([1, 2]), places[:, i], velocity, np.array([0.3, 0.3]))
        policy.act(Observation(0.1 * i, (1.0, 1.0), (0.0, 0.0), 0.0, tracks))
    assert policy.state is not None
    assert policy.state.crowd.turning.rate[:2] == pytest.approx([0.6, 0.0], abs=1e-3)
    segments = policy.state.plan.segments[: int(policy.state.plan.state[SEGMENT_COUNT])]
    now = segments[(segments[:, records.T0] <= 5.2) & (segments[:, records.T1] > 5.2)]
    found = now[:, [records.X, records.Y]] + now[:, [records.VX, records.VY]] * (5.2 - now[:, [records.T0]])
    assert found == pytest.approx(places[:, 52], abs=0.06)


@pytest.mark.parametrize("robot", ["holonomic", "diff"])
def test_a_robot_crosses_among_discs_that_go_in_circles(robot: str) -> None:
    """Six discs go around where the robot has to pass; who expects them to go straight waits for each of them."""
    t, times = np.arange(0.0, 60.05, 0.1), []
    for seed in range(costly(4, 40)):
        rng, discs = np.random.default_rng(seed), []
        for i in range(6):
            radius, speed = rng.uniform(0.8, 2.0), rng.uniform(0.5, 1.1)
            rate = float(rng.choice([-1, 1])) * speed / radius
            path = _circle(4.0 + 1.6 * i, rng.uniform(3.5, 6.5), radius, rate, t + 9.0 * i)
            discs.append(Obstacle(0.3, Replay(tuple(t.tolist()), tuple(map(tuple, path.tolist())))))
        world = World(Grid(np.zeros((50, 80), np.bool_), 0.2), tuple(discs))
        result = run(Scenario(world, (1.1, 5.1), (15.1, 5.1), robot=load_robot(robot), obstacle_speed=1.5), "antway", seed=seed)
        check_episode(result)
        assert result.reached, seed
        times.append(result.time)
    assert math.fsum(times) / len(times) < 16.0
