"""Work on large maps is done beside the control cycles, and changes nothing but when its result is used."""

from __future__ import annotations

import copy
import math
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from antway import EpisodeResult, Task, check_episode, run
from antway.policies.antway import beside
from antway.policies.antway.beside import Beside
from antway.policies.antway.policy import AntwayPolicy
from antway.world.policy import Observation, Tracks
from antway.world.robots import load_robot
from test_detours import STANDS, scenario, two_doors
from test_response import CHANGES, DIFF, Misled


def test_a_result_is_due_after_a_time_that_the_map_decides() -> None:
    """Small work is done at once; a thread does large work."""
    asked: list[str] = []

    def work() -> str:
        asked.append(threading.current_thread().name)
        return "done"

    here = threading.current_thread().name
    assert Beside(beside._AT_ONCE, 3.0, work).due == 3.0 and asked == [here]
    later = Beside(10**6, 3.0, work)
    assert later.due == 3.0 + 10**6 / beside._PACE and later.result() == "done" and asked[1] != here
    assert copy.deepcopy(later).result() == "done" and copy.deepcopy(later).due == later.due


def test_what_goes_wrong_beside_is_raised() -> None:
    """By the control cycle in which the result is due."""

    def work() -> None:
        raise ValueError("broken")

    with pytest.raises(ValueError, match="broken"):
        Beside(10**6, 0.0, work).result()


def test_commands_are_given_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """The robot goes on by what it knows while other times to the goal are computed, however long that takes."""
    monkeypatch.setattr(beside, "_AT_ONCE", 0)
    go_on, policy = threading.Event(), AntwayPolicy()
    task = Task(two_doors(), load_robot("diff"), (3.0, 4.0), (13.1, 4.1))
    policy.reset(task, seed=0)
    slow = beside.Beside._run
    monkeypatch.setattr(beside.Beside, "_run", lambda self, work: (go_on.wait(60.0), slow(self, work)))
    tracks = Tracks(np.array([1]), np.array([[8.0, 2.6]]), np.zeros((1, 2)), np.array([0.3]))
    pending = []
    for k in range(60):
        policy.act(Observation(0.1 * k, task.start, (0.0, 0.0), 0.0, tracks))
        pending.append(policy._beside is not None)
        if pending[-1]:
            assert policy._beside is not None
            policy._beside.due = 5.5
            if k == 54:
                go_on.set()
    assert pending.count(True) > 10 and not pending[-1]
    assert policy.state is not None and policy.state.detours.expects


def test_a_robot_that_turns_out_to_be_slow_meanwhile_is_planned_for_then(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its top speed used to be forgotten if it was learnt while times for a detour were computed."""
    monkeypatch.setattr(beside, "_AT_ONCE", 0)
    policy, task = AntwayPolicy(learns_response=False), Task(two_doors(), load_robot("diff"), (3.0, 4.0), (13.1, 4.1))
    policy.reset(task, seed=0)
    tracks = Tracks(np.array([1]), np.array([[8.0, 2.6]]), np.zeros((1, 2)), np.array([0.3]))
    s, slower = policy.state, replace(task.robot, v_max=0.5 * task.robot.v_max)
    assert s is not None
    for k in range(60):
        policy.act(Observation(0.1 * k, task.start, (0.0, 0.0), 0.0, tracks))
        if policy._beside is not None and s.task.robot is task.robot:
            s.response.robot = slower
            policy._suit_response(0.1 * k)
            assert policy.state is s, "other times are still being computed"
    assert policy.state is not None and policy.state.detours.expects and policy._beside is None
    assert policy.state.task.robot == slower and policy.state.context.speed == slower.v_max


def test_a_car_has_more_to_compute(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has times to the goal in each heading, so a thread computes its detours on a map that is small for others."""
    monkeypatch.setattr(beside, "_AT_ONCE", 30_000)
    late: dict[str, list[bool]] = {}
    car = replace(load_robot("diff"), drive="ackermann", turning_radius=0.8)
    for name, robot in (("diff", load_robot("diff")), ("car", car)):
        policy, task = AntwayPolicy(), Task(two_doors(), robot, (3.0, 4.0), (13.1, 4.1))
        policy.reset(task, seed=0)
        tracks = Tracks(np.array([1]), np.array([[8.0, 2.6]]), np.zeros((1, 2)), np.array([0.3]))
        late[name] = []
        for k in range(45):
            policy.act(Observation(0.1 * k, task.start, (0.0, 0.0), 0.0, tracks))
            late[name].append(policy._beside is not None)
        assert policy.state is not None and policy.state.detours.expects
    assert any(late["car"]) and not any(late["diff"])


def played(make: Callable[[], EpisodeResult], monkeypatch: pytest.MonkeyPatch, pace: float) -> list[EpisodeResult]:
    """Play an episode as usual, and twice with all work done beside the cycles."""
    results = [make()]
    monkeypatch.setattr(beside, "_AT_ONCE", 0)
    monkeypatch.setattr(beside, "_PACE", pace)
    results += [make(), make()]
    for result in results:
        check_episode(result)
    np.testing.assert_array_equal(results[1].trace.xy, results[2].trace.xy)
    return results


def test_a_detour_is_taken_a_little_later(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the second of two runs as by the first, although a thread takes as long as it likes."""
    usual, later, _ = played(lambda: run(scenario("holonomic", STANDS), "antway", seed=0), monkeypatch, 1e4)
    assert usual.reached and later.reached and later.time < usual.time + 15.0


@pytest.mark.parametrize("pace", [math.inf, 1e4])
def test_a_robot_that_turns_out_to_be_slow_is_planned_for_a_little_later(pace: float, monkeypatch: pytest.MonkeyPatch) -> None:
    """With results that are due at once all is as usual."""
    slow, policies = CHANGES["slow"], []

    def make() -> EpisodeResult:
        policies.append(AntwayPolicy())
        return run(
            replace(scenario("diff", STANDS, horizon=12.0), robot=slow.of(DIFF)), Misled(policies[-1], DIFF, slow), seed=0
        )

    usual, later, _ = played(make, monkeypatch, pace)
    if pace == math.inf:
        np.testing.assert_array_equal(usual.trace.xy, later.trace.xy)
    for policy in policies:
        assert policy.state is not None
        assert policy.state.context.speed == policy.state.task.robot.v_max == pytest.approx(0.7, abs=0.01)
