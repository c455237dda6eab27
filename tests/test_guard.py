"""The guard alone against policies and obstacles at their worst: no contact while the robot moves (C25), and its slow twin."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from antway import (
    BadParameter,
    Command,
    Decision,
    Grid,
    Observation,
    RobotSpec,
    Task,
    Tracks,
    check_episode,
    load_scenario,
    make_policy,
    run,
)
from antway.kernels.base.geometry import segment_hits_cells, swept_discs
from antway.kernels.base.records import RobotState
from antway.kernels.robot.dynamics import drive
from antway.kernels.robot.guard import BRAKED, FREE, SLOWED, STEPPED_ASIDE, TABLE_COLUMNS, Rules, guarded, within_reach
from antway.kernels.robot.motion import drive_cycle
from antway.kernels.robot.reach import SPEED
from antway.policies.guard import Guard, Guarded, check_observation
from antway.world.terrain import terrain_of
from common import cases
from naive import guard as naive

DT, RADIUS, V_MAX, BOUND = 0.1, 0.3, 1.0, 1.2
SIZE = 0.25
HALL = np.zeros((40, 40), dtype=bool)  # 10 x 10 m
HALL[10:14, 12:28] = HALL[26:28, 4:20] = HALL[20:30, 30:32] = True
STARTS = ((5.0, 5.0), (1.0, 1.0), (8.6, 6.0), (3.0, 7.5))
POLICIES = ("charge", "random", "none", "flee", "steady")
ROBOTS = [(math.inf, "holonomic"), (1.0, "holonomic"), (math.inf, "differential"), (0.7, "differential")]


class Chasers:
    """Discs within assumption A: a bound on speed and its growth, turns at once, and a stop short of a robot that stands."""

    def __init__(self, rng: np.random.Generator, count: int, surge: float, xy: np.ndarray, accel: float = math.inf) -> None:
        self.rng, self.surge, self.accel = rng, surge, accel
        self.radius = rng.uniform(0.15, 0.4, count)
        angle, far = rng.uniform(-math.pi, math.pi, count), rng.uniform(1.0, 4.0, count)
        self.xy = xy + np.column_stack((far * np.cos(angle), far * np.sin(angle)))
        self.velocity = np.zeros((count, 2))
        self.mood, self.until = np.zeros(count, int), np.zeros(count)

    def choose(self, t: float, xy: np.ndarray, velocity: np.ndarray) -> None:
        """Each disc chases, cuts the robot off, wanders or waits, all at what speed it likes."""
        for k in range(len(self.radius)):
            if t >= self.until[k]:
                self.mood[k], self.until[k] = self.rng.integers(4), t + self.rng.uniform(0.3, 4.0)
                self.aim = self.rng.uniform(0.0, 10.0, (len(self.radius), 2))
            lead = self.rng.uniform(0.0, 1.0)
            goal = (xy, xy + velocity * lead, self.aim[k], self.xy[k])[self.mood[k]]
            path = goal - self.xy[k]
            far = math.hypot(*path)
            fastest = min(BOUND, math.hypot(*self.velocity[k]) + self.surge * DT)
            wish = path / far * fastest if far > 1e-9 else np.zeros(2)
            change = math.hypot(*(wish - self.velocity[k]))
            # a jump of half of what the bound allows in a period: its place then keeps to the bound at the period's end
            share = min(1.0, self.accel * DT / 2 / change) if change > 0.0 else 1.0
            self.velocity[k] += (wish - self.velocity[k]) * share


def play(
    seed: int,
    steps: int,
    a_max: float,
    kind: str,
    surge: float,
    stale: float = 0.0,
    accel: float = math.inf,
    names: tuple[int, ...] = (0, 1, 2, 3, 4),
) -> dict[str, int]:
    """Play one robot, policy after policy, against chasers; returns how often what happened."""
    rng = np.random.default_rng(seed)
    robot = RobotSpec(radius=RADIUS, v_max=V_MAX, a_max=a_max, drive=kind, dt=DT, dynamics="steps")
    task = Task(
        Grid(HALL, SIZE), robot, (1.0, 1.0), (9.0, 9.0), obstacle_speed=BOUND, obstacle_surge=surge, obstacle_swerve=accel
    )
    guard = Guard(timeout=0.35)
    announced = {"free": 0, "slowed": 0, "braked": 0, "stepped-aside": 0, "moving": 0}
    for i in range(steps):
        t = i * DT
        if i % 40 == 0:  # in the end they stand round the robot and none can move: begin anew
            guard.reset(task)
            xy, velocity, heading = np.array(STARTS[i // 40 % len(STARTS)]), np.zeros(2), float(rng.uniform(-3, 3))
            discs, seen, stamp = Chasers(rng, 5, surge, xy, accel), Tracks.none(), -math.inf
        policy = POLICIES[(i // 20) % len(POLICIES)]
        discs.choose(t, xy, velocity)
        if rng.random() >= stale:
            stamp = t
            seen = Tracks(np.array(names), discs.xy.copy(), discs.velocity.copy(), discs.radius)
        nearest = discs.xy[int(np.argmin(np.hypot(*(discs.xy - xy).T)))] - xy
        towards = nearest / max(math.hypot(*nearest), 1e-9)
        wanted = {
            "charge": towards * 2.0,
            "flee": -towards,
            "random": rng.normal(size=2) * rng.choice([0.3, 1.0, 5.0]),
            "steady": np.array([math.cos(i // 8), math.sin(i // 8)]),
            "none": np.array([math.nan, 1.0]),
        }[policy]
        command = None if policy == "none" and i % 2 else Command((float(wanted[0]), float(wanted[1])))
        o = Observation(t, tuple(xy.tolist()), tuple(velocity.tolist()), heading, seen, stamp)
        passed = guard.limit(o, command)
        announced[guard.did] += 1
        if policy == "none" or t - stamp > guard.timeout:
            assert passed == Command((0.0, 0.0)) and guard.did == "braked"
        vx, vy, heading = drive(*velocity, heading, *passed.velocity, robot.limits, DT)
        velocity = np.array([vx, vy])
        moving = math.hypot(vx, vy) > 1e-9
        announced["moving"] += moving
        for k, radius in enumerate(discs.radius):
            apart, reach = discs.xy[k] - xy, RADIUS + radius
            hit, _, _ = swept_discs(*apart, *(discs.velocity[k] - velocity), reach, DT)
            if moving:
                assert hit == math.inf, (seed, i, k, policy, guard.did)
            elif hit < math.inf:  # a disc does not drive into a robot that stands
                discs.velocity[k] *= max(hit / DT - 1e-6, 0.0)
        ends = [*((xy[::-1] / SIZE) - 0.5), *(((xy + velocity * DT)[::-1] / SIZE) - 0.5)]
        assert not segment_hits_cells(HALL, *ends, (RADIUS - 1e-9) / SIZE, True)
        xy = xy + velocity * DT
        discs.xy += discs.velocity * DT
    return announced


@pytest.mark.parametrize("surge", [math.inf, 0.5])
@pytest.mark.parametrize(("a_max", "kind"), ROBOTS)
def test_the_robot_never_moves_into_a_contact(a_max: float, kind: str, surge: float) -> None:
    """Whatever is commanded and however obstacles move within the declared bounds, a moving robot touches nothing (C25)."""
    announced = play(1, cases(625, 12_500), a_max, kind, surge)
    assert announced["moving"] > 50 and announced["braked"] > 50 and announced["slowed"] > 0


@pytest.mark.parametrize(("a_max", "kind"), ROBOTS)
def test_the_promise_holds_where_velocities_change_no_faster_than_told(a_max: float, kind: str) -> None:
    """With a bound on changes of velocity the guard lets more pass, and a moving robot still touches nothing."""
    announced = play(3, cases(400, 12_500), a_max, kind, math.inf, accel=2.0)
    assert announced["moving"] > 50


@pytest.mark.parametrize(("a_max", "kind"), ROBOTS)
def test_the_promise_holds_with_lost_scans(a_max: float, kind: str) -> None:
    """With half of the scans lost the promise stands: old tracks count as far as they could have come since."""
    announced = play(2, cases(400, 12_500), a_max, kind, 0.5, stale=0.5)
    assert announced["moving"] > 20


@pytest.mark.parametrize("names", [(7, 7, 7, 7, 7), (2, 7, 7, 2, 3)])
@pytest.mark.parametrize(("a_max", "kind"), ROBOTS)
def test_the_promise_holds_where_tracks_share_numbers(a_max: float, kind: str, names: tuple[int, ...]) -> None:
    """D3: in 60 episodes against chasers that a tracker gives the same numbers, a moving robot touches nothing."""
    announced = play(4, 40 * cases(8, 1000), a_max, kind, math.inf, names=names)
    assert announced["moving"] > 20


@pytest.mark.parametrize(("a_max", "kind"), ROBOTS)
def test_what_passes_is_what_its_slow_twin_passes(a_max: float, kind: str) -> None:
    """A free command passes whole, a slowed one is the fastest of ten that sampling finds free, and none is when it brakes."""
    rng = np.random.default_rng(3)
    robot = RobotSpec(radius=RADIUS, v_max=V_MAX, a_max=a_max, drive=kind)
    limits = V_MAX, a_max, 2.0, kind == "differential"
    did_all = []
    for _ in range(cases(200, 3000)):
        tracks = np.column_stack(
            (
                rng.uniform(4, 6, (2, 2)),
                rng.uniform(-0.7, 0.7, (2, 2)),
                rng.uniform(0.1, 0.3, 2),
                rng.uniform(0, 1.2, 2),
                rng.choice([math.inf, 1.0], 2),
                rng.uniform(0.0, 0.1, 2),
            )
        )
        (px, py), heading, speed = rng.uniform(4, 6, 2), rng.uniform(-3, 3), rng.uniform(0, V_MAX) * (rng.random() < 0.7)
        command = rng.normal(size=2) * rng.choice([0.5, 1.0, 2.0])
        v = (speed * math.cos(heading), speed * math.sin(heading))
        rules = Rules(robot.limits, terrain_of(Grid(HALL, SIZE)), DT, 1.5, True)
        wx, wy, did = guarded(RobotState(px, py, heading, *v), *command, tracks, rules)
        did_all.append(did)
        gaps = naive.gaps_of_fractions(px, py, v, heading, command, tracks, RADIUS, limits, DT, HALL, SIZE)
        near = np.abs(gaps) < 2e-3  # too close to call by sampling
        passed = math.hypot(wx, wy) / min(math.hypot(*command), V_MAX) * 10
        if did in (FREE, SLOWED) and passed > 0:
            k = round(passed)
            assert passed == pytest.approx(k) and (did == FREE) == (k == 10)
            assert gaps[k - 1] > -2e-3 and ((gaps[k:] < 0.0) | near[k:]).all()
        else:
            assert did in (BRAKED, STEPPED_ASIDE) and ((gaps < 0.0) | near).all()
            if did == STEPPED_ASIDE:
                stepped = naive.gaps_of_fractions(px, py, v, heading, (wx, wy), tracks, RADIUS, limits, DT, HALL, SIZE)
                assert stepped[-1] > -2e-3
            else:
                after, _ = naive.driven(v, heading, (wx, wy), limits, DT)
                assert wx == wy == 0.0 or (kind == "differential" and speed == 0.0 and math.hypot(*after) < 1e-9)
    assert {FREE, SLOWED} <= set(did_all) or kind == "differential"


def test_tracks_that_count_are_those_of_its_slow_twin() -> None:
    """Seen tracks, and lost ones while they are held, come out with the radius that covers what they could have moved."""
    rng = np.random.default_rng(4)
    table, count, out, slow = np.zeros((64, TABLE_COLUMNS)), 0, np.empty((64, 8)), naive.Book()
    bounds, told = np.array([BOUND, 0.5, 2.0, 0.0, 0.3]), [BOUND, 0.5, 2.0, 0.0]
    for i in range(cases(200)):
        now, age = i * 0.1, 0.05 * float(rng.integers(3))
        name = np.flatnonzero(rng.random(8) < 0.6)
        xy, velocity = rng.uniform(-5, 5, (len(name), 2)), rng.uniform(-1, 1, (len(name), 2))
        velocity[rng.random(len(name)) < 0.2] = math.nan
        radius, spread = rng.uniform(0.1, 0.4, len(name)), rng.uniform(0, 0.1, len(name)) * (rng.random(len(name)) < 0.5)
        scan = (name, xy, velocity, radius, spread)
        count = within_reach(table, count, now, now - age, 0.5, *scan, bounds, out)
        expected = slow.take(now, now - age, 0.5, name, xy, velocity, radius, spread, told, 0.3)
        rows = out[:count][np.lexsort(out[:count].T)]
        np.testing.assert_allclose(rows, expected[np.lexsort(expected.T)], atol=1e-12)


def test_a_robot_in_the_way_steps_aside() -> None:
    """A robot at rest leaves the course of an obstacle that comes for it, and runs before it where there is no room aside."""
    robot, coming = RobotSpec(a_max=math.inf), np.array([[6.5, 5.0]])
    for corridor in (False, True):
        blocked = np.zeros((40, 40), dtype=bool)
        if corridor:
            blocked[:18], blocked[22:] = True, True
        guard = Guard()
        guard.reset(Task(Grid(blocked, SIZE), robot, (1.0, 5.0), (9.0, 5.0), obstacle_speed=0.8, obstacle_surge=0.2))
        tracks = Tracks(np.array([0]), coming, np.array([[-0.8, 0.0]]), np.array([0.3]))
        passed = guard.limit(Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, tracks), Command((0.0, 0.0)))
        assert guard.did == "stepped-aside"
        assert passed.velocity[0] < -0.9 if corridor else abs(passed.velocity[1]) > 0.3


@pytest.mark.parametrize("a_max", [math.inf, 1.0])
def test_what_has_to_be_finite_is_what_the_robot_follows(a_max: float) -> None:
    """A robot without wheels follows the velocity, whatever twist comes with it."""
    guard = Guard(mode="strict")
    guard.reset(Task(Grid(HALL, SIZE), RobotSpec(a_max=a_max), (1.0, 1.0), (9.0, 9.0)))
    o = Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, Tracks.none())
    stop = guard.limit(o, Command((math.nan, 0.0), twist=(0.1, 0.0)))
    assert guard.did == "braked" and stop.velocity == (0.0, 0.0)
    passed = guard.limit(o, Command((0.5, 0.0), twist=(math.nan, 0.0)))
    assert guard.did == "free" and passed.velocity == (0.5, 0.0)


def test_stale_future_and_reversed_stamps_stop_the_robot() -> None:
    """A scan that is too old, from the future, or older than the last one means stop."""
    guard = Guard()
    guard.reset(Task(Grid(HALL, SIZE), RobotSpec(), (1.0, 1.0), (9.0, 9.0)))

    def did(t: float, stamp: float) -> str:
        guard.limit(Observation(t, (5.0, 5.0), (0.0, 0.0), 0.0, Tracks.none(), stamp), Command((0.5, 0.0)))
        return guard.did

    assert did(1.0, 1.0) == "free" and did(1.5, 1.0) == "free" and did(1.6, 1.0) == "braked"
    assert did(1.56, 1.6) == "free" and did(1.6, 1.7) == "braked" and did(1.7, 1.7) == "free" and did(1.8, 1.2) == "braked"
    assert did(0.5, 0.5) == "braked" and did(2.0, -math.inf) == "braked"


def test_a_robot_is_moved_on_to_a_scan_that_is_a_little_newer() -> None:
    """By its speeds; so a sensor whose clock is a few milliseconds ahead of odometry does not stop it."""
    o = Observation(1.0, (5.0, 5.0), (0.5, -1.0), 0.2, Tracks.none(), 1.02, 0.5)
    moved = check_observation(o)
    assert moved.t == moved.sensed_at == 1.02 and moved.velocity == o.velocity
    assert moved.xy == pytest.approx((5.01, 4.98)) and moved.heading == pytest.approx(0.21)
    for stamp in (0.9, 1.0, 1.06, -math.inf, math.nan):
        assert check_observation(replace(o, stamp=stamp)).t == 1.0


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2])
def test_errors_of_places_count_in_every_direction(angle: float) -> None:
    """A person ahead whose place is uncertain along one line stops the robot, wherever the line and the way lead."""
    guard, way = Guard(), np.array([math.cos(angle), math.sin(angle)])
    guard.reset(Task(Grid(np.zeros((60, 60), bool), 0.2), RobotSpec(), (6.0, 6.0), (11.0, 11.0), obstacle_speed=0.5))
    for variance in (0.0, 0.04):
        covariance = np.zeros((1, 4, 4))
        covariance[0, :2, :2] = variance * np.outer(way, way)
        tracks = Tracks([1], [6.0 + 0.95 * way], [[0, 0]], [0.3], covariance)
        guard.limit(Observation(0.0, (6.0, 6.0), (0.0, 0.0), 0.0, tracks), Command(tuple(way)))
        assert guard.did == ("braked" if variance else "free")


@pytest.mark.parametrize("angle", [0.0, 0.7, math.pi / 2])
@pytest.mark.parametrize("a_max", [math.inf, 2.0])
def test_errors_of_velocities_count_in_mode_strict(angle: float, a_max: float) -> None:
    """An obstacle may be faster than was measured by two standard deviations, also while it is lost, but not than declared."""
    way, seen = np.array([math.cos(angle), math.sin(angle)]), {}
    for mode, sigma, bound in (("strict", 0.1, 2.0), ("strict", 0.1, 0.5), ("strict", 0.0, 2.0), ("least-harm", 0.1, 2.0)):
        guard, covariance = Guard(mode=mode), np.zeros((1, 4, 4))
        covariance[0, 2:, 2:] = sigma**2 * np.outer(way, way)
        task = Task(Grid(HALL, SIZE), RobotSpec(a_max=a_max), (1.0, 1.0), (9.0, 9.0), obstacle_speed=bound, obstacle_surge=0.0)
        guard.reset(task)
        for t in (0.0, 0.1):
            tracks = Tracks([1], [[8.0, 8.0]], [0.4 * way], [0.3], covariance) if t == 0.0 else Tracks.none()
            guard.limit(Observation(t, (1.0, 1.0), (0.0, 0.0), 0.0, tracks), Command((0.1, 0.0)))
            seen[mode, sigma, bound, t] = float(guard.tracks[0, SPEED])
    assert list(seen.values()) == pytest.approx([0.6, 0.6, 0.5, 0.5, 0.4, 0.4, 0.4, 0.4])


@pytest.mark.parametrize("what", ["xy", "velocity", "radius", "lengths", "covariance", "covariances", "own"])
def test_observations_that_make_no_sense_raise(what: str) -> None:
    """NaN, infinite or negative numbers and arrays of unequal length raise `BadParameter`: no command comes out."""
    guard = Guard()
    guard.reset(Task(Grid(HALL, SIZE), RobotSpec(), (1.0, 1.0), (9.0, 9.0)))
    xy, velocity, radius, covariance, own = np.array([[7.0, 7.0]]), np.zeros((1, 2)), np.array([0.3]), None, (5.0, 5.0)
    if what == "xy":
        xy = np.array([[math.nan, 1.0]])
    elif what == "velocity":
        velocity = np.array([[math.inf, 1.0]])
    elif what == "radius":
        radius = np.array([-0.1])
    elif what == "lengths":
        xy = np.zeros((2, 2))
    elif what == "covariance":
        covariance = np.full((1, 4, 4), -1.0)
    elif what == "covariances":
        covariance = np.zeros((2, 4, 4))
    else:
        own = (math.nan, 5.0)
    o = Observation(0.0, own, (0.0, 0.0), 0.0, Tracks(np.array([0]), xy, velocity, radius, covariance))
    with pytest.raises(BadParameter):
        guard.limit(o, Command((1.0, 0.0)))


@pytest.mark.parametrize("a_max", [math.inf, 1.0])
def test_what_is_no_task_observation_or_command_is_refused(a_max: float) -> None:
    """Each was an AttributeError; the guard then goes on as before."""
    guard, task = Guard(), Task(Grid(HALL, SIZE), RobotSpec(a_max=a_max), (1.0, 1.0), (9.0, 9.0))
    guard.reset(task)
    seen = Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, Tracks.none())
    with pytest.raises(BadParameter, match="task"):
        guard.reset(3)  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match="observation"):
        guard.limit(3, None)  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match="command"):
        guard.limit(seen, (1.0, 0.0))  # type: ignore[arg-type]
    assert guard.limit(seen, Command((1.0, 0.0))) == Command((1.0, 0.0))


def test_a_guarded_policy_says_what_the_guard_did() -> None:
    """`Guarded` passes commands through the guard and adds its state to the decision."""

    class Charge:
        def reset(self, task, seed): ...
        def act(self, observation):
            return Command((1.0, 0.0))

        def explain(self):
            return Decision("follow", "onwards")

    policy = Guarded(Charge())
    policy.reset(Task(Grid(HALL, SIZE), RobotSpec(), (1.0, 1.0), (9.0, 9.0)), 0)
    tracks = Tracks(np.array([0]), np.array([[5.75, 5.0]]), np.zeros((1, 2)), np.array([0.3]))
    policy.act(Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, tracks))
    assert policy.explain().guard in ("slowed", "braked")


def test_a_guarded_policy_explains_its_last_decision() -> None:
    """The decision is another object only if the policy's, or what the guard did, is another."""
    decisions = {reason: Decision("follow", reason) for reason in ("one", "two")}

    class Told:
        reason = "one"

        def reset(self, task, seed): ...
        def act(self, observation):
            return Command((0.7, 0.7))

        def explain(self):
            return decisions[self.reason]

    inner = Told()
    policy, free = Guarded(inner), Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, Tracks.none())
    policy.reset(Task(Grid(HALL, SIZE), RobotSpec(), (1.0, 1.0), (9.0, 9.0)), 0)
    near = replace(free, tracks=Tracks([0], [(5.5, 5.5)], [(0.0, 0.0)], [0.3]))
    told = []
    for reason, seen in (("one", free), ("one", free), ("two", free), ("two", near), ("two", near)):
        policy.act(seen)
        inner.reason = reason
        told.append(policy.explain())
    assert [(one.reason, one.guard) for one in told] == [("one", "free")] * 2 + [("two", "free")] + [("two", told[3].guard)] * 2
    assert told[3].guard != "free" and len({id(one) for one in told}) == 3


def test_a_guarded_oracle_knows_the_future():
    """What a policy is told besides its task reaches it through the guard."""
    result = run(load_scenario("paper"), Guarded(make_policy("oracle")), seed=1)
    assert result.reached
    check_episode(result)


def test_a_policy_that_changes_the_observation_does_not_blind_the_guard() -> None:
    """The guard judges the command by what was seen, not by what the policy made of it in place."""

    class Centres:
        def reset(self, task, seed): ...
        def act(self, observation):
            observation.tracks.xy[:] += 100.0
            return Command((1.0, 0.0))

        def explain(self):
            return Decision("follow", "onwards")

    policy = Guarded(Centres())
    policy.reset(Task(Grid(HALL, SIZE), RobotSpec(), (1.0, 1.0), (9.0, 9.0)), 0)
    tracks = Tracks(np.array([0]), np.array([[5.75, 5.0]]), np.zeros((1, 2)), np.array([0.3]))
    policy.act(Observation(0.0, (5.0, 5.0), (0.0, 0.0), 0.0, tracks))
    assert policy.explain().guard in ("slowed", "braked") and tracks.xy.tolist() == [[5.75, 5.0]]


def test_a_policy_that_changes_pending_commands_does_not_blind_the_guard() -> None:
    """The guard foresees where the robot is when a command acts by what was sent, not by what the policy wrote there."""

    class Forgets:
        def reset(self, task, seed): ...
        def act(self, observation):
            observation.pending[:] = 0.0
            return Command((1.0, 0.0))

        def explain(self):
            return Decision("follow", "onwards")

    policy = Guarded(Forgets())
    policy.reset(Task(Grid(HALL, SIZE), RobotSpec(a_max=2.0, latency=0.2), (1.0, 1.0), (9.0, 9.0)), 0)
    sent = np.array([[1.0, 0.0], [0.9, 0.0]])
    policy.act(Observation(0.0, (5.0, 5.0), (1.0, 0.0), 0.0, Tracks.none(), pending=sent))
    assert sent.tolist() == [[1.0, 0.0], [0.9, 0.0]]


@pytest.mark.parametrize("rows", [0, 1, 2])
def test_too_few_pending_commands_are_refused(rows: int) -> None:
    """The guard used to take the robot to be where it is now, for no rows, or where it is a little later."""
    guard = Guard()
    guard.reset(Task(Grid(HALL, SIZE), RobotSpec(a_max=2.0, latency=0.3), (1.0, 1.0), (9.0, 9.0)))
    for given in (rows, 3, 4):
        seen = Observation(0.0, (5.0, 5.0), (1.0, 0.0), 0.0, Tracks.none(), pending=np.tile((1.0, 0.0), (given, 1)))
        if given < 3:
            with pytest.raises(BadParameter, match=r"observation\.pending"):
                guard.limit(seen, Command((1.0, 0.0)))
        else:
            assert guard.dynamic.state_at_action(seen).x == pytest.approx(5.3)


@pytest.mark.parametrize("a_max", [math.inf, 1.0])
def test_many_tracks_far_away_change_nothing(a_max: float) -> None:
    """There is memory for 128 tracks at first."""
    xy = np.random.default_rng(0).random((300, 2)) + 500.0
    for n in (1, 100, 300):
        xy[n - 1] = 5.7, 5.0
        guard = Guard()
        guard.reset(
            Task(Grid(HALL, SIZE), RobotSpec(a_max=a_max), (5.0, 5.0), (9.0, 9.0), obstacle_speed=0.5, obstacle_swerve=2.0)
        )
        passed = []
        for k in range(3):
            tracks = Tracks(np.arange(n), xy[:n], np.tile((-0.4, 0.0), (n, 1)), np.full(n, 0.3))
            passed.append(guard.limit(Observation(0.1 * k, (5.0, 5.0), (0.0, 0.0), 0.0, tracks), Command((1.0, 0.0))))
        if n == 1:
            alone = passed
        assert passed == alone
        xy[n - 1] = 500.0, 500.0
    assert Command((1.0, 0.0)) not in alone


@pytest.mark.parametrize("latency", [0.1, 0.3, 0.5])
def test_another_latency_forgets_no_command_that_does_not_act_yet(latency: float) -> None:
    """The last ones are kept, as many as do not act yet; before them the robot was told to stand."""
    task = Task(Grid(HALL, SIZE), RobotSpec(a_max=1.0, latency=0.3), (5.0, 5.0), (9.0, 9.0))
    guard = Guard()
    guard.reset(task)
    for k in range(5):
        guard.limit(Observation(0.1 * k, (5.0, 5.0), (0.0, 0.0), 0.0, Tracks.none()), Command((0.01 * k, 0.0)))
    guard.set_robot(replace(task, robot=replace(task.robot, latency=latency)))
    assert guard.dynamic is not None
    assert guard.dynamic.sent[:, 0].tolist() == pytest.approx([0.0, 0.0, 0.02, 0.03, 0.04][-round(latency / 0.1) :])


@pytest.mark.parametrize("wrong", [{"timeout": 0.0}, {"timeout": math.nan}, {"hold": -1.0}, {"lookahead": math.inf}])
def test_wrong_settings_raise(wrong: dict[str, float]) -> None:
    """Settings out of range raise `BadParameter`."""
    with pytest.raises(BadParameter):
        Guard(**wrong)


@pytest.mark.parametrize("kind", [int, np.float32, np.int64])
def test_commands_of_other_numbers_are_passed_as_they_are(kind: type) -> None:
    """A whole number of Python or NumPy is a speed like any other; its bits are not those of a float."""
    task = Task(Grid(np.zeros((40, 80), dtype=bool), 0.2), RobotSpec(a_max=1.0), (2.0, 4.0), (12.0, 4.0))
    guard = Guard()
    guard.reset(task)
    command = guard.limit(Observation(0.0, (2.0, 4.0), (0.0, 0.0), 0.0, Tracks.none()), Command((kind(1), kind(0))))
    assert command.velocity == (1.0, 0.0) and guard.did == "free"


@pytest.mark.parametrize(
    ("kind", "mode"), [("holonomic", "strict"), ("differential", "strict"), ("differential", "least-harm")]
)
def test_who_is_seen_without_a_velocity_may_go_anywhere(kind: str, mode: str) -> None:
    """A declared bound on its change says nothing of a velocity that is not known: the obstacle used to count as standing."""
    wheels = {"drive": "differential", "a_max": 1.0, "turn_rate": 2.0, "alpha_max": 4.0} if kind == "differential" else {}
    robot, moved = RobotSpec(radius=RADIUS, v_max=V_MAX, **wheels), 0
    for x in np.arange(0.5, 3.0, 0.25).tolist():
        guard, state = Guard(mode=mode), RobotState(x, 3.0, 0.0, 0.0, 0.0)
        hall = Grid(np.zeros((60, 120), dtype=bool), 0.1)
        guard.reset(Task(hall, robot, (x, 3.0), (11.0, 3.0), obstacle_speed=1.0, obstacle_swerve=0.5))
        for i in range(50):
            y = 0.6 + i * robot.dt  # it walks across at 1 m/s
            tracks = Tracks(np.array([1]), np.array([(4.0, y)]), np.full((1, 2), math.nan), np.array([0.3]))
            seen = Observation(i * robot.dt, (state.x, state.y), (state.a, 0.0), state.theta, tracks, turn_rate=0.0)
            passed = guard.limit(seen, Command((V_MAX, 0.0), twist=(V_MAX, 0.0)))
            state = drive_cycle(state, *passed.acts(seen, robot), robot.limits, robot.dt)
            moves = math.hypot(state.a, state.b) > 1e-3
            moved += moves
            assert not moves or math.dist((state.x, state.y), (4.0, y + robot.dt)) > RADIUS + 0.3 - 1e-6, (x, i)
    assert moved > 50


@pytest.mark.parametrize("a_max", [math.inf, 1.0])
def test_who_was_seen_in_cycles_without_a_command_is_remembered(a_max: float) -> None:
    """He stands before the robot and is hidden when the policy commands again, within `hold`; also if it commanded NaN."""
    one = Tracks(np.array([1]), np.array([(5.72, 3.0)]), np.zeros((1, 2)), np.array([0.3]))
    for before in (Command((0.0, 0.0)), None, Command((math.nan, 0.0))):
        guard = Guard(hold=0.5)
        guard.reset(Task(Grid(np.zeros((60, 80), dtype=bool), 0.1), RobotSpec(radius=0.2, a_max=a_max), (5.0, 3.0), (7.0, 3.0)))
        for i in range(6):
            t, hidden = 0.1 * i, i == 5
            seen = Observation(t, (5.0, 3.0), (0.0, 0.0), 0.0, Tracks.none() if hidden else one)
            passed = guard.limit(seen, Command((0.8, 0.0)) if hidden else before)
            assert guard.last_stamp == t
        assert guard.did != "free" and passed.velocity[0] < 0.5
