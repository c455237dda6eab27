"""Suites: the same episodes on every machine and in every order, worlds as they are described, files refused by name."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from antway import Grid, RobotSpec, Scenario, World, run, save_map
from antway.arena.environments import read_tracks, walks
from antway.arena.suites import SUITES, Chance, Suite, SuiteEpisode, build, drawn, episodes, facts, load_suite, seed_of, stage
from antway.arena.synthetic import DENSITIES
from antway.errors import BadInput, BadParameter, BadScenario
from antway.tables import names
from antway.world.motions import BackAndForth, Bounce, Line, RandomWalk
from antway.world.scenario import to_toml
from antway.world.stage import Stage
from antway.world.world import Obstacle
from common import SHARED, needs_data


@pytest.mark.parametrize("spec", ["paper", "synthetic", "crossing", "encounters", "barn"])
def test_every_group_builds_the_same_twice(spec):
    """Each group gives a sound scenario, equal from one build to the next, with no obstacle on the robot at the start."""
    for episode in episodes(spec, 1):
        scenario = build(episode)
        assert to_toml(scenario) == to_toml(build(episode))
        places = scenario.world.timeline(episode.seed, 1.0).places(np.zeros(1))[0]
        gaps = np.hypot(*(places - scenario.start).T) - [one.radius for one in scenario.world.obstacles]
        assert (gaps > scenario.robot.radius).all()


def test_seeds_depend_on_names_alone():
    """A seed is a hash of what the episode is called: fixed for good, and different for every name and number."""
    assert seed_of("synthetic", "open/low", 0) == 3850625544610840973
    seeds = {episode.seed for episode in episodes("synthetic", 200)}
    assert len(seeds) == 18 * 200 and all(0 <= seed < 2**63 for seed in seeds)
    few, many = episodes("synthetic", 2), episodes("synthetic", 5)
    assert list(few) == list(many[: len(few)])


def test_worlds_do_not_depend_on_the_hash_seed():
    """Another process with another PYTHONHASHSEED builds the same worlds."""
    script = (
        "from antway.arena.suites import *; from antway.world.scenario import to_toml\n"
        "print(*(to_toml(build(e)) for e in episodes('synthetic', 1)[::9]))"
    )
    world = {**os.environ, "PYTHONHASHSEED": "78" if os.environ.get("PYTHONHASHSEED") == "77" else "77"}
    found = subprocess.run([sys.executable, "-c", script], env=world, check=True, capture_output=True, text=True).stdout
    assert found.rstrip("\n") == " ".join(to_toml(build(e)) for e in episodes("synthetic", 1)[::9]).rstrip("\n")


def test_synthetic_worlds_are_as_described():
    """Density, radii, speeds, turners, noise and declared bounds are those of the family; no disc begins in a wall."""
    for episode in episodes("synthetic", 1):
        scenario, (family, level) = build(episode), episode.group.split("/")
        density, _, variant = level.partition("-")
        obstacles, grid = scenario.world.obstacles, scenario.world.grid
        low, high = (0.6, 1.5) if variant == "fast" else (0.3, 0.9)
        assert len(obstacles) == round(DENSITIES[density] * 256) and grid.shape == (80, 80) and grid.resolution == 0.2
        assert all(0.2 <= one.radius <= 0.45 and low <= one.motion.speed <= high for one in obstacles)
        assert all(grid.clearance()[grid.cell_at(one.motion.start)] > one.radius for one in obstacles)
        turners = sum(isinstance(one.motion, RandomWalk) for one in obstacles)
        assert turners == (len(obstacles) // 2 if variant == "turners" else 0)
        assert scenario.sensor.noise == (0.05 if variant == "noise" else 0.0) and not scenario.sensor.occlusion
        assert (scenario.obstacle_speed, scenario.obstacle_surge) == (high, 0.5)
        assert bool(grid.blocked.any()) == (family != "open")
        assert math.dist(scenario.start, scenario.goal) > 10.0


def test_crossing_keeps_the_protocol():
    """CrowdNav's starts and goals; humans walk at most 1 m/s, start at rest from the circle, and keep clear of one another."""
    for episode in episodes("crossing", 4):
        scenario = build(episode)
        timeline = scenario.world.timeline(0, 25.0)
        places = timeline.places(np.linspace(0.0, 25.0, 101))
        assert len(scenario.world.obstacles) == 5 and scenario.robot.dt == 0.25 and scenario.goal_tolerance == 0.3
        assert (np.hypot(*np.moveaxis(np.diff(places, axis=0), 2, 0)) <= 0.25 + 1e-4).all()
        if episode.group == "circle":
            radii = np.hypot(*places[0].T)
            assert ((radii > 4.0 - math.sqrt(0.5)) & (radii < 4.0 + math.sqrt(0.5))).all()
            assert np.hypot(*(places[-1] + places[0]).T).max() < 0.5
        for a in range(5):
            for b in range(a):
                assert np.hypot(*(places[:, a] - places[:, b]).T).min() > 0.55


def test_facts():
    """The optimum of a free way is its length less the tolerance at full speed; a disc in the way delays it; walls kill."""
    room = Grid(np.zeros((60, 60), np.bool_), 0.2)
    spec = RobotSpec(radius=0.3, v_max=2.0)
    free = facts(Scenario(World(room), (1.1, 6.1), (11.1, 6.1), spec), 0)
    assert (free.bound, free.shortest) == pytest.approx((4.9, 9.8))
    assert 0.02 < free.difficulty < 0.5
    blocked = room.blocked.copy()
    blocked[:28], blocked[33:] = True, True
    barrier = Obstacle(0.4, BackAndForth((9.1, 6.1), (3.1, 6.1), 1.0))
    late = facts(Scenario(World(Grid(blocked, 0.2), (barrier,)), (1.1, 6.1), (11.1, 6.1), spec, horizon=20.0), 0)
    assert late.bound == math.inf and late.shortest == pytest.approx(9.8)
    gone = facts(Scenario(World(room, (Obstacle(0.3, Line((6.1, 2.0), (6.1, 10.0), 1.6)),)), (1.1, 6.1), (11.1, 6.1), spec), 0)
    assert free.bound < gone.bound < free.bound + 1.0


def test_an_arrival_in_the_last_control_period_has_an_optimum() -> None:
    """An episode drives the period that the horizon falls into to its end, and a goal reached by then counts."""
    room = World(Grid(np.zeros((60, 60), np.bool_), 0.2))
    for horizon, reached in ((4.79, False), (4.81, True)):  # the tolerance is reached at 4.85 s
        scenario = Scenario(room, (1.1, 6.1), (11.1, 6.1), RobotSpec(v_max=2.0), horizon=horizon, goal_tolerance=0.3)
        assert run(scenario, "follow").reached == reached
        assert facts(scenario, 0).bound == pytest.approx(4.85 if reached else math.inf)


def test_difficulty_is_what_dense_sampling_finds():
    """Of the same robots as many touch nothing when each is looked at 1,000 times a second, among walls and moving discs."""
    blocked = np.zeros((40, 50), np.bool_)
    blocked[10:14, 20:30] = blocked[30, :15] = True
    grid, spec, seed = Grid(blocked, 0.2), RobotSpec(radius=0.3, v_max=1.0), 3
    discs = (Obstacle(0.4, Line((1.0, 4.0), (9.0, 4.5), 0.8)), Obstacle(0.3, BackAndForth((5.0, 1.0), (5.0, 7.0), 1.2)))
    scenario = Scenario(World(grid, discs), (1.1, 1.1), (9.1, 1.1), spec, through_walls=True)
    inflated, chance, alive = grid.inflate(spec.radius), Chance(seed_of("survival", seed)), 0
    free = inflated.to_xy(np.argwhere(~inflated.blocked))
    low = np.argwhere(blocked)[:, ::-1] * grid.resolution
    t = np.arange(5001) / 1000
    line = scenario.world.timeline(seed, 5.0)
    places = line.places(t)
    for _ in range(200):
        angle = chance.turn()
        xy = free[chance.integer(0, len(free))] + t[:, None] * spec.v_max * np.array([math.cos(angle), math.sin(angle)])
        size = np.array([grid.shape[1], grid.shape[0]]) * grid.resolution
        if ((xy < spec.radius) | (xy > size - spec.radius)).any():
            continue
        gaps = np.hypot(*np.moveaxis(places - xy[:, None], 2, 0)) - line.radius
        if (gaps < spec.radius - 1e-9).any():
            continue
        nearest = np.clip(xy[:, None], low, low + grid.resolution)
        alive += not (np.hypot(*np.moveaxis(xy[:, None] - nearest, 2, 0)) < spec.radius - 1e-9).any()
    assert 20 < alive < 180
    assert facts(scenario, seed).difficulty == alive / 200


def test_chance():
    """Draws lie in their ranges and cover them."""
    chance = Chance(7)
    numbers = [chance.between(2.0, 3.0) for _ in range(500)]
    assert 2.0 <= min(numbers) < 2.05 and 2.95 < max(numbers) < 3.0
    assert {chance.integer(3, 7) for _ in range(200)} == {3, 4, 5, 6}


def test_wrong_suites_are_refused():
    """An unknown suite names those there are; a suite without its file, or with one it does not take, says so."""
    with pytest.raises(BadParameter, match=names(SUITES)):
        load_suite("synthetics")
    for spec in ("maps", "tracks", "synthetic:x.yaml"):
        with pytest.raises(BadParameter, match="suite"):
            load_suite(spec)
    for spec in ("synthetic", "paper", "encounters"):
        assert load_suite(f"{spec}:").name == spec  # a colon before nothing
    for spec in ("maps:", "tracks:"):
        with pytest.raises(BadParameter, match=f"{spec}FILE"):
            load_suite(spec)
    for spec in ("maps:none.yaml", "tracks:none.csv"):
        with pytest.raises(BadInput, match="none"):
            load_suite(spec)
    with pytest.raises(BadParameter, match="episodes"):
        episodes("synthetic", 0)
    with pytest.raises(BadParameter, match="group = 'thick': must be one of sparse, dense"):  # it was a KeyError
        build(SuiteEpisode("barn", "barn", "thick", 0))


def test_maps(tmp_path):
    """Any map file makes a suite; its name tells the content, so that results of a changed map are not mixed up."""
    walls = np.zeros((60, 80), np.bool_)
    walls[20:40, 38:42] = True
    save_map(Grid(walls, 0.2), tmp_path / "hall.yaml")
    suite = load_suite(f"maps:{tmp_path / 'hall.yaml'}")
    for episode in episodes(f"maps:{tmp_path / 'hall.yaml'}", 2):
        scenario, known = stage(episode)
        assert all(isinstance(one.motion, Bounce) for one in scenario.world.obstacles) and math.isfinite(known.shortest)
    names = {suite.name}
    for file in ("hall.yaml", "hall.pgm"):  # the picture as well as its description
        (tmp_path / file).write_bytes((tmp_path / file).read_bytes() + b"\n")
        names.add(load_suite(f"maps:{tmp_path / 'hall.yaml'}").name)
    assert len(names) == 3


def test_worlds_on_maps_are_as_described(tmp_path: Path) -> None:
    """Density, radii, speeds and room at the start; robot and discs are in the larger room, and the goal is far off."""
    (tmp_path / "two.txt").write_text("\n".join(("." * 20 + "#" + "." * 39,) * 40))
    for episode in episodes(f"maps:{tmp_path / 'two.txt'}", 4):
        scenario = build(episode)
        grid, ends, obstacles = scenario.world.grid, (scenario.start, scenario.goal), scenario.world.obstacles
        assert len(obstacles) == round({"low": 0.02, "medium": 0.05, "high": 0.1}[episode.group] * 40 * 59)
        places = np.array([*(one.motion.start for one in obstacles), *ends])
        room = np.argwhere(~grid.inflate(1.3).blocked & (np.arange(60) > 20)) + 0.5
        steps = np.sort(np.abs(np.vstack((room, scenario.goal[::-1])) - scenario.start[::-1]))
        length = steps[:, 1] + (math.sqrt(2.0) - 1.0) * steps[:, 0]
        assert (places[:, 0] > 21.0).all() and length[-1] > length.max() / 2
        assert scenario.horizon == pytest.approx(60.0 + 3.0 * length.max())
        for one in obstacles:
            assert 0.2 <= one.radius < 0.4 and 0.3 <= one.motion.speed < 0.9
            assert math.dist(one.motion.start, scenario.start) > one.radius + 1.3
        assert (scenario.obstacle_speed, scenario.obstacle_surge) == (0.9, 0.5) and grid.blocked.sum() == 40


def test_discs_on_a_fine_map_begin_clear_of_its_walls(tmp_path: Path) -> None:
    """A disc of 0.4 m needs more room than the robot; a place drawn for it may have only room for the robot."""
    walls = np.zeros((200, 200), np.bool_)
    walls[5::17, 5::17] = True
    save_map(Grid(walls, 0.05), tmp_path / "pillars.yaml")
    for episode in episodes(f"maps:{tmp_path / 'pillars.yaml'}", 3):
        world = build(episode).world
        assert all(world.grid.clearance()[world.grid.cell_at(one.motion.start)] > one.radius for one in world.obstacles)


def test_barns_are_as_described() -> None:
    """Discs go round between four places on legs that are clear of cylinders; there is a path of 18 m from start to goal."""
    filled = {}
    for episode in episodes("barn", 3):
        scenario, known = stage(episode)
        grid, obstacles = scenario.world.grid, scenario.world.obstacles
        filled.setdefault(episode.group, []).append(float(grid.blocked.mean()))
        assert len(obstacles) == {"sparse": 6, "dense": 12}[episode.group] and grid.shape == (80, 200)
        assert not grid.blocked[:, :20].any() and not grid.blocked[:, 180:].any() and 17.6 < known.shortest < 25.0
        walls = np.argwhere(grid.blocked)[:, ::-1] * 0.1
        for one in obstacles:
            points = np.array(one.motion.points)
            assert one.radius == 0.3 and 0.3 <= one.motion.speed < 0.8 and one.motion.loop and len(points) == 4
            assert ((points >= (3.0, 0.5)) & (points < (17.0, 7.5))).all()
            share = np.linspace(0.0, 1.0, 60)[:, None, None]
            along = (points + share * (np.roll(points, -1, axis=0) - points)).reshape(-1, 1, 2)
            assert np.hypot(*np.moveaxis(along - np.clip(along, walls, walls + 0.1), 2, 0)).min() >= 0.3 - 1e-9
    assert 0.025 < np.mean(filled["sparse"]) < 0.037 and 0.05 < np.mean(filled["dense"]) < 0.07


def walkers(path, *, csv):
    """Two people who cross, as an obsmat.txt (a place each 0.4 s) or CSV."""
    lines = []
    for name, (x, y, vx, vy) in {1: (0.0, 2.0, 1.0, 0.0), 2: (6.0, 8.0, 0.0, -0.9)}.items():
        for k in range(30):
            t, px, py = 0.4 * k, x + 0.4 * k * vx, y + 0.4 * k * vy
            obsmat = "".join(f"{value:16.7e}" for value in (700 + 6 * k, name, px, 0.0, py, vx, 0.0, vy))  # as published
            lines.append(f"{t!r},{name},{px!r},{py!r}" if csv else obsmat)
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("csv", [True, False])
def test_tracks(tmp_path, csv):
    """Recorded people walk where and when the file says, straight on before and after, in both formats alike."""
    spec = f"tracks:{walkers(tmp_path / ('t.csv' if csv else 'obsmat.txt'), csv=csv)}"
    episode = episodes(spec, 1)[0]
    scenario = build(episode)
    assert len(scenario.world.obstacles) == 2 and scenario.obstacle_speed == 1.5
    timeline = scenario.world.timeline(0, 5.0)
    since = (timeline.at(0.0)[0][0, 0] - 0.0) / 1.0  # the first walks along x at 1 m/s from x = 0 at time 0
    for t in (0.0, 0.7, 3.0):
        assert timeline.at(t)[0] == pytest.approx(np.array([(since + t, 2.0), (6.0, 8.0 - 0.9 * (since + t))]), abs=1e-6)


@pytest.mark.parametrize("rate", [2, 10, 24, 30, 100])
def test_people_come_and_go_at_their_own_speed_whatever_the_rate(tmp_path, rate):
    """Before and after a record of 4 s people walk on at 0.5 m/s, though its places have steps of 0.04 m, as pixels have.

    Within it no step is shorter than 0.1 s, in which such places would jump, and the first and the last place are kept.
    """
    rows = [(k / rate, v, round(v * k / rate / 0.04) * 0.04) for v in (0.5, -0.5) for k in range(4 * rate)]
    (tmp_path / "t.csv").write_text("".join(f"{t},{v > 0:d},{x},{v}\n" for t, v, x in rows))
    for person in build(episodes(f"tracks:{tmp_path / 't.csv'}", 1)[0]).world.obstacles:
        t, points = np.array(person.motion.t) - person.motion.record_start, np.array(person.motion.points)
        v = points[0, 1]
        assert np.interp((-3.0, 7.0), t, points[:, 0]) == pytest.approx((-3.0 * v, 7.0 * v), abs=0.35)
        assert np.diff(t).min() + 1e-6 >= 0.1 and np.median(np.diff(t)) < max(0.15, 1.01 / rate)
        ends = [row[::2] for row in rows if row[1] == v][:: 4 * rate - 1]
        assert list(zip(t, points[:, 0]))[1:-1][:: len(t) - 3] == [pytest.approx(end) for end in ends]


@pytest.mark.parametrize(("rate", "speed"), [(2, 0.6), (10, 1.0), (20, 0.625), (100, 0.625)])
def test_people_leave_with_their_last_velocity(tmp_path: Path, rate: int, speed: float) -> None:
    """Somebody walks 0.5 m/s, and the last place is 0.05 m farther on."""
    x = 0.5 * np.arange(4 * rate) / rate + 0.05 * (np.arange(4 * rate) == 4 * rate - 1)
    (tmp_path / "t.csv").write_text("".join(f"{k / rate},1,{at},0\n" for k, at in enumerate(x)))
    t, xy = build(episodes(f"tracks:{tmp_path / 't.csv'}", 1)[0]).world.obstacles[0].motion.arrays
    assert (xy[-1, 0] - xy[-2, 0]) / (t[-1] - t[-2]) == pytest.approx(speed)


def test_tracks_start_from_every_side(tmp_path):
    """Over the episodes of a file the robot starts near each of the four sides, and its goal is near the opposite one."""
    spec = f"tracks:{walkers(tmp_path / 't.csv', csv=True)}"
    sides = set()
    for episode in episodes(spec, 30):
        scenario = build(episode)
        rows, cols = scenario.world.grid.shape
        (x0, y0, _), size = scenario.world.grid.origin, np.array([cols, rows]) * 0.2
        ends = [(np.array(end) - (x0, y0)) / size for end in (scenario.start, scenario.goal)]
        axis = int(np.argmax(np.abs(ends[1] - ends[0])))
        assert sorted((ends[0][axis] < 0.11, ends[1][axis] < 0.11)) == [False, True]
        assert max(ends[0][axis], ends[1][axis]) > 0.89
        sides.add((axis, ends[0][axis] < 0.5))
    assert len(sides) == 4


def recording(path, *people):
    """A recording of people who walk from x, y with vx, vy between two times, and its suite."""
    rows = [(t, *who) for *who, since, until in people for t in np.arange(since, until, 0.4)]
    path.write_text("".join(f"{t},{k},{x + vx * (t - rows[0][0])},{y + vy * t}\n" for t, k, x, y, vx, vy in rows))
    return f"tracks:{path}"


def test_crowds_and_narrow_or_large_places(monkeypatch, tmp_path):
    """In crowds robots start nearer to people, or the file is refused; every episode can begin, and end in time."""
    crowd = [(100 * i + j, 1.0 * i, 1.0 * j, 0.0, 0.0, 0.0, 3.0) for i in range(11) for j in range(11)]
    spec = recording(tmp_path / "crowd.csv", *crowd)
    monkeypatch.setattr("antway.arena.environments._DRAWS", 3)
    scenario = build(episodes(spec, 1)[0])
    assert 0.8 < min(math.dist(scenario.start, at) for at in scenario.world.timeline(0, 1.0).at(0.0)[0]) < 1.5
    monkeypatch.setattr("antway.arena.environments._CLEAR", (9.0, 8.0))
    with pytest.raises(BadScenario, match="8 m from everybody"):
        build(episodes(spec, 2)[1])
    monkeypatch.undo()
    left = [(100 * i + j, 1.0 * i, 1.0 * j, 0.0, 0.0, 0.0, 3.0) for i in range(6) for j in range(11)]
    spec = recording(tmp_path / "left.csv", *left, (1000, 20.0, 5.0, 0.0, 0.0, 0.0, 3.0))
    for scenario in map(build, episodes(spec, 8)):  # half of the draws are too near to people, but not all
        assert min(math.dist(scenario.start, at) for at in scenario.world.timeline(0, 1.0).at(0.0)[0]) > 1.5
    for far in (8.0, 100.0):
        spec = recording(tmp_path / "line.csv", (1, 0.0, 0.0, 1.0, 0.0, 0.0, far))
        scenarios = [build(episode) for episode in episodes(spec, 6)]  # all have room at both ends
        assert all(s.horizon == max(60.0, 2.0 * math.dist(s.start, s.goal)) for s in scenarios)


def test_people_come_for_as_long_as_a_slow_robot_drives(tmp_path):
    """Somebody enters every 4 s; a robot of 0.22 m/s used to meet nobody after the first minute of its 273 s.

    The people, the start and the goal of the suite's own robot stay; who strolls in is not at the start of a slow one.
    """
    people = [(k, -4.0 * k, 2.0 + 3 * k % 9, 1.0, 0.0, 4.0 * k, 4.0 * k + 16.0) for k in range(200)]
    strolls = [(200 + k, k % 12 - 10.0, k // 12, 0.02, 0.0, 500.0, 540.0) for k in range(120)]
    spec = recording(tmp_path / "flow.csv", *people, *strolls)
    last = []
    for own, slow in zip(episodes(spec, 8), episodes(spec, 8, "turtlebot3_burger")):
        a, b = build(own), build(slow)
        last.append(max(one.motion.record_start for one in b.world.obstacles))
        assert last[-1] < b.horizon == pytest.approx(a.horizon / 0.22)
        assert (b.start, b.goal, b.world.obstacles[: len(a.world.obstacles)]) == (a.start, a.goal, a.world.obstacles)
        assert min(math.dist(b.start, at) for at in b.world.timeline(0, 1.0).at(0.0)[0]) > 1.5
    assert np.mean(last) > 200.0


def test_a_number_that_comes_again_is_somebody_else(tmp_path):
    """Nobody glides from where one person left to where another one with the same number enters later."""
    spec = recording(tmp_path / "t.csv", (1, 0.0, 0.0, 1.0, 0.0, 0.0, 8.0), (1, 0.0, 3.0, 1.0, 0.0, 60.0, 68.0))
    for episode in episodes(spec, 5):
        timeline = build(episode).world.timeline(0, 60.0)
        for t in range(0, 60, 7):
            assert {round(y, 6) for _, y in timeline.at(float(t))[0].tolist()} <= {0.0, 3.0}
    (tmp_path / "one.csv").write_text("0,1,0,0\n0,2,1,1\n")
    with pytest.raises(BadScenario, match="the same id"):
        load_suite(f"tracks:{tmp_path / 'one.csv'}")


@pytest.mark.parametrize(
    ("period", "gap", "same"), [(0.4, 2.9, True), (0.4, 3.1, False), (2.0, 5.9, True), (2.0, 6.1, False), (1.2, 3.5, True)]
)
def test_who_is_unseen_for_three_seconds_and_three_frames_is_somebody_else(
    tmp_path: Path, period: float, gap: float, same: bool
) -> None:
    """And whoever is seen once, after another such gap, is left out."""
    t = [0.0, period, 2 * period, 2 * period + gap, 3 * period + gap, 4 * period + gap, 100.0]
    (tmp_path / "t.csv").write_text("".join(f"{at},1,{0.8 * at},0\n" for at in t))
    found = [walk[:, 0].tolist() for walk in walks(read_tracks(str(tmp_path / "t.csv")), "t.csv")]
    assert found == [pytest.approx(t[:6])] if same else found == [pytest.approx(t[:3]), pytest.approx(t[3:6])]


def test_people_of_an_episode_are_those_whose_records_are_in_it(tmp_path: Path) -> None:
    """Nobody who left before it or comes after it; each walks in from beyond the area, at its own time."""
    people = [
        (k, -4.0 * k * v, 1.0 * k, v, 0.0, 4.0 * k, 4.0 * k + 3.0 + k % 9) for k in range(60) for v in (1.0 - 2.0 * (k % 2),)
    ]
    spec, begun = recording(tmp_path / "t.csv", *people), set()
    known = {walk[0, 2]: walk for walk in walks(read_tracks(str(tmp_path / "t.csv")), "t.csv")}  # by the place along y
    for episode in episodes(spec, 8):
        scenario = build(episode)
        here = {one.motion.points[1][1]: one.motion for one in scenario.world.obstacles}
        since = {round(known[y][0, 0] - motion.record_start, 6) for y, motion in here.items()}
        begun |= since
        (start,) = since
        assert 0.0 <= start <= 4.0 * 59 + 3.0 + 59 % 9 - 20.0
        overlap = {y for y, walk in known.items() if walk[0, 0] < start + scenario.horizon and walk[-1, 0] > start}
        assert here.keys() == overlap and len(here) > 5
        for y, motion in here.items():
            t, xy = motion.arrays
            assert t[1:-1] + start == pytest.approx(known[y][:, 0]) and xy[1:-1] == pytest.approx(known[y][:, 1:])
            speeds = np.diff(xy[[0, 1, -2, -1], 0]) / np.diff(t[[0, 1, -2, -1]])
            assert speeds == pytest.approx(np.full(3, 1.0 - 2.0 * (y % 2))) and min(t[1] - t[0], t[-1] - t[-2]) > 60.0
    assert len(begun) == 8


@pytest.mark.parametrize("text", ["", "1,2\n", "0,1,a,0\n1,1,0,0\n", "0,1,0,nan\n1,1,0,0\n", "0,1,0,0\n0,1,1,1\n", "\0\0"])
def test_broken_tracks_are_refused(tmp_path, text):
    """A broken track file is a typed error that says what it must hold."""
    (tmp_path / "t.csv").write_text(text)
    with pytest.raises(BadScenario, match=r"tracks|t,id,x,y"):
        load_suite(f"tracks:{tmp_path / 't.csv'}")


@needs_data
@pytest.mark.parametrize("file", ["teb_tutorials/maze.yaml", "roomba_lse/lse_arena.yaml"])
def test_shipped_maps_of_robots(file):
    """A map_server file of a real robot makes a suite whose episodes have a way; 3 x 4 m are enough."""
    _, known = stage(episodes(f"maps:{SHARED / 'ros_maps' / file}", 1)[0])
    assert math.isfinite(known.bound)


def test_a_recording_that_has_changed_is_read_again(tmp_path: Path) -> None:
    """The name of its suite tells what it holds, so no episode of the new name is played in the old world."""
    file, speeds = tmp_path / "people.csv", []
    for speed in (1.0, 1.6):
        t = 0.4 * np.arange(40)
        rows = [np.column_stack((t, np.full(40, i), 1.0 + speed * t, np.full(40, 2.0 + i))) for i in range(6)]
        np.savetxt(file, np.vstack(rows), delimiter=",")
        scenario = build(episodes(f"tracks:{file}", 1)[0])
        moves = [np.hypot(*np.diff(one.motion.arrays[1], axis=0).T) / 0.4 for one in scenario.world.obstacles]
        speeds.append(float(np.median(moves[0])))
    assert speeds == pytest.approx([1.0, 1.6])


def test_a_file_that_changes_meanwhile_spoils_no_row(tmp_path: Path) -> None:
    """Episodes of the old name are played neither in the new world nor by the new robot; they were, in a new process."""
    picture, body = tmp_path / "hall.txt", tmp_path / "body.toml"
    for changed, text in ((picture, ("." * 41 + "\n") * 40), (body, "radius = 0.2\n")):
        picture.write_text(("." * 40 + "\n") * 40)
        body.write_text("radius = 0.25\n")
        episode = episodes(f"maps:{picture}", 1, str(body))[0]
        changed.write_text(text)
        with pytest.raises(BadParameter, match="has changed since"):
            build(episode)


def test_a_map_that_is_turned_is_played(tmp_path: Path) -> None:
    """Episodes need cells along the axes of the world."""
    save_map(Grid(np.zeros((60, 80), dtype=bool), 0.2, (0.0, 0.0, 0.3)), tmp_path / "turned.yaml")
    scenario = build(episodes(f"maps:{tmp_path / 'turned.yaml'}", 1)[0])
    assert scenario.world.grid.origin[2] == 0.0 and scenario.world.obstacles


def test_names_of_files_may_contain_what_separates_robots() -> None:
    """Worlds of two maps differ although both names have " on " in them, and those of one are the same for every robot."""
    one, other = (SuiteEpisode("", f"maps:people on {where}", "sparse", 0) for where in ("stairs", "ground"))
    assert one.seed != other.seed
    assert replace(one, suite=f"{one.suite} on amr", robot="amr").seed == one.seed


def test_worlds_do_not_depend_on_the_name_of_a_robots_file(tmp_path: Path) -> None:
    """A file "robot on wheels.toml" used to get other worlds than "robot.toml" with the same content."""
    own = episodes("synthetic", 1)[0]
    for name in ("robot", "robot on wheels", "a on a on a"):
        (tmp_path / f"{name}.toml").write_text("radius = 0.25\n")
        other = episodes("synthetic", 1, str(tmp_path / f"{name}.toml"))[0]
        assert (other.own_suite, other.seed) == (own.suite, own.seed) and build(other).start == build(own).start


def test_a_larger_robot_starts_clear_of_obstacles_whose_place_is_drawn() -> None:
    """Whether a world has room for it depends on where obstacles start with the seed of the episode, not with seed 0."""

    def make(group: str, chance: Chance) -> Scenario:
        shuttle = BackAndForth((1.5, 5.0), (8.5, 5.0), 0.5, (0.0, 1.0))
        return Scenario(
            World(Grid(np.zeros((50, 50), bool), 0.2), (Obstacle(0.3, shuttle),)), (chance.between(3.0, 7.0), 5.5), (5.0, 1.0)
        )

    for seed in range(20):
        robot = RobotSpec(radius=0.5)
        scenario = drawn(Suite("shuttle", ("all",), make), "all", seed, robot)
        Stage(scenario, seed, 1.0)
