"""A holonomic robot with a footprint cannot turn: it is planned for in the heading that it keeps."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, Moves, Outcome, RobotSpec, Scenario, Task, World, check_episode, run
from antway.kernels.robot.brake import fits_at
from antway.policies.antway.detours import node_near
from antway.policies.antway.nodes import contexts_for, is_turned
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.state import contexts_from
from antway.world.policy import Observation, Tracks
from antway.world.robots import load_robot
from antway.world.terrain import body_of, walls_of
from common import cases
from naive import motion as twin

LONG = RobotSpec(drive="holonomic", footprint=((0.5, 0.25), (-0.5, 0.25), (-0.5, -0.25), (0.5, -0.25)), sensor_range=6.0)


def rooms(*doors: tuple[str, float, float]) -> Grid:
    """Two rooms of 6 x 4 m on the left and one of 6 x 8 m on the right; doors are in the wall across x ("x") or y ("y")."""
    blocked = np.zeros((160, 240), np.bool_)
    blocked[:, 118:122] = True
    blocked[78:82, :118] = True
    for across, low, high in doors:
        part = slice(round(low / 0.05), round(high / 0.05))
        blocked[(part, slice(118, 122)) if across == "x" else (slice(78, 82), part)] = False
    return Grid(blocked, 0.05)


@pytest.mark.parametrize("a_max", [math.inf, 1.0])
@pytest.mark.parametrize(
    ("doors", "goal"),
    [
        ([("x", 1.5, 2.4)], (10.0, 2.0)),  # straight on
        ([("x", 0.5, 1.35), ("y", 1.0, 2.2), ("x", 6.0, 7.5)], (10.0, 3.5)),  # lengthwise through a door of 0.85 m
        ([("y", 2.0, 2.9)], (5.0, 6.0)),  # one that the robot passes only in this heading
        ([("y", 2.0, 2.9), ("x", 1.4, 2.6), ("x", 5.4, 6.6)], (4.5, 6.0)),  # not through the other two, which are wider
    ],
)
def test_doors_are_passed_where_the_footprint_fits(
    doors: list[tuple[str, float, float]], goal: tuple[float, float], a_max: float
) -> None:
    """The robot takes the shortest way; it used to turn back before the last two, or to reach the goal after 20 and 36 s."""
    scenario = Scenario(World(rooms(*doors)), (2.0, 2.0), goal, replace(LONG, a_max=a_max), horizon=60.0)
    result = run(scenario, "antway", seed=0)
    check_episode(result)
    assert result.reached and result.time < 1.15 * math.dist((2.0, 2.0), goal) + 1.0
    assert all(decision.action != "stuck" for _, decision in result.trace.decisions)


@pytest.mark.parametrize("a_max", [math.inf, 1.0])
def test_who_fits_nowhere_stands_and_says_so(a_max: float) -> None:
    """In this heading the footprint is 1 m wide before a door of 0.7 m; the robot used to drive to and fro."""
    grid = rooms(("x", 1.5, 2.2), ("y", 1.0, 3.0))
    policy, scenario = AntwayPolicy(), Scenario(World(grid), (2.0, 1.0), (10.0, 7.0), replace(LONG, a_max=a_max), horizon=5.0)
    result = run(scenario, policy, seed=0)
    check_episode(result)
    assert result.outcome is Outcome.TIMEOUT and result.length == 0.0
    assert policy.explain().action == "stuck" and "no path" in policy.explain().reason


@pytest.mark.parametrize("robot", ["holonomic", "inertia", "diff", "jackal", "amr"])
def test_a_map_without_a_path_is_said_to_have_none(robot: str) -> None:
    """A robot with wheels or inertia used to stand and say that the path is free."""
    policy, scenario = AntwayPolicy(), Scenario(World(rooms()), (2.0, 2.0), (10.0, 4.0), load_robot(robot), horizon=2.0)
    result = run(scenario, policy, seed=0)
    check_episode(result)
    assert result.length == 0.0
    assert policy.explain().action == "stuck" and policy.explain().reason.startswith("the map has no path to the goal")


def test_plans_are_for_the_heading_that_is_observed() -> None:
    """In one heading the door is open, in the other it is shut, and back again, a cycle later once the robot drives."""
    policy, task = AntwayPolicy(), Task(rooms(("x", 1.5, 2.4)), LONG, (2.0, 2.0), (10.0, 2.0))
    policy.reset(task, seed=0)
    finite = []
    for k, heading in enumerate((0.0, 0.02, 0.5 * math.pi, 0.5 * math.pi, -0.01, -0.01)):
        policy.act(Observation(0.1 * k, task.start, (0.0, 0.0), heading, Tracks.none()))
        assert policy.state is not None
        finite.append(math.isfinite(policy.state.context.field.reshape(policy.state.context.rows, -1)[:, :40].min()))
    assert finite == [True, True, True, False, False, True]
    assert is_turned(LONG, math.pi, -math.pi + 0.11) and not is_turned(LONG, math.pi, -math.pi + 0.09)
    assert not is_turned(load_robot("amr"), 0.0, 1.0)


def test_where_a_footprint_fits_is_where_it_is_clear_of_walls() -> None:
    """Compared with the distance of the turned polygon from every blocked square and every edge of the map."""
    rng, seen, corners = np.random.default_rng(5), [0, 0], np.array(LONG.footprint)
    for _ in range(cases(20, 2000)):
        grid, heading, fits = Grid(rng.random((24, 30)) < 0.012, 0.1), rng.uniform(-4.0, 4.0), np.empty((12, 15), np.bool_)
        fits_at(0.05, 0.05, 0.2, heading, body_of(LONG), walls_of(grid), fits)
        row, col = np.indices(fits.shape)
        body = twin.body_at(corners, 0.05 + 0.2 * col, 0.05 + 0.2 * row, np.float64(heading))
        gap = twin.wall_gap(body, grid.blocked, 0.1, 0.0)
        clear = np.abs(gap) > 1e-6
        np.testing.assert_array_equal(fits[clear], gap[clear] > 0.0)
        seen[0] += (~fits).sum()
        seen[1] += fits.sum()
    assert min(seen) > 300


def test_no_move_leads_over_a_place_where_the_footprint_does_not_fit() -> None:
    """Moves of 32 directions are up to 3.6 nodes long; times to the goal over such a place had the robot stand before it."""
    rng, moves, legal = np.random.default_rng(6), Moves.THIRTY_TWO, 0
    for _ in range(cases(4, 200)):
        blocked = rng.random((60, 80)) < 0.01
        blocked[:15, :15] = blocked[45:, 65:] = False
        task, heading = Task(Grid(blocked, 0.1), LONG, (0.75, 0.75), (7.25, 5.25)), rng.uniform(-1.5, 1.5)
        context = contexts_for(task, moves, heading)[0][1]
        fits = np.empty((context.rows, context.cols), np.bool_)
        fits_at(context.x0, context.y0, context.resolution, heading, body_of(LONG), walls_of(task.grid), fits)
        for row, col in np.argwhere(context.legal.reshape(fits.shape)).tolist():
            for k, between in enumerate(moves.touched):
                if context.legal[row * context.cols + col] >> np.uint32(k) & np.uint32(1):
                    legal += 1
                    assert fits[row, col] and all(fits[row + dr, col + dc] for dr, dc in between)
    assert legal > 1000


def cluttered(seed: int) -> Grid:
    """Four rooms in a row of 10 x 7 m with doors 0.95 to 1.3 m wide at random places, and five boxes."""
    rng, size = np.random.default_rng(seed), 0.07
    blocked = np.zeros((100, 143), np.bool_)
    blocked[[0, -1]] = blocked[:, [0, -1]] = True
    for x in (2.5, 5.0, 7.5):
        col, y = round(x / size), rng.uniform(0.3, 5.5)
        blocked[:, col : col + 2] = True
        blocked[round(y / size) : round((y + rng.uniform(0.95, 1.3)) / size), col : col + 2] = False
    for _ in range(5):
        row, col = rng.integers(0, 92), rng.integers(0, 135)
        blocked[row : row + 5, col : col + 5] = True
    blocked[6:14, 6:22] = blocked[-14:-6, -22:-6] = False
    return Grid(blocked, size)


@pytest.mark.parametrize(("seed", "reached"), [(16, True), (23, True), (37, True), (29, False)])
def test_corners_of_walls_are_passed_or_the_robot_says_that_it_is_stuck(seed: int, reached: bool) -> None:
    """It stood for good: rollouts saw no corner between the ends of a period, and plans led over places without room."""
    robot = RobotSpec(footprint=((0.35, 0.25), (-0.35, 0.25), (-0.35, -0.25), (0.35, -0.25)))
    policy, scenario = AntwayPolicy(), Scenario(World(cluttered(seed)), (0.8, 0.7), (9.2, 6.3), robot, horizon=30.0)
    result = run(scenario, policy, seed=seed)
    check_episode(result)
    assert result.reached == reached and (policy.explain().action == "stuck") != reached


def test_a_robot_that_is_turned_in_a_corridor_is_planned_for_where_it_is() -> None:
    """It could not set out from the start in this heading, but goes on from here; it used to stand in the corridor for good."""
    blocked = np.zeros((120, 200), np.bool_)
    blocked[:30, 60:140] = blocked[45:80, 60:140] = True  # a corridor of 0.75 m, and a hall beside it
    square = RobotSpec(v_max=0.8, a_max=1.0, footprint=((0.3, 0.3), (-0.3, 0.3), (-0.3, -0.3), (0.3, -0.3)))
    policy, task = AntwayPolicy(), Task(Grid(blocked, 0.05), square, (1.2, 1.875), (9.0, 1.875))
    policy.reset(task, seed=0)
    policy.act(Observation(0.0, task.start, (0.0, 0.0), 0.0, Tracks.none()))
    for k in range(1, 4):
        policy.act(Observation(0.1 * k, (5.2, 1.875), (0.4, 0.0), 0.15, Tracks.none()))
    assert policy.state is not None and policy._beside is None
    context = policy.state.detours.contexts[-1]
    assert context.field[node_near(context, (5.2, 1.875))] < 10.0


def test_a_robot_beside_the_map_is_planned_for_from_its_start() -> None:
    """So is one whose place is in a wall: from there no path can be looked for."""
    task = Task(rooms(("x", 1.5, 2.4)), LONG, (2.0, 2.0), (10.0, 2.0))
    expected = contexts_for(task, Moves.EIGHT, 0.0)[0][0].field
    for place in (None, (-3.0, 2.0), (6.0, 7.0)):
        assert (contexts_from(place, task, Moves.EIGHT, 0.0)[0][0].field == expected).all()


def test_a_heading_that_is_new_while_the_robot_drives_is_planned_for_beside_the_cycles() -> None:
    """Who takes over has not seen the heading yet, and used to plan for it within a cycle; who departs goes on with it."""
    task = Task(rooms(("x", 1.5, 2.4)), LONG, (2.0, 2.0), (10.0, 2.0))
    first, second = AntwayPolicy(), AntwayPolicy()
    first.reset(task, seed=0)
    first.act(Observation(0.0, task.start, (0.0, 0.0), 0.0, Tracks.none()))
    assert first._beside is None and first._heading == 0.0
    second.reset(task, seed=1)
    second.take_over(first, 0.1)
    second.act(Observation(0.1, task.start, (0.3, 0.0), 0.0, Tracks.none()))
    assert second._beside is not None
    second.depart(task, seed=2)
    departed = second.state
    second.act(Observation(0.2, task.start, (0.3, 0.0), 0.0, Tracks.none()))
    assert second._beside is None and second.state is departed and second._heading == 0.0
