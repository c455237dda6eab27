"""Giving way: the robot and somebody else wait for one another in a passage of one width."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, Moves, RobotSpec, Scenario, World
from antway.kernels.base.records import RobotState
from antway.kernels.base.rng import make_state
from antway.kernels.robot.motion import drive_cycle
from antway.kernels.tracking.predict import ID, RADIUS, X, Y
from antway.policies.antway import yielding
from antway.policies.antway.detours import Detours
from antway.policies.antway.nodes import make_context
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.yielding import Dance, Yielding
from antway.world.policy import XY, Observation, Task, Tracks
from antway.world.robots import load_robot
from antway.world.stage import Stage
from antway.world.trace import Outcome

START, GOAL = (2.0, 2.0), (9.0, 2.0)


def rooms() -> Grid:
    """Return two rooms of 4 x 4 m, joined by a corridor of 1 m that is 3 m long."""
    blocked = np.zeros((40, 110), np.bool_)
    blocked[:, 40:70] = True
    blocked[15:25, 40:70] = False
    return Grid(blocked, 0.1)


@pytest.mark.parametrize("robot", ["holonomic", "diff"])
def test_a_robot_gives_way_to_who_waits_for_it(robot: str) -> None:
    """It meets somebody in the corridor who comes in sight late, and stops; it backs out and lets him pass."""
    stage, policy = Stage(Scenario(World(rooms()), START, GOAL, load_robot(robot)), 1, 60.0), AntwayPolicy()
    policy.reset(stage.task, 1)
    x, outcome, reasons, came = 6.9, None, [], False
    while outcome is None:
        robot_x, robot_y = stage.xy[stage.n].tolist()
        came = came or robot_x > 4.2
        is_held_up = abs(robot_y - 2.0) < 0.5 and -2.0 < robot_x - x < 0.0
        speed = 0.0 if is_held_up or x < 1.0 or not came else -0.6
        seen, other = stage.observe(), (np.array([7]), np.array([[x, 2.0]]), np.array([[speed, 0.0]]), np.array([0.25]))
        seen = replace(seen, tracks=Tracks(*(one[: int(came)] for one in other)))
        command = policy.act(seen)
        assert policy.task == stage.task
        if stage.n % 40 == 0:
            reasons.append(policy.explain().reason)
        x += speed * stage.task.robot.dt
        outcome, _ = stage.drive(*stage.controls(command, seen))
        assert math.dist(stage.xy[stage.n], (x, 2.0)) > stage.task.robot.radius + 0.25
    assert outcome is Outcome.REACHED and any("gives way" in reason for reason in reasons)


def goes(grid: Grid, at: XY, other: XY, came: float = 1.5, clock: float = 0.0) -> tuple[Task, list[tuple[float, Task]]]:
    """Return the task of a robot that stays for half a minute, as somebody else does, and when it becomes another.

    He comes the last `came` metres at 1 m/s, from the robot's side if it is below 0. Both begin when the clock tells `clock` s.
    """
    task = Task(grid, load_robot("diff"), START, GOAL)
    context = make_context(grid, task.robot, grid.cell_at(GOAL), Moves.EIGHT)
    found, paths, now, changes = Detours(Moves.EIGHT, (context,)), Yielding(), task, []
    estimates = np.zeros((1, 8))
    estimates[0, (ID, RADIUS)] = 7, 0.25
    for t in np.arange(0.0, 30.1, 0.25).tolist():
        estimates[0, (X, Y)] = other[0] + math.copysign(max(abs(came) - t, 0.0), came), other[1]
        if counted := found.update(estimates, np.full(1, clock + t), clock + t, at):
            found.adopt(counted())
        after = paths.next_task(now, found, clock + t, at)
        if after is not now:
            changes.append((t, after))
            assert paths.asked(after) == task
        now = after
    return task, changes


@pytest.mark.parametrize(("came", "waits"), [(1.5, 6.5), (0.7, 5.0), (0.0, 20.0)])
def test_the_refuge_is_beside_the_way_out(came: float, waits: float) -> None:
    """It is out of the corridor, and whoever comes out has room; one who was not seen to come may just stand there."""
    task, changes = goes(rooms(), (5.0, 2.0), (6.2, 2.0), came)
    when, there = changes[0]
    assert when == pytest.approx(waits, abs=0.5)
    assert 3.0 < there.goal[0] < 4.0 and abs(there.goal[1] - 2.0) > 0.3 + 0.25 + yielding._GAP - 0.1
    assert there.goal_tolerance < task.goal_tolerance and there.robot == task.robot
    if came:  # nobody moves, so it drives on after twice as long
        then, back = changes[1]
        assert back == task and 10.0 <= then - when <= 10.5


def test_a_robot_gives_way_by_every_clock() -> None:
    """By a clock that began below 0 it used to wait for that clock to reach 0."""
    when, there = goes(rooms(), (5.0, 2.0), (6.2, 2.0))[1][0]
    for clock in (-1e6, 1.7e9):
        then, also = goes(rooms(), (5.0, 2.0), (6.2, 2.0), clock=clock)[1][0]
        assert then == when and also.goal == there.goal


def test_the_refuge_may_be_beside_somebody_who_moved_about() -> None:
    """Where the robot stands now, in the middle of an intersection, he does not, although he has been as near as that."""
    blocked = np.ones((40, 110), np.bool_)
    blocked[16:24, 1:-1] = blocked[1:-1, 46:54] = False
    _, changes = goes(Grid(blocked, 0.1), (5.0, 2.0), (6.1, 2.0), -0.7)
    assert changes and abs(changes[0][1].goal[1] - 2.0) > 0.9


@pytest.mark.parametrize("other", [(8.95, 2.0), (5.0, 2.0), (7.0, 2.0)])
def test_a_robot_gives_no_way_where_the_other_can_pass(other: XY) -> None:
    """It stays where it is if he stands at its goal, or beside it, in a hall."""
    assert goes(Grid(np.zeros((40, 110), np.bool_), 0.1), (other[0] - 0.7, 2.0), other)[1] == []


def stands(seed: int, passes: float = 0.0, hurries: float = 0.0) -> list[float]:
    """Return when a robot stands that goes to and fro once in 2 s, as somebody else does before it.

    He passes by at `passes` m/s besides, and the robot comes nearer to its goal by `hurries` s in each second.
    """
    task, dance, rng, times = Task(rooms(), load_robot("holonomic"), START, GOAL), Dance(), make_state(seed, 0), []
    for n in range(100):
        t, shift = 0.1 * n, abs(0.1 * n % 2.0 - 1.0)
        if n % 3 == 0:
            dance.update(task, 7.0 + shift - hurries * t, t, (2.0 - shift, 2.0))
        other = Tracks(np.array([7]), np.array([[8.0 + shift, passes * t]]), np.zeros((1, 2)), np.array([0.3]))
        if dance.stands(Observation(t, (2.0 - shift, 2.0), (0.0, 0.0), 0.0, other), 1.0, rng):
            times.append(t)
    return times


def test_two_who_go_to_and_fro_before_one_another_stand_for_different_times() -> None:
    """The robot drives on before somebody who passes, and if it comes nearer to its goal."""
    times = [stands(seed) for seed in range(4)]
    assert all(2.0 < one[0] < 5.0 and len(one) >= 10 for one in times) and len({len(one) for one in times}) > 1
    assert stands(0) == times[0] and stands(0, passes=1.0) == stands(0, hurries=1.0) == []


def test_a_robot_gives_way_out_of_a_corridor_that_leaves_no_margin() -> None:
    """What it plans with has a path from where it stands, not from where the episode began: there is no margin here."""
    walls, middle = np.ones((60, 200), dtype=bool), 30.5 * 0.05
    walls[5:55, 3:60] = walls[5:55, 140:197] = False
    walls[25:36, 60:140] = False  # 0.55 m wide
    robot = RobotSpec(radius=0.25, drive="differential", a_max=1.0)
    policy = AntwayPolicy()
    policy.reset(Task(Grid(walls, 0.05), robot, (1.5, middle), (8.5, middle)), 0)
    state, other = RobotState(4.5, middle, 0.0, 0.0, 0.0), 5.4
    for k in range(250):
        place, velocity = state[:2], (state.a * math.cos(state.theta), state.a * math.sin(state.theta))
        near = math.dist(place, (other, middle)) < 0.85
        comes = Tracks([1], [[other, middle]], [[0.0 if near else -0.5, 0.0]], [0.25])
        seen = Observation(0.1 * k, place, velocity, state.theta, comes, turn_rate=state.b)
        state = drive_cycle(state, *policy.act(seen).acts(seen, robot), robot.limits, 0.1)
        other -= 0.0 if near else 0.05
        if state.x < 2.7:
            break
    assert state.x < 2.7
