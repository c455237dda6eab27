"""Kernels of the world against their sampled twins."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import BadParameter, Grid, RobotSpec, World
from antway.kernels.base.geometry import first_wall, wrap
from antway.kernels.robot.contact import Record, advance
from antway.kernels.robot.dynamics import drive
from antway.world.motions import Line
from antway.world.terrain import terrain_of
from antway.world.world import Obstacle
from common import cases
from naive import world as naive


def test_first_wall_passes_over_free_blocks_alone() -> None:
    """What is known of blocks of cells makes it faster, and changes nothing."""
    rng, hits = np.random.default_rng(2), 0
    for _ in range(cases(300, 10000)):
        shape = rng.integers(1, 40, 2)
        grid = Grid(rng.random(shape) < rng.choice([0.003, 0.03, 0.3]))
        motion = *rng.uniform(-3, shape + 3), *rng.uniform(-30, 30, 2), rng.uniform(0.0, 3.0)
        found = first_wall(grid.blocked, *motion)
        assert first_wall(grid.blocked, *motion, terrain_of(grid).blocks) == found
        hits += found[0] < 1.0
    assert 0.2 < hits / cases(300, 10000) < 0.95


def test_first_wall_agrees_with_dense_sampling() -> None:
    """The first contact with walls is that of dense samples of the way, to the sampling step."""
    rng = np.random.default_rng(1)
    samples = 400
    hits = 0
    for _ in range(cases(150, 5000)):
        blocked = rng.random((8, 8)) < 0.15
        radius = rng.uniform(0.1, 1.2)
        row, col = rng.uniform(0, 7, 2)
        if naive.wall_distance(blocked, row, col) < radius:
            continue
        dr, dc = rng.uniform(-6, 6, 2)
        share, n_row, n_col = first_wall(blocked, row, col, dr, dc, radius)
        slow = naive.first_wall(blocked, row, col, dr, dc, radius, samples)
        if slow == math.inf:  # a grazing contact may fall between samples, by no more than the arc between two of them
            assert share > 1 or naive.wall_distance(blocked, row + share * dr, col + share * dc) <= radius + 1e-6
            continue
        hits += 1
        assert slow - 1.0 / (samples - 1) - 1e-9 <= share <= slow + 1e-9
        assert naive.wall_distance(blocked, row + share * dr, col + share * dc) == pytest.approx(radius, abs=1e-8)
        assert math.hypot(n_row, n_col) == pytest.approx(1.0) and n_row * dr + n_col * dc < 0
    assert hits > 30


def test_drive_agrees_with_its_twin_and_keeps_the_limits() -> None:
    """A holonomic robot gets the nearest velocity its limits allow; a differential one turns and speeds up within its own."""
    rng = np.random.default_rng(2)
    for _ in range(cases(1000)):
        v_max, a_max, dt = rng.uniform(0.2, 2), rng.choice([rng.uniform(0.2, 5), math.inf]), rng.uniform(0.02, 0.3)
        v = rng.normal(size=2)
        v *= min(1.0, v_max / np.hypot(*v))
        command = rng.normal(size=2) * 2
        if rng.random() < 0.1:
            command[0] = rng.choice([math.nan, math.inf])
        heading = rng.uniform(-3, 3)
        robot = RobotSpec(v_max=v_max, a_max=a_max)
        vx, vy, _ = drive(*v, heading, *command, robot.limits, dt)
        np.testing.assert_allclose((vx, vy), naive.drive(v, heading, command, v_max, a_max, dt), atol=1e-12)
        limits = replace(robot, drive="differential").limits
        speed = rng.uniform(0, v_max)
        vx, vy, new = drive(speed * math.cos(heading), speed * math.sin(heading), heading, *command, limits, dt)
        now = vx * math.cos(new) + vy * math.sin(new)
        assert abs(wrap(new - heading)) <= 2.0 * dt + 1e-12 and abs(now - speed) <= a_max * dt + 1e-9
        assert math.hypot(vx, vy) <= v_max + 1e-12 and now >= -1e-12 and abs(new) <= math.pi


def test_no_step_tunnels() -> None:
    """A fast obstacle and a fast robot that pass through each other within one step are seen to meet, at the right instant."""
    world = World(Grid(np.zeros((40, 400), dtype=bool)), [Obstacle(0.2, Line((300.5, 20.0), (0.5, 20.0), speed=100.0))])
    line = world.timeline(0, 10.0)
    t, xy, velocity, heading = np.zeros(2), np.array([[100.5, 20.0], [0, 0]]), np.zeros((2, 2)), np.zeros(2)
    limits, aim = RobotSpec(v_max=100.0).limits, np.array([390.0, 20.0, 0.1])
    record = Record(t, xy, velocity, heading, np.zeros(2), np.array([[100.0, 0.0]]))
    what, obstacle, clearance = advance(0, 1.5, limits, aim, record, terrain_of(world.grid), line.trajectories)
    assert (what, obstacle) == (1, 0) and t[1] == pytest.approx((200.0 - 0.5) / 200.0, abs=1e-12)
    assert clearance == pytest.approx(0.0, abs=1e-9) and xy[1, 0] == pytest.approx(100.5 + 100 * t[1])


def test_a_step_that_begins_in_contact_ends_just_after_its_start() -> None:
    """The times of a record increase, so that no two of its rows are the same instant."""
    world = World(Grid(np.zeros((40, 40), dtype=bool)), [Obstacle(0.2, Line((20.4, 20.0), (10.0, 20.0), speed=1.0))])
    t, xy = np.zeros(2), np.array([[20.0, 20.0], [0, 0]])
    record = Record(t, xy, np.zeros((2, 2)), np.zeros(2), np.zeros(2), np.array([[1.0, 0.0]]))
    terrain, trajectories = terrain_of(world.grid), world.timeline(0, 10.0).trajectories
    what, _, _ = advance(0, 0.1, RobotSpec().limits, np.array([30.0, 20.0, 0.1]), record, terrain, trajectories)
    assert what == 1 and 0.0 < t[1] < 1e-300 and xy[1].tolist() == [20.0, 20.0]


def test_world_refuses_what_is_no_world() -> None:
    """Obstacles without radius or motion and turned maps raise the typed error."""
    grid = Grid(np.zeros((3, 3), dtype=bool))
    with pytest.raises(BadParameter, match="radius"):
        Obstacle(0.0, Line((0, 0), (1, 1), 1.0))
    with pytest.raises(BadParameter, match="motion"):
        Obstacle(1.0, "line")  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match="motion"):
        Obstacle(1.0, Line)  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match=r"obstacles\[0\]"):
        World(grid, [3])  # type: ignore[list-item]
    for wrong in ({"seed": "a", "horizon": 5.0}, {"seed": 0, "horizon": math.nan}):
        with pytest.raises(BadParameter):
            World(grid).timeline(**wrong)
    with pytest.raises(BadParameter, match="yaw"):
        World(Grid(grid.blocked, origin=(0, 0, 0.5)))
