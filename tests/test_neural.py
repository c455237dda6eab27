"""Policies `neural` and `glasius`: activities are those of the published equations, and the robot climbs them to its goal."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import BadParameter, Grid, Outcome, RobotSpec, Scenario, World, check_episode, make_policy, run
from antway.kernels.baselines.neural import CLOSED, FREE, TARGET, ascend, relax, shunt, stamp
from antway.world.motions import BackAndForth
from antway.world.policy import Observation, Task, Tracks
from antway.world.world import Obstacle
from common import cases, costly
from naive import baselines as naive

POINT = RobotSpec(radius=0.1)


def kinds(rng: np.random.Generator, rows: int = 9, cols: int = 11) -> np.ndarray:
    """A random map with its rim."""
    kind = np.where(rng.random((rows, cols)) < 0.25, CLOSED, FREE).astype(np.uint8)
    kind[tuple(rng.integers((rows, cols)))] = TARGET
    return np.pad(kind, 1, constant_values=CLOSED)


def snake(views: int, length: int) -> Grid:
    """One corridor, one cell wide, that goes up and down `views` times."""
    blocked = np.ones((length, 2 * views + 1), dtype=bool)
    for view in range(views):
        blocked[1:-1, 2 * view + 1] = False
        if view:
            blocked[1 if view % 2 else -2, 2 * view] = False
    return Grid(blocked, 1.0)


def ends(grid: Grid) -> tuple[tuple[float, float], tuple[float, float]]:
    last = grid.shape[1] - 2
    return grid.centre((grid.shape[0] - 2, 1)), grid.centre((1 if (last // 2 + 1) % 2 == 0 else grid.shape[0] - 2, last))


def test_glasius_comes_to_the_fixed_point() -> None:
    """Sweeps in any order end at the solution of the linear system, within [0, 1]."""
    rng = np.random.default_rng(0)
    for gain, diagonal in ((0.5, 1 / math.sqrt(2)), (0.95, 1 / math.sqrt(2)), (0.95, 1.0)):
        slope = gain / (4 + 4 * diagonal)
        for _ in range(cases(10, 500)):
            kind = kinds(rng)
            x, order = np.zeros(kind.shape), int(rng.integers(4))
            while relax(x, kind, slope, diagonal, order & 3) > 1e-13:
                order += 1
            np.testing.assert_allclose(x[1:-1, 1:-1], naive.relaxed(kind[1:-1, 1:-1], slope, diagonal), rtol=1e-9, atol=1e-300)
            assert x.min() >= 0.0 and x.max() == 1.0


def test_shunting_neurons_come_to_rest_where_the_equations_do() -> None:
    """Sweeps with infinite and with finite spans end where Euler's method does, within [-1, 1], negative in walls alone."""
    rng = np.random.default_rng(1)
    for _ in range(costly(2, 50)):
        kind = kinds(rng, 4, 5)
        slow = naive.shunted(kind[1:-1, 1:-1], 3.0, 1e-3)
        for span in (math.inf, 0.05):
            x = np.zeros(kind.shape)
            for order in range(200):
                shunt(x, kind, 10.0, 1.0, 1.0, 0.7, 100.0, span, order & 3)
            np.testing.assert_allclose(x[1:-1, 1:-1], slow, rtol=1e-5, atol=1e-12)
            assert np.abs(x).max() <= 1.0 and ((x[1:-1, 1:-1] < 0.0) == (kind[1:-1, 1:-1] == CLOSED)).all()


def test_a_sweep_visits_each_cell_once_in_its_order() -> None:
    """One sweep in each of the four orders against a loop over that order, with the activities as they are by then."""
    rng, slope = np.random.default_rng(4), 0.12
    kind = kinds(rng)
    start = np.where(kind == CLOSED, 0.0, rng.random(kind.shape))
    for order in range(4):
        bounded, neurons = start.copy(), start.copy()
        relax(bounded, kind, slope, 0.8, order)
        shunt(neurons, kind, 10.0, 1.0, 1.0, 0.7, 100.0, math.inf, order)
        slow = np.stack((start, start))
        rows, cols = (range(1, side - 1)[:: 1 - 2 * (order >> axis & 1)] for axis, side in enumerate(kind.shape))
        for row in rows:
            for col in cols:
                near = [(slow[:, r, c], d) for r, c, d in naive.neighbours(kind, row, col)]
                excited = 0.7 * sum(max(x[1], 0.0) / d for x, d in near) + 100.0 * (kind[row, col] == TARGET)
                inhibited = 100.0 * (kind[row, col] == CLOSED)
                plain = slope * sum(x[0] * (1.0 if d == 1.0 else 0.8) for x, d in near)
                slow[0, row, col] = {FREE: plain, CLOSED: 0.0, TARGET: 1.0}[int(kind[row, col])]
                slow[1, row, col] = (excited - inhibited) / (10.0 + excited + inhibited)
        np.testing.assert_allclose((bounded, neurons), slow, rtol=1e-9, atol=1e-300)


def test_one_neuron_follows_the_equation_in_time() -> None:
    """A target without neighbours: x(t) = E / (A + E) (1 - exp(-(A + E) t))."""
    kind, x = np.full((3, 3), CLOSED, np.uint8), np.zeros((3, 3))
    kind[1, 1] = TARGET
    for n in range(1, 6):
        shunt(x, kind, 10.0, 1.0, 1.0, 0.7, 100.0, 0.004, 0)
        assert x[1, 1] == pytest.approx(100 / 110 * (1 - math.exp(-110 * 0.004 * n)), rel=1e-12)


def test_stamp_closes_what_obstacles_cover() -> None:
    """Just the free cells whose centres are nearer than the reach."""
    rng, frame = np.random.default_rng(2), np.array([-1.0, 2.0, 0.5])
    for _ in range(cases(50, 5000)):
        kind = kinds(rng)
        before, xy, contact_radius = kind.copy(), rng.uniform(-3, 9, (3, 2)), rng.uniform(0.1, 2.0, 3)
        stamp(kind, frame, xy, contact_radius)
        rows, cols = np.indices(kind.shape)
        centres = np.stack((-1.0 + (cols + 0.5) * 0.5, 2.0 + (rows + 0.5) * 0.5))
        met = (np.hypot(*(centres[:, None] - xy.T[:, :, None, None])) < contact_radius[:, None, None]).any(axis=0)
        assert (kind == np.where(met & (before == FREE), CLOSED, before)).all()


@pytest.mark.parametrize("name", ["neural", "glasius"])
def test_activity_has_no_peak_but_the_goal(name: str) -> None:
    """From every free cell that has a way the climb ends at the goal: no dead end holds it, in a maze neither."""
    rng = np.random.default_rng(3)
    for _ in range(cases(3, 100)):
        blocked = rng.random((16, 16)) < 0.35
        blocked[12, 12] = False
        grid = Grid(blocked, 0.5)
        policy = make_policy(name)
        policy.reset(Task(grid, POINT, grid.centre((12, 12)), grid.centre((12, 12))), 0)
        for cell in np.argwhere(policy.walls == FREE):
            path = ascend(policy.x, policy.walls, *cell, 600)
            if len(path):
                assert tuple(path[-1]) == policy.goal
            else:
                assert policy.x[tuple(cell)] == 0.0


@pytest.mark.parametrize("name", ["neural", "glasius"])
def test_the_robot_climbs_to_its_goal(name: str) -> None:
    """Through a corridor that winds, and past a disc that crosses, without contact; same seed, same bytes."""
    grid = snake(4, 12)
    start, goal = ends(grid)
    maze = run(Scenario(World(grid), start, goal, robot=POINT, horizon=120.0), name)
    check_episode(maze)
    assert maze.reached and maze.length > 25.0
    disc = Obstacle(0.3, BackAndForth((5.0, 0.5), (5.0, 5.5), (0.3, 0.5), (0.0, 1.0)))
    hall = Scenario(World(Grid(np.zeros((24, 40), dtype=bool), 0.25), (disc,)), (1.125, 3.125), (9.125, 3.125))
    results = [run(hall, name, seed=4) for _ in range(2)]
    check_episode(results[0])
    assert results[0].reached and results[0].trace.digest() == results[1].trace.digest()


def test_activity_underflows_far_from_the_goal() -> None:
    """The known fault: some 400 cells into a corridor there is no activity left in float64, and the robot stands there."""
    grid = snake(10, 43)
    start, goal = ends(grid)
    policy = make_policy("neural")
    result = run(Scenario(World(grid), start, goal, robot=POINT, horizon=1.0), policy)
    assert result.outcome is Outcome.TIMEOUT and result.length == 0.0 and policy.explain().action == "stuck"
    near = np.sort(policy.x[policy.x > 0.0])
    assert 200 < len(near) < 400 and near[0] < 1e-300


def test_the_path_may_begin_in_a_cell_that_an_obstacle_closes() -> None:
    """Then straight neighbours can be reached, and diagonal ones only past cells that are open."""
    kind, x = np.full((5, 5), FREE, np.uint8), np.zeros((5, 5))
    kind[2, 2] = kind[1, 2] = CLOSED
    for cell, reached in {(2, 3): True, (3, 2): True, (3, 3): True, (1, 1): False, (1, 3): False}.items():
        x[:] = 0.0
        x[cell] = 0.5
        assert ascend(x, kind, 2, 2, 3).tolist() == ([list(cell)] if reached else [])


def test_without_a_way_the_robot_stands() -> None:
    """A wall across the map leaves no activity on the far side."""
    blocked = np.zeros((12, 20), dtype=bool)
    blocked[:, 10] = True
    for name in ("neural", "glasius"):
        result = run(Scenario(World(Grid(blocked, 0.5)), (1.25, 3.25), (9.25, 3.25), horizon=2.0), name)
        assert result.outcome is Outcome.TIMEOUT and result.length == 0.0


def test_a_robot_whose_place_is_off_the_map_stands() -> None:
    """A wrong place ends neither the episode nor the policy, which goes on as soon as the place is right."""
    for name in ("neural", "glasius"):
        policy = make_policy(name)
        policy.reset(Task(Grid(np.zeros((5, 10), dtype=bool), 1.0), POINT, (1.5, 1.5), (8.5, 3.5)), 0)
        for xy, action in {(1.5, 1.5): "follow", (-0.3, 1.5): "stuck", (1.5, 5.3): "stuck", (2.5, 1.5): "follow"}.items():
            command = policy.act(Observation(0.0, xy, (0.0, 0.0), 0.0, Tracks.none()))
            assert (policy.explain().action, any(command.velocity)) == (action, action == "follow")


def test_wrong_options_are_refused() -> None:
    """Typed errors name the option."""
    for option, wrong in {"mu": 5.0, "sweeps": 0, "span": 0.0, "margin": -1.0}.items():
        with pytest.raises(BadParameter, match=option):
            make_policy("neural", **{option: wrong})
    with pytest.raises(BadParameter, match="gain"):
        make_policy("glasius", gain=1.0)
