"""The search over arcs that seeds the ants in the space of controls, beside all sequences of arcs."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, RobotSpec
from antway.kernels.base.records import RobotState
from antway.kernels.controls.lattice import best_arcs
from antway.kernels.controls.outlook import write_beyond
from antway.policies.antway.control_options import ControlOptions
from antway.policies.antway.controls import ControlColony
from antway.policies.antway.nodes import make_context
from antway.world.policy import Task
from common import cases, costly
from naive.lattice import least_bound
from naive.rollout import cost_of, least_of_arcs

WHEELS = RobotSpec(drive="differential", a_max=1.0, turn_rate=1.9, alpha_max=3.0, v_reverse=0.3)
HOLONOMIC = RobotSpec(a_max=1.0)
CAR = RobotSpec(drive="ackermann", a_max=1.0, v_reverse=0.3, turning_radius=0.6)
FIRM = {"near": 0.0, "risk": 2.0, "decay": 0.0, "stop": 0.0, "progress": 0.0}


def _colony(robot: RobotSpec, rng: np.random.Generator) -> ControlColony:
    """A colony in a room with a pillar, and obstacles beside the robot that stand or go."""
    blocked = np.zeros((40, 50), np.bool_)
    blocked[12:30, 20:24] = True
    task = Task(Grid(blocked, 0.2), robot, (1.1, 4.1), (3.9, 7.1))
    context = make_context(task.grid, robot, task.grid.cell_at(task.goal))
    colony = ControlColony(ControlOptions(), task, context.field.reshape(task.grid.shape), 3, strict=False)
    colony.problem = colony.problem._replace(start=RobotState(2.5, 4.1, rng.uniform(-3.0, 3.0), 0.4, 0.2))
    x, y, vx, vy = rng.uniform((2.5, 5.0, -0.5, -0.5), (3.7, 6.0, 0.5, 0.5), (3, 4)).T
    colony.problem.outlook.near[:] = 3
    for k in range(len(colony.problem.outlook.near)):
        for i in range(3):
            at = x[i] + 0.1 * k * vx[i], y[i] + 0.1 * k * vy[i]
            colony.problem.outlook.disc[k, i] = *at, 0.5, 0.55, 1.0, vx[i], vy[i], math.inf, 0.7, i, 0.6, 0.3
    write_beyond(robot.v_max, robot.dt, colony.problem.outlook)
    colony.problem = colony.problem._replace(weights=colony.problem.weights._replace(**FIRM))
    return colony


@pytest.mark.parametrize("robot", [WHEELS, HOLONOMIC, CAR], ids=["wheels", "holonomic", "car"])
@pytest.mark.parametrize("seed", range(cases(3)))
def test_the_search_is_best_first(robot: RobotSpec, seed: int) -> None:
    colony = _colony(robot, np.random.default_rng(seed))
    for arcs in (1, 3, 6):
        ant = np.empty((arcs * 5, 2))
        bound = least_bound(colony.lattice.held, 5, arcs, colony.problem)
        nodes = colony.lattice._replace(expansions=10_000 if arcs < 6 else 100)
        found = best_arcs(ant, nodes, colony.problem)
        assert found == pytest.approx(bound, abs=1e-9) or (arcs == 6 and found == math.inf)


@pytest.mark.parametrize("robot", [WHEELS, HOLONOMIC, CAR], ids=["wheels", "holonomic", "car"])
@pytest.mark.parametrize("seed", range(costly(2)))
def test_what_is_found_costs_what_its_definition_says(robot: RobotSpec, seed: int) -> None:
    """No sequence of two arcs costs less than the least of all."""
    colony = _colony(robot, np.random.default_rng(seed))
    held, block = colony.lattice.held[seed % 4 :: 4], colony.archive.block
    lattice, ant = colony.lattice._replace(held=held), np.empty((2 * block, 2))
    found = best_arcs(ant, lattice, colony.problem)
    assert found >= least_of_arcs(held, block, 2, colony.problem) - 0.05
    problem = colony.problem
    w = problem.weights
    w = w._replace(risk=w.risk / block, turn_risk=w.turn_risk / block)
    summed = problem._replace(batch=problem.batch._replace(harm=np.empty((64, 0))), weights=w)
    assert 2 * block * robot.dt + cost_of(ant, summed) == pytest.approx(found, abs=0.05)


def test_without_expansions_it_is_the_longest_so_far_and_then_a_stop() -> None:
    colony = _colony(WHEELS, np.random.default_rng(1))
    for expansions, arcs in ((0, 0), (1, 1), (2, 2)):
        ant = np.ones((30, 2))
        assert best_arcs(ant, colony.lattice._replace(expansions=expansions), colony.problem) == math.inf
        driven = np.flatnonzero(ant.any(axis=1))
        assert len(driven) == 5 * arcs and (driven == np.arange(5 * arcs)).all()


def test_where_all_arcs_touch_it_is_a_stop() -> None:
    colony = _colony(WHEELS, np.random.default_rng(1))
    colony.problem.outlook.disc[:, 0, :2] = colony.problem.start[:2]
    write_beyond(WHEELS.v_max, 0.1, colony.problem.outlook)
    ant = np.ones((30, 2))
    assert best_arcs(ant, colony.lattice, colony.problem) == math.inf
    assert (ant == 0.0).all()


def test_arcs_of_a_robot_that_turns_at_once_are_finite() -> None:
    colony = _colony(RobotSpec(drive="differential", turn_rate=1e6), np.random.default_rng(1))
    assert np.isfinite(colony.lattice.held).all() and np.ptp(colony.lattice.held[:, 1]) == pytest.approx(4.0 * math.pi)
