"""The guard of robots with wheels, inertia, latency and footprints, against the worst of policies and obstacles (C24, C45)."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from antway import Command, Grid, Observation, RobotSpec, Task, Tracks
from antway.kernels.base.records import RobotState, Trajectories
from antway.kernels.robot.contact import GOES_ON, HIT_MOVING, HIT_STANDING, HIT_WALL, REACHED, Record
from antway.kernels.robot.cycle import play
from antway.kernels.robot.motion import delayed, drive_cycle
from antway.kernels.robot.sweep import Body
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.guard import Guard
from antway.world.terrain import walls_of
from common import cases, costly

DT, BOUND, CYCLES, WHOLE, COUNT = 0.1, 1.2, 60, 200, 5
SIZE, FIRST = 0.25, np.arange(0, 2 * COUNT + 1, 2)  # the first knot of each disc
_HALL = np.zeros((40, 40), dtype=bool)  # 10 x 10 m
_HALL[10:14, 12:28] = _HALL[26:28, 4:20] = _HALL[20:30, 30:32] = True
_CORRIDOR = np.ones((40, 40), dtype=bool)
_CORRIDOR[17:23] = _CORRIDOR[:, 17:23] = False
GOAL = 9.0, 5.0
MAPS = (Grid(_HALL, SIZE), Grid(_CORRIDOR, SIZE))
STARTS = (((5.0, 5.0), (1.2, 1.2), (8.8, 6.0), (3.0, 8.0)), ((5.0, 5.0), (1.5, 5.0), (5.0, 8.5), (7.0, 5.0)))
POLICIES = ("charge", "random", "none", "flee", "steady", "wall")
FOOTPRINTS = (
    ((-0.5, -0.35), (0.5, -0.35), (0.5, 0.35), (-0.5, 0.35)),
    ((-0.2, -0.15), (0.4, -0.15), (0.4, 0.15), (-0.2, 0.15)),
    ((0.45, 0.0), (-0.25, 0.3), (-0.25, -0.3)),
)


def some_robot(rng: np.random.Generator, drive: str, polygon: bool, at_once: bool = False) -> RobotSpec:
    """A robot with inertia, sometimes with latency, slow steering, brakes of its own; `at_once`: infinite rates, too."""
    if at_once:
        robot, (a, brake, alpha) = some_robot(rng, drive, polygon), rng.random(3)
        robot = replace(
            robot, a_max=math.inf if a < 0.6 else robot.a_max, alpha_max=math.inf if alpha < 0.5 else robot.alpha_max
        )
        return replace(robot, brake_max=math.inf if brake < 0.5 else robot.brake_max)
    wheels = drive != "holonomic"
    return RobotSpec(
        radius=0.3,
        v_max=float(rng.choice([0.5, 1.0, 1.5])),
        a_max=float(rng.choice([0.5, 1.0, 2.0])),
        brake_max=float(rng.choice([0.7, 1.0, 2.0])),
        drive=drive,
        dt=DT,
        turn_rate=float(rng.choice([1.0, 1.9, 3.0])),
        alpha_max=float(rng.choice([1.5, 3.0, math.inf])),
        v_reverse=float(rng.choice([0.0, 0.3])) if wheels else 0.0,
        turning_radius=0.5 if drive == "ackermann" else 0.0,
        latency=float(rng.choice([0.0, 0.04, 0.1, 0.23])),
        footprint=FOOTPRINTS[rng.integers(3)] if polygon else None,
        sensor_range=8.0,
    )


class Chasers:
    """Discs within assumption A: a bound on speed and its growth, turns at once, and a stop short of a robot that stands."""

    def __init__(self, rng: np.random.Generator, surge: float, swerve: float, xy: np.ndarray, near: float) -> None:
        self.rng, self.surge, self.swerve = rng, surge, swerve
        self.radius = rng.uniform(0.15, 0.4, COUNT)
        angle, far = rng.uniform(-math.pi, math.pi, COUNT), rng.uniform(near, 4.0, COUNT)
        self.xy = xy + np.column_stack((far * np.cos(angle), far * np.sin(angle)))
        self.velocity = np.zeros((COUNT, 2))
        self.mood, self.until = np.zeros(COUNT, int), np.zeros(COUNT)
        self.aim = rng.uniform(0.0, 10.0, (COUNT, 2))

    def choose(self, t: float, xy: np.ndarray, velocity: np.ndarray) -> None:
        """Each disc chases, cuts the robot off, wanders or waits, all at what speed it likes."""
        for k in range(COUNT):
            if t >= self.until[k]:
                self.mood[k], self.until[k] = self.rng.integers(4), t + self.rng.uniform(0.3, 4.0)
                self.aim[k] = self.rng.uniform(0.0, 10.0, 2)
            lead = self.rng.uniform(0.0, 1.5)
            goal = (xy, xy + velocity * lead, self.aim[k], self.xy[k])[self.mood[k]]
            way = goal - self.xy[k]
            far = math.hypot(*way)
            fastest = min(BOUND, math.hypot(*self.velocity[k]) + self.surge * DT)
            change = (way / far * fastest if far > 1e-9 else 0.0) - self.velocity[k]
            most = self.swerve * DT / max(math.hypot(*change), 1e-9)
            self.velocity[k] += change * (1.0 if most > 1.0 else most)


def wish(rng: np.random.Generator, policy: str, spec: RobotSpec, apart: np.ndarray, theta: float, i: int) -> Command | None:
    """What a policy at its worst commands: at an obstacle, at a wall, at random, nothing, not a number."""
    if policy == "none":
        return None if i % 2 else Command((math.nan, 1.0), (math.nan, 1.0) if spec.wheels else None)
    towards = apart / max(math.hypot(*apart), 1e-9)
    if policy in ("charge", "flee"):
        velocity = towards * 2.0 if policy == "charge" else -towards
        return Command((float(velocity[0]), float(velocity[1])))
    if not spec.wheels:
        angle = i // 8 if policy == "steady" else 1.0 if policy == "wall" else rng.uniform(0.0, 6.3)
        speed = 5.0 if policy == "wall" else rng.choice([0.3, 1.0, 5.0])
        return Command((speed * math.cos(angle), speed * math.sin(angle)))
    if policy == "wall":
        return Command(twist=(5.0, 0.0))
    block = np.random.default_rng(i // 8 if policy == "steady" else i)
    return Command(twist=(float(block.uniform(-0.5, 2.0)), float(block.uniform(-4.0, 4.0))))


def episode(
    seed: int,
    drive: str,
    polygon: bool,
    surge: float,
    stale: float = 0.0,
    swerve: float = math.inf,
    mode: str = "",
    at_once: bool = False,
) -> dict[str, int]:
    """Play one robot of that drive among chasers; returns how often what happened.

    With a `mode` policy antway drives, and its own guard is in that mode; else a guard stands before the worst of policies.
    """
    rng = np.random.default_rng([seed, len(drive), polygon])
    spec, which = some_robot(rng, drive, polygon, at_once), int(rng.integers(2))
    grid = MAPS[which]
    xy, theta = np.array(STARTS[which][rng.integers(4)]), float(rng.uniform(-math.pi, math.pi))
    task = Task(grid, spec, tuple(xy), GOAL, obstacle_speed=BOUND, obstacle_surge=surge, obstacle_swerve=swerve)
    guard, discs = Guard(timeout=0.35), Chasers(rng, surge, swerve, xy, spec.radius + 0.5)
    guard.reset(task)
    antway = AntwayPolicy(mode=mode) if mode else None
    if antway:
        antway.reset(task, seed)
    body, walls = Body(spec.corners, spec.rounding, spec.radius, np.zeros((1, 2))), walls_of(grid)
    n = WHOLE if mode else CYCLES
    record = Record(
        np.zeros(n + 1), np.zeros((n + 1, 2)), np.zeros((n + 1, 2)), np.zeros(n + 1), np.zeros(n + 1), np.zeros((n, 2))
    )
    record.xy[0], record.heading[0] = xy, theta
    late = math.ceil(spec.latency / DT - 1e-9)
    count = {"free": 0, "slowed": 0, "braked": 0, "stepped-aside": 0, "least-harm": 0, "moving": 0, "contacts": 0, "arrived": 0}
    seen, stamp = Tracks.none(), -math.inf
    aim, policy = np.array([*GOAL, 0.1] if mode else [100.0, 100.0, 0.1]), POLICIES[seed % len(POLICIES)]
    for i in range(n):
        t, xy, velocity, theta = i * DT, record.xy[i], record.velocity[i], float(record.heading[i])
        if i % 20 == 0:
            policy = POLICIES[rng.integers(len(POLICIES))]
        discs.choose(t, xy, velocity)
        if rng.random() >= stale:
            stamp = t
            seen = Tracks(np.arange(COUNT), discs.xy.copy(), discs.velocity.copy(), discs.radius)
        pending = np.zeros((late, 2))
        if late:
            pending[late - min(late, i) :] = record.command[max(i - late, 0) : i]
        o = Observation(t, tuple(xy), tuple(velocity), theta, seen, stamp, float(record.turn_rate[i]), pending)
        if antway:
            passed = antway.act(o)
            count[antway.guard.did] += 1
        else:
            nearest = discs.xy[int(np.argmin(np.hypot(*(discs.xy - xy).T)))] - xy
            passed = guard.limit(o, wish(rng, policy, spec, nearest, theta, i))
            count[guard.did] += 1
        record.command[i] = passed.acts(o, spec)
        times = np.array((t, t + DT) * COUNT)
        for _ in range(50):
            knots = np.concatenate((discs.xy, discs.xy + discs.velocity * DT), axis=1).reshape(-1, 2)
            line = Trajectories(times, knots, FIRST, discs.radius)
            for part in line:
                part.setflags(write=False)  # as those of a world are; else the kernel would be compiled once more
            what, obstacle, _ = play(i, DT, spec.limits, body, record, aim, walls, line, math.inf)
            if what != HIT_STANDING:
                break
            # It does not drive into a robot that stands: it stops short of it, from the begin of the cycle on.
            share = (record.t[i + 1] - t) / DT
            discs.velocity[obstacle] *= max(share - 1e-6, 0.0) if share > 1e-5 else 0.0
        if what == HIT_STANDING:
            break  # a disc stood where the robot has come to stand: no contact in motion
        if mode == "least-harm" and what == HIT_MOVING:
            count["contacts"] += 1
            break  # only walls are certain there
        assert what not in (HIT_MOVING, HIT_WALL), (what, seed, drive, polygon, i, mode, policy, guard.did, spec)
        if what == REACHED:
            count["arrived"] += 1
            break
        assert what == GOES_ON
        count["moving"] += math.hypot(*record.velocity[i + 1]) > 1e-9
        discs.xy += discs.velocity * DT
    return count


def total(seeds: range, drive: str, polygon: bool, surge: float, **options: Any) -> dict[str, int]:
    """Sum over episodes."""
    counts = [episode(seed, drive, polygon, surge, **options) for seed in seeds]
    return {key: sum(c[key] for c in counts) for key in counts[0]}


@pytest.mark.parametrize("surge", [math.inf, 0.5])
@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_a_robot_with_inertia_never_moves_into_a_contact(drive: str, surge: float) -> None:
    """C24, C45: whatever is commanded and however obstacles move within their bounds, 0 contacts in motion and 0 with walls."""
    n = total(range(cases(50, 5000)), drive, False, surge)
    assert n["moving"] > 20 and n["braked"] > 20 and n["slowed"] > 0 and n["free"] > 10, n


@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_a_robot_with_a_footprint_never_moves_into_a_contact(drive: str) -> None:
    """C24, C45: and so for polygons, whose corners sweep out when they turn."""
    n = total(range(cases(30, 1700)), drive, True, 0.5)
    assert n["moving"] > 10 and n["braked"] > 10 and n["free"] > 5, n


@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_the_promise_holds_with_lost_scans_and_inertia(drive: str) -> None:
    """With half of the scans lost the promise stands: old tracks count as far as they could have come since."""
    n = total(range(10_000, 10_000 + costly(30, 1000)), drive, False, 0.5, stale=0.5)
    assert n["moving"] > 5, n


@pytest.mark.parametrize("swerve", [0.3, 2.2])
@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_the_promise_holds_where_obstacles_swerve_no_faster_than_declared(drive: str, swerve: float) -> None:
    """C24, C45: with a declared bound on changes of velocity the guard lets more pass, and still nothing ends in a contact."""
    seeds = range(20_000, 20_000 + costly(30, 3000))
    bounded = total(seeds, drive, False, math.inf, swerve=swerve)
    assert bounded["moving"] > 20 and bounded["braked"] + bounded["slowed"] > 5, bounded


@pytest.mark.parametrize("mode", ["strict", "least-harm"])
@pytest.mark.parametrize("drive", ["differential", "ackermann"])
def test_policy_antway_on_wheels_never_moves_into_a_contact(drive: str, mode: str) -> None:
    """C45: what it drives among chasers by itself, 20 s at most: no contact in motion where it is strict, and never a wall."""
    seeds = range(30_000, 30_000 + costly(6, 1000))
    n = total(seeds, drive, False, 0.5, mode=mode)
    calm = total(seeds, drive, False, 0.5, swerve=1.0, mode=mode)
    assert n["moving"] > 10 and calm["moving"] > 10, (n, calm)
    assert mode == "least-harm" or (n["slowed"] > 0 and n["contacts"] == 0), n


@pytest.mark.parametrize("polygon", [False, True])
@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_a_robot_whose_rates_are_infinite_never_moves_into_a_contact(drive: str, polygon: bool) -> None:
    """C24, C45: and so where speeds change at once, or where they only fall in time, at the very end of a cycle too."""
    n = total(range(50_000, 50_000 + cases(66, 1500)), drive, polygon, math.inf, at_once=True)
    assert n["moving"] > 20 and n["braked"] > 20, n


@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_a_strict_guard_goes_by_what_is_measured_where_velocities_lie(drive: str) -> None:
    """C24: discs that press on a robot that stands tell a velocity all the same: no estimate leads them through it."""
    n = total(range(60_000, 60_000 + costly(12, 300)), drive, False, math.inf, mode="strict")
    assert n["moving"] > 10 and n["contacts"] == 0, n


@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
def test_the_guard_starts_from_the_state_after_the_pending_commands(drive: str) -> None:
    """It is that of `delayed`, from the velocity along the heading for wheels; without wheels a footprint keeps its heading."""
    rng = np.random.default_rng(7)
    for i in range(cases(100, 5000)):
        spec = some_robot(rng, drive, i % 2 == 0)
        theta, speed, turn = rng.uniform(-3.0, 3.0), rng.uniform(0.0, spec.v_max), rng.uniform(-0.5, 0.5)
        vx, vy = speed * math.cos(theta), speed * math.sin(theta)
        pending = rng.uniform(-1.0, 1.0, (math.ceil(spec.latency / DT - 1e-9), 2))
        guard = Guard()
        guard.reset(Task(Grid(np.zeros((10, 10), np.bool_)), spec, (5.0, 5.0), (5.0, 5.0)))
        assert guard.dynamic is not None
        seen = Observation(0.0, (5.0, 5.0), (vx, vy), theta, Tracks.none(), turn_rate=turn, pending=pending)
        state = np.array(guard.dynamic.state_at_action(seen))
        own = (vx, vy) if drive == "holonomic" else (speed, turn)
        expected = np.array(delayed(RobotState(5.0, 5.0, theta, *own), pending, spec.limits, DT))
        if drive == "holonomic" and spec.footprint is not None:
            assert state[2] == theta
            expected[2] = theta
        assert np.abs(state - expected).max() < 1e-12


def test_the_certified_stop_outlives_what_is_learnt_of_the_robot() -> None:
    """A robot in a bend along a wall can stop only by turning on, also if its latency and brakes have just been learnt."""
    blocked = np.zeros((40, 40), dtype=bool)
    blocked[:, 22:] = True
    robot = RobotSpec(drive="differential", a_max=1.0, turn_rate=2.0, latency=0.1, dt=DT)
    task = Task(Grid(blocked, SIZE), robot, (2.0, 2.0), (2.0, 8.0))
    guard = Guard()
    guard.reset(task)
    seen = Observation(0.0, (5.0, 4.0), (math.cos(1.07), math.sin(1.07)), 1.07, Tracks.none(), turn_rate=1.0)
    guard.limit(seen, Command(twist=(1.0, 2.0)))
    kept, sent = guard.dynamic.keep.tolist(), guard.dynamic.sent.tolist()
    assert kept[2] > 0.0
    guard.set_robot(replace(task, robot=replace(robot, latency=0.2, brake_max=0.8)))
    assert guard.dynamic.keep.tolist() == kept and guard.dynamic.sent.tolist() == [[0.0, 0.0], *sent]


@pytest.mark.parametrize("along", [0, 1])
def test_without_wheels_a_stop_bends_along_a_wall(along: int) -> None:
    """A robot that nears a wall at a small angle drives on: it can brake across the wall first; straight braking would touch.

    Such commands used to be refused, so that robots slowed down before whoever they were about to pass.
    """
    robot = RobotSpec(a_max=1.0, dt=DT)
    blocked = np.zeros((40, 40), dtype=bool)
    blocked.T[22:] = True
    grid = Grid(blocked if along else blocked.T, SIZE)
    xy, velocity = ((5.0, 5.07), (0.95, 0.25)) if along == 0 else ((5.07, 5.0), (0.25, 0.95))
    guard = Guard()
    guard.reset(Task(grid, robot, (2.0, 2.0), (2.0, 3.0)))
    command = guard.limit(Observation(0.0, xy, velocity, 0.0, Tracks.none()), Command(velocity))
    assert guard.did == "free" and command.velocity == velocity
    straight = 0.5 * math.hypot(*velocity) * velocity[1 - along]  # m; how far straight braking leads towards the wall
    assert xy[1 - along] + velocity[1 - along] * DT + straight > 5.5 - robot.radius
    state = RobotState(*xy, 0.0, *velocity)
    for i in range(30):
        state = drive_cycle(state, *command.velocity, robot.limits, DT)
        assert max(state.x, state.y) < 10.0 and state[1 - along] < 5.5 - robot.radius - 0.005
        command = guard.limit(Observation(DT * (i + 1), (state.x, state.y), (state.a, state.b), 0.0, Tracks.none()), None)
    assert math.hypot(state.a, state.b) == 0.0


@pytest.mark.parametrize(("x", "did"), [(6.5, "braked"), (9.0, "braked"), (10.0, "free")])
def test_a_robot_faster_than_its_top_speed_brakes_for_what_it_comes_near_to(x: float, did: str) -> None:
    """At 2 m/s, for instance because a slower top speed was learnt, it stops after 4.2 m; 0.5 m/s would be less."""
    robot = RobotSpec(radius=0.3, v_max=0.5, a_max=0.5, dt=DT)
    guard, stands = Guard(), Tracks([1], [[x, 5.0]], [[0.0, 0.0]], [0.3])
    guard.reset(Task(Grid(np.zeros((80, 80), bool), SIZE), robot, (5.0, 5.0), (15.0, 5.0), obstacle_speed=0.0))
    guard.limit(Observation(0.0, (5.0, 5.0), (2.0, 0.0), 0.0, stands), Command((0.5, 0.0)))
    assert guard.did == did


@pytest.mark.parametrize(("drive", "dynamics"), [("differential", "ramps"), ("differential", "steps"), ("holonomic", "ramps")])
def test_obstacles_may_speed_up_for_as_long_as_a_robot_faster_than_its_top_speed_brakes(drive: str, dynamics: str) -> None:
    """At 2 m/s downhill it stops after 4.2 m and 4.1 s, in which an obstacle that stands comes up to 4.2 m nearer."""
    robot = RobotSpec(radius=0.3, v_max=0.5, a_max=0.5, dt=DT, drive=drive, dynamics=dynamics)
    task = Task(Grid(np.zeros((80, 160), bool), SIZE), robot, (5.0, 5.0), (35.0, 5.0), obstacle_speed=2.0, obstacle_surge=0.5)
    for x, free in ((13.0, False), (20.0, True)):
        guard, stands = Guard(), Tracks([1], [[x, 5.0]], [[0.0, 0.0]], [0.3])
        guard.reset(task)
        guard.limit(Observation(0.0, (5.0, 5.0), (2.0, 0.0), 0.0, stands), Command((0.5, 0.0)))
        assert (guard.did == "free") == free
