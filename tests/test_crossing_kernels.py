"""The kernels of avoidance against their sampled twins and against exact search (C5, C7)."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from antway import Grid, Observation, RobotSpec, Status, Task, Tracks
from antway.kernels import crossing
from antway.kernels.base.records import Predictions
from antway.kernels.robot.guard import time_to_contact
from antway.kernels.robot.reach import least_gap
from antway.kernels.spacetime.ants import _Choices, _draw, deposit
from antway.kernels.spacetime.memory import EXPANSIONS, GENERATION, HEAP_SIZE, STATE_COUNT, pop, push
from antway.kernels.spacetime.motion import first_conflict, passing, place_at, shorten, trace_back
from antway.kernels.spacetime.pheromone import TRAILS, edge, evaporate, lay, slot, window
from antway.kernels.spacetime.segments import earliest_departure, unsafe_departures, unsafe_stay
from antway.kernels.tracking import kalman as track
from antway.kernels.tracking.predict import ID, NO_PREDICTIONS, RADIUS, TubeMargins, predict
from antway.kernels.tracking.table import make_table
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.state import make_memory, make_trails
from antway.search.sipp import Sipp
from antway.world.motions import Bounce
from antway.world.terrain import terrain_of
from antway.world.world import Obstacle, World
from common import cases, costly
from crossing import colony, local_problem
from naive import crossing as naive


def random_piece(rng: np.random.Generator) -> np.ndarray:
    t0 = rng.uniform(0.0, 2.0)
    velocity = rng.uniform(-1.0, 1.0, 2) * (rng.random() < 0.9)
    contact_radius, berth = rng.uniform(0.1, 0.8), rng.uniform(0.0, 0.2)
    return np.array(
        [[t0, t0 + rng.uniform(0.1, 4.0), *rng.uniform(-2.0, 2.0, 2), *velocity, contact_radius, contact_radius + berth]]
    )


def test_unsafe_stay_is_what_sampling_finds() -> None:
    """The closed interval of contact covers every sample in contact and no more than the step between samples."""
    rng = np.random.default_rng(0)
    times = np.linspace(-1.0, 8.0, 4501)
    for _ in range(cases(500, 10**5)):
        piece, (x, y) = random_piece(rng), rng.uniform(-2.0, 2.0, 2)
        low, high = unsafe_stay(x, y, piece, 0)
        hit = times[naive.unsafe_stay(x, y, piece[0], times)]
        if len(hit):
            assert low - 1e-9 <= hit[0] <= low + 0.003 and high - 0.003 <= hit[-1] <= high + 1e-9
        else:
            assert high - low < 0.003


def test_unsafe_departures_are_what_sampling_finds() -> None:
    """The interval of departures that lead to contact covers every sampled one, and nothing else."""
    rng = np.random.default_rng(1)
    departures = np.linspace(-2.0, 8.0, 2001)
    for i in range(costly(400, 10**5)):
        piece, (x, y), v = random_piece(rng), rng.uniform(-2.0, 2.0, 2), rng.uniform(-1.0, 1.0, 2)
        if i % 7 == 0:  # parallel courses
            v = piece[0, 4:6] * rng.uniform(-1.0, 2.0)
        duration = rng.uniform(0.1, 1.0)
        low, high = unsafe_departures(x, y, v[0], v[1], duration, piece, 0)
        hit = departures[naive.unsafe_departures(x, y, v, duration, piece[0], departures)]
        if len(hit):
            assert low - 1e-9 <= hit[0] and hit[-1] <= high + 1e-9
            assert hit[0] - low < 0.03 and high - hit[-1] < 0.03
        else:
            assert high - low < 0.03


def test_earliest_departure_is_safe_and_earliest() -> None:
    """The departure found is safe by sampling, also with lag, and no sampled earlier one is."""
    rng = np.random.default_rng(2)
    for _ in range(costly(200, 10**4)):
        segments = np.vstack([random_piece(rng) for _ in range(6)])
        (x, y), v, duration, stopping_time = (
            rng.uniform(-2, 2, 2),
            rng.uniform(-1, 1, 2),
            rng.uniform(0.1, 1.0),
            rng.choice([0.0, 0.1]),
        )
        s = earliest_departure(x, y, v[0], v[1], duration, 0.0, 9.0, Predictions(segments, stopping_time))
        departures = np.arange(0.0, 9.0, 0.01)
        moved = segments + np.array([stopping_time, stopping_time, 0, 0, 0, 0, 0, 0])
        hit = np.any([naive.unsafe_departures(x, y, v, duration, piece, departures) for piece in moved], axis=0)
        missed = departures[(departures < s - 1e-6) & ~hit]  # grazes between samples of the way
        assert all(np.abs(departures[hit] - m).min() < 0.03 for m in missed)
        assert not hit[np.abs(departures - s) < 1e-9].any()


def test_gap_to_reach_is_the_least() -> None:
    """The closed form of the worst gap to a growing disc equals the sampled least to 1e-6."""
    rng = np.random.default_rng(3)
    for _ in range(cases(300, 10**5)):
        a, w = rng.uniform(-2, 2, 2), rng.uniform(-1.5, 1.5, 2) * (rng.random() < 0.9)
        contact_radius, growth, t = rng.uniform(0.1, 1.0), rng.choice([0.0, rng.uniform(0.0, 1.5)]), rng.uniform(0.05, 2.0)
        assert least_gap(*a, *w, contact_radius, growth, t) == pytest.approx(
            naive.gap_to_reach(a, w, contact_radius, growth, t), abs=1e-6
        )


def test_time_to_contact_is_the_first() -> None:
    """The earliest contact with tracks that keep their velocity is where the sampled gap first closes."""
    rng = np.random.default_rng(4)
    s = np.linspace(0.0, 20.0, 20001)
    for _ in range(cases(200, 10**4)):
        tracks = np.column_stack(
            (
                rng.uniform(-4, 4, (3, 2)),
                rng.uniform(-1, 1, (3, 2)),
                rng.uniform(0.1, 0.4, 3),
                np.ones((3, 3)) * (1.0, np.inf, 0.0),
            )
        )
        tracks[:, 2:4] -= rng.uniform(-1, 1, 2)
        found = time_to_contact(0.0, 0.0, tracks, 0.3)
        gap = [np.hypot(k[0] + k[2] * s, k[1] + k[3] * s) - k[4] - 0.3 for k in tracks]
        hit = s[(np.min(gap, axis=0) <= 0.0)]
        if found < 19.9 and len(hit):
            assert abs(hit[0] - found) < 0.002
        elif found < 19.9:
            assert np.min(gap) < 1e-3  # a graze between samples
        else:
            assert not len(hit) or hit[0] > 19.8


def test_colony_reaches_the_exact_optimum() -> None:
    """On local problems the colony arrives when SIPP does, to the gain asked for, and neither where the other cannot (C5)."""
    rng = np.random.default_rng(5)
    solved = 0
    for _ in range(cases(60, 2000)):
        grid, robot, start, goal, context, segments = local_problem(rng)
        x, y = grid.centre(start)
        memory, _, arrival, bound = colony(context, segments, x, y)
        opened = memory.stamp == memory.counter[GENERATION]
        states = memory.counter[STATE_COUNT] if math.isfinite(arrival) else 0
        assert states <= 1 + memory.intervals[opened].sum(), "each cell is opened once"
        exact = Sipp(grid, grid.centre(goal), radius=robot.radius, v_max=1.0).search((x, y), 0.0, segments)
        if exact.status is Status.FOUND and exact.arrival < 19.0:
            solved += 1
            assert exact.arrival - 1e-6 <= arrival <= exact.arrival + 0.001 + 1e-6
            assert arrival - 0.001 - 1e-6 <= bound <= exact.arrival + 1e-6
            assert colony(context, segments, x, y, limit=arrival)[1:3] == (-1, arrival), "only what is better counts"
            assert colony(context, segments, x, y, limit=arrival + 0.01)[1] > 0
            free = context.field[start[0] * 31 + start[1]]
            idle, end, _, least = colony(context, segments, x, y, limit=free + 0.0005)
            assert (end, idle.counter[EXPANSIONS], least) == (-1, 0, pytest.approx(free)), "nothing can be better by so much"
        elif exact.status is Status.NO_PATH:
            assert arrival == math.inf or arrival >= 19.0
    assert solved > 0


def test_the_first_leg_may_lead_to_any_cell_near_the_start() -> None:
    """From places off the centres, in a memory that was used before, the colony arrives when SIPP does, by the same legs."""
    rng, solved, memory = np.random.default_rng(16), 0, make_memory(31 * 31, 1 << 15, 1 << 18)
    for _ in range(cases(20, 1000)):
        grid, robot, start, goal, context, segments = local_problem(rng)
        x, y = np.add(grid.centre(start), rng.uniform(-0.09, 0.09, 2)).tolist()
        search = Sipp(grid, grid.centre(goal), radius=robot.radius, v_max=1.0)
        if not search.stands((x, y)):
            continue
        exact = search.search((x, y), 0.0, segments)
        _, end, arrival, bound = colony(context, segments, x, y, leg_cells=3, memory=memory)
        if exact.status is Status.FOUND and exact.arrival < 19.0:
            solved += 1
            assert exact.arrival - 1e-6 <= arrival <= exact.arrival + 0.001 + 1e-6 and bound <= exact.arrival + 1e-6
        elif exact.status is Status.NO_PATH:
            assert end < 0 or arrival >= 19.0
        here = np.array([[-1.0, 3.0, x + 0.05, y, 0.0, 0.0, 0.3, 0.3]])
        assert colony(context, here, x, y, leg_cells=3, memory=memory)[1:3] == (-1, math.inf), "somebody stands there"
        walled = divmod(int(np.isinf(context.field).argmax()), 31)
        assert colony(context, segments, *grid.centre(walled), memory=memory)[1:] == (-1, math.inf, math.inf), "no way out"
    assert solved > 0


def test_a_weight_on_metres_finds_shorter_paths_that_cost_less() -> None:
    """With a weight on metres a path costs what the search says or less, is no longer, and seldom costs more than without."""
    rng, shorter, dearer = np.random.default_rng(8), 0, 0
    for _ in range(runs := cases(60, 2000)):
        grid, _, start, _, context, segments = local_problem(rng)
        (x, y), predictions, knots = grid.centre(start), Predictions(segments, 0.0), np.empty((600, 3))
        spent = []
        for weight in (0.0, 5.0):
            memory, end, cost, bound = colony(context, segments, x, y, distance_weight=weight)
            n = 0 if end < 0 else trace_back(memory, context, predictions, x, y, end, 20.0, 40.0, knots)
            metres = float(np.hypot(*np.diff(knots[:n, 1:], axis=0).T).sum())
            reached = 1 + np.flatnonzero(np.isfinite(memory.arrival[1 : memory.counter[STATE_COUNT]]))
            assert (memory.depart[reached] >= memory.arrival[memory.parent[reached]] - 1e-9).all(), "nobody leaves too soon"
            if n:
                assert bound - 1e-6 <= knots[n - 1, 0] + weight * metres <= cost + 1e-6
                assert first_conflict(knots[:n], 0.0, predictions) == math.inf
            spent.append((n > 0, metres, float(knots[n - 1, 0]) + 5.0 * metres))
        assert spent[0][0] == spent[1][0]
        if spent[0][0]:
            shorter += spent[1][1] < spent[0][1] - 1e-6
            dearer += spent[1][2] > spent[0][2] + 0.011
    assert shorter >= 0.1 * runs and dearer <= 0.05 * runs


def test_motions_keep_clear_of_everything() -> None:
    """What is read from the colony's memory, and its any-angle shortening, touch nothing and never arrive later."""
    rng = np.random.default_rng(6)
    shorter = 0
    for _ in range(cases(60, 2000)):
        grid, robot, start, goal, context, segments = local_problem(rng)
        x, y = grid.centre(start)
        memory, end, arrival, _ = colony(context, segments, x, y, expansions=2000, minimum_improvement=0.02)
        if end < 0:
            continue
        raw, short = np.empty((600, 3)), np.empty((600, 3))
        n = trace_back(memory, context, Predictions(segments, 0.0), x, y, end, 20.0, 30.0, raw)
        m = shorten(context, Predictions(segments, 0.0), raw[:n], short)
        assert raw[n - 1, 0] <= arrival + 1e-9 and short[m - 1, 0] <= raw[n - 1, 0] + 1e-9
        shorter += short[m - 1, 0] < raw[n - 1, 0] - 1e-6
        waits = np.vstack((raw[:n], raw[n - 1] + np.array([1.0, 0.0, 0.0])))
        last = shorten(context, Predictions(segments, 0.0), waits, short) - 1
        assert (short[last] == waits[-1]).all(), "a wait at the end stays"
        m = shorten(context, Predictions(segments, 0.0), raw[:n], short)
        for knots in (raw[:n], short[:m]):
            assert (knots[0, 1:] == (x, y)).all() and np.allclose(knots[-1, 1:], grid.centre(goal))
            steps = np.diff(knots, axis=0)
            assert (steps[:, 0] > 0).all() and (np.hypot(steps[:, 1], steps[:, 2]) <= steps[:, 0] + 1e-9).all()
            assert first_conflict(knots, 0.0, Predictions(segments, 0.0)) == math.inf
            assert naive.closest(knots, segments) > -1e-6
            t = np.arange(0.0, knots[-1, 0], 0.01)
            path = np.column_stack([np.interp(t, knots[:, 0], knots[:, k]) for k in (1, 2)])
            p = grid.to_points(path)
            for r, c in np.argwhere(grid.blocked):
                gap = np.hypot(np.maximum(np.abs(p[:, 0] - r) - 0.5, 0), np.maximum(np.abs(p[:, 1] - c) - 0.5, 0)) * 0.2
                assert gap.min() > robot.radius - 1e-6
    assert shorter > 0


def test_the_first_conflict_is_that_which_sampling_finds() -> None:
    """Of a motion with waits, from a moment on: the start of the first leg or wait that meets an obstacle, or none."""
    rng, found = np.random.default_rng(8), 0
    for _ in range(cases(150, 2000)):
        segments = np.vstack([random_piece(rng) for _ in range(2)])
        berths = segments[:, [0, 1, 2, 3, 4, 5, 7, 7]]  # kept while it moves
        xy = rng.uniform(-2, 2, (5, 2)).repeat(rng.integers(1, 3, 5), axis=0)
        knots, now, wanted = np.column_stack((np.cumsum(rng.uniform(0.3, 1.0, len(xy))), xy)), float(rng.uniform(0.0, 2.0)), []
        for first, last in pairwise(knots):
            begin = np.array([np.interp(max(now, first[0]), knots[:, 0], knots[:, k]) for k in range(3)])
            if begin[0] < last[0]:
                kept = segments if (first[1:] == last[1:]).all() else berths
                wanted.append((begin[0], naive.closest(np.vstack((begin, last)), kept, 0.002)))
        if all(abs(gap) > 0.005 for _, gap in wanted):
            conflict = next((t for t, gap in wanted if gap < 0.0), math.inf)
            assert first_conflict(knots, now, Predictions(segments, 0.0)) == pytest.approx(conflict, abs=1e-12)
            found += conflict < math.inf
    assert found >= cases(150, 2000) // 30


def test_behind_the_horizon_motions_follow_the_field() -> None:
    """They wait for it, reach the goal when the field says, and end early where told to or where there is no room."""
    rng, ran = np.random.default_rng(9), 0
    for _ in range(cases(12, 300)):
        grid, _, start, goal, context, segments = local_problem(rng)
        x, y = grid.centre(start)
        field = float(context.field[start[0] * 31 + start[1]])
        segments = np.vstack((segments, [0.0, 20.0, *grid.centre(goal), 0.0, 0.0, 0.5, 0.5]))  # somebody stands at the goal
        horizon = 0.4 * field if ran % 2 else 2.0 * field
        memory, end, _, _ = colony(context, segments, x, y, expansions=2000, horizon=horizon)
        if end <= 0 or memory.cell[end] == context.goal:
            continue
        ran += 1
        known, knots = (memory, context, Predictions(segments, 0.0), x, y, end, horizon), np.empty((600, 3))
        knots = knots[: trace_back(*known, math.inf, knots)]
        left = max(memory.arrival[end], horizon)
        assert knots[-1, 0] == pytest.approx(left + context.field[memory.cell[end]]) and grid.cell_at(knots[-1, 1:]) == goal
        steps = np.diff(knots, axis=0)
        assert (steps[:, 0] > 0).all() and (np.hypot(steps[:, 1], steps[:, 2]) <= context.speed * steps[:, 0] + 1e-9).all()
        at = int(np.searchsorted(knots[:, 0], left - 1e-6))
        assert np.allclose(np.hypot(*steps[at:, 1:].T), context.speed * steps[at:, 0])
        less = np.empty((600, 3))
        assert trace_back(*known, float(knots[at + 1, 0]) - 1e-3, less) == at + 2
        for room in range(4, len(knots)):
            n = trace_back(*known, math.inf, less[:room])
            assert room - 2 <= n <= room and (less[:n] == knots[:n]).all()
    assert ran > cases(12, 300) / 6


def test_same_seed_same_search() -> None:
    """The colony's result, budget spent or not, depends on nothing but its input and seed."""
    grid, _, start, _, context, segments = local_problem(np.random.default_rng(7))
    results = [colony(context, segments, *grid.centre(start), expansions=300, seed=9) for _ in range(2)]
    assert results[0][1:] == results[1][1:]
    for a, b in zip(results[0][0], results[1][0]):
        assert a.tobytes() == b.tobytes()


def test_a_search_does_not_depend_on_the_zero_of_the_clock() -> None:
    """The colony arrives as long after its start, and lays as much pheromone: at least Q / L on the best path."""
    rng, found = np.random.default_rng(14), 0
    for _ in range(cases(6)):
        grid, _, start, _, context, segments = local_problem(rng)
        (x, y), t0, trails = grid.centre(start), 1000.0, make_trails(context.field.size)
        _, end, arrival, _ = colony(context, segments, x, y)
        later = segments + np.array([t0, t0, 0, 0, 0, 0, 0, 0])
        _, there, then, bound = colony(context, later, x, y, t0=t0, horizon=20.0 + t0, trails=trails)
        assert (there < 0) == (end < 0) and (end < 0 or then - t0 == pytest.approx(arrival, abs=0.002))
        if end > 0:
            assert t0 + context.field[start[0] * 31 + start[1]] <= bound + 1e-9 and trails.tau.max() >= 0.99 / (then - t0)
            found += 1
    assert found


def test_place_at_is_linear_between_knots() -> None:
    """The place on a motion is interpolated, and held before and after."""
    knots = np.array([[1.0, 0.0, 0.0], [2.0, 1.0, 0.0], [3.0, 1.0, 0.0], [4.0, 1.0, 2.0]])
    for t in (0.0, 1.0, 1.5, 2.5, 3.75, 9.0):
        x, y, _ = place_at(knots, t)
        assert (x, y) == (np.interp(t, knots[:, 0], knots[:, 1]), np.interp(t, knots[:, 0], knots[:, 2]))


def test_predictions_are_mirrored_as_the_world_mirrors() -> None:
    """The predicted course of a bouncing disc is the course it takes."""
    rng = np.random.default_rng(8)
    blocked = np.zeros((40, 40), dtype=bool)
    blocked[10:14, 5:25] = blocked[25:28, 18:36] = True
    grid = Grid(blocked, 0.2)
    out = np.empty((64, 8))
    for _ in range(cases(50, 2000)):
        heading, speed = float(rng.uniform(-3, 3)), float(rng.uniform(0.2, 0.9))
        world = World(grid, (Obstacle(0.25, Bounce((4.0, 4.0), speed, heading)),))
        line = world.timeline(0, 5.0)
        _, velocity = line.at(0.0)
        estimates = np.array([[4.0, 4.0, *velocity[0], 0.25, 0.0, 0.0, 0.0]])
        margins = TubeMargins(0.3, 0.05, 1.6, 1.0, 0.5, 0.1)
        n = predict(estimates, 0.0, 0.0, 3.0, 0.5, 0.5, margins, terrain_of(grid), NO_PREDICTIONS, out)
        for piece in out[:n]:
            for t in np.linspace(max(piece[0], 0.0), piece[1], 5):
                at = piece[2:4] + piece[4:6] * (t - piece[0])
                assert np.allclose(at, line.at(float(t))[0][0], atol=1e-6)
            assert piece[6] == pytest.approx(0.3 + 0.25 + 0.05)
            assert piece[7] == pytest.approx(piece[6] + (speed + 0.05) * 0.1)


def test_filter_is_the_textbook_one() -> None:
    """Without velocities the tracker equals a Kalman filter with matrices to 1e-12, for each axis."""
    rng = np.random.default_rng(9)
    table, estimates = make_table(8, track.COLUMNS, ID), np.zeros((8, 8))
    twins: list[naive.Kalman] = []
    nan = np.full((1, 2), math.nan)
    t, dt = 0.0, 0.0
    for _ in range(200):
        xy = np.array([[t * 0.5, 1.0 - t * 0.2]]) + rng.normal(0.0, 0.05, (1, 2))
        variance = np.array([[0.0025, 0.0]])
        scan = np.array([3]), xy, nan, np.array([0.3]), variance
        n, fastest, measured = track.update(*table[:2], t, *scan, 1.0, estimates)
        if not twins:
            twins = [naive.Kalman(z, 0.0, 0.0025, 1.0) for z in xy[0]]
        else:
            for twin, z in zip(twins, xy[0]):
                twin.step(dt, 1.0, z, 0.0025)
        assert n == 1 and not measured and fastest == math.hypot(*estimates[0, 2:4])
        assert estimates[0, :4] == pytest.approx(
            [twins[0].m[0], twins[1].m[0], twins[0].m[1], twins[1].m[1]], rel=1e-9, abs=1e-12
        )
        assert estimates[0, 5] == pytest.approx(math.sqrt(twins[0].p[0, 0]), rel=1e-9)
        dt = float(rng.uniform(0.05, 0.3))
        t += dt
    assert abs(estimates[0, 2] - 0.5) < 0.2


def test_who_turns_has_his_new_velocity_in_two_scans() -> None:
    """Of exact places alone the velocity is known at the second, and at the second after a turn between two scans."""
    table, estimates = make_table(8, track.COLUMNS, ID), np.zeros((8, 8))
    nan, variance, at, off = np.full((1, 2), math.nan), np.zeros((1, 2)), np.array([1.0, 2.0]), []
    for i in range(12):
        velocity = np.array([0.9, 0.1] if i <= 6 else [-0.5, 0.6])
        scan = np.array([3]), at[None], nan, np.array([0.3]), variance
        track.update(*table[:2], 0.1 * i, *scan, 1.0, estimates)
        off.append(float(np.hypot(*(estimates[0, 2:4] - velocity))))
        at = at + (0.06 * np.array([0.9, 0.1]) + 0.04 * np.array([-0.5, 0.6]) if i == 6 else 0.1 * velocity)
    assert estimates[0, 6] < track.UNKNOWN and max(off[1:7]) < 0.01 and off[7] > 0.3 and max(off[8:]) < 0.02


def test_a_radius_grows_at_once_and_shrinks_slowly() -> None:
    """One that is measured with errors is seldom taken for less than it is; one that never changes stays as it is."""
    table, estimates = make_table(8, track.COLUMNS, ID), np.zeros((8, 8))
    rng, variance, found = np.random.default_rng(5), np.zeros((2, 2)), []
    for i in range(200):
        xy, velocity = np.array([[0.1 * i, 0.0], [0.1 * i, 5.0]]), np.array([[1.0, 0.0], [1.0, 0.0]])
        radius = np.array([0.3, 0.3 * rng.uniform(0.8, 1.2)])
        scan = np.array([3, 4]), xy, velocity, radius, variance
        track.update(*table[:2], 0.1 * i, *scan, 1.0, estimates)
        assert estimates[0, RADIUS] == 0.3 and estimates[1, RADIUS] >= radius[1]
        found.append(estimates[1, RADIUS])
    assert np.quantile(found[10:], 0.02) >= 0.3 and max(found) <= 0.36
    for i in range(200, 240):
        scan = np.array([4]), np.array([[0.1 * i, 5.0]]), np.array([[1.0, 0.0]]), np.array([0.2]), variance[:1]
        track.update(*table[:2], 0.1 * i, *scan, 1.0, estimates)
    assert estimates[0, RADIUS] == pytest.approx(0.2, abs=0.01)


def test_trails_keep_within_their_limits() -> None:
    """Pheromone stays finite and at or above its floor over 10,000 cycles, and what is past is dropped (C12)."""
    rng = np.random.default_rng(10)
    trails = make_trails(100)
    for cycle in range(cases(10000)):
        now = cycle * 0.1
        for _ in range(3):
            lay(trails, edge(trails, int(rng.integers(100)), int(rng.integers(32)), now + rng.uniform(0, 5)), 1.0)
        if cycle % 10 == 0:
            evaporate(trails, now, float(cycle + 1))
            used = trails.key >= 0
            assert np.isfinite(trails.tau).all() and (trails.tau[used] > 0).all() and used.sum() < TRAILS // 2
            assert ((trails.key[used] // 6400 + 1) * trails.bin >= now).all()
    key = edge(trails, 5, 3, now + 1.0)
    at = slot(trails, key)
    before = trails.tau[at] if trails.key[at] == key else 0.0
    lay(trails, key, 2.0)
    assert trails.tau[slot(trails, key)] == pytest.approx(before + 2.0, abs=1e-6)


def test_an_edge_is_kept_in_one_of_sixteen_slots() -> None:
    """In the first of them that is free, from the end of the table on at its beginning; where none is free nothing is laid."""
    trails = make_trails(100)
    keys = {slot(trails, key): key for key in range(1, 6400)}
    for home in (min(keys), max(keys)):
        trails.key[:] = -1
        places = [(home + i) % TRAILS for i in range(16)]
        for i, place in enumerate(places):
            assert slot(trails, keys[home]) == place
            trails.key[place] = 6400 * i
        assert slot(trails, keys[home]) == -1
        lay(trails, keys[home], 1.0)
        assert not trails.tau.any() and not trails.mark.any()
        trails.key[places[-1]] = keys[home]
        assert slot(trails, keys[home]) == places[-1]
    assert max(keys) > TRAILS - 16


def test_the_first_edge_and_the_first_slot_are_like_all_others() -> None:
    """The key of an edge, and its place in the table, may be 0."""
    trails = make_trails(100)
    assert window(trails, 10)[2].shape == (0, 0)
    for key in (0, next(key for key in range(6400) if slot(trails, key) == 0)):
        trails.key[:] = -1
        lay(trails, key, 1.0)
        lay(trails, key, 1.0)
        row, col = divmod(key // 64, 10)
        assert trails.mark[key // 64] and (trails.key >= 0).sum() == 1
        top, left, found = window(trails, 10)
        assert (top, left, found.tolist()) == (row, col, [[2.0]])


@pytest.mark.parametrize("clock", [-1e6, -0.7, 2.0**15, 1.7e9, 1e12])
def test_pheromone_is_kept_by_every_clock(clock: float) -> None:
    """Before the time 0 no edge used to keep any."""
    trails = make_trails(100)
    keys = [edge(trails, 5, 3, clock + 0.5 * i) for i in range(4)]
    for key in keys:
        lay(trails, key, 2.0)
    evaporate(trails, clock + 1.1, 1.0)
    assert sorted(trails.key[trails.key >= 0].tolist()) == sorted(keys[2:])
    assert trails.mark[5] and len(set(keys)) == 4


def test_pheromone_is_laid_on_each_edge_at_the_time_at_which_it_is_left() -> None:
    """An edge is a cell, the move that leaves it, and the bin of the time at which it is left."""
    rng, several = np.random.default_rng(13), 0
    for _ in range(cases(5)):
        grid, _, start, _, context, segments = local_problem(rng)
        memory, end, *_ = colony(context, segments, *grid.centre(start))
        trails, cells, expected, s = make_trails(len(context.field)), len(context.field), set(), end
        if end < 0:
            continue
        deposit(memory, trails, context, end, 0.5)
        while memory.cell[s] >= 0 and memory.cell[p := memory.parent[s]] >= 0:
            expected.add((memory.cell[p], memory.cell[s] - memory.cell[p], int(memory.arrival[p] / trails.bin)))
            s = p
        keys = [int(key) for key in trails.key if key >= 0]
        assert {(key // 64 % cells, context.offset[key % 64], key // 64 // cells) for key in keys} == expected
        several += len({when for *_, when in expected}) > 1
    assert several


@pytest.mark.parametrize("seed", [164, 952, 1233])
def test_rounding_leaves_no_choice_to_draw(seed: int) -> None:
    """With much pheromone the sum of the weights did not fall to 0 with the last choice; `make bounds` found it."""
    rng, robot = np.random.default_rng(seed), RobotSpec(drive="differential", v_max=2.0, dt=0.01, v_reverse=1.0)
    task = Task(Grid(np.zeros((6, 6), dtype=bool), 0.5), robot, (0.75, 2.05), (2.25, 0.75))
    policy = AntwayPolicy(deposit=1e6, margin=10.0, hysteresis=0.0, guard=False)
    policy.reset(task, seed)
    xy, velocity = rng.uniform(0.0, 3.0, (30, 2)), rng.normal(0.0, 1.0, (30, 2))
    for k in range(4):
        tracks = Tracks(np.arange(30), xy + 0.01 * k * velocity, velocity, np.full(30, 0.01))
        command = policy.act(Observation(0.01 * k, task.start, (0.0, 0.0), 0.0, tracks))
        assert np.isfinite(command.twist or (math.nan,)).all()


def test_moves_are_drawn_in_proportion_to_their_weights() -> None:
    """A move without weight is never drawn."""
    weight, state = np.array([1.0, 0.0, 3.0, 4.0]), np.array([5], np.uint64)
    choices = _Choices(np.arange(4), np.zeros(4), weight)
    drawn = [_draw(choices, 4, 8.0, state) for _ in range(2000)]
    assert np.bincount(drawn, minlength=4) / 2000 == pytest.approx(weight / 8.0, abs=0.05) and 1 not in drawn


def test_trails_evaporate_by_the_papers_persistence() -> None:
    """tau <- clip(exp(-1 / tau) + exp(-cycle), 0.1, 0.9) tau; what falls to 1.05, or whose bin has ended, is gone."""
    rng = np.random.default_rng(12)
    for _ in range(cases(20)):
        trails, now, cycle = make_trails(100), float(rng.uniform(0.0, 5.0)), float(rng.integers(1, 8))
        excess: dict[int, float] = {}
        for _ in range(40):
            key, amount = edge(trails, int(rng.integers(100)), 7, float(rng.uniform(0.0, 10.0))), float(rng.uniform(0.0, 8.0))
            lay(trails, key, amount)
            excess[key] = excess.get(key, 0.0) + amount
        evaporate(trails, now, cycle)
        tau = {key: 1.0 + more for key, more in excess.items() if (key // 6400 + 1) * trails.bin >= now}
        left = {key: min(max(math.exp(-1.0 / at) + math.exp(-cycle), 0.1), 0.9) * at for key, at in tau.items()}
        kept = {int(key): 1.0 + float(more) for key, more in zip(trails.key, trails.tau) if key >= 0}
        assert kept == pytest.approx({key: at for key, at in left.items() if at > 1.05}, rel=1e-5)
        assert set(np.flatnonzero(trails.mark).tolist()) == {key // 64 % 100 for key in kept}


def test_a_window_of_pheromone_holds_the_largest_of_each_cell() -> None:
    """Each cell of the window has the most that lies on any of its moves at any time, and outside lies none."""
    rng = np.random.default_rng(11)
    for _ in range(cases(20)):
        trails, twin = make_trails(12 * 9), np.zeros((12, 9), np.float32)
        for _ in range(rng.integers(0, 30)):
            cell, move, t, amount = rng.integers(2, 100), rng.integers(32), rng.uniform(0.0, 9.0), rng.uniform(0.1, 3.0)
            lay(trails, edge(trails, cell, move, t), amount)
        for key, tau in zip(trails.key.tolist(), trails.tau):
            if key >= 0:
                row, col = divmod(key // 64 % twin.size, 9)
                twin[row, col] = max(twin[row, col], tau)
        top, left, part = window(trails, 9)
        whole = np.zeros_like(twin)
        whole[top : top + part.shape[0], left : left + part.shape[1]] = part
        assert (whole == twin).all() and part.size == (np.prod(np.ptp(np.argwhere(twin), axis=0) + 1) if twin.any() else 0)


def test_passing_is_what_its_slow_twin_finds() -> None:
    """Where a robot is as seen from an obstacle when it is nearest to it, and that one's velocity."""
    rng = np.random.default_rng(12)
    for _ in range(cases(50, 2000)):
        ends = np.concatenate(([0.0], np.cumsum(rng.uniform(0.5, 2.0, 4))))
        segments = np.column_stack(
            (ends[:-1], ends[1:], rng.uniform(-3, 3, (4, 2)), rng.uniform(-1, 1, (4, 2)), np.ones((4, 2)))
        )
        knots = np.column_stack((np.cumsum(rng.uniform(0.2, 2.0, 5)), rng.uniform(-3, 3, (5, 2))))
        now, until = 0.1, float(rng.uniform(1.0, ends[-1]))
        assert passing(knots, segments, now, until) == pytest.approx(naive.passing(knots, segments, now, until), abs=1e-12)


def test_no_open_state_is_lost_from_a_heap_that_is_full_of_stale_entries() -> None:
    """A state that is reached earlier and earlier fills it; the best open state bounds the cost of all paths."""
    memory, keys = make_memory(4, states=8, heap=32), np.full(8, math.inf)
    rng = np.random.default_rng(3)
    for _ in range(500):
        s, key = int(rng.integers(8)), float(rng.uniform(1.0, 9.0))
        keys[s] = key
        push(memory, key, s)
        assert len(memory.heap_key) >= memory.counter[HEAP_SIZE]
    found: list[int] = []
    while memory.counter[HEAP_SIZE]:
        key, s = memory.heap_key[0], int(memory.heap_state[0])
        found += [s] if key == memory.key[s] else []
        pop(memory)
    assert found == np.argsort(keys).tolist()


def test_a_cycle_plans_keeps_and_gives_up() -> None:
    """A new plan is clear of all that is predicted, commanded exactly, kept while all goes as foreseen, and made anew else."""
    rng, made, kept = np.random.default_rng(13), 0, 0
    for _ in range(cases(12, 500)):
        grid, robot, start, goal, _, pieces = local_problem(rng)
        policy = AntwayPolicy(guard=False)
        policy.reset(Task(grid, robot, grid.centre(start), grid.centre(goal)), 1)
        s, xy = policy.state, grid.centre(start)
        estimates = np.column_stack(
            (pieces[:, 2:6], pieces[:, 6] - robot.radius, np.zeros((len(pieces), 2)), np.arange(len(pieces)))
        )

        def cycle(now: float, xy: tuple[float, float], estimates: np.ndarray, s=s, policy=policy):
            n, tracks = len(estimates), s.crowd.tracks
            tracks.estimates[:n] = tracks.averaged[:n] = estimates
            return crossing.cycle(
                policy.memory(), s.trails, s.context, s.terrain, s.settings, s.plan, s.crowd, n, now, now, xy, s.rng
            )  # fmt: skip

        vx, vy, what = cycle(0.0, xy, estimates)
        arrival, bound = s.plan.state[[crossing.ARRIVAL, crossing.BOUND]].tolist()
        if what == crossing.NONE:
            assert vx == vy == 0.0 and arrival == math.inf
            continue
        made += 1
        n, m = int(s.plan.state[crossing.KNOT_COUNT]), int(s.plan.state[crossing.SEGMENT_COUNT])
        predicted = s.plan.segments[:m].copy()
        knots = s.plan.knots[:n].copy()
        assert what == crossing.NEW and naive.closest(knots, predicted) > -1e-6
        assert math.isfinite(bound) and arrival >= math.dist(xy, grid.centre(goal)) - 1e-9
        after = tuple(float(np.interp(0.1, knots[:, 0], knots[:, k])) for k in (1, 2))
        assert (vx, vy) == pytest.approx(((after[0] - xy[0]) / 0.1, (after[1] - xy[1]) / 0.1), abs=1e-9)
        moved = estimates.copy()
        moved[:, :2] += 0.1 * moved[:, 2:4]
        if not (predicted[:, 1] <= 0.2).any():  # no obstacle is mirrored at a wall so soon
            assert cycle(0.1, after, moved)[2] == crossing.KEPT and (s.plan.knots[:n] == knots).all()
            kept += 1
        assert cycle(0.2, xy, moved)[2] in (crossing.NEW, crossing.NONE), "the robot is not on its plan"
        boxed = np.column_stack((np.array([after]), np.zeros((1, 2)), [1.0], np.zeros((1, 2)), [99.0]))
        assert cycle(0.3, after, boxed)[2] == crossing.NONE and s.plan.state[crossing.ARRIVAL] == math.inf
    assert made > 0 and kept > 0
