"""Obstacles that follow the robot: never too fast, never through walls, never into a robot that stands; and the encounters."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import BadParameter, Command, Grid, RobotSpec, Scenario, World, check_episode, load_scenario, run
from antway.arena.encounters import KINDS
from antway.arena.suites import build, episodes, stage
from antway.baselines.replan import Follow
from antway.world.motions import Line, Pursue
from antway.world.pursuit import _slide
from antway.world.scenario import save_scenario
from antway.world.world import Obstacle
from common import cases


class Wanders(Follow):
    """Drives a zigzag that depends on `kind`; 0 stands."""

    def __init__(self, kind=1):
        self.kind = kind

    def act(self, observation):
        angle = 1.3 * math.sin(self.kind * observation.t)
        return Command((0.4 * math.cos(angle), 0.4 * math.sin(angle)) if self.kind else (0.0, 0.0))


def chase(*obstacles, kind=1, seed=0, walls=None, horizon=15.0):
    grid = Grid(np.zeros((60, 60), np.bool_) if walls is None else walls, 0.2)
    scenario = Scenario(World(grid, obstacles), (2.0, 6.0), (11.0, 11.0), RobotSpec(), horizon=horizon, through_walls=True)
    return run(scenario, Wanders(kind), seed=seed)


def test_it_goes_straight_for_the_robot():
    """In every control period it drives at its speed towards where the robot was at the beginning of the period."""
    trace = chase(Obstacle(0.3, Pursue((6.0, 9.0), 0.5))).trace
    there = trace.timeline.places(trace.t)[:, 0]
    steps, paths = np.diff(there, axis=0), trace.xy[:-1] - there[:-1]
    far = np.hypot(*paths.T) > 0.9 + 0.05
    assert far.sum() > 10
    assert steps[far] == pytest.approx(paths[far] / np.hypot(*paths[far].T)[:, None] * 0.05, abs=1e-9)


@pytest.mark.parametrize("speed", [0.3, 0.9, 2.5])
def test_it_stops_short_of_a_robot_that_stands(speed):
    """It comes up to its gap, whatever its speed, and waits there."""
    result = chase(Obstacle(0.3, Pursue((8.0, 6.0), speed)), kind=0, horizon=25.0)
    assert result.outcome.value == "timeout" and result.min_clearance == pytest.approx(0.3)
    check_episode(result)


def test_it_keeps_its_bounds_whatever_the_robot_does():
    """Never faster than its speed, never in a wall, still before its delay and after its patience; other discs as ever."""
    rng = np.random.default_rng(4)
    for seed in range(cases(12, 200)):
        walls = rng.random((60, 60)) < 0.04
        walls[26:34, 5:15] = False
        motion = Pursue((8.0, 6.0), (0.2, 1.5), delay=1.0, follow_time=6.0)
        walls[27:33, 37:43] = walls[52:58, 52:58] = False
        still = Obstacle(0.2, Line((11.5, 0.4), (11.5, 11.0), 0.1))
        result = chase(Obstacle(0.3, motion), still, kind=seed % 4, seed=seed, walls=walls)
        check_episode(result)
        line = result.trace.timeline
        t, xy = line.trajectory(0)
        speeds = np.hypot(*np.diff(xy, axis=0).T) / np.diff(t)
        assert speeds.max() <= 1.5 + 1e-9
        assert (speeds[t[:-1] < 0.999] == 0).all() and (speeds[t[:-1] > 7.001] == 0).all()
        room = Grid(walls, 0.2)
        edges = np.argwhere(walls) * 0.2
        for x, y in xy[::5].tolist():
            gap = np.hypot(*(np.array((y, x)) - np.clip((y, x), edges, edges + 0.2)).T)
            assert gap.min() > 0.3 - 1e-6 and room.contains(room.cell_at((x, y)))
        assert line.at(5.0)[0][1] == pytest.approx((11.5, 0.9))


def test_the_same_episode_is_the_same_and_another_robot_sees_another():
    """Equal seeds and robots make equal courses; another robot is followed on another."""
    first, again, other = (chase(Obstacle(0.3, Pursue((8.0, 6.0), (0.3, 0.9))), kind=kind, seed=7) for kind in (1, 1, 2))
    assert first.trace.timeline.knot_xy.tobytes() == again.trace.timeline.knot_xy.tobytes()
    assert not np.array_equal(first.trace.timeline.knot_xy, other.trace.timeline.knot_xy)


def test_walls_are_where_the_origin_of_the_map_says():
    """A step along a wall ends at the same place of the map, wherever that lies."""
    walls = np.zeros((20, 20), np.bool_)
    walls[12] = True
    for x, y in ((0.0, 0.0), (3.0, -7.0), (-5.0, 11.0)):
        end = _slide(Grid(walls, 0.2, (x, y, 0.0)), 0.3, (x + 1.0, y + 2.0), (x + 2.0, y + 3.0), 0.5)
        assert np.array(end) == pytest.approx((x + 1.5, y + 2.1))


def test_it_is_written_and_read(tmp_path):
    """A scenario with a pursuer comes back equal from its file; wrong numbers are refused by name."""
    pursuer = Obstacle(0.3, Pursue((8.0, 6.0), (0.3, 0.9), gap=0.4))
    scenario = Scenario(World(Grid(np.zeros((60, 60), np.bool_), 0.2), (pursuer,)), (2.0, 6.0), (11.0, 11.0))
    save_scenario(scenario, tmp_path / "s.toml")
    assert load_scenario(tmp_path / "s.toml").world.obstacles == (pursuer,)
    for wrong in ({"speed": -1.0}, {"speed": 1.0, "gap": math.nan}, {"speed": 1.0, "follow_time": "long"}):
        with pytest.raises(BadParameter, match=list(wrong)[-1]):
            Pursue((0.0, 0.0), **wrong)


def test_every_kind_of_encounter_is_met():
    """Kinds, and what makes each: a robot that avoids nothing is met, no disc is too fast, hidden ones are hidden."""
    assert list(KINDS) == ["head-on", "doorway", "overtaking", "ambush", "flow", "crowd", "pursuer"]
    met = dict.fromkeys(KINDS, 0)
    for episode in episodes("encounters", 6):
        scenario, known = stage(episode)
        result = run(scenario, "follow", seed=episode.seed)
        met[episode.group] += result.outcome.value.startswith("hit")
        line = result.trace.timeline
        for k in range(len(line)):
            t, xy = line.trajectory(k)
            assert (np.hypot(*np.diff(xy, axis=0).T) <= scenario.obstacle_speed * np.diff(t) + 1e-9).all()
        assert math.isnan(known.bound) == (episode.group == "pursuer") and math.isfinite(known.shortest)
        path = np.subtract(scenario.goal, scenario.start)
        velocity = line.at(min(line.knot_t.max(), 8.0) / 2)[1]
        if episode.group in ("head-on", "overtaking"):
            assert np.sign(velocity[0] @ path) == (1 if episode.group == "overtaking" else -1)
        assert (episode.group == "crowd") == (len(line) > 20 and not line.at(1.0)[1].any())
        if episode.group == "ambush":
            assert scenario.sensor.occlusion and not result.trace.sensed[0].any()
    assert all(count >= 2 for kind, count in met.items() if kind != "flow") and sum(met.values()) > 20, met


@pytest.mark.parametrize("name", ["antway", "sipp"])
def test_encounters_can_be_mastered(name):
    """`antway` and `sipp` come through every kind of encounter."""
    for episode in episodes("encounters", cases(1, 50)):
        result = run(build(episode), name, seed=episode.seed)
        assert result.outcome.value != "hit-moving", episode.name
        assert result.reached or cases(1, 50) > 1, (episode.name, result.reason)


def test_no_pursuer_begins_in_a_wall():
    """Every pursuit of the suite is a legal scenario: number 12 once began with the disc's rim in the corner of a wall."""
    for episode in (one for one in episodes("encounters", 40) if one.group == "pursuer"):
        assert stage(episode)[0].world.obstacles
