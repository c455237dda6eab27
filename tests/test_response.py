"""Policy antway learns how the robot answers commands where it is slower than declared."""

from __future__ import annotations

import math
import sys
from dataclasses import replace
from itertools import pairwise, product
from pathlib import Path

import numpy as np
import pytest

from antway import Command, Grid, Observation, RobotSpec, Scenario, Task, Tracks, World, check_episode, make_policy, run
from antway.arena.suites import SuiteEpisode, build
from antway.errors import BadParameter
from antway.kernels.base.records import HOLONOMIC, RobotState
from antway.kernels.robot.motion import drive_cycle
from antway.kernels.robot.odometry import COMPARED, HEADING, LAST_X, ODOMETRY, A, B, T, X, Y, compare_speeds
from antway.kernels.robot.response import ERROR_X, GROWS, LED, PLACE, SLOWS, TURNS, WEIGHT, Period, answered, learn, learn_place
from antway.policies.antway.policy import AntwayPolicy
from antway.policies.antway.response import Response
from antway.policies.guard import Guarded
from antway.tables import ROBOTS
from antway.world.motions import Line
from antway.world.robots import load_robot
from antway.world.world import Obstacle
from common import cases, costly
from naive import motion as twin
from test_motion import DRIVES, some_command, some_limits, some_state

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "benchmarks"))
from response import CHANGES, Change, Misled, play

DIFF = load_robot("diff")
NOBODY = Tracks.none()
REST = RobotState(0.0, 0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("drive", DRIVES)
def test_speeds_are_predicted_as_steps_of_a_millisecond_predict_them(drive: int) -> None:
    """For commands at each 0.1 s that act up to 0.4 s later, some before the time looked at and some within it."""
    rng = np.random.default_rng(drive)
    for _ in range(cases(40, 2000)):
        limits = some_limits(rng, drive, latency=0.05 * float(rng.integers(9)), at_once=True)
        state, n = some_state(rng, limits), int(rng.integers(1, 7))
        given, commands = 0.1 * np.arange(10 - n, 10), np.array([some_command(rng) for _ in range(n)])
        expected = twin.answered(state, 0.9, 1.0, given, commands, limits)
        period = Period(np.full(6, 0.9), np.full(6, 1.0), np.column_stack((given, commands)))
        found = answered(RobotState(0.0, 0.0, 0.0, state.a, state.b), period, limits)
        assert np.allclose(found[3:], expected, atol=1e-6), (limits, commands)


def test_errors_are_those_of_each_candidate() -> None:
    """Sums over cycles with a memory; while the first candidate has been right, the others are not tried."""
    limits, given, commands = DIFF.limits, np.array([0.0, 0.1]), np.array([[0.0, 0.0], [1.0, 1.9]])
    latencies, ramps = np.array([0.0, 0.1, 0.2]), np.array([[1.0, 1.0, 3.0], [0.5, 0.5, 1.5]])
    used, error, place = np.zeros(4, np.int64), np.zeros((3, 3, 2)), np.zeros(PLACE)
    odometry = np.zeros(ODOMETRY)
    before, now = np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]), np.array([0.2, 0.0, 0.0, 0.0, 0.05, 0.0])
    sent = np.column_stack((given, commands))
    right = np.array([0.2, 0.005, 0.0, 0.0, *answered(REST, Period(before, now, sent), limits)[3:]])
    learn(Period(before, right, sent), limits, latencies, ramps, 0.9, used, error, place, odometry)
    assert error.max() < 1e-20
    for k in range(2):
        learn(Period(before, now, sent), limits, latencies, ramps, 0.9, used, error, place, odometry)
        sums = sum(0.9**i for i in range(k + 1))
        assert np.allclose(error[GROWS], sums * np.array([[0.05**2, 0.0], [0.05**2, 0.05**2], [0.05**2, 0.05**2]]))
        assert error[SLOWS].max() == 0.0
        assert np.allclose(error[TURNS], sums * np.array([[(0.3 / 1.9) ** 2, (0.15 / 1.9) ** 2], [0.0, 0.0], [0.0, 0.0]]))
    later = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    learn(Period(now, later, sent), limits, latencies, ramps, 0.9, used, error, place, odometry)
    assert error[SLOWS].max() > 0.0 and place[WEIGHT] == pytest.approx(0.9**3 + 0.9**2 + 0.9 + 1.0)


@pytest.mark.parametrize("drive", DRIVES)
def test_a_place_is_missed_by_as_much_as_it_is_wrong(drive: int) -> None:
    """By the distance by which it was moved from where steps of a millisecond lead, whatever command was predicted."""
    rng = np.random.default_rng(drive)
    for _ in range(cases(40, 2000)):
        limits = some_limits(rng, drive)
        state, command = some_state(rng, limits), some_command(rng)
        steps = twin.holonomic if drive == HOLONOMIC else twin.wheels
        x, y, theta, one, two = steps(state, command, limits, 0.1)[-1]
        angle, miss = rng.uniform(0.0, 2.0 * math.pi), rng.choice([0.0, 0.1])
        now = np.array([0.1, x + miss * math.cos(angle), y + miss * math.sin(angle), theta, one, two])
        for other in (command, some_command(rng)):
            predicted = drive_cycle(RobotState(0.0, 0.0, 0.0, state.a, state.b), *other, limits, 0.1)
            place = np.zeros(PLACE)
            place[LED] = 1e9  # no factor is fitted
            found = learn_place(np.array([0.0, *state]), now, predicted, drive == HOLONOMIC, 1.0, place)
            jump = 0.05 * math.hypot(one - predicted.a, two - predicted.b)
            assert found * math.sqrt(2.0) == pytest.approx(miss, abs=2.0 * jump + 2e-3)


def test_the_error_of_a_place_is_forgotten_in_three_seconds() -> None:
    """A place that jumped by 0.1 m and stays there is wrong by a third of that three seconds later."""
    place = np.zeros(PLACE)
    place[LED] = 1e9  # no factor is fitted
    for k in range(31):
        was = 0.0 if k == 0 else 0.1
        before, now = np.array([0.1 * k, was, was, 0.0, 0.0, 0.0]), np.array([0.1 * k + 0.1, 0.1, 0.1, 0.0, 0.0, 0.0])
        learn_place(before, now, REST, True, 1.0, place)
    assert place[ERROR_X : ERROR_X + 2] == pytest.approx(0.1 / math.e)


@pytest.mark.parametrize("drive", DRIVES)
def test_speeds_stay_while_no_command_is_known(drive: int) -> None:
    """Those above the limits, which may be wrong, too."""
    limits = some_limits(np.random.default_rng(drive), drive)
    period = Period(np.zeros(6), np.full(6, 0.1), np.empty((0, 3)))
    later = answered(RobotState(0.0, 0.0, 0.0, 1.2, 0.3), period, limits)
    assert later[3:] == (1.2, 0.3) and later.x > 0.1


def drive(
    response: Response,
    real: RobotSpec,
    cycles: int,
    noise: float = 0.0,
    misplaced: float = 0.0,
    held: int = 1,
    top: tuple[float, float] = (1.0, 1.0),
    every: int = 5,
) -> None:
    """Let `real` answer random commands up to `top` that are held for `every` cycles, while `response` watches.

    Speeds are measured with `noise` in m/s and rad/s, and places are wrong by `misplaced` m, for `held` cycles at a time.
    """
    rng, late = np.random.default_rng(0), math.ceil(real.latency / real.dt - 1e-9)
    state, sent = REST, [(0.0, 0.0)] * (late + 1)
    newer = real.dt * late - real.latency  # s; for so long the newer of two commands acts in a cycle
    for k in range(cycles):
        one, two = (float(at) for at in np.array([state.a, state.b]) + rng.normal(0.0, noise, 2))
        if k % held == 0:
            off = rng.normal(0.0, misplaced, 2).tolist()
        place = (state.x + off[0], state.y + off[1])
        velocity = (one * math.cos(state.theta), one * math.sin(state.theta)) if real.wheels else (one, two)
        seen = Observation(k * real.dt, place, velocity, state.theta, NOBODY, turn_rate=two)
        response.update(seen)
        if k % every == 0:
            asked = (top[0] * float(rng.uniform(-0.3, 1.0)), top[1] * float(rng.uniform(-1.0, 1.0)))
        response.record(seen, Command(twist=asked) if real.wheels else Command(asked))
        sent = [*sent[1:], asked]
        if late and newer > 1e-9:
            state = drive_cycle(drive_cycle(state, *sent[0], real.limits, real.dt - newer), *sent[1], real.limits, newer)
        else:
            state = drive_cycle(state, *sent[0], real.limits, real.dt)


@pytest.mark.parametrize("latency", [0.0, 0.05, 0.1, 0.25, 0.4])
@pytest.mark.parametrize("factor", [1.0, 0.7, 0.3])
@pytest.mark.parametrize("name", ["diff", "inertia", "holonomic"])
def test_what_differs_is_found(name: str, factor: float, latency: float) -> None:
    """Latency and accelerations to the step of the candidates, with and without 1 cm/s of noise."""
    declared = load_robot(name)
    a_max = 1.0 if math.isinf(declared.a_max) and factor < 1.0 else declared.a_max * factor
    real = replace(declared, a_max=a_max, latency=latency)
    for noise in (0.0, 0.01):
        response = Response(declared)
        drive(response, real, 60, noise=noise)
        # Without inertia, all latencies within a control period lead to the same speeds at its end.
        assert response.robot.latency == pytest.approx(latency, abs=0.101 if math.isinf(a_max) else 0.051)
        if math.isfinite(a_max):
            assert response.robot.a_max == pytest.approx(a_max, rel=0.35)
        assert ("the robot answers" in str(response)) == (response.robot != declared)


@pytest.mark.parametrize("name", ROBOTS)
def test_a_robot_that_is_as_declared_stays_so(name: str) -> None:
    """For all robots with a name; where speeds are measured with 2 cm/s of noise, it only keeps a little more room."""
    declared = load_robot(name)
    response = Response(declared)
    drive(response, declared, 300)
    assert response.robot is declared and str(response) == "" and response.spread == 0.0
    response = Response(declared)
    drive(response, declared, 300, noise=0.02)
    assert 0.0 < response.spread < 0.05
    assert response.robot == (replace(declared, a_max=8.0) if declared.stepwise else declared)


@pytest.mark.parametrize("latency", [0.0, 0.17])
@pytest.mark.parametrize("alpha_max", [9.0, math.inf])
@pytest.mark.parametrize("turning_radius", [0.0, 0.7])
def test_fast_wheels_that_are_as_declared_are_where_they_are_predicted(
    turning_radius: float, alpha_max: float, latency: float
) -> None:
    """Also where their turn rate grows within a period, which leads them some millimetres to the side of an arc's chord."""
    wheels = {"drive": "ackermann", "turning_radius": turning_radius} if turning_radius > 0.0 else {"drive": "differential"}
    fast = RobotSpec(v_max=2.5, a_max=2.0, v_reverse=2.5, turn_rate=3.5, alpha_max=alpha_max, latency=latency, **wheels)
    response = Response(fast)
    drive(response, fast, 200, top=(fast.v_max, fast.turn_rate))
    assert response.robot is fast and str(response) == "" and response.spread == 0.0


@pytest.mark.parametrize("kind", ["holonomic", "differential"])
def test_speeds_are_right_though_a_command_begins_to_act_within_a_period(kind: str) -> None:
    """Within the period the robot is faster than at its start and end; such speeds used to be found wrong within 2 s."""
    declared = RobotSpec(v_max=2.0, a_max=4.0, v_reverse=2.0 * (kind != "holonomic"), drive=kind, dt=0.2, latency=0.1)
    response = Response(declared)
    drive(response, declared, 100, top=(2.0, 2.0), every=1)
    assert response.robot is declared and str(response) == "" and response.spread == 0.0


@pytest.mark.parametrize("held", [1, 10])
@pytest.mark.parametrize("name", ["diff", "inertia", "jackal", "amr", "holonomic"])
def test_the_error_of_the_robots_place_is_found(name: str, held: int) -> None:
    """Whether it changes in each cycle or once a second; one without inertia is then driven with care, as one with it is."""
    response = Response(load_robot(name))
    drive(response, load_robot(name), 100, misplaced=0.02, held=held)
    assert response.spread == pytest.approx(0.02, rel=0.5) and "its place is uncertain by 0.0" in str(response)
    assert not response.robot.stepwise


@pytest.mark.parametrize("name", ["diff", "inertia"])
def test_speeds_that_are_wrong_by_a_factor_are_no_error_of_the_place(name: str) -> None:
    """Wheels whose radius is not known to 3 % do not make the robot keep away from walls."""
    declared = load_robot(name)
    response, at, heading = Response(declared), np.zeros(2), 0.0
    for k in range(200):
        speed, turn = min(0.1 * k, 0.9), 0.3 * math.sin(0.03 * k) if declared.wheels else 0.0
        velocity = (speed * math.cos(heading), speed * math.sin(heading))
        seen = Observation(0.1 * k, tuple(at.tolist()), velocity, heading, NOBODY, turn_rate=turn)
        response.update(seen)
        response.record(seen, Command(velocity, (speed, turn) if declared.wheels else None))
        later = min(0.1 * (k + 1), 0.9)
        middle = heading + 0.05 * turn
        at = at + 0.1 * 1.03 * 0.5 * (speed + later) * np.array([math.cos(middle), math.sin(middle)])
        heading += 0.1 * turn
    assert response.spread < 0.01


@pytest.mark.parametrize("name", ["diff", "inertia", "holonomic"])
def test_a_lower_top_speed_is_found_and_forgotten(name: str) -> None:
    """From where the robot stays; once it is faster than that, what was declared counts again."""
    declared = load_robot(name)
    slow = replace(declared, v_max=0.7 * declared.v_max, v_reverse=0.7 * declared.v_reverse)
    response, full, x, speed = Response(declared), Command((1.0, 0.0), (1.0, 0.0) if declared.wheels else None), 0.0, 0.0
    for k in range(40):
        before, speed = speed, min(0.1 * k, slow.v_max if k < 30 else declared.v_max)
        x += 0.05 * (before + speed)
        seen = Observation(0.1 * k, (x, 0.0), (speed, 0.0), 0.0, NOBODY)
        response.update(seen)
        response.record(seen, full)
        if k == 29:
            assert response.robot.v_max == pytest.approx(0.7) and "v_max 0.7 in place of 1 m/s" in str(response)
    assert response.robot.v_max == declared.v_max


def test_who_accelerates_weakly_brakes_weakly_until_it_is_seen_to_brake_better() -> None:
    """Otherwise it would find out only when it has to stop."""
    response, state, weak = Response(DIFF), REST, replace(DIFF, a_max=0.5, brake_max=1.0)
    for k in range(40):
        seen = Observation(0.1 * k, (state.x, 0.0), (state.a, 0.0), 0.0, NOBODY)
        response.update(seen)
        command = (0.8 if k < 20 else 0.0, 0.0)
        response.record(seen, Command(twist=command))
        assert k < 2 or response.robot.a_max == 0.5
        assert not 2 <= k < 20 or response.robot.brake_max == 0.5
        state = drive_cycle(state, *command, weak.limits, 0.1)
    assert response.robot.brake_max == 1.0


@pytest.mark.parametrize("name", ["diff", "inertia", "holonomic"])
def test_a_robot_that_is_held_and_released_is_as_declared(name: str) -> None:
    """After an emergency stop of ten seconds, begun at rest or while driving, the declared numbers count, and it says why."""
    declared = load_robot(name)
    full = Command((1.0, 0.0), (1.0, 0.0) if declared.wheels else None)
    for begin in (0, 20):
        response, state = Response(declared), REST
        for k in range(160):
            seen = Observation(0.1 * k, (state.x, state.y), (state.a, state.b), 0.0, NOBODY)
            response.update(seen)
            if begin + 10 <= k <= begin + 100:
                assert response.robot is declared and "does not move" in str(response)
            response.record(seen, full)
            is_held = begin <= k < begin + 100
            state = REST._replace(x=state.x) if is_held else drive_cycle(state, 1.0, 0.0, declared.limits, 0.1)
        assert response.robot is declared and str(response) == ""


def test_a_car_that_is_only_asked_to_turn_is_not_held() -> None:
    """It cannot turn in place, so that it stays where it is as it should."""
    response = Response(RobotSpec(drive="ackermann", a_max=1.0, turning_radius=1.0))
    for k in range(30):
        response.update(Observation(0.1 * k, (0.0, 0.0), (0.0, 0.0), 0.0, NOBODY))
        assert str(response) == ""
        response.record(Observation(0.1 * k, (0.0, 0.0), (0.0, 0.0), 0.0, NOBODY), Command(twist=(0.0, 1.0)))


@pytest.mark.parametrize("name", ["diff", "inertia"])
def test_a_robot_that_is_carried_elsewhere_knows_its_place_as_well_as_before(name: str) -> None:
    """A jump of 5 m is no error of the place that could come back, and a turn that nobody commanded no missing gyroscope."""
    declared = load_robot(name)
    response, state = Response(declared), REST
    for k in range(60):
        heading = 0.1 if k >= 30 and declared.wheels else 0.0
        place = (state.x + 5.0 * (k >= 40), state.y)
        velocity = (state.a * math.cos(heading), state.a * math.sin(heading))
        seen = Observation(0.1 * k, place, velocity, heading, NOBODY)
        response.update(seen)
        response.record(seen, Command((1.0, 0.0), (0.5, 0.0) if declared.wheels else None))
        state = drive_cycle(state, 0.5 if declared.wheels else 1.0, 0.0, declared.limits, 0.1)
        assert response.spread < 0.1 and response.odometry.turn_rate is None
    assert response.robot is declared


def test_a_turn_rate_that_is_not_measured_is_predicted() -> None:
    """Simulators of others may leave it out of their observations, where it is 0 then."""
    response, twist = Response(DIFF), Command(twist=(0.0, 1.9))
    state = RobotState(0.0, 0.0, 0.0, 0.0, 0.0)
    for k in range(20):
        seen = Observation(0.1 * k, (0.0, 0.0), (0.0, 0.0), state.theta, NOBODY)
        response.update(seen)
        if k > 10:
            assert response.completed(seen).turn_rate == pytest.approx(1.9)
        response.record(seen, twist)
        state = drive_cycle(state, 0.0, 1.9, DIFF.limits, 0.1)
    assert response.robot is DIFF and response.error[TURNS].max() == 0.0


def test_commands_before_a_gap_are_forgotten_and_those_that_are_told_count() -> None:
    """What was sent during a gap is not known; what does not act yet is told by some simulators; what replaces counts."""
    late = replace(DIFF, latency=0.2)
    response, moves = Response(late), Command(twist=(1.0, 0.0))
    for k in range(5):
        seen = Observation(0.1 * k, (0.0, 0.0), (0.0, 0.0), 0.0, NOBODY)
        response.update(seen)
        response.record(seen, moves)
        response.record(seen, Command(twist=(0.0, 0.0)))  # is what was sent
    assert response.robot is late and response.error.max() == 0.0
    response.record(seen, moves)
    response.update(Observation(3.0, (0.0, 0.0), (0.0, 0.0), 0.0, NOBODY))
    assert response.known == 0 and response.robot is late
    told = np.array([[1.0, 0.0], [1.0, 0.0]])
    seen = Observation(3.1, (0.0, 0.0), (0.0, 0.0), 0.0, NOBODY, pending=told)
    response.update(seen)
    assert response.known == 2 and response.robot is late
    response.record(seen, moves)
    response.update(Observation(3.2, (0.0, 0.0), (0.1, 0.0), 0.0, NOBODY, pending=told))
    assert response.error.max() < 1e-12
    assert (response.sent[-2:, 1:] == told).all()


def test_commands_that_acted_before_a_gap_do_not_count_as_pending() -> None:
    """After a pause of 20 s they used to; after one missed cycle those that are on their way still do."""
    late = replace(DIFF, latency=0.3)
    response, still = Response(late), ((0.0, 0.0), (0.0, 0.0), 0.0, NOBODY)
    for k in range(8):
        seen = Observation(0.1 * k, *still)
        response.record(seen, Command(twist=(0.1 * k, 0.0)))
    pending = {t: response.completed(Observation(t, *still)).pending for t in (0.8, 0.9, 20.7)}
    speeds = {t: None if given is None else given[:, 0].tolist() for t, given in pending.items()}
    assert speeds[0.8] == pytest.approx([0.5, 0.6, 0.7])
    assert speeds[0.9] == pytest.approx([0.6, 0.7, 0.7])
    assert speeds[20.7] == [0.0, 0.0, 0.0]
    response.record(Observation(20.7, *still), Command(twist=(0.4, 0.0)))
    told = response.completed(Observation(20.8, *still)).pending
    assert told is not None and told[:, 0].tolist() == [0.0, 0.0, 0.4]


@pytest.mark.parametrize("drive", DRIVES)
def test_speeds_are_compared_with_places(drive: int) -> None:
    """By sums over the history; speeds are as wrong as the velocity between two places is far from all between them.

    How far it is to be beside them by the commands, which may begin to act within a period, does not count.
    """
    rng, memory, holonomic = np.random.default_rng(drive), 0.99, drive == HOLONOMIC
    for _ in range(cases(5, 200)):
        odometry, n = np.zeros(ODOMETRY), 20
        odometry[LAST_X] = math.nan
        seen = rng.normal(0.0, 1.0, (n, 6))
        seen[:, T] = np.cumsum(rng.uniform(0.05, 0.2, n))
        led = [RobotState(*rng.normal(0.0, 1.0, 5)) for _ in range(n - 1)]
        for (before, now), predicted in zip(pairwise(seen), led):
            compare_speeds(before, now, predicted, holonomic, memory, odometry)
        passed, sums, weight = np.diff(seen[:, T]), np.zeros(3), 0.0
        velocity = np.diff(seen[:, [X, Y]], axis=0) / passed[:, None]
        for k in range(1, n - 1):
            turn = led[k].theta + math.remainder(seen[k + 1, HEADING] - seen[k, HEADING] - led[k].theta, math.tau)
            middle = seen[k, HEADING] + 0.5 * turn
            axes = (
                np.eye(2)
                if holonomic
                else np.array([[math.cos(middle), math.sin(middle)], [-math.sin(middle), math.cos(middle)]])
            )
            here, ahead = axes @ velocity[k], np.array(led[k][:2]) / passed[k]
            between = np.linspace(seen[k, [A, B]], seen[k + 1, [A, B]], 20_001)
            foreseen = np.linspace(led[k - 1][3:], led[k][3:], 20_001)
            if not holonomic:
                half = 0.5 * led[k].theta
                ahead = np.array([math.copysign(math.hypot(*ahead), ahead @ (math.cos(half), math.sin(half))), 0.0])
                for speeds in (between, foreseen):
                    speeds[:, 0] *= np.sinc(0.5 * turn / math.pi)  # a chord over its arc
                    speeds[:, 1] = 0.0
            beside, as_foreseen = (
                (at - on)[np.hypot(*(at - on).T).argmin()] for at, on in ((here, between), (ahead, foreseen))
            )
            measured = min(math.hypot(*beside), math.dist(beside, as_foreseen))
            errors = [measured, math.dist(velocity[k], velocity[k - 1]), math.dist(here, ahead)]
            sums, weight = memory * sums + errors, memory * weight + 1.0
        assert np.allclose(odometry[:3], sums, atol=1e-3) and odometry[COMPARED] == pytest.approx(weight)


@pytest.mark.parametrize("robot", ["holonomic", "diff", "jackal"])
def test_a_robot_arrives_though_its_speeds_are_reported_wrongly(robot: str) -> None:
    """It notices, says so, and is not much slower."""
    named = "" if robot == "holonomic" else robot
    episode = SuiteEpisode("synthetic", "synthetic", "aisles/medium", 0, named)
    scenario = build(episode)
    right = run(scenario, "antway", seed=episode.seed)
    for change in ("no speeds", "robot's frame"):
        policy = AntwayPolicy()
        result = run(scenario, Misled(policy, scenario.robot, CHANGES[change]), seed=episode.seed)
        check_episode(result)
        assert result.reached and "do not fit its places" in policy.explain().reason, change
        assert result.time <= 1.5 * right.time, change


def test_speeds_that_fit_places_are_believed() -> None:
    """Whatever noise places have, and wherever they jump, speeds that are right are used."""
    rng = np.random.default_rng(7)
    for _ in range(cases(10, 300)):
        robot, noise, jumps = load_robot("inertia"), float(rng.choice([0.0, 0.01, 0.05])), float(rng.choice([0.0, 0.05, 0.1]))
        response, state, off, command = Response(robot), REST, np.zeros(2), (0.0, 0.0)
        for i in range(200):
            if i % 20 == 0:
                command = tuple(rng.uniform(-0.7, 0.7, 2).tolist())
            if rng.random() < 0.1:
                off = rng.normal(0.0, jumps, 2)
            x, y = state[:2] + off + rng.normal(0.0, noise, 2)
            seen = Observation(0.1 * i, (x, y), (state.a, state.b), state.theta, NOBODY)
            response.update(seen)
            response.record(seen, Command(command))
            state = drive_cycle(state, *command, robot.limits, robot.dt)
            assert response.odometry.measured, (noise, jumps, i)


@pytest.mark.parametrize(
    ("robot", "change", "hardest"),
    [
        ("diff", "latency 0.2", [("clutter", 1), ("clutter", 3), ("aisles", 2)]),
        ("diff", "slow turns", [("aisles", 9), ("aisles", 16), ("aisles", 17)]),
        ("holonomic", "latency 0.1", [("clutter", 0), ("clutter", 4), ("aisles", 0)]),
        ("holonomic", "weak", [("clutter", 1), ("clutter", 2), ("aisles", 2)]),
        ("jackal", "latency 0.2", [("clutter", 0), ("clutter", 2), ("aisles", 3)]),
        ("diff", "slow", [("aisles", 4)]),
        ("holonomic", "noise", [("clutter", 1), ("clutter", 4), ("aisles", 1)]),
    ],
)
def test_robots_that_are_slower_than_declared_arrive(robot: str, change: str, hardest: list[tuple[str, int]]) -> None:
    """Without what is learnt, contacts with walls and obstacles end some of these episodes; with it they all arrive.

    The hardest, which end so without it, are played first; `make test` plays these and few others.
    """
    named = "" if robot == "holonomic" else robot
    places = hardest + [one for one in product(("clutter", "aisles"), range(6)) if one not in hardest]
    drives = [SuiteEpisode("synthetic", "synthetic", f"{kind}/medium", k, named) for kind, k in places[: costly(12, 12)]]
    assert {play(one, "antway", CHANGES[change])[0] for one in drives} == {"reached"}
    assert any(play(one, "antway/learns_response=False", CHANGES[change])[0] != "reached" for one in drives)


def test_the_explanation_says_what_was_found() -> None:
    """And every such episode passes its check; the same policy then starts anew with the robot that it is told."""
    episode = SuiteEpisode("synthetic", "synthetic", "open/medium", 0, "diff")
    scenario = build(episode)
    late = replace(scenario, robot=Change(latency=0.2).of(scenario.robot))
    policy = make_policy("antway")
    results = []
    for _ in range(2):
        results.append(run(late, Misled(policy, scenario.robot, Change(latency=0.2)), seed=1))
        check_episode(results[-1])
        assert "the robot answers with latency 0.2 in place of 0 s" in policy.explain().reason
    first, second = (result.trace for result in results)
    assert first is not None and second is not None and first.xy.tobytes() == second.xy.tobytes()


def test_a_guard_around_the_policy_tells_what_it_sent() -> None:
    """Otherwise a robot that the guard slows down would seem to be slow itself."""
    episode = SuiteEpisode("synthetic", "synthetic", "aisles/high", 0, "diff")
    policy = AntwayPolicy(guard=False)
    guarded = Guarded(policy)
    run(build(episode), guarded, seed=0, horizon=15.0, record=False)
    assert policy.state is not None
    assert policy.state.response.robot is policy.state.response.declared and policy.state.response.error.max() < 1e-9


def test_what_learns_can_be_chosen() -> None:
    """Only a bool is taken; a weight of distances, for which the ants in the space of controls do not drive, turns it off."""
    with pytest.raises(BadParameter, match="learns_response"):
        AntwayPolicy(learns_response=1)  # type: ignore[arg-type]
    assert not AntwayPolicy(distance_weight=0.1).learns_response and AntwayPolicy().learns_response


@pytest.mark.parametrize("learns", [True, False])
@pytest.mark.parametrize("name", ["diff", "inertia"])
def test_commands_that_do_not_act_yet_need_not_be_told(name: str, learns: bool) -> None:
    """With latency, observations without `pending` get the same commands: the policy knows what it has commanded.

    It used to plan as if there were no latency, and met people whom it avoids without having been told of the latency.
    """
    robot = replace(load_robot(name), latency=0.3)
    world = World(Grid(np.zeros((60, 80), np.bool_), 0.2), (Obstacle(0.3, Line((8.0, 11.0), (8.0, 1.0), speed=0.8)),))
    scenario = Scenario(world, (1.1, 6.1), (14.1, 6.1), robot=robot, horizon=4.0)
    told = AntwayPolicy(learns_response=learns)

    class Untold(AntwayPolicy):
        def act(self, observation: Observation) -> Command:
            return super().act(replace(observation, pending=None))

    one, two = run(scenario, told), run(scenario, Untold(learns_response=learns))
    assert one.trace is not None and two.trace is not None
    assert one.trace.command.tobytes() == two.trace.command.tobytes()


@pytest.mark.parametrize("rates", [(0.5, 0.5), (0.3, 0.3), (0.7, 0.5)])
def test_a_robot_that_turns_slowly_leaves_a_wall(rates: tuple[float, float]) -> None:
    """Its nose is 5 cm before a wall, and it turns on the spot. It used to stand: half a turn outlasted its sequences."""
    turn_rate, alpha_max = rates
    robot = RobotSpec(0.4, 1.5, 0.5, drive="differential", turn_rate=turn_rate, alpha_max=alpha_max)
    blocked = np.zeros((100, 160), np.bool_)
    blocked[:, 0] = True
    task = Task(Grid(blocked, 0.1), robot, (0.55, 5.0), (6.0, 5.0), 0.4)
    policy, state = AntwayPolicy(), RobotState(0.55, 5.0, math.pi, 0.0, 0.0)
    policy.reset(task, 0)
    for k in range(150):
        heading = state.theta
        velocity = state.a * math.cos(heading), state.a * math.sin(heading)
        command = policy.act(Observation(k * robot.dt, (state.x, state.y), velocity, heading, NOBODY, turn_rate=state.b))
        assert command.twist is not None
        state = drive_cycle(state, *command.twist, robot.limits, robot.dt)
        assert state.x >= 0.1 + robot.radius
        if math.dist((state.x, state.y), task.goal) <= task.goal_tolerance:
            break
    assert math.dist((state.x, state.y), task.goal) <= task.goal_tolerance


def test_what_is_computed_anew_keeps_the_distance_for_an_uncertain_place() -> None:
    """In the cycle in which a state is made anew, the colony keeps the same distances as before."""
    policy = AntwayPolicy(guard=False)
    policy.reset(Task(Grid(np.zeros((40, 60), np.bool_), 0.1), RobotSpec(a_max=1.0), (1.0, 2.0), (5.0, 2.0)), 0)
    before = policy.state
    before.response.spread = 0.08
    before.controls.set_spread(0.08)
    policy._compute_anew(0.0, before.task)
    assert policy.state is not before
    after = policy.state.controls
    assert after.margins == before.controls.margins and after.margins.margin > 0.08
    assert policy.state.dance is before.dance, "a robot that stands to let somebody else drive on first does so still"
    assert after.problem.weights.wall_margin == before.controls.problem.weights.wall_margin


def test_a_departure_keeps_what_was_learnt() -> None:
    """The robot that was found is planned for and guarded on the way to the next stop; both used to be as declared again."""
    declared, grid = load_robot("diff"), Grid(np.zeros((40, 120), np.bool_), 0.1)
    policy = AntwayPolicy()
    policy.reset(Task(grid, declared, (1.0, 2.0), (6.0, 2.0)), 0)
    seen = Tracks(np.array([7]), np.array([[9.0, 2.0]]), np.zeros((1, 2)), np.array([0.3]))
    policy.act(Observation(0.0, (1.0, 2.0), (0.0, 0.0), 0.0, seen))
    before = policy.state
    assert before is not None and policy.guard is not None
    drive(before.response, replace(declared, a_max=0.3), 60)
    policy.depart(Task(grid, declared, (1.0, 2.0), (8.0, 2.0)), 1)
    after = policy.state
    assert after is not None and after is not before and after.controls is not None
    assert after.response is before.response and after.response.robot.braking < 0.5 * declared.braking
    assert after.task.robot == policy.guard.task.robot == after.response.robot and after.task.goal == (8.0, 2.0)
    assert after.controls.problem.limits.brake_max == after.response.robot.braking
    assert after.tracker is before.tracker and len(after.tracker.estimates) == 1 and after.yielding is not before.yielding
    policy.reset(Task(grid, declared, (1.0, 2.0), (8.0, 2.0)), 1)
    assert policy.state is not None and policy.state.task.robot == policy.guard.task.robot == declared
    assert len(policy.state.tracker.estimates) == 0


@pytest.mark.parametrize("guarded", [False, True])
@pytest.mark.parametrize("name", ["diff", "inertia"])
def test_commands_that_do_not_act_yet_survive_a_departure(name: str, guarded: bool) -> None:
    """With latency, observations without `pending` get the same commands, also right after a departure amid the drive."""
    robot = replace(load_robot(name), latency=0.4)
    grid, given = Grid(np.zeros((40, 120), np.bool_), 0.1), []
    for told in (True, False):
        policy = Guarded(AntwayPolicy(guard=False)) if guarded else AntwayPolicy()
        state, sent = RobotState(1.0, 2.0, 0.0, 0.0, 0.0), np.zeros((4, 2))
        policy.reset(Task(grid, robot, (1.0, 2.0), (11.0, 2.0)), 0)
        given.append([])
        for k in range(30):
            place, heading = (state.x, state.y), state.theta
            if k == 20:
                policy.depart(Task(grid, robot, place, (11.0, 1.0)), 1)
            velocity = (state.a * math.cos(heading), state.a * math.sin(heading)) if robot.wheels else (state.a, state.b)
            turn_rate = state.b if robot.wheels else 0.0
            full = Observation(k * robot.dt, place, velocity, heading, NOBODY, turn_rate=turn_rate, pending=sent.copy())
            acts = policy.act(full if told else replace(full, pending=None)).acts(full, robot)
            given[-1].append(acts)
            state = drive_cycle(state, *sent[0].tolist(), robot.limits, robot.dt)
            sent = np.vstack((sent[1:], [acts]))
    assert given[0] == given[1]


@pytest.mark.parametrize("alpha_max", [8.0, math.inf])
@pytest.mark.parametrize(("turn_rate", "dt"), [(4.0, 0.3), (4.0, 0.5), (2.0, 1.0), (3.0, 1.0), (4.0, 1.0), (6.3, 1.0)])
def test_wheels_that_turn_far_in_a_long_period_are_where_they_are_predicted(
    turn_rate: float, dt: float, alpha_max: float
) -> None:
    """Their place used to count as uncertain by up to 0.3 m, and their speeds as wrong: a chord is shorter than its arc."""
    fast = RobotSpec(v_max=2.0, a_max=2.0, turn_rate=turn_rate, alpha_max=alpha_max, drive="differential", dt=dt)
    response = Response(fast)
    drive(response, fast, 60, top=(fast.v_max, fast.turn_rate))
    assert response.robot is fast and str(response) == "" and response.spread == 0.0
