"""Baselines that replan, and the oracle: what they must manage, what they cannot; the exact ones never touch anything."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, Observation, RobotSpec, Scenario, Task, Tracks, World, check_episode, make_policy, run
from antway.arena.suites import Chance, SuiteEpisode, build, episodes, facts, seed_of, stage
from antway.errors import BadParameter
from antway.kernels.base.records import Trajectories
from antway.kernels.baselines.oracle import first_contact
from antway.tables import NEED_PYRVO, POLICIES
from antway.world.motions import Bounce, Line
from antway.world.policy import Command
from antway.world.sensor import Sensor
from antway.world.terrain import terrain_of
from antway.world.world import Obstacle
from common import cases, costly
from crossing import crowd

ALL = ["follow", "stop", "replan", "dstarlite", "sipp", "oracle"]


def room(*obstacles, walls=None, horizon=40.0, reach=math.inf, **more):
    grid = Grid(np.zeros((40, 60), np.bool_) if walls is None else walls, 0.2)
    spec = RobotSpec(sensor_range=reach)
    return Scenario(World(grid, obstacles), (1.1, 4.1), (10.9, 4.1), spec, Sensor(occlusion=False), horizon=horizon, **more)


@pytest.mark.parametrize("name", ALL)
def test_free_ways_are_driven_at_full_speed(name):
    """With nothing in the way each drives the shortest path around walls, touching none, in the time it must take."""
    walls = np.zeros((40, 60), np.bool_)
    walls[10:30, 28:32] = True
    result = run(room(walls=walls), name)
    assert result.reached
    # Ways over 8 neighbours are up to 8 % too long.
    assert result.time <= (1.09 if name == "dstarlite" else 1.03) * facts(room(walls=walls), 0).bound


@pytest.mark.parametrize(("name", "passes"), [("follow", False), ("replan", True), ("dstarlite", True), ("sipp", True)])
def test_something_stands_in_the_way(name, passes):
    """Whoever looks goes round what stands unknown to the map; `follow` does not look."""
    assert run(room(Obstacle(0.4, Line((6.1, 4.1), (6.1, 4.1), 0.0))), name).reached is passes


@pytest.mark.parametrize("name", ["follow", "stop", "replan", "sipp", "dwa", "orca"])
def test_commands_are_the_same_by_every_clock(name):
    """Seconds since 1970, or as many as a clock may tell, used to be later than any end of a path."""
    task = Task(Grid(np.zeros((40, 60), np.bool_), 0.2), RobotSpec(), (1.1, 4.1), (10.9, 4.1))
    commands = []
    for clock in (0.0, 1.7e9, 1e12):
        policy = make_policy(name)
        policy.reset(task, 0)
        seen = Tracks(np.array([1]), np.array([[5.0, 5.6]]), np.array([[-0.5, 0.0]]), np.array([0.3]))
        commands.append(policy.act(Observation(clock, (1.1, 4.1), (0.0, 0.0), 0.0, seen)).velocity)
    assert math.hypot(*commands[0]) > 0.5
    assert np.allclose(commands, commands[0], atol=2e-3)


@pytest.mark.parametrize("name", sorted(set(POLICIES) - {"antway", "paper", "oracle"}))
def test_commands_are_those_for_when_they_act(name):
    """A robot with latency does what one without does where it will be by then, among obstacles that go on until then."""
    if name in NEED_PYRVO:
        pytest.importorskip("pyrvo")
    prompt = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3)
    late, pending = replace(prompt, latency=0.3), np.full((3, 2), (0.8, 0.6))
    velocity = np.array([[-0.4, 0.1], [0.3, -0.2]])
    tracks = Tracks([1, 2], [[4.5, 4.3], [3.2, 5.6]], velocity, [0.3, 0.4])
    now = Observation(2.0, (2.1, 4.1), (0.9, 0.0), 0.0, tracks, stamp=1.8, pending=pending)
    x, y, heading, v, turn_rate = now.state_at_action(late)
    there = replace(tracks, xy=tracks.xy + 0.5 * velocity)
    then = Observation(2.3, (x, y), (v * math.cos(heading), v * math.sin(heading)), heading, there, turn_rate=turn_rate)
    commands = []
    for robot, seen in ((late, now), (prompt, then)):
        policy = make_policy(name)
        policy.reset(Task(Grid(np.zeros((40, 60), np.bool_), 0.2), robot, (1.1, 4.1), (10.9, 4.1)), 1)
        commands.append(policy.act(seen).acts(seen, robot))
    assert commands[0] == pytest.approx(commands[1], abs=1e-6)


def test_late_wheels_keep_off_walls():
    """They track the velocities of `nh-orca` round two corners; while it took the present place, they hit a wall."""
    pytest.importorskip("pyrvo")
    walls = np.zeros((40, 60), np.bool_)
    walls[10:30, 28:32] = True
    robot = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3, latency=0.3)
    assert run(replace(room(walls=walls), robot=robot), "nh-orca").reached


WHEELS = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3, latency=0.2)
FOR_INSTANT = ["follow", "stop", "replan", "dstarlite", "sipp", "potential-field", "neural", "glasius"]


@pytest.mark.parametrize("name", FOR_INSTANT)
def test_a_robot_with_inertia_keeps_off_walls(name: str) -> None:
    """Methods for robots that turn at once lead others round two corners as well, and not into walls where discs cross."""
    walls = np.zeros((40, 60), np.bool_)
    walls[10:30, 28:32] = True
    assert run(replace(room(walls=walls), robot=WHEELS), name, record=False).reached
    for robot, seed in ((WHEELS, 2), (WHEELS, 7), (RobotSpec(a_max=1.0), 2)):
        result = run(crowd(seed, robot=robot), name, horizon=15.0, record=False)
        assert result.outcome.value != "hit-wall", (seed, result.time)


def test_wheels_too_near_a_wall_brake_on_the_arc_that_was_clear():
    """No share of the command is clear of the wall ahead."""
    policy = make_policy("follow")
    policy.reset(replace(room(), robot=replace(WHEELS, latency=0.0)).task, 1)
    policy.turning = 0.7
    o = Observation(0.0, (11.65, 4.1), (1.0, 0.0), 0.0, Tracks.none())
    assert policy.braked(o, Command((1.0, 0.0))).twist == (0.0, 0.7)


@pytest.mark.parametrize("name", sorted(set(POLICIES) - {"antway", "oracle"}))
def test_without_a_path_it_stands_and_says_so(name):
    """A wall parts the map; `mppi` used to drive about there, and it, `follow` and `stop` said that they follow a path."""
    if name in NEED_PYRVO:
        pytest.importorskip("pyrvo")
    walls = np.zeros((40, 60), np.bool_)
    walls[:, 30] = True
    policy = make_policy(name)
    policy.reset(room(walls=walls).task, 1)
    command = policy.act(Observation(0.0, (1.1, 4.1), (0.0, 0.0), 0.0, Tracks.none()))
    assert command.velocity == (0.0, 0.0)
    assert policy.explain().action == ("wait" if name == "dstarlite" else "brake" if name in ("replan", "sipp") else "stuck")


def test_stop_leaves_somebody_who_is_nearer_than_its_margin():
    """They stand 3 cm behind it: it need not wait until they have gone farther away."""
    behind = Obstacle(0.3, Line((0.47, 4.1), (0.47, 4.1), 0.0))
    assert run(room(behind, horizon=15.0), "stop").reached


def test_replan_says_that_it_waits():
    """Somebody stands in a corridor and leaves less space than the margin: a path that waits for 1e6 s is no detour."""
    walls = np.zeros((40, 60), np.bool_)
    walls[:15], walls[26:] = True, True
    policy = make_policy("replan")
    assert not run(room(Obstacle(0.4, Line((6.1, 4.1), (6.1, 4.1), 0.0)), walls=walls, horizon=8.0), policy).reached
    assert (policy.explain().action, policy.explain().reason) == (
        "wait",
        "every path is closed by what is predicted to stay there",
    )


def test_stop_waits():
    """`stop` lets a crossing obstacle pass and goes on; it drives no detour."""
    result = run(room(Obstacle(0.4, Line((6.1, 1.0), (6.1, 7.0), 0.62))), "stop")
    assert result.reached and result.waits >= 1 and result.length < 10.0
    assert run(room(Obstacle(0.4, Line((6.1, 4.1), (6.1, 4.1), 0.0)), horizon=15.0), "stop").outcome.value == "timeout"


@pytest.mark.parametrize("name", ["sipp", "oracle"])
def test_nothing_is_touched_where_the_future_is_known(name):
    """Where everything is seen and keeps its velocity, `sipp` touches nothing; `oracle` does not where discs bounce, either."""
    solved = 0
    for k in range(costly(40, 1000)):
        chance = Chance(seed_of("known future", k))
        obstacles = []
        while len(obstacles) < 12:
            at = chance.between(0.5, 11.5), chance.between(0.5, 7.5)
            if math.dist(at, (1.1, 4.1)) < 1.5:
                continue
            speed, heading = chance.between(0.2, 0.9), chance.turn()
            motion = Bounce(at, speed, heading)
            if name == "sipp":
                far = at[0] + 40 * speed * math.cos(heading), at[1] + 40 * speed * math.sin(heading)
                motion = Line(at, far, speed)
            obstacles.append(Obstacle(chance.between(0.2, 0.4), motion))
        scenario = room(*obstacles)
        policy = make_policy(name, **({"horizon": 100.0} if name == "sipp" else {}))
        result = run(scenario, policy, seed=k)
        assert not result.outcome.value.startswith("hit-"), (k, result.reason)
        solved += result.reached
    assert solved >= 0.95 * costly(40, 1000)


def test_the_oracle_is_a_bound():
    """On synthetic worlds the oracle touches nothing and nobody beats the optimum by more than its grid allows."""
    for episode in episodes("synthetic", cases(1, 20))[-costly(6, 120) :]:
        scenario, known = stage(episode)
        best = run(scenario, "oracle", seed=episode.seed)
        # In the last period the oracle drives straight to the goal, and may be within its tolerance some milliseconds sooner.
        assert best.reached and best.time >= 0.999 * known.bound, episode.name
        other = run(scenario, "sipp", seed=episode.seed)
        assert not other.reached or other.time > 0.9 * known.bound


def test_the_oracle_sees_the_first_contact_of_a_path():
    """With discs that move between knots, when it happens; with walls and the edge, at the start of the leg that meets them."""
    rng, blocked, radius, seen = np.random.default_rng(8), np.zeros((20, 20), np.bool_), 0.3, {"free": 0, "wall": 0, "disc": 0}
    blocked[8:11, 4:9] = True  # x from 2 to 4.5 m, y from 4 to 5.5 m
    terrain = terrain_of(Grid(blocked, 0.5))
    for _ in range(cases(60, 1_000)):
        t, xy = np.cumsum(rng.uniform(0.5, 2.0, 4)), np.vstack(([[7.0, 5.0]], rng.uniform(0.2, 9.8, (3, 2))))
        knot_t = np.tile([0.0, 4.0, 9.0], 2)
        knot_xy, size = rng.uniform(0.0, 10.0, (6, 2)), rng.uniform(0.1, 0.6, 2)
        found = first_contact(t, xy, radius, terrain, Trajectories(knot_t, knot_xy, np.array([0, 3, 6]), size))
        wanted, kind, close = math.inf, "free", math.inf
        for i in range(3):
            when = np.linspace(t[i], t[i + 1], 1001)
            x, y = (np.interp(when, t, xy[:, axis]) for axis in (0, 1))
            wall = np.hypot(x - np.clip(x, 2.0, 4.5), y - np.clip(y, 4.0, 5.5))
            room = np.min([wall, x, y, 10.0 - x, 10.0 - y], axis=0).min() - radius
            gaps = [
                np.hypot(*(np.interp(when, knot_t[:3], knot_xy[k : k + 3, axis]) - own for axis, own in ((0, x), (1, y)))) - r
                for k, r in zip((0, 3), size + radius)
            ]
            gap = np.min(gaps, axis=0)
            close = min(close, abs(room), abs(gap.min()))
            if room < 0.0 or gap.min() < 0.0:
                kind = "wall" if room < 0.0 and gap[0] > 0.0 else "disc"
                wanted = t[i] if kind == "wall" else when[np.argmax(gap < 0.0)]
                break
        if close < 1e-3:
            continue  # whether they touch is a matter of rounding
        seen[kind] += 1
        assert found == pytest.approx(wanted, abs=0.0 if kind == "wall" else 2.1e-3), kind
    assert min(seen.values()) > 3, seen


def test_the_oracle_waits_at_the_rim_of_the_goal():
    """Within rounding of the goal's tolerance it may not count as there yet; what comes by then is foreseen as well."""
    episode = SuiteEpisode("synthetic", "synthetic", "aisles/high-noise", 22)
    assert run(build(episode), "oracle", seed=episode.seed).reached


def test_mirrored_predictions_are_better():
    """A disc comes back from the wall: the mirrored prediction knows it and the constant one does not."""
    from antway.baselines.replan import Sipp
    from antway.world.policy import Observation, Tracks

    task = room().task
    tracks = Tracks(np.array([0]), np.array([[6.1, 7.0]]), np.array([[0.0, 0.8]]), np.array([0.3]))
    seen = Observation(0.0, (1.1, 4.1), (0.0, 0.0), 0.0, tracks)
    ends = {}
    for predictions in ("constant", "mirrored", "frozen"):
        policy = Sipp(predictions=predictions)
        policy.reset(task, 0)
        piece = policy._segments(seen, 0.0)[-1]
        ends[predictions] = piece[3] + piece[5] * (piece[1] - piece[0])
    assert ends["constant"] == pytest.approx(11.0)
    assert ends["mirrored"] == pytest.approx(2 * 7.7 - 11.0)
    assert ends["frozen"] == 7.0


@pytest.mark.parametrize("name", ["follow", "stop", "sipp", "replan", "dstarlite", "dwa", "potential-field", "nh-orca"])
def test_a_footprint_may_stand_where_its_disc_has_no_room(name):
    """Beside a wall that only the disc round the footprint overlaps, policies command something, and most lead away from it."""
    if name == "nh-orca":
        pytest.importorskip("pyrvo")
    blocked = np.zeros((40, 40), np.bool_)
    blocked[:, 0] = True  # as far as x = 0.25 m
    slim = ((0.1, 0.4), (-0.1, 0.4), (-0.1, -0.4), (0.1, -0.4))
    robot = RobotSpec(drive="holonomic" if name != "nh-orca" else "differential", footprint=slim)
    task = Task(Grid(blocked, 0.25), robot, (5.0, 5.0), (8.0, 5.0))
    policy = make_policy(name)
    policy.reset(task, 0)
    command = policy.act(Observation(0.0, (0.4, 5.0), (0.0, 0.0), 0.0, Tracks.none()))
    x, y = command.velocity if command.twist is None else command.twist
    assert math.hypot(x, y) <= robot.v_max + robot.turn_rate
    if name in ("follow", "stop", "sipp", "replan"):
        assert x > 0.5


def test_wrong_options_are_refused():
    """Options out of range name field, value and what is allowed."""
    for name, options in (("sipp", {"predictions": "tea"}), ("sipp", {"horizon": 0}), ("stop", {"lookahead": -1})):
        with pytest.raises(BadParameter, match=next(iter(options))):
            make_policy(name, **options)
    with pytest.raises(BadParameter, match="margin"):
        make_policy("replan", margin=math.nan)


@pytest.mark.parametrize(
    "policy", ["follow", "stop", "sipp", "replan", "dstarlite", "orca", "potential-field", "oracle", "paper"]
)
def test_a_goal_is_reached_where_the_centre_of_its_cell_has_no_room(policy: str) -> None:
    """A disc of 0.37 m fits 0.38 m from a wall, but not in the middle of that cell of 0.5 m."""
    world = World(Grid(np.zeros((16, 20), bool), 0.5))
    scenario = Scenario(world, (3.25, 3.25), (9.62, 0.39), RobotSpec(radius=0.37), horizon=30.0)
    result = run(scenario, policy)
    check_episode(result)
    assert result.reached
    assert facts(scenario, 0).bound <= 1.01 * result.time  # over cells, of which the last is beside the straight line
