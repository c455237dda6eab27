"""How well predictions have held: beside a slow twin, for what goes as predicted and for what does not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid
from antway.kernels.tracking.predict import NO_PREDICTIONS, TubeMargins, predict
from antway.kernels.tracking.prediction_error import COLUMNS, LATER, POOL, compare_predictions, distrust, store_predictions
from antway.kernels.tracking.table import make_table
from antway.world.terrain import terrain_of
from common import all_seen, cases
from naive.people import pooled

BOX = np.zeros((40, 40), np.bool_)
TERRAIN = terrain_of(Grid(BOX, 0.2))  # 8 x 8 m
MARGINS = TubeMargins(0.3, 0.0, 0.0, 0.0, 0.0, 0.0, math.inf)


class Slow:
    """The same by a list of what was predicted, for each track and all."""

    def __init__(self) -> None:
        self.made: dict[float, tuple[float, np.ndarray]] = {}
        self.last: dict[float, float] = {}
        self.errors: dict[float, list[float]] = {}
        self.pool, self.compared, self.missed = POOL[0], 1, 0

    def __call__(self, estimates: np.ndarray, t: float, segments: np.ndarray, owner: np.ndarray) -> list[float]:
        found = []
        for k, row in enumerate(estimates):
            name = row[7]
            if name in self.last and t - self.last[name] > 1.0:
                for known in (self.made, self.errors, self.last):
                    known.pop(name, None)
            self.last[name] = t
            if name not in self.made or t > self.made[name][0] + LATER - 1e-6:
                if name in self.made and t < self.made[name][0] + 1.5 * LATER:
                    since, place = self.made[name]
                    over = t - since - LATER
                    off = float(np.hypot(*(row[:2] - over * row[2:4] - place))) / LATER
                    self.errors.setdefault(name, []).append(off)
                    self.missed += off > 0.25
                    found.append(off)
                due = t + LATER
                piece = next(s for s, k2 in zip(segments, owner) if k2 == k and s[0] <= due < s[1])
                self.made[name] = t, piece[2:4] + piece[4:6] * (due - piece[0])
        self.compared, self.pool = pooled(self.compared, self.pool, found)
        out = []
        for name in estimates[:, 7]:
            own = self.errors.get(name, [])
            weights = 0.8 ** np.arange(len(own))[::-1]
            mean = (float(weights @ own) + 2.0 * self.pool) / (float(weights.sum()) + 2.0)
            out.append(mean * math.sqrt(2.0 / math.pi))
        return out

    def distrust(self) -> float:
        """The share of misses, with a half miss in ten comparisons before the first, over one in twenty."""
        return min((0.5 + self.missed) / (9 + self.compared) / 0.05, 1.0)


def play(rng: np.random.Generator, wander: float, steps: int = 80, step: float = 0.1) -> tuple[np.ndarray, float]:
    """Tracks that bounce in a box and change their velocity by `wander` m/s a step; returns errors and distrust in the end."""
    n = 4
    xy, velocity = rng.uniform(1.0, 7.0, (n, 2)), rng.uniform(-0.9, 0.9, (n, 2))
    table, pool, slow, errors = make_table(16, COLUMNS), np.array(POOL), Slow(), np.empty(n)
    missed = np.zeros(1, np.int64)
    names = np.arange(n, dtype=float)
    for i in range(steps):
        t = step * i
        seen = np.flatnonzero(rng.random(n) < 0.9)
        estimates = np.column_stack((xy[seen], velocity[seen], np.full(len(seen), 0.3), np.zeros((len(seen), 2)), names[seen]))
        pieces = np.empty((256, 8))
        segments = pieces[: predict(estimates, t, 0.0, 4.0, -50.0, 0.0, MARGINS, TERRAIN, NO_PREDICTIONS, pieces)]
        owner = np.cumsum(np.concatenate(([0], segments[1:, 0] < segments[:-1, 1]))) if len(segments) else np.empty(0)
        errors = np.empty(len(seen))
        compare_predictions(table, pool, missed, estimates, all_seen(estimates), t, errors)
        store_predictions(table, estimates, t, segments)
        expected = slow(estimates, t, segments, owner)
        assert errors == pytest.approx(expected, abs=1e-9)
        assert distrust(pool, missed) == pytest.approx(slow.distrust())
        velocity += rng.normal(0.0, wander, (n, 2)) if wander else 0.0
        xy += velocity * step
        for axis in range(2):
            for low, sign in ((0.3, 1.0), (7.7, -1.0)):
                out = (xy[:, axis] - low) * sign < 0.0
                xy[out, axis] = 2.0 * low - xy[out, axis]
                velocity[out, axis] *= -1.0
    return errors, distrust(pool, missed)


def test_it_is_what_its_slow_twin_finds() -> None:
    """Tracks come and go, wander and bounce; what wanders more is predicted worse."""
    rng = np.random.default_rng(4)
    for _ in range(cases(5, 200)):
        calm, relied_on = play(rng, 0.01)
        wild, doubted = play(rng, 0.1)
        assert 0.0 < calm.mean() < wild.mean() and relied_on < 0.5 < doubted <= 1.0


def test_what_bounces_as_predicted_is_not_taken_for_wrong() -> None:
    """Discs that go straight between walls are where they were predicted to be, before and after they bounce."""
    for step in (0.1, 0.25):  # 0.8 s are no multiple of 0.25 s
        errors, doubt = play(np.random.default_rng(5), 0.0, steps=160, step=step)
        assert errors.max() < 0.02 and doubt < 0.2
