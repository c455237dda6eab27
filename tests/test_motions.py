"""Motions: courses are exact, keep their speed, and depend on seed and obstacle alone."""

from __future__ import annotations

import itertools
import math
from itertools import pairwise

import numpy as np
import pytest

from antway import BadParameter, BadScenario, Grid, World
from antway.kernels.base.rng import make_state
from antway.kernels.robot.motions import bounce
from antway.world.motions import BackAndForth, Bounce, Draw, Line, Pursue, RandomWalk, Replay, Waypoints
from antway.world.timeline import Timeline
from antway.world.world import Obstacle
from common import cases
from naive.world import wall_distance

ROOM = Grid(np.zeros((20, 30), dtype=bool), 0.5)


def trajectory(motion, seed: int = 0, horizon: float = 60.0, grid: Grid = ROOM, radius: float = 0.3):
    return World(grid, [Obstacle(radius, motion)]).timeline(seed, horizon)


def test_scripted_motions_are_where_arithmetic_says() -> None:
    """Line, back-and-forth, waypoints and replay are at hand-computed places."""
    line = trajectory(Line((1, 1), (5, 4), speed=1.0, delay=2.0))
    assert [line.at(t)[0][0].tolist() for t in (0, 2, 4.5, 7, 99)] == [[1, 1], [1, 1], [3, 2.5], [5, 4], [5, 4]]
    shuttle = trajectory(BackAndForth((2, 3), (6, 3), speed=2.0, phase=0.25))
    np.testing.assert_allclose([shuttle.at(t)[0][0, 0] for t in (0, 1, 2, 3, 4, 40)], [4, 6, 4, 2, 4, 4], atol=1e-9)
    loop = trajectory(Waypoints(((1, 1), (3, 1), (3, 2)), speed=1.0, pause=1.0))
    np.testing.assert_allclose(
        [loop.at(t)[0][0].tolist() for t in (1, 2, 2.9, 3.5, 4.5)], [[2, 1], [3, 1], [3, 1], [3, 1.5], [3, 2]]
    )
    late = trajectory(Waypoints(((1, 1), (5, 1)), speed=1.0, pause=6.0, phase=0.25))  # a quarter of a round of 20 s, not of 8 m
    np.testing.assert_allclose([late.at(t)[0][0, 0] for t in (0, 4, 5, 6)], [5, 5, 5, 4])
    once = trajectory(Waypoints(((1, 1), (3, 1)), speed=1.0, loop=False))
    assert once.at(50)[0][0].tolist() == [3, 1] and once.at(1)[1][0].tolist() == [1, 0]
    track = trajectory(Replay((1.0, 2.0), ((1, 1), (2, 1))))
    assert [track.at(t)[0][0, 0] for t in (0, 1.5, 9)] == [1, 1.5, 2]


def test_a_disc_that_fills_its_gap_is_refused_with_the_reason() -> None:
    """It would bounce at every moment; the error said only that its path has too many knots."""
    with pytest.raises(BadScenario, match="walls farther apart than the disc, 10 m"):
        trajectory(Bounce((5.0, 5.0), 0.3), radius=5.0)


def test_bouncing_discs_keep_clear_of_walls_and_keep_their_speed() -> None:
    """Every point of every course is at least the radius from walls and edges; every leg has the speed; none overlaps."""
    rng = np.random.default_rng(3)
    done = 0
    for case in range(cases(40, 1000)):
        grid = Grid(rng.random((10, 12)) < 0.15, 0.5)
        radius = rng.uniform(0.1, 0.45)
        start = rng.uniform(0, 5, 2)
        row, col = grid.to_points(start)[0]
        if wall_distance(grid.blocked, row, col) * 0.5 < radius:
            continue
        done += 1
        motion = Bounce(tuple(start), (0.3, 2.0)) if case % 2 else RandomWalk(tuple(start), (0.3, 2.0), turn_every=1.7)
        line = trajectory(motion, seed=case, horizon=20.0, grid=grid, radius=radius)
        speeds = np.hypot(*np.diff(line.knot_xy, axis=0).T) / np.diff(line.knot_t)
        moving = speeds > 1e-6
        np.testing.assert_allclose(speeds[moving], speeds[moving][0], rtol=1e-4)
        for t in np.linspace(0, 20, 60):
            row, col = grid.to_points(line.at(t)[0])[0]
            assert wall_distance(grid.blocked, row, col) * 0.5 >= radius - 1e-6
        assert line.knot_t[-1] == pytest.approx(20.0)
    assert done > 10


def test_a_bounce_is_a_mirror() -> None:
    """A disc that runs at an edge at 45 degrees leaves it mirrored at the distance of its radius."""
    line = trajectory(Bounce((5.0, 1.3), speed=math.sqrt(2.0), heading=-math.pi / 4))
    np.testing.assert_allclose(line.at(1.0)[0][0], [6.0, 0.3], atol=1e-8)
    np.testing.assert_allclose(line.at(2.0)[0][0], [7.0, 1.3], atol=1e-8)


def test_a_random_walk_turns_at_its_times_in_every_direction() -> None:
    t, xy = trajectory(RandomWalk((7.5, 5.0), speed=0.05, turn_every=1.7), horizon=60.0).trajectory(0)
    np.testing.assert_allclose(t[:-1], 1.7 * np.arange(len(t) - 1), atol=1e-9)
    turned = np.diff(xy, axis=0)[1:]
    assert len(np.unique(turned > 0.0, axis=0)) == 4 and np.ptp(np.arctan2(*turned.T)) > 5.0


def test_a_long_random_walk_begins_as_a_short_one() -> None:
    """It is drawn again from its start where the memory for its knots was too small."""
    short, long = (trajectory(RandomWalk((5.0, 5.0), 0.5, turn_every=0.1), seed=2, horizon=end) for end in (10.0, 60.0))
    assert len(short.knot_t) < 256 < len(long.knot_t)
    assert long.knot_xy[: len(short.knot_t) - 1].tolist() == short.knot_xy[:-1].tolist()


def test_a_disc_that_is_wedged_waits_for_its_next_turn() -> None:
    """Pushed between the corners of two cells it would be reflected for ever; in another direction it may leave."""
    blocked = np.zeros((20, 21), np.bool_)
    blocked[5, [9, 11]] = True  # their corners are half a cell from the middle between them
    row, radius, t, rc = (
        5.5 + 0.5 * math.tan(math.radians(5.0)),
        0.5 / math.cos(math.radians(5.0)),
        np.empty(99),
        np.empty((99, 2)),
    )
    n = bounce(blocked, row, 10.0, 1.0, -math.pi / 2, radius + 1e-8, 2.0, 9.0, make_state(0, 0), t, rc)
    assert (t[0], t[1]) == (0.0, 2.0) and math.dist(rc[1], (row, 10.0)) == 0.0
    assert t[n - 1] == 9.0 and np.hypot(*(rc[:n] - (row, 10.0)).T).max() > 1.0


def test_chance_depends_on_seed_and_obstacle_alone() -> None:
    """The same obstacle at the same index gets the same course whatever else there is; other seeds differ."""
    walk, other = Obstacle(0.3, RandomWalk((5, 5), (0.2, 1.0))), Obstacle(0.2, Line((1, 1), (2, 2), (0.1, 1.0)))
    alone, both = World(ROOM, [walk]).timeline(7, 30.0), World(ROOM, [walk, other]).timeline(7, 30.0)
    assert alone.trajectory(0)[1].tobytes() == both.trajectory(0)[1].tobytes()
    assert alone.trajectory(0)[1].tobytes() != World(ROOM, [walk]).timeline(8, 30.0).trajectory(0)[1].tobytes()
    draws = [Draw(1, k).of((0.0, 1.0)) for k in range(1000)]
    assert 0.45 < np.mean(draws) < 0.55 and max(draws) < 1.0 <= 2 * max(draws)


@pytest.mark.parametrize(
    ("make", "field"),
    [
        (lambda: Line((0, 0), (1, math.nan), 1.0), r"end\[1\]"),
        (lambda: Line((0, 0), (1, 1), -1.0), "speed"),
        (lambda: BackAndForth((0, 0), (1, 1), (0.5, 0.2)), "speed"),
        (lambda: BackAndForth((0, 0), (1, 1), 1.0, phase=1.5), "phase"),
        (lambda: Waypoints((), 1.0), "points"),
        (lambda: Waypoints(((0, 0),), 1.0, loop=1), "loop"),  # type: ignore[arg-type]
        (lambda: RandomWalk((0, 0), 1.0, turn_every=0.0), "turn_every"),
        (lambda: Replay((1.0, 1.0), ((0, 0), (1, 1))), "t = 1.0"),
        (lambda: Replay((1.0,), ((0, 0), (1, 1))), "t.shape"),
        (lambda: Line((0, -1.1e10), (1, 1), 1.0), r"start\[1\]"),
        (lambda: Line((0, 0), (1.1e10, 1), 1.0), r"end\[0\]"),
        (lambda: Line((0, 0), (1, 1), 1001.0), r"speed.*m/s"),
        (lambda: Line((0, 0), (1, 1), 0.9e-9), "speed .* 0, or at least 1e-09"),
        (lambda: Line((0, 0), (1, 1), (-0.1, 1.0)), r"speed\[0\]"),
        (lambda: Line((0, 0), (1, 1), (0.0, 1e-10)), r"speed\[1\]"),
        (lambda: Line((0, 0), (1, 1), (0.1, 0.2, 0.3)), "speed"),
        (lambda: Line((0, 0), (1, 1), 1.0, -1.0), "delay"),
        (lambda: Line((0, 0), (1, 1), 1.0, 1.1e9), "delay"),
        (lambda: BackAndForth((math.nan, 0), (1, 1), 1.0), r"start\[0\]"),
        (lambda: BackAndForth((0, 0), (1, math.inf), 1.0), r"end\[1\]"),
        (lambda: Waypoints(((0, 0), (0, -1.1e10)), 1.0), "points = -1"),
        (lambda: Waypoints(((0, 0), (1.1e10, 0)), 1.0), "points = 1"),
        (lambda: Waypoints(((0, 0),) * 100_001, 1.0), "points.length = 100001"),
        (lambda: Waypoints(np.empty((0, 2)), 1.0), "points.length = 0"),  # type: ignore[arg-type]
        (lambda: Waypoints(((0, 0),), -1.0), "speed"),
        (lambda: Waypoints(((0, 0),), 1.0, pause=-1.0), "pause"),
        (lambda: Waypoints(((0, 0),), 1.0, phase=1.1), "phase"),
        (lambda: Bounce((0, math.nan), 1.0), r"start\[1\]"),
        (lambda: Bounce((0, 0), -1.0), "speed"),
        (lambda: Bounce((0, 0), 1.0, math.inf), "heading"),
        (lambda: Bounce((0, 0), 1.0, 1.1e6), "heading"),
        (lambda: RandomWalk((0, math.nan), 1.0), r"start\[1\]"),
        (lambda: RandomWalk((0, 0), -1.0), "speed"),
        (lambda: RandomWalk((0, 0), 1.0, turn_every=0.9e-3), "turn_every"),
        (lambda: RandomWalk((0, 0), 1.0, heading=math.nan), "heading"),
        (lambda: Replay((0.0, 1.1e9), ((0, 0), (1, 1))), r"t = 1100000000.0.*\(s\)"),
        (lambda: Replay((-1.1e9, 0.0), ((0, 0), (1, 1))), r"t = -1100000000.0.*\(s\)"),
        (lambda: Replay((0.0, 1.0), ((0, 0), (1001, 0))), "points = 1001.0.*m/s between two of them"),
        (lambda: Replay((0.0, 5e-324), ((0, 0), (1, 0))), "points = inf"),
        (lambda: Replay((0.0,), ((0, 0),), 1.1e9), "record_start"),
        (lambda: Replay((0.0,), ((0, 0),), -1.1e9), "record_start"),
        (lambda: Pursue((0, math.nan), 1.0), r"start\[1\]"),
        (lambda: Pursue((0, 0), -1.0), "speed"),
        (lambda: Pursue((0, 0), 1.0, gap=-0.1), "gap"),
        (lambda: Pursue((0, 0), 1.0, delay=-0.1), "delay"),
        (lambda: Pursue((0, 0), 1.0, follow_time=-0.1), "follow_time"),
    ],
)
def test_wrong_motions_are_refused(make, field: str) -> None:
    """Each wrong parameter raises an error that names it."""
    with pytest.raises(BadParameter, match=field):
        make()


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"id": [7, 7]}, "timeline.id"),
        ({"id": [7]}, "timeline.radius.shape"),
        ({"radius": [0.3, 0.0]}, "timeline.radius"),
        ({"radius": [math.nan, 0.3]}, "timeline.radius"),
        ({"radius": [0.3, math.inf]}, "timeline.radius"),
        ({"knot_xy": [(0, 0), (1, 0)]}, "timeline.knot_xy.shape"),
        ({"knot_xy": [(0, 0), (1, 0), (5, math.inf)]}, "timeline.knot_xy"),
        ({"knot_t": [0.0, 1.0, math.nan]}, "timeline.knot_t"),
        ({"knot_t": [0.0, 0.0, 0.0]}, "timeline.knot_t"),
        ({"first": [0, 3]}, "timeline.first.shape"),
        ({"first": [1, 2, 3]}, "timeline.first"),
        ({"first": [0, 1, 2]}, "timeline.first"),
        ({"first": [0, 3, 3]}, "timeline.first"),
    ],
)
def test_a_timeline_whose_parts_do_not_fit_is_refused(change, field: str) -> None:
    """Two discs, of which the second has one knot; the error names the array. What is sound is read-only."""
    parts = {"id": [7, 9], "radius": [0.3, 0.4], "knot_t": [0, 1, 0], "knot_xy": [(0, 0), (1, 0), (5, 5)], "first": [0, 2, 3]}
    line = Timeline(**parts)  # type: ignore[arg-type]
    assert line.at(0.5)[0].tolist() == [[0.5, 0.0], [5.0, 5.0]] and line.knot_t.dtype == np.float64
    assert not any(getattr(line, name).flags.writeable for name in parts)
    with pytest.raises(BadScenario) as wrong:
        Timeline(**(parts | change))  # type: ignore[arg-type]
    assert wrong.value.field == field


def test_numbers_at_the_limits_are_motions() -> None:
    """The least and the greatest number of each kind, and a span of one number."""
    Line((-1e10, 0), (1e10, 0), 1000.0, (1e9, 1e9))
    Waypoints(((-1e10, 0), (1e10, 0)), 1e-9, phase=(0.0, 1.0))
    Waypoints(((0, 0),) * 100_000, 0.0)
    RandomWalk((0, 0), 1.0, 1e-3, -1e6)
    Replay((-1e9, 1e9), ((0, 0), (1, 0)), 1e9)
    Replay((0.0, 1.0), ((0, 0), (1000, 0)), -1e9)


def test_waypoints_are_where_a_walk_along_them_leads() -> None:
    """Rounds of places, some of them the same, with pauses, from any phase on; or once."""
    rng = np.random.default_rng(9)
    for _ in range(cases(60, 600)):
        points = rng.integers(0, 4, (rng.integers(1, 6), 2)).astype(float)
        speed, pause = float(rng.choice([0.1, 1 / 3, 1.0])), float(rng.choice([0.0, 1 / 3]))
        phase, loop = float(rng.choice([0.0, 0.25, 1.0, rng.random()])), bool(rng.integers(0, 2))
        motion = Waypoints(tuple(map(tuple, points.tolist())), speed, loop, pause, phase)
        line = trajectory(motion, horizon=50.0)
        round_trip = [*points, points[0]] if loop else list(points)
        legs = [(a, b, math.dist(a, b) / speed) for a, b in pairwise(round_trip)]
        period = sum(time + pause for *_, time in legs)
        for t in rng.uniform(0.0, 50.0, 20).tolist():
            left, place = t, points[0]
            if any(time > 0.0 for *_, time in legs):
                left = (t + phase * period) % period if loop else t
                place = round_trip[-1]
                for a, b, time in legs:
                    if left < time + pause:
                        place = a + (b - a) * (min(left / time, 1.0) if time > 0.0 else 1.0)
                        break
                    left -= time + pause
            np.testing.assert_allclose(line.at(t)[0][0], place, atol=1e-6)


def test_too_many_knots_are_refused() -> None:
    """A course of absurd detail raises in place of taking memory."""
    with pytest.raises(BadScenario, match=r"obstacles\[0\]\.speed"):
        trajectory(BackAndForth((0, 0), (1e-3, 0), 1e3))
    with pytest.raises(BadScenario, match=r"obstacles\[0\]\.speed"):
        trajectory(Bounce((5, 5), 1e3), horizon=3000.0)


def test_a_line_that_rounding_alone_makes_stands() -> None:
    """Between ends of which one was computed, after a delay, there is no time to drive."""
    line = trajectory(Line((0.1 + 0.2, 2.0), (0.3, 2.0), 0.5, delay=2.0))
    assert line.knot_t.tolist() == [0.0] and line.knot_xy.tolist() == [[0.1 + 0.2, 2.0]]


def test_who_walks_at_no_speed_stands() -> None:
    """A speed of 0, which may be drawn, is not divided by."""
    for motion in (Waypoints(((1.0, 2.0), (3.0, 4.0)), 0.0), BackAndForth((1.0, 2.0), (3.0, 4.0), (0.0, 0.0), phase=0.5)):
        assert trajectory(motion).at(7.0)[0].tolist() == [[1.0, 2.0]]


def test_a_phase_that_ends_at_a_corner_but_for_rounding_starts_there() -> None:
    """No step of 1e-16 s comes first, whose velocity is noise."""
    for corners in range(2, 8):
        angle = 2.0 * math.pi * np.arange(corners) / corners
        points = tuple(zip((5.0 + np.cos(angle)).tolist(), (5.0 + np.sin(angle)).tolist()))
        for k, speed in itertools.product(range(corners + 1), np.linspace(0.3, 1.5, 40).tolist()):
            t, xy = Waypoints(points, speed, phase=k / corners).trajectory(Draw(0, 0), 20.0, ROOM, 0.3)
            np.testing.assert_allclose(np.hypot(*np.diff(xy, axis=0).T) / np.diff(t), speed, rtol=1e-6)


def test_what_is_not_given_is_as_the_guide_says() -> None:
    """Files of scenarios leave these out."""
    at = (1.0, 1.0)
    assert Line(at, at, 1.0) == Line(at, at, 1.0, delay=0.0)
    assert BackAndForth(at, at, 1.0) == BackAndForth(at, at, 1.0, phase=0.0)
    assert Waypoints((at,), 1.0) == Waypoints((at,), 1.0, loop=True, pause=0.0, phase=0.0)
    assert Bounce(at, 1.0) == Bounce(at, 1.0, heading=(-math.pi, math.pi))
    assert RandomWalk(at, 1.0) == RandomWalk(at, 1.0, turn_every=3.0, heading=(-math.pi, math.pi))
    assert Replay((0.0, 1.0), (at, at)) == Replay((0.0, 1.0), (at, at), record_start=0.0)
    assert Pursue(at, 1.0) == Pursue(at, 1.0, gap=0.3, delay=0.0, follow_time=20.0)
