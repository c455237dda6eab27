"""Numbers that are finite but absurd are refused at the boundary, and copies of a map stay read-only (hardening)."""

from __future__ import annotations

import bz2
import contextlib
import copy
import pickle
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numba.core import event

from antway import BadInput, Command, Grid, Observation, RobotSpec, Task, Tracks, load_scenario, make_policy
from antway.kernels.base.geometry import first_wall
from antway.policies.guard import Guard, check_observation
from antway.ros2 import convert
from antway.ros2.scan import ScanTracker
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


@pytest.mark.parametrize("speed", [5e-324, 1e-300, (1e-12, 1.0)])
def test_speeds_next_to_nothing_are_refused(speed):
    """The time to get anywhere would overflow; an obstacle that stands has the speed 0."""
    for make in (Line, BackAndForth):
        with pytest.raises(BadInput, match="speed"):
            make((5.0, 2.0), (5.0, 8.0), speed)
        make((5.0, 2.0), (5.0, 8.0), 0.0)


def test_a_scenario_with_an_absurd_speed_is_refused(tmp_path):
    """D1: the file that once ended the process is wrong input."""
    rest = '[[obstacles]]\nradius = 0.3\nmotion = "bounce"\nstart = [7, 7]\nspeed = 1e18\n'
    with pytest.raises(BadInput, match="speed"):
        load_scenario(scenario(tmp_path, rest))


def test_a_long_step_far_outside_costs_no_more_than_the_map():
    """D2: contact with walls is found at once however far a disc goes, and however far off it is."""
    blocked = np.zeros((10, 10), bool)
    blocked[4, 4] = True
    first_wall(blocked, 4.0, 0.0, 0.0, 1.0, 0.3)  # is compiled by now
    started = time.monotonic()
    share, *_ = first_wall(blocked, 4.0, -1e9, 0.0, 2e9, 0.3)
    assert time.monotonic() - started < 5.0  # without the bound it takes days
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


TASK = Task(Grid(np.zeros((40, 40), bool), 0.25), RobotSpec(), (5.0, 5.0), (9.0, 5.0))


def seen(names, places, speeds=None, **own) -> Observation:
    n = len(places)
    tracks = Tracks(names, places, np.zeros((n, 2)) if speeds is None else speeds, np.full(n, 0.3))
    return Observation(**{"t": 0.0, "xy": (5.0, 5.0), "velocity": (0.0, 0.0), "heading": 0.0, "tracks": tracks} | own)


@pytest.mark.parametrize("names", [[7, 7], [2**60, 2**60 + 1], [7, 8]])
def test_a_guard_forgets_no_obstacle_of_a_number_that_occurs_twice(names):
    """D3: an obstacle in front brakes the robot whatever others are called; numbers beyond 2^53 are one number to floats."""
    guard = Guard()
    guard.reset(TASK)
    for t in (0.0, 0.1):  # also when both were there before
        passed = guard.limit(seen(names, [(5.75, 5.0), (9.0, 9.0)], t=t), Command((1.0, 0.0)))
        assert guard.did in ("slowed", "braked") and passed.velocity[0] < 1.0
    guard.limit(seen(names[:1], [(9.0, 9.0)], t=0.2), Command((1.0, 0.0)))
    assert guard.did != "free" or names == [7, 8], "nor when only the other one is seen any more"


def test_a_laser_tracker_does_not_take_two_for_one():
    """D3: tracks of one number that lack velocities never become one."""
    tracks = Tracks([7, 7], [(1.0, 1.0), (3.0, 3.0)], np.full((2, 2), np.nan), [0.3, 0.3])
    assert len(ScanTracker().update(0.0, tracks)) == 2
    assert len(ScanTracker().update(0.0, Tracks([7, 7, 8], 3.0 * np.eye(3)[:, :2], np.full((3, 2), np.nan), np.ones(3)))) == 3


@pytest.mark.parametrize("policy", ["antway", "paper"])
@pytest.mark.parametrize(
    "wrong",
    [
        {"velocity": [(1e300, 3e299)]},
        {"velocity": [(1e4, 0.0)]},
        {"xy": [(1e18, 0.0)]},
        {"own": {"velocity": (1e300, 0.0)}},
        {"own": {"xy": (1e300, 0.0)}},
        {"own": {"heading": 1e300}},
        {"own": {"t": 1e300}},
        {"own": {"stamp": -1e300}},
        {"own": {"turn_rate": np.nan}},
    ],
)
def test_absurd_observations_are_refused(policy, wrong):
    """D1, D2: what no robot and no obstacle can be is no observation; it once ended the process, or took for ever."""
    policy = make_policy(policy)
    policy.reset(TASK, 0)
    observation = seen([1], wrong.get("xy", [(7.0, 5.0)]), wrong.get("velocity"), **wrong.get("own", {}))
    with pytest.raises(BadInput):
        policy.act(observation)


@pytest.mark.parametrize("wrong", [5, "ab", np.array(1.0), (1.0,), {1: 2, 3: 4}])
def test_a_place_that_is_no_pair_is_refused(wrong):
    """Nor is an array without dimensions one; iterating over it was a TypeError."""
    with pytest.raises(BadInput, match=r"observation\.xy"):
        seen([1], [(7.0, 5.0)], xy=wrong)


def test_absurd_arrows_and_places_are_refused_in_messages():
    """D1: a marker's arrow of 1e300 m is no velocity."""
    tracks = Tracks([3], [(1.0, 2.0)], [(0.5, 0.0)], [0.3])
    for name, value in (("x", 1e300), ("y", 2000.0)):
        message = convert.markers_message(tracks, 0.0)
        setattr(message.markers[2].points[1], name, value)
        with pytest.raises(BadInput, match="points"):
            convert.read_markers(message)
    message = convert.markers_message(tracks, 0.0)
    message.markers[1].pose.position.x = 1e18
    with pytest.raises(BadInput, match="position"):
        convert.read_markers(message)


@pytest.mark.parametrize(
    "like",
    [
        lambda a: a.tolist(),
        lambda a: a.astype(a.dtype.newbyteorder(">")),
        lambda a: a.astype(np.float32 if a.dtype.kind == "f" else np.int32),
        lambda a: np.repeat(a, 2, axis=0)[::2],
        lambda a: np.asfortranarray(a),
        lambda a: pickle.loads(pickle.dumps(a)),
    ],
    ids=["lists", "big-endian", "narrow", "strided", "columns first", "pickled"],
)
def test_tracks_of_any_type_and_layout_are_those_that_kernels_are_compiled_for(like):
    """D10: nothing is compiled for them, and the command is the same."""
    plain = seen([1, 2], [(6.5, 5.0), (7.0, 6.5)], [(-0.5, 0.0), (0.0, -0.5)])
    commands, compiled = [], []

    class Compiling(event.Listener):
        def on_start(self, event):
            compiled.append(event)

        def on_end(self, event): ...

    for kind in (lambda a: a, like):
        policy = make_policy("antway")
        policy.reset(TASK, 0)
        t = plain.tracks
        arrays = [kind(array) for array in (t.id, t.xy, t.velocity, t.radius)]
        with event.install_listener("numba:compile", Compiling()) if kind is like else contextlib.nullcontext():
            commands.append(policy.act(replace(plain, tracks=Tracks(*arrays))))
    assert commands[0] == commands[1] and not compiled


def test_a_read_only_scan_is_taken_as_it_is():
    """D10: arrays that cannot be written, as from a buffer, cost no compilation."""
    xy = np.frombuffer(np.array([[6.5, 5.0]]).tobytes()).reshape(1, 2)
    assert Tracks([1], xy, xy, [0.3]).xy.flags.carray


@pytest.mark.parametrize("wrong", [["a"], [None], [True], [1.5], [1j], {}, "ab", None, [10**400], [np.nan], [2**64]])
def test_numbers_of_tracks_are_whole(wrong):
    """D10: what is no whole number is a typed error."""
    with pytest.raises(BadInput, match="tracks"):
        Tracks(wrong, [(1.0, 1.0)], [(0.0, 0.0)], [0.3])


@pytest.mark.parametrize("field", ["t", "xy", "velocity", "heading", "stamp", "turn_rate", "pending", "tracks"])
@pytest.mark.parametrize("wrong", ["x", [1], object(), {}, [None, None], True])
def test_what_is_no_observation_is_a_typed_error(field, wrong):
    """D10: in whatever field it comes."""
    with pytest.raises(BadInput):
        check_observation(seen([1], [(7.0, 5.0)], **{field: wrong}))
