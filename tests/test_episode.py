"""Episodes: exact outcomes, clean ends of faulty policies, a verifier that kills, the same bytes for the same seed."""

from __future__ import annotations

import math
import os
import random
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import antway
from antway import BadParameter, BadScenario, Grid, InvalidPlan, Outcome, RobotSpec, Scenario, World, check_episode, run
from antway.kernels.base.rng import stream
from antway.world.episode import Episode
from antway.world.motions import BackAndForth, Bounce, Line, RandomWalk, Replay, Waypoints
from antway.world.policy import Command, Decision, make_policy
from antway.world.sensor import Sensor
from antway.world.world import Obstacle
from common import SCALE, cases

ROOM = Grid(np.zeros((40, 60), dtype=bool), 0.25)


class Steer:
    """Drives by a function of the observation: velocities, or with `twists` what wheels get."""

    def __init__(self, velocity, twists: bool = False) -> None:
        self.velocity, self.decision, self.twists = velocity, Decision("follow", "as told"), twists

    def reset(self, task, seed) -> None:
        self.task = task

    def act(self, observation):
        velocity = self.velocity(observation)
        return None if velocity is None else Command(velocity, velocity if self.twists else None)

    def explain(self):
        return self.decision


def crossing(*obstacles: Obstacle, goal=(14.0, 5.0), **changes) -> Scenario:
    return Scenario(World(ROOM, obstacles), (1.0, 5.0), goal, horizon=20.0, **changes)


def east(observation):
    return (1.0, 0.0)


def test_an_episode_has_a_result_once_it_has_ended_and_then_goes_no_further() -> None:
    """It drove on, up to an IndexError; and asked for its result before, it was an AssertionError."""
    episode = Episode(crossing(), Steer(east), horizon=0.2)
    for _ in range(2):
        with pytest.raises(BadParameter, match="one that has ended"):
            episode.result()
        episode.step()
    assert episode.result().outcome is Outcome.TIMEOUT
    with pytest.raises(BadParameter, match="'timeout': must be one that has not ended"):
        episode.step()


def random_scenario(seed: int) -> Scenario:
    rng = np.random.default_rng(seed)
    places = [tuple(p) for p in rng.uniform((2.5, 0.5), (14.5, 9.5), (6, 2))]
    kinds = (Bounce, RandomWalk)
    obstacles = [Obstacle(0.3, kinds[i % 2](p, (0.3, 0.9))) for i, p in enumerate(places)]
    robot = RobotSpec(
        a_max=[math.inf, 2.0][seed % 2], drive=["holonomic", "differential"][seed // 2 % 2], dt=[0.1, 0.05][seed // 4 % 2]
    )
    sensor = Sensor(noise=0.02 * (seed % 3), dropout=0.1 * (seed % 2), latency=0.1 * (seed % 2))
    return crossing(*obstacles, robot=robot, sensor=sensor, name=f"random {seed}")


def test_outcomes_and_their_instants_are_exact() -> None:
    """Goal, moving and standing contact, wall and horizon end an episode at the computed instant."""
    done = run(crossing(), Steer(east))
    assert (
        done.outcome is Outcome.REACHED and done.time == pytest.approx(12.8, abs=1e-12) and done.length == pytest.approx(12.8)
    )
    head_on = crossing(Obstacle(0.4, Line((12.0, 5.0), (0.5, 5.0), speed=1.0)))
    hit = run(head_on, Steer(east))
    assert hit.outcome is Outcome.HIT_MOVING and hit.time == pytest.approx((11.0 - 0.7) / 2, abs=1e-9)
    stood = run(head_on, Steer(lambda o: (0.0, 0.0)))
    assert stood.outcome is Outcome.HIT_STANDING and stood.time == pytest.approx(10.3, abs=1e-9) and stood.waits == 1
    wall = run(crossing(), Steer(lambda o: (0.0, 1.0)))
    assert wall.outcome is Outcome.HIT_WALL and wall.time == pytest.approx(4.7, abs=1e-8)
    soon = run(crossing(), Steer(east), horizon=0.04)
    assert (soon.outcome, soon.time, len(soon.cycle_ms)) == (Outcome.TIMEOUT, 0.1, 1)
    late = run(crossing(), Steer(lambda o: (0.0, 0.0)), horizon=3.0)
    assert late.outcome is Outcome.TIMEOUT and late.time == pytest.approx(3.0)
    amid = run(crossing(goal=(1.48, 5.0)), Steer(east), horizon=0.25)  # the cycle from 0.2 s on is driven to its end
    assert amid.outcome is Outcome.REACHED and amid.time == pytest.approx(0.28, abs=1e-9)
    near = run(crossing(goal=(1.1, 5.0)), Steer(east))
    assert near.outcome is Outcome.REACHED and near.time == 0.0 and len(near.trace) == 0
    for result in (done, hit, stood, wall, late, amid, near):
        check_episode(result)
    assert run(crossing(), Steer(east), record=False).trace is None


@pytest.mark.parametrize("robot", [RobotSpec(), RobotSpec(a_max=1.0), RobotSpec(drive="differential", a_max=1.0)])
def test_a_robot_on_the_edge_of_the_goal_is_there(robot: RobotSpec) -> None:
    """It stops exactly as far from the goal as the tolerance, which it used to hold for the goal until its time was over."""
    done = run(crossing(goal=(3.0, 5.0), robot=robot), Steer(lambda seen: (1.0, 0.0) if seen.t < 0.95 else (0.0, 0.0)))
    stop = done.trace.xy[-1].tolist()
    scenario = crossing(goal=(stop[0] + 0.5, 5.0), goal_tolerance=0.5, robot=robot)
    result = run(scenario, Steer(lambda seen: (1.0, 0.0) if seen.t < 0.95 else (0.0, 0.0)))
    assert result.reached and result.time == pytest.approx(done.trace.t[done.trace.xy[:, 0] >= stop[0] - 1e-9][0], abs=0.1)
    check_episode(result)
    late = replace(done.trace, task=result.trace.task, outcome=Outcome.TIMEOUT)
    with pytest.raises(InvalidPlan, match="after it reached the goal"):
        check_episode(late)
    start = run(crossing(goal=(1.5, 5.0), goal_tolerance=0.5 - 1e-10, robot=robot), Steer(east))
    assert start.reached and start.time == 0.0


def test_a_failing_policy_ends_as_error_with_the_robot_stopped() -> None:
    """An exception brakes the robot and names itself; None and NaN mean stop; Ctrl-C passes."""

    def breaks(observation):
        if observation.t > 1.0:
            raise RuntimeError("lost the way")
        return (1.0, 0.0)

    result = run(crossing(robot=RobotSpec(a_max=1.0)), Steer(breaks))
    assert result.outcome is Outcome.ERROR and "RuntimeError: lost the way" in result.reason
    assert np.hypot(*result.trace.velocity[-1]) < 1e-9 and result.time < 2.5
    check_episode(result)

    class Unready(Steer):
        def reset(self, task, seed):
            raise ValueError("no\n  map")

    reason = run(crossing(), Unready(east)).reason
    assert reason.startswith("Unready at reset: ValueError: no map (test_episode.py, line ") and reason.endswith(", in reset)")
    for nothing in (None, (math.nan, 0.0), (math.inf, 1.0)):
        still = run(crossing(), Steer(lambda o, nothing=nothing: nothing), horizon=1.0)
        assert still.outcome is Outcome.TIMEOUT and still.length == 0.0
        assert still.reason == "the horizon of 1 s came first; Steer gave no command of finite numbers"
    for value, named in (("east", "= 'east'"), ((0.1, 0.1, 0.1), "= (0.1, 0.1, 0.1)"), ((1, "a"), "= (1, 'a')")):
        wrong = run(crossing(), Steer(lambda o, value=value: value), horizon=1.0)
        assert wrong.outcome is Outcome.ERROR and f"command.velocity {named}" in wrong.reason, wrong.reason

    left = run(crossing(), Steer(lambda o: sys.exit(3)), horizon=1.0)
    assert left.outcome is Outcome.ERROR and "SystemExit: 3" in left.reason
    path = np.zeros((2, 2))
    decisions = {
        "decision ": None,
        "decision.obstacle": Decision("wait", "", obstacle="x"),
        "decision.path": Decision("", "", path=path),
    }
    decisions |= {
        "decision.reason": Decision("wait", None),
        "decision.alternatives": Decision("", "", alternatives=[("wait", "2")]),
    }
    for field, decision in decisions.items():
        odd = Steer(east)
        odd.explain = lambda decision=decision: decision
        unclear = run(crossing(), odd, horizon=1.0)
        assert unclear.outcome is Outcome.ERROR and field in unclear.reason, unclear.reason
        check_episode(unclear)

    def interrupts(observation):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(crossing(), Steer(interrupts))


def test_no_cycle_takes_longer_for_being_explained() -> None:
    """The time of a control cycle is that of the command; what its explanation takes is not counted."""

    class Wordy(Steer):
        def explain(self):
            time.sleep(0.2)
            return self.decision

    result = run(crossing(goal=(2.0, 5.0)), Wordy(east))
    assert result.reached and result.trace.decisions and np.median(result.cycle_ms) < 100.0


def test_wrong_arguments_are_refused() -> None:
    """Wrong scenario, seed, horizon, policy, or an obstacle upon the robot raise the typed error."""
    for bad in ({"seed": -1}, {"seed": 1.5}, {"horizon": 0.0}, {"horizon": math.nan}, {"policy": "nobody"}):
        with pytest.raises(BadParameter):
            run(crossing(), **({"policy": Steer(east)} | bad))
    with pytest.raises(BadParameter):
        run("crossing", Steer(east))
    with pytest.raises(BadScenario, match=r"obstacles\[0\]"):
        run(crossing(Obstacle(0.3, Line((1.2, 5.0), (3, 5), 1.0))), Steer(east))


def test_random_episodes_pass_the_verifier_and_replay() -> None:
    """Whatever happens, the trace obeys the rules; driven again by its commands every state is the same."""
    outcomes = set()
    for seed in range(cases(24, 500)):
        scenario = random_scenario(seed)
        angle = np.random.default_rng(seed).uniform(-0.7, 0.7, 400)
        wander = Steer(lambda o, a=angle: (math.cos(a[int(o.t)]), math.sin(a[int(o.t)])))
        try:
            result = run(scenario, wander, seed=seed)
        except BadScenario:
            continue  # an obstacle drawn upon the robot
        check_episode(result)
        outcomes.add(result.outcome)
        trace = result.trace
        trajectories = [trace.timeline.trajectory(k) for k in range(len(trace.timeline))]
        again = [Replay(tuple(t.tolist()), tuple(map(tuple, xy.tolist()))) for t, xy in trajectories]
        world = World(ROOM, [Obstacle(float(r), m) for r, m in zip(trace.obstacle_radius, again)])
        commands = iter(trace.command.tolist())
        replay = run(replace(scenario, world=world), Steer(lambda o, c=commands: tuple(next(c)), True), seed=seed).trace
        for name in ("t", "xy", "velocity", "heading", "sensed", "obstacle_xy"):
            assert getattr(replay, name).tobytes() == getattr(trace, name).tobytes(), name
    assert len(outcomes) >= 3


def test_the_verifier_kills_broken_episodes() -> None:
    """Every way of breaking a legal episode is refused (C8)."""
    disc = Obstacle(0.3, BackAndForth((8.0, 1.0), (8.0, 9.0), (0.3, 0.8), (0.0, 1.0)))
    for seed in range(cases(20, 500)):
        result = run(crossing(disc), Steer(east), seed=seed, horizon=10.0)
        check_episode(result)
        for broken in broken_episodes(result):
            with pytest.raises(InvalidPlan):
                check_episode(broken)


def broken_episodes(result):
    """The episode broken in 37 ways."""
    trace = result.trace

    def bent(name: str, row: int, value) -> dict:
        array = getattr(trace, name).copy()
        array[row] = value
        return {name: array}

    n = len(trace)
    through = trace.timeline.knot_xy.copy()
    through[:] = trace.xy[n // 2]
    breaks = [
        bent("xy", 5, (3.0, 3.0)),
        bent("xy", 0, (1.0, 5.5)),
        bent("xy", 7, math.nan),
        bent("t", 9, 0.85),
        bent("t", 3, 0.2),
        bent("velocity", 4, (3.0, 0.0)),
        {"outcome": Outcome.REACHED},
        {"outcome": Outcome.HIT_STANDING},
        {"outcome": Outcome.HIT_WALL},
        {"command": trace.command[:-1]},
        {"timeline": replace(trace.timeline, knot_xy=through)},
        {"task": replace(trace.task, robot=replace(trace.task.robot, v_max=0.5))},
        {"task": replace(trace.task, robot=replace(trace.task.robot, a_max=0.5))},
        {"task": replace(trace.task, robot=replace(trace.task.robot, radius=6.0))},
        {"task": replace(trace.task, goal=tuple(trace.xy[n // 2].tolist()))},
        {"outcome": Outcome.TIMEOUT, "config": {"horizon": 50.0}},
        {"decisions": ((n + 1, Decision("follow", "late")),)},
        {"decisions": trace.decisions * 2},
        {"outcome": Outcome.ERROR, "config": {"horizon": 50.0}},
        {"command": np.zeros((n, 2))},
        {"command": np.full((n, 2), math.nan)},
        {"heading": trace.heading + 1.0},
        bent("heading", 0, 0.1),
        bent("heading", n, 0.1),
        bent("velocity", 0, (0.5, 0.0)),
        bent("turn_rate", n // 2, 0.3),
        {"cycle_ms": trace.cycle_ms - 1000.0},
        {"sensed": ~trace.sensed},
        bent("sensed", n, ~trace.sensed[n]),
        {"task": replace(trace.task, robot=replace(trace.task.robot, sensor_range=0.1))},
    ]
    yield from (replace(trace, **change) for change in breaks)
    wrong = ({"time": 3.0}, {"length": 1.0}, {"min_clearance": 9.0}, {"seed": 501}, {"trace": None})
    wrong += ({"replans": 1}, {"waits": 3})
    yield from (replace(result, **change) for change in wrong)


def test_the_verifier_compares_jumping_speeds_with_commands() -> None:
    """A differential drive in steps turns, then drives; a holonomic robot with inertia points where it goes."""
    angles = np.random.default_rng(1).uniform(-3.0, 3.0, 30)
    for robot in (RobotSpec(drive="differential", a_max=2.0, dynamics="steps"), RobotSpec(a_max=2.0, brake_max=1.0)):
        around = Steer(lambda o: (math.cos(angles[round(10 * o.t)]), math.sin(angles[round(10 * o.t)])))
        trace = run(crossing(robot=robot), around, horizon=3.0).trace
        check_episode(trace)
        for row in (3, 17):
            command, heading = trace.command.copy(), trace.heading.copy()
            command[row] *= -1.0
            heading[row] += 0.1
            for wrong in ({"command": command}, {"heading": heading}):
                with pytest.raises(InvalidPlan, match="command"):
                    check_episode(replace(trace, **wrong))


SCRIPT = """
import sys
sys.path[:0] = [{tests!r}]
from test_episode import random_scenario, digests
print("\\n".join(digests({policy!r})))
"""


def digests(policy: str) -> list[str]:
    out = []
    for seed in (0, 1, 3, 4, 6, 8):
        try:
            out.append(run(random_scenario(seed), policy, seed=seed, horizon=10.0).trace.digest())
        except BadScenario as error:
            out.append(str(error))
    return out


@pytest.mark.parametrize("policy", ["paper", "antway"])
def test_two_processes_give_the_same_bytes(tmp_path: Path, policy: str) -> None:
    """C30: a process with another hash seed, time zone, locale and directory, at night kernels compiled anew: identical traces.

    tests/golden/traces.json has bytes of both policies from another compilation.
    """
    here = digests(policy)
    assert sum(len(d) == 64 for d in here) >= 5
    env = os.environ | {"PYTHONHASHSEED": "77", "TZ": "Asia/Tokyo", "LC_ALL": "C"}
    if SCALE > 1:
        env["NUMBA_CACHE_DIR"] = str(tmp_path / "cache")
    script = SCRIPT.format(tests=str(Path(__file__).parent), policy=policy)
    there = subprocess.run([sys.executable, "-c", script], cwd=tmp_path, env=env, capture_output=True, text=True, check=True)
    assert there.stdout.split("\n")[:-1] == here


def test_a_policy_that_fails_at_a_start_within_reach_of_the_goal_is_an_error() -> None:
    """The robot is at its goal and never drives; the verifier said that it went on."""

    class Fails(Steer):
        def reset(self, task, seed) -> None:
            raise ValueError("no")

    result = run(Scenario(World(ROOM), (1.0, 1.0), (1.05, 1.0)), Fails(lambda seen: (0.0, 0.0)))
    assert result.outcome is Outcome.ERROR
    check_episode(result)


def test_global_randomness_is_untouched() -> None:
    """C33: an episode moves the states of `random` and `numpy.random` not; test_numbers.py asks every public function."""
    random.seed(1)
    np.random.seed(1)  # noqa: NPY002
    before = random.getstate(), np.random.get_state()[1].tobytes()  # noqa: NPY002
    run(random_scenario(0), "paper", horizon=5.0)
    stream(np.uint64(1), np.uint64(2))
    assert (random.getstate(), np.random.get_state()[1].tobytes()) == before  # noqa: NPY002


def test_importing_antway_is_light() -> None:
    """C33: `import antway` brings neither numba nor matplotlib nor scipy, sets up no logging and writes no file."""
    code = "import sys, antway, logging; assert not logging.root.handlers; " + (
        "print([m for m in ('numba', 'matplotlib', 'scipy', 'PIL', 'yaml', 'typer') if m in sys.modules])"
    )
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]" and antway.__version__


def test_the_least_clearance_may_be_where_an_obstacle_turns() -> None:
    """An obstacle that turns back between two moments at which the check looks was farther away at both."""
    turns = Waypoints(((5.25, 3.5), (5.25, 1.2), (5.25, 3.5)), speed=0.75)
    world = World(Grid(np.zeros((40, 200), bool), resolution=0.1), (Obstacle(0.2, turns),))
    robot = RobotSpec(radius=0.25, drive="differential", v_max=2.0, a_max=1.0, turn_rate=2.0, alpha_max=3.0, dt=0.2)
    result = run(Scenario(world, (1.0, 0.5), (9.0, 0.5), robot, horizon=60.0), "follow", seed=25)
    check_episode(result)
    with pytest.raises(InvalidPlan, match="min_clearance"):
        check_episode(replace(result, min_clearance=result.min_clearance + 2e-4))


def test_without_a_command_a_robot_with_latency_is_told_that_it_is_to_stop() -> None:
    """No command means to stop, also among those that do not act yet: policy antway used to end in an error."""
    pending = []

    class Late(type(make_policy("antway"))):
        def act(self, observation):
            pending.append(observation.pending.tolist())
            return None if observation.t < 0.25 else super().act(observation)

        def explain(self):
            return Decision("wait", "not yet")

    result = run(Scenario(World(ROOM), (1.0, 5.0), (3.0, 5.0), RobotSpec(a_max=1.0, latency=0.2)), Late())
    assert result.reached and pending[:4] == [[[0.0, 0.0], [0.0, 0.0]]] * 4
    check_episode(result)
