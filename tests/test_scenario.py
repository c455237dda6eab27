"""Scenario files: round trips, and errors that name the file, the table and the key."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from antway import (
    BadInput,
    BadParameter,
    BadScenario,
    CellBlocked,
    Grid,
    RobotSpec,
    Scenario,
    World,
    load_scenario,
    run,
    save_map,
)
from antway.kernels.robot.motions import first_inside
from antway.scenes import ROUNDS, SCENES, scene
from antway.world.motions import MAX_KNOTS, BackAndForth, Bounce, Line, Pursue, RandomWalk, Replay, Waypoints
from antway.world.scenario import save_scenario, to_toml
from antway.world.sensor import Sensor
from antway.world.world import Obstacle
from common import cases
from naive import world as naive

GOOD = """
name = "hall"
map = "hall.txt"
start = [1.5, 1.5]
goal = [8.5, 1.5]
[robot]
radius = 0.3
[sensor]
noise = 0.01
[[obstacles]]
radius = 0.3
motion = "line"
start = [5, 5]
end = [5, 1]
speed = [0.2, 0.4]
[[obstacles]]
radius = 0.2
motion = "replay"
file = "track.csv"
"""


@pytest.fixture
def hall(tmp_path: Path) -> Path:
    (tmp_path / "hall.txt").write_text("..........\n" * 10)
    (tmp_path / "track.csv").write_text("0,2,7\n1,3,7\n5.5,4,8\n")
    (tmp_path / "hall.toml").write_text(GOOD)
    return tmp_path / "hall.toml"


def test_a_replay_may_have_a_heading(hall: Path) -> None:
    """The heading t,x,y of a recording is not a fault, wherever comments and empty lines leave it."""
    plain = load_scenario(hall)
    track = hall.parent / "track.csv"
    numbers = track.read_text()
    for heading in ("t, x, y\n", "\n  \nt,x,y\n\n", "# of the camera\nT,X,Y\n# in s and m\n", "# t,x,y\n", "t,x,y # s, m\n"):
        track.write_text(heading + numbers)
        assert load_scenario(hall).world.obstacles[1] == plain.world.obstacles[1]
    for wrong in ("t,y,x\n", "t,x,y\nt,x,y\n"):
        track.write_text(wrong + numbers)
        with pytest.raises(BadScenario, match=r"obstacles\[1\]\.file"):
            load_scenario(hall)


def test_a_scenario_file_is_read(hall: Path) -> None:
    """Every key arrives where it belongs; what is left out has its default."""
    scenario = load_scenario(hall)
    assert scenario.robot == RobotSpec(radius=0.3) and scenario.sensor == Sensor(noise=0.01) and scenario.horizon == 60.0
    assert scenario.world.obstacles[0] == Obstacle(0.3, Line((5, 5), (5, 1), (0.2, 0.4)))
    assert scenario.world.obstacles[1].motion == Replay((0, 1, 5.5), ((2, 7), (3, 7), (4, 8)))


def test_round_trips(tmp_path: Path) -> None:
    """A random scenario saved and loaded is the same, plays the same, and saved again has the same bytes."""
    rng = np.random.default_rng(4)
    for case in range(cases(5, 200)):
        grid = Grid(np.zeros((20, 20), dtype=bool), 0.5, (-1.0, 2.5, 0.0))
        p = [tuple(q) for q in rng.uniform((2, 4), (8, 11), (5, 2))]
        kinds = [
            Line(p[0], p[1], (0.1, rng.random() + 0.2)),
            Waypoints(tuple(p), rng.random() + 0.1, loop=False, pause=0.25),
            Bounce(p[2], 0.5),
            RandomWalk(p[3], 0.5, turn_every=2.0),
            Replay((0.0, rng.random() + 0.1), (p[0], p[3])),
        ]
        scenario = Scenario(
            World(grid, [Obstacle(rng.random() + 0.05, kind) for kind in kinds]),
            (0.0, 3.5),
            (8.0, 11.0),
            RobotSpec(a_max=rng.random() + 1),
            Sensor(latency=rng.random()),
            name='a "name"\n',
            seed=case,
        )
        save_scenario(scenario, tmp_path / "one.toml")
        back = load_scenario(tmp_path / "one.toml")
        assert to_toml(back).replace("one_map.yaml", "") == to_toml(scenario)
        assert np.array_equal(back.world.grid.blocked, grid.blocked) and back.world.grid.origin == grid.origin
        first = (tmp_path / "one.toml").read_bytes()
        save_scenario(back, tmp_path / "one.toml")
        assert (tmp_path / "one.toml").read_bytes() == first
        lines = [s.world.timeline(case, 20.0) for s in (scenario, back)]
        assert lines[0].knot_xy.tobytes() == lines[1].knot_xy.tobytes()


def test_a_map_that_says_more_than_a_scenario_needs_is_kept(tmp_path: Path) -> None:
    """Saving a scenario over its own file used to replace the costs of its map by 0 and 100; another map is replaced."""
    (tmp_path / "one_map.pgm").write_bytes(b"P5\n40 30\n255\n" + bytes(np.full(1200, 200, np.uint8)))
    lines = "image: one_map.pgm", "mode: scale", "resolution: 0.25", "origin: [0.0, 0.0, 0.0]", "negate: 0"
    (tmp_path / "one_map.yaml").write_text("\n".join((*lines, "occupied_thresh: 0.65", "free_thresh: 0.1", "")))
    (tmp_path / "one.toml").write_text('map = "one_map.yaml"\nstart = [1.0, 1.0]\ngoal = [8.0, 5.0]\n')
    scenario = load_scenario(tmp_path / "one.toml")
    kept = [(tmp_path / f"one_map.{kind}").read_bytes() for kind in ("yaml", "pgm")]
    save_scenario(scenario, tmp_path / "one.toml")
    assert [(tmp_path / f"one_map.{kind}").read_bytes() for kind in ("yaml", "pgm")] == kept
    walls = np.zeros((30, 40), dtype=bool)
    walls[20, 20] = True
    other = replace(scenario, world=World(replace(scenario.world.grid, blocked=walls, unknown=None)))
    save_scenario(other, tmp_path / "one.toml")
    assert load_scenario(tmp_path / "one.toml").world.grid == other.world.grid


@pytest.mark.parametrize(
    ("old", "new", "field"),
    [
        ("radius = 0.3\n[sensor]", "radius = -0.3\n[sensor]", r"robot\.radius = -0.3"),
        ("radius = 0.3\n[sensor]", 'radius = "big"\n[sensor]', r"robot\.radius"),
        ("noise = 0.01", "nois = 0.01", r"sensor\.nois .*the keys are period"),
        ("noise = 0.01", "noise = nan", r"sensor\.noise"),
        ("speed = [0.2, 0.4]", "speed = [0.4, 0.2]", r"obstacles\[0\]\.speed"),
        ("speed = [0.2, 0.4]", "speed = true", r"obstacles\[0\]\.speed"),
        ("speed = [0.2, 0.4]", "", r"obstacles\[0\]\.speed = None: must be given"),
        ("end = [5, 1]", "end = [5]", r"obstacles\[0\]\.end"),
        ('motion = "line"', 'motion = "fly"', r"obstacles\[0\]\.motion .*line, back-and-forth"),
        ("radius = 0.2", "", r"obstacles\[1\]\.radius"),
        ("radius = 0.2", "radius = 1e300", r"obstacles\[1\]\.radius"),
        ("track.csv", "../track.csv", r"obstacles\[1\]\.file"),
        ("track.csv", "hall.txt", r"obstacles\[1\]\.file"),
        ("hall.txt", "/etc/passwd", "map"),
        ("hall.txt", "../hall.txt", "map"),
        ("hall.txt", "none.txt", "map"),
        ("start = [1.5, 1.5]", "start = [99, 1.5]", "start"),
        ("start = [1.5, 1.5]", "start = [0.1, 1.5]", "start"),
        ("start = [1.5, 1.5]", "", "start = None"),
        ('name = "hall"', "name = 3", "name"),
        ('name = "hall"', "horizon = 0", "horizon"),
        ('name = "hall"', "seed = 1.5", "seed"),
        ('name = "hall"', "horizon = 1e9", "horizon"),
        ('name = "hall"', "color = 1", "color .*the keys are name, map"),
        ('name = "hall"', "resolution = true", "resolution"),
        ('name = "hall"', "occupied = 0", "occupied"),
        ('name = "hall"', "top_first = 1", "top_first"),
        ("[robot]", "[[robot]]", "robot"),
        ("[[obstacles]]\nradius = 0.3", "[obstacles]\nradius = 0.3", "."),
        ("[sensor]", "[sensor", "scenario"),
    ],
)
def test_wrong_files_are_refused_by_name(hall: Path, old: str, new: str, field: str) -> None:
    """Each fault raises an error that names the file, the table and the key."""
    assert old in GOOD
    hall.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(BadInput, match=field) as caught:
        load_scenario(hall)
    assert "hall.toml" in str(caught.value)


def test_keys_of_the_scenario_below_a_table_are_named_with_it(hall: Path) -> None:
    """Who writes `map` below `[robot]` is told so, not only that there is no map."""
    hall.write_text('[robot]\nradius = 0.3\nmap = "hall.txt"\nstart = [1.5, 1.5]\ngoal = [5, 1.5]\n')
    with pytest.raises(BadInput, match=r"robot\.map"):
        load_scenario(hall)


def test_links_out_of_the_folder_are_refused(hall: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    """A link that leads out of the scenario's folder is not followed."""
    outside = tmp_path_factory.mktemp("outside") / "map.txt"
    outside.write_text("..........\n" * 10)
    (hall.parent / "hall.txt").unlink()
    (hall.parent / "hall.txt").symlink_to(outside)
    with pytest.raises(BadScenario, match="map"):
        load_scenario(hall)


def test_mutated_files_end_in_the_typed_error(hall: Path) -> None:
    """Any change of bytes gives a scenario or a BadInput."""
    rng = np.random.default_rng(11)
    good = GOOD.encode()
    for _ in range(cases(200, 20_000)):
        data = bytearray(good)
        for _ in range(rng.integers(1, 4)):
            at = int(rng.integers(len(data)))
            data[at : at + int(rng.integers(0, 3))] = bytes(rng.integers(0, 256, rng.integers(0, 3)).tolist())
        hall.write_bytes(data)
        try:
            load_scenario(hall)
        except BadInput as error:
            assert str(error)


def test_maps_far_from_the_origin_are_refused() -> None:
    """Floats are too coarse there: robots stood at walls in UTM coordinates."""
    for x, y in ((5e5, 5.4e6), (0.0, -2e6)):
        with pytest.raises(BadParameter, match="subtract the map's origin"):
            Scenario(World(Grid(np.zeros((40, 40), bool), 0.1, (x, y, 0.0))), (x + 1.0, y + 1.0), (x + 3.0, y + 3.0))


def test_scenarios_in_python_are_checked() -> None:
    """Ends in walls and wrong parts raise the typed error."""
    blocked = np.zeros((10, 10), dtype=bool)
    blocked[5, 5] = True
    world = World(Grid(blocked))
    for end in ((5.5, 5.5), (4.8, 5.5), (0.2, 5.0)):
        with pytest.raises(CellBlocked, match="goal"):
            Scenario(world, (1.0, 1.0), end)
    for start, away in (((4.8, 5.5), "0.2"), ((5.5, 5.5), "0"), ((9.75, 9.0), "0.25"), ((6.2, 6.2), "0.283")):
        with pytest.raises(CellBlocked, match=rf"start = .*radius, 0.3 m, from walls .*; the nearest is {away} m away$"):
            Scenario(world, start, (9.0, 9.0))
    for wrong in ({"horizon": -1}, {"seed": -1}, {"goal_tolerance": 0.0}, {"sensor": None}, {"name": 3}):
        with pytest.raises(BadParameter, match=next(iter(wrong))):
            Scenario(world, (1.0, 1.0), (9.0, 9.0), **wrong)


@pytest.mark.parametrize("path", ["", ".", "/", ".."])
def test_a_scenario_is_not_saved_as_a_folder(path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What is no file's name is refused, and no map is left behind."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BadParameter, match="path"):
        save_scenario(Scenario(World(Grid(np.zeros((10, 10), bool))), (1.0, 1.0), (9.0, 9.0)), path)
    assert not list(tmp_path.iterdir())


WALL = np.zeros((10, 10), dtype=bool)
WALL[:, 5] = True  # x from 5 to 6 m


@pytest.mark.parametrize(
    ("motion", "when"),
    [
        (Line((2.0, 2.0), (8.0, 2.0), 1.0, delay=1.0), "3.70"),
        (Line((2.0, 2.0), (8.0, 2.0), (0.0, 0.05)), "in a wall"),  # the speed drawn is too low to come there, and so below
        (BackAndForth((2.0, 2.0), (5.0, 2.0), 0.5), "5.40"),
        (Waypoints(((2.0, 2.0), (4.0, 2.0), (4.0, 8.0), (5.5, 8.0)), 1.0, loop=False), "8.70"),
        (Waypoints(((2.0, 2.0), (2.0, -3.0), (8.0, -3.0), (8.0, 2.0)), 0.01), "in a wall"),  # on the way back
        (Replay((0.0, 2.0), ((4.0, 2.0), (7.0, 2.0))), "0.47"),
        (Bounce((5.5, 5.0), 1.0), "0.00"),
        (RandomWalk((4.9, 5.0), 1.0), "0.00"),
        (Pursue((6.1, 5.0), 1.0), "0.00"),
    ],
)
def test_a_motion_through_a_wall_is_refused(motion, when: str) -> None:
    """The error names obstacle and time; `through_walls` lets it pass, and so does a wall that is only touched."""
    free = Obstacle(0.3, BackAndForth((4.7, 1.0), (4.7, 9.0), 0.5))
    world = World(Grid(WALL), [free, Obstacle(0.3, motion)])
    with pytest.raises(BadScenario, match=r"obstacles\[1\]\.motion.*" + when):
        Scenario(world, (1.0, 1.0), (1.0, 9.0))
    allowed = Scenario(world, (1.0, 1.0), (1.0, 9.0), through_walls=True)
    assert "through_walls = true" in to_toml(allowed)
    assert Scenario(World(Grid(WALL), [free, Obstacle(0.3, Line((3.0, 3.0), (-3.0, 3.0), 1.0))]), (1.0, 1.0), (1.0, 9.0))


def test_the_first_time_in_a_wall_is_that_of_the_naive_twin() -> None:
    """On random maps and motions the kernel finds the first contact that dense sampling finds."""
    rng = np.random.default_rng(3)
    for _ in range(cases(20, 500)):
        blocked = rng.random((8, 9)) < 0.1
        t, rc = np.cumsum(rng.uniform(0.1, 1.0, 4)), rng.uniform(-2.0, 10.0, (4, 2))
        radius = float(rng.uniform(0.05, 0.8))
        exact, sampled = first_inside(blocked, t, rc, radius), naive.first_inside(blocked, t, rc, radius, 2000)
        assert exact <= sampled + 1e-9 and (
            exact == sampled or sampled - exact < (t[-1] - t[0]) / 2000 + 1e-9 or grazes(blocked, t, rc, radius)
        )


def grazes(blocked: np.ndarray, t: np.ndarray, rc: np.ndarray, radius: float) -> bool:
    """Whether the contact is so slight that sampling misses it: a disc a little smaller has it later or not at all."""
    return first_inside(blocked, t, rc, radius - 1e-3) - first_inside(blocked, t, rc, radius) > (t[-1] - t[0]) / 2000


@pytest.mark.parametrize("name", (*SCENES, *ROUNDS))
def test_obstacles_of_the_shipped_scenes_keep_off_walls(name: str) -> None:
    """With any seed no obstacle enters a wall, by the swept test on its drawn motion."""
    scenario = load_scenario(scene(name))
    grid = scenario.world.grid
    for seed in range(cases(20, 200)):
        line = scenario.world.timeline(seed, scenario.horizon)
        for k in range(len(line)):
            t, xy = line.trajectory(k)
            radius = (line.radius[k] - 1e-6) / grid.resolution
            assert first_inside(grid.blocked, t, grid.to_points(xy), radius) == np.inf, (name, seed, k)


@pytest.mark.parametrize("name", SCENES)
def test_shipped_scenes_load(name: str) -> None:
    """Each shipped scene is a legal scenario whose obstacles keep clear of walls for its whole time."""
    scenario = load_scenario(scene(name))
    assert scenario.name == name
    line = scenario.world.timeline(0, scenario.horizon)
    grid = scenario.world.grid
    clearance = grid.clearance()
    for t in np.linspace(0, scenario.horizon, 300):
        for place, radius in zip(line.at(t)[0], line.radius):
            assert clearance[grid.cell_at(place)] >= radius - grid.resolution * 0.75, (name, place)
    with pytest.raises(BadParameter):
        scene("moon")
    with pytest.raises(BadParameter):
        run(scenario, "nobody")


def test_a_footprint_is_the_disc_round_it(hall: Path) -> None:
    """A polygon in place of the radius has its circumscribed disc; both at once, and what is no polygon, are refused."""
    hall.write_text(GOOD.replace("radius = 0.3\n[sensor]", "footprint = [[0.24, 0.18], [-0.24, 0.18], [0.0, -0.2]]\n[sensor]"))
    assert load_scenario(hall).robot.radius == pytest.approx(0.3) and len(load_scenario(hall).robot.footprint) == 3
    for wrong in ("radius = 0.3\nfootprint = [[0, 1], [1, 0], [0, 0]]", "footprint = [[0, 1], [1, 0]]", "footprint = 'car'"):
        hall.write_text(GOOD.replace("radius = 0.3\n[sensor]", f"{wrong}\n[sensor]"))
        with pytest.raises(BadInput, match=r"hall\.toml.*robot\.footprint"):
            load_scenario(hall)


def test_a_scenario_says_the_resolution_of_a_picture(tmp_path):
    """`resolution` gives a picture its size, `occupied` a ROS map its threshold, and a turned map is turned."""
    save_map(Grid(np.zeros((40, 60), bool)), tmp_path / "hall.png")
    (tmp_path / "hall.toml").write_text("map = 'hall.png'\nresolution = 0.1\nstart = [1.0, 2.0]\ngoal = [5.0, 2.0]\n")
    assert load_scenario(tmp_path / "hall.toml").world.grid == Grid(np.zeros((40, 60), bool), 0.1)
    save_map(Grid(np.zeros((40, 60), bool), 0.1, (0.0, 0.0, 0.5)), tmp_path / "turned.yaml")
    (tmp_path / "turned.toml").write_text("map = 'turned.yaml'\noccupied = 60\nstart = [1.0, 2.0]\ngoal = [3.0, 3.0]\n")
    assert load_scenario(tmp_path / "turned.toml").world.grid.origin[2] == 0.0
    (tmp_path / "hall.toml").write_text("map = 'hall.png'\nresolution = -1\nstart = [1.0, 2.0]\ngoal = [5.0, 2.0]\n")
    with pytest.raises(BadInput, match="resolution"):
        load_scenario(tmp_path / "hall.toml")


def test_numbers_of_numpy_are_written_as_numbers(tmp_path: Path) -> None:
    """A scenario whose numbers are scalars of NumPy is read back."""
    numbers = {"goal_tolerance": np.float64(0.3), "obstacle_speed": np.float64(1.0), "obstacle_swerve": np.float64(2.0)}
    place = Scenario(World(Grid(np.zeros((9, 9), bool))), (1.0, 1.0), (7.0, 7.0), seed=np.int64(3), **numbers)
    save_scenario(place, tmp_path / "a.toml")
    back = load_scenario(tmp_path / "a.toml")
    assert (back.seed, back.goal_tolerance, back.obstacle_speed, back.obstacle_swerve) == (3, 0.3, 1.0, 2.0)
    with pytest.raises(BadInput):
        save_scenario(place, 5)  # type: ignore[arg-type]
    with pytest.raises(BadParameter, match="robot"):
        place.driven_by("diff")  # type: ignore[arg-type]


def test_a_replay_of_too_many_knots_is_refused(hall: Path) -> None:
    """It is not cut short, after which the obstacle would stand."""
    t = np.arange(MAX_KNOTS + 1) * 1e-3
    np.savetxt(hall.parent / "long.csv", np.column_stack((t, 1.0 + 1e-3 * t, np.full(len(t), 3.0))), delimiter=",", fmt="%.4f")
    hall.write_text(hall.read_text() + '\n[[obstacles]]\nradius = 0.2\nmotion = "replay"\nfile = "long.csv"\n')
    with pytest.raises(BadInput, match=r"points\.length"):
        load_scenario(hall)
