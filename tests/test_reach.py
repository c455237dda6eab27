"""Where an obstacle can be: the kernels against a sampled twin, and against obstacles that do their worst."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, RobotSpec
from antway.kernels.base.records import RobotState
from antway.kernels.robot.brake import Robot
from antway.kernels.robot.guard import STEPPED_ASIDE, time_to_contact
from antway.kernels.robot.passing import passed_command
from antway.kernels.robot.reach import reach_gap_along, split_at_walls
from antway.kernels.robot.sweep import Body
from antway.world.terrain import walls_of
from common import cases
from naive import reach as naive


def _cases(seed, count):
    rng = np.random.default_rng(seed)
    for _ in range(count):
        speed = rng.uniform(0.0, 2.5)
        accel = rng.choice([0.0, 0.5, 2.2, 6.0, math.inf])
        angle, now = rng.uniform(0, 2 * math.pi), rng.uniform(0, 1) * speed
        (x, y), radius = rng.uniform(-2, 2, 2), rng.uniform(0, 0.6)
        row = np.array([x, y, now * math.cos(angle), now * math.sin(angle), radius, speed, accel, rng.uniform(0, 0.5)])
        yield rng, row


def test_the_gap_is_that_of_both_discs():
    for rng, row in _cases(1, cases(200)):
        px, py, t = rng.uniform(-3, 3), rng.uniform(-3, 3), rng.uniform(0, 2)
        assert reach_gap_along(row, px, py, 0.0, 0.0, t, t) == pytest.approx(naive.gap(row, px, py, t), abs=1e-12)


def test_along_a_motion_it_bounds_every_instant_and_is_nearly_met():
    for rng, row in _cases(2, cases(200)):
        (px, py), (wx, wy) = rng.uniform(-3, 3, 2), rng.uniform(-1.5, 1.5, 2)
        start, span = rng.uniform(0, 1), rng.choice([0.0, 0.1, 0.5])
        bound = reach_gap_along(row, px, py, wx, wy, start, start + span)
        least = naive.least(row, px, py, wx, wy, start, start + span)
        assert bound <= least + 1e-9
        for column, value in ((5, 1e6), (6, math.inf)):  # either term alone is met, but for the chord of the parabola
            one = row.copy()
            one[column] = value
            near = naive.least(one, px, py, wx, wy, start, start + span)
            slack = one[6] * span * span / 8 if math.isfinite(one[6]) else 0.0
            assert reach_gap_along(one, px, py, wx, wy, start, start + span) >= near - slack - 0.01


def test_a_point_may_be_exactly_as_fast_as_the_disc_grows():
    """It then is nearest at the end, whether it goes towards the obstacle, away from it or past it."""
    row = np.array([0.0, 0.0, 0.0, 0.0, 0.3, 1.25, math.inf, 0.1])
    for wx, wy in ((-1.25, 0.0), (1.25, 0.0), (-0.75, 1.0)):
        gap = reach_gap_along(row, 3.0, 0.0, wx, wy, 0.0, 0.4)
        assert gap == pytest.approx(naive.least(row, 3.0, 0.0, wx, wy, 0.0, 0.4), abs=1e-12)


def test_whoever_keeps_to_the_bounds_is_never_nearer_than_the_gap():
    for rng, row in _cases(3, cases(200)):
        accel = row[6] if math.isfinite(row[6]) else 50.0
        (x, y), (vx, vy), t, step = row[:2], row[2:4], -row[7], 0.005
        px, py = rng.uniform(-2, 2, 2)
        while t < 1.0:
            assert math.hypot(px - x, py - y) - row[4] >= reach_gap_along(row, px, py, 0.0, 0.0, t, t) - 1e-9
            # towards the point as fast as the bounds let it
            far = max(math.hypot(px - x, py - y), 1e-9)
            dx, dy = (px - x) / far * row[5] - vx, (py - y) / far * row[5] - vy
            change = math.hypot(dx, dy)
            share = min(1.0, accel * step / change) if change > 0 else 0.0
            nx, ny = vx + dx * share, vy + dy * share
            x, y, t = x + (vx + nx) / 2 * step, y + (vy + ny) / 2 * step, t + step
            vx, vy = nx, ny


def test_two_rows_hold_whoever_may_turn_at_a_wall():
    """It swerves to the wall at x = 4 m and leaves that with all its speed anywhere; far from walls one row is enough."""
    walls, rng = walls_of(Grid(np.ones((160, 1)) * np.arange(240) >= 200, 0.02)), np.random.default_rng(4)
    for _ in range(cases(10)):
        vx, vy, radius = rng.uniform((0.8, -1.0, 0.1), (1.5, 1.0, 0.4))
        accel, age = rng.choice([0.0, 0.5, 4.0]), 0.02
        speed, x = math.hypot(vx, vy) + accel, rng.uniform(2.9, 3.4)
        rows = np.tile([x, 1.6, vx, vy, radius, speed, accel, age], (2, 1))
        assert split_at_walls(rows, 1, walls, 1.0) == 2
        since = age - rows[1, 7]
        assert since >= 0.0 and rows[1, :2] == pytest.approx((x + vx * (since + 0.025), 1.6 + vy * (since + 0.025)))
        assert rows[1, 4] == pytest.approx(radius + accel * (since + 0.05) ** 2 / 2 + 0.025 * math.hypot(vx, vy))
        for angle in np.linspace(0.0, math.pi, 5):
            ax, ay, met = accel * math.cos(angle), accel * math.sin(angle), math.nan
            for t in np.arange(0.0, 1.0, 0.01):
                px, py = x + vx * t + ax * t * t / 2, 1.6 + vy * t + ay * t * t / 2
                met = t if math.isnan(met) and px > 4.0 - radius else met
                places = [(px, py)]
                if t > met:
                    px, py = x + vx * met + ax * met * met / 2, 1.6 + vy * met + ay * met * met / 2
                    places = [(px + speed * (t - met) * math.cos(a), py + speed * (t - met) * math.sin(a)) for a in range(6)]
                for place in places:
                    assert min(naive.gap(row, *place, t - age) for row in rows) <= 1e-9 - radius
    far = np.tile([2.0, 1.6, 0.5, 0.5, 0.3, 1.0, 0.5, 0.0], (2, 1))
    assert split_at_walls(far, 1, walls, 1.0) == 1
    anywhere = np.tile([3.6, 1.6, 0.5, 0.5, 0.3, 1.0, math.inf, 0.0], (2, 1))  # one row holds all that its speed allows
    assert split_at_walls(anywhere, 1, walls, 1.0) == 1


@pytest.mark.parametrize("wall", [False, True])
def test_where_an_obstacle_may_turn_at_a_wall_nobody_is_predicted_to_stand(wall: bool) -> None:
    """A robot near a wall steps aside for whoever comes: it once took itself to be touched there, wherever it went."""
    blocked = np.zeros((60, 80), bool)
    blocked[:, 55:57] = wall
    walls = walls_of(Grid(blocked, 0.1))
    spec = RobotSpec(radius=0.3, a_max=1.0, drive="differential", turn_rate=2.0, alpha_max=4.0)
    body = Body(spec.corners, spec.rounding, spec.radius, np.zeros((1, 2)))
    robot = Robot(spec.limits, body, walls, 0.1, 0.02, False, np.empty((8, 8)), np.array([0.0, 0.0, 0.0, -1.0]))
    rows = np.tile([2.4, 3.0, 1.0, 0.0, 0.3, 1.2, 2.2, 0.0], (2, 1))
    rows = rows[: split_at_walls(rows, 1, walls, 1.3)]
    assert len(rows) == 1 + wall and time_to_contact(4.0, 3.0, rows, 0.3) == pytest.approx(1.0)
    one, _, did = passed_command(RobotState(4.0, 3.0, math.pi / 2, 0.0, 0.0), 0.0, 0.0, rows, robot, 3.0)
    assert did == STEPPED_ASIDE and one > 0.0
