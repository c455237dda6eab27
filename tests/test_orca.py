"""Policy `orca`: known answers of the method, its walls, and CrowdNav's result with a robot that nobody sees."""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np
import pytest

from antway import BadParameter, Grid, RobotSpec, Scenario, World, check_episode, make_policy, run, warmup
from antway.arena.suites import build, episodes
from antway.baselines.orca import outlines, tracked
from antway.kernels.base.records import RobotState
from antway.kernels.robot.motion import drive_cycle
from antway.tables import NEED_PYRVO, POLICIES
from antway.world.motions import BackAndForth, Line
from antway.world.policy import Observation, Tracks
from antway.world.world import Obstacle
from common import cases

HALL = Grid(np.zeros((31, 51), dtype=bool), 0.4)


def hall(*obstacles: Obstacle, **changes) -> Scenario:
    return Scenario(World(HALL, obstacles), (2.2, 6.2), (18.2, 6.2), **changes)


def seen(xy, velocity, tracks) -> Observation:
    rows = np.array(tracks, dtype=float).reshape(-1, 5)
    return Observation(0.0, xy, velocity, 0.0, Tracks(np.arange(len(rows)), rows[:, :2], rows[:, 2:4], rows[:, 4]))


def test_two_robots_pass_each_other_by_symmetry() -> None:
    """Two that run head-on, each steered by the same policy, are mirror images all the way, never touch, and both arrive."""
    paths = [((2.2, 6.2), (18.2, 6.2)), ((18.2, 6.2), (2.2, 6.2))]
    minds = []
    for start, goal in paths:
        policy = make_policy("orca")
        policy.reset(Scenario(World(HALL), start, goal).task, 0)
        minds.append(policy)
    xy, velocity, closest = [(4.0, 6.25), (16.4, 6.15)], [(0.0, 0.0), (0.0, 0.0)], math.inf
    for _ in range(200):
        commands = [minds[k].act(seen(xy[k], velocity[k], [(*xy[1 - k], *velocity[1 - k], 0.3)])).velocity for k in range(2)]
        assert commands[0] == pytest.approx((-commands[1][0], -commands[1][1]), abs=1e-4)
        velocity = commands
        xy = [(x + vx * 0.1, y + vy * 0.1) for (x, y), (vx, vy) in zip(xy, velocity)]
        closest = min(closest, math.dist(*xy))
    assert 0.6 <= closest < 0.7 and math.dist(xy[0], (18.2, 6.2)) < 0.1 and math.dist(xy[1], (2.2, 6.2)) < 0.1


def test_each_takes_half_of_the_change() -> None:
    """Against the velocity obstacle by hand: a disc that stands 3 m ahead on the axis, horizon 2 s.

    The relative velocity 1 m/s lies inside the cut-off disc of radius r / 2 around 3 / 2, by r / 2 - 0.5 with r = 1.4 + 0.02;
    half of that is to be taken back.
    """
    policy = make_policy("orca", horizon=2.0)
    policy.reset(hall(robot=RobotSpec(radius=0.7)).task, 0)
    vx, vy = policy.act(seen((4.2, 6.2), (1.0, 0.0), [(7.2, 6.2, 0.0, 0.0, 0.7)])).velocity
    assert (vx, vy) == pytest.approx((1.0 - (1.42 / 2 - 0.5) / 2, 0.0), abs=1e-5)
    assert policy.explain().action == "avoid"
    assert policy.act(seen((4.2, 6.2), (1.0, 0.0), [])).velocity == pytest.approx((1.0, 0.0), abs=1e-6)


def test_walls_are_covered_by_rectangles_once() -> None:
    """The outlines' areas: each blocked cell is in one rectangle, counterclockwise; the map's edge is clockwise."""
    rng = np.random.default_rng(0)
    for _ in range(cases(20, 500)):
        blocked = rng.random((12, 15)) < 0.4
        edge, *boxes = outlines(Grid(blocked, 0.5, (1.0, -2.0, 0.0)))
        count = np.zeros(blocked.shape, dtype=int)
        for (x0, y0), _, (x1, y1), _ in boxes:
            left, low, right, high = (round(v / 0.5) for v in (x0 - 1.0, y0 + 2.0, x1 - 1.0, y1 + 2.0))
            count[low:high, left:right] += 1
        assert (count == blocked).all()
        for polygon, side in [(edge, -1.0), *((box, 1.0) for box in boxes)]:
            area = sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(polygon, polygon[1:] + polygon[:1])) / 2
            assert area * side > 0.0


def test_it_keeps_off_walls_and_arrives() -> None:
    """Round the arms of a U, and past a disc that crosses; same seed, same bytes, whoever played before."""
    blocked = np.zeros((60, 80), dtype=bool)
    blocked[18:42, 48:50] = blocked[18:20, 30:50] = blocked[40:42, 30:50] = True
    policy = make_policy("orca")
    trap = run(Scenario(World(Grid(blocked, 0.2)), (3.1, 6.1), (13.1, 6.1)), policy)
    check_episode(trap)
    assert trap.reached
    disc = Obstacle(0.3, BackAndForth((10.0, 3.0), (10.0, 9.0), (0.3, 0.5), (0.0, 1.0)))
    results = [run(hall(disc), mind, seed=1) for mind in (policy, make_policy("orca"))]
    check_episode(results[0])
    assert results[0].reached and results[0].trace.digest() == results[1].trace.digest()


def test_wheels_track_a_velocity_no_farther_off_than_the_error() -> None:
    """Integrated: wheels whose twist changes at once are within the error of where the slowed velocity leads."""
    limits = RobotSpec(drive="differential", v_max=2.0, turn_rate=20.0).limits
    for angle in np.linspace(-math.pi / 2, math.pi / 2, 13).tolist():
        for time in (0.3, 0.8):
            v, omega = tracked(1.0, angle, time, 0.1)
            x, y, theta, _, _ = drive_cycle(RobotState(0.0, 0.0, 0.0, 0.0, 0.0), v, omega, limits, time)
            assert theta == pytest.approx(angle, abs=1e-9)
            off = min(math.hypot(x - s * math.cos(angle), y - s * math.sin(angle)) for s in np.linspace(0.0, time, 400))
            assert off <= 0.1 + 1e-3 and v <= 1.0 + 1e-9


def test_on_wheels_the_robot_alone_is_enlarged() -> None:
    """By the error of its place, on top of the margin that every radius has; people are as large as they are seen."""
    policy = make_policy("nh-orca", error=0.3, margin=0.02)
    policy.reset(hall(robot=RobotSpec(drive="differential")).task, 1)
    policy.act(seen((4.2, 6.2), (1.0, 0.0), [(7.2, 6.2, 0.0, 0.0, 0.7)]))
    radii = [policy.simulation.get_agent_radius(k) for k in (0, 1)]
    assert radii == pytest.approx([policy.task.robot.radius + 0.32, 0.72])


def test_it_slows_down_in_the_last_metre() -> None:
    """As CrowdNav's robot does, in proportion to its own speed."""
    policy = make_policy("orca")
    policy.reset(hall(robot=RobotSpec(v_max=2.0)).task, 1)
    assert policy.act(seen((17.8, 6.2), (0.8, 0.0), [])).velocity == pytest.approx((0.8, 0.0), abs=1e-5)
    assert policy.act(seen((4.2, 6.2), (2.0, 0.0), [])).velocity == pytest.approx((2.0, 0.0), abs=1e-5)


def test_on_wheels_it_turns_no_faster_than_it_can() -> None:
    """A velocity far off the heading is tracked in the time that the turn takes."""
    policy = make_policy("nh-orca")
    policy.reset(hall(robot=RobotSpec(drive="differential", turn_rate=1.0)).task, 1)
    o = Observation(0.0, (4.2, 6.2), (0.0, 0.0), 2.0, Tracks.none())
    assert policy.act(o).twist[1] == pytest.approx(-1.0, abs=1e-6)
    assert policy.act(replace(o, heading=0.2)).twist[1] == pytest.approx(-0.2 / policy.turn_time, abs=1e-6)


def test_on_wheels_it_arrives() -> None:
    """With ramps and slow steering, past a disc that crosses; the same seed gives the same bytes."""
    wheels = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3)
    disc = Obstacle(0.3, BackAndForth((10.0, 3.0), (10.0, 9.0), (0.3, 0.5), (0.0, 1.0)))
    results = [run(hall(disc, robot=wheels), "nh-orca", seed=1) for _ in range(2)]
    check_episode(results[0])
    assert results[0].reached and results[0].trace.digest() == results[1].trace.digest()
    with pytest.raises(BadParameter, match="error"):
        make_policy("nh-orca", error=0.0)


@pytest.mark.parametrize(("name", "robot"), [("orca", RobotSpec()), ("nh-orca", RobotSpec(drive="differential"))])
def test_who_stands_behind_the_goal_is_kept_two_margins_off(name: str, robot: RobotSpec) -> None:
    """One is the robot's and one theirs: where they keep it from a goal of 4 cm, it drives straight into that."""
    stands = Obstacle(0.3, Line((18.92, 6.2), (18.92, 6.2), 0.0))  # 12 cm from a robot at the goal
    result = run(hall(stands, robot=robot, goal_tolerance=0.04, horizon=40.0), make_policy(name, margin=0.1))
    check_episode(result)
    assert result.reached


@pytest.mark.parametrize(("name", "option"), [("orca", "margin"), ("nh-orca", "margin"), ("nh-orca", "error")])
def test_margins_beyond_any_map_are_refused(name: str, option: str) -> None:
    """Velocities were NaN with 1e300 m, and 1e31 m/s with 1e30 m; up to the limit they keep the robot's."""
    for wrong in (1e7, 1e30, 1e300, math.nan, -0.1):
        with pytest.raises(BadParameter, match=option):
            make_policy(name, **{option: wrong})
    policy = make_policy(name, **{option: 1e6})
    policy.reset(hall().task, 1)
    for tracks in ([], [(7.2, 6.2, -1.0, 0.0, 0.3)]):
        assert math.hypot(*policy.act(seen((4.2, 6.2), (0.5, 0.0), tracks)).velocity) <= 1.0 + 1e-6


def test_unseen_it_fails_as_published() -> None:
    """CrowdNav's circle with a robot that the humans do not see: about 0.43 of the episodes succeed."""
    chosen = [episode for episode in episodes("crossing", cases(40, 500)) if episode.group == "circle"]
    good = sum(run(build(e), "orca", seed=e.seed, record=False).reached for e in chosen)
    error = 3 * math.sqrt(0.43 * 0.57 / len(chosen))
    assert abs(good / len(chosen) - 0.43) <= 0.03 + error


def test_without_pyrvo_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """A typed error that names the extra; wrong options have theirs."""
    for option in ("horizon", "wall_horizon", "margin", "look_ahead"):
        with pytest.raises(BadParameter, match=option):
            make_policy("orca", **{option: -1.0})
    monkeypatch.setitem(sys.modules, "pyrvo", None)
    for name in POLICIES:
        if name in NEED_PYRVO:
            with pytest.raises(BadParameter, match=f"policy = '{name}': .*arena"):
                make_policy(name)
        else:
            make_policy(name)
    assert not {name for _, name in warmup._TASKS["baselines"]} & set(NEED_PYRVO)
