"""Cars: how long they take to the goal from each heading, and that they find the way that their turning radius leaves them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import Grid, Outcome, RobotSpec, Scenario, Task, World, check_episode, run
from antway.kernels.controls.fields import fitting_poses, turning_times
from antway.world.rollouts import static_field, static_time
from common import cases
from naive.turning import backup

CAR = RobotSpec(drive="ackermann", radius=0.3, v_max=0.8, a_max=1.5, turning_radius=1.2, turn_rate=2.0)


@pytest.mark.parametrize("seed", range(cases(4)))
@pytest.mark.parametrize("v_reverse, radius, turn_rate", [(0.0, 0.8, 2.0), (0.4, 0.8, 0.7), (0.4, 2.43, 2.0)])
def test_no_pose_is_bettered_by_a_single_arc(seed: int, v_reverse: float, radius: float, turn_rate: float) -> None:
    rng = np.random.default_rng(seed)
    rows, cols, headings, size = 9, 11, 12, 0.3
    times = np.hypot(*np.indices((rows, cols)) - np.array([4.0, 5.0])[:, None, None]) * size
    times[(rng.random((rows, cols)) < 0.15) & (times > 0.0)] = math.inf
    fits = np.isfinite(times)[None] & (rng.random((headings, rows, cols)) > 0.1 * (seed % 2))
    poses = turning_times(times, fits, size, radius, turn_rate, 1.0, v_reverse, 10_000)
    assert (np.isinf(poses) == ~fits).all()
    assert (poses <= np.where(fits, times, math.inf) + 60.0).all()
    for k in range(headings):
        for row, col in np.argwhere(fits[k] & (times > 1.4 * size)).tolist():
            at = k, row, col
            assert poses[at] == pytest.approx(backup(poses, times, at, size, radius, turn_rate, 1.0, v_reverse), abs=0.1)


def test_in_the_open_a_car_turns_before_it_comes_back() -> None:
    """Beside the straight line stands what Dubins' paths take: half a circle and more to what is behind."""
    side, size, radius = 81, 0.1, 1.0
    times = np.hypot(*np.indices((side, side)) - 40.0) * size
    poses = turning_times(times, np.ones((24, side, side), bool), size, radius, 2.0, 1.0, 0.0, 80)
    assert poses[0, 40, 20] == pytest.approx(2.0, abs=0.05)  # ahead
    behind = poses[12, 40, 20]  # 2 m behind: the shortest path there is a turn by 270 degrees less what the tangent saves
    tangent = math.sqrt(2.0**2 + 1.0**2 - 1.0**2)
    turned = 2.0 * math.pi - 2.0 * math.atan2(radius, tangent) - (math.pi - 2.0 * math.atan2(radius, tangent))
    assert turned * radius < behind < 1.25 * (turned * radius + tangent)


def test_no_arc_leads_through_a_wall() -> None:
    """A car with a large turning radius drives long arcs; a wall thinner than they are is a wall all the same."""
    times = np.hypot(*np.indices((30, 30)) - 4.0) * 0.2
    times[12] = math.inf
    poses = turning_times(times, np.isfinite(times)[None].repeat(24, axis=0), 0.2, 4.0, 2.0, 1.0, 1.0, 200)
    assert (poses[:, 13:, :] == times[13:] + 60.0).all()


def test_beyond_a_gap_whose_turns_are_finer_than_the_cells_times_fall_towards_it() -> None:
    """They were those after 80 iterations, alike over the whole room, in which a car with a plan stood forever."""
    times = np.hypot(*np.indices((30, 30)) - 4.0) * 0.2
    times[12], times[12, 15] = math.inf, 3.2
    fits = np.isfinite(times)[None].repeat(24, axis=0)
    fits[:, 12] = False
    poses = turning_times(times, fits, 0.2, 0.9, 2.0, 1.0, 0.5, 1)
    assert (poses[:, 13:, :] == times[13:] + 60.0).all()


def test_a_car_that_turns_slowly_takes_a_wide_arc_or_drives_slowly() -> None:
    """At 1 m/s and 0.4 rad/s half a turn takes 7.9 s, although the turning radius is 1 m."""
    side = 81
    times = np.hypot(*np.indices((side, side)) - 40.0) * 0.1
    poses = [turning_times(times, np.ones((24, side, side), bool), 0.1, 1.0, rate, 1.0, 0.0, 80) for rate in (2.0, 0.4)]
    assert poses[1][0, 40, 20] == pytest.approx(poses[0][0, 40, 20], abs=0.05)  # ahead
    assert math.pi / 0.4 < poses[1][12, 40, 20] < 2.0 * poses[0][12, 40, 20] + 2.0  # behind


def aisle(v_reverse: float = 0.0) -> Scenario:
    """A car that faces up an aisle in which it cannot turn; the shortest path leads down and out of it."""
    blocked = np.zeros((120, 100), dtype=bool)
    blocked[20:100, 30:39] = blocked[20:100, 60:69] = True
    return Scenario(World(Grid(blocked, 0.1)), (5.0, 4.0), (1.5, 6.5), replace(CAR, v_reverse=v_reverse), horizon=60.0)


@pytest.mark.parametrize("v_reverse", [0.0, 0.3])
def test_a_car_drives_out_of_an_aisle_in_which_it_cannot_turn(v_reverse: float) -> None:
    result = run(aisle(v_reverse), "antway", seed=0)
    check_episode(result)
    assert result.outcome is Outcome.REACHED


def test_who_turns_at_once_needs_no_times_by_heading() -> None:
    grid = Grid(np.zeros((20, 20), dtype=bool), 0.2)
    times = np.hypot(*np.indices((20, 20)) - 10.0) * 0.2
    field = static_field(Task(grid, RobotSpec(drive="differential", a_max=1.0), (2.1, 2.1), (2.1, 2.1)), times)
    assert field.turning.size == 0
    assert static_time(field, (2.1, 0.1, 0.0, 0.0, 0.0)) == pytest.approx(1.8, abs=0.1)
    field = static_field(Task(grid, CAR, (2.1, 2.1), (2.1, 2.1)), times / 0.8)
    ahead, behind = (static_time(field, (2.1, 0.3, heading, 0.0, 0.0)) for heading in (0.5 * math.pi, -0.5 * math.pi))
    assert ahead == pytest.approx(2.25, abs=0.2)
    assert behind > ahead + 3.0


def test_a_body_fits_where_no_part_of_it_is_in_a_wall() -> None:
    """Compared with points of the body, a centimetre apart; those nearer to a wall than 2 cm may be told either way."""
    rng = np.random.default_rng(4)
    blocked = rng.random((20, 24)) < 0.03
    grid, size = Grid(blocked, 0.3), 0.3
    car = replace(CAR, footprint=((0.9, 0.25), (-0.3, 0.25), (-0.3, -0.25), (0.9, -0.25)))
    field = static_field(Task(grid, car, (3.0, 3.0), (3.0, 3.0)), np.hypot(*np.indices(blocked.shape) - 10.0) * size)
    fits = fitting_poses(field, np.array([0.15, 0.15, 1.0 / size]), 8, *blocked.shape, 0.0)
    assert 0.2 < fits.mean() < 0.9

    def free(k: int, row: int, col: int, wider: float) -> bool:
        """Whether the body, wider by this much on each side, is on the map and off all blocked cells."""
        ahead, left = np.meshgrid(np.arange(-0.3 - wider, 0.9 + wider, 0.01), np.arange(-0.25 - wider, 0.25 + wider, 0.01))
        cos, sin = math.cos(0.25 * math.pi * k), math.sin(0.25 * math.pi * k)
        cols = np.floor(col + 0.5 + (cos * ahead - sin * left) / size).astype(int)
        rows = np.floor(row + 0.5 + (sin * ahead + cos * left) / size).astype(int)
        on_map = (rows >= 0) & (cols >= 0) & (rows < blocked.shape[0]) & (cols < blocked.shape[1])
        return bool(on_map.all() and not blocked[rows, cols].any())

    for k, row, col in np.ndindex(*fits.shape):
        assert free(k, row, col, -0.02) if fits[k, row, col] else not free(k, row, col, 0.02)
