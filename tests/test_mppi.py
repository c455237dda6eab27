"""Policy `mppi`: the mean is what its definition says, and wheels with inertia arrive by it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import BadParameter, Grid, Observation, RobotSpec, Scenario, Tracks, World, check_episode, make_policy, run
from antway.kernels.base.records import RobotState
from antway.kernels.baselines.mppi import path_integral
from antway.kernels.controls.problem import NearObstacle
from antway.world.motions import BackAndForth, Line
from antway.world.world import Obstacle
from common import costly, judge

HALL = Grid(np.zeros((24, 40), dtype=bool), 0.25)
WHEELS = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3)


def hall(*obstacles: Obstacle, **changes) -> Scenario:
    return Scenario(World(HALL, obstacles), (1.125, 3.125), (9.125, 3.125), **changes)


@pytest.mark.parametrize("robot", [WHEELS, RobotSpec(a_max=1.0)], ids=["wheels", "holonomic"])
def test_the_mean_is_what_its_definition_says(robot: RobotSpec) -> None:
    """Each sample costs what its rollout says; the mean weighs them by exp(-cost / temperature); noise has its spread."""
    policy = make_policy("mppi", samples=400, temperature=0.3)
    policy.reset(hall(robot=robot).task, 1)
    policy.problem = policy.problem._replace(start=RobotState(2.0, 3.0, 0.2, 0.4, 0.1))
    policy.nominal[:] = (0.5, 0.2)
    path_integral(policy.nominal, policy.sampling, policy.problem, policy.random)
    drawn, cost = policy.sampling.drawn, policy.sampling.cost
    for i in (0, 1, 17, 399):
        assert cost[i] == judge(drawn[i], policy.problem)
    weight = np.exp(-(cost - cost.min()) / 0.3)
    assert policy.nominal == pytest.approx(np.tensordot(weight / weight.sum(), drawn, 1), abs=1e-9)
    assert (drawn[0] == (0.5, 0.2)).all() and not drawn[1].any()
    blocks = drawn.reshape(400, 6, 5, 2)
    assert (blocks == blocks[:, :, :1]).all(), "30 steps in blocks of 5 share a draw"
    turn = drawn[2:, 0, 1] - 0.2
    assert abs(turn.mean()) < 0.1 and turn.std() == pytest.approx(0.4 * (1.9 if robot.wheels else 1.0), rel=0.15)


@pytest.mark.parametrize(
    "robot",
    [WHEELS, RobotSpec(a_max=1.5), RobotSpec(), RobotSpec(drive="differential", a_max=2.0, dynamics="steps")],
    ids=["wheels", "inertia", "holonomic", "steps"],
)
def test_it_arrives_past_what_crosses(robot: RobotSpec) -> None:
    """Seeds of a disc that goes up and down across the way; same seed, same bytes."""
    disc = Obstacle(0.3, BackAndForth((5.0, 0.4), (5.0, 5.6), (0.3, 0.5), (0.0, 1.0)))
    for seed in range(costly(2, 20)):
        result = run(hall(disc, robot=robot), "mppi", seed=seed)
        check_episode(result)
        assert result.reached, (seed, result.outcome)
    again = run(hall(disc, robot=robot), "mppi", seed=seed)
    assert again.trace.digest() == result.trace.digest()


def test_commands_without_wheels_keep_the_limit() -> None:
    """Samples limit vx and vy apart; the command is not faster than the robot in any direction."""
    policy = make_policy("mppi", samples=20)
    scenario = hall(robot=RobotSpec())
    policy.reset(scenario.task, 1)
    policy.nominal[:] = (1.0, 1.0)
    policy.sampling = policy.sampling._replace(spread_a=0.0, spread_b=0.0)
    command = policy.act(Observation(0.0, (1.125, 3.125), (0.7, 0.7), 0.0, Tracks.none()))
    assert command.velocity == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))


def test_the_last_sequence_goes_on_and_obstacles_keep_their_velocities() -> None:
    """The mean starts a period later each time, and who was seen goes on from there, as large as both bodies and the margin."""
    policy, robot = make_policy("mppi", samples=20, temperature=1e-3), RobotSpec(drive="differential", radius=0.25, a_max=2.0)
    policy.reset(hall(robot=robot).task, 1)
    policy.sampling = policy.sampling._replace(spread_a=0.0, spread_b=0.0)
    before = np.column_stack((np.linspace(0.9, 1.0, 30), np.linspace(0.1, -0.1, 30)))
    policy.nominal[:] = before
    tracks = Tracks([1], [(2.0, 4.9)], [(0.1, 0.2)], [0.3])
    policy.act(Observation(2.0, (1.125, 3.125), (0.9, 0.0), 0.0, tracks, stamp=1.5))
    assert policy.nominal == pytest.approx(np.vstack((before[1:], before[-1])), abs=1e-9)
    outlook, near = policy.problem.outlook, NearObstacle._fields.index
    for k in (15, 29):
        disc = outlook.disc[k, 0]
        t = 0.5 + 0.1 * (k + 1)
        assert outlook.near[k] == 1 and disc[:2] == pytest.approx((2.0 + 0.1 * t, 4.9 + 0.2 * t))
        assert disc[near("contact")] == pytest.approx(0.25 + 0.3 + policy.margin)


def test_noise_suits_the_robot_and_the_seed() -> None:
    """Its standard deviations are shares of the robot's limits, its blocks last as long as asked, and each seed has its own."""
    firsts = []
    for seed in (1, 2):
        policy = make_policy("mppi", samples=20, block=0.2)
        policy.reset(hall(robot=RobotSpec(drive="differential", v_max=2.0, dt=0.25, turn_rate=1.5)).task, seed)
        sampling = policy.sampling
        assert (sampling.block, sampling.spread_a, sampling.spread_b) == pytest.approx((1, 0.35 * 2.0, 0.4 * 1.5))
        policy.act(Observation(0.0, (1.125, 3.125), (0.0, 0.0), 0.0, Tracks.none()))
        firsts.append(sampling.drawn[2, 0].tolist())
    assert firsts[0] != firsts[1]


def test_at_a_low_temperature_the_cheapest_sequence_counts_alone() -> None:
    """However much more the others cost: weights are relative to it, so that no exponential overflows."""
    policy = make_policy("mppi", samples=20, temperature=1e-5)
    policy.reset(hall(robot=RobotSpec(drive="differential", a_max=2.0)).task, 3)
    policy.act(Observation(0.0, (1.125, 3.125), (0.0, 0.0), 0.0, Tracks([1], [(2.0, 3.2)], [(-0.5, 0.0)], [0.3])))
    cost = policy.sampling.cost
    assert np.ptp(cost) > 1.0
    assert policy.nominal == pytest.approx(policy.sampling.drawn[cost.argmin()], abs=1e-6)


def test_walls_are_kept_clear_of() -> None:
    """Round a block in the middle of the hall, on wheels, close to its corners and without contact."""
    blocked = HALL.blocked.copy()
    blocked[6:18, 18:22] = True
    result = run(Scenario(World(Grid(blocked, 0.25)), (1.125, 3.125), (9.125, 3.125), WHEELS, horizon=30.0), "mppi")
    check_episode(result)
    assert result.reached and result.time < 14.0


def test_latency_is_driven_with() -> None:
    """With commands that act late it still arrives past a disc that crosses."""
    late = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, latency=0.15)
    result = run(hall(Obstacle(0.3, Line((5.0, 0.4), (5.0, 5.6), 0.4)), robot=late), "mppi")
    check_episode(result)
    assert result.reached


def test_wrong_options_are_refused() -> None:
    """Typed errors name the option."""
    for wrong in ({"samples": 2}, {"horizon": 0.0}, {"temperature": 0.0}, {"margin": math.nan}, {"turn_noise": -1.0}):
        with pytest.raises(BadParameter, match=next(iter(wrong))):
            make_policy("mppi", **wrong)


@pytest.mark.parametrize("option", ["margin", "preferred_gap", "wall_margin"])
def test_margins_beyond_any_map_are_refused(option: str) -> None:
    """Velocities were NaN with a preferred gap of 1e300 m; up to the limit they are numbers."""
    for wrong in (1e7, 1e300, -0.1):
        with pytest.raises(BadParameter, match=option):
            make_policy("mppi", **{option: wrong})
    policy = make_policy("mppi", samples=20, **{option: 1e6})
    policy.reset(hall(robot=WHEELS).task, 3)
    tracks = Tracks([1], [(2.0, 3.2)], [(-0.5, 0.0)], [0.3])
    assert np.isfinite(policy.act(Observation(0.0, (1.125, 3.125), (0.0, 0.0), 0.0, tracks)).twist).all()
