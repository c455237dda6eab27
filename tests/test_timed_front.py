"""The front of time, distance and clearance: ants, dynamic programming, all paths there are, and each path of a front."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import numpy as np
import pytest

from antway import BadInput, BadParameter, Grid, Moves, Plan, Problem, Status, TooLarge, World, check_plan
from antway.ants.timed_front import LEVEL, TimedFront, exact_front, timed_front
from antway.cli import app
from antway.view.plans import front_figure
from antway.world.motions import BackAndForth, Line
from antway.world.timeline import Timeline
from antway.world.world import Obstacle
from common import cases

RADIUS = 0.2


def small(seed: int, rows: int = 7, cols: int = 8, obstacles: int = 3) -> tuple[Problem, Timeline]:
    """A small map with boxes that discs go back and forth over."""
    rng = np.random.default_rng(seed)
    blocked = rng.random((rows, cols)) < 0.15
    blocked[0, 0] = blocked[-1, -1] = False
    grid = Grid(blocked)
    moving = [
        Obstacle(
            float(rng.uniform(0.2, 0.4)),
            BackAndForth(
                tuple(rng.uniform(0, rows, 2)),
                tuple(rng.uniform(0, rows, 2)),
                float(rng.uniform(0.3, 1.0)),
                float(rng.random()),
            ),
        )
        for _ in range(obstacles)
    ]
    moves = Moves.EIGHT if seed % 2 else Moves.FOUR
    return Problem(grid, (0, 0), (rows - 1, cols - 1), moves), World(grid, moving).timeline(seed, 60.0)


def check(problem: Problem, line: Timeline, front: TimedFront, most: float) -> None:
    """Every path is legal, as long as it says, keeps the clearance it says by dense sampling, and none betters another."""
    period = float(problem.moves.lengths.max())
    for (time, distance, clearance), path in zip(front.values.tolist(), front.paths):
        assert path.t[0] == 0.0 and path.t[-1] == pytest.approx(time)
        assert np.allclose(np.diff(path.t), period), "each move and each wait takes a period"
        cells = np.array([problem.grid.cell_at(place) for place in path.xy.tolist()])
        driven = np.concatenate(([True], (np.diff(cells, axis=0) != 0).any(axis=1)))
        check_plan(problem, Plan(Status.FOUND, cells[driven].astype(np.int32), distance))
        at = np.linspace(0.0, time, 40 * len(path.t))
        robot = np.column_stack([np.interp(at, path.t, path.xy[:, axis]) for axis in (0, 1)])
        gaps = np.hypot(*(line.places(at) - robot[:, None]).transpose(2, 0, 1)) - line.radius - RADIUS
        least = min(float(gaps.min(initial=math.inf)), most)
        assert clearance - 1e-6 <= least < clearance + LEVEL + 0.05
    costs = front.values * [1.0, 1.0, -1.0]
    for one in costs:
        assert ((costs <= one + 1e-9).all(axis=1)).sum() == 1


def every_path(problem: Problem, line: Timeline, periods: int, most: float) -> list[tuple[float, float, float]]:
    """The front by going every way there is: no label is ever dropped."""
    period, offsets = float(problem.moves.lengths.max()), [*problem.moves.offsets.tolist(), [0, 0]]
    grid, found = problem.grid, set()

    def gap(a: tuple[int, int], b: tuple[int, int], n: int) -> float:
        at = np.linspace(0.0, 1.0, 4001)
        robot = np.array(grid.centre(a)) + at[:, None] * (np.array(grid.centre(b)) - grid.centre(a))
        away = np.hypot(*(line.places((n + at) * period) - robot[:, None]).transpose(2, 0, 1)) - line.radius - RADIUS
        return float(away.min(initial=math.inf))

    known: dict[tuple, float] = {}

    def go(cell: tuple[int, int], far: float, clear: float, n: int) -> None:
        if cell == problem.goal:
            found.add((round(n * period, 6), round(far, 6), round(clear, 6)))
            return
        for dr, dc in offsets if n < periods else []:
            there = (cell[0] + dr, cell[1] + dc)
            beside = grid.is_free((there[0], cell[1])) and grid.is_free((cell[0], there[1]))
            legal = grid.is_free(there) and (beside or not (dr and dc))
            if legal:
                key = (cell, there, n)
                if key not in known:
                    known[key] = gap(cell, there, n)
                if known[key] >= 0.0:
                    level = math.floor(min(known[key], most) / LEVEL + 1e-6) * LEVEL
                    go(there, far + math.hypot(dr, dc), min(clear, level), n + 1)

    go(problem.start, 0.0, most, 0)
    return sorted(
        one for one in found if not any(a <= one[0] and b <= one[1] and c >= one[2] and (a, b, c) != one for a, b, c in found)
    )


def test_dynamic_programming_finds_the_front_of_all_paths() -> None:
    """On tiny maps the exact front is that of every path there is."""
    for seed in range(cases(4, 20)):
        problem, line = small(seed, 3, 3, 1)
        periods = 5 if problem.moves is Moves.FOUR else 4
        horizon = periods * float(problem.moves.lengths.max())
        front = exact_front(problem, line, radius=RADIUS, horizon=horizon)
        assert np.allclose(front.values, np.array(every_path(problem, line, periods, 1.0)).reshape(-1, 3), atol=2e-3), seed


def test_ants_find_the_whole_front() -> None:
    """In at least 95 % of seeds the ants' front is the exact one; here they say themselves when it is."""
    whole, number = 0, cases(15, 100)
    for seed in range(number):
        problem, line = small(seed)
        exact = exact_front(problem, line, radius=RADIUS, horizon=25.0)
        front = timed_front(problem, line, radius=RADIUS, horizon=25.0, seed=seed)
        check(problem, line, exact, 1.0)
        check(problem, line, front, 1.0)
        assert front.status is exact.status
        whole += front.values.shape == exact.values.shape and np.allclose(front.values, exact.values)
    assert whole >= 0.95 * number


def test_a_budget_leaves_a_part_of_the_front_and_says_so() -> None:
    """With fewer labels the answer is legal and of status BUDGET; the same seed gives the same answer."""
    problem, line = small(7)
    some = timed_front(problem, line, radius=RADIUS, horizon=25.0, seed=3, budget=40)
    again = timed_front(problem, line, radius=RADIUS, horizon=25.0, seed=3, budget=40)
    assert some.status is Status.BUDGET and some.labels == 40 and np.array_equal(some.values, again.values)
    check(problem, line, some, 1.0)


def test_waiting_saves_distance_and_going_round_saves_time() -> None:
    """Behind a slow disc: sooner by a detour, or less far by waiting; a weight on distance chooses."""
    blocked = np.zeros((5, 9), dtype=bool)
    line = World(Grid(blocked), [Obstacle(0.4, Line((4.5, 2.5), (4.5, 8.0), 0.15, delay=6.0))]).timeline(0, 60.0)
    front = timed_front(Problem(Grid(blocked), (2, 0), (2, 8), Moves.FOUR), line, radius=RADIUS)
    assert len(front.paths) >= 2 and front.values[0, 1] > front.values[front.least(10.0), 1]
    assert front.least(0.0) == 0 and front.values[front.least(0.0, clearance=0.5), 2] >= 0.5
    with pytest.raises(BadInput, match="clearance"):
        front.least(0.0, clearance=5.0)


def test_wrong_input_and_no_path() -> None:
    """Moves that are too long, horizons that are too far, and goals that cannot be reached."""
    grid = Grid(np.zeros((4, 4), dtype=bool))
    with pytest.raises(BadInput, match=r"problem\.moves"):
        timed_front(Problem(grid, (0, 0), (3, 3), Moves.SIXTEEN))
    with pytest.raises(TooLarge, match="horizon"):
        timed_front(Problem(Grid(np.zeros((400, 400), dtype=bool)), (0, 0), (3, 3)), horizon=90.0)
    for name in ("radius", "v_max", "horizon", "most"):
        with pytest.raises(BadInput, match=name):
            exact_front(Problem(grid, (0, 0), (3, 3)), **{name: -1.0})
    assert timed_front(Problem(grid, (0, 0), (3, 3)), horizon=3.0).status is Status.NO_PATH
    lane = Problem(Grid(np.zeros((1, 4), dtype=bool)), (0, 0), (0, 3), Moves.FOUR)
    assert timed_front(lane, horizon=2.9).status is Status.NO_PATH
    assert timed_front(lane, horizon=3.0).values.tolist() == [[3.0, 3.0, 1.0]]
    still = timed_front(Problem(grid, (1, 1), (1, 1)))
    assert still.values.tolist() == [[0.0, 0.0, 1.0]] and len(still.paths[0].t) == 1


def test_who_is_there_already_has_the_gap_of_that_place() -> None:
    """A disc that stands on the robot, or beside it, counts without a move, too; what comes later does not."""
    problem = Problem(Grid(np.zeros((3, 3), dtype=bool)), (1, 1), (1, 1))
    for front in (exact_front, timed_front):
        for x, gap in ((1.6, None), (2.29, None), (2.3, 0.0), (2.4, 0.1), (2.45, 0.15), (2.48, 0.15), (9.0, 1.0)):
            values = [] if gap is None else [[0.0, 0.0, gap]]
            disc = Timeline.of([1], [0.5], [([0.0, 0.5], [(x, 1.5), (1.5, 1.5)])])
            for horizon in (0.1, 5.0):
                found = front(problem, disc, radius=0.3, horizon=horizon)
                assert found.status is (Status.FOUND if values else Status.NO_PATH)
                assert found.values.round(9).tolist() == values


def test_the_command_prints_and_draws_the_front(tmp_path, capsys: pytest.CaptureFixture) -> None:
    """`antway plan --pareto` gives the front as a table, as JSON and as a picture."""
    (tmp_path / "hall.txt").write_text("........\n" * 6)
    (tmp_path / "hall.toml").write_text(
        'map = "hall.txt"\nstart = [0.5, 0.5]\ngoal = [7.5, 5.5]\n[robot]\nradius = 0.3\n'
        '[[obstacles]]\nradius = 0.3\nmotion = "line"\nstart = [4.0, 0.5]\nend = [4.0, 5.5]\nspeed = 0.5\n'
    )
    where = ["plan", str(tmp_path / "hall.txt"), "--start", "0.5,0.5", "--goal", "7.5,5.5", "--radius", "0.3", "--pareto"]
    where += ["--obstacles", str(tmp_path / "hall.toml")]
    assert app([*where, "--json"], standalone_mode=False) in (0, None)
    record = json.loads(capsys.readouterr().out)
    assert record["status"] == "found" and record["objectives"] == ["time", "distance", "clearance"]
    assert len(record["front"]) == len(record["paths"]) >= 1
    assert app([*where, "--out", str(tmp_path / "front.png")], standalone_mode=False) in (0, None)
    printed = capsys.readouterr().out
    assert "all trade-offs found" in printed and f"drawn in {tmp_path / 'front.png'}" in printed
    assert (tmp_path / "front.png").stat().st_size > 10_000
    robot = [part for part in where if part not in ("--radius", "0.3")]
    assert app([*robot, "--robot", "jackal", "--json"], standalone_mode=False) in (0, None)
    driven = json.loads(capsys.readouterr().out)["front"]
    assert driven[0][0] < 0.6 * record["front"][0][0]


def test_the_obstacles_have_to_be_on_the_same_map(tmp_path, capsys: pytest.CaptureFixture) -> None:
    """A scenario on a map of another area is refused; one on other cells of the same area is not."""
    (tmp_path / "hall.txt").write_text("........\n" * 6)
    (tmp_path / "fine.txt").write_text("................\n" * 12)
    (tmp_path / "long.txt").write_text("..........\n" * 6)
    where = ["plan", str(tmp_path / "hall.txt"), "--start", "0.5,0.5", "--goal", "7.5,5.5", "--pareto", "--json"]
    for name, resolution in (("hall", 1.0), ("fine", 0.5), ("long", 1.0)):
        scenario = tmp_path / f"{name}.toml"
        scenario.write_text(f'map = "{name}.txt"\nresolution = {resolution}\nstart = [0.5, 0.5]\ngoal = [7.5, 5.5]\n')
        if name == "long":
            with pytest.raises(BadParameter, match=r"obstacles = .*long.toml.*: must be a scenario on this map"):
                app([*where, "--obstacles", str(scenario)], standalone_mode=False)
        else:
            assert app([*where, "--obstacles", str(scenario)], standalone_mode=False) in (0, None)
            assert json.loads(capsys.readouterr().out)["front"]


def test_the_command_gives_a_long_way_its_time(tmp_path, capsys: pytest.CaptureFixture) -> None:
    """What is farther than a minute away is reached; what stands in the only way all the time is not called "no path"."""
    (tmp_path / "hall.txt").write_text("." * 60 + "\n")
    (tmp_path / "hall.toml").write_text(
        'map = "hall.txt"\nstart = [0.5, 0.5]\ngoal = [59.5, 0.5]\nhorizon = 90.0\n'
        '[[obstacles]]\nradius = 0.3\nmotion = "line"\nstart = [9.0, 0.5]\nend = [9.1, 0.5]\nspeed = 0.5\n'
    )
    where = ["plan", str(tmp_path / "hall.txt"), "--start", "0.5,0.5", "--goal", "59.5,0.5", "--pareto"]
    assert app(where, standalone_mode=False) in (0, None)
    assert "83.44 s" in capsys.readouterr().out
    assert app([*where, "--obstacles", str(tmp_path / "hall.toml")], standalone_mode=False) == 4
    assert "none arrives within 90 s at 1 m/s" in capsys.readouterr().out


def test_the_picture_needs_a_path() -> None:
    """A front without a path cannot be drawn."""
    grid = Grid(np.zeros((4, 4), dtype=bool))
    with pytest.raises(BadInput, match="front"):
        front_figure(grid, timed_front(Problem(grid, (0, 0), (3, 3)), horizon=1.0))
    assert len(list(pairwise(front_figure(grid, timed_front(Problem(grid, (0, 0), (3, 3)))).axes))) == 1
