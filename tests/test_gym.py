"""The environment for Gymnasium keeps Gymnasium's rules and plays the simulator's episodes."""

from __future__ import annotations

import math
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from antway import BadParameter, Outcome, load_scenario
from antway.arena.gym import CrossingEnv

ID = "antway.arena.gym:antway/Crossing-v0"


def test_the_environment_passes_gymnasiums_own_checker() -> None:
    """`check_env` raises and warns of nothing."""
    check_env(gymnasium.make(ID).unwrapped)


def test_same_seed_same_bytes() -> None:
    """Two environments with one seed and the same actions agree bit for bit over several episodes."""

    def play() -> bytes:
        env, rng, parts = gymnasium.make(ID), np.random.default_rng(1), []
        seen, _ = env.reset(seed=5)
        for _ in range(300):
            parts += [part.tobytes() for part in seen.values()]
            seen, reward, terminated, truncated, _ = env.step(rng.uniform(-1, 1, 2).astype(np.float32))
            parts.append(np.float64(reward).tobytes())
            if terminated or truncated:
                seen, _ = env.reset()
        return b"".join(parts)

    assert play() == play()


def test_terminated_and_truncated_mean_what_gymnasium_says() -> None:
    """A contact or the goal terminates with its reward; the horizon truncates; then only reset helps."""
    env = gymnasium.make(ID, group="open/low").unwrapped
    ends = set()
    for seed in range(12):
        seen, info = env.reset(seed=seed)
        assert info["group"] == "open/low"
        done = False
        while not done:
            goal = seen["robot"][:2] * (seed % 3 != 0)  # every third robot stands still
            action = goal / max(np.hypot(*goal), 1.0)
            seen, reward, terminated, truncated, info = env.step(action.astype(np.float32))
            done = terminated or truncated
        outcome = Outcome(info["outcome"])
        assert truncated == (outcome is Outcome.TIMEOUT) and terminated != truncated
        assert reward == {Outcome.TIMEOUT: 0.0, Outcome.REACHED: 1.0}.get(outcome, -0.25)
        ends.add(outcome)
        with pytest.raises(gymnasium.error.ResetNeeded):
            env.step(np.zeros(2, np.float32))
    assert len(ends) >= 3


def test_observations_are_the_nearest_tracks_and_the_walls() -> None:
    """Tracks come nearest first and within sensor range; walls are never nearer than they are."""
    env = gymnasium.make(ID, group="aisles/high", tracks=3).unwrapped
    counts = []
    for seed in range(10):
        seen, _ = env.reset(seed=seed)
        rows = seen["tracks"][seen["tracks"][:, 5] == 1.0]
        gaps = np.hypot(rows[:, 0], rows[:, 1]) - rows[:, 4]
        assert (np.diff(gaps) >= 0).all() and (np.hypot(rows[:, 0], rows[:, 1]) <= 4.0 + rows[:, 4]).all()
        counts.append(len(rows))
        task = env.stage.task
        clearance = task.grid.clearance()[task.grid.cell_at(task.start)] - task.robot.radius
        assert (seen["walls"] >= min(clearance, 4.0) - 1e-6).all() and seen["walls"].max() <= 4.0
    assert max(counts) == 3


def test_wrong_options_are_refused() -> None:
    """Typed errors name them."""
    with pytest.raises(BadParameter, match="group"):
        gymnasium.make(ID, group="closed")
    with pytest.raises(BadParameter, match="tracks"):
        gymnasium.make(ID, tracks=0)


def test_an_action_is_two_numbers() -> None:
    """Three were taken for two, and one was an IndexError; NaN brakes."""
    env = CrossingEnv(scenario="office")
    env.reset(seed=1)
    for wrong in (np.zeros(3), [1.0], "ab", None, 0.5):
        with pytest.raises(BadParameter, match="action"):
            env.step(wrong)  # type: ignore[arg-type]
    for action in ((1.0, 0.0), (math.nan, 0.0)):
        env.step(np.array(action, np.float32))
    assert env.stage is not None and env.stage.velocity[1:3].tolist() == [[1.0, 0.0], [0.0, 0.0]]


def test_own_scenarios_wheels_and_pictures() -> None:
    """A scenario of one's own is played, by a robot of one's own whose actions are speed and turn rate; pictures show it."""
    env = gymnasium.make(ID, scenario="office", robot="turtlebot4", render_mode="rgb_array").unwrapped
    check_env(env, skip_render_check=True)
    _, info = env.reset(seed=2)
    assert info["group"] == "office"
    before = env.stage.heading[0]
    first = env.render()
    for _ in range(30):
        seen, *_ = env.step(np.array([0.2, 1.0], np.float32))
    assert seen["robot"].shape == (6,) and abs(env.stage.heading[env.stage.n] - before) > 0.5
    later = env.render()
    assert first.dtype == np.uint8 and first.shape[2] == 3 and min(first.shape[:2]) > 200 and not np.array_equal(first, later)
    with pytest.raises(BadParameter, match="group"):
        gymnasium.make(ID, scenario="office", group="open/low")
    with pytest.raises(BadParameter, match="stops"):
        gymnasium.make(ID, scenario="rounds")
    with pytest.raises(BadParameter, match="render_mode"):
        CrossingEnv(render_mode="loud")


def test_a_velocity_that_is_not_measured_is_zero() -> None:
    """Observations of sensors without velocities are in their space."""
    place = load_scenario("office")
    env = CrossingEnv(scenario=replace(place, sensor=replace(place.sensor, velocity="none")))
    seen, _ = env.reset(seed=2)
    assert env.observation_space.contains(seen)


def test_a_large_robot_gets_worlds_into_which_it_fits() -> None:
    """As in suites, another world is drawn where it does not fit at both ends."""
    environment = CrossingEnv(robot="amr")
    for seed in range(40):
        environment.reset(seed=seed)
