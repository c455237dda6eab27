"""The certificate of a stop against steps of a millisecond: what is certified keeps clear, and nothing else is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

from antway import Grid, RobotSpec
from antway.kernels.base.records import RobotState
from antway.kernels.robot.brake import CYCLES, SIDE, Robot, Situation, certified, stop_for
from antway.kernels.robot.guard import BRAKED, FREE, SLOWED, STEPPED_ASIDE
from antway.kernels.robot.motion import drive_cycle
from antway.kernels.robot.passing import passed_command
from antway.kernels.robot.reach import SPEED
from antway.kernels.robot.sweep import Body
from antway.world.terrain import walls_of
from common import cases, costly
from naive import motion as naive

DT, MARGIN, SIZE, NEARLY = 0.1, 0.02, 0.25, 3e-3
BLOCKED = np.zeros((24, 24), dtype=bool)  # 6 x 6 m
BLOCKED[10:12, 14:16] = BLOCKED[4:6, 3:9] = True
WALLS = walls_of(Grid(BLOCKED, SIZE))
OPEN = walls_of(Grid(np.zeros((60, 60), dtype=bool), SIZE))
FOOTPRINT = ((0.45, 0.0), (-0.25, 0.3), (-0.25, -0.3))
DRIVES = ("holonomic", "differential", "ackermann")


def some(rng: np.random.Generator, drive: str, polygon: bool, obstacles: int) -> tuple[Robot, RobotState, np.ndarray]:
    """A robot that stands or drives somewhere, and rows of obstacles around it."""
    wheels = drive != "holonomic"
    spec = RobotSpec(
        radius=0.3,
        v_max=float(rng.choice([0.7, 1.5])),
        a_max=float(rng.choice([0.7, 2.0, math.inf])),
        brake_max=float(rng.choice([0.8, 2.0])),
        drive=drive,
        dt=DT,
        turn_rate=float(rng.choice([1.0, 2.5])),
        alpha_max=float(rng.choice([1.5, 4.0])),
        v_reverse=0.4 if wheels else 0.0,
        turning_radius=0.5 if drive == "ackermann" else 0.0,
        latency=float(rng.choice([0.0, 0.07])),
        footprint=FOOTPRINT if polygon else None,
    )
    body = Body(spec.corners, spec.rounding, spec.radius, np.zeros((1, 2)))
    robot = Robot(spec.limits, body, WALLS, DT, MARGIN, True, np.empty((8, 8)), np.array([0.0, 0.0, 0.0, -1.0]))
    x, y, theta = *rng.uniform(0.8, 5.2, 2), rng.uniform(-3.0, 3.0)
    angle, speed = rng.uniform(-3.0, 3.0), rng.uniform(0.0, spec.v_max)
    a, b = speed * math.cos(angle), speed * math.sin(angle)
    if wheels:
        a = rng.uniform(-spec.v_reverse, spec.v_max)
        b = rng.uniform(-1.0, 1.0) * (abs(a) / 0.5 if drive == "ackermann" else 1.0) * min(spec.turn_rate, 1.0)
    if rng.random() < 0.3:
        a = b = 0.0
    n = obstacles
    angle, far = rng.uniform(-3.0, 3.0, n), rng.uniform(0.6, 1.6, n)
    later = rng.random(n) < 0.2  # as after a wall, from which an obstacle may bounce in any direction: none is there before
    far[later] -= 0.5
    xy = np.array([x, y]) + far[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    velocity, radius, speed = rng.uniform(-0.5, 0.5, (n, 2)), rng.uniform(0.1, 0.3, n), rng.uniform(0.0, 1.0, n)
    accel, age = rng.choice([math.inf, 0.5, 2.0], n), rng.choice([0.0, 0.1, 1.0], n)
    age[later], accel[later] = -rng.uniform(0.1, 1.0, later.sum()), math.inf
    return robot, RobotState(x, y, theta, a, b), np.column_stack((xy, velocity, radius, speed, accel, age))


def command(rng: np.random.Generator, robot: Robot) -> tuple[float, float]:
    """A command within the robot's limits, now and then to stand."""
    if rng.random() < 0.1:
        return 0.0, 0.0
    most = robot.limits.turn_rate if robot.limits.drive else robot.limits.v_max / 2
    return float(rng.uniform(-0.4, 0.85 * robot.limits.v_max)), float(rng.uniform(-most, most))


def start_gap(robot: Robot, state: RobotState) -> float:
    """The gap between the robot, where it is, and walls."""
    corners = naive.body_at(robot.body.corners, *np.array(state[:3])[:, None])
    return float(naive.wall_gap(corners, BLOCKED, SIZE, 0.5)[0]) - robot.body.rounding


def least_gaps(robot: Robot, state: RobotState, commands: list[tuple[float, float]], rows: np.ndarray) -> tuple[float, float]:
    """The least gaps to walls and to where obstacles can be, until the robot stands after the commands and a stop."""
    limits, body, steps, rest = robot.limits, robot.body, [], 0
    drive, at = naive.wheels if limits.drive else naive.holonomic, tuple(state)
    turns = limits.drive > 0 and len(body.corners) > 1
    while rest < len(commands) or (abs(at[3]) + abs(at[4]) * turns if limits.drive else math.hypot(*at[3:])) > 1e-9:
        one = commands[rest] if rest < len(commands) else (0.0, 0.0)
        steps.append(drive(at, one, limits, DT)[rest > 0 :])
        at, rest = tuple(steps[-1][-1]), rest + 1
    path = np.concatenate(steps)
    t = limits.latency + np.arange(len(path)) * naive.MS
    moves = np.hypot(path[:, 3], path[:, 4]) if not limits.drive else np.abs(path[:, 3]) + np.abs(path[:, 4]) * turns
    keep = moves > 1e-6
    corners = naive.body_at(body.corners, *path[keep, :3].T)
    if not len(corners):
        return math.inf, math.inf
    wall = float(naive.wall_gap(corners, BLOCKED, SIZE, 0.5).min()) - body.rounding
    least = math.inf
    for x, y, vx, vy, r, speed, accel, age in rows:
        later = t[keep] + age
        gap = naive.hull_gap(corners, np.array([[x, y]])) - speed * later
        if accel < math.inf:
            centre = np.column_stack((x + vx * later, y + vy * later))[:, None]
            gap = np.maximum(gap, naive.hull_gap(corners, centre) - accel * later**2 / 2)
        least = min(least, float(gap[later >= 0.0].min(initial=math.inf)) - r - body.rounding)
    return wall, least


@pytest.mark.parametrize("polygon", [False, True])
@pytest.mark.parametrize("drive", DRIVES)
def test_what_is_certified_is_what_steps_of_a_millisecond_find_clear(drive: str, polygon: bool) -> None:
    """One command, a bend of some cycles and braking: the verdict is that of the samples, but for what is too close to call."""
    rng, said = np.random.default_rng([5, len(drive), polygon]), []
    for i in range(costly(120, 3000)):
        robot, state, rows = some(rng, drive, polygon, 1 + i % 2)
        if start_gap(robot, state) < MARGIN + 1e-6:
            continue  # it is in a wall, out of which it may drive
        (ca, cb), cycles = command(rng, robot), int(rng.integers(3))
        bend = (
            (0.0, float(rng.uniform(-1.0, 1.0)))
            if robot.limits.drive
            else (drive_cycle(state, ca, cb, robot.limits, DT).a, 0.0)
        )
        wall, least = least_gaps(robot, state, [(ca, cb), *[bend] * cycles], rows)
        clear = certified(Situation(state, robot, MARGIN, rows), ca, cb, *bend, cycles)
        if abs(wall - MARGIN) > NEARLY and abs(least) > NEARLY:
            said.append(clear)
            assert clear == (wall > MARGIN and least > 0.0), (i, wall, least)
    assert 0.2 < np.mean(said) < 0.95


def stop_of(situation: Situation, one: tuple[float, float]) -> tuple[float, float, int] | None:
    """The first stop that is certified: straight, or after a bend in which wheels turn or one axis keeps its speed."""
    limits = situation.robot.limits
    *_, a, b = drive_cycle(situation.state, *one, limits, DT)
    bends = [(0.0, turn, abs(a)) for turn in (b, limits.turn_rate, -limits.turn_rate) if abs(turn) > 0.01 and abs(a) > 1e-9]
    if not limits.drive:
        bends = sorted([(a, 0.0, abs(b)), (0.0, b, abs(a))], key=lambda bend: bend[2]) if min(abs(a), abs(b)) > 0.01 else []
    stops = [(0.0, 0.0, 0), *((*bend, math.ceil(lost / limits.brake_max / DT - 1e-9)) for *bend, lost in bends)]
    return next((stop for stop in stops if certified(situation, *one, *stop)), None)


def slower(robot: Robot, ca: float, cb: float) -> list[tuple[float, float]]:
    """The slower commands in the order in which they are tried. Wheels keep the turn rate, or else the arc, or only turn."""
    shares = [0.8, 0.6, 0.4, 0.2]
    if not robot.limits.drive:
        return [(ca * share, cb * share) for share in shares]
    turn = [] if robot.limits.turning_radius else [(0.0, cb)]
    return [one for share in shares for one in ((ca * share, cb), (ca * share, cb * share))] + turn


@pytest.mark.parametrize("polygon", [False, True])
@pytest.mark.parametrize("drive", DRIVES)
def test_the_fastest_command_passes_that_is_certified_among_all_obstacles(drive: str, polygon: bool) -> None:
    """Obstacles that are left out as too far away make no difference, and the stop that is kept is the first one found."""
    rng, seen = np.random.default_rng([6, len(drive), polygon]), set()
    bent = 0  # how often the stop that is kept has a bend
    for i in range(cases(300, 5000)):
        robot, state, rows = some(rng, drive, polygon, 1 + i % 3)
        robot = robot._replace(margin=0.0)
        if start_gap(robot, state) < 1e-6:
            continue
        if i % 2:  # fast ones from far away
            rows[:, :2], rows[:, SPEED] = state[:2] + 2.0 * (rows[:, :2] - state[:2]), 3.0 * rows[:, SPEED]
        ca, cb = command(rng, robot)
        if i % 4 == 0:  # it drives along an edge of the map, and a little towards it
            speed, off, side, rows = 0.9 * robot.limits.v_max, rng.uniform(0.05, 0.3), 1 - i // 4 % 2 * 2, rows[:0]
            ca, cb = (speed, 0.0) if robot.limits.drive else (speed, speed * off * side)
            y = 3.0 + side * (3.0 - robot.body.radius - rng.uniform(0.03, 0.2))
            state = RobotState(2.7, y, off * side, ca, cb)
        situation, before = Situation(state, robot, 0.0, rows), [0.3, 0.1, 2.0, -1.0]
        asked = [
            (ca, cb),
            *(slower(robot, ca, cb) if (abs(ca) if robot.limits.drive else math.hypot(ca, cb)) else [(0.0, 0.0)]),
        ]
        found = [(one, stop) for one in asked if (stop := stop_of(situation, one))]
        rest = stop_of(situation, (0.0, 0.0))
        robot.keep[:] = before
        *passed, did = passed_command(state, ca, cb, rows, robot, -1.0)
        bent += bool(found) and robot.keep[CYCLES] > 0.0
        if found:
            assert tuple(passed) == pytest.approx(found[0][0]) and robot.keep[:3] == pytest.approx(found[0][1]), i
            assert did == (FREE if passed == pytest.approx((ca, cb)) else SLOWED), i
        elif rest:
            assert (did, *passed) == (BRAKED, 0.0, 0.0) and robot.keep[:3] == pytest.approx(rest), i
        else:  # the next command of the stop kept before
            assert (did, *passed) == (BRAKED, 0.3, 0.1) and robot.keep.tolist() == [0.3, 0.1, 1.0, -1.0], i
        seen.add(did if found or rest else None)
    assert {FREE, SLOWED, None} <= seen and bent > 1


def first_contact(robot: Robot, state: RobotState, one: tuple[float, float], rows: np.ndarray, until: float) -> float:
    """When a robot is first touched, at the end of a cycle, that drives under a command until `until` s and stops; else 3 s."""
    at, t = state, robot.limits.latency
    while t < 3.0:
        at, t = drive_cycle(at, *(one if t <= until else (0.0, 0.0)), robot.limits, DT), t + DT
        away = np.hypot(*(rows[:, :2] + rows[:, 2:4] * (t + rows[:, 7:]) - at[:2]).T)
        if (away < robot.body.radius + rows[:, 4]).any():
            return t
    return 3.0


@pytest.mark.parametrize("polygon", [False, True])
@pytest.mark.parametrize("drive", DRIVES)
def test_a_robot_in_the_way_steps_aside_to_where_it_is_touched_last(drive: str, polygon: bool) -> None:
    """Somebody comes for a robot at rest. Of the commands that are certified it takes the one with the latest contact."""
    rng, stepped = np.random.default_rng([7, len(drive), polygon]), 0
    for i in range(cases(40, 600)):
        robot, state, rows = some(rng, drive, polygon, 1)
        robot, limits = robot._replace(walls=OPEN), robot.limits
        state = state._replace(x=7.5, y=7.5, a=0.0, b=0.0)
        angle = rng.uniform(-3.0, 3.0)
        rows[:, :4] = *(state.x + 1.9 * math.cos(angle), state.y + 1.9 * math.sin(angle)), -math.cos(angle), -math.sin(angle)
        rows[:, 5:7] = 1.0, 0.5
        situation = Situation(state, robot, MARGIN, rows)
        sides = [(limits.v_max * math.cos(k * math.pi / 8), limits.v_max * math.sin(k * math.pi / 8)) for k in range(16)]
        if limits.drive:
            speeds, turns = (limits.v_max, 0.4 * limits.v_max, -limits.v_reverse), np.linspace(-1.0, 1.0, 5) * limits.turn_rate
            sides = [(speed, float(turn)) for speed in speeds for turn in turns]
        worth = [first_contact(robot, state, one, rows, 0.9) if stop_for(situation, *one) else 0.0 for one in sides]
        still = (1.9 - robot.body.radius - rows[0, 4]) - rows[0, 7]
        robot.keep[SIDE] = -1.0
        *passed, did = passed_command(state, 0.0, 0.0, rows, robot, 1.5)
        if still <= 1.5 - 1e-6 and max(worth) > still + 2.0 * DT:
            taken = next(k for k, one in enumerate(sides) if passed == pytest.approx(one))
            assert did == STEPPED_ASIDE and worth[taken] >= max(worth) - DT - 1e-9, i
            assert robot.keep[SIDE] == taken
            stepped += 1
        elif still > 1.5 + 1e-6 or max(worth) < still:
            assert did in (FREE, BRAKED) and passed == [0.0, 0.0], i
    assert stepped > 2
