"""The shipped contract test passes what antway ships, and names each way of breaking the contract."""

from __future__ import annotations

import math
import random
import time
from dataclasses import replace

import numpy as np
import pytest

from antway import Command, Observation, Outcome, RobotSpec, load_scenario, run, solve
from antway.baselines.replan import Follow
from antway.conformance import check_planner, check_policy
from antway.errors import BadParameter, InvalidPlan
from antway.planning import PLANNERS, Budget, Plan, Status, find
from antway.policies.guard import Guarded
from antway.tables import SHIPPED_SCENES
from antway.world.policy import POLICIES, make_policy


@pytest.mark.parametrize("name", POLICIES)
def test_policies_keep_the_contract(name):
    """Every policy keeps the contract."""
    check_policy(lambda: make_policy(name), seconds=30.0)


@pytest.mark.parametrize("name", POLICIES)
def test_policies_set_out_in_every_shipped_scene(name):
    """Within the first second every policy drives somewhere, on coarse maps and fine ones."""
    for scene in SHIPPED_SCENES:
        assert run(replace(load_scenario(scene), horizon=1.0), name).length > 0.2, scene


@pytest.mark.parametrize("name", PLANNERS)
def test_planners_keep_the_contract(name):
    """Every planner keeps the contract."""
    check_planner(find("planner", name, PLANNERS, ""))


class Remembers(Follow):
    count = 0

    def act(self, observation):
        self.count += 1
        return super().act(observation) if self.count < 100 else Command((0.0, 0.0))


class Unseeded(Follow):
    def act(self, observation):
        vx, vy = super().act(observation).velocity
        return Command((vx * Unseeded.chance.uniform(0.9, 1.0), vy))

    chance = random.Random(3)


class Global(Follow):
    def act(self, observation):
        np.random.default_rng(0)
        random.random()
        return super().act(observation)


class Slow(Follow):
    def act(self, observation):
        time.sleep(0.02 if 0.95 < observation.t < 1.05 else 0.0)
        return super().act(observation)


class NoNan(Follow):
    def act(self, observation):
        vx = observation.tracks.velocity.sum() * 1e-9
        return Command((vx, 0.1))


class Empty(Follow):
    def act(self, observation):
        if observation.stamp == -math.inf:
            raise ValueError("the sensor has not begun")
        return super().act(observation)


class Turns(Follow):
    def act(self, observation):
        return Command(twist=(0.5, 0.1))


class InPlace(Follow):
    def act(self, observation):
        observation.tracks.xy[:] -= observation.xy
        return super().act(observation)


class Cleans(Follow):
    def act(self, observation):
        np.nan_to_num(observation.tracks.velocity, copy=False)
        return super().act(observation)


class Widens(Follow):
    def act(self, observation):
        observation.tracks.radius[:] = 9.0
        return super().act(observation)


class Once(Follow):
    episodes = 0

    def reset(self, task, seed):
        self.episodes += 1
        if self.episodes > 1:
            raise RuntimeError("it is spent")
        super().reset(task, seed)


class Blocked(Follow):
    def act(self, observation):
        raise RuntimeError("it is in the way")


class Silent(Follow):
    def act(self, observation):
        super().act(observation)


@pytest.mark.parametrize(
    ("kind", "printed"),
    [
        (Silent, "commands: not all of them are finite"),
        (Remembers, "reset"),
        (Unseeded, "seeding"),
        (Global, "global state"),
        (Slow, "time limit"),
        (NoNan, "NaN"),
        (Empty, "no scan yet: ValueError"),
        (Turns, "command.twist = .* left out for a robot without wheels"),
        (InPlace, "no scan yet: it changes the observation|an old scan: it changes the observation"),
        (Cleans, "^NaN: unknown velocities: it changes the observation, which others use as well$"),
        (Widens, "NaN: unknown velocities: it changes .*an old scan: it changes .*an obstacle in contact: it changes"),
        (Once, "reset: a second episode differs from the first: .*it is spent"),
        (Blocked, "fails in a room with a wall and two moving discs: .*it is in the way"),
    ],
)
def test_breaches_are_named(kind, printed):
    """A policy that breaks the contract in one way is told which."""
    with pytest.raises(InvalidPlan, match=printed):
        check_policy(kind, seconds=0.01 if kind is Slow else 30.0)


@pytest.mark.parametrize("make", [Turns, lambda: Guarded(Turns())])
def test_a_twist_alone_is_refused_where_wheels_move_in_steps(make):
    """They take a velocity: a robot with such a policy stood still without a word."""
    driven = replace(load_scenario("paper"), robot=RobotSpec(drive="differential", dynamics="steps"))
    result = run(driven, make(), horizon=0.3)
    assert (
        result.outcome is Outcome.ERROR
        and 'command.twist = (0.5, 0.1): must be left out for the dynamics "steps"' in result.reason
    )


@pytest.mark.parametrize("wrong", ["antway", Follow()])
def test_what_makes_no_policy_is_refused(wrong):
    """It was a TypeError without a word of what to give."""
    with pytest.raises(BadParameter, match="a function that returns a new policy"):
        check_policy(wrong)


def test_what_cannot_be_made_is_told_as_a_fault():
    """Whatever it raised, such as a TypeError for a missing argument, ended the check; so did what is made only once."""
    made = []

    def once():
        made.append(Follow() if not made else made[9])
        return made[0]

    for make, words in ((Sealed, "TypeError: .*secret"), (once, "IndexError: list index out of range")):
        with pytest.raises(InvalidPlan, match=f"it cannot be made: {words}"):
            check_policy(make)
    with pytest.raises(BadParameter, match="a policy with the methods"):
        check_policy(dict)


class Sealed(Follow):
    """A policy that takes an argument, which nobody gives here."""

    def __init__(self, secret):
        self.secret = secret


def test_a_time_limit_that_is_none_is_refused():
    """Nothing is slower than NaN s."""
    with pytest.raises(BadParameter, match="seconds"):
        check_policy(Follow, seconds=math.nan)


def test_a_planner_that_lies_is_caught():
    """A planner that says there is no path where there is one, and global randomness, are caught."""

    def lies(problem, *, seed=0, budget=None):
        random.random()
        return Plan(Status.NO_PATH)

    with pytest.raises(InvalidPlan) as caught:
        check_planner(lies)
    assert len(caught.value.violations) == 3
    with pytest.raises(InvalidPlan, match="it returns None, not a Plan"):
        check_planner(lambda problem, *, seed, budget: None)
    for wrong in (lambda problem: None, min, 5):
        with pytest.raises(InvalidPlan, match="cannot be called as planner"):
            check_planner(wrong)


def test_what_raises_or_is_no_command_is_told_as_a_fault() -> None:
    """A planner or policy of a third party that breaks the rules never ends the check by an error of its own."""

    def planner(problem, *, seed=0, budget=Budget()):
        if problem.start == problem.goal:
            raise ValueError("start is goal")
        return solve(problem, "jps")

    with pytest.raises(InvalidPlan, match="it raises ValueError: start is goal"):
        check_planner(planner)
    for wrong in ((0.0, 0.0), Command(("a", 0.0))):  # type: ignore[arg-type]

        class Odd(Follow):
            def act(self, observation: Observation, wrong: object = wrong) -> Command:
                return Command((0.0, 0.0)) if observation.stamp != -math.inf else wrong  # type: ignore[return-value]

        with pytest.raises(InvalidPlan, match="no scan yet: BadParameter: command"):
            check_policy(Odd)
