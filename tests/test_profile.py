"""Speed profiles: exact, within their limits, never slower than trapezoids, and checked against what moves (C29)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import BadParameter, Grid, TimedPath
from antway.trajectory.profile import is_clear, speed_profile
from common import cases
from naive import crossing as naive


def trapezoid(length: float, v: float, a: float) -> float:
    """Time of a leg from stand to stand."""
    return length / v + v / a if length >= v * v / a else 2.0 * math.sqrt(length / a)


def test_profiles_keep_their_limits_and_beat_trapezoids() -> None:
    """Speed and acceleration hold to 1e-6, ends are met, it stands there, and no leg takes longer than its trapezoid."""
    rng = np.random.default_rng(0)
    for _ in range(cases(200, 5000)):
        points = np.cumsum(rng.normal(size=(int(rng.integers(2, 12)), 2)) * rng.choice([0.05, 0.5, 3.0]), axis=0)
        v, a, corner = rng.uniform(0.2, 2.0), rng.uniform(0.2, 5.0), rng.choice([0.0, 0.1, 0.3])
        path = speed_profile(points, v, a, dt=0.01, t=3.0, corner=corner)
        assert path.t[0] == 3.0 and (np.diff(path.t) > 0).all()
        assert (path.xy[0] == points[0]).all() and (path.xy[-1] == points[-1]).all()
        at = [float(path.t[np.flatnonzero((path.xy == p).all(axis=1))[0]]) for p in points]
        legs = np.hypot(*np.diff(points, axis=0).T)
        assert all(b - c <= trapezoid(leg, v, a) + 1e-6 for c, b, leg in zip(at, at[1:], legs))
        step, dt = np.diff(path.xy, axis=0), np.diff(path.t)
        speed = np.hypot(*step.T) / dt
        assert speed.max() <= v + 1e-6
        within = np.abs(step[1:, 0] * step[:-1, 1] - step[1:, 1] * step[:-1, 0]) < 1e-12  # no corner between
        rate = np.abs(np.diff(speed)) / ((dt[1:] + dt[:-1]) / 2)
        assert rate[within].max(initial=0.0) <= a + 1e-6
        assert speed[0] <= a * dt[0] / 2 + 1e-6 and speed[-1] <= a * dt[-1] / 2 + 1e-6
        jump = np.hypot(*np.diff(step / dt[:, None], axis=0).T)[~within]
        ramps = (a * (dt[1:] + dt[:-1]) / 2)[~within]
        assert (jump <= a * corner + ramps + 1e-6).all()


def test_without_inertia_every_leg_is_driven_at_full_speed() -> None:
    """An infinite acceleration leaves nothing but length over speed."""
    path = speed_profile([(0, 0), (3, 4), (3, 5)], 0.5, math.inf)
    assert path.t.tolist() == [0.0, 10.0, 12.0]


def test_the_swept_test_is_what_dense_sampling_says() -> None:
    """A profile is clear of walls and moving discs where samples, at a tenth of a cell and denser, say so."""
    rng = np.random.default_rng(1)
    clear = 0
    for _ in range(cases(200, 5000)):
        grid = Grid(rng.random((20, 20)) < 0.03, 0.25)
        path = speed_profile(rng.uniform(0.3, 4.7, (3, 2)), 1.0, 1.0, corner=0.1)
        speed, angle = rng.uniform(0, 1, 3), rng.uniform(-3, 3, 3)
        segments = np.column_stack(
            (np.zeros(3), np.full(3, 99.0), rng.uniform(0, 5, (3, 2)), speed * np.cos(angle), speed * np.sin(angle),
             np.full(3, 0.5), np.full(3, 0.5))
        )  # fmt: skip
        t = np.arange(0.0, path.t[-1], 0.01)
        xy = np.column_stack([np.interp(t, path.t, path.xy[:, k]) for k in (0, 1)])
        p, least = grid.to_points(xy), min(float(xy.min()), float((5.0 - xy).min()))
        for r, c in np.argwhere(grid.blocked):
            gap = np.hypot(np.maximum(np.abs(p[:, 0] - r) - 0.5, 0), np.maximum(np.abs(p[:, 1] - c) - 0.5, 0)) * 0.25
            least = min(least, float(gap.min()))
        least = min(least - 0.25, naive.closest(np.column_stack((path.t, path.xy)), segments))
        if abs(least) > 0.01:
            assert is_clear(path, grid, 0.25, segments) == (least > 0)
            clear += least > 0
    assert clear > 0


@pytest.mark.parametrize(
    "wrong",
    [{"points": [(0, 0)]}, {"points": [(0, 0), (0, 0)]}, {"points": [(0, math.nan), (1, 1)]}, {"v_max": 0.0}, {"a_max": -1.0},
     {"dt": 0.0}, {"corner": -1.0}],
)  # fmt: skip
def test_wrong_input_raises(wrong: dict) -> None:
    """Numbers out of range and paths without length raise `BadParameter`."""
    with pytest.raises(BadParameter):
        speed_profile(**({"points": [(0, 0), (1, 1)], "v_max": 1.0, "a_max": 1.0} | wrong))


def test_a_profile_is_a_timed_path() -> None:
    """What comes out is a `TimedPath`, read-only."""
    path = speed_profile([(0, 0), (1, 1)], 1.0, 1.0)
    assert isinstance(path, TimedPath) and not path.xy.flags.writeable
