"""People of a recording who appear beside the robot are not there until they are farther off; why episodes failed."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from antway import BadParameter, BadScenario, Command, Grid, RobotSpec, Scenario, World, check_episode, load_scenario, run
from antway.arena.causes import by_cause, cause, errors, with_cause
from antway.arena.store import Row
from antway.baselines.replan import Follow
from antway.world.entries import NEAR, _detour
from antway.world.motions import Pursue, Replay, place_at
from antway.world.scenario import save_scenario
from antway.world.sensor import Sensor
from antway.world.timeline import Timeline
from antway.world.trace import Outcome
from antway.world.world import Obstacle
from common import cases, costly

ROOM = Grid(np.zeros((60, 60), np.bool_), 0.2)


class Drives(Follow):
    """Drives east at a given speed, whatever comes."""

    def __init__(self, speed=1.0):
        self.speed, self.seen = speed, []

    def act(self, observation):
        self.seen.append((observation.t, observation.tracks))
        return Command((self.speed, 0.0))


def walk(begins, *, passes, v=(-1.0, 0.0), until=20.0):
    """One who is at `passes` at the time `begins`, when its record begins, with the velocity v all the time."""
    t = np.array([begins - 20.0, begins, begins + until])
    return Obstacle(0.3, Replay(tuple(t), tuple((np.array(passes) + np.outer(t - begins, v)).tolist()), begins))


def play(*people, speed=1.0, horizon=8.0):
    scenario = Scenario(World(ROOM, people), (2.0, 6.0), (11.0, 6.0), RobotSpec(), horizon=horizon)
    policy = Drives(speed)
    return run(scenario, policy), policy.seen


def test_who_appears_beside_the_robot_is_not_there_until_it_is_farther_off():
    """Its record begins 0.8 m ahead: it is gone the cycle after, passes through nobody, and is back behind."""
    result, seen = play(walk(3.0, passes=(5.8, 6.0)))
    check_episode(result)
    assert result.outcome.value == "timeout" or result.reached
    here = {round(t, 6): len(tracks) for t, tracks in seen}
    assert here[2.0] == 1 and here[3.0] == 1 and here[3.1] == 0 and here[5.0] == 1
    back = min(t for t, n in here.items() if t > 3.05 and n)
    at = {round(t, 6): tracks for t, tracks in seen}[back]
    assert NEAR < math.dist(at.xy[0], (2.0 + back, 6.0)) < NEAR + 0.5
    assert at.velocity[0] == pytest.approx((-1.0, 0.0)) and all(np.hypot(*t.velocity.T).max(initial=0.0) < 2.0 for _, t in seen)


@pytest.mark.parametrize("dt", [1e-6, 3e-6, 1e-4])
def test_people_leave_within_the_shortest_periods(dt: float) -> None:
    """Who appears beside the robot is gone in the next period, however short periods are."""
    people = [walk(2 * dt, passes=(2.7, 6.0))]
    result = run(Scenario(World(ROOM, people), (2.0, 6.0), (11.0, 6.0), RobotSpec(dt=dt), horizon=10 * dt), Drives(0.0))
    check_episode(result)
    assert result.trace.sensed[:, 0].tolist() == [True] * 3 + [False] * 8


def test_who_appears_farther_off_counts_at_once():
    """A record that begins 1.2 m ahead ends the episode in contact, as does one that went on all the time."""
    for begins in (3.0, 0.0):
        person = walk(3.0, passes=(6.2, 6.0))
        result, _ = play(Obstacle(0.3, replace(person.motion, record_start=begins)))
        check_episode(result)
        assert result.outcome.value == "hit-moving" and result.time == pytest.approx(3.3)


def test_entries_among_others_keep_every_rule():
    """Whatever appears where, no disc comes within 1 m out of nowhere, and episodes are sound, pursuers among them."""
    rng, gone = np.random.default_rng(3), 0
    for _ in range(cases(40, 300)):
        people = [
            walk(float(b), passes=(2.0 + b + dx, 6.0 + dy), v=tuple(rng.uniform(-1.2, 1.2, 2)))
            for b, dx, dy in zip(rng.uniform(1, 6, 4), rng.uniform(-1.2, 1.2, 4), rng.uniform(-1.2, 1.2, 4))
        ]
        people += [Obstacle(0.3, Pursue((11.5, 0.5), 0.2))]
        try:
            result, seen = play(*people, speed=float(rng.uniform(0.0, 1.0)))
        except Exception as error:  # one that walks in over the start
            assert "clear of the robot" in str(error)
            continue
        check_episode(result)
        assert all(np.hypot(*tracks.velocity.T).max(initial=0.0) < 2.0 for _, tracks in seen)
        line = result.trace.timeline
        steps = [np.hypot(*np.diff(line.trajectory(k)[1], axis=0).T) for k in range(4)]
        gone += sum(bool((step > 100.0).any()) for step in steps)
    assert gone > 2


PLANK = (1.2, 0.2), (-1.2, 0.2), (-1.2, -0.2), (1.2, -0.2)


@pytest.mark.parametrize("robot", [RobotSpec(sensor_range=50.0), RobotSpec(dt=0.25, footprint=PLANK, sensor_range=50.0)])
def test_who_is_seen_when_is_what_the_rule_says(robot: RobotSpec) -> None:
    """At every scan each person is where the record says, with its velocity, or absent as the rule says, step by step."""
    rng, absent, hits = np.random.default_rng(5), 0, 0
    for _ in range(costly(40, 400)):
        people, speed = [], float(rng.uniform(0.0, 1.0))
        for begins in (0.0, *rng.uniform(0.1, 5.0, 3).round(1)):
            t = begins + 0.1 * np.arange(-200, 90)
            ahead, aside = rng.uniform(-0.9, 0.9), rng.choice((-1.0, 1.0)) * rng.uniform(0.45, 1.0)
            xy = np.array((2.0 + speed * begins + ahead, 6.0 + aside)) + np.outer(t - begins, rng.uniform(-1.2, 1.2, 2))
            xy[:, 1] += 0.2 * (np.sin(3.0 * t) - math.sin(3.0 * begins))
            people.append(Obstacle(0.2, Replay(tuple(t), tuple(map(tuple, xy)), float(begins))))
        scenario = Scenario(World(ROOM, people), (2.0, 6.0), (10.5, 6.0), robot, Sensor(occlusion=False), horizon=7.0)
        try:
            result = run(scenario, policy := Drives(speed))
        except BadScenario:  # one is at the start
            continue
        trace, hidden, dt = result.trace, np.zeros(len(people), np.bool_), robot.dt
        due = [one.motion.record_start > 0.0 for one in people]
        for i, (t, tracks) in enumerate(policy.seen):
            assert (trace.sensed[i] == ~hidden).all()
            for k, person in enumerate(people):
                at, later = (place_at(person.motion.arrays, when) for when in (t, t + dt))
                if not hidden[k]:
                    row = int(np.flatnonzero(tracks.id == k)[0])
                    assert tracks.xy[row] == pytest.approx(at) == trace.timeline.at(t)[0][k]
                    assert np.hypot(*tracks.velocity[row]) < 2.5 and (t < 0.1 or tracks.velocity[row].any())
                if hidden[k]:
                    hidden[k] = math.dist(later, trace.xy[i]) <= max(1.0, robot.radius + 0.2) + robot.v_max * dt
                elif i and due[k] and person.motion.record_start <= t + 1e-9:
                    due[k], hidden[k] = False, math.dist(at, trace.xy[i]) <= 1.0
                    absent += int(hidden[k])
        hits += result.outcome in (Outcome.HIT_MOVING, Outcome.HIT_STANDING)
        check_episode(result)
    assert absent > 3 and hits > 2


def test_who_comes_back_does_not_pass_through_the_robot() -> None:
    """It was removed to the north, and its record leads on a hair south of due east, so it comes back around by the north."""
    t, xy = (0.0, 2.0, 3.05, 3.09), ((2.0, 8.8), (2.0, 6.8), (2.0, 6.8), (4.0, 5.9995))
    result, seen = play(Obstacle(0.3, Replay(t, xy, 2.0)), speed=0.0)
    assert result.outcome is Outcome.TIMEOUT and {len(tracks) for _, tracks in seen} == {0, 1}


def test_who_comes_back_from_far_off_stays_far_off_until_straight_ahead() -> None:
    """From whatever side, and to whatever side of the robot."""
    for start in 1000.0 * directions(73):
        for end in 1.5 * directions(16):
            path = np.vstack((start, _detour(start, end)))
            along = path[:-1, None] + np.linspace(0.0, 1.0, 50)[:, None] * np.diff(path, axis=0)[:, None]
            assert np.hypot(*np.moveaxis(along, 2, 0)).min() > 700.0 and path[-1] == pytest.approx(end / 0.0015)


def directions(count: int) -> np.ndarray:
    """Unit vectors all around."""
    angle = np.linspace(-math.pi, math.pi, count)
    return np.column_stack((np.cos(angle), np.sin(angle)))


def test_when_a_record_begins_is_kept_in_a_file_and_checked(tmp_path):
    """Scenario files hold it; what is no time is refused."""
    for begins in (2.5, 0.0, -3.0):
        person = Obstacle(0.3, Replay((0.0, 4.0), ((1.0, 1.0), (5.0, 1.0)), begins))
        scenario = Scenario(World(ROOM, (person,)), (2.0, 6.0), (11.0, 6.0))
        save_scenario(scenario, tmp_path / "s.toml")
        assert load_scenario(tmp_path / "s.toml").world.obstacles == (person,)
    for wrong in (math.nan, "soon", math.inf, -math.inf, True):
        with pytest.raises(BadParameter, match="record_start"):
            Replay((0.0,), ((1.0, 1.0),), wrong)


@pytest.mark.parametrize(
    ("velocity", "others", "said"),
    [
        ((0.09, 0.0), [], "one alone, standing"),
        ((0.11, 0.0), [], "one alone, from behind"),
        ((0.55, 0.9), [], "one alone, from behind"),  # within 60 degrees of the direction to the goal
        ((0.45, 0.9), [], "one alone, from the side"),
        ((-0.45, 0.9), [], "one alone, from the side"),
        ((-0.55, 0.9), [], "one alone, from ahead"),
        ((-1.5, 0.0), [], "one alone, from ahead"),
        ((-1.51, 0.0), [], "one alone, from ahead, faster than declared"),
        ((-1.0, 0.0), [((2.5, 3.9), (-1.0, 0.59))], "one of 2 together, from ahead"),
        ((-1.0, 0.0), [((2.5, 4.1), (-1.0, 0.0)), ((2.5, 2.5), (-1.0, 0.61))], "one alone, from ahead"),
    ],
)
def test_causes_by_hand(velocity, others, said):
    """The robot at (2, 2) on its way to (9, 2) touches a disc of 0.3 m at (2.5, 2), and none that runs past."""
    people = [((2.0, 2.6), (5.0, 5.0)), *others, ((2.5, 2.0), velocity)]
    t, line = 4.0, np.array([0.0, 1.0])
    courses = [(t - 0.5 + line, np.array(xy) + np.outer(line - 0.5, v)) for xy, v in people]
    timeline = Timeline.of(range(len(people)), [0.05, *[0.3] * (len(people) - 1)], courses)
    task = SimpleNamespace(robot=RobotSpec(radius=0.2), goal=(9.0, 2.0), obstacle_speed=1.5)
    ends = np.array([[0.0, 0.0], [9.0, 9.0], [2.0, 2.0]])
    trace = SimpleNamespace(
        outcome=Outcome.HIT_MOVING,
        timeline=timeline,
        task=task,
        t=np.array([0.0, 0.5 * t, t]),
        xy=ends,
        heading=np.zeros(3),
        reason="hit",
    )
    assert cause(trace) == said and with_cause(trace) == f"hit; {said}"
    trace.outcome = Outcome.HIT_WALL
    assert cause(trace) == "" and with_cause(trace) == "hit"


def test_causes_tell_who_touched_the_robot():
    """Alone or together, from which side, and how fast; the table counts them, and what nobody could have reached."""
    one, _ = play(walk(3.0, passes=(6.2, 6.0)))
    assert cause(one.trace) == "one alone, from ahead" and with_cause(one.trace).endswith("moving; one alone, from ahead")
    three, _ = play(*(walk(3.0, passes=(3.9, y), v=(2.0, 0.0)) for y in (5.3, 6.0, 6.7)))
    assert cause(three.trace) == "one of 3 together, from behind, faster than declared"
    aside, _ = play(walk(3.0, passes=(5.0, 7.5), v=(0.0, -1.0)), speed=0.0)
    assert cause(aside.trace) == "" and with_cause(aside.trace) == aside.trace.reason
    rows = [
        Row("s", f"e{i}", "p", i, "v", "g", outcome, reason, bound=bound)
        for i, (outcome, reason, bound) in enumerate(
            [
                ("reached", "", 9.0),
                ("hit-moving", with_cause(one.trace), 9.0),
                ("hit-moving", with_cause(one.trace), 9.0),
                *[("timeout", "the horizon came first", 9.0)] * 3,
                ("hit-standing", with_cause(three.trace), math.inf),
                ("error", "p at 3 s: ValueError: no; never", 9.0),
                ("error", "p at 3 s: ValueError: no", math.inf),
            ]
        )
    ]
    counts = [("timeout", 3), ("error", 2), ("hit-moving: one alone, from ahead", 2), ("no path at all", 1)]
    assert list(by_cause(rows).items()) == counts
    (line,) = errors([replace(row, policy="q") if row.outcome == "reached" else row for row in rows])
    assert line == "policy p failed in 2 of 8 episodes; first: p at 3 s: ValueError: no; never"
