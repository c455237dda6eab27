"""The order in which tracks come changes nothing that is learnt and predicted of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, Observation, RobotSpec, Task, Tracks
from antway.kernels.tracking.kalman import COLUMNS, SCANS, T, forget_ghosts
from antway.kernels.tracking.predict import ID, RADIUS, VX, VY, X, Y
from antway.kernels.tracking.table import make_table
from antway.policies.antway.policy import AntwayPolicy
from antway.world.terrain import terrain_of
from common import all_seen, cases
from test_hidden import Learning

N = 8


def walks(rng: np.random.Generator, steps: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """Places and velocities of N tracks in each of so many scans; some go in circles, some turn round, all sway."""
    at, v = rng.uniform(3, 17, N) + 1j * rng.uniform(3, 17, N), rng.uniform(0.2, 1, N) * np.exp(1j * rng.uniform(0, 6, N))
    rate, scans = np.where(np.arange(N) < 3, rng.uniform(-1, 1, N), 0.0), []
    for _ in range(steps):
        scans.append((np.column_stack((at.real, at.imag)), np.column_stack((v.real, v.imag))))
        v = v * np.exp(0.1j * rate) * np.where(rng.random(N) < 0.01, -1, 1)
        v = v + 0.05 * (rng.normal(size=N) + 1j * rng.normal(size=N))
        at = at + 0.1 * v
    return scans


def test_errors_of_predictions_do_not_depend_on_the_order_of_tracks() -> None:
    """They used to, because the errors of all tracks together changed while track after track was compared with them."""
    for seed in range(cases(5, 100)):
        rng, one, other = np.random.default_rng(seed), Learning(), Learning()
        order = rng.permutation(N)
        for i, (xy, velocity) in enumerate(walks(rng, 60)):
            estimates = np.zeros((N, 8))
            estimates[:, [X, Y]], estimates[:, [VX, VY]], estimates[:, RADIUS], estimates[:, ID] = xy, velocity, 0.3, range(N)
            told = one.update(0.1 * i, estimates, all_seen(estimates))[order]
            assert other.update(0.1 * i, estimates[order], all_seen(estimates)) == pytest.approx(told, abs=1e-9)


@pytest.mark.parametrize("measured", [True, False])
def test_what_the_policy_knows_does_not_depend_on_the_order_of_scans(measured: bool) -> None:
    """Noisy places, with velocities or without; the noise itself is estimated, and used to depend on the order most of all."""
    task = Task(Grid(np.zeros((100, 100), np.bool_), 0.2), RobotSpec(radius=0.3), (10.0, 10.0), (18.0, 18.0))
    for seed in range(cases(2, 40)):
        found = []
        for order in (np.arange(N), np.random.default_rng(seed).permutation(N)):
            rng, policy = np.random.default_rng(seed), AntwayPolicy()
            policy.reset(task, 0)
            for i, (xy, v) in enumerate(walks(rng, 40)):
                seen = xy + rng.normal(0, 0.03, xy.shape), v + (rng.normal(0, 0.1, v.shape) if measured else math.nan)
                tracks = Tracks(order, seen[0][order], seen[1][order], np.full(N, 0.3))
                policy.act(Observation(0.1 * i, (10.0, 10.0), (0.0, 0.0), 0.0, tracks))
            s = policy.state
            assert s is not None
            at, c = np.argsort(s.tracker.estimates[:, ID]), s.crowd
            rows = s.tracker.estimates, c.tracks.averaged[:N], c.velocity_error[:N, None], c.turning.rate[:N, None]
            found.append(np.hstack(rows)[at])
        assert found[1] == pytest.approx(found[0], abs=1e-9)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_false_alarm_may_hide_another_one(order: tuple[int, int]) -> None:
    """Whichever comes first, the one in front is forgotten, and the one behind is not yet."""
    table = make_table(2, COLUMNS, ID)
    table.used[0] = 2
    table.rows[:, ID], table.rows[:, RADIUS], table.rows[:, SCANS], table.rows[:, Y] = order, 0.3, 1.0, 5.0
    table.rows[:, X] = np.array([4.0, 6.0])[list(order)]
    hall = terrain_of(Grid(np.zeros((100, 100), np.bool_), 0.1))
    forget_ghosts(*table[:2], hall, 0.1, np.empty(0, np.int64), 2.0, 5.0, 9.0)
    assert dict(zip(order, np.isinf(table.rows[:, T]).tolist(), strict=True)) == {0: True, 1: False}
