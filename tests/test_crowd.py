"""Those who avoid one another: ORCA beside its definition and RVO2, and predictions of a crowd beside what it does."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway.kernels.base.records import Terrain
from antway.kernels.tracking import crowd, orca
from antway.kernels.tracking.predict import FAR_AHEAD, ID, STEP_TIME, TubeMargins, predict
from antway.kernels.tracking.table import make_table
from antway.world.timeline import Timeline
from common import all_seen, cases
from naive import crowd as naive


def lines_among(rng: np.random.Generator, n: int) -> np.ndarray:
    angle = rng.uniform(-math.pi, math.pi, n)
    return np.column_stack((rng.uniform(-1.0, 1.0, (n, 2)), np.cos(angle), np.sin(angle)))


def test_the_half_plane_is_what_sampling_finds() -> None:
    """The shift is half of the least change of velocity that ends, or just keeps out of, a contact within the horizon."""
    rng = np.random.default_rng(0)
    for _ in range(cases(10, 500)):
        angle, far = rng.uniform(-math.pi, math.pi), rng.uniform(0.65, 4.0)
        a, u = far * np.array([math.cos(angle), math.sin(angle)]), rng.uniform(-1.5, 1.5, 2)
        x, y, dx, dy = orca.half_plane(*a, *u, 0.6, 5.0, 0.25)
        assert math.hypot(dx, dy) == pytest.approx(1.0)
        assert abs(x * dx + y * dy) < 1e-9 or naive.meets(a, u, 0.6, 5.0)
        assert 2 * math.hypot(x, y) == pytest.approx(naive.least_change(a, u, 0.6, 5.0), abs=0.02)


def test_the_velocity_is_the_nearest_allowed_one() -> None:
    """It equals the best of all crossings of lines and circle and all feet of the wish; without any, none is less wrong."""
    rng = np.random.default_rng(1)
    out, work = np.empty(2), np.empty((8, 4))
    allowed = 0
    for _ in range(cases(400, 20000)):
        lines, request = lines_among(rng, int(rng.integers(1, 6))), rng.uniform(-1.5, 1.5, 2)
        n = len(lines)
        bad = orca.nearest(lines, n, 1.0, *request, False, out)
        best = naive.nearest(lines, 1.0, request)
        if best is not None:
            assert bad == n and math.dist(out, request) == pytest.approx(math.dist(best, request), abs=1e-6)
            allowed += 1
        elif bad < n:
            orca.least_violation(lines, n, bad, 1.0, out, work)
            assert math.hypot(*out) <= 1.0 + 1e-9
            assert naive.violation(lines, out) <= naive.least_violation(lines, 1.0) + 1e-6
    assert allowed > 50


def circle(seed: int) -> Timeline:
    """Five who walk across a circle of 4 m and avoid one another."""
    from antway.arena.suites import build, episodes

    scenario = build(episodes("crossing", seed + 1)[2 * seed])
    return scenario.world.timeline(0, 12.0)


def watched(line: Timeline, steps: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Places 2 s after each scan: as predicted (NaN: not), and on at the velocity seen."""
    table, paths, straight = make_table(8, crowd.COLUMNS, ID), [], []
    trajectory = np.full((8, crowd.STEPS, 2), np.nan)  # of who is not predicted the first number alone is written
    for i in range(steps):
        t = i * STEP_TIME + 1e-6
        xy, velocity = line.at(t - 1e-9)[0], line.at(t - 1e-3)[1]
        velocity = np.zeros_like(velocity) if i == 0 else velocity
        estimates = np.column_stack((xy, velocity, line.radius, np.zeros((len(xy), 2)), line.id))
        crowd.foresee(table, estimates, all_seen(estimates), t, 1.0, trajectory)
        paths.append(xy + trajectory[: len(estimates), :8].sum(axis=1) * STEP_TIME)
        straight.append(xy + velocity * 2.0)
    return paths, straight


def test_a_crowd_is_predicted_better_than_straight_on() -> None:
    """Of people steered by RVO2 the places in 2 s are known to a third of the error of constant velocity."""
    pytest.importorskip("pyrvo")
    learnt, straight = [], []
    for seed in range(cases(4, 100)):
        line = circle(seed)
        paths, on = watched(line, 20)
        for i in range(2, 20):
            if np.isfinite(paths[i]).all():
                then = line.at(i * STEP_TIME + 2.0)[0]
                learnt.append(np.hypot(*(paths[i] - then).T).mean())
                straight.append(np.hypot(*(on[i] - then).T).mean())
    assert len(learnt) > 12 * cases(4, 100)
    assert np.mean(learnt) < np.mean(straight) / 3


def test_discs_that_never_yield_are_not_taken_for_people() -> None:
    """Of discs that go straight on through one another no course is predicted, nor of those who turn at random."""
    rng = np.random.default_rng(2)
    for turns in (False, True):
        heading = rng.uniform(-math.pi, math.pi, 8)
        xy, trajectory, followed = rng.uniform(0.0, 4.0, (8, 2)), np.empty((8, crowd.STEPS, 2)), 0
        table = make_table(8, crowd.COLUMNS, ID)
        for i in range(100):
            if turns and i % 10 == 5:
                heading[rng.integers(8)] = rng.uniform(-math.pi, math.pi)
            velocity = 0.6 * np.column_stack((np.cos(heading), np.sin(heading)))
            estimates = np.column_stack((xy, velocity, np.full(8, 0.3), np.zeros((8, 2)), np.arange(8)))
            crowd.foresee(table, estimates, all_seen(estimates), i * 0.1, 0.9, trajectory)
            followed += bool(np.isfinite(trajectory[: len(estimates), 0, 0]).any())
            xy = xy + velocity * 0.1
        assert followed <= (2 if turns else 0)


def test_courses_are_straightened_by_no_more_than_a_centimetre() -> None:
    """Many steps of a bent course become few uniform stretches; at their ends all is as it was, between by 1 cm at most."""
    rng = np.random.default_rng(3)
    for _ in range(cases(50, 2000)):
        angle = np.cumsum(rng.normal(0.0, rng.choice([0.0, 0.02, 0.2]), crowd.STEPS))
        trajectory = np.column_stack((np.cos(angle), np.sin(angle)))
        straight, first = trajectory.copy(), int(rng.integers(0, 10))
        crowd.straighten(straight, first, crowd.STEPS)
        off = np.hypot(*np.cumsum((straight - trajectory) * STEP_TIME, axis=0).T)
        changes = np.flatnonzero((np.diff(straight, axis=0) != 0.0).any(axis=1))
        assert off.max() <= 0.01 + 1e-12 and off[[*changes, -1]].max() < 1e-12
        assert (straight[:first] == trajectory[:first]).all() and len(changes) < crowd.STEPS - 1
        assert len(changes) <= first + (1 if (trajectory == trajectory[0]).all() else crowd.STEPS)


def test_lines_of_all_are_those_of_each() -> None:
    """What binds two people of one another, worked out once, is to the bit what each would work out alone."""
    rng = np.random.default_rng(4)
    for _ in range(cases(50, 2000)):
        n = int(rng.integers(1, 12))
        rows = np.zeros((n, crowd.COLUMNS))
        rows[:, :2], rows[:, 2:4], rows[:, 4] = rng.uniform(-4.0, 4.0, (n, 2)), rng.uniform(-1.0, 1.0, (n, 2)), 0.3
        every, many = np.empty((n, n, 4)), np.empty(n, np.int64)
        crowd._lines(rows, STEP_TIME, every, many)
        for k in range(n):
            alone = []
            for away in np.delete(rows, k, 0)[:, :4] - rows[k, :4]:
                if math.hypot(*away[:2]) <= 10.0:
                    x, y, dx, dy = orca.half_plane(*away[:2], *-away[2:4], 0.3 + 0.3 + 2 * 0.01, 5.0, STEP_TIME)
                    alone.append([rows[k, 2] + x, rows[k, 3] + y, dx, dy])
            assert many[k] == len(alone) and every[k, : many[k]].tolist() == alone


@pytest.mark.parametrize("speed", [1.0, 0.0])
def test_courses_are_followed_with_less_room_later_on(speed: float) -> None:
    """Pieces lead along the course; what the guard asks for is spared in part once the first seconds are over, to who moves."""
    angle = np.linspace(0.0, 3.0, crowd.STEPS)
    trajectory = speed * np.column_stack((np.cos(angle), np.sin(angle)))[None]
    paths = np.vstack(([0.0, 0.0], np.cumsum(trajectory[0] * STEP_TIME, axis=0)))
    estimates, out = np.array([[0.0, 0.0, speed, 0.0, 0.3, 0.0, 0.0, 1.0]]), np.empty((100, 8))
    terrain, stopping_time = Terrain(np.zeros((60, 60), np.bool_), np.zeros((8, 8), np.bool_), -30.0, -30.0, 1.0), 0.25
    margins = TubeMargins(0.3, 0.01, 0.0, 1.0, math.inf, stopping_time)
    n = predict(estimates, 5.0, 0.0, 6.0, 20.0, 0.0, margins, terrain, trajectory, out)
    assert out[0, 0] == 5.0 - stopping_time and out[n - 1, 1] == pytest.approx(11.0)
    for start, end, x, y, vx, vy, stand, drive in out[:n]:
        if start >= 5.0 - 1e-9:
            i = round((start - 5.0) / STEP_TIME)
            assert (x, y) == pytest.approx(tuple(paths[i]), abs=1e-9)
            assert end - start == pytest.approx(
                STEP_TIME if speed else FAR_AHEAD if start < 5.0 + FAR_AHEAD else 6.0 - FAR_AHEAD
            )
            assert (vx, vy) == pytest.approx(tuple(trajectory[0, i]))
        assert stand == pytest.approx(0.61)
        assert drive == pytest.approx(0.86 if speed == 0.0 or start < 5.0 + FAR_AHEAD - 1e-9 else 0.76)


@pytest.mark.parametrize("age", [0.05, 0.3])
def test_courses_have_less_room_later_on_however_old_the_estimates_are(age: float) -> None:
    """Of an obstacle that goes straight on, too: a whole piece of its course used to keep the room of the first seconds."""
    trajectory, pieces = np.tile((0.9, 0.0), (1, crowd.STEPS, 1)), []
    estimates = np.array([[0.0, 0.0, 0.9, 0.0, 0.3, 0.0, 0.0, 1.0]])
    terrain = Terrain(np.zeros((60, 60), np.bool_), np.zeros((8, 8), np.bool_), -30.0, -30.0, 1.0)
    for late in (0.0, age):
        out = np.empty((100, 8))
        margins = TubeMargins(0.3, 0.01, 0.0, 1.0, math.inf, 0.25)
        n = predict(estimates, 5.0 + late, late, 9.0 - late, 20.0, 0.0, margins, terrain, trajectory, out)
        pieces.append(out[:n])
    assert pieces[1] == pytest.approx(pieces[0], abs=1e-9)
    assert set(pieces[0][:, 7].round(3)) == {0.86, 0.76}
