"""Detours around obstacles that stay in a doorway, and the record of how long they have stayed."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import EpisodeResult, Grid, Moves, RobotSpec, Scenario, World, check_episode, run
from antway.kernels.tracking import stays
from antway.kernels.tracking.predict import ID, RADIUS, VX, VY, X, Y
from antway.kernels.tracking.stays import COLUMNS, update_stays
from antway.kernels.tracking.table import SEEN, TRACK_ID, make_table, rows_in_use
from antway.policies.antway import detours
from antway.policies.antway.detours import Detours
from antway.policies.antway.nodes import make_context
from antway.policies.antway.tracker import Tracker
from antway.world.motions import BackAndForth, Line, Motion, Replay
from antway.world.policy import Tracks
from antway.world.robots import load_robot
from antway.world.sensor import Sensor
from antway.world.terrain import terrain_of
from antway.world.world import Obstacle
from common import cases, costly
from naive import people as naive

DOOR = (8.0, 2.6)  # m; centre of the near doorway
STANDS = Line(DOOR, (DOOR[0], DOOR[1] + 0.001), speed=0.001)


def two_doors(far_door: bool = True) -> Grid:
    """Return two rooms of 8 x 16 m, joined by a doorway of 1.2 m and by another that is 11 m away."""
    blocked = np.zeros((80, 80), np.bool_)
    blocked[:, 38:42] = True
    blocked[10:16, 38:42] = False
    if far_door:
        blocked[68:76, 38:42] = False
    return Grid(blocked, 0.2)


def scenario(robot: str, motion: Motion, far_door: bool = True, horizon: float = 200.0) -> Scenario:
    """Return the drive through the near doorway, in which an obstacle stays."""
    world = World(two_doors(far_door), [Obstacle(0.3, motion)])
    return Scenario(world=world, robot=load_robot(robot), start=(3.0, 4.0), goal=(13.0, 4.0), horizon=horizon)


def checked(drive: Scenario, policy: str = "antway") -> EpisodeResult:
    """Run the episode and check it."""
    result = run(drive, policy, seed=0)
    check_episode(result)
    return result


@pytest.mark.parametrize("robot", ["holonomic", "inertia", "diff", "turtlebot4", "jackal", "amr"])
@pytest.mark.parametrize("motion", [STANDS, BackAndForth((8.0, 2.35), (8.0, 2.85), speed=0.5)], ids=["stands", "to and fro"])
def test_a_robot_goes_round_what_stays_in_a_doorway(robot: str, motion: Motion) -> None:
    """It waits for no longer than the detour of 20 m takes. `amr` is too wide for the near doorway anyway."""
    drive = scenario(robot, motion)
    result = checked(drive)
    way_there, detour = 10.5, 20.0
    assert result.reached and result.time < (way_there + 2.2 * detour) / drive.robot.v_max


@pytest.mark.parametrize("robot", ["holonomic", "diff", "inertia", "turtlebot4", "jackal"][: costly(2, 5)])
def test_without_detours_it_waits_forever(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The test above can fail."""
    monkeypatch.setattr(detours, "_STALLED", math.inf)
    assert not run(scenario(robot, STANDS, horizon=60.0), "antway", seed=0).reached


def test_a_robot_remembers_those_it_does_not_see_any_more() -> None:
    """It goes round a row of people who stand, of whom it sees some at a time, and does not run to and fro for ever."""
    for seed, half in ((1, 4.0), (2, 4.0), (1, 5.0)):
        rng, width = np.random.default_rng(seed), 2.0 * half + 1.8
        start, goal = ((x, width / 2 + rng.uniform(-1.0, 1.0)) for x in (2.0, 14.0))
        row = np.arange(0.35, width - 1.7, 0.55)
        row = width - row if rng.random() < 0.5 else row
        people = [Obstacle(0.25, Line((8.0, y), (8.0, y + 0.001), speed=0.0)) for y in row.tolist()]
        robot = RobotSpec(sensor_range=2.5 if half == 4.0 else 3.0)
        world = World(Grid(np.zeros((round(width / 0.1), 160), np.bool_), 0.1), people)
        sensor = Sensor(occlusion=False)
        result = checked(Scenario(world=world, robot=robot, start=start, goal=goal, horizon=90.0, sensor=sensor))
        assert result.reached and result.time < 40.0, seed


@pytest.mark.parametrize("robot", ["holonomic", "diff"])
def test_a_robot_waits_where_there_is_no_detour(robot: str) -> None:
    """It goes through as soon as the obstacle has left the only doorway."""
    leaves = Replay((0.0, 20.0, 24.0), (DOOR, DOOR, (11.0, 1.0)))
    result = checked(scenario(robot, leaves, far_door=False))
    assert result.reached and 20.0 < result.time < 33.0


def test_a_robot_turns_back_if_the_obstacle_leaves_early() -> None:
    """It has left the doorway before the robot, which still sees it, is nearer to the other one."""
    result = checked(scenario("holonomic", Replay((0.0, 13.0, 15.0), (DOOR, DOOR, (6.0, 2.6)))))
    assert result.reached and result.time < 26.0 and result.trace is not None
    assert 5.0 < result.trace.xy[:, 1].max() < 10.0


def test_stays_are_those_of_the_slow_twin() -> None:
    """Discs stand, jitter, walk, or turn back after a metre; some come in sight late, and all are lost now and then."""
    rng = np.random.default_rng(3)
    for _ in range(cases(30, 500)):
        table, scans = make_table(8, COLUMNS), []
        xy, v = rng.uniform(0, 4, (6, 2)), rng.uniform(-1, 1, (6, 2)) * np.array([[0], [0], [0.1], [0.3], [1], [1]])
        for i in range(80):
            t = 0.25 * i
            visible = np.flatnonzero(rng.random(6) < (0.2 if i % 30 > 18 else 0.9))
            estimates, seen = np.zeros((6, 8)), np.full(6, t - 0.25)
            estimates[:, (X, Y)], estimates[:, (VX, VY)], estimates[:, RADIUS], estimates[:, ID] = xy, v, 0.3, np.arange(6)
            seen[visible] = t
            update_stays(table, estimates, seen, t)
            scans.append((t, {k: (*xy[k].tolist(), *v[k].tolist()) for k in visible.tolist()}))
            xy, v = xy + 0.25 * v + rng.normal(0, 0.01, (6, 2)), np.where(rng.random((6, 1)) < 0.2, -v, v)
        known = naive.stays(scans)
        assert sorted(known) == sorted(rows_in_use(table)[:, TRACK_ID].astype(int).tolist())
        for row in rows_in_use(table):
            since, last, places, _ = known[int(row[TRACK_ID])]
            assert (row[stays.SINCE], row[SEEN]) == (since, last)
            assert row[stays.LOW_X : stays.HIGH_X].tolist() == np.min(places, axis=0).tolist()
            assert row[stays.HIGH_X : stays.LEAVING].tolist() == np.max(places, axis=0).tolist()


def test_a_stay_ends_when_the_obstacle_has_left_or_is_forgotten() -> None:
    """It is remembered out of sight for as long as it had stayed; one that stood all the time for 15 s at least."""
    table, at = make_table(4, COLUMNS), np.zeros((1, 8))
    for t in range(6):
        at[0, X] = 0.3 * (t % 2)
        update_stays(table, at, np.array([float(t)]), float(t))
    assert table.rows[0, [stays.SINCE, SEEN]].tolist() == [0.0, 5.0]
    for t, left in ((10.0, 1), (10.25, 0)):
        update_stays(table, at[:0], np.empty(0), t)
        assert table.used[0] == left
    for t in (0.0, 1.0):
        update_stays(table, at, np.array([t]), t)
    for t, left in ((16.0, 1), (16.25, 0)):
        update_stays(table, at[:0], np.empty(0), t)
        assert table.used[0] == left
    update_stays(table, at, np.array([11.0]), 11.0)
    at[0, X] = 1.5
    update_stays(table, at, np.array([12.0]), 12.0)
    assert table.rows[0, stays.SINCE] == 12.0


def test_who_was_leaving_is_not_remembered() -> None:
    """Who stood in a doorway and walks off out of sight stands there no longer; robots gave way to him for ten seconds."""
    table, at = make_table(4, COLUMNS), np.zeros((1, 8))
    for i in range(100):
        at[0, (X, VX)] = max(0.0, 0.25 * i - 24.0), float(i > 96)
        update_stays(table, at, np.array([0.25 * i]), 0.25 * i)
    assert table.rows[0, stays.SINCE] == 0.0 and table.rows[0, stays.HIGH_X] == 0.75
    for t, left in ((25.5, 1), (26.0, 0)):
        update_stays(table, at[:0], np.empty(0), t)
        assert table.used[0] == left


def test_times_are_the_least_of_waits_and_detours() -> None:
    """Both doorways are taken: the near one for 3 s, the far one for 33 s."""
    grid, robot, goal = two_doors(), load_robot("holonomic"), (20, 65)
    context = make_context(grid, robot, goal, Moves.EIGHT)
    near = make_context(two_doors(far_door=False), robot, goal, Moves.EIGHT)
    found, estimates = Detours(Moves.EIGHT, (context,)), np.zeros((2, 8))
    estimates[:, ID], estimates[:, RADIUS] = (1, 0), (0.6, 0.3)
    estimates[0, (X, Y)], estimates[1, (X, Y)] = (8.0, 14.4), DOOR
    for t in np.arange(0.0, 33.1, 0.25).tolist():
        known = 2 if t >= 30.0 else 1
        if counted := found.update(estimates[:known], np.full(known, t), t, (3.0, 4.0)):
            found.adopt(counted())
    left = np.isfinite(context.field) & (np.arange(6400) % 80 < 35)
    least = np.minimum(near.field + 3.0, context.field + 33.0)  # through the near doorway, or the far one
    assert left.sum() > 1500 and found.times[0][left] == pytest.approx(least[left], abs=1e-9)
    right = np.isfinite(context.field) & (np.arange(6400) % 80 > 50)
    assert found.times[0][right] == pytest.approx(context.field[right], abs=0.1)  # around the disc in the doorway


def test_what_is_computed_anew_counts_at_once_with_who_was_counted_with() -> None:
    """A robot that was found to be slower than declared used to forget for 3 s who stands in the doorway."""
    context, estimates = make_context(two_doors(), load_robot("holonomic"), (20, 65)), np.zeros((1, 8))
    estimates[0, (X, Y)], estimates[0, RADIUS], found = DOOR, 0.6, Detours(Moves.THIRTY_TWO, (context,))
    for t in np.arange(0.0, 5.1, 0.25).tolist():
        if counted := found.update(estimates, np.full(1, t), t, (3.0, 4.0)):
            found.adopt(counted())
    anew = Detours(Moves.THIRTY_TWO, (context._replace(field=2.0 * context.field, speed=0.5 * context.speed),))
    anew.go_on(found)
    counted = anew.update(estimates, np.full(1, 5.2), 5.2, (3.0, 4.0))
    assert found.expects and counted is not None and anew.expects
    assert anew.update(estimates, np.full(1, 5.5), 5.5, (3.0, 4.0)) is None


@pytest.mark.parametrize("clock", [0.0, -1e6, 1.7e9])
def test_a_robot_that_is_cut_off_looks_for_detours_after_as_long_by_every_clock(clock: float) -> None:
    """By a clock that began below 0 it used not to look for any."""
    blocked = np.zeros((80, 80), np.bool_)
    blocked[:, 40] = True
    grid = Grid(blocked, 0.2)
    context = make_context(grid, RobotSpec(), grid.cell_at((13.1, 4.1)))
    found, estimates, looks = Detours(Moves.THIRTY_TWO, (context,)), np.zeros((1, 8)), []
    estimates[0, (X, Y)] = 12.0, 4.0
    for i in range(20):
        t = clock + 0.25 * i
        if found.update(estimates, np.full(1, t), t, (3.0, 4.0)) is not None:
            looks.append(0.25 * i)
    assert math.isinf(found.to_go) and looks and looks[0] == 3.0


def test_a_robot_at_its_goal_looks_for_no_detours() -> None:
    """It may stand there for long, beside an obstacle that does as well."""
    context, estimates = make_context(two_doors(), load_robot("holonomic"), (20, 65)), np.zeros((1, 8))
    estimates[0, (X, Y)], found = (12.0, 4.0), Detours(Moves.THIRTY_TWO, (context,))
    assert not any(found.update(estimates, np.full(1, t), t, (13.1, 4.1)) for t in np.arange(0.0, 20.0, 0.25).tolist())
    assert not found.expects


def test_times_of_tracks_are_handed_to_kernels_without_gaps() -> None:
    """A kernel compiled for one track would read the wrong numbers of a column that is not contiguous."""
    tracker, hall = Tracker(), terrain_of(Grid(np.zeros((100, 100), np.bool_), 0.2))
    for n in (1, 3):
        xy = 9.0 * np.arange(n)[:, None] * np.ones(2)
        tracker.update(Tracks(np.arange(n), xy, np.zeros((n, 2)), np.ones(n)), 0.5 * n, hall, (1.0, 1.0), 4.0)
        assert tracker.last_seen.tolist() == [0.5 * n] * n and tracker.last_seen.strides == (8,)


def test_a_footprint_passes_lengthwise_what_stays_where_the_disc_around_it_does_not_fit() -> None:
    """`amr`, 0.7 m wide in a disc of 0.61 m, passes somebody who leaves 0.9 m of a corridor, and stood behind him before."""
    blocked = np.ones((28, 140), np.bool_)
    blocked[5:25, 3:137] = False
    stands = Line((7.0, 1.65), (7.0, 1.651), speed=0.001)
    world = World(Grid(blocked, 0.1), [Obstacle(0.25, stands)])
    result = checked(Scenario(world=world, robot=load_robot("amr"), start=(2.0, 1.5), goal=(12.0, 1.5), horizon=30.0))
    assert result.reached and result.time < 20.0


def test_a_footprint_passes_lengthwise_who_comes_along_a_corridor() -> None:
    """`amr` neither turns back nor stops before somebody who leaves 0.9 m of a corridor beside him; it did both before."""
    blocked = np.ones((22, 160), np.bool_)
    blocked[2:20, 1:159] = False
    world = World(Grid(blocked, 0.1), [Obstacle(0.25, Line((14.5, 1.35), (0.6, 1.35), speed=1.0))])
    for seed in range(cases(2, 20)):
        drive = Scenario(world=world, robot=load_robot("amr"), start=(1.5, 1.1), goal=(14.0, 1.1), horizon=30.0)
        result = run(drive, "antway", seed=seed)
        check_episode(result)
        assert result.reached and result.time < 11.0 and result.length < 12.9


@pytest.mark.parametrize(("robot", "most"), [("diff", 18.0), ("inertia", 18.5), ("jackal", 12.0)])
def test_a_robot_on_wheels_hesitates_little_inside_a_u_of_people_who_stand(robot: str, most: float) -> None:
    """Its plan led out at once, but its times counted with nobody who stood for less than 3 s: 19.1, 20.6 and 13.2 s."""
    free = np.zeros((120, 160), np.bool_)
    wall = [(8.0, y) for y in np.arange(5.0, 7.1, 0.5).tolist()]
    arms = [(x, y) for x in np.arange(5.5, 8.0, 0.5).tolist() for y in (4.7, 7.3)]
    people = [Obstacle(0.25, Line(xy, (xy[0], xy[1] + 0.001), speed=0.001)) for xy in wall + arms]
    drive = Scenario(
        world=World(Grid(free, 0.1), people), robot=load_robot(robot), start=(2.0, 6.0), goal=(14.0, 6.0), horizon=60.0
    )
    result = run(drive, "antway", seed=int(robot == "diff"))
    check_episode(result)
    assert result.reached and result.time < most
