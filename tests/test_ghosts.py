"""False alarms: a track that was seen once and not again, though nothing hides it, is forgotten."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, RobotSpec, Task
from antway.kernels.tracking.kalman import COLUMNS, SCANS, T, forget_ghosts
from antway.kernels.tracking.predict import ID, RADIUS, X, Y
from antway.kernels.tracking.table import make_table, rows_in_use
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.tracker import Tracker
from antway.world.policy import Observation, Tracks
from antway.world.terrain import terrain_of
from common import cases
from naive.people import hidden


def test_who_would_be_seen_is_forgotten() -> None:
    """Compared with lines of sight in random rooms; who was seen twice, is seen now or may have left the range stays."""
    rng, seen = np.random.default_rng(3), {True: 0, False: 0}
    for _ in range(cases(150, 5000)):
        grid = Grid(rng.random((10, 12)) < 0.06, 1.0)
        walls, eye = np.argwhere(grid.blocked)[:, ::-1] + 0.5, rng.uniform(1.0, 9.0, 2)
        table, radius = make_table(4, COLUMNS, ID), rng.uniform(0.2, 0.6, 4)
        table.used[0] = 4
        table.rows[:, ID], table.rows[:, T], table.rows[:, RADIUS] = range(4), 0.0, radius
        places = table.rows[:, X : Y + 1] = rng.uniform(0.5, 9.5, (4, 2))
        table.rows[:, SCANS] = 1.0, 1.0, 1.0, 2.0
        forget_ghosts(*table[:2], terrain_of(grid), 0.1, np.array([2]), *eye, 6.0)
        gone = np.isinf(rows_in_use(table)[:, T])
        assert not gone[2:].any()
        for i in range(2):
            others = [(places[j], radius[j]) for j in range(4) if j != i]
            near = math.dist(places[i], eye)
            apart = min(math.dist(at, end) for at, _ in others for end in (places[i], eye))
            if abs(near - 5.7) < 0.01 or near < radius[i] + 0.05 or apart < 1.3:
                continue  # at the edge of the rule
            expected = near < 5.7 and not hidden(places[i], radius[i], others, eye, walls)
            seen[bool(gone[i])] += gone[i] == expected
            assert gone[i] == expected, (places[i], eye)
    assert min(seen.values()) > 10


@pytest.mark.parametrize(("scans", "known"), [(1, 0), (2, 1)])
def test_a_tracker_remembers_who_was_seen_twice(scans: int, known: int) -> None:
    tracker, hall = Tracker(), terrain_of(Grid(np.zeros((100, 100), np.bool_), 0.1))
    for k in range(scans):
        tracker.update(Tracks([5], [[4.0, 5.0]], [[0.0, 0.0]], [0.3]), 0.1 * k, hall, (2.0, 5.0), 4.0)
    tracker.update(Tracks.none(), 0.1 * scans, hall, (2.0, 5.0), 4.0)
    assert len(tracker.estimates) == known


def test_a_false_alarm_costs_no_more_than_its_scan() -> None:
    """A robot on wheels goes on at full speed as soon as the obstacle in its path is gone; it used to brake for a second."""
    robot = RobotSpec(drive="differential", a_max=1.0, v_reverse=0.3)
    policy, task = AntwayPolicy(), Task(Grid(np.zeros((100, 200), np.bool_), 0.1), robot, (2.0, 5.0), (18.0, 5.0))
    policy.reset(task, 0)
    x, speed, slowest = 2.0, 1.0, 1.0
    for k in range(20):
        alarm = Tracks([9], [[x + 2.0, 5.0]], [[0.0, 0.0]], [0.3]) if k == 5 else Tracks.none()
        command = policy.act(Observation(0.1 * k, (x, 5.0), (speed, 0.0), 0.0, alarm))
        assert command.twist is not None
        speed = min(max(command.twist[0], speed - 0.1), speed + 0.1)
        x, slowest = x + 0.1 * speed, min(slowest, speed)
    assert slowest > 0.85
