"""Where an obstacle can be: the kernels against a sampled twin, and against obstacles that do their worst."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway.kernels.robot.reach import reach_gap_along
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
