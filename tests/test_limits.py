"""Numbers that are finite but absurd are refused at the boundary, and copies of a map stay read-only (hardening)."""

from __future__ import annotations

import bz2
import copy
import pickle
import time
from pathlib import Path

import numpy as np
import pytest

from antway import BadInput, Grid, load_scenario
from antway.kernels.base.geometry import first_wall
from antway.world.motions import BackAndForth, Bounce, Line, Pursue, RandomWalk, Replay, Waypoints

HEAD = 'map = "m.txt"\nstart = [1.5, 1.5]\ngoal = [8.5, 8.5]\n'


def scenario(folder: Path, rest: str) -> Path:
    (folder / "m.txt").write_text("\n".join(["." * 10] * 10) + "\n")
    (folder / "s.toml").write_text(HEAD + rest)
    return folder / "s.toml"


@pytest.mark.parametrize(
    "make",
    [
        lambda v: Line((5.0, 2.0), (5.0, 8.0), v),
        lambda v: BackAndForth((5.0, 2.0), (5.0, 8.0), v),
        lambda v: Waypoints(((5.0, 2.0), (5.0, 8.0)), v),
        lambda v: Bounce((5.0, 2.0), v),
        lambda v: RandomWalk((5.0, 2.0), v),
        lambda v: Pursue((5.0, 2.0), v),
        lambda v: Line((5.0, v), (5.0, 8.0), 1.0),
        lambda v: Replay((0.0, 1.0), ((0.0, 0.0), (v, 0.0))),
        lambda v: Replay((0.0, v), ((0.0, 0.0), (1.0, 0.0))),
    ],
)
@pytest.mark.parametrize("value", [1e11, 1e18, 1e300])
def test_absurd_speeds_places_and_times_are_refused(make, value):
    """D1, D2: no motion may be so fast, so far or so long that arithmetic on it overflows or takes for ever."""
    with pytest.raises(BadInput):
        make(value)


def test_a_scenario_with_an_absurd_speed_is_refused(tmp_path):
    """D1: the file that once ended the process is wrong input."""
    rest = '[[obstacles]]\nradius = 0.3\nmotion = "bounce"\nstart = [7, 7]\nspeed = 1e18\n'
    with pytest.raises(BadInput, match="speed"):
        load_scenario(scenario(tmp_path, rest))


def test_a_long_step_far_outside_costs_no_more_than_the_map():
    """D2: contact with walls is found at once however far a disc goes, and however far off it is."""
    blocked = np.zeros((10, 10), bool)
    blocked[4, 4] = True
    started = time.monotonic()
    share, *_ = first_wall(blocked, 4.0, -1e9, 0.0, 2e9, 0.3)
    assert time.monotonic() - started < 30.0  # with the compilation; without the bound it takes days
    assert share == pytest.approx((1e9 + 4.0 - 0.8) / 2e9, rel=1e-12)


def test_replays_are_never_unpacked(tmp_path):
    """D4: a file that is packed is no CSV, whatever its ending."""
    (tmp_path / "t.csv.bz2").write_bytes(bz2.compress(b"0,1,1\n" * 100_000))
    rest = '[[obstacles]]\nradius = 0.3\nmotion = "replay"\nfile = "t.csv.bz2"\n'
    with pytest.raises(BadInput, match="file"):
        load_scenario(scenario(tmp_path, rest))


@pytest.mark.parametrize("rest", [".".join("a" * 30_000) + " = 1\n", "name = " + "[" * 1500 + "]" * 1500 + "\n"])
def test_deep_toml_is_refused_at_once(tmp_path, rest):
    """D5: neither a key of thousands of parts nor a value of thousands of levels costs time or a RecursionError."""
    started = time.monotonic()
    with pytest.raises(BadInput):
        load_scenario(scenario(tmp_path, rest))
    assert time.monotonic() - started < 5.0


def test_names_longer_than_a_file_may_have_are_refused(tmp_path):
    """D7: such a name is wrong input and no OSError."""
    path = scenario(tmp_path, "")
    path.write_text(HEAD.replace("m.txt", "m" * 300 + ".txt"))
    with pytest.raises(BadInput, match="map"):
        load_scenario(path)


@pytest.mark.parametrize("again", [copy.copy, copy.deepcopy, lambda grid: pickle.loads(pickle.dumps(grid))])
def test_copies_of_a_map_are_read_only(again):
    """D8: no way to copy a map makes one whose cells can be changed behind what is derived from it."""
    grid = Grid(np.eye(4, dtype=bool), 0.5, (1.0, 2.0, 0.0), np.eye(4, dtype=bool))
    other = again(grid)
    assert other == grid
    for array in (other.blocked, other.unknown):
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = False
