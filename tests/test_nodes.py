"""The nodes between which policy antway plans: their distance suits the robot, whatever the cells of the map."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, Moves, Observation, RobotSpec, Scenario, Task, Tracks, World, check_episode, run
from antway.arena.suites import SuiteEpisode, build, episodes
from antway.errors import CellBlocked
from antway.kernels.spacetime.context import free_time
from antway.policies.antway.nodes import contexts_for, make_context, on_cells, planning_context, with_far_nodes
from antway.policies.antway.policy import AntwayPolicy
from antway.world.motions import Line
from antway.world.robots import load_robot
from antway.world.world import Obstacle


def finer(grid: Grid, parts: int) -> Grid:
    """Return the same map in cells whose edges are so many times shorter."""
    cells = grid.blocked.repeat(parts, axis=0).repeat(parts, axis=1)
    return replace(grid, blocked=cells, resolution=grid.resolution / parts)


@pytest.mark.parametrize(("robot", "distance"), [("holonomic", 0.15), ("inertia", 0.1), ("diff", 0.1)])
def test_nodes_are_a_part_of_the_radius_apart(robot: str, distance: float) -> None:
    """On a map with cells of 5 cm as on one with cells of 20 cm, as far as nodes are parts or multiples of cells."""
    blocked = np.zeros((60, 80), np.bool_)
    blocked[20:40, 38:42] = True
    for parts, expected in ((1, {"holonomic": 0.2}.get(robot, distance)), (4, distance)):
        policy, grid = AntwayPolicy(), finer(Grid(blocked, 0.2), parts)
        policy.reset(Task(grid, load_robot(robot), (2.1, 6.1), (14.1, 6.1)), seed=0)
        assert policy.state is not None
        assert policy.state.context.resolution == pytest.approx(expected)


def test_no_nodes_are_left_out_if_a_path_is_lost() -> None:
    """A slot of 0.65 m, into which no node of a sparse row falls, leads to the goal; the other way is longer."""
    blocked = np.zeros((120, 200), np.bool_)
    blocked[:, 95:105] = True
    blocked[:13, 95:105] = False
    blocked[100:118, 95:105] = False
    task = Task(Grid(blocked, 0.05), RobotSpec(radius=0.3), (1.0, 1.0), (9.0, 4.02))
    _, over_cells, start, goal = planning_context(task, Moves.THIRTY_TWO)
    sparse = make_context(task.grid, task.robot, goal, stride=3)
    chosen = with_far_nodes(task, over_cells, over_cells, start, goal, Moves.THIRTY_TWO)
    assert sparse.field.min() == 0.0 and chosen.resolution < 0.15
    result = run(Scenario(World(task.grid), task.start, task.goal), "antway", seed=0)
    check_episode(result)
    assert result.reached and result.time < 10.0


@pytest.mark.parametrize("stride", [1, 2])
def test_the_time_to_the_goal_is_the_least_over_the_nodes_around(stride: int) -> None:
    """Straight to a node up to so many rows and columns from the nearest one, also beside the map, and then by the field."""
    rng, robot = np.random.default_rng(1), RobotSpec(radius=0.05, v_max=0.7)
    for _ in range(5):
        grid = Grid(rng.random((12, 15)) < 0.2, 0.3, (-2.0, 5.0, 0.0))
        row, col = np.argwhere(~grid.blocked)[-1].tolist()
        context = make_context(grid, robot, (row, col), stride=stride)
        nodes = grid.to_xy([(r, c) for r in range(row % stride, 12, stride) for c in range(col % stride, 15, stride)])
        places = np.rint((nodes - nodes[0]) / context.resolution)
        for x, y in rng.uniform(grid.bounds()[0] - 0.3, grid.bounds()[1] + 0.3, (20, 2)).tolist():
            for cells in (0, 1, 3):
                apart = np.floor(((x, y) - nodes[0]) / context.resolution + 0.5) - places
                near = (np.abs(apart) <= cells).all(axis=1)
                times = np.hypot(*(nodes[near] - (x, y)).T) / 0.7 + context.field[near]
                assert free_time(context, x, y, cells) == pytest.approx(times.min(initial=math.inf))


def test_a_fine_map_is_crossed_like_a_coarse_one() -> None:
    """With cells of 5 cm, the search used to spend its moves before it had seen half of what it sees with 20 cm."""
    suite, times = episodes("synthetic", 1, "diff")[0].suite, []
    for number in (6100, 6101, 6102):
        episode = SuiteEpisode("synthetic", suite, "aisles/medium", number, "diff")
        scenario = build(episode)
        grid = finer(scenario.world.grid, 4)
        fine = replace(scenario, world=replace(scenario.world, grid=grid))
        ends = [run(one, "antway", seed=episode.seed) for one in (scenario, fine)]
        for end in ends:
            check_episode(end)
        assert all(end.reached for end in ends)
        times.append([end.time for end in ends])
    coarse, fine_times = np.mean(times, axis=0)
    assert fine_times < 1.1 * coarse


@pytest.mark.parametrize("robot", ["holonomic", "inertia", "diff"])
@pytest.mark.parametrize("far", [15.0, 15.5, 16.0, 16.5, 17.0])
def test_a_robot_backs_out_of_a_corridor_that_somebody_enters(robot: str, far: float) -> None:
    """It has to go back for 3 m into a bay. The search with all moves ends before it gets there; that with few does not."""
    blocked = np.ones((40, 200), np.bool_)
    blocked[13:27] = False
    blocked[20:39, 60:78] = False
    somebody = Obstacle(0.3, Line((far, 2.0), (3.0, 2.0), speed=0.5))
    bay = Scenario(World(Grid(blocked, 0.1), [somebody]), (8.0, 2.0), (18.0, 2.0), load_robot(robot), horizon=60.0)
    result = run(bay, "antway", seed=0)
    check_episode(result)
    assert result.reached and result.time < 2.0 * far


@pytest.mark.parametrize("stride", [1, 2, 3, 4])
def test_amounts_at_nodes_are_shown_in_the_cells_around_them(stride: int) -> None:
    """Each cell of the map shows the nearest node; also at the edges of the map."""
    grid = Grid(np.zeros((14, 17), np.bool_), 0.1, (1.0, -2.0, 0.0))
    context = make_context(grid, RobotSpec(radius=0.05), (9, 6), stride=stride)
    amounts = np.arange(context.rows * context.cols, dtype=np.float32).reshape(context.rows, context.cols)
    top, left, shown = on_cells(context, grid, 0, 0, amounts)
    assert (shown >= 0).all() and top + shown.shape[0] <= 14 and left + shown.shape[1] <= 17
    for row in range(context.rows):
        for col in range(context.cols):
            x, y = context.x0 + col * context.resolution, context.y0 + row * context.resolution
            r, c = grid.cell_at((x, y))
            assert shown[r - top, c - left] == amounts[row, col]


def test_a_cell_shows_the_most_of_the_nodes_in_it() -> None:
    """Where nodes are parts of cells, as for robots with wheels on maps with large cells."""
    grid = Grid(np.zeros((6, 8), np.bool_), 0.2)
    context = make_context(finer(grid, 2), RobotSpec(radius=0.05), (4, 4))
    amounts = np.random.default_rng(0).random((5, 7)).astype(np.float32)
    top, left, shown = on_cells(context, grid, 3, 5, amounts)
    assert (top, left) == (1, 2)
    whole = np.zeros((12, 16), np.float32)
    whole[3:8, 5:12] = amounts
    assert shown.tolist() == whole.reshape(6, 2, 8, 2).max(axis=(1, 3))[1:4, 2:6].tolist()


def test_a_goal_near_which_a_footprint_fits_in_no_heading_is_blocked() -> None:
    """`amr`, 1.0 x 0.7 m, fits into a box of 1.1 x 0.8 m; in one of 0.9 x 0.9 m there is room for the disc inside it alone."""
    for high, wide, fits in ((11, 8, True), (8, 11, True), (9, 9, False)):
        blocked = np.ones((20, 20), np.bool_)
        blocked[2 : 2 + high, 2 : 2 + wide] = False
        goal = 0.2 + 0.05 * wide, 0.2 + 0.05 * high
        task = Task(Grid(blocked, 0.1), load_robot("amr"), goal, goal, goal_tolerance=0.05)
        if fits:
            AntwayPolicy().reset(task, seed=0)
        else:
            with pytest.raises(CellBlocked, match=r"goal = .*footprint fits"):
                AntwayPolicy().reset(task, seed=0)


@pytest.mark.parametrize(("cells", "radius"), [(61, 0.24), (201, 0.2), (401, 0.13)])
def test_a_robot_with_wheels_fits_into_corridors_one_cell_wide(cells: int, radius: float) -> None:
    """Cells of 0.5 m that are divided by an even number have no centre in the middle, and the goal was refused as blocked."""
    comb = np.ones((cells, cells), dtype=bool)
    comb[1, 1:-1] = comb[1:-1, 1::2] = False
    grid = Grid(comb, 0.5)
    policy, task = (
        AntwayPolicy(),
        Task(grid, replace(load_robot("diff"), radius=radius), grid.centre((5, 1)), grid.centre((5, 9))),
    )
    policy.reset(task, seed=0)
    assert policy.state is not None and np.isfinite(policy.state.context.field).sum() > cells


def test_a_map_with_unknown_cells_is_divided_too() -> None:
    """Policy antway refused it, and each turned map, for robots that need finer cells."""
    grid = Grid(np.zeros((12, 12), np.bool_), 0.5, (0.0, 0.0, 0.3)).turned()
    assert grid.unknown is not None
    policy, middle = AntwayPolicy(), grid.bounds().mean(axis=0)
    policy.reset(Task(grid, load_robot("diff"), tuple(middle - 0.5), tuple(middle + 0.5)), seed=0)
    assert policy.state is not None and policy.state.context.resolution < 0.5


@pytest.mark.parametrize("robot", ["inertia", "diff"])
@pytest.mark.parametrize("shape", [(1, 300_000), (300_000, 1)])
def test_a_map_of_one_row_that_is_not_divided_is_driven_along(robot: str, shape: tuple[int, int]) -> None:
    """Fields were interpolated beyond their only row, from whatever memory was there."""
    grid = Grid(np.zeros(shape, dtype=bool), 1.0)
    goal = grid.centre((0, 20) if shape[0] == 1 else (20, 0))
    result = run(Scenario(World(grid), grid.centre((0, 0)), goal, load_robot(robot), horizon=40.0), "antway", seed=0)
    check_episode(result)
    assert result.reached


def test_passages_that_are_hardly_wider_than_two_large_cells_are_found() -> None:
    """A robot without inertia used to end with an error: no centre of a cell is as far from the walls as its radius."""
    blocked = np.zeros((8, 16), np.bool_)
    blocked[[2, 5]] = True
    for radius, y in ((0.3, 2.0), (0.3, 1.9), (0.4, 2.0)):
        scenario = Scenario(World(Grid(blocked, 0.5)), (1.0, 2.0), (6.5, y), robot=RobotSpec(radius=radius))
        result = run(scenario, "antway", seed=0)
        check_episode(result)
        assert result.reached and result.time < 5.5


def test_a_footprint_without_inertia_is_planned_for_on_the_cells_that_it_drives_on() -> None:
    """Before a corridor of 0.4 m, the plan for a disc of its width had finer cells than its rollouts, which was an error."""
    blocked = np.ones((20, 44), np.bool_)
    blocked[5:15, 2:15] = blocked[5:15, 30:43] = blocked[9:11, 15:30] = False
    footprint = (-0.5, -0.15), (0.5, -0.15), (0.5, 0.15), (-0.5, 0.15)
    told = []
    for a_max in (math.inf, 1.0):
        policy = AntwayPolicy()
        policy.reset(Task(Grid(blocked, 0.2), RobotSpec(footprint=footprint, a_max=a_max), (2.0, 2.0), (7.2, 2.0)), seed=0)
        policy.act(Observation(0.0, (2.0, 2.0), (0.0, 0.0), 0.0, Tracks.none()))
        told.append(policy.explain().reason)
    assert told[0] == told[1]


def test_paths_of_a_footprint_without_inertia_keep_from_walls() -> None:
    """It is driven by the same colony as one with inertia, and so has the same contexts."""
    blocked = np.zeros((20, 40), np.bool_)
    blocked[:8, 18:22] = True
    footprint = (-0.5, -0.15), (0.5, -0.15), (0.5, 0.15), (-0.5, 0.15)
    tasks = [Task(Grid(blocked, 0.1), RobotSpec(footprint=footprint, a_max=a), (0.8, 1.2), (3.2, 1.2)) for a in (math.inf, 1.0)]
    for at_once, slower in zip(*(contexts_for(task, Moves.THIRTY_TWO, 0.0) for task in tasks), strict=True):
        assert at_once is not None and slower is not None
        for mine, other in zip(at_once, slower, strict=True):
            assert mine.radius == other.radius and (mine.legal == other.legal).all()


@pytest.mark.parametrize("robot", ["inertia", "diff"])
def test_a_robot_nearer_to_a_wall_than_its_plans_has_a_plan(robot: str) -> None:
    """Plans keep 5 cm more from walls than rollouts do; from within them there was no first leg, and so no plan at all."""
    blocked = np.zeros((40, 60), np.bool_)
    blocked[:10] = True
    task = Task(Grid(blocked, 0.1), load_robot(robot), (1.0, 3.0), (5.0, 1.8))
    policy = AntwayPolicy()
    policy.reset(task, seed=0)
    policy.act(Observation(0.0, (2.5, 1.0 + task.robot.radius + 0.02), (0.0, 0.0), 0.0, Tracks.none()))
    assert policy.explain().reason == "the path is free"


def test_wheels_are_not_planned_through_a_gap_near_the_start_before_which_rollouts_stop() -> None:
    """It leaves 8 mm on each side. The start is near a wall, where less room is kept than elsewhere."""
    blocked = np.zeros((160, 200), np.bool_)
    blocked[80:84] = True
    blocked[80:84, 60:73] = blocked[80:84, 150:170] = False
    robot = RobotSpec(radius=0.252, drive="differential", a_max=1.0, alpha_max=3.0)
    task = Task(Grid(blocked, 0.04), robot, (2.1, 2.9), (2.66, 5.5))
    cell = task.grid.cell_at(task.start)
    all_moves = make_context(task.grid, robot, task.grid.cell_at(task.goal))
    near = contexts_for(task, Moves.THIRTY_TWO, math.nan)[0][1]
    assert all_moves.field.reshape(blocked.shape)[cell] < 5.0 < 8.0 < near.field.reshape(blocked.shape)[cell] < 12.0
    result = run(Scenario(World(task.grid), task.start, task.goal, robot, horizon=30.0), "antway", seed=0)
    check_episode(result)
    assert result.reached
