"""The sensor: what it sees, when, and how well."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import BadParameter, Grid, RobotSpec, Scenario, Task, World
from antway.world.motions import Line
from antway.world.sensor import Scanner, Sensor
from antway.world.timeline import Timeline
from antway.world.world import Obstacle
from common import cases
from naive.world import visible


def scanner(sensor: Sensor, timeline: Timeline, grid: Grid | None = None, reach: float = 4.0, seed: int = 0) -> Scanner:
    grid = grid or Grid(np.zeros((20, 20), dtype=bool))
    task = Task(grid, RobotSpec(sensor_range=reach), (1.0, 1.0), (2.0, 2.0))
    return Scanner(sensor, task, timeline, seed)


def still(places: list[tuple[float, float]], radius: float = 0.3) -> Timeline:
    return Timeline.of(range(10, 10 + len(places)), [radius] * len(places), [([0.0], [p]) for p in places])


def moving(speed: float = 0.5) -> Timeline:
    return Timeline.of([4], [0.3], [([0.0, 40.0], [(2.0, 5.0), (2.0 + 40 * speed, 5.0)])])


def test_range_and_occlusion() -> None:
    """Seen is exactly what is in range and has its near side or a flank in sight; compared with sampled rays."""
    rng = np.random.default_rng(5)
    pairs = differ = 0
    for _ in range(cases(60, 2000)):
        grid = Grid(rng.random((12, 12)) < 0.15)
        eye, places = rng.uniform(1, 11, 2), rng.uniform(1, 11, (6, 2))
        if not grid.is_free(grid.cell_at(eye)):
            continue
        radius = 0.3
        _, tracks, _ = scanner(Sensor(), still([tuple(p) for p in places], radius), grid).observe(0.0, *eye)
        for k, place in enumerate(places):
            away = place - eye
            distance = np.hypot(*away)
            u = away / distance
            marks = [place - radius * u, place + radius * np.array([-u[1], u[0]]), place - radius * np.array([-u[1], u[0]])]
            points = grid.to_points([eye, *marks])
            seen = distance - radius <= 4.0 and any(visible(grid.blocked, points[0], p) for p in points[1:])
            pairs, differ = pairs + 1, differ + (distance > radius and seen != (10 + k in tracks.id))
    assert pairs > 200 and differ <= pairs / 200  # a ray that grazes a corner may fall between samples


def test_exact_sensor_gives_place_and_velocity() -> None:
    """Without noise the tracks are the truth, from one cycle to the next under the same id."""
    eyes = scanner(Sensor(), moving())
    for t in (0.0, 0.1, 3.3):
        stamp, tracks, seen = eyes.observe(t, 3.0, 4.0)
        assert stamp == t and tracks.id.tolist() == [4] and seen.tolist() == [0] and tracks.covariance is None
        np.testing.assert_allclose(tracks.xy[0], (2.0 + 0.5 * t, 5.0), atol=1e-12)
        np.testing.assert_allclose(tracks.velocity[0], (0.5, 0.0), atol=1e-12)


def test_rate_and_latency() -> None:
    """A slow, late sensor shows the scan of its last period, once its latency has passed, with its stamp."""
    eyes = scanner(Sensor(period=0.5, latency=0.2), moving())
    stamps = [eyes.observe(t, 3.0, 4.0)[0] for t in np.arange(12) * 0.1]
    assert stamps[:2] == [-math.inf, -math.inf]
    np.testing.assert_allclose(stamps[2:], [0.0] * 5 + [0.5] * 5, atol=1e-9)
    uneven = scanner(Sensor(period=0.25), moving())  # a scan is not late because the one before was
    stamps = [uneven.observe(t, 3.0, 4.0)[0] for t in np.arange(9) * 0.1]
    np.testing.assert_allclose(stamps, [0.0, 0.0, 0.0, 0.3, 0.3, 0.5, 0.5, 0.5, 0.8], atol=1e-9)
    late = scanner(Sensor(latency=0.2), moving())  # scans in each cycle
    assert [late.observe(0.1 * k, 3.0, 4.0)[0] for k in range(4)] == pytest.approx([-math.inf, -math.inf, 0.0, 0.1])


def test_noise_and_losses_have_their_size_and_repeat() -> None:
    """Noise has the stated deviation, losses the stated share, and both repeat with the seed."""
    sensor = Sensor(noise=0.05, velocity_noise=0.1, dropout=0.3)
    runs = [scanner(sensor, moving(0.0 + 1e-9), seed=s) for s in (1, 1, 2)]
    seen = [[eyes.observe(0.1 * i, 2.0, 4.0)[1] for i in range(2000)] for eyes in runs]
    assert all(a.xy.tobytes() == b.xy.tobytes() for a, b in zip(seen[0], seen[1]))
    assert any(a.xy.tobytes() != b.xy.tobytes() for a, b in zip(seen[0], seen[2]))
    xy = np.vstack([s.xy for s in seen[0]])
    velocity = np.vstack([s.velocity for s in seen[0]])
    assert abs(len(xy) / 2000 - 0.7) < 0.04
    np.testing.assert_allclose(xy.std(axis=0), 0.05, rtol=0.1)
    np.testing.assert_allclose(velocity.std(axis=0), 0.1, rtol=0.1)
    covariance = next(s.covariance for s in seen[0] if len(s))
    assert covariance is not None and covariance.shape == (1, 4, 4) and covariance[0, 0, 0] == pytest.approx(0.05**2)


@pytest.mark.parametrize("velocity", ["exact", "estimated"])
def test_what_is_measured_of_a_disc_does_not_depend_on_others(velocity: str) -> None:
    """Each has its own noise and losses, filter and covariance, whichever others are seen; its row goes with its number."""
    sensor = Sensor(noise=0.02, velocity_noise=0.02, dropout=0.4, velocity=velocity)
    walks = [((3.0, 4.0), (0.5, 0.0)), ((4.0, 6.0), (0.0, -0.5)), ((2.0, 2.0), (-0.2, 0.3))]
    lines = [([0.0, 9.0], [xy, np.add(xy, np.multiply(v, 9.0))]) for xy, v in walks]
    far = ([0.0], [(500.0, 0.0)])
    both = [scanner(sensor, Timeline.of([7, 8, 9], [0.3] * 3, [first, *lines[1:]]), reach=20.0) for first in (lines[0], far)]
    errors, lost = [], 0
    for t in np.arange(60) * 0.1:
        one, two = (eyes.observe(t, 3.0, 4.0)[1] for eyes in both)
        others = one.id != 7
        assert one.id[others].tolist() == two.id.tolist()
        for name in ("xy", "velocity", "covariance"):
            assert getattr(one, name)[others].tobytes() == getattr(two, name).tobytes()
        lost += 3 - len(one)
        for k, xy, v in zip(one.id - 7, one.xy, one.velocity):
            errors.append([t, k, *(xy - np.add(walks[k][0], np.multiply(walks[k][1], t))), *(v - walks[k][1])])
    late = np.array([row for row in errors if row[0] > 2.0])
    assert 40 < lost < 110 and 0.0 < np.abs(late[:, 2:4]).max() < 0.1 and np.abs(late[:, 4:]).max() < 0.4
    assert len(np.unique(late[:, 2:4])) == late[:, 2:4].size


def test_estimated_velocity_converges() -> None:
    """The Kalman filter's velocity comes close to the truth, and its covariance says how close."""
    eyes = scanner(Sensor(noise=0.02, velocity="estimated", agility=0.2), moving(0.5), reach=100.0)
    errors = []
    for i in range(200):
        _, tracks, _ = eyes.observe(0.1 * i, 3.0, 4.0)
        if i > 50:
            errors.append(tracks.velocity[0] - (0.5, 0.0))
    assert np.std(errors) < 0.1 and abs(np.mean(errors)) < 0.03
    assert tracks.covariance is not None and np.std(errors) < 3 * math.sqrt(tracks.covariance[0, 2, 2])
    assert np.isnan(scanner(Sensor(velocity="none"), moving()).observe(0.0, 3.0, 4.0)[1].velocity).all()
    first = scanner(Sensor(velocity="estimated"), moving()).observe(0.0, 3.0, 4.0)[1]
    assert first.velocity.tolist() == [[0.0, 0.0]] and first.covariance[0, 2, 2] == 4.0


def test_noise_is_that_of_its_seed_scan_and_disc() -> None:
    """Its numbers stay the same, so that episodes can be repeated."""
    eyes = scanner(Sensor(noise=1.0, velocity_noise=1.0), still([(3.0, 4.0)]), seed=7)
    found = [np.hstack((seen.xy[0], seen.velocity[0])) for seen in (eyes.observe(t, 3.0, 4.0)[1] for t in (0.0, 0.1))]
    np.testing.assert_allclose(found[0], (3.11705761557378, 4.25878713145062, -3.21240436949245, -0.70142437319165), atol=1e-12)
    np.testing.assert_allclose(found[1], (3.89669268156604, 3.97319530126155, 1.43593788507839, 2.90435130188295), atol=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [
        {"noise": -1.0},
        {"dropout": 1.5},
        {"dropout": 1.1},
        {"velocity": "guess"},
        {"velocity_noise": -0.1},
        {"occlusion": 1},
        {"period": math.nan},
        {"period": 5e-7},
        {"agility": 0.0},
        {"agility": 1e200},  # places were NaN
    ],
)
def test_wrong_sensors_are_refused(wrong: dict) -> None:
    """Each wrong parameter raises an error that names it."""
    with pytest.raises(BadParameter, match=next(iter(wrong))):
        Sensor(**wrong)


def test_sensors_at_the_limits_are_sensors() -> None:
    """The least period and the greatest acceleration, with which estimates stay numbers."""
    assert Sensor(period=1e-6, dropout=1.0, agility=0.01).period == 1e-6
    eyes = scanner(Sensor(velocity="estimated", agility=1e9), moving())
    tracks = [eyes.observe(0.1 * k, 3.0, 4.0).tracks for k in range(5)][-1]
    assert tracks.xy[0] == pytest.approx((2.2, 5.0)) and np.isfinite(tracks.covariance).all()


@pytest.mark.parametrize("period", [0.5, 1.0, 1.2, 3.0])
def test_velocities_are_estimated_by_slow_sensors_too(period: float) -> None:
    """A filter goes on from one scan to the next, however far apart they are."""
    walker = Obstacle(0.3, Line((2.0, 4.0), (18.0, 4.0), 1.0))
    grid = Grid(np.zeros((40, 100), dtype=bool), 0.2)
    sensor = Sensor(period=period, velocity="estimated")
    hall = Scenario(World(grid, (walker,)), (1.0, 1.0), (19.0, 7.0), RobotSpec(sensor_range=30.0), sensor)
    scanner = Scanner(sensor, hall.task, hall.world.timeline(0, 30.0), 0)
    for k in range(121):
        scan = scanner.observe(0.1 * k, 1.0, 1.0)
    assert scan.tracks.velocity[0].tolist() == pytest.approx([1.0, 0.0], abs=0.01)
