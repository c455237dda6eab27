"""Nonlinear programs: clear by a dense re-check, within limits, no slower than the polyline; failures fall back (C29)."""

from __future__ import annotations

import builtins

import numpy as np
import pytest

from antway import BadParameter, Grid, plan
from antway.trajectory import nlp
from antway.trajectory.nlp import MissingExtra, smooth
from common import cases

ROOM = np.zeros((20, 20), dtype=bool)
ROOM[8:10, :13] = True
GRID = Grid(ROOM, 0.25)  # 5 x 5 m
AROUND = [(1.0, 1.0), (3.8, 1.0), (3.8, 3.8), (1.0, 3.8)]


def checked(answer, radius: float, v: float, a: float) -> None:
    """Sample the path at less than a tenth of a cell: no wall within the radius; limits of speed and acceleration hold."""
    path = answer.path
    t = np.linspace(path.t[0], path.t[-1], int(path.t[-1] / 0.02) + 2)
    p = GRID.to_points(np.column_stack([np.interp(t, path.t, path.xy[:, k]) for k in (0, 1)]))
    for r, c in np.argwhere(GRID.blocked):
        gap = np.hypot(np.maximum(np.abs(p[:, 0] - r) - 0.5, 0), np.maximum(np.abs(p[:, 1] - c) - 0.5, 0)) * 0.25
        assert gap.min() >= radius - 1e-6
    dt = np.diff(path.t)
    velocity = np.diff(path.xy, axis=0) / dt[:, None]
    assert np.hypot(*velocity.T).max() <= v + 1e-6
    if answer.smooth:
        change = np.hypot(*np.diff(velocity, axis=0).T) / ((dt[1:] + dt[:-1]) / 2)
        assert change.max() <= a + 1e-6


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
def test_ways_are_bent_and_stay_legal(drive: str) -> None:
    """Random polylines round a wall come out legal, and mostly faster than with a stop at each corner."""
    pytest.importorskip("casadi")
    rng = np.random.default_rng(0)
    bent = 0
    for _ in range(cases(5, 200)):
        points = np.array(AROUND) + rng.uniform(-0.3, 0.3, (4, 2))
        answer = smooth(points, GRID, radius=0.3, v_max=1.0, a_max=1.0, drive=drive, knots=30)
        assert answer.clear and answer.path.xy[[0, -1]] == pytest.approx(points[[0, -1]])
        checked(answer, 0.3, 1.0, 1.0)
        assert answer.smooth or answer.reason
        bent += answer.smooth
    assert bent > 0


def test_obstacles_are_kept_clear_of_or_the_answer_says_not() -> None:
    """With a disc on the way the smooth answer is free by the swept test; what is not free is never called clear."""
    pytest.importorskip("casadi")
    pieces = np.array([[0.0, 99.0, 4.5, 4.5, 0.0, -0.3, 0.5, 0.5]])
    answer = smooth(AROUND, GRID, radius=0.25, v_max=1.0, a_max=1.0, pieces=pieces, knots=30)
    assert answer.clear == nlp.is_clear(answer.path, GRID, 0.25, pieces)
    assert answer.clear or not answer.smooth


def test_a_program_without_solution_falls_back_to_the_polyline() -> None:
    """A margin that no way can keep leaves the checked polyline, and says so."""
    pytest.importorskip("casadi")
    path = plan(GRID, (1.0, 1.0), (1.0, 3.8), robot_radius=0.3)
    answer = smooth(path.xy(GRID), GRID, radius=0.3, v_max=1.0, a_max=1.0, margin=1.5, knots=20)
    assert not answer.smooth and answer.clear and answer.reason


def test_without_casadi_the_error_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the extra `smooth` a `MissingExtra` names it."""
    real = builtins.__import__

    def without(name, *rest, **more):
        if name == "casadi":
            raise ImportError(name)
        return real(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(MissingExtra, match="antway\\[smooth\\]"):
        smooth(AROUND, GRID, radius=0.3, v_max=1.0, a_max=1.0)


def test_wrong_input_raises() -> None:
    """Numbers out of range raise `BadParameter`."""
    pytest.importorskip("casadi")
    for wrong in ({"radius": -1.0}, {"a_max": float("inf")}, {"drive": "legs"}, {"knots": 3}):
        with pytest.raises(BadParameter):
            smooth(AROUND, GRID, **({"radius": 0.3, "v_max": 1.0, "a_max": 1.0} | wrong))
