"""Contact of a body in motion, one kernel at a time, against slow twins and dense samples."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid
from antway.kernels.base.geometry import TOUCH
from antway.kernels.robot.sweep import (
    Body,
    Disc,
    Pose,
    Segment,
    axis_gap,
    disc_axis,
    meets_disc,
    meets_wall,
    nearest_disc,
    pose,
    rolling,
    square_axis,
    straight,
)
from antway.world.terrain import walls_of
from common import cases, costly
from naive import motion as naive

SHAPES = {
    "disc": np.zeros((1, 2)),
    "rod": np.array([(-0.3, 0.0), (0.4, 0.1)]),
    "sliver": np.array([(0.6, 0.0), (-0.2, 0.05), (-0.2, -0.05)]),
    "box": np.array([(-0.2, -0.15), (0.35, -0.15), (0.35, 0.15), (-0.2, 0.15)]),
    "hexagon": 0.3 * np.array([(math.cos(a), math.sin(a)) for a in np.arange(6) * math.pi / 3 + 0.1]),
}


def some_segment(rng: np.random.Generator, h: float) -> Segment:
    """An arc, a straight line of wheels or one of a robot without wheels."""
    x, y, theta = rng.uniform((-1.0, -1.0, -4.0), (1.0, 1.0, 4.0)).tolist()
    if rng.random() < 0.3:
        return straight(x, y, theta, *(rng.uniform(-2.0, 2.0, 4) * (rng.random(4) < 0.7)).tolist())
    rates = rng.uniform((-1.0, -2.0, -3.0, -6.0), (2.0, 2.0, 3.0, 6.0)) * (rng.random(4) < 0.7)
    return rolling(x, y, theta, *rates.tolist(), h)


def body_of(shape: str, rng: np.random.Generator) -> Body:
    """The shape, rounded; a disc always is."""
    corners = SHAPES[shape]
    rounding = float(rng.choice([0.0, 0.1])) if len(corners) > 1 else 0.3
    return Body(corners, rounding, rounding + float(np.hypot(*corners.T).max()), np.zeros((1, 2)))


def places(m: Segment, corners: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The body's corners in the world at these times."""
    return naive.body_at(corners, *np.array([pose(m, s)[:3] for s in times.tolist()]).T)


@pytest.mark.parametrize("shape", SHAPES)
def test_along_the_axis_the_gap_is_the_distance(shape: str) -> None:
    """Of points and of squares, beside edges, beyond corners and, where they overlap, as deep as they do."""
    rng, corners = np.random.default_rng(1), SHAPES[shape]
    for _ in range(cases(300, 30_000)):
        at = Pose(*rng.uniform(-0.8, 0.8, 2).tolist(), rng.uniform(-4.0, 4.0), 0.0, 0.0, 0.0)
        (x, y), half = rng.uniform(-0.3, 0.3, 2).tolist(), float(rng.choice([0.02, 0.25]))
        here = naive.body_at(corners, at.x, at.y, at.theta)
        nx, ny = disc_axis(at, corners, x, y)
        assert math.hypot(nx, ny) == pytest.approx(1.0)
        apart = (here @ (nx, ny)).min() - nx * x - ny * y
        assert apart == pytest.approx(float(naive.hull_gap(here, np.array([(x, y)]))), abs=1e-12)
        square = np.array([(x - half, y - half), (x + half, y - half), (x + half, y + half), (x - half, y + half)])
        nx, ny = square_axis(at, corners, x, y, half)
        assert math.hypot(nx, ny) == pytest.approx(1.0)
        apart = (here @ (nx, ny)).min() - (square @ (nx, ny)).max()
        assert apart == pytest.approx(float(naive.hull_gap(here, square)), abs=1e-12)


@pytest.mark.parametrize("shape", SHAPES)
def test_a_gap_stays_open_for_as_long_as_told(shape: str) -> None:
    """And on straight segments no longer; one that is not open stays as it is, or opens."""
    rng, corners, met = np.random.default_rng(2), SHAPES[shape], 0
    for _ in range(cases(150, 15_000)):
        h = float(rng.choice([0.1, 1.0]))
        m, angle = some_segment(rng, h), rng.uniform(-4.0, 4.0)
        nx, ny, (rate, growth) = math.cos(angle), math.sin(angle), rng.uniform((-1.0, 0.0), (1.0, 2.0)).tolist()
        times = np.linspace(0.0, h, 201)
        ahead = places(m, corners, times) @ (nx, ny)
        level = float(ahead[0].min() - rng.uniform(-0.15, 0.3))
        gap, opening, time = axis_gap(m, pose(m, 0.0), corners, nx, ny, level, rate, growth)
        gaps = ahead.min(axis=1) - level - rate * times - 0.5 * growth * times**2
        assert gap == pytest.approx(gaps[0], abs=1e-12)
        soon = places(m, corners, np.array([0.0, 1e-6])) @ (nx, ny)
        nearest = soon[0].argmin()
        assert opening == pytest.approx((soon[1] - soon[0])[nearest] / 1e-6 - rate, abs=1e-4)
        assert gaps[times < time].min() > min(gap, 0.0) - 1e-9
        closes = (soon[1] - soon[0]) / 1e-6 - rate < 0.1
        if gap < 0.0 and (soon[0] - soon[0].min() > 0.02)[closes].all():  # only what is less deep gets deeper
            assert time > 1e-3
        if gap > 0.0 and not m.curved and time < h:
            later = (places(m, corners, np.array([time])) @ (nx, ny)).min() - level - rate * time - 0.5 * growth * time**2
            assert later == pytest.approx(0.0, abs=1e-9)
            met += 1
    assert met > 2


@pytest.mark.parametrize("shape", SHAPES)
def test_a_disc_is_met_and_passed_where_dense_samples_are(shape: str) -> None:
    """The first contact, also with a disc that is fast, and the smallest gap, on segments of many lengths."""
    rng, told = np.random.default_rng(3), [0, 0]
    for _ in range(costly(40, 4000)):
        h = float(rng.choice([0.003, 0.1, 0.8]))
        m, body = some_segment(rng, h), body_of(shape, rng)
        angle, away, radius = rng.uniform(-4.0, 4.0), body.radius + rng.uniform(0.0, 0.5), float(rng.choice([0.05, 0.4]))
        there = np.array([math.cos(angle), math.sin(angle)])
        x, y = (np.array([m.x, m.y]) + (away + radius) * there).tolist()
        disc = Disc(x, y, *((rng.uniform(-1.0, 1.0, 2) - there) * rng.choice([0.0, 1.0, 4.0])).tolist(), radius)
        first = meets_disc(m, h, body, disc)
        told[int(first < math.inf)] += 1
        end = min(first, h)
        times = np.linspace(0.0, end, 4001)
        centres = np.array([x, y]) + times[:, None] * (disc.vx, disc.vy)
        gaps = naive.hull_gap(places(m, body.corners, times), centres[:, None]) - radius - body.rounding
        assert gaps.min() > -1e-6
        if first < math.inf:
            assert gaps[-1] == pytest.approx(-TOUCH, abs=2e-8)  # it is found within a nanosecond
        best = nearest_disc(m, end, body, disc, math.inf)
        assert -3e-6 < best - gaps.min() < 1e-9
        assert nearest_disc(m, end, body, disc, best + 0.01) == pytest.approx(best, abs=1e-9)
        assert nearest_disc(m, end, body, disc, best - 0.01) == best - 0.01
        soon = min(times[gaps.argmin()] + 1e-3, end)  # the segment ends just after the body has come nearest
        assert nearest_disc(m, soon, body, disc, math.inf) == pytest.approx(best, abs=1e-9)
        fast = disc._replace(vx=8.0 * disc.vx, vy=8.0 * disc.vy)
        end = min(meets_disc(m, h, body, fast), h)
        near = nearest_disc(m, end, body, fast, math.inf)  # and if another disc has come nearly as near before:
        assert nearest_disc(m, end, body, fast, near + 1e-6) == pytest.approx(near, abs=1e-7)
    assert min(told) > 0


@pytest.mark.parametrize("shape", SHAPES)
def test_walls_and_edges_are_met_where_dense_samples_meet_them(shape: str) -> None:
    """On the whole of a long segment, by rounded bodies too, whatever the place of the map."""
    rng, told = np.random.default_rng(4), [0, 0]
    for _ in range(cases(40, 4000)):
        blocked, size = rng.random((20, 24)) < 0.02, float(rng.choice([0.1, 0.25]))
        walls, body, h = walls_of(Grid(blocked, size, (-1.0, 0.5, 0.0))), body_of(shape, rng), float(rng.choice([0.05, 1.2]))
        m = some_segment(rng, h)
        m = m._replace(x=rng.uniform(-0.5, 24 * size - 1.5), y=rng.uniform(1.0, 20 * size))
        first = meets_wall(m, h, body, walls)
        times = np.linspace(0.0, min(first, h), 401)
        gaps = naive.wall_gap(places(m, body.corners, times) - (-1.0, 0.5), blocked, size, 0.3) - body.rounding
        if gaps[0] < 1e-6:
            continue  # it begins in a wall
        told[int(first < math.inf)] += 1
        assert gaps.min() > -1e-6
        if first < math.inf:
            assert gaps[-1] == pytest.approx(-TOUCH, abs=2e-8)
    assert min(told) > 0
