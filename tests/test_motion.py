"""Robots with wheels, inertia, latency, footprints move as a twin in steps of a millisecond does, and touch what it does."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from antway import Grid
from antway.kernels.base.geometry import timeline_at
from antway.kernels.base.records import ACKERMANN, DIFFERENTIAL, HOLONOMIC, RobotLimits, RobotState, Trajectories
from antway.kernels.robot import sweep
from antway.kernels.robot.contact import GOES_ON, HIT_MOVING, HIT_STANDING, HIT_WALL, REACHED, Record, advance
from antway.kernels.robot.cycle import play
from antway.kernels.robot.dynamics import drive as in_steps
from antway.kernels.robot.motion import delayed, drive_cycle, drive_roughly
from antway.kernels.robot.sweep import Body, meets_wall, pose, rolling
from antway.world.terrain import terrain_of, walls_of
from antway.world.timeline import Timeline
from common import cases
from naive import motion as twin

DRIVES = (HOLONOMIC, DIFFERENTIAL, ACKERMANN)


def some_limits(
    rng: np.random.Generator, drive: int, latency: float = 0.0, radius: float = 0.3, at_once: bool = False
) -> RobotLimits:
    """Limits of a robot; `at_once`: each rate is infinite now and then."""
    a_max, brake, alpha = *rng.uniform(0.3, 3.0, 2), rng.uniform(1.0, 6.0)
    if at_once:
        a_max, brake, alpha = np.where(rng.random(3) < 0.3, math.inf, (a_max, brake, alpha))
    steering = float(rng.uniform(0.3, 1.0)) if drive == ACKERMANN else 0.0
    reverse = 0.0 if drive == HOLONOMIC else float(rng.choice([0.0, 0.3]))
    return RobotLimits(drive, 1.0, reverse, a_max, brake, 1.9, float(alpha), steering, latency, radius)


def some_state(rng: np.random.Generator, limits: RobotLimits) -> RobotState:
    x, y, theta = *rng.uniform(2.0, 4.0, 2), rng.uniform(-math.pi, math.pi)
    if limits.drive == HOLONOMIC:
        speed, angle = rng.uniform(0.0, 1.0), rng.uniform(0.0, 2 * math.pi)
        return RobotState(x, y, theta, speed * math.cos(angle), speed * math.sin(angle))
    v, w = rng.uniform(-limits.v_reverse, 1.0), rng.uniform(-1.9, 1.9)
    if limits.drive == ACKERMANN:
        w = float(np.clip(w, -abs(v) / limits.turning_radius, abs(v) / limits.turning_radius))
    return RobotState(x, y, theta, float(v), float(w))


def some_command(rng: np.random.Generator) -> tuple[float, float]:
    one, two = rng.uniform(-1.3, 1.3), rng.uniform(-2.5, 2.5)
    return (one, two) if rng.random() > 0.3 else ((0.0, two), (one, 0.0), (0.0, 0.0), (math.nan, 1.0))[rng.integers(4)]


@pytest.mark.parametrize("drive", DRIVES)
def test_a_cycle_ends_where_steps_of_a_millisecond_lead(drive: int) -> None:
    """C44: within 1e-6 m, rad, m/s and rad/s, for commands that reverse, stop, turn and are not finite; roughly within 1e-5."""
    rng = np.random.default_rng(drive)
    steps = twin.holonomic if drive == HOLONOMIC else twin.wheels
    columns = [0, 1, 3, 4] if drive == HOLONOMIC else [0, 1, 2, 3, 4]  # a holonomic robot's twin knows no heading
    for _ in range(cases(100, 30_000)):
        limits = some_limits(rng, drive, at_once=True)
        state, command, dt = some_state(rng, limits), some_command(rng), float(rng.choice([0.05, 0.1, 0.2]))
        end = np.array(drive_cycle(state, *command, limits, dt))
        far = steps(state, command, limits, dt)[-1]
        assert np.abs(end - far)[columns].max() < 1e-6, (limits, state, command, dt)
        rough = np.array(drive_roughly(state, *command, limits, dt))
        assert np.abs(end - rough).max() < (1e-5 if dt <= 0.1 else 1e-3)


@pytest.mark.parametrize("drive", [DIFFERENTIAL, ACKERMANN])
def test_a_cycle_in_two_parts_is_the_cycle(drive: int) -> None:
    """Motion has no memory but its state: driven in two parts of any length it ends at the same place to 1e-9 m."""
    rng = np.random.default_rng(drive)
    for _ in range(cases(2000, 50_000)):
        limits = some_limits(rng, drive, at_once=True)
        state, command, dt, share = some_state(rng, limits), some_command(rng), rng.uniform(0.05, 0.5), rng.random()
        whole = np.array(drive_cycle(state, *command, limits, dt))
        half = drive_cycle(state, *command, limits, dt * share)
        assert np.abs(np.array(drive_cycle(half, *command, limits, dt - dt * share)) - whole).max() < 1e-9


@pytest.mark.parametrize("drive", DRIVES)
def test_a_speed_of_next_to_nothing_is_driven_like_rest(drive: int) -> None:
    """However small the change of a speed is, nothing overflows: velocities that computations leave are often 1e-310 m/s."""
    rng = np.random.default_rng(5)
    for power in range(-324, -200, 3):
        limits = some_limits(rng, drive)
        state, tiny = RobotState(0.0, 0.0, 0.0, 0.0, 0.0), 10.0**power
        for command in ((0.0, 0.0), (tiny, 0.0), (0.0, tiny)):
            moving = state._replace(a=tiny, b=tiny if drive == HOLONOMIC else 0.0)
            assert np.allclose(drive_cycle(moving, *command, limits, 0.1), state, atol=1e-99)


@pytest.mark.parametrize("drive", [DIFFERENTIAL, ACKERMANN])
def test_a_speed_that_becomes_zero_when_a_cycle_ends_does_not_change_its_sign_in_it(drive: int) -> None:
    """Though it then would at once, and the turn rate or its bound becomes 0 there, too, but for a rounding error."""
    limits = RobotLimits(drive, 1.0, 1.0, math.inf, 0.5, 1.9, 0.5, 0.05 if drive == ACKERMANN else 0.0, 0.0, 0.3)
    for dt, cycles, steering in itertools.product((0.01, 0.02, 0.05, 0.1), range(1, 12), (0.0, 0.5)):
        state = RobotState(0.0, 0.0, 0.0, 0.5 * dt * cycles, steering * dt * cycles)
        for _ in range(cycles):
            state = drive_cycle(state, -0.3, 0.0, limits, dt)
        assert abs(state.a) < 1e-12, (dt, cycles, steering)


@pytest.mark.parametrize("drive", DRIVES)
def test_a_command_with_a_number_that_is_not_finite_means_stop(drive: int) -> None:
    """Whichever number it is, on ramps and in steps."""
    limits = some_limits(np.random.default_rng(1), drive)
    state = RobotState(0.0, 0.0, 0.5, 0.5, 0.2)
    for command in ((math.nan, 1.0), (1.0, math.nan), (math.inf, 0.0), (0.0, -math.inf)):
        assert drive_cycle(state, *command, limits, 0.1) == drive_cycle(state, 0.0, 0.0, limits, 0.1)
        assert in_steps(0.5, 0.2, 0.5, *command, limits, 0.1) == in_steps(0.5, 0.2, 0.5, 0.0, 0.0, limits, 0.1)


def test_a_late_command_acts_when_it_arrives() -> None:
    """`delayed` drives the oldest pending command until the next one arrives, for latencies of whole and broken cycles."""
    rng = np.random.default_rng(5)
    for latency in (0.03, 0.1, 0.17, 0.2, 0.25):
        limits = some_limits(rng, DIFFERENTIAL, latency)
        pending = rng.uniform(-1.0, 1.0, (math.ceil(latency / 0.1 - 1e-9), 2))
        state = some_state(rng, limits)
        late = latency - 0.1 * (len(pending) - 1)
        expected = drive_cycle(state, *pending[0], limits, late)
        for command in pending[1:]:
            expected = drive_cycle(expected, *command, limits, 0.1)
        assert np.abs(np.array(delayed(state, pending, limits, 0.1)) - expected).max() < 1e-12


SHAPES = {
    "disc": np.zeros((1, 2)),
    "box": np.array([(-0.2, -0.15), (0.35, -0.15), (0.35, 0.15), (-0.2, 0.15)]),
    "triangle": np.array([(0.4, 0.0), (-0.2, 0.25), (-0.2, -0.25)]),
}


def some_play(rng: np.random.Generator, drive: int, shape: str, latency: float):
    """A cycle close to walls or to moving discs, from a state that touches nothing."""
    corners = SHAPES[shape]
    rounding = 0.3 if shape == "disc" else 0.0
    radius = rounding + float(np.hypot(*corners.T).max())
    limits = some_limits(rng, drive, latency, radius)
    crowded = rng.random() < 0.5
    while True:
        grid = Grid(rng.random((30, 30)) < (0.02 if crowded else 0.1), 0.2)
        x, y, theta, a, b = some_state(rng, limits)
        free = twin.wall_gap(twin.body_at(corners, x, y, theta), grid.blocked, 0.2, 1.0) - rounding
        if 1e-3 < free < (1.0 if crowded else 0.05):
            break
    courses, radii = [], []
    for _ in range(4):
        r, angle, away = rng.uniform(0.1, 0.4), rng.uniform(0.0, 2 * math.pi), rng.uniform(0.0, 0.3) if crowded else 1.0
        px, py = x + (radius + r + away) * math.cos(angle), y + (radius + r + away) * math.sin(angle)
        v = rng.uniform(-1.5, 1.5, (2, 2))
        courses.append((np.array([0.0, 0.04, 0.3]), np.cumsum([(px, py), v[0] * 0.04, v[1] * 0.26], axis=0)))
        radii.append(r)
    discs = Timeline.of(list(range(4)), radii, courses)
    velocity = (a, b) if drive == HOLONOMIC else (a * math.cos(theta), a * math.sin(theta))
    count = math.ceil(latency / 0.1 - 1e-9)
    record = Record(
        np.zeros(count + 2), np.zeros((count + 2, 2)), np.zeros((count + 2, 2)), np.zeros(count + 2), np.zeros(count + 2),
        np.array([some_command(rng) for _ in range(count + 1)]),
    )  # fmt: skip
    record.t[count], record.xy[count], record.velocity[count] = 0.1 * count, (x, y), velocity
    record.heading[count], record.turn_rate[count] = theta, 0.0 if drive == HOLONOMIC else b
    shifted = Trajectories(discs.knot_t + 0.1 * count, discs.knot_xy, discs.first, discs.radius)
    shifted.knot_t.setflags(write=False)  # as those of a world are; else kernels would be compiled once more
    aim = np.array([*rng.uniform(0.0, 6.0, 2), 0.2])
    while math.dist(aim[:2], (x, y)) < 0.201:  # an episode that begins at its goal is over
        aim[:2] = rng.uniform(0.0, 6.0, 2)
    return limits, corners, rounding, radius, grid, (x, y, theta, a, b), shifted, record, aim, count


def sampled(limits: RobotLimits, state, record: Record, count: int) -> np.ndarray:
    """States of the twin every millisecond of the cycle that begins in row `count`."""
    steps = twin.holonomic if limits.drive == HOLONOMIC else twin.wheels
    late = limits.latency - 0.1 * math.floor(limits.latency / 0.1 + 1e-9)
    parts, rows = ([(0, late)] if late > 1e-9 else []) + [(1 if late > 1e-9 else 0, 0.1 - max(late, 0.0))], [np.array([state])]
    for k, span in parts:
        far = steps(tuple(rows[-1][-1]), tuple(record.command[k]), limits, span)
        rows.append(far[1:])
    return np.concatenate(rows)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("drive", DRIVES)
def test_contact_is_where_samples_find_it(drive: int, shape: str) -> None:
    """C44: no sampled contact is missed, a contact told is one, what is told first comes first, and so for the clearance."""
    rng = np.random.default_rng([drive, len(SHAPES[shape])])
    told = dict.fromkeys((GOES_ON, HIT_MOVING, HIT_STANDING, HIT_WALL, REACHED), 0)
    for _ in range(cases(30, 3000)):
        limits, corners, rounding, radius, grid, state, discs, record, aim, count = some_play(
            rng, drive, shape, float(rng.choice([0.0, 0.06, 0.1]))
        )
        body = Body(corners, rounding, radius, np.zeros((1, 2)))
        what, obstacle, clearance = play(count, 0.1, limits, body, record, aim, walls_of(grid), discs, math.inf)
        told[what] += 1
        end = record.t[count + 1] - 0.1 * count
        rows = sampled(limits, state, record, count)
        late = limits.latency % 0.1
        times = np.linspace(0.0, 0.1, len(rows)) if late < 1e-9 or late > 0.1 - 1e-9 else np.concatenate(
            (np.linspace(0.0, late, round(late / 1e-3) + 1), np.linspace(late, 0.1, round((0.1 - late) / 1e-3) + 1)[1:])
        )  # fmt: skip
        within = times <= end + 1e-12
        times, rows = times[within], rows[within]
        here = twin.body_at(corners, *rows[:, :3].T)
        places = np.array([[timeline_at(0.1 * count + s, discs, k)[:2] for k in range(4)] for s in times])
        gaps = twin.hull_gap(here[:, None], places[:, :, None]) - discs.radius - rounding
        wall = twin.wall_gap(here, grid.blocked, 0.2, 0.5) - rounding
        goal = np.hypot(*(rows[:, :2] - aim[:2]).T) - aim[2]
        before = slice(None, -1) if what != GOES_ON else slice(None)
        for gap in (gaps.min(axis=1), wall, goal):
            assert gap[before].min(initial=1.0) > -2e-6, (what, gap.min())
        x, y, theta = *record.xy[count + 1], record.heading[count + 1]
        if shape != "disc" and drive == HOLONOMIC:
            assert theta == state[2]
        here = twin.body_at(corners, x, y, theta)
        if what in (HIT_MOVING, HIT_STANDING):
            place = timeline_at(record.t[count + 1], discs, obstacle)[:2]
            assert abs(twin.hull_gap(here, np.array([place])) - discs.radius[obstacle] - rounding) < 1e-7
        elif what == HIT_WALL:
            assert abs(twin.wall_gap(here, grid.blocked, 0.2, 0.5) - rounding) < 1e-7
        elif what == REACHED:
            assert abs(math.dist((x, y), aim[:2]) - aim[2]) < 1e-7 or end < 1e-9
        assert -5e-3 < clearance - gaps.min() < 5e-6  # the samples are a millisecond apart
    assert sum(told[what] > 0 for what in told) >= 2, told


@pytest.mark.parametrize("ramps", [True, False])
@pytest.mark.parametrize(("away", "told"), [(-1e-9, HIT_STANDING), (1e-6, REACHED)], ids=["contact", "soon"])
def test_of_a_contact_and_the_goal_at_the_same_instant_the_contact_counts(ramps: bool, away: float, told: int) -> None:
    """Also for a robot that is at its goal already: after its last stop an episode may end where it stands."""
    grid, zero = Grid(np.zeros((30, 30), bool), 0.2), np.zeros((2, 2))
    record = Record(np.zeros(2), np.full((2, 2), 3.0), zero.copy(), np.zeros(2), np.zeros(2), np.zeros((1, 2)))
    apart, aim = 0.5 + away, np.array([3.0, 3.0, 0.2])
    discs = Timeline.of([0], [0.2], [(np.array([0.0, 1.0]), np.array([(3.0 + apart, 3.0), (2.0 + apart, 3.0)]))]).trajectories
    limits, body = some_limits(np.random.default_rng(1), HOLONOMIC), Body(np.zeros((1, 2)), 0.3, 0.3, np.zeros((1, 2)))
    if ramps:
        what, obstacle, _ = play(0, 0.1, limits, body, record, aim, walls_of(grid), discs, math.inf)
    else:
        what, obstacle, _ = advance(0, 0.1, limits, aim, record, terrain_of(grid), discs)
    assert (what, obstacle) == (told, 0 if told == HIT_STANDING else -1) and record.t[1] < 1e-9


@pytest.mark.timeout(60)
def test_a_body_that_overlaps_a_wall_gets_out_of_it_without_delay() -> None:
    """It touches where it gets deeper, and where it only gets out, as after a jump of its place, it takes few steps to tell.

    Steps of a nanosecond, each because another corner in the wall got deeper, once took minutes for a control cycle.
    """
    rng, walls, told = np.random.default_rng(4), walls_of(Grid(np.zeros((40, 40), bool), 0.1)), [0, 0]
    corners = np.array([(-0.25, -0.2), (0.25, -0.2), (0.25, 0.2), (-0.25, 0.2)])
    body = Body(corners, 0.0, math.hypot(0.25, 0.2), np.zeros((1, 2)))
    for _ in range(cases(300, 3000)):
        x, theta = rng.uniform(0.1, 0.3), rng.uniform(-math.pi, math.pi)
        speeds = rng.uniform((-1.0, -2.0, -4.0, -4.0), (2.0, 2.0, 4.0, 4.0)).tolist()
        m = rolling(x, 2.0, theta, *speeds, 0.1)
        first = meets_wall(m, 0.1, body, walls)
        times = np.linspace(0.0, 0.1, 201)
        deep = twin.body_at(corners, *np.array([pose(m, s)[:3] for s in times]).T)[:, :, 0].min(axis=1)
        inside = int(deep[0] < 0.0)
        told[inside] += first == math.inf
        until = times < first - 1e-9
        assert deep[until].min(initial=1.0) > min(deep[0], 0.0) - 1e-6
        if first < math.inf:
            x, later = (twin.body_at(corners, *pose(m, s)[:3])[:, 0].min() for s in (first, first + 1e-4))
            assert x < 1e-6 and later < x + 1e-7
    assert min(told) > 10


def some_walls(rng: np.random.Generator) -> Grid:
    """A map with walls of one cell and of many, in rows, at angles and at the edges, or with one room in a solid wall."""
    blocked = np.full((12, 14), rng.random() < 0.2)
    for _ in range(3):
        row, col, high, wide = *rng.integers(0, 12, 2), *rng.integers(1, 8, 2)
        blocked[row : row + high, col : col + wide] = not blocked[0, 0]
    diagonal = np.arange(8)
    blocked[diagonal, diagonal + rng.integers(5)] |= rng.random() < 0.3
    return Grid(blocked, 0.1, (0.5, -0.3, 0.0))


def test_a_wall_is_met_where_the_first_of_its_cells_would_be_met_alone() -> None:
    """Whether the body begins in the open, in contact, in a wall or beyond the edge: no cell that is left out matters."""
    rng, told = np.random.default_rng(3), [0, 0, 0]
    shapes = ([(0.0, 0.0)], [(0.3, 0.1), (-0.1, 0.1), (-0.1, -0.1), (0.3, -0.1)], [(0.02, 0.0), (-0.01, 0.01), (-0.01, -0.01)])
    for _ in range(cases(150, 30_000)):
        walls, corners = walls_of(some_walls(rng)), np.array(shapes[rng.integers(3)])
        rounding = float(rng.choice([0.0, 0.05])) if len(corners) > 1 else 0.15
        body = Body(corners, rounding, rounding + math.dist(corners[0], (0.0, 0.0)), np.zeros((1, 2)))
        x, y = rng.uniform((0.4, -0.4), (2.0, 1.0))
        theta = float(rng.choice([0.0, 0.25 * math.pi, rng.uniform(-4.0, 4.0)]))
        m = rolling(x, y, theta, *rng.uniform((-2.0, -2.0, -4.0, -4.0), (2.0, 2.0, 4.0, 4.0)).tolist(), 0.3)
        alone = [math.inf]
        for cell in np.argwhere(walls.blocked).tolist() or [(0, 0)]:
            blocked = np.zeros_like(walls.blocked)
            blocked[tuple(cell)] = walls.blocked[tuple(cell)]
            alone.append(meets_wall(m, 0.3, body, walls._replace(blocked=blocked)))
        assert meets_wall(m, 0.3, body, walls) == min(alone)
        told[int(min(alone) > 0.0) + int(min(alone) == math.inf)] += 1
    assert min(told) > 10


def test_only_cells_near_the_body_and_at_the_surface_of_walls_are_tested(monkeypatch: pytest.MonkeyPatch) -> None:
    """A car between solid walls, on a map with cells of 2.5 cm, once was tested against thousands of them every 5 cm."""
    blocked, tested = np.ones((120, 200), np.bool_), []
    blocked[45:75] = False
    walls, corners = walls_of(Grid(blocked, 0.025)), np.array([(-0.3, -0.35), (0.9, -0.35), (0.9, 0.35), (-0.3, 0.35)])
    for name in ("meets_wall", "_meets_near"):
        monkeypatch.setattr(sweep, name, getattr(getattr(sweep, name), "py_func", getattr(sweep, name)))
    monkeypatch.setattr(sweep, "_meets_square", lambda *at: (tested.append(at), (math.inf, False))[1])
    m, body = sweep.straight(1.0, 1.5, 0.0, 1.0, 0.0, 0.0, 0.0), Body(corners, 0.0, math.hypot(0.9, 0.35), np.zeros((1, 2)))
    assert sweep.meets_wall(m, 0.049, body, walls) == math.inf
    assert 100 < len(tested) < 120
