"""Space-time search against its slow twins (C5, C7)."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from antway import Grid, Moves, Status
from antway.search.sipp import TIMED_MOVES, sipp, timed_field, timed_moves
from antway.world.timeline import Timeline
from common import cases, random_grid
from naive import timed as naive
from naive.geometry import hits_cells


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_moves_against_samples(moves):
    """A move is in the mask exactly where no sample of its way comes nearer than the radius to a blocked cell or the edge."""
    rng = np.random.default_rng(1)
    step = moves.lengths.max() / 40 / 2
    for _ in range(cases(6, 300)):
        grid = random_grid(rng, 1, 8, (0.0, 0.3))
        radius = rng.uniform(0.05, 1.5)
        mask = timed_moves(grid, radius, moves)
        legal, margin = naive.move_mask(grid.blocked, moves.offsets, radius)
        bits = (mask[..., None] >> np.arange(len(moves.offsets), dtype=np.uint32) & 1).astype(bool)
        assert not (bits & ~legal).any()
        assert not (legal & ~bits & (margin > step)).any()


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_moves_of_a_point(moves):
    """Without a radius the legal moves are those of the grid: every touched cell must be free."""
    rng = np.random.default_rng(2)
    for _ in range(cases(20)):
        grid = random_grid(rng, 1, 9)
        mask = timed_moves(grid, 0.0, moves)
        for (r, c), bits in np.ndenumerate(mask):
            for k, (dr, dc) in enumerate(moves.offsets):
                need = [(r, c), (r + dr, c + dc), *((r + i, c + j) for i, j in moves.touched[k])]
                assert bool(bits >> k & 1) == all(grid.is_free(cell) for cell in need)


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_field_against_heap(moves):
    """The bucketed field equals Dijkstra's with a heap to the last bit; whole maps, windows, several goals (C7)."""
    rng = np.random.default_rng(3)
    for _ in range(cases(40, 4000)):
        grid = random_grid(rng, 1, 20, (0.0, 0.4))
        mask = timed_moves(grid, rng.uniform(0.0, 0.9), moves)
        r, c = rng.integers(0, grid.shape)
        window = mask[r:, c:]
        goals = np.argwhere(window)[: rng.integers(1, 4)]
        if len(goals):
            field = timed_field(window, moves, goals)
            assert np.array_equal(field, naive.move_field(window, moves.offsets, moves.lengths, goals))


def random_world(rng, low, high, count):
    """A grid, a robot and up to `count` discs that walk about in straight pieces, stand and begin at different times."""
    grid = Grid(rng.random(rng.integers(low, high + 1, 2)) < rng.uniform(0.0, 0.3), resolution=rng.choice([0.5, 1.0]))
    rows, cols = grid.shape
    size = np.array([cols, rows]) * grid.resolution
    ids, radii, courses = [], [], []
    for k in range(rng.integers(1, count + 1)):
        t = np.cumsum(rng.uniform(0.3, 4.0, rng.integers(1, 4))) - 1.0
        ids.append(k)
        radii.append(rng.uniform(0.2, 0.6) * grid.resolution)
        courses.append((t, rng.uniform(-0.1, 1.1, (len(t), 2)) * size))
    return grid, Timeline.of(ids, radii, courses)


def check(grid, plan, timeline, radius, speed, start, goal, horizon=math.inf):
    """Sample the path every millisecond: its ends are right, it is not too fast and meets no disc and no wall."""
    t, xy = plan.path.t, plan.path.xy
    assert np.array_equal(xy[0], start) and np.allclose(xy[-1], goal, atol=1e-9) and t[-1] == plan.arrival
    assert (np.diff(t) > 0).all()
    assert (np.hypot(*np.diff(xy, axis=0).T) <= speed * np.diff(t) + 1e-9).all()
    for a, b in pairwise(grid.to_points(xy)):
        assert hits_cells(grid.blocked, a, b, radius, True, 60) >= radius / grid.resolution - 1e-6
    times = np.union1d(t, np.arange(t[0], min(t[-1], horizon), 1e-3))
    times = times[times < horizon]
    x, y = (np.interp(times, t, xy[:, i]) for i in (0, 1))
    for k, r in enumerate(timeline.radius):
        knots = slice(timeline.first[k], timeline.first[k + 1])
        ox, oy = (np.interp(times, timeline.knot_t[knots], timeline.knot_xy[knots, i]) for i in (0, 1))
        assert (np.hypot(x - ox, y - oy) >= radius + r - 1e-6).all()


@pytest.mark.parametrize(
    ("moves", "size", "worlds"),
    [(Moves.EIGHT, 10, 60), (Moves.SIXTEEN, 7, 40), (Moves.THIRTY_TWO, 6, 40), (Moves.FOUR, 10, 40)],
)
def test_sipp_against_naive(moves, size, worlds):
    """The arrival is that of a naive SIPP with bisected intervals, and no sample of the path is in contact (C5)."""
    rng = np.random.default_rng(4)
    for _ in range(cases(worlds, 1250)):
        grid, timeline = random_world(rng, 2, size, 8)
        radius, speed = rng.uniform(0.1, 0.5) * grid.resolution, rng.choice([0.5, 1.0, 1.7])
        t, horizon = rng.choice([0.0, 1.3]), rng.choice([np.inf, 5.0])
        mask = timed_moves(grid, radius, moves)
        cells = np.argwhere(mask)
        if len(cells) == 0:
            continue
        start, goal = (tuple(int(i) for i in rng.choice(cells)) for _ in range(2))
        centre = grid.to_xy(list(np.ndindex(grid.shape))).reshape(*grid.shape, 2)
        courses = (timeline.radius, timeline.knot_t, timeline.knot_xy, timeline.first)
        arrival = naive.sipp(mask, moves.offsets, centre, speed, radius, start, goal, courses, t, horizon)
        plan = sipp(grid, centre[start], centre[goal], timeline, radius=radius, v_max=speed, moves=moves, t=t, horizon=horizon)
        assert (plan.status is Status.FOUND) == (arrival < np.inf)
        if arrival < np.inf:
            assert math.isclose(plan.arrival, arrival, abs_tol=1e-6)
            check(grid, plan, timeline, radius, speed, centre[start], centre[goal], horizon)


def test_sipp_against_unit_steps():
    """Where points hop from cell to cell at whole seconds the arrival is that of a search over (cell, step) (C5).

    Discs of 1 mm reach that hop in a microsecond make contact exactly where two share a cell at a whole second or swap cells;
    a robot that follows one comes at most that 1 mm later.
    """
    rng = np.random.default_rng(5)
    reach, hop = 1e-3, 1e-6
    for _ in range(cases(120, 5000)):
        grid = random_grid(rng, 2, 10, (0.0, 0.3))
        free = [(int(r), int(c)) for r, c in np.argwhere(~grid.blocked)]
        if not free:
            continue
        start, goal = free[rng.integers(len(free))], free[rng.integers(len(free))]
        walks, courses = [], []
        for _ in range(rng.integers(0, 9)):
            walk = [free[rng.integers(len(free))]]
            for _ in range(rng.integers(0, 15)):
                r, c = walk[-1]
                steps = [(r, c), (r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)]
                steps = [cell for cell in steps if grid.is_free(cell)]
                walk.append(steps[rng.integers(len(steps))])
            if walk[0] == start:
                continue
            walks.append(walk)
            times = np.column_stack((np.arange(len(walk)), np.arange(1, len(walk) + 1) - hop)).ravel()
            courses.append((times, np.repeat(grid.to_xy(walk), 2, axis=0)))
        timeline = Timeline.of(list(range(len(walks))), [reach / 2] * len(walks), courses)
        steps = naive.unit_steps(grid.blocked, walks, start, goal)
        plan = sipp(grid, grid.centre(start), grid.centre(goal), timeline, radius=reach / 2, v_max=1.0, moves=Moves.FOUR)
        assert (plan.status is Status.FOUND) == (steps < np.inf)
        if steps < np.inf:
            assert steps - 1e-5 <= plan.arrival <= steps + reach + 1e-5


def test_sipp_between_searches_over_ticks():
    """Real time arrives no later than time in ticks, and no earlier than that among discs smaller by a tick's way (C5)."""
    rng = np.random.default_rng(6)
    for _ in range(cases(12, 500)):
        grid, timeline = random_world(rng, 2, 5, 4)
        grid = Grid(grid.blocked)
        mask = timed_moves(grid, 0.3, Moves.FOUR)
        cells = np.argwhere(mask)
        if len(cells) == 0:
            continue
        start, goal = (tuple(int(i) for i in rng.choice(cells)) for _ in range(2))
        centre = grid.to_xy(list(np.ndindex(grid.shape))).reshape(*grid.shape, 2)
        courses = (timeline.radius, timeline.knot_t, timeline.knot_xy, timeline.first)
        above, below = (
            naive.ticks(mask, Moves.FOUR.offsets, centre, 0.3, start, goal, courses, 8, slack, 400) for slack in (0.0, 0.125)
        )
        plan = sipp(grid, centre[start], centre[goal], timeline, radius=0.3, v_max=1.0, moves=Moves.FOUR)
        assert below - 1e-6 <= plan.arrival <= above + 1e-6
