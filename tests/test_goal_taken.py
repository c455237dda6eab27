"""Goals beside which somebody stands: the centre is taken, and the edge of the tolerance is not."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import BadParameter, Grid, Observation, RobotSpec, Scenario, Task, Tracks, World, check_episode, make_policy, run
from antway.arena.suites import SuiteEpisode, build, facts
from antway.tables import NEED_PYRVO, POLICIES
from antway.world.motions import Line
from antway.world.nearby import TAKEN, approach, contact_radii, keeping_velocity, now
from antway.world.world import Obstacle

# Cells (m), how far the goal is from the centre of its cell (m), and how far behind it somebody stands (m).
PLACES = [(0.2, 0.0, 0.48), (0.2, 0.05, 0.5), (0.1, 0.0, 0.5), (0.5, 0.0, 0.55), (0.25, 0.0, 0.5)]


def _scenario(cells: float, off: float, behind: float, leaves: float = 0.0) -> Scenario:
    grid, y = Grid(np.zeros((int(6 / cells), int(10 / cells)), bool), cells), 3.0 + 0.5 * cells
    goal = 8.0 + 0.5 * cells + off, y
    at = goal[0] + behind, y
    motion = Line(at, (at[0], y + 2.5), 1.0, leaves) if leaves else Line(at, at, 0.0)
    return Scenario(World(grid, (Obstacle(0.3, motion),)), (1.0 + 0.5 * cells, y), goal, robot=RobotSpec(), horizon=30.0)


@pytest.mark.parametrize("leaves", [0.0, 20.0])
@pytest.mark.parametrize(("cells", "off", "behind"), PLACES)
def test_who_stands_behind_the_goal_keeps_nobody_from_it(cells: float, off: float, behind: float, leaves: float) -> None:
    """The optimum, `oracle` and `antway` end at the edge of the tolerance, as soon as `follow` does that avoids nothing."""
    scenario = _scenario(cells, off, behind, leaves)
    follows = run(scenario, "follow", seed=1)
    assert follows.reached and follows.time == pytest.approx(6.8 + off, abs=0.01)
    assert facts(scenario, 1).bound == pytest.approx(follows.time, abs=0.01)
    for policy in ("oracle", "antway"):
        result = run(scenario, policy, seed=1)
        assert result.reached and result.time < follows.time + 0.1, policy
        check_episode(result)


def test_no_path_within_the_tolerance_is_sooner_than_the_optimum() -> None:
    """In these episodes the goal's centre is taken when the first path arrives, which then waited, or went round."""
    earlier = {("clutter/high", 3): 15.7, ("aisles/high-noise", 0): 15.3}
    for (group, number), most in earlier.items():
        episode = SuiteEpisode("synthetic", "synthetic", group, number)
        assert facts(build(episode), episode.seed).bound < most
    assert math.isfinite(most)


def test_the_oracle_must_know_the_future() -> None:
    """Where nobody tells it the motions, as on a robot, it is refused."""
    with pytest.raises(BadParameter, match="foresee"):
        make_policy("oracle").reset(Task(Grid(np.zeros((9, 9), bool)), RobotSpec(), (1.5, 1.5), (6.5, 1.5)), 0)


def test_the_oracle_passes_who_stands_for_good() -> None:
    """The last known motion of somebody who stands, or who stops after two seconds, is long over when the robot comes."""
    grid = Grid(np.zeros((30, 50), bool), 0.2)
    for motion in (Line((5.0, 3.1), (5.0, 3.1), 0.0), Line((5.0, 5.1), (5.0, 3.1), 1.0)):
        scenario = Scenario(World(grid, (Obstacle(0.4, motion),)), (1.1, 3.1), (8.1, 3.1), robot=RobotSpec(), horizon=30.0)
        result = run(scenario, "oracle", seed=1)
        assert result.reached and result.time == pytest.approx(facts(scenario, 1).bound, abs=0.05)


def test_plain_search_ends_within_the_tolerance_too() -> None:
    """A baseline is given what the optimum and `antway` are given."""
    scenario = _scenario(0.1, 0.0, 0.48)
    result = run(scenario, "sipp/predictions=mirrored", seed=1)
    assert result.reached and result.time < 7.0


def test_the_straight_path_is_kept() -> None:
    """Somebody comes from behind in a corridor, another one stands behind the goal, and the robot does not stop and go."""
    blocked = np.zeros((30, 80), bool)
    blocked[:11], blocked[19:] = True, True
    for gap in (0.5, 1.2, 2.2):
        behind, goal = Line((6.0 - 2.2 - 0.6 - gap, 1.5), (6.5, 1.5), 0.5), (6.0, 1.5)
        obstacles = Obstacle(0.3, Line((6.56, 1.5), (6.56, 1.5), 0.0)), Obstacle(0.3, behind)
        scenario = Scenario(World(Grid(blocked, 0.1), obstacles), (3.8, 1.5), goal, robot=RobotSpec(), horizon=20.0)
        result = run(scenario, "antway", seed=1)
        moves = np.hypot(*result.trace.velocity[1:-1].T) > 0.01
        assert result.reached and (np.diff(moves.astype(int)) < 0).sum() <= 1, gap


WHEELS = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3)


@pytest.mark.parametrize("policy", sorted(set(POLICIES) - {"follow"}))
def test_no_policy_waits_for_good_where_somebody_stands_behind_the_goal(policy: str) -> None:
    """Each drives straight into the tolerance, on cells smaller and larger than that, and most on wheels with ramps, too."""
    if policy in NEED_PYRVO:
        pytest.importorskip("pyrvo")
    for place in (PLACES[1], PLACES[3]):
        result = run(_scenario(*place), policy, seed=1)
        check_episode(result)
        assert result.reached and result.time < 7.5, place
    if policy not in ("oracle", "paper"):  # these turn on the spot before they drive, or have a guard that lets nobody so near
        result = run(replace(_scenario(*PLACES[2]), robot=WHEELS), policy, seed=1)
        check_episode(result)
        assert result.reached and result.time < 9.0


@pytest.mark.parametrize("policy", ["stop", "dstarlite", "paper"])
def test_who_stands_on_the_goal_is_named_and_waited_for(policy: str) -> None:
    """No place within the tolerance is free: the decision says why the robot waits, once; when they leave, it arrives."""
    result = run(_scenario(0.1, 0.0, 0.1, leaves=12.0), policy, seed=1)
    check_episode(result)
    assert result.reached and 12.0 < result.time < 20.0
    said = [(one.reason, one.obstacle) for _, one in result.trace.decisions if one.reason == TAKEN]
    assert said and set(said) == {(TAKEN, 0)} and len(said) <= 8


def _approach(
    xy=(6.5, 3.0), others=((8.5, 3.0),), velocity=(0.0, 0.0), robot=None, heading=0.0, walls=None, radius=0.3, **more
):
    """Approach a goal at (8, 3) from `xy`; the robot's own velocity is `moves`."""
    blocked = np.zeros((60, 100), bool) if walls is None else walls
    moves = more.pop("moves", (0.0, 0.0))
    task = Task(Grid(blocked, 0.1), robot or RobotSpec(), (1.0, 3.0), (8.0, 3.0))
    tracks = Tracks(np.arange(len(others)), others, [velocity] * len(others), [radius] * len(others), **more)
    return approach(task, Observation(0.0, xy, moves, heading, tracks), 0.2)


def test_the_last_metres_are_straight_to_a_free_place() -> None:
    """At full speed to the near edge, beside whoever stands before the goal, and slower where the robot has to stop."""
    _, who, command = _approach()
    assert who == 0 and command.velocity == pytest.approx((1.0, 0.0))
    assert _approach((7.78, 3.0))[2].velocity == pytest.approx(((0.22 - 0.97 * 0.2) / 0.1, 0.0))
    beside = _approach((7.99, 2.0), ((7.52, 3.0),))[2].velocity  # to the right of the goal, seen from below
    assert beside[0] > 0.03 and beside[1] > 0.9
    heavy = RobotSpec(a_max=1.0, brake_max=1.5)
    speed = _approach((7.7, 3.0), robot=heavy)[2].velocity[0]
    assert speed * heavy.dt + speed**2 / 3 == pytest.approx(0.3 - 0.97 * 0.2)


def test_nobody_is_at_the_goal_who_moves_or_is_not_near_it() -> None:
    """Then the method goes on by itself with all tracks; an unknown velocity is no rest, an uncertain one may be."""
    for change in ({"velocity": (0.06, 0.0)}, {"velocity": (math.nan,) * 2}, {"others": ((8.81, 3.0),)}, {"others": ()}):
        seen, who, command = _approach(**change)
        assert (who, command) == (None, None) and len(seen.tracks) == len(change.get("others", (0,)))
    covariance = [np.diag((0.0, 0.0, 0.01, 0.01))]
    assert _approach(velocity=(0.2, 0.0), covariance=covariance)[1] == 0
    assert _approach(velocity=(0.3, 0.0), covariance=covariance)[1] is None


def test_from_afar_who_stands_at_the_goal_does_not_count() -> None:
    """Unless they are near the robot, as a large disc may be; others count."""
    seen, who, command = _approach((4.0, 3.0), ((8.5, 3.0), (6.0, 3.0)))
    assert (who, command) == (None, None) and seen.tracks.id.tolist() == [1]
    seen, _, _ = _approach((4.0, 3.0), ((8.5, 3.0), (6.0, 3.0)), covariance=np.array([np.eye(4), 2.0 * np.eye(4)]))
    assert seen.tracks.covariance.tolist() == [(2.0 * np.eye(4)).tolist()]
    for radius, count in ((1.8, 1), (1.6, 0)):  # 0.9 and 1.1 m from the robot
        assert len(_approach((5.7, 3.0), ((8.7, 3.0),), radius=radius)[0].tracks) == count
    heavy = RobotSpec(a_max=1.0)  # has to brake 0.5 m earlier
    assert _approach((5.4, 3.0), robot=heavy)[2] is not None and _approach((5.2, 3.0), robot=heavy)[2] is None


def test_no_straight_path_leads_through_anybody_or_a_wall() -> None:
    """All places are closed by who stands on the goal, a wall, or by somebody who crosses; a car does not try to turn."""
    assert _approach(others=((8.1, 3.0),))[1:] == (0, None)
    walls = np.zeros((60, 100), bool)
    walls[:, 70] = True
    assert _approach(walls=walls)[1:] == (0, None)
    crossing = Tracks([0, 1], [(8.5, 3.0), (7.2, 2.3)], [(0.0, 0.0), (0.0, 1.0)], [0.3, 0.3])
    task = Task(Grid(np.zeros((60, 100), bool), 0.1), RobotSpec(), (1.0, 3.0), (8.0, 3.0))
    assert approach(task, Observation(0.0, (6.5, 3.0), (0.0, 0.0), 0.0, crossing), 0.2)[1:] == (0, None)
    car = RobotSpec(drive="ackermann", turning_radius=0.5)
    assert _approach(robot=car)[2] is not None
    assert _approach(robot=car, heading=0.6)[1:] == (None, None)


def test_robots_that_would_leave_the_line_stop_and_turn_first() -> None:
    """Wheels turn where they stand; a robot with inertia that drifts aside brakes; a little of both is driven through."""
    assert _approach(robot=WHEELS, heading=0.27)[2].velocity[0] > 0.9  # leaves the line by 0.27^2 / (2 * 1.9) = 0.019 m
    assert math.hypot(*_approach(robot=WHEELS, heading=0.29)[2].velocity) == pytest.approx(1e-6)
    assert math.hypot(*_approach(robot=WHEELS, heading=1.0)[2].velocity) == pytest.approx(1e-6)
    assert _approach(robot=WHEELS, heading=1.0, moves=(0.3, 0.4))[2].velocity == (0.0, 0.0)
    heavy = RobotSpec(a_max=1.0)
    assert _approach(robot=heavy, moves=(0.9, 0.19))[2].velocity[0] > 0.9
    assert _approach(robot=heavy, moves=(0.9, 0.21))[2].velocity == (0.0, 0.0)
    upwards = _approach((8.0, 1.5), ((8.0, 3.5),), robot=heavy, moves=(0.0, 0.9))[2].velocity
    assert upwards == pytest.approx((0.0, 1.0))
    assert _approach(robot=WHEELS, heading=2.0 * math.pi)[2].velocity[0] > 0.9


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * math.pi, 11)[:-1].tolist())
def test_the_last_metres_are_alike_from_every_side(angle: float) -> None:
    """Somebody stands behind the goal; who heads or drives straight to it goes on, others turn before."""
    ahead = np.array((math.cos(angle), math.sin(angle)))
    place = {"xy": tuple((8.0, 3.0) - 1.5 * ahead), "others": ((8.0, 3.0) + 0.5 * ahead,)}
    assert _approach(**place)[2].velocity == pytest.approx(ahead)
    assert _approach(**place, robot=RobotSpec(a_max=1.0), moves=tuple(0.9 * ahead))[2].velocity == pytest.approx(ahead)
    for heading, speed in ((angle + 0.2, 1.0), (angle + 2.0 * math.pi, 1.0), (angle - 1.0, 0.0), (angle + math.pi, 0.0)):
        assert math.hypot(*_approach(**place, robot=WHEELS, heading=heading)[2].velocity) == pytest.approx(speed, abs=0.1)


@pytest.mark.parametrize(("v_max", "free"), [(0.5, False), (1.0, True)])
def test_who_crosses_counts_for_as_long_as_the_robot_drives(v_max: float, free: bool) -> None:
    """A slow robot is amid the path when somebody comes by, and a quick one is past."""
    task = Task(Grid(np.zeros((60, 100), bool), 0.1), RobotSpec(v_max=v_max), (1.0, 3.0), (8.0, 3.0))
    crossing = Tracks([0, 1], [(8.5, 3.0), (7.2, 0.7)], [(0.0, 0.0), (0.0, 1.0)], [0.3, 0.3])
    assert (approach(task, Observation(0.0, (6.5, 3.0), (0.0, 0.0), 0.0, crossing), 0.2).command is not None) == free


def test_tracks_are_extrapolated_and_margins_end_where_somebody_is_near() -> None:
    """Half a second after the scan they are on; contact is to begin at the margin, or short of where they are now."""
    seen = Tracks([0, 1], [(2.0, 3.0), (1.0, 3.7)], [(1.0, -2.0), (math.nan,) * 2], [0.3, 0.3])
    o = Observation(4.0, (1.0, 3.0), (0.0, 0.0), 0.0, seen, stamp=3.5)
    assert now(o)[0] == pytest.approx(np.array([(2.5, 2.0), (1.0, 3.7)])) and now(o)[1].tolist() == [[1.0, -2.0], [0.0, 0.0]]
    kept = keeping_velocity(o, np.array([0.3, 0.4]), 2.0)
    assert (
        kept.knot_t.tolist() == [4.0, 6.0, 4.0, 6.0] and kept.first.tolist() == [0, 2, 4] and kept.radius.tolist() == [0.3, 0.4]
    )
    assert kept.knot_xy == pytest.approx(np.array([(2.5, 2.0), (4.5, -2.0), (1.0, 3.7), (1.0, 3.7)]))
    far, close = contact_radii(o, now(o)[0], o.xy, RobotSpec(), 0.2).tolist()
    assert far == pytest.approx(0.8) and 0.69 < close < 0.7


def test_tracks_of_a_scan_without_a_time_are_where_they_were_seen() -> None:
    """Baselines took them for infinitely old, so that they were nowhere."""
    policy = make_policy("stop")
    policy.reset(Task(Grid(np.zeros((60, 100), bool), 0.1), RobotSpec(), (1.0, 3.0), (8.0, 3.0)), 0)
    seen = Tracks([0], [(2.0, 3.0)], [(0.0, 0.0)], [0.3])
    assert policy.act(Observation(0.0, (1.0, 3.0), (0.0, 0.0), 0.0, seen, stamp=-math.inf)).velocity == (0.0, 0.0)
