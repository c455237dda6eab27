"""Goals beside which somebody stands: the centre is taken, and the edge of the tolerance is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, RobotSpec, Scenario, World, check_episode, run
from antway.arena.suites import SuiteEpisode, build, facts
from antway.world.motions import Line
from antway.world.world import Obstacle

# Cells (m), how far the goal is from the centre of its cell (m), and how far behind it somebody stands (m).
PLACES = [(0.2, 0.0, 0.48), (0.2, 0.05, 0.5), (0.1, 0.0, 0.5), (0.5, 0.0, 0.55), (0.25, 0.0, 0.5)]


def _scenario(cells: float, off: float, behind: float, leaves: float = 0.0) -> Scenario:
    grid, y = Grid(np.zeros((int(6 / cells), int(10 / cells)), bool), cells), 3.0 + 0.5 * cells
    goal = 8.0 + 0.5 * cells + off, y
    at = goal[0] + behind, y
    motion = Line(at, (at[0], y + 2.5), 1.0, leaves) if leaves else Line(at, at, 0.0)
    return Scenario(World(grid, (Obstacle(0.3, motion),)), (1.0 + 0.5 * cells, y), goal, robot=RobotSpec(), horizon=30.0)


@pytest.mark.parametrize("leaves", [0.0, 20.0])
@pytest.mark.parametrize(("cells", "off", "behind"), PLACES)
def test_who_stands_behind_the_goal_keeps_nobody_from_it(cells: float, off: float, behind: float, leaves: float) -> None:
    """The optimum, `oracle` and `antway` end at the edge of the tolerance, as soon as `follow` does that avoids nothing."""
    scenario = _scenario(cells, off, behind, leaves)
    follows = run(scenario, "follow", seed=1)
    assert follows.reached and follows.time == pytest.approx(6.8 + off, abs=0.01)
    assert facts(scenario, 1).bound == pytest.approx(follows.time, abs=0.01)
    for policy in ("oracle", "antway"):
        result = run(scenario, policy, seed=1)
        assert result.reached and result.time < follows.time + 0.1, policy
        check_episode(result)


def test_no_path_within_the_tolerance_is_sooner_than_the_optimum() -> None:
    """In these episodes the goal's centre is taken when the first path arrives, which then waited, or went round."""
    earlier = {("clutter/high", 3): 15.7, ("aisles/high-noise", 0): 15.3}
    for (group, number), most in earlier.items():
        episode = SuiteEpisode("synthetic", "synthetic", group, number)
        assert facts(build(episode), episode.seed).bound < most
    assert math.isfinite(most)


def test_the_oracle_passes_who_stands_for_good() -> None:
    """The last known motion of somebody who stands, or who stops after two seconds, is long over when the robot comes."""
    grid = Grid(np.zeros((30, 50), bool), 0.2)
    for motion in (Line((5.0, 3.1), (5.0, 3.1), 0.0), Line((5.0, 5.1), (5.0, 3.1), 1.0)):
        scenario = Scenario(World(grid, (Obstacle(0.4, motion),)), (1.1, 3.1), (8.1, 3.1), robot=RobotSpec(), horizon=30.0)
        result = run(scenario, "oracle", seed=1)
        assert result.reached and result.time == pytest.approx(facts(scenario, 1).bound, abs=0.05)


def test_plain_search_ends_within_the_tolerance_too() -> None:
    """A baseline is given what the optimum and `antway` are given."""
    scenario = _scenario(0.1, 0.0, 0.48)
    result = run(scenario, "sipp/predictions=mirrored", seed=1)
    assert result.reached and result.time < 7.0


def test_the_straight_path_is_kept() -> None:
    """Somebody comes from behind in a corridor, another one stands behind the goal, and the robot does not stop and go."""
    blocked = np.zeros((30, 80), bool)
    blocked[:11], blocked[19:] = True, True
    for gap in (0.5, 1.2, 2.2):
        behind, goal = Line((6.0 - 2.2 - 0.6 - gap, 1.5), (6.5, 1.5), 0.5), (6.0, 1.5)
        obstacles = Obstacle(0.3, Line((6.56, 1.5), (6.56, 1.5), 0.0)), Obstacle(0.3, behind)
        scenario = Scenario(World(Grid(blocked, 0.1), obstacles), (3.8, 1.5), goal, robot=RobotSpec(), horizon=20.0)
        result = run(scenario, "antway", seed=1)
        moves = np.hypot(*result.trace.velocity[1:-1].T) > 0.01
        assert result.reached and (np.diff(moves.astype(int)) < 0).sum() <= 1, gap
