"""Faults of sensor, clock and policy under the guard (C26), and robots that go on once the way clears (C28)."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from antway import Grid, Outcome, RobotSpec, Scenario, World, check_episode, make_policy, run
from antway.planning import TimedPath
from antway.policies.guard import Guarded
from antway.world.motions import BackAndForth, Line
from antway.world.policy import Command, Decision, Observation, Task, Tracks
from antway.world.trace import Trace
from antway.world.world import Obstacle
from common import cases, costly

HALL = Grid(np.zeros((24, 40), dtype=bool), 0.25)
AT, TIMEOUT = 2.0, 0.5  # s; when the fault sets in, and the guard's patience
NOISE = 0.02  # m, said of places; three times as much is done to them
STOPS = ("blackout", "stale stamp", "clock ahead", "clock back", "slow", "nothing", "nan", "exception")
CARRIES_ON = ("dropped", "duplicated", "reordered", "noise")


def pick(tracks: Tracks, rows: np.ndarray) -> Tracks:
    return Tracks(tracks.id[rows], tracks.xy[rows], tracks.velocity[rows], tracks.radius[rows])


class Faulty:
    """A guarded policy whose observations, or whose commands on the way to the guard, go wrong from `AT` on."""

    def __init__(self, policy: str, fault: str, seed: int) -> None:
        self.inner, self.fault, self.rng = make_policy(policy), fault, np.random.default_rng(seed)
        self.guarded = Guarded(self)
        self.outer = True

    def reset(self, task, seed) -> None:
        if self.outer:
            self.outer = False
            self.guarded.reset(task, seed)
            self.outer = True
        else:
            self.inner.reset(task, seed)

    def act(self, o):
        if self.outer:
            self.outer = False
            try:
                return self.guarded.act(self.spoil(o))
            finally:
                self.outer = True
        command = self.inner.act(o)
        if o.t >= AT:
            if self.fault == "exception":
                raise RuntimeError("the planner broke")
            if self.fault in ("slow", "nothing"):  # ten cycles over time: nothing arrives meanwhile
                return None if self.fault == "nothing" or round(o.t / 0.1) % 10 else command
            if self.fault == "nan":
                return Command((math.nan, 0.0))
        return command

    def explain(self):
        return replace(self.inner.explain(), guard=self.guarded.guard.did)

    def spoil(self, o):
        n, tracks = len(o.tracks), o.tracks
        if o.t < AT:
            self.last = o
            return replace(o, stamp=o.t)
        return {
            "blackout": lambda: replace(o, stamp=self.last.t, tracks=self.last.tracks),
            "stale stamp": lambda: replace(o, stamp=o.t - 1.0),
            "clock ahead": lambda: replace(o, t=o.t + 3600.0, stamp=o.t),
            "clock back": lambda: replace(o, t=o.t - 1.5, stamp=o.t - 1.5) if o.t < AT + 1.4 else replace(o, stamp=o.t - 9.0),
            "dropped": lambda: replace(o, tracks=pick(tracks, np.flatnonzero(self.rng.random(n) < 0.5))),
            "duplicated": lambda: replace(o, tracks=pick(tracks, np.repeat(np.arange(n), 2))),
            "reordered": lambda: replace(o, tracks=pick(tracks, self.rng.permutation(n))),
            "noise": lambda: replace(o, tracks=self.noisy(tracks)),
        }.get(self.fault, lambda: o)()

    def noisy(self, tracks: Tracks) -> Tracks:
        """Places three times as far off as their covariance says."""
        covariance = np.zeros((len(tracks), 4, 4))
        covariance[:, [0, 1], [0, 1]] = NOISE**2
        return replace(tracks, xy=tracks.xy + self.rng.normal(0.0, 3 * NOISE, tracks.xy.shape), covariance=covariance)


def hall(seed: int) -> Scenario:
    discs = [Obstacle(0.3, BackAndForth((x, 0.4), (x, 5.6), (0.3, 0.5), (0.0, 1.0))) for x in (4.0, 6.5)]
    robot = RobotSpec(a_max=[math.inf, 2.0][seed % 2])
    return Scenario(World(HALL, discs), (1.1, 3.1), (9.1, 3.1), robot, horizon=30.0, obstacle_speed=0.6)


@pytest.mark.parametrize("policy", ["paper", "antway"])
@pytest.mark.parametrize("fault", STOPS + CARRIES_ON)
def test_faults_stop_the_robot_or_do_no_harm(fault: str, policy: str) -> None:
    """The robot stands within timeout + braking, never moves into a contact, and the record names what was wrong (C26).

    Places that are farther off than the sensor says are outside what the guard promises: there the robot may be met moving.
    """
    for seed in range(cases(3, 50)):
        scenario = hall(seed)
        horizon = 6.0 if fault in STOPS else 30.0
        result = run(scenario, Faulty(policy, fault, seed), seed=seed, horizon=horizon)
        check_episode(result)
        assert result.outcome is not Outcome.HIT_WALL
        assert result.outcome is not Outcome.HIT_MOVING or fault == "noise"
        stop = 0.0 if math.isinf(scenario.robot.a_max) else scenario.robot.stop_time
        late = result.trace.t[1:] > AT + TIMEOUT + stop + 2.5 * scenario.robot.dt
        speed = np.hypot(*result.trace.velocity[1:].T)
        if fault == "exception":
            assert result.outcome is Outcome.ERROR and "the planner broke" in result.reason
        elif fault == "slow":
            assert result.outcome in (Outcome.TIMEOUT, Outcome.HIT_STANDING)
            assert speed[late].mean() < 0.3 if late.any() else True
        elif fault in STOPS:
            assert result.outcome in (Outcome.TIMEOUT, Outcome.HIT_STANDING)
            assert (speed[late] < 1e-6).all()
            assert result.trace.decisions[-1][1].guard == "braked"


@pytest.mark.parametrize("policy", ["paper", "antway"])
def test_the_robot_goes_on_within_two_seconds_once_the_way_clears(policy: str) -> None:
    """A gate closed by a disc that then leaves for good: the robot that waited moves on within 2 s (C28)."""
    blocked = np.zeros((24, 40), dtype=bool)
    blocked[:10, 18:22] = blocked[14:, 18:22] = True
    for seed in range(costly(5, 100)):
        delay = 10.0 + 0.37 * seed
        gate = Obstacle(0.45, Line((5.0, 3.0), (9.4, 0.6), 1.0, delay))
        scenario = Scenario(World(Grid(blocked, 0.25), [gate]), (1.1, 3.1), (9.1, 4.6), horizon=60.0, through_walls=True)
        result = run(scenario, policy, seed=seed)
        check_episode(result)
        moving = np.hypot(*result.trace.velocity[1:].T) > 0.1
        since = result.trace.t[1:]
        clears = delay + 4.5 / 1.0 / 2  # it has left the gate by then
        assert result.reached and not moving[(since > 8.0) & (since < delay)].all()
        assert moving[(since > clears) & (since < clears + 2.0)].any()


@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("robot", [RobotSpec(sensor_range=20.0), RobotSpec(drive="differential", a_max=1.0, alpha_max=3.0)])
def test_a_scan_of_never_after_others_is_the_last_one(robot: RobotSpec, named: bool) -> None:
    """A stamp of -inf says that nothing was sensed yet; among tracks, predictions from then until now took for ever."""
    for seed in range(cases(3, 100)):
        rng, policy = np.random.default_rng(seed), make_policy("antway")
        policy.reset(Task(Grid(np.zeros((60, 60), bool), 0.2), robot, (1.0, 1.0), (11.0, 11.0), obstacle_speed=1.0), seed)
        places = rng.uniform(2.0, 11.0, (5, 2))
        for k in range(36):
            if k % 6 == 0:
                way = rng.uniform(-math.pi, math.pi, 5)
                velocities = 0.75 * np.column_stack((np.cos(way), np.sin(way)))
            places = places + 0.1 * velocities
            x = 1.0 + 0.07 * min(k, 25)
            seen = Observation(
                0.1 * k, (x, x), (0.7, 0.7), math.pi / 4, Tracks(np.arange(5), places, velocities, np.full(5, 0.25))
            )
            if k >= 25:
                seen = replace(seen, tracks=seen.tracks if named else Tracks.none(), stamp=-math.inf)
            command = policy.act(seen)
            speed = math.hypot(*(command.twist or command.velocity))
            assert math.isfinite(speed) and (speed == 0.0 or k < 31), "after half a second the sensor counts as silent"


ODD = {
    "local_target": (math.nan, 1.0),
    "pheromone": (0, 0, np.zeros((3, 3))),
    "predicted": np.zeros((2, 7)),
    "history": np.zeros((2, 3)),
    "encounter": None,
    "guard": None,
    "gap": None,
    "path": TimedPath(np.arange(2.0), np.array([[math.nan, 0.0], [1.0, 1.0]])),
}


@pytest.mark.parametrize("field", ODD)
def test_a_decision_that_no_file_can_hold_ends_the_episode(field: str, tmp_path: Path) -> None:
    """Else the trace would be written, and could not be read."""

    class Odd:
        def reset(self, task: Task, seed: int) -> None: ...

        def act(self, observation: Observation) -> Command:
            return Command((0.5, 0.0))

        def explain(self) -> Decision:
            return Decision("follow", "straight ahead", **{field: ODD[field]})

    empty = Scenario(World(Grid(np.zeros((20, 40), dtype=bool), 0.2)), (1.0, 2.0), (7.0, 2.0), horizon=1.0)
    result = run(empty, Odd())
    assert result.outcome is Outcome.ERROR and f"decision.{field}" in result.reason
    result.trace.save(tmp_path / "trace.json")
    assert len(Trace.load(tmp_path / "trace.json")) == len(result.trace)
