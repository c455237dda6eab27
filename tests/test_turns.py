"""Turns of obstacles: how often they are seen, and how far a robot that foresees them keeps away."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from antway import Grid, Observation, RobotSpec, Scenario, Task, Tracks, World, check_episode, run
from antway.kernels.base.records import RobotState
from antway.kernels.controls.outlook import Margins, SpeedBounds, look_ahead
from antway.kernels.controls.problem import NearObstacle
from antway.kernels.tracking import kalman
from antway.kernels.tracking.changes import COLUMNS, FIRST_SECONDS, velocity_changes
from antway.kernels.tracking.kalman import UNKNOWN
from antway.kernels.tracking.predict import ID, RADIUS, SIGMA_V, VX, VY, X, Y
from antway.kernels.tracking.table import make_table
from antway.policies.antway.control_options import ControlOptions
from antway.policies.antway.controls import ControlColony
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.tracker import Tracker
from antway.world.motions import Line, Replay, Waypoints
from antway.world.robots import load_robot
from antway.world.rollouts import empty_outlook
from antway.world.terrain import terrain_of
from antway.world.trace import Outcome
from antway.world.world import Obstacle
from common import all_seen, cases, costly
from naive import people as naive
from naive import rollout as naive_rollout

ROOM = terrain_of(Grid(np.zeros((40, 40), np.bool_), 0.1))
COLUMN = {name: k for k, name in enumerate(NearObstacle._fields)}  # of obstacles of an outlook


def test_turns_are_those_that_the_slow_twin_counts() -> None:
    """Tracks in a room come and go, turn now and then and bounce off its walls, and some have no velocity."""
    rng = np.random.default_rng(4)
    for _ in range(cases(30, 1000)):
        table, turns = make_table(16, COLUMNS), np.array([FIRST_SECONDS, 0.0, 0.0])
        v, step, scans = rng.uniform(-1, 1, (6, 2)), float(rng.choice([0.05, 0.1, 0.25])), []
        xy, bounces = rng.uniform(0.3, 3.7, (6, 2)), 0
        for i in range(60):
            turned = rng.random(6) < 0.05
            v = np.where(turned[:, None], rng.uniform(-1, 1, (6, 2)), v + rng.normal(0, 0.02, (6, 2)))
            seen = np.flatnonzero(rng.random(6) < (0.3 if i % 20 > 15 else 0.95))
            estimates = np.zeros((len(seen), 8))
            estimates[:, (X, Y)], estimates[:, RADIUS] = xy[seen], 0.3
            estimates[:, (VX, VY)], estimates[:, ID] = v[seen], seen
            estimates[seen == 5, SIGMA_V] = UNKNOWN
            velocity_changes(table, turns, estimates, all_seen(estimates), ROOM, step * i, np.empty((len(seen), 4)))
            scans.append((step * i, {k: (*xy[k], *v[k]) for k in seen.tolist() if k != 5}))
            xy += step * v
            met = (xy < 0.3) & (v < 0.0) | (xy > 3.7) & (v > 0.0)
            v, bounces = np.where(met, -v, v), bounces + int(met.sum())
        rate, change = naive.turns(scans, 4.0, 0.3)
        assert turns[1] / turns[0] == pytest.approx(rate, rel=1e-9)
        assert turns[2] / max(turns[1], 1.0) == pytest.approx(change, rel=1e-9) and rate > 0.0 and bounces > 0


def test_a_wrong_velocity_in_the_first_scan_of_a_track_is_no_turn() -> None:
    """Many trackers report 0 then. It counted as a turn of the whole episode, and robots on wheels kept away from everybody."""
    table, turns = make_table(16, COLUMNS), np.array([FIRST_SECONDS, 0.0, 0.0])
    for i in range(20):
        estimates = np.array([[1.0 + 0.1 * i, 2.0, 1.0 if i % 10 else 0.0, 0.0, 0.3, 0.0, 0.0, float(i // 10)]])
        velocity_changes(table, turns, estimates, all_seen(estimates), ROOM, 0.1 * i, np.empty((1, 4)))
    assert turns[1] == 0.0 and turns[0] == pytest.approx(FIRST_SECONDS + 1.6)


def test_a_disc_that_bounces_off_a_wall_does_not_turn() -> None:
    """It goes to and fro between an edge of the map and a wall in it; one that turns at the same place and time does."""
    blocked = np.zeros((20, 40), np.bool_)
    blocked[:, 30:] = True
    for mirrored, number in ((True, 0.0), (False, 3.0)):
        table, turns, x, vx = make_table(16, COLUMNS), np.array([FIRST_SECONDS, 0.0, 0.0]), 1.5, 0.9
        for i in range(80):
            vy = 0.5 if mirrored or vx > 0.0 else -0.5
            estimates = np.array([[x, 1.0, vx, vy, 0.3, 0.0, 0.0, 7.0]])
            velocity_changes(
                table, turns, estimates, all_seen(estimates), terrain_of(Grid(blocked, 0.1)), 0.1 * i, np.empty((1, 4))
            )
            x += 0.1 * vx
            vx = -abs(vx) if x > 2.7 else abs(vx) if x < 0.3 else vx
        assert turns[1] == number


def test_tracks_bounce_where_the_scan_says_so() -> None:
    """Kernel and slow twin agree on which of two futures a scan shows, with velocities or without, and where it leads."""
    rng, found = np.random.default_rng(6), 0
    for _ in range(cases(200, 5000)):
        table, dt, speed = (
            make_table(2, kalman.COLUMNS, ID),
            float(rng.uniform(0.05, 0.3)),
            float(rng.choice([0.1, math.nan])),
        )
        state = [*rng.uniform(0.3, 0.7, 2), *rng.uniform(-1.0, 0.3, 2)]
        table.used[0], row = 1, table.rows[0]
        row[[X, Y, VX, VY]], row[RADIUS], row[ID], row[kalman.P11], row[kalman.P22] = state, 0.3, 5.0, 0.0009, 0.04
        velocity = np.array(state[2:]) * np.where(rng.random(2) < 0.5, -1.0, 1.0) + rng.normal(0.0, 1.0, 2) * speed
        xy = np.maximum(0.6 - np.array(state[:2]), 0.3) if rng.random() < 0.5 else np.array(state[:2]) + dt * velocity
        future, did = naive.bounced(state, 0.3, 4.0, dt, xy, velocity, (math.sqrt(0.0034), math.sqrt(0.05)))
        kalman.bounce(*table[:2], ROOM, dt, np.array([5]), xy[None], velocity[None], np.array([[0.0025, 0.01]]))
        assert [row[X] + dt * row[VX], row[Y] + dt * row[VY], row[VX], row[VY]] == pytest.approx(future, abs=1e-4)
        found += did
    assert 0.1 < found / cases(200, 5000) < 0.9


@pytest.mark.parametrize("speed", [0.25, math.nan])
def test_a_bounce_is_known_at_once_where_places_are_noisy(speed: float) -> None:
    """Between two walls the velocity is known to 0.5 m/s in nine of ten scans, and at most one in twenty counts as a turn."""
    rng, tracker, x, vx, wrong = np.random.default_rng(7), Tracker(), 1.0, 0.9, []
    for i in range(300):
        xy, velocity = np.array([[x, 2.0]]) + rng.normal(0.0, 0.03, (1, 2)), np.array([[vx, 0.0]])
        tracks = Tracks([3], xy, velocity + rng.normal(0.0, 1.0, (1, 2)) * speed, [0.3])
        tracker.update(tracks, 0.1 * i, ROOM, (2.0, 2.0), 10.0)
        wrong.append(abs(tracker.estimates[0, VX] - vx))
        x += 0.1 * vx
        vx = -abs(vx) if x > 3.7 else abs(vx) if x < 0.3 else vx
    assert np.quantile(wrong[50:], 0.9) < 0.5 and tracker.turns[0] < 0.5


@pytest.mark.parametrize("change", [0.0, 0.8, 1.6])
def test_the_reach_of_turns_is_what_an_obstacle_gains_before_the_robot_is_out_of_its_way(change: float) -> None:
    """It is the largest gain of all turns up to then, tried one by one."""
    outlook = empty_outlook(30)
    margins = Margins(0.01, 0.05, 2.0, 1.2, 0.4, 0.15, 2.0)
    segments, at = np.array([[0.0, math.inf, 2.0, 0.0, 0.0, 0.0, 0.6, 0.6]]), RobotState(0.0, 0.0, 0.0, 0.0, 0.0)
    look_ahead(segments, np.zeros((1, 2)), 0.0, 0.1, at, SpeedBounds(1.0, 1.0, 1.0, 1.0), margins, change, outlook)
    reach = outlook.disc[:, 0, COLUMN["turn_distance"]] - outlook.disc[:, 0, COLUMN["contact"]]
    for k in range(30):
        since = np.linspace(0.0, 0.1 * (k + 1), 20_001)
        gain = change * since - 0.5 * 2.0 * np.maximum(since - 0.15, 0.0) ** 2
        assert reach[k] == pytest.approx(gain.max(), abs=1e-6)
        assert outlook.disc[k, 0, COLUMN["turn_time"]] == pytest.approx(min(0.1 * (k + 1), 0.15 + change / 2.0))
    assert (outlook.near == 1).all()


def _walks(rng: np.random.Generator, now: float, number: int) -> np.ndarray:
    """Segments of an obstacle from before `now` on: at each knot a wall mirrors it, or only its tube widens, or neither."""
    knots = now + np.cumsum([-rng.uniform(0.0, 0.3), *rng.uniform(0.05, 1.5, rng.integers(1, 7))])
    at, v, radius, rows = rng.uniform(-9.0, 9.0, 2), rng.uniform(-1.5, 1.5, 2), rng.uniform(0.4, 0.8), []
    for t0, t1 in pairwise([*knots[:-1].tolist(), now + 9.0 + number]):
        rows.append((t0, t1, *at, *v, radius, radius))
        at = at + (t1 - t0) * v
        v, radius = v * rng.choice([-1.0, 1.0, 1.0], 2), radius + 0.1 * (rng.random() < 0.5)
    return np.array(rows)


@pytest.mark.parametrize("count", [0, 1, 7, 90, 400])
def test_an_outlook_is_what_its_slow_twin_finds(count: int) -> None:
    """All that is near, each in a column of its own, whatever is far and comes between; of too many the nearest."""
    rng, steps, margins = np.random.default_rng(count), 12, Margins(0.01, 0.05, 2.0, 0.8, 0.4, 0.15, 2.0)
    outlook = empty_outlook(steps)
    for _ in range(costly(5, 500)):
        now, change, dt = float(rng.choice([0.0, 7.3])), float(rng.choice([0.0, 0.9])), float(rng.choice([0.1, 0.3]))
        tracks, sigma = [_walks(rng, now, k) for k in range(count)], rng.uniform(0.0, 0.2, (count, 2))
        segments = np.vstack([np.empty((0, 8)), *tracks])
        bounds, start = SpeedBounds(0.6, 0.5, 1.0, rng.uniform(0.0, 0.5)), RobotState(*rng.uniform(-1.0, 1.0, 2), 0.0, 0.0, 0.0)
        columns: dict[int, set[float]] = {}
        look_ahead(segments, sigma, now, dt, start, bounds, margins, change, outlook)
        twin = naive_rollout.outlook_of(tracks, sigma, now, dt, steps, start, bounds, margins, change)
        for k, near in enumerate(twin):
            kept = sorted(near, key=lambda n, near=near: near[n][1])[:64]
            kept.sort(key=lambda n, near=near: near[n][0][0])
            n = outlook.near[k]
            order = np.argsort(outlook.disc[k, :n, COLUMN["x"]])
            rows, beyond = outlook.disc[k, order], outlook.beyond[k, :, order]
            found, expected = np.delete(rows, COLUMN["owner"], axis=1), np.array([near[n][0] for n in kept])
            assert found == pytest.approx(expected.reshape(found.shape), abs=1e-6)
            around = rows[:, [COLUMN[name] for name in ("preferred", "risky", "turn_distance")]].max(axis=1, initial=0.0)
            speed = bounds.v_max + np.hypot(*rows[:, 5:7].T)
            passed = dt * speed if dt > 0.1 else 0.0  # within a step that is not short
            square = around**2 + passed**2 if k < steps else (around + 3.0 * speed) ** 2
            assert beyond == pytest.approx(np.column_stack((rows[:, :2], square)))
            for n, column in zip(kept, rows[:, COLUMN["owner"]].tolist()):
                columns.setdefault(n, set()).add(column)
        assert all(len(own) == 1 for own in columns.values())
        if len(set().union(*twin)) <= 64:
            assert len(set().union(*columns.values())) == len(columns)


@pytest.mark.parametrize("now", [0.0, 7.3, 1.7e9])
def test_an_obstacle_counts_once_wherever_rounding_puts_the_end_of_a_step(now: float) -> None:
    """A step may end just before or after a segment of the obstacle does."""
    at, margins = RobotState(0.0, 0.0, 0.0, 0.0, 0.0), Margins(0.01, 0.05, 2.0, 1.2, 0.4, 0.1, 2.0)
    for off in (0.0, 1e-16, 1e-12, 5e-10, 1e-9, 2e-9, 3e-7):
        for end in (now + 0.3 - off, now + 0.3 + off):
            outlook = empty_outlook(10)
            segments = np.array([[now, end, 2.0, 0.0, 0.0, 0.0, 0.6, 0.6], [end, now + 9.0, 2.0, 0.0, 0.0, 0.0, 0.6, 0.6]])
            look_ahead(segments, np.zeros((1, 2)), now, 0.1, at, SpeedBounds(1.0, 1.0, 1.0, 1.0), margins, 0.0, outlook)
            assert outlook.near[:10].tolist() == [1] * 10


def test_velocities_count_as_wrong_by_as_much_as_turns_change_them() -> None:
    """A turn of 2 m/s in every 5 s has, drawn at random again and again, the spread along an axis that is assumed.

    That holds for those who move; whoever stands is predicted as well as before.
    """
    task = Task(Grid(np.zeros((40, 40), np.bool_), 0.1), RobotSpec(a_max=1.0), (1.0, 1.0), (3.0, 3.0))
    colony = ControlColony(ControlOptions(turned=0.4), task, np.zeros((40, 40)), 3, strict=False)
    estimates = np.zeros((3, 8))
    estimates[:, VX] = 0.21, 8.0, 0.19
    _, velocity = colony.deviations(estimates, np.array([0.02, 0.02, 0.02]), 1.0, (0.2, 2.0)).T
    rng = np.random.default_rng(5)
    number, angle = rng.poisson(0.2 * 0.4, 100_000), rng.uniform(-math.pi, math.pi, 100_000)
    assert velocity[0] == pytest.approx((2.0 * number.astype(bool) * np.cos(angle)).std(), rel=0.05)
    assert velocity[1] == pytest.approx(0.12 * 8.0)
    assert velocity[2] == 0.12 * 0.19
    _, velocity = colony.deviations(estimates, np.array([0.02, 0.02, 0.02]), 0.0, (0.0, 0.0)).T
    assert velocity == pytest.approx(0.02)


def test_a_robot_with_inertia_keeps_away_from_obstacles_that_turn_again_and_again() -> None:
    """Discs go to and fro across an aisle, so that they turn at once; the robot passes them farther away for that."""
    gap = {}
    for turn_risk in (0.0, 20.0):
        discs = tuple(Obstacle(0.3, Waypoints(((x, 2.9), (x, 5.2)), 0.8)) for x in (5.0, 8.0, 11.0))
        world = World(Grid(np.zeros((60, 150), np.bool_), 0.1), discs)
        scenario = Scenario(world, (1.0, 3.0), (14.0, 3.0), robot=RobotSpec(v_max=2.0, a_max=2.0, radius=0.3))
        result = run(scenario, AntwayPolicy(controls=ControlOptions(turn_risk=turn_risk)), seed=1)
        check_episode(result)
        assert result.outcome.value == "reached"
        gap[turn_risk] = result.min_clearance
    assert gap[20.0] > gap[0.0] + 0.05, gap


def test_scans_whose_time_goes_back_count_for_nothing() -> None:
    """Neither time observed nor turns come of them, however often the clock is set back."""
    table, turns = make_table(4, COLUMNS), np.array([FIRST_SECONDS, 0.0, 0.0])
    estimates = np.zeros((1, 8))
    estimates[0, X], estimates[0, Y], estimates[0, RADIUS] = 2.0, 2.0, 0.3
    for i in range(40):
        estimates[0, VX] = float(i % 4 // 2)
        velocity_changes(table, turns, estimates, all_seen(estimates), ROOM, float(i % 2), np.empty((1, 4)))
    assert turns.tolist() == [FIRST_SECONDS, 0.0, 0.0]


def test_who_stopped_dead_is_passed_as_somebody_who_stands() -> None:
    """After one had stopped, the slow robot expected him to set off as suddenly again, and waited for 20 to 30 s beside him."""
    blocked = np.ones((40, 150), np.bool_)
    blocked[10:30, 5:-5] = False
    somebody = Obstacle(0.25, Line((9.0, 2.0), (6.0, 2.0), speed=1.0))
    corridor = Scenario(World(Grid(blocked, 0.1), [somebody]), (1.5, 2.0), (12.5, 2.0), load_robot("turtlebot4"), horizon=120.0)
    result = run(corridor, "antway", seed=0)
    check_episode(result)
    assert result.reached and result.time < 1.15 * 11.0 / 0.31


@pytest.mark.parametrize("stops_for", [0.01, 0.36, 0.53])
def test_nobody_who_walks_ahead_and_stops_is_touched(stops_for: float) -> None:
    """A robot that could not pass them came up so near and so fast behind that it touched them at 0.7 to 1.05 m/s."""
    blocked = np.ones((35, 200), np.bool_)
    blocked[10:25, 5:-5] = False
    t = np.array([0.0, *np.linspace(2.5, 2.5 + stops_for, 20)])
    x = 3.0 + 0.8 * (t - 0.5 * np.maximum(t - 2.5, 0.0) ** 2 / stops_for)
    ahead = Obstacle(0.25, Replay(tuple(t.tolist()), tuple((at, 1.75) for at in x.tolist())))
    corridor = Scenario(World(Grid(blocked, 0.1), [ahead]), (1.5, 1.75), (18.0, 1.75), load_robot("amr"), horizon=15.0)
    for seed in range(costly(2, 20)):
        result = run(corridor, "antway", seed=seed)
        check_episode(result)
        assert result.outcome is Outcome.TIMEOUT and result.trace.xy[-1, 0] > 3.0


def test_who_is_faster_than_declared_is_not_expected_to_slow_down() -> None:
    """Of an obstacle seen at 2 m/s, where 1 m/s is declared, 2 m/s is the bound; a slower one may still reach 1 m/s."""
    at, margins = RobotState(0.0, 0.0, 0.0, 0.0, 0.0), Margins(0.01, 0.05, 2.0, 1.2, 0.4, 0.1, 2.0)
    for seen, growth, bound in ((2.0, 0.0, 2.0), (2.0, 1.0, 2.0), (0.5, 1.0, 1.0), (0.5, 0.2, 0.7)):
        outlook = empty_outlook(10)
        segments = np.array([[0.0, 9.0, 2.0, 0.0, -seen, 0.0, 0.6, 0.6]])
        look_ahead(segments, np.zeros((1, 2)), 0.0, 0.1, at, SpeedBounds(1.0, 1.0, 1.0, growth), margins, 0.0, outlook)
        assert outlook.near[9] == 1 and outlook.disc[9, 0, COLUMN["speed"]] == pytest.approx(bound)


@pytest.mark.parametrize("every", [1, 2])
def test_a_scan_that_is_known_for_several_cycles_is_one(every: int) -> None:
    """Trackers that say of a new track that it stands, until its second scan, make no turns of it."""
    tracker, terrain = Tracker(), terrain_of(Grid(np.zeros((200, 200), bool), 0.1))
    for n in range(60):
        t, scan = 0.1 * n, 0.1 * every * (n // every)
        age = np.array([scan - 0.6 * k for k in range(10) if scan >= 0.6 * k - 1e-9])
        moves = np.where(age < 0.1 * every - 1e-9, 0.0, 1.0)
        places, velocities = np.column_stack((2.0 + age, 2.0 + np.arange(len(age)))), np.column_stack((moves, 0.0 * moves))
        tracks = Tracks(np.arange(len(age)), places, velocities, np.full(len(age), 0.25))
        seen = tracker.corrected(Observation(t, (15.0, 15.0), (0.0, 0.0), 0.0, tracks, stamp=scan))
        tracker.update(seen.tracks, scan, terrain, (15.0, 15.0), 30.0)
    assert tracker.turns[0] == 0.0
