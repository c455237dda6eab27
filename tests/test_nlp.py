"""Nonlinear programs: clear by a dense re-check, within limits, no slower than the polyline; failures fall back (C29)."""

from __future__ import annotations

import builtins

import numpy as np
import pytest

from antway import BadParameter, Grid, Problem, Status, plan, solve
from antway.trajectory import nlp
from antway.trajectory.nlp import MissingExtra, smooth
from antway.trajectory.profile import speed_profile
from common import cases

ROOM = np.zeros((20, 20), dtype=bool)
ROOM[8:10, :13] = True
GRID = Grid(ROOM, 0.25)  # 5 x 5 m
AROUND = [(1.0, 1.0), (3.8, 1.0), (3.8, 3.8), (1.0, 3.8)]


TURN, TWIST = 2.0, 4.0  # rad/s, rad/s^2; the limits that `smooth` has for wheels


def checked(answer, grid: Grid, radius: float, v: float, a: float, segments: np.ndarray, drive: str) -> None:
    """Sample the path at less than a tenth of a cell: no wall or disc within the radius; all limits hold to 1e-6.

    Where the polyline is not free of what moves, nothing is: then `clear` says so.
    """
    path = answer.path
    t = np.linspace(path.t[0], path.t[-1], int(path.t[-1] / 0.02) + 2)
    xy = np.column_stack([np.interp(t, path.t, path.xy[:, k]) for k in (0, 1)])
    p = grid.to_points(xy)
    r, c = np.nonzero(grid.blocked)
    gap = np.hypot(np.maximum(np.abs(p[:, :1] - r) - 0.5, 0), np.maximum(np.abs(p[:, 1:] - c) - 0.5, 0)) * grid.resolution
    free = gap.min(initial=np.inf) - radius
    assert free >= -1e-6
    for _, _, x, y, vx, vy, reach, _ in segments:
        free = min(free, (np.hypot(xy[:, 0] - x - vx * t, xy[:, 1] - y - vy * t) - reach).min())
    assert free >= -1e-6 or not answer.clear
    dt = np.diff(path.t)
    velocity = np.diff(path.xy, axis=0) / dt[:, None]
    speed = np.hypot(*velocity.T)
    assert speed.max() <= v + 1e-6
    assert speed[0] <= a * dt[0] / 2 + 1e-6 and speed[-1] <= a * dt[-1] / 2 + 1e-6
    if answer.smooth:
        span = (dt[1:] + dt[:-1]) / 2
        assert (np.hypot(*np.diff(velocity, axis=0).T) / span).max() <= a + 1e-6
        if drive == "differential":
            turns = velocity[1:, 1] * velocity[:-1, 0] - velocity[1:, 0] * velocity[:-1, 1]
            rate = np.arctan2(turns, (velocity[1:] * velocity[:-1]).sum(axis=1)) / span
            assert np.abs(rate).max() <= TURN + 1e-6
            assert (np.abs(np.diff(rate, prepend=0.0)) <= TWIST * span + 1e-6).all()


def place(rng: np.random.Generator) -> tuple[Grid, np.ndarray, np.ndarray]:
    """A random room, a way through it at any angle, and what moves there: one disc or none."""
    while True:
        grid = Grid(rng.random((20, 20)) < 0.04, 0.25)
        room = grid.inflate(0.3)
        free = np.argwhere(~room.blocked)
        start, goal = (tuple(map(int, cell)) for cell in free[rng.integers(len(free), size=2)])
        path = solve(Problem(room, start, goal), "anyangle")
        if path.status is not Status.FOUND or path.length < 1.5:
            continue
        if nlp.is_clear(speed_profile(path.xy(grid), 1.0, 1.0), grid, 0.3):  # else there is nothing to fall back to
            break
    velocity = rng.uniform(-0.4, 0.4, 2)
    meets = grid.centre(path.cells[len(path.cells) // 2]) + rng.uniform(-0.6, 0.6, 2)
    piece = [0.0, 99.0, *(meets - velocity * path.length / 2), *velocity, 0.55, 0.55]
    return grid, path.xy(grid), np.array([piece] if rng.random() < 0.5 else []).reshape(-1, 8)


@pytest.mark.parametrize("drive", ["holonomic", "differential"])
def test_ways_are_bent_and_stay_legal(drive: str) -> None:
    """Ways through random rooms come out legal; most are bent, and never slower than with a stop at each corner (C29)."""
    pytest.importorskip("casadi")
    rng = np.random.default_rng(0)
    bent, asked, worst = 0, cases(10, 2500), ""
    for case in range(asked):
        grid, points, segments = place(rng)
        stops = speed_profile(points, 1.0, 1.0)
        answer = smooth(points, grid, radius=0.3, v_max=1.0, a_max=1.0, drive=drive, segments=segments, knots=30)
        checked(answer, grid, 0.3, 1.0, 1.0, segments, drive)
        assert answer.path.xy[[0, -1]] == pytest.approx(points[[0, -1]])
        assert answer.smooth or (answer.reason and (answer.path.xy == stops.xy).all())
        assert answer.clear == nlp.is_clear(answer.path, grid, 0.3, segments), case
        if drive == "holonomic" and nlp.is_clear(stops, grid, 0.3, segments):
            assert answer.clear and answer.path.t[-1] <= stops.t[-1] + 1e-6
        bent += answer.smooth
        worst = answer.reason or worst
    print(f"{drive}: {bent} of {asked} bent; else e.g. {worst}")
    assert bent >= 0.5 * asked


def test_obstacles_are_kept_clear_of_or_the_answer_says_not() -> None:
    """With a disc on the way the smooth answer is free by the swept test; what is not free is never called clear."""
    pytest.importorskip("casadi")
    segments = np.array([[0.0, 99.0, 4.5, 4.5, 0.0, -0.3, 0.5, 0.5]])
    answer = smooth(AROUND, GRID, radius=0.25, v_max=1.0, a_max=1.0, segments=segments, knots=30)
    assert answer.clear == nlp.is_clear(answer.path, GRID, 0.25, segments)
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
