"""Paths on the map that policy `paper` drives, and what baselines make of paths, against slow twins and the simulator."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from antway import Grid, Observation, Problem, RobotSpec, Scenario, Status, Task, TimedPath, Tracks, World, make_policy, solve
from antway.baselines.replan import SHORT, Follow, arrival_time, short_of_walls
from antway.policies.paper.routes import StaticRoutes
from antway.world.line_of_sight import clear
from antway.world.stage import Stage
from common import cases

OPEN = Grid(np.zeros((40, 60), np.bool_), 0.2)
STEPS = {"drive": "holonomic", "dynamics": "steps"}


def seen_at(xy: tuple[float, float], velocity: tuple[float, float] = (0.0, 0.0), t: float = 0.0) -> Observation:
    return Observation(t, xy, velocity, 0.0, Tracks.none())


def pillars(rng: np.random.Generator) -> Grid:
    """Return a room of 12 x 8 m with pillars, free around both ends of a task."""
    walls = rng.random((40, 60)) < 0.06
    walls[17:24, :8], walls[17:24, -8:] = False, False
    return Grid(walls, 0.2, (-3.0, 2.0, 0.0))


def test_cells_of_nodes_are_those_of_the_map() -> None:
    """Also next to the edges of cells and where the map's origin is not 0."""
    grid = Grid(np.zeros((40, 60), np.bool_), 0.2, (-3.0, 2.0, 0.0))
    routes = StaticRoutes(Task(grid, RobotSpec(), (0.0, 4.0), (5.0, 6.0)))
    nodes = np.random.default_rng(0).random((200, 2)) * (11.9, 7.9) + (-3.0, 2.0)
    assert routes.cells(nodes).tolist() == [list(grid.cell_at((x, y))) for x, y in nodes.tolist()]


@pytest.mark.parametrize(("a_max", "brake_max"), [(1.0, 0.5), (0.5, math.inf), (math.inf, 0.5), (math.inf, math.inf)])
def test_the_time_along_a_leg_is_that_of_its_ramps(a_max: float, brake_max: float) -> None:
    """The fastest drive from rest to rest: to the speed at which both ramps fill the leg, or to full speed and on at it."""
    robot = RobotSpec(a_max=a_max, brake_max=brake_max)
    routes = StaticRoutes(Task(OPEN, robot, (1.1, 4.1), (10.9, 4.1)))
    for length in (0.05, 0.4, 3.0, 9.0):
        path = routes.timed(seen_at((1.1, 4.1), t=5.0), np.array([[1.1 + length, 4.1]]))
        ramps = 0.5 / a_max + 0.5 / brake_max  # s^2/m; what both take of a leg for each square of the top speed
        top = min(1.0, math.sqrt(length / ramps) if ramps else math.inf)
        took = length / top + ramps * top if routes.stops else length
        assert path.t[-1] - 5.0 == pytest.approx(took, abs=1e-9)
        assert path.at(path.t[-1]) == pytest.approx((1.1 + length, 4.1))
        for t in np.linspace(5.0, 5.0 + took, 30)[1:-1] if routes.stops else ():  # knots lie on the ramps
            up, left = path.at(t)[0] - 1.1, 1.1 + length - path.at(t)[0]
            assert up <= 0.5 * a_max * (t - 5.0) ** 2 + top**2 / a_max / 16 + 1e-9
            assert left <= 0.5 * brake_max * (5.0 + took - t) ** 2 + top**2 / brake_max / 16 + 1e-9


@pytest.mark.parametrize("a_max", [0.5, 1.0])
def test_corners_take_as_long_as_they_are_said_to_take(a_max: float) -> None:
    """A robot with inertia that stops at four corners arrives when its path says, but for a period a leg and the last 0.2 m."""
    scenario = Scenario(World(OPEN), (1.1, 1.1), (9.1, 5.1), RobotSpec(a_max=a_max, **STEPS))
    stage, routes = Stage(scenario, 0, 60.0), StaticRoutes(scenario.task)
    nodes = np.array([[3.1, 1.1], [3.1, 3.1], [6.1, 3.1], [6.1, 5.1], [9.1, 5.1]])
    told = routes.timed(stage.observe(), nodes)
    outcome = None
    while outcome is None:
        seen = stage.observe()
        command, nodes = routes.passed(seen, nodes)
        outcome, _ = stage.drive(*stage.controls(command, seen))
    assert outcome.value == "reached"
    assert told.t[-1] == pytest.approx(stage.t[stage.n], abs=0.5 + math.sqrt(2 * 0.2 / a_max))


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
def test_a_push_is_driven_as_the_simulator_drives_it(drive: str) -> None:
    """A velocity for some time, and then a stop: place by place what the simulator finds for the same commands."""
    robot = RobotSpec(a_max=0.7, drive=drive, dynamics="steps")
    scenario = Scenario(World(OPEN), (3.1, 4.1), (9.1, 4.1), robot)
    for velocity, push in (((0.9, 0.3), 1.0), ((-0.4, 0.5), 0.35), ((0.0, 0.0), 0.2)):
        stage = Stage(scenario, 0, 20.0)
        path = StaticRoutes(scenario.task).driven(stage.observe(), velocity, push)
        assert path is not None
        for k in range(len(path.t) - 1):
            stage.drive(*(velocity if 0.1 * k < push else (0.0, 0.0)))
        assert np.allclose(path.xy, stage.xy[: stage.n + 1], atol=1e-12) and np.allclose(path.t, stage.t[: stage.n + 1])
        assert stage.at_rest and len(path.t) > push / 0.1


def walled(rng: np.random.Generator, a_max: float, **more: object) -> Task:
    return Task(pillars(rng), RobotSpec(radius=0.15, a_max=a_max, **more), (-2.1, 6.1), (8.1, 6.1))  # type: ignore[arg-type]


@pytest.mark.parametrize("a_max", [math.inf, 1.0])
def test_paths_to_the_goal_are_the_shortest_and_are_driven_without_a_contact(a_max: float) -> None:
    """No longer than those of Dijkstra's algorithm between their cells, with legs that touch nothing."""
    rng, found = np.random.default_rng(4), 0
    for _ in range(cases(8, 200)):
        task = walled(rng, a_max, **STEPS)
        routes = StaticRoutes(task)
        nodes = routes.to_goal(task.start)
        here, goal = routes.cell(task.start), routes.cell(task.goal)
        assert here is not None and goal is not None
        exact = solve(Problem(routes.inflated, here, goal), "dijkstra")
        if exact.status is not Status.FOUND:
            assert not len(nodes)
            continue
        found += 1
        ends = [math.dist(end, routes.inflated.centre(cell)) for end, cell in ((task.start, here), (task.goal, goal))]
        assert routes.length(task.start, nodes) <= exact.length + sum(ends) + 1e-9
        points = [task.start, *map(tuple, nodes.tolist())]
        assert points[-1] == task.goal and all(clear(task, a, b) for a, b in pairwise(points))
        if routes.stops:  # straight on along the path as far as the robot sees
            at_once = StaticRoutes(Task(task.grid, RobotSpec(radius=0.15), task.start, task.goal))
            every = [tuple(xy) for xy in at_once.to_goal(task.start).tolist()]
            assert all(not clear(task, a, every[every.index(b) + 1]) for a, b in pairwise(points[:-1]))
        stage, outcome = Stage(Scenario(World(task.grid), task.start, task.goal, task.robot), 0, 60.0), None
        while outcome is None:
            seen = stage.observe()
            command, nodes = routes.passed(seen, nodes)
            outcome, _ = stage.drive(*stage.controls(command, seen))
        assert outcome.value == "reached"
    assert found > 2


def test_a_path_is_joined_where_that_is_shortest() -> None:
    """Over all its nodes, each reached by Dijkstra's algorithm alone, or less than the edge of a cell longer."""
    rng, far = np.random.default_rng(5), 0
    for k in range(cases(8, 200)):
        task = walled(rng, math.inf)
        routes = StaticRoutes(task)
        path = routes.to_goal(task.start)
        if not len(path):
            continue
        free = np.argwhere(~routes.inflated.blocked)
        off = routes.inflated.centre(tuple(free[int(rng.integers(len(free)))].tolist()))
        here = routes.cell(off)
        assert here is not None
        totals = []
        for i, cell in enumerate(routes.cells(path).tolist()):
            leg = solve(Problem(routes.inflated, here, tuple(cell)), "dijkstra")
            rest = routes.length(tuple(path[i].tolist()), path[i:])
            totals.append((leg.length + rest, leg.length) if leg.status is Status.FOUND else (math.inf, math.inf))
        within = (1.5, math.inf)[k % 2]
        found = routes.rejoining(off, path, within)
        least = min((total for total, leg in totals if leg <= within), default=min(totals)[0])
        if math.isinf(least):
            assert not len(found)
            continue
        points = [off, *map(tuple, found.tolist())]
        assert points[-1] == task.goal and all(clear(task, a, b) for a, b in pairwise(points))
        far += 1
        assert routes.length(off, found) <= least + 0.2 + 1e-6
    assert far > 2


def test_nodes_that_the_robot_has_come_by_are_left_out() -> None:
    """One or several of a straight line in one period, in any direction; the last one stays; off the line none is left out."""
    rng = np.random.default_rng(6)
    for _ in range(50):
        start, turn = rng.random(2) * 10.0, rng.random() * 7.0
        along, aside = np.array([math.cos(turn), math.sin(turn)]), np.array([-math.sin(turn), math.cos(turn)])
        nodes = start + np.outer([0.0, 0.7, 1.1, 2.0], along)
        for way, left in ((-0.1, 0), (0.0, 1), (0.3, 1), (0.7, 2), (0.9, 2), (1.5, 3), (2.0, 3), (2.5, 3)):
            for off in (0.0, 0.05):
                xy = start + way * along + off * aside
                assert len(StaticRoutes.ahead((float(xy[0]), float(xy[1])), nodes)) == 4 - (0 if off else left)


def test_no_path_leads_from_outside_the_map_or_from_within_walls() -> None:
    """Nor to a goal that is no place for the robot any more; and none leads on along no nodes."""
    walls, none, path = np.zeros((40, 60), np.bool_), np.empty((0, 2)), np.array([[5.1, 6.1], [10.9, 6.1]])
    walls[:20] = True
    routes = StaticRoutes(Task(Grid(walls, 0.2), RobotSpec(), (5.1, 6.1), (10.9, 6.1)))
    for place in ((1000.0, 1000.0), (5.0, 1.0)):
        assert routes.cell(place) is None
        assert routes.to_goal(place).shape == routes.rejoining(place, path, 1.0).shape == (0, 2)
    assert routes.rejoining((5.1, 6.1), none, 1.0).shape == (0, 2)
    assert routes.timed(seen_at((5.1, 6.1), t=3.0), none).t.tolist() == [3.0]
    routes.home = None
    assert routes.to_goal((5.1, 6.1)).shape == (0, 2)


@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_wheels_turn_the_short_way_before_they_drive(heading: float) -> None:
    """A path takes as long as the turns at its start and its corner, two periods to stand there, and its ramps."""
    robot = RobotSpec(drive="differential", a_max=1.0, turn_rate=0.8)
    routes = StaticRoutes(Task(OPEN, robot, (5.1, 4.1), (10.9, 4.1)))
    first, second = (-0.6, 0.8), (-1.0, 0.0)
    nodes = np.array([[5.1 - 1.8, 4.1 + 2.4], [5.1 - 3.8, 4.1 + 2.4]])
    seen = Observation(0.0, (5.1, 4.1), (0.0, 0.0), heading, Tracks.none())
    angles = [heading, *(math.atan2(y, x) for x, y in (first, second))]
    turns = sum(abs(math.remainder(b - a, 2.0 * math.pi)) for a, b in pairwise(angles))
    assert routes.timed(seen, nodes).t[-1] == pytest.approx(turns / 0.8 + 0.2 + (3.0 + 1.0) + (2.0 + 1.0))


@pytest.mark.parametrize("along", [True, False])
def test_a_robot_that_drives_along_its_first_leg_goes_on(along: bool) -> None:
    """One that drives elsewhere stops first; the path then is that of a robot at rest, which begins later."""
    routes = StaticRoutes(Task(OPEN, RobotSpec(a_max=1.0, brake_max=0.5), (5.1, 4.1), (10.9, 4.1)))
    nodes, velocity = np.array([[5.1 - 2.4, 4.1 + 1.8]]), (-0.64, 0.48) if along else (0.64, 0.48)
    took = routes.timed(seen_at((5.1, 4.1), velocity), nodes).t[-1]
    rest = 3.0 + 0.5 + 1.0  # for 3 m at 1 m/s, with both ramps
    assert took == pytest.approx(rest - (0.8 - 0.5 * 0.8**2) if along else rest + 0.8 / 0.5)


def test_a_robot_is_astray_once_it_can_turn_and_sees_no_way_on() -> None:
    """One with inertia drives on until it stands; one without is astray at once."""
    walls = np.zeros((40, 60), np.bool_)
    walls[10:30, 28:32] = True
    for a_max in (math.inf, 1.0):
        routes = StaticRoutes(Task(Grid(walls, 0.2), RobotSpec(a_max=a_max), (1.1, 4.1), (10.9, 4.1)))
        for node, hidden in (((10.9, 4.1), True), ((4.1, 4.1), False)):
            for speed in (0.0, 0.5):
                astray = routes.astray(seen_at((3.1, 4.1), (speed, 0.0)), np.array([node]))
                assert astray == (hidden and (speed == 0.0 or a_max == math.inf))


def test_a_motion_arrives_when_dense_samples_of_it_do() -> None:
    """Random motions, with waits, and straight on to the goal. Those that pass it between knots used to arrive later."""
    rng, task = np.random.default_rng(1), Task(OPEN, RobotSpec(v_max=0.8), (1.1, 4.1), (6.1, 4.1), 0.5)
    for _ in range(cases(25, 2000)):
        n = int(rng.integers(1, 6))
        t, xy = np.cumsum(rng.random(n)) + 3.0, rng.random((n, 2)) * 3.0 + (4.6, 2.6)
        if n > 2:
            xy[2] = xy[1]
        path = TimedPath(t, xy)
        found = arrival_time(path, task)
        whole = TimedPath(np.append(t, t[-1] + math.dist(xy[-1], task.goal) / 0.8), np.vstack((xy, task.goal)))
        samples = np.linspace(t[0], whole.t[-1], 2000)
        away = np.array([math.dist(whole.at(s), task.goal) for s in samples.tolist()])
        fine = float(samples[1] - samples[0])
        assert found <= samples[np.argmax(away <= 0.5)] + 1e-9
        assert math.dist(whole.at(found), task.goal) <= 0.5 + 1e-9 and (away[samples < found - fine] > 0.5).all()
    assert arrival_time(TimedPath(np.empty(0), np.empty((0, 2))), task) == math.inf


def test_the_target_is_the_farthest_node_in_sight() -> None:
    """Of the nodes of the path within 2 m; one nearer than `beyond` gives way to the first that is not, or to the last."""
    rng, hidden, near = np.random.default_rng(2), 0, 0
    for _ in range(cases(25, 500)):
        policy = Follow()
        policy.reset(task := Task(pillars(rng), RobotSpec(radius=0.15), (-2.1, 6.1), (8.1, 6.1)), 0)
        seen = seen_at((-2.1, 6.1), t=7.0)
        path = policy.path(seen)
        if not len(path.t) or clear(task, seen.xy, task.goal):
            continue
        nodes = [tuple(xy) for t, xy in zip(path.t.tolist(), path.xy.tolist()) if 7.0 < t <= 9.0]
        within = nodes or [path.at(9.0)]
        sight = [k for k, node in enumerate(within) if clear(task, seen.xy, node)]
        first = sight[-1] if sight else 0
        hidden += first < len(within) - 1
        for beyond in (0.0, 1.0, 3.0):
            far = [node for node in within[first:] if math.dist(seen.xy, node) >= beyond]
            near += not far
            assert policy.target(seen, 2.0, beyond) == pytest.approx(far[0] if far else within[-1])
    assert hidden and near


def test_commands_end_short_of_walls() -> None:
    """After the step, and after braking from it, the robot is clear of walls, and where these slow it, by 1e-6 m or so."""
    rng, slowed = np.random.default_rng(3), 0
    for k in range(cases(100, 3000)):
        robot = RobotSpec(radius=0.15, a_max=(math.inf, 1.0)[k % 2])
        task = Task(pillars(rng), robot, (-2.1, 6.1), (8.1, 6.1))
        vx, vy = rng.normal(size=2) * 20.0
        x, y = short_of_walls(task, seen_at(task.start), float(vx), float(vy)).velocity
        speed = math.hypot(x, y)
        assert speed <= 1.0 + 1e-9 and x * vy == pytest.approx(y * vx) and x * vx >= 0.0
        span = 0.1 + 1.0 / (2.0 * robot.braking)
        ends = [(task.start[0] + x * span * more, task.start[1] + y * span * more) for more in (1.0, 1.0 + 3.0 * SHORT / 0.01)]
        assert clear(task, task.start, ends[0])
        slowed += 0.1 < speed < 0.999
    assert slowed


@pytest.mark.parametrize(("name", "kept"), [("stop", 0.25), ("sipp", 0.05), ("replan", 0.65), ("dstarlite", 0.4)])
def test_who_stands_at_the_goal_keeps_a_method_from_it_within_what_its_paths_keep(name: str, kept: float) -> None:
    """A margin, and the edge of a cell, at whose centre paths end; not where these may end beside the goal, within 0.2 m."""
    task = Task(OPEN, RobotSpec(), (9.5, 4.1), (10.9, 4.1))
    for gap, keeps in ((kept - 1e-3, True), (kept + 1e-3, False)):
        policy = make_policy(name)
        policy.reset(task, 0)
        stands = Tracks([4], [(10.9, 4.1 + 0.6 + gap)], [(0.0, 0.0)], [0.3])
        policy.act(Observation(0.0, task.start, (0.0, 0.0), 0.0, stands))
        assert (policy.explain().obstacle == 4) == keeps


def test_a_path_of_one_cell_leads_to_the_goal_itself() -> None:
    """`dstarlite` in the goal's cell, past its centre, drives on to the goal; from the cell before, to that centre."""
    task = Task(OPEN, RobotSpec(v_max=0.3), (9.5, 4.1), (10.97, 4.17), 0.01)
    for start, target in (((10.93, 4.13), task.goal), ((10.75, 4.13), (10.9, 4.1))):
        policy = make_policy("dstarlite")
        policy.reset(task, 0)
        x, y = policy.act(seen_at(start)).velocity
        step = min(0.03, math.dist(start, target))
        direction = np.subtract(target, start) / math.dist(start, target)
        assert (x * 0.1, y * 0.1) == pytest.approx(tuple(step * direction), abs=1e-9)
