"""Robots with wheels, inertia, latency, footprints in whole episodes: checked, kept in files, refused if wrong."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from antway import (
    BadInput,
    BadParameter,
    Command,
    Decision,
    Grid,
    Observation,
    Outcome,
    RobotSpec,
    Scenario,
    Tracks,
    World,
    check_episode,
    make_policy,
    run,
)
from antway.arena.suites import SuiteEpisode, build, episodes
from antway.errors import InvalidPlan
from antway.kernels.base.records import RobotState
from antway.kernels.robot.motion import drive_cycle
from antway.policies.guard import Guarded
from antway.world.motions import Bounce, Replay
from antway.world.robots import ROBOTS, load_robot, towards
from antway.world.trace import Trace
from antway.world.world import Obstacle
from common import cases, costly

EXTRA = {
    "tricycle": RobotSpec(drive="ackermann", a_max=1.0, turning_radius=0.6, v_reverse=0.3, alpha_max=4.0, latency=0.13),
    "slider": RobotSpec(a_max=1.0, brake_max=2.0, latency=0.05, footprint=((-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2))),
}
EVERY = {name: spec for name, (spec, _) in ROBOTS.items()} | EXTRA


class Wanderer:
    """Random twists and velocities, each for a while."""

    def reset(self, task, seed):
        self.task, self.rng = task, np.random.default_rng(seed)
        self.command = Command()

    def act(self, o):
        if self.rng.random() < 0.2:
            v, w, angle = self.rng.uniform(-0.5, 1.5), self.rng.uniform(-3, 3), self.rng.uniform(0, 6.3)
            twist = (float(v), float(w)) if self.task.robot.wheels and self.rng.random() < 0.7 else None
            self.command = Command((math.cos(angle), math.sin(angle)), twist)
        return None if self.rng.random() < 0.03 else self.command

    def explain(self):
        return Decision("follow", "wanders")


class Turning(Wanderer):
    """Turns on the spot."""

    def act(self, o):
        return Command(twist=(0.0, 1.0))


def hall(rng: np.random.Generator, robot: RobotSpec, discs: int = 4) -> Scenario:
    blocked = np.zeros((40, 40), dtype=bool)
    blocked[10:13, 8:20] = blocked[26:30, 20:34] = True
    obstacles = []
    while len(obstacles) < discs:
        xy = rng.uniform(1.0, 9.0, 2)
        if math.dist(xy, (5.0, 5.0)) > 2.0 and not blocked[int(xy[1] / 0.25) - 1 : int(xy[1] / 0.25) + 2].any():
            obstacles.append(Obstacle(0.25, Bounce(tuple(xy.tolist()), 0.6, float(rng.uniform(-3, 3)))))
    world = World(Grid(blocked, 0.25), tuple(obstacles))
    return Scenario(world, (5.0, 5.0), (9.0, 9.0), robot=robot, horizon=15.0, obstacle_speed=0.6)


@pytest.mark.parametrize("name", EVERY)
def test_what_is_played_passes_the_check(name: str, tmp_path: Path) -> None:
    """Wild episodes of every robot, with and without a guard, pass the independent check; traces read back equal."""
    rng = np.random.default_rng(len(name))
    for seed in range(costly(3, 300)):
        for policy in (Wanderer(), Guarded(Wanderer())):
            result = run(hall(rng, EVERY[name]), policy, seed=seed)
            check_episode(result)
            if isinstance(policy, Guarded):
                assert result.outcome.value in ("timeout", "reached", "hit-standing")
    result.trace.save(tmp_path / "trace.json")
    again = Trace.load(tmp_path / "trace.json")
    assert again.digest() == result.trace.digest() and again.task.robot == EVERY[name]
    check_episode(again)


def test_robots_of_every_kind_pass_the_check() -> None:
    """A car's speed, which holds its steering, passes 0 or its target amid a step; rates are infinite now and then."""
    rng = np.random.default_rng(1)
    for seed in range(costly(30, 3000)):
        v, a = rng.uniform(0.3, 2.0), rng.uniform(0.4, 3.0)
        car = RobotSpec(
            drive="ackermann",
            v_max=v,
            v_reverse=v * rng.choice([0.0, 0.3, 1.0]),
            a_max=a if rng.random() < 0.7 else math.inf,
            brake_max=a * rng.uniform(1.0, 2.0) if rng.random() < 0.7 else math.inf,
            turn_rate=rng.uniform(0.8, 4.0),
            alpha_max=rng.choice([2.0, 4.0, math.inf]),
            turning_radius=rng.uniform(0.4, 1.0),
            latency=rng.choice([0.0, 0.1, 0.25]),
            dt=rng.choice([0.05, 0.1, 0.2]),
        )
        check_episode(run(hall(rng, car, 0), Wanderer(), seed=seed))
        slides = replace(car, drive="holonomic", turning_radius=0.0, v_reverse=0.0)
        check_episode(run(hall(rng, slides, 0), Wanderer(), seed=seed))


@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_a_speed_that_is_0_at_the_end_of_a_period_changes_its_sign_in_the_next(radius: float) -> None:
    """Of a car the bound of its steering is 0 at that time, too, and ended the ramp a rounding error before the period."""
    drive = "ackermann" if radius else "differential"
    robot = RobotSpec(drive=drive, turning_radius=radius, brake_max=1.0, v_reverse=0.1, dt=0.05, alpha_max=1e3)
    for k in range(-50, 50):
        state = RobotState(0.0, 0.0, 0.0, 0.05 + 1e-17 * k, 0.0)
        assert abs(drive_cycle(state, -0.06, 0.0, robot.limits, robot.dt).a) < 1e-9, k
        assert drive_cycle(state, -0.06, 0.0, robot.limits, 1.001 * robot.dt).a == -0.06, k


def test_a_car_with_a_long_period_passes_the_check() -> None:
    """The bound of its turn rate is met amid one of the steps, of 2.5 ms each, in which its cycles are driven again."""
    car = RobotSpec(
        drive="ackermann", v_max=1.5, v_reverse=0.3, a_max=0.5, brake_max=1.5, turn_rate=0.4, turning_radius=0.05, dt=1.0
    )
    for seed in range(6, 13):
        check_episode(run(hall(np.random.default_rng(seed), car, 0), Wanderer(), seed=seed))


class Predicts(Wanderer):
    """A wanderer that notes in which state it is told to be when its command begins to act."""

    def reset(self, task, seed):
        super().reset(task, seed)
        self.states = []

    def act(self, o):
        self.states.append(o.state_at_action(self.task.robot))
        return super().act(o)


@pytest.mark.parametrize("name", EVERY)
def test_a_command_begins_to_act_where_the_observation_says(name: str) -> None:
    """The simulator is there two periods later; a footprint without wheels has not turned to where it goes."""
    robot, wanderer = replace(EVERY[name], latency=0.2, dt=0.1), Predicts()
    result = run(hall(np.random.default_rng(5), robot, 0), wanderer, seed=3)
    trace = result.trace
    assert trace is not None and len(trace.t) > 15
    for i, state in enumerate(wanderer.states[: len(trace.t) - 3]):  # the last step may be cut short
        (vx, vy), heading = trace.velocity[i + 2], trace.heading[i + 2]
        speeds = (vx * math.cos(heading) + vy * math.sin(heading), trace.turn_rate[i + 2]) if robot.wheels else (vx, vy)
        there = np.array((*trace.xy[i + 2], heading, *speeds)) - state
        there[2] = math.remainder(there[2], math.tau)
        assert np.abs(there).max() < 1e-9, (i, state)


def test_a_footprint_without_wheels_whose_commands_act_late_passes_crowds(tmp_path: Path) -> None:
    """Rollouts that took it to turn to where it goes had it touched in half of such crowds, among them these."""
    file = tmp_path / "slider.toml"
    file.write_text(
        "v_max = 1.2\na_max = 1.5\nlatency = 0.1\nfootprint = [[-0.35, -0.25], [0.35, -0.25], [0.35, 0.25], [-0.35, 0.25]]"
    )
    named = episodes("synthetic", 1, str(file))[0]
    for number in (13000, 13002, 13004):
        episode = SuiteEpisode("synthetic", named.suite, "open/medium", number, str(file))
        result = run(build(episode), make_policy("antway"), seed=episode.seed)
        check_episode(result)
        assert result.reached, number


class Squarely(Wanderer):
    """Turns its velocity by 60 degrees and halves it: each change is square to the command, as an ant's stop aside may be."""

    def act(self, o):
        (vx, vy), root = o.velocity, math.sqrt(3.0)
        if math.hypot(vx, vy) < 0.1 or self.rng.random() < 0.3:
            angle = self.rng.uniform(0.0, 6.3)
            return Command((math.cos(angle), math.sin(angle)))
        return Command(((vx - root * vy) / 4.0, (vy + root * vx) / 4.0))


def test_ramps_square_to_the_command_pass_the_check() -> None:
    """Whether a speed falls all along such a ramp is for roundings to say, and simulator and check have their own."""
    rng = np.random.default_rng(3)
    robot = RobotSpec(a_max=1.5, brake_max=2.5, dt=0.2)
    for seed in range(cases(5, 200)):
        check_episode(run(hall(rng, robot, 0), Squarely(), seed=seed))


@pytest.mark.parametrize("name", ["diff", "amr", "tricycle", "slider", "inertia", "holonomic"])
def test_the_check_finds_what_is_false(name: str) -> None:
    """A place, a heading, a speed or a command that is not as driven is found."""
    trace = run(hall(np.random.default_rng(1), EVERY[name], 0), Guarded(Wanderer()), seed=1).trace
    check_episode(trace)
    for field in ("xy", "velocity", "command", *(() if not EVERY[name].wheels else ("heading", "turn_rate"))):
        wrong = getattr(trace, field).copy()
        row = len(wrong) // 2
        while field == "command" and not np.isfinite(wrong[row]).all():
            row += 1
        wrong[row] += 0.1 if field != "command" else np.where(wrong[row] > 0, -3.0, 3.0)
        with pytest.raises(InvalidPlan):
            check_episode(replace(trace, **{field: wrong}))
    grid, velocity, row = trace.task.grid, trace.velocity.copy(), len(trace) // 2
    blocked = grid.blocked.copy()
    blocked[grid.cell_at(trace.xy[row])] = True
    with pytest.raises(InvalidPlan, match=r"^passes through a wall"):
        check_episode(replace(trace, task=replace(trace.task, grid=replace(grid, blocked=blocked))))
    velocity[row] += 0.1 * np.array([-math.sin(trace.heading[row]), math.cos(trace.heading[row])])
    if EVERY[name].wheels:
        with pytest.raises(InvalidPlan, match=r"^moves aside, which wheels do not$"):
            check_episode(replace(trace, velocity=velocity))


def test_a_footprint_that_turns_is_moving() -> None:
    """A bar that turns on the spot strikes who stands beside it, and the contact is one of a robot in motion."""
    bar = RobotSpec(drive="differential", footprint=((-0.5, -0.1), (0.5, -0.1), (0.5, 0.1), (-0.5, 0.1)), alpha_max=3.0)
    world = World(Grid(np.zeros((10, 10), bool)), (Obstacle(0.1, Replay((0.0, 1.0), ((5.0, 5.5), (5.0, 5.5)))),))
    result = run(Scenario(world, (5.0, 5.0), (9.0, 5.0), robot=bar, horizon=5.0), Turning())
    assert result.outcome.value == "hit-moving" and result.length == 0.0
    check_episode(result)
    with pytest.raises(InvalidPlan, match="claims hit-standing though the robot was moving"):
        check_episode(replace(result.trace, outcome=Outcome.HIT_STANDING))


@pytest.mark.parametrize(("alpha", "most"), [(math.inf, 1e-9), (3.0, 0.1)])
def test_wheels_told_a_velocity_turn_to_it_and_hardly_further(alpha: float, most: float) -> None:
    robot = RobotSpec(drive="differential", alpha_max=alpha)
    for velocity in ((0.0, 1.0), (-1.0, -0.1), (1.0, 0.01)):
        state, goal = RobotState(0.0, 0.0, 0.0, 0.0, 0.0), math.atan2(velocity[1], velocity[0])
        for _ in range(60):
            state = drive_cycle(state, *towards(velocity, state.theta, robot), robot.limits, robot.dt)
            assert abs(state.theta) < abs(goal) + most
        assert state.theta == pytest.approx(goal, abs=1e-4)


def test_traces_of_old_are_of_steps() -> None:
    """The old step model stays an option, and without inertia holonomic robots know no other."""
    rng = np.random.default_rng(2)
    result = run(hall(rng, RobotSpec(drive="differential", a_max=1.0, dynamics="steps")), Wanderer(), seed=3)
    check_episode(result)
    assert RobotSpec().stepwise and not RobotSpec(a_max=1.0).stepwise


@pytest.mark.parametrize(
    "wrong",
    [
        {"v_reverse": -0.3, "drive": "differential"},
        {"v_reverse": 0.3},
        {"v_reverse": 2.0, "drive": "differential"},
        {"turning_radius": 1.0},
        {"turning_radius": 1.0, "drive": "differential"},
        {"drive": "ackermann"},
        {"drive": "tank"},
        {"alpha_max": 0.0},
        {"brake_max": -1.0},
        {"latency": -0.1},
        {"latency": math.inf},
        {"dynamics": "leaps"},
        {"dynamics": "steps", "latency": 0.1},
        {"dynamics": "steps", "a_max": 0.25, "brake_max": 16.0},
        {"footprint": [(0, 0), (1, 0)]},
        {"footprint": [(0, 0), (1, 1), (1, 0), (0, 1)]},
        {"footprint": [(0, 0), (2, 0), (0.4, 0.4), (0, 2)]},
        {"footprint": [(0, 0), (1, 0), (2, 0)]},
        {"footprint": [(-0.3, -0.3), (0, 0), (0.3, 0.3)]},
        {"footprint": [(0.1, 0.1), (-0.3, -0.3), (0.2, 0.2)]},
        {"footprint": [(0, 0), (0.1, 0.3), (0.2, 0.6), (0.1, 0.3)]},
        {"footprint": [(0, 0), (1, 0), (math.nan, 1)]},
        {"footprint": "round"},
        {"footprint": [(0, 1), (-0.59, -0.81), (0.95, 0.31), (-0.95, 0.31), (0.59, -0.81)]},
    ],
)
def test_wrong_robots_raise(wrong: dict) -> None:
    """A reverse limit with a sign, a footprint that crosses itself, a turning radius without steering: one typed error."""
    with pytest.raises(BadParameter, match=r"robot\."):
        RobotSpec(**wrong)


def test_robots_are_found_by_name_and_file(tmp_path: Path) -> None:
    """Every shipped robot has a source and loads by name; a file gives the fields, and errors name it."""
    for name, (spec, source) in ROBOTS.items():
        assert load_robot(name) == spec and len(source) > 20
    file = tmp_path / "mine.toml"
    file.write_text('drive = "differential"\na_max = 0.5\nfootprint = [[-0.2, -0.1], [0.2, -0.1], [0.2, 0.1], [-0.2, 0.1]]\n')
    assert load_robot(str(file)).radius == pytest.approx(math.hypot(0.2, 0.1))
    both = "radius = 0.1\nfootprint = [[-0.2, -0.1], [0.2, -0.1], [0.2, 0.1], [-0.2, 0.1]]"
    file.write_text("[robot]\nv_max = 0.5\n")
    assert load_robot(file) == RobotSpec(v_max=0.5)
    beside = "v_max = 0.7\n[robot]\nv_max = 0.5", "[robot]\nv_max = 0.5\n[limits]\na_max = 0.3"  # which was not read
    for text in (*beside, "wheels = 2", "v_max = -1", "v_max", 'drive = "tank"', both):
        file.write_text(text)
        with pytest.raises(BadInput, match=r"mine\.toml"):
            load_robot(file)
    for name in ("turtlebot5", "", str(tmp_path), None):
        with pytest.raises(BadParameter):
            load_robot(name)


def test_tables_of_names_agree() -> None:
    """The names that help texts show are those that there are."""
    from antway.tables import ROBOTS as NAMES

    assert set(NAMES) == set(ROBOTS)


def test_a_scenario_file_names_its_robot(tmp_path: Path) -> None:
    """`robot = "turtlebot4"` takes the shipped one; a scenario with any robot reads back equal."""
    from antway.world.scenario import load_scenario, save_scenario

    scenario = hall(np.random.default_rng(0), EVERY["slider"], 2)
    save_scenario(scenario, tmp_path / "one.toml")
    assert load_scenario(tmp_path / "one.toml").robot == scenario.robot
    text = (tmp_path / "one.toml").read_text()
    head, _, rest = text.partition("[robot]")
    file = tmp_path / "two.toml"
    file.write_text('robot = "turtlebot4"\n' + head + "[sensor]" + rest.partition("[sensor]")[2])
    assert load_scenario(file).robot == ROBOTS["turtlebot4"][0]
    file.write_text('robot = "turtlebot5"\n' + head)
    with pytest.raises(BadInput, match=r"two\.toml.*robot"):
        load_scenario(file)


def test_every_suite_takes_another_robot() -> None:
    """A robot is an axis of a suite: the same world and seed, another key; a larger robot gets a world with room for it."""
    from antway.arena.suites import build, episodes

    own, other = episodes("synthetic", 1), episodes("synthetic", 1, "diff")
    for a, b in zip(own, other):
        assert a.seed == b.seed and b.suite == "synthetic on diff" and a.suite == "synthetic"
        assert build(b).robot == ROBOTS["diff"][0] and build(a).start == build(b).start
    for episode in episodes("synthetic", 1, "amr"):
        assert build(episode).robot.radius > 0.6
    with pytest.raises(BadParameter, match="room"):
        build(episodes("paper", 1, "amr")[0])


def test_no_robot_turns_without_a_limit() -> None:
    """The guard would look infinitely far ahead for it."""
    with pytest.raises(BadParameter, match=r"robot\.turn_rate"):
        RobotSpec(drive="differential", turn_rate=math.inf)
    assert RobotSpec(drive="differential", turn_rate=1e6).turn_rate == 1e6


def test_only_commands_that_do_not_act_yet_are_foreseen() -> None:
    """Whoever hands over more of the last commands than the latency takes is told the same."""
    robot = RobotSpec(drive="differential", latency=0.1, dt=0.1)
    sent = np.array([(1.0, 0.0), (0.7, 0.2), (0.3, 0.0), (1.0, 0.0)])
    seen = Observation(0.0, (0.0, 0.0), (1.0, 0.0), 0.0, Tracks.none(), pending=sent[-1:])
    assert replace(seen, pending=sent).state_at_action(robot) == seen.state_at_action(robot)
