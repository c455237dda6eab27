"""Rounds: stops in a scenario, visited in an order that is decided anew; their record, their check, and doors that close."""

from __future__ import annotations

import itertools
import json
import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import antway
from antway import BadInput, Grid, InvalidPlan, Outcome, RobotSpec, Scenario, World, check_episode, load_scenario, run
from antway.kernels.colony.held_karp import earliest_of_few
from antway.policies.guard import Guard, Guarded
from antway.scenes import scene
from antway.verify_episode import rounds_faults
from antway.world.episode import Episode
from antway.world.motions import Line, Replay
from antway.world.order_planner import FEW, MANY, OrderOutlook, nearest_cell
from antway.world.policy import Observation, Task, Tracks, make_policy
from antway.world.rounds import RoundsPolicy
from antway.world.scenario import save_scenario
from antway.world.sensor import Sensor
from antway.world.standing import Sighting, StandingObstacles
from antway.world.stops import Rounds, Stop, Turn, Visit
from antway.world.timeline import Timeline
from antway.world.trace import Trace
from antway.world.tracefile import _Reader
from antway.world.world import Obstacle
from common import cases


def hall(*, stops: tuple[Stop, ...], obstacles: tuple[Obstacle, ...] = (), horizon: float = 120.0, **more: object) -> Scenario:
    """A hall of 12 x 6 m with a wall across it that has a door at each end."""
    blocked = np.zeros((60, 120), dtype=bool)
    blocked[12:48, 60:62] = True
    start: tuple[float, float] = (1.0, 1.0)
    grid = Grid(blocked, resolution=0.1)
    return Scenario(World(grid, obstacles), start, start, RobotSpec(radius=0.25), stops=stops, horizon=horizon, **more)


def test_the_nearest_cell_is_the_nearest() -> None:
    """The search in growing squares used to take what is in a corner of one before what is nearer beyond its edge."""
    rng = np.random.default_rng(5)
    for k in range(cases(200, 5000)):
        blocked = rng.random((60, 50)) < rng.choice([0.5, 0.99, 0.999, 1.0])
        if k == 0:
            blocked[:] = True
            blocked[28, 28] = blocked[29, 20] = False
        cell = (20, 20) if k == 0 else (int(rng.integers(60)), int(rng.integers(50)))
        grid = Grid(blocked, 0.5)
        free = np.argwhere(~blocked)
        least = np.hypot(*(free - cell).T).min(initial=math.inf)
        found = nearest_cell(grid, grid.centre(cell))
        assert found == cell if len(free) == 0 else math.dist(found, cell) == least and grid.is_free(found)


FOUR = (
    Stop((4.0, 5.0), "ward", service=2.0),
    Stop((9.0, 1.0), "lab", window=(20.0, 60.0), service=1.0),
    Stop((3.0, 1.0), "desk"),
    Stop((9.0, 5.0), "store", window=(0.0, 30.0)),
)


def naive_best(away: np.ndarray, windows: np.ndarray, service: np.ndarray, now: float) -> tuple[float, float]:
    """The least (lateness, end) of all orders."""
    m = len(service)

    def outcome(order: tuple[int, ...]) -> tuple[float, float]:
        t, late, at = now, 0.0, 0
        for j in order:
            t = max(t + away[at, j + 1], windows[j, 0])
            late += max(0.0, t - windows[j, 1])
            t += service[j]
            at = j + 1
        return late, t + away[at, m + 1]

    return min(outcome(order) for order in itertools.permutations(range(m)))


def test_few_stops_keep_every_window_that_can_be_kept() -> None:
    rng = np.random.default_rng(1)
    kept = 0
    for _ in range(cases(60, 2000)):
        m = int(rng.integers(1, 7))
        xy = rng.random((m + 2, 2)) * 10
        away = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1))
        opens = rng.uniform(0, 30, m)
        windows = np.column_stack((opens, opens + rng.uniform(0, 25, m)))
        service, now = rng.uniform(0, 2, m), float(rng.uniform(0, 5))
        order = earliest_of_few(away, windows, service, now)
        assert sorted(order.tolist()) == list(range(m))
        late, end = naive_best(away, windows, service, now)
        t, found, at = now, 0.0, 0
        for j in order.tolist():
            t = max(t + away[at, j + 1], windows[j, 0])
            found += max(0.0, t - windows[j, 1])
            t += service[j]
            at = j + 1
        if late == 0.0:
            kept += 1
            assert found == 0.0
            assert t + away[at, m + 1] == pytest.approx(end)
        else:
            assert found >= late - 1e-9
    assert kept > 10


def test_a_robot_visits_all_stops_and_keeps_their_windows() -> None:
    result = run(hall(stops=FOUR), "follow", seed=1)
    check_episode(result)
    assert result.outcome is Outcome.REACHED
    rounds = result.rounds
    assert rounds is not None and not rounds.missed
    assert all(rounds.lateness(visit) == 0.0 for visit in rounds.visits)
    by_name = {rounds.name(visit.stop): visit for visit in rounds.visits}
    assert by_name["lab"].start >= 20.0
    assert by_name["ward"].end - by_name["ward"].start >= 2.0 - 0.1 - 1e-6
    assert len(result.order_ms) >= 4
    assert "to ward" in " ".join(decision.reason for _, decision in result.trace.decisions)


def test_the_trace_of_rounds_is_read_back(tmp_path) -> None:
    unnamed = tuple(replace(stop, name="") for stop in FOUR[:2])  # they came back as "stop 0" and "stop 1"
    trace = run(hall(stops=(*unnamed, *FOUR[2:])), "follow", seed=1).trace
    trace.save(tmp_path / "trace.json")
    back = Trace.load(tmp_path / "trace.json")
    assert back.rounds == trace.rounds
    assert back.digest() == trace.digest()
    check_episode(back)


def test_the_same_seed_gives_the_same_rounds() -> None:
    one, two = (run(hall(stops=FOUR), "follow", seed=3).trace.digest() for _ in range(2))
    assert one == two


def test_a_scenario_with_stops_is_written_and_read_back(tmp_path) -> None:
    scenario = hall(stops=FOUR)
    save_scenario(scenario, tmp_path / "hall.toml")
    assert load_scenario(tmp_path / "hall.toml").stops == scenario.stops


def spoilt(rounds: Rounds, k: int = 0, **changes: float) -> Rounds:
    visits = list(rounds.visits)
    visits[k] = visits[k]._replace(**changes)
    return replace(rounds, visits=tuple(visits))


BROKEN = {
    "without stops": lambda r: replace(r, visits=r.visits[:-1]),
    "is visited twice": lambda r: replace(r, visits=(*r.visits, r.visits[0])),
    "m away when it arrives": lambda r: spoilt(r, arrival=0.0, start=0.0),
    "before it leaves the stop before": lambda r: spoilt(r, 1, arrival=r.visits[0].end - 0.1),
    "is served for": lambda r: spoilt(r, [v.stop for v in r.visits].index(0), end=r.visits[0].start),
    "not near for as long": lambda r: replace(r, stops=(replace(r.stops[0], service=99.0), *r.stops[1:])),
    "begins at .* its window opens": lambda r: spoilt(r, start=r.visits[0].end),
    "begins at 12 s, ends at": lambda r: spoilt(r, [v.stop for v in r.visits].index(1), start=12.0),
    "visits stop 99": lambda r: spoilt(r, stop=99),
    "is 2.9.* m away": lambda r: replace(r, stops=(replace(r.stops[0], at=(1.0, 5.0)), *r.stops[1:])),
    "or visited before": lambda r: replace(r, turns=(*r.turns, Turn(r.visits[0].end + 0.1, (r.visits[0].stop,), ""))),
    "has stops twice": lambda r: replace(r, turns=(Turn(0.0, (0, 0, 1, 2), ""), *r.turns[1:])),
}


def test_check_episode_names_what_is_wrong_with_rounds() -> None:
    trace = run(hall(stops=FOUR), "follow", seed=1).trace
    check_episode(trace)
    for what, wrong in BROKEN.items():
        with pytest.raises(InvalidPlan, match=what):
            check_episode(replace(trace, rounds=wrong(trace.rounds)))
    for horizon in (1.0, 8.0):  # before the first stop is visited the robot is at its goal, where it started, and goes on
        check_episode(run(hall(stops=FOUR, horizon=horizon), "follow", seed=1))


def test_a_robot_may_pass_over_the_goal_between_its_stops() -> None:
    """It is on its way to the goal only when all stops are done, whether it gets that far or not."""
    way = Stop((3.0, 1.0), "desk"), Stop((7.0, 1.0), "lab")
    scenario = replace(hall(stops=way), start=(2.0, 1.0), goal=(4.5, 1.0))
    for horizon, visited in ((3.5, 1), (60.0, 2)):
        result = run(scenario, "follow", horizon=horizon)
        assert len(result.rounds.visits) == visited and result.reached == (visited == 2)
        assert np.hypot(*(result.trace.xy - scenario.goal).T).min() < 0.1
        check_episode(result)


def test_time_at_a_stop_before_it_opens_is_no_service() -> None:
    """A robot that waits for 3 s, is then 2 m away for 2 s and comes back has not been served for 3 s."""
    stop, home = Stop((4.0, 5.0), "ward", window=(10.0, 60.0), service=3.0), (1.0, 1.0)
    t = np.arange(0.0, 20.0, 0.1)
    for leaves, legal in ((10.0, False), (13.0, True)):
        xy = np.where((np.abs(t - leaves - 1.05) < 1.0)[:, None], (4.0, 3.0), stop.at)
        rounds = Rounds((stop,), (Visit(0, 7.0, 10.0, 13.0),))
        task = Task(hall(stops=()).world.grid, RobotSpec(), home, home)
        trace: Any = SimpleNamespace(t=t, xy=xy, rounds=rounds, task=task, outcome=Outcome.TIMEOUT)
        found = list(rounds_faults(trace))
        assert found == ([] if legal else ["stop 0 (ward): is not near for as long as the service takes"])


def test_a_door_that_closes_turns_the_order() -> None:
    """Someone stands in the upper door: the way round makes "south" late unless it comes first, and the lower door is taken."""
    stops = (Stop((4.5, 5.4), "near"), Stop((7.5, 5.4), "behind"), Stop((4.5, 0.7), "south", window=(0.0, 19.0)))
    stands = Obstacle(0.3, Line((6.1, 5.4), (6.1, 5.4), 0.0))
    result = run(hall(stops=stops, obstacles=(stands,), obstacle_speed=0.5), "stop", seed=1)
    check_episode(result)
    first, second, *_ = result.rounds.turns
    assert first.order == (0, 1, 2)
    assert second.order in ((0, 2, 1), (2, 1))
    assert "stands in the way" in second.reason
    assert result.outcome is Outcome.REACHED and not result.rounds.missed
    assert all(result.rounds.lateness(visit) == 0.0 for visit in result.rounds.visits)


def test_whoever_comes_to_stand_in_the_way_is_told_from_others() -> None:
    """Obstacle 3 stands aside all the time, 7 first aside, then in the upper door while the robot serves; then it leaves."""
    near, behind, door, aside = (4.5, 5.4), (7.5, 5.4), (6.1, 5.4), (1.0, 4.5)
    stops = Stop(near, "near", service=0.8), Stop(behind, window=(30.0, math.inf))
    reasons = list[str]()
    policy = RoundsPolicy(make_policy("follow"), stops)
    policy.reset(hall(stops=stops).task, 0)
    assert policy.order == [0, 1]
    policy._decide = reasons.append  # type: ignore[method-assign]
    for times, xy, other, told in (
        (range(6), (2.0, 5.4), aside, []),
        (range(6, 17), near, door, ["near is done", "obstacle 7 stands in the way"]),
        (range(17, 19), near, aside, ["the path is free again"]),
    ):
        tracks = Tracks([3, 7], [(1.0, 3.0), other], np.zeros((2, 2)), [0.3, 0.3])
        for t in times:
            policy.act(Observation(float(t), xy, (0.0, 0.0), 0.0, tracks))
        assert reasons == told
        reasons.clear()


def test_a_path_may_become_longer_though_nobody_has_come_to_a_stand() -> None:
    """Obstacle 7 beside the upper door is seen larger than before once 3, which stood elsewhere, has left."""
    stops = (Stop((7.5, 5.4), "behind"),)
    reasons = list[str]()
    policy = RoundsPolicy(make_policy("follow"), stops)
    policy.reset(hall(stops=stops).task, 0)
    policy._decide = reasons.append  # type: ignore[method-assign]
    for t in range(7):
        radii, y = ([0.3, 0.05], 3.0) if t < 6 else ([0.3, 0.9], 4.0)
        tracks = Tracks([3, 7], [(1.0, y), (6.1, 5.9)], np.zeros((2, 2)), radii)
        policy.act(Observation(float(t), (2.0, 5.4), (0.0, 0.0), 0.0, tracks))
    assert reasons == ["the path has become longer"]


def test_no_window_is_lost_that_an_exact_plan_would_keep_when_a_door_closes() -> None:
    """The order decided on with someone in the upper door is never late where any order would not be."""
    rng = np.random.default_rng(6)
    kept = turned = 0
    for _ in range(cases(12, 300)):
        n = int(rng.integers(3, 6))
        halves = [0.5, 6.7, *rng.choice((0.5, 6.7), n)]  # x of the left edge of the half of the hall
        sides = [(left + rng.uniform(0.0, 4.8), rng.uniform(0.5, 5.5)) for left in halves]
        stops = []
        for x, y in sides:
            opens = float(rng.uniform(0, 20))
            stops.append(Stop((float(x), float(y)), window=(opens, opens + float(rng.uniform(10, 40)))))
        scenario = hall(stops=tuple(stops))
        policy = RoundsPolicy(antway.make_policy("follow"), scenario.stops)
        policy.reset(scenario.task, 1)
        before = tuple(policy.order)
        policy.standing.sightings = {7: Sighting(0.0, 4.0, 6.1, 5.4, 0.3)}
        policy.planner.present = policy.standing.block(policy.planner.inflated, policy.standing.walls().keys(), 0.25)
        policy._decide("a door is closed")
        times = policy.planner.travel_times(policy.xy, policy.remaining)
        windows = np.array([stop.window for stop in stops])
        best = naive_best(times, windows, np.zeros(len(stops)), 0.0)
        place = {stop: k + 1 for k, stop in enumerate(policy.remaining)}
        rows = [0, *(place[stop] for stop in policy.order), -1]
        late, _ = policy.planner._followed(policy.order, times[rows[:-1], rows[1:]].tolist(), 0.0)
        turned += tuple(policy.order) != before
        if best[0] == 0.0:
            kept += 1
            assert late == 0.0
    assert kept > 2 and turned > 0


def test_a_stop_may_be_added_on_the_way() -> None:
    episode = Episode(hall(stops=FOUR[2:]), "follow", seed=1)
    for _ in range(20):
        episode.step()
    assert isinstance(episode.policy, RoundsPolicy)
    episode.policy.add(Stop((4.0, 5.0), "late call"))
    with pytest.raises(BadInput):
        episode.policy.add(Stop((99.0, 5.0), "nowhere"))
    while episode.outcome is None:
        episode.step()
    result = episode.result()
    check_episode(result)
    assert not result.rounds.missed and len(result.rounds.visits) == 3
    assert any("late call was added" in turn.reason for turn in result.rounds.turns)


def test_the_colony_orders_many_stops() -> None:
    rng = np.random.default_rng(2)
    stops = tuple(Stop((float(x), float(y)), f"s{k}") for k, (x, y) in enumerate(rng.uniform(0.5, 5.5, (16, 2))))
    result = run(hall(stops=stops, horizon=200.0), "follow", seed=1)
    check_episode(result)
    assert result.outcome is Outcome.REACHED and not result.rounds.missed


def scattered(n: int, seed: int) -> tuple[Stop, ...]:
    """Stops on both sides of the hall's wall; every third has a window."""
    cells = np.random.default_rng(seed).choice(2 * 100, n, replace=False)
    ends = [150.0 if k % 3 == 0 else math.inf for k in range(n)]
    places = [(0.75 + 0.5 * (cell % 10) + 6.0 * (cell // 100), 0.75 + 0.5 * (cell // 10 % 10)) for cell in cells.tolist()]
    return tuple(Stop(place, f"s{k}", (0.0, end)) for k, (place, end) in enumerate(zip(places, ends)))


def test_more_stops_than_a_colony_orders_in_time_are_visited_too() -> None:
    result = run(hall(stops=scattered(MANY + 4, seed=3), horizon=400.0), "follow", seed=1)
    check_episode(result)
    assert result.outcome is Outcome.REACHED and not result.rounds.missed
    assert sum(result.rounds.lateness(visit) for visit in result.rounds.visits) == 0.0


def test_the_colony_goes_on_from_what_it_has_learned() -> None:
    """What it knows of pairs of stops that are left stays as it was when others are done or added."""
    stops = scattered(20, seed=4)
    scenario = hall(stops=stops)
    policy = RoundsPolicy(make_policy("follow"), stops)
    policy.reset(scenario.task, 0)
    before, last = policy.planner.answer
    assert last.pheromone is not None and last.pheromone.max() > 0.5 > last.pheromone.min()
    left = [stop for stop in before if stop not in (3, 7)]
    known = policy.planner.continued([*left, 20], policy.order)
    assert known.orders[0].tolist() == [0, *(left.index(stop) + 1 for stop in policy.order if stop in left), len(left) + 2]
    for i, a in enumerate(left):
        assert known.pheromone[0, i + 1] == last.pheromone[0, before.index(a) + 1]
        for j, b in enumerate(left):
            assert known.pheromone[i + 1, j + 1] == last.pheromone[before.index(a) + 1, before.index(b) + 1]


@pytest.mark.parametrize(
    ("stops", "words"),
    [
        ((Stop((6.1, 3.0), "wall"),), r"stops\[0\] \(wall\)"),
        ((Stop((99.0, 3.0)),), r"stops\[0\]"),
        ((Stop((4.0, 5.0), "a"), Stop((4.01, 5.01), "b")), r"stops\[1\] \(b\).*stops\[0\]"),
        (("ward",), r"stops\[0\]"),
    ],
)
def test_wrong_stops_are_named(stops: tuple[Stop, ...], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        hall(stops=stops)


@pytest.mark.parametrize(
    "change", [{"window": (5.0, 4.0)}, {"window": (math.nan, 4.0)}, {"service": -1.0}, {"at": (1.0,)}, {"at": (math.nan, 1.0)}]
)
def test_a_wrong_stop_is_refused(change: dict[str, object]) -> None:
    with pytest.raises(BadInput):
        Stop(**{"at": (1.0, 1.0), **change})  # type: ignore[arg-type]


def test_a_stop_out_of_reach_is_the_fault_of_the_scenario() -> None:
    blocked = np.zeros((20, 60), dtype=bool)
    blocked[:, 30] = True
    scenario = Scenario(
        World(Grid(blocked, 0.1)), (1.0, 1.0), (2.0, 1.0), RobotSpec(radius=0.2), stops=(Stop((5.0, 1.0), "far"),)
    )
    with pytest.raises(BadInput, match=r"stops\[0\] \(far\)"):
        run(scenario, "follow")


def test_a_record_of_rounds_that_is_none_is_refused() -> None:
    good = Rounds((Stop((1.0, 1.0), "a"),), (Visit(0, 1.0, 1.0, 2.0),), (Turn(0.0, (0,), "first"),)).record()
    reader = _Reader("trace.json")
    assert reader.rounds(good).visits[0].arrival == 1.0
    for wrong in (
        [],
        {},
        {**good, "visits": [[5, 1.0, 1.0, 2.0]]},
        {**good, "turns": [[0.0, [7], ""]]},
        {**good, "stops": [1]},
    ):
        with pytest.raises(BadInput):
            reader.rounds(wrong)


def test_the_scene_rounds_has_twelve_stops_and_four_windows() -> None:
    stops = load_scenario(scene("rounds")).stops
    assert len(stops) == 12
    assert sum(math.isfinite(stop.window[1]) for stop in stops) == 4
    assert antway.load_scenario(scene("office")).stops == ()


def test_rounds_are_drawn_and_summed_up(tmp_path) -> None:
    """The figure draws late and missed stops as well; the summary is JSON; the page holds the stops."""
    from antway.demo import summary
    from antway.view import style
    from antway.view.replay import replay_page
    from antway.view.tours import rounds_figure

    late = (*FOUR, Stop((6.0, 0.6), "too late", window=(0.0, 0.5)))
    result = run(hall(stops=late, horizon=18.0), "follow", seed=1)
    check_episode(result)
    assert result.outcome is Outcome.TIMEOUT and result.rounds.missed
    assert style.save(rounds_figure(result.trace), tmp_path / "rounds.png").stat().st_size > 10_000
    numbers = summary(result, result.trace.task)
    assert numbers["stops"] == 5 and numbers["visited"] < 5 and numbers["lateness"] > 0.0
    json.dumps(numbers, allow_nan=False)
    assert '"name":"too late"' in replay_page(result.trace)


@pytest.mark.parametrize("drive", ["holonomic", "differential", "ackermann"])
@pytest.mark.parametrize("rates", [{}, {"a_max": 1.0, "alpha_max": 3.0}], ids=["at-once", "inertia"])
def test_a_last_stop_within_the_goal_ends_the_rounds(drive: str, rates: dict) -> None:
    """A robot that stands at the goal when its last stop is done has arrived, though it comes from nowhere."""
    robot = RobotSpec(radius=0.25, drive=drive, turning_radius=0.5 if drive == "ackermann" else 0.0, **rates)
    scenario = replace(hall(stops=(Stop((4.0, 1.0), "desk", service=1.0),)), start=(1.0, 1.0), goal=(4.05, 1.0), robot=robot)
    result = run(scenario, "antway")
    check_episode(result)
    assert result.reached and result.time < 12.0


@pytest.mark.parametrize("policy", ["antway", "paper", "replan"])
def test_a_stop_on_which_somebody_stands_is_visited_once_he_leaves(policy: str) -> None:
    """Meanwhile the robot visits the others."""
    stop = (3.0, 5.0)
    stands = Replay((0.0, 2.0, 13.0, 18.0), ((3.0, 3.0), stop, stop, (3.0, 2.5)))
    scenario = hall(stops=(Stop(stop, "ward"), Stop((5.0, 5.0), "desk")), obstacles=(Obstacle(0.4, stands),), horizon=90.0)
    result = run(scenario, policy, seed=0)
    check_episode(result)
    assert result.outcome is Outcome.REACHED
    arrivals = {visit.stop: visit.arrival for visit in result.rounds.visits}
    assert arrivals[1] < 12.0 and 13.0 < arrivals[0] <= result.time < 43.0


def test_a_stop_on_which_somebody_stands_comes_last() -> None:
    """The robot does not wait there while it could visit others."""
    ward = (2.5, 3.0)
    stops, stands = (Stop(ward, "ward"), Stop((4.5, 5.0), "desk")), Obstacle(0.4, Line(ward, ward, 0.0))
    rounds = run(hall(stops=stops, obstacles=(stands,), horizon=7.0), "replan", seed=0).rounds
    assert [turn.order for turn in rounds.turns] == [(0, 1), (1, 0)]
    assert [visit.stop for visit in rounds.visits] == [1]


def test_who_stands_is_told_by_places() -> None:
    """Whoever walks is no wall where no velocities are measured, and whoever stands is one where they are noisy."""
    standing, rng = StandingObstacles(), np.random.default_rng(0)
    for t in np.arange(0.0, 5.0, 0.1):
        places = np.array([(1.0 + t, 2.0), (3.0, 4.0)]) + rng.normal(0.0, 0.02, (2, 2))
        velocity = np.array([(math.nan, math.nan), rng.normal(0.0, 0.1, 2)])
        standing.observe(Tracks([0, 1], places, velocity, [0.3, 0.3]), float(t))
    assert standing.walls() == {1: 0.0}


def test_who_stands_in_scans_without_a_time_is_a_wall() -> None:
    """They were taken for infinitely old, and so forgotten at once."""
    policy = RoundsPolicy(make_policy("follow"), FOUR[:1])
    policy.reset(hall(stops=FOUR[:1]).task, 0)
    for t in range(5):
        seen = Tracks([7], [(6.1, 5.4)], np.zeros((1, 2)), [0.3])
        policy.act(Observation(float(t), (1.0, 1.0), (0.0, 0.0), 0.0, seen, stamp=-math.inf))
    assert policy.standing.walls() == policy.walls == {7: 0.0}


def test_obstacles_that_stand_block_the_cells_around_them() -> None:
    """Those whose centre is nearer than the radius and a margin; the others of whom nothing was asked stay free."""
    rng, standing = np.random.default_rng(4), StandingObstacles()
    for _ in range(cases(20, 500)):
        grid = Grid(rng.random((12, 9)) < 0.1, float(rng.uniform(0.1, 0.6)), (-1.0, 2.0, 0.0))
        places = rng.uniform((-1.5, 1.5), (4.0, 8.0), (3, 2))
        standing.observe(Tracks([4, 7, 9], places, np.zeros((3, 2)), rng.uniform(0.1, 1.0, 3)), 0.0)
        margin = float(rng.uniform(-0.3, 0.5))
        expected = grid.blocked.copy()
        for number, one in standing.sightings.items():
            for cell in np.ndindex(grid.shape):
                expected[cell] |= number != 7 and math.dist(grid.centre(cell), (one.x, one.y)) < one.radius + margin
        assert (standing.block(grid, {4, 9}, margin).blocked == expected).all()
        assert standing.block(grid, set(), margin) is grid


def test_an_obstacle_is_a_wall_after_three_seconds_until_it_moves_or_is_forgotten() -> None:
    """It may sway by 0.2 m from where it came to a stand; a slow walk is none."""
    standing = StandingObstacles()

    def walls(t: float, *places: tuple[float, float]) -> dict[int, float]:
        standing.observe(
            Tracks(range(len(places)), np.reshape(places, (-1, 2)), np.zeros((len(places), 2)), [0.3] * len(places)), t
        )
        return standing.walls()

    for t in (0.0, 1.0, 2.0, 2.9):
        assert walls(t, (1.0, 2.0), (5.0 + 0.15 * t, 5.0)) == {}
    assert walls(3.0, (1.19, 2.0), (5.45, 5.0)) == {0: 0.0}
    assert walls(3.5, (0.81, 2.0)) == {0: 0.0} == walls(33.4)
    assert walls(33.5) == {}
    assert walls(40.0, (1.0, 2.0)) == {} and walls(43.0, (1.0, 2.0)) == {0: 40.0}
    assert walls(44.0, (1.25, 2.0)) == {} and walls(47.0, (1.25, 2.0)) == {0: 44.0}


@pytest.mark.parametrize(
    ("opens", "service", "aside", "end"),
    [(0.65, 0.0, 0.0, 0.7), (0.65, 0.1, 0.0, 0.8), (0.0, 1.0, 0.0, 1.0), (0.0, 1.0, 0.3, 1.0), (0.0, 1.0, 0.6, 1.5)],
)
def test_a_service_begins_in_its_window_and_counts_while_the_robot_is_there(
    opens: float, service: float, aside: float, end: float
) -> None:
    """The robot is `aside` m from the stop in five of the periods of 0.1 s; 0.4 m are near enough."""
    stop = Stop((4.0, 1.0), window=(opens, 100.0), service=service)
    policy = RoundsPolicy(make_policy("follow"), (stop,))
    policy.reset(hall(stops=(stop,)).task, 0)
    for i in range(20):
        at = 4.0 + aside * (3 <= i < 8), 1.0
        policy.act(Observation(0.1 * i, at, (0.0, 0.0), 0.0, Tracks.none()))
    assert policy.visits == [(0, 0.0, opens, pytest.approx(end))]


def test_wrong_stops_of_the_policy_are_refused() -> None:
    """It is given stops, not numbers, and a policy."""
    with pytest.raises(BadInput, match=r"stops\[0\]"):
        RoundsPolicy(make_policy("antway"), [1])
    with pytest.raises(BadInput, match="stops = 5: must be a sequence of stops"):
        RoundsPolicy(make_policy("antway"), 5)
    with pytest.raises(BadInput, match="policy"):
        RoundsPolicy("antway", [])


def test_a_stop_in_a_wall_is_refused_and_changes_nothing() -> None:
    episode = Episode(hall(stops=FOUR[2:]), "follow", seed=1)
    episode.step()
    before = list(episode.policy.stops), list(episode.policy.remaining)
    for wrong in ((6.1, 3.0), FOUR[2].at):  # in the wall, and where there is a stop already
        with pytest.raises(BadInput, match=r"stops\[2\] \(in vain\)"):
            episode.policy.add(Stop(wrong, "in vain"))
    assert (episode.policy.stops, episode.policy.remaining) == before


def test_the_oracle_visits_stops() -> None:
    """It plans from the time at which it departs from a stop, at which obstacles are elsewhere than at 0 s."""
    result = run(hall(stops=FOUR[2:], obstacles=(Obstacle(0.3, Line((11.0, 0.6), (1.0, 0.6), 0.4)),)), "oracle")
    assert result.reached and len(result.rounds.visits) == 2


def test_an_explanation_tells_when_the_robot_arrives_and_serves() -> None:
    """Also where the policy has no other reason than before."""
    stop = Stop((4.0, 1.0), "A", window=(6.0, 100.0), service=2.0)
    result = run(hall(stops=(stop,)), "follow")
    told = [decision.reason.partition(";")[0] for _, decision in result.trace.decisions]
    assert told[0].startswith("to A: ") and told[1:3] == ["waits at A until 6 s", "at A"]
    assert [decision.action for _, decision in result.trace.decisions] == ["follow", "arrived", "arrived", "follow"]


def test_somebody_seen_once_long_ago_does_not_stand() -> None:
    """With a scan each 4.5 s, one scan does not tell for 3 s that somebody stands, so the order stays."""
    walker = Obstacle(0.5, Line((12.0, 4.0), (1.0, 7.0), 1.0))
    world = World(Grid(np.zeros((40, 100), dtype=bool), 0.2), (walker,))
    stops, robot = (Stop((17.0, 4.0), "a"), Stop((12.05, 4.05), "b")), RobotSpec(sensor_range=30.0)
    hall = Scenario(world, (1.0, 4.0), (19.0, 4.0), robot, Sensor(period=4.5), horizon=6.0, stops=stops)
    assert len(run(hall, "follow").rounds.turns) == 1


@pytest.mark.parametrize("seed", [1, 4, 5, 11])
def test_a_departure_keeps_the_stop_that_the_guard_has_certified(seed: int) -> None:
    """A robot that departs from a stop while it still drives touches no wall, because a stop that nobody tested may."""
    rng, blocked = np.random.default_rng(seed), np.zeros((24, 24), dtype=bool)
    for row, col in rng.integers(5, 22, (5, 2)):
        blocked[row : row + 2, col : col + 3] = True
    grid = Grid(blocked, 0.25)
    places = rng.permutation(np.argwhere(~grid.inflate(0.5).blocked))[:12].tolist()
    robot = RobotSpec(drive="differential", a_max=1.0, brake_max=0.5, v_reverse=0.5, alpha_max=2.0)
    stops = tuple(Stop(grid.centre((row, col))) for row, col in places)
    scenario = Scenario(World(grid), (0.7, 0.7), (0.7, 0.7), robot, horizon=100.0, stops=stops)
    assert run(scenario, Guarded(make_policy("follow"), Guard(mode="strict")), seed=seed).reached


def test_policy_antway_keeps_the_stop_of_its_guard_at_a_departure() -> None:
    """And it remembers what it has seen: only the first departure begins anew."""
    robot = RobotSpec(radius=0.25, a_max=1.0, latency=0.1)
    episode = Episode(replace(hall(stops=FOUR[2:]), robot=robot), "antway", seed=1)
    for _ in range(5):
        episode.step()
    guard = episode.policy.policy.guard
    kept = guard.dynamic.keep.copy(), guard.dynamic.sent.copy(), guard.last_stamp
    episode.policy.add(Stop((1.0, 1.6)))
    assert episode.policy.departures == 2 and kept[0].any() and kept[1].any()
    assert (guard.dynamic.keep == kept[0]).all() and (guard.dynamic.sent == kept[1]).all() and guard.last_stamp == kept[2]


def test_a_stop_that_was_added_belongs_to_its_episode() -> None:
    """After a reset the stops are those that the policy was made for, and no decision of before counts."""
    policy = RoundsPolicy(make_policy("follow"), FOUR[:2])
    for _ in range(2):
        policy.reset(hall(stops=()).task, 0)
        assert policy.rounds.stops == FOUR[:2] and len(policy.order_ms) == 1
        policy.add(FOUR[2])
        assert policy.rounds.stops == FOUR[:3]


def test_an_episode_with_stops_may_end_before_it_begins() -> None:
    """A policy that fails before its reset ends the episode like any other, without visits."""

    def foresee(timeline: Timeline) -> None:
        raise ValueError("sees nothing")

    policy: Any = make_policy("follow")
    policy.foresee = foresee
    result = run(hall(stops=FOUR[:2]), policy)
    assert result.outcome is Outcome.ERROR and "sees nothing" in result.reason
    assert result.rounds.missed == (0, 1) and not len(result.order_ms)


def test_up_to_thirteen_stops_need_no_colony() -> None:
    """A dynamic program finds their order; of one more the colony does."""
    for count in (FEW, FEW + 1):
        stops = scattered(count, seed=4)
        policy = RoundsPolicy(make_policy("follow"), stops)
        policy.reset(hall(stops=stops).task, 0)
        assert sorted(policy.order) == list(range(count)) and (policy.planner.answer is None) == (count <= 13)


@pytest.mark.parametrize(
    ("one", "other", "better", "worse"),
    [
        ((0.0, 90.0), (0.1, 50.0), True, True),  # it avoids all lateness, and ends later than promised
        ((0.1, 50.0), (0.0, 50.0), False, True),  # late for the first time
        ((0.1, 50.0), (0.6, 50.0), False, False),
        ((0.1, 50.0), (0.7, 50.0), True, False),
        ((0.7, 50.0), (0.1, 50.0), False, True),
        ((0.6, 50.0), (0.1, 50.0), False, False),
        ((0.0, 47.0), (0.0, 50.0), False, False),
        ((0.0, 46.9), (0.0, 50.0), True, False),
        ((0.2, 46.9), (0.1, 50.0), False, False),  # an earlier end makes up for no lateness
        ((0.1, 46.9), (0.1, 50.0), True, False),
        ((0.0, 53.0), (0.0, 50.0), False, False),
        ((0.0, 53.1), (0.0, 50.0), False, True),
    ],
)
def test_orders_are_compared_by_lateness_and_then_by_their_ends(one: tuple, other: tuple, better: bool, worse: bool) -> None:
    """Less than 0.5 s of lateness, and 3 s of the end, are no reason to change an order."""
    assert OrderOutlook(*one).clearly_better_than(OrderOutlook(*other)) is better
    assert OrderOutlook(*one).clearly_worse_than(OrderOutlook(*other)) is worse


def test_a_stop_without_service_takes_no_time() -> None:
    """The robot departs in the control period in which it arrives."""
    (visit,) = run(hall(stops=(FOUR[2],)), "follow").rounds.visits
    assert visit.arrival == visit.start == visit.end > 0.0
