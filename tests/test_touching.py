"""Robots that overlap a track: its disc is too large, or its place wrong, and the robot gets away instead of deeper in."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, Observation, RobotSpec, Task, Tracks, make_policy

HALL = Grid(np.zeros((120, 120), dtype=bool), 0.1)


def _driven(place: tuple[float, float], since: float) -> tuple[float, float]:
    """Drive the default robot through the hall in its own steps, where somebody stands at `place` from a time on.

    Returns the distance to the goal in the end, and the largest overlap, m.
    """
    task = Task(HALL, RobotSpec(), (1.5, 6.0), (10.5, 6.0))
    policy = make_policy("antway")
    policy.reset(task, 0)
    xy, velocity, deepest = np.array(task.start), (0.0, 0.0), -math.inf
    for k in range(120):
        seen = k * 0.1 >= since - 1e-9
        tracks = Tracks(np.array([4]), np.array([place]), np.zeros((1, 2)), np.array([0.3])) if seen else Tracks.none()
        velocity = policy.act(Observation(k * 0.1, tuple(xy.tolist()), velocity, 0.0, tracks)).velocity
        xy = xy + 0.1 * np.array(velocity)
        if seen:
            deepest = max(deepest, 0.6 - math.dist(xy, place))
        if math.dist(xy, task.goal) < 0.2:
            break
    return math.dist(xy, task.goal), deepest


@pytest.mark.parametrize("overlap", [1e-4, 0.001, 0.02, 0.05])
def test_a_robot_leaves_somebody_it_overlaps_at_the_start(overlap: float) -> None:
    """It goes on to its goal, and never deeper in. It used to stand for good, or to drive into him."""
    left, deepest = _driven((1.5 - 0.6 + overlap, 6.0), 0.0)
    assert left < 0.2 and deepest <= overlap + 1e-9


@pytest.mark.parametrize("aside", [0.54, 0.57, 0.59])
def test_a_robot_in_motion_leaves_somebody_who_appears_beside_it(aside: float) -> None:
    """The disc of somebody who stands overlaps the robot's by some centimetres, from 3 s on."""
    left, deepest = _driven((4.55, 6.0 + aside), 3.0)
    assert left < 0.2 and deepest <= 0.6 - aside + 0.02


def test_a_robot_deep_inside_a_disc_stands() -> None:
    """By 0.3 m no motion of one period ends the contact, and the robot gets no deeper in."""
    assert _driven((1.8, 6.0), 0.0)[1] <= 0.3 + 1e-9
