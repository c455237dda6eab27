"""Policy `potential-field`: forces are gradients of the published potentials, and it behaves, and fails, as published."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.ndimage import label

from antway import BadParameter, Grid, Outcome, RobotSpec, Scenario, World, check_episode, make_policy, run
from antway.baselines.replan import short_of_walls
from antway.kernels.base.geometry import segment_hits_cells
from antway.kernels.baselines.potential_field import disc_force, wall_force
from antway.world.line_of_sight import clear
from antway.world.motions import Line
from antway.world.policy import Observation, Tracks
from antway.world.world import Obstacle
from common import cases
from naive import baselines as naive


def trap(horizon: float = 60.0) -> Scenario:
    """A U open to the robot, the goal behind it."""
    blocked = np.zeros((60, 80), dtype=bool)
    blocked[18:42, 48:50] = blocked[18:20, 30:50] = blocked[40:42, 30:50] = True
    return Scenario(World(Grid(blocked, 0.2)), (3.1, 6.1), (13.1, 6.1), horizon=horizon)


def hall(*obstacles: Obstacle, goal=(9.1, 3.1), **changes) -> Scenario:
    return Scenario(World(Grid(np.zeros((31, 51), dtype=bool), 0.2), obstacles), (1.1, 3.1), goal, **changes)


def _wall_potential(blocked: np.ndarray, size: float, radius: float, reach: float, at: np.ndarray) -> float:
    return naive.wall_potential(blocked, size, at[0], at[1], radius, reach)


def test_wall_forces_are_the_gradient_of_khatibs_potential() -> None:
    """Against differences of a naive potential, on random maps anywhere; the third number is twice the potential."""
    rng, seen, radius, size = np.random.default_rng(0), 0, 0.15, 0.5
    while seen < cases(50, 10_000):
        blocked = rng.random((9, 9)) < 0.2
        walls, count = label(blocked, np.ones((3, 3)))
        at, reach, corner = rng.uniform(0.3, 4.2, 2), rng.uniform(0.2, 1.0), rng.uniform(-9.0, 9.0, 2)
        row, col = at[::-1] / size - 0.5
        if segment_hits_cells(blocked, row, col, row, col, 0.2 / size, True):
            continue
        potential = partial(_wall_potential, blocked, size, radius, reach)
        frame, near = np.array([*corner, size]), np.empty((count + 5, 3))
        fx, fy, u = wall_force(walls.astype(np.int32), frame, *(corner + at), radius, reach, near)
        assert u == pytest.approx(2 * potential(at), rel=1e-9, abs=1e-9)
        np.testing.assert_allclose((fx, fy), -naive.gradient(potential, at), rtol=1e-4, atol=1e-4)
        seen += 1


def test_disc_forces_are_the_gradient_of_ge_and_cuis_potential() -> None:
    """Minus the gradient by place and by velocity, by differences of the naive potential; nil for what does not approach."""
    rng = np.random.default_rng(1)
    for _ in range(cases(200, 20_000)):
        robot = np.array([0.0, 0.0, *rng.uniform(-1, 1, 2)])
        angle, far = rng.uniform(-math.pi, math.pi, 3), rng.uniform(2.5, 4.0, 3)
        discs = np.column_stack((far * np.cos(angle), far * np.sin(angle), rng.uniform(-0.7, 0.7, (3, 2)), np.full(3, 0.3)))
        brake, reach = rng.uniform(1.0, 2.0), rng.uniform(1.0, 4.0)

        def potential(p, brake=brake, reach=reach, discs=discs):
            return naive.disc_potential(p, 0.3, brake, reach, discs)

        slope = naive.gradient(potential, robot)
        fx, fy, obstacle = disc_force(*robot, 0.3, brake, reach, discs[:, :2].copy(), discs[:, 2:4].copy(), discs[:, 4].copy())
        np.testing.assert_allclose((fx, fy), -slope[:2] - slope[2:], rtol=1e-4, atol=1e-5)
        assert (obstacle >= 0) == (potential(robot) > 0.0)
        alone = [
            disc_force(*robot, 0.3, brake, reach, d[None, :2].copy(), d[None, 2:4].copy(), d[4:].copy())[:2] for d in discs
        ]
        assert obstacle in (-1, np.argmax(np.hypot(*np.array(alone).T))), "the strongest is named"
        assert disc_force(0.0, 0.0, 0.0, 0.0, 0.3, 1.0, 9.0, np.array([[2.0, 0.0]]), np.array([[0.5, 0.0]]), np.ones(1))[2] < 0


def test_the_force_near_the_goal_is_the_gradient_of_ge_and_cuis_potential() -> None:
    """Attraction and two walls whose potential falls with the square of the distance to the goal, by differences."""
    blocked, goal, rng = np.zeros((31, 51), dtype=bool), (9.1, 3.1), np.random.default_rng(6)
    blocked[:, 48:] = blocked[19:, :46] = True
    policy = make_policy("potential-field", look_ahead=None, conic=0.5, wall=0.05, influence=1.0)
    task = Scenario(World(Grid(blocked, 0.2)), (1.1, 3.1), goal).task
    policy.reset(task, 0)

    def potential(p: np.ndarray) -> float:
        away = math.dist(p, goal)
        return away**2 / (2 * 0.5) + 0.05 * _wall_potential(blocked, 0.2, task.robot.radius, 1.0, p) * (away / 0.5) ** 2

    for _ in range(cases(20, 1000)):
        at = goal + rng.uniform((-0.3, -0.3), (0.1, 0.3))
        fx, fy, _ = policy._force(Observation(0.0, tuple(at.tolist()), (0.0, 0.0), 0.0, Tracks.none()), goal)
        np.testing.assert_allclose((fx, fy), -naive.gradient(potential, at), rtol=1e-4, atol=1e-4)


def test_a_robot_that_brakes_weakly_is_repelled_from_farther() -> None:
    """What it needs to brake counts as if the obstacle were so much nearer."""
    forces = []
    for brake in (math.inf, 0.5):
        policy = make_policy("potential-field")
        policy.reset(hall(robot=RobotSpec(a_max=brake)).task, 0)
        o = Observation(0.0, (3.1, 3.1), (0.8, 0.0), 0.0, Tracks([0], [(5.1, 3.1)], [(0.0, 0.0)], [0.3]))
        forces.append(policy._force(o, (9.1, 3.1))[0])
    b = 0.8**2 / (2 * 0.5)
    assert forces[1] == pytest.approx(1.0 - 0.05 * (1.0 + 0.8 / 0.5) / (1.4 - b) ** 2) and forces[1] < forces[0]


def test_the_u_trap_holds_it_without_the_look_ahead_target() -> None:
    """Pulled to the goal itself it ends in the dead end; pulled to what it sees of the global path it arrives."""
    caught = run(trap(), make_policy("potential-field", look_ahead=None))
    check_episode(caught)
    assert caught.outcome is Outcome.TIMEOUT and np.hypot(*(caught.trace.xy[-1] - (9.3, 6.1))) < 0.7
    free = run(trap(), "potential-field")
    check_episode(free)
    assert free.reached


def test_a_goal_beside_a_wall_is_reached() -> None:
    """The fault of 1986 that the factor of the goal's distance cures: 1 cm off the wall, within its reach."""
    blocked = np.zeros((31, 51), dtype=bool)
    blocked[:, 48:] = True
    scenario = Scenario(World(Grid(blocked, 0.2)), (1.1, 3.1), (9.29, 3.1), goal_tolerance=0.03)
    assert run(scenario, "potential-field").reached
    held = run(scenario, make_policy("potential-field", conic=1e-3, wall=0.05, influence=1.0))
    assert held.outcome is Outcome.TIMEOUT  # with the factor switched off, as good as, the wall holds the robot off its goal


def test_it_keeps_to_the_middle_of_a_corridor() -> None:
    """Begun aside, pushed by both walls alike, it runs along the axis without touching."""
    blocked = np.zeros((20, 60), dtype=bool)
    blocked[:6] = blocked[14:] = True
    corridor = Scenario(World(Grid(blocked, 0.1)), (0.6, 0.95), (5.6, 1.0), robot=RobotSpec(radius=0.2))
    result = run(corridor, make_policy("potential-field", look_ahead=None))
    check_episode(result)
    middle = (result.trace.xy[:, 0] > 1.5) & (result.trace.xy[:, 0] < 5.0)
    assert result.reached and np.abs(result.trace.xy[middle, 1] - 1.0).max() < 0.03


def test_it_gives_way_to_what_comes_and_not_to_what_goes() -> None:
    """A disc head-on drives it aside; one that leads at the same speed leaves its way straight."""
    result = run(hall(Obstacle(0.3, Line((9.0, 3.3), (0.5, 3.3), 0.6))), "potential-field")
    check_episode(result)
    assert result.reached and np.abs(result.trace.xy[:, 1] - 3.1).max() > 0.1
    leader = run(hall(Obstacle(0.3, Line((2.1, 3.1), (9.7, 3.1), 1.0)), goal=(8.1, 3.1)), "potential-field")
    assert leader.reached and np.abs(leader.trace.xy[:, 1] - 3.1).max() < 1e-9


@pytest.mark.parametrize("dt", [0.1, 0.5])
def test_a_robot_that_brakes_weakly_stops_before_walls(dt: float) -> None:
    """It accelerates four times as fast as it brakes, and asks for full speed towards a wall."""
    robot = RobotSpec(a_max=2.0, brake_max=0.5, dt=dt)
    task = replace(trap(), robot=robot).task
    x, v, end = 6.5, 0.0, 9.6 - robot.radius
    for _ in range(100):
        asked = short_of_walls(task, Observation(0.0, (x, 6.1), (v, 0.0), 0.0, Tracks.none()), robot.v_max, 0.0).velocity[0]
        for _ in range(100):  # the speed ramps to what is asked
            v += min(max(asked - v, -robot.brake_max * dt / 100), robot.a_max * dt / 100)
            x += v * dt / 100
        assert x <= end
    assert x > end - 0.2


def test_steps_end_at_walls() -> None:
    """A command never leads into a wall, with inertia neither, and is untouched where nothing is in the way."""
    rng = np.random.default_rng(2)
    for a_max in (math.inf, 1.0):
        task = replace(trap(), robot=RobotSpec(a_max=a_max)).task
        for _ in range(200):
            xy = tuple(rng.uniform(1.0, 11.0, 2))
            if not clear(task, xy, xy):
                continue
            o = Observation(0.0, xy, (0.0, 0.0), 0.0, Tracks.none())
            vx, vy = rng.uniform(-1, 1, 2)
            done = short_of_walls(task, o, vx, vy).velocity
            assert clear(task, xy, (xy[0] + done[0] * 0.1, xy[1] + done[1] * 0.1))
            assert math.hypot(*done) <= 1.0 + 1e-12
            far = 0.1 + 0.5 / a_max
            if clear(task, xy, (xy[0] + vx * far, xy[1] + vy * far)) and math.hypot(vx, vy) <= 1.0:
                assert done == (vx, vy)


def test_the_target_is_in_sight() -> None:
    """The look-ahead target is seen from the robot and not farther along the path than asked."""
    policy, task = make_policy("potential-field"), trap().task
    policy.reset(task, 0)
    for x, y in ((3.1, 6.1), (8.0, 6.1), (9.0, 4.7), (9.0, 9.5)):
        o = Observation(0.0, (x, y), (0.0, 0.0), 0.0, Tracks.none())
        target = policy.target(o, 2.0)
        assert target is not None and clear(task, (x, y), target)
        assert target == task.goal or math.dist((x, y), target) <= 2.0 + 1e-9


def test_wrong_options_are_refused() -> None:
    """Typed errors name the option."""
    for wrong in ({"look_ahead": 0.0}, {"wall": -1.0}, {"influence": 0.0}, {"moving": math.nan}, {"brake": 0.0}):
        with pytest.raises(BadParameter, match=next(iter(wrong))):
            make_policy("potential-field", **wrong)


def test_it_names_the_obstacle_that_repels_most() -> None:
    """Its decision is renewed when another one does."""
    policy = make_policy("potential-field")
    policy.reset(hall().task, 0)
    named = []
    for near in (0, 1):
        places = [(3.1 + 3.0 * (near != k), 3.3) for k in (0, 1)]
        tracks = Tracks([0, 1], places, [(-1.0, 0.0)] * 2, [0.3, 0.3])
        policy.act(Observation(0.1 * near, (1.1, 3.1), (0.5, 0.0), 0.0, tracks))
        named.append(policy.explain().obstacle)
    assert named == [0, 1]
