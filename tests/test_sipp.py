"""Space-time search against its slow twins (C5, C7)."""

from __future__ import annotations

import math
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from antway import Grid, Moves, Status
from antway.errors import BadParameter, CellBlocked, OutOfBounds
from antway.kernels.base.records import Predictions
from antway.kernels.spacetime.segments import delayed, earliest_departure, insert_interval, unsafe_departures
from antway.search.sipp import TIMED_MOVES, Sipp, _workspace, sipp, timed_field, timed_moves
from antway.world.timeline import Timeline
from common import cases, random_grid
from naive import sipp as naive
from naive.geometry import hits_cells


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_moves_against_samples(moves):
    """A move is in the mask exactly where no sample of its way comes nearer than the radius to a blocked cell or the edge."""
    rng = np.random.default_rng(1)
    step = moves.lengths.max() / 40 / 2
    for _ in range(cases(6, 300)):
        grid = random_grid(rng, 1, 8, (0.0, 0.3))
        blocked = grid.blocked.repeat(3, axis=0).repeat(3, axis=1) if rng.random() < 0.3 else grid.blocked
        grid, radius = Grid(blocked), rng.uniform(0.05, 1.5)
        mask = timed_moves(grid, radius, moves)
        legal, margin = naive.move_mask(grid.blocked, moves.offsets, radius)
        bits = (mask[..., None] >> np.arange(len(moves.offsets), dtype=np.uint32) & 1).astype(bool)
        assert not (bits & ~legal).any()
        assert not (legal & ~bits & (margin > step)).any()


def test_unsafe_departures_are_those_that_samples_find() -> None:
    """Every departure that meets the segment is between both ends, and near each end there is one."""
    rng, z, s, met = np.random.default_rng(5), np.linspace(0.0, 1.0, 300), np.linspace(-8.0, 9.0, 681)[:, None], 0
    for _ in range(cases(60, 2000)):
        (angle, duration), t0 = rng.uniform((-math.pi, 0.5), (math.pi, 4.0)), rng.uniform(0.0, 3.0)
        span, (x, y), (ux, uy), radius = (
            rng.uniform(0.2, 4.0),
            rng.uniform(-3, 3, 2),
            rng.uniform(-2, 2, 2),
            rng.uniform(0.3, 1.5),
        )
        vx, vy, along, late = math.cos(angle), math.sin(angle), duration * z, s + duration * z - t0
        near = np.hypot(vx * along - x - ux * late, vy * along - y - uy * late) < radius - 1e-6
        times = s[(near & (late >= 0.0) & (late <= span)).any(axis=1), 0]
        segment = np.array([[t0, t0 + span, x, y, ux, uy, radius, radius]])
        low, high = unsafe_departures(0.0, 0.0, vx, vy, duration, segment, 0)
        assert not len(times) or (low <= times[0] <= low + 0.1 and high - 0.1 <= times[-1] <= high)
        assert len(times) or high - low < 0.1 or low == math.inf
        met += len(times) > 0
    assert met > cases(60, 2000) / 6


def test_no_departure_that_meets_a_segment_is_missed_or_invented() -> None:
    """Bounding boxes change nothing, and a robot that must keep off where obstacles were leaves so much later."""
    rng = np.random.default_rng(6)
    for _ in range(cases(300, 20000)):
        span, radius, stop, s = rng.uniform((0.2, 0.3, 0.0, -1.0), (4.0, 1.5, 1.5, 8.0))
        (x, y, ux, uy), (vx, vy), duration = rng.uniform(-3, 3, 4), rng.uniform(-1, 1, 2), rng.uniform(0.5, 4.0)
        segment = np.array([[1.5, 1.5 + span, x, y, ux, uy, radius, radius]])
        low, high = unsafe_departures(0.0, 0.0, vx, vy, duration, segment, 0)
        wanted = high + stop if low < s - stop < high else s
        assert delayed(0.0, 0.0, vx, vy, duration, s, Predictions(segment, stop), 0) == pytest.approx(wanted, abs=1e-8)
        for limit in (wanted + 0.1, wanted - 0.1):
            depart = earliest_departure(0.0, 0.0, vx, vy, duration, s, limit, Predictions(segment, stop))
            assert depart == pytest.approx(wanted if limit > wanted else math.inf, abs=1e-8)


def test_intervals_are_kept_in_the_order_of_their_starts() -> None:
    """Whatever the order in which they come."""
    rng, rows = np.random.default_rng(7), np.empty((9, 2))
    for n in range(10):
        pairs = rng.integers(0, 9, (n, 2)).astype(float)
        for i, (low, high) in enumerate(pairs):
            assert insert_interval(rows, i, low, high) == i + 1
        assert rows[:n].tolist() == sorted(pairs.tolist(), key=lambda pair: pair[0])


def test_goals_that_are_named_twice_count_once() -> None:
    """The lists of the search hold a cell once."""
    mask, goals = timed_moves(Grid(np.zeros((4, 6), dtype=bool)), 0.3), [(0, 0), (2, 3)]
    once = timed_field(mask, Moves.THIRTY_TWO, goals)
    assert (timed_field(mask, Moves.THIRTY_TWO, [*goals, goals[0]]) == once).all()


@pytest.mark.parametrize("moves", TIMED_MOVES)
def test_timed_moves_between_far_cells(moves):
    """With a stride, the moves are those that are so much longer, from every cell of the stride."""
    rng = np.random.default_rng(4)
    for _ in range(cases(4, 100)):
        grid, stride = random_grid(rng, 4, 12, (0.0, 0.1)), int(rng.integers(2, 5))
        first = int(rng.integers(stride)), int(rng.integers(stride))
        radius = rng.uniform(0.05, 1.5)
        mask = timed_moves(grid, radius, moves, stride, first)
        legal, margin = naive.move_mask(grid.blocked, moves.offsets * stride, radius)
        legal, margin = (all_cells[first[0] :: stride, first[1] :: stride] for all_cells in (legal, margin))
        bits = (mask[..., None] >> np.arange(len(moves.offsets), dtype=np.uint32) & 1).astype(bool)
        step = stride * moves.lengths.max() / 40 / 2
        assert not (bits & ~legal).any()
        assert not (legal & ~bits & (margin > step)).any()
    for wrong in ({"stride": 0}, {"stride": 2, "first": (2, 0)}):
        with pytest.raises(BadParameter):
            timed_moves(grid, radius, moves, **wrong)


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
    ids, radii, trajectories = [], [], []
    for k in range(rng.integers(1, count + 1)):
        t = np.cumsum(rng.uniform(0.3, 4.0, rng.integers(1, 4))) - 1.0
        ids.append(k)
        radii.append(rng.uniform(0.2, 0.6) * grid.resolution)
        trajectories.append((t, rng.uniform(-0.1, 1.1, (len(t), 2)) * size))
    return grid, Timeline.of(ids, radii, trajectories)


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
    [(Moves.EIGHT, 8, 35), (Moves.SIXTEEN, 6, 25), (Moves.THIRTY_TWO, 6, 25), (Moves.FOUR, 8, 35)],
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
        trajectories = (timeline.radius, timeline.knot_t, timeline.knot_xy, timeline.first)
        arrival = naive.sipp(mask, moves.offsets, centre, speed, radius, start, goal, trajectories, t, horizon)
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
    for _ in range(cases(180, 5000)):
        grid = random_grid(rng, 2, 10, (0.0, 0.3))
        free = [(int(r), int(c)) for r, c in np.argwhere(~grid.blocked)]
        if not free:
            continue
        start, goal = free[rng.integers(len(free))], free[rng.integers(len(free))]
        walks, trajectories = [], []
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
            trajectories.append((times, np.repeat(grid.to_xy(walk), 2, axis=0)))
        timeline = Timeline.of(list(range(len(walks))), [reach / 2] * len(walks), trajectories)
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
        trajectories = (timeline.radius, timeline.knot_t, timeline.knot_xy, timeline.first)
        above, below = (
            naive.ticks(mask, Moves.FOUR.offsets, centre, 0.3, start, goal, trajectories, 8, slack, 400)
            for slack in (0.0, 0.125)
        )
        plan = sipp(grid, centre[start], centre[goal], timeline, radius=0.3, v_max=1.0, moves=Moves.FOUR)
        assert below - 1e-6 <= plan.arrival <= above + 1e-6


def test_start_off_the_centres():
    """From anywhere the robot reaches a centre by one straight leg; the arrival is the best over all legs within reach."""
    rng = np.random.default_rng(7)
    for _ in range(cases(40, 2000)):
        grid, timeline = random_world(rng, 3, 9, 5)
        radius = 0.3 * grid.resolution
        mask = timed_moves(grid, radius)
        free = np.argwhere(mask)
        start = rng.uniform(0, 1, 2) * grid.shape[::-1] * grid.resolution
        point = grid.to_points(start)[0]
        if len(free) == 0 or hits_cells(grid.blocked, point, point, radius, True, 1) < radius / grid.resolution + 1e-6:
            continue
        goal = grid.centre(tuple(int(i) for i in rng.choice(free)))
        search = Sipp(grid, goal, radius=radius, v_max=1.0)
        plan = search.plan(start, timeline)
        if plan.status is Status.FOUND:
            check(grid, plan, timeline, radius, 1.0, start, goal)
        still = search.plan(start)
        cell = np.array(grid.cell_at(start))
        legs = [
            math.dist(start, grid.centre((r, c))) + search.field[r, c]
            for r, c in np.ndindex(grid.shape)
            if max(abs(cell - (r, c))) <= 3
            and mask[r, c]
            and hits_cells(grid.blocked, point, (r, c), radius, True, 2000) >= radius / grid.resolution
        ]
        assert math.isclose(still.arrival, min(legs, default=np.inf), abs_tol=1e-6)
        assert still.arrival <= plan.arrival + 1e-9


@pytest.mark.parametrize(("size", "rows", "origin"), [(0.1, 1, 0.0), (0.05, 3, 1e6), (0.1, 7, 1e6)])
def test_a_robot_as_wide_as_its_corridor_leaves_every_place_where_it_stands(size, rows, origin):
    """Rounding, beside the middle or far from the origin, does not make a contact of a wall that it touches."""
    grid = Grid(np.zeros((rows, 18), bool), size, (origin, 0.7 * origin, 0.0))
    search, left = Sipp(grid, grid.centre((rows // 2, 13)), radius=rows * size / 2, v_max=1.0), 0
    for col in (4, 6):
        x, y = grid.centre((rows // 2, col))
        for start in ((x, y), (x, y + 1e-10), (x + 0.3 * size, y - 1e-10)):
            if search.stands(start):
                left += 1
                assert search.plan(start).status is Status.FOUND
    assert left >= 2


def test_one_search_asked_again():
    """Queries leave nothing behind: a search asked in any order, after a tiny budget too, answers as a new one, bit for bit."""
    rng = np.random.default_rng(8)
    grid = Grid(rng.random((30, 30)) < 0.1)
    goal = grid.centre(tuple(int(i) for i in np.argwhere(timed_moves(grid, 0.4))[0]))
    search = Sipp(grid, goal, radius=0.4, v_max=1.0)
    for _ in range(cases(30)):
        _, timeline = random_world(rng, 20, 30, 40)
        start = grid.centre(tuple(int(i) for i in rng.choice(np.argwhere(search.mask))))
        search.plan(start, timeline, max_expanded=int(rng.integers(0, 5)))
        ours, fresh = search.plan(start, timeline), sipp(grid, start, goal, timeline, radius=0.4, v_max=1.0)
        assert ours.status is fresh.status and ours.expanded == fresh.expanded and ours.arrival == fresh.arrival
        assert ours.path.t.tobytes() == fresh.path.t.tobytes() and ours.path.xy.tobytes() == fresh.path.xy.tobytes()


def test_a_search_whose_memory_is_too_small_gets_more():
    """It begins anew with more room, and answers as with enough from the start."""
    rng = np.random.default_rng(10)
    for _ in range(cases(6)):
        grid, timeline = random_world(rng, 6, 9, 8)
        cells = np.argwhere(timed_moves(grid, 0.2 * grid.resolution))
        start, goal = (grid.centre(tuple(int(i) for i in rng.choice(cells))) for _ in range(2))
        search = Sipp(grid, goal, radius=0.2 * grid.resolution, v_max=1.0)
        wanted = search.plan(start, timeline)
        search._workspace = _workspace(search.mask.size, 1, 1)
        plan = search.plan(start, timeline)
        assert (plan.arrival, plan.expanded) == (wanted.arrival, wanted.expanded)
        assert plan.path.t.tobytes() == wanted.path.t.tobytes() and plan.path.xy.tobytes() == wanted.path.xy.tobytes()


def test_only_intervals_on_the_way_are_expanded():
    """Of many equally early paths over an empty map one is followed."""
    search = Sipp(Grid(np.zeros((7, 12), bool)), (10.5, 5.5), radius=0.3, v_max=2.0, moves=Moves.FOUR)
    free = search.plan((1.5, 1.5))
    assert (free.arrival, free.expanded) == (6.5, 13)


def test_budget_and_bound():
    """Out of budget there is no path but a bound that no arrival undercuts and that never falls as the budget grows."""
    rng = np.random.default_rng(9)
    for _ in range(cases(20)):
        grid, timeline = random_world(rng, 8, 12, 8)
        cells = np.argwhere(timed_moves(grid, 0.2 * grid.resolution))
        start, goal = (grid.centre(tuple(int(i) for i in rng.choice(cells))) for _ in range(2))
        search = Sipp(grid, goal, radius=0.2 * grid.resolution, v_max=1.0)
        best, last = search.plan(start, timeline), -math.inf
        for budget in range(best.expanded + 1):
            plan = search.plan(start, timeline, max_expanded=budget)
            if plan.status is Status.BUDGET:
                assert len(plan.path.t) == 0 and plan.arrival == math.inf
                assert last - 1e-8 <= plan.lower_bound <= best.arrival + 1e-8
                last = plan.lower_bound
            else:
                assert plan.arrival == best.arrival and budget >= best.expanded


@pytest.mark.parametrize(("v_max", "now"), [(1e-6, 0.0), (0.7, 0.0), (0.7, 1e8), (1000.0, 0.0), (1000.0, 1e8)])
def test_extreme_speeds_and_times(v_max, now):
    """The slowest and the fastest robot get a path from start to goal, whose arrival no bound exceeds, late times included."""
    search = Sipp(Grid(np.zeros((9, 12), dtype=bool)), (11.5, 7.5), radius=0.1, v_max=v_max)
    best = search.plan((0.6, 0.5), t=now)
    assert best.path.xy[0].tolist() == [0.6, 0.5] and best.path.xy[-1].tolist() == [11.5, 7.5] and best.path.t[0] == now
    for budget in range(best.expanded):
        assert now <= search.plan((0.6, 0.5), t=now, max_expanded=budget).lower_bound <= best.arrival
    for wrong in (v_max * 1e-10, v_max * 1e10):
        with pytest.raises(BadParameter, match="v_max"):
            Sipp(search.grid, (11.5, 7.5), radius=0.1, v_max=wrong)


def test_goal_region():
    """With a tolerance the robot goes to the cell it can reach first within that distance of the goal."""
    grid = Grid(np.zeros((5, 12), dtype=bool))
    plan = sipp(grid, (0.5, 2.5), (11.5, 2.5), radius=0.4, v_max=2.0, goal_tolerance=3.0)
    assert plan.arrival == 4.0 and plan.path.xy[-1].tolist() == [8.5, 2.5]


def test_horizon_forgets():
    """A disc that closes a corridor for ever is waited out to the horizon, and without one there is no path."""
    grid = Grid(np.zeros((1, 9), dtype=bool))
    wall = Timeline.of([1], [0.5], [([0.0], [(4.5, 0.5)])])
    options = {"radius": 0.5, "v_max": 1.0}
    assert sipp(grid, (0.5, 0.5), (8.5, 0.5), wall, **options).status is Status.NO_PATH
    plan = sipp(grid, (0.5, 0.5), (8.5, 0.5), wall, horizon=20.0, **options)
    assert math.isclose(plan.arrival, 25.0, abs_tol=1e-8)
    assert sipp(grid, (0.5, 0.5), (8.5, 0.5), wall, horizon=2.0, **options).arrival == 8.0
    assert sipp(grid, (4.0, 0.5), (8.5, 0.5), wall, **options).status is Status.NO_PATH  # in contact at the start


@pytest.mark.parametrize("bad", [math.nan, math.inf, -1.0, "1", None, True])
@pytest.mark.parametrize("name", ["radius", "v_max", "t", "horizon", "goal_tolerance", "max_expanded"])
def test_bad_numbers(name, bad):
    """A number that is none or out of range raises an error that names it."""
    good = {"radius": 0.3, "v_max": 1.0, "t": 0.0, "horizon": 9.0, "goal_tolerance": 0.0, "max_expanded": 9}
    if (name, bad) in (("t", -1.0), ("horizon", math.inf), ("max_expanded", None)):
        return
    with pytest.raises(BadParameter, match=name):
        sipp(Grid(np.zeros((3, 3), dtype=bool)), (0.5, 0.5), (2.5, 2.5), **(good | {name: bad}))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("radius", [-0.1, 0.2]),
        ("radius", [math.nan, 0.2]),
        ("radius", [0.2]),
        ("radius", [0.2, 1.1e10]),
        ("knot_xy", [[0.0, 0.0], [0.0, -1.1e10], [0.0, 0.0]]),
        ("knot_t", [1.0, 1.0, 0.0]),
        ("knot_t", [0.0, math.inf, 0.0]),
        ("knot_t", [0.0, 1.0]),
        ("knot_xy", [[0.0, 0.0]] * 2),
        ("knot_xy", [[0.0, math.nan]] * 3),
        ("first", [0, 2, 4]),
        ("first", [1, 2, 3]),
        ("first", [0, 0, 3]),
        ("first", [0.0, 2.0, 3.0]),
    ],
)
def test_bad_courses(field, value):
    """Arrays of obstacles that do not fit together or are not finite raise an error that names the obstacles."""
    good = {"radius": [0.2, 0.2], "knot_t": [0.0, 1.0, 0.0], "knot_xy": [[0.0, 0.0]] * 3, "first": [0, 2, 3]}
    trajectories = SimpleNamespace(**{k: np.array(v) for k, v in (good | {field: value}).items()})
    with pytest.raises(BadParameter, match="obstacles"):
        sipp(Grid(np.zeros((3, 3), dtype=bool)), (0.5, 0.5), (2.5, 2.5), trajectories, radius=0.3, v_max=1.0)


def test_bad_arguments_of_moves_and_fields():
    """Each is named."""
    grid = Grid(np.zeros((3, 3), dtype=bool))
    for first in (5, (0,), (0, 0, 0), (1, 0)):
        with pytest.raises(BadParameter, match="first"):
            timed_moves(grid, 0.3, first=first)
    mask = timed_moves(grid, 0.3)
    for name, moves, goals in (
        ("moves", "four", (0, 0)),
        ("goals", Moves.FOUR, [(0, 0), (0,)]),
        ("goals", Moves.FOUR, [(9, 9)]),
    ):
        with pytest.raises(BadParameter, match=name):
            timed_field(mask, moves, goals)
    with pytest.raises(BadParameter, match="v_max"):
        sipp(grid, (0.5, 0.5), (2.5, 2.5), radius=0.3, v_max=1e-320)


def test_bad_places():
    """Ends off the map or within the robot's radius of a wall, turned maps and moves that cut corners are refused."""
    grid = Grid(np.pad(np.zeros((3, 3), dtype=bool), 1, constant_values=True))
    for start, goal, error in (
        ((2.5, 9.0), (2.5, 2.5), OutOfBounds),
        ((2.5, 2.5), (-1.0, 2.5), OutOfBounds),
        ((1.2, 2.5), (2.5, 2.5), CellBlocked),
        ((2.5, 2.5), (0.5, 2.5), CellBlocked),
        ((math.nan, 2.5), (2.5, 2.5), BadParameter),
        ((2.5,), (2.5, 2.5), BadParameter),
    ):
        with pytest.raises(error):
            sipp(grid, start, goal, radius=0.3, v_max=1.0)
    with pytest.raises(BadParameter, match="yaw"):
        sipp(Grid(grid.blocked, origin=(0.0, 0.0, 0.5)), (2.5, 2.5), (2.5, 2.5), radius=0.3, v_max=1.0)
    with pytest.raises(BadParameter, match="moves"):
        timed_moves(grid, 0.3, Moves.EIGHT_CUT)
    with pytest.raises(BadParameter, match="goals"):
        timed_field(timed_moves(grid, 0.3), Moves.THIRTY_TWO, (5, 0))
    with pytest.raises(BadParameter, match="mask"):
        timed_field(grid.blocked, Moves.THIRTY_TWO, (1, 1))


def test_a_goal_in_a_cell_that_no_move_leads_from():
    """A robot that fills a map of one cell is at its goal, within a tolerance or not."""
    cell = Grid(np.zeros((1, 1), dtype=bool))
    for tolerance in (0.0, 0.1):
        there = sipp(cell, (0.5, 0.5), (0.5, 0.5), radius=0.3, v_max=1.0, goal_tolerance=tolerance)
        assert there.status is Status.FOUND and there.arrival == 0.0
    with pytest.raises(CellBlocked, match=r"at the centre of a cell within 0\.1 m"):
        sipp(cell, (0.5, 0.5), (0.9, 0.9), radius=0.3, v_max=1.0, goal_tolerance=0.1)


def test_paths_that_take_too_long_are_no_proof() -> None:
    """They would end after the last safe interval, which looked as if there was no path."""
    with pytest.raises(BadParameter, match=r"v_max .* no path to the goal takes more than 1e\+12 s"):
        Sipp(Grid(np.zeros((1, 30), bool), 1e6), (2.95e7, 5e5), radius=0.0, v_max=1e-6)
