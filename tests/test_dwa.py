"""Policy `dwa`: rollouts are true, commands keep within limits, obstacles are seen coming."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import BadParameter, Grid, Observation, RobotSpec, Scenario, Tracks, World, check_episode, make_policy, run
from antway.kernels.base.records import RobotState
from antway.kernels.baselines.dwa import Obstacles, roll_out, roll_out_twists, stops_clear
from antway.kernels.robot.motion import drive_cycle
from antway.world.motions import BackAndForth, Line
from antway.world.terrain import terrain_of
from antway.world.world import Obstacle
from common import cases, costly
from crossing import crowd
from naive import baselines as naive

WHEELS = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3)
HALL = Grid(np.zeros((24, 40), dtype=bool), 0.25)


def hall(*obstacles: Obstacle, **changes) -> Scenario:
    return Scenario(World(HALL, obstacles), (1.125, 3.125), (9.125, 3.125), **changes)


def obstacles(discs):
    return Obstacles(discs[:, :2].copy(), discs[:, 2:4].copy(), discs[:, 4].copy())


def roll(command, state, limits, dt, steps, blocked, size, discs):
    out, terrain = np.empty((1, 4)), terrain_of(Grid(blocked, size))
    roll_out(np.array([command]), RobotState(*state), limits, dt, steps, terrain, obstacles(discs), out)
    return out[0]


def test_rollouts_find_the_first_contact() -> None:
    """Against dense sampling: discs to the sampling's step, walls to the control period that reaches them."""
    rng, blocked = np.random.default_rng(0), np.zeros((40, 40), dtype=bool)
    blocked[:, 30:] = True
    found = [0, 0]
    for _ in range(cases(60, 3000)):
        discs = np.column_stack((rng.uniform(0, 6, (3, 2)), rng.uniform(-1, 1, (3, 2)), np.full(3, 0.5)))
        angle = rng.uniform(-math.pi, math.pi)
        velocity = math.cos(angle), math.sin(angle)
        done = roll(velocity, (4.0, 4.0, 0.0, 0.0, 0.0), RobotSpec(radius=0.2).limits, 0.1, 30, blocked, 0.2, discs)
        disc = naive.first_touch((4.0, 4.0), velocity, 3.2, discs, math.inf, 0.2)
        wall = naive.first_touch((4.0, 4.0), velocity, 3.2, discs[:0], 6.0, 0.2)
        if math.isinf(done[0]):
            assert min(disc, wall) > 2.99
        elif disc < wall - 0.101:
            assert done[0] == pytest.approx(disc, abs=6e-3)
        else:  # the period in which the wall is reached ends all
            assert done[0] - 1e-3 <= min(disc, wall) and wall <= done[0] + 0.101
        found[int(disc < wall - 0.101)] += math.isfinite(done[0])
        assert done[1:] == pytest.approx((1.0, 4.0 + 0.1 * velocity[0], 4.0 + 0.1 * velocity[1]))
    assert min(found) > 3


def test_rollouts_obey_the_robots_own_limits() -> None:
    """After one period the robot is where the simulator's rules take it: inertia, and turning before driving."""
    free, none = np.zeros((40, 40), dtype=bool), np.empty((0, 5))
    heavy, wheels = RobotSpec(radius=0.2, a_max=2.0).limits, RobotSpec(radius=0.2, drive="differential").limits
    slow = roll((1.0, 0.0), (4.0, 4.0, 0.0, 0.0, 0.0), heavy, 0.1, 1, free, 0.2, none)
    assert slow[1:] == pytest.approx((0.2, 4.02, 4.0))
    turning = roll((-1.0, 0.0), (4.0, 4.0, 0.0, 1.0, 0.0), wheels, 0.1, 1, free, 0.2, none)
    assert turning[1:] == pytest.approx((0.0, 4.0, 4.0))


def test_rollouts_of_twists_are_the_robots_own_arcs() -> None:
    """Against arcs driven exactly in steps of 5 ms: when a disc or a wall is touched, and where the robot is on the way."""
    rng, blocked = np.random.default_rng(1), np.zeros((40, 40), dtype=bool)
    blocked[:, 30:] = True
    found = [0, 0]
    for k in range(cases(60, 1000)):
        discs = np.column_stack((rng.uniform(1, 6, (3, 2)), rng.uniform(-0.6, 0.6, (3, 2)), np.full(3, 0.5)))[: 3 * (k % 2)]
        state = RobotState(4.0 + (k + 1) % 2, 4.0, rng.uniform(-3, 3), rng.uniform(0, 1), rng.uniform(-1, 1))
        twist, out = np.array([[rng.uniform(-0.3, 1.0), rng.uniform(-1.9, 1.9)]]), np.empty((1, 6))
        terrain = terrain_of(Grid(blocked, 0.2))
        roll_out_twists(twist, state, WHEELS.limits, 0.1, 30, 10, terrain, obstacles(discs), out)
        now, after, gaps = state, None, []
        for i in range(600):
            now = drive_cycle(now, *twist[0].tolist(), WHEELS.limits, 0.005)
            after = now if i == 199 else after
            away = np.hypot(*(discs[:, :2] + discs[:, 2:4] * 0.005 * (i + 1) - now[:2]).T) - discs[:, 4]
            gaps.append((away.min(initial=9.0), min(6.0 - now[0], now[0], now[1], 8.0 - now[1]) - WHEELS.radius))
        # Chords differ from arcs by millimetres: contact may begin where the gap is 5 mm, and must where it is -5 mm.
        (disc, wall), (last_disc, last_wall) = (
            [0.005 * (int(np.argmax(below)) + 1) if below.any() else math.inf for below in (np.array(gaps) < gap).T]
            for gap in (5e-3, -5e-3)
        )
        assert out[0, 1] == pytest.approx(drive_cycle(state, *twist[0].tolist(), WHEELS.limits, 0.1)[3], abs=1e-9)
        if min(disc, wall) > 1.01:
            assert out[0, 2:5] == pytest.approx(after[:3], abs=2e-3)
        if math.isinf(out[0, 0]):
            assert min(last_disc, last_wall) > 2.9
        else:  # the period in which a wall is touched counts from its start
            assert min(disc, wall - 0.1) - 0.03 <= out[0, 0] <= min(last_disc, last_wall) + 0.03
            found[k % 2] += 1
    assert min(found) > 3


@pytest.mark.parametrize(
    "robot",
    [
        RobotSpec(),
        RobotSpec(a_max=1.5),
        RobotSpec(drive="differential", a_max=2.0, turn_rate=1.5, dynamics="steps"),
        WHEELS,
        RobotSpec(v_max=0.7),
    ],
)
def test_commands_keep_within_limits(robot: RobotSpec) -> None:
    """Commands and changes of speed keep within limits, and no robot drives into a wall."""
    for seed in range(costly(2, 30)):
        result = run(crowd(seed, robot=robot), "dwa", horizon=30.0)
        check_episode(result)
        trace = result.trace
        twists = robot.wheels and not robot.stepwise
        speed = np.abs(trace.command[:, 0]) if twists else np.hypot(*trace.command.T)
        assert speed.max() <= robot.v_max * (1 + 1e-12)
        assert np.hypot(*np.diff(trace.velocity, axis=0).T).max() <= robot.a_max * robot.dt + 1e-9 or robot.drive != "holonomic"
        assert result.outcome.value != "hit-wall"


@pytest.mark.parametrize(
    "robot",
    [
        RobotSpec(),
        RobotSpec(a_max=1.5),
        RobotSpec(drive="differential", a_max=2.0, dynamics="steps"),
        WHEELS,
        replace(WHEELS, latency=0.15),
    ],
)
def test_it_arrives_past_what_crosses(robot: RobotSpec) -> None:
    """Seeds of a disc that goes up and down across the way; same seed, same bytes."""
    disc = Obstacle(0.3, BackAndForth((5.0, 0.4), (5.0, 5.6), (0.3, 0.5), (0.0, 1.0)))
    for seed in range(costly(3, 30)):
        result = run(hall(disc, robot=robot), "dwa", seed=seed)
        check_episode(result)
        assert result.reached, (seed, result.outcome)
    again = run(hall(disc, robot=robot), "dwa", seed=seed)
    assert again.trace.digest() == result.trace.digest()


@pytest.mark.parametrize("aim", [0.7, 1.2])
@pytest.mark.parametrize("changes", [{}, {"latency": 0.15}, {"v_reverse": 0.0, "turn_rate": 1.0, "alpha_max": 1.5}])
def test_wheels_stop_before_every_wall(aim: float, changes: dict) -> None:
    """What is commanded can be braked from before a wall, on the arc that braking takes: not one of 180 episodes hits one."""
    for seed in range(costly(3, 30)):
        result = run(crowd(seed, robot=replace(WHEELS, **changes)), make_policy("dwa", aim=aim), horizon=30.0, record=False)
        assert result.outcome.value != "hit-wall", (seed, aim, changes)


@pytest.mark.parametrize("robot", [WHEELS, RobotSpec(a_max=1.0, brake_max=2.0)])
def test_a_stop_is_clear_where_dense_steps_find_no_wall(robot: RobotSpec) -> None:
    """A period of a command and then braking, driven in steps of a millisecond: never called clear where that meets a wall."""
    rng, blocked, dt = np.random.default_rng(3), np.zeros((40, 40), dtype=bool), 0.1
    blocked[:, 30:] = True
    both = set()
    for _ in range(costly(200, 3000)):
        state = RobotState(rng.uniform(4.6, 5.7), 4.0, rng.uniform(-1.5, 1.5), rng.uniform(-0.3, 1), rng.uniform(-1.9, 1.9))
        command = float(rng.uniform(-0.3, 1.0)), float(rng.uniform(-1.9, 1.9))
        brake = 0.0, command[1] if robot.wheels else 0.0
        clear = stops_clear(*command, state, robot.limits, dt, terrain_of(Grid(blocked, 0.2)))
        now, gap, t = state, math.inf, 0.0
        while t < dt or math.hypot(now[3], 0.0 if robot.wheels else now[4]) > 1e-9:
            gap = min(gap, 6.0 - robot.radius - now[0])
            now = drive_cycle(now, *(command if t < dt - 1e-9 else brake), robot.limits, 1e-3)
            t += 1e-3
        gap = min(gap, 6.0 - robot.radius - now[0])
        assert not clear or gap >= -1e-9
        assert clear or gap < 0.005
        both.add(clear)
    assert both == {True, False}
    terrain = terrain_of(Grid(blocked, 0.2))
    for gap in (0.004, 0.02):  # from rest a period and braking take 0.01 m
        at_rest = RobotState(6.0 - robot.radius - gap, 4.0, 0.0, 0.0, 0.0)
        assert stops_clear(1.0, 0.0, at_rest, robot.limits, dt, terrain) is (gap > 0.01)


@pytest.mark.parametrize(("robot", "v"), [(WHEELS, 1.0), (replace(WHEELS, a_max=math.inf, alpha_max=math.inf), 0.0)])
def test_no_stop_is_clear_where_the_arc_bulges_into_a_wall(robot: RobotSpec, v: float) -> None:
    """Where the chord of the first period runs along the wall, the arc is up to 2.4 mm nearer to it."""
    blocked = np.zeros((40, 40), dtype=bool)
    blocked[:, 30:] = True
    for gap, off, clear in ((0.001, 0.095, False), (0.004, 0.095, True), (0.0003, 0.05, False)):
        state = RobotState(6.0 - robot.radius - gap, 4.0, math.pi / 2 - off, v, 1.9)
        assert stops_clear(1.0, 1.9, state, robot.limits, 0.1, terrain_of(Grid(blocked, 0.2))) is clear


def test_the_edge_of_the_map_is_a_wall_for_twists() -> None:
    """The robot drives towards it; and each candidate is told whether a period of it, and then braking, is clear."""
    terrain, none = terrain_of(Grid(np.zeros((40, 40), dtype=bool), 0.2)), obstacles(np.empty((0, 5)))
    state, clear = RobotState(4.0, WHEELS.radius + 0.65, -math.pi / 2, 1.0, 0.0), set()
    twists = np.array([(v, w) for v in (1.0, 0.9, 0.3) for w in (-0.3, 0.0, 0.3)])
    out = np.empty((9, 6))
    roll_out_twists(twists, state, WHEELS.limits, 0.1, 30, 10, terrain, none, out)
    assert out[1, 0] == pytest.approx(0.6, abs=0.051)
    for gap in np.linspace(0.5, 0.65, 16):
        state = state._replace(y=WHEELS.radius + float(gap))
        roll_out_twists(twists, state, WHEELS.limits, 0.1, 3, 1, terrain, none, out)
        assert out[:, 5].tolist() == [stops_clear(v, w, state, WHEELS.limits, 0.1, terrain) for v, w in twists.tolist()]
        clear |= set(out[:, 5].tolist())
    assert clear == {0.0, 1.0}


@pytest.mark.parametrize("robot", [WHEELS, RobotSpec(a_max=1.0, brake_max=2.0)])
def test_going_straight_along_a_wall_or_standing_beside_it_is_clear(robot: RobotSpec) -> None:
    """A straight way has no arc that bulges into a wall 5 mm away, and who turns in place needs no room at all."""
    blocked = np.zeros((40, 40), dtype=bool)
    blocked[:, 30:] = blocked[30:] = True
    terrain, near = terrain_of(Grid(blocked, 0.2)), 6.0 - robot.radius
    for v in (0.2, 1.0):
        ways = [(0.0, (v, 0.0), (3.0, near - 0.005))]
        ways += [(math.pi / 2, (v, 0.0), (near - 0.005, 3.0))] if robot.wheels else [(0.0, (0.0, v), (near - 0.005, 3.0))]
        for heading, velocity, (x, y) in ways:
            state = RobotState(x, y, heading, *velocity)
            assert stops_clear(*velocity, state, robot.limits, 0.1, terrain)
    spin = 1.9 if robot.wheels else 0.0
    assert stops_clear(0.0, spin, RobotState(near - 1e-6, near - 1e-6, 0.0, 0.0, spin), robot.limits, 0.1, terrain)


def test_predictions_are_what_saves_it() -> None:
    """Discs that cross fast are missed; taken for standing, as in 1997, they are not all."""
    hits = {"moving": 0, "still": 0}

    class Still(type(make_policy("dwa"))):
        def _ends(self, o, commands):
            o.tracks.velocity[:] = 0.0
            return super()._ends(o, commands)

    for seed in range(costly(6, 6)):
        disc = Obstacle(0.3, Line((4.0 + 0.3 * seed, 0.4), (4.0 + 0.3 * seed, 5.6), 1.0))
        for name, policy in (("moving", make_policy("dwa")), ("still", Still())):
            hits[name] += not run(hall(disc), policy, record=False).reached
    assert hits["moving"] == 0 < hits["still"]


def test_latency_counts_once() -> None:
    """Somebody stands 0.7 m before where a command acts; one period and braking take 0.6 m, and the latency is over by then."""
    robot = replace(WHEELS, latency=0.3)
    policy = make_policy("dwa", vel=50.0, dist=0.0, heading=0.0)
    policy.reset(hall(robot=robot).task, 1)
    for gap, action, fastest in ((0.62, "follow", True), (0.58, "follow", False), (0.4, "brake", False)):
        x = 3.0 + 0.3 * robot.v_max + robot.radius + 0.3 + policy.kept + gap
        seen = Tracks([1], [(x, 3.125)], [(0.0, 0.0)], [0.3])
        command = policy.act(Observation(0.0, (3.0, 3.125), (1.0, 0.0), 0.0, seen, pending=np.array([(1.0, 0.0)] * 3)))
        assert policy.explain().action == action and (command.twist[0] == 1.0) is fastest


def test_the_window_is_what_the_robot_reaches_in_a_period() -> None:
    """Against its own dynamics under the most extreme commands, ahead and in reverse; the first candidates stop, or nearly."""
    rng, policy = np.random.default_rng(5), make_policy("dwa")
    robot = RobotSpec(drive="differential", a_max=1.0, brake_max=2.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.6)
    policy.reset(hall(robot=robot).task, 1)
    for v in (*rng.uniform(-0.6, 1.0, cases(40, 1000)).tolist(), 0.0, 1.0, -0.6):
        state = RobotState(5.0, 3.0, 0.0, v, float(rng.uniform(-1.9, 1.9)))
        window = policy._window(state)
        ends = np.array(
            [drive_cycle(state, s * 9.0, turn, robot.limits, robot.dt)[3:] for s in (-1, 1) for turn in (-9.0, 9.0)]
        )
        low, high = window.min(axis=0), window.max(axis=0)
        assert (low[1], high[1]) == pytest.approx((ends[:, 1].min(), ends[:, 1].max()))
        if v <= 0.0 or v >= robot.brake_max * robot.dt:  # else it crosses 0, and speeds up more slowly than it braked
            assert low[0] == pytest.approx(ends[:, 0].min())
        if v >= 0.0 or v <= -robot.brake_max * robot.dt:
            assert high[0] == pytest.approx(ends[:, 0].max())
        assert window[: policy.turns, 0] == pytest.approx(min(max(0.0, low[0]), high[0]))


def test_wheels_too_near_a_wall_stop_on_the_arc_that_was_clear() -> None:
    """No command is clear of the wall ahead: it brakes with the turn rate commanded last."""
    policy = make_policy("dwa")
    policy.reset(hall(robot=WHEELS).task, 1)
    policy.turning = 0.7
    assert policy.act(Observation(0.0, (9.65, 3.125), (1.0, 0.0), 0.0, Tracks.none())).twist == (0.0, 0.7)


def test_it_goes_round_a_dead_end() -> None:
    """The target on the global path leads it out of a U."""
    blocked = np.zeros((60, 80), dtype=bool)
    blocked[18:42, 48:50] = blocked[18:20, 30:50] = blocked[40:42, 30:50] = True
    result = run(Scenario(World(Grid(blocked, 0.2)), (3.1, 6.1), (13.1, 6.1)), "dwa")
    check_episode(result)
    assert result.reached


def test_wheels_do_not_stop_short_of_a_corner() -> None:
    """Where that hides all but centimetres of the path, the target is farther on: else none is nearer it than who stands."""
    blocked = np.zeros((40, 60), dtype=bool)
    blocked[10:30, 28:32] = True
    scenario = Scenario(World(Grid(blocked, 0.2)), (1.1, 4.1), (10.9, 4.1), WHEELS, horizon=20.0)
    result = run(scenario, "dwa")
    check_episode(result)
    assert result.reached and result.time < 15.0
    policy = make_policy("dwa", aim=0.5)
    policy.reset(scenario.task, 1)
    o = Observation(0.0, (5.461, 6.283), (0.0, 0.0), 0.43, Tracks.none())
    assert policy.target(o, 2.0) == pytest.approx((5.5, 6.3))
    assert policy.target(o, 2.0, 0.3) == pytest.approx((5.9, 6.3)), "the first node that is not nearer"


@pytest.mark.parametrize("robot", [RobotSpec(), WHEELS], ids=["disc", "wheels"])
def test_however_short_the_horizon_a_period_is_looked_ahead(robot: RobotSpec) -> None:
    """At 1e-11 s none was, and what was judged had never been written."""
    policy = make_policy("dwa", horizon=1e-11, aim=1e-11)
    policy.reset(hall(robot=robot).task, 1)
    o, commands = Observation(0.0, (4.0, 3.0), (0.0, 0.0), 0.0, Tracks.none()), np.array([[0.1, 0.0], [0.05, 0.0]])
    ends = policy._rolled(o, o.state_at_action(robot), commands) if policy.rolls else policy._ends(o, commands)
    assert ends[:, 1] == pytest.approx(commands[:, 0])
    assert ends[:, 2] == pytest.approx(4.0 + commands[:, 0] * robot.dt, abs=0.01)


def test_a_disc_weighs_rest_all_directions_and_the_way_to_the_target() -> None:
    """The angle to the target is that of the motion or, at rest, of the heading; near the target it would not go past it."""
    policy = make_policy("dwa", heading=1.0, dist=2.0, vel=0.5, horizon=4.0)
    policy.reset(hall(robot=RobotSpec(v_max=2.0)).task, 1)
    o = Observation(0.0, (4.0, 3.0), (0.0, 0.0), 0.3, Tracks.none())
    commands = policy._candidates(o, (8.0, 3.0))
    assert len(commands) == 1 + 4 * 36 + 4
    assert commands[0].tolist() == [0.0, 0.0]
    assert np.hypot(*commands[1:145].T).reshape(4, 36) == pytest.approx(np.tile([[0.5], [1.0], [1.5], [2.0]], 36))
    assert commands[[1, 10, 19, 28]] == pytest.approx(0.5 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]))
    assert commands[-4:] == pytest.approx(np.array([[0.5, 0.0], [1.0, 0.0], [1.5, 0.0], [2.0, 0.0]]))
    assert policy._candidates(o, (4.0, 3.1))[-1] == pytest.approx((0.0, 0.1 / policy.task.robot.dt))
    ends = np.array([[math.inf, 0.0, 4.0, 3.0], [1.0, 2.0, 4.2, 3.0], [math.inf, 1.0, 3.9, 3.0], [2.0, 1.0, 8.0, 2.0]])
    value = policy._value(o, (8.0, 3.0), ends, np.array([4.0, 1.0, 4.0, 2.0]))
    quarter = 0.5 - math.atan2(1.0, 4.0) / math.pi  # it moved to the right and down; the target is then straight up
    assert value == pytest.approx([1 - 0.3 / math.pi + 2.0, 1.0 + 0.5 + 0.5, 2.0 + 0.25, quarter + 1.0 + 0.25])


def test_wheels_look_no_farther_than_a_thousand_periods() -> None:
    """For their angle to the target, too: 1e6 s took minutes for a command."""
    policy = make_policy("dwa", aim=1e6)
    policy.reset(hall(robot=WHEELS).task, 1)
    assert policy.aim_periods == policy.periods * 1000 // 30 == 1000
    assert policy.act(Observation(0.0, (4.0, 3.0), (0.0, 0.0), 0.0, Tracks.none())).twist is not None


def test_wrong_options_are_refused() -> None:
    """Typed errors name the option."""
    for wrong in (
        {"heading": -1.0},
        {"horizon": 0.0},
        {"directions": 2},
        {"speeds": 1.5},
        {"turns": 1},
        {"aim": 0.0},
        {"margin": math.nan},
        {"margin": 1e7},
        {"vel": -0.1},
        {"vel": 1e101},
        {"heading": 1e308},
        {"dist": 1e308},
    ):
        with pytest.raises(BadParameter, match=next(iter(wrong))):
            make_policy("dwa", **wrong)


def test_wheels_with_ramps_weigh_speed_less() -> None:
    """Weight of speed and margin are others on such wheels, unless they are given."""
    for robot, usual in ((WHEELS, (0.25, 0.1)), (RobotSpec(), (1.1, 0.2))):
        for options, wanted in (({}, usual), ({"vel": 0.7, "margin": 0.3}, (0.7, 0.3))):
            policy = make_policy("dwa", **options)
            policy.reset(hall(robot=robot).task, 1)
            assert (policy.speed_weight, policy.kept) == wanted
