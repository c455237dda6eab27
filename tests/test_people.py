"""People: what predicts them best, how wrong their places are, tubes that hold, and least harm where nothing is certain."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pytest

from antway import Command, Grid, Observation, Policy, RobotSpec, Scenario, Task, Tracks, World, check_episode, run
from antway.arena.predict import (
    PEOPLE_DENSITY,
    PEOPLE_DOF,
    forecast,
    left_tubes,
    markdown,
    people_variance,
    place_variance,
    tube_radius,
)
from antway.arena.suites import build, episodes
from antway.errors import BadScenario
from antway.kernels import sidestep
from antway.kernels.base.records import RobotState, Terrain
from antway.kernels.robot.harm import harm, least_harm
from antway.kernels.tracking import averages, kalman, noise, reported
from antway.kernels.tracking.predict import (
    ID,
    NO_PREDICTIONS,
    RADIUS,
    SIGMA,
    SIGMA_V,
    VX,
    VY,
    TubeMargins,
    X,
    Y,
    crosses_edge,
    predict,
)
from antway.kernels.tracking.prediction_error import LATER
from antway.kernels.tracking.table import make_table
from antway.policies.antway.nodes import make_context
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.tracker import FIRST_OWN_ID, Tracker
from antway.policies.guard import MODES, Guard
from antway.world.motions import Replay
from antway.world.robots import load_robot
from antway.world.sensor import Sensor
from antway.world.terrain import terrain_of
from antway.world.world import Obstacle
from common import SHARED, all_seen, cases, changes_of, costly, needs_data
from naive import people as naive

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from people import Told, Untold, swaps

LIMITS = RobotSpec().limits
OPEN = terrain_of(Grid(np.zeros((100, 100), np.bool_), 0.2))
AIR = Terrain(np.zeros((1, 1), np.bool_), np.zeros((1, 1), np.bool_), -500.0, -500.0, 1000.0)
TRACKS = np.array([0.0, 0.0, 0.0, 0.0, 0.3, 1.5, 2.2, 0.0])


def _rows(*people: tuple[float, float, float, float]) -> np.ndarray:
    rows = np.tile(TRACKS, (len(people), 1))
    rows[:, :4] = people
    return rows


def test_harm_is_what_its_slow_twin_finds() -> None:
    """Expected contacts of a motion among people, some of them seen before, are those of dense sampling."""
    rng, some = np.random.default_rng(1), 0
    for _ in range(cases(60, 2000)):
        drive, at = int(rng.integers(2)), rng.uniform(-20.0, 20.0, 2)
        limits = LIMITS._replace(a_max=float(rng.choice([math.inf, 1.0])), drive=drive)
        heading, speed = rng.uniform(-3.0, 3.0), rng.uniform(0.0, 1.0)
        v = (speed * math.cos(heading), speed * math.sin(heading))
        tracks = _rows(*np.column_stack((at + rng.uniform(-3, 3, (3, 2)), rng.uniform(-1.5, 1.5, (3, 2)))))
        tracks[:, 7] = rng.uniform(0.0, 0.4, 3)
        command, until, dt = rng.uniform(-0.7, 0.7, 2), float(rng.uniform(0.0, 2.5)), float(rng.choice([0.1, 0.3]))
        if rng.random() < 0.2:  # all stand
            v, command, tracks[:, 2:4] = (0.0, 0.0), np.zeros(2), 0.0
        path = np.empty((64, 5))
        found = harm(RobotState(*at, heading, *v), *command, until, tracks, limits, dt, math.inf, path)
        slow = naive.harm(at, v, heading, command, until, tracks, (1.0, limits.a_max, 2.0, drive == 1, 0.3), dt)
        assert found == pytest.approx(slow, abs=7e-3, rel=0.05)
        assert harm(RobotState(*at, heading, *v), *command, until, tracks, limits, dt, 0.5 * found, path) >= 0.5 * found
        some += found > 0.1
    assert some > 10


def test_harm_fades_with_the_distance() -> None:
    """A robot at full speed counts whom it cannot quite reach, as places are uncertain; it once counted nobody 3.11 m away."""
    path, v = np.empty((64, 5)), (1.0, 0.0)
    for distance in (3.0, 3.2, 3.5):
        tracks = _rows((distance, 0.0, 0.0, 0.0))
        slow = naive.harm((0.0, 0.0), v, 0.0, v, 2.5, tracks, (1.0, math.inf, 2.0, False, 0.3), 0.1)
        found = harm(RobotState(0.0, 0.0, 0.0, *v), *v, 2.5, tracks, LIMITS, 0.1, math.inf, path)
        assert found == pytest.approx(slow) and found > 0.02


def test_harm_looks_as_far_ahead_at_every_control_rate() -> None:
    """Who touches a standing robot in 1.9 s counts as much at 50 and at 100 Hz as at 10 Hz, to a tenth."""
    path, tracks = np.empty((64, 5)), _rows((2.5, 0.0, -1.0, 0.0))
    at = RobotState(0.0, 0.0, 0.0, 0.0, 0.0)
    found = [harm(at, 0.0, 0.0, 0.0, tracks, LIMITS, dt, math.inf, path) for dt in (0.1, 0.05, 0.02, 0.01)]
    assert found == pytest.approx([found[0]] * 4, rel=0.1) and found[0] > 0.1


@pytest.mark.parametrize("dt", [0.1, 0.125, 0.3, 0.5, 2.5 / 49.0])
def test_harm_looks_ahead_for_as_many_periods_as_it_needs(dt: float) -> None:
    """Where 2.5 s were an odd number of periods, one more was looked at, in which somebody comes near who counts else less."""
    path, at = np.full((64, 5), math.nan), RobotState(0.0, 0.0, 0.0, 0.0, 0.0)
    for away in (2.4, 2.55):
        tracks = _rows((0.6 + away, 0.0, -1.0, 0.0))
        found = harm(at, 0.0, 0.0, 0.0, tracks, LIMITS, dt, math.inf, path)
        slow = naive.harm((0.0, 0.0), (0.0, 0.0), 0.0, (0.0, 0.0), 0.0, tracks, (1.0, math.inf, 2.0, False, 0.3), dt)
        assert found == pytest.approx(slow, rel=0.02)
    periods = int(np.isfinite(path[:, 0]).sum())
    assert (periods - 1) * dt < 2.5 - 1e-9 <= periods * dt


@pytest.mark.parametrize("drive", [0, 1], ids=["holonomic", "wheels"])
def test_least_harm_is_the_least_of_its_slow_twin(drive: int) -> None:
    """Among people and walls, of what is clear of these, whatever is commanded; it is often neither that nor a stand."""
    rng, chosen = np.random.default_rng(2), []
    for _ in range(costly(6, 300)):
        grid = Grid(rng.random((12, 12)) < 0.08, 0.5)
        limits = LIMITS._replace(a_max=float(rng.choice([1.0, 2.0])), drive=drive)
        free = np.argwhere(grid.clearance() > 0.5)
        at = grid.centre(tuple(free[rng.integers(len(free))].tolist()))
        heading, speed = float(rng.choice([0.3, -2.0])), float(rng.choice([0.0, 0.2]))
        v = (speed * math.cos(heading), speed * math.sin(heading))
        command = tuple(rng.choice([0.0, 0.3, -0.7], 2).tolist())
        near = rng.uniform(-1.5, 1.5, (3, 2))
        tracks = _rows(*np.column_stack((np.array(at) + near, -0.5 * near * rng.integers(0, 2, (3, 1)))))
        found = least_harm(RobotState(*at, heading, *v), *command, tracks, limits, 0.1, terrain_of(grid))
        twin = (at, v, heading, command, tracks, (1.0, limits.a_max, limits.turn_rate, drive == 1, 0.3), 0.1, grid.blocked, 0.5)
        may, sure = (naive.least_harm(*twin, spare) for spare in (-0.01, 0.01))
        costs = [cost for candidate, cost in may.items() if math.dist(candidate, found) < 1e-9]
        assert costs and costs[0] < min(sure.values()) + 0.012
        chosen.append(math.dist(found, command) > 1e-9 and math.hypot(*found) > 0.0)
    assert any(chosen)


def test_least_harm_leaves_the_way_of_a_runner_and_of_three_abreast() -> None:
    """Who runs at 2.5 m/s is sidestepped; before three abreast the robot goes round their nearer end, or runs before them."""
    dt = 0.1
    for people in ([(3.0, 0.0, -2.5, 0.0)], [(2.5, -0.7, -1.3, 0.0), (2.5, 0.1, -1.3, 0.0), (2.5, 0.9, -1.3, 0.0)]):
        x, y, rows = 10.0, 10.0, _rows(*people)
        rows[:, :2] += 10.0
        for _ in range(40):
            vx, vy = least_harm(RobotState(x, y, 0.0, 0.0, 0.0), 0.0, 0.0, rows, LIMITS, dt, OPEN)
            x, y = x + vx * dt, y + vy * dt
            rows[:, :2] += rows[:, 2:4] * dt
            assert np.hypot(rows[:, 0] - x, rows[:, 1] - y).min() > 0.6


def test_strict_stands_where_least_harm_moves() -> None:
    """A robot in the way of one who comes too near for certainty stands in mode strict, and in the other leaves its way."""
    tracks = Tracks(np.array([0]), np.array([[5.63, 5.02]]), np.array([[-1.3, 0.0]]), np.array([0.3]))
    told = {}
    for mode in ("strict", "least-harm"):
        guard = Guard(mode=mode)
        guard.reset(Task(Grid(np.zeros((50, 50), np.bool_), 0.2), RobotSpec(), (1.0, 5.0), (9.0, 5.0)))
        passed = guard.limit(Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, tracks), Command((1.0, 0.0)))
        told[mode] = guard.did, math.hypot(*passed.velocity)
    assert told["strict"] == ("braked", 0.0) and told["least-harm"][0] == "least-harm" and told["least-harm"][1] > 0.9


def test_what_is_seen_raises_the_bounds() -> None:
    """One who ran once may run again; others are expected to be a little faster than told, and more so with time."""
    guard = Guard()
    guard.reset(Task(Grid(np.zeros((50, 50), np.bool_), 0.2), RobotSpec(), (1.0, 5.0), (9.0, 5.0), obstacle_speed=1.0))
    for i in range(30):
        speeds = np.array([[2.5 if i == 5 else 0.5, 0.0], [0.5, 0.0]])
        tracks = Tracks(np.array([7, 8]), np.array([[3.0, 3.0], [7.0, 7.0]]) + 0.01 * i, speeds, np.array([0.3, 0.3]))
        guard.limit(Observation(0.1 * i, (5.0, 5.0), (0.0, 0.0), 0.0, tracks), Command((0.0, 0.0)))
    assert guard.tracks[0, 5] == 2.5 and 1.0 <= guard.tracks[1, 5] < 1.2


def _averaged(scans, terrain: Terrain = AIR, restart: bool = True) -> np.ndarray:
    table, pool, out = make_table(64, averages.COLUMNS), np.zeros(averages.POOL), np.empty(0)
    for (t, estimates), changed in zip(scans, changes_of(scans, terrain), strict=True):
        out = np.empty_like(estimates)
        averages.averaged(table, pool, estimates, all_seen(estimates), changed, t, restart, out)
    return out


@pytest.mark.parametrize("sways", [False, True])
def test_the_average_that_predicted_best_is_taken(sways: bool) -> None:
    """Velocities that sway from scan to scan are averaged; those that hold until they turn are taken as they are."""
    rng, off = np.random.default_rng(2), []
    for _ in range(cases(20, 500)):
        xy, v, scans = rng.uniform(0, 9, (5, 2)), rng.uniform(-1, 1, (5, 2)), []
        for i in range(60):
            if not sways and i % 20 == 19:
                v = rng.uniform(-1, 1, (5, 2))
            estimates = np.zeros((5, 8))
            estimates[:, (X, Y)], estimates[:, (VX, VY)] = xy, v + (rng.normal(0, 0.3, (5, 2)) if sways else 0.0)
            estimates[:, ID] = np.arange(5)
            scans.append((0.1 * i, estimates))
            xy = xy + v * 0.1
        out = _averaged(scans)
        off.append(np.hypot(*(out[:, (VX, VY)] - v).T).mean())
    assert np.mean(off) < (0.2 if sways else 1e-9)  # the last velocity alone is off by 0.38 on the average


@pytest.mark.parametrize("restart", [False, True])
def test_discs_that_bounce_are_not_averaged(restart: bool) -> None:
    """Discs cross an aisle to and fro; those from before a bounce are averaged only without walls and restarts."""
    wrong, aisle = {True: 0, False: 0}, terrain_of(Grid(np.zeros((15, 200), np.bool_), 0.1))
    for known in wrong:
        rng = np.random.default_rng(7)
        for _ in range(cases(20, 300)):
            xy, v, scans = rng.uniform((4.0, 0.3), (16.0, 1.2), (3, 2)), rng.uniform((-0.3, 0.5), (0.3, 0.9), (3, 2)), []
            for i in range(int(rng.integers(40, 100))):
                estimates = np.zeros((3, 8))
                estimates[:, (X, Y)], estimates[:, (VX, VY)], estimates[:, RADIUS] = xy, v, 0.3
                estimates[:, ID] = np.arange(3)
                scans.append((0.1 * i, estimates))
                xy = xy + 0.1 * v
                v[:, 1] = np.where(xy[:, 1] < 0.3, np.abs(v[:, 1]), np.where(xy[:, 1] > 1.2, -np.abs(v[:, 1]), v[:, 1]))
            off = np.abs(_averaged(scans, aisle if known else AIR, restart)[:, (VX, VY)] - scans[-1][1][:, (VX, VY)])
            wrong[known] += int((off.max(axis=1) > 1e-9).sum())
    assert wrong[True] == 0 and (wrong[False] > 0) == (not restart)


@pytest.mark.parametrize(("before", "after"), [(1.2, 0.0), (1.2, -0.8), (0.0, 0.8)])
def test_who_stops_turns_back_or_sets_out_is_noticed_at_once(before: float, after: float) -> None:
    """People sway, so averages predict them best; 0.2 s after a change at 3 m/s^2 the velocity is right to 0.25 m/s."""
    rng = np.random.default_rng(8)
    for _ in range(cases(10, 200)):
        step, phase, ends = float(rng.choice([0.05, 0.1])), rng.uniform(0, 6, 2), 4.0 + abs(after - before) / 3.0
        xy, scans = np.zeros((2, 2)), []
        for i in range(round((ends + 0.2) / step) + 1):
            speed, estimates = float(np.interp(step * i, (4.0, ends), (before, after))), np.zeros((2, 8))
            estimates[:, (X, Y)], estimates[:, VX], estimates[:, ID] = xy, speed, np.arange(2)
            estimates[:, VY] = 0.15 * abs(speed) * np.cos(5.7 * step * i + phase)
            scans.append((step * i, estimates))
            xy = xy + step * estimates[:, (VX, VY)]
        assert np.hypot(*(_averaged(scans)[:, (VX, VY)] - (after, 0.0)).T).max() < 0.25


@pytest.mark.parametrize("restart", [False, True])
def test_averages_are_those_of_their_slow_twin(restart: bool) -> None:
    """Velocities and how wrong they may be are those of sums over whole histories, as tracks sway, come and go."""
    rng = np.random.default_rng(12)
    for _ in range(cases(8, 200)):
        xy, v, scans, slow, step = rng.uniform(0, 9, (5, 2)), rng.uniform(-1, 1, (5, 2)), [], [], float(rng.choice([0.1, 0.25]))
        for i in range(40):
            v = v + rng.normal(0, 0.1, (5, 2))
            there = np.arange(5) < (3 if i % 9 == 4 else 5)  # two of them are not seen now and then
            estimates = np.zeros((int(there.sum()), 8))
            estimates[:, (X, Y)], estimates[:, (VX, VY)], estimates[:, ID] = xy[there], v[there], np.flatnonzero(there)
            scans.append((step * i, estimates))
            slow.append((step * i, {k: (*xy[k], *v[k]) for k in np.flatnonzero(there).tolist()}))
            xy = xy + v * step
        least = {} if restart else {"sudden": math.inf, "stops": math.inf}
        out, told = _averaged(scans, AIR, restart), naive.averaged(slow, **least)
        for row in out:
            assert tuple(row[[VX, VY, SIGMA_V]]) == pytest.approx(told[int(row[ID])], abs=1e-9)


def test_companions_tell_where_a_newcomer_goes() -> None:
    """A person who has just come in sight is predicted better in a group that sways than alone."""
    rng, off = np.random.default_rng(4), {True: [], False: []}
    for together in off:
        for _ in range(cases(20, 500)):
            mean, scans = rng.uniform(0.6, 1.2, 2), []
            xy = np.column_stack((np.zeros(4), (0.8 if together else 6.0) * np.arange(4)))
            for i in range(12):
                there = np.arange(4) < (4 if i > 9 else 3)  # the fourth comes two scans before the end
                estimates = np.zeros((int(there.sum()), 8))
                estimates[:, (X, Y)], estimates[:, ID] = xy[there], np.flatnonzero(there)
                estimates[:, (VX, VY)] = (mean + rng.normal(0, 0.2, (4, 2)))[there]
                scans.append((0.1 * i, estimates))
                xy = xy + 0.1 * mean
            off[together].append(math.hypot(*(_averaged(scans)[3, VX : VY + 1] - mean)))
    assert np.mean(off[True]) < 0.8 * np.mean(off[False])


@pytest.mark.parametrize("velocity", ["exact", "none"])
@pytest.mark.parametrize("way", ["ahead", "behind"])
def test_three_abreast_and_a_runner_do_not_touch_the_robot(way: str, velocity: str) -> None:
    """Groups of three who walk abreast, 0.8 m apart, towards the robot or faster than it from behind, and one who runs.

    So it is, too, where the sensor tells no velocities.
    """
    rng = np.random.default_rng(21)
    for _ in range(cases(4, 100)):
        sign = -1.0 if way == "ahead" else 1.0
        speed, y = float(rng.uniform(1.2, 1.5)), float(rng.uniform(5.0, 7.0))
        x = 20.0 if way == "ahead" else -3.0
        walk = [(x, y + 0.8 * k, sign * speed) for k in range(-1, 2)] + [(26.0, float(rng.uniform(3.0, 9.0)), -2.5)]
        people = tuple(Obstacle(0.3, Replay((0.0, 40.0), ((px, py), (px + 40.0 * v, py)))) for px, py, v in walk)
        grid = Grid(np.zeros((60, 100), np.bool_), 0.2)
        sensor = Sensor(velocity=velocity)
        result = run(Scenario(World(grid, people), (2.0, 6.0), (18.0, 6.0), RobotSpec(sensor_range=4.0), sensor=sensor))
        check_episode(result)
        assert result.reached, result.reason


def test_the_guard_knows_velocities_that_are_not_told() -> None:
    """In mode least-harm it is given the filter's, soon after the first scan; in mode strict it takes them as unknown."""
    for mode in MODES:
        policy = AntwayPolicy(mode=mode)
        policy.reset(Task(Grid(np.zeros((50, 50), np.bool_), 0.2), RobotSpec(), (1.0, 5.0), (9.0, 5.0)), 1)
        for i in range(6):
            one = Tracks(np.array([4]), np.array([[6.7 - 0.13 * i, 5.02]]), np.full((1, 2), math.nan), np.array([0.3]))
            policy.act(Observation(0.1 * i, (3.0, 5.0), (0.0, 0.0), 0.0, one))
            guard = policy.guard
            assert guard is not None
            known = i > 0 and mode == "least-harm"
            assert guard.tracks[0, 2] == pytest.approx(-1.3 if known else 0.0, abs=0.5 if i == 1 else 0.08)


class _Nameless(AntwayPolicy):
    """Policy antway with a sensor that reports the same name for all, or new names in each scan, in any order."""

    def __init__(self, name: int | None) -> None:
        super().__init__()
        self.name, self.scans, self.rng = name, 0, np.random.default_rng(1)

    def act(self, observation: Observation) -> Command:
        seen, order = observation.tracks, self.rng.permutation(len(observation.tracks))
        self.scans += 1
        names = np.full(len(seen), self.name) if self.name is not None else 1_000 * self.scans + np.arange(len(seen))
        tracks = Tracks(names, seen.xy[order], seen.velocity[order], seen.radius[order])
        return super().act(replace(observation, tracks=tracks))


def _time(robot: str, policy: Callable[[], Policy | str]) -> float:
    """How long a robot takes for four drives, all of which reach the goal."""
    total = 0.0
    for one in episodes("synthetic", 2, robot):
        if one.group in ("open/medium", "aisles/medium"):
            result = run(build(one), policy(), seed=one.seed)
            check_episode(result)
            assert result.reached, one.name
            total += result.time
    return total


@cache
def _time_with_names(robot: str) -> float:
    return _time(robot, lambda: "antway")


@pytest.mark.parametrize("robot", ["", "diff"])
@pytest.mark.parametrize("name", [-1, 7, None])
def test_tracks_without_names_are_followed_by_their_places(name: int | None, robot: str) -> None:
    """A robot whose sensor gives no names, the same one twice, or ever new ones is as fast as one that is given them."""
    assert _time(robot, lambda: _Nameless(name)) <= 1.15 * _time_with_names(robot)


def test_the_nearest_of_all_pairs_keeps_its_name_first() -> None:
    """Names follow predicted places; whoever is far from all of them, or whose place is taken, gets a new one."""
    tracker = Tracker()

    def names(t: float, xy: list[tuple[float, float]]) -> list[int]:
        n = len(xy)
        tracks = Tracks(np.full(n, -1), np.array(xy), np.tile((1.0, 0.0), (n, 1)), np.full(n, 0.3))
        seen = tracker.corrected(Observation(t, (0.0, 0.0), (0.0, 0.0), 0.0, tracks))
        tracker.update(seen.tracks, t, AIR)
        return seen.tracks.id.tolist()

    a, b = names(0.0, [(1.0, 1.0), (4.0, 1.0)])
    assert names(0.0, [(4.0, 1.0), (1.0, 1.0)]) == [b, a], "the same scan again"
    assert names(0.5, [(4.5, 1.0), (1.5, 1.0)]) == [b, a]
    *new, old = names(0.6, [(9.0, 9.0), (1.9, 1.0), (1.6, 1.1)])
    assert old == a and not {a, b} & set(new) and len(set(new)) == 2
    assert names(0.7, [(4.7, 1.0)]) == [b], "unseen for one scan"


@pytest.mark.parametrize("wrong", [0.0, 0.1])
def test_covariances_that_are_too_large_are_scaled_down(wrong: float) -> None:
    """To what places show, and not below; a strict guard keeps what the sensor states."""
    rng, covariance = np.random.default_rng(1), np.tile(np.eye(4), (6, 1, 1))
    trackers = Tracker(), Tracker(True)
    for i in range(60):
        xy = np.arange(12.0).reshape(6, 2) + 0.1 * i + rng.normal(0.0, wrong, (6, 2))
        for tracker in trackers:
            tracker.update(Tracks(np.arange(6), xy, np.ones((6, 2)), np.full(6, 0.3), covariance), 0.1 * i, AIR)
    relaxed, strict = (tracker.estimates[:, SIGMA].max() for tracker in trackers)
    assert (0.02 < relaxed < 0.15 if wrong else relaxed < 0.01) and strict > 0.2
    assert trackers[0].estimates[0, SIGMA_V] < 0.5


@pytest.mark.parametrize("told", [True, False])
def test_a_strict_guard_is_given_the_places_that_the_sensor_states(told: bool) -> None:
    """Exact places with a covariance are within two standard deviations of what it is given, also if an obstacle turns."""
    policy = AntwayPolicy(mode="strict")
    policy.reset(Task(Grid(np.zeros((100, 100), np.bool_), 0.2), RobotSpec(sensor_range=20.0), (3.0, 3.0), (18.0, 3.0)), 0)
    guard = policy.guard
    assert guard is not None
    xy, covariance = np.array([[5.0, 10.0]]), np.diag([0.05**2, 0.05**2, 0.04, 0.04])[None]
    for i in range(45):
        v = 1.3 * np.array([(1.0, 0.0), (0.0, 1.0), (-0.8, 0.6)][(i > 25) + (i > 35)])
        seen = Tracks(np.array([1]), xy, v[None] if told else np.full((1, 2), math.nan), np.array([0.3]), covariance)
        policy.act(Observation(0.1 * i, (3.0, 3.0), (0.0, 0.0), 0.0, seen))
        assert math.dist(guard.tracks[0, :2], xy[0]) <= guard.spread[0] == pytest.approx(0.1)
        xy = xy + 0.1 * v


def test_covariances_count_in_every_direction() -> None:
    """The larger variance of places and of velocities counts, and either axis shows that a filter made them."""
    for x, y, filtered in ((0.04, 0.01, False), (0.01, 0.04, False), (0.04, 0.01, True), (0.01, 0.04, True)):
        covariance = np.diag([x, y, 4.0 * x, 4.0 * y])[None]
        covariance[0, 1, 3] = covariance[0, 3, 1] = 0.001 * filtered
        tracker = Tracker()
        for place in (0.0, 0.5):  # the output of a filter replaces the estimate
            tracker.update(Tracks([7], [[place, 0.0]], [[0.0, 0.0]], [0.3], covariance), place, AIR)
        assert tracker.estimates[0, SIGMA_V] == pytest.approx(0.4) if filtered else tracker.estimates[0, SIGMA_V] < 0.39
        assert (tracker.estimates[0, X] == 0.5) == filtered


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("place", [0, -1])
def test_of_hundreds_of_obstacles_the_nearest_count(place: int, mode: str) -> None:
    """One that stands in the way of the robot is known, wherever it is listed among 350 without velocities."""
    rng = np.random.default_rng(0)
    xy = np.column_stack((rng.uniform(1.0, 39.0, 350), rng.uniform(26.0, 39.0, 350)))
    xy[place] = 8.0, 20.0
    policy = AntwayPolicy(mode=mode)
    policy.reset(Task(Grid(np.zeros((160, 160), bool), 0.25), RobotSpec(), (5.0, 20.0), (12.0, 20.0)), 0)
    tracks = Tracks(np.arange(350), xy, np.full((350, 2), math.nan), np.full(350, 0.5))
    for k in range(3):
        policy.act(Observation(0.1 * k, (5.0, 20.0), (0.0, 0.0), 0.0, tracks))
        assert tracks.id[place] in policy.state.tracker.estimates[:, ID]


@pytest.mark.parametrize("half", [(0.0, math.nan), (math.nan, 1.0)])
def test_half_a_velocity_is_none(half: tuple[float, float]) -> None:
    """A track of which one axis alone is measured is estimated like one without a velocity, and stays known."""
    found = []
    for told in ((math.nan, math.nan), half):
        tracker = Tracker()
        for k in range(10):
            tracks = Tracks([3], [[1.0 + 0.1 * k, 2.0]], [told], [0.3])
            seen = tracker.corrected(Observation(0.1 * k, (0.0, 0.0), (0.0, 0.0), 0.0, tracks))
            tracker.update(seen.tracks, 0.1 * k, AIR)
        found.append(tracker.estimates.copy())
    assert np.isfinite(found[1]).all() and np.array_equal(*found)


@pytest.mark.parametrize("robot", ["", "diff"])
def test_swapped_names_are_put_right(robot: str) -> None:
    """A robot whose sensor swaps names again and again is nearly as fast as one whose sensor does not."""
    often = partial(swaps, share=0.1)
    assert _time(robot, lambda: Untold(AntwayPolicy(), often)) <= 1.1 * _time_with_names(robot)


def test_whatever_names_a_sensor_gives_a_body_keeps_its_own() -> None:
    """Of bodies a metre apart, some unseen in each scan, everyone keeps the name of the first scan, however names are dealt."""
    rng = np.random.default_rng(2)
    for _ in range(cases(20, 500)):
        n, t, tracker = int(rng.integers(2, 7)), 0.0, Tracker()
        xy, v, names = np.column_stack((rng.uniform(0, 9, n), np.arange(n))), rng.uniform(-1.5, 1.5, n), np.arange(n)
        for i in range(30):
            if rng.random() < 0.3:
                names = rng.permutation(n)
            seen = rng.permutation(np.flatnonzero((rng.random(n) < 0.8) | (i == 0)))
            velocity = np.column_stack((v, np.zeros(n)))
            given = np.arange(n) if i == 0 else names
            tracks = Tracks(given[seen], xy[seen], velocity[seen], np.full(len(seen), 0.3))
            found = tracker.corrected(Observation(t, (0.0, 0.0), (0.0, 0.0), 0.0, tracks)).tracks
            assert found.id.tolist() == seen.tolist()
            tracker.update(found, t, AIR)
            t, xy = t + 0.1, xy + velocity * 0.1


def test_the_largest_names_are_kept_as_far_as_floats_hold_them() -> None:
    """A sensor may count to 2^63 - 1; filtered tracks then have a name that both floats and whole numbers of 64 bits hold."""
    most, policy = 2**63 - 1, AntwayPolicy()
    policy.reset(Task(Grid(np.zeros((50, 50), np.bool_), 0.2), RobotSpec(), (1.0, 5.0), (9.0, 5.0)), 1)
    for i in range(3):
        tracks = Tracks(np.array([4, most]), np.array([[6.0, 5.0], [7.0, 6.0]]), np.full((2, 2), math.nan), np.full(2, 0.3))
        seen = Observation(0.1 * i, (3.0, 5.0), (0.0, 0.0), 0.0, tracks)
        policy.act(seen)
        assert policy.state is not None
        names = policy.state.tracker.for_guard(seen).tracks.id
        assert names.tolist() == [4, most - 1023]


def test_a_name_is_believed_where_no_other_track_is_nearer() -> None:
    """Whoever jumps, or turns, keeps its name if nobody else was expected there; a taken name goes to whom it fits."""
    tracker = Tracker()

    def names(t: float, ids: list[int], x: list[float]) -> list[int]:
        n = len(x)
        tracks = Tracks(np.array(ids), np.column_stack((x, np.ones(n))), np.tile((1.0, 0.0), (n, 1)), np.full(n, 0.3))
        seen = tracker.corrected(Observation(t, (0.0, 0.0), (0.0, 0.0), 0.0, tracks))
        tracker.update(seen.tracks, t, AIR)
        return seen.tracks.id.tolist()

    assert names(0.0, [4, 5], [1.0, 6.0]) == [4, 5]
    assert names(0.1, [4, 5], [0.6, 6.1]) == [4, 5], "0.5 m from where it was expected, and nobody was expected there"
    assert names(0.2, [5, 9], [3.0, 6.2]) == [FIRST_OWN_ID, 5], (
        "the name 5 is given to somebody new, and another one to who had it"
    )
    assert names(0.3, [5, 9, 4], [3.1, 6.3, 0.8]) == [FIRST_OWN_ID, 5, 4]


@pytest.mark.parametrize("measured", [True, False])
def test_noise_is_told_from_innovations(measured: bool) -> None:
    """That of places is found to within a third, with velocities or without, and that of velocities; exact ones have none."""
    rng = np.random.default_rng(3)
    errors = np.random.default_rng(8)
    for sigma, speed in (*((one, 0.0) for one in (0.0, 0.02, 0.05, 0.1)), (0.02, 0.1), (0.05, 0.1), (0.05, 0.3), (0.1, 0.3)):
        xy, v, t, scans = rng.uniform(0, 9, (8, 2)), rng.uniform(-1, 1, (8, 2)), 0.0, []
        for _ in range(300):
            v = np.where(rng.random((8, 1)) < 0.03, rng.uniform(-1, 1, (8, 2)), v)
            velocity = v + errors.normal(0.0, 1.0, (8, 2)) * speed if measured else np.full((8, 2), math.nan)
            scans.append((t, np.arange(8), xy + rng.normal(0, sigma, (8, 2)) if sigma else xy.copy(), velocity))
            dt = 0.1 if measured else rng.uniform(0.05, 0.2)
            xy, t = xy + v * dt, t + dt
        table, state, found = make_table(16, noise.COLUMNS), np.zeros(noise.STATE), []
        for t, ids, places, velocity in scans:
            found.append(noise.measured_noise(*table[:2], state, t, ids, places, velocity))
        late = noise.measured_noise(*table[:2], state, t + 0.6, ids, places + 5.0, velocity)
        assert late == found[-1], "places that are so far apart in time are not compared"
        slow = naive.measured_noise(scans)
        assert math.sqrt(found[-1][0]) == pytest.approx(sigma, rel=0.34, abs=1e-3)
        assert np.sqrt(np.mean(found[-100:], axis=0)) == pytest.approx([sigma, speed if measured else 0.0], rel=0.2, abs=1e-3)
        assert math.sqrt(found[20][0]) == pytest.approx(sigma, rel=0.5, abs=5e-3)  # after two seconds
        assert np.sqrt(slow) == pytest.approx([sigma, speed if measured else 0.0], rel=0.1, abs=1e-3)


@pytest.mark.parametrize("tracks", [1, 2, 8])
def test_noise_is_known_from_the_sixth_innovation_on(tracks: int) -> None:
    """It is that of the median of all innovations so far, and so is that of velocities; before, none is known."""
    rng = np.random.default_rng(tracks)
    table, state, scans = make_table(16, noise.COLUMNS), np.zeros(noise.STATE), []
    for i in range(16 // tracks + 1):
        scan = 0.1 * i, np.arange(tracks), 0.1 * i + rng.normal(0, 0.05, (tracks, 2)), rng.normal(1, 0.1, (tracks, 2))
        scans.append(scan)
        found = noise.measured_noise(*table[:2], state, *scan)
        if i * tracks >= 6:
            assert found == pytest.approx(naive.measured_noise(scans)), "the slow twin has true medians"
        else:
            assert found[0] < noise.EXACT


@pytest.mark.parametrize("stated", [None, 0.0, 0.005])
def test_who_was_taken_to_be_seen_exactly_is_not_once_noise_shows(stated: float | None) -> None:
    """Estimates from the first scans, whose places are wrong, come near to the true places within a second.

    With the variance 0 of an exact place, no later place had any weight, and robots touched people whom they had seen from the
    start. The same goes for a sensor that states no such errors, or far too small ones.
    """
    covariance = None if stated is None else np.tile(np.diag([stated**2, stated**2, 0.0, 0.0]), (3, 1, 1))
    rng, errors = np.random.default_rng(2), []
    terrain = terrain_of(Grid(np.zeros((40, 40), bool), 0.5))
    velocity = np.array([[0.5, 0.0], [0.0, -0.4], [0.3, 0.3]])
    for _ in range(50):
        tracker, true = Tracker(), rng.uniform(5.0, 15.0, (3, 2))
        for i in range(11):
            seen = true + 0.1 * i * velocity + rng.normal(0.0, 0.05, (3, 2))
            tracker.update(Tracks(np.arange(3), seen, velocity, np.full(3, 0.3), covariance), 0.1 * i, terrain)
        gap = np.hypot(*(tracker.estimates[:, :2] - true - velocity).T)
        errors += (gap / tracker.estimates[:, SIGMA]).tolist()
        assert gap.max() < 0.06
    assert np.mean(np.square(errors)) == pytest.approx(2.0, rel=0.5), "the stated standard deviation is that along each axis"


def test_variances_are_raised_as_if_measurements_had_been_so_wrong_from_the_start() -> None:
    """As a filter over the same times finds them, whose measurements are that wrong; those of exact places become theirs."""
    for before in (0.01**2, 0.02**2):
        found = []
        for variance in (before, 0.05**2):
            table, estimates = make_table(4, kalman.COLUMNS, ID), np.zeros((4, 8))
            for i in range(20):
                still = np.zeros((1, 2)), np.zeros((1, 2)), np.full(1, 0.3), np.array([[variance, 1e-12]])
                kalman.update(*table[:2], 0.1 * i, np.zeros(1, np.int64), *still, 0.0, estimates)
            if variance == before:
                kalman.raise_variances(*table[:2], np.array([before, 0.0]), np.array([0.05**2, 0.0]))
            found.append(table.rows[0, kalman.P11])
        assert found[0] == pytest.approx(found[1], rel=1e-6)
    table.rows[0, kalman.P11] = 0.0
    kalman.raise_variances(*table[:2], np.zeros(2), np.array([0.05**2, 0.1**2]))
    assert table.rows[0, [kalman.P11, kalman.P22]] == pytest.approx([0.05**2, 0.1**2])


def test_what_wrong_velocities_taught_of_places_is_forgotten() -> None:
    """Places are exact, but all velocities are reported as 0, so that places seem to be wrong. A second later all are known."""
    rng, terrain = np.random.default_rng(6), terrain_of(Grid(np.zeros((40, 40), bool), 0.5))
    for _ in range(20):
        tracker, true, velocity = Tracker(), rng.uniform(5.0, 15.0, (3, 2)), rng.uniform(0.3, 0.8, (3, 2))
        for i in range(14):
            tracks = Tracks(np.arange(3), true + 0.1 * i * velocity, np.zeros((3, 2)), np.full(3, 0.3))
            seen = tracker.corrected(Observation(0.1 * i, (1.0, 1.0), (0.0, 0.0), 0.0, tracks))
            tracker.update(seen.tracks, 0.1 * i, terrain)
        assert tracker.doubts_velocities
        assert tracker.estimates[:, VX : VY + 1] == pytest.approx(velocity, abs=0.02)
        assert tracker.estimates[:, X : Y + 1] == pytest.approx(true + 1.3 * velocity, abs=0.01)
        assert tracker.estimates[:, SIGMA].max() < 0.01


@pytest.mark.parametrize("robot", ["holonomic", "diff", "jackal"])
def test_a_robot_waits_calmly_for_somebody_who_sways(robot: str) -> None:
    """Who stands in the only doorway sways by 3 cm. It seemed to open now left, now right, and robots ran to and fro."""
    blocked = np.zeros((40, 60), bool)
    blocked[:17, 29:31] = blocked[23:, 29:31] = True
    t = np.arange(0.0, 22.0, 0.1)
    sways = [(6.0 + 0.03 * math.sin(1.1 * s + 0.3), 4.0 + 0.03 * math.sin(0.7 * s + 1.0)) for s in t.tolist()]
    stands = Replay((*t.tolist(), 27.4), (*sways, (11.4, 4.0)))
    world = World(Grid(blocked, 0.2), (Obstacle(0.3, stands),))
    scenario = Scenario(world, (2.0, 4.0), (10.0, 4.0), robot=load_robot(robot), obstacle_speed=1.5)
    result = run(scenario, "antway", seed=1)
    check_episode(result)
    assert result.reached and result.trace is not None
    waits = (result.trace.t > 8.0) & (result.trace.t < 19.0)
    assert np.hypot(*np.diff(result.trace.xy[waits], axis=0).T).sum() < 0.7, "m in 11 s"


def test_velocities_that_lead_to_exact_places_are_exact() -> None:
    """Whoever sways changes a velocity in each scan, but is where it leads: there is no noise, though it looks like 0.1 m/s."""
    table, state, xy, rng = (
        make_table(16, noise.COLUMNS),
        np.zeros(noise.STATE),
        np.arange(16.0).reshape(8, 2),
        np.random.default_rng(1),
    )
    velocity = np.ones((8, 2))
    for i in range(100):
        assert noise.measured_noise(*table[:2], state, 0.1 * i, np.arange(8), xy, velocity) == (0.0, 0.0)
        before, velocity = velocity, 1.0 + rng.normal(0.0, 0.1, (8, 2))
        xy = xy + 0.05 * (before + velocity)
    assert math.sqrt(state[noise.VELOCITY] / noise.MEDIAN) == pytest.approx(0.1, rel=0.4)


WRONG_VELOCITIES: dict[str, Callable[[np.ndarray, np.random.Generator], np.ndarray]] = {
    "zero": lambda v, rng: np.zeros(v.shape),
    "noise": lambda v, rng: v + rng.normal(0.0, 0.3, v.shape),
    "too large": lambda v, rng: 1.3 * v,
}


@pytest.mark.parametrize("how", ["right", "none", "of noisy places", *WRONG_VELOCITIES])
def test_velocities_that_do_not_fit_places_are_noticed(how: str) -> None:
    """Kernel and slow twin agree after each scan; wrong velocities are noticed in a second, right ones are never called so."""
    rng = np.random.default_rng(4)
    for _ in range(cases(5, 100)):
        xy, v, t, scans = rng.uniform(0, 9, (4, 2)), rng.uniform(0.5, 1.2, (4, 2)), 0.0, []
        for _ in range(40):
            v = np.where(rng.random((4, 1)) < 0.02, rng.uniform(-1.2, 1.2, (4, 2)), v)
            told = WRONG_VELOCITIES[how](v, rng) if how in WRONG_VELOCITIES else v * (math.nan if how == "none" else 1.0)
            seen = rng.random(4) < 0.9
            places = xy + rng.normal(0.0, 0.05, xy.shape) * (how == "of noisy places")
            scans.append((t, np.flatnonzero(seen), places[seen], told[seen]))
            dt = float(rng.choice([0.1, 0.2, 0.6], p=[0.8, 0.18, 0.02]))
            xy, t = xy + v * dt, t + dt
        for span in reported.SPANS:
            table, state = make_table(16, reported.COLUMNS), np.zeros(3)
            found = [reported.wrong(*table[:2], state, *scan, span) for scan in scans]
            assert found == naive.velocities_are_wrong(scans, *span)
            if how in WRONG_VELOCITIES and span[0] == 0.0:
                assert all(found[10:])
            elif how in ("right", "none", "of noisy places"):
                assert not any(found)


@pytest.mark.parametrize("robot", ["", "diff"])
@pytest.mark.parametrize("how", WRONG_VELOCITIES)
def test_a_robot_arrives_though_its_sensor_reports_wrong_velocities(how: str, robot: str) -> None:
    """It is nearly as fast as with right ones, and says that those reported are not used."""

    def wrong(rng: np.random.Generator) -> Told:
        return lambda tracks: replace(tracks, velocity=WRONG_VELOCITIES[how](tracks.velocity, rng))

    for one in episodes("synthetic", 1, robot):
        if one.group == "open/medium":
            policy = Untold(AntwayPolicy(), wrong)
            result, right = run(build(one), policy, seed=one.seed), run(build(one), "antway", seed=one.seed)
            check_episode(result)
            assert result.reached and result.time <= 1.1 * right.time
            assert "do not fit their places" in policy.explain().reason


@pytest.mark.parametrize("chance", [0.05, 0.2])
def test_tubes_hold_on_the_model_of_the_filter(chance: float) -> None:
    """On white acceleration the share outside of a tube is `chance`, to a point, at 0.5, 1, 2 and 4 s (C46)."""
    rng, n, dt, density = np.random.default_rng(4), cases(40_000, 400_000), 0.05, 0.2
    p11, p12, p22 = 0.01, 0.005, 0.04
    error = rng.multivariate_normal((0.0, 0.0), ((p11, p12), (p12, p22)), (n, 2))
    place, velocity = error[..., 0], error[..., 1]
    for i in range(1, 81):
        kick = rng.normal(0.0, math.sqrt(density * dt), (n, 2))
        place, velocity = place + velocity * dt + kick * dt / 2, velocity + kick
        if i * dt in (0.5, 1.0, 2.0, 4.0):
            radius = tube_radius(place_variance(p11, p12, p22, density, i * dt), chance, math.inf)
            assert (np.hypot(*place.T) > radius).mean() == pytest.approx(chance, abs=0.01)


def test_the_variance_of_people_is_that_of_white_acceleration() -> None:
    """Places that start with the variances of a person spread as predicted, to 3 %, after 0.5, 1, 2 and 4 s."""
    rng, n, dt, sway = np.random.default_rng(4), 20_000, 0.05, 0.3
    own = 0.5 * sway**2 - PEOPLE_DENSITY * LATER / 3
    place, velocity = rng.normal(0.0, 0.01, n), rng.normal(0.0, math.sqrt(own), n)
    for i in range(1, 81):
        kick = rng.normal(0.0, math.sqrt(PEOPLE_DENSITY * dt), n)
        place, velocity = place + velocity * dt + kick * dt / 2, velocity + kick
        if i * dt in (0.5, 1.0, 2.0, 4.0):
            assert place.var() == pytest.approx(people_variance(sway, i * dt), rel=0.03)


def test_tubes_of_people_hold_on_their_law() -> None:
    """Of Student's t in two dimensions the tube leaves out `chance`, to a point (C46)."""
    rng, n = np.random.default_rng(5), 100_000
    places = rng.normal(size=(n, 2)) / np.sqrt(rng.chisquare(PEOPLE_DOF, n) / PEOPLE_DOF)[:, None]
    for chance in (0.05, 0.2):
        assert (np.hypot(*places.T) > tube_radius(1.0, chance, PEOPLE_DOF)).mean() == pytest.approx(chance, abs=0.01)


@needs_data
def test_recorded_people_are_predicted_no_worse_than_by_constant_velocity() -> None:
    """On every recording the errors are at most 3 % above those of constant velocity, and on the noisy ones well below."""
    for name, most in (("eth", 0.9), ("zara01", 1.03), ("citr", 0.8)):
        told = forecast(str(SHARED / "tracks" / f"{name}.csv"))
        for horizon, own, constant in told.fde:
            assert own < most * constant, (name, horizon)


@pytest.mark.parametrize("mode", ["strict", "least-harm"])
def test_people_that_appear_vanish_swap_names_stop_and_run(mode: str) -> None:
    """Whatever sensors make of people, a policy commands; a strict guard has no contact in motion with who is seen."""
    rng, dt = np.random.default_rng(6), 0.1
    for _ in range(cases(3, 100)):
        task = Task(Grid(np.zeros((60, 60), np.bool_), 0.2), RobotSpec(), (1.0, 6.0), (11.0, 6.0), obstacle_speed=2.5)
        policy = AntwayPolicy(mode=mode, expansions=500)
        policy.reset(task, 1)
        xy, v, names = rng.uniform(3, 11, (6, 2)), rng.uniform(-1.3, 1.3, (6, 2)), np.arange(6)
        at, velocity = np.array([1.0, 6.0]), np.zeros(2)
        for i in range(60):
            if i % 7 == 3:
                v[rng.integers(6)] = 0.0  # one stops
            if i % 11 == 5:
                v[rng.integers(6)] = rng.uniform(-1.7, 1.7, 2)  # one runs
            if i % 13 == 6:
                names = rng.permutation(names)  # names are swapped
            seen = rng.random(6) < 0.9  # some vanish and appear
            tracks = Tracks(names[seen], xy[seen].copy(), v[seen].copy(), np.full(int(seen.sum()), 0.3))
            command = policy.act(Observation(i * dt, tuple(at), tuple(velocity), 0.0, tracks))
            assert all(map(math.isfinite, command.velocity))
            velocity = np.array(command.velocity)
            before = np.hypot(*(xy - at).T)
            at, xy = at + velocity * dt, xy + v * dt
            if mode == "strict" and math.hypot(*velocity) > 1e-9 and seen[int(np.argmin(before))]:
                nearest = int(np.argmin(before))
                assert math.dist(xy[nearest], at) > 0.6 - 1e-6


OPEN_EDGES = terrain_of(Grid(np.zeros((40, 40), np.bool_), 0.2))


def _segments(x: float, v: float, **more: float | bool) -> np.ndarray:
    """The motion segments of a disc of 0.3 m at (x, 4.0) with the velocity (v, 0), for a robot far away."""
    estimates = np.array([[x, 4.0, v, 0.0, 0.3, 0.0, 0.1, 1.0]])
    margins = TubeMargins(0.3, 0.03, 0.5, 1.5, math.inf, 0.1, 2.2)._replace(**more)
    out = np.empty((32, 8))
    return out[: predict(estimates, 0.0, 0.0, 4.0, 1.0, 1.0, margins, OPEN_EDGES, NO_PREDICTIONS, out)]


def test_obstacles_turn_back_at_edges_until_one_is_seen_to_cross_them() -> None:
    """At an edge a disc is mirrored, or goes on where edges are open; one whose centre is beyond the map tells."""
    closed, ended = _segments(7.0, 1.0), _segments(7.0, 1.0, edges=False)
    for rows, last, place in ((closed, -1.0, 4.4), (ended, 1.0, 11.0)):
        t0, t1, x, _, vx = rows[-1, :5]
        assert vx == last and t1 == 4.0 and x + vx * (t1 - t0) == pytest.approx(place)
    for x, crosses in ((7.7, False), (7.9, False), (8.1, True), (8.6, True), (0.1, False), (-0.1, True)):
        for place in ((x, 4.0), (4.0, x)):
            assert crosses_edge(np.array([[*place, 1.0, 0.0, 0.3, 0.0, 0.0, 1.0]]), OPEN_EDGES) == crosses
    walls = np.zeros((40, 40), np.bool_)
    walls[:, 38:] = True
    walled = terrain_of(Grid(walls, 0.2))
    estimates, out = np.array([[7.0, 4.0, 1.0, 0.0, 0.3, 0.0, 0.0, 1.0]]), np.empty((32, 8))
    margins = TubeMargins(0.3, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, edges=False)
    n = predict(estimates, 0.0, 0.0, 4.0, 1.0, 1.0, margins, walled, NO_PREDICTIONS, out)
    assert out[n - 1, 4] == -1.0  # walls inside the map turn it back in any case


def test_margins_are_narrow_where_nobody_sways() -> None:
    """To discs that go straight plans keep their margin and no more within four seconds; from people who sway more."""
    rng, wrong = np.random.default_rng(3), []
    for sway, narrow in ((0.0, True), (0.15, False), (0.3, False)):
        policy = AntwayPolicy()
        policy.reset(Task(Grid(np.zeros((60, 60), np.bool_), 0.2), RobotSpec(), (2.0, 2.0), (2.0, 10.0)), seed=1)
        xy, held = np.array([[4.0 + i, 3.0 + 1.5 * i] for i in range(5)]), np.array([[0.4, 0.1]] * 5)
        for k in range(40):
            velocity = held + rng.normal(0.0, sway, (5, 2))
            policy.act(Observation(0.1 * k, (2.0, 2.0), (0.0, 0.0), 0.0, Tracks(np.arange(5), xy, velocity, np.full(5, 0.3))))
            xy = xy + 0.1 * velocity
        known, filtered = policy.state.crowd.tracks.averaged[:5], policy.state.tracker.estimates[:5]
        assert (known[:, SIGMA_V].max() < 0.02) == narrow == np.array_equal(known[:, :4], filtered[:, :4])
        wrong.append(float(known[:, SIGMA_V].mean()))
    assert wrong == sorted(wrong)


def test_a_track_out_of_sight_crosses_no_edge() -> None:
    """Where a track would be that is not seen any more says nothing of edges; where one is seen does."""
    grid = Grid(np.zeros((40, 40), np.bool_), 0.2)
    policy = AntwayPolicy()
    policy.reset(Task(grid, RobotSpec(), (2.0, 4.0), (6.0, 4.0)), seed=1)
    for k, seen in ((0, 7.5), (1, 7.6), (2, None), (8, None), (9, 8.1)):
        assert policy.state.settings.tubes.edges
        one = Tracks(np.array([3]), np.array([[seen, 1.0]]), np.array([[1.0, 0.0]]), np.array([0.3])) if seen else Tracks.none()
        policy.act(Observation(0.1 * k, (2.0, 4.0), (0.0, 0.0), 0.0, one))
    assert not policy.state.settings.tubes.edges


def test_room_to_spare_grows_with_time_and_is_never_more_than_there_is() -> None:
    """Of 3 s times 0.1 m/s a third is kept for 0.5 s, two thirds for 1 s, then all; near the robot what there is."""
    plain, swaying, roomy = _segments(7.0, 0.1), _segments(7.0, 0.1, drift_time=0.2), _segments(7.0, 0.1, extra_drift_time=3.0)
    assert (swaying[:, 6] - plain[:, 6]).tolist() == pytest.approx([0.02, 0.02, 0.02])
    assert (roomy[:, 6] - plain[:, 6]).tolist() == pytest.approx([0.1, 0.2, 0.3])
    estimates, out = np.array([[1.8, 1.0, 0.0, 0.0, 0.3, 0.0, 0.1, 1.0]]), np.empty((32, 8))
    for extra in (0.0, 0.1, 0.5):
        margins = TubeMargins(0.3, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf, extra_drift_time=10.0 * extra)
        n = predict(estimates, 0.0, 0.0, 4.0, 1.0, 1.0, margins, OPEN_EDGES, NO_PREDICTIONS, out)
        assert out[n - 1, 6] == pytest.approx(0.6 + min(extra, 0.2), abs=1e-5)


@pytest.mark.parametrize("factor", [0.3, 1.0, 3.0])
def test_tubes_are_learnt_to_hold_whatever_people_do(factor: float) -> None:
    """Of tubes far too narrow or wide at first, on errors whose spread doubles half way, `chance` leave to 3 points."""
    rng, n = np.random.default_rng(9), 6000
    now = np.repeat(np.arange(n // 6) * 0.4, 6)
    error = np.abs(rng.standard_t(3.0, n)) * np.where(np.arange(n) < n // 2, 0.1, 0.2)
    for chance in (0.05, 0.2):
        left = left_tubes(now, error, np.full(n, 0.3), 2.0, chance, factor)
        assert left.mean() == pytest.approx(chance, abs=0.03)
        assert left[-2000:].mean() == pytest.approx(chance, abs=0.03)
    # Nothing counts before its time has come: the first tubes are as they were fitted.
    first = now < 2.0
    assert (left_tubes(now, error, np.full(n, 0.3), 2.0, 0.05, factor)[first] == (error[first] > 0.3 * factor)).all()


@pytest.mark.parametrize(("ahead", "left"), [(1.0, [True, False, True]), (1.5, [True, True, False])])
def test_a_prediction_teaches_once_its_time_has_come(ahead: float, left: list[bool]) -> None:
    """The factor is 1, then e^0.016 = 1.0161 after one who left, and 1.0121 after another who did not, a second later."""
    error, now = np.array([2.0, 1.01, 1.013]), np.arange(3.0)
    assert left_tubes(now, error, np.ones(3), ahead, 0.2, 1.0).tolist() == left
    assert left_tubes(now, 0.5 * error, np.full(3, 0.5), ahead, 0.2, 1.0).tolist() == left
    for chance, dof in ((0.05, 3.0), (0.2, 5.0)):
        assert (1.0 + tube_radius(0.3, chance, dof) ** 2 / (dof * 0.3)) ** (-dof / 2.0) == pytest.approx(chance)
    assert math.exp(-(tube_radius(0.3, 0.05, math.inf) ** 2) / 0.6) == pytest.approx(0.05)


@pytest.mark.parametrize("people", [10, 100])
def test_tubes_hold_in_crowds_that_are_recorded_often(people: int) -> None:
    """Of tubes that are right at first, 30 times a second for 12 s, `chance` leave to 3 points, though all are judged late."""
    rng = np.random.default_rng(9)
    now = np.repeat(np.arange(360) / 30, people)
    error = np.repeat(np.abs(rng.standard_t(3.0, 24 * people)).reshape(24, people), 15, axis=0).ravel()  # anew each 0.5 s
    for chance in (0.05, 0.2):
        radius = np.quantile(error, 1.0 - chance)
        assert left_tubes(now, error, np.full(len(now), radius), 4.0, chance, 1.0).mean() == pytest.approx(chance, abs=0.03)


def test_the_mean_error_of_forecasts_is_that_of_a_loop(tmp_path: Path) -> None:
    """Each time up to the horizon counts once; what the record is too short for is NaN, and a dash in the table.

    Constant velocity is that over the last 0.4 s, however often a record tells places.
    """
    rng, file = np.random.default_rng(3), tmp_path / "t.csv"
    for each in (4, 1):  # rows in 0.4 s
        xy = np.cumsum(rng.normal(0.4, 0.1, (20 * each, 2)), axis=0) / each
        file.write_text("".join(f"{0.4 * k / each},7,{x},{y}\n" for k, (x, y) in enumerate(xy.tolist())))
        found, errors = forecast(str(file)), []
        for k in range(2 * each, (20 - 12) * each):
            ahead = [xy[k] + (xy[k] - xy[k - each]) * n - xy[k + n * each] for n in range(1, 13)]
            errors.append(np.hypot(*np.transpose(ahead)).mean())
        assert found.ade[2][2] == pytest.approx(np.mean(errors), abs=1e-9)
    file.write_text("".join(file.read_text().splitlines(keepends=True)[:8]))
    short = forecast(str(file))
    assert math.isfinite(short.fde[0][1]) and math.isnan(short.fde[2][1])
    assert "| 4.8 s | - | - | - | - |" in markdown(short)
    file.write_text("0,1,0,0\n0,2,1,1\n")
    with pytest.raises(BadScenario):
        forecast(str(file))


@needs_data
@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("name", ["eth", "zara01", "citr"])
def test_tubes_hold_on_recordings(name: str, factor: float) -> None:
    """On each recording the share outside is `chance` to 3 points, though tubes are half or twice as wide at first."""
    for chance, time, share in forecast(str(SHARED / "tracks" / f"{name}.csv"), factor=factor).outside:
        assert share == pytest.approx(chance, abs=0.03), (chance, time)


def _estimates(*people: tuple[float, float, float, float], sway: float = 0.15) -> np.ndarray:
    rows = np.zeros((len(people), 8))
    rows[:, [X, Y, VX, VY]] = people
    rows[:, RADIUS], rows[:, SIGMA_V], rows[:, ID] = 0.3, sway, np.arange(len(people))
    return rows


def test_chance_of_contact_is_nearly_what_its_slow_twin_finds() -> None:
    """What is expected of a motion beside a plan is what dense sampling finds, which looks at more than nearest approaches."""
    rng, some = np.random.default_rng(5), 0
    steps = sidestep.STEPS
    for _ in range(cases(60, 2000)):
        places = np.vstack((np.zeros(2), np.cumsum(rng.uniform(-0.07, 0.07, (steps, 2)), axis=0)))
        people = _estimates(*np.column_stack((rng.uniform(-1.5, 1.5, (3, 2)), rng.uniform(-1.5, 1.5, (3, 2)))))
        aside, age = tuple(rng.uniform(-1.0, 1.0, 2)), float(rng.uniform(0.0, 0.1))
        ahead, hold = float(rng.uniform(0.3, 1.0)), float(rng.uniform(0.1, 0.3))
        found = sidestep.chance_of_contact(places, aside, people, age, 0.3, math.inf, ahead, hold)
        slow = naive.chance_of_contact(places, aside, people, age, 0.3, ahead, hold)
        assert found <= slow + 1e-6 and found == pytest.approx(slow, abs=0.03)
        some += slow > 0.1
    assert some > 10


def test_a_step_aside_leaves_a_person_who_walks_alongside_more_clearance() -> None:
    """Beside one 3 cm away the robot turns off and goes on; with nobody near it does as its plan says."""
    grid = Grid(np.zeros((100, 100), np.bool_), 0.2)
    context = make_context(grid, RobotSpec(radius=0.3, v_max=1.0), (50, 99))
    knots = np.array([[0.0, 10.0, 10.1], [8.0, 18.0, 10.1]])
    for y, turns in ((10.73, True), (13.0, False)):
        people = _estimates((10.0, y, 1.0, 0.0))
        vx, vy = sidestep.sidestep(knots, 0.0, 0.0, (10.0, 10.1), (1.0, 0.0), people, context, 0.1, 0.0)
        assert (vy < -0.1 and vx > 0.2) if turns else (vx, vy) == (1.0, 0.0)


def test_chance_by_turns_is_what_its_slow_twin_finds() -> None:
    """The share of the angles by which tracks turn into a robot is in closed form what many angles show."""
    rng, some = np.random.default_rng(6), 0
    for _ in range(cases(200, 5000)):
        people = _estimates(*np.column_stack((rng.uniform(-1.2, 1.2, (3, 2)), rng.uniform(-2.5, 2.5, (3, 2)))))
        people[0, VX : VY + 1] *= rng.integers(2)  # one may stand
        where = *rng.uniform(-0.5, 0.5, 2), people, float(rng.uniform(0.0, 0.1)), 0.3, float(rng.uniform(0.05, 0.3))
        outside = np.hypot(*(people[:, :2] + where[3] * people[:, VX : VY + 1] - where[:2]).T) > 0.6
        where = *where[:2], people[outside], *where[3:]
        found = sidestep.chance_by_turns(*where)
        assert found == pytest.approx(naive.chance_by_turns(*where), abs=0.003)
        some += found > 0.05
    assert some > 20


def test_a_step_aside_counts_with_turns_where_obstacles_turn() -> None:
    """Beside somebody fast who keeps his velocity the robot keeps to its plan; where such people turn back, it makes room."""
    grid = Grid(np.zeros((100, 100), np.bool_), 0.2)
    context = make_context(grid, RobotSpec(radius=0.3, v_max=2.0), (50, 99))
    knots, people = np.array([[0.0, 10.0, 10.1], [4.0, 18.0, 10.1]]), _estimates((10.1, 10.8, 2.0, 0.0), sway=0.0)
    for turns in (0.0, 1.0):
        vx, vy = sidestep.sidestep(knots, 0.0, 0.0, (10.0, 10.1), (2.0, 0.0), people, context, 0.1, turns)
        assert (vy < -0.5) if turns else (vx, vy) == (2.0, 0.0)
