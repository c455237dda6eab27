"""Tracks that the last scan does not show are moved on, and nothing is learnt from where they were moved to."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from antway import Grid, Observation, Task
from antway.kernels.tracking import averages, changes, crowd, curves
from antway.kernels.tracking import prediction_error as error
from antway.kernels.tracking.predict import ID, RADIUS, VX, VY, X, Y
from antway.kernels.tracking.table import SEEN, Table, make_table, rows_in_use
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.tracker import Tracker
from antway.world.policy import Tracks
from antway.world.robots import load_robot
from antway.world.terrain import terrain_of
from common import all_seen, cases

ROOM = terrain_of(Grid(np.zeros((100, 100), np.bool_), 0.2))


class Learning:
    """What the kernels know of tracks, from scan to scan."""

    def __init__(self) -> None:
        self.changes, self.turns = make_table(64, changes.COLUMNS), np.zeros(3)
        self.averages, self.pool = make_table(64, averages.COLUMNS), np.zeros(averages.POOL)
        self.turning = curves.Turning(make_table(64, curves.COLUMNS), np.zeros(curves.POOL), np.zeros(64))
        self.stored, self.errors, self.missed = make_table(64, error.COLUMNS), np.array(error.POOL), np.zeros(1, np.int64)

    def update(self, t: float, estimates: np.ndarray, seen: np.ndarray) -> np.ndarray:
        """Take a scan, and return what is predicted of each track: its velocity, its turn rate and their error."""
        n = len(estimates)
        changed, out, deviation = np.empty((n, 4)), np.empty_like(estimates), np.empty(n)
        changes.velocity_changes(self.changes, self.turns, estimates, seen, ROOM, t, changed)
        averages.averaged(self.averages, self.pool, estimates, seen, changed, t, True, out)
        curves.turn_rates(self.turning, estimates, seen, out, changed, t)
        error.compare_predictions(self.stored, self.errors, self.missed, out, seen, t, deviation)
        ahead = np.zeros((n, 8))
        ahead[:, :2], ahead[:, 2:4], ahead[:, 4:6] = (t - 1.0, t + 9.0), estimates[:, :2] - estimates[:, 2:4], estimates[:, 2:4]
        error.store_predictions(self.stored, estimates[seen], t, ahead[seen])
        return np.column_stack((out[:, VX : VY + 1], self.turning.rate[:n], deviation))

    def tables(self) -> list[Table]:
        """Return the tables of all kernels."""
        return [self.changes, self.averages, self.turning.table, self.stored]


def test_tracks_that_a_scan_does_not_show_change_nothing() -> None:
    """What is learnt and predicted of the others is the same as if the estimates had been of these alone."""
    for seed in range(cases(20, 300)):
        rng, known, alone = np.random.default_rng(seed), Learning(), Learning()
        at, v = rng.uniform(1, 19, 6) + 1j * rng.uniform(1, 19, 6), rng.uniform(0, 1, 6) * np.exp(1j * rng.uniform(0, 6, 6))
        last = np.full(6, -math.inf)
        for i in range(80):
            t, shown = 0.1 * i, rng.random(6) < (0.4 if i % 20 > 15 else 0.95)
            last[shown] = t
            remembered = t - last <= 1.0
            estimates = np.zeros((6, 8))
            estimates[:, X], estimates[:, Y], estimates[:, VX], estimates[:, VY] = at.real, at.imag, v.real, v.imag
            estimates[:, RADIUS], estimates[:, ID] = 0.3, np.arange(6)
            estimates[~shown, :4] = rng.uniform(100.0, 900.0, (int((~shown).sum()), 4))  # nobody is there
            told = known.update(t, estimates[remembered], shown[remembered])[shown[remembered]]
            assert np.allclose(told, alone.update(t, estimates[shown], all_seen(estimates[shown])), atol=1e-9)
            for one, other in zip(known.tables(), alone.tables(), strict=True):
                mine, theirs = rows_in_use(one), rows_in_use(other)
                assert sorted(mine[mine[:, SEEN] == t].tolist()) == sorted(theirs[theirs[:, SEEN] == t].tolist())
            assert (known.turns == alone.turns).all() and (known.errors == alone.errors).all()
            at, v = at + 0.1 * v, v * np.exp(1j * np.where(rng.random(6) < 0.03, rng.uniform(-2, 2, 6), 0.05))


def test_a_walker_on_a_circle_is_predicted_on_it_though_hidden_half_the_time() -> None:
    """Where it was moved on to, straight ahead, does not count against the circle."""
    tracker, learning, found = Tracker(), Learning(), []
    for i in range(120):
        t, angle = 0.1 * i, 0.05 * i
        shown = i % 12 < 6
        xy = [[10.0 + 2.0 * math.sin(angle), 10.0 - 2.0 * math.cos(angle)]]
        tracks = Tracks([7], xy, [[math.cos(angle), math.sin(angle)]], [0.3]) if shown else Tracks.none()
        tracker.update(tracks, t, ROOM, (10.0, 10.0), 20.0)
        told = learning.update(t, tracker.estimates.copy(), tracker.last_seen == t)
        if shown and t >= 4.0:
            found.append(abs(told[0, 2] - 0.5) < 0.1)
    assert len(found) == 38 and np.mean(found) > 0.9


def test_hidden_people_do_not_speak_against_avoidance() -> None:
    """Goal and errors of a person stay as they are while the person is hidden, though the estimate goes straight on."""
    rng, table, trajectory = np.random.default_rng(1), make_table(8, crowd.COLUMNS, ID), np.empty((8, crowd.STEPS, 2))
    heading, xy = rng.uniform(-math.pi, math.pi, 8), rng.uniform(0.0, 4.0, (8, 2))
    for i in range(20):
        velocity = 0.6 * np.column_stack((np.cos(heading), np.sin(heading)))
        estimates = np.column_stack((xy, velocity, np.full(8, 0.3), np.zeros((8, 2)), np.arange(8)))
        before, hidden = table.rows.copy(), rng.random(8) < (0.3 if i > 5 else 0.0)
        crowd.foresee(table, estimates, ~hidden, 0.1 * i, 0.9, trajectory)
        learnt = table.rows[:, [9, 10, 11, 12, 13, 16, 17]] != before[:, [9, 10, 11, 12, 13, 16, 17]]
        assert not learnt[hidden].any()
        assert i < 6 or learnt[~hidden].any()
        xy = xy + velocity * 0.1


def test_a_scan_that_is_known_for_several_cycles_is_learnt_from_once() -> None:
    """Where commands act late, rounding used to make the same scan a later one, and people seem to walk as nobody expects."""
    policy, robot = AntwayPolicy(), replace(load_robot("diff"), latency=0.3)
    policy.reset(Task(Grid(np.zeros((100, 100), np.bool_), 0.2), robot, (5.0, 5.0), (15.0, 5.0)), 0)
    tracks, pending = Tracks([7], [[9.0, 8.0]], [[0.5, 0.0]], [0.3]), np.zeros((3, 2))
    for k in range(20):
        policy.act(Observation(0.37 + 0.1 * k, (5.0, 5.0), (0.0, 0.0), 0.0, tracks, 0.37, pending=pending))
        assert policy.state is not None and policy.state.crowd.people.rows[0, crowd._SEEN] == 0.37
