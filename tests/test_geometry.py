"""Kernels of geometry against dense sampling (C23) and cases worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid
from antway.kernels.base import geometry
from antway.kernels.base.records import Trajectories
from antway.world.terrain import terrain_of
from common import cases
from naive.geometry import hits_cells, sampled_discs, sampled_square, sampled_timeline


def test_swept_discs_against_samples():
    """The closed form misses no contact that 10,000 samples see and alarms only within 1e-9 of what they can resolve (C23)."""
    rng = np.random.default_rng(1)
    for _ in range(cases(10_000, 1_000_000)):
        dt = rng.choice([0.05, 0.1, 1.0, 10.0])
        p = rng.normal(size=2) * 3
        v = rng.normal(size=2) * rng.choice([0.0, 1e-6, 0.1, 1.0, 30.0])
        contact_radius = rng.uniform(0.05, 1.5)
        first, distance, when = geometry.swept_discs(p[0], p[1], v[0], v[1], contact_radius, dt)
        sampled, _, sampled_first = sampled_discs(p, v, contact_radius, dt)
        resolved = math.hypot(*v) * dt / 9_999 / 2  # no sample is farther in space from the true closest point
        assert distance <= sampled + 1e-12
        assert sampled <= math.hypot(distance, resolved) + 1e-12
        assert 0.0 <= when <= dt
        assert math.isclose(math.hypot(*(p + v * when)), distance, rel_tol=1e-12, abs_tol=1e-12)
        assert (first < math.inf) == (distance < contact_radius - 1e-9)
        assert first <= sampled_first + 1e-9
        if 0.0 < first < math.inf:
            assert math.isclose(math.hypot(*(p + v * first)), contact_radius, abs_tol=1.1e-9)
            assert np.dot(p, v) < 0.0


@pytest.mark.parametrize("speed", [1e1, 1e3, 1e6])
def test_tunnelling(speed):
    """Two discs that pass through one another within one step are in contact however fast they are (C23)."""
    rng = np.random.default_rng(2)
    for _ in range(cases(300)):
        angle, offset = rng.uniform(0, 2 * np.pi), rng.uniform(-0.99, 0.99)
        u, n = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
        p, v, dt = -5 * u + offset * n, speed * u, 10.0 / speed
        first, distance, when = geometry.swept_discs(p[0], p[1], v[0], v[1], 1.0, dt)
        assert math.isclose(first * speed, 5 - math.sqrt(1 - offset**2), rel_tol=1e-9)
        assert math.isclose(distance, abs(offset), abs_tol=1e-12)
        assert math.isclose(when, dt / 2, rel_tol=1e-9)


def test_touching_is_no_contact():
    """Discs that touch, slide along one another, part from contact or stand are judged as the rule of touching says."""
    touch = geometry.swept_discs
    assert touch(1.0, 0.0, 0.0, 1.0, 1.0, 5.0) == (math.inf, 1.0, 0.0)
    assert touch(2.0, 1.0, -1.0, 0.0, 1.0, 5.0) == (math.inf, 1.0, 2.0)
    assert touch(1.0, 0.0, 1.0, 0.0, 1.0, 5.0)[0] == math.inf
    assert touch(1.0, 0.0, -1.0, 0.0, 1.0, 5.0)[0] == 0.0
    assert touch(0.5, 0.0, 1.0, 0.0, 1.0, 5.0)[0] == 0.0
    assert touch(0.5, 0.0, 0.0, 0.0, 0.5, 5.0) == (math.inf, 0.5, 0.0)
    assert touch(3.0, 0.0, -1.0, 0.0, 1.0, 0.0) == (math.inf, 3.0, 0.0)


def test_swept_timeline_against_samples():
    """A step against a piecewise linear course: contact, least distance and times agree with 10,000 samples."""
    rng = np.random.default_rng(3)
    for _ in range(cases(2_000, 100_000)):
        n = rng.integers(1, 6)
        knot_t = np.cumsum(rng.uniform(0.1, 2.0, n)) - 1.0
        knot_xy = rng.normal(size=(n, 2)) * 2
        disc = Trajectories(knot_t, knot_xy, np.array([0, n]), np.zeros(1))
        a, b = rng.normal(size=(2, 2)) * 2
        t0 = rng.uniform(-2.0, 4.0)
        t1 = t0 + rng.choice([0.0, rng.uniform(0.0, 6.0)])
        if t1 == t0:
            b = a
        contact_radius = rng.uniform(0.05, 1.5)
        first, distance, when = geometry.swept_timeline(*a, *b, t0, t1, contact_radius, disc, 0)
        sampled, _, sampled_first = sampled_timeline(a, b, t0, t1, contact_radius, knot_t, knot_xy)
        fastest = math.dist(a, b) / max(t1 - t0, 1e-9)
        if n > 1:
            fastest += (np.hypot(*np.diff(knot_xy, axis=0).T) / np.diff(knot_t)).max()
        resolved = fastest * (t1 - t0) / 9_999 / 2
        assert distance <= sampled + 1e-12
        assert sampled <= distance + resolved + 1e-12
        assert t0 <= when <= t1
        assert (first < math.inf) == (distance < contact_radius - 1e-9)
        assert first <= sampled_first + 1e-9
        if first < math.inf:
            assert t0 <= first <= when
            x, y, _, _ = geometry.timeline_at(first, disc, 0)
            s = (first - t0) / (t1 - t0) if t1 > t0 else 0.0
            away = math.hypot(x - a[0] - s * (b[0] - a[0]), y - a[1] - s * (b[1] - a[1]))
            assert away <= contact_radius + 1e-9 if first == t0 else math.isclose(away, contact_radius, abs_tol=2e-9)


def test_timeline_at():
    """A timeline is at its knots at their times, in between on the straight line, and stands before and after."""
    knot_t, knot_xy = np.array([9.0, 1.0, 3.0, 4.0, 9.0]), np.array([[9.0, 9], [0, 0], [2, 4], [2, 4], [9, 9]])
    discs = Trajectories(knot_t, knot_xy, np.array([0, 1, 4, 5]), np.zeros(3))
    at = [geometry.timeline_at(t, discs, 1) for t in (0.0, 1.0, 2.0, 3.0, 4.0, 5.0)]
    assert at == [(0, 0, 0, 0), (0, 0, 1, 2), (1, 2, 1, 2), (2, 4, 0, 0), (2, 4, 0, 0), (2, 4, 0, 0)]


def test_segment_square_distance_against_samples():
    """The distance of a segment from a square agrees with 10,000 samples, is 0 where they meet, and is symmetric."""
    rng = np.random.default_rng(4)
    for _ in range(cases(3_000, 100_000)):
        lattice = rng.random() < 0.3
        a, b, cell = rng.integers(-4, 5, (3, 2)) / 2.0 if lattice else rng.normal(size=(3, 2)) * 2
        half = rng.choice([0.0, 0.5, 1.0])
        distance = geometry.segment_square_distance(*a, *b, *cell, half)
        sampled = sampled_square(a, b, cell, half)
        assert distance <= sampled + 1e-12
        assert sampled <= distance + math.dist(a, b) / 9_999 / 2 + 1e-12
        assert math.isclose(distance, geometry.segment_square_distance(*b, *a, *cell, half), abs_tol=1e-12)


@pytest.mark.parametrize("walled", [False, True])
def test_segment_hits_cells_against_samples(walled):
    """A disc's straight way is free exactly where no sample comes nearer than the radius to a blocked cell or the edge."""
    rng = np.random.default_rng(5)
    for _ in range(cases(700, 30_000)):
        blocked = rng.random(rng.integers(1, 8, 2)) < 0.25
        a, b = rng.uniform(-1.0, 8.0, (2, 2)) if rng.random() < 0.5 else rng.integers(0, 7, (2, 2)).astype(float)
        radius = rng.uniform(0.01, 2.0)
        least = hits_cells(blocked, a, b, radius, walled)
        if abs(least - radius) > math.dist(a, b) / 1_999 / 2 + 2e-9:  # what the samples can tell
            assert geometry.segment_hits_cells(blocked, *a, *b, radius, walled) == (least < radius)


def test_what_leads_clear_of_walls():
    """From free space that is a way without contact; from a wall, one on which no cell gets nearer than it was at first."""
    rng, led = np.random.default_rng(7), 0
    for _ in range(cases(700, 30_000)):
        blocked = rng.random(rng.integers(1, 8, 2)) < 0.25
        a, b = rng.uniform((0.0, 0.0), blocked.shape, (2, 2))
        radius = rng.uniform(0.01, 1.0)
        leads = geometry.leads_clear(terrain_of(Grid(blocked, 1.0)), a[1], a[0], b[1], b[0], radius)
        start, least = (hits_cells(blocked, a - 0.5, end - 0.5, radius, True) for end in (a, b))
        resolved = math.dist(a, b) / 1_999 / 2 + 2e-9
        if start >= radius + resolved and abs(least - radius) > resolved:
            assert leads == (least > radius)
        elif 0.0 < start < radius - resolved and leads:
            led += 1
            assert least >= start - resolved
    assert led > cases(700, 30_000) / 100
    wall = terrain_of(Grid(np.arange(6)[:, None] < np.full(6, 2), 1.0))
    assert geometry.leads_clear(wall, 3.0, 2.8, 3.0, 4.0, 0.9) and not geometry.leads_clear(wall, 3.0, 2.8, 3.0, 2.7, 0.9)


def test_exact_touching_of_cells():
    """A disc of radius exactly the clearance of a cell centre fits there, and one that is 1e-6 larger does not."""
    rng = np.random.default_rng(6)
    for _ in range(cases(100)):
        grid = Grid(rng.random(rng.integers(1, 9, 2)) < 0.2)
        for (r, c), clear in np.ndenumerate(grid.clearance()):
            if clear > 0.0:
                assert not geometry.segment_hits_cells(grid.blocked, r, c, r, c, clear, True)
                assert geometry.segment_hits_cells(grid.blocked, r, c, r, c, clear + 1e-6, True)


def test_what_a_point_may_touch():
    """A point may run along edges and through corners, and not through the inside of a cell or off the map."""
    blocked = np.zeros((5, 5), dtype=bool)
    blocked[2, 2] = True

    def see(blocked, *ends):
        return not geometry.segment_hits_cells(blocked, *ends, 0.0, True)

    assert see(blocked, 1.5, 0.0, 1.5, 4.0)
    assert see(blocked, 1.0, 2.0, 2.0, 1.0)
    assert see(blocked, 1.0, 1.0, 1.5, 1.5)
    assert not see(blocked, 1.0, 1.0, 3.0, 3.0)
    assert not see(blocked, 2.0, 0.0, 2.0, 4.0)
    assert not see(blocked, 2.0, 2.0, 2.0, 2.0)
    assert see(blocked, -0.5, 0.0, -0.5, 4.5)
    assert not see(blocked, -0.6, 0.0, 0.0, 0.0)
