"""Metrics of episodes and of policies: by hand on small traces, and against known intervals."""

from __future__ import annotations

import math
import tracemalloc
from types import SimpleNamespace

import numpy as np
import pytest

from antway import Grid, RobotSpec, Scenario, World, run
from antway.arena import metrics
from antway.errors import BadParameter
from antway.world.motions import Line
from antway.world.policy import Command, Decision
from antway.world.robots import body_gap
from antway.world.world import Obstacle


class Scripted:
    """Drives the velocities it is given, then stands."""

    def __init__(self, velocities):
        self.velocities = list(velocities)

    def reset(self, task, seed):
        self.left = list(self.velocities)

    def act(self, observation):
        return Command(self.left.pop(0) if self.left else (0.0, 0.0))

    def explain(self):
        return Decision("follow", "as written")


def trace_of(velocities, obstacles=(), horizon=1.0):
    room = World(Grid(np.zeros((20, 20), np.bool_)), tuple(obstacles))
    scenario = Scenario(room, (5.0, 5.0), (18.0, 18.0), RobotSpec(radius=0.5, v_max=2.0, dt=0.1), horizon=horizon)
    return run(scenario, Scripted(velocities)).trace


def test_discomfort():
    """Time under 0.2 m is the sum of the control steps that ended there."""
    # the disc's edge is 0.45 m away and the robot comes nearer by 0.1 m a step: after 3, 4 and 5 steps it is within 0.2 m
    trace = trace_of([(1.0, 0.0)] * 3 + [(0.0, 0.0)] * 2, [Obstacle(0.5, Line((6.45, 5.0), (6.45, 5.0), 0.0))], horizon=0.5)
    assert metrics.discomfort(trace) == pytest.approx(0.3)
    assert metrics.gaps(trace)[:, 0] == pytest.approx([0.45, 0.35, 0.25, 0.15, 0.15, 0.15])
    assert metrics.discomfort(trace_of([(1.0, 0.0)])) == 0.0
    far = Obstacle(0.5, Line((1.0, 9.0), (1.0, 9.0), 0.0))
    near = Obstacle(0.5, Line((6.15, 5.0), (6.15, 5.0), 0.0))  # 0.15 m away; what counts are the ends of steps
    for discs in ((far, near), (near, far)):
        assert metrics.discomfort(trace_of([(-1.0, 0.0)] * 3, discs, horizon=0.3)) == 0.0
        assert metrics.discomfort(trace_of([], discs, horizon=0.3)) == pytest.approx(0.3)


def test_jerk():
    """A constant velocity has no jerk; one step from rest to v has the second difference v at two steps."""
    assert metrics.jerk(trace_of([(1.0, 0.0)] * 10)) == pytest.approx(0.0, abs=1e-9)
    trace = trace_of([(0.0, 0.0)] * 4 + [(1.0, 0.0)] * 6)
    v = trace.velocity[1:-1]
    assert metrics.jerk(trace) == pytest.approx(math.sqrt(2 / (len(v) - 2)) / 0.01)
    for velocities, expected in (
        ([(0.6, 0.8)] * 4 + [(1.0, 0.0)], 0.0),  # the last step does not count
        ([(0.0, 0.0), (0.0, 0.0), (0.0, 0.5), (0.0, 0.0)], 50.0),  # m/s^3; nor does the first row, before any step
        ([(0.0, 0.0), (0.5, 0.0), (0.0, 0.0)], 0.0),  # two whole steps have no second difference
    ):
        assert metrics.jerk(trace_of(velocities, horizon=len(velocities) / 10)) == pytest.approx(expected, abs=1e-9)


def test_side_changes():
    """Each change of the side on which the robot is about to pass counts once; a steady side counts nothing."""
    disc = Obstacle(0.2, Line((7.5, 5.0), (7.5, 5.0), 0.0))
    left, right = (1.0, 0.4), (1.0, -0.4)
    assert metrics.side_changes(trace_of([left] * 10, [disc])) == 0
    assert metrics.side_changes(trace_of([left] * 3 + [right] * 3 + [left] * 3, [disc])) == 2
    assert metrics.side_changes(trace_of([left] * 3 + [right] * 3, [])) == 0


def passing(x: float, misses: list[float], speed: float, drift: tuple[float, float], angle: float) -> SimpleNamespace:
    """Rows in which a robot would pass a resting obstacle x m ahead, in each step by another miss, m; all drifts, turned."""
    turn = np.array([(math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))])
    sine = np.array([0.0, *misses]) / abs(x)
    velocity = speed * np.column_stack((np.sqrt(1.0 - sine**2), sine)) @ turn + drift
    t = 0.1 * np.arange(len(sine))
    xy = t[:, None] * drift
    return SimpleNamespace(t=t, xy=xy, velocity=velocity, obstacle_xy=(xy + x * turn[0])[:, None])


@pytest.mark.parametrize(
    ("x", "misses", "changes"),
    [
        *((2.99, [0.5, -0.5, 0.5], 2), (3.01, [0.5, -0.5, 0.5], 0), (-2.0, [0.5, -0.5, 0.5], 0)),
        *((2.0, [0.5, -0.09, 0.5], 0), (2.0, [0.11, -0.11, 0.11], 2), (2.0, [-0.5, -0.5, 0.5, 0.5], 1)),
        *((2.0, [0.5, 0.0, 0.0, 0.0, 0.0, -0.5], 1), (2.0, [0.5, 0.0, 0.0, 0.0, 0.0, 0.0, -0.5], 0)),
    ],
)
def test_sides_count_near_ahead_off_centre_and_within_half_a_second(x: float, misses: list[float], changes: int) -> None:
    """Within 3 m, if it would pass by at least 0.1 m at whatever speed; the next one may come up to five steps later."""
    for speed in (0.2, 1.0, 3.0):
        for drift, angle in (((0.0, 0.0), 0.0), ((0.7, -1.3), 2.0)):
            assert metrics.side_changes(passing(x, misses, speed, drift, angle)) == changes


def test_side_changes_are_those_of_a_loop_over_obstacles_and_steps() -> None:
    """Of several discs on the way of a robot that turns about, some ahead and some behind."""
    rng, total = np.random.default_rng(6), 0
    for _ in range(20):
        steps = rng.normal(size=(61, 2)) + np.array([0.5, 0.0])
        xy = np.cumsum(0.1 * steps, axis=0)
        discs = rng.uniform(-2.0, 5.0, (3, 2)) + np.cumsum(rng.normal(size=(61, 3, 2)) * 0.03, axis=0)
        rows = SimpleNamespace(t=0.1 * np.arange(61), xy=xy, velocity=steps, obstacle_xy=discs)
        expected = 0
        for k in range(3):
            last, before = -100, 0.0
            for i in range(60):
                (x, y), (u, v) = discs[i, k] - xy[i], rows.velocity[i + 1] - (discs[i + 1, k] - discs[i, k]) / 0.1
                if u * x + v * y > 0.0 and math.hypot(x, y) < 3.0 and abs(u * y - v * x) >= 0.1 * math.hypot(u, v):
                    side = math.copysign(1.0, u * y - v * x)
                    expected += i - last <= 5 and side != before
                    last, before = i, side
        assert metrics.side_changes(rows) == expected
        total += expected
    assert total > 50


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [(0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (5, 10, 0.2366, 0.7634), (0, 10_000, 0.0, 0.00038)],
)
def test_wilson(count, total, low, high):
    """Wilson's interval is that of the textbooks; 0 of 10,000 is below 0.04 %."""
    assert metrics.wilson(count, total) == pytest.approx((low, high), abs=1e-4)


def test_wilson_covers():
    """Over all outcomes of n trials the 95 % interval holds the true rate in about 95 % of cases."""
    n, p = 50, 0.9
    share = sum(
        math.comb(n, k) * p**k * (1 - p) ** (n - k)
        for k in range(n + 1)
        if metrics.wilson(k, n)[0] <= p <= metrics.wilson(k, n)[1]
    )
    assert 0.92 < share < 0.98


def test_bootstrap():
    """The interval of a mean comes close to that of the normal distribution, is the same every time, and is NaN of nothing."""
    sample = np.random.default_rng(1).normal(3.0, 1.0, 400)
    low, high = metrics.bootstrap(sample)
    half = 1.96 * sample.std() / 20
    assert (low, high) == pytest.approx((sample.mean() - half, sample.mean() + half), abs=0.02)
    assert metrics.bootstrap(sample) == (low, high)
    assert all(map(math.isnan, metrics.bootstrap([])))
    for n, tail in ((7, 0.025), (1000, 0.1)):  # which is how it is defined; of many values the resamples are drawn in parts
        values = np.random.default_rng(n).random(n)
        means = values[np.random.default_rng(0).integers(0, n, (2000, n))].mean(axis=1)
        assert metrics.bootstrap(values, tail) == tuple(np.quantile(means, (tail, 1.0 - tail)))


def test_intervals_of_many_episodes_fit_into_memory():
    """Of 20,000 values 2,000 resamples at once took 600 MB."""
    tracemalloc.start()
    metrics.mean_interval(np.zeros(20_000))
    assert tracemalloc.get_traced_memory()[1] < 30e6
    tracemalloc.stop()


def test_ranks_tell_real_differences():
    """Policies that differ by chance share a rank; a significantly better one stands alone; order follows the direction."""
    rng = np.random.default_rng(2)
    hard = rng.random(300)
    scores = {"a": hard + 0.1, "b": hard + rng.normal(0.0, 0.1, 300), "c": hard + rng.normal(0.0, 0.1, 300)}
    for scale in (1.0, 1e-3):
        scaled = {name: scale * one for name, one in scores.items()}
        assert {name: rank for name, _, rank in metrics.ranks(scaled)} == {"a": 1, "b": 2, "c": 2}
        assert {name: rank for name, _, rank in metrics.ranks(scaled, most=False)} == {"a": 3, "b": 1, "c": 1}


def test_ranks_of_nobody_are_none() -> None:
    """Without policies there is neither a rank nor an episode that all scored in."""
    assert metrics.ranks({}) == [] and not metrics.scored_by_all({}).any()


def test_ranks_compare_where_both_have_a_score():
    """A score that is missing takes that episode from the policy's own comparisons alone; few pairs decide nothing."""
    hard = np.random.default_rng(4).uniform(1.0, 2.0, 40)
    never, seldom = np.full(40, math.nan), np.where(np.arange(40) < 9, hard - 0.5, math.nan)
    worse = np.where(np.arange(40) % 2, hard + 0.1, math.nan)
    table = {
        name: (mean, rank)
        for name, mean, rank in metrics.ranks({"never": never, "seldom": seldom, "worse": worse, "best": hard}, most=False)
    }
    assert table["best"][1] == table["seldom"][1] == 1 and table["worse"][1] == 2
    assert math.isnan(table["never"][0]) and list(table)[-1] == "never"


def test_the_mean_beside_a_rank_is_of_the_episodes_that_all_reached():
    """A policy that is 5 % slower everywhere, and fails where it is difficult, has the larger mean too."""
    good = np.linspace(1.0, 2.0, 60)
    weak = np.where(good < 1.4, 1.05 * good, math.nan)
    scores = {"good": good, "weak": weak, "never": np.full(60, math.nan)}
    (best, mean, _), (worse, larger, rank), (last, nothing, _) = metrics.ranks(scores, most=False)
    assert (best, worse, last, rank) == ("good", "weak", "never", 2) and math.isnan(nothing)
    assert larger == pytest.approx(1.05 * mean) and mean == pytest.approx(good[good < 1.4].mean())
    assert metrics.scored_by_all(scores).sum() == np.count_nonzero(good < 1.4)
    assert not metrics.scored_by_all({"never": scores["never"]}).any(), "where no policy reached the goal, not all did"
    apart = {"b": np.where(good < 1.5, good, math.nan), "a": np.where(good > 1.5, good, math.nan)}
    assert [(name, rank, math.isnan(mean)) for name, mean, rank in metrics.ranks(apart)] == [("a", 1, True), ("b", 1, True)]


def test_pairing_sees_what_unpaired_means_do_not():
    """A small difference on episodes of very different length is real only because they are paired."""
    hard = np.random.default_rng(3).uniform(5.0, 50.0, 100)
    mean, (low, high), real = metrics.real_difference(hard + 0.1, hard)
    assert real and low <= mean <= high and mean == pytest.approx(0.1)
    assert not metrics.real_difference(hard, hard)[2]


def test_few_pairs_seldom_differ_by_chance():
    """Of equal policies, ten pairs tell about 5 % apart, not twice as many as by the plain percentile interval."""
    rng = np.random.default_rng(5)
    found = sum(metrics.real_difference(rng.normal(size=10), rng.normal(size=10))[2] for _ in range(1000))
    assert 20 <= found <= 75


def test_gaps_are_those_of_the_footprint():
    """A disc beside a long body is as far from it as points on its edge are, at whatever heading."""
    body = RobotSpec(footprint=((0.8, 0.15), (-0.8, 0.15), (-0.8, -0.15), (0.8, -0.15)))
    edge = np.array([(-0.8 + 1.6 * s, y) for s in np.linspace(0.0, 1.0, 400) for y in (-0.15, 0.15)])
    edge = np.vstack((edge, [(x, -0.15 + 0.3 * s) for s in np.linspace(0.0, 1.0, 100) for x in (-0.8, 0.8)]))
    for x, y, theta in np.random.default_rng(0).uniform(-2.0, 2.0, (50, 3)):
        turn = np.array([[np.cos(theta), np.sin(theta)], [-np.sin(theta), np.cos(theta)]])
        least, (u, v) = np.hypot(*(edge @ turn + (x, y)).T).min(), turn @ (-x, -y)
        least = -least if abs(u) < 0.8 and abs(v) < 0.15 else least
        gap = body_gap(body, np.array([x, y]), np.array(theta), np.zeros((1, 2)))[0]
        assert gap == pytest.approx(least, abs=5e-3)
    room = World(Grid(np.zeros((40, 60), bool), 0.2), (Obstacle(0.2, Line((2.0, 4.6), (2.0, 4.6), 0.0)),))
    beside = Scenario(room, (2.0, 4.0), (10.0, 4.0), body)
    assert metrics.gaps(run(beside, "stop", horizon=0.2).trace)[0, 0] == pytest.approx(0.25)


def test_intervals_of_few_values_hold():
    """Of means of normal numbers they miss one in twenty, however few; plain percentiles missed half of those of two."""
    rng = np.random.default_rng(7)
    for n in (2, 3, 5, 9, 12):
        ends = np.array([metrics.mean_interval(rng.normal(size=n)) for _ in range(400)])
        assert 0.90 <= ((ends[:, 0] <= 0.0) & (ends[:, 1] >= 0.0)).mean() <= 0.98, n
    assert all(map(math.isnan, (*metrics.mean_interval([1.0]), *metrics.mean_interval([]))))
    many = rng.normal(size=400)
    assert metrics.mean_interval(many) == pytest.approx(metrics.bootstrap(many), abs=2e-3)


def test_intervals_are_those_of_tables() -> None:
    """Student's t with 2 degrees of freedom is 4.30265, with 11 it is 2.20099; 1.075 % of normal numbers are below -2.29884."""
    spread = math.sqrt((16.0 + 1.0 + 25.0) / 9.0 / 2.0)  # of 1, 2, 4 around their mean
    half = 4.30265 * spread / math.sqrt(3.0)
    assert metrics.mean_interval([1.0, 2.0, 4.0]) == pytest.approx((7.0 / 3.0 - half, 7.0 / 3.0 + half), rel=1e-5)
    for n, tail in ((12, 0.0107572), (10, 0.0085508)):
        several = np.random.default_rng(1).normal(size=n)
        assert metrics.mean_interval(several) == pytest.approx(metrics.bootstrap(several, tail), abs=1e-4)
    assert all((metrics.wilson(0, n)[0], metrics.wilson(n, n)[1]) == (0.0, 1.0) for n in range(1, 100)), "without rounding"
    assert metrics.wilson(0, 0) == (0.0, 1.0)
    for wrong in ({"total": -1, "count": 0}, {"total": 3, "count": 4}, {"total": 3, "count": -1}):
        with pytest.raises(BadParameter):
            metrics.wilson(**wrong)
    assert metrics.bootstrap([1.0, 3.0], 0.5) == (2.0, 2.0)
    for tail in (-0.1, 0.6):
        with pytest.raises(BadParameter, match="tail"):
            metrics.bootstrap([1.0], tail)


@pytest.mark.parametrize("ratio", [metrics.time_ratio, metrics.path_ratio])
def test_ratios(ratio) -> None:
    """NaN where either number is; nothing is negative, and there are as many of one as of the other."""
    assert ratio([3.0, math.nan, 1.0, 1.0, 0.0], [2.0, 1.0, math.nan, 0.0, 0.0]) == pytest.approx(
        [1.5, math.nan, math.nan, math.inf, math.nan], nan_ok=True
    )
    for above, below in (([1.0, -1.0], [1.0, 1.0]), ([1.0, 1.0], [1.0, -1.0]), ([1.0], [1.0, 1.0])):
        with pytest.raises(BadParameter):
            ratio(above, below)


@pytest.mark.parametrize(
    ("most", "order"), [(True, ["fair", "dull", "nobody", "none"]), (False, ["dull", "fair", "nobody", "none"])]
)
def test_policies_of_one_rank_are_listed_by_their_means(most: bool, order: list[str]) -> None:
    scores = {
        "none": np.full(9, math.nan),
        "dull": np.arange(9.0),
        "fair": np.arange(9.0) + 0.5,
        "nobody": np.full(9, math.nan),
    }
    table = metrics.ranks(scores, most=most)
    assert [(name, rank) for name, _, rank in table] == [(name, 1) for name in order]
