"""Policy `paper`: the shipped scenes are crossed without contact, decisions say what they must, answers stay the same."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from functools import cache
from itertools import pairwise, product
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from antway import (
    BadParameter,
    Command,
    EpisodeResult,
    Grid,
    Moves,
    Outcome,
    Problem,
    RobotSpec,
    Scenario,
    World,
    check_episode,
    load_scenario,
    make_policy,
    run,
)
from antway.ants.grid_walk import Trail
from antway.ants.gridpath import Exploration
from antway.policies.encounter import closest_approach, encounter
from antway.policies.paper import policy as policy_module
from antway.policies.paper.local_target import local_target
from antway.scenes import SCENES, scene
from antway.view.moments import moments, shortest
from antway.world.motions import BackAndForth, Bounce, Line
from antway.world.policy import Observation, Task, Tracks
from antway.world.sensor import Sensor
from antway.world.world import Obstacle
from common import cases, costly

GOLDEN = Path(__file__).parent / "golden" / "traces.json"
HALL = Grid(np.zeros((24, 40), dtype=bool), 0.25)


def hall(*obstacles: Obstacle, **changes) -> Scenario:
    return Scenario(World(HALL, obstacles), (1.125, 3.125), (9.125, 3.125), horizon=60.0, **changes)


@cache
def played(name: str, policy: str, seed: int) -> EpisodeResult:
    """An episode of a shipped scene, which several tests look at."""
    return run(load_scenario(scene(name)), policy, seed=seed)


@pytest.mark.parametrize("policy", ["paper", "antway"])
@pytest.mark.parametrize("name", SCENES)
def test_the_shipped_scenes_are_crossed_without_contact(name: str, policy: str) -> None:
    """Seed after seed the robot reaches the goal, touches nothing, and the verifier agrees."""
    for seed in range(costly(4, 50)):
        result = played(name, policy, seed)
        check_episode(result)
        assert result.reached, (name, seed, result.outcome, result.reason)


def test_ants_find_the_way_round_a_standing_obstacle() -> None:
    """A disc on the path is gone round by ants, with local target, pheromone and history told; and no more than is needed."""
    result = run(hall(Obstacle(0.4, Line((5.125, 3.125), (5.125, 3.125), 0.0))), "paper")
    check_episode(result)
    avoid = next(d for _, d in result.trace.decisions if d.action == "avoid")
    assert avoid.obstacle == 0 and avoid.encounter == "standing" and avoid.local_target is not None
    assert avoid.pheromone is not None and (avoid.pheromone[2] > 0).any() and np.isfinite(avoid.pheromone[2]).all()
    assert avoid.history is not None and 1 <= len(avoid.history) <= 20 and (np.diff(avoid.history[:, 0]) <= 0).all()
    (waits, never), (goes_round, extra) = avoid.alternatives
    assert avoid.path is not None and (waits, goes_round) == ("wait", "go round") and extra < never == math.inf
    assert avoid.distance_at_closest < 0 < avoid.time_to_closest
    assert result.reached and 8.0 < result.length < 9.5 and result.replans >= 1


def test_waiting_is_chosen_where_it_is_shorter() -> None:
    """In a corridor that a disc crosses the robot waits and then goes on; nothing else costs less."""
    blocked = np.zeros((24, 40), dtype=bool)
    blocked[:10, :18] = blocked[:10, 22:] = blocked[14:, :18] = blocked[14:, 22:] = True
    world = World(Grid(blocked, 0.25), [Obstacle(0.4, Line((5.0, 0.5), (5.0, 5.5), 0.6, delay=0.0))])
    result = run(Scenario(world, (1.125, 3.125), (9.125, 3.125)), "paper")
    check_episode(result)
    assert result.reached and result.waits >= 1 and any(d.action == "wait" for _, d in result.trace.decisions)


def test_the_robot_steps_back_from_a_corridor() -> None:
    """Met head-on in a corridor with no room to pass, the robot backs out and comes again."""
    blocked = np.zeros((24, 60), dtype=bool)
    blocked[:10, 20:40] = blocked[14:, 20:40] = True
    world = World(Grid(blocked, 0.25), [Obstacle(0.35, Line((12.0, 3.0), (2.0, 3.0), 0.6))])
    result = run(Scenario(world, (4.0, 3.0), (13.5, 3.0), RobotSpec(sensor_range=3.0)), "paper")
    check_episode(result)
    assert result.reached and result.length > 9.5


@pytest.mark.parametrize(
    "changes",
    [
        {"robot": RobotSpec(a_max=1.5)},
        {"robot": RobotSpec(drive="differential", a_max=2.0)},
        {"sensor": Sensor(noise=0.02, dropout=0.1)},
        {"sensor": Sensor(velocity="none")},
        {"sensor": Sensor(velocity="estimated", noise=0.02, agility=0.3)},
        {"sensor": Sensor(latency=0.2, period=0.2)},
    ],
)
def test_other_robots_and_sensors_arrive(changes: dict) -> None:
    """Inertia, wheels, noise, missing velocities and latency do not end in contact in a hall with a crossing disc."""
    for seed in range(costly(3, 30)):
        disc = Obstacle(0.3, BackAndForth((5.0, 0.4), (5.0, 5.6), (0.3, 0.5), (0.0, 1.0)))
        result = run(hall(disc, **changes), "paper", seed=seed)
        check_episode(result)
        assert result.reached, (changes, seed, result.outcome)


def crowded(seed: int, robot: RobotSpec) -> Scenario:
    """A hall with boxes that five slow discs cross."""
    rng = np.random.default_rng(seed)
    boxes = rng.random((16, 28)) < 0.05
    boxes[:, :3] = boxes[:, -3:] = False
    x = 3.0 + 2.0 * np.arange(5) + rng.uniform(-0.5, 0.5, 5)
    ends = zip(x.tolist(), (x + rng.uniform(-0.8, 0.8, 5)).tolist())
    discs = [Obstacle(0.3, BackAndForth((a, 0.4), (b, 7.6), (0.15, 0.4), (0.0, 1.0))) for a, b in ends]
    world = World(Grid(np.kron(boxes, np.ones((2, 2), dtype=bool)), 0.25), discs)
    return Scenario(world, (1.0, 4.0), (13.0, 4.0), robot, horizon=90.0, obstacle_speed=0.5, through_walls=True)


@pytest.mark.parametrize(
    "robot",
    [
        RobotSpec(),
        RobotSpec(a_max=1.5),
        RobotSpec(a_max=0.8),
        RobotSpec(drive="differential"),
        RobotSpec(drive="differential", a_max=1.0, turn_rate=1.5),
    ],
)
def test_crowded_rooms_are_crossed_by_every_robot(robot: RobotSpec) -> None:
    """With inertia, wheels or neither the robot keeps off walls, hardly ever touches a disc, and mostly arrives in time."""
    outcomes = []
    for seed in range(costly(4, 40)):
        result = run(crowded(seed, robot), "paper", seed=seed)
        check_episode(result)
        outcomes.append(result.outcome)
    assert not {Outcome.HIT_WALL, Outcome.ERROR} & set(outcomes)
    # The promise of no contact is the guard's, which the paper's own robot, that stops at once, drives without.
    guarded = robot.drive == "differential" or math.isfinite(robot.a_max)
    assert outcomes.count(Outcome.HIT_MOVING) <= (0 if guarded else 0.05 * len(outcomes)), outcomes
    # Turns and ramps take space that the paper does not plan for.
    slow = robot.drive == "differential" and math.isfinite(robot.a_max)
    assert outcomes.count(Outcome.REACHED) >= (0.5 if slow else 0.75) * len(outcomes), outcomes


def test_no_way_and_blind_robots_stand() -> None:
    """Without a way the robot stands and says why; without a sensor it still keeps off the walls."""
    blocked = HALL.blocked.copy()
    blocked[:, 20] = True
    result = run(Scenario(World(Grid(blocked, 0.25)), (1.0, 3.0), (9.0, 3.0), horizon=2.0), "paper")
    assert result.outcome is Outcome.TIMEOUT and result.length == 0.0
    assert result.trace.decisions[0][1].action == "stuck"
    assert run(hall(sensor=Sensor(dropout=1.0)), "paper").reached


def test_parameters_are_checked() -> None:
    """Wrong options raise the typed error that names them."""
    for wrong in (
        {"ants": 0},
        {"cycles": 1.5},
        {"margin": -1.0},
        {"growth": math.nan},
        {"lookahead": 0.0},
        {"lookahead": 1001.0},
        {"heuristic": "x"},
        {"distance_weight": -1.0},
    ):
        with pytest.raises(BadParameter, match=next(iter(wrong))):
            make_policy("paper", **wrong)


def test_encounters_have_their_names() -> None:
    """The five kinds of meeting, and the closest approach by hand."""
    east = (1.0, 0.0)
    names = {(-1.0, 0.1): "head-on", (0.5, 0.1): "overtaking", (0.1, 1.0): "crossing-right", (0.1, -1.0): "crossing-left"}
    for velocity, name in names.items():
        assert encounter(east, velocity) == name
    assert encounter(east, (0.0, 0.0)) == "standing"
    assert closest_approach((0, 0), (1, 0), (2, 2), (0, -1)) == (2.0, 0.0)
    assert closest_approach((0, 0), (1, 0), (-2, 0), (0, 0)) == (0.0, 2.0)
    assert closest_approach((3, 5), (1, 1), (5, 8), (1, 1)) == (0.0, math.sqrt(13.0))
    assert encounter((0.0, 0.0), east) == "head-on"
    rng = np.random.default_rng(3)
    for heading, turn in rng.uniform(-math.pi, math.pi, (200, 2)).tolist():
        speeds, (xy, other) = rng.uniform(0.1, 2.0, 2), rng.uniform(-5.0, 5.0, (2, 2))
        one, two = (v * np.array((math.cos(a), math.sin(a))) for v, a in zip(speeds, (heading, heading + turn)))
        crossing = "crossing-right" if turn > 0.0 else "crossing-left"
        kind = "overtaking" if abs(turn) < math.pi / 4 else "head-on" if abs(turn) > 0.75 * math.pi else crossing
        assert encounter(one, two) == kind
        t, away = closest_approach(xy, one, other, two)
        near = [math.dist(xy + s * one, other + s * two) for s in (t, t + 1e-2, max(t - 1e-2, 0.0))]
        assert t >= 0.0 and near[0] == pytest.approx(away) == pytest.approx(min(near))


def test_the_local_target_is_the_first_free_node_past_the_conflict() -> None:
    """First free node beyond; else the farthest in sight and range; else the last."""
    route = np.column_stack((np.arange(1.0, 9.0), np.zeros(8)))
    taken = np.array([False, False, True, True, False, False, True, False])
    every = np.ones(8, dtype=bool)
    assert local_target(route, taken, every, 2.5, (0.0, 0.0), 5.0, lambda p: True)[0] == 4
    assert local_target(route, taken, every, 5.0, (0.0, 0.0), 5.0, lambda p: True)[0] == 5, "not where it is met"
    assert local_target(route, taken, route[:, 0] > 5.5, 2.5, (0.0, 0.0), 5.0, lambda p: True)[0] == 5
    assert local_target(route, every, every, 2.5, (0.0, 0.0), 5.0, lambda p: p[0] < 4.5)[0] == 3
    assert local_target(route, every, every, 2.5, (0.0, 0.0), 5.0, lambda p: True)[0] == 4
    assert local_target(route, every, every, 2.5, (0.0, 0.0), 5.0, lambda p: False)[0] == 7
    assert local_target(route, every, route[:, 0] < 6.5, 2.5, (0.0, 0.0), 5.0, lambda p: False)[0] == 5


def test_local_targets_lie_on_the_global_path_and_ways_do_not_turn_back() -> None:
    """Step 8: every detour ends at a node of the path of Step 2 and goes on along it, without a step straight back."""
    detours = 0
    for name, seed in product(SCENES, range(cases(3, 20))):
        trace = played(name, "paper", seed).trace
        onward = trace.decisions[0][1].path.xy.tolist()
        for avoid in (one for _, one in trace.decisions if one.action == "avoid"):
            detours += 1
            nodes = avoid.path.xy[:1].tolist() + [b for a, b in pairwise(avoid.path.xy.tolist()) if math.dist(a, b) > 1e-9]
            i, j = onward.index(list(avoid.local_target)), nodes.index(list(avoid.local_target))
            rest = [one for n, one in enumerate(onward) if n >= i and (n == 0 or one != onward[n - 1])]
            assert nodes[j:] == rest, (name, seed)
            legs = np.diff(nodes, axis=0)
            legs /= np.hypot(*legs.T)[:, None]
            assert ((legs[1:] * legs[:-1]).sum(axis=1) > -0.99).all(), (name, seed)
    assert detours >= 10


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_shows_a_real_detour(name: str) -> None:
    """With the scene's own seed Figures 5 and 6 show a detour that leads a metre or more off the path of Figure 4."""
    trace = run(load_scenario(scene(name)), "paper").trace
    meet, midst = moments(trace)
    shown, onward = trace.decision_at(meet), shortest(trace.task).xy(trace.task.grid)
    assert shown.action == trace.decision_at(midst).action == "avoid" and shown.predicted is not None and meet <= midst
    away = np.hypot(*(shown.path.xy[:, None] - onward[None]).transpose(2, 0, 1)).min(axis=1)
    at_goal = shown.local_target == trace.task.goal
    assert away.max() >= 1.0 and (at_goal or np.hypot(*(onward - shown.local_target).T).min() < 1e-9)
    first = trace.decisions[0][1].path.xy  # from the start and to the goal, which need not be the middles of their cells
    followed = np.hypot(*(first[:, None] - onward[None, 1:-1]).transpose(2, 0, 1)).min(axis=0)
    assert followed.max() < 1e-9, "Figure 4 is the path that the robot follows"


def test_pheromone_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps 4 to 7: with the pheromone shuffled over the moves, ants stop learning, and other paths come out, longer ones."""
    search, weights, found = policy_module.explore, Trail.weights, []

    def shuffled(trail: Trail) -> np.ndarray:
        kept, mixed = trail.tau, trail.tau.copy()
        legal = kept > 0.0
        mixed[legal] = np.random.default_rng(len(found)).permutation(kept[legal])
        trail.tau = mixed
        try:
            return weights(trail)
        finally:
            trail.tau = kept

    def both(problem: Problem, **options: object) -> Exploration:
        as_it_is = search(problem, **options)
        if len(as_it_is.plan.cells):
            with monkeypatch.context() as patch:
                patch.setattr(Trail, "weights", shuffled)
                found.append((as_it_is, search(problem, **options)))
        return as_it_is

    monkeypatch.setattr(policy_module, "explore", both)
    for name, seed in product(("office", "warehouse"), range(cases(3, 20))):
        assert run(load_scenario(scene(name)), "paper", seed=seed).reached
    differ = [not np.array_equal(one.plan.cells, other.plan.cells) for one, other in found]
    assert len(found) >= 8 and np.mean(differ) >= 0.5
    over = np.array([[o.plan.length / o.plan.lower_bound, o.history[-1, 1] / o.plan.lower_bound] for p in found for o in p]) - 1
    # a cycle in which no ant arrives, as a few with shuffled pheromone are, has no mean length
    (best, last), (best_shuffled, last_shuffled) = over[::2].mean(axis=0), np.nanmean(over[1::2], axis=0)
    assert best < 0.5 * best_shuffled and last < 0.5 * last_shuffled
    assert all(len(one.history) == 20 for one, _ in found), "Step 7: the cycles run to their number"


def test_a_weight_on_distance_makes_the_robot_wait() -> None:
    """Least time goes round a disc that waits; where each metre costs 20 s more, the robot waits for it and drives less."""
    blocked = np.zeros((24, 40), dtype=bool)
    disc = Obstacle(0.4, Line((5.1, 0.6), (5.1, 5.5), 0.45, delay=0.0))
    scenario = Scenario(World(Grid(blocked, 0.25), [disc]), (1.125, 3.125), (9.125, 3.125))
    results = [run(scenario, make_policy("paper", distance_weight=weight)) for weight in (0.0, 20.0)]
    for result in results:
        check_episode(result)
    assert results[1].length <= results[0].length and all(result.reached for result in results)


def test_golden_traces() -> None:
    """C32: stored digests of whole traces are reproduced; a deliberate change edits tests/golden/traces.json."""
    golden = json.loads(GOLDEN.read_text())
    assert len(golden) >= 20
    for key, digest in golden.items():
        name, policy, seed = key.split()
        assert played(name, policy, int(seed)).trace.digest() == digest, key


@pytest.mark.parametrize("late", [{"latency": 0.3}, {"drive": "ackermann", "turning_radius": 0.5}], ids=["latency", "car"])
def test_a_robot_that_cannot_turn_or_stop_at_once_has_a_guard(late: dict) -> None:
    """Commands come late, or a car turns, though no acceleration is declared: the guard stops it before who comes ahead."""
    robot = RobotSpec(radius=0.3, dt=0.2, sensor_range=9.0, **late)
    for seed in range(costly(8, 200)):
        rng = np.random.default_rng(seed)
        places = [(float(x), float(rng.uniform(0.6, 5.4))) for x in np.linspace(3.5, 9.0, 6)]
        discs = (Obstacle(0.3, Bounce(xy, float(rng.uniform(0.5, 1.2)))) for xy in places)
        result = run(hall(*discs, robot=robot, sensor=Sensor(occlusion=False), obstacle_speed=1.2), "paper", seed=seed)
        check_episode(result)
        assert result.outcome not in (Outcome.HIT_MOVING, Outcome.HIT_WALL), seed


def test_at_a_stop_the_guard_remembers_who_was_just_seen() -> None:
    """Somebody stands 5 mm before a robot that departs, and is hidden then; the guard used to forget him."""
    grid, robot = Grid(np.zeros((40, 80), bool), 0.1), RobotSpec(a_max=1.0)
    policy, task = policy_module.PaperPolicy(), Task(grid, robot, (2.0, 2.0), (2.05, 2.0), obstacle_speed=0.0)
    policy.reset(task, 1)
    one = Tracks([1], [[2.0 + 2 * robot.radius + 0.005, 2.0]], [[0.0, 0.0]], [robot.radius])
    policy.act(Observation(0.0, (2.0, 2.0), (0.0, 0.0), 0.0, one))
    policy.depart(replace(task, goal=(6.0, 2.0)), 2)
    command = policy.act(Observation(0.1, (2.0, 2.0), (0.0, 0.0), 0.0, Tracks.none()))
    assert command.velocity[0] < 0.9 and policy.explain().guard != "free"


def test_a_command_that_acts_late_is_for_the_heading_at_that_time() -> None:
    """Wheels whose commands come late drive round a corner without turning to and fro."""
    blocked = np.zeros((24, 40), dtype=bool)
    blocked[:14, 18:20] = True
    robot = RobotSpec(radius=0.3, drive="differential", a_max=1.0, alpha_max=3.0, latency=0.3)
    result = run(Scenario(World(Grid(blocked, 0.25)), (1.125, 3.125), (9.125, 3.125), robot, horizon=60.0), "paper")
    check_episode(result)
    assert result.outcome is Outcome.REACHED
    pending = np.array([(0.0, 0.5)] * 3)
    turning = Observation(0.0, (1.0, 3.0), (0.0, 0.0), -0.15, Tracks.none(), turn_rate=0.5, pending=pending)
    assert Command((0.5, 0.0)).acts(turning, robot) == pytest.approx((0.5, 0.0), abs=1e-9)


def test_missing_velocities_are_those_between_scans() -> None:
    """A scan that is seen again tells no other velocity, and tracks without a number tell none."""
    policy = make_policy("paper")
    policy.reset(hall().task, 0)
    unknown = np.full((2, 2), math.nan)
    for t, stamp, x in ((0.0, 0.0, 6.0), (0.1, 0.0, 6.0), (0.2, 0.2, 5.9), (0.3, 0.2, 5.9)):
        seen = Observation(
            t, (1.1, 3.1), (0.0, 0.0), 0.0, Tracks([0, -1], [(x, x - 5.0), (x, 5.0)], unknown, [0.3, 0.3]), stamp
        )
        velocity = policy._look(seen).velocity
    assert velocity == pytest.approx(np.array([(-0.5, -0.5), (0.0, 0.0)]))


def test_places_of_tracks_that_are_gone_are_forgotten() -> None:
    """Of 200 tracks that come for one scan each, those of the last second are left; who comes back later has no velocity."""
    policy = make_policy("paper")
    policy.reset(hall().task, 0)
    unknown = [[math.nan, math.nan]]
    for k in range(200):
        policy._look(Observation(0.1 * k, (1.0, 2.0), (0.0, 0.0), 0.0, Tracks([k], [[4.0, 1.0]], unknown, [0.2])))
    assert 10 <= len(policy.places) <= 12
    ahead = policy._look(Observation(20.0, (1.0, 2.0), (0.0, 0.0), 0.0, Tracks([3], [[2.0, 1.0]], unknown, [0.2])))
    assert ahead.velocity.tolist() == [[0.0, 0.0]]


def test_tracks_of_a_scan_without_a_time_are_met() -> None:
    """Tracks that come with the stamp of no scan yet count as seen now."""
    policy = make_policy("paper")
    policy.reset(Task(Grid(np.zeros((40, 120), bool), 0.1), RobotSpec(), (1.0, 2.0), (11.0, 2.0)), 0)
    xy, nearest, stands = (1.0, 2.0), math.inf, Tracks([1], [[6.0, 2.0]], [[0.0, 0.0]], [0.3])
    for k in range(80):
        command = policy.act(Observation(0.1 * k, xy, (0.0, 0.0), 0.0, stands, stamp=-math.inf if k > 3 else math.nan))
        xy = xy[0] + 0.1 * command.velocity[0], xy[1] + 0.1 * command.velocity[1]
        nearest = min(nearest, math.dist(xy, (6.0, 2.0)) - 0.6)
    assert nearest > 0.0


@pytest.mark.parametrize(
    "robot", [RobotSpec(radius=0.2), RobotSpec(radius=0.2, drive="differential", a_max=1.0)], ids=["holonomic", "wheels"]
)
def test_a_robot_whose_place_was_wrong_rejoins_its_path(robot: RobotSpec) -> None:
    """From behind a wall it drives around that wall, at most at full speed; off the map it stands, until its place is right."""
    blocked = np.zeros((8, 12), dtype=bool)
    blocked[4, :9] = True
    policy, behind = make_policy("paper"), (2.0, 6.0)
    policy.reset(Task(Grid(blocked, 1.0), robot, (1.5, 1.5), (10.5, 1.5)), 0)
    for k, xy in enumerate([(1.5, 1.5), behind, (2.5, 1.5), (-1.0, 1.5), (3.0, 1.5)]):
        command = policy.act(Observation(0.1 * k, xy, (0.0 if robot.wheels else 1.0, 0.0), 0.0, Tracks.none()))
        assert math.hypot(*command.velocity) < 1.0 + 1e-9
        assert policy.routes.clear(xy, policy.nodes[0]) == (policy.explain().action == "follow") == (xy[0] > 0.0)
        if xy != behind:  # where wheels turn first
            assert command.velocity == pytest.approx((float(xy[0] > 0.0), 0.0), abs=1e-9)


def test_ants_that_were_watched_step_by_step_get_all_their_cycles_again() -> None:
    """A cycle that is played with fewer ant cycles leaves the number of them as it was."""
    policy = make_policy("paper", cycles=7)
    policy.reset(hall().task, 0)
    assert policy.step_ants(1, lambda: None).done and policy.cycles == 7
    with pytest.raises(ZeroDivisionError):
        policy.step_ants(1, lambda: 1 / 0)
    assert policy.cycles == 7


def test_trails_lead_from_cells_along_their_moves() -> None:
    """The pheromone on a move of the window lies between the centres of both cells; the least on any is not shown."""
    policy, pheromone = make_policy("paper"), np.zeros((3, 4, 8))
    policy.reset(hall().task, 0)
    assert len(policy.trails().amount) == 0
    pheromone[1, 2], pheromone[1, 2, 5] = 1.0, 4.0
    policy.found = SimpleNamespace(window=(5, 7, 3, 4), pheromone=pheromone)
    trails, (down, right) = policy.trails(), Moves.EIGHT.offsets[5].tolist()
    assert np.allclose(trails.here, [HALL.centre((6, 9))]) and np.allclose(trails.there, [HALL.centre((6 + down, 9 + right))])
    assert trails.amount.tolist() == [4.0]


def test_the_last_resort_puts_contact_off() -> None:
    """Away from whoever comes, but not into a wall; at rest if nobody does."""
    policy = make_policy("paper")
    for x, speed, action in ((1.125, -1.5, "step-aside"), (1.125, 0.0, "brake"), (0.4, -1.5, "step-aside")):
        policy.reset(hall().task, 0)
        tracks = Tracks([0], [[x + 1.0, 3.125]], [[speed, 0.0]], [0.3])
        ahead = policy._look(Observation(0.0, (x, 3.125), (0.0, 0.0), 0.0, tracks))
        vx, vy = policy._last_resort(ahead, 0, ()).velocity
        assert (policy.explain().action, math.hypot(vx, vy)) == (action, pytest.approx(0.0 if action == "brake" else 1.0))
        assert speed == 0.0 or abs(vy) > 0.3 or vx < 0.0 < x - 0.5
        assert policy.retreating and policy.nodes.tolist() == [[x, 3.125]]
