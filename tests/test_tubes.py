"""Tubes and ways of policy `paper` against sampled twins and plain Dijkstra; timed paths against what the robot then does."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from antway import Grid, RobotSpec, Scenario, World, distance_field, run
from antway.kernels.tracking.tubes import first_conflict
from antway.policies.paper.routes import PathsFrom, StaticRoutes
from antway.policies.paper.tubes import Tubes
from antway.world.policy import Observation, Task, Tracks
from common import cases, costly, free_cells, random_grid

OPEN = Grid(np.zeros((40, 40), dtype=bool), 0.25)


def tubes(rng: np.random.Generator, count: int = 3, fast: float = 1.0) -> Tubes:
    xy, velocity = rng.uniform(1, 9, (count, 2)), rng.uniform(-fast, fast, (count, 2))
    discs = np.column_stack((xy, velocity, rng.uniform(0.2, 0.5, count)))
    return Tubes.predict(0.0, 0.0, discs, OPEN, 8.0)


def gap(trajectory: Tubes, t: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Least distance of the point (x, y) from the edges of the discs at each time t."""
    gaps = []
    for k, radius in enumerate(trajectory.trajectories.radius):
        knot_t, knot_xy = trajectory.knots(k)
        px, py = (np.interp(t, knot_t, knot_xy[:, i]) for i in (0, 1))
        gaps.append(np.hypot(px - x, py - y) - radius)
    return np.min(gaps, axis=0)


def test_where_the_robot_can_stand_is_what_sampling_finds() -> None:
    """A place is free exactly if no sampled instant from arrival on finds it in a tube that is as wide as at arrival."""
    rng = np.random.default_rng(3)
    for _ in range(costly(40, 2000)):
        trajectory, t, xy = replace(tubes(rng), t=1.0), rng.uniform(1, 7, 8), rng.uniform(1, 9, (8, 2))
        growth = rng.choice([0.0, 0.1])
        found = trajectory.standing(t, xy, 6.0, 0.4, growth, 8)
        free = np.isin(np.arange(8), found)
        assert (trajectory.standing(t, xy, 6.0, 0.4, growth, 2) == found[:2]).all()
        for i in range(8):
            least = gap(trajectory, np.linspace(t[i], max(t[i], 6.0), 400), *xy[i]).min() - 0.4 - growth * (t[i] - 1.0)
            assert abs(least) < 0.02 or free[i] == (least > 0.0)


@pytest.mark.parametrize("whole", [False, True])
def test_closed_cells_are_those_that_sampling_finds(whole: bool) -> None:
    """A cell is closed if a tube is there between 0.9 times and 1.3 times the least time of arrival and 0.5 s, or ever."""
    rng, shut = np.random.default_rng(4), 0
    for _ in range(cases(4, 200)):
        trajectory, (top, left) = tubes(rng, 6), rng.integers(8, 24, 2).tolist()
        x, y = OPEN.centre((top + 4, left + 2))
        closed = trajectory.close(OPEN, (top, left, 8, 8), (x, y), 1.5, 0.4, 3.0, whole=whole)
        assert closed.sum() == closed[top : top + 8, left : left + 8].sum()
        for row, col in np.argwhere(np.ones((8, 8)))[::3] + np.array((top, left)):
            px, py = OPEN.centre((int(row), int(col)))
            away = math.hypot(px - x, py - y) / 1.5
            first, last = (0.0, 3.0) if whole else (min(0.9 * away, 3.0), min(1.3 * away + 0.5, 3.0))
            least = gap(trajectory, np.linspace(first, last, 60), px, py).min() - 0.4
            assert abs(least) < 0.03 or closed[row, col] == (least < 0.0)
        shut += closed.sum()
    assert shut > 20


def test_every_cell_is_asked_that_a_tube_may_close() -> None:
    """Each cell of a window against a body that stands at its centre for the time in which the robot may arrive there."""
    rng, shut = np.random.default_rng(6), 0
    for _ in range(cases(80, 2000)):
        trajectory, (top, left) = tubes(rng, 1, 3.0), rng.integers(0, 28, 2).tolist()
        x, y = rng.uniform(1, 9, 2).tolist()
        rows, cols = (9, 12) if rng.random() < 0.5 else (12, 9)
        closed = trajectory.close(OPEN, (top, left, rows, cols), (x, y), 1.5, 0.4, 3.0, whole=False)
        closed = closed[top : top + rows, left : left + cols]
        for row, col in np.ndindex(rows, cols):
            cx, cy = OPEN.centre((top + row, left + col))
            away = math.hypot(cx - x, cy - y) / 1.5
            first, last = min(0.9 * away, 3.0), min(1.3 * away + 0.5, 3.0)
            met, _ = first_conflict(np.array([first]), np.array([(cx, cy)]), last, 0.4, 0.0, trajectory.trajectories)
            assert closed[row, col] == (met < math.inf)
        shut += closed.sum()
    assert shut > 100


def test_conflicts_are_those_that_sampling_finds() -> None:
    """The first conflict of a timed path is the first sampled instant within a tube, as wide as when the leg began."""
    rng = np.random.default_rng(4)
    for _ in range(costly(40, 2000)):
        trajectory, xy, growth = tubes(rng), rng.uniform(1, 9, (4, 2)), rng.choice([0.0, 0.1])
        t = np.cumsum(rng.uniform(0.5, 2.0, 4))
        when, obstacle = first_conflict(t, xy, 7.0, 0.3, growth, trajectory.trajectories)

        def left(times: np.ndarray, t=t, xy=xy, trajectory=trajectory, growth=growth) -> np.ndarray:
            """What is left between the body and the tubes; at a knot as wide as on the leg before it."""
            x, y = (np.interp(times, t, xy[:, k]) for k in (0, 1))
            began = t[np.maximum(np.searchsorted(t, times) - 1, 0)]
            return gap(trajectory, times, x, y) - 0.3 - growth * (began - t[0])

        times = np.linspace(t[0], max(7.0, t[0]), 1500)
        inside = np.flatnonzero(left(times) < -0.01)
        if when == math.inf:
            assert obstacle == -1 and not len(inside)
        else:
            assert left(np.array([when, when + 1e-9])).min() < 1e-6
            assert not len(inside) or when <= times[inside[0]]


def test_ways_are_shortest_and_none_leads_where_none_can() -> None:
    """Ways of the field of one cell have the lengths that Dijkstra gives; unreachable and far cells have none."""
    rng = np.random.default_rng(5)
    for _ in range(cases(60, 2000)):
        grid = Grid(random_grid(rng, 4, 20).blocked, 0.5)
        free = free_cells(grid)
        if not len(free):
            continue
        cell = tuple(free[rng.integers(len(free))].tolist())
        within = [math.inf, 5.0][rng.integers(2)]
        exact, paths = distance_field(grid, cell, within=within), PathsFrom(grid, cell, within)
        assert np.allclose(paths.distance(), exact)
        for row, col in free[:: max(1, len(free) // 10)].tolist():
            nodes = paths.nodes((row, col))
            assert (len(nodes) == 0) == math.isinf(exact[row, col])
            if len(nodes):
                assert nodes[0].tolist() == list(grid.centre((row, col))) and nodes[-1].tolist() == list(grid.centre(cell))
                assert math.isclose(np.hypot(*np.diff(nodes, axis=0).T).sum(), exact[row, col], abs_tol=1e-9)


def test_nodes_that_were_passed_are_left_behind() -> None:
    """Those behind the robot on a straight line, however many; beside the line and before its first node all of them stay."""
    for dx, dy in ((1, 0), (0, -1), (-1, 1), (2, 1)):
        nodes = np.array([(k * dx, k * dy) for k in (1.0, 2.0, 3.0)])
        for share, left in {0.5: 3, 1.0: 2, 1.5: 2, 2.0: 1, 2.5: 1, 3.5: 1}.items():
            assert len(StaticRoutes.ahead((share * dx, share * dy), nodes)) == left
        assert len(StaticRoutes.ahead((1.5 * dx - 0.1 * dy, 1.5 * dy + 0.1 * dx), nodes)) == 3
    corner = np.array([(1.0, 0.0), (2.0, 0.0), (2.0, 1.0)])
    assert StaticRoutes.ahead((2.5, 0.0), corner).tolist() == corner[1:].tolist()


def test_the_robot_is_on_its_timed_path_and_cuts_no_corner_of_a_wall() -> None:
    """After a wait it is where the path says, around corners too; where the chord of a step would touch, it ends there."""
    nodes, start = np.array([(2.0, 1.0), (2.0, 2.55), (3.5, 2.55)]), (1.1, 1.0)
    routes = StaticRoutes(Task(OPEN, RobotSpec(), start, (9.0, 9.0)))
    path, xy = routes.timed(Observation(5.0, start, (0.0, 0.0), 0.0, Tracks.none()), nodes, 1.5), start
    left = np.vstack([np.linspace(a, b, 45)[1:] for a, b in pairwise((start, *nodes))])  # several in a step
    assert path.at(6.4) == start and path.t[0] == 5.0
    for k in range(45):
        t = 6.5 + 0.1 * k
        assert xy == pytest.approx(path.at(t), abs=1e-9)
        command, left = routes.passed(Observation(t, xy, (0.0, 0.0), 0.0, Tracks.none()), left)
        xy = xy[0] + 0.1 * command.velocity[0], xy[1] + 0.1 * command.velocity[1]
    blocked, places = np.zeros((60, 60), dtype=bool), [start]
    blocked[13:, :17] = True
    routes = StaticRoutes(Task(Grid(blocked, 0.1), RobotSpec(v_max=6.0), start, (3.5, 2.55)))
    while len(places) < 5:
        command, nodes = routes.passed(Observation(0.0, places[-1], (0.0, 0.0), 0.0, Tracks.none()), nodes)
        places.append((places[-1][0] + 0.1 * command.velocity[0], places[-1][1] + 0.1 * command.velocity[1]))
    assert np.allclose(places, [start, (1.7, 1.0), (2.0, 1.0), (2.0, 1.6), (2.0, 2.2)])


def test_what_is_driven_for_a_while_ends_at_a_stand_or_at_a_wall() -> None:
    """At a velocity for four periods, and then one to stop in; nothing where that meets a wall."""
    routes = StaticRoutes(Task(OPEN, RobotSpec(), (1.0, 1.0), (9.0, 9.0)))
    seen = Observation(2.0, (1.0, 1.0), (0.0, 0.0), 0.0, Tracks.none())
    path = routes.driven(seen, (0.0, 1.0), 0.35)
    assert np.allclose(path.t, 2.0 + 0.1 * np.arange(6))
    assert np.allclose(path.xy, [(1.0, 1.0 + y) for y in (0.0, 0.1, 0.2, 0.3, 0.4, 0.4)])
    assert routes.driven(seen, (0.0, -1.0), 0.65) is not None and routes.driven(seen, (0.0, -1.0), 0.75) is None


def test_a_robot_off_its_path_rejoins_it_where_the_whole_is_shortest() -> None:
    """Against all nodes of the path, on random maps; up to a cell longer where it joins earlier."""
    rng, seen = np.random.default_rng(9), 0
    while seen < cases(20, 1000):
        grid = Grid(rng.random((12, 12)) < 0.3, 1.0)
        free = grid.to_xy(free_cells(grid))
        start, goal, xy = map(tuple, free[rng.integers(len(free), size=3)].tolist())
        routes = StaticRoutes(Task(grid, RobotSpec(), start, goal))
        path, here = routes.to_goal(start), PathsFrom(routes.inflated, grid.cell_at(xy)).distance()
        nodes = routes.rejoining(xy, path, 3.0)
        if not len(path) or math.isinf(here[grid.cell_at(goal)]):
            assert not len(nodes)
            continue
        ways = [here[grid.cell_at(node)] + routes.length(node, path[k:]) for k, node in enumerate(path.tolist())]
        near = [way for way, node in zip(ways, path.tolist()) if here[grid.cell_at(node)] <= 3.0] or ways
        assert nodes[-1].tolist() == list(goal) and routes.length(xy, nodes) < min(near) + 1.0
        seen += 1


def test_a_robot_with_inertia_stops_before_it_drives_another_way() -> None:
    """It drives on towards its node, or from a stand; while it moves aside or backwards it brakes."""
    routes = StaticRoutes(Task(OPEN, RobotSpec(a_max=1.0), (1.0, 1.0), (9.0, 9.0)))
    for velocity, drives in {(0.5, 0.0): True, (0.0, 0.0): True, (0.4, 0.3): False, (-0.3, 0.0): False}.items():
        seen = Observation(0.0, (1.0, 1.0), velocity, 0.0, Tracks.none())
        command, _ = routes.passed(seen, np.array([(5.0, 1.0)]))
        assert command.velocity == ((1.0, 0.0) if drives else (0.0, 0.0))


def test_the_first_node_is_left_out_where_the_second_is_seen() -> None:
    """Not behind a wall, and not if it is the only one."""
    blocked = np.zeros((10, 10), dtype=bool)
    blocked[3:, 3] = True
    routes = StaticRoutes(Task(Grid(blocked, 1.0), RobotSpec(), (1.5, 5.5), (5.5, 5.5)))
    nodes = np.array([(1.5, 5.5), (1.5, 2.5), (5.5, 5.5)])
    assert routes.joined((1.2, 5.2), nodes).tolist() == nodes[1:].tolist()
    assert routes.joined((1.2, 5.2), nodes[::2]).tolist() == nodes[::2].tolist()
    assert routes.joined((1.2, 5.2), nodes[:1]).tolist() == nodes[:1].tolist()


def test_a_robot_that_passes_several_nodes_in_one_period_drives_on() -> None:
    """A fast robot on a fine map whose path is not pulled taut keeps its direction until it brakes for the end."""
    robot = RobotSpec(radius=0.2, v_max=2.0, a_max=4.0, drive="differential", dynamics="steps")
    routes = StaticRoutes(Task(Grid(np.zeros((20, 60), dtype=bool), 0.1), robot, (1.05, 1.05), (5.05, 1.05)))
    nodes, x, v = np.array([(1.15 + 0.1 * k, 1.05) for k in range(40)]), 1.05, 0.0
    for _ in range(40):
        command, nodes = routes.passed(Observation(0.0, (x, 1.05), (v, 0.0), 0.0, Tracks.none()), nodes)
        assert command.velocity[0] > 0.0 or x > 5.04
        v = min(max(command.velocity[0], v - 0.4), v + 0.4)
        x += 0.1 * v
    assert x == pytest.approx(5.05, abs=1e-3)


def test_pulled_paths_keep_the_nodes_that_are_needed() -> None:
    """On random maps, against a loop over all nodes: after a node that is kept comes the last of those it sees in a row."""
    rng, robot = np.random.default_rng(8), RobotSpec(radius=0.3, drive="differential")
    for _ in range(cases(10, 500)):
        grid = Grid(rng.random((12, 12)) < 0.2, 1.0)
        free = grid.to_xy(free_cells(grid))
        routes = StaticRoutes(Task(grid, robot, *map(tuple, free[rng.integers(len(free), size=2)].tolist())))
        xy = routes.task.start
        here = routes.cell(xy)
        whole = [xy, *map(tuple, routes.home.nodes(here).tolist())]
        kept = routes.pulled(xy, np.array(whole[1:] or np.empty((0, 2)))).tolist()
        i = 0
        for node in kept:
            j = next((k for k in range(i + 2, len(whole)) if not routes.clear(whole[i], whole[k])), len(whole)) - 1
            assert tuple(node) == whole[j]
            i = j
        assert i == len(whole) - 1


@pytest.mark.parametrize(
    "robot",
    [
        RobotSpec(a_max=1.0, dynamics="steps"),
        RobotSpec(drive="differential"),
        RobotSpec(drive="differential", a_max=0.8, turn_rate=1.0, dynamics="steps"),
    ],
)
def test_the_timed_path_is_what_the_robot_drives(robot: RobotSpec) -> None:
    """A robot with inertia or wheels is where its timed path says, within a few control periods' way."""
    blocked = np.zeros((40, 40), dtype=bool)
    blocked[12:28, 12:28] = True
    scenario = Scenario(World(Grid(blocked, 0.25), ()), (1.1, 1.1), (9.1, 9.1), robot)
    result = run(scenario, "paper")
    assert result.reached
    routes, trace = StaticRoutes(scenario.task), result.trace
    nodes = routes.to_goal(scenario.start)
    for i in (0, 8, 20):
        seen = Observation(
            float(trace.t[i]), tuple(trace.xy[i]), tuple(trace.velocity[i]), float(trace.heading[i]), Tracks.none()
        )
        path = routes.timed(seen, routes.ahead(seen.xy, nodes))
        place = np.column_stack([np.interp(trace.t[i:], path.t, path.xy[:, k]) for k in (0, 1)])
        assert np.hypot(*(place - trace.xy[i:]).T).max() < 0.5


def test_predicted_discs_are_mirrored_at_walls() -> None:
    """From when they were seen to the horizon: in an empty room each axis goes to and fro on its own. Rows say the same."""
    rng, room = np.random.default_rng(10), Grid(np.zeros((40, 60), dtype=bool), 0.25, (-3.0, 7.0, 0.0))
    low, high = room.bounds()
    for _ in range(cases(10, 300)):
        radius, velocity = rng.uniform(0.2, 0.5, 3), rng.uniform(-2, 2, (3, 2))
        xy = rng.uniform(low + 0.5, high - 0.5, (3, 2))
        seen_at, t, horizon = rng.uniform(0, 3), rng.uniform(3, 5), rng.uniform(2, 8)
        found = Tubes.predict(t, seen_at, np.column_stack((xy, velocity, radius)), room, horizon)
        assert found.t == t and found.trajectories.radius.tolist() == radius.tolist()
        for k in range(3):
            knot_t, knot_xy = found.knots(k)
            assert (knot_t[0], knot_t[-1]) == pytest.approx((seen_at, t + horizon))
            rows = found.rows()
            rows = rows[np.isclose(rows[:, 6], radius[k])]
            for when in rng.uniform(seen_at + 1e-3, t + horizon - 1e-3, 20):
                least, most = low + radius[k], high - radius[k]
                gone = np.mod(xy[k] + velocity[k] * (when - seen_at) - least, 2 * (most - least))
                there = least + np.minimum(gone, 2 * (most - least) - gone)
                assert [np.interp(when, knot_t, knot_xy[:, axis]) for axis in (0, 1)] == pytest.approx(there.tolist(), abs=1e-6)
                row = rows[np.searchsorted(rows[:, 0], when) - 1]
                assert row[0] <= when + 1e-5 and when <= row[1] + 1e-5
                assert (row[2:4] + row[4:6] * (when - row[0])).tolist() == pytest.approx(there.tolist(), abs=1e-4)


def test_a_standing_obstacle_has_a_standing_tube() -> None:
    """What does not move is predicted to stay."""
    trajectory = Tubes.predict(2.0, 2.0, np.array([[5.0, 5.0, 0.0, 0.0, 0.3]]), OPEN, 5.0)
    assert np.allclose(trajectory.knots(0)[1], (5.0, 5.0))


@pytest.mark.parametrize(("length", "start"), [(3.0, 0.4), (3.0, 0.0), (0.5, 0.4), (0.5, 0.0)])
def test_the_knots_of_a_leg_lie_on_its_ramps(length: float, start: float) -> None:
    """Against a robot that is driven in steps of 0.1 ms: as fast as it can still brake to a stand at the end of the leg."""
    robot = RobotSpec(a_max=0.8, brake_max=2.0)
    routes = StaticRoutes(Scenario(World(OPEN, ()), (1.0, 1.0), (9.0, 9.0), robot).task)
    seen = Observation(2.0, (1.0, 1.0), (start, 0.0), 0.0, Tracks.none())
    path = routes.timed(seen, np.array([(1.0 + length, 1.0)]))
    t, x, v, step = 0.0, 0.0, start, 1e-4
    driven = [(t, x)]
    while x < length - 1e-4 and t < 10.0:
        v = min(v + robot.a_max * step, robot.v_max, math.sqrt(2.0 * 2.0 * (length - x)))
        t, x = t + step, x + v * step
        driven.append((t, x))
    there = np.interp(path.t - 2.0, *np.array(driven).T)
    assert there == pytest.approx(path.xy[:, 0] - 1.0, abs=2e-3) and path.t[-1] - 2.0 == pytest.approx(
        t + math.sqrt(1e-4), abs=3e-3
    )


def test_a_robot_stops_at_corners_and_first_if_it_drives_elsewhere() -> None:
    """It turns by 90 and by 180 degrees where it stands, and not where the path goes straight on."""
    routes = StaticRoutes(Scenario(World(OPEN, ()), (1.0, 1.0), (9.0, 9.0), RobotSpec(a_max=0.8, brake_max=2.0)).task)
    rest, across = (Observation(2.0, (1.0, 1.0), v, 0.0, Tracks.none()) for v in ((0.0, 0.0), (0.0, 0.4)))
    nodes = np.array([(3.0, 1.0), (3.0, 3.0), (3.0, 2.0)])
    path, later = routes.timed(rest, nodes), routes.timed(across, nodes)
    assert later.t[1:] == pytest.approx(path.t[1:] + 0.4 / 2.0) and later.xy.tolist() == path.xy.tolist()
    assert all(corner in path.xy.tolist() for corner in nodes.tolist())
    straight = routes.timed(rest, np.array([(2.0, 1.0), (3.0, 1.0)]))
    assert straight.xy.tolist() == path.xy[: len(straight.t)].tolist() and (2.0, 1.0) not in straight.xy.tolist()


@pytest.mark.parametrize(("robot", "stops"), [({}, False), ({"a_max": 1.0}, True), ({"a_max": 25.0}, False)])
def test_a_path_keeps_its_last_node_for_robots_that_turn_at_once_and_others(robot: dict, stops: bool) -> None:
    """One that reaches full speed, either way, in a period turns at once; none forgets where it is to stand."""
    routes = StaticRoutes(Scenario(World(OPEN, ()), (1.0, 1.0), (9.0, 9.0), RobotSpec(dynamics="steps", **robot)).task)
    end = np.array([(1.05, 1.0)])
    assert routes.stops is stops
    assert routes.passed(Observation(0.0, (1.0, 1.0), (0.0, 0.0), 0.0, Tracks.none()), end)[1].tolist() == end.tolist()
